//! Counts the rays on which the search of a shape reaches its limit.

use glam::DVec3;
use std::fmt;
use std::sync::OnceLock;
use std::sync::atomic::{AtomicU64, Ordering};

/// Rays on which the search of a shape reached its limit, so that a hit may be missing. Counting
/// does not change any answer.
#[derive(Debug, Default)]
pub struct SearchLimit {
    rays: AtomicU64,
    place: OnceLock<DVec3>,
}

/// How often the limit was reached, and where.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LimitReached {
    /// Number of rays. A ray counts once for each search, such as those of several operands.
    pub rays: u64,
    /// The place on one of the rays where the search reached the limit, in the space of the scene
    /// or of the group that the shape belongs to.
    pub place: DVec3,
}

impl SearchLimit {
    /// Counts one ray. `place` is where its search reached the limit.
    #[cold]
    pub fn count(&self, place: impl FnOnce() -> DVec3) {
        self.rays.fetch_add(1, Ordering::Relaxed);
        self.place.get_or_init(place);
    }

    /// Forgets all rays so far.
    pub fn reset(&mut self) {
        *self = Self::default();
    }

    /// `None` if no ray reached the limit.
    pub fn reached(&self) -> Option<LimitReached> {
        let rays = self.rays.load(Ordering::Relaxed);
        let place = *self.place.get()?;
        Some(LimitReached { rays, place })
    }
}

impl fmt::Display for LimitReached {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (rays, [x, y, z]) = (self.rays, self.place.to_array());
        write!(
            f,
            "the search for hits reached its limit on {rays} rays, on one near [{x:.6}, {y:.6}, {z:.6}]"
        )
    }
}

impl LimitReached {
    /// Adds the rays of another shape; keeps this place.
    pub fn and(self, other: Self) -> Self {
        Self {
            rays: self.rays + other.rays,
            ..self
        }
    }
}
