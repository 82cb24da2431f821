//! Runs the command of a subject with limits of time, memory, processes and output.
//!
//! The command gets its own process group. On Linux its processes are also followed through
//! `/proc`: by their parents, and at the end by a variable of their environment, so that processes
//! that have left the group are ended too.

use crate::stop::Stop;
use std::collections::{BTreeMap, VecDeque};
use std::fmt;
use std::io::{ErrorKind, Read};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

/// Whether the memory of a run can be limited on this system.
pub(crate) const MEASURES_MEMORY: bool = cfg!(target_os = "linux");
/// Maximum number of processes of a run at a time.
const MAX_PROCESSES: usize = 512;
/// Bytes that are kept of the end of standard output, and as many of standard error.
const KEPT_OUTPUT: usize = 16 << 10;
/// Lines of them in a message.
const SHOWN_LINES: usize = 12;
/// Characters of such a line.
const SHOWN_WIDTH: usize = 300;
/// Time between two measurements of memory and processes.
const MEASURED_EVERY: Duration = Duration::from_millis(100);
/// Time that pipes stay open after their processes have ended.
const DRAINED_WITHIN: Duration = Duration::from_secs(1);
/// The variable that marks the processes of a run.
const MARK: &str = "WHITSTONE_SUBJECT_RUN";

/// The limits of a run.
#[derive(Clone, Debug)]
pub(crate) struct RunLimits {
    pub(crate) time: Duration,
    /// In bytes, of all processes together; measured on Linux only.
    pub(crate) memory: u64,
    /// The file that the command writes, and its maximum length in bytes.
    pub(crate) file: (PathBuf, u64),
    /// A request to stop early.
    pub(crate) stop: Stop,
}

/// A run that ended with success.
#[derive(Debug)]
pub(crate) struct Run {
    pub(crate) seconds: f64,
    /// The end of its standard output and standard error.
    pub(crate) output: Tail,
    /// Processes that were still running and were ended.
    pub(crate) left_over: usize,
}

/// Why a run gave no result.
#[derive(Debug, thiserror::Error)]
pub(crate) enum RunError {
    #[error("`{}` cannot be started: {}", program.display(), reason(error))]
    NotStarted { program: PathBuf, error: std::io::Error },
    #[error("the command did not end within {} s and was stopped{output}", seconds.as_secs_f64())]
    TimedOut { seconds: Duration, output: Tail },
    #[error("the command used more than {} MiB of memory and was stopped{output}", limit >> 20)]
    Memory { limit: u64, output: Tail },
    #[error("the command started more than {MAX_PROCESSES} processes and was stopped{output}")]
    Processes { output: Tail },
    #[error("the command wrote an image file of more than {} MiB and was stopped{output}", limit >> 20)]
    File { limit: u64, output: Tail },
    #[error("the command was stopped{output}")]
    Stopped { output: Tail },
    #[error("the command ended with {status}{output}")]
    Failed { status: ExitStatus, output: Tail },
    #[error("the command cannot be waited for: {0}")]
    Wait(std::io::Error),
}

fn reason(error: &std::io::Error) -> String {
    if error.kind() == ErrorKind::NotFound {
        "there is no such program".to_owned()
    } else {
        error.to_string()
    }
}

/// The end of the output of a run. It is written as indented lines after a message.
#[derive(Clone, Debug, Default)]
pub(crate) struct Tail {
    text: String,
    /// The length of standard output in it, which is followed by standard error.
    output: usize,
    /// Bytes before it that were not kept.
    dropped: u64,
}

impl Tail {
    /// The text, and how much is missing before it.
    pub(crate) fn log(&self) -> String {
        match self.dropped {
            0 => self.text.clone(),
            dropped => format!("[{dropped} bytes before this were not kept]\n{}", self.text),
        }
    }

    /// The last line of standard output, or of standard error if there is none: where a command
    /// says why it ends.
    pub(crate) fn last_line(&self) -> Option<String> {
        let [output, error] = [&self.text[..self.output], &self.text[self.output..]];
        let last = |text: &str| text.lines().map(shown).rfind(|line| !line.trim().is_empty());
        last(output).or_else(|| last(error))
    }
}

