//! The tests of leaves in double precision, and the best hit of a ray.

use super::ray::{BoxRay, Rays, Sheared, prepare};
use crate::support::leaves::child::WIDTH;
use crate::support::leaves::filter::{NUMBERS, WINDOW};
use crate::support::leaves::state::RayQuery;
use crate::support::leaves::{Leaves, Slot};
use whitstone_core::stream::{GROUP, NO_SHAPE};
use whitstone_core::triangle::ShearedRay;
use whitstone_core::{DVec2, Element, InstanceId, Interval, PreliminaryIntersection, ShapeHit};
use whitstone_simd::{Doubles, Quad, prefetch};

/// A hit of which only the existence counts.
const SOMEWHERE: PreliminaryIntersection = PreliminaryIntersection {
    t: 0.0,
    prim_uv: DVec2::ZERO,
    instance: InstanceId::TOP_LEVEL,
    shape: 0,
    primitive: 0,
};

/// The best hit of a ray so far, and what triangle tests read of the ray.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Best {
    pub(super) hit: Option<PreliminaryIntersection>,
    /// A hit counts if its parameter is greater than this ...
    min: f64,
    /// ... and at most this. Hits at the distance of the best one still count: a lower index wins
    /// the tie.
    pub(super) max: f64,
    pub(super) sheared: Sheared,
    /// The triangle that the ray starts from.
    skip: Slot,
}

impl Best {
    /// Starts a search and tests the unbounded elements. Returns the ray to traverse the structure
    /// with; `None` if the search is over.
    #[inline(always)]
    pub(super) fn start<const ANY: bool, Q: Quad>(
        &mut self,
        q: Q,
        leaves: &Leaves,
        query: &impl RayQuery,
    ) -> Option<BoxRay> {
        if !self.restart::<ANY>(leaves, query) {
            return None;
        }
        let Some((local, sheared)) = prepare(q, &leaves.frame, &query.ray(), &query.interval()) else {
            self.try_slots(leaves, query);
            return None;
        };
        self.sheared = sheared;
        Some(local)
    }

    /// Starts a search and tests the unbounded elements. Returns whether the structure must be
    /// searched.
    #[inline(always)]
    pub(super) fn restart<const ANY: bool>(&mut self, leaves: &Leaves, query: &impl RayQuery) -> bool {
        let interval = query.interval();
        // Field by field: a value that is written in pieces and then copied stalls the processor.
        self.hit = None;
        self.min = interval.min;
        self.max = below(interval.max);
        self.skip = match query.skip().id() {
            Some((InstanceId::TOP_LEVEL, shape, triangle)) => Slot { shape, triangle },
            _ => Slot {
                shape: NO_SHAPE,
                triangle: 0,
            },
        };
        if !leaves.unbounded.is_empty() {
            self.try_all(leaves, query, leaves.unbounded.iter().copied());
            if ANY && self.hit.is_some() {
                return false;
            }
        }
        !leaves.slots.is_empty()
    }

    /// Tests all other elements, with a ray that single precision cannot represent.
    #[cold]
    pub(super) fn try_slots(&mut self, leaves: &Leaves, query: &impl RayQuery) {
        self.try_all(leaves, query, leaves.slots.iter().map(|slot| slot.element()));
    }

    /// The limit beyond which boxes do not count.
    #[inline(always)]
    pub(super) fn limit(&self, local: &BoxRay) -> f32 {
        local.above(self.max)
    }

    /// Tests some elements.
    #[cold]
    #[inline(never)]
    fn try_all(&mut self, leaves: &Leaves, query: &impl RayQuery, elements: impl Iterator<Item = Element>) {
        for element in elements {
            self.try_element(leaves, query, element);
        }
    }

    /// Tests an element of any kind. Returns whether it is the best hit.
    #[inline(never)]
    pub(super) fn try_element(&mut self, leaves: &Leaves, query: &impl RayQuery, element: Element) -> bool {
        let ray = query.ray();
        let open = Interval {
            min: self.min,
            max: self.max.next_up(),
        };
        let sheared = ShearedRay::new(&ray);
        let hit = leaves
            .geometry
            .intersect(element, &ray, &sheared, open, query.skip());
        hit.is_some_and(|hit| self.offer(hit))
    }

    /// Keeps a hit if it is the best so far. Returns whether it is.
    #[inline(always)]
    fn offer(&mut self, hit: PreliminaryIntersection) -> bool {
        let better = self.hit.as_ref().is_none_or(|best| hit.is_nearer_than(best));
        if better {
            self.max = hit.t;
            self.hit = Some(hit);
        }
        better
    }

