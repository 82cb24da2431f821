//! The driver of a reference as a child process: requests and answers of
//! `references/mitsuba/PROTOCOL.md`.

use crate::environment::Environment;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};
use std::collections::VecDeque;
use std::ffi::OsStr;
use std::io::{BufRead, BufReader, Read, Write};
use std::path::Path;
use std::process::{Child, ChildStdin, Command, ExitStatus, Stdio};
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel, sync_channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::{self, JoinHandle};
use std::time::Duration;
use thiserror::Error;

/// Longest answer that is taken, in bytes. The longest proper ones, of `probe`, stay far below.
const MAX_ANSWER: u64 = 256 << 20;
/// Longest line of standard error that is taken as one, in bytes.
const MAX_STDERR_LINE: u64 = 4096;
/// How much of the end of standard error is kept for messages.
const STDERR_LINES: usize = 40;

/// Why the driver gave no answer, or not a good one.
#[derive(Debug, Error)]
pub enum DriverError {
    /// The process could not be started or written to.
    #[error("cannot run the driver of the reference: {0}")]
    Io(#[from] std::io::Error),
    /// The process ended instead of answering.
    #[error("the driver of the reference ended ({status}){stderr}")]
    Exited {
        /// How it ended.
        status: String,
        /// The end of what it wrote to standard error, on lines of its own.
        stderr: String,
    },
    /// No answer within the time limit; the process and its children were killed.
    #[error(
        "the driver of the reference gave no answer to `{op}` within {seconds} s and was stopped{stderr}"
    )]
    TimedOut {
        /// What it was asked.
        op: String,
        /// The limit.
        seconds: u64,
        /// As above.
        stderr: String,
    },
    /// What it wrote is no answer.
    #[error("the driver of the reference gave an answer to `{op}` that cannot be understood: {problem}")]
    BadAnswer {
        /// What it was asked.
        op: String,
        /// What is wrong with it.
        problem: String,
    },
    /// The reference has no twin of something in the scene: a problem a line, each led by its place
    /// in the document.
    #[error("no twin in the reference: {0}")]
    Unsupported(String),
    /// It answered that it cannot.
    #[error("the driver of the reference says: {0}")]
    Refused(String),
}

/// A running driver. It is killed, with its children, when dropped.
pub struct Driver {
    child: Child,
    /// Lines for standard input. They are written by a thread: a driver that does not read would
    /// hold up whoever writes more than fits into the pipe.
    requests: Sender<String>,
    answers: Receiver<std::io::Result<String>>,
    stderr: Arc<Mutex<VecDeque<String>>>,
    stderr_reader: JoinHandle<()>,
    limit: Duration,
}

/// How the reference is to trace: see the protocol.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Setting {
    /// Spawn offset in units of 2^-24 (1 + max |p|).
    pub k: f64,
    /// Embree's robust intersections.
    pub robust: bool,
    /// Shift of the sample positions in pixels, to the right.
    pub dx: f64,
    /// Downwards.
    pub dy: f64,
    /// Perturbation of every ray, in units of 2^-24.
    pub ulps: f64,
    /// Of the perturbation and of the rounding of vertices.
    pub seed: u32,
    /// Whether the numbers of meshes are rounded to single precision at random, not to the nearest.
    pub vertices: bool,
    /// Whether a perturbation is in units of the largest component of its vector, not of each.
    /// Mitsuba only.
    #[serde(skip_serializing_if = "is_false")]
    pub largest: bool,
    /// Factor on all light, divided out of the image again. POV-Ray only: its images have half
    /// precision.
    #[serde(skip_serializing_if = "is_one")]
    pub exposure: f64,
}

#[expect(
    clippy::trivially_copy_pass_by_ref,
    reason = "serde calls it with a reference"
)]
fn is_one(number: &f64) -> bool {
    *number == 1.0
}

#[expect(
    clippy::trivially_copy_pass_by_ref,
    reason = "serde calls it with a reference"
)]
fn is_false(value: &bool) -> bool {
    !value
}

impl Default for Setting {
    fn default() -> Self {
        Self {
            k: 4.0,
            robust: true,
            dx: 0.0,
            dy: 0.0,
            ulps: 0.0,
            seed: 0,
            vertices: false,
            largest: false,
            exposure: 1.0,
        }
    }
}

/// Who traces on the other side.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct Hello {
    /// Version of Mitsuba.
    pub mitsuba: String,
    /// Version of Dr.Jit.
    pub drjit: String,
    /// Such as `llvm_ad_rgb`.
    pub variant: String,
    /// Version of Python.
    pub python: String,
    /// File name of the LLVM library.
    pub libllvm: String,
    /// Its version.
    pub llvm_version: String,
    /// Of the machine.
    pub cpu: String,
    /// Threads that it uses by default.
    pub threads: u32,
}

