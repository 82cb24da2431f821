//! An octree: a cube is divided into eight, recursively, as long as it holds many elements.
//!
//! - Build: Glassner, *Space subdivision for fast ray tracing*, 1984. An element that straddles
//!   cells is referred to from each of them; triangles themselves, not their boxes, are
//!   tested against cells, up to a margin (`overlaps`).
//! - Traversal: Revelles, Ureña, Lastra, *An efficient parametric algorithm for octree traversal*,
//!   2000: top down. A child's ray interval follows from that of its parent and the three middle
//!   planes, without box tests. Their automaton yields the single next child. Here, a ray is
//!   widened to cover rounding errors (see `elements`) and can be in two children at once, so all
//!   eight are checked in ray order.
//! - Cost model: a cell is divided if it holds more than `max_leaf` elements. The build does not
//!   minimise a cost: cuts are always in the middle, which is slower than a kd-tree (figures in
//!   `docs/accelerators.md`), while one step makes three cuts at once. The statistics report the
//!   expected cost of a ray without a hit: a cell is crossed with probability equal to the ratio of
//!   its surface area, inside the bounds of all elements, to theirs; in units of one element test,
//!   an inner cell costs 2 and a leaf its number of elements. Unlike in a grid, empty
//!   space is skipped in large cells. Memory: at most 8 references per element on average, after
//!   which cells are not divided further. Build: O(n log n).
//!
//! - Twin: none needed; the image does not depend on it.
//! - Example: `scenes/accelerators/octree.toml`.

use crate::support::elements::{
    Elements, Item, MARGIN, Mailbox, Searched, Structure, Visitor, WideRay, bounds, overlaps,
};
use schemars::JsonSchema;
use serde::Deserialize;
use std::num::NonZeroU32;
use std::sync::Arc;
use whitstone_core::config::IntegerIn;
use whitstone_core::{
    Aabb, Accelerator, Accelerators, Context, DVec3, DebugBounds, Element, Geometry, Plugin, SceneErrors,
    Statistics,
};

/// An octree: adapts to unevenly distributed elements, but cuts cells in the middle only.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// Cells of more than this many elements are divided.
    #[serde(default = "eight")]
    max_leaf: NonZeroU32,
    /// Maximum depth of the tree.
    #[serde(default)]
    #[schemars(extend("x-default" = "3 + 0.6 log2(number of elements)"))]
    max_depth: Option<IntegerIn<1, 24>>,
}

fn eight() -> NonZeroU32 {
    const { NonZeroU32::new(8).unwrap() }
}

/// Maximum number of references per element, on average.
const MAX_REFERENCES: usize = 8;

/// Cost of a step, which tests eight children, in element tests.
const STEP_COST: f64 = 2.0;

/// The tree.
pub struct Octree {
    /// Bounds of all elements; not a cube.
    bounds: Aabb,
    cube: Cube,
    /// The nodes; the root is node 0.
    nodes: Vec<Node>,
    /// Element indices of all leaves.
    references: Vec<u32>,
    elements: Vec<Element>,
    depth: u32,
}

#[derive(Clone, Copy, Debug)]
enum Node {
    /// Eight consecutive children. The bits of a child's number name its half: 1 for the larger x,
    /// 2 for y, 4 for z.
    Inner { children: u32 },
    /// A range of references.
    Leaf { first: u32, count: u32 },
}

#[derive(Clone, Copy, Debug)]
struct Cube {
    center: DVec3,
    /// Half the edge length.
    half: f64,
}

impl Cube {
    /// One of the eight octants, computed bit-identically by the build and by every ray.
    #[inline]
    fn part(&self, number: usize) -> Self {
        let half = 0.5 * self.half;
        let toward = [0, 1, 2].map(|axis| if number >> axis & 1 == 1 { half } else { -half });
        Self {
            center: self.center + DVec3::from_array(toward),
            half,
        }
    }

    fn aabb(&self) -> Aabb {
        Aabb {
            min: self.center - self.half,
            max: self.center + self.half,
        }
    }
}

impl Plugin<Accelerators> for Octree {
    const TYPE: &'static str = "octree";
    type Config = Config;

    fn build(
        config: Config,
        geometry: Arc<Geometry>,
        _: &mut dyn Context,
    ) -> Result<Box<dyn Accelerator>, SceneErrors> {
        let build = |geometry: &Geometry, elements: Elements| Self::new(geometry, &elements, &config);
        Ok(Box::new(Searched::new(geometry, build)?))
    }
}

