//! `validate`: compares scenes with a reference and writes a report.

#[cfg(feature = "cluster")]
pub mod parts;
mod several;

#[cfg(feature = "cluster")]
use super::cluster::Cluster;
use super::junit::{self, Case, Outcome};
use super::report;
use super::{Drivers, Target};
use crate::interrupt;
#[cfg(feature = "cluster")]
use crate::jobs::Job;
use crate::terminal::{self, Exit, Failure, keep_moving, progress, set_message, verdict_word};
#[cfg(feature = "cluster")]
use clap::Parser;
use clap::{Args, ValueEnum};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};
use whitstone_core::{ImportOptions, Registry};
use whitstone_image::Image;
use whitstone_scene::{Description, Sources};
use whitstone_validate::driver::Versions;
use whitstone_validate::matrix::{self, Row, Tally};
use whitstone_validate::{
    Ask, CaseResult, Mode, Options, OraclePolicy, Provenance, REFERENCES, Renderer, Results, SkippedScene,
    Status, Subject, Summary, Validator, counted, find_scenes, quoted,
};

const SCENES: &str = "scenes";
/// In seconds.
const TIME_LIMIT: u64 = 300;

/// Compare Whitstone's images of scenes with those of a reference renderer, and write a report
///
/// The reference is a live Mitsuba in a private Python environment that is created on first use,
/// or, with --reference povray, the installed POV-Ray. If it is not available, the stored
/// references of the repository are used, and the report says so. A scene that the reference cannot
/// render is skipped and listed if another renderer has a stored reference of it; otherwise it is
/// undecided. --reference mitsuba-stock compares with Mitsuba's own direct, path and volpathmis
/// integrators.
///
/// With --subject NAME, the images of another renderer take the place of Whitstone's. Its command
/// is in the table [subject.NAME] of a file whitstone.toml: docs/subjects.md. A subject that gives
/// no image of a scene fails it; a command that cannot be started is exit code 3. With several
/// subjects, the page comparison/index.html in the folder of the results shows the scenes and the
/// subjects as a matrix, and the error between each two of them.
///
/// Verdicts: pass (the images agree), confirmed (the reference is too inaccurate in this scene, and
/// the arbitrary-precision oracle confirms our image), FAIL (our image is wrong), undecided
/// (neither reference nor oracle can decide, with the reason). Exit code 0 if all cases pass or are
/// confirmed, 1 if one fails or is undecided, 2 for a wrong command line or scene, 3 if none fails
/// but a scene could not be compared.
#[derive(Args, Debug)]
#[command(
    help_template = super::HELP_TEMPLATE,
    after_help = "Examples:\n  whitstone validate scenes/shapes\n  whitstone validate scenes/showcase/classic.toml --reference povray\n  whitstone validate --reference stored --junit validate.xml\n  whitstone validate scenes/shapes --subject mytracer"
)]
pub struct Arguments {
    #[command(flatten)]
    scenes: Scenes,
    /// Validate another renderer: the name of a table [subject.NAME], or NAME={...}; can be
    /// repeated to compare several
    #[arg(long, value_name = "NAME", conflicts_with_all = ["ours", "matrix"])]
    subject: Vec<String>,
    /// File with the subject's table [default: whitstone.toml in this folder or one above it]
    #[arg(long, value_name = "FILE", requires = "subject")]
    config: Option<PathBuf>,
    /// Override a value in Whitstone only, to inject a fault; can be repeated
    #[arg(long, value_name = "PATH=VALUE")]
    ours: Vec<String>,
    /// Also vary the settings: accelerator and threads (compared with the scene's own image), depth
    /// and texture filter (compared with a live reference); settings that a scene does not need are
    /// skipped and reported
    #[arg(long)]
    matrix: bool,
    /// Query the arbitrary-precision oracle about every pixel over tolerance, not only where the
    /// verdict depends on it
    #[arg(long)]
    oracle: bool,
    /// Never query the oracle; cases that only it could decide are undecided
    #[arg(long, conflicts_with = "oracle")]
    no_oracle: bool,
    /// Time limit of the oracle for one scene, in seconds
    #[arg(
        long,
        default_value_t = 60,
        value_name = "SECONDS",
        conflicts_with = "no_oracle"
    )]
    oracle_time: u64,
    /// Treat confirmed as a failure: the reference itself must agree
    #[arg(long)]
    strict: bool,
    #[cfg(feature = "cluster")]
    #[command(flatten)]
    cluster: Cluster,
    /// Also write the results to this file as JSON; - means standard output
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    /// Write the verdicts to this file as JUnit XML, which most CI systems display
    #[arg(long, value_name = "FILE")]
    junit: Option<PathBuf>,
}

