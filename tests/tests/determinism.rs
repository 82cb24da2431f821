//! The same picture from any number of threads and any accelerator; every scene of the repository renders.

use std::fs;
use whitstone::core::FamilyName;
use whitstone_tests::{bits, load, program, root, scenes, small};

#[test]
fn files_are_the_same_for_any_number_of_threads() {
    let folder = tempfile::tempdir().unwrap();
    let scene = root().join("scenes/showcase/classic.toml");
    let files: Vec<Vec<u8>> = ["1", "2", "7"]
        .into_iter()
        .map(|threads| {
            let path = folder.path().join(format!("{threads}.exr"));
            let output = program!()
                .args([
                    "render",
                    "--threads",
                    threads,
                    "--set",
                    "film.width=75",
                    "--set",
                    "film.height=50",
                    "-o",
                ])
                .args([&path, &scene])
                .output()
                .unwrap();
            assert!(
                output.status.success(),
                "{}",
                String::from_utf8_lossy(&output.stderr)
            );
            fs::read(path).unwrap()
        })
        .collect();
    assert!(!files[0].is_empty());
    assert_eq!(files[0], files[1], "1 and 2 threads");
    assert_eq!(files[0], files[2], "1 and 7 threads");
}

#[test]
fn every_scene_renders_and_all_accelerators_agree() {
    let registry = whitstone::registry();
    let scenes = scenes();
    assert!(!scenes.is_empty(), "the scenes are not found");
    let accelerators: Vec<&str> = registry
        .entries()
        .filter(|entry| entry.family == FamilyName::Accelerator)
        .map(|entry| entry.name)
        .collect();
    assert!(accelerators.len() > 1, "{accelerators:?}");
    let mut problems = Vec::new();
    for scene in scenes {
        let name = scene.display();
        let pipeline = match load(&scene, &small(), &registry) {
            Ok(pipeline) => pipeline,
            Err(report) => {
                problems.push(format!("{name}:\n{report}"));
                continue;
            }
        };
        let picture = bits(&pipeline, 2);
        let not_finite = picture
            .iter()
            .filter(|bits| !f32::from_bits(**bits).is_finite())
            .count();
        if not_finite > 0 {
            problems.push(format!("{name}: {not_finite} values are not finite"));
        }
        if bits(&pipeline, 3) != picture {
            problems.push(format!("{name}: 2 and 3 threads give different pictures"));
        }
        for accelerator in &accelerators {
            // The whole table, so that no parameters of another accelerator stay.
            let mut overrides = small();
            overrides.push(format!("accelerator={{type=\"{accelerator}\"}}"));
            match load(&scene, &overrides, &registry) {
                Ok(pipeline) if bits(&pipeline, 2) == picture => {}
                Ok(_) => problems.push(format!("{name}: {accelerator} gives another picture")),
                Err(report) => problems.push(format!("{name} with {accelerator}:\n{report}")),
            }
        }
    }
    assert!(problems.is_empty(), "{}", problems.join("\n"));
}
