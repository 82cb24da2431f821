//! Packet traversal: sixteen rays of one octant go through the hierarchy together, as long as
//! enough of them visit the same nodes.
//!
//! Wald, Slusallek, Benthin, Wagner, *Interactive rendering with coherent ray tracing*, 2001: each
//! box is tested with all rays, and so is each triangle of a leaf that enough rays visit. Where few
//! rays are left, each continues alone. Boxes missed by bounds on all rays are culled first, eight
//! at once (Boulos, Wald, Shirley, *Geometric and arithmetic culling methods for entire ray
//! packets*, 2006, section 3).

use super::node::Node;
use super::search::{SingleRay, Stack};
use super::{Eight, RaySets};
use crate::support::leaves::child::{Child, Kind, WIDTH};
use crate::support::leaves::filter::{Beam, NUMBERS, filter};
use crate::support::leaves::frame::{Alone, LocalLane, LocalRays};
use crate::support::leaves::state::{State, Streamed, Sure};
use whitstone_core::stream::GROUP;
use whitstone_core::triangle::Axis;
use whitstone_simd::{Lanes, Machine};

/// Up to this number of rays, each is traced alone.
const FEW: u32 = 3;

/// Deeper hierarchies are traversed ray by ray.
pub(super) const USUAL_DEPTH: usize = 18;

