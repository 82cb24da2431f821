//! `conventions`: planted conventions are found, and nothing is found in conforming renderers. One
//! is the program itself, the other a small tracer that shares no code with it.
#![cfg(unix)]

use std::fs;
use std::os::unix::fs::PermissionsExt;
use tempfile::TempDir;
use whitstone_tests::program;

const CONFORMING: &str = env!("CARGO_BIN_EXE_whitstone-under-test");
const SMALL: &str = env!("CARGO_BIN_EXE_small-tracer");

/// The output of the command for a renderer whose command is this shell script, with `$1` the scene
/// and `$2` the image, and further keys.
fn of_script(script: &str, more: &str) -> String {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("render.sh");
    fs::write(&path, format!("#!/bin/sh\n{script}\n")).unwrap();
    fs::set_permissions(&path, fs::Permissions::from_mode(0o755)).unwrap();
    run(&folder, "./render.sh {scene} {output}", more)
}

fn run(folder: &TempDir, command: &str, more: &str) -> String {
    let text = format!("[subject.tracer]\ncommand = \"{command}\"\n{more}\n");
    fs::write(folder.path().join("whitstone.toml"), text).unwrap();
    let output = program!()
        .current_dir(folder.path())
        .args(["conventions", "--subject", "tracer"])
        .output()
        .unwrap();
    let text = String::from_utf8_lossy(&[&output.stdout[..], &output.stderr[..]].concat()).into_owned();
    assert_eq!(output.status.code(), Some(0), "{command} {more}: {text}");
    text
}

/// The output for the program itself, with further arguments and keys.
fn conventions(arguments: &str, more: &str) -> String {
    of_script(&format!("{CONFORMING} render \"$1\" -o \"$2\" {arguments}"), more)
}

/// The output for the small tracer with faults.
fn with_faults(faults: &str) -> String {
    with_faults_and_keys(faults, "")
}

fn with_faults_and_keys(faults: &str, keys: &str) -> String {
    let folder = tempfile::tempdir().unwrap();
    run(
        &folder,
        &format!("{SMALL} {{scene}} {{output}} {faults}"),
        &format!("output = \"pfm\"\n{keys}"),
    )
}

fn expect(text: &str, count: usize, words: &[&str]) {
    let findings = if count == 1 {
        "1 finding".to_owned()
    } else {
        format!("{count} findings")
    };
    assert!(text.contains(&format!("tracer: {findings}\n")), "{text}");
    for word in words {
        assert!(text.contains(word), "expected \"{word}\":\n{text}");
    }
}

const ALL_PROBES: [&str; 8] = [
    "error of the probe with a directional light that no tried convention explains",
    "error of the probe with a point light",
    "error of the probe with a texture",
    "error of the probe with glass",
    "error of the probe with near surfaces",
    "error of the probe with far surfaces",
    "error of the probe with a spot",
    "spawn offset: shadow rays start less than 5e-6 m from their surface",
];

#[test]
fn conforming_renderers_have_no_findings() {
    expect(&conventions("", ""), 0, &ALL_PROBES);
    expect(&with_faults(""), 0, &ALL_PROBES);
    // With meshes, where a format has no spheres. Its spots have another edge.
    let text = conventions("", "scene = \"gltf\"");
    let others = ALL_PROBES.into_iter().filter(|words| !words.ends_with("a spot"));
    expect(&text, 0, &others.collect::<Vec<_>>());
    expect(
        &text,
        0,
        &["the probe with a spot was skipped: the format only approximates it: "],
    );
}

#[test]
fn conventions_of_images_are_found() {
    for (faults, words) in [
        (
            "corner",
            &["0.5 to the left and 0.5 up", "offset = [-0.5, -0.5]"][..],
        ),
        ("row", &["pixels are sampled 1 down", "offset = [0.0, 1.0]"]),
        (
            "columns",
            &["the columns of the image are reversed", "flip = \"x\""],
        ),
        ("rows", &["the rows of the image are reversed", "flip = \"y\""]),
        ("fov-y", &["the field of view is along y instead of x"]),
        ("srgb", &["the transfer function of sRGB", "transfer = \"srgb\""]),
        (
            "gaussian",
            &["a pixel is a Gaussian with a deviation of 0.5 pixels"],
        ),
        ("bgr", &["red and blue are exchanged"]),
    ] {
        expect(&with_faults(faults), 1, words);
    }
    expect(
        &conventions("", "output = \"png\"\ntransfer = \"linear\""),
        1,
        &["the transfer function of sRGB", "transfer = \"srgb\""],
    );
    // The image is reversed when it is read, so that the finding cancels the key.
    expect(
        &conventions("", "flip = \"y\""),
        1,
        &["the rows of the image are reversed", "# without the key `flip`"],
    );
}

