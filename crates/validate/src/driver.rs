//! The driver of a reference as a child process: sends the requests of
//! `references/mitsuba/PROTOCOL.md` and receives the answers.

use crate::environment::Environment;
use crate::lifeline::{self, Lifeline};
use crate::protocol::Number;
pub use crate::protocol::{
    Coincident, Hello, PovRay, Rays, Rendered, RenderedSeconds, SceneText, Setting, Versions,
};
use crate::stop::Stop;
use serde::Deserialize;
use serde_json::{Value, json};
use std::collections::VecDeque;
use std::ffi::OsStr;
use std::io::{BufRead, BufReader, Read, Write};
use std::path::Path;
use std::process::{Child, ChildStdin, Command, ExitStatus, Stdio};
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel, sync_channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};
use thiserror::Error;

/// Maximum length of an answer in bytes. The longest valid answers, those of `probe`, stay far
/// below.
const MAX_ANSWER: u64 = 256 << 20;
/// Maximum length of a line of standard error in bytes; longer ones are split.
const MAX_STDERR_LINE: u64 = 4096;
/// Number of last lines of standard error that are kept for messages.
const STDERR_LINES: usize = 40;

/// Time between two looks at the request to stop.
const STOP_INTERVAL: Duration = Duration::from_millis(50);

/// Why the driver gave no valid answer.
#[derive(Debug, Error)]
pub enum DriverError {
    /// The process could not be started or written to.
    #[error("cannot run the driver of the reference: {0}")]
    Io(#[from] std::io::Error),
    /// The process ended instead of answering.
    #[error("the driver of the reference ended ({status}){stderr}")]
    Exited {
        /// The exit status.
        status: String,
        /// The end of its standard error, on lines of its own.
        stderr: String,
    },
    /// Somebody asked to stop.
    #[error("the driver of the reference was stopped")]
    Stopped,
    /// No answer within the time limit; the process and its children were killed.
    #[error(
        "the driver of the reference gave no answer to `{op}` within {seconds} s and was stopped{stderr}"
    )]
    TimedOut {
        /// The request.
        op: String,
        /// The limit in seconds.
        seconds: u64,
        /// The end of its standard error.
        stderr: String,
    },
    /// The output is not a valid answer.
    #[error("the driver of the reference gave an invalid answer to `{op}`: {problem}")]
    BadAnswer {
        /// The request.
        op: String,
        /// What is wrong with the answer.
        problem: String,
    },
    /// The reference has no twin of something in the scene. One problem per line, each with its
    /// place in the document at the start.
    #[error("no twin in the reference: {0}")]
    Unsupported(String),
    /// The driver answered that it cannot do this.
    #[error("the driver of the reference reports: {0}")]
    Refused(String),
}

/// A running driver. It is killed, with its children, when dropped; it ends with this process.
pub struct Driver {
    child: Child,
    /// Lines for standard input. A thread writes them, because writing more than fits into the pipe
    /// would block while the driver does not read.
    requests: Sender<String>,
    answers: Receiver<std::io::Result<String>>,
    stderr: Arc<Mutex<VecDeque<String>>>,
    stderr_reader: JoinHandle<()>,
    limit: Duration,
    stop: Stop,
    _lifeline: Lifeline,
}

