//! `bench shapes`: measures the time of every shape against its textbook form, and its error
//! against the oracle.

use super::machine::load;
use super::median;
use super::shapes_mitsuba::LiveMitsuba;
use crate::pages::between;
use clap::Args;
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::fmt::Write;
use std::hint::black_box;
use std::path::{Path, PathBuf};
use std::time::Instant;
use whitstone::core::triangle::ShearedRay;
use whitstone::core::{
    Aabb, DAffine3, DVec3, FamilyName, Geometry, Interval, LoweredShape, Ray, Registry, SelfHitFilter,
};
use whitstone::image::atomic;
use whitstone::{Exit, Failure};
use whitstone_oracle::agreement::{Agreement, Errors, MAX_ULPS, Subject};
use whitstone_oracle::cases::{CASES, Case};
use whitstone_testkit::{Aim, Random};

/// The page with the table.
const PAGE: &str = "docs/shapes.md";
const BEGIN: &str = "<!-- figures: written by `cargo xtask bench shapes --page` -->";
const END: &str = "<!-- end of figures -->";

/// Maximum ratio of a shape's time to that of the textbook form, unless there is a reason.
const MAX_TIMES: f64 = 2.0;

/// The reasons for ratios above [`MAX_TIMES`]; the files of the shapes name the sources.
const REASONS: [(&str, &str); 13] = [
    (
        "sphere",
        "the form of the discriminant is chosen for each ray, and both roots are computed in double precision without cancellation",
    ),
    ("triangle", WATERTIGHT),
    ("mesh", WATERTIGHT),
    ("heightfield", WATERTIGHT),
    ("ellipsoid", CONIC),
    ("cylinder", CONIC),
    ("cone", CONIC),
    ("paraboloid", CONIC),
    ("hyperboloid", CONIC),
    (
        "torus",
        "roots are bracketed between the turning points of the quartic, measured from the ray's nearest point, instead of computed by Ferrari's formula (see the last columns)",
    ),
    (
        "polygon",
        "edge functions have exact signs, so that a ray through a common edge of two polygons hits exactly one",
    ),
    (
        "csg",
        "the time of its operands, and spans carry their primitives",
    ),
    (
        "instance",
        "the time of its shapes, and an accelerator in between",
    ),
];

const WATERTIGHT: &str =
    "the test is watertight, in double precision, and the ray is sheared first; streams share the shear";
const CONIC: &str = "the ray is moved to its nearest point, and the discriminant is Kahan's; its fused products are function \
                     calls where the processor is not known, and streams compute them in registers";

/// Benchmark every shape against the textbook form in single precision, and compare both with the
/// oracle
///
/// Exit code 0 if no hit of Whitstone is wrong, 1 if one is.
#[derive(Args, Debug)]
#[command(
    help_template = whitstone::commands::HELP_TEMPLATE,
    after_help = "Examples:\n  taskset -c 0 cargo xtask bench shapes sphere torus\n  taskset -c 0 cargo xtask bench shapes --page"
)]
pub(super) struct Arguments {
    /// Types of shapes to run [default: all registered ones]
    #[arg(value_name = "SHAPE")]
    shapes: Vec<String>,
    /// Number of rays of each kind (hits and misses)
    #[arg(long, value_name = "COUNT", default_value_t = 4096)]
    rays: usize,
    /// Number of rays of each kind that the oracle checks
    #[arg(long, value_name = "COUNT", default_value_t = 1024)]
    checked: usize,
    /// Number of rounds; each times everything once
    #[arg(long, value_name = "COUNT", default_value_t = 15)]
    rounds: usize,
    /// Write the results to this file as JSON
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    /// Write the table into docs/shapes.md, between its marker comments
    #[arg(long)]
    page: bool,
}

/// A ray in both precisions, with equal values.
struct Both {
    ray: Ray,
    o: [f32; 3],
    d: [f32; 3],
}

impl Both {
    /// Normalised and rounded to single precision, so that every program can trace the same ray.
    fn new(ray: &Ray) -> Self {
        let [o, d] = [ray.origin, ray.direction.normalize()].map(|v| v.as_vec3().to_array());
        Self {
            ray: Ray::new(
                DVec3::from_array(o.map(f64::from)),
                DVec3::from_array(d.map(f64::from)),
            ),
            o,
            d,
        }
    }
}

/// One line of the table.
struct Row {
    shape: &'static str,
    hit: bool,
    rays: usize,
    ns: f64,
    ns_textbook: f64,
    ours: Agreement,
    textbook: Errors,
    /// The errors of Mitsuba, or why there are none.
    mitsuba: Result<Errors, &'static str>,
}

impl Row {
    fn times(&self) -> f64 {
        self.ns / self.ns_textbook
    }

