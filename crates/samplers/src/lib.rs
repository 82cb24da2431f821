//! Samplers: one file is one plugin is one Cargo feature is one TOML `type`.
//!
//! All are described in section 5 of `docs/whitted-model.md`.

#![cfg_attr(
    not(feature = "all"),
    allow(unused, reason = "some parts serve single plugins")
)]

use whitstone_core::{DuplicateType, Registry, Samplers};

#[cfg(feature = "center")]
pub mod center;
#[cfg(feature = "grid")]
pub mod grid;

/// Adds every sampler whose feature is on.
pub fn register(registry: &mut Registry) -> Result<(), DuplicateType> {
    let from = env!("CARGO_PKG_NAME");
    #[cfg(feature = "center")]
    registry.add::<Samplers, center::Center>(from)?;
    #[cfg(feature = "grid")]
    registry.add::<Samplers, grid::Grid>(from)?;
    Ok(())
}
