//! `gallery`: models of other programs, rendered beside Mitsuba and three.js, as a page.

use clap::Args;
use serde_json::{Value, json};
use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::{Duration, Instant};
use whitstone::commands::cluster::Cluster;
use whitstone::commands::validate::parts::validate_each;
use whitstone::core::{Note, Registry, Treatment};
use whitstone::image::atomic;
use whitstone::scene::{Description, Sources};
use whitstone::validate::opinion::{Ask, OraclePolicy};
use whitstone::validate::{CaseResult, Installation, Mode, Options, REFERENCES, Renderer, Status, Validator};
use whitstone::{Exit, Failure};

/// The program of the tests that renders with three.js.
const THREE: &str = "tests/independent/gallery.py";
/// The Python that `tests/independent/run` installs.
const PYTHON: &str = "target/independent/python/bin/python";
/// Extensions of models.
const MODELS: [&str; 2] = ["glb", "gltf"];

/// Render models beside Mitsuba and three.js, and write a page with the pictures, the errors, what
/// was approximated and dropped, and the times
///
/// Models whose files are invalid are listed with the error. Exit code 1 if an image fails.
#[derive(Args, Debug)]
#[command(
    help_template = whitstone::commands::HELP_TEMPLATE,
    after_help = "Examples:\n  cargo xtask gallery model.glb\n  cargo xtask gallery ~/glTF-Sample-Assets/Models -o gallery"
)]
pub(crate) struct Arguments {
    /// Models, or folders that are searched for .glb and .gltf [default: the folder gltf in the
    /// folder that WHITSTONE_TEST_DATA names]
    #[arg(value_name = "MODEL")]
    models: Vec<PathBuf>,
    /// Folder for the page
    #[arg(short, long, value_name = "DIR", default_value = "target/gallery")]
    output: PathBuf,
    /// Width of the pictures in pixels
    #[arg(long, value_name = "PIXELS", default_value_t = 320)]
    width: usize,
    /// Time limit of the oracle per model in seconds
    #[arg(long, value_name = "SECONDS", default_value_t = 30)]
    oracle_time: u64,
    /// No pictures of three.js
    #[arg(long)]
    no_three: bool,
    #[command(flatten)]
    cluster: Cluster,
}

/// A model on the page.
struct Entry {
    model: PathBuf,
    /// Name of its pictures, without what they show.
    stem: String,
    notes: Vec<Note>,
    import_s: f64,
    case: Option<CaseResult>,
    /// Why there is no image.
    error: Option<String>,
    size: (usize, usize),
}

/// Runs the command.
pub(crate) fn run(arguments: &Arguments, registry: &Registry) -> Result<Exit, Failure> {
    let models = find(&arguments.models)?;
    fs::create_dir_all(&arguments.output).map_err(Failure::environment)?;
    let mut entries: Vec<Entry> = Vec::new();
    for (model, number) in models.iter().zip(1..) {
        entries.push(Entry::import(model, format!("{number:03}"), arguments, registry));
    }
    if arguments.cluster.is_named() {
        on_cluster(&mut entries, arguments, registry)?;
    } else {
        let count = entries.len();
        for (entry, number) in entries.iter_mut().zip(1..) {
            eprintln!("{number} of {count}: {}", entry.model.display());
            if entry.error.is_none() {
                match validate(entry, arguments, registry) {
                    Ok(case) => entry.finish(case, &arguments.output),
                    Err(error) => entry.error = Some(error),
                }
            }
        }
    }
    if !arguments.no_three {
        three(&entries, &arguments.output)?;
    }
    let page = arguments.output.join("index.html");
    atomic::write_bytes(&page, html(&entries, &arguments.output).as_bytes()).map_err(Failure::environment)?;
    let with = |status: Status| {
        let cases = entries.iter().filter_map(|entry| entry.case.as_ref());
        cases.filter(|case| case.status == Some(status)).count()
    };
    println!(
        "{}: {} models: {} pass, {} confirmed, {} undecided, {} fail, {} cannot be rendered",
        page.display(),
        entries.len(),
        with(Status::Pass),
        with(Status::Confirmed),
        with(Status::Undecided),
        with(Status::Fail),
        entries.iter().filter(|entry| entry.case.is_none()).count()
    );
    Ok(if with(Status::Fail) > 0 {
        Exit::Differs
    } else {
        Exit::Pass
    })
}

/// The models that files and folders name, sorted.
fn find(given: &[PathBuf]) -> Result<Vec<PathBuf>, Failure> {
    let data = std::env::var_os("WHITSTONE_TEST_DATA").map(|data| Path::new(&data).join("gltf"));
    let given = match (given, data) {
        ([], None) => {
            let message = "name models or folders, or set WHITSTONE_TEST_DATA";
            return Err(Failure::usage(message));
        }
        ([], Some(folder)) => vec![folder],
        (given, _) => given.to_vec(),
    };
    let mut found = Vec::new();
    let mut folders = Vec::new();
    for path in given {
        if path.is_dir() {
            folders.push(path);
        } else {
            found.push(path);
        }
    }
    while let Some(folder) = folders.pop() {
        let entries = fs::read_dir(&folder)
            .map_err(|error| Failure::usage(format!("{}: {error}", folder.display())))?;
        for path in entries.flatten().map(|entry| entry.path()) {
            let extension = path.extension().and_then(|extension| extension.to_str());
            if path.is_dir() {
                folders.push(path);
            } else if extension.is_some_and(|extension| MODELS.contains(&extension)) {
                found.push(path);
            }
        }
    }
    found.sort();
    Ok(found)
}

