//! Lists the files of the drivers for `src/lib.rs`.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::{env, fs, io};

const PACKAGES: [&str; 3] = [
    "mitsuba/whitstone_mitsuba",
    "povray/whitstone_povray",
    "protocol/whitstone_protocol",
];

const REQUIREMENTS: [&str; 2] = ["mitsuba/requirements.txt", "mitsuba/requirements-llvm.txt"];

fn main() -> io::Result<()> {
    let root = PathBuf::from(env::var_os("CARGO_MANIFEST_DIR").unwrap_or_default());
    let mut files: Vec<_> = REQUIREMENTS.map(PathBuf::from).to_vec();
    for package in PACKAGES {
        println!("cargo::rerun-if-changed={package}");
        sources(&root, Path::new(package), &mut files)?;
    }
    for file in REQUIREMENTS {
        println!("cargo::rerun-if-changed={file}");
    }
    files.sort();
    let mut list = String::from("&[\n");
    for file in files {
        // Of the same form on every system, because the hash of the drivers depends on them.
        let name = file.to_string_lossy().replace('\\', "/");
        let path = root.join(&file);
        writeln!(
            list,
            "    File {{ path: {name:?}, bytes: include_bytes!({path:?}) }},"
        )
        .map_err(io::Error::other)?;
    }
    list.push(']');
    let out = PathBuf::from(env::var_os("OUT_DIR").unwrap_or_default());
    fs::write(out.join("files.rs"), list)
}

/// Adds the Python files below a folder, relative to the root.
fn sources(root: &Path, folder: &Path, files: &mut Vec<PathBuf>) -> io::Result<()> {
    for entry in fs::read_dir(root.join(folder))? {
        let entry = entry?;
        let path = folder.join(entry.file_name());
        if entry.file_type()?.is_dir() {
            sources(root, &path, files)?;
        } else if path.extension().is_some_and(|extension| extension == "py") {
            files.push(path);
        }
    }
    Ok(())
}
