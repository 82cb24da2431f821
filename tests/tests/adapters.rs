//! The adapters of `subjects`, where their renderers are installed: each renders the probes of
//! `conventions` by the conventions that its table states. The kernel answers rays. The others are
//! skipped, and reported.

use std::process::{Command, Stdio};
use whitstone_tests::{program, root, skipped};

/// Whether a program ends with success.
fn works(name: &str, arguments: &[&str]) -> bool {
    let mut command = Command::new(name);
    command
        .args(arguments)
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(Stdio::null());
    command.status().is_ok_and(|status| status.success())
}

/// The findings about a subject, unless one of the programs that it needs is missing.
fn check(subject: &str, needs: &[(&str, &[&str])]) {
    if let Some((name, arguments)) = needs.iter().find(|(name, arguments)| !works(name, arguments)) {
        let tried = arguments.join(" ");
        skipped(&format!("{subject}: `{name} {tried}` does not work here"));
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let output = program!()
        .current_dir(root())
        .args([
            "conventions",
            "--config",
            "subjects/whitstone.toml",
            "--subject",
            subject,
            "--target",
        ])
        .arg(folder.path())
        .output()
        .unwrap();
    let text = String::from_utf8_lossy(&[&output.stdout[..], &output.stderr[..]].concat()).into_owned();
    assert_eq!(output.status.code(), Some(0), "{text}");
    assert!(text.contains(&format!("{subject}: 0 findings")), "{text}");
}

/// The verdict on a kernel of `subjects`.
fn check_kernel(name: &str, file: &str, needs: &str) {
    if !works("python3", &["-c", needs]) {
        skipped(&format!("{name}: `python3 -c '{needs}'` does not work here"));
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let output = program!()
        .current_dir(root())
        .args(["stress", "--rays", "20000", "--target"])
        .arg(folder.path())
        .args(["--kernel", "python3", file])
        .output()
        .unwrap();
    let text = String::from_utf8_lossy(&[&output.stdout[..], &output.stderr[..]].concat()).into_owned();
    assert_eq!(output.status.code(), Some(0), "{text}");
    assert!(text.ends_with("pass\n"), "{text}");
}

const NUMPY: (&str, &[&str]) = ("python3", &["-c", "import numpy, tomllib"]);

#[test]
fn cycles() {
    check("cycles", &[NUMPY, ("python3", &["-c", "import bpy"])]);
}

#[test]
fn embreex() {
    check_kernel("embreex", "subjects/embreex_kernel.py", "import numpy, embreex");
}

#[test]
fn luxcore() {
    // NumPy comes first, as in the adapter.
    check(
        "luxcore",
        &[NUMPY, ("python3", &["-c", "import numpy, pyluxcore"])],
    );
}

#[test]
fn mitsuba() {
    check("mitsuba", &[NUMPY, ("python3", &["-c", "import mitsuba"])]);
}

#[test]
fn povray() {
    check("povray", &[("povray", &["--version"])]);
}

#[test]
fn tachyon() {
    // It has no argument that only prints the version.
    check("tachyon", &[NUMPY, ("sh", &["-c", "command -v tachyon"])]);
}

#[test]
fn threejs() {
    // The package is where the adapter looks for it.
    let three = format!(
        "test -e \"${{WHITSTONE_THREE:-{}/target/tools/three}}/node_modules/three/package.json\"",
        root().display()
    );
    check(
        "threejs",
        &[NUMPY, ("chromium", &["--version"]), ("sh", &["-c", &three])],
    );
}
