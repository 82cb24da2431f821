//! The scene of the view: loading it, and the camera, size and sampler of a picture of it.

use crate::camera::{self, LookAt};
use serde::Serialize;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;
use toml::{Table, Value};
use whitstone_core::{
    Camera, FamilyName, FilmSize, ImportOptions, Registry, Sampler, SceneError, SceneErrors,
};
use whitstone_render::{BuildOptions, Cache, Pipeline, Shared};
use whitstone_scene::{Aov, Description, Flattened, Plan, Sources};

/// The layers that a click shows. The scene is built for all of them.
pub(crate) const LAYERS: [Aov; 5] = [Aov::Depth, Aov::Normal, Aov::Uv, Aov::ShapeId, Aov::PrimitiveId];

/// Their names in scene files.
const LAYER_NAMES: &str = "film.aovs=['depth', 'normal', 'uv', 'shape_id', 'primitive_id']";

/// The sampler of previews: one ray through the centre of each pixel.
const PREVIEW_SAMPLER: &str = "center";

/// A problem of a scene at its place.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub(crate) struct Problem {
    /// File, line and column, as editors read them; empty if there is no place.
    pub(crate) place: String,
    /// The fault, and what was expected.
    pub(crate) message: String,
    /// A hint on how to fix it.
    pub(crate) help: Option<String>,
}

fn problems(sources: &Sources, errors: &[SceneError]) -> Vec<Problem> {
    let problem = |error: &SceneError| {
        let position = error.span.as_ref().and_then(|span| sources.position(span));
        Problem {
            place: position.map_or_else(String::new, |at| format!("{}:{}:{}", at.file, at.line, at.column)),
            message: error.message.clone(),
            help: error.help.clone(),
        }
    };
    errors.iter().map(problem).collect()
}

/// Which version of a scene is built.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Version {
    /// Increases whenever a file has changed.
    pub(crate) files: u64,
    /// The accelerator in place of the scene's own.
    pub(crate) accelerator: Option<String>,
    /// The camera's view, if the build depends on it.
    pub(crate) look_at: Option<LookAt>,
}

/// Where the scene comes from.
#[derive(Clone, Debug, Default)]
pub(crate) struct Origin {
    pub(crate) path: PathBuf,
    pub(crate) overrides: Vec<String>,
    pub(crate) camera: Option<String>,
    pub(crate) root: Option<PathBuf>,
    pub(crate) max_memory: Option<u64>,
    pub(crate) max_tree_rays: Option<u32>,
    /// Folder for data that takes long to compute, and whether that of earlier runs is used.
    pub(crate) cache: (PathBuf, bool),
}

/// A scene that could not be built.
pub(crate) struct Failed {
    pub(crate) problems: Vec<Problem>,
    /// The same as text for a terminal.
    pub(crate) report: String,
    /// The files that were read before the problem was found.
    pub(crate) files: Vec<PathBuf>,
}

/// A built scene.
pub(crate) struct Loaded {
    pub(crate) pipeline: Pipeline,
    pub(crate) version: Version,
    /// The scene without the layers that the view adds.
    pub(crate) flattened: Flattened,
    /// The names of its shapes: id or type.
    pub(crate) shapes: Vec<String>,
    /// The view of its camera; `None` if the camera cannot be moved.
    pub(crate) look_at: Option<LookAt>,
    pub(crate) files: Vec<PathBuf>,
    pub(crate) warnings: Vec<Problem>,
    /// Time from the start of reading to the end of the build, in seconds.
    pub(crate) seconds: f64,
    /// Whether the build depends on the camera: coincident surfaces are separated as it sees them,
    /// and object-order renderers project in advance.
    pub(crate) depends_on_camera: bool,
    /// The size of the finished picture.
    pub(crate) size: FilmSize,
    table: Table,
    /// The sampler that is not in use: the scene's own, or that of previews.
    other_sampler: Option<Box<dyn Sampler>>,
    previews: bool,
    /// The view and the size of the camera in use.
    shown: (Option<LookAt>, FilmSize),
}

/// The picture that is wanted of a scene.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Aspect {
    /// The view, if it is not the scene's own.
    pub(crate) look_at: Option<LookAt>,
    /// Divisor of the size.
    pub(crate) divisor: u32,
    /// Whether one ray for each pixel is enough.
    pub(crate) preview: bool,
}

