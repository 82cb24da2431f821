//! `bench growth`: how time and memory grow with triangles, lights, pixels, depth and threads,
//! compared with the limits of the machine.

use super::machine::{date, load, processor};
use super::median;
use clap::Args;
use serde_json::{Value, json};
use std::hint::black_box;
use std::path::{Path, PathBuf};
use std::time::Instant;
use whitstone::core::{Registry, simd};
use whitstone::image::atomic;
use whitstone::render::{BuildOptions, Pipeline, RenderOptions};
use whitstone::scene::Sources;
use whitstone::{Exit, Failure};

/// Benchmark how time and memory grow with the size of a scene, and fit exponents
///
/// Each family varies one number: triangles, lights, pixels, depth or threads. The limits of the
/// machine are measured as well: the latency of memory, its bandwidth and the rate of arithmetic.
#[derive(Args, Debug)]
#[command(
    help_template = whitstone::commands::HELP_TEMPLATE,
    after_help = "Examples:\n  cargo xtask bench growth --quick\n  cargo xtask bench growth --json studies/results/growth-2-cores.json"
)]
pub(super) struct Arguments {
    /// Families to run [default: all]
    #[arg(value_name = "FAMILY")]
    families: Vec<String>,
    /// Stop each family after its third value
    #[arg(long)]
    quick: bool,
    /// Number of renderings of each scene; slow ones are repeated less often
    #[arg(long, value_name = "COUNT", default_value_t = 5)]
    rounds: usize,
    /// Write the results to this file as JSON
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

/// Scenes that differ in one number.
struct Family {
    name: &'static str,
    /// The number that varies.
    parameter: &'static str,
    values: &'static [f64],
    scene: fn(f64) -> Scene,
}

/// A scene file or its text, with overrides.
struct Scene {
    text: String,
    overrides: Vec<String>,
    threads: usize,
}

const FAMILIES: &[Family] = &[
    Family {
        name: "triangles",
        parameter: "triangles of a height field; 256 x 256 pixels, one light, one thread",
        values: &[1e3, 1e4, 1e5, 1e6, 1e7, 1e8],
        scene: |triangles| {
            let cells = (triangles / 2.0).sqrt().round();
            Scene::of_text(landscape(256, 256, cells) + LAMP)
        },
    },
    Family {
        name: "lights",
        parameter: "point lights over 20,000 triangles; 64 x 48 pixels, one thread",
        values: &[1.0, 10.0, 100.0, 1e3, 1e4, 1e5],
        scene: |lights| Scene::of_text(landscape(64, 48, 100.0) + &lamps(lights)),
    },
    Family {
        name: "pixels",
        parameter: "pixels of the scene classic; one thread",
        values: &[
            4096.0, 16384.0, 65536.0, 262144.0, 1048576.0, 4194304.0, 16777216.0,
        ],
        scene: |pixels| {
            let side = pixels.sqrt().round();
            Scene::of_file(CLASSIC, &[film(side, side)], 1)
        },
    },
    Family {
        name: "depth",
        parameter: "maximum depth of rays inside a mirror ball; 256 x 256 pixels, one thread",
        values: &[1.0, 4.0, 16.0, 64.0, 256.0, 1024.0],
        scene: |depth| Scene::of_text(mirror_ball(depth)),
    },
    Family {
        name: "threads",
        parameter: "threads; the scene classic with 2048 x 2048 pixels",
        values: &[1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 64.0, 128.0],
        scene: |threads| Scene::of_file(CLASSIC, &[film(2048.0, 2048.0)], threads as usize),
    },
];

const CLASSIC: &str = "scenes/showcase/classic.toml";

const LAMP: &str = "[[light]]\ntype = \"point\"\nposition = [0.3, -0.5, 2]\nintensity = 5\n";

/// Operations of the test of a node with eight boxes: a subtraction and a multiplication for six
/// planes.
const OPERATIONS_PER_NODE: f64 = 8.0 * 6.0 * 2.0;

/// Renderings of one scene may take this long together.
const MAX_SECONDS: f64 = 20.0;

impl Scene {
    fn of_text(text: String) -> Self {
        Self {
            text,
            overrides: Vec::new(),
            threads: 1,
        }
    }

    /// A scene file without layers, with one sample per pixel.
    fn of_file(path: &str, overrides: &[String], threads: usize) -> Self {
        let mut overrides = overrides.to_vec();
        overrides.push("sampler={ type = \"center\" }".to_owned());
        Self {
            text: std::fs::read_to_string(path).unwrap_or_default(),
            overrides,
            threads,
        }
    }

