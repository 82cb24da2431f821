//! `validate --cluster`: each scene is a job.

use super::{
    Arguments, Done, ReferenceMode, SCENES, TIME_LIMIT, print_case, print_header, print_row, print_skipped,
    print_summary,
};
use crate::commands::Target;
use crate::commands::cluster::{self, Batch, Cluster};
use crate::commands::render::check_apart;
use crate::commands::run_job::Output;
use crate::commands::{plan, report};
use crate::jobs::{self, Job, Program};
use crate::terminal::{Exit, Failure};
use std::path::{Path, PathBuf};
use std::time::Instant;
use whitstone_core::Registry;
use whitstone_validate::matrix::{self, Tally};
use whitstone_validate::{
    CaseResult, Mode, Pictures, Provenance, REFERENCES, Results, Status, Summary, scene_key, stored_folder,
};

/// A job for each scene.
pub(crate) fn plan(
    arguments: &Arguments,
    registry: &Registry,
    scenes: &[PathBuf],
) -> Result<Vec<Job>, Failure> {
    let all = &arguments.scenes;
    all.drivers.check_built_in()?;
    let identity = Program::this()?;
    let job = |scene: &PathBuf| {
        let mut files = plan::files_of(scene, &all.overrides, registry)?;
        if all.reference.parts().1 != Mode::Live {
            files.extend(stored(scene, Path::new(SCENES), &all.references)?);
        }
        plan::command(&identity, &files, words(arguments, scene)?)
    };
    let (mut planned, mut problems) = (Vec::new(), Vec::new());
    for scene in scenes {
        match job(scene) {
            Ok(job) => planned.push(job),
            Err(problem) => problems.push(problem.problem()),
        }
    }
    if !problems.is_empty() {
        return Err(Failure::usage(problems.join("\n")));
    }
    let outputs: Vec<&Path> = arguments.json.iter().map(PathBuf::as_path).collect();
    check_apart(&outputs, &jobs::input_paths(&planned))?;
    Ok(planned)
}

/// Validates scenes on a cluster, and prints each result as it arrives.
pub(super) fn validate(
    arguments: &Arguments,
    registry: &Registry,
    scenes: &[PathBuf],
) -> Result<Done, Failure> {
    let start = Instant::now();
    let all = &arguments.scenes;
    let planned = plan(arguments, registry, scenes)?;
    let results = cluster::results(&all.target)?;
    if all.fresh {
        results.remove(&planned);
    }
    print_header();
    let mut parts: Vec<Option<Results>> = scenes.iter().map(|_| None).collect();
    let mut problem = None;
    let finished = &mut |job: &Job| {
        for (k, _) in planned.iter().enumerate().filter(|(_, one)| one.id == job.id) {
            match read(&results, job, Some(&scenes[k])) {
                Ok(part) => {
                    print(&part);
                    parts[k] = Some(part);
                }
                Err(found) => problem = Some(found),
            }
        }
    };
    arguments.cluster.run(&mut Batch {
        doing: "validating",
        jobs: &planned,
        results: &results,
        target: &all.target,
        threads: all.threads,
        mitsuba: all.drivers.mitsuba.as_deref(),
        exclusive: false,
        finished,
    })?;
    if let Some(problem) = problem {
        return Err(problem);
    }
    let done = together(
        parts.into_iter().flatten().collect(),
        start.elapsed().as_secs_f64(),
    );
    results.remove(&planned);
    Ok(done)
}

/// Validates scenes on a cluster, each with further arguments of `validate`, and calls `each` with
/// the number of the scene and its results as they arrive.
pub fn validate_each(
    cluster: &Cluster,
    doing: &str,
    scenes: &[(PathBuf, Vec<String>)],
    registry: &Registry,
    each: &mut dyn FnMut(usize, Results),
) -> Result<(), Failure> {
    let identity = Program::this()?;
    let mut planned = Vec::new();
    for (scene, more) in scenes {
        let files = plan::files_of(scene, &[], registry)?;
        let mut words = vec!["validate".to_owned(), plan::from_here(scene)?];
        words.extend_from_slice(more);
        planned.push(plan::command(&identity, &files, words)?);
    }
    let target = Target::default();
    let results = cluster::results(&target)?;
    let mut problem = None;
    let finished = &mut |job: &Job| {
        for (k, _) in planned.iter().enumerate().filter(|(_, one)| one.id == job.id) {
            match read(&results, job, Some(&scenes[k].0)) {
                Ok(part) => each(k, part),
                Err(found) => problem = Some(found),
            }
        }
    };
    cluster.run(&mut Batch {
        doing,
        jobs: &planned,
        results: &results,
        target: &target,
        threads: 1,
        mitsuba: None,
        exclusive: false,
        finished,
    })?;
    results.remove(&planned);
    problem.map_or(Ok(()), Err)
}

