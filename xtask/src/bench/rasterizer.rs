//! `bench rasterizer`: compares rasterization with ray casting. Shading is the same in both. A
//! scene with only ambient lights shows the cost of visibility alone.

use super::machine::{date, load, processor, processor_time};
use super::median;
use crate::comparisons;
use crate::readme::of_text;
use clap::Args;
use serde_json::{Value, json};
use std::path::PathBuf;
use whitstone::core::Registry;
use whitstone::image::atomic;
use whitstone::render::{BuildOptions, Pipeline, RenderOptions};
use whitstone::scene::Sources;
use whitstone::{Exit, Failure};

/// Benchmark rasterization against ray casting on scenes of triangles, interleaved
#[derive(Args, Debug)]
#[command(
    help_template = whitstone::commands::HELP_TEMPLATE,
    after_help = "Examples:\n  cargo xtask bench rasterizer --shadows\n  cargo xtask bench rasterizer --sizes --json studies/results/rasterizer.json"
)]
pub(crate) struct Arguments {
    /// Scene files (TOML) that contain only triangles
    #[arg(value_name = "SCENE", default_value = "scenes/integrators/rasterizer.toml")]
    scenes: Vec<PathBuf>,
    /// Vary the image and the number of triangles of a heightfield, in place of scenes
    #[arg(long, conflicts_with_all = ["scenes", "width", "height"])]
    sizes: bool,
    /// Write the results of `--sizes` to this file as JSON
    #[arg(long, value_name = "FILE", requires = "sizes")]
    json: Option<PathBuf>,
    /// Width of the image in pixels
    #[arg(long, value_name = "PIXELS", default_value_t = 1920)]
    width: u32,
    /// Height of the image in pixels
    #[arg(long, value_name = "PIXELS", default_value_t = 1080)]
    height: u32,
    /// Number of rounds; each renders with both integrators once
    #[arg(long, value_name = "COUNT", default_value_t = 7)]
    rounds: usize,
    /// Number of threads; 0 means one per core
    #[arg(long, value_name = "COUNT", default_value_t = 1)]
    threads: usize,
    /// Also trace shadow rays, which are the same with both integrators
    #[arg(long)]
    shadows: bool,
}

/// Medians in seconds of processor time, of rasterization and of ray casting.
struct Measured {
    built: [f64; 2],
    rendered: [f64; 2],
    /// Pixels of the last images that differ in any bit.
    differing: usize,
}

/// Renders a scene, built for each integrator, in rounds.
fn measure(
    arguments: &Arguments,
    build: impl Fn(&str) -> Result<Pipeline, Failure>,
) -> Result<Measured, Failure> {
    let options = RenderOptions {
        threads: arguments.threads,
        ..RenderOptions::default()
    };
    let (mut built, mut rendered) = ([const { Vec::new() }; 2], [const { Vec::new() }; 2]);
    let mut images = [const { Vec::new() }; 2];
    for round in 0..=arguments.rounds {
        for (number, integrator) in ["rasterizer", "appel"].into_iter().enumerate() {
            let pipeline = build(integrator)?;
            let before = processor_time();
            let film = pipeline.render(options);
            // The first round is a warm-up: it touches pages.
            if round > 0 {
                built[number].push(pipeline.build_seconds);
                rendered[number].push(processor_time() - before);
            }
            images[number] = film.rgb;
        }
    }
    Ok(Measured {
        built: built.each_mut().map(|times| median(times)),
        rendered: rendered.each_mut().map(|times| median(times)),
        differing: comparisons::differing(&images[0], &images[1]),
    })
}

/// Runs the command.
pub(super) fn run(arguments: &Arguments, registry: &Registry) -> Result<Exit, Failure> {
    let shadows = if arguments.shadows { "opaque" } else { "none" };
    if arguments.sizes {
        return sizes(arguments, shadows, registry);
    }
    for path in &arguments.scenes {
        let build = |integrator: &str| -> Result<Pipeline, Failure> {
            let overrides = [
                format!(
                    "film={{ width = {}, height = {} }}",
                    arguments.width, arguments.height
                ),
                format!("integrator={{ type = \"{integrator}\", shadows = \"{shadows}\" }}"),
            ];
            let sources = Sources::load(path, &overrides, registry)
                .map_err(|error| Failure::usage(error.sources.report(&error.errors, false)))?;
            let report = |errors| Failure::usage(sources.report(&errors, false));
            Pipeline::load(&sources, registry, BuildOptions::default()).map_err(report)
        };
        let found = measure(arguments, build)?;
        let ([drawn, cast], [drawn_build, cast_build]) = (found.rendered, found.built);
        println!(
            "{}: {} x {}, {} threads, {} shadows, in processor time; load {:.1}\n  rasterized  {drawn:.4} s  (build {drawn_build:.4} s, projection and accelerator)\n  ray cast    {cast:.4} s  (build {cast_build:.4} s)  {:.2} times as long",
            path.display(),
            arguments.width,
            arguments.height,
            arguments.threads,
            if arguments.shadows { "with" } else { "without" },
            load(),
            cast / drawn,
        );
    }
    Ok(Exit::Pass)
}

/// Varies the size of the image and the number of triangles.
fn sizes(arguments: &Arguments, shadows: &str, registry: &Registry) -> Result<Exit, Failure> {
    let before = load();
    let mut rows: Vec<Value> = Vec::new();
    for columns in comparisons::COLUMNS {
        for [width, height] in comparisons::IMAGES {
            let found = measure(arguments, |integrator| {
                let text = comparisons::landscape(columns, [width, height], integrator, shadows);
                of_text(registry, &text)
            })?;
            let ([drawn, cast], [drawn_build, cast_build]) = (found.rendered, found.built);
            println!(
                "{:>8} triangles, {width:>4} x {height:>4}: rasterized {drawn:.5} s (build {drawn_build:.5} s), ray cast {cast:.5} s (build {cast_build:.5} s), {} pixels differ",
                2 * columns * columns,
                found.differing,
            );
            rows.push(json!({
                "triangles": 2 * columns * columns,
                "width": width,
                "height": height,
                "rasterized_s": drawn,
                "rasterized_build_s": drawn_build,
                "cast_s": cast,
                "cast_build_s": cast_build,
                "differing": found.differing,
            }));
        }
    }
    if let Some(path) = &arguments.json {
        let cores = std::thread::available_parallelism().map_or(0, usize::from);
        let result = json!({
            "processor": processor(),
            "cores": cores,
            "threads": arguments.threads,
            "shadows": shadows,
            "rounds": arguments.rounds,
            "date": date(),
            "load": before,
            "rows": rows,
        });
        let bytes = serde_json::to_vec_pretty(&result).map_err(Failure::environment)?;
        atomic::write_bytes(path, &bytes).map_err(Failure::environment)?;
    }
    Ok(Exit::Pass)
}
