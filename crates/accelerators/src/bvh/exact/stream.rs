//! Traversal of the hierarchy by the rays of a stream: coherent ones as packets, and others many at
//! a time.
//!
//! A single ray waits: for the node that it needs next, and for branches that no processor can
//! predict. So each of many rays takes one step, without branches, before any takes the next one.
//! Rays that reach leaves wait until few are left at inner nodes; then all test their leaves, and
//! new rays take the places of finished ones.

use super::super::RaySets;
use super::super::stream::Answers;
use super::Sixteen;
use super::leaf::Best;
use super::node::Node;
use super::packet::{Packet, USUAL_DEPTH, Wanted, WantedStack};
use super::ray::{BoxRay, Prepare, Rays, octant};
use super::stack::Stack;
use crate::support::leaves::child::Child;
use crate::support::leaves::state::Streamed;
use std::cell::Cell;
use whitstone_core::stream::{GROUP, LANES, RayStream};
use whitstone_simd::{WideKernel, WideMachine, with_wide_lanes};

/// Number of rays that are traversed at a time.
const RAYS: usize = 40;

/// Once at most this many rays are at inner nodes, leaves are tested.
const FEW: usize = RAYS / 8;

/// Finds the nearest hits of the rays of a stream, or with `ANY` whether there are any.
pub(super) struct Stream<'a, const ANY: bool, A> {
    pub(super) tree: &'a Sixteen,
    pub(super) rays: &'a RayStream,
    pub(super) answers: &'a mut A,
    pub(super) places: &'a mut Places,
}

/// The memory of a traversal.
pub(super) struct Places {
    /// Rays that are being traversed.
    places: [Place; RAYS],
    prepared: Rays,
    best: [Best; GROUP],
    alone: [BoxRay; GROUP],
    wanted: WantedStack,
}

impl Places {
    /// Calls `f` with memory of this thread: clearing it for every stream would take a tenth of a
    /// stream's time.
    pub(super) fn with<R>(f: impl FnOnce(&mut Self) -> R) -> R {
        thread_local! {
            static MEMORY: Cell<Option<Box<Places>>> = const { Cell::new(None) };
        }
        let new = || {
            Box::new(Self {
                places: std::array::from_fn(|_| Place::new()),
                prepared: Rays::default(),
                best: Default::default(),
                alone: Default::default(),
                wanted: [Wanted::default(); _],
            })
        };
        let mut places = MEMORY.take().unwrap_or_else(new);
        let result = f(&mut places);
        MEMORY.set(Some(places));
        result
    }
}

impl<const ANY: bool, A: Answers> WideKernel for Stream<'_, ANY, A> {
    type Output = ();

    #[inline(always)]
    fn run<M: WideMachine>(self, m: M) {
        let Self {
            tree,
            rays,
            answers,
            places,
        } = self;
        let mut groups = Groups {
            starts: [0; LANES / GROUP],
            count: 0,
        };
        let shallow = tree.depth <= USUAL_DEPTH && !tree.leaves.slots.is_empty();
        let packets = shallow && tree.sets != RaySets::None;
        for start in rays.groups() {
            rays.prefetch(start + GROUP);
            let coherent = packets && start + GROUP <= rays.len;
            let packed = match if coherent { octant(rays, start) } else { None } {
                Some(octant) => packet::<ANY, M>(m, tree, rays, start, octant, answers, places),
                None => false,
            };
            if !packed {
                groups.push(start);
            }
        }
        if groups.count > 0 {
            let source = Source::<ANY> {
                tree,
                rays,
                groups,
                lanes: 0..0,
                start: 0,
                prepared: &mut places.prepared,
            };
            flight::<ANY, M>(m, source, answers, &mut places.places);
        }
    }
}

/// Traces the rays of a group as a packet; returns whether all are valid.
#[inline(always)]
fn packet<const ANY: bool, M: WideMachine>(
    m: M,
    tree: &Sixteen,
    rays: &RayStream,
    start: usize,
    octant: usize,
    answers: &mut impl Answers,
    places: &mut Places,
) -> bool {
    let Places {
        places: singles,
        prepared,
        best,
        alone,
        wanted,
    } = places;
    let frame = &tree.leaves.frame;
    with_wide_lanes(Prepare {
        frame,
        rays,
        start,
        to: prepared,
    });
    if !prepared.are_sound() {
        return false;
    }
    let mut limits = [f32::NEG_INFINITY; GROUP];
    let mut max = [f64::NEG_INFINITY; GROUP];
    for k in 0..GROUP {
        let query = Streamed {
            rays,
            lane: start + k,
        };
        if best[k].restart::<ANY>(&tree.leaves, &query) {
            max[k] = best[k].max;
            limits[k] = prepared.above(k, max[k]);
        }
    }
    let mut packet = Packet {
        tree,
        rays,
        start,
        prepared,
        sides: [octant & 1, octant >> 1 & 1, octant >> 2 & 1],
        axes: prepared.axes(),
        best,
        limits,
        max,
        alone,
        here: 0,
    };
    packet.traverse::<ANY, M>(m, wanted, &mut singles[0].stack);
    for k in 0..GROUP {
        answers.set(start + k, best[k].hit);
    }
    true
}

