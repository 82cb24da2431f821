//! Runs every command of docs/tutorial.md and every `whitstone` command of README.md, in order, in
//! one folder for each page.
//!
//! Scenes of the tutorial are its `toml` blocks, named by the sentence before them; commands are
//! the `sh` blocks. A block marked `sh fails` must end with exit code 1. Commands that need a live
//! Mitsuba run where its environment exists.

#![cfg(unix)]

use std::fs;
use std::path::Path;
use whitstone::validate::Installation;
use whitstone::validate::environment::Environment;
use whitstone_tests::{program, root};

/// A fenced block: its mark, its text, and the text before it.
fn blocks(page: &str) -> Vec<(String, String, String)> {
    let mut found = Vec::new();
    let mut rest = page;
    while let Some((before, behind)) = rest.split_once("```") {
        let (mark, body) = behind.split_once('\n').expect("a mark ends its line");
        let (text, after) = body.split_once("```").expect("a block ends");
        found.push((mark.to_owned(), text.to_owned(), before.to_owned()));
        rest = after;
    }
    found
}

/// The last name in backticks that ends in `.toml`.
fn file_name(before: &str) -> &str {
    let names = before.split('`').skip(1).step_by(2);
    names
        .filter(|name| name.ends_with(".toml"))
        .last()
        .expect("the sentence before a scene names its file")
}

#[test]
fn every_command_of_the_tutorial_works() {
    let page = fs::read_to_string(root().join("docs/tutorial.md")).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let live = Environment::existing(&Installation::default()).is_some();
    link_references(folder.path()).unwrap();
    let (mut run, mut skipped) = (Vec::new(), Vec::new());
    for (mark, text, before) in blocks(&page) {
        match mark.as_str() {
            "toml" => fs::write(folder.path().join(file_name(&before)), text).unwrap(),
            "sh" | "sh fails" => {
                for line in text.lines() {
                    if needs_mitsuba(line) && !live {
                        skipped.push(line.to_owned());
                        continue;
                    }
                    let code = execute(line, folder.path());
                    assert_eq!(code, i32::from(mark == "sh fails"), "{line}");
                    run.push(line.to_owned());
                }
            }
            _ => {}
        }
    }
    assert!(
        run.len() >= 8,
        "the page has fewer commands than expected: {run:?}"
    );
    if !skipped.is_empty() {
        whitstone_tests::skipped(&format!("without Mitsuba's environment: {skipped:?}"));
    }
}

/// The commands of README.md that run the program, without their comments. CI runs its other
/// commands itself.
fn of_readme(page: &str) -> Vec<String> {
    let shells = blocks(page).into_iter().filter(|(mark, ..)| mark == "sh");
    let lines = shells.flat_map(|(_, text, _)| text.lines().map(str::to_owned).collect::<Vec<_>>());
    lines
        .filter_map(|line| {
            let command = line.strip_prefix("cargo run --release -p ")?;
            let (command, _) = command.split_once(" # ").unwrap_or((command, ""));
            Some(command.replacen(" --", "", 1).trim().to_owned())
        })
        .collect()
}

#[test]
fn every_command_of_the_readme_works() {
    let page = fs::read_to_string(root().join("README.md")).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let live = Environment::existing(&Installation::default()).is_some();
    link_references(folder.path()).unwrap();
    for name in ["scenes", "studies"] {
        std::os::unix::fs::symlink(root().join(name), folder.path().join(name)).unwrap();
    }
    let scene = blocks(&page)
        .into_iter()
        .find(|(mark, ..)| mark == "toml")
        .unwrap();
    fs::write(folder.path().join("scene.toml"), scene.1).unwrap();
    let subject = blocks(&page)
        .into_iter()
        .find(|(_, text, _)| text.starts_with("[subject."))
        .unwrap();
    fs::write(folder.path().join("whitstone.toml"), subject.1).unwrap();
    write_tracer(&folder.path().join("mytracer")).unwrap();
    let (mut run, mut skipped) = (0, Vec::new());
    for line in of_readme(&page) {
        if needs_mitsuba(&line) && !live {
            skipped.push(line);
            continue;
        }
        if line.contains("--cluster") && whitstone_tests::dask().is_none() {
            continue;
        }
        // The page stands for any two images of the same size.
        for name in ["ours.exr", "theirs.exr"] {
            if line.contains(name) {
                fs::copy(folder.path().join("scene.exr"), folder.path().join(name)).unwrap();
            }
        }
        // The one validation with an injected fault shows a failing report.
        let fails = line.starts_with("whitstone validate") && line.contains("--ours");
        assert_eq!(execute(&line, folder.path()), i32::from(fails), "{line}");
        run += 1;
    }
    assert!(run >= 4, "the page has fewer commands than expected: {run}");
    if !skipped.is_empty() {
        whitstone_tests::skipped(&format!("without Mitsuba's environment: {skipped:?}"));
    }
}

/// A renderer as README names it, which is this one.
fn write_tracer(path: &Path) -> std::io::Result<()> {
    use std::os::unix::fs::PermissionsExt as _;
    let program = env!("CARGO_BIN_EXE_whitstone-under-test");
    fs::write(
        path,
        format!("#!/bin/sh\nexec {program} render \"$1\" -o \"$3\"\n"),
    )?;
    fs::set_permissions(path, fs::Permissions::from_mode(0o755))
}

/// Whether a command starts Mitsuba, or would install it.
fn needs_mitsuba(line: &str) -> bool {
    ["validate", "sensitivity", "reduce", "converge", "explain"]
        .iter()
        .any(|verb| line.starts_with(&format!("whitstone {verb}")))
}

/// Lets the program find the repository's stored references below the folder, as in a clone.
/// Results are written into the folder.
fn link_references(folder: &Path) -> std::io::Result<()> {
    std::os::unix::fs::symlink(root().join("references"), folder.join("references"))
}

/// Runs a line of the page and returns the exit code.
fn execute(line: &str, folder: &Path) -> i32 {
    let mut words = line.split_whitespace();
    assert_eq!(words.next(), Some("whitstone"), "{line}");
    let mut command = program!();
    command.current_dir(folder).args(words);
    if line.starts_with("whitstone new-plugin") {
        // The folder is outside of the clone.
        command.arg("--whitstone").arg(root());
    }
    if line.starts_with("whitstone converge") {
        // Each setting is timed once.
        command.arg("--quick");
    }
    command.output().unwrap().status.code().unwrap_or(-1)
}
