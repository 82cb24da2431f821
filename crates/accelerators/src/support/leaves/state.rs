//! State of a search, and its tests of leaves.

use super::child::{Child, Kind, WIDTH};
use super::filter::{self, Filtered, Leaf, NUMBERS};
use super::frame::{LocalRay, Reach};
use super::{Leaves, Slot};
use std::cell::Cell;
use whitstone_core::stream::RayStream;
use whitstone_core::triangle::{Axis, ShearedRay, TriangleHit};
use whitstone_core::{
    DVec2, Element, InstanceId, Interval, PreliminaryIntersection, Ray, SelfHitFilter, ShapeHit,
    TraversalStatistics,
};
use whitstone_simd::{Kernel, Lanes, Machine};

/// What counts the work of a search. `()` counts nothing, and costs nothing.
pub(crate) trait Tally {
    /// An inner node is visited.
    fn step(&self);

    /// The elements of a leaf are tested.
    fn tests(&self, count: usize);
}

impl Tally for () {
    #[inline(always)]
    fn step(&self) {}

    #[inline(always)]
    fn tests(&self, _: usize) {}
}

/// Counters of a search.
#[derive(Default)]
pub(crate) struct Counters {
    steps: Cell<u64>,
    tests: Cell<u64>,
}

impl Tally for &Counters {
    fn step(&self) {
        self.steps.set(self.steps.get() + 1);
    }

    fn tests(&self, count: usize) {
        self.tests.set(self.tests.get() + count as u64);
    }
}

impl Counters {
    /// Whether nothing was counted.
    pub(crate) fn are_zero(&self) -> bool {
        self.steps.get() + self.tests.get() == 0
    }

    /// What was counted of a search; a structure counts only what it visits. It is not `used` for a
    /// ray that single precision cannot represent.
    pub(crate) fn statistics(&self, leaves: &Leaves, used: bool) -> TraversalStatistics {
        let mut tests = self.tests.get() + leaves.unbounded.len() as u64;
        if !used {
            tests += leaves.slots.len() as u64;
        }
        TraversalStatistics {
            steps: self.steps.get(),
            tests,
        }
    }
}

/// A structure over leaves, with its traversal.
pub(crate) trait Walk {
    fn leaves(&self) -> &Leaves;

    /// Visits everything that the ray may hit, roughly front to back. Returns the limit up to which
    /// pending hits may still be nearest.
    fn walk<const ANY: bool, L: Lanes<WIDTH>>(
        &self,
        l: L,
        state: &mut State<'_, impl RayQuery>,
        local: &LocalRay,
        limit: f32,
    ) -> f32;
}

/// A search for the nearest hit, or with `ANY` for any hit, of which only the existence counts.
pub(crate) struct Search<'a, const ANY: bool, W>(pub(crate) &'a W, pub(crate) &'a Query<'a>);

impl<const ANY: bool, W: Walk> Kernel for Search<'_, ANY, W> {
    type Output = Option<PreliminaryIntersection>;

    #[inline(always)]
    fn run<M: Machine>(self, l: M) -> Option<PreliminaryIntersection> {
        let Self(walk, query) = self;
        let leaves = walk.leaves();
        let mut state = State::new(leaves, query);
        if state.resolve_unbounded() && ANY || leaves.slots.is_empty() {
            return state.best;
        }
        let Some(local) = &leaves.frame.ray(query.ray, &query.interval) else {
            // Single precision cannot represent such a ray.
            state.resolve_all(leaves.slots.iter().map(|slot| slot.element()));
            return state.best;
        };
        let limit = state.limit(local);
        let limit = walk.walk::<ANY, M>(l, &mut state, local, limit);
        state.resolve_pending(local, limit);
        state.best
    }
}

/// A ray query.
pub(crate) struct Query<'a> {
    pub(crate) ray: &'a Ray,
    pub(crate) interval: Interval,
    pub(crate) skip: SelfHitFilter,
}

/// A query for a ray of a stream, read in place: few of its values are needed during traversal.
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

impl RayQuery for &Query<'_> {
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

/// Outcome for a triangle that is certainly hit.
pub(crate) enum Sure {
    /// The new limit.
    Nearer(f32),
    /// It is not certain that the hit is inside the interval.
    Unsure,
    /// The search is over.
    Found,
}

/// State of a search.
#[derive(Clone, Copy)]
pub(crate) struct State<'a, Q> {
    leaves: &'a Leaves,
    query: Q,
    sheared: Option<ShearedRay>,
    pub(crate) best: Option<PreliminaryIntersection>,
    /// Certain hits that are not yet known in double precision: lower bound, leaf, place in it.
    pending: [(f32, Child, u32); 8],
    count: usize,
    /// The smallest of the lower bounds.
    lowest: f32,
}

