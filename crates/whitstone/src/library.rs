//! Scenes as values, for programs that render, compare or trace rays.

use std::fmt;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use whitstone_core::{ImportOptions, PreliminaryIntersection, Ray, Registry, SceneError, SceneErrors};
use whitstone_image::Image;
use whitstone_render::{BuildOptions, Film, FilmError, Pipeline, RenderOptions, Shared};
use whitstone_scene::{Flattened, LoadError, Plan, Position, Sources};

/// A scene that is built: it can be rendered any number of times, from several threads. A clone is
/// the same scene.
///
#[cfg_attr(feature = "plugins", doc = "```")]
#[cfg_attr(not(feature = "plugins"), doc = "```ignore")]
/// use whitstone::{Change, Scene};
///
/// let scene = Scene::parse(
///     r#"
///     film = { width = 32, height = 24 }
///     camera = { type = "perspective", look_at = { origin = [0, 0, 4], target = [0, 0, 0] } }
///     light = [{ type = "ambient", radiance = 1 }]
///     shape = [{ type = "sphere" }]
///     "#,
///     ".",
/// )?;
/// let image = scene.render()?;
/// assert_eq!((image.width(), image.height()), (32, 24));
///
/// // Another scene, with one value changed.
/// let wide = scene.with(&[Change::new("camera.fov", 90)])?;
/// assert_ne!(wide.render()?, image);
///
/// // All problems are reported, each with its place.
/// let error = scene.with(&[Change::new("camera.fow", 30)]).err().unwrap();
/// assert!(error.to_string().contains("fov"), "{error}");
/// # Ok::<(), whitstone::Error>(())
/// ```
#[derive(Clone)]
pub struct Scene(Arc<Built>);

struct Built {
    origin: Origin,
    changes: Vec<Change>,
    options: SceneOptions,
    /// Files that were read, for the scenes that are made from this one.
    shared: Arc<Shared>,
    pipeline: Pipeline,
    flattened: Flattened,
    files: Vec<PathBuf>,
    warnings: Vec<Problem>,
}

/// Where a scene comes from.
#[derive(Clone)]
enum Origin {
    File(PathBuf),
    Text { text: Arc<str>, base: PathBuf },
}

impl Origin {
    fn read(&self, changes: &[Change], options: &SceneOptions) -> Result<Sources, Error> {
        let overrides: Vec<String> = changes.iter().map(|change| change.0.clone()).collect();
        let sources = match self {
            Self::File(path) => {
                let import = ImportOptions {
                    camera: options.camera.clone(),
                    ..ImportOptions::all()
                };
                Sources::load_with(path, &overrides, &options.registry, &import)?
            }
            Self::Text { text, base } => Sources::from_text("scene", text, base, &overrides)?,
        };
        Ok(sources)
    }
}

/// Options of reading and building a scene.
#[derive(Clone)]
pub struct SceneOptions {
    /// The plugins; by default all built-in ones (with the feature `plugins`).
    pub registry: Arc<Registry>,
    /// Memory limit in bytes for meshes and accelerators; by default the available memory.
    pub max_memory: Option<u64>,
    /// Maximum number of rays of one sample of a pixel; by default that of
    /// [`whitstone_core::TreeLimits`].
    pub max_tree_rays: Option<u32>,
    /// Camera of a file of another format, by name or index; by default the first.
    pub camera: Option<String>,
}

impl SceneOptions {
    /// The default options with these plugins.
    pub fn with_registry(registry: Registry) -> Self {
        Self {
            registry: Arc::new(registry),
            max_memory: None,
            max_tree_rays: None,
            camera: None,
        }
    }
}

#[cfg(feature = "plugins")]
impl Default for SceneOptions {
    fn default() -> Self {
        Self::with_registry(crate::registry())
    }
}

/// A change of a value of a scene.
#[derive(Clone, Debug, PartialEq)]
pub struct Change(String);

impl Change {
    /// The value at a path such as `camera.fov`, `shape.2.radius` or `material.glass.interior_ior`
    /// becomes another one. A table replaces a whole plugin.
    pub fn new(path: &str, value: impl Into<toml::Value>) -> Self {
        Self(format!("{path}={}", value.into()))
    }

    /// `PATH=VALUE` with a value in TOML, as on the command line.
    pub fn parse(text: &str) -> Self {
        Self(text.to_owned())
    }
}

