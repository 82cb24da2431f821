//! `stress --kernel`: holes and wrong hits of other programs' kernels are found, and none in right
//! ones.

use whitstone_tests::program;

const KERNEL: &str = env!("CARGO_BIN_EXE_small-kernel");

fn judge(fault: &str, rays: &str) -> (Option<i32>, String) {
    let folder = tempfile::tempdir().unwrap();
    let output = program!()
        .current_dir(folder.path())
        .args([
            "stress",
            "--rays",
            rays,
            "--time-limit",
            "10",
            "--kernel",
            KERNEL,
            fault,
        ])
        .output()
        .unwrap();
    let text = String::from_utf8_lossy(&[&output.stdout[..], &output.stderr[..]].concat()).into_owned();
    (output.status.code(), text)
}

fn expect(fault: &str, code: i32, words: &[&str]) -> String {
    let (found, text) = judge(fault, "400");
    assert_eq!(found, Some(code), "{fault}: {text}");
    for word in words {
        assert!(text.contains(word), "{fault}: expected \"{word}\":\n{text}");
    }
    text
}

#[test]
fn a_right_kernel_passes() {
    let (code, text) = judge("", "2000");
    assert_eq!(code, Some(0), "{text}");
    assert!(text.ends_with("pass\n") && text.contains("far ball"), "{text}");
    // Rays hit the meshes; otherwise there would be nothing to find.
    let ball = text.lines().find(|line| line.starts_with("ball")).unwrap();
    let hits: usize = ball.split_whitespace().nth(3).unwrap().parse().unwrap();
    assert!(hits > 1000, "{text}");
}

#[test]
fn broken_kernels_are_found() {
    expect(
        "gaps",
        1,
        &["a hole: origin", "the kernel says a miss, the truth is triangle"],
    );
    for fault in ["shifted", "farthest", "exchanged", "all-distances"] {
        expect(fault, 1, &["DIFFERS: ", "the kernel says triangle"]);
    }
}

#[test]
fn what_a_kernel_does_not_support_is_said() {
    expect(
        "no-lower-end",
        0,
        &["some rays were skipped: rays start at 0", "pass"],
    );
}

#[test]
fn kernels_that_misbehave_are_exit_code_3() {
    expect(
        "short",
        3,
        &["the kernel answered [0, 0, 0, 0] values of t, primitive, u and v to"],
    );
    expect("ends", 3, &["the kernel ended"]);
    expect(
        "hangs",
        3,
        &["the kernel gave no answer to `intersect` within 10 s"],
    );
    let output = program!()
        .args(["stress", "--kernel", "no-such-kernel"])
        .output()
        .unwrap();
    assert_eq!(output.status.code(), Some(3));
    let text = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(text.contains("cannot run the kernel"), "{text}");
}
