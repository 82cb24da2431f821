//! The results of a validation, in the form of `results.json`.

use crate::explain::Reason;
use crate::matrix::cell::{Cell, Tally};
use crate::noisy::Noisy;
use crate::opinion::{Opinion, Verdict};
use crate::pixels::Pictures;
use crate::protocol::{Hello, PovRay};
use serde::{Deserialize, Deserializer, Serialize};
use whitstone_metrics::metrics::BlockBias;
use whitstone_render::Cost;

/// All cases of a run.
#[derive(Debug, Serialize, Deserialize)]
pub struct Results {
    /// Counts and medians.
    pub summary: Summary,
    /// Machine and versions of the run.
    pub provenance: Provenance,
    /// One entry per scene, configuration and reference.
    pub results: Vec<CaseResult>,
    /// Scenes that were skipped, and why.
    pub skipped: Vec<SkippedScene>,
    /// The settings matrix, if it was requested.
    pub matrix: Vec<Cell>,
}

/// Over all cases.
#[derive(Debug, Serialize, Deserialize)]
pub struct Summary {
    /// Number of cases.
    pub cases: usize,
    /// Number of cases that passed.
    pub passed: usize,
    /// Number of cases in which the oracle confirms our image against an inaccurate reference.
    #[serde(default)]
    pub confirmed: usize,
    /// Number of cases that failed.
    pub failed: usize,
    /// Number of cases in which neither reference nor oracle can decide.
    #[serde(default)]
    pub undecided: usize,
    /// Total number of unexplained pixels.
    pub unexplained: usize,
    /// Total number of pixels over tolerance that the reference's own variation explains.
    pub explained: usize,
    /// Total number of values that are not finite.
    pub nonfinite: usize,
    /// Number of scenes that were skipped because this reference has no twin of them and another
    /// has.
    pub skipped: usize,
    /// Number of scenes that were not compared because the run was interrupted.
    #[serde(default)]
    pub not_run: usize,
    /// Counts of the matrix, if it was requested.
    pub matrix: Tally,
    /// Median of `rel_rmse_interior` over the cases that have one.
    pub median_rel_rmse_interior: Option<f64>,
    /// "live" or "stored": the source of the references, with the reason if it is not live.
    pub references: String,
    /// Wall time in seconds.
    pub seconds: f64,
}

/// A scene that was skipped because this reference has no twin of it.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct SkippedScene {
    /// Its name.
    pub scene: String,
    /// The plugins without a twin.
    pub reason: String,
    /// The renderer that has a stored reference of it. None if the subject cannot render it.
    pub other_reference: Option<String>,
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

/// The verdict on a case.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Status {
    /// The images agree within all limits.
    Pass,
    /// The images differ, but the reference is too inaccurate in this scene, and the oracle
    /// confirms ours.
    Confirmed,
    /// Our image is wrong.
    Fail,
    /// The images differ and the oracle has no answer, or there was nothing to compare with.
    Undecided,
}

impl Status {
    /// The verdict as a word for tables.
    pub fn word(self) -> &'static str {
        match self {
            Self::Pass => "pass",
            Self::Confirmed => "confirmed",
            Self::Fail => "FAIL",
            Self::Undecided => "undecided",
        }
    }

    /// Whether our image counts as right.
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

