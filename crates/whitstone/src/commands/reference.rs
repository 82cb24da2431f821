//! `reference`: renders, shows and accepts stored references.

use crate::terminal::{Exit, Failure, make_folder, progress};
use clap::Args;
use std::path::PathBuf;
use whitstone_core::{Registry, TreeLimits};
use whitstone_image::{ToneMap, exr_io};
use whitstone_metrics::error_map::{ErrorView, trio};
use whitstone_render::RenderOptions;
use whitstone_validate::driver::SceneText;
use whitstone_validate::stored::Stored;
use whitstone_validate::{Mode, Validator, quoted, scene_key};

/// Maximum size of a stored image, in pixels: the references of a repository must stay small.
const MAX_PIXELS: u64 = 192 * 192;

/// Render reference images with a live Mitsuba or POV-Ray, and store them with --accept
///
/// Handles each scene whose stored reference is missing or belongs to another version of the scene.
/// Writes a picture of our image, the reference and the error. Nothing is stored without --accept,
/// and never an image of more than 36,864 pixels (192 x 192).
///
/// Exit code 1 if a reference was rendered and not stored; 2 for a wrong command line or scene, or
/// an image that is too large; 3 without a live renderer, or if the reference has re-hits; else 0.
#[derive(Args, Debug)]
#[command(
    help_template = super::HELP_TEMPLATE,
    after_help = "Examples:\n  whitstone reference scenes/shapes/sphere.toml\n  whitstone reference --accept scenes/shapes/sphere.toml\n  whitstone reference --accept --reference povray scenes/shapes/sphere.toml"
)]
pub struct Arguments {
    #[command(flatten)]
    scenes: super::validate::Scenes,
    /// Store the rendered references
    #[arg(long)]
    accept: bool,
    /// Also render references that are up to date
    #[arg(long)]
    all: bool,
}

/// Runs the command.
pub fn run(arguments: &Arguments, registry: &Registry, program: &str) -> Result<Exit, Failure> {
    let mut options = arguments.scenes.options(program);
    let renderer = options.renderer;
    // Even with `stored`, because the references are rendered here.
    options.mode = Mode::Live;
    let scenes = arguments.scenes.find(registry)?;
    let mut validator = Validator::new(registry, options.clone(), &|text| eprintln!("{text}"))
        .map_err(Failure::environment)?;
    let mut waiting = 0;
    for path in &scenes {
        let (flattened, overrides) = validator.adapted(path).map_err(Failure::usage)?;
        let folder = validator.stored_folder(path);
        let state = match Stored::read(&folder, renderer, &flattened.hash) {
            Ok(_) if !arguments.all => continue,
            Ok(_) => "up to date".to_owned(),
            Err(error) => error.to_string(),
        };
        let key = scene_key(path, &options.scenes);
        let scene = super::SceneArguments {
            camera: None,
            scene: path.clone(),
            overrides,
            root: None,
            max_memory: None,
            max_tree_rays: TreeLimits::default().rays,
            target: arguments.scenes.target.clone(),
            fresh: !options.reuse,
        };
        let pipeline = super::build(&scene, registry)?;
        let size = pipeline.film.size;
        if u64::from(size.width) * u64::from(size.height) > MAX_PIXELS {
            return Err(Failure::usage(format!(
                "{}: {} x {} is more than {MAX_PIXELS} pixels (192 x 192), the maximum of a stored reference; reduce film.width and film.height",
                path.display(),
                size.width,
                size.height
            )));
        }
        let bar = progress(1, &key);
        let text = SceneText {
            text: &flattened.text,
            base: &flattened.base,
        };
        let live = validator.live().expect("the mode is live");
        let stored = live
            .reference_with_variants(text, &flattened.hash, &|done, all| {
                bar.set_length(all as u64);
                bar.set_position(done as u64);
            })
            .map_err(Failure::environment)?;
        bar.finish_and_clear();
        if stored.meta.rehits > 0 {
            return Err(Failure::environment(format!(
                "{}: {} rays of the reference hit the surface again that they had just left (re-hits); such an image is not stored",
                path.display(),
                stored.meta.rehits
            )));
        }
        let film = pipeline.render(RenderOptions::default());
        let ours = film.to_image(&pipeline.scene_hash).map_err(Failure::usage)?;
        let picture = show(&options.target, &key, &ours, &stored)?;
        if arguments.accept {
            stored.write(&folder, renderer).map_err(Failure::environment)?;
            println!("stored  {key} (before: {state}); see {}", picture.display());
        } else {
            waiting += 1;
            println!("new     {key} ({state}); see {}", picture.display());
        }
    }
    if waiting == 0 {
        return Ok(Exit::Pass);
    }
    let paths = arguments.scenes.paths.iter();
    let paths: String = paths
        .map(|path| format!(" {}", quoted(&path.display().to_string())))
        .collect();
    let all = if arguments.all { " --all" } else { "" };
    println!(
        "\nreferences that are not stored: {waiting}; to store them: {program} reference --accept{all}{paths}{}",
        arguments.scenes.flags()
    );
    Ok(Exit::Differs)
}

/// Writes our image, the reference and the error side by side, and both EXR files.
fn show(
    target: &std::path::Path,
    key: &str,
    ours: &whitstone_image::Image,
    stored: &Stored,
) -> Result<PathBuf, Failure> {
    let folder = target.join("reference").join(key);
    make_folder(&folder)?;
    let raster =
        trio(ours, &stored.image, ToneMap::default(), ErrorView::default()).map_err(Failure::usage)?;
    let picture = folder.join("trio.png");
    raster.write_png(&picture).map_err(Failure::environment)?;
    exr_io::write(folder.join("ours.exr"), ours).map_err(Failure::environment)?;
    exr_io::write(folder.join("reference.exr"), &stored.image).map_err(Failure::environment)?;
    Ok(picture)
}
