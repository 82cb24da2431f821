//! Build of the tree.

use super::Config;
use crate::support::leaves::child::WIDTH;
use crate::support::leaves::items::{Box4, Corners, Item};
use crate::support::partition::{Choice, Cut, Cutter, Tree, cheaper, cost};
use crate::support::split::{Axes, Split};

/// Cost of a traversal step, in units of a leaf of up to eight elements. Measured on triangle
/// meshes: rays take the same time for 1 to 1.6; below 1, the tree grows and they take longer.
const STEP_COST: f64 = 1.4;

/// Cost of an element of a cell that will be cut further.
const ELEMENT_COST: f64 = 0.2;

/// Up to this number of references, every end of a box is tried.
const SWEEP: usize = 1024;

/// Bins per axis for larger cells.
const BINS: usize = 64;

/// A plane perpendicular to an axis.
#[derive(Clone, Copy, Debug)]
pub(super) struct AxisCut {
    pub(super) axis: usize,
    pub(super) plane: f32,
}

impl Cut for AxisCut {
    type Cell = Box4;

    fn half_area(cell: &Box4) -> f64 {
        f64::from(cell.half_area())
    }

    fn halves(&self, cell: &Box4) -> [Box4; 2] {
        let mut halves = [*cell; 2];
        halves[0].max[self.axis] = self.plane;
        halves[1].min[self.axis] = self.plane;
        halves
    }
}

struct Builder {
    corners: Corners,
    max_leaf: usize,
    split: Split,
    axes: Axes,
}

/// Builds the tree over all items in a cell.
pub(super) fn build(items: Vec<Item>, corners: Corners, cell: Box4, config: &Config) -> Tree<AxisCut> {
    let builder = Builder {
        corners,
        max_leaf: config.max_leaf.get() as usize,
        split: config.split,
        axes: config.axes,
    };
    Tree::new(&builder, items, cell, config.max_depth.map(|depth| depth.get()))
}

impl Cutter for Builder {
    type Cut = AxisCut;
    type Part = Item;

    const STEP_COST: f64 = STEP_COST;
    const MAX_REFERENCES: usize = 4;
    const PARALLEL: usize = 4096;

    fn item(item: &Item) -> u32 {
        item.number()
    }

    fn is_leaf(&self, count: usize) -> bool {
        !self.asks_cost() && count <= self.max_leaf
    }

    fn asks_cost(&self) -> bool {
        self.split.asks_cost()
    }

    fn leaf_cost(count: usize) -> f64 {
        count.div_ceil(WIDTH) as f64
    }

    fn is_hopeless(&self, count: usize, half_area: f64, choice: &Choice<AxisCut>) -> bool {
        STEP_COST * half_area + ELEMENT_COST * choice.cost >= ELEMENT_COST * count as f64 * half_area
    }

    fn choose(&self, items: &[Item], cell: &Box4) -> Option<Choice<AxisCut>> {
        let extent = (cell.max - cell.min).truncate();
        let axes = self.axes.of(extent.as_dvec3().to_array());
        let cuts = axes.filter_map(|axis| match self.split {
            Split::Sah | Split::Between if items.len() <= SWEEP => sweep(items, cell, axis, self.split),
            Split::Sah | Split::Between | Split::Midpoint => binned(items, cell, axis, self.split),
            Split::Median => median(items, cell, axis),
        });
        cuts.reduce(cheaper)
    }

    fn sides(&self, items: &[Item], choice: &Choice<AxisCut>) -> Option<[Vec<Item>; 2]> {
        let AxisCut { axis, plane } = choice.cut;
        let mut sides = [const { Vec::new() }; 2];
        for item in items {
            let (min, max) = (item.aabb().min[axis], item.aabb().max[axis]);
            match (min < plane, max > plane) {
                (true, false) => sides[0].push(*item),
                (false, true) => sides[1].push(*item),
                (false, false) => sides[choice.flat_side].push(*item),
                (true, true) => {
                    let below = self.corners.between(item, axis, f32::NEG_INFINITY, plane);
                    let above = self.corners.between(item, axis, plane, f32::INFINITY);
                    for (side, part) in sides.iter_mut().zip([below, above]) {
                        side.extend((!part.is_empty()).then(|| item.part(part)));
                    }
                }
            }
        }
        Some(sides)
    }
}

