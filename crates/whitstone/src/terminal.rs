//! What all commands share in talking to people: progress, messages, exit codes.

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use std::fmt::Display;
use std::io::IsTerminal;
use std::process::ExitCode;

/// How a command ended; the numbers are a contract with scripts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Exit {
    /// 0: done, and what was compared agrees.
    Pass,
    /// 1: what was compared differs.
    Differs,
}

/// Why a command could not do its work.
#[derive(Debug)]
pub enum Failure {
    /// 2: the command line or the scene is wrong.
    Usage(String),
    /// 3: something that it needs is missing or broken, such as a live Mitsuba that was asked for.
    Environment(String),
}

impl Failure {
    /// The command line, a scene or a file is wrong.
    pub fn usage(problem: impl Display) -> Self {
        Self::Usage(problem.to_string())
    }

    /// Something outside is missing.
    pub fn environment(problem: impl Display) -> Self {
        Self::Environment(problem.to_string())
    }
}

/// Prints a failure and gives the exit code.
pub fn finish(result: Result<Exit, Failure>) -> ExitCode {
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
    // Reports about scenes bring their own.
    if problem.contains("error") && problem.starts_with(['e', '\u{1b}']) {
        problem.to_owned()
    } else {
        format!("error: {problem}")
    }
}

/// Whether messages may be coloured.
pub fn color() -> bool {
    std::io::stderr().is_terminal() && std::env::var_os("NO_COLOR").is_none()
}

/// A progress bar on standard error; none where that is no terminal.
pub fn progress(total: u64, what: &str) -> ProgressBar {
    let bar = ProgressBar::with_draw_target(Some(total), ProgressDrawTarget::stderr());
    let style = ProgressStyle::with_template("{msg} {wide_bar} {percent}% {elapsed} (eta {eta})");
    bar.set_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()));
    bar.set_message(what.to_owned());
    bar
}
