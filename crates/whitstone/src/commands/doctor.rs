//! `doctor`: checks that everything that Whitstone needs is installed.

use super::{Drivers, Target};
use crate::terminal::{Exit, Failure, write_json};
use clap::Args;
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};
use whitstone_core::Registry;
use whitstone_core::simd::Level;
use whitstone_render::{BuildOptions, Pipeline, RenderOptions};
use whitstone_scene::Sources;
use whitstone_validate::driver::{Hello, PovRay, Versions};
use whitstone_validate::environment::Environment;
use whitstone_validate::stored::Stored;
use whitstone_validate::{Live, REFERENCES, Renderer};

/// Check that rendering and live validation work on this machine, and suggest how to fix problems
///
/// Renders a small picture, looks for Python, creates the private Python environment if it does not
/// exist (a download of about 100 MB, once; see --no-install), starts Mitsuba in it, and queries
/// POV-Ray's version.
///
/// Exit code 0 if rendering and live validation with Mitsuba work, 3 if not. POV-Ray is a second,
/// optional reference (`validate --reference povray`).
#[derive(Args, Debug)]
#[command(
    help_template = super::HELP_TEMPLATE,
    after_help = "Examples:\n  whitstone doctor\n  whitstone doctor --no-install --json doctor.json"
)]
pub struct Arguments {
    /// Write the findings to this file as JSON; - means standard output
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    /// Do not create the Python environment, only look for it
    #[arg(long)]
    no_install: bool,
    /// Print the licences of the packages that are part of this program, and do nothing else
    #[arg(long)]
    licenses: bool,
    #[command(flatten)]
    target: Target,
    /// Folder of the stored references
    #[arg(long, default_value = REFERENCES, value_name = "DIR")]
    references: PathBuf,
    #[command(flatten)]
    drivers: Drivers,
    /// Time limit for the start of Mitsuba, in seconds
    #[arg(long, default_value_t = 120, value_name = "SECONDS")]
    time_limit: u64,
}

/// Written by `cargo xtask readme`.
const LICENCES: &str = include_str!("../licences.txt");

/// The results of all checks.
struct Findings {
    threads: usize,
    rendering: Result<f64, String>,
    environments: usize,
    live: Result<(Hello, PathBuf), String>,
    povray: Result<PovRay, String>,
    stored: usize,
    stored_of_povray: usize,
}

/// Runs the command.
pub fn run(arguments: &Arguments, registry: &Registry) -> Result<Exit, Failure> {
    if arguments.licenses {
        println!("{}", LICENCES.trim_end());
        return Ok(Exit::Pass);
    }
    let rendering = render(registry);
    let installation = arguments.drivers.installation(&arguments.target);
    let environments = environments(&installation.folder);
    let live = if arguments.no_install && Environment::existing(&installation).is_none() {
        Err("its Python environment does not exist yet; run `validate`, or `doctor` without --no-install, to create it".to_owned())
    } else {
        start(arguments)
    };
    let findings = Findings {
        threads: std::thread::available_parallelism().map_or(1, usize::from),
        rendering,
        environments,
        live,
        povray: start_povray(arguments),
        stored: stored_references(&arguments.references, Renderer::MITSUBA),
        stored_of_povray: stored_references(&arguments.references, Renderer::POVRAY),
    };
    print(&findings);
    if let Some(path) = &arguments.json {
        write_json(path, &report(&findings))?;
    }
    match (&findings.rendering, &findings.live) {
        (Err(_), _) => Err(Failure::environment(
            "rendering does not work; see the problem reported above",
        )),
        (Ok(_), Err(_)) if findings.stored > 0 => Err(Failure::environment(format!(
            "live Mitsuba is not available; the {} stored references still work",
            findings.stored
        ))),
        (Ok(_), Err(_)) => Err(Failure::environment(
            "live Mitsuba is not available; rendering works",
        )),
        (Ok(_), Ok(_)) => Ok(Exit::Pass),
    }
}

/// A sphere in front of a background: visible in the middle, not at the corners.
const SCENE: &str = r#"
film = { width = 64, height = 64 }
camera = { type = "perspective", look_at = { origin = [0, 0, 4], target = [0, 0, 0] } }
light = [{ type = "background", radiance = 0.25 }, { type = "ambient", radiance = 2 }]
shape = [{ type = "sphere" }]
"#;

/// Renders an image whose pixels are known: diffuse grey of 0.5 under an ambient light of 2.
fn render(registry: &Registry) -> Result<f64, String> {
    let start = Instant::now();
    let sources =
        Sources::from_text("doctor", SCENE, Path::new(""), &[]).map_err(|error| error.to_string())?;
    let pipeline =
        Pipeline::load(&sources, registry, BuildOptions::default()).map_err(|error| error.to_string())?;
    let film = pipeline.render(RenderOptions::default());
    let (corner, middle) = (film.rgb.first().copied(), film.rgb.get(32 * 64 + 32).copied());
    if (corner, middle) == (Some([0.25; 3]), Some([1.0; 3])) {
        Ok(start.elapsed().as_secs_f64())
    } else {
        Err(format!(
            "the test image is wrong: expected 0.25 in the corner and 1 in the middle, found {corner:?} and {middle:?}"
        ))
    }
}

/// The number of complete Python environments in a folder.
fn environments(folder: &Path) -> usize {
    let folders = std::fs::read_dir(folder).into_iter().flatten().flatten();
    folders
        .filter(|entry| entry.file_name().to_string_lossy().starts_with("python-"))
        .filter(|entry| entry.path().join("complete").is_file())
        .count()
}

