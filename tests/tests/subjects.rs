//! Other renderers as subjects of `validate`: conforming ones, faulty ones, and ones that
//! misbehave. The conforming renderer is the program itself; the others are small scripts.
#![cfg(unix)]

use exr::prelude::{Image as Exr, IntegerBounds, Layer, SpecificChannels, WritableImage, f16};
use std::fs;
use std::os::unix::fs::PermissionsExt;
use std::path::Path;
use tempfile::TempDir;
use whitstone::render::RenderOptions;
use whitstone_tests::{load, program, root};

const SCENE: &str = "scenes/shapes/sphere.toml";
const OTHER: &str = "scenes/shapes/disk.toml";
/// The program that renders TOML scenes without a fault.
const CONFORMING: &str = env!("CARGO_BIN_EXE_whitstone-under-test");

/// A folder with a configuration of one subject and its script.
struct Subject(TempDir);

/// The outcome of a run.
struct Outcome {
    code: Option<i32>,
    text: String,
    junit: String,
}

impl Subject {
    /// A subject with the keys `more` whose command is a shell script. In the script, `$1` is the
    /// scene, `$2` the image and `$3` the seed.
    fn script(script: &str, more: &str) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("render.sh");
        let script = script.replace("WHITSTONE", CONFORMING);
        fs::write(&path, format!("#!/bin/sh\n{script}\n")).unwrap();
        fs::set_permissions(&path, fs::Permissions::from_mode(0o755)).unwrap();
        Self(folder).with("./render.sh {scene} {output} {seed}", more)
    }

    fn with(self, command: &str, more: &str) -> Self {
        let text = format!("[subject.tracer]\ncommand = \"{command}\"\n{more}\n");
        fs::write(self.0.path().join("whitstone.toml"), text).unwrap();
        self
    }

    fn validate(&self, scenes: &[&str]) -> Outcome {
        let place = |name: &str| self.0.path().join(name);
        let output = program!()
            .current_dir(root())
            .arg("validate")
            .args(scenes)
            .args(["--subject", "tracer", "--reference", "stored", "--config"])
            .arg(place("whitstone.toml"))
            .arg("--target")
            .arg(place("target"))
            .arg("--junit")
            .arg(place("junit.xml"))
            .output()
            .unwrap();
        Outcome {
            code: output.status.code(),
            text: String::from_utf8_lossy(&[&output.stdout[..], &output.stderr[..]].concat()).into_owned(),
            junit: fs::read_to_string(place("junit.xml")).unwrap_or_default(),
        }
    }
}

fn expect(outcome: &Outcome, code: i32, words: &[&str]) {
    assert_eq!(outcome.code, Some(code), "{}", outcome.text);
    for word in words {
        assert!(
            outcome.text.contains(word),
            "expected \"{word}\":\n{}",
            outcome.text
        );
    }
}

#[test]
fn a_conforming_subject_passes() {
    let subject = Subject::script("WHITSTONE render \"$1\" -o \"$2\"", "");
    let outcome = subject.validate(&[SCENE, OTHER]);
    expect(&outcome, 0, &["subject: tracer", "2 passed"]);
    assert!(
        outcome
            .junit
            .contains("tests=\"2\" skipped=\"0\" errors=\"0\" failures=\"0\""),
        "{}",
        outcome.junit
    );
    let target = subject.0.path().join("target");
    let page = fs::read_to_string(target.join("validate/index.html")).unwrap();
    assert!(page.contains("<strong>tracer</strong>, whose image is called ours here"));
    assert!(page.contains("the image of tracer agrees with the reference"));
    // What it was given and what it wrote can be looked at.
    let files = target.join("subjects/tracer/shapes/sphere");
    for name in ["scene.toml", "image.exr", "output.txt"] {
        assert!(files.join(name).is_file(), "{name}");
    }
}

