//! `slim`: builds a binary that contains only what one scene needs.
//!
//! Generates a package that depends on `whitstone` without its features, and on the families with
//! the features that the scene needs. The package has its own workspace, because cargo unifies the
//! features of all packages of a workspace. The full binary is built in the same way, so that both
//! have the same profile.

use crate::root;
use clap::Args;
use serde_json::{Value, json};
use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::Instant;
use whitstone::core::Registry;
use whitstone::render::{BuildOptions, Pipeline};
use whitstone::scene::Sources;
use whitstone::{Exit, Failure};

/// Build a binary with only the plugins that a scene needs, and compare it with the full binary
///
/// Both are built like `cargo build --release`, without debug information. They must write the same
/// bytes. Start-up time is the time of a whole run with a film of one pixel. Instructions are
/// counted by valgrind if it is installed.
///
/// Exit code 0 if the slim binary writes the same bytes as this program, 1 if not.
#[derive(Args, Debug)]
#[command(
    help_template = whitstone::commands::HELP_TEMPLATE,
    after_help = "Examples:\n  cargo xtask slim scenes/shapes/sphere.toml\n  cargo xtask slim scenes/shapes/sphere.toml --only -o sphere"
)]
pub(crate) struct Arguments {
    /// Scene file (TOML)
    scene: PathBuf,
    /// Path of the binary [default: target/whitstone/slim/SCENE]
    #[arg(short, long, value_name = "BINARY")]
    output: Option<PathBuf>,
    /// Only build the slim binary and compare its image with that of this program; do not measure
    #[arg(long)]
    only: bool,
    /// Number of runs of each binary, interleaved; medians are reported
    #[arg(long, value_name = "COUNT", default_value_t = 11)]
    runs: usize,
    /// Write the results to this file as JSON
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

/// The folder of packages and binaries.
const FOLDER: &str = "target/whitstone/slim";

/// Runs the command.
pub(crate) fn run(arguments: &Arguments, registry: &Registry) -> Result<Exit, Failure> {
    let scene = arguments.scene.canonicalize();
    let scene = scene.map_err(|error| Failure::usage(format!("{}: {error}", arguments.scene.display())))?;
    let Scene {
        needed,
        parts,
        picture: expected,
        rays,
    } = needed(&scene, registry)?;
    let stem = scene
        .file_stem()
        .unwrap_or_default()
        .to_string_lossy()
        .into_owned();
    let folder = PathBuf::from(FOLDER);
    let slim = build(
        &folder.join("package-slim"),
        &slim_package(&needed, parts, registry),
    )?;
    let output = arguments.output.clone().unwrap_or_else(|| folder.join(&stem));
    std::fs::copy(&slim.binary, &output)
        .map_err(|error| Failure::environment(format!("{}: {error}", output.display())))?;
    let output = output.canonicalize().map_err(Failure::environment)?;

    let same = picture(&output, &[], &scene, &folder.join("slim.exr"))? == expected;
    println!(
        "{}: {} bytes, {} crates",
        output.display(),
        slim.bytes,
        slim.crates.len()
    );
    for (package, features) in &needed {
        println!("  {package}: {}", features.join(", "));
    }
    println!("linked: {}", slim.crates.join(", "));
    println!("same bytes as the full program: {same}");
    let mut report = json!({
        "scene": arguments.scene, "features": needed, "linked": slim.crates,
        "bytes_slim": slim.bytes, "crates_slim": slim.crates.len(), "same_bytes": same,
    });
    if !arguments.only {
        let full = build(&folder.join("package-full"), &full_package())?;
        compare(arguments, &scene, rays, [&full, &slim], &mut report)?;
    }
    if let Some(path) = &arguments.json {
        let text = format!("{report:#}\n");
        whitstone::image::atomic::write_bytes(path, text.as_bytes()).map_err(Failure::environment)?;
    }
    Ok(if same { Exit::Pass } else { Exit::Differs })
}

/// For each package, the features that the scene's plugins need.
type Needed = BTreeMap<&'static str, Vec<String>>;

/// The data of the scene before anything is built for it.
struct Scene {
    needed: Needed,
    /// The features of `whitstone` that the scene needs.
    parts: &'static [&'static str],
    /// The bytes of the EXR file that this program renders.
    picture: Vec<u8>,
    /// Number of traced rays.
    rays: u64,
}

