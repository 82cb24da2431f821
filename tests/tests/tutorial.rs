//! Runs every command of docs/tutorial.md, in order, in one folder.
//!
//! Scenes are the `toml` blocks, named by the sentence before them; commands are the `sh` blocks. A
//! block marked `sh fails` must end with exit code 1. Commands that need a live Mitsuba run where
//! its environment exists.

#![cfg(unix)]

use std::fs;
use std::path::Path;
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
    let live = Environment::existing(&root().join("target/whitstone"), &root().join("references")).is_some();
    if live {
        link_environment(folder.path()).unwrap();
    }
    let (mut run, mut skipped) = (Vec::new(), Vec::new());
    for (mark, text, before) in blocks(&page) {
        match mark.as_str() {
            "toml" => fs::write(folder.path().join(file_name(&before)), text).unwrap(),
            "sh" | "sh fails" => {
                for line in text.lines() {
                    let needs_mitsuba = ["validate", "sensitivity"]
                        .iter()
                        .any(|verb| line.starts_with(&format!("whitstone {verb}")));
                    if needs_mitsuba && !live {
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
        println!("skipped without Mitsuba's environment: {skipped:?}");
    }
}

/// Lets the program find the repository's drivers and Mitsuba's environment below the folder, as in
/// a clone. Results are written into the folder.
fn link_environment(folder: &Path) -> std::io::Result<()> {
    std::os::unix::fs::symlink(root().join("references"), folder.join("references"))?;
    let target = folder.join("target/whitstone");
    fs::create_dir_all(&target)?;
    for entry in fs::read_dir(root().join("target/whitstone"))? {
        let entry = entry?;
        if entry.file_name().to_string_lossy().starts_with("python-") {
            std::os::unix::fs::symlink(entry.path(), target.join(entry.file_name()))?;
        }
    }
    Ok(())
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
    command.output().unwrap().status.code().unwrap_or(-1)
}
