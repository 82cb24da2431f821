//! Numbers between an image and its reference.
//!
//! Everything is computed in `f64` over the channels R, G, B with compensated sums, in one fixed
//! order: rows, or parts of 2^14 values, are summed in parallel and then added in order. With `d =
//! ours - reference` at one channel of one pixel, `N` = 3 * pixels, and `mean_reference` = (1/N) *
//! sum min(|reference|, b) with the bound b of [`mean_reference`]:
//!
//! | name | definition |
//! |---|---|
//! | `rmse` | sqrt((1/N) sum d²) |
//! | `mae` | (1/N) sum \|d\| |
//! | `max_abs` | max \|d\| |
//! | `signed_mean` | (1/N) sum d |
//! | `relmse` | (1/N) sum d²/(reference² + 0.01) |
//! | `mape` | (1/N) sum \|d\|/(\|reference\| + 0.01) |
//! | `smape` | (1/N) sum 2 \|d\|/(\|ours\| + \|reference\| + 0.01) |
//! | `psnr` | 20 log10(peak/rmse) dB |
//! | relative residual | r = d/(\|reference\| + mean_reference) |
//! | `rel_rmse_interior` | sqrt of the mean of r² over RGB of all pixels that are not excluded |
//! | `signed_block_bias` | the mean of r with the largest magnitude, over all blocks of 16 x 16 pixels and channels |
//! | over tolerance | on any channel \|d\| > rel*\|reference\| + abs*mean_reference, or a value that is not finite |
//!
//! In `r`, a denominator below the smallest normal `f32` (about 1.2e-38) counts as that, so that
//! `r` stays finite for a black reference.

use rayon::prelude::*;
use serde::{Deserialize, Deserializer, Serialize};

use std::ops::Range;

use crate::mask::Mask;
use crate::sum::Sum;
use whitstone_image::planes::{Image, ImageError, Placement, RGB};

/// Side of the square blocks of [`Metrics::signed_block_bias`], in pixels. Blocks are aligned to
/// the top left corner; those at the right and the bottom may be smaller.
pub const BLOCK: usize = 16;

/// Added to the squared reference in `relmse`.
pub const RELMSE_EPSILON: f64 = 0.01;

/// Added to the denominators of `mape` and `smape`.
pub const MAPE_EPSILON: f64 = 0.01;

/// Smallest denominator of a relative residual.
const SMALLEST_DENOMINATOR: f64 = f32::MIN_POSITIVE as f64;

/// One of the two images of a comparison.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Side {
    /// The image under test.
    Ours,
    /// The reference image.
    Reference,
}

impl std::fmt::Display for Side {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Ours => "our image",
            Self::Reference => "the reference",
        })
    }
}

/// Why two images cannot be compared.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum CompareError {
    /// The images differ in size. They are never resampled.
    #[error("sizes differ: ours is {} x {} pixels, the reference {} x {}; render both at the same size, since images are not resampled", ours.0, ours.1, reference.0, reference.1)]
    Size {
        /// Columns and rows of our image.
        ours: (usize, usize),
        /// Columns and rows of the reference.
        reference: (usize, usize),
    },
    /// The images are different parts of a frame, or parts of different frames.
    #[error(
        "placements differ: ours is at ({}, {}) in a frame of {} x {} pixels, the reference at ({}, {}) in {} x {}",
        ours.x, ours.y, ours.frame_width, ours.frame_height,
        reference.x, reference.y, reference.frame_width, reference.frame_height
    )]
    Placement {
        /// Placement of our image.
        ours: Placement,
        /// Placement of the reference.
        reference: Placement,
    },
    /// One of the images lacks a channel.
    #[error("{side}: {error}")]
    Channel {
        /// The image that lacks it.
        side: Side,
        /// The error that names the channel and the existing ones.
        error: ImageError,
    },
    /// Some values are NaN or infinite, so that means are undefined.
    #[error(
        "expected finite values, found {} in our image and {} in the reference that are not; the first is in {} at column {}, row {}",
        count.ours, count.reference, first.side, first.x, first.y
    )]
    NotFinite {
        /// Number of such values.
        count: NotFinite,
        /// Place of the first one: our image before the reference, row by row.
        first: FirstNotFinite,
    },
    /// The mask of excluded pixels has another size than the images.
    #[error("the mask has {} x {} pixels, but the images have {} x {}", mask.0, mask.1, images.0, images.1)]
    MaskSize {
        /// Columns and rows of the mask.
        mask: (usize, usize),
        /// Columns and rows of the images.
        images: (usize, usize),
    },
    /// An option is out of its range.
    #[error("`{name}` must be {range}, found {value}")]
    Option {
        /// Name of the option.
        name: &'static str,
        /// The valid range.
        range: &'static str,
        /// The given value.
        value: f64,
    },
}

