//! The third opinion: of the pixels in which the two differ, which of them the oracle agrees with.

use crate::CaseResult;
use crate::validator::Validator;
use serde::{Deserialize, Serialize};
use std::fmt;
use std::path::Path;
use whitstone_image::{Image, Tolerance, metrics};

/// Of so many pixels the oracle is asked at most: it takes its time.
const MOST: usize = 200;

/// Who is right about a pixel.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// Only ours is within tolerance of the oracle's value.
    Ours,
    /// Only the reference is.
    Reference,
    /// Both are: they lie on different sides of it.
    Both,
    /// None is.
    Neither,
    /// The oracle's value is uncertain by more than the tolerance: tiny changes of the numbers change the pixel.
    IllPosed,
    /// The oracle has no value.
    Unknown,
}

impl fmt::Display for Verdict {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Ours => "ours is right",
            Self::Reference => "the reference is right",
            Self::Both => "both are right",
            Self::Neither => "neither is right",
            Self::IllPosed => "the pixel is ill-posed",
            Self::Unknown => "it does not know",
        })
    }
}

/// What the oracle says of a case.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Opinion {
    /// Pixels over tolerance that it was asked about.
    pub asked: usize,
    /// How many of them have each verdict.
    pub ours: usize,
    /// See [`Verdict`].
    pub reference: usize,
    /// See [`Verdict`].
    pub both: usize,
    /// See [`Verdict`].
    pub neither: usize,
    /// See [`Verdict`].
    pub ill_posed: usize,
    /// See [`Verdict`].
    pub unknown: usize,
    /// Why it says nothing of this scene, if so.
    pub silent: Option<String>,
}

impl Opinion {
    fn count(&mut self, verdict: Verdict) {
        self.asked += 1;
        *match verdict {
            Verdict::Ours => &mut self.ours,
            Verdict::Reference => &mut self.reference,
            Verdict::Both => &mut self.both,
            Verdict::Neither => &mut self.neither,
            Verdict::IllPosed => &mut self.ill_posed,
            Verdict::Unknown => &mut self.unknown,
        } += 1;
    }
}

impl fmt::Display for Opinion {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some(why) = &self.silent {
            return write!(f, "silent: {why}");
        }
        let Self {
            asked,
            ours,
            reference,
            both,
            neither,
            ill_posed,
            unknown,
            ..
        } = self;
        write!(
            f,
            "of {asked} pixels that differ: ours right {ours}, reference right {reference}, both {both}, neither {neither}, \
             ill-posed {ill_posed}, not known {unknown}"
        )
    }
}

/// The value of a pixel and its uncertainty by channel; `None` where it is not known.
type Value = Option<[[f64; 3]; 2]>;

/// Who is right, with the tolerance of each channel.
fn verdict(value: Value, ours: [f64; 3], reference: [f64; 3], tolerance: [f64; 3]) -> Verdict {
    let Some([rgb, uncertainty]) = value else {
        return Verdict::Unknown;
    };
    if (0..3).any(|c| !rgb[c].is_finite() || uncertainty[c].is_nan() || uncertainty[c] > tolerance[c]) {
        return Verdict::IllPosed;
    }
    let right = |side: [f64; 3]| (0..3).all(|c| (side[c] - rgb[c]).abs() <= tolerance[c] + uncertainty[c]);
    match (right(ours), right(reference)) {
        (true, true) => Verdict::Both,
        (true, false) => Verdict::Ours,
        (false, true) => Verdict::Reference,
        (false, false) => Verdict::Neither,
    }
}

