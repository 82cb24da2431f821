//! The way of a ray through the hierarchy.

use super::Bvh;
use super::filter::{self, Filtered, Leaf, NUMBERS};
use super::frame::{LocalRay, Reach};
use super::node::{Child, Kind, WIDTH};
use whitstone_core::stream::RayStream;
use whitstone_core::triangle::{ShearedRay, TriangleHit};
use whitstone_core::{DVec2, DVec3, Element, InstancePath, Interval, PrimitiveHit, RawHit, Ray, Shape, Skip};
use whitstone_simd::{Kernel, Lanes, Machine};

/// The stack of a search: each level of nodes puts off seven children at most.
pub(super) const fn stack_size(depth: usize) -> usize {
    (depth * (WIDTH - 1) + 1).next_power_of_two()
}

/// Hierarchies up to this depth are searched with a smaller stack, which is cheaper to set up.
pub(super) const USUAL_DEPTH: usize = 18;

/// A search for the nearest hit, or with `ANY` for some hit, in which case only whether there is one counts.
pub(super) struct Search<'a, const ANY: bool, const DEEP: bool>(pub(super) &'a Bvh, pub(super) &'a Query<'a>);

/// What is searched for.
pub(super) struct Query<'a> {
    pub(super) ray: &'a Ray,
    pub(super) interval: Interval,
    pub(super) skip: Skip,
}

/// The same for a ray of a stream, where it stays: few of its numbers are needed on its way.
#[derive(Clone, Copy)]
pub(super) struct Streamed<'a> {
    pub(super) rays: &'a RayStream,
    pub(super) lane: usize,
}

/// Where a search looks up what is searched for.
pub(super) trait Asked {
    fn ray(&self) -> Ray;
    fn interval(&self) -> Interval;
    fn skip(&self) -> Skip;
}

impl Asked for &Query<'_> {
    #[inline(always)]
    fn ray(&self) -> Ray {
        *self.ray
    }
    #[inline(always)]
    fn interval(&self) -> Interval {
        self.interval
    }
    #[inline(always)]
    fn skip(&self) -> Skip {
        self.skip
    }
}

impl Asked for Streamed<'_> {
    #[inline(always)]
    fn ray(&self) -> Ray {
        self.rays.ray(self.lane)
    }
    #[inline(always)]
    fn interval(&self) -> Interval {
        self.rays.interval(self.lane)
    }
    #[inline(always)]
    fn skip(&self) -> Skip {
        self.rays.skip.skip(self.lane)
    }
}

/// What becomes of a triangle that is certainly hit.
pub(super) enum Sure {
    /// The new limit.
    Nearer(f32),
    /// It is not certain that the hit is inside the interval.
    Unsure,
    /// The search is over.
    Found,
}

/// What a search knows.
#[derive(Clone, Copy)]
pub(super) struct State<'a, Q> {
    bvh: &'a Bvh,
    query: Q,
    sheared: Option<ShearedRay>,
    /// Before this hits still count.
    end: f64,
    pub(super) best: Option<RawHit>,
    /// Sure hits that are not yet known in double precision: lower bound, leaf, place in it.
    pending: [(f32, Child, u32); 8],
    count: usize,
    /// The smallest of the lower bounds.
    lowest: f32,
}

impl<'a, Q: Asked> State<'a, Q> {
    #[inline(always)]
    pub(super) fn new(bvh: &'a Bvh, query: Q) -> Self {
        Self {
            bvh,
            end: query.interval().max,
            query,
            sheared: None,
            best: None,
            pending: [(0.0, Child::default(), 0); 8],
            count: 0,
            lowest: 0.0,
        }
    }

    /// Whether a slot is the triangle that the ray leaves.
    #[inline(always)]
    fn skips(&self, slot: usize) -> bool {
        {
            let skip = self.query.skip();
            skip != Skip::NOTHING && {
                let Slot { shape, triangle } = self.bvh.slots[slot];
                skip.of_shape(InstancePath::WORLD, shape) == Some(triangle)
            }
        }
    }