/// A line without control characters, which could change what the terminal shows.
fn shown(line: &str) -> String {
    line.chars()
        .filter(|c| !c.is_control())
        .take(SHOWN_WIDTH)
        .collect()
}

impl fmt::Display for Tail {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let lines: Vec<&str> = self.text.lines().filter(|line| !line.trim().is_empty()).collect();
        for line in &lines[lines.len().saturating_sub(SHOWN_LINES)..] {
            write!(f, "\n  | {}", shown(line))?;
        }
        Ok(())
    }
}

/// Runs a program to its end, or until a limit is exceeded. Afterwards none of its processes runs.
pub(crate) fn run(
    program: &Path,
    arguments: &[String],
    folder: &Path,
    limits: &RunLimits,
) -> Result<Run, RunError> {
    static RUNS: AtomicU64 = AtomicU64::new(0);
    let mark = format!("{}-{}", std::process::id(), RUNS.fetch_add(1, Ordering::Relaxed));
    let mut command = Command::new(program);
    command
        .args(arguments)
        .current_dir(folder)
        .env(MARK, &mark)
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped());
    #[cfg(unix)]
    std::os::unix::process::CommandExt::process_group(&mut command, 0);
    let start = Instant::now();
    let child = command.spawn().map_err(|error| RunError::NotStarted {
        program: program.to_owned(),
        error,
    })?;
    let mut family = Family::new(child, format!("{MARK}={mark}"));
    let drain = Drain::start(&mut family.child);
    let ended = wait(&mut family, limits, start);
    let seconds = start.elapsed().as_secs_f64();
    // A command that starts processes without end must not start more while all are found, also
    // those that have left its group.
    if !matches!(ended, Ok(Ended::Itself(_))) {
        family.stop_group();
        family.alive(true);
        family.kill_group();
    }
    let left_over = family.end();
    let output = drain.finish();
    match ended {
        Err(error) => Err(RunError::Wait(error)),
        Ok(Ended::Itself(status)) if status.success() => Ok(Run {
            seconds,
            output,
            left_over,
        }),
        Ok(Ended::Itself(status)) => Err(RunError::Failed { status, output }),
        Ok(Ended::TimedOut) => Err(RunError::TimedOut {
            seconds: limits.time,
            output,
        }),
        Ok(Ended::Stopped) => Err(RunError::Stopped { output }),
        Ok(Ended::Memory) => Err(RunError::Memory {
            limit: limits.memory,
            output,
        }),
        Ok(Ended::Processes) => Err(RunError::Processes { output }),
        Ok(Ended::File) => Err(RunError::File {
            limit: limits.file.1,
            output,
        }),
    }
}

enum Ended {
    Itself(ExitStatus),
    TimedOut,
    Stopped,
    Memory,
    Processes,
    File,
}

fn wait(family: &mut Family, limits: &RunLimits, start: Instant) -> std::io::Result<Ended> {
    let mut measured = None;
    loop {
        if let Some(status) = family.child.try_wait()? {
            return Ok(Ended::Itself(status));
        }
        if limits.stop.is_requested() {
            return Ok(Ended::Stopped);
        }
        if start.elapsed() >= limits.time {
            return Ok(Ended::TimedOut);
        }
        if measured.is_none_or(|at: Instant| at.elapsed() >= MEASURED_EVERY) {
            measured = Some(Instant::now());
            let (count, memory) = family.measure();
            if count > MAX_PROCESSES {
                return Ok(Ended::Processes);
            }
            if memory > limits.memory {
                return Ok(Ended::Memory);
            }
            let (file, length) = &limits.file;
            if std::fs::metadata(file).is_ok_and(|file| file.len() > *length) {
                return Ok(Ended::File);
            }
        }
        // Short runs are timed too.
        let pause = start.elapsed() / 64;
        thread::sleep(pause.clamp(Duration::from_millis(1), Duration::from_millis(20)));
    }
}

/// The processes of a run.
struct Family {
    child: Child,
    /// The entry of the environment that marks them.
    mark: String,
    /// Start times of the processes that were seen; a number alone may be used again.
    seen: BTreeMap<u32, u64>,
}

