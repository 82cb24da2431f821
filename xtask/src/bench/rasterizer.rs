//! `bench rasterizer`: compares rasterization with ray casting. Shading is the same in both. A
//! scene with only ambient lights shows the cost of visibility alone.

use super::machine::{load, processor_time};
use super::median;
use clap::Args;
use std::path::PathBuf;
use whitstone::core::Registry;
use whitstone::render::{BuildOptions, Pipeline, RenderOptions};
use whitstone::scene::Sources;
use whitstone::{Exit, Failure};

/// Benchmark rasterization against ray casting on scenes of triangles, interleaved
#[derive(Args, Debug)]
pub(crate) struct Arguments {
    /// Scene files (TOML) that contain only triangles
    #[arg(value_name = "SCENE", default_value = "scenes/integrators/rasterizer.toml")]
    scenes: Vec<PathBuf>,
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

/// Runs the command.
pub(super) fn run(arguments: &Arguments, registry: &Registry) -> Result<Exit, Failure> {
    let options = RenderOptions {
        threads: arguments.threads,
        ..RenderOptions::default()
    };
    for path in &arguments.scenes {
        let build = |integrator: &str| -> Result<Pipeline, Failure> {
            let shadows = if arguments.shadows { "opaque" } else { "none" };
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
        let both = ["rasterizer", "appel"];
        let (mut built, mut rendered) = ([const { Vec::new() }; 2], [const { Vec::new() }; 2]);
        for round in 0..=arguments.rounds {
            for (number, integrator) in both.into_iter().enumerate() {
                let pipeline = build(integrator)?;
                let before = processor_time();
                pipeline.render(options);
                // The first round is a warm-up: it touches pages.
                if round > 0 {
                    built[number].push(pipeline.build_seconds);
                    rendered[number].push(processor_time() - before);
                }
            }
        }
        let [drawn, cast] = rendered.each_mut().map(|times| median(times));
        let [drawn_build, cast_build] = built.each_mut().map(|times| median(times));
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
