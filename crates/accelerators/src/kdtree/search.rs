//! The nodes, and their traversal.
//!
//! Front to back, with a ray interval for each cell (t_min, t*, t_max of the lecture notes; Havran,
//! *Heuristic ray shooting algorithms*, 2000, appendix C). The ray is padded to cover rounding
//! errors (see `leaves::frame`): it enters the far side of a plane before it leaves the near side,
//! so the intervals overlap slightly.

use super::KdTree;
use super::build::AxisCut;
use crate::support::elements::Mailbox;
use crate::support::leaves::Leaves;
use crate::support::leaves::child::{Child, Kind, WIDTH};
use crate::support::leaves::frame::LocalRay;
use crate::support::leaves::state::{RayQuery, State, Tally, Walk};
use crate::support::partition::MAX_DEPTH;
use std::ops::Range;
use whitstone_simd::Lanes;

/// A node in 8 bytes (Pharr, Jakob, Humphreys, *Physically based rendering*, 3rd edition, 2016,
/// section 4.4.1).
#[derive(Clone, Copy, Debug)]
pub(super) struct Node {
    /// Inner node: the plane. Leaf: the first slot, as bits.
    plane: f32,
    /// The lowest two bits hold the axis, or 3 in a leaf. Above them, an inner node holds the first
    /// of two consecutive children. A leaf holds one bit that says whether it holds triangles only,
    /// and then its number of elements.
    rest: u32,
}

impl Node {
    const LEAF: u32 = 3;
    const TRIANGLES: u32 = 4;

    /// An empty leaf.
    pub(super) const EMPTY: Self = Self {
        plane: 0.0,
        rest: Self::TRIANGLES | Self::LEAF,
    };

    pub(super) fn inner(cut: &AxisCut, children: usize) -> Self {
        Self {
            plane: cut.plane,
            rest: (children as u32) << 2 | cut.axis as u32,
        }
    }

    /// A leaf of `count` elements.
    pub(super) fn leaf(first: usize, count: usize) -> Self {
        Self {
            plane: f32::from_bits(first as u32),
            rest: (count as u32) << 3 | Self::TRIANGLES | Self::LEAF,
        }
    }

    /// The same leaf, marked as not holding triangles only.
    pub(super) fn mixed(self) -> Self {
        Self {
            rest: self.rest & !Self::TRIANGLES,
            ..self
        }
    }

    #[inline(always)]
    fn axis(self) -> usize {
        (self.rest & 3) as usize
    }

    /// The child of an inner node below the plane, an even number; the other child is the next one.
    #[inline(always)]
    fn children(self) -> u32 {
        self.rest >> 2
    }

    /// Whether a leaf holds triangles only.
    #[inline(always)]
    fn holds_triangles(self) -> bool {
        self.rest & Self::TRIANGLES != 0
    }

    /// The slots of a leaf.
    #[inline(always)]
    pub(super) fn slots(self) -> Range<usize> {
        let first = self.plane.to_bits() as usize;
        first..first + (self.rest >> 3) as usize
    }

    pub(super) fn is_leaf(self) -> bool {
        self.rest & 3 == Self::LEAF
    }

    /// Whether it is an empty leaf.
    pub(super) fn is_empty(self) -> bool {
        self.is_leaf() && self.slots().is_empty()
    }

    /// The plane and the first child of an inner node; `None` for a leaf.
    pub(super) fn cut(self) -> Option<(AxisCut, usize)> {
        let (axis, plane) = (self.axis(), self.plane);
        (!self.is_leaf()).then_some((AxisCut { axis, plane }, self.children() as usize))
    }
}

const _: () = assert!(size_of::<Node>() == 8);

/// A deferred cell: its node and the ray interval in it.
type Later = (u32, f32, f32);

/// The tree, and what counts the work of a search.
pub(super) struct Traversal<'a, T> {
    pub(super) tree: &'a KdTree,
    pub(super) tally: T,
}

