//! Validates scenes: renders a scene, obtains its reference, and has the two compared.

use crate::decoded::decode_textures;
use crate::driver::DriverError;
use crate::environment::Installation;
use crate::key::{folder_of, quoted, scene_key, stored_folder};
use crate::live::{Live, LiveError};
use crate::opinion::OraclePolicy;
use crate::protocol::SceneText;
use crate::renderer::{Adaptation, Renderer};
use crate::result::{CaseResult, Status, SubjectRun};
use crate::stop::Stop;
use crate::stored::{Stored, StoredError};
use crate::subject::Subject;
use crate::subject::render::{self, Job, SubjectError};
use crate::{floor, noisy, place};
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::time::Duration;
use whitstone_core::{Registry, SceneErrors};
use whitstone_image::Image;
use whitstone_metrics::range::is_vacuous;
use whitstone_render::{BuildOptions, Pipeline, RenderOptions};
use whitstone_scene::{Description, Expect, Flattened, Sources};

/// In any image, at least this many pixels may be explained edges.
pub(crate) const EXPLAINED_PIXELS: usize = 8;
/// In a large image, this fraction of the pixels may be.
const EXPLAINED_FRACTION: f64 = 5e-4;

/// Where references come from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Mode {
    /// Live if possible, else stored, and reports which.
    #[default]
    Auto,
    /// Live or an error.
    Live,
    /// Stored only.
    Stored,
}

/// Options of a validation.
#[derive(Clone, Debug)]
pub struct Options {
    /// Folder that scene names are relative to.
    pub scenes: PathBuf,
    /// Folder of the stored references.
    pub references: PathBuf,
    /// Where the drivers of the references are.
    pub installation: Installation,
    /// The renderer of the references.
    pub renderer: Renderer,
    /// Folder for caches and the report.
    pub target: PathBuf,
    /// Where references come from.
    pub mode: Mode,
    /// Whether live references of earlier runs are reused if scene and driver are unchanged.
    pub reuse: bool,
    /// Threads of our renderer; 0 for all cores.
    pub threads: usize,
    /// `path=value`, applied to every scene.
    pub overrides: Vec<String>,
    /// `path=value`, applied to our side only, to test whether a fault is detected.
    pub ours_overrides: Vec<String>,
    /// `path=value`, applied to our side and to the oracle. Simulates a fault in code that both
    /// share.
    pub shared_overrides: Vec<String>,
    /// Time limit of one answer of the driver.
    pub time_limit: Duration,
    /// The name of this program in commands that messages suggest.
    pub program: String,
    /// Further arguments that a suggested command needs to repeat the run: ` --set a=b`, or
    /// nothing.
    pub flags: String,
}

/// Validates scenes.
pub struct Validator<'a> {
    pub(crate) registry: &'a Registry,
    pub(crate) options: Options,
    pub(crate) live: Option<Live>,
    /// Why there is no live reference, if so.
    not_live: Option<String>,
    /// The first failure of a live reference that had started.
    broken: Option<String>,
    /// Whether results have pictures.
    pub(crate) pictures: bool,
    /// When the oracle is queried.
    pub(crate) oracle: OraclePolicy,
    pub(crate) stop: Stop,
    /// The renderer whose images take the place of ours.
    subject: Option<Subject>,
    /// Called with the name of each stage.
    pub(crate) stage: Box<dyn Fn(&str) + Send + Sync + 'a>,
}

/// A live reference was requested but is not available: exit code 3.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub struct NoLive(pub String);

/// Why there is no reference to compare with.
enum NoReference {
    /// Something is missing or broken.
    Problem(String),
    /// This renderer has no twin of a plugin in the scene, or no stored reference: the report, and
    /// the missing plugins.
    NoTwin(String, Vec<String>),
}

/// A reference with its provenance.
pub(crate) struct Against {
    pub(crate) stored: Stored,
    pub(crate) live: bool,
}

/// Why there is no image under test.
enum NoImage {
    /// The scene cannot be rendered, with the report.
    Scene(String),
    /// The subject has no image of it.
    Subject(SubjectError),
}

impl From<String> for NoImage {
    fn from(report: String) -> Self {
        Self::Scene(report)
    }
}

/// Our side of a case.
pub(crate) struct Ours {
    pub(crate) image: Image,
    /// For a file with rounded numbers: the smallest and the largest values that they can stand
    /// for.
    bounds: Option<[Image; 2]>,
    pub(crate) flattened: Flattened,
    pub(crate) pipeline: Pipeline,
}

