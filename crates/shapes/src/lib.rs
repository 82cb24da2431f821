//! Shapes: one file is one plugin is one Cargo feature is one TOML `type`.
//!
//! All are described in section 9 of `docs/whitted-model.md`.

use whitstone_core::{DuplicateType, Registry, Shapes};

#[cfg(feature = "sphere")]
pub mod sphere;

/// Adds every shape whose feature is on.
pub fn register(registry: &mut Registry) -> Result<(), DuplicateType> {
    let from = env!("CARGO_PKG_NAME");
    #[cfg(feature = "sphere")]
    registry.add::<Shapes, sphere::Sphere>(from)?;
    Ok(())
}