    /// Tests the triangles of a leaf. Returns whether one of them is the best hit.
    #[inline(always)]
    pub(super) fn try_triangles<const ANY: bool, D: Doubles>(
        &mut self,
        d: D,
        leaves: &Leaves,
        first: usize,
        count: usize,
    ) -> bool {
        // This changes nothing, but lets the compiler omit bounds checks.
        let count = count.min(WIDTH);
        if leaves.doubles.is_empty() {
            match leaves.numbers[NUMBERS * first..].first_chunk() {
                Some(numbers) => {
                    self.try_window::<ANY, _, _>(d, leaves, (numbers, leaves.exact), first, count)
                }
                None => false,
            }
        } else {
            match leaves.doubles[NUMBERS * first..].first_chunk() {
                Some(numbers) => self.try_window::<ANY, _, _>(d, leaves, (numbers, 1.0), first, count),
                None => false,
            }
        }
    }

    #[inline(always)]
    fn try_window<const ANY: bool, D: Doubles, T: Row>(
        &mut self,
        d: D,
        leaves: &Leaves,
        (numbers, factor): (&[T; WINDOW], f64),
        first: usize,
        count: usize,
    ) -> bool {
        let slots = &leaves.slots[first..];
        // A hit compares its slot with that of the triangle which the ray leaves.
        prefetch(&slots[..count]);
        let triangles = self.triangles(numbers, factor, count);
        let sides = Sides::new(d, &triangles);
        let valid = (1 << count) - 1;
        // Most leaves end here; the next branch is then easy to predict.
        if sides.mask & valid == 0 {
            return false;
        }
        let reached = sides.reach(d, &triangles, valid);
        if reached.mask == 0 {
            return false;
        }
        if ANY {
            let mut sure = reached.mask & reached.sure;
            while sure != 0 {
                let lane = sure.trailing_zeros() as usize;
                sure &= sure - 1;
                if self.accept(slots[lane]) {
                    return true;
                }
            }
        }
        let hits = reached.intersect(d, &self.triangles(numbers, factor, count));
        let mut mask = hits.mask;
        let mut better = false;
        while mask != 0 {
            let lane = mask.trailing_zeros() as usize;
            mask &= mask - 1;
            better |= self.offer_lane(d, &hits, lane, slots[lane]);
        }
        better
    }

    /// The ray, and the triangles of a leaf.
    #[inline(always)]
    fn triangles<'a, T>(&'a self, numbers: &'a [T; WINDOW], factor: f64, count: usize) -> Triangles<'a, T> {
        Triangles {
            numbers,
            factor,
            count,
            best: self,
        }
    }

    /// Keeps the hit of a lane if it is the best so far. Returns whether it is.
    #[inline(always)]
    pub(super) fn offer_lane<D: Doubles>(
        &mut self,
        d: D,
        hits: &Hits<D::Vector>,
        lane: usize,
        slot: Slot,
    ) -> bool {
        if slot == self.skip {
            return false;
        }
        let hit = ShapeHit {
            t: d.lane(hits.t, lane),
            primitive: slot.triangle,
            prim_uv: DVec2::new(d.lane(hits.u, lane), d.lane(hits.v, lane)),
        };
        self.offer(hit.of_shape(InstanceId::TOP_LEVEL, slot.shape))
    }

    /// Notes that the triangle of this slot is hit somewhere, unless the ray starts from it.
    /// Returns whether it does not.
    #[inline(always)]
    pub(super) fn accept(&mut self, slot: Slot) -> bool {
        let other = slot != self.skip;
        if other {
            self.hit = Some(SOMEWHERE);
        }
        other
    }
}

/// The next smaller number; the first case is the usual one, without the branches of the other.
#[inline(always)]
fn below(x: f64) -> f64 {
    if x > 0.0 {
        f64::from_bits(x.to_bits() - 1)
    } else {
        x.next_down()
    }
}

/// A number of a leaf.
pub(super) trait Row: Copy {
    /// Eight numbers relative to that of the ray's origin.
    fn relative<D: Doubles>(d: D, row: &[Self; 8], factor: f64, origin: D::Vector) -> D::Vector;
}

impl Row for f32 {
    #[inline(always)]
    fn relative<D: Doubles>(d: D, row: &[Self; 8], factor: f64, origin: D::Vector) -> D::Vector {
        d.exact_mul_sub(d.widen(row), d.splat(factor), origin)
    }
}

impl Row for f64 {
    #[inline(always)]
    fn relative<D: Doubles>(d: D, row: &[Self; 8], _: f64, origin: D::Vector) -> D::Vector {
        d.sub(d.load(row), origin)
    }
}

