//! Third-party ray tracing kernels (backends) as accelerators: each is one file, one Cargo feature
//! and one TOML `type`.
//!
//! They render the same scenes with the same surrounding code, so that their errors and times are
//! directly comparable with ours. They find all hits on triangles, **in single precision**. So they
//! do not obey the law of accelerators, and report that
//! ([`whitstone_core::Accelerator::approximation_note`]). All other shapes are tested one by one in
//! double precision. `docs/backends.md` lists the differences and their size.

use whitstone_core::{DuplicateType, Registry};

#[cfg(feature = "embree")]
pub mod embree;
#[cfg(feature = "obvhs")]
pub mod obvhs;
#[cfg(any(feature = "embree", feature = "obvhs"))]
mod single;

/// Registers every backend whose feature is enabled.
pub fn register(registry: &mut Registry) -> Result<(), DuplicateType> {
    #[cfg(feature = "embree")]
    registry.add::<whitstone_core::Accelerators, embree::Embree>(env!("CARGO_PKG_NAME"))?;
    #[cfg(feature = "obvhs")]
    registry.add::<whitstone_core::Accelerators, obvhs::Obvhs>(env!("CARGO_PKG_NAME"))?;
    let _ = registry;
    Ok(())
}
