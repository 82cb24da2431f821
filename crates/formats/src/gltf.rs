//! glTF 2.0.
//!
//! Meshes stay in their file: a shape names the file, the mesh and the primitive. Materials are
//! translated by the rules of [`FEATURES`]; `material` has the formulas.

mod camera;
mod features;
mod import;
mod light;
mod material;
mod sampler;

pub(crate) use features::FEATURES;
use std::path::Path;
use whitstone_core::{Feature, FormatErrors, ImportOptions, Imported, SceneFormat};

/// glTF 2.0: .gltf and .glb.
pub struct Gltf;

impl SceneFormat for Gltf {
    fn name(&self) -> &'static str {
        "gltf"
    }

    fn extensions(&self) -> &'static [&'static str] {
        &["gltf", "glb"]
    }

    fn features(&self) -> &'static [Feature] {
        FEATURES
    }

    fn import(&self, path: &Path, options: &ImportOptions) -> Option<Result<Imported, FormatErrors>> {
        Some(import::import(path, options))
    }
}
