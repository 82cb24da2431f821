//! Images of other processors.

use super::{Subject, Tally, run_within};
use rayon::prelude::*;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Duration;
use whitstone::Failure;

/// The compiler's name of arm64 under Linux.
const TARGET: &str = "aarch64-unknown-linux-gnu";
/// Debian's packages with a linker, the C library and an emulator for it.
const PACKAGES: &str = "gcc-aarch64-linux-gnu libc6-dev-arm64-cross qemu-user";
/// The C library of arm64.
const LIBRARIES: &str = "/usr/aarch64-linux-gnu";
/// glibc chooses its functions by the processor, here as for one without these instructions.
const OLDER: (&str, &str) = ("GLIBC_TUNABLES", "glibc.cpu.hwcaps=-AVX512F,-AVX2,-FMA,-FMA4");
/// A quick run tries every eighth scene.
const QUICK_STEP: usize = 8;
/// The emulator takes some 30 times as long, and fractals seconds without it.
const LIMIT: Duration = Duration::from_secs(600);

pub(super) fn run(subject: &Subject) -> Result<Tally, Failure> {
    let mut tally = Tally::default();
    if !cfg!(all(target_os = "linux", target_arch = "x86_64")) {
        tally.skipped = Some("needs Linux on x86-64.".to_owned());
        return Ok(tally);
    }
    let own = subject.program.display().to_string();
    let mut others = vec![("functions of older processors", vec![own.clone()], Some(OLDER))];
    for level in ["avx2", "baseline"] {
        others.push((level, vec![own.clone()], Some(("WHITSTONE_SIMD", level))));
    }
    if !subject.quick {
        match arm64(subject) {
            Ok(words) => others.push(("arm64", words, None)),
            Err(why) => {
                tally.skipped = Some(why);
                return Ok(tally);
            }
        }
    }
    let folder = tempfile::tempdir().map_err(Failure::environment)?;
    let scenes = whitstone::validate::find_scenes(&[subject.root.join("scenes")]);
    let scenes = scenes.map_err(Failure::environment)?;
    let seen: Vec<Vec<Result<(), String>>> = scenes
        .par_iter()
        .step_by(if subject.quick { QUICK_STEP } else { 1 })
        .enumerate()
        .map(|(number, scene)| {
            let image = |words: &[String], variable| {
                let path = folder.path().join(format!("{number}.exr"));
                image(subject, words, variable, scene, &path)
            };
            let expected = image(std::slice::from_ref(&own), None);
            let compared = others.iter().map(|(name, words, variable)| {
                let told = |what: &str| format!("{}, {name}: {what}", scene.display());
                match (&expected, &image(words, *variable)) {
                    (Ok(expected), Ok(found)) if expected == found => Ok(()),
                    (Ok(_), Ok(_)) => Err(told("another image")),
                    (Err(error), _) | (_, Err(error)) => Err(told(error)),
                }
            });
            compared.collect()
        })
        .collect();
    seen.into_iter().flatten().for_each(|seen| tally.count(seen));
    Ok(tally)
}

/// The bytes of the file that a program writes of a scene.
fn image(
    subject: &Subject,
    words: &[String],
    variable: Option<(&str, &str)>,
    scene: &Path,
    path: &Path,
) -> Result<Vec<u8>, String> {
    let size = ["--set", "film.width=32", "--set", "film.height=24"].map(str::to_owned);
    let file = |path: &Path| path.display().to_string();
    let rest = ["render".to_owned(), file(scene), "-o".to_owned(), file(path)];
    let words: Vec<String> = words.iter().cloned().chain(rest).chain(size).collect();
    let mut command = subject.plain(&words);
    command.envs(variable);
    let output = run_within(&mut command, LIMIT).map_err(|error| error.to_string())?;
    let output = output.ok_or_else(|| format!("no image within {} s", LIMIT.as_secs()))?;
    if !output.status.success() {
        return Err(String::from_utf8_lossy(&output.stderr).trim().to_owned());
    }
    fs::read(path).map_err(|error| error.to_string())
}

/// Compiles the program for arm64; returns the words that run it, or why it cannot.
fn arm64(subject: &Subject) -> Result<Vec<String>, String> {
    let said = |command: &mut Command| {
        let output = command.output().map_err(|error| error.to_string())?;
        match output.status.success() {
            true => Ok(()),
            false => Err(String::from_utf8_lossy(&output.stderr).trim().to_owned()),
        }
    };
    for tool in ["aarch64-linux-gnu-gcc", "qemu-aarch64"] {
        said(Command::new(tool).arg("--version"))
            .map_err(|_| format!("needs {tool} (Debian: apt-get install {PACKAGES})."))?;
    }
    let folder = subject.root.join("target/arm64");
    let mut build = Command::new("cargo");
    build
        .args([
            "build",
            "--profile",
            "ci",
            "--locked",
            "--package",
            "whitstone",
            "--bin",
            "whitstone",
        ])
        .args(["--target", TARGET, "--target-dir"])
        .arg(&folder)
        .current_dir(&subject.root)
        .env(
            "CARGO_TARGET_AARCH64_UNKNOWN_LINUX_GNU_LINKER",
            "aarch64-linux-gnu-gcc",
        );
    said(&mut build)
        .map_err(|error| format!("needs Rust for arm64 (rustup target add {TARGET}): {error}"))?;
    let program: PathBuf = folder.join(TARGET).join("ci/whitstone");
    Ok(vec![
        "qemu-aarch64".to_owned(),
        "-L".to_owned(),
        LIBRARIES.to_owned(),
        program.display().to_string(),
    ])
}