impl Family {
    fn new(child: Child, mark: String) -> Self {
        Self {
            child,
            mark,
            seen: BTreeMap::new(),
        }
    }

    /// The number of processes and their resident memory in bytes.
    fn measure(&mut self) -> (usize, u64) {
        let alive = self.alive(false);
        (alive.len(), alive.iter().map(|process| process.memory).sum())
    }

    /// The running processes of the family. `marked` also looks for the mark, which takes longer.
    fn alive(&mut self, marked: bool) -> Vec<proc::Process> {
        let all = proc::all();
        let root = self.child.id();
        let mut members = BTreeMap::new();
        loop {
            let before = members.len();
            for process in &all {
                let is_member = process.id == root
                    || process.group == root
                    || self.seen.get(&process.id) == Some(&process.started)
                    || members.contains_key(&process.parent)
                    || (marked && proc::has_mark(process.id, &self.mark));
                if is_member {
                    members.insert(process.id, process.started);
                }
            }
            if members.len() == before {
                break;
            }
        }
        self.seen.extend(&members);
        all.into_iter()
            .filter(|process| members.contains_key(&process.id) && !process.is_zombie)
            .collect()
    }

    /// Ends all processes. Returns the number of those that had outlived the first one.
    fn end(&mut self) -> usize {
        let root = self.child.id();
        let outlived = (self.alive(true).iter())
            .filter(|process| process.id != root)
            .count();
        // New processes may be started while the others are ended.
        for _ in 0..50 {
            self.kill_group();
            let left = self.alive(true);
            for process in &left {
                kill(process.id);
            }
            if left.is_empty() {
                break;
            }
            thread::sleep(Duration::from_millis(10));
        }
        let _ = self.child.kill();
        let _ = self.child.wait();
        outlived
    }

    fn stop_group(&self) {
        #[cfg(unix)]
        self.signal_group(rustix::process::Signal::STOP);
    }

    fn kill_group(&self) {
        #[cfg(unix)]
        self.signal_group(rustix::process::Signal::KILL);
    }

    #[cfg(unix)]
    fn signal_group(&self, signal: rustix::process::Signal) {
        let group = i32::try_from(self.child.id()).ok();
        if let Some(group) = group.and_then(rustix::process::Pid::from_raw) {
            // Fails only if the group no longer exists.
            let _ = rustix::process::kill_process_group(group, signal);
        }
    }
}

fn kill(process: u32) {
    #[cfg(unix)]
    if let Some(process) = i32::try_from(process)
        .ok()
        .and_then(rustix::process::Pid::from_raw)
    {
        // Fails only if the process has ended.
        let _ = rustix::process::kill_process(process, rustix::process::Signal::KILL);
    }
    #[cfg(not(unix))]
    let _ = process;
}

/// The processes of the system.
mod proc {
    /// A process.
    pub(super) struct Process {
        pub(super) id: u32,
        pub(super) parent: u32,
        pub(super) group: u32,
        /// Time of its start since boot, in clock ticks.
        pub(super) started: u64,
        /// Resident memory in bytes.
        pub(super) memory: u64,
        pub(super) is_zombie: bool,
    }

    /// All processes; none on systems without `/proc`.
    pub(super) fn all() -> Vec<Process> {
        if !super::MEASURES_MEMORY {
            return Vec::new();
        }
        let entries = std::fs::read_dir("/proc").into_iter().flatten().flatten();
        entries
            .filter_map(|entry| {
                let id = entry.file_name().to_str()?.parse().ok()?;
                // A process may end while it is looked at.
                parse(id, &std::fs::read_to_string(entry.path().join("stat")).ok()?)
            })
            .collect()
    }

