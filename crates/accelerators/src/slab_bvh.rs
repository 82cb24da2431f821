//! A hierarchy of bounding slabs: each node is the space between pairs of parallel planes in k/2 fixed
//! directions (a discrete oriented polytope, k-DOP).
//!
//! - Volumes: Kay and Kajiya, *Ray tracing complex scenes*, 1986, section 2; the directions for k = 6 (the axes),
//!   14 (with the diagonals of a cube), 26 (with those of its faces) as in Klosowski et al., *Efficient collision
//!   detection using bounding volume hierarchies of k-DOPs*, 1998, section 4.1.
//! - Build: top down over boxes; see `binary`.
//! - Traversal: section 3 of Kay and Kajiya: a heap hands out the nodes in the order in which the ray enters them,
//!   from all over the tree, and the search ends when the next one is farther than the best hit.
//! - Cost model: a step does k/2 interval tests in place of three, and has to save as many by hitting fewer volumes:
//!   their areas are those of tighter hulls. For triangles that lie askew that is so with k = 14; on faces along
//!   the axes all k above 6 are lost. The heap visits the fewest nodes that are possible, but takes O(log n) a
//!   node, where a stack takes O(1); a ray that asks for any hit gains nothing from the order. Memory: k numbers a
//!   node, two nodes an element at most. Build: O(n log n) and O(k n) for each level.
//!
//! - Twin: none needed; the image does not depend on it.
//! - Example: `scenes/accelerators/slab_bvh.toml`.

use crate::binary::{Builder, STEP_COST, Tree};
use crate::elements::{Along, Elements, Item, Searched, Structure, WideRay};
use crate::split::{Axes, Split};
use schemars::JsonSchema;
use serde::{Deserialize, Deserializer};
use std::cmp::Ordering;
use std::collections::BinaryHeap;
use std::num::NonZeroU32;
use std::sync::Arc;
use whitstone_core::{
    Accelerator, Accelerators, Context, DVec3, Element, Geometry, Plugin, SceneErrors, Statistics,
};

/// A hierarchy of slabs in 3, 7 or 13 directions, searched in the order of distance.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// Number of planes around each node: 6, 14 or 26.
    #[serde(default)]
    #[schemars(extend("enum" = [6, 14, 26]))]
    k: Planes,
    /// Most elements that a leaf may hold; a leaf has fewer where that is estimated to be faster.
    #[serde(default = "four")]
    max_leaf: NonZeroU32,
    /// Where to split.
    #[serde(default)]
    split: Split,
    /// Along which axes to look for a split.
    #[serde(default)]
    axes: Axes,
}

fn four() -> NonZeroU32 {
    const { NonZeroU32::new(4).unwrap() }
}

/// How many planes.
#[derive(Clone, Copy, Debug, Default, JsonSchema)]
#[schemars(with = "u32")]
enum Planes {
    Six,
    #[default]
    Fourteen,
    TwentySix,
}

impl<'de> Deserialize<'de> for Planes {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        match i64::deserialize(deserializer)? {
            6 => Ok(Self::Six),
            14 => Ok(Self::Fourteen),
            26 => Ok(Self::TwentySix),
            other => Err(serde::de::Error::custom(format!(
                "expected 6, 14 or 26, found {other}"
            ))),
        }
    }
}

/// Normals of the slabs, not of unit length: their coordinates are exact.
const NORMALS: [DVec3; 13] = [
    DVec3::X,
    DVec3::Y,
    DVec3::Z,
    DVec3::new(1.0, 1.0, 1.0),
    DVec3::new(1.0, 1.0, -1.0),
    DVec3::new(1.0, -1.0, 1.0),
    DVec3::new(-1.0, 1.0, 1.0),
    DVec3::new(1.0, 1.0, 0.0),
    DVec3::new(1.0, -1.0, 0.0),
    DVec3::new(1.0, 0.0, 1.0),
    DVec3::new(1.0, 0.0, -1.0),
    DVec3::new(0.0, 1.0, 1.0),
    DVec3::new(0.0, 1.0, -1.0),
];