/// Costs of cuts of one cell along one axis.
struct Costs {
    cell: Box4,
    axis: usize,
}

impl Costs {
    /// A cut with these numbers of elements that are partly below, in, and partly above the plane;
    /// `None` if the plane does not pass through the cell's interior.
    fn cut(&self, plane: f32, below: usize, flat: usize, above: usize) -> Option<Choice<AxisCut>> {
        let axis = self.axis;
        if !(self.cell.min[axis] < plane && plane < self.cell.max[axis]) {
            return None;
        }
        let cut = AxisCut { axis, plane };
        let areas = cut.halves(&self.cell).map(|half| AxisCut::half_area(&half));
        let costs = [[below + flat, above], [below, above + flat]].map(|counts| cost(areas, counts));
        let flat_side = usize::from(costs[1] < costs[0]);
        Some(Choice {
            cut,
            flat_side,
            cost: costs[flat_side],
        })
    }
}

/// Keeps the cheaper of the best cut so far and another cut, as far as these exist.
fn keep(best: &mut Option<Choice<AxisCut>>, cut: Option<Choice<AxisCut>>) {
    *best = best.take().into_iter().chain(cut).reduce(cheaper);
}

/// The best cut at an end of any box; with `Split::Between` of those between the median of the ends
/// and the midpoint of the cell, and at the midpoint itself. The ends are swept in order, and the
/// elements on both sides are counted.
fn sweep(items: &[Item], cell: &Box4, axis: usize, split: Split) -> Option<Choice<AxisCut>> {
    /// Kinds of box ends, in the order in which they count at the same coordinate.
    #[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
    enum Kind {
        Ends,
        Flat,
        Begins,
        /// No end: the midpoint of the cell.
        Midpoint,
    }
    let mut events = Vec::with_capacity(2 * items.len());
    for item in items {
        let aabb = item.aabb();
        let (min, max) = (aabb.min[axis], aabb.max[axis]);
        if min == max {
            events.push((min, Kind::Flat));
        } else {
            events.extend([(min, Kind::Begins), (max, Kind::Ends)]);
        }
    }
    let order = |a: &(f32, Kind), b: &(f32, Kind)| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1));
    events.sort_unstable_by(order);
    let mut tried = [f32::NEG_INFINITY, f32::INFINITY];
    if split == Split::Between {
        let median = events[events.len() / 2].0;
        let midpoint = 0.5 * cell.min[axis] + 0.5 * cell.max[axis];
        tried = [median.min(midpoint), median.max(midpoint)];
        events.push((midpoint, Kind::Midpoint));
        events.sort_unstable_by(order);
    }
    let costs = Costs { cell: *cell, axis };
    let (mut below, mut above) = (0, items.len());
    let mut best = None;
    for at_place in events.chunk_by(|a, b| a.0 == b.0) {
        let count = |kind| at_place.iter().filter(|event| event.1 == kind).count();
        let (ends, flat, begins) = (count(Kind::Ends), count(Kind::Flat), count(Kind::Begins));
        above -= ends + flat;
        let plane = at_place[0].0;
        if tried[0] <= plane && plane <= tried[1] {
            keep(&mut best, costs.cut(plane, below, flat, above));
        }
        below += begins + flat;
    }
    best
}

/// The best cut at a lower border of a bin that `split` tries. The bins divide the cell evenly and
/// count how many boxes begin and how many end in them.
fn binned(items: &[Item], cell: &Box4, axis: usize, split: Split) -> Option<Choice<AxisCut>> {
    let (start, extent) = (cell.min[axis], cell.max[axis] - cell.min[axis]);
    let scale = BINS as f32 / extent;
    if !scale.is_finite() {
        return None;
    }
    // The conversion saturates, so rounding cannot yield a bin out of range.
    let bin = |x: f32| (((x - start) * scale) as usize).min(BINS - 1);
    let (mut begin, mut end) = ([0; BINS], [0; BINS]);
    for item in items {
        let aabb = item.aabb();
        begin[bin(aabb.min[axis])] += 1;
        end[bin(aabb.max[axis])] += 1;
    }
    let mut ends = 0;
    let median = (0..BINS).find(|&i| {
        ends += begin[i] + end[i];
        ends > items.len()
    });
    let before = split.borders(BINS, median.unwrap_or(BINS - 1));
    let costs = Costs { cell: *cell, axis };
    let (mut below, mut above) = (0, items.len());
    let mut best = None;
    for i in 1..BINS {
        below += begin[i - 1];
        above -= end[i - 1];
        if before.contains(&i) {
            let plane = start + extent * (i as f32 / BINS as f32);
            // An element in the border is in the bin above it.
            let cut = costs.cut(plane, below, 0, above);
            keep(&mut best, cut.map(|cut| Choice { flat_side: 1, ..cut }));
        }
    }
    best
}

