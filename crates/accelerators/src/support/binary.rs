//! Builds binary hierarchies top down over the centers of the elements' boxes, for any kind of node
//! volume.
//!
//! - `split = "sah"`: the surface area heuristic, binned (Wald, *On fast construction of SAH-based
//!   bounding volume hierarchies*, 2007), or by a full sweep for small nodes.
//! - `split = "midpoint"`: the middle of the box of all centers. `split = "median"`: half of the
//!   elements on each side.
//! - `split = "between"`: as `"sah"`, but only the splits between the median and the midpoint are
//!   tried (MacDonald and Booth, *Heuristics for ray tracing using space subdivision*, 1990:
//!   the best plane of a kd-tree lies between them).
//! - `axes = "longest"` tries the axis with the largest extent of the centers; `"all"` tries all
//!   three and takes the cheapest.

use crate::support::elements::{Item, bounds};
use crate::support::split::{Axes, Split};
use std::cmp::Ordering;
use std::ops::Range;
use whitstone_core::Aabb;

/// Cost of a traversal step in element tests, measured on triangle meshes.
pub(crate) const STEP_COST: f64 = 0.7;

/// Maximum depth of the tree.
pub(crate) const MAX_DEPTH: usize = 64;

/// Bins per axis.
const BINS: usize = 32;

/// Up to this number of elements, every split is tried.
const SWEEP: usize = 24;

/// From this number of elements, both sides are built in parallel.
const PARALLEL: usize = 4096;

/// A subtree.
pub(crate) enum Tree {
    /// A range of the items.
    Leaf(Range<usize>),
    /// Two subtrees, each with the bounds of its items.
    Inner([(Aabb, Box<Tree>); 2]),
}

impl Tree {
    /// The items of the subtree, which are contiguous.
    pub(crate) fn range(&self) -> Range<usize> {
        match self {
            Self::Leaf(range) => range.clone(),
            Self::Inner([(_, left), (_, right)]) => left.range().start..right.range().end,
        }
    }
}

/// Parameters of a build.
pub(crate) struct Builder {
    /// Maximum number of elements in a leaf.
    pub(crate) max_leaf: usize,
    pub(crate) split: Split,
    pub(crate) axes: Axes,
    /// Cost of a traversal step in element tests.
    pub(crate) step_cost: f64,
}

/// The best split found so far: its cost (area times count, summed over both sides) and how to make
/// it.
struct Cut {
    cost: f64,
    axis: usize,
    at: At,
}

enum At {
    /// Items in bins below this one go left.
    Bin(usize),
    /// This number of items goes left, in the order of their centers.
    Count(usize),
}

impl Builder {
    /// Builds a tree over at least one item and reorders the items into leaf order. The result
    /// depends only on the items, not on the number of threads.
    pub(crate) fn build(&self, items: &mut [Item]) -> Tree {
        self.tree(items, 0, 0)
    }

    fn tree(&self, items: &mut [Item], first: usize, depth: usize) -> Tree {
        let n = items.len();
        let leaf = Tree::Leaf(first..first + n);
        if n == 1 {
            return leaf;
        }
        let centers = Aabb::around(items.iter().map(|item| item.center));
        // Halving n items reaches single items after at most as many levels as n has bits. Once
        // only that many levels remain, halve.
        let must_halve = depth + (usize::BITS - n.leading_zeros()) as usize >= MAX_DEPTH;
        let cut = if must_halve {
            None
        } else {
            self.choose(items, &centers)
        };
        if n <= self.max_leaf {
            let area = bounds(items).half_area();
            let worth = self.split.asks_cost()
                && cut
                    .as_ref()
                    .is_some_and(|cut| self.step_cost * area + cut.cost < n as f64 * area);
            if !worth {
                return leaf;
            }
        }
        let middle = match cut {
            Some(Cut {
                axis,
                at: At::Bin(bin),
                ..
            }) => {
                let to_bin = ToBin::new(&centers, axis);
                partition(items, |item| to_bin.bin(item) < bin)
            }
            Some(Cut {
                axis,
                at: At::Count(count),
                ..
            }) => {
                sort(items, axis);
                count
            }
            None => {
                let extent = centers.extent().to_array();
                halve(items, Axes::Longest.of(extent).next().unwrap_or(0))
            }
        };
        let (left, right) = items.split_at_mut(middle);
        let boxes = [bounds(left), bounds(right)];
        let build_left = |items: &mut [Item]| Box::new(self.tree(items, first, depth + 1));
        let build_right = |items: &mut [Item]| Box::new(self.tree(items, first + middle, depth + 1));
        let (left, right) = if n >= PARALLEL {
            rayon::join(|| build_left(left), || build_right(right))
        } else {
            (build_left(left), build_right(right))
        };
        Tree::Inner([(boxes[0], left), (boxes[1], right)])
    }

