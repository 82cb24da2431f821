//! The build of the tree.

use super::{Config, KdTree, Node};
use crate::elements::{Elements, Item, MARGIN, bounds};
use crate::split::{Axes, Split};
use whitstone_core::{Aabb, Element, Geometry};

/// Time of a step down, in units of the time of one test of an element. Measured on triangle meshes: from 0.4 to 1.2
/// rays take the same time, and the tree has half the size.
const STEP_COST: f64 = 1.2;

/// What a cut counts if one side is empty.
const EMPTY_BONUS: f64 = 0.8;

/// Most references to an element, on average.
const MOST_REFERENCES: usize = 8;

/// Up to this number of references every end of a box is tried.
const SWEEP: usize = 1024;

/// Bins for each axis, where there are more.
const BINS: usize = 64;

/// From this number of references on both sides are built in parallel.
const PARALLEL: usize = 4096;

/// An element in a cell.
#[derive(Clone, Copy)]
struct Reference {
    /// Around the part of the element in the cell.
    aabb: Aabb,
    item: u32,
}

enum Tree {
    Leaf(Vec<Reference>),
    Inner { cut: Cut, children: Box<[Tree; 2]> },
}

/// A plane, and what it costs: area times number, both sides.
#[derive(Clone, Copy)]
struct Cut {
    axis: usize,
    plane: f64,
    /// Where elements go that lie in the plane: 0 below, 1 above.
    flat_side: usize,
    cost: f64,
}

struct Builder<'a> {
    geometry: &'a Geometry,
    items: &'a [Item],
    margin: f64,
    max_leaf: usize,
    split: Split,
    axes: Axes,
}

/// Builds over all elements. The result depends on the geometry only, not on the number of threads.
pub(super) fn build(geometry: &Geometry, elements: &Elements, config: &Config) -> KdTree {
    let items = &elements.items;
    let mut built = KdTree {
        bounds: bounds(items),
        nodes: vec![Node::Leaf { first: 0, count: 0 }],
        references: Vec::new(),
        elements: items.iter().map(|item| item.element).collect::<Vec<Element>>(),
        depth: 0,
        sah_cost: 0.0,
    };
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
    let usual = 8.0 + 1.3 * (items.len().max(1) as f64).log2();
    let levels = config
        .max_depth
        .map_or(usual as usize, |depth| depth.get() as usize);
    let spare = (MOST_REFERENCES - 1) * items.len();
    let tree = builder.tree(references, built.bounds, levels.min(super::MAX_DEPTH), spare);
    let area = built.bounds.half_area().max(f64::MIN_POSITIVE);
    built.flatten(&tree, 0, built.bounds, 0);
    // Relative to the chance of hitting the whole; a flat point has none.
    built.sah_cost /= area;
    built
}

impl KdTree {
    /// Puts a subtree at a place among the nodes, and what is below it behind all others.
    fn flatten(&mut self, tree: &Tree, place: usize, cell: Aabb, depth: usize) {
        self.depth = self.depth.max(depth);
        self.nodes[place] = match tree {
            Tree::Leaf(references) => {
                self.sah_cost += cell.half_area() * references.len() as f64;
                let first = self.references.len() as u32;
                self.references.extend(references.iter().map(|r| r.item));
                Node::Leaf {
                    first,
                    count: references.len() as u32,
                }
            }
            Tree::Inner { cut, children } => {
                self.sah_cost += cell.half_area() * STEP_COST;
                let next = self.nodes.len();
                self.nodes.extend([Node::Leaf { first: 0, count: 0 }; 2]);
                let cells = halves(&cell, cut.axis, cut.plane);
                for side in 0..2 {
                    self.flatten(&children[side], next + side, cells[side], depth + 1);
                }
                Node::Inner {
                    axis: cut.axis as u8,
                    children: next as u32,
                    plane: cut.plane,
                }
            }
        };
    }
}

/// The parts of a box below and above a plane.
fn halves(cell: &Aabb, axis: usize, plane: f64) -> [Aabb; 2] {
    let mut halves = [*cell; 2];
    halves[0].max[axis] = plane;
    halves[1].min[axis] = plane;
    halves
}

