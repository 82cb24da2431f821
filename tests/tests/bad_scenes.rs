//! Faulty scenes: each `bad/NAME.toml` with what the program must say about it beside it, in
//! `bad/NAME.stderr`.
//!
//! A first line `# arguments: ...` holds further arguments, separated by spaces. `UPDATE=1` writes
//! what the program says into the files; look at the difference before keeping it.

use std::fs;
use std::path::{Path, PathBuf};
use whitstone_tests::{entries, program};

fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("bad")
}

#[test]
fn every_fault_is_named_at_its_place_and_nothing_is_written() {
    let mut problems = Vec::new();
    let names: Vec<String> = entries(&folder())
        .into_iter()
        .filter(|name| name.ends_with(".toml"))
        .collect();
    assert!(names.len() > 40, "the scenes are not found: {names:?}");
    for name in &names {
        if let Err(problem) = check(name) {
            problems.push(format!("{name}: {problem}"));
        }
    }
    assert!(
        problems.is_empty(),
        "{}\n\nUPDATE=1 cargo test -p whitstone-tests --test bad_scenes accepts new messages",
        problems.join("\n\n")
    );
}

#[test]
fn every_expected_message_has_its_scene() {
    for name in entries(&folder()) {
        if let Some(stem) = name.strip_suffix(".stderr") {
            assert!(
                folder().join(format!("{stem}.toml")).is_file(),
                "{name} has no scene"
            );
        }
    }
}

fn check(name: &str) -> Result<(), String> {
    let text = fs::read_to_string(folder().join(name)).map_err(|error| error.to_string())?;
    let arguments = text
        .lines()
        .next()
        .and_then(|line| line.strip_prefix("# arguments: "));
    let out = tempfile::tempdir().map_err(|error| error.to_string())?;
    let output = program!()
        .current_dir(folder())
        .arg("render")
        .arg(name)
        .arg("--output")
        .arg(out.path().join("image.exr"))
        .arg("--json")
        .arg(out.path().join("report.json"))
        .args(arguments.unwrap_or_default().split_whitespace())
        .output()
        .map_err(|error| error.to_string())?;
    let stderr = String::from_utf8_lossy(&output.stderr);
    if output.status.code() != Some(2) {
        return Err(format!("ends with {} instead of 2:\n{stderr}", output.status));
    }
    let written = entries(out.path());
    if !written.is_empty() {
        return Err(format!("wrote {written:?}"));
    }
    // Every single error has one, be it the file.
    let errors = stderr.lines().filter(|line| line.starts_with("error: ")).count();
    let places = stderr
        .lines()
        .filter(|line| line.trim_start().starts_with("--> "));
    if places.count() < errors {
        return Err(format!("no place in\n{stderr}"));
    }
    let sidecar = folder().join(name).with_extension("stderr");
    let expected = fs::read_to_string(&sidecar).unwrap_or_default();
    if std::env::var_os("UPDATE").is_some() {
        fs::write(&sidecar, stderr.as_bytes()).map_err(|error| error.to_string())
    } else if expected.replace("\r\n", "\n") == stderr {
        Ok(())
    } else {
        Err(format!("expected\n{expected}\nbut it says\n{stderr}"))
    }
}
