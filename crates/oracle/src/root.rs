//! Intersections of a line with a surface, and their condition numbers.

use crate::interval::{Decided, Interval, Undecided};
use crate::vector::Line;
use std::cmp::Ordering;
use whitstone_core::{DAffine3, DVec3};

/// A point where a line meets a surface.
#[derive(Clone, Debug)]
pub struct Root {
    /// The ray parameter.
    pub t: Interval,
    /// Number of the primitive; at an edge, of any of the primitives that share it.
    pub primitive: u32,
    /// Whether the line enters the solid here, judged by the side of the outward normal.
    pub enters: bool,
    /// The outward normal, of any length, in double precision.
    pub(crate) normal: DVec3,
    /// The distance that the surface moves along the normal, times the length of the normal, for a
    /// relative change of one of all its inputs. The inputs are the numbers of the shape and of the
    /// maps from its object space to the current space.
    pub(crate) moves: f64,
    /// The surface parameters here, if the surface is parametric.
    pub(crate) parameters: Option<[f64; 2]>,
}

impl Root {
    /// A root; `along` has the sign of the product of the line's direction and the outward normal.
    pub(crate) fn new(
        t: Interval,
        primitive: u32,
        along: &Interval,
        normal: DVec3,
        moves: f64,
    ) -> Decided<Self> {
        let enters = match along.sign()? {
            Ordering::Less => true,
            Ordering::Greater => false,
            // The line touches the surface; whether that is a hit is undecidable.
            Ordering::Equal => return Err(Undecided),
        };
        Ok(Self {
            t,
            primitive,
            enters,
            normal,
            moves,
            parameters: None,
        })
    }

    /// The same root in the space that the map leads to; `line` is in the space that it leads from.
    pub(crate) fn placed(mut self, map: &DAffine3, line: &Line) -> Self {
        if *map == DAffine3::IDENTITY {
            return self;
        }
        let p = line.origin.nearest() + self.t.nearest() * line.direction.nearest();
        self.normal = map.matrix3.inverse().transpose() * self.normal;
        let [x, y, z] = [0, 1, 2].map(|i| map.matrix3.col(i).abs() * p[i].abs());
        self.moves += self.normal.abs().dot(x + y + z + map.translation.abs());
        self
    }

    /// The *condition number* of the ray parameter, at least 1.
    ///
    /// This is its relative change for a relative change of one, with the worst signs, of every
    /// input: the numbers of the ray, of the shape and of the maps that place it. Higham, *Accuracy
    /// and Stability of Numerical Algorithms* (2002), 1.6, component by component. It is infinite
    /// where the line touches the surface.
    ///
    /// `line` must be in the space that the root was placed in.
    pub(crate) fn condition(&self, line: &Line) -> f64 {
        let (o, d) = (line.origin.nearest(), line.direction.nearest());
        let t = self.t.nearest();
        let ray = self.normal.abs().dot(o.abs() + (t * d).abs());
        let change = (ray + self.moves) / (self.normal.dot(d) * t).abs();
        // NaN, from 0/0, must not pass as a condition number.
        if change >= 1.0 {
            change
        } else if change.is_nan() {
            f64::INFINITY
        } else {
            1.0
        }
    }
}

/// All roots of a shape on a line, in no order, each once.
#[derive(Clone, Debug, Default)]
pub(crate) struct Roots {
    pub(crate) all: Vec<Root>,
    /// Whether the line is inside the solid at t = -infinity.
    pub(crate) from_inside: bool,
}

impl Roots {
    pub(crate) fn new(all: Vec<Root>) -> Self {
        Self {
            all,
            from_inside: false,
        }
    }
}
