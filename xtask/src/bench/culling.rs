//! `bench culling`: the gain of packets, culling and tile frusta of `bvh`, each measured alone.
//!
//! The accelerator `bvh` traces coherent rays as packets, culls boxes by bounds on a packet, and
//! skips whole tiles by their frusta; its key `ray_sets` switches each step. Tiles are also
//! counted: those whose rays all miss, and those that the frusta find.

use super::machine::{date, load, processor, processor_time};
use super::median;
use crate::pages;
use clap::Args;
use std::fmt::Write as _;
use std::path::PathBuf;
use whitstone::core::Registry;
use whitstone::core::simd::Level;
use whitstone::render::{BuildOptions, Pipeline, RenderOptions};
use whitstone::scene::{LoadError, Sources};
use whitstone::{Exit, Failure};

/// The page with the table.
const PAGE: &str = "docs/parallel.md";
const MARKERS: [&str; 2] = [
    "<!-- culling: written by `cargo xtask bench culling --page` -->",
    "<!-- end of culling -->",
];
/// The scenes of the page.
const SCENES: [&str; 4] = [
    "scenes/showcase/classic.toml",
    "scenes/showcase/glass_mesh.toml",
    "scenes/showcase/textured_mesh.toml",
    "scenes/showcase/displacement.toml",
];
/// The values of the key `ray_sets` of `bvh`, each with one more step.
const SETS: [&str; 4] = ["none", "packets", "culled_packets", "tiles"];
/// What only camera rays see.
const CAMERA_RAYS: &str = r#"integrator={ type = "appel", shadows = "none" }"#;
/// Side of the tiles of the renderer.
const TILE: u32 = 16;
/// A ball of 20,480 triangles in front of nothing, where many tiles are empty.
const BALL: &str = r#"
camera = { type = "perspective", look_at = { origin = [0, 0, 5], target = [0, 0, 0] }, fov = 60 }
light = [{ type = "background", radiance = 1 }]

[[shape]]
type = "mesh"
file = "icosphere.ply"
subdivision = { scheme = "loop", levels = 2 }
"#;

/// Measure packets, culling and tile frusta of `bvh`, each alone, on one thread
///
/// Prints processor times per pixel: with rays traced one by one, as packets, as packets that cull
/// boxes by bounds on their rays, and with tiles that are skipped by their frusta. Then the same
/// objects without and with a proxy, their bounding box.
#[derive(Args, Debug)]
#[command(
    help_template = whitstone::commands::HELP_TEMPLATE,
    after_help = "Examples:\n  taskset -c 0 cargo xtask bench culling\n  taskset -c 0 cargo xtask bench culling --page"
)]
pub(crate) struct Arguments {
    /// Scene files (TOML)
    #[arg(value_name = "SCENE", default_values = SCENES)]
    scenes: Vec<PathBuf>,
    /// Number of rounds; each renders every image once
    #[arg(long, value_name = "COUNT", default_value_t = 9)]
    rounds: usize,
    /// Width of the images in pixels; the height is three quarters of it
    #[arg(long, value_name = "PIXELS", default_value_t = 640)]
    width: u32,
    /// Write the tables into docs/parallel.md
    #[arg(long)]
    page: bool,
}