impl Ours {
    /// Takes rounded numbers to the nearest to the reference's that they can stand for. Returns
    /// whether the image says anything about the scene.
    fn take_nearest(&mut self, against: &Against) -> bool {
        let Some(bounds) = &self.bounds else {
            return true;
        };
        let reference = &against.stored.image;
        let varies = !is_vacuous(reference, reference).unwrap_or(false);
        render::nearest_to(reference, bounds, &mut self.image) || !varies
    }
}

impl<'a> Validator<'a> {
    /// Creates the Python environment of Mitsuba if needed. Calls `say` before slow steps.
    pub fn new(registry: &'a Registry, options: Options, say: &dyn Fn(&str)) -> Result<Self, NoLive> {
        let (live, not_live) = match options.mode {
            Mode::Stored => (None, Some("stored references were requested".to_owned())),
            Mode::Auto | Mode::Live => match start_live(registry, &options, say) {
                Ok(live) => {
                    if let Some(warning) = live.warning() {
                        say(&format!("warning: {warning}"));
                    }
                    (Some(live), None)
                }
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
            oracle: OraclePolicy::default(),
            stop: Stop::default(),
            subject: None,
            stage: Box::new(|_| {}),
        })
    }

    /// Sets a callback that receives the name of each stage, because a scene can take minutes.
    pub fn on_stage(&mut self, stage: impl Fn(&str) + Send + Sync + 'a) {
        self.stage = Box::new(stage);
    }

    /// Sets the request that stops a validation early. The result of the scene in work then has no
    /// meaning.
    pub fn set_stop(&mut self, stop: Stop) {
        if let Some(live) = &mut self.live {
            live.set_stop(stop.clone());
        }
        self.stop = stop;
    }

    /// Sets a renderer whose images take the place of ours.
    pub fn set_subject(&mut self, subject: Subject) {
        self.subject = Some(subject);
    }

    /// Whether the images under test are those of a subject.
    pub(crate) fn has_subject(&self) -> bool {
        self.subject.is_some()
    }

    /// Whether scenes are rendered with changes, so that stored references are of no use.
    fn changes_scenes(&self) -> bool {
        let subject = self.subject.as_ref();
        !self.options.overrides.is_empty()
            || subject.is_some_and(|subject| !subject.set.is_empty() || subject.offset != [0.0; 2])
    }

    /// Disables the pictures of all further cases. Use this if only the verdict counts, because
    /// pictures take most of the time.
    pub fn without_pictures(&mut self) {
        self.pictures = false;
    }

    /// The first failure of the live reference in use: a crash, no answer, or an incomplete image.
    /// In [`Mode::Live`] the run then gives no verdict on the scenes.
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

    /// Renders a scene, compares it with its reference, and explains the differences.
    pub fn validate(&mut self, path: &Path) -> CaseResult {
        self.validate_tampered(path, &|_| {})
    }

    /// Like [`Self::validate`], but changes our image before the comparison, to test whether a
    /// fault is detected.
    pub fn validate_tampered(&mut self, path: &Path, tamper: &dyn Fn(&mut Image)) -> CaseResult {
        let scene = scene_key(path, &self.options.scenes);
        let mut case = CaseResult {
            command: self.command("validate", path),
            scene,
            config: "default".to_owned(),
            ..CaseResult::default()
        };
        match self.render(path, &mut case) {
            Err(NoImage::Scene(report)) => {
                case.scene_error = true;
                case.problems.push(report);
                case.settle(Status::Fail, "the scene cannot be rendered".to_owned());
            }
            Err(NoImage::Subject(error)) => {
                case.problems.push(error.to_string());
                let name = self.subject.as_ref().map(|subject| subject.name.clone());
                let name = name.unwrap_or_default();
                let (status, verdict) = match error {
                    SubjectError::NotExpressible(_) => {
                        case.not_expressible = true;
                        (Status::Undecided, format!("{name} cannot render this scene"))
                    }
                    SubjectError::Environment(_) => (Status::Undecided, format!("{name} cannot be run")),
                    SubjectError::Failed(_) => {
                        case.subject.get_or_insert_default().failed = true;
                        (Status::Fail, format!("{name} gave no image of this scene"))
                    }
                };
                case.settle(status, verdict);
            }
            Ok(mut ours) => {
                tamper(&mut ours.image);
                match self.reference(path, &ours.flattened, &mut case) {
                    Err(NoReference::Problem(problem)) => {
                        case.problems.push(problem);
                        case.settle(
                            Status::Undecided,
                            "there is no reference to compare with".to_owned(),
                        );
                    }
                    Err(NoReference::NoTwin(problem, lacks)) => {
                        case.other_reference = self.other_reference(path);
                        case.problems.push(problem);
                        case.no_twin = lacks;
                        case.settle(
                            Status::Undecided,
                            "the reference cannot render this scene".to_owned(),
                        );
                    }
                    Ok(against) if !ours.take_nearest(&against) => {
                        case.compared = true;
                        case.settle(
                            Status::Undecided,
                            "the file is black or white all over, and could stand for any such scene"
                                .to_owned(),
                        );
                    }
                    Ok(against) if noisy::is_noisy(&against.stored.image) || noisy::is_noisy(&ours.image) => {
                        if let Err(error) = self.judge_noisy(path, &mut case, &ours, &against) {
                            case.problems.push(error.to_string());
                            case.settle(Status::Fail, "the images cannot be compared".to_owned());
                        }
                    }
                    Ok(against) => match self.judge(&mut case, &ours, &against) {
                        Err(error) => {
                            case.problems.push(error.to_string());
                            case.settle(Status::Fail, "the images cannot be compared".to_owned());
                        }
                        Ok(judged) => {
                            self.decide(path, &mut case, &ours, &against, &judged);
                        }
                    },
                }
            }
        }
        case
    }

