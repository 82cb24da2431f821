//! The command line.

fn main() -> std::process::ExitCode {
    whitstone::Cli::new("whitstone").run()
}
