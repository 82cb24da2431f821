//! Accelerators: one file is one plugin is one Cargo feature is one TOML `type`.
//!
//! None of them changes an image: all return bit for bit what trying every element in order would return.

#![cfg_attr(
    not(feature = "all"),
    allow(unused, reason = "some parts serve single plugins")
)]

use whitstone_core::{Accelerators, DuplicateType, Registry};

#[cfg(feature = "brute_force")]
pub mod brute_force;
#[cfg(feature = "bvh")]
pub mod bvh;
#[cfg(feature = "bvh2")]
pub mod bvh2;

/// Adds every accelerator whose feature is on.
pub fn register(registry: &mut Registry) -> Result<(), DuplicateType> {
    let from = env!("CARGO_PKG_NAME");
    #[cfg(feature = "brute_force")]
    registry.add::<Accelerators, brute_force::BruteForce>(from)?;
    #[cfg(feature = "bvh")]
    registry.add::<Accelerators, bvh::Bvh>(from)?;
    #[cfg(feature = "bvh2")]
    registry.add::<Accelerators, bvh2::Bvh2>(from)?;
    Ok(())
}
