//! A superquadric shape for Whitstone, in a package of its own.

pub mod superquadric;

use whitstone_core::{DuplicateType, Registry, Shapes};

/// Registers the shapes of this package, and what Mitsuba's driver needs to render them.
pub fn register(registry: &mut Registry) -> Result<(), DuplicateType> {
    registry.add_twin("mitsuba", "superquadric.py", include_str!("superquadric.py"));
    registry.add::<Shapes, superquadric::Superquadric>(env!("CARGO_PKG_NAME"))
}
