//! The generated meshes and pictures of `scenes/assets`.

use std::path::Path;
use whitstone::image::atomic;
use whitstone::{Exit, Failure};
use whitstone_testkit::assets::generate;

/// Their folder.
const FOLDER: &str = "scenes/assets";

/// Writes all of them.
pub(crate) fn write() -> Result<Exit, Failure> {
    std::fs::create_dir_all(FOLDER).map_err(Failure::environment)?;
    for (name, bytes) in generate() {
        let path = Path::new(FOLDER).join(name);
        atomic::write_bytes(&path, &bytes).map_err(Failure::environment)?;
        println!("{}: {} bytes", path.display(), bytes.len());
    }
    Ok(Exit::Pass)
}

/// Files that are missing, differ from the generated ones, or are not generated.
pub(crate) fn check() -> Vec<String> {
    let again = "run `cargo xtask assets`";
    let generated = generate();
    let mut problems: Vec<String> = generated
        .iter()
        .filter_map(|(name, bytes)| {
            let path = Path::new(FOLDER).join(name);
            match std::fs::read(&path) {
                Ok(found) if found == *bytes => None,
                Ok(_) => Some(format!(
                    "{}: differs from the generated file; {again}",
                    path.display()
                )),
                Err(error) => Some(format!("{}: {error}; {again}", path.display())),
            }
        })
        .collect();
    for entry in std::fs::read_dir(FOLDER).into_iter().flatten().flatten() {
        let name = entry.file_name();
        if !generated
            .iter()
            .any(|(known, _)| name.to_string_lossy() == *known)
        {
            problems.push(format!(
                "{}: no generator writes this file; delete it",
                entry.path().display()
            ));
        }
    }
    problems
}
