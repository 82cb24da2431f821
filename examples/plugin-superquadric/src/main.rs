//! Whitstone's command line with one shape more.

fn main() -> std::process::ExitCode {
    whitstone::Cli::new("superquadric")
        .with(plugin_superquadric::register)
        .run()
}