/// Pairs of a ray and a triangle, one per lane: one ray and the triangles of a leaf, or one
/// triangle and the rays of a packet.
///
/// Methods instead of fields: a value that is the same in all lanes is loaded where it is used; a
/// stored one would be spilled.
pub(super) trait Pairs<D: Doubles> {
    /// A coordinate of a corner relative to the ray's origin, along the `i`-th axis of the ray.
    fn coordinate(&self, d: D, corner: usize, i: usize) -> D::Vector;
    fn shear(&self, d: D, i: usize) -> D::Vector;
    /// Hits count if their parameter is greater than this ...
    fn min(&self, d: D) -> D::Vector;
    /// ... and at most this.
    fn max(&self, d: D) -> D::Vector;
}

/// A ray, and the triangles of a leaf.
struct Triangles<'a, T> {
    /// The numbers of the leaf, and then unrelated ones.
    numbers: &'a [T; WINDOW],
    factor: f64,
    /// The number of triangles in the leaf, at most 8.
    count: usize,
    best: &'a Best,
}

impl<T: Row, D: Doubles> Pairs<D> for Triangles<'_, T> {
    #[inline(always)]
    fn coordinate(&self, d: D, corner: usize, i: usize) -> D::Vector {
        // The last of 9 rows begins at 8 times the count at most.
        let along = self.best.sheared.axes[i] as usize * (3 * self.count);
        match self.numbers[along + corner * self.count..].first_chunk() {
            Some(row) => T::relative(d, row, self.factor, d.splat(self.best.sheared.origin[i])),
            None => d.splat(f64::NAN),
        }
    }
    #[inline(always)]
    fn shear(&self, d: D, i: usize) -> D::Vector {
        d.splat(self.best.sheared.shear[i])
    }
    #[inline(always)]
    fn min(&self, d: D) -> D::Vector {
        d.splat(self.best.min)
    }
    #[inline(always)]
    fn max(&self, d: D) -> D::Vector {
        d.splat(self.best.max)
    }
}

/// Eight rays of a group with the same axes, and a triangle.
pub(super) struct Beam<'a> {
    pub(super) rays: &'a Rays,
    /// Which half of the rays.
    pub(super) half: usize,
    /// The corners, with coordinates along the axes of the rays.
    pub(super) corners: &'a [[f64; 3]; 3],
    pub(super) max: &'a [f64; GROUP],
}

impl Beam<'_> {
    #[inline(always)]
    fn half<'a>(&self, all: &'a [f64; GROUP]) -> &'a [f64; 8] {
        &all.as_chunks().0[self.half % 2]
    }
}

impl<D: Doubles> Pairs<D> for Beam<'_> {
    #[inline(always)]
    fn coordinate(&self, d: D, corner: usize, i: usize) -> D::Vector {
        d.sub(
            d.splat(self.corners[corner][i]),
            d.load(self.half(&self.rays.origin[i])),
        )
    }
    #[inline(always)]
    fn shear(&self, d: D, i: usize) -> D::Vector {
        d.load(self.half(&self.rays.shear[i]))
    }
    #[inline(always)]
    fn min(&self, d: D) -> D::Vector {
        // Rays of streams begin at 0.
        d.splat(0.0)
    }
    #[inline(always)]
    fn max(&self, d: D) -> D::Vector {
        d.load(self.half(self.max))
    }
}

/// A corner in sheared coordinates, in which the ray is the third axis.
///
/// Functions instead of closures, here and below: closures would not be compiled for the lanes'
/// instruction set.
#[inline(always)]
fn corner<D: Doubles>(d: D, pairs: &impl Pairs<D>, corner: usize) -> [D::Vector; 3] {
    let x = pairs.coordinate(d, corner, 0);
    let y = pairs.coordinate(d, corner, 1);
    let z = pairs.coordinate(d, corner, 2);
    [
        d.sub(x, d.mul(pairs.shear(d, 0), z)),
        d.sub(y, d.mul(pairs.shear(d, 1), z)),
        z,
    ]
}

/// The first part of the test of [`ShearedRay::intersect`], in the same order of operations, with
/// all lanes at once: on which sides of the edges the ray passes.
///
/// No closures: they would not be compiled for the lanes' instruction set.
pub(super) struct Sides<V> {
    /// The lanes whose triangles may be hit by the line of the ray, as a bit mask.
    pub(super) mask: u32,
    /// Sheared coordinates of the corners a, b and c.
    corners: [[V; 3]; 3],
    /// Scaled barycentric coordinates.
    weights: [V; 3],
}

impl<V: Copy> Sides<V> {
    #[inline(always)]
    pub(super) fn new<D: Doubles<Vector = V>>(d: D, pairs: &impl Pairs<D>) -> Self {
        let corners = [corner(d, pairs, 0), corner(d, pairs, 1), corner(d, pairs, 2)];
        let [a, b, c] = corners;
        let weights = [
            cross(d, [c[0], c[1]], [b[0], b[1]]),
            cross(d, [a[0], a[1]], [c[0], c[1]]),
            cross(d, [b[0], b[1]], [a[0], a[1]]),
        ];
        let lowest = d.min(d.min(weights[0], weights[1]), weights[2]);
        let highest = d.max(d.max(weights[0], weights[1]), weights[2]);
        let zero = d.splat(0.0);
        Self {
            mask: d.less(lowest, zero) ^ d.less(zero, highest),
            corners,
            weights,
        }
    }