/// Number of values (channels of pixels) that are NaN or infinite.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize)]
pub struct NotFinite {
    /// In our image.
    pub ours: usize,
    /// In the reference.
    pub reference: usize,
}

/// The place of a value that is not finite.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct FirstNotFinite {
    /// The image.
    pub side: Side,
    /// Column.
    pub x: usize,
    /// Row.
    pub y: usize,
}

/// The tolerance of a pixel. It differs if |ours - reference| > relative*|reference| +
/// absolute*mean_reference on any channel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tolerance {
    /// Fraction of the reference's value at the pixel, >= 0; 1e-3 by default.
    pub relative: f64,
    /// Fraction of the mean of the reference, >= 0; 1e-4 by default.
    pub absolute: f64,
}

impl Default for Tolerance {
    fn default() -> Self {
        Self {
            relative: 1e-3,
            absolute: 1e-4,
        }
    }
}

/// Options of [`compare`].
#[derive(Debug, Clone, Copy, Default)]
pub struct CompareOptions<'a> {
    /// Tolerance for counting pixels.
    pub tolerance: Tolerance,
    /// Pixels that are excluded from `rel_rmse_interior` and `signed_block_bias` (explained edges),
    /// but from no other number.
    pub exclude: Option<&'a Mask>,
    /// The peak of `psnr`, > 0; by default the largest value of the reference.
    pub psnr_peak: Option<f64>,
}

/// The results of [`compare`]. All values are finite; undefined ones are `None`.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Metrics {
    /// Columns of both images.
    pub width: usize,
    /// Rows of both images.
    pub height: usize,
    /// Root mean square difference, in units of radiance, over all pixels.
    pub rmse: f64,
    /// Root mean square of the relative residual over the pixels that are not excluded; `None` if
    /// there are none, which is not a pass.
    pub rel_rmse_interior: Option<f64>,
    /// Number of pixels in `rel_rmse_interior`.
    pub interior_pixels: usize,
    /// Mean of the squared difference over (reference² + 0.01).
    pub relmse: f64,
    /// Mean of the absolute difference over (|reference| + 0.01).
    pub mape: f64,
    /// Mean of twice the absolute difference over (|ours| + |reference| + 0.01), less than 2.
    pub smape: f64,
    /// Mean of the absolute difference.
    pub mae: f64,
    /// Largest absolute difference.
    pub max_abs: f64,
    /// Mean of the difference, positive where ours is brighter.
    pub signed_mean: f64,
    /// Peak signal to noise ratio in dB; `None` if there is no difference or the peak is not
    /// above 0.
    pub psnr: Option<f64>,
    /// The peak that `psnr` refers to.
    pub psnr_peak: f64,
    /// Mean of |reference|, without the excess of very bright values: see [`mean_reference`].
    pub mean_reference: f64,
    /// The block of 16 x 16 pixels with the largest bias; `None` if all pixels are excluded.
    pub signed_block_bias: Option<BlockBias>,
    /// Number of pixels over the tolerance.
    pub pixels_over_tolerance: usize,
}

/// Mean relative residual of one channel over one block.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct BlockBias {
    /// The mean, positive where ours is brighter.
    pub bias: f64,
    /// `R`, `G` or `B`.
    pub channel: &'static str,
    /// Column of the block's top left pixel.
    pub x: usize,
    /// Row of the block's top left pixel.
    pub y: usize,
    /// Number of counted pixels of the block, 1 to 256.
    pub pixels: usize,
}

