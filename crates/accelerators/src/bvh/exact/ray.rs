//! Rays, prepared for the tests of boxes and of triangles.

use crate::support::leaves::frame::{Frame, ROUNDING};
use whitstone_core::stream::{GROUP, LANES, RayStream};
use whitstone_core::{DVec3, Interval, Ray};
use whitstone_simd::{Doubles, Quad, QuadOrder, WideKernel, WideMachine};

/// A ray in local coordinates, for the single-precision tests of boxes. Its parameter is scaled so
/// that the largest component of the direction is 1 or -1, and counted from a point near the
/// structure. Aligned as [`Stack`](super::stack::Stack) is.
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(align(64))]
pub(super) struct BoxRay {
    /// 1 over the direction, finite. The fourth number counts nowhere, here and below.
    pub(super) reciprocal: [f32; 4],
    /// Added to a near plane times `reciprocal`, this gives a lower bound on the parameter there.
    pub(super) near: [f32; 4],
    /// Added to a far plane times `reciprocal`, this gives an upper bound on the parameter there.
    pub(super) far: [f32; 4],
    /// Lower bound of the interval.
    pub(super) min: f32,
    /// The near planes (index 0) and the far planes (index 1) of boxes, by axis.
    pub(super) planes: &'static [[Planes; 3]; 2],
    /// The signs of the direction, x the lowest bit.
    pub(super) octant: usize,
    clock: Clock,
}

impl Default for BoxRay {
    fn default() -> Self {
        Self {
            reciprocal: [0.0; 4],
            near: [0.0; 4],
            far: [0.0; 4],
            min: 0.0,
            planes: &SIDES[0],
            octant: 0,
            clock: Clock::default(),
        }
    }
}

impl BoxRay {
    /// An upper bound on the local parameter of `t`, if that is at least -8. The structure ends
    /// before that.
    #[inline(always)]
    pub(super) fn above(&self, t: f64) -> f32 {
        self.clock.above(t)
    }
}

/// Conversion of world ray parameters to upper bounds on local ones.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Clock {
    /// Local parameters per world parameter, and the local parameter of 0, both rounded up.
    pace: f64,
    start: f64,
}

impl Clock {
    #[inline(always)]
    fn new(scale: f64, shift: f64) -> Self {
        Self {
            pace: scale * MORE,
            start: 64.0 * f64::from(ROUNDING) + slack(shift) - shift * MORE,
        }
    }

    #[inline(always)]
    fn above(&self, t: f64) -> f32 {
        (t * self.pace + self.start) as f32
    }
}

/// Twice the rounding to single precision, and that of the product and the sum in [`Clock`].
const MORE: f64 = 1.0 + 4.0 * ROUNDING as f64;

/// Bound on the rounding of a local parameter that is counted from `shift`.
#[inline(always)]
fn slack(shift: f64) -> f64 {
    2f64.powi(-48) * shift.abs()
}

/// A lower bound on the local parameter of the lower end of an interval.
#[inline(always)]
fn least(min: f64, scale: f64, shift: f64) -> f32 {
    let min = min * scale - shift;
    (min - 4.0 * f64::from(ROUNDING) * min.abs() - slack(shift)) as f32
}

/// Whether single precision can represent a ray. So written, NaN fails too.
#[inline(always)]
fn is_sound(reach: f64, size: f64, scale: f64, min: f64) -> bool {
    let in_range = (scale > SCALES[0]) & (scale < SCALES[1]);
    (reach < FARTHEST) & (size > SMALLEST) & in_range & (min < 1e100)
}

/// Exclusive bounds on the distance of the origin, and on the local parameters per world parameter.
const FARTHEST: f64 = 1e18;
const SCALES: [f64; 2] = [1e-200, 1e200];

/// Exclusive bound on the largest component of the direction, whose reciprocal must be finite.
const SMALLEST: f64 = 1e-300;

