//! The image split by classes of light paths.

use std::path::{Path, PathBuf};
use whitstone::core::{Rgb, Scratch};
use whitstone::render::{Film, Pipeline, Region, RenderOptions};
use whitstone::scene::Sources;
use whitstone_tests::{build, load, root, scenes, skipped, small};

/// Classes of which every path is in exactly one.
const PARTITION: [(&str, &str); 8] = [
    ("ambient", "E .* D A"),
    ("direct", "E D L"),
    ("glass", "E [ST]* T [ST]* D L"),
    ("glossy", "E .* G .* D L"),
    ("mirror", "E S+ D L"),
    ("shown_directly", "E [OB]"),
    ("shown_by_one", "E . [OB]"),
    ("shown_by_more", "E .{2,} [OB]"),
];

fn classes(list: &[(&str, &str)]) -> String {
    let classes: Vec<String> = list
        .iter()
        .map(|(name, text)| format!("{name}={text:?}"))
        .collect();
    format!("film.paths={{{}}}", classes.join(","))
}

/// The values of a class in all pixels.
fn class<'a>(film: &'a Film, name: &str) -> [&'a [f32]; 3] {
    ["R", "G", "B"].map(|letter| {
        let channel = format!("path.{name}.{letter}");
        let found = film.layers.iter().find(|(name, _)| *name == channel);
        &*found.unwrap_or_else(|| panic!("there is no layer {channel}")).1
    })
}

/// Distance of a number to its neighbour in single precision.
fn ulp(value: f32) -> f64 {
    f64::from(value.abs().next_up()) - f64::from(value.abs())
}

/// The largest difference between the sum of these classes and the image, in units in the last
/// place of single precision.
fn apart(film: &Film, names: &[&str]) -> f64 {
    let parts: Vec<_> = names.iter().map(|name| class(film, name)).collect();
    let mut worst = 0.0_f64;
    for (pixel, rgb) in film.rgb.iter().enumerate() {
        for (channel, value) in rgb.iter().enumerate() {
            let sum: f64 = parts.iter().map(|part| f64::from(part[channel][pixel])).sum();
            worst = worst.max((sum - f64::from(*value)).abs() / ulp(*value));
        }
    }
    worst
}

fn is_black(film: &Film, name: &str) -> bool {
    class(film, name)
        .iter()
        .all(|plane| plane.iter().all(|value| *value == 0.0))
}

/// Scenes whose ray trees are so large that a test of all would take minutes.
fn is_large(scene: &Path) -> bool {
    scene.starts_with(root().join("scenes/scale")) || scene.ends_with("showcase/facing_mirrors.toml")
}

#[test]
fn the_classes_of_a_partition_sum_to_the_image() {
    let registry = whitstone::registry();
    let mut changes = small();
    changes.extend(["film.width=16", "film.height=12", "film.aovs=['depth']"].map(str::to_owned));
    let names = PARTITION.map(|(name, _)| name);
    let (mut rendered, mut seen, mut without) = (0, vec![false; names.len()], vec![0.0_f64; names.len()]);
    for scene in scenes().iter().filter(|scene| !is_large(scene)) {
        let plain = match load(scene, &changes, &registry) {
            Ok(pipeline) => pipeline,
            Err(error) => {
                skipped(&error);
                continue;
            }
        };
        let mut changes = changes.clone();
        changes.push(classes(&PARTITION));
        let split = match load(scene, &changes, &registry) {
            Ok(pipeline) => pipeline,
            Err(error) => {
                assert!(error.contains("does not split its paths"), "{error}");
                continue;
            }
        };
        assert!(split.film.paths.as_ref().unwrap().classes.is_partition());
        let (plain, split) = (
            plain.render(RenderOptions::default()),
            split.render(RenderOptions::default()),
        );
        rendered += 1;
        // The classes do not change the image, the layers or the counts.
        let bits = |film: &Film| -> Vec<_> {
            let values = film.rgb.as_flattened().iter();
            values.map(|value| value.to_bits()).collect()
        };
        assert_eq!(bits(&plain), bits(&split), "{scene:?}");
        assert_eq!(plain.layers[0], split.layers[0], "{scene:?}");
        assert_eq!(plain.counters, split.counters, "{scene:?}");
        let off = apart(&split, &names);
        assert!(off <= 2.0, "{}: {off} units in the last place", scene.display());
        for (number, name) in names.iter().enumerate() {
            seen[number] |= !is_black(&split, name);
            let others: Vec<&str> = names.into_iter().filter(|other| other != name).collect();
            without[number] = without[number].max(apart(&split, &others));
        }
    }
    assert!(rendered > 120, "only {rendered} scenes were rendered");
    assert_eq!(
        seen,
        vec![true; names.len()],
        "every class has paths in some scene"
    );
    // The check fails without any one of the classes.
    assert!(without.iter().all(|off| *off > 1e3), "{without:?}");
}

fn scene(text: &str) -> Pipeline {
    let sources = Sources::from_text("scene.toml", text, Path::new("."), &[]);
    build(&sources.unwrap(), &whitstone::registry()).unwrap_or_else(|report| panic!("{report}"))
}

fn example(changes: &[&str]) -> Pipeline {
    let path: PathBuf = root().join("scenes/showcase/path_classes.toml");
    let size = ["film.width=48", "film.height=36"];
    let changes: Vec<String> = size
        .iter()
        .chain(changes)
        .map(|change| (*change).to_owned())
        .collect();
    load(&path, &changes, &whitstone::registry()).unwrap_or_else(|report| panic!("{report}"))
}