impl<'a, Q: RayQuery> State<'a, Q> {
    #[inline(always)]
    pub(crate) fn new(leaves: &'a Leaves, query: Q) -> Self {
        Self {
            leaves,
            query,
            sheared: None,
            best: None,
            pending: [(0.0, Child::default(), 0); 8],
            count: 0,
            lowest: 0.0,
        }
    }

    /// Whether a slot is the triangle that the ray starts from (self-intersection filter).
    #[inline(always)]
    fn skips(&self, slot: usize) -> bool {
        let skip = self.query.skip();
        skip != SelfHitFilter::NOTHING && {
            let Slot { shape, triangle } = self.leaves.slots[slot];
            skip.of_shape(InstanceId::TOP_LEVEL, shape) == Some(triangle)
        }
    }

    /// Tests an element in double precision.
    #[inline(never)]
    fn resolve(&mut self, element: Element) {
        let (ray, interval, skip) = (self.query.ray(), self.query.interval(), self.query.skip());
        let sheared = self.sheared.get_or_insert_with(|| ShearedRay::new(&ray));
        let geometry = &self.leaves.geometry;
        let open = Interval {
            min: interval.min,
            // Hits at the same distance still count: a lower index wins the tie.
            max: self.best.map_or(interval.max, |best| best.t.next_up()),
        };
        if let Some(hit) = geometry.intersect(element, &ray, sheared, open, skip) {
            self.offer(&hit);
        }
    }

    /// The same for a triangle that is not skipped and whose corners are exact in the leaf.
    #[inline(always)]
    fn resolve_exact(&mut self, along: Axis, first: usize, count: usize, lane: usize) {
        let (ray, interval) = (self.query.ray(), self.query.interval());
        let sheared = ShearedRay::along(&ray, along);
        let hit = sheared.intersect_turned(self.leaves.exact_along(sheared.axes(), first, count, lane));
        if let Some(TriangleHit { t, u, v }) = hit
            && t > interval.min
            && t < interval.max
        {
            let Slot { shape, triangle } = self.leaves.slots[first + lane];
            let hit = ShapeHit {
                t,
                primitive: triangle,
                prim_uv: DVec2::new(u, v),
            };
            self.offer(&hit.of_shape(InstanceId::TOP_LEVEL, shape));
        }
    }

    /// Keeps a hit if it is the nearest so far.
    #[inline(always)]
    fn offer(&mut self, hit: &PreliminaryIntersection) {
        if self.best.is_none_or(|best| hit.is_nearer_than(&best)) {
            self.best = Some(*hit);
        }
    }

    /// Tests the element at a place of a leaf in double precision; returns the new limit.
    #[inline(always)]
    fn resolve_in(&mut self, leaf: Child, lane: usize, local: &impl Reach, limit: f32) -> f32 {
        match leaf.kind() {
            Kind::Triangles(first, count) if self.leaves.exact != 0.0 => {
                self.resolve_exact(local.longest(), first, count, lane)
            }
            Kind::Triangles(first, _) | Kind::Mixed(first, _) => {
                self.resolve(self.leaves.slots[first + lane].element());
            }
            Kind::Inner(_) => {}
        }
        match &self.best {
            Some(best) => limit.min(local.above(best.t)),
            None => limit,
        }
    }

    /// Tests the pending triangles that may still be nearest in double precision; returns the new
    /// limit.
    #[inline(always)]
    pub(crate) fn resolve_pending(&mut self, local: &impl Reach, mut limit: f32) -> f32 {
        for i in 0..std::mem::take(&mut self.count) {
            let (low, leaf, lane) = self.pending[i];
            if low <= limit {
                limit = self.resolve_in(leaf, lane as usize, local, limit);
            }
        }
        limit
    }

    /// Remembers a certain hit; returns the new limit.
    #[inline(always)]
    fn put_off(
        &mut self,
        [low, high]: [f32; 2],
        leaf: Child,
        lane: usize,
        local: &impl Reach,
        mut limit: f32,
    ) -> f32 {
        if high < self.lowest {
            // No pending hit is as near as this one.
            self.count = 0;
        }
        if self.count == self.pending.len() {
            limit = self.resolve_pending(local, limit);
        }
        self.lowest = if self.count == 0 {
            low
        } else {
            self.lowest.min(low)
        };
        self.pending[self.count] = (low, leaf, lane as u32);
        self.count += 1;
        limit.min(high)
    }
}

