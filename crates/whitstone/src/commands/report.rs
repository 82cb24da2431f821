//! `report`: the page of the last validation, with what is there beside it.

use crate::terminal::{Exit, Failure};
use clap::Args;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
#[cfg(feature = "converge")]
use whitstone_converge::{StudyReport, plot};
use whitstone_image::atomic;
use whitstone_validate::report::{Baseline, Changes, Diagram, Extras, Kind, html};
use whitstone_validate::{CaseResult, Pictures, Results, counted};

/// Write the report of the last `validate` anew, with the diagrams of the last `converge`, and open it
///
/// The page is index.html in the folder of the results: one file that works from disk, without a network. With
/// --baseline it also says what changed since an earlier run, and so does the terminal.
///
/// Exit code 1 if a case of the baseline passed there and fails now, or is gone; else 0.
#[derive(Args, Debug)]
#[command(
    after_help = "Examples:\n  whitstone report --open\n  whitstone report --baseline main/results.json"
)]
pub struct Arguments {
    /// Show the page in the browser that the system opens pages with
    #[arg(long)]
    open: bool,
    /// Results of an earlier run: a results.json, or what `validate --json` wrote
    #[arg(long, value_name = "OLD.json")]
    baseline: Option<PathBuf>,
    /// Folder of `validate` and `converge`
    #[arg(long, default_value = "target/whitstone", value_name = "DIR")]
    target: PathBuf,
}

/// Runs the command.
pub fn run(arguments: &Arguments, program: &str) -> Result<Exit, Failure> {
    let results = read(&arguments.target, program)?;
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
    let page = write_page(&results, &arguments.target, changes)?;
    println!("report: {}", page.display());
    if arguments.open {
        open(&page)?;
    }
    Ok(if broken == 0 { Exit::Pass } else { Exit::Differs })
}

fn folder(target: &Path) -> PathBuf {
    target.join("validate")
}

/// Writes the results of a validation: `results.json`, pictures that a later `report` needs, and the page.
pub(super) fn write(results: &Results, target: &Path, json: Option<&Path>) -> Result<(), Failure> {
    let folder = folder(target);
    std::fs::create_dir_all(&folder).map_err(Failure::environment)?;
    let text = serde_json::to_string_pretty(results).map_err(Failure::environment)? + "\n";
    for path in [Some(folder.join("results.json").as_path()), json]
        .into_iter()
        .flatten()
    {
        atomic::write_bytes(path, text.as_bytes()).map_err(Failure::environment)?;
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
        changes,
    };
    let path = folder(target).join("index.html");
    atomic::write_bytes(&path, html(results, &extras).as_bytes()).map_err(Failure::environment)?;
    Ok(path)
}

/// The last validation, with its pictures as far as these belong to it.
fn read(target: &Path, program: &str) -> Result<Results, Failure> {
    let path = folder(target).join("results.json");
    if !path.is_file() {
        return Err(Failure::usage(format!(
            "there is no {}: `{program} validate` makes it",
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
                    "warning: {} is of other results; there are no pictures",
                    path.display()
                );
            }
        }
        Err(problem) => eprintln!("warning: {problem}; there are no pictures"),
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

/// Keeps what was measured of studies for reports, beside what is there of others.
#[cfg(feature = "converge")]
pub(super) fn keep_studies(target: &Path, reports: &[StudyReport]) -> Result<(), Failure> {
    let path = studies(target);
    let mut all: Vec<StudyReport> = from_json(&path).unwrap_or_default();
    all.retain(|old| reports.iter().all(|new| new.study != old.study));
    all.extend_from_slice(reports);
    all.sort_by(|a, b| a.study.cmp(&b.study));
    let text = serde_json::to_string_pretty(&all).map_err(Failure::environment)? + "\n";
    std::fs::create_dir_all(target.join("converge")).map_err(Failure::environment)?;
    atomic::write_bytes(&path, text.as_bytes()).map_err(Failure::environment)
}

/// The diagrams of all studies that were measured.
#[cfg(feature = "converge")]
fn diagrams(target: &Path) -> Vec<Diagram> {
    let path = studies(target);
    if !path.is_file() {
        return Vec::new();
    }
    let reports: Vec<StudyReport> = from_json(&path).unwrap_or_else(|problem| {
        eprintln!("warning: {problem}; there are no diagrams");
        Vec::new()
    });
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
        "since {}: {} as before, {}, of which {} broken and {worse} worse",
        changes.baseline,
        counted(changes.same, "case"),
        counted(changes.rows.len(), "change"),
        changes.broken(),
    );
}

/// As a user would, by double-clicking it.
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
        "{problem}: open {} in a browser by hand",
        page.display()
    )))
}
