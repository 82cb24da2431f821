//! Whitstone's command line with one additional shape.

fn main() -> std::process::ExitCode {
    whitstone::Cli::new("superquadric")
        .with(plugin_superquadric::register)
        .run()
}
