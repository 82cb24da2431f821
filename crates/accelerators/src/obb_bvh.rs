//! A hierarchy of oriented boxes: each node has a frame of its own.
//!
//! - Fit: along the principal axes of the corners of what is inside (Gottschalk, Lin, Manocha, *OBBTree: a
//!   hierarchical structure for rapid interference detection*, 1996, section 4), or along the coordinate axes where
//!   that box is smaller. Each node is fitted to its own elements, not to its children.
//! - Build: top down over axis-parallel boxes; see `binary`.
//! - Traversal: nearer child first, with an explicit stack. The ray is expressed in the frame of each box: six
//!   products with a vector before the three intervals.
//! - Cost model: a step takes about three times that of an axis-parallel box, so that an oriented one pays where it
//!   is hit less than a third as often: long thin things that lie askew (hair, pipes, blades), the worst case
//!   of `bvh2`. On compact meshes it does not pay. Memory: 15 numbers a node, two nodes an element at most. Build:
//!   O(n log n), as every level is fitted anew. A moving rigid part needs no new fit, only a new frame.
//!
//! - Twin: none needed; the image does not depend on it.
//! - Example: `scenes/accelerators/obb_bvh.toml`.

use crate::binary::{Builder, MAX_DEPTH, STEP_COST, Tree};
use crate::elements::{Elements, Item, Searched, Structure, WideRay};
use crate::principal::{COORDINATE_AXES, principal_axes};
use crate::split::{Axes, Split};
use schemars::JsonSchema;
use serde::Deserialize;
use std::num::NonZeroU32;
use std::sync::Arc;
use whitstone_core::{
    Accelerator, Accelerators, Context, DVec3, Element, Geometry, Plugin, SceneErrors, Statistics,
};

/// A hierarchy of oriented boxes: for long thin things that lie askew.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// Most elements that a leaf may hold; a leaf has fewer where that is estimated to be faster.
    #[serde(default = "four")]
    max_leaf: NonZeroU32,
    /// Where to split.
    #[serde(default)]
    split: Split,
    /// Along which axes to look for a split.
    #[serde(default)]
    axes: Axes,
}

fn four() -> NonZeroU32 {
    const { NonZeroU32::new(4).unwrap() }
}

/// Time of a step, in units of that of an axis-parallel box.
const STEPS: f64 = 3.0;

/// A box in a frame of its own.
#[derive(Clone, Copy, Debug)]
struct Oriented {
    /// Orthogonal, of unit length up to rounding.
    axes: [DVec3; 3],
    /// Smallest and largest product of each axis with a point inside.
    min: [f64; 3],
    max: [f64; 3],
}

impl Oriented {
    /// The box around some points along given axes. Each face is where the outermost point is, so rounding of the
    /// axes does not matter.
    fn around(points: &[DVec3], axes: [DVec3; 3]) -> Self {
        let end = |start: f64, choose: fn(f64, f64) -> f64| {
            axes.map(|axis| points.iter().map(|p| axis.dot(*p)).fold(start, choose))
        };
        Self {
            axes,
            min: end(f64::INFINITY, f64::min),
            max: end(f64::NEG_INFINITY, f64::max),
        }
    }

    /// The smaller of the two candidates.
    fn fitted(points: &[DVec3]) -> Self {
        let straight = Self::around(points, COORDINATE_AXES);
        let askew = Self::around(points, principal_axes(points));
        if askew.half_area() < straight.half_area() {
            askew
        } else {
            straight
        }
    }

    fn half_area(&self) -> f64 {
        let [x, y, z] = [0, 1, 2].map(|i| self.max[i] - self.min[i]);
        x * y + y * z + z * x
    }

    /// Where the ray enters, if it does so from `min` to `limit`.
    #[inline]
    fn enter(&self, ray: &WideRay, min: f64, limit: f64) -> Option<f64> {
        let mut inside = (min, limit);
        for i in 0..3 {
            let along = ray.along(self.axes[i]);
            inside = along.between(self.min[i], self.max[i], inside);
        }
        (inside.0 <= inside.1).then_some(inside.0)
    }
}

/// The hierarchy.
#[derive(Default)]
pub struct ObbBvh {
    /// The root is 0.
    nodes: Vec<Node>,
    /// What the leaves hold, leaf after leaf.
    elements: Vec<Element>,
    depth: usize,
    sah_cost: f64,
}

#[derive(Clone, Copy, Debug)]
struct Node {
    oriented: Oriented,
    /// Of an inner node, the first of two children side by side; of a leaf, the first of its elements.
    first: u32,
    /// Elements of a leaf; 0 for an inner node.
    count: u32,
}

impl Plugin<Accelerators> for ObbBvh {
    const TYPE: &'static str = "obb_bvh";
    type Config = Config;

    fn build(
        config: Config,
        geometry: Arc<Geometry>,
        _: &mut dyn Context,
    ) -> Result<Box<dyn Accelerator>, SceneErrors> {
        let builder = Builder {
            max_leaf: config.max_leaf.get() as usize,
            split: config.split,
            axes: config.axes,
            step_cost: STEPS * STEP_COST,
        };
        Ok(Box::new(Searched::new(geometry, |geometry, elements| {
            Self::new(geometry, elements, &builder)
        })))
    }
}

