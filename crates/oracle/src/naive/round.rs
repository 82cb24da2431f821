//! Spheres and tori.

use super::quartic::quartic;
use super::{Real, Roots, Textbook, Vector, dot, first_positive, minus, vector};

/// The textbook quadratic formula: Glassner (ed.) 1989, ch. 2, 2.1.
pub(super) struct Sphere<R> {
    center: Vector<R>,
    radius: R,
}

impl<R: Real> Sphere<R> {
    pub(super) fn new(center: [f64; 3], radius: f64) -> Self {
        Self {
            center: vector(center),
            radius: R::of(radius),
        }
    }

    #[inline]
    fn both(&self, o: Vector<R>, d: Vector<R>) -> Option<[R; 2]> {
        let l = minus(o, self.center);
        let a = dot(d, d);
        let b = R::of(2.0) * dot(l, d);
        let c = dot(l, l) - self.radius * self.radius;
        let discriminant = b * b - R::of(4.0) * a * c;
        if discriminant < R::of(0.0) {
            return None;
        }
        let (root, twice) = (discriminant.sqrt(), R::of(2.0) * a);
        Some([(-b - root) / twice, (-b + root) / twice])
    }
}

impl<R: Real> Textbook<R> for Sphere<R> {
    fn intersect(&self, o: Vector<R>, d: Vector<R>) -> Option<R> {
        let [first, second] = self.both(o, d)?;
        first_positive(first, second)
    }

    fn roots(&self, o: Vector<R>, d: Vector<R>) -> Roots<R> {
        self.both(o, d).into_iter().flatten().collect()
    }
}

/// A quartic polynomial, solved in closed form: Glassner (ed.) 1989, ch. 3, 5.
pub(super) struct Torus<R> {
    major: R,
    minor: R,
}

impl<R: Real> Torus<R> {
    pub(super) fn new(major: f64, minor: f64) -> Self {
        Self {
            major: R::of(major),
            minor: R::of(minor),
        }
    }
}

impl<R: Real> Textbook<R> for Torus<R> {
    fn intersect(&self, o: Vector<R>, d: Vector<R>) -> Option<R> {
        self.roots(o, d).into_iter().find(|t| *t > R::of(0.0))
    }

    fn roots(&self, o: Vector<R>, d: Vector<R>) -> Roots<R> {
        let (two, four) = (R::of(2.0), R::of(4.0));
        let (a, b, c) = (dot(d, d), dot(o, d), dot(o, o));
        let around = four * self.major * self.major;
        let k = c + self.major * self.major - self.minor * self.minor;
        let flat = |p: Vector<R>, q: Vector<R>| p[0] * q[0] + p[1] * q[1];
        quartic([
            k * k - around * flat(o, o),
            four * k * b - two * around * flat(o, d),
            two * a * k + four * b * b - around * flat(d, d),
            four * a * b,
            a * a,
        ])
    }
}