/// Who renders where the reference is POV-Ray.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct PovRay {
    /// Its version.
    pub povray: String,
    /// Version of the Python that drives it.
    pub python: String,
    /// Of the machine.
    pub cpu: String,
    /// Of the machine.
    pub threads: u32,
}

/// Who renders on the other side.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(untagged)]
pub enum Versions {
    /// Mitsuba.
    Mitsuba(Hello),
    /// POV-Ray.
    PovRay(PovRay),
}

/// A scene as the driver gets it.
#[derive(Clone, Copy)]
pub struct SceneText<'a> {
    /// The flattened TOML.
    pub text: &'a str,
    /// Folder that its files are relative to.
    pub base: &'a Path,
}

/// What a rendering by the driver was.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Rendered {
    /// Wall time.
    pub seconds: RenderedSeconds,
    /// Rays traced, where they are counted.
    #[serde(default)]
    pub rays: Rays,
    /// Of stock Mitsuba, its integrator.
    #[serde(default)]
    pub integrator: String,
    /// How independent the twin is: "native", "hosted" or "formula".
    pub twin: String,
    /// Plugins that are not native, with the reason.
    #[serde(default)]
    pub hosted: Value,
    /// Spawned rays that hit the surface they left.
    #[serde(default)]
    pub rehits: u64,
    /// Which surfaces coincide, if the driver says so.
    #[serde(default)]
    pub coincident: Vec<Coincident>,
    /// Samples a pixel.
    pub samples: u32,
    /// Bytes that the driver grew by, at its highest, where the system tells.
    #[serde(default)]
    pub memory: Option<u64>,
}

/// Two shapes that coincide, or why none were looked for: see `references/mitsuba/PROTOCOL.md`.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Coincident {
    /// Their places in the list of the scene.
    #[serde(default)]
    pub shapes: Vec<u32>,
    /// The width of the gap between them in metres; none if they are not drawn apart.
    #[serde(default)]
    pub gap: Option<f64>,
    /// Why surfaces were not compared.
    #[serde(default)]
    pub not_examined: Option<String>,
}

impl Coincident {
    /// A note, where rounding decides which surface the reference meets first.
    pub(crate) fn note(&self) -> Option<String> {
        match (&self.not_examined, &self.gap, &self.shapes[..]) {
            (Some(why), _, _) => Some(format!(
                "the reference has not looked for coincident surfaces: {why}"
            )),
            (None, None, [one, two]) => Some(format!(
                "the reference has not drawn apart the shapes {one} and {two}, which coincide"
            )),
            _ => None,
        }
    }
}

/// See [`Rendered`].
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub struct RenderedSeconds {
    /// Building the Mitsuba scene.
    pub load: f64,
    /// Tracing, kernel compilation included.
    pub trace: f64,
    /// Processor time of all threads, of both; 0 where the driver does not say.
    #[serde(default)]
    pub cpu: f64,
}

/// See [`Rendered`].
#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
pub struct Rays {
    /// Nearest-hit queries.
    pub closest: u64,
    /// Shadow rays.
    pub shadow: u64,
}

