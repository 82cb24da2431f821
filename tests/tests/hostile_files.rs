//! Files that never end, or that nobody writes, ray trees without end, and systems without threads.
#![cfg(target_os = "linux")]

use std::fs;
use std::os::unix::fs::{MetadataExt, PermissionsExt};
use std::path::Path;
use std::process::Command;
use std::time::{Duration, Instant};
use whitstone_tests::{ENDLESS, program, root, skipped};

/// Runs the program, which must refuse the file.
fn refused(folder: &Path, arguments: &[&str], name: &str) {
    let output = program!()
        .current_dir(folder)
        .args(arguments)
        .timeout(ENDLESS)
        .output()
        .unwrap();
    let text = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{arguments:?}: {text}");
    assert!(text.contains(name), "{arguments:?} should name {name}: {text}");
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
            skipped("the file system has no sparse files");
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

/// Each surface reflects and transmits, so a tree of depth d has up to 2^d rays.
#[test]
fn ray_trees_without_end_are_an_error() {
    let folder = tempfile::tempdir().unwrap();
    for scene in ["showcase/nested_dielectrics", "showcase/priorities"] {
        let scene = root().join("scenes").join(scene).with_extension("toml");
        let render = |more: &[&str]| {
            let start = Instant::now();
            let output = program!()
                .current_dir(folder.path())
                .arg("render")
                .arg(&scene)
                .args(["-o", "x.exr", "--set", "film.width=8", "--set", "film.height=6"])
                .args([
                    "--set",
                    "sampler.type=center",
                    "--set",
                    "integrator.max_depth=200",
                ])
                .args(more)
                .timeout(Duration::from_secs(60))
                .output()
                .unwrap();
            let text = String::from_utf8_lossy(&output.stderr).into_owned();
            (output.status.code(), text, start.elapsed())
        };
        let image = folder.path().join("x.exr");
        let _ = fs::remove_file(&image);
        let (code, text, time) = render(&["--max-tree-rays", "1000"]);
        assert_eq!(code, Some(2), "{text}");
        assert!(
            text.contains("more than 1000 rays: decrease `max_depth` of the integrator, or increase its `min_contribution`, or set another limit (`--max-tree-rays`"),
            "{text}"
        );
        assert!(time < ENDLESS, "{time:?}");
        assert!(!image.exists());
        let adaptive = ["--max-tree-rays", "1000", "--set", "sampler.type=adaptive"];
        let (code, text, _) = render(&adaptive);
        assert_eq!(code, Some(2), "{text}");
        // With the default limit it ends as well.
        let (code, text, _) = render(&[]);
        assert!(
            code == Some(0) || text.contains("more than 1048576 rays"),
            "{text}"
        );
        let (code, text, _) = render(&[
            "--max-tree-rays",
            "1000",
            "--set",
            "integrator.min_contribution=0.01",
        ]);
        assert_eq!(code, Some(0), "{text}");
    }
}

/// A single pixel is traced within the share of a thread, as it is when the image is rendered.
#[test]
fn a_pixel_has_the_memory_of_a_thread() {
    let scene = root().join("scenes/showcase/nested_dielectrics.toml");
    let output = program!()
        .arg("explain")
        .arg(&scene)
        .args(["--pixel", "4,3", "--reference", "none", "--max-memory", "0.1"])
        .args(["--set", "film={width=8,height=6}", "--set", "sampler.type=center"])
        .args(["--set", "integrator.max_depth=100000"])
        .timeout(Duration::from_secs(60))
        .output()
        .unwrap();
    let text = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{text}");
    assert!(text.contains("pending rays"), "{text}");
}

/// A user who may start no further thread or process. Needs another user than root, whom the limit
/// does not hold.
#[test]
fn without_threads_one_thread_renders() {
    let is_root = fs::metadata("/proc/self").is_ok_and(|own| own.uid() == 0);
    let has = |tool: &str| Command::new(tool).arg("--version").output().is_ok();
    if !is_root || !has("setpriv") || !has("prlimit") {
        skipped("this test starts the program as another user, with setpriv and prlimit");
        return;
    }
    // In a folder that the other user may read and write.
    let folder = tempfile::tempdir_in("/tmp").unwrap();
    // Not as an option of the folder's creation, which the umask would restrict.
    fs::set_permissions(folder.path(), fs::Permissions::from_mode(0o777)).unwrap();
    let program = folder.path().join("whitstone");
    fs::copy(program!().get_program(), &program).unwrap();
    let ball = "film = { width = 40, height = 30 }\n\
        camera = { type = \"perspective\", look_at = { origin = [0, 0, 4], target = [0, 0, 0] } }\n\
        light = [{ type = \"ambient\", radiance = 1 }]\n\
        shape = [{ type = \"sphere\" }]\n";
    fs::write(folder.path().join("ball.toml"), ball).unwrap();
    let run = |processes: &str, arguments: &[&str]| {
        Command::new("setpriv")
            .args([
                "--reuid",
                "54321",
                "--regid",
                "54321",
                "--clear-groups",
                "prlimit",
            ])
            .arg(format!("--nproc={processes}"))
            .arg(&program)
            .args(arguments)
            .current_dir(folder.path())
            .env("RUST_BACKTRACE", "0")
            .output()
            .unwrap()
    };
    let render = |processes: &str, name: &str| {
        let output = run(processes, &["render", "ball.toml", "-o", name]);
        let text = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(0), "{processes}: {text}");
        fs::read(folder.path().join(name)).unwrap()
    };
    assert_eq!(render("1", "one.exr"), render("1000", "many.exr"));
    // A page needs threads.
    for processes in ["1", "12"] {
        let output = run(processes, &["view", "ball.toml", "--target", "target"]);
        let text = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(3), "{processes}: {text}");
        assert!(text.contains("it needs 16 threads"), "{processes}: {text}");
    }
}

