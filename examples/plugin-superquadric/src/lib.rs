//! A superquadric for Whitstone, from a package of its own.

pub mod superquadric;

use whitstone_core::{DuplicateType, Registry, Shapes};

/// Adds the shapes of this package.
pub fn register(registry: &mut Registry) -> Result<(), DuplicateType> {
    registry.add::<Shapes, superquadric::Superquadric>(env!("CARGO_PKG_NAME"))
}
