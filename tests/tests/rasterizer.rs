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

/// A triangle under a light, and a small triangle that hides the light from one of its corners.
#[test]
fn shadows_are_interpolated_between_corners() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.toml");
    let scene = |shadows: &str, interpolation: &str| {
        let text = format!(
            "film = {{ width = 9, height = 9 }}\n\
             [camera]\ntype = \"perspective\"\nfov = 12\nlook_at = {{ origin = [0, 5, 1], target = [1, 0, 0] }}\n\
             [integrator]\ntype = \"rasterizer\"\nshadows = \"{shadows}\"\ninterpolation = \"{interpolation}\"\n\
             [[light]]\ntype = \"directional\"\ndirection = [0, -1, 0]\nirradiance = 3\n\
             [[shape]]\ntype = \"triangle\"\nvertices = [[-3, 0, 0], [3, 0, 3], [3, 0, -3]]\n\
             [[shape]]\ntype = \"triangle\"\nvertices = [[-3.2, 1, 0], [-2.9, 1, 0.2], [-2.9, 1, -0.2]]\n"
        );
        std::fs::write(&path, text).unwrap();
        let pipeline = load(&path, &[], &whitstone::registry()).unwrap_or_else(|report| panic!("{report}"));
        pipeline.render(whitstone::render::RenderOptions::default()).rgb
    };
    let (lit, sharp) = (scene("none", "gouraud"), scene("opaque", "phong"));
    // The small triangle hides the light from nothing that is seen.
    for (a, b) in lit.as_flattened().iter().zip(sharp.as_flattened()) {
        assert!((a - b).abs() <= 1e-6 * a, "{a} {b}");
    }
    // x runs from the dark corner, at -3, to the lit edge, at 3: the colour is (x + 3)/6. In the
    // middle of the image x is 1.
    let soft = scene("opaque", "gouraud");
    let part = |pixel: usize| soft[pixel][1] / lit[pixel][1];
    assert!((part(40) - 4.0 / 6.0).abs() < 1e-6, "{}", part(40));
    let row: Vec<f32> = (36..45).map(part).collect();
    assert!(row.is_sorted() && row[8] - row[0] > 0.1, "{row:?}");
    assert_eq!(scene("filtered", "gouraud"), soft);
}
