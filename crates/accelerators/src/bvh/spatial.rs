//! The build with spatial splits (SBVH), for the fastest ray tracing.
//!
//! Stich, Friedrich, Dietrich, *Spatial splits in bounding volume hierarchies*, HPG 2009: where the
//! two sides of the best object split overlap, the items may be cut at a plane instead. An item on
//! both sides is then stored twice, each time with the box of its part. Section 4.4 of the paper,
//! *reference unsplitting*, decides which items are worth it. A hit on an element that is stored
//! twice is the same hit, so results do not change.

use super::MAX_DEPTH;
use super::binned::{Binned, Bins, MAX_BINS, Sides, Split, bounds, halve, partition};
use super::tree::{Binary, Tree};
use crate::support::leaves::items::{Box4, Corners, Item};

/// Spatial bins per axis.
const BINS: usize = 16;

/// From this number of items, both sides are built in parallel.
const PARALLEL: usize = 4096;

/// Spatial splits are tried where the sides of the object split share more than this part of the
/// node's area.
const OVERLAP: f32 = 0.1;

/// Nodes of at most this many items are not cut: they become one leaf or two.
const SMALL: usize = 12;

/// Maximum number of additional items, relative to the number of elements.
const SPARE: f32 = 0.3;

/// The build of nodes that are not cut.
const OBJECTS: Binned = Binned {
    max_leaf: 1,
    bins: MAX_BINS,
    items_a_bin: 4,
};

/// A build with spatial splits.
pub(super) struct Spatial<'a> {
    pub(super) corners: &'a Corners,
}

/// The items of a node.
struct Part {
    items: Vec<Item>,
    aabb: Box4,
    centers: Box4,
    /// Maximum number of additional items in the subtree.
    spare: usize,
    depth: usize,
}

impl Part {
    /// Items within these bounds.
    fn new(items: Vec<Item>, (aabb, centers): (Box4, Box4), spare: usize, depth: usize) -> Self {
        Self {
            items,
            aabb,
            centers,
            spare,
            depth,
        }
    }
}

/// A plane between spatial bins.
struct Cut {
    axis: usize,
    at: f32,
}

