//! `bench accelerators`: rays per second of every accelerator, compared with Embree in the same
//! run.

use super::backend::{self, Backend};
use super::chart;
use super::choice::{Choice, build};
use super::data;
use super::fetch;
use super::machine::{date, load, processor, processor_time};
use super::median;
use super::prepare::prepare;
use super::rays::{Difference, Mode, Rays};
use clap::Args;
use serde_json::{Value, json};
use std::path::PathBuf;
use std::sync::Arc;
use whitstone::core::simd::Level;
use whitstone::core::{Accelerator, Element, FamilyName, Geometry, LoweredShape, Registry};
use whitstone::{Exit, Failure};

/// Benchmark accelerators on three meshes with three sets of rays each, interleaved with Embree
///
/// Everything runs on one thread and is measured in processor time. Pin it to one core
/// (`taskset -c 0`) for stable results.
///
/// Exit code 1 if an accelerator in double precision disagrees with `bvh2` in any bit, else 0.
#[derive(Args, Debug)]
#[command(
    help_template = whitstone::commands::HELP_TEMPLATE,
    after_help = "Examples:\n  taskset -c 0 cargo xtask bench accelerators --quick\n  taskset -c 0 cargo xtask bench accelerators --fetch --accelerator bvh:best --json bench.json"
)]
pub(crate) struct Arguments {
    #[command(flatten)]
    folder: fetch::Folder,
    /// Accelerator to run: TYPE or TYPE:QUALITY; can be repeated. Third-party backends are
    /// available if they are built in [default: bvh in three qualities, bvh2, and the backends]
    #[arg(long = "accelerator", value_name = "NAME")]
    accelerators: Vec<String>,
    /// Mesh: a name in the data folder, or a PLY or OBJ file; can be repeated [default: the public
    /// meshes in the data folder, or else generated ones]
    #[arg(long = "mesh", value_name = "PATH")]
    meshes: Vec<String>,
    /// Set of rays; can be repeated
    #[arg(long = "set", value_name = "SET", default_values = ["primary", "shadow", "bounce"])]
    sets: Vec<String>,
    /// Number of rounds; each times every accelerator once
    #[arg(long, value_name = "COUNT", default_value_t = 5)]
    rounds: usize,
    /// Use one in eight rays and three rounds; takes less than a minute
    #[arg(long)]
    quick: bool,
    /// Write the results to this file as JSON
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    /// Plot the ratios to Embree, or the rates without it, into this SVG file
    #[arg(long, value_name = "FILE")]
    svg: Option<PathBuf>,
}

/// The default accelerators, as far as they are built in.
const ALL: [&str; 6] = [
    "bvh:fast",
    "bvh:balanced",
    "bvh:best",
    "bvh2",
    "embree:high",
    "obvhs:very_slow",
];

/// Builds that take longer than this, in seconds, run only once with `--quick`. Others run at least
/// three times, and until their total time reaches this, because a process and its memory are slow
/// at first. The Embree program does the same.
const LONG_BUILD: f64 = 0.25;

/// A size in bytes just below the largest block whose release makes the GNU C library keep twice as
/// much memory (`M_TRIM_THRESHOLD` of mallopt(3)).
const KEPT_MEMORY: usize = 31 << 20;

/// The quality of the Embree build against which rays are compared.
const EMBREE_QUALITY: &str = "HIGH";

/// An accelerator over a mesh.
struct Built<'a> {
    choice: &'a Choice,
    accelerator: Box<dyn Accelerator>,
    build_seconds: f64,
    bytes_per_triangle: f64,
}

/// Runs the command.
pub(crate) fn run(arguments: &Arguments, registry: &Registry) -> Result<Exit, Failure> {
    // Builds use one thread too, like those of the compared renderer.
    rayon::ThreadPoolBuilder::new()
        .num_threads(1)
        .build_global()
        .map_err(Failure::environment)?;
    // Until a large block has been freed, the C library returns memory to the system after each
    // build, and the next one pays for fresh pages. Embree keeps its memory between builds, and the
    // benchmark compares builds, not page faults.
    drop(std::hint::black_box(vec![1u8; KEPT_MEMORY]));
    let bench = Bench::new(arguments, registry)?;
    let mut rows = Vec::new();
    let mut version = Value::Null;
    for mesh in prepare(&bench.folder, &arguments.meshes, registry).map_err(Failure::environment)? {
        rows.extend(bench.mesh(&mesh, &mut version).map_err(Failure::environment)?);
    }
    let summary = summarise(&rows, version);
    println!("{}", chart::table(&rows));
    println!("{summary:#}");
    if let Some(path) = &arguments.svg {
        let picture = chart::bars(&rows);
        whitstone::image::atomic::write_bytes(path, picture.as_bytes()).map_err(Failure::environment)?;
    }
    if let Some(path) = &arguments.json {
        let result = json!({
            "processor": processor(), "simd": Level::current().to_string(), "date": date(), "load": load(),
            "rounds": bench.rounds, "rows": rows, "summary": summary,
        });
        let text = format!("{result:#}\n");
        whitstone::image::atomic::write_bytes(path, text.as_bytes()).map_err(Failure::environment)?;
    }
    // Accelerators in single precision differ; their differences are shown but do not fail.
    let judged = rows.iter().filter(|row| row["exact"] == true);
    let mismatches: u64 = judged.filter_map(|row| row["mismatches"].as_u64()).sum();
    Ok(if mismatches == 0 {
        Exit::Pass
    } else {
        Exit::Differs
    })
}

