//! `bench plugins`: what a ray costs in the example scene of each plugin, for the pages of
//! docs/plugins.

use super::machine::processor_time;
use super::median;
use clap::Args;
use std::collections::BTreeMap;
use std::path::Path;
use std::time::{Duration, Instant};
use whitstone::core::Registry;
use whitstone::scene::{Description, Pipeline, Plan, RenderOptions, Sources};
use whitstone::{Exit, Failure};

/// Nanoseconds a ray, by family and name.
pub(crate) type Costs = BTreeMap<String, BTreeMap<String, f64>>;

/// Where they are kept.
pub(crate) const FILE: &str = "docs/costs.json";

/// Renderings of a scene that its median is taken from, at least.
const ROUNDS: usize = 5;

/// Render the example scene of each plugin on one thread, and keep the nanoseconds a ray for its
/// page
#[derive(Args, Debug)]
pub(crate) struct Arguments {
    /// Milliseconds for each scene, at least
    #[arg(long, default_value_t = 200)]
    budget: u64,
}

/// Runs the verb.
pub(super) fn run(arguments: &Arguments, registry: &Registry) -> Result<Exit, Failure> {
    let mut costs = Costs::new();
    for entry in registry.entries() {
        let family = entry.family.plural();
        let scene = format!("scenes/{family}/{}.toml", entry.name);
        // Other engines have none.
        if !Path::new(&scene).is_file() {
            continue;
        }
        let cost = nanoseconds_a_ray(&scene, registry, Duration::from_millis(arguments.budget))?;
        println!("{family:<13} {:<16} {cost:>8.1} ns a ray", entry.name);
        // Three digits: more are noise.
        let digits = 2.0 - cost.log10().floor();
        let rounded = (cost * f64::powf(10.0, digits)).round() / f64::powf(10.0, digits);
        costs
            .entry(family.to_owned())
            .or_default()
            .insert(entry.name.to_owned(), rounded);
    }
    let text = serde_json::to_string_pretty(&costs).map_err(|error| Failure::usage(error.to_string()))?;
    std::fs::write(FILE, text + "\n").map_err(|error| Failure::usage(format!("{FILE}: {error}")))?;
    println!("{FILE} is written; `cargo xtask readme` puts it into the pages");
    Ok(Exit::Pass)
}

/// Shading and shadow rays included, layers not.
fn nanoseconds_a_ray(scene: &str, registry: &Registry, budget: Duration) -> Result<f64, Failure> {
    let sources = Sources::load(Path::new(scene), &["film.aovs=[]".to_owned()])
        .map_err(|error| Failure::usage(error.sources.report(&error.errors, false)))?;
    let report = |errors| Failure::usage(sources.report(&errors, false));
    let description = Description::parse(&sources).map_err(report)?;
    let plan = Plan::new(&description, registry).map_err(report)?;
    let pipeline = Pipeline::build(&plan, registry).map_err(report)?;
    let options = RenderOptions {
        threads: 1,
        progress: None,
    };
    let render = || {
        let before = processor_time();
        let counters = pipeline.render(options).counters;
        let rays = counters.closest + counters.shadow;
        1e9 * (processor_time() - before) / rays.max(1) as f64
    };
    // The first one touches pages.
    render();
    let (start, mut found) = (Instant::now(), Vec::new());
    while found.len() < ROUNDS || start.elapsed() < budget {
        found.push(render());
    }
    Ok(median(&mut found))
}

/// Those that are kept; none where there is no such file.
pub(crate) fn kept() -> Costs {
    let text = std::fs::read_to_string(FILE).unwrap_or_default();
    serde_json::from_str(&text).unwrap_or_default()
}
