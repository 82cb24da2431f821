//! What a validation found, as `results.json` has it.

use crate::driver::{Hello, PovRay};
use crate::explain::Reason;
use crate::matrix::{Cell, Tally};
use crate::noisy::Noisy;
use crate::opinion::{Opinion, Verdict};
use crate::pixels::Pictures;
use serde::{Deserialize, Deserializer, Serialize};
use whitstone_image::metrics::BlockBias;
use whitstone_scene::Cost;

/// All cases of a run.
#[derive(Debug, Serialize, Deserialize)]
pub struct Results {
    /// Counts and medians.
    pub summary: Summary,
    /// Where and with what it was run.
    pub provenance: Provenance,
    /// One a (scene, configuration, reference).
    pub results: Vec<CaseResult>,
    /// Scenes that were not compared, and why.
    pub left_out: Vec<LeftOut>,
    /// Settings of the scenes, where these were asked for.
    pub matrix: Vec<Cell>,
}

/// Over all cases.
#[derive(Debug, Serialize, Deserialize)]
pub struct Summary {
    /// Number of cases.
    pub cases: usize,
    /// Of these, how many passed.
    pub passed: usize,
    /// In how many the oracle confirms ours against a weak reference.
    #[serde(default)]
    pub confirmed: usize,
    /// How many failed.
    pub failed: usize,
    /// In how many nobody can tell.
    #[serde(default)]
    pub undecided: usize,
    /// Pixels that nothing explains, in all.
    pub unexplained: usize,
    /// Pixels over tolerance that the reference's own variation explains, in all.
    pub explained: usize,
    /// Values that are not finite, in all.
    pub nonfinite: usize,
    /// Scenes that were not compared, because this reference has no twin of them: another has.
    pub left_out: usize,
    /// The cells of the matrix, if one was asked for.
    pub matrix: Tally,
    /// Median of `rel_rmse_interior` over the cases that have one.
    pub median_rel_rmse_interior: Option<f64>,
    /// "live" or "stored": where the references came from; with the reason if not live.
    pub references: String,
    /// Wall time in seconds.
    pub seconds: f64,
}

/// A scene that this reference has no twin of.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct LeftOut {
    /// Its name.
    pub scene: String,
    /// What has no twin.
    pub reason: String,
    /// Who has a stored reference of it.
    pub other_reference: String,
}

/// Versions and the machine.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Provenance {
    /// Of Whitstone.
    pub whitstone: String,
    /// Threads that Whitstone used.
    pub threads: usize,
    /// The live Mitsuba, if there was one.
    pub mitsuba: Option<Hello>,
    /// The live POV-Ray, if there was one.
    pub povray: Option<PovRay>,
}

/// Whether a case is as it must be.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Status {
    /// The images agree within all limits.
    Pass,
    /// They do not, but the reference is too weak in this scene, and the oracle confirms ours.
    Confirmed,
    /// Ours is wrong.
    Fail,
    /// Nobody can tell: the images differ and the oracle has no answer, or there was nothing to
    /// compare with.
    Undecided,
}

impl Status {
    /// In words, for tables.
    pub fn word(self) -> &'static str {
        match self {
            Self::Pass => "pass",
            Self::Confirmed => "confirmed",
            Self::Fail => "FAIL",
            Self::Undecided => "undecided",
        }
    }

    /// Whether our image is held to be right.
    pub fn is_right(self) -> bool {
        matches!(self, Self::Pass | Self::Confirmed)
    }
}

/// What the image was compared with.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
#[serde(default)]
pub struct Reference {
    /// "mitsuba" or "povray".
    pub name: String,
    /// Its version.
    pub version: String,
    /// Its variant.
    pub variant: String,
    /// "live" (rendered by this run or by an earlier one of the same driver) or "stored".
    pub source: String,
    /// Spawn offset of the reference, in units of 2^-24 (1 + max |p|).
    pub k: f64,
}

