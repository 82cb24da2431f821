//! Tests whether noise explains a difference, for each pixel and channel, if the files contain the
//! noise.
//!
//! An image of random samples stores its noise in layers, for each channel C of R, G, B:
//!
//! | layer | contents |
//! |---|---|
//! | `variance.C` | the variance of *one sample* of the pixel (divided by n - 1, not by n) |
//! | `m2.C`, alternatively | the mean of the squared samples |
//! | `samples.N` | the samples n of the pixel; else the text attribute `whitstone:samples` counts for all |
//!
//! The variance of a pixel's mean is then that of one sample over n. With layers on both sides this
//! is Welch's test (*The generalization of "Student's" problem when several different population
//! variances are involved*, Biometrika 34, 1947, with the degrees of freedom of Satterthwaite
//! 1946); with layers on one side, the other one counts as exact and this is Student's test with
//! n - 1 degrees of freedom.
//!
//! A sample variance misses events that are rarer than 1 in n: a pixel that no such event hit has a
//! mean that is too low and a variance near 0. If only one side has noise, nothing else contains
//! these events. The variance is therefore at least the mean of the variances of the [`WINDOW`] x
//! [`WINDOW`] pixels around it. Suppose that an event hits a pixel with n samples lambda times on
//! average, lambda < 1, and was missed in one. The difference is then at most sqrt(lambda) standard
//! errors of the pooled variance, which is never significant. The pooled variance contains no event
//! with a probability of exp(-225 lambda), so the level holds for events that hit at least one
//! pixel in 14 (225/14 > 16 = -ln(1e-7), a usual threshold). Where nearby pixels are noisier, only
//! a larger fault is detected.
//!
//! Many tests give some significant results by chance. A value is *significant* if its p is below
//! 1 - (1 - level)^(1/N), N being the number of tests (Šidák 1967), as in Mitsuba 3's
//! `test_renders.py`. If the two renderers agree, the probability of any significant value is then
//! at most the level. Values within the pixel tolerance are not tested, because the rounding of a
//! picture without noise is significant at any level.

use crate::mask::Mask;
use crate::metrics::{CompareError, Pair, Side, Tolerance};
use serde::Serialize;
use std::collections::BTreeMap;
use whitstone_image::planes::{Image, ImageError, RGB};

/// Side of the window around a pixel whose mean variance is the minimum variance of the pixel, if
/// only one side has noise.
pub const WINDOW: usize = 15;

/// The kind of test.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Test {
    /// One side has noise: Student's test, with the variance of the neighbourhood as a lower bound.
    Student,
    /// Both sides have noise: Welch's test.
    Welch,
}

/// The results of the tests of all pixels and channels.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Significance {
    /// The kind of test.
    pub test: Test,
    /// The probability of any significant value by chance, over all tests together.
    pub level: f64,
    /// Number of tests: all values of the image.
    pub tests: usize,
    /// A value with a smaller p is significant.
    pub threshold: f64,
    /// Pixels with a significant value.
    pub pixels: usize,
    /// The smallest p.
    pub least_p: f64,
    /// Column and row of the smallest p; `None` if nothing is over the tolerance.
    pub least_at: Option<[usize; 2]>,
    /// The significant pixels.
    #[serde(skip)]
    pub mask: Mask,
}

/// Why the test is not possible.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum SignificanceError {
    /// The images cannot be compared.
    #[error(transparent)]
    Compare(#[from] CompareError),
    /// An incomplete set of layers.
    #[error("{side}: {error}")]
    Layers {
        /// The image.
        side: Side,
        /// The missing layer.
        error: ImageError,
    },
    /// The number of samples is unknown.
    #[error(
        "{side} has layers of variance, but lacks the number of samples: expected a layer `samples.N` or an attribute `whitstone:samples`"
    )]
    Samples {
        /// The image.
        side: Side,
    },
    /// A variance below 0 or not finite, or less than two samples.
    #[error("{side} has {what} at column {x}, row {y}: this gives no variance")]
    Value {
        /// The image.
        side: Side,
        /// The value.
        what: String,
        /// Column.
        x: usize,
        /// Row.
        y: usize,
    },
}

