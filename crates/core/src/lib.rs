//! The core types of Whitstone: geometry in `f64`, the traits that plugins implement, the registry
//! that lists them, and errors with positions in the scene file.
//!
//! This crate does no input or output and contains no plugin. All other crates depend on it; it
//! depends only on `whitstone-simd`. `docs/whitted-model.md` defines the meaning of every quantity.

mod accelerator;
mod bodies;
mod camera;
mod closed_mesh;
mod color;
pub mod config;
mod distribution;
mod error;
pub mod footprint;
mod geometry;
pub mod hash;
mod instance;
mod integrator;
mod light;
mod material;
mod mesh_defects;
mod object_order;
mod path;
mod ray;
mod registry;
mod sampler;
mod shadow;
mod shape;
pub mod solid;
pub mod steps;
mod straight;
pub mod stream;
mod surface_part;
mod texture;
mod transform;
pub mod triangle;

pub use accelerator::{Accelerator, Effort, Outline, Statistics};
pub use bodies::{Bodies, Face, Inside, Overlapping, Substance};
pub use camera::{Camera, FilmSize};
pub use closed_mesh::{ClosedMesh, NotClosed};
pub use color::Rgb;
pub use distribution::Distribution;
pub use error::{DuplicateType, SceneError, SceneErrors, SourceSpan, nearest};
pub use footprint::{Footprint, Spread};
pub use geometry::{Element, Geometry, TriangleMesh};
pub use glam::{DAffine3, DMat3, DMat4, DVec2, DVec3, DVec4, Vec2, Vec3, Vec4};
pub use instance::{Group, Instance};
pub use integrator::{Counters, Integrator, LightMemory, Scratch, TreeNode, World};
pub use light::{Light, LightGives, LightSample};
pub use material::{
    Branch, BranchKind, BranchStream, BranchStreams, Branches, Filter, Flags, Illumination, Incoming, Lobes,
    Material, MaterialRef,
};
pub use mesh_defects::MeshDefects;
pub use object_order::{ObjectOrder, Refused, View};
pub use path::{Medium, PathLetter, PathState};
pub use ray::{Aabb, Interval, Ray};
pub use registry::{
    Accelerators, Cameras, Context, Entry, Family, FamilyName, Integrators, Lights, Materials, Plugin,
    Registry, Samplers, Shapes, Textures, Twin,
};
pub use sampler::{Refinement, Sampler};
pub use shadow::Shadowing;
pub use shape::{InstancePath, Needs, Primitive, PrimitiveHit, RawHit, Shape, Skip, SurfacePoint};
pub use solid::{SolidRef, Span, Spans};
pub use straight::{LEAVES_NOTHING, Straight};
pub use surface_part::SurfacePart;
pub use texture::{ColorSource, Texture, TextureBytes};
pub use transform::Transform;
pub use whitstone_simd as simd;