/// A scene against a reference. Numbers are absent where no comparison was possible.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
#[serde(default)]
pub struct CaseResult {
    /// Path of the scene below `scenes/`, without `.toml`.
    pub scene: String,
    /// "default".
    pub config: String,
    /// The other side.
    pub reference: Option<Reference>,
    /// "native", "hosted" or "formula": how independent the reference is.
    pub twin: String,
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// A pixel.
    pub samples: u32,
    /// Whether it came to the comparison: otherwise its counts are 0 and mean nothing.
    pub compared: bool,
    /// Over all pixels and RGB.
    pub rmse: Option<f64>,
    /// Over the pixels that are not explained edges, relative.
    pub rel_rmse_interior: Option<f64>,
    /// Largest `rel_rmse_interior` that passes.
    pub limit: f64,
    /// The reference's own error in this scene.
    pub floor: f64,
    /// Pixels over tolerance between the reference and the variation of it that has most of them;
    /// not known of stored references of old.
    pub moved: Option<usize>,
    /// For a case that fails: what shows that the reference is too inexact in this scene to be
    /// judged by.
    pub inexact: Vec<String>,
    /// Remarks that change no verdict: a comparison that shows nothing, a mesh that refracts and is
    /// not closed.
    pub notes: Vec<String>,
    /// Pairs of coincident surfaces, and what was not examined for them.
    pub coincident: Vec<String>,
    /// Why the limit differs from the default, if it does.
    pub limit_reason: Option<String>,
    /// Mean relative squared error.
    pub relmse: Option<f64>,
    /// Mean absolute error.
    pub mae: Option<f64>,
    /// Largest absolute error.
    pub max_abs: Option<f64>,
    /// Mean of |reference|.
    pub mean_reference: Option<f64>,
    /// Most biased block of 16 x 16 pixels.
    pub signed_block_bias: Option<BlockBias>,
    /// Largest |signed_block_bias| that passes.
    pub bias_limit: f64,
    /// NaN or infinite values in either image.
    pub nonfinite: usize,
    /// Pixels over tolerance.
    pub pixels_over_tolerance: usize,
    /// Of these, explained by the reference's own variation.
    pub explained: usize,
    /// Largest number of explained pixels that passes.
    pub explained_limit: usize,
    /// Largest shift that an explanation needed, in pixels; 0 if none needed one.
    pub explained_radius_px: f64,
    /// Pixels over tolerance that lie between values that the reference takes, and equal none of
    /// them.
    pub ambiguous: usize,
    /// Pixels that nothing explains.
    pub unexplained: usize,
    /// The worst pixels over tolerance, worst first.
    pub worst: Vec<WorstPixel>,
    /// Layers beside the radiance.
    pub layers: Vec<LayerResult>,
    /// RMS relative difference of a live reference from the stored one, if both are there.
    pub drift: Option<f64>,
    /// Time to build our pipeline.
    pub build_s: f64,
    /// Time to render ours.
    pub render_s: f64,
    /// Time that the reference took to trace.
    pub reference_s: Option<f64>,
    /// Rays that ours traced, shadow rays included.
    pub rays: u64,
    /// Our rays a second, in millions.
    pub mrays_per_s: f64,
    /// The verdict.
    pub status: Option<Status>,
    /// The verdict in words, with its reason.
    pub verdict: String,
    /// The limits that the comparison does not keep, and what else is wrong; empty for a pass.
    pub problems: Vec<String>,
    /// Whether the scene itself is wrong, so that nothing was rendered.
    pub scene_error: bool,
    /// What its parts take.
    pub costs: Vec<Cost>,
    /// The plugins that our pipeline uses, such as `shape/sphere`.
    pub plugins: Vec<String>,
    /// What our pipeline did without.
    pub left_out: Vec<String>,
    /// What of the scene was changed on both sides, because the reference could not show it, and
    /// why.
    pub adapted: Vec<String>,
    /// What of the scene the reference has no twin of; empty where it has all.
    pub no_twin: Vec<String>,
    /// For a scene without a twin: who else has a stored reference of it. It then counts as left
    /// out, not as failed.
    pub other_reference: Option<String>,
    /// Of an accelerator that the image depends on: which, and how the image differs from the exact
    /// one.
    pub caveat: Option<String>,
    /// The command that runs this case alone.
    pub command: String,
    /// How it compares with a reference that has noise.
    pub noisy: Option<Noisy>,
    /// Pictures for the report.
    #[serde(skip)]
    pub pictures: Option<Pictures>,
    /// What the oracle says, if it was asked.
    pub opinion: Option<Opinion>,
}

/// A pixel that differs.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct WorstPixel {
    /// Column.
    pub x: usize,
    /// Row.
    pub y: usize,
    /// Our value.
    #[serde(deserialize_with = "nullable")]
    pub ours: [f32; 3],
    /// The reference's.
    #[serde(deserialize_with = "nullable")]
    pub reference: [f32; 3],
    /// What explains it; none for an unexplained pixel.
    pub reason: Option<Reason>,
    /// The variation of the reference between whose values ours lies, without equalling one.
    #[serde(default)]
    pub between: Option<Reason>,
    /// For unexplained and ambiguous pixels of a live reference: the smallest and largest value of
    /// each channel that it took under all that was tried.
    #[serde(deserialize_with = "nullable_range")]
    pub tried: Option<[[f64; 3]; 2]>,
    /// For unexplained pixels: where the two ray trees part.
    pub first_difference: Option<String>,
    /// Who is right, if the oracle was asked.
    #[serde(default)]
    pub oracle: Option<Verdict>,
}