/// The same renderer with a fault of half a percent in one light.
#[test]
fn a_faulty_subject_fails_with_the_reason() {
    let subject = Subject::script(
        "WHITSTONE render \"$1\" -o \"$2\" --set light.0.intensity=120.6",
        "",
    );
    let outcome = subject.validate(&[SCENE]);
    expect(&outcome, 1, &["FAIL", "the image of tracer is wrong", "1 failed"]);
    assert!(outcome.junit.contains("failures=\"1\""), "{}", outcome.junit);
}

/// 8-bit codes hide what is smaller than half a code, and nothing else.
#[test]
fn codes_are_compared_as_intervals() {
    let png = "output = \"png\"\ntransfer = \"srgb\"";
    let right = Subject::script("WHITSTONE render \"$1\" -o \"$2\"", png).validate(&[SCENE]);
    expect(&right, 0, &["1 passed"]);
    let faulty = "WHITSTONE render \"$1\" -o \"$2\" --set light.0.intensity=125";
    expect(&Subject::script(faulty, png).validate(&[SCENE]), 1, &["FAIL"]);
    // Codes that are declared as linear are sRGB.
    let wrong = "output = \"png\"\ntransfer = \"linear\"";
    let outcome = Subject::script("WHITSTONE render \"$1\" -o \"$2\"", wrong).validate(&[SCENE]);
    expect(&outcome, 1, &["FAIL"]);
}

/// The image of [`SCENE`] with a light of this intensity, row by row.
fn rendered(intensity: f64) -> ([usize; 2], Vec<[f32; 3]>) {
    let change = format!("light.0.intensity={intensity}");
    let pipeline = load(&root().join(SCENE), &[change], &whitstone::registry()).unwrap();
    let film = pipeline.render(RenderOptions::default());
    let size = [film.width, film.height].map(|side| side as usize);
    (size, film.rgb)
}

/// Subjects that copy files which the test has written.
fn copies(write: impl FnOnce(&Path), more: &str) -> Outcome {
    let subject = Subject::script("cp \"$(dirname \"$0\")/ready-$3\" \"$2\"", more);
    write(subject.0.path());
    subject.validate(&[SCENE])
}

/// Half-precision numbers and numbers with a shared exponent are rounded, too.
#[test]
fn rounded_numbers_are_compared_as_intervals() {
    let half = |intensity: f64| {
        let ([width, height], rgb) = rendered(intensity);
        let write = |folder: &Path| {
            let color = |x: usize, y: usize| {
                let [r, g, b] = rgb[y * width + x].map(f16::from_f32);
                (r, g, b)
            };
            exr::prelude::write_rgb_file(folder.join("ready-0"), width, height, color).unwrap();
        };
        copies(write, "")
    };
    expect(&half(120.0), 0, &["1 passed"]);
    expect(&half(121.0), 1, &["FAIL"]);
    let hdr = |intensity: f64| {
        let ([width, height], rgb) = rendered(intensity);
        let write = |folder: &Path| {
            let file = fs::File::create(folder.join("ready-0")).unwrap();
            let pixels: Vec<image::Rgb<f32>> = rgb.into_iter().map(image::Rgb).collect();
            let encoder = image::codecs::hdr::HdrEncoder::new(file);
            encoder.encode(&pixels, width, height).unwrap();
        };
        copies(write, "output = \"hdr\"")
    };
    expect(&hdr(120.0), 0, &["1 passed"]);
    expect(&hdr(125.0), 1, &["FAIL"]);
}