impl Spatial<'_> {
    /// Builds over all items. The result depends only on these and their order.
    pub(super) fn build(&self, items: Vec<Item>) -> Tree {
        let mut tree = Tree::default();
        if !items.is_empty() {
            let spare = (SPARE * items.len() as f32) as usize;
            let bounds = bounds(&items);
            self.node(&mut tree, Part::new(items, bounds, spare, 0));
        }
        tree
    }

    /// Appends a subtree.
    fn node(&self, tree: &mut Tree, mut part: Part) {
        if part.items.len() <= SMALL {
            // Most nodes are this small, and need no lists of their own.
            let bounds = (part.aabb, part.centers);
            OBJECTS.node(&mut part.items, &mut tree.nodes, bounds, part.depth);
            tree.items.extend(part.items);
            return;
        }
        let (index, first) = (tree.nodes.len(), tree.items.len());
        let aabb = part.aabb;
        tree.nodes.push(Binary::leaf(aabb, 1));
        let parallel = part.items.len() >= PARALLEL;
        let (left, right) = self.divide(part);
        let second;
        if parallel {
            let build = |part: Part| {
                let mut tree = Tree::default();
                self.node(&mut tree, part);
                tree
            };
            let (left, right) = rayon::join(|| build(left), || build(right));
            tree.append(left);
            second = tree.nodes.len();
            tree.append(right);
        } else {
            self.node(tree, left);
            second = tree.nodes.len();
            self.node(tree, right);
        }
        tree.nodes[index] = Binary::inner(aabb, tree.items.len() - first, second - index);
    }

    /// Divides a node into two parts of at least one item each.
    fn divide(&self, mut part: Part) -> (Part, Part) {
        let n = part.items.len();
        // As in `binned`: once only the levels needed for halving remain, halve.
        let must_halve = part.depth + (usize::BITS - n.leading_zeros()) as usize >= MAX_DEPTH;
        let bins = Bins::new(&part.centers, MAX_BINS.min(4 + n / 4));
        let object = if must_halve { None } else { bins.best(&part.items) };
        let cost = object.map_or(f32::INFINITY, |split| split.cost);
        if !must_halve
            && part.spare > 0
            && self.sides_overlap(&part, &bins, object)
            && let Some(cut) = self.best_cut(&part, cost)
            && let Some(sides) = self.cut(&part, &cut)
        {
            return sides;
        }
        let Sides { middle, bounds } = match object {
            Some(split) => partition(&mut part.items, |item| bins.side(item, &split)),
            None => halve(&mut part.items, &part.centers),
        };
        let right = part.items.split_off(middle);
        sides([part.items, right], bounds, part.spare, part.depth)
    }

    fn sides_overlap(&self, part: &Part, bins: &Bins, object: Option<Split>) -> bool {
        let Some(split) = object else {
            return true;
        };
        let (mut left, mut right) = (Box4::EMPTY, Box4::EMPTY);
        for item in &part.items {
            if bins.side(item, &split) {
                left = left.union(item.aabb());
            } else {
                right = right.union(item.aabb());
            }
        }
        left.intersection(right).half_area() > OVERLAP * part.aabb.half_area()
    }

    /// The best plane, if it costs less than `cost`.
    fn best_cut(&self, part: &Part, mut cost: f32) -> Option<Cut> {
        let mut best = None;
        for axis in 0..3 {
            let start = part.aabb.min[axis];
            let width = (part.aabb.max[axis] - start) / BINS as f32;
            if width < 64.0 * Corners::ROUNDING {
                continue;
            }
            let plane = |i: usize| start + width * i as f32;
            let to_bin = |x: f32| (((x - start) / width) as usize).min(BINS - 1);
            let mut boxes = [Box4::EMPTY; BINS];
            let (mut enter, mut leave) = ([0usize; BINS], [0usize; BINS]);
            for item in &part.items {
                let aabb = item.aabb();
                let (first, last) = (to_bin(aabb.min[axis]), to_bin(aabb.max[axis]));
                enter[first] += 1;
                leave[last] += 1;
                if first == last {
                    boxes[first] = boxes[first].union(aabb);
                    continue;
                }
                let mut bins = boxes[first..=last].iter_mut();
                self.corners
                    .slices(item, axis, (first + 1..=last).map(plane), |slice| {
                        if let Some(bin) = bins.next() {
                            *bin = bin.union(slice);
                        }
                    });
            }
            let mut after = [(0f32, 0usize); BINS];
            let (mut right, mut count) = (Box4::EMPTY, 0);
            for i in (1..BINS).rev() {
                right = right.union(boxes[i]);
                count += leave[i];
                after[i] = (right.half_area(), count);
            }
            let (mut left, mut count) = (Box4::EMPTY, 0);
            for i in 1..BINS {
                left = left.union(boxes[i - 1]);
                count += enter[i - 1];
                let (area, number) = after[i];
                let all = left.half_area() * count as f32 + area * number as f32;
                if count > 0 && number > 0 && all < cost {
                    cost = all;
                    best = Some(Cut { axis, at: plane(i) });
                }
            }
        }
        best
    }

    /// Cuts all items at a plane; `None` if that adds too many items or makes no progress.
    fn cut(&self, part: &Part, cut: &Cut) -> Option<(Part, Part)> {
        let (mut left, mut right, mut both) = (Vec::new(), Vec::new(), Vec::new());
        let (mut left_box, mut right_box) = (Box4::EMPTY, Box4::EMPTY);
        for item in &part.items {
            let aabb = item.aabb();
            if aabb.max[cut.axis] <= cut.at {
                left_box = left_box.union(aabb);
                left.push(*item);
            } else if aabb.min[cut.axis] >= cut.at {
                right_box = right_box.union(aabb);
                right.push(*item);
            } else {
                both.push(*item);
            }
        }
        if both.len() > part.spare {
            return None;
        }
        let mut doubled = 0;
        let (mut counts, cuts) = ([left.len(), right.len()], both.len());
        counts = [counts[0] + cuts, counts[1] + cuts];
        for item in both {
            let pieces = [
                self.corners.between(&item, cut.axis, f32::NEG_INFINITY, cut.at),
                self.corners.between(&item, cut.axis, cut.at, f32::INFINITY),
            ];
            let [to_left, to_right] = pieces.map(|piece| !piece.is_empty());
            // Costs of both sides with the item cut, or whole on one side.
            let whole = item.aabb();
            let cost = |l: Box4, r: Box4, counts: [usize; 2]| {
                l.half_area() * counts[0] as f32 + r.half_area() * counts[1] as f32
            };
            let split = cost(left_box.union(pieces[0]), right_box.union(pieces[1]), counts);
            let only_left = cost(left_box.union(whole), right_box, [counts[0], counts[1] - 1]);
            let only_right = cost(left_box, right_box.union(whole), [counts[0] - 1, counts[1]]);
            if !to_right || (to_left && only_left <= split && only_left <= only_right) {
                left_box = left_box.union(whole);
                left.push(item);
                counts[1] -= 1;
            } else if !to_left || only_right <= split {
                right_box = right_box.union(whole);
                right.push(item);
                counts[0] -= 1;
            } else {
                left_box = left_box.union(pieces[0]);
                right_box = right_box.union(pieces[1]);
                left.push(item.part(pieces[0]));
                right.push(item.part(pieces[1]));
                doubled += 1;
            }
        }
        if left.is_empty() || right.is_empty() || left.len().max(right.len()) == part.items.len() {
            return None;
        }
        let of_both = [bounds(&left), bounds(&right)];
        Some(sides([left, right], of_both, part.spare - doubled, part.depth))
    }
}

/// Two parts with these bounds; the budget of additional items is divided by their sizes.
fn sides(
    [left, right]: [Vec<Item>; 2],
    [left_bounds, right_bounds]: [(Box4, Box4); 2],
    spare: usize,
    depth: usize,
) -> (Part, Part) {
    let of_left = spare * left.len() / (left.len() + right.len());
    (
        Part::new(left, left_bounds, of_left, depth + 1),
        Part::new(right, right_bounds, spare - of_left, depth + 1),
    )
}
