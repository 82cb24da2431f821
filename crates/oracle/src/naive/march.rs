//! Level sets by ray marching: constant steps along the ray until the sign changes, then bisection.
//!
//! Hart, Sandin and Kauffman 1989, *Ray tracing deterministic 3-D fractals*, name it as the
//! method that is used if nothing better is known. Features thinner than a step are missed.

use super::{Real, Textbook, Vector, at, dot};
use crate::shapes::level::{Jet, Level, LevelSet, Number};
use std::cmp::Ordering;

/// Number of steps over the part of the ray inside a ball around the surface.
const STEPS: u32 = 256;
const BISECTIONS: u32 = 40;

pub(super) struct March<L>(pub(super) LevelSet<L>);

/// A plain number instead of an interval, as if it were exact.
#[derive(Clone, Copy)]
struct Plain<R>(R);

impl<R: Real> Number for Plain<R> {
    fn like(&self, x: f64) -> Self {
        Self(R::of(x))
    }
    fn plus(&self, other: &Self) -> Self {
        Self(self.0 + other.0)
    }
    fn times(&self, other: &Self) -> Self {
        Self(self.0 * other.0)
    }
    fn negated(&self) -> Self {
        Self(-self.0)
    }
    fn squared(&self) -> Self {
        Self(self.0 * self.0)
    }
    fn abs(&self) -> Self {
        Self(self.0.abs())
    }
    fn min(&self, other: &Self) -> Self {
        match self.0.partial_cmp(&other.0) {
            Some(Ordering::Greater) => *other,
            _ => *self,
        }
    }
    fn hull(&self, _other: &Self) -> Self {
        *self
    }
    fn divided(&self, other: &Self) -> Option<Self> {
        Some(Self(self.0 / other.0))
    }
    fn root(&self) -> Self {
        Self(self.0.sqrt())
    }
    fn has_zero(&self) -> bool {
        false
    }
    fn is_above(&self) -> bool {
        self.0 > R::of(0.0)
    }
    fn ends(&self) -> [f64; 2] {
        [self.0.to_f64(); 2]
    }
    fn turn(&self) -> [Self; 2] {
        let angle = self.radians().0;
        [angle, angle - R::of(std::f64::consts::FRAC_PI_2)].map(|x| Self(x.cos()))
    }
    fn radians(&self) -> Self {
        Self(self.0 * R::of(std::f64::consts::PI / 180.0))
    }
}

impl<L: Level> March<L> {
    /// Whether the function is negative at `p` and `p` lies in the bounding box.
    fn inside<R: Real>(&self, p: Vector<R>) -> bool {
        let (bounds, _) = self.0.0.bounds();
        let beyond = |[min, max]: [whitstone_core::DVec3; 2]| {
            (0..3).any(|axis| p[axis] < R::of(min[axis]) || p[axis] > R::of(max[axis]))
        };
        let jet = |x| Jet {
            value: Plain(x),
            slope: None,
            moves: 0.0,
        };
        !bounds.is_some_and(beyond) && self.0.0.at(&p.map(jet)).value.0 < R::of(0.0)
    }
}

impl<R: Real, L: Level> Textbook<R> for March<L> {
    fn intersect(&self, o: Vector<R>, d: Vector<R>) -> Option<R> {
        let reach = R::of(self.0.reach()?);
        let square = dot(d, d);
        let middle = -dot(o, d) / square;
        let half = reach / square.sqrt();
        let step = (half + half) / R::of(f64::from(STEPS));
        let zero = R::of(0.0);
        let start = if middle - half > zero { middle - half } else { zero };
        let was = self.inside(at(o, d, start));
        let mut before = start;
        while before < middle + half {
            let next = before + step;
            if self.inside(at(o, d, next)) != was {
                let (mut a, mut b) = (before, next);
                for _ in 0..BISECTIONS {
                    let t = (a + b) * R::of(0.5);
                    if self.inside(at(o, d, t)) == was {
                        a = t;
                    } else {
                        b = t;
                    }
                }
                return Some(b);
            }
            before = next;
        }
        None
    }
}
