//! Mip maps and EWA filtering of images.
//!
//! Williams, *Pyramidal parametrics*, SIGGRAPH 1983: each level is the image at half the size, so
//! that a mean over many texels becomes one over few. Greene and Heckbert, *Creating raster Omnimax
//! images from multiple perspective views using the elliptical weighted average filter*, IEEE CG&A
//! 6(6), 1986, and Heckbert, *Fundamentals of texture mapping and image warping*, 1989, section
//! 3.5: the mean over the ellipse that a round sample covers, scanned row by row using its
//! quadratic form. Elongated ellipses are widened until the ratio of their axes is at most a bound,
//! which also bounds the number of texels read.

use crate::support::wrap::Wrap;

use whitstone_core::{DVec2, Rgb, Vec4, simd};

/// A level of a mip map: linear values, row by row from the top.
pub(crate) struct Level {
    pub(crate) width: usize,
    pub(crate) height: usize,
    /// Padded by one texel, so that four numbers can be loaded at each.
    texels: Vec<[f32; 3]>,
}

impl Level {
    #[inline(always)]
    pub(crate) fn texel(&self, at: usize) -> [f32; 3] {
        self.texels[at]
    }

    /// Texel lookup for [`elliptical`].
    #[inline(always)]
    pub(crate) fn four(&self) -> impl Fn(usize) -> Vec4 {
        let numbers = self.texels.as_flattened();
        move |at| Vec4::from_slice(&numbers[3 * at..])
    }
}

/// The levels of a mip map except the finest one, which is the image itself; the last one is a
/// single texel. Together they need about 4 bytes per texel of the image: a third of its texels, at
/// 12 bytes each.
#[derive(Default)]
pub(crate) struct Pyramid(pub(crate) Vec<Level>);

/// Half of n, rounded down, but at least 1.
fn halved(n: usize) -> usize {
    (n / 2).max(1)
}

/// The sizes of all levels except the finest.
fn sizes(width: usize, height: usize) -> impl Iterator<Item = (usize, usize)> {
    let next =
        |(width, height): &(usize, usize)| (width * height > 1).then(|| (halved(*width), halved(*height)));
    std::iter::successors(Some((width, height)), next).skip(1)
}

impl Pyramid {
    /// Memory of the mip map of an image of this size, in bytes.
    pub(crate) fn bytes(width: usize, height: usize) -> u64 {
        let texels: usize = sizes(width, height)
            .map(|(width, height)| width * height + 1)
            .sum();
        (texels * size_of::<[f32; 3]>()) as u64
    }

    /// Builds the mip map of an image with these linear texel values. Each texel of a level is the
    /// mean of the previous level over the area that it covers, so sizes need not be powers of two.
    pub(crate) fn new(width: usize, height: usize, texel: impl Fn(usize) -> [f32; 3]) -> Self {
        let mut levels: Vec<Level> = Vec::new();
        for (to_width, to_height) in sizes(width, height) {
            let level = match levels.last() {
                None => shrunk((width, height), (to_width, to_height), &texel),
                Some(last) => {
                    let from = (last.width, last.height);
                    shrunk(from, (to_width, to_height), &|at| last.texel(at))
                }
            };
            levels.push(level);
        }
        Self(levels)
    }
}

/// For each of `to` texels in a row, the first of the `from` texels that it covers and the weights
/// of the covered ones.
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

/// Downsamples a level: the mean over the area of each texel of the smaller level.
fn shrunk(from: (usize, usize), (width, height): (usize, usize), texel: &dyn Fn(usize) -> [f32; 3]) -> Level {
    let (columns, rows) = (shares(from.0, width), shares(from.1, height));
    let mut texels = Vec::with_capacity(width * height + 1);
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
    texels.push([0.0; 3]);
    Level {
        width,
        height,
        texels,
    }
}

/// Half axis of the ellipse per texel of distance to the neighbouring sample, chosen so that the
/// weights have the variance of a square sample, 1/12. Along an axis, over a disk of radius 1, the
/// weights have the variance (1 - 5q) / (4 (1 - 3q)), q = e^-2.
const RADIUS: f64 = 0.782_549_4;

/// Factor on all weights, a power of two, so that no sum of texels overflows: an ellipse has fewer
/// than 65536 texels.
const SMALL: f32 = 1.0 / 65536.0;

