//! The renderers: pipelines of the registry, Mitsuba through the driver of the harness, and
//! Mitsuba's own integrators.

use crate::cache::{Cache, Record};
use crate::errors::{Measured, edges};
use crate::study::{self, Against, Change, Engine, Series, Study};
use crate::usage::{Memory, Ticks, processor_time};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};
use whitstone_core::{FamilyName, Registry, SceneError, SceneErrors};
use whitstone_image::{Image, Limits, atomic, exr_io};
use whitstone_metrics::Mask;
use whitstone_render::{BuildOptions, Pipeline, RenderOptions};
use whitstone_scene::{Description, Flattened, Sources};
use whitstone_validate::driver::{Driver, DriverError, Rendered, SceneText, Setting};
use whitstone_validate::exported::{self, ExportedMitsuba, Seconds};
use whitstone_validate::subject::Once;
use whitstone_validate::{Stop, Subject};

/// Shorter renderings, in seconds, are timed in batches, because clocks and schedulers have a
/// limited resolution.
const SHORTEST: f64 = 0.02;
/// Largest batch.
const MAX_AT_ONCE: u32 = 50;
/// Pause before each repeat: threads of the previous run, perhaps of another process, spin for a
/// while before they sleep.
const REST: Duration = Duration::from_millis(20);
/// Smallest number of repeats.
const FEWEST: usize = 3;

/// Options for measuring studies.
#[derive(Clone, Debug)]
pub struct Options {
    /// Number of repeats, unless the study sets it.
    pub repeats: usize,
    /// Overrides the number of repeats of every study.
    pub forced_repeats: Option<usize>,
    /// Approximate time budget for the repeats of one setting, in seconds. At least three repeats
    /// are measured in any case.
    pub budget: f64,
    /// Threads of both renderers; 0 for one per core.
    pub threads: usize,
    /// How the user calls this program, for the commands in reports.
    pub program: String,
    /// The folder of all results.
    pub target: PathBuf,
    /// A request to stop early, which ends commands.
    pub stop: Stop,
}

/// The renderers, the cache and the options.
pub struct Lab<'a> {
    pub(crate) registry: &'a Registry,
    pub(crate) mitsuba: Option<Driver>,
    stock: Option<ExportedMitsuba>,
    /// Why Mitsuba takes no part.
    absent: String,
    /// Why kernels of others take no part.
    absent_kernels: BTreeMap<Engine, String>,
    /// Hash of this program: another build has other times, and perhaps other images.
    program_hash: String,
    /// Hash of the Mitsuba driver.
    driver_hash: String,
    pub(crate) cache: Cache,
    pub(crate) options: Options,
    /// Whether to stop after the first half of the times.
    pub(crate) halfway: bool,
}

/// A configuration that is ready to be timed.
pub(crate) enum Ready {
    Whitstone(Box<Pipeline>),
    Mitsuba(Flattened),
    StockMitsuba(Exported),
    Command(Box<Commanded>),
}

/// A scene for the command of a renderer.
pub(crate) struct Commanded {
    subject: Subject,
    scene: Flattened,
    size: [usize; 2],
    samples: u32,
    primitives: u64,
}

/// A scene for Mitsuba's own integrators.
pub(crate) struct Exported {
    file: PathBuf,
    samples: u32,
    primitives: u64,
    /// Where the file and its meshes are.
    folder: atomic::TemporaryFolder,
}

/// One rendering with its measurements.
pub(crate) struct Shot {
    pub(crate) image: Image,
    pub(crate) seconds: f64,
    pub(crate) cpu: f64,
    pub(crate) build_s: f64,
    /// 0 if they are not counted.
    rays: u64,
    samples: u32,
    primitives: Option<u64>,
    memory: Option<u64>,
}

