//! `bench efficiency`: how well threads and vector instructions are used, by tile size.
//!
//! The level of vector instructions is determined once for a process, so each level is measured by
//! a process of its own. All processes, tile sizes and numbers of threads take turns.

use super::machine::{date, load, processor, processor_time};
use crate::pages;
use clap::Args;
use serde_json::{Value, json};
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::process::Command;
use whitstone::core::Registry;
use whitstone::core::simd::Level;
use whitstone::render::{BuildOptions, Pipeline, RenderOptions};
use whitstone::scene::Sources;
use whitstone::{Exit, Failure};

/// The page with the table.
const PAGE: &str = "docs/parallel.md";
const MARKERS: [&str; 2] = [
    "<!-- figures: written by `cargo xtask bench efficiency --page` -->",
    "<!-- end of figures -->",
];
/// The scenes of the page.
const SCENES: [&str; 2] = ["scenes/showcase/classic.toml", "scenes/showcase/glass_mesh.toml"];
/// Sides of tiles in pixels. Up to 16 the rays of a tile are one stream.
const TILES: [u32; 5] = [4, 8, 16, 32, 128];
/// The levels of vector instructions, as the environment variable names them.
const LEVELS: [(Level, &str); 3] = [
    (Level::Baseline, "baseline"),
    (Level::Avx2, "avx2"),
    (Level::Avx512, "avx512"),
];
/// Limits the level of vector instructions of a process.
const VARIABLE: &str = "WHITSTONE_SIMD";

/// Benchmark whole images by tile size, level of vector instructions and number of threads
///
/// Prints the time with one thread and with several, and the efficiency of the threads: the time
/// with one, divided by the time with several and by their number.
#[derive(Args, Debug)]
#[command(
    help_template = whitstone::commands::HELP_TEMPLATE,
    after_help = "Examples:\n  cargo xtask bench efficiency\n  cargo xtask bench efficiency scenes/showcase/room.toml --threads 8\n  cargo xtask bench efficiency --page"
)]
pub(crate) struct Arguments {
    /// Scene files (TOML)
    #[arg(value_name = "SCENE", default_values = SCENES)]
    scenes: Vec<PathBuf>,
    /// Number of threads [default: one per core]
    #[arg(long, value_name = "COUNT")]
    threads: Option<usize>,
    /// Number of rounds; each renders every image once
    #[arg(long, value_name = "COUNT", default_value_t = 5)]
    rounds: usize,
    /// Width of the images in pixels; the height is three quarters of it
    #[arg(long, value_name = "PIXELS", default_value_t = 320)]
    width: u32,
    /// Write the tables into docs/parallel.md
    #[arg(long)]
    page: bool,
    /// Only the current level of vector instructions; prints one line of JSON for each round
    #[arg(long, hide = true)]
    one_level: bool,
}

/// Runs the command.
pub(super) fn run(arguments: &Arguments, registry: &Registry) -> Result<Exit, Failure> {
    let threads = arguments
        .threads
        .unwrap_or_else(|| std::thread::available_parallelism().map_or(1, usize::from));
    if arguments.one_level {
        for scene in &arguments.scenes {
            println!("{}", once(scene, arguments.width, threads, registry)?);
        }
        return Ok(Exit::Pass);
    }
    let before = load();
    let mut text = format!(
        "{}, {threads} threads, {}.\nImages of {} x {} pixels, best of {} rounds. Load {before:.1} before.",
        processor().unwrap_or_else(|| "unknown processor".to_owned()),
        date(),
        arguments.width,
        arguments.width * 3 / 4,
        arguments.rounds.max(1),
    );
    for scene in &arguments.scenes {
        let rows = measure(scene, arguments, threads)?;
        let _ = write!(text, "\n\n{}", table(scene, threads, &rows));
    }
    println!("{text}");
    if arguments.page {
        pages::between(PAGE, MARKERS, &text)?;
    }
    Ok(Exit::Pass)
}

/// Times of one tile size at one level: wall-clock seconds with one thread and with several, and
/// processor seconds of the same.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Times {
    wall: [f64; 2],
    busy: [f64; 2],
}

impl Times {
    fn efficiency(&self, threads: usize) -> f64 {
        self.wall[0] / (self.wall[1] * threads as f64)
    }

    /// The efficiency if no thread ever waits for a core.
    fn bound(&self) -> f64 {
        self.busy[0] / self.busy[1]
    }
}

/// The best of all rounds, when the machine was least busy, for each level and tile size.
type Rows = Vec<(Level, Vec<Times>)>;

