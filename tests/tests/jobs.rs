//! Jobs: tiles that processes render on their own give the bytes of the whole image, and whatever
//! does not fit the plan is refused.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::{Duration, Instant};
use whitstone_tests::{entries, program, root, skipped};

/// The arguments as owned text.
fn words(arguments: &[&str]) -> Vec<String> {
    arguments.iter().map(|word| (*word).to_owned()).collect()
}

/// Plans a scene of the repository, and returns the number of jobs.
fn plan(scene: &Path, changes: &[String], tile: u32, jobs: &Path) -> usize {
    program!()
        .arg("plan")
        .arg(scene)
        .args(changes)
        .args(["--tile-size", &tile.to_string(), "-o"])
        .arg(jobs)
        .assert()
        .success();
    fs::read_to_string(jobs).unwrap().lines().count()
}

fn run_job(jobs: &Path, index: usize) -> assert_cmd::assert::Assert {
    let mut command = program!();
    command.arg("run-job").arg(jobs);
    command.args(["--index", &index.to_string(), "--target"]);
    command.arg(jobs.with_extension("target")).assert()
}

fn merge(jobs: &Path, output: &Path) -> assert_cmd::assert::Assert {
    program!().arg("merge").arg(jobs).arg("-o").arg(output).assert()
}

fn render(scene: &Path, changes: &[String], output: &Path) -> Vec<u8> {
    program!()
        .arg("render")
        .arg(scene)
        .args(changes)
        .arg("-o")
        .arg(output)
        .assert()
        .success();
    fs::read(output).unwrap()
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

/// Copies the inputs of a file of jobs, and nothing else, to a folder.
fn copy_inputs(jobs: &Path, to: &Path) {
    let line = fs::read_to_string(jobs).unwrap();
    let job: serde_json::Value = serde_json::from_str(line.lines().next().unwrap()).unwrap();
    let from = PathBuf::from(job["folder"].as_str().unwrap());
    for input in job["inputs"].as_array().unwrap() {
        let name = input["path"].as_str().unwrap();
        fs::create_dir_all(to.join(name).parent().unwrap()).unwrap();
        fs::copy(from.join(name), to.join(name)).unwrap();
    }
}

#[test]
fn merged_tiles_are_the_image_of_one_process() {
    let small = ["--set", "film.width=50", "--set", "film.height=37"];
    for (scene, changes) in [
        (
            "showcase/classic.toml",
            vec!["--set", "film.aovs=['depth','normal','uv','shape_id']"],
        ),
        // The number of samples of a pixel depends on its neighbours.
        ("samplers/adaptive.toml", vec![]),
        ("integrators/rasterizer.toml", vec![]),
        ("cameras/thin_lens.toml", vec![]),
        // With files: an include or an import, meshes, textures.
        ("showcase/textured_mesh.toml", vec![]),
        ("assets/crystal.glb", vec!["--max-tree-rays", "5000"]),
    ] {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        let path = root().join("scenes").join(scene);
        let changes = words(&[&small[..], &changes].concat());
        let whole = render(&path, &changes, &at("whole.exr"));
        let jobs = at("jobs.jsonl");
        // Neither the tiles of the renderer nor the blocks of the file.
        let count = plan(&path, &changes, 19, &jobs);
        assert_eq!(count, 6, "{scene}");
        // Somewhere else, with the inputs alone, and the last one first.
        copy_inputs(&jobs, &at("copy"));
        for index in (0..count).rev() {
            program!()
                .current_dir(folder.path())
                .args([
                    "run-job",
                    "jobs.jsonl",
                    "--inputs",
                    "copy",
                    "--index",
                    &index.to_string(),
                ])
                .assert()
                .success();
        }
        merge(&jobs, &at("merged.exr")).success();
        assert!(fs::read(at("merged.exr")).unwrap() == whole, "{scene}");
    }
}

/// A plan of the classic scene in six tiles, of which all are finished.
fn finished(folder: &Path) -> (PathBuf, usize) {
    let jobs = folder.join("jobs.jsonl");
    let scene = root().join("scenes/showcase/classic.toml");
    let changes = words(&["--set", "film={width=30,height=20}"]);
    let count = plan(&scene, &changes, 10, &jobs);
    (0..count).for_each(|index| drop(run_job(&jobs, index).success()));
    (jobs, count)
}

#[test]
fn a_finished_job_is_not_repeated_and_a_damaged_result_is() {
    let folder = tempfile::tempdir().unwrap();
    let (jobs, count) = finished(folder.path());
    let results = folder.path().join("jobs.results");
    assert_eq!((count, entries(&results).len()), (6, 12));
    let image = results.join(
        entries(&results)
            .into_iter()
            .find(|name| name.ends_with(".exr"))
            .unwrap(),
    );
    let id = image.file_stem().unwrap().to_str().unwrap().to_owned();
    let again = || {
        let output = program!()
            .arg("run-job")
            .arg(&jobs)
            .args(["--id", &id])
            .assert()
            .success();
        text(&output.get_output().stdout)
    };
    assert!(again().contains("was finished before"));
    let whole = fs::read(&image).unwrap();
    let mut damaged = whole.clone();
    *damaged.last_mut().unwrap() ^= 1;
    for wrong in [Some(&damaged[..]), Some(&whole[..whole.len() / 2]), None] {
        match wrong {
            Some(bytes) => fs::write(&image, bytes).unwrap(),
            None => fs::remove_file(&image).unwrap(),
        }
        let output = merge(&jobs, &folder.path().join("out.exr")).code(3);
        let told = text(&output.get_output().stderr);
        assert!(
            told.contains("1 of 6 jobs have no complete result") && told.contains(&id),
            "{told}"
        );
        assert!(!folder.path().join("out.exr").exists());
        assert!(again().contains("is finished"));
        assert!(fs::read(&image).unwrap() == whole);
    }
    merge(&jobs, &folder.path().join("out.exr")).success();
}

#[test]
fn what_is_not_of_one_plan_is_not_merged() {
    let folder = tempfile::tempdir().unwrap();
    let (jobs, _) = finished(folder.path());
    let out = folder.path().join("out.exr");
    let other = folder.path().join("other.jsonl");
    let scene = root().join("scenes/showcase/classic.toml");
    plan(
        &scene,
        &words(&["--set", "film={width=30,height=20}"]),
        20,
        &other,
    );
    program!()
        .arg("run-job")
        .arg(&other)
        .args(["--index", "0", "--results"])
        .arg(folder.path().join("jobs.results"))
        .assert()
        .success();
    let lines = fs::read_to_string(&jobs).unwrap();
    let more = fs::read_to_string(&other).unwrap();
    let first = more.lines().next().unwrap();
    for (text_of_jobs, problem) in [
        (format!("{lines}{first}\n"), "overlap or leave gaps"),
        (
            lines.lines().skip(1).collect::<Vec<_>>().join("\n"),
            "overlap or leave gaps",
        ),
        (String::new(), "no jobs"),
        (
            lines.replacen("\"overrides\":[", "\"overrides\":[\"camera.fov=3\",", 1),
            "changed after it was planned",
        ),
        (
            lines.replacen("{\"id\"", "{\"no\"", 1),
            "jobs.jsonl:1: not a job: unknown field `no`",
        ),
    ] {
        fs::write(&jobs, text_of_jobs).unwrap();
        let output = merge(&jobs, &out).failure();
        let told = text(&output.get_output().stderr);
        assert!(told.contains(problem), "{problem}: {told}");
        assert!(!out.exists());
    }
    // The same job twice is no error.
    fs::write(&jobs, format!("{lines}{lines}")).unwrap();
    merge(&jobs, &out).success();
}

#[test]
fn jobs_of_another_program_or_with_other_files_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    for name in ["scene.toml", "wood.png"] {
        let from = match name {
            "scene.toml" => {
                let sky = "[[light]]\ntype = \"ambient\"\nradiance = 1\n";
                let shape = "[[shape]]\ntype = \"sphere\"\nmaterial = { type = \"matte\", reflectance = { type = \"image\", file = \"wood.png\" } }\n";
                let camera = "[camera]\ntype = \"perspective\"\nlook_at = { origin = [0, 0, 4], target = [0, 0, 0] }\n";
                fs::write(
                    at(name),
                    format!("film = {{ width = 8, height = 8 }}\n{camera}{sky}{shape}"),
                )
                .unwrap();
                continue;
            }
            _ => root().join("docs/plugins/textures/image.png"),
        };
        fs::copy(from, at(name)).unwrap();
    }
    let jobs = at("jobs.jsonl");
    assert_eq!(plan(&at("scene.toml"), &[], 64, &jobs), 1);
    let line = fs::read_to_string(&jobs).unwrap();
    assert!(line.contains("wood.png"), "{line}");
    let refused = |code: i32, problem: &str| {
        let told = text(&run_job(&jobs, 0).code(code).get_output().stderr);
        assert!(told.contains(problem), "{problem}: {told}");
        assert!(entries(&at("jobs.results")).is_empty());
    };
    let wood = fs::read(at("wood.png")).unwrap();
    fs::write(at("wood.png"), &wood[1..]).unwrap();
    refused(3, "the file changed after the job was planned");
    fs::remove_file(at("wood.png")).unwrap();
    refused(3, "wood.png: No such file");
    fs::write(at("wood.png"), &wood).unwrap();
    // Another build of the same version.
    let other = at("other");
    fs::copy(env!("CARGO_BIN_EXE_whitstone-under-test"), &other).unwrap();
    let mut bytes = fs::read(&other).unwrap();
    bytes.push(0);
    fs::write(&other, bytes).unwrap();
    let output = Command::new(&other).arg("run-job").arg(&jobs).output().unwrap();
    assert_eq!(output.status.code(), Some(3));
    assert!(text(&output.stderr).contains("only the same program gives the same bytes"));
    for (arguments, problem) in [
        (["--index", "1"], "the file has fewer jobs"),
        (["--id", "nonsense"], "no job of the file has this id"),
    ] {
        let output = program!()
            .arg("run-job")
            .arg(&jobs)
            .args(arguments)
            .assert()
            .code(2);
        assert!(text(&output.get_output().stderr).contains(problem));
    }
    run_job(&jobs, 0).success();
}

