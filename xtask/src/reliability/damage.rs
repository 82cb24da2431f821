//! Damaged files.

use super::{Subject, Tally, pick, run_within};
use std::fs;
use std::path::{Path, PathBuf};
use std::time::Duration;
use whitstone::Failure;

/// Files of the repository that are damaged, and the formats into which scenes are converted first.
const SEEDS: [&str; 10] = [
    "scenes/showcase/classic.toml",
    "scenes/showcase/room.toml",
    "scenes/textures/noise.toml",
    "scenes/shapes/csg.toml",
    "scenes/assets/crystal.glb",
    "scenes/assets/star.obj",
    "scenes/assets/icosphere.ply",
    "scenes/assets/corners.png",
    "references/images/materials/matte/mitsuba.exr",
    "scenes/showcase/imported.toml",
];
const CONVERTED: [&str; 3] = ["gltf", "xml", "pbrt"];

/// Numbers that are put into text.
const NUMBERS: [&str; 8] = [
    "-1",
    "0",
    "1e308",
    "nan",
    "4294967296",
    "1e-320",
    "99999999999999999999",
    "\"\"",
];

pub(super) fn run(subject: &Subject) -> Result<Tally, Failure> {
    let mut tally = Tally::default();
    let folder = tempfile::tempdir().map_err(Failure::environment)?;
    let mut seeds: Vec<PathBuf> = SEEDS
        .iter()
        .map(|seed| subject.root.join(seed))
        .filter(|seed| seed.is_file())
        .collect();
    for extension in CONVERTED {
        let path = folder.path().join("converted").with_extension(extension);
        let words = [
            subject.program.display().to_string(),
            "convert".to_owned(),
            "scenes/showcase/classic.toml".to_owned(),
            path.display().to_string(),
        ];
        let output = subject.plain(&words).output().map_err(Failure::environment)?;
        if !path.is_file() {
            return Err(Failure::environment(
                String::from_utf8_lossy(&output.stderr).into_owned(),
            ));
        }
        seeds.push(path);
    }
    let attempts = if subject.quick { 12 } else { 400 };
    for (number, seed) in seeds.iter().enumerate() {
        let bytes = fs::read(seed).map_err(Failure::environment)?;
        for attempt in 0..attempts {
            let damaged = damage(&bytes, (number * attempts + attempt) as u64 * 16);
            let name = seed.file_name().unwrap_or_default();
            // In the folder of the converted scenes, where the files are that they name.
            let path = folder.path().join(format!("damaged-{}", name.to_string_lossy()));
            fs::write(&path, &damaged).map_err(Failure::environment)?;
            let seen = answer(subject, &path)?;
            if seen.is_err() {
                // Kept, so that it can be tried again.
                let kept = std::env::temp_dir()
                    .join(format!("whitstone-{number}-{attempt}-{}", name.to_string_lossy()));
                fs::write(&kept, &damaged).map_err(Failure::environment)?;
                tally.count(seen.map_err(|seen| format!("{}: {seen}", kept.display())));
            } else {
                tally.count(Ok(()));
            }
        }
    }
    Ok(tally)
}

/// What the program does with a file.
fn answer(subject: &Subject, path: &Path) -> Result<Result<(), String>, Failure> {
    let text = path.display().to_string();
    let out = path.with_file_name("out.exr").display().to_string();
    let image = path
        .extension()
        .is_some_and(|extension| extension == "png" || extension == "exr");
    let size = "film={width=8,height=6}";
    let words: Vec<&str> = match image {
        true => vec!["compare", &text, &text],
        false => vec![
            "render",
            &text,
            "-o",
            &out,
            "--set",
            size,
            "--max-memory",
            "1",
            "--max-tree-rays",
            "4096",
        ],
    };
    let program = subject.program.display().to_string();
    let words: Vec<String> = std::iter::once(program.as_str())
        .chain(words)
        .map(str::to_owned)
        .collect();
    let ended =
        run_within(&mut subject.plain(&words), Duration::from_secs(10)).map_err(Failure::environment)?;
    Ok(match ended {
        None => Err("no answer within 10 s".to_owned()),
        Some(output) => {
            let stderr = String::from_utf8_lossy(&output.stderr);
            let code = output.status.code();
            match code {
                _ if stderr.contains("panicked") => Err(stderr.trim().to_owned()),
                Some(0..=3) => Ok(()),
                _ => Err(format!("exit code {code:?}: {}", stderr.trim())),
            }
        }
    })
}

/// The bytes with one to four changes.
fn damage(bytes: &[u8], seed: u64) -> Vec<u8> {
    let mut damaged = bytes.to_vec();
    for change in 0..=pick(seed, 4) as u64 {
        let seed = seed + 4 * change;
        let at = pick(seed + 1, damaged.len());
        let len = (1 + pick(seed + 2, 16)).min(damaged.len() - at);
        let is_digit = |byte: &u8| byte.is_ascii_digit();
        match pick(seed + 3, 6) {
            0 => damaged[at] ^= 1 << pick(seed + 5, 8),
            1 => damaged[at..at + len].fill(0xff),
            2 => drop(damaged.drain(at..at + len)),
            3 => {
                let copy = damaged[at..at + len].to_vec();
                damaged.splice(at..at, copy);
            }
            4 => damaged.truncate(at),
            // The next number of a text.
            _ => {
                let start = damaged[at..]
                    .iter()
                    .position(is_digit)
                    .map_or(at, |digits| at + digits);
                let digits = damaged[start..].iter().take_while(|byte| is_digit(byte)).count();
                let number = NUMBERS[pick(seed + 6, NUMBERS.len())];
                damaged.splice(start..start + digits, number.bytes());
            }
        }
        if damaged.is_empty() {
            break;
        }
    }
    damaged
}
