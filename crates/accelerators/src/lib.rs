//! Accelerators: each plugin is one file, one Cargo feature and one TOML `type`.
//!
//! No accelerator changes an image: each returns, bit for bit, the result of testing every element
//! in order. An element is a triangle of a mesh, or a whole shape of any other kind (also an
//! instance).
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

use whitstone_core::{Accelerators, DuplicateType, Registry};

mod support;

#[cfg(feature = "brute_force")]
pub mod brute_force;
#[cfg(feature = "bsp")]
pub mod bsp;
#[cfg(feature = "bvh")]
pub mod bvh;
#[cfg(feature = "bvh2")]
pub mod bvh2;
#[cfg(feature = "grid")]
pub mod grid;
#[cfg(feature = "kdtree")]
pub mod kdtree;
#[cfg(feature = "obb_bvh")]
pub mod obb_bvh;
#[cfg(feature = "octree")]
pub mod octree;
#[cfg(feature = "slab_bvh")]
pub mod slab_bvh;

/// Registers every accelerator whose feature is enabled.
pub fn register(registry: &mut Registry) -> Result<(), DuplicateType> {
    let from = env!("CARGO_PKG_NAME");
    registry.set_automatic_accelerator(support::automatic::choose);
    #[cfg(feature = "brute_force")]
    registry.add::<Accelerators, brute_force::BruteForce>(from)?;
    #[cfg(feature = "bvh")]
    registry.add::<Accelerators, bvh::Bvh>(from)?;
    #[cfg(feature = "bvh2")]
    registry.add::<Accelerators, bvh2::Bvh2>(from)?;
    #[cfg(feature = "bsp")]
    registry.add::<Accelerators, bsp::Bsp>(from)?;
    #[cfg(feature = "grid")]
    registry.add::<Accelerators, grid::Grid>(from)?;
    #[cfg(feature = "kdtree")]
    registry.add::<Accelerators, kdtree::KdTree>(from)?;
    #[cfg(feature = "obb_bvh")]
    registry.add::<Accelerators, obb_bvh::ObbBvh>(from)?;
    #[cfg(feature = "octree")]
    registry.add::<Accelerators, octree::Octree>(from)?;
    #[cfg(feature = "slab_bvh")]
    registry.add::<Accelerators, slab_bvh::SlabBvh>(from)?;
    Ok(())
}
