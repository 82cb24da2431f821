//! Scenes that are cut short, damaged, or no scenes at all: an answer with a place, and never a
//! panic.

use std::fs;
use std::path::{Path, PathBuf};
use std::time::Instant;
use whitstone::core::{Registry, SceneErrors};
use whitstone::render::{BuildOptions, Pipeline};
use whitstone::scene::{Description, Sources};
use whitstone_tests::{build, program, root, test_data};

/// A scene with a bit of everything, small enough to be built some ten thousand times.
const SCENE: &str = r#"# größe: ein bißchen von allem
[film]
width = 8
height = 6
aovs = ["depth", "normal", "uv"]

[camera]
type = "perspective"
look_at = { origin = [0, 2, 6], target = [0, 1, 0], up = [0, 1, 0] }
fov = 45
fov_axis = "x"

[sampler]
type = "grid"
samples_per_axis = 2

[integrator]
type = "whitted"
max_depth = 6

[accelerator]
type = "auto"

[[light]]
type = "point"
position = [3, 5, 4]
intensity = [60, 60, 60.5]

[[light]]
type = "spot"
position = [0, 5, 0]
target = [0, 0, 0]
intensity = 1e2
cutoff_angle = 20

[texture.tiles]
type = "checker"
a = 0.4
b = [0.2, 0.1, 0.3]
scale = [10, 10]

[material.floor]
type = "matte"
reflectance = "tiles"

[[shape]]
type = "rectangle"
transform = [{ scale = 10 }, { rotate = { axis = [1, 0, 0], degrees = -90 } }]
material = "floor"

[[shape]]
id = "glass"
type = "sphere"
center = [1.2, 1, 0]
radius = 1
material = { type = "dielectric", interior_ior = 1.5, exterior_ior = 1.0 }

[[shape]]
id = "κώνος"
type = "triangle"
vertices = [[0, 0, 0], [1, 0, 0], [0, 1, 0]]

[expect]
rel_rmse_interior = 1e-3
reason = """
two lines"""
"#;

/// Reads, plans and builds a text; checks that what is wrong with it is said, at places inside the
/// text.
fn answer(text: &str, registry: &Registry) -> Result<(), String> {
    let (sources, errors) = match Sources::from_text("scene.toml", text, Path::new(""), &[]) {
        Err(error) => (error.sources, error.errors),
        Ok(sources) => {
            let errors = match Pipeline::load(&sources, registry, BuildOptions::default()) {
                Ok(_) => SceneErrors::default(),
                Err(errors) if errors.0.is_empty() => return Err("it fails without an error".to_owned()),
                Err(errors) => errors,
            };
            (sources, errors)
        }
    };
    let lines = text.lines().count() + 1;
    for error in &errors.0 {
        if error.message.is_empty() {
            return Err("an error says nothing".to_owned());
        }
        let Some(span) = &error.span else { continue };
        let place = sources
            .position(span)
            .ok_or_else(|| format!("no place for {span:?}: {error}"))?;
        if span.end > text.len() || span.start > span.end || place.line > lines {
            return Err(format!("{span:?} is outside of the text: {error}"));
        }
    }
    if !errors.0.is_empty() && sources.report(&errors, false).is_empty() {
        return Err("the report is empty".to_owned());
    }
    Ok(())
}

fn check(text: &str, registry: &Registry) {
    if let Err(problem) = answer(text, registry) {
        panic!("{problem}\nin\n{text}");
    }
}

#[test]
fn a_scene_cut_at_every_byte_is_answered() {
    let registry = whitstone::registry();
    check(SCENE, &registry);
    let whole = Sources::from_text("scene.toml", SCENE, Path::new(""), &[]).unwrap();
    if let Err(report) = build(&whole, &registry) {
        panic!("{report}");
    }
    for length in 0..SCENE.len() {
        // A file is text before it is a scene: what is cut inside a letter is not.
        if let Some(text) = SCENE.get(..length) {
            check(text, &registry);
        }
        if let Some(text) = SCENE.get(length..) {
            check(text, &registry);
        }
    }
}

/// A simple generator with a fixed seed: the same damage on every run.
struct Random(u64);

impl Random {
    fn below(&mut self, limit: usize) -> usize {
        // Steele, Lea, Flood 2014: SplitMix64.
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) % limit as u64) as usize
    }
}

#[test]
fn a_damaged_scene_is_answered() {
    let registry = whitstone::registry();
    let mut random = Random(1);
    for _ in 0..10_000 {
        let mut bytes = SCENE.as_bytes().to_vec();
        for _ in 0..=random.below(4) {
            let at = random.below(bytes.len());
            match random.below(5) {
                0 => bytes[at] ^= 1 << random.below(8),
                1 => bytes[at] = b"[]{}=\"'.,#\n\\-0e_"[random.below(16)],
                2 => drop(bytes.remove(at)),
                3 => bytes.insert(at, bytes[random.below(bytes.len())]),
                _ => {
                    let other = random.below(bytes.len());
                    let (from, to) = (at.min(other), at.max(other).min(at.min(other) + 60));
                    let part = bytes[from..to].to_vec();
                    let place = random.below(bytes.len());
                    bytes.splice(place..place, part);
                }
            }
        }
        if let Ok(text) = String::from_utf8(bytes) {
            check(&text, &registry);
        }
    }
}

