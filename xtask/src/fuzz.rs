//! `fuzz`: coverage-guided fuzzing of everything that reads files, and random scenes.
//!
//! The package `tests/fuzz` is compiled with the coverage counters of LLVM, which the stable
//! compiler has as well, and runs under libFuzzer.

mod against_mitsuba;
mod random_scene;
mod scenes;
mod totals;

use clap::Args;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::Instant;
use totals::Totals;
use whitstone::core::Registry;
use whitstone::{Exit, Failure};

pub(crate) use totals::table;
/// The stored totals.
pub(crate) const RESULT: &str = "studies/results/fuzz.json";

/// The kinds of files, by their extension, and random scenes.
const KINDS: [&str; 17] = [
    SCENES, MITSUBA, "toml", "gltf", "glb", "xml", "pbrt", "obj", "mtl", "ply", "stl", "exr", "png", "jpg",
    "hdr", "pfm", "tif",
];
/// Those that have a target of their own.
const PICTURES: [&str; 6] = ["exr", "png", "jpg", "hdr", "pfm", "tif"];
const SCENES: &str = "scenes";
const MITSUBA: &str = "mitsuba";
/// Larger files make an execution slow.
const MAX_LENGTH: u64 = 20_000;
/// Counters for each branch, and comparisons, so that words and numbers are found.
const FLAGS: &str = "-Cpasses=sancov-module -Cllvm-args=-sanitizer-coverage-level=4 \
    -Cllvm-args=-sanitizer-coverage-inline-8bit-counters -Cllvm-args=-sanitizer-coverage-pc-table \
    -Cllvm-args=-sanitizer-coverage-trace-compares";
/// Everything is below it.
const FOLDER: &str = "target/fuzz";

/// Feed damaged files to everything that reads files, guided by coverage
///
/// Each kind of file is mutated for some time. A file may be refused with an error; a panic, an
/// execution of more than 10 s, or more than 2 GiB of memory is a finding. The seeds are the scenes
/// and assets of the repository, and the files below the folder WHITSTONE_TEST_DATA. Inputs that
/// reached new code stay in target/fuzz/corpus for the next run; findings are in
/// target/fuzz/findings. Needs a C++ compiler.
///
/// The kind `scenes` makes random scenes from the JSON Schema. One that is valid must have the same
/// image, bit for bit, with all accelerators, threads and vector instructions. The kind
/// `mitsuba` validates such scenes against Mitsuba: a scene that fails, or that only one of the two
/// renderers accepts, is a finding.
///
/// Exit code 0 without a finding, 1 with one.
#[derive(Args, Debug)]
#[command(
    help_template = whitstone::commands::HELP_TEMPLATE,
    after_help = "Examples:\n  cargo xtask fuzz\n  cargo xtask fuzz ply gltf --seconds 3600\n  cargo xtask fuzz scenes --first 1000000\n  cargo xtask fuzz scenes --seconds 3600 --json studies/results/fuzz.json"
)]
pub(crate) struct Arguments {
    /// Kinds of files [default: all]
    #[arg(value_name = "KIND", value_parser = KINDS)]
    kinds: Vec<String>,
    /// Time for each kind
    #[arg(long, value_name = "SECONDS", default_value_t = 60)]
    seconds: u64,
    /// Largest file that is made; small ones are read more often in the same time
    #[arg(long, value_name = "BYTES", default_value_t = MAX_LENGTH, value_parser = clap::value_parser!(u64).range(1..=1 << 20))]
    length: u64,
    /// Number of the first random scene; each number is another scene, the same in every run
    /// [default: the first that no run of --json has reached, or 0]
    #[arg(long, value_name = "NUMBER", conflicts_with = "json")]
    first: Option<u64>,
    /// Add what was tried to the totals in this file
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    /// Be a process of the kind `scenes`
    #[arg(long, hide = true, value_name = "ROLE")]
    worker: Option<scenes::Role>,
}

