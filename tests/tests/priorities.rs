//! Bodies that overlap, by their priorities, beside scenes that say the same without.

use std::path::Path;
use whitstone::core::{Rgb, Scratch};
use whitstone::render::{Pipeline, RenderOptions};
use whitstone_tests::{bits, load, root};

const HEAD: &str = r#"
[film]
width = 40
height = 30
[camera]
type = "perspective"
look_at = { origin = [0.3, 0.2, 6], target = [0, 0, 0] }
fov = 40
[integrator]
type = "whitted"
max_depth = 200
min_contribution = LEAST
SHADOWS
[[light]]
type = "directional"
direction = [0.2, -0.3, -1]
irradiance = 3
[[light]]
type = "ambient"
radiance = 0.5
[[light]]
type = "background"
radiance = [0.3, 0.5, 0.7]
[[shape]]
type = "rectangle"
transform = [{ scale = 9 }, { translate = [0, 0, -3] }]
material = { type = "matte", reflectance = { type = "checker", scale = 40, a = 0.9, b = 0.2 } }
"#;

fn built(text: &str, shadows: &str) -> Pipeline {
    with_branches_above("1e-3", text, shadows)
}

fn with_branches_above(least: &str, text: &str, shadows: &str) -> Pipeline {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.toml");
    let head = HEAD.replace("SHADOWS", &format!("shadows = \"{shadows}\""));
    let text = head.replace("LEAST", least) + text;
    std::fs::write(&path, text).unwrap();
    load(&path, &[], &whitstone::registry()).unwrap_or_else(|report| panic!("{report}"))
}

fn pixels(pipeline: &Pipeline) -> Vec<Rgb> {
    let size = pipeline.film.size;
    let all = (0..size.height).flat_map(|y| (0..size.width).map(move |x| [x, y]));
    all.map(|pixel| pipeline.pixel(pixel, &mut Scratch::default()))
        .collect()
}

/// Pixels that differ by more than this part of a radiance of 1.
fn differing(a: &Pipeline, b: &Pipeline, tolerance: f64) -> usize {
    let (a, b) = (pixels(a), pixels(b));
    let off = |(a, b): (&Rgb, &Rgb)| (*a + *b * -1.0).map(f64::abs).max_component() > tolerance;
    a.iter().zip(&b).filter(|pair| off(*pair)).count()
}

fn sphere(radius: f64, material: &str) -> String {
    format!(
        "[[shape]]\ntype = \"sphere\"\nradius = {radius}\nmaterial = {{ type = \"dielectric\", {material} }}\n"
    )
}

/// What is wholly inside: the same faces between the same media, hence the same bits.
#[test]
fn bodies_in_bodies_are_those_whose_faces_name_both_sides() {
    for shadows in ["opaque", "filtered"] {
        let outer = "interior_ior = 1.52, absorption = [0.5, 0.1, 0.4]";
        let inner = "interior_ior = 1.2, absorption = [0.1, 0.1, 0.6]";
        let named = sphere(1.5, outer)
            + &sphere(
                0.9,
                &format!("{inner}, exterior_ior = 1.52, exterior_absorption = [0.5, 0.1, 0.4]"),
            );
        let ranked =
            sphere(1.5, &format!("{outer}, priority = 1")) + &sphere(0.9, &format!("{inner}, priority = 2"));
        let (named, ranked) = (built(&named, shadows), built(&ranked, shadows));
        assert!(named.scene.bodies.is_none() && ranked.scene.bodies.is_some());
        assert_eq!(bits(&named, 1), bits(&ranked, 2));
        // The other way round the inner one is not there.
        let hidden =
            sphere(1.5, &format!("{outer}, priority = 2")) + &sphere(0.9, &format!("{inner}, priority = 1"));
        // At a passed face a branch is weighed once more, after what was absorbed before: what is
        // cut off must not matter.
        let all = |text: &str| with_branches_above("1e-12", text, shadows);
        let (alone, hidden) = (all(&sphere(1.5, outer)), all(&hidden));
        assert_eq!(differing(&alone, &hidden, 1e-9), 0);
        assert!(differing(&alone, &ranked, 1e-2) > 100);
    }
}

/// Two blocks that overlap beside three panes, each of which names the media that meet there.
#[test]
fn overlapping_blocks_are_the_faces_that_remain() {
    let block = |z: [f64; 2], material: &str| {
        let (half, middle) = (0.5 * (z[1] - z[0]), 0.5 * (z[1] + z[0]));
        format!(
            "[[shape]]\ntype = \"box\"\ntransform = [{{ scale = [50, 50, {half}] }}, {{ translate = [0, 0, {middle}] }}]\n\
             material = {{ type = \"dielectric\", {material} }}\n"
        )
    };
    // Its inside is where the normal, +z, does not point.
    let pane = |z: f64, material: &str| {
        format!(
            "[[shape]]\ntype = \"rectangle\"\ntransform = [{{ scale = 50 }}, {{ translate = [0, 0, {z}] }}]\n\
             material = {{ type = \"dielectric\", {material} }}\n"
        )
    };
    let (glass, water) = (
        "interior_ior = 1.5, absorption = [0.4, 0.1, 0.2]",
        "interior_ior = 1.25, absorption = [0.1, 0.1, 0.5]",
    );
    for shadows in ["opaque", "filtered"] {
        // Glass from -1 to 0.5, water from 0 to 1.
        let overlapping = |glass_first: [u32; 2]| {
            let [a, b] = glass_first;
            let text = block([-1.0, 0.5], &format!("{glass}, priority = {a}"))
                + &block([0.0, 1.0], &format!("{water}, priority = {b}"));
            built(&text, shadows)
        };
        let panes = |meet: f64| {
            let text = pane(1.0, water)
                + &pane(
                    meet,
                    &format!("{glass}, exterior_ior = 1.25, exterior_absorption = [0.1, 0.1, 0.5]"),
                )
                + &pane(
                    -1.0,
                    "interior_ior = 1, exterior_ior = 1.5, exterior_absorption = [0.4, 0.1, 0.2]",
                );
            built(&text, shadows)
        };
        let (glass_counts, water_counts) = (overlapping([9, 4]), overlapping([4, 9]));
        let close = 1e-9;
        assert_eq!(differing(&glass_counts, &panes(0.5), close), 0);
        assert_eq!(differing(&water_counts, &panes(0.0), close), 0);
        assert_eq!(differing(&overlapping([3, 3]), &glass_counts, 0.0), 0);
        assert!(differing(&glass_counts, &water_counts, 1e-2) > 200);
    }
}

/// Also what is made for all scenes at once, and any number of threads.
#[test]
fn the_example_needs_its_priorities() {
    let path = root().join("scenes/showcase/priorities.toml");
    let load = |overrides: &[String]| {
        load(Path::new(&path), overrides, &whitstone::registry()).unwrap_or_else(|report| panic!("{report}"))
    };
    let example = load(&[]);
    assert_eq!(bits(&example, 1), bits(&example, 2));
    let options = || RenderOptions {
        threads: 1,
        ..RenderOptions::default()
    };
    let counters = example.render(options()).counters;
    assert!(counters.closest > u64::from(example.film.size.width * example.film.size.height));
    let water =
        "shape.water.material={ type = \"dielectric\", interior_ior = 1.33, absorption = [0.6, 0.2, 0.1]";
    for change in [" }", ", priority = 0 }"] {
        let other = load(&[format!("{water}{change}")]);
        let count = differing(&example, &other, 1e-2);
        println!("{change}: {count} pixels differ");
        assert!(count > 300, "{change}: {count}");
    }
}
