//! A picture at ever coarser levels, and what a ray and its neighbours see of it.
//!
//! Williams, *Pyramidal parametrics*, SIGGRAPH 1983: each level is the picture at half the size, so that a mean over many texels is
//! one over few. Greene and Heckbert, *Creating raster Omnimax images from multiple perspective views using the elliptical
//! weighted average filter*, IEEE CG&A 6(6), 1986, and Heckbert, *Fundamentals of texture mapping and image warping*, 1989, section 3.5:
//! the mean over the ellipse that a round sample covers, whose rows are cut out of its quadratic form. A long ellipse is made wider until
//! its axes are in proportion to a bound, so that the texels that are read are bounded too.

use crate::wrap::Wrap;
use whitstone_core::{DVec2, Rgb, simd};

/// Linear values, row by row from the top.
pub(crate) struct Level {
    pub(crate) width: usize,
    pub(crate) height: usize,
    pub(crate) texels: Vec<[f32; 3]>,
}

/// The levels of a picture but for the finest one, which is the picture; the last one is a single texel. Together they take about 4 bytes for each texel of the
/// picture: a third of its texels, of 12 bytes.
#[derive(Default)]
pub(crate) struct Pyramid(pub(crate) Vec<Level>);

/// Half, rounded down, but at least one.
fn halved(n: usize) -> usize {
    (n / 2).max(1)
}

/// The sizes of all levels but the finest.
fn sizes(width: usize, height: usize) -> impl Iterator<Item = (usize, usize)> {
    let next =
        |(width, height): &(usize, usize)| (width * height > 1).then(|| (halved(*width), halved(*height)));
    std::iter::successors(Some((width, height)), next).skip(1)
}

impl Pyramid {
    /// What it takes over a picture of this size, in bytes.
    pub(crate) fn bytes(width: usize, height: usize) -> u64 {
        let texels: usize = sizes(width, height).map(|(width, height)| width * height).sum();
        (texels * size_of::<[f32; 3]>()) as u64
    }

    /// Over a picture whose texels have these linear values. Each texel of a level is the mean of the level before over the area that it covers, so
    /// that sizes need not be powers of two.
    pub(crate) fn new(width: usize, height: usize, texel: impl Fn(usize) -> [f32; 3]) -> Self {
        let mut levels: Vec<Level> = Vec::new();
        for (to_width, to_height) in sizes(width, height) {
            let level = match levels.last() {
                None => shrunk((width, height), (to_width, to_height), &texel),
                Some(last) => {
                    let from = (last.width, last.height);
                    shrunk(from, (to_width, to_height), &|at| last.texels[at])
                }
            };
            levels.push(level);
        }
        Self(levels)
    }
}

/// For each of `to` texels in a row the first of the `from` texels that it covers, and the shares of these.
fn shares(from: usize, to: usize) -> Vec<(usize, Vec<f64>)> {
    let ratio = from as f64 / to as f64;
    let covered = |k: usize| {
        let (start, end) = (k * from / to, ((k + 1) * from).div_ceil(to));
        let (low, high) = (k as f64 * ratio, (k + 1) as f64 * ratio);
        let part = |i: usize| (high.min((i + 1) as f64) - low.max(i as f64)).max(0.0) / ratio;
        (start, (start..end).map(part).collect())
    };
    (0..to).map(covered).collect()
}

/// The mean over the area of each texel of the smaller level.
fn shrunk(from: (usize, usize), (width, height): (usize, usize), texel: &dyn Fn(usize) -> [f32; 3]) -> Level {
    let (columns, rows) = (shares(from.0, width), shares(from.1, height));
    let mut texels = Vec::with_capacity(width * height);
    let mut sums = vec![[0.0_f64; 3]; width];
    for (first_row, row_shares) in rows {
        sums.fill([0.0; 3]);
        for (row, of_row) in (first_row..).zip(row_shares) {
            for (sum, (first, of_columns)) in sums.iter_mut().zip(&columns) {
                for (column, share) in (*first..).zip(of_columns) {
                    let value = texel(row * from.0 + column);
                    for (sum, value) in sum.iter_mut().zip(value) {
                        *sum += of_row * share * f64::from(value);
                    }
                }
            }
        }
        texels.extend(sums.iter().map(|sum| sum.map(|value| value as f32)));
    }
    Level {
        width,
        height,
        texels,
    }
}

/// Entries of the table of weights.
const WEIGHTS: usize = 256;

/// The weights of texels in an ellipse by the square of their distance from its middle, as a part of that of its edge: a Gaussian that is cut where it
/// is e^-2, and lowered so that it ends at zero.
pub(crate) struct Weights {
    table: [f32; WEIGHTS],
    /// Half axes of the ellipse for neighbours that are one texel away along them.
    radius: f64,
}