/// The pixels of an EXR file belong to the place of its data window in the frame.
#[test]
fn data_windows_are_placed_in_the_frame() {
    let windowed = |at: [i32; 2], border: usize| {
        let ([width, height], rgb) = rendered(120.0);
        let size = (width + 2 * border, height + 2 * border);
        let write = |folder: &Path| {
            let channels = SpecificChannels::rgb(|position: exr::math::Vec2<usize>| {
                let inside = |at: usize, size: usize| at.checked_sub(border).filter(|at| *at < size);
                match (inside(position.x(), width), inside(position.y(), height)) {
                    (Some(x), Some(y)) => rgb[y * width + x].into(),
                    _ => (7.0_f32, 7.0, 7.0),
                }
            });
            let mut layer = Layer::new(
                size,
                exr::meta::header::LayerAttributes::default(),
                exr::image::Encoding::default(),
                channels,
            );
            layer.attributes.layer_position = exr::math::Vec2(at[0], at[1]);
            let mut image = Exr::from_layer(layer);
            image.attributes.display_window = IntegerBounds::from_dimensions((width, height));
            image.write().to_file(folder.join("ready-0")).unwrap();
        };
        copies(write, "")
    };
    expect(&windowed([0, 0], 0), 0, &["1 passed"]);
    // More than the frame.
    expect(&windowed([-6, -6], 6), 0, &["1 passed"]);
    expect(&windowed([5, 0], 0), 1, &["FAIL"]);
}

/// Much noise hides a mirrored image in each pixel, but not in blocks of pixels.
#[test]
fn noise_does_not_hide_a_mirrored_image() {
    let noisy = |mirrored: bool| {
        let ([width, height], rgb) = rendered(120.0);
        let write = |folder: &Path| {
            let mut state = 1_u32;
            for run in 0..5 {
                let color = |x: usize, y: usize| {
                    let x = if mirrored { width - 1 - x } else { x };
                    state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                    let noise = (state >> 8) as f32 / (1 << 24) as f32 - 0.5;
                    rgb[y * width + x].map(|value| value * (1.0 + noise) + 0.01 * noise)
                };
                let image = whitstone::image::Image::from_fn(width, height, color).unwrap();
                whitstone::image::exr_io::write(folder.join(format!("ready-{run}")), &image).unwrap();
            }
        };
        copies(write, "runs = 4")
    };
    expect(&noisy(false), 0, &["1 passed"]);
    expect(&noisy(true), 1, &["FAIL", "blocks of pixels differ"]);
}

/// The runs of the first subject average to the right image, those of the second to one that is
/// 1.7 % too bright.
#[test]
fn noisy_subjects_are_judged_by_their_mean() {
    let script =
        |base: u32| format!("WHITSTONE render \"$1\" -o \"$2\" --set light.0.intensity=$(({base} + $3 % 3))");
    let right = Subject::script(&script(119), "runs = 6").validate(&[SCENE]);
    expect(&right, 0, &["of the pixels agree with the reference"]);
    // Each run is rounded to codes.
    let png = "runs = 6\noutput = \"png\"\ntransfer = \"srgb\"";
    expect(
        &Subject::script(&script(119), png).validate(&[SCENE]),
        0,
        &["1 passed"],
    );
    let biased = Subject::script(&script(121), "runs = 6").validate(&[SCENE]);
    expect(&biased, 1, &["bias +"]);
    let constant = Subject::script("WHITSTONE render \"$1\" -o \"$2\"", "runs = 4").validate(&[SCENE]);
    expect(&constant, 0, &["all 4 runs gave the same image"]);
    // Without noise the rules for images without noise count: a thousandth is too much.
    let slightly = "WHITSTONE render \"$1\" -o \"$2\" --set light.0.intensity=120.1";
    expect(
        &Subject::script(slightly, "runs = 4").validate(&[SCENE]),
        1,
        &["FAIL"],
    );
}

/// A limit of a subject needs a reason, which the output repeats; it excuses no unexplained pixel.
#[test]
fn stated_limits_count() {
    let slightly = "WHITSTONE render \"$1\" -o \"$2\" --set light.0.intensity=120.006";
    expect(
        &Subject::script(slightly, "").validate(&[SCENE]),
        1,
        &["FAIL", "the error of the image of tracer"],
    );
    let stated = "expect = { interior = 1e-4, reason = \"half floats\" }";
    expect(
        &Subject::script(slightly, stated).validate(&[SCENE]),
        0,
        &["1 passed"],
    );
    let faulty = "WHITSTONE render \"$1\" -o \"$2\" --set light.0.intensity=130";
    let wide = "expect = { interior = 1, reason = \"none\" }";
    expect(&Subject::script(faulty, wide).validate(&[SCENE]), 1, &["FAIL"]);
}