/// The weights of four texels, given their squared distances from the centre relative to the edge
/// of the ellipse. A Gaussian truncated at e^-2 and lowered to reach zero there; it is [`SMALL`] at
/// the centre. Approximated by the best polynomial of this degree, with an error of at most 2.6e-4,
/// because polynomials vectorise more easily than exponentials.
#[inline(always)]
fn weight(square: Vec4) -> Vec4 {
    const BY: [f32; 4] = [
        SMALL * 0.305_360_4,
        SMALL * 0.382_570_4,
        SMALL * 0.018_251_8,
        SMALL * 0.293_558_3,
    ];
    let x = (Vec4::ONE - square).max(Vec4::ZERO);
    x * (BY[0] + x * (BY[1] + x * (BY[2] + x * BY[3])))
}

/// The ellipse that a sample covers, in image coordinates.
pub(crate) struct Ellipse {
    major: DVec2,
    minor: DVec2,
    /// Lengths of both half axes, in texels of the finest level.
    pub(crate) long: f64,
    pub(crate) short: f64,
}

impl Ellipse {
    /// The ellipse of a sample with these steps to its neighbours, on an image of this size, with
    /// an axis ratio of at most `most`. Not finite if a step is not.
    pub(crate) fn new(steps: [DVec2; 2], size: DVec2, most: f64) -> Self {
        let scale = size * RADIUS;
        let (s, t) = (steps[0] * scale, steps[1] * scale);
        // The axes of the quadratic form, by a Jacobi rotation of the sum of s s^T and t t^T.
        let (xx, xy, yy) = (
            s.x * s.x + t.x * t.x,
            s.x * s.y + t.x * t.y,
            s.y * s.y + t.y * t.y,
        );
        let (mean, half) = (0.5 * (xx + yy), 0.5 * (xx - yy));
        let root = (half * half + xy * xy).sqrt();
        let long = (mean + root).sqrt();
        // From the area, which is free of cancellation.
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

/// Size and wrap rules of a level.
#[derive(Clone, Copy)]
pub(crate) struct Grid {
    pub(crate) width: usize,
    pub(crate) height: usize,
    /// Rules of columns and of rows.
    pub(crate) wrap: [Wrap; 2],
}

/// Wrapped indices along a row or a column.
#[derive(Clone, Copy)]
struct Walk {
    wrap: Wrap,
    count: i32,
    /// The index that offsets are relative to.
    base: i32,
}

impl Walk {
    /// `middle` is an integer of any size.
    #[inline(always)]
    fn new(wrap: Wrap, count: usize, middle: f64) -> Self {
        let count = count as i32;
        let base = match wrap {
            // An integer within the range of the type, or NaN, which becomes 0.
            Wrap::Repeat => middle.rem_euclid(f64::from(count)) as i32,
            Wrap::Mirror => middle.rem_euclid(2.0 * f64::from(count)) as i32,
            // Far beyond the border, all texels are the border.
            Wrap::Clamp => middle.clamp(f64::from(i32::MIN / 2), f64::from(i32::MAX / 2)) as i32,
        };
        Self { wrap, count, base }
    }

    /// The wrapped index at an offset from the base.
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

    /// The index at `from`, if the range needs no wrapping.
    #[inline(always)]
    fn straight(&self, from: i32, to: i32) -> Option<usize> {
        let (from, to) = (self.base + from, self.base + to);
        (0 <= from && to < self.count).then_some(from as usize)
    }
}

/// The weighted mean of a level over an ellipse around a point. The fourth component of texels is
/// ignored.
pub(crate) fn elliptical(grid: Grid, texel: impl Fn(usize) -> Vec4, middle: DVec2, ellipse: &Ellipse) -> Rgb {
    // Dispatched because it rounds often, with an instruction that not every processor has.
    simd::dispatch(
        #[inline(always)]
        || mean(grid, texel, middle, ellipse),
    )
}

#[inline(always)]
fn mean(grid: Grid, texel: impl Fn(usize) -> Vec4, middle: DVec2, ellipse: &Ellipse) -> Rgb {
    let size = DVec2::new(grid.width as f64, grid.height as f64);
    let middle = middle * size - 0.5;
    // The half axes span at least one texel, so that some texels are inside and the mean is
    // continuous across texels.
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
    // Scans few long runs of texels instead of many short ones.
    let lying = major.x.abs() >= major.y.abs();
    let across = |v: DVec2| if lying { v } else { DVec2::new(v.y, v.x) };
    let quadratic = Quadratic::new(across(major), across(minor));
    if lying {
        quadratic.mean([right, down], [columns, rows], [1, grid.width], texel)
    } else {
        quadratic.mean([down, right], [rows, columns], [grid.width, 1], texel)
    }
}

/// An ellipse: `a p² + b p q + c q² < 1`.
struct Quadratic {
    a: f32,
    b: f32,
    c: f32,
    /// Extent along q.
    reach: f32,
}

impl Quadratic {
    /// Creates the ellipse with these conjugate half diameters.
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

    /// The weighted mean of all texels inside. The centre lies `start` beyond a texel; adjacent
    /// texels are `apart` entries away along p and q.
    #[inline(always)]
    fn mean(
        &self,
        [start_p, start_q]: [f32; 2],
        [along_p, along_q]: [Walk; 2],
        [apart_p, apart_q]: [usize; 2],
        texel: impl Fn(usize) -> Vec4,
    ) -> Rgb {
        let Self { a, b, c, reach } = *self;
        let (slope, half) = (-0.5 * b / a, (1.0 / a).sqrt());
        // All lines have the length of the longest, for predictable loops. Texels outside have
        // weight 0.
        let runs = (2.0 * half) as i32 / 4 + 1;
        // Two sums avoid a dependency chain.
        let (mut even, mut odd) = (Vec4::ZERO, Vec4::ZERO);
        let mut total = Vec4::ZERO;
        let (first, last) = ((start_q - reach).ceil() as i32, (start_q + reach).floor() as i32);
        for k in first..=last {
            let q = k as f32 - start_q;
            let (bq, cqq) = (b * q, c * q * q);
            let line = along_q.place(k) * apart_q;
            let mut i = (start_p + slope * q - half).ceil() as i32;
            for _ in 0..runs {
                let p = i as f32 - start_p + Vec4::new(0.0, 1.0, 2.0, 3.0);
                let weights = weight((a * p + bq) * p + cqq);
                total += weights;
                let at = match along_p.straight(i, i + 3) {
                    Some(first) => std::array::from_fn(|lane| line + (first + lane) * apart_p),
                    None => [0, 1, 2, 3].map(|lane| line + along_p.place(i + lane) * apart_p),
                };
                even += Vec4::splat(weights.x) * texel(at[0]);
                odd += Vec4::splat(weights.y) * texel(at[1]);
                even += Vec4::splat(weights.z) * texel(at[2]);
                odd += Vec4::splat(weights.w) * texel(at[3]);
                i += 4;
            }
        }
        let mean = (even + odd).as_dvec4() / f64::from(total.element_sum());
        Rgb::new(mean.x, mean.y, mean.z)
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
        assert_eq!(pyramid.0[2].texel(0), [32.0, 1.0, 0.0]);
        assert_eq!(pyramid.0[2].four()(0), Vec4::new(32.0, 1.0, 0.0, 0.0));
        assert!(Pyramid::new(1, 1, |_| [1.0; 3]).0.is_empty());
        // The documented memory of the largest common textures.
        assert_eq!(Pyramid::bytes(4096, 4096), 12 * ((4096 * 4096 - 1) / 3 + 12));
    }

    #[test]
    fn weights_are_those_of_a_gaussian() {
        let edge = (-2.0_f64).exp();
        for k in 0..=1000 {
            let square = f64::from(k) / 1000.0;
            let gaussian = ((-2.0 * square).exp() - edge) / (1.0 - edge);
            let found = f64::from(weight(Vec4::splat(square as f32)).x / SMALL);
            assert!(
                (found - gaussian).abs() < 2.7e-4,
                "{square}: {found} for {gaussian}"
            );
        }
        assert_eq!(weight(Vec4::new(1.0, 7.0, f32::INFINITY, f32::NAN)), Vec4::ZERO);
    }

    /// The weights have the variance that `RADIUS` assumes, that of a square sample.
    #[test]
    fn the_weights_have_the_variance_of_a_square() {
        let (mut sum, mut moment) = (0.0, 0.0);
        for k in 0..1000 {
            // Rings of equal area.
            let square = (f64::from(k) + 0.5) / 1000.0;
            let weight = f64::from(weight(Vec4::splat(square as f32)).x);
            sum += weight;
            moment += weight * 0.5 * square * RADIUS * RADIUS;
        }
        assert!((moment / sum - 1.0 / 12.0).abs() < 1e-5, "{}", moment / sum);
    }

    #[test]
    fn ellipses_have_the_axes_of_their_steps() {
        let size = DVec2::splat(100.0);
        let of = |s: [f64; 2], t: [f64; 2], most: f64| {
            let ellipse = Ellipse::new([s.into(), t.into()], size, most);
            (ellipse.long / RADIUS, ellipse.short / RADIUS, ellipse)
        };
        let (long, short, ellipse) = of([0.08, 0.0], [0.0, 0.02], 16.0);
        assert!((long - 8.0).abs() < 1e-12 && (short - 2.0).abs() < 1e-12);
        assert!(ellipse.major.y.abs() < 1e-15 && ellipse.minor.x.abs() < 1e-15);
        // The same ellipse, from other conjugate half diameters.
        let turn = DVec2::from_angle(0.6);
        let (s, t) = (
            DVec2::new(0.08 * turn.x, 0.02 * turn.y),
            DVec2::new(-0.08 * turn.y, 0.02 * turn.x),
        );
        let (long, short, _) = of(s.into(), t.into(), 16.0);
        assert!((long - 8.0).abs() < 1e-12 && (short - 2.0).abs() < 1e-12);
        // The ellipse is widened, never lengthened.
        let (long, short, _) = of([0.08, 0.0], [0.16, 0.0], 16.0);
        assert!((short - long / 16.0).abs() < 1e-12 && (long - 320f64.sqrt()).abs() < 1e-12);
    }

    /// Isolates each texel to measure its weight.
    #[test]
    fn weights_add_up_to_one() {
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
                let ellipse = Ellipse::new([s.into(), t.into()], DVec2::new(9.0, 6.0), 16.0);
                let share = |which: usize| {
                    let texel = |at: usize| Vec4::splat(f32::from(u8::from(at == which)));
                    elliptical(grid, texel, DVec2::new(0.77, -3.4), &ellipse).r
                };
                let sum: f64 = (0..9 * 6).map(share).sum();
                assert!((sum - 1.0).abs() < 1e-5, "{wrap:?}: {sum}");
            }
        }
    }