impl<'a> Lab<'a> {
    /// `mitsuba` is the driver, or the reason why there is none. `driver_hash` is a text that
    /// changes with the driver.
    pub fn new(
        registry: &'a Registry,
        mitsuba: Result<Driver, String>,
        driver_hash: &str,
        cache: Cache,
        options: Options,
    ) -> Self {
        let (mitsuba, absent) = match mitsuba {
            Ok(driver) => (Some(driver), String::new()),
            Err(why) => (None, why),
        };
        let program = std::env::current_exe()
            .and_then(std::fs::read)
            .unwrap_or_default();
        Self {
            registry,
            mitsuba,
            stock: None,
            absent,
            absent_kernels: absent_kernels(registry),
            program_hash: blake3::hash(&program).to_hex().to_string(),
            driver_hash: driver_hash.to_owned(),
            cache,
            options,
            halfway: false,
        }
    }

    /// Adds Mitsuba's own integrators.
    pub fn with_stock(mut self, stock: ExportedMitsuba) -> Self {
        self.stock = Some(stock);
        self
    }

    /// Why an engine takes no part.
    pub(crate) fn absent(&self, engine: Engine) -> Option<&str> {
        match engine {
            Engine::Mitsuba if self.mitsuba.is_none() => Some(&self.absent),
            Engine::StockMitsuba if self.stock.is_none() => Some(&self.absent),
            _ => self.absent_kernels.get(&engine).map(|why| &**why),
        }
    }

    /// Processor time of the whole machine and of the measured processes, if the system reports it.
    fn ticks(&self) -> Option<Ticks> {
        let driver = self.mitsuba.iter().map(Driver::process);
        let stock = self.stock.iter().map(ExportedMitsuba::process);
        Ticks::now(&driver.chain(stock).collect::<Vec<u32>>())
    }

    /// The cache key of everything that determines a rendering of a scene.
    pub(crate) fn key(&self, kind: &str, engine: Engine, flattened: &Flattened, truth: &str) -> String {
        let threads = self.options.threads.to_string();
        let Flattened { text, hash, .. } = flattened;
        let version = match engine {
            Engine::Mitsuba | Engine::StockMitsuba => &self.driver_hash,
            _ => &self.program_hash,
        };
        Cache::key(&[kind, engine.name(), text, hash, truth, &threads, version])
    }

    /// The scene with changes, flattened to one document.
    pub(crate) fn flatten(&self, study: &Study, changes: &[Change]) -> Result<Flattened, String> {
        let sources = load(study, changes, self.registry)?;
        let description = Description::parse(&sources)
            .into_result()
            .map_err(|errors| placed(study, changes, &sources, errors))?;
        Ok(description.flattened)
    }

    /// Builds the scene with changes.
    pub(crate) fn build(&self, study: &Study, changes: &[Change]) -> Result<Pipeline, String> {
        let sources = load(study, changes, self.registry)?;
        let report = |errors: SceneErrors| placed(study, changes, &sources, errors);
        Pipeline::load(&sources, self.registry, BuildOptions::default()).map_err(report)
    }

    /// Pixels whose neighbourhood shows more than one surface.
    pub(crate) fn edges(&self, study: &Study, changes: &[Change]) -> Result<Mask, String> {
        let mut changes = changes.to_vec();
        let here = 0..0;
        for text in ["film.aovs=[\"shape_id\"]", "sampler={ type = \"center\" }"] {
            let text = text.to_owned();
            changes.push(Change {
                text,
                span: here.clone(),
            });
        }
        let film = self.build(study, &changes)?.render(self.render_options());
        let ids = film.layers.first().map_or(&[][..], |(_, values)| values);
        Ok(edges(film.width as usize, film.height as usize, ids))
    }

