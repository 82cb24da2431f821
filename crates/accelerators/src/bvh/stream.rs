//! Traversal of the hierarchy by the rays of a stream, many at a time.
//!
//! A single ray waits: for the node that it needs next, and for branches that no processor can
//! predict. So each of many rays takes one step, without branches, before any takes the next one.
//! Rays that reach leaves wait until few are left at inner nodes; then all test their leaves, and
//! new rays take the places of finished ones.

use super::node::Node;
use super::search::Tree;
use super::stack::Stack;
use crate::support::leaves::child::Child;
use crate::support::leaves::frame::LocalRay;
use crate::support::leaves::search::{Best, Streamed};
use std::cell::Cell;
use whitstone_core::PreliminaryIntersection;
use whitstone_core::stream::{GROUP, HitStream, LANES, Lanes, RayStream};
use whitstone_simd::{Kernel, Machine};

/// Number of rays that are traversed at a time.
const RAYS: usize = 48;

/// Room for a list of rays: a power of two, so that indexing needs no bounds check.
const ROOM: usize = RAYS.next_power_of_two();

/// Once at most this many rays are at inner nodes, leaves are tested.
const FEW: usize = RAYS / 8;

/// Rays are fetched from memory this many lanes before they start.
const AHEAD: usize = RAYS.next_multiple_of(GROUP);

/// Destination of the results.
pub(super) trait Answers {
    /// Stores the result of a ray.
    fn set(&mut self, lane: usize, hit: Option<PreliminaryIntersection>);
}

impl Answers for HitStream {
    #[inline(always)]
    fn set(&mut self, lane: usize, hit: Option<PreliminaryIntersection>) {
        if let Some(hit) = hit {
            HitStream::set(self, lane, &hit);
        }
    }
}

impl Answers for Lanes<bool> {
    #[inline(always)]
    fn set(&mut self, lane: usize, hit: Option<PreliminaryIntersection>) {
        self[lane] = hit.is_some();
    }
}

/// Finds the nearest hits of the rays of a stream, or with `ANY` whether there are any.
pub(super) struct Stream<'a, const ANY: bool, const N: usize, A> {
    pub(super) tree: Tree<'a, N>,
    pub(super) rays: &'a RayStream,
    pub(super) answers: &'a mut A,
    pub(super) places: &'a mut Places,
}

/// The rays that are being traversed.
pub(super) struct Places([Place; RAYS]);

impl Places {
    /// Calls `f` with memory of this thread: clearing it for every stream would take a tenth of a
    /// stream's time.
    pub(super) fn with<R>(f: impl FnOnce(&mut Self) -> R) -> R {
        thread_local! {
            static MEMORY: Cell<Option<Box<Places>>> = const { Cell::new(None) };
        }
        let new = || Box::new(Self(std::array::from_fn(|_| Place::new())));
        let mut places = MEMORY.take().unwrap_or_else(new);
        let result = f(&mut places);
        MEMORY.set(Some(places));
        result
    }
}

