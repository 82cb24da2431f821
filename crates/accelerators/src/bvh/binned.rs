//! The build by the surface area heuristic in bins.
//!
//! Wald, *On fast construction of SAH-based bounding volume hierarchies*, 2007: at each node the centers of
//! the items are put into bins along all three axes, and the best of the splits between bins is taken.

use super::MAX_DEPTH;
use super::items::{Box4, Item};
use super::tree::{Binary, BinaryKind, Tree, append};
use glam::Vec4;

/// Most bins along an axis.
pub(super) const MOST_BINS: usize = 32;

/// From this number of items on both sides are built in parallel.
const PARALLEL: usize = 4096;

/// How a build is done.
#[derive(Clone, Copy, Debug)]
pub(super) struct Binned {
    /// Nodes with no more items are not divided.
    pub(super) max_leaf: usize,
    /// Most bins along an axis, at most 32.
    pub(super) bins: usize,
}

/// The best split that was found: items in bins below `bin` go to the first side.
#[derive(Clone, Copy)]
pub(super) struct Split {
    pub(super) cost: f32,
    pub(super) axis: usize,
    pub(super) bin: usize,
}

impl Binned {
    /// Builds over all items. The result depends on these and their order only.
    pub(super) fn build(self, mut items: Vec<Item>) -> Tree {
        let mut nodes = Vec::new();
        if !items.is_empty() {
            let bounds = bounds(&items);
            self.node(&mut items, &mut nodes, bounds, 0, 0);
        }
        Tree { nodes, items }
    }

    /// Appends the subtree over `items`, which begin at `first`; gives their order.
    fn node(
        self,
        items: &mut [Item],
        nodes: &mut Vec<Binary>,
        (aabb, centers): (Box4, Box4),
        first: u32,
        depth: usize,
    ) {
        let n = items.len();
        let index = nodes.len();
        let kind = BinaryKind::Leaf(first, n as u32);
        nodes.push(Binary { aabb, kind });
        if n <= self.max_leaf {
            return;
        }
        let Sides { middle, bounds } = self.split(items, &centers, depth);
        let (left, right) = items.split_at_mut(middle);
        let second = first + middle as u32;
        if n >= PARALLEL {
            let mut behind = Vec::new();
            rayon::join(
                || self.node(left, nodes, bounds[0], first, depth + 1),
                || self.node(right, &mut behind, bounds[1], second, depth + 1),
            );
            nodes[index].kind = BinaryKind::Inner(nodes.len() as u32);
            append(nodes, behind, 0);
        } else {
            self.node(left, nodes, bounds[0], first, depth + 1);
            nodes[index].kind = BinaryKind::Inner(nodes.len() as u32);
            self.node(right, nodes, bounds[1], second, depth + 1);
        }
    }

    /// Brings the items of one side to the front.
    fn split(self, items: &mut [Item], centers: &Box4, depth: usize) -> Sides {
        let n = items.len();
        // Halving leads to single items in as many steps as there are bits in n: from where that is all
        // that there is room for, halve.
        let must_halve = depth + (usize::BITS - n.leading_zeros()) as usize >= MAX_DEPTH;
        let bins = Bins::new(centers, self.bins.min(4 + n / 16));
        let best = if must_halve { None } else { bins.best(items) };
        match best {
            Some(split) => partition(items, |item| bins.side(item, &split)),
            None => {
                let middle = halve(items, centers);
                let (left, right) = items.split_at(middle);
                Sides {
                    middle,
                    bounds: [bounds(left), bounds(right)],
                }
            }
        }
    }
}

/// Items in two parts: where the second begins, and the bounds of both.
pub(super) struct Sides {
    pub(super) middle: usize,
    bounds: [(Box4, Box4); 2],
}

/// The box around the items and that around their (doubled) centers.
pub(super) fn bounds(items: &[Item]) -> (Box4, Box4) {
    let start = (Box4::EMPTY, Box4::EMPTY);
    items.iter().fold(start, |(aabb, centers), item| {
        (aabb.union(item.aabb()), centers.including(item.center()))
    })
}

/// Brings the items whose centers come first along the longest axis to the front: half of them.
pub(super) fn halve(items: &mut [Item], centers: &Box4) -> usize {
    let axis = centers.longest_axis();
    let middle = items.len() / 2;
    items.select_nth_unstable_by(middle, |a, b| {
        let by_center = a.center()[axis].total_cmp(&b.center()[axis]);
        by_center.then(a.number().cmp(&b.number()))
    });
    middle
}

/// Brings what `goes_first` to the front. The order depends on the old one only.
pub(super) fn partition(items: &mut [Item], goes_first: impl Fn(&Item) -> bool) -> Sides {
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
        // All go into bin 0 along an axis without extent.
        let scale = Vec4::splat((count - 1) as f32) / extent;
        let scale = Vec4::select(extent.cmpgt(Vec4::splat(1e-30)), scale, Vec4::ZERO);
        Self {
            count,
            start: centers.min,
            scale,
            last: Vec4::splat((count - 1) as f32),
        }
    }

    /// The bins of an item.
    #[inline(always)]
    fn of(&self, item: &Item) -> [usize; 3] {
        // Conversions are slow; the last bits of a float that has no room for a fraction are an integer.
        let place = ((item.center() - self.start) * self.scale).clamp(Vec4::ZERO, self.last);
        let bits = (place + Vec4::splat((1u32 << 23) as f32)).to_array();
        [bits[0], bits[1], bits[2]].map(|x| (x.to_bits() & 0xff) as usize)
    }

    /// Whether an item is on the first side of a split.
    #[inline(always)]
    pub(super) fn side(&self, item: &Item, split: &Split) -> bool {
        self.of(item)[split.axis] < split.bin
    }

    /// The best split between bins; `None` if all centers fall into one.
    pub(super) fn best(&self, items: &[Item]) -> Option<Split> {
        // Clearing many bins for few items would take longer than the items.
        match self.count {
            0..=4 => self.best_of::<4>(items),
            5..=8 => self.best_of::<8>(items),
            9..=16 => self.best_of::<16>(items),
            _ => self.best_of::<MOST_BINS>(items),
        }
    }

    fn best_of<const N: usize>(&self, items: &[Item]) -> Option<Split> {
        let mut bins = [[Box4::EMPTY; N]; 3];
        let mut counts = [[0u32; N]; 3];
        for item in items {
            let place = self.of(item);
            let aabb = item.aabb();
            for axis in 0..3 {
                let bin = place[axis] % N;
                bins[axis][bin] = bins[axis][bin].union(aabb);
                counts[axis][bin] += 1;
            }
        }
        let mut best: Option<Split> = None;
        for axis in 0..3 {
            if self.scale[axis] == 0.0 {
                continue;
            }
            let (bins, counts) = (&bins[axis], &counts[axis]);
            let mut after = [0f32; N];
            let (mut right, mut count) = (Box4::EMPTY, 0);
            for i in (1..self.count.min(N)).rev() {
                right = right.union(bins[i]);
                count += counts[i];
                // Nothing at all costs nothing, but is no side.
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
