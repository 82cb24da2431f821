//! The pictures of what accelerators divide space into.

use std::path::Path;
use whitstone::core::{DVec2, Interval, SelfHitFilter};
use whitstone::image::Raster;
use whitstone::render::{BuildOptions, Pipeline};
use whitstone::scene::Sources;
use whitstone::{registry, wireframe};
use whitstone_tests::{load, program, root};

const STRUCTURES: [&str; 8] = [
    "bsp", "bvh", "bvh2", "grid", "kdtree", "obb_bvh", "octree", "slab_bvh",
];

/// A cube beside the middle of a black picture: its silhouette is that of the box around it.
const CUBE: &str = r#"
[film]
width = 80
height = 60

[[shape]]
type = "box"
transform = [{ scale = 0.5 }, { translate = [0.7, 0.6, 0] }]
material = { type = "matte", reflectance = 0.5 }
"#;

const CAMERAS: [&str; 2] = [
    "camera={type=\"perspective\",look_at={origin=[2,3,5],target=[0,0.3,0]},fov=45}",
    "camera={type=\"orthographic\",look_at={origin=[2,3,5],target=[0,0.3,0]},width=4}",
];

/// The first and last column and row of some pixels.
fn frame(width: usize, height: usize, counts: impl Fn(usize, usize) -> bool) -> Option<[usize; 4]> {
    let all = (0..height).flat_map(|y| (0..width).map(move |x| (x, y)));
    all.filter(|&(x, y)| counts(x, y))
        .map(|(x, y)| [x, x, y, y])
        .reduce(|a, b| [a[0].min(b[0]), a[1].max(b[1]), a[2].min(b[2]), a[3].max(b[3])])
}

fn frame_of_lines(picture: &Raster) -> Option<[usize; 4]> {
    let bright = |x, y| {
        picture
            .pixel(x, y)
            .is_some_and(|pixel| pixel.iter().any(|&value| value > 100))
    };
    frame(picture.width(), picture.height(), bright)
}

fn frame_of_hits(pipeline: &Pipeline) -> Option<[usize; 4]> {
    let size = pipeline.film.size;
    frame(size.width as usize, size.height as usize, |x, y| {
        let ray = pipeline.camera.ray(DVec2::new(x as f64 + 0.5, y as f64 + 0.5));
        pipeline
            .scene
            .accelerator
            .occluded(&ray, Interval::FORWARD, SelfHitFilter::NOTHING)
    })
}

/// Whether no side of one is more than a pixel from that of the other.
fn alike(a: Option<[usize; 4]>, b: Option<[usize; 4]>) -> bool {
    a.zip(b)
        .is_some_and(|(a, b)| a.into_iter().zip(b).all(|(a, b)| a.abs_diff(b) <= 1))
}

#[test]
fn the_box_around_a_cube_is_drawn_where_the_cube_is_seen() {
    let folder = tempfile::tempdir().unwrap();
    let scene = folder.path().join("cube.toml");
    std::fs::write(&scene, CUBE).unwrap();
    let built = |kind: &str, camera: &str| {
        let overrides = [camera.to_owned(), format!("accelerator={{type=\"{kind}\"}}")];
        load(&scene, &overrides, &registry()).unwrap()
    };
    for kind in STRUCTURES {
        for camera in CAMERAS {
            let pipeline = built(kind, camera);
            let lines = frame_of_lines(&wireframe::picture(&pipeline, 0).unwrap());
            let hits = frame_of_hits(&pipeline);
            assert!(alike(lines, hits), "{kind}, {camera}: {lines:?} around {hits:?}");
            // A camera that stands or looks a little elsewhere is noticed.
            for (from, to) in [("[0,0.3,0]", "[0.2,0.3,0]"), ("[2,3,5]", "[-2,3,5]")] {
                let other = frame_of_hits(&built(kind, &camera.replace(from, to)));
                assert!(
                    !alike(lines, other),
                    "{kind}, {camera}: {lines:?} is {other:?} too"
                );
            }
        }
    }
}

#[test]
fn explain_draws_the_levels_that_are_asked_for() {
    let folder = tempfile::tempdir().unwrap();
    let draw = |kind: &str, depth: &str, file: &Path| {
        let scene = format!("scenes/accelerators/{kind}.toml");
        let path = file.to_str().unwrap();
        let mut program = program!();
        program
            .current_dir(root())
            .args(["explain", &scene, "--draw-bounds", path]);
        program.args(["--bounds-depth", depth]).output().unwrap()
    };
    let file = folder.path().join("bounds.png");
    for kind in STRUCTURES {
        // As the command builds it: for one image, which decides how a `bvh` is built.
        let path = root().join(format!("scenes/accelerators/{kind}.toml"));
        let sources = Sources::load(&path, &[], &registry()).unwrap();
        let options = BuildOptions {
            single_image: true,
            ..BuildOptions::default()
        };
        let pipeline = Pipeline::load(&sources, &registry(), options).unwrap();
        let outlines = |deepest| pipeline.scene.accelerator.debug_bounds(deepest).unwrap();
        let counts = [0, 1, 2].map(|deepest| outlines(deepest).len());
        // A grid of one level has no third.
        assert!(counts[0] == 1 && counts[0] < counts[1], "{kind}: {counts:?}");
        assert!(counts[1] < counts[2] || kind == "grid", "{kind}: {counts:?}");
        assert!(outlines(2).iter().all(|outline| outline.depth <= 2), "{kind}");
        for deepest in [0, 2] {
            let output = draw(kind, &deepest.to_string(), &file);
            assert_eq!(output.status.code(), Some(0), "{output:?}");
            let expected = wireframe::picture(&pipeline, deepest).unwrap().to_png().unwrap();
            assert!(
                std::fs::read(&file).unwrap() == expected,
                "{kind}, level {deepest}"
            );
        }
    }
    let none = folder.path().join("none.png");
    let output = draw("brute_force", "1", &none);
    assert_eq!(output.status.code(), Some(2));
    let message = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(
        message.contains("\"brute_force\" has no boxes to draw"),
        "{message}"
    );
    assert!(!none.exists());
}
