//! Output, progress, messages and exit codes, shared by all commands.

#[cfg(feature = "cli")]
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use std::borrow::Cow;
use std::fmt::{Arguments, Display};
use std::io::{ErrorKind, IsTerminal, Write};
#[cfg(feature = "cli")]
use std::path::Path;
use std::sync::OnceLock;
use std::sync::atomic::{AtomicBool, Ordering};
#[cfg(feature = "cli")]
use whitstone_image::atomic;

/// Like the standard macro, but does not panic if the reader of a pipe has gone. The crate uses no
/// other `println!`.
macro_rules! println {
    () => { $crate::terminal::out(format_args!("\n")) };
    ($($arguments:tt)*) => { $crate::terminal::out(format_args!("{}\n", format_args!($($arguments)*))) };
}

/// Like [`println!`], to standard error.
macro_rules! eprintln {
    ($($arguments:tt)*) => { $crate::terminal::err(format_args!("{}\n", format_args!($($arguments)*))) };
}

/// Whether writing to standard output failed for a reason other than a closed pipe.
static OUTPUT_LOST: AtomicBool = AtomicBool::new(false);

/// Writes to standard output. A reader that has gone (`whitstone list | head -1`) is no error: the
/// command still has to finish its work, and the rest of its text is discarded.
///
/// With `--json -`, standard output is for the JSON alone, and this text goes to standard error.
pub(crate) fn out(text: Arguments<'_>) {
    if json_on_stdout() {
        err(text);
    } else {
        stdout(text);
    }
}

fn stdout(text: Arguments<'_>) {
    write(visible(&text.to_string()).as_bytes());
}

/// Writes text with control sequences of this program's own to standard output, or with `--json -`
/// to standard error. It must contain nothing that comes from a file or a scene.
#[cfg(feature = "cli")]
pub(crate) fn trusted(text: &str) {
    if json_on_stdout() {
        let _ = std::io::stderr().lock().write_all(text.as_bytes());
    } else {
        write(text.as_bytes());
    }
}

fn write(bytes: &[u8]) {
    if let Err(error) = std::io::stdout().lock().write_all(bytes)
        && error.kind() != ErrorKind::BrokenPipe
    {
        OUTPUT_LOST.store(true, Ordering::Relaxed);
    }
}

/// The value of `--json` that stands for standard output.
pub(crate) const STDOUT: &str = "-";

/// Whether the command line has `--json -`.
fn json_on_stdout() -> bool {
    static FOUND: OnceLock<bool> = OnceLock::new();
    *FOUND.get_or_init(|| {
        let arguments: Vec<_> = std::env::args_os().collect();
        arguments
            .windows(2)
            .any(|pair| pair[0] == "--json" && pair[1] == STDOUT)
            || arguments.iter().any(|argument| argument == "--json=-")
    })
}

/// Writes to standard error. Ignores failures, because there is nowhere to report them.
pub(crate) fn err(text: Arguments<'_>) {
    let text = text.to_string();
    let _ = std::io::stderr().lock().write_all(visible(&text).as_bytes());
}

/// The text with its control characters written out, as in Rust: file names and scenes of strangers
/// must not move the cursor or change the title of the window. Line breaks, tabs and colours stay.
pub(crate) fn visible(text: &str) -> Cow<'_, str> {
    let is_hostile = |c: char| c.is_control() && !matches!(c, '\n' | '\t');
    if !text.contains(is_hostile) {
        return Cow::Borrowed(text);
    }
    let mut safe = String::with_capacity(text.len() + 16);
    let mut rest = text;
    while let Some(place) = rest.find(is_hostile) {
        safe.push_str(&rest[..place]);
        rest = &rest[place..];
        let length = match color_sequence(rest) {
            Some(sequence) => {
                safe.push_str(sequence);
                sequence.len()
            }
            None => {
                let hostile = rest.chars().next().unwrap_or_default();
                safe.extend(hostile.escape_default());
                hostile.len_utf8()
            }
        };
        rest = &rest[length..];
    }
    safe.push_str(rest);
    Cow::Owned(safe)
}