/// Tests every value at a `level` between 0 and 1; `None` if neither image has the layers.
///
/// # Errors
/// [`SignificanceError`]: images that cannot be compared, layers that are incomplete or have
/// impossible values, a level out of range.
pub fn significance(
    ours: &Image,
    reference: &Image,
    level: f64,
    tolerance: Tolerance,
) -> Result<Option<Significance>, SignificanceError> {
    if !(level > 0.0 && level < 1.0) {
        return Err(SignificanceError::Compare(CompareError::Option {
            name: "level",
            range: "above 0 and below 1",
            value: level,
        }));
    }
    let pair = Pair::new(ours, reference)?;
    pair.check_finite()?;
    let noise = [
        Noise::of(ours, Side::Ours)?,
        Noise::of(reference, Side::Reference)?,
    ];
    let test = match &noise {
        [None, None] => return Ok(None),
        [Some(_), Some(_)] => Test::Welch,
        _ => Test::Student,
    };
    let floor = match &noise {
        [Some(noise), None] | [None, Some(noise)] => Some(noise.neighbourhood(pair.width, pair.pixels())?),
        _ => None,
    };
    let tests = RGB.len() * pair.pixels();
    let threshold = threshold(level, tests);
    let mean = pair.mean_reference();
    let mut mask = Mask::new(pair.width, pair.pixels() / pair.width);
    let (mut least_p, mut least_at) = (1.0_f64, None);
    for index in 0..pair.pixels() {
        let place = [index % pair.width, index / pair.width];
        for (channel, (ours, reference)) in pair.at(index).into_iter().enumerate() {
            let mut parts = [None; 2];
            for (part, noise) in parts.iter_mut().zip(&noise) {
                *part = noise
                    .as_ref()
                    .map(|noise| noise.at(index, channel, place))
                    .transpose()?;
            }
            let difference = (ours - reference).abs();
            if difference <= tolerance.relative * reference.abs() + tolerance.absolute * mean {
                continue;
            }
            let p = match parts {
                [Some(ours), Some(reference)] => welch(difference, ours, reference),
                [Some(part), _] | [_, Some(part)] => {
                    let floor = floor.as_ref().map_or(0.0, |floor| floor[channel][index]);
                    one_sided(difference, part, floor)
                }
                // At least one side has noise.
                [None, None] => 1.0,
            };
            if p < threshold {
                mask.set(place[0], place[1], true);
            }
            if p < least_p || least_at.is_none() {
                (least_p, least_at) = (p, Some(place));
            }
        }
    }
    Ok(Some(Significance {
        test,
        level,
        tests,
        threshold,
        pixels: mask.count(),
        least_p,
        least_at,
        mask,
    }))
}

/// The largest differences from exact values that noise explains, for each channel and pixel of an
/// image with layers of variance; `None` without them. The test is that of [`significance()`].
///
/// # Errors
/// As of [`significance()`].
pub fn explained_by_noise(image: &Image, level: f64) -> Result<Option<[Vec<f64>; 3]>, SignificanceError> {
    let Some(noise) = Noise::of(image, Side::Ours)? else {
        return Ok(None);
    };
    let (width, pixels) = (image.width(), image.pixel_count());
    let threshold = threshold(level, RGB.len() * pixels);
    let floor = noise.neighbourhood(width, pixels)?;
    // Usually all pixels have as many samples.
    let mut critical = BTreeMap::new();
    let mut limits = RGB.map(|_| Vec::with_capacity(pixels));
    for (channel, limits) in limits.iter_mut().enumerate() {
        for index in 0..pixels {
            let part = noise.at(index, channel, [index % width, index / width])?;
            let degrees = part.samples - 1.0;
            let t = *(critical.entry(degrees.to_bits())).or_insert_with(|| critical_t(threshold, degrees));
            limits.push(t * (part.variance.max(floor[channel][index]) / part.samples).sqrt());
        }
    }
    Ok(Some(limits))
}

/// The p below which one of `tests` values is significant: 1 - (1 - level)^(1/tests), written so
/// that it does not round to zero.
fn threshold(level: f64, tests: usize) -> f64 {
    -libm::expm1(libm::log1p(-level) / tests as f64)
}

