//! The recipes of docs/ci.md, run as they stand there: a renderer in C++ that only writes PNG, and
//! pre-commit. Those for pytest are in crates/python/tests. And the shell steps of action.yml.
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

/// A step of action.yml: its script.
fn step(name: &str) -> String {
    let text = fs::read_to_string(root().join("action.yml")).unwrap();
    let step = text.split(&format!("\n    - name: {name}\n")).nth(1);
    let step = step.unwrap_or_else(|| panic!("action.yml has no step {name}"));
    let step = step.split("\n    - name: ").next().unwrap();
    let script = step.split("\n      run: |\n").nth(1);
    let script = script.unwrap_or_else(|| panic!("the step {name} has no script"));
    let lines = script
        .lines()
        .map(|line| line.strip_prefix("        ").unwrap_or(line));
    lines.collect::<Vec<_>>().join("\n")
}

/// What a runner of GitHub Actions gives to steps, with a program `curl` that has one release.
struct Runner(tempfile::TempDir);

impl Runner {
    fn new() -> Self {
        let runner = Self(tempfile::tempdir().unwrap());
        let at = |name: &str| runner.0.path().join(name);
        let stored = "work/references/images/shapes/sphere";
        for folder in [
            "bin",
            "temp",
            "work/renders",
            "work/scenes/shapes",
            stored,
            "release",
        ] {
            fs::create_dir_all(at(folder)).unwrap();
        }
        let name = "whitstone-1.2.3-x86_64-unknown-linux-gnu";
        fs::create_dir(at(name)).unwrap();
        symlink(
            env!("CARGO_BIN_EXE_whitstone-under-test"),
            at(name).join("whitstone"),
        )
        .unwrap();
        let archive = format!(
            "tar -czf release/{name}.tar.gz {name} && cd release && sha256sum {name}.tar.gz >{name}.tar.gz.sha256"
        );
        assert_eq!(runner.bash(&archive, runner.0.path(), &[]).0, Some(0));
        // The last argument is the address.
        let curl = "#!/bin/sh\nfor url; do :; done\necho \"$url\"\ncp \"$RELEASE/${url##*/}\" .\n";
        fs::write(at("bin/curl"), curl).unwrap();
        let mode = std::os::unix::fs::PermissionsExt::from_mode(0o755);
        fs::set_permissions(at("bin/curl"), mode).unwrap();
        runner
    }

    fn bash(&self, script: &str, folder: &Path, more: &[(&str, &str)]) -> (Option<i32>, String) {
        let at = |name: &str| self.0.path().join(name);
        let path = std::env::var("PATH").unwrap_or_default();
        let added = fs::read_to_string(at("path")).unwrap_or_default();
        let added: String = added.lines().map(|line| format!("{line}:")).collect();
        // As GitHub runs `shell: bash`.
        let output = Command::new("bash")
            .args(["--noprofile", "--norc", "-eo", "pipefail", "-c", script])
            .current_dir(folder)
            .env("PATH", format!("{added}{}:{path}", at("bin").display()))
            .env("RELEASE", at("release"))
            .env("RUNNER_OS", "Linux")
            .env("RUNNER_ARCH", "X64")
            .env("RUNNER_TEMP", at("temp"))
            .env("GITHUB_PATH", at("path"))
            .env("GITHUB_STEP_SUMMARY", at("summary.md"))
            .env("RUST_BACKTRACE", "0")
            .envs(more.iter().copied())
            .output()
            .unwrap();
        let text = [&output.stdout[..], &output.stderr[..]].concat();
        (output.status.code(), String::from_utf8_lossy(&text).into_owned())
    }

    fn install(&self, version: &str, arch: &str) -> (Option<i32>, String) {
        let more = [
            ("VERSION", version),
            ("REPOSITORY", "someone/whitstone"),
            ("RUNNER_ARCH", arch),
        ];
        self.bash(&step("Install"), &self.0.path().join("work"), &more)
    }

    fn run(&self, command: &str) -> (Option<i32>, String) {
        self.bash(&step("Run"), &self.0.path().join("work"), &[("COMMAND", command)])
    }
}

#[test]
fn the_steps_of_the_action() {
    let runner = Runner::new();
    let at = |name: &str| runner.0.path().join(name);
    let (code, text) = runner.install("1.2.3", "X64");
    assert_eq!(code, Some(0), "{text}");
    let address = "https://github.com/someone/whitstone/releases/download/v1.2.3/whitstone-1.2.3-x86_64-unknown-linux-gnu.tar.gz";
    assert!(text.contains(address) && text.contains("OK"), "{text}");

    // The program that was installed is the one that runs.
    let scene = "scenes/shapes/sphere.toml";
    fs::copy(root().join(scene), at("work").join(scene)).unwrap();
    let stored = "references/images/shapes/sphere";
    for entry in fs::read_dir(root().join(stored)).unwrap() {
        let entry = entry.unwrap();
        let copy = at("work").join(stored).join(entry.file_name());
        fs::copy(entry.path(), copy).unwrap();
    }
    let image = root().join(stored).join("mitsuba.exr");
    fs::copy(&image, at("work/renders/a b.exr")).unwrap();
    fs::create_dir(at("work/accepted")).unwrap();
    fs::copy(&image, at("work/accepted/a b.exr")).unwrap();
    let (code, text) = runner.run("compare renders accepted");
    assert_eq!(code, Some(0), "{text}");
    let xml = fs::read_to_string(at("work/whitstone.xml")).unwrap();
    assert!(xml.contains("a b.exr"), "{xml}");
    // Words are not expanded, and the exit code is that of the command.
    let (code, text) = runner.run("compare renders $HOME/*");
    assert_eq!(code, Some(2), "{text}");
    assert!(text.contains("$HOME/*"), "{text}");
    let (code, text) = runner.run(&format!("validate {scene} --reference stored"));
    assert_eq!(code, Some(0), "{text}");
    let summary = fs::read_to_string(at("summary.md")).unwrap();
    assert!(summary.contains("sphere"), "{summary}");

    // An archive that is not the published one, a release that is not there, another processor.
    let archive = at("release/whitstone-1.2.3-x86_64-unknown-linux-gnu.tar.gz");
    fs::write(archive, "another").unwrap();
    assert_eq!(runner.install("1.2.3", "X64").0, Some(1));
    assert_eq!(runner.install("9.9.9", "X64").0, Some(1));
    let (code, text) = runner.install("1.2.3", "S390X");
    assert_eq!(code, Some(3), "{text}");
    assert!(
        text.contains("::error::there is no release for Linux S390X"),
        "{text}"
    );
}
