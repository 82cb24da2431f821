//! The binary hierarchy that a build makes first.

use crate::support::leaves::items::{Box4, Item};
use glam::Vec4;
use rayon::prelude::*;

/// Number of nodes that are copied at a time.
const BLOCK: usize = 64;

/// A binary hierarchy over items.
#[derive(Default)]
pub(super) struct Tree {
    /// In depth-first order, the root first; empty if there are no items.
    pub(super) nodes: Vec<Binary>,
    /// In leaf order. An element may occur more than once, in parts.
    pub(super) items: Vec<Item>,
}

impl Tree {
    /// Appends another hierarchy.
    pub(super) fn append(&mut self, other: Self) {
        self.nodes.extend(other.nodes);
        self.items.extend(other.items);
    }
}

/// A node; its first child follows it. The position of its items follows from the nodes before it,
/// so a subtree is the same wherever it is placed.
#[derive(Clone, Copy, Debug)]
pub(super) struct Binary {
    /// The fourth components hold `count` and `second`, as bits.
    aabb: Box4,
}

impl Binary {
    /// Or-ed into the numbers stored in unused SIMD lanes, so that their bit patterns are normal
    /// floats: denormals are slow to compute with.
    const NORMAL: u32 = 1 << 30;

    /// Placeholder for a node.
    const NONE: Self = Self { aabb: Box4::EMPTY };

    fn new(aabb: Box4, count: usize, second: usize) -> Self {
        let with = |v: Vec4, number: usize| v.truncate().extend(f32::from_bits(number as u32 | Self::NORMAL));
        Self {
            aabb: Box4 {
                min: with(aabb.min, count),
                max: with(aabb.max, second),
            },
        }
    }

    /// A leaf.
    pub(super) fn leaf(aabb: Box4, count: usize) -> Self {
        Self::new(aabb, count, 0)
    }

    /// An inner node whose second child is `second` nodes behind it.
    pub(super) fn inner(aabb: Box4, count: usize, second: usize) -> Self {
        Self::new(aabb, count, second)
    }

    #[inline(always)]
    pub(super) fn aabb(&self) -> Box4 {
        self.aabb
    }

    /// Number of items in the subtree.
    #[inline(always)]
    pub(super) fn count(&self) -> usize {
        (self.aabb.min.w.to_bits() ^ Self::NORMAL) as usize
    }

    /// Offset from the node to its second child; `None` for a leaf.
    #[inline(always)]
    pub(super) fn second(&self) -> Option<usize> {
        match self.aabb.max.w.to_bits() ^ Self::NORMAL {
            0 => None,
            second => Some(second as usize),
        }
    }
}

/// The nodes of a subtree that was built in parts.
pub(super) struct Parts {
    /// Concatenated, they are the subtree.
    parts: Vec<Vec<Binary>>,
    length: usize,
}

impl Parts {
    /// A subtree in one part.
    pub(super) fn whole(nodes: Vec<Binary>) -> Self {
        Self {
            length: nodes.len(),
            parts: vec![nodes],
        }
    }

    /// A node with two children.
    pub(super) fn inner(aabb: Box4, count: usize, first: Self, second: Self) -> Self {
        let mut parts = vec![vec![Binary::inner(aabb, count, 1 + first.length)]];
        parts.extend(first.parts);
        parts.extend(second.parts);
        Self {
            length: 1 + first.length + second.length,
            parts,
        }
    }

    /// All nodes, concatenated.
    pub(super) fn concat(&self) -> Vec<Binary> {
        let mut end = 0;
        let ends: Vec<usize> = self
            .parts
            .iter()
            .map(|part| {
                end += part.len();
                end
            })
            .collect();
        // In blocks, so that several threads can fetch the memory.
        let block = |i: usize| {
            let part = ends.partition_point(|&end| end <= i * BLOCK);
            let mut skipped = i * BLOCK + self.parts[part].len() - ends[part];
            let (mut nodes, mut filled) = ([Binary::NONE; BLOCK], 0);
            for part in &self.parts[part..] {
                let count = (part.len() - skipped).min(BLOCK - filled);
                nodes[filled..][..count].copy_from_slice(&part[skipped..][..count]);
                filled += count;
                skipped = 0;
                if filled == BLOCK {
                    break;
                }
            }
            nodes
        };
        let blocks = (0..self.length.div_ceil(BLOCK)).into_par_iter();
        let blocks: Vec<_> = blocks.with_min_len(64).map(block).collect();
        let mut nodes = blocks.into_flattened();
        nodes.truncate(self.length);
        nodes
    }
}
