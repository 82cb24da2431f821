//! Quadrics by the textbook quadratic formula for `f(o + t d) = 0`, with clipping planes. Glassner
//! (ed.) 1989, ch. 2, 5.

use super::{Real, Roots, Textbook, Vector, at};
use crate::shapes::cone::Cone;
use crate::shapes::cylinder::Cylinder;
use crate::shapes::ellipsoid::Ellipsoid;
use crate::shapes::hyperboloid::Hyperboloid;
use crate::shapes::paraboloid::Paraboloid;
use crate::shapes::quadric::Quadric;

/// Coefficients of x², y², z², xy, xz, yz, x, y, z and 1.
pub(super) struct Conic<R> {
    coefficients: [R; 10],
    /// Lower and upper clipping plane of each axis.
    slabs: [Option<[R; 2]>; 3],
    caps: bool,
}

impl<R: Real> Conic<R> {
    fn new(coefficients: [f64; 10], slabs: [Option<[f64; 2]>; 3], caps: bool) -> Self {
        Self {
            coefficients: coefficients.map(R::of),
            slabs: slabs.map(|slab| slab.map(|ends| ends.map(R::of))),
            caps,
        }
    }

    fn round(z2: f64, z: f64, constant: f64, heights: [f64; 2], caps: bool) -> Self {
        let coefficients = [1.0, 1.0, z2, 0.0, 0.0, 0.0, 0.0, 0.0, z, constant];
        Self::new(coefficients, [None, None, Some(heights)], caps)
    }

    pub(super) fn ellipsoid(shape: &Ellipsoid) -> Self {
        let [a, b, c] = shape.radii.map(|radius| 1.0 / (radius * radius));
        Self::new([a, b, c, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, -1.0], [None; 3], false)
    }

    pub(super) fn cylinder(shape: &Cylinder) -> Self {
        Self::round(0.0, 0.0, -shape.radius * shape.radius, shape.z, shape.caps)
    }

    pub(super) fn cone(shape: &Cone) -> Self {
        let ([r0, r1], [z0, z1]) = (shape.radii, shape.z);
        let slope = (r1 - r0) / (z1 - z0);
        let rest = r0 - slope * z0;
        Self::round(
            -slope * slope,
            -2.0 * slope * rest,
            -rest * rest,
            shape.z,
            shape.caps,
        )
    }

    pub(super) fn paraboloid(shape: &Paraboloid) -> Self {
        Self::round(0.0, -shape.radius * shape.radius, 0.0, shape.z, shape.caps)
    }

    pub(super) fn hyperboloid(shape: &Hyperboloid) -> Self {
        let constant = -shape.radius * shape.radius;
        Self::round(-shape.slope * shape.slope, 0.0, constant, shape.z, shape.caps)
    }

    pub(super) fn quadric(shape: &Quadric) -> Self {
        let [min, max] = shape.r#box;
        let slabs = [0, 1, 2].map(|axis| Some([min[axis], max[axis]]));
        Self::new(shape.coefficients(), slabs, shape.caps)
    }

    #[inline]
    fn value(&self, p: Vector<R>) -> R {
        let [a, b, c, d, e, f, g, h, i, j] = self.coefficients;
        let [x, y, z] = p;
        a * x * x + b * y * y + c * z * z + d * x * y + e * x * z + f * y * z + g * x + h * y + i * z + j
    }

    #[inline]
    fn holds(&self, p: Vector<R>, but: usize) -> bool {
        let within = |axis: usize| {
            let slab = self.slabs[axis].filter(|_| axis != but);
            slab.is_none_or(|[low, high]| p[axis] >= low && p[axis] <= high)
        };
        within(0) && within(1) && within(2)
    }

    /// Calls `found` with every root, in no order.
    #[inline]
    fn each(&self, o: Vector<R>, d: Vector<R>, mut found: impl FnMut(R)) {
        let [a, b, c, xy, xz, yz, g, h, i, _] = self.coefficients;
        let two = R::of(2.0);
        let square = a * d[0] * d[0]
            + b * d[1] * d[1]
            + c * d[2] * d[2]
            + xy * d[0] * d[1]
            + xz * d[0] * d[2]
            + yz * d[1] * d[2];
        let linear = two * (a * o[0] * d[0] + b * o[1] * d[1] + c * o[2] * d[2])
            + xy * (o[0] * d[1] + o[1] * d[0])
            + xz * (o[0] * d[2] + o[2] * d[0])
            + yz * (o[1] * d[2] + o[2] * d[1])
            + g * d[0]
            + h * d[1]
            + i * d[2];
        let discriminant = linear * linear - R::of(4.0) * square * self.value(o);
        if discriminant >= R::of(0.0) {
            let root = discriminant.sqrt();
            for t in [
                (-linear - root) / (two * square),
                (-linear + root) / (two * square),
            ] {
                if self.holds(at(o, d, t), 3) {
                    found(t);
                }
            }
        }
        if self.caps {
            for axis in 0..3 {
                for height in self.slabs[axis].into_iter().flatten() {
                    let t = (height - o[axis]) / d[axis];
                    let p = at(o, d, t);
                    if self.holds(p, axis) && self.value(p) <= R::of(0.0) {
                        found(t);
                    }
                }
            }
        }
    }
}

impl<R: Real> Textbook<R> for Conic<R> {
    fn intersect(&self, o: Vector<R>, d: Vector<R>) -> Option<R> {
        let mut best: Option<R> = None;
        self.each(o, d, |t| {
            if t > R::of(0.0) && best.is_none_or(|best| t < best) {
                best = Some(t);
            }
        });
        best
    }

    fn roots(&self, o: Vector<R>, d: Vector<R>) -> Roots<R> {
        let mut roots = Roots::new();
        self.each(o, d, |t| roots.push(t));
        roots.sort_by(|a, b| a.partial_cmp(b).unwrap_or(std::cmp::Ordering::Equal));
        roots
    }
}
