//! What stands between a point and a light, to the last digit.

use std::fs;
use whitstone::render::RenderOptions;
use whitstone_tests::load;

/// A lamp in the very plane of the floor; what hangs over it is lit from below.
const SCENE: &str = r#"
film = { width = 96, height = 64 }
camera = { type = "perspective", look_at = { origin = [0, 0.2, 3], target = [0, 0.25, 0] }, fov = 60 }
"#;

const FLOOR: &str = r#"
[[shape]]
type = "plane"
transform = { rotate = { axis = [1, 0, 0], degrees = -90 } }
"#;

/// Glass beside everything: shadow rays then ask what lets light through.
const GLASS: &str = r#"
[integrator]
type = "whitted"
shadows = "filtered"

[[shape]]
type = "sphere"
center = [0, 0, 50]
material = { type = "dielectric" }
"#;

const LIGHTS: [&str; 3] = [
    "[[light]]\ntype = \"point\"\nposition = [0, 0, 0]\nintensity = 1\n",
    "[[light]]\ntype = \"point\"\nposition = [0.5, 0, 2]\nintensity = 1\n",
    "[[light]]\ntype = \"area\"\nradiance = 1\nsamples = 2\ntransform = { rotate = { axis = [1, 0, 0], degrees = -90 } }\n",
];

const ROOFS: [&str; 4] = [
    "type = \"triangle\"\nvertices = [[-4, 0.5, -4], [4, 0.5, -4], [0, 0.6, 4]]\n",
    "type = \"sphere\"\ncenter = [0, 5, -3]\nradius = 5\n",
    "type = \"sphere\"\ncenter = [0, 1, -1]\n",
    "type = \"torus\"\nmajor_radius = 2\nminor_radius = 0.5\ntransform = [{ rotate = { axis = [1, 0, 0], degrees = 80 } }, { translate = [0, 1, -2] }]\n",
];

#[test]
fn a_surface_that_holds_the_light_does_not_hide_it() {
    let folder = tempfile::tempdir().unwrap();
    let registry = whitstone::registry();
    let picture = |text: String| {
        let path = folder.path().join("scene.toml");
        fs::write(&path, text).unwrap();
        let pipeline = load(&path, &[], &registry).unwrap();
        let film = pipeline.render(RenderOptions::default());
        film.rgb.iter().map(|pixel| pixel[1]).collect::<Vec<_>>()
    };
    for light in LIGHTS {
        for roof in ROOFS {
            for glass in ["", GLASS] {
                let alone = format!("{SCENE}\n{glass}\n{light}\n[[shape]]\n{roof}");
                let without = picture(alone.clone());
                let with = picture(format!("{alone}\n{FLOOR}"));
                let lit: Vec<usize> = (0..without.len()).filter(|&i| without[i] > 1e-6).collect();
                assert!(lit.len() > 50, "{} pixels are lit: {alone}", lit.len());
                let dark = lit.iter().filter(|&&i| with[i] < 0.999 * without[i]).count();
                assert_eq!(dark, 0, "of {} pixels: {alone}", lit.len());
            }
        }
    }
}

#[test]
fn shapes_without_a_shadow_hide_no_light() {
    let folder = tempfile::tempdir().unwrap();
    let registry = whitstone::registry();
    let picture = |text: &str| {
        let path = folder.path().join("scene.toml");
        fs::write(&path, text).unwrap();
        let pipeline = load(&path, &[], &registry).unwrap();
        pipeline.render(RenderOptions::default()).rgb
    };
    // Outside the view, so that only its shadow is seen.
    let roof = "type = \"box\"\ntransform = [{ scale = [3, 0.1, 3] }, { translate = [0, 3, 0] }]\n";
    let place = "[[shape]]\ntype = \"instance\"\ngroup = \"roof\"\n";
    let without = "casts_shadow = false\n";
    let lights = "[[light]]\ntype = \"point\"\nposition = [0, 6, 0]\nintensity = 9\n";
    for glass in ["", GLASS] {
        let scene = format!("{SCENE}\n{glass}\n{lights}{FLOOR}");
        let (own, group) = (
            format!("[[shape]]\n{roof}"),
            format!("[[group.roof.shape]]\n{roof}"),
        );
        let free = picture(&scene);
        assert!(free.iter().any(|pixel| pixel[0] > 0.0));
        for (shadow, more) in [
            (true, own.clone()),
            (false, own + without),
            (true, format!("{group}{place}")),
            (false, format!("{group}{without}{place}")),
            (false, format!("{group}{place}{without}")),
        ] {
            let found = picture(&format!("{scene}\n{more}"));
            assert_eq!(found != free, shadow, "{glass}{more}");
        }
    }
}
