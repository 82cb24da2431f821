//! The vocabulary of Whitstone: geometry in `f64`, the traits that plugins implement, the registry
//! that names them, and errors that point into the scene file.
//!
//! This crate does no input or output and knows no plugin. Everything else depends on it, and it on
//! nothing of the workspace. The meaning of every quantity is fixed in `docs/whitted-model.md`.

mod accelerator;
mod camera;
mod color;
pub mod config;
mod error;
mod geometry;
mod instance;
mod integrator;
mod light;
mod material;
mod ray;
mod registry;
mod sampler;
mod shape;
mod straight;
pub mod stream;
mod texture;
mod transform;
pub mod triangle;

pub use accelerator::{Accelerator, Effort, Outline, Statistics};
pub use camera::{Camera, FilmSize};
pub use color::Rgb;
pub use error::{DuplicateType, SceneError, SceneErrors, SourceSpan, nearest};
pub use geometry::{Element, Geometry, TriangleMesh};
pub use instance::{Group, Instance};
