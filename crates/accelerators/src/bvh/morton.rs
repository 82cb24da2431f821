//! The quickest build: elements in the order of a space-filling curve, divided where its bits change.
//!
//! Lauterbach et al., *Fast BVH construction on GPUs*, Eurographics 2009: the highest bit in which the first and the
//! last code of a range differ divides it in space.

use super::MAX_DEPTH;
use super::items::{Box4, Item};
use super::tree::{Binary, BinaryKind, Tree, append};
use rayon::prelude::*;

/// Nodes with no more items are not divided.
const MAX_LEAF: usize = 4;

/// From this number of items on both sides are built in parallel.
const PARALLEL: usize = 4096;

/// Bits of a code along an axis. With the number of an element, which is below 2^28, it fills 64.
const BITS: u32 = 12;

/// Bits of an element's number.
const NUMBER: u32 = 64 - 3 * BITS;

/// Builds over all items. The result depends on these and their order only.
pub(super) fn build(items: &[Item]) -> Tree {
    let mut nodes = Vec::with_capacity(items.len());
    let mut sorted = Vec::new();
    if !items.is_empty() {
        let keys = sorted_keys(items);
        let place = |key: &u64| items[(key & ((1 << NUMBER) - 1)) as usize];
        sorted = keys.par_iter().with_min_len(PARALLEL).map(place).collect();
        node(&keys, &sorted, &mut nodes, 0, 0);
    }
    Tree { nodes, items: sorted }
}

/// The codes of the items, each with the place of its item, in order.
fn sorted_keys(items: &[Item]) -> Vec<u64> {
    let all = items.par_iter().with_min_len(PARALLEL);
    let centers = all.map(|item| Box4::EMPTY.including(item.center()));
    let centers = centers.reduce(|| Box4::EMPTY, Box4::union);
    let cells = ((1u32 << BITS) - 1) as f32;
    // One scale for all axes, so that cells are cubes.
    let extent = (centers.max - centers.min).truncate().max_element();
    let scale = if extent > 1e-30 { cells / extent } else { 0.0 };
    let key = |(place, item): (usize, &Item)| {
        let cell = ((item.center() - centers.min) * scale).to_array();
        // A float becomes an integer by saturation, so anything is a cell.
        let code = |axis: usize| spread((cell[axis] as u32).min((1 << BITS) - 1));
        (code(0) << 2 | code(1) << 1 | code(2)) << NUMBER | place as u64
    };
    let all = items.par_iter().enumerate().with_min_len(PARALLEL);
    let mut keys: Vec<u64> = all.map(key).collect();
    keys.par_sort_unstable();
    keys
}

/// Puts two zeros before each of 12 bits.
fn spread(x: u32) -> u64 {
    let mut x = u64::from(x);
    for (shift, mask) in [
        (16, 0x0f00_00ff),
        (8, 0x0f00_f00f),
        (4, 0xc30c_30c3),
        (2, 0x2_4924_9249),
    ] {
        x = (x | x << shift) & mask;
    }
    x
}

/// Appends the subtree over items, which begin at `first`; returns its box.
fn node(keys: &[u64], items: &[Item], nodes: &mut Vec<Binary>, first: u32, depth: usize) -> Box4 {
    let n = items.len();
    let index = nodes.len();
    let kind = BinaryKind::Leaf(first, n as u32);
    nodes.push(Binary {
        aabb: Box4::EMPTY,
        kind,
    });
    let aabb = if n <= MAX_LEAF {
        items
            .iter()
            .fold(Box4::EMPTY, |aabb, item| aabb.union(item.aabb()))
    } else {
        let middle = divide(keys, depth);
        let (keys, other_keys) = keys.split_at(middle);
        let (items, other_items) = items.split_at(middle);
        let second = first + middle as u32;
        let left;
        let right;
        let place;
        if n >= PARALLEL {
            let mut behind = Vec::new();
            (left, right) = rayon::join(
                || node(keys, items, nodes, first, depth + 1),
                || node(other_keys, other_items, &mut behind, second, depth + 1),
            );
            place = nodes.len();
            append(nodes, behind, 0);
        } else {
            left = node(keys, items, nodes, first, depth + 1);
            place = nodes.len();
            right = node(other_keys, other_items, nodes, second, depth + 1);
        }
        nodes[index].kind = BinaryKind::Inner(place as u32);
        left.union(right)
    };
    nodes[index].aabb = aabb;
    aabb
}

/// Where the second part of a range of at least two begins.
fn divide(keys: &[u64], depth: usize) -> usize {
    let n = keys.len();
    let different = (keys[0] ^ keys[n - 1]) >> NUMBER;
    // Halving leads to single items in as many steps as there are bits in n: from where that is all
    // that there is room for, halve.
    let must_halve = depth + (usize::BITS - n.leading_zeros()) as usize >= MAX_DEPTH;
    if different == 0 || must_halve {
        return n / 2;
    }
    let bit = 1u64 << (NUMBER + different.ilog2());
    keys.partition_point(|key| key & bit == 0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bits_are_spread() {
        for x in (0..1 << BITS).step_by(7) {
            let expected = (0..BITS).fold(0, |all, i| all | u64::from(x >> i & 1) << (3 * i));
            assert_eq!(spread(x), expected, "{x:b}");
        }
    }
}