/// Writes the report of finished jobs to a folder, and prints their results.
pub(crate) fn merge(
    jobs: &[Job],
    results: &jobs::Results,
    folder: &Path,
    json: Option<&Path>,
) -> Result<Exit, Failure> {
    print_header();
    let mut parts = Vec::new();
    for job in jobs {
        let part = read(results, job, None)?;
        print(&part);
        parts.push(part);
    }
    let seconds = parts.iter().map(|part| part.summary.seconds).sum();
    let done = together(parts, seconds);
    report::write(&done.results, folder, json)?;
    print_summary(&done.results.summary, &folder.join("validate"));
    done.verdict(false)
}

/// The results of one scene from the result of its job.
fn read(results: &jobs::Results, job: &Job, scene: Option<&Path>) -> Result<Results, Failure> {
    let (mut part, pictures): (Results, _) = Output::read(results, job)?;
    let pictures: Vec<(String, Option<Pictures>)> =
        serde_json::from_value(pictures).map_err(Failure::environment)?;
    for (case, (_, pictures)) in part.results.iter_mut().zip(pictures) {
        case.pictures = pictures;
    }
    // A scene outside the folder of scenes is named by its path, which differs on the worker.
    let names = part.results.iter_mut().map(|case| &mut case.scene);
    let names = names.chain(part.skipped.iter_mut().map(|left| &mut left.scene));
    let names = names.chain(part.matrix.iter_mut().map(|cell| &mut cell.scene));
    if let Some(scene) = scene {
        let key = scene_key(scene, Path::new(SCENES));
        names.for_each(|name| name.clone_from(&key));
    }
    Ok(part)
}

/// One result of all scenes.
fn together(parts: Vec<Results>, seconds: f64) -> Done {
    let mut references: Vec<String> = Vec::new();
    let mut provenance = Provenance {
        whitstone: env!("CARGO_PKG_VERSION").to_owned(),
        threads: 1,
        mitsuba: None,
        povray: None,
    };
    let (mut results, mut skipped, mut matrix) = (Vec::new(), Vec::new(), Vec::new());
    for part in parts {
        if !references.contains(&part.summary.references) {
            references.push(part.summary.references);
        }
        provenance.threads = part.provenance.threads;
        provenance.mitsuba = provenance.mitsuba.or(part.provenance.mitsuba);
        provenance.povray = provenance.povray.or(part.provenance.povray);
        results.extend(part.results);
        skipped.extend(part.skipped);
        matrix.extend(part.matrix);
    }
    let results = Results {
        summary: Summary {
            skipped: skipped.len(),
            matrix: Tally::of(&matrix),
            ..Summary::of(&results, references.join(", "), seconds)
        },
        provenance,
        results,
        skipped,
        matrix,
    };
    Done {
        results,
        broken: None,
    }
}

fn print(part: &Results) {
    let is_of_matrix = |case: &&CaseResult| case.config != "default";
    part.skipped.iter().for_each(print_skipped);
    part.results
        .iter()
        .filter(|case| !is_of_matrix(case))
        .for_each(print_case);
    matrix::rows(&part.matrix).iter().for_each(print_row);
    part.results
        .iter()
        .filter(is_of_matrix)
        .filter(|case| case.status != Some(Status::Pass))
        .for_each(print_case);
}

/// The files of the stored references of a scene.
fn stored(scene: &Path, root: &Path, references: &Path) -> Result<Vec<PathBuf>, Failure> {
    let folder = stored_folder(scene, root, references);
    let mut found = Vec::new();
    if folder.is_dir() {
        for entry in std::fs::read_dir(&folder).map_err(Failure::usage)? {
            let path = entry.map_err(Failure::usage)?.path();
            if path.is_file() {
                found.push(path);
            }
        }
    }
    Ok(found)
}

/// The command of one scene.
fn words(arguments: &Arguments, scene: &Path) -> Result<Vec<String>, Failure> {
    let all = &arguments.scenes;
    let mut words = vec!["validate".to_owned(), plan::from_here(scene)?];
    let mut add = |flag: &str, value: String| words.extend([flag.to_owned(), value]);
    all.overrides
        .iter()
        .for_each(|change| add("--set", change.clone()));
    arguments
        .ours
        .iter()
        .for_each(|change| add("--ours", change.clone()));
    if all.reference != ReferenceMode::Auto {
        add("--reference", all.reference.name());
    }
    if all.references != Path::new(REFERENCES) {
        add("--references", plan::from_here(&all.references)?);
    }
    if all.time_limit != TIME_LIMIT {
        add("--time-limit", all.time_limit.to_string());
    }
    if !arguments.no_oracle {
        add("--oracle-time", arguments.oracle_time.to_string());
    }
    let switches = [
        ("--matrix", arguments.matrix),
        ("--oracle", arguments.oracle),
        ("--no-oracle", arguments.no_oracle),
    ];
    let on = switches.iter().filter(|(_, on)| *on);
    words.extend(on.map(|(flag, _)| (*flag).to_owned()));
    Ok(words)
}