    fn render_options(&self) -> RenderOptions<'static> {
        RenderOptions {
            threads: self.options.threads,
            ..RenderOptions::default()
        }
    }

    /// Builds and renders a setting of a series once, to warm up and to get the image.
    pub(crate) fn first_of(
        &mut self,
        study: &Study,
        series: &Series,
        setting: &study::Setting,
    ) -> Result<(Ready, Shot), String> {
        let changes = study.changes(series, setting);
        let Some(subject) = &series.subject else {
            return self.first(study, series.engine, &changes);
        };
        let pipeline = self.build(study, &changes)?;
        let mut scene = self.flatten(study, &changes)?;
        if let Some(text) = subject.centered(&scene)? {
            let centered = Change { text, span: 0..0 };
            scene = self.flatten(study, &[&changes[..], &[centered]].concat())?;
        }
        let commanded = Commanded {
            subject: subject.clone(),
            scene,
            size: [pipeline.film.size.width, pipeline.film.size.height].map(|size| size as usize),
            samples: setting.value.map_or(1, |samples| samples as u32),
            primitives: primitives(&pipeline),
        };
        // The first run reads files that later ones find in memory.
        self.run_command(&commanded)?;
        let (image, seconds) = self.run_command(&commanded)?;
        let shot = Shot {
            image,
            seconds,
            cpu: f64::NAN,
            build_s: 0.0,
            rays: 0,
            samples: commanded.samples,
            primitives: Some(commanded.primitives),
            memory: None,
        };
        Ok((Ready::Command(Box::new(commanded)), shot))
    }

    /// Runs a command; returns its image and the wall time of the whole command.
    fn run_command(&self, commanded: &Commanded) -> Result<(Image, f64), String> {
        let once = Once {
            registry: self.registry,
            target: &self.options.target,
            folder: Path::new("converge"),
            scene: &commanded.scene,
            size: commanded.size,
            samples: commanded.samples,
            threads: self.options.threads,
            stop: &self.options.stop,
        };
        let rendered = commanded.subject.render_once(&once);
        rendered.map_err(|error| error.to_string())
    }

    /// Builds and renders once, to warm up and to get the image.
    pub(crate) fn first(
        &mut self,
        study: &Study,
        engine: Engine,
        changes: &[Change],
    ) -> Result<(Ready, Shot), String> {
        match engine {
            Engine::Command => Err("a command renders only in a series of its own".to_owned()),
            Engine::Whitstone | Engine::Embree | Engine::Obvhs => {
                let memory = Memory::start();
                let pipeline = self.build(study, changes)?;
                let mut shot = self.shoot_whitstone(&pipeline)?;
                shot.memory = memory.grown();
                Ok((Ready::Whitstone(Box::new(pipeline)), shot))
            }
            Engine::Mitsuba => {
                let flattened = self.flatten(study, changes)?;
                let mut shot = self.shoot_mitsuba(&flattened)?;
                let (build_s, memory) = (shot.build_s, shot.memory);
                // The first rendering compiles kernels, so the number of repeats is based on the
                // second one.
                shot = self.shoot_mitsuba(&flattened)?;
                (shot.build_s, shot.memory) = (build_s, memory);
                if study.against == Against::Primitives {
                    // The driver does not report it; the scene is the same.
                    shot.primitives = Some(primitives(&self.build(study, changes)?));
                }
                Ok((Ready::Mitsuba(flattened), shot))
            }
            Engine::StockMitsuba => {
                let exported = self.export(study, changes)?;
                // The first rendering compiles kernels.
                self.render_stock(&exported)?;
                let shot = self.shoot_stock(&exported)?;
                Ok((Ready::StockMitsuba(exported), shot))
            }
            Engine::NaiveDoubleDouble | Engine::NaiveF64 | Engine::NaiveF32 => {
                Err("textbook formulas cannot render scenes".to_owned())
            }
        }
    }

    fn shoot_whitstone(&self, pipeline: &Pipeline) -> Result<Shot, String> {
        let start = processor_time();
        let film = pipeline.render(self.render_options());
        let cpu = processor_time() - start;
        let image = film
            .to_image(&pipeline.scene_hash)
            .map_err(|error| error.to_string())?;
        Ok(Shot {
            image,
            seconds: film.render_seconds,
            cpu,
            build_s: pipeline.build_seconds,
            rays: film.counters.total(),
            samples: film.samples,
            primitives: Some(primitives(pipeline)),
            memory: None,
        })
    }

    fn export(&self, study: &Study, changes: &[Change]) -> Result<Exported, String> {
        let flattened = self.flatten(study, changes)?;
        let pipeline = self.build(study, changes)?;
        let told = |error: std::io::Error| error.to_string();
        let folder = atomic::TemporaryFolder::new_in(self.cache.make()?).map_err(told)?;
        let place = std::path::absolute(folder.path()).map_err(told)?;
        let export = exported::export(self.registry, &flattened, &place)?;
        if !export.lost.is_empty() {
            let lost = export.lost.join(", ");
            return Err(format!(
                "Mitsuba's own integrators render another scene, because they lack: {lost}"
            ));
        }
        Ok(Exported {
            file: export.file,
            samples: pipeline.sampler.count(),
            primitives: primitives(&pipeline),
            folder,
        })
    }

    /// Renders with Mitsuba's own integrators; returns the times of loading and of rendering.
    fn render_stock(&mut self, scene: &Exported) -> Result<(Seconds, Seconds), String> {
        let stock = self.stock.as_mut().ok_or_else(|| self.absent.clone())?;
        Ok((stock.load(&scene.file)?, stock.render(scene.samples, 0)?))
    }

    fn shoot_stock(&mut self, scene: &Exported) -> Result<Shot, String> {
        let (loading, rendering) = self.render_stock(scene)?;
        let out = std::path::absolute(scene.folder.path().join("image.exr"));
        let out = out.map_err(|error| error.to_string())?;
        if let Some(stock) = &mut self.stock {
            stock.write(&out)?;
        }
        let image = exr_io::read(&out, Limits::IMAGE).map_err(|error| error.to_string())?;
        Ok(Shot {
            image,
            seconds: rendering.wall,
            cpu: rendering.processor,
            build_s: loading.wall,
            rays: 0,
            samples: scene.samples,
            primitives: Some(scene.primitives),
            memory: None,
        })
    }

    fn shoot_mitsuba(&mut self, flattened: &Flattened) -> Result<Shot, String> {
        let folder =
            atomic::TemporaryFolder::new_in(self.cache.make()?).map_err(|error| error.to_string())?;
        let out = std::path::absolute(folder.path().join("image.exr")).map_err(|error| error.to_string())?;
        let rendered = self.drive(flattened, &out)?;
        let image = exr_io::read(&out, Limits::IMAGE).map_err(|error| error.to_string())?;
        Ok(Shot {
            image,
            seconds: rendered.seconds.trace,
            cpu: rendered.seconds.cpu,
            build_s: rendered.seconds.load,
            rays: rendered.rays.closest + rendered.rays.shadow,
            samples: rendered.samples,
            primitives: None,
            memory: rendered.memory,
        })
    }

    fn drive(&mut self, flattened: &Flattened, out: &Path) -> Result<Rendered, String> {
        let threads = self.options.threads;
        let driver = self.mitsuba.as_mut().ok_or_else(|| self.absent.clone())?;
        let text = SceneText {
            text: &flattened.text,
            base: &flattened.base,
        };
        let answer = driver.render(text, out, Setting::default(), threads);
        if !matches!(
            answer,
            Ok(_) | Err(DriverError::Refused(_) | DriverError::Unsupported(_))
        ) {
            // The driver has crashed; no further Mitsuba renderings are possible.
            self.mitsuba = None;
            self.absent = "its driver crashed".to_owned();
        }
        answer.map_err(|error| error.to_string())
    }

    /// The number of repeats to measure, at most `affordable`.
    pub(crate) fn repeats(&self, study: &Study, affordable: usize) -> usize {
        let wanted = study
            .repeats
            .map_or(self.options.repeats, |repeats| repeats as usize);
        let wanted = self.options.forced_repeats.unwrap_or(wanted);
        wanted.min(affordable)
    }

    /// A record without times.
    pub(crate) fn record(&self, study: &Study, shot: &Shot, errors: Measured) -> Record {
        let seconds = shot.seconds.max(1e-6);
        let affordable = ((self.options.budget / seconds) as usize).max(FEWEST);
        Record {
            build_s: shot.build_s,
            times: Vec::new(),
            cpu: Vec::new(),
            used: Ticks::default(),
            rays: shot.rays,
            samples: shot.samples,
            primitives: shot.primitives,
            memory: shot.memory,
            repeats: self.repeats(study, affordable),
            affordable,
            batch: ((SHORTEST / seconds).ceil() as u32).clamp(1, MAX_AT_ONCE),
            errors,
        }
    }

    /// Measures one more repeat. Short renderings run once untimed before it, to warm the caches.
    pub(crate) fn time(&mut self, ready: &Ready, record: &mut Record) -> Result<(), String> {
        std::thread::sleep(REST);
        if record.batch > 1 {
            match ready {
                Ready::Command(_) => {}
                Ready::Whitstone(pipeline) => drop(pipeline.render(self.render_options())),
                Ready::Mitsuba(flattened) => drop(self.shoot_mitsuba(flattened)?),
                Ready::StockMitsuba(scene) => drop(self.render_stock(scene)?),
            }
        }
        let before = self.ticks();
        match ready {
            Ready::Whitstone(pipeline) => {
                let (clock, processor) = (Instant::now(), processor_time());
                for _ in 0..record.batch {
                    pipeline.render(self.render_options());
                }
                let batch = f64::from(record.batch);
                record.times.push(clock.elapsed().as_secs_f64() / batch);
                record.cpu.push((processor_time() - processor) / batch);
            }
            Ready::Mitsuba(flattened) => {
                let shot = self.shoot_mitsuba(flattened)?;
                record.times.push(shot.seconds);
                record.cpu.push(shot.cpu);
            }
            Ready::StockMitsuba(scene) => {
                let (_, rendering) = self.render_stock(scene)?;
                record.times.push(rendering.wall);
                record.cpu.push(rendering.processor);
            }
            Ready::Command(commanded) => {
                let (_, seconds) = self.run_command(commanded)?;
                record.times.push(seconds);
            }
        }
        if let (Some(before), Some(now)) = (before, self.ticks()) {
            record.used = record.used.more(before, now);
        }
        Ok(())
    }
}