/// [`BlockBias`] in a file, where a channel may have any name.
#[derive(Deserialize)]
struct WrittenBias {
    bias: f64,
    channel: String,
    x: usize,
    y: usize,
    pixels: usize,
}

impl<'de> Deserialize<'de> for BlockBias {
    /// An invalid channel name counts as `R`: the value is only displayed and decides nothing.
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let written = WrittenBias::deserialize(deserializer)?;
        let known = RGB.into_iter().find(|name| *name == written.channel);
        Ok(Self {
            bias: written.bias,
            channel: known.unwrap_or(RGB[0]),
            x: written.x,
            y: written.y,
            pixels: written.pixels,
        })
    }
}

/// A pixel and its relative residual.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct WorstPixel {
    /// Column.
    pub x: usize,
    /// Row.
    pub y: usize,
    /// Our values (R, G, B).
    pub ours: [f32; 3],
    /// The reference's values (R, G, B).
    pub reference: [f32; 3],
    /// Largest magnitude of the relative residual over the channels; infinite if a value is not
    /// finite.
    pub residual: f64,
}

/// Measures the difference of two images over R, G, B. Other channels are ignored; see
/// [`layers`](crate::layers).
///
/// # Errors
/// [`CompareError`]: sizes, placements or channels that differ, values that are not finite, options
/// out of range.
pub fn compare(ours: &Image, reference: &Image, options: &CompareOptions) -> Result<Metrics, CompareError> {
    let pair = Pair::new(ours, reference)?;
    check_tolerance(options.tolerance)?;
    check_mask(options.exclude, &pair)?;
    check_peak(options.psnr_peak)?;
    pair.check_finite()?;

    let mean_reference = pair.mean_reference();
    let count = pair.values() as f64;
    let rows: Vec<Totals> = (0..pair.height)
        .into_par_iter()
        .map(|y| pair.row_totals(y, mean_reference, options.exclude))
        .collect();
    let mut totals = Totals::default();
    rows.iter().for_each(|row| totals.add(row));
    let Totals {
        sums:
            [
                squares,
                relative_squares,
                absolutes,
                percents,
                symmetric_percents,
                differences,
                interior,
            ],
        max_abs,
        largest,
        interior_pixels,
    } = totals;
    let rmse = (squares.total() / count).sqrt();
    let psnr_peak = options.psnr_peak.unwrap_or(largest);
    Ok(Metrics {
        width: ours.width(),
        height: ours.height(),
        rmse,
        rel_rmse_interior: (interior_pixels > 0)
            .then(|| (interior.total() / (RGB.len() * interior_pixels) as f64).sqrt()),
        interior_pixels,
        relmse: relative_squares.total() / count,
        mape: percents.total() / count,
        smape: symmetric_percents.total() / count,
        mae: absolutes.total() / count,
        max_abs,
        signed_mean: differences.total() / count,
        psnr: (rmse > 0.0 && psnr_peak > 0.0).then(|| 20.0 * libm::log10(psnr_peak / rmse)),
        psnr_peak,
        mean_reference,
        signed_block_bias: pair.block_bias(mean_reference, options.exclude),
        pixels_over_tolerance: pair.over(options.tolerance, mean_reference).count(),
    })
}

/// The pixels over a tolerance. Unlike [`compare`], this accepts values that are not finite: pixels
/// with such a value in either image are over tolerance, and the mean includes only finite values
/// of the reference.
///
/// # Errors
/// [`CompareError`]: sizes, placements or channels that differ, a tolerance out of range.
pub fn over_tolerance(ours: &Image, reference: &Image, tolerance: Tolerance) -> Result<Mask, CompareError> {
    let pair = Pair::new(ours, reference)?;
    check_tolerance(tolerance)?;
    Ok(pair.over(tolerance, pair.mean_reference()))
}

