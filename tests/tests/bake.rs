//! A sky on the faces of a cube, made from one by latitude and longitude.

use std::f64::consts::PI;
use std::path::Path;
use whitstone::core::DVec3;
use whitstone::image::{Image, Limits, exr_io};
use whitstone_tests::{load, program};

/// No change per radian is greater.
const SLOPE: f64 = 1.1;

/// Smooth, different all around, and in no channel the same.
fn sky(d: DVec3) -> [f64; 3] {
    [
        1.0 + 0.8 * d.x * d.y,
        1.0 + 0.5 * d.z,
        1.0 + 0.4 * d.x + 0.6 * d.y * d.z,
    ]
}

fn write(path: &Path, width: usize, color: impl Fn(DVec3) -> [f64; 3]) {
    let image = Image::from_fn(width, width / 2, |x, y| {
        let u = (x as f64 + 0.5) / width as f64;
        let v = 1.0 - (y as f64 + 0.5) / (width / 2) as f64;
        let (phi, theta) = (2.0 * PI * (u - 0.5), PI * (v - 0.5));
        let direction = DVec3::new(theta.cos() * phi.sin(), theta.sin(), -theta.cos() * phi.cos());
        color(direction).map(|c| c as f32)
    });
    exr_io::write(path, &image.unwrap()).unwrap();
}

fn bake(folder: &Path, arguments: &[&str]) -> (Option<i32>, String, String) {
    let output = program!()
        .current_dir(folder)
        .args([&["bake", "cubemap"], arguments].concat())
        .output()
        .unwrap();
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    (output.status.code(), text(&output.stdout), text(&output.stderr))
}

/// A mirror under a sky that is seen all around.
const SCENE: &str = "[film]\nwidth = 96\nheight = 48\n[camera]\ntype = \"environment\"\nlook_at = { origin = [0.1, 0.2, 3], target = [0, 0, 0] }\n\
    [[shape]]\ntype = \"sphere\"\nmaterial = { type = \"mirror\" }\n";

fn rendered(folder: &Path, name: &str, text: &str) -> Vec<[f32; 3]> {
    let path = folder.join(name);
    std::fs::write(&path, text).unwrap();
    let pipeline = load(&path, &[], &whitstone::registry()).unwrap_or_else(|report| panic!("{report}"));
    pipeline.render(Default::default()).rgb
}

#[test]
fn faces_show_the_sky_within_what_the_help_says() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    write(&folder.join("sky.exr"), 256, sky);
    let by_picture = "[[light]]\ntype = \"environment\"\nradiance = { type = \"image\", file = \"sky.exr\", wrap = [\"repeat\", \"clamp\"] }\n";
    let expected = rendered(folder, "picture.toml", &format!("{SCENE}{by_picture}"));
    let errors = [8, 16, 32].map(|size| {
        let into = format!("faces {size}");
        let (code, told, problems) = bake(folder, &["sky.exr", "--size", &size.to_string(), "-o", &into]);
        assert_eq!((code, problems.as_str()), (Some(0), ""));
        let light = std::fs::read_to_string(folder.join(&into).join("faces.toml")).unwrap();
        assert!(told.ends_with(&light), "{told}");
        let text = format!("include = [\"{into}/faces.toml\"]\n{SCENE}");
        let found = rendered(folder, "faces.toml", &text);
        let off: Vec<f64> = expected
            .as_flattened()
            .iter()
            .zip(found.as_flattened())
            .map(|(a, b)| f64::from((a - b).abs()))
            .collect();
        let most = off.iter().copied().fold(0.0, f64::max);
        assert!(most < 1.1 * 2.0 / f64::from(size) * SLOPE, "{size}: {most}");
        (off.iter().map(|off| off * off).sum::<f64>() / off.len() as f64).sqrt()
    });
    println!("{errors:?}");
    // By squares, but for the borders, whose area falls as their width does.
    for pair in errors.windows(2) {
        assert!(pair[1] < 0.36 * pair[0], "{errors:?}");
    }
}

