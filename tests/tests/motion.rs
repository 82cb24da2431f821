//! Moving shapes: at one time a scene is the same scene written without motion, and with a shutter
//! its image is the mean of those.

use std::ops::ControlFlow;
use std::path::Path;
use whitstone::core::Scratch;
use whitstone::render::{BuildOptions, Film, Pipeline, RenderOptions};
use whitstone::scene::Sources;
use whitstone_tests::{bits, build, load, root};

/// Three moving shapes: one of them, in a group, within another one. {film} goes into `[film]`.
const SCENE: &str = r#"
[film]
width = 24
height = 18
aovs = ["shape_id", "depth"]
paths = { specular = "E S+ .*", rest = "E [^S] .*" }
{film}

[camera]
type = "perspective"
look_at = { origin = [0, 1, 6], target = [0, 0, 0] }

[[light]]
type = "point"
position = [2, 5, 4]
intensity = 100

[[light]]
type = "background"
radiance = 0.25

[[group.pair.shape]]
type = "box"
transform = { scale = 0.25 }
{inner}

[[group.pair.shape]]
type = "sphere"
radius = 0.25
transform = { translate = [0, 0.75, 0] }

[[shape]]
type = "rectangle"
transform = [{ scale = 4 }, { rotate = { axis = [1, 0, 0], degrees = -90 } }, { translate = [0, -1, 0] }]
material = { type = "mirror", reflectance = 0.5 }

[[shape]]
type = "sphere"
radius = 0.5
{ball}

[[shape]]
type = "instance"
group = "pair"
transform = { scale = 1.5 }
{pair}
"#;

/// The scene with these lines.
fn scene([film, inner, ball, pair]: [&str; 4]) -> String {
    SCENE
        .replace("{film}", film)
        .replace("{inner}", inner)
        .replace("{ball}", ball)
        .replace("{pair}", pair)
}

/// The moving scene. Its numbers and those of the times are short, so that they are interpolated
/// without rounding.
fn moving(film: &str) -> String {
    let rotate = |degrees: i32| format!("{{ rotate = {{ axis = [0, 1, 0], degrees = {degrees} }} }}");
    let (start, end) = (rotate(0), rotate(480));
    scene([
        film,
        &format!("motion = [{{ time = 0, transform = {start} }}, {{ time = 1, transform = {end} }}]"),
        "motion = [
            { time = 0.25, transform = { translate = [-1, 0, 0] } },
            { time = 0.5, transform = { translate = [1, 0.5, 0] } },
            { time = 1, transform = { translate = [0, 0, 2] } }]",
        "motion = [
            { time = 0, transform = [{ scale = 1 }, { translate = [-1, 0, 0] }] },
            { time = 1, transform = [{ scale = [1, 2, 3] }, { translate = [1, 0, 0] }] }]",
    ])
}

/// The same scene at the time k/8, by hand.
fn still(k: usize) -> String {
    let degrees = 60 * k;
    // Before the first keyframe, at it, halfway, at the second, and between it and the last.
    let ball = [
        [-1.0, 0.0, 0.0],
        [-1.0, 0.0, 0.0],
        [-1.0, 0.0, 0.0],
        [0.0, 0.25, 0.0],
        [1.0, 0.5, 0.0],
        [0.75, 0.375, 0.5],
        [0.5, 0.25, 1.0],
        [0.25, 0.125, 1.5],
        [0.0, 0.0, 2.0],
        [0.0, 0.0, 2.0],
    ][k];
    let t = k.min(8) as f64 / 8.0;
    let turned = if k > 8 { 480 } else { degrees };
    scene([
        "",
        &format!(
            "transform = [{{ scale = 0.25 }}, {{ rotate = {{ axis = [0, 1, 0], degrees = {turned} }} }}]"
        ),
        &format!("transform = {{ translate = {ball:?} }}"),
        &format!(
            "transform = [{{ scale = 1.5 }}, {{ scale = [1, {}, {}] }}, {{ translate = [{}, 0, 0] }}]",
            1.0 + t,
            1.0 + 2.0 * t,
            2.0 * t - 1.0
        ),
    ])
    // Each key is written once.
    .replace("transform = { scale = 0.25 }\ntransform", "transform")
    .replace("transform = { scale = 1.5 }\ntransform", "transform")
}

