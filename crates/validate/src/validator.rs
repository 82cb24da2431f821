use crate::driver::{DriverError, SceneText};
use crate::environment::Environment;
use crate::explain::{Range, Reason, explain};
use crate::key::{folder_of, quoted, scene_key};
use crate::live::{Live, LiveError};
use crate::pixels::Pictures;
use crate::renderer::{Adaptation, Renderer};
use crate::result::{CaseResult, LayerResult, Reference, Status, WorstPixel};
use crate::stored::{Stored, StoredError};
use crate::{floor, inexact, place, tree};
use std::path::{Path, PathBuf};
use std::time::Duration;
use whitstone_core::{Needs, Registry, SceneErrors};
use whitstone_image::{CompareError, CompareOptions, Image, Mask, Tolerance, compare, layers, metrics};
use whitstone_scene::{
    Description, Flattened, Pipeline, Plan, PluginTable, RenderOptions, Sources, all_errors,
};

/// Of an image, at least so many pixels may be explained edges.
const EXPLAINED_PIXELS: usize = 8;
/// And this fraction of a large one.
const EXPLAINED_FRACTION: f64 = 5e-4;
/// How many worst pixels a result lists.
const WORST: usize = 20;
/// For how many unexplained pixels the ray trees are compared.
const TREES: usize = 3;

/// Where references come from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Mode {
    /// Live if possible, else stored, and say so.
    #[default]
    Auto,
    /// Live or an error.
    Live,
    /// Stored only.
    Stored,
}

/// How to validate.
#[derive(Clone, Debug)]
pub struct Options {
    /// Folder that scene names are relative to.
    pub scenes: PathBuf,
    /// Folder with `mitsuba/`, `povray/` and `images/`.
    pub references: PathBuf,
    /// Who renders the references.
    pub renderer: Renderer,
    /// Folder for the environment, caches and the report.
    pub target: PathBuf,
    /// Where references come from.
    pub mode: Mode,
    /// Whether live references of earlier runs may be used if scene and driver are unchanged.
    pub reuse: bool,
    /// For our renderer; 0 for all cores.
    pub threads: usize,
    /// `path=value`, applied to every scene.
    pub overrides: Vec<String>,
    /// `path=value`, applied to our side only: to see whether a fault is found.
    pub ours_overrides: Vec<String>,
    /// How long one answer of the driver may take.
    pub time_limit: Duration,
    /// How the user calls this program, for commands in messages.
    pub program: String,
    /// What else a command in a message must say to do the same again: ` --set a=b`, or nothing.
    pub flags: String,
}

/// Validates scenes.
pub struct Validator<'a> {
    pub(crate) registry: &'a Registry,
    pub(crate) options: Options,
    pub(crate) live: Option<Live>,
    /// Why there is no live reference, if there is none.
    not_live: Option<String>,
    /// The first failure of a live reference that was there.
    broken: Option<String>,
    /// Whether results have pictures.
    pictures: bool,
    /// Whether the oracle is asked about pixels that differ.
    pub(crate) oracle: bool,
    /// Is told what is being done.
    pub(crate) stage: Box<dyn Fn(&str) + Send + Sync + 'a>,
}

/// A live reference was asked for and cannot be had: exit code 3.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub struct NoLive(pub String);

/// Why there is nothing to compare with.
enum NoReference {
    /// Something is missing or broken.
    Problem(String),
    /// This renderer has no twin of something in the scene, or none is stored: the report, and what is lacking.
    NoTwin(String, Vec<String>),
}

/// A reference with its provenance.
struct Against {
    stored: Stored,
    live: bool,
}

/// Our side of a case.
struct Ours {
    image: Image,
    flattened: Flattened,
    pipeline: Pipeline,
}

/// A pixel over tolerance.
struct Judged {
    pixel: [usize; 2],
    reason: Option<Reason>,
    /// All values that a live reference took there.
    tried: Option<Range>,
}

impl Judged {
    fn unexplained(pixel: &[usize; 2]) -> Self {
        Self {
            pixel: *pixel,
            reason: None,
            tried: None,
        }
    }
}

