//! The density along a ray in one cell, a cubic.

use crate::support::crossings::{Along, RootCount, refine};
use std::ops::ControlFlow;
use whitstone_core::DVec3;

/// Linear interpolation, exact at both ends.
#[inline]
pub(super) fn lerp(a: f64, b: f64, t: f64) -> f64 {
    (1.0 - t) * a + t * b
}

/// Interpolates along x, then y, then z, so that both cells at a face compute the same value on it.
#[inline]
pub(super) fn trilinear(c: &[f64; 8], p: DVec3) -> f64 {
    let [a, b] = [0, 4].map(|k| lerp(lerp(c[k], c[k + 1], p.x), lerp(c[k + 2], c[k + 3], p.x), p.y));
    lerp(a, b, p.z)
}

/// The Bernstein coefficients of the density along a segment within a cell.
pub(super) struct Cubic(pub(super) [f64; 4]);

impl Cubic {
    pub(super) fn new(corners: &[f64; 8], from: DVec3, to: DVec3) -> Self {
        let at = |x: DVec3, y: DVec3, z: DVec3| trilinear(corners, DVec3::new(x.x, y.y, z.z));
        Self([
            at(from, from, from),
            (at(to, from, from) + at(from, to, from) + at(from, from, to)) / 3.0,
            (at(from, to, to) + at(to, from, to) + at(to, to, from)) / 3.0,
            at(to, to, to),
        ])
    }

    /// Visits the sign changes in order.
    pub(super) fn crossings(&self, visit: &mut impl FnMut(f64, bool) -> ControlFlow<()>) -> ControlFlow<()> {
        // The cubic lies in the range of its coefficients.
        let negative = self.0.iter().filter(|value| **value < 0.0).count();
        if negative == 0 || negative == 4 {
            return ControlFlow::Continue(());
        }
        let mut lo = 0.0;
        for hi in self.extrema().into_iter().chain([1.0]) {
            if hi <= lo {
                continue;
            }
            let (before, after) = (self.at(lo).0 < 0.0, self.at(hi).0 < 0.0);
            if before != after {
                visit(refine(self, lo, hi, after), after)?;
            }
            lo = hi;
        }
        ControlFlow::Continue(())
    }

    /// The extrema in order; those outside (0, 1) are returned as 0.
    fn extrema(&self) -> [f64; 2] {
        let [p, q, r] = [0, 1, 2].map(|i| self.0[i + 1] - self.0[i]);
        // a s² + 2 b s + p
        let (a, b) = (p - 2.0 * q + r, q - p);
        let discriminant = b * b - a * p;
        if discriminant.is_nan() || discriminant <= 0.0 {
            return [0.0; 2];
        }
        let sum = -(b + discriminant.sqrt().copysign(b));
        let within = |s: f64| if s > 0.0 && s < 1.0 { s } else { 0.0 };
        let (one, other) = (within(sum / a), within(p / sum));
        [one.min(other), one.max(other)]
    }
}

impl Along for Cubic {
    /// De Casteljau's algorithm, exact at both ends.
    fn at(&self, s: f64) -> (f64, f64) {
        let [a, b, c, d] = self.0;
        let [e, f, g] = [lerp(a, b, s), lerp(b, c, s), lerp(c, d, s)];
        let [h, i] = [lerp(e, f, s), lerp(f, g, s)];
        (lerp(h, i, s), 3.0 * (i - h))
    }

    fn over(&self, _: f64, _: f64) -> RootCount {
        RootCount::AtMostOne
    }

    fn limit_reached(&self, _: f64) {}
}
