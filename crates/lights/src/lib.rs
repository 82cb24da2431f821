//! Lights: each plugin is one file, one Cargo feature and one TOML `type`.
//!
//! Section 7 of `docs/whitted-model.md` specifies all of them.
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

use whitstone_core::{DuplicateType, Lights, Registry};

mod support;

#[cfg(feature = "ambient")]
pub mod ambient;
#[cfg(feature = "area")]
pub mod area;
#[cfg(feature = "background")]
pub mod background;
#[cfg(feature = "directional")]
pub mod directional;
#[cfg(feature = "environment")]
pub mod environment;
#[cfg(feature = "point")]
pub mod point;
#[cfg(feature = "projector")]
pub mod projector;
#[cfg(feature = "spot")]
pub mod spot;

/// Registers every light whose feature is enabled.
pub fn register(registry: &mut Registry) -> Result<(), DuplicateType> {
    let from = env!("CARGO_PKG_NAME");
    #[cfg(feature = "ambient")]
    registry.add::<Lights, ambient::Ambient>(from)?;
    #[cfg(feature = "area")]
    registry.add::<Lights, area::Area>(from)?;
    #[cfg(feature = "background")]
    registry.add::<Lights, background::Background>(from)?;
    #[cfg(feature = "directional")]
    registry.add::<Lights, directional::Directional>(from)?;
    #[cfg(feature = "environment")]
    registry.add::<Lights, environment::Environment>(from)?;
    #[cfg(feature = "point")]
    registry.add::<Lights, point::Point>(from)?;
    #[cfg(feature = "projector")]
    registry.add::<Lights, projector::Projector>(from)?;
    #[cfg(feature = "spot")]
    registry.add::<Lights, spot::Spot>(from)?;
    Ok(())
}
