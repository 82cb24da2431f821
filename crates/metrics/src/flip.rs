//! FLIP: how visible the difference of two images is when they alternate on a screen.
//!
//! Andersson, Nilsson, Akenine-Möller, Oskarsson, Åström, Fairchild, *FLIP: A Difference Evaluator
//! for Alternating Images*, PACMCGIT 3(2), 2020 (section 4: colour and feature pipelines), and
//! Andersson, Nilsson, Shirley, Akenine-Möller, *Visualizing Errors in Rendered High Dynamic Range
//! Images*, Eurographics 2021 short papers, for [`flip`]: the largest value over tone-mapped
//! exposures.
//!
//! Implemented from the papers, in double precision. The tests contain values of `flip-evaluator`
//! 1.7.

use crate::metrics::{CompareError, PART, Pair};
use crate::sum::Sum;
use rayon::prelude::*;
use serde::Serialize;
use std::f64::consts::{LN_2, LOG2_E, PI, SQRT_2};
use std::ops::Range;
use whitstone_image::Image;
use whitstone_image::tone::{ACES, ToneCurve};
use whitstone_simd::{dispatch, select};

/// Pixels per degree of the visual field for which the values are valid: a screen of 3840 pixels
/// and 0.7 m, seen from 0.7 m.
pub const PIXELS_PER_DEGREE: f64 = 0.7 * (3840.0 / 0.7) * (PI / 180.0);

/// Columns and rows of a tile.
const TILE: [usize; 2] = [256, 64];

/// The visibility of a difference.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Flip {
    /// Mean over all pixels, 0 (invisible) to 1.
    pub mean: f64,
    /// Row by row, each 0 to 1.
    #[serde(skip)]
    pub map: Vec<f64>,
    /// First and last exposure in stops, and the number of exposures; `None` for [`flip_ldr`].
    pub exposures: Option<(f64, f64, usize)>,
}

/// HDR-FLIP, for linear values of any range. Negative values count as 0.
///
/// # Errors
/// [`CompareError`]: sizes, placements or channels that differ, values that are not finite.
pub fn flip(ours: &Image, reference: &Image) -> Result<Flip, CompareError> {
    let pair = Pair::new(ours, reference)?;
    pair.check_finite()?;
    let (start, stop) = exposures(&pair);
    let count = (stop - start).ceil().max(2.0) as usize;
    let filters = Filters::new(PIXELS_PER_DEGREE);
    let mut map = vec![0.0_f64; pair.pixels()];
    for i in 0..count {
        let exposure = start + (stop - start) * i as f64 / (count - 1) as f64;
        let factor = libm::exp2(exposure);
        filters.map(&pair, TILE, &mut map, |x| ToneCurve::Filmic.apply(x * factor));
    }
    Ok(Flip {
        mean: mean(&map),
        map,
        exposures: Some((start, stop, count)),
    })
}

/// LDR-FLIP, for linear values that are displayed without tone mapping. Values are clamped to [0,
/// 1].
///
/// # Errors
/// [`CompareError`]: sizes, placements or channels that differ, values that are not finite.
pub fn flip_ldr(ours: &Image, reference: &Image) -> Result<Flip, CompareError> {
    let pair = Pair::new(ours, reference)?;
    pair.check_finite()?;
    let mut map = vec![0.0; pair.pixels()];
    Filters::new(PIXELS_PER_DEGREE).map(&pair, TILE, &mut map, |x| ToneCurve::Clamp.apply(x));
    Ok(Flip {
        mean: mean(&map),
        map,
        exposures: None,
    })
}

type Vec3 = [f64; 3];

fn mean(map: &[f64]) -> f64 {
    let parts: Vec<Sum> = map
        .par_chunks(PART)
        .map(|part| part.iter().copied().collect())
        .collect();
    let mut sum = Sum::default();
    parts.into_iter().for_each(|part| sum.merge(part));
    sum.total() / map.len().max(1) as f64
}

