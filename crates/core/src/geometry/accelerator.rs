use crate::stream::{HitStream, Lanes, RayStream};
use crate::{Aabb, Geometry, Interval, PreliminaryIntersection, Ray, SelfHitFilter};
use glam::{DAffine3, DVec3};
use std::collections::BTreeMap;
use std::sync::Arc;

/// An acceleration structure over a [`crate::Geometry`].
///
/// **Same answer law**: every accelerator returns bit for bit the result of testing every element
/// in order: the nearest hit, and among equal distances the lowest (instance, shape, primitive). A
/// node may be culled only if it is *strictly* farther than the best hit.
pub trait Accelerator: Send + Sync {
    /// The nearest hit inside the interval.
    fn intersect(
        &self,
        ray: &Ray,
        interval: Interval,
        skip: SelfHitFilter,
    ) -> Option<PreliminaryIntersection>;

    /// Whether there is any hit inside the interval.
    fn occluded(&self, ray: &Ray, interval: Interval, skip: SelfHitFilter) -> bool;

    /// [`Self::intersect`] for every ray of a stream. Replaces all of `hits`: `hits.clear(rays)`
    /// comes first, and a miss keeps the limit of its ray.
    fn intersect_stream(&self, rays: &RayStream, hits: &mut HitStream) {
        hits.clear(rays);
        for lane in 0..rays.len {
            let skip = rays.skip.skip(lane);
            if let Some(hit) = self.intersect(&rays.ray(lane), rays.interval(lane), skip) {
                hits.set(lane, &hit);
            }
        }
    }

    /// [`Self::occluded`] for every ray of a stream. Sets every lane below `rays.len`, also to
    /// false.
    fn occluded_stream(&self, rays: &RayStream, hidden: &mut Lanes<bool>) {
        for (lane, hidden) in hidden.iter_mut().enumerate().take(rays.len) {
            *hidden = self.occluded(&rays.ray(lane), rays.interval(lane), rays.skip.skip(lane));
        }
    }

    /// The same structure for a geometry whose elements have moved: its bounding volumes are fitted
    /// anew, and their contents stay. The geometry has the same shapes, with the same triangles at
    /// other places. `rigid`: the rotation and translation by which all of it has moved, if it is
    /// one. `None` if a new build is needed.
    fn refitted(&self, _geometry: &Arc<Geometry>, _rigid: Option<&DAffine3>) -> Option<Box<dyn Accelerator>> {
        None
    }

    /// Why the image depends on this accelerator, if it does not obey the law; the note is reported
    /// with the image. `None` for accelerators that obey the law.
    fn approximation_note(&self) -> Option<&str> {
        None
    }

    /// Statistics of the structure that was built.
    fn statistics(&self) -> Statistics;

    /// Traversal statistics of [`Self::intersect`] for one ray; `None` if they are not counted.
    fn traversal_statistics(
        &self,
        _ray: &Ray,
        _interval: Interval,
        _skip: SelfHitFilter,
    ) -> Option<TraversalStatistics> {
        None
    }

    /// The bounding volumes or cells, for debug images, down to level `deepest`; the root is level
    /// 0. `None` if the structure has no volumes.
    fn debug_bounds(&self, _deepest: usize) -> Option<Vec<DebugBounds>> {
        None
    }
}

/// Traversal statistics of one query.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct TraversalStatistics {
    /// Inner nodes, or cells of a grid, visited.
    pub steps: u64,
    /// Element tests.
    pub tests: u64,
}

/// The edges of one bounding volume or cell of an accelerator.
#[derive(Clone, Debug, PartialEq)]
pub struct DebugBounds {
    /// Level; the root is 0.
    pub depth: usize,
    /// Both ends of each edge, in world space.
    pub segments: Vec<[DVec3; 2]>,
}

impl DebugBounds {
    /// The edges of a box; none if it is empty.
    pub fn of_box(depth: usize, aabb: &Aabb) -> Self {
        Self::of_parallelepiped(depth, aabb, [DVec3::X, DVec3::Y, DVec3::Z])
    }

    /// The edges of a box in the frame spanned by `axes`; none if it is empty.
    pub fn of_parallelepiped(depth: usize, aabb: &Aabb, axes: [DVec3; 3]) -> Self {
        let corner = |number: usize| {
            let sides = [0, 1, 2].map(|axis| [aabb.min, aabb.max][number >> axis & 1][axis]);
            sides[0] * axes[0] + sides[1] * axes[1] + sides[2] * axes[2]
        };
        let edges = (0..8).flat_map(|number| {
            let other = move |axis: usize| (number >> axis & 1 == 0).then_some(number | 1 << axis);
            (0..3).filter_map(other).map(move |other| [number, other])
        });
        let segments = edges.map(|ends| ends.map(corner));
        Self {
            depth,
            segments: if aabb.is_empty() {
                Vec::new()
            } else {
                segments.collect()
            },
        }
    }
}

/// Named figures that an accelerator reports about itself, such as `nodes`, `leaves` and `depth`.
///
/// These names have a fixed meaning; all others are free:
///
/// - `bytes`: memory without the geometry. If missing, it counts as 0.
/// - `sah_cost`: expected number of element tests of a ray without a hit that crosses the bounds.
/// - `build_seconds`: time of the build in seconds.
pub type Statistics = BTreeMap<&'static str, f64>;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_box_has_twelve_edges() {
        let aabb = Aabb::around([DVec3::ZERO, DVec3::new(1.0, 2.0, 4.0)]);
        let DebugBounds { depth, segments } = DebugBounds::of_box(3, &aabb);
        assert_eq!((depth, segments.len()), (3, 12));
        let total: f64 = segments.iter().map(|[a, b]| a.distance(*b)).sum();
        assert_eq!(total, 4.0 * (1.0 + 2.0 + 4.0));
        assert_eq!(Aabb::around(segments.into_iter().flatten()), aabb);
        assert!(DebugBounds::of_box(0, &Aabb::EMPTY).segments.is_empty());
    }
}
