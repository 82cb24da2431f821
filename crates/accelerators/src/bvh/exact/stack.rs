//! The stack of a traversal.

use crate::support::leaves::child::Child;
use whitstone_simd::Sixteen;

/// Deferred children with the entry distances of their boxes. Clearing room for the worst case
/// would cost a tenth of a ray's time, and most rays need a few entries: the rest spills to the
/// heap.
///
/// Aligned: where it crosses cache lines, which the address of the program's stack decides, rays
/// take up to a fifth longer.
#[derive(Clone, Debug)]
#[repr(align(64))]
pub(super) struct Stack {
    near: [f32; Self::ROOM],
    children: [u32; Self::ROOM],
    height: usize,
    /// Below all others.
    spilled: Vec<(f32, u32)>,
}

impl Stack {
    const ROOM: usize = 64;

    /// What is below all entries.
    pub(super) const END: Child = Child::NONE;

    #[inline(always)]
    pub(super) fn new() -> Self {
        Self {
            near: [f32::NEG_INFINITY; Self::ROOM],
            children: [Self::END.0; Self::ROOM],
            height: 1,
            spilled: Vec::new(),
        }
    }

    /// Removes all entries.
    #[inline(always)]
    pub(super) fn clear(&mut self) {
        self.height = 1;
        self.spilled.clear();
    }

    /// Makes room for the children of a node. Returns the height.
    #[inline(always)]
    pub(super) fn make_room(&mut self) -> usize {
        // Not by a sum, which could overflow: the compiler must know the height to be in range.
        if self.height > Self::ROOM - 16 {
            self.spill();
            return 1;
        }
        self.height
    }

    /// Adds the entries that the mask selects, except the last one, on top of `height`.
    #[inline(always)]
    pub(super) fn push<L: Sixteen>(
        &mut self,
        l: L,
        height: usize,
        (mask, near, children): (u32, L::Floats, L::Words),
    ) {
        let to = self.near[height..].first_chunk_mut();
        if let Some(to) = to.zip(self.children[height..].first_chunk_mut()) {
            l.compress(mask, near, children, to);
        }
        self.height = height + mask.count_ones() as usize - 1;
    }

    /// The same; returns the last entry, or removes and returns the top one if the mask is empty.
    #[inline(always)]
    pub(super) fn push_and_pop<L: Sixteen>(
        &mut self,
        l: L,
        height: usize,
        selected: (u32, L::Floats, L::Words),
    ) -> Child {
        self.push(l, height, selected);
        Child(self.children[self.height % Self::ROOM])
    }

    /// Removes the top entry and returns it; [`Self::END`] if there is none.
    #[inline(always)]
    pub(super) fn pop(&mut self) -> (f32, Child) {
        self.height -= 1;
        let height = self.height % Self::ROOM;
        (self.near[height], Child(self.children[height]))
    }

    /// After [`Self::END`]: the same for what was spilled.
    #[inline(always)]
    pub(super) fn pop_spilled(&mut self) -> (f32, Child) {
        self.height = 1;
        if self.spilled.is_empty() {
            return (f32::NEG_INFINITY, Self::END);
        }
        self.refill();
        self.pop()
    }

    /// Removes entries farther than `limit`, except spilled ones.
    #[inline(always)]
    pub(super) fn cull<L: Sixteen>(&mut self, l: L, limit: f32) {
        let (mut from, mut to) = (1, 1);
        while from < self.height {
            let (Some(near), Some(children)) = (
                self.near[from..].first_chunk(),
                self.children[from..].first_chunk(),
            ) else {
                // The last entries do not fill a vector; they stay.
                break;
            };
            let (near, children) = (l.load(near), l.load_words(children));
            let valid = u32::MAX >> (32 - (self.height - from).min(16));
            let mask = l.at_most(near, l.splat(limit)) & valid;
            let place = self.near[to..].first_chunk_mut();
            if let Some(place) = place.zip(self.children[to..].first_chunk_mut()) {
                l.compress(mask, near, children, place);
            }
            from += 16;
            to += mask.count_ones() as usize;
        }
        while from < self.height {
            (self.near[to], self.children[to]) = (self.near[from], self.children[from]);
            (from, to) = (from + 1, to + 1);
        }
        self.height = to;
    }

    #[cold]
    #[inline(never)]
    fn spill(&mut self) {
        let entries = self.near.into_iter().zip(self.children);
        self.spilled.extend(entries.take(self.height).skip(1));
        self.height = 1;
    }

    #[cold]
    #[inline(never)]
    fn refill(&mut self) {
        let rest = self.spilled.len().saturating_sub(Self::ROOM / 2);
        for (near, child) in self.spilled.drain(rest..) {
            (self.near[self.height], self.children[self.height]) = (near, child);
            self.height += 1;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use whitstone_simd::Portable;

    #[test]
    fn what_was_deferred_comes_back_the_latest_first() {
        let mut stack = Stack::new();
        let mut expected = Vec::new();
        let mut spilled = 0;
        for round in 0..400u32 {
            // At first more entries go in than come out, later fewer.
            let [more, fewer] = if round < 200 { [9, 3] } else { [2, 6] };
            let near = std::array::from_fn(|i| (16 * round + i as u32) as f32);
            let children = std::array::from_fn(|i| 1000 * round + i as u32);
            let mask = ((1u32 << more) - 1) << (round % 3);
            for i in (0..16).filter(|i| mask >> i & 1 == 1) {
                expected.push((near[i], Child(children[i])));
            }
            let height = stack.make_room();
            let top = stack.push_and_pop(Portable, height, (mask, near, children));
            assert_eq!(Some(top), expected.pop().map(|entry| entry.1));
            spilled = spilled.max(stack.spilled.len());
            for _ in 0..fewer {
                let mut top = stack.pop();
                if top.1 == Stack::END {
                    top = stack.pop_spilled();
                }
                let end = (f32::NEG_INFINITY, Stack::END);
                assert_eq!(top, expected.pop().unwrap_or(end));
                if top == end {
                    stack.clear();
                }
            }
        }
        assert!(
            spilled > 500 && expected.is_empty(),
            "{spilled}, {}",
            expected.len()
        );
    }

    #[test]
    fn only_near_entries_are_left() {
        for count in 1..=32usize {
            let mut stack = Stack::new();
            for i in 0..count {
                let near = [(i * 7 % 64) as f32; 16];
                let height = stack.make_room();
                // The second one is removed at once.
                stack.push_and_pop(Portable, height, (3, near, [i as u32; 16]));
            }
            stack.cull(Portable, 20.0);
            let left = (0..count).rev().filter(|i| i * 7 % 64 <= 20);
            let left: Vec<u32> = left.map(|i| i as u32).collect();
            let mut found = Vec::new();
            while let (_, child) = stack.pop()
                && child != Stack::END
            {
                found.push(child.0);
            }
            assert_eq!(found, left, "{count}");
        }
    }
}
