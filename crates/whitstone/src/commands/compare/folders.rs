//! Compares two folders of images, matched by their paths.

use super::super::junit::{self, Case, Outcome};
use super::accept::accept;
use super::measure::Comparison;
use super::{Arguments, Compared, Files, page, range, word, write_trio};
use crate::terminal::{Exit, Failure, progress, set_message, write_json};
use serde_json::{Value, json};
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use whitstone_validate::counted;

/// A path below both folders, and the outcome.
struct Row {
    name: String,
    /// A comparison, or why there is none.
    found: Result<Comparison, String>,
    /// Whether ours became the reference, or why it did not.
    accepted: Option<Result<(), String>>,
    json: Value,
    /// For the page of `--html`.
    details: String,
    /// For the review.
    #[cfg(feature = "view")]
    seen: super::review::Seen,
    #[cfg(feature = "view")]
    files: Files,
}

impl Row {
    fn is_accepted(&self) -> bool {
        self.accepted == Some(Ok(()))
    }

    /// Each limit that is exceeded, or why there is no comparison.
    fn problems(&self) -> Vec<String> {
        match &self.found {
            Ok(found) => found.broken.clone(),
            Err(problem) => vec![problem.clone()],
        }
    }

    fn entry(&self) -> page::Entry {
        let problems = self.problems();
        page::Entry {
            name: self.name.clone(),
            word: word(self.found.is_ok(), problems.is_empty(), self.is_accepted()),
            is_right: self.is_accepted() || problems.is_empty(),
            problems,
            details: self.details.clone(),
        }
    }
}

/// Compares all pairs, and fails if a file could not be compared.
pub(super) fn run(arguments: &Arguments) -> Result<Exit, Failure> {
    let find = |folder: &Path| images(folder, &arguments.extension);
    let (ours, reference) = (find(&arguments.ours)?, find(&arguments.reference)?);
    let all: BTreeSet<&PathBuf> = ours.union(&reference).collect();
    if all.is_empty() {
        return Err(Failure::usage(format!(
            "there are no files *.{} in {} and {}",
            arguments.extension.join(", *."),
            arguments.ours.display(),
            arguments.reference.display()
        )));
    }
    let bar = progress(all.len() as u64, "comparing");
    let mut rows = Vec::new();
    for path in all {
        let name = name(path);
        set_message(&bar, &name);
        let files = files(arguments, path);
        #[cfg(feature = "view")]
        let seen = match arguments.review.is_wanted() {
            true => super::review::Seen::of(&files.ours, files.reference()),
            false => super::review::Seen::default(),
        };
        let found = match (ours.contains(path), reference.contains(path)) {
            (true, true) => compare(arguments, path, &files),
            (true, false) => Err(format!("missing in {}", arguments.reference.display())),
            _ => Err(format!("missing in {}", arguments.ours.display())),
        };
        let differs = (found.as_ref()).map_or(true, |found| !found.comparison.broken.is_empty());
        let accepted = (arguments.accept && differs && ours.contains(path))
            .then(|| accept(&files.ours, files.reference()).map_err(Failure::problem));
        let json = match &found {
            Ok(found) => found.comparison.json(arguments, &files.ours, &found.reference),
            Err(problem) => json!({ "status": "error", "problems": [problem] }),
        };
        let details = match arguments.html {
            Some(_) => page::details(arguments, &files, found.as_ref().ok(), Vec::new()),
            None => String::new(),
        };
        let found = found.map(|found| found.comparison);
        rows.push(Row {
            name,
            found,
            accepted,
            json,
            details,
            #[cfg(feature = "view")]
            seen,
            #[cfg(feature = "view")]
            files,
        });
        bar.inc(1);
    }
    bar.finish_and_clear();
    print(&rows);
    #[cfg(feature = "view")]
    if arguments.review.is_wanted() {
        let items: Vec<super::review::Item<'_>> = rows.iter().map(item).collect();
        let accepted = super::review::run(arguments, &items)?;
        for (row, accepted) in rows.iter_mut().zip(accepted) {
            row.accepted = accepted.then_some(Ok(()));
        }
    }
    write(arguments, &rows)?;
    end(&rows)
}

#[cfg(feature = "view")]
fn item(row: &Row) -> super::review::Item<'_> {
    super::review::Item {
        name: &row.name,
        files: row.files.clone(),
        seen: row.seen,
        comparable: row.found.is_ok(),
        problems: row.problems(),
    }
}

/// The files of a comparison at a path below both folders.
fn files(arguments: &Arguments, path: &Path) -> Files {
    let mut references = vec![arguments.reference.join(path)];
    let others = arguments.or.iter().map(|folder| folder.join(path));
    references.extend(others.filter(|other| other.exists()));
    let mask = arguments.mask.as_ref().map(|folder| folder.join(path));
    Files {
        ours: arguments.ours.join(path),
        references,
        mask: mask.filter(|mask| mask.exists()),
        range: range(&arguments.reference_range, Some(path)),
    }
}

fn compare(arguments: &Arguments, path: &Path, files: &Files) -> Result<Compared, String> {
    let message = Failure::problem;
    let found = files.compare(arguments).map_err(message)?;
    if let Some(folder) = &arguments.png {
        let picture = folder.join(path).with_extension("png");
        let parent = picture.parent().unwrap_or(folder);
        std::fs::create_dir_all(parent).map_err(|error| format!("{}: {error}", parent.display()))?;
        let [ours, reference] = &found.images;
        write_trio(arguments, ours, reference, &picture).map_err(message)?;
    }
    Ok(found)
}

