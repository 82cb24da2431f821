//! `readme`: generates the pictures and the table of numbers in README.md from the stored
//! references.

use crate::bench::light_paths;
use crate::{
    close_ups, comparisons, course, diagrams, formats, fuzz, growth, lecture_scenes, licences, pages,
    pictures, plugins, reliability, run_time, scale, subjects, topics, traversal, variants, verdict,
    worst_cases,
};
use clap::Args;
use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Duration;
use whitstone::core::Registry;
use whitstone::core::simd::Level;
use whitstone::image::{Raster, ToneMap, atomic};
use whitstone::metrics::error_map::{ErrorView, trio};
use whitstone::render::{BuildOptions, Film, Pipeline, RenderOptions};
use whitstone::scene::Sources;
use whitstone::validate::opinion::{Ask, Opinion, OraclePolicy};
use whitstone::validate::stored::Stored;
use whitstone::validate::{
    CaseResult, Installation, Mode, Options, REFERENCES, Renderer, Status, Validator, find_scenes,
};
use whitstone::{Exit, Failure, wireframe};

const README: &str = "README.md";
const VALIDATION: &str = "docs/validation.md";
const BEGIN: &str = "<!-- numbers: written by `cargo xtask readme` -->";
const END: &str = "<!-- end of numbers -->";
const BEGIN_RUN_TIME: &str = "<!-- run time: written by `cargo xtask readme` -->";
const END_RUN_TIME: &str = "<!-- end of run time -->";
const BEGIN_WORST: &str = "<!-- worst cases: written by `cargo xtask readme` -->";
const END_WORST: &str = "<!-- end of worst cases -->";
const BEGIN_RATES: &str = "<!-- rates: written by `cargo xtask readme` -->";
const END_RATES: &str = "<!-- end of rates -->";
/// The scenes on the contact sheet, three per row.
const SHEET: [&str; 6] = [
    "classic",
    "nested_dielectrics",
    "textured_mesh",
    "facing_mirrors",
    "lecture_phong",
    "glass_mesh",
];
/// Pixels of a picture on the sheet.
const TILE: (usize, usize) = (288, 216);

/// The showcase scenes that are shown next to their references.
const TRIOS: [&str; 3] = ["classic", "room", "imported"];

/// Pictures of the bounds of accelerators: name, configuration, deepest level.
const BOUNDS: [(&str, &str, usize); 9] = [
    ("bvh", "type = \"bvh\"", 2),
    ("bvh2", "type = \"bvh2\"", 4),
    ("kdtree", "type = \"kdtree\"", 6),
    ("grid", "type = \"grid\", density = 1", 1),
    ("grid-2", "type = \"grid\", density = 1, levels = 2", 2),
    ("octree", "type = \"octree\"", 2),
    ("slab_bvh", "type = \"slab_bvh\"", 3),
    ("obb_bvh", "type = \"obb_bvh\"", 4),
    ("bsp", "type = \"bsp\"", 6),
];

/// Write all generated documentation
///
/// That is: the pictures and numbers of README.md and docs/validation.md, from the stored
/// references; docs/run-time.md, docs/growth.md, docs/lecture-scenes.md and the costs in
/// docs/scale.md, from the stored results of `bench sizes`, `bench growth`, `bench scale` and
/// others, and `scale`; the pictures of docs/accelerators.md; a page for every plugin in
/// docs/plugins; and the data of `list --json`. The showcase pictures of docs/pictures.md and
/// README.md, which take minutes, are rendered only where their scenes have changed, and never with
/// `--check`.
#[derive(Args, Debug)]
#[command(
    help_template = whitstone::commands::HELP_TEMPLATE,
    after_help = "Examples:\n  cargo xtask readme\n  cargo xtask readme --check"
)]
pub(crate) struct Arguments {
    /// Write nothing; print the files that would change, and exit with 1 if there are any
    #[arg(long)]
    check: bool,
}

