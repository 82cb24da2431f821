//! Benchmarks of whole pictures: against Mitsuba, against POV-Ray, and as frames per second.

use super::machine::{date, load, processor, processor_time, threads};
use super::median;
use super::povray;
use clap::Args;
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use std::time::Duration;
use whitstone::core::Registry;
use whitstone::render::{BuildOptions, Pipeline, RenderOptions};
use whitstone::scene::{Flattened, Plan, Sources};
use whitstone::validate::Installation;
use whitstone::validate::driver::{Driver, Setting};
use whitstone::validate::environment::Environment;
use whitstone::{Exit, Failure};

#[derive(Args, Debug)]
#[group(id = "picture")]
pub(crate) struct Arguments {
    /// Scene files (TOML)
    #[arg(default_value = CLASSIC, value_name = "SCENE")]
    scenes: Vec<PathBuf>,
    /// Width of the image in pixels
    #[arg(long, value_name = "PIXELS", default_value_t = 1920)]
    width: u32,
    /// Height of the image in pixels
    #[arg(long, value_name = "PIXELS", default_value_t = 1080)]
    height: u32,
    /// Number of rounds; each times both renderers once
    #[arg(long, value_name = "COUNT", default_value_t = 5)]
    rounds: usize,
    /// Number of threads of both renderers; 0 means one per core
    #[arg(long, value_name = "COUNT", default_value_t = 0)]
    threads: usize,
    /// Compare with POV-Ray instead: the classic scene on one thread, in processor time per ray
    #[arg(long, conflicts_with_all = ["threads", "scenes"])]
    povray: bool,
    /// Measure frames per second of the scenes instead: medians of 60 frames
    #[arg(long, conflicts_with = "rounds")]
    fps: bool,
    /// Write the results to this file as JSON
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

/// The scene that also exists in POV-Ray's language.
const CLASSIC: &str = "scenes/showcase/classic.toml";

/// Number of frames of `--fps`.
const FRAMES: usize = 60;

/// Runs the command.
pub(super) fn run(arguments: &Arguments, registry: &Registry) -> Result<Exit, Failure> {
    let mut figures = Vec::new();
    if arguments.povray {
        figures.push(compare_with_povray(arguments, registry)?);
    }
    if arguments.fps {
        for scene in &arguments.scenes {
            figures.push(frames(arguments, scene, registry)?);
        }
    }
    if !arguments.povray && !arguments.fps {
        figures = compare_with_mitsuba(arguments, registry)?;
    }
    if let Some(path) = &arguments.json {
        let text = format!("{:#}\n", json!({ "bench": figures }));
        whitstone::image::atomic::write_bytes(path, text.as_bytes()).map_err(Failure::environment)?;
    }
    Ok(Exit::Pass)
}

/// Builds a scene at a given size; also returns the document that the driver receives.
fn built(path: &Path, film: &str, registry: &Registry) -> Result<(Pipeline, Flattened), Failure> {
    let overrides = [format!("film={{ {film} }}")];
    let sources = Sources::load(path, &overrides, registry)
        .map_err(|error| Failure::usage(error.sources.report(&error.errors, false)))?;
    let report = |errors| Failure::usage(sources.report(&errors, false));
    let document = |plan: &Plan<'_, '_>| plan.description.flattened.clone();
    Pipeline::load_and(&sources, registry, BuildOptions::default(), document).map_err(report)
}

fn compare_with_mitsuba(arguments: &Arguments, registry: &Registry) -> Result<Vec<Value>, Failure> {
    let environment = Environment::ensure(&Installation::default(), &|text| eprintln!("{text}"))
        .map_err(Failure::environment)?;
    let mut driver = Driver::start(&environment, Duration::from_secs(600)).map_err(Failure::environment)?;
    let film = format!("width = {}, height = {}", arguments.width, arguments.height);
    let mut reports = Vec::new();
    for path in &arguments.scenes {
        let (pipeline, document) = built(path, &film, registry)?;
        let report = compare_scene_with_mitsuba(arguments, path, &pipeline, &document, &mut driver);
        reports.push(report?);
    }
    Ok(reports)
}

fn compare_scene_with_mitsuba(
    arguments: &Arguments,
    path: &Path,
    pipeline: &Pipeline,
    document: &Flattened,
    driver: &mut Driver,
) -> Result<Value, Failure> {
    let options = RenderOptions {
        threads: arguments.threads,
        ..RenderOptions::default()
    };
    let request = json!({
        "op": "time", "scene": document.text, "base": document.base,
        "setting": Setting::default(), "threads": arguments.threads, "repeats": 1,
    });
    // A warm-up run: compiles kernels and touches pages.
    let warm = driver.request(&request).map_err(Failure::environment)?;
    let counters = pipeline.render(options).counters;
    let (mut ours, mut theirs, mut path_times) = (Vec::new(), Vec::new(), Vec::new());
    for _ in 0..arguments.rounds {
        ours.push(pipeline.render(options).render_seconds);
        let answer = driver.request(&request).map_err(Failure::environment)?;
        theirs.extend(answer["driver_s"].as_f64());
        path_times.extend(answer["path_s"].as_f64());
    }
    let driver_rays = warm["driver_rays"]["closest"].as_f64().unwrap_or(0.0)
        + warm["driver_rays"]["shadow"].as_f64().unwrap_or(0.0);
    let (ours, theirs, path_s) = (median(&mut ours), median(&mut theirs), median(&mut path_times));
    let rate = counters.total() as f64 / ours / 1e6;
    let driver_rate = driver_rays / theirs / 1e6;
    println!(
        "{}: {} x {}\n  whitstone            {ours:.3} s  {} rays  {rate:.2} Mrays/s\n  mitsuba, same rays   {theirs:.3} s  {driver_rays} rays  {driver_rate:.2} Mrays/s  (whitstone traces {:.2} times as many rays per second)\n  mitsuba, C++ path    {path_s:.3} s  one specular ray per hit  (whitstone takes {:.2} of its time)",
        path.display(),
        arguments.width,
        arguments.height,
        counters.total(),
        rate / driver_rate,
        ours / path_s,
    );
    Ok(json!({
        "scene": path, "width": arguments.width, "height": arguments.height,
        "whitstone_s": ours, "whitstone_rays": counters.total(), "driver_s": theirs,
        "driver_rays": driver_rays, "path_s": path_s, "rate_ratio": rate / driver_rate,
        "time_over_path": ours / path_s,
    }))
}

/// The classic scene on one thread: nanoseconds per ray of both renderers, in processor time, so
/// that other processes have little influence.
fn compare_with_povray(arguments: &Arguments, registry: &Registry) -> Result<Value, Failure> {
    let (width, height) = (arguments.width, arguments.height);
    let film = format!("width = {width}, height = {height}, aovs = []");
    let (pipeline, _) = built(Path::new(CLASSIC), &film, registry)?;
    let options = RenderOptions {
        threads: 1,
        ..RenderOptions::default()
    };
    let counters = pipeline.render(options).counters;
    let (mut ours, mut theirs, mut ratios) = (Vec::new(), Vec::new(), Vec::new());
    let mut rays = (0, 0);
    for _ in 0..arguments.rounds.max(1) {
        let other = povray::render(width, height).map_err(Failure::environment)?;
        let start = processor_time();
        pipeline.render(options);
        let seconds = processor_time() - start;
        rays = (other.rays, other.shadow_rays);
        let a_ray = 1e9 * other.seconds / (other.rays + other.shadow_rays) as f64;
        let our_ray = 1e9 * seconds / counters.total() as f64;
        ours.push(our_ray);
        theirs.push(a_ray);
        ratios.push(our_ray / a_ray);
    }
    let (ours, theirs, ratio) = (median(&mut ours), median(&mut theirs), median(&mut ratios));
    println!(
        "{CLASSIC}: {width} x {height}, one thread, processor time\n  whitstone  {ours:6.1} ns per ray  {} rays, {} of them shadow rays\n  POV-Ray    {theirs:6.1} ns per ray  {} rays, {} of them shadow rays  (whitstone takes {ratio:.3} of its time per ray)\n  load {:.1}",
        counters.total(),
        counters.shadow,
        rays.0 + rays.1,
        rays.1,
        load(),
    );
    Ok(json!({
        "scene": CLASSIC, "width": width, "height": height, "whitstone_ns_per_ray": ours,
        "whitstone_rays": counters.total(), "povray_ns_per_ray": theirs, "povray_rays": rays.0,
        "povray_shadow_rays": rays.1, "time_per_ray_ratio": ratio, "load": load(),
    }))
}

/// Frames per second of a warm scene: rendering only, in wall-clock time.
fn frames(arguments: &Arguments, path: &Path, registry: &Registry) -> Result<Value, Failure> {
    let (width, height, before) = (arguments.width, arguments.height, load());
    let threads = threads(arguments.threads);
    let film = format!("width = {width}, height = {height}, aovs = []");
    let (pipeline, _) = built(path, &film, registry)?;
    let options = RenderOptions {
        threads,
        ..RenderOptions::default()
    };
    let rays = pipeline.render(options).counters.total();
    let mut seconds: Vec<f64> = (0..FRAMES)
        .map(|_| pipeline.render(options).render_seconds)
        .collect();
    let (middle, best) = (median(&mut seconds), seconds[0]);
    let ns_per_ray = 1e9 * middle * threads as f64 / rays as f64;
    println!(
        "{}: {width} x {height}, {threads} threads\n  {:.1} frames per second (best {:.1}), {rays} rays each, {:.1} ns per ray and thread\n  load {:.1}",
        path.display(),
        1.0 / middle,
        1.0 / best,
        ns_per_ray,
        load(),
    );
    Ok(json!({
        "scene": path, "width": width, "height": height, "threads": threads, "frames": FRAMES,
        "frames_per_s": 1.0 / middle, "best_frames_per_s": 1.0 / best, "rays": rays,
        "ns_per_ray_and_thread": ns_per_ray, "load": before, "processor": processor(), "date": date(),
    }))
}