impl State<'_, Streamed<'_>> {
    /// Starts another search, for the ray of another lane.
    #[inline(always)]
    pub(crate) fn restart(&mut self, lane: usize) {
        self.query.lane = lane;
        self.sheared = None;
        self.best = None;
        self.count = 0;
        self.lowest = 0.0;
    }
}

impl<Q: RayQuery> State<'_, Q> {
    /// Tests some elements.
    #[cold]
    pub(crate) fn resolve_all(&mut self, elements: impl Iterator<Item = Element>) {
        for element in elements {
            self.resolve(element);
        }
    }

    /// Tests the unbounded elements; returns whether any was hit.
    #[inline(always)]
    pub(crate) fn resolve_unbounded(&mut self) -> bool {
        if !self.leaves.unbounded.is_empty() {
            self.resolve_all(self.leaves.unbounded.iter().copied());
        }
        self.best.is_some()
    }

    /// The leaf, and the place in it, of the only triangle that may be hit, if it is not yet known
    /// in double precision.
    #[inline(always)]
    pub(crate) fn candidate(&self) -> Option<(Child, usize)> {
        let (_, leaf, lane) = self.pending[0];
        (self.count == 1 && self.best.is_none()).then_some((leaf, lane as usize))
    }

    /// The initial limit.
    #[inline(always)]
    pub(crate) fn limit(&self, local: &impl Reach) -> f32 {
        match &self.best {
            Some(best) => local.max().min(local.above(best.t)),
            None => local.max(),
        }
    }

    /// Processes a triangle that is certainly hit between two distances.
    #[inline(always)]
    pub(crate) fn sure<const ANY: bool>(
        &mut self,
        local: &impl Reach,
        leaf: Child,
        lane: usize,
        bounds: [f32; 2],
        limit: f32,
    ) -> Sure {
        let inside = local.inside();
        if !(bounds[0] >= inside[0] && bounds[1] <= inside[1]) {
            return Sure::Unsure;
        }
        if self.skips(leaf.index() + lane) {
            return Sure::Nearer(limit);
        }
        if ANY {
            // Any hit will do: this one exists, although it is not known in double precision.
            self.best = Some(PreliminaryIntersection {
                t: 0.0,
                prim_uv: Default::default(),
                instance: InstanceId::TOP_LEVEL,
                shape: 0,
                primitive: 0,
            });
            return Sure::Found;
        }
        Sure::Nearer(self.put_off(bounds, leaf, lane, local, limit))
    }

    /// Decides at once about a triangle that may be hit; returns the new limit, or `None` if the
    /// search is over.
    #[inline(always)]
    pub(crate) fn unsure<const ANY: bool>(
        &mut self,
        local: &impl Reach,
        leaf: Child,
        lane: usize,
        limit: f32,
    ) -> Option<f32> {
        if self.skips(leaf.index() + lane) {
            return Some(limit);
        }
        let limit = self.resolve_in(leaf, lane, local, limit);
        (!ANY || self.best.is_none()).then_some(limit)
    }

    /// Tests the elements of a leaf; returns the new limit, or `None` if the search is over.
    #[inline(always)]
    pub(crate) fn leaf<const ANY: bool, L: Lanes<WIDTH>>(
        &mut self,
        l: L,
        local: &LocalRay,
        child: Child,
        mut limit: f32,
    ) -> Option<f32> {
        let leaves = self.leaves;
        let filtered = match child.kind() {
            Kind::Triangles(first, count) => {
                let Some(numbers) = leaves.numbers[NUMBERS * first..].first_chunk() else {
                    return Some(limit);
                };
                let pairs = Leaf {
                    ray: local,
                    numbers,
                    count,
                    limit,
                };
                match filter::filter(l, &pairs, (1 << count) - 1) {
                    Some(filtered) => filtered,
                    None => return Some(limit),
                }
            }
            Kind::Mixed(_, count) => Filtered {
                sure: 0,
                unsure: (1 << count) - 1,
                low: [0.0; WIDTH],
                high: [0.0; WIDTH],
            },
            Kind::Inner(_) => return Some(limit),
        };
        let mut unsure = filtered.unsure;
        let mut sure = filtered.sure;
        while sure != 0 {
            let i = sure.trailing_zeros() as usize % WIDTH;
            sure &= sure - 1;
            let bounds = [filtered.low[i], filtered.high[i]];
            match self.sure::<ANY>(local, child, i, bounds, limit) {
                Sure::Nearer(nearer) => limit = nearer,
                Sure::Unsure => unsure |= 1 << i,
                Sure::Found => return None,
            }
        }
        while unsure != 0 {
            let i = unsure.trailing_zeros() as usize;
            unsure &= unsure - 1;
            limit = self.unsure::<ANY>(local, child, i, limit)?;
        }
        Some(limit)
    }
}