/// Why a scene cannot be built or rendered.
#[derive(Clone, Debug)]
pub struct Error {
    /// All problems.
    pub problems: Vec<Problem>,
    report: String,
}

/// A problem at its place.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Problem {
    /// File, line and column; none for a scene without text.
    pub place: Option<Position>,
    /// The fault, and what was expected.
    pub message: String,
    /// A hint on how to fix it.
    pub help: Option<String>,
}

impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.report)
    }
}

impl std::error::Error for Error {}

impl Error {
    fn new(sources: &Sources, errors: &SceneErrors) -> Self {
        Self {
            problems: problems(sources, &errors.0),
            report: sources.report(errors, false),
        }
    }
}

fn problems(sources: &Sources, errors: &[SceneError]) -> Vec<Problem> {
    let problem = |error: &SceneError| Problem {
        place: error.span.as_ref().and_then(|span| sources.position(span)),
        message: error.message.clone(),
        help: error.help.clone(),
    };
    errors.iter().map(problem).collect()
}

impl From<Box<LoadError>> for Error {
    fn from(error: Box<LoadError>) -> Self {
        Self::new(&error.sources, &error.errors)
    }
}

impl From<FilmError> for Error {
    fn from(error: FilmError) -> Self {
        let message = error.to_string();
        Self {
            report: format!("error: {message}"),
            problems: vec![Problem {
                place: None,
                message,
                help: None,
            }],
        }
    }
}

impl Scene {
    /// Reads and builds a scene file of any format.
    ///
    /// # Errors
    /// All that is wrong with it.
    #[cfg(feature = "plugins")]
    pub fn open(path: impl AsRef<Path>) -> Result<Self, Error> {
        Self::open_with(path, &[], SceneOptions::default())
    }

    /// [`Self::open`] with changes and options.
    ///
    /// # Errors
    /// All that is wrong with it.
    pub fn open_with(
        path: impl AsRef<Path>,
        changes: &[Change],
        options: SceneOptions,
    ) -> Result<Self, Error> {
        let origin = Origin::File(path.as_ref().to_owned());
        Self::build(origin, changes.to_vec(), options, Arc::default())
    }

    /// Builds a scene from TOML text. Its paths are relative to `base`.
    ///
    /// # Errors
    /// All that is wrong with it.
    #[cfg(feature = "plugins")]
    pub fn parse(text: &str, base: impl AsRef<Path>) -> Result<Self, Error> {
        Self::parse_with(text, base, &[], SceneOptions::default())
    }

    /// [`Self::parse`] with changes and options.
    ///
    /// # Errors
    /// All that is wrong with it.
    pub fn parse_with(
        text: &str,
        base: impl AsRef<Path>,
        changes: &[Change],
        options: SceneOptions,
    ) -> Result<Self, Error> {
        let origin = Origin::Text {
            text: text.into(),
            base: base.as_ref().to_owned(),
        };
        Self::build(origin, changes.to_vec(), options, Arc::default())
    }

    /// The same scene with other values of some keys. Images and meshes that several scenes of this
    /// origin use are read at most twice.
    ///
    /// # Errors
    /// All that is wrong with it.
    pub fn with(&self, changes: &[Change]) -> Result<Self, Error> {
        let all = [&self.0.changes, changes].concat();
        let Built {
            origin,
            options,
            shared,
            ..
        } = &*self.0;
        Self::build(origin.clone(), all, options.clone(), shared.clone())
    }

    fn build(
        origin: Origin,
        changes: Vec<Change>,
        options: SceneOptions,
        shared: Arc<Shared>,
    ) -> Result<Self, Error> {
        let sources = origin.read(&changes, &options)?;
        let build = BuildOptions {
            max_memory: options.max_memory,
            max_tree_rays: options.max_tree_rays,
            shared: Some(&shared),
            ..BuildOptions::default()
        };
        let note = |plan: &Plan<'_, '_>| {
            let scenes = plan.description.sources.scene_files().map(Path::to_owned);
            let scenes: Vec<PathBuf> = match &origin {
                Origin::File(_) => scenes.collect(),
                Origin::Text { .. } => Vec::new(),
            };
            let flattened = plan.description.flattened.clone();
            ([scenes, flattened.files.clone()].concat(), flattened)
        };
        let (pipeline, (files, flattened)) = Pipeline::load_and(&sources, &options.registry, build, note)
            .map_err(|errors| Error::new(&sources, &errors))?;
        let warnings = problems(&sources, &pipeline.warnings);
        Ok(Self(Arc::new(Built {
            origin,
            changes,
            options,
            shared,
            pipeline,
            flattened,
            files,
            warnings,
        })))
    }

