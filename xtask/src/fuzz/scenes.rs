//! `fuzz scenes`: random scenes, whose image must not depend on the accelerator, the number of
//! threads or the vector instructions.
//!
//! The instructions are chosen once in a process, so each set has its own: a worker. It reads
//! numbers of scenes and prints a line for each. A group of workers, one for each set, renders the
//! same scenes; there are as many groups as keep the cores busy.

use super::random_scene::Generator;
use std::collections::{BTreeMap, VecDeque};
use std::fs;
use std::hash::{DefaultHasher, Hash, Hasher};
use std::io::{BufRead, BufReader, Write};
use std::path::Path;
use std::process::{Child, ChildStdin, Command, Stdio};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, channel};
use std::thread;
use std::time::{Duration, Instant};
use toml::Table;
use whitstone::core::{FamilyName, Registry};
use whitstone::render::{BuildOptions, Film, Pipeline, RenderOptions};
use whitstone::scene::{Sources, scene_schema};
use whitstone::{Exit, Failure};
use whitstone_testkit::Random;

/// The values of `WHITSTONE_SIMD` of the workers. The first one also varies accelerator and
/// threads.
const LEVELS: [&str; 3] = ["avx512", "avx2", "baseline"];
/// Accelerators that each scene is rendered with, beside its own.
const OTHERS: usize = 3;
/// Memory that a scene may take, in bytes.
const MEMORY: u64 = 256 << 20;
/// Rays that a sample may become.
const TREE_RAYS: u32 = 1 << 12;
/// Pairs of a ray and an element that are all tested.
const MOST_TESTS: u64 = 10_000_000;
/// Samples of an image; scenes of more are not rendered.
const MOST_SAMPLES: u64 = 5_000;
/// A scene must be answered within this time plus [`PER_RAY`] for each of its rays. Without an
/// accelerator it may take longer.
const LIMIT: Duration = Duration::from_secs(10);
/// Time of a ray that hits a fractal, or a repeated field of 768 long shapes that overlap, on a
/// loaded machine.
const PER_RAY: Duration = Duration::from_millis(20);
/// Time after which a worker is given up.
const PATIENCE: Duration = Duration::from_secs(300);
/// Scenes that a worker has been asked for at a time. The workers that render a scene once are
/// ahead of the one that varies it by no more.
const WINDOW: usize = 8;
/// The folder that paths of the scenes are relative to.
const BASE: &str = "scenes";
const FINDINGS: &str = "target/fuzz/findings/scenes";
/// More are not looked for in one run.
const ENOUGH: usize = 20;

/// What became of a scene.
enum Answer {
    /// Hash of its image.
    Image(u64),
    /// With the first error.
    Refused(String),
    Finding(String),
}

impl Answer {
    fn line(&self) -> String {
        match self {
            Self::Image(hash) => format!("image {hash:016x}"),
            Self::Refused(text) => format!("refused {}", text.replace('\n', " ")),
            Self::Finding(text) => format!("finding {}", text.replace('\n', " ")),
        }
    }
}

/// The scene of this number, as TOML. Most are valid: one in four is left as it comes.
fn text(schema: &serde_json::Value, number: u64, registry: &Registry) -> Result<String, String> {
    let is_valid = |scene: &Table| {
        number.is_multiple_of(4)
            || toml::to_string(scene).is_ok_and(|text| matches!(build(&text, &[], registry), Ok(Ok(_))))
    };
    let scene = Generator::new(schema, number)?.scene(&is_valid);
    toml::to_string(&scene).map_err(|error| error.to_string())
}

/// The scene of this number, as TOML, if it is valid, and if single precision holds its numbers.
pub(super) fn valid(
    schema: &serde_json::Value,
    number: u64,
    registry: &Registry,
) -> Result<Option<String>, String> {
    if Generator::new(schema, number)?.is_extreme() {
        return Ok(None);
    }
    let text = text(schema, number, registry)?;
    let is_valid = build(&text, &[], registry)?.is_ok_and(|pipeline| samples(&pipeline) <= MOST_SAMPLES);
    Ok(is_valid.then_some(text))
}