/// Runs the command.
pub(crate) fn run(arguments: &Arguments, registry: &Registry) -> Result<Exit, Failure> {
    if Level::current() == Level::Avx512 {
        return without_avx512();
    }
    let cases = validate(registry, Renderer::MITSUBA)?;
    let others = validate(registry, Renderer::POVRAY)?;
    let times = all_stored(run_time::RESULTS)?;
    let rates = traversal::section(&all_stored(traversal::RESULTS)?);
    let worst = worst_cases::tables(&stored(worst_cases::RESULT)?);
    let numbers = [
        ((BEGIN, END), summary(&cases)),
        ((BEGIN_RUN_TIME, END_RUN_TIME), run_time::sentence(&times)),
    ];
    let valley = stored(lecture_scenes::VALLEY)?;
    let explaining = diagrams::all(registry)?;
    let mut files = vec![
        (PathBuf::from(README), page(README, &numbers)?),
        (
            PathBuf::from(VALIDATION),
            page(VALIDATION, &[((BEGIN, END), table(&cases))])?,
        ),
        (PathBuf::from(run_time::PAGE), run_time::page(&times).into_bytes()),
        (
            PathBuf::from(reliability::PAGE),
            reliability::page(&stored(reliability::RESULT)?, &stored(fuzz::RESULT)?).into_bytes(),
        ),
        (
            PathBuf::from(growth::PAGE),
            growth::page(
                &growth::RESULTS
                    .map(stored)
                    .into_iter()
                    .collect::<Result<Vec<_>, _>>()?,
            )
            .into_bytes(),
        ),
        (
            PathBuf::from(lecture_scenes::PAGE),
            lecture_scenes::page(
                &valley,
                &stored(lecture_scenes::LIGHTS)?,
                &stored(lecture_scenes::FRAMES)?,
            )
            .into_bytes(),
        ),
        (
            PathBuf::from(worst_cases::PAGE),
            page(
                worst_cases::PAGE,
                &[
                    ((BEGIN_WORST, END_WORST), worst),
                    ((BEGIN_RATES, END_RATES), rates),
                ],
            )?,
        ),
        (
            PathBuf::from(scale::PAGE),
            page(
                scale::PAGE,
                &[(scale::MARKS, scale::section(&stored(scale::RESULT)?))],
            )?,
        ),
        (
            PathBuf::from(subjects::PAGE),
            page(
                subjects::PAGE,
                &[
                    (subjects::MARKS, subjects::table(&all_stored(subjects::RESULTS)?)),
                    (
                        subjects::VALIDATED_MARKS,
                        subjects::validated(&stored(subjects::VALIDATED)?),
                    ),
                ],
            )?,
        ),
        (PathBuf::from("docs/images/showcase.png"), sheet(registry)?),
        (PathBuf::from(plugins::FILE), plugins::json(registry).into_bytes()),
        (
            PathBuf::from(licences::FILE),
            licences::text().map_err(Failure::environment)?.into_bytes(),
        ),
        (
            PathBuf::from(plugins::PACKAGE_FILE),
            plugins::package().map_err(Failure::environment)?.into_bytes(),
        ),
        (PathBuf::from(formats::PAGE), formats::page(registry).into_bytes()),
        (
            PathBuf::from(comparisons::PAGE),
            comparisons::page(registry, &stored(comparisons::RESULT)?)?.into_bytes(),
        ),
        (
            PathBuf::from(light_paths::PAGE),
            light_paths::page(registry)?.into_bytes(),
        ),
        (PathBuf::from(topics::PAGE), topics::page(&cases)?.into_bytes()),
        (
            PathBuf::from(variants::PAGE),
            variants::page(registry)?.into_bytes(),
        ),
    ];
    files.extend(explaining);
    files.extend(course::pictures(registry)?);
    for name in TRIOS {
        let path = PathBuf::from(format!("docs/images/{name}-trio.png"));
        files.push((path, trio_of(registry, name)?));
    }
    for (name, accelerator, deepest) in BOUNDS {
        let path = PathBuf::from(format!("docs/images/bounds-{name}.png"));
        files.push((path, bounds(registry, accelerator, deepest)?));
    }
    let examples = [("Mitsuba", &*cases), ("POV-Ray", &*others)];
    files.extend(pages::pages(registry, &examples, |example| {
        picture(registry, example)
    })?);
    let pictures = pictures::update(registry, arguments.check)?;
    let close_ups = close_ups::update(registry)?;
    let mut problems = strangers(&files);
    for update in [pictures, close_ups] {
        files.extend(update.files);
        problems.extend(update.problems);
    }
    problems.extend(lecture_scenes::problems(registry, &valley)?);
    for (path, bytes) in files {
        if std::fs::read(&path).is_ok_and(|found| found == bytes) {
            continue;
        }
        if arguments.check {
            problems.push(format!(
                "{}: out of date; run `cargo xtask readme`",
                path.display()
            ));
            continue;
        }
        if let Some(folder) = path.parent().filter(|folder| !folder.as_os_str().is_empty()) {
            std::fs::create_dir_all(folder).map_err(Failure::environment)?;
        }
        atomic::write_bytes(&path, &bytes).map_err(Failure::environment)?;
        println!("{}: written", path.display());
    }
    verdict(&problems, "readme: all generated files are up to date")
}