struct Bench<'a> {
    arguments: &'a Arguments,
    registry: &'a Registry,
    folder: PathBuf,
    choices: Vec<Choice>,
    backend: Option<PathBuf>,
    rounds: usize,
    stride: usize,
}

impl<'a> Bench<'a> {
    fn new(arguments: &'a Arguments, registry: &'a Registry) -> Result<Self, Failure> {
        let folder = arguments.folder.ensure().map_err(Failure::environment)?;
        let backend = backend::compile(&folder);
        if let Err(why) = &backend {
            eprintln!("Embree is not available: {why}");
        }
        let mut choices: Vec<Choice> = arguments
            .accelerators
            .iter()
            .map(|name| Choice::parse(name))
            .collect();
        if choices.is_empty() {
            choices.extend(ALL.map(Choice::parse));
            choices.retain(|choice| registry.get(FamilyName::Accelerator, &choice.kind).is_ok());
        }
        Ok(Self {
            arguments,
            registry,
            folder,
            choices,
            backend: backend.ok(),
            rounds: if arguments.quick {
                3
            } else {
                arguments.rounds.max(1)
            },
            stride: if arguments.quick { 8 } else { 1 },
        })
    }

    /// Benchmarks all sets of one mesh.
    fn mesh(&self, name: &str, version: &mut Value) -> Result<Vec<Value>, String> {
        let mesh = data::mesh(&self.folder.join(format!("{name}.tri")))?;
        let triangles = mesh.triangles.len();
        println!("\n{name}: {triangles} triangles");
        let geometry = Arc::new(Geometry::new(vec![LoweredShape::Triangles(mesh)]));
        let built = self
            .choices
            .iter()
            .map(|choice| self.build(choice, &geometry))
            .collect::<Result<Vec<_>, String>>()?;
        let truth = build(self.registry, &Choice::parse("bvh2"), &geometry)?;
        for one in &built {
            println!(
                "  {:28} build {:8.4} s  {:6.1} bytes per triangle",
                one.choice.label(),
                one.build_seconds,
                one.bytes_per_triangle
            );
        }
        let mut backend = None;
        if let Some(program) = &self.backend {
            for quality in ["LOW", "MEDIUM", EMBREE_QUALITY] {
                let started = Backend::start(program, &self.folder, name, quality)?;
                println!(
                    "  {:28} build {:8.4} s  {:6.1} bytes per triangle",
                    format!("embree {quality}"),
                    started.build_seconds,
                    started.bytes / triangles as f64
                );
                *version = json!(started.version);
                backend = Some(started);
            }
        }
        let mut rows = Vec::new();
        for set in &self.arguments.sets {
            let rays = Rays::read(&self.folder.join(format!("{name}_{set}.rays")), self.stride, set)?;
            let figures = self.set(set, &rays, &built, &*truth, backend.as_mut())?;
            for (row, figures) in figures.iter().enumerate() {
                let (one, mode) = (
                    &built[row / Mode::ALL.len()],
                    Mode::ALL[row % Mode::ALL.len()].name(),
                );
                let rate = rays.len() as f64 / figures.seconds / 1e6;
                let ratio = figures
                    .ratio
                    .map_or("    -".to_owned(), |ratio| format!("{ratio:5.3}"));
                let exact = one.accelerator.approximation_note().is_none();
                let difference = &figures.difference;
                let differ = if exact {
                    format!("{} of {} differ", difference.mismatches, rays.len())
                } else {
                    format!(
                        "{} of {} hit another triangle; t differs by up to {:.1e}",
                        difference.others,
                        rays.len(),
                        difference.distance
                    )
                };
                println!(
                    "  {set:8} {:28} {mode:6} {rate:7.3} Mrays/s  {ratio} times Embree  {differ}",
                    one.choice.label()
                );
                rows.push(json!({
                    "accelerator": one.choice.kind, "quality": one.choice.quality, "mode": mode, "mesh": name,
                    "set": set, "rays": rays.len(), "mrays_per_s": rate, "ratio_to_embree": figures.ratio,
                    "build_s": one.build_seconds, "bytes_per_triangle": one.bytes_per_triangle,
                    "mismatches": difference.mismatches, "others": difference.others,
                    "max_t_error": difference.distance, "exact": exact,
                }));
            }
        }
        Ok(rows)
    }

