//! `run-job`: runs one job of a file that `plan` wrote, or of a cluster.

use super::{Command, SceneArguments, Target, build_with};
use crate::interrupt;
use crate::jobs::{Job, Picture, Program, Record, Rendered, Results, Task, Tile};
use crate::terminal::{self, Exit, Failure, write_json};
use clap::{Args, Parser};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};
use std::ffi::OsString;
use std::fmt::Display;
use std::fs;
use std::io::{BufRead, BufReader, Read};
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::time::Instant;
use whitstone_core::{Registry, nearest};
use whitstone_image::{Placement, atomic, exr_io};
use whitstone_render::{Region, RenderOptions};

/// Run one job of a file that `plan` wrote
///
/// Writes the tile to ID.exr in the folder of results, and then a record of it to ID.json. The
/// result of a job of another command than `render` is in ID.result. A job whose result is complete
/// is not run again. A job that was planned by another build of the
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
    /// Python with an installed Mitsuba, for jobs that need it [default: the private environment]
    #[arg(long, value_name = "PYTHON")]
    mitsuba: Option<PathBuf>,
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
pub fn run(arguments: &Arguments, registry: &Registry, program: &str) -> Result<Exit, Failure> {
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
        None => {
            let inputs = arguments.inputs.as_ref().unwrap_or(&job.folder);
            job.check(inputs)?;
            // Before the work.
            atomic::check(results.0.join(&job.outputs[0])).map_err(Failure::environment)?;
            let record = match &job.task {
                Task::Render { tile, picture } => {
                    render(&job, *tile, picture, inputs, &results, arguments, registry)?
                }
                Task::Run {
                    folder,
                    arguments: words,
                } => {
                    let folder = inputs.join(folder);
                    command(&job, words, &folder, &results, arguments, registry, program)?
                }
            };
            (record, "is finished")
        }
    };
    match &record.tile {
        Some(tile) => println!(
            "job {} {word}: {} rays in {:.3} s, built in {:.3} s",
            job.id, tile.rays, tile.render_s, tile.build_s
        ),
        None => println!("job {} {word}: {:.3} s", job.id, record.seconds),
    }
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
    tile: Tile,
    picture: &Picture,
    inputs: &Path,
    results: &Results,
    arguments: &Arguments,
    registry: &Registry,
) -> Result<Record, Failure> {
    let start = Instant::now();
    let [x, y, width, height] = tile;
    let region = Region { x, y, width, height };
    let scene = SceneArguments {
        scene: inputs.join(&picture.scene),
        camera: picture.camera.clone(),
        overrides: picture.overrides.clone(),
        root: None,
        max_memory: arguments.max_memory,
        max_tree_rays: picture.max_tree_rays,
        target: arguments.target.clone(),
        fresh: false,
    };
    let (pipeline, ()) = build_with(&scene, registry, Some(region), |_| ())?;
    let size = pipeline.film.size;
    if [size.width, size.height] != [picture.width, picture.height] {
        return Err(Failure::usage(format!(
            "job {}: planned for an image of {} x {} pixels, but the scene has {} x {}",
            job.id, picture.width, picture.height, size.width, size.height
        )));
    }
    let watching = interrupt::Watching::new();
    let film = pipeline.render(RenderOptions {
        region: Some(region),
        threads: arguments.threads,
        progress: Some(&|_, _| match interrupt::stop().is_requested() {
            true => ControlFlow::Break(()),
            false => ControlFlow::Continue(()),
        }),
        ..RenderOptions::default()
    });
    film.check().map_err(Failure::usage)?;
    if !film.is_complete {
        return Err(Failure::Interrupted {
            signal: interrupt::signal().unwrap_or(15),
            kept: format!("job {} has no result", job.id),
        });
    }
    drop(watching);
    let rendered = Rendered {
        build_s: pipeline.build_seconds,
        render_s: film.render_seconds,
        rays: film.counters.total(),
        not_finite: film.not_finite(),
    };
    let mut image = film.into_image(&pipeline.scene_hash).map_err(Failure::usage)?;
    // The format ends far below 2^31.
    image.set_placement(Placement {
        x: x as i32,
        y: y as i32,
        frame_width: size.width as usize,
        frame_height: size.height as usize,
    });
    let bytes = exr_io::encode(&image).map_err(Failure::environment)?;
    results.write(job, &bytes, start.elapsed().as_secs_f64(), Some(rendered))
}

/// The result of a job that runs a command.
#[derive(Deserialize, Serialize)]
pub(super) struct Output {
    /// What the command writes for `--json`.
    json: Value,
    /// The pictures of the cases of `validate`.
    pictures: Value,
}

impl Output {
    /// Reads the result of a job.
    pub(super) fn read<T: DeserializeOwned>(results: &Results, job: &Job) -> Result<(T, Value), Failure> {
        let broken = |problem: &dyn Display| Failure::environment(format!("job {}: {problem}", job.id));
        let loaded = results.load(job);
        let (_, bytes) = loaded.ok_or_else(|| broken(&"no complete result"))?;
        let output: Self = serde_json::from_slice(&bytes).map_err(|error| broken(&error))?;
        let json = serde_json::from_value(output.json).map_err(|error| broken(&error))?;
        Ok((json, output.pictures))
    }
}

