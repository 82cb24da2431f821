//! `converge`: error against run time.

#[cfg(feature = "cluster")]
mod parts;

#[cfg(feature = "cluster")]
use super::cluster::Cluster;
use super::page::{self, Marks};
use super::{Drivers, Target};
use crate::interrupt::{self, Watching};
use crate::terminal::{Exit, Failure, make_folder, progress, set_message, write_json};
use clap::Args;
use serde_json::json;
use std::path::{Path, PathBuf};
use std::time::Duration;
use whitstone_converge::{
    Cache, Engine, Lab, Options, SeriesReport, Study, StudyReport, Verdict, csv, headline, plot, table, usage,
};
use whitstone_core::Registry;
use whitstone_image::atomic;
use whitstone_validate::driver::Driver;
use whitstone_validate::environment::Environment;
use whitstone_validate::exported::ExportedMitsuba;
use whitstone_validate::{Renderer, Subject, hash_sources, quoted};

/// Folder of the stored studies.
const STUDIES: &str = "studies";
/// Folder of the plots of stored studies, relative to `docs`.
const PICTURES: &str = "images/converge";

/// Measure error against run time for Whitstone and Mitsuba, and compare the time to reach an error
///
/// A study names a scene, the parameter that is swept, and the image that counts as the truth. All
/// configurations are rendered in turn, several times, half of them in a second session, which
/// follows the first session of all studies. The tables show the median and its 95 % confidence
/// interval. No claim is made below twice the error of the truth itself, nor outside the measured
/// range. Finished measurements are kept under target/whitstone/converge: an interrupted run
/// continues where it stopped.
///
/// Exit code 0 if all expectations of the studies hold (none of them depends on time); 1 if not, if
/// a setting could not be measured, or if the truth is too inaccurate for any claim.
#[derive(Args, Debug)]
#[command(
    help_template = super::HELP_TEMPLATE,
    after_help = "Examples:\n  whitstone converge samples\n  whitstone converge studies/lens.toml --plots plots\n  whitstone converge scenes/showcase/cornell.toml\n  whitstone converge scenes/showcase/cornell.toml --recommend 0.005\n  whitstone converge scene.toml --subject mytracer --points\n  whitstone converge --quick"
)]
pub struct Arguments {
    /// Names of stored studies, study files, or scenes, whose samples per pixel are swept [default:
    /// all stored studies]
    #[arg(value_name = "STUDY")]
    studies: Vec<String>,
    /// Run the reduced form of the studies that have one, without Mitsuba: seconds instead of
    /// minutes
    #[arg(long)]
    quick: bool,
    /// List the stored studies and exit
    #[arg(long)]
    list: bool,
    /// Name the cheapest setting of a scene that reaches this error (RMSE): its sampler and the
    /// number of samples. Mitsuba is not run
    #[arg(long, value_name = "ERROR", value_parser = super::positive, conflicts_with_all = ["quick", "list", "page"])]
    recommend: Option<f64>,
    /// Add another renderer, and Whitstone's own command: the name of a table [subject.NAME], or
    /// NAME={...}. Their times are those of whole commands, from the start of the process to the
    /// written image; the value of {samples} is swept, and every error has the same truth
    #[arg(long, value_name = "NAME", conflicts_with_all = ["quick", "recommend", "page"])]
    subject: Option<String>,
    /// File with the subject's table [default: whitstone.toml in this folder or one above it]
    #[arg(long, value_name = "FILE", requires = "subject")]
    config: Option<PathBuf>,
    /// Print every point, not only the curves
    #[arg(long)]
    points: bool,
    /// Do not run Mitsuba
    #[arg(long)]
    no_mitsuba: bool,
    /// Ignore the results of earlier runs and measure everything again
    #[arg(long)]
    fresh: bool,
    /// Number of times each setting is timed, overriding the study
    #[arg(long, value_name = "COUNT", value_parser = clap::value_parser!(u32).range(1..=1000))]
    repeats: Option<u32>,
    /// Approximate limit in seconds for the repeats of one setting; at least three are run, unless
    /// --repeats asks for fewer
    #[arg(long, default_value_t = 20.0, value_name = "SECONDS", value_parser = super::finite)]
    budget: f64,
    /// Number of threads of both renderers; 0 means one per core
    #[arg(long, value_name = "COUNT", default_value_t = 0, value_parser = super::threads)]
    threads: usize,
    /// Write all results to this file as JSON; - means standard output
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    /// Write one line per point to this file as CSV
    #[arg(long, value_name = "FILE")]
    csv: Option<PathBuf>,
    /// Plot error against time into this folder, one file per study
    #[arg(long, value_name = "DIR")]
    plots: Option<PathBuf>,
    /// Write the tables into this Markdown file, between its marker comments; can be repeated
    #[arg(long, value_name = "FILE")]
    page: Vec<PathBuf>,
    #[cfg(feature = "cluster")]
    #[command(flatten)]
    cluster: Cluster,
    #[command(flatten)]
    target: Target,
    #[command(flatten)]
    drivers: Drivers,
    /// Time limit for one rendering by Mitsuba, in seconds
    #[arg(long, default_value_t = 600, value_name = "SECONDS")]
    time_limit: u64,
}