/// The padding of a ray whose origin is at most `reach` from the center: 8 roundings of numbers up
/// to `reach + 1`, and a generous bound on the rounding of the origin in double precision, which
/// was `far` away.
#[inline(always)]
fn padding(reach: f64, far: f64) -> f64 {
    EIGHT * (reach + 1.0) + FINE * far
}

/// Eight roundings, and the bound on the rounding of a distant origin.
const EIGHT: f64 = 8.0 * ROUNDING as f64;
const FINE: f64 = 1.0 / (1u64 << 40) as f64;

/// For distant origins single precision would be too coarse: the parameter of the point of the ray
/// closest to the center, and that point.
#[inline(always)]
fn approach(origin: DVec3, direction: DVec3, largest: f64) -> (f64, DVec3) {
    let e = direction / largest;
    let shift = -origin.dot(e) / e.length_squared();
    (shift, origin + shift * e)
}

/// Above this distance of the origin the parameter is counted from another point.
const AFAR: f64 = 4.0;

/// Bound on the reciprocal of the direction: beyond, the ray does not leave its padding within the
/// structure.
const STEEPEST: f64 = (1 << 30) as f64;

/// An axis; an enumeration, so that indexing needs no bounds check.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[repr(usize)]
pub(super) enum Axis {
    #[default]
    X,
    Y,
    Z,
}

/// A ray for the double-precision tests of triangles: the numbers of
/// [`ShearedRay`](whitstone_core::triangle::ShearedRay), whose first three lanes count.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Sheared {
    /// The world axes that become x, y and z.
    pub(super) axes: [Axis; 3],
    /// The origin along `axes`.
    pub(super) origin: [f64; 4],
    /// The direction along x and y per unit of z, and the ray parameter per unit of z.
    pub(super) shear: [f64; 4],
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

/// Offset of sixteen boxes' planes across one axis, on one side: by axis, by side, by box.
///
/// An enumeration, so that the compiler knows it to be in range.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[repr(usize)]
pub(super) enum Planes {
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

/// A ray for the tests of boxes and of triangles. `None` if it is out of range or not a valid ray.
#[inline(always)]
pub(super) fn prepare<Q: Quad>(
    q: Q,
    frame: &Frame,
    ray: &Ray,
    interval: &Interval,
) -> Option<(BoxRay, Sheared)> {
    // What the first box test waits for comes first: the chain of dependent operations from the
    // ray to there is a fifth of the time of a primary ray.
    let direction = load(q, ray.direction, 1.0);
    let sizes = q.abs(direction);
    let largest = greatest(q, sizes);
    // Not divided by the sizes, so that the division need not wait for the largest.
    let steps = q.mul(largest, q.div(q.splat(1.0), sizes));
    let steps = q.min(steps, q.splat(STEEPEST));
    let world_origin = load(q, ray.origin, 0.0);
    let moved = q.sub(world_origin, load(q, frame.center, 0.0));
    let mut origin = q.mul(moved, q.splat(frame.scale));
    let distance = greatest(q, q.abs(moved));
    // `padding` with two equal distances.
    let pad = q.mul(distance, q.splat(frame.scale * (EIGHT + FINE)));
    let mut pad = q.add(pad, q.splat(EIGHT));
    let size = q.store(largest)[0];
    let scale = size * frame.scale;
    let far = q.store(distance)[0] * frame.scale;
    // NaN is not equal to itself.
    let valid = q.equal(origin, origin) == 15;
    if !(is_sound(far, size, scale, interval.min) & valid) {
        return None;
    }
    let mut shift = 0.0;
    if far > AFAR {
        let near;
        (shift, near) = approach(frame.point(ray.origin), ray.direction, size);
        pad = q.splat(padding(near.abs().max_element(), far));
        origin = load(q, near, 0.0);
    }
    let reciprocal = q.copy_sign(steps, direction);
    let offset = q.mul(origin, reciprocal);
    let margin = q.mul(pad, steps);
    let signs = q.signs(direction);
    // The last axis among equals.
    let axis = (q.equal(sizes, largest) & 7 | 1).ilog2();
    let turn = &TURNS[(axis | (signs >> axis & 1) << 2) as usize & 7];
    let shear = q.div(
        q.permute(direction, &turn.dividend),
        q.permute(direction, &turn.divisor),
    );
    let octant = signs as usize & 7;
    let local = BoxRay {
        reciprocal: q.store_rounded(reciprocal),
        near: q.store_rounded(q.sub(q.negate(offset), margin)),
        far: q.store_rounded(q.sub(margin, offset)),
        min: least(interval.min, scale, shift),
        planes: &SIDES[octant],
        octant,
        clock: Clock::new(scale, shift),
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
    let next = q.permute(v, &const { QuadOrder::new([1, 2, 0, 3]) });
    let last = q.permute(v, &const { QuadOrder::new([2, 0, 1, 3]) });
    q.max(q.max(v, next), last)
}

/// [`BoxRay`]s and [`Sheared`]s of [`GROUP`] rays of a stream, as a structure of arrays.
#[derive(Default)]
#[repr(align(64))]
pub(super) struct Rays {
    pub(super) reciprocal: [[f32; GROUP]; 3],
    pub(super) near: [[f32; GROUP]; 3],
    pub(super) far: [[f32; GROUP]; 3],
    pub(super) min: [f32; GROUP],
    /// Along the axes of each ray.
    pub(super) origin: [[f64; GROUP]; 3],
    pub(super) shear: [[f64; GROUP]; 3],
    pace: [f64; GROUP],
    start: [f64; GROUP],
    /// Bit masks of rays: whose direction is negative along each axis, whose axis z of the triangle
    /// test is the world's x or y, and whose direction is negative along that axis.
    negative: [u32; 3],
    longest: [u32; 2],
    back: u32,
    /// The valid rays; the values of others mean nothing.
    sound: u32,
}

/// Prepares the rays of a stream from `start` on, all at once: the same numbers as [`prepare`]
/// gives.
pub(super) struct Prepare<'a> {
    pub(super) frame: &'a Frame,
    pub(super) rays: &'a RayStream,
    pub(super) start: usize,
    pub(super) to: &'a mut Rays,
}

impl WideKernel for Prepare<'_> {
    type Output = ();

