//! Builds scenes and renders them: [`whitstone_scene::Plan`] -> [`Pipeline`] (built) -> [`Film`]
//! (rendered).
//!
//! This crate depends on the plugin registry, not on the plugins.

#![cfg_attr(
    not(test),
    warn(clippy::disallowed_methods, reason = "the same image on every machine")
)]

mod adaptive;
mod box_tree;
mod builder;
mod cache;
mod coincident;
mod context;
mod costs;
mod film;
mod limits;
mod memory;
mod operands;
mod paths;
mod pipeline;
mod reach;
mod render;
mod samples;
mod shared;
mod threads;
mod trace;
mod unused;

pub use builder::{BuildOptions, BuiltGroup};
pub use cache::Cache;
pub use coincident::Coincidence;
pub use costs::Cost;
pub use film::{Film, FilmError, Progress};
pub use pipeline::{Moment, Pipeline};
pub use render::{Region, RenderOptions};
pub use shared::Shared;
pub use threads::{SPARE_THREADS, start_threads, startable_threads};