impl Arguments {
    /// Makes this a part of another command, with its files in a folder; returns false if it would
    /// write other files or start other programs.
    #[cfg(feature = "cluster")]
    pub(super) fn be_part(&mut self, scratch: &Path, mitsuba: Option<&Path>) -> bool {
        self.target.be_part(scratch)
            && self.drivers.be_part(mitsuba)
            && self.csv.is_none()
            && self.plots.is_none()
            && self.page.is_empty()
            && self.subject.is_none()
            && self.cluster.cluster.is_none()
    }
}

/// Runs the command.
pub fn run(arguments: &Arguments, registry: &Registry, program: &str) -> Result<Exit, Failure> {
    let mut studies = chosen(arguments)?;
    if arguments.quick {
        studies.retain(|(_, study)| study.has_quick);
    }
    if arguments.list {
        for (_, study) in studies {
            println!("{:<16} {}", study.name, study.title);
        }
        return Ok(Exit::Pass);
    }
    let here = |studies: Vec<(PathBuf, Study)>| {
        let studies = studies.into_iter().map(|(_, study)| study).collect();
        measure(arguments, studies, registry, program)
    };
    #[cfg(feature = "cluster")]
    let reports = match arguments.cluster.is_named() {
        true => parts::measure(arguments, &studies, registry)?,
        false => here(studies)?,
    };
    #[cfg(not(feature = "cluster"))]
    let reports = here(studies)?;
    super::report::keep_studies(arguments.target.folder(), &reports)?;
    for page in &arguments.page {
        write_page(page, &reports)?;
    }
    let good = reports
        .iter()
        .filter(|report| report.verdict == Verdict::Pass)
        .count();
    if let Some(error) = arguments.recommend {
        let all = reports.iter().all(|report| report.cheapest(error).is_some());
        return Ok(if all { Exit::Pass } else { Exit::Differs });
    }
    println!("studies: {}, pass: {good}", reports.len());
    Ok(if good == reports.len() {
        Exit::Pass
    } else {
        Exit::Differs
    })
}

