//! A Mitsuba that is there and does not do its work: exit code 3 where it was asked for, stored
//! references and a warning where it was not.
#![cfg(unix)]

use std::fs;
use std::path::Path;
use std::process::Output;
use whitstone_tests::{MITSUBA, fake_python, program, root};

const SCENE: &str = "scenes/shapes/sphere.toml";

fn validate(version: &str, behaviour: &str, reference: &str) -> (Output, String) {
    let folder = tempfile::tempdir().unwrap();
    validate_in(folder.path(), version, behaviour, reference)
}

/// The same with the fake and the results in a folder.
fn validate_in(folder: &Path, version: &str, behaviour: &str, reference: &str) -> (Output, String) {
    fake_python(folder, version, behaviour).unwrap();
    run(folder, reference)
}

/// Validates with the Python in a folder.
fn run(folder: &Path, reference: &str) -> (Output, String) {
    let output = program!()
        .current_dir(root())
        .env("WHITSTONE_PYTHON", folder.join("python"))
        .args(["validate", SCENE, "--time-limit", "2", "--reference", reference])
        .arg("--target")
        .arg(folder.join("target"))
        .output()
        .unwrap();
    let text = String::from_utf8_lossy(&[&output.stdout[..], &output.stderr[..]].concat()).into_owned();
    (output, text)
}

const BROKEN: [(&str, &str, &str); 5] = [
    ("exit 9", "ended", "a crash"),
    ("sleep 100", "gave no answer", "a hang"),
    (
        "echo good morning",
        "gave an invalid answer",
        "an answer that is none",
    ),
    (
        r#"echo '{"ok":true,"seconds":{"load":0,"trace":0},"rays":{"closest":1,"shadow":0},"twin":"native","rehits":0,"samples":1}'"#,
        "wrote no image",
        "no image",
    ),
    (
        r#"echo '{"ok":false,"kind":"internal","error":"out of luck"}'"#,
        "out of luck",
        "a refusal",
    ),
];

#[test]
fn asked_for_it_ends_in_exit_code_3_with_the_reason() {
    for (behaviour, expected, what) in BROKEN {
        let (output, text) = validate(MITSUBA, behaviour, "live");
        assert_eq!(output.status.code(), Some(3), "{what}: {text}");
        assert!(text.contains(expected), "{what}: {text}");
    }
}

#[test]
fn not_asked_for_the_stored_references_serve_with_a_warning() {
    for (behaviour, expected, what) in BROKEN {
        let (output, text) = validate(MITSUBA, behaviour, "auto");
        assert_eq!(output.status.code(), Some(0), "{what}: {text}");
        assert!(
            text.contains("warning") && text.contains(expected),
            "{what}: {text}"
        );
        assert!(text.contains("stored"), "{what}: {text}");
    }
}

#[test]
fn another_version_is_refused() {
    let (output, text) = validate("3.10.0", "exit 9", "live");
    assert_eq!(output.status.code(), Some(3), "{text}");
    assert!(text.contains("3.10.0 is installed, 3.9.1 is pinned"), "{text}");
}

/// On a machine without LLVM the environment has one of its own.
#[test]
#[cfg(all(target_os = "linux", target_arch = "x86_64"))]
fn llvm_is_installed_where_there_is_none() {
    for (has_llvm, expected) in [
        (true, &["requirements.txt"][..]),
        (false, &["requirements.txt", "requirements-llvm.txt"]),
    ] {
        let folder = tempfile::tempdir().unwrap();
        fake_python(folder.path(), MITSUBA, "exit 9").unwrap();
        let python = folder.path().join("python");
        let log = folder.path().join("installed");
        let pip = format!("\"-m pip\") echo \"$@\" >>'{}' ;;", log.display());
        let llvm = format!("\"-m whitstone_mitsuba.llvm\") {has_llvm} ;;");
        let script = fs::read_to_string(&python).unwrap();
        let changed = script.replace("\"-m pip\") ;;", &format!("{pip}\n{llvm}"));
        assert_ne!(script, changed);
        fs::write(&python, changed).unwrap();
        let (_, text) = run(folder.path(), "live");
        let installed = fs::read_to_string(&log).unwrap_or_else(|error| panic!("{error}: {text}"));
        let files = installed
            .lines()
            .map(|line| line.rsplit('/').next().unwrap_or(line));
        assert_eq!(files.collect::<Vec<_>>(), expected, "{text}");
        assert_eq!(text.contains("installing LLVM"), !has_llvm, "{text}");
    }
}

#[test]
fn links_in_the_cache_are_not_followed() {
    let folder = tempfile::tempdir().unwrap();
    let (_, text) = validate_in(folder.path(), MITSUBA, "exit 9", "live");
    let cache = folder.path().join("target/live");
    let entries = fs::read_dir(&cache).unwrap_or_else(|error| panic!("{error}: {text}"));
    let kept = entries.map(|entry| entry.unwrap().path());
    let hello = kept.filter(|path| path.extension().is_some_and(|extension| extension == "json"));
    let [hello] = hello.collect::<Vec<_>>().try_into().unwrap();
    let victim = folder.path().join("victim");
    fs::write(&victim, "precious").unwrap();
    fs::remove_file(&hello).unwrap();
    std::os::unix::fs::symlink(&victim, &hello).unwrap();
    validate_in(folder.path(), MITSUBA, "exit 9", "live");
    assert_eq!(fs::read_to_string(&victim).unwrap(), "precious");
    assert!(hello.symlink_metadata().unwrap().is_file());
}