impl Driver {
    /// Starts the driver. `limit` is the time limit for one answer.
    pub fn start(environment: &Environment, limit: Duration) -> Result<Self, DriverError> {
        let mut command = Command::new(&environment.python);
        command
            .args(["-m", environment.module, "serve"])
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

    /// Starts any program that implements the protocol.
    pub fn spawn(mut command: Command, limit: Duration) -> Result<Self, DriverError> {
        command
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped());
        // A process group of its own, so that its child processes can be killed with it.
        #[cfg(unix)]
        std::os::unix::process::CommandExt::process_group(&mut command, 0);
        let (mut child, lifeline) = lifeline::spawn(&mut command)?;
        let (Some(stdin), Some(stdout), Some(stderr)) =
            (child.stdin.take(), child.stdout.take(), child.stderr.take())
        else {
            unreachable!("all three are configured as pipes");
        };
        let (requests, lines) = channel::<String>();
        let start = thread::Builder::new;
        start().spawn(move || write_lines(stdin, &lines))?;
        let (sender, answers) = sync_channel(1);
        start().spawn(move || {
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
        })?;
        let tail = Arc::new(Mutex::new(VecDeque::new()));
        let kept = tail.clone();
        let stderr_reader = start().spawn(move || {
            // Bytes, not text: output that is not UTF-8 must not stop the reading.
            let mut reader = BufReader::new(stderr);
            let mut line = Vec::new();
            // Reads a part of a line at a time, because a line may be unlimited.
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
        })?;
        Ok(Self {
            child,
            requests,
            answers,
            stderr: tail,
            stderr_reader,
            limit,
            stop: Stop::default(),
            _lifeline: lifeline,
        })
    }

    /// Sets the request that stops waiting for an answer, and with it the driver.
    pub fn set_stop(&mut self, stop: Stop) {
        self.stop = stop;
    }

    /// Waits for an answer; at most for the time limit, and until somebody asks to stop.
    fn answer(&self) -> Result<std::io::Result<String>, RecvTimeoutError> {
        let start = Instant::now();
        loop {
            let left = self.limit.saturating_sub(start.elapsed());
            match self.answers.recv_timeout(left.min(STOP_INTERVAL)) {
                Err(RecvTimeoutError::Timeout)
                    if start.elapsed() < self.limit && !self.stop.is_requested() => {}
                other => return other,
            }
        }
    }

    /// Sends a request and waits for the answer.
    pub fn request(&mut self, request: &Value) -> Result<Value, DriverError> {
        let op = request["op"].as_str().unwrap_or_default().to_owned();
        let mut line = request.to_string();
        line.push('\n');
        if self.requests.send(line).is_err() {
            return Err(self.exited());
        }
        let answer = match self.answer() {
            Ok(Ok(answer)) => answer,
            Ok(Err(error)) => {
                self.kill();
                return Err(DriverError::BadAnswer {
                    op,
                    problem: error.to_string(),
                });
            }
            Err(RecvTimeoutError::Disconnected) => return Err(self.exited()),
            Err(RecvTimeoutError::Timeout) if self.stop.is_requested() => {
                self.kill();
                return Err(DriverError::Stopped);
            }
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
            (None, _) => Err(bad("the field `ok` is missing".into())),
        }
    }

    fn ask<T: serde::de::DeserializeOwned>(&mut self, request: &Value) -> Result<T, DriverError> {
        let answer = self.request(request)?;
        serde_json::from_value(answer).map_err(|error| DriverError::BadAnswer {
            op: request["op"].as_str().unwrap_or_default().to_owned(),
            problem: error.to_string(),
        })
    }

    /// The process id.
    pub fn process(&self) -> u32 {
        self.child.id()
    }

    /// Queries the versions, from a driver of Mitsuba.
    pub fn hello(&mut self) -> Result<Hello, DriverError> {
        self.ask(&json!({ "op": "hello" }))
    }

    /// Queries the versions, from a driver of POV-Ray.
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

    /// Renders a scene with Mitsuba's own integrators, with this many samples per camera ray.
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

    /// The values of pixels under several settings: `[setting][pixel]`.
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
                problem: "the number of values does not match the request".into(),
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
        // The pipe can close shortly before the process ends.
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
            status: status.map_or_else(|| "its output was closed".to_owned(), |status| status.to_string()),
            stderr: self.stderr_tail(),
        }
    }

    /// The end of standard error. Called after the process has ended, because its last output may
    /// still be in the pipe.
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
            // Fails only if the group no longer exists.
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

/// Writes the lines until there are no more or the reader has gone. A missing answer is detected
/// where it is awaited.
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
