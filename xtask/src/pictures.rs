//! `pictures`: renders the scenes of scenes/pictures, which are composed to be looked at.
//!
//! The documentation shows them too: docs/pictures.md, and one at the top of README.md.
//! These copies take minutes to render, so `readme` renders only those whose scene has changed, and
//! `readme --check` renders none: [`RECORD`] has the hash of the scene that each copy shows, and
//! the hash of the copy itself.

use crate::readme;
use clap::Args;
use serde_json::{Value, json};
use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};
use whitstone::core::Registry;
use whitstone::image::{Image, Raster, ToneCurve, ToneMap, atomic};
use whitstone::picture::Quality;
use whitstone::scene::{Description, Sources};
use whitstone::validate::find_scenes;
use whitstone::{Exit, Failure};

/// The scenes.
const FOLDER: &str = "scenes/pictures";
/// The copies for the documentation, and nothing else.
const COPIES: &str = "docs/images/pictures";
/// What the copies show.
pub(crate) const RECORD: &str = "docs/images/pictures/record.json";
/// The page with all pictures.
const PAGE: &str = "docs/pictures.md";
/// Exposure of all pictures in stops. With it, the filmic curve shows a grey of 18 % about as the
/// curve `clamp` does.
const EXPOSURE: f64 = 0.5;
/// Quality of JPEG files.
pub(crate) const JPEG: u8 = 90;
/// Maximum size of a copy in bytes.
const MAX_BYTES: usize = 400 << 10;

/// Width and quality of the copies.
const COPY: (u32, Quality) = (960, Quality::Good);

/// Render the showcase pictures, the scenes in scenes/pictures, as PNG files
///
/// With 1280 pixels and quality `best` each takes several minutes. Validate one at this size with
/// `validate scenes/pictures/NAME.toml --set film.width=1280 --set film.height=720`.
#[derive(Args, Debug)]
#[command(
    help_template = whitstone::commands::HELP_TEMPLATE,
    after_help = "Examples:\n  cargo xtask pictures\n  cargo xtask pictures whisky --width 1920 --quality good"
)]
pub(crate) struct Arguments {
    /// Names of scenes in scenes/pictures [default: all]
    #[arg(value_name = "NAME")]
    names: Vec<String>,
    /// Width in pixels; the height follows from the scene
    #[arg(long, value_name = "PIXELS", default_value_t = 1280, value_parser = clap::value_parser!(u32).range(16..=16384))]
    width: u32,
    /// The sampler, as of `render --quality`
    #[arg(long, value_name = "QUALITY", default_value = "best")]
    quality: Quality,
    /// Folder for the pictures
    #[arg(short, long, value_name = "DIR", default_value = "target/pictures")]
    output: PathBuf,
}

/// Runs the command.
pub(crate) fn run(arguments: &Arguments, registry: &Registry) -> Result<Exit, Failure> {
    fs::create_dir_all(&arguments.output).map_err(Failure::environment)?;
    let all = names(FOLDER)?;
    if let Some(unknown) = arguments.names.iter().find(|name| !all.contains(name)) {
        return Err(Failure::usage(format!(
            "there is no picture `{unknown}`; expected one of: {}",
            all.join(", ")
        )));
    }
    let names = match &*arguments.names {
        [] => &all[..],
        names => names,
    };
    for name in names {
        let raster = render(registry, name, (arguments.width, arguments.quality))?;
        let path = arguments.output.join(name).with_extension("png");
        raster.write_png(&path).map_err(Failure::environment)?;
        println!("{}: written", path.display());
    }
    Ok(Exit::Pass)
}

/// The names of all scenes in a folder, sorted.
pub(crate) fn names(folder: &str) -> Result<Vec<String>, Failure> {
    let scenes = find_scenes(&[PathBuf::from(folder)]).map_err(Failure::environment)?;
    let stem = |path: &PathBuf| Some(path.file_stem()?.to_str()?.to_owned());
    let mut names: Vec<String> = scenes.iter().filter_map(stem).collect();
    names.sort();
    Ok(names)
}

fn scene(name: &str) -> PathBuf {
    Path::new(FOLDER).join(name).with_extension("toml")
}

fn copy(name: &str) -> PathBuf {
    Path::new(COPIES).join(name).with_extension("jpg")
}

/// The overrides of a scene for a picture of this size: all films have the shape 16 to 9.
fn overrides((width, quality): (u32, Quality)) -> [String; 3] {
    [
        format!("film.width={width}"),
        format!("film.height={}", (width * 9).div_ceil(16)),
        quality.sampler().to_owned(),
    ]
}

fn render(registry: &Registry, name: &str, size: (u32, Quality)) -> Result<Raster, Failure> {
    let (film, hash) = readme::render(registry, &scene(name), &overrides(size))?;
    raster(&film.to_image(&hash).map_err(Failure::usage)?)
}

/// An image with the tone curve of all pictures.
pub(crate) fn raster(image: &Image) -> Result<Raster, Failure> {
    let tone = ToneMap {
        exposure: EXPOSURE,
        curve: ToneCurve::Filmic,
    };
    Raster::preview(image, tone).map_err(Failure::usage)
}

/// The hash of the scene that a copy shows, with the overrides.
fn hash(registry: &Registry, name: &str) -> Result<String, Failure> {
    scene_hash(registry, &scene(name), &overrides(COPY))
}

