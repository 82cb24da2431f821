//! Rasterization beside ray casting: the same picture, pixel for pixel.

use whitstone::render::Pipeline;
use whitstone_tests::{bits, load, root};

fn built(scene: &str, integrator: &str, more: &[&str]) -> Pipeline {
    let mut overrides = vec![format!("integrator={{ type = \"{integrator}\" }}")];
    overrides.extend(more.iter().map(|more| (*more).to_owned()));
    let path = root().join("scenes").join(scene);
    load(&path, &overrides, &whitstone::registry()).unwrap_or_else(|report| panic!("{report}"))
}

/// Pixels that differ in any bit.
fn differing(a: &Pipeline, b: &Pipeline) -> usize {
    let (a, b) = (bits(a, 2), bits(b, 2));
    assert_eq!(a.len(), b.len());
    a.chunks(3).zip(b.chunks(3)).filter(|(a, b)| a != b).count()
}

#[test]
fn the_picture_is_that_of_ray_casting() {
    let orthographic =
        "camera={ type = \"orthographic\", look_at = { origin = [1, 2, 3], target = [0, 0, 0] }, width = 3 }";
    let near = "camera={ type = \"perspective\", look_at = { origin = [0.2, 0.75, 1.9], target = [0, 0.1, 0] }, near = 1.6 }";
    let round = "camera={ type = \"perspective\", look_at = { origin = [0.2, 0.75, 1.9], target = [0, 0.1, 0] }, near = 1.6, near_kind = \"spherical\" }";
    let inside = "camera={ type = \"perspective\", look_at = { origin = [-0.3, 0.2, 0.1], target = [1, 0, 0] }, fov = 120 }";
    let grid = "sampler={ type = \"grid\", samples_per_axis = 3 }";
    let scene = "integrators/rasterizer.toml";
    for more in [
        &[][..],
        &[orthographic],
        &[near],
        &[round],
        &[inside],
        &[grid],
        &[grid, inside],
    ] {
        let (drawn, cast) = (built(scene, "rasterizer", more), built(scene, "appel", more));
        assert!(drawn.object_order.is_some() && cast.object_order.is_none());
        assert_eq!(differing(&drawn, &cast), 0, "{more:?}");
    }
    let plain = |integrator| built("shapes/heightfield.toml", integrator, &[]);
    assert_eq!(differing(&plain("rasterizer"), &plain("appel")), 0);
}

/// The comparison sees a millionth of a pixel at edges, and what no ray is cast for.
#[test]
fn the_comparison_bites() {
    let scene = "integrators/rasterizer.toml";
    let drawn = built(scene, "rasterizer", &[]);
    let moved = built(scene, "appel", &["camera.fov=60.01"]);
    assert!(differing(&drawn, &moved) > 1_000);
    let options = || whitstone::render::RenderOptions {
        threads: 1,
        ..whitstone::render::RenderOptions::default()
    };
    let (ours, cast) = (
        drawn.render(options()).counters,
        built(scene, "appel", &[]).render(options()).counters,
    );
    assert_eq!((ours.closest, ours.shadow), (0, cast.shadow));
    assert!(cast.closest > 0);
}

/// With one normal a triangle and light from one direction, colours do not change over it, and are
/// interpolated to themselves.
#[test]
fn interpolated_colours_of_flat_triangles_are_those_of_pixels() {
    let built = |interpolation: &str| {
        let set = format!(
            "integrator={{ type = \"rasterizer\", shadows = \"none\", interpolation = \"{interpolation}\" }}"
        );
        let path = root().join("scenes/shapes/heightfield.toml");
        load(&path, &[set], &whitstone::registry()).unwrap_or_else(|report| panic!("{report}"))
    };
    let options = || whitstone::render::RenderOptions::default();
    let (phong, gouraud) = (
        built("phong").render(options()),
        built("gouraud").render(options()),
    );
    for (a, b) in phong.rgb.iter().zip(&gouraud.rgb) {
        for (a, b) in a.iter().zip(b) {
            assert!((a - b).abs() <= 1e-6 * a.abs(), "{a} {b}");
        }
    }
}