/// Runs this command again without AVX-512. With it, nodes of `bvh` have sixteen children instead
/// of eight; the picture of its boxes must be the same on every machine.
fn without_avx512() -> Result<Exit, Failure> {
    let program = std::env::current_exe().map_err(Failure::environment)?;
    let mut command = Command::new(program);
    command
        .args(std::env::args_os().skip(1))
        .env("WHITSTONE_SIMD", "avx2");
    let status = command.status().map_err(Failure::environment)?;
    match status.code() {
        Some(0) => Ok(Exit::Pass),
        Some(1) => Ok(Exit::Differs),
        _ => Err(Failure::environment(format!("readme without AVX-512: {status}"))),
    }
}

/// Folder of the stored results.
const STORED: &str = "studies/results";

/// All stored results whose names begin like this, in the order of their names.
fn all_stored(prefix: &str) -> Result<Vec<serde_json::Value>, Failure> {
    let mut names: Vec<String> = std::fs::read_dir(STORED)
        .map_err(|error| Failure::usage(format!("{STORED}: {error}")))?
        .filter_map(|entry| entry.ok()?.file_name().into_string().ok())
        .filter(|name| name.starts_with(prefix))
        .collect();
    names.sort();
    names
        .iter()
        .map(|name| stored(&format!("{STORED}/{name}")))
        .collect()
}

/// A stored result.
fn stored(path: &str) -> Result<serde_json::Value, Failure> {
    let text = std::fs::read_to_string(path).map_err(Failure::environment)?;
    serde_json::from_str(&text).map_err(Failure::environment)
}

/// A page with texts inserted between their markers.
fn page(path: &str, texts: &[((&str, &str), String)]) -> Result<Vec<u8>, Failure> {
    let mut page = std::fs::read_to_string(path).map_err(Failure::environment)?;
    for ((first, last), text) in texts {
        let (Some(begin), Some(end)) = (page.find(first), page.find(last)) else {
            return Err(Failure::usage(format!(
                "{path}: the marker comments {first} and {last} are missing"
            )));
        };
        page = format!(
            "{}{first}\n\n{}\n\n{}",
            &page[..begin],
            text.trim_end(),
            &page[end..]
        );
    }
    Ok(page.into_bytes())
}

/// Pages of plugins that no longer exist.
fn strangers(files: &[(PathBuf, Vec<u8>)]) -> Vec<String> {
    let folders =
        whitstone::core::FamilyName::ALL.map(|family| Path::new(pages::FOLDER).join(family.plural()));
    let found = folders
        .iter()
        .filter_map(|folder| std::fs::read_dir(folder).ok())
        .flatten()
        .flatten();
    let found = found
        .map(|entry| entry.path())
        .filter(|path| !files.iter().any(|(known, _)| known == path));
    found
        .map(|path| format!("{}: belongs to no plugin; delete it", path.display()))
        .collect()
}

