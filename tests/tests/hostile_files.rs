//! Files that never end, or that nobody writes: refused by name, in a moment.
#![cfg(target_os = "linux")]

use std::fs;
use std::path::Path;
use std::process::Command;
use std::time::{Duration, Instant};
use whitstone_tests::program;

/// Runs the program, which must refuse the file quickly.
fn refused(folder: &Path, arguments: &[&str], name: &str) {
    let start = Instant::now();
    let output = program!()
        .current_dir(folder)
        .args(arguments)
        .timeout(Duration::from_secs(10))
        .output()
        .unwrap();
    let text = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{arguments:?}: {text}");
    assert!(text.contains(name), "{arguments:?} should name {name}: {text}");
    assert!(start.elapsed() < Duration::from_secs(5), "{arguments:?}");
}

/// A scene with a texture and with a shape of a file.
fn scene(folder: &Path, name: &str, texture: &str, mesh: &str) {
    let text = format!(
        r#"
camera = {{ type = "perspective", look_at = {{ origin = [0, 0, 4], target = [0, 0, 0] }} }}
[[shape]]
type = "rectangle"
material = {{ type = "matte", reflectance = {{ type = "image", file = "{texture}" }} }}
[[shape]]
type = "mesh"
file = "{mesh}"
"#
    );
    fs::write(folder.join(name), text).unwrap();
}

#[test]
fn pipes_and_files_of_the_system_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    for name in [
        "pipe.exr",
        "pipe.png",
        "pipe.ply",
        "pipe.glb",
        "pipe.toml",
        "pipe.xml",
    ] {
        let made = Command::new("mkfifo")
            .arg(folder.path().join(name))
            .status()
            .unwrap();
        assert!(made.success());
    }
    std::os::unix::fs::symlink("/proc/kmsg", folder.path().join("kmsg.png")).unwrap();
    std::os::unix::fs::symlink("/proc/kmsg", folder.path().join("kmsg.obj")).unwrap();
    std::os::unix::fs::symlink("/dev/zero", folder.path().join("zero.exr")).unwrap();
    refused(folder.path(), &["compare", "pipe.exr", "pipe.exr"], "pipe.exr");
    refused(folder.path(), &["compare", "zero.exr", "zero.exr"], "zero.exr");
    for file in ["pipe.toml", "pipe.glb", "pipe.ply", "pipe.xml"] {
        refused(folder.path(), &["render", file], file);
        refused(folder.path(), &["convert", file], file);
    }
    for (texture, mesh) in [
        ("pipe.png", "pipe.ply"),
        ("kmsg.png", "kmsg.obj"),
        ("zero.exr", "pipe.glb"),
    ] {
        scene(folder.path(), "scene.toml", texture, mesh);
        // The report has both problems.
        refused(folder.path(), &["render", "scene.toml"], texture);
        refused(folder.path(), &["render", "scene.toml"], mesh);
    }
}

/// It sets the title of a window and clears the screen.
#[test]
fn control_characters_of_a_name_do_not_reach_the_terminal() {
    let folder = tempfile::tempdir().unwrap();
    let name = "\u{1b}]0;title\u{7}\u{1b}[2J.toml";
    for exists in [false, true] {
        if exists {
            fs::write(
                folder.path().join(name),
                format!("camera = {{ type = \"{}\" }}", "\\u001b[2J"),
            )
            .unwrap();
        }
        for arguments in [&["render", name][..], &["validate", name], &["explain", name]] {
            let output = program!()
                .current_dir(folder.path())
                .args(arguments)
                .output()
                .unwrap();
            let text = [output.stdout, output.stderr].concat();
            assert!(!text.contains(&0x1b) && !text.contains(&7), "{arguments:?}");
            assert!(
                String::from_utf8_lossy(&text).contains("\\u{1b}]0;title"),
                "{arguments:?}"
            );
        }
    }
}

/// 20 GB of nothing: its size is looked at before it is read.
#[test]
fn a_large_sparse_file_is_refused_by_its_size() {
    let folder = tempfile::tempdir().unwrap();
    for name in ["large.png", "large.obj"] {
        let file = fs::File::create(folder.path().join(name)).unwrap();
        if file.set_len(20 << 30).is_err() {
            println!("skipped: the file system has no sparse files");
            return;
        }
    }
    scene(folder.path(), "scene.toml", "large.png", "large.obj");
    refused(folder.path(), &["render", "scene.toml"], "large.png");
    refused(
        folder.path(),
        &["render", "scene.toml", "--max-memory", "1"],
        "limit: 1.000 GiB",
    );
}
