//! `fuzz scenes`: random scenes, whose image must not depend on the accelerator, the number of
//! threads or the vector instructions.
//!
//! The instructions are chosen once in a process, so each set has its own: a worker. Another worker
//! makes the scenes. Each reads a line for each scene and prints one. A group of workers renders
//! the same scenes; there are as many groups as cores.

use super::Run;
use super::random_scene::Generator;
use crate::bench::machine::processor_time;
use clap::ValueEnum;
use serde_json::Value as Json;
use std::collections::{BTreeMap, VecDeque};
use std::fs;
use std::hash::{DefaultHasher, Hash, Hasher};
use std::io::{BufRead, BufReader, Write};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, TryRecvError, channel};
use std::thread;
use std::time::{Duration, Instant};
use toml::Table;
use whitstone::core::{FamilyName, Registry};
use whitstone::render::{BuildOptions, Film, Pipeline, RenderOptions, Shared};
use whitstone::scene::{Sources, scene_schema};
use whitstone::{Exit, Failure};

/// The values of `WHITSTONE_SIMD` of the workers. The first one also varies accelerator and
/// threads.
const LEVELS: [&str; 3] = ["avx512", "avx2", "baseline"];
/// Memory that a scene may take, in bytes.
const MEMORY: u64 = 256 << 20;
/// Rays that a sample may become.
const TREE_RAYS: u32 = 1 << 12;
/// Pairs of a ray and an element that are all tested: a tenth of a second. A fractal takes
/// milliseconds a test.
const MOST_TESTS: u64 = 1_000_000;
/// Samples of an image; scenes of more are not rendered.
const MOST_SAMPLES: u64 = 5_000;
/// A scene must be answered within this processor time plus [`PER_RAY`] for each of its rays.
/// Without an accelerator it may take longer.
const LIMIT: Duration = Duration::from_secs(10);
/// Time of a ray that hits a fractal, or a repeated field of 768 long shapes that overlap, with
/// much to spare.
const PER_RAY: Duration = Duration::from_millis(20);
/// A scene that takes longer is rendered once: a dozen times would take the time of a thousand
/// other scenes.
const VARIED: Duration = Duration::from_millis(500);
/// Time of the clock after which a worker is given up.
const PATIENCE: Duration = Duration::from_secs(1200);
/// Scenes that wait for a worker at a time: no worker is ahead of another by more.
const WINDOW: usize = 8;
/// The folder that paths of the scenes are relative to.
const BASE: &str = "scenes";
const FRACTAL: &str = "type = \"fractal\"";
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

/// Makes and renders scenes.
pub(super) struct Scenes<'a> {
    registry: &'a Registry,
    schema: Json,
    /// Contents of the few files that scenes refer to.
    files: Shared,
}

impl<'a> Scenes<'a> {
    pub(super) fn new(registry: &'a Registry) -> Self {
        Self {
            registry,
            schema: scene_schema(registry),
            files: Shared::default(),
        }
    }

    /// The scene of this number, as TOML. Most are valid: one in four is left as it comes.
    fn text(&self, number: u64) -> Result<String, String> {
        let is_valid = |scene: &Table| {
            number.is_multiple_of(4)
                || toml::to_string(scene).is_ok_and(|text| matches!(self.build(&text, &[]), Ok(Ok(_))))
        };
        let scene = Generator::new(&self.schema, number)?.scene(&is_valid);
        toml::to_string(&scene).map_err(|error| error.to_string())
    }

    /// The scene of this number, as TOML, if it is valid, and if single precision holds its
    /// numbers.
    pub(super) fn valid(&self, number: u64) -> Result<Option<String>, String> {
        if Generator::new(&self.schema, number)?.is_extreme() {
            return Ok(None);
        }
        let text = self.text(number)?;
        let built = self.build(&text, &[])?;
        let is_valid = built.is_ok_and(|pipeline| samples(&pipeline) <= MOST_SAMPLES);
        Ok(is_valid.then_some(text))
    }

    /// A scene that is built, or the error with which it is refused. The outer error is a finding.
    fn build(&self, text: &str, changes: &[String]) -> Result<Result<Pipeline, String>, String> {
        let options = BuildOptions {
            max_memory: Some(MEMORY),
            max_tree_rays: Some(TREE_RAYS),
            shared: Some(&self.files),
            ..BuildOptions::default()
        };
        let sources = Sources::from_text("scene.toml", text, Path::new(BASE), changes)
            .map_err(|error| format!("no TOML: {}", error.sources.report(&error.errors, false)))?;
        let errors = match Pipeline::load(&sources, self.registry, options) {
            Ok(pipeline) => return Ok(Ok(pipeline)),
            Err(errors) => errors.0,
        };
        match errors.into_iter().map(|error| error.message).next() {
            None => Err("refused without an error".to_owned()),
            Some(message) if message.is_empty() => Err("an error without a message".to_owned()),
            Some(message) => Ok(Err(message)),
        }
    }