/// Constants of a build.
struct Builder<'a> {
    geometry: &'a Geometry,
    items: &'a [Item],
    margin: f64,
    max_leaf: usize,
    max_depth: u32,
}

impl Octree {
    fn new(geometry: &Geometry, elements: &Elements, config: &Config) -> Self {
        let items = &elements.items;
        let bounds = bounds(items);
        let mut tree = Self {
            bounds,
            cube: Cube {
                center: bounds.center(),
                half: 0.5 * bounds.extent().max_element(),
            },
            nodes: vec![Node::Leaf { first: 0, count: 0 }],
            references: Vec::new(),
            elements: items.iter().map(|item| item.element).collect(),
            depth: 0,
        };
        let usual = 3.0 + 0.6 * libm::log2(items.len().max(1) as f64);
        let builder = Builder {
            geometry,
            items,
            margin: MARGIN * elements.reach,
            max_leaf: config.max_leaf.get() as usize,
            max_depth: config
                .max_depth
                .map_or(usual.min(24.0) as u32, |depth| depth.get()),
        };
        let all = (0..items.len() as u32).collect();
        let spare = (MAX_REFERENCES - 1) * items.len();
        let cube = tree.cube;
        tree.divide(&builder, 0, all, cube, 0, spare);
        tree
    }

    /// Builds the subtree of `node` with at most `spare` additional references.
    fn divide(
        &mut self,
        builder: &Builder<'_>,
        node: usize,
        held: Vec<u32>,
        cube: Cube,
        depth: u32,
        spare: usize,
    ) {
        self.depth = self.depth.max(depth);
        let parts = || [0, 1, 2, 3, 4, 5, 6, 7].map(|number| builder.inside(&held, &cube, number));
        let divided = (depth < builder.max_depth && held.len() > builder.max_leaf).then(parts);
        let more = |parts: &[Vec<u32>; 8]| {
            let total: usize = parts.iter().map(Vec::len).sum();
            total.saturating_sub(held.len())
        };
        let Some((parts, more)) = divided
            .map(|parts| (more(&parts), parts))
            .and_then(|(more, parts)| (more <= spare).then_some((parts, more)))
        else {
            self.nodes[node] = Node::Leaf {
                first: self.references.len() as u32,
                count: held.len() as u32,
            };
            self.references.extend(held);
            return;
        };
        // The remaining budget is divided in proportion to size.
        let total = (held.len() + more).max(1);
        drop(held);
        let children = self.nodes.len();
        self.nodes.extend([Node::Leaf { first: 0, count: 0 }; 8]);
        self.nodes[node] = Node::Inner {
            children: children as u32,
        };
        for (number, part) in parts.into_iter().enumerate() {
            let spare = (spare - more) * part.len() / total;
            self.divide(
                builder,
                children + number,
                part,
                cube.part(number),
                depth + 1,
                spare,
            );
        }
    }
}

impl Octree {
    /// Expected cost inside a node of a ray that has no hit, times half the surface area of the
    /// bounds.
    fn cost(&self, node: u32, cube: &Cube) -> f64 {
        let aabb = cube.aabb();
        let crossed = Aabb {
            min: aabb.min.max(self.bounds.min),
            max: aabb.max.min(self.bounds.max),
        };
        if crossed.min.cmpgt(crossed.max).any() {
            return 0.0;
        }
        match self.nodes[node as usize] {
            Node::Leaf { count, .. } => crossed.half_area() * f64::from(count),
            Node::Inner { children } => {
                let below = (children..children + 8).zip(0..);
                let below = below.map(|(child, number)| self.cost(child, &cube.part(number)));
                STEP_COST * crossed.half_area() + below.sum::<f64>()
            }
        }
    }

    fn outline(&self, node: u32, cube: &Cube, depth: usize, deepest: usize, found: &mut Vec<DebugBounds>) {
        found.push(DebugBounds::of_box(depth, &cube.aabb()));
        if let Node::Inner { children } = self.nodes[node as usize]
            && depth < deepest
        {
            for (number, child) in (children..children + 8).enumerate() {
                self.outline(child, &cube.part(number), depth + 1, deepest, found);
            }
        }
    }
}

