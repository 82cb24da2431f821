//! Rays, shapes and what is built from them: transforms, hits, streams of rays, accelerators.

pub(crate) mod accelerator;
pub(crate) mod closed_mesh;
pub(crate) mod instance;
pub(crate) mod mesh_defects;
pub(crate) mod ray;
pub(crate) mod scene_geometry;
pub(crate) mod search_limit;
pub(crate) mod shape;
pub(crate) mod shape_kernel;
pub mod solid;
pub mod stream;
pub(crate) mod surface_part;
pub(crate) mod transform;
pub mod triangle;
pub(crate) mod uv_gradient;
pub(crate) mod vertex_attributes;