impl Origin {
    /// The changes of the scene that a version of it has.
    pub(crate) fn changes(&self, version: &Version) -> Vec<String> {
        let look_at = version.look_at.map(LookAt::change);
        let accelerator = version.accelerator.as_ref();
        let accelerator =
            accelerator.map(|name| format!("accelerator={{type={}}}", Value::from(name.clone())));
        let own = self.overrides.iter().cloned();
        own.chain(look_at).chain(accelerator).collect()
    }

    /// Reads the texts of a version.
    fn sources(&self, changes: &[String], registry: &Registry) -> Result<Sources, Failed> {
        let import = ImportOptions {
            camera: self.camera.clone(),
            root: self.root.clone(),
            ..ImportOptions::all()
        };
        Sources::load_with(&self.path, changes, registry, &import)
            .map_err(|error| self.failed(&error.sources, &error.errors, Vec::new()))
    }

    fn failed(&self, sources: &Sources, errors: &SceneErrors, named: Vec<PathBuf>) -> Failed {
        let mut files: Vec<PathBuf> = sources.scene_files().map(Path::to_owned).collect();
        files.extend(named);
        files.push(self.path.clone());
        Failed {
            problems: problems(sources, &errors.0),
            report: sources.report(errors, false),
            files,
        }
    }

    /// The scene as one document, as a reference renderer reads it.
    pub(crate) fn flatten(&self, version: &Version, registry: &Registry) -> Result<Flattened, Failed> {
        let sources = self.sources(&self.changes(version), registry)?;
        let description = Description::parse(&sources).into_result();
        let description = description.map_err(|errors| self.failed(&sources, &errors, Vec::new()))?;
        Ok(description.flattened)
    }

    /// Builds a version of the scene. `shared` keeps the contents of files, and must be new if a
    /// file has changed.
    pub(crate) fn load(
        &self,
        version: Version,
        registry: &Registry,
        shared: &Arc<Shared>,
    ) -> Result<Loaded, Failed> {
        let start = Instant::now();
        let changes = self.changes(&version);
        let plain = self.sources(&changes, registry)?;
        let checked = Description::parse(&plain);
        let named = checked.value.as_ref().map(|found| found.flattened.files.clone());
        let named = named.unwrap_or_default();
        let flattened = match checked.into_result() {
            Ok(description) => Ok(description.flattened),
            Err(errors) => Err(errors),
        };
        let all = [&changes[..], &[LAYER_NAMES.to_owned()]].concat();
        // Where the text is wrong, its errors are found again, with those of the later steps.
        let sources = self.sources(&all, registry)?;
        let options = BuildOptions {
            max_memory: self.max_memory,
            max_tree_rays: self.max_tree_rays,
            shared: Some(shared),
            cache: Some(Cache {
                folder: &self.cache.0,
                reuse: self.cache.1,
            }),
            ..BuildOptions::default()
        };
        let note = |plan: &Plan<'_, '_>| -> Vec<String> {
            let name = |shape: &whitstone_scene::ShapeTable<'_>| {
                let kind = &shape.plugin.name;
                shape
                    .id
                    .as_ref()
                    .map_or_else(|| kind.clone(), |id| format!("{kind} \"{id}\""))
            };
            plan.shapes().into_iter().map(name).collect()
        };
        let built = Pipeline::load_and(&sources, registry, options, note);
        let (pipeline, shapes) = built.map_err(|errors| self.failed(&sources, &errors, named.clone()))?;
        let flattened = flattened.map_err(|errors| self.failed(&plain, &errors, named))?;
        let table: Table = flattened.text.parse().unwrap_or_default();
        let scenes = sources.scene_files().map(Path::to_owned);
        let files = scenes.chain(flattened.files.clone()).collect();
        let (size, look_at) = (pipeline.film.size, LookAt::of(&table));
        let other_sampler = parts(&table, None, size, registry)
            .map(|found| found.sampler)
            .ok();
        Ok(Loaded {
            warnings: problems(&sources, &pipeline.warnings),
            depends_on_camera: pipeline.object_order.is_some() || !pipeline.coincident.is_empty(),
            pipeline,
            look_at,
            flattened,
            shapes,
            files,
            seconds: start.elapsed().as_secs_f64(),
            size,
            table,
            other_sampler,
            previews: false,
            shown: (version.look_at, size),
            version,
        })
    }
}