/// Selects the scenes and the reference.
#[derive(Args, Debug)]
// An unnamed group, because it is part of several commands.
#[group(skip)]
pub struct Scenes {
    /// Scene files (TOML), or folders of them
    #[arg(default_value = SCENES, value_name = "SCENE")]
    pub paths: Vec<PathBuf>,
    /// Source of the references
    #[arg(long, value_enum, default_value_t = ReferenceMode::Auto)]
    pub reference: ReferenceMode,
    /// Override a value of every scene, for example `camera.fov=30`; can be repeated
    #[arg(long = "set", value_name = "PATH=VALUE")]
    pub overrides: Vec<String>,
    /// Refuse scenes that name a file outside of this folder, also through a link [default: files
    /// may be anywhere]
    #[arg(long, value_name = "DIR")]
    pub root: Option<PathBuf>,
    /// Render all references again, including those of unchanged scenes
    #[arg(long)]
    pub fresh: bool,
    #[command(flatten)]
    pub(super) target: Target,
    /// Folder of the stored references
    #[arg(long, default_value = REFERENCES, value_name = "DIR")]
    pub references: PathBuf,
    #[command(flatten)]
    pub(super) drivers: Drivers,
    /// Number of threads; 0 means one per core
    #[arg(long, value_name = "COUNT", default_value_t = 0, value_parser = super::threads)]
    pub threads: usize,
    /// Time limit for one request to the reference renderer's driver, in seconds
    #[arg(long, default_value_t = TIME_LIMIT, value_name = "SECONDS")]
    pub time_limit: u64,
}

/// See [`Mode`] and [`Renderer`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum ReferenceMode {
    /// Mitsuba, live if possible, else stored
    Auto,
    /// Live Mitsuba, or exit code 3
    Live,
    /// Stored references of Mitsuba only
    Stored,
    /// POV-Ray, live if possible, else stored
    Povray,
    /// Live POV-Ray, or exit code 3
    PovrayLive,
    /// Stored references of POV-Ray only
    PovrayStored,
    /// Mitsuba's own direct, path and volpathmis integrators, live, or exit code 3: shows that the
    /// driver agrees with Mitsuba
    MitsubaStock,
}

impl ReferenceMode {
    /// The renderer, and whether it runs live.
    pub fn parts(self) -> (Renderer, Mode) {
        match self {
            Self::Auto => (Renderer::MITSUBA, Mode::Auto),
            Self::Live => (Renderer::MITSUBA, Mode::Live),
            Self::Stored => (Renderer::MITSUBA, Mode::Stored),
            Self::Povray => (Renderer::POVRAY, Mode::Auto),
            Self::PovrayLive => (Renderer::POVRAY, Mode::Live),
            Self::PovrayStored => (Renderer::POVRAY, Mode::Stored),
            Self::MitsubaStock => (Renderer::MITSUBA_STOCK, Mode::Live),
        }
    }

    /// The name of the value on the command line.
    fn name(self) -> String {
        let value = self.to_possible_value();
        value.map_or_else(String::new, |value| value.get_name().to_owned())
    }
}

impl Scenes {
    /// The options of the library. Messages call this command line `program`.
    pub fn options(&self, program: &str) -> Options {
        let (renderer, mode) = self.reference.parts();
        Options {
            scenes: PathBuf::from(SCENES),
            references: self.references.clone(),
            installation: self.drivers.installation(&self.target),
            target: self.target.folder().to_owned(),
            renderer,
            mode,
            reuse: !self.fresh,
            threads: self.threads,
            overrides: self.overrides.clone(),
            ours_overrides: Vec::new(),
            shared_overrides: Vec::new(),
            time_limit: Duration::from_secs(self.time_limit),
            program: program.to_owned(),
            flags: self.flags(),
        }
    }

