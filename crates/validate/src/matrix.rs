//! The settings matrix: renders a scene with the settings that users sweep, checks each result, and
//! skips settings that the scene does not need.
//!
//! The accelerator and the number of threads must not change a bit of the picture, so they are
//! compared with Whitstone's own picture, which in turn is compared with a reference. Depth and
//! texture filters do change it. There the reference renders the changed scene too, which requires
//! a live one.

pub(crate) mod cell;
mod settings;

pub use cell::{Cell, OWN, Outcome, Row, Tally, rows};

use crate::{CaseResult, Renderer, Status, Validator};
use settings::{Facts, Sweep};
use std::path::Path;
use whitstone_core::{BsdfFlags, FamilyName};
use whitstone_render::{BuildOptions, Film, Pipeline, RenderOptions};
use whitstone_scene::{Description, Plan, PluginTable, Sources};

/// Our side of a scene, to be rendered with several settings.
struct Own {
    sources: Sources,
    overrides: Vec<String>,
    facts: Facts,
    film: Film,
}

impl Validator<'_> {
    /// All cells of a scene. The cells that were compared with a reference are also returned as
    /// cases. A scene that cannot be built has no cells, because its own case reports the error.
    pub fn matrix(&mut self, path: &Path) -> (Vec<Cell>, Vec<CaseResult>) {
        let (mut cells, mut cases) = (Vec::new(), Vec::new());
        let Ok(own) = self.own(path) else {
            return (cells, cases);
        };
        let scene = crate::scene_key(path, &self.options.scenes);
        let cell = |axis: &str, setting: &str, outcome, against: &str, detail| Cell {
            scene: scene.clone(),
            axis: axis.to_owned(),
            setting: setting.to_owned(),
            outcome,
            against: against.to_owned(),
            detail,
        };
        let skipped =
            |axis: &str, setting: &str, why: &str| cell(axis, setting, Outcome::Skipped, "", why.to_owned());
        for (axis, sweep) in own.facts.sweeps(self.registry) {
            let settings = match sweep {
                Sweep::Skipped(why) => {
                    cells.push(skipped(axis, "all", &why));
                    continue;
                }
                Sweep::Settings(settings) => settings,
            };
            for setting in settings {
                let name = &setting.name;
                if let Some(why) = &setting.skipped {
                    cells.push(skipped(axis, name, why));
                } else if setting.overrides.is_empty() {
                    let (outcome, detail) = self.same_picture(&own, axis, name);
                    cells.push(cell(axis, name, outcome, OWN, detail));
                } else if self.live.is_none() {
                    let why = "it changes the image, and the stored reference is of the unchanged scene: a live reference is needed";
                    cells.push(skipped(axis, name, why));
                } else if self.is_unchanged(&own, path, &setting.overrides) {
                    cells.push(skipped(
                        axis,
                        name,
                        "the image is identical to that of the unchanged scene",
                    ));
                } else {
                    let mut case = self.validate_changed(path, &setting.overrides);
                    // A setting that the reference does not support is no fault of ours.
                    if !case.no_twin.is_empty() {
                        let lacks = case.no_twin.join("; ");
                        cells.push(skipped(
                            axis,
                            name,
                            &format!("{}: {lacks}", self.options.renderer),
                        ));
                        continue;
                    }
                    case.config = format!("{axis} {name}");
                    let (outcome, detail) = judged(&case);
                    cells.push(cell(
                        axis,
                        name,
                        outcome,
                        &live_name(self.options.renderer),
                        detail,
                    ));
                    cases.push(case);
                }
            }
        }
        (cells, cases)
    }

    /// The scene without changes.
    fn own(&self, path: &Path) -> Result<Own, String> {
        let overrides = self.overrides(path, &mut Vec::new())?;
        let sources = Sources::load(path, &overrides, self.registry).map_err(|error| error.to_string())?;
        let pipeline = self.build(&sources, None)?;
        let film = self.picture(&pipeline, self.options.threads);
        let world = &pipeline.scene;
        let facts = Facts {
            elements: world.geometry.elements().count(),
            rays: film.counters.total(),
            pixels: [film.width, film.height],
            threads: self.options.threads,
            integrator: used(&pipeline, FamilyName::Integrator).pop().unwrap_or_default(),
            follows_branches: pipeline.integrator.follows_branches(),
            branches: world
                .materials
                .iter()
                .any(|material| material.flags().intersects(BsdfFlags::SPECULAR)),
            accelerator: pipeline.accelerator.0.clone(),
            textures: used(&pipeline, FamilyName::Texture),
            flattened: crate::flatten(path, &overrides, self.registry)?.text,
        };
        Ok(Own {
            sources,
            overrides,
            facts,
            film,
        })
    }

    fn build(&self, sources: &Sources, accelerator: Option<&str>) -> Result<Pipeline, String> {
        let mut description = Description::parse(sources)
            .into_result()
            .map_err(|errors| errors.to_string())?;
        if let Some(name) = accelerator {
            description.accelerator = PluginTable::named(name);
        }
        let plan = Plan::new(&description, self.registry);
        let built = plan
            .into_result()
            .and_then(|plan| Pipeline::build(&plan, self.registry, BuildOptions::default()).into_result());
        built.map_err(|errors| errors.to_string())
    }

    fn picture(&self, pipeline: &Pipeline, threads: usize) -> Film {
        pipeline.render(RenderOptions {
            threads,
            ..RenderOptions::default()
        })
    }

    /// Renders the scene with another accelerator or number of threads and compares it with its own
    /// picture.
    fn same_picture(&self, own: &Own, axis: &str, setting: &str) -> (Outcome, String) {
        (self.stage)(&format!("{axis} {setting}"));
        let (accelerator, threads) = match setting.parse() {
            Ok(threads) if axis == settings::THREADS => (None, threads),
            _ => (Some(setting), self.options.threads),
        };
        let pipeline = match self.build(&own.sources, accelerator) {
            Ok(pipeline) => pipeline,
            Err(errors) => return (Outcome::Fail, errors),
        };
        // This accelerator does not promise identical images: its own validation measures the
        // difference.
        if let Some(approximation_note) = pipeline.scene.accelerator.approximation_note() {
            return (
                Outcome::Skipped,
                format!("{approximation_note}: the image depends on it"),
            );
        }
        match differing(&own.film, &self.picture(&pipeline, threads)) {
            0 => (Outcome::Pass, "bit-identical".to_owned()),
            count => (
                Outcome::Fail,
                format!(
                    "{count} of {} pixels differ from the scene's own image",
                    own.film.rgb.len()
                ),
            ),
        }
    }

    /// Whether changes of the scene do not affect the picture, so that a reference of it would only
    /// repeat the unchanged scene.
    fn is_unchanged(&self, own: &Own, path: &Path, changes: &[String]) -> bool {
        let overrides = [&own.overrides, changes].concat();
        let picture = Sources::load(path, &overrides, self.registry)
            .map_err(|error| error.to_string())
            .and_then(|sources| self.build(&sources, None))
            .map(|pipeline| self.picture(&pipeline, self.options.threads));
        // Its case reports any error.
        picture.is_ok_and(|film| differing(&own.film, &film) == 0)
    }

    /// Like [`Self::validate`], for a scene that is changed on both sides.
    fn validate_changed(&mut self, path: &Path, overrides: &[String]) -> CaseResult {
        let kept = self.options.clone();
        for change in overrides {
            self.options.flags += &format!(" --set {}", crate::quoted(change));
        }
        self.options.overrides.extend_from_slice(overrides);
        let case = self.validate(path);
        self.options = kept;
        case
    }
}

