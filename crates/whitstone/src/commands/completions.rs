//! `completions`: prints shell completion scripts.

use crate::terminal::{Exit, Failure, out};
use clap::{Args, Command};
use clap_complete::Shell;

/// Print a completion script for a shell, such as bash or zsh
#[derive(Args, Debug)]
#[command(
    help_template = super::HELP_TEMPLATE,
    after_help = "Example:\n  whitstone completions bash > ~/.local/share/bash-completion/completions/whitstone"
)]
pub struct Arguments {
    /// Shell to complete for
    #[arg(value_enum)]
    shell: Shell,
}

/// Runs the command. `command` is the whole command line, which users call `program`.
pub fn run(arguments: &Arguments, mut command: Command, program: &str) -> Result<Exit, Failure> {
    let mut script = Vec::new();
    clap_complete::generate(arguments.shell, &mut command, program, &mut script);
    out(format_args!("{}", String::from_utf8_lossy(&script)));
    Ok(Exit::Pass)
}