/// A packet of rays.
pub(super) struct Packet<'a, 's> {
    pub(super) bvh: &'a Eight,
    pub(super) rays: &'s LocalRays,
    pub(super) alone: &'s mut Alone,
    pub(super) states: &'s mut [State<'a, Streamed<'a>>; GROUP],
    /// Hits beyond these parameters do not count; minus infinity for a ray that is done.
    pub(super) limits: [f32; GROUP],
    pub(super) octant: [usize; 3],
    /// The axes of [`LocalRay`](crate::support::leaves::frame::LocalRay), if they are the same for
    /// all rays.
    pub(super) axes: Option<[Axis; 3]>,
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

/// Stack of deferred children: each level of nodes defers seven at most.
pub(super) type WantedStack = [Wanted; (USUAL_DEPTH * (WIDTH - 1) + 1).next_power_of_two()];

/// Bounds on the values of all rays; see [`LocalRay`](crate::support::leaves::frame::LocalRay).
#[derive(Default)]
struct Bounds {
    reciprocal: [[f32; 2]; 3],
    near: [f32; 3],
    far: [f32; 3],
    min: f32,
}

impl Packet<'_, '_> {
    /// Traverses the subtree of `child` with some rays, given as a bit mask.
    #[inline(always)]
    pub(super) fn traverse<const ANY: bool, M: Machine>(
        &mut self,
        m: M,
        mut child: Child,
        mut rays: u32,
        wanted: &mut WantedStack,
        stack: &mut Stack,
    ) {
        let l = m.wide();
        let size = wanted.len();
        let mut height = 0;
        let bounds = self.bounds(l);
        // The largest of the limits.
        let mut farthest = l.largest(l.load(&self.limits));
        loop {
            let mut inner = false;
            if rays.count_ones() <= FEW {
                self.each(
                    rays,
                    #[inline(always)]
                    |packet, lane| {
                        let (state, local) = (&mut packet.states[lane], packet.alone.get(packet.rays, lane));
                        let one = SingleRay::<ANY> {
                            bvh: packet.bvh,
                            state,
                            local,
                            child,
                            stack,
                            limit: packet.limits[lane],
                        };
                        let limit = one.traverse();
                        packet.limits[lane] = if ANY && state.best.is_some() {
                            f32::NEG_INFINITY
                        } else {
                            limit
                        };
                    },
                );
            } else if let Kind::Inner(node) = child.kind() {
                let node = &self.bvh.nodes[node];
                inner = true;
                let bottom = height;
                // Tests all boxes before any is pushed: fewer branches depend on the results.
                let mut nears = [l.splat(0.0); WIDTH];
                let mut wants = [0; WIDTH];
                let mut hit = 0;
                let mut some = match self.bvh.sets {
                    RaySets::Packets => (1 << WIDTH) - 1,
                    _ => self.cull(m, node, farthest, &bounds),
                };
                while some != 0 {
                    let i = some.trailing_zeros() as usize % WIDTH;
                    some &= some - 1;
                    (nears[i], wants[i]) = self.enter(l, node, i, rays);
                    hit |= u32::from(wants[i] != 0) << i;
                }
                while hit != 0 {
                    let i = hit.trailing_zeros() as usize % WIDTH;
                    hit &= hit - 1;
                    let near = if ANY {
                        f32::NEG_INFINITY
                    } else {
                        l.smallest(nears[i])
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
            }
            if !inner {
                farthest = l.largest(l.load(&self.limits));
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
    fn leaf<const ANY: bool, M: Machine>(&mut self, m: M, leaf: Child, rays: u32) {
        let together = match (leaf.kind(), self.axes) {
            (Kind::Triangles(first, count), Some(axes)) if 2 * rays.count_ones() as usize > count => {
                Some((first, count, axes))
            }
            _ => None,
        };
        let Some((first, count, axes)) = together else {
            return self.each(
                rays,
                #[inline(always)]
                |packet, lane| {
                    let (state, local) = (&mut packet.states[lane], packet.alone.get(packet.rays, lane));
                    let limit = state.leaf::<ANY, M>(m, local, leaf, packet.limits[lane]);
                    packet.limits[lane] = limit.unwrap_or(f32::NEG_INFINITY);
                },
            );
        };
        let numbers = &self.bvh.leaves.numbers[NUMBERS * first..][..NUMBERS * count];
        for i in 0..count {
            let pairs = Beam {
                rays: self.rays,
                axes,
                numbers: &numbers[i..],
                stride: count,
                limits: &self.limits,
            };
            let Some(filtered) = filter(m.wide(), &pairs, rays) else {
                continue;
            };
            let (mut sure, mut unsure) = (filtered.sure, filtered.unsure);
            while sure != 0 {
                let lane = sure.trailing_zeros() as usize % GROUP;
                sure &= sure - 1;
                let bounds = [filtered.low[lane], filtered.high[lane]];
                let (state, local) = (&mut self.states[lane], &LocalLane(self.rays, lane));
                match state.sure::<ANY>(local, leaf, i, bounds, self.limits[lane]) {
                    Sure::Nearer(nearer) => self.limits[lane] = nearer,
                    Sure::Unsure => unsure |= 1 << lane,
                    Sure::Found => self.limits[lane] = f32::NEG_INFINITY,
                }
            }
            while unsure != 0 {
                let lane = unsure.trailing_zeros() as usize % GROUP;
                unsure &= unsure - 1;
                let (state, local) = (&mut self.states[lane], &LocalLane(self.rays, lane));
                let limit = state.unsure::<ANY>(local, leaf, i, self.limits[lane]);
                self.limits[lane] = limit.unwrap_or(f32::NEG_INFINITY);
            }
        }
    }

    /// Calls `f` for each of these rays that is not done.
    #[inline(always)]
    fn each(&mut self, mut rays: u32, mut f: impl FnMut(&mut Self, usize)) {
        while rays != 0 {
            let lane = rays.trailing_zeros() as usize % GROUP;
            rays &= rays - 1;
            if self.limits[lane] > f32::NEG_INFINITY {
                f(self, lane);
            }
        }
    }

    /// Bounds on all rays.
    #[inline(always)]
    fn bounds<L: Lanes<GROUP>>(&self, l: L) -> Bounds {
        let mut b = Bounds::default();
        for axis in 0..3 {
            let r = l.load(&self.rays.reciprocal[axis]);
            b.reciprocal[axis] = [l.smallest(r), l.largest(r)];
            b.near[axis] = l.smallest(l.load(&self.rays.near[axis]));
            b.far[axis] = l.largest(l.load(&self.rays.far[axis]));
        }
        b.min = l.smallest(l.load(&self.rays.min));
        b
    }

    /// Which boxes any ray may hit, as a bit mask, all eight at once; the others need no test.
    /// Rounded products and sums are monotonic too, so results computed from bounds bound those of
    /// [`Self::enter`].
    #[inline(always)]
    fn cull<M: Machine>(&self, l: M, node: &Node<WIDTH>, farthest: f32, b: &Bounds) -> u32 {
        let mut near = l.splat(b.min);
        let mut far = l.splat(farthest);
        for axis in 0..3 {
            let side = self.octant[axis] & 1;
            let sides = &node.planes[axis];
            let (enter, leave) = (l.load(&sides[side]), l.load(&sides[side ^ 1]));
            let [r0, r1] = b.reciprocal[axis].map(|r| l.splat(r));
            let (n, f) = (l.splat(b.near[axis]), l.splat(b.far[axis]));
            near = l.max(l.min(l.mul_add(enter, r0, n), l.mul_add(enter, r1, n)), near);
            far = l.min(l.max(l.mul_add(leave, r0, f), l.mul_add(leave, r1, f)), far);
        }
        l.at_most(near, far)
    }

    /// Lower bounds on the rays' entry distances into a box, and which rays may hit it; the same
    /// numbers as in [`Node::enter`].
    #[inline(always)]
    fn enter<L: Lanes<GROUP>>(&self, l: L, node: &Node<WIDTH>, i: usize, rays: u32) -> (L::Floats, u32) {
        let mut near = l.load(&self.rays.min);
        let mut far = l.load(&self.limits);
        for axis in 0..3 {
            let side = self.octant[axis] & 1;
            let sides = &node.planes[axis];
            let (enter, leave) = (l.splat(sides[side][i]), l.splat(sides[side ^ 1][i]));
            let reciprocal = l.load(&self.rays.reciprocal[axis]);
            let enter = l.mul_add(enter, reciprocal, l.load(&self.rays.near[axis]));
            let leave = l.mul_add(leave, reciprocal, l.load(&self.rays.far[axis]));
            near = l.max(enter, near);
            far = l.min(leave, far);
        }
        let wants = l.at_most(near, far) & rays;
        (near, wants)
    }
}
