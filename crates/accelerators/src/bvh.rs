//! A wide SIMD bounding volume hierarchy (BVH): the default accelerator. Exceptions are tiny scenes
//! and those with many elements that single precision cannot separate or that have no area.
//!
//! - Nodes hold boxes in `f32`, leaves up to eight triangles. `docs/accelerators.md` proves that no
//!   hit is missed.
//! - With AVX-512, nodes have sixteen children, and leaves are tested in `f64` (`exact`).
//! - Otherwise nodes have eight children, and leaves are in `f32`. Tests in `f64` decide the cases
//!   that the `f32` tests leave open, and compute every hit that is returned (`search`, `packet`
//!   and `stream`).
//! - Build: a binary BVH (`morton`, `binned` or `spatial`), collapsed to wide nodes (`wide`).
//!   Traversal tests all boxes of a node at once and selects near and far planes by the signs of
//!   the direction (Wald, Benthin, Boulos, *Getting rid of packets*, 2008; Fuetterling et al.,
//!   *Accelerated single ray tracing for wide vector units*, HPG 2017).
//!
//! - Twin: none needed; the image does not depend on it.
//! - Example: `scenes/accelerators/bvh.toml`.

mod binned;
mod exact;
mod frustum;
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
use crate::support::leaves::child::{Child, Kind, WIDTH};
use crate::support::leaves::filter::NUMBERS;
use crate::support::leaves::items::{Box4, Contents, Item, Items, PARALLEL};
use crate::support::leaves::state::{Counters, Query, Search};
use crate::support::leaves::{Leaves, Number, by_coordinate};
use binned::Binned;
use exact::Sixteen;
use frustum::Proxies;
use morton::Keys;
use node::Node;
use packet::USUAL_DEPTH;
use rayon::prelude::*;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use spatial::Spatial;
use std::sync::Arc;
use std::time::Instant;
use tree::{Binary, Tree};
use whitstone_core::stream::{HitStream, Lanes, RayStream};
use whitstone_core::{
    Aabb, Accelerator, Accelerators, Context, DAffine3, DVec3, DebugBounds, Geometry, Interval, Plugin,
    PreliminaryIntersection, Ray, SceneErrors, SelfHitFilter, Statistics, TraversalStatistics,
};
use whitstone_simd::{Level, with_lanes};
use wide::Wide;

/// A wide SIMD bounding volume hierarchy (BVH): the best choice for most scenes that are not tiny.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// Trade-off between build time and ray tracing speed.
    #[serde(default)]
    quality: Quality,
    /// Sets of rays that are tested against a box at once. The hits do not depend on it.
    #[serde(default)]
    ray_sets: RaySets,
    /// Boxes of a node, all of which a step tests at once. The hits do not depend on it.
    #[serde(default)]
    width: Width,
}

/// Boxes of a node.
#[derive(Clone, Copy, Debug, Default, Deserialize, Serialize, JsonSchema, PartialEq, Eq)]
#[serde(rename_all = "snake_case")]
pub enum Width {
    /// Sixteen where the processor has AVX-512, else eight.
    #[default]
    Auto,
    /// Eight, so that the work of a ray is the same number on every processor.
    Eight,
    /// Sixteen.
    Sixteen,
}

impl Width {
    /// The level of processors that the hierarchy is built for.
    fn level(self) -> Level {
        match self {
            Self::Auto => Level::current(),
            Self::Eight => Level::Avx2,
            Self::Sixteen => Level::Avx512,
        }
    }
}

/// Sets of rays that are tested against a box at once.
#[derive(Clone, Copy, Debug, Default, Deserialize, Serialize, JsonSchema, PartialEq, Eq)]
#[serde(rename_all = "snake_case")]
pub enum RaySets {
    /// None: each ray is traced alone. For measurements.
    None,
    /// Packets: sixteen neighbours whose directions have the same signs visit nodes together; each
    /// box is tested with each of them. For measurements.
    Packets,
    /// Packets, and boxes that bounds on all rays of a packet miss are culled.
    #[default]
    CulledPackets,
    /// Also whole tiles: the up to 256 rays of a stream are skipped if their frustum misses all
    /// boxes at the top of the hierarchy. Gains where large parts of an image are empty.
    Tiles,
}

/// Trade-off between build time and ray tracing speed.
#[derive(Clone, Copy, Debug, Default, Deserialize, Serialize, JsonSchema, PartialEq, Eq)]
#[serde(rename_all = "snake_case")]
pub enum Quality {
    /// `fast` where few rays are expected and the elements are spread evenly, else `balanced`.
    #[default]
    Auto,
    /// Fastest build, for images with few rays.
    Fast,
    /// Suits most images.
    Balanced,
    /// Fastest ray tracing, slowest build.
    Best,
}