fn needed(scene: &Path, registry: &Registry) -> Result<Scene, Failure> {
    let failure = |sources: &Sources, errors: &_| Failure::usage(sources.report(errors, false));
    let sources =
        Sources::load(scene, &[], registry).map_err(|error| failure(&error.sources, &error.errors))?;
    let (pipeline, named) = Pipeline::load_and(&sources, registry, BuildOptions::default(), |plan| {
        plan.named.clone()
    })
    .map_err(|errors| failure(&sources, &errors))?;
    let mut needed = Needed::new();
    let all: BTreeSet<_> = pipeline.used.union(&named).collect();
    for (family, name) in all {
        let entry = registry
            .get(*family, name)
            .map_err(|error| Failure::usage(error.message))?;
        needed
            .entry(entry.crate_name)
            .or_default()
            .push((*name).to_owned());
    }
    let film = pipeline.render(whitstone::render::RenderOptions::default());
    let image = film.to_image(&pipeline.scene_hash).map_err(Failure::usage)?;
    let path = Path::new(FOLDER).join("expected.exr");
    std::fs::create_dir_all(FOLDER).map_err(Failure::environment)?;
    whitstone::image::exr_io::write(&path, &image).map_err(Failure::environment)?;
    let parts: &[_] = if pipeline.film.paths.is_some() {
        &["paths"]
    } else {
        &[]
    };
    Ok(Scene {
        needed,
        parts,
        picture: std::fs::read(path).map_err(Failure::environment)?,
        rays: film.counters.total(),
    })
}

/// A generated package: its name, the dependencies of its manifest, and its main program.
struct Package {
    name: &'static str,
    dependencies: String,
    main: String,
}

fn slim_package(needed: &Needed, parts: &[&str], registry: &Registry) -> Package {
    let folder = |package: &str| {
        root()
            .join("crates")
            .join(package.trim_start_matches("whitstone-"))
    };
    let dependency = |package: &str, features: &[String]| {
        let path = folder(package).display().to_string();
        format!("{package} = {{ path = {path:?}, default-features = false, features = {features:?} }}\n")
    };
    let parts: Vec<String> = parts.iter().map(|part| (*part).to_owned()).collect();
    let mut dependencies = dependency("whitstone", &parts);
    let mut registered = String::new();
    for (package, features) in needed {
        dependencies += &dependency(package, features);
        let _ = writeln!(
            registered,
            "        {}::register(registry)?;",
            package.replace('-', "_")
        );
    }
    let has = |package: &str, name: &str| {
        needed
            .get(package)
            .is_some_and(|features| features.iter().any(|feature| feature == name))
    };
    let absent = registry
        .entries()
        .filter(|entry| !has(entry.crate_name, entry.name));
    let absent: String = absent
        .map(|entry| {
            let (family, name, package) = (entry.family, entry.name, entry.crate_name);
            format!("    (FamilyName::{family:?}, {name:?}, {package:?}),\n")
        })
        .collect();
    let main = format!(
        "//! Written by `cargo xtask slim`.\n\nuse whitstone::core::FamilyName;\n\n\
         const ABSENT: &[(FamilyName, &str, &str)] = &[\n{absent}];\n\n\
         fn main() -> std::process::ExitCode {{\n    whitstone::slim::run(|registry| {{\n{registered}        \
         registry.omit(ABSENT);\n        Ok(())\n    }})\n}}\n"
    );
    Package {
        name: "slim",
        dependencies,
        main,
    }
}

fn full_package() -> Package {
    let path = root().join("crates/whitstone").display().to_string();
    Package {
        name: "full",
        dependencies: format!("whitstone = {{ path = {path:?} }}\n"),
        main: "//! Written by `cargo xtask slim`.\n\nfn main() -> std::process::ExitCode {\n    \
               whitstone::Cli::new(\"whitstone\").run()\n}\n"
            .to_owned(),
    }
}

/// A binary and its linked packages.
struct Built {
    binary: PathBuf,
    bytes: u64,
    crates: Vec<String>,
}