/// The hash of a scene with overrides, which is not built.
pub(crate) fn scene_hash(registry: &Registry, scene: &Path, overrides: &[String]) -> Result<String, Failure> {
    let sources = Sources::load(scene, overrides, registry)
        .map_err(|error| Failure::usage(error.sources.report(&error.errors, false)))?;
    let description = Description::parse(&sources).into_result();
    let description = description.map_err(|errors| Failure::usage(sources.report(&errors, false)))?;
    Ok(description.flattened.hash)
}

/// The hash of a file.
pub(crate) fn hash_of(bytes: &[u8]) -> String {
    blake3::hash(bytes).to_hex()[..32].to_owned()
}

/// The hash of a copy as it is on disk; empty if there is none.
fn present(name: &str) -> String {
    fs::read(copy(name)).map_or(String::new(), |bytes| hash_of(&bytes))
}

/// What `readme` writes and tells.
#[derive(Default)]
pub(crate) struct Update {
    /// Files and their contents.
    pub(crate) files: Vec<(PathBuf, Vec<u8>)>,
    /// What is wrong with the copies.
    pub(crate) problems: Vec<String>,
}

/// The page, and with `check` what is wrong with the copies; without it, they are rendered where
/// their scenes have changed.
pub(crate) fn update(registry: &Registry, check: bool) -> Result<Update, Failure> {
    let old = fs::read(RECORD).ok();
    let old: Value = old.map_or(Value::Null, |bytes| {
        serde_json::from_slice(&bytes).unwrap_or_default()
    });
    let mut record = serde_json::Map::new();
    let names = match Path::new(FOLDER).is_dir() {
        true => names(FOLDER)?,
        false => return Ok(Update::default()),
    };
    let mut problems = strangers(&names);
    for name in &names {
        let scene_hash = hash(registry, name)?;
        let is_current = |record: &Value| record["scene"] == scene_hash && record["file"] == present(name);
        if !is_current(&old[name]) {
            if check {
                problems.push(stale(name));
            } else {
                eprintln!("rendering {}", copy(name).display());
                write(name, &render(registry, name, COPY)?)?;
            }
        }
        record.insert(
            name.clone(),
            // In alphabetical order, which some builds of the JSON library make anyway.
            json!({ "file": present(name), "scene": scene_hash }),
        );
    }
    let record = format!("{:#}\n", Value::Object(record));
    let files = vec![
        (PathBuf::from(RECORD), record.into_bytes()),
        (PathBuf::from(PAGE), page(&names)?.into_bytes()),
    ];
    Ok(Update { files, problems })
}

fn stale(name: &str) -> String {
    let path = copy(name);
    format!("{}: out of date; run `cargo xtask readme`", path.display())
}

/// Copies of scenes that no longer exist.
fn strangers(names: &[String]) -> Vec<String> {
    let files = fs::read_dir(COPIES)
        .into_iter()
        .flatten()
        .flatten()
        .map(|entry| entry.path());
    let is_known = |path: &PathBuf| {
        let of = |name: &str| *path == copy(name);
        path == Path::new(RECORD) || names.iter().any(|name| of(name))
    };
    let strangers = files.filter(|path| !is_known(path));
    strangers
        .map(|path| format!("{}: shows no scene in {FOLDER}; delete it", path.display()))
        .collect()
}

fn write(name: &str, raster: &Raster) -> Result<(), Failure> {
    fs::create_dir_all(COPIES).map_err(Failure::environment)?;
    let bytes = raster.to_jpeg(JPEG).map_err(Failure::environment)?;
    if bytes.len() > MAX_BYTES {
        return Err(Failure::usage(format!(
            "{}: {} bytes; the limit is {MAX_BYTES}",
            copy(name).display(),
            bytes.len()
        )));
    }
    atomic::write_bytes(copy(name), &bytes).map_err(Failure::environment)
}

/// The page: each picture with the comment that its scene begins with.
fn page(names: &[String]) -> Result<String, Failure> {
    let mut text = String::from(
        "# Pictures\n\nThese scenes are composed to be looked at. `cargo xtask readme` renders the images on this\npage. The scene files have small films, 16 to 32 pixels wide, so that CI can validate them. These\ncommands render the scenes at 1280 pixels, validate the small versions against stored images of\nMitsuba, and of POV-Ray where Mitsuba lacks a shape, and validate one scene at full size against a\nlive Mitsuba, which takes minutes:\n\n```sh\ncargo xtask pictures             # 1280 pixels wide, `--quality best`, in target/pictures\ncargo xtask validate --reference stored scenes/pictures\ncargo xtask validate --reference povray-stored scenes/pictures/julia.toml\ncargo xtask validate --reference live --time-limit 2000 scenes/pictures/whisky.toml --set film.width=1280 --set film.height=720\n```\n\nThe tone curve is `render --tone-map filmic` with an exposure of half a stop. There is no indirect\ndiffuse light in Whitted's model: several area lights and a weak ambient light take its place.\n",
    );
    for name in names {
        let path = scene(name);
        let source = fs::read_to_string(&path).map_err(Failure::environment)?;
        let comment: Vec<&str> = source
            .lines()
            .map_while(|line| line.strip_prefix('#').map(str::trim))
            .collect();
        let title = name.replace('_', " ");
        let title = format!("{}{}", title[..1].to_uppercase(), &title[1..]);
        let _ = write!(
            text,
            "\n## {title}\n\n![{title}](images/pictures/{name}.jpg)\n\n{}\n\n[Scene](../{})\n",
            comment.join("\n"),
            path.display()
        );
    }
    Ok(text)
}