/// What a run has tried.
struct Run {
    /// Files that are read, or images of random scenes.
    executions: u64,
    /// Random scenes.
    scenes: Option<u64>,
    /// Random scenes that were not refused.
    valid: Option<u64>,
    findings: usize,
    /// The number after that of the last random scene.
    next: Option<u64>,
}

/// Longer runs of random scenes are divided, so that a run that is interrupted has added to the
/// totals.
const PART: u64 = 600;

/// Runs the command.
pub(crate) fn run(arguments: &Arguments, registry: &Registry) -> Result<Exit, Failure> {
    if let Some(role) = arguments.worker {
        return scenes::work(role, registry);
    }
    let kinds: Vec<&str> = match arguments.kinds.as_slice() {
        [] => KINDS.to_vec(),
        kinds => kinds.iter().map(String::as_str).collect(),
    };
    let is_file = |kind: &&str| ![SCENES, MITSUBA].contains(kind);
    let programs = kinds.iter().any(is_file).then(build).transpose()?;
    let totals = || match &arguments.json {
        Some(path) => Totals::read(path),
        None => Ok(Totals::default()),
    };
    let mut found = 0;
    for kind in kinds {
        let mut first = match arguments.first {
            Some(first) => first,
            None => totals()?.next(kind),
        };
        let mut left = arguments.seconds;
        while left > 0 {
            let start = Instant::now();
            let (run, seconds) = match (kind, &programs) {
                (SCENES, _) => (scenes::run(first, left.min(PART))?, PART),
                (MITSUBA, _) => (against_mitsuba::run(first, left.min(PART), registry)?, PART),
                (_, Some(programs)) => (fuzz(programs, kind, left, arguments.length)?, left),
                (_, None) => break,
            };
            left = left.saturating_sub(seconds);
            first = run.next.unwrap_or(first);
            found += run.findings;
            if let Some(path) = &arguments.json {
                let mut totals = totals()?;
                totals.add(kind, &run, start.elapsed());
                totals.write(path)?;
            }
        }
    }
    Ok(if found == 0 { Exit::Pass } else { Exit::Differs })
}

/// Compiles the targets; returns their folder.
fn build() -> Result<PathBuf, Failure> {
    let version = Command::new("rustc").arg("-vV").output();
    let version = version.map_err(Failure::environment)?.stdout;
    let version = String::from_utf8_lossy(&version).into_owned();
    let host = version.lines().find_map(|line| line.strip_prefix("host: "));
    let host = host.ok_or_else(|| Failure::environment("rustc does not name its host"))?;
    // With `--target`, the flags do not apply to build scripts.
    let status = Command::new("cargo")
        .args([
            "build",
            "--release",
            "--locked",
            "--quiet",
            "--manifest-path",
            "tests/fuzz/Cargo.toml",
        ])
        .args(["--target-dir", FOLDER, "--target", host])
        .env("RUSTFLAGS", FLAGS)
        .status()
        .map_err(Failure::environment)?;
    if !status.success() {
        return Err(Failure::environment("the fuzz targets do not compile; see above"));
    }
    let programs = Path::new(FOLDER).join(host).join("release");
    std::path::absolute(programs).map_err(Failure::environment)
}

