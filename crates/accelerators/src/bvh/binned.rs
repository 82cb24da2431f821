//! The binned SAH build.
//!
//! Wald, *On fast construction of SAH-based bounding volume hierarchies*, 2007: at each node, the
//! centers of the items are assigned to bins along all three axes, and the best of the splits
//! between bins is taken.

use super::MAX_DEPTH;
use super::tree::{Binary, Parts, Tree};
use crate::support::leaves::items::{Box4, Item, PARALLEL};
use glam::Vec4;
use rayon::prelude::*;

/// Maximum number of bins per axis.
pub(super) const MAX_BINS: usize = 32;

/// From this number of items, the items of a single node are processed in parallel.
const MANY: usize = 1 << 16;

/// Parameters of a build.
#[derive(Clone, Copy, Debug)]
pub(super) struct Binned {
    /// Maximum number of items in a leaf.
    pub(super) max_leaf: usize,
    /// Maximum number of bins per axis, at most 32.
    pub(super) bins: usize,
    /// Number of items per additional bin.
    pub(super) items_a_bin: usize,
}

/// The best split found: items in bins below `bin` go to the first side.
#[derive(Clone, Copy)]
pub(super) struct Split {
    pub(super) cost: f32,
    pub(super) axis: usize,
    pub(super) bin: usize,
}

impl Binned {
    /// Builds over all items. The result depends only on these and their order.
    pub(super) fn build(self, mut items: Vec<Item>) -> Tree {
        if items.is_empty() {
            return Tree::default();
        }
        let bounds = bounds(&items);
        let nodes = self.subtree(&mut items, bounds, 0).concat();
        Tree { nodes, items }
    }

    /// Builds the subtree over items and reorders them.
    fn subtree(self, items: &mut [Item], bounds: (Box4, Box4), depth: usize) -> Parts {
        let n = items.len();
        if n < PARALLEL {
            let mut nodes = Vec::with_capacity(n);
            self.node(items, &mut nodes, bounds, depth);
            return Parts::whole(nodes);
        }
        let (aabb, centers) = bounds;
        let Sides { middle, bounds } = self.split(items, &centers, depth);
        let (left, right) = items.split_at_mut(middle);
        let (first, second) = rayon::join(
            || self.subtree(left, bounds[0], depth + 1),
            || self.subtree(right, bounds[1], depth + 1),
        );
        Parts::inner(aabb, n, first, second)
    }

    /// Appends the subtree over a few items with these bounds and reorders them.
    pub(super) fn node(
        self,
        items: &mut [Item],
        nodes: &mut Vec<Binary>,
        (aabb, centers): (Box4, Box4),
        depth: usize,
    ) {
        let n = items.len();
        let index = nodes.len();
        nodes.push(Binary::leaf(aabb, n));
        if n <= self.max_leaf {
            return;
        }
        let Sides { middle, bounds } = self.split(items, &centers, depth);
        let (left, right) = items.split_at_mut(middle);
        self.node(left, nodes, bounds[0], depth + 1);
        nodes[index] = Binary::inner(aabb, n, nodes.len() - index);
        self.node(right, nodes, bounds[1], depth + 1);
    }

    /// Moves the items of one side to the front.
    fn split(self, items: &mut [Item], centers: &Box4, depth: usize) -> Sides {
        let n = items.len();
        // Halving n items reaches single items after at most as many levels as n has bits. Once
        // only that many levels remain, halve.
        let must_halve = depth + (usize::BITS - n.leading_zeros()) as usize >= MAX_DEPTH;
        let bins = Bins::new(centers, self.bins.min(4 + n / self.items_a_bin));
        let best = if must_halve { None } else { bins.best(items) };
        match best {
            Some(split) => partition(items, |item| bins.side(item, &split)),
            None => halve(items, centers),
        }
    }
}

/// Items in two parts: where the second begins, and the bounds of both.
pub(super) struct Sides {
    pub(super) middle: usize,
    pub(super) bounds: [(Box4, Box4); 2],
}

/// The box around the items, and the box around their (doubled) centers.
pub(super) fn bounds(items: &[Item]) -> (Box4, Box4) {
    let start = (Box4::EMPTY, Box4::EMPTY);
    let of_few = |items: &[Item]| {
        items.iter().fold(start, |(aabb, centers), item| {
            (aabb.union(item.aabb()), centers.including(item.center()))
        })
    };
    if items.len() < MANY {
        return of_few(items);
    }
    let parts = items.par_chunks(MANY / 2).map(of_few);
    parts.reduce(|| start, both)
}

/// The unions of two pairs of boxes.
fn both(a: (Box4, Box4), b: (Box4, Box4)) -> (Box4, Box4) {
    (a.0.union(b.0), a.1.union(b.1))
}

/// Moves the half of the items whose centers come first along the longest axis to the front.
pub(super) fn halve(items: &mut [Item], centers: &Box4) -> Sides {
    let axis = centers.longest_axis();
    let middle = items.len() / 2;
    items.select_nth_unstable_by(middle, |a, b| {
        let by_center = a.center()[axis].total_cmp(&b.center()[axis]);
        by_center.then(a.number().cmp(&b.number()))
    });
    let (left, right) = items.split_at(middle);
    Sides {
        middle,
        bounds: [bounds(left), bounds(right)],
    }
}

