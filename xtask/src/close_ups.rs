//! `close-ups`: the scenes of studies/scenes/close_ups, each at a value of the parameter of a
//! family of `stress` at which renderers break.
//!
//! docs/stability.md shows how Whitstone, Mitsuba and textbook formulas render them. Whitstone and
//! the formulas render anew in each `readme`. Mitsuba's pictures are stored, so that `readme` needs
//! no Mitsuba; [`RECORD`] has the hash of the scene that each shows, and the hash of its file.

mod textbook;

use crate::diagrams::{GAP, picture};
use crate::labels::{self, LINE, PAPER};
use crate::pictures::{Update, hash_of, names, scene_hash};
use clap::Args;
use serde_json::{Value, json};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use whitstone::core::Registry;
use whitstone::image::{Limits, Raster, ToneMap, atomic, picture as files};
use whitstone::{Exit, Failure};

/// The scenes. Each has the name of a family, and begins with a comment that is its title.
const FOLDER: &str = "studies/scenes/close_ups";
/// Mitsuba's pictures, and nothing else but the record.
const STORED: &str = "docs/images/close_ups";
/// What they show.
const RECORD: &str = "docs/images/close_ups/record.json";
/// The picture of all.
const SHEET: &str = "docs/images/close-ups.jpg";
const JPEG: u8 = 90;
/// The page with the table of families.
const PAGE: &str = "docs/stability.md";
/// Mitsuba with its own cameras, shapes and integrators, and without this project's driver.
const STOCK: &str = "subjects/mitsuba_stock.py";

/// Render the scenes of studies/scenes/close_ups with Mitsuba, for docs/stability.md
///
/// The next `readme` shows the pictures next to those of Whitstone and of textbook formulas.
#[derive(Args, Debug)]
#[command(
    help_template = whitstone::commands::HELP_TEMPLATE,
    after_help = "Examples:\n  cargo xtask close-ups --mitsuba python3"
)]
pub(crate) struct Arguments {
    /// A Python interpreter that has Mitsuba 3 and NumPy
    #[arg(long, value_name = "PYTHON")]
    mitsuba: PathBuf,
}

/// Runs the command.
pub(crate) fn run(arguments: &Arguments, registry: &Registry) -> Result<Exit, Failure> {
    let version =
        output(Command::new(&arguments.mitsuba).args(["-c", "import mitsuba; print(mitsuba.__version__)"]))?;
    fs::create_dir_all(STORED).map_err(Failure::environment)?;
    let mut record = serde_json::Map::new();
    for name in names(FOLDER)? {
        let folder = tempfile::tempdir().map_err(Failure::environment)?;
        let image = folder.path().join("image.pfm");
        output(
            Command::new(&arguments.mitsuba)
                .arg(STOCK)
                .arg(scene(&name))
                .arg(&image),
        )?;
        let image = files::read(&image, Limits::IMAGE)
            .map_err(Failure::environment)?
            .image;
        let raster = Raster::preview(&image, ToneMap::default()).map_err(Failure::environment)?;
        let bytes = raster.to_png().map_err(Failure::environment)?;
        atomic::write_bytes(stored(&name), &bytes).map_err(Failure::environment)?;
        println!("{}: written", stored(&name).display());
        let shown = json!({
            "file": hash_of(&bytes),
            "mitsuba": version.trim(),
            "scene": scene_hash(registry, &scene(&name), &[])?,
        });
        record.insert(name, shown);
    }
    let record = format!("{:#}\n", Value::Object(record));
    atomic::write_bytes(RECORD, record.as_bytes()).map_err(Failure::environment)?;
    Ok(Exit::Pass)
}

/// What a program prints.
fn output(command: &mut Command) -> Result<String, Failure> {
    let program = command.get_program().display().to_string();
    let told = |why: String| Failure::environment(format!("{program}: {why}"));
    let output = command.output().map_err(|error| told(error.to_string()))?;
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    match output.status.success() {
        true => Ok(text(&output.stdout)),
        false => Err(told(format!(
            "{}: {}{}",
            output.status,
            text(&output.stdout),
            text(&output.stderr)
        ))),
    }
}

fn scene(name: &str) -> PathBuf {
    Path::new(FOLDER).join(name).with_extension("toml")
}

fn stored(name: &str) -> PathBuf {
    Path::new(STORED).join(name).with_extension("png")
}