    fn build(&self, registry: &Registry) -> Result<Pipeline, Failure> {
        let folder = Path::new("scenes/showcase");
        let sources = Sources::from_text("scene.toml", &self.text, folder, &self.overrides)
            .map_err(|error| Failure::usage(error.sources.report(&error.errors, false)))?;
        let report = |errors| Failure::usage(sources.report(&errors, false));
        let pool = rayon::ThreadPoolBuilder::new().num_threads(self.threads).build();
        pool.map_err(Failure::environment)?.install(|| {
            let options = BuildOptions::default();
            Pipeline::load(&sources, registry, options).map_err(report)
        })
    }
}

fn film(width: f64, height: f64) -> String {
    format!("film={{ width = {width}, height = {height} }}")
}

/// A landscape of `cells`² quads, seen obliquely from above.
fn landscape(width: u32, height: u32, cells: f64) -> String {
    format!(
        "film = {{ width = {width}, height = {height} }}\n\
         [camera]\ntype = \"perspective\"\nlook_at = {{ origin = [0, -2.2, 1.6], target = [0, 0, 0], up = [0, 0, 1] }}\nfov = 50\n\
         [[shape]]\ntype = \"heightfield\"\ncolumns = {cells}\nrows = {cells}\n\
         material = {{ type = \"matte\", reflectance = 0.7 }}\n"
    )
}

/// Lamps on a spiral above the landscape.
fn lamps(count: f64) -> String {
    let mut text = String::new();
    for number in 0..count as u32 {
        // The golden angle spreads them evenly.
        let (sin, cos) = (f64::from(number) * 2.399_963_229_728_653).sin_cos();
        let radius = (f64::from(number) / count).sqrt();
        text += &format!(
            "[[light]]\ntype = \"point\"\nposition = [{}, {}, 1]\nintensity = {:e}\n",
            radius * cos,
            radius * sin,
            1.0 / count
        );
    }
    text
}

/// The inside of a ball that reflects most of the light: no ray ends before the maximum depth.
fn mirror_ball(depth: f64) -> String {
    format!(
        "film = {{ width = 256, height = 256 }}\n[integrator]\ntype = \"whitted\"\nmax_depth = {depth}\n\
         [camera]\ntype = \"perspective\"\nlook_at = {{ origin = [0.3, 0, 1], target = [0, 0, 0] }}\nfov = 60\n\
         [[shape]]\ntype = \"sphere\"\nradius = 2\nmaterial = {{ type = \"whitted\", k_d = 0.1, k_refl = 0.9 }}\n\
         [[light]]\ntype = \"point\"\nposition = [0, 1, 0]\nintensity = 5\n"
    )
}

/// What one scene took.
struct Row {
    value: f64,
    build_s: f64,
    render_s: f64,
    rays: f64,
    /// Of the accelerator.
    bytes: f64,
    /// Expected number of nodes and leaves that a ray visits; NaN for structures without nodes.
    steps: f64,
}

impl Row {
    fn ns_per_ray(&self) -> f64 {
        1e9 * self.render_s / self.rays
    }
}

/// Runs the command.
pub(super) fn run(arguments: &Arguments, registry: &Registry) -> Result<Exit, Failure> {
    for name in &arguments.families {
        if !FAMILIES.iter().any(|family| family.name == name) {
            let known: Vec<&str> = FAMILIES.iter().map(|family| family.name).collect();
            return Err(Failure::usage(format!(
                "unknown family {name:?}; the families are {}",
                known.join(", ")
            )));
        }
    }
    let before = load();
    let limits = Limits::measure();
    println!(
        "{}: one thread reads {:.1} GB/s and does {:.1} Gflop/s; load {before:.1}",
        processor().unwrap_or_default(),
        limits.bandwidth,
        limits.arithmetic
    );
    for (bytes, ns) in &limits.latency {
        println!("  latency of memory, {:>10} bytes: {ns:.1} ns", *bytes as u64);
    }
    let mut families = Vec::new();
    for family in FAMILIES {
        if arguments.families.is_empty() || arguments.families.iter().any(|name| name == family.name) {
            families.push(measure(family, arguments, &limits, registry)?);
        }
    }
    if let Some(path) = &arguments.json {
        let result = json!({
            "processor": processor(), "cores": std::thread::available_parallelism().map_or(0, usize::from),
            "date": date(), "load": before,
            "bandwidth_gb_s": limits.bandwidth, "gflop_s": limits.arithmetic,
            "latency": limits.latency.iter().map(|(bytes, ns)| json!({ "bytes": bytes, "ns": ns })).collect::<Vec<_>>(),
            "families": families,
        });
        atomic::write_bytes(path, format!("{result:#}\n").as_bytes()).map_err(Failure::environment)?;
    }
    Ok(Exit::Pass)
}

fn measure(
    family: &Family,
    arguments: &Arguments,
    limits: &Limits,
    registry: &Registry,
) -> Result<Value, Failure> {
    println!("{}: {}", family.name, family.parameter);
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let most = if arguments.quick { 3 } else { usize::MAX };
    let mut rows = Vec::new();
    for &value in family.values.iter().take(most) {
        let scene = (family.scene)(value);
        if scene.threads > cores {
            break;
        }
        let start = Instant::now();
        let pipeline = match scene.build(registry) {
            Ok(pipeline) => pipeline,
            // The largest scenes need more memory than some machines have.
            Err(Failure::Usage(why)) if !rows.is_empty() => {
                println!("  {value:>10}  not built: {why}");
                break;
            }
            Err(failure) => return Err(failure),
        };
        let build_s = start.elapsed().as_secs_f64();
        let statistics = pipeline.scene.accelerator.statistics();
        let statistic = |key: &str| statistics.get(key).copied().unwrap_or(f64::NAN);
        let options = RenderOptions {
            threads: scene.threads,
            ..RenderOptions::default()
        };
        let (mut times, mut rays, start) = (Vec::new(), 0, Instant::now());
        for _ in 0..arguments.rounds.max(1) {
            let begin = Instant::now();
            rays = pipeline.render(options).counters.total();
            times.push(begin.elapsed().as_secs_f64());
            if start.elapsed().as_secs_f64() > MAX_SECONDS {
                break;
            }
        }
        let row = Row {
            value,
            build_s,
            render_s: median(&mut times),
            rays: rays as f64,
            bytes: statistic("bytes"),
            steps: statistic("sah_cost"),
        };
        println!(
            "  {value:>10}  build {build_s:9.4} s  render {:9.4} s  {:>11} rays  {:7.1} ns a ray (steps by latency {:.1}, by arithmetic {:.1})",
            row.render_s,
            row.rays,
            row.ns_per_ray(),
            limits.latency_of(&row),
            limits.arithmetic_of(&row),
        );
        rows.push(row);
    }
    let fit = |of: &dyn Fn(&Row) -> f64| exponent(&rows, of);
    let exponents = json!({
        "build": fit(&|row| row.build_s), "render": fit(&|row| row.render_s),
        "rays": fit(&|row| row.rays), "ray": fit(&Row::ns_per_ray), "bytes": fit(&|row| row.bytes),
    });
    println!("  exponents: {exponents}");
    let rows: Vec<Value> = rows
        .iter()
        .map(|row| {
            json!({
                "value": row.value, "build_s": row.build_s, "render_s": row.render_s, "rays": row.rays,
                "bytes": row.bytes, "steps": row.steps, "ns_per_ray": row.ns_per_ray(),
                "latency_limit_ns": limits.latency_of(row), "arithmetic_limit_ns": limits.arithmetic_of(row),
                "bandwidth_limit_s": 1e-9 * row.bytes / limits.bandwidth,
            })
        })
        .collect();
    Ok(json!({
        "family": family.name, "parameter": family.parameter, "exponents": exponents, "rows": rows,
    }))
}

/// The slope of a line through the logarithms of the upper half of the rows, where fixed costs
/// matter least. `None` if there are fewer than two, or a quantity is 0.
fn exponent(rows: &[Row], of: &dyn Fn(&Row) -> f64) -> Option<f64> {
    let upper = &rows[(rows.len() / 2).min(rows.len().saturating_sub(2))..];
    let points: Vec<[f64; 2]> = upper.iter().map(|row| [row.value.ln(), of(row).ln()]).collect();
    let count = points.len() as f64;
    let mean = |axis: usize| points.iter().map(|point| point[axis]).sum::<f64>() / count;
    let middle = [mean(0), mean(1)];
    let sum = |a: usize, b: usize| {
        let terms = points
            .iter()
            .map(|point| (point[a] - middle[a]) * (point[b] - middle[b]));
        terms.sum::<f64>()
    };
    let slope = sum(0, 1) / sum(0, 0);
    slope.is_finite().then_some(slope)
}

/// What one thread of this machine can do at best.
struct Limits {
    /// Sizes of a working set in bytes, ascending, and the nanoseconds of a load that depends on
    /// the one before it.
    latency: Vec<(f64, f64)>,
    /// Gigabytes a second that are read in order.
    bandwidth: f64,
    /// Billions of additions and multiplications in double precision a second.
    arithmetic: f64,
}

impl Limits {
    fn measure() -> Self {
        let sizes = [15, 19, 23, 26, 30].map(|power| 1_usize << power);
        Self {
            latency: sizes
                .iter()
                .map(|bytes| (*bytes as f64, latency(*bytes)))
                .collect(),
            bandwidth: bandwidth(),
            arithmetic: arithmetic(),
        }
    }