/// The `bvh` accelerator; see the module documentation.
pub struct Bvh {
    hierarchy: Hierarchy,
    /// Boxes for the test of tiles; `None` if it is off or a shape is unbounded.
    proxies: Option<Proxies>,
    statistics: Statistics,
}

/// The hierarchy, by the number of children of its nodes.
enum Hierarchy {
    /// With leaves in single precision.
    Eight(Eight),
    /// With leaves tested in double precision, for AVX-512. Their corners are stored in `f32` where
    /// that is exact.
    Sixteen(Sixteen),
}

impl Hierarchy {
    /// Memory.
    fn bytes(&self) -> usize {
        match self {
            Self::Eight(eight) => size_of_val(&*eight.nodes) + eight.leaves.bytes(),
            Self::Sixteen(sixteen) => sixteen.bytes(),
        }
    }
}

/// Nodes of eight boxes, and leaves in single precision.
struct Eight {
    leaves: Leaves,
    nodes: Vec<Node<WIDTH>>,
    root: Option<Child>,
    /// Whether the tree is too deep for the stack of the packet traversal.
    deep: bool,
    sets: RaySets,
}

/// With fewer rays an element than this, a fast build saves more time than its rays cost. Measured
/// with scanned meshes; see `docs/accelerators.md`.
const FEW_RAYS: u64 = 32;

/// A fast build is given up if more elements than this lie in one cell of its grid, where it
/// divides them without regard to their places.
const MAX_IN_CELL: usize = 64;

/// A fast build is given up if its expected cost exceeds that of a balanced binary tree, which is
/// near to the binary logarithm of the number of elements, by more than this factor. Scanned meshes
/// and rooms have 0.6 to 1.2.
const MAX_COST: f64 = 3.0;

/// Maximum depth of the tree; all builds enforce it.
const MAX_DEPTH: usize = 64;

impl Plugin<Accelerators> for Bvh {
    const TYPE: &'static str = "bvh";
    type Config = Config;

    fn build(
        config: Config,
        geometry: Arc<Geometry>,
        context: &mut dyn Context,
    ) -> Result<Box<dyn Accelerator>, SceneErrors> {
        // Spatial splits increase the number of references by at most 30%.
        let spare = if config.quality == Quality::Best { 4 } else { 0 };
        check_count(&geometry, MAX_ELEMENTS / 16 * (16 - spare))?;
        let few = |rays: u64| rays < FEW_RAYS * geometry.elements().count() as u64;
        let quality = match config.quality {
            Quality::Auto if !context.expected_rays().is_some_and(few) => Quality::Balanced,
            quality => quality,
        };
        Ok(Box::new(
            Self::new(geometry, quality, config.width.level()).with(config.ray_sets),
        ))
    }
}

impl Bvh {
    /// Builds for processors of this level.
    fn new(geometry: Arc<Geometry>, quality: Quality, level: Level) -> Self {
        let start = Instant::now();
        let shapes = geometry.clone();
        let items = Items::new(&shapes);
        let mut statistics = Statistics::new();
        let hierarchy = if level < Level::Avx512 {
            let (wide, leaves) = build::<f32, WIDTH>(items, geometry, quality, &mut statistics);
            Hierarchy::Eight(Eight {
                leaves,
                nodes: wide.nodes,
                root: wide.root,
                deep: wide.depth > USUAL_DEPTH,
                sets: RaySets::default(),
            })
        } else {
            let (wide, leaves) = if items.frame.exact().is_some() {
                build::<f32, 16>(items, geometry, quality, &mut statistics)
            } else {
                build::<f64, 16>(items, geometry, quality, &mut statistics)
            };
            Hierarchy::Sixteen(Sixteen::new(&wide, leaves))
        };
        statistics.extend([
            ("bytes", hierarchy.bytes() as f64),
            ("build_seconds", start.elapsed().as_secs_f64()),
        ]);
        Self {
            hierarchy,
            proxies: None,
            statistics,
        }
    }

