//! A binary space partition by planes in *any* direction; `kdtree` is the one whose planes follow the axes.
//!
//! - Build: Ize, Wald, Parker, *Ray tracing with the BSP tree*, 2008: the surface area heuristic over polyhedra
//!   (section 3), with the planes of the triangles themselves as candidates besides axis-parallel ones, where few
//!   elements are left. Triangles are cut into polygons at each plane (Fuchs, Kedem, Naylor, *On visible surface
//!   generation by a priori tree structures*, 1980). `split = "midpoint"` and `"median"` cut across the principal axis
//!   of what is in the cell; see `build`.
//! - Traversal: that of a kd-tree, in order with an interval for each cell, with two products of vectors for each
//!   plane.
//! - Cost model: that of `kdtree`, with the areas of the polyhedra; a step takes about twice as long. What it buys are
//!   cells that fit: a triangle that lies askew fills a corner of every axis-parallel box, and a plane along
//!   it leaves empty space on one side at once. There are fewer tests than in any other structure here, and the build
//!   is by far the slowest. Memory: 48 bytes a node, at most 8 references to an element on average, after which
//!   cells stay as they are. Build: O(n log n) with a large factor.
//!
//! - Twin: none needed; the image does not depend on it.
//! - Example: `scenes/accelerators/bsp.toml`.

mod build;

use crate::elements::{Elements, Mailbox, Searched, Structure, WideRay};
use crate::polyhedron::Plane;
use crate::split::Split;
use schemars::JsonSchema;
use serde::Deserialize;
use std::num::NonZeroU32;
use std::sync::Arc;
use whitstone_core::config::IntegerIn;
use whitstone_core::{
    Aabb, Accelerator, Accelerators, Context, Element, Geometry, Plugin, SceneErrors, Statistics,
};

/// Space cut by planes in any direction: few tests for each ray, and a slow build.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// Cells of so few elements are not cut.
    #[serde(default = "two")]
    max_leaf: NonZeroU32,
    /// Longest path from the root; 8 + 1.3 log2 of the number of elements if left out.
    #[serde(default)]
    max_depth: Option<IntegerIn<1, { MAX_DEPTH as u32 }>>,
    /// Where to cut.
    #[serde(default)]
    split: Split,
}

fn two() -> NonZeroU32 {
    const { NonZeroU32::new(2).unwrap() }
}

/// No path from the root is longer.
const MAX_DEPTH: usize = 64;

/// The tree.
pub struct Bsp {
    /// Around all elements.
    bounds: Aabb,
    /// The root is 0.
    nodes: Vec<Node>,
    /// What the leaves hold: indices of elements.
    references: Vec<u32>,
    elements: Vec<Element>,
    depth: usize,
    sah_cost: f64,
}

#[derive(Clone, Copy, Debug)]
enum Node {
    /// Two children side by side, the first below the plane.
    Inner { plane: Plane, children: u32 },
    /// A range of references.
    Leaf { first: u32, count: u32 },
}

impl Plugin<Accelerators> for Bsp {
    const TYPE: &'static str = "bsp";
    type Config = Config;

    fn build(
        config: Config,
        geometry: Arc<Geometry>,
        _: &mut dyn Context,
    ) -> Result<Box<dyn Accelerator>, SceneErrors> {
        let build = |geometry: &Geometry, elements: Elements| build::build(geometry, &elements, &config);
        Ok(Box::new(Searched::new(geometry, build)))
    }
}

/// A cell that is visited later: its node and the part of the ray in it.
type Later = (u32, f64, f64);

impl Structure for Bsp {
    #[inline]
    fn visit(
        &self,
        ray: &WideRay,
        min: f64,
        mut limit: f64,
        visit: &mut impl FnMut(Element) -> Option<f64>,
    ) -> Option<f64> {
        let Some((mut near, mut far)) = ray.inside(&self.bounds, min, limit) else {
            return Some(limit);
        };
        let mut mailbox = Mailbox::new();
        let mut stack: [Later; MAX_DEPTH] = [(0, 0.0, 0.0); MAX_DEPTH];
        let (mut height, mut node) = (0, 0);
        loop {
            match self.nodes[node as usize] {
                Node::Inner { plane, children } => {
                    let along = ray.along(plane.normal);
                    let side = u32::from(along.backwards);
                    let (before, beyond) = (children + side, children + 1 - side);
                    let leaves = far.min(along.leaves(plane.at));
                    let arrives = near.max(along.arrives(plane.at));
                    match (near <= leaves, arrives <= far) {
                        (true, true) => {
                            stack[height] = (beyond, arrives, far);
                            height += 1;
                            (node, far) = (before, leaves);
                            continue;
                        }
                        (true, false) => {
                            (node, far) = (before, leaves);
                            continue;
                        }
                        (false, true) => {
                            (node, near) = (beyond, arrives);
                            continue;
                        }
                        (false, false) => {}
                    }
                }
                Node::Leaf { first, count } => {
                    for &element in &self.references[first as usize..(first + count) as usize] {
                        if mailbox.is_new(element) {
                            limit = visit(self.elements[element as usize])?;
                        }
                    }
                }
            }
            loop {
                if height == 0 {
                    return Some(limit);
                }
                height -= 1;
                (node, near, far) = stack[height];
                // At equal distance an element of lower number may be in there.
                if near <= limit {
                    break;
                }
            }
        }
    }

    fn statistics(&self) -> Statistics {
        let leaf = |node: &&Node| matches!(node, Node::Leaf { .. });
        let empty = |node: &&Node| matches!(node, Node::Leaf { count: 0, .. });
        let askew = |node: &&Node| match node {
            Node::Inner { plane, .. } => plane.normal.abs().max_element() < 1.0,
            Node::Leaf { .. } => false,
        };
        let leaves = self.nodes.iter().filter(leaf).count();
        let bytes = size_of_val(&*self.nodes) + size_of_val(&*self.references) + size_of_val(&*self.elements);
        Statistics::from([
            ("nodes", (self.nodes.len() - leaves) as f64),
            ("askew", self.nodes.iter().filter(askew).count() as f64),
            ("leaves", leaves as f64),
            ("empty_leaves", self.nodes.iter().filter(empty).count() as f64),
            ("references", self.references.len() as f64),
            ("depth", self.depth as f64),
            ("sah_cost", self.sah_cost),
            ("bytes", bytes as f64),
        ])
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
            "max_leaf = 1\nmax_depth = 64",
            "max_depth = 1",
            "split = \"midpoint\"",
            "split = \"median\"\nmax_leaf = 1",
        ] {
            accelerator_laws::<Bsp>(text);
        }
    }
}