/// Runs a command of this program in a folder.
fn command(
    job: &Job,
    words: &[String],
    folder: &Path,
    results: &Results,
    arguments: &Arguments,
    registry: &Registry,
    program: &str,
) -> Result<Record, Failure> {
    let start = Instant::now();
    // The results stay where they are, seen from the other folder.
    let results = Results(std::path::absolute(&results.0).map_err(Failure::environment)?);
    let scratch = tempfile::tempdir().map_err(Failure::environment)?;
    let json = scratch.path().join("results.json");
    let mitsuba = arguments.mitsuba.as_ref().map(std::path::absolute).transpose();
    let mitsuba = mitsuba.map_err(Failure::usage)?;
    let command = parse(
        words,
        &json,
        arguments.threads,
        mitsuba.as_deref(),
        scratch.path(),
        program,
    )
    .map_err(|problem| Failure::usage(format!("job {}: {problem}", job.id)))?;
    // A copy of the inputs has it only if one of them is in it.
    terminal::make_folder(folder)?;
    std::env::set_current_dir(folder)
        .map_err(|error| Failure::environment(format!("{}: {error}", folder.display())))?;
    let done = command.run(registry, program);
    if let Err(failure @ Failure::Interrupted { .. }) = done {
        return Err(failure);
    }
    let Ok(text) = fs::read_to_string(&json) else {
        return Err(done
            .err()
            .unwrap_or_else(|| Failure::environment("the command wrote no results")));
    };
    let pictures = fs::read_to_string(scratch.path().join("validate/pictures.json"));
    let read = |text: &str| serde_json::from_str(text).map_err(Failure::environment);
    let output = Output {
        json: read(&text)?,
        pictures: pictures.map_or(Ok(Value::Null), |text| read(&text))?,
    };
    let bytes = serde_json::to_vec(&output).map_err(Failure::environment)?;
    results.write(job, &bytes, start.elapsed().as_secs_f64(), None)
}

/// The command of a job. Whatever the job says, it writes no file but `json` and those in
/// `scratch`, and starts no program but the reference.
fn parse(
    words: &[String],
    json: &Path,
    threads: usize,
    mitsuba: Option<&Path>,
    scratch: &Path,
    program: &str,
) -> Result<Command, String> {
    let mut all: Vec<OsString> = vec![program.into()];
    all.extend(words.iter().map(OsString::from));
    all.extend(["--json".into(), json.into()]);
    if words.first().is_none_or(|name| name != "stress") {
        all.extend(["--threads".into(), threads.to_string().into()]);
    }
    let parsed = super::Arguments::try_parse_from(all).map_err(|error| error.to_string())?;
    let mut command = parsed.command;
    let is_part = match &mut command {
        Command::Validate(arguments) => arguments.be_part(scratch, mitsuba),
        #[cfg(feature = "stress")]
        Command::Stress(arguments) => arguments.be_part(scratch, mitsuba),
        #[cfg(feature = "converge")]
        Command::Converge(arguments) => arguments.be_part(scratch, mitsuba),
        _ => false,
    };
    match is_part {
        true => Ok(command),
        false => Err(format!("`{}` is no part of a command", words.join(" "))),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn jobs_write_no_other_files_and_start_no_programs() {
        let parse = |words: &[&str]| {
            let words: Vec<String> = words.iter().map(|word| (*word).to_owned()).collect();
            let scratch = Path::new("scratch");
            parse(&words, &scratch.join("x.json"), 1, None, scratch, "whitstone").err()
        };
        assert_eq!(parse(&["validate", "a.toml", "--set", "camera.fov=30"]), None);
        for words in [
            &["render", "a.toml", "-o", "/x.exr"][..],
            &["compare", "a.exr", "b.exr"],
            &["run-job", "a.jsonl"],
            &["validate", "a.toml", "--junit", "/x.xml"],
            &["validate", "a.toml", "--json", "/x.json"],
            &["validate", "a.toml", "--target", "/x"],
            &["validate", "a.toml", "--subject", "x={command='rm'}"],
            &["validate", "a.toml", "--mitsuba", "/x"],
            &["validate", "a.toml", "--drivers", "/x"],
            &["validate", "a.toml", "--cluster", "local"],
            &[],
        ] {
            assert!(parse(words).is_some(), "{words:?}");
        }
    }

    #[cfg(feature = "stress")]
    #[test]
    fn families_write_no_other_files() {
        let parse = |more: &[&str]| {
            let words = ["stress", "planet"].iter().chain(more);
            let words: Vec<String> = words.map(|word| (*word).to_owned()).collect();
            let scratch = Path::new("scratch");
            parse(&words, &scratch.join("x.json"), 1, None, scratch, "whitstone").err()
        };
        assert_eq!(parse(&["--quick"]), None);
        for more in [
            &["--plots", "/x"][..],
            &["--page", "/x"],
            &["--target", "/x"],
            &["--kernel", "rm"],
            &["--subject", "x={command='rm'}"],
            &["--cluster", "local"],
        ] {
            assert!(parse(more).is_some(), "{more:?}");
        }
    }

    #[cfg(feature = "converge")]
    #[test]
    fn studies_write_no_other_files() {
        let parse = |more: &[&str]| {
            let words = ["converge", "a.toml"].iter().chain(more);
            let words: Vec<String> = words.map(|word| (*word).to_owned()).collect();
            let scratch = Path::new("scratch");
            parse(&words, &scratch.join("x.json"), 1, None, scratch, "whitstone").err()
        };
        assert_eq!(parse(&["--no-mitsuba"]), None);
        for more in [
            &["--plots", "/x"][..],
            &["--page", "/x"],
            &["--csv", "/x"],
            &["--target", "/x"],
            &["--subject", "x={command='rm'}"],
            &["--cluster", "local"],
        ] {
            assert!(parse(more).is_some(), "{more:?}");
        }
    }
}