/// The exposures in stops at which the brightest and the median pixel are shown at 0.85 (2021,
/// section 3.1).
fn exposures(pair: &Pair<'_>) -> (f64, f64) {
    const SHOWN: f64 = 0.85;
    let [a, b, c] = [0, 1, 2].map(|i| ACES[i] - SHOWN * ACES[i + 3]);
    let half = -0.5 * b / a;
    let value = half + (half * half - c / a).sqrt();
    let of = |index| luminance_of(pair.at(index).map(|(_, reference)| reference.max(0.0)));
    let mut luminance: Vec<f64> = (0..pair.pixels()).into_par_iter().map(of).collect();
    luminance.par_sort_unstable_by(f64::total_cmp);
    // An image has at least one pixel.
    let n = luminance.len();
    let brightest = luminance[n - 1];
    let median = 0.5 * (luminance[n / 2] + luminance[(n - 1) / 2]);
    // Black stays black at every exposure.
    let stops = |luminance: f64| libm::log2(value / luminance.max(f64::from(f32::EPSILON)));
    (stops(brightest), stops(median))
}

/// Rec. 709 luminance.
fn luminance_of([r, g, b]: Vec3) -> f64 {
    0.2126 * r + 0.7152 * g + 0.0722 * b
}

/// Linear Rec. 709 to CIE XYZ (IEC 61966-2-1), so that white has Y = 1.
#[inline(always)]
fn xyz([r, g, b]: Vec3) -> Vec3 {
    [
        (10_135_552.0 * r + 8_788_810.0 * g + 4_435_075.0 * b) / 24_577_794.0,
        (2_613_072.0 * r + 8_788_810.0 * g + 887_015.0 * b) / 12_288_897.0,
        (1_425_312.0 * r + 8_788_810.0 * g + 70_074_185.0 * b) / 73_733_382.0,
    ]
}

/// CIE XYZ to linear Rec. 709: the inverse of [`xyz`].
#[inline(always)]
fn rgb([x, y, z]: Vec3) -> Vec3 {
    [
        3.241_003_232_976_358_7 * x - 1.537_398_969_488_785_5 * y - 0.498_615_881_996_362_9 * z,
        -0.969_224_252_202_516_6 * x + 1.875_929_983_695_176 * y + 0.041_554_226_340_084_724 * z,
        0.055_639_419_851_975_444 * x - 0.204_011_206_123_909_97 * y + 1.057_148_977_187_533_5 * z,
    ]
}

/// XYZ divided by that of white.
#[inline(always)]
fn relative([x, y, z]: Vec3) -> Vec3 {
    let white = xyz([1.0; 3]);
    [x / white[0], y / white[1], z / white[2]]
}

/// An opponent space that is linear in light: YCxCz, by Zhang and Wandell.
#[inline(always)]
fn ycxcz(rgb: Vec3) -> Vec3 {
    let [x, y, z] = relative(xyz(rgb));
    [116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z)]
}

#[inline(always)]
fn from_ycxcz([y, cx, cz]: Vec3) -> Vec3 {
    let y = (y + 16.0) / 116.0;
    let white = xyz([1.0; 3]);
    rgb([
        (y + cx / 500.0) * white[0],
        y * white[1],
        (y - cz / 200.0) * white[2],
    ])
}

/// CIELAB with the Hunt effect: chroma counts less at low luminance.
#[inline(always)]
fn hunt_lab(rgb: Vec3) -> Vec3 {
    let [x, y, z] = relative(xyz(rgb));
    let [x, y, z] = [lightness(x), lightness(y), lightness(z)];
    let l = 116.0 * y - 16.0;
    [l, 0.01 * l * 500.0 * (x - y), 0.01 * l * 200.0 * (y - z)]
}

/// The curve of CIELAB: a cube root, with a line near zero.
#[inline(always)]
fn lightness(t: f64) -> f64 {
    const DELTA: f64 = 6.0 / 29.0;
    let linear = t / (3.0 * DELTA * DELTA) + 4.0 / 29.0;
    select(t > DELTA * DELTA * DELTA, cube_root(t), linear)
}

