//! `oracle`: measures for how many pixels of each scene the oracle has a certain value, and its
//! time.

use crate::pages::between;
use clap::Args;
use serde_json::{Value as Json, json};
use std::collections::BTreeMap;
use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};
use whitstone::core::Registry;
use whitstone::image::atomic;
use whitstone::metrics::Tolerance;
use whitstone::scene::{Description, Plan, Sources};
use whitstone::validate::find_scenes;
use whitstone::{Exit, Failure};
use whitstone_oracle::tracer::{Care, Tracer, Value};

/// The page with the table.
const PAGE: &str = "docs/oracle.md";
const BEGIN: &str = "<!-- figures: written by `cargo xtask oracle --page` -->";
const END: &str = "<!-- end of figures -->";

/// Minimum fraction of the pixels that the oracle must decide, unless the scene is an exception.
const LEAST_DECIDED: f64 = 0.95;

/// A ray must be answered within this time, with certainty or not.
const LONGEST_RAY: f64 = 1.0;

/// Scenes in which it decides fewer pixels, and why. A timeout on a busy machine is not a reason.
const EXCEPTIONS: [(&str, &str); 5] = [
    ("community/mitsuba_dielectrics", TOUCH),
    ("community/nasty_doubled_faces", DOUBLED),
    ("community/pbrt_transparent_machines", TOUCH),
    ("community/pov_chain", TOUCH),
    ("showcase/gear", TOUCH),
];

const TOUCH: &str = "rays that touch a surface or an edge, or hit two coincident surfaces \
                     whose order the model does not define";
const DOUBLED: &str =
    "the mesh contains every face twice; the pixel depends on which of two equal faces is hit";

/// Measure for how many pixels of each scene the oracle has a certain value, and its time
///
/// The pixels are evenly spaced.
/// A pixel is decided if the oracle's value is certain to within the tolerance of `validate`. Exit
/// code 1 if it decides less than 95 % of the pixels of a scene that is not a known exception, if a
/// known exception reaches 95 %, or if a ray takes more than a second.
#[derive(Args, Debug)]
#[command(
    help_template = whitstone::commands::HELP_TEMPLATE,
    after_help = "Examples:\n  cargo xtask oracle\n  cargo xtask oracle scenes/showcase/room.toml --budget 300"
)]
pub(crate) struct Arguments {
    /// Scene files (TOML), or folders of them
    #[arg(default_values = ["scenes", "scenes/community"], value_name = "SCENE")]
    scenes: Vec<PathBuf>,
    /// Number of pixels of each scene
    #[arg(long, default_value_t = 200, value_name = "COUNT")]
    pixels: usize,
    /// Wall time limit for each scene, in seconds
    #[arg(long, default_value_t = 60, value_name = "SECONDS")]
    budget: u64,
    /// Number of threads
    #[arg(long, default_value_t = 2, value_name = "COUNT")]
    threads: usize,
    /// Write the results to this file as JSON
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    /// Write the table into docs/oracle.md, between its marker comments
    #[arg(long)]
    page: bool,
}

/// Steps of the additive recurrence R2 (Roberts 2018), which is even in two dimensions: 1/g and
/// 1/g^2 with g^3 = g + 1.
const STEPS: [f64; 2] = [0.754_877_666_246_692_7, 0.569_840_290_998_053_2];

/// The oracle's answers about a scene.
struct Row {
    name: String,
    asked: usize,
    /// Pixels whose value is certain.
    decided: usize,
    /// Pixels that take several values under rounding.
    ill_posed: usize,
    /// Pixels without a value, by reason.
    unknown: BTreeMap<String, usize>,
    seconds: f64,
    /// Time of the slowest pixel in seconds.
    slowest: f64,
    /// Time of the slowest ray in seconds.
    slowest_ray: f64,
}

impl Row {
    fn is_enough(&self) -> bool {
        self.decided as f64 >= LEAST_DECIDED * self.asked as f64
    }

    fn unknown(&self) -> usize {
        self.unknown.values().sum()
    }

    fn reason(&self) -> &str {
        let most = self.unknown.iter().max_by_key(|(_, count)| **count);
        most.map_or("", |(reason, _)| reason)
    }

