//! A binary bounding volume hierarchy (BVH) in `f64`.
//!
//! - Build: top down, with SAH, midpoint or median splits; see `binary`.
//! - Traversal: nearer child first, with an explicit stack. The slab test selects planes by the
//!   sign bits of the direction and uses comparisons that ignore NaN (Ize, *Robust BVH ray
//!   traversal*, JCGT 2(2), 2013). Rays are padded (treated as if they had a width), so that
//!   rounding in a shape's own test cannot hide its hit; see `elements`. Where elements are tiny
//!   next to others, or far from the origin of the coordinates, the padding is computed for each
//!   box, relative to its distance from the origin of the ray, so that their boxes stay tight.
//! - Cost model: a ray that hits a box hits a box inside it with probability equal to the ratio of
//!   their areas (Goldsmith and Salmon, *Automatic creation of object hierarchies for ray tracing*,
//!   1987, section 3). In units of one element test, a node costs 0.7 + (A_l C_l + A_r C_r) / A,
//!   and a leaf costs its number of elements. Memory: at most one node and one slot per element.
//!   Build: O(n log n).
//!
//! - Twin: none needed; the image does not depend on it.
//! - Example: `scenes/accelerators/bvh2.toml`.

use crate::support::binary::{Builder, MAX_DEPTH, STEP_COST, Tree};
use crate::support::elements::{Elements, Item, Searched, Structure, Visitor, WideRay, bounds, relative_pad};
use crate::support::split::{Axes, Split};
use schemars::JsonSchema;
use serde::Deserialize;
use std::num::NonZeroU32;
use std::sync::Arc;
use whitstone_core::{
    Aabb, Accelerator, Accelerators, Context, DVec3, DebugBounds, Element, Geometry, Plugin, SceneErrors,
    Statistics,
};

/// A binary bounding volume hierarchy (BVH) in `f64`: suits every scene.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// Maximum number of elements in a leaf. With `split` "sah" or "between", leaves are smaller
    /// where that lowers the estimated cost.
    #[serde(default = "four")]
    max_leaf: NonZeroU32,
    /// How to choose the split position.
    #[serde(default)]
    split: Split,
    /// Which axes to try for a split.
    #[serde(default)]
    axes: Axes,
}

fn four() -> NonZeroU32 {
    const { NonZeroU32::new(4).unwrap() }
}

/// The hierarchy.
#[derive(Default)]
pub struct Bvh2 {
    /// Inner nodes in depth-first order; the root is 0.
    nodes: Vec<Node>,
    /// Elements of all leaves, concatenated.
    slots: Vec<Slot>,
    /// The root; `None` if there are no elements.
    root: Option<Child>,
    /// Depth of the tree.
    depth: usize,
    /// Expected cost of a ray that hits the root's box, in element tests.
    sah_cost: f64,
    bounds: Option<Aabb>,
    /// Whether the padding of a ray is computed for each box.
    relative: bool,
}

/// An element is tiny if its size is below this fraction of the largest coordinate. At this size,
/// padding relative to that coordinate is a thousandth of the size of the element.
const TINY: f64 = 1.0 / (1u64 << 30) as f64;

/// With at least this many tiny elements, the padding is computed for each box. A step then costs
/// almost twice as much.
const MANY_TINY: usize = 32;

/// Whether there are many tiny elements.
fn are_tiny(elements: &Elements) -> bool {
    let size = |item: &Item| item.aabb.extent().max_element();
    let tiny = elements
        .items
        .iter()
        .filter(|item| size(item) < TINY * elements.reach);
    tiny.take(MANY_TINY).count() == MANY_TINY
}

/// An inner node with the boxes of both children.
#[derive(Clone, Copy, Debug)]
struct Node {
    /// Indexed by axis, side (0 minimum, 1 maximum) and child.
    planes: [[[f64; 2]; 2]; 3],
    children: [Child; 2],
}

/// Reference to an inner node, or to a leaf by its first slot.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Child(u32);

impl Child {
    const LEAF: u32 = 1 << 31;

    fn leaf(first_slot: usize) -> Self {
        Self(first_slot as u32 | Self::LEAF)
    }

    fn inner(node: usize) -> Self {
        Self(node as u32)
    }

    /// The first slot of a leaf; `Err` with the index of an inner node.
    fn first_slot(self) -> Result<usize, usize> {
        let index = (self.0 & !Self::LEAF) as usize;
        if self.0 & Self::LEAF != 0 {
            Ok(index)
        } else {
            Err(index)
        }
    }
}

/// An element in a leaf.
#[derive(Clone, Copy, Debug)]
struct Slot {
    element: Element,
    /// Whether this is the last slot of its leaf.
    last: bool,
}

/// Trees up to this depth are traversed with a smaller stack, which is cheaper to set up, except
/// with relative padding.
const USUAL_DEPTH: usize = 32;