    /// The best split of the configured kind; `None` if there is none, for example if all centers
    /// coincide.
    fn choose(&self, items: &mut [Item], centers: &Aabb) -> Option<Cut> {
        let axes = self.axes.of(centers.extent().to_array());
        match self.split {
            Split::Sah if items.len() <= SWEEP => sweep(items, axes, |items, _| 1..items.len()),
            Split::Between if items.len() <= SWEEP => sweep(items, axes, between),
            Split::Sah | Split::Between | Split::Midpoint => binned(items, centers, axes, self.split),
            Split::Median => {
                let cuts = axes.map(|axis| {
                    let middle = halve(items, axis);
                    let (left, right) = items.split_at(middle);
                    let cost = |side: &[Item]| bounds(side).half_area() * side.len() as f64;
                    Cut {
                        cost: cost(left) + cost(right),
                        axis,
                        at: At::Count(middle),
                    }
                });
                cuts.reduce(|best, cut| if cut.cost < best.cost { cut } else { best })
            }
        }
    }
}

/// Order by the center along an axis, then by number.
fn order(axis: usize) -> impl Fn(&Item, &Item) -> Ordering {
    move |a, b| {
        a.center[axis]
            .total_cmp(&b.center[axis])
            .then(a.number.cmp(&b.number))
    }
}

fn sort(items: &mut [Item], axis: usize) {
    items.sort_unstable_by(order(axis));
}

/// Moves the lower half along an axis to the front; returns its size.
fn halve(items: &mut [Item], axis: usize) -> usize {
    let middle = items.len() / 2;
    items.select_nth_unstable_by(middle, order(axis));
    middle
}

/// Moves the items for which `goes_left` holds to the front, in an unspecified but reproducible
/// order; returns their number.
fn partition(items: &mut [Item], goes_left: impl Fn(&Item) -> bool) -> usize {
    let mut middle = 0;
    for i in 0..items.len() {
        if goes_left(&items[i]) {
            items.swap(middle, i);
            middle += 1;
        }
    }
    middle
}

/// The numbers of lower items that lie between the median and the midpoint of items that are sorted
/// along an axis.
fn between(items: &[Item], axis: usize) -> Range<usize> {
    let n = items.len();
    let (low, high) = (items[0].center[axis], items[n - 1].center[axis]);
    let middle = 0.5 * low + 0.5 * high;
    let below = items.partition_point(|item| item.center[axis] < middle);
    (n / 2).min(below).max(1)..(n / 2).max(below).min(n - 1) + 1
}

/// The best split of a few items along some axes, among the numbers of lower items that `tried`
/// gives for sorted items and their axis; `None` if there is no split.
fn sweep(
    items: &mut [Item],
    axes: impl Iterator<Item = usize>,
    tried: impl Fn(&[Item], usize) -> Range<usize>,
) -> Option<Cut> {
    let n = items.len();
    let mut best: Option<Cut> = None;
    let mut right_areas = [0.0; SWEEP];
    for axis in axes {
        sort(items, axis);
        let mut right = Aabb::EMPTY;
        for i in (1..n).rev() {
            right = right.union(items[i].aabb);
            right_areas[i] = right.half_area();
        }
        let tried = tried(items, axis);
        let mut left = Aabb::EMPTY;
        for i in 1..n {
            left = left.union(items[i - 1].aabb);
            if !tried.contains(&i) {
                continue;
            }
            let cost = left.half_area() * i as f64 + right_areas[i] * (n - i) as f64;
            if best.as_ref().is_none_or(|best| cost < best.cost) {
                best = Some(Cut {
                    cost,
                    axis,
                    at: At::Count(i),
                });
            }
        }
    }
    best
}

/// Maps an item to a bin by its center.
struct ToBin {
    axis: usize,
    start: f64,
    scale: f64,
}

impl ToBin {
    fn new(centers: &Aabb, axis: usize) -> Self {
        let extent = centers.max[axis] - centers.min[axis];
        Self {
            axis,
            start: centers.min[axis],
            scale: BINS as f64 / extent,
        }
    }

    fn bin(&self, item: &Item) -> usize {
        // The conversion saturates, so rounding cannot yield a bin out of range.
        (((item.center[self.axis] - self.start) * self.scale) as usize).min(BINS - 1)
    }
}

