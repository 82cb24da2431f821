//! The build of the tree.

use super::{AxisCut, Config};
use crate::elements::{Elements, Item, MARGIN};
use crate::partition::{Choice, Cut, Cutter, Partition, cheaper, cost};
use crate::split::{Axes, Split};
use whitstone_core::{Aabb, Geometry};

/// Time of a step down, in units of the time of one test of an element. Measured on triangle meshes: from 0.4 to 1.2
/// rays take the same time, and the tree has half the size.
const STEP_COST: f64 = 1.2;

/// Up to this number of references every end of a box is tried.
const SWEEP: usize = 1024;

/// Bins for each axis, where there are more.
const BINS: usize = 64;

/// An element in a cell.
#[derive(Clone, Copy)]
struct Reference {
    /// Around the part of the element in the cell.
    aabb: Aabb,
    item: u32,
}

struct Builder<'a> {
    geometry: &'a Geometry,
    items: &'a [Item],
    margin: f64,
    max_leaf: usize,
    split: Split,
    axes: Axes,
}

/// Builds over all elements.
pub(super) fn build(geometry: &Geometry, elements: &Elements, config: &Config) -> Partition<AxisCut> {
    let items = &elements.items;
    let builder = Builder {
        geometry,
        items,
        margin: MARGIN * elements.reach,
        max_leaf: config.max_leaf.get() as usize,
        split: config.split,
        axes: config.axes,
    };
    let reference = |(item, number): (&Item, u32)| Reference {
        aabb: item.aabb,
        item: number,
    };
    let references = items.iter().zip(0..).map(reference).collect();
    let max_depth = config.max_depth.map(|depth| depth.get());
    Partition::new(&builder, items, references, max_depth)
}

impl Cutter for Builder<'_> {
    type Cut = AxisCut;
    type Part = Reference;

    const STEP_COST: f64 = STEP_COST;
    const PARALLEL: usize = 4096;

    fn item(reference: &Reference) -> u32 {
        reference.item
    }

    fn is_leaf(&self, count: usize) -> bool {
        !self.asks_cost() && count <= self.max_leaf
    }

    fn asks_cost(&self) -> bool {
        self.split == Split::Sah
    }

    fn choose(&self, references: &[Reference], cell: &Aabb) -> Option<Choice<AxisCut>> {
        let axes = self.axes.of(cell.extent().to_array());
        let cuts = axes.filter_map(|axis| match self.split {
            Split::Sah if references.len() <= SWEEP => sweep(references, cell, axis),
            Split::Sah => binned(references, cell, axis, 1..BINS),
            Split::Midpoint => binned(references, cell, axis, BINS / 2..BINS / 2 + 1),
            Split::Median => median(references, cell, axis),
        });
        cuts.reduce(cheaper)
    }

    fn sides(&self, references: &[Reference], choice: &Choice<AxisCut>) -> Option<[Vec<Reference>; 2]> {
        let (axis, plane) = (choice.cut.axis(), choice.cut.plane);
        let mut sides = [const { Vec::new() }; 2];
        for reference in references {
            let (min, max) = (reference.aabb.min[axis], reference.aabb.max[axis]);
            match (min < plane, max > plane) {
                (true, false) => sides[0].push(*reference),
                (false, true) => sides[1].push(*reference),
                (false, false) => sides[choice.flat_side].push(*reference),
                (true, true) => {
                    for (side, part) in sides.iter_mut().zip(self.parts(reference, &choice.cut)) {
                        side.extend((!part.is_empty()).then_some(Reference {
                            aabb: part,
                            item: reference.item,
                        }));
                    }
                }
            }
        }
        Some(sides)
    }
}

impl Builder<'_> {
    /// Boxes around the parts of an element on both sides of a plane; empty if it is cut off already.
    fn parts(&self, reference: &Reference, cut: &AxisCut) -> [Aabb; 2] {
        let (axis, plane) = (cut.axis(), cut.plane);
        let mut parts = cut.halves(&reference.aabb);
        let Some(corners) = self.items[reference.item as usize].corners(self.geometry) else {
            return parts;
        };
        let mut tight = [Aabb::EMPTY; 2];
        for i in 0..3 {
            let (a, b) = (corners[i], corners[(i + 1) % 3]);
            if a[axis] <= plane {
                tight[0] = tight[0].including(a);
            }
            if a[axis] >= plane {
                tight[1] = tight[1].including(a);
            }
            if (a[axis] < plane) != (b[axis] < plane) {
                let point = a.lerp(b, (plane - a[axis]) / (b[axis] - a[axis]));
                tight = tight.map(|aabb| aabb.including(point));
            }
        }
        for (part, tight) in parts.iter_mut().zip(tight) {
            let tight = tight.padded(self.margin);
            part.min = part.min.max(tight.min);
            part.max = part.max.min(tight.max);
        }
        parts
    }
}

