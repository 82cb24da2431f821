//! `stress`: parameter sweeps over ill-conditioned and extreme cases.

mod kernel;
#[cfg(feature = "cluster")]
mod parts;
mod search;
mod subject;
mod unfinished;

#[cfg(feature = "cluster")]
use super::cluster::Cluster;
use super::page::{self, Marks};
use super::report;
use super::{Drivers, Target};
use crate::terminal::{Exit, Failure, make_folder, progress, write_json};
use clap::Args;
use serde_json::json;
use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::time::Duration;
use unfinished::Unfinished;
use whitstone_core::Registry;
use whitstone_image::atomic;
use whitstone_stress::{
    ELSEWHERE, Engine, FAMILIES, Family, FamilyReport, Lab, Verdict, headline, plot, precision, price, table,
    triangles,
};
use whitstone_validate::driver::Driver;
use whitstone_validate::environment::Environment;
use whitstone_validate::report::Diagram;

/// Sweep parameters logarithmically to find the values at which renderers fail
///
/// Every family runs the same queries on Whitstone, on deliberately naive variants of its formulas,
/// on Mitsuba, and on Embree and obvhs where they are built in, and checks the answers against the
/// oracle or a closed form. The frontier is the first value of the parameter at which a renderer's
/// answers are unusable; "none" is best. The next `report` shows the diagrams.
///
/// With --subject, another renderer gets the families as scenes, from easy to hard, until a pixel
/// is wrong, and the oracle judges its images; families that no image shows are skipped, with the
/// reason: docs/subjects.md. Exit code 0 if no pixel is wrong, 1 if one is, 3 if the subject can
/// render none of them.
///
/// With --kernel, another program's ray-triangle kernel is judged instead: docs/subjects.md. Exit
/// code 0 if it has no holes and no wrong hits, 1 if it has, 3 if it cannot be run.
///
/// An interrupted run continues where it stopped if the same program repeats it with the same
/// settings.
///
/// Exit code 0 if Whitstone keeps its promised error bound in every family, fails no earlier than
/// Mitsuba and Embree, and at least one naive variant of each family fails; 1 if not. With
/// `--search`: 0 if no answer breaks the promise, else 1.
#[derive(Args, Debug)]
#[command(
    help_template = super::HELP_TEMPLATE,
    after_help = "Examples:\n  whitstone stress --quick\n  whitstone stress planet --steps\n  whitstone stress --search --seconds 600\n  whitstone stress planet --subject mytracer\n  whitstone stress --list\n  whitstone stress --rays 10000 --kernel python3 subjects/embreex_kernel.py"
)]
pub struct Arguments {
    /// Families of cases to run [default: all]
    #[arg(value_name = "FAMILY")]
    families: Vec<String>,
    /// Run 60 queries at each step
    #[arg(long, conflicts_with = "rays")]
    quick: bool,
    /// Number of queries at each step; "watertight" runs a hundred times as many, with every
    /// accelerator
    #[arg(long, default_value_t = 400, value_name = "COUNT", value_parser = clap::value_parser!(u32).range(1..=10_000_000))]
    rays: u32,
    /// Do not continue an interrupted run
    #[arg(long)]
    fresh: bool,
    /// List the families and exit
    #[arg(long)]
    list: bool,
    /// Print every step, not only the frontiers
    #[arg(long)]
    steps: bool,
    /// Instead of the steps, search for the worst case of each family: random values of its
    /// parameter and random rays, and small changes of the worst ones so far. Only Whitstone and
    /// the oracle take part
    #[arg(long, conflicts_with_all = ["steps", "json", "plots", "page", "rays"])]
    #[cfg_attr(feature = "cluster", arg(conflicts_with = "cluster"))]
    search: bool,
    /// Number of questions of a search, over all families
    #[arg(long, default_value_t = 100_000, value_name = "COUNT", requires = "search", value_parser = clap::value_parser!(u64).range(1..))]
    questions: u64,
    /// Search for this time instead, in seconds, divided evenly among the families
    #[arg(long, value_name = "SECONDS", requires = "search", conflicts_with = "questions", value_parser = clap::value_parser!(u64).range(1..))]
    seconds: Option<u64>,
    /// Seed of a search
    #[arg(long, default_value_t = 1, value_name = "NUMBER", requires = "search")]
    seed: u64,
    /// Do not run Mitsuba
    #[arg(long)]
    no_mitsuba: bool,
    /// Write all results to this file as JSON; - means standard output
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    /// Plot error against the parameter and against time into this folder, one file per family
    #[arg(long, value_name = "DIR")]
    plots: Option<PathBuf>,
    /// Write the table of frontiers into this Markdown file, between its marker comments; can be
    /// repeated
    #[arg(long, value_name = "FILE")]
    page: Vec<PathBuf>,
    #[cfg(feature = "cluster")]
    #[command(flatten)]
    cluster: Cluster,
    #[command(flatten)]
    target: Target,
    #[command(flatten)]
    drivers: Drivers,
    /// Judge the images of another renderer: the name of a table [subject.NAME], or NAME={...}
    #[arg(long, value_name = "NAME", conflicts_with_all = ["quick", "rays", "search", "steps", "plots", "page", "list", "kernel", "fresh"])]
    #[cfg_attr(feature = "cluster", arg(conflicts_with = "cluster"))]
    subject: Option<String>,
    /// File with the subject's table [default: whitstone.toml in this folder or one above it]
    #[arg(long, value_name = "FILE", requires = "subject")]
    config: Option<PathBuf>,
    /// Judge the kernel that this program and its arguments implement, which must come last
    #[arg(long, value_name = "PROGRAM", num_args = 1.., allow_hyphen_values = true, conflicts_with_all = ["families", "quick", "steps", "plots", "page", "list"])]
    #[cfg_attr(feature = "cluster", arg(conflicts_with = "cluster"))]
    kernel: Vec<OsString>,
    /// Time limit for one step of Mitsuba or one answer of a kernel, in seconds
    #[arg(long, default_value_t = 120, value_name = "SECONDS")]
    time_limit: u64,
}