/// Fuzzes one kind of file.
fn fuzz(programs: &Path, kind: &str, seconds: u64, length: u64) -> Result<Run, Failure> {
    let program = programs.join(if PICTURES.contains(&kind) {
        "pictures"
    } else {
        "scenes"
    });
    let folder = |name: &str| -> Result<PathBuf, Failure> {
        let path = Path::new(FOLDER).join(name).join(kind);
        fs::create_dir_all(&path).map_err(Failure::environment)?;
        Ok(path)
    };
    let [corpus, seeds, findings] = [folder("corpus")?, folder("seeds")?, folder("findings")?];
    let sources = std::env::var_os("WHITSTONE_TEST_DATA").map(PathBuf::from);
    for source in [PathBuf::from("scenes")].into_iter().chain(sources) {
        gather(&source, kind, &seeds)?;
    }
    convert(kind, &seeds);
    // Files of /dev/shm are in memory.
    let memory = Path::new("/dev/shm");
    let parent = if memory.is_dir() {
        memory.to_owned()
    } else {
        std::env::temp_dir()
    };
    let inputs = tempfile::tempdir_in(parent).map_err(Failure::environment)?;
    let before = count(&findings);
    let output = Command::new(&program)
        .args([&corpus, &seeds])
        .arg(format!("-max_total_time={seconds}"))
        .arg(format!("-artifact_prefix={}/", findings.display()))
        .arg(format!("-max_len={length}"))
        .args(["-timeout=10", "-rss_limit_mb=2048", "-print_final_stats=1"])
        .env("WHITSTONE_FUZZ", kind)
        .env("WHITSTONE_FUZZ_FOLDER", inputs.path())
        // Threads would make the counters differ from run to run.
        .env("RAYON_NUM_THREADS", "1")
        .stdin(Stdio::null())
        .output()
        .map_err(Failure::environment)?;
    let text = String::from_utf8_lossy(&output.stderr);
    let executed = text
        .lines()
        .find_map(|line| line.strip_prefix("stat::number_of_executed_units: "));
    let found = (count(&findings) - before).max(usize::from(!output.status.success()));
    println!(
        "{kind:<5} {:>9} executions, {} files in the corpus, findings: {found}",
        executed.unwrap_or("unknown"),
        count(&corpus)
    );
    if found > 0 {
        let lines: Vec<&str> = text.lines().filter(|line| !line.starts_with('#')).collect();
        println!("{}", lines[lines.len().saturating_sub(30)..].join("\n"));
        println!(
            "to see it again: WHITSTONE_FUZZ={kind} {} FILE",
            program.display()
        );
    }
    Ok(Run {
        executions: executed.and_then(|count| count.trim().parse().ok()).unwrap_or(0),
        scenes: None,
        valid: None,
        findings: found,
        next: None,
    })
}

/// The number of files in a folder.
fn count(folder: &Path) -> usize {
    fs::read_dir(folder).map_or(0, Iterator::count)
}

/// Copies small files of a kind from below a folder, each under its path, with dashes.
fn gather(folder: &Path, kind: &str, seeds: &Path) -> Result<(), Failure> {
    for entry in fs::read_dir(folder).into_iter().flatten().flatten() {
        let path = entry.path();
        let Ok(metadata) = fs::symlink_metadata(&path) else {
            continue;
        };
        if metadata.is_dir() {
            gather(&path, kind, seeds)?;
        } else if metadata.is_file()
            && metadata.len() <= MAX_LENGTH
            && path
                .extension()
                .is_some_and(|extension| extension.eq_ignore_ascii_case(kind))
        {
            let name = path.display().to_string().replace(['/', '\\'], "-");
            fs::copy(&path, seeds.join(name)).map_err(Failure::environment)?;
        }
    }
    Ok(())
}

/// Makes seeds of a kind that Whitstone writes, from some scenes. Not every format can express
/// every scene.
fn convert(kind: &str, seeds: &Path) {
    let Ok(program) = std::env::current_exe() else {
        return;
    };
    for scene in [
        "shapes/sphere",
        "shapes/csg",
        "materials/matte",
        "showcase/cornell",
        "lights/point",
    ] {
        let to = seeds.join(format!("{}.{kind}", scene.replace('/', "-")));
        let scene = format!("scenes/{scene}.toml");
        let mut command = Command::new(&program);
        match kind {
            "gltf" | "glb" | "xml" | "pbrt" => command.arg("convert").arg(scene).arg(to),
            "exr" | "png" => {
                let small = ["--set", "film.width=8", "--set", "film.height=6"];
                command.arg("render").arg(scene).arg("-o").arg(to).args(small)
            }
            _ => return,
        };
        // A seed that is missing costs nothing but time.
        let _ = command.stdout(Stdio::null()).stderr(Stdio::null()).status();
    }
}