impl<'a> Validator<'a> {
    /// Makes the Python environment of Mitsuba if needed; `say` is told what takes long.
    pub fn new(registry: &'a Registry, options: Options, say: &dyn Fn(&str)) -> Result<Self, NoLive> {
        let (live, not_live) = match options.mode {
            Mode::Stored => (None, Some("stored references were asked for".to_owned())),
            Mode::Auto | Mode::Live => match start_live(&options, say) {
                Ok(live) => (Some(live), None),
                Err(problem) if options.mode == Mode::Live => return Err(NoLive(problem)),
                Err(problem) => (None, Some(problem)),
            },
        };
        Ok(Self {
            registry,
            options,
            live,
            not_live,
            broken: None,
            pictures: true,
            oracle: false,
            stage: Box::new(|_| {}),
        })
    }

    /// Has `stage` told, from now on, what is being done: a scene can take minutes.
    pub fn tell(&mut self, stage: impl Fn(&str) + Send + Sync + 'a) {
        self.stage = Box::new(stage);
    }

    /// From now on cases have no pictures: where only the verdict counts, they take most of the time.
    pub fn without_pictures(&mut self) {
        self.pictures = false;
    }

    /// The first failure of the live reference while it was used: a crash, no answer, half an image. In
    /// [`Mode::Live`] the run is then no verdict on the scenes.
    pub fn broken(&self) -> Option<&str> {
        self.broken.as_deref()
    }

    /// Why references are stored ones, if they are.
    pub fn not_live(&self) -> Option<&str> {
        self.not_live.as_deref()
    }

    /// The live reference.
    pub fn live(&mut self) -> Option<&mut Live> {
        self.live.as_mut()
    }

    /// Renders a scene, compares it with its reference, and explains what differs.
    pub fn validate(&mut self, path: &Path) -> CaseResult {
        self.validate_tampered(path, &|_| {})
    }

    /// The same with our image changed before the comparison: to see whether a fault is found.
    pub fn validate_tampered(&mut self, path: &Path, tamper: &dyn Fn(&mut Image)) -> CaseResult {
        let scene = scene_key(path, &self.options.scenes);
        let mut case = CaseResult {
            command: self.command("validate", path),
            scene,
            config: "default".to_owned(),
            ..CaseResult::default()
        };
        match self.render(path, &mut case) {
            Err(report) => {
                case.scene_error = true;
                case.problems.push(report);
            }
            Ok(mut ours) => {
                tamper(&mut ours.image);
                match self.reference(path, &ours.flattened, &mut case) {
                    Err(NoReference::Problem(problem)) => case.problems.push(problem),
                    Err(NoReference::NoTwin(problem, lacks)) => {
                        case.other_reference = self.other_reference(path);
                        case.problems.push(problem);
                        case.no_twin = lacks;
                    }
                    Ok(against) => {
                        if let Err(error) = self.judge(&mut case, &ours, &against) {
                            case.problems.push(error.to_string());
                        } else if self.oracle {
                            self.opine(path, &mut case, &ours.image, &against.stored.image);
                        }
                    }
                }
            }
        }
        case.status = Some(if case.problems.is_empty() {
            Status::Pass
        } else {
            Status::Fail
        });
        case
    }

    /// One of many: with a change of our side, and our image shown to `look`.
    pub(crate) fn trial(
        &mut self,
        path: &Path,
        change: Option<String>,
        look: &dyn Fn(&mut Image),
    ) -> CaseResult {
        let before = std::mem::replace(&mut self.options.ours_overrides, Vec::from_iter(change));
        let case = self.validate_tampered(path, look);
        self.options.ours_overrides = before;
        case
    }

    /// The command that does something with this scene alone as this run does.
    fn command(&self, verb: &str, path: &Path) -> String {
        let Options { program, flags, .. } = &self.options;
        format!("{program} {verb} {}{flags}", quoted(&path.display().to_string()))
    }

