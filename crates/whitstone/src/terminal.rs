//! Output, progress, messages and exit codes, shared by all commands.

#[cfg(feature = "cli")]
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use std::fmt::{Arguments, Display};
use std::io::{ErrorKind, IsTerminal, Write};
#[cfg(feature = "cli")]
use std::path::Path;
use std::process::ExitCode;
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
pub(crate) fn out(text: Arguments<'_>) {
    if let Err(error) = std::io::stdout().lock().write_fmt(text)
        && error.kind() != ErrorKind::BrokenPipe
    {
        OUTPUT_LOST.store(true, Ordering::Relaxed);
    }
}

/// Writes to standard error. Ignores failures, because there is nowhere to report them.
pub(crate) fn err(text: Arguments<'_>) {
    let _ = std::io::stderr().lock().write_fmt(text);
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
}

/// Creates a folder for results if it does not exist.
#[cfg(feature = "cli")]
pub(crate) fn make_folder(folder: &Path) -> Result<(), Failure> {
    std::fs::create_dir_all(folder).map_err(|error| {
        Failure::environment(format!("cannot make the folder {}: {error}", folder.display()))
    })
}

/// Prints a failure and returns the exit code.
pub fn finish(result: Result<Exit, Failure>) -> ExitCode {
    let flushed = std::io::stdout().lock().flush();
    let lost = OUTPUT_LOST.load(Ordering::Relaxed)
        || flushed.is_err_and(|error| error.kind() != ErrorKind::BrokenPipe);
    let result = match result {
        // Lost output is a failure of its own only if there is no other verdict or failure.
        Ok(Exit::Pass) if lost => Err(Failure::environment("cannot write to standard output")),
        result => result,
    };
    match result {
        Ok(Exit::Pass) => ExitCode::SUCCESS,
        Ok(Exit::Differs) => ExitCode::from(1),
        Err(Failure::Usage(problem)) => {
            eprintln!("{}", with_prefix(&problem));
            ExitCode::from(2)
        }
        Err(Failure::Environment(problem)) => {
            eprintln!("{}", with_prefix(&problem));
            ExitCode::from(3)
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
/// Writes machine-readable results to the file of `--json`, atomically.
pub(crate) fn write_json(path: &Path, value: &serde_json::Value) -> Result<(), Failure> {
    atomic::write_bytes(path, format!("{value:#}\n").as_bytes()).map_err(Failure::environment)
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
    bar.set_message(what.to_owned());
    bar
}

#[cfg(feature = "cli")]
/// A spinner for work of unknown length; hidden if standard error is not a terminal.
pub(crate) fn spinner(what: &str) -> ProgressBar {
    let bar = ProgressBar::with_draw_target(None, ProgressDrawTarget::stderr());
    let style = ProgressStyle::with_template("{spinner} {msg} {elapsed}");
    bar.set_style(style.unwrap_or_else(|_| ProgressStyle::default_spinner()));
    bar.set_message(what.to_owned());
    // The spinner appears after a delay, because most scenes are built before anyone could read it.
    bar.enable_steady_tick(std::time::Duration::from_millis(250));
    bar
}

#[cfg(test)]
mod tests {
    use super::with_prefix;

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
