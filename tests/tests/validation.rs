//! Validation where the reference is missing, or the driver is broken: told, and never a pass.

use serde_json::json;
use std::fs;
use std::time::{Duration, Instant};
use whitstone::registry;
use whitstone::validate::driver::{Driver, DriverError};
use whitstone::validate::environment::Environment;
use whitstone::validate::{Installation, Renderer, flatten};
use whitstone_tests::{program, root, scenes};

const SCENE: &str = "scenes/showcase/classic.toml";

/// Nothing was compared, so nothing differs: something is missing.
#[test]
fn a_missing_stored_reference_fails_visibly() {
    let folder = tempfile::tempdir().unwrap();
    let report = folder.path().join("report.json");
    let (references, target) = (folder.path().join("references"), folder.path().join("a target"));
    let scene = folder.path().join("scene.toml");
    fs::write(
        &scene,
        fs::read_to_string(root().join("scenes/shapes/disk.toml")).unwrap(),
    )
    .unwrap();
    let validate = |more: &[&str]| {
        let output = program!()
            .current_dir(root())
            .arg("validate")
            .arg(&scene)
            .args(["--reference", "stored"])
            .args(more)
            .arg("--references")
            .arg(&references)
            .arg("--target")
            .arg(&target)
            .arg("--json")
            .arg(&report)
            .output()
            .unwrap();
        let stdout = String::from_utf8_lossy(&output.stdout).into_owned();
        let stderr = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(3), "{stdout}{stderr}");
        assert!(
            stdout.contains("undecided") && stdout.contains("no stored reference"),
            "{stdout}"
        );
        assert!(
            stderr.contains("could not be compared with a reference: 1"),
            "{stderr}"
        );
        stdout
    };
    let scene_name = scene.display();
    let flags = format!(
        "--reference stored --references {} --target '{}'",
        references.display(),
        target.display()
    );
    let told = validate(&[]);
    // The words of both commands are complete, and the name is not that of a scene of the
    // repository.
    assert!(
        told.contains(&format!("reproduce: whitstone validate {scene_name} {flags}\n")),
        "{told}"
    );
    assert!(
        told.contains(&format!("whitstone reference --accept {scene_name} {flags}\n")),
        "{told}"
    );
    assert!(
        told.contains(&format!("undecided {}", folder.path().join("scene").display())),
        "{told}"
    );
    // A reference of a changed scene would take the place of the scene's own.
    let told = validate(&["--set", "camera.fov=30", "--set", "light[0].intensity=[1, 2, 3]"]);
    let changes = "--set camera.fov=30 --set 'light[0].intensity=[1, 2, 3]'";
    assert!(
        told.contains(&format!(
            "reproduce: whitstone validate {scene_name} {changes} {flags}\n"
        )),
        "{told}"
    );
    assert!(
        !told.contains("--accept") && told.contains("changed by `--set`"),
        "{told}"
    );
    let report: serde_json::Value = serde_json::from_slice(&fs::read(report).unwrap()).unwrap();
    assert_eq!(report["summary"]["passed"], 0);
    assert_eq!(report["results"][0]["status"], "undecided");
}

#[test]
fn a_missing_python_is_told_with_advice() {
    let folder = tempfile::tempdir().unwrap();
    let with_target = |command: &str| {
        let mut program = program!();
        program
            .current_dir(root())
            .env("WHITSTONE_PYTHON", "/nonexistent/python")
            .arg(command);
        program.arg("--target").arg(folder.path().join("target"));
        program
    };
    let output = with_target("validate")
        .args([SCENE, "--reference", "live"])
        .output()
        .unwrap();
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(3), "{stderr}");
    assert!(
        stderr.contains("/nonexistent/python") && stderr.contains("install one"),
        "{stderr}"
    );

    let report = folder.path().join("doctor.json");
    let output = with_target("doctor").arg("--json").arg(&report).output().unwrap();
    let (stdout, stderr) = (
        String::from_utf8_lossy(&output.stdout),
        String::from_utf8_lossy(&output.stderr),
    );
    assert_eq!(output.status.code(), Some(3), "{stdout}{stderr}");
    assert!(
        stdout.contains("NOT AVAILABLE") && stdout.contains("what to do"),
        "{stdout}"
    );
    let report: serde_json::Value = serde_json::from_slice(&fs::read(report).unwrap()).unwrap();
    assert_eq!(report["rendering"]["works"], true);
    assert_eq!(report["live"]["works"], false);
}