    /// One of many validations of a scene: applies changes to our side, and passes our image to
    /// `look`.
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

    /// The command that does this with this scene alone, with the options of this run.
    fn command(&self, verb: &str, path: &Path) -> String {
        let Options { program, flags, .. } = &self.options;
        format!("{program} {verb} {}{flags}", quoted(&path.display().to_string()))
    }

    fn render(&self, path: &Path, case: &mut CaseResult) -> Result<Ours, NoImage> {
        if let Some(subject) = &self.subject {
            self.check_changes(subject, path)?;
        }
        let overrides = self.overrides(path, &mut case.adapted)?;
        let mut flattened = flatten(path, &overrides, self.registry)?;
        let decoded = decode_textures(&mut flattened, &self.options.target.join("decoded"))?;
        if !decoded.is_empty() {
            let files = decoded.join(", ");
            case.adapted.push(format!(
                "the reference reads the decoded texels of {files}: decoders differ"
            ));
        }
        let all_overrides = [
            &overrides[..],
            &self.options.shared_overrides,
            &self.options.ours_overrides,
        ]
        .concat();
        let sources = Sources::load(path, &all_overrides, self.registry)
            .map_err(|error| error.sources.report(&error.errors, false))?;
        let report = |errors: SceneErrors| sources.report(&errors, false);
        let options = BuildOptions::default();
        let (pipeline, expect) = Pipeline::load_and(&sources, self.registry, options, |plan| {
            plan.description.expect.clone()
        })
        .map_err(report)?;
        if let Some(subject) = &self.subject {
            return self.render_with(subject, path, flattened, pipeline, &expect, case);
        }
        let (stage, stop) = (&self.stage, &self.stop);
        let film = pipeline.render(RenderOptions {
            threads: self.options.threads,
            progress: Some(&|done, all| {
                stage(&format!("ours, {}%", 100 * done / all.max(1)));
                match stop.is_requested() {
                    true => ControlFlow::Break(()),
                    false => ControlFlow::Continue(()),
                }
            }),
            ..RenderOptions::default()
        });
        film.check().map_err(|error| NoImage::Scene(error.to_string()))?;
        if !film.is_complete {
            return Err(NoImage::Scene("the rendering was stopped".to_owned()));
        }
        if let Some(approximation_note) = pipeline.scene.accelerator.approximation_note() {
            let exact = [&all_overrides[..], &["accelerator={type='auto'}".to_owned()]].concat();
            let sources = Sources::load(path, &exact, self.registry)
                .map_err(|error| error.sources.report(&error.errors, false))?;
            let exact = Pipeline::load(&sources, self.registry, options).map_err(report)?;
            let exact = exact.render(RenderOptions {
                threads: self.options.threads,
                ..RenderOptions::default()
            });
            case.approximation_note = Some(format!(
                "{approximation_note}: {}",
                departure(&film.rgb, &exact.rgb)
            ));
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
        case.omitted = pipeline
            .omitted
            .iter()
            .map(|part| format!("{}: {}", part.what, part.why))
            .collect();
        describe(case, &pipeline, &expect);
        Ok(Ours {
            image,
            bounds: None,
            flattened,
            pipeline,
        })
    }

    /// Fails if the changes that are stated for a subject are not possible in a scene: the subject
    /// cannot be compared in it.
    fn check_changes(&self, subject: &Subject, path: &Path) -> Result<(), NoImage> {
        let build = |overrides: &[String]| -> Result<(), String> {
            let sources = Sources::load(path, overrides, self.registry)
                .map_err(|error| error.sources.report(&error.errors, false))?;
            Pipeline::load(&sources, self.registry, BuildOptions::default())
                .map_err(|errors| sources.report(&errors, false))?;
            Ok(())
        };
        let not_possible = |key: &str, why: String| {
            let why = why.trim();
            let problem = format!(
                "`{key}` of subject {} is not possible in this scene: {why}",
                subject.name
            );
            NoImage::Subject(SubjectError::NotExpressible(problem))
        };
        let original = &self.options.overrides;
        let changed = [&original[..], &subject.set].concat();
        if !subject.set.is_empty()
            && let Err(why) = build(&changed)
            && build(original).is_ok()
        {
            return Err(not_possible("set", why));
        }
        if subject.offset != [0.0; 2]
            && let Ok(flattened) = flatten(path, &changed, self.registry)
            && let Err(why) = subject.shifted(&flattened.text)
        {
            return Err(not_possible("offset", why));
        }
        Ok(())
    }

    /// Our side of a case whose image is that of a subject.
    fn render_with(
        &self,
        subject: &Subject,
        path: &Path,
        flattened: Flattened,
        pipeline: Pipeline,
        expect: &Expect,
        case: &mut CaseResult,
    ) -> Result<Ours, NoImage> {
        case.subject = Some(SubjectRun {
            name: subject.name.clone(),
            ..SubjectRun::default()
        });
        let mut scene = flatten(path, &self.changes(path, &mut Vec::new())?, self.registry)?;
        decode_textures(&mut scene, &self.options.target.join("decoded"))?;
        case.width = pipeline.film.size.width as usize;
        case.height = pipeline.film.size.height as usize;
        case.samples = subject.samples;
        let job = Job {
            registry: self.registry,
            target: &self.options.target,
            folder: &folder_of(&case.scene),
            scene: &scene,
            size: [case.width, case.height],
            threads: self.options.threads,
            stage: &self.stage,
            stop: &self.stop,
        };
        let rendered = render::render(subject, &job).map_err(NoImage::Subject)?;
        case.render_s = rendered.run.seconds;
        case.subject = Some(rendered.run);
        describe(case, &pipeline, expect);
        if let Some(expect) = &subject.expect {
            case.limit = expect.interior.unwrap_or(case.limit);
            case.explained_limit = expect.explained.unwrap_or(case.explained_limit);
            case.limit_reason = Some(format!("{}: {}", subject.name, expect.reason));
        }
        Ok(Ours {
            image: rendered.image,
            bounds: rendered.bounds,
            flattened,
            pipeline,
        })
    }

    /// The changes of a scene on both sides: those of the options, and those without which the
    /// reference cannot render it. The latter are also appended to `changes`.
    pub(crate) fn overrides(&self, path: &Path, changes: &mut Vec<String>) -> Result<Vec<String>, String> {
        let mut overrides = self.changes(path, changes)?;
        if let Some(subject) = &self.subject
            && subject.offset != [0.0; 2]
        {
            let [x, y] = subject.offset;
            let flattened = flatten(path, &overrides, self.registry)?;
            overrides.push(subject.shifted(&flattened.text)?);
            changes.push(format!(
                "the camera of the reference is shifted by ({x}, {y}) pixels: {} samples there",
                subject.name
            ));
        }
        Ok(overrides)
    }

    /// [`Self::overrides`] without those that only the reference of a subject gets.
    fn changes(&self, path: &Path, changes: &mut Vec<String>) -> Result<Vec<String>, String> {
        let mut overrides = self.options.overrides.clone();
        if let Some(subject) = &self.subject {
            let stated = subject.set.iter();
            changes.extend(stated.map(|change| format!("{change}: stated for {}", subject.name)));
            overrides.extend(subject.set.iter().cloned());
        }
        let flattened = flatten(path, &overrides, self.registry)?;
        for Adaptation { change, reason } in self.options.renderer.adaptations_of(&flattened.text) {
            changes.push(format!("{change}: {reason}"));
            overrides.push(change);
        }
        Ok(overrides)
    }

    /// The scene as the reference receives it, and the changes that were made for it.
    pub fn adapted(&self, path: &Path) -> Result<(Flattened, Vec<String>), String> {
        let overrides = self.overrides(path, &mut Vec::new())?;
        let mut flattened = flatten(path, &overrides, self.registry)?;
        decode_textures(&mut flattened, &self.options.target.join("decoded"))?;
        Ok((flattened, overrides))
    }

    /// Another renderer with a stored reference of the scene.
    fn other_reference(&self, path: &Path) -> Option<String> {
        let folder = self.stored_folder(path);
        let others = Renderer::ALL.into_iter();
        let mut others = others.filter(|&other| other != self.options.renderer && other.can_be_stored());
        let found = others.find(|&other| Stored::is_in(&folder, other));
        found.map(|other| other.to_string())
    }

    /// The folder of a scene's stored references.
    pub fn stored_folder(&self, path: &Path) -> PathBuf {
        stored_folder(path, &self.options.scenes, &self.options.references)
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
            let progress = |done, all| stage(&format!("the reference, {done} of {all} renderings"));
            match live.reference(text, &hash, &progress) {
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
                    let report = place::report(path, &self.options.overrides, self.registry, &problems);
                    let report = format!("no twin in {renderer}:\n{report}");
                    let lacks = problems.lines().map(|line| place::split_place(line).1.to_owned());
                    return Err(NoReference::NoTwin(report, lacks.collect()));
                }
                Err(error) => {
                    self.broken.get_or_insert_with(|| error.to_string());
                    if self.options.mode == Mode::Live {
                        return Err(NoReference::Problem(error.to_string()));
                    }
                    case.omitted.push(format!("live reference: {error}"));
                }
            }
        }
        match stored {
            Ok(stored) => Ok(Against { stored, live: false }),
            // A stored reference of the changed scene would replace that of the original scene.
            Err(error @ (StoredError::Missing { .. } | StoredError::Stale { .. }))
                if self.changes_scenes() =>
            {
                Err(NoReference::Problem(format!(
                    "{error}; a scene that is changed by `--set` or for a subject can only be compared with a live reference"
                )))
            }
            Err(error @ (StoredError::Missing { .. } | StoredError::Stale { .. })) => {
                let accept = self.command("reference --accept", path);
                let new = format!("{error}; render a new one with: {accept}");
                Err(match (&error, self.other_reference(path)) {
                    (StoredError::Missing { .. }, Some(other)) => {
                        NoReference::NoTwin(format!("{error}; {other} has a stored reference"), Vec::new())
                    }
                    _ => NoReference::Problem(new),
                })
            }
            Err(error) => Err(NoReference::Problem(error.to_string())),
        }
    }
}