    fn reason(&self) -> Option<&'static str> {
        let reason = REASONS.iter().find(|(shape, _)| *shape == self.shape);
        (self.times() > MAX_TIMES).then(|| reason.map_or("no reason is known", |(_, why)| why))
    }

    fn json(&self) -> Value {
        json!({
            "shape": self.shape,
            "case": if self.hit { "hit" } else { "miss" },
            "rays": self.rays,
            "ns_per_ray": self.ns,
            "ns_textbook_f32": self.ns_textbook,
            "reason": self.reason(),
            "max_error_ulp": self.hit.then_some(self.ours.most_ulps),
            "max_error_ulp_by_condition": self.hit.then_some(self.ours.most_ulps_by_condition),
            "wrong": self.ours.wrong,
            "ill_posed": self.ours.ill_posed,
            "unknown": self.ours.unknown,
            "textbook_f32_wrong_class": self.textbook.wrong_class,
            "textbook_f32_max_error_ulp": self.hit.then_some(self.textbook.most_ulps),
            "mitsuba_max_error_ulp": self.mitsuba.ok().filter(|_| self.hit).map(|errors| errors.most_ulps),
            "mitsuba_wrong_class": self.mitsuba.ok().map(|errors| errors.wrong_class),
            "why": self.mitsuba.err(),
        })
    }
}

/// Runs the command.
pub(super) fn run(arguments: &Arguments, registry: &Registry) -> Result<Exit, Failure> {
    let entries = registry
        .entries()
        .filter(|entry| entry.family == FamilyName::Shape);
    let known: Vec<&str> = entries.map(|entry| entry.name).collect();
    if let Some(unknown) = arguments
        .shapes
        .iter()
        .find(|name| !known.contains(&name.as_str()))
    {
        return Err(Failure::usage(format!(
            "unknown shape \"{unknown}\"; `cargo xtask list shapes` lists all"
        )));
    }
    let mitsuba = LiveMitsuba::start()?;
    let (mut rows, mut unmeasured) = (Vec::new(), BTreeMap::new());
    for shape in known {
        if !arguments.shapes.is_empty() && !arguments.shapes.iter().any(|name| name == shape) {
            continue;
        }
        match CASES.iter().find(|case| case.shape == shape) {
            Some(case) => rows.extend(measure(case, arguments, registry, &mitsuba)?),
            None => {
                unmeasured.insert(shape, "the oracle does not support it yet");
            }
        }
    }
    let table = table(&rows, &unmeasured);
    println!("{table}");
    println!(
        "wall-clock time on one thread, {} rounds; load {:.1}",
        arguments.rounds,
        load()
    );
    if arguments.page {
        between(PAGE, [BEGIN, END], &table)?;
    }
    if let Some(path) = &arguments.json {
        let mut lines: Vec<Value> = rows.iter().map(Row::json).collect();
        lines.extend(
            unmeasured
                .iter()
                .map(|(shape, why)| json!({ "shape": shape, "why": why })),
        );
        let report = json!({ "rounds": arguments.rounds, "load": load(), "rows": lines });
        atomic::write_bytes(path, format!("{report:#}\n").as_bytes()).map_err(Failure::environment)?;
    }
    let wrong: u64 = rows.iter().map(|row| row.ours.wrong).sum();
    Ok(mitsuba.end(if wrong == 0 { Exit::Pass } else { Exit::Differs }))
}

fn measure(
    case: &Case,
    arguments: &Arguments,
    registry: &Registry,
    mitsuba: &LiveMitsuba,
) -> Result<[Row; 2], Failure> {
    let scene = case.scene(&DAffine3::IDENTITY);
    let subject = Subject::new(&scene, Path::new("scenes"), registry).map_err(Failure::usage)?;
    let geometry = &*subject.pipeline.scene.geometry;
    let elements = geometry.elements().map(|element| geometry.bounds(element));
    let bounds = elements.fold(Aabb::EMPTY, Aabb::union);
    let kinds = rays_of(geometry, &bounds, arguments.rays);
    let textbook = &*subject.textbook_f32;
    let mut times = [const { [const { Vec::new() }; 2] }; 2];
    for round in 0..=arguments.rounds {
        for (kind, rays) in kinds.iter().enumerate() {
            let ours = per_ray(rays, |both| intersect(geometry, &both.ray).is_some());
            let theirs = per_ray(rays, |both| textbook.intersect(both.o, both.d).is_some());
            // The first round is a warm-up.
            if round > 0 {
                times[kind][0].push(ours);
                times[kind][1].push(theirs);
            }
        }
    }
    let [hits, misses] = kinds;
    let row = |hit: bool, rays: &[Both], times: &mut [Vec<f64>; 2]| {
        let (mut ours, mut theirs) = (Agreement::default(), Errors::default());
        let checked = &rays[..arguments.checked.min(rays.len())];
        for both in checked {
            ours.add(
                &subject.oracle,
                &both.ray,
                intersect(geometry, &both.ray),
                &bounds,
            );
            let found = textbook.intersect(both.o, both.d).map(f64::from);
            theirs.add(&subject.oracle.nearest(&both.ray, Interval::FORWARD), found);
        }
        let checked: Vec<Ray> = checked.iter().map(|both| both.ray).collect();
        let [ns, ns_textbook] = times.each_mut().map(|times| median(times));
        Row {
            shape: case.shape,
            hit,
            rays: rays.len(),
            ns,
            ns_textbook,
            ours,
            textbook: theirs,
            mitsuba: mitsuba.errors(&scene, &subject.oracle, &checked),
        }
    };
    let [hit_times, miss_times] = &mut times;
    Ok([row(true, &hits, hit_times), row(false, &misses, miss_times)])
}

