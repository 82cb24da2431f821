//! `sensitivity`: how small a fault in each number of a scene the comparison sees.

use super::validate;
use crate::terminal::{Exit, Failure, progress, write_json};
use clap::Args;
use serde_json::json;
use whitstone_core::Registry;
use whitstone_validate::Validator;
use whitstone_validate::sensitivity::{Seen, Sensitivity, sensitivity};

/// Change every number of a scene on our side only, by less and less, and say which change is the smallest that the comparison sees
///
/// Numbers of which even large changes are not seen are limits that are too wide, or numbers that the picture does not depend on. Renders the scene
/// some hundred times.
#[derive(Args, Debug)]
#[group(id = "sensitivity")]
#[command(
    mut_arg("reference", |argument| argument.default_value("stored")),
    after_help = "Example:\n  whitstone sensitivity scenes/shapes/sphere.toml"
)]
pub struct Arguments {
    #[command(flatten)]
    validate: validate::Arguments,
}

/// Runs the command.
pub fn run(arguments: &Arguments, registry: &Registry, program: &str) -> Result<Exit, Failure> {
    let arguments = &arguments.validate;
    let mut validator = Validator::new(registry, arguments.options(program), &|text| eprintln!("{text}"))
        .map_err(Failure::environment)?;
    let mut reports = Vec::new();
    let mut failed = false;
    for scene in arguments.find()? {
        let bar = progress(1, "changing");
        let found = sensitivity(&mut validator, &scene, &|done, all| {
            bar.set_length(all as u64);
            bar.set_position(done as u64);
        });
        bar.finish_and_clear();
        match found {
            Ok(mut parameters) => {
                parameters.sort_by(|a, b| rank(a).total_cmp(&rank(b)));
                println!("{}", scene.display());
                parameters.iter().for_each(print);
                reports.push(json!({ "scene": scene, "parameters": parameters }));
            }
            Err(why) => {
                failed = true;
                eprintln!("{}: {why}", scene.display());
                reports.push(json!({ "scene": scene, "problem": why }));
            }
        }
    }
    if let Some(path) = &arguments.json {
        write_json(path, &json!({ "scenes": reports }))?;
    }
    Ok(if failed { Exit::Differs } else { Exit::Pass })
}

/// What is seen best comes first.
fn rank(parameter: &Sensitivity) -> f64 {
    match parameter.seen {
        Seen::From { relative, .. } => relative,
        Seen::Never { .. } => 1e300,
        Seen::NoPixel { .. } => 1e301,
        Seen::Fixed => 1e302,
    }
}

fn print(Sensitivity { path, value, seen }: &Sensitivity) {
    let told = match seen {
        Seen::From {
            change,
            relative,
            problem,
        } => format!("seen from {change:.1e} ({relative:.1e} of it): {problem}"),
        Seen::Never { tried } => format!("NOT SEEN: the image changes, by {tried:.1e} too little"),
        Seen::NoPixel { tried } => format!("no pixel depends on it (tried {tried:.1e})"),
        Seen::Fixed => "cannot be changed".to_owned(),
    };
    println!("  {path:<44} {value:>10}  {told}");
}