/// Moves the items for which `goes_first` holds to the front. The new order depends only on the old
/// one.
pub(super) fn partition(items: &mut [Item], goes_first: impl Fn(&Item) -> bool + Copy + Sync) -> Sides {
    if items.len() < MANY {
        return partition_few(items, goes_first);
    }
    let half = items.len() / 2;
    let (left, right) = items.split_at_mut(half);
    let (left, right) = rayon::join(|| partition(left, goes_first), || partition(right, goes_first));
    // Swaps the items of the left half that go last with those of the right half that go first.
    let between = &mut items[left.middle..half + right.middle];
    let moved = (half - left.middle).min(right.middle);
    let (front, back) = between.split_at_mut(between.len() - moved);
    front[..moved].swap_with_slice(back);
    Sides {
        middle: left.middle + right.middle,
        bounds: [0, 1].map(|side: usize| both(left.bounds[side], right.bounds[side])),
    }
}

fn partition_few(items: &mut [Item], goes_first: impl Fn(&Item) -> bool) -> Sides {
    let (mut low, mut high) = (0, items.len());
    let mut bounds = [(Box4::EMPTY, Box4::EMPTY); 2];
    let mut count = |item: &Item, side: usize| {
        let (aabb, centers) = &mut bounds[side];
        *aabb = aabb.union(item.aabb());
        *centers = centers.including(item.center());
    };
    loop {
        while low < high && goes_first(&items[low]) {
            count(&items[low], 0);
            low += 1;
        }
        while low < high && !goes_first(&items[high - 1]) {
            count(&items[high - 1], 1);
            high -= 1;
        }
        if low >= high {
            return Sides { middle: low, bounds };
        }
        items.swap(low, high - 1);
    }
}

/// Bins along the three axes.
pub(super) struct Bins {
    count: usize,
    start: Vec4,
    scale: Vec4,
    last: Vec4,
}

impl Bins {
    pub(super) fn new(centers: &Box4, count: usize) -> Self {
        let extent = centers.max - centers.min;
        // All items go into bin 0 along an axis without extent.
        let scale = Vec4::splat((count - 1) as f32) / extent;
        let scale = Vec4::select(extent.cmpgt(Vec4::splat(1e-30)), scale, Vec4::ZERO);
        Self {
            count,
            start: centers.min,
            scale,
            last: Vec4::splat((count - 1) as f32),
        }
    }

    /// The bin of an item along each axis.
    #[inline(always)]
    fn of(&self, item: &Item) -> [usize; 3] {
        // Avoids slow conversions: after adding 2^23, the lowest bits of a float are the integer.
        let place = ((item.center() - self.start) * self.scale).clamp(Vec4::ZERO, self.last);
        let bits = (place + Vec4::splat((1u32 << 23) as f32)).to_array();
        [bits[0], bits[1], bits[2]].map(|x| (x.to_bits() & 0xff) as usize)
    }

    /// Whether an item is on the first side of a split.
    #[inline(always)]
    pub(super) fn side(&self, item: &Item, split: &Split) -> bool {
        self.of(item)[split.axis] < split.bin
    }

    /// The best split between bins; `None` if all centers fall into one bin.
    pub(super) fn best(&self, items: &[Item]) -> Option<Split> {
        // Clearing many bins for few items would take longer than processing the items.
        match self.count {
            0..=4 => self.best_of::<4>(items),
            5..=8 => self.best_of::<8>(items),
            9..=16 => self.best_of::<16>(items),
            _ => self.best_of::<MAX_BINS>(items),
        }
    }

    fn fill<const N: usize>(&self, items: &[Item]) -> Filled<N> {
        let mut filled = Filled::default();
        for item in items {
            let place = self.of(item);
            let aabb = item.aabb();
            for axis in 0..3 {
                let bin = place[axis] % N;
                filled.boxes[axis][bin] = filled.boxes[axis][bin].union(aabb);
                filled.counts[axis][bin] += 1;
            }
        }
        filled
    }

    fn best_of<const N: usize>(&self, items: &[Item]) -> Option<Split> {
        let Filled { boxes, counts } = if items.len() < MANY {
            self.fill::<N>(items)
        } else {
            let parts = items.par_chunks(MANY / 2).map(|items| self.fill::<N>(items));
            parts.reduce(Filled::default, Filled::union)
        };
        let mut best: Option<Split> = None;
        for axis in 0..3 {
            if self.scale[axis] == 0.0 {
                continue;
            }
            let (bins, counts) = (&boxes[axis], &counts[axis]);
            let mut after = [0f32; N];
            let (mut right, mut count) = (Box4::EMPTY, 0);
            for i in (1..self.count.min(N)).rev() {
                right = right.union(bins[i]);
                count += counts[i];
                // An empty side would cost nothing, but is not a valid side.
                after[i] = if count == 0 {
                    f32::INFINITY
                } else {
                    right.half_area() * count as f32
                };
            }
            let (mut left, mut count) = (Box4::EMPTY, 0);
            for i in 1..self.count.min(N) {
                left = left.union(bins[i - 1]);
                count += counts[i - 1];
                let cost = left.half_area() * count as f32 + after[i];
                if count > 0 && best.is_none_or(|best| cost < best.cost) && cost < f32::INFINITY {
                    best = Some(Split { cost, axis, bin: i });
                }
            }
        }
        best
    }
}

/// Contents of the bins, by axis and bin.
struct Filled<const N: usize> {
    boxes: [[Box4; N]; 3],
    counts: [[u32; N]; 3],
}

impl<const N: usize> Default for Filled<N> {
    fn default() -> Self {
        Self {
            boxes: [[Box4::EMPTY; N]; 3],
            counts: [[0; N]; 3],
        }
    }
}

impl<const N: usize> Filled<N> {
    fn union(mut self, other: Self) -> Self {
        for axis in 0..3 {
            for bin in 0..N {
                self.boxes[axis][bin] = self.boxes[axis][bin].union(other.boxes[axis][bin]);
                self.counts[axis][bin] += other.counts[axis][bin];
            }
        }
        self
    }
}