    /// Reads the line of `/proc/ID/stat`. The name of the program, in parentheses, may contain any
    /// character.
    pub(super) fn parse(id: u32, line: &str) -> Option<Process> {
        let (_, rest) = line.rsplit_once(')')?;
        let fields: Vec<&str> = rest.split_ascii_whitespace().collect();
        // proc_pid_stat(5) numbers the fields from 1; field 3 is the first one after the name.
        let field = |number: usize| fields.get(number - 3).copied();
        Some(Process {
            id,
            parent: field(4)?.parse().ok()?,
            group: field(5)?.parse().ok()?,
            started: field(22)?.parse().ok()?,
            memory: page_size() * field(24)?.parse::<u64>().ok()?,
            is_zombie: field(3)? == "Z",
        })
    }

    #[cfg(unix)]
    fn page_size() -> u64 {
        rustix::param::page_size() as u64
    }

    #[cfg(not(unix))]
    fn page_size() -> u64 {
        0
    }

    /// Whether an entry is in the environment with which a process was started.
    pub(super) fn has_mark(id: u32, mark: &str) -> bool {
        let environment = std::fs::read(format!("/proc/{id}/environ"));
        environment.is_ok_and(|bytes| {
            bytes
                .split(|byte| *byte == 0)
                .any(|entry| entry == mark.as_bytes())
        })
    }
}

/// The end of a pipe, and the number of bytes before it.
type Kept = Arc<Mutex<(VecDeque<u8>, u64)>>;

/// The threads that read standard output and standard error, so that the command is never blocked.
struct Drain(Vec<(Kept, JoinHandle<()>)>);

impl Drain {
    fn start(child: &mut Child) -> Self {
        let stdout = child
            .stdout
            .take()
            .map(|pipe| Box::new(pipe) as Box<dyn Read + Send>);
        let stderr = child
            .stderr
            .take()
            .map(|pipe| Box::new(pipe) as Box<dyn Read + Send>);
        Self([stdout, stderr].into_iter().flatten().filter_map(drain).collect())
    }

    /// The end of the output. Called after the processes have ended.
    fn finish(self) -> Tail {
        let start = Instant::now();
        while start.elapsed() < DRAINED_WITHIN && self.0.iter().any(|(_, reader)| !reader.is_finished()) {
            thread::sleep(Duration::from_millis(1));
        }
        let mut tail = Tail::default();
        for (index, (kept, _)) in self.0.iter().enumerate() {
            let kept = kept.lock().unwrap_or_else(PoisonError::into_inner);
            let bytes: Vec<u8> = kept.0.iter().copied().collect();
            tail.text += &String::from_utf8_lossy(&bytes);
            tail.dropped += kept.1;
            if index == 0 {
                tail.output = tail.text.len();
            }
        }
        tail
    }
}

/// `None` if no thread can be started; the pipe is then closed, and writing to it fails.
fn drain(mut pipe: Box<dyn Read + Send>) -> Option<(Kept, JoinHandle<()>)> {
    let kept = Kept::default();
    let into = kept.clone();
    let reader = thread::Builder::new().spawn(move || {
        let mut block = [0; 8192];
        while let Ok(count @ 1..) = pipe.read(&mut block) {
            let mut kept = into.lock().unwrap_or_else(PoisonError::into_inner);
            kept.0.extend(&block[..count]);
            let excess = kept.0.len().saturating_sub(KEPT_OUTPUT);
            kept.0.drain(..excess);
            kept.1 += excess as u64;
        }
    });
    Some((kept, reader.ok()?))
}

#[cfg(all(test, target_os = "linux"))]
mod tests {
    use super::*;

    fn shell(script: &str, limits: &RunLimits) -> Result<Run, RunError> {
        run(
            Path::new("/bin/sh"),
            &["-c".to_owned(), script.to_owned()],
            Path::new("/"),
            limits,
        )
    }

    fn limits(file: &Path) -> RunLimits {
        RunLimits {
            time: Duration::from_secs(20),
            memory: 1 << 30,
            file: (file.to_owned(), 1 << 20),
            stop: Stop::default(),
        }
    }

    /// Whether a process with this text in its command line is running.
    fn is_running(text: &str) -> bool {
        proc::all().iter().any(|process| {
            let line = std::fs::read(format!("/proc/{}/cmdline", process.id)).unwrap_or_default();
            !process.is_zombie && String::from_utf8_lossy(&line).replace('\0', " ").contains(text)
        })
    }

