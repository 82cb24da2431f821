//! `bench`: our speed beside Mitsuba's, the same rays in the same run.

mod accelerators;
mod data;
mod peer;
mod prepare;
mod rays;

use clap::{Args, Subcommand};
use serde_json::json;
use std::path::{Path, PathBuf};
use std::time::Duration;
use whitstone::core::Registry;
use whitstone::scene::{Description, Pipeline, Plan, RenderOptions, Sources};
use whitstone::validate::driver::{Driver, Setting};
use whitstone::validate::environment::Environment;
use whitstone::{Exit, Failure};

/// Time scenes with Whitstone and with Mitsuba, interleaved, and print medians and ratios
#[derive(Args, Debug)]
#[command(args_conflicts_with_subcommands = true)]
pub(crate) struct Arguments {
    #[command(subcommand)]
    what: Option<What>,
    /// The scenes
    #[arg(default_value = "scenes/showcase/classic.toml")]
    scenes: Vec<PathBuf>,
    /// Columns of the image
    #[arg(long, default_value_t = 1920)]
    width: u32,
    /// Rows of the image
    #[arg(long, default_value_t = 1080)]
    height: u32,
    /// Rounds; each times both once
    #[arg(long, default_value_t = 5)]
    rounds: usize,
    /// Threads of both; 0 for one a core
    #[arg(long, default_value_t = 0)]
    threads: usize,
    /// Write the figures to this file
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

#[derive(Subcommand, Debug)]
enum What {
    Accelerators(accelerators::Arguments),
}

/// Runs the verb.
pub(crate) fn run(arguments: &Arguments, registry: &Registry) -> Result<Exit, Failure> {
    if let Some(What::Accelerators(arguments)) = &arguments.what {
        return accelerators::run(arguments, registry);
    }
    let target = Path::new("target/whitstone");
    let environment = Environment::ensure(target, Path::new("references"), &|text| eprintln!("{text}"))
        .map_err(Failure::environment)?;
    let mut driver = Driver::start(&environment, Duration::from_secs(600)).map_err(Failure::environment)?;
    let mut reports = Vec::new();
    for path in &arguments.scenes {
        let overrides = [format!(
            "film={{ width = {}, height = {} }}",
            arguments.width, arguments.height
        )];
        let sources = Sources::load(path, &overrides)
            .map_err(|error| Failure::usage(error.sources.report(&error.errors, false)))?;
        let report = |errors| Failure::usage(sources.report(&errors, false));
        let description = Description::parse(&sources).map_err(report)?;
        let plan = Plan::new(&description, registry).map_err(report)?;
        let pipeline = Pipeline::build(&plan, registry).map_err(report)?;
        let options = RenderOptions {
            threads: arguments.threads,
            progress: None,
        };
        let request = json!({
            "op": "time", "scene": description.flattened.text, "base": description.flattened.base,
            "setting": Setting::default(), "threads": arguments.threads, "repeats": 1,
        });
        // Once for warmth: kernels are compiled, pages are touched.
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
            "{}: {} x {}\n  whitstone            {ours:.3} s  {} rays  {rate:.2} Mrays/s\n  mitsuba, same rays   {theirs:.3} s  {driver_rays} rays  {driver_rate:.2} Mrays/s  (whitstone traces {:.2} times as many rays a second)\n  mitsuba, C++ path    {path_s:.3} s  one branch a hit  (whitstone takes {:.2} of its time)",
            path.display(),
            arguments.width,
            arguments.height,
            counters.total(),
            rate / driver_rate,
            ours / path_s,
        );
        reports.push(json!({
            "scene": path, "width": arguments.width, "height": arguments.height,
            "whitstone_s": ours, "whitstone_rays": counters.total(), "driver_s": theirs,
            "driver_rays": driver_rays, "path_s": path_s, "rate_ratio": rate / driver_rate,
            "time_over_path": ours / path_s,
        }));
    }
    if let Some(path) = &arguments.json {
        let text = format!("{:#}\n", json!({ "bench": reports }));
        whitstone::image::atomic::write_bytes(path, text.as_bytes()).map_err(Failure::environment)?;
    }
    Ok(Exit::Pass)
}

/// NaN for no values.
fn median(values: &mut [f64]) -> f64 {
    values.sort_by(f64::total_cmp);
    match values.len() {
        0 => f64::NAN,
        n if n % 2 == 1 => values[n / 2],
        n => 0.5 * (values[n / 2 - 1] + values[n / 2]),
    }
}
