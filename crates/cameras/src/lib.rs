//! Cameras: each plugin is one file, one Cargo feature and one TOML `type`.
//!
//! Section 4 of `docs/whitted-model.md` specifies all of them.
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

use whitstone_core::{Cameras, DuplicateType, Registry};

mod support;

#[cfg(feature = "environment")]
pub mod environment;
#[cfg(feature = "orthographic")]
pub mod orthographic;
#[cfg(feature = "perspective")]
pub mod perspective;
#[cfg(feature = "thin_lens")]
pub mod thin_lens;

/// Registers every camera whose feature is enabled.
pub fn register(registry: &mut Registry) -> Result<(), DuplicateType> {
    let from = env!("CARGO_PKG_NAME");
    #[cfg(feature = "environment")]
    registry.add::<Cameras, environment::Environment>(from)?;
    #[cfg(feature = "orthographic")]
    registry.add::<Cameras, orthographic::Orthographic>(from)?;
    #[cfg(feature = "perspective")]
    registry.add::<Cameras, perspective::Perspective>(from)?;
    #[cfg(feature = "thin_lens")]
    registry.add::<Cameras, thin_lens::ThinLens>(from)?;
    Ok(())
}
