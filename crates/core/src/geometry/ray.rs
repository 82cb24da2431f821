use glam::DVec3;

/// A half-line `origin + t * direction`. Distances `t` are in units of the direction's length:
/// integrators use unit directions, rays in a shape's object space may have any length.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ray {
    /// Where t = 0, in metres.
    pub origin: DVec3,
    /// Finite and not zero; not necessarily of unit length.
    pub direction: DVec3,
}

impl Ray {
    /// A ray from its parts.
    #[inline(always)]
    pub const fn new(origin: DVec3, direction: DVec3) -> Self {
        Self { origin, direction }
    }

    /// The point at parameter `t`.
    #[inline(always)]
    pub fn at(&self, t: f64) -> DVec3 {
        self.origin + t * self.direction
    }
}

/// The *open* range of ray parameters in which a hit counts: `min < t < max`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Interval {
    /// Lower end, excluded; at least 0.
    pub min: f64,
    /// Upper end, excluded; may be infinite.
    pub max: f64,
}

impl Interval {
    /// Everything in front of the origin.
    pub const FORWARD: Self = Self {
        min: 0.0,
        max: f64::INFINITY,
    };

    /// In front of the origin and nearer than `max`.
    pub const fn up_to(max: f64) -> Self {
        Self { min: 0.0, max }
    }

    /// Whether `t` lies inside. False for NaN.
    pub fn contains(&self, t: f64) -> bool {
        t > self.min && t < self.max
    }
}

/// An axis-aligned bounding box, in the space of the scene or of a group. `EMPTY` contains nothing;
/// the box of an unbounded shape has infinite corners.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Aabb {
    /// Smallest coordinates.
    pub min: DVec3,
    /// Largest coordinates.
    pub max: DVec3,
}

impl Aabb {
    /// The empty box, the neutral element of [`Aabb::union`].
    pub const EMPTY: Self = Self {
        min: DVec3::INFINITY,
        max: DVec3::NEG_INFINITY,
    };

    /// All of space.
    pub const EVERYTHING: Self = Self {
        min: DVec3::NEG_INFINITY,
        max: DVec3::INFINITY,
    };

    /// The smallest box around some points.
    pub fn around(points: impl IntoIterator<Item = DVec3>) -> Self {
        points.into_iter().fold(Self::EMPTY, |aabb, p| aabb.including(p))
    }

    /// This box grown to hold `point`.
    pub fn including(self, point: DVec3) -> Self {
        Self {
            min: self.min.min(point),
            max: self.max.max(point),
        }
    }

    /// The smallest box that holds both.
    pub fn union(self, other: Self) -> Self {
        Self {
            min: self.min.min(other.min),
            max: self.max.max(other.max),
        }
    }

    /// Whether the box holds nothing.
    pub fn is_empty(&self) -> bool {
        !self.min.cmple(self.max).all()
    }

    /// Whether all six faces are at finite coordinates.
    pub fn is_finite(&self) -> bool {
        self.min.is_finite() && self.max.is_finite()
    }

    /// Middle of the box; NaN along an axis that is empty, or unbounded on both sides.
    pub fn center(&self) -> DVec3 {
        0.5 * self.min + 0.5 * self.max
    }

    /// Edge lengths; zero for an empty box.
    pub fn extent(&self) -> DVec3 {
        (self.max - self.min).max(DVec3::ZERO)
    }

    /// Half the surface area, in m², for the surface area heuristic.
    pub fn half_area(&self) -> f64 {
        let e = self.extent();
        e.x * e.y + e.y * e.z + e.z * e.x
    }

    /// The box moved outward by `distance` on every side.
    pub fn padded(self, distance: f64) -> Self {
        Self {
            min: self.min - distance,
            max: self.max + distance,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_empty_box_is_neutral_and_has_no_area() {
        let unit = Aabb::around([DVec3::ZERO, DVec3::ONE]);
        assert_eq!(Aabb::EMPTY.union(unit), unit);
        assert!(Aabb::EMPTY.is_empty());
        assert_eq!(Aabb::EMPTY.half_area(), 0.0);
        assert_eq!(unit.half_area(), 3.0);
    }

    #[test]
    fn an_interval_is_open_and_excludes_nan() {
        let interval = Interval::up_to(2.0);
        assert!(interval.contains(1.0));
        assert!(!interval.contains(0.0));
        assert!(!interval.contains(2.0));
        assert!(!interval.contains(f64::NAN));
    }
}
