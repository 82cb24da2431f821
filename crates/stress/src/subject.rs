//! Families as scenes for another renderer, whose images the oracle judges.
//!
//! A pixel is right if it differs from the oracle's by at most [`TOLERANCE`] of the mean. Most
//! renderers compute in single precision. They answer a question that is close to the one that was
//! asked: a scene whose numbers, and rays whose points and directions, differ by a few units in the
//! last place of single precision ([`single`]). So a pixel is *excused* if its value is between
//! those of such questions. Everything else is wrong. The sweep of a family ends at the first wrong
//! pixel, where no pixel is right without excuse, and at the last value for which Whitstone makes a
//! promise ([`About::reach`]).

use crate::{About, Family, Lab, single, view};
use rayon::prelude::*;
use serde::Serialize;
use std::path::Path;
use std::time::{Duration, Instant};
use whitstone_core::Scratch;
use whitstone_oracle::tracer::{Care, Tracer, Value};
use whitstone_render::{BuildOptions, Pipeline};
use whitstone_scene::{Description, Sources};
use whitstone_validate::subject::{Once, Subject, SubjectError};
use whitstone_validate::{Stop, flatten_sources};

/// Largest error of a right pixel, relative to the mean of the image.
const TOLERANCE: f64 = 1e-2;
/// Means of images that single precision holds with all digits, and with room for bright pixels.
const SMALLEST: f64 = 1e-30;
const LARGEST: f64 = 1e30;
/// Time limit of the oracle for one pixel.
const TIME: Duration = Duration::from_secs(10);
/// Number of wrong pixels of a step that are shown.
const EXAMPLES: usize = 3;

/// The pixels of one renderer at one value of the parameter.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Pixels {
    /// Pixels that agree with the oracle.
    pub right: usize,
    /// Pixels that single precision excuses.
    pub excused: usize,
    /// All others that the oracle can decide.
    pub wrong: usize,
    /// Pixels that it cannot decide.
    pub undecided: usize,
}

/// One value of the parameter.
#[derive(Clone, Debug, Serialize)]
pub struct SubjectStep {
    /// The value.
    pub parameter: f64,
    /// The pixels of the subject.
    pub subject: Pixels,
    /// Whitstone's pixels of the same scene.
    pub whitstone: Pixels,
    /// Wall time of the whole command, in seconds.
    pub seconds: f64,
}

/// A family with the images of a subject.
#[derive(Clone, Debug, Serialize)]
pub struct SubjectReport {
    /// The name of the family.
    pub family: String,
    /// The parameter that is swept.
    pub parameter: String,
    /// All values that were rendered.
    pub steps: Vec<SubjectStep>,
    /// The first value at which the subject has a wrong pixel or gives no image.
    pub wrong_at: Option<f64>,
    /// The first value at which Whitstone has a wrong pixel.
    pub whitstone_wrong_at: Option<f64>,
    /// The first value at which no pixel is right without excuse.
    pub excused_at: Option<f64>,
    /// Some of the wrong pixels, or why there is no image.
    pub examples: Vec<String>,
    /// Why the family, or the rest of its steps, was skipped.
    pub skipped: Option<String>,
}

/// Where the scenes are rendered.
#[derive(Clone, Copy)]
pub struct SubjectRuns<'a> {
    /// The renderer.
    pub subject: &'a Subject,
    /// The folder of all results.
    pub target: &'a Path,
    /// A request to stop early.
    pub stop: &'a Stop,
}

/// Renders the scenes of a family with a subject, from easy to hard, and judges its images.
///
/// # Errors
/// If the command cannot be started, or a scene of the family has an error.
pub fn judge_subject(
    family: &dyn Family,
    lab: &Lab<'_>,
    runs: &SubjectRuns<'_>,
    progress: &dyn Fn(f64),
) -> Result<SubjectReport, String> {
    let about = family.about();
    let mut report = SubjectReport {
        family: about.name.to_owned(),
        parameter: about.parameter.to_owned(),
        steps: Vec::new(),
        wrong_at: None,
        whitstone_wrong_at: None,
        excused_at: None,
        examples: Vec::new(),
        skipped: None,
    };
    for parameter in within_reach(&about, family.parameters()) {
        if runs.stop.is_requested() {
            break;
        }
        progress(parameter);
        let judged = family
            .view(parameter, lab)
            .map_err(Problem::Skipped)
            .and_then(|text| step(&text, parameter, about.name, lab, runs, &mut report.examples));
        let step = match judged {
            Ok(step) => step,
            Err(Problem::Skipped(why)) => {
                report.skipped = Some(why);
                break;
            }
            Err(Problem::NoImage(why)) => {
                report.wrong_at = Some(parameter);
                report.examples.push(why);
                break;
            }
            Err(Problem::Environment(why)) => return Err(format!("{} at {parameter:e}: {why}", about.name)),
        };
        if step.whitstone.wrong > 0 {
            report.whitstone_wrong_at.get_or_insert(parameter);
        }
        let Pixels { right, wrong, .. } = step.subject;
        report.steps.push(step);
        if wrong > 0 {
            report.wrong_at = Some(parameter);
            break;
        }
        if right == 0 {
            report.excused_at = Some(parameter);
            break;
        }
    }
    Ok(report)
}

