//! Reflections in several directions, beside those of mirrors and beside what can be said of whole
//! scenes.

use std::path::Path;
use whitstone::core::{Rgb, Scratch};
use whitstone::render::Pipeline;
use whitstone_tests::{bits, load, program, root};

const HEAD: &str = r#"
[film]
width = 40
height = 30
[camera]
type = "perspective"
look_at = { origin = [0.3, 1.5, 5], target = [0, 0.5, 0] }
fov = 40
[[light]]
type = "point"
position = [2, 4, 3]
intensity = 40
[[light]]
type = "background"
radiance = [0.3, 0.5, 0.7]
"#;

/// A ball and a box over a floor; of what is `MATERIAL`, some reflects in others. Nothing touches:
/// there rounding decides what is seen.
const ROOM: &str = r#"
[integrator]
type = "whitted"
max_depth = 3
[[shape]]
type = "plane"
transform = { rotate = { axis = [1, 0, 0], degrees = -90 } }
material = { type = "mix", a = { type = "matte", reflectance = { type = "checker", scale = 2 } }, b = { MATERIAL } }
[[shape]]
type = "sphere"
center = [-0.4, 0.65, 0]
radius = 0.6
material = { MATERIAL }
[[shape]]
type = "box"
transform = [{ scale = 0.3 }, { translate = [0.8, 0.37, 0] }]
material = { type = "mask", opacity = 0.7, material = { MATERIAL } }
"#;

fn built(text: &str) -> Pipeline {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.toml");
    std::fs::write(&path, format!("{HEAD}{text}")).unwrap();
    load(&path, &[], &whitstone::registry()).unwrap_or_else(|report| panic!("{report}"))
}

fn room(material: &str) -> Pipeline {
    built(&ROOM.replace("MATERIAL", material))
}

fn pixels(pipeline: &Pipeline) -> Vec<Rgb> {
    let size = pipeline.film.size;
    let all = (0..size.height).flat_map(|y| (0..size.width).map(move |x| [x, y]));
    all.map(|pixel| pipeline.pixel(pixel, &mut Scratch::default()))
        .collect()
}

#[test]
fn with_one_direction_it_is_a_mirror_to_the_bit() {
    let mirror = room("type = \"mirror\", reflectance = [0.9, 0.7, 0.5]");
    let glossy = room("type = \"glossy\", samples = 1, exponent = 3, reflectance = [0.9, 0.7, 0.5]");
    assert!(!glossy.scene.requires_scalar_tracing());
    assert_eq!(bits(&glossy, 1), bits(&mirror, 2));
}

/// The mean difference to the mirror falls as the lobe becomes narrow, and at last only rounding is
/// left, and the edges that it moves.
#[test]
fn large_exponents_tend_to_the_mirror() {
    let mirror = pixels(&room("type = \"mirror\", reflectance = 0.8"));
    let mut last = f64::INFINITY;
    for exponent in ["10", "1e3", "1e5", "1e8"] {
        let material = format!("type = \"glossy\", reflectance = 0.8, samples = 2, exponent = {exponent}");
        let found = pixels(&room(&material));
        let off = |(a, b): (&Rgb, &Rgb)| (*a + *b * -1.0).map(f64::abs).max_component();
        let mean = found.iter().zip(&mirror).map(off).sum::<f64>() / mirror.len() as f64;
        assert!(mean < 0.5 * last, "{exponent}: {mean} after {last}");
        last = mean;
    }
    assert!(last < 3e-3, "{last}");
    let found = pixels(&room(
        "type = \"glossy\", reflectance = 0.8, samples = 2, exponent = 1e30",
    ));
    for (a, b) in found.iter().zip(&mirror) {
        assert!((*a + *b * -1.0).map(f64::abs).max_component() < 1e-12);
    }
}