impl Plugin<Accelerators> for Bvh2 {
    const TYPE: &'static str = "bvh2";
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
            step_cost: STEP_COST,
        };
        Ok(Box::new(Searched::new(geometry, |_, elements| {
            let relative = are_tiny(&elements);
            Self::new(elements, &builder, relative)
        })?))
    }
}

impl Bvh2 {
    fn new(elements: Elements, builder: &Builder, relative: bool) -> Self {
        let mut items = elements.items;
        let mut found = Self {
            relative,
            ..Self::default()
        };
        if items.is_empty() {
            return found;
        }
        if relative {
            for item in &mut items {
                item.aabb = item.aabb.padded(relative_pad(item));
            }
        }
        let bounds = bounds(&items);
        let area = bounds.half_area();
        found.bounds = Some(bounds);
        let tree = builder.build(&mut items);
        let slot = |item: &Item| Slot {
            element: item.element,
            last: false,
        };
        found.slots = items.iter().map(slot).collect();
        found.root = Some(found.flatten(&tree, area, 0));
        // Normalized by the root's area, which may be zero.
        found.sah_cost /= area.max(f64::MIN_POSITIVE);
        found
    }

    /// Appends a subtree in depth-first order: the first child directly follows its parent.
    fn flatten(&mut self, tree: &Tree, half_area: f64, depth: usize) -> Child {
        self.depth = self.depth.max(depth);
        match tree {
            Tree::Leaf(range) => {
                self.sah_cost += half_area * range.len() as f64;
                self.slots[range.end - 1].last = true;
                Child::leaf(range.start)
            }
            Tree::Inner(children) => {
                self.sah_cost += half_area * STEP_COST;
                let planes = [0, 1, 2].map(|axis| {
                    let side =
                        |of: fn(&Aabb) -> DVec3| [0, 1].map(|child: usize| of(&children[child].0)[axis]);
                    [side(|aabb| aabb.min), side(|aabb| aabb.max)]
                });
                let index = self.nodes.len();
                self.nodes.push(Node {
                    planes,
                    children: [Child::default(); 2],
                });
                for (i, (aabb, subtree)) in children.iter().enumerate() {
                    let child = self.flatten(subtree, aabb.half_area(), depth + 1);
                    self.nodes[index].children[i] = child;
                }
                Child::inner(index)
            }
        }
    }

    fn outline(&self, child: Child, aabb: &Aabb, depth: usize, deepest: usize, found: &mut Vec<DebugBounds>) {
        found.push(DebugBounds::of_box(depth, aabb));
        if let Err(node) = child.first_slot()
            && depth < deepest
        {
            let node = &self.nodes[node];
            for (i, &child) in node.children.iter().enumerate() {
                let [min, max] = [0, 1].map(|side| node.planes.map(|sides| sides[side][i]).into());
                self.outline(child, &Aabb { min, max }, depth + 1, deepest, found);
            }
        }
    }

    #[inline]
    fn walk<const DEPTH: usize, const RELATIVE: bool>(
        &self,
        ray: &WideRay,
        min: f64,
        mut limit: f64,
        visitor: &mut impl Visitor,
    ) -> Option<f64> {
        let Some(mut child) = self.root else {
            return Some(limit);
        };
        // One entry per level: the deferred child.
        let mut stack = [(0.0, Child::default()); DEPTH];
        let mut height = 0;
        loop {
            match child.first_slot() {
                Err(node) => {
                    visitor.step();
                    let node = &self.nodes[node];
                    let (near, hit) = if RELATIVE {
                        node.enter_relative(ray, min, limit)
                    } else {
                        node.enter(ray, min, limit)
                    };
                    match hit {
                        [true, true] => {
                            let first = usize::from(near[1] < near[0]);
                            stack[height] = (near[1 - first], node.children[1 - first]);
                            height += 1;
                            child = node.children[first];
                            continue;
                        }
                        [true, false] => {
                            child = node.children[0];
                            continue;
                        }
                        [false, true] => {
                            child = node.children[1];
                            continue;
                        }
                        [false, false] => {}
                    }
                }
                Ok(first) => {
                    for slot in &self.slots[first..] {
                        limit = visitor.test(slot.element)?;
                        if slot.last {
                            break;
                        }
                    }
                }
            }
            child = loop {
                if height == 0 {
                    return Some(limit);
                }
                height -= 1;
                let (near, child) = stack[height];
                // `<=`: at equal distance an element of lower index may follow, which wins the tie.
                if near <= limit {
                    break child;
                }
            };
        }
    }
}