    fn exception(&self) -> Option<&'static str> {
        let found = EXCEPTIONS.iter().find(|(name, _)| *name == self.name);
        found.map(|(_, reason)| *reason)
    }

    fn json(&self) -> Json {
        json!({
            "scene": self.name,
            "asked": self.asked,
            "decided": self.decided,
            "ill_posed": self.ill_posed,
            "unknown": self.unknown,
            "seconds": self.seconds,
            "slowest_pixel_s": self.slowest,
            "slowest_ray_s": self.slowest_ray,
            "exception": self.exception(),
        })
    }
}

/// Runs the command.
pub(crate) fn run(arguments: &Arguments, registry: &Registry) -> Result<Exit, Failure> {
    let paths = find_scenes(&arguments.scenes).map_err(Failure::usage)?;
    let width = paths.iter().map(|path| name(path).len()).max().unwrap_or(0);
    println!(
        "{:width$}  decided  ill-posed  unknown  seconds  slowest      ray  most frequent reason",
        "scene"
    );
    let mut rows = Vec::new();
    for path in paths {
        let row = query(&path, arguments, registry)?;
        println!(
            "{:width$}  {:>7}  {:>9}  {:>7}  {:>7.1}  {:>7.2}  {:>7.2}  {}",
            row.name,
            row.decided,
            row.ill_posed,
            row.unknown(),
            row.seconds,
            row.slowest,
            row.slowest_ray,
            row.reason()
        );
        rows.push(row);
    }
    let below = rows.iter().filter(|row| !row.is_enough()).count();
    println!("{} of {} scenes are below 95 % decided", below, rows.len());
    if let Some(path) = &arguments.json {
        let text = serde_json::to_vec_pretty(&rows.iter().map(Row::json).collect::<Vec<_>>());
        let text = text.map_err(Failure::environment)?;
        atomic::write_bytes(path, &text).map_err(Failure::environment)?;
    }
    if arguments.page {
        write_page(&rows)?;
    }
    let mut problems = Vec::new();
    for row in &rows {
        if row.slowest_ray > LONGEST_RAY {
            problems.push(format!(
                "{}: a ray takes {:.1} s, more than {LONGEST_RAY} s",
                row.name, row.slowest_ray
            ));
        }
        match (row.is_enough(), row.exception()) {
            (false, None) => problems.push(format!(
                "{}: the oracle decides {} of {} pixels, less than 95 %, and the scene is not in `EXCEPTIONS`",
                row.name, row.decided, row.asked
            )),
            (true, Some(_)) => problems.push(format!("{}: the oracle decides at least 95 %; remove the scene from `EXCEPTIONS`", row.name)),
            _ => {}
        }
    }
    crate::verdict(
        &problems,
        "oracle: all scenes that are not exceptions are decided",
    )
}

fn name(path: &Path) -> String {
    let path = path.strip_prefix("scenes").unwrap_or(path).with_extension("");
    path.display().to_string().replace('\\', "/")
}

