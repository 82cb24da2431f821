//! Traversal of the hierarchy by one ray.

use super::Sixteen;
use super::leaf::Best;
use super::ray::BoxRay;
use super::stack::Stack;
use crate::support::leaves::child::{Child, Kind};
use crate::support::leaves::state::{Query, RayQuery, Streamed, Tally};
use whitstone_core::PreliminaryIntersection;
use whitstone_simd::{WideKernel, WideMachine, with_wide_lanes};

/// A search for the nearest hit, or with `ANY` for any hit, of which only the existence counts.
pub(super) struct Search<'a, const ANY: bool, T> {
    pub(super) tree: &'a Sixteen,
    pub(super) query: &'a Query<'a>,
    pub(super) tally: T,
}

impl<const ANY: bool, T: Tally> WideKernel for Search<'_, ANY, T> {
    type Output = Option<PreliminaryIntersection>;

    #[inline(always)]
    fn run<M: WideMachine>(self, m: M) -> Option<PreliminaryIntersection> {
        let Self { tree, query, tally } = self;
        let mut best = Best::default();
        if let Some(local) = best.start::<ANY, _>(m.quad(), &tree.leaves, &query) {
            // Otherwise each value, broadcast to all lanes, would be kept on the stack instead of
            // being broadcast when it is loaded.
            let local = std::hint::black_box(&local);
            let start = (tree.root, &mut Stack::new());
            tree.traverse::<ANY, M>(m, &mut best, local, &query, start, tally);
        }
        best.hit
    }
}

/// Traversal of a subtree by a ray of a packet, in a function of its own, so that its state stays
/// in registers.
pub(super) struct Alone<'a, const ANY: bool> {
    pub(super) tree: &'a Sixteen,
    pub(super) best: &'a mut Best,
    pub(super) local: &'a BoxRay,
    pub(super) query: Streamed<'a>,
    pub(super) child: Child,
    pub(super) stack: &'a mut Stack,
}

impl<const ANY: bool> Alone<'_, ANY> {
    /// Traverses.
    #[inline(never)]
    pub(super) fn traverse(self) {
        with_wide_lanes(self);
    }
}

impl<const ANY: bool> WideKernel for Alone<'_, ANY> {
    type Output = ();

    #[inline(always)]
    fn run<M: WideMachine>(self, m: M) {
        let Self {
            tree,
            best,
            local,
            query,
            child,
            stack,
        } = self;
        stack.clear();
        tree.traverse::<ANY, M>(m, best, local, &query, (child, stack), ());
    }
}

impl Sixteen {
    /// Tests the elements of a leaf. Returns whether one of them is the best hit.
    #[inline(always)]
    pub(super) fn leaf<const ANY: bool, M: WideMachine>(
        &self,
        m: M,
        best: &mut Best,
        leaf: Child,
        query: &impl RayQuery,
    ) -> bool {
        match leaf.kind() {
            Kind::Triangles(first, count) => {
                best.try_triangles::<ANY, _>(m.doubles(), &self.leaves, first, count)
            }
            Kind::Mixed(first, count) => {
                let mut better = false;
                for slot in &self.leaves.slots[first..first + count] {
                    better |= best.try_element(&self.leaves, query, slot.element());
                }
                better
            }
            Kind::Inner(_) => false,
        }
    }

    /// Visits the subtree of `child`; the stack must be empty.
    #[inline(always)]
    fn traverse<const ANY: bool, M: WideMachine>(
        &self,
        m: M,
        best: &mut Best,
        local: &BoxRay,
        query: &impl RayQuery,
        (mut child, stack): (Child, &mut Stack),
        tally: impl Tally,
    ) {
        let nodes = &*self.nodes;
        let mut limit = best.limit(local);
        loop {
            // A separate loop over inner nodes, so that its state stays in registers.
            while child.is_inner() {
                tally.step();
                let height = stack.make_room();
                let node = &nodes[child.index()];
                let entered = node.enter(m, local, limit);
                if entered.mask & entered.mask.wrapping_sub(1) != 0 {
                    // Not read back from the stack: a single ray would wait for the store.
                    let sorted = node.sorted(m, local.octant, &entered);
                    child = node.last(local.octant, sorted.0);
                    stack.push(m, height, sorted);
                } else if entered.mask != 0 {
                    // A branch, so that the processor fetches the child that it predicts.
                    child = node.only(&entered);
                } else {
                    break;
                }
            }
            if !child.is_inner() {
                tally.tests(child.elements());
                if self.leaf::<ANY, M>(m, best, child, query) {
                    if ANY {
                        return;
                    }
                    limit = best.limit(local);
                }
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