fn validate(registry: &Registry, renderer: Renderer) -> Result<Vec<CaseResult>, Failure> {
    let options = Options {
        scenes: PathBuf::from("scenes"),
        references: PathBuf::from(REFERENCES),
        installation: Installation::default(),
        target: PathBuf::from("target/whitstone"),
        renderer,
        mode: Mode::Stored,
        reuse: true,
        threads: 0,
        overrides: Vec::new(),
        ours_overrides: Vec::new(),
        shared_overrides: Vec::new(),
        time_limit: Duration::from_secs(1),
        program: "cargo xtask".to_owned(),
        flags: String::new(),
    };
    let mut validator = Validator::new(registry, options, &|_| {}).map_err(Failure::environment)?;
    if renderer == Renderer::MITSUBA {
        validator.set_oracle(OraclePolicy {
            when: Ask::Always,
            ..OraclePolicy::default()
        });
    }
    let scenes = find_scenes(&[PathBuf::from("scenes")]).map_err(Failure::environment)?;
    let cases = scenes.iter().map(|scene| validator.validate(scene));
    // This table is about Mitsuba, so scenes with only a POV-Ray reference are excluded.
    Ok(cases.filter(|case| case.other_reference.is_none()).collect())
}

/// One digit after the point, because the second depends on the platform's mathematical functions.
fn table(cases: &[CaseResult]) -> String {
    let number = |value: Option<f64>| value.map_or_else(|| "–".to_owned(), |value| format!("{value:.0e}"));
    let mut text = String::from(
        "| scene | RMSE | interior error | limit | pixels over | explained | unexplained |\n|---|---|---|---|---|---|---|\n",
    );
    for case in cases.iter().filter(|case| case.scene.starts_with("showcase/")) {
        let _ = writeln!(
            text,
            "| [{0}](../scenes/{0}.toml) | {1} | {2} | {3:.0e} | {4} | {5} | {6} |",
            case.scene,
            number(case.rmse),
            number(case.rel_rmse_interior),
            case.limit,
            case.pixels_over_tolerance,
            case.explained,
            case.unexplained,
        );
    }
    text
}

/// The results over all scenes.
fn summary(cases: &[CaseResult]) -> String {
    let with = |status| cases.iter().filter(|case| case.status == Some(status)).count();
    let sum = |of: fn(&CaseResult) -> usize| cases.iter().map(of).sum::<usize>();
    let explained = sum(|case| case.explained);
    let twin = |kind: &str| cases.iter().filter(|case| case.twin == kind).count();
    let opinions = || cases.iter().filter_map(|case| case.opinion.as_ref());
    let answers = |of: fn(&Opinion) -> usize| opinions().map(of).sum::<usize>();
    let asked = answers(|opinion| opinion.asked);
    let (ours, theirs) = (
        answers(|opinion| opinion.ours),
        answers(|opinion| opinion.reference),
    );
    let is_silent = |case: &&CaseResult| case.opinion.as_ref().is_some_and(|found| found.silent.is_some());
    let silent: Vec<&str> = cases.iter().filter(is_silent).map(|case| &*case.scene).collect();
    let others = if silent.is_empty() {
        String::new()
    } else {
        let scenes = silent.join(", ");
        format!(" The others are in scenes that the oracle does not support: {scenes}.")
    };
    run_time::wrapped(&format!(
        "{} scenes have a stored Mitsuba image: {} pass, {} are confirmed by the oracle, {} fail, {} are undecided. Of {} pixels {explained} are explained by the reference's own variation, or ambiguous and confirmed by the oracle; {} are unexplained. With `--oracle`, which asks the oracle about explained pixels too, it was asked about {asked} of the {explained}: it confirms Whitstone in {ours}, Mitsuba in {theirs}, and neither or both in {}.{others} The least independent [twin](docs/glossary.md) that a scene uses is native in {} scenes, hosted in {} and a formula in {}.",
        cases.len(),
        with(Status::Pass),
        with(Status::Confirmed),
        with(Status::Fail),
        with(Status::Undecided),
        sum(|case| case.width * case.height),
        sum(|case| case.unexplained),
        asked - ours - theirs,
        twin("native"),
        twin("hosted"),
        twin("formula"),
    ))
}

/// Builds a scene with overrides.
pub(crate) fn build(registry: &Registry, scene: &Path, overrides: &[String]) -> Result<Pipeline, Failure> {
    let sources = Sources::load(scene, overrides, registry)
        .map_err(|error| Failure::usage(error.sources.report(&error.errors, false)))?;
    let report = |errors| Failure::usage(sources.report(&errors, false));
    Pipeline::load(&sources, registry, BuildOptions::default()).map_err(report)
}

