//! Many rays at once: while one waits for memory or for its own arithmetic, others go on.
//!
//! A single ray is bound by latency: each step needs the result of the one before. Here some rays are in flight; each
//! round takes all that are at inner nodes one step, without a jump that depends on the ray, then
//! all that are at leaves. What a ray meets, and in which order, does not depend on the others.

use super::Bvh;
use super::filter::NUMBERS;
use super::frame::LocalRay;
use super::node::{Child, WIDTH};
use super::search::{Query, State, USUAL_DEPTH, stack_size};
use std::ops::Range;
use whitstone_core::stream::{HitStream, LANES, Lanes as RayLanes, RayStream};
use whitstone_core::{RawHit, Ray};
use whitstone_simd::{Kernel, Lanes, prefetch, select, with_lanes};

/// Rays in flight.
const FLIGHTS: usize = 16;

/// Room for the usual depth, the sentinel, and what `descending` writes beyond the children.
const STACK: usize = stack_size(USUAL_DEPTH) + 1 + WIDTH;

/// The nearest hits of a stream, into hits that are clear.
pub(super) fn closest(bvh: &Bvh, rays: &RayStream, hits: &mut HitStream) {
    let take = |lane: usize, hit: Option<RawHit>| {
        if let Some(hit) = hit {
            hits.set(lane, &hit);
        }
    };
    search::<false>(bvh, rays, take);
}

/// Whether anything is hit.
pub(super) fn occluded(bvh: &Bvh, rays: &RayStream, hidden: &mut RayLanes<bool>) {
    search::<true>(bvh, rays, |lane, hit| hidden[lane] = hit.is_some());
}

fn search<const ANY: bool>(bvh: &Bvh, rays: &RayStream, mut take: impl FnMut(usize, Option<RawHit>)) {
    let len = rays.len.min(LANES);
    match bvh.root {
        Some(root) if !bvh.deep => {
            let stream = Stream::<ANY, _> {
                bvh,
                root,
                rays,
                take: &mut take,
            };
            with_lanes(bvh.level, stream);
        }
        _ => {
            for lane in 0..len {
                let (ray, skip) = (rays.ray(lane), rays.skip.skip(lane));
                take(lane, bvh.find::<ANY>(&ray, rays.interval(lane), skip));
            }
        }
    }
}

struct Stream<'a, const ANY: bool, T> {
    bvh: &'a Bvh,
    root: Child,
    rays: &'a RayStream,
    take: &'a mut T,
}

/// A ray on its way.
struct Flight<'a> {
    lane: usize,
    local: LocalRay,
    state: State<'a>,
    /// Beyond this boxes are of no interest.
    limit: f32,
    /// Where it is.
    child: Child,
    height: usize,
    near: [f32; STACK],
    children: [u32; STACK],
}

impl Flight<'_> {
    /// Goes to what is next on the stack.
    #[inline(always)]
    fn pop(&mut self) {
        let mut top = self.height - 1;
        while self.near[top] > self.limit {
            top -= 1;
        }
        self.height = top;
        self.child = Child(self.children[top]);
    }
}

/// Numbers of flights.
#[derive(Default)]
struct List {
    flights: [u8; FLIGHTS],
    len: usize,
}

impl List {
    /// Appends a flight, or does nothing, without a jump.
    #[inline(always)]
    fn push_if(&mut self, condition: bool, flight: u8) {
        self.flights[self.len % FLIGHTS] = flight;
        self.len += usize::from(condition);
    }
}

impl Bvh {
    /// Fetches what is needed of a child.
    #[inline(always)]
    fn prefetch(&self, child: Child) {
        let node = self.nodes.as_ptr().wrapping_add(child.index()).cast::<f32>();
        let leaf = self.numbers.as_ptr().wrapping_add(NUMBERS * child.index());
        prefetch(select(child.is_inner(), node, leaf), 4);
    }
}

/// The rays that still have to start.
struct Queue<'a> {
    bvh: &'a Bvh,
    root: Child,
    lanes: Range<usize>,
    queries: &'a [Query<'a>; LANES],
}

