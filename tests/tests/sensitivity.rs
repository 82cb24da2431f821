//! `sensitivity`: how small a fault is seen.

use serde_json::Value;
use std::fs;
use whitstone_tests::{program, root};

#[test]
fn numbers_that_matter_are_seen_and_others_are_told() {
    let folder = tempfile::tempdir().unwrap();
    let json = folder.path().join("found.json");
    let mut command = program!();
    command
        .current_dir(root())
        .args(["sensitivity", "scenes/shapes/sphere.toml", "--json"])
        .arg(&json);
    let output = command.arg("--target").arg(folder.path()).output().unwrap();
    let text = String::from_utf8_lossy(&output.stdout) + String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(0), "{text}");
    let found: Value = serde_json::from_slice(&fs::read(json).unwrap()).unwrap();
    let parameters = found["parameters"].as_array().unwrap();
    let of = |path: &str| {
        let of = |parameter: &&Value| parameter["path"] == path;
        &parameters
            .iter()
            .find(of)
            .unwrap_or_else(|| panic!("no {path}: {text}"))["effect"]
    };
    for (path, at_most) in [
        ("light.0.intensity", 0.01),
        ("shape.0.radius", 1e-4),
        ("camera.fov", 0.01),
    ] {
        let effect = of(path);
        assert_eq!(effect["effect"], "seen", "{path}: {effect}");
        assert!(effect["change"].as_f64().unwrap() <= at_most, "{path}: {effect}");
    }
    assert!(
        !text.contains("film.width") && text.contains("numbers: "),
        "{text}"
    );
}

#[test]
fn a_scene_that_is_wrong_or_missing_is_told() {
    for (scene, told) in [("tests/bad/camera_fov_0.toml", "fov"), ("none.toml", "none.toml")] {
        let output = program!()
            .current_dir(root())
            .args(["sensitivity", scene])
            .output()
            .unwrap();
        let text = String::from_utf8_lossy(&output.stdout) + String::from_utf8_lossy(&output.stderr);
        assert!(matches!(output.status.code(), Some(1 | 2)), "{text}");
        assert!(text.contains(told), "{text}");
    }
}
