//! A kd-tree: space is cut by axis-parallel planes, and an element is referred to from every cell it lies in.
//!
//! - Build: Wald and Havran, *On building fast kd-trees for ray tracing, and on doing that in O(N log N)*,
//!   2006: the surface area heuristic over the ends of the elements' boxes (section 4.2), boxes cut at each plane
//!   ("perfect splits", section 3.3, by boxes instead of polygons), a bonus for empty space (section 3.4). Nodes of
//!   many elements are cut at the borders of bins instead (Shevtsov, Soupikov, Kapustin 2007); see `build`.
//! - Traversal: in order, with an interval of the ray for each cell; see `partition`.
//! - Cost model: a ray that passes a cell passes a part of it with the ratio of their areas as chance. So a cut
//!   costs 1.2 + (A_l n_l + A_r n_r) / A tests of an element and a leaf costs n; if one side is empty the cut
//!   counts a fifth less. Cells do not overlap, so that nearest hits end the search early, but an element is
//!   referred to several times: at most 8 times on average, after which cells stay as they are. Build: O(n log² n).
//!
//! - Twin: none needed; the image does not depend on it.
//! - Example: `scenes/accelerators/kdtree.toml`.

mod build;

use crate::elements::{Searched, WideRay};
use crate::partition::{Cut, MAX_DEPTH, Partition, Passage};
use crate::split::{Axes, Split};
use schemars::JsonSchema;
use serde::Deserialize;
use std::num::NonZeroU32;
use std::sync::Arc;
use whitstone_core::config::IntegerIn;
use whitstone_core::{Aabb, Accelerator, Accelerators, Context, Geometry, Outline, Plugin, SceneErrors};

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

/// The plugin.
pub struct KdTree;

impl Plugin<Accelerators> for KdTree {
    const TYPE: &'static str = "kdtree";
    type Config = Config;

    fn build(
        config: Config,
        geometry: Arc<Geometry>,
        _: &mut dyn Context,
    ) -> Result<Box<dyn Accelerator>, SceneErrors> {
        Ok(Box::new(Searched::new(geometry, |geometry, elements| {
            build::build(geometry, &elements, &config)
        })?))
    }
}

/// A plane across an axis. Packed, so that a node of the tree has 16 bytes.
#[derive(Clone, Copy, Debug)]
#[repr(Rust, packed(4))]
struct AxisCut {
    plane: f64,
    axis: Axis,
}

const _: () = assert!(Partition::<AxisCut>::NODE_BYTES == 16);

/// A coordinate axis; that there are no others leaves room to tell nodes from leaves.
#[derive(Clone, Copy, Debug)]
enum Axis {
    X,
    Y,
    Z,
}

impl AxisCut {
    fn new(axis: usize, plane: f64) -> Self {
        Self {
            plane,
            axis: [Axis::X, Axis::Y, Axis::Z][axis],
        }
    }

    fn axis(&self) -> usize {
        self.axis as usize
    }
}

impl Cut for AxisCut {
    type Cell = Aabb;

    fn cell(aabb: &Aabb) -> Aabb {
        *aabb
    }

    fn half_area(cell: &Aabb) -> f64 {
        cell.half_area()
    }

    fn outline(depth: usize, cell: &Aabb) -> Outline {
        Outline::of_box(depth, cell)
    }

    fn halves(&self, cell: &Aabb) -> [Aabb; 2] {
        let mut halves = [*cell; 2];
        halves[0].max[self.axis()] = self.plane;
        halves[1].min[self.axis()] = self.plane;
        halves
    }

    #[inline]
    fn passage(&self, ray: &WideRay) -> Passage {
        let axis = self.axis();
        Passage {
            side: ray.near_side[axis] as u32,
            leaves: ray.leaves(axis, self.plane),
            arrives: ray.arrives(axis, self.plane),
        }
    }

    fn is_askew(&self) -> bool {
        false
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