    /// Nanoseconds of a ray whose steps each wait for memory.
    fn latency_of(&self, row: &Row) -> f64 {
        let fitting = self.latency.iter().find(|(bytes, _)| *bytes >= row.bytes);
        let (_, ns) = fitting.or(self.latency.last()).copied().unwrap_or_default();
        row.steps * ns
    }

    /// Nanoseconds of a ray whose steps only compute.
    fn arithmetic_of(&self, row: &Row) -> f64 {
        row.steps * OPERATIONS_PER_NODE / self.arithmetic
    }
}

/// Nanoseconds of each of a chain of loads, over lines of 64 bytes in random order.
fn latency(bytes: usize) -> f64 {
    const LINE: usize = 16;
    let lines = bytes / (4 * LINE);
    let mut next = vec![0_u32; lines * LINE];
    // Sattolo's algorithm: one cycle through all lines.
    let mut order: Vec<u32> = (0..lines as u32).collect();
    let mut state = 1_u64;
    for last in (1..lines).rev() {
        state = state
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        order.swap(last, (state >> 33) as usize % last);
    }
    for (line, to) in order.iter().enumerate() {
        next[line * LINE] = *to * LINE as u32;
    }
    let loads = 4_000_000;
    let mut times = Vec::new();
    for _ in 0..3 {
        let (start, mut at) = (Instant::now(), 0);
        for _ in 0..loads {
            at = next[at as usize];
        }
        black_box(at);
        times.push(start.elapsed().as_secs_f64());
    }
    1e9 * median(&mut times) / f64::from(loads)
}

/// Gigabytes a second of a sum over an array far larger than the caches.
fn bandwidth() -> f64 {
    let data = vec![1.0_f64; 1 << 27];
    let mut times = Vec::new();
    for _ in 0..5 {
        let start = Instant::now();
        black_box(simd::dispatch(
            #[inline(always)]
            || {
                let mut sums = [0.0; 64];
                for chunk in black_box(&data).chunks_exact(64) {
                    for (sum, value) in sums.iter_mut().zip(chunk) {
                        *sum += value;
                    }
                }
                sums
            },
        ));
        times.push(start.elapsed().as_secs_f64());
    }
    1e-9 * size_of_val(&*data) as f64 / median(&mut times)
}

/// Billions of operations a second of independent multiplications and additions.
fn arithmetic() -> f64 {
    const CHAINS: usize = 96;
    const STEPS: usize = 4_000_000;
    let mut times = Vec::new();
    for _ in 0..5 {
        let start = Instant::now();
        black_box(simd::dispatch(
            #[inline(always)]
            || {
                let (factor, offset) = black_box((0.999_999, 1e-6));
                let mut values = [1.0_f64; CHAINS];
                for _ in 0..STEPS {
                    for value in &mut values {
                        *value = *value * factor + offset;
                    }
                }
                values
            },
        ));
        times.push(start.elapsed().as_secs_f64());
    }
    1e-9 * (2 * CHAINS * STEPS) as f64 / median(&mut times)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rows(power: f64) -> Vec<Row> {
        [1.0, 10.0, 100.0, 1000.0]
            .map(|value: f64| Row {
                value,
                build_s: 1.0,
                render_s: value.powf(power),
                rays: value,
                bytes: 0.0,
                steps: 4.0,
            })
            .into()
    }

    #[test]
    fn exponents_are_those_of_powers() {
        for power in [0.0, 0.5, 1.0, 2.0] {
            let found = exponent(&rows(power), &|row| row.render_s).unwrap();
            assert!((found - power).abs() < 1e-12, "{found}");
        }
        assert_eq!(exponent(&rows(1.0), &|row| row.bytes), None);
        assert_eq!(exponent(&rows(1.0)[..1], &|row| row.rays), None);
        assert_eq!(exponent(&[], &|row| row.rays), None);
    }

    #[test]
    fn limits_take_the_memory_that_holds_the_structure() {
        let limits = Limits {
            latency: vec![(10.0, 1.0), (100.0, 5.0)],
            bandwidth: 1.0,
            arithmetic: 96.0,
        };
        let mut row = rows(1.0).remove(0);
        for (bytes, expected) in [(0.0, 4.0), (10.0, 4.0), (11.0, 20.0), (1e9, 20.0)] {
            row.bytes = bytes;
            assert_eq!(limits.latency_of(&row), expected);
        }
        assert_eq!(limits.arithmetic_of(&row), 4.0);
    }
}
