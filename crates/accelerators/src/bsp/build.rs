//! The build of the tree.

use super::{Bsp, Config, MAX_DEPTH, Node};
use crate::elements::{Elements, Item, MARGIN, bounds};
use crate::polyhedron::{Plane, Polyhedron, cut_polygon};
use crate::principal::{COORDINATE_AXES, principal_axes};
use crate::split::Split;
use whitstone_core::{Aabb, DVec3, Geometry};

/// Time of a step down, in units of the time of one test of an element: measured on triangle meshes.
const STEP_COST: f64 = 1.6;

/// What a cut counts if one side is empty.
const EMPTY_BONUS: f64 = 0.8;

/// Most references to an element, on average.
const MOST_REFERENCES: usize = 8;

/// Axis-parallel planes that are tried along each axis between the two that bound what is in the cell.
const STRAIGHT: usize = 6;

/// Up to this number of elements the planes of triangles are tried.
const FEW: usize = 64;

/// Planes of so many triangles.
const ASKEW: usize = 4;

/// From this number of elements on both sides are built in parallel.
const PARALLEL: usize = 1024;

/// An element, or the part of it in a cell.
struct Fragment {
    /// Corners of the polygon, or of a box.
    points: Vec<DVec3>,
    /// Whether the points are those of a polygon, which can be cut.
    polygon: bool,
    item: u32,
}

impl Fragment {
    /// Smallest and largest height above a plane.
    fn heights(&self, plane: &Plane) -> (f64, f64) {
        let heights = self.points.iter().map(|&point| plane.height(point));
        heights.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), height| {
            (low.min(height), high.max(height))
        })
    }
}

enum Tree {
    Leaf {
        held: Vec<u32>,
        half_area: f64,
    },
    Inner {
        plane: Plane,
        half_area: f64,
        children: Box<[Tree; 2]>,
    },
}

/// A plane, and what it costs: area times number, both sides.
struct Cut {
    plane: Plane,
    cost: f64,
}

struct Builder {
    margin: f64,
    max_leaf: usize,
    split: Split,
}

/// Builds over all elements. The result depends on the geometry only, not on the number of threads.
pub(super) fn build(geometry: &Geometry, elements: &Elements, config: &Config) -> Bsp {
    let items = &elements.items;
    let builder = Builder {
        // Below the margin of a cut by a box, as what is lost here is not added there.
        margin: 0.125 * MARGIN * elements.reach,
        max_leaf: config.max_leaf.get() as usize,
        split: config.split,
    };
    let fragment = |(item, number): (&Item, u32)| Fragment {
        points: item.hull(geometry).collect(),
        polygon: item.corners(geometry).is_some(),
        item: number,
    };
    let fragments = items.iter().zip(0..).map(fragment).collect();
    let usual = 8.0 + 1.3 * (items.len().max(1) as f64).log2();
    let levels = config
        .max_depth
        .map_or(usual as usize, |depth| depth.get() as usize);
    let bounds = bounds(items);
    let spare = (MOST_REFERENCES - 1) * items.len();
    let cell = Polyhedron::of_box(&bounds);
    let area = cell.half_area();
    let tree = builder.tree(fragments, cell, levels.min(MAX_DEPTH), spare);
    let mut built = Bsp {
        bounds,
        nodes: vec![Node::Leaf { first: 0, count: 0 }],
        references: Vec::new(),
        elements: items.iter().map(|item| item.element).collect(),
        depth: 0,
        sah_cost: 0.0,
    };
    built.flatten(&tree, 0, 0);
    // Relative to the chance of hitting the whole; a flat point has none.
    built.sah_cost /= area.max(f64::MIN_POSITIVE);
    built
}

impl Bsp {
    /// Puts a subtree at a place among the nodes, and what is below it behind all others.
    fn flatten(&mut self, tree: &Tree, place: usize, depth: usize) {
        self.depth = self.depth.max(depth);
        self.nodes[place] = match tree {
            Tree::Leaf { held, half_area } => {
                self.sah_cost += half_area * held.len() as f64;
                let first = self.references.len() as u32;
                self.references.extend(held);
                Node::Leaf {
                    first,
                    count: held.len() as u32,
                }
            }
            Tree::Inner {
                plane,
                half_area,
                children,
            } => {
                self.sah_cost += half_area * STEP_COST;
                let next = self.nodes.len();
                self.nodes.extend([Node::Leaf { first: 0, count: 0 }; 2]);
                for (side, child) in children.iter().enumerate() {
                    self.flatten(child, next + side, depth + 1);
                }
                Node::Inner {
                    plane: *plane,
                    children: next as u32,
                }
            }
        };
    }
}

impl Builder {
    /// Builds over a cell, at most so many levels and with so many references more than it has now.
    fn tree(&self, fragments: Vec<Fragment>, cell: Polyhedron, levels: usize, spare: usize) -> Tree {
        let (n, half_area) = (fragments.len(), cell.half_area());
        let leaf = |fragments: &[Fragment]| Tree::Leaf {
            held: fragments.iter().map(|fragment| fragment.item).collect(),
            half_area,
        };
        if levels == 0 || n <= self.max_leaf {
            return leaf(&fragments);
        }
        let Some(Cut { plane, cost }) = self.choose(&fragments, &cell) else {
            return leaf(&fragments);
        };
        if self.split == Split::Sah && STEP_COST * half_area + cost >= n as f64 * half_area {
            return leaf(&fragments);
        }
        let sides = self.sides(&fragments, &plane);
        let counts = [sides[0].len(), sides[1].len()];
        let more = (counts[0] + counts[1]).saturating_sub(n);
        // Other than by cost, an empty side is no progress.
        let useless = self.split != Split::Sah && counts.contains(&0);
        if more > spare || useless {
            return leaf(&fragments);
        }
        drop(fragments);
        // What may still be added is shared out by size.
        let below_spare = (spare - more) * counts[0] / (n + more).max(1);
        let above_spare = spare - more - below_spare;
        let ([below, above], [below_cell, above_cell]) = (sides, cell.cut(&plane));
        let build_below = move || self.tree(below, below_cell, levels - 1, below_spare);
        let build_above = move || self.tree(above, above_cell, levels - 1, above_spare);
        let (below, above) = if n >= PARALLEL {
            rayon::join(build_below, build_above)
        } else {
            (build_below(), build_above())
        };
        Tree::Inner {
            plane,
            half_area,
            children: Box::new([below, above]),
        }
    }

