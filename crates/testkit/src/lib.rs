//! The conformance kit: laws that every plugin of a family must satisfy.
//!
//! A law is a function that panics, with a message that says which law is broken and where. A plugin's
//! tests build it from TOML with [`build`] and hand it to the laws of its family.

mod context;
pub use context::{TestContext, build, build_in};

mod accelerators;
pub mod assets;
mod ball;
mod instances;
mod peers;
mod random;
mod shapes;
mod solids;

pub use accelerators::{accelerator_agrees, accelerator_laws, random_rays};
pub use instances::Naive;
pub use random::Random;
pub use shapes::{Aim, placements, shape_laws, shape_laws_everywhere};

mod cameras;
mod integrators;
mod lights;
mod materials;
mod samplers;
mod spread;
mod streams;
mod textures;

pub use cameras::camera_laws;
pub use integrators::{Lamp, Simple, Wall, floor, integrator_laws, world_of_walls};
pub use lights::{light_laws, light_near_laws};
pub use materials::{dielectric_laws, furnace_laws, material_laws, sided_material_laws};
pub use peers::{peer_agrees, peer_laws};
pub use samplers::{random_sampler_laws, sampler_laws};
pub use textures::texture_laws;