    /// Decides about an element in double precision.
    #[inline(never)]
    fn resolve(&mut self, element: Element) {
        let (ray, interval, skip) = (self.query.ray(), self.query.interval(), self.query.skip());
        let sheared = self.sheared.get_or_insert_with(|| ShearedRay::new(&ray));
        let geometry = &self.bvh.geometry;
        let open = Interval {
            min: interval.min,
            max: self.end,
        };
        if let Some(hit) = geometry.intersect(element, &ray, sheared, open, skip) {
            self.offer(&hit);
        }
    }

    /// The same for a triangle that is not skipped and whose corners are exact in the leaf.
    #[inline(never)]
    fn resolve_exact(&mut self, first: usize, count: usize, lane: usize) {
        let (ray, interval) = (self.query.ray(), self.query.interval());
        let sheared = self.sheared.get_or_insert_with(|| ShearedRay::new(&ray));
        let [a, b, c] = self.bvh.exact_corners(first, count, lane);
        let hit = sheared.intersect(a, b, c);
        if let Some(TriangleHit { t, u, v }) = hit
            && t > interval.min
            && t < self.end
        {
            let Slot { shape, triangle } = self.bvh.slots[first + lane];
            let hit = PrimitiveHit {
                t,
                primitive: triangle,
                params: DVec2::new(u, v),
            };
            self.offer(&hit.of_shape(InstancePath::WORLD, shape));
        }
    }

    /// A hit that is there.
    #[inline(always)]
    fn offer(&mut self, hit: &RawHit) {
        if self.best.is_none_or(|best| hit.beats(&best)) {
            self.best = Some(*hit);
            // Hits at the same distance still count: they may be lower in number.
            self.end = hit.t.next_up();
        }
    }

    /// Decides about a place of a leaf; returns the new limit.
    #[inline(always)]
    fn resolve_in(&mut self, leaf: Child, lane: usize, local: &impl Reach, limit: f32) -> f32 {
        match leaf.kind() {
            Kind::Triangles(first, count) if self.bvh.exact != 0.0 => self.resolve_exact(first, count, lane),
            Kind::Triangles(first, _) | Kind::Mixed(first, _) => {
                self.resolve(self.bvh.slots[first + lane].element());
            }
            Kind::Inner(_) => {}
        }
        match &self.best {
            Some(best) => limit.min(local.above(best.t)),
            None => limit,
        }
    }

    /// Decides about what is pending and may still be nearest.
    #[inline(always)]
    pub(super) fn resolve_pending(&mut self, local: &impl Reach, mut limit: f32) -> f32 {
        for i in 0..std::mem::take(&mut self.count) {
            let (low, leaf, lane) = self.pending[i];
            if low <= limit {
                limit = self.resolve_in(leaf, lane as usize, local, limit);
            }
        }
        limit
    }

    /// Remembers a sure hit; returns the new limit.
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
            // Nothing that was put off is as near as this.
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
    /// Begins another search, of the ray of another lane.
    #[inline(always)]
    pub(super) fn restart(&mut self, lane: usize) {
        self.query.lane = lane;
        self.sheared = None;
        self.end = self.query.interval().max;
        self.best = None;
        self.count = 0;
        self.lowest = 0.0;
    }
}

impl<const ANY: bool, const DEEP: bool> Kernel for Search<'_, ANY, DEEP> {
    type Output = Option<RawHit>;

    #[inline(always)]
    fn run<M: Machine>(self, l: M) -> Option<RawHit> {
        let Self(bvh, query) = self;
        let state = State::new(bvh, query);
        if DEEP {
            state.search::<ANY, { stack_size(super::MAX_DEPTH) }, M>(l)
        } else {
            state.search::<ANY, { stack_size(USUAL_DEPTH) }, M>(l)
        }
    }
}

