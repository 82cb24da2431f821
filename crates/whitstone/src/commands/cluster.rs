//! Runs jobs on a Dask cluster: the Rust half, which starts `cluster/cluster.py`.

use super::Target;
use crate::interrupt;
use crate::jobs::{self, Job, Results};
use crate::terminal::{self, Failure, progress};
use clap::Args;
use serde::{Deserialize, Serialize};
use serde_json::json;
use std::collections::{BTreeMap, HashMap};
use std::fs::{self, File};
use std::io::{BufRead, BufReader, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::mpsc::{self, RecvTimeoutError};
use std::time::{Duration, Instant};
use whitstone_image::atomic;
use whitstone_validate::{Installation, counted, dask_python};

const SCRIPT: &str = include_str!("../../cluster/cluster.py");
const REQUIREMENTS: &str = include_str!("../../cluster/requirements.txt");

/// Where the jobs run.
#[derive(Args, Clone, Debug)]
// An unnamed group, because it is part of several commands.
#[group(skip)]
pub struct Cluster {
    /// Run in parts on a Dask cluster: the address of its scheduler, such as tcp://10.0.0.1:8786,
    /// or local for processes of this machine. A part uses one thread, unless --threads says
    /// otherwise. Finished parts are kept until all are finished, so that the same command
    /// continues
    #[arg(long, value_name = "SCHEDULER")]
    pub(super) cluster: Option<String>,
    /// Number of worker processes of --cluster local; 0 means one per core
    #[arg(long, value_name = "COUNT", default_value_t = 0, value_parser = super::threads, requires = "cluster")]
    workers: usize,
    /// How often a job may fail before it is given up; the others go on
    #[arg(long, value_name = "COUNT", default_value_t = 2, requires = "cluster")]
    retries: u32,
    /// Time limit of a job, in seconds
    #[arg(long, value_name = "SECONDS", default_value_t = 3600, requires = "cluster", value_parser = clap::value_parser!(u64).range(1..))]
    job_time: u64,
    /// Jobs with a higher priority run first, also those of other commands on the same scheduler
    #[arg(
        long,
        value_name = "NUMBER",
        default_value_t = 0,
        requires = "cluster",
        allow_negative_numbers = true
    )]
    priority: i32,
    /// Number of jobs that a worker takes at a time. More of them are less work for the scheduler,
    /// but results arrive, and are kept, only when all of them are finished
    #[arg(long, value_name = "COUNT", default_value_t = 1, requires = "cluster", value_parser = clap::value_parser!(u32).range(1..=100_000))]
    chunk: u32,
    /// Python with an installed Dask, to be used in place of the private environment
    #[arg(long, value_name = "PYTHON", requires = "cluster")]
    dask: Option<PathBuf>,
}

/// Jobs that run together.
pub(super) struct Batch<'a> {
    /// For the display of progress, such as "rendering".
    pub(super) doing: &'a str,
    pub(super) jobs: &'a [Job],
    pub(super) results: &'a Results,
    pub(super) target: &'a Target,
    /// Threads of a job.
    pub(super) threads: usize,
    /// A Python with Mitsuba on the workers, if they have no private environment.
    pub(super) mitsuba: Option<&'a Path>,
    /// Whether a job runs alone on its machine, so that its times mean something.
    pub(super) exclusive: bool,
    /// Called with each job that is finished, also those that were finished before.
    pub(super) finished: &'a mut dyn FnMut(&Job),
}

/// The folder of the results of unfinished commands.
pub(super) fn results(target: &Target) -> Result<Results, Failure> {
    let folder = target.folder().join("jobs");
    terminal::make_folder(&folder)?;
    Ok(Results(folder))
}

/// A line of the script.
#[derive(Debug, Deserialize)]
#[serde(tag = "event", rename_all = "snake_case")]
enum Event {
    Started { workers: usize },
    Finished { id: String, seconds: f64 },
    Failed { id: String, reason: String },
    Refused { worker: String, reason: String },
    Stopped { reason: String },
}

/// Ends the script when it is dropped.
struct Script(Child);

impl Script {
    /// How long it may take to end after its standard input is closed.
    const PATIENCE: Duration = Duration::from_secs(5);

    fn end(&mut self) {
        drop(self.0.stdin.take());
        let start = Instant::now();
        while let Ok(None) = self.0.try_wait() {
            if start.elapsed() > Self::PATIENCE {
                let _ = self.0.kill();
                let _ = self.0.wait();
                return;
            }
            std::thread::sleep(Duration::from_millis(10));
        }
    }
}