fn build(folder: &Path, package: &Package) -> Result<Built, Failure> {
    let Package {
        name,
        dependencies,
        main,
    } = package;
    let manifest = format!(
        "[package]\nname = \"{name}\"\nversion = \"0.1.0\"\nedition = \"2024\"\npublish = false\n\n[workspace]\n\n\
         [dependencies]\n{dependencies}\n[profile.release]\nlto = \"thin\"\ncodegen-units = 4\nstrip = true\n"
    );
    let write = |file: &str, text: &str| {
        let path = folder.join(file);
        std::fs::create_dir_all(path.parent().unwrap_or(folder))?;
        // Unchanged files are not rewritten, so that cargo does not rebuild.
        match std::fs::read_to_string(&path) {
            Ok(old) if old == text => Ok(()),
            _ => std::fs::write(path, text),
        }
    };
    write("Cargo.toml", &manifest).map_err(Failure::environment)?;
    write("src/main.rs", main).map_err(Failure::environment)?;
    // The versions of the repository.
    std::fs::copy("Cargo.lock", folder.join("Cargo.lock")).map_err(Failure::environment)?;
    eprintln!("building the {name} binary");
    let target = root().join(FOLDER).join("target");
    cargo(folder, &["build", "--release", "--quiet"], &target)?;
    let tree = [
        "tree",
        "--prefix",
        "none",
        "--edges",
        "normal,no-proc-macro",
        "--format",
        "{p}",
    ];
    let tree = cargo(folder, &tree, &target)?;
    let crates: BTreeSet<String> = tree
        .lines()
        .filter_map(|line| line.split_whitespace().next())
        .filter(|word| word != name)
        .map(str::to_owned)
        .collect();
    let binary = target.join("release").join(name);
    let bytes = std::fs::metadata(&binary).map_err(Failure::environment)?.len();
    Ok(Built {
        binary,
        bytes,
        crates: crates.into_iter().collect(),
    })
}

/// The output of cargo, called in this folder.
fn cargo(folder: &Path, arguments: &[&str], target: &Path) -> Result<String, Failure> {
    let program = std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into());
    let output = Command::new(program)
        .args(arguments)
        .current_dir(folder)
        .env("CARGO_TARGET_DIR", target)
        .env("CARGO_INCREMENTAL", "0")
        .stderr(Stdio::inherit())
        .output()
        .map_err(Failure::environment)?;
    if !output.status.success() {
        return Err(Failure::environment(format!("cargo {} failed", arguments[0])));
    }
    Ok(String::from_utf8_lossy(&output.stdout).into_owned())
}

/// Renders a scene with a program; returns the bytes of the file.
fn picture(program: &Path, before: &[&str], scene: &Path, output: &Path) -> Result<Vec<u8>, Failure> {
    run_quietly(
        Command::new(program)
            .args(before)
            .arg(scene)
            .arg("-o")
            .arg(output),
    )?;
    std::fs::read(output).map_err(Failure::environment)
}

fn run_quietly(command: &mut Command) -> Result<String, Failure> {
    let output = command.output().map_err(|error| {
        Failure::environment(format!("{}: {error}", command.get_program().to_string_lossy()))
    })?;
    let text = String::from_utf8_lossy(&output.stderr).into_owned();
    if output.status.success() {
        Ok(text)
    } else {
        Err(Failure::environment(text))
    }
}

