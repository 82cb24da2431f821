//! `schema`: prints JSON Schema, for editors and generators.

use super::list::family;
use crate::terminal::{Exit, Failure};
use clap::Args;
use std::path::PathBuf;
use whitstone_core::Registry;
use whitstone_image::atomic;
use whitstone_scene::{scene_schema, table_schema};

/// Print the JSON Schema of scene files, or of the table of one plugin
///
/// Editors that support it, for example through taplo, complete and check scenes: put
/// `#:schema ./scene.schema.json` into the first line of a scene.
#[derive(Args, Debug)]
#[command(
    help_template = super::HELP_TEMPLATE,
    after_help = "Examples:\n  whitstone schema -o scene.schema.json\n  whitstone schema shape sphere"
)]
pub struct Arguments {
    /// Family of the plugin, such as shape [default: the schema of whole scenes]
    family: Option<String>,
    /// Type of the plugin, such as sphere
    #[arg(id = "type", value_name = "TYPE")]
    name: Option<String>,
    /// Write to this file instead of standard output
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
}

/// Runs the command.
pub fn run(arguments: &Arguments, registry: &Registry) -> Result<Exit, Failure> {
    let schema = match (&arguments.family, &arguments.name) {
        (Some(name), None) => {
            let family = family(name)?;
            let entries = registry.entries().filter(|entry| entry.family == family);
            let types: Vec<&str> = entries.map(|entry| entry.name).collect();
            return Err(Failure::usage(format!(
                "expected a TYPE after {name}: one of {}",
                types.join(", ")
            )));
        }
        (Some(name), Some(plugin)) => {
            let entry = registry.get(family(name)?, plugin).map_err(|error| {
                let advice = error
                    .help
                    .iter()
                    .map(|help| format!(": {help}"))
                    .collect::<String>();
                Failure::usage(format!("{}{advice}", error.message))
            })?;
            table_schema(entry)
        }
        (None, _) => scene_schema(registry),
    };
    let text = format!("{schema:#}\n");
    match &arguments.output {
        Some(path) => atomic::write_bytes(path, text.as_bytes()).map_err(Failure::environment)?,
        None => crate::terminal::out(format_args!("{text}")),
    }
    Ok(Exit::Pass)
}
