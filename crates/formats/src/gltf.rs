//! glTF 2.0.
//!
//! Meshes stay in their file: a shape names the file, the mesh and the primitive. Materials are
//! translated by the rules of [`FEATURES`]; `material` has the formulas. An exported file also
//! keeps the scene itself, which is imported unless another program has changed the file.

mod camera;
mod export;
mod features;
mod import;
mod kept;
mod light;
mod material;
mod restore;
mod sampler;

pub(crate) use features::FEATURES;
use std::path::Path;
use whitstone_core::{ExportScene, Feature, FormatErrors, ImportOptions, Imported, Note, SceneFormat};

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

    fn export(&self, scene: &ExportScene<'_>, path: &Path) -> Option<Result<Vec<Note>, FormatErrors>> {
        Some(export::export(scene, path))
    }
}