/// JSON has no other numbers than finite ones: what is not is written as null, and read as NaN.
fn nullable<'de, D: Deserializer<'de>>(deserializer: D) -> Result<[f32; 3], D::Error> {
    Ok(<[Option<f32>; 3]>::deserialize(deserializer)?.map(|value| value.unwrap_or(f32::NAN)))
}

fn nullable_range<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Option<[[f64; 3]; 2]>, D::Error> {
    let range = <Option<[[Option<f64>; 3]; 2]>>::deserialize(deserializer)?;
    Ok(range.map(|ends| ends.map(|end| end.map(|value| value.unwrap_or(f64::NAN)))))
}

/// A layer of both images.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct LayerResult {
    /// EXR channel.
    pub name: String,
    /// Pixels whose ids differ, for layers of ids.
    pub differing: Option<usize>,
    /// Of these, the number of those whose colour agrees.
    #[serde(default)]
    pub differing_alone: Option<usize>,
    /// RMS difference, for layers of numbers, over the pixels where both see the same primitive.
    pub rms: Option<f64>,
    /// Largest difference over the same.
    pub max_abs: Option<f64>,
}

/// A number of a case beside the largest one that passes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Check<T> {
    /// Absent where there was no comparison or it gave none.
    pub value: Option<T>,
    /// Absent where it was not known yet.
    pub limit: Option<T>,
}

impl<T: PartialOrd> Check<T> {
    /// Whether the case fails by it. NaN does; an absent value does not: why it is absent is a
    /// problem of its own.
    pub fn is_over(&self) -> bool {
        let (Some(value), Some(limit)) = (&self.value, &self.limit) else {
            return false;
        };
        let is_kept = value <= limit;
        !is_kept
    }
}

/// Every number that has a limit.
impl CaseResult {
    /// Sets the verdict.
    pub(crate) fn settle(&mut self, status: Status, verdict: String) {
        self.status = Some(status);
        self.verdict = verdict;
    }

    /// `rel_rmse_interior`.
    pub fn interior(&self) -> Check<f64> {
        self.measured(self.rel_rmse_interior, self.limit)
    }

    /// Size of the bias of the most biased block.
    pub fn bias(&self) -> Check<f64> {
        self.measured(
            self.signed_block_bias.map(|block| block.bias.abs()),
            self.bias_limit,
        )
    }

    /// Pixels that differ explainably.
    pub fn explained(&self) -> Check<usize> {
        self.counted(self.explained, self.explained_limit)
    }

    /// Pixels between values of the reference that the oracle has not decided.
    pub fn ambiguous(&self) -> Check<usize> {
        let decided = self.status.is_some_and(Status::is_right);
        self.counted(self.ambiguous, if decided { self.ambiguous } else { 0 })
    }

    /// Pixels that nothing explains.
    pub fn unexplained(&self) -> Check<usize> {
        self.counted(self.unexplained, 0)
    }

    /// Values that are not finite.
    pub fn nonfinite(&self) -> Check<usize> {
        self.counted(self.nonfinite, 0)
    }

    /// Pixels of a layer of ids that differ: as many as there may be explained ones.
    pub fn ids(&self, layer: &LayerResult) -> Check<usize> {
        Check {
            value: layer.differing,
            limit: Some(self.explained_limit),
        }
    }

    /// Those of the worst layer.
    pub fn worst_ids(&self) -> Check<usize> {
        let checks = self.layers.iter().map(|layer| self.ids(layer));
        let worst = checks.max_by_key(|check| check.value);
        worst.unwrap_or(Check {
            value: None,
            limit: Some(self.explained_limit),
        })
    }

    /// Pixels that differ from stock Mitsuba.
    pub fn stock(&self) -> Check<usize> {
        Check {
            value: self.noisy.as_ref().map(|noisy| noisy.significant),
            limit: (self.noisy.as_ref()).map(|_| Noisy::limit(self.width * self.height)),
        }
    }

    /// A limit of 0 stands for none before the comparison.
    fn measured(&self, value: Option<f64>, limit: f64) -> Check<f64> {
        Check {
            value,
            limit: (self.compared || limit > 0.0).then_some(limit),
        }
    }

    fn counted(&self, count: usize, limit: usize) -> Check<usize> {
        Check {
            value: self.compared.then_some(count),
            limit: Some(limit),
        }
    }