/// The scene for a file four folders below the root: its paths lead to the folder `scenes`.
pub(super) fn relocated(text: &str) -> String {
    text.replace("\"assets/", "\"../../../../scenes/assets/")
}

/// The number of samples of the image, those of a lens included.
fn samples(pipeline: &Pipeline) -> u64 {
    let size = pipeline.film.size;
    u64::from(size.width) * u64::from(size.height) * u64::from(pipeline.samples())
}

/// Renders the scenes whose numbers it reads, and prints what became of each.
pub(super) fn work(registry: &Registry) -> Result<Exit, Failure> {
    let schema = scene_schema(registry);
    let vary = std::env::var("WHITSTONE_SIMD").as_deref() == Ok(LEVELS[0]);
    let mut out = std::io::stdout().lock();
    for line in std::io::stdin().lock().lines().map_while(Result::ok) {
        let number = line.parse().map_err(Failure::environment)?;
        let text = text(&schema, number, registry).map_err(Failure::environment)?;
        let answer = answer(&text, number, vary, registry);
        if writeln!(out, "{}", answer.line())
            .and_then(|()| out.flush())
            .is_err()
        {
            // Nobody reads any more.
            break;
        }
    }
    Ok(Exit::Pass)
}

/// Renders a scene, if it is valid, in as many ways as `vary` says.
fn answer(text: &str, number: u64, vary: bool, registry: &Registry) -> Answer {
    let start = Instant::now();
    let mut work = Work::default();
    let found = image(text, &[], 1, registry, &mut work);
    let rays = u32::try_from(work.rays).unwrap_or(u32::MAX);
    if start.elapsed() > LIMIT + PER_RAY * rays {
        return Answer::Finding(format!("takes {:.0} s", start.elapsed().as_secs_f64()));
    }
    let first = match found {
        Ok(Ok(first)) => first,
        Ok(Err(error)) => return Answer::Refused(error),
        Err(problem) => return Answer::Finding(problem),
    };
    // A scene this slow is rendered once, so that the worker stays within [`PATIENCE`].
    if vary && start.elapsed() < LIMIT {
        let threads = [(Vec::new(), 3)];
        let others = accelerators(number, work.tests < MOST_TESTS, registry).into_iter();
        let others = others.map(|name| (vec![format!("accelerator={{type=\"{name}\"}}")], 1));
        for (changes, threads) in threads.into_iter().chain(others) {
            let with = || format!("{} and {threads} threads", changes.join(""));
            match image(text, &changes, threads, registry, &mut work) {
                Ok(Ok(image)) if image == first => {}
                Ok(Ok(_)) => return Answer::Finding(format!("another image with {}", with())),
                Ok(Err(error)) => return Answer::Finding(format!("refused with {}: {error}", with())),
                Err(problem) => return Answer::Finding(format!("{problem}, with {}", with())),
            }
        }
    }
    Answer::Image(first)
}

/// Some accelerators, among them the one that tests everything, if that is not too slow.
fn accelerators(number: u64, brute_force: bool, registry: &Registry) -> Vec<&'static str> {
    let mut names: Vec<&str> = registry
        .entries()
        .filter(|entry| entry.family == FamilyName::Accelerator && entry.name != "brute_force")
        .map(|entry| entry.name)
        .collect();
    let mut random = Random::new(!number);
    let mut chosen = if brute_force {
        vec!["brute_force"]
    } else {
        Vec::new()
    };
    while chosen.len() < OTHERS && !names.is_empty() {
        chosen.push(names.swap_remove(random.below(names.len())));
    }
    chosen
}

