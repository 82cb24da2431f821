//! The conformance kit: laws (property tests) that every plugin of a family must satisfy.
//!
//! A law is a function that panics with a message that says which law is broken and where. A
//! plugin's tests build the plugin from TOML with [`build`] and pass it to the laws of its family.
//!
//! One macro call does all of this, also for tables with ranges ([`shape_laws!`],
//! [`accelerator_laws!`], [`material_laws!`], [`texture_laws!`], [`camera_laws!`],
//! [`light_laws!`]): it draws random configurations, shrinks one that breaks a law, and prints a
//! scene that demonstrates it.

mod context;
pub use context::{TestContext, build, build_in};

mod accelerators;
pub mod assets;
mod backends;
mod ball;
mod broken;
mod instances;
mod random;
mod shapes;
mod solids;
mod test_shapes;

pub use accelerators::{accelerator_agrees, accelerator_laws, accelerator_laws_of_part, random_rays};
pub use broken::Broken;
pub use instances::Naive;
pub use random::Random;
pub use shapes::{Aim, placements, shape_laws, shape_laws_everywhere};

mod cameras;
mod integrators;
#[cfg(feature = "properties")]
mod lawful;
mod lights;
#[cfg(feature = "properties")]
mod macros;
mod materials;
#[cfg(feature = "properties")]
mod properties;
mod samplers;
mod spread;
mod streams;
#[cfg(feature = "properties")]
mod template;
mod textures;

#[cfg(feature = "properties")]
pub use lawful::{Lawful, Things};
#[cfg(feature = "properties")]
pub use properties::{Failure, first_failure, hold, holds_in};
/// Used by the macros.
#[doc(hidden)]
pub use whitstone_core as core;

pub use backends::{backend_agrees, backend_laws};
pub use cameras::camera_laws;
pub use integrators::{Lamp, Simple, Wall, floor, integrator_laws, world_of_walls};
pub use lights::{light_laws, light_near_laws};
pub use materials::{
    dielectric_laws, energy_laws, furnace_laws, material_laws, materials_agree, reciprocity_laws,
    sided_material_laws,
};
pub use samplers::{random_sampler_laws, sampler_laws};
pub use test_shapes::tiny_ball;
pub use textures::texture_laws;