impl Builder<'_> {
    /// Builds over a cell, at most so many levels and with so many references more than it has now.
    fn tree(&self, references: Vec<Reference>, cell: Aabb, levels: usize, spare: usize) -> Tree {
        let n = references.len();
        if levels == 0 || n == 0 || (self.split != Split::Sah && n <= self.max_leaf) {
            return Tree::Leaf(references);
        }
        let Some(cut) = self.choose(&references, &cell) else {
            return Tree::Leaf(references);
        };
        let area = cell.half_area();
        if self.split == Split::Sah && STEP_COST * area + cut.cost >= n as f64 * area {
            return Tree::Leaf(references);
        }
        let [below, above] = self.sides(&references, &cut);
        let more = (below.len() + above.len()).saturating_sub(n);
        if more > spare {
            return Tree::Leaf(references);
        }
        drop(references);
        let (n_below, n_above) = (below.len(), above.len());
        // What may still be added is shared out by size.
        let spare_below = (spare - more) * n_below / (n_below + n_above).max(1);
        let spares = [spare_below, spare - more - spare_below];
        let cells = halves(&cell, cut.axis, cut.plane);
        let build_below = move || self.tree(below, cells[0], levels - 1, spares[0]);
        let build_above = move || self.tree(above, cells[1], levels - 1, spares[1]);
        let (below, above) = if n >= PARALLEL {
            rayon::join(build_below, build_above)
        } else {
            (build_below(), build_above())
        };
        Tree::Inner {
            cut,
            children: Box::new([below, above]),
        }
    }

    /// What lies on each side of a plane.
    fn sides(&self, references: &[Reference], cut: &Cut) -> [Vec<Reference>; 2] {
        let mut sides = [Vec::new(), Vec::new()];
        for reference in references {
            let (min, max) = (reference.aabb.min[cut.axis], reference.aabb.max[cut.axis]);
            match (min < cut.plane, max > cut.plane) {
                (true, false) => sides[0].push(*reference),
                (false, true) => sides[1].push(*reference),
                (false, false) => sides[cut.flat_side].push(*reference),
                (true, true) => {
                    for (side, part) in sides.iter_mut().zip(self.parts(reference, cut)) {
                        side.extend((!part.is_empty()).then_some(Reference {
                            aabb: part,
                            item: reference.item,
                        }));
                    }
                }
            }
        }
        sides
    }

    /// Boxes around the parts of an element on both sides of a plane; empty if it is cut off already.
    fn parts(&self, reference: &Reference, cut: &Cut) -> [Aabb; 2] {
        let Cut { axis, plane, .. } = *cut;
        let mut parts = halves(&reference.aabb, axis, plane);
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

    /// The best plane inside a cell; `None` if there is none.
    fn choose(&self, references: &[Reference], cell: &Aabb) -> Option<Cut> {
        let axes = self.axes.of(cell.extent().to_array());
        let cuts = axes.filter_map(|axis| match self.split {
            Split::Sah if references.len() <= SWEEP => sweep(references, cell, axis),
            Split::Sah => binned(references, cell, axis, 1..BINS),
            Split::Midpoint => binned(references, cell, axis, BINS / 2..BINS / 2 + 1),
            Split::Median => median(references, cell, axis),
        });
        cuts.reduce(|best, cut| if cut.cost < best.cost { cut } else { best })
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
    fn cut(&self, plane: f64, below: usize, flat: usize, above: usize) -> Option<Cut> {
        let axis = self.axis;
        if !(self.cell.min[axis] < plane && plane < self.cell.max[axis]) {
            return None;
        }
        let areas = halves(&self.cell, axis, plane).map(|half| half.half_area());
        let costs = [(below + flat, above), (below, above + flat)].map(|(below, above)| {
            let cost = areas[0] * below as f64 + areas[1] * above as f64;
            let bonus = if below == 0 || above == 0 {
                EMPTY_BONUS
            } else {
                1.0
            };
            cost * bonus
        });
        let flat_side = usize::from(costs[1] < costs[0]);
        Some(Cut {
            axis,
            plane,
            flat_side,
            cost: costs[flat_side],
        })
    }
}

fn cheaper(best: Option<Cut>, cut: Option<Cut>) -> Option<Cut> {
    match (best, cut) {
        (Some(best), Some(cut)) => Some(if cut.cost < best.cost { cut } else { best }),
        (best, cut) => best.or(cut),
    }
}

/// The best cut at an end of any box: the ends pass by in order, and the numbers on both sides are counted.
fn sweep(references: &[Reference], cell: &Aabb, axis: usize) -> Option<Cut> {
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
        best = cheaper(best, costs.cut(at_place[0].0, below, flat, above));
        below += begins + flat;
    }
    best
}

/// The best cut at a border before some of the bins, which divide the cell evenly: for each bin, how many
/// boxes begin and how many end in it.
fn binned(references: &[Reference], cell: &Aabb, axis: usize, before: std::ops::Range<usize>) -> Option<Cut> {
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
            best = cheaper(best, cut.map(|cut| Cut { flat_side: 1, ..cut }));
        }
    }
    best
}

/// The cut that has as many centers below as above.
fn median(references: &[Reference], cell: &Aabb, axis: usize) -> Option<Cut> {
    let mut centers: Vec<f64> = references.iter().map(|r| r.aabb.center()[axis]).collect();
    let middle = centers.len() / 2;
    let (_, &mut plane, _) = centers.select_nth_unstable_by(middle, f64::total_cmp);
    let below = references.iter().filter(|r| r.aabb.min[axis] < plane).count();
    let above = references.iter().filter(|r| r.aabb.max[axis] > plane).count();
    let flat = |r: &&Reference| r.aabb.min[axis] == plane && r.aabb.max[axis] == plane;
    let flat = references.iter().filter(flat).count();
    Costs { cell: *cell, axis }.cut(plane, below, flat, above)
}
