//! Single-ray traversal of the hierarchy.

use super::Eight;
use crate::support::leaves::Leaves;
use crate::support::leaves::child::{Child, Kind, WIDTH};
use crate::support::leaves::frame::LocalRay;
use crate::support::leaves::state::{Counters, RayQuery, State, Streamed, Tally, Walk};
use whitstone_simd::{Kernel, Lanes, Level, Machine, with_lanes};

/// Traversal stack. Zero-initialising the worst-case depth costs about a tenth of a ray's time, and
/// most rays need a few entries, so 32 live inline and the rest spill to the heap.
pub(super) struct Stack {
    top: [StackEntry; Self::INLINE_CAPACITY],
    below: Vec<StackEntry>,
}

/// Entry distance of a box, and its contents.
type StackEntry = (f32, Child);

impl Stack {
    const INLINE_CAPACITY: usize = 32;

    #[inline(always)]
    pub(super) fn new() -> Self {
        Self {
            top: [(0.0, Child::default()); Self::INLINE_CAPACITY],
            below: Vec::new(),
        }
    }

    /// Makes room for the children of a node, by spilling if necessary; returns the new height.
    #[inline(always)]
    fn make_room(&mut self, height: usize) -> usize {
        if height + WIDTH > Self::INLINE_CAPACITY {
            self.spill(height)
        } else {
            height
        }
    }

    #[cold]
    #[inline(never)]
    fn spill(&mut self, height: usize) -> usize {
        self.below.extend_from_slice(&self.top[..height]);
        0
    }

    /// Takes back the entries that were spilled last; returns the new height, 0 if there are none.
    #[inline(always)]
    fn unspill(&mut self) -> usize {
        if self.below.is_empty() { 0 } else { self.refill() }
    }

    /// Pops the next child whose entry distance is within the limit, if there is one.
    #[inline(always)]
    fn pop(&mut self, height: &mut usize, limit: f32) -> Option<Child> {
        loop {
            if *height == 0 {
                *height = self.unspill();
                if *height == 0 {
                    return None;
                }
            }
            *height -= 1;
            let (near, child) = self.top[*height % Self::INLINE_CAPACITY];
            // `<=`: at equal distance an element of lower index may follow, which wins the tie.
            if near <= limit {
                return Some(child);
            }
        }
    }

    #[cold]
    #[inline(never)]
    fn refill(&mut self) -> usize {
        let rest = self.below.len().saturating_sub(Self::INLINE_CAPACITY / 2);
        let height = self.below.len() - rest;
        self.top[..height].copy_from_slice(&self.below[rest..]);
        self.below.truncate(rest);
        height
    }
}

impl Walk for Eight {
    fn leaves(&self) -> &Leaves {
        &self.leaves
    }

    #[inline(always)]
    fn walk<const ANY: bool, L: Lanes<WIDTH>>(
        &self,
        l: L,
        state: &mut State<'_, impl RayQuery>,
        local: &LocalRay,
        limit: f32,
    ) -> f32 {
        self.traverse_all::<ANY, L>(l, state, local, limit, ())
    }
}

/// A hierarchy whose traversal is counted.
pub(super) struct Counted<'a>(pub(super) &'a Eight, pub(super) &'a Counters);

impl Walk for Counted<'_> {
    fn leaves(&self) -> &Leaves {
        &self.0.leaves
    }

    #[inline(always)]
    fn walk<const ANY: bool, L: Lanes<WIDTH>>(
        &self,
        l: L,
        state: &mut State<'_, impl RayQuery>,
        local: &LocalRay,
        limit: f32,
    ) -> f32 {
        self.0.traverse_all::<ANY, L>(l, state, local, limit, self.1)
    }
}

impl Eight {
    /// Traverses the whole hierarchy, as [`Self::traverse`].
    #[inline(always)]
    fn traverse_all<const ANY: bool, L: Lanes<WIDTH>>(
        &self,
        l: L,
        state: &mut State<'_, impl RayQuery>,
        local: &LocalRay,
        limit: f32,
        tally: impl Tally,
    ) -> f32 {
        let Some(root) = self.root else {
            return limit;
        };
        self.traverse::<ANY, L>(l, state, local, (root, &mut Stack::new()), limit, tally)
    }