/// The plugin types of a family that are in use.
fn used(pipeline: &Pipeline, family: FamilyName) -> Vec<&'static str> {
    let used = pipeline.used.iter();
    used.filter(|(found, _)| *found == family)
        .map(|(_, name)| *name)
        .collect()
}

fn live_name(renderer: Renderer) -> String {
    format!("{renderer}, live")
}

/// Number of pixels with a different bit in a channel or a layer.
fn differing(a: &Film, b: &Film) -> usize {
    let differs = |pixel: usize| {
        let bits = |film: &Film| film.rgb[pixel].map(f32::to_bits);
        let layers = a.layers.iter().zip(&b.layers);
        bits(a) != bits(b) || { layers }.any(|((_, a), (_, b))| a[pixel].to_bits() != b[pixel].to_bits())
    };
    (0..a.rgb.len()).filter(|&pixel| differs(pixel)).count()
}

/// The verdict of a case, in one line.
fn judged(case: &CaseResult) -> (Outcome, String) {
    if case.status.is_some_and(Status::is_right) {
        let error = case.rel_rmse_interior.unwrap_or_default();
        (
            Outcome::Pass,
            format!("interior error {error:.1e}, limit {:.1e}", case.limit),
        )
    } else {
        (
            Outcome::Fail,
            format!("{}: {}", case.verdict, case.problems.join("; ")),
        )
    }
}