/// The plugin; what it builds depends on `k`.
pub struct SlabBvh;

impl Plugin<Accelerators> for SlabBvh {
    const TYPE: &'static str = "slab_bvh";
    type Config = Config;

    fn build(
        config: Config,
        geometry: Arc<Geometry>,
        _: &mut dyn Context,
    ) -> Result<Box<dyn Accelerator>, SceneErrors> {
        Ok(match config.k {
            Planes::Six => build::<3>(&config, geometry),
            Planes::Fourteen => build::<7>(&config, geometry),
            Planes::TwentySix => build::<13>(&config, geometry),
        })
    }
}

fn build<const N: usize>(config: &Config, geometry: Arc<Geometry>) -> Box<dyn Accelerator> {
    let builder = Builder {
        max_leaf: config.max_leaf.get() as usize,
        split: config.split,
        axes: config.axes,
        step_cost: STEP_COST * N as f64 / 3.0,
    };
    Box::new(Searched::new(geometry, |geometry, elements| {
        Hierarchy::<N>::new(geometry, elements, &builder)
    }))
}

/// The space between N pairs of planes.
#[derive(Clone, Copy, Debug)]
struct Slabs<const N: usize> {
    min: [f64; N],
    max: [f64; N],
}

impl<const N: usize> Slabs<N> {
    const EMPTY: Self = Self {
        min: [f64::INFINITY; N],
        max: [f64::NEG_INFINITY; N],
    };

    fn around(item: &Item, geometry: &Geometry) -> Self {
        item.hull(geometry).fold(Self::EMPTY, |mut slabs, point| {
            for i in 0..N {
                let x = NORMALS[i].dot(point);
                slabs.min[i] = slabs.min[i].min(x);
                slabs.max[i] = slabs.max[i].max(x);
            }
            slabs
        })
    }

    fn union(mut self, other: &Self) -> Self {
        for i in 0..N {
            self.min[i] = self.min[i].min(other.min[i]);
            self.max[i] = self.max[i].max(other.max[i]);
        }
        self
    }

    /// Where the ray enters, if it does so from `min` to `limit`.
    #[inline]
    fn enter(&self, ray: &[Along; N], min: f64, limit: f64) -> Option<f64> {
        let mut inside = (min, limit);
        for i in 0..N {
            inside = ray[i].between(self.min[i], self.max[i], inside);
        }
        (inside.0 <= inside.1).then_some(inside.0)
    }
}

/// The hierarchy.
struct Hierarchy<const N: usize> {
    /// The root is 0.
    nodes: Vec<Node<N>>,
    /// What the leaves hold, leaf after leaf.
    elements: Vec<Element>,
    depth: usize,
}

#[derive(Clone, Copy, Debug)]
struct Node<const N: usize> {
    slabs: Slabs<N>,
    /// Of an inner node, the first of two children side by side; of a leaf, the first of its elements.
    first: u32,
    /// Elements of a leaf; 0 for an inner node.
    count: u32,
}

impl<const N: usize> Hierarchy<N> {
    fn new(geometry: &Geometry, elements: Elements, builder: &Builder) -> Self {
        let mut items = elements.items;
        let mut found = Self {
            nodes: Vec::new(),
            elements: Vec::new(),
            depth: 0,
        };
        if !items.is_empty() {
            let tree = builder.build(&mut items);
            found.nodes.push(Node {
                slabs: Slabs::EMPTY,
                first: 0,
                count: 0,
            });
            found.flatten(&tree, 0, 0, &items, geometry);
            found.elements = items.iter().map(|item| item.element).collect();
        }
        found
    }