#[test]
fn conventions_of_lights_are_found() {
    for (faults, words) in [
        (
            "lumen",
            &[
                "darker by a factor of 12.566",
                "4 pi",
                "candela) is taken as its power",
            ][..],
        ),
        (
            "no-pi",
            &["brighter by a factor of 3.14159, which is pi", "scale = "],
        ),
        ("no-falloff", &["does not fall off with the squared distance"]),
        ("no-shadows", &["surfaces cast no shadows"]),
        ("headlight", &["an ambient radiance of (0.100, 0.100, 0.100)"]),
        ("sky", &["where a ray hits nothing, the image shows (0."]),
        ("light-from", &["comes from its `direction`"]),
        ("whole-spot", &["the angles of a spot are taken as whole ones"]),
        (
            "double-spot",
            &["the angles of a spot are twice as large as stated"],
        ),
        ("hard-spot", &["a spot has a hard edge at its cutoff"]),
        ("beam-is-cutoff", &["a spot ends at its `beam_width`"]),
        ("no-beam", &["the light of a spot falls off from its axis on"]),
        (
            "default-beam",
            &["the `beam_width` of a spot is three quarters of its cutoff"],
        ),
        (
            "cosine-spot",
            &["falls off with the square of a linear function of the cosine"],
        ),
        (
            "steep-spot",
            &["the image of a spot differs, and no tried hypothesis explains it"],
        ),
        (
            "spot-no-falloff",
            &["the light of a spot does not fall off with the squared distance"],
        ),
        (
            "spot-lumen",
            &[
                "a spot, compared with a directional one, is darker by a factor of 3.14159",
                "the lumen of a spot",
            ],
        ),
    ] {
        expect(&with_faults(faults), 1, words);
    }
    let square = "falls off with the square of a linear function of the cosine";
    for (faults, words) in [
        (
            "whole-spot cosine-spot",
            "the angles of a spot are taken as whole ones",
        ),
        (
            "double-spot cosine-spot",
            "the angles of a spot are twice as large as stated",
        ),
        (
            "default-beam cosine-spot",
            "the `beam_width` of a spot is three quarters of its cutoff",
        ),
        (
            "spot-no-falloff cosine-spot",
            "does not fall off with the squared distance",
        ),
    ] {
        expect(&with_faults(faults), 2, &[square, words]);
    }
    let third = "$(case \"$1\" in */point/*) echo --set light.0.intensity=12.7323954 ;; esac)";
    expect(
        &conventions(third, ""),
        1,
        &["darker by a factor of 3.14159", "the lumen of a spot"],
    );
}

#[test]
fn conventions_of_scenes_are_found() {
    for (faults, words) in [
        ("flipped-v", &["textures are upside down"][..]),
        ("texel-corners", &["half a texel off, to the left and up"]),
        (
            "linear-texture",
            &["the codes of a texture are taken as linear values"],
        ),
        (
            "water",
            &["without a stated index of refraction has the index 1.330 instead of 1.5"],
        ),
        (
            "near-1",
            &["nearer to the camera than 1.000 m, measured along the view"],
        ),
        (
            "far-1000",
            &["surfaces at 2000 m are not seen, and those at 1000 m are (a far clip)"],
        ),
        ("epsilon", &["shadow rays start 1.0e-3 m along the ray:"]),
        ("bias", &["shadow rays start 1.1e-3 m above the surface:"]),
        ("clockwise", &["rotations turn the other way"]),
        (
            "reverse-order",
            &["the steps of a transform are applied in the reverse order"],
        ),
    ] {
        expect(&with_faults(faults), 1, words);
    }
}

/// Several at once, and samples that differ between runs.
#[test]
fn findings_do_not_hide_each_other() {
    expect(
        &with_faults("rows bgr sky flipped-v water near-1"),
        6,
        &[
            "rows of the image are reversed",
            "red and blue",
            "hits nothing",
            "upside down",
            "1.330",
            "1.000 m",
        ],
    );
    // Where no hypothesis explains the image, this is what is reported.
    expect(
        &with_faults("random"),
        2,
        &[
            "two runs give different images",
            "and no tried hypothesis explains it",
        ],
    );
}

/// What is seen through glass shows its index only near the true one.
#[test]
fn the_index_of_glass_is_found_between_the_tried_values() {
    for (set, found) in [
        ("shape.1.material.interior_ior=1.82", "the index 1.820"),
        ("shape.0.material.interior_ior=1.48", "the index 1.48"),
    ] {
        let script = format!(
            "more=; grep -q dielectric \"$1\" && more='--set {set}'\n{CONFORMING} render \"$1\" -o \"$2\" $more"
        );
        let outcome = of_script(&script, "");
        expect(&outcome, 1, &[found]);
    }
}

/// Conventions that the table states are not found again.
#[test]
fn stated_conventions_are_no_findings() {
    expect(&with_faults_and_keys("corner", "offset = [-0.5, -0.5]"), 0, &[]);
    expect(
        &with_faults_and_keys("no-pi rows", "flip = \"y\"\nscale = 0.318309886"),
        0,
        &[],
    );
    expect(&conventions("", "output = \"png\"\ntransfer = \"srgb\""), 0, &[]);
}

/// A probe that cannot be rendered is named with the reason; the others are examined.
#[test]
fn probes_that_cannot_be_rendered_are_skipped() {
    let script = format!(
        "case \"$1\" in */glass/*) echo loading; echo there is no glass here; exit 77 ;; \
         */texture/*) exit 4 ;; esac\n{SMALL} $1 $2"
    );
    let text = of_script(&script, "output = \"pfm\"");
    for words in [
        "the probe with glass was skipped: the command cannot render this scene: there is no glass here\n",
        "the probe with a texture was skipped: the subject gave no image: the command ended with exit status: 4",
    ] {
        assert!(text.contains(words), "expected \"{words}\":\n{text}");
    }
}

#[test]
fn a_renderer_without_an_image_is_exit_code_3() {
    for (command, words) in [
        ("false {scene} {output}", "the command ended with exit status: 1"),
        ("no-such-renderer {scene} {output}", "there is no such program"),
    ] {
        let output = program!()
            .args(["conventions", "--subject", &format!("t={{command='{command}'}}")])
            .output()
            .unwrap();
        assert_eq!(output.status.code(), Some(3));
        let text = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(text.contains(words), "{text}");
    }
}
