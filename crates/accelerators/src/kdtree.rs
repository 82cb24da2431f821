//! A kd-tree: axis-aligned planes split space into cells, and each leaf cell refers to all elements
//! that overlap it.
//!
//! - Build: Wald and Havran, *On building fast kd-trees for ray tracing, and on doing that in O(N
//!   log N)*, 2006. The SAH chooses among planes at the ends of the elements' boxes (section 4.2).
//!   Each side keeps the box of the triangle clipped to it ("perfect splits", section 3.3). Cutting
//!   off empty space has a bonus (section 3.4). In large nodes the candidates are the borders of
//!   bins (Shevtsov, Soupikov, Kapustin 2007); see `build`.
//! - Traversal: front to back, with a ray interval for each cell, in single precision; see
//!   `search`. The triangles of a leaf are tested eight at once by the conservative filter that
//!   `bvh` also uses; see `leaves`.
//! - Cost model: a ray that crosses a cell crosses a given part of it with probability equal to the
//!   ratio of their surface areas. In units of one test of eight triangles, a traversal step costs
//!   1.4, and a leaf 1 for every eight elements. A cell is split at the plane with the least
//!   A_l n_l + A_r n_r, where A is the area and n the number of elements of a side; a side without
//!   elements lowers this cost by a fifth. A subtree of at most 64 elements that costs no less than
//!   a single leaf is replaced by that leaf. Cells do not overlap, so a near hit ends the search
//!   early.
//! - Memory: 8 bytes per node, 44 per reference. Several cells may refer to one element. Once there
//!   are 4 references per element on average, cells are not split further. Build: O(n log n). The
//!   paper sorts once to reach this bound. Here cells are sorted again at each level, but only
//!   those of at most 1024 references, so that sorting costs a constant factor.
//!
//! - Twin: none needed; the image does not depend on it.
//! - Example: `scenes/accelerators/kdtree.toml`.

mod build;
mod search;

use crate::support::elements::{MAX_ELEMENTS, check_count};
use crate::support::leaves::child::WIDTH;
use crate::support::leaves::filter::NUMBERS;
use crate::support::leaves::items::{Box4, Contents, Items};
use crate::support::leaves::state::{Counters, Query, Search, Tally};
use crate::support::leaves::{Leaves, by_coordinate};
use crate::support::partition::{Content, Cut, MAX_DEPTH, Tree};
use crate::support::split::{Axes, Split};
use build::AxisCut;
use schemars::JsonSchema;
use search::{Node, Traversal};
use serde::Deserialize;
use std::num::NonZeroU32;
use std::sync::Arc;
use std::time::Instant;
use whitstone_core::config::IntegerIn;
use whitstone_core::{
    Aabb, Accelerator, Accelerators, Context, DebugBounds, Geometry, Interval, Plugin,
    PreliminaryIntersection, Ray, SceneErrors, SelfHitFilter, Statistics, TraversalStatistics,
};
use whitstone_simd::{Level, with_lanes};

/// A kd-tree: cells do not overlap, and an element may lie in several of them.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// Cells of at most this many elements are not split; ignored with `split` "sah" or "between",
    /// which decide by cost.
    #[serde(default = "eight")]
    max_leaf: NonZeroU32,
    /// Maximum depth of the tree.
    #[serde(default)]
    #[schemars(extend("x-default" = "8 + 1.3 log2(number of elements)"))]
    max_depth: Option<IntegerIn<1, { MAX_DEPTH as u32 }>>,
    /// How to choose the split position.
    #[serde(default)]
    split: Split,
    /// Which axes to try.
    #[serde(default)]
    axes: Axes,
}

fn eight() -> NonZeroU32 {
    const { NonZeroU32::new(8).unwrap() }
}

/// The `kdtree` accelerator; see the module documentation.
pub struct KdTree {
    leaves: Leaves,
    /// Bounds of all elements that have a box, in local coordinates.
    cell: Box4,
    /// The nodes; the root is node 0.
    nodes: Vec<Node>,
    statistics: Statistics,
}

impl Plugin<Accelerators> for KdTree {
    const TYPE: &'static str = "kdtree";
    type Config = Config;

    fn build(
        config: Config,
        geometry: Arc<Geometry>,
        _: &mut dyn Context,
    ) -> Result<Box<dyn Accelerator>, SceneErrors> {
        check_count(&geometry, MAX_ELEMENTS)?;
        Ok(Box::new(Self::new(geometry, &config)))
    }
}

