//! `sensitivity`: finds the smallest change of each parameter that the comparison detects.

use super::report;
use super::validate::ReferenceMode;
use super::{Drivers, Target};
use crate::terminal::{Exit, Failure, progress, set_message, write_json};
use clap::Args;
use serde_json::json;
use std::path::{Path, PathBuf};
use std::time::Duration;
use whitstone_core::Registry;
use whitstone_validate::sensitivity::{Effect, Parameter};
use whitstone_validate::{Options, REFERENCES, Validator, scene_key};

/// Folder that names of scenes are relative to.
const SCENES: &str = "scenes";

/// Find the smallest change of each number of a scene that the comparison detects
///
/// Changes one number at a time, in Whitstone only, until the comparison fails. Numbers of the film
/// and of the table `expect` are skipped. A number is changed by a ten-millionth of itself, then by
/// ten times as much, and so on up to ten times itself; a whole number by one and by itself.
/// Reports undetectable parameters, and parameters that change no pixel at all. The next `report`
/// shows the results with the scene.
///
/// Exit code 0; 1 if the unchanged scene does not pass.
#[derive(Args, Debug)]
#[command(
    help_template = super::HELP_TEMPLATE,
    after_help = "Example:\n  whitstone sensitivity scenes/shapes/sphere.toml"
)]
pub struct Arguments {
    /// Scene file (TOML)
    scene: PathBuf,
    /// Source of the reference
    #[arg(long, value_enum, default_value_t = ReferenceMode::Stored)]
    reference: ReferenceMode,
    /// Write all numbers to this file as JSON; - means standard output
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    #[command(flatten)]
    target: Target,
    /// Folder of the stored references
    #[arg(long, default_value = REFERENCES, value_name = "DIR")]
    references: PathBuf,
    #[command(flatten)]
    drivers: Drivers,
    /// Number of threads; 0 means one per core
    #[arg(long, value_name = "COUNT", default_value_t = 0, value_parser = super::threads)]
    threads: usize,
}

/// Runs the command.
pub fn run(arguments: &Arguments, registry: &Registry, program: &str) -> Result<Exit, Failure> {
    if !arguments.scene.is_file() {
        return Err(Failure::usage(format!(
            "there is no scene file {}",
            arguments.scene.display()
        )));
    }
    let (renderer, mode) = arguments.reference.parts();
    let options = Options {
        scenes: PathBuf::from(SCENES),
        references: arguments.references.clone(),
        installation: arguments.drivers.installation(&arguments.target),
        target: arguments.target.folder().to_owned(),
        renderer,
        mode,
        reuse: true,
        threads: arguments.threads,
        overrides: Vec::new(),
        ours_overrides: Vec::new(),
        shared_overrides: Vec::new(),
        time_limit: Duration::from_secs(300),
        program: program.to_owned(),
        flags: String::new(),
    };
    let mut validator =
        Validator::new(registry, options, &|text| eprintln!("{text}")).map_err(Failure::environment)?;
    let bar = progress(1, "sensitivity");
    let advance = |index: usize, all: usize, name: &str| {
        bar.set_length(all as u64);
        bar.set_position(index as u64);
        set_message(&bar, name);
    };
    let found = validator.sensitivity(&arguments.scene, &advance);
    bar.finish_and_clear();
    let found = match found {
        Ok(found) => found,
        Err(problem) if problem.starts_with("the scene does not pass") => {
            println!("{problem}");
            return Ok(Exit::Differs);
        }
        Err(problem) => return Err(Failure::usage(problem)),
    };
    print(&found);
    report::keep_sensitivity(
        arguments.target.folder(),
        scene_key(&arguments.scene, Path::new(SCENES)),
        &found,
    )?;
    if let Some(path) = &arguments.json {
        write_json(path, &json!({ "scene": arguments.scene, "parameters": found }))?;
    }
    Ok(Exit::Pass)
}

fn print(found: &[Parameter]) {
    let width = found
        .iter()
        .map(|parameter| parameter.path.len())
        .max()
        .unwrap_or(0)
        .max(6);
    println!(
        "{:<width$}  {:>12}  {:>10}  {:>10}",
        "number", "value", "change", "relative"
    );
    for Parameter { path, value, effect } in found {
        let (change, text) = match effect {
            Effect::Seen { change, problem } => (*change, format!("detected: {problem}")),
            Effect::Unseen { change } => (
                *change,
                "NOT DETECTED up to this change, although pixels change".to_owned(),
            ),
            Effect::NoPixel { change } => (*change, "no pixel changes up to this change".to_owned()),
            Effect::Refused { change, problem } => (*change, format!("rejected: {problem}")),
        };
        let part = match value {
            0.0 => "-".to_owned(),
            value => format!("{:.1e}", change / value.abs()),
        };
        println!("{path:<width$}  {value:>12}  {change:>10.1e}  {part:>10}  {text}");
    }
    let count = |of: fn(&Effect) -> bool| found.iter().filter(|parameter| of(&parameter.effect)).count();
    println!(
        "\n{} numbers: {} detected, {} not detected, {} without effect on any pixel, {} that cannot be changed",
        found.len(),
        count(|effect| matches!(effect, Effect::Seen { .. })),
        count(|effect| matches!(effect, Effect::Unseen { .. })),
        count(|effect| matches!(effect, Effect::NoPixel { .. })),
        count(|effect| matches!(effect, Effect::Refused { .. })),
    );
}