    #[inline(always)]
    fn run<M: WideMachine>(self, m: M) {
        let Self {
            frame,
            rays,
            start,
            to,
        } = self;
        (to.negative, to.longest, to.back, to.sound) = ([0; 3], [0; 2], 0, 0);
        for half in 0..GROUP / 8 {
            let (origin, direction) = (rays.origin.columns(), rays.direction.columns());
            let row = start / 8 + half;
            let load = |columns: [&[f64; LANES]; 3]| columns.map(|column| column.as_chunks::<8>().0[row]);
            to.set(m.doubles(), half, frame, &load(origin), &load(direction));
        }
    }
}

impl Rays {
    #[inline(always)]
    fn set<D: Doubles>(
        &mut self,
        d: D,
        half: usize,
        frame: &Frame,
        origin: &[[f64; 8]; 3],
        direction: &[[f64; 8]; 3],
    ) {
        let (zero, one) = (d.splat(0.0), d.splat(1.0));
        let v = [
            d.load(&direction[0]),
            d.load(&direction[1]),
            d.load(&direction[2]),
        ];
        let world = [d.load(&origin[0]), d.load(&origin[1]), d.load(&origin[2])];
        let a = [d.abs(v[0]), d.abs(v[1]), d.abs(v[2])];
        let size = d.max(d.max(a[0], a[1]), a[2]);
        let scale = d.mul(size, d.splat(frame.scale));
        let center = frame.center.to_array();
        let mut o = [zero; 3];
        for i in 0..3 {
            let moved = d.sub(world[i], d.splat(center[i]));
            o[i] = d.mul(moved, d.splat(frame.scale));
        }
        let far = largest(d, o);
        let sum = d.add(d.add(o[0], o[1]), o[2]);
        // NaN is not equal to itself.
        let sound = d.less(far, d.splat(FARTHEST))
            & d.less(d.splat(SMALLEST), size)
            & d.less(d.splat(SCALES[0]), scale)
            & d.less(scale, d.splat(SCALES[1]))
            & d.at_most(sum, sum);
        let mut pad = d.add(d.mul(far, d.splat(EIGHT + FINE)), d.splat(EIGHT));
        let mut shift = zero;
        let afar = d.less(d.splat(AFAR), far);
        if afar != 0 {
            // As `approach` does.
            let e = [d.div(v[0], size), d.div(v[1], size), d.div(v[2], size)];
            let by = d.div(d.sub(zero, dot(d, o, e)), dot(d, e, e));
            shift = d.select(afar, by, zero);
            for i in 0..3 {
                o[i] = d.add(o[i], d.mul(shift, e[i]));
            }
            let reach = d.mul(d.splat(EIGHT), d.add(largest(d, o), one));
            pad = d.select(afar, d.add(reach, d.mul(d.splat(FINE), far)), pad);
        }
        for i in 0..3 {
            let steps = d.mul(size, d.div(one, a[i]));
            let steps = d.min(steps, d.splat(STEEPEST));
            let reciprocal = d.copy_sign(steps, v[i]);
            let (offset, margin) = (d.mul(o[i], reciprocal), d.mul(pad, steps));
            d.round(reciprocal, part(&mut self.reciprocal[i], half));
            d.round(d.sub(d.sub(zero, offset), margin), part(&mut self.near[i], half));
            d.round(d.sub(margin, offset), part(&mut self.far[i], half));
            self.negative[i] |= d.signs(v[i]) << (8 * half);
        }
        let slack = d.mul(d.splat(2f64.powi(-48)), d.abs(shift));
        // The lower end of the interval is 0.
        let min = d.sub(zero, shift);
        let rounding = d.mul(d.splat(4.0 * f64::from(ROUNDING)), d.abs(min));
        d.round(d.sub(d.sub(min, rounding), slack), part(&mut self.min, half));
        let more = d.splat(MORE);
        d.store(d.mul(scale, more), part(&mut self.pace, half));
        let begin = d.add(d.splat(64.0 * f64::from(ROUNDING)), slack);
        d.store(d.sub(begin, d.mul(shift, more)), part(&mut self.start, half));
        // The last axis among equals.
        let x_longest = d.less(a[1], a[0]) & d.less(a[2], a[0]);
        let y_longest = d.less(a[2], a[1]) & !x_longest & !d.less(a[1], a[0]);
        let longest = [x_longest, y_longest];
        let z = turned(d, longest, v);
        let back = d.less(z, zero);
        let [x, y] = across(d, longest, back, world);
        d.store(x, part(&mut self.origin[0], half));
        d.store(y, part(&mut self.origin[1], half));
        d.store(turned(d, longest, world), part(&mut self.origin[2], half));
        let [x, y] = across(d, longest, back, v);
        d.store(d.div(x, z), part(&mut self.shear[0], half));
        d.store(d.div(y, z), part(&mut self.shear[1], half));
        d.store(d.div(one, z), part(&mut self.shear[2], half));
        self.longest[0] |= x_longest << (8 * half);
        self.longest[1] |= y_longest << (8 * half);
        self.back |= back << (8 * half);
        self.sound |= sound << (8 * half);
    }