/// The control sequence that the text begins with, if it changes only colour or weight: a sequence
/// "select graphic rendition" of ECMA-48, without 8, which hides text.
fn color_sequence(text: &str) -> Option<&str> {
    let codes = text.strip_prefix("\u{1b}[")?;
    let end = codes.find('m')?;
    let is_color = |code: &str| code.len() <= 3 && code.bytes().all(|b| b.is_ascii_digit()) && code != "8";
    codes[..end]
        .split(';')
        .all(is_color)
        .then(|| &text[..text.len() - codes.len() + end + 1])
}

/// How a command ended. Scripts rely on these numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Exit {
    /// 0: done, and all comparisons agree.
    Pass,
    /// 1: a comparison differs.
    Differs,
}

/// Why a command could not do its work.
#[derive(Debug)]
pub enum Failure {
    /// 2: the command line or the scene is wrong.
    Usage(String),
    /// 3: something that the command needs is missing or broken, such as a requested live Mitsuba.
    Environment(String),
    /// 128 and the number of the signal: the command was interrupted.
    Interrupted {
        /// The number of the signal.
        signal: i32,
        /// What the command has finished.
        kept: String,
    },
}

impl Failure {
    /// A failure of the command line, a scene or a file.
    pub fn usage(problem: impl Display) -> Self {
        Self::Usage(problem.to_string())
    }

    /// A failure of the environment.
    pub fn environment(problem: impl Display) -> Self {
        Self::Environment(problem.to_string())
    }

    /// The message.
    pub fn problem(self) -> String {
        match self {
            Self::Usage(problem) | Self::Environment(problem) => problem,
            Self::Interrupted { kept, .. } => kept,
        }
    }

    /// The message, of a failure that is still needed.
    pub fn text(&self) -> &str {
        match self {
            Self::Usage(problem) | Self::Environment(problem) => problem,
            Self::Interrupted { kept, .. } => kept,
        }
    }
}

/// Creates a folder for results if it does not exist.
#[cfg(feature = "cli")]
pub(crate) fn make_folder(folder: &Path) -> Result<(), Failure> {
    std::fs::create_dir_all(folder).map_err(|error| {
        Failure::environment(format!("cannot make the folder {}: {error}", folder.display()))
    })
}

/// Prints a failure and returns the exit code.
pub fn finish(result: Result<Exit, Failure>) -> u8 {
    let flushed = std::io::stdout().lock().flush();
    let lost = OUTPUT_LOST.load(Ordering::Relaxed)
        || flushed.is_err_and(|error| error.kind() != ErrorKind::BrokenPipe);
    let result = match result {
        // Lost output is a failure of its own only if there is no other verdict or failure.
        Ok(Exit::Pass) if lost => Err(Failure::environment("cannot write to standard output")),
        result => result,
    };
    match result {
        Ok(Exit::Pass) => 0,
        Ok(Exit::Differs) => 1,
        Err(Failure::Usage(problem)) => {
            eprintln!("{}", with_prefix(&problem));
            2
        }
        Err(Failure::Environment(problem)) => {
            eprintln!("{}", with_prefix(&problem));
            3
        }
        Err(Failure::Interrupted { signal, kept }) => {
            eprintln!("interrupted: {kept}");
            u8::try_from(128 + signal).unwrap_or(u8::MAX)
        }
    }
}

fn with_prefix(problem: &str) -> String {
    // Scene reports bring their own heading and may be coloured.
    let mut plain = problem;
    while let Some((_, rest)) = plain
        .strip_prefix("\u{1b}[")
        .and_then(|codes| codes.split_once('m'))
    {
        plain = rest;
    }
    if plain.starts_with("error:") || plain.starts_with("error\u{1b}") {
        problem.to_owned()
    } else {
        format!("error: {problem}")
    }
}

#[cfg(feature = "cli")]
/// Writes machine-readable results to the file of `--json`, atomically, or to standard output.
pub(crate) fn write_json(path: &Path, value: &serde_json::Value) -> Result<(), Failure> {
    write_text(path, &format!("{value:#}\n"))
}

