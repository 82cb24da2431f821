//! An 8-wide SIMD bounding volume hierarchy (BVH): the default accelerator of all but tiny scenes.
//!
//! - Nodes hold eight boxes in `f32`, leaves up to eight triangles in `f32`. Tests in `f64` decide
//!   the cases that the `f32` tests leave open, and compute every hit that is returned.
//!   `docs/accelerators.md` proves that no hit is missed.
//! - Build: a binary BVH (`morton`, `binned` or `spatial`), collapsed to eight children per node
//!   (`wide`). Traversal: `search`, which tests eight boxes at once and selects near and far planes
//!   by the signs of the direction (Wald, Benthin, Boulos, *Getting rid of packets*, 2008;
//!   Fuetterling et al., *Accelerated single ray tracing for wide vector units*, HPG 2017).
//!
//! - Twin: none needed; the image does not depend on it.
//! - Example: `scenes/accelerators/bvh.toml`.

mod binned;
mod morton;
mod node;
mod packet;
mod search;
mod spatial;
mod stream;
mod tree;
mod wide;
#[cfg(all(test, feature = "all"))]
mod worst_cases;

use crate::support::elements::{MAX_ELEMENTS, check_count};
use crate::support::leaves::Leaves;
use crate::support::leaves::child::{Child, Kind};
use crate::support::leaves::items::{Item, Items};
use crate::support::leaves::state::{Query, Search};
use binned::Binned;
use node::Node;
use packet::USUAL_DEPTH;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use spatial::Spatial;
use std::sync::Arc;
use std::time::Instant;
use tree::Tree;
use whitstone_core::stream::{HitStream, Lanes, RayStream};
use whitstone_core::{
    Aabb, Accelerator, Accelerators, Context, DVec3, DebugBounds, Geometry, Interval, Plugin,
    PreliminaryIntersection, Ray, SceneErrors, SelfHitFilter, Statistics,
};
use whitstone_simd::{Level, with_lanes};
use wide::Wide;

/// An 8-wide SIMD bounding volume hierarchy (BVH): the best choice for all but tiny scenes.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// Trade-off between build time and ray tracing speed.
    #[serde(default)]
    quality: Quality,
}

/// Trade-off between build time and ray tracing speed.
#[derive(Clone, Copy, Debug, Default, Deserialize, Serialize, JsonSchema, PartialEq, Eq)]
#[serde(rename_all = "snake_case")]
pub enum Quality {
    /// Fastest build, for images with few rays.
    Fast,
    /// Suits most images.
    #[default]
    Balanced,
    /// Fastest ray tracing, slowest build.
    Best,
}

/// The `bvh` accelerator; see the module documentation.
pub struct Bvh {
    leaves: Leaves,
    nodes: Vec<Node>,
    root: Option<Child>,
    /// Whether the tree is too deep for the stack of the packet traversal.
    deep: bool,
    statistics: Statistics,
}

/// Maximum depth of the tree; all builds enforce it.
const MAX_DEPTH: usize = 64;

impl Plugin<Accelerators> for Bvh {
    const TYPE: &'static str = "bvh";
    type Config = Config;

    fn build(
        config: Config,
        geometry: Arc<Geometry>,
        _: &mut dyn Context,
    ) -> Result<Box<dyn Accelerator>, SceneErrors> {
        // Spatial splits increase the number of references by at most 30%.
        let spare = if config.quality == Quality::Best { 4 } else { 0 };
        check_count(&geometry, MAX_ELEMENTS / 16 * (16 - spare))?;
        Ok(Box::new(Self::new(geometry, config.quality)))
    }
}