impl<Q: Asked> State<'_, Q> {
    /// Tries some elements.
    #[cold]
    pub(super) fn resolve_all(&mut self, elements: impl Iterator<Item = Element>) {
        for element in elements {
            self.resolve(element);
        }
    }

    /// Tries what has no box; returns whether something was hit.
    #[inline(always)]
    pub(super) fn resolve_unbounded(&mut self) -> bool {
        if !self.bvh.unbounded.is_empty() {
            self.resolve_all(self.bvh.unbounded.iter().copied());
        }
        self.best.is_some()
    }

    /// The only thing that may be hit, not yet known in double precision: a triangle in the leaf.
    #[inline(always)]
    pub(super) fn candidate(&self) -> Option<(Child, usize)> {
        let (_, leaf, lane) = self.pending[0];
        (self.count == 1 && self.best.is_none()).then_some((leaf, lane as usize))
    }

    /// The limit to begin with.
    #[inline(always)]
    pub(super) fn limit(&self, local: &impl Reach) -> f32 {
        match &self.best {
            Some(best) => local.max().min(local.above(best.t)),
            None => local.max(),
        }
    }

    #[inline(always)]
    fn search<const ANY: bool, const STACK: usize, L: Lanes<WIDTH>>(mut self, l: L) -> Option<RawHit> {
        let bvh = self.bvh;
        if self.resolve_unbounded() && ANY {
            return self.best;
        }
        let Some(root) = bvh.root else {
            return self.best;
        };
        let Some(local) = &bvh.frame.ray(&self.query.ray(), &self.query.interval()) else {
            // Nothing that single precision can tell about such a ray.
            self.resolve_all(bvh.slots.iter().map(|slot| slot.element()));
            return self.best;
        };
        let mut stack = [(0f32, Child::default()); STACK];
        let limit = self.limit(local);
        let limit = self.traverse::<ANY, STACK, L>(l, local, root, &mut stack, limit);
        self.resolve_pending(local, limit);
        self.best
    }

    /// Goes through what is below a child; what is pending then may be nearest up to the limit that is returned.
    #[inline(always)]
    pub(super) fn traverse<const ANY: bool, const STACK: usize, L: Lanes<WIDTH>>(
        &mut self,
        l: L,
        local: &LocalRay,
        mut child: Child,
        stack: &mut [(f32, Child); STACK],
        mut limit: f32,
    ) -> f32 {
        let bvh = self.bvh;
        // Each number in eight lanes would be kept on the stack otherwise, instead of being loaded into them.
        let local = std::hint::black_box(local);
        let mut height = 0;
        loop {
            if child.is_inner()
                && let Kind::Inner(node) = child.kind()
            {
                let node = &bvh.nodes[node];
                let (mut mask, near) = node.enter(l, local, limit);
                if mask != 0 {
                    let near = l.store(near);
                    let mut next = || {
                        let i = mask.trailing_zeros() as usize % WIDTH;
                        mask &= mask - 1;
                        ((near[i], Child(node.children[i])), mask)
                    };
                    let (first, rest) = next();
                    if rest == 0 {
                        child = first.1;
                        continue;
                    }
                    let (second, rest) = next();
                    if rest == 0 {
                        let (nearer, farther) = if second.0 < first.0 {
                            (second, first)
                        } else {
                            (first, second)
                        };
                        stack[height % STACK] = farther;
                        height += 1;
                        child = nearer.1;
                        continue;
                    }
                    // Three or more: sorted on the stack, the nearest on top.
                    let bottom = height;
                    let mut insert = |entry: (f32, Child)| {
                        let mut place = height;
                        while !ANY && place > bottom && stack[(place - 1) % STACK].0 < entry.0 {
                            stack[place % STACK] = stack[(place - 1) % STACK];
                            place -= 1;
                        }
                        stack[place % STACK] = entry;
                        height += 1;
                    };
                    insert(first);
                    insert(second);
                    loop {
                        let (entry, rest) = next();
                        insert(entry);
                        if rest == 0 {
                            break;
                        }
                    }
                    height -= 1;
                    child = stack[height % STACK].1;
                    continue;
                }
            } else {
                match self.leaf::<ANY, L>(l, local, child, limit) {
                    Some(nearer) => limit = nearer,
                    None => return limit,
                }
            }
            child = loop {
                if height == 0 {
                    return limit;
                }
                height -= 1;
                let (near, child) = stack[height % STACK];
                // At equal distance an element of lower number may be in there.
                if near <= limit {
                    break child;
                }
            };
        }
    }

    /// Takes a triangle that is certainly hit between two distances.
    #[inline(always)]
    pub(super) fn sure<const ANY: bool>(
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
            // Any hit will do: this one is not known in double precision, but it is there.
            self.best = Some(RawHit {
                t: 0.0,
                params: Default::default(),
                instance: InstancePath::WORLD,
                shape: 0,
                primitive: 0,
            });
            return Sure::Found;
        }
        Sure::Nearer(self.put_off(bounds, leaf, lane, local, limit))
    }

    /// Decides at once about a triangle that may be hit; returns the new limit, or `None` if the search is over.
    #[inline(always)]
    pub(super) fn unsure<const ANY: bool>(
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

    /// Tests what is in a leaf; returns the new limit, or `None` if the search is over.
    #[inline(always)]
    pub(super) fn leaf<const ANY: bool, L: Lanes<WIDTH>>(
        &mut self,
        l: L,
        local: &LocalRay,
        child: Child,
        mut limit: f32,
    ) -> Option<f32> {
        let bvh = self.bvh;
        let filtered = match child.kind() {
            Kind::Triangles(first, count) => {
                let Some(numbers) = bvh.numbers[NUMBERS * first..].first_chunk() else {
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

impl Bvh {
    /// The corners of a triangle of a leaf where these are exact.
    #[inline(always)]
    fn exact_corners(&self, first: usize, count: usize, lane: usize) -> [DVec3; 3] {
        let numbers = &self.numbers[NUMBERS * first..][..NUMBERS * count];
        let number = |i: usize| f64::from(numbers[i * count + lane]) * self.exact;
        let corner = |i: usize| DVec3::new(number(3 * i), number(3 * i + 1), number(3 * i + 2));
        [corner(0), corner(1), corner(2)]
    }

    /// What is in a place of a leaf of triangles, and its corners in the world.
    #[inline(always)]
    pub(super) fn triangle(&self, leaf: Child, lane: usize) -> (Slot, [DVec3; 3]) {
        let slot = self.slots[leaf.index() + lane];
        let corners = match leaf.kind() {
            Kind::Triangles(first, count) if self.exact != 0.0 => self.exact_corners(first, count, lane),
            _ => match &self.geometry.shapes()[slot.shape as usize] {
                Shape::Triangles(mesh) => mesh.corners(slot.triangle),
                _ => [DVec3::ZERO; 3],
            },
        };
        (slot, corners)
    }
}

/// An element in a leaf.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Slot {
    pub(super) shape: u32,
    /// The triangle, or [`Slot::OPAQUE`].
    pub(super) triangle: u32,
}

impl Slot {
    const OPAQUE: u32 = u32::MAX;

    pub(super) fn new(element: Element) -> Self {
        match element {
            Element::Triangle { shape, triangle } => Self { shape, triangle },
            Element::Opaque { shape } => Self {
                shape,
                triangle: Self::OPAQUE,
            },
        }
    }

    pub(super) fn is_opaque(self) -> bool {
        self.triangle == Self::OPAQUE
    }

    #[inline]
    pub(super) fn element(self) -> Element {
        let Self { shape, triangle } = self;
        if self.is_opaque() {
            Element::Opaque { shape }
        } else {
            Element::Triangle { shape, triangle }
        }
    }
}
