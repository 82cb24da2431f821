//! The files that commands write: whole ones, in their own places, or none.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Output;
use whitstone::image::{Limits, exr_io};
use whitstone_tests::{entries, program, root, skipped};

fn run(arguments: &[&str]) -> Output {
    program!().current_dir(root()).args(arguments).output().unwrap()
}

fn stderr(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// Whether the file system keeps this user from writing into a folder without permission; it does
/// not keep root.
#[cfg(unix)]
fn permissions_count(folder: &Path) -> bool {
    fs::write(folder.join("probe"), "").is_err()
}

#[test]
fn output_that_cannot_be_written_leaves_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let place = |name: &str| folder.path().join(name);
    fs::create_dir(place("folder.exr")).unwrap();
    fs::create_dir(place("folder.json")).unwrap();
    fs::write(place("file"), "").unwrap();
    let mut cases: Vec<(PathBuf, i32)> = vec![
        (place("folder.exr"), 3),
        (place("none/image.exr"), 3),
        (place("file/image.exr"), 3),
        (place("image.bmp"), 2),
        (place("image"), 2),
    ];
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt as _;
        fs::create_dir(place("locked")).unwrap();
        fs::set_permissions(place("locked"), fs::Permissions::from_mode(0o555)).unwrap();
        if permissions_count(&place("locked")) {
            cases.push((place("locked/image.exr"), 3));
        } else {
            skipped("a folder without permission (this user may write anywhere)");
            fs::remove_file(place("locked/probe")).unwrap();
        }
    }
    let before = entries(folder.path());
    for (path, expected) in cases {
        let output = program!()
            .current_dir(root())
            .args([
                "render",
                "scenes/showcase/classic.toml",
                "--set",
                "film={width=8,height=8}",
                "-o",
            ])
            .arg(&path)
            .output()
            .unwrap();
        assert_eq!(
            output.status.code(),
            Some(expected),
            "{}: {}",
            path.display(),
            stderr(&output)
        );
        let named = path.file_name().unwrap().to_string_lossy().into_owned();
        assert!(
            stderr(&output).contains(&named),
            "{}: {}",
            path.display(),
            stderr(&output)
        );
        assert_eq!(entries(folder.path()), before, "{}", path.display());
        assert!(entries(&place("folder.exr")).is_empty());
        // The file that is written first is no one's business.
        assert!(!stderr(&output).contains("temporary"), "{}", stderr(&output));
    }
    let output = program!()
        .current_dir(root())
        .args(["explain", "scenes/showcase/classic.toml", "--json"])
        .arg(place("folder.json"))
        .output()
        .unwrap();
    assert_eq!(output.status.code(), Some(3), "{}", stderr(&output));
    assert_eq!(entries(folder.path()), before);
}

/// No result takes the place of another, of the scene, or of what the scene reads.
#[test]
fn outputs_are_files_of_their_own() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).display().to_string();
    let texture = "reflectance = { type = \"image\", file = \"tex.png\" }";
    let scene = format!(
        "film = {{ width = 4, height = 4 }}\n[camera]\ntype = \"perspective\"\n\
         look_at = {{ origin = [0, 0, 5], target = [0, 0, 0] }}\n[[shape]]\ntype = \"sphere\"\n\
         material = {{ type = \"matte\", {texture} }}\n"
    );
    fs::write(path("s.toml"), &scene).unwrap();
    fs::copy(root().join("scenes/assets/checker.png"), path("tex.png")).unwrap();
    let before = fs::read(path("tex.png")).unwrap();
    for (arguments, told) in [
        (["-o", "a.exr", "--json", "a.exr"], "two results"),
        (["-o", "a.exr", "--json", "s.toml"], "the scene reads this file"),
        (["-o", "tex.png", "--json", "a.json"], "the scene reads this file"),
    ] {
        let places = [arguments[1], arguments[3]].map(path);
        let scene = path("s.toml");
        let output = run(&[
            "render",
            &scene,
            arguments[0],
            &places[0],
            arguments[2],
            &places[1],
        ]);
        assert_eq!(output.status.code(), Some(2), "{arguments:?}");
        assert!(stderr(&output).contains(told), "{}", stderr(&output));
    }
    assert_eq!(fs::read_to_string(path("s.toml")).unwrap(), scene);
    assert_eq!(fs::read(path("tex.png")).unwrap(), before);
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 2);
    let output = run(&[
        "render",
        &path("s.toml"),
        "-o",
        &path("a.exr"),
        "--json",
        &path("a.json"),
    ]);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
}

