//! `plan`: divides images into jobs for other processes and machines.

use super::SceneArguments;
use super::validate::ReferenceMode;
use crate::jobs::{self, Inputs, Job, Picture, Program, Task};
use crate::terminal::{self, Exit, Failure, write_json};
use clap::Args;
use serde_json::json;
use std::path::{Path, PathBuf};
use whitstone_core::{ImportOptions, Registry};
use whitstone_image::atomic;
use whitstone_scene::{Description, Plan, Sources};

/// Divide the images of scenes, or their validation, into jobs, one JSON object on each line of a
/// file
///
/// A job is a tile of an image, or with --validate the comparison of a scene with the reference. It
/// names everything that its result depends on: the program and the input files by their hashes,
/// the overrides, and the tile. `run-job` runs one job, on any machine that has the same program
/// and the files. `merge` makes the images from the results, with the bytes that `render` writes,
/// or the report of the validation.
#[derive(Args, Debug)]
#[command(
    help_template = super::HELP_TEMPLATE,
    after_help = "Examples:\n  whitstone plan scenes/showcase/classic.toml -o jobs.jsonl\n  whitstone plan scenes/showcase/*.toml --tile-size 128 --make jobs.mk\n  whitstone plan scenes/shapes --validate --slurm jobs.sh"
)]
pub struct Arguments {
    #[command(flatten)]
    scenes: Scenes,
    #[command(flatten)]
    size: TileSize,
    /// Compare the scenes with the reference instead; folders of scenes can be named too
    #[arg(long, conflicts_with_all = ["camera", "tile_size", "max_tree_rays"])]
    validate: bool,
    /// Source of the references
    #[arg(long, value_enum, default_value_t = ReferenceMode::Auto, requires = "validate")]
    reference: ReferenceMode,
    /// File of the jobs to write
    #[arg(short, long, default_value = "jobs.jsonl", value_name = "FILE")]
    output: PathBuf,
    /// Also write a Makefile that runs the jobs and merges the results: make -j -f FILE
    #[arg(long, value_name = "FILE")]
    make: Option<PathBuf>,
    /// Also write an array job for Slurm: sbatch FILE
    #[arg(long, value_name = "FILE")]
    slurm: Option<PathBuf>,
    /// Also write a job template for render farms that read Open Job Description, as JSON
    #[arg(long, value_name = "FILE")]
    openjd: Option<PathBuf>,
    /// Write the number of jobs and images to this file as JSON; - means standard output
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

/// Selects scenes. Like [`SceneArguments`], for any number of scenes.
#[derive(Args, Debug)]
#[group(skip)]
struct Scenes {
    /// Scene files (TOML), or files of other formats such as .glb
    #[arg(required = true, value_name = "SCENE")]
    paths: Vec<PathBuf>,
    /// Camera of a file of another format, by name or index [default: the first]
    #[arg(long, value_name = "NAME")]
    camera: Option<String>,
    /// Override a value of every scene: `camera.fov=30`; can be repeated
    #[arg(long = "set", value_name = "PATH=VALUE")]
    overrides: Vec<String>,
    /// Refuse a scene that names a file outside of this folder, also through a link [default: files
    /// may be anywhere]
    #[arg(long, value_name = "DIR")]
    root: Option<PathBuf>,
    /// Stop where one sample of a pixel becomes more rays than this, by reflection and refraction
    #[arg(long, value_name = "RAYS", default_value_t = whitstone_core::TreeLimits::default().rays, value_parser = clap::value_parser!(u32).range(1..))]
    max_tree_rays: u32,
}

/// The size of a job.
#[derive(Args, Clone, Debug)]
#[group(skip)]
pub(super) struct TileSize {
    /// Side of the square tiles, in pixels. Each job builds the whole scene, so a small tile costs
    /// time; the image does not depend on it [default: 256]
    #[arg(long, value_name = "PIXELS", value_parser = clap::value_parser!(u32).range(1..))]
    pub(super) tile_size: Option<u32>,
}

impl TileSize {
    const DEFAULT: u32 = 256;

