//! Scene files: [`Sources`] (text) -> [`Description`] (tables) -> [`Plan`] (required parts).
//!
//! This crate describes scenes. It depends on the plugin registry, not on the plugins, and builds
//! nothing; `whitstone-render` does.

#![cfg_attr(
    not(test),
    warn(clippy::disallowed_methods, reason = "the same image on every machine")
)]

mod checked;
mod companions;
mod description;
mod document;
mod groups;
mod import;
mod motion;
mod path_classes;
mod plan;
#[cfg(feature = "schema")]
mod schema;
mod sources;
mod transform;

pub use checked::Checked;
pub use description::{
    Aov, Description, Expect, Faulty, FilmTable, GroupTable, PathLayers, PluginTable, ReplacedMaterial,
    ShapeTable,
};
pub use document::{Flattened, nearest_top_level};
pub use groups::{Appearance, Appearances, PlannedGroup, unknown_id};
pub use motion::Motion;
pub use plan::{Omitted, Plan};
#[cfg(feature = "schema")]
pub use schema::{scene_schema, table_schema};
pub use sources::{LoadError, Position, Sources};
pub use transform::parse as parse_transform;

/// The accelerator type with which a scene leaves the choice to the program.
pub const AUTO: &str = "auto";