impl Weights {
    pub(crate) fn new() -> Self {
        let edge = (-2.0_f64).exp();
        let weight = |k: usize| (-2.0 * (k as f64 + 0.5) / WEIGHTS as f64).exp() - edge;
        // The variance along an axis of this weight over a disk of radius 1 is (1 - 5q) / (4 (1 - 3q)), q = e^-2; that of the square of
        // a sample is 1/12.
        let variance = (1.0 - 5.0 * edge) / (4.0 * (1.0 - 3.0 * edge));
        Self {
            table: std::array::from_fn(|k| weight(k) as f32),
            radius: (1.0 / (12.0 * variance)).sqrt(),
        }
    }
}

/// The ellipse that a sample covers, in units of the picture.
pub(crate) struct Ellipse {
    major: DVec2,
    minor: DVec2,
    /// Lengths of both, in texels of the finest level.
    pub(crate) long: f64,
    pub(crate) short: f64,
}

impl Ellipse {
    /// Of a sample whose neighbours are these steps away, on a picture of this size. Not finite if a step is not.
    pub(crate) fn new(steps: [DVec2; 2], size: DVec2, most: f64, weights: &Weights) -> Self {
        let scale = size * weights.radius;
        let (s, t) = (steps[0] * scale, steps[1] * scale);
        // The axes of the quadratic form: Jacobi's rotation of the sum of s s^T and t t^T.
        let (xx, xy, yy) = (
            s.x * s.x + t.x * t.x,
            s.x * s.y + t.x * t.y,
            s.y * s.y + t.y * t.y,
        );
        let (mean, half) = (0.5 * (xx + yy), 0.5 * (xx - yy));
        let root = (half * half + xy * xy).sqrt();
        let long = (mean + root).sqrt();
        // By the area, which does not cancel.
        let short = if long > 0.0 {
            (s.perp_dot(t) / long).abs()
        } else {
            0.0
        };
        let along = if half >= 0.0 {
            DVec2::new(half + root, xy)
        } else {
            DVec2::new(xy, root - half)
        };
        let along = along.try_normalize().unwrap_or(DVec2::X);
        let short = short.max(long / most);
        Self {
            major: along * long / size,
            minor: along.perp() * short / size,
            long,
            short,
        }
    }
}

/// A level as it is looked up.
#[derive(Clone, Copy)]
pub(crate) struct Grid {
    pub(crate) width: usize,
    pub(crate) height: usize,
    /// Of columns and of rows.
    pub(crate) wrap: [Wrap; 2],
}

/// Places in a row or a column, one after the other.
#[derive(Clone, Copy)]
struct Walk {
    wrap: Wrap,
    count: i32,
    /// The place that texels are counted from.
    base: i32,
}

impl Walk {
    /// `middle` is a whole number of any size.
    #[inline(always)]
    fn new(wrap: Wrap, count: usize, middle: f64) -> Self {
        let count = count as i32;
        let base = match wrap {
            // Whole numbers below the bounds of the type, or NaN, which becomes 0.
            Wrap::Repeat => middle.rem_euclid(f64::from(count)) as i32,
            Wrap::Mirror => middle.rem_euclid(2.0 * f64::from(count)) as i32,
            // Far beyond the border all is the border.
            Wrap::Clamp => middle.clamp(f64::from(i32::MIN / 2), f64::from(i32::MAX / 2)) as i32,
        };
        Self { wrap, count, base }
    }

    /// The texel that stands so many places from the middle.
    #[inline(always)]
    fn place(&self, offset: i32) -> usize {
        let k = self.base + offset;
        let inside = match self.wrap {
            Wrap::Repeat if (0..self.count).contains(&k) => k,
            Wrap::Repeat => k.rem_euclid(self.count),
            Wrap::Clamp => k.clamp(0, self.count - 1),
            Wrap::Mirror => {
                let k = k.rem_euclid(2 * self.count);
                k.min(2 * self.count - 1 - k)
            }
        };
        inside as usize
    }
}

/// The mean of a level over an ellipse around a point, by these weights.
pub(crate) fn elliptical(
    grid: Grid,
    texel: impl Fn(usize) -> [f32; 3],
    middle: DVec2,
    ellipse: &Ellipse,
    weights: &Weights,
) -> Rgb {
    // Numbers are rounded to whole ones all the time: an instruction that not every processor has.
    simd::dispatch(
        #[inline(always)]
        || mean(grid, texel, middle, ellipse, weights),
    )
}

