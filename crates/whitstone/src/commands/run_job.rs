//! `run-job`: renders one job of a file that `plan` wrote.

use super::{SceneArguments, Target, build_with};
use crate::interrupt;
use crate::jobs::{Job, Program, Record, Results};
use crate::terminal::{self, Exit, Failure, write_json};
use clap::Args;
use serde_json::json;
use std::io::{BufRead, BufReader, Read};
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use whitstone_core::{Registry, nearest};
use whitstone_image::{Placement, atomic};
use whitstone_render::RenderOptions;

/// Run one job of a file that `plan` wrote
///
/// Writes the tile to ID.exr in the folder of results, and then a record of it to ID.json. A job
/// whose result is complete is not run again. A job that was planned by another build of the
/// program, or whose input files are missing or changed, is refused with exit code 3. Exit code 2
/// says that the job itself cannot be rendered.
#[derive(Args, Debug)]
#[command(
    help_template = super::HELP_TEMPLATE,
    after_help = "Examples:\n  whitstone run-job jobs.jsonl --index 0\n  whitstone run-job jobs.jsonl --index $SLURM_ARRAY_TASK_ID --results /shared/results"
)]
pub struct Arguments {
    /// File of jobs; - means standard input
    #[arg(value_name = "JOBS", required_unless_present = "program")]
    jobs: Option<PathBuf>,
    /// The job on this line, counted from 0
    #[arg(long, value_name = "NUMBER", conflicts_with = "id")]
    index: Option<usize>,
    /// The job with this id
    #[arg(long)]
    id: Option<String>,
    /// Folder of the results [default: the name of the file of jobs with .results]
    #[arg(long, value_name = "DIR")]
    results: Option<PathBuf>,
    /// Folder of the input files [default: where they were when the jobs were planned]
    #[arg(long, value_name = "DIR")]
    inputs: Option<PathBuf>,
    /// Number of threads; 0 means one per core. The image does not depend on it
    #[arg(long, value_name = "COUNT", default_value_t = 0, value_parser = super::threads)]
    threads: usize,
    /// Reject a scene whose meshes and accelerators need more memory than this, in GiB [default:
    /// the available memory]
    #[arg(long, value_name = "GIB", value_parser = super::gib)]
    max_memory: Option<u64>,
    #[command(flatten)]
    target: Target,
    /// Read one job from standard input, and end as soon as standard input is closed: no process
    /// stays behind when the one that started it is killed
    #[arg(long, conflicts_with_all = ["index", "id"])]
    attached: bool,
    /// Print the version and the hash of this program, which are those of the jobs that it can run
    #[arg(long, exclusive = true)]
    program: bool,
    /// Write the record of the job to this file as JSON; - means standard output
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

/// The folder of results if none is named.
pub(super) fn default_results(jobs: &Path) -> PathBuf {
    jobs.with_extension("results")
}

/// Runs the command.
pub fn run(arguments: &Arguments, registry: &Registry) -> Result<Exit, Failure> {
    if arguments.program {
        write_json(Path::new(terminal::STDOUT), &json!(Program::this()?))?;
        return Ok(Exit::Pass);
    }
    let path = arguments.jobs.as_deref().unwrap_or(Path::new(terminal::STDOUT));
    let job = match arguments.attached {
        true if path == Path::new(terminal::STDOUT) => attached()?,
        true => {
            return Err(Failure::usage(
                "--attached reads the job from standard input; give - as JOBS",
            ));
        }
        false => pick(path, arguments)?,
    };
    let results = match &arguments.results {
        Some(folder) => folder.clone(),
        None if path == Path::new(terminal::STDOUT) => {
            return Err(Failure::usage("jobs from standard input need --results"));
        }
        None => default_results(path),
    };
    terminal::make_folder(&results)?;
    let results = Results(results);
    let (record, word) = match results.find(&job) {
        Some(record) => (record, "was finished before"),
        None => (render(&job, &results, arguments, registry)?, "is finished"),
    };
    println!(
        "job {} {word}: {} rays in {:.3} s, built in {:.3} s",
        job.id, record.rays, record.render_s, record.build_s
    );
    if let Some(path) = &arguments.json {
        write_json(path, &json!(record))?;
    }
    Ok(Exit::Pass)
}

/// Reads one job from standard input, and watches it from then on.
fn attached() -> Result<Job, Failure> {
    let mut input = BufReader::new(std::io::stdin());
    let mut line = String::new();
    input
        .read_line(&mut line)
        .map_err(|error| Failure::usage(format!("standard input: {error}")))?;
    let job = Job::read_line(&line)?;
    std::thread::Builder::new()
        .name("input".to_owned())
        .spawn(move || {
            // Nothing more is expected: this ends when the other side is closed.
            let _ = std::io::copy(&mut input.by_ref(), &mut std::io::sink());
            atomic::remove_temporaries();
            std::process::exit(143);
        })
        .map_err(Failure::environment)?;
    Ok(job)
}

/// The job that the arguments name. Other lines are not parsed: a file may have very many.
fn pick(path: &Path, arguments: &Arguments) -> Result<Job, Failure> {
    let (index, id) = (arguments.index, arguments.id.as_deref());
    let wanted = |number: usize, line: &str| match (index, id) {
        (Some(index), _) => number == index,
        (None, Some(id)) => Job::is_line_of(line, id),
        (None, None) => true,
    };
    let jobs = Job::read(path, wanted)?;
    let problem = match (jobs.len(), index, id) {
        (0, Some(index), _) => format!("--index {index}: the file has fewer jobs; they are counted from 0"),
        (0, None, Some(id)) => {
            let all = Job::read(path, |_, _| true)?;
            let near = nearest(id, all.iter().map(|job| job.id.as_str()));
            let near = near.map_or_else(String::new, |near| format!("; did you mean {near}?"));
            format!("--id {id}: no job of the file has this id{near}")
        }
        (count, None, None) if count > 1 => {
            format!("the file has {count} jobs; choose one with --index or --id")
        }
        _ => return jobs.into_iter().next().ok_or_else(|| Failure::usage("no jobs")),
    };
    Err(Failure::usage(format!("{}: {problem}", path.display())))
}

fn render(
    job: &Job,
    results: &Results,
    arguments: &Arguments,
    registry: &Registry,
) -> Result<Record, Failure> {
    let inputs = arguments.inputs.as_ref().unwrap_or(&job.folder);
    job.check(inputs)?;
    // Before the work.
    atomic::check(results.0.join(&job.outputs[0])).map_err(Failure::environment)?;
    let scene = SceneArguments {
        scene: inputs.join(&job.picture.scene),
        camera: job.picture.camera.clone(),
        overrides: job.picture.overrides.clone(),
        root: None,
        max_memory: arguments.max_memory,
        max_tree_rays: job.picture.max_tree_rays,
        target: arguments.target.clone(),
        fresh: false,
    };
    let (pipeline, ()) = build_with(&scene, registry, Some(job.region()), |_| ())?;
    let size = pipeline.film.size;
    if [size.width, size.height] != [job.picture.width, job.picture.height] {
        return Err(Failure::usage(format!(
            "job {}: planned for an image of {} x {} pixels, but the scene has {} x {}",
            job.id, job.picture.width, job.picture.height, size.width, size.height
        )));
    }
    let watching = interrupt::Watching::new();
    let film = pipeline.render(RenderOptions {
        region: Some(job.region()),
        threads: arguments.threads,
        progress: Some(&|_, _| match interrupt::stop().is_requested() {
            true => ControlFlow::Break(()),
            false => ControlFlow::Continue(()),
        }),
    });
    film.check().map_err(Failure::usage)?;
    if !film.is_complete {
        return Err(Failure::Interrupted {
            signal: interrupt::signal().unwrap_or(15),
            kept: format!("job {} has no result", job.id),
        });
    }
    drop(watching);
    let record = Record {
        id: job.id.clone(),
        hash: String::new(),
        build_s: pipeline.build_seconds,
        render_s: film.render_seconds,
        rays: film.counters.total(),
        not_finite: film.not_finite(),
    };
    let mut image = film.into_image(&pipeline.scene_hash).map_err(Failure::usage)?;
    let [x, y, ..] = job.tile;
    // The format ends far below 2^31.
    image.set_placement(Placement {
        x: x as i32,
        y: y as i32,
        frame_width: size.width as usize,
        frame_height: size.height as usize,
    });
    results.write(job, &image, &record)?;
    Ok(record)
}