    /// Traverses the subtree of `child`. Returns the limit up to which pending hits (found in
    /// single precision, not yet computed in double) may still be nearest.
    #[inline(always)]
    fn traverse<const ANY: bool, L: Lanes<WIDTH>>(
        &self,
        l: L,
        state: &mut State<'_, impl RayQuery>,
        local: &LocalRay,
        (mut child, stack): (Child, &mut Stack),
        mut limit: f32,
        tally: impl Tally,
    ) -> f32 {
        // Otherwise each value, broadcast to eight lanes, would be kept on the stack instead of
        // being broadcast when it is loaded.
        let local = std::hint::black_box(local);
        // A search that ended early may have left entries.
        stack.below.clear();
        let mut height = 0;
        loop {
            // A separate loop over inner nodes, so that its state stays in registers.
            while child.is_inner()
                && let Kind::Inner(node) = child.kind()
            {
                tally.step();
                let node = &self.nodes[node];
                let (mut mask, near) = node.enter(l, local, limit);
                if mask == 0 {
                    match stack.pop(&mut height, limit) {
                        Some(next) => child = next,
                        None => return limit,
                    }
                    continue;
                }
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
                height = stack.make_room(height);
                let stack = &mut stack.top;
                let (second, rest) = next();
                if rest == 0 {
                    // A branch (which the black boxes keep) instead of a select: the processor can
                    // fetch the node that it predicts to be nearer before the distances are known.
                    if second.0 < first.0 {
                        std::hint::black_box(());
                        stack[height % Stack::INLINE_CAPACITY] = first;
                        height += 1;
                        child = second.1;
                    } else {
                        std::hint::black_box(());
                        stack[height % Stack::INLINE_CAPACITY] = second;
                        height += 1;
                        child = first.1;
                    }
                    continue;
                }
                // Three or more: sorted on the stack, the nearest on top, unless any hit will do.
                let bottom = height;
                let mut insert = |entry: (f32, Child)| {
                    let mut place = height;
                    while !ANY && place > bottom && stack[(place - 1) % Stack::INLINE_CAPACITY].0 < entry.0 {
                        stack[place % Stack::INLINE_CAPACITY] = stack[(place - 1) % Stack::INLINE_CAPACITY];
                        place -= 1;
                    }
                    stack[place % Stack::INLINE_CAPACITY] = entry;
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
                child = stack[height % Stack::INLINE_CAPACITY].1;
            }
            tally.tests(child.elements());
            match state.leaf::<ANY, L>(l, local, child, limit) {
                Some(nearer) => limit = nearer,
                None => return limit,
            }
            match stack.pop(&mut height, limit) {
                Some(next) => child = next,
                None => return limit,
            }
        }
    }
}

/// Single-ray traversal used by the stream and packet code below a given child. Kept as a separate
/// kernel so that its state stays in registers.
pub(super) struct SingleRay<'a, 's, const ANY: bool> {
    pub(super) bvh: &'a Eight,
    pub(super) state: &'s mut State<'a, Streamed<'a>>,
    pub(super) local: &'s LocalRay,
    pub(super) child: Child,
    pub(super) stack: &'s mut Stack,
    pub(super) limit: f32,
}

impl<const ANY: bool> SingleRay<'_, '_, ANY> {
    /// Traverses; returns the limit up to which pending hits may still be nearest.
    #[inline(always)]
    pub(super) fn traverse(self) -> f32 {
        with_lanes(Level::Avx2, self)
    }
}

impl<const ANY: bool> Kernel for SingleRay<'_, '_, ANY> {
    type Output = f32;

    #[inline(always)]
    fn run<M: Machine>(self, m: M) -> f32 {
        let Self {
            bvh,
            state,
            local,
            child,
            stack,
            limit,
        } = self;
        bvh.traverse::<ANY, M>(m, state, local, (child, stack), limit, ())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_put_off_comes_back_the_latest_first() {
        let mut stack = Stack::new();
        let mut height = 0;
        let mut expected = Vec::new();
        let mut spill = 0;
        for round in 0..400 {
            // At first more entries go in than come out, later fewer.
            let [more, fewer] = if round < 200 { [WIDTH, 3] } else { [1, 6] };
            height = stack.make_room(height);
            for i in 0..more - round % 2 {
                let later = ((WIDTH * round + i) as f32, Child(i as u32));
                expected.push(later);
                stack.top[height] = later;
                height += 1;
            }
            spill = spill.max(stack.below.len());
            for _ in 0..fewer {
                if height == 0 {
                    height = stack.unspill();
                }
                let top = (height > 0).then(|| {
                    height -= 1;
                    stack.top[height]
                });
                assert_eq!(top, expected.pop());
            }
        }
        assert!(spill > 500 && expected.is_empty(), "{spill}, {}", expected.len());
    }
}