    fn render(&self, path: &Path, case: &mut CaseResult) -> Result<Ours, String> {
        let overrides = self.overrides(path, &mut case.adapted)?;
        let flattened = flatten(path, &overrides)?;
        let all_overrides = [&overrides[..], &self.options.ours_overrides].concat();
        let sources = Sources::load(path, &all_overrides)
            .map_err(|error| error.sources.report(&error.errors, false))?;
        let report = |_: SceneErrors| sources.report(&all_errors(&sources, self.registry), false);
        let description = Description::parse(&sources).map_err(report)?;
        let plan = Plan::new(&description, self.registry).map_err(report)?;
        let pipeline = Pipeline::build(&plan, self.registry).map_err(report)?;
        let stage = &self.stage;
        let film = pipeline.render(RenderOptions {
            threads: self.options.threads,
            progress: Some(&|done, all| stage(&format!("ours, {}%", 100 * done / all.max(1)))),
        });
        if let Some(caveat) = pipeline.world.accelerator.caveat() {
            let mut description = Description::parse(&sources).map_err(report)?;
            description.accelerator = PluginTable::named("auto");
            let plan = Plan::new(&description, self.registry).map_err(report)?;
            let exact = Pipeline::build(&plan, self.registry).map_err(report)?;
            let exact = exact.render(RenderOptions {
                threads: self.options.threads,
                progress: None,
            });
            case.caveat = Some(format!("{caveat}: {}", departure(&film.rgb, &exact.rgb)));
        }
        let image = film
            .to_image(&pipeline.scene_hash)
            .map_err(|error| error.to_string())?;
        case.width = image.width();
        case.height = image.height();
        case.samples = film.samples;
        case.build_s = pipeline.build_seconds;
        case.render_s = film.render_seconds;
        case.rays = film.counters.total();
        case.mrays_per_s = case.rays as f64 / film.render_seconds / 1e6;
        case.costs = pipeline.costs();
        let used = pipeline.used.iter();
        case.plugins = used
            .map(|(family, name)| format!("{}/{name}", family.singular()))
            .collect();
        case.left_out = pipeline
            .left_out
            .iter()
            .map(|part| format!("{}: {}", part.what, part.why))
            .collect();
        case.limit_reason = description.expect.reason.clone();
        case.explained_limit = description.expect.explained.map_or_else(
            || {
                let fraction = EXPLAINED_FRACTION * image.pixel_count() as f64;
                EXPLAINED_PIXELS.max(fraction as usize)
            },
            |count| count as usize,
        );
        // Taken as it is; without it the floor decides, once it is known.
        case.limit = description
            .expect
            .rel_rmse_interior
            .map_or(0.0, |limit| limit.get());
        Ok(Ours {
            image,
            flattened,
            pipeline,
        })
    }

    /// The changes of a scene on both sides: those asked for, and those without which the reference could not show it, which
    /// are also told.
    pub(crate) fn overrides(&self, path: &Path, told: &mut Vec<String>) -> Result<Vec<String>, String> {
        let mut overrides = self.options.overrides.clone();
        let flattened = flatten(path, &overrides)?;
        for Adaptation { change, reason } in self.options.renderer.adaptations(&flattened.text) {
            told.push(format!("{change}: {reason}"));
            overrides.push(change);
        }
        Ok(overrides)
    }

    /// The scene as the reference gets it, and the changes that make it so.
    pub fn adapted(&self, path: &Path) -> Result<(Flattened, Vec<String>), String> {
        let overrides = self.overrides(path, &mut Vec::new())?;
        Ok((flatten(path, &overrides)?, overrides))
    }

    /// Another renderer with a stored reference of the scene.
    fn other_reference(&self, path: &Path) -> Option<String> {
        let folder = self.stored_folder(path);
        let others = Renderer::ALL.into_iter();
        let mut others = others.filter(|&other| other != self.options.renderer);
        let found = others.find(|&other| Stored::is_in(&folder, other));
        found.map(|other| other.to_string())
    }

    /// The folder of a scene's stored references.
    pub fn stored_folder(&self, path: &Path) -> PathBuf {
        let key = scene_key(path, &self.options.scenes);
        self.options.references.join("images").join(folder_of(&key))
    }