/// Traces many rays at a time.
#[inline(always)]
fn flight<const ANY: bool, M: WideMachine>(
    m: M,
    mut source: Source<'_, ANY>,
    answers: &mut impl Answers,
    places: &mut [Place; RAYS],
) {
    let (tree, rays) = (source.tree, source.rays);
    let nodes = &*tree.nodes;
    // The places of rays at inner nodes, at leaves, and at the end. Sets, not lists: a list grows
    // by a number of entries that is not known until a step is complete, and the next step would
    // wait for it, because it might read what is written there.
    let (mut inner, mut leaves, mut done) = (Set(0), Set(0), Set(0));
    for (number, place) in places.iter_mut().enumerate() {
        if !source.start(place, answers) {
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
        // A leaf is rarely in the nearest cache, and whether it is hit is hard to predict: without
        // this, each ray would wait for its own leaf.
        for number in leaves {
            tree.leaves.prefetch(places[number].child);
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
                    place.limit = place.local.above(place.best.max);
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
                left = source.start(place, answers);
            }
            done.remove(number, true);
            inner.insert(number, left & place.child.is_inner());
            leaves.insert(number, left & !place.child.is_inner());
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

/// Some groups of the rays of a stream, by their first lanes.
struct Groups {
    starts: [usize; LANES / GROUP],
    count: usize,
}

impl Groups {
    #[inline(always)]
    fn push(&mut self, start: usize) {
        self.starts[self.count % (LANES / GROUP)] = start;
        self.count += 1;
    }

    #[inline(always)]
    fn pop(&mut self) -> Option<usize> {
        self.count = self.count.checked_sub(1)?;
        Some(self.starts[self.count % (LANES / GROUP)])
    }
}

/// The rays that are not yet started.
struct Source<'a, const ANY: bool> {
    tree: &'a Sixteen,
    rays: &'a RayStream,
    groups: Groups,
    /// A group that is prepared: its first lane, and which of its rays are left.
    prepared: &'a mut Rays,
    start: usize,
    lanes: std::ops::Range<usize>,
}

impl<const ANY: bool> Source<'_, ANY> {
    /// Starts the next ray that must be traversed; returns whether there is one.
    #[inline(always)]
    fn start(&mut self, place: &mut Place, answers: &mut impl Answers) -> bool {
        loop {
            let Some(k) = self.lanes.next() else {
                let Some(start) = self.groups.pop() else {
                    return false;
                };
                self.start = start;
                self.lanes = 0..GROUP.min(self.rays.len - start);
                with_wide_lanes(Prepare {
                    frame: &self.tree.leaves.frame,
                    rays: self.rays,
                    start,
                    to: self.prepared,
                });
                continue;
            };
            let lane = self.start + k;
            let query = Streamed {
                rays: self.rays,
                lane,
            };
            let leaves = &self.tree.leaves;
            if place.best.restart::<ANY>(leaves, &query) {
                if self.prepared.is_sound(k) {
                    self.prepared.get(k, &mut place.local, &mut place.best.sheared);
                    place.limit = place.local.above(place.best.max);
                    place.child = self.tree.root;
                    place.lane = lane;
                    place.stack.clear();
                    return true;
                }
                place.best.try_slots(leaves, &query);
            }
            answers.set(lane, place.best.hit);
        }
    }
}

/// A ray that is being traversed.
struct Place {
    local: BoxRay,
    limit: f32,
    child: Child,
    lane: usize,
    best: Best,
    stack: Stack,
}

impl Place {
    fn new() -> Self {
        Self {
            local: BoxRay::default(),
            limit: 0.0,
            child: Child::default(),
            lane: 0,
            best: Best::default(),
            stack: Stack::new(),
        }
    }

    /// Visits an inner node.
    #[inline(always)]
    fn step<M: WideMachine>(&mut self, m: M, nodes: &[Node]) {
        let height = self.stack.make_room();
        let node = &nodes[self.child.index()];
        let entered = node.enter(m, &self.local, self.limit);
        let sorted = node.sorted(m, self.local.octant, &entered);
        self.child = self.stack.push_and_pop(m, height, sorted);
    }
}
