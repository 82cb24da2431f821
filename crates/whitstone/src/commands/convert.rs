//! `convert`: translates scenes between formats.

use super::render::check_apart;
use crate::terminal::{self, Exit, Failure, STDOUT, write_json};
use clap::Args;
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use whitstone_core::{
    ExportScene, FormatErrors, ImportOptions, Note, Registry, SceneFormat, Treatment, nearest,
};
use whitstone_scene::{Description, Sources};

/// Convert a scene to another format
///
/// Formats are known by the extensions of the files. The summary says what was kept, approximated
/// and dropped; docs/formats.md lists this for each format. Without an output file only the summary
/// is printed.
#[derive(Args, Debug)]
#[command(
    help_template = super::HELP_TEMPLATE,
    after_help = "Examples:\n  whitstone convert model.glb model.toml\n  whitstone convert model.glb\n  whitstone convert scene.toml scene.xml --strict"
)]
pub struct Arguments {
    /// File to convert
    input: PathBuf,
    /// File to write
    output: Option<PathBuf>,
    /// Format of the input [default: by its extension]
    #[arg(long, value_name = "FORMAT")]
    from: Option<String>,
    /// Format of the output [default: by its extension]
    #[arg(long, value_name = "FORMAT")]
    to: Option<String>,
    /// Override a value of the scene, as for `render`; can be repeated
    #[arg(long = "set", value_name = "PATH=VALUE")]
    overrides: Vec<String>,
    /// Scene to convert, by name or index, if the file has several
    #[arg(long, value_name = "NAME")]
    scene: Option<String>,
    /// Node to convert with everything below it, by name or index
    #[arg(long, value_name = "NAME")]
    node: Option<String>,
    /// Camera, by name or index [default: the first]
    #[arg(long, value_name = "NAME")]
    camera: Option<String>,
    /// Convert the intensities of lights from candela and lux, by 683 lm/W [default: the numbers
    /// are used as W/sr and W/m2]
    #[arg(long)]
    photometric: bool,
    /// Read files outside of the folder of the input
    #[arg(long)]
    allow_outside: bool,
    /// Refuse an input that names a file outside of this folder, also through a link [default:
    /// files that a TOML scene names may be anywhere]
    #[arg(long, value_name = "DIR", conflicts_with = "allow_outside")]
    root: Option<PathBuf>,
    /// Fail, and write nothing, if anything is dropped
    #[arg(long)]
    strict: bool,
    /// Write the summary to this file as JSON; - means standard output
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

/// Runs the command.
pub fn run(arguments: &Arguments, registry: &Registry) -> Result<Exit, Failure> {
    let color = terminal::color();
    let options = ImportOptions {
        format: arguments.from.clone(),
        scene: arguments.scene.clone(),
        node: arguments.node.clone(),
        camera: arguments.camera.clone(),
        photometric: arguments.photometric,
        allow_outside: arguments.allow_outside,
        root: arguments.root.clone(),
        ..ImportOptions::all()
    };
    if let Some(name) = &arguments.from {
        format(registry, name)?;
    }
    let writer = arguments
        .output
        .as_deref()
        .map(|output| writer(arguments, registry, output));
    let writer = writer.transpose()?;
    let sources = Sources::load_with(&arguments.input, &arguments.overrides, registry, &options)
        .map_err(|error| Failure::usage(error.sources.report(&error.errors, color)))?;
    let description = Description::parse(&sources)
        .into_result()
        .map_err(|errors| Failure::usage(sources.report(&errors, color)))?;
    let mut notes: Vec<Note> = sources
        .notes()
        .iter()
        .flat_map(|(_, notes)| notes.clone())
        .collect();
    let refuse = |notes: &[Note]| {
        let dropped = notes
            .iter()
            .filter(|note| note.feature.treatment == Treatment::Dropped)
            .map(|note| format!("{} ({})", note.feature.name, places(note)));
        let dropped: Vec<String> = dropped.collect();
        if dropped.is_empty() || !arguments.strict {
            return Ok(());
        }
        Err(Failure::usage(format!(
            "{}: dropped, and --strict forbids it: {}",
            arguments.input.display(),
            dropped.join("; ")
        )))
    };
    refuse(&notes)?;
    let json = (arguments.json.as_ref()).filter(|path| *path != Path::new(STDOUT));
    let outputs: Vec<&Path> = [arguments.output.as_ref(), json]
        .into_iter()
        .flatten()
        .map(PathBuf::as_path)
        .collect();
    let inputs = sources.scene_files().map(Path::to_owned);
    let inputs: Vec<PathBuf> = inputs.chain(description.flattened.files.clone()).collect();
    check_apart(&outputs, &inputs)?;
    if let (Some(output), Some(writer)) = (&arguments.output, writer) {
        let document = description.flattened.text.parse::<toml::Table>();
        let document = document.map_err(|error| Failure::usage(error.to_string()))?;
        let scene = ExportScene {
            document: &document,
            base: &description.flattened.base,
        };
        // What is dropped is known only after writing, so a strict run writes elsewhere first.
        let scratch = tempfile::tempdir().map_err(Failure::environment)?;
        if arguments.strict {
            let name = output.file_name().unwrap_or_default();
            let told = export(writer, &scene, &scratch.path().join(name), output)?;
            refuse(&told)?;
        }
        notes.extend(export(writer, &scene, output, output)?);
    }
    notes.sort_by_key(|note| note.feature.treatment);
    match &arguments.json {
        Some(file) => write_json(file, &summary(arguments, &notes))?,
        None => print(arguments, &notes),
    }
    Ok(Exit::Pass)
}

/// The format that writes the output.
fn writer<'r>(
    arguments: &Arguments,
    registry: &'r Registry,
    output: &Path,
) -> Result<&'r dyn SceneFormat, Failure> {
    match &arguments.to {
        Some(name) => format(registry, name),
        None => registry.format_of(output).ok_or_else(|| {
            let known: Vec<&str> = registry
                .formats()
                .flat_map(|format| format.extensions())
                .copied()
                .collect();
            Failure::usage(format!(
                "{}: unknown format; expected a file that ends in .{}",
                output.display(),
                known.join(", .")
            ))
        }),
    }
}