    #[test]
    fn output_is_drained_and_its_end_is_kept() {
        let run = shell(
            "yes 0123456789 | head -c 30000000; echo end >&2",
            &limits(Path::new("/none")),
        );
        let output = run.unwrap().output;
        assert!(output.text.len() <= 2 * KEPT_OUTPUT && output.text.ends_with("end\n"));
        assert_eq!(output.dropped + output.text.len() as u64, 30_000_004);
        assert!(output.log().starts_with('['));
        assert!(output.to_string().lines().count() <= 1 + SHOWN_LINES);
    }

    #[test]
    fn a_status_is_reported_with_the_output() {
        let error = shell(
            "echo oh; printf 'a\\033[31mb'; exit 7",
            &limits(Path::new("/none")),
        )
        .unwrap_err();
        assert_eq!(
            error.to_string(),
            "the command ended with exit status: 7\n  | oh\n  | a[31mb"
        );
    }

    #[test]
    fn a_missing_program_is_named() {
        let error = run(
            Path::new("/none/x"),
            &[],
            Path::new("/"),
            &limits(Path::new("/none")),
        )
        .unwrap_err();
        assert_eq!(
            error.to_string(),
            "`/none/x` cannot be started: there is no such program"
        );
    }

    #[test]
    fn what_hangs_is_stopped_with_its_children() {
        let short = RunLimits {
            time: Duration::from_millis(300),
            ..limits(Path::new("/none"))
        };
        let error = shell("sleep 3141 & sleep 3142", &short).unwrap_err();
        assert!(matches!(error, RunError::TimedOut { .. }), "{error}");
        assert!(!is_running("sleep 3141") && !is_running("sleep 3142"));
    }

    #[test]
    fn a_request_stops_the_command() {
        let limits = limits(Path::new("/none"));
        let stop = limits.stop.clone();
        let request = thread::spawn(move || {
            thread::sleep(Duration::from_millis(200));
            stop.request();
        });
        let error = shell("sleep 3147", &limits).unwrap_err();
        request.join().unwrap();
        assert!(matches!(error, RunError::Stopped { .. }), "{error}");
        assert!(!is_running("sleep 3147"));
    }

    /// `setsid` leaves the process group, and its parent ends at once.
    #[test]
    fn processes_that_left_the_group_are_ended() {
        let run = shell(
            "setsid sh -c 'sleep 3143 & sleep 3143' & sleep 0.1",
            &limits(Path::new("/none")),
        );
        assert!(run.unwrap().left_over >= 1);
        assert!(!is_running("sleep 3143"));
        let run = shell("setsid -f sleep 3144", &limits(Path::new("/none")));
        assert_eq!(run.unwrap().left_over, 1);
        assert!(!is_running("sleep 3144"));
    }

    #[test]
    fn too_many_processes_are_stopped() {
        let error = shell("while :; do sleep 3145 & done", &limits(Path::new("/none"))).unwrap_err();
        assert!(matches!(error, RunError::Processes { .. }), "{error}");
        assert!(!is_running("sleep 3145"));
    }

    #[test]
    fn memory_and_the_length_of_the_file_are_limited() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("image");
        let small = RunLimits {
            memory: 64 << 20,
            ..limits(&file)
        };
        // `tail` keeps a line without an end in memory.
        let error = shell("head -c 400000000 /dev/zero | tail | sleep 3146", &small).unwrap_err();
        assert!(matches!(error, RunError::Memory { .. }), "{error}");
        assert!(!is_running("sleep 3146"));
        let error = shell(&format!("yes > {}", file.display()), &limits(&file)).unwrap_err();
        assert!(matches!(error, RunError::File { .. }), "{error}");
    }

    #[test]
    fn a_name_in_parentheses_is_read() {
        let line = "7 (a) b) S 3 4 5 0 -1 0 0 0 0 0 0 0 0 0 20 0 1 0 99 1000 2 0 0";
        let process = proc::parse(7, line).unwrap();
        assert_eq!((process.parent, process.group, process.started), (3, 4, 99));
        assert!(process.memory >= 2 * 4096 && !process.is_zombie);
    }
}