    fn build<'c>(&self, choice: &'c Choice, geometry: &Arc<Geometry>) -> Result<Built<'c>, String> {
        let mut seconds = f64::INFINITY;
        let mut accelerator = None;
        let (mut builds, mut together) = (0, 0.0);
        while builds < 3 || together < LONG_BUILD {
            drop(accelerator.take());
            let start = processor_time();
            accelerator = Some(build(self.registry, choice, geometry)?);
            let took = processor_time() - start;
            seconds = seconds.min(took);
            (builds, together) = (builds + 1, together + took);
            if self.arguments.quick && seconds > LONG_BUILD {
                break;
            }
        }
        let accelerator = accelerator.ok_or("nothing built")?;
        let triangles = geometry
            .elements()
            .filter(|e| matches!(e, Element::Triangle { .. }))
            .count();
        let bytes = accelerator.statistics().get("bytes").copied().unwrap_or(f64::NAN);
        Ok(Built {
            choice,
            accelerator,
            build_seconds: seconds,
            bytes_per_triangle: bytes / triangles as f64,
        })
    }

    /// Benchmarks one set of rays. Each round times each accelerator, in each mode, and Embree
    /// once. The modes of one accelerator are adjacent in the result.
    fn set(
        &self,
        set: &str,
        rays: &Rays,
        built: &[Built<'_>],
        truth: &dyn Accelerator,
        mut backend: Option<&mut Backend>,
    ) -> Result<Vec<Figures>, String> {
        let rows: Vec<(&Built<'_>, Mode)> = built
            .iter()
            .flat_map(|one| Mode::ALL.map(|mode| (one, mode)))
            .collect();
        let mut seconds = vec![Vec::new(); rows.len()];
        let mut ratios = vec![Vec::new(); rows.len()];
        for round in 0..=self.rounds {
            let theirs = match &mut backend {
                Some(backend) => Some(backend.trace(set, self.stride)?.0),
                None => None,
            };
            for (i, (one, mode)) in rows.iter().enumerate() {
                let start = processor_time();
                std::hint::black_box(rays.pass(&*one.accelerator, *mode));
                let ours = processor_time() - start;
                // The first round is a warm-up: it touches pages.
                if round > 0 {
                    seconds[i].push(ours);
                    ratios[i].extend(theirs.map(|theirs| theirs / ours));
                }
            }
        }
        let expected = rays.answers(truth, Mode::Single);
        let figures = rows.iter().enumerate().map(|(i, (one, mode))| Figures {
            seconds: median(&mut seconds[i]),
            ratio: (!ratios[i].is_empty()).then(|| median(&mut ratios[i])),
            difference: rays.difference(&*one.accelerator, *mode, &expected),
        });
        Ok(figures.collect())
    }
}

struct Figures {
    seconds: f64,
    ratio: Option<f64>,
    difference: Difference,
}

/// Geometric means over all cells of the ratios to Embree, by accelerator and quality.
fn summarise(rows: &[Value], version: Value) -> Value {
    let mut sums: Vec<(String, f64, usize)> = Vec::new();
    for row in rows {
        let Some(ratio) = row["ratio_to_embree"].as_f64() else {
            continue;
        };
        let text = |key: &str| row[key].as_str().unwrap_or_default().to_owned();
        let name = format!("{}:{} {}", text("accelerator"), text("quality"), text("mode"));
        match sums.iter_mut().find(|sum| sum.0 == name) {
            Some(sum) => (sum.1, sum.2) = (sum.1 + ratio.ln(), sum.2 + 1),
            None => sums.push((name, ratio.ln(), 1)),
        }
    }
    let means: Vec<Value> = sums
        .iter()
        .map(|(name, sum, count)| json!({ "name": name, "ratio": (sum / *count as f64).exp() }))
        .collect();
    let best = |mode: &str| {
        let wanted = format!("bvh:best {mode}");
        means
            .iter()
            .find(|mean| mean["name"] == wanted.as_str())
            .map(|mean| mean["ratio"].clone())
    };
    json!({
        "geomean_single": best("single"), "geomean_batch": best("batch"), "embree_version": version,
        "geomeans": means,
    })
}