impl Structure for Bvh2 {
    #[inline]
    fn visit(&self, ray: &WideRay, min: f64, limit: f64, visitor: &mut impl Visitor) -> Option<f64> {
        match (self.depth <= USUAL_DEPTH, self.relative) {
            (true, false) => self.walk::<USUAL_DEPTH, false>(ray, min, limit, visitor),
            (false, false) => self.walk::<MAX_DEPTH, false>(ray, min, limit, visitor),
            (_, true) => self.walk::<MAX_DEPTH, true>(ray, min, limit, visitor),
        }
    }

    fn statistics(&self) -> Statistics {
        let leaves = self.slots.iter().filter(|slot| slot.last).count();
        Statistics::from([
            ("nodes", self.nodes.len() as f64),
            ("leaves", leaves as f64),
            ("depth", self.depth as f64),
            ("sah_cost", self.sah_cost),
            (
                "bytes",
                (size_of_val(&*self.nodes) + size_of_val(&*self.slots)) as f64,
            ),
        ])
    }

    fn debug_bounds(&self, deepest: usize) -> Vec<DebugBounds> {
        let mut found = Vec::new();
        if let (Some(child), Some(bounds)) = (self.root, &self.bounds) {
            self.outline(child, bounds, 0, deepest, &mut found);
        }
        found
    }
}

impl Node {
    /// Entry distance of each child's box, and whether the ray is inside it between `min` and
    /// `limit`.
    #[inline]
    fn enter(&self, ray: &WideRay, min: f64, limit: f64) -> ([f64; 2], [bool; 2]) {
        let (mut near, mut far) = ([min; 2], [limit; 2]);
        for axis in 0..3 {
            let near_planes = self.planes[axis][ray.near_side[axis]];
            let far_planes = self.planes[axis][1 - ray.near_side[axis]];
            for child in 0..2 {
                let enter = ray.arrives(axis, near_planes[child]);
                let leave = ray.leaves(axis, far_planes[child]);
                // NaN (the ray lies in the plane) changes nothing.
                near[child] = if enter > near[child] { enter } else { near[child] };
                far[child] = if leave < far[child] { leave } else { far[child] };
            }
        }
        (near, [near[0] <= far[0], near[1] <= far[1]])
    }

    /// The same, with a padding relative to the largest distance, along an axis, from the origin to
    /// a plane of the box.
    #[inline]
    fn enter_relative(&self, ray: &WideRay, min: f64, limit: f64) -> ([f64; 2], [bool; 2]) {
        // The planes relative to the origin, near ones first, and the largest of them.
        let mut planes = [[[0.0; 2]; 2]; 3];
        let mut reach = [0.0; 2];
        for axis in 0..3 {
            let near_side = ray.near_side[axis];
            for (to, side) in [near_side, 1 - near_side].into_iter().enumerate() {
                for child in 0..2 {
                    let plane: f64 = self.planes[axis][side][child] - ray.ray.origin[axis];
                    planes[axis][to][child] = plane;
                    let far = plane.abs();
                    reach[child] = if far > reach[child] { far } else { reach[child] };
                }
            }
        }
        let (mut near, mut far) = ([min; 2], [limit; 2]);
        for axis in 0..3 {
            let reciprocal = ray.reciprocal[axis];
            for child in 0..2 {
                let forward = (ray.width * reach[child]).copysign(reciprocal);
                let enter = (planes[axis][0][child] - forward) * reciprocal;
                let leave = (planes[axis][1][child] + forward) * reciprocal;
                // NaN (the ray lies in the plane) changes nothing.
                near[child] = if enter > near[child] { enter } else { near[child] };
                far[child] = if leave < far[child] { leave } else { far[child] };
            }
        }
        (near, [near[0] <= far[0], near[1] <= far[1]])
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    /// Pads rays relative to each box, whatever the elements are.
    pub(crate) struct Relative;

    impl Plugin<Accelerators> for Relative {
        const TYPE: &'static str = "bvh2";
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
                step_cost: STEP_COST,
            };
            let build = |_: &Geometry, elements| Bvh2::new(elements, &builder, true);
            Ok(Box::new(Searched::new(geometry, build)?))
        }
    }

    #[test]
    fn padding_relative_to_each_box_obeys_the_laws() {
        whitstone_testkit::accelerator_laws::<Relative>("");
        whitstone_testkit::accelerator_laws::<Relative>("max_leaf = 1");
    }

    #[test]
    fn large_leaves_obey_the_laws() {
        whitstone_testkit::accelerator_laws_of_part::<Bvh2>("max_leaf = 1000", 8);
    }

    whitstone_testkit::accelerator_laws!(
        Bvh2,
        "",
        "max_leaf = 1",
        "max_leaf = 1..9",
        "split = \"midpoint\"\naxes = \"longest\"",
        "split = \"midpoint\"\nmax_leaf = 1",
        "split = \"median\"\naxes = \"longest\"",
        "split = \"median\"",
        "split = \"between\"",
        "split = \"between\"\naxes = \"longest\"\nmax_leaf = 1",
        "axes = \"longest\"",
    );
}