impl Arguments {
    /// Makes this a part of another command, with its files in a folder; returns false if it would
    /// write other files or start other programs.
    #[cfg(feature = "cluster")]
    pub(super) fn be_part(&mut self, scratch: &Path, mitsuba: Option<&Path>) -> bool {
        self.target.be_part(scratch)
            && self.drivers.be_part(mitsuba)
            && self.plots.is_none()
            && self.page.is_empty()
            && self.kernel.is_empty()
            && self.subject.is_none()
            && self.cluster.cluster.is_none()
    }

    /// Number of queries at each step.
    fn rays(&self) -> u32 {
        if self.quick { 60 } else { self.rays }
    }
}

/// Runs the command.
pub fn run(arguments: &Arguments, registry: &Registry) -> Result<Exit, Failure> {
    if let [program, rest @ ..] = arguments.kernel.as_slice() {
        return kernel::run(arguments, registry, program, rest);
    }
    let families = chosen(&arguments.families)?;
    if arguments.list {
        for family in families {
            let about = family.about();
            println!("{:<20} {}; {}", about.name, about.parameter, about.measure);
        }
        for (number, what, file) in ELSEWHERE {
            println!("case {number:<15} {what}: {file}");
        }
        return Ok(Exit::Pass);
    }
    if let Some(name) = &arguments.subject {
        return subject::run(arguments, registry, &families, name);
    }
    if arguments.search {
        return search::run(arguments, &families, registry);
    }
    #[cfg(feature = "cluster")]
    let reports = match arguments.cluster.is_named() {
        true => parts::measure(arguments, &families, registry)?,
        false => measure(arguments, &families, registry)?,
    };
    #[cfg(not(feature = "cluster"))]
    let reports = measure(arguments, &families, registry)?;
    report::keep_stress(arguments.target.folder(), reports.iter().map(diagram).collect())?;
    if let Some(path) = &arguments.json {
        write_json(path, &json!({ "families": reports }))?;
    }
    if let Some(folder) = &arguments.plots {
        make_folder(folder)?;
        for report in &reports {
            let path = folder.join(format!("{}.svg", report.family));
            atomic::write_bytes(&path, plot::svg(report).as_bytes()).map_err(Failure::environment)?;
        }
    }
    for page in &arguments.page {
        write_page(page, &reports)?;
    }
    let theirs = triangles(&reports);
    if !theirs.is_empty() {
        println!("\nScenes of triangles:\n\n{theirs}");
    }
    let good = reports
        .iter()
        .filter(|report| report.verdict == Verdict::Pass)
        .count();
    println!("families: {}, pass: {good}", reports.len());
    Ok(if good == reports.len() {
        Exit::Pass
    } else {
        Exit::Differs
    })
}

