//! The fastest build (LBVH): elements are sorted by Morton code, and ranges are divided where its
//! bits change.
//!
//! Lauterbach et al., *Fast BVH construction on GPUs*, Eurographics 2009: a range is divided at the
//! highest bit in which its first and its last code differ.

use super::MAX_DEPTH;
use super::tree::{Binary, Parts};
use crate::support::leaves::Number;
use crate::support::leaves::filter::NUMBERS;
use crate::support::leaves::items::{Box4, Contents, Items, PARALLEL};
use rayon::prelude::*;

/// Maximum number of items in a leaf.
const MAX_LEAF: usize = 4;

/// Bits of a code per axis. The three axes and the number of an element, which is below 2^28, fill
/// 64 bits.
const BITS: u32 = 12;

/// Bits of an element's number.
const NUMBER: u32 = 64 - 3 * BITS;

/// The elements by their place: a code and a number each, sorted.
pub(super) struct Keys(Vec<u64>);

impl Keys {
    pub(super) fn new(items: &Items) -> Self {
        Self(sorted(keys(items)))
    }

    /// Whether more than `count` elements have the same code.
    pub(super) fn any_cell_has_more_than(&self, count: usize) -> bool {
        let code = |key: u64| key >> NUMBER;
        self.0
            .windows(count + 1)
            .any(|run| code(run[0]) == code(run[count]))
    }
}

/// Builds over all elements; returns the nodes and the contents of the leaves. The result depends
/// only on the elements and their order.
pub(super) fn build<T: Number>(items: &Items, Keys(keys): &Keys) -> (Vec<Binary>, Contents<T>) {
    let contents = items.contents(keys, |key| number(*key));
    if keys.is_empty() {
        return (Vec::new(), contents);
    }
    let builder = Builder { items };
    let corners = &contents.corners;
    let nodes = if rayon::current_num_threads() == 1 {
        // The same without a copy.
        let mut nodes = Vec::with_capacity(2 * keys.len());
        builder.node(keys, corners, &mut nodes, 0);
        nodes
    } else {
        builder.subtree(keys, corners, 0).1.concat()
    };
    (nodes, contents)
}

/// The element number in a key.
fn number(key: u64) -> u32 {
    (key & ((1 << NUMBER) - 1)) as u32
}

/// The keys of the elements: code and number.
fn keys(items: &Items) -> Vec<u64> {
    let cells = f64::from((1u32 << BITS) - 1);
    let (start, extent) = (items.centers().min, items.centers().extent().max_element());
    // One scale for all axes, so that cells are cubes.
    let scale = if extent > 1e-300 { cells / extent } else { 0.0 };
    items.each(|number| {
        // The conversion saturates, so every value yields a cell.
        let cell = ((items.center(number) - start) * scale).to_array();
        let code = cell.map(|x| spread(x as u32));
        (code[0] << 2 | code[1] << 1 | code[2]) << NUMBER | u64::from(number)
    })
}

/// Sorts keys: into buckets by their highest bits, then each bucket by itself.
fn sorted(keys: Vec<u64>) -> Vec<u64> {
    const BUCKETS: u32 = 12;
    let bucket = |key: u64| (key >> (u64::BITS - BUCKETS)) as usize;
    let mut ends = [0u32; 1 << BUCKETS];
    for &key in &keys {
        ends[bucket(key)] += 1;
    }
    let mut sorted = vec![0; keys.len()];
    let mut start = 0;
    for end in &mut ends {
        (start, *end) = (start + *end, start);
    }
    for &key in &keys {
        let end = &mut ends[bucket(key)];
        sorted[*end as usize] = key;
        *end += 1;
    }
    let mut rest = sorted.as_mut_slice();
    let mut start = 0;
    let mut buckets = Vec::new();
    for end in ends {
        buckets.extend(rest.split_off_mut(..(end - start) as usize));
        start = end;
    }
    buckets.into_par_iter().for_each(|bucket| bucket.sort_unstable());
    sorted
}

/// For each 6-bit number, its bits placed three apart.
const SPREAD: [u64; 64] = {
    let mut table = [0; 64];
    let mut x = 0;
    while x < 64 {
        let mut bit = 0;
        while bit < 6 {
            table[x] |= (x as u64 >> bit & 1) << (3 * bit);
            bit += 1;
        }
        x += 1;
    }
    table
};

/// Inserts two zeros before each of 12 bits.
#[inline(always)]
fn spread(x: u32) -> u64 {
    let part = |shift: u32| SPREAD[(x >> shift & 63) as usize];
    part(6) << 18 | part(0)
}

struct Builder<'a> {
    items: &'a Items<'a>,
}

impl Builder<'_> {
    /// The box of the elements with these keys and corners, and the subtree over them.
    fn subtree<T: Number>(&self, keys: &[u64], corners: &[[T; NUMBERS]], depth: usize) -> (Box4, Parts) {
        let n = keys.len();
        if n < PARALLEL {
            let mut nodes = Vec::with_capacity(n);
            let aabb = self.node(keys, corners, &mut nodes, depth);
            return (aabb, Parts::whole(nodes));
        }
        let middle = divide(keys, depth);
        let ((left, first), (right, second)) = rayon::join(
            || self.subtree(&keys[..middle], corners, depth + 1),
            || self.subtree(&keys[middle..], &corners[middle..], depth + 1),
        );
        let aabb = left.union(right);
        (aabb, Parts::inner(aabb, n, first, second))
    }

    /// Appends the subtree over a few elements; returns its box.
    fn node<T: Number>(
        &self,
        keys: &[u64],
        corners: &[[T; NUMBERS]],
        nodes: &mut Vec<Binary>,
        depth: usize,
    ) -> Box4 {
        let n = keys.len();
        if n <= MAX_LEAF {
            let boxes = keys.iter().zip(corners);
            let boxes = boxes.map(|(key, corners)| self.items.aabb(number(*key), corners));
            let aabb = boxes.fold(Box4::EMPTY, Box4::union);
            nodes.push(Binary::leaf(aabb, n));
            return aabb;
        }
        let middle = divide(keys, depth);
        let index = nodes.len();
        nodes.push(Binary::leaf(Box4::EMPTY, n));
        let left = self.node(&keys[..middle], corners, nodes, depth + 1);
        let second = nodes.len() - index;
        let right = self.node(&keys[middle..], &corners[middle..], nodes, depth + 1);
        let aabb = left.union(right);
        nodes[index] = Binary::inner(aabb, n, second);
        aabb
    }
}

/// Where the second part of a range of at least two keys begins.
fn divide(keys: &[u64], depth: usize) -> usize {
    let n = keys.len();
    let different = (keys[0] ^ keys[n - 1]) >> NUMBER;
    // Halving n items reaches single items after at most as many levels as n has bits. Once only
    // that many levels remain, halve.
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