impl Driver {
    /// Starts the driver. `limit` is the time that one answer may take.
    pub fn start(environment: &Environment, limit: Duration) -> Result<Self, DriverError> {
        let mut command = Command::new(&environment.python);
        command
            .args(["-m", environment.renderer.package(), "serve"])
            .args(
                environment
                    .twins
                    .iter()
                    .flat_map(|twin| [OsStr::new("--twin"), twin.as_os_str()]),
            )
            .env("PYTHONPATH", &environment.package)
            .env("PYTHONDONTWRITEBYTECODE", "1")
            .env("PYTHONUNBUFFERED", "1")
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped());
        Self::spawn(command, limit)
    }

    /// Starts any program that speaks the protocol.
    pub fn spawn(mut command: Command, limit: Duration) -> Result<Self, DriverError> {
        command
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped());
        // A group of its own, so that what it starts can be killed with it.
        #[cfg(unix)]
        std::os::unix::process::CommandExt::process_group(&mut command, 0);
        let mut child = command.spawn()?;
        let (Some(stdin), Some(stdout), Some(stderr)) =
            (child.stdin.take(), child.stdout.take(), child.stderr.take())
        else {
            unreachable!("all three were asked to be pipes");
        };
        let (requests, lines) = channel::<String>();
        thread::spawn(move || write_lines(stdin, &lines));
        let (sender, answers) = sync_channel(1);
        thread::spawn(move || {
            let mut reader = BufReader::new(stdout);
            loop {
                let mut line = String::new();
                let read = reader.by_ref().take(MAX_ANSWER).read_line(&mut line);
                let ended = !matches!(read, Ok(count) if count > 0);
                if read.is_err() || !ended {
                    let answer = read.map(|_| line);
                    if sender.send(answer).is_err() {
                        break;
                    }
                }
                if ended {
                    break;
                }
            }
        });
        let tail = Arc::new(Mutex::new(VecDeque::new()));
        let kept = tail.clone();
        let stderr_reader = thread::spawn(move || {
            // Bytes, not text: whatever a library prints must not stop the reading.
            let mut reader = BufReader::new(stderr);
            let mut line = Vec::new();
            // A part of a line at a time: a line may have no end.
            while reader
                .by_ref()
                .take(MAX_STDERR_LINE)
                .read_until(b'\n', &mut line)
                .is_ok_and(|read| read > 0)
            {
                let text = String::from_utf8_lossy(&line);
                let text: String = text.trim_end().chars().take(500).collect();
                line.clear();
                let mut kept: std::sync::MutexGuard<'_, VecDeque<String>> =
                    kept.lock().unwrap_or_else(PoisonError::into_inner);
                if kept.len() == STDERR_LINES {
                    kept.pop_front();
                }
                kept.push_back(text);
            }
        });
        Ok(Self {
            child,
            requests,
            answers,
            stderr: tail,
            stderr_reader,
            limit,
        })
    }

    /// Asks and waits for the answer.
    pub fn request(&mut self, request: &Value) -> Result<Value, DriverError> {
        let op = request["op"].as_str().unwrap_or_default().to_owned();
        let mut line = request.to_string();
        line.push('\n');
        if self.requests.send(line).is_err() {
            return Err(self.exited());
        }
        let answer = match self.answers.recv_timeout(self.limit) {
            Ok(Ok(answer)) => answer,
            Ok(Err(error)) => {
                self.kill();
                return Err(DriverError::BadAnswer {
                    op,
                    problem: error.to_string(),
                });
            }
            Err(RecvTimeoutError::Disconnected) => return Err(self.exited()),
            Err(RecvTimeoutError::Timeout) => {
                self.kill();
                return Err(DriverError::TimedOut {
                    op,
                    seconds: self.limit.as_secs(),
                    stderr: self.stderr_tail(),
                });
            }
        };
        let bad = |problem: String| DriverError::BadAnswer {
            op: op.clone(),
            problem,
        };
        let answer: Value = serde_json::from_str(&answer).map_err(|error| bad(error.to_string()))?;
        let text = || answer["error"].as_str().unwrap_or("no reason given").to_owned();
        match (answer["ok"].as_bool(), answer["kind"].as_str()) {
            (Some(true), _) => Ok(answer),
            (Some(false), Some("unsupported")) => Err(DriverError::Unsupported(text())),
            (Some(false), _) => Err(DriverError::Refused(text())),
            (None, _) => Err(bad("it does not say whether it is ok".into())),
        }
    }

    fn ask<T: serde::de::DeserializeOwned>(&mut self, request: &Value) -> Result<T, DriverError> {
        let answer = self.request(request)?;
        serde_json::from_value(answer).map_err(|error| DriverError::BadAnswer {
            op: request["op"].as_str().unwrap_or_default().to_owned(),
            problem: error.to_string(),
        })
    }

    /// The number of its process.
    pub fn process(&self) -> u32 {
        self.child.id()
    }

    /// Versions, of a driver of Mitsuba.
    pub fn hello(&mut self) -> Result<Hello, DriverError> {
        self.ask(&json!({ "op": "hello" }))
    }

    /// Versions, of a driver of POV-Ray.
    pub fn hello_of_povray(&mut self) -> Result<PovRay, DriverError> {
        self.ask(&json!({ "op": "hello" }))
    }

    /// Renders a scene into an EXR file.
    pub fn render(
        &mut self,
        scene: SceneText<'_>,
        out: &Path,
        setting: Setting,
        threads: usize,
    ) -> Result<Rendered, DriverError> {
        self.image(
            &json!({
                "op": "render", "scene": scene.text, "base": scene.base, "out": out,
                "setting": setting, "threads": threads,
            }),
            out,
        )
    }

    /// Renders a scene by Mitsuba's own integrators, with so many samples of each camera ray.
    pub fn stock(
        &mut self,
        scene: SceneText<'_>,
        out: &Path,
        setting: Setting,
        repeats: u32,
    ) -> Result<Rendered, DriverError> {
        self.image(
            &json!({
                "op": "stock", "scene": scene.text, "base": scene.base, "out": out,
                "setting": setting, "repeats": repeats,
            }),
            out,
        )
    }

    fn image(&mut self, request: &Value, out: &Path) -> Result<Rendered, DriverError> {
        let rendered = self.ask(request)?;
        if out.is_file() {
            Ok(rendered)
        } else {
            Err(DriverError::BadAnswer {
                op: request["op"].as_str().unwrap_or_default().to_owned(),
                problem: format!("it wrote no image to {}", out.display()),
            })
        }
    }

    /// Values of some pixels under several settings: `[setting][pixel]`.
    pub fn probe(
        &mut self,
        scene: SceneText<'_>,
        pixels: &[[usize; 2]],
        settings: &[Setting],
    ) -> Result<Vec<Vec<[f64; 3]>>, DriverError> {
        #[derive(Deserialize)]
        struct Answer {
            values: Vec<Vec<[Number; 3]>>,
        }
        let answer: Answer = self.ask(&json!({
            "op": "probe", "scene": scene.text, "base": scene.base,
            "pixels": pixels, "settings": settings,
        }))?;
        let complete =
            answer.values.len() == settings.len() && answer.values.iter().all(|v| v.len() == pixels.len());
        if !complete {
            return Err(DriverError::BadAnswer {
                op: "probe".into(),
                problem: "wrong number of values".into(),
            });
        }
        let plain = |values: Vec<[Number; 3]>| values.into_iter().map(|v| v.map(|n| n.0)).collect();
        Ok(answer.values.into_iter().map(plain).collect())
    }

    /// The ray tree of a sample of a pixel.
    pub fn tree(
        &mut self,
        scene: SceneText<'_>,
        pixel: [usize; 2],
        sample: u32,
    ) -> Result<Vec<crate::tree::Node>, DriverError> {
        #[derive(Deserialize)]
        struct Answer {
            nodes: Vec<crate::tree::Node>,
        }
        let answer: Answer = self.ask(&json!({
            "op": "tree", "scene": scene.text, "base": scene.base, "pixel": pixel, "sample": sample,
        }))?;
        Ok(answer.nodes)
    }

    fn exited(&mut self) -> DriverError {
        // The pipe can close a moment before the process is gone.
        let mut status: Option<ExitStatus> = None;
        for _ in 0..50 {
            status = self.child.try_wait().ok().flatten();
            if status.is_some() {
                break;
            }
            thread::sleep(Duration::from_millis(20));
        }
        self.kill();
        DriverError::Exited {
            status: status.map_or_else(|| "it closed its output".to_owned(), |status| status.to_string()),
            stderr: self.stderr_tail(),
        }
    }

    /// The end of standard error. Called when the process is gone: what it wrote last may still be
    /// on its way through the pipe.
    fn stderr_tail(&self) -> String {
        for _ in 0..100 {
            if self.stderr_reader.is_finished() {
                break;
            }
            thread::sleep(Duration::from_millis(10));
        }
        let lines = self.stderr.lock().unwrap_or_else(PoisonError::into_inner);
        lines.iter().map(|line| format!("\n  | {line}")).collect()
    }

    fn kill(&mut self) {
        #[cfg(unix)]
        if let Some(group) = i32::try_from(self.child.id())
            .ok()
            .and_then(rustix::process::Pid::from_raw)
        {
            // Fails only where the group is gone already.
            let _ = rustix::process::kill_process_group(group, rustix::process::Signal::KILL);
        }
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

impl Drop for Driver {
    fn drop(&mut self) {
        self.kill();
    }
}

/// Writes the lines until there are no more or no one reads them; that the driver then gives no
/// answer is noticed where the answer is waited for.
fn write_lines(mut stdin: ChildStdin, lines: &Receiver<String>) {
    for line in lines {
        if stdin
            .write_all(line.as_bytes())
            .and_then(|()| stdin.flush())
            .is_err()
        {
            break;
        }
    }
}

/// A number that JSON may not be able to write.
pub(crate) fn number<'de, D: serde::Deserializer<'de>>(deserializer: D) -> Result<f64, D::Error> {
    Number::deserialize(deserializer).map(|number| number.0)
}

/// Three of them.
pub(crate) fn numbers<'de, D: serde::Deserializer<'de>>(deserializer: D) -> Result<[f64; 3], D::Error> {
    <[Number; 3]>::deserialize(deserializer).map(|three| three.map(|number| number.0))
}

struct Number(f64);

impl<'de> Deserialize<'de> for Number {
    fn deserialize<D: serde::Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        match Value::deserialize(deserializer)? {
            Value::Number(number) => Ok(Self(number.as_f64().unwrap_or(f64::NAN))),
            Value::String(text) => match text.as_str() {
                "nan" => Ok(Self(f64::NAN)),
                "inf" => Ok(Self(f64::INFINITY)),
                "-inf" => Ok(Self(f64::NEG_INFINITY)),
                other => Err(serde::de::Error::custom(format!("\"{other}\" is not a number"))),
            },
            other => Err(serde::de::Error::custom(format!("{other} is not a number"))),
        }
    }
}
