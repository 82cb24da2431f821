//! A search, and its tests of leaves.

use super::child::WIDTH;
use super::frame::{LocalRay, Sheared, prepare};
use super::{Corners, Leaves, NUMBERS, Number, Slot, WINDOW};
use whitstone_core::stream::{NO_SHAPE, RayStream};
use whitstone_core::triangle::ShearedRay;
use whitstone_core::{
    DVec2, Element, InstanceId, Interval, PreliminaryIntersection, Ray, SelfHitFilter, ShapeHit,
};
use whitstone_simd::{Doubles, Kernel, Machine, Quad};

/// A structure over leaves, with its traversal.
pub(crate) trait Walk<const N: usize> {
    fn leaves(&self) -> &Leaves;

    /// Visits everything that the ray may hit, roughly front to back.
    fn walk<const ANY: bool, M: Machine<N>>(
        &self,
        m: M,
        best: &mut Best,
        local: &LocalRay,
        query: &impl RayQuery,
    );
}

/// A search for the nearest hit, or with `ANY` for any hit, of which only the existence counts.
pub(crate) struct Search<'a, const ANY: bool, W>(pub(crate) &'a W, pub(crate) &'a Query<'a>);

impl<const N: usize, const ANY: bool, W: Walk<N>> Kernel<N> for Search<'_, ANY, W> {
    type Output = Option<PreliminaryIntersection>;

    #[inline(always)]
    fn run<M: Machine<N>>(self, m: M) -> Option<PreliminaryIntersection> {
        let Self(walk, query) = self;
        let leaves = walk.leaves();
        let mut best = Best::default();
        if let Some(local) = best.start::<ANY, _>(m.quad(), leaves, query) {
            walk.walk::<ANY, M>(m, &mut best, &local, query);
        }
        best.hit
    }
}

/// A ray query.
pub(crate) struct Query<'a> {
    pub(crate) ray: &'a Ray,
    pub(crate) interval: Interval,
    pub(crate) skip: SelfHitFilter,
}

/// A query for a ray of a stream, read in place.
#[derive(Clone, Copy)]
pub(crate) struct Streamed<'a> {
    pub(crate) rays: &'a RayStream,
    pub(crate) lane: usize,
}

/// Access to the query of a search.
pub(crate) trait RayQuery {
    fn ray(&self) -> Ray;
    fn interval(&self) -> Interval;
    fn skip(&self) -> SelfHitFilter;
}

impl RayQuery for Query<'_> {
    #[inline(always)]
    fn ray(&self) -> Ray {
        *self.ray
    }
    #[inline(always)]
    fn interval(&self) -> Interval {
        self.interval
    }
    #[inline(always)]
    fn skip(&self) -> SelfHitFilter {
        self.skip
    }
}

impl RayQuery for Streamed<'_> {
    #[inline(always)]
    fn ray(&self) -> Ray {
        self.rays.ray(self.lane)
    }
    #[inline(always)]
    fn interval(&self) -> Interval {
        self.rays.interval(self.lane)
    }
    #[inline(always)]
    fn skip(&self) -> SelfHitFilter {
        self.rays.skip.skip(self.lane)
    }
}

/// The best hit of a ray so far, and what triangle tests read of the ray.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Best {
    pub(crate) hit: Option<PreliminaryIntersection>,
    /// A hit counts if its parameter is greater than this ...
    min: f64,
    /// ... and at most this. Hits at the distance of the best one still count: a lower index wins
    /// the tie.
    max: f64,
    sheared: Sheared,
    /// The triangle that the ray starts from.
    skip: Slot,
}

