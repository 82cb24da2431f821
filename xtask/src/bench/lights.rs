//! `bench lights`: hundreds of lights, most of which illuminate only a small part of the scene.

use super::machine::load;
use super::median;
use clap::Args;
use serde_json::json;
use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::time::Instant;
use whitstone::core::Registry;
use whitstone::image::atomic;
use whitstone::render::{BuildOptions, Pipeline, RenderOptions};
use whitstone::scene::Sources;
use whitstone::{Exit, Failure};

/// Spots along each side of the square above the landscape.
const SIDE: u32 = 10;
/// Lamps that illuminate everything.
const LAMPS: [[f64; 3]; 4] = [
    [-0.9, -0.9, 0.8],
    [0.9, -0.9, 0.8],
    [-0.9, 0.9, 0.8],
    [0.9, 0.9, 0.8],
];

/// Benchmark light culling: render a landscape of 380,192 triangles under 100 spots and 4 lamps
/// with and without it, interleaved; the pictures must be identical
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
    /// Write all results to this file as JSON
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

/// Runs the command.
pub(super) fn run(arguments: &Arguments, registry: &Registry) -> Result<Exit, Failure> {
    let pipeline = |culls: bool| -> Result<Pipeline, Failure> {
        let text = scene(arguments.size);
        let sources = Sources::from_text("lights", &text, Path::new("scenes"), &[])
            .map_err(|error| Failure::usage(error.sources.report(&error.errors, false)))?;
        let report = |errors| Failure::usage(sources.report(&errors, false));
        let mut built = Pipeline::load(&sources, registry, BuildOptions::default()).map_err(report)?;
        built.scene.culls_lights &= culls;
        Ok(built)
    };
    let pipelines = [pipeline(true)?, pipeline(false)?];
    let options = RenderOptions {
        threads: arguments.threads,
        progress: None,
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
            "  {what:<7} culling  {seconds:.3} s per frame, {:.2} Mrays/s",
            rate(seconds)
        );
    }
    println!("  without culling {:.2} times as long", slow / fast);
    if let Some(path) = &arguments.json {
        let row = |culling: bool, seconds: f64| {
            json!({
                "culling": culling, "seconds": seconds, "rays": rays, "shadow_rays": shadow,
                "mrays_per_s": rate(seconds),
            })
        };
        let text = json!({ "rows": [row(true, fast), row(false, slow)], "same": same, "load": load() });
        atomic::write_bytes(path, format!("{text:#}\n").as_bytes()).map_err(Failure::environment)?;
    }
    if same {
        Ok(Exit::Pass)
    } else {
        println!("  the pictures DIFFER");
        Ok(Exit::Differs)
    }
}

/// A landscape seen obliquely from above, with a grid of spots over it, each illuminating a part,
/// and lamps at the corners.
fn scene(size: u32) -> String {
    let mut text = format!(
        "film = {{ width = {size}, height = {size} }}\n\
         [camera]\ntype = \"perspective\"\nlook_at = {{ origin = [0, -2.2, 1.6], target = [0, 0, 0], up = [0, 0, 1] }}\nfov = 50\n\
         [[shape]]\ntype = \"heightfield\"\ncolumns = 436\nrows = 436\n\
         material = {{ type = \"matte\", reflectance = 0.7 }}\n"
    );
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