    /// Whether a ray is valid.
    #[inline(always)]
    pub(super) fn is_sound(&self, k: usize) -> bool {
        self.sound >> (k % GROUP) & 1 == 1
    }

    /// Whether all rays are valid.
    #[inline(always)]
    pub(super) fn are_sound(&self) -> bool {
        self.sound == (1 << GROUP) - 1
    }

    /// An upper bound on the local parameter of `t` of a ray.
    #[inline(always)]
    pub(super) fn above(&self, k: usize, t: f64) -> f32 {
        self.clock(k).above(t)
    }

    #[inline(always)]
    fn clock(&self, k: usize) -> Clock {
        Clock {
            pace: self.pace[k],
            start: self.start[k],
        }
    }

    /// The numbers of these masks at a ray's place, as the bits of a number.
    #[inline(always)]
    fn bits(masks: [u32; 3], k: usize) -> usize {
        let [x, y, z] = masks.map(|mask| (mask >> (k % GROUP) & 1) as usize);
        x | y << 1 | z << 2
    }

    /// The axes of the triangle test of a ray.
    #[inline(always)]
    fn turn(&self, k: usize) -> &'static Turn {
        let [x, y] = self.longest;
        &TURNS[Self::bits([y, !(x | y), self.back], k)]
    }

    /// Copies a ray. Not inlined: the compiler would turn it into gathers, which take longer.
    #[inline(never)]
    pub(super) fn get(&self, k: usize, local: &mut BoxRay, sheared: &mut Sheared) {
        let k = k % GROUP;
        let single = |rows: &[[f32; GROUP]; 3]| [rows[0][k], rows[1][k], rows[2][k], 0.0];
        let double = |rows: &[[f64; GROUP]; 3]| [rows[0][k], rows[1][k], rows[2][k], 0.0];
        let octant = Self::bits(self.negative, k);
        *local = BoxRay {
            reciprocal: single(&self.reciprocal),
            near: single(&self.near),
            far: single(&self.far),
            min: self.min[k],
            planes: &SIDES[octant],
            octant,
            clock: self.clock(k),
        };
        *sheared = Sheared {
            axes: self.turn(k).axes,
            origin: double(&self.origin),
            shear: double(&self.shear),
        };
    }

    /// The axes of all rays, if they agree.
    #[inline(always)]
    pub(super) fn axes(&self) -> Option<[Axis; 3]> {
        let all = (1 << GROUP) - 1;
        let same = |mask: u32| mask == 0 || mask == all;
        (same(self.longest[0]) & same(self.longest[1]) & same(self.back)).then(|| self.turn(0).axes)
    }
}

