//! The commands, one file each.

pub mod bake;
#[cfg(feature = "cluster")]
pub mod cluster;
pub mod compare;
pub mod completions;
pub mod conventions;
#[cfg(feature = "converge")]
pub mod converge;
pub mod convert;
pub mod doctor;
pub mod explain;
#[cfg(feature = "cluster")]
mod farm;
pub mod init;
mod junit;
pub mod list;
#[cfg(feature = "cluster")]
pub mod merge;
mod names;
pub mod new_plugin;
#[cfg(any(feature = "converge", feature = "stress"))]
mod page;
mod pixel;
#[cfg(feature = "cluster")]
pub mod plan;
pub mod reduce;
pub mod reference;
pub mod render;
pub mod report;
#[cfg(feature = "cluster")]
pub mod run_job;
pub mod schema;
pub mod sensitivity;
#[cfg(feature = "stress")]
pub mod stress;
pub mod validate;
#[cfg(feature = "view")]
pub mod view;

use crate::terminal::{self, Exit, Failure};
use clap::{Args, CommandFactory, FromArgMatches, Parser, Subcommand};
use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use whitstone_core::simd::Level;
use whitstone_core::{DuplicateType, ImportOptions, Note, Registry, Treatment, TreeLimits};
use whitstone_render::{BuildOptions, Cache, Pipeline, Region};
use whitstone_scene::{Plan, Sources};
use whitstone_validate::{Installation, TARGET};

/// A Whitted ray tracer that is validated against Mitsuba 3, pixel by pixel.
///
/// Exit codes: 0 success; 1 a comparison differs; 2 the command line, a scene or an input file is
/// wrong; 3 something that the command needs is missing or broken, such as a live Mitsuba; 130 and
/// 143 the command was interrupted by Ctrl-C or asked to terminate.
#[derive(Parser)]
#[command(version, arg_required_else_help = true, max_term_width = 100)]
struct Arguments {
    #[command(subcommand)]
    command: Command,
}

/// The template of help texts with examples: they come before the arguments.
pub const HELP_TEMPLATE: &str = "{about-with-newline}\n{usage-heading} {usage}{after-help}\n\n{all-args}";

/// The commands with their arguments.
#[derive(Subcommand)]
#[expect(
    missing_docs,
    reason = "clap would show documentation here instead of that of the arguments"
)]
pub enum Command {
    Render(render::Arguments),
    Validate(validate::Arguments),
    #[cfg(feature = "cluster")]
    Plan(plan::Arguments),
    #[cfg(feature = "cluster")]
    RunJob(run_job::Arguments),
    #[cfg(feature = "cluster")]
    Merge(merge::Arguments),
    Reduce(reduce::Arguments),
    Report(report::Arguments),
    Compare(Box<compare::Arguments>),
    Conventions(conventions::Arguments),
    Convert(convert::Arguments),
    Explain(explain::Arguments),
    #[cfg(feature = "stress")]
    Stress(stress::Arguments),
    #[cfg(feature = "converge")]
    Converge(converge::Arguments),
    Bake(bake::Arguments),
    List(list::Arguments),
    Schema(schema::Arguments),
    Sensitivity(sensitivity::Arguments),
    NewPlugin(new_plugin::Arguments),
    Init(init::Arguments),
    Doctor(doctor::Arguments),
    Completions(completions::Arguments),
    Reference(reference::Arguments),
    #[cfg(feature = "view")]
    View(view::Arguments),
}