    /// The arguments that affect a result, apart from the scenes, as they must be repeated.
    pub fn flags(&self) -> String {
        let mut flags: Vec<(&str, String)> = Vec::new();
        flags.extend(self.overrides.iter().map(|change| ("--set", change.clone())));
        if self.reference != ReferenceMode::Auto {
            flags.push(("--reference", self.reference.name()));
        }
        if self.references != Path::new(REFERENCES) {
            flags.push(("--references", self.references.display().to_string()));
        }
        for (flag, path) in [
            ("--target", &self.target.target),
            ("--mitsuba", &self.drivers.mitsuba),
            ("--drivers", &self.drivers.drivers),
        ] {
            flags.extend(path.iter().map(|path| (flag, path.display().to_string())));
        }
        if self.time_limit != TIME_LIMIT {
            flags.push(("--time-limit", self.time_limit.to_string()));
        }
        let written = flags
            .iter()
            .map(|(flag, value)| format!(" {flag} {}", quoted(value)));
        written.collect()
    }

    /// All scenes that the paths name.
    pub fn find(&self, registry: &Registry) -> Result<Vec<PathBuf>, Failure> {
        if self.fresh && self.reference.parts().1 == Mode::Stored {
            return Err(Failure::usage(format!(
                "--fresh renders references again, but --reference {} renders none; leave one of them out",
                self.reference.name()
            )));
        }
        let scenes = find_scenes(&self.paths).map_err(|error| {
            let hint = if self.paths == [PathBuf::from(SCENES)] {
                "; name scene files, or run the command in the root of a Whitstone checkout"
            } else {
                ""
            };
            Failure::usage(format!("{error}{hint}"))
        })?;
        if scenes.is_empty() {
            return Err(Failure::usage(
                "no scenes were found; name scene files (TOML), or folders of them",
            ));
        }
        self.check_root(&scenes, registry)?;
        Ok(scenes)
    }

    /// With a root, all scenes are read before anything is rendered.
    fn check_root(&self, scenes: &[PathBuf], registry: &Registry) -> Result<(), Failure> {
        if self.root.is_none() {
            return Ok(());
        }
        let options = ImportOptions {
            root: self.root.clone(),
            ..ImportOptions::all()
        };
        let color = terminal::color();
        for scene in scenes {
            let sources = Sources::load_with(scene, &self.overrides, registry, &options)
                .map_err(|error| Failure::usage(error.sources.report(&error.errors, color)))?;
            Description::parse(&sources)
                .into_result()
                .map_err(|errors| Failure::usage(sources.report(&errors, color)))?;
        }
        Ok(())
    }
}

impl Arguments {
    /// Makes this a part of another command, with its files in a folder; returns false if it would
    /// write other files or start other programs.
    #[cfg(feature = "cluster")]
    pub(super) fn be_part(&mut self, scratch: &Path, mitsuba: Option<&Path>) -> bool {
        self.scenes.target.be_part(scratch)
            && self.scenes.drivers.be_part(mitsuba)
            && self.junit.is_none()
            && self.subject.is_empty()
            && self.cluster.cluster.is_none()
    }
}

/// Runs the command.
pub fn run(arguments: &Arguments, registry: &Registry, program: &str) -> Result<Exit, Failure> {
    #[cfg(feature = "cluster")]
    if arguments.cluster.is_named() && !arguments.subject.is_empty() {
        return Err(Failure::usage(
            "--cluster does not run subjects: their commands run only where they are named",
        ));
    }
    if arguments.subject.len() > 1 {
        return several::run(arguments, registry, program);
    }
    let scenes = arguments.scenes.find(registry)?;
    report::check(
        arguments.scenes.target.folder(),
        arguments.json.iter().chain(&arguments.junit),
    )?;
    let subject = arguments.subject.first();
    let subject = subject.map(|name| find(arguments, name, registry)).transpose()?;
    let here = |subject| validate(arguments, registry, program, &scenes, subject, &|_, _| ());
    #[cfg(feature = "cluster")]
    let done = match arguments.cluster.is_named() {
        true => parts::validate(arguments, registry, &scenes)?,
        false => here(subject)?,
    };
    #[cfg(not(feature = "cluster"))]
    let done = here(subject)?;
    let results = &done.results;
    report::write(
        results,
        arguments.scenes.target.folder(),
        arguments.json.as_deref(),
    )?;
    if let Some(path) = &arguments.junit {
        junit::write(path, "whitstone validate", &junit_cases(results))?;
    }
    print_summary(
        &results.summary,
        &arguments.scenes.target.folder().join("validate"),
    );
    done.exit(arguments, program)
}