impl<'a> Queue<'a> {
    /// Starts the next ray that has a way to go; returns whether there is one.
    #[inline(always)]
    fn start<const ANY: bool, T: FnMut(usize, Option<RawHit>)>(
        &mut self,
        flight: &mut Flight<'a>,
        take: &mut T,
    ) -> bool {
        for lane in self.lanes.by_ref() {
            let query = &self.queries[lane % LANES];
            flight.state = State::new(self.bvh, query);
            if !(flight.state.resolve_unbounded() && ANY) {
                if let Some(local) = self.bvh.frame.ray(query.ray, &query.interval) {
                    flight.local = local;
                    flight.lane = lane;
                    flight.child = self.root;
                    flight.height = 1;
                    flight.limit = flight.state.limit(&flight.local);
                    return true;
                }
                flight
                    .state
                    .resolve_all(self.bvh.slots.iter().map(|slot| slot.element()));
            }
            take(lane, flight.state.best);
        }
        false
    }
}

impl<const ANY: bool, T: FnMut(usize, Option<RawHit>)> Kernel for Stream<'_, ANY, T> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self, l: L) {
        let Self {
            bvh,
            root,
            rays,
            take,
        } = self;
        let own: [Ray; LANES] = std::array::from_fn(|lane| rays.ray(lane));
        let queries: [Query<'_>; LANES] = std::array::from_fn(|lane| Query {
            ray: &own[lane],
            interval: rays.interval(lane),
            skip: rays.skip.skip(lane),
        });
        let mut queue = Queue {
            bvh,
            root,
            lanes: 0..rays.len.min(LANES),
            queries: &queries,
        };
        let mut flights: [Flight<'_>; FLIGHTS] = std::array::from_fn(|_| Flight {
            lane: 0,
            local: LocalRay::default(),
            state: State::new(bvh, &queries[0]),
            limit: 0.0,
            child: Child::NONE,
            height: 1,
            near: [f32::MIN; STACK],
            children: [Child::NONE.0; STACK],
        });
        let (mut inner, mut leaves) = (List::default(), List::default());
        for (i, flight) in flights.iter_mut().enumerate() {
            if queue.start::<ANY, _>(flight, take) {
                let is_inner = flight.child.is_inner();
                inner.push_if(is_inner, i as u8);
                leaves.push_if(!is_inner, i as u8);
            }
        }
        while inner.len + leaves.len > 0 {
            for place in 0..std::mem::take(&mut inner.len) {
                let i = inner.flights[place % FLIGHTS];
                let flight = &mut flights[usize::from(i) % FLIGHTS];
                let node = &bvh.nodes[flight.child.index()];
                let (mask, near) = node.enter(l, &flight.local, flight.limit);
                let nearest = l.least(near, mask) % WIDTH;
                let rest = mask & !(1 << nearest);
                let height = flight.height;
                let last = flight.children[height - 1];
                let stale = mask == 0 && flight.near[height - 1] > flight.limit;
                if let Some(top) = flight.near[height..].first_chunk_mut() {
                    *top = l.store(l.pack(near, rest));
                }
                if let Some(top) = flight.children[height..].first_chunk_mut() {
                    *top = l.pack_words(&node.children, rest);
                }
                flight.child = Child(select(mask == 0, last, node.children[nearest]));
                flight.height = height + mask.count_ones() as usize - 1;
                if stale {
                    flight.pop();
                }
                bvh.prefetch(flight.child);
                let is_inner = flight.child.is_inner();
                inner.push_if(is_inner, i);
                leaves.push_if(!is_inner, i);
            }
            for place in 0..std::mem::take(&mut leaves.len) {
                let i = leaves.flights[place % FLIGHTS];
                let flight = &mut flights[usize::from(i) % FLIGHTS];
                let mut goes_on = flight.child != Child::NONE;
                if goes_on {
                    let limit = flight.limit;
                    match flight.state.leaf::<ANY, L>(l, &flight.local, flight.child, limit) {
                        Some(nearer) => {
                            flight.limit = nearer;
                            flight.pop();
                            bvh.prefetch(flight.child);
                        }
                        None => goes_on = false,
                    }
                }
                if !goes_on {
                    flight.state.resolve_pending(&flight.local, flight.limit);
                    take(flight.lane, flight.state.best);
                    if !queue.start::<ANY, _>(flight, take) {
                        continue;
                    }
                }
                let is_inner = flight.child.is_inner();
                inner.push_if(is_inner, i);
                leaves.push_if(!is_inner, i);
            }
        }
    }
}
