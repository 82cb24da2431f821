//! `conventions`: finds how another renderer differs from the model.

use super::Target;
use crate::interrupt;
use crate::terminal::{Exit, Failure, set_message, spinner, write_json};
use clap::Args;
use serde_json::json;
use std::path::PathBuf;
use whitstone_core::Registry;
use whitstone_validate::conventions::{self, Conventions};
use whitstone_validate::{Subject, counted};

/// Find the conventions by which another renderer differs from the model
///
/// The subject renders eight small probe scenes. The images are compared with those of the model
/// under hypotheses: other sample positions and filters, reversed rows and columns, a vertical
/// field of view, other light units, spots and transfer functions, other texture coordinates,
/// indices of refraction, near and far clips, and starts of shadow rays. Each difference is
/// reported with the error of the image with and without it, and with the key of the subject's
/// table that states it. A probe that the subject cannot render is skipped, with the reason.
///
/// Differences are relative to the table: a table that states all conventions has no findings. Exit
/// code 0 whether or not there are findings, 2 for a wrong command line or table, 3 if the subject
/// gives no image of the first two probes.
#[derive(Args, Debug)]
#[command(
    help_template = super::HELP_TEMPLATE,
    after_help = "Examples:\n  whitstone conventions --subject mytracer\n  whitstone conventions --subject tachyon --config subjects/whitstone.toml --json conventions.json"
)]
pub struct Arguments {
    /// The name of a table [subject.NAME], or NAME={...}
    #[arg(long, value_name = "NAME")]
    subject: String,
    /// File with the subject's table [default: whitstone.toml in this folder or one above it]
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    #[command(flatten)]
    target: Target,
    /// Also write the findings to this file as JSON; - means standard output
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

/// Runs the command.
pub fn run(arguments: &Arguments, registry: &Registry) -> Result<Exit, Failure> {
    let subject = Subject::find(&arguments.subject, arguments.config.as_deref(), registry);
    let subject = subject.map_err(Failure::usage)?;
    let bar = spinner(&subject.name);
    let stage = |text: &str| set_message(&bar, text);
    let _watching = interrupt::Watching::new();
    let target = arguments.target.folder();
    let found = conventions::find(&subject, registry, target, &stage, interrupt::stop());
    bar.finish_and_clear();
    if let Some(signal) = interrupt::signal() {
        let kept = "nothing was found".to_owned();
        return Err(Failure::Interrupted { signal, kept });
    }
    let found = found.map_err(Failure::environment)?;
    if found.errors.is_empty() {
        let reasons: Vec<&str> = found.skipped.iter().map(|(_, why)| why.as_str()).collect();
        let name = &subject.name;
        return Err(Failure::environment(format!(
            "{name} cannot render the probes: {}",
            reasons.join("; ")
        )));
    }
    print(&subject.name, &found);
    if let Some(path) = &arguments.json {
        write_json(path, &json!({ "subject": subject.name, "conventions": found }))?;
    }
    Ok(Exit::Pass)
}

fn print(name: &str, found: &Conventions) {
    println!("{name}: {}", counted(found.findings.len(), "finding"));
    for finding in &found.findings {
        println!(
            "  {:<22} {} (error {:.1e}, without this {:.1e})",
            finding.convention, finding.sentence, finding.error, finding.error_without
        );
    }
    for (probe, error) in &found.errors {
        println!("  error of the probe with {probe} that no tried convention explains: {error:.1e}");
    }
    for (what, words) in &found.measured {
        println!("  {what}: {words}");
    }
    for (probe, why) in &found.skipped {
        println!("  the probe with {probe} was skipped: {why}");
    }
    let keys: Vec<&str> = found
        .findings
        .iter()
        .filter_map(|finding| finding.key.as_deref())
        .collect();
    if !keys.is_empty() {
        println!("keys for [subject.{name}]:");
        keys.iter().for_each(|key| println!("{key}"));
    }
}
