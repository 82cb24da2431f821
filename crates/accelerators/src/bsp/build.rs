//! Build of the tree.

use super::Config;
use super::tree::Partition;
use crate::support::elements::{Elements, Item, MARGIN, bounds};
use crate::support::partition::{Choice, Cutter, Tree, bonus, cheaper, cost};
use crate::support::polyhedron::{Plane, Polyhedron, cut_polygon};
use crate::support::principal::{COORDINATE_AXES, principal_axes};
use crate::support::split::Split;
use whitstone_core::{Aabb, DVec3, Geometry};

/// Cost of a traversal step in element tests, measured on triangle meshes.
const STEP_COST: f64 = 1.6;

/// Axis-parallel candidates divide the extent of a cell's contents into this many equal parts along
/// each axis; both ends are candidates too.
const STRAIGHT: usize = 6;

/// Up to this number of elements, the planes of triangles are candidates.
const FEW: usize = 64;

/// Maximum number of triangle planes that are tried.
const ASKEW: usize = 4;

/// Steps from the median to the midpoint with `split = "between"`.
const BETWEEN: usize = 8;

/// An element, or its part inside a cell.
struct Fragment {
    /// Corners of the polygon or of the box.
    points: Vec<DVec3>,
    /// Whether the points are those of a polygon, which can be clipped.
    polygon: bool,
    item: u32,
}

impl Fragment {
    /// Smallest and largest signed distance above a plane.
    fn heights(&self, plane: &Plane) -> (f64, f64) {
        let heights = self.points.iter().map(|&point| plane.height(point));
        heights.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), height| {
            (low.min(height), high.max(height))
        })
    }
}

struct Builder {
    margin: f64,
    max_leaf: usize,
    split: Split,
}

