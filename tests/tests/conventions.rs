//! `conventions`: planted conventions are found, and nothing is found in a conforming renderer. The
//! renderer is the program itself.
#![cfg(unix)]

use std::fs;
use std::os::unix::fs::PermissionsExt;
use whitstone_tests::program;

const CONFORMING: &str = env!("CARGO_BIN_EXE_whitstone-under-test");

/// The output of the command for a renderer with further arguments and keys.
fn conventions(arguments: &str, more: &str) -> String {
    let folder = tempfile::tempdir().unwrap();
    let script = folder.path().join("render.sh");
    fs::write(
        &script,
        format!("#!/bin/sh\n{CONFORMING} render \"$1\" -o \"$2\" {arguments}\n"),
    )
    .unwrap();
    fs::set_permissions(&script, fs::Permissions::from_mode(0o755)).unwrap();
    let text = format!("[subject.tracer]\ncommand = \"./render.sh {{scene}} {{output}}\"\n{more}\n");
    fs::write(folder.path().join("whitstone.toml"), text).unwrap();
    let output = program!()
        .current_dir(folder.path())
        .args(["conventions", "--subject", "tracer"])
        .output()
        .unwrap();
    let text = String::from_utf8_lossy(&[&output.stdout[..], &output.stderr[..]].concat()).into_owned();
    assert_eq!(output.status.code(), Some(0), "{arguments} {more}: {text}");
    text
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

#[test]
fn a_conforming_renderer_has_no_findings() {
    expect(
        &conventions("", ""),
        0,
        &["light that no tried convention explains"],
    );
}

/// The window of the probe, shifted by half a pixel to the left and up.
const CORNER: &str = "--set 'camera={type=\"perspective\",look_at={origin=[0.3,0.5,5],target=[0,0,0]},\
    window={l=-0.47116503,r=0.46145029,b=-0.30601440,t=0.31572915}}'";

#[test]
fn planted_conventions_are_found() {
    expect(
        &conventions(CORNER, ""),
        1,
        &["0.5 to the left and 0.5 up", "offset = [-0.5, -0.5]"],
    );
    expect(
        &conventions("--set 'camera.fov_axis=\"y\"'", ""),
        1,
        &["the field of view is along y instead of x"],
    );
    expect(
        &conventions("--set 'sampler={type=\"grid\",samples_per_axis=8}'", ""),
        1,
        &["a box of 1 pixels instead of one sample"],
    );
    expect(
        &conventions("", "output = \"png\"\ntransfer = \"linear\""),
        1,
        &["the transfer function of sRGB", "transfer = \"srgb\""],
    );
    for flip in ["x", "y"] {
        let what = if flip == "x" { "columns" } else { "rows" };
        let reversed = format!("the {what} of the image are reversed");
        // The image is reversed when it is read, so that the finding cancels the key.
        expect(
            &conventions("", &format!("flip = \"{flip}\"")),
            1,
            &[&reversed, "# without the key `flip`"],
        );
    }
    expect(
        &conventions("", "scale = 3.14159265"),
        1,
        &[
            "a directional light is brighter by a factor of 3.14159, which is pi",
            "scale = 1.0",
        ],
    );
    let power = "$(case \"$1\" in */point/*) echo --set light.0.intensity=3.18309886 ;; esac)";
    expect(
        &conventions(power, ""),
        1,
        &[
            "a point light, compared with a directional one, is darker by a factor of 12.566",
            "4 pi",
        ],
    );
}

/// Conventions that the table states are not found again.
#[test]
fn stated_conventions_are_no_findings() {
    expect(&conventions(CORNER, "offset = [-0.5, -0.5]"), 0, &[]);
    expect(&conventions("", "output = \"png\"\ntransfer = \"srgb\""), 0, &[]);
}

#[test]
fn a_renderer_without_an_image_is_exit_code_3() {
    let output = program!()
        .args(["conventions", "--subject", "t={command='false {scene} {output}'}"])
        .output()
        .unwrap();
    assert_eq!(output.status.code(), Some(3));
    let text = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(text.contains("the command ended with exit status: 1"), "{text}");
}
