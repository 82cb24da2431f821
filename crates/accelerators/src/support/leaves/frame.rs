//! The structure's local coordinates, and rays in them.

use whitstone_core::{Aabb, DVec3, Interval, Ray};
use whitstone_simd::{Quad, QuadOrder};

/// Transform to local coordinates, in which the whole structure lies in the cube from -1 to 1.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Frame {
    center: DVec3,
    /// A power of two, so that scaling is exact.
    scale: f64,
    /// Whether `f32` coordinates in the world are exact in `f32` here too.
    exact: bool,
}

impl Frame {
    /// A frame around a box of finite size.
    pub(crate) fn around(aabb: &Aabb) -> Self {
        let center = aabb.center();
        // Uses the corners as they will be computed, so that rounding puts none outside.
        let half = (aabb.max - center).max(center - aabb.min).max_element();
        let exponent = if half > 0.0 { half.log2().ceil() } else { 0.0 };
        // Set by its bits: `exp2` does not promise exact powers of two.
        let exponent = (-exponent).clamp(-1000.0, 1000.0) as i64;
        Self {
            center,
            scale: f64::from_bits(((1023 + exponent) as u64) << 52),
            exact: false,
        }
    }

    /// A frame that scales but does not translate, around a finite box of points whose coordinates
    /// are `f32`: these stay exact in local coordinates. `None` where that would be too coarse.
    pub(crate) fn unmoved(aabb: &Aabb) -> Option<Self> {
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

    /// Whether vertices that are `f32` in the world are exact in `f32` here too: their coordinates
    /// times [`Self::length`] of 1.
    pub(crate) fn is_exact(&self) -> bool {
        self.exact
    }

    /// A world point in local coordinates.
    #[inline]
    pub(crate) fn point(&self, p: DVec3) -> DVec3 {
        (p - self.center) * self.scale
    }

    /// A local point in world coordinates.
    pub(crate) fn world(&self, p: DVec3) -> DVec3 {
        p / self.scale + self.center
    }

    /// A world length in local coordinates.
    pub(crate) fn length(&self, length: f64) -> f64 {
        length * self.scale
    }
}

/// The relative error of a product or sum rounded to `f32`.
pub(crate) const ROUNDING: f32 = f32::EPSILON / 2.0;

/// A ray in local coordinates, for the single-precision tests of boxes. Its parameter is scaled so
/// that the largest component of the direction is 1 or -1, and counted from a point near the
/// structure.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct LocalRay {
    /// 1 over the direction, finite.
    pub(crate) reciprocal: [f32; 4],
    /// Added to a near plane times `reciprocal`, this gives a lower bound on the parameter there.
    pub(crate) near: [f32; 4],
    /// Added to a far plane times `reciprocal`, this gives an upper bound on the parameter there.
    pub(crate) far: [f32; 4],
    /// Lower bound of the interval.
    pub(crate) min: f32,
    /// The near planes (index 0) and the far planes (index 1) of boxes, by axis.
    pub(crate) planes: [[Planes; 3]; 2],
    /// The signs of the direction, x the lowest bit.
    pub(crate) octant: usize,
    /// Local parameters per world parameter, and the local parameter of 0, both rounded up.
    pace: f64,
    start: f64,
}

/// A ray for the double-precision tests of triangles: the numbers of
/// [`ShearedRay`](whitstone_core::triangle::ShearedRay), whose first three lanes count.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Sheared {
    /// The world axes that become x, y and z.
    pub(crate) axes: [Axis; 3],
    /// The origin along `axes`.
    pub(crate) origin: [f64; 4],
    /// The direction along x and y per unit of z, and the ray parameter per unit of z.
    pub(crate) shear: [f64; 4],
}

/// How the lanes of a direction are arranged for [`Sheared`].
struct Turn {
    axes: [Axis; 3],
    origin: QuadOrder,
    dividend: QuadOrder,
    divisor: QuadOrder,
}

/// By the axis that becomes z, plus 4 if the direction is negative along it.
static TURNS: [Turn; 8] = {
    const fn turn([x, y, z]: [Axis; 3]) -> Turn {
        let [i, j, k] = [x as usize, y as usize, z as usize];
        Turn {
            axes: [x, y, z],
            origin: QuadOrder::new([i, j, k, 3]),
            // The fourth lane of a direction is 1.
            dividend: QuadOrder::new([i, j, 3, 3]),
            divisor: QuadOrder::new([k; 4]),
        }
    }
    use Axis::*;
    [
        turn([Y, Z, X]),
        turn([Z, X, Y]),
        turn([X, Y, Z]),
        turn([X, Y, Z]),
        turn([Z, Y, X]),
        turn([X, Z, Y]),
        turn([Y, X, Z]),
        turn([Y, X, Z]),
    ]
};

