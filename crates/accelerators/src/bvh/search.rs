//! The way of a ray through the hierarchy.

use super::Bvh;
use crate::leaves::Leaves;
use crate::leaves::child::{Child, Kind, WIDTH};
use crate::leaves::frame::LocalRay;
use crate::leaves::state::{Asked, State, Walk};
use whitstone_simd::Lanes;

/// The stack of a search: each level of nodes puts off seven children at most.
pub(super) const fn stack_size(depth: usize) -> usize {
    (depth * (WIDTH - 1) + 1).next_power_of_two()
}

/// Hierarchies up to this depth are searched with a smaller stack, which is cheaper to set up.
pub(super) const USUAL_DEPTH: usize = 18;

/// The hierarchy, and a stack of the size that it needs.
pub(super) struct WithStack<'a, const STACK: usize>(pub(super) &'a Bvh);

impl<const STACK: usize> Walk for WithStack<'_, STACK> {
    fn leaves(&self) -> &Leaves {
        &self.0.leaves
    }

    #[inline(always)]
    fn walk<const ANY: bool, L: Lanes<WIDTH>>(
        &self,
        l: L,
        state: &mut State<'_, impl Asked>,
        local: &LocalRay,
        limit: f32,
    ) -> f32 {
        let Some(root) = self.0.root else {
            return limit;
        };
        let mut stack = [(0f32, Child::default()); STACK];
        self.0
            .traverse::<ANY, STACK, L>(l, state, local, root, &mut stack, limit)
    }
}

impl Bvh {
    /// Goes through what is below a child; what is pending then may be nearest up to the limit that is returned.
    #[inline(always)]
    pub(super) fn traverse<const ANY: bool, const STACK: usize, L: Lanes<WIDTH>>(
        &self,
        l: L,
        state: &mut State<'_, impl Asked>,
        local: &LocalRay,
        mut child: Child,
        stack: &mut [(f32, Child); STACK],
        mut limit: f32,
    ) -> f32 {
        // Each number in eight lanes would be kept on the stack otherwise, instead of being loaded into them.
        let local = std::hint::black_box(local);
        let mut height = 0;
        loop {
            if child.is_inner()
                && let Kind::Inner(node) = child.kind()
            {
                let node = &self.nodes[node];
                let (mut mask, near) = node.enter(l, local, limit);
                if mask != 0 {
                    let near = l.store(near);
                    let mut next = || {
                        let i = mask.trailing_zeros() as usize % WIDTH;
                        mask &= mask - 1;
                        ((near[i], Child(node.children[i])), mask)
                    };
                    let (first, rest) = next();
                    if rest == 0 {
                        child = first.1;
                        continue;
                    }
                    let (second, rest) = next();
                    if rest == 0 {
                        let (nearer, farther) = if second.0 < first.0 {
                            (second, first)
                        } else {
                            (first, second)
                        };
                        stack[height % STACK] = farther;
                        height += 1;
                        child = nearer.1;
                        continue;
                    }
                    // Three or more: sorted on the stack, the nearest on top.
                    let bottom = height;
                    let mut insert = |entry: (f32, Child)| {
                        let mut place = height;
                        while !ANY && place > bottom && stack[(place - 1) % STACK].0 < entry.0 {
                            stack[place % STACK] = stack[(place - 1) % STACK];
                            place -= 1;
                        }
                        stack[place % STACK] = entry;
                        height += 1;
                    };
                    insert(first);
                    insert(second);
                    loop {
                        let (entry, rest) = next();
                        insert(entry);
                        if rest == 0 {
                            break;
                        }
                    }
                    height -= 1;
                    child = stack[height % STACK].1;
                    continue;
                }
            } else {
                match state.leaf::<ANY, L>(l, local, child, limit) {
                    Some(nearer) => limit = nearer,
                    None => return limit,
                }
            }
            child = loop {
                if height == 0 {
                    return limit;
                }
                height -= 1;
                let (near, child) = stack[height % STACK];
                // At equal distance an element of lower number may be in there.
                if near <= limit {
                    break child;
                }
            };
        }
    }
}
