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
pub(super) struct Places(Vec<Place>);

impl Places {
    /// Calls `f` with memory of this thread: clearing it for every stream would take a tenth of a
    /// stream's time.
    pub(super) fn with<R>(f: impl FnOnce(&mut Self) -> R) -> R {
        thread_local! {
            static MEMORY: Cell<Option<Places>> = const { Cell::new(None) };
        }
        let new = || Self((0..RAYS).map(|_| Place::new()).collect());
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
        for start in (0..AHEAD).step_by(GROUP) {
            rays.prefetch(start);
        }
        // The places of rays at inner nodes, at leaves, and at the end. Sets, not lists: a list
        // grows by a number of entries that is not known until a step is complete, and the next
        // step would wait for it, because it might read what is written there.
        let (mut inner, mut leaves, mut done) = (Set(0), Set(0), Set(0));
        for (number, place) in places.iter_mut().enumerate() {
            if !source.start(m, place, answers) {
                break;
            }
            inner.insert(number, place.child.is_inner());
            leaves.insert(number, !place.child.is_inner());
        }
        while inner.len() + leaves.len() + done.len() > 0 {
            loop {
                for number in inner {
                    let place = &mut places[number];
                    place.step(m, nodes);
                    let now = place.child;
                    inner.remove(number, !now.is_inner());
                    leaves.insert(number, now.is_leaf());
                    done.insert(number, now == Stack::END);
                }
                if inner.len() <= FEW {
                    break;
                }
            }
            for number in leaves {
                let place = &mut places[number];
                let query = Streamed {
                    rays,
                    lane: place.lane,
                };
                if tree.leaf::<ANY, M>(m, &mut place.best, place.child, &query) {
                    if ANY {
                        place.stack.clear();
                    } else {
                        place.limit = place.best.limit(&place.local);
                        place.stack.cull(m, place.limit);
                    }
                }
                place.child = place.stack.pop().1;
                let now = place.child;
                inner.insert(number, now.is_inner());
                leaves.remove(number, !now.is_leaf());
                done.insert(number, now == Stack::END);
            }
            for number in done {
                let place = &mut places[number];
                place.child = place.stack.pop_spilled().1;
                let mut left = true;
                if place.child == Stack::END {
                    answers.set(place.lane, place.best.hit);
                    left = source.start(m, place, answers);
                }
                done.remove(number, true);
                inner.insert(number, left & place.child.is_inner());
                leaves.insert(number, left & !place.child.is_inner());
            }
        }
    }
}

/// A set of places.
#[derive(Clone, Copy)]
struct Set(u64);

impl Set {
    #[inline(always)]
    fn len(self) -> usize {
        self.0.count_ones() as usize
    }

    /// Inserts a number if `really`, without a branch.
    #[inline(always)]
    fn insert(&mut self, number: usize, really: bool) {
        self.0 |= u64::from(really) << (number % 64);
    }

    /// Removes a number if `really`, without a branch.
    #[inline(always)]
    fn remove(&mut self, number: usize, really: bool) {
        self.0 &= !(u64::from(really) << (number % 64));
    }
}

impl Iterator for Set {
    type Item = usize;

    #[inline(always)]
    fn next(&mut self) -> Option<usize> {
        let number = self.0.trailing_zeros() as usize;
        self.0 &= self.0.wrapping_sub(1);
        (number < RAYS).then_some(number)
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
            if lane.is_multiple_of(GROUP) {
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