/// The cube root of a number from 0.008 to 1.1, to the last digits. Unlike `cbrt`, it is
/// vectorised.
#[inline(always)]
fn cube_root(t: f64) -> f64 {
    // The quotient of the third and the fourth root is nearly linear in the latter: 2 % off.
    let fourth = t.sqrt().sqrt();
    let mut root = fourth * (0.542 + 0.473 * fourth);
    // Halley's method triples the number of digits.
    for _ in 0..2 {
        let cube = root * root * root;
        root *= (cube + 2.0 * t) / (2.0 * cube + t);
    }
    root
}

/// The HyAB distance of Abasi, Amani Tehrani and Fairchild (2020), for large differences.
#[inline(always)]
fn distance(a: Vec3, b: Vec3) -> f64 {
    (a[0] - b[0]).abs() + length(a[1] - b[1], a[2] - b[2])
}

/// The power of distances that FLIP compares.
const POWER: f64 = 0.7;

/// `x` to the power of `y`, for `x` from 0 to 1e9 and `y` from 0 to 1, within 1e-15 of the larger
/// of the result and 1. Unlike `powf`, it is vectorised.
#[inline(always)]
fn power(x: f64, y: f64) -> f64 {
    // 1.5 * 2^52: added to a small number, it leaves the nearest integer in the last bits.
    const UNITS: f64 = 6_755_399_441_055_744.0;
    const MANTISSA: u64 = (1 << 52) - 1;
    // x = m 2^e with m from sqrt(1/2) to sqrt(2).
    let bits = x.to_bits();
    let m = f64::from_bits(bits & MANTISSA | 1.0_f64.to_bits());
    let is_large = m > SQRT_2;
    let m = select(is_large, 0.5 * m, m);
    let e = f64::from_bits(bits >> 52 | UNITS.to_bits()) - UNITS - 1023.0 + select(is_large, 1.0, 0.0);
    // ln m = 2 artanh((m - 1)/(m + 1)), by its series.
    let t = (m - 1.0) / (m + 1.0);
    let square = t * t;
    let mut series = 0.0;
    for k in (0..12).rev() {
        series = series * square + 1.0 / f64::from(2 * k + 1);
    }
    let logarithm = y * (e + 2.0 * LOG2_E * t * series);
    // 2^(n + f) with f from -1/2 to 1/2, by the series of exp.
    let n = logarithm + UNITS;
    let f = (logarithm - (n - UNITS)) * LN_2;
    let mut series = 1.0;
    for k in (1..14).rev() {
        series = 1.0 + series * f / f64::from(k);
    }
    let scale = f64::from_bits((n + 1023.0).to_bits() << 52);
    select(x > 0.0, scale * series, select(y > 0.0, 0.0, 1.0))
}

/// The length of a vector whose squares do not overflow. Unlike `hypot`, it is vectorised.
#[inline(always)]
fn length(x: f64, y: f64) -> f64 {
    (x * x + y * y).sqrt()
}

/// A one-dimensional kernel, centred on its middle element.
type Kernel = Vec<f64>;

/// The filters for one viewing distance.
struct Filters {
    /// Contrast sensitivity: for each channel, a sum of separable kernels.
    sensitivity: [Vec<(f64, Kernel)>; 3],
    /// A Gaussian and its first two derivatives, with the width of a visible feature.
    feature: [Kernel; 3],
    /// The power of the maximum distance: from green to blue.
    farthest: f64,
    /// The largest radius of a kernel.
    reach: usize,
}

