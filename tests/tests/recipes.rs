//! The recipes of docs/ci.md, run as they stand there: a renderer in C++ that only writes PNG, and
//! pre-commit. Those for pytest are in crates/python/tests.
#![cfg(unix)]

use std::fs;
use std::os::unix::fs::symlink;
use std::path::Path;
use std::process::Command;
use whitstone_tests::{root, skipped};

/// The blocks of code in a section of docs/ci.md, in one language.
fn blocks(heading: &str, language: &str) -> Vec<String> {
    let text = fs::read_to_string(root().join("docs/ci.md")).unwrap();
    let section = text.split(&format!("\n## {heading}\n")).nth(1);
    let section = section.unwrap_or_else(|| panic!("docs/ci.md has no section {heading}"));
    let section = section.split("\n## ").next().unwrap();
    let fence = format!("```{language}\n");
    let parts = section.split(&fence).skip(1);
    let found: Vec<String> = parts
        .map(|part| part.split("```").next().unwrap().to_owned())
        .collect();
    assert!(!found.is_empty(), "{heading} has no block of {language}");
    found
}

/// A folder with the source of the renderer, and the program `whitstone` on the path.
struct Project(tempfile::TempDir);

impl Project {
    fn new() -> Option<Self> {
        if Command::new("c++").arg("--version").output().is_err() {
            skipped("the recipes of docs/ci.md: there is no C++ compiler");
            return None;
        }
        let folder = tempfile::tempdir().unwrap();
        fs::create_dir(folder.path().join("bin")).unwrap();
        let program = env!("CARGO_BIN_EXE_whitstone-under-test");
        symlink(program, folder.path().join("bin/whitstone")).unwrap();
        let source = root().join("tests/tests/recipes/renderer.cpp");
        fs::copy(source, folder.path().join("renderer.cpp")).unwrap();
        Some(Self(folder))
    }

    fn path(&self) -> &Path {
        self.0.path()
    }

    fn command(&self, program: &str, arguments: &[&str]) -> (Option<i32>, String) {
        let path = std::env::var("PATH").unwrap_or_default();
        let output = Command::new(program)
            .args(arguments)
            .current_dir(self.path())
            .env("PATH", format!("{}:{path}", self.path().join("bin").display()))
            .env("PRE_COMMIT_HOME", self.path().join("hooks"))
            .env("RUST_BACKTRACE", "0")
            .output()
            .unwrap();
        let text = [&output.stdout[..], &output.stderr[..]].concat();
        (output.status.code(), String::from_utf8_lossy(&text).into_owned())
    }

    fn sh(&self, script: &str) -> (Option<i32>, String) {
        self.command("sh", &["-ec", script])
    }

    /// Makes the renderer a program that renders too bright, and leaves the references.
    fn break_renderer(&self) {
        let source = self.path().join("renderer.cpp");
        let text = fs::read_to_string(&source).unwrap();
        let changed = text.replace(": 1.0;", ": 1.1;");
        assert_ne!(text, changed);
        fs::write(source, changed).unwrap();
    }
}

const PNG: &str = "A renderer in C++ that only writes PNG";

#[test]
fn a_renderer_that_writes_png() {
    let Some(project) = Project::new() else { return };
    let [render, first, check] = &blocks(PNG, "sh")[..] else {
        panic!("expected three blocks: render, accept, compare");
    };
    assert_eq!(project.sh(render).0, Some(0));
    // Without references nothing passes.
    let (code, text) = project.sh(check);
    assert_eq!(code, Some(2), "{text}");
    let (code, text) = project.sh(first);
    assert_eq!(code, Some(0), "{text}");
    assert!(text.contains("ACCEPT sphere.png"), "{text}");
    let (code, text) = project.sh(check);
    assert_eq!(code, Some(0), "{text}");
    project.break_renderer();
    assert_eq!(project.sh(render).0, Some(0));
    let (code, text) = project.sh(check);
    assert_eq!(code, Some(1), "{text}");
    assert!(
        text.contains("FAIL") && text.contains("pixels have other codes"),
        "{text}"
    );
    let xml = fs::read_to_string(project.path().join("compare.xml")).unwrap();
    assert!(xml.contains("<failure") && xml.contains("sphere.png"), "{xml}");
    assert!(project.path().join("pictures/sphere.png").is_file());
}

#[test]
fn a_hook_of_pre_commit() {
    let Some(project) = Project::new() else { return };
    let [render, first, _] = &blocks(PNG, "sh")[..] else {
        panic!("expected three blocks: render, accept, compare");
    };
    for script in [render, first] {
        assert_eq!(project.sh(script).0, Some(0));
    }
    let [config] = &blocks("pre-commit", "yaml")[..] else {
        panic!("expected one block");
    };
    let entry = config
        .lines()
        .find_map(|line| line.trim().strip_prefix("entry: "));
    let entry = entry.expect("a hook has an entry");
    assert_eq!(project.sh(entry).0, Some(0));

    fs::write(project.path().join(".pre-commit-config.yaml"), config).unwrap();
    let (code, text) = project.sh("git init -q . && git add -A");
    assert_eq!(code, Some(0), "{text}");
    let hook = || project.command("pre-commit", &["run", "--all-files", "--verbose"]);
    let is_there = Command::new("pre-commit").arg("--version").output().is_ok();
    if is_there {
        let (code, text) = hook();
        assert_eq!((code, text.contains("Passed")), (Some(0), true), "{text}");
    } else {
        skipped("the hook runs without pre-commit, which is not installed");
    }
    project.break_renderer();
    assert_eq!(project.sh(render).0, Some(0));
    assert_eq!(project.sh(entry).0, Some(1));
    if is_there {
        let (code, text) = hook();
        assert_eq!((code, text.contains("Failed")), (Some(1), true), "{text}");
        assert!(text.contains("pixels have other codes"), "{text}");
    }
}
