//! An octree: a cube is divided into eight, and each of these again, as long as many elements are
//! in it.
//!
//! - Build: Glassner, *Space subdivision for fast ray tracing*, 1984. An element that straddles is
//!   referred to from each cell that it lies in; triangles are tested against cells exactly
//!   (`overlaps`).
//! - Traversal: Revelles, Ureña, Lastra, *An efficient parametric algorithm for octree traversal*,
//!   2000: top down, the ray's interval in a child from that in its parent and the three planes
//!   through the middle, no boxes. Their automaton names the one next child; a ray that is as wide
//!   as rounding may need (see `elements`) can be in two at once, so here the eight are gone
//!   through in the order of the ray.
//! - Cost model: a cell is divided if it holds more than `max_leaf` elements. No cost is estimated:
//!   cuts are in the middle whatever lies there, which costs 1.3 to 2.3 times the time of a
//!   kd-tree, while a step does three cuts at once. Empty space is skipped in large cells, which is
//!   what a grid lacks. Memory: at most 8 references to an element on average, after which cells
//!   stay as they are. Build: O(n log n).
//!
//! - Twin: none needed; the image does not depend on it.
//! - Example: `scenes/accelerators/octree.toml`.

use crate::elements::{
    Elements, Item, MARGIN, Mailbox, Searched, Structure, Visitor, WideRay, bounds, overlaps,
};
use schemars::JsonSchema;
use serde::Deserialize;
use std::num::NonZeroU32;
use std::sync::Arc;
use whitstone_core::config::IntegerIn;
use whitstone_core::{
    Aabb, Accelerator, Accelerators, Context, DVec3, Element, Geometry, Outline, Plugin, SceneErrors,
    Statistics,
};

/// Cubes in cubes: adapts to where the elements are, with cuts in the middle only.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// Most elements that a cell may hold without being divided.
    #[serde(default = "eight")]
    max_leaf: NonZeroU32,
    /// Longest path from the root; 3 + 0.6 log2 of the number of elements if left out.
    #[serde(default)]
    max_depth: Option<IntegerIn<1, 24>>,
}

fn eight() -> NonZeroU32 {
    const { NonZeroU32::new(8).unwrap() }
}

/// Most references to an element, on average.
const MOST_REFERENCES: usize = 8;

/// The tree.
pub struct Octree {
    /// Around all elements, not a cube.
    bounds: Aabb,
    cube: Cube,
    /// The root is 0.
    nodes: Vec<Node>,
    /// What the leaves hold: indices of elements.
    references: Vec<u32>,
    elements: Vec<Element>,
    depth: u32,
}

#[derive(Clone, Copy, Debug)]
enum Node {
    /// Eight children side by side, by the bits of their numbers: 1 for the larger x, 2 for y, 4
    /// for z.
    Inner { children: u32 },
    /// A range of references.
    Leaf { first: u32, count: u32 },
}

#[derive(Clone, Copy, Debug)]
struct Cube {
    center: DVec3,
    /// Half the edge.
    half: f64,
}

impl Cube {
    /// One of the eight parts. The build and every ray compute it alike, to the last bit.
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

/// What stays the same during a build.
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
        let usual = 3.0 + 0.6 * (items.len().max(1) as f64).log2();
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
        let spare = (MOST_REFERENCES - 1) * items.len();
        let cube = tree.cube;
        tree.divide(&builder, 0, all, cube, 0, spare);
        tree
    }

    /// Fills a node, with at most so many references more than it has now.
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
        // What may still be added is shared out by size.
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
    fn outline(&self, node: u32, cube: &Cube, depth: usize, deepest: usize, found: &mut Vec<Outline>) {
        found.push(Outline::of_box(depth, &cube.aabb()));
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
    /// Which elements lie in a part of a cube.
    fn inside(&self, held: &[u32], cube: &Cube, number: usize) -> Vec<u32> {
        let part = cube.part(number).aabb();
        let inside = held.iter().filter(|&&held| {
            let item = &self.items[held as usize];
            let on_side = (0..3).all(|axis| {
                let (plane, aabb) = (cube.center[axis], &item.aabb);
                let above = aabb.max[axis] > plane;
                // What lies in the plane is below it.
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

/// One ray's way through the tree.
struct Walk<'a, V> {
    tree: &'a Octree,
    ray: &'a WideRay,
    /// Which bits of a child's number are turned over, so that child 0 comes first.
    mirror: usize,
    mailbox: Mailbox,
    visitor: &'a mut V,
}

impl<V: Visitor> Walk<'_, V> {
    /// Visits a node, which the ray touches from `near` to `far`. The recursion is as deep as the
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
            // At equal distance an element of lower number may be in there.
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
            ("bytes", bytes as f64),
        ])
    }

    fn outlines(&self, deepest: usize) -> Vec<Outline> {
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
    use whitstone_testkit::accelerator_laws;

    #[test]
    fn obeys_the_laws_of_accelerators() {
        for text in [
            "",
            "max_leaf = 1\nmax_depth = 24",
            "max_leaf = 1",
            "max_depth = 1",
        ] {
            accelerator_laws::<Octree>(text);
        }
    }
}