impl Filters {
    fn new(per_degree: f64) -> Self {
        // Movshon and Kiorpes (1988), as in table 1 of the paper: amplitude and width of each
        // Gaussian.
        const SENSITIVITY: [&[(f64, f64)]; 3] =
            [&[(1.0, 0.0047)], &[(1.0, 0.0053)], &[(34.1, 0.04), (13.5, 0.025)]];
        let widest = 0.04_f64;
        let radius = (3.0 * (widest / (2.0 * PI * PI)).sqrt() * per_degree).ceil() as i64;
        let sensitivity = SENSITIVITY.map(|gaussians| {
            let mut parts: Vec<(f64, Kernel)> = Vec::new();
            for &(amplitude, width) in gaussians {
                let at = |i: i64| libm::exp(-PI * PI * (i as f64 / per_degree).powi(2) / width);
                parts.push((
                    amplitude * (PI / width).sqrt(),
                    (-radius..=radius).map(at).collect(),
                ));
            }
            let total: f64 = parts
                .iter()
                .map(|(factor, kernel)| factor * kernel.iter().sum::<f64>().powi(2))
                .sum();
            parts.iter_mut().for_each(|(factor, _)| *factor /= total);
            parts
        });
        // Half of the visible width of an edge, 0.082 degrees.
        let deviation = 0.5 * 0.082 * per_degree;
        let reach = (3.0 * deviation).ceil() as i64;
        let gaussian = |i: i64| libm::exp(-((i * i) as f64) / (2.0 * deviation * deviation));
        let first = |i: i64| -(i as f64) * gaussian(i);
        let second = |i: i64| ((i * i) as f64 / (deviation * deviation) - 1.0) * gaussian(i);
        let kernel = |of: &dyn Fn(i64) -> f64| balanced((-reach..=reach).map(of).collect());
        Self {
            reach: radius.max(reach) as usize,
            sensitivity,
            feature: [kernel(&gaussian), kernel(&first), kernel(&second)],
            farthest: libm::pow(
                distance(hunt_lab([0.0, 1.0, 0.0]), hunt_lab([0.0, 0.0, 1.0])),
                POWER,
            ),
        }
    }

    /// Raises the values of `map` to those of FLIP, of two images whose values are displayed as
    /// `shown`, in [0, 1]. Far from all differences they are 0, so only the tiles next to one are
    /// computed, with the pixels around them that the filters reach.
    fn map(&self, pair: &Pair<'_>, size: [usize; 2], map: &mut [f64], shown: impl Fn(f64) -> f64 + Sync) {
        let (width, height) = (pair.width, pair.height);
        let near = |range: &Range<usize>, limit: usize| {
            range.start.saturating_sub(self.reach)..(range.end + self.reach).min(limit)
        };
        let of_band = |work: &mut Work, (band, values): (usize, &mut [f64])| {
            let start = band * size[1];
            for first in (0..width).step_by(size[0]) {
                let tile = Tile {
                    columns: first..(first + size[0]).min(width),
                    rows: start..start + values.len() / width,
                };
                let (columns, mut rows) = (near(&tile.columns, width), near(&tile.rows, height));
                let is_equal = |y: usize| pair.is_equal(y * width + columns.start..y * width + columns.end);
                if rows.all(is_equal) {
                    continue;
                }
                for (seen, planes) in [pair.ours, pair.reference].into_iter().enumerate() {
                    self.see(planes, [width, height], &tile, &shown, seen, work);
                }
                for (y, row) in values.chunks_mut(width).enumerate() {
                    self.raise(&mut row[tile.columns.clone()], &work.seen, y * tile.columns.len());
                }
            }
        };
        map.par_chunks_mut(size[1] * width)
            .enumerate()
            .for_each_init(Work::default, of_band);
    }

    /// Raises values to the visibility of the differences of successive pixels, from `first` on.
    fn raise(&self, values: &mut [f64], seen: &[Seen; 2], first: usize) {
        let count = values.len();
        // The loop has no checks of bounds if all slices have the same length.
        let [ours, reference] = seen.each_ref().map(|seen| {
            let [a, b, c] = &seen.color;
            [a, b, c, &seen.edge, &seen.point].map(|plane| &plane[first..][..count])
        });
        dispatch(
            #[inline(always)]
            || {
                let ([a, b, c, edge, point], [other_a, other_b, other_c, other_edge, other_point]) =
                    (ours, reference);
                let values = &mut values[..count];
                for i in 0..count {
                    let edge = (edge[i] - other_edge[i]).abs();
                    let point = (point[i] - other_point[i]).abs();
                    let feature = (select(edge > point, edge, point) / SQRT_2).sqrt();
                    let distance = distance([a[i], b[i], c[i]], [other_a[i], other_b[i], other_c[i]]);
                    let found = power(self.spread(power(distance, POWER)), 1.0 - feature);
                    values[i] = select(found > values[i], found, values[i]);
                }
            },
        );
    }