/// The format of this name.
fn format<'r>(registry: &'r Registry, name: &str) -> Result<&'r dyn SceneFormat, Failure> {
    registry
        .formats()
        .find(|format| format.name() == name)
        .ok_or_else(|| {
            let known: Vec<&str> = registry.formats().map(|format| format.name()).collect();
            let advice = match nearest(name, known.iter().copied()) {
                Some(near) => format!("did you mean \"{near}\"?"),
                None => format!("expected one of {}", known.join(", ")),
            };
            Failure::usage(format!("unknown format \"{name}\": {advice}"))
        })
}

fn export(
    writer: &dyn SceneFormat,
    scene: &ExportScene<'_>,
    path: &Path,
    shown: &Path,
) -> Result<Vec<Note>, Failure> {
    let Some(result) = writer.export(scene, path) else {
        let message = format!("the format {} can be read, but not written", writer.name());
        return Err(Failure::usage(message));
    };
    result.map_err(|FormatErrors(errors)| {
        let lines: Vec<String> = errors
            .iter()
            .map(|error| {
                let place = if error.place.is_empty() {
                    String::new()
                } else {
                    format!(", at {}", error.place)
                };
                let help = error
                    .help
                    .as_ref()
                    .map_or(String::new(), |help| format!("\n  {help}"));
                format!("{}{place}: {}{help}", shown.display(), error.message)
            })
            .collect();
        Failure::usage(lines.join("\n"))
    })
}

/// The name of a treatment as a heading.
pub(crate) fn heading(treatment: Treatment) -> &'static str {
    match treatment {
        Treatment::Kept => "kept",
        Treatment::Approximated => "approximated",
        Treatment::Dropped => "dropped",
    }
}

/// At most three places of a note.
fn places(note: &Note) -> String {
    let shown: Vec<&str> = note.places.iter().take(3).map(String::as_str).collect();
    let more = note.places.len() - shown.len();
    match more {
        0 => shown.join(", "),
        more => format!("{} and {more} more", shown.join(", ")),
    }
}

fn print(arguments: &Arguments, notes: &[Note]) {
    for treatment in [Treatment::Kept, Treatment::Approximated, Treatment::Dropped] {
        let of: Vec<&Note> = notes
            .iter()
            .filter(|note| note.feature.treatment == treatment)
            .collect();
        if of.is_empty() {
            continue;
        }
        println!("{}:", heading(treatment));
        for note in of {
            println!("  {} ({}): {}", note.feature.name, places(note), note.feature.how);
        }
    }
    match &arguments.output {
        Some(output) => println!("{} -> {}", arguments.input.display(), output.display()),
        None => println!("{}: nothing written", arguments.input.display()),
    }
}

fn summary(arguments: &Arguments, notes: &[Note]) -> Value {
    let of = |treatment: Treatment| -> Vec<Value> {
        let notes = notes.iter().filter(|note| note.feature.treatment == treatment);
        notes
            .map(|note| json!({ "feature": note.feature.name, "how": note.feature.how, "places": note.places }))
            .collect()
    };
    json!({
        "input": arguments.input,
        "output": arguments.output,
        "kept": of(Treatment::Kept),
        "approximated": of(Treatment::Approximated),
        "dropped": of(Treatment::Dropped),
    })
}