/// In a furnace, where the background is 1 everywhere, a surface shows its reflectance where no
/// direction goes into it, and never more.
#[test]
fn a_furnace_shows_the_reflectance() {
    let scene = |shape: &str, depth: u32| {
        let text = format!(
            "[integrator]\ntype = \"whitted\"\nmax_depth = {depth}\n[[light]]\ntype = \"background\"\nradiance = [0.7, 0.5, 0.3]\n{shape}"
        );
        built(&text)
    };
    let floor = "[[shape]]\ntype = \"plane\"\ntransform = { rotate = { axis = [1, 0, 0], degrees = -90 } }\n";
    let flat = scene(
        &format!("{floor}material = {{ type = \"glossy\", reflectance = [1, 0.5, 0.25], exponent = 20000 }}"),
        2,
    );
    // The sky is above the horizon: the lower half of the picture is the floor.
    let size = flat.film.size;
    for x in 0..size.width {
        let found = flat.pixel([x, size.height - 1], &mut Scratch::default());
        let off = (found + Rgb::new(1.0, 0.5, 0.25) * -1.0)
            .map(f64::abs)
            .max_component();
        assert!(off < 1e-13, "{found:?}");
    }
    // A broad lobe on a ball: grazing directions are lost, and at its outline half of them or so.
    let ball = "[[shape]]\ntype = \"sphere\"\ncenter = [0, 0.5, 0]\nmaterial = { type = \"glossy\", exponent = 5, samples = 8 }\n";
    let all = pixels(&scene(ball, 2));
    let least = all.iter().map(|value| value.g).fold(1.0, f64::min);
    assert!(all.iter().all(|value| value.max_component() <= 1.0 + 1e-13));
    assert!((0.3..0.9).contains(&least), "{least}");
}

/// The same picture by any number of threads, and by streams as by single rays; n² rays at the
/// first hit.
#[test]
fn rays_are_counted_and_threads_do_not_matter() {
    let glossy = room("type = \"glossy\", samples = 3, exponent = 50");
    assert!(glossy.scene.requires_scalar_tracing());
    assert_eq!(bits(&glossy, 1), bits(&glossy, 4));
    let single = built(
        "[integrator]\ntype = \"whitted\"\nmax_depth = 1\n[[shape]]\ntype = \"sphere\"\nradius = 0.5\ncenter = [0, 0.5, 0]\nmaterial = { type = \"glossy\", samples = 5 }\n",
    );
    let mut scratch = Scratch::recording();
    let ray = single.camera_ray([20, 15], 0);
    single.integrator.radiance(&single.scene, &ray, &mut scratch);
    assert_eq!(scratch.counters.closest, 26);
    let paths: Vec<String> = scratch
        .record
        .unwrap()
        .into_iter()
        .map(|node| node.path)
        .collect();
    let expected: Vec<String> = (0..25).map(|number| format!("R{number:02}")).collect();
    assert_eq!(paths[0], "");
    assert_eq!(paths[1..], expected);
}

/// What may become too many rays is refused; a limit of depth or of contribution, or fewer
/// directions, make it right.
#[test]
fn the_bounds_are_those_of_the_message() {
    let head = "[[shape]]\ntype = \"sphere\"\n";
    let build = |rules: &str, samples: u32| {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("scene.toml");
        let material = format!("material = {{ type = \"glossy\", samples = {samples} }}\n");
        let text = format!("{HEAD}[integrator]\ntype = \"whitted\"\n{rules}\n{head}{material}");
        std::fs::write(&path, text).unwrap();
        load(&path, &[], &whitstone::registry()).map(|_| ())
    };
    for (rules, samples, right) in [
        ("", 4, true),
        ("max_depth = 7", 4, false),
        ("max_depth = 4", 8, true),
        ("max_depth = 5", 8, false),
        // 4^-12 and a little more and less.
        ("max_depth = 100000\nmin_contribution = 5.97e-8", 2, true),
        ("max_depth = 100000\nmin_contribution = 5.96e-8", 2, true),
        ("max_depth = 100000\nmin_contribution = 1e-8", 2, false),
        ("max_depth = 100000", 1, true),
    ] {
        assert_eq!(build(rules, samples).is_ok(), right, "{rules}, {samples}");
    }
    assert!(Path::new(&root().join("scenes/materials/glossy.toml")).is_file());
}

#[test]
fn explain_tells_of_it() {
    let output = program!()
        .args([
            "explain",
            "scenes/materials/glossy.toml",
            "--pixel",
            "40,70",
            "--reference",
            "none",
        ])
        .current_dir(root())
        .output()
        .unwrap();
    let text = String::from_utf8_lossy(&output.stdout);
    assert!(text.contains("up to 9 reflection rays per hit"), "{text}");
    assert!(text.contains("R00: ") && text.contains("R08: "), "{text}");
}
