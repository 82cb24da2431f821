//! Frusta of tiles: bounds on all rays of a stream, tested against the boxes at the top of the
//! hierarchy, which stand for everything inside them.
//!
//! All rays must advance along one axis. Their slopes against it lie in a rectangle, as the rays of
//! a tile of the image do, and the test compares intervals of positions (Boulos, Wald, Shirley,
//! *Geometric and arithmetic culling methods for entire ray packets*, 2006). If the test
//! reports a miss, every ray misses; the converse need not hold.

use crate::support::leaves::frame::Frame;
use std::sync::atomic::{AtomicU64, Ordering};
use whitstone_core::stream::{LANES, RayStream};
use whitstone_core::{Aabb, DVec3};
use whitstone_simd::dispatch;

/// Number of boxes that a frustum is tested against.
pub(super) const MAX_PROXIES: usize = 64;

/// Rays that advance less than this along the axis have no frustum: its slopes would bound little.
const LEAST: f64 = 0.125;

/// Twice the padding of single rays: they have 8 roundings to single precision, of numbers up to
/// the distance of their origin and the size of the structure, and 2^-40 of world coordinates
/// (`docs/accelerators.md`).
const PADDING: f64 = 1.0 / (1 << 20) as f64;
const WORLD_PADDING: f64 = 1.0 / (1_u64 << 39) as f64;

/// Boxes around everything in the hierarchy.
pub(super) struct Proxies {
    boxes: Vec<Aabb>,
    center: DVec3,
    /// Half of the largest extent of everything, or more.
    reach: f64,
    /// Number of streams that missed all boxes.
    skipped: AtomicU64,
}

impl Proxies {
    pub(super) fn new(frame: &Frame, boxes: Vec<Aabb>) -> Self {
        Self {
            boxes,
            center: frame.center,
            reach: 1.0 / frame.scale,
            skipped: AtomicU64::new(0),
        }
    }

    /// Number of streams that were skipped.
    pub(super) fn skipped(&self) -> u64 {
        self.skipped.load(Ordering::Relaxed)
    }

    /// Whether all rays of a stream certainly miss all boxes; counts such streams.
    pub(super) fn are_missed_by(&self, rays: &RayStream) -> bool {
        let missed = Frustum::around(rays).is_some_and(|frustum| self.all_miss(&frustum));
        self.skipped.fetch_add(u64::from(missed), Ordering::Relaxed);
        missed
    }

    fn all_miss(&self, frustum: &Frustum) -> bool {
        let Aabb { min, max } = frustum.origin;
        let distance = (max - self.center).max(self.center - min).max_element();
        let world = max.max(-min).max(self.center.abs()).max_element();
        let padding = PADDING * (self.reach + distance) + WORLD_PADDING * world;
        self.boxes
            .iter()
            .all(|aabb| frustum.misses(&aabb.padded(padding)))
    }
}

/// Bounds on the rays of a stream.
#[derive(Debug)]
pub(super) struct Frustum {
    origin: Aabb,
    /// All rays advance along this axis, in this direction.
    axis: usize,
    sign: f64,
    /// For the two axes that follow it: least and greatest slope.
    slopes: [[f64; 2]; 2],
}

impl Frustum {
    /// `None` for no rays, and for rays that do not all advance along one axis.
    pub(super) fn around(rays: &RayStream) -> Option<Self> {
        let len = rays.len.min(LANES);
        let first = rays.direction.get(0);
        let axis = first.abs().max_position();
        let sign = 1.0_f64.copysign(first[axis]);
        let columns = rays.direction.columns();
        let [along, u, v] = [axis, axis + 1, axis + 2].map(|axis| columns[axis % 3]);
        let mut least = f64::INFINITY;
        let mut slopes = [[f64::INFINITY, f64::NEG_INFINITY]; 2];
        dispatch(
            #[inline(always)]
            || {
                for lane in 0..len {
                    let ahead = sign * along[lane];
                    // NaN is below.
                    least = if ahead >= least { least } else { ahead };
                    for ([low, high], across) in slopes.iter_mut().zip([u, v]) {
                        let slope = across[lane] / ahead;
                        *low = low.min(slope);
                        *high = high.max(slope);
                    }
                }
            },
        );
        let origin = rays.origin.bounds(len);
        // Directions need not have unit length: those that an instance has transformed do not.
        let is_narrow = slopes
            .as_flattened()
            .iter()
            .all(|slope| slope.abs() <= 1.0 / LEAST);
        (len > 0 && least > LEAST && is_narrow && origin.is_finite()).then_some(Self {
            origin,
            axis,
            sign,
            slopes,
        })
    }