/// A scene that is built, or the error with which it is refused. The outer error is a finding.
fn build(text: &str, changes: &[String], registry: &Registry) -> Result<Result<Pipeline, String>, String> {
    let options = BuildOptions {
        max_memory: Some(MEMORY),
        max_tree_rays: Some(TREE_RAYS),
        ..BuildOptions::default()
    };
    let sources = Sources::from_text("scene.toml", text, Path::new(BASE), changes)
        .map_err(|error| format!("no TOML: {}", error.sources.report(&error.errors, false)))?;
    let errors = match Pipeline::load(&sources, registry, options) {
        Ok(pipeline) => return Ok(Ok(pipeline)),
        Err(errors) => errors.0,
    };
    match errors.into_iter().map(|error| error.message).next() {
        None => Err("refused without an error".to_owned()),
        Some(message) if message.is_empty() => Err("an error without a message".to_owned()),
        Some(message) => Ok(Err(message)),
    }
}

/// What a rendering took.
#[derive(Default)]
struct Work {
    rays: u64,
    /// Pairs of a ray and an element.
    tests: u64,
}

/// Hash of the image of a scene, or the error with which it is refused. The outer error is a
/// finding.
fn image(
    text: &str,
    changes: &[String],
    threads: usize,
    registry: &Registry,
    work: &mut Work,
) -> Result<Result<u64, String>, String> {
    let pipeline = match build(text, changes, registry)? {
        Ok(pipeline) => pipeline,
        Err(error) => return Ok(Err(error)),
    };
    if samples(&pipeline) > MOST_SAMPLES {
        return Ok(Err("too many samples".to_owned()));
    }
    let film = pipeline.render(RenderOptions {
        threads,
        ..RenderOptions::default()
    });
    let groups = pipeline.groups.iter().map(|built| built.group.geometry());
    let geometries = std::iter::once(&pipeline.scene.geometry).chain(groups);
    let elements: usize = geometries.map(|geometry| geometry.elements().count()).sum();
    work.rays = film.counters.total();
    work.tests = work.rays * elements as u64;
    // The place of the first tree that is too large depends on the threads.
    Ok(match film.check() {
        Ok(()) => Ok(hash(&film)),
        Err(_) => Err("the ray tree of a sample is too large".to_owned()),
    })
}

fn hash(film: &Film) -> u64 {
    let layers = film.layers.iter().flat_map(|(_, values)| values);
    let values = film.rgb.as_flattened().iter().chain(layers);
    let mut hasher = DefaultHasher::new();
    for value in values {
        value.to_bits().hash(&mut hasher);
    }
    hasher.finish()
}

/// A process that renders scenes.
struct Worker {
    level: &'static str,
    child: Child,
    numbers: Option<ChildStdin>,
    lines: Receiver<String>,
}

impl Worker {
    fn start(level: &'static str) -> Result<Self, Failure> {
        let program = std::env::current_exe().map_err(Failure::environment)?;
        let mut child = Command::new(program)
            .args(["fuzz", "--worker"])
            .env("WHITSTONE_SIMD", level)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .map_err(Failure::environment)?;
        let (sender, lines) = channel();
        if let Some(pipe) = child.stdout.take() {
            // Ends with the pipe.
            thread::spawn(move || {
                for line in BufReader::new(pipe).lines().map_while(Result::ok) {
                    if sender.send(line).is_err() {
                        break;
                    }
                }
            });
        }
        let numbers = child.stdin.take();
        Ok(Self {
            level,
            child,
            numbers,
            lines,
        })
    }

    /// Asks for a scene. A process that has ended is noticed when its answer is read.
    fn ask(&mut self, number: u64) {
        if let Some(pipe) = &mut self.numbers {
            let _ = writeln!(pipe, "{number}");
        }
    }

    /// The line of the scene that was asked for first, or what went wrong instead.
    fn next(&self) -> Result<String, String> {
        self.lines.recv_timeout(PATIENCE).map_err(|error| match error {
            RecvTimeoutError::Timeout => "no answer".to_owned(),
            RecvTimeoutError::Disconnected => "the process ended".to_owned(),
        })
    }
}