/// With `--root`, no file outside of it is read, whatever names it.
#[test]
fn files_outside_of_the_root_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let root = folder.path().join("root");
    fs::create_dir_all(root.join("scenes")).unwrap();
    let secret = "secret = [\"of this line nothing is shown\"\n";
    for name in ["secret.toml", "secret.obj", "secret.mtl", "secret.png"] {
        fs::write(folder.path().join(name), secret).unwrap();
    }
    std::os::unix::fs::symlink(folder.path().join("secret.png"), root.join("link.png")).unwrap();
    fs::write(root.join("inside.obj"), "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n").unwrap();
    fs::write(
        root.join("scenes/outside.obj"),
        "mtllib ../../secret.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n",
    )
    .unwrap();
    let camera = r#"camera = { type = "perspective", look_at = { origin = [0, 0, 4], target = [0, 0, 0] } }"#;
    let shape = |file: &str| format!("{camera}\n[[shape]]\ntype = \"mesh\"\nfile = \"{file}\"\n");
    let texture = |file: &str| {
        format!(
            "{camera}\n[[shape]]\ntype = \"sphere\"\nmaterial = {{ type = \"matte\", reflectance = {{ type = \"image\", file = \"{file}\" }} }}\n"
        )
    };
    for (name, text, is_inside) in [
        ("inside", shape("../inside.obj"), true),
        (
            "include",
            format!("include = [\"../../secret.toml\"]\n{camera}\n"),
            false,
        ),
        (
            "absolute",
            format!("include = [\"/etc/passwd\"]\n{camera}\n"),
            false,
        ),
        ("mesh", shape("../../secret.obj"), false),
        ("texture", texture("../../secret.png"), false),
        ("link", texture("../link.png"), false),
        (
            "import",
            format!("{camera}\n[[import]]\nfile = \"../../secret.obj\"\n"),
            false,
        ),
        (
            "companion",
            format!("{camera}\n[[import]]\nfile = \"outside.obj\"\nallow_outside = true\n"),
            false,
        ),
    ] {
        let scene = root.join("scenes").join(name).with_extension("toml");
        fs::write(&scene, text).unwrap();
        for command in ["render", "validate", "convert"] {
            let mut run = program!();
            run.current_dir(folder.path()).arg(command).arg(&scene);
            match command {
                "render" => run.args(["-o", "x.exr", "--set", "film={width=8,height=6}"]),
                "validate" => run.args(["--reference", "stored"]),
                _ => run.arg("x.toml"),
            };
            let output = run.arg("--root").arg(&root).output().unwrap();
            let text = String::from_utf8_lossy(&output.stderr);
            let refused = text.contains("(`--root`)") || text.contains("is outside of the folder");
            assert_eq!(refused, !is_inside, "{command} {name}: {text}");
            assert!(!text.contains("of this line"), "{command} {name}: {text}");
            if command != "validate" {
                assert_eq!(
                    output.status.code(),
                    Some(if is_inside { 0 } else { 2 }),
                    "{command} {name}: {text}"
                );
            }
        }
    }
}
