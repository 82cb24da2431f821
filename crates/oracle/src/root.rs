//! Where a line meets a surface, and how sensitive that is.

use crate::interval::{Decided, Interval, Undecided};
use crate::vector::Line;
use std::cmp::Ordering;
use whitstone_core::{DAffine3, DVec3};

/// A place where a line meets a surface.
#[derive(Clone, Debug)]
pub struct Root {
    /// The ray parameter.
    pub t: Interval,
    /// Number of the primitive; at an edge that of any of those that meet there.
    pub primitive: u32,
    /// Whether the line goes from the outside to the inside here, by the side that the normal is
    /// on.
    pub enters: bool,
    /// Along the outward normal, of any length; as good as doubles are.
    pub(crate) normal: DVec3,
    /// By how much the surface moves, along the normal and times its length, for a relative change
    /// of one of all its numbers: of those of the shape, and of the maps that place it, those
    /// around the present space not counted.
    pub(crate) moves: f64,
    /// Of a surface that is given by two parameters: which they are here.
    pub(crate) parameters: Option<[f64; 2]>,
}

impl Root {
    /// `along` is how the line and the outward normal, of any length, lie to each other: its sign
    /// is that of their product.
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
            // The line touches the surface: whether that is a hit is not for us to say.
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

    /// The same seen from the space that the map leads to; `line` is that of the space it leads
    /// from.
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

    /// The *condition* of the ray parameter: its relative change for a relative change of one, by
    /// the worst signs, of every number that it follows from: those of the ray, of the shape and of
    /// the maps that place it. At least one. Higham, *Accuracy and Stability of Numerical
    /// Algorithms* (2002), 1.6, component by component. Infinite where the line touches the
    /// surface.
    ///
    /// `line` is in the space that the root was placed in.
    pub(crate) fn condition(&self, line: &Line) -> f64 {
        let (o, d) = (line.origin.nearest(), line.direction.nearest());
        let t = self.t.nearest();
        let ray = self.normal.abs().dot(o.abs() + (t * d).abs());
        let change = (ray + self.moves) / (self.normal.dot(d) * t).abs();
        // NaN, of zero over zero, is no condition that anything could be held to.
        if change >= 1.0 {
            change
        } else if change.is_nan() {
            f64::INFINITY
        } else {
            1.0
        }
    }
}

/// All places where a line meets a shape, in no order, each once.
#[derive(Clone, Debug, Default)]
pub(crate) struct Roots {
    pub(crate) all: Vec<Root>,
    /// Whether the line comes from the inside of the solid, which is endless there.
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
