//! Vectors, lines and affine maps of intervals.

use crate::interval::{Decided, Interval, Undecided};
use whitstone_core::{DAffine3, DVec3, Ray};

/// A point or a direction.
#[derive(Clone, Debug)]
pub(crate) struct Vector(pub(crate) [Interval; 3]);

impl Vector {
    /// Exactly these numbers.
    pub(crate) fn new(v: [f64; 3], bits: usize) -> Self {
        Self(v.map(|x| Interval::new(x, bits)))
    }

    pub(crate) fn dot(&self, other: &Self) -> Interval {
        let [a, b, c] = [0, 1, 2].map(|i| &self.0[i] * &other.0[i]);
        a + b + c
    }

    pub(crate) fn cross(&self, other: &Self) -> Self {
        Self([0, 1, 2].map(|i| {
            let (j, k) = ((i + 1) % 3, (i + 2) % 3);
            &self.0[j] * &other.0[k] - &self.0[k] * &other.0[j]
        }))
    }

    pub(crate) fn plus(&self, other: &Self) -> Self {
        Self([0, 1, 2].map(|i| &self.0[i] + &other.0[i]))
    }

    pub(crate) fn minus(&self, other: &Self) -> Self {
        Self([0, 1, 2].map(|i| &self.0[i] - &other.0[i]))
    }

    pub(crate) fn times(&self, factor: &Interval) -> Self {
        Self([0, 1, 2].map(|i| &self.0[i] * factor))
    }

    /// The nearest vector of doubles.
    pub(crate) fn nearest(&self) -> DVec3 {
        DVec3::from_array([0, 1, 2].map(|i| self.0[i].nearest()))
    }
}

/// All points `origin + t direction`.
#[derive(Clone, Debug)]
pub(crate) struct Line {
    pub(crate) origin: Vector,
    pub(crate) direction: Vector,
}

impl Line {
    /// The line of a ray, whose doubles are taken as exact. It is undecided where a ray with a
    /// coordinate that is not finite goes.
    pub(crate) fn of(ray: &Ray, bits: usize) -> Decided<Self> {
        if !(ray.origin.is_finite() && ray.direction.is_finite()) {
            return Err(Undecided);
        }
        Ok(Self {
            origin: Vector::new(ray.origin.to_array(), bits),
            direction: Vector::new(ray.direction.to_array(), bits),
        })
    }

    pub(crate) fn bits(&self) -> usize {
        self.origin.0[0].bits()
    }

    /// Exactly this number, with the precision of the line.
    pub(crate) fn number(&self, x: f64) -> Interval {
        Interval::new(x, self.bits())
    }

    /// Exactly this point, with the precision of the line.
    pub(crate) fn point(&self, p: [f64; 3]) -> Vector {
        Vector::new(p, self.bits())
    }

    pub(crate) fn at(&self, t: &Interval) -> Vector {
        self.origin.plus(&self.direction.times(t))
    }

    /// One coordinate of the point at `t`.
    pub(crate) fn coordinate(&self, axis: usize, t: &Interval) -> Interval {
        &self.origin.0[axis] + &self.direction.0[axis] * t
    }

    /// The same line in the space that this map leads from.
    pub(crate) fn inside(&self, map: &DAffine3) -> Decided<Self> {
        if *map == DAffine3::IDENTITY {
            return Ok(self.clone());
        }
        let [x, y, z] = [0, 1, 2].map(|column| self.point(map.matrix3.col(column).to_array()));
        // The rows of the inverse are cross products of the columns, divided by the determinant.
        let rows = [y.cross(&z), z.cross(&x), x.cross(&y)];
        let determinant = x.dot(&rows[0]);
        let moved = self.origin.minus(&self.point(map.translation.to_array()));
        let seen = |v: &Vector| -> Decided<Vector> {
            let [a, b, c] = [0, 1, 2].map(|i| rows[i].dot(v).over(&determinant));
            Ok(Vector([a?, b?, c?]))
        };
        Ok(Self {
            origin: seen(&moved)?,
            direction: seen(&self.direction)?,
        })
    }
}

/// The unit vector and the length of a finite vector other than zero. Squares do not overflow.
pub(crate) fn unit_and_length(v: DVec3) -> (DVec3, f64) {
    // A power of two, so that the division is exact.
    let scale = v.abs().max_element().log2().floor().exp2();
    let scaled = v / scale;
    let length = scaled.length();
    (scaled / length, scale * length)
}