/// Costs of cuts of one cell along one axis.
struct Costs {
    cell: Aabb,
    axis: usize,
}

impl Costs {
    /// A cut with so many elements that are partly below, in the plane, and partly above; `None` if the plane
    /// is not inside.
    fn cut(&self, plane: f64, below: usize, flat: usize, above: usize) -> Option<Choice<AxisCut>> {
        let axis = self.axis;
        if !(self.cell.min[axis] < plane && plane < self.cell.max[axis]) {
            return None;
        }
        let cut = AxisCut::new(axis, plane);
        let areas = cut.halves(&self.cell).map(|half| half.half_area());
        let costs = [[below + flat, above], [below, above + flat]].map(|counts| cost(areas, counts));
        let flat_side = usize::from(costs[1] < costs[0]);
        Some(Choice {
            cut,
            flat_side,
            cost: costs[flat_side],
        })
    }
}

/// The cheapest of all cuts that there are.
fn keep(best: &mut Option<Choice<AxisCut>>, cut: Option<Choice<AxisCut>>) {
    *best = best.take().into_iter().chain(cut).reduce(cheaper);
}

/// The best cut at an end of any box: the ends pass by in order, and the numbers on both sides are counted.
fn sweep(references: &[Reference], cell: &Aabb, axis: usize) -> Option<Choice<AxisCut>> {
    /// In the order in which they count at the same place.
    #[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
    enum Kind {
        Ends,
        Flat,
        Begins,
    }
    let mut events = Vec::with_capacity(2 * references.len());
    for Reference { aabb, .. } in references {
        let (min, max) = (aabb.min[axis], aabb.max[axis]);
        if min == max {
            events.push((min, Kind::Flat));
        } else {
            events.extend([(min, Kind::Begins), (max, Kind::Ends)]);
        }
    }
    events.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    let costs = Costs { cell: *cell, axis };
    let (mut below, mut above) = (0, references.len());
    let mut best = None;
    for at_place in events.chunk_by(|a, b| a.0 == b.0) {
        let count = |kind| at_place.iter().filter(|event| event.1 == kind).count();
        let (ends, flat, begins) = (count(Kind::Ends), count(Kind::Flat), count(Kind::Begins));
        above -= ends + flat;
        keep(&mut best, costs.cut(at_place[0].0, below, flat, above));
        below += begins + flat;
    }
    best
}

/// The best cut at a border before some of the bins, which divide the cell evenly: for each bin, how many
/// boxes begin and how many end in it.
fn binned(
    references: &[Reference],
    cell: &Aabb,
    axis: usize,
    before: std::ops::Range<usize>,
) -> Option<Choice<AxisCut>> {
    let (start, extent) = (cell.min[axis], cell.max[axis] - cell.min[axis]);
    let scale = BINS as f64 / extent;
    if !scale.is_finite() {
        return None;
    }
    // The conversion saturates, so that whatever rounding does the bin is one of them.
    let bin = |x: f64| (((x - start) * scale) as usize).min(BINS - 1);
    let (mut begin, mut end) = ([0; BINS], [0; BINS]);
    for Reference { aabb, .. } in references {
        begin[bin(aabb.min[axis])] += 1;
        end[bin(aabb.max[axis])] += 1;
    }
    let costs = Costs { cell: *cell, axis };
    let (mut below, mut above) = (0, references.len());
    let mut best = None;
    for i in 1..BINS {
        below += begin[i - 1];
        above -= end[i - 1];
        if before.contains(&i) {
            let plane = start + extent * (i as f64 / BINS as f64);
            // What lies in the border is in the bin above it.
            let cut = costs.cut(plane, below, 0, above);
            keep(&mut best, cut.map(|cut| Choice { flat_side: 1, ..cut }));
        }
    }
    best
}

/// The cut that has as many centers below as above.
fn median(references: &[Reference], cell: &Aabb, axis: usize) -> Option<Choice<AxisCut>> {
    let mut centers: Vec<f64> = references.iter().map(|r| r.aabb.center()[axis]).collect();
    let middle = centers.len() / 2;
    let (_, &mut plane, _) = centers.select_nth_unstable_by(middle, f64::total_cmp);
    let below = references.iter().filter(|r| r.aabb.min[axis] < plane).count();
    let above = references.iter().filter(|r| r.aabb.max[axis] > plane).count();
    let flat = |r: &&Reference| r.aabb.min[axis] == plane && r.aabb.max[axis] == plane;
    let flat = references.iter().filter(flat).count();
    Costs { cell: *cell, axis }.cut(plane, below, flat, above)
}
