//! What the tests of the whole share; the tests are in `tests/`.

use std::path::{Path, PathBuf};
use std::time::Duration;
use whitstone::core::Registry;
use whitstone::render::{BuildOptions, Pipeline, RenderOptions};
use whitstone::scene::Sources;

/// The program under test.
#[macro_export]
macro_rules! program {
    () => {
        // Backtraces would hide what the program itself says.
        {
            let mut program = assert_cmd::Command::new(env!("CARGO_BIN_EXE_whitstone-under-test"));
            program.env("RUST_BACKTRACE", "0");
            program
        }
    };
}

/// What takes longer does not end. No measure of speed: machines are slow or busy at times.
pub const ENDLESS: Duration = Duration::from_secs(30);

/// Says why a test, or a part of it, is skipped. The harness captures what `println!` prints.
pub fn skipped(why: &str) {
    use std::io::Write as _;
    // Without standard error nobody listens.
    let _ = writeln!(std::io::stderr(), "skipped: {why}");
}

/// The Python with Dask, installed on first use; reported as skipped where that fails.
pub fn dask() -> Option<PathBuf> {
    let requirements = root().join("crates/whitstone/cluster/requirements.txt");
    let installation = whitstone::validate::Installation::default();
    match whitstone::validate::dask_python(&installation, &requirements, &|_| ()) {
        Ok(python) => Some(python),
        Err(error) => {
            skipped(&format!("a cluster: {error}"));
            None
        }
    }
}

/// A folder of the public test data; told as skipped where there is none.
pub fn test_data(folder: &str) -> Option<PathBuf> {
    let data = std::env::var_os("WHITSTONE_TEST_DATA").filter(|data| !data.is_empty());
    let folder = data.map(|data| Path::new(&data).join(folder));
    let found = folder.filter(|folder| folder.is_dir());
    if found.is_none() {
        skipped("public files: WHITSTONE_TEST_DATA names no folder with them");
    }
    found
}

/// Root of the repository.
pub fn root() -> PathBuf {
    let package = Path::new(env!("CARGO_MANIFEST_DIR"));
    package.parent().unwrap_or(package).to_owned()
}

/// Every scene of the repository.
pub fn scenes() -> Vec<PathBuf> {
    whitstone::validate::find_scenes(&[root().join("scenes")]).unwrap_or_default()
}

/// `--set` arguments that make a scene small, so that a test of many is quick.
pub fn small() -> Vec<String> {
    ["film.width=32", "film.height=24"].map(str::to_owned).to_vec()
}

/// From text to pipeline, with all that is wrong as a report.
pub fn build(sources: &Sources, registry: &Registry) -> Result<Pipeline, String> {
    let report = |errors| sources.report(&errors, false);
    Pipeline::load(sources, registry, BuildOptions::default()).map_err(report)
}

/// A scene file with overrides, built.
pub fn load(path: &Path, overrides: &[String], registry: &Registry) -> Result<Pipeline, String> {
    let sources = Sources::load(path, overrides, registry)
        .map_err(|error| error.sources.report(&error.errors, false))?;
    build(&sources, registry)
}

/// Radiance and layers of a picture by `threads` threads, as bits: equal bits are equal pictures.
pub fn bits(pipeline: &Pipeline, threads: usize) -> Vec<u32> {
    let film = pipeline.render(RenderOptions {
        threads,
        ..RenderOptions::default()
    });
    let layers = film.layers.iter().flat_map(|(_, values)| values);
    film.rgb
        .as_flattened()
        .iter()
        .chain(layers)
        .map(|value| value.to_bits())
        .collect()
}

/// Names of what is in a folder, sorted.
pub fn entries(folder: &Path) -> Vec<String> {
    let found = std::fs::read_dir(folder).into_iter().flatten().flatten();
    let mut names: Vec<String> = found
        .map(|entry| entry.file_name().to_string_lossy().into_owned())
        .collect();
    names.sort();
    names
}

/// The version of Mitsuba that the driver requires.
pub const MITSUBA: &str = "3.9.1";

/// A Python that makes environments of itself, says `hello` as Mitsuba `version`, and answers
/// everything else by `behaviour` (shell).
#[cfg(unix)]
pub fn fake_python(folder: &Path, version: &str, behaviour: &str) -> std::io::Result<()> {
    let script = format!(
        r#"#!/bin/sh
case "$1 $2" in
"-c "*) echo 3.11.0 ;;
"-m venv") mkdir -p "$3/bin" && cp "$0" "$3/bin/python" ;;
"-m pip") ;;
"-m whitstone_mitsuba")
  while read -r line; do
    case "$line" in
    *'"op":"hello"'*) echo '{{"ok":true,"mitsuba":"{version}","drjit":"1","variant":"llvm_ad_rgb","python":"3","libllvm":"x","llvm_version":"1","cpu":"c","threads":2}}' ;;
    *) {behaviour} ;;
    esac
  done ;;
esac
"#
    );
    let path = folder.join("python");
    std::fs::write(&path, script)?;
    std::fs::set_permissions(&path, std::os::unix::fs::PermissionsExt::from_mode(0o755))
}