/// Kernels of others that this program lacks or cannot load, with the reason.
fn absent_kernels(registry: &Registry) -> BTreeMap<Engine, String> {
    let why = |engine: Engine| {
        let name = engine.accelerator()?;
        if registry.get(FamilyName::Accelerator, name).is_err() {
            return Some(format!("this program was built without the feature `{name}`"));
        }
        let scene = format!(
            "[camera]\ntype = \"perspective\"\nlook_at = {{ origin = [0, 0, 1], target = [0, 0, 0] }}\n[accelerator]\ntype = \"{name}\"\n"
        );
        let sources = Sources::from_text("a scene", &scene, Path::new(""), &[]).ok()?;
        let built = Pipeline::load(&sources, registry, BuildOptions::default());
        let error = built.err()?.0.into_iter().next()?;
        Some(error.message)
    };
    let engines = Engine::RENDERERS.into_iter();
    engines
        .filter_map(|engine| Some((engine, why(engine)?)))
        .collect()
}

fn primitives(pipeline: &Pipeline) -> u64 {
    pipeline.scene.geometry.elements().count() as u64
}

fn texts(changes: &[Change]) -> Vec<String> {
    changes.iter().map(|change| change.text.clone()).collect()
}

fn load(study: &Study, changes: &[Change], registry: &Registry) -> Result<Sources, String> {
    Sources::load(&study.scene_path, &texts(changes), registry)
        .map_err(|error| placed(study, changes, &error.sources, error.errors))
}

/// Formats the errors of a changed scene. Errors in a change point to its place in the study, all
/// others to the scene.
fn placed(study: &Study, changes: &[Change], sources: &Sources, errors: SceneErrors) -> String {
    let mut ours = SceneErrors::default();
    let mut theirs = SceneErrors::default();
    for error in errors.0 {
        let place = error.span.as_ref().and_then(|span| sources.position(span));
        let change = place.and_then(|place| {
            let text = place.file.strip_prefix("--set ")?.to_owned();
            changes
                .iter()
                .rev()
                .find(|change| change.text == text && !change.span.is_empty())
        });
        match change {
            Some(change) => ours.0.push(SceneError {
                span: Some(change.span.clone()),
                ..error
            }),
            None => theirs.0.push(error),
        }
    }
    let mut reports = Vec::new();
    if !ours.0.is_empty() {
        reports.push(study.report(&ours));
    }
    if !theirs.0.is_empty() {
        reports.push(sources.report(&theirs, false));
    }
    reports.join("\n\n")
}