#[test]
fn scenes_that_no_other_machine_can_read_are_not_planned() {
    let folder = tempfile::tempdir().unwrap();
    let scene = folder.path().join("scene.toml");
    let mesh = folder.path().join("mesh.obj");
    fs::write(&mesh, "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n").unwrap();
    let elsewhere = tempfile::tempdir().unwrap();
    let other = elsewhere.path().join("mesh.obj");
    fs::copy(&mesh, &other).unwrap();
    let with = |file: &str| {
        let camera = "[camera]\ntype = \"perspective\"\n[[light]]\ntype = \"ambient\"\nradiance = 1\n";
        let shape =
            format!("[[shape]]\ntype = \"mesh\"\nfile = '{file}'\nmaterial = {{ type = \"matte\" }}\n");
        fs::write(&scene, format!("{camera}{shape}")).unwrap();
        let output = program!()
            .arg("plan")
            .arg(&scene)
            .arg("-o")
            .arg(folder.path().join("jobs.jsonl"))
            .assert();
        text(&output.get_output().stderr)
    };
    assert!(with(other.to_str().unwrap()).contains("by an absolute path"));
    assert!(with("none.obj").contains("none.obj"));
    assert_eq!(entries(folder.path()), ["mesh.obj", "scene.toml"]);
    // Nor is a file of the scene overwritten.
    with("mesh.obj");
    let before = fs::read(&scene).unwrap();
    let output = program!()
        .arg("plan")
        .arg(&scene)
        .arg("-o")
        .arg(&scene)
        .assert()
        .code(2);
    assert!(text(&output.get_output().stderr).contains("the scene reads this file"));
    assert_eq!(fs::read(&scene).unwrap(), before);
}

