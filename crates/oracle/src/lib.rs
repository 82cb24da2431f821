//! The oracle: intersections of rays and shapes, and whole pixels, in arbitrary-precision interval
//! arithmetic.
//!
//! It is an independent implementation of `docs/whitted-model.md`. It shares no intersection code
//! with the plugins, only the vocabulary: rays, transforms and the tables of a scene. The numbers
//! of a ray, of a shape and of its `world_from_object` are taken as exactly the doubles that they
//! are.
//!
//! All roots along the line are enclosed in intervals, first with 128 bits. The precision is
//! doubled until the class of the hit is certain and t is known to 1/256 of a unit in the last
//! place of a double. If [`MAX_BITS`] do not suffice, the line touches a surface or an edge. The
//! answer is then [`Nearest::Unknown`], never a guess.

pub mod agreement;
pub mod cases;
mod gltf;
mod interval;
pub mod naive;
pub mod optics;
mod polynomial;
mod quadratic;
mod root;
mod shapes;
#[cfg(test)]
mod testing;
pub mod tracer;
mod vector;

pub use interval::Interval as Enclosure;
pub use root::Root;

use interval::{Decided, Undecided};
use shapes::{Placed, Surface};
use std::cmp::Ordering;
use std::time::{Duration, Instant};
use vector::Line;
use whitstone_core::{Interval, Ray, SceneErrors};
use whitstone_scene::Description;

/// Precision of the first attempt, in bits; each further attempt doubles it.
const FIRST_BITS: usize = 128;

/// Precision of the last attempt, in bits: sums of products of up to eight doubles are exact.
pub const MAX_BITS: usize = 1024;

/// The same for single questions. They may combine the smallest doubles with ordinary numbers,
/// which are 1074 bits apart.
const LAST_BITS: usize = 2 * MAX_BITS;

/// After this time, an undecided ray is not repeated with more bits: each attempt takes at least as
/// long as the one before.
const PATIENCE: Duration = Duration::from_millis(200);

/// The nearest hit of a ray.
#[derive(Clone, Debug)]
pub enum Nearest {
    /// The ray certainly hits the surface, first at `t`.
    Hit {
        /// The ray parameter.
        t: Enclosure,
        /// Number of the primitive; at an edge, of one of the primitives that share it.
        primitive: u32,
        /// Condition number of t, at least 1: its relative change for a relative change of one of
        /// all its inputs. See [`Root`].
        condition: f64,
    },
    /// The ray certainly hits nothing.
    Miss,
    /// The ray touches a surface, lies in one, or passes so close to an edge that no precision
    /// decides; or an answer would take too long.
    Unknown,
}

/// One shape of a scene.
pub struct Oracle {
    shape: Placed,
}

impl Oracle {
    /// The types of shapes that the oracle supports.
    pub const KNOWN: [&str; 24] = shapes::KNOWN;

    /// The oracle for shape number `number` of a scene that the planner accepts.
    ///
    /// # Errors
    ///
    /// If the oracle does not support the type, or cannot read the file of a mesh.
    ///
    /// # Panics
    ///
    /// If the scene has fewer shapes.
    pub fn new(description: &Description<'_>, number: usize) -> Result<Self, SceneErrors> {
        let shape = &description.shapes[number];
        Ok(Self {
            shape: Placed {
                surface: shapes::surface(description, &shape.plugin)?,
                map: *shape.transform.world_from_object(),
            },
        })
    }

    /// The nearest hit inside the open interval.
    pub fn nearest(&self, ray: &Ray, interval: Interval) -> Nearest {
        let mut bits = FIRST_BITS;
        let begin = Instant::now();
        loop {
            match self.attempt(ray, interval, bits) {
                Ok(nearest) => return nearest,
                Err(Undecided) if bits >= LAST_BITS || begin.elapsed() > PATIENCE => return Nearest::Unknown,
                Err(Undecided) => bits *= 2,
            }
        }
    }

    /// All roots on the line of the ray, including those behind the origin, in ascending order.
    /// `None` if they are not all certain.
    pub fn roots(&self, ray: &Ray) -> Option<Vec<Root>> {
        let mut bits = FIRST_BITS;
        while bits <= MAX_BITS {
            let roots = Line::of(ray, bits).and_then(|line| self.shape.meet(&line));
            if let Ok(mut roots) = roots
                && roots.all.iter().all(|root| root.t.is_narrow())
            {
                let middle = |root: &Root| root.t.nearest();
                roots.all.sort_by(|a, b| middle(a).total_cmp(&middle(b)));
                return Some(roots.all);
            }
            bits *= 2;
        }
        None
    }

    fn attempt(&self, ray: &Ray, interval: Interval, bits: usize) -> Decided<Nearest> {
        let line = Line::of(ray, bits)?;
        let mut ahead = Vec::new();
        for root in self.shape.meet_beyond(&line, interval.min)?.all {
            let begins = root.t.compare(&line.number(interval.min))? == Ordering::Greater;
            let ends =
                !interval.max.is_finite() || root.t.compare(&line.number(interval.max))? == Ordering::Less;
            if begins && ends {
                ahead.push(root);
            }
        }
        // If two roots cannot be told apart, as on an edge shared by two triangles, this still
        // encloses the nearest one.
        let Some(t) = ahead.iter().map(|root| root.t.clone()).reduce(|a, b| a.min(&b)) else {
            return Ok(Nearest::Miss);
        };
        if !t.is_narrow() {
            return Err(Undecided);
        }
        let first = ahead.iter().find(|root| root.t.common(&t).is_some());
        let first = first.ok_or(Undecided)?;
        Ok(Nearest::Hit {
            t,
            primitive: first.primitive,
            condition: first.condition(&line),
        })
    }
}