/// A job for each scene that the paths name.
#[cfg(feature = "cluster")]
pub(super) fn plan(
    paths: &[PathBuf],
    overrides: &[String],
    reference: ReferenceMode,
    registry: &Registry,
) -> Result<Vec<Job>, Failure> {
    let parsed = super::Arguments::try_parse_from(["whitstone", "validate"]);
    let Ok(super::Command::Validate(mut arguments)) = parsed.map(|parsed| parsed.command) else {
        return Err(Failure::usage("`validate` has required arguments"));
    };
    arguments.scenes.paths = paths.to_vec();
    arguments.scenes.overrides = overrides.to_vec();
    arguments.scenes.reference = reference;
    let scenes = arguments.scenes.find(registry)?;
    parts::plan(&arguments, registry, &scenes)
}

/// The subject of this name, with the file of the command line.
fn find(arguments: &Arguments, name: &str, registry: &Registry) -> Result<Subject, Failure> {
    Subject::find(name, arguments.config.as_deref(), registry).map_err(Failure::usage)
}

/// The results of all scenes, and why there may be none.
struct Done {
    results: Results,
    /// Why the live reference failed, if it did.
    broken: Option<String>,
}

impl Done {
    /// The exit code, after the results were written.
    fn exit(&self, arguments: &Arguments, program: &str) -> Result<Exit, Failure> {
        let results = &self.results;
        if let Some(signal) = interrupt::signal() {
            let not_run = results.summary.not_run;
            return Err(Failure::Interrupted {
                signal,
                kept: format!("the report has no result of {}", counted(not_run, "scene")),
            });
        }
        if let Some(problem) = &self.broken {
            let (renderer, mode) = arguments.scenes.reference.parts();
            if mode == Mode::Live {
                return Err(Failure::environment(problem));
            }
            eprintln!(
                "warning: the live {renderer} failed, so stored references were used: {problem}\n\
                 warning: run `{program} doctor` for details"
            );
        }
        self.verdict(arguments.strict)
    }

    /// The exit code of the cases.
    fn verdict(&self, strict: bool) -> Result<Exit, Failure> {
        let results = &self.results;
        let wrong = results.results.iter().filter(|case| case.scene_error).count();
        if wrong > 0 {
            return Err(Failure::usage(format!(
                "scenes that cannot be rendered: {wrong}; see above"
            )));
        }
        if results.results.is_empty() {
            return Err(Failure::environment(
                "nothing was compared: the reference renderer or the subject cannot render any of the scenes; see above",
            ));
        }
        verdict(&results.results, results.summary.matrix, strict)
    }
}