impl Bvh {
    fn new(geometry: Arc<Geometry>, quality: Quality) -> Self {
        let start = Instant::now();
        let items = Items::new(&geometry);
        let bounded = || items.each(|number| items.item(number));
        let of_tree = |Tree { nodes, items: order }| (nodes, items.contents(&order, Item::number));
        let (nodes, contents) = match quality {
            Quality::Fast => morton::build(&items),
            Quality::Balanced => {
                let binned = Binned {
                    max_leaf: 3,
                    bins: 32,
                    items_a_bin: 16,
                };
                of_tree(binned.build(bounded()))
            }
            Quality::Best => {
                let corners = items.corners();
                of_tree(Spatial { corners: &corners }.build(bounded()))
            }
        };
        let wide = Wide::new(&nodes, contents);
        let Items { frame, unbounded, .. } = items;
        let leaves = Leaves::new(geometry, frame, unbounded, wide.slots, wide.numbers);
        let bytes = size_of_val(&*wide.nodes) + leaves.bytes();
        let statistics = Statistics::from([
            ("elements", (leaves.slots.len() + leaves.unbounded.len()) as f64),
            ("unbounded", leaves.unbounded.len() as f64),
            ("nodes", wide.nodes.len() as f64),
            ("leaves", wide.leaves as f64),
            ("depth", wide.depth as f64),
            ("sah_cost", wide.cost),
            ("bytes", bytes as f64),
            ("build_seconds", start.elapsed().as_secs_f64()),
        ]);
        Self {
            leaves,
            nodes: wide.nodes,
            root: wide.root,
            deep: wide.depth > USUAL_DEPTH,
            statistics,
        }
    }

    fn outline(&self, child: Child, aabb: &Aabb, depth: usize, deepest: usize, found: &mut Vec<DebugBounds>) {
        found.push(DebugBounds::of_box(depth, aabb));
        if let Kind::Inner(node) = child.kind()
            && depth < deepest
        {
            let node = &self.nodes[node];
            for (i, child) in node.children.map(Child).into_iter().enumerate() {
                let corner = |side: usize| node.planes.map(|sides| f64::from(sides[side][i])).into();
                let (min, max): (DVec3, DVec3) = (corner(0), corner(1));
                // The box of an empty child slot is inverted (min > max).
                if min.cmple(max).all() {
                    let [min, max] = [min, max].map(|p| self.leaves.frame.world(p));
                    self.outline(child, &Aabb { min, max }, depth + 1, deepest, found);
                }
            }
        }
    }

    /// Finds any hit if `ANY`, else the nearest.
    #[inline(always)]
    fn find<const ANY: bool>(
        &self,
        ray: &Ray,
        interval: Interval,
        skip: SelfHitFilter,
    ) -> Option<PreliminaryIntersection> {
        let query = Query { ray, interval, skip };
        // Nodes and leaves are eight wide, so AVX-512 gains nothing for a single ray. It is 4%
        // slower on some processors.
        with_lanes(Level::Avx2, Search::<ANY, _>(self, &query))
    }
}

impl Accelerator for Bvh {
    fn intersect(
        &self,
        ray: &Ray,
        interval: Interval,
        skip: SelfHitFilter,
    ) -> Option<PreliminaryIntersection> {
        self.find::<false>(ray, interval, skip)
    }

    fn occluded(&self, ray: &Ray, interval: Interval, skip: SelfHitFilter) -> bool {
        self.find::<true>(ray, interval, skip).is_some()
    }

    fn intersect_stream(&self, rays: &RayStream, hits: &mut HitStream) {
        hits.clear(rays);
        stream::intersect(self, rays, hits);
    }

    fn occluded_stream(&self, rays: &RayStream, hidden: &mut Lanes<bool>) {
        stream::occluded(self, rays, hidden);
    }

    fn statistics(&self) -> Statistics {
        self.statistics.clone()
    }

    fn debug_bounds(&self, deepest: usize) -> Option<Vec<DebugBounds>> {
        let whole = self.leaves.bounds();
        let mut found = Vec::new();
        if let Some(root) = self.root {
            self.outline(root, &whole, 0, deepest, &mut found);
        }
        Some(found)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use whitstone_testkit::accelerator_laws;

    #[test]
    fn obeys_the_laws_of_accelerators() {
        accelerator_laws::<Bvh>("");
        accelerator_laws::<Bvh>("quality = \"fast\"");
        accelerator_laws::<Bvh>("quality = \"best\"");
    }
}