/// The best split at a lower border of a bin that `split` tries; `None` if each leaves one side
/// empty.
fn binned(items: &[Item], centers: &Aabb, axes: impl Iterator<Item = usize>, split: Split) -> Option<Cut> {
    let mut best: Option<Cut> = None;
    for axis in axes {
        let to_bin = ToBin::new(centers, axis);
        if !to_bin.scale.is_finite() {
            continue;
        }
        let mut bins = [(Aabb::EMPTY, 0usize); BINS];
        for item in items {
            let (aabb, count) = &mut bins[to_bin.bin(item)];
            *aabb = aabb.union(item.aabb);
            *count += 1;
        }
        let mut below = 0;
        let median = bins.iter().position(|(_, count)| {
            below += count;
            below > items.len() / 2
        });
        let before = split.borders(BINS, median.unwrap_or(BINS - 1));
        let mut right_of = [(0.0, 0usize); BINS];
        let (mut right, mut count) = (Aabb::EMPTY, 0);
        for i in (1..BINS).rev() {
            right = right.union(bins[i].0);
            count += bins[i].1;
            right_of[i] = (right.half_area(), count);
        }
        let (mut left, mut count) = (Aabb::EMPTY, 0);
        for i in 1..BINS {
            left = left.union(bins[i - 1].0);
            count += bins[i - 1].1;
            let (right_area, right_count) = right_of[i];
            if count == 0 || right_count == 0 || !before.contains(&i) {
                continue;
            }
            let cost = left.half_area() * count as f64 + right_area * right_count as f64;
            if best.as_ref().is_none_or(|best| cost < best.cost) {
                best = Some(Cut {
                    cost,
                    axis,
                    at: At::Bin(i),
                });
            }
        }
    }
    best
}

#[cfg(test)]
mod tests {
    use super::*;
    use whitstone_core::{DVec3, Element};
    use whitstone_testkit::Random;

    /// Small boxes that crowd towards the origin along each axis.
    fn crowd(random: &mut Random, count: u32) -> Vec<Item> {
        let item = |number| {
            let center = DVec3::from_array([(); 3].map(|()| random.unit().powi(4)));
            let half = 0.01 * random.cube().abs();
            Item {
                aabb: Aabb {
                    min: center - half,
                    max: center + half,
                },
                center,
                element: Element::Triangle {
                    shape: 0,
                    triangle: number,
                },
                number,
                sliver: false,
            }
        };
        (0..count).map(item).collect()
    }

    /// The cost of the chosen split, and the number of items below it.
    fn chosen(items: &[Item], split: Split) -> (f64, usize) {
        let builder = Builder {
            max_leaf: 1,
            split,
            axes: Axes::Longest,
            step_cost: STEP_COST,
        };
        let mut items = items.to_vec();
        let centers = Aabb::around(items.iter().map(|item| item.center));
        let cut = builder.choose(&mut items, &centers).expect("there is a split");
        let below = match cut.at {
            At::Count(count) => count,
            At::Bin(bin) => {
                let to_bin = ToBin::new(&centers, cut.axis);
                items.iter().filter(|item| to_bin.bin(item) < bin).count()
            }
        };
        (cut.cost, below)
    }

    #[test]
    fn the_best_split_between_the_median_and_the_midpoint_is_chosen() {
        let (mut random, mut dearer) = (Random::new(32), 0);
        for case in 0..100 {
            let n = if case < 50 { 2 + case % 23 } else { 200 };
            let items = crowd(&mut random, n);
            let centers = Aabb::around(items.iter().map(|item| item.center));
            let axis = Axes::Longest.of(centers.extent().to_array()).next().unwrap();
            let mut sorted = items.clone();
            sort(&mut sorted, axis);
            let middle = centers.center()[axis];
            let below = sorted.iter().filter(|item| item.center[axis] < middle).count();
            let half = sorted.len() / 2;
            let cost = |count: usize| {
                let (left, right) = sorted.split_at(count);
                bounds(left).half_area() * left.len() as f64 + bounds(right).half_area() * right.len() as f64
            };
            let best = (half.min(below)..=half.max(below))
                .map(cost)
                .fold(f64::INFINITY, f64::min);
            let (found, count) = chosen(&items, Split::Between);
            assert!((cost(count) / found - 1.0).abs() < 1e-12);
            let (sah, _) = chosen(&items, Split::Sah);
            assert!(sah <= found, "more splits to choose from cost no more");
            dearer += u32::from(sah < found);
            if sorted.len() <= SWEEP {
                assert_eq!(found, best, "{n} items");
            } else {
                // Bins are coarser than items: one bin on either side of the range.
                let width = centers.extent()[axis] / BINS as f64;
                let at = sorted[count].center[axis];
                let [low, high] = [half.min(below), half.max(below)].map(|i| sorted[i].center[axis]);
                assert!(low - width <= at && at <= high + width, "{low} {at} {high}");
                let (midpoint, _) = chosen(&items, Split::Midpoint);
                assert!(found <= midpoint);
            }
        }
        assert!(
            dearer > 0,
            "the range must exclude some of the best splits: {dearer}"
        );
    }
}
