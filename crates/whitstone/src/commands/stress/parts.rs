//! `stress --cluster`: each family is a job.

use super::{Arguments, columns, print};
use crate::commands::cluster::{self, Batch};
use crate::commands::plan;
use crate::commands::run_job::Output;
use crate::jobs::{Job, Program};
use crate::terminal::Failure;
use serde::Deserialize;
use whitstone_core::Registry;
use whitstone_stress::{Family, FamilyReport};

/// What `stress --json` writes.
#[derive(Deserialize)]
struct Reports {
    families: Vec<FamilyReport>,
}

/// Measures families on a cluster, and prints each result as it arrives.
pub(super) fn measure(
    arguments: &Arguments,
    families: &[&'static dyn Family],
    registry: &Registry,
) -> Result<Vec<FamilyReport>, Failure> {
    arguments.drivers.check_built_in()?;
    let identity = Program::this()?;
    let words = |family: &&dyn Family| {
        let mut words = vec!["stress".to_owned(), family.about().name.to_owned()];
        words.extend(["--rays".to_owned(), arguments.rays().to_string()]);
        words.extend(["--time-limit".to_owned(), arguments.time_limit.to_string()]);
        words.extend(arguments.no_mitsuba.then(|| "--no-mitsuba".to_owned()));
        words
    };
    let planned: Vec<Job> = families
        .iter()
        .map(|family| plan::command(&identity, &[], words(family)))
        .collect::<Result<_, _>>()?;
    let results = cluster::results(&arguments.target)?;
    if arguments.fresh {
        results.remove(&planned);
    }
    let engines = columns(arguments, registry);
    let mut reports: Vec<Option<FamilyReport>> = families.iter().map(|_| None).collect();
    let mut problem = None;
    let mut first = true;
    let finished = &mut |job: &Job| {
        let place = planned.iter().position(|one| one.id == job.id);
        match (Output::read::<Reports>(&results, job), place) {
            (Ok((Reports { families }, _)), Some(place)) => {
                for report in families {
                    print(&report, &engines, arguments.steps, std::mem::take(&mut first));
                    reports[place] = Some(report);
                }
            }
            (Ok(_), None) => {}
            (Err(found), _) => problem = Some(found),
        }
    };
    arguments.cluster.run(&mut Batch {
        doing: "stress",
        jobs: &planned,
        results: &results,
        target: &arguments.target,
        threads: 1,
        mitsuba: arguments.drivers.mitsuba.as_deref(),
        exclusive: false,
        finished,
    })?;
    if let Some(problem) = problem {
        return Err(problem);
    }
    results.remove(&planned);
    eprintln!("The times were measured beside other jobs, so they are upper bounds.");
    Ok(reports.into_iter().flatten().collect())
}
