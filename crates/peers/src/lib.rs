//! Ray tracing kernels of others as accelerators: one file is one peer is one Cargo feature is one
//! TOML `type`.
//!
//! They render the same scenes by the same code around them, so that their errors and times stand
//! on the same axes as ours. Triangles are theirs alone, **in single precision**: they do not obey
//! the law of accelerators, and say so ([`whitstone_core::Accelerator::caveat`]). All other shapes
//! are tried one by one in double precision. `docs/peers.md` says what differs and by how much.

use whitstone_core::{DuplicateType, Registry};

#[cfg(feature = "embree")]
pub mod embree;
#[cfg(feature = "obvhs")]
pub mod obvhs;
#[cfg(any(feature = "embree", feature = "obvhs"))]
mod single;

/// Adds every peer whose feature is on.
pub fn register(registry: &mut Registry) -> Result<(), DuplicateType> {
    #[cfg(feature = "embree")]
    registry.add::<whitstone_core::Accelerators, embree::Embree>(env!("CARGO_PKG_NAME"))?;
    #[cfg(feature = "obvhs")]
    registry.add::<whitstone_core::Accelerators, obvhs::Obvhs>(env!("CARGO_PKG_NAME"))?;
    let _ = registry;
    Ok(())
}