/// Rays that hit and rays that miss, aimed as in the property tests of shapes.
fn rays_of(geometry: &Geometry, bounds: &Aabb, count: usize) -> [Vec<Both>; 2] {
    let aim = Aim::at(*bounds);
    let mut random = Random::new(11);
    let mut kinds = [Vec::new(), Vec::new()];
    // A shape that almost every ray hits, or misses, has fewer rays of the other kind.
    for number in 0..64 * count as u32 {
        let both = Both::new(&aim.ray(number, &mut random));
        let kind = &mut kinds[usize::from(intersect(geometry, &both.ray).is_none())];
        if kind.len() < count {
            kind.push(both);
        }
        if kinds.iter().all(|kind| kind.len() == count) {
            break;
        }
    }
    kinds
}

/// The nearest hit, by the scalar code, without an accelerator.
fn intersect(geometry: &Geometry, ray: &Ray) -> Option<f64> {
    match &geometry.shapes()[0] {
        LoweredShape::Custom(primitive) => primitive.intersect(ray, Interval::FORWARD, None).map(|hit| hit.t),
        LoweredShape::Triangles(mesh) => {
            let sheared = ShearedRay::new(ray);
            let all = 0..mesh.triangles.len() as u32;
            let hits = all.filter_map(|triangle| mesh.intersect(&sheared, triangle));
            let ahead = hits.map(|hit| hit.t).filter(|t| *t > 0.0);
            ahead.reduce(f64::min)
        }
        LoweredShape::Instance(instance) => {
            let hit = instance.intersect(ray, Interval::FORWARD, SelfHitFilter::NOTHING);
            hit.map(|hit| hit.t)
        }
        _ => None,
    }
}

/// Nanoseconds per ray.
fn per_ray(rays: &[Both], hits: impl Fn(&Both) -> bool) -> f64 {
    let start = Instant::now();
    let count = rays.iter().filter(|both| hits(black_box(both))).count();
    black_box(count);
    start.elapsed().as_secs_f64() * 1e9 / rays.len() as f64
}

fn table(rows: &[Row], unmeasured: &BTreeMap<&str, &str>) -> String {
    let mut text = String::from(
        "| shape | rays | ns | textbook f32, ns | times | error, ulp | by condition | wrong | ill-posed | unknown | textbook f32: wrong class | error, ulp | Mitsuba: wrong class | error, ulp |\n\
         |---|---|---|---|---|---|---|---|---|---|---|---|---|---|\n",
    );
    for row in rows {
        let _ = writeln!(
            text,
            "| {} | {} {} | {:.0} | {:.0} | {:.1} | {} | {} | {} | {} | {} | {} of {} | {} | {} | {} |",
            row.shape,
            row.rays,
            if row.hit { "hit" } else { "miss" },
            row.ns,
            row.ns_textbook,
            row.times(),
            of_hits(row, format!("{:.1}", row.ours.most_ulps)),
            of_hits(row, format!("{:.2}", row.ours.most_ulps_by_condition)),
            row.ours.wrong,
            row.ours.ill_posed,
            row.ours.unknown,
            row.textbook.wrong_class,
            row.textbook.rays,
            of_hits(row, format!("{:.0e}", row.textbook.most_ulps)),
            row.mitsuba.map_or("–".to_owned(), |errors| format!(
                "{} of {}",
                errors.wrong_class, errors.rays
            )),
            row.mitsuba.map_or("–".to_owned(), |errors| of_hits(
                row,
                format!("{:.0e}", errors.most_ulps)
            )),
        );
    }
    let mut reported = Vec::new();
    for row in rows {
        if let Some(reason) = row.reason().filter(|_| !reported.contains(&row.shape)) {
            reported.push(row.shape);
            let _ = write!(
                text,
                "\n- {}: more than {MAX_TIMES} times the textbook form: {reason}.",
                row.shape
            );
        }
    }
    for (shape, why) in unmeasured {
        let _ = write!(text, "\n- {shape}: not measured: {why}.");
    }
    let _ = write!(
        text,
        "\n\nA hit is wrong if its class is wrong, or if t is off by more than {MAX_ULPS} ulp times the condition, also for every slightly displaced ray."
    );
    text
}

/// A figure that only rows of hits have; a dash in rows of misses.
fn of_hits(row: &Row, figure: String) -> String {
    if row.hit { figure } else { "–".to_owned() }
}
