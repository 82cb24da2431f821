//! Ctrl-C and the request to terminate: what is finished is kept and marked, temporary files go,
//! no child stays, and the exit code tells the signal.
#![cfg(unix)]

use std::fs;
use std::process::{Child, Command, Output, Stdio};
use std::thread;
use std::time::{Duration, Instant};
use whitstone::image::{Limits, exr_io};
use whitstone_tests::{MITSUBA, entries, fake_python, root};

/// A scene that takes minutes.
const LONG: [&str; 6] = [
    "scenes/showcase/classic.toml",
    "--set",
    "film={width=3000,height=3000}",
    "--set",
    "sampler={type='grid',samples_per_axis=16}",
    "--threads=1",
];

fn start(arguments: &[&str]) -> Child {
    Command::new(env!("CARGO_BIN_EXE_whitstone-under-test"))
        .current_dir(root())
        .args(arguments)
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap()
}

fn send(signal: &str, process: u32) {
    let status = Command::new("kill").args([signal, &process.to_string()]).status();
    assert!(status.unwrap().success(), "kill {signal}");
}

/// Sends signals, and returns the output of the process with the time that it took to end.
fn interrupt(child: Child, signals: &[&str]) -> (Output, Duration) {
    thread::sleep(Duration::from_millis(1500));
    let start = Instant::now();
    for signal in signals {
        send(signal, child.id());
        thread::sleep(Duration::from_millis(50));
    }
    let output = child.wait_with_output().unwrap();
    (output, start.elapsed())
}

#[test]
fn a_kernel_does_not_outlive_the_command() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("process");
    let target = folder.path().display().to_string();
    let script = format!("echo $$ > {}; exec sleep 300", file.display());
    let arguments = ["stress", "--target", &target, "--kernel", "sh", "-c", &script];
    let child = start(&arguments);
    let read = || fs::read_to_string(&file).unwrap_or_default();
    let end = Instant::now() + Duration::from_secs(60);
    while read().is_empty() && Instant::now() < end {
        thread::sleep(Duration::from_millis(50));
    }
    let (output, _) = interrupt(child, &["-TERM"]);
    let text = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(143), "{text}");
    let process = read();
    let mut alive = Command::new("kill");
    alive.args(["-0", process.trim()]).stderr(Stdio::null());
    assert!(!alive.status().unwrap().success(), "the kernel still runs");
}

#[test]
fn a_rendering_keeps_what_is_finished() {
    for (signal, code) in [("-INT", 130), ("-TERM", 143)] {
        let folder = tempfile::tempdir().unwrap();
        let image = folder.path().join("part.exr");
        let out = image.display().to_string();
        let (output, took) = interrupt(
            start(&[&["render"], &LONG[..], &["-o", &out]].concat()),
            &[signal],
        );
        let text = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(code), "{text}");
        assert!(text.contains("the others are black"), "{text}");
        assert!(took < whitstone_tests::ENDLESS, "{took:?}");
        let read = exr_io::read(&image, Limits::IMAGE).unwrap();
        assert_eq!(
            read.attributes().get("unfinished").map(String::as_str),
            Some("true")
        );
        let red = read.channel("R").unwrap();
        let black = red.iter().filter(|&&value| value == 0.0).count();
        assert!(0 < black && black < red.len(), "{black} of {}", red.len());
        assert_eq!(entries(folder.path()), ["part.exr"]);
    }
}

#[test]
fn a_second_signal_ends_at_once() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("part.exr").display().to_string();
    // With so few threads and such tiles, a first signal alone would be obeyed later.
    let slow = ["--set", "integrator.max_depth=1"];
    let arguments = [&["render"], &LONG[..], &slow, &["-o", &out]].concat();
    let (output, _) = interrupt(start(&arguments), &["-INT", "-INT"]);
    assert_eq!(output.status.code(), Some(130));
    let left = entries(folder.path());
    assert!(left.iter().all(|name| name == "part.exr"), "{left:?}");
}

#[test]
fn a_validation_reports_what_is_finished_and_ends_the_driver() {
    let folder = tempfile::tempdir().unwrap();
    // It tells its process, and never answers.
    let behaviour = format!("echo $$ > {}/process; sleep 100", folder.path().display());
    fake_python(folder.path(), MITSUBA, &behaviour).unwrap();
    let target = folder.path().join("target");
    let child = Command::new(env!("CARGO_BIN_EXE_whitstone-under-test"))
        .current_dir(root())
        .env("WHITSTONE_PYTHON", folder.path().join("python"))
        .args(["validate", "--reference", "live", "--no-oracle"])
        .args(["scenes/shapes/sphere.toml", "scenes/shapes/disk.toml"])
        .arg("--target")
        .arg(&target)
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let process = folder.path().join("process");
    let start = Instant::now();
    while !process.exists() && start.elapsed() < Duration::from_secs(30) {
        thread::sleep(Duration::from_millis(20));
    }
    let (output, took) = interrupt(child, &["-INT"]);
    let text = String::from_utf8_lossy(&[&output.stdout[..], &output.stderr[..]].concat()).into_owned();
    assert_eq!(output.status.code(), Some(130), "{text}");
    assert!(text.contains("no result of 2 scenes"), "{text}");
    assert!(took < whitstone_tests::ENDLESS, "{took:?}");
    let results = fs::read_to_string(target.join("validate/results.json")).unwrap();
    let results: serde_json::Value = serde_json::from_str(&results).unwrap();
    assert_eq!(results["summary"]["not_run"], 2);
    // The driver and its child are gone.
    let process = fs::read_to_string(process).unwrap();
    let alive = Command::new("kill")
        .args(["-0", process.trim()])
        .stderr(Stdio::null())
        .status();
    assert!(!alive.unwrap().success(), "the driver {process} is alive");
    let left = entries(&target.join("live"));
    assert!(left.iter().all(|name| !name.ends_with(".tmp")), "{left:?}");
}