fn built(text: &str) -> Pipeline {
    let sources = Sources::from_text("scene.toml", text, Path::new(""), &[]).unwrap();
    build(&sources, &whitstone::registry()).unwrap_or_else(|report| panic!("{report}\n{text}"))
}

fn rendered(text: &str) -> Film {
    built(text).render(RenderOptions::default())
}

#[test]
fn at_each_time_it_is_a_scene_without_motion() {
    let mut images = Vec::new();
    for k in 0..10 {
        let moving = bits(&built(&moving(&format!("time = {}", k as f64 / 8.0))), 0);
        assert_eq!(moving, bits(&built(&still(k)), 0), "time {k}/8");
        images.push(moving);
    }
    // They do differ, up to the last keyframe.
    assert_eq!(images[8], images[9]);
    assert!((0..8).all(|k| images[k] != images[k + 1]));
}

#[test]
fn a_shutter_takes_the_mean() {
    // The middles are 1/8, 3/8, 5/8 and 7/8.
    let film = rendered(&moving("time = { open = 0, close = 1, count = 4 }"));
    let singles = [1, 3, 5, 7].map(|k| rendered(&still(k)));
    // Of images that are rounded themselves.
    let near = |found: f32, mean: f32| (found - mean).abs() <= 2e-7 * mean.abs();
    let mean = |of: &dyn Fn(&Film) -> f32| {
        (singles.iter().map(|film| f64::from(of(film))).sum::<f64>() / 4.0) as f32
    };
    for pixel in 0..film.rgb.len() {
        for c in 0..3 {
            assert!(near(film.rgb[pixel][c], mean(&|film| film.rgb[pixel][c])));
        }
        for (number, (name, values)) in film.layers.iter().enumerate() {
            let expected = if name.starts_with("path.") {
                mean(&|film| film.layers[number].1[pixel])
            } else {
                singles[0].layers[number].1[pixel]
            };
            assert!(near(values[pixel], expected), "{name}");
        }
    }
    assert_eq!(film.samples, 4);
    let rays = singles.iter().map(|film| film.counters.total()).sum::<u64>();
    assert_eq!(film.counters.total(), rays);
    assert!(film.is_complete);
}

#[test]
fn pixels_do_not_depend_on_the_way_they_are_rendered() {
    for sampler in ["", "\n[sampler]\ntype = \"adaptive\"\nthreshold = 0.1\n"] {
        let text = moving("time = { open = 0, close = 1, count = 3 }") + sampler;
        let pipeline = built(&text);
        let expected = bits(&pipeline, 1);
        assert_eq!(bits(&pipeline, 3), expected);
        let mut scratch = Scratch::default();
        for (place, expected) in expected.chunks(3).take(24 * 18).enumerate() {
            let pixel = [place as u32 % 24, place as u32 / 24];
            let found = pipeline.pixel(pixel, &mut scratch).to_array();
            assert_eq!(found.map(|c| (c as f32).to_bits()), expected, "{pixel:?}");
        }
        let slow = pipeline.without_specialization();
        assert_eq!(bits(&slow, 0), expected);
    }
}

#[test]
fn a_shutter_without_motion_changes_nothing() {
    let shutter = "time = { open = 0, close = 1, count = 4 }";
    let still = still(3);
    let timed = still.replace("[film]", &format!("[film]\n{shutter}"));
    let pipeline = built(&timed);
    assert_eq!(pipeline.moments(), 1);
    assert_eq!(bits(&pipeline, 0), bits(&built(&still), 0));
    assert!(
        pipeline
            .omitted
            .iter()
            .any(|part| part.what == "3 of the 4 times of the film")
    );
}