/// A room with a light, and a ball in its middle, at `[0.4, 0.3, -0.2]`, with radius 0.25.
const ROOM: &str = r#"
[camera]
type = "environment"
look_at = { origin = [0.4, 0.3, -0.2], target = [0.4, 0.3, -1.2] }
[film]
width = 64
height = 32
[[light]]
type = "point"
position = [-1, 1.1, 0.7]
intensity = 5
[[shape]]
type = "box"
transform = { scale = [2, 1.5, 1.8] }
material = { type = "matte", reflectance = { type = "noise", mapping = { projection = "solid" } } }
"#;
const BALL: &str = "[[shape]]\ntype = \"sphere\"\ncenter = [0.4, 0.3, -0.2]\nradius = 0.25\n";
const MIRROR: &str = "material = { type = \"mirror\" }\n";

/// The largest difference, relative to the largest value.
fn largest_difference(a: &[[f32; 3]], b: &[[f32; 3]]) -> f32 {
    let pairs = a.as_flattened().iter().zip(b.as_flattened());
    let most = pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
    most / a.as_flattened().iter().copied().fold(0.0, f32::max)
}

#[test]
fn a_scene_is_seen_from_a_point() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let expected = rendered(folder, "room.toml", ROOM);
    let camera = &ROOM[..ROOM.find("[[light]]").unwrap()];
    let at = ["--at", "0.4", "0.3", "-0.2"];
    // A texel blends what is next to it: walls of different brightness, at the edges of the room.
    for (size, limit) in [("16", 0.2), ("128", 0.05)] {
        let into = format!("faces {size}");
        let arguments = [&["room.toml"][..], &at, &["--size", size, "-o", &into]].concat();
        let (code, told, problems) = bake(folder, &arguments);
        assert_eq!((code, problems.as_str()), (Some(0), ""));
        assert!(
            told.contains(&format!("six faces of {size} x {size} texels")),
            "{told}"
        );
        let text = format!("include = [\"{into}/faces.toml\"]\n{camera}");
        let found = rendered(folder, "seen.toml", &text);
        let error = largest_difference(&expected, &found);
        println!("{size}: {error}");
        assert!(error < limit, "{size}: {error}");
        // Turned by a right angle, it is another picture.
        let turned = text.replace("[0.4, 0.3, -1.2]", "[1.4, 0.3, -0.2]");
        assert!(largest_difference(&expected, &rendered(folder, "turned.toml", &turned)) > 0.3);
    }
}

/// The object that reflects the map does not hide the scene from itself. Its reflections are those
/// of a surface at the point, and the smaller it is, the nearer they are to those that are traced.
#[test]
fn reflections_are_looked_up() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let look = "[camera]\ntype = \"perspective\"\nlook_at = { origin = [0.4, 0.6, 1.2], target = [0.4, 0.3, -0.2] }\nfov = ";
    let rest = &ROOM[ROOM.find("[film]").unwrap()..];
    let film = &rest[..rest.find("[[light]]").unwrap()];
    let errors = [0.25, 0.05, 0.01].map(|radius: f64| {
        let ball = BALL.replace("0.25", &radius.to_string());
        // The ball fills the width of the image; its outline is out of view.
        let look = format!("{look}{}\n", 1.2 * radius.to_degrees());
        let traced = rendered(folder, "scene.toml", &format!("{look}{rest}{ball}{MIRROR}"));
        let near = (1.01 * radius).to_string();
        let arguments = [
            "scene.toml",
            "--at",
            "0.4",
            "0.3",
            "-0.2",
            "--near",
            &near,
            "-o",
            "map",
        ];
        let (code, _, problems) = bake(folder, &arguments);
        assert_eq!((code, problems.as_str()), (Some(0), ""));
        let text = format!("include = [\"map/faces.toml\"]\n{look}{film}{ball}{MIRROR}");
        largest_difference(&traced, &rendered(folder, "lookup.toml", &text))
    });
    println!("{errors:?}");
    assert!(errors[0] > 0.1, "a large ball is reflected wrongly: {errors:?}");
    assert!(errors[1] < 0.6 * errors[0] && errors[2] < 0.03, "{errors:?}");
    // Without --near the inside of the ball is seen.
    let arguments = [
        "scene.toml",
        "--at",
        "0.4",
        "0.3",
        "-0.2",
        "--size",
        "4",
        "-o",
        "inside",
    ];
    assert_eq!(bake(folder, &arguments).0, Some(0));
    let face = exr_io::read(folder.join("inside/pz.exr"), Limits::IMAGE).unwrap();
    assert_eq!(
        face.channel("G").unwrap().iter().copied().fold(0.0, f32::max),
        0.0
    );
}