impl Drop for Script {
    fn drop(&mut self) {
        self.end();
    }
}

impl Cluster {
    /// Whether the command line names a cluster.
    pub fn is_named(&self) -> bool {
        self.cluster.is_some()
    }

    /// Runs the jobs that have no result yet.
    pub(super) fn run(&self, batch: &mut Batch<'_>) -> Result<Usage, Failure> {
        let &mut Batch {
            jobs,
            results,
            target,
            ..
        } = batch;
        let installation = target.installation();
        let (done, waiting): (Vec<&Job>, Vec<&Job>) =
            jobs.iter().partition(|job| results.find(job).is_some());
        let before = done.len();
        if before > 0 {
            eprintln!(
                "{} of {} were finished before",
                before,
                counted(jobs.len(), "job")
            );
        }
        done.into_iter().for_each(|job| (batch.finished)(job));
        if waiting.is_empty() {
            return Ok(Usage::default());
        }
        let (script, requirements) = unpack(&installation)?;
        let python = match &self.dask {
            Some(python) => python.clone(),
            None => match own_python() {
                Some(python) => python,
                None => dask_python(&installation, &requirements, &|text| eprintln!("{text}"))
                    .map_err(Failure::environment)?,
            },
        };
        let cores = std::thread::available_parallelism().map_or(1, usize::from);
        let absolute = |path: &Path| std::path::absolute(path).unwrap_or_else(|_| path.to_owned());
        let request = json!({
            "scheduler": self.cluster,
            "workers": match (self.workers, batch.exclusive) {
                // All of them share this machine.
                (_, true) => 1,
                (0, false) => cores,
                (workers, false) => workers,
            },
            "retries": self.retries,
            "time_limit": self.job_time,
            "priority": self.priority,
            "chunk": self.chunk,
            "exclusive": batch.exclusive,
            "threads": match (batch.threads, batch.exclusive) {
                (0, false) => 1,
                (threads, _) => threads,
            },
            "mitsuba": batch.mitsuba,
            "command": jobs::own_command()?,
            "results": absolute(&results.0),
            "scratch": absolute(&target.folder().join("dask")),
            "jobs": waiting.iter().map(|job| Job::lines(std::slice::from_ref(*job))).collect::<Vec<_>>(),
        });
        let log = target.folder().join("cluster.log");
        let unwritable = |error| Failure::environment(format!("{}: {error}", log.display()));
        let mut child = Command::new(&python)
            .arg(&script)
            .env("PYTHONDONTWRITEBYTECODE", "1")
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(File::create(&log).map_err(unwritable)?)
            .spawn()
            .map_err(|error| Failure::environment(format!("{}: {error}", python.display())))?;
        let output = child.stdout.take();
        let mut script = Script(child);
        if let Some(input) = &mut script.0.stdin {
            // A script that ended early is noticed below.
            let _ = writeln!(input, "{request}").and_then(|()| input.flush());
        }
        let (sender, events) = mpsc::channel();
        std::thread::Builder::new()
            .name("events".to_owned())
            .spawn(move || {
                let lines = output
                    .into_iter()
                    .flat_map(|output| BufReader::new(output).lines());
                for line in lines.map_while(Result::ok) {
                    if sender.send(line).is_err() {
                        return;
                    }
                }
            })
            .map_err(Failure::environment)?;
        let told = Told::listen(&events, waiting.len() as u64, batch);
        let signal = interrupt::signal();
        let status = match signal {
            Some(_) => None,
            None => script.0.wait().ok(),
        };
        script.end();
        let finished = before + told.finished;
        let kept = format!(
            "{finished} of {} are finished; the same command continues",
            counted(jobs.len(), "job")
        );
        if let Some(signal) = signal {
            return Err(Failure::Interrupted { signal, kept });
        }
        if let Some(reason) = told.stopped {
            return Err(Failure::environment(format!("{reason}\n{kept}")));
        }
        if !told.failed.is_empty() {
            let of = |id: &String| jobs.iter().find(|job| job.id == *id);
            let failed: Vec<String> = told
                .failed
                .iter()
                .map(|(id, reason)| {
                    let what = of(id).map(|job| format!("{}, ", job.what()));
                    let log = results.log(id);
                    let log = log
                        .exists()
                        .then(|| format!("\n  all of its output: {}", log.display()));
                    format!(
                        "job {id}, {}failed: {reason}{}",
                        what.unwrap_or_default(),
                        log.unwrap_or_default()
                    )
                })
                .collect();
            return Err(Failure::environment(format!(
                "{}\n{kept}; what Dask reported is in {}",
                failed.join("\n"),
                log.display()
            )));
        }
        if told.finished < waiting.len() {
            let ended = status.map_or_else(|| "ended".to_owned(), |status| format!("ended with {status}"));
            let text = fs::read_to_string(&log).unwrap_or_default();
            let lines: Vec<&str> = text.lines().collect();
            return Err(Failure::environment(format!(
                "the connection to Dask {ended}:\n{}\n{kept}",
                lines[lines.len().saturating_sub(20)..].join("\n")
            )));
        }
        Ok(told.usage)
    }
}