/// An adaptive sampler refines the image at each time by itself.
#[test]
fn images_of_an_adaptive_sampler_are_finished_one_by_one() {
    let sampler = "\n[sampler]\ntype = \"adaptive\"\nthreshold = 0.1\n";
    let pipeline = built(&(moving("time = { open = 0, close = 1, count = 4 }") + sampler));
    let single = |k| rendered(&(still(k) + sampler));
    let singles = [1, 3, 5, 7].map(single);
    let is_mean = |film: &Film, of: &[Film]| {
        for pixel in 0..film.rgb.len() {
            for c in 0..3 {
                let sum: f64 = of.iter().map(|film| f64::from(film.rgb[pixel][c])).sum();
                assert_eq!(film.rgb[pixel][c], (sum / of.len() as f64) as f32);
            }
        }
        for (layer, (name, values)) in film.layers.iter().enumerate() {
            let of = if name.starts_with("path.") { of } else { &of[..1] };
            for (value, found) in values.iter().enumerate() {
                let sum: f64 = of.iter().map(|film| f64::from(film.layers[layer].1[value])).sum();
                assert_eq!(*found, (sum / of.len() as f64) as f32, "{name}");
            }
        }
    };
    let whole = pipeline.render(RenderOptions::default());
    assert!(whole.is_complete);
    is_mean(&whole, &singles);
    let rays = singles.iter().map(|film| film.counters.total()).sum::<u64>();
    assert_eq!(whole.counters.total(), rays);
    // What is finished when it is stopped in the third image.
    let stopped = pipeline.render(RenderOptions {
        progress: Some(&|done, all| {
            assert!(done <= all);
            match 2 * done > all {
                true => ControlFlow::Break(()),
                false => ControlFlow::Continue(()),
            }
        }),
        threads: 1,
        ..RenderOptions::default()
    });
    assert!(!stopped.is_complete);
    is_mean(&stopped, &singles[..2]);
}

#[test]
fn times_can_be_set_from_outside() {
    let scene = root().join("scenes/showcase/motion_blur.toml");
    let at = |set: &[&str]| {
        let overrides: Vec<String> = set.iter().map(|set| (*set).to_owned()).collect();
        let pipeline =
            load(&scene, &overrides, &whitstone::registry()).unwrap_or_else(|report| panic!("{report}"));
        (
            pipeline.moments(),
            pipeline.scene_hash.clone(),
            bits(&pipeline, 0),
        )
    };
    let (blurred, early, late) = (at(&[]), at(&["film.time=0"]), at(&["film.time=1"]));
    assert_eq!((blurred.0, early.0, late.0), (8, 1, 1));
    assert_eq!(at(&["film.time.count=3"]).0, 3);
    assert!(early.1 != late.1 && early.2 != late.2 && blurred.2 != early.2);
}

/// Surfaces that meet at a later time only are known.
#[test]
fn coincident_surfaces_of_all_times_are_found() {
    let scene = |time: &str| {
        format!(
            "film = {{ width = 4, height = 3, time = {time} }}\n\
             camera = {{ type = \"perspective\", look_at = {{ origin = [0, 5, 9], target = [0, 0, 0] }} }}\n\
             [[shape]]\ntype = \"box\"\n\
             [[shape]]\ntype = \"box\"\n\
             motion = [{{ time = 0.25, transform = {{ translate = [5, 0, 2] }} }},\n\
             {{ time = 0.75, transform = {{ translate = [0.5, 0, 2] }} }}]\n"
        )
    };
    let found = |time: &str| built(&scene(time)).coincident.len();
    assert_eq!([found("0.25"), found("0.75")], [0, 1]);
    assert_eq!(found("{ open = 0, close = 1, count = 2 }"), 1);
}

#[test]
fn the_memory_limit_holds_for_all_times_together() {
    let load = |count: u32| {
        let text = moving(&format!("time = {{ open = 0, close = 1, count = {count} }}"));
        let sources = Sources::from_text("scene.toml", &text, Path::new("."), &[])
            .ok()
            .unwrap();
        let options = BuildOptions {
            max_memory: Some(64 << 10),
            ..BuildOptions::default()
        };
        Pipeline::load(&sources, &whitstone::registry(), options).map(|_| ())
    };
    load(2).unwrap();
    let errors = load(256).unwrap_err().0;
    assert!(errors[0].message.starts_with("at 0."), "{errors:?}");
    assert!(errors[0].message.contains("more than the limit"), "{errors:?}");
}