impl Entry {
    /// Imports a model.
    fn import(model: &Path, stem: String, arguments: &Arguments, registry: &Registry) -> Self {
        let mut entry = Self {
            model: model.to_owned(),
            stem,
            notes: Vec::new(),
            import_s: 0.0,
            case: None,
            error: None,
            size: (arguments.width, arguments.width),
        };
        if let Err(error) = fill(&mut entry, arguments, registry) {
            entry.error = Some(error);
        }
        entry
    }

    /// The size of its picture, as overrides of the scene.
    fn overrides(&self) -> Vec<String> {
        let (width, height) = self.size;
        vec![format!("film.width={width}"), format!("film.height={height}")]
    }

    /// Takes the result, and writes the pictures.
    fn finish(&mut self, case: CaseResult, folder: &Path) {
        for (name, bytes) in case.pictures.iter().flat_map(|pictures| {
            [
                ("ours", &pictures.ours),
                ("reference", &pictures.reference),
                ("error", &pictures.error),
            ]
        }) {
            let path = folder.join(format!("{}-{name}.png", self.stem));
            if let Err(error) = atomic::write_bytes(&path, bytes) {
                self.error = Some(error.to_string());
            }
        }
        if case.compared {
            self.case = Some(case);
        } else {
            self.error = Some(case.problems.join("\n"));
        }
    }
}

/// Time limit of a request to Mitsuba, in seconds.
const TIME_LIMIT: u64 = 600;

/// Validates the models on a cluster.
fn on_cluster(entries: &mut [Entry], arguments: &Arguments, registry: &Registry) -> Result<(), Failure> {
    let good: Vec<usize> = (0..entries.len())
        .filter(|k| entries[*k].error.is_none())
        .collect();
    let scenes: Vec<(PathBuf, Vec<String>)> = good
        .iter()
        .map(|k| {
            let mut words = vec!["--reference=live".to_owned()];
            words.push(format!("--oracle-time={}", arguments.oracle_time));
            words.push(format!("--time-limit={TIME_LIMIT}"));
            let changes = entries[*k].overrides().into_iter();
            words.extend(changes.map(|change| format!("--set={change}")));
            (entries[*k].model.clone(), words)
        })
        .collect();
    validate_each(
        &arguments.cluster,
        "validating",
        &scenes,
        registry,
        &mut |k, results| {
            for case in results.results {
                entries[good[k]].finish(case, &arguments.output);
            }
        },
    )
}

/// Imports a model: its notes, the size of its picture, and the scene that it becomes.
fn fill(entry: &mut Entry, arguments: &Arguments, registry: &Registry) -> Result<(), String> {
    let begin = Instant::now();
    let sources = Sources::load(&entry.model, &[], registry)
        .map_err(|error| error.sources.report(&error.errors, false))?;
    let description = Description::parse(&sources).into_result();
    let description = description.map_err(|errors| sources.report(&errors, false))?;
    entry.import_s = begin.elapsed().as_secs_f64();
    entry.notes = (sources.notes().iter())
        .flat_map(|(_, notes)| notes.clone())
        .filter(|note| note.feature.treatment > Treatment::Kept)
        .collect();
    let document: toml::Table = description
        .flattened
        .text
        .parse()
        .map_err(|error| format!("{error}"))?;
    let film = |key: &str| document.get("film").and_then(|film| film.get(key)?.as_integer());
    // The picture has the shape of the film.
    let (width, height) = (
        film("width").unwrap_or(1) as f64,
        film("height").unwrap_or(1) as f64,
    );
    let height = (arguments.width as f64 * height / width).round().max(1.0) as usize;
    entry.size = (arguments.width, height);
    let scene = arguments.output.join(format!("{}.toml", entry.stem));
    atomic::write_bytes(&scene, description.flattened.text.as_bytes()).map_err(|error| error.to_string())
}

/// Renders and validates a model.
fn validate(entry: &Entry, arguments: &Arguments, registry: &Registry) -> Result<CaseResult, String> {
    let options = Options {
        scenes: PathBuf::from("scenes"),
        references: PathBuf::from(REFERENCES),
        installation: Installation::default(),
        renderer: Renderer::MITSUBA,
        target: PathBuf::from("target/whitstone"),
        mode: Mode::Live,
        reuse: false,
        threads: 0,
        overrides: entry.overrides(),
        ours_overrides: Vec::new(),
        shared_overrides: Vec::new(),
        time_limit: Duration::from_secs(TIME_LIMIT),
        program: "cargo xtask".to_owned(),
        flags: String::new(),
    };
    let mut validator =
        Validator::new(registry, options, &|text| eprintln!("{text}")).map_err(|error| error.to_string())?;
    validator.set_oracle(OraclePolicy {
        when: Ask::Needed,
        budget: Duration::from_secs(arguments.oracle_time),
    });
    Ok(validator.validate(&entry.model))
}