impl Builder<'_> {
    /// The elements that lie in one octant of a cube.
    fn inside(&self, held: &[u32], cube: &Cube, number: usize) -> Vec<u32> {
        let part = cube.part(number).aabb();
        let inside = held.iter().filter(|&&held| {
            let item = &self.items[held as usize];
            let on_side = (0..3).all(|axis| {
                let (plane, aabb) = (cube.center[axis], &item.aabb);
                let above = aabb.max[axis] > plane;
                // Elements in the plane belong below it.
                if number >> axis & 1 == 1 {
                    above
                } else {
                    aabb.min[axis] < plane || !above
                }
            });
            let corners = || item.corners(self.geometry);
            on_side && corners().is_none_or(|corners| overlaps(&corners, &part, self.margin))
        });
        inside.copied().collect()
    }
}

/// Traversal state of one ray.
struct Walk<'a, V> {
    tree: &'a Octree,
    ray: &'a WideRay,
    /// XOR mask for the numbers of children, so that child 0 is the first along the ray.
    mirror: usize,
    mailbox: Mailbox,
    visitor: &'a mut V,
}

impl<V: Visitor> Walk<'_, V> {
    /// Visits a node that the ray touches from `near` to `far`. The recursion is as deep as the
    /// tree.
    fn descend(&mut self, node: u32, cube: Cube, near: f64, far: f64, mut limit: f64) -> Option<f64> {
        let children = match self.tree.nodes[node as usize] {
            Node::Inner { children } => {
                self.visitor.step();
                children
            }
            Node::Leaf { first, count } => {
                for &element in &self.tree.references[first as usize..(first + count) as usize] {
                    if self.mailbox.is_new(element) {
                        limit = self.visitor.test(self.tree.elements[element as usize])?;
                    }
                }
                return Some(limit);
            }
        };
        let arrives = [0, 1, 2].map(|axis| self.ray.arrives(axis, cube.center[axis]));
        let leaves = [0, 1, 2].map(|axis| self.ray.leaves(axis, cube.center[axis]));
        for step in 0..8 {
            let (mut near, mut far) = (near, far);
            for axis in 0..3 {
                // NaN is ignored.
                if step >> axis & 1 == 1 {
                    near = near.max(arrives[axis]);
                } else {
                    far = far.min(leaves[axis]);
                }
            }
            // `<=`: at equal distance an element of lower index may follow, which wins the tie.
            if near <= far && near <= limit {
                let number = step ^ self.mirror;
                limit = self.descend(children + number as u32, cube.part(number), near, far, limit)?;
            }
        }
        Some(limit)
    }
}

impl Structure for Octree {
    fn visit(&self, ray: &WideRay, min: f64, limit: f64, visitor: &mut impl Visitor) -> Option<f64> {
        let Some((near, far)) = ray.inside(&self.bounds, min, limit) else {
            return Some(limit);
        };
        let [x, y, z] = ray.near_side;
        let mut walk = Walk {
            tree: self,
            ray,
            mirror: x | y << 1 | z << 2,
            mailbox: Mailbox::new(),
            visitor,
        };
        walk.descend(0, self.cube, near, far, limit)
    }

    fn statistics(&self) -> Statistics {
        let inner = |node: &&Node| matches!(node, Node::Inner { .. });
        let empty = |node: &&Node| matches!(node, Node::Leaf { count: 0, .. });
        let nodes = self.nodes.iter().filter(inner).count();
        let bytes = size_of_val(&*self.nodes) + size_of_val(&*self.references) + size_of_val(&*self.elements);
        Statistics::from([
            ("nodes", nodes as f64),
            ("leaves", (self.nodes.len() - nodes) as f64),
            ("empty_leaves", self.nodes.iter().filter(empty).count() as f64),
            ("references", self.references.len() as f64),
            ("depth", f64::from(self.depth)),
            // Normalized by the area of the bounds, which may be zero.
            (
                "sah_cost",
                self.cost(0, &self.cube) / self.bounds.half_area().max(f64::MIN_POSITIVE),
            ),
            ("bytes", bytes as f64),
        ])
    }

    fn debug_bounds(&self, deepest: usize) -> Vec<DebugBounds> {
        let mut found = Vec::new();
        if !self.elements.is_empty() {
            self.outline(0, &self.cube, 0, deepest, &mut found);
        }
        found
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use whitstone_testkit::{accelerator_laws, accelerator_laws_of_part};

    #[test]
    fn obeys_the_laws_of_accelerators() {
        for text in ["", "max_leaf = 1\nmax_depth = 24", "max_leaf = 1"] {
            accelerator_laws::<Octree>(text);
        }
        // Leaves that hold a good part of the elements.
        accelerator_laws_of_part::<Octree>("max_depth = 1", 8);
    }
}