/// Runs a process for each level and round.
fn measure(scene: &Path, arguments: &Arguments, threads: usize) -> Result<Rows, Failure> {
    let program = std::env::current_exe().map_err(Failure::environment)?;
    let levels = LEVELS.iter().filter(|(level, _)| *level <= Level::current());
    let levels: Vec<_> = levels.collect();
    let mut rounds: Vec<Vec<Vec<Times>>> = vec![Vec::new(); levels.len()];
    for _ in 0..arguments.rounds.max(1) {
        for ((_, name), rounds) in levels.iter().zip(&mut rounds) {
            let output = Command::new(&program)
                .env(VARIABLE, name)
                .args(["bench", "efficiency", "--one-level"])
                .args(["--threads", &threads.to_string()])
                .args(["--width", &arguments.width.to_string()])
                .arg(scene)
                .output()
                .map_err(Failure::environment)?;
            let said = String::from_utf8_lossy(&output.stderr);
            if !output.status.success() {
                return Err(Failure::usage(said.trim_end()));
            }
            let line: Value = serde_json::from_slice(&output.stdout).map_err(Failure::environment)?;
            rounds.push(TILES.iter().map(|tile| times(&line[tile.to_string()])).collect());
        }
    }
    let of = |(level, rounds): (&&(Level, &str), Vec<Vec<Times>>)| {
        let tile = |index: usize| {
            let best = |of: &dyn Fn(&Times) -> f64| {
                let all = rounds.iter().map(|round| of(&round[index]));
                all.fold(f64::INFINITY, f64::min)
            };
            Times {
                wall: [0, 1].map(|k| best(&|times| times.wall[k])),
                busy: [0, 1].map(|k| best(&|times| times.busy[k])),
            }
        };
        (level.0, (0..TILES.len()).map(tile).collect())
    };
    Ok(levels.iter().zip(rounds).map(of).collect())
}

/// Reads the times of a tile size; NaN where one is missing.
fn times(value: &Value) -> Times {
    let two = |key: &str| [0, 1].map(|k| value[key][k].as_f64().unwrap_or(f64::NAN));
    Times {
        wall: two("wall"),
        busy: two("busy"),
    }
}

/// One round at the current level: an image of each tile size with one thread and with several.
fn once(scene: &Path, width: u32, threads: usize, registry: &Registry) -> Result<Value, Failure> {
    let film = format!("film={{ width = {width}, height = {} }}", (width * 3 / 4).max(1));
    let sources = Sources::load(scene, &[film], registry)
        .map_err(|error| Failure::usage(error.sources.report(&error.errors, false)))?;
    let pipeline = Pipeline::load(&sources, registry, BuildOptions::default())
        .map_err(|errors| Failure::usage(sources.report(&errors, false)))?;
    let pool = |threads: usize| {
        let builder = rayon::ThreadPoolBuilder::new().num_threads(threads);
        builder.build().map_err(Failure::environment)
    };
    let pools = [pool(1)?, pool(threads)?];
    // The first image touches pages.
    let mut kept = pools[1].install(|| pipeline.render(RenderOptions::default()));
    let mut found = serde_json::Map::new();
    for tile in TILES {
        let (mut wall, mut busy) = ([0.0; 2], [0.0; 2]);
        for (k, pool) in pools.iter().enumerate() {
            let options = RenderOptions {
                tile,
                ..RenderOptions::default()
            };
            let start = processor_time();
            pool.install(|| pipeline.render_into(options, &mut kept));
            busy[k] = processor_time() - start;
            wall[k] = kept.render_seconds;
        }
        found.insert(tile.to_string(), json!({ "wall": wall, "busy": busy }));
    }
    Ok(Value::Object(found))
}

/// The table of a scene.
fn table(scene: &Path, threads: usize, rows: &Rows) -> String {
    let name = scene.file_stem().unwrap_or_default().display();
    let mut text = format!("| {name}: tile |");
    for (level, _) in rows {
        let _ = write!(
            text,
            " {level}, 1 thread | {threads} threads | efficiency | at most |"
        );
    }
    let _ = write!(text, "\n|---|{}", "---|".repeat(4 * rows.len()));
    for (index, tile) in TILES.iter().enumerate() {
        let _ = write!(text, "\n| {tile} x {tile} |");
        for (_, tiles) in rows {
            let times = &tiles[index];
            let [one, several] = times.wall.map(|seconds| 1e3 * seconds);
            let _ = write!(
                text,
                " {one:.0} ms | {several:.0} ms | {:.2} | {:.2} |",
                times.efficiency(threads),
                times.bound()
            );
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn efficiency_is_the_share_of_threads_that_work() {
        let times = Times {
            wall: [4.0, 1.25],
            busy: [4.0, 4.5],
        };
        assert!((times.efficiency(4) - 0.8).abs() < 1e-15);
        assert!((times.bound() - 4.0 / 4.5).abs() < 1e-15);
        let written = json!({ "wall": [4.0, 1.25], "busy": [4.0, 4.5] });
        assert_eq!(super::times(&written), times);
        let rows = vec![(Level::Baseline, vec![times; TILES.len()])];
        let text = table(Path::new("a/b.toml"), 4, &rows);
        assert!(
            text.contains("| 16 x 16 | 4000 ms | 1250 ms | 0.80 | 0.89 |"),
            "{text}"
        );
        assert_eq!(text.lines().count(), 2 + TILES.len());
    }
}