#[test]
fn deep_nesting_is_answered() {
    let registry = whitstone::registry();
    let deep = 20_000;
    let dotted = vec!["a"; deep].join(".");
    for text in [
        format!("x = {}{}", "[".repeat(deep), "]".repeat(deep)),
        format!("film = {}", "[".repeat(deep)),
        format!("film = {}1{}", "{ a = ".repeat(deep), " }".repeat(deep)),
        format!("film.{dotted} = 1"),
        format!("[film.{dotted}]"),
        format!("[[shape]]\ntype = 'sphere'\n[shape.{dotted}]\nx = 1"),
        format!("{}type = \"x\"", "[[shape]]\n".repeat(deep)),
        "=".repeat(deep),
        "[film]\n".repeat(deep),
    ] {
        let answer = answer(&text, &registry);
        assert!(answer.is_ok(), "{}: {answer:?}", &text[..60.min(text.len())]);
    }
}

#[test]
fn deep_overrides_are_answered() {
    let path = vec!["a"; 20_000].join(".");
    let output = program!()
        .arg("explain")
        .arg(root().join("scenes/showcase/classic.toml"))
        .arg("--set")
        .arg(format!("film.{path}=1"))
        .output()
        .unwrap();
    assert_eq!(output.status.code(), Some(2), "{}", output.status);
}

#[test]
fn many_faults_do_not_take_long() {
    let registry = whitstone::registry();
    let start = Instant::now();
    let keys: String = (0..20_000).map(|i| format!("key{i} = {i}\n")).collect();
    check(&format!("[camera]\ntype = \"perspective\"\n{keys}"), &registry);
    let shapes = "[[shape]]\ntype = \"shpere\"\n".repeat(5_000);
    check(&shapes, &registry);
    assert!(
        start.elapsed() < whitstone_tests::ENDLESS,
        "{:?}",
        start.elapsed()
    );
}

#[test]
fn bytes_that_are_no_text_and_files_that_are_none() {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, bytes: &[u8]| {
        let path = folder.path().join(name);
        fs::write(&path, bytes).unwrap();
        path
    };
    let mut latin = SCENE.as_bytes().to_vec();
    latin[60] = 0xe9;
    let cases = [
        (write("latin.toml", &latin), "not UTF-8 text (line 4)"),
        (
            write("wide.toml", b"\xff\xfe[\0f\0]\0"),
            "not UTF-8 text (line 1)",
        ),
        (write("zero.toml", &[0; 64]), "zero.toml:1:1"),
        (folder.path().to_owned(), "not a regular file"),
        (folder.path().join("none.toml"), "No such file"),
        (PathBuf::from("/dev/zero"), "not a regular file"),
        (write("empty.toml", b""), "the scene has no camera"),
        (write("mark.toml", "\u{feff}[flim]\n".as_bytes()), "mark.toml:1:2"),
    ];
    for (path, expected) in cases {
        let output = program!()
            .args(["render", "-o"])
            .args([folder.path().join("x.exr"), path.clone()])
            .output()
            .unwrap();
        let stderr = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{}: {stderr}", path.display());
        assert!(stderr.contains(expected), "{}: {stderr}", path.display());
        assert!(!folder.path().join("x.exr").exists());
    }
}

/// The digits of a number are looked at when it is used: whether that finds the fault in a file,
/// which is taken as the parameters of a camera.
fn refused_as_number(path: &Path) -> bool {
    let text = fs::read_to_string(path).unwrap_or_default();
    let Ok(sources) = Sources::from_text("number.toml", &format!("[camera]\n{text}"), Path::new(""), &[])
    else {
        return true;
    };
    let errors = Description::parse(&sources)
        .into_result()
        .err()
        .unwrap_or_default();
    errors
        .0
        .iter()
        .any(|error| error.message.contains("is not a 64-bit integer"))
}

/// The public test suite of TOML, where the environment says that it is there.
#[test]
fn the_public_toml_files_are_answered() {
    let Some(folder) = test_data("toml") else {
        return;
    };
    let (mut open, mut files) = (vec![folder.clone()], Vec::new());
    while let Some(folder) = open.pop() {
        for entry in fs::read_dir(&folder).unwrap_or_else(|error| panic!("{}: {error}", folder.display())) {
            let path = entry.unwrap().path();
            if path.is_dir() {
                open.push(path);
            } else if path.extension().is_some_and(|extension| extension == "toml") {
                files.push(path);
            }
        }
    }
    assert!(
        files.len() > 100,
        "only {} files in {}",
        files.len(),
        folder.display()
    );
    let registry = whitstone::registry();
    let mut accepted = Vec::new();
    for path in files {
        let invalid = path
            .strip_prefix(&folder)
            .is_ok_and(|path| path.starts_with("invalid"));
        match Sources::load(&path, &[], &registry) {
            Err(error) => {
                assert!(!error.errors.0.is_empty(), "{}", path.display());
                error.sources.report(&error.errors, false);
            }
            Ok(sources) => {
                if invalid && !refused_as_number(&path) {
                    accepted.push(path.display().to_string());
                }
                // None of them is a scene.
                assert!(
                    Description::parse(&sources).into_result().is_err(),
                    "{} is no scene",
                    path.display()
                );
                assert!(!build(&sources, &registry).err().unwrap().is_empty());
            }
        }
    }
    assert!(
        accepted.is_empty(),
        "invalid TOML is accepted:\n{}",
        accepted.join("\n")
    );
}