impl Drop for Worker {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// What came of the scenes of some workers.
#[derive(Default)]
struct Outcome {
    scenes: u64,
    valid: u64,
    findings: BTreeMap<u64, String>,
}

/// Has one group of workers render scenes until a time.
fn examine(next: &AtomicU64, end: Instant) -> Result<Outcome, Failure> {
    let start_all = || -> Result<Vec<Worker>, Failure> { LEVELS.into_iter().map(Worker::start).collect() };
    let mut workers = start_all()?;
    let mut outcome = Outcome::default();
    let mut asked = VecDeque::new();
    loop {
        while asked.len() < WINDOW && Instant::now() < end && outcome.findings.len() < ENOUGH {
            let number = next.fetch_add(1, Ordering::Relaxed);
            workers.iter_mut().for_each(|worker| worker.ask(number));
            asked.push_back(number);
        }
        let Some(number) = asked.pop_front() else {
            return Ok(outcome);
        };
        let lines: Vec<Result<String, String>> = workers.iter().map(Worker::next).collect();
        let each = || lines.iter().zip(&workers);
        let told = each().find_map(|(line, Worker { level, .. })| match line {
            Err(problem) => Some(format!("{problem}, with WHITSTONE_SIMD={level}")),
            Ok(line) => line
                .strip_prefix("finding ")
                .map(|text| format!("{text}, with WHITSTONE_SIMD={level}")),
        });
        let differs = || {
            let other = each().find(|(line, _)| **line != lines[0]);
            other.map(|(_, Worker { level, .. })| format!("another image with WHITSTONE_SIMD={level}"))
        };
        outcome.scenes += 1;
        if let Some(finding) = told.or_else(differs) {
            outcome.findings.insert(number, finding);
        } else if lines[0].as_ref().is_ok_and(|line| !line.starts_with("refused")) {
            outcome.valid += 1;
        }
        if lines.iter().any(Result::is_err) {
            workers = start_all()?;
            for number in &asked {
                workers.iter_mut().for_each(|worker| worker.ask(*number));
            }
        }
    }
}

/// Renders random scenes for some time; returns the number of findings.
pub(super) fn run(first: u64, seconds: u64, registry: &Registry) -> Result<usize, Failure> {
    let end = Instant::now() + Duration::from_secs(seconds);
    let next = AtomicU64::new(first);
    // A group keeps about 1.7 cores busy: one worker varies each scene, two render it once.
    let cores = thread::available_parallelism().map_or(1, usize::from);
    let groups = (cores * 3 / 5).max(1);
    let outcomes: Vec<Result<Outcome, Failure>> = thread::scope(|scope| {
        let groups: Vec<_> = (0..groups).map(|_| scope.spawn(|| examine(&next, end))).collect();
        groups
            .into_iter()
            .map(|group| {
                group
                    .join()
                    .unwrap_or_else(|panic| std::panic::resume_unwind(panic))
            })
            .collect()
    });
    let mut all = Outcome::default();
    for outcome in outcomes {
        let outcome = outcome?;
        all.scenes += outcome.scenes;
        all.valid += outcome.valid;
        all.findings.extend(outcome.findings);
    }
    println!(
        "scenes {:>9} random scenes, of which {} are valid, from number {first}; findings: {}",
        all.scenes,
        all.valid,
        all.findings.len()
    );
    let schema = scene_schema(registry);
    for (number, finding) in &all.findings {
        let file = Path::new(FINDINGS).join(format!("{number}.toml"));
        let text = text(&schema, *number, registry).map_err(Failure::environment)?;
        fs::create_dir_all(FINDINGS).map_err(Failure::environment)?;
        fs::write(&file, relocated(&text)).map_err(Failure::environment)?;
        println!("{}: {finding}", file.display());
    }
    Ok(all.findings.len())
}