/// Validates scenes, and prints each result. `look` gets the name of each scene and the image that
/// is compared with the reference.
fn validate(
    arguments: &Arguments,
    registry: &Registry,
    program: &str,
    scenes: &[PathBuf],
    subject: Option<Subject>,
    look: &dyn Fn(&Path, &Image),
) -> Result<Done, Failure> {
    let start = Instant::now();
    let mut options = arguments.scenes.options(program);
    options.ours_overrides.clone_from(&arguments.ours);
    for change in &arguments.ours {
        options.flags += &format!(" --ours {}", quoted(change));
    }
    if let Some(subject) = &subject {
        options.flags += &format!(" --subject {}", quoted(&said(arguments, subject)));
        if let Some(config) = &arguments.config {
            options.flags += &format!(" --config {}", quoted(&config.display().to_string()));
        }
    }
    let mut validator =
        Validator::new(registry, options, &|text| eprintln!("{text}")).map_err(Failure::environment)?;
    validator.set_oracle(OraclePolicy {
        when: match (arguments.oracle, arguments.no_oracle) {
            (true, _) => Ask::Always,
            (_, true) => Ask::Never,
            _ => Ask::Needed,
        },
        budget: Duration::from_secs(arguments.oracle_time),
    });
    if let Some(subject) = subject {
        println!("subject: {}; \"ours\" below is its image", subject.name);
        validator.set_subject(subject);
    }
    if let Some(why) = validator.not_live() {
        let (renderer, _) = arguments.scenes.reference.parts();
        eprintln!(
            "warning: live {renderer} is not available: {why}\nwarning: comparing with the stored references"
        );
    }
    validator.set_stop(interrupt::stop().clone());
    // What is finished becomes a report.
    let _watching = interrupt::Watching::new();
    let bar = progress(scenes.len() as u64, "validating");
    // The clock also runs while the driver is busy.
    keep_moving(&bar);
    let mut cases = Vec::new();
    let mut skipped = Vec::new();
    let mut matrix = Vec::new();
    let mut compared = 0;
    print_header();
    for path in scenes {
        let (name, stage_bar) = (path.display().to_string(), bar.clone());
        validator.on_stage(move |stage| set_message(&stage_bar, &format!("{name}: {stage}")));
        let mut case = validator.validate_tampered(path, &|image| look(path, image));
        if interrupt::signal().is_some() {
            break;
        }
        let other_reference = case.other_reference.take();
        if other_reference.is_some() || case.not_expressible {
            let left = SkippedScene {
                reason: case.problems.join("\n"),
                scene: case.scene,
                other_reference,
            };
            bar.suspend(|| print_skipped(&left));
            skipped.push(left);
        } else {
            bar.suspend(|| print_case(&case));
            let sweeps = arguments.matrix && !case.scene_error;
            cases.push(case);
            if sweeps {
                let (cells, more) = validator.matrix(path);
                if interrupt::signal().is_some() {
                    break;
                }
                bar.suspend(|| {
                    matrix::rows(&cells).iter().for_each(print_row);
                    more.iter()
                        .filter(|case| case.status != Some(Status::Pass))
                        .for_each(print_case);
                });
                matrix.extend(cells);
                cases.extend(more);
            }
        }
        compared += 1;
        bar.inc(1);
    }
    bar.finish_and_clear();
    let versions = validator.live().and_then(|live| live.versions().cloned());
    let (mitsuba, povray) = match versions {
        Some(Versions::Mitsuba(found)) => (Some(found), None),
        Some(Versions::PovRay(found)) => (None, Some(found)),
        None => (None, None),
    };
    let references = match validator.not_live() {
        None => "live".to_owned(),
        // The rest is in the warning above.
        Some(why) => {
            let first = why.lines().next().unwrap_or_default();
            format!("stored ({})", first.trim_end_matches(':'))
        }
    };
    let results = Results {
        summary: Summary {
            skipped: skipped.len(),
            not_run: scenes.len() - compared,
            matrix: Tally::of(&matrix),
            ..Summary::of(&cases, references, start.elapsed().as_secs_f64())
        },
        provenance: Provenance {
            whitstone: env!("CARGO_PKG_VERSION").to_owned(),
            threads: match arguments.scenes.threads {
                0 => std::thread::available_parallelism().map_or(1, usize::from),
                threads => threads,
            },
            mitsuba,
            povray,
        },
        results: cases,
        skipped,
        matrix,
    };
    Ok(Done {
        results,
        broken: validator.broken().map(str::to_owned),
    })
}

/// The subject as the command line states it.
fn said(arguments: &Arguments, subject: &Subject) -> String {
    let is_it = |said: &&String| said.split('=').next() == Some(&*subject.name);
    arguments
        .subject
        .iter()
        .find(is_it)
        .cloned()
        .unwrap_or_else(|| subject.name.clone())
}