/// Sets what a case says about its scene, and the limits that the scene states.
fn describe(case: &mut CaseResult, pipeline: &Pipeline, expect: &Expect) {
    let used = pipeline.used.iter();
    case.plugins = used
        .map(|(family, name)| format!("{}/{name}", family.singular()))
        .collect();
    case.limit_reason = expect.reason.clone();
    case.explained_limit = expect.explained.map_or_else(
        || {
            let fraction = EXPLAINED_FRACTION * (case.width * case.height) as f64;
            EXPLAINED_PIXELS.max(fraction as usize)
        },
        |count| count as usize,
    );
    // An explicit limit is used unchanged. Otherwise the floor decides, once it is known.
    case.limit = expect.rel_rmse_interior.map_or(0.0, |limit| limit.get());
}

/// The flattened scene, as the reference receives it.
pub fn flatten(path: &Path, overrides: &[String], registry: &Registry) -> Result<Flattened, String> {
    let sources = Sources::load(path, overrides, registry)
        .map_err(|error| error.sources.report(&error.errors, false))?;
    flatten_sources(&sources)
}

/// The flattened scene of sources.
pub fn flatten_sources(sources: &Sources) -> Result<Flattened, String> {
    let description = Description::parse(sources)
        .into_result()
        .map_err(|errors| sources.report(&errors, false))?;
    Ok(description.flattened)
}

/// A description of how a picture differs from the exact one.
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

fn start_live(registry: &Registry, options: &Options, say: &dyn Fn(&str)) -> Result<Live, String> {
    let environment = options.renderer.environment(&options.installation, say);
    let environment = environment.map_err(|error| error.to_string())?;
    let environment = environment.with_twins(registry, &options.target);
    let environment = environment.map_err(|error| format!("the twins of plugins: {error}"))?;
    let cache = options.target.join("live");
    Live::start(
        options.renderer,
        environment,
        cache,
        options.reuse,
        options.time_limit,
    )
    .map_err(|error| error.to_string())
}