    /// The same hierarchy around moved elements; `None` if other elements need to be in it.
    fn refit(&self, geometry: &Arc<Geometry>) -> Option<Self> {
        let start = Instant::now();
        let old = self.leaves();
        let items = Items::new(geometry);
        if items.unbounded != old.unbounded {
            return None;
        }
        let numbers = old.slots.par_iter().with_min_len(PARALLEL);
        let numbers: Vec<u32> = numbers.map(|slot| items.number(*slot)).collect::<Option<_>>()?;
        // A build may have left out triangles that had no area.
        let mut known = vec![false; geometry.elements().count()];
        numbers.iter().for_each(|number| known[*number as usize] = true);
        let lost = |number: u32| !known[number as usize] && !items.is_flat(number);
        if items.each(lost).contains(&true) {
            return None;
        }
        let boxes = numbers.par_iter().with_min_len(PARALLEL);
        let boxes: Vec<Box4> = boxes.map(|number| items.item(*number).aabb()).collect();
        let (hierarchy, cost) = match &self.hierarchy {
            Hierarchy::Eight(eight) => {
                let mut wide = Wide {
                    nodes: eight.nodes.clone(),
                    root: eight.root,
                    ..Wide::default()
                };
                let leaves = refit::<f32, WIDTH>(&mut wide, &boxes, items, &numbers, geometry);
                let refitted = Eight {
                    leaves,
                    nodes: wide.nodes,
                    root: wide.root,
                    deep: eight.deep,
                    sets: eight.sets,
                };
                (Hierarchy::Eight(refitted), wide.cost)
            }
            Hierarchy::Sixteen(sixteen) => {
                let mut wide = sixteen.wide();
                let leaves = if items.frame.exact().is_some() {
                    refit::<f32, 16>(&mut wide, &boxes, items, &numbers, geometry)
                } else {
                    refit::<f64, 16>(&mut wide, &boxes, items, &numbers, geometry)
                };
                (Hierarchy::Sixteen(Sixteen::new(&wide, leaves)), wide.cost)
            }
        };
        let mut statistics = self.statistics.clone();
        statistics.extend([
            ("sah_cost", cost),
            ("bytes", hierarchy.bytes() as f64),
            ("build_seconds", start.elapsed().as_secs_f64()),
        ]);
        let sets = match &self.hierarchy {
            Hierarchy::Eight(eight) => eight.sets,
            Hierarchy::Sixteen(sixteen) => sixteen.sets,
        };
        let refitted = Self {
            hierarchy,
            proxies: None,
            statistics,
        };
        Some(refitted.with(sets))
    }

    /// The same with these sets of rays.
    fn with(mut self, sets: RaySets) -> Self {
        match &mut self.hierarchy {
            Hierarchy::Eight(eight) => eight.sets = sets,
            Hierarchy::Sixteen(sixteen) => sixteen.sets = sets,
        }
        self.proxies = (sets == RaySets::Tiles && self.leaves().unbounded.is_empty())
            .then(|| Proxies::new(&self.leaves().frame, self.top(frustum::MAX_PROXIES)));
        self
    }

    /// At most this number of boxes around everything (one more level if the root has more
    /// children): the largest inner nodes are replaced by their children.
    fn top(&self, most: usize) -> Vec<Aabb> {
        let mut found = Vec::new();
        found.extend(self.root().map(|root| (root, self.leaves().bounds())));
        loop {
            let inner = |(_, (child, _)): &(usize, &(Child, Aabb))| matches!(child.kind(), Kind::Inner(_));
            let area = |(_, aabb): &(Child, Aabb)| aabb.half_area();
            let largest = found
                .iter()
                .enumerate()
                .filter(inner)
                .max_by(|(_, a), (_, b)| area(a).total_cmp(&area(b)));
            let Some((place, (child, _))) = largest else { break };
            let Kind::Inner(node) = child.kind() else { break };
            let children = self.children(node);
            if found.len() > 1 && found.len() - 1 + children.len() > most {
                break;
            }
            found.swap_remove(place);
            let world = |p: DVec3| self.leaves().frame.world(p);
            found.extend(children.into_iter().map(|(child, [min, max])| {
                let (min, max) = (world(min), world(max));
                (child, Aabb { min, max })
            }));
        }
        found.into_iter().map(|(_, aabb)| aabb).collect()
    }

    fn leaves(&self) -> &Leaves {
        match &self.hierarchy {
            Hierarchy::Eight(eight) => &eight.leaves,
            Hierarchy::Sixteen(sixteen) => &sixteen.leaves,
        }
    }

    /// The root; `None` if there are no elements.
    fn root(&self) -> Option<Child> {
        match &self.hierarchy {
            Hierarchy::Eight(eight) => eight.root,
            Hierarchy::Sixteen(sixteen) => (!sixteen.leaves.slots.is_empty()).then_some(sixteen.root),
        }
    }

