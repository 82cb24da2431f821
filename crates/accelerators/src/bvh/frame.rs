//! The structure's own coordinates, and rays in them.

use whitstone_core::{Aabb, DVec3, Interval, Ray};

/// Where the structure's own coordinates are: all of it lies in the cube from -1 to 1.
#[derive(Clone, Copy, Debug)]
pub(super) struct Frame {
    center: DVec3,
    /// A power of two, so that scaling rounds nothing.
    scale: f64,
    /// Whether what is `f32` in the world is so here.
    exact: bool,
}

impl Frame {
    /// Around a box of finite size.
    pub(super) fn around(aabb: &Aabb) -> Self {
        let center = aabb.center();
        // Of the corners as they will be computed, so that rounding puts none outside.
        let half = (aabb.max - center).max(center - aabb.min).max_element();
        let exponent = if half > 0.0 { half.log2().ceil() } else { 0.0 };
        Self {
            center,
            scale: (-exponent).clamp(-1000.0, 1000.0).exp2(),
            exact: false,
        }
    }

    /// Around a box of finite size that holds points whose coordinates are `f32`: the same coordinates but for a
    /// factor, so that these are exact in own coordinates too; `None` where that would be too coarse.
    pub(super) fn unmoved(aabb: &Aabb) -> Option<Self> {
        let around_zero = aabb.union(Aabb {
            min: -aabb.max,
            max: -aabb.min,
        });
        let frame = Self {
            center: DVec3::ZERO,
            exact: true,
            ..Self::around(&around_zero)
        };
        let near = aabb.extent().max_element() * frame.scale > 0.25;
        // Coordinates above 2^-60 stay `f32` down to 2^-120; smaller ones may be rounded.
        (near && frame.scale > 1e-12 && frame.scale < 1e12).then_some(frame)
    }

    /// The factor that turns own coordinates into those of the world, exactly, if there is one.
    pub(super) fn exact(&self) -> Option<f64> {
        self.exact.then_some(1.0 / self.scale)
    }

    /// A point of the world in own coordinates.
    #[inline]
    pub(super) fn point(&self, p: DVec3) -> DVec3 {
        (p - self.center) * self.scale
    }

    /// A length of the world in own coordinates.
    pub(super) fn length(&self, length: f64) -> f64 {
        length * self.scale
    }

    /// A ray in single precision; `None` for one that does not fit or is no ray at all.
    #[inline(always)]
    pub(super) fn ray(&self, ray: &Ray, interval: &Interval) -> Option<LocalRay> {
        LocalRay::new(self, ray, interval)
    }
}

/// The relative error of a product or sum rounded to `f32`.
pub(super) const ROUNDING: f32 = f32::EPSILON / 2.0;

/// A ray in own coordinates, for the tests in single precision. Its parameter is scaled so that the
/// largest component of the direction is 1 or -1, and counted from `shift`.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct LocalRay {
    /// 1 over the direction, finite.
    pub(super) reciprocal: [f32; 3],
    /// What to add to a near plane times `reciprocal` to get a lower bound of the parameter there.
    pub(super) near: [f32; 3],
    /// What to add to a far plane times `reciprocal` to get an upper bound.
    pub(super) far: [f32; 3],
    /// Whether the near plane of an axis is that of the smallest (0) or largest (1) coordinates.
    pub(super) side: [usize; 3],
    /// The axes; along the last the direction is largest.
    pub(super) axes: [usize; 3],
    /// The origin along `axes`.
    pub(super) origin: [f32; 3],
    /// The direction along the first two of `axes`, divided by the last component.
    pub(super) shear: [f32; 2],
    /// The sign of the direction along the last axis.
    pub(super) sign: f32,
    /// Bound on the error of the sheared coordinates of a point of the structure.
    pub(super) error: f32,
    /// Bound on the error of a coordinate of the origin or of a point of the structure.
    pub(super) conversion: f32,
    /// Lower bound of the interval.
    pub(super) min: f32,
    /// Upper bound of the interval.
    pub(super) max: f32,
    /// What is between these is certainly inside the interval.
    pub(super) inside: [f32; 2],
    clock: Clock,
}

