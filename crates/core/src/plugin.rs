//! How plugins are registered, configured and built, and how errors in scene files are reported.

pub mod config;
pub(crate) mod context;
pub(crate) mod error;
pub mod hash;
pub(crate) mod registry;
pub(crate) mod scene_format;
pub mod transform_steps;