/// A scene that the format cannot express is skipped and reported, not judged.
#[test]
fn scenes_that_cannot_be_expressed_are_skipped() {
    let subject = Subject::script("exit 1", "scene = \"gltf\"");
    let outcome = subject.validate(&[SCENE]);
    expect(
        &outcome,
        3,
        &[
            "skipped",
            "the format gltf of subject tracer cannot express the scene",
        ],
    );
    assert!(outcome.junit.contains("<skipped"), "{}", outcome.junit);
}

/// Some scenes are exported to POV-Ray as a file for each colour channel.
#[test]
fn scenes_of_several_files_are_skipped() {
    let subject = Subject::script("exit 1", "scene = \"povray\"");
    let outcome = subject.validate(&["scenes/community/rtc_planes.toml"]);
    expect(
        &outcome,
        3,
        &["skipped", "it takes more than one file", "scene-red.pov"],
    );
}

#[test]
fn a_command_may_say_that_it_cannot_render_a_scene() {
    let subject = Subject::script("echo no spheres here; exit 77", "");
    let outcome = subject.validate(&[SCENE]);
    expect(
        &outcome,
        3,
        &[
            "skipped",
            "the command cannot render this scene: no spheres here\n",
        ],
    );
    // Only the reason is printed, not what comes before it or goes to standard error.
    let noisy = "echo version 3; echo warning >&2; echo; echo no spheres here; echo bye >&2; exit 77";
    let outcome = Subject::script(noisy, "").validate(&[SCENE]);
    expect(&outcome, 3, &["this scene: no spheres here\n"]);
    assert!(
        !outcome.text.contains("version 3") && !outcome.text.contains("bye"),
        "{}",
        outcome.text
    );
    let outcome = Subject::script("echo only this >&2; exit 77", "").validate(&[SCENE]);
    expect(&outcome, 3, &["this scene: only this\n"]);
}

/// A scene in which the keys of the table are not possible is skipped, and not the subject's fault.
#[test]
fn scenes_in_which_the_table_is_not_possible_are_skipped() {
    let render = "WHITSTONE render \"$1\" -o \"$2\"";
    let panorama = "scenes/cameras/environment.toml";
    let shifted = Subject::script(render, "offset = [0.5, -0.5]").validate(&[panorama]);
    expect(
        &shifted,
        3,
        &[
            "skipped",
            "`offset` of subject tracer is not possible in this scene: a camera of type \"environment\"",
        ],
    );
    assert!(shifted.junit.contains("<skipped"), "{}", shifted.junit);
    let near = Subject::script(render, "set = [\"camera.near=0.1\"]").validate(&[panorama]);
    expect(
        &near,
        3,
        &[
            "skipped",
            "`set` of subject tracer is not possible in this scene",
            "near",
        ],
    );
    // A scene that is wrong by itself stays an error.
    let folder = tempfile::tempdir().unwrap();
    let wrong = folder.path().join("wrong.toml");
    fs::write(&wrong, "[camera]\ntype = \"perspectve\"\n").unwrap();
    let outcome = Subject::script(render, "set = [\"camera.near=0.1\"]").validate(&[wrong.to_str().unwrap()]);
    assert_ne!(outcome.code, Some(3), "{}", outcome.text);
    assert!(outcome.text.contains("did you mean"), "{}", outcome.text);
}

