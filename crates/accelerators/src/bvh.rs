//! A wide SIMD bounding volume hierarchy (BVH): the default accelerator of all but tiny scenes.
//!
//! - Nodes hold sixteen boxes with AVX-512, else eight, in `f32`. Leaves hold up to eight
//!   triangles, which are tested in `f64`. `docs/accelerators.md` proves that no hit is missed.
//! - Build: a binary BVH (`morton`, `binned` or `spatial`), collapsed to wide nodes (`wide`).
//!   Traversal: `search` for one ray and `stream` for many. A step tests all boxes of a node at
//!   once and selects near and far planes by the signs of the direction (Wald, Benthin, Boulos,
//!   *Getting rid of packets*, 2008; Fuetterling et al., *Accelerated single ray tracing for wide
//!   vector units*, HPG 2017).
//!
//! - Twin: none needed; the image does not depend on it.
//! - Example: `scenes/accelerators/bvh.toml`.

mod binned;
mod morton;
mod node;
mod search;
mod spatial;
mod stack;
mod stream;
mod tree;
mod wide;

use crate::support::elements::{MAX_ELEMENTS, check_count};
use crate::support::leaves::child::{Child, Kind};
use crate::support::leaves::items::{Item, Items};
use crate::support::leaves::search::{Query, Search};
use crate::support::leaves::{Leaves, Number};
use binned::Binned;
use node::Node;
use schemars::JsonSchema;
use search::Tree;
use serde::{Deserialize, Serialize};
use spatial::Spatial;
use std::sync::Arc;
use std::time::Instant;
use stream::{Answers, Places, Stream};
use whitstone_core::stream::{HitStream, Lanes, RayStream};
use whitstone_core::{
    Aabb, Accelerator, Accelerators, Context, DVec3, DebugBounds, Geometry, Interval, Plugin,
    PreliminaryIntersection, Ray, SceneErrors, SelfHitFilter, Statistics,
};
use whitstone_simd::{Level, with_eight_lanes, with_sixteen_lanes};
use wide::Wide;

/// A wide SIMD bounding volume hierarchy (BVH): the best choice for all but tiny scenes.
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
    nodes: Nodes,
    /// The vector instructions to use for nodes of eight.
    level: Level,
    statistics: Statistics,
}

/// The hierarchy, by its width.
enum Nodes {
    Eight(Hierarchy<8>),
    Sixteen(Hierarchy<16>),
}

/// Nodes with up to `N` children.
struct Hierarchy<const N: usize> {
    nodes: Vec<Node<N>>,
    /// Arbitrary if there are no elements.
    root: Child,
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
        Ok(Box::new(Self::new(geometry, config.quality, Level::current())))
    }
}

impl Bvh {
    /// Builds for processors of this level.
    fn new(geometry: Arc<Geometry>, quality: Quality, level: Level) -> Self {
        if level == Level::Avx512 {
            Self::of_width(geometry, quality, level, Nodes::Sixteen)
        } else {
            Self::of_width(geometry, quality, level, Nodes::Eight)
        }
    }

    fn of_width<const N: usize>(
        geometry: Arc<Geometry>,
        quality: Quality,
        level: Level,
        nodes: impl FnOnce(Hierarchy<N>) -> Nodes,
    ) -> Self {
        let start = Instant::now();
        let shapes = geometry.clone();
        let items = Items::new(&shapes);
        let (wide, leaves) = if items.single {
            build::<f32, N>(items, geometry, quality)
        } else {
            build::<f64, N>(items, geometry, quality)
        };
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
        let root = wide.root.unwrap_or_default();
        Self {
            leaves,
            nodes: nodes(Hierarchy {
                nodes: wide.nodes,
                root,
            }),
            level,
            statistics,
        }
    }