/// Builds the tree over all elements.
pub(super) fn build(geometry: &Geometry, elements: &Elements, config: &Config) -> Partition {
    let items = &elements.items;
    let builder = Builder {
        // Smaller than the margin of box overlap tests: these enlarge the box by it, whereas here
        // each cut loses up to this much of a fragment.
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
    let max_depth = config.max_depth.map(|depth| depth.get());
    let cell = Polyhedron::of_box(&bounds(items));
    Partition::new(items, &Tree::new(&builder, fragments, cell, max_depth))
}

impl Cutter for Builder {
    type Cut = Plane;
    type Part = Fragment;

    const STEP_COST: f64 = STEP_COST;
    const MAX_REFERENCES: usize = 8;
    const PARALLEL: usize = 1024;

    fn item(fragment: &Fragment) -> u32 {
        fragment.item
    }

    fn is_leaf(&self, count: usize) -> bool {
        count <= self.max_leaf
    }

    fn asks_cost(&self) -> bool {
        self.split.asks_cost()
    }

    fn leaf_cost(count: usize) -> f64 {
        count as f64
    }

    fn is_hopeless(&self, count: usize, half_area: f64, choice: &Choice<Plane>) -> bool {
        STEP_COST * half_area + choice.cost >= Self::leaf_cost(count) * half_area
    }

    fn choose(&self, fragments: &[Fragment], cell: &Polyhedron) -> Option<Choice<Plane>> {
        let half_area = cell.half_area();
        if self.split == Split::Between {
            let [median, midpoint] = self.across(fragments);
            let planes = (0..=BETWEEN).map(|i| {
                let share = i as f64 / BETWEEN as f64;
                Plane {
                    normal: median.normal,
                    at: (1.0 - share) * median.at + share * midpoint.at,
                }
            });
            let judged =
                planes.filter_map(|plane| self.judge(fragments, cell, half_area, &plane, f64::INFINITY));
            return judged.reduce(cheaper);
        }
        if self.split != Split::Sah {
            let [median, midpoint] = self.across(fragments);
            let plane = if self.split == Split::Median {
                median
            } else {
                midpoint
            };
            let (_, flat_side) = self.counts(fragments, &plane);
            return Some(Choice {
                cut: plane,
                flat_side,
                cost: 0.0,
            });
        }
        let held = Aabb::around(points(fragments));
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
        let mut best: Option<Choice<Plane>> = None;
        for plane in straight.chain(askew) {
            let limit = best.as_ref().map_or(f64::INFINITY, |best| best.cost);
            let choice = self.judge(fragments, cell, half_area, &plane, limit);
            best = choice.filter(|choice| choice.cost < limit).or(best);
        }
        best
    }

    fn sides(&self, fragments: &[Fragment], choice: &Choice<Plane>) -> Option<[Vec<Fragment>; 2]> {
        let plane = &choice.cut;
        let mut sides = [const { Vec::new() }; 2];
        let copy = |fragment: &Fragment, points: Vec<DVec3>| Fragment { points, ..*fragment };
        for fragment in fragments {
            let whole = || copy(fragment, fragment.points.clone());
            match self.affects_bounds(fragment, plane) {
                [true, true] if fragment.polygon => {
                    let parts = cut_polygon(&fragment.points, plane, self.margin);
                    for (side, part) in sides.iter_mut().zip(parts) {
                        side.push(copy(fragment, part));
                    }
                }
                [false, false] => sides[choice.flat_side].push(whole()),
                reaches => {
                    for (side, _) in sides.iter_mut().zip(reaches).filter(|(_, reaches)| *reaches) {
                        side.push(whole());
                    }
                }
            }
        }
        // Unless costs decide, an empty side is no progress.
        let useful = self.asks_cost() || sides.iter().all(|side| !side.is_empty());
        useful.then_some(sides)
    }
}

impl Builder {
    /// Whether a fragment reaches below and above a plane.
    fn affects_bounds(&self, fragment: &Fragment, plane: &Plane) -> [bool; 2] {
        let (low, high) = fragment.heights(plane);
        [low < -self.margin, high > self.margin]
    }

    /// Number of fragments on each side of a plane, and the side of those in the plane: the one
    /// with fewer fragments.
    fn counts(&self, fragments: &[Fragment], plane: &Plane) -> ([usize; 2], usize) {
        let (mut counts, mut flat) = ([0; 2], 0);
        for fragment in fragments {
            let reaches = self.affects_bounds(fragment, plane);
            flat += usize::from(reaches == [false; 2]);
            counts = [0, 1].map(|side| counts[side] + usize::from(reaches[side]));
        }
        let flat_side = usize::from(counts[1] < counts[0]);
        counts[flat_side] += flat;
        (counts, flat_side)
    }

    /// The planes perpendicular to the principal axis, at the median and at the spatial midpoint.
    fn across(&self, fragments: &[Fragment]) -> [Plane; 2] {
        let normal = principal_axes(&points(fragments).collect::<Vec<_>>())[0];
        let ground = Plane { normal, at: 0.0 };
        let mut middles: Vec<f64> = fragments
            .iter()
            .map(|fragment| fragment.heights(&ground))
            .map(|(low, high)| 0.5 * low + 0.5 * high)
            .collect();
        let low = middles.iter().copied().fold(f64::INFINITY, f64::min);
        let high = middles.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let half = middles.len() / 2;
        let median = *middles.select_nth_unstable_by(half, f64::total_cmp).1;
        [median, 0.5 * low + 0.5 * high].map(|at| Plane { normal, at })
    }

    /// A cut with its cost; `None` if its cost is certainly not below `limit`, or if the plane does
    /// not pass through the cell.
    fn judge(
        &self,
        fragments: &[Fragment],
        cell: &Polyhedron,
        half_area: f64,
        plane: &Plane,
        limit: f64,
    ) -> Option<Choice<Plane>> {
        let (counts, flat_side) = self.counts(fragments, plane);
        // The parts' areas add up to at least that of the cell, which gives a lower bound on the
        // cost before they are computed.
        let least = bonus(counts) * half_area * counts[0].min(counts[1]) as f64;
        if least >= limit || !cell.is_on_both_sides(plane, self.margin) {
            return None;
        }
        let areas = cell.cut(plane).map(|part| part.half_area());
        Some(Choice {
            cut: *plane,
            flat_side,
            cost: cost(areas, counts),
        })
    }
}

fn points(fragments: &[Fragment]) -> impl Iterator<Item = DVec3> {
    fragments
        .iter()
        .flat_map(|fragment| fragment.points.iter().copied())
}

/// The plane of a triangle or of its part; `None` for boxes and degenerate triangles.
fn plane_of(fragment: &Fragment) -> Option<Plane> {
    let [a, b, c] = *fragment.points.first_chunk()?;
    let normal = (b - a).cross(c - a).try_normalize()?;
    fragment.polygon.then(|| Plane {
        normal,
        at: normal.dot(a),
    })
}