    /// The limits that it does not keep, in words.
    pub fn broken_limits(&self) -> Vec<String> {
        let mut problems = Vec::new();
        if self.nonfinite().is_over() {
            problems.push(format!("not finite: {}", counted(self.nonfinite, "value")));
        }
        if self.unexplained().is_over() {
            problems.push(format!(
                "unexplained: {} over tolerance",
                counted(self.unexplained, "pixel")
            ));
        }
        if self.explained().is_over() {
            problems.push(format!(
                "explained: {} over tolerance, more than {}",
                counted(self.explained, "pixel"),
                self.explained_limit
            ));
        }
        match self.rel_rmse_interior {
            None if self.compared && self.nonfinite == 0 => {
                problems.push("there is no interior to compare".to_owned());
            }
            Some(error) if self.interior().is_over() => problems.push(format!(
                "rel_rmse_interior {error:.2e} is above the limit {:.2e}",
                self.limit
            )),
            _ => {}
        }
        if let Some(block) = self.signed_block_bias
            && self.bias().is_over()
        {
            problems.push(format!(
                "the block at ({}, {}) is biased by {:.2e} in {}, above the limit {:.2e}",
                block.x, block.y, block.bias, block.channel, self.bias_limit
            ));
        }
        for layer in &self.layers {
            if let Some(count) = layer.differing
                && self.ids(layer).is_over()
            {
                problems.push(format!("{} differs at {}", layer.name, counted(count, "pixel")));
            }
        }
        problems
    }
}

/// "1 pixel", "2 pixels".
pub fn counted(count: usize, what: &str) -> String {
    format!("{count} {what}{}", if count == 1 { "" } else { "s" })
}

impl Summary {
    /// Counts over some cases.
    pub fn of(cases: &[CaseResult], references: String, seconds: f64) -> Self {
        let with = |status: Status| cases.iter().filter(|case| case.status == Some(status)).count();
        let mut errors: Vec<f64> = cases.iter().filter_map(|case| case.rel_rmse_interior).collect();
        errors.sort_by(f64::total_cmp);
        let middle = |values: &[f64]| match values.len() {
            0 => None,
            n if n % 2 == 1 => Some(values[n / 2]),
            n => Some(0.5 * (values[n / 2 - 1] + values[n / 2])),
        };
        Self {
            cases: cases.len(),
            passed: with(Status::Pass),
            confirmed: with(Status::Confirmed),
            failed: with(Status::Fail),
            undecided: with(Status::Undecided),
            unexplained: cases.iter().map(|case| case.unexplained).sum(),
            explained: cases.iter().map(|case| case.explained).sum(),
            nonfinite: cases.iter().map(|case| case.nonfinite).sum(),
            left_out: 0,
            matrix: Tally::default(),
            median_rel_rmse_interior: middle(&errors),
            references,
            seconds,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// On all its limits.
    fn case() -> CaseResult {
        CaseResult {
            compared: true,
            rel_rmse_interior: Some(1e-6),
            limit: 1e-6,
            signed_block_bias: Some(BlockBias {
                bias: -1e-5,
                channel: "G",
                x: 0,
                y: 16,
                pixels: 256,
            }),
            bias_limit: 1e-5,
            explained: 8,
            explained_limit: 8,
            layers: vec![ids(Some(8)), ids(None), ids(Some(3))],
            ..CaseResult::default()
        }
    }

    fn ids(differing: Option<usize>) -> LayerResult {
        LayerResult {
            name: "shape_id.I".to_owned(),
            differing,
            differing_alone: differing,
            rms: None,
            max_abs: None,
        }
    }

    #[test]
    fn what_is_on_its_limit_passes_and_what_is_beyond_is_told() {
        assert_eq!(case().broken_limits(), Vec::<String>::new());
        assert_eq!(case().worst_ids().value, Some(8));
        type Change = fn(&mut CaseResult);
        let beyond: [(Change, &str); 9] = [
            (|case| case.rel_rmse_interior = Some(1.01e-6), "1.01e-6 is above"),
            (|case| case.rel_rmse_interior = Some(f64::NAN), "NaN is above"),
            (|case| case.rel_rmse_interior = None, "no interior"),
            (|case| case.limit = 0.0, "above the limit 0"),
            (|case| case.bias_limit = 0.99e-5, "biased by -1.00e-5 in G"),
            (
                |case| case.explained = 9,
                "explained: 9 pixels over tolerance, more than 8",
            ),
            (|case| case.unexplained = 1, "unexplained: 1 pixel over tolerance"),
            (|case| case.nonfinite = 1, "not finite: 1 value"),
            (|case| case.layers.push(ids(Some(9))), "shape_id.I differs at 9"),
        ];
        for (change, message) in beyond {
            let mut case = case();
            change(&mut case);
            let problems = case.broken_limits();
            assert!(
                problems.len() == 1 && problems[0].contains(message),
                "{problems:?}"
            );
        }
    }

    #[test]
    fn without_a_comparison_there_are_no_values() {
        let case = CaseResult::default();
        assert_eq!(case.broken_limits(), Vec::<String>::new());
        assert_eq!((case.interior().value, case.interior().limit), (None, None));
        for check in [
            case.explained(),
            case.unexplained(),
            case.nonfinite(),
            case.worst_ids(),
        ] {
            assert_eq!(check.value, None);
        }
    }
}