#[test]
fn what_is_finer_than_the_faces_becomes_its_mean() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let image = Image::from_fn(256, 128, |x, _| [(x % 2) as f32; 3]).unwrap();
    exr_io::write(folder.join("stripes.exr"), &image).unwrap();
    assert_eq!(bake(folder, &["stripes.exr", "--size", "4"]).0, Some(0));
    // The default folder.
    let face = exr_io::read(folder.join("stripes/pz.exr"), Limits::IMAGE).unwrap();
    assert_eq!((face.width(), face.height()), (4, 4));
    let far = face.channel("G").unwrap().iter().map(|value| (value - 0.5).abs());
    assert!(far.fold(0.0, f32::max) < 0.1);
    // As fine as the picture if nothing is said.
    assert_eq!(bake(folder, &["stripes.exr"]).0, Some(0));
    let face = exr_io::read(folder.join("stripes/pz.exr"), Limits::IMAGE).unwrap();
    assert_eq!(face.width(), 64);
}

#[test]
fn what_cannot_be_baked_is_told() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    write(&folder.join("sky.exr"), 8, sky);
    std::fs::write(folder.join("text.png"), "no picture").unwrap();
    std::fs::write(folder.join("file"), "").unwrap();
    std::fs::write(folder.join("room.toml"), ROOM).unwrap();
    std::fs::write(folder.join("bad.toml"), ROOM.replace("intensity", "intensities")).unwrap();
    for (arguments, why) in [
        (&["none.png"][..], "cannot read \"none.png\""),
        (
            &["text.png"],
            "\"text.png\" cannot be used as a texture: not a PNG, JPEG, WebP, EXR or HDR file",
        ),
        (&["sky.exr", "--size", "0"], "0 is not in 1..=4096"),
        (&["sky.exr", "-o", "file"], "file: "),
        (&["."], "expected the path of an image file"),
        (&["sky.exr", "--near", "1"], "--at"),
        (&["room.toml", "--at", "1", "2"], "3 values"),
        (
            &["room.toml", "--at", "1", "2", "nan"],
            "--at: expected three finite numbers",
        ),
        (
            &["room.toml", "--at", "1", "2", "3", "--near=-1"],
            "--near: a finite number",
        ),
        (&["none.toml", "--at", "1", "2", "3"], "none.toml"),
        (&["bad.toml", "--at", "1", "2", "3"], "bad.toml:11"),
        (&[], "required arguments"),
    ] {
        let (code, _, problems) = bake(folder, arguments);
        assert_eq!(code, Some(2), "{arguments:?}: {problems}");
        assert!(problems.contains(why), "{arguments:?}: {problems}");
    }
    let square = Image::from_fn(4, 4, |_, _| [1.0; 3]).unwrap();
    exr_io::write(folder.join("square.exr"), &square).unwrap();
    let (code, _, told) = bake(folder, &["square.exr"]);
    assert_eq!(code, Some(0));
    assert!(
        told.contains("expected a picture twice as wide as high"),
        "{told}"
    );
}
