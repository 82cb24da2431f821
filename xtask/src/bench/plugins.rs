//! `bench plugins`: the cost of a ray in the example scene of each plugin, for the pages of
//! docs/plugins.

use super::machine::processor_time;
use super::median;
use clap::Args;
use std::collections::BTreeMap;
use std::path::Path;
use std::time::{Duration, Instant};
use whitstone::core::Registry;
use whitstone::render::{BuildOptions, Pipeline, RenderOptions};
use whitstone::scene::Sources;
use whitstone::{Exit, Failure};

/// Nanoseconds per ray, by family and name.
pub(crate) type Costs = BTreeMap<String, BTreeMap<String, f64>>;

/// The file of stored costs.
pub(crate) const FILE: &str = "docs/costs.json";

/// Minimum number of renderings of a scene for its median.
const ROUNDS: usize = 5;

/// Render the example scene of each plugin on one thread, and store the nanoseconds per ray for its
/// page
#[derive(Args, Debug)]
pub(crate) struct Arguments {
    /// Minimum time for each scene, in milliseconds
    #[arg(long, value_name = "MS", default_value_t = 200)]
    budget: u64,
}

/// Runs the command.
pub(super) fn run(arguments: &Arguments, registry: &Registry) -> Result<Exit, Failure> {
    let mut costs = Costs::new();
    for entry in registry.entries() {
        let family = entry.family.plural();
        let scene = format!("scenes/{family}/{}.toml", entry.name);
        // Third-party backends have no example scene.
        if !Path::new(&scene).is_file() {
            continue;
        }
        let cost = nanoseconds_per_ray(&scene, registry, Duration::from_millis(arguments.budget))?;
        println!("{family:<13} {:<16} {cost:>8.1} ns per ray", entry.name);
        // Three significant digits: more would be noise.
        let digits = 2.0 - cost.log10().floor();
        let rounded = (cost * f64::powf(10.0, digits)).round() / f64::powf(10.0, digits);
        costs
            .entry(family.to_owned())
            .or_default()
            .insert(entry.name.to_owned(), rounded);
    }
    let text = serde_json::to_string_pretty(&costs).map_err(|error| Failure::usage(error.to_string()))?;
    std::fs::write(FILE, text + "\n").map_err(|error| Failure::usage(format!("{FILE}: {error}")))?;
    println!("{FILE}: written; run `cargo xtask readme` to update the pages");
    Ok(Exit::Pass)
}

/// Includes shading and shadow rays, but not layers.
fn nanoseconds_per_ray(scene: &str, registry: &Registry, budget: Duration) -> Result<f64, Failure> {
    let sources = Sources::load(Path::new(scene), &["film.aovs=[]".to_owned()], registry)
        .map_err(|error| Failure::usage(error.sources.report(&error.errors, false)))?;
    let report = |errors| Failure::usage(sources.report(&errors, false));
    let pipeline = Pipeline::load(&sources, registry, BuildOptions::default()).map_err(report)?;
    let options = RenderOptions {
        threads: 1,
        ..RenderOptions::default()
    };
    let render = || {
        let before = processor_time();
        let counters = pipeline.render(options).counters;
        let rays = counters.closest + counters.shadow;
        1e9 * (processor_time() - before) / rays.max(1) as f64
    };
    // The first one is a warm-up: it touches pages.
    render();
    let (start, mut found) = (Instant::now(), Vec::new());
    while found.len() < ROUNDS || start.elapsed() < budget {
        found.push(render());
    }
    Ok(median(&mut found))
}

/// The stored costs; none if the file does not exist.
pub(crate) fn kept() -> Costs {
    let text = std::fs::read_to_string(FILE).unwrap_or_default();
    serde_json::from_str(&text).unwrap_or_default()
}
