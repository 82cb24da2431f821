//! Maintenance commands of the repository: `cargo xtask <command>`. Most of the work is in the
//! library.

mod assets;
mod backends;
mod bench;
mod close_ups;
mod comparisons;
mod course;
mod dependencies;
mod diagrams;
mod features;
mod formats;
mod fuzz;
mod gallery;
mod growth;
mod labels;
mod lecture_scenes;
mod licences;
mod links;
mod oracle;
mod pages;
mod parameters;
mod pictures;
mod places;
mod plugins;
mod readme;
mod reliability;
mod run_time;
mod scale;
mod slim;
mod subjects;
mod synthesis;
mod tidy;
mod topics;
mod traversal;
mod variants;
mod width;
mod work;
mod worst_cases;

use clap::{Parser, Subcommand};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use whitstone::{Exit, Failure, commands, finish};

/// All commands of `whitstone`, and the maintenance commands of this repository.
///
/// Paths are relative to the repository root. Exit codes: 0 success; 1 a check fails or a
/// comparison differs; 2 the command line, a scene or an input file is wrong; 3 something that the
/// command needs is missing or broken, such as a live Mitsuba.
#[derive(Parser)]
#[command(name = "cargo xtask", arg_required_else_help = true, max_term_width = 100)]
struct Arguments {
    #[command(subcommand)]
    verb: Verb,
}

#[derive(Subcommand)]
enum Verb {
    #[command(flatten)]
    Whitstone(Box<commands::Command>),
    Tidy(places::Arguments),
    /// Check that every plugin compiles as the only enabled feature of its crate
    Features,
    /// Write the generated meshes and pictures of scenes/assets again
    Assets,
    Bench(bench::Arguments),
    CloseUps(close_ups::Arguments),
    Fuzz(fuzz::Arguments),
    Gallery(gallery::Arguments),
    Oracle(oracle::Arguments),
    Pictures(pictures::Arguments),
    Readme(readme::Arguments),
    Reliability(reliability::Arguments),
    Scale(scale::Arguments),
    Slim(slim::Arguments),
    Subjects(subjects::Arguments),
    Topics(topics::Arguments),
}

fn main() -> ExitCode {
    let arguments = Arguments::parse();
    whitstone::watch_signals();
    // Paths on the command line are relative to the repository root, regardless of the working
    // folder.
    if let Err(error) = std::env::set_current_dir(root()) {
        return finish(Err(Failure::environment(error))).into();
    }
    let registry = whitstone::registry();
    finish(match &arguments.verb {
        Verb::Whitstone(command) => command.run(&registry, "cargo xtask"),
        Verb::Tidy(arguments) => match &arguments.plugin {
            Some(plugin) => places::run(plugin),
            None => tidy::run(&registry),
        },
        Verb::Features => features::run(&registry),
        Verb::Assets => assets::write(),
        Verb::Bench(arguments) => bench::run(arguments, &registry),
        Verb::CloseUps(arguments) => close_ups::run(arguments, &registry),
        Verb::Fuzz(arguments) => fuzz::run(arguments, &registry),
        Verb::Gallery(arguments) => gallery::run(arguments, &registry),
        Verb::Oracle(arguments) => oracle::run(arguments, &registry),
        Verb::Topics(arguments) => topics::run(arguments),
        Verb::Pictures(arguments) => pictures::run(arguments, &registry),
        Verb::Slim(arguments) => slim::run(arguments, &registry),
        Verb::Subjects(arguments) => subjects::run(arguments),
        Verb::Readme(arguments) => readme::run(arguments, &registry),
        Verb::Reliability(arguments) => reliability::run(arguments),
        Verb::Scale(arguments) => scale::run(arguments),
    })
    .into()
}

/// The repository root, which contains this package.
fn root() -> PathBuf {
    let package = std::env::var_os("CARGO_MANIFEST_DIR").map(PathBuf::from);
    let package = package.unwrap_or_else(|| PathBuf::from(env!("CARGO_MANIFEST_DIR")));
    package.parent().unwrap_or(Path::new(".")).to_owned()
}

/// Prints the problems, or the text `good` if there are none, and returns the result of a check.
fn verdict(problems: &[String], good: &str) -> Result<Exit, Failure> {
    for problem in problems {
        println!("{problem}");
    }
    if problems.is_empty() {
        println!("{good}");
        Ok(Exit::Pass)
    } else {
        println!("problems: {}", problems.len());
        Ok(Exit::Differs)
    }
}