#[inline(always)]
fn mean(
    grid: Grid,
    texel: impl Fn(usize) -> [f32; 3],
    middle: DVec2,
    ellipse: &Ellipse,
    weights: &Weights,
) -> Rgb {
    let size = DVec2::new(grid.width as f64, grid.height as f64);
    let middle = middle * size - 0.5;
    // At least a texel to each side, so that some are inside, and the mean goes over smoothly from one to the next.
    let wide = |axis: DVec2| {
        let axis = axis * size;
        axis * (1.0 / axis.length()).max(1.0)
    };
    let (major, minor) = (wide(ellipse.major), wide(ellipse.minor));
    let columns = Walk::new(grid.wrap[0], grid.width, middle.x.floor());
    let rows = Walk::new(grid.wrap[1], grid.height, middle.y.floor());
    let part = |x: f64| {
        if x.is_finite() {
            (x - x.floor()) as f32
        } else {
            0.0
        }
    };
    let (right, down) = (part(middle.x), part(middle.y));
    // Few long runs of texels instead of many short ones.
    let lying = major.x.abs() >= major.y.abs();
    let across = |v: DVec2| if lying { v } else { DVec2::new(v.y, v.x) };
    let quadratic = Quadratic::new(across(major), across(minor));
    let sum = if lying {
        let row = |k: i32| rows.place(k) * grid.width;
        quadratic.sum(
            [right, down],
            weights,
            |p, q_part| texel(q_part + columns.place(p)),
            row,
        )
    } else {
        quadratic.sum(
            [down, right],
            weights,
            |p, q_part| texel(rows.place(p) * grid.width + q_part),
            |k| columns.place(k),
        )
    };
    sum.mean()
}

/// Weighted texels.
#[derive(Clone, Copy, Default)]
struct Sum {
    value: [f32; 3],
    weight: f32,
}

impl Sum {
    fn mean(self) -> Rgb {
        let [r, g, b] = self.value;
        let part = |value: f32| f64::from(value / self.weight);
        Rgb::new(part(r), part(g), part(b))
    }
}

/// The points of an ellipse: `a p² + b p q + c q² < 1`.
struct Quadratic {
    a: f32,
    b: f32,
    c: f32,
    /// How far it reaches along q.
    reach: f32,
}

impl Quadratic {
    /// With these conjugate half diameters.
    #[inline(always)]
    fn new(one: DVec2, other: DVec2) -> Self {
        let area = one.perp_dot(other);
        let per = 1.0 / (area * area);
        Self {
            a: ((one.y * one.y + other.y * other.y) * per) as f32,
            b: (-2.0 * (one.x * one.y + other.x * other.y) * per) as f32,
            c: ((one.x * one.x + other.x * other.x) * per) as f32,
            reach: (one.y * one.y + other.y * other.y).sqrt() as f32,
        }
    }

