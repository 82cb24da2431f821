//! Textures: each plugin is one file, one Cargo feature and one TOML `type`.
//!
//! Section 10 of `docs/whitted-model.md` specifies all of them.
//!
//! `docs/glossary.md` explains *twin*, *native*, *hosted*, *formula* and *lecture notes*.

#![cfg_attr(
    not(test),
    warn(clippy::disallowed_methods, reason = "the same image on every machine")
)]
#![cfg_attr(
    not(feature = "all"),
    allow(unused, reason = "some parts serve single plugins")
)]

use whitstone_core::{DuplicateType, FamilyName, Registry, Textures};

mod support;

#[cfg(feature = "checker")]
pub mod checker;
#[cfg(feature = "checker3d")]
pub mod checker3d;
#[cfg(feature = "constant")]
pub mod constant;
#[cfg(feature = "gradient")]
pub mod gradient;
#[cfg(feature = "grid_lines")]
pub mod grid_lines;
#[cfg(feature = "image")]
pub mod image;
#[cfg(feature = "mix")]
pub mod mix;
#[cfg(feature = "noise")]
pub mod noise;
#[cfg(feature = "product")]
pub mod product;
#[cfg(feature = "rings")]
pub mod rings;
#[cfg(feature = "solid")]
pub mod solid;
#[cfg(feature = "stripes")]
pub mod stripes;
#[cfg(feature = "synthesized")]
pub mod synthesized;
#[cfg(feature = "threshold")]
pub mod threshold;
#[cfg(feature = "vertex_color")]
pub mod vertex_color;
#[cfg(feature = "worley")]
pub mod worley;

/// Registers every texture whose feature is enabled.
pub fn register(registry: &mut Registry) -> Result<(), DuplicateType> {
    let from = env!("CARGO_PKG_NAME");
    registry.set_default(FamilyName::Texture, "image");
    #[cfg(feature = "checker")]
    registry.add::<Textures, checker::Checker>(from)?;
    #[cfg(feature = "checker3d")]
    registry.add::<Textures, checker3d::Checker3d>(from)?;
    #[cfg(feature = "constant")]
    registry.add::<Textures, constant::Constant>(from)?;
    #[cfg(feature = "gradient")]
    registry.add::<Textures, gradient::Gradient>(from)?;
    #[cfg(feature = "grid_lines")]
    registry.add::<Textures, grid_lines::GridLines>(from)?;
    #[cfg(feature = "image")]
    registry.add::<Textures, image::Image>(from)?;
    #[cfg(feature = "mix")]
    registry.add::<Textures, mix::Mix>(from)?;
    #[cfg(feature = "noise")]
    registry.add::<Textures, noise::Noise>(from)?;
    #[cfg(feature = "product")]
    registry.add::<Textures, product::Product>(from)?;
    #[cfg(feature = "rings")]
    registry.add::<Textures, rings::Rings>(from)?;
    #[cfg(feature = "solid")]
    registry.add::<Textures, solid::Solid>(from)?;
    #[cfg(feature = "stripes")]
    registry.add::<Textures, stripes::Stripes>(from)?;
    #[cfg(feature = "synthesized")]
    registry.add::<Textures, synthesized::Synthesized>(from)?;
    #[cfg(feature = "threshold")]
    registry.add::<Textures, threshold::Threshold>(from)?;
    #[cfg(feature = "vertex_color")]
    registry.add::<Textures, vertex_color::VertexColor>(from)?;
    #[cfg(feature = "worley")]
    registry.add::<Textures, worley::Worley>(from)?;
    Ok(())
}