/// Eight numbers of a row.
#[inline(always)]
fn part<T>(row: &mut [T; GROUP], half: usize) -> &mut [T; 8] {
    &mut row.as_chunks_mut().0[half % 2]
}

/// The largest component of vectors.
#[inline(always)]
fn largest<D: Doubles>(d: D, v: [D::Vector; 3]) -> D::Vector {
    d.max(d.max(d.abs(v[0]), d.abs(v[1])), d.abs(v[2]))
}

#[inline(always)]
fn dot<D: Doubles>(d: D, v: [D::Vector; 3], w: [D::Vector; 3]) -> D::Vector {
    d.add(d.add(d.mul(v[0], w[0]), d.mul(v[1], w[1])), d.mul(v[2], w[2]))
}

/// The first number where x is the longest axis, the second where it is y, else the third.
#[inline(always)]
fn turned<D: Doubles>(d: D, longest: [u32; 2], v: [D::Vector; 3]) -> D::Vector {
    d.select(longest[0], v[0], d.select(longest[1], v[1], v[2]))
}

/// The coordinates along the other two axes, exchanged where the direction is negative along z.
#[inline(always)]
fn across<D: Doubles>(d: D, longest: [u32; 2], back: u32, v: [D::Vector; 3]) -> [D::Vector; 2] {
    let x = turned(d, longest, [v[1], v[2], v[0]]);
    let y = turned(d, longest, [v[2], v[0], v[1]]);
    [d.select(back, y, x), d.select(back, x, y)]
}

/// The octant of the directions of a group of rays, if they agree.
#[inline(always)]
pub(super) fn octant(rays: &RayStream, start: usize) -> Option<usize> {
    let mut octant = 0;
    for (axis, column) in rays.direction.columns().into_iter().enumerate() {
        let row = column.as_chunks::<GROUP>().0[start / GROUP];
        let negative = row.iter().fold(0, |all, d| all + (d.to_bits() >> 63));
        if negative == GROUP as u64 {
            octant |= 1 << axis;
        } else if negative != 0 {
            return None;
        }
    }
    Some(octant)
}

