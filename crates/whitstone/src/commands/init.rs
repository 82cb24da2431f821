//! `init`: writes a project to start from.

use crate::terminal::{Exit, Failure, make_folder};
use clap::Args;
use std::path::PathBuf;
use whitstone_image::atomic;

/// Write a project to start from: a scene, settings, a CI workflow, and a .gitignore
///
/// Existing files are never changed: if one of them exists, nothing is written.
#[derive(Args, Debug)]
#[command(
    help_template = super::HELP_TEMPLATE,
    after_help = "Example:\n  whitstone init images && cd images && whitstone validate scenes"
)]
pub struct Arguments {
    /// Folder of the project
    #[arg(default_value = ".", value_name = "DIR")]
    folder: PathBuf,
}

const SCENE: &str = "scenes/first.toml";

const FILES: [(&str, &str); 4] = [
    (SCENE, include_str!("init/first.toml")),
    ("whitstone.toml", include_str!("init/whitstone.toml")),
    (".github/workflows/images.yml", include_str!("init/workflow.yml")),
    (".gitignore", include_str!("init/gitignore")),
];

/// Runs the command. Messages call the executable `program`.
pub fn run(arguments: &Arguments, program: &str) -> Result<Exit, Failure> {
    let inside = |path: &str| match arguments.folder.as_os_str() == "." {
        true => PathBuf::from(path),
        false => arguments.folder.join(path),
    };
    let files = FILES.map(|(path, text)| (inside(path), text));
    let existing: Vec<String> = files
        .iter()
        .filter(|(path, _)| path.symlink_metadata().is_ok())
        .map(|(path, _)| path.display().to_string())
        .collect();
    if !existing.is_empty() {
        return Err(Failure::usage(format!(
            "nothing was written, because these files exist: {}",
            existing.join(", ")
        )));
    }
    for (path, text) in files {
        if let Some(folder) = path.parent() {
            make_folder(folder)?;
        }
        let text = text.replace("VERSION", env!("CARGO_PKG_VERSION"));
        atomic::write_bytes(&path, text.as_bytes()).map_err(Failure::environment)?;
        println!("created {}", path.display());
    }
    let scene = inside(SCENE);
    let scene = scene.display();
    println!("next: {program} render {scene} --png; {program} validate {scene}");
    Ok(Exit::Pass)
}
