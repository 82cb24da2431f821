//! Scene formats of other programs.
//!
//! Each format is one module with a type that implements
//! [`SceneFormat`](whitstone_core::SceneFormat), and a table of features that says what its
//! conversions keep, approximate and drop.

pub mod document;
pub mod fit;

use whitstone_core::Registry;

/// Adds all formats.
pub fn register(registry: &mut Registry) {
    let _ = registry;
}