/// A scene compared with a reference. Numbers are absent if no comparison was possible.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
#[serde(default)]
pub struct CaseResult {
    /// Path of the scene below `scenes/`, without `.toml`.
    pub scene: String,
    /// The name of the configuration: "default".
    pub config: String,
    /// The reference of the comparison.
    pub reference: Option<Reference>,
    /// "native", "hosted" or "formula": how independent the reference is.
    pub twin: String,
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Samples per pixel.
    pub samples: u32,
    /// Whether the images were compared. If not, the counts are 0 and meaningless.
    pub compared: bool,
    /// Root mean square difference over all pixels and RGB.
    pub rmse: Option<f64>,
    /// Relative RMS difference over the pixels that are not explained edges.
    pub rel_rmse_interior: Option<f64>,
    /// Largest `rel_rmse_interior` that passes.
    pub limit: f64,
    /// The reference's own error in this scene (see [`crate::floor`]).
    pub floor: f64,
    /// Pixels over tolerance between the reference and its worst variation. Not known for old
    /// stored references.
    pub moved: Option<usize>,
    /// For a failing case: evidence that the reference is too inaccurate in this scene to decide.
    pub inexact: Vec<String>,
    /// Remarks that do not affect the verdict, for example a vacuous comparison, or a refracting
    /// mesh that is not closed.
    pub notes: Vec<String>,
    /// Pairs of coincident surfaces, and the surfaces that were not examined for them.
    pub coincident: Vec<String>,
    /// Why the limit differs from the default, if it does.
    pub limit_reason: Option<String>,
    /// Mean relative squared error.
    pub relmse: Option<f64>,
    /// Mean absolute error.
    pub mae: Option<f64>,
    /// Largest absolute error.
    pub max_abs: Option<f64>,
    /// Mean of |reference|; very bright values are limited.
    pub mean_reference: Option<f64>,
    /// The block of 16 x 16 pixels with the largest bias.
    pub signed_block_bias: Option<BlockBias>,
    /// Largest |signed_block_bias| that passes.
    pub bias_limit: f64,
    /// NaN or infinite values in either image.
    pub nonfinite: usize,
    /// Pixels over tolerance.
    pub pixels_over_tolerance: usize,
    /// Pixels over tolerance that the reference's own variation explains.
    pub explained: usize,
    /// Maximum number of explained pixels that passes.
    pub explained_limit: usize,
    /// Largest shift that an explanation needed, in pixels; 0 if none needed one.
    pub explained_radius_px: f64,
    /// Pixels over tolerance whose value lies between values of the reference and equals none of
    /// them.
    pub ambiguous: usize,
    /// Pixels that nothing explains.
    pub unexplained: usize,
    /// The worst pixels over tolerance, worst first.
    pub worst: Vec<WorstPixel>,
    /// Layers other than the radiance.
    pub layers: Vec<LayerResult>,
    /// Relative RMS difference between the live and the stored reference, if both exist.
    pub drift: Option<f64>,
    /// Time to build our pipeline, in seconds.
    pub build_s: f64,
    /// Time to render our image, in seconds.
    pub render_s: f64,
    /// Tracing time of the reference, in seconds.
    pub reference_s: Option<f64>,
    /// Number of rays that we traced, including shadow rays.
    pub rays: u64,
    /// Our rays per second, in millions.
    pub mrays_per_s: f64,
    /// The verdict.
    pub status: Option<Status>,
    /// The verdict in words, with its reason.
    pub verdict: String,
    /// The limits that the comparison exceeds, and other problems; empty for a pass.
    pub problems: Vec<String>,
    /// Whether the scene itself is invalid, so that nothing was rendered.
    pub scene_error: bool,
    /// Time and memory of the parts of our pipeline.
    pub costs: Vec<Cost>,
    /// The plugins that our pipeline uses, such as `shape/sphere`.
    pub plugins: Vec<String>,
    /// The optimisations that skip work which this scene does not need.
    pub omitted: Vec<String>,
    /// Changes that were made to the scene on both sides because the reference cannot render it
    /// otherwise, with the reasons.
    pub adapted: Vec<String>,
    /// Parts of the scene without a twin in the reference; empty if there are none.
    pub no_twin: Vec<String>,
    /// For a scene without a twin: the renderer that has a stored reference of it. The scene then
    /// counts as skipped, not as failed.
    pub other_reference: Option<String>,
    /// For an accelerator that affects the image: its name, and how the image differs from the
    /// exact one.
    pub approximation_note: Option<String>,
    /// The command that runs this case alone.
    pub command: String,
    /// The result of the comparison with a noisy reference.
    pub noisy: Option<Noisy>,
    /// Pictures for the report.
    #[serde(skip)]
    pub pictures: Option<Pictures>,
    /// The oracle's answers, if it was queried.
    pub opinion: Option<Opinion>,
    /// The subject whose image takes the place of ours, if there is one.
    pub subject: Option<SubjectRun>,
    /// Whether the subject cannot render the scene. The scene then counts as skipped.
    pub not_expressible: bool,
}

/// What a subject did to render a scene.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct SubjectRun {
    /// Its name.
    pub name: String,
    /// The program and the arguments of the last run.
    pub command: Vec<String>,
    /// The exported scene.
    pub scene_file: String,
    /// What the format of the export approximates.
    pub approximated: Vec<String>,
    /// Number of runs.
    pub runs: u32,
    /// Time of all runs in seconds.
    pub seconds: f64,
    /// The file with the end of the output of the last run.
    pub log: String,
    /// Whether it ran and gave no image of the scene.
    pub failed: bool,
    /// Remarks that do not affect the verdict.
    pub remarks: Vec<String>,
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
    /// The value of the reference.
    #[serde(deserialize_with = "nullable")]
    pub reference: [f32; 3],
    /// The explanation; none for an unexplained pixel.
    pub reason: Option<Reason>,
    /// For an ambiguous pixel: the variation of the reference between whose values ours lies.
    #[serde(default)]
    pub between: Option<Reason>,
    /// For unexplained and ambiguous pixels of a live reference: the smallest and largest value of
    /// each channel under all variations.
    #[serde(deserialize_with = "nullable_range")]
    pub tried: Option<[[f64; 3]; 2]>,
    /// For unexplained pixels: the first difference between the two ray trees.
    pub first_difference: Option<String>,
    /// The verdict of the oracle, if it was queried.
    #[serde(default)]
    pub oracle: Option<Verdict>,
}

