//! `report`, `validate --junit` and what they keep.

use serde_json::Value;
use std::fs;
use std::path::Path;
use std::process::Output;
use whitstone_tests::{program, root};

const SCENES: [&str; 2] = ["scenes/shapes/sphere.toml", "scenes/shapes/box.toml"];

fn run(arguments: &[&str]) -> Output {
    program!().current_dir(root()).args(arguments).output().unwrap()
}

fn check(arguments: &[&str], code: i32, parts: &[&str]) -> String {
    let output = run(arguments);
    let text = String::from_utf8_lossy(&output.stdout) + String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(code), "{arguments:?}: {text}");
    for part in parts {
        assert!(text.contains(part), "{arguments:?}: {part} is not in {text}");
    }
    text.into_owned()
}

fn validate(target: &str, extra: &[&str]) {
    let fixed = ["validate", "--reference", "stored", "--target", target];
    check(&[&fixed[..], &SCENES, extra].concat(), 0, &["2 passed"]);
}

fn changed(path: &Path, change: impl Fn(&mut Value)) -> String {
    let mut value: Value = serde_json::from_slice(&fs::read(path).unwrap()).unwrap();
    change(&mut value);
    let old = path.with_file_name("old.json");
    fs::write(&old, value.to_string()).unwrap();
    old.to_str().unwrap().to_owned()
}

#[test]
fn a_report_is_written_anew_and_says_what_changed() {
    let folder = tempfile::tempdir().unwrap();
    let target = folder.path().to_str().unwrap();
    let junit = folder.path().join("all.xml");
    check(
        &["report", "--target", target],
        2,
        &["results.json", "whitstone validate"],
    );
    validate(target, &["--junit", junit.to_str().unwrap()]);
    let junit = fs::read_to_string(junit).unwrap();
    assert!(
        junit.contains("tests=\"2\" skipped=\"0\" errors=\"0\" failures=\"0\""),
        "{junit}"
    );
    assert!(junit.contains("<testcase name=\"shapes/sphere\" classname=\"whitstone validate\""));

    let at = |name: &str| folder.path().join("validate").join(name);
    let written = fs::read_to_string(at("index.html")).unwrap();
    assert!(written.contains("<option value=\"shape/sphere\">") && written.contains("data-pixels=\"eN"));
    fs::remove_file(at("index.html")).unwrap();
    check(&["report", "--target", target], 0, &["report: "]);
    assert!(
        fs::read_to_string(at("index.html")).unwrap() == written,
        "another page of the same results"
    );

    let table = folder.path().join("table.md");
    let table_path = table.to_str().unwrap();
    check(&["report", "--target", target, "--markdown", table_path], 0, &[]);
    let table = fs::read_to_string(table).unwrap();
    assert!(
        table.starts_with("### Whitstone: 2 passed, 0 confirmed, 0 failed"),
        "{table}"
    );
    assert!(table.contains("| pass | shapes/sphere |"), "{table}");

    let results = at("results.json");
    let same = changed(&results, |_| {});
    let with = |old: &str| ["report", "--target", target, "--baseline", old].map(str::to_owned);
    let baseline = |old: &str, code, parts: &[&str]| {
        let arguments = with(old);
        check(&arguments.each_ref().map(String::as_str), code, parts)
    };
    baseline(&same, 0, &["2 cases unchanged, 0 changes"]);
    let better = changed(&results, |old| {
        old["results"][0]["status"] = "fail".into();
        old["results"][0]["unexplained"] = 3.into();
    });
    baseline(
        &better,
        0,
        &["better", "verdict: FAIL -> pass", "pixels unexplained: 3 -> 0"],
    );
    let gone = changed(&results, |old| old["results"][0]["scene"] = "shapes/gone".into());
    baseline(&gone, 1, &["broken   shapes/gone", "1 broken and 0 worse"]);
    let page = fs::read_to_string(at("index.html")).unwrap();
    assert!(page.contains("Since the baseline") && page.contains("shapes/gone"));

    fs::write(at("old.json"), "{\"results\": [\n3]}").unwrap();
    baseline(&same, 2, &["old.json", "line 2 column"]);
    fs::remove_file(at("old.json")).unwrap();
    baseline(&same, 2, &["old.json"]);
    // Pictures that belong to other results are not used.
    fs::write(at("pictures.json"), "[]").unwrap();
    check(&["report", "--target", target], 0, &["warning: ", "no pictures"]);
}

#[cfg(target_os = "linux")]
#[test]
fn the_page_is_opened_by_the_system() {
    use std::os::unix::fs::PermissionsExt;

    let folder = tempfile::tempdir().unwrap();
    let target = folder.path().join("target");
    validate(target.to_str().unwrap(), &[]);
    let (bin, opened) = (folder.path().join("bin"), folder.path().join("opened"));
    fs::create_dir(&bin).unwrap();
    let open = |script: Option<&str>| {
        let program = bin.join("xdg-open");
        let _ = fs::remove_file(&program);
        if let Some(script) = script {
            fs::write(&program, format!("#!/bin/sh\n{script}\n")).unwrap();
            fs::set_permissions(&program, fs::Permissions::from_mode(0o755)).unwrap();
        }
        let mut command = program!();
        command
            .current_dir(root())
            .env("PATH", &bin)
            .args(["report", "--open", "--target"])
            .arg(&target);
        let output = command.output().unwrap();
        (
            output.status.code(),
            String::from_utf8_lossy(&output.stderr).into_owned(),
        )
    };
    let (code, text) = open(Some(&format!("echo \"$1\" > {}", opened.display())));
    assert_eq!(code, Some(0), "{text}");
    let page = fs::read_to_string(opened).unwrap();
    assert!(Path::new(page.trim()).is_absolute() && Path::new(page.trim()).ends_with("validate/index.html"));
    for (script, told) in [
        (None, "there is no `xdg-open`"),
        (Some("exit 3"), "ended with exit status: 3"),
    ] {
        let (code, text) = open(script);
        assert_eq!(code, Some(3), "{text}");
        assert!(text.contains(told) && text.contains("by hand"), "{text}");
    }
}
