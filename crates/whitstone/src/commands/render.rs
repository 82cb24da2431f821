//! `render`: renders a scene to an image file.

#[cfg(feature = "cluster")]
use super::cluster::{self, Batch, Cluster};
use super::{SceneArguments, build_with};
#[cfg(feature = "cluster")]
use super::{merge, plan};
use crate::interrupt;
#[cfg(feature = "cluster")]
use crate::jobs::{self, Program};
use crate::picture::{Quality, View};
use crate::slim;
use crate::terminal::{Exit, Failure, STDOUT, progress, write_json};
use clap::Args;
use serde_json::json;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use whitstone_core::Registry;
use whitstone_image::{atomic, exr_io};
use whitstone_render::RenderOptions;
use whitstone_scene::Plan;

/// Render a scene to an image file: OpenEXR (32-bit float), PNG, or both
///
/// Prints the image size, the number of rays, the render time and the build time.
#[derive(Args, Debug)]
#[command(
    help_template = super::HELP_TEMPLATE,
    after_help = "Examples:\n  whitstone render scenes/showcase/classic.toml --png\n  whitstone render scenes/showcase/classic.toml -o classic.png --quality good --tone-map filmic\n  whitstone render scenes/showcase/classic.toml --preview\n  whitstone render scenes/showcase/classic.toml --cluster local\n  whitstone render scenes/showcase/classic.toml --set camera.fov=30 -o classic.png"
)]
pub struct Arguments {
    #[command(flatten)]
    scene: SceneArguments,
    /// Image file to write: .exr or .png [default: the scene's name with .exr, in the working
    /// folder]
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
    /// Also write a PNG preview next to the EXR file, with the same name
    #[arg(long)]
    png: bool,
    #[command(flatten)]
    view: View,
    /// Replace the sampler of the scene; --set still changes keys of the new one. Samples of
    /// lenses, area lights and glossy materials stay as in the scene
    #[arg(long, value_name = "QUALITY")]
    quality: Option<Quality>,
    /// Number of threads; 0 means one per core, and with --cluster one per job. The image does not
    /// depend on it
    #[arg(long, value_name = "COUNT", default_value_t = 0, value_parser = super::threads)]
    threads: usize,
    /// Disable all scene-specific specialisation, to measure how much time it saves; the image is
    /// bit-identical
    #[arg(long = "no-specialization")]
    #[cfg_attr(feature = "cluster", arg(conflicts_with = "cluster"))]
    without_specialization: bool,
    #[cfg(feature = "cluster")]
    #[command(flatten)]
    cluster: Cluster,
    #[cfg(feature = "cluster")]
    #[command(flatten)]
    tile: plan::TileSize,
    /// Write the image size, times and ray counts to this file as JSON; - means standard output
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

/// Runs the command.
pub fn run(arguments: &Arguments, registry: &Registry) -> Result<Exit, Failure> {
    let default = arguments.scene.scene.with_extension("exr");
    let default = PathBuf::from(default.file_name().unwrap_or_default());
    let output = arguments.output.clone().unwrap_or(default);
    let extension = output.extension().map(|e| e.to_string_lossy().to_lowercase());
    let as_png = match extension.as_deref() {
        Some("exr") => false,
        Some("png") => true,
        _ => {
            return Err(Failure::usage(format!(
                "{}: unknown image format; expected a file name that ends in .exr or .png",
                output.display()
            )));
        }
    };
    arguments.view.check(as_png || arguments.png)?;
    let picture = (as_png || arguments.png).then(|| output.with_extension("png"));
    let exr = (!as_png).then_some(&output);
    let json = (arguments.json.as_ref()).filter(|path| *path != Path::new(STDOUT));
    let outputs: Vec<&Path> = [exr, picture.as_ref(), json]
        .into_iter()
        .flatten()
        .map(PathBuf::as_path)
        .collect();
    let mut scene = arguments.scene.clone();
    if let Some(quality) = arguments.quality {
        scene.overrides.insert(0, quality.sampler().to_owned());
    }
    #[cfg(feature = "cluster")]
    if arguments.cluster.is_named() {
        let exr = exr.ok_or_else(|| {
            Failure::usage("--cluster writes an EXR file: give -o FILE.exr, and --png for a preview")
        })?;
        return on_cluster(arguments, &scene, exr, picture.as_deref(), &outputs, registry);
    }
    #[cfg(feature = "cluster")]
    if arguments.tile.tile_size.is_some() {
        return Err(Failure::usage(
            "--tile-size needs --cluster: one process renders no tiles of its own",
        ));
    }
    let read = |plan: &Plan<'_, '_>| {
        let scenes = plan.description.sources.scene_files().map(Path::to_owned);
        scenes
            .chain(plan.description.flattened.files.clone())
            .collect::<Vec<_>>()
    };
    let (mut pipeline, inputs) = build_with(&scene, registry, None, read)?;
    check_apart(&outputs, &inputs)?;
    for output in &outputs {
        atomic::check(output).map_err(Failure::environment)?;
    }
    if arguments.without_specialization {
        pipeline = pipeline.without_specialization();
    }
    let size = pipeline.film.size;
    let bar = progress(u64::from(size.width) * u64::from(size.height), "rendering");
    let watching = interrupt::Watching::new();
    let film = pipeline.render(RenderOptions {
        threads: arguments.threads,
        progress: Some(&|done, _| {
            bar.set_position(done);
            match interrupt::stop().is_requested() {
                true => ControlFlow::Break(()),
                false => ControlFlow::Continue(()),
            }
        }),
        ..RenderOptions::default()
    });
    bar.finish_and_clear();
    let is_complete = film.is_complete;
    let rays = film.counters.total();
    let mrays = rays as f64 / film.render_seconds / 1e6;
    let report = json!({
        "output": output, "width": film.width, "height": film.height, "samples": film.samples,
        "scene_hash": pipeline.scene_hash, "build_s": pipeline.build_seconds,
        "complete": film.is_complete, "render_s": film.render_seconds, "mrays_per_s": mrays, "not_finite": film.not_finite(),
        "rays": { "closest": film.counters.closest, "shadow": film.counters.shadow },
    });
    let summary = slim::Summary::new(&output, &pipeline, &film);
    let image = film.into_image(&pipeline.scene_hash).map_err(Failure::usage)?;
    if let Some(output) = exr {
        exr_io::write(output, &image).map_err(Failure::environment)?;
    }
    arguments.view.show(&image, picture.as_deref())?;
    summary.print();
    if let Some(path) = &arguments.json {
        write_json(path, &report)?;
    }
    drop(watching);
    match interrupt::signal() {
        Some(signal) if !is_complete => Err(Failure::Interrupted {
            signal,
            kept: format!(
                "{} has the finished pixels; the others are black",
                output.display()
            ),
        }),
        _ => Ok(Exit::Pass),
    }
}

/// Renders the tiles on a cluster and merges them.
#[cfg(feature = "cluster")]
fn on_cluster(
    arguments: &Arguments,
    scene: &SceneArguments,
    exr: &Path,
    picture: Option<&Path>,
    outputs: &[&Path],
    registry: &Registry,
) -> Result<Exit, Failure> {
    let target = &scene.target;
    let tile_size = arguments.tile.side();
    let jobs = plan::jobs(scene, tile_size, &Program::this()?, registry)?;
    check_apart(outputs, &jobs::input_paths(&jobs))?;
    for output in outputs {
        atomic::check(output).map_err(Failure::environment)?;
    }
    let results = cluster::results(target)?;
    if scene.fresh {
        results.remove(&jobs);
    }
    let usage = (arguments.cluster).run(&mut Batch {
        doing: "rendering",
        jobs: &jobs,
        results: &results,
        target,
        threads: arguments.threads,
        mitsuba: None,
        exclusive: false,
        finished: &mut |_| (),
    })?;
    let (sums, image) = merge::merge(&jobs, &results, exr)?;
    results.remove(&jobs);
    println!("{}", sums.line(exr, image));
    if picture.is_some() || arguments.view.preview {
        let image = exr_io::read(exr, whitstone_image::Limits::IMAGE).map_err(Failure::environment)?;
        arguments.view.show(&image, picture)?;
    }
    if let Some(path) = &arguments.json {
        let mut report = sums.json(exr, image);
        report["cluster"] = json!(usage);
        write_json(path, &report)?;
    }
    Ok(Exit::Pass)
}

/// Rejects an output that would overwrite another output or an input of the scene.
pub(super) fn check_apart(outputs: &[&Path], inputs: &[PathBuf]) -> Result<(), Failure> {
    let identity = |path: &Path| path.canonicalize().or_else(|_| std::path::absolute(path)).ok();
    for (k, output) in outputs.iter().enumerate() {
        let same = |other: &&Path| identity(other) == identity(output);
        if outputs[..k].iter().any(same) {
            let problem = "two results would be written to this file; choose different paths";
            return Err(Failure::usage(format!("{}: {problem}", output.display())));
        }
        if inputs.iter().map(PathBuf::as_path).any(|input| same(&input)) {
            let problem = "the scene reads this file; choose another path for the output";
            return Err(Failure::usage(format!("{}: {problem}", output.display())));
        }
    }
    Ok(())
}
