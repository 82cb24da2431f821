//! The structure's local coordinates ("own coordinates" in `docs/accelerators.md`), and rays in
//! them.

use whitstone_core::stream::{GROUP, RayStream};
use whitstone_core::triangle::Axis;
use whitstone_core::{Aabb, DVec3, Interval, Ray};
use whitstone_simd::select;

/// Transform to local coordinates, in which the whole structure lies in the cube from -1 to 1.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Frame {
    pub(crate) center: DVec3,
    /// A power of two, so that scaling is exact.
    pub(crate) scale: f64,
    /// Whether `f32` coordinates in the world are exact in `f32` here too.
    exact: bool,
}

impl Frame {
    /// A frame around a box of finite size.
    pub(crate) fn around(aabb: &Aabb) -> Self {
        let center = aabb.center();
        // Uses the corners as they will be computed, so that rounding puts none outside.
        let half = (aabb.max - center).max(center - aabb.min).max_element();
        let exponent = if half > 0.0 { libm::log2(half).ceil() } else { 0.0 };
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

    /// The factor that turns local coordinates into world coordinates exactly, if there is one.
    pub(crate) fn exact(&self) -> Option<f64> {
        self.exact.then_some(1.0 / self.scale)
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

    /// A ray in single precision; `None` for one that is out of range or not a valid ray.
    #[inline(always)]
    pub(crate) fn ray(&self, ray: &Ray, interval: &Interval) -> Option<LocalRay> {
        LocalRay::new::<false>(self, ray, interval, &mut false)
    }

    /// The same for `GROUP` rays of a stream, from `start` on.
    #[inline(always)]
    pub(crate) fn rays(&self, rays: &RayStream, start: usize, local: &mut LocalRays) {
        for k in 0..GROUP {
            let lane = start + k;
            let (ray, interval) = (rays.ray(lane), rays.interval(lane));
            let mut sound = false;
            if let Some(local_ray) = LocalRay::new::<true>(self, &ray, &interval, &mut sound) {
                local.set(k, &local_ray, ray.direction, sound);
            }
        }
    }
}

/// The relative error of a product or sum rounded to `f32`.
pub(crate) const ROUNDING: f32 = f32::EPSILON / 2.0;

/// For each axis, the two axes that follow it, and the axis itself.
static AXES: [[Axis; 3]; 3] = {
    use Axis::*;
    [[Y, Z, X], [Z, X, Y], [X, Y, Z]]
};

/// Offset of eight boxes' planes across one axis, on one side: by axis, by side (0 minimum, 1
/// maximum), by box.
///
/// An enumeration, so that the compiler knows it to be in range: it is used six times per node.
#[derive(Clone, Copy, Debug, Default)]
#[repr(u8)]
pub(crate) enum Planes {
    #[default]
    SmallestX = 0,
    LargestX = 8,
    SmallestY = 16,
    LargestY = 24,
    SmallestZ = 32,
    LargestZ = 40,
}

/// The near planes (index 0) and the far planes (index 1) of boxes, by axis.
type Sides = [[Planes; 3]; 2];

/// Indexed by the signs of a direction, x the lowest bit.
static SIDES: [Sides; 8] = {
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

/// A ray in local coordinates, for the single-precision tests. Its parameter is scaled so that the
/// largest component of the direction is 1 or -1, and counted from `shift`.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct LocalRay {
    /// 1 over the direction, finite.
    pub(crate) reciprocal: [f32; 3],
    /// Added to a near plane times `reciprocal`, this gives a lower bound on the parameter there.
    pub(crate) near: [f32; 3],
    /// Added to a far plane times `reciprocal`, this gives an upper bound on the parameter there.
    pub(crate) far: [f32; 3],
    /// The near and the far planes of boxes, by axis.
    pub(crate) planes: Sides,
    /// The axes; the direction is largest along the last one.
    pub(crate) axes: [Axis; 3],
    /// The origin along `axes`.
    pub(crate) origin: [f32; 3],
    /// The direction along the first two of `axes`, divided by the last component.
    pub(crate) shear: [f32; 2],
    /// The sign of the direction along the last axis.
    pub(crate) sign: f32,
    /// Bound on the error of the sheared coordinates of a point of the structure.
    pub(crate) error: f32,
    /// Bound on the error of a coordinate of the origin or of a point of the structure.
    pub(crate) conversion: f32,
    /// Lower bound of the interval.
    pub(crate) min: f32,
    /// Upper bound of the interval.
    pub(crate) max: f32,
    /// Parameters between these are certainly inside the interval.
    pub(crate) inside: [f32; 2],
    clock: Clock,
}

impl LocalRay {
    /// Whether the near plane of an axis is that of the smallest (0) or largest (1) coordinates.
    #[inline(always)]
    pub(crate) fn side(&self, axis: usize) -> usize {
        self.planes[0][axis] as usize >> 3 & 1
    }

    /// With `STRAIGHT` it is branchless, for loops over many rays: it always returns a ray, and
    /// `sound` says whether that is valid.
    #[inline(always)]
    fn new<const STRAIGHT: bool>(
        frame: &Frame,
        ray: &Ray,
        interval: &Interval,
        sound: &mut bool,
    ) -> Option<Self> {
        let d = ray.direction.to_array();
        let axis = if STRAIGHT {
            largest(d)
        } else {
            let a = d.map(f64::abs);
            match (a[0] > a[1], a[0] > a[2], a[1] > a[2]) {
                (true, true, _) => 0,
                (false, _, true) => 1,
                _ => 2,
            }
        };
        // The coordinates, rotated so that the largest component of the direction comes last.
        let turned = |v: [f64; 3]| {
            if STRAIGHT {
                let pick = |x, y, z| select(axis == 0, x, select(axis == 1, y, z));
                [
                    pick(v[1], v[2], v[0]),
                    pick(v[2], v[0], v[1]),
                    pick(v[0], v[1], v[2]),
                ]
            } else {
                AXES[axis as usize].map(|i| v[i as usize])
            }
        };
        let [dx, dy, dz] = turned(d);
        let largest = dz.abs();
        let scale = largest * frame.scale;
        let mut origin = frame.point(ray.origin);
        let mut reach = origin.abs().max_element();
        let size = origin.x.abs() + origin.y.abs() + origin.z.abs();
        // Written so that NaN fails too.
        *sound = (scale > 1e-200) & (scale < 1e200) & (size < 1e18) & (interval.min < 1e100);
        if !STRAIGHT && !*sound {
            return None;
        }
        // Generous bound on the rounding of the origin in double precision.
        let far = 2f64.powi(-40) * reach;
        let mut shift = 0.0;
        let afar = reach > 4.0;
        if STRAIGHT || afar {
            // For distant origins single precision would be too coarse: start at the point of the
            // ray closest to the center of the structure.
            let e = ray.direction / largest;
            shift = select(afar, -origin.dot(e) / e.length_squared(), 0.0);
            origin += shift * e;
            reach = origin.abs().max_element();
        }
        // 8 roundings of numbers up to `reach + 1`.
        let pad = 8.0 * f64::from(ROUNDING) * (reach + 1.0) + far;
        // Limited to 2^30: beyond, the ray does not leave its padding within the structure.
        let sizes = d.map(|d| less((largest / d).abs(), 2f64.powi(30)));
        let inverse = [0, 1, 2].map(|i| sizes[i].copysign(d[i]));
        let per_z = 1.0 / dz;
        let o = origin.to_array();
        let shifted = |i: usize, by: f64| (-(o[i] * inverse[i]) - by * sizes[i]) as f32;
        let clock = Clock { scale, shift };
        let inside_max = if interval.max < f64::INFINITY {
            clock.below(interval.max)
        } else {
            f32::INFINITY
        };
        let turned_origin = turned(o);
        // One literal: a value that is written in pieces and then copied stalls the processor.
        Some(Self {
            reciprocal: inverse.map(|r| r as f32),
            near: [shifted(0, pad), shifted(1, pad), shifted(2, pad)],
            far: [shifted(0, -pad), shifted(1, -pad), shifted(2, -pad)],
            planes: sides(d.map(side)),
            axes: AXES[axis as usize],
            origin: [
                turned_origin[0] as f32,
                turned_origin[1] as f32,
                turned_origin[2] as f32,
            ],
            shear: [(dx * per_z) as f32, (dy * per_z) as f32],
            sign: 1f32.copysign(dz as f32),
            error: pad as f32 * (1.0 + 2.0 * ROUNDING),
            conversion: ROUNDING * (reach as f32 + 1.0) + far as f32,
            min: clock.below(interval.min),
            max: clock.above(interval.max),
            inside: [clock.above(interval.min), inside_max],
            clock,
        })
    }
}

/// The values of a [`LocalRay`] that are needed to judge a hit.
pub(crate) trait Reach {
    fn max(&self) -> f32;
    fn inside(&self) -> [f32; 2];
    /// An upper bound on the local parameter of `t`.
    fn above(&self, t: f64) -> f32;
    /// The axis along which the direction is longest.
    fn longest(&self) -> Axis;
}

impl Reach for LocalRay {
    #[inline(always)]
    fn max(&self) -> f32 {
        self.max
    }
    #[inline(always)]
    fn inside(&self) -> [f32; 2] {
        self.inside
    }
    #[inline(always)]
    fn above(&self, t: f64) -> f32 {
        self.clock.above(t)
    }
    #[inline(always)]
    fn longest(&self) -> Axis {
        self.axes[2]
    }
}

/// One lane of [`LocalRays`], read in place.
pub(crate) struct LocalLane<'a>(pub(crate) &'a LocalRays, pub(crate) usize);

impl Reach for LocalLane<'_> {
    #[inline(always)]
    fn max(&self) -> f32 {
        self.0.max[self.1]
    }
    #[inline(always)]
    fn inside(&self) -> [f32; 2] {
        [self.0.inside[0][self.1], self.0.inside[1][self.1]]
    }
    #[inline(always)]
    fn above(&self, t: f64) -> f32 {
        let clock = Clock {
            scale: self.0.scale[self.1],
            shift: self.0.shift[self.1],
        };
        clock.above(t)
    }
    #[inline(always)]
    fn longest(&self) -> Axis {
        AXES[self.0.axis[self.1] as usize % 3][2]
    }
}

