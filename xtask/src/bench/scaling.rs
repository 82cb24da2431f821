//! `bench scaling`: compares building and tracing on several threads with one thread.
//!
//! Other processes influence the wall-clock time, so processor time is reported next to it. The
//! extra processor time of several threads is their overhead, and bounds the speedup on an idle
//! machine.

use super::choice::{Choice, build};
use super::data;
use super::fetch;
use super::machine::{load, processor_time};
use super::median;
use super::prepare::prepare;
use super::rays::{Mode, Rays};
use clap::Args;
use rayon::ThreadPool;
use serde_json::json;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Instant;
use whitstone::core::{Geometry, LoweredShape, Registry};
use whitstone::{Exit, Failure};

/// Benchmark an accelerator's build and traversal with one thread and with several, interleaved, in
/// wall-clock time
#[derive(Args, Debug)]
pub(crate) struct Arguments {
    #[command(flatten)]
    folder: fetch::Folder,
    /// Mesh: a name in the data folder, or a PLY or OBJ file [default: dragon, or else the last
    /// available mesh]
    #[arg(long, value_name = "PATH")]
    mesh: Option<String>,
    /// Set of rays: primary, shadow or bounce
    #[arg(long, value_name = "SET", default_value = "bounce")]
    set: String,
    /// Accelerator: TYPE or TYPE:QUALITY
    #[arg(long, value_name = "NAME", default_value = "bvh:balanced")]
    accelerator: String,
    /// Number of threads of the larger pool, at least 2 [default: one per core]
    #[arg(long, value_name = "COUNT")]
    threads: Option<usize>,
    /// Number of rounds; each runs everything once with both pools
    #[arg(long, value_name = "COUNT", default_value_t = 7)]
    rounds: usize,
    /// Write the results to this file as JSON
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

/// Runs the command.
pub(super) fn run(arguments: &Arguments, registry: &Registry) -> Result<Exit, Failure> {
    let folder = arguments.folder.ensure().map_err(Failure::environment)?;
    let meshes: Vec<String> = arguments.mesh.iter().cloned().collect();
    let names = prepare(&folder, &meshes, registry).map_err(Failure::environment)?;
    // The dragon, or else the last available mesh.
    let name = names.iter().find(|name| *name == "dragon").or(names.last());
    let name = name.ok_or_else(|| Failure::usage("no mesh is available; name one with --mesh"))?;
    let mesh = data::mesh(&folder.join(format!("{name}.tri"))).map_err(Failure::environment)?;
    let geometry = Arc::new(Geometry::new(vec![LoweredShape::Triangles(mesh)]));
    let rays = folder.join(format!("{name}_{}.rays", arguments.set));
    let rays = Rays::read(&rays, 1, &arguments.set).map_err(Failure::environment)?;
    let choice = Choice::parse(&arguments.accelerator);

    let pool = |threads: usize| {
        let builder = rayon::ThreadPoolBuilder::new().num_threads(threads);
        builder.build().map_err(Failure::environment)
    };
    let cores = || std::thread::available_parallelism().map_or(1, usize::from);
    let threads = arguments.threads.unwrap_or_else(cores).max(2);
    let pools = [pool(1)?, pool(threads)?];
    let before = load();
    let mut times = [[Vec::new(), Vec::new(), Vec::new()], [const { Vec::new() }; 3]];
    let mut ratios = [const { Vec::new() }; 3];
    let mut bounds = [const { Vec::new() }; 3];
    for round in 0..=arguments.rounds.max(1) {
        let mut seconds = [[(0.0, 0.0); 3]; 2];
        for (pool, seconds) in pools.iter().zip(&mut seconds) {
            *seconds = once(pool, &choice, &geometry, &rays, registry).map_err(Failure::environment)?;
        }
        // The first round is a warm-up: it touches pages.
        for task in 0..3 {
            if round > 0 {
                let [(one, one_busy), (several, several_busy)] =
                    [0, 1].map(|pool: usize| seconds[pool][task]);
                times[0][task].push(one);
                times[1][task].push(several);
                ratios[task].push(one / several);
                bounds[task].push(threads as f64 * one_busy / several_busy);
            }
        }
    }
    println!(
        "{name}, {} {} rays, {}: 1 and {} threads, wall-clock time; load {before:.1} before, {:.1} after",
        rays.len(),
        arguments.set,
        arguments.accelerator,
        threads,
        load()
    );
    let mut figures = Vec::new();
    for (task, what) in ["build", "single", "batch"].into_iter().enumerate() {
        let [one, several] = [0, 1].map(|pool: usize| median(&mut times[pool][task]));
        let (ratio, bound) = (median(&mut ratios[task]), median(&mut bounds[task]));
        // The best times, when the machine was least busy.
        let best = times[0][task][0] / times[1][task][0];
        println!(
            "  {what:6}  {one:8.4} s  {several:8.4} s  speedup {ratio:.2} (best of each: {best:.2}); upper bound from processor time {bound:.2}"
        );
        figures.push(json!({
            "task": what, "one_s": one, "several_s": several, "speedup": ratio, "best_speedup": best,
            "bound_by_processor_time": bound,
        }));
    }
    if let Some(path) = &arguments.json {
        let text = json!({
            "mesh": name, "set": arguments.set, "accelerator": arguments.accelerator,
            "threads": threads, "load_before": before, "load_after": load(), "figures": figures,
        });
        let text = format!("{text:#}\n");
        whitstone::image::atomic::write_bytes(path, text.as_bytes()).map_err(Failure::environment)?;
    }
    Ok(Exit::Pass)
}

/// Seconds of building, of single rays and of streams, in wall-clock and in processor time.
fn once(
    pool: &ThreadPool,
    choice: &Choice,
    geometry: &Arc<Geometry>,
    rays: &Rays,
    registry: &Registry,
) -> Result<[(f64, f64); 3], String> {
    let timed = |work: &mut dyn FnMut() -> Result<(), String>| {
        let (clock, busy) = (Instant::now(), processor_time());
        work()?;
        Ok::<_, String>((clock.elapsed().as_secs_f64(), processor_time() - busy))
    };
    pool.install(|| {
        let mut accelerator = None;
        let built = timed(&mut || {
            accelerator = Some(build(registry, choice, geometry)?);
            Ok(())
        })?;
        let accelerator = accelerator.ok_or("nothing built")?;
        let trace = |mode| {
            timed(&mut || {
                std::hint::black_box(rays.parallel_pass(&*accelerator, mode));
                Ok(())
            })
        };
        Ok([built, trace(Mode::Single)?, trace(Mode::Batch)?])
    })
}