/// Measures studies, prints each result, and writes those so far.
fn measure(
    arguments: &Arguments,
    mut studies: Vec<Study>,
    registry: &Registry,
    program: &str,
) -> Result<Vec<StudyReport>, Failure> {
    for subject in commands(arguments, registry)? {
        for study in studies.iter_mut().filter(|study| study.stress.is_none()) {
            study.add_command(&subject);
        }
    }
    // A signal ends the command that runs.
    let _watching = arguments.subject.as_ref().map(|_| Watching::new());
    let interrupted = || match interrupt::signal() {
        Some(signal) => {
            let kept = "finished measurements of Whitstone and Mitsuba are kept".to_owned();
            Err(Failure::Interrupted { signal, kept })
        }
        None => Ok(()),
    };
    let (driver, stock, driver_hash) = mitsuba(arguments, &studies)?;
    let options = Options {
        repeats: 7,
        forced_repeats: arguments.repeats.map(|count| count as usize),
        budget: arguments.budget,
        threads: arguments.threads,
        program: program.to_owned(),
        target: arguments.target.folder().to_owned(),
        stop: interrupt::stop().clone(),
    };
    let cache = Cache::new(arguments.target.folder().join("converge"), !arguments.fresh);
    let mut lab = Lab::new(registry, driver, &driver_hash, cache, options);
    if let Some(stock) = stock {
        lab = lab.with_stock(stock);
    }
    // The checks of `--quick` do not depend on time.
    let sessions = if arguments.quick { 1 } else { 2 };
    let bar = progress(sessions * studies.len() as u64, "converge");
    for study in studies.iter().filter(|_| !arguments.quick) {
        let stage = |what: &str| set_message(&bar, &format!("first session, {}: {what}", study.name));
        lab.measure_first_session(study, &stage).map_err(Failure::usage)?;
        interrupted()?;
        bar.inc(1);
    }
    let mut reports: Vec<StudyReport> = Vec::new();
    for study in &studies {
        let stage = |what: &str| set_message(&bar, &format!("{}: {what}", study.name));
        let report = lab.measure(study, &stage).map_err(Failure::usage)?;
        interrupted()?;
        bar.inc(1);
        bar.suspend(|| tell(arguments, &report));
        reports.push(report);
        // Written after each study, so that an interrupted run keeps its results.
        write(arguments, &reports)?;
    }
    bar.finish_and_clear();
    Ok(reports)
}

/// Prints a report, and the recommendation that it contains.
fn tell(arguments: &Arguments, report: &StudyReport) {
    print(report, arguments.points);
    if let Some(error) = arguments.recommend {
        recommend(report, error);
    }
}

/// The studies that the arguments name, with their files or scenes.
fn chosen(arguments: &Arguments) -> Result<Vec<(PathBuf, Study)>, Failure> {
    let stored = || -> Result<Vec<PathBuf>, Failure> {
        let folder = std::fs::read_dir(STUDIES);
        let folder = folder.map_err(|error| Failure::usage(format!("{STUDIES}: {error}; name a study file or a scene, or run the command in the root of a Whitstone checkout")))?;
        let files = folder.filter_map(|entry| Some(entry.ok()?.path()));
        let mut files: Vec<PathBuf> = files
            .filter(|path| path.extension().is_some_and(|e| e == "toml"))
            .collect();
        files.sort();
        Ok(files)
    };
    let load = |path: &Path| {
        let study = Study::load(path, arguments.quick).map_err(Failure::usage)?;
        Ok((path.to_owned(), study))
    };
    let scenes = arguments.studies.iter().map(Path::new);
    let scenes = scenes.filter(|path| path.is_file() && is_scene(path)).count();
    if arguments.recommend.is_some() && (scenes == 0 || scenes < arguments.studies.len()) {
        return Err(Failure::usage("--recommend needs scene files, not studies"));
    }
    if arguments.studies.is_empty() {
        return stored()?.iter().map(|path| load(path)).collect();
    }
    let mut studies = Vec::new();
    for name in &arguments.studies {
        let path = Path::new(name);
        let by_name = Path::new(STUDIES).join(name).with_extension("toml");
        studies.push(if path.is_file() && is_scene(path) {
            (path.to_owned(), of_scene(path, arguments.recommend.is_some())?)
        } else if path.is_file() || !by_name.is_file() && path.extension().is_some() {
            load(path)?
        } else if by_name.is_file() {
            load(&by_name)?
        } else {
            let known = stored().unwrap_or_default();
            let known: Vec<String> = known
                .iter()
                .map(|path| {
                    path.file_stem()
                        .unwrap_or_default()
                        .to_string_lossy()
                        .into_owned()
                })
                .collect();
            let near = whitstone_core::nearest(name, known.iter().map(String::as_str));
            let help = near.map_or_else(
                || "`whitstone converge --list` lists all studies".to_owned(),
                |near| format!("did you mean \"{near}\"?"),
            );
            return Err(Failure::usage(format!("there is no study \"{name}\"; {help}")));
        });
    }
    Ok(studies)
}

