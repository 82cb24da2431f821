//! `render`: a scene to an image file.

use super::{SceneArguments, build};
use crate::slim;
use crate::terminal::{Exit, Failure, progress};
use clap::Args;
use serde_json::json;
use std::path::PathBuf;
use whitstone_core::Registry;
use whitstone_image::{Raster, ToneMap, atomic, exr_io};
use whitstone_scene::RenderOptions;

/// Render a scene to OpenEXR (float32) and, with --png or a .png name, to a picture
#[derive(Args, Debug)]
pub struct Arguments {
    #[command(flatten)]
    scene: SceneArguments,
    /// The image to write: .exr or .png; by default the scene's name with .exr in the working folder
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
    /// Also write a PNG preview beside the EXR
    #[arg(long)]
    png: bool,
    /// Brightness of PNG pictures, in stops; after it values are cut at 1 and encoded as sRGB
    #[arg(long, default_value_t = 0.0, allow_negative_numbers = true, value_parser = super::finite)]
    exposure: f64,
    /// Threads; 0 for one a core. The image does not depend on it
    #[arg(long, default_value_t = 0, value_parser = super::threads)]
    threads: usize,
    /// Compute also what this scene does not need, as if it were not known: the same image, to measure what leaving out saves
    #[arg(long)]
    one_size_fits_all: bool,
    /// Write sizes, times and ray counts to this file as JSON
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
                "{}: expected a name that ends in .exr or .png",
                output.display()
            )));
        }
    };
    let mut pipeline = build(&arguments.scene, registry)?;
    if arguments.one_size_fits_all {
        pipeline.world = pipeline.world.one_size_fits_all();
    }
    let size = pipeline.film.size;
    let bar = progress(u64::from(size.width) * u64::from(size.height), "rendering");
    let film = pipeline.render(RenderOptions {
        threads: arguments.threads,
        progress: Some(&|done, _| bar.set_position(done)),
    });
    bar.finish_and_clear();
    let image = film.to_image(&pipeline.scene_hash).map_err(Failure::usage)?;
    if !as_png {
        exr_io::write(&output, &image).map_err(Failure::environment)?;
    }
    if as_png || arguments.png {
        let tone = ToneMap {
            exposure: arguments.exposure,
        };
        let raster = Raster::preview(&image, tone).map_err(Failure::usage)?;
        raster
            .write_png(output.with_extension("png"))
            .map_err(Failure::environment)?;
    }
    let rays = film.counters.total();
    let mrays = rays as f64 / film.render_seconds / 1e6;
    println!("{}", slim::summary(&output, &pipeline, &film));
    if let Some(path) = &arguments.json {
        let report = json!({
            "output": output, "width": film.width, "height": film.height, "samples": film.samples,
            "scene_hash": pipeline.scene_hash, "build_s": pipeline.build_seconds,
            "render_s": film.render_seconds, "mrays_per_s": mrays,
            "rays": { "closest": film.counters.closest, "shadow": film.counters.shadow },
        });
        atomic::write_bytes(path, format!("{report:#}\n").as_bytes()).map_err(Failure::environment)?;
    }
    Ok(Exit::Pass)
}