    /// The weighted mean in double precision, over all texels around the ellipse.
    fn naive(grid: Grid, texel: impl Fn(usize) -> f64, middle: DVec2, ellipse: &Ellipse) -> f64 {
        let size = DVec2::new(grid.width as f64, grid.height as f64);
        let middle = middle * size - 0.5;
        let wide = |axis: DVec2| axis * size * (1.0 / (axis * size).length()).max(1.0);
        let (major, minor) = (wide(ellipse.major), wide(ellipse.minor));
        let (mut sum, mut total) = (0.0, 0.0);
        let reach = major.length().ceil() as i32 + 2;
        for j in -reach..=reach {
            for i in -reach..=reach {
                let at = middle.floor() + DVec2::new(f64::from(i), f64::from(j));
                let from = at - middle;
                let parts = DVec2::new(from.perp_dot(minor), -from.perp_dot(major)) / major.perp_dot(minor);
                if parts.length_squared() < 1.0 {
                    let weight = f64::from(weight(Vec4::splat(parts.length_squared() as f32)).x);
                    let [columns, rows] = grid.wrap;
                    let (column, row) = (columns.index(at.x, grid.width), rows.index(at.y, grid.height));
                    sum += weight * texel(row * grid.width + column);
                    total += weight;
                }
            }
        }
        sum / total
    }