    fn reference(
        &mut self,
        path: &Path,
        flattened: &Flattened,
        case: &mut CaseResult,
    ) -> Result<Against, NoReference> {
        let hash = flattened.hash.clone();
        let renderer = self.options.renderer;
        let stored = Stored::read(&self.stored_folder(path), renderer, &hash);
        let text = SceneText {
            text: &flattened.text,
            base: &flattened.base,
        };
        if let Some(live) = &mut self.live {
            let stage = &self.stage;
            let told = |done, all| stage(&format!("the reference, {done} of {all} renderings"));
            match live.reference(text, &hash, &told) {
                Ok(reference) => {
                    if let Ok(stored) = &stored {
                        let drift = floor::between(&stored.image, &reference.image);
                        case.drift = drift.ok().map(|difference| difference.error);
                    }
                    return Ok(Against {
                        stored: reference,
                        live: true,
                    });
                }
                // Whether the scene has a twin does not depend on the run.
                Err(LiveError::Driver(DriverError::Unsupported(problems))) => {
                    let report = place::report(path, &self.options.overrides, &problems);
                    let report = format!("no twin in {renderer}:\n{report}");
                    let lacks = problems.lines().map(|line| place::told(line).1.to_owned());
                    return Err(NoReference::NoTwin(report, lacks.collect()));
                }
                Err(error) => {
                    self.broken.get_or_insert_with(|| error.to_string());
                    if self.options.mode == Mode::Live {
                        return Err(NoReference::Problem(error.to_string()));
                    }
                    case.left_out.push(format!("live reference: {error}"));
                }
            }
        }
        match stored {
            Ok(stored) => Ok(Against { stored, live: false }),
            // One of the changed scene would take the place of the scene's own.
            Err(error @ (StoredError::Missing { .. } | StoredError::Stale { .. }))
                if !self.options.overrides.is_empty() =>
            {
                Err(NoReference::Problem(format!(
                    "{error}; a scene that is changed by --set can be compared with a live reference only"
                )))
            }
            Err(error @ (StoredError::Missing { .. } | StoredError::Stale { .. })) => {
                let accept = self.command("reference --accept", path);
                let new = format!("{error}; render a new one by: {accept}");
                let other = self.other_reference(path);
                let other = other.map(|other| format!("{error}; {other} has one"));
                Err(match error {
                    StoredError::Missing { .. } => NoReference::NoTwin(other.unwrap_or(new), Vec::new()),
                    _ => NoReference::Problem(new),
                })
            }
            Err(error) => Err(NoReference::Problem(error.to_string())),
        }
    }

    fn judge(&mut self, case: &mut CaseResult, ours: &Ours, against: &Against) -> Result<(), CompareError> {
        let Stored {
            image: reference,
            meta,
        } = &against.stored;
        case.reference = Some(Reference {
            name: meta.renderer.clone(),
            version: meta.version.clone(),
            variant: meta.variant.clone(),
            source: if against.live { "live" } else { "stored" }.to_owned(),
            k: meta.k,
        });
        case.twin = meta.twin.clone();
        case.floor = meta.floor;
        case.moved = meta.moved;
        case.reference_s = Some(meta.seconds);
        let textured = ours.pipeline.world.needs().contains(Needs::UV);
        let cap = floor::cap(self.options.renderer, textured);
        if case.limit == 0.0 {
            case.limit = floor::limit(meta.floor, cap);
        }
        case.bias_limit = floor::bias_limit(meta.floor, cap);
        let not_finite = metrics::count_not_finite(&ours.image, reference)?;
        case.nonfinite = not_finite.ours + not_finite.reference;
        let tolerance = Tolerance::default();
        let over = metrics::over_tolerance(&ours.image, reference, tolerance)?;
        case.pixels_over_tolerance = over.count();
        let judged = self.explain(ours, against, &over, tolerance, case);
        if self.pictures {
            let reasons = judged.iter().map(|one| (one.pixel, one.reason));
            case.pictures = Pictures::new(&ours.image, reference, reasons);
        }
        let mut explained = Mask::new(over.width(), over.height());
        for Judged { pixel, reason, .. } in &judged {
            if let Some(reason) = reason {
                explained.set(pixel[0], pixel[1], true);
                if let Reason::Shift { radius_px } = reason {
                    case.explained_radius_px = case.explained_radius_px.max(*radius_px);
                }
            }
        }
        case.explained = explained.count();
        case.unexplained = case.pixels_over_tolerance - case.explained;
        self.list_worst(case, ours, reference, &over, &judged)?;
        self.compare_layers(case, &ours.image, reference, &explained)?;

        if case.nonfinite == 0 {
            let options = CompareOptions {
                tolerance,
                exclude: Some(&explained),
                psnr_peak: None,
            };
            let measured = compare(&ours.image, reference, &options)?;
            case.rmse = Some(measured.rmse);
            case.rel_rmse_interior = measured.rel_rmse_interior;
            case.relmse = Some(measured.relmse);
            case.mae = Some(measured.mae);
            case.max_abs = Some(measured.max_abs);
            case.mean_reference = Some(measured.mean_reference);
            case.signed_block_bias = measured.signed_block_bias;
        }
        case.compared = true;
        case.notes = crate::vacuous::notes(&ours.image, reference, &ours.pipeline.world);
        case.problems.extend(case.broken_limits());
        if !case.problems.is_empty() {
            case.inexact = inexact::notes(case, &ours.pipeline.world.geometry, self.options.renderer, cap);
        }
        Ok(())
    }

