//! Bicubic patches by Newton's method from nine starting points. Toth, *On ray tracing parametric
//! surfaces*, SIGGRAPH 1985, without its proof of convergence.

use super::{Real, Textbook, Vector, cross, dot, minus, vector};

/// Newton steps from each starting point.
const STEPS: usize = 8;

/// Largest residual of a root, relative to the length of the direction.
const NEAR: f64 = 1e-5;

pub(super) struct Patches<R>(Vec<[Vector<R>; 16]>);

impl<R: Real> Patches<R> {
    pub(super) fn new(nets: &[[[f64; 3]; 16]]) -> Self {
        Self(nets.iter().map(|net| net.map(vector)).collect())
    }
}

/// The point and both partial derivatives.
#[inline]
fn surface<R: Real>(net: &[Vector<R>; 16], u: R, v: R) -> [Vector<R>; 3] {
    let basis = |t: R| {
        let (one, two, three) = (R::of(1.0), R::of(2.0), R::of(3.0));
        let s = one - t;
        let values = [s * s * s, three * s * s * t, three * s * t * t, t * t * t];
        let slopes = [
            -three * s * s,
            three * s * (s - two * t),
            three * t * (two * s - t),
            three * t * t,
        ];
        (values, slopes)
    };
    let ((bu, du), (bv, dv)) = (basis(u), basis(v));
    let mut sums = [[R::of(0.0); 3]; 3];
    for (k, p) in net.iter().enumerate() {
        let (i, j) = (k / 4, k % 4);
        for (sum, weight) in sums.iter_mut().zip([bv[i] * bu[j], bv[i] * du[j], dv[i] * bu[j]]) {
            for axis in 0..3 {
                sum[axis] = sum[axis] + weight * p[axis];
            }
        }
    }
    sums
}

impl<R: Real> Textbook<R> for Patches<R> {
    fn intersect(&self, o: Vector<R>, d: Vector<R>) -> Option<R> {
        let (zero, one) = (R::of(0.0), R::of(1.0));
        let starts = [0.2, 0.5, 0.8];
        let mut best: Option<R> = None;
        for net in &self.0 {
            for start in starts.iter().flat_map(|u| starts.iter().map(move |v| (*u, *v))) {
                let (mut u, mut v) = (R::of(start.0), R::of(start.1));
                for _ in 0..STEPS {
                    // P + s P_u + w P_v = o + t d.
                    let [p, pu, pv] = surface(net, u, v);
                    let residual = minus(o, p);
                    let determinant = dot(d, cross(pu, pv));
                    u = u + dot(residual, cross(pv, d)) / determinant;
                    v = v + dot(residual, cross(d, pu)) / determinant;
                }
                let [p, ..] = surface(net, u, v);
                let t = dot(minus(p, o), d) / dot(d, d);
                let off = minus(p, super::at(o, d, t));
                let inside = u >= zero && u <= one && v >= zero && v <= one;
                if inside
                    && t > zero
                    && dot(off, off) < R::of(NEAR * NEAR)
                    && best.is_none_or(|best| t < best)
                {
                    best = Some(t);
                }
            }
        }
        best
    }
}