/// Against closed forms: a wall seen in a mirror, with each kind of light.
#[test]
fn the_parts_of_a_reflection_are_those_of_its_lights() {
    // The camera looks down at a mirror with reflectance 0.5, in which it sees a ceiling two metres
    // above: emission 3, 0.8 of an ambient radiance of 0.25, and 0.8/pi of the irradiance pi of a
    // lamp that shines upwards.
    let pipeline = scene(
        "[film]\nwidth = 1\nheight = 1\n[film.paths]\nlamp = 'E S D L'\nambient = 'E S D A'\nglow = 'ESO'\n\
         sky = 'E .* B'\nrest = 'E (|S S+) (D.|O)'\n\
         [camera]\ntype = \"orthographic\"\nwidth = 0.01\n\
         look_at = { origin = [0, 1, 0], target = [0, 0, 0], up = [0, 0, 1] }\n\
         [[light]]\ntype = \"directional\"\ndirection = [0, 1, 0]\nirradiance = 3.14159265358979\n\
         [[light]]\ntype = \"ambient\"\nradiance = 0.25\n\
         [integrator]\ntype = \"whitted\"\nshadows = \"none\"\n\
         [[shape]]\ntype = \"rectangle\"\ntransform = { rotate = { axis = [1, 0, 0], degrees = -90 } }\n\
         material = { type = \"mirror\", reflectance = 0.5 }\n\
         [[shape]]\ntype = \"plane\"\n\
         transform = [{ rotate = { axis = [1, 0, 0], degrees = 90 } }, { translate = [0, 2, 0] }]\n\
         material = { type = \"emissive\", radiance = 3, material = { type = \"matte\", reflectance = 0.8 } }\n",
    );
    let film = pipeline.render(RenderOptions::default());
    let values = ["lamp", "ambient", "glow", "sky", "rest"].map(|name| class(&film, name)[1][0]);
    assert_eq!(values, [0.4, 0.1, 1.5, 0.0, 0.0]);
    assert_eq!(film.rgb[0][1], 2.0);
}

/// Against the recorded ray trees: the classes of one sequence of branches are what its nodes add.
#[test]
fn each_sequence_of_branches_has_the_radiance_of_its_rays() {
    let branches = [
        "", "S", "T", "ST", "TS", "TT", "STT", "TTS", "TTT", "G", "GT", "SG", "TGT",
    ];
    let list: Vec<(String, String)> = branches
        .iter()
        .map(|branches| (format!("p{branches}"), format!("E {branches} (D .|O|B)")))
        .collect();
    let list: Vec<(&str, &str)> = list.iter().map(|(a, b)| (a.as_str(), b.as_str())).collect();
    let pipeline = example(&[&classes(&list)]);
    let film = pipeline.render(RenderOptions::default());
    let mut compared = vec![0; branches.len()];
    for (pixel, number) in (0..film.width * film.height)
        .map(|p| [p % film.width, p / film.width])
        .zip(0..)
    {
        let mut scratch = Scratch::recording();
        pipeline
            .integrator
            .radiance(&pipeline.scene, &pipeline.camera_ray(pixel, 0), &mut scratch);
        let nodes = scratch.record.unwrap();
        for (place, branches) in branches.iter().enumerate() {
            let nodes = nodes.iter().filter(|node| {
                // R is a mirror's, R and two digits one ray of a glossy reflection.
                let mut letters = node.path.replace('R', "S");
                for digits in (0..64).map(|number| format!("S{number:02}")) {
                    letters = letters.replace(&digits, "G");
                }
                letters == *branches
            });
            let expected: Rgb = nodes.map(|node| node.throughput * node.local).sum();
            let found = class(&film, &format!("p{branches}")).map(|plane| f64::from(plane[number]));
            for (found, expected) in found.iter().zip(expected.to_array()) {
                let near = (found - expected).abs() <= 1e-6 * expected + 1e-30;
                assert!(near, "{branches} at {pixel:?}: {found} is not {expected}");
                compared[place] += usize::from(expected > 0.0);
            }
        }
    }
    assert!(
        compared.iter().filter(|count| **count > 10).count() >= 7,
        "{compared:?}"
    );
}

/// Pixels have the same classes in every region, on any number of threads, with every sampler.
#[test]
fn classes_do_not_depend_on_regions_and_threads() {
    for sampler in [
        "sampler={ type = 'center' }",
        "sampler={ type = 'adaptive', samples = 32, initial_samples = 4, threshold = 0.02 }",
    ] {
        let pipeline = example(&[sampler]);
        let whole = pipeline.render(RenderOptions {
            threads: 1,
            ..RenderOptions::default()
        });
        let again = pipeline.render(RenderOptions {
            threads: 3,
            ..RenderOptions::default()
        });
        assert_eq!(whole.layers, again.layers);
        let names = ["ambient", "direct", "emitted", "glass", "glossy", "mirror", "sky"];
        assert!(apart(&whole, &names) <= 2.0, "{sampler}");
        let part = Region {
            x: 9,
            y: 13,
            width: 21,
            height: 20,
        };
        let film = pipeline.render(RenderOptions {
            region: Some(part),
            ..RenderOptions::default()
        });
        for ((name, whole), (_, film)) in whole.layers.iter().zip(&film.layers) {
            for y in 0..part.height {
                for x in 0..part.width {
                    let place = ((part.y + y) * 48 + part.x + x) as usize;
                    let found = film[(y * part.width + x) as usize];
                    assert_eq!(found.to_bits(), whole[place].to_bits(), "{name}");
                }
            }
        }
    }
}

#[test]
fn interpolated_colours_have_no_classes() {
    let path = root().join("scenes/showcase/gouraud.toml");
    let error = load(&path, &[classes(&PARTITION)], &whitstone::registry())
        .err()
        .unwrap();
    assert!(error.contains("does not split its paths"), "{error}");
}
