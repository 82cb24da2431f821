//! Control nets of bicubic Bezier surfaces: values, derivatives and subdivision by de Casteljau's
//! algorithm.
//!
//! Farin, *Curves and Surfaces for CAGD* (5th ed.), chapters 4 (curves), 3.3 (blossoms) and 14
//! (surfaces).

use std::ops::{Add, Mul, Sub};

/// A point or a vector, in space or projected along a ray.
pub(super) trait Point:
    Copy + Add<Output = Self> + Sub<Output = Self> + Mul<f64, Output = Self>
{
}

impl<T: Copy + Add<Output = T> + Sub<Output = T> + Mul<f64, Output = T>> Point for T {}

/// Four rows of four control points along u, in order of v.
#[derive(Clone, Copy, Debug)]
pub(super) struct Net<T>(pub(super) [T; 16]);

/// A parameter direction on a surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Way {
    U,
    V,
}

/// A point of a surface with its first derivatives.
#[derive(Clone, Copy, Debug)]
pub(super) struct Jet<T> {
    pub(super) p: T,
    pub(super) u: T,
    pub(super) v: T,
}

fn between<T: Point>(a: T, b: T, t: f64) -> T {
    a + (b - a) * t
}

/// Value and derivative of a cubic.
fn cubic<T: Point>([a, b, c, d]: [T; 4], t: f64) -> (T, T) {
    let (ab, bc, cd) = (between(a, b, t), between(b, c, t), between(c, d, t));
    let (abc, bcd) = (between(ab, bc, t), between(bc, cd, t));
    (between(abc, bcd, t), (bcd - abc) * 3.0)
}

/// Second derivative of a cubic.
fn bend<T: Point>([a, b, c, d]: [T; 4], t: f64) -> T {
    between((c - b) - (b - a), (d - c) - (c - b), t) * 6.0
}

/// The control points of a cubic between two parameters, as values of its blossom.
fn part<T: Point>([a, b, c, d]: [T; 4], low: f64, high: f64) -> [T; 4] {
    let at = |t: f64| [between(a, b, t), between(b, c, t), between(c, d, t)];
    let (l, h) = (at(low), at(high));
    let next = |p: [T; 3], t: f64| [between(p[0], p[1], t), between(p[1], p[2], t)];
    let (ll, lh, hh) = (next(l, low), next(l, high), next(h, high));
    [
        between(ll[0], ll[1], low),
        between(ll[0], ll[1], high),
        between(lh[0], lh[1], high),
        between(hh[0], hh[1], high),
    ]
}

impl<T: Point> Net<T> {
    pub(super) fn map<S>(&self, f: impl FnMut(T) -> S) -> Net<S> {
        Net(self.0.map(f))
    }

    /// The four control points of line `k` along a parameter direction.
    pub(super) fn line(&self, way: Way, k: usize) -> [T; 4] {
        match way {
            Way::U => [0, 1, 2, 3].map(|j| self.0[4 * k + j]),
            Way::V => [0, 1, 2, 3].map(|i| self.0[4 * i + k]),
        }
    }

    /// Point and first derivatives. A derivative is exactly zero if the control points that
    /// determine it are equal.
    pub(super) fn at(&self, u: f64, v: f64) -> Jet<T> {
        let rows = [0, 1, 2, 3].map(|i| cubic(self.line(Way::U, i), u));
        let (p, along_v) = cubic(rows.map(|row| row.0), v);
        let (along_u, _) = cubic(rows.map(|row| row.1), v);
        Jet {
            p,
            u: along_u,
            v: along_v,
        }
    }

    /// Second derivatives: P_uu, P_uv and P_vv.
    pub(super) fn bends(&self, u: f64, v: f64) -> [T; 3] {
        let rows = [0, 1, 2, 3].map(|i| self.line(Way::U, i));
        let (twice_u, _) = cubic(rows.map(|row| bend(row, u)), v);
        let (_, mixed) = cubic(rows.map(|row| cubic(row, u).1), v);
        let twice_v = bend(rows.map(|row| cubic(row, u).0), v);
        [twice_u, mixed, twice_v]
    }

    /// The part between two parameters.
    pub(super) fn part(&self, way: Way, low: f64, high: f64) -> Self {
        let lines = [0, 1, 2, 3].map(|k| part(self.line(way, k), low, high));
        let mut parts = *self;
        for k in 0..4 {
            for j in 0..4 {
                match way {
                    Way::U => parts.0[4 * k + j] = lines[k][j],
                    Way::V => parts.0[4 * j + k] = lines[k][j],
                }
            }
        }
        parts
    }

    /// The length of the longest control polygon in a direction, measured by `length`.
    pub(super) fn longest(&self, way: Way, length: impl Fn(T) -> f64) -> f64 {
        let polygon = |k: usize| {
            let line = self.line(way, k);
            line.windows(2).map(|pair| length(pair[1] - pair[0])).sum::<f64>()
        };
        (0..4).map(polygon).fold(0.0, f64::max)
    }

    /// The largest second difference in a direction: the deviation of the lines from straight and
    /// evenly spaced.
    pub(super) fn unevenness(&self, way: Way, length: impl Fn(T) -> f64) -> f64 {
        let line = |k: usize| {
            let [a, b, c, d] = self.line(way, k);
            length((c - b) - (b - a)).max(length((d - c) - (c - b)))
        };
        (0..4).map(line).fold(0.0, f64::max)
    }
}
