//! The core types of Whitstone: geometry in `f64`, the traits that plugins implement, the registry
//! that lists them, and errors with positions in the scene file.
//!
//! This crate does no input or output and contains no plugin. All other crates depend on it; it
//! depends only on `whitstone-simd`. `docs/whitted-model.md` defines the meaning of every quantity.

#![cfg_attr(
    not(test),
    warn(clippy::disallowed_methods, reason = "the same image on every machine")
)]

mod geometry;
mod plugin;
mod shading;

pub use geometry::{solid, stream, triangle};
pub use plugin::{config, hash, transform_steps};
pub use shading::{direction_map, ray_differential};

pub use geometry::accelerator::{Accelerator, DebugBounds, Statistics, TraversalStatistics};
pub use geometry::closed_mesh::{ClosedMesh, NotClosed};
pub use geometry::instance::{Group, Instance};
pub use geometry::mesh_defects::MeshDefects;
pub use geometry::ray::{Aabb, Interval, Ray};
pub use geometry::scene_geometry::{Element, Geometry, TriangleMesh};
pub use geometry::search_limit::{LimitReached, SearchLimit};
pub use geometry::shape::{
    InstanceId, LoweredShape, PreliminaryIntersection, SelfHitFilter, Shape, ShapeHit, SurfaceAttributes,
    SurfaceInteraction,
};
pub use geometry::shape_kernel::{NO_PRIMITIVE, ShapeKernel};
pub use geometry::solid::{SolidRef, Span, Spans};
pub use geometry::surface_part::SurfacePart;
pub use geometry::transform::Transform;
pub use geometry::vertex_attributes::{MeshAttributes, VertexAttributeStream, VertexAttributes};
pub use glam::{DAffine3, DMat3, DMat4, DVec2, DVec3, DVec4, Vec2, Vec3, Vec4};
pub use plugin::context::{Context, Diagnostics, Resources, Storage};
pub use plugin::error::{DuplicateType, SceneError, SceneErrors, SourceSpan, nearest};
pub use plugin::registry::{
    Accelerators, AutomaticAccelerator, Cameras, Entry, Family, FamilyName, Integrators, Lights, Materials,
    Plugin, Registry, Samplers, Shapes, Textures, Twin,
};
pub use plugin::scene_format::{
    ExportScene, Feature, FormatError, FormatErrors, ImportOptions, Imported, Note, Notes, SceneFormat,
    Treatment,
};
pub use shading::camera::{Camera, FilmSize};
pub use shading::color::Rgb;
pub use shading::glossy_lobe::GlossyLobe;
pub use shading::integrator::{
    Counters, Integrator, LightMemory, Scene, Scratch, TooLarge, TreeLimits, TreeNode,
};
pub use shading::light::{Light, LightFlags, LightSample};
pub use shading::light_tree::LightBounds;
pub use shading::material::{
    BsdfFlags, IncidentLight, LaneMask, LightSamples, Material, MaterialRef, SpecularRay, SpecularRayKind,
    SpecularRayStream, SpecularRayStreams, SpecularRays, Transmittance,
};
pub use shading::nested_dielectrics::{
    Medium, MediumInterface, MediumStack, NestedDielectrics, PrioritizedDielectric,
};
pub use shading::object_order::{ObjectOrder, Refused, View};
pub use shading::path::{MediumState, PathLetter, PathState};
pub use shading::path_classes::{BRANCH_EVENTS, PathClassState, PathClasses, PathEnd, PathSums};
pub use shading::ray_differential::{Footprint, RayDifferential};
pub use shading::sampler::{Refinement, Sampler};
pub use shading::shadow::{DirectLighting, ShadowMode};
pub use shading::tangent_field::TangentField;
pub use shading::texture::{ColorSource, Texture, TextureBytes};
pub use whitstone_simd as simd;
