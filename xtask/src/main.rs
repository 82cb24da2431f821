//! Verbs of the repository, thin over the library: `cargo xtask <verb>`.

fn main() -> std::process::ExitCode {
    whitstone::Cli::new("cargo xtask").run()
}