#[cfg(feature = "cli")]
/// [`write_json`] of a formatted text.
pub(crate) fn write_text(path: &Path, text: &str) -> Result<(), Failure> {
    if path == Path::new(STDOUT) {
        stdout(format_args!("{text}"));
        return Ok(());
    }
    atomic::write_bytes(path, text.as_bytes()).map_err(Failure::environment)
}

#[cfg(feature = "cli")]
/// A verdict for standard output, padded to a width; on a terminal in green, yellow or red.
pub(crate) fn verdict_word(word: &str, exit: Option<Exit>, width: usize) -> String {
    let padded = format!("{word:<width$}");
    let plain =
        json_on_stdout() || !std::io::stdout().is_terminal() || std::env::var_os("NO_COLOR").is_some();
    let code = match exit {
        Some(Exit::Pass) => 32,
        None => 33,
        Some(Exit::Differs) => 31,
    };
    if plain {
        padded
    } else {
        format!("\u{1b}[{code}m{padded}\u{1b}[0m")
    }
}

/// Whether messages may be coloured.
pub(crate) fn color() -> bool {
    std::io::stderr().is_terminal() && std::env::var_os("NO_COLOR").is_none()
}

#[cfg(feature = "cli")]
/// A progress bar on standard error; hidden if standard error is not a terminal.
pub fn progress(total: u64, what: &str) -> ProgressBar {
    let bar = ProgressBar::with_draw_target(Some(total), ProgressDrawTarget::stderr());
    let style = ProgressStyle::with_template("{msg} {wide_bar} {percent}% {elapsed} (eta {eta})");
    bar.set_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()));
    set_message(&bar, what);
    bar
}

#[cfg(feature = "cli")]
/// Changes the text of a progress bar, which may contain names of files.
pub(crate) fn set_message(bar: &ProgressBar, text: &str) {
    bar.set_message(visible(text).into_owned());
}

#[cfg(feature = "cli")]
/// A spinner for work of unknown length; hidden if standard error is not a terminal.
pub(crate) fn spinner(what: &str) -> ProgressBar {
    let bar = ProgressBar::with_draw_target(None, ProgressDrawTarget::stderr());
    let style = ProgressStyle::with_template("{spinner} {msg} {elapsed}");
    bar.set_style(style.unwrap_or_else(|_| ProgressStyle::default_spinner()));
    set_message(&bar, what);
    // The spinner appears after a delay, because most scenes are built before anyone could read it.
    keep_moving(&bar);
    bar
}

#[cfg(feature = "cli")]
/// Draws a progress bar also while nothing changes. Needs a thread: without one, the bar stands
/// still until the next change.
pub(crate) fn keep_moving(bar: &ProgressBar) {
    let can_start = || std::thread::Builder::new().spawn(|| {}).is_ok();
    if !bar.is_hidden() && can_start() {
        bar.enable_steady_tick(std::time::Duration::from_millis(250));
    }
}

#[cfg(test)]
mod tests {
    use super::{visible, with_prefix};

    #[test]
    fn control_characters_are_written_out() {
        let colored = "\u{1b}[1m\u{1b}[91merror\u{1b}[0m: a\tb\n";
        assert_eq!(visible(colored), colored);
        for (hostile, seen) in [
            ("\u{1b}]0;title\u{7}", "\\u{1b}]0;title\\u{7}"),
            ("a\u{1b}[2J\u{1b}[32mb", "a\\u{1b}[2J\u{1b}[32mb"),
            ("\u{1b}[8mhidden\u{9b}31m", "\\u{1b}[8mhidden\\u{9b}31m"),
            ("line\rover it", "line\\rover it"),
            ("\u{1b}", "\\u{1b}"),
            ("\u{1b}[", "\\u{1b}["),
        ] {
            assert_eq!(visible(hostile), seen);
        }
    }

    #[test]
    fn failures_have_one_prefix() {
        assert_eq!(with_prefix("no such file"), "error: no such file");
        assert_eq!(
            with_prefix("errors.toml: no such file"),
            "error: errors.toml: no such file"
        );
        assert_eq!(with_prefix("error: unknown key"), "error: unknown key");
        let colored = "\u{1b}[1m\u{1b}[91merror\u{1b}[0m: unknown key";
        assert_eq!(with_prefix(colored), colored);
    }
}