/// The oracle's values of pixels of the scene that both sides were given.
#[cfg(feature = "oracle")]
fn tracer(
    validator: &Validator<'_>,
    path: &Path,
    overrides: &[String],
) -> Result<impl Fn([u32; 2]) -> Value + use<>, String> {
    use whitstone_oracle::tracer::{Tracer, Value};
    use whitstone_scene::{Description, Plan, Sources};

    let sources =
        Sources::load(path, overrides).map_err(|error| error.sources.report(&error.errors, false))?;
    let description = Description::parse(&sources).map_err(|errors| sources.report(&errors, false))?;
    Plan::new(&description, validator.registry).map_err(|errors| sources.report(&errors, false))?;
    let tracer = Tracer::new(&description).map_err(|errors| {
        let first = errors.0.first().map(|error| error.message.clone());
        first.unwrap_or_default()
    })?;
    Ok(move |pixel| match tracer.pixel(pixel) {
        Value::Known { rgb, uncertainty } => Some([rgb, uncertainty]),
        Value::Unknown(_) => None,
    })
}

#[cfg(not(feature = "oracle"))]
fn tracer(_: &Validator<'_>, _: &Path, _: &[String]) -> Result<fn([u32; 2]) -> Value, String> {
    Err("this program was built without the oracle, which comes with the feature `stress`".to_owned())
}

impl Validator<'_> {
    /// From now on the oracle is asked about pixels that differ.
    pub fn ask_oracle(&mut self) {
        self.oracle = true;
    }

    /// Asks it about those of a case, and notes what it says of the worst.
    pub(crate) fn opine(&self, path: &Path, case: &mut CaseResult, ours: &Image, reference: &Image) {
        let tolerance = Tolerance::default();
        let Ok(over) = metrics::over_tolerance(ours, reference, tolerance) else {
            return;
        };
        let mut opinion = Opinion::default();
        let pixels: Vec<[usize; 2]> = over.pixels().map(|(x, y)| [x, y]).take(MOST).collect();
        if pixels.is_empty() {
            case.opinion = Some(opinion);
            return;
        }
        let overrides = self.overrides(path, &mut Vec::new());
        let tracer = match overrides.and_then(|overrides| tracer(self, path, &overrides)) {
            Ok(tracer) => tracer,
            Err(why) => {
                opinion.silent = Some(why);
                case.opinion = Some(opinion);
                return;
            }
        };
        let mean = metrics::mean_reference(reference).unwrap_or(0.0);
        let value = |image: &Image, [x, y]: [usize; 2]| -> [f64; 3] {
            let index = y * image.width() + x;
            image.rgb().map_or([f64::NAN; 3], |planes| {
                planes.map(|plane| f64::from(plane[index]))
            })
        };
        for (number, &pixel) in pixels.iter().enumerate() {
            (self.stage)(&format!(
                "asking the oracle about pixel {} of {}",
                number + 1,
                pixels.len()
            ));
            let theirs = value(reference, pixel);
            let allowed = theirs.map(|v| tolerance.relative * v.abs() + tolerance.absolute * mean);
            let told = tracer(pixel.map(|p| p as u32));
            let verdict = verdict(told, value(ours, pixel), theirs, allowed);
            opinion.count(verdict);
            for worst in case.worst.iter_mut().filter(|worst| [worst.x, worst.y] == pixel) {
                worst.oracle = Some(verdict);
            }
        }
        case.opinion = Some(opinion);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn who_is_right() {
        let known = |rgb: f64, uncertainty: f64| Some([[rgb; 3], [uncertainty; 3]]);
        let judge =
            |value: Value, ours: f64, reference: f64| verdict(value, [ours; 3], [reference; 3], [0.01; 3]);
        let certain = known(1.0, 1e-12);
        assert_eq!(judge(certain, 1.001, 1.5), Verdict::Ours);
        assert_eq!(judge(certain, 1.5, 0.995), Verdict::Reference);
        assert_eq!(judge(certain, 1.009, 0.992), Verdict::Both);
        assert_eq!(judge(certain, 1.5, 0.5), Verdict::Neither);
        assert_eq!(judge(certain, f64::NAN, 1.0), Verdict::Reference);
        assert_eq!(judge(known(1.0, 0.02), 1.0, 1.5), Verdict::IllPosed);
        assert_eq!(judge(known(f64::NAN, 0.0), 1.0, 1.5), Verdict::IllPosed);
        assert_eq!(judge(None, 1.0, 1.0), Verdict::Unknown);
    }
}