fn query(path: &Path, arguments: &Arguments, registry: &Registry) -> Result<Row, Failure> {
    let sources = Sources::load(path, &[], registry)
        .map_err(|error| Failure::usage(error.sources.report(&error.errors, false)))?;
    let description = Description::parse(&sources).into_result();
    let description = description.map_err(|errors| Failure::usage(sources.report(&errors, false)))?;
    Plan::new(&description, registry)
        .into_result()
        .map_err(|errors| Failure::usage(sources.report(&errors, false)))?;
    let start = Instant::now();
    let deadline = start + Duration::from_secs(arguments.budget);
    let size = description.film.size;
    let all = size.width as usize * size.height as usize;
    let asked = arguments.pixels.min(all);
    let mut row = Row {
        name: name(path),
        asked,
        decided: 0,
        ill_posed: 0,
        unknown: BTreeMap::new(),
        seconds: 0.0,
        slowest: 0.0,
        slowest_ray: 0.0,
    };
    let tracer = match Tracer::new(&description) {
        Ok(tracer) => tracer,
        Err(errors) => {
            let why = errors.0.first().map(|error| error.message.clone());
            row.unknown.insert(why.unwrap_or_default(), asked);
            return Ok(row);
        }
    };
    let pixel = |number: usize| {
        let [x, y] = STEPS.map(|step| (0.5 + number as f64 * step).fract());
        [x * f64::from(size.width), y * f64::from(size.height)].map(|part| part as u32)
    };
    let next = AtomicUsize::new(0);
    let answers = Mutex::new(Vec::new());
    std::thread::scope(|scope| -> std::io::Result<()> {
        for _ in 0..arguments.threads.max(1) {
            std::thread::Builder::new().spawn_scoped(scope, || {
                loop {
                    let number = next.fetch_add(1, Ordering::Relaxed);
                    if number >= asked {
                        return;
                    }
                    let begun = Instant::now();
                    let value = tracer.pixel_before(pixel(number), Care::USUAL, deadline);
                    let mut answers = answers.lock().unwrap_or_else(PoisonError::into_inner);
                    answers.push((value, begun.elapsed().as_secs_f64()));
                }
            })?;
        }
        Ok(())
    })
    .map_err(Failure::environment)?;
    row.seconds = start.elapsed().as_secs_f64();
    row.slowest_ray = tracer.slowest_ray().as_secs_f64();
    let answers = answers.into_inner().unwrap_or_else(PoisonError::into_inner);
    let mut sum = 0.0;
    let mut known = Vec::new();
    for (value, seconds) in answers {
        row.slowest = row.slowest.max(seconds);
        match value {
            Value::Known { rgb, uncertainty, .. } => {
                sum += rgb.iter().map(|v| v.abs()).sum::<f64>() / 3.0;
                known.push((rgb, uncertainty));
            }
            Value::Unknown(why) => *row.unknown.entry(why).or_default() += 1,
        }
    }
    // The tolerance of `validate`, with the mean of these pixels instead of that of the image.
    let Tolerance { relative, absolute } = Tolerance::default();
    let mean = sum / known.len().max(1) as f64;
    row.decided = (known.iter())
        .filter(|(rgb, uncertainty)| {
            (0..3).all(|c| uncertainty[c] <= relative * rgb[c].abs() + absolute * mean)
        })
        .count();
    row.ill_posed = known.len() - row.decided;
    Ok(row)
}

/// Writes the scenes below the limit and the slowest of the others between the markers of the page.
fn write_page(rows: &[Row]) -> Result<(), Failure> {
    let mut table = String::from(
        "| scene | decided | ill-posed | unknown | seconds | reason |\n|---|---:|---:|---:|---:|---|\n",
    );
    let mut shown: Vec<&Row> = rows.iter().collect();
    shown.sort_by(|a, b| b.seconds.total_cmp(&a.seconds));
    let enough = rows.iter().filter(|row| row.is_enough()).count();
    for row in shown.iter().filter(|row| !row.is_enough()) {
        let (name, reason) = (&row.name, row.exception().unwrap_or(row.reason()));
        let _ = writeln!(
            table,
            "| {name} | {} of {} | {} | {} | {:.0} | {reason} |",
            row.decided,
            row.asked,
            row.ill_posed,
            row.unknown(),
            row.seconds
        );
    }
    let decided: Vec<&&Row> = shown.iter().filter(|row| row.is_enough()).collect();
    let times: Vec<f64> = decided.iter().map(|row| row.seconds).collect();
    let median = times.get(times.len() / 2).copied().unwrap_or(0.0);
    let slowest: Vec<String> = (decided.iter().take(5))
        .map(|row| format!("{} {:.0} s", row.name, row.seconds))
        .collect();
    let ray = rows.iter().max_by(|a, b| a.slowest_ray.total_cmp(&b.slowest_ray));
    let ray = ray.map_or((0.0, ""), |row| (row.slowest_ray, row.name.as_str()));
    let text = format!(
        "It decides at least 95 % of the pixels of {enough} of {} scenes, in {median:.1} s in the median.\n\
         The slowest of these: {}.\nThe slowest ray of all scenes takes {:.2} s (in {}).\n\nThe others:\n\n{table}",
        rows.len(),
        slowest.join(", "),
        ray.0,
        ray.1
    );
    between(PAGE, [BEGIN, END], &text)
}
