//! `bench sizes`: run time against the number of pixels, compared with Mitsuba's own integrators
//! and POV-Ray.
//!
//! Small images measure the fixed cost of a renderer, large ones its cost per pixel, so both are
//! fitted: `seconds = fixed + cost * pixels`. Mitsuba renders the scene that `convert` exports, by
//! its C++ integrator `path` with one sample per pixel, which follows one ray per hit where we
//! follow all. No Python runs while it is timed.

use super::machine::{date, load, processor};
use super::{fetch, median, povray};
use clap::Args;
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::Instant;
use whitstone::core::Registry;
use whitstone::render::{BuildOptions, Pipeline, RenderOptions};
use whitstone::scene::{Flattened, Plan, Sources};
use whitstone::validate::Installation;
use whitstone::validate::driver::{Driver, Setting};
use whitstone::validate::environment::Environment;
use whitstone::validate::exported::{self, ExportedMitsuba};
use whitstone::{Exit, Failure};

/// Benchmark scenes at several image sizes, interleaved with Mitsuba, and fit fixed cost and cost
/// per pixel
///
/// Whole commands are timed as well, from the start of the process to its end.
#[derive(Args, Debug)]
#[command(
    help_template = whitstone::commands::HELP_TEMPLATE,
    after_help = "Examples:\n  cargo build --release -p whitstone && cargo xtask bench sizes\n  cargo xtask bench sizes scenes/showcase/cornell.toml --sizes 256,1024 --threads 1"
)]
pub(super) struct Arguments {
    /// Scene files
    #[arg(value_name = "SCENE", default_values = ["scenes/showcase/classic.toml", "scenes/showcase/facing_mirrors.toml", "scenes/showcase/glass_mesh.toml"])]
    scenes: Vec<PathBuf>,
    /// Widths in pixels; the height is the same
    #[arg(long, value_name = "PIXELS", value_delimiter = ',', default_values_t = [128, 256, 512, 1024, 2048])]
    sizes: Vec<u32>,
    /// Numbers of threads, of all renderers
    #[arg(long, value_name = "COUNT", value_delimiter = ',', default_values_t = [1, 2])]
    threads: Vec<usize>,
    /// Number of rounds; each times everything once
    #[arg(long, value_name = "COUNT", default_value_t = 5)]
    rounds: usize,
    /// The program whose whole command is timed [default: `whitstone` beside this program]
    #[arg(long, value_name = "FILE")]
    whitstone: Option<PathBuf>,
    #[command(flatten)]
    folder: fetch::Folder,
    /// Write the results to this file as JSON
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

/// A scene of the dragon, whose whole command is timed if the mesh is in the data folder.
const DRAGON: &str = r#"# Stanford's dragon, 871,414 triangles in a text PLY file.

[film]
width = 1024
height = 1024

[camera]
type = "perspective"
look_at = { origin = [-0.05, 0.17, 0.33], target = [-0.01, 0.125, 0] }
fov = 40

[[light]]
type = "directional"
direction = [-1, -2, -1.5]
irradiance = 3

[[light]]
type = "background"
radiance = 0.2

[[shape]]
type = "mesh"
file = "dragon.ply"
material = { type = "matte", reflectance = [0.7, 0.6, 0.4] }
"#;

/// The scene that also exists in POV-Ray's language.
const CLASSIC: &str = "scenes/showcase/classic.toml";

/// The sizes of the images of whole commands.
const COMMAND_SIZES: [u32; 3] = [256, 1024, 2048];
const FIRST_RUN: &str = "Mitsuba, llvm_ad_rgb, first run (compiles its kernels)";

const VARIANTS: [&str; 2] = ["llvm_ad_rgb", "scalar_rgb"];

/// The times of one renderer at each size.
struct Series {
    name: String,
    seconds: Vec<f64>,
}

impl Series {
    fn new(name: impl Into<String>) -> Self {
        Self {
            name: name.into(),
            seconds: Vec::new(),
        }
    }

