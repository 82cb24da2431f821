//! A kd-tree: space is cut by axis-parallel planes, and an element is referred to from every cell it lies in.
//!
//! - Build: Wald and Havran, *On building fast kd-trees for ray tracing, and on doing that in O(N log N)*,
//!   2006: the surface area heuristic over the ends of the elements' boxes (section 4.2), boxes cut at each plane
//!   ("perfect splits", section 3.3, by boxes instead of polygons), a bonus for empty space (section 3.4). Nodes of
//!   many elements are cut at the borders of bins instead (Shevtsov, Soupikov, Kapustin 2007); see `build`.
//! - Traversal: in order, with an interval of the ray for each cell (the notes' t_min, t*, t_max; Havran,
//!   *Heuristic ray shooting algorithms*, 2000, appendix C). The ray is as wide as rounding may need (see
//!   `elements`), so it arrives at a plane before it leaves the side before, and the intervals overlap a little.
//! - Cost model: a ray that passes a cell passes a part of it with the ratio of their areas as chance. So a cut
//!   costs 1.2 + (A_l n_l + A_r n_r) / A tests of an element and a leaf costs n; if one side is empty the cut
//!   counts a fifth less. Cells do not overlap, so that nearest hits end the search early, but an element is
//!   referred to several times: at most 8 times on average, after which cells stay as they are. Build: O(n log² n).
//!
//! - Twin: none needed; the image does not depend on it.
//! - Example: `scenes/accelerators/kdtree.toml`.

mod build;

use crate::elements::{Elements, Mailbox, Searched, Structure, WideRay};
use crate::split::{Axes, Split};
use schemars::JsonSchema;
use serde::Deserialize;
use std::num::NonZeroU32;
use std::sync::Arc;
use whitstone_core::config::IntegerIn;
use whitstone_core::{
    Aabb, Accelerator, Accelerators, Context, Element, Geometry, Plugin, SceneErrors, Statistics,
};

/// A kd-tree: cells that do not overlap, with elements in several of them.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// Cells of so few elements are not cut, except by the surface area heuristic, which decides by cost.
    #[serde(default = "four")]
    max_leaf: NonZeroU32,
    /// Longest path from the root; 8 + 1.3 log2 of the number of elements if left out.
    #[serde(default)]
    max_depth: Option<IntegerIn<1, { MAX_DEPTH as u32 }>>,
    /// Where to cut.
    #[serde(default)]
    split: Split,
    /// Along which axes to look for a cut.
    #[serde(default)]
    axes: Axes,
}

fn four() -> NonZeroU32 {
    const { NonZeroU32::new(4).unwrap() }
}

/// No path from the root is longer.
const MAX_DEPTH: usize = 64;

/// The tree.
pub struct KdTree {
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
    /// Two children side by side, the first with the smaller coordinates.
    Inner { axis: u8, children: u32, plane: f64 },
    /// A range of references.
    Leaf { first: u32, count: u32 },
}

impl Plugin<Accelerators> for KdTree {
    const TYPE: &'static str = "kdtree";
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

impl Structure for KdTree {
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
                Node::Inner {
                    axis,
                    children,
                    plane,
                } => {
                    let axis = usize::from(axis);
                    let near_side = ray.near_side[axis] as u32;
                    let (before, beyond) = (children + near_side, children + 1 - near_side);
                    // t* of the notes, which is two for a wide ray.
                    let leaves = far.min(ray.leaves(axis, plane));
                    let arrives = near.max(ray.arrives(axis, plane));
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
        let inner = |node: &&Node| matches!(node, Node::Inner { .. });
        let empty = |node: &&Node| matches!(node, Node::Leaf { count: 0, .. });
        let nodes = self.nodes.iter().filter(inner).count();
        let bytes = size_of_val(&*self.nodes) + size_of_val(&*self.references) + size_of_val(&*self.elements);
        Statistics::from([
            ("nodes", nodes as f64),
            ("leaves", (self.nodes.len() - nodes) as f64),
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
            "axes = \"longest\"",
            "split = \"midpoint\"",
            "split = \"midpoint\"\naxes = \"longest\"\nmax_leaf = 1",
            "split = \"median\"",
            "split = \"median\"\naxes = \"longest\"\nmax_leaf = 1",
        ] {
            accelerator_laws::<KdTree>(text);
        }
    }
}