impl Command {
    /// Runs the command. Messages call the executable `program`.
    pub fn run(&self, registry: &Registry, program: &str) -> Result<Exit, Failure> {
        Level::wanted().map_err(Failure::usage)?;
        match self {
            Self::Render(arguments) => render::run(arguments, registry),
            Self::Validate(arguments) => validate::run(arguments, registry, program),
            Self::Reduce(arguments) => reduce::run(arguments, registry, program),
            #[cfg(feature = "cluster")]
            Self::Plan(arguments) => plan::run(arguments, registry, program),
            #[cfg(feature = "cluster")]
            Self::RunJob(arguments) => run_job::run(arguments, registry, program),
            #[cfg(feature = "cluster")]
            Self::Merge(arguments) => merge::run(arguments),
            Self::Report(arguments) => report::run(arguments, program),
            Self::Compare(arguments) => compare::run(arguments),
            Self::Conventions(arguments) => conventions::run(arguments, registry),
            Self::Convert(arguments) => convert::run(arguments, registry),
            Self::Explain(arguments) => explain::run(arguments, registry),
            #[cfg(feature = "stress")]
            Self::Stress(arguments) => stress::run(arguments, registry),
            #[cfg(feature = "converge")]
            Self::Converge(arguments) => converge::run(arguments, registry, program),
            Self::Bake(arguments) => bake::run(arguments, registry),
            Self::List(arguments) => list::run(arguments, registry),
            Self::Init(arguments) => init::run(arguments, program),
            Self::NewPlugin(arguments) => new_plugin::run(arguments, registry),
            Self::Sensitivity(arguments) => sensitivity::run(arguments, registry, program),
            Self::Schema(arguments) => schema::run(arguments, registry),
            Self::Doctor(arguments) => doctor::run(arguments, registry),
            Self::Completions(arguments) => completions::run(arguments, Arguments::command(), program),
            Self::Reference(arguments) => reference::run(arguments, registry, program),
            #[cfg(feature = "view")]
            Self::View(arguments) => view::run(arguments, registry),
        }
    }
}

/// The command line and its plugins. A third party adds its own:
///
/// ```no_run
/// # fn register(_: &mut whitstone::core::Registry) -> Result<(), whitstone::core::DuplicateType> { Ok(()) }
/// fn main() -> std::process::ExitCode {
///     whitstone::Cli::new("whitstone").with(register).run()
/// }
/// ```
pub struct Cli {
    program: &'static str,
    registry: Registry,
    duplicate: Option<DuplicateType>,
}

impl Cli {
    /// A command line with all built-in plugins. Messages call the executable `program`.
    pub fn new(program: &'static str) -> Self {
        Self {
            program,
            registry: crate::registry(),
            duplicate: None,
        }
    }

    /// Says that this program is a library in the Python package `whitstone`, loaded by an
    /// interpreter. Jobs are identified by the hash of `library`, and run by `python -m whitstone`.
    #[must_use]
    pub fn in_python(self, library: PathBuf, python: PathBuf) -> Self {
        #[cfg(feature = "cluster")]
        crate::jobs::set_python(library, python);
        #[cfg(not(feature = "cluster"))]
        let _ = (library, python);
        self
    }

    /// Adds the plugins of a `register` function.
    #[must_use]
    pub fn with(mut self, register: fn(&mut Registry) -> Result<(), DuplicateType>) -> Self {
        if let Err(duplicate) = register(&mut self.registry) {
            self.duplicate.get_or_insert(duplicate);
        }
        self
    }

    /// Reads the arguments of the process and runs the command.
    pub fn run(self) -> ExitCode {
        self.run_with(std::env::args_os().skip(1)).into()
    }

    /// Runs the command of these arguments, and returns the exit code. A wrong command line and
    /// `--help` end the process.
    pub fn run_with(self, arguments: impl IntoIterator<Item = OsString>) -> u8 {
        if let Some(duplicate) = self.duplicate {
            return terminal::finish(Err(Failure::usage(duplicate)));
        }
        crate::interrupt::watch();
        let arguments = compare::with_two_hyphens(arguments.into_iter());
        let all = std::iter::once(OsString::from(self.program)).chain(arguments);
        let matches = Arguments::command().name(self.program).get_matches_from(all);
        let arguments = match Arguments::from_arg_matches(&matches) {
            Ok(arguments) => arguments,
            Err(error) => error.exit(),
        };
        if let Err(error) = whitstone_render::start_threads() {
            return terminal::finish(Err(Failure::environment(error)));
        }
        terminal::finish(arguments.command.run(&self.registry, self.program))
    }
}

/// Parses a number of threads. The limit exists because more threads than any machine has only wait
/// for each other, and starting tens of thousands can exhaust the machine.
fn threads(text: &str) -> Result<usize, String> {
    match text.parse() {
        Ok(count) if count <= 1024 => Ok(count),
        _ => Err("expected a whole number from 0 to 1024; 0 means one thread per core".to_owned()),
    }
}

