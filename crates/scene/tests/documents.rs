//! Scene documents: merging, overrides, positions of errors. These tests need no plugin.

use std::fs;
use std::path::Path;
use whitstone_core::{DVec3, Registry, SceneErrors};
use whitstone_scene::{Description, Sources};

const SCENE: &str = r#"
[camera]
type = "perspective"
fov = 40

[material.floor]
type = "matte"
reflectance = { type = "checker", a = { type = "constant", value = 0.5 } }

[[shape]]
type = "plane"
material = "floor"

[[shape]]
id = "ball"
type = "sphere"
radius = 2
transform = { translate = [0, 1, 0] }
"#;

fn sources(text: &str, sets: &[&str]) -> Sources {
    let sets: Vec<String> = sets.iter().map(|s| (*s).to_owned()).collect();
    Sources::from_text("scene.toml", text, Path::new("."), &sets).unwrap()
}

/// Long documents are flattened in another thread.
#[test]
fn long_documents_are_flattened_as_short_ones() {
    let flattened = |text: &str| {
        let sources = sources(text, &[]);
        let description = Description::parse(&sources).into_result().unwrap();
        (description.flattened.text.clone(), description.flattened.hash)
    };
    let padding = format!("#{}\n", " ".repeat(2 << 20));
    assert_eq!(flattened(&format!("{SCENE}{padding}")), flattened(SCENE));
    let wrong = "\n[[shape]]\ntype = 99999999999999999999\n";
    let lines = |text: String| errors(&text, &[]);
    let found = lines(format!("{SCENE}{wrong}"));
    assert!(!found.is_empty());
    assert_eq!(lines(format!("{SCENE}{wrong}{padding}")), found);
}

/// The halves of long lists are copied in two threads.
#[test]
fn long_lists_keep_their_order() {
    let shape = |file: usize| format!("[[shape]]\ntype = \"mesh\"\nfile = \"{file}.ply\"\n");
    let list = |count: usize| -> String { (0..count).map(shape).collect() };
    let sources = sources(&format!("{SCENE}{}", list(10_001)), &[]);
    let flattened = Description::parse(&sources).into_result().unwrap().flattened;
    let files: Vec<String> = flattened
        .files
        .iter()
        .map(|path| path.display().to_string())
        .collect();
    let expected: Vec<String> = (0..10_001)
        .map(|file| Path::new(".").join(format!("{file}.ply")).display().to_string())
        .collect();
    assert_eq!(files, expected);
    let at = |file: usize| flattened.text.find(&format!("\"{file}.ply\"")).unwrap();
    assert!((1..10_001).all(|file| at(file - 1) < at(file)));
    let wrong = "[[shape]]\nsize = 99999999999999999999\n";
    let found = errors(&format!("{SCENE}{wrong}{}{wrong}", list(10_001)), &[]);
    let integers = found.iter().filter(|error| error.contains("64-bit"));
    assert_eq!(integers.count(), 2, "{found:?}");
}

fn errors(text: &str, sets: &[&str]) -> Vec<String> {
    let sets: Vec<String> = sets.iter().map(|s| (*s).to_owned()).collect();
    let (sources, errors) = match Sources::from_text("scene.toml", text, Path::new("."), &sets) {
        Err(error) => (error.sources, error.errors),
        Ok(sources) => {
            let errors = Description::parse(&sources)
                .into_result()
                .err()
                .unwrap_or_default();
            (sources, errors)
        }
    };
    places(&sources, &errors)
}

fn places(sources: &Sources, errors: &SceneErrors) -> Vec<String> {
    let mut lines: Vec<String> = errors
        .0
        .iter()
        .map(
            |error| match error.span.as_ref().and_then(|span| sources.position(span)) {
                Some(at) => format!("{}:{}:{}: {}", at.file, at.line, at.column, error.message),
                None => error.message.clone(),
            },
        )
        .collect();
    lines.sort();
    lines
}

