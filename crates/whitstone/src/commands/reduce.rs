//! `reduce`: reduces a failing scene to a minimal reproducer.

use super::validate;
use crate::terminal::{Exit, Failure, keep_moving, progress};
use clap::Args;
use std::path::PathBuf;
use whitstone_core::Registry;
use whitstone_image::atomic;
use whitstone_validate::Validator;
use whitstone_validate::reduce::reduce;

/// Reduce a failing scene to a minimal reproducer
///
/// Removes shapes, lights and keys one after another, as long as the comparison with the live
/// reference still fails. Writes the remaining scene, which is small enough to debug or to attach
/// to a bug report.
#[derive(Args, Debug)]
#[command(
    mut_arg("reference", |argument| argument.default_value("live")),
    mut_arg("paths", |argument| argument.value_name("SCENE").help("Scene file (TOML)").default_value(None::<&str>).required(true).num_args(1).action(clap::ArgAction::Set)),
    help_template = super::HELP_TEMPLATE,
    after_help = "Example, with an injected fault:\n  whitstone reduce scenes/showcase/classic.toml --ours camera.fov=50.1 -o small.toml"
)]
pub struct Arguments {
    #[command(flatten)]
    validate: validate::Scenes,
    /// Override a value in Whitstone only, to inject a fault; can be repeated
    #[arg(long, value_name = "PATH=VALUE")]
    ours: Vec<String>,
    /// File for the reduced scene [default: standard output]
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
}

/// Runs the command.
pub fn run(arguments: &Arguments, registry: &Registry, program: &str) -> Result<Exit, Failure> {
    let scenes = arguments.validate.find(registry)?;
    let [scene] = &scenes[..] else {
        return Err(Failure::usage(format!(
            "expected one scene, found {}; name a single scene file",
            scenes.len()
        )));
    };
    // The overrides are part of the scene that is reduced, not changes of it.
    let overrides = &arguments.validate.overrides;
    let mut options = arguments.validate.options(program);
    options.overrides.clear();
    options.ours_overrides.clone_from(&arguments.ours);
    let mut validator =
        Validator::new(registry, options, &|text| eprintln!("{text}")).map_err(Failure::environment)?;
    let bar = progress(0, "reducing");
    keep_moving(&bar);
    let left = reduce(&mut validator, scene, overrides, &|values| {
        bar.set_message(format!("reducing: {values} values left"));
    });
    bar.finish_and_clear();
    let left = left.map_err(Failure::usage)?;
    let text = format!(
        "# Reduced from {}: the comparison still fails.\n\n{left}",
        scene.display()
    );
    match &arguments.output {
        Some(path) => atomic::write_bytes(path, text.as_bytes()).map_err(Failure::environment)?,
        None => print!("{text}"),
    }
    Ok(Exit::Pass)
}