/// Whether a file is a scene: of another format, or without a list of series and with a key that
/// only scenes have.
fn is_scene(path: &Path) -> bool {
    if path.extension().is_some_and(|extension| extension != "toml") {
        return true;
    }
    let text = std::fs::read_to_string(path).unwrap_or_default();
    let first = |key: &str| text.lines().any(|line| line.trim_start().starts_with(key));
    !first("[[series") && ["[camera]", "[[shape]]", "include"].iter().any(|key| first(key))
}

/// The variant of Mitsuba whose own integrators take part; the driver uses it too.
const VARIANT: &str = "llvm_ad_rgb";

/// The series of the default study of a scene, with Mitsuba.
const SERIES: &str = r#"
[[series]]
name = "grid"
engines = ["whitstone", "mitsuba"]
set = ["sampler={ type = \"grid\" }"]
sweep = { "sampler.samples_per_axis" = [1, 2, 3, 4, 6, 8] }
[[series]]
name = "sobol"
engines = ["whitstone", "mitsuba"]
set = ["sampler={ type = \"sobol\" }"]
sweep = { "sampler.samples" = [1, 4, 16, 64] }
"#;

/// Finer series, for a recommendation.
const CANDIDATES: &str = r#"
[[series]]
name = "grid"
set = ["sampler={ type = \"grid\" }"]
sweep = { "sampler.samples_per_axis" = [1, 2, 3, 4, 5, 6, 8, 10, 12, 16] }
[[series]]
name = "sobol"
set = ["sampler={ type = \"sobol\" }"]
sweep = { "sampler.samples" = [2, 4, 8, 16, 32, 64, 128, 256] }
[[series]]
name = "adaptive"
set = ["sampler={ type = \"adaptive\", samples = 1024 }"]
sweep = { "sampler.threshold" = [0.1, 0.05, 0.02, 0.01, 0.005, 0.002, 0.001] }
"#;

/// A default study for a scene: samples per pixel, for every sampler that supports any number of
/// samples.
fn of_scene(path: &Path, candidates: bool) -> Result<Study, Failure> {
    let absolute = std::path::absolute(path).map_err(Failure::environment)?;
    let scene = toml_text(&absolute.display().to_string());
    let shown = toml_text(&path.display().to_string());
    let text = format!(
        r#"title = {shown}
about = "Samples per pixel."
scene = {scene}
[truth]
set = ["sampler={{ type = \"grid\", samples_per_axis = 32 }}"]
check = [{{ set = ["sampler={{ type = \"sobol\", samples = 1024 }}"] }}]
{}"#,
        if candidates { CANDIDATES } else { SERIES }
    );
    let name = path.display().to_string();
    Study::parse(&name, &text, Path::new(""), false).map_err(Failure::usage)
}

/// A string as a TOML literal.
fn toml_text(text: &str) -> String {
    // JSON's escapes are a subset of TOML's.
    serde_json::Value::from(text).to_string()
}

/// The renderers of `--subject`: the one that it names, and this program.
fn commands(arguments: &Arguments, registry: &Registry) -> Result<Vec<Subject>, Failure> {
    let Some(name) = &arguments.subject else {
        return Ok(Vec::new());
    };
    let subject = Subject::find(name, arguments.config.as_deref(), registry).map_err(Failure::usage)?;
    let program = std::env::current_exe().map_err(Failure::environment)?;
    let is_python = |name: &std::ffi::OsStr| name.to_string_lossy().starts_with("python");
    if program.file_name().is_some_and(is_python) {
        // Started from Python, the command is a script that this process does not know.
        return Ok(vec![subject]);
    }
    let command = format!(
        "{} render {{scene}} -o {{output}} --threads {{threads}} \
         --set 'sampler={{{{ type = \"sobol\", samples = {{samples}} }}}}'",
        quoted(&program.display().to_string())
    );
    let ours = format!("whitstone={{ command = {} }}", toml_text(&command));
    let ours = Subject::find(&ours, None, registry).map_err(Failure::usage)?;
    Ok(vec![ours, subject])
}

