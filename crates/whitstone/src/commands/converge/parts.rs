//! `converge --cluster`: each study is a job.

use super::{Arguments, tell, write};
use crate::commands::cluster::{self, Batch};
use crate::commands::plan;
use crate::commands::run_job::Output;
use crate::jobs::{Job, Program};
use crate::terminal::Failure;
use serde::Deserialize;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use whitstone_converge::{Change, Study, StudyReport};
use whitstone_core::Registry;

/// What `converge --json` writes.
#[derive(Deserialize)]
struct Reports {
    studies: Vec<StudyReport>,
}

/// Measures studies on a cluster, prints each result as it arrives, and writes those so far.
pub(super) fn measure(
    arguments: &Arguments,
    studies: &[(PathBuf, Study)],
    registry: &Registry,
) -> Result<Vec<StudyReport>, Failure> {
    arguments.drivers.check_built_in()?;
    if arguments.subject.is_some() {
        return Err(Failure::usage(
            "--cluster does not run subjects: their commands run only where they are named",
        ));
    }
    let identity = Program::this()?;
    let mut planned = Vec::new();
    for (path, study) in studies {
        let files = files(path, study, registry)?;
        planned.push(plan::command(&identity, &files, words(arguments, path)?)?);
    }
    let results = cluster::results(&arguments.target)?;
    if arguments.fresh {
        results.remove(&planned);
    }
    let mut reports: Vec<Option<StudyReport>> = studies.iter().map(|_| None).collect();
    let mut problem = None;
    let finished = &mut |job: &Job| {
        let place = planned.iter().position(|one| one.id == job.id);
        match (Output::read::<Reports>(&results, job), place) {
            (Ok((Reports { studies }, _)), Some(place)) => {
                for report in studies {
                    tell(arguments, &report);
                    reports[place] = Some(report);
                }
            }
            (Ok(_), None) => {}
            (Err(found), _) => problem = Some(found),
        }
    };
    arguments.cluster.run(&mut Batch {
        doing: "converge",
        jobs: &planned,
        results: &results,
        target: &arguments.target,
        threads: arguments.threads,
        mitsuba: arguments.drivers.mitsuba.as_deref(),
        exclusive: true,
        finished,
    })?;
    if let Some(problem) = problem {
        return Err(problem);
    }
    let reports: Vec<StudyReport> = reports.into_iter().flatten().collect();
    write(arguments, &reports)?;
    results.remove(&planned);
    Ok(reports)
}

/// All files that the renderings of a study are read from.
fn files(path: &Path, study: &Study, registry: &Registry) -> Result<Vec<PathBuf>, Failure> {
    let mut found = BTreeSet::from([path.to_owned()]);
    if study.stress.is_some() {
        return Ok(found.into_iter().collect());
    }
    let truths = std::iter::once(&study.truth).chain(&study.checks);
    let mut settings: Vec<Vec<&Change>> = truths.map(|truth| truth.set.iter().collect()).collect();
    for series in &study.series {
        settings.extend(series.settings.iter().map(|setting| {
            let changes = series.set.iter().chain(&setting.changes);
            changes.collect()
        }));
    }
    let mut known = BTreeSet::new();
    for setting in settings {
        let changes = study.set.iter().chain(setting);
        let overrides: Vec<String> = changes.map(|change| change.text.clone()).collect();
        if known.insert(overrides.clone()) {
            found.extend(plan::files_of(&study.scene_path, &overrides, registry)?);
        }
    }
    Ok(found.into_iter().collect())
}

/// The command of one study.
fn words(arguments: &Arguments, path: &Path) -> Result<Vec<String>, Failure> {
    let mut words = vec!["converge".to_owned(), plan::from_here(path)?];
    let mut add = |flag: &str, value: String| words.extend([flag.to_owned(), value]);
    if let Some(repeats) = arguments.repeats {
        add("--repeats", repeats.to_string());
    }
    if let Some(error) = arguments.recommend {
        add("--recommend", error.to_string());
    }
    add("--budget", arguments.budget.to_string());
    add("--time-limit", arguments.time_limit.to_string());
    let switches = [
        ("--quick", arguments.quick),
        ("--no-mitsuba", arguments.no_mitsuba),
    ];
    let on = switches.iter().filter(|(_, on)| *on);
    words.extend(on.map(|(flag, _)| (*flag).to_owned()));
    Ok(words)
}