    /// For each pixel over tolerance, why the reference could have taken our value.
    fn explain(
        &mut self,
        ours: &Ours,
        against: &Against,
        over: &Mask,
        tolerance: Tolerance,
        case: &mut CaseResult,
    ) -> Vec<Judged> {
        let pixels: Vec<[usize; 2]> = over.pixels().map(|(x, y)| [x, y]).collect();
        let reference = &against.stored.image;
        let mean = metrics::mean_reference(reference).unwrap_or(0.0);
        let value = |image: &Image, [x, y]: [usize; 2]| -> [f64; 3] {
            let index = y * image.width() + x;
            image.rgb().map_or([f64::NAN; 3], |planes| {
                planes.map(|plane| f64::from(plane[index]))
            })
        };
        let allowed =
            |nominal: [f64; 3]| nominal.map(|v| tolerance.relative * v.abs() + tolerance.absolute * mean);
        // Thousands of differing pixels are a fault, not edges; the worst of them are enough to see it.
        let most = 20 * case.explained_limit.max(EXPLAINED_PIXELS);
        let (asked, beyond) = pixels.split_at(pixels.len().min(most));
        let mut judged: Vec<Judged> = Vec::new();
        if !against.live {
            for &pixel in asked {
                let [x, y] = pixel;
                let nominal = value(reference, pixel);
                let range = against.stored.range(y * reference.width() + x);
                let held =
                    range.is_some_and(|range| range.holds(value(&ours.image, pixel), allowed(nominal)));
                let finite = value(&ours.image, pixel).iter().all(|v| v.is_finite());
                judged.push(Judged {
                    reason: (held && finite).then_some(Reason::StoredRange),
                    ..Judged::unexplained(&pixel)
                });
            }
        } else if !asked.is_empty() {
            let text = SceneText {
                text: &ours.flattened.text,
                base: &ours.flattened.base,
            };
            (self.stage)(&format!("tracing {} pixels of the reference again", asked.len()));
            let answer = self
                .live
                .as_mut()
                .map(|live| live.probe(text, &ours.flattened.hash, asked));
            match answer {
                Some(Ok(values)) => {
                    let trials = self.options.renderer.trials();
                    for (&pixel, variants) in asked.iter().zip(&values) {
                        let nominal = value(reference, pixel);
                        let ours = value(&ours.image, pixel);
                        let mut tried = Range::of(nominal);
                        variants
                            .iter()
                            .flatten()
                            .for_each(|variant| tried.include(*variant));
                        judged.push(Judged {
                            pixel,
                            reason: explain(ours, nominal, allowed(nominal), &trials, variants),
                            tried: Some(tried),
                        });
                    }
                }
                Some(Err(error)) => {
                    case.problems
                        .push(format!("pixels could not be traced again: {error}"));
                    judged.extend(asked.iter().map(Judged::unexplained));
                }
                None => judged.extend(asked.iter().map(Judged::unexplained)),
            }
        }
        judged.extend(beyond.iter().map(Judged::unexplained));
        judged
    }

    fn list_worst(
        &mut self,
        case: &mut CaseResult,
        ours: &Ours,
        reference: &Image,
        over: &Mask,
        judged: &[Judged],
    ) -> Result<(), CompareError> {
        let mut unexplained = Mask::new(over.width(), over.height());
        for Judged { pixel: [x, y], .. } in judged.iter().filter(|one| one.reason.is_none()) {
            unexplained.set(*x, *y, true);
        }
        let mut worst = metrics::worst(&ours.image, reference, WORST, Some(&unexplained))?;
        let rest = metrics::worst(&ours.image, reference, WORST, Some(over))?;
        worst.extend(
            rest.into_iter()
                .filter(|pixel| !unexplained.contains(pixel.x, pixel.y)),
        );
        worst.truncate(WORST);
        for (rank, pixel) in worst.iter().enumerate() {
            let place = [pixel.x, pixel.y];
            let found = judged.iter().find(|one| one.pixel == place);
            let reason = found.and_then(|one| one.reason);
            let tried = found.and_then(|one| one.tried).filter(|_| reason.is_none());
            let first_difference = if reason.is_none() && rank < TREES {
                self.first_difference(ours, place)
            } else {
                None
            };
            case.worst.push(WorstPixel {
                x: pixel.x,
                y: pixel.y,
                ours: pixel.ours,
                reference: pixel.reference,
                reason,
                tried: tried.map(|range| [range.min, range.max]),
                first_difference,
                oracle: None,
            });
        }
        Ok(())
    }