/// Runs the command.
pub(super) fn run(arguments: &Arguments, registry: &Registry) -> Result<Exit, Failure> {
    let [width, height] = [arguments.width, (arguments.width * 3 / 4).max(1)];
    let film = format!("film={{ width = {width}, height = {height} }}");
    let mut text = format!(
        "{}, {}, one thread, {}.\n\
         Nanoseconds of processor time per pixel; {width} x {height} pixels, medians of {} rounds. Load {:.1}.\n\n\
         | scene | rays | one by one | packets | and culling | and tiles | gain of packets | of culling | of tiles | empty tiles | skipped |\n\
         |---|---|---|---|---|---|---|---|---|---|---|",
        processor().unwrap_or_else(|| "unknown processor".to_owned()),
        Level::current(),
        date(),
        arguments.rounds.max(1),
        load(),
    );
    let scenes = arguments.scenes.iter().map(Some).chain([None]);
    for (scene, rays) in scenes.flat_map(|scene| [(scene, Some(CAMERA_RAYS)), (scene, None)]) {
        let pipelines = SETS
            .iter()
            .map(|sets| {
                let accelerator = format!("accelerator={{ type = \"bvh\", ray_sets = \"{sets}\" }}");
                let mut overrides = vec![film.clone(), accelerator];
                overrides.extend(rays.map(str::to_owned));
                match scene {
                    Some(scene) => built(Sources::load(scene, &overrides, registry), registry),
                    None => of_text(BALL, &overrides, registry),
                }
            })
            .collect::<Result<Vec<_>, _>>()?;
        let times = nanoseconds(&pipelines, arguments.rounds)?;
        let name = scene.map_or("ball".into(), |scene| {
            scene.file_stem().unwrap_or_default().display().to_string()
        });
        let [before, after] = [skipped(&pipelines[3]), {
            pipelines[3].render(one_thread());
            skipped(&pipelines[3])
        }];
        let tiles = width.div_ceil(TILE) * height.div_ceil(TILE);
        let share = |count: f64| 100.0 * count / f64::from(tiles);
        // No proxies if a shape is unbounded. Streams of other rays are no tiles.
        let skipped_share = match share(after - before) {
            share if share.is_nan() || rays.is_none() => "–".to_owned(),
            share => format!("{share:.0} %"),
        };
        let _ = write!(
            text,
            "\n| {name} | {} | {:.0} | {:.0} | {:.0} | {:.0} | {:.2} | {:.2} | {:.2} | {:.0} % | {} |",
            if rays.is_some() { "camera" } else { "all" },
            times[0],
            times[1],
            times[2],
            times[3],
            times[0] / times[1],
            times[1] / times[2],
            times[2] / times[3],
            share(f64::from(empty_tiles(&pipelines[3], [width, height]))),
            skipped_share,
        );
    }
    let _ = write!(text, "\n\n{}", proxies(&film, arguments, registry)?);
    println!("{text}");
    if arguments.page {
        pages::between(PAGE, MARKERS, &text)?;
    }
    Ok(Exit::Pass)
}

fn one_thread() -> RenderOptions<'static> {
    RenderOptions {
        threads: 1,
        ..RenderOptions::default()
    }
}

type Loaded = Result<Sources, Box<LoadError>>;

fn built(sources: Loaded, registry: &Registry) -> Result<Pipeline, Failure> {
    let sources = sources.map_err(|error| Failure::usage(error.sources.report(&error.errors, false)))?;
    Pipeline::load(&sources, registry, BuildOptions::default())
        .map_err(|errors| Failure::usage(sources.report(&errors, false)))
}

fn of_text(text: &str, overrides: &[String], registry: &Registry) -> Result<Pipeline, Failure> {
    let assets = crate::root().join("scenes/assets");
    built(Sources::from_text("culling", text, &assets, overrides), registry)
}

/// The medians over all rounds of the processor time per pixel; the images take turns. It is an
/// error if they are not the same.
fn nanoseconds(pipelines: &[Pipeline], rounds: usize) -> Result<Vec<f64>, Failure> {
    let mut times = vec![Vec::new(); pipelines.len()];
    // The first round touches pages.
    for round in 0..=rounds.max(1) {
        let mut first = None;
        for (pipeline, times) in pipelines.iter().zip(&mut times) {
            let start = processor_time();
            let film = pipeline.render(one_thread());
            let seconds = processor_time() - start;
            if round > 0 {
                times.push(1e9 * seconds / film.rgb.len() as f64);
            }
            if *first.get_or_insert_with(|| film.rgb.clone()) != film.rgb {
                return Err(Failure::usage("the images differ"));
            }
        }
    }
    Ok(times.iter_mut().map(|times| median(times)).collect())
}

/// The number of streams that the accelerator has skipped.
fn skipped(pipeline: &Pipeline) -> f64 {
    let statistics = pipeline.scene.accelerator.statistics();
    statistics.get("skipped_streams").copied().unwrap_or(f64::NAN)
}

/// The number of tiles whose camera rays all miss.
fn empty_tiles(pipeline: &Pipeline, [width, height]: [u32; 2]) -> u32 {
    let starts = |side: u32| (0..side).step_by(TILE as usize);
    let (mut rays, mut hits) = (Vec::new(), Vec::new());
    let mut is_empty = |[x, y]: [u32; 2]| {
        rays.clear();
        for row in y..(y + TILE).min(height) {
            rays.extend((x..(x + TILE).min(width)).map(|column| pipeline.camera_ray([column, row], 0)));
        }
        hits.resize(rays.len(), None);
        pipeline.trace_into(&rays, &mut hits);
        hits.iter().all(Option::is_none)
    };
    let tiles = starts(height).flat_map(|y| starts(width).map(move |x| [x, y]));
    tiles.map(|tile| u32::from(is_empty(tile))).sum()
}

