//! Packet traversal: sixteen rays of one octant go through the hierarchy together, as long as
//! enough of them visit the same nodes.
//!
//! Wald, Slusallek, Benthin, Wagner, *Interactive rendering with coherent ray tracing*, 2001: each
//! box is tested with all rays, and so is each triangle of a leaf that enough rays visit. Where few
//! rays are left, each continues alone. Boxes missed by bounds on all rays are culled first,
//! sixteen at once (Boulos, Wald, Shirley, *Geometric and arithmetic culling methods for entire ray
//! packets*, 2006, section 3).

use super::super::RaySets;
use super::super::node::Node;
use super::Sixteen;
use super::leaf::{Beam, Best, Sides};
use super::ray::{Axis, BoxRay, Rays};
use super::search::Alone;
use super::stack::Stack;
use crate::support::leaves::child::{Child, Kind};
use crate::support::leaves::filter::NUMBERS;
use crate::support::leaves::state::Streamed;
use whitstone_core::stream::{GROUP, RayStream};
use whitstone_simd::{Lanes, WideMachine};

/// Up to this number of rays, each is traced alone.
const FEW: u32 = 1;

/// Deeper hierarchies are traversed ray by ray.
pub(super) const USUAL_DEPTH: usize = 16;

/// A packet of rays.
pub(super) struct Packet<'a> {
    pub(super) tree: &'a Sixteen,
    pub(super) rays: &'a RayStream,
    /// The lane of the first ray.
    pub(super) start: usize,
    pub(super) prepared: &'a Rays,
    /// For each axis, the side (0 minimum, 1 maximum) by which the rays enter boxes.
    pub(super) sides: [usize; 3],
    /// The axes of the triangle test, if they are the same for all rays.
    pub(super) axes: Option<[Axis; 3]>,
    pub(super) best: &'a mut [Best; GROUP],
    /// Hits beyond these parameters do not count, in local and in world coordinates; minus infinity
    /// for a ray that is done.
    pub(super) limits: [f32; GROUP],
    pub(super) max: [f64; GROUP],
    /// The rays as single rays, and which of them are there, as a bit mask.
    pub(super) alone: &'a mut [BoxRay; GROUP],
    pub(super) here: u32,
}

/// A child, and the rays that enter it.
#[derive(Clone, Copy, Default)]
pub(super) struct Wanted {
    /// Smallest entry distance of these rays.
    near: f32,
    child: Child,
    /// The rays, as a bit mask.
    rays: u32,
}

/// Stack of deferred children: each level of nodes defers fifteen at most.
pub(super) type WantedStack = [Wanted; (USUAL_DEPTH * 15 + 1).next_power_of_two()];

/// Bounds on the values of all rays; see [`BoxRay`].
#[derive(Default)]
struct Bounds {
    reciprocal: [[f32; 2]; 3],
    near: [f32; 3],
    far: [f32; 3],
    min: f32,
}