    /// The second part: whether the ray reaches the triangle in its interval. The parameter of a
    /// hit is between those of the nearest and the farthest corner, also after rounding. Nearly all
    /// triangles that pass are hit, so the processor predicts what depends on the third part.
    #[inline(always)]
    pub(super) fn reach<D: Doubles<Vector = V>>(self, d: D, pairs: &impl Pairs<D>, valid: u32) -> Reached<V> {
        let [a, b, c] = self.corners;
        let determinant = d.add(d.add(self.weights[0], self.weights[1]), self.weights[2]);
        let finite = d.less(d.abs(determinant), d.splat(f64::INFINITY));
        let least = d.min(d.min(a[2], b[2]), c[2]);
        let most = d.max(d.max(a[2], b[2]), c[2]);
        let scale = pairs.shear(d, 2);
        let ends = [d.mul(least, scale), d.mul(most, scale)];
        let (near, far) = (d.min(ends[0], ends[1]), d.max(ends[0], ends[1]));
        let (min, max) = (pairs.min(d), pairs.max(d));
        Reached {
            mask: self.mask & valid & finite & d.less(min, far) & d.at_most(near, max),
            sure: d.less(min, near) & d.at_most(far, max),
            determinant,
            least,
            most,
            sides: self,
        }
    }
}

/// The result of the second part of the test.
pub(super) struct Reached<V> {
    /// The lanes whose triangles may be hit in the interval, as a bit mask.
    pub(super) mask: u32,
    /// Those that are hit in the interval, wherever that is on them, if they are hit at all.
    pub(super) sure: u32,
    determinant: V,
    /// Bounds on the coordinate along the ray.
    least: V,
    most: V,
    sides: Sides<V>,
}

/// The lanes whose triangles are hit, as a bit mask, and the hits.
pub(super) struct Hits<V> {
    pub(super) mask: u32,
    t: V,
    u: V,
    v: V,
}

impl<V: Copy> Reached<V> {
    /// The third part: the hits in the interval.
    #[inline(always)]
    pub(super) fn intersect<D: Doubles<Vector = V>>(&self, d: D, pairs: &impl Pairs<D>) -> Hits<V> {
        let Sides { corners, weights, .. } = self.sides;
        let [a, b, c] = corners;
        let reciprocal = d.div(d.splat(1.0), self.determinant);
        let shares = [
            d.mul(weights[0], reciprocal),
            d.mul(weights[1], reciprocal),
            d.mul(weights[2], reciprocal),
        ];
        let offset = [mean(d, shares, corners, 0), mean(d, shares, corners, 1)];
        let e = [d.sub(b[0], a[0]), d.sub(b[1], a[1]), d.sub(b[2], a[2])];
        let f = [d.sub(c[0], a[0]), d.sub(c[1], a[1]), d.sub(c[2], a[2])];
        let u = d.mul(cross(d, offset, [f[0], f[1]]), reciprocal);
        let v = d.mul(cross(d, [e[0], e[1]], offset), reciprocal);
        let change = d.add(d.mul(u, e[2]), d.mul(v, f[2]));
        let depth = d.add(mean(d, shares, corners, 2), change);
        let depth = d.min(d.max(depth, self.least), self.most);
        let t = d.mul(depth, pairs.shear(d, 2));
        let (min, max) = (pairs.min(d), pairs.max(d));
        let (zero, one) = (d.splat(0.0), d.splat(1.0));
        Hits {
            mask: self.mask & d.less(min, t) & d.at_most(t, max),
            t,
            u: d.min(d.max(d.add(shares[1], u), zero), one),
            v: d.min(d.max(d.add(shares[2], v), zero), one),
        }
    }
}

/// A coordinate of the point with these shares of three corners.
#[inline(always)]
fn mean<D: Doubles>(d: D, shares: [D::Vector; 3], corners: [[D::Vector; 3]; 3], axis: usize) -> D::Vector {
    let [a, b, c] = shares;
    let sum = d.add(d.mul(a, corners[0][axis]), d.mul(b, corners[1][axis]));
    d.add(sum, d.mul(c, corners[2][axis]))
}

/// The third component of the cross product of two vectors in the plane.
#[inline(always)]
fn cross<D: Doubles>(d: D, p: [D::Vector; 2], q: [D::Vector; 2]) -> D::Vector {
    d.sub(d.mul(p[0], q[1]), d.mul(p[1], q[0]))
}
