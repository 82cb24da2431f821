//! Peaks of memory.

use super::{Subject, Tally};
use std::fmt::Write as _;
use std::fs;
use std::path::Path;
use std::process::Stdio;
use std::time::{Duration, Instant};
use whitstone::Failure;
use whitstone::image::Raster;

const MIB: u64 = 1 << 20;
const CAMERA: &str = "[camera]\ntype = \"perspective\"\nlook_at = { origin = [0, 0, 4], target = [0, 0, 0] }\n[[shape]]\ntype = \"sphere\"\n";
const FILM: &str = "film = { width = 64, height = 48 }\n";

/// A scene and its limits in MiB.
struct Load {
    name: &'static str,
    limits: &'static [u64],
    more: &'static [&'static str],
    write: fn(&Path) -> Result<String, Failure>,
}

const LOADS: [Load; 5] = [
    Load {
        name: "a film of 8192 x 8192",
        limits: &[64, 1024],
        more: &[],
        write: |_| Ok(format!("film = {{ width = 8192, height = 8192 }}\n{CAMERA}")),
    },
    Load {
        name: "200 pictures of 1024 x 1024",
        limits: &[64, 512],
        more: &[],
        write: pictures,
    },
    Load {
        name: "100,000 lights",
        limits: &[16, 256],
        more: &["--threads", "16", "--set", "film={width=16,height=12}"],
        write: |_| {
            let mut text = format!("{FILM}{CAMERA}");
            for light in 0..100_000 {
                let x = f64::from(light) * 1e-3;
                let _ = write!(
                    text,
                    "[[light]]\ntype = \"point\"\nposition = [{x}, 5, 5]\nintensity = 1e-4\n"
                );
            }
            Ok(text)
        },
    },
    Load {
        name: "a mesh that is divided seven times",
        limits: &[64, 1024],
        more: &[],
        write: |_| {
            let mesh = std::path::absolute("scenes/assets/star.obj").map_err(Failure::environment)?;
            Ok(format!(
                "{FILM}{CAMERA}[[shape]]\ntype = \"mesh\"\nfile = \"{}\"\nsubdivision = {{ scheme = \"loop\", levels = 7 }}\n",
                mesh.display()
            ))
        },
    },
    Load {
        name: "ray trees of depth 100,000",
        limits: &[64],
        more: &[
            "--threads",
            "16",
            "--set",
            "film={width=32,height=24}",
            "--set",
            "integrator.max_depth=100000",
        ],
        write: |_| {
            fs::read_to_string("scenes/showcase/nested_dielectrics.toml").map_err(Failure::environment)
        },
    },
];

fn pictures(folder: &Path) -> Result<String, Failure> {
    let mut text = format!("{FILM}{CAMERA}");
    for number in 0..200_u32 {
        let name = format!("{number}.png");
        let raster = Raster::filled(1024, 1024, [number as u8, 100, 7]);
        raster
            .write_png(folder.join(&name))
            .map_err(Failure::environment)?;
        let _ = write!(
            text,
            "[[shape]]\ntype = \"sphere\"\nradius = 0.01\ncenter = [{}, 0, 0]\nmaterial = {{ type = \"matte\", reflectance = {{ type = \"image\", file = \"{name}\" }} }}\n",
            f64::from(number) * 0.01
        );
    }
    Ok(text)
}

pub(super) fn run(subject: &Subject) -> Result<Tally, Failure> {
    let mut tally = Tally::default();
    if !cfg!(target_os = "linux") {
        tally.skipped = Some("the peak of memory is known on Linux only.".to_owned());
        return Ok(tally);
    }
    for load in &LOADS {
        let folder = tempfile::tempdir().map_err(Failure::environment)?;
        let scene = folder.path().join("scene.toml");
        fs::write(&scene, (load.write)(folder.path())?).map_err(Failure::environment)?;
        for limit in load.limits {
            let gib = (*limit as f64 / 1024.0).to_string();
            let (scene, output) = (
                scene.display().to_string(),
                folder.path().join("x.exr").display().to_string(),
            );
            let program = subject.program.display().to_string();
            let first = [
                program.as_str(),
                "render",
                &scene,
                "-o",
                &output,
                "--max-memory",
                &gib,
            ];
            let words: Vec<String> = first
                .iter()
                .chain(load.more)
                .map(|word| (*word).to_owned())
                .collect();
            let (peak, code, stderr) = peak(subject, &words, &folder.path().join("stderr"))?;
            let most = limit * 11 / 10 + 64;
            // Refused for its size, not for a fault of the scene.
            let refused = code == Some(2)
                && ["more than the limit", "pending rays"]
                    .iter()
                    .any(|why| stderr.contains(why));
            tally.count(match code {
                Some(0 | 2) if peak > most * MIB => {
                    Err(format!("{}, limit {limit} MiB: {} MiB", load.name, peak / MIB))
                }
                Some(0) => Ok(()),
                _ if refused => Ok(()),
                _ => Err(format!(
                    "{}, limit {limit} MiB: exit code {code:?}: {}",
                    load.name,
                    stderr.trim()
                )),
            });
        }
    }
    Ok(tally)
}

/// A size in bytes that the system reports of a process; `None` if it does not.
pub(super) fn of_status(process: u32, key: &str) -> Option<u64> {
    let text = fs::read_to_string(format!("/proc/{process}/status")).ok()?;
    let size = text.lines().find_map(|line| line.strip_prefix(key))?;
    let kib: u64 = size.trim().strip_suffix("kB")?.trim().parse().ok()?;
    Some(kib << 10)
}

/// The peak of the resident memory in bytes, the exit code (none if it does not end), and the
/// messages, which are written to a file.
fn peak(subject: &Subject, words: &[String], messages: &Path) -> Result<(u64, Option<i32>, String), Failure> {
    let mut child = subject
        .plain(words)
        .env_remove("RAYON_NUM_THREADS")
        .stdout(Stdio::null())
        .stderr(fs::File::create(messages).map_err(Failure::environment)?)
        .spawn()
        .map_err(Failure::environment)?;
    let (start, mut peak) = (Instant::now(), 0);
    let code = loop {
        peak = peak.max(of_status(child.id(), "VmHWM:").unwrap_or(0));
        if let Some(status) = child.try_wait().map_err(Failure::environment)? {
            break status.code();
        }
        if start.elapsed() > Duration::from_secs(120) {
            child
                .kill()
                .and_then(|()| child.wait())
                .map_err(Failure::environment)?;
            break None;
        }
        std::thread::sleep(Duration::from_millis(2));
    };
    Ok((peak, code, fs::read_to_string(messages).unwrap_or_default()))
}