    /// Maps powers of distances to [0, 1]: 0.4 of the maximum becomes 0.95, and larger ones share
    /// the rest.
    #[inline(always)]
    fn spread(&self, distance: f64) -> f64 {
        const KNEE: (f64, f64) = (0.4, 0.95);
        let knee = KNEE.0 * self.farthest;
        let near = KNEE.1 / knee * distance;
        let far = KNEE.1 + (distance - knee) / (self.farthest - knee) * (1.0 - KNEE.1);
        select(distance < knee, near, far)
    }

    /// Computes `work.seen[index]` of a tile of an image.
    fn see(
        &self,
        planes: [&[f32]; 3],
        size: [usize; 2],
        tile: &Tile,
        shown: &impl Fn(f64) -> f64,
        index: usize,
        work: &mut Work,
    ) {
        let reach = self.reach;
        let (width, wide) = (tile.columns.len(), tile.columns.len() + 2 * reach);
        let Work {
            opponent,
            smooth,
            rows,
            part,
            seen,
        } = work;
        let Seen { color, edge, point } = &mut seen[index];
        self.opponent(planes, size, tile, shown, opponent);
        for ((color, plane), kernels) in color.iter_mut().zip(&*opponent).zip(&self.sensitivity) {
            color.clear();
            color.resize(width * tile.rows.len(), 0.0);
            for (factor, kernel) in kernels {
                across(plane, wide, kernel, reach, rows);
                down(rows, width, kernel, reach, part);
                add(color, *factor, part);
            }
        }
        to_hunt_lab(color);
        let [grey, ..] = opponent;
        grey.iter_mut().for_each(|y| *y = (*y + 16.0) / 116.0);
        let [gaussian, first, second] = &self.feature;
        across(grey, wide, gaussian, reach, smooth);
        for (feature, kernel) in [(edge, first), (point, second)] {
            across(grey, wide, kernel, reach, rows);
            down(rows, width, gaussian, reach, feature);
            down(smooth, width, kernel, reach, part);
            lengths(feature, part);
        }
    }

    /// The opponent colours of a tile and of the pixels within reach. The border of the image is
    /// extended by its own values.
    fn opponent(
        &self,
        planes: [&[f32]; 3],
        [width, height]: [usize; 2],
        tile: &Tile,
        shown: &impl Fn(f64) -> f64,
        opponent: &mut [Plane; 3],
    ) {
        let reach = self.reach;
        let wide = tile.columns.len() + 2 * reach;
        let from = tile.columns.start.saturating_sub(reach);
        let to = (tile.columns.end + reach).min(width);
        let before = reach - (tile.columns.start - from);
        for plane in opponent.iter_mut() {
            plane.resize(wide * (tile.rows.len() + 2 * reach), 0.0);
        }
        let [a, b, c] = &mut *opponent;
        let rows = a
            .chunks_exact_mut(wide)
            .zip(b.chunks_exact_mut(wide))
            .zip(c.chunks_exact_mut(wide));
        for (y, ((a, b), c)) in rows.enumerate() {
            let start = (tile.rows.start + y).saturating_sub(reach).min(height - 1) * width;
            for (out, plane) in [&mut *a, &mut *b, &mut *c].into_iter().zip(planes) {
                let row = &plane[start + from..start + to];
                let (left, rest) = out.split_at_mut(before);
                let (middle, right) = rest.split_at_mut(row.len());
                for (out, value) in middle.iter_mut().zip(row) {
                    *out = shown(f64::from(*value));
                }
                left.fill(middle[0]);
                right.fill(middle[row.len() - 1]);
            }
        }
        to_ycxcz(opponent);
    }
}