    /// Of all texels inside, by their distance from a point that lies `start` beyond a texel.
    #[inline(always)]
    fn sum(
        &self,
        [start_p, start_q]: [f32; 2],
        weights: &Weights,
        texel: impl Fn(i32, usize) -> [f32; 3],
        line: impl Fn(i32) -> usize,
    ) -> Sum {
        let Self { a, b, c, reach } = *self;
        let mut sum = Sum::default();
        let per_a = 1.0 / a;
        let (first, last) = ((start_q - reach).ceil() as i32, (start_q + reach).floor() as i32);
        for k in first..=last {
            let q = k as f32 - start_q;
            // The run of texels of this line that are inside.
            let (middle, inside) = (-0.5 * b * q * per_a, (1.0 - c * q * q) * per_a);
            let square = middle * middle + inside;
            if square.is_nan() || square <= 0.0 {
                continue;
            }
            let half = square.sqrt();
            let (from, to) = (
                (start_p + middle - half).ceil() as i32,
                (start_p + middle + half).floor() as i32,
            );
            let at_line = line(k);
            for i in from..=to {
                let p = i as f32 - start_p;
                let distance = (a * p + b * q) * p + c * q * q;
                let entry = (distance * WEIGHTS as f32) as usize;
                let weight = weights.table[entry.min(WEIGHTS - 1)];
                let value = texel(i, at_line);
                sum.value[0] += weight * value[0];
                sum.value[1] += weight * value[1];
                sum.value[2] += weight * value[2];
                sum.weight += weight;
            }
        }
        sum
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_size_is_covered_exactly_once() {
        for from in 1..40 {
            for to in 1..=from {
                let shares = shares(from, to);
                let mut taken = vec![0.0; from];
                for (first, shares) in &shares {
                    assert!((shares.iter().sum::<f64>() - 1.0).abs() < 1e-14, "{from} to {to}");
                    for (at, share) in (*first..).zip(shares) {
                        taken[at] += share;
                    }
                }
                let each = to as f64 / from as f64;
                assert!(
                    taken.iter().all(|part| (part - each).abs() < 1e-14),
                    "{from} to {to}"
                );
            }
        }
    }

    #[test]
    fn levels_end_at_one_texel_and_take_what_they_say() {
        let pyramid = Pyramid::new(13, 5, |at| [at as f32, 1.0, 0.0]);
        let sizes: Vec<_> = pyramid
            .0
            .iter()
            .map(|level| (level.width, level.height))
            .collect();
        assert_eq!(sizes, [(6, 2), (3, 1), (1, 1)]);
        let bytes: usize = pyramid.0.iter().map(|level| size_of_val(&*level.texels)).sum();
        assert_eq!(bytes as u64, Pyramid::bytes(13, 5));
        // The mean of 0 to 64.
        assert_eq!(pyramid.0[2].texels, [[32.0, 1.0, 0.0]]);
        assert!(Pyramid::new(1, 1, |_| [1.0; 3]).0.is_empty());
        // What is promised of the largest textures that are common.
        assert_eq!(Pyramid::bytes(4096, 4096), 12 * (4096 * 4096 - 1) / 3);
    }

    /// The weights have the variance that the radius is made from: of the square of a sample.
    #[test]
    fn the_weights_have_the_variance_of_a_square() {
        let weights = Weights::new();
        let (mut sum, mut moment) = (0.0, 0.0);
        for (k, weight) in weights.table.iter().enumerate() {
            // Rings of equal area.
            let square = (k as f64 + 0.5) / WEIGHTS as f64;
            sum += f64::from(*weight);
            moment += f64::from(*weight) * 0.5 * square * weights.radius * weights.radius;
        }
        assert!((moment / sum - 1.0 / 12.0).abs() < 1e-5, "{}", moment / sum);
        assert!(weights.table.windows(2).all(|pair| pair[0] > pair[1]));
        assert!(weights.table[WEIGHTS - 1] > 0.0);
    }

    #[test]
    fn ellipses_have_the_axes_of_their_steps() {
        let weights = Weights::new();
        let size = DVec2::splat(100.0);
        let of = |s: [f64; 2], t: [f64; 2], most: f64| {
            let ellipse = Ellipse::new([s.into(), t.into()], size, most, &weights);
            (
                ellipse.long / weights.radius,
                ellipse.short / weights.radius,
                ellipse,
            )
        };
        let (long, short, ellipse) = of([0.08, 0.0], [0.0, 0.02], 16.0);
        assert!((long - 8.0).abs() < 1e-12 && (short - 2.0).abs() < 1e-12);
        assert!(ellipse.major.y.abs() < 1e-15 && ellipse.minor.x.abs() < 1e-15);
        // The same ellipse by other half diameters.
        let turn = DVec2::from_angle(0.6);
        let (s, t) = (
            DVec2::new(0.08 * turn.x, 0.02 * turn.y),
            DVec2::new(-0.08 * turn.y, 0.02 * turn.x),
        );
        let (long, short, _) = of(s.into(), t.into(), 16.0);
        assert!((long - 8.0).abs() < 1e-12 && (short - 2.0).abs() < 1e-12);
        // Made wider, and never longer.
        let (long, short, _) = of([0.08, 0.0], [0.16, 0.0], 16.0);
        assert!((short - long / 16.0).abs() < 1e-12 && (long - 320f64.sqrt()).abs() < 1e-12);
    }

    /// Each texel by itself, to find out what weight it has.
    #[test]
    fn weights_add_up_to_one() {
        let weights = Weights::new();
        for wrap in [Wrap::Repeat, Wrap::Mirror, Wrap::Clamp] {
            for (s, t) in [
                ([0.3, 0.1], [-0.05, 0.2]),
                ([0.02, 0.5], [0.03, 0.01]),
                ([0.4, 0.4], [0.4, 0.39]),
            ] {
                let grid = Grid {
                    width: 9,
                    height: 6,
                    wrap: [wrap; 2],
                };
                let ellipse = Ellipse::new([s.into(), t.into()], DVec2::new(9.0, 6.0), 16.0, &weights);
                let share = |which: usize| {
                    let texel = |at: usize| [f32::from(u8::from(at == which)); 3];
                    elliptical(grid, texel, DVec2::new(0.77, -3.4), &ellipse, &weights).r
                };
                let sum: f64 = (0..9 * 6).map(share).sum();
                assert!((sum - 1.0).abs() < 1e-5, "{wrap:?}: {sum}");
            }
        }
    }
}