/// JSON numbers are finite: other values are written as null, and read as NaN.
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
    /// For layers of ids: pixels whose ids differ. For path classes: pixels over the tolerance of
    /// the radiance, apart from the explained ones.
    pub differing: Option<usize>,
    /// Those of them whose colours agree.
    #[serde(default)]
    pub differing_alone: Option<usize>,
    /// RMS difference, for layers of numbers, over the pixels in which both hit the same primitive.
    pub rms: Option<f64>,
    /// Largest difference over the same pixels.
    pub max_abs: Option<f64>,
}

/// A measured number and the largest value that passes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Check<T> {
    /// Absent if there was no comparison, or the comparison does not give it.
    pub value: Option<T>,
    /// Absent if it is not known yet.
    pub limit: Option<T>,
}

impl<T: PartialOrd> Check<T> {
    /// Whether the number exceeds its limit. NaN does. An absent value does not, because the reason
    /// why it is absent is a problem of its own.
    pub fn is_over(&self) -> bool {
        let (Some(value), Some(limit)) = (&self.value, &self.limit) else {
            return false;
        };
        let is_kept = value <= limit;
        !is_kept
    }
}

/// All numbers that have limits.
impl CaseResult {
    /// Sets the verdict.
    pub(crate) fn settle(&mut self, status: Status, verdict: String) {
        self.status = Some(status);
        self.verdict = verdict;
    }

    /// A name for the image under test, for messages.
    pub(crate) fn image_name(&self) -> String {
        match &self.subject {
            Some(subject) => format!("the image of {}", subject.name),
            None => "our image".to_owned(),
        }
    }

    /// `rel_rmse_interior`.
    pub fn interior(&self) -> Check<f64> {
        self.measured(self.rel_rmse_interior, self.limit)
    }

    /// Absolute bias of the block with the largest bias.
    pub fn bias(&self) -> Check<f64> {
        self.measured(
            self.signed_block_bias.map(|block| block.bias.abs()),
            self.bias_limit,
        )
    }

    /// Number of explained pixels.
    pub fn explained(&self) -> Check<usize> {
        self.counted(self.explained, self.explained_limit)
    }

    /// Number of ambiguous pixels that the oracle has not decided.
    pub fn ambiguous(&self) -> Check<usize> {
        let decided = self.status.is_some_and(Status::is_right);
        self.counted(self.ambiguous, if decided { self.ambiguous } else { 0 })
    }

    /// Number of unexplained pixels.
    pub fn unexplained(&self) -> Check<usize> {
        self.counted(self.unexplained, 0)
    }

    /// Number of values that are not finite.
    pub fn nonfinite(&self) -> Check<usize> {
        self.counted(self.nonfinite, 0)
    }

    /// Number of differing pixels in a layer of ids or a path class. The limit is that of the
    /// explained pixels.
    pub fn ids(&self, layer: &LayerResult) -> Check<usize> {
        Check {
            value: layer.differing,
            limit: Some(self.explained_limit),
        }
    }

    /// The check of the layer of ids or path class with most differing pixels.
    pub fn worst_ids(&self) -> Check<usize> {
        let checks = self.layers.iter().map(|layer| self.ids(layer));
        let worst = checks.max_by_key(|check| check.value);
        worst.unwrap_or(Check {
            value: None,
            limit: Some(self.explained_limit),
        })
    }

    /// Number of pixels that differ from stock Mitsuba.
    pub fn stock(&self) -> Check<usize> {
        Check {
            value: self.noisy.as_ref().map(|noisy| noisy.significant),
            limit: (self.noisy.as_ref()).map(|_| Noisy::limit(self.width * self.height)),
        }
    }

    /// A limit of 0 means that there was no comparison yet.
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

    /// The exceeded limits, as text.
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
                problems.push("there are no interior pixels to compare".to_owned());
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
    /// Summarises some cases.
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
            skipped: 0,
            not_run: 0,
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

    /// A case with every number at its limit.
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
