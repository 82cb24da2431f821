//! The oracle: what is true of rays and shapes, with as many digits as it takes.
//!
//! Written from `docs/whitted-model.md`, like every other side of a comparison; it shares no code
//! of intersection with the plugins, only the words: rays, transforms, and the tables of a scene. A
//! ray, the numbers of a shape and its `world_from_object` are taken for exactly the doubles that
//! they are. All roots along the line are enclosed in intervals, first with 128 bits, then with
//! more, until the class of the hit is certain and t is known to 1/256 of a unit in the last place
//! of a double; where even [`MOST_BITS`] do not suffice, the line touches a surface or an edge, and
//! the answer is [`Nearest::Unknown`], never a guess.

pub mod agreement;
pub mod cases;
mod interval;
pub mod naive;
pub mod optics;
mod polynomial;
mod quadratic;
mod root;
mod shapes;
pub mod tracer;
mod vector;

pub use interval::Interval as Enclosure;
pub use root::Root;

use interval::{Decided, Undecided};
use shapes::{Placed, Surface};
use std::cmp::Ordering;
use vector::Line;
use whitstone_core::{Interval, Ray, SceneErrors};
use whitstone_scene::Description;

/// Bits of the first attempt; each further one has twice as many.
const FIRST_BITS: usize = 128;

/// Bits of the last attempt: sums of products of up to eight doubles are exact.
pub const MOST_BITS: usize = 1024;

/// The nearest hit of a ray.
#[derive(Clone, Debug)]
pub enum Nearest {
    /// The ray certainly meets the surface first here.
    Hit {
        /// The ray parameter.
        t: Enclosure,
        /// Number of the primitive; at an edge that of one of those that meet there.
        primitive: u32,
        /// See [`Root`]: how much t changes, relatively, for a relative change of one of all
        /// numbers that it follows from; at least 1.
        condition: f64,
    },
    /// The ray certainly meets nothing.
    Miss,
    /// The ray touches a surface, lies in one, or meets an edge so nearly that no number of digits
    /// tells.
    Unknown,
}

/// One shape of a scene.
pub struct Oracle {
    shape: Placed,
}

impl Oracle {
    /// The types of shapes that it knows.
    pub const KNOWN: [&str; 22] = shapes::KNOWN;

    /// For the shape with this number in a scene that could be planned.
    ///
    /// # Errors
    ///
    /// If the oracle does not know the type, or cannot read the file of a mesh.
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
        loop {
            match self.attempt(ray, interval, bits) {
                Ok(nearest) => return nearest,
                Err(Undecided) if bits >= MOST_BITS => return Nearest::Unknown,
                Err(Undecided) => bits *= 2,
            }
        }
    }

    /// All roots on the line of the ray, also those behind it, in ascending order; `None` where
    /// they are not all certain.
    pub fn roots(&self, ray: &Ray) -> Option<Vec<Root>> {
        let mut bits = FIRST_BITS;
        while bits <= MOST_BITS {
            let roots = self.shape.meet(&Line::of(ray, bits));
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
        let line = Line::of(ray, bits);
        let mut ahead = Vec::new();
        for root in self.shape.meet(&line)?.all {
            let begins = root.t.compare(&line.number(interval.min))? == Ordering::Greater;
            let ends =
                !interval.max.is_finite() || root.t.compare(&line.number(interval.max))? == Ordering::Less;
            if begins && ends {
                ahead.push(root);
            }
        }
        // Where two roots are not told apart, as on an edge that two triangles share, the nearest
        // one is still enclosed.
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
