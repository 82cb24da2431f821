//! Sixteen rays of one octant through the hierarchy together, as long as enough of them want the same nodes.
//!
//! Wald, Slusallek, Benthin, Wagner, *Interactive rendering with coherent ray tracing*, 2001: here boxes are tested one
//! by one with all rays; in leaves, and where few rays are left, each ray goes alone.

use super::Bvh;
use super::frame::{LocalRay, LocalRays};
use super::node::{Child, Kind, Node, WIDTH};
use super::search::{Query, State, USUAL_DEPTH, stack_size};
use whitstone_core::Ray;
use whitstone_core::stream::GROUP;
use whitstone_simd::Lanes;

/// So many rays or fewer go alone.
const FEW: u32 = 3;

/// The stack of a ray that goes alone.
pub(super) type Stack = [(f32, Child); stack_size(USUAL_DEPTH)];

/// Rays that go together.
pub(super) struct Packet<'a, 's> {
    pub(super) bvh: &'a Bvh,
    pub(super) rays: &'s LocalRays,
    pub(super) alone: &'s [LocalRay; GROUP],
    pub(super) states: &'s mut [State<'a, Query<Ray>>; GROUP],
    /// Beyond these nothing counts; minus infinity for a ray that is done.
    pub(super) limits: [f32; GROUP],
    pub(super) octant: [usize; 3],
}

/// Some rays that want something.
#[derive(Clone, Copy, Default)]
pub(super) struct Wanted {
    /// The least distance at which one of them enters it.
    near: f32,
    child: Child,
    /// Which, as bits.
    rays: u32,
}

/// Room for what is put off.
pub(super) type WantedStack = [Wanted; stack_size(USUAL_DEPTH)];

impl Packet<'_, '_> {
    /// Sends rays, as bits, through what is below a child.
    #[inline(always)]
    pub(super) fn traverse<const ANY: bool, L: Lanes>(
        &mut self,
        l: L,
        mut child: Child,
        mut rays: u32,
        wanted: &mut WantedStack,
        stack: &mut Stack,
    ) {
        let size = wanted.len();
        let mut height = 0;
        // The largest of the limits.
        let mut farthest = l.largest(l.load_wide(&self.limits));
        loop {
            let mut inner = false;
            if rays.count_ones() <= FEW {
                self.each(
                    rays,
                    #[inline(always)]
                    |packet, lane| {
                        let (state, local) = (&mut packet.states[lane], &packet.alone[lane]);
                        let limit = state.traverse::<ANY, _, L>(l, local, child, stack, packet.limits[lane]);
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
                for i in 0..WIDTH {
                    if node.planes[0][0][i] == f32::INFINITY {
                        break;
                    }
                    let (near, wants) = self.enter(l, node, i, rays);
                    if wants == 0 {
                        continue;
                    }
                    let near = l.smallest(near);
                    let entry = Wanted {
                        near,
                        child: Child(node.children[i]),
                        rays: wants,
                    };
                    let mut place = height;
                    while place > bottom && wanted[(place - 1) % size].near < near {
                        wanted[place % size] = wanted[(place - 1) % size];
                        place -= 1;
                    }
                    wanted[place % size] = entry;
                    height += 1;
                }
            } else {
                self.each(
                    rays,
                    #[inline(always)]
                    |packet, lane| {
                        let (state, local) = (&mut packet.states[lane], &packet.alone[lane]);
                        let limit = state.leaf::<ANY, L>(l, local, child, packet.limits[lane]);
                        packet.limits[lane] = limit.unwrap_or(f32::NEG_INFINITY);
                    },
                );
            }
            if !inner {
                farthest = l.largest(l.load_wide(&self.limits));
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

    /// Calls `f` for all of these rays that are not done.
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

    /// Which of these rays may meet a box, and where the first of them enters it at the earliest; the same
    /// numbers as in [`Node::enter`].
    #[inline(always)]
    fn enter<L: Lanes>(&self, l: L, node: &Node, i: usize, rays: u32) -> (L::Wide, u32) {
        let mut near = l.load_wide(&self.rays.min);
        let mut far = l.load_wide(&self.limits);
        for axis in 0..3 {
            let side = self.octant[axis] & 1;
            let sides = &node.planes[axis];
            let (enter, leave) = (l.splat_wide(sides[side][i]), l.splat_wide(sides[side ^ 1][i]));
            let reciprocal = l.load_wide(&self.rays.reciprocal[axis]);
            let enter = l.mul_add_wide(enter, reciprocal, l.load_wide(&self.rays.near[axis]));
            let leave = l.mul_add_wide(leave, reciprocal, l.load_wide(&self.rays.far[axis]));
            near = l.max_wide(enter, near);
            far = l.min_wide(leave, far);
        }
        let wants = l.at_most_wide(near, far) & rays;
        (near, wants)
    }
}