/// The `count` pixels with the largest relative residuals, worst first, restricted to `within` if
/// given. Pixels with a value that is not finite come first; of equals, the upper left one. Accepts
/// the same images as [`over_tolerance`].
///
/// # Errors
/// [`CompareError`]: sizes, placements or channels that differ, a mask of another size.
pub fn worst(
    ours: &Image,
    reference: &Image,
    count: usize,
    within: Option<&Mask>,
) -> Result<Vec<WorstPixel>, CompareError> {
    let pair = Pair::new(ours, reference)?;
    check_mask(within, &pair)?;
    if within.is_some_and(|mask| mask.count() == 0) {
        return Ok(Vec::new());
    }
    let mean = pair.mean_reference();
    let order = |a: &(usize, f64), b: &(usize, f64)| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0));
    let first = |ranked: &mut Vec<(usize, f64)>| {
        if count < ranked.len() {
            ranked.select_nth_unstable_by(count, order);
            ranked.truncate(count);
        }
    };
    let of_row = |y: usize| {
        let mut residuals = vec![0.0; pair.width];
        pair.residuals(y, mean, &mut residuals);
        let mut ranked = Vec::new();
        // Smallest residual kept so far, once `count` pixels are kept. A later pixel must exceed
        // it: of equals, the earlier one is first.
        let mut least = f64::NEG_INFINITY;
        for (index, residual) in pair.row(y).zip(residuals) {
            if residual > least && within.is_none_or(|mask| mask.as_slice()[index]) {
                ranked.push((index, residual));
                if ranked.len() >= count.max(32).saturating_mul(2) {
                    first(&mut ranked);
                    least = ranked
                        .iter()
                        .fold(f64::INFINITY, |least, pixel| least.min(pixel.1));
                }
            }
        }
        first(&mut ranked);
        ranked
    };
    let rows: Vec<Vec<(usize, f64)>> = (0..pair.height).into_par_iter().map(of_row).collect();
    let mut ranked = rows.concat();
    first(&mut ranked);
    ranked.sort_unstable_by(order);
    let pixel = |(index, residual): (usize, f64)| WorstPixel {
        x: index % pair.width,
        y: index / pair.width,
        ours: pair.ours.map(|plane| plane[index]),
        reference: pair.reference.map(|plane| plane[index]),
        residual,
    };
    Ok(ranked.into_iter().map(pixel).collect())
}

/// Counts the values of R, G, B that are NaN or infinite.
///
/// # Errors
/// [`CompareError`]: sizes, placements or channels that differ.
pub fn count_not_finite(ours: &Image, reference: &Image) -> Result<NotFinite, CompareError> {
    Ok(Pair::new(ours, reference)?.not_finite())
}

/// Mean of |reference| over the finite values of R, G, B; 0 if none is finite. A value above
/// [`BRIGHT`] times 2^k, the least power of two above the median of the values other than 0, counts
/// as that much: a lamp in the picture does not hide errors elsewhere.
///
/// # Errors
/// [`ImageError::MissingChannel`].
pub fn mean_reference(reference: &Image) -> Result<f64, ImageError> {
    Ok(mean_absolute(reference.rgb()?))
}

/// (ours - reference)/(|reference| + mean_reference), the denominator being at least the smallest
/// normal `f32`.
#[must_use]
pub fn relative_residual(ours: f64, reference: f64, mean_reference: f64) -> f64 {
    (ours - reference) / (reference.abs() + mean_reference).max(SMALLEST_DENOMINATOR)
}

/// The number of values that are handled at once by one thread.
pub(crate) const PART: usize = 1 << 14;

/// A value this many times larger than usual ones counts as this many times.
pub const BRIGHT: f64 = 64.0;

/// The largest value that counts fully in [`mean_reference`].
fn brightest(planes: [&[f32]; 3]) -> f64 {
    /// Bits of the mantissa.
    const MANTISSA: u32 = f32::MANTISSA_DIGITS - 1;
    let add = |mut all: [usize; 256], part: [usize; 256]| {
        all.iter_mut().zip(part).for_each(|(all, part)| *all += part);
        all
    };
    // Values by their exponents: 2^(exponent - 127) is the largest power of two that is not above.
    let of_part = |part: &[f32]| {
        let mut counts = [0_usize; 256];
        for value in part.iter().filter(|value| value.is_finite() && **value != 0.0) {
            counts[(value.abs().to_bits() >> MANTISSA) as usize] += 1;
        }
        counts
    };
    let parts = planes.into_par_iter().flat_map(|plane| plane.par_chunks(PART));
    let counts = parts.map(of_part).reduce(|| [0; 256], add);
    let values: usize = counts.iter().sum();
    let mut below = 0;
    let median = counts.iter().position(|count| {
        below += count;
        2 * below > values
    });
    median.map_or(f64::INFINITY, |exponent| {
        BRIGHT * libm::exp2(exponent as f64 - 126.0)
    })
}

