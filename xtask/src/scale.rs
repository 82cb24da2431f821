//! `scale`: measures what a cluster costs, and writes the model in docs/scale.md.

use crate::bench::machine;
use crate::run_time::wrapped;
use clap::Args;
use serde_json::{Value, json};
use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};
use whitstone::image::atomic;
use whitstone::validate::{Installation, dask_python};
use whitstone::{Exit, Failure};

/// The page that has the tables, between its markers.
pub(crate) const PAGE: &str = "docs/scale.md";
/// The stored result.
pub(crate) const RESULT: &str = "studies/results/scale.json";
/// The markers.
pub(crate) const MARKS: (&str, &str) = (
    "<!-- costs: written by `cargo xtask readme` -->",
    "<!-- end of costs -->",
);
const REQUIREMENTS: &str = "crates/whitstone/cluster/requirements.txt";
const SCHEDULER: &str = include_str!("scale/scheduler.py");
/// Names the processes of a measurement.
const MARK: &str = "WHITSTONE_SCALE";
/// Worker processes of the measured commands.
const WORKERS: u32 = 2;
/// Numbers of workers of the model.
const MODEL: [f64; 5] = [1.0, 10.0, 100.0, 1000.0, 10_000.0];

/// Measure what a cluster costs: for each job, each worker, the files and the merging, and a large
/// frame in tiles
///
/// The command `whitstone` runs on worker processes of this machine. The scheduler of Dask is
/// measured alone, with up to 1000 workers that only wait. With --json, `cargo xtask readme` writes
/// the tables of docs/scale.md.
#[derive(Args, Debug)]
#[command(
    help_template = whitstone::commands::HELP_TEMPLATE,
    after_help = "Examples:\n  cargo xtask scale --quick\n  cargo xtask scale --json studies/results/scale.json"
)]
pub(crate) struct Arguments {
    /// Fewer jobs and workers and a smaller frame: half a minute instead of four
    #[arg(long)]
    quick: bool,
    /// The program to measure [default: whitstone, in the folder of this program]
    #[arg(long, value_name = "FILE")]
    program: Option<PathBuf>,
    /// Write all results to this file as JSON
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

/// Runs the command.
pub(crate) fn run(arguments: &Arguments) -> Result<Exit, Failure> {
    let program = match &arguments.program {
        Some(program) => program.clone(),
        None => std::env::current_exe()
            .map_err(Failure::environment)?
            .with_file_name("whitstone"),
    };
    let program = program.canonicalize().map_err(|error| {
        Failure::usage(format!(
            "{}: {error}; build it, or name it with --program",
            program.display()
        ))
    })?;
    let say = |text: &str| eprintln!("{text}");
    let python =
        dask_python(&Installation::default(), Path::new(REQUIREMENTS), &say).map_err(Failure::environment)?;
    let lab = Lab {
        program,
        python,
        folder: tempfile::tempdir().map_err(Failure::environment)?,
    };
    let quick = arguments.quick;
    let (many, side) = if quick { (100, 2048) } else { (1000, 16_384) };
    let load = machine::load();
    let date = machine::date();
    let mut jobs = Vec::new();
    for count in [10, many] {
        say(&format!("{count} jobs of 8 x 8 pixels"));
        jobs.push(lab.small_jobs(count)?);
    }
    say(&format!("{many} jobs of 64 x 64 pixels with 100 samples"));
    jobs.push(lab.longer_jobs(many)?);
    let mut tasks = Vec::new();
    for (workers, number, seconds, bytes) in [
        (1, 500, 0.0, 0),
        (10, 1000, 0.0, 0),
        (100, 2000, 0.0, 0),
        (100, 1000, 0.0, 400_000),
        (100, 1000, 1.0, 0),
        (1000, 3000, 1.0, 0),
    ] {
        if quick && workers > 10 {
            continue;
        }
        say(&format!(
            "{number} tasks of {seconds} s with results of {bytes} bytes on {workers} waiting workers"
        ));
        let words = [
            workers.to_string(),
            number.to_string(),
            seconds.to_string(),
            bytes.to_string(),
        ];
        tasks.push(lab.scheduler("tasks", &words)?);
    }
    let mut files = Vec::new();
    for workers in [1, 2, 4, 8] {
        say(&format!("a file of 100 MB for {workers} workers"));
        files.push(lab.scheduler("file", &[workers.to_string(), "100000000".to_owned()])?);
    }
    say(&format!("an image of {side} x {side} pixels"));
    let frame = lab.frame(side)?;
    let result = json!({
        "quick": quick,
        "processor": machine::processor(),
        "cores": std::thread::available_parallelism().map_or(1, usize::from),
        "load": load, "date": date,
        "jobs": jobs, "tasks": tasks, "files": files, "frame": frame,
    });
    println!("{}", section(&result));
    if let Some(path) = &arguments.json {
        let text = serde_json::to_string_pretty(&result).map_err(Failure::environment)? + "\n";
        atomic::write_bytes(path, text.as_bytes()).map_err(Failure::environment)?;
    }
    let per_job = per_job(&result);
    let busy = busy(&result["jobs"][2]);
    let good = per_job < 0.025 && busy >= 0.9;
    println!(
        "{:.1} ms for each further job (at most 25); workers {:.0} % busy (at least 90)",
        per_job * 1e3,
        busy * 100.0
    );
    Ok(if good { Exit::Pass } else { Exit::Differs })
}

struct Lab {
    program: PathBuf,
    python: PathBuf,
    folder: tempfile::TempDir,
}

impl Lab {
    /// Renders on worker processes of this machine; returns what `--json` says, with the whole time
    /// of the command and its memory.
    fn render(&self, scene: &str, changes: &[String]) -> Result<Value, Failure> {
        let at = |name: &str| self.folder.path().join(name);
        let (json, image) = (at("render.json"), at("image.exr"));
        let mut command = Command::new(&self.program);
        command.args(["render", scene, "--cluster", "local", "--threads", "1"]);
        command.args(["--workers", &WORKERS.to_string(), "-o"]);
        command.arg(&image).arg("--json").arg(&json);
        command.arg("--dask").arg(&self.python);
        command.arg("--target").arg(at("target"));
        command
            .args(changes)
            .env(MARK, std::process::id().to_string())
            .stdout(Stdio::null());
        let start = Instant::now();
        let mut child = command.spawn().map_err(Failure::environment)?;
        let memory = Memory::watch(&mut child)?;
        let status = child.wait().map_err(Failure::environment)?;
        let elapsed = start.elapsed().as_secs_f64();
        if !status.success() {
            return Err(Failure::environment(format!("`render` ended with {status}")));
        }
        let text = fs::read_to_string(&json).map_err(Failure::environment)?;
        let mut value: Value = serde_json::from_str(&text).map_err(Failure::environment)?;
        value["elapsed_s"] = json!(elapsed);
        value["memory"] = json!({ "all": memory.all, "largest": memory.largest, "command": memory.command });
        value["file_bytes"] = json!(fs::metadata(&image).map_or(0, |file| file.len()));
        value["output"] = Value::Null;
        Ok(value)
    }