    fn json(&self, sizes: &[u32]) -> Value {
        let (fixed, cost) = fit(sizes, &self.seconds);
        json!({ "name": self.name, "seconds": self.seconds, "fixed_s": fixed, "ns_per_pixel": 1e9 * cost })
    }
}

/// `seconds = fixed + cost * pixels`, with the least sum of squared relative errors; the fixed cost
/// is at least 0.
fn fit(sizes: &[u32], seconds: &[f64]) -> (f64, f64) {
    let points = || {
        sizes
            .iter()
            .zip(seconds)
            .map(|(side, s)| (f64::from(*side).powi(2), *s))
    };
    // Of the rows (1/s, x/s) and the right side 1.
    let (mut aa, mut ab, mut bb, mut a, mut b) = (0.0, 0.0, 0.0, 0.0, 0.0);
    for (x, s) in points() {
        let (u, v) = (1.0 / s, x / s);
        (aa, ab, bb, a, b) = (aa + u * u, ab + u * v, bb + v * v, a + u, b + v);
    }
    let fixed = (a * bb - b * ab) / (aa * bb - ab * ab);
    let fixed = if fixed > 0.0 { fixed } else { 0.0 };
    (fixed, (b - fixed * ab) / bb)
}

/// Runs the command.
pub(super) fn run(arguments: &Arguments, registry: &Registry) -> Result<Exit, Failure> {
    let environment = Environment::ensure(&Installation::default(), &|text| eprintln!("{text}"))
        .map_err(Failure::environment)?;
    let program = match &arguments.whitstone {
        Some(program) => program.clone(),
        None => std::env::current_exe()
            .map_err(Failure::environment)?
            .with_file_name("whitstone"),
    };
    if !program.is_file() {
        let program = program.display();
        return Err(Failure::usage(format!(
            "{program} is not there; build it with `cargo build --release -p whitstone`"
        )));
    }
    let mut pictures = Vec::new();
    for threads in &arguments.threads {
        for scene in &arguments.scenes {
            let mut peers = Vec::new();
            for variant in VARIANTS {
                let peer = ExportedMitsuba::start(&environment, variant, *threads);
                peers.push(peer.map_err(Failure::environment)?);
            }
            pictures.push(sizes(arguments, scene, *threads, &environment, peers, registry)?);
        }
    }
    let mut commands = Vec::new();
    let whole = |scene: &Path| -> Result<Vec<Value>, Failure> {
        let at = |side| whole_commands(arguments, (scene, side), &environment, &program, registry);
        COMMAND_SIZES.into_iter().map(at).collect()
    };
    for scene in &arguments.scenes {
        commands.extend(whole(scene)?);
    }
    let folder = arguments.folder.ensure().map_err(Failure::environment)?;
    if folder.join("dragon.ply").is_file() {
        let scene = folder.join("dragon.toml");
        std::fs::write(&scene, DRAGON).map_err(Failure::environment)?;
        for mut size in whole(&scene)? {
            size["scene"] = json!("dragon (871,414 triangles, text PLY)");
            commands.push(size);
        }
    } else {
        eprintln!("skipped: the whole command with the dragon, which --fetch downloads");
    }
    let result = json!({
        "processor": processor(), "cores": std::thread::available_parallelism().map_or(0, usize::from),
        "date": date(), "load": load(), "rounds": arguments.rounds, "sizes": arguments.sizes,
        "pictures": pictures, "commands": commands,
    });
    if let Some(path) = &arguments.json {
        let text = format!("{result:#}\n");
        whitstone::image::atomic::write_bytes(path, text.as_bytes()).map_err(Failure::environment)?;
    }
    Ok(Exit::Pass)
}

/// The scene without layers, at one sample per pixel; also the document that the driver receives.
fn built(path: &Path, side: u32, registry: &Registry) -> Result<(Pipeline, Flattened), Failure> {
    let overrides = overrides(side);
    let sources = Sources::load(path, &overrides, registry)
        .map_err(|error| Failure::usage(error.sources.report(&error.errors, false)))?;
    let report = |errors| Failure::usage(sources.report(&errors, false));
    let document = |plan: &Plan<'_, '_>| plan.description.flattened.clone();
    Pipeline::load_and(&sources, registry, BuildOptions::default(), document).map_err(report)
}

fn overrides(side: u32) -> [String; 2] {
    [
        format!("film={{ width = {side}, height = {side} }}"),
        "sampler={ type = \"center\" }".to_owned(),
    ]
}

/// Writes the scene as Mitsuba's XML, with one sample per pixel.
fn exported(document: &Flattened, folder: &Path, registry: &Registry) -> Result<PathBuf, Failure> {
    let export = exported::export(registry, document, folder).map_err(Failure::environment)?;
    let path = export.file;
    // The export has the 16 samples that a noisy renderer needs at least.
    let text = std::fs::read_to_string(&path).map_err(Failure::environment)?;
    let marker = "name=\"sample_count\" value=\"";
    let (before, after) = text
        .split_once(marker)
        .ok_or_else(|| Failure::environment("the exported scene states no number of samples"))?;
    let rest = after.trim_start_matches(|c: char| c.is_ascii_digit());
    std::fs::write(&path, format!("{before}{marker}1{rest}")).map_err(Failure::environment)?;
    Ok(path)
}

fn sizes(
    arguments: &Arguments,
    scene: &Path,
    threads: usize,
    environment: &Environment,
    mut peers: Vec<ExportedMitsuba>,
    registry: &Registry,
) -> Result<Value, Failure> {
    let limit = std::time::Duration::from_secs(600);
    let mut driver = Driver::start(environment, limit).map_err(Failure::environment)?;
    let options = RenderOptions {
        threads,
        ..RenderOptions::default()
    };
    let mut ours = Series::new("Whitstone");
    let mut paths = VARIANTS.map(|variant| Series::new(format!("Mitsuba path, {variant}")));
    let mut driven = Series::new("Mitsuba driver (Python)");
    let mut other = Series::new(crate::run_time::POVRAY);
    let mut rays = Vec::new();
    println!(
        "{}, {threads} threads, seconds; load {:.1}",
        scene.display(),
        load()
    );
    for side in &arguments.sizes {
        let (pipeline, document) = built(scene, *side, registry)?;
        let folder = tempfile::tempdir().map_err(Failure::environment)?;
        let file = exported(&document, folder.path(), registry)?;
        let time_driver = json!({
            "op": "time", "scene": document.text, "base": document.base,
            "setting": Setting::default(), "threads": threads, "repeats": 1,
        });
        // Compiles kernels and touches pages.
        rays.push(pipeline.render(options).counters.total());
        for peer in &mut peers {
            peer.load(&file)
                .and_then(|_| peer.render(1, 0))
                .map_err(Failure::environment)?;
        }
        let mut times = [const { Vec::new() }; 5];
        for _ in 0..arguments.rounds.max(1) {
            let [a, b, c, d, e] = &mut times;
            let begin = Instant::now();
            std::hint::black_box(pipeline.render(options));
            a.push(begin.elapsed().as_secs_f64());
            for (peer, seconds) in peers.iter_mut().zip([b, c]) {
                seconds.push(peer.render(1, 0).map_err(Failure::environment)?.wall);
            }
            let answer = driver.request(&time_driver).map_err(Failure::environment)?;
            d.extend(answer["driver_s"].as_f64());
            if scene == Path::new(CLASSIC)
                && threads == 1
                && let Ok(rendering) = povray::render(*side, *side)
            {
                e.push(rendering.seconds);
            }
        }
        let [a, b, c, d, e] = times.each_mut().map(|times| median(times));
        ours.seconds.push(a);
        paths[0].seconds.push(b);
        paths[1].seconds.push(c);
        driven.seconds.push(d);
        other.seconds.push(e);
        println!(
            "  {side:5}  ours {a:.4}  path {b:.4} ({:.2}) and {c:.4} ({:.2})  driver {d:.4}{}",
            a / b,
            a / c,
            if e.is_nan() {
                String::new()
            } else {
                format!("  POV-Ray {e:.4}")
            }
        );
    }
    let [llvm, scalar] = paths;
    let mut series = vec![ours, llvm, scalar, driven, other];
    series.retain(|series| series.seconds.iter().all(|seconds| seconds.is_finite()));
    for series in &series {
        let (fixed, cost) = fit(&arguments.sizes, &series.seconds);
        println!(
            "  {}: {:.2} ms + {:.1} ns per pixel",
            series.name,
            1e3 * fixed,
            1e9 * cost
        );
    }
    Ok(json!({
        "scene": scene, "threads": threads, "rays": rays, "load": load(),
        "series": series.iter().map(|series| series.json(&arguments.sizes)).collect::<Vec<_>>(),
    }))
}

/// The wall time of whole commands, on all cores.
fn whole_commands(
    arguments: &Arguments,
    (scene, side): (&Path, u32),
    environment: &Environment,
    program: &Path,
    registry: &Registry,
) -> Result<Value, Failure> {
    let (_, document) = built(scene, side, registry)?;
    let folder = tempfile::tempdir().map_err(Failure::environment)?;
    let file = exported(&document, folder.path(), registry)?;
    let image = folder.path().join("image.exr");
    let ours = |aovs: &str| {
        let [_, sampler] = overrides(side);
        let film = format!("film={{ width = {side}, height = {side}, aovs = [{aovs}] }}");
        let mut command = Command::new(program);
        command
            .arg("render")
            .arg(scene)
            .arg("-o")
            .arg(&image)
            .args(["--set", &film, "--set", &sampler]);
        command
    };
    let mitsuba = mitsuba(environment)?;
    let theirs = |variant: &str| {
        let mut command = Command::new(&mitsuba);
        command.args(["-m", variant, "-o"]).arg(&image).arg(&file);
        if let Some(library) = llvm(environment) {
            command.env("DRJIT_LIBLLVM_PATH", library);
        }
        command
    };
    let layers = "\"depth\", \"normal\", \"uv\", \"shape_id\", \"primitive_id\"";
    let mut commands = [
        ("Whitstone", ours("")),
        (
            "Whitstone, with five AOV layers (depth, normal, uv, shape and primitive ID)",
            ours(layers),
        ),
        ("Mitsuba, llvm_ad_rgb", theirs(VARIANTS[0])),
        (FIRST_RUN, theirs(VARIANTS[0])),
        ("Mitsuba, scalar_rgb", theirs(VARIANTS[1])),
    ];
    let mut times = [const { Vec::new() }; 5];
    // The first round fills the caches of kernels and files.
    for round in 0..=arguments.rounds.max(1) {
        let mut order: Vec<usize> = (0..commands.len()).collect();
        if round % 2 == 1 {
            order.reverse();
        }
        for index in order {
            let ((name, command), times) = (&mut commands[index], &mut times[index]);
            // To overwrite a file takes longer the larger it is.
            let _ = std::fs::remove_file(&image);
            // Dr.Jit keeps its kernels in the home folder.
            let home = tempfile::tempdir().map_err(Failure::environment)?;
            if *name == FIRST_RUN {
                command.env("HOME", home.path());
            }
            let begin = Instant::now();
            let output = command
                .stdin(Stdio::null())
                .output()
                .map_err(Failure::environment)?;
            if !output.status.success() {
                let text = String::from_utf8_lossy(&output.stderr);
                return Err(Failure::environment(format!("{name} failed:\n{text}")));
            }
            if round > 0 {
                times.push(begin.elapsed().as_secs_f64());
            }
        }
    }
    println!("{}: whole commands at {side} x {side}, seconds", scene.display());
    let mut figures = Vec::new();
    for ((name, _), times) in commands.iter().zip(&mut times) {
        let seconds = median(times);
        println!("  {name}: {seconds:.3}");
        figures.push(json!({ "name": name, "seconds": seconds }));
    }
    Ok(json!({ "scene": scene, "width": side, "load": load(), "commands": figures }))
}

/// Mitsuba's C++ program. The script `bin/mitsuba` of its package imports all of Mitsuba into
/// Python before it starts this program, which takes longer than a rendering.
fn mitsuba(environment: &Environment) -> Result<PathBuf, Failure> {
    let ask = "import importlib.util as u; print(u.find_spec('mitsuba').submodule_search_locations[0])";
    let output = Command::new(&environment.python)
        .args(["-c", ask])
        .output()
        .map_err(Failure::environment)?;
    let folder = String::from_utf8_lossy(&output.stdout);
    let program = Path::new(folder.trim()).join("mitsuba");
    if program.is_file() {
        Ok(program)
    } else {
        let message = format!("the package of Mitsuba lacks its program {}", program.display());
        Err(Failure::environment(message))
    }
}

/// The library that Mitsuba's LLVM variants need, as the driver finds it.
fn llvm(environment: &Environment) -> Option<String> {
    let ask = "from whitstone_mitsuba.llvm import find; print(find().path)";
    let output = Command::new(&environment.python)
        .args(["-c", ask])
        .env("PYTHONPATH", &environment.package)
        .output()
        .ok()?;
    let path = String::from_utf8(output.stdout).ok()?.trim().to_owned();
    (!path.is_empty()).then_some(path)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fixed_cost_and_cost_per_pixel_are_separated() {
        let sizes = [128, 256, 512, 1024];
        let seconds = sizes.map(|side: u32| 0.02 + 1e-7 * f64::from(side).powi(2));
        let (fixed, cost) = fit(&sizes, &seconds);
        assert!((fixed - 0.02).abs() < 1e-9 && (cost - 1e-7).abs() < 1e-15);
        let (fixed, cost) = fit(&sizes, &sizes.map(|side| 2e-7 * f64::from(side).powi(2)));
        assert!(fixed < 1e-9 && (cost - 2e-7).abs() < 1e-13);
    }
}