    /// What lies on each side of a plane. What lies in it is on the side of fewer.
    fn sides(&self, fragments: &[Fragment], plane: &Plane) -> [Vec<Fragment>; 2] {
        let mut sides = [const { Vec::new() }; 2];
        let mut flat = Vec::new();
        let copy = |fragment: &Fragment, points: Vec<DVec3>| Fragment { points, ..*fragment };
        for fragment in fragments {
            let (low, high) = fragment.heights(plane);
            match (low < -self.margin, high > self.margin) {
                (true, false) => sides[0].push(copy(fragment, fragment.points.clone())),
                (false, true) => sides[1].push(copy(fragment, fragment.points.clone())),
                (false, false) => flat.push(copy(fragment, fragment.points.clone())),
                (true, true) if fragment.polygon => {
                    let parts = cut_polygon(&fragment.points, plane, self.margin);
                    for (side, part) in sides.iter_mut().zip(parts) {
                        side.push(copy(fragment, part));
                    }
                }
                (true, true) => {
                    for side in &mut sides {
                        side.push(copy(fragment, fragment.points.clone()));
                    }
                }
            }
        }
        let fewer = usize::from(sides[1].len() < sides[0].len());
        sides[fewer].extend(flat);
        sides
    }

    fn choose(&self, fragments: &[Fragment], cell: &Polyhedron) -> Option<Cut> {
        let points = || fragments.iter().flat_map(|fragment| &fragment.points).copied();
        if self.split != Split::Sah {
            let normal = principal_axes(&points().collect::<Vec<_>>())[0];
            let ground = Plane { normal, at: 0.0 };
            let mut middles: Vec<f64> = fragments
                .iter()
                .map(|fragment| fragment.heights(&ground))
                .map(|(low, high)| 0.5 * low + 0.5 * high)
                .collect();
            let at = if self.split == Split::Median {
                let half = middles.len() / 2;
                *middles.select_nth_unstable_by(half, f64::total_cmp).1
            } else {
                let low = middles.iter().copied().fold(f64::INFINITY, f64::min);
                let high = middles.iter().copied().fold(f64::NEG_INFINITY, f64::max);
                0.5 * low + 0.5 * high
            };
            let plane = Plane { normal, at };
            return Some(Cut { plane, cost: 0.0 });
        }
        let held = Aabb::around(points());
        let straight = (0..3).flat_map(|axis| {
            let (low, extent) = (held.min[axis], held.extent()[axis]);
            (0..=STRAIGHT).map(move |i| Plane {
                normal: COORDINATE_AXES[axis],
                at: if i == STRAIGHT {
                    held.max[axis]
                } else {
                    low + extent * (i as f64 / STRAIGHT as f64)
                },
            })
        });
        let few = if fragments.len() <= FEW { fragments } else { &[] };
        let stride = few.len().div_ceil(ASKEW).max(1);
        let askew = few.iter().step_by(stride).filter_map(plane_of);
        let half_area = cell.half_area();
        let mut best: Option<Cut> = None;
        for plane in straight.chain(askew) {
            let limit = best.as_ref().map_or(f64::INFINITY, |best| best.cost);
            if let Some(cost) = self.cost(fragments, cell, half_area, &plane, limit)
                && cost < limit
            {
                best = Some(Cut { plane, cost });
            }
        }
        best
    }

    /// The cost of a cut; `None` if it is not below a limit for sure, or does not go through the cell.
    fn cost(
        &self,
        fragments: &[Fragment],
        cell: &Polyhedron,
        half_area: f64,
        plane: &Plane,
        limit: f64,
    ) -> Option<f64> {
        let (mut below, mut above, mut flat) = (0, 0, 0);
        for fragment in fragments {
            let (low, high) = fragment.heights(plane);
            let (is_below, is_above) = (low < -self.margin, high > self.margin);
            below += usize::from(is_below);
            above += usize::from(is_above);
            flat += usize::from(!is_below && !is_above);
        }
        *(if above < below { &mut above } else { &mut below }) += flat;
        let bonus = if below == 0 || above == 0 {
            EMPTY_BONUS
        } else {
            1.0
        };
        // The areas of the parts are together at least that of the whole: so much can be said without them.
        if bonus * half_area * below.min(above) as f64 >= limit {
            return None;
        }
        if !cell.is_on_both_sides(plane, self.margin) {
            return None;
        }
        let [below_area, above_area] = cell.cut(plane).map(|part| part.half_area());
        Some(bonus * (below_area * below as f64 + above_area * above as f64))
    }
}

/// The plane of a triangle or a part of it.
fn plane_of(fragment: &Fragment) -> Option<Plane> {
    let [a, b, c] = *fragment.points.first_chunk()?;
    let normal = (b - a).cross(c - a).try_normalize()?;
    fragment.polygon.then(|| Plane {
        normal,
        at: normal.dot(a),
    })
}