impl<T: Tally> Traversal<'_, T> {
    /// The interval of a ray inside the root's cell.
    #[inline(always)]
    fn inside(&self, local: &LocalRay, limit: f32) -> (f32, f32) {
        let (mut near, mut far) = (local.min, limit);
        let sides = [self.tree.cell.min, self.tree.cell.max];
        for axis in 0..3 {
            let side = local.side(axis);
            near = near.max(sides[side][axis] * local.reciprocal[axis] + local.near[axis]);
            far = far.min(sides[side ^ 1][axis] * local.reciprocal[axis] + local.far[axis]);
        }
        (near, far)
    }

    /// Tests the triangles of a leaf, eight at once. Returns the new limit, or `None` if the search
    /// is over.
    #[inline(always)]
    fn triangles<const ANY: bool, L: Lanes<WIDTH>>(
        &self,
        l: L,
        state: &mut State<'_, impl RayQuery>,
        local: &LocalRay,
        slots: Range<usize>,
        mut limit: f32,
    ) -> Option<f32> {
        let mut first = slots.start;
        while first < slots.end {
            let leaf = Child::new(Kind::Triangles(first, WIDTH.min(slots.end - first)));
            limit = state.leaf::<ANY, L>(l, local, leaf, limit)?;
            first += WIDTH;
        }
        Some(limit)
    }

    /// Tests the elements of a leaf in double precision, with the same result.
    #[inline(never)]
    fn anything<const ANY: bool>(
        &self,
        state: &mut State<'_, impl RayQuery>,
        local: &LocalRay,
        slots: Range<usize>,
        mailbox: &mut Mailbox,
        mut limit: f32,
    ) -> Option<f32> {
        for i in slots {
            let held = self.tree.leaves.slots[i];
            // Shapes may be expensive, and lie in several cells.
            if !held.is_custom() || mailbox.is_new(held.shape) {
                limit = state.unsure::<ANY>(local, Child::new(Kind::Mixed(i, 1)), 0, limit)?;
            }
        }
        Some(limit)
    }
}

impl<T: Tally> Walk for Traversal<'_, T> {
    fn leaves(&self) -> &Leaves {
        &self.tree.leaves
    }

    #[inline(always)]
    fn walk<const ANY: bool, L: Lanes<WIDTH>>(
        &self,
        l: L,
        state: &mut State<'_, impl RayQuery>,
        local: &LocalRay,
        mut limit: f32,
    ) -> f32 {
        // Otherwise each value, broadcast to eight lanes, would be kept on the stack instead of
        // being broadcast when it is loaded.
        let local = std::hint::black_box(local);
        let nodes = &*self.tree.nodes;
        let (mut near, mut far) = self.inside(local, limit);
        if near > far {
            return limit;
        }
        let mut mailbox = Mailbox::new();
        let mut stack: [Later; MAX_DEPTH] = [(0, 0.0, 0.0); MAX_DEPTH];
        let (mut height, mut place) = (0, 0);
        loop {
            let node = nodes[place as usize];
            let axis = node.axis();
            if axis < 3 {
                self.tally.step();
                let t = node.plane * local.reciprocal[axis];
                // t* of the lecture notes; a padded ray has two, and the first is never the larger
                // one.
                let (arrives, leaves) = (t + local.near[axis], t + local.far[axis]);
                let before = node.children() + local.side(axis) as u32;
                let beyond = before ^ 1;
                // Whether the near child is entered is a branch: where rays often agree, the
                // predicted path does not wait for the distances. Whether both are entered is
                // branchless, as it is the least predictable.
                stack[height % MAX_DEPTH] = (beyond, if arrives > near { arrives } else { near }, far);
                if near <= leaves {
                    height += usize::from(arrives <= far);
                    place = before;
                    far = if leaves < far { leaves } else { far };
                } else {
                    place = beyond;
                }
                continue;
            }
            let slots = node.slots();
            self.tally.tests(slots.len());
            let nearer = if node.holds_triangles() {
                self.triangles::<ANY, L>(l, state, local, slots, limit)
            } else {
                self.anything::<ANY>(state, local, slots, &mut mailbox, limit)
            };
            match nearer {
                Some(nearer) => limit = nearer,
                None => return limit,
            }
            loop {
                if height == 0 {
                    return limit;
                }
                height -= 1;
                (place, near, far) = stack[height % MAX_DEPTH];
                // `<=`: at equal distance an element of lower index may follow, which wins the tie.
                if near <= limit {
                    break;
                }
            }
        }
    }
}