/// Each of these is named as what it is, and the next scene is validated all the same.
#[test]
fn misbehaving_subjects_are_named_and_other_scenes_go_on() {
    let good = "WHITSTONE render \"$1\" -o \"$2\"";
    for (script, expected) in [
        ("sleep 100", "did not end within 3 s and was stopped"),
        (
            "sleep 100 & sleep 100 & wait",
            "did not end within 3 s and was stopped",
        ),
        ("while :; do sleep 60 & done", "started more than 512 processes"),
        ("yes; exit 0", "did not end within 3 s and was stopped"),
        ("echo out of luck >&2; exit 7", "| out of luck"),
        ("exit 7", "exit status: 7"),
        ("kill -SEGV $$", "signal: 11"),
        ("exit 0", "the command wrote no image to"),
        (
            "WHITSTONE render \"$1\" -o \"$2.png\"",
            "image.exr; in the same folder it wrote image.exr.png",
        ),
        (": > \"$2\"", "is empty"),
        ("mkdir \"$2\"", "is not a regular file"),
        ("echo hello > \"$2\"", "not an EXR, PNG"),
        (
            "WHITSTONE render \"$1\" -o x.exr; head -c 9000 x.exr > \"$2\"",
            "damaged",
        ),
        (
            "WHITSTONE render \"$1\" -o \"$2\" --set film.width=64",
            "the image has 64 x 96 pixels, expected 128 x 96",
        ),
        (
            "WHITSTONE render \"$1\" -o x.png; cp x.png \"$2\"",
            "8-bit codes, expected a file of the kind exr",
        ),
        (
            "WHITSTONE render \"$1\" -o x.exr; touch -d '2 hours ago' x.exr; cp -p x.exr \"$2\"",
            "is older than the run",
        ),
    ] {
        let script = format!("case \"$1\" in *sphere*) {script} ;; *) {good} ;; esac");
        let limits = "time_limit = 3";
        let outcome = Subject::script(&script, limits).validate(&[SCENE, OTHER]);
        expect(
            &outcome,
            1,
            &[
                expected,
                "tracer gave no image of this scene",
                "1 passed",
                "1 failed",
            ],
        );
        assert!(outcome.junit.contains("failures=\"1\""), "{}", outcome.junit);
    }
}

#[test]
#[cfg(target_os = "linux")]
fn memory_is_limited() {
    // `tail` keeps a line without an end in memory.
    let script = "head -c 900000000 /dev/zero | tail -n 1";
    let outcome = Subject::script(script, "memory_limit = 0.25").validate(&[SCENE]);
    expect(&outcome, 1, &["used more than 256 MiB of memory and was stopped"]);
}

#[test]
fn values_that_are_not_finite_fail() {
    // 32-bit floats in a PFM file; the bytes are a NaN.
    let script = "{ printf 'Pf\\n128 96\\n-1\\n'; head -c 49152 /dev/zero | tr '\\0' '\\377'; } > \"$2\"";
    let outcome = Subject::script(script, "output = \"pfm\"").validate(&[SCENE]);
    expect(&outcome, 1, &["FAIL", "not finite: 36864 values"]);
}

#[test]
fn a_command_that_is_not_there_is_exit_code_3() {
    let subject = Subject(tempfile::tempdir().unwrap()).with("no-such-renderer {scene} {output}", "");
    let outcome = subject.validate(&[SCENE]);
    expect(
        &outcome,
        3,
        &["`no-such-renderer` cannot be started: there is no such program"],
    );
}

/// Nothing of a configuration runs that was not named.
#[test]
fn commands_run_only_if_their_subject_is_named() {
    let subject = Subject::script("touch \"$(dirname \"$0\")/ran\"", "");
    let run = |extra: &[&str]| {
        let mut command = program!();
        command
            .current_dir(subject.0.path())
            .arg("validate")
            .arg(root().join(SCENE));
        command.args(["--reference", "stored", "--target", "t", "--references"]);
        command
            .arg(root().join("references/images"))
            .args(extra)
            .output()
            .unwrap()
    };
    let ran = || subject.0.path().join("ran").exists();
    run(&[]);
    assert!(!ran());
    let output = run(&["--subject", "tarcer"]);
    assert_eq!(output.status.code(), Some(2));
    let text = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(text.contains("did you mean \"tracer\"?"), "{text}");
    assert!(!ran());
    // The configuration is found without --config.
    run(&["--subject", "tracer"]);
    assert!(ran());
}