#[test]
fn tables_are_taken_apart() {
    let sources = sources(SCENE, &[]);
    let description = Description::parse(&sources).into_result().unwrap();
    assert_eq!(description.camera.name, "perspective");
    assert!(description.sampler.is_none());
    assert_eq!(description.film.size.width, 512);
    let ball = &description.shapes[1];
    assert_eq!(ball.id.as_deref(), Some("ball"));
    assert_eq!(ball.transform.point_to_world(DVec3::ZERO), DVec3::Y);
    // The inner texture is moved out before the outer one.
    let inline: Vec<&str> = description
        .inline
        .iter()
        .map(|plugin| plugin.name.as_str())
        .collect();
    assert_eq!(inline, ["constant", "checker"]);
}

#[test]
fn overrides_reach_tables_lists_ids_and_missing_tables() {
    let sets = [
        "camera.fov=30",
        "shape.ball.radius = 3",
        "shape[0].material=other",
        "film.width=64",
    ];
    let sources = sources(SCENE, &sets);
    let text = Description::parse(&sources).into_result().unwrap().flattened.text;
    for expected in ["fov = 30", "radius = 3", "material = \"other\"", "width = 64"] {
        assert!(text.contains(expected), "{expected} is not in\n{text}");
    }
}

#[test]
fn faulty_overrides_are_shown_in_their_own_text() {
    assert_eq!(
        errors(
            SCENE,
            &["shape.bell.radius=1", "camra.fov=3", "film.width=0", "fov"]
        ),
        [
            "--set camra.fov=3:1:1: unknown table `camra`",
            "--set film.width=0:1:12: expected an integer from 1 to 65536, found 0",
            "--set fov:1:1: expected path=value",
            "--set shape.bell.radius=1:1:7: no element `bell`: expected an id, or an index below 2",
        ]
    );
}

#[test]
fn all_errors_are_reported_at_once_with_their_places() {
    let text = r#"
film = { width = 99999999 }
[camera]
typo = "perspective"
[[shape]]
type = "sphere"
id = "a"
transform = { scale = 0 }
[[shape]]
type = 3
[[shape]]
type = "sphere"
id = "a"
[light]
type = "point"
[cheese]
"#;
    assert_eq!(
        errors(text, &[]),
        [
            "scene.toml:10:8: expected a type in quotes, found an integer",
            "scene.toml:13:6: the id \"a\" is already used by shape 0",
            "scene.toml:14:2: expected a list of lights",
            "scene.toml:16:2: unknown table `cheese`",
            "scene.toml:2:18: expected an integer from 1 to 65536, found 99999999",
            "scene.toml:3:1: this camera has no `type`",
            "scene.toml:8:13: the transform is singular: it flattens the shape or is not finite",
        ]
    );
}

#[test]
fn syntax_errors_have_a_place_and_no_consequences() {
    let found = errors("[camera]\ntype = \nfov = 3 3\n", &[]);
    assert!(
        found.iter().any(|line| line.starts_with("scene.toml:2:")),
        "{found:?}"
    );
    let deep = format!("x = {}{}", "[".repeat(20_000), "]".repeat(20_000));
    assert!(!errors(&deep, &[]).is_empty());
    assert!(!errors("width = 99999999999999999999999\n[camera]\ntype='x'", &[]).is_empty());
}

#[test]
fn the_hash_is_of_what_the_image_depends_on() {
    let hash = |text: &str, sets: &[&str]| {
        let sources = sources(text, sets);
        Description::parse(&sources).into_result().unwrap().flattened.hash
    };
    let plain = hash(SCENE, &[]);
    assert_eq!(plain, hash(&format!("# a comment\n{SCENE}"), &[]));
    assert_eq!(plain, hash(SCENE, &["accelerator.type=bvh"]));
    assert_ne!(plain, hash(SCENE, &["camera.fov=41"]));
}

#[test]
fn includes_are_merged_first_and_their_paths_stay_right() {
    let folder = tempfile::tempdir().unwrap();
    let root = folder.path();
    fs::create_dir(root.join("parts")).unwrap();
    let part = "[camera]\ntype = 'far'\n[[shape]]\ntype = 'mesh'\nfile = 'a.ply'\n[material.m]\ntype='x'\n";
    fs::write(root.join("parts/part.toml"), part).unwrap();
    fs::write(root.join("parts/a.ply"), "one").unwrap();
    let main =
        "include = ['parts/part.toml', 'parts/part.toml']\n[camera]\ntype = 'near'\n[[shape]]\ntype='s'\n";
    fs::write(root.join("main.toml"), main).unwrap();
    let load = || Sources::load(&root.join("main.toml"), &[], &Registry::default()).unwrap();
    let sources = load();
    let description = Description::parse(&sources).into_result().unwrap();
    assert_eq!(description.camera.name, "near");
    assert_eq!(description.shapes[0].plugin.name, "mesh");
    assert_eq!(description.shapes.len(), 2, "a file counts once");
    assert!(description.flattened.text.contains("file = \"parts/a.ply\""));
    let before = description.flattened.hash.clone();
    fs::write(root.join("parts/a.ply"), "two").unwrap();
    let sources = load();
    assert_ne!(
        before,
        Description::parse(&sources).into_result().unwrap().flattened.hash
    );
}