/// The smaller number; the second if they are unordered.
#[inline(always)]
fn less(x: f64, y: f64) -> f64 {
    select(x < y, x, y)
}

/// The axis along which a direction is largest, branchless.
#[inline(always)]
fn largest(d: [f64; 3]) -> u32 {
    let a = d.map(f64::abs);
    select(a[0] > a[1], select(a[0] > a[2], 0, 2), select(a[1] > a[2], 1, 2))
}

/// Near and far planes, given the sides of the near ones.
#[inline(always)]
fn sides([x, y, z]: [usize; 3]) -> Sides {
    SIDES[(x | y << 1 | z << 2) & 7]
}

#[inline(always)]
fn side(d: f64) -> usize {
    (d.to_bits() >> 63) as usize
}

/// Conversion of world ray parameters to local ones.
#[derive(Clone, Copy, Debug, Default)]
struct Clock {
    scale: f64,
    shift: f64,
}

impl Clock {
    /// A lower bound on the local parameter of `t`.
    #[inline(always)]
    fn below(&self, t: f64) -> f32 {
        let t = t * self.scale - self.shift;
        (t - self.slack(t)) as f32
    }

    /// An upper bound on the local parameter of `t`, which may be infinite.
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

/// [`LocalRay`]s as a structure of arrays.
#[derive(Default)]
#[repr(align(64))]
pub(crate) struct LocalRays {
    pub(crate) reciprocal: [[f32; GROUP]; 3],
    pub(crate) near: [[f32; GROUP]; 3],
    pub(crate) far: [[f32; GROUP]; 3],
    pub(crate) origin: [[f32; GROUP]; 3],
    pub(crate) shear: [[f32; GROUP]; 2],
    pub(crate) inside: [[f32; GROUP]; 2],
    pub(crate) sign: [f32; GROUP],
    pub(crate) error: [f32; GROUP],
    pub(crate) conversion: [f32; GROUP],
    pub(crate) min: [f32; GROUP],
    max: [f32; GROUP],
    sides: [[u32; GROUP]; 3],
    axis: [u32; GROUP],
    scale: [f64; GROUP],
    shift: [f64; GROUP],
    /// Whether a ray is valid; otherwise its values mean nothing.
    pub(crate) sound: [bool; GROUP],
}

impl LocalRays {
    #[inline(always)]
    fn set(&mut self, lane: usize, ray: &LocalRay, direction: DVec3, sound: bool) {
        let d = direction.to_array();
        for axis in 0..3 {
            self.reciprocal[axis][lane] = ray.reciprocal[axis];
            self.near[axis][lane] = ray.near[axis];
            self.far[axis][lane] = ray.far[axis];
            self.origin[axis][lane] = ray.origin[axis];
            self.sides[axis][lane] = side(d[axis]) as u32;
        }
        for i in 0..2 {
            self.shear[i][lane] = ray.shear[i];
            self.inside[i][lane] = ray.inside[i];
        }
        self.sign[lane] = ray.sign;
        self.error[lane] = ray.error;
        self.conversion[lane] = ray.conversion;
        self.min[lane] = ray.min;
        self.max[lane] = ray.max;
        self.axis[lane] = largest(d);
        self.scale[lane] = ray.clock.scale;
        self.shift[lane] = ray.clock.shift;
        self.sound[lane] = sound;
    }