/// The t that [`student`] gives this probability.
fn critical_t(probability: f64, degrees: f64) -> f64 {
    // Powers of two, by bisection.
    let (mut low, mut high) = (-10.0_f64, 100.0_f64);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        match student(libm::exp2(middle), degrees) > probability {
            true => low = middle,
            false => high = middle,
        }
    }
    libm::exp2(high)
}

/// The noise layers of an image.
pub(crate) struct Noise<'a> {
    side: Side,
    means: [&'a [f32]; 3],
    /// Variances, or means of squares.
    moments: [&'a [f32]; 3],
    are_squares: bool,
    samples: Samples<'a>,
}

enum Samples<'a> {
    Each(&'a [f32]),
    All(f64),
}

/// The noise of a value.
#[derive(Clone, Copy)]
struct Part {
    /// Variance of one sample.
    variance: f64,
    samples: f64,
}

impl Part {
    fn of_mean(self) -> f64 {
        self.variance / self.samples
    }
}

impl<'a> Noise<'a> {
    pub(crate) fn of(image: &'a Image, side: Side) -> Result<Option<Self>, SignificanceError> {
        let name = |layer: &str, channel: &str| format!("{layer}.{channel}");
        let has = |layer: &str| RGB.iter().any(|c| image.channel(&name(layer, c)).is_some());
        let layer = match (has("variance"), has("m2")) {
            (true, _) => "variance",
            (_, true) => "m2",
            _ => return Ok(None),
        };
        let fail = |error| SignificanceError::Layers { side, error };
        let [r, g, b] = RGB.map(|channel| image.require_channel(&name(layer, channel)));
        let samples = match image.channel("samples.N") {
            Some(each) => Samples::Each(each),
            None => {
                let stated = image.attributes().get("samples");
                let count = stated.and_then(|text| text.trim().parse().ok());
                Samples::All(count.ok_or(SignificanceError::Samples { side })?)
            }
        };
        Ok(Some(Self {
            side,
            means: image.rgb().map_err(fail)?,
            moments: [r.map_err(fail)?, g.map_err(fail)?, b.map_err(fail)?],
            are_squares: layer == "m2",
            samples,
        }))
    }

    /// Adds the variances of the means, of which none is below the mean of those around it.
    pub(crate) fn add_variances(
        &self,
        width: usize,
        sums: &mut [Vec<f64>; 3],
    ) -> Result<(), SignificanceError> {
        let floor = self.neighbourhood(width, sums[0].len())?;
        for (channel, sums) in sums.iter_mut().enumerate() {
            for (index, sum) in sums.iter_mut().enumerate() {
                let part = self.at(index, channel, [index % width, index / width])?;
                *sum += part.variance.max(floor[channel][index]) / part.samples;
            }
        }
        Ok(())
    }

    /// The mean of the variances of one sample in the window around each pixel, per channel.
    fn neighbourhood(&self, width: usize, pixels: usize) -> Result<[Vec<f64>; 3], SignificanceError> {
        let height = pixels / width;
        let mut means = [const { Vec::new() }; 3];
        for (channel, means) in means.iter_mut().enumerate() {
            let mut variances = Vec::with_capacity(pixels);
            for index in 0..pixels {
                let place = [index % width, index / width];
                variances.push(self.at(index, channel, place)?.variance);
            }
            let rows: Vec<f64> = (0..pixels)
                .map(|index| {
                    let (start, end) = window(index % width, width);
                    let row = index - index % width;
                    variances[row + start..row + end].iter().sum::<f64>() / (end - start) as f64
                })
                .collect();
            *means = (0..pixels)
                .map(|index| {
                    let (start, end) = window(index / width, height);
                    let column = (start..end).map(|y| rows[y * width + index % width]);
                    column.sum::<f64>() / (end - start) as f64
                })
                .collect();
        }
        Ok(means)
    }

    fn at(&self, index: usize, channel: usize, [x, y]: [usize; 2]) -> Result<Part, SignificanceError> {
        let bad = |what: String| SignificanceError::Value {
            side: self.side,
            what,
            x,
            y,
        };
        let samples = match self.samples {
            Samples::Each(each) => f64::from(each[index]),
            Samples::All(count) => count,
        };
        if !(samples >= 2.0 && samples.is_finite()) {
            return Err(bad(format!("{samples} samples")));
        }
        let moment = f64::from(self.moments[channel][index]);
        if !(moment >= 0.0 && moment.is_finite()) {
            return Err(bad(format!("{moment} for {}", RGB[channel])));
        }
        let variance = if self.are_squares {
            let mean = f64::from(self.means[channel][index]);
            // Rounding may make the squared mean larger than the moment.
            (moment - mean * mean).max(0.0) * samples / (samples - 1.0)
        } else {
            moment
        };
        Ok(Part { variance, samples })
    }
}

/// The part of the window around a position that lies within the image.
fn window(position: usize, size: usize) -> (usize, usize) {
    (
        position.saturating_sub(WINDOW / 2),
        (position + WINDOW / 2 + 1).min(size),
    )
}

/// The probability of at least this difference from an exact value by chance. `floor` is the
/// minimum variance of one sample.
fn one_sided(difference: f64, part: Part, floor: f64) -> f64 {
    let variance = part.variance.max(floor) / part.samples;
    if variance == 0.0 {
        return z_test(difference, 0.0);
    }
    student(difference / variance.sqrt(), part.samples - 1.0)
}

/// The probability of at least this difference by chance, for a normal distribution.
fn z_test(difference: f64, variance_of_mean: f64) -> f64 {
    if variance_of_mean == 0.0 {
        return if difference == 0.0 { 1.0 } else { 0.0 };
    }
    libm::erfc(difference / (2.0 * variance_of_mean).sqrt())
}

/// The same for the difference of two means whose variances are both estimated.
fn welch(difference: f64, ours: Part, reference: Part) -> f64 {
    let (a, b) = (ours.of_mean(), reference.of_mean());
    if a + b == 0.0 {
        return z_test(difference, 0.0);
    }
    let degrees = (a + b) * (a + b) / (a * a / (ours.samples - 1.0) + b * b / (reference.samples - 1.0));
    student(difference / (a + b).sqrt(), degrees)
}

/// Both tails of Student's t distribution: I of degrees/(degrees + t²) with degrees/2 and 1/2 (DLMF
/// 8.17).
fn student(t: f64, degrees: f64) -> f64 {
    let x = degrees / (degrees + t * t);
    incomplete_beta(x, 1.0 - x, 0.5 * degrees, 0.5)
}

/// The regularised incomplete beta function of `x`; `rest` is 1 - x.
fn incomplete_beta(x: f64, rest: f64, a: f64, b: f64) -> f64 {
    if x <= 0.0 || rest <= 0.0 {
        return if x <= 0.0 { 0.0 } else { 1.0 };
    }
    // The fraction converges fast only on this side of the mean.
    if x > (a + 1.0) / (a + b + 2.0) {
        return 1.0 - incomplete_beta(rest, x, b, a);
    }
    let front =
        libm::lgamma(a + b) - libm::lgamma(a) - libm::lgamma(b) + a * libm::log(x) + b * libm::log(rest);
    libm::exp(front) / (a * fraction(x, a, b))
}

/// The continued fraction of DLMF 8.17.22, by Lentz's method.
fn fraction(x: f64, a: f64, b: f64) -> f64 {
    const TINY: f64 = 1e-300;
    let not_0 = |value: f64| if value.abs() < TINY { TINY } else { value };
    let (mut value, mut c, mut d) = (1.0, 1.0, 0.0);
    for step in 1..=10_000 {
        let m = f64::from(step / 2);
        let term = if step % 2 == 0 {
            m * (b - m) * x / ((a + 2.0 * m - 1.0) * (a + 2.0 * m))
        } else {
            -(a + m) * (a + b + m) * x / ((a + 2.0 * m) * (a + 2.0 * m + 1.0))
        };
        d = 1.0 / not_0(1.0 + term * d);
        c = not_0(1.0 + term / c);
        value *= c * d;
        if (c * d - 1.0).abs() < 1e-15 {
            break;
        }
    }
    value
}

#[cfg(test)]
mod tests;
