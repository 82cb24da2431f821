//! `report`: the page of the last validation, with the results of other commands.

use super::Target;
use crate::terminal::{Exit, Failure, STDOUT, make_folder, write_text};
use clap::Args;
use std::collections::BTreeMap;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
#[cfg(feature = "converge")]
use whitstone_converge::{StudyReport, plot};
use whitstone_image::atomic;
use whitstone_validate::report::{Baseline, Changes, Diagram, Extras, Kind, SCENES, pages};
use whitstone_validate::sensitivity::Parameter;
use whitstone_validate::{CaseResult, Pictures, Results, Status, counted};

/// Write the HTML report of the last `validate`, with the latest results of `converge`, `stress`
/// and `sensitivity`; with --open, show it in a browser
///
/// The page is index.html in the folder of the results. It is one file that works from disk,
/// without a network. With more than 150 cases it becomes an index, and each scene has its own page
/// in the folder `scenes` next to it. With --baseline, the page and the terminal also show the
/// changes since an earlier run.
///
/// Exit code 1 if a case that passed in the baseline fails now or is missing; else 0.
#[derive(Args, Debug)]
#[command(
    help_template = super::HELP_TEMPLATE,
    after_help = "Examples:\n  whitstone report --open\n  whitstone report --baseline main/results.json"
)]
pub struct Arguments {
    /// Open the page in the system's default browser
    #[arg(long)]
    open: bool,
    /// Results of an earlier run: a results.json, or a file written by `validate --json`
    #[arg(long, value_name = "OLD.json")]
    baseline: Option<PathBuf>,
    /// Also write a table of the verdicts to this file as Markdown, for the summary of a CI job; -
    /// means standard output
    #[arg(long, value_name = "FILE")]
    markdown: Option<PathBuf>,
    #[command(flatten)]
    target: Target,
}

/// Runs the command.
pub fn run(arguments: &Arguments, program: &str) -> Result<Exit, Failure> {
    let results = read(arguments.target.folder(), program)?;
    let changes = match &arguments.baseline {
        None => None,
        Some(path) => {
            let old: Baseline = from_json(path).map_err(Failure::usage)?;
            Some(Changes::between(path.display().to_string(), &old, &results))
        }
    };
    if let Some(changes) = &changes {
        print(changes);
    }
    let broken = changes.as_ref().map_or(0, Changes::broken);
    let page = write_page(&results, arguments.target.folder(), changes)?;
    println!("report: {}", page.display());
    if let Some(path) = &arguments.markdown {
        write_text(path, &markdown(&results))?;
    }
    if arguments.open {
        open(&page)?;
    }
    Ok(if broken == 0 { Exit::Pass } else { Exit::Differs })
}

/// A table of the verdicts; those that are not right come first.
fn markdown(results: &Results) -> String {
    let summary = &results.summary;
    let mut text = format!(
        "### Whitstone: {} passed, {} confirmed, {} failed, {} undecided\n\n\
         | verdict | scene | RMSE | unexplained pixels | reason |\n|---|---|--:|--:|---|\n",
        summary.passed, summary.confirmed, summary.failed, summary.undecided
    );
    let is_right = |case: &&CaseResult| case.status.is_some_and(Status::is_right);
    let (right, wrong): (Vec<_>, Vec<_>) = results.results.iter().partition(is_right);
    for case in wrong.into_iter().chain(right) {
        let word = case.status.unwrap_or(Status::Undecided).word();
        let rmse = case
            .rmse
            .map_or_else(|| "-".to_owned(), |rmse| format!("{rmse:.2e}"));
        let reason = case.verdict.replace('|', "\\|").replace('\n', " ");
        text += &format!(
            "| {word} | {} | {rmse} | {} | {reason} |\n",
            case.scene, case.unexplained
        );
    }
    text
}

fn folder(target: &Path) -> PathBuf {
    target.join("validate")
}

/// Checks that the results can be written, before hours are spent on them.
pub(super) fn check<'a>(target: &Path, others: impl IntoIterator<Item = &'a PathBuf>) -> Result<(), Failure> {
    let folder = folder(target);
    make_folder(&folder)?;
    atomic::check(folder.join("results.json")).map_err(Failure::environment)?;
    let mut others = others.into_iter().filter(|path| *path != Path::new(STDOUT));
    others.try_for_each(|path| atomic::check(path).map_err(Failure::environment))
}