/// Renders the models with three.js, if it is installed.
fn three(entries: &[Entry], folder: &Path) -> Result<(), Failure> {
    let jobs: Vec<Value> = entries
        .iter()
        .filter(|entry| entry.case.is_some() && is_gltf(&entry.model))
        .map(|entry| {
            json!({
                "model": entry.model,
                "scene": folder.join(format!("{}.toml", entry.stem)),
                "width": entry.size.0,
                "height": entry.size.1,
                "png": folder.join(format!("{}-three.png", entry.stem)),
            })
        })
        .collect();
    if jobs.is_empty() {
        return Ok(());
    }
    if !Path::new(PYTHON).is_file() {
        eprintln!("skipped: three.js, which `tests/independent/run` installs");
        return Ok(());
    }
    let file = folder.join("jobs.json");
    fs::write(&file, Value::from(jobs).to_string()).map_err(Failure::environment)?;
    let status = Command::new(PYTHON).arg(THREE).arg(&file).status();
    if !status.map_err(Failure::environment)?.success() {
        eprintln!("skipped: three.js, which has failed");
    }
    Ok(())
}

fn is_gltf(path: &Path) -> bool {
    let extension = path.extension().and_then(|extension| extension.to_str());
    extension.is_some_and(|extension| MODELS.contains(&extension))
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;")
        .replace('<', "&lt;")
        .replace('>', "&gt;")
        .replace('"', "&quot;")
}

const HEAD: &str = "<!doctype html>
<html lang=\"en\">
<meta charset=\"utf-8\">
<title>Gallery</title>
<style>
body { font: 15px/1.4 system-ui, sans-serif; margin: 2em; max-width: 110em }
section { border-top: 1px solid #ccc; padding: 1em 0 }
h2 { font-size: 1.1em; margin: 0 0 .5em }
figure { display: inline-block; margin: 0 1em .5em 0 }
figcaption { color: #555 }
.dropped { color: #a00 }
pre { white-space: pre-wrap; color: #a00 }
</style>
<h1>Gallery</h1>
<p>Each model: Whitstone, Mitsuba by the driver with the same materials and lights, their relative
error, and three.js with its own materials and, where the file has no lights, the same ones.
three.js has no shadows and no reflections here.</p>
";

fn html(entries: &[Entry], folder: &Path) -> String {
    let mut text = HEAD.to_owned();
    for entry in entries {
        let name = escaped(&entry.model.display().to_string());
        let _ = writeln!(text, "<section>\n<h2>{name}</h2>");
        for (what, title) in [
            ("ours", "Whitstone"),
            ("reference", "Mitsuba"),
            ("error", "relative error, 1e-7 to 1e-1"),
            ("three", "three.js"),
        ] {
            let file = format!("{}-{what}.png", entry.stem);
            if folder.join(&file).is_file() {
                let _ = writeln!(
                    text,
                    "<figure><img src=\"{file}\" alt=\"{title}\"><figcaption>{title}</figcaption></figure>"
                );
            }
        }
        if let Some(case) = &entry.case {
            let status = case.status.map_or("not compared", Status::word);
            let _ = writeln!(
                text,
                "<p><b>{status}</b>: {}. Interior error {}; {} of {} pixels explained, {} unexplained.<br>\
                 Import {:.3} s, build {:.3} s, render {:.3} s; Mitsuba {}.</p>",
                escaped(&case.verdict),
                case.rel_rmse_interior
                    .map_or("–".to_owned(), |error| format!("{error:.1e}")),
                case.explained,
                case.width * case.height,
                case.unexplained,
                entry.import_s,
                case.build_s,
                case.render_s,
                case.reference_s
                    .map_or("–".to_owned(), |seconds| format!("{seconds:.3} s")),
            );
        }
        if !entry.notes.is_empty() {
            text.push_str("<ul>\n");
            for note in &entry.notes {
                let (class, word) = match note.feature.treatment {
                    Treatment::Dropped => ("dropped", "dropped"),
                    _ => ("", "approximated"),
                };
                let _ = writeln!(
                    text,
                    "<li class=\"{class}\">{word}: {} ({}): {}</li>",
                    escaped(note.feature.name),
                    note.places.len(),
                    escaped(note.feature.how)
                );
            }
            text.push_str("</ul>\n");
        }
        if let Some(error) = &entry.error {
            let _ = writeln!(text, "<pre>{}</pre>", escaped(error));
        }
        text.push_str("</section>\n");
    }
    text.push_str("</html>\n");
    text
}