fn mean_absolute(planes: [&[f32]; 3]) -> f64 {
    let most = brightest(planes);
    let of_part = |part: &[f32]| {
        let finite = part.iter().filter(|value| value.is_finite());
        let mut count = 0_usize;
        let sum: Sum = finite
            .inspect(|_| count += 1)
            .map(|value| f64::from(value.abs()).min(most))
            .collect();
        (sum, count)
    };
    let mut sum = Sum::default();
    let mut count = 0_usize;
    for plane in planes {
        let parts: Vec<(Sum, usize)> = plane.par_chunks(PART).map(of_part).collect();
        for (part, finite) in parts {
            sum.merge(part);
            count += finite;
        }
    }
    if count == 0 {
        0.0
    } else {
        sum.total() / count as f64
    }
}

/// The sums and extremes of [`compare`] over some pixels.
#[derive(Clone, Copy)]
struct Totals {
    /// Squares, relative squares, absolutes, percents, symmetric percents, differences, and the
    /// squared relative residuals of the interior.
    sums: [Sum; 7],
    max_abs: f64,
    /// The largest value of the reference.
    largest: f64,
    interior_pixels: usize,
}

impl Default for Totals {
    fn default() -> Self {
        Self {
            sums: [Sum::default(); 7],
            max_abs: 0.0,
            largest: f64::NEG_INFINITY,
            interior_pixels: 0,
        }
    }
}

impl Totals {
    fn add(&mut self, other: &Self) {
        for (sum, other) in self.sums.iter_mut().zip(&other.sums) {
            sum.merge(*other);
        }
        self.max_abs = self.max_abs.max(other.max_abs);
        self.largest = self.largest.max(other.largest);
        self.interior_pixels += other.interior_pixels;
    }
}