impl Best {
    /// Starts a search and tests the unbounded elements. Returns the ray to traverse the structure
    /// with; `None` if the search is over.
    #[inline(always)]
    pub(crate) fn start<const ANY: bool, Q: Quad>(
        &mut self,
        q: Q,
        leaves: &Leaves,
        query: &impl RayQuery,
    ) -> Option<LocalRay> {
        let interval = query.interval();
        // Field by field: a value that is written in pieces and then copied stalls the processor.
        self.hit = None;
        self.min = interval.min;
        self.max = interval.max.next_down();
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
                return None;
            }
        }
        if leaves.slots.is_empty() {
            return None;
        }
        let Some((local, sheared)) = prepare(q, &leaves.frame, &query.ray(), &interval) else {
            // Single precision cannot represent such a ray.
            self.try_all(leaves, query, leaves.slots.iter().map(|slot| slot.element()));
            return None;
        };
        self.sheared = sheared;
        Some(local)
    }

    /// The limit beyond which boxes do not count.
    #[inline(always)]
    pub(crate) fn limit(&self, local: &LocalRay) -> f32 {
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
    pub(crate) fn try_element(&mut self, leaves: &Leaves, query: &impl RayQuery, element: Element) -> bool {
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
    pub(crate) fn try_triangles<const ANY: bool, D: Doubles>(
        &mut self,
        d: D,
        leaves: &Leaves,
        first: usize,
        count: usize,
    ) -> bool {
        match &leaves.corners {
            Corners::Single(numbers) => self.try_window::<ANY, _, _>(d, leaves, numbers, first, count),
            Corners::Double(numbers) => self.try_window::<ANY, _, _>(d, leaves, numbers, first, count),
        }
    }

    #[inline(always)]
    fn try_window<const ANY: bool, D: Doubles, T: Number>(
        &mut self,
        d: D,
        leaves: &Leaves,
        numbers: &[T],
        first: usize,
        count: usize,
    ) -> bool {
        let Some(numbers) = numbers[NUMBERS * first..].first_chunk() else {
            return false;
        };
        // This changes nothing, but lets the compiler omit bounds checks.
        let count = count.min(WIDTH);
        let mut better = false;
        let parts = if D::LANES == WIDTH {
            1
        } else {
            count.div_ceil(D::LANES)
        };
        for part in 0..parts {
            let slots = &leaves.slots[first + part * D::LANES..];
            let sides = Sides::new(d, &self.triangles(numbers, count, part));
            if sides.mask == 0 {
                continue;
            }
            if ANY {
                let mut sure = sides.sure(d, &self.triangles(numbers, count, part));
                while sure != 0 {
                    let lane = sure.trailing_zeros() as usize;
                    sure &= sure - 1;
                    if self.accept(slots[lane]) {
                        return true;
                    }
                }
            }
            let hits = sides.intersect(d, &self.triangles(numbers, count, part));
            let mut mask = hits.mask;
            while mask != 0 {
                let lane = mask.trailing_zeros() as usize;
                mask &= mask - 1;
                better |= self.offer_lane(d, &hits, lane, slots[lane]);
            }
        }
        better
    }

    /// The ray, and part of the triangles of a leaf.
    #[inline(always)]
    fn triangles<'a, T>(&'a self, numbers: &'a [T; WINDOW], count: usize, part: usize) -> Triangles<'a, T> {
        Triangles {
            numbers,
            count,
            part,
            ray: &self.sheared,
            limits: [self.min, self.max],
        }
    }

    /// Keeps the hit of a lane if it is the best so far. Returns whether it is.
    #[inline(always)]
    fn offer_lane<D: Doubles>(&mut self, d: D, hits: &Hits<D::Vector>, lane: usize, slot: Slot) -> bool {
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
    fn accept(&mut self, slot: Slot) -> bool {
        let other = slot != self.skip;
        if other {
            self.hit = Some(PreliminaryIntersection::default());
        }
        other
    }
}

/// A ray, and part of the triangles of a leaf: as many as a vector has lanes.
struct Triangles<'a, T> {
    /// The numbers of the leaf, and then unrelated ones.
    numbers: &'a [T; WINDOW],
    /// The number of triangles in the leaf, at most 8.
    count: usize,
    part: usize,
    ray: &'a Sheared,
    limits: [f64; 2],
}

impl<T: Number> Triangles<'_, T> {
    /// A corner in sheared coordinates.
    #[inline(always)]
    fn corner<D: Doubles>(&self, d: D, corner: usize) -> [D::Vector; 3] {
        let x = self.coordinate(d, corner, 0);
        let y = self.coordinate(d, corner, 1);
        let z = self.coordinate(d, corner, 2);
        let shear = &self.ray.shear;
        [
            d.sub(x, d.mul(d.splat(shear[0]), z)),
            d.sub(y, d.mul(d.splat(shear[1]), z)),
            z,
        ]
    }

    /// A coordinate of a corner relative to the ray's origin, along the `i`-th axis of the ray.
    #[inline(always)]
    fn coordinate<D: Doubles>(&self, d: D, corner: usize, i: usize) -> D::Vector {
        // The last of 9 rows begins at 8 times the count at most.
        let along = self.ray.axes[i] as usize * (3 * self.count);
        match self.numbers[along + corner * self.count..].first_chunk() {
            Some(row) => d.sub(T::lanes(d, row, self.part), d.splat(self.ray.origin[i])),
            None => d.splat(f64::NAN),
        }
    }

    #[inline(always)]
    fn limits<D: Doubles>(&self, d: D) -> [D::Vector; 2] {
        [d.splat(self.limits[0]), d.splat(self.limits[1])]
    }
}