    /// Where our ray tree and the live reference's part, in words, or why that cannot be told. Stored references and POV-Ray
    /// have no trees.
    fn first_difference(&mut self, ours: &Ours, pixel: [usize; 2]) -> Option<String> {
        let live = self.live.as_mut().filter(|live| live.renderer().tells_trees())?;
        (self.stage)("comparing ray trees");
        let text = SceneText {
            text: &ours.flattened.text,
            base: &ours.flattened.base,
        };
        let samples = ours.pipeline.samples();
        for sample in 0..samples {
            let theirs = match live.tree(text, pixel, sample) {
                Ok(theirs) => theirs,
                Err(error) => return Some(format!("sample {sample}: the reference's ray tree: {error}")),
            };
            let mine = tree::ours(&ours.pipeline, pixel, sample);
            if let Some(difference) = tree::first_difference(&mine, &theirs) {
                return Some(format!("sample {sample}: {difference}"));
            }
        }
        Some("the ray trees agree: the difference is in how they are summed".to_owned())
    }

    fn compare_layers(
        &self,
        case: &mut CaseResult,
        ours: &Image,
        reference: &Image,
        explained: &Mask,
    ) -> Result<(), CompareError> {
        let names: Vec<String> = ours
            .channels()
            .map(|(name, _)| name.to_owned())
            .filter(|name| name.contains('.'))
            .collect();
        // Numbers can only agree where both see the same thing.
        let mut apart = explained.clone();
        for name in names.iter().filter(|name| name.ends_with(".I")) {
            let ids = layers::compare_ids(ours, reference, name, None)?;
            for (x, y) in ids.differing.pixels() {
                apart.set(x, y, true);
            }
            case.layers.push(LayerResult {
                name: name.clone(),
                differing: Some(ids.differing.count()),
                rms: None,
                max_abs: None,
            });
        }
        for name in names.iter().filter(|name| !name.ends_with(".I")) {
            let numbers = layers::compare_floats(ours, reference, name, Some(&apart))?;
            case.layers.push(LayerResult {
                name: name.clone(),
                differing: None,
                rms: Some(numbers.rms),
                max_abs: Some(numbers.max_abs),
            });
        }
        Ok(())
    }
}

/// The scene as the reference gets it.
pub fn flatten(path: &Path, overrides: &[String]) -> Result<Flattened, String> {
    let sources =
        Sources::load(path, overrides).map_err(|error| error.sources.report(&error.errors, false))?;
    let description = Description::parse(&sources).map_err(|errors| sources.report(&errors, false))?;
    Ok(description.flattened)
}

/// How a picture differs from the exact one, in words.
fn departure(ours: &[[f32; 3]], exact: &[[f32; 3]]) -> String {
    let far = |a: &[f32; 3], b: &[f32; 3]| {
        let channels = a.iter().zip(b);
        channels
            .map(|(a, b)| (a - b).abs() / (1.0 + b.abs()))
            .fold(0.0, f32::max)
    };
    let apart = || ours.iter().zip(exact).map(|(a, b)| far(a, b));
    let beyond = |limit: f32| apart().filter(|&far| far > limit).count();
    format!(
        "{} of {} pixels differ from the exact image, {} by more than 1e-5, {} by more than 1e-3, at most by {:.2e}",
        beyond(0.0),
        ours.len(),
        beyond(1e-5),
        beyond(1e-3),
        apart().fold(0.0, f32::max)
    )
}

fn start_live(options: &Options, say: &dyn Fn(&str)) -> Result<Live, String> {
    let environment = match options.renderer {
        Renderer::Mitsuba => Environment::ensure(&options.target, &options.references, say),
        Renderer::PovRay => Environment::of_povray(&options.references),
    };
    let environment = environment.map_err(|error| error.to_string())?;
    let cache = options.target.join("live");
    Live::start(environment, cache, options.reuse, options.time_limit).map_err(|error| error.to_string())
}
