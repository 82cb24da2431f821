//! `bench lights`: hundreds of lights, most of which illuminate only a small part of the scene; and
//! up to a hundred thousand, with `light_cutoff` and without.

use super::machine::{date, load, processor, threads};
use super::median;
use clap::Args;
use serde_json::{Value, json};
use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::time::Instant;
use whitstone::core::Registry;
use whitstone::image::atomic;
use whitstone::render::{BuildOptions, Pipeline, RenderOptions};
use whitstone::scene::Sources;
use whitstone::{Exit, Failure};

/// A picture with as many triangles and lights, and mirrors.
const PICTURE: &str = "scenes/pictures/harbour.toml";
/// Overrides for it.
const PICTURE_FILM: &str = "film={ width = 1920, height = 1080 }";

/// Spots along each side of the square above the landscape.
const SIDE: u32 = 10;
/// Quads along each side of the landscape, and triangles in it.
const QUADS: u32 = 436;
const TRIANGLES: u32 = 2 * QUADS * QUADS;
/// Lamps that illuminate everything.
const LAMPS: [[f64; 3]; 4] = [
    [-0.9, -0.9, 0.8],
    [0.9, -0.9, 0.8],
    [-0.9, 0.9, 0.8],
    [0.9, 0.9, 0.8],
];

