//! The way of a ray through the hierarchy.

use super::Bvh;
use crate::leaves::Leaves;
use crate::leaves::child::{Child, Kind, WIDTH};
use crate::leaves::frame::LocalRay;
use crate::leaves::state::{Asked, State, Streamed, Walk};
use whitstone_simd::{Kernel, Lanes, Level, Machine, with_lanes};

/// What a search has put off, the latest on top. A ray seldom puts off more than a few, and room
/// that it does not use must be cleared all the same: a tenth of its time for the room that the
/// deepest hierarchy may need. So the rest is put away.
pub(super) struct Stack {
    top: [Later; Self::ROOM],
    below: Vec<Later>,
}

/// Where a box is entered, and what is in it.
type Later = (f32, Child);

impl Stack {
    const ROOM: usize = 32;

    #[inline(always)]
    pub(super) fn new() -> Self {
        Self {
            top: [(0.0, Child::default()); Self::ROOM],
            below: Vec::new(),
        }
    }

    /// Makes room for the children of a node; returns the new height.
    #[inline(always)]
    fn make_room(&mut self, height: usize) -> usize {
        if height + WIDTH > Self::ROOM {
            self.put_away(height)
        } else {
            height
        }
    }

    #[cold]
    #[inline(never)]
    fn put_away(&mut self, height: usize) -> usize {
        self.below.extend_from_slice(&self.top[..height]);
        0
    }

    /// Takes back what was put away last; returns the new height, 0 if there is nothing.
    #[inline(always)]
    fn take_back(&mut self) -> usize {
        if self.below.is_empty() { 0 } else { self.refill() }
    }

    /// What is to be done next, if there is anything that is entered before the limit.
    #[inline(always)]
    fn pop(&mut self, height: &mut usize, limit: f32) -> Option<Child> {
        loop {
            if *height == 0 {
                *height = self.take_back();
                if *height == 0 {
                    return None;
                }
            }
            *height -= 1;
            let (near, child) = self.top[*height % Self::ROOM];
            // At equal distance an element of lower number may be in there.
            if near <= limit {
                return Some(child);
            }
        }
    }

    #[cold]
    #[inline(never)]
    fn refill(&mut self) -> usize {
        let rest = self.below.len().saturating_sub(Self::ROOM / 2);
        let height = self.below.len() - rest;
        self.top[..height].copy_from_slice(&self.below[rest..]);
        self.below.truncate(rest);
        height
    }
}

impl Walk for Bvh {
    fn leaves(&self) -> &Leaves {
        &self.leaves
    }

    #[inline(always)]
    fn walk<const ANY: bool, L: Lanes<WIDTH>>(
        &self,
        l: L,
        state: &mut State<'_, impl Asked>,
        local: &LocalRay,
        limit: f32,
    ) -> f32 {
        let Some(root) = self.root else {
            return limit;
        };
        self.traverse::<ANY, L>(l, state, local, root, &mut Stack::new(), limit)
    }
}

impl Bvh {
    /// Goes through what is below a child; what is pending then may be nearest up to the limit that
    /// is returned.
    #[inline(always)]
    fn traverse<const ANY: bool, L: Lanes<WIDTH>>(
        &self,
        l: L,
        state: &mut State<'_, impl Asked>,
        local: &LocalRay,
        mut child: Child,
        stack: &mut Stack,
        mut limit: f32,
    ) -> f32 {
        // Each number in eight lanes would be kept on the stack otherwise, instead of being loaded
        // into them.
        let local = std::hint::black_box(local);
        // A search that ended early may have left something.
        stack.below.clear();
        let mut height = 0;
        loop {
            // A loop of its own: what it needs stays in registers.
            while child.is_inner()
                && let Kind::Inner(node) = child.kind()
            {
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
                    // A jump (which the black boxes keep), and no choice of numbers: so the
                    // processor can fetch the node that it takes to be nearer before the distances
                    // are known.
                    if second.0 < first.0 {
                        std::hint::black_box(());
                        stack[height % Stack::ROOM] = first;
                        height += 1;
                        child = second.1;
                    } else {
                        std::hint::black_box(());
                        stack[height % Stack::ROOM] = second;
                        height += 1;
                        child = first.1;
                    }
                    continue;
                }
                // Three or more: sorted on the stack, the nearest on top.
                let bottom = height;
                let mut insert = |entry: (f32, Child)| {
                    let mut place = height;
                    while !ANY && place > bottom && stack[(place - 1) % Stack::ROOM].0 < entry.0 {
                        stack[place % Stack::ROOM] = stack[(place - 1) % Stack::ROOM];
                        place -= 1;
                    }
                    stack[place % Stack::ROOM] = entry;
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
                child = stack[height % Stack::ROOM].1;
            }
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

/// The way of one ray of many, from a child on. A kernel of its own, so that it is compiled apart:
/// among what is done for many rays its numbers would not stay in registers.
pub(super) struct One<'a, 's, const ANY: bool> {
    pub(super) bvh: &'a Bvh,
    pub(super) state: &'s mut State<'a, Streamed<'a>>,
    pub(super) local: &'s LocalRay,
    pub(super) child: Child,
    pub(super) stack: &'s mut Stack,
    pub(super) limit: f32,
}

impl<const ANY: bool> One<'_, '_, ANY> {
    /// The limit up to which what is pending may be nearest.
    #[inline(always)]
    pub(super) fn go(self) -> f32 {
        with_lanes(Level::Avx2, self)
    }
}

impl<const ANY: bool> Kernel for One<'_, '_, ANY> {
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
        bvh.traverse::<ANY, M>(m, state, local, child, stack, limit)
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
        let mut put_away = 0;
        for round in 0..400 {
            // More goes in than comes out at first, and less later.
            let [more, fewer] = if round < 200 { [WIDTH, 3] } else { [1, 6] };
            height = stack.make_room(height);
            for i in 0..more - round % 2 {
                let later = ((WIDTH * round + i) as f32, Child(i as u32));
                expected.push(later);
                stack.top[height] = later;
                height += 1;
            }
            put_away = put_away.max(stack.below.len());
            for _ in 0..fewer {
                if height == 0 {
                    height = stack.take_back();
                }
                let top = (height > 0).then(|| {
                    height -= 1;
                    stack.top[height]
                });
                assert_eq!(top, expected.pop());
            }
        }
        assert!(
            put_away > 500 && expected.is_empty(),
            "{put_away}, {}",
            expected.len()
        );
    }
}
