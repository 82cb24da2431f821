//! Traversal of the hierarchy by one ray.

use super::Hierarchy;
use super::stack::Stack;
use crate::support::leaves::Leaves;
use crate::support::leaves::child::{Child, Kind};
use crate::support::leaves::frame::LocalRay;
use crate::support::leaves::search::{Best, RayQuery, Walk};
use whitstone_simd::Machine;

/// A hierarchy of this width, with its leaves.
#[derive(Clone, Copy)]
pub(super) struct Tree<'a, const N: usize> {
    pub(super) leaves: &'a Leaves,
    pub(super) hierarchy: &'a Hierarchy<N>,
}

impl<const N: usize> Tree<'_, N> {
    /// Tests the elements of a leaf. Returns whether one of them is the best hit.
    #[inline(always)]
    pub(super) fn leaf<const ANY: bool, M: Machine<N>>(
        &self,
        m: M,
        best: &mut Best,
        leaf: Child,
        query: &impl RayQuery,
    ) -> bool {
        match leaf.kind() {
            Kind::Triangles(first, count) => {
                best.try_triangles::<ANY, _>(m.doubles(), self.leaves, first, count)
            }
            Kind::Mixed(first, count) => {
                let mut better = false;
                for slot in &self.leaves.slots[first..first + count] {
                    better |= best.try_element(self.leaves, query, slot.element());
                }
                better
            }
            Kind::Inner(_) => false,
        }
    }
}

impl<const N: usize> Walk<N> for Tree<'_, N> {
    fn leaves(&self) -> &Leaves {
        self.leaves
    }

    #[inline(always)]
    fn walk<const ANY: bool, M: Machine<N>>(
        &self,
        m: M,
        best: &mut Best,
        local: &LocalRay,
        query: &impl RayQuery,
    ) {
        // Otherwise each value, broadcast to all lanes, would be kept on the stack instead of being
        // broadcast when it is loaded.
        let local = std::hint::black_box(local);
        self.traverse::<ANY, M>(m, best, local, query, self.hierarchy.root, &mut Stack::new());
    }
}

impl<const N: usize> Tree<'_, N> {
    /// Visits the subtree of `child`; the stack must be empty.
    #[inline(always)]
    pub(super) fn traverse<const ANY: bool, M: Machine<N>>(
        &self,
        m: M,
        best: &mut Best,
        local: &LocalRay,
        query: &impl RayQuery,
        mut child: Child,
        stack: &mut Stack,
    ) {
        let nodes = &*self.hierarchy.nodes;
        let mut limit = best.limit(local);
        loop {
            // A separate loop over inner nodes, so that its state stays in registers.
            while child.is_inner() {
                let height = stack.make_room::<N>();
                let node = &nodes[child.index()];
                let entered = node.enter(m, local, limit);
                if entered.mask & entered.mask.wrapping_sub(1) != 0 {
                    child = stack.push_and_pop(m, height, node.sorted(m, local.octant, &entered));
                } else if entered.mask != 0 {
                    // A branch, so that the processor fetches the child that it predicts.
                    child = node.only(&entered);
                } else {
                    break;
                }
            }
            if !child.is_inner() && self.leaf::<ANY, M>(m, best, child, query) {
                if ANY {
                    return;
                }
                limit = best.limit(local);
            }
            let mut near;
            loop {
                (near, child) = stack.pop();
                // `<=`: at equal distance an element of lower index may follow, which wins the tie.
                if near <= limit {
                    break;
                }
            }
            if child == Stack::END {
                child = stack.pop_spilled().1;
                if child == Stack::END {
                    return;
                }
            }
        }
    }
}