/// The engines that the line of a family names; `--steps` adds the others.
const COLUMNS: [Engine; 5] = [
    Engine::Whitstone,
    Engine::Mitsuba,
    Engine::Embree,
    Engine::NaiveF64,
    Engine::NaiveF32,
];

/// The engines that the lines name, of those that the program includes.
fn columns(arguments: &Arguments, registry: &Registry) -> Vec<Engine> {
    let is_named = |engine: &Engine| arguments.steps || COLUMNS.contains(engine);
    Lab::engines_of(registry).filter(is_named).collect()
}

/// Measures families, and prints each result.
fn measure(
    arguments: &Arguments,
    families: &[&'static dyn Family],
    registry: &Registry,
) -> Result<Vec<FamilyReport>, Failure> {
    let mitsuba = match arguments.no_mitsuba {
        true => None,
        false => Some(mitsuba(arguments)?),
    };
    let rays = arguments.rays() as usize;
    let lab = Lab::new(registry, mitsuba, rays);
    let steps: usize = families.iter().map(|family| family.parameters().len()).sum();
    let bar = progress(steps as u64, "stress");
    let engines: Vec<Engine> = lab.engines().collect();
    let columns = columns(arguments, registry);
    let settings = format!("{rays} rays, {engines:?}, Mitsuba: {}", !arguments.no_mitsuba);
    let mut unfinished = Unfinished::new(arguments.target.folder(), &settings, arguments.fresh);
    let mut reports = Vec::new();
    for family in families {
        let name = family.about().name;
        if let Some(report) = unfinished.find(name) {
            bar.inc(report.parameters.len() as u64);
            bar.suspend(|| {
                print(report, &columns, arguments.steps, reports.is_empty());
                eprintln!("  {name}: result of an interrupted run; use --fresh to measure it again");
            });
            reports.push(report.clone());
            continue;
        }
        let report_step = |parameter: f64| {
            bar.set_message(format!("{name} at {parameter:.0e}"));
            bar.inc(1);
        };
        let report = FamilyReport::measure(*family, &lab, &report_step).map_err(Failure::environment)?;
        bar.suspend(|| print(&report, &columns, arguments.steps, reports.is_empty()));
        unfinished.add(report.clone())?;
        reports.push(report);
    }
    bar.finish_and_clear();
    unfinished.end();
    Ok(reports)
}

/// The diagram of a family for the report.
fn diagram(family: &FamilyReport) -> Diagram {
    Diagram {
        name: family.family.clone(),
        title: family.parameter.clone(),
        about: format!(
            "Error: {}; usable up to {:e}; promise: {}.",
            family.measure, family.usable_level, family.pass_level
        ),
        verdict: format!(
            "frontier: Whitstone {}, Mitsuba {}{}: {}",
            family.frontier(Engine::Whitstone),
            family.frontier(Engine::Mitsuba),
            if family.takes_part(Engine::Embree) {
                format!(", Embree {}", family.frontier(Engine::Embree))
            } else {
                String::new()
            },
            family.verdict
        ),
        svg: plot::svg(family),
    }
}

/// The marks around the parts of a page that are replaced: the table of all families, and the table
/// of those in which Mitsuba takes part.
const TABLE: Marks = [
    "<!-- frontiers: written by `cargo xtask stress --page` -->",
    "<!-- end of frontiers -->",
];
const HEADLINE: Marks = [
    "<!-- headline: written by `cargo xtask stress --page` -->",
    "<!-- end of headline -->",
];

/// That of the engines that intersect triangles.
const TRIANGLES: Marks = [
    "<!-- triangles: written by `cargo xtask stress --page` -->",
    "<!-- end of triangles -->",
];
/// Errors by precision.
const PRECISION: Marks = [
    "<!-- precision: written by `cargo xtask stress --page` -->",
    "<!-- end of precision -->",
];
const PRICE: Marks = [
    "<!-- price: written by `cargo xtask stress --page` -->",
    "<!-- end of price -->",
];

fn write_page(path: &Path, reports: &[FamilyReport]) -> Result<(), Failure> {
    let parts = [
        (TABLE, table(reports)),
        (HEADLINE, headline(reports)),
        (TRIANGLES, triangles(reports)),
        (PRECISION, precision(reports)),
        (PRICE, price(reports)),
    ];
    page::write(path, &parts)
}

fn chosen(names: &[String]) -> Result<Vec<&'static dyn Family>, Failure> {
    if names.is_empty() {
        return Ok(FAMILIES.to_vec());
    }
    let unknown = |name: &String| {
        Failure::usage(format!(
            "unknown family \"{name}\"; `whitstone stress --list` lists all families"
        ))
    };
    let mut chosen = Vec::new();
    for name in names {
        let family = FAMILIES.iter().find(|family| family.about().name == name);
        chosen.push(*family.ok_or_else(|| unknown(name))?);
    }
    Ok(chosen)
}