/// A path with blanks and characters of the shell is one argument.
#[test]
fn paths_are_single_arguments() {
    let folder = tempfile::tempdir().unwrap();
    let odd = folder.path().join("a b;touch ran$(touch ran)");
    fs::create_dir(&odd).unwrap();
    let command = format!("'{CONFORMING}' render {{scene}} -o {{output}}");
    let subject = Subject(TempDir::new_in(&odd).unwrap()).with(&command, "");
    expect(&subject.validate(&[SCENE]), 0, &["1 passed"]);
    assert!(!Path::new("ran").exists() && !odd.join("ran").exists());
}

/// Several subjects are validated one after the other, and a page compares them.
#[test]
fn several_subjects_are_compared() {
    let subject = Subject::script("WHITSTONE render \"$1\" -o \"$2\"", "");
    let place = |name: &str| subject.0.path().join(name);
    let other = |name: &str, arguments: &str, more: &str| {
        format!(
            "[subject.{name}]\ncommand = \"{CONFORMING} render {{scene}} -o {{output}} {arguments}\"\n{more}\n"
        )
    };
    let tables = [
        other("exact", "", ""),
        // The same fault in two subjects: they agree with each other, and not with the reference.
        other("bright", "--set light.0.intensity=125", ""),
        other("brighter", "--set light.0.intensity=125", ""),
        other("shifted", "", "offset = [0.25, 0]"),
        "[subject.lazy]\ncommand = \"sh -c 'echo no balls; exit 77' {scene} {output}\"\n".to_owned(),
    ];
    fs::write(place("whitstone.toml"), tables.concat()).unwrap();
    let output = program!()
        .current_dir(root())
        .args(["validate", SCENE, "--reference", "stored", "--config"])
        .arg(place("whitstone.toml"))
        .args([
            "--subject",
            "exact",
            "--subject",
            "bright",
            "--subject",
            "brighter",
        ])
        .args(["--subject", "shifted", "--subject", "lazy", "--target"])
        .arg(place("target"))
        .arg("--junit")
        .arg(place("junit.xml"))
        .arg("--json")
        .arg(place("all.json"))
        .output()
        .unwrap();
    let text = String::from_utf8_lossy(&[&output.stdout[..], &output.stderr[..]].concat()).into_owned();
    assert_eq!(output.status.code(), Some(1), "{text}");
    let all: serde_json::Value =
        serde_json::from_str(&fs::read_to_string(place("all.json")).unwrap()).unwrap();
    let pair = |a: &str, b: &str| {
        let pairs = all["pairs"].as_array().unwrap();
        pairs
            .iter()
            .find(|pair| pair["a"] == a && pair["b"] == b)
            .unwrap()
    };
    assert_eq!(pair("bright", "brighter")["median"], 0.0, "{text}");
    let far = pair("exact", "bright")["median"].as_f64().unwrap();
    assert!((1e-3..1e-1).contains(&far), "{text}");
    assert!(
        pair("exact", "reference")["median"].as_f64() < Some(1e-5),
        "{text}"
    );
    assert!(
        pair("bright", "reference")["median"].as_f64() > Some(1e-3),
        "{text}"
    );
    // Its scenes are others.
    let why = pair("exact", "shifted")["why"].as_str().unwrap();
    assert!(why.contains("offset = [0.25, 0]"), "{text}");
    assert!(pair("exact", "lazy")["why"].is_string(), "{text}");
    let page = fs::read_to_string(place("target/comparison/index.html")).unwrap();
    assert!(page.contains("exact/validate/index.html#case-1"), "{page}");
    assert!(page.contains("no balls"), "{page}");
    let own = fs::read_to_string(place("target/comparison/bright/validate/index.html")).unwrap();
    assert!(own.contains("the image of bright is wrong"), "{own}");
    let junit = fs::read_to_string(place("junit.xml")).unwrap();
    assert!(junit.contains("tests=\"5\""), "{junit}");
    assert!(junit.contains("bright, shapes/sphere"), "{junit}");
    assert!(text.contains("which two agree"), "{text}");
}