    /// Puts a subtree at a place among the nodes, and what is below it behind all others.
    fn flatten(&mut self, tree: &Tree, place: usize, depth: usize, items: &[Item], geometry: &Geometry) {
        self.depth = self.depth.max(depth);
        self.nodes[place] = match tree {
            Tree::Leaf(range) => Node {
                slabs: items[range.clone()].iter().fold(Slabs::EMPTY, |slabs, item| {
                    slabs.union(&Slabs::around(item, geometry))
                }),
                first: range.start as u32,
                count: range.len() as u32,
            },
            Tree::Inner(children) => {
                let first = self.nodes.len();
                self.nodes.extend([self.nodes[place]; 2]);
                for (i, (_, child)) in children.iter().enumerate() {
                    self.flatten(child, first + i, depth + 1, items, geometry);
                }
                Node {
                    slabs: self.nodes[first].slabs.union(&self.nodes[first + 1].slabs),
                    first: first as u32,
                    count: 0,
                }
            }
        };
    }
}

/// A node that waits, and where the ray enters it.
#[derive(Clone, Copy, PartialEq)]
struct Waiting {
    near: f64,
    node: u32,
}

impl Eq for Waiting {}

impl Ord for Waiting {
    /// The nearest is the greatest, which the heap hands out first.
    fn cmp(&self, other: &Self) -> Ordering {
        other.near.total_cmp(&self.near).then(other.node.cmp(&self.node))
    }
}

impl PartialOrd for Waiting {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl<const N: usize> Structure for Hierarchy<N> {
    fn visit(
        &self,
        ray: &WideRay,
        min: f64,
        mut limit: f64,
        visit: &mut impl FnMut(Element) -> Option<f64>,
    ) -> Option<f64> {
        let along: [Along; N] = std::array::from_fn(|i| ray.along(NORMALS[i]));
        let enter = |node: u32, limit: f64| {
            let near = self.nodes[node as usize].slabs.enter(&along, min, limit)?;
            Some(Waiting { near, node })
        };
        let mut heap = BinaryHeap::new();
        if !self.nodes.is_empty() {
            heap.extend(enter(0, limit));
        }
        // At equal distance an element of lower number may be in there.
        while let Some(Waiting { near, node }) = heap.pop()
            && near <= limit
        {
            let Node { first, count, .. } = self.nodes[node as usize];
            for &element in held(&self.elements, first, count) {
                limit = visit(element)?;
            }
            if count == 0 {
                heap.extend(enter(first, limit));
                heap.extend(enter(first + 1, limit));
            }
        }
        Some(limit)
    }

    fn statistics(&self) -> Statistics {
        let leaves = self.nodes.iter().filter(|node| node.count > 0).count();
        let bytes = size_of_val(&*self.nodes) + size_of_val(&*self.elements);
        Statistics::from([
            ("planes", 2.0 * N as f64),
            ("nodes", (self.nodes.len() - leaves) as f64),
            ("leaves", leaves as f64),
            ("depth", self.depth as f64),
            ("bytes", bytes as f64),
        ])
    }
}

/// What a leaf holds; nothing for an inner node, whose `first` is a node.
#[inline]
fn held(elements: &[Element], first: u32, count: u32) -> &[Element] {
    if count == 0 {
        return &[];
    }
    &elements[first as usize..][..count as usize]
}

#[cfg(test)]
mod tests {
    use super::*;
    use whitstone_testkit::{accelerator_laws, build};

    #[test]
    fn obeys_the_laws_of_accelerators() {
        for text in [
            "k = 6",
            "k = 14",
            "k = 26\nmax_leaf = 1",
            "k = 26\nsplit = \"midpoint\"\naxes = \"longest\"",
            "split = \"median\"",
        ] {
            accelerator_laws::<SlabBvh>(text);
        }
    }

    #[test]
    fn other_numbers_of_planes_are_refused() {
        let built = build::<Accelerators, SlabBvh>("k = 8", Arc::new(Geometry::default()));
        let error = built.err().expect("8 is refused").to_string();
        assert_eq!(error, "expected 6, 14 or 26, found 8");
    }
}