    #[test]
    fn means_are_those_over_the_ellipse() {
        let words = [Wrap::Repeat, Wrap::Mirror, Wrap::Clamp];
        let hash = |at: usize| (whitstone_core::hash::mix(at as u32) >> 8) as f32 / 16_777_216.0;
        for (number, (s, t)) in [
            ([0.3, 0.1], [-0.05, 0.2]),
            ([0.02, 0.5], [0.03, 0.01]),
            ([0.4, 0.4], [0.4, 0.39]),
            ([0.05, 0.0], [0.0, 0.1]),
            ([0.9, -0.3], [0.2, 0.7]),
        ]
        .into_iter()
        .enumerate()
        {
            for (columns, rows) in words.iter().flat_map(|a| words.map(|b| (*a, b))) {
                let grid = Grid {
                    width: 13,
                    height: 7,
                    wrap: [columns, rows],
                };
                let ellipse = Ellipse::new([s.into(), t.into()], DVec2::new(13.0, 7.0), 16.0);
                for k in 0..20 {
                    let middle = DVec2::new(0.618, -0.755) * f64::from(k) + 0.1;
                    let found = elliptical(grid, |at| Vec4::splat(hash(at)), middle, &ellipse).g;
                    let expected = naive(grid, |at| f64::from(hash(at)), middle, &ellipse);
                    assert!(
                        (found - expected).abs() < 1e-4,
                        "{number} {columns:?} {rows:?} {k}: {found}, not {expected}"
                    );
                }
            }
        }
    }

    #[test]
    fn means_of_the_largest_texels_are_numbers() {
        let grid = Grid {
            width: 64,
            height: 64,
            wrap: [Wrap::Repeat; 2],
        };
        let ellipse = Ellipse::new([[0.9, 0.3].into(), [-0.3, 0.9].into()], DVec2::splat(64.0), 64.0);
        let mean = elliptical(grid, |_| Vec4::splat(f32::MAX), DVec2::splat(0.3), &ellipse);
        assert!((mean.r / f64::from(f32::MAX) - 1.0).abs() < 1e-5, "{mean:?}");
    }
}