/// Without POV-Ray its stored references serve, and a warning says so.
#[test]
fn a_missing_povray_is_told() {
    let folder = tempfile::tempdir().unwrap();
    let validate = |reference: &str, scene: &str| {
        let output = program!()
            .current_dir(root())
            .env("WHITSTONE_POVRAY", "/nonexistent/povray")
            .args(["validate", scene, "--reference", reference, "--target"])
            .arg(folder.path().join("target"))
            .output()
            .unwrap();
        let text = String::from_utf8_lossy(&[&output.stdout[..], &output.stderr[..]].concat()).into_owned();
        (output.status.code(), text)
    };
    let (code, text) = validate("povray-live", "scenes/materials/phong.toml");
    assert_eq!(code, Some(3), "{text}");
    let (code, text) = validate("povray", "scenes/materials/phong.toml");
    assert_eq!(code, Some(0), "{text}");
    assert!(
        text.contains("warning: live POV-Ray is not available") && text.contains("stored"),
        "{text}"
    );
    // What was changed on both sides is told.
    let (code, text) = validate("povray-stored", "scenes/materials/whitted.toml");
    assert_eq!(code, Some(0), "{text}");
    assert!(
        text.contains("on both sides") && text.contains("at_max_depth"),
        "{text}"
    );
    // Where it has no stored reference and Mitsuba has one, nothing is compared: no pass.
    let (code, text) = validate("povray-stored", "scenes/shapes/heightfield.toml");
    assert_eq!(code, Some(3), "{text}");
    assert!(
        text.contains("skipped   shapes/heightfield") && text.contains("nothing was compared"),
        "{text}"
    );
    let (code, text) = validate("povray-stored", "scenes/materials");
    assert_eq!(code, Some(0), "{text}");
    assert!(
        text.contains("skipped") && !text.contains(" 0 scenes skipped"),
        "{text}"
    );
}