/// A scene that is not in a file; its paths are relative to the root.
pub(crate) fn of_text(registry: &Registry, text: &str) -> Result<Pipeline, Failure> {
    of_text_in(registry, text, Path::new("."))
}

/// A scene whose text names files relative to a folder.
pub(crate) fn of_text_in(registry: &Registry, text: &str, folder: &Path) -> Result<Pipeline, Failure> {
    let sources = Sources::from_text("scene.toml", text, folder, &[])
        .map_err(|error| Failure::usage(error.sources.report(&error.errors, false)))?;
    let report = |errors| Failure::usage(sources.report(&errors, false));
    Pipeline::load(&sources, registry, BuildOptions::default()).map_err(report)
}

/// Renders a scene with overrides; returns the image and the hash of the scene.
pub(crate) fn render(
    registry: &Registry,
    scene: &Path,
    overrides: &[String],
) -> Result<(Film, String), Failure> {
    let pipeline = build(registry, scene, overrides)?;
    Ok((pipeline.render(RenderOptions::default()), pipeline.scene_hash))
}

/// The small scene of the accelerators, from a larger distance, with the boxes of one of them.
fn bounds(registry: &Registry, accelerator: &str, deepest: usize) -> Result<Vec<u8>, Failure> {
    let overrides = [
        format!("film={{ width = {}, height = {} }}", TILE.0, TILE.1),
        "camera.look_at={ origin = [1.7, 2.2, 4.2], target = [0, 0.55, 0] }".to_owned(),
        format!("accelerator={{ {accelerator} }}"),
    ];
    let pipeline = build(registry, Path::new("scenes/accelerators/bvh.toml"), &overrides)?;
    let picture = wireframe::picture(&pipeline, deepest)?;
    picture.to_png().map_err(Failure::environment)
}

/// A scene without changes.
fn picture(registry: &Registry, scene: &str) -> Result<Vec<u8>, Failure> {
    let (film, hash) = render(registry, Path::new(scene), &[])?;
    let image = film.to_image(&hash).map_err(Failure::usage)?;
    let picture = Raster::preview(&image, ToneMap::default()).map_err(Failure::usage)?;
    picture.to_png().map_err(Failure::environment)
}

/// Pictures of showcase scenes with nine samples per pixel.
fn sheet(registry: &Registry) -> Result<Vec<u8>, Failure> {
    let columns = 3;
    let rows = SHEET.len().div_ceil(columns);
    let mut sheet = Raster::filled(columns * TILE.0, rows * TILE.1, [0; 3]);
    for (index, name) in SHEET.iter().enumerate() {
        let path = PathBuf::from("scenes/showcase").join(name).with_extension("toml");
        let overrides = [
            format!("film={{ width = {}, height = {} }}", TILE.0, TILE.1),
            "sampler={ type = \"grid\", samples_per_axis = 3 }".to_owned(),
        ];
        let (film, hash) = render(registry, &path, &overrides)?;
        let image = film.to_image(&hash).map_err(Failure::usage)?;
        let picture = Raster::preview(&image, ToneMap::default()).map_err(Failure::usage)?;
        sheet.draw(&picture, index % columns * TILE.0, index / columns * TILE.1);
    }
    sheet.to_png().map_err(Failure::environment)
}

/// Our image, the stored reference, and the error.
fn trio_of(registry: &Registry, name: &str) -> Result<Vec<u8>, Failure> {
    let scene = PathBuf::from(format!("scenes/showcase/{name}.toml"));
    let (film, hash) = render(registry, &scene, &[])?;
    let ours = film.to_image(&hash).map_err(Failure::usage)?;
    let folder = PathBuf::from(format!("references/images/showcase/{name}"));
    let stored = Stored::read(&folder, Renderer::MITSUBA, &hash).map_err(Failure::usage)?;
    let raster =
        trio(&ours, &stored.image, ToneMap::default(), ErrorView::default()).map_err(Failure::usage)?;
    raster.to_png().map_err(Failure::environment)
}
