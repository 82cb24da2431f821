//! Runs the checks of docs/course: every `whitstone` command of every chapter, in order, in a
//! copy of the folder.
//!
//! A `toml` block is the answer of the student from there on. A block `sh fails` must end with exit
//! code 1, all others with 0. So each chapter shows that its check fails without an answer,
//! and passes with the right one.

#![cfg(unix)]

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use whitstone_tests::{program, root};

/// Number of chapters.
const CHAPTERS: usize = 10;
/// A copy of the course in a folder that has the program on its search path.
struct Course(tempfile::TempDir);

impl Course {
    fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let course = Self(folder);
        copy(&root().join("docs/course"), &course.folder());
        let programs = course.0.path().join("bin");
        fs::create_dir(&programs).unwrap();
        let own = env!("CARGO_BIN_EXE_whitstone-under-test");
        std::os::unix::fs::symlink(own, programs.join("whitstone")).unwrap();
        course
    }

    fn folder(&self) -> PathBuf {
        self.0.path().join("course")
    }

    /// Runs a line of a page; returns the exit code and all output.
    fn execute(&self, line: &str) -> (i32, String) {
        let mut words = line.split_whitespace();
        assert_eq!(words.next(), Some("whitstone"), "{line}");
        let path = std::env::var_os("PATH").unwrap_or_default();
        let programs = std::iter::once(self.0.path().join("bin")).chain(std::env::split_paths(&path));
        let output = program!()
            .current_dir(self.folder())
            .env("PATH", std::env::join_paths(programs).unwrap())
            .args(words)
            .output()
            .unwrap();
        let text = [&output.stdout[..], &output.stderr[..]].concat();
        (
            output.status.code().unwrap_or(-1),
            String::from_utf8_lossy(&text).into_owned(),
        )
    }

    fn answer(&self, text: &str) {
        fs::write(self.folder().join("answer.toml"), text).unwrap();
    }
}

/// Copies a folder without the results of commands.
fn copy(from: &Path, to: &Path) {
    fs::create_dir_all(to).unwrap();
    for entry in fs::read_dir(from).unwrap().flatten() {
        let (path, name) = (entry.path(), entry.file_name());
        if path.is_dir() && name != "target" {
            copy(&path, &to.join(name));
        } else if path.is_file() {
            fs::copy(&path, to.join(name)).unwrap();
        }
    }
}

/// The chapters, by the names of their files.
fn chapters() -> Vec<String> {
    let mut names: Vec<String> = whitstone_tests::entries(&root().join("docs/course"));
    names.retain(|name| name.ends_with(".md") && name != "README.md");
    names
}

/// The marks and texts of the fenced blocks of a page.
fn blocks(page: &str) -> Vec<(&str, &str)> {
    let fenced = page.split("```").skip(1).step_by(2);
    fenced.filter_map(|block| block.split_once('\n')).collect()
}

/// The subjects that need a Python with `tomllib`.
fn of_python(course: &Course) -> Vec<String> {
    let text = fs::read_to_string(course.folder().join("whitstone.toml")).unwrap();
    let table: toml::Table = text.parse().unwrap();
    let subjects = table["subject"].as_table().unwrap().iter();
    let is_python = |subject: &toml::Value| subject["command"].as_str().unwrap().starts_with("python3 ");
    let found: Vec<String> = subjects
        .filter(|(_, subject)| is_python(subject))
        .map(|(name, _)| name.clone())
        .collect();
    assert!(!found.is_empty());
    found
}

/// Whether `python3` can run the solution of the programming exercises.
fn has_tomllib() -> bool {
    let found = Command::new("python3").args(["-c", "import tomllib"]).output();
    found.is_ok_and(|output| output.status.success())
}

#[test]
fn every_check_fails_the_start_and_passes_the_right_answer() {
    let course = Course::new();
    let (python, mut skipped) = (has_tomllib(), 0);
    let chapters = chapters();
    assert_eq!(chapters.len(), CHAPTERS, "{chapters:?}");
    let of_python = of_python(&course);
    let contents = fs::read_to_string(course.folder().join("README.md")).unwrap();
    for chapter in chapters {
        let page = fs::read_to_string(course.folder().join(&chapter)).unwrap();
        let title = page.lines().next().unwrap().trim_start_matches("# ");
        assert!(contents.contains(&format!("| [{title}]({chapter}) |")), "{title}");
        let name = chapter.trim_end_matches(".md");
        let check = format!("whitstone validate scenes/{name}.toml --subject answer --reference stored");
        let mut codes = Vec::new();
        for (mark, text) in blocks(&page) {
            match mark {
                "toml" => course.answer(text),
                "sh" | "sh fails" => {
                    for line in text.lines() {
                        let is_python = of_python
                            .iter()
                            .any(|subject| line.contains(&format!("--subject {subject} ")));
                        if is_python && !python {
                            skipped += 1;
                            continue;
                        }
                        let (code, output) = course.execute(line);
                        assert_eq!(code, i32::from(mark == "sh fails"), "{chapter}: {line}\n{output}");
                        // It failed because of the image, not for a broken scene or command.
                        let compared = mark != "sh fails" || output.contains("pixel (");
                        assert!(compared, "{chapter}: {line}\n{output}");
                        if line == check {
                            codes.push(code);
                        }
                    }
                }
                _ => {}
            }
        }
        assert_eq!(codes[..2], [1, 0], "{chapter}: without an answer, and with one");
        assert!(
            codes[2..].iter().all(|code| *code == 0),
            "{chapter}: other answers"
        );
    }
    if skipped > 0 {
        whitstone_tests::skipped(&format!(
            "{skipped} commands of the course: no Python with tomllib"
        ));
    }
}

/// The stored images belong to the scenes as they are, and Whitstone renders the right answers.
#[test]
fn the_stored_images_are_right() {
    let course = Course::new();
    let (code, output) = course.execute("whitstone validate scenes --reference stored");
    assert_eq!(code, 0, "{output}");
    assert!(output.contains(&format!("{CHAPTERS} passed")), "{output}");
}

/// Answers that miss the right number by little, and one with an error: each message says what is
/// wrong.
#[test]
fn a_wrong_answer_gets_a_helpful_message() {
    let course = Course::new();
    let check = |scene: &str| {
        course.execute(&format!(
            "whitstone validate scenes/{scene}.toml --subject answer --reference stored"
        ))
    };
    // A flat disk instead of a ball.
    course.answer(
        "include = \"04-shadows.toml\"\n[[shape]]\ntype = \"sphere\"\ncenter = [0, 1, 0]\nradius = 0.75\nmaterial = \"ball\"\n",
    );
    let (code, output) = check("04-shadows");
    assert_eq!(code, 1, "{output}");
    assert!(
        output.contains("pixel (") && output.contains("ours ["),
        "{output}"
    );
    course.answer("include = \"04-shadows.toml\"\n[[shape]]\ntype = \"sphere\"\ncentre = [0, 1, 0]\n");
    let (code, output) = check("04-shadows");
    assert_eq!(code, 1, "{output}");
    assert!(
        output.contains("answer.toml:4:1") && output.contains("`center`"),
        "{output}"
    );
}
