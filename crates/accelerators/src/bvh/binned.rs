//! The build by the surface area heuristic in bins.
//!
//! Wald, *On fast construction of SAH-based bounding volume hierarchies*, 2007: at each node the centers of
//! the items are put into bins along all three axes, and the best of the splits between bins is taken.

use super::MAX_DEPTH;
use super::items::{Box4, Item};
use super::tree::{Binary, BinaryKind, Tree};
use glam::Vec4;

/// Most bins along an axis.
pub(super) const MOST_BINS: usize = 32;

/// From this number of items on both sides are built in parallel.
const PARALLEL: usize = 4096;

/// How a build is done.
#[derive(Clone, Copy, Debug)]
pub(super) struct Binned {
    /// Nodes with no more items may be leaves, where that costs less.
    pub(super) max_leaf: usize,
    /// Time of a step down in units of the test of one item.
    pub(super) step: f32,
    /// Most bins along an axis, at most 32.
    pub(super) bins: usize,
}

/// The best split that was found: items in bins below `bin` go to the first side.
#[derive(Clone, Copy)]
pub(super) struct Split {
    pub(super) cost: f32,
    pub(super) axis: usize,
    pub(super) bin: i32,
}

impl Binned {
    /// Builds over all items. The result depends on these and their order only.
    pub(super) fn build(self, mut items: Vec<Item>) -> Tree {
        let mut nodes = vec![Binary::EMPTY; (2 * items.len()).saturating_sub(1)];
        if !items.is_empty() {
            let (aabb, centers) = bounds(&items);
            self.node(&mut items, &mut nodes, aabb, centers, 0, 0, 0);
        }
        Tree { nodes, items }
    }

    /// Builds over `items`, which begin at `first`, into `nodes`, which begin at `at`: two less one an item.
    #[expect(clippy::too_many_arguments, reason = "a recursion with what it knows")]
    fn node(
        self,
        items: &mut [Item],
        nodes: &mut [Binary],
        aabb: Box4,
        centers: Box4,
        first: u32,
        at: u32,
        depth: usize,
    ) {
        let n = items.len();
        nodes[0].aabb = aabb;
        nodes[0].kind = BinaryKind::Leaf(first, n as u32);
        if n == 1 {
            return;
        }
        // Halving leads to single items in as many steps as there are bits in n: from where that is all
        // that there is room for, halve.
        let must_halve = depth + (usize::BITS - n.leading_zeros()) as usize >= MAX_DEPTH;
        let bins = Bins::new(&centers, self.bins.min(4 + n / 16));
        let split = if must_halve { None } else { bins.best(items) };
        if n <= self.max_leaf {
            let area = aabb.half_area();
            let worth = split.is_some_and(|split| self.step * area + split.cost < n as f32 * area);
            if !worth {
                return;
            }
        }
        let middle = match split {
            Some(split) => partition(items, |item| bins.of(item)[split.axis] < split.bin),
            None => halve(items, &centers),
        };
        let (left, right) = items.split_at_mut(middle);
        let second = at + 2 * middle as u32;
        nodes[0].kind = BinaryKind::Inner(second);
        let (left_nodes, right_nodes) = nodes[1..].split_at_mut(2 * middle - 1);
        let mut build_left = || {
            let (aabb, centers) = bounds(left);
            self.node(left, left_nodes, aabb, centers, first, at + 1, depth + 1);
        };
        let mut build_right = || {
            let (aabb, centers) = bounds(right);
            let first = first + middle as u32;
            self.node(right, right_nodes, aabb, centers, first, second, depth + 1);
        };
        if n >= PARALLEL {
            rayon::join(build_left, build_right);
        } else {
            build_left();
            build_right();
        }
    }
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

/// Brings what `goes_first` to the front; returns how many. The order depends on the old one only.
pub(super) fn partition(items: &mut [Item], goes_first: impl Fn(&Item) -> bool) -> usize {
    let (mut low, mut high) = (0, items.len());
    loop {
        while low < high && goes_first(&items[low]) {
            low += 1;
        }
        while low < high && !goes_first(&items[high - 1]) {
            high -= 1;
        }
        if low >= high {
            return low;
        }
        items.swap(low, high - 1);
    }
}

/// Bins along the three axes.
pub(super) struct Bins {
    count: usize,
    start: Vec4,
    scale: Vec4,
    last: glam::IVec4,
}

impl Bins {
    pub(super) fn new(centers: &Box4, count: usize) -> Self {
        let extent = centers.max - centers.min;
        // All go into bin 0 along an axis without extent. The factor keeps the largest in the last bin.
        let scale = Vec4::splat(count as f32 * (1.0 - 1e-6)) / extent;
        let scale = Vec4::select(extent.cmpgt(Vec4::splat(1e-30)), scale, Vec4::ZERO);
        Self {
            count,
            start: centers.min,
            scale,
            last: glam::IVec4::splat(count as i32 - 1),
        }
    }

    /// The bins of an item.
    #[inline(always)]
    pub(super) fn of(&self, item: &Item) -> [i32; 4] {
        let place = (item.center() - self.start) * self.scale;
        place.as_ivec4().clamp(glam::IVec4::ZERO, self.last).to_array()
    }

    /// The best split between bins; `None` if all centers fall into one.
    pub(super) fn best(&self, items: &[Item]) -> Option<Split> {
        let mut bins = [[(Box4::EMPTY, 0u32); MOST_BINS]; 3];
        for item in items {
            let place = self.of(item);
            let aabb = item.aabb();
            for axis in 0..3 {
                let bin = &mut bins[axis][place[axis] as usize % MOST_BINS];
                bin.0 = bin.0.union(aabb);
                bin.1 += 1;
            }
        }
        let mut best: Option<Split> = None;
        for (axis, bins) in bins.iter().enumerate() {
            if self.scale[axis] == 0.0 {
                continue;
            }
            let mut after = [(0f32, 0u32); MOST_BINS];
            let (mut right, mut count) = (Box4::EMPTY, 0);
            for i in (1..self.count).rev() {
                right = right.union(bins[i].0);
                count += bins[i].1;
                after[i] = (right.half_area(), count);
            }
            let (mut left, mut count) = (Box4::EMPTY, 0);
            for i in 1..self.count {
                left = left.union(bins[i - 1].0);
                count += bins[i - 1].1;
                let (area, number) = after[i];
                if count == 0 || number == 0 {
                    continue;
                }
                let cost = left.half_area() * count as f32 + area * number as f32;
                if best.is_none_or(|best| cost < best.cost) {
                    best = Some(Split {
                        cost,
                        axis,
                        bin: i as i32,
                    });
                }
            }
        }
        best
    }
}