    /// Renders the image with its layers, on all cores.
    ///
    /// # Errors
    /// The ray tree of a sample exceeds its limits ([`whitstone_core::TreeLimits`]).
    pub fn render(&self) -> Result<Image, Error> {
        let film = self.render_with(RenderOptions::default());
        Ok(film.into_image(&self.0.pipeline.scene_hash)?)
    }

    /// Renders a region, with a number of threads, or with progress that can stop it.
    pub fn render_with(&self, options: RenderOptions<'_>) -> Film {
        self.0.pipeline.render(options)
    }

    /// [`Self::render_with`] into a film of the caller, whose buffers serve again, for the frames
    /// of an animation.
    pub fn render_into(&self, options: RenderOptions<'_>, film: &mut Film) {
        self.0.pipeline.render_into(options, film);
    }

    /// The nearest hit of each ray, traced on all threads of the current pool. Directions need not
    /// be of unit length; the parameter of a hit is its distance in metres.
    ///
    #[cfg_attr(feature = "plugins", doc = "```")]
    #[cfg_attr(not(feature = "plugins"), doc = "```ignore")]
    /// use whitstone::Scene;
    /// use whitstone::core::{DVec3, Ray};
    ///
    /// let scene = Scene::parse(
    ///     r#"
    ///     camera = { type = "perspective", look_at = { origin = [0, 0, 4], target = [0, 0, 0] } }
    ///     shape = [{ type = "sphere" }]
    ///     "#,
    ///     ".",
    /// )?;
    /// let towards = |direction| Ray::new(DVec3::new(0.0, 0.0, 4.0), direction);
    /// let rays = [towards(DVec3::new(0.0, 0.0, -2.0)), towards(DVec3::Y)];
    /// let hits = scene.trace(&rays);
    /// assert_eq!(hits[0].map(|hit| (hit.t, hit.shape)), Some((3.0, 0)));
    /// assert_eq!(hits[1], None);
    ///
    /// let mut again = [None; 2];
    /// scene.trace_into(&rays, &mut again);
    /// assert_eq!(again[..], hits);
    /// # Ok::<(), whitstone::Error>(())
    /// ```
    pub fn trace(&self, rays: &[Ray]) -> Vec<Option<PreliminaryIntersection>> {
        let mut hits = vec![None; rays.len()];
        self.trace_into(rays, &mut hits);
        hits
    }

    /// [`Self::trace`] into memory of the caller. This is two to three times as fast for many rays
    /// in a simple scene, where most of the time of [`Self::trace`] goes to getting new memory.
    ///
    /// # Panics
    /// `hits` has another length than `rays`.
    pub fn trace_into(&self, rays: &[Ray], hits: &mut [Option<PreliminaryIntersection>]) {
        self.0.pipeline.trace_into(rays, hits);
    }

    /// The oracle for this scene: first hits of rays and values of pixels in arbitrary precision,
    /// by code of its own.
    ///
    /// # Errors
    /// Every part of the scene that the oracle does not support.
    #[cfg(feature = "stress")]
    pub fn oracle(&self) -> Result<whitstone_oracle::tracer::Tracer, Error> {
        let Built {
            origin,
            changes,
            options,
            ..
        } = &*self.0;
        let sources = origin.read(changes, options)?;
        let description = whitstone_scene::Description::parse(&sources).into_result();
        let tracer = description.and_then(|description| whitstone_oracle::tracer::Tracer::new(&description));
        tracer.map_err(|errors| Error::new(&sources, &errors))
    }

    /// The built scene.
    pub fn pipeline(&self) -> &Pipeline {
        &self.0.pipeline
    }

    /// The scene as one TOML document without includes and changes.
    pub fn flattened(&self) -> &Flattened {
        &self.0.flattened
    }

    /// The files that the scene was read from.
    pub fn files(&self) -> &[PathBuf] {
        &self.0.files
    }

    /// What is unusual about it.
    pub fn warnings(&self) -> &[Problem] {
        &self.0.warnings
    }
}