    /// Renders a scene, if it is valid, in as many ways as `vary` says.
    fn answer(&self, text: &str, vary: bool, work: &mut Work) -> Answer {
        // Of the processor, so that a loaded machine makes no finding.
        let start = processor_time();
        let elapsed = || Duration::from_secs_f64((processor_time() - start).max(0.0));
        let pipeline = match self.build(text, &[]) {
            Ok(Ok(pipeline)) => pipeline,
            Ok(Err(error)) => return Answer::Refused(error),
            Err(problem) => return Answer::Finding(problem),
        };
        if samples(&pipeline) > MOST_SAMPLES {
            return Answer::Refused("too many samples".to_owned());
        }
        let first = render(&pipeline, 1, work);
        let rays = u32::try_from(work.rays).unwrap_or(u32::MAX);
        if elapsed() > LIMIT + PER_RAY * rays {
            return Answer::Finding(format!("takes {:.0} s", elapsed().as_secs_f64()));
        }
        let first = match first {
            Ok(first) => first,
            Err(error) => return Answer::Refused(error),
        };
        if !vary || elapsed() > VARIED {
            return Answer::Image(first);
        }
        let compare = |image: Result<u64, String>, with: &str| match image {
            Ok(image) if image == first => None,
            Ok(_) => Some(format!("another image with {with}")),
            Err(error) => Some(format!("refused with {with}: {error}")),
        };
        let threads = compare(render(&pipeline, 3, work), "3 threads");
        drop(pipeline);
        let brute_force = work.tests < MOST_TESTS && !text.contains(FRACTAL);
        let accelerators = (self.registry.entries())
            .filter(|entry| entry.family == FamilyName::Accelerator)
            .map(|entry| entry.name)
            .filter(|name| brute_force || *name != "brute_force");
        let mut others = accelerators.filter_map(|name| {
            let change = format!("accelerator={{type=\"{name}\"}}");
            match self.build(text, std::slice::from_ref(&change)) {
                Ok(Ok(pipeline)) => compare(render(&pipeline, 1, work), &change),
                Ok(Err(error)) => compare(Err(error), &change),
                Err(problem) => Some(format!("{problem}, with {change}")),
            }
        });
        match threads.or_else(|| others.next()) {
            Some(finding) => Answer::Finding(finding),
            None => Answer::Image(first),
        }
    }
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

/// What a worker does.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(super) enum Role {
    /// Reads numbers, and prints the scenes as JSON strings.
    Generate,
    /// Reads such strings, and prints what became of each.
    Render,
    /// The same, and varies accelerator and threads.
    Vary,
}

/// Does the work of a worker.
pub(super) fn work(role: Role, registry: &Registry) -> Result<Exit, Failure> {
    let scenes = Scenes::new(registry);
    let mut out = std::io::stdout().lock();
    for line in std::io::stdin().lock().lines().map_while(Result::ok) {
        let line = match role {
            Role::Generate => {
                let number = line.parse().map_err(Failure::environment)?;
                Json::from(scenes.text(number).map_err(Failure::environment)?).to_string()
            }
            Role::Render | Role::Vary => {
                let text: String = serde_json::from_str(&line).map_err(Failure::environment)?;
                let mut work = Work::default();
                let answer = scenes.answer(&text, role == Role::Vary, &mut work);
                // A scene that is refused is an execution too.
                format!("{} {}", work.images.max(1), answer.line())
            }
        };
        if writeln!(out, "{line}").and_then(|()| out.flush()).is_err() {
            // Nobody reads any more.
            break;
        }
    }
    Ok(Exit::Pass)
}

/// What a rendering took.
#[derive(Default)]
struct Work {
    images: u64,
    rays: u64,
    /// Pairs of a ray and an element.
    tests: u64,
}