    /// Jobs that take almost no time apart from their processes.
    fn small_jobs(&self, count: u32) -> Result<Value, Failure> {
        let changes = [
            format!("--set=film={{width={},height=8}}", 8 * count),
            "--tile-size=8".to_owned(),
        ];
        self.render("scenes/shapes/sphere.toml", &changes)
    }

    /// Jobs of some hundredths of a second.
    fn longer_jobs(&self, count: u32) -> Result<Value, Failure> {
        let changes = [
            format!("--set=film={{width={},height=640}}", 64 * count / 10),
            "--set=sampler={type='grid',samples_per_axis=10}".to_owned(),
            "--tile-size=64".to_owned(),
        ];
        self.render("scenes/showcase/classic.toml", &changes)
    }

    fn frame(&self, side: u32) -> Result<Value, Failure> {
        let changes = [
            format!("--set=film={{width={side},height={side},aovs=[]}}"),
            format!("--tile-size={}", side / 16),
        ];
        self.render("scenes/showcase/classic.toml", &changes)
    }

    /// Runs the measurements of the scheduler alone.
    fn scheduler(&self, what: &str, words: &[String]) -> Result<Value, Failure> {
        let script = self.folder.path().join("scheduler.py");
        fs::write(&script, SCHEDULER).map_err(Failure::environment)?;
        let output = Command::new(&self.python)
            .arg(&script)
            .arg(what)
            .args(words)
            .output()
            .map_err(Failure::environment)?;
        serde_json::from_slice(&output.stdout).map_err(|error| {
            let told = String::from_utf8_lossy(&output.stderr);
            Failure::environment(format!("scheduler.py: {error}\n{told}"))
        })
    }
}

/// The largest memory of a command and its processes, in bytes. Memory that several processes share
/// is divided among them.
struct Memory {
    /// All processes together.
    all: u64,
    /// The largest process.
    largest: u64,
    /// The process of the command itself.
    command: u64,
}

impl Memory {
    /// Looks at the processes until the command ends.
    fn watch(child: &mut Child) -> Result<Self, Failure> {
        let mut most = Self {
            all: 0,
            largest: 0,
            command: 0,
        };
        let mark = format!("{MARK}={}", std::process::id());
        while child.try_wait().map_err(Failure::environment)?.is_none() {
            let mut all = 0;
            for process in fs::read_dir("/proc").into_iter().flatten().flatten() {
                let path = process.path();
                let is_ours = fs::read(path.join("environ"))
                    .is_ok_and(|text| text.split(|byte| *byte == 0).any(|line| line == mark.as_bytes()));
                let Some(bytes) = is_ours.then(|| share(&path)).flatten() else {
                    continue;
                };
                all += bytes;
                most.largest = most.largest.max(bytes);
                if path.ends_with(child.id().to_string()) {
                    most.command = most.command.max(bytes);
                }
            }
            most.all = most.all.max(all);
            std::thread::sleep(Duration::from_millis(250));
        }
        Ok(most)
    }
}

/// The share of a process in the memory, in bytes.
fn share(process: &Path) -> Option<u64> {
    let text = fs::read_to_string(process.join("smaps_rollup")).ok()?;
    let line = text.lines().find_map(|line| line.strip_prefix("Pss:"))?;
    let kib: u64 = line.trim().strip_suffix("kB")?.trim().parse().ok()?;
    Some(kib << 10)
}

fn number(value: &Value, path: &str) -> f64 {
    value.pointer(path).and_then(Value::as_f64).unwrap_or(f64::NAN)
}

/// Seconds that each further job takes of the time of all.
fn per_job(result: &Value) -> f64 {
    let of = |k: usize, what: &str| number(&result["jobs"][k], what);
    let more = of(1, "/cluster/jobs") - of(0, "/cluster/jobs");
    (of(1, "/elapsed_s") - of(0, "/elapsed_s")) / more
}

/// The part of the time in which the workers had a job.
fn busy(jobs: &Value) -> f64 {
    number(jobs, "/cluster/busy_s") / (number(jobs, "/cluster/workers") * number(jobs, "/cluster/seconds"))
}

/// The part of the time in which the workers built scenes and rendered.
fn rendering(jobs: &Value) -> f64 {
    (number(jobs, "/render_s") + number(jobs, "/build_s"))
        / (number(jobs, "/cluster/workers") * number(jobs, "/cluster/seconds"))
}

/// The costs of a model.
struct Model {
    /// From the command to the first job, in seconds.
    start: f64,
    /// Time of a job on its worker apart from its pixels, in seconds.
    process: f64,
    /// Time of the scheduler for a job, in seconds.
    scheduler: f64,
    /// Time to merge a pixel, in seconds.
    merge: f64,
}

impl Model {
    fn new(result: &Value) -> Self {
        let jobs = &result["jobs"];
        let frame = &result["frame"];
        let small = &jobs[1];
        let tasks = result["tasks"].as_array().map_or(&[][..], Vec::as_slice);
        let times = tasks.iter().map(|tasks| number(tasks, "/scheduler_s"));
        let pixels = number(frame, "/width") * number(frame, "/height");
        let after = |value: &Value| number(value, "/elapsed_s") - number(value, "/cluster/seconds");
        let start = after(&jobs[0]);
        Self {
            start,
            process: (number(small, "/cluster/busy_s")
                - number(small, "/render_s")
                - number(small, "/build_s"))
                / number(small, "/cluster/jobs"),
            scheduler: times.fold(0.0, f64::max),
            merge: (after(frame) - start).max(0.0) / pixels,
        }
    }