/// A ray for the tests of boxes and of triangles. `None` if it is out of range or not a valid ray.
#[inline(always)]
pub(crate) fn prepare<Q: Quad>(
    q: Q,
    frame: &Frame,
    ray: &Ray,
    interval: &Interval,
) -> Option<(LocalRay, Sheared)> {
    let direction = load(q, ray.direction, 1.0);
    let sizes = q.abs(direction);
    let largest = greatest(q, sizes);
    let size = q.store(largest)[0];
    let scale = size * frame.scale;
    let world_origin = load(q, ray.origin, 0.0);
    let mut origin = q.mul(
        q.sub(world_origin, load(q, frame.center, 0.0)),
        q.splat(frame.scale),
    );
    let mut reach = q.store(greatest(q, q.abs(origin)))[0];
    // So written, NaN fails too.
    let sound = (q.equal(origin, origin) == 15)
        & (reach < 1e18)
        & (scale > 1e-200)
        & (scale < 1e200)
        & (interval.min < 1e100);
    if !sound {
        return None;
    }
    // Generous bound on the rounding of the origin in double precision.
    let far = 2f64.powi(-40) * reach;
    let mut shift = 0.0;
    if reach > 4.0 {
        // For distant origins single precision would be too coarse: start at the point of the ray
        // closest to the center of the structure.
        let e = ray.direction / size;
        let o = frame.point(ray.origin);
        shift = -o.dot(e) / e.length_squared();
        let o = o + shift * e;
        reach = o.abs().max_element();
        origin = load(q, o, 0.0);
    }
    // 8 roundings of numbers up to `reach + 1`.
    let pad = 8.0 * f64::from(ROUNDING) * (reach + 1.0) + far;
    // At most 2^30: beyond, the ray does not leave its padding within the structure.
    let least = q.mul(largest, q.splat(2f64.powi(-30)));
    let steps = q.div(largest, q.max(sizes, least));
    let reciprocal = q.copy_sign(steps, direction);
    let offset = q.mul(origin, reciprocal);
    let margin = q.mul(q.splat(pad), steps);
    let signs = q.signs(direction);
    // The last axis among equals.
    let axis = (q.equal(sizes, largest) & 7 | 1).ilog2();
    let turn = &TURNS[(axis | (signs >> axis & 1) << 2) as usize & 7];
    let shear = q.div(
        q.permute(direction, &turn.dividend),
        q.permute(direction, &turn.divisor),
    );
    // Twice the rounding to single precision, and that of the product and the sum below.
    let more = 1.0 + 4.0 * f64::from(ROUNDING);
    let slack = 2f64.powi(-48) * shift.abs();
    let min = interval.min * scale - shift;
    let octant = signs as usize & 7;
    let local = LocalRay {
        reciprocal: q.store_rounded(reciprocal),
        near: q.store_rounded(q.sub(q.splat(0.0), q.add(offset, margin))),
        far: q.store_rounded(q.sub(margin, offset)),
        min: (min - 4.0 * f64::from(ROUNDING) * min.abs() - slack) as f32,
        planes: SIDES[octant],
        octant,
        pace: scale * more,
        start: 64.0 * f64::from(ROUNDING) + slack - shift * more,
    };
    let sheared = Sheared {
        axes: turn.axes,
        origin: q.store(q.permute(world_origin, &turn.origin)),
        shear: q.store(shear),
    };
    Some((local, sheared))
}

#[inline(always)]
fn load<Q: Quad>(q: Q, v: DVec3, fourth: f64) -> Q::Vector {
    q.load([v.x, v.y, v.z, fourth])
}

/// The greatest of the first three lanes, in these lanes; unspecified if one is NaN.
#[inline(always)]
fn greatest<Q: Quad>(q: Q, v: Q::Vector) -> Q::Vector {
    let v = q.max(v, q.permute(v, &const { QuadOrder::new([1, 2, 0, 3]) }));
    q.max(v, q.permute(v, &const { QuadOrder::new([2, 0, 1, 3]) }))
}

impl LocalRay {
    /// An upper bound on the local parameter of `t`, if that is at least -8. The structure ends
    /// before that.
    #[inline(always)]
    pub(crate) fn above(&self, t: f64) -> f32 {
        (t * self.pace + self.start) as f32
    }
}

/// An axis; an enumeration, so that indexing needs no bounds check.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[repr(usize)]
pub(crate) enum Axis {
    #[default]
    X,
    Y,
    Z,
}

/// Planes of boxes: one axis and one side. The number is their offset among those of sixteen boxes,
/// which are sorted by axis, then by side.
#[derive(Clone, Copy, Debug, Default)]
#[repr(usize)]
pub(crate) enum Planes {
    #[default]
    SmallestX = 0,
    LargestX = 16,
    SmallestY = 32,
    LargestY = 48,
    SmallestZ = 64,
    LargestZ = 80,
}

/// The near planes (index 0) and the far planes (index 1) of boxes, by axis, indexed by the signs
/// of a direction, x the lowest bit.
static SIDES: [[[Planes; 3]; 2]; 8] = {
    use Planes::*;
    let all = [
        [SmallestX, LargestX],
        [SmallestY, LargestY],
        [SmallestZ, LargestZ],
    ];
    let mut found = [[[SmallestX; 3]; 2]; 8];
    let mut i = 0;
    while i < 8 * 2 * 3 {
        let (signs, far, axis) = (i / 6, i / 3 % 2, i % 3);
        found[signs][far][axis] = all[axis][(signs >> axis & 1) ^ far];
        i += 1;
    }
    found
};