/// A failed case decides the result. Cases that could not be compared matter only if all others
/// agree.
fn verdict(cases: &[CaseResult], matrix: Tally, strict: bool) -> Result<Exit, Failure> {
    let is_good = |status: Status| {
        if strict {
            status == Status::Pass
        } else {
            status.is_right()
        }
    };
    let mut failed = cases
        .iter()
        .filter(|case| !case.status.is_some_and(is_good))
        .peekable();
    if matrix.failed > 0 {
        return Ok(Exit::Differs);
    }
    if failed.peek().is_none() {
        return Ok(Exit::Pass);
    }
    let decides = |case: &CaseResult| {
        let subject_failed = case.subject.as_ref().is_some_and(|subject| subject.failed);
        case.compared || case.status == Some(Status::Fail) || subject_failed
    };
    if failed.any(decides) {
        return Ok(Exit::Differs);
    }
    let without = cases.iter().filter(|case| !case.compared).count();
    Err(Failure::environment(format!(
        "scenes that could not be compared with a reference: {without}; see above"
    )))
}

fn junit_cases(results: &Results) -> Vec<Case> {
    let compared = results.results.iter().map(|case| Case {
        name: match case.config.as_str() {
            "default" => case.scene.clone(),
            config => format!("{}, {config}", case.scene),
        },
        seconds: case.build_s + case.render_s,
        outcome: match (case.status, case.compared) {
            (Some(Status::Pass | Status::Confirmed), _) => Outcome::Pass,
            (Some(Status::Fail), _) if case.subject.is_some() => {
                Outcome::Fails(format!("{}\n{}", case.verdict, case.problems.join("\n")))
            }
            (_, true) => Outcome::Fails(format!("{}\n{}", case.verdict, case.problems.join("\n"))),
            (_, false) => Outcome::Error(format!("{}\n{}", case.verdict, case.problems.join("\n"))),
        },
    });
    let skipped = results.skipped.iter().map(|left| Case {
        name: left.scene.clone(),
        seconds: 0.0,
        outcome: Outcome::Skipped(left.reason.clone()),
    });
    // Settings that were compared with a reference are among the cases.
    let own = results.matrix.iter().filter(|cell| cell.against == matrix::OWN);
    let own = own.map(|cell| Case {
        name: format!("{}, {} {}", cell.scene, cell.axis, cell.setting),
        seconds: 0.0,
        outcome: match cell.outcome {
            matrix::Outcome::Fail => Outcome::Fails(cell.detail.clone()),
            matrix::Outcome::Pass => Outcome::Pass,
            matrix::Outcome::Skipped => Outcome::Skipped(cell.detail.clone()),
        },
    });
    compared.chain(skipped).chain(own).collect()
}

/// Prints the column headers of [`print_case`].
fn print_header() {
    println!(
        "{:<9} {:<30} {:>8} {:>8} {:>8} {:>6} {:>11} {:>11} {:>8} {:>8}  {:<6} twin",
        "verdict",
        "scene",
        "rmse",
        "interior",
        "limit",
        "over",
        "expl. of max",
        "unexplained",
        "ours s",
        "ref. s",
        "source"
    );
}