    /// Seconds for jobs that take `work` seconds of one worker together.
    fn time(&self, workers: f64, jobs: f64, work: f64, pixels: f64) -> f64 {
        let parallel = (work + jobs * self.process) / workers.min(jobs);
        self.start + parallel.max(jobs * self.scheduler) + pixels * self.merge
    }
}

/// The tables of the page.
pub(crate) fn section(result: &Value) -> String {
    let mut text = wrapped(&format!(
        "Measured by `cargo xtask scale` with {WORKERS} worker processes on {}, {} cores, load average \
         {:.1} before. Jobs of 8 x 8 pixels show what a job costs apart from its pixels.",
        result["processor"].as_str().unwrap_or("an unknown processor"),
        result["cores"],
        number(result, "/load"),
    ));
    jobs_table(&mut text, result);
    scheduler_table(&mut text, result);
    files_table(&mut text, result);
    frame_text(&mut text, result);
    model_table(&mut text, result);
    text
}

fn jobs_table(text: &mut String, result: &Value) {
    text.push_str(
        "\n\n| jobs | pixels of a job | whole command | workers have a job | workers render |\n\
         |---:|---|---:|---:|---:|\n",
    );
    let what = ["8 x 8", "8 x 8", "64 x 64, 100 samples"];
    for (jobs, what) in result["jobs"].as_array().into_iter().flatten().zip(what) {
        let _ = writeln!(
            text,
            "| {} | {what} | {:.1} s | {:.0} % | {:.0} % |",
            jobs["cluster"]["jobs"],
            number(jobs, "/elapsed_s"),
            busy(jobs) * 100.0,
            rendering(jobs) * 100.0,
        );
    }
    let model = Model::new(result);
    let _ = write!(
        text,
        "\n{}\n",
        wrapped(&format!(
            "Each further small job adds {:.1} ms to the command; a worker has it for {:.0} ms, most of \
             which is the start of its process and the hash of the program. All jobs of Whitstone are \
             processes of their own.",
            per_job(result) * 1e3,
            model.process * 1e3,
        ))
    );
}

fn scheduler_table(text: &mut String, result: &Value) {
    let _ = write!(
        text,
        "\n{}\n\n| workers | tasks | time of a task | result | scheduler, for each task | client, for each \
         task | all tasks | as the model says |\n|---:|---:|---:|---:|---:|---:|---:|---:|\n",
        wrapped(
            "The scheduler alone, with workers that only wait. All of these workers are in one process, \
             which shares the cores with the scheduler and the client, so that many tasks at a time take \
             longer than the model says. The scheduler's processor time for each task limits how many \
             jobs start in a second:"
        )
    );
    for tasks in result["tasks"].as_array().into_iter().flatten() {
        let of = |what: &str| number(tasks, what);
        let shared = of("/tasks") * of("/task_s") / of("/workers");
        let predicted = shared.max(of("/tasks") * of("/scheduler_s"));
        let _ = writeln!(
            text,
            "| {} | {} | {} s | {} kB | {:.2} ms | {:.2} ms | {:.1} s | at least {predicted:.1} s |",
            tasks["workers"],
            tasks["tasks"],
            of("/task_s"),
            of("/bytes") / 1e3,
            of("/scheduler_s") * 1e3,
            of("/client_s") * 1e3,
            of("/elapsed_s"),
        );
    }
    let first = &result["tasks"][0];
    let _ = write!(
        text,
        "\n{}\n",
        wrapped(&format!(
            "So a task that starts no process costs {:.1} ms in all, on one worker.",
            1e3 * number(first, "/elapsed_s") / number(first, "/tasks")
        ))
    );
}

fn files_table(text: &mut String, result: &Value) {
    let _ = write!(
        text,
        "\n{}\n\n| workers | at the first worker | at all workers |\n|---:|---:|---:|\n",
        wrapped(
            "The files of a scene go to one worker through the scheduler, and from there to the others. A file of 100 MB:"
        )
    );
    for file in result["files"].as_array().into_iter().flatten() {
        let _ = writeln!(
            text,
            "| {} | {:.2} s | {:.2} s |",
            file["workers"],
            number(file, "/first_s"),
            number(file, "/all_s"),
        );
    }
}

fn frame_text(text: &mut String, result: &Value) {
    let frame = &result["frame"];
    let mib = |what: &str| number(frame, what) / f64::from(1 << 20);
    let _ = write!(
        text,
        "\n{}\n",
        wrapped(&format!(
            "An image of {} x {} pixels of the classic scene in {} tiles took {:.0} s, of which the workers \
             rendered for {:.0} s each. All processes together used at most {:.0} MiB of memory, the \
             largest of them {:.0} MiB, and the command, which merges the tiles, {:.0} MiB. The file has \
             {:.0} MiB; until it is complete, the tiles take as much.",
            frame["width"],
            frame["height"],
            frame["cluster"]["jobs"],
            number(frame, "/elapsed_s"),
            number(frame, "/render_s") / number(frame, "/cluster/workers"),
            mib("/memory/all"),
            mib("/memory/largest"),
            mib("/memory/command"),
            mib("/file_bytes"),
        ))
    );
}

fn model_table(text: &mut String, result: &Value) {
    let model = Model::new(result);
    let frame = &result["frame"];
    let pixels = number(frame, "/width") * number(frame, "/height");
    let jobs = number(frame, "/cluster/jobs");
    let samples = 100.0;
    let work = samples * (number(frame, "/render_s") + number(frame, "/build_s"));
    let _ = write!(
        text,
        "\n### Model\n\n{}\n\n{}\n\n",
        wrapped(&format!(
            "With w workers and n jobs that take t seconds each, a command takes about start + max(n (t + \
             p) / w, n c) + m. Here, the start of a local cluster is {:.1} s, p = {:.0} ms (process of a \
             job), c = {:.2} ms (scheduler, the largest of the table above), and m is the time to merge: \
             {:.0} ns a pixel. The scheduler is the limit where t + p < w c. So choose tiles that take more \
             than 10 p and more than w c, or `--chunk k`, which divides c by k; and where a scene has \
             gigabytes, a shared file system.",
            model.start,
            model.process * 1e3,
            model.scheduler * 1e3,
            model.merge * 1e9,
        )),
        wrapped(&format!(
            "*Shortest job* is the t at which the scheduler is busy all the time. *Frame* is the image above \
             with {samples} samples a pixel, in {jobs} and in 16 times as many tiles. *1 GB to all workers* \
             assumes a network of 1 GB/s, if each worker that has the files passes them on, and if one \
             worker sends them to all. Lines of more than 1000 workers are on paper.",
        ))
    );
    text.push_str(
        "| workers | jobs started in a second | shortest job | frame | frame, 16 x tiles | 1 GB to all workers |\n\
         |---:|---:|---:|---:|---:|---:|\n",
    );
    for workers in MODEL {
        let _ = writeln!(
            text,
            "| {workers} | {:.0} | {:.2} s | {:.0} s | {:.0} s | {} |",
            (1.0 / model.scheduler).min(workers / model.process),
            (workers * model.scheduler - model.process).max(0.0),
            model.time(workers, jobs, work, pixels),
            model.time(workers, 16.0 * jobs, work, pixels),
            match workers {
                1.0 => "1 s".to_owned(),
                _ => format!("{:.0} to {workers} s", 1.0 + workers.log2().ceil()),
            },
        );
    }
}