#[test]
fn the_hash_includes_the_files_that_a_gltf_mesh_refers_to() {
    let folder = tempfile::tempdir().unwrap();
    let root = folder.path();
    fs::create_dir(root.join("meshes")).unwrap();
    let scene = "[camera]\ntype = 'c'\n[[shape]]\ntype = 'mesh'\nfile = 'meshes/a.gltf'\n";
    fs::write(root.join("scene.toml"), scene).unwrap();
    fs::write(
        root.join("meshes/a.gltf"),
        r#"{ "buffers": [{ "uri": "a.bin" }] }"#,
    )
    .unwrap();
    let hash = |contents: &str| {
        fs::write(root.join("meshes/a.bin"), contents).unwrap();
        let sources = Sources::load(&root.join("scene.toml"), &[], &Registry::default()).unwrap();
        let flattened = Description::parse(&sources).into_result().unwrap().flattened;
        assert!(flattened.files.contains(&root.join("meshes/a.bin")));
        flattened.hash
    };
    assert_eq!(hash("one"), hash("one"));
    assert_ne!(hash("one"), hash("two"));
}

#[test]
fn include_cycles_and_missing_files_are_errors_at_the_include() {
    let folder = tempfile::tempdir().unwrap();
    let root = folder.path();
    fs::write(root.join("a.toml"), "include = 'b.toml'\n").unwrap();
    fs::write(
        root.join("b.toml"),
        "include = ['a.toml',\n  'missing.toml', 3]\n",
    )
    .unwrap();
    let error = Sources::load(&root.join("a.toml"), &[], &Registry::default()).unwrap_err();
    let found = places(&error.sources, &error.errors);
    assert_eq!(found.len(), 3);
    assert!(
        found[0].contains("b.toml:1:12") && found[0].contains("includes itself"),
        "{found:?}"
    );
    assert!(found[1].contains("b.toml:2:19"), "{found:?}");
    assert!(found[2].contains("b.toml:2:3:"), "{found:?}");
}

#[test]
fn what_is_no_scene_file_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let root = folder.path();
    fs::write(root.join("latin.toml"), b"# caf\xe9\n").unwrap();
    for (path, expected) in [
        ("nothing.toml", "No such file"),
        ("", "not a regular file"),
        ("latin.toml", "not UTF-8 text (line 1)"),
    ] {
        let error = Sources::load(&root.join(path), &[], &Registry::default()).unwrap_err();
        let report = error.sources.report(&error.errors, false);
        assert!(report.contains(expected), "{report}");
    }
    let mut with_mark = b"\xef\xbb\xbf".to_vec();
    with_mark.extend_from_slice(SCENE.as_bytes());
    fs::write(root.join("mark.toml"), with_mark).unwrap();
    let sources = Sources::load(&root.join("mark.toml"), &[], &Registry::default()).unwrap();
    assert!(Description::parse(&sources).into_result().is_ok());
}

#[test]
fn a_report_shows_the_line() {
    let sources = sources("[camera]\ntype = 'p'\n[flim]\nwidth = 3\n", &[]);
    let errors = Description::parse(&sources).into_result().err().unwrap();
    let report = sources.report(&errors, false);
    for expected in [
        "error: unknown table `flim`",
        "scene.toml:3:2",
        "[flim]",
        "did you mean `film`?",
    ] {
        assert!(report.contains(expected), "{report}");
    }
}

proptest::proptest! {
    /// A truncated scene gives a result or an error, and never a panic.
    #[test]
    fn truncated_scenes_are_answered(length in 0..SCENE.len()) {
        let _ = errors(&SCENE[..length], &[]);
    }
}