    /// Side of the tiles, in pixels.
    pub(super) fn side(&self) -> u32 {
        self.tile_size.unwrap_or(Self::DEFAULT)
    }
}

/// Divides the image of a scene into jobs.
pub(super) fn jobs(
    scene: &SceneArguments,
    tile_size: u32,
    program: &Program,
    registry: &Registry,
) -> Result<Vec<Job>, Failure> {
    let color = terminal::color();
    let options = ImportOptions {
        camera: scene.camera.clone(),
        root: scene.root.clone(),
        max_memory: scene.max_memory,
        ..ImportOptions::all()
    };
    let sources = Sources::load_with(&scene.scene, &scene.overrides, registry, &options)
        .map_err(|error| Failure::usage(error.sources.report(&error.errors, color)))?;
    let reported = |errors| Failure::usage(sources.report(&errors, color));
    let description = Description::parse(&sources).into_result().map_err(reported)?;
    Plan::new(&description, registry)
        .into_result()
        .map_err(reported)?;
    let size = description.film.size;
    let files = files(&sources, Some(&description))?;
    let parent = scene.scene.parent().unwrap_or(Path::new(""));
    let inputs = Inputs::new(program, parent_or_here(parent), &files)?;
    let picture = Picture {
        scene: inputs.name(&scene.scene)?,
        camera: scene.camera.clone(),
        overrides: scene.overrides.clone(),
        max_tree_rays: scene.max_tree_rays,
        width: size.width,
        height: size.height,
    };
    let task = |tile| Task::Render {
        tile,
        picture: picture.clone(),
    };
    let tiles = jobs::tiles(size, tile_size)?.into_iter();
    Ok(tiles.map(|tile| Job::new(&inputs, task(tile))).collect())
}

fn parent_or_here(path: &Path) -> &Path {
    match path.as_os_str().is_empty() {
        true => Path::new("."),
        false => path,
    }
}

/// All files that a scene is read from, as far as they are known: `description` is that of a scene
/// without errors.
fn files(sources: &Sources, description: Option<&Description<'_>>) -> Result<Vec<PathBuf>, Failure> {
    let scenes = sources.scene_files().map(Path::to_owned);
    let others = description.map_or_else(Vec::new, |description| description.flattened.files.clone());
    let all: Vec<PathBuf> = scenes.chain(others).collect();
    let base = sources.base();
    // A relative path is relative to the base.
    let movable = |path: &Path| path.starts_with(base) && (base.is_absolute() || path.is_relative());
    if let Some(file) = all.iter().find(|file| !movable(file)) {
        return Err(Failure::usage(format!(
            "{}: names {} by an absolute path, which other machines need not have; name it relative to the scene",
            sources.name(),
            file.display()
        )));
    }
    Ok(all)
}

/// The files of a scene for a command that reports the errors of scenes itself.
pub(super) fn files_of(
    scene: &Path,
    overrides: &[String],
    registry: &Registry,
) -> Result<Vec<PathBuf>, Failure> {
    let mut found = match Sources::load(scene, overrides, registry) {
        Ok(sources) => {
            let description = Description::parse(&sources).into_result();
            files(&sources, description.ok().as_ref())?
        }
        Err(error) => files(&error.sources, None)?,
    };
    found.push(scene.to_owned());
    Ok(found)
}

/// A path relative to the working folder: it leads to the same file in a copy of the inputs.
pub(super) fn from_here(path: &Path) -> Result<String, Failure> {
    let mut found = PathBuf::from(path);
    if path.is_absolute() {
        let here = std::env::current_dir().map_err(Failure::environment)?;
        let common = here.ancestors().find(|folder| path.starts_with(folder));
        let common = common.unwrap_or(Path::new("/"));
        let up = here.strip_prefix(common).unwrap_or(Path::new("")).components();
        found = up.map(|_| "..").collect();
        found.push(path.strip_prefix(common).unwrap_or(path));
    }
    let text = found.to_str().map(str::to_owned);
    text.ok_or_else(|| Failure::usage(format!("{}: the name is not valid UTF-8", path.display())))
}

/// A job that runs a command of this program in this working folder, with files.
pub(super) fn command(program: &Program, files: &[PathBuf], arguments: Vec<String>) -> Result<Job, Failure> {
    let here = Path::new(".");
    let inputs = Inputs::new(program, here, files)?;
    let folder = inputs.name(here)?;
    Ok(Job::new(&inputs, Task::Run { folder, arguments }))
}

/// Runs the command.
pub fn run(arguments: &Arguments, registry: &Registry, program: &str) -> Result<Exit, Failure> {
    let mut all = Vec::new();
    if arguments.validate {
        all = super::validate::plan(
            &arguments.scenes.paths,
            &arguments.scenes.overrides,
            arguments.reference,
            registry,
        )?;
    }
    let identity = Program::this()?;
    let images = match arguments.validate {
        true => &[][..],
        false => &arguments.scenes.paths,
    };
    for path in images {
        let scene = SceneArguments {
            scene: path.clone(),
            camera: arguments.scenes.camera.clone(),
            overrides: arguments.scenes.overrides.clone(),
            root: arguments.scenes.root.clone(),
            max_memory: None,
            max_tree_rays: arguments.scenes.max_tree_rays,
            target: super::Target::default(),
            fresh: false,
        };
        all.extend(jobs(&scene, arguments.size.side(), &identity, registry)?);
    }
    let optional = [
        &arguments.make,
        &arguments.slurm,
        &arguments.openjd,
        &arguments.json,
    ];
    let mut outputs = vec![arguments.output.as_path()];
    let files = optional.into_iter().flatten().map(PathBuf::as_path);
    outputs.extend(files.filter(|path| *path != Path::new(terminal::STDOUT)));
    super::render::check_apart(&outputs, &jobs::input_paths(&all))?;
    let results = super::run_job::default_results(&arguments.output);
    atomic::write_bytes(&arguments.output, Job::lines(&all).as_bytes()).map_err(Failure::environment)?;
    let farm = super::farm::Farm {
        program,
        jobs: &arguments.output,
        results: &results,
        count: all.len(),
        merged: match images.len() {
            0 => PathBuf::from("report"),
            1 => arguments.scenes.paths[0]
                .with_extension("exr")
                .file_name()
                .map(PathBuf::from)
                .unwrap_or_default(),
            _ => PathBuf::from("images"),
        },
    };
    for (path, text) in [
        (&arguments.make, farm.make(&all)?),
        (&arguments.slurm, farm.slurm()?),
        (&arguments.openjd, farm.openjd()?),
    ] {
        if let Some(path) = path {
            atomic::write_bytes(path, text.as_bytes()).map_err(Failure::environment)?;
        }
    }
    let of = |count: usize, what| whitstone_validate::counted(count, what);
    println!(
        "{}: {}{}",
        arguments.output.display(),
        of(all.len(), "job"),
        match images.len() {
            0 => String::new(),
            images => format!(" of {}", of(images, "image")),
        }
    );
    if let Some(path) = &arguments.json {
        write_json(
            path,
            &json!({ "jobs": all.len(), "images": images.len(), "program": identity }),
        )?;
    }
    Ok(Exit::Pass)
}