/// `--json -`: standard output is one JSON document, and the text for people is elsewhere.
#[test]
fn json_on_standard_output_is_alone() {
    let folder = tempfile::tempdir().unwrap();
    let image = folder.path().join("image.exr").display().to_string();
    let scene = "scenes/shapes/sphere.toml";
    let json = |arguments: &[&str]| {
        let output = run(arguments);
        assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
        assert!(!stderr(&output).is_empty(), "the text for people");
        let value: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
        value
    };
    let rendered = json(&["render", scene, "-o", &image, "--json", "-"]);
    assert_eq!(rendered["output"], image.as_str());
    assert!(json(&["explain", scene, "--json", "-"]).is_object());
    assert!(json(&["compare", &image, &image, "--json=-"]).is_object());
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
}

#[test]
fn an_image_that_cannot_hold_its_radiance_is_told() {
    let folder = tempfile::tempdir().unwrap();
    let scene = folder.path().join("bright.toml");
    let report = folder.path().join("report.json");
    let render = |radiance: &str| {
        let text = format!(
            "film = {{ width = 8, height = 4 }}\ncamera = {{ type = \"environment\", look_at = {{ origin = [0, 0, 0], target = [0, 0, 1] }} }}\n\
             light = [{{ type = \"background\", radiance = {radiance} }}]\n\
             shape = [{{ type = \"sphere\", center = [0, 0, 3], material = {{ type = \"mirror\" }} }}]\n"
        );
        fs::write(&scene, text).unwrap();
        let [scene, report] = [&scene, &report].map(|path| path.to_str().unwrap());
        let output = folder.path().join("image.exr");
        let output = run(&["render", scene, "-o", output.to_str().unwrap(), "--json", report]);
        assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
        let report: serde_json::Value = serde_json::from_slice(&fs::read(report).unwrap()).unwrap();
        (stderr(&output), report["not_finite"].as_u64().unwrap())
    };
    let (told, unfit) = render("1e39");
    assert!(told.contains("warning: 32 of 32 pixels are not finite"), "{told}");
    assert_eq!(unfit, 32);
    assert_eq!(render("1e38"), (String::new(), 0));
}

/// The scene in README is the first that a stranger writes: it shows something.
#[test]
fn the_scene_in_the_readme_is_a_picture() {
    let readme = fs::read_to_string(root().join("README.md")).unwrap();
    let (_, behind) = readme.split_once("```toml\n").unwrap();
    let (scene, _) = behind.split_once("```").unwrap();
    let folder = tempfile::tempdir().unwrap();
    let place = |name: &str| folder.path().join(name).display().to_string();
    fs::write(place("scene.toml"), scene).unwrap();
    let size = "film={width=48,height=48}";
    let output = run(&[
        "render",
        &place("scene.toml"),
        "--set",
        size,
        "-o",
        &place("image.exr"),
    ]);
    assert!(output.status.success(), "{}", stderr(&output));
    let image = exr_io::read(place("image.exr"), Limits::IMAGE).unwrap();
    let green = image.channel("G").unwrap();
    let lit = green.iter().filter(|&&value| value > 0.01).count();
    assert!(
        4 * lit > 3 * green.len(),
        "{lit} of {} pixels are lit",
        green.len()
    );
}

#[test]
fn render_asks_before_the_work_whether_the_picture_can_be_written() {
    let folder = tempfile::tempdir().unwrap();
    let missing = folder.path().join("none").display().to_string();
    // It would take hours.
    let long = [
        "film={width=8192,height=8192}",
        "sampler={type='grid',samples_per_axis=32}",
    ];
    let (scene, output) = ("scenes/showcase/classic.toml", format!("{missing}/image.exr"));
    let output = run(&["render", scene, "--set", long[0], "--set", long[1], "-o", &output]);
    assert_eq!(output.status.code(), Some(3));
    let told = stderr(&output);
    assert!(
        told.contains(&format!("the folder {missing} does not exist")),
        "{told}"
    );
}