// The loops over pixels. Each is compiled for every set of vector instructions, which covers what
// is inlined: they call nothing else.

/// Linear colours to YCxCz, in place.
fn to_ycxcz([a, b, c]: &mut [Plane; 3]) {
    dispatch(
        #[inline(always)]
        || {
            for ((a, b), c) in a.iter_mut().zip(b).zip(c) {
                [*a, *b, *c] = ycxcz([*a, *b, *c]);
            }
        },
    );
}

/// YCxCz, of colours clamped to what a screen shows, to CIELAB, in place.
fn to_hunt_lab([a, b, c]: &mut [Plane; 3]) {
    dispatch(
        #[inline(always)]
        || {
            for ((a, b), c) in a.iter_mut().zip(b).zip(c) {
                let [red, green, blue] = from_ycxcz([*a, *b, *c]);
                let shown = [red.clamp(0.0, 1.0), green.clamp(0.0, 1.0), blue.clamp(0.0, 1.0)];
                [*a, *b, *c] = hunt_lab(shown);
            }
        },
    );
}

/// Adds a multiple of some values.
fn add(sum: &mut [f64], factor: f64, values: &[f64]) {
    dispatch(
        #[inline(always)]
        || {
            for (sum, value) in sum.iter_mut().zip(values) {
                *sum += factor * value;
            }
        },
    );
}

/// The lengths of vectors, in place of their first components.
fn lengths(x: &mut [f64], y: &[f64]) {
    dispatch(
        #[inline(always)]
        || {
            for (x, y) in x.iter_mut().zip(y) {
                *x = length(*x, *y);
            }
        },
    );
}

/// A part of an image.
struct Tile {
    columns: Range<usize>,
    rows: Range<usize>,
}

/// Values of the pixels of a tile, row by row, or also of those within reach.
type Plane = Vec<f64>;

/// The pixels of a tile as seen from the viewing distance.
#[derive(Default)]
struct Seen {
    color: [Plane; 3],
    edge: Plane,
    point: Plane,
}

/// Memory that is used for one tile after the other: new pages would take half of the time.
#[derive(Default)]
struct Work {
    opponent: [Plane; 3],
    smooth: Plane,
    rows: Plane,
    part: Plane,
    seen: [Seen; 2],
}

/// Normalises positive weights to a sum of 1, and negative ones to -1.
fn balanced(kernel: Kernel) -> Kernel {
    let positive: f64 = kernel.iter().filter(|&&x| x > 0.0).sum();
    let negative: f64 = kernel.iter().filter(|&&x| x < 0.0).sum();
    let scale = |x: f64| {
        if x > 0.0 {
            x / positive
        } else {
            -x / negative.min(-f64::MIN_POSITIVE)
        }
    };
    kernel.into_iter().map(scale).collect()
}

/// Filters rows of `wide` values. The first and last `reach` columns have no result.
fn across(plane: &[f64], wide: usize, kernel: &[f64], reach: usize, result: &mut Plane) {
    let (width, skipped) = (wide - 2 * reach, reach - kernel.len() / 2);
    result.resize(plane.len() / wide * width, 0.0);
    dispatch(
        #[inline(always)]
        || {
            for (row, out) in plane.chunks_exact(wide).zip(result.chunks_exact_mut(width)) {
                weighted(out, &row[skipped..], 1, kernel);
            }
        },
    );
}

/// Filters columns. The first and last `reach` rows have no result.
fn down(plane: &[f64], width: usize, kernel: &[f64], reach: usize, result: &mut Plane) {
    let skipped = reach - kernel.len() / 2;
    result.resize(plane.len() - 2 * reach * width, 0.0);
    dispatch(
        #[inline(always)]
        || {
            for (y, out) in result.chunks_exact_mut(width).enumerate() {
                weighted(out, &plane[(y + skipped) * width..], width, kernel);
            }
        },
    );
}