/// Writes the results of a validation: `results.json`, the pictures that a later `report` needs,
/// and the page.
pub(super) fn write(results: &Results, target: &Path, json: Option<&Path>) -> Result<(), Failure> {
    let folder = folder(target);
    make_folder(&folder)?;
    let text = serde_json::to_string_pretty(results).map_err(Failure::environment)? + "\n";
    for path in [Some(folder.join("results.json").as_path()), json]
        .into_iter()
        .flatten()
    {
        write_text(path, &text)?;
    }
    let pictures = results.results.iter().map(|case| (&case.scene, &case.pictures));
    let pictures: Vec<(&String, &Option<Pictures>)> = pictures.collect();
    let text = serde_json::to_string(&pictures).map_err(Failure::environment)?;
    atomic::write_bytes(folder.join("pictures.json"), text.as_bytes()).map_err(Failure::environment)?;
    write_page(results, target, None).map(drop)
}

fn write_page(results: &Results, target: &Path, changes: Option<Changes>) -> Result<PathBuf, Failure> {
    let extras = Extras {
        diagrams: diagrams(target),
        stress: kept(&stress(target)),
        sensitivity: kept(&sensitivity(target)),
        changes,
    };
    let folder = folder(target);
    // Remove pages of scenes of an earlier run.
    if folder.join(SCENES).is_dir() {
        std::fs::remove_dir_all(folder.join(SCENES)).map_err(Failure::environment)?;
    }
    let files = pages(results, &extras);
    for (path, page) in &files {
        let path = folder.join(path);
        make_folder(path.parent().unwrap_or(&folder))?;
        atomic::write_bytes(&path, page.as_bytes()).map_err(Failure::environment)?;
    }
    // The first file is the page of all scenes.
    Ok(folder.join(&files[0].0))
}

/// The file of the smallest detectable changes, by scene.
fn sensitivity(target: &Path) -> PathBuf {
    target.join("sensitivity.json")
}

/// The file of the stress diagrams.
fn stress(target: &Path) -> PathBuf {
    target.join("stress").join("diagrams.json")
}

/// Reads the data that an earlier command left for reports. Returns nothing if the file is missing,
/// or if its version differs, which is reported.
fn kept<T: serde::de::DeserializeOwned + Default>(path: &Path) -> T {
    if !path.is_file() {
        return T::default();
    }
    from_json(path).unwrap_or_else(|problem| {
        eprintln!("warning: {problem}; the report omits these results");
        T::default()
    })
}

fn keep<T: serde::Serialize>(path: &Path, value: &T) -> Result<(), Failure> {
    let text = serde_json::to_string_pretty(value).map_err(Failure::environment)? + "\n";
    if let Some(folder) = path.parent() {
        make_folder(folder)?;
    }
    atomic::write_bytes(path, text.as_bytes()).map_err(Failure::environment)
}

/// Stores the smallest detectable changes of a scene for reports, and keeps those of other scenes.
pub(super) fn keep_sensitivity(target: &Path, scene: String, found: &[Parameter]) -> Result<(), Failure> {
    let path = sensitivity(target);
    let mut all: BTreeMap<String, Vec<Parameter>> = kept(&path);
    all.insert(scene, found.to_vec());
    keep(&path, &all)
}

/// Stores the diagrams of families for reports, and keeps those of other families.
#[cfg(feature = "stress")]
pub(super) fn keep_stress(target: &Path, diagrams: Vec<Diagram>) -> Result<(), Failure> {
    let path = stress(target);
    let mut all: Vec<Diagram> = kept(&path);
    all.retain(|old| diagrams.iter().all(|new| new.name != old.name));
    all.extend(diagrams);
    all.sort_by(|a, b| a.name.cmp(&b.name));
    keep(&path, &all)
}