impl Packet<'_> {
    /// Traverses the hierarchy.
    #[inline(always)]
    pub(super) fn traverse<const ANY: bool, M: WideMachine>(
        &mut self,
        m: M,
        wanted: &mut WantedStack,
        stack: &mut Stack,
    ) {
        let size = wanted.len();
        let (mut child, mut rays) = (self.tree.root, (1u32 << GROUP) - 1);
        let mut height = 0;
        let bounds = self.bounds(m);
        // The largest of the limits.
        let mut farthest = m.largest(m.load(&self.limits));
        loop {
            if rays.count_ones() <= FEW {
                self.each::<ANY>(rays, |query, best, local| {
                    Alone::<ANY> {
                        tree: query.0,
                        best,
                        local,
                        query: query.1,
                        child,
                        stack,
                    }
                    .traverse();
                });
                farthest = m.largest(m.load(&self.limits));
            } else if let Kind::Inner(node) = child.kind() {
                let node = self.tree.node(node);
                let bottom = height;
                // Tests all boxes before any is pushed: fewer branches depend on the results.
                let mut nears = [m.splat(0.0); 16];
                let mut wants = [0; 16];
                let mut hit = 0;
                let mut some = match self.tree.sets {
                    RaySets::Packets => (1 << 16) - 1,
                    _ => self.cull(m, node, farthest, &bounds),
                };
                while some != 0 {
                    let i = some.trailing_zeros() as usize % 16;
                    some &= some - 1;
                    (nears[i], wants[i]) = self.enter(m, node, i, rays);
                    hit |= u32::from(wants[i] != 0) << i;
                }
                while hit != 0 {
                    let i = hit.trailing_zeros() as usize % 16;
                    hit &= hit - 1;
                    let near = if ANY {
                        f32::NEG_INFINITY
                    } else {
                        m.smallest(nears[i])
                    };
                    let entry = Wanted {
                        near,
                        child: Child(node.children[i]),
                        rays: wants[i],
                    };
                    let mut place = height;
                    while !ANY && place > bottom && wanted[(place - 1) % size].near < near {
                        wanted[place % size] = wanted[(place - 1) % size];
                        place -= 1;
                    }
                    wanted[place % size] = entry;
                    height += 1;
                }
            } else {
                self.leaf::<ANY, M>(m, child, rays);
                farthest = m.largest(m.load(&self.limits));
            }
            loop {
                if height == 0 {
                    return;
                }
                height -= 1;
                let entry = &wanted[height % size];
                if entry.near <= farthest {
                    (child, rays) = (entry.child, entry.rays);
                    break;
                }
            }
        }
    }

    /// Tests the elements of a leaf.
    #[inline(always)]
    fn leaf<const ANY: bool, M: WideMachine>(&mut self, m: M, leaf: Child, rays: u32) {
        let together = match (leaf.kind(), self.axes) {
            (Kind::Triangles(first, count), Some(axes)) if rays.count_ones() as usize > count => {
                Some((first, count, axes))
            }
            _ => None,
        };
        let Some((first, count, axes)) = together else {
            return self.each::<ANY>(
                rays,
                #[inline(always)]
                |(tree, query), best, _| {
                    tree.leaf::<ANY, M>(m, best, leaf, &query);
                },
            );
        };
        let d = m.doubles();
        let leaves = &self.tree.leaves;
        for i in 0..count {
            let mut corners = [[0.0; 3]; 3];
            for k in 0..9 {
                let place = NUMBERS * first + (3 * axes[k % 3] as usize + k / 3) * count + i;
                corners[k / 3][k % 3] = if leaves.doubles.is_empty() {
                    f64::from(leaves.numbers[place]) * leaves.exact
                } else {
                    leaves.doubles[place]
                };
            }
            let slot = leaves.slots[first + i];
            for half in 0..2 {
                let valid = rays >> (8 * half) & 255;
                let sides = Sides::new(d, &self.beam(half, &corners));
                if sides.mask & valid == 0 {
                    continue;
                }
                let reached = sides.reach(d, &self.beam(half, &corners), valid);
                let mut mask = reached.mask;
                let mut sure = if ANY { mask & reached.sure } else { 0 };
                mask &= !sure;
                while sure != 0 {
                    let lane = 8 * half + sure.trailing_zeros() as usize % 8;
                    sure &= sure - 1;
                    if self.best[lane].accept(slot) {
                        self.done(lane);
                    }
                }
                if mask == 0 {
                    continue;
                }
                let hits = reached.intersect(d, &self.beam(half, &corners));
                mask &= hits.mask;
                while mask != 0 {
                    let lane = mask.trailing_zeros() as usize % 8;
                    mask &= mask - 1;
                    let ray = 8 * half + lane;
                    if self.best[ray].offer_lane(d, &hits, lane, slot) {
                        self.shorten::<ANY>(ray);
                    }
                }
            }
        }
    }

    #[inline(always)]
    fn beam<'b>(&'b self, half: usize, corners: &'b [[f64; 3]; 3]) -> Beam<'b> {
        Beam {
            rays: self.prepared,
            half,
            corners,
            max: &self.max,
        }
    }

    /// Takes over the best hit of a ray.
    #[inline(always)]
    fn shorten<const ANY: bool>(&mut self, lane: usize) {
        if ANY && self.best[lane].hit.is_some() {
            self.done(lane);
        } else {
            self.max[lane] = self.best[lane].max;
            self.limits[lane] = self.prepared.above(lane, self.max[lane]);
        }
    }

    #[inline(always)]
    fn done(&mut self, lane: usize) {
        self.limits[lane] = f32::NEG_INFINITY;
        self.max[lane] = f64::NEG_INFINITY;
    }

    /// Calls `f` for each of these rays that is not done.
    #[inline(always)]
    fn each<const ANY: bool>(
        &mut self,
        mut rays: u32,
        mut f: impl FnMut((&Sixteen, Streamed<'_>), &mut Best, &BoxRay),
    ) {
        while rays != 0 {
            let lane = rays.trailing_zeros() as usize % GROUP;
            rays &= rays - 1;
            if self.limits[lane] > f32::NEG_INFINITY {
                let (best, local) = (&mut self.best[lane], &mut self.alone[lane]);
                if self.here & 1 << lane == 0 {
                    self.here |= 1 << lane;
                    self.prepared.get(lane, local, &mut best.sheared);
                }
                let query = Streamed {
                    rays: self.rays,
                    lane: self.start + lane,
                };
                f((self.tree, query), best, local);
                self.shorten::<ANY>(lane);
            }
        }
    }

    /// Bounds on all rays.
    #[inline(always)]
    fn bounds<L: Lanes<GROUP>>(&self, l: L) -> Bounds {
        let mut b = Bounds::default();
        for axis in 0..3 {
            let r = l.load(&self.prepared.reciprocal[axis]);
            b.reciprocal[axis] = [l.smallest(r), l.largest(r)];
            b.near[axis] = l.smallest(l.load(&self.prepared.near[axis]));
            b.far[axis] = l.largest(l.load(&self.prepared.far[axis]));
        }
        b.min = l.smallest(l.load(&self.prepared.min));
        b
    }

    /// Which boxes any ray may hit, as a bit mask, all at once; the others need no test. Rounded
    /// products and sums are monotonic too, so results computed from bounds bound those of
    /// [`Self::enter`].
    #[inline(always)]
    fn cull<L: Lanes<16>>(&self, l: L, node: &Node<16>, farthest: f32, b: &Bounds) -> u32 {
        let mut near = l.splat(b.min);
        let mut far = l.splat(farthest);
        for axis in 0..3 {
            let side = self.sides[axis] & 1;
            let sides = &node.planes[axis];
            let (enter, leave) = (l.load(&sides[side]), l.load(&sides[side ^ 1]));
            let [r0, r1] = b.reciprocal[axis];
            let [r0, r1] = [l.splat(r0), l.splat(r1)];
            let (n, f) = (l.splat(b.near[axis]), l.splat(b.far[axis]));
            near = l.max(l.min(l.mul_add(enter, r0, n), l.mul_add(enter, r1, n)), near);
            far = l.min(l.max(l.mul_add(leave, r0, f), l.mul_add(leave, r1, f)), far);
        }
        l.at_most(near, far)
    }

    /// Lower bounds on the rays' entry distances into a box, and which rays may hit it; the same
    /// numbers as for single rays.
    #[inline(always)]
    fn enter<L: Lanes<GROUP>>(&self, l: L, node: &Node<16>, i: usize, rays: u32) -> (L::Floats, u32) {
        let mut near = l.load(&self.prepared.min);
        let mut far = l.load(&self.limits);
        for axis in 0..3 {
            let side = self.sides[axis] & 1;
            let sides = &node.planes[axis];
            let (enter, leave) = (l.splat(sides[side][i]), l.splat(sides[side ^ 1][i]));
            let reciprocal = l.load(&self.prepared.reciprocal[axis]);
            let enter = l.mul_add(enter, reciprocal, l.load(&self.prepared.near[axis]));
            let leave = l.mul_add(leave, reciprocal, l.load(&self.prepared.far[axis]));
            near = l.max(enter, near);
            far = l.min(leave, far);
        }
        (near, l.at_most(near, far) & rays)
    }
}
