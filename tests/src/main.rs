//! The command line, for the tests of this package.

fn main() -> std::process::ExitCode {
    whitstone::Cli::new("whitstone").run()
}