/// The parameters up to the last one for which Whitstone makes a promise.
fn within_reach(about: &About, mut parameters: Vec<f64>) -> Vec<f64> {
    let rises = parameters.is_sorted();
    let reach = about.reach;
    parameters.retain(|&value| if rises { value <= reach } else { value >= reach });
    parameters
}

/// Why a step has no judged image.
enum Problem {
    Skipped(String),
    NoImage(String),
    Environment(String),
}

impl From<SubjectError> for Problem {
    fn from(error: SubjectError) -> Self {
        match error {
            SubjectError::NotExpressible(why) => Self::Skipped(why),
            SubjectError::Environment(why) => Self::Environment(why),
            SubjectError::Failed(why) => Self::NoImage(why),
        }
    }
}

fn step(
    text: &str,
    parameter: f64,
    family: &str,
    lab: &Lab<'_>,
    runs: &SubjectRuns<'_>,
    examples: &mut Vec<String>,
) -> Result<SubjectStep, Problem> {
    let subject = runs.subject;
    let load = |changes: &[String]| {
        Sources::from_text("stress", text, Path::new("scenes"), changes)
            .map_err(|error| Problem::Skipped(error.sources.report(&error.errors, false)))
    };
    // A scene that Whitstone refuses has no image.
    let sources = load(&subject.set)?;
    let skip = |errors| Problem::Skipped(sources.report(&errors, false));
    let pipeline = Pipeline::load(&sources, lab.registry(), BuildOptions::default()).map_err(skip)?;
    let description = Description::parse(&sources).into_result().map_err(skip)?;
    let tracer = Tracer::new(&description).map_err(skip)?;
    let mut changes = subject.set.clone();
    let flattened = flatten_sources(&sources).map_err(Problem::Skipped)?;
    changes.extend(subject.centered(&flattened).map_err(Problem::Skipped)?);
    let theirs = flatten_sources(&load(&changes)?).map_err(Problem::Skipped)?;
    let [width, height] = view::SIZE;
    let places: Vec<[u32; 2]> = (0..height)
        .flat_map(|y| (0..width).map(move |x| [x, y]))
        .collect();
    let truths: Vec<Value> = places
        .par_iter()
        .map(|place| tracer.pixel_before(*place, Care::USUAL, Instant::now() + TIME))
        .collect();
    let known = truths.iter().filter_map(|truth| match truth {
        Value::Known { rgb, .. } => Some(rgb.iter().sum::<f64>() / 3.0),
        Value::Unknown(_) => None,
    });
    let known: Vec<f64> = known.collect();
    let mean = known.iter().sum::<f64>() / known.len().max(1) as f64;
    if mean == 0.0 {
        return Err(Problem::Skipped("nothing is to be seen".to_owned()));
    }
    if !(SMALLEST..=LARGEST).contains(&mean) {
        let why = format!("the mean radiance {mean:.0e} is not in the range of images");
        return Err(Problem::Skipped(why));
    }
    let folder = Path::new("stress").join(family);
    let size = view::SIZE.map(|side| side as usize);
    let (image, seconds) = subject.render_once(&Once {
        registry: lab.registry(),
        target: runs.target,
        folder: &folder,
        scene: &theirs,
        size,
        samples: subject.samples,
        threads: 0,
        stop: runs.stop,
    })?;
    let questions = single::Questions::new(&flattened, &tracer);
    let judge = |found: &(dyn Fn([u32; 2]) -> [f64; 3] + Sync)| -> Vec<Verdict> {
        let pairs = places.par_iter().zip(&truths);
        pairs
            .map(|(place, truth)| {
                judge(found(*place), truth, TOLERANCE * mean, || {
                    questions.answers(*place, Instant::now() + TIME)
                })
            })
            .collect()
    };
    let planes = ["R", "G", "B"].map(|name| image.channel(name).unwrap_or(&[]));
    let pixel = |[x, y]: [u32; 2]| {
        let index = y as usize * size[0] + x as usize;
        planes.map(|plane| plane.get(index).map_or(f64::NAN, |value| f64::from(*value)))
    };
    let found = judge(&pixel);
    let ours = judge(&|place| pipeline.pixel(place, &mut Scratch::default()).to_array());
    let wrong = places
        .iter()
        .zip(&truths)
        .zip(&found)
        .filter(|(_, verdict)| **verdict == Verdict::Wrong);
    examples.extend(wrong.take(EXAMPLES).map(|((place, truth), _)| {
        let truth = match truth {
            Value::Known { rgb, .. } => format!("{:?}", rgb.map(|value| value as f32)),
            Value::Unknown(why) => why.clone(),
        };
        let [x, y] = place;
        let found = pixel(*place).map(|value| value as f32);
        format!("pixel ({x}, {y}): {found:?}, the oracle {truth}")
    }));
    Ok(SubjectStep {
        parameter,
        subject: count(&found),
        whitstone: count(&ours),
        seconds,
    })
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Verdict {
    Right,
    Excused,
    Wrong,
    Undecided,
}

fn count(verdicts: &[Verdict]) -> Pixels {
    let of = |wanted| verdicts.iter().filter(|verdict| **verdict == wanted).count();
    Pixels {
        right: of(Verdict::Right),
        excused: of(Verdict::Excused),
        wrong: of(Verdict::Wrong),
        undecided: of(Verdict::Undecided),
    }
}

/// Judges a pixel; `perturbed` gives the values that single precision excuses, or none if they are
/// not known.
fn judge(
    found: [f64; 3],
    truth: &Value,
    tolerance: f64,
    perturbed: impl Fn() -> Option<Vec<[f64; 3]>>,
) -> Verdict {
    let Value::Known { rgb, uncertainty, .. } = truth else {
        return Verdict::Undecided;
    };
    // Not if one of them is not a number.
    let is_right = |k: usize| (found[k] - rgb[k]).abs() <= tolerance + uncertainty[k];
    if (0..3).all(is_right) {
        return Verdict::Right;
    }
    let Some(seen) = perturbed() else {
        return Verdict::Undecided;
    };
    let is_seen = |k: usize| {
        let values = || seen.iter().map(|value| value[k]);
        let low = values().fold(f64::INFINITY, f64::min);
        let high = values().fold(f64::NEG_INFINITY, f64::max);
        (low - tolerance..=high + tolerance).contains(&found[k])
    };
    match (0..3).all(is_seen) {
        true => Verdict::Excused,
        false => Verdict::Wrong,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn known(values: &[f64]) -> Value {
        Value::Known {
            rgb: [values[0]; 3],
            uncertainty: [0.0; 3],
            seen: values.iter().map(|value| [*value; 3]).collect(),
        }
    }

    #[test]
    fn only_what_rounding_explains_is_excused() {
        let truth = known(&[1.0]);
        let with = |found: f64, perturbed: &[f64]| {
            let values = || Some(perturbed.iter().map(|value| [*value; 3]).collect());
            judge([found; 3], &truth, 0.01, values)
        };
        assert_eq!(with(1.005, &[1.0]), Verdict::Right);
        assert_eq!(with(0.5, &[1.0, 0.4]), Verdict::Excused);
        assert_eq!(with(0.5, &[1.0, 0.6]), Verdict::Wrong);
        assert_eq!(with(f64::NAN, &[1.0, 0.4]), Verdict::Wrong);
        assert_eq!(judge([0.5; 3], &truth, 0.01, || None), Verdict::Undecided);
        let unknown = Value::Unknown(String::new());
        assert_eq!(judge([0.5; 3], &unknown, 0.01, || None), Verdict::Undecided);
    }

    #[test]
    fn the_sweep_ends_at_the_reach() {
        let of = |reach: f64, parameters: &[f64]| {
            let about = About {
                reach,
                ..crate::FAMILIES[0].about()
            };
            within_reach(&about, parameters.to_vec())
        };
        assert_eq!(of(10.0, &[1.0, 10.0, 100.0]), [1.0, 10.0]);
        assert_eq!(of(0.1, &[1.0, 0.1, 0.01]), [1.0, 0.1]);
        // Every family has values to render.
        for family in crate::FAMILIES {
            let about = family.about();
            assert!(
                !within_reach(&about, family.parameters()).is_empty(),
                "{}",
                about.name
            );
        }
    }
}