/// How busy a cluster was.
#[derive(Clone, Copy, Debug, Default, Serialize)]
pub(super) struct Usage {
    /// Number of workers at first.
    workers: usize,
    /// Jobs that ran.
    jobs: usize,
    /// From the first worker to the last result, in seconds.
    seconds: f64,
    /// Sum over the jobs of the time that each took on its worker, with the start of its process.
    busy_s: f64,
}

/// What the script has reported.
#[derive(Default)]
struct Told {
    usage: Usage,
    finished: usize,
    failed: BTreeMap<String, String>,
    stopped: Option<String>,
}

impl Told {
    /// Reads events until the script ends or a signal arrives.
    fn listen(events: &mpsc::Receiver<String>, total: u64, batch: &mut Batch<'_>) -> Self {
        let mut told = Self::default();
        let doing = batch.doing;
        let by_id: HashMap<&str, &Job> = batch.jobs.iter().map(|job| (job.id.as_str(), job)).collect();
        let bar = progress(total, doing);
        let watching = interrupt::Watching::new();
        let mut start = Instant::now();
        loop {
            match events.recv_timeout(Duration::from_millis(100)) {
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => break,
                Ok(line) => match serde_json::from_str(&line) {
                    Ok(Event::Started { workers }) => {
                        told.usage.workers = workers;
                        start = Instant::now();
                        terminal::set_message(
                            &bar,
                            &format!("{doing}, at first on {}", counted(workers, "worker")),
                        );
                    }
                    Ok(Event::Finished { id, seconds }) => {
                        told.finished += 1;
                        told.usage.jobs += 1;
                        told.usage.busy_s += seconds;
                        told.usage.seconds = start.elapsed().as_secs_f64();
                        bar.inc(1);
                        if let Some(job) = by_id.get(id.as_str()) {
                            bar.suspend(|| (batch.finished)(job));
                        }
                    }
                    Ok(Event::Failed { id, reason }) => {
                        bar.inc(1);
                        told.failed.insert(id, reason);
                    }
                    Ok(Event::Refused { worker, reason }) => {
                        bar.suspend(|| eprintln!("warning: worker {worker} is not used: it {reason}"));
                    }
                    Ok(Event::Stopped { reason }) => told.stopped = Some(reason),
                    // Output of a library.
                    Err(_) => {}
                },
            }
            if interrupt::stop().is_requested() {
                break;
            }
        }
        drop(watching);
        bar.finish_and_clear();
        told
    }
}

/// The Python that has loaded this program, if Dask is installed there: `whitstone[cluster]`.
fn own_python() -> Option<PathBuf> {
    let python = jobs::own_python()?;
    let has_dask = Command::new(&python)
        .args(["-c", "import distributed"])
        .stdin(Stdio::null())
        .stderr(Stdio::null())
        .status()
        .is_ok_and(|status| status.success());
    has_dask.then_some(python)
}

/// Writes the script and its requirements to the folder of the drivers; returns their paths.
fn unpack(installation: &Installation) -> Result<(PathBuf, PathBuf), Failure> {
    let hash = blake3::hash([SCRIPT, REQUIREMENTS].concat().as_bytes()).to_hex();
    let folder = installation.folder.join(format!("cluster-{}", &hash[..12]));
    terminal::make_folder(&folder)?;
    let place = |name: &str, text: &str| {
        let path = folder.join(name);
        if fs::read(&path).is_ok_and(|bytes| bytes == text.as_bytes()) {
            return Ok(path);
        }
        atomic::write_bytes(&path, text.as_bytes()).map_err(Failure::environment)?;
        Ok(path)
    };
    Ok((
        place("cluster.py", SCRIPT)?,
        place("requirements.txt", REQUIREMENTS)?,
    ))
}
