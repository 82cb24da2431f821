//! Samplers: each plugin is one file, one Cargo feature and one TOML `type`.
//!
//! Section 5 of `docs/whitted-model.md` specifies all of them.
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

use whitstone_core::hash::mix;
use whitstone_core::{DuplicateType, FamilyName, Registry, Samplers};

mod support;

#[cfg(feature = "adaptive")]
pub mod adaptive;
#[cfg(feature = "center")]
pub mod center;
#[cfg(feature = "grid")]
pub mod grid;
#[cfg(feature = "sobol")]
pub mod sobol;
#[cfg(feature = "stratified")]
pub mod stratified;

/// Hash of a pixel (column i, row j).
fn hash_of_pixel(seed: u32, [i, j]: [u32; 2]) -> u32 {
    mix(mix(mix(seed).wrapping_add(j)).wrapping_add(i))
}

/// Registers every sampler whose feature is enabled.
pub fn register(registry: &mut Registry) -> Result<(), DuplicateType> {
    let from = env!("CARGO_PKG_NAME");
    registry.set_default(FamilyName::Sampler, "center");
    #[cfg(feature = "adaptive")]
    registry.add::<Samplers, adaptive::Adaptive>(from)?;
    #[cfg(feature = "center")]
    registry.add::<Samplers, center::Center>(from)?;
    #[cfg(feature = "grid")]
    registry.add::<Samplers, grid::Grid>(from)?;
    #[cfg(feature = "sobol")]
    registry.add::<Samplers, sobol::Sobol>(from)?;
    #[cfg(feature = "stratified")]
    registry.add::<Samplers, stratified::Stratified>(from)?;
    Ok(())
}