impl<const ANY: bool, const N: usize, A: Answers> Kernel<N> for Stream<'_, ANY, N, A> {
    type Output = ();

    #[inline(always)]
    fn run<M: Machine<N>>(self, m: M) {
        let Self {
            tree,
            rays,
            answers,
            places: Places(places),
        } = self;
        let mut source = Source::<ANY, N> { tree, rays, next: 0 };
        let nodes = &*tree.hierarchy.nodes;
        // The places of rays at inner nodes, at leaves or at the end, and at the end.
        let (mut inner, mut leaves, mut done) = ([0u8; ROOM], [0u8; ROOM], [0u8; ROOM]);
        let (mut inner_count, mut leaf_count) = (0, 0);
        for start in (0..AHEAD).step_by(GROUP) {
            rays.prefetch(start);
        }
        while inner_count < RAYS && source.start(m, &mut places[inner_count], answers) {
            inner[inner_count] = inner_count as u8;
            inner_count += 1;
        }
        while inner_count + leaf_count > 0 {
            while inner_count > 0 {
                let mut left = 0;
                for i in 0..inner_count {
                    let number = inner[i];
                    let place = &mut places[usize::from(number)];
                    place.step(m, nodes);
                    let is_inner = place.child.is_inner();
                    (inner[left], leaves[leaf_count % ROOM]) = (number, number);
                    left += usize::from(is_inner);
                    leaf_count += usize::from(!is_inner);
                }
                inner_count = left;
                if inner_count <= FEW {
                    break;
                }
            }
            let (mut left, mut done_count) = (0, 0);
            for i in 0..leaf_count {
                let number = leaves[i];
                let is_done = places[usize::from(number)].child == Stack::END;
                (leaves[left], done[done_count % ROOM]) = (number, number);
                left += usize::from(!is_done);
                done_count += usize::from(is_done);
            }
            leaf_count = left;
            left = 0;
            for i in 0..leaf_count {
                let number = leaves[i];
                let place = &mut places[usize::from(number)];
                let query = Streamed {
                    rays,
                    lane: place.lane,
                };
                if tree.leaf(m, &mut place.best, place.child, &query) {
                    if ANY {
                        place.stack.clear();
                    } else {
                        place.limit = place.best.limit(&place.local);
                        place.stack.cull(m, place.limit);
                    }
                }
                place.child = place.stack.pop().1;
                let is_inner = place.child.is_inner();
                (inner[inner_count % ROOM], leaves[left]) = (number, number);
                inner_count += usize::from(is_inner);
                left += usize::from(!is_inner);
            }
            leaf_count = left;
            for &number in &done[..done_count] {
                let place = &mut places[usize::from(number)];
                place.child = place.stack.pop_spilled().1;
                if place.child == Stack::END {
                    answers.set(place.lane, place.best.hit);
                    if !source.start(m, place, answers) {
                        continue;
                    }
                }
                let is_inner = place.child.is_inner();
                (inner[inner_count % ROOM], leaves[leaf_count % ROOM]) = (number, number);
                inner_count += usize::from(is_inner);
                leaf_count += usize::from(!is_inner);
            }
        }
    }
}

/// The rays that are not yet started.
struct Source<'a, const ANY: bool, const N: usize> {
    tree: Tree<'a, N>,
    rays: &'a RayStream,
    next: usize,
}

impl<const ANY: bool, const N: usize> Source<'_, ANY, N> {
    /// Starts the next ray that must be traversed; returns whether there is one.
    #[inline(always)]
    fn start<M: Machine<N>>(&mut self, m: M, place: &mut Place, answers: &mut impl Answers) -> bool {
        while self.next < self.rays.len.min(LANES) {
            let lane = self.next;
            self.next += 1;
            if lane % GROUP == 0 {
                self.rays.prefetch(lane + AHEAD);
            }
            let query = Streamed {
                rays: self.rays,
                lane,
            };
            if let Some(local) = place.best.start::<ANY, _>(m.quad(), self.tree.leaves, &query) {
                place.local = local;
                place.limit = place.best.limit(&place.local);
                place.child = self.tree.hierarchy.root;
                place.lane = lane;
                place.stack.clear();
                return true;
            }
            answers.set(lane, place.best.hit);
        }
        false
    }
}

/// A ray that is being traversed.
struct Place {
    local: LocalRay,
    limit: f32,
    child: Child,
    lane: usize,
    best: Best,
    stack: Stack,
}

impl Place {
    fn new() -> Self {
        Self {
            local: LocalRay::default(),
            limit: 0.0,
            child: Child::default(),
            lane: 0,
            best: Best::default(),
            stack: Stack::new(),
        }
    }

    /// Visits an inner node.
    #[inline(always)]
    fn step<const N: usize, M: Machine<N>>(&mut self, m: M, nodes: &[Node<N>]) {
        let height = self.stack.make_room::<N>();
        let node = &nodes[self.child.index()];
        let entered = node.enter(m, &self.local, self.limit);
        let sorted = node.sorted(m, self.local.octant, &entered);
        self.child = self.stack.push_and_pop(m, height, sorted);
    }
}