/// What a picture of a scene needs besides its contents.
struct Parts {
    camera: Box<dyn Camera>,
    sampler: Box<dyn Sampler>,
}

/// Builds the camera of a scene with another view and size, and the sampler of previews: as a scene
/// of its own, which has nothing else.
fn parts(
    scene: &Table,
    look_at: Option<LookAt>,
    size: FilmSize,
    registry: &Registry,
) -> Result<Parts, String> {
    let mut camera = scene.get("camera").cloned().unwrap_or(Value::Table(Table::new()));
    if let (Some(look_at), Some(camera)) = (look_at, camera.as_table_mut()) {
        camera.insert(camera::KEY.to_owned(), look_at.to_toml());
    }
    let sides = [("width", size.width), ("height", size.height)];
    let film = sides.map(|(key, side)| (key.to_owned(), Value::from(i64::from(side))));
    let mut document = Table::new();
    document.insert("film".to_owned(), Value::Table(film.into_iter().collect()));
    document.insert("camera".to_owned(), camera);
    if registry.get(FamilyName::Sampler, PREVIEW_SAMPLER).is_ok() {
        let kind = [("type".to_owned(), Value::from(PREVIEW_SAMPLER))];
        document.insert("sampler".to_owned(), Value::Table(kind.into_iter().collect()));
    }
    let text = toml::to_string(&document).map_err(|error| error.to_string())?;
    let sources = Sources::from_text("view", &text, Path::new(""), &[]).map_err(|error| error.to_string())?;
    let built = Pipeline::load(&sources, registry, BuildOptions::default());
    // Without positions, which would be those of a text that nobody has written.
    let built = built.map_err(|errors| {
        let all: Vec<&str> = errors.0.iter().map(|error| error.message.as_str()).collect();
        all.join("; ")
    })?;
    Ok(Parts {
        camera: built.camera,
        sampler: built.sampler,
    })
}

impl Loaded {
    /// The size of a picture with a divisor.
    pub(crate) fn size_at(&self, divisor: u32) -> FilmSize {
        let side = |pixels: u32| pixels.div_ceil(divisor.max(1));
        FilmSize {
            width: side(self.size.width),
            height: side(self.size.height),
        }
    }

    /// Whether pictures of other sizes are possible.
    pub(crate) fn can_shrink(&self) -> bool {
        self.pipeline.object_order.is_none()
    }

    /// Whether a preview has fewer samples than the picture.
    pub(crate) fn has_previews(&self) -> bool {
        self.can_shrink() && self.own_samples() > 1 && self.other_sampler.is_some()
    }

    /// The number of samples of a pixel of the finished picture.
    pub(crate) fn own_samples(&self) -> u32 {
        let own = match (self.previews, &self.other_sampler) {
            (true, Some(own)) => own,
            _ => &self.pipeline.sampler,
        };
        own.count() * self.pipeline.camera.lens_points() * self.pipeline.moments()
    }

    /// Prepares the pipeline for a picture, with the given layers.
    ///
    /// # Errors
    /// If there is no such camera.
    pub(crate) fn prepare(
        &mut self,
        aspect: Aspect,
        layers: &[Aov],
        registry: &Registry,
    ) -> Result<(), String> {
        let wanted = (aspect.look_at, self.size_at(aspect.divisor));
        if self.shown != wanted {
            if aspect.look_at.is_some() && self.look_at.is_none() {
                return Err("this camera has no `look_at`, so it cannot be moved".to_owned());
            }
            let found = parts(&self.table, aspect.look_at, wanted.1, registry)?;
            self.pipeline.camera = found.camera;
            self.pipeline.film.size = wanted.1;
            self.shown = wanted;
        }
        if let Some(other) = &mut self.other_sampler
            && self.previews != aspect.preview
        {
            std::mem::swap(&mut self.pipeline.sampler, other);
            self.previews = aspect.preview;
        }
        self.pipeline.film.aovs = layers.to_vec();
        // The view has no pictures of path classes.
        self.pipeline.film.paths = None;
        Ok(())
    }
}
