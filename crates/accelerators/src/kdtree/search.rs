//! The nodes, and the way of a ray through them.
//!
//! In order, with an interval of the ray for each cell (the notes' t_min, t*, t_max; Havran,
//! *Heuristic ray shooting algorithms*, 2000, appendix C). The ray is as wide as rounding may need
//! (see `leaves::frame`), so it arrives at a plane before it leaves the side before, and the
//! intervals overlap a little.

use super::KdTree;
use super::build::AxisCut;
use crate::elements::Mailbox;
use crate::leaves::Leaves;
use crate::leaves::child::{Child, Kind, WIDTH};
use crate::leaves::frame::LocalRay;
use crate::leaves::state::{Asked, State, Walk};
use crate::partition::MAX_DEPTH;
use std::cell::Cell;
use std::ops::Range;
use whitstone_core::Effort;
use whitstone_simd::Lanes;

/// A node in 8 bytes (Pharr, Jakob, Humphreys, *Physically based rendering*, 3rd edition, 2016,
/// section 4.4.1).
#[derive(Clone, Copy, Debug)]
pub(super) struct Node {
    /// Of an inner node the plane; of a leaf the first slot, as bits.
    plane: f32,
    /// The axis, or 3 in a leaf, and above these two bits: in an inner node the first of the two
    /// children, which lie side by side; in a leaf whether it holds triangles only, and above that
    /// the number of elements.
    rest: u32,
}

impl Node {
    const LEAF: u32 = 3;
    const TRIANGLES: u32 = 4;

    /// A leaf without anything.
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

    /// A leaf of so many elements.
    pub(super) fn leaf(first: usize, count: usize) -> Self {
        Self {
            plane: f32::from_bits(first as u32),
            rest: (count as u32) << 3 | Self::TRIANGLES | Self::LEAF,
        }
    }

    /// The same for elements not all of which are triangles.
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

    /// The lower of the two children of an inner node, an even number; the other is the next one.
    #[inline(always)]
    fn children(self) -> u32 {
        self.rest >> 2
    }

    /// Whether a leaf holds triangles only.
    #[inline(always)]
    fn holds_triangles(self) -> bool {
        self.rest & Self::TRIANGLES != 0
    }

    /// What a leaf holds.
    #[inline(always)]
    pub(super) fn slots(self) -> Range<usize> {
        let first = self.plane.to_bits() as usize;
        first..first + (self.rest >> 3) as usize
    }

    pub(super) fn is_leaf(self) -> bool {
        self.rest & 3 == Self::LEAF
    }

    /// Whether it is a leaf without anything.
    pub(super) fn is_empty(self) -> bool {
        self.is_leaf() && self.slots().is_empty()
    }

    /// The plane and the first of the children of an inner node.
    pub(super) fn cut(self) -> Option<(AxisCut, usize)> {
        let (axis, plane) = (self.axis(), self.plane);
        (!self.is_leaf()).then_some((AxisCut { axis, plane }, self.children() as usize))
    }
}

const _: () = assert!(size_of::<Node>() == 8);

/// A cell that is visited later: its node and the part of the ray in it.
type Later = (u32, f32, f32);

/// The tree, and with `COUNT` what a search costs.
pub(super) struct Traversal<'a, const COUNT: bool> {
    tree: &'a KdTree,
    steps: Cell<u64>,
    tests: Cell<u64>,
}

impl<'a, const COUNT: bool> Traversal<'a, COUNT> {
    pub(super) fn new(tree: &'a KdTree) -> Self {
        Self {
            tree,
            steps: Cell::new(0),
            tests: Cell::new(tree.leaves.unbounded.len() as u64),
        }
    }

    pub(super) fn effort(&self) -> Effort {
        Effort {
            steps: self.steps.get(),
            tests: self.tests.get(),
        }
    }

    #[inline(always)]
    fn count(&self, counter: &Cell<u64>, more: usize) {
        if COUNT {
            counter.set(counter.get() + more as u64);
        }
    }

    /// The part of a ray in the whole.
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

    /// Tests the triangles of a leaf, eight at once; returns the new limit, or `None` if the search
    /// is over.
    #[inline(always)]
    fn triangles<const ANY: bool, L: Lanes<WIDTH>>(
        &self,
        l: L,
        state: &mut State<'_, impl Asked>,
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

    /// Tests the elements of a leaf in double precision; the same results.
    #[inline(never)]
    fn anything<const ANY: bool>(
        &self,
        state: &mut State<'_, impl Asked>,
        local: &LocalRay,
        slots: Range<usize>,
        mailbox: &mut Mailbox,
        mut limit: f32,
    ) -> Option<f32> {
        for i in slots {
            let held = self.tree.leaves.slots[i];
            // Shapes may be dear, and lie in several cells.
            if !held.is_opaque() || mailbox.is_new(held.shape) {
                limit = state.unsure::<ANY>(local, Child::new(Kind::Mixed(i, 1)), 0, limit)?;
            }
        }
        Some(limit)
    }
}

impl<const COUNT: bool> Walk for Traversal<'_, COUNT> {
    fn leaves(&self) -> &Leaves {
        &self.tree.leaves
    }

    #[inline(always)]
    fn walk<const ANY: bool, L: Lanes<WIDTH>>(
        &self,
        l: L,
        state: &mut State<'_, impl Asked>,
        local: &LocalRay,
        mut limit: f32,
    ) -> f32 {
        // Each number in eight lanes would be kept on the stack otherwise, instead of being loaded
        // into them.
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
                self.count(&self.steps, 1);
                let t = node.plane * local.reciprocal[axis];
                // t* of the notes, which is two for a wide ray; the first is never the larger one.
                let (arrives, leaves) = (t + local.near[axis], t + local.far[axis]);
                let before = node.children() + local.side(axis) as u32;
                let beyond = before ^ 1;
                // Which way first is a jump, so that the processor need not wait for the numbers to
                // go on where the ray often does the same; whether both ways is none, as that can
                // be foreseen least.
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
            self.count(&self.tests, slots.len());
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
                // At equal distance an element of lower number may be in there.
                if near <= limit {
                    break;
                }
            }
        }
    }
}