/// It is left out with a reason, or the driver understands all of it: a key that a driver does not
/// know would be an error in the midst of a run.
#[test]
fn every_scene_has_a_twin_in_povray_or_a_reason() {
    let environment = Environment::of_povray(&Installation::default()).unwrap();
    let mut driver = Driver::start(&environment, Duration::from_secs(120)).unwrap();
    let (mut twins, mut wrong) = (0, Vec::new());
    for path in scenes() {
        let flattened = flatten(&path, &[], &registry()).unwrap();
        let changes: Vec<_> = Renderer::POVRAY.adaptations_of(&flattened.text);
        let changes: Vec<_> = changes.into_iter().map(|adaptation| adaptation.change).collect();
        let flattened = flatten(&path, &changes, &registry()).unwrap();
        let request = json!({ "op": "write", "scene": flattened.text, "base": flattened.base });
        match driver.request(&request) {
            Ok(_) => twins += 1,
            Err(DriverError::Unsupported(reasons)) => assert!(!reasons.is_empty(), "{}", path.display()),
            Err(error) => wrong.push(format!("{}: {error}", path.display())),
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
    assert!(twins > 50, "{twins}");
}

/// The near limit of an orthographic camera is exported to POV-Ray. That of a perspective camera is
/// dropped with a note.
#[test]
fn near_limits_are_exported_to_povray_or_dropped_with_a_note() {
    let folder = tempfile::tempdir().unwrap();
    for (scene, dropped) in [
        ("scenes/showcase/near_planar.toml", true),
        ("scenes/showcase/near_orthographic.toml", false),
    ] {
        // The scenes also have layers, which are always dropped.
        for (strict, expected) in [(&[][..], 0), (&["--strict"][..], 2)] {
            let output = program!()
                .current_dir(root())
                .args(["convert", scene])
                .arg(folder.path().join("scene.pov"))
                .args(strict)
                .output()
                .unwrap();
            let text =
                String::from_utf8_lossy(&[&output.stdout[..], &output.stderr[..]].concat()).into_owned();
            assert_eq!(output.status.code(), Some(expected), "{scene}: {text}");
            assert_eq!(
                text.contains("[camera] near of perspective"),
                dropped,
                "{scene}: {text}"
            );
        }
    }
}

#[test]
fn outside_of_the_repository_it_is_told_that_there_are_no_scenes() {
    let folder = tempfile::tempdir().unwrap();
    let output = program!()
        .current_dir(folder.path())
        .arg("validate")
        .output()
        .unwrap();
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{stderr}");
    assert!(
        stderr.contains("scenes: no such file or folder; name scene files"),
        "{stderr}"
    );
    assert!(
        output.stdout.is_empty(),
        "{}",
        String::from_utf8_lossy(&output.stdout)
    );
}

#[test]
fn scenes_that_are_not_there_are_a_fault_of_usage() {
    let folder = tempfile::tempdir().unwrap();
    let output = program!()
        .current_dir(folder.path())
        .args(["validate", "--reference", "stored", "."])
        .output()
        .unwrap();
    assert_eq!(
        output.status.code(),
        Some(2),
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );
}

/// Programs in the driver's place that do everything wrong.
#[cfg(unix)]
mod broken_drivers {
    use super::{Duration, Instant, fs};
    use std::path::Path;
    use std::process::Command;
    use whitstone::validate::driver::{Driver, DriverError, SceneText, Setting};

    fn driver(script: &str, limit: Duration) -> Driver {
        let mut command = Command::new("sh");
        command.args(["-c", script]);
        Driver::spawn(command, limit).unwrap()
    }

    /// What comes of asking. The limit is for those that would answer in time; a busy machine is
    /// slow.
    fn hello(script: &str) -> DriverError {
        hello_within(script, Duration::from_secs(20))
    }

    fn hello_within(script: &str, limit: Duration) -> DriverError {
        let start = Instant::now();
        let mut driver = driver(script, limit);
        let error = driver.hello().unwrap_err();
        drop(driver);
        assert!(
            start.elapsed() < limit + whitstone_tests::ENDLESS,
            "{script}: {:?}",
            start.elapsed()
        );
        error
    }

    #[test]
    fn one_that_crashes() {
        let error = hello("echo no such library >&2; exit 7");
        let text = error.to_string();
        assert!(matches!(error, DriverError::Exited { .. }), "{text}");
        assert!(text.contains('7') && text.contains("no such library"), "{text}");
        let error = hello("read request; kill -SEGV $$");
        assert!(matches!(error, DriverError::Exited { .. }), "{error}");
        assert!(error.to_string().contains("signal"), "{error}");
    }

    #[test]
    fn one_that_ends_without_a_word() {
        assert!(matches!(hello("exit 0"), DriverError::Exited { .. }));
        assert!(matches!(
            hello("read request; exit 0"),
            DriverError::Exited { .. }
        ));
        assert!(matches!(hello("exec 1>&-; sleep 60"), DriverError::Exited { .. }));
    }

    #[test]
    fn one_that_prints_garbage() {
        for script in [
            "echo hello",
            "echo '{'",
            "echo '{}'",
            "echo 3",
            "echo '[]'",
            "echo '{\"ok\": \"yes\"}'",
            "echo '{\"ok\": true}'",
            "echo '{\"ok\": true, \"mitsuba\": 3}'",
            "printf '\\377\\376\\n'",
            "printf 'no end of line'",
            "head -c 300000 /dev/zero; echo",
        ] {
            let error = hello_within(
                &format!("read request; {script}; sleep 60"),
                Duration::from_secs(1),
            );
            let answered = matches!(
                error,
                DriverError::BadAnswer { .. } | DriverError::TimedOut { .. }
            );
            assert!(answered, "{script}: {error}");
        }
    }

    #[test]
    fn one_that_refuses() {
        let error =
            hello("read request; echo '{\"ok\": false, \"error\": \"no twin\", \"kind\": \"unsupported\"}'");
        assert!(
            matches!(&error, DriverError::Unsupported(text) if text == "no twin"),
            "{error}"
        );
        let error = hello("read request; echo '{\"ok\": false, \"error\": \"broken\"}'");
        assert!(
            matches!(&error, DriverError::Refused(text) if text == "broken"),
            "{error}"
        );
    }

    #[test]
    fn one_that_floods_standard_error() {
        let error = hello("yes flood | head -c 5000000 >&2; exit 1");
        assert!(matches!(error, DriverError::Exited { .. }), "{error}");
        assert!(error.to_string().len() < 100_000);
        // One line without an end must not be kept as a whole.
        let error = hello("head -c 50000000 /dev/zero >&2; exit 1");
        assert!(matches!(error, DriverError::Exited { .. }), "{error}");
        assert!(error.to_string().len() < 100_000);
    }

    #[test]
    fn one_that_does_not_read() {
        // A request that fills the pipe must not wait for a reader for ever.
        let start = Instant::now();
        let mut driver = driver("sleep 60", Duration::from_secs(1));
        let text = "x".repeat(1 << 20);
        let (sender, answer) = std::sync::mpsc::channel();
        std::thread::spawn(move || {
            let scene = SceneText {
                text: &text,
                base: Path::new("."),
            };
            let _ = sender.send(
                driver
                    .render(scene, Path::new("none.exr"), Setting::default(), 0)
                    .is_err(),
            );
        });
        let failed = answer.recv_timeout(whitstone_tests::ENDLESS);
        assert_eq!(failed, Ok(true), "still waiting after {:?}", start.elapsed());
    }

    #[test]
    fn one_that_says_it_wrote_a_picture() {
        let answer = r#"{"ok": true, "seconds": {"load": 0, "trace": 0}, "rays": {"closest": 1, "shadow": 1}, "twin": "native", "rehits": 0, "samples": 1}"#;
        let mut driver = driver(
            &format!("read request; echo '{answer}'; sleep 60"),
            Duration::from_secs(2),
        );
        let scene = SceneText {
            text: "",
            base: Path::new("."),
        };
        let folder = tempfile::tempdir().unwrap();
        let error = driver
            .render(scene, &folder.path().join("none.exr"), Setting::default(), 0)
            .unwrap_err();
        assert!(error.to_string().contains("wrote no image"), "{error}");
    }

    /// The driver and what it started, which writes its number into a file first.
    #[test]
    fn one_that_hangs_is_stopped_with_its_children() {
        let folder = tempfile::tempdir().unwrap();
        let (own, child) = (folder.path().join("own"), folder.path().join("child"));
        let script = format!(
            "echo $$ > {}; sh -c 'echo $$ > {}; exec sleep 60' & read request; wait",
            own.display(),
            child.display()
        );
        let error = hello_within(&script, Duration::from_secs(1));
        assert!(
            matches!(error, DriverError::TimedOut { seconds: 1, .. }),
            "{error}"
        );
        for file in [own, child] {
            let id: i32 = fs::read_to_string(&file).unwrap().trim().parse().unwrap();
            assert!(is_gone(id), "process {id} of {} is still there", file.display());
        }
    }

    /// Whether a process has ended, perhaps still to be collected by whoever adopted it.
    fn is_gone(id: i32) -> bool {
        for _ in 0..100 {
            let state = Command::new("ps")
                .args(["-o", "stat=", "-p", &id.to_string()])
                .output()
                .unwrap();
            let state = String::from_utf8_lossy(&state.stdout).trim().to_owned();
            if state.is_empty() || state.starts_with('Z') {
                return true;
            }
            std::thread::sleep(Duration::from_millis(20));
        }
        false
    }

    #[test]
    fn one_that_is_not_there() {
        let command = Command::new("/nonexistent/python");
        assert!(matches!(
            Driver::spawn(command, Duration::from_secs(1)),
            Err(DriverError::Io(_))
        ));
    }
}