/// Parses a size in GiB; returns bytes.
fn gib(text: &str) -> Result<u64, String> {
    match text.parse::<f64>() {
        Ok(gib) if gib > 0.0 && gib <= 1e9 => Ok((gib * (1u64 << 30) as f64) as u64),
        _ => Err("expected a number of GiB above 0 and at most 1e9, such as 4 or 0.5".to_owned()),
    }
}

/// Parses a finite number.
pub(crate) fn finite(text: &str) -> Result<f64, String> {
    let value: f64 = text.parse().map_err(|_| "expected a number".to_owned())?;
    if value.is_finite() {
        Ok(value)
    } else {
        Err("expected a finite number".to_owned())
    }
}

/// Parses a finite number greater than 0.
#[cfg(feature = "converge")]
fn positive(text: &str) -> Result<f64, String> {
    match finite(text)? {
        value if value > 0.0 => Ok(value),
        _ => Err("expected a number greater than 0".to_owned()),
    }
}

/// A scene on the command line.
#[derive(Args, Clone, Debug)]
pub struct SceneArguments {
    /// Scene file (TOML), or a file of another format such as .glb
    pub scene: PathBuf,
    /// Camera of a file of another format, by name or index [default: the first]
    #[arg(long, value_name = "NAME")]
    pub camera: Option<String>,
    /// Override a value of the scene: `camera.fov=30`, `shape.glass.radius=0.5`,
    /// `'film={width=64,height=64}'`; can be repeated
    #[arg(long = "set", value_name = "PATH=VALUE")]
    pub overrides: Vec<String>,
    /// Refuse a scene that names a file outside of this folder, also through a link [default: files
    /// may be anywhere]
    #[arg(long, value_name = "DIR")]
    pub root: Option<PathBuf>,
    /// Reject a scene whose meshes and accelerators need more memory than this, in GiB [default:
    /// the available memory]
    #[arg(long, value_name = "GIB", value_parser = gib)]
    pub max_memory: Option<u64>,
    /// Stop where one sample of a pixel becomes more rays than this, by reflection and refraction
    #[arg(long, value_name = "RAYS", default_value_t = TreeLimits::default().rays, value_parser = clap::value_parser!(u32).range(1..))]
    pub max_tree_rays: u32,
    #[command(flatten)]
    pub(crate) target: Target,
    /// Ignore cached files and build them again
    #[arg(long)]
    pub fresh: bool,
}

/// Selects the folder of results.
#[derive(Args, Clone, Debug, Default)]
// Unnamed groups, because these are parts of several commands.
#[group(skip)]
pub struct Target {
    /// Folder for results and caches [default: target/whitstone]; also for the drivers of the
    /// references and the Python environment of Mitsuba, which are otherwise in the user's cache
    /// folder
    #[arg(long, value_name = "DIR")]
    target: Option<PathBuf>,
    /// A folder for results and caches only, of a part of a command.
    #[arg(skip)]
    scratch: Option<PathBuf>,
}

impl Target {
    /// The folder.
    pub fn folder(&self) -> &Path {
        let folder = self.scratch.as_deref().or(self.target.as_deref());
        folder.unwrap_or(Path::new(TARGET))
    }

    /// Sets the folder of a part of a command; returns false if the command line names one.
    #[cfg(feature = "cluster")]
    fn be_part(&mut self, scratch: &Path) -> bool {
        self.scratch = Some(scratch.to_owned());
        self.target.is_none()
    }

    /// Where private Python environments are.
    fn installation(&self) -> Installation {
        self.target.clone().map(Installation::at).unwrap_or_default()
    }
}

/// Selects the drivers of the references.
#[derive(Args, Clone, Debug)]
#[group(skip)]
pub struct Drivers {
    /// Python with an installed Mitsuba, to be used in place of the private environment
    #[arg(long, value_name = "PYTHON")]
    mitsuba: Option<PathBuf>,
    /// Folder with the drivers of the references, in place of the built-in ones
    #[arg(long, value_name = "DIR")]
    drivers: Option<PathBuf>,
}

