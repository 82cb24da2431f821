//! The common part of all quadrics: the zero set of a function of second degree, clipped by
//! axis-aligned planes.

use crate::interval::{Decided, Interval, Undecided};
use crate::quadratic;
use crate::root::{Root, Roots};
use crate::vector::{Line, Vector};
use std::cmp::Ordering;
use whitstone_core::DVec3;

/// The clipping planes of a quadric, and whether caps close it there.
pub(super) struct Cut {
    /// Lower and upper clipping plane of each axis.
    pub(super) slabs: [Option<[f64; 2]>; 3],
    pub(super) caps: bool,
    /// The axis whose lower cap has primitive number 1.
    pub(super) first_axis: usize,
}

/// `f = sum of square_i p_i² + xy p_x p_y + xz p_x p_z + yz p_y p_z + sum of linear_i p_i +
/// constant`. The inside is where f is at most zero.
pub(super) struct Conic {
    pub(super) square: Vector,
    /// Coefficients of xy, xz, yz.
    pub(super) mixed: Vector,
    pub(super) linear: Vector,
    pub(super) constant: Interval,
}

impl Conic {
    /// A quadric without mixed terms.
    pub(super) fn straight(square: [Interval; 3], linear_z: Interval, constant: Interval) -> Self {
        let zero = constant.like(0.0);
        let zeros = Vector([zero.clone(), zero.clone(), zero.clone()]);
        Self {
            square: Vector(square),
            linear: Vector([zero.clone(), zero, linear_z]),
            mixed: zeros,
            constant,
        }
    }

    /// The gradient of the second-degree terms at `u`.
    fn twice(&self, u: &Vector) -> Vector {
        let ([x, y, z], [xy, xz, yz]) = (&u.0, &self.mixed.0);
        let [a, b, c] = [0, 1, 2].map(|i| &self.square.0[i] * &u.0[i]);
        Vector([
            &a + &a + xy * y + xz * z,
            &b + &b + xy * x + yz * z,
            &c + &c + xz * x + yz * y,
        ])
    }

    /// Twice the value of the function.
    fn twice_at(&self, p: &Vector) -> Interval {
        let rest = self.linear.dot(p) + &self.constant;
        self.twice(p).dot(p) + &rest + &rest
    }

    /// Intersects the line with the clipped surface and its caps. `moves` gives the change of the
    /// function at a point for a relative change of one of its own numbers.
    pub(super) fn meet(&self, line: &Line, cut: &Cut, moves: impl Fn(DVec3) -> f64) -> Decided<Roots> {
        let (o, d) = (&line.origin, &line.direction);
        let a = self.twice(d).dot(d);
        let b = self.twice(o).dot(d) + self.linear.dot(d);
        let mut all = Vec::new();
        for (t, slope) in quadratic::roots(&a, &b, &self.twice_at(o))? {
            let p = line.at(&t);
            if cut.holds(&p, None)? {
                let normal = self.twice(&p).plus(&self.linear).nearest();
                let change = moves(p.nearest());
                all.push(Root::new(t, 0, &slope, normal, change)?);
            }
        }
        if cut.caps {
            for axis in 0..3 {
                for (height, side) in cut.slabs[axis].into_iter().flatten().zip([-1.0, 1.0]) {
                    all.extend(self.cap(line, cut, axis, height, side)?);
                }
            }
        }
        Ok(Roots::new(all))
    }

    /// Intersects the line with the cap at `height` across an axis.
    fn cap(&self, line: &Line, cut: &Cut, axis: usize, height: f64, side: f64) -> Decided<Option<Root>> {
        let (o, d) = (&line.origin.0[axis], &line.direction.0[axis]);
        let above = line.number(height) - o;
        if d.sign()? == Ordering::Equal {
            return match above.sign()? {
                // The line lies in the plane of the cap.
                Ordering::Equal => Err(Undecided),
                _ => Ok(None),
            };
        }
        let t = above.over(d)?;
        let mut p = line.at(&t);
        p.0[axis] = line.number(height);
        if !cut.holds(&p, Some(axis))? || self.twice_at(&p).is_positive()? {
            return Ok(None);
        }
        let face = 1 + 2 * (axis - cut.first_axis) as u32 + u32::from(side > 0.0);
        let along = d * line.number(side);
        Root::new(t, face, &along, side * DVec3::AXES[axis], height.abs()).map(Some)
    }
}

impl Cut {
    /// No clipping.
    pub(super) const NONE: Self = Self {
        slabs: [None; 3],
        caps: false,
        first_axis: 0,
    };

    /// Clipping between two heights in z.
    pub(super) fn between(z: [f64; 2], caps: bool) -> Self {
        Self {
            slabs: [None, None, Some(z)],
            caps,
            first_axis: 2,
        }
    }

    /// Whether a point lies between the clipping planes. `but` is the axis to skip, because the
    /// point lies on a cap across it.
    fn holds(&self, p: &Vector, but: Option<usize>) -> Decided<bool> {
        for (axis, slab) in self.slabs.iter().enumerate() {
            let Some([low, high]) = slab.filter(|_| but != Some(axis)) else {
                continue;
            };
            let x = &p.0[axis];
            if (x.like(low) - x).is_positive()? || (x - x.like(high)).is_positive()? {
                return Ok(false);
            }
        }
        Ok(true)
    }
}