/// The driver, or the reason why there is none; Mitsuba's own integrators, if a study uses them;
/// and a key that changes with both.
type Mitsuba = (Result<Driver, String>, Option<ExportedMitsuba>, String);

fn mitsuba(arguments: &Arguments, studies: &[Study]) -> Result<Mitsuba, Failure> {
    let absent = |why: &str| Ok((Err(why.to_owned()), None, String::new()));
    if arguments.no_mitsuba {
        return absent("skipped because of --no-mitsuba");
    }
    if arguments.quick {
        return absent("skipped because of --quick");
    }
    let uses = |study: &Study, engine: Engine| {
        let truths = std::iter::once(&study.truth).chain(&study.checks);
        let engines = truths.map(|truth| truth.engine);
        let series = study.series.iter().map(|series| series.engine);
        engines.chain(series).any(|used| used == engine)
    };
    let with_driver = studies
        .iter()
        .any(|study| study.stress.is_some() || uses(study, Engine::Mitsuba));
    let with_stock = studies.iter().any(|study| uses(study, Engine::StockMitsuba));
    if !with_driver && !with_stock {
        return absent("no study uses it");
    }
    let environment = Environment::ensure(&arguments.drivers.installation(&arguments.target), &|what| {
        eprintln!("{what}")
    });
    let environment = environment
        .map_err(|error| Failure::environment(format!("{error}; use --no-mitsuba to run without Mitsuba")))?;
    let stock = with_stock
        .then(|| ExportedMitsuba::start(&environment, VARIANT, arguments.threads))
        .transpose()
        .map_err(Failure::environment)?;
    let hash = hash_sources(Renderer::MITSUBA, &environment);
    let limit = Duration::from_secs(arguments.time_limit);
    let mut driver = Driver::start(&environment, limit).map_err(Failure::environment)?;
    let hello = driver.hello().map_err(Failure::environment)?;
    Ok((Ok(driver), stock, format!("{hash} {}", hello.mitsuba)))
}

fn write(arguments: &Arguments, reports: &[StudyReport]) -> Result<(), Failure> {
    if let Some(path) = &arguments.json {
        let value = json!({
            "studies": reports,
            "provenance": {
                "version": env!("CARGO_PKG_VERSION"),
                "cpu": usage::processor(),
                "cores": std::thread::available_parallelism().ok(),
                "threads": arguments.threads,
                "load": usage::load(),
            },
        });
        write_json(path, &value)?;
    }
    if let Some(path) = &arguments.csv {
        atomic::write_bytes(path, csv(reports).as_bytes()).map_err(Failure::environment)?;
    }
    if let Some(folder) = &arguments.plots {
        make_folder(folder)?;
        for report in reports {
            let name = Path::new(&report.study)
                .file_stem()
                .unwrap_or_default()
                .to_string_lossy();
            let path = folder.join(format!("{name}.svg"));
            atomic::write_bytes(&path, plot::svg(report).as_bytes()).map_err(Failure::environment)?;
        }
    }
    Ok(())
}

/// The markers around the parts of a page that are replaced: all curves, and the ratios to Mitsuba.
const TABLE: Marks = [
    "<!-- studies: written by `cargo xtask converge --page` -->",
    "<!-- end of studies -->",
];
const HEADLINE: Marks = [
    "<!-- time to error: written by `cargo xtask converge --page` -->",
    "<!-- end of time to error -->",
];