    /// Copies the ray of a lane. Not inlined: for AVX-512 the compiler would turn it into gathers,
    /// which take longer.
    #[inline(never)]
    pub(crate) fn get(&self, lane: usize, to: &mut LocalRay) {
        let lane = lane % GROUP;
        let three = |rows: &[[f32; GROUP]; 3]| [rows[0][lane], rows[1][lane], rows[2][lane]];
        let two = |rows: &[[f32; GROUP]; 2]| [rows[0][lane], rows[1][lane]];
        *to = LocalRay {
            reciprocal: three(&self.reciprocal),
            near: three(&self.near),
            far: three(&self.far),
            planes: sides([0, 1, 2].map(|axis| self.sides[axis][lane] as usize)),
            axes: AXES[self.axis[lane] as usize % 3],
            origin: three(&self.origin),
            shear: two(&self.shear),
            inside: two(&self.inside),
            sign: self.sign[lane],
            error: self.error[lane],
            conversion: self.conversion[lane],
            min: self.min[lane],
            max: self.max[lane],
            clock: Clock {
                scale: self.scale[lane],
                shift: self.shift[lane],
            },
        };
    }

    /// The axes of all rays, if they agree.
    #[inline(always)]
    pub(crate) fn axes(&self) -> Option<[Axis; 3]> {
        let mut same = true;
        for k in 0..GROUP {
            same &= self.axis[k] == self.axis[0];
        }
        same.then(|| AXES[self.axis[0] as usize % 3])
    }