    fn tree<'a, const N: usize>(&'a self, hierarchy: &'a Hierarchy<N>) -> Tree<'a, N> {
        Tree {
            leaves: &self.leaves,
            hierarchy,
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
        match &self.nodes {
            Nodes::Eight(nodes) => with_eight_lanes(self.level, Search::<ANY, _>(&self.tree(nodes), &query)),
            Nodes::Sixteen(nodes) => with_sixteen_lanes(Search::<ANY, _>(&self.tree(nodes), &query)),
        }
    }

    /// The same for each ray of a stream.
    #[inline(always)]
    fn find_stream<const ANY: bool>(&self, rays: &RayStream, answers: &mut impl Answers) {
        Places::with(|places| match &self.nodes {
            Nodes::Eight(nodes) => {
                let tree = self.tree(nodes);
                let stream = Stream::<ANY, _, _> {
                    tree,
                    rays,
                    answers,
                    places,
                };
                with_eight_lanes(self.level, stream);
            }
            Nodes::Sixteen(nodes) => {
                let tree = self.tree(nodes);
                let stream = Stream::<ANY, _, _> {
                    tree,
                    rays,
                    answers,
                    places,
                };
                with_sixteen_lanes(stream);
            }
        });
    }
}

/// Builds the hierarchy and its leaves.
fn build<T: Number, const N: usize>(
    items: Items<'_>,
    geometry: Arc<Geometry>,
    quality: Quality,
) -> (Wide<N>, Leaves) {
    let bounded = || items.each(|number| items.item(number));
    let of_tree = |tree: tree::Tree| (tree.nodes, items.contents::<T, _>(&tree.items, Item::number));
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
    let mut corners = contents.corners.into_flattened();
    let wide = Wide::new(&nodes, &contents.slots, &mut corners);
    let Items { frame, unbounded, .. } = items;
    let leaves = Leaves {
        geometry,
        frame,
        unbounded,
        slots: contents.slots,
        corners: T::corners(corners),
    };
    (wide, leaves)
}

impl<const N: usize> Hierarchy<N> {
    fn outline(
        &self,
        child: Child,
        leaves: &Leaves,
        aabb: &Aabb,
        levels: [usize; 2],
        found: &mut Vec<DebugBounds>,
    ) {
        let [depth, deepest] = levels;
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
                    let [min, max] = [min, max].map(|p| leaves.frame.world(p));
                    self.outline(child, leaves, &Aabb { min, max }, [depth + 1, deepest], found);
                }
            }
        }
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
        self.find_stream::<false>(rays, hits);
    }

    fn occluded_stream(&self, rays: &RayStream, hidden: &mut Lanes<bool>) {
        self.find_stream::<true>(rays, hidden);
    }

    fn statistics(&self) -> Statistics {
        self.statistics.clone()
    }

    fn debug_bounds(&self, deepest: usize) -> Option<Vec<DebugBounds>> {
        let whole = self.leaves.bounds();
        let mut found = Vec::new();
        if !self.leaves.slots.is_empty() {
            let levels = [0, deepest];
            match &self.nodes {
                Nodes::Eight(nodes) => nodes.outline(nodes.root, &self.leaves, &whole, levels, &mut found),
                Nodes::Sixteen(nodes) => nodes.outline(nodes.root, &self.leaves, &whole, levels, &mut found),
            }
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

    /// A `bvh` for processors of lower levels.
    struct Limited<const AVX2: bool>;

    impl<const AVX2: bool> Plugin<Accelerators> for Limited<AVX2> {
        const TYPE: &'static str = "bvh";
        type Config = Config;

        fn build(
            config: Config,
            geometry: Arc<Geometry>,
            _: &mut dyn Context,
        ) -> Result<Box<dyn Accelerator>, SceneErrors> {
            let level = if AVX2 { Level::Avx2 } else { Level::Baseline };
            Ok(Box::new(Bvh::new(
                geometry,
                config.quality,
                level.min(Level::current()),
            )))
        }
    }

    #[test]
    fn obeys_them_with_fewer_instructions() {
        accelerator_laws::<Limited<true>>("quality = \"best\"");
        accelerator_laws::<Limited<false>>("quality = \"best\"");
    }
}