    /// Whether all rays certainly miss a finite box.
    fn misses(&self, aabb: &Aabb) -> bool {
        let Aabb { min, max } = self.origin;
        let axis = self.axis;
        // Distances along the axis within which a ray may be in the box.
        let (near, far) = if self.sign > 0.0 {
            (aabb.min[axis] - max[axis], aabb.max[axis] - min[axis])
        } else {
            (min[axis] - aabb.max[axis], max[axis] - aabb.min[axis])
        };
        let near = near.max(0.0);
        let passes = |k: usize| {
            let ([low, high], axis) = (self.slopes[k], (axis + 1 + k) % 3);
            min[axis] + (low * near).min(low * far) > aabb.max[axis]
                || max[axis] + (high * near).max(high * far) < aabb.min[axis]
        };
        far < 0.0 || passes(0) || passes(1)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use whitstone_core::{Ray, SelfHitFilter};
    use whitstone_testkit::Random;

    /// The parameters where a ray is in a box.
    fn enters(ray: &Ray, aabb: &Aabb) -> bool {
        let (mut near, mut far) = (0.0_f64, f64::INFINITY);
        for axis in 0..3 {
            let ends = [aabb.min, aabb.max].map(|p| (p[axis] - ray.origin[axis]) / ray.direction[axis]);
            near = near.max(ends[0].min(ends[1]));
            far = far.min(ends[0].max(ends[1]));
        }
        near <= far
    }

    /// Random tiles and boxes: no box that a ray enters is missed, and most of the others are.
    #[test]
    fn no_box_that_a_ray_enters_is_missed() {
        let mut random = Random::new(34);
        let mut rays = Box::new(RayStream::default());
        let (mut hit, mut missed, mut spared) = (0, 0, 0);
        for case in 0..3000 {
            let mut vector = |size: f64| size * random.cube();
            let (eye, middle) = (vector(3.0), vector(1.0).normalize());
            let (right, up) = middle.any_orthonormal_pair();
            let spread = if case % 2 == 0 { 0.0 } else { 0.5 };
            rays.len = LANES - case % 100;
            for lane in 0..rays.len {
                let tile = |k: usize| 0.01 * (k as f64 - 7.5);
                let direction = middle + tile(lane % 16) * right + tile(lane / 16) * up;
                let origin = eye + vector(spread);
                let ray = Ray::new(origin, direction.normalize());
                rays.set(lane, ray, f64::INFINITY, SelfHitFilter::NOTHING);
            }
            let frustum = Frustum::around(&rays).unwrap();
            for _ in 0..10 {
                let center = vector(4.0);
                let half = vector(1.0).abs();
                let aabb = Aabb {
                    min: center - half,
                    max: center + half,
                };
                let entered = (0..rays.len).any(|lane| enters(&rays.ray(lane), &aabb));
                let culled = frustum.misses(&aabb);
                assert!(!(entered && culled), "{frustum:?} {aabb:?}");
                hit += u32::from(entered);
                missed += u32::from(!entered);
                spared += u32::from(culled);
            }
        }
        assert!(hit > 1000 && 10 * spared > 9 * missed, "{hit} {missed} {spared}");
    }

    #[test]
    fn rays_that_do_not_advance_together_have_no_frustum() {
        let mut rays = Box::new(RayStream::default());
        assert!(Frustum::around(&rays).is_none());
        rays.len = 2;
        let mut set = |lane, direction: DVec3| {
            let ray = Ray::new(DVec3::ZERO, direction);
            rays.set(lane, ray, f64::INFINITY, SelfHitFilter::NOTHING);
            Frustum::around(&rays).is_some()
        };
        set(0, DVec3::Z);
        assert!(set(1, DVec3::new(0.6, 0.0, 0.8)));
        for direction in [DVec3::NEG_Z, DVec3::X, DVec3::NAN, DVec3::ZERO] {
            assert!(!set(1, direction), "{direction}");
        }
    }
}