fn print_case(case: &CaseResult) {
    let status = case.status.unwrap_or(Status::Undecided);
    let number = |value: Option<f64>| value.map_or_else(|| "-".to_owned(), |v| format!("{v:.2e}"));
    let count = |text: String| if case.compared { text } else { "-".to_owned() };
    let source = case
        .reference
        .as_ref()
        .map_or("-", |reference| reference.source.as_str());
    let exit = match status {
        Status::Pass | Status::Confirmed => Some(Exit::Pass),
        Status::Fail => Some(Exit::Differs),
        Status::Undecided => None,
    };
    println!(
        "{} {:<30} {:>8} {:>8} {:>8} {:>6} {:>11} {:>11} {:>8.3} {:>8}  {source:<6} {}",
        verdict_word(status.word(), exit, 9),
        case.scene,
        number(case.rmse),
        number(case.rel_rmse_interior),
        number(case.interior().limit),
        count(case.pixels_over_tolerance.to_string()),
        count(format!("{} of {}", case.explained, case.explained_limit)),
        count(case.unexplained.to_string()),
        case.render_s,
        case.reference_s
            .map_or_else(|| "-".to_owned(), |s| format!("{s:.3}")),
        case.twin,
    );
    if status != Status::Pass {
        println!("      {}: {}", status.word(), case.verdict);
    }
    if status == Status::Pass
        && let Some(noisy) = &case.noisy
    {
        println!("      {noisy}");
    }
    if let Some(approximation_note) = &case.approximation_note {
        println!("      {approximation_note}");
    }
    for change in &case.adapted {
        println!("      changed on both sides: {change}");
    }
    if let Some(subject) = &case.subject {
        let both = subject
            .approximated
            .iter()
            .map(|what| ("approximated by the export", what));
        let both = both.chain(subject.remarks.iter().map(|what| ("note", what)));
        both.for_each(|(kind, what)| println!("      {kind}: {what}"));
    }
    if let Some(opinion) = case
        .opinion
        .as_ref()
        .filter(|opinion| opinion.asked > 0 || opinion.silent.is_some())
    {
        println!("      oracle: {opinion}");
    }
    for problem in &case.problems {
        println!("      {}", problem.replace('\n', "\n      "));
    }
    for pixel in case.worst.iter().filter(|pixel| pixel.reason.is_none()).take(3) {
        println!(
            "      pixel ({}, {}): ours {:?}, reference {:?}{}{}",
            pixel.x,
            pixel.y,
            pixel.ours,
            pixel.reference,
            pixel
                .tried
                .map(|[min, max]| [min, max].map(|color| color.map(|value| value as f32)))
                .map_or_else(String::new, |[min, max]| format!(
                    "\n        the reference under shifts, spawn offsets and roundings: {min:?} to {max:?}"
                )),
            pixel
                .first_difference
                .as_ref()
                .map_or_else(String::new, |text| format!("\n        {text}")),
        );
    }
    for note in &case.notes {
        println!("      note: {note}");
    }
    if status != Status::Pass {
        case.coincident
            .iter()
            .for_each(|pair| println!("      coincident surfaces: {pair}"));
    }
    for note in &case.inexact {
        println!("      the reference is inexact here: {note}");
    }
    if !case.problems.is_empty() {
        println!("      reproduce: {}", case.command);
    }
}

/// Prints one setting of the scene above.
fn print_row(row: &Row<'_>) {
    let axis = row.axis;
    if !row.passed.is_empty() {
        println!(
            "      {axis:<11} agrees with {}: {}",
            row.against,
            row.passed.join(", ")
        );
    }
    for (setting, told) in &row.failed {
        println!(
            "FAIL      {axis:<11} {setting}: {}",
            told.replace('\n', "\n      ")
        );
    }
    for (settings, why) in &row.skipped {
        println!(
            "      {axis:<11} skipped, {settings}: {}",
            why.replace('\n', "\n      ")
        );
    }
}

fn print_skipped(left: &SkippedScene) {
    let other = left.other_reference.as_ref();
    let other = other.map(|other| format!("{other} has a stored reference of this scene; "));
    println!(
        "skipped   {:<30} {}{}",
        left.scene,
        other.unwrap_or_default(),
        left.reason.replace('\n', "\n      "),
    );
}

fn print_summary(summary: &Summary, folder: &Path) {
    println!(
        "\n{}: {} passed, {} confirmed by the oracle, {} failed, {} undecided, {} skipped; {} explained, {} unexplained, {} not finite; median interior error {}; references {}; {:.1} s",
        counted(summary.cases, "case"),
        summary.passed,
        summary.confirmed,
        summary.failed,
        summary.undecided,
        counted(summary.skipped, "scene"),
        counted(summary.explained, "pixel"),
        summary.unexplained,
        counted(summary.nonfinite, "value"),
        summary
            .median_rel_rmse_interior
            .map_or_else(|| "-".to_owned(), |m| format!("{m:.2e}")),
        summary.references,
        summary.seconds,
    );
    let Tally {
        passed,
        failed,
        skipped,
    } = summary.matrix;
    if summary.matrix != Tally::default() {
        println!(
            "matrix: {} passed, {failed} failed, {skipped} skipped",
            counted(passed, "setting")
        );
    }
    println!("report: {}", folder.join("index.html").display());
}
