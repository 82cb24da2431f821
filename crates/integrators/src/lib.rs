//! Integrators: each plugin is one file, one Cargo feature and one TOML `type`.
//!
//! Section 6 of `docs/whitted-model.md` specifies all of them.
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

use whitstone_core::{DuplicateType, FamilyName, Integrators, Registry};

mod local_illumination;
mod paths;
mod rules;
mod wave;

#[cfg(feature = "appel")]
pub mod appel;
#[cfg(feature = "rasterizer")]
pub mod rasterizer;
#[cfg(feature = "whitted")]
pub mod whitted;

/// Registers every integrator whose feature is enabled.
pub fn register(registry: &mut Registry) -> Result<(), DuplicateType> {
    let from = env!("CARGO_PKG_NAME");
    registry.set_default(FamilyName::Integrator, "whitted");
    #[cfg(feature = "appel")]
    registry.add::<Integrators, appel::Appel>(from)?;
    #[cfg(feature = "rasterizer")]
    registry.add::<Integrators, rasterizer::Rasterizer>(from)?;
    #[cfg(feature = "whitted")]
    registry.add::<Integrators, whitted::Whitted>(from)?;
    Ok(())
}