    /// For each axis, the side by which all rays enter boxes, if they agree and are all valid.
    #[inline(always)]
    pub(crate) fn octant(&self) -> Option<[usize; 3]> {
        let mut same = true;
        for k in 0..GROUP {
            same &= self.sound[k];
            for axis in 0..3 {
                same &= self.sides[axis][k] == self.sides[axis][0];
            }
        }
        same.then(|| [0, 1, 2].map(|axis| self.sides[axis][0] as usize & 1))
    }
}

/// The rays of [`LocalRays`] as single rays, for scalar code; each is copied on first use.
#[derive(Default)]
pub(crate) struct Alone {
    rays: [LocalRay; GROUP],
    /// Which rays are already copied, as a bit mask.
    here: u32,
}

impl Alone {
    /// Forgets all rays.
    #[inline(always)]
    pub(crate) fn clear(&mut self) {
        self.here = 0;
    }

    /// A ray, copied on first use.
    #[inline(always)]
    pub(crate) fn get(&mut self, rays: &LocalRays, lane: usize) -> &LocalRay {
        let lane = lane % GROUP;
        if self.here & 1 << lane == 0 {
            self.here |= 1 << lane;
            rays.get(lane, &mut self.rays[lane]);
        }
        &self.rays[lane]
    }
}