/// Objects that are tested one by one, without and with a box around each.
fn proxies(film: &str, arguments: &Arguments, registry: &Registry) -> Result<String, Failure> {
    let mut text = String::from(
        "| objects | triangles | without proxies | with a box around each | gain |\n|---|---|---|---|---|",
    );
    for side in [1, 2, 3] {
        let overrides = [film.to_owned(), CAMERA_RAYS.to_owned()];
        let pipelines = [
            of_text(&balls(side, false), &overrides, registry)?,
            of_text(&balls(side, true), &overrides, registry)?,
        ];
        let times = nanoseconds(&pipelines, arguments.rounds)?;
        let count = side * side;
        let _ = write!(
            text,
            "\n| {count} | {} | {:.0} ns | {:.0} ns | {:.1} |",
            80 * count,
            times[0],
            times[1],
            times[0] / times[1]
        );
    }
    Ok(text)
}

/// Balls of 80 triangles in rows. An instance of a group tests the box of the group first.
fn balls(side: u32, boxes: bool) -> String {
    let ball = "type = \"mesh\"\nfile = \"icosphere_1.ply\"\n";
    let mut text = String::from(
        "accelerator = { type = \"brute_force\" }\n\
         camera = { type = \"perspective\", look_at = { origin = [0, 0, 5], target = [0, 0, 0] }, fov = 60 }\n\
         light = [{ type = \"background\", radiance = 1 }, { type = \"ambient\", radiance = 1 }]\n",
    );
    if boxes {
        let _ = write!(
            text,
            "[group.ball]\naccelerator = {{ type = \"brute_force\" }}\n[[group.ball.shape]]\n{ball}"
        );
    }
    for number in 0..side * side {
        let place = |k: u32| 4.0 * (f64::from(k) + 0.5) / f64::from(side) - 2.0;
        let [x, y] = [number % side, number / side].map(place);
        let what = if boxes {
            "type = \"instance\"\ngroup = \"ball\"\n"
        } else {
            ball
        };
        let _ = write!(
            text,
            "[[shape]]\n{what}transform = [{{ scale = {} }}, {{ translate = [{x}, {y}, 0] }}]\n",
            1.2 / f64::from(side)
        );
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Frusta find most of the tiles that no ray of them hits, and no other.
    #[test]
    fn empty_tiles_are_skipped() {
        let registry = whitstone::registry();
        let film = "film={ width = 320, height = 240 }".to_owned();
        let sets = "accelerator={ type = \"bvh\", ray_sets = \"tiles\" }".to_owned();
        let pipeline = of_text(BALL, &[film, sets, CAMERA_RAYS.to_owned()], &registry).unwrap();
        pipeline.render(one_thread());
        let skipped = skipped(&pipeline);
        let empty = f64::from(empty_tiles(&pipeline, [320, 240]));
        assert!(
            empty > 100.0 && skipped <= empty && skipped > 0.8 * empty,
            "{skipped} of {empty}"
        );
        let film = "film={ width = 80, height = 60 }";
        let images = SETS.map(|sets| {
            let sets = format!("accelerator={{ type = \"bvh\", ray_sets = \"{sets}\" }}");
            let pipeline = of_text(BALL, &[film.to_owned(), sets], &registry).unwrap();
            pipeline.render(one_thread()).rgb
        });
        assert!(images.iter().all(|image| *image == images[0]));
    }

    /// The boxes change the time only.
    #[test]
    fn proxies_do_not_change_the_image() {
        let registry = whitstone::registry();
        let film = "film={ width = 64, height = 48 }".to_owned();
        let images = [false, true].map(|boxes| {
            let pipeline = of_text(&balls(2, boxes), std::slice::from_ref(&film), &registry).unwrap();
            pipeline.render(one_thread()).rgb
        });
        assert!(images[0].iter().any(|pixel| *pixel != images[0][0]));
        assert_eq!(images[0], images[1]);
    }
}
