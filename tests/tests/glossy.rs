//! Reflections and transmissions in several directions, compared with those of mirrors and of
//! smooth glass, and with what can be said of whole scenes.

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

/// Rough glass: a ball over a floor, from outside and from inside.
fn ball(material: &str, depth: u32) -> Pipeline {
    built(&format!(
        "[integrator]\ntype = \"whitted\"\nmax_depth = {depth}\n[[shape]]\ntype = \"plane\"\n\
         transform = {{ rotate = {{ axis = [1, 0, 0], degrees = -90 }} }}\n\
         material = {{ type = \"matte\", reflectance = {{ type = \"checker\", scale = 2 }} }}\n\
         [[shape]]\ntype = \"sphere\"\ncenter = [0, 0.65, 0]\nradius = 0.6\nmaterial = {{ {material} }}\n"
    ))
}

#[test]
fn a_rough_mirror_is_glossy_to_the_bit() {
    let lobe = "samples = 3, exponent = 50";
    let glossy = room(&format!(
        "type = \"glossy\", {lobe}, reflectance = [0.9, 0.7, 0.5]"
    ));
    let rough = room(&format!(
        "type = \"rough\", {lobe}, material = {{ type = \"mirror\", reflectance = [0.9, 0.7, 0.5] }}"
    ));
    assert_eq!(bits(&rough, 2), bits(&glossy, 1));
}

/// The same as smooth glass with one direction and, up to rounding, with a very narrow lobe; the
/// wider the lobe, the farther from it.
#[test]
fn rough_glass_tends_to_smooth_glass() {
    let glass = "type = \"dielectric\", absorption = [0.3, 0.1, 0.5]";
    let smooth = ball(glass, 4);
    let rough = |lobe: &str| ball(&format!("type = \"rough\", {lobe}, material = {{ {glass} }}"), 4);
    assert_eq!(bits(&rough("samples = 1"), 2), bits(&smooth, 1));
    let smooth = pixels(&smooth);
    let off = |lobe: &str| {
        let found = pixels(&rough(lobe));
        let off = |(a, b): (&Rgb, &Rgb)| (*a + *b * -1.0).map(f64::abs).max_component();
        found.iter().zip(&smooth).map(off).sum::<f64>() / smooth.len() as f64
    };
    let mut last = f64::INFINITY;
    for exponent in ["1e2", "1e4", "1e6"] {
        let mean = off(&format!("samples = 2, exponent = {exponent}"));
        assert!(mean < 0.6 * last, "{exponent}: {mean} after {last}");
        last = mean;
    }
    assert!(off("samples = 2, exponent = 1e30") < 1e-12);
}

/// Both branches are spread, reflections first.
#[test]
fn rays_through_rough_glass_are_counted_and_named() {
    let single = ball(
        "type = \"rough\", samples = 2, exponent = 1e4, material = { type = \"dielectric\" }",
        1,
    );
    assert!(single.scene.requires_scalar_tracing());
    let mut scratch = Scratch::recording();
    let ray = single.camera_ray([20, 14], 0);
    single.integrator.radiance(&single.scene, &ray, &mut scratch);
    assert_eq!(scratch.counters.closest, 9);
    let mut nodes = scratch.record.unwrap();
    // Those that `max_depth` ends are recorded, too.
    nodes.retain(|node| node.path.len() <= "T00".len());
    let paths: Vec<&str> = nodes.iter().map(|node| node.path.as_str()).collect();
    let expected = ["", "R00", "R01", "R02", "R03", "T00", "T01", "T02", "T03"];
    assert_eq!(paths, expected);
    // All of the weight is kept: R and (1 - R)/1.5².
    let sum = |letter: char| -> f64 {
        let rays = nodes.iter().filter(|node| node.path.starts_with(letter));
        rays.map(|node| node.throughput.g).sum()
    };
    assert!((sum('R') + 2.25 * sum('T') - 1.0).abs() < 1e-14);
}

/// What passes rough glass is an event T, also where it is spread, and its reflections are G.
#[test]
fn rough_glass_has_events_of_its_own() {
    let material = "type = \"rough\", samples = 2, exponent = 1e4, material = { type = \"dielectric\" }";
    let text = ["T", "G", "S"]
        .map(|event| format!("{event} = \"E .* {event} .*\""))
        .join("\n");
    let scene = format!(
        "[film.paths]\n{text}\n[integrator]\ntype = \"whitted\"\nmax_depth = 2\n\
         [[shape]]\ntype = \"sphere\"\ncenter = [0, 0.5, 0]\nmaterial = {{ {material} }}\n"
    );
    let film = built(&scene).render(whitstone::render::RenderOptions::default());
    let lit = |name: &str| {
        let found = film
            .layers
            .iter()
            .find(|(layer, _)| *layer == format!("path.{name}.G"));
        found.unwrap().1.iter().filter(|value| **value > 0.0).count()
    };
    assert!(lit("T") > 100 && lit("G") > 100, "{} {}", lit("T"), lit("G"));
    assert_eq!(lit("S"), 0);
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

/// Rough glass has twice as many rays per bounce as there are directions: 8^8 is 2^24, 32^5 2^25.
#[test]
fn rough_glass_counts_both_of_its_branches() {
    let build = |inner: &str, depth: u32, samples: u32| {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("scene.toml");
        let text = format!(
            "{HEAD}[integrator]\ntype = \"whitted\"\nmax_depth = {depth}\n[[shape]]\ntype = \"sphere\"\n\
             material = {{ type = \"rough\", samples = {samples}, material = {{ type = \"{inner}\" }} }}\n"
        );
        std::fs::write(&path, text).unwrap();
        load(&path, &[], &whitstone::registry()).map(|_| ())
    };
    for (inner, depth, samples, right) in [
        ("dielectric", 8, 2, true),
        ("dielectric", 9, 2, false),
        ("dielectric", 4, 4, true),
        ("dielectric", 5, 4, false),
        ("mirror", 6, 4, true),
        ("mirror", 7, 4, false),
        ("matte", 100_000, 8, true),
    ] {
        let found = build(inner, depth, samples).is_ok();
        assert_eq!(found, right, "{inner}, {depth}, {samples}");
    }
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