impl ObbBvh {
    fn new(geometry: &Geometry, elements: Elements, builder: &Builder) -> Self {
        let mut items = elements.items;
        let mut found = Self::default();
        if items.is_empty() {
            return found;
        }
        let tree = builder.build(&mut items);
        found.elements = items.iter().map(|item| item.element).collect();
        found.nodes.push(node(&tree, &items, geometry));
        found.flatten(&tree, 0, 0, &items, geometry);
        // Relative to the chance of hitting the whole; a flat point has none.
        found.sah_cost /= found.nodes[0].oriented.half_area().max(f64::MIN_POSITIVE);
        found
    }

    /// Puts what is below a node behind all others.
    fn flatten(&mut self, tree: &Tree, place: usize, depth: usize, items: &[Item], geometry: &Geometry) {
        self.depth = self.depth.max(depth);
        let area = self.nodes[place].oriented.half_area();
        match tree {
            Tree::Leaf(range) => {
                self.sah_cost += area * range.len() as f64;
                self.nodes[place].count = range.len() as u32;
                self.nodes[place].first = range.start as u32;
            }
            Tree::Inner([(_, left), (_, right)]) => {
                self.sah_cost += area * STEPS * STEP_COST;
                let first = self.nodes.len();
                self.nodes[place].first = first as u32;
                let children = rayon::join(|| node(left, items, geometry), || node(right, items, geometry));
                self.nodes.extend(<[Node; 2]>::from(children));
                for (i, child) in [left, right].into_iter().enumerate() {
                    self.flatten(child, first + i, depth + 1, items, geometry);
                }
            }
        }
    }
}

/// A node around a subtree, without its children.
fn node(tree: &Tree, items: &[Item], geometry: &Geometry) -> Node {
    let points: Vec<DVec3> = items[tree.range()]
        .iter()
        .flat_map(|item| item.hull(geometry))
        .collect();
    Node {
        oriented: Oriented::fitted(&points),
        first: 0,
        count: 0,
    }
}

impl Structure for ObbBvh {
    #[inline]
    fn visit(
        &self,
        ray: &WideRay,
        min: f64,
        mut limit: f64,
        visit: &mut impl FnMut(Element) -> Option<f64>,
    ) -> Option<f64> {
        let enter = |node: u32, limit: f64| self.nodes[node as usize].oriented.enter(ray, min, limit);
        if self.nodes.is_empty() || enter(0, limit).is_none() {
            return Some(limit);
        }
        // One entry a level: the child that is put off.
        let mut stack = [(0.0, 0); MAX_DEPTH];
        let (mut height, mut node) = (0, 0);
        loop {
            let Node { first, count, .. } = self.nodes[node as usize];
            for &element in held(&self.elements, first, count) {
                limit = visit(element)?;
            }
            if count == 0 {
                match (enter(first, limit), enter(first + 1, limit)) {
                    (Some(left), Some(right)) => {
                        let swap = u32::from(right < left);
                        stack[height] = (left.max(right), first + 1 - swap);
                        height += 1;
                        node = first + swap;
                        continue;
                    }
                    (Some(_), None) => {
                        node = first;
                        continue;
                    }
                    (None, Some(_)) => {
                        node = first + 1;
                        continue;
                    }
                    (None, None) => {}
                }
            }
            loop {
                if height == 0 {
                    return Some(limit);
                }
                height -= 1;
                let (near, later) = stack[height];
                node = later;
                // At equal distance an element of lower number may be in there.
                if near <= limit {
                    break;
                }
            }
        }
    }

    fn statistics(&self) -> Statistics {
        let leaves = self.nodes.iter().filter(|node| node.count > 0).count();
        let askew = |node: &&Node| node.oriented.axes != COORDINATE_AXES;
        let bytes = size_of_val(&*self.nodes) + size_of_val(&*self.elements);
        Statistics::from([
            ("nodes", (self.nodes.len() - leaves) as f64),
            ("leaves", leaves as f64),
            ("askew", self.nodes.iter().filter(askew).count() as f64),
            ("depth", self.depth as f64),
            ("sah_cost", self.sah_cost),
            ("bytes", bytes as f64),
        ])
    }
}

/// What a leaf holds; nothing for an inner node, whose `first` is a node.
#[inline]
fn held(elements: &[Element], first: u32, count: u32) -> &[Element] {
    if count == 0 {
        return &[];
    }
    &elements[first as usize..][..count as usize]
}

#[cfg(test)]
mod tests {
    use super::*;
    use whitstone_testkit::accelerator_laws;

    #[test]
    fn obeys_the_laws_of_accelerators() {
        for text in [
            "",
            "max_leaf = 1",
            "split = \"midpoint\"\naxes = \"longest\"",
            "split = \"median\"",
        ] {
            accelerator_laws::<ObbBvh>(text);
        }
    }
}
