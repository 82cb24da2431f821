//! The plugins that `new-plugin` writes: compiled here, with their own tests, and their scenes
//! rendered.

#![allow(
    unreachable_pub,
    reason = "what is public in a package of its own is not in a test"
)]

#[path = "../../crates/whitstone/src/commands/scaffold/chalk.rs"]
mod chalk;
#[path = "../../crates/whitstone/src/commands/scaffold/fisheye.rs"]
mod fisheye;
#[path = "../../crates/whitstone/src/commands/scaffold/moon.rs"]
mod moon;
#[path = "../../crates/whitstone/src/commands/scaffold/ripples.rs"]
mod ripples;

use std::fs;
use whitstone::core::{Cameras, Lights, Materials, Textures};
use whitstone_tests::{bits, entries, load, program, root};

#[test]
fn their_scenes_render() {
    let mut registry = whitstone::registry();
    registry.add::<Materials, chalk::Chalk>("scaffold").unwrap();
    registry.add::<Textures, ripples::Ripples>("scaffold").unwrap();
    registry.add::<Lights, moon::Moon>("scaffold").unwrap();
    registry.add::<Cameras, fisheye::Fisheye>("scaffold").unwrap();
    let folder = root().join("crates/whitstone/src/commands/scaffold");
    let scenes: Vec<String> = entries(&folder)
        .into_iter()
        .filter(|name| name.ends_with(".toml"))
        .collect();
    assert_eq!(
        scenes,
        ["chalk.toml", "fisheye.toml", "moon.toml", "ripples.toml"]
    );
    for scene in scenes {
        let pipeline = load(&folder.join(&scene), &[], &registry).unwrap_or_else(|report| panic!("{report}"));
        let mut values = bits(&pipeline, 2);
        assert!(
            values.iter().all(|bits| f32::from_bits(*bits).is_finite()),
            "{scene}"
        );
        values.sort_unstable();
        values.dedup();
        assert!(values.len() > 1, "{scene} shows something");
    }
}

#[test]
fn a_package_of_each_family_is_written() {
    let folder = tempfile::tempdir().unwrap();
    for family in ["shape", "material", "texture", "light", "camera"] {
        let into = folder.path().join(family);
        let output = program!()
            .current_dir(root())
            .args(["new-plugin", family, "half_blob", "--into"])
            .arg(&into)
            .output()
            .unwrap();
        assert_eq!(
            output.status.code(),
            Some(0),
            "{}",
            String::from_utf8_lossy(&output.stderr)
        );
        assert_eq!(entries(&into), ["Cargo.toml", "README.md", "scenes", "src"]);
        let manifest: toml::Table = fs::read_to_string(into.join("Cargo.toml"))
            .unwrap()
            .parse()
            .unwrap();
        assert_eq!(manifest["package"]["name"].as_str(), Some("plugin-half_blob"));
        let core = manifest["dependencies"]["whitstone-core"]["path"]
            .as_str()
            .unwrap();
        assert!(
            fs::exists(std::path::Path::new(core).join("Cargo.toml")).unwrap(),
            "{core}"
        );
        let source = fs::read_to_string(into.join("src/half_blob.rs")).unwrap();
        assert!(
            source.contains(&format!("whitstone_testkit::{family}_laws!(")),
            "{source}"
        );
        let scene = fs::read_to_string(into.join("scenes/half_blob.toml")).unwrap();
        assert!(scene.contains("\"half_blob\""), "{scene}");
    }
    let output = program!()
        .current_dir(root())
        .args(["new-plugin", "sampler", "x"])
        .output()
        .unwrap();
    assert_eq!(output.status.code(), Some(2));
}