impl KdTree {
    fn new(geometry: Arc<Geometry>, config: &Config) -> Self {
        let start = Instant::now();
        let items = Items::new(&geometry);
        let bounded = items.each(|number| items.item(number));
        let cell = bounded
            .iter()
            .fold(Box4::EMPTY, |cell, item| cell.union(item.aabb()));
        let count = bounded.len();
        let tree = build::build(bounded, items.corners(), cell, config);
        let (mut nodes, mut references) = (vec![Node::EMPTY; 2], Vec::new());
        flatten(&tree, 0, &mut nodes, &mut references);
        let Contents { slots, corners } = items.contents(&references, |&number| number);
        let mut numbers = corners.into_flattened();
        for node in nodes.iter_mut().filter(|node| node.is_leaf()) {
            let held = node.slots();
            if slots[held.clone()].iter().any(|slot| slot.is_custom()) {
                *node = node.mixed();
            } else {
                for numbers in numbers[NUMBERS * held.start..NUMBERS * held.end].chunks_mut(NUMBERS * WIDTH) {
                    by_coordinate(numbers, numbers.len() / NUMBERS);
                }
            }
        }
        let Items { frame, unbounded, .. } = items;
        let leaves = Leaves::new(geometry, frame, unbounded, slots, numbers);
        let leaf_count = nodes.iter().filter(|node| node.is_leaf()).count() - 1;
        let empty = nodes.iter().filter(|node| node.is_empty()).count() - 1;
        let statistics = Statistics::from([
            ("elements", (count + leaves.unbounded.len()) as f64),
            ("unbounded", leaves.unbounded.len() as f64),
            ("nodes", (nodes.len() - 1 - leaf_count) as f64),
            ("leaves", leaf_count as f64),
            ("empty_leaves", empty as f64),
            ("references", references.len() as f64),
            ("depth", tree.depth() as f64),
            // Normalized by the root's area, which may be zero.
            ("sah_cost", tree.cost / tree.half_area.max(f64::MIN_POSITIVE)),
            ("bytes", (size_of_val(&*nodes) + leaves.bytes()) as f64),
            ("build_seconds", start.elapsed().as_secs_f64()),
        ]);
        Self {
            leaves,
            cell,
            nodes,
            statistics,
        }
    }

    fn outline(&self, node: usize, cell: &Box4, depth: usize, deepest: usize, found: &mut Vec<DebugBounds>) {
        let frame = &self.leaves.frame;
        let [min, max] = [cell.min, cell.max].map(|p| frame.world(p.truncate().as_dvec3()));
        found.push(DebugBounds::of_box(depth, &Aabb { min, max }));
        if let Some((cut, children)) = self.nodes[node].cut()
            && depth < deepest
        {
            for (child, cell) in (children..).zip(&cut.halves(cell)) {
                self.outline(child, cell, depth + 1, deepest, found);
            }
        }
    }

    /// Finds any hit if `ANY`, else the nearest.
    #[inline(always)]
    fn find<const ANY: bool>(&self, query: &Query<'_>, tally: impl Tally) -> Option<PreliminaryIntersection> {
        let traversal = Traversal { tree: self, tally };
        with_lanes(Level::Avx512, Search::<ANY, _>(&traversal, query))
    }
}

/// Writes the root of a subtree to `place`, and appends its descendants to `nodes` and the elements
/// of its leaves to `references`.
fn flatten(tree: &Tree<AxisCut>, place: usize, nodes: &mut Vec<Node>, references: &mut Vec<u32>) {
    match &tree.content {
        Content::Leaf(held) => {
            nodes[place] = Node::leaf(references.len(), held.len());
            references.extend(held);
        }
        Content::Inner(cut, children) => {
            let next = nodes.len();
            nodes[place] = Node::inner(cut, next);
            nodes.extend([Node::EMPTY; 2]);
            for (side, child) in children.iter().enumerate() {
                flatten(child, next + side, nodes, references);
            }
        }
    }
}

impl Accelerator for KdTree {
    fn intersect(
        &self,
        ray: &Ray,
        interval: Interval,
        skip: SelfHitFilter,
    ) -> Option<PreliminaryIntersection> {
        self.find::<false>(&Query { ray, interval, skip }, ())
    }

    fn occluded(&self, ray: &Ray, interval: Interval, skip: SelfHitFilter) -> bool {
        self.find::<true>(&Query { ray, interval, skip }, ()).is_some()
    }

    fn traversal_statistics(
        &self,
        ray: &Ray,
        interval: Interval,
        skip: SelfHitFilter,
    ) -> Option<TraversalStatistics> {
        let (query, counters) = (Query { ray, interval, skip }, Counters::default());
        self.find::<false>(&query, &counters);
        let used = self.leaves.frame.ray(ray, &interval).is_some();
        Some(counters.statistics(&self.leaves, used))
    }

    fn statistics(&self) -> Statistics {
        self.statistics.clone()
    }

    fn debug_bounds(&self, deepest: usize) -> Option<Vec<DebugBounds>> {
        let mut found = Vec::new();
        if !self.cell.is_empty() {
            self.outline(0, &self.cell, 0, deepest, &mut found);
        }
        Some(found)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use whitstone_testkit::{accelerator_laws, accelerator_laws_of_part};

    #[test]
    fn obeys_the_laws_of_accelerators() {
        for text in [
            "",
            "max_leaf = 1\nmax_depth = 64",
            "axes = \"longest\"",
            "split = \"midpoint\"",
            "split = \"midpoint\"\naxes = \"longest\"\nmax_leaf = 1",
            "split = \"between\"",
            "split = \"between\"\naxes = \"longest\"",
            "split = \"median\"",
            "split = \"median\"\naxes = \"longest\"\nmax_leaf = 1",
        ] {
            accelerator_laws::<KdTree>(text);
        }
        // Leaves that hold a good part of the elements.
        accelerator_laws_of_part::<KdTree>("max_depth = 1", 8);
    }
}