/// The sheet of all scenes, a row for each, and what is wrong with the stored pictures.
pub(crate) fn update(registry: &Registry) -> Result<Update, Failure> {
    let names = names(FOLDER)?;
    let record: Value = fs::read(RECORD).map_or(Value::Null, |bytes| {
        serde_json::from_slice(&bytes).unwrap_or_default()
    });
    let mut problems = strangers(&names);
    let table = fs::read_to_string(PAGE).map_err(Failure::environment)?;
    let mut rows = Vec::new();
    let mut versions = Vec::new();
    for name in &names {
        let path = scene(name);
        if !table.contains(&format!("\n| {name} | ")) {
            problems.push(format!("{}: {PAGE} lists no family of this name", path.display()));
        }
        let bytes = fs::read(stored(name)).unwrap_or_default();
        let shown = &record[name];
        if shown["scene"] != scene_hash(registry, &path, &[])? || shown["file"] != hash_of(&bytes) {
            problems.push(format!(
                "{}: does not show {}; run `cargo xtask close-ups --mitsuba PYTHON`",
                stored(name).display(),
                path.display()
            ));
            continue;
        }
        versions.push(shown["mitsuba"].as_str().unwrap_or_default());
        let decoded = files::decode(&bytes, Limits::IMAGE)
            .map_err(Failure::environment)?
            .image;
        let planes = decoded.rgb().map_err(Failure::environment)?;
        let code = |value: f32| (255.0 * value).round() as u8;
        let theirs = Raster::from_fn(decoded.width(), decoded.height(), |x, y| {
            planes.map(|plane| code(plane[y * decoded.width() + x]))
        });
        let pictures = [
            picture(registry, &path.display().to_string(), &[])?,
            theirs,
            textbook::picture::<f64>(registry, &path)?,
            textbook::picture::<f32>(registry, &path)?,
        ];
        rows.push((title(&path)?, pictures));
    }
    versions.dedup();
    let mitsuba = format!("Mitsuba {}", versions.join(", "));
    let columns = [
        "Whitstone",
        mitsuba.as_str(),
        "textbook, double",
        "textbook, single",
    ];
    let bytes = sheet(&columns, &rows)
        .to_jpeg(JPEG)
        .map_err(Failure::environment)?;
    Ok(Update {
        files: vec![(PathBuf::from(SHEET), bytes)],
        problems,
    })
}

/// The first line of a scene, without the sign of a comment.
fn title(scene: &Path) -> Result<String, Failure> {
    let text = fs::read_to_string(scene).map_err(Failure::environment)?;
    let first = text.lines().next().and_then(|line| line.strip_prefix("# "));
    let told = || Failure::usage(format!("{}:1:1: expected a comment, the title", scene.display()));
    first.map(str::to_owned).ok_or_else(told)
}

/// Files that show no scene.
fn strangers(names: &[String]) -> Vec<String> {
    let files = fs::read_dir(STORED).into_iter().flatten().flatten();
    let is_known =
        |path: &PathBuf| path == Path::new(RECORD) || names.iter().any(|name| *path == stored(name));
    let strangers = files.map(|entry| entry.path()).filter(|path| !is_known(path));
    strangers
        .map(|path| format!("{}: shows no scene in {FOLDER}; delete it", path.display()))
        .collect()
}

/// Pictures of equal size below the titles of columns, each row below its own title.
fn sheet<const N: usize>(columns: &[&str; N], rows: &[(String, [Raster; N])]) -> Raster {
    let size = |of: fn(&Raster) -> usize| rows.iter().flat_map(|(_, row)| row.iter().map(of)).max();
    let width = size(Raster::width).unwrap_or(1) + GAP;
    let height = size(Raster::height).unwrap_or(1) + LINE + GAP;
    let mut all = Raster::filled(N * width - GAP, LINE + rows.len() * height, PAPER);
    for (k, text) in columns.iter().enumerate() {
        labels::write(&mut all, text, [k * width + 2, 0]);
    }
    for (j, (title, row)) in rows.iter().enumerate() {
        let top = LINE + j * height;
        labels::write(&mut all, title, [2, top]);
        for (k, picture) in row.iter().enumerate() {
            all.draw(picture, k * width, top + LINE);
        }
    }
    all
}