/// Benchmark scenes with many lights
///
/// Renders a landscape of 380,192 triangles. First under 100 spots and 4 lamps, with and without
/// light culling, interleaved; the images must be identical. Then at 64 x 48 under growing numbers
/// of weak lamps, exactly and with `light_cutoff`, and prints the error that the cutoff causes.
/// Last, a picture with as many triangles and lights, and mirrors.
#[derive(Args, Debug)]
pub(crate) struct Arguments {
    /// Width and height of the image in pixels
    #[arg(long, value_name = "PIXELS", default_value_t = 1024)]
    size: u32,
    /// Number of rounds; each renders both once
    #[arg(long, value_name = "COUNT", default_value_t = 5)]
    rounds: usize,
    /// Number of threads; 0 means one per core
    #[arg(long, value_name = "COUNT", default_value_t = 0)]
    threads: usize,
    /// Numbers of weak lamps
    #[arg(long, value_name = "COUNT,...", value_delimiter = ',', default_values_t = [100, 1_000, 10_000, 100_000])]
    lamps: Vec<u32>,
    /// Reach of a weak lamp in metres, by the cutoff; the landscape is 2 m wide
    #[arg(long, value_name = "METRES", default_value_t = 0.3)]
    reach: f64,
    /// Write all results to this file as JSON
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

/// Runs the command.
pub(super) fn run(arguments: &Arguments, registry: &Registry) -> Result<Exit, Failure> {
    let before = load();
    let pipeline = |culls: bool| -> Result<Pipeline, Failure> {
        let mut built = load_scene(&spots(arguments.size), registry)?;
        built.scene.culls_lights &= culls;
        Ok(built)
    };
    let pipelines = [pipeline(true)?, pipeline(false)?];
    let options = RenderOptions {
        threads: arguments.threads,
        ..RenderOptions::default()
    };
    let mut times = [const { Vec::new() }; 2];
    let mut films = [const { None }; 2];
    for round in 0..=arguments.rounds {
        for (number, pipeline) in pipelines.iter().enumerate() {
            let start = Instant::now();
            let film = pipeline.render(options);
            // The first round is a warm-up: it touches pages.
            if round > 0 {
                times[number].push(start.elapsed().as_secs_f64());
            }
            films[number] = Some(film);
        }
    }
    let [Some(culled), Some(all)] = films else {
        return Err(Failure::usage("expected at least one round: --rounds 1"));
    };
    let same = culled.rgb == all.rgb && culled.counters == all.counters;
    let [fast, slow] = times.each_mut().map(|times| median(times));
    let (rays, shadow) = (culled.counters.total(), culled.counters.shadow);
    println!(
        "{size} x {size}, 380,192 triangles, {} lights, {rays} rays, {shadow} of them shadow rays; load {:.1}",
        pipelines[0].scene.lights.len(),
        load(),
        size = arguments.size,
    );
    let rate = |seconds: f64| 1e-6 * rays as f64 / seconds;
    for (what, seconds) in [("with", fast), ("without", slow)] {
        println!(
            "  {what:<7} culling  {seconds:.3} s per frame, {:.2} frames per second, {:.2} Mrays/s",
            1.0 / seconds,
            rate(seconds)
        );
    }
    println!("  without culling {:.2} times as long", slow / fast);
    let many = many_lamps(arguments, registry)?;
    let picture = frames(arguments, registry)?;
    if let Some(path) = &arguments.json {
        let row = |culling: bool, seconds: f64| {
            json!({
                "culling": culling, "seconds": seconds, "rays": rays, "shadow_rays": shadow,
                "mrays_per_s": rate(seconds),
            })
        };
        let text = json!({
            "size": arguments.size, "lights": pipelines[0].scene.lights.len(), "triangles": TRIANGLES,
            "rounds": arguments.rounds, "threads": threads(arguments.threads), "processor": processor(),
            "date": date(), "rows": [row(true, fast), row(false, slow)], "same": same, "lamps": many,
            "picture": picture,
            "load": before,
        });
        atomic::write_bytes(path, format!("{text:#}\n").as_bytes()).map_err(Failure::environment)?;
    }
    if same {
        Ok(Exit::Pass)
    } else {
        println!("  the pictures DIFFER");
        Ok(Exit::Differs)
    }
}

/// Times the picture.
fn frames(arguments: &Arguments, registry: &Registry) -> Result<Value, Failure> {
    let pipeline = crate::readme::build(registry, Path::new(PICTURE), &[PICTURE_FILM.to_owned()])?;
    let options = RenderOptions {
        threads: arguments.threads,
        ..RenderOptions::default()
    };
    // One frame, which takes most of a minute.
    let film = pipeline.render(options);
    let (seconds, rays) = (film.render_seconds, film.counters.total());
    let (width, height) = (film.width, film.height);
    println!(
        "{PICTURE}: {width} x {height}, {rays} rays\n  {seconds:.3} s per frame, {:.2} frames per second, {:.2} Mrays/s",
        1.0 / seconds,
        1e-6 * rays as f64 / seconds
    );
    Ok(json!({
        "scene": PICTURE, "width": width, "height": height, "lights": pipeline.scene.lights.len(),
        "rays": rays, "seconds": seconds,
    }))
}

fn load_scene(text: &str, registry: &Registry) -> Result<Pipeline, Failure> {
    let sources = Sources::from_text("lights", text, Path::new("scenes"), &[])
        .map_err(|error| Failure::usage(error.sources.report(&error.errors, false)))?;
    let report = |errors| Failure::usage(sources.report(&errors, false));
    Pipeline::load(&sources, registry, BuildOptions::default()).map_err(report)
}

/// Times the landscape under each number of weak lamps, exactly and with a cutoff.
fn many_lamps(arguments: &Arguments, registry: &Registry) -> Result<Vec<Value>, Failure> {
    let options = RenderOptions {
        threads: arguments.threads,
        ..RenderOptions::default()
    };
    println!(
        "64 x 48, 380,192 triangles, weak lamps; the cutoff lets each reach {} m",
        arguments.reach
    );
    let mut rows = Vec::new();
    for &count in &arguments.lamps {
        let mut films: Vec<Vec<[f32; 3]>> = Vec::new();
        for cutoff in [0.0, lamp_intensity(count) / (arguments.reach * arguments.reach)] {
            let start = Instant::now();
            let pipeline = load_scene(&lamps(count, cutoff), registry)?;
            let loaded = start.elapsed().as_secs_f64();
            // The hierarchy over the lights is built while rendering: each time is a first one.
            let start = Instant::now();
            let film = pipeline.render(options);
            let seconds = start.elapsed().as_secs_f64();
            let rays = film.counters.total();
            let rate = 1e-6 * rays as f64 / seconds;
            let error = films
                .first()
                .map_or(0.0, |exact| relative_error(&film.rgb, exact));
            println!(
                "  {count:>7} lamps  cutoff {cutoff:<8.2e}  loading {loaded:6.3} s  rendering {seconds:7.3} s  {rays:>11} rays  {rate:6.2} Mrays/s  relative RMSE {error:.4}"
            );
            rows.push(json!({
                "lamps": count, "light_cutoff": cutoff, "loading_s": loaded, "seconds": seconds,
                "rays": rays, "mrays_per_s": rate, "relative_rmse": error,
            }));
            films.push(film.rgb);
        }
    }
    Ok(rows)
}

/// The root of the mean squared difference, divided by the mean.
fn relative_error(found: &[[f32; 3]], exact: &[[f32; 3]]) -> f64 {
    let channels = |pixels: &[[f32; 3]]| pixels.iter().flatten().map(|c| f64::from(*c)).collect::<Vec<_>>();
    let (found, exact) = (channels(found), channels(exact));
    let count = exact.len() as f64;
    let squares: f64 = found.iter().zip(&exact).map(|(a, b)| (a - b) * (a - b)).sum();
    (squares / count).sqrt() / (exact.iter().sum::<f64>() / count)
}

/// A landscape seen obliquely from above. `amplitude`: of its noise, in metres.
fn landscape(width: u32, height: u32, amplitude: f64) -> String {
    format!(
        "film = {{ width = {width}, height = {height} }}\n\
         [camera]\ntype = \"perspective\"\nlook_at = {{ origin = [0, -2.2, 1.6], target = [0, 0, 0], up = [0, 0, 1] }}\nfov = 50\n\
         [[shape]]\ntype = \"heightfield\"\ncolumns = {QUADS}\nrows = {QUADS}\namplitude = {amplitude}\n\
         material = {{ type = \"matte\", reflectance = 0.7 }}\n"
    )
}

/// Radiant intensity of each of `count` weak lamps: together they light flat ground with about 1
/// W/m² (2 pi times their number per square metre times their intensity).
fn lamp_intensity(count: u32) -> f64 {
    4.0 / (std::f64::consts::TAU * f64::from(count))
}

/// The landscape under weak lamps at pseudo-random places (the additive recurrence of the plastic
/// number: Roberts 2018, *The unreasonable effectiveness of quasirandom sequences*).
fn lamps(count: u32, cutoff: f64) -> String {
    let mut text = landscape(64, 48, 0.02);
    let _ = writeln!(
        text,
        "[integrator]\ntype = \"whitted\"\nlight_cutoff = {cutoff:e}"
    );
    let intensity = lamp_intensity(count);
    for number in 0..count {
        let place = |step: f64| 2.0 * (f64::from(number) * step).fract() - 1.0;
        let [x, y] = [0.754_877_666_246_692_7, 0.569_840_290_998_053_3].map(place);
        let _ = writeln!(
            text,
            "[[light]]\ntype = \"point\"\nposition = [{x}, {y}, 0.06]\nintensity = {intensity:e}"
        );
    }
    text
}

/// The landscape with a grid of spots over it, each illuminating a part, and lamps at the corners.
fn spots(size: u32) -> String {
    let mut text = landscape(size, size, 0.2);
    for number in 0..SIDE * SIDE {
        let place = |index: u32| (f64::from(index) + 0.5) / f64::from(SIDE) * 2.0 - 1.0;
        let [x, y] = [number % SIDE, number / SIDE].map(place);
        let color = |shift: u32| 0.02 * f64::from((number * 7 + shift) % 5 + 1);
        let [r, g, b] = [0, 2, 4].map(color);
        let _ = writeln!(
            text,
            "[[light]]\ntype = \"spot\"\nposition = [{x}, {y}, 0.7]\ntarget = [{x}, {y}, 0]\ncutoff_angle = 20\nintensity = [{r}, {g}, {b}]"
        );
    }
    for [x, y, z] in LAMPS {
        let _ = writeln!(
            text,
            "[[light]]\ntype = \"point\"\nposition = [{x}, {y}, {z}]\nintensity = 0.15"
        );
    }
    text
}