/// All images with these extensions below a folder, by their relative paths, without the variants
/// of stored references. Links to folders are not followed, because they may form cycles.
fn images(folder: &Path, extensions: &[String]) -> Result<BTreeSet<PathBuf>, Failure> {
    let mut found = BTreeSet::new();
    let mut open = vec![PathBuf::new()];
    while let Some(below) = open.pop() {
        let path = folder.join(&below);
        let at = |error: std::io::Error| Failure::usage(format!("{}: {error}", path.display()));
        for entry in std::fs::read_dir(&path).map_err(at)? {
            let entry = entry.map_err(at)?;
            let inside = below.join(entry.file_name());
            if entry.file_type().map_err(at)?.is_dir() {
                open.push(inside);
            } else if inside.extension().is_some_and(|extension| {
                extensions
                    .iter()
                    .any(|wanted| extension.eq_ignore_ascii_case(wanted))
            }) {
                found.insert(inside);
            }
        }
    }
    let variants: Vec<PathBuf> = found.iter().map(|path| super::variants_of(path)).collect();
    for path in variants {
        found.remove(&path);
    }
    Ok(found)
}

/// A path that reads the same on every system.
fn name(path: &Path) -> String {
    let parts: Vec<_> = path.iter().map(|part| part.to_string_lossy()).collect();
    parts.join("/")
}

fn counts(rows: &[Row]) -> [usize; 3] {
    let count = |of: fn(&Row) -> bool| rows.iter().filter(|row| of(row)).count();
    let differs = |row: &Row| row.found.as_ref().is_ok_and(|found| !found.broken.is_empty());
    [
        count(|row| row.found.as_ref().is_ok_and(|found| found.broken.is_empty())),
        rows.iter()
            .filter(|row| differs(row) && !row.is_accepted())
            .count(),
        count(|row| row.found.is_err() && !row.is_accepted()),
    ]
}

fn print(rows: &[Row]) {
    let width = rows
        .iter()
        .map(|row| row.name.chars().count())
        .max()
        .unwrap_or(0)
        .max(5);
    println!(
        "       {:<width$}  {:>10}  {:>17}  {:>8}  {:>8}  {:>8}",
        "image", "rmse", "rel_rmse_interior", "over", "ssim", "flip"
    );
    for row in rows {
        let Row {
            name, found, json, ..
        } = row;
        let number = |value: Option<f64>| value.map_or_else(|| "-".to_owned(), |v| format!("{v:.3e}"));
        match found {
            Ok(found) => {
                let status = match (found.broken.is_empty(), row.is_accepted()) {
                    (true, _) => "pass ",
                    (false, true) => "ACCEPT",
                    (false, false) => "FAIL ",
                };
                let metrics = found.metrics.as_ref();
                println!(
                    "{status:<6} {name:<width$}  {:>10}  {:>17}  {:>8}  {:>8}  {:>8}",
                    number(metrics.map(|metrics| metrics.rmse)),
                    number(metrics.and_then(|metrics| metrics.rel_rmse_interior)),
                    found.over,
                    found
                        .ssim
                        .flatten()
                        .map_or_else(|| "-".to_owned(), |ssim| format!("{ssim:.4}")),
                    json["flip"]
                        .as_f64()
                        .map_or_else(|| "-".to_owned(), |flip| format!("{flip:.4}")),
                );
                for broken in &found.broken {
                    println!("       {broken}");
                }
                for warning in &found.warnings {
                    println!("       warning: {warning}");
                }
            }
            Err(_) if row.is_accepted() => println!("ACCEPT {name:<width$}  a new reference"),
            Err(problem) => println!("ERROR  {name:<width$}  {}", problem.replace('\n', "\n       ")),
        }
    }
    for row in rows {
        if let Some(Err(why)) = &row.accepted {
            println!("       {why}");
        }
    }
    let [passed, failed, errors] = counts(rows);
    let accepted = match rows.iter().filter(|row| row.is_accepted()).count() {
        0 => String::new(),
        accepted => format!(", {accepted} accepted"),
    };
    println!(
        "\n{}: {passed} passed, {failed} failed, {errors} could not be compared{accepted}",
        counted(rows.len(), "image")
    );
}

fn write(arguments: &Arguments, rows: &[Row]) -> Result<(), Failure> {
    if let Some(path) = &arguments.json {
        let [passed, failed, errors] = counts(rows);
        let images: Vec<Value> = rows
            .iter()
            .map(|row| {
                let mut image = row.json.clone();
                image["name"] = Value::from(row.name.as_str());
                if row.is_accepted() {
                    image["status"] = "accepted".into();
                }
                image
            })
            .collect();
        let value = json!({
            "summary": { "images": rows.len(), "passed": passed, "failed": failed, "errors": errors },
            "images": images,
        });
        write_json(path, &value)?;
    }
    if let Some(path) = &arguments.html {
        let entries = rows.iter().map(Row::entry).collect::<Vec<_>>();
        page::write(arguments, path, &entries)?;
    }
    if let Some(path) = &arguments.junit {
        let case = |row: &Row| match &row.found {
            _ if row.is_accepted() => Case {
                name: row.name.clone(),
                seconds: 0.0,
                outcome: Outcome::Pass,
            },
            Ok(comparison) => comparison.junit(row.name.clone()),
            Err(problem) => Case {
                name: row.name.clone(),
                seconds: 0.0,
                outcome: Outcome::Error(problem.clone()),
            },
        };
        let cases: Vec<Case> = rows.iter().map(case).collect();
        junit::write(path, "whitstone compare", &cases)?;
    }
    Ok(())
}

/// A difference decides the result. Files that could not be compared matter only if there is none.
fn end(rows: &[Row]) -> Result<Exit, Failure> {
    match counts(rows) {
        [_, 0, 0] => Ok(Exit::Pass),
        [_, 0, errors] => Err(Failure::usage(format!(
            "images that could not be compared: {errors}; see above"
        ))),
        _ => Ok(Exit::Differs),
    }
}