#[test]
fn merged_cases_are_those_of_one_process() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let scenes = ["scenes/shapes/sphere.toml", "scenes/textures"];
    let stored = ["--reference", "stored"];
    let command = || {
        let mut command = program!();
        command.current_dir(root());
        command
    };
    command()
        .arg("plan")
        .args(scenes)
        .args(stored)
        .args(["--validate", "-o"])
        .arg(at("jobs.jsonl"))
        .assert()
        .success();
    let count = fs::read_to_string(at("jobs.jsonl")).unwrap().lines().count();
    assert!(count > 5, "{count}");
    let merge = || {
        let mut command = command();
        command
            .arg("merge")
            .arg(at("jobs.jsonl"))
            .arg("-o")
            .arg(at("report"));
        command.arg("--json").arg(at("merged.json")).assert()
    };
    let told = text(&merge().code(3).get_output().stderr);
    assert!(told.contains("(`validate scenes/shapes/sphere.toml"), "{told}");
    (0..count).for_each(|index| drop(run_job(&at("jobs.jsonl"), index).success()));
    merge().success();
    assert!(at("report/validate/index.html").is_file());
    command()
        .arg("validate")
        .args(scenes)
        .args(stored)
        .arg("--json")
        .arg(at("one.json"))
        .arg("--target")
        .arg(at("target"))
        .assert()
        .success();
    let [merged, one] = ["merged.json", "one.json"].map(|name| {
        let value: serde_json::Value = serde_json::from_slice(&fs::read(at(name)).unwrap()).unwrap();
        let cases = value["results"].as_array().unwrap().iter();
        cases
            .map(|case| ["scene", "status", "rmse", "verdict"].map(|key| case[key].clone()))
            .collect::<Vec<_>>()
    });
    assert_eq!(merged, one);
}

