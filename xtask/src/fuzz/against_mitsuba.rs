//! `fuzz mitsuba`: random scenes, validated against Mitsuba.
//!
//! The driver of Mitsuba is written from the model and not from the tracer, so a scene that only
//! one of them accepts, or that they render differently, shows a mistake of one of them.

use super::Run;
use super::scenes::{Scenes, relocated};
use serde_json::Value;
use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};
use whitstone::Failure;
use whitstone::core::Registry;
use whitstone::validate::Installation;
use whitstone::validate::environment::Environment;

/// Scenes of one run of `validate`.
const BATCH: usize = 20;
/// The results of `validate`.
const TARGET: &str = "target/fuzz/mitsuba";
const FINDINGS: &str = "target/fuzz/findings/mitsuba";
/// Scenes that a person may want to look at.
const UNDECIDED: &str = "target/fuzz/mitsuba/undecided";

/// Validates random scenes for some time.
pub(super) fn run(first: u64, seconds: u64, registry: &Registry) -> Result<Run, Failure> {
    let end = Instant::now() + Duration::from_secs(seconds);
    let scenes = Scenes::new(registry);
    let environment = Environment::ensure(&Installation::default(), &|text| eprintln!("{text}"));
    let python = environment.map_err(Failure::environment)?.python;
    let folder = Path::new(TARGET).join("scenes");
    let mut number = first;
    let mut counts: BTreeMap<&str, usize> = BTreeMap::new();
    let mut findings = BTreeMap::new();
    while Instant::now() < end {
        fs::create_dir_all(&folder).map_err(Failure::environment)?;
        let mut files = Vec::new();
        while files.len() < BATCH {
            if let Some(text) = scenes.valid(number).map_err(Failure::environment)? {
                let file = folder.join(format!("{number}.toml"));
                fs::write(&file, relocated(&text)).map_err(Failure::environment)?;
                files.push(file);
            }
            number += 1;
        }
        for (file, outcome) in validate(&files, &python)? {
            let kind = match &outcome {
                Outcome::Pass => "pass",
                Outcome::Undecided => "undecided",
                Outcome::Refused => "refused",
                Outcome::Finding(_) => "findings",
            };
            *counts.entry(kind).or_default() += 1;
            match outcome {
                Outcome::Finding(text) => {
                    findings.insert(keep(&file, FINDINGS)?, text);
                }
                Outcome::Undecided => {
                    keep(&file, UNDECIDED)?;
                }
                Outcome::Pass | Outcome::Refused => {}
            }
        }
        fs::remove_dir_all(&folder).map_err(Failure::environment)?;
    }
    let of = |kind| counts.get(kind).copied().unwrap_or(0);
    println!(
        "mitsuba {:>8} random scenes from number {first}: {} pass, {} undecided, {} refused; findings: {}",
        counts.values().sum::<usize>(),
        of("pass"),
        of("undecided"),
        of("refused"),
        findings.len()
    );
    for (file, finding) in &findings {
        println!("{}: {finding}", file.display());
    }
    Ok(Run {
        executions: counts.values().sum::<usize>() as u64,
        scenes: Some(counts.values().sum::<usize>() as u64),
        valid: Some((of("pass") + of("undecided")) as u64),
        findings: findings.len(),
        next: Some(number),
    })
}

/// What became of a scene.
enum Outcome {
    Pass,
    /// For example, because different surfaces coincide where the model does not order them.
    Undecided,
    /// It has no twin, or it takes too many rays.
    Refused,
    Finding(String),
}

/// Validates scenes.
fn validate(files: &[PathBuf], python: &Path) -> Result<Vec<(PathBuf, Outcome)>, Failure> {
    let json = Path::new(TARGET).join("results.json");
    let _ = fs::remove_file(&json);
    let program = std::env::current_exe().map_err(Failure::environment)?;
    let output = Command::new(program)
        .args(["validate", "--fresh", "--root", ".", "--target", TARGET])
        .arg("--mitsuba")
        .arg(python)
        .arg("--json")
        .arg(&json)
        .args(files)
        .stdout(Stdio::null())
        .output()
        .map_err(Failure::environment)?;
    let results = fs::read_to_string(&json).ok();
    let results: Option<Value> = results.and_then(|text| serde_json::from_str(&text).ok());
    let Some(results) = results else {
        // Nothing tells which scene it was.
        let last = String::from_utf8_lossy(&output.stderr);
        let finding = format!("validate: {}: {}", output.status, last.trim());
        let each = files
            .iter()
            .map(|file| (file.clone(), Outcome::Finding(finding.clone())));
        return Ok(each.collect());
    };
    let outcomes = files.iter().map(|file| (file.clone(), outcome(&results, file)));
    Ok(outcomes.collect())
}

/// What `validate` says about a scene.
fn outcome(results: &Value, file: &Path) -> Outcome {
    let stem = file.file_stem().unwrap_or_default().to_string_lossy();
    let of = |list: &'static str| {
        let all = results[list].as_array().into_iter().flatten();
        all.filter(|entry| {
            let scene = entry["scene"].as_str().map(Path::new);
            scene.and_then(Path::file_stem) == Some(stem.as_ref().as_ref())
        })
    };
    let Some(result) = of("results").next() else {
        return match of("skipped").next() {
            Some(_) => Outcome::Refused,
            None => Outcome::Finding("no result".to_owned()),
        };
    };
    let verdict = result["verdict"].as_str().unwrap_or_default();
    match result["status"].as_str() {
        Some("pass" | "confirmed") => Outcome::Pass,
        Some("undecided") if verdict == "the reference cannot render this scene" => Outcome::Refused,
        // For example, if the tree of a sample is too large.
        Some("fail") if verdict == "the scene cannot be rendered" => Outcome::Refused,
        Some("undecided") if result["compared"] == true => Outcome::Undecided,
        status => Outcome::Finding(format!(
            "{}: {verdict}: {}",
            status.unwrap_or_default(),
            result["problems"]
        )),
    }
}

/// Copies a scene to a folder; returns the copy.
fn keep(file: &Path, folder: &str) -> Result<PathBuf, Failure> {
    fs::create_dir_all(folder).map_err(Failure::environment)?;
    let copy = Path::new(folder).join(file.file_name().unwrap_or_default());
    fs::copy(file, &copy).map_err(Failure::environment)?;
    Ok(copy)
}
