//! Turns a scene file into an image, in steps with one type each: [`Sources`] (text) ->
//! [`Description`] (tables) -> [`Plan`] (required parts) -> [`Pipeline`] (built) -> [`Film`]
//! (rendered).
//!
//! This crate depends on the plugin registry, not on the plugins.

mod adaptive;
mod cache;
mod check;
mod choice;
mod coincident;
mod costs;
mod description;
mod document;
mod film;
mod groups;
mod limits;
mod memory;
mod operands;
mod pipeline;
mod plan;
mod reach;
#[cfg(feature = "schema")]
mod schema;
mod sources;
mod transform;
mod unused;

pub use cache::Cache;
pub use check::{all_errors, all_errors_with};
pub use coincident::Coincidence;
pub use costs::Cost;
pub use description::{Aov, Description, Expect, FilmTable, GroupTable, PluginTable, ShapeTable};
pub use document::{Flattened, nearest_top_level};
pub use film::{Film, Progress, RenderOptions};
pub use groups::{BuiltGroup, PlannedGroup};
pub use pipeline::{BuildOptions, Pipeline};
pub use plan::{Omitted, Plan};
#[cfg(feature = "schema")]
pub use schema::{scene_schema, table_schema};
pub use sources::{LoadError, Position, Sources};
pub use transform::parse as parse_transform;