/// A worker that is killed closes the standard input of its job, which then ends.
#[test]
fn an_attached_job_ends_with_its_standard_input() {
    let folder = tempfile::tempdir().unwrap();
    let jobs = folder.path().join("jobs.jsonl");
    let long = [
        "--set",
        "film={width=3000,height=3000}",
        "--set",
        "sampler={type='grid',samples_per_axis=16}",
    ];
    plan(
        &root().join("scenes/showcase/classic.toml"),
        &words(&long),
        3000,
        &jobs,
    );
    let results = folder.path().join("results");
    let mut child = Command::new(env!("CARGO_BIN_EXE_whitstone-under-test"))
        .args(["run-job", "-", "--attached", "--threads", "1", "--results"])
        .arg(&results)
        .arg("--target")
        .arg(folder.path().join("target"))
        .stdin(std::process::Stdio::piped())
        .stdout(std::process::Stdio::null())
        .spawn()
        .unwrap();
    let mut input = child.stdin.take().unwrap();
    std::io::Write::write_all(&mut input, &fs::read(&jobs).unwrap()).unwrap();
    std::thread::sleep(Duration::from_millis(1500));
    assert!(child.try_wait().unwrap().is_none(), "the job was too short");
    let start = Instant::now();
    drop(input);
    assert_eq!(child.wait().unwrap().code(), Some(143));
    assert!(start.elapsed() < whitstone_tests::ENDLESS);
    assert!(entries(&results).is_empty());
}

/// What a farm runs: its description, in a folder of its own, with the program found by its name.
#[cfg(unix)]
#[test]
fn other_programs_run_the_jobs() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let changes = words(&["--set", "film={width=40,height=30}"]);
    let scene = root().join("scenes/showcase/classic.toml");
    let whole = render(&scene, &changes, &at("whole.exr"));
    fs::create_dir(at("bin")).unwrap();
    std::os::unix::fs::symlink(env!("CARGO_BIN_EXE_whitstone-under-test"), at("bin/whitstone")).unwrap();
    let path = std::env::var("PATH").unwrap_or_default();
    let path = format!("{}:{path}", at("bin").display());
    let start = |name: &str| {
        let mut command = Command::new(name);
        command.current_dir(folder.path()).env("PATH", &path);
        command
    };
    let succeeds = |command: &mut Command| {
        let output = command.output().unwrap();
        assert!(
            output.status.success(),
            "{command:?}: {}{}",
            text(&output.stdout),
            text(&output.stderr)
        );
    };
    let fresh = || {
        let _ = fs::remove_dir_all(at("jobs.results"));
        let _ = fs::remove_file(at("classic.exr"));
    };
    let is_whole = || assert!(fs::read(at("classic.exr")).unwrap() == whole);
    succeeds(start("whitstone").arg("plan").arg(&scene).args(&changes).args([
        "--tile-size",
        "10",
        "--make",
        "jobs.mk",
        "--slurm",
        "jobs.sh",
        "--openjd",
        "jobs.json",
    ]));
    // Slurm sets a number for each task, and runs the last comment of its own.
    let script = fs::read_to_string(at("jobs.sh")).unwrap();
    assert!(script.contains("#SBATCH --array=0-11\n"), "{script}");
    for task in 0..12 {
        succeeds(
            start("sh")
                .arg("jobs.sh")
                .env("SLURM_ARRAY_TASK_ID", task.to_string()),
        );
    }
    let merging = script.lines().find_map(|line| line.strip_prefix("#   ")).unwrap();
    succeeds(start("sh").args(["-c", merging]));
    is_whole();
    let has = |name: &str| {
        Command::new(name)
            .arg("--version")
            .output()
            .is_ok_and(|output| output.status.success())
    };
    fresh();
    if has("make") {
        succeeds(start("make").args(["-j2", "-f", "jobs.mk"]));
        is_whole();
        // Nothing is run again.
        let again = start("make").args(["-f", "jobs.mk"]).output().unwrap();
        assert!(
            !text(&again.stdout).contains("run-job"),
            "{}",
            text(&again.stdout)
        );
    } else {
        skipped("make is not here");
    }
    fresh();
    if has("openjd") {
        succeeds(start("openjd").args(["check", "jobs.json"]));
        succeeds(start("openjd").args(["run", "jobs.json", "--step", "merge", "--run-dependencies"]));
        is_whole();
    } else {
        skipped("openjd is not here (pip install openjd-cli)");
    }
}