/// Two images of the same size and placement.
pub(crate) struct Pair<'a> {
    pub(crate) width: usize,
    pub(crate) height: usize,
    pub(crate) ours: [&'a [f32]; 3],
    pub(crate) reference: [&'a [f32]; 3],
}

impl<'a> Pair<'a> {
    pub(crate) fn new(ours: &'a Image, reference: &'a Image) -> Result<Self, CompareError> {
        check_geometry(ours, reference)?;
        let planes =
            |image: &'a Image, side| image.rgb().map_err(|error| CompareError::Channel { side, error });
        Ok(Self {
            width: ours.width(),
            height: ours.height(),
            ours: planes(ours, Side::Ours)?,
            reference: planes(reference, Side::Reference)?,
        })
    }

    pub(crate) fn pixels(&self) -> usize {
        self.width * self.height
    }

    fn values(&self) -> usize {
        RGB.len() * self.pixels()
    }

    /// (ours, reference) of the three channels of a pixel.
    pub(crate) fn at(&self, index: usize) -> [(f64, f64); 3] {
        std::array::from_fn(|channel| {
            (
                f64::from(self.ours[channel][index]),
                f64::from(self.reference[channel][index]),
            )
        })
    }

    pub(crate) fn mean_reference(&self) -> f64 {
        mean_absolute(self.reference)
    }

    /// The indices of the pixels of a row.
    fn row(&self, y: usize) -> Range<usize> {
        y * self.width..(y + 1) * self.width
    }

    /// Whether both images have the same values in a range of pixels.
    pub(crate) fn is_equal(&self, range: Range<usize>) -> bool {
        let mut planes = self.ours.iter().zip(&self.reference);
        planes.all(|(ours, reference)| ours[range.clone()] == reference[range.clone()])
    }

    /// The images must be finite.
    fn row_totals(&self, y: usize, mean: f64, exclude: Option<&Mask>) -> Totals {
        let mut totals = Totals::default();
        let row = self.row(y);
        let inside = |index: usize| exclude.is_none_or(|mask| !mask.as_slice()[index]);
        totals.interior_pixels = row.clone().filter(|&index| inside(index)).count();
        for plane in self.reference {
            let largest = plane[row.clone()]
                .iter()
                .copied()
                .fold(f32::NEG_INFINITY, f32::max);
            totals.largest = totals.largest.max(f64::from(largest));
        }
        // Differences of 0 change no sum.
        if self.is_equal(row.clone()) {
            return totals;
        }
        for index in row {
            let inside = inside(index);
            for (ours, reference) in self.at(index) {
                let difference = ours - reference;
                let [absolute, square] = [difference.abs(), difference * difference];
                let residual = if inside {
                    relative_residual(ours, reference, mean)
                } else {
                    0.0
                };
                let terms = [
                    square,
                    square / (reference * reference + RELMSE_EPSILON),
                    absolute,
                    absolute / (reference.abs() + MAPE_EPSILON),
                    2.0 * absolute / (ours.abs() + reference.abs() + MAPE_EPSILON),
                    difference,
                    residual * residual,
                ];
                for (sum, term) in totals.sums.iter_mut().zip(terms) {
                    sum.add(term);
                }
                totals.max_abs = totals.max_abs.max(absolute);
            }
        }
        totals
    }

    /// Largest magnitude of the relative residual over the channels, for each pixel of a row;
    /// infinite where a value is not finite. `residuals` must be zero before.
    fn residuals(&self, y: usize, mean: f64, residuals: &mut [f64]) {
        for (ours, reference) in self.planes(y) {
            for (worst, (&ours, &reference)) in residuals.iter_mut().zip(ours.iter().zip(reference)) {
                let finite = ours.is_finite() & reference.is_finite();
                let residual = relative_residual(f64::from(ours), f64::from(reference), mean).abs();
                let residual = if finite { residual } else { f64::INFINITY };
                *worst = if residual > *worst { residual } else { *worst };
            }
        }
    }

    /// The values of a row in both images, for each channel.
    fn planes(&self, y: usize) -> impl Iterator<Item = (&[f32], &[f32])> {
        let row = self.row(y);
        let planes = self.ours.into_iter().zip(self.reference);
        planes.map(move |(ours, reference)| (&ours[row.clone()], &reference[row.clone()]))
    }

    fn not_finite(&self) -> NotFinite {
        let count = |planes: [&[f32]; 3]| -> usize {
            let of_part = |part: &[f32]| part.iter().filter(|value| !value.is_finite()).count();
            let of_plane = |plane: &[f32]| plane.par_chunks(PART).map(of_part).sum::<usize>();
            planes.into_iter().map(of_plane).sum()
        };
        NotFinite {
            ours: count(self.ours),
            reference: count(self.reference),
        }
    }

    pub(crate) fn check_finite(&self) -> Result<(), CompareError> {
        let count = self.not_finite();
        if count == NotFinite::default() {
            return Ok(());
        }
        let first = |planes: [&[f32]; 3]| {
            (0..self.pixels()).find(|&index| planes.iter().any(|plane| !plane[index].is_finite()))
        };
        let found = first(self.ours)
            .map(|index| (Side::Ours, index))
            .or_else(|| first(self.reference).map(|index| (Side::Reference, index)));
        found.map_or(Ok(()), |(side, index)| {
            let first = FirstNotFinite {
                side,
                x: index % self.width,
                y: index / self.width,
            };
            Err(CompareError::NotFinite { count, first })
        })
    }

    fn over(&self, tolerance: Tolerance, mean: f64) -> Mask {
        Mask::from_rows(self.width, self.height, |y, members| {
            let row = self.row(y);
            let is_finite = |plane: &[f32]| plane[row.clone()].iter().all(|value| value.is_finite());
            if self.is_equal(row.clone()) && self.reference.into_iter().all(is_finite) {
                return;
            }
            // Without an early end, so that several pixels are compared at once.
            for (ours, reference) in self.planes(y) {
                for (member, (&ours, &reference)) in members.iter_mut().zip(ours.iter().zip(reference)) {
                    let finite = ours.is_finite() & reference.is_finite();
                    let (ours, reference) = (f64::from(ours), f64::from(reference));
                    let allowed = tolerance.relative * reference.abs() + tolerance.absolute * mean;
                    // Two equal infinities are over as well, and a comparison with NaN is never
                    // within.
                    *member |= !(finite & ((ours - reference).abs() <= allowed));
                }
            }
        })
    }

    /// The images must be finite.
    fn block_bias(&self, mean: f64, exclude: Option<&Mask>) -> Option<BlockBias> {
        let rows: Vec<Option<BlockBias>> = (0..self.height.div_ceil(BLOCK))
            .into_par_iter()
            .map(|row| self.block_bias_of_row(row * BLOCK, mean, exclude))
            .collect();
        let larger = |worst: BlockBias, next: BlockBias| {
            if next.bias.abs() > worst.bias.abs() {
                next
            } else {
                worst
            }
        };
        rows.into_iter().flatten().reduce(larger)
    }

    /// As [`Self::block_bias`], of the blocks whose first row is `y`.
    fn block_bias_of_row(&self, y: usize, mean: f64, exclude: Option<&Mask>) -> Option<BlockBias> {
        let mut worst: Option<BlockBias> = None;
        let rows = y..self.height.min(y + BLOCK);
        for x in (0..self.width).step_by(BLOCK) {
            let columns = x..self.width.min(x + BLOCK);
            let in_row = |row: usize| row * self.width + columns.start..row * self.width + columns.end;
            // No bias is not larger than any.
            if worst.is_some() && rows.clone().all(|row| self.is_equal(in_row(row))) {
                continue;
            }
            let mut sums = [Sum::default(); 3];
            let mut pixels = 0;
            for index in rows.clone().flat_map(in_row) {
                if exclude.is_some_and(|mask| mask.as_slice()[index]) {
                    continue;
                }
                pixels += 1;
                for (sum, (ours, reference)) in sums.iter_mut().zip(self.at(index)) {
                    sum.add(relative_residual(ours, reference, mean));
                }
            }
            if pixels == 0 {
                continue;
            }
            for (channel, sum) in RGB.into_iter().zip(sums) {
                let bias = sum.total() / pixels as f64;
                if worst.is_none_or(|worst| bias.abs() > worst.bias.abs()) {
                    worst = Some(BlockBias {
                        bias,
                        channel,
                        x,
                        y,
                        pixels,
                    });
                }
            }
        }
        worst
    }
}

/// Rejects images of different sizes or placements.
pub(crate) fn check_geometry(ours: &Image, reference: &Image) -> Result<(), CompareError> {
    let size = |image: &Image| (image.width(), image.height());
    if size(ours) != size(reference) {
        return Err(CompareError::Size {
            ours: size(ours),
            reference: size(reference),
        });
    }
    if ours.placement() != reference.placement() {
        return Err(CompareError::Placement {
            ours: ours.placement(),
            reference: reference.placement(),
        });
    }
    Ok(())
}

fn check_mask(mask: Option<&Mask>, pair: &Pair) -> Result<(), CompareError> {
    check_mask_size(mask, (pair.width, pair.height))
}

/// Rejects a mask of another size than the images.
pub(crate) fn check_mask_size(mask: Option<&Mask>, images: (usize, usize)) -> Result<(), CompareError> {
    match mask.map(|mask| (mask.width(), mask.height())) {
        Some(mask) if mask != images => Err(CompareError::MaskSize { mask, images }),
        _ => Ok(()),
    }
}

fn check_tolerance(tolerance: Tolerance) -> Result<(), CompareError> {
    for (name, value) in [("relative", tolerance.relative), ("absolute", tolerance.absolute)] {
        if !(value >= 0.0 && value.is_finite()) {
            return Err(CompareError::Option {
                name,
                range: "finite and >= 0",
                value,
            });
        }
    }
    Ok(())
}

fn check_peak(peak: Option<f64>) -> Result<(), CompareError> {
    match peak {
        Some(value) if !(value > 0.0 && value.is_finite()) => Err(CompareError::Option {
            name: "psnr_peak",
            range: "finite and > 0",
            value,
        }),
        _ => Ok(()),
    }
}

#[cfg(test)]
mod tests;
