//! A binary space partition (BSP) by planes of *any* orientation; `kdtree` uses axis-parallel
//! planes only.
//!
//! - Build: Ize, Wald, Parker, *Ray tracing with the BSP tree*, 2008: SAH over polyhedra (section
//!   3). Candidates are axis-parallel planes and, where few elements are left, the planes of
//!   triangles. Triangles are clipped to polygons at each plane (Fuchs, Kedem, Naylor, *On visible
//!   surface generation by a priori tree structures*, 1980). `split = "midpoint"` and `"median"`
//!   cut across the principal axis of the cell's contents; see `build`.
//! - Traversal: as in a kd-tree, with two dot products per plane; see `tree`.
//! - Cost model: as in `kdtree`, with the areas of the polyhedra, but a leaf costs one test per
//!   element and a step 1.6 tests. The benefit is tight cells: a slanted triangle fills only a
//!   small part of its axis-parallel box, whereas a plane along it leaves one side empty at once.
//!   With the few candidates tried here that does not pay off (figures in `docs/accelerators.md`),
//!   and the build is by far the slowest. Memory: 40 bytes a node, at most 8 references per element
//!   on average, after which cells are not divided further. Build: O(n log n) with a large factor.
//!
//! - Twin: none needed; the image does not depend on it.
//! - Example: `scenes/accelerators/bsp.toml`.

mod build;
mod tree;

use crate::support::elements::Searched;
use crate::support::partition::{Cut, MAX_DEPTH};
use crate::support::polyhedron::{Plane, Polyhedron};
use crate::support::split::Split;
use schemars::JsonSchema;
use serde::Deserialize;
use std::num::NonZeroU32;
use std::sync::Arc;
use whitstone_core::config::IntegerIn;
use whitstone_core::{Accelerator, Accelerators, Context, Geometry, Plugin, SceneErrors};

/// A BSP tree with planes of any orientation: tight cells, but a slow build.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// Cells of at most this many elements are not cut.
    #[serde(default = "two")]
    max_leaf: NonZeroU32,
    /// Maximum depth of the tree.
    #[serde(default)]
    #[schemars(extend("x-default" = "8 + 1.3 log2(number of elements)"))]
    max_depth: Option<IntegerIn<1, { MAX_DEPTH as u32 }>>,
    /// How to choose the position of a cut.
    #[serde(default)]
    split: Split,
}

fn two() -> NonZeroU32 {
    const { NonZeroU32::new(2).unwrap() }
}

/// The plugin.
pub struct Bsp;

impl Plugin<Accelerators> for Bsp {
    const TYPE: &'static str = "bsp";
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

impl Cut for Plane {
    type Cell = Polyhedron;

    fn half_area(cell: &Polyhedron) -> f64 {
        cell.half_area()
    }

    fn halves(&self, cell: &Polyhedron) -> [Polyhedron; 2] {
        cell.cut(self)
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
            "split = \"midpoint\"",
            "split = \"between\"",
            "split = \"median\"\nmax_leaf = 1",
        ] {
            accelerator_laws::<Bsp>(text);
        }
        // Two leaves, which hold half of the elements each.
        accelerator_laws_of_part::<Bsp>("max_depth = 1", 8);
    }
}