/// The sum of the slices of `values` that begin `step` apart, times the weights of a kernel.
#[inline(always)]
fn weighted(out: &mut [f64], values: &[f64], step: usize, kernel: &[f64]) {
    let rest = out.len() % 32;
    let (blocks, single) = out.split_at_mut(out.len() - rest);
    weighted_blocks::<32>(blocks, values, step, kernel);
    weighted_blocks::<1>(single, &values[blocks.len()..], step, kernel);
}

/// As many sums at a time as registers hold.
#[inline(always)]
fn weighted_blocks<const N: usize>(out: &mut [f64], values: &[f64], step: usize, kernel: &[f64]) {
    for (i, block) in out.as_chunks_mut::<N>().0.iter_mut().enumerate() {
        let mut sum = [0.0; N];
        for (k, weight) in kernel.iter().enumerate() {
            let start = k * step + i * N;
            for (sum, value) in sum.iter_mut().zip(&values[start..start + N]) {
                *sum += weight * value;
            }
        }
        *block = sum;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_abs_diff_eq;

    const SIZE: (usize, usize) = (40, 30);

    fn image(of: impl Fn(usize, usize, usize) -> f32) -> Image {
        let pixels: Vec<[f32; 3]> = (0..SIZE.0 * SIZE.1)
            .map(|i| [0, 1, 2].map(|c| of(i % SIZE.0, i / SIZE.0, c)))
            .collect();
        Image::from_rgb(SIZE.0, SIZE.1, &pixels).unwrap()
    }

    fn pattern(k: usize) -> impl Fn(usize, usize, usize) -> f32 {
        move |x, y, c| {
            let blocks = (x / 8 + y / 6) % 2 * 12;
            (blocks + (x * 7 + y * 13 + c * 5 + k * (x / 5) + k * c * 3) % 20) as f32 / 32.0
        }
    }

    fn dot(x: usize, y: usize, c: usize) -> f32 {
        if (12..14).contains(&y) && (20..22).contains(&x) {
            [1.0, 0.0, 0.0][c]
        } else {
            pattern(0)(x, y, c)
        }
    }

    fn shifted(x: usize, y: usize, c: usize) -> f32 {
        pattern(0)((x + SIZE.0 - 1) % SIZE.0, y, c)
    }

    fn high(of: impl Fn(usize, usize, usize) -> f32) -> impl Fn(usize, usize, usize) -> f32 {
        move |x, y, c| (of(x, y, c) * 8.0).powi(2) + 0.01
    }

    /// The mean, three pixels and the largest value, as returned by
    /// `flip_evaluator.evaluate(reference, test, range, inputsRGB=False, applyMagma=False)` of
    /// version 1.7.
    fn agrees(found: &Flip, expected: [f64; 5]) {
        let at = |x: usize, y: usize| found.map[y * SIZE.0 + x];
        let largest = found.map.iter().copied().fold(0.0, f64::max);
        let values = [found.mean, at(20, 12), at(0, 0), at(39, 29), largest];
        for (found, expected) in values.into_iter().zip(expected) {
            assert_abs_diff_eq!(found, expected, epsilon = 1e-4);
        }
    }

    /// A tile has the values of the whole image, at borders and far from them.
    #[test]
    fn tiles_have_the_values_of_the_whole_image() {
        let [width, height] = [420, 300];
        let color = |place: [usize; 2]| {
            let [x, y] = place.map(|part| part as f32);
            [0.5 + 0.4 * (0.1 * x).sin(), 0.5 + 0.4 * (0.13 * y).cos(), 0.3]
        };
        let reference = Image::from_fn(width, height, |x, y| color([x, y])).unwrap();
        let filters = Filters::new(PIXELS_PER_DEGREE);
        let map = |ours: &Image, size: [usize; 2]| {
            let mut map = vec![0.0; width * height];
            filters.map(&Pair::new(ours, &reference).unwrap(), size, &mut map, |x| x);
            map
        };
        assert!(map(&reference, TILE).iter().all(|value| *value == 0.0));
        // The corner, two tiles at once, and the last column.
        let changed = [[0, 0], [TILE[0], 40], [width - 1, height - 20]];
        let ours = |x: usize, y: usize| match changed.contains(&[x, y]) {
            true => [1.0, 0.0, 0.0],
            false => color([x, y]),
        };
        let ours = Image::from_fn(width, height, ours).unwrap();
        let whole = map(&ours, [width, height]);
        assert_eq!(map(&ours, TILE), whole);
        assert!(whole.iter().filter(|value| **value > 0.0).count() > 500);
    }

    #[test]
    fn powers_are_exact() {
        for x in [0.0, 1e-300, 1e-12, 0.1, 0.5, 0.7, SQRT_2, 1.0, 1.5, 41.0, 300.0] {
            for y in [0.0, 1e-9, 0.3, POWER, 1.0] {
                let expected = f64::powf(x, y);
                assert!(
                    (power(x, y) - expected).abs() <= 1e-15 * expected.max(1.0),
                    "{x} {y}"
                );
            }
        }
    }

    #[test]
    fn the_cube_root_is_exact() {
        for i in 8..=1100 {
            let t = f64::from(i) / 1000.0;
            assert!((cube_root(t) / t.cbrt() - 1.0).abs() < 1e-15, "{t}");
        }
    }

    #[test]
    fn ldr_flip_equals_the_reference_implementation() {
        let reference = image(pattern(0));
        let flip = |of: &dyn Fn(usize, usize, usize) -> f32| flip_ldr(&image(of), &reference).unwrap();
        agrees(
            &flip(&pattern(1)),
            [0.318156451, 0.18955265, 0.3981472, 0.43624064, 0.783674],
        );
        agrees(&flip(&dot), [0.008647039, 0.35936, 0.0, 0.0, 0.40440708]);
        agrees(
            &flip(&shifted),
            [0.2131771, 0.10066833, 0.5989294, 0.5225336, 0.6271329],
        );
    }

    #[test]
    fn hdr_flip_equals_the_reference_implementation() {
        let reference = image(high(pattern(0)));
        let found = flip(&image(high(pattern(1))), &reference).unwrap();
        let (start, stop, count) = found.exposures.unwrap();
        assert_abs_diff_eq!(start, -4.647458076, epsilon = 1e-5);
        assert_abs_diff_eq!(stop, -3.006349325, epsilon = 1e-5);
        assert_eq!(count, 2);
        agrees(&found, [0.336236686, 0.26055157, 0.4748305, 0.6303607, 0.9328241]);
        let found = flip(&image(high(dot)), &reference).unwrap();
        agrees(&found, [0.010069047, 0.40759432, 0.0, 0.0, 0.47584397]);
        let found = flip(&image(high(shifted)), &reference).unwrap();
        agrees(
            &found,
            [0.240154669, 0.11054143, 0.78709537, 0.66894776, 0.78709537],
        );
    }

    #[test]
    fn equal_images_have_zero_flip_even_if_black() {
        let same = image(pattern(0));
        assert_eq!(flip(&same, &same).unwrap().mean, 0.0);
        let black = image(|_, _, _| 0.0);
        assert_eq!(flip(&black, &black).unwrap().mean, 0.0);
        let found = flip(&same, &black).unwrap();
        assert!(found.mean > 0.1 && found.map.iter().all(|x| (0.0..=1.0).contains(x)));
        assert!(flip(&image(|_, _, _| f32::NAN), &same).is_err());
    }

    #[test]
    fn the_opponent_space_round_trips() {
        for color in [[0.2, 0.5, 0.9], [1.0, 1.0, 1.0], [0.0, 1.0, 0.0]] {
            for (found, expected) in from_ycxcz(ycxcz(color)).into_iter().zip(color) {
                assert_abs_diff_eq!(found, expected, epsilon = 1e-12);
            }
        }
    }
}