fn mitsuba(arguments: &Arguments) -> Result<Driver, Failure> {
    let environment = Environment::ensure(&arguments.drivers.installation(&arguments.target), &|what| {
        eprintln!("{what}")
    });
    let environment = environment
        .map_err(|error| Failure::environment(format!("{error}; use --no-mitsuba to run without Mitsuba")))?;
    Driver::start(&environment, Duration::from_secs(arguments.time_limit)).map_err(Failure::environment)
}

fn print(report: &FamilyReport, engines: &[Engine], steps: bool, first: bool) {
    let columns = |cell: &dyn Fn(Engine) -> String| -> String {
        let cells = engines.iter().map(|engine| format!(" {:>10}", cell(*engine)));
        cells.collect()
    };
    if first {
        let names = columns(&|engine| engine.name().to_owned());
        println!("{:<20}{names}  verdict", "frontier of");
    }
    let frontiers = columns(&|engine| report.frontier(engine));
    println!("{:<20}{frontiers}  {}", report.family, report.verdict);
    if !steps {
        return;
    }
    println!(
        "  parameter: {}; error: {}; usable up to {:e}; promise: {}",
        report.parameter, report.measure, report.usable_level, report.pass_level
    );
    let reach = report
        .parameters
        .iter()
        .position(|known| (known / report.reach - 1.0).abs() < 1e-9);
    let is_beyond = |parameter: f64| {
        let place = report.parameters.iter().position(|known| *known == parameter);
        place > reach
    };
    if let Some(parameter) = report.worse_at {
        println!("  much worse than the textbook formula in double precision at {parameter:.0e}");
    }
    if let Some(why) = &report.refusal {
        println!(
            "  the last step is refused: {}",
            why.lines().next().unwrap_or_default()
        );
    }
    for engine in &report.engines {
        for step in &engine.steps {
            println!(
                "  {:<10} {:>8.0e}  error {:>9.2e}  strict {:>9.2e}  wrong {:>4}  not finite {:>3}  {:>7} ns{}{}",
                engine.engine.name(),
                step.parameter,
                step.error,
                step.strict,
                step.failures,
                step.nonfinite,
                step.ns_per_op.map_or("–".to_owned(), |ns| format!("{ns:.0}")),
                if step.usable { "" } else { "  unusable" },
                if step.passes || engine.engine != Engine::Whitstone || is_beyond(step.parameter) {
                    ""
                } else {
                    "  BREAKS ITS PROMISE"
                },
            );
        }
        if let Some(why) = &engine.absent {
            println!("  {:<10} not run: {why}", engine.engine.name());
        }
    }
}