/// The versions of Mitsuba, and the Python that runs it.
fn start(arguments: &Arguments) -> Result<(Hello, PathBuf), String> {
    let environment = Environment::ensure(&arguments.drivers.installation(&arguments.target), &|text| {
        eprintln!("{text}")
    })
    .map_err(|error| error.to_string())?;
    let python = environment.python.clone();
    // The answer of an earlier run says nothing about the present state.
    let (reuse, limit) = (false, Duration::from_secs(arguments.time_limit));
    let live = Live::start(
        Renderer::MITSUBA,
        environment,
        arguments.target.folder().join("live"),
        reuse,
        limit,
    )
    .map_err(|error| error.to_string())?;
    match live.versions() {
        Some(Versions::Mitsuba(hello)) => Ok((hello.clone(), python)),
        _ => Err("the driver does not report its version".to_owned()),
    }
}

fn start_povray(arguments: &Arguments) -> Result<PovRay, String> {
    let environment = Environment::of_povray(&arguments.drivers.installation(&arguments.target))
        .map_err(|error| error.to_string())?;
    let limit = Duration::from_secs(arguments.time_limit);
    let live = Live::start(
        Renderer::POVRAY,
        environment,
        arguments.target.folder().join("live"),
        false,
        limit,
    )
    .map_err(|error| error.to_string())?;
    match live.versions() {
        Some(Versions::PovRay(found)) => Ok(found.clone()),
        _ => Err("the driver does not report its version".to_owned()),
    }
}

/// The number of folders at or below `folder` that hold a reference of a renderer.
fn stored_references(folder: &Path, renderer: Renderer) -> usize {
    let mut open = vec![folder.to_owned()];
    let mut count = 0;
    while let Some(folder) = open.pop() {
        count += usize::from(Stored::is_in(&folder, renderer));
        let entries = std::fs::read_dir(&folder).into_iter().flatten().flatten();
        // Links could lead back up.
        open.extend(
            entries
                .filter(|entry| entry.file_type().is_ok_and(|kind| kind.is_dir()))
                .map(|e| e.path()),
        );
    }
    count
}

fn print(findings: &Findings) {
    let row = |name: &str, text: &str| println!("{name:<18} {text}");
    row("whitstone", env!("CARGO_PKG_VERSION"));
    row(
        "machine",
        &format!("{} {}", std::env::consts::OS, std::env::consts::ARCH),
    );
    row("threads", &findings.threads.to_string());
    row("SIMD level", &Level::current().to_string());
    match &findings.rendering {
        Ok(seconds) => row("rendering", &format!("works ({seconds:.3} s for a test image)")),
        Err(problem) => row("rendering", &format!("FAILS: {problem}")),
    }
    row(
        "environments",
        &format!(
            "{} complete Python environments at the start",
            findings.environments
        ),
    );
    match &findings.live {
        Ok((hello, python)) => {
            row(
                "live Mitsuba",
                &format!(
                    "works: {} ({}), Dr.Jit {}",
                    hello.mitsuba, hello.variant, hello.drjit
                ),
            );
            row("python", &format!("{} ({})", hello.python, python.display()));
            row("libLLVM", &format!("{} ({})", hello.libllvm, hello.llvm_version));
            row(
                "cpu",
                &format!("{}, Mitsuba uses {} threads", hello.cpu, hello.threads),
            );
        }
        Err(problem) => {
            row("live Mitsuba", &format!("NOT AVAILABLE: {problem}"));
            row("what to do", advice(problem));
        }
    }
    match &findings.povray {
        Ok(found) => row("live POV-Ray", &format!("works: {}", found.povray)),
        Err(problem) => row("live POV-Ray", &format!("not available: {problem}")),
    }
    row(
        "stored references",
        &format!(
            "{} of Mitsuba, {} of POV-Ray",
            findings.stored, findings.stored_of_povray
        ),
    );
}

/// Advice for the most common problems, in addition to the problem's own message.
fn advice(problem: &str) -> &'static str {
    let problem = problem.to_lowercase();
    if problem.contains("is pypi reachable") {
        "allow access to PyPI once (or set PIP_INDEX_URL to a mirror), then run `doctor` again"
    } else if problem.contains("llvm") {
        "install libLLVM 16 or newer (on Debian: apt-get install libllvm19), or set DRJIT_LIBLLVM_PATH to its path; \
         the library of a Rust toolchain works too: $(rustc --print sysroot)/lib; on Linux x86-64 also: pip install \
         karellen-llvm-core"
    } else {
        "fix the problem reported above; until then, use `validate --reference stored`"
    }
}

fn report(findings: &Findings) -> Value {
    json!({
        "whitstone": env!("CARGO_PKG_VERSION"),
        "os": std::env::consts::OS,
        "architecture": std::env::consts::ARCH,
        "threads": findings.threads,
        "vectors": Level::current().to_string(),
        "rendering": { "works": findings.rendering.is_ok(), "problem": findings.rendering.as_ref().err() },
        "environments": findings.environments,
        "live": {
            "works": findings.live.is_ok(),
            "mitsuba": findings.live.as_ref().ok().map(|(hello, _)| hello),
            "python": findings.live.as_ref().ok().map(|(_, python)| python),
            "problem": findings.live.as_ref().err(),
        },
        "povray": {
            "works": findings.povray.is_ok(),
            "versions": findings.povray.as_ref().ok(),
            "problem": findings.povray.as_ref().err(),
        },
        "stored_references": findings.stored,
        "stored_references_of_povray": findings.stored_of_povray,
    })
}