/// Hash of the image of a scene, or the error with which it is refused.
fn render(pipeline: &Pipeline, threads: usize, work: &mut Work) -> Result<u64, String> {
    let film = pipeline.render(RenderOptions {
        threads,
        ..RenderOptions::default()
    });
    let groups = pipeline.groups.iter().map(|built| built.group.geometry());
    let geometries = std::iter::once(&pipeline.scene.geometry).chain(groups);
    let elements: usize = geometries.map(|geometry| geometry.elements().count()).sum();
    work.images += 1;
    work.rays = film.counters.total();
    work.tests = work.rays * elements as u64;
    // The place of the first tree that is too large depends on the threads.
    match film.check() {
        Ok(()) => Ok(hash(&film)),
        Err(_) => Err("the ray tree of a sample is too large".to_owned()),
    }
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

/// A process that makes or renders scenes.
struct Worker {
    /// What it is, for a message.
    name: String,
    child: Child,
    /// Written by a thread: a process that hangs does not read, and its pipe fills.
    requests: Sender<String>,
    lines: Receiver<String>,
}

impl Worker {
    /// `level` is the value of `WHITSTONE_SIMD`, if it is set.
    fn start(role: Role, level: Option<&str>) -> Result<Self, Failure> {
        let program = std::env::current_exe().map_err(Failure::environment)?;
        let role = role.to_possible_value();
        let role = role.as_ref().map_or("", |role| role.get_name());
        let mut child = Command::new(program)
            .args(["fuzz", "--worker", role])
            .envs(level.map(|level| ("WHITSTONE_SIMD", level)))
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .map_err(Failure::environment)?;
        let (sender, lines) = channel();
        if let Some(pipe) = child.stdout.take() {
            // Ends with the pipe.
            let read = move || {
                for line in BufReader::new(pipe).lines().map_while(Result::ok) {
                    if sender.send(line).is_err() {
                        break;
                    }
                }
            };
            thread::Builder::new().spawn(read).map_err(Failure::environment)?;
        }
        let (requests, waiting) = channel::<String>();
        if let Some(mut pipe) = child.stdin.take() {
            // Ends with the process, or with the last request.
            let write = move || {
                while let Ok(request) = waiting.recv() {
                    if writeln!(pipe, "{request}").is_err() {
                        break;
                    }
                }
            };
            thread::Builder::new()
                .spawn(write)
                .map_err(Failure::environment)?;
        }
        Ok(Self {
            name: level.map_or_else(|| role.to_owned(), |level| format!("WHITSTONE_SIMD={level}")),
            child,
            requests,
            lines,
        })
    }

    /// Asks for a scene. A process that has ended is noticed when its answer is read.
    fn ask(&self, request: String) {
        let _ = self.requests.send(request);
    }

    /// The line of the scene that was asked for first, or what went wrong instead.
    fn next(&self) -> Result<String, String> {
        self.lines.recv_timeout(PATIENCE).map_err(|error| match error {
            RecvTimeoutError::Timeout => format!("no answer, with {}", self.name),
            RecvTimeoutError::Disconnected => format!("the process ended, with {}", self.name),
        })
    }

    /// The answer of a renderer, behind the number of its executions.
    fn answer(&self) -> (u64, Result<String, String>) {
        match self.next() {
            Ok(line) => match line.split_once(' ').map(|(images, rest)| (images.parse(), rest)) {
                Some((Ok(images), rest)) => (images, Ok(rest.to_owned())),
                _ => (0, Err(format!("no number before the answer, with {}", self.name))),
            },
            Err(problem) => (0, Err(problem)),
        }
    }

    /// As [`Self::next`], or none if it would have to wait.
    fn poll(&self) -> Option<Result<String, String>> {
        match self.lines.try_recv() {
            Ok(line) => Some(Ok(line)),
            Err(TryRecvError::Empty) => None,
            Err(TryRecvError::Disconnected) => Some(self.next()),
        }
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
    executions: u64,
    scenes: u64,
    valid: u64,
    /// By number, with the scene as a JSON string, unless it could not be made.
    findings: BTreeMap<u64, (String, Option<String>)>,
}

/// Workers of all kinds, and the scenes that they have.
struct Group {
    generator: Worker,
    renderers: Vec<Worker>,
    /// Numbers of the scenes that are being made.
    made: VecDeque<u64>,
    /// The scenes that are being rendered: a number and a JSON string.
    rendered: VecDeque<(u64, String)>,
    outcome: Outcome,
}

impl Group {
    fn start() -> Result<Self, Failure> {
        Ok(Self {
            generator: Worker::start(Role::Generate, None)?,
            renderers: renderers()?,
            made: VecDeque::new(),
            rendered: VecDeque::new(),
            outcome: Outcome::default(),
        })
    }

    /// Makes and renders scenes until a time.
    fn examine(mut self, next: &AtomicU64, end: Instant) -> Result<Outcome, Failure> {
        loop {
            while self.made.len() < WINDOW && Instant::now() < end && self.outcome.findings.len() < ENOUGH {
                let number = next.fetch_add(1, Ordering::Relaxed);
                self.generator.ask(number.to_string());
                self.made.push_back(number);
            }
            self.pass_on()?;
            let Some((number, scene)) = self.rendered.pop_front() else {
                if self.made.is_empty() {
                    return Ok(self.outcome);
                }
                continue;
            };
            let answers = self.renderers.iter().map(Worker::answer);
            let (images, lines): (Vec<u64>, Vec<Result<String, String>>) = answers.unzip();
            self.outcome.executions += images.iter().sum::<u64>();
            let valid = lines[0].as_ref().is_ok_and(|line| !line.starts_with("refused"));
            self.outcome.scenes += 1;
            match finding(&self.renderers, &lines) {
                Some(finding) => {
                    self.outcome.findings.insert(number, (finding, Some(scene)));
                }
                None => self.outcome.valid += u64::from(valid),
            }
            if lines.iter().any(Result::is_err) {
                self.renderers = renderers()?;
                for (_, scene) in &self.rendered {
                    ask_all(&self.renderers, scene);
                }
            }
        }
    }

    /// Gives finished scenes to the renderers. Waits only if they have nothing else to do.
    fn pass_on(&mut self) -> Result<(), Failure> {
        while self.rendered.len() < WINDOW
            && let Some(number) = self.made.front().copied()
        {
            let made = match self.rendered.is_empty() {
                true => self.generator.next(),
                false => match self.generator.poll() {
                    Some(made) => made,
                    None => break,
                },
            };
            self.made.pop_front();
            match made {
                Ok(scene) => {
                    ask_all(&self.renderers, &scene);
                    self.rendered.push_back((number, scene));
                }
                Err(problem) => {
                    self.outcome.scenes += 1;
                    self.outcome.findings.insert(number, (problem, None));
                    self.generator = Worker::start(Role::Generate, None)?;
                    for number in &self.made {
                        self.generator.ask(number.to_string());
                    }
                }
            }
        }
        Ok(())
    }
}

/// Starts a renderer for each set of vector instructions.
fn renderers() -> Result<Vec<Worker>, Failure> {
    let roles = [Role::Vary, Role::Render, Role::Render];
    let both = roles.into_iter().zip(LEVELS);
    both.map(|(role, level)| Worker::start(role, Some(level)))
        .collect()
}

fn ask_all(workers: &[Worker], scene: &str) {
    for worker in workers {
        worker.ask(scene.to_owned());
    }
}

/// What is wrong with the answers of the renderers to one scene.
fn finding(renderers: &[Worker], lines: &[Result<String, String>]) -> Option<String> {
    let each = || lines.iter().zip(renderers);
    let told = each().find_map(|(line, worker)| match line {
        Err(problem) => Some(problem.clone()),
        Ok(line) => line
            .strip_prefix("finding ")
            .map(|text| format!("{text}, with {}", worker.name)),
    });
    told.or_else(|| {
        let other = each().find(|(line, _)| **line != lines[0]);
        other.map(|(_, worker)| format!("another image with {}", worker.name))
    })
}

/// Renders random scenes for some time, beginning with a number.
pub(super) fn run(first: u64, seconds: u64) -> Result<Run, Failure> {
    let end = Instant::now() + Duration::from_secs(seconds);
    let next = AtomicU64::new(first);
    // In a group, the renderer that varies takes three quarters of the time.
    let groups = thread::available_parallelism().map_or(1, usize::from);
    let outcomes: Vec<Result<Outcome, Failure>> = thread::scope(|scope| {
        let examine = || Group::start().and_then(|group| group.examine(&next, end));
        let groups: Vec<_> = (0..groups)
            .map(|_| thread::Builder::new().spawn_scoped(scope, examine))
            .collect();
        groups
            .into_iter()
            .map(|group| {
                let group = group.map_err(Failure::environment)?;
                group
                    .join()
                    .unwrap_or_else(|panic| std::panic::resume_unwind(panic))
            })
            .collect()
    });
    let mut all = Outcome::default();
    for outcome in outcomes {
        let outcome = outcome?;
        all.executions += outcome.executions;
        all.scenes += outcome.scenes;
        all.valid += outcome.valid;
        all.findings.extend(outcome.findings);
    }
    println!(
        "scenes {:>9} executions of {} random scenes, of which {} are valid, from number {first}; \
         findings: {}",
        all.executions,
        all.scenes,
        all.valid,
        all.findings.len()
    );
    for (number, (finding, scene)) in &all.findings {
        let Some(scene) = scene else {
            println!("number {number}: {finding}");
            continue;
        };
        let file = Path::new(FINDINGS).join(format!("{number}.toml"));
        let text: String = serde_json::from_str(scene).map_err(Failure::environment)?;
        fs::create_dir_all(FINDINGS).map_err(Failure::environment)?;
        fs::write(&file, relocated(&text)).map_err(Failure::environment)?;
        println!("{}: {finding}", file.display());
    }
    Ok(Run {
        executions: all.executions,
        scenes: Some(all.scenes),
        valid: Some(all.valid),
        findings: all.findings.len(),
        next: Some(next.into_inner()),
    })
}