/// Reads the last validation, with those of its pictures that belong to it.
fn read(target: &Path, program: &str) -> Result<Results, Failure> {
    let path = folder(target).join("results.json");
    if !path.is_file() {
        return Err(Failure::usage(format!(
            "{} does not exist; run `{program} validate` to create it",
            path.display()
        )));
    }
    let mut results: Results = from_json(&path).map_err(Failure::usage)?;
    let path = folder(target).join("pictures.json");
    match from_json::<Vec<(String, Option<Pictures>)>>(&path) {
        Ok(pictures) => {
            let same = |(case, picture): (&CaseResult, &(String, Option<Pictures>))| case.scene == picture.0;
            if pictures.len() == results.results.len() && results.results.iter().zip(&pictures).all(same) {
                for (case, (_, picture)) in results.results.iter_mut().zip(pictures) {
                    case.pictures = picture;
                }
            } else {
                eprintln!(
                    "warning: {} belongs to other results; the report has no pictures",
                    path.display()
                );
            }
        }
        Err(problem) => eprintln!("warning: {problem}; the report has no pictures"),
    }
    Ok(results)
}

fn from_json<T: serde::de::DeserializeOwned>(path: &Path) -> Result<T, String> {
    let text = std::fs::read_to_string(path).map_err(|error| format!("{}: {error}", path.display()))?;
    // The message ends with line and column.
    serde_json::from_str(&text).map_err(|error| format!("{}: {error}", path.display()))
}

#[cfg(feature = "converge")]
fn studies(target: &Path) -> PathBuf {
    target.join("converge").join("studies.json")
}

/// Stores the results of studies for reports, and keeps those of other studies.
#[cfg(feature = "converge")]
pub(super) fn keep_studies(target: &Path, reports: &[StudyReport]) -> Result<(), Failure> {
    let path = studies(target);
    let mut all: Vec<StudyReport> = kept(&path);
    all.retain(|old| reports.iter().all(|new| new.study != old.study));
    all.extend_from_slice(reports);
    all.sort_by(|a, b| a.study.cmp(&b.study));
    keep(&path, &all)
}

/// The diagrams of all measured studies.
#[cfg(feature = "converge")]
fn diagrams(target: &Path) -> Vec<Diagram> {
    let reports: Vec<StudyReport> = kept(&studies(target));
    let diagram = |report: &StudyReport| Diagram {
        name: report.study.clone(),
        title: report.title.clone(),
        about: report.about.clone(),
        verdict: if report.quick {
            format!("quick form, {}", report.verdict)
        } else {
            report.verdict.to_string()
        },
        svg: plot::svg(report),
    };
    reports.iter().map(diagram).collect()
}

#[cfg(not(feature = "converge"))]
fn diagrams(_target: &Path) -> Vec<Diagram> {
    Vec::new()
}

fn print(changes: &Changes) {
    for row in &changes.rows {
        println!(
            "{:<7}  {:<30} {}: {} -> {}",
            row.kind.name(),
            row.scene,
            row.what,
            row.before,
            row.after
        );
    }
    let worse = changes.rows.iter().filter(|row| row.kind == Kind::Worse).count();
    println!(
        "compared with {}: {} unchanged, {}, of which {} broken and {worse} worse",
        changes.baseline,
        counted(changes.same, "case"),
        counted(changes.rows.len(), "change"),
        changes.broken(),
    );
}

/// Opens the page with the system's default program.
fn open(page: &Path) -> Result<(), Failure> {
    let (program, first): (&str, &[&str]) = if cfg!(target_os = "macos") {
        ("open", &[])
    } else if cfg!(windows) {
        ("cmd", &["/C", "start", ""])
    } else {
        ("xdg-open", &[])
    };
    let page = std::path::absolute(page).map_err(Failure::environment)?;
    let status = Command::new(program)
        .args(first)
        .arg(&page)
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .status();
    let problem = match status {
        Ok(status) if status.success() => return Ok(()),
        Ok(status) => format!("`{program}` ended with {status}"),
        Err(error) if error.kind() == ErrorKind::NotFound => format!("there is no `{program}`"),
        Err(error) => format!("`{program}`: {error}"),
    };
    Err(Failure::environment(format!(
        "{problem}; open {} in a browser by hand",
        page.display()
    )))
}
