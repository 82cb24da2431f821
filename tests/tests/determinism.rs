//! The same picture from any number of threads and any accelerator; every scene of the repository
//! renders.

use rayon::prelude::*;
use std::fs;
use whitstone::core::{FamilyName, Scratch, SurfaceAttributes};
use whitstone::render::RenderOptions;
use whitstone_tests::{bits, load, program, root, scenes, small};

/// The file that the program writes of a scene with these arguments and this environment variable.
fn file(scene: &str, arguments: &[&str], variable: (&str, &str)) -> Vec<u8> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("image.exr");
    let output = program!()
        .env(variable.0, variable.1)
        .args(["render", "--set", "film.width=75", "--set", "film.height=50"])
        .args(arguments)
        .arg("-o")
        .args([&path, &root().join("scenes").join(scene)])
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{said}");
    let bytes = fs::read(path).unwrap();
    assert!(!bytes.is_empty());
    bytes
}

#[test]
fn files_are_the_same_for_any_number_of_threads() {
    let [one, two, seven] =
        ["1", "2", "7"].map(|threads| file("showcase/classic.toml", &["--threads", threads], ("UNUSED", "")));
    assert!(one == two, "1 and 2 threads");
    assert!(one == seven, "1 and 7 threads");
}

#[test]
fn pixels_are_the_same_for_any_tile_size() {
    let registry = whitstone::registry();
    for scene in ["showcase/classic", "showcase/path_classes", "samplers/adaptive"] {
        let scene = root().join(format!("scenes/{scene}.toml"));
        let size = ["film.width=75", "film.height=50"].map(str::to_owned);
        let pipeline = load(&scene, &size, &registry).unwrap_or_else(|report| panic!("{report}"));
        let rendered = |tile: u32| {
            pipeline.render(RenderOptions {
                tile,
                ..RenderOptions::default()
            })
        };
        let expected = rendered(0);
        for tile in [1, 4, 7, 16, 20, 48, u32::MAX] {
            let film = rendered(tile);
            assert!(film.is_complete);
            assert!(film.rgb == expected.rgb, "tile size {tile}");
            assert!(film.layers == expected.layers, "tile size {tile}");
        }
    }
}

#[test]
fn files_are_the_same_for_any_instruction_set() {
    for scene in [
        "showcase/classic.toml",
        "showcase/glass_mesh.toml",
        "showcase/nested_dielectrics.toml",
    ] {
        let [baseline, avx2, best] =
            ["baseline", "avx2", "avx512"].map(|level| file(scene, &[], ("WHITSTONE_SIMD", level)));
        assert!(baseline == avx2, "{scene}: baseline and AVX2");
        assert!(baseline == best, "{scene}: baseline and the best there is");
    }
}

/// Streams of rays against the single-ray code, which is their specification.
#[test]
fn every_pixel_by_itself_is_as_in_the_image() {
    let registry = whitstone::registry();
    for scene in scenes() {
        let pipeline = load(&scene, &small(), &registry).unwrap_or_else(|report| panic!("{report}"));
        let film = pipeline.render(RenderOptions::default());
        let mut scratch = Scratch::default();
        for (place, found) in (0..).zip(&film.rgb) {
            let pixel = [place % film.width, place / film.width];
            let expected = pipeline.pixel(pixel, &mut scratch).to_array().map(|c| c as f32);
            assert_eq!(expected, *found, "{}: pixel {pixel:?}", scene.display());
        }
        let mut expected = scratch.counters;
        if pipeline.object_order.is_some() {
            // A whole image in the order of objects needs no rays from the camera.
            expected.closest -= film.rgb.len() as u64 * u64::from(pipeline.sampler.count());
        }
        assert_eq!(expected, film.counters, "{}", scene.display());
    }
}

/// What the pipeline knows of a scene saves work and nothing else.
#[test]
fn what_a_scene_does_not_need_is_not_computed_and_is_not_missed() {
    let registry = whitstone::registry();
    let (mut without_uv, mut with_uv) = (0, 0);
    for scene in scenes() {
        let mut pipeline = load(&scene, &small(), &registry).unwrap_or_else(|report| panic!("{report}"));
        let planned = pipeline.render(RenderOptions::default());
        let needs = pipeline.scene.needs();
        pipeline = pipeline.without_specialization();
        let general = pipeline.render(RenderOptions::default());
        let name = scene.display();
        assert!(planned.rgb == general.rgb, "{name}");
        let (some, all) = (planned.counters, general.counters);
        assert_eq!((all.uv, all.textured), (all.shaded, all.shaded), "{name}");
        if !needs.contains(SurfaceAttributes::UV) {
            assert_eq!(some.uv, 0, "{name}");
            without_uv += 1;
        } else {
            with_uv += 1;
        }
        if !needs.contains(SurfaceAttributes::TEXTURE) {
            assert_eq!(some.textured, 0, "{name}");
        }
    }
    assert!(without_uv > 20 && with_uv > 10, "{without_uv}, {with_uv}");
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
    let problems: Vec<String> = scenes
        .into_par_iter()
        .flat_map(|scene| {
            let mut problems = Vec::new();
            let name = scene.display();
            let pipeline = match load(&scene, &small(), &registry) {
                Ok(pipeline) => pipeline,
                Err(report) => return vec![format!("{name}:\n{report}")],
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
                    Ok(pipeline) if bits(&pipeline, 1) == picture => {}
                    Ok(_) => problems.push(format!("{name}: {accelerator} gives another picture")),
                    Err(report) => problems.push(format!("{name} with {accelerator}:\n{report}")),
                }
            }
            problems
        })
        .collect();
    assert!(problems.is_empty(), "{}", problems.join("\n"));
}
