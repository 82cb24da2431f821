//! `stress --subject`: the families that are scenes, rendered by another renderer.

use super::Arguments;
use crate::interrupt;
use crate::terminal::{Exit, Failure, progress, write_json};
use serde_json::json;
use whitstone_core::Registry;
use whitstone_stress::{Family, Lab, SubjectReport, SubjectRuns, judge_subject};
use whitstone_validate::Subject;

/// Runs the command.
pub(super) fn run(
    arguments: &Arguments,
    registry: &Registry,
    families: &[&'static dyn Family],
    name: &str,
) -> Result<Exit, Failure> {
    let subject = Subject::find(name, arguments.config.as_deref(), registry).map_err(Failure::usage)?;
    if subject.is_noisy() {
        return Err(Failure::usage(format!(
            "the images of {name} have noise, which hides what `stress` looks for; state a subject without `runs`"
        )));
    }
    let lab = Lab::new(registry, None, 1);
    let runs = SubjectRuns {
        subject: &subject,
        target: arguments.target.folder(),
        stop: interrupt::stop(),
    };
    let _watching = interrupt::Watching::new();
    let bar = progress(families.len() as u64, "stress");
    let mut reports = Vec::new();
    for family in families {
        let name = family.about().name;
        let say = |parameter: f64| bar.set_message(format!("{name} at {parameter:.0e}"));
        let report = judge_subject(*family, &lab, &runs, &say).map_err(Failure::environment)?;
        if let Some(signal) = interrupt::signal() {
            let kept = "nothing was kept".to_owned();
            return Err(Failure::Interrupted { signal, kept });
        }
        bar.suspend(|| print(&report, &subject.name, reports.is_empty()));
        reports.push(report);
        bar.inc(1);
    }
    bar.finish_and_clear();
    if let Some(path) = &arguments.json {
        write_json(path, &json!({ "subject": subject.name, "families": reports }))?;
    }
    let rendered = reports.iter().filter(|report| is_rendered(report)).count();
    let wrong = reports.iter().filter(|report| report.wrong_at.is_some()).count();
    println!(
        "\nfamilies: {rendered} rendered, {} skipped; {}: {wrong} with wrong pixels",
        reports.len() - rendered,
        subject.name
    );
    match (rendered, wrong) {
        (0, _) => Err(Failure::environment(format!(
            "{name} can render no scene of these families; see above"
        ))),
        (_, 0) => Ok(Exit::Pass),
        _ => Ok(Exit::Differs),
    }
}

/// Whether the subject was asked for an image that it can render.
fn is_rendered(report: &SubjectReport) -> bool {
    !report.steps.is_empty() || report.wrong_at.is_some()
}

fn print(report: &SubjectReport, name: &str, is_first: bool) {
    if is_first {
        println!(
            "{:<20} {:>10} {:>12} {:>10}  parameter",
            "wrong from", "whitstone", name, "excused"
        );
    }
    if !is_rendered(report) {
        let why = report.skipped.as_deref().unwrap_or_default();
        println!("{:<20} skipped: {}", report.family, why.replace('\n', "\n    "));
        return;
    }
    let number = |value: Option<f64>| value.map_or("none".to_owned(), |value| format!("{value:.0e}"));
    println!(
        "{:<20} {:>10} {:>12} {:>10}  {}",
        report.family,
        number(report.whitstone_wrong_at),
        number(report.wrong_at),
        number(report.excused_at),
        report.parameter
    );
    if let (Some(step), Some(_)) = (report.steps.last(), report.wrong_at) {
        let pixels = step.subject;
        println!(
            "    at {:.0e}: {} pixels right, {} excused, {} wrong, {} undecided",
            step.parameter, pixels.right, pixels.excused, pixels.wrong, pixels.undecided
        );
    }
    for example in &report.examples {
        println!("    {}", example.replace('\n', "\n    "));
    }
    if let (Some(why), Some(step)) = (&report.skipped, report.steps.last()) {
        println!(
            "    after {:.0e} skipped: {}",
            step.parameter,
            why.replace('\n', "\n    ")
        );
    }
}