/// The first half of the test: on which sides of the edges the ray passes.
struct Sides<V> {
    /// The lanes whose triangles are hit by the line of the ray, perhaps inside the interval, as a
    /// bit mask.
    mask: u32,
    /// Sheared coordinates of the corners a, b and c.
    corners: [[V; 3]; 3],
    /// Scaled barycentric coordinates, and their sum.
    weights: [V; 3],
    determinant: V,
    /// Bounds on the coordinate along the ray, and on the ray parameter.
    least: V,
    most: V,
    near: V,
    far: V,
}

/// The lanes whose triangles are hit, as a bit mask, and the hits.
struct Hits<V> {
    mask: u32,
    t: V,
    u: V,
    v: V,
}

/// The test of [`ShearedRay::intersect`], in the same order of operations, with all lanes at once.
///
/// No closures: they would not be compiled for the lanes' instruction set.
impl<V: Copy> Sides<V> {
    #[inline(always)]
    fn new<D: Doubles<Vector = V>>(d: D, triangles: &Triangles<'_, impl Number>) -> Self {
        let corners = [
            triangles.corner(d, 0),
            triangles.corner(d, 1),
            triangles.corner(d, 2),
        ];
        let [a, b, c] = corners;
        let weights = [
            cross(d, [c[0], c[1]], [b[0], b[1]]),
            cross(d, [a[0], a[1]], [c[0], c[1]]),
            cross(d, [b[0], b[1]], [a[0], a[1]]),
        ];
        let lowest = d.min(d.min(weights[0], weights[1]), weights[2]);
        let highest = d.max(d.max(weights[0], weights[1]), weights[2]);
        let determinant = d.add(d.add(weights[0], weights[1]), weights[2]);
        let zero = d.splat(0.0);
        let valid = ((1 << triangles.count) - 1) >> (triangles.part * D::LANES);
        let one_side = d.less(lowest, zero) ^ d.less(zero, highest);
        let finite = d.less(d.abs(determinant), d.splat(f64::INFINITY));
        // The parameter of a hit is between those of the nearest and the farthest corner, also
        // after rounding. Nearly all triangles that pass this test are hit, so the processor
        // predicts what depends on the second half.
        let least = d.min(d.min(a[2], b[2]), c[2]);
        let most = d.max(d.max(a[2], b[2]), c[2]);
        let scale = d.splat(triangles.ray.shear[2]);
        let ends = [d.mul(least, scale), d.mul(most, scale)];
        let (near, far) = (d.min(ends[0], ends[1]), d.max(ends[0], ends[1]));
        let [min, max] = triangles.limits(d);
        let reached = d.less(min, far) & d.at_most(near, max);
        Self {
            mask: one_side & finite & reached & valid,
            corners,
            weights,
            determinant,
            least,
            most,
            near,
            far,
        }
    }

    /// The lanes whose triangles are hit inside the interval, wherever that is on them.
    #[inline(always)]
    fn sure<D: Doubles<Vector = V>>(&self, d: D, triangles: &Triangles<'_, impl Number>) -> u32 {
        let [min, max] = triangles.limits(d);
        self.mask & d.less(min, self.near) & d.at_most(self.far, max)
    }

    /// The second half of the test: the hits inside the interval.
    #[inline(always)]
    fn intersect<D: Doubles<Vector = V>>(&self, d: D, triangles: &Triangles<'_, impl Number>) -> Hits<V> {
        let [a, b, c] = self.corners;
        let reciprocal = d.div(d.splat(1.0), self.determinant);
        let shares = [
            d.mul(self.weights[0], reciprocal),
            d.mul(self.weights[1], reciprocal),
            d.mul(self.weights[2], reciprocal),
        ];
        let offset = [mean(d, shares, self.corners, 0), mean(d, shares, self.corners, 1)];
        let e = [d.sub(b[0], a[0]), d.sub(b[1], a[1]), d.sub(b[2], a[2])];
        let f = [d.sub(c[0], a[0]), d.sub(c[1], a[1]), d.sub(c[2], a[2])];
        let u = d.mul(cross(d, offset, [f[0], f[1]]), reciprocal);
        let v = d.mul(cross(d, [e[0], e[1]], offset), reciprocal);
        let change = d.add(d.mul(u, e[2]), d.mul(v, f[2]));
        let depth = d.add(mean(d, shares, self.corners, 2), change);
        let depth = d.min(d.max(depth, self.least), self.most);
        let t = d.mul(depth, d.splat(triangles.ray.shear[2]));
        let [min, max] = triangles.limits(d);
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