    /// The children of a node, each with the corners of its box.
    fn children(&self, node: usize) -> Vec<(Child, [DVec3; 2])> {
        match &self.hierarchy {
            Hierarchy::Eight(eight) => eight.nodes[node].boxes().collect(),
            Hierarchy::Sixteen(sixteen) => sixteen.node(node).boxes().collect(),
        }
    }

    fn outline(&self, child: Child, aabb: &Aabb, depth: usize, deepest: usize, found: &mut Vec<DebugBounds>) {
        found.push(DebugBounds::of_box(depth, aabb));
        if let Kind::Inner(node) = child.kind()
            && depth < deepest
        {
            for (child, corners) in self.children(node) {
                let [min, max] = corners.map(|p| self.leaves().frame.world(p));
                self.outline(child, &Aabb { min, max }, depth + 1, deepest, found);
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
        match &self.hierarchy {
            Hierarchy::Eight(eight) => eight.find::<ANY>(&query),
            Hierarchy::Sixteen(sixteen) => sixteen.find::<ANY>(&query, ()),
        }
    }
}

impl Eight {
    #[inline(always)]
    fn find<const ANY: bool>(&self, query: &Query<'_>) -> Option<PreliminaryIntersection> {
        // Only tests build this form on processors with AVX-512, which gains nothing for a single
        // ray here: nodes and leaves are eight wide.
        with_lanes(Level::Avx2, Search::<ANY, _>(self, query))
    }
}

/// Builds the hierarchy and its leaves.
fn build<T: Corners, const N: usize>(
    items: Items<'_>,
    geometry: Arc<Geometry>,
    quality: Quality,
    statistics: &mut Statistics,
) -> (Wide<N>, Leaves) {
    let bounded = || items.each(|number| items.item(number));
    let of_tree = |tree: Tree| (tree.nodes, items.contents::<T, _>(&tree.items, Item::number));
    let balanced = || {
        let binned = Binned {
            max_leaf: 3,
            bins: 32,
            items_a_bin: 16,
        };
        of_tree(binned.build(bounded()))
    };
    let widened = |(nodes, contents): (Vec<Binary>, Contents<T>)| {
        let mut numbers = contents.corners.into_flattened();
        let wide = Wide::new(&nodes, &contents.slots, &mut numbers);
        (wide, contents.slots, numbers)
    };
    let (wide, slots, numbers) = match quality {
        Quality::Auto => {
            let keys = Keys::new(&items);
            let is_even = !keys.any_cell_has_more_than(MAX_IN_CELL);
            let fast = is_even.then(|| widened(morton::build(&items, &keys)));
            fast.filter(|(wide, slots, _)| wide.cost <= MAX_COST * libm::log2(slots.len() as f64))
                .unwrap_or_else(|| widened(balanced()))
        }
        Quality::Fast => widened(morton::build(&items, &Keys::new(&items))),
        Quality::Balanced => widened(balanced()),
        Quality::Best => {
            let corners = items.corners();
            widened(of_tree(Spatial { corners: &corners }.build(bounded())))
        }
    };
    let Items { frame, unbounded, .. } = items;
    let mut leaves = Leaves::new(geometry, frame, unbounded, slots, Vec::new());
    T::store(numbers, &mut leaves);
    statistics.extend([
        ("elements", (leaves.slots.len() + leaves.unbounded.len()) as f64),
        ("unbounded", leaves.unbounded.len() as f64),
        ("nodes", wide.nodes.len() as f64),
        ("leaves", wide.leaves as f64),
        ("depth", wide.depth as f64),
        ("sah_cost", wide.cost),
    ]);
    (wide, leaves)
}

/// Fits the boxes of a hierarchy anew, and makes its leaves of the moved elements with these
/// numbers.
fn refit<T: Corners, const N: usize>(
    wide: &mut Wide<N>,
    boxes: &[Box4],
    items: Items<'_>,
    numbers: &[u32],
    geometry: &Arc<Geometry>,
) -> Leaves {
    wide.refit(boxes);
    let Contents { slots, corners } = items.contents::<T, _>(numbers, |number| *number);
    let mut corners = corners.into_flattened();
    let mut rest = &mut corners[..];
    let mut leaves = Vec::new();
    for (_, count) in wide.leaves() {
        leaves.push((count, rest.split_off_mut(..NUMBERS * count).unwrap_or_default()));
    }
    let leaves = leaves.into_par_iter().with_min_len(PARALLEL);
    leaves.for_each(|(count, numbers)| by_coordinate(numbers, count));
    let Items { frame, unbounded, .. } = items;
    let mut leaves = Leaves::new(geometry.clone(), frame, unbounded, slots, Vec::new());
    T::store(corners, &mut leaves);
    leaves
}

/// The coordinates of the leaves: `f32` and `f64` have a field of [`Leaves`] each.
trait Corners: Number {
    fn store(numbers: Vec<Self>, leaves: &mut Leaves);
}

impl Corners for f32 {
    fn store(numbers: Vec<Self>, leaves: &mut Leaves) {
        leaves.numbers = numbers;
    }
}

impl Corners for f64 {
    fn store(numbers: Vec<Self>, leaves: &mut Leaves) {
        leaves.doubles = numbers;
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
        if self
            .proxies
            .as_ref()
            .is_some_and(|proxies| proxies.are_missed_by(rays))
        {
            return;
        }
        match &self.hierarchy {
            Hierarchy::Eight(eight) => stream::intersect(eight, rays, hits),
            Hierarchy::Sixteen(sixteen) => sixteen.find_stream::<false>(rays, hits),
        }
    }

    fn occluded_stream(&self, rays: &RayStream, hidden: &mut Lanes<bool>) {
        match &self.hierarchy {
            Hierarchy::Eight(eight) => stream::occluded(eight, rays, hidden),
            Hierarchy::Sixteen(sixteen) => sixteen.find_stream::<true>(rays, hidden),
        }
    }

    fn refitted(&self, geometry: &Arc<Geometry>, _rigid: Option<&DAffine3>) -> Option<Box<dyn Accelerator>> {
        Some(Box::new(self.refit(geometry)?))
    }

    fn traversal_statistics(
        &self,
        ray: &Ray,
        interval: Interval,
        skip: SelfHitFilter,
    ) -> Option<TraversalStatistics> {
        let (query, counters) = (Query { ray, interval, skip }, Counters::default());
        let used = match &self.hierarchy {
            Hierarchy::Eight(eight) => {
                with_lanes(
                    Level::Avx2,
                    Search::<false, _>(&search::Counted(eight, &counters), &query),
                );
                eight.leaves.frame.ray(ray, &interval).is_some()
            }
            Hierarchy::Sixteen(sixteen) => {
                sixteen.find::<false>(&query, &counters);
                // It represents other rays than `frame`; each of them visits the root.
                !counters.are_zero()
            }
        };
        Some(counters.statistics(self.leaves(), used))
    }

    fn statistics(&self) -> Statistics {
        let mut statistics = self.statistics.clone();
        let skipped = self.proxies.as_ref().map(Proxies::skipped);
        statistics.extend(skipped.map(|count| ("skipped_streams", count as f64)));
        statistics
    }

    fn debug_bounds(&self, deepest: usize) -> Option<Vec<DebugBounds>> {
        let whole = self.leaves().bounds();
        let mut found = Vec::new();
        if let Some(root) = self.root() {
            self.outline(root, &whole, 0, deepest, &mut found);
        }
        Some(found)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use whitstone_core::{LoweredShape, TriangleMesh};
    use whitstone_testkit::{accelerator_laws, accelerator_laws_of_part};

    /// A `bvh` for processors of one level, which runs on all.
    struct Of<const AVX512: bool>;

    impl<const AVX512: bool> Plugin<Accelerators> for Of<AVX512> {
        const TYPE: &'static str = "bvh";
        type Config = Config;

        fn build(
            config: Config,
            geometry: Arc<Geometry>,
            _: &mut dyn Context,
        ) -> Result<Box<dyn Accelerator>, SceneErrors> {
            let level = if AVX512 { Level::Avx512 } else { Level::Avx2 };
            let bvh = Bvh::new(geometry, config.quality, level).with(config.ray_sets);
            Ok(Box::new(bvh))
        }
    }

    fn with_all_sets_of_rays<const AVX512: bool>() {
        for sets in ["none", "packets", "tiles"] {
            accelerator_laws_of_part::<Of<AVX512>>(&format!("ray_sets = \"{sets}\""), 4);
        }
    }

    /// A quad of two triangles at each of these places.
    fn quads(places: &[DVec3]) -> Arc<Geometry> {
        let corners = [DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::X + DVec3::Y];
        let quad = |number: usize| {
            let first = 4 * number as u32;
            [[first, first + 1, first + 2], [first + 3, first + 2, first + 1]]
        };
        Arc::new(Geometry::new(vec![LoweredShape::Triangles(TriangleMesh {
            positions: places
                .iter()
                .flat_map(|place| corners.map(|corner| *place + corner))
                .collect(),
            triangles: (0..places.len()).flat_map(quad).collect(),
            orientation: 1.0,
            ..TriangleMesh::default()
        })]))
    }

    /// A hundred quads in a row: a ray passes all of them, hits one, runs along all of them, or is
    /// so far away that single precision cannot represent it.
    #[test]
    fn the_work_of_a_ray_is_counted() {
        let places: Vec<DVec3> = (0..100)
            .map(|i| DVec3::new(2.0 * f64::from(i), 0.0, 0.0))
            .collect();
        for level in [Level::Avx2, Level::Avx512] {
            let bvh = Bvh::new(quads(&places), Quality::Balanced, level);
            let nodes = bvh.statistics["nodes"] as u64;
            let count = |origin: DVec3, direction: DVec3| {
                let ray = Ray::new(origin, direction);
                let counted = bvh.traversal_statistics(&ray, Interval::FORWARD, SelfHitFilter::NOTHING);
                counted.map(|counted| (counted.steps, counted.tests))
            };
            assert_eq!(count(DVec3::new(0.0, 0.0, 5.0), DVec3::Z), Some((1, 0)));
            let (steps, tests) = count(DVec3::new(100.3, 0.3, 5.0), -DVec3::Z).unwrap();
            assert!(
                (1..6).contains(&steps) && (2..17).contains(&tests),
                "{steps} {tests}"
            );
            assert_eq!(count(DVec3::new(-1.0, 0.5, 0.0), DVec3::X), Some((nodes, 200)));
            let (steps, tests) = count(DVec3::splat(1e20), DVec3::X).unwrap();
            assert!([(0, 200), (1, 0)].contains(&(steps, tests)), "{steps} {tests}");
            assert_eq!(count(DVec3::splat(1e40), DVec3::X), Some((0, 200)));
        }
    }

    /// Elements that part make the boxes overlap; elements that a hierarchy lacks need a new one.
    #[test]
    fn a_refit_keeps_the_contents_of_nodes() {
        let place = |i: usize| DVec3::new(2.0 * i as f64, 0.0, 0.0);
        let near: Vec<DVec3> = (0..100).map(place).collect();
        // Every second one far away.
        let apart = |i: usize| {
            place(i)
                + if i.is_multiple_of(2) {
                    DVec3::Y * 100.0
                } else {
                    DVec3::ZERO
                }
        };
        let far: Vec<DVec3> = (0..100).map(apart).collect();
        for level in [Level::Avx2, Level::Avx512] {
            let cost = |bvh: &Bvh| bvh.statistics["sah_cost"];
            let built = Bvh::new(quads(&near), Quality::Balanced, level);
            let same = built.refit(&quads(&near)).unwrap();
            assert!(
                (cost(&same) / cost(&built) - 1.0).abs() < 1e-5,
                "{} {}",
                cost(&same),
                cost(&built)
            );
            let moved = built.refit(&quads(&far)).unwrap();
            let rebuilt = Bvh::new(quads(&far), Quality::Balanced, level);
            assert!(
                cost(&moved) > 1.5 * cost(&rebuilt),
                "{} {}",
                cost(&moved),
                cost(&rebuilt)
            );
            assert_eq!(moved.statistics["nodes"], built.statistics["nodes"]);
            assert!(built.refit(&quads(&near[1..])).is_none());
            assert!(
                built
                    .refit(&quads(&[&near[..], &[DVec3::ZERO]].concat()))
                    .is_none()
            );
        }
    }

    #[test]
    fn obeys_the_laws_of_accelerators_with_leaves_in_single_precision() {
        // By default as where few rays are expected.
        accelerator_laws::<Of<false>>("");
        accelerator_laws::<Of<false>>("quality = \"balanced\"");
        accelerator_laws::<Of<false>>("quality = \"fast\"");
        accelerator_laws::<Of<false>>("quality = \"best\"");
        with_all_sets_of_rays::<false>();
    }

    #[test]
    fn obeys_them_with_leaves_in_double_precision() {
        accelerator_laws::<Of<true>>("");
        accelerator_laws::<Of<true>>("quality = \"balanced\"");
        accelerator_laws::<Of<true>>("quality = \"fast\"");
        accelerator_laws::<Of<true>>("quality = \"best\"");
        with_all_sets_of_rays::<true>();
    }
}
