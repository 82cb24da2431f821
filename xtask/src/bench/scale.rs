//! `bench scale`: time and memory of a scene of 240 million quads, and its picture.

use super::machine::{date, load, processor, threads};
use crate::lecture_scenes::{COPY, VALLEY};
use crate::pictures;
use clap::Args;
use serde_json::json;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Instant;
use whitstone::core::{Geometry, LoweredShape, Registry};
use whitstone::render::{BuildOptions, Film, Pipeline, RenderOptions};
use whitstone::scene::Sources;
use whitstone::{Exit, Failure, image::atomic};

/// The scene.
pub(crate) const SCENE: &str = "scenes/scale/valley.toml";

/// The time in hours that the lecture notes report for a frame with as many quads and 80 million
/// rays (Christensen et al. 2006).
const HOURS_THEN: f64 = 8.0;

/// Columns and rows of the copy for the documentation, and its largest size in bytes.
const COPY_SIZE: (usize, usize) = (960, 540);
const COPY_BYTES: usize = 300 << 10;

/// Build and render a valley of 240 million quads (15 instances of 16 million)
///
/// The picture has 1920 x 1080 pixels with 16 samples each, from about 120 million rays.
#[derive(Args, Debug)]
#[command(
    help_template = whitstone::commands::HELP_TEMPLATE,
    after_help = "Examples:\n  cargo xtask bench scale --quick\n  cargo xtask bench scale --page && cargo xtask readme"
)]
pub(super) struct Arguments {
    /// Use mountains of a million quads and a sixteenth of the pixels; takes some seconds
    #[arg(long)]
    quick: bool,
    /// Override a value of the scene, as for `render`; can be repeated
    #[arg(long = "set", value_name = "PATH=VALUE")]
    overrides: Vec<String>,
    /// Number of threads; 0 means one per core
    #[arg(long, value_name = "COUNT", default_value_t = 0)]
    threads: usize,
    /// Memory limit in GiB
    #[arg(long, value_name = "GIB", default_value_t = 12.0)]
    max_memory: f64,
    /// PNG file of the picture, with the tone curve of `pictures`
    #[arg(
        short,
        long,
        value_name = "FILE",
        default_value = "target/pictures/valley.png"
    )]
    output: PathBuf,
    /// Also write the image to this EXR file
    #[arg(long, value_name = "FILE")]
    exr: Option<PathBuf>,
    /// Write the results to this file as JSON
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    /// Store the results, and a small copy of the picture, for docs/lecture-scenes.md
    #[arg(long, conflicts_with_all = ["quick", "overrides", "json"])]
    page: bool,
}

pub(super) fn run(arguments: &Arguments, registry: &Registry) -> Result<Exit, Failure> {
    let mut overrides = Vec::new();
    if arguments.quick {
        overrides = [
            "film={ width = 480, height = 270 }",
            "group.mountain.shape.mountain.columns=1000",
            "group.mountain.shape.mountain.rows=1000",
        ]
        .map(str::to_owned)
        .to_vec();
    }
    overrides.extend(arguments.overrides.iter().cloned());
    let load_before = load();
    let start = Instant::now();
    let build = || build(&overrides, arguments, registry, start);
    let pipeline = match arguments.threads {
        0 => build()?,
        threads => rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .map_err(Failure::environment)?
            .install(build)?,
    };
    let build_s = start.elapsed().as_secs_f64();
    let (build_peak, resident) = (memory("VmHWM:"), memory("VmRSS:"));
    say(
        start,
        &format!(
            "built: peak memory {} GiB, now {} GiB",
            gib(build_peak),
            gib(resident)
        ),
    );
    let reported = AtomicU64::new(0);
    let film = pipeline.render(RenderOptions {
        threads: arguments.threads,
        progress: Some(&|done, of| {
            let tenths = done * 10 / of;
            if reported.fetch_max(tenths, Ordering::Relaxed) < tenths {
                say(start, &format!("rendered {} %", 10 * tenths));
            }
            ControlFlow::Continue(())
        }),
        ..RenderOptions::default()
    });
    let (instances, quads) = quads(&pipeline.scene.geometry);
    let rays = film.counters.total();
    let total_s = start.elapsed().as_secs_f64();
    let peak = memory("VmHWM:");
    let rate = rays as f64 / film.render_seconds / 1e6;
    let times = HOURS_THEN * 3600.0 / total_s;
    println!(
        "{SCENE}: {instances} instances, {:.1} million quads",
        quads as f64 / 1e6
    );
    println!("  build   {build_s:.1} s");
    println!(
        "  render  {:.1} s, {:.1} million rays, {rate:.2} Mrays/s",
        film.render_seconds,
        rays as f64 / 1e6
    );
    println!("  memory  {} GiB peak", gib(peak));
    println!("  total   {total_s:.1} s");
    println!(
        "  for comparison: {HOURS_THEN} h for a film frame of 240 million quads and 80 million rays on a machine of 2006: \
         {times:.0} times as long, with other shading"
    );
    let copy = write_pictures(arguments, &film, &pipeline.scene_hash)?;
    let report = json!({
        "scene": SCENE, "scene_hash": pipeline.scene_hash, "quick": arguments.quick, "width": film.width,
        "height": film.height, "samples": film.samples, "instances": instances,
        "quads": quads, "triangles": 2 * quads, "rays": rays,
        "closest_rays": film.counters.closest, "shadow_rays": film.counters.shadow, "build_s": build_s,
        "render_s": film.render_seconds, "total_s": total_s, "mrays_per_s": rate,
        "build_peak_bytes": build_peak, "built_bytes": resident, "peak_bytes": peak,
        "hours_in_the_notes": HOURS_THEN, "processor": processor(), "threads": threads(arguments.threads),
        "date": date(), "load": load_before, "copy_hash": copy,
    });
    let json = match arguments.page {
        true => Some(Path::new(VALLEY)),
        false => arguments.json.as_deref(),
    };
    if let Some(path) = json {
        atomic::write_bytes(path, format!("{report:#}\n").as_bytes()).map_err(Failure::environment)?;
        println!("{}: written", path.display());
    }
    Ok(Exit::Pass)
}