#[cfg(test)]
mod tests {
    use super::*;
    use whitstone_core::{Aabb, SelfHitFilter};
    use whitstone_simd::{Portable, with_wide_lanes};
    use whitstone_testkit::Random;

    /// Directions with equal and with missing components, and arbitrary ones.
    fn direction(i: usize, random: &mut Random) -> DVec3 {
        let signs = DVec3::new([1.0, -1.0][i % 2], [1.0, -1.0][i / 2 % 2], [1.0, -1.0][i / 4 % 2]);
        signs
            * match i / 8 % 7 {
                0 => DVec3::ONE,
                1 => DVec3::new(1.0, 1.0, 0.5),
                2 => DVec3::new(0.5, 1.0, 1.0),
                3 => DVec3::new(1.0, 0.5, 1.0),
                4 => DVec3::new(0.0, 1e-20, 3.0),
                // Not valid.
                5 => DVec3::new(1e-310, 2e-308, 1e-320),
                _ => 7.0 * random.direction(),
            }
    }

    /// The first three numbers of a ray for boxes.
    fn three(ray: &BoxRay) -> BoxRay {
        let three = |[x, y, z, _]: [f32; 4]| [x, y, z, 0.0];
        BoxRay {
            reciprocal: three(ray.reciprocal),
            near: three(ray.near),
            far: three(ray.far),
            ..*ray
        }
    }

    #[test]
    fn many_rays_are_prepared_as_one_is() {
        let min = DVec3::new(-1.0, 2.0, 3.0);
        let max = DVec3::new(5.0, 4.0, 9.0);
        let frame = Frame::around(&Aabb { min, max });
        let mut random = Random::new(1);
        let mut stream = RayStream {
            len: LANES,
            ..RayStream::default()
        };
        for lane in 0..LANES {
            // Inside, far away, and not valid.
            let size = [1.0, 10.0, 1e6, 1e19, f64::NAN][lane % 5];
            let origin = min + size * random.cube();
            let ray = Ray::new(origin, direction(lane, &mut random));
            stream.set(lane, ray, f64::INFINITY, SelfHitFilter::NOTHING);
        }
        let mut rays = Rays::default();
        let mut valid = 0;
        for start in stream.groups() {
            with_wide_lanes(Prepare {
                frame: &frame,
                rays: &stream,
                start,
                to: &mut rays,
            });
            for k in 0..GROUP {
                let (ray, interval) = (stream.ray(start + k), stream.interval(start + k));
                let expected = prepare(Portable, &frame, &ray, &interval);
                assert_eq!(rays.is_sound(k), expected.is_some(), "{ray:?}");
                let Some((expected_box, expected_sheared)) = expected else {
                    continue;
                };
                valid += 1;
                let (mut local, mut sheared) = Default::default();
                rays.get(k, &mut local, &mut sheared);
                assert_eq!(three(&local), three(&expected_box), "{ray:?}");
                assert_eq!(sheared.axes, expected_sheared.axes, "{ray:?}");
                for i in 0..3 {
                    assert_eq!(sheared.origin[i], expected_sheared.origin[i], "{ray:?}");
                    assert_eq!(sheared.shear[i], expected_sheared.shear[i], "{ray:?}");
                }
            }
        }
        assert!(valid > LANES / 2, "{valid}");
    }

    #[test]
    fn only_rays_of_one_octant_are_coherent() {
        let mut stream = RayStream {
            len: GROUP,
            ..RayStream::default()
        };
        for lane in 0..GROUP {
            let ray = Ray::new(DVec3::ZERO, DVec3::new(1.0, -2.0, -0.0));
            stream.set(lane, ray, 1.0, SelfHitFilter::NOTHING);
        }
        assert_eq!(octant(&stream, 0), Some(6));
        stream.set(
            7,
            Ray::new(DVec3::ZERO, DVec3::new(1.0, -2.0, 0.0)),
            1.0,
            SelfHitFilter::NOTHING,
        );
        assert_eq!(octant(&stream, 0), None);
    }
}