/// The cut with as many centers below as above.
fn median(items: &[Item], cell: &Box4, axis: usize) -> Option<Choice<AxisCut>> {
    let mut centers: Vec<f32> = items.iter().map(|r| 0.5 * r.center()[axis]).collect();
    let middle = centers.len() / 2;
    let (_, &mut plane, _) = centers.select_nth_unstable_by(middle, f32::total_cmp);
    let below = items.iter().filter(|r| r.aabb().min[axis] < plane).count();
    let above = items.iter().filter(|r| r.aabb().max[axis] > plane).count();
    let flat = |r: &&Item| r.aabb().min[axis] == plane && r.aabb().max[axis] == plane;
    let flat = items.iter().filter(flat).count();
    Costs { cell: *cell, axis }.cut(plane, below, flat, above)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::support::leaves::items::Items;
    use whitstone_core::{DVec3, Geometry, LoweredShape, TriangleMesh};
    use whitstone_testkit::Random;

    #[test]
    fn the_best_end_between_the_median_and_the_midpoint_is_chosen() {
        let mut random = Random::new(32);
        let mut dearer = 0;
        for count in 1..60 {
            let mut mesh = TriangleMesh {
                orientation: 1.0,
                ..TriangleMesh::default()
            };
            for i in 0..count {
                // They crowd towards the origin.
                let at = DVec3::from_array([(); 3].map(|()| random.unit().powi(4)));
                mesh.positions.extend([(); 3].map(|()| at + 0.02 * random.cube()));
                mesh.triangles.push([3 * i, 3 * i + 1, 3 * i + 2]);
            }
            let geometry = Geometry::new(vec![LoweredShape::Triangles(mesh)]);
            let items = Items::new(&geometry);
            let items = items.each(|number| items.item(number));
            let cell = items
                .iter()
                .fold(Box4::EMPTY, |cell, item| cell.union(item.aabb()));
            for axis in 0..3 {
                let side = |of: fn(&Box4, usize) -> f32| items.iter().map(move |item| of(&item.aabb(), axis));
                let mut ends: Vec<f32> = side(|aabb, axis| aabb.min[axis])
                    .chain(side(|aabb, axis| aabb.max[axis]))
                    .collect();
                ends.sort_by(f32::total_cmp);
                let median = ends[ends.len() / 2];
                let middle = 0.5 * cell.min[axis] + 0.5 * cell.max[axis];
                let costs = Costs { cell, axis };
                let cost = |plane: f32| {
                    let below = items.iter().filter(|item| item.aabb().min[axis] < plane).count();
                    let above = items.iter().filter(|item| item.aabb().max[axis] > plane).count();
                    costs.cut(plane, below, 0, above).map(|cut| cut.cost)
                };
                let planes = ends.iter().copied().chain([middle]);
                let between =
                    planes.filter(|plane| median.min(middle) <= *plane && *plane <= median.max(middle));
                let best = between.filter_map(cost).reduce(f64::min);
                let found = sweep(&items, &cell, axis, Split::Between).map(|cut| cut.cost);
                assert_eq!(found, best, "{count} triangles");
                let sah = sweep(&items, &cell, axis, Split::Sah).map(|cut| cut.cost);
                dearer += u32::from(sah < found);
                let midpoint = binned(&items, &cell, axis, Split::Midpoint).map(|cut| cut.cost);
                let coarse = binned(&items, &cell, axis, Split::Between).map(|cut| cut.cost);
                assert!(midpoint.is_none() || coarse <= midpoint, "{count} triangles");
            }
        }
        assert!(
            dearer > 0,
            "the range must exclude some of the best ends: {dearer}"
        );
    }
}