/// Writes the picture, and the files that the options name; returns the hash of the copy for the
/// documentation, if it is written.
fn write_pictures(arguments: &Arguments, film: &Film, hash: &str) -> Result<Option<String>, Failure> {
    let image = film.to_image(hash).map_err(Failure::usage)?;
    if let Some(path) = &arguments.exr {
        whitstone::image::exr_io::write(path, &image).map_err(Failure::environment)?;
    }
    let picture = pictures::raster(&image)?;
    if let Some(folder) = arguments
        .output
        .parent()
        .filter(|folder| !folder.as_os_str().is_empty())
    {
        std::fs::create_dir_all(folder).map_err(Failure::environment)?;
    }
    picture
        .write_png(&arguments.output)
        .map_err(Failure::environment)?;
    println!("{}: written", arguments.output.display());
    if !arguments.page {
        return Ok(None);
    }
    let bytes = picture
        .reduced(COPY_SIZE.0, COPY_SIZE.1)
        .to_jpeg(pictures::JPEG)
        .map_err(Failure::environment)?;
    if bytes.len() > COPY_BYTES {
        return Err(Failure::usage(format!(
            "{COPY}: {} bytes; the limit is {COPY_BYTES}",
            bytes.len()
        )));
    }
    atomic::write_bytes(COPY, &bytes).map_err(Failure::environment)?;
    println!("{COPY}: written");
    Ok(Some(pictures::hash_of(&bytes)))
}

fn build(
    overrides: &[String],
    arguments: &Arguments,
    registry: &Registry,
    start: Instant,
) -> Result<Pipeline, Failure> {
    let progress = |what: &str| {
        if !what.contains("instance") {
            say(start, &format!("building {what}"));
        }
    };
    let options = BuildOptions {
        max_memory: Some((arguments.max_memory * (1u64 << 30) as f64) as u64),
        progress: Some(&progress),
        ..BuildOptions::default()
    };
    let sources = Sources::load(Path::new(SCENE), overrides, registry)
        .map_err(|error| Failure::usage(error.sources.report(&error.errors, false)))?;
    let report = |errors| Failure::usage(sources.report(&errors, false));
    Pipeline::load(&sources, registry, options).map_err(report)
}

fn say(start: Instant, what: &str) {
    eprintln!("{:7.1} s  {what}", start.elapsed().as_secs_f64());
}

/// The number of instances, and the number of quads in all of them together.
fn quads(geometry: &Geometry) -> (u64, u64) {
    let mut sums = (0, 0);
    for shape in geometry.shapes() {
        match shape {
            LoweredShape::Triangles(mesh) => sums.1 += mesh.triangles.len() as u64 / 2,
            LoweredShape::Instance(instance) => {
                let inside = quads(instance.group().geometry());
                sums = (sums.0 + 1 + inside.0, sums.1 + inside.1);
            }
            _ => {}
        }
    }
    sums
}

/// A memory statistic of this process in bytes, if the system reports it.
fn memory(name: &str) -> Option<u64> {
    let text = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = text.lines().find_map(|line| line.strip_prefix(name))?;
    let kib: u64 = line.trim().strip_suffix("kB")?.trim().parse().ok()?;
    Some(kib << 10)
}

fn gib(bytes: Option<u64>) -> String {
    bytes.map_or("unknown".to_owned(), |bytes| {
        format!("{:.2}", bytes as f64 / (1u64 << 30) as f64)
    })
}