impl Drivers {
    /// Sets the Python of a part of a command; returns false if the command line names drivers.
    #[cfg(feature = "cluster")]
    fn be_part(&mut self, mitsuba: Option<&Path>) -> bool {
        let is_plain = self.mitsuba.is_none() && self.drivers.is_none();
        self.mitsuba = mitsuba.map(Path::to_owned);
        is_plain
    }

    /// Refuses a folder with drivers, which workers do not have.
    #[cfg(feature = "cluster")]
    fn check_built_in(&self) -> Result<(), Failure> {
        match self.drivers {
            None => Ok(()),
            Some(_) => Err(Failure::usage(
                "--drivers cannot be used with --cluster: workers use the drivers in the program",
            )),
        }
    }

    /// Where the drivers are.
    pub fn installation(&self, target: &Target) -> Installation {
        Installation {
            drivers: self.drivers.clone(),
            mitsuba: self.mitsuba.clone(),
            ..target.installation()
        }
    }
}

/// Builds a scene. The error is a report of everything that is wrong with it.
pub fn build(arguments: &SceneArguments, registry: &Registry) -> Result<Pipeline, Failure> {
    let (pipeline, ()) = build_with(arguments, registry, None, |_| ())?;
    Ok(pipeline)
}

/// Like [`build`], for a part of the image, and also returns the result of `note` for the planned
/// scene.
pub fn build_with<T>(
    arguments: &SceneArguments,
    registry: &Registry,
    region: Option<Region>,
    note: impl FnOnce(&Plan<'_, '_>) -> T,
) -> Result<(Pipeline, T), Failure> {
    let color = terminal::color();
    let options = ImportOptions {
        camera: arguments.camera.clone(),
        root: arguments.root.clone(),
        max_memory: arguments.max_memory,
        ..ImportOptions::all()
    };
    let sources = Sources::load_with(&arguments.scene, &arguments.overrides, registry, &options)
        .map_err(|error| Failure::usage(error.sources.report(&error.errors, color)))?;
    for (path, notes) in sources.notes() {
        tell_losses(path, notes);
    }
    let bar = terminal::spinner("building");
    let progress = |what: &str| terminal::set_message(&bar, &format!("building {what}"));
    let kept = arguments.target.folder().join("kept");
    let options = BuildOptions {
        max_memory: arguments.max_memory,
        max_tree_rays: Some(arguments.max_tree_rays),
        cache: Some(Cache {
            folder: &kept,
            reuse: !arguments.fresh,
        }),
        progress: Some(&progress),
        region,
        single_image: true,
        ..BuildOptions::default()
    };
    let built = Pipeline::load_and(&sources, registry, options, note);
    bar.finish_and_clear();
    let (pipeline, note) = built.map_err(|errors| Failure::usage(sources.report(&errors, color)))?;
    if !pipeline.warnings.is_empty() {
        eprintln!("{}", sources.report_warnings(&pipeline.warnings, color));
    }
    Ok((pipeline, note))
}

/// Prints what an import approximated and dropped, as one line on standard error.
fn tell_losses(path: &Path, notes: &[Note]) {
    let of = |treatment: Treatment| {
        let names = notes.iter().filter(|note| note.feature.treatment == treatment);
        let names: Vec<&str> = names.map(|note| note.feature.name).collect();
        let what = convert::heading(treatment);
        (!names.is_empty()).then(|| format!("{what}: {}", names.join(", ")))
    };
    let told: Vec<String> = [Treatment::Approximated, Treatment::Dropped]
        .into_iter()
        .filter_map(of)
        .collect();
    if !told.is_empty() {
        eprintln!("{}: {}", path.display(), told.join("; "));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use whitstone_core::Shapes;

    #[test]
    fn a_duplicate_type_is_rejected_and_both_crates_are_named() {
        let again =
            |registry: &mut Registry| registry.add::<Shapes, whitstone_shapes::sphere::Sphere>("stranger");
        let message = Cli::new("mine")
            .with(again)
            .duplicate
            .map(|duplicate| duplicate.to_string());
        let expected = "shape type \"sphere\" is registered twice: by whitstone-shapes and by stranger";
        assert_eq!(message.as_deref(), Some(expected));
        assert!(Cli::new("mine").with(|_| Ok(())).duplicate.is_none());
    }
}