impl LocalRay {
    #[inline(always)]
    fn new(frame: &Frame, ray: &Ray, interval: &Interval) -> Option<Self> {
        let d = ray.direction.to_array();
        let a = d.map(f64::abs);
        let z = match (a[0] > a[1], a[0] > a[2], a[1] > a[2]) {
            (true, true, _) => 0,
            (false, _, true) => 1,
            _ => 2,
        };
        let axes = [[1, 2, 0], [2, 0, 1], [0, 1, 2]][z];
        let largest = a[z];
        let scale = largest * frame.scale;
        let mut origin = frame.point(ray.origin);
        let mut reach = origin.abs().max_element();
        // Written so that NaN does not pass either.
        let sound = scale > 1e-200 && scale < 1e200 && reach < 1e18 && interval.min < 1e100;
        if !sound {
            return None;
        }
        // The rounding of the origin in double precision, with much to spare.
        let far = 2f64.powi(-40) * reach;
        let mut shift = 0.0;
        if reach > 4.0 {
            // From afar single precision would be too coarse: start where the structure is closest.
            let e = ray.direction / largest;
            shift = -origin.dot(e) / e.length_squared();
            origin += shift * e;
            reach = origin.abs().max_element();
        }
        // 8 roundings of numbers up to `reach + 1`.
        let pad = 8.0 * f64::from(ROUNDING) * (reach + 1.0) + far;
        // Slower than this along an axis the ray does not leave the pad within the structure.
        let slowest = largest * 2f64.powi(-30);
        let invert = |d: f64| (largest / d.abs().max(slowest).copysign(d)) as f32;
        let reciprocal = [invert(d[0]), invert(d[1]), invert(d[2])];
        let per_z = 1.0 / d[z];
        let o = origin.to_array();
        let shifted = |i: usize, by: f64| {
            let r = f64::from(reciprocal[i]);
            (-(o[i] * r) - by * r.abs()) as f32
        };
        let clock = Clock { scale, shift };
        // As one literal: what is written in pieces and then copied stalls the processor.
        Some(Self {
            reciprocal,
            near: [shifted(0, pad), shifted(1, pad), shifted(2, pad)],
            far: [shifted(0, -pad), shifted(1, -pad), shifted(2, -pad)],
            side: [side(d[0]), side(d[1]), side(d[2])],
            axes,
            origin: [o[axes[0]] as f32, o[axes[1]] as f32, o[axes[2]] as f32],
            shear: [(d[axes[0]] * per_z) as f32, (d[axes[1]] * per_z) as f32],
            sign: 1f32.copysign(d[z] as f32),
            error: pad as f32 * (1.0 + 2.0 * ROUNDING),
            conversion: ROUNDING * (reach as f32 + 1.0) + far as f32,
            min: clock.below(interval.min),
            max: clock.above(interval.max),
            inside: [
                clock.above(interval.min),
                if interval.max < f64::INFINITY {
                    clock.below(interval.max)
                } else {
                    f32::INFINITY
                },
            ],
            clock,
        })
    }

    /// A number that is certainly above the own parameter of `t`.
    #[inline(always)]
    pub(super) fn above(&self, t: f64) -> f32 {
        self.clock.above(t)
    }
}

fn side(d: f64) -> usize {
    usize::from(d.is_sign_negative())
}

/// From parameters of the ray in the world to own ones.
#[derive(Clone, Copy, Debug, Default)]
struct Clock {
    scale: f64,
    shift: f64,
}

impl Clock {
    /// A number that is certainly below the own parameter of `t`.
    #[inline(always)]
    fn below(&self, t: f64) -> f32 {
        let t = t * self.scale - self.shift;
        (t - self.slack(t)) as f32
    }

    /// A number that is certainly above the own parameter of `t`, which may be infinite.
    #[inline(always)]
    fn above(&self, t: f64) -> f32 {
        let t = t * self.scale - self.shift;
        (t + self.slack(t)) as f32
    }

    #[inline(always)]
    fn slack(&self, t: f64) -> f64 {
        4.0 * f64::from(ROUNDING) * t.abs() + 2f64.powi(-48) * self.shift.abs()
    }
}