/// Compares both; the full binary comes before the slim one.
fn compare(
    arguments: &Arguments,
    scene: &Path,
    rays: u64,
    both: [&Built; 2],
    report: &mut Value,
) -> Result<(), Failure> {
    let output = PathBuf::from(FOLDER).join("compared.exr");
    let words: [&[&str]; 2] = [&["render"], &[]];
    let command = |which: usize, more: &[&str]| {
        let mut command = Command::new(&both[which].binary);
        command
            .args(words[which])
            .arg(scene)
            .arg("-o")
            .arg(&output)
            .args(more);
        command
    };
    let one_pixel = ["--set", "film.width=1", "--set", "film.height=1"];
    let time = |more: &[&str]| -> Result<[f64; 2], Failure> {
        let mut seconds = [Vec::new(), Vec::new()];
        for _ in 0..=arguments.runs.max(1) {
            for which in 0..2 {
                let start = Instant::now();
                run_quietly(&mut command(which, more))?;
                seconds[which].push(start.elapsed().as_secs_f64());
            }
        }
        Ok(seconds.map(|mut all| {
            // The first run is a warm-up: it reads files into memory.
            all.remove(0);
            all.sort_by(f64::total_cmp);
            1e3 * all[all.len() / 2]
        }))
    };
    let startup = time(&one_pixel)?;
    let whole = time(&["--threads", "1"])?;
    let instructions = [0, 1].map(|which| instructions_of(&command(which, &["--threads", "1"])));
    let starting = [0, 1].map(|which| {
        let mut more = vec!["--threads", "1"];
        more.extend(one_pixel);
        instructions_of(&command(which, &more))
    });
    let [full, slim] = both;
    let percent = |a: f64, b: f64| 100.0 * b / a;
    println!("                      full       slim");
    println!(
        "bytes         {:>12} {:>10}  {:.0} %",
        full.bytes,
        slim.bytes,
        percent(full.bytes as f64, slim.bytes as f64)
    );
    println!(
        "crates        {:>12} {:>10}",
        full.crates.len(),
        slim.crates.len()
    );
    println!("start-up, ms  {:>12.2} {:>10.2}", startup[0], startup[1]);
    println!("whole run, ms {:>12.2} {:>10.2}", whole[0], whole[1]);
    let shown =
        |count: Option<u64>| count.map_or("-".to_owned(), |count| format!("{:.3}", count as f64 / 1e6));
    println!("instructions, million");
    println!(
        "  whole run   {:>12} {:>10}",
        shown(instructions[0]),
        shown(instructions[1])
    );
    println!(
        "  start-up    {:>12} {:>10}",
        shown(starting[0]),
        shown(starting[1])
    );
    let rendering = [0, 1].map(|i| Some(instructions[i]?.saturating_sub(starting[i]?)));
    println!(
        "  rendering   {:>12} {:>10}",
        shown(rendering[0]),
        shown(rendering[1])
    );
    // Measures the benefit of scene-specific specialisation: the same binary with specialisation
    // disabled.
    let general = command(0, &["--threads", "1", "--no-specialization"]);
    let general = instructions_of(&general).zip(starting[0]);
    let general = general.map(|(whole, starting)| whole.saturating_sub(starting));
    let a_ray = [rendering[0], general].map(|count| count.map(|count| count as f64 / rays as f64));
    if let [Some(planned), Some(general)] = a_ray {
        println!(
            "instructions per ray of the full binary: {planned:.1}; {general:.1} with --no-specialization, so specialisation saves {:.0} %",
            100.0 * (1.0 - planned / general)
        );
    }
    report["instructions_per_ray"] = json!(a_ray[0]);
    report["instructions_per_ray_no_specialization"] = json!(a_ray[1]);
    for (key, [full, slim]) in [
        ("bytes", [json!(full.bytes), json!(slim.bytes)]),
        ("crates", [json!(full.crates.len()), json!(slim.crates.len())]),
        ("startup_ms", startup.map(|ms| json!(ms))),
        ("run_ms", whole.map(|ms| json!(ms))),
        ("instructions", instructions.map(|count| json!(count))),
        ("instructions_rendering", rendering.map(|count| json!(count))),
    ] {
        report[format!("{key}_full")] = full;
        report[format!("{key}_slim")] = slim;
    }
    Ok(())
}

/// Instructions of a run, counted by valgrind; nothing if it is not installed.
fn instructions_of(command: &Command) -> Option<u64> {
    let mut counted = Command::new("valgrind");
    counted.args([
        "--tool=cachegrind",
        "--cache-sim=no",
        "--cachegrind-out-file=/dev/null",
    ]);
    counted.arg(command.get_program()).args(command.get_args());
    let text = run_quietly(&mut counted).ok()?;
    let line = text
        .lines()
        .find(|line| line.contains("I   refs:") || line.contains("I refs:"))?;
    let digits: String = line
        .rsplit(':')
        .next()?
        .chars()
        .filter(char::is_ascii_digit)
        .collect();
    digits.parse().ok()
}