fn write_page(path: &Path, reports: &[StudyReport]) -> Result<(), Failure> {
    page::write(
        path,
        &[(TABLE, table(reports, PICTURES)), (HEADLINE, headline(reports))],
    )
}

/// Prints the cheapest setting that reaches an error, or how near the best one comes.
fn recommend(report: &StudyReport, error: f64) {
    if let Some((series, point)) = report.cheapest(error) {
        let number = |value: Option<f64>| value.unwrap_or(f64::NAN);
        println!(
            "  cheapest for an error of {error:e}: {} with {} (RMSE {:.2e}, {:.4} s of processor time, {} rays)\n    {}",
            series.configuration,
            point.setting,
            number(point.rmse),
            number(point.cpu_seconds.or(point.seconds)),
            point.rays.unwrap_or(0),
            point.command,
        );
        return;
    }
    let points = report.series.iter().flat_map(|series| &series.points);
    let best = points
        .filter_map(|point| point.rmse)
        .fold(f64::INFINITY, f64::min);
    println!(
        "  no setting reaches an error of {error:e}: the smallest one is {best:.2e}, and the truth's own error is {:.2e}",
        report.floor_rmse
    );
}

fn print(report: &StudyReport, points: bool) {
    let noisy = if report.noisy { ", noisy" } else { "" };
    println!("{}: {} ({}{noisy})", report.study, report.title, report.verdict);
    println!("  the truth's own error: {:.1e}", report.floor_rmse);
    for series in &report.series {
        let name = format!("{} ({})", series.configuration, series.engine.name());
        if let Some(why) = &series.absent {
            println!("  {name:<28} not run: {why}");
            continue;
        }
        let slope = match (series.slope, series.slope_interval) {
            (Some(slope), Some([least, most])) => format!("{slope:.3} ({least:.3} to {most:.3})"),
            _ => "–".to_owned(),
        };
        println!("  {name:<28} slope against {}: {slope}", report.against.name());
        for point in series.points.iter().filter(|_| points) {
            let number =
                |value: Option<f64>| value.map_or_else(|| "–".to_owned(), |value| format!("{value:.3e}"));
            println!(
                "    {:<32} {:>10} s, spread {:>10}{}  RMSE {:>10}  interior {:>10}  {} rays{}",
                point.setting,
                number(point.seconds),
                number(point.spread),
                if point.noisy { " noisy" } else { "" },
                number(point.rmse),
                number(point.errors.map(|errors| errors.interior.rmse)),
                point.rays.map_or_else(|| "–".to_owned(), |rays| rays.to_string()),
                if point.above_floor {
                    ""
                } else {
                    "  below the floor"
                },
            );
        }
    }
    for (level, both) in report.levels() {
        let seconds =
            |value: Option<f64>| value.map_or_else(|| "–".to_owned(), |value| format!("{value:.4} s"));
        let ratio = match (both.noisy, both.ratio, both.ratio_interval) {
            (true, ..) => ": noisy".to_owned(),
            (false, Some(ratio), Some([least, most])) => {
                format!(": ratio {ratio:.4} ({least:.4} to {most:.4})")
            }
            _ => String::new(),
        };
        println!(
            "  to an error of {level}: whitstone {}, mitsuba {}{ratio}",
            seconds(both.whitstone_s),
            seconds(both.mitsuba_s)
        );
    }
    let commands = || (report.series.iter()).filter(|series| series.engine == Engine::Command);
    for (level, _) in report.levels() {
        let reached = |series: &SeriesReport| match series.time_to.get(level) {
            Some(reached) => format!("{} {:.4} s", series.configuration, reached.seconds),
            None => format!("{} –", series.configuration),
        };
        let all: Vec<String> = commands().map(reached).collect();
        if !all.is_empty() {
            println!("  to an error of {level}, whole commands: {}", all.join(", "));
        }
    }
    for what in &report.withheld {
        println!("  withheld: {what}");
    }
    for what in &report.problems {
        println!("  problem: {what}");
    }
}
