//! Scene formats of other programs.
//!
//! Each format is one module with a type that implements
//! [`SceneFormat`](whitstone_core::SceneFormat), and a table of features that says what its
//! conversions keep, approximate and drop.

#![cfg_attr(
    not(test),
    warn(clippy::disallowed_methods, reason = "the same image on every machine")
)]

#[macro_use]
mod features;

mod coat;
mod combine;
pub mod document;
mod files;
pub mod fit;
mod gltf;
mod image_size;
mod mesh_file;
mod mitsuba;
mod obj;
mod part;
mod pbrt;
mod spectrum;
mod table;
mod toml_scene;
mod triangles;

use whitstone_core::Registry;

pub use gltf::Gltf;
pub use mesh_file::{Ply, Stl};
pub use mitsuba::{Mitsuba, MitsubaPython};
pub use obj::Obj;
pub use pbrt::Pbrt;
pub use toml_scene::Toml;

/// Adds all formats.
pub fn register(registry: &mut Registry) {
    registry.add_format(Toml);
    registry.add_format(Gltf);
    registry.add_format(Mitsuba);
    registry.add_format(MitsubaPython);
    registry.add_format(Obj);
    registry.add_format(Pbrt);
    registry.add_format(Ply);
    registry.add_format(Stl);
}
