//! A binary bounding volume hierarchy in `f64`.
//!
//! - Build: top down by the surface area heuristic, in bins over all three axes (Wald, *On fast
//!   construction of SAH-based bounding volume hierarchies*, 2007), by a full sweep where few elements are
//!   left; see `build`.
//! - Traversal: nearer child first, with an explicit stack. Slabs by sign bits with comparisons that ignore
//!   NaN (Ize, *Robust BVH ray traversal*, JCGT 2(2), 2013), padded so that rounding in a shape's own test
//!   cannot put a hit outside its box.
//!
//! - Twin: none needed; the image does not depend on it.
//! - Example: `scenes/accelerators/bvh2.toml`.

mod build;

use schemars::JsonSchema;
use serde::Deserialize;
use std::num::NonZeroU32;
use std::sync::Arc;
use std::time::Instant;
use whitstone_core::triangle::ShearedRay;
use whitstone_core::{
    Accelerator, Accelerators, Context, DVec3, Element, Geometry, Interval, Plugin, RawHit, Ray, SceneErrors,
    Skip, Statistics,
};

/// A binary bounding volume hierarchy: good for every scene.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// Most elements that a leaf may hold; a leaf has fewer where that is estimated to be faster.
    #[serde(default = "four")]
    max_leaf: NonZeroU32,
}

fn four() -> NonZeroU32 {
    const { NonZeroU32::new(4).unwrap() }
}

/// The hierarchy.
pub struct Bvh2 {
    geometry: Arc<Geometry>,
    /// Elements without a box of reasonable size, tried for every ray.
    unbounded: Vec<Element>,
    /// Inner nodes in depth-first order; the root is 0.
    nodes: Vec<Node>,
    /// What the leaves hold, leaf after leaf.
    slots: Vec<Slot>,
    /// The root, unless there are no bounded elements.
    root: Option<Child>,
    /// Largest absolute coordinate of any box.
    reach: f64,
    /// Whether the smaller stack does not do.
    deep: bool,
    statistics: Statistics,
}

/// An inner node with the boxes of both children.
#[derive(Clone, Copy, Debug)]
struct Node {
    /// By axis, by side (0 smallest, 1 largest coordinate), by child.
    planes: [[[f64; 2]; 2]; 3],
    children: [Child; 2],
}

/// An inner node, or a leaf by its first slot.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Child(u32);

impl Child {
    const LEAF: u32 = 1 << 31;

    fn leaf(first_slot: usize) -> Self {
        Self(first_slot as u32 | Self::LEAF)
    }

    fn inner(node: usize) -> Self {
        Self(node as u32)
    }

    /// `Err` for an inner node.
    fn first_slot(self) -> Result<usize, usize> {
        let index = (self.0 & !Self::LEAF) as usize;
        if self.0 & Self::LEAF != 0 {
            Ok(index)
        } else {
            Err(index)
        }
    }
}

/// An element in a leaf.
#[derive(Clone, Copy, Debug)]
struct Slot {
    element: Element,
    /// Whether the leaf ends here.
    last: bool,
}

/// No path from the root is longer: `build` sees to it.
const MAX_DEPTH: usize = 64;

/// Trees up to this depth are traversed with a smaller stack, which is cheaper to set up.
const USUAL_DEPTH: usize = 32;

impl Plugin<Accelerators> for Bvh2 {
    const TYPE: &'static str = "bvh2";
    type Config = Config;

    fn build(
        config: Config,
        geometry: Arc<Geometry>,
        _: &mut dyn Context,
    ) -> Result<Box<dyn Accelerator>, SceneErrors> {
        Ok(Box::new(Self::new(geometry, config.max_leaf.get() as usize)))
    }
}

impl Bvh2 {
    fn new(geometry: Arc<Geometry>, max_leaf: usize) -> Self {
        let start = Instant::now();
        let built = build::build(&geometry, max_leaf);
        let bytes = built.nodes.len() * size_of::<Node>()
            + built.slots.len() * size_of::<Slot>()
            + built.unbounded.len() * size_of::<Element>();
        let statistics = Statistics::from([
            ("elements", (built.slots.len() + built.unbounded.len()) as f64),
            ("unbounded", built.unbounded.len() as f64),
            ("nodes", built.nodes.len() as f64),
            (
                "leaves",
                built.slots.iter().filter(|slot| slot.last).count() as f64,
            ),
            ("depth", built.depth as f64),
            ("sah_cost", built.sah_cost),
            ("bytes", bytes as f64),
            ("build_seconds", start.elapsed().as_secs_f64()),
        ]);
        Self {
            geometry,
            unbounded: built.unbounded,
            nodes: built.nodes,
            slots: built.slots,
            root: built.root,
            reach: built.reach,
            deep: built.depth > USUAL_DEPTH,
            statistics,
        }
    }

    /// Visits the elements that the ray may hit before `limit`, nearer ones roughly first. `visit`
    /// returns the new limit, or `None` to stop.
    #[inline]
    fn visit<const DEPTH: usize>(
        &self,
        ray: &Ray,
        min: f64,
        mut limit: f64,
        mut visit: impl FnMut(Element) -> Option<f64>,
    ) {
        for &element in &self.unbounded {
            let Some(nearer) = visit(element) else { return };
            limit = nearer;
        }
        let slabs = Slabs::new(ray, self.reach);
        let (Some(mut child), true) = (self.root, ray.origin.is_finite() && ray.direction.is_finite()) else {
            return;
        };
        // One entry a level: the child that is put off.
        let mut stack = [(0.0, Child::default()); DEPTH];
        let mut height = 0;
        loop {
            match child.first_slot() {
                Err(node) => {
                    let node = &self.nodes[node];
                    let (near, hit) = slabs.enter(node, min, limit);
                    match hit {
                        [true, true] => {
                            let first = usize::from(near[1] < near[0]);
                            stack[height] = (near[1 - first], node.children[1 - first]);
                            height += 1;
                            child = node.children[first];
                            continue;
                        }
                        [true, false] => {
                            child = node.children[0];
                            continue;
                        }
                        [false, true] => {
                            child = node.children[1];
                            continue;
                        }
                        [false, false] => {}
                    }
                }
                Ok(first) => {
                    for slot in &self.slots[first..] {
                        let Some(nearer) = visit(slot.element) else { return };
                        limit = nearer;
                        if slot.last {
                            break;
                        }
                    }
                }
            }
            child = loop {
                if height == 0 {
                    return;
                }
                height -= 1;
                let (near, child) = stack[height];
                // At equal distance an element of lower number may be in there.
                if near <= limit {
                    break child;
                }
            };
        }
    }

    #[inline]
    fn closest_in<const DEPTH: usize>(&self, ray: &Ray, interval: Interval, skip: Skip) -> Option<RawHit> {
        let sheared = ShearedRay::new(ray);
        let mut best: Option<RawHit> = None;
        let mut open = interval;
        self.visit::<DEPTH>(ray, interval.min, interval.max, |element| {
            if let Some(hit) = self.geometry.intersect(element, ray, &sheared, open, skip)
                && best.is_none_or(|best| hit.beats(&best))
            {
                best = Some(hit);
                // Hits at the same distance still count: they may be lower in number.
                open.max = hit.t.next_up();
            }
            Some(best.map_or(interval.max, |best| best.t))
        });
        best
    }

    #[inline]
    fn occluded_in<const DEPTH: usize>(&self, ray: &Ray, interval: Interval, skip: Skip) -> bool {
        let sheared = ShearedRay::new(ray);
        let mut occluded = false;
        self.visit::<DEPTH>(ray, interval.min, interval.max, |element| {
            occluded = self
                .geometry
                .intersect(element, ray, &sheared, interval, skip)
                .is_some();
            (!occluded).then_some(interval.max)
        });
        occluded
    }
}

impl Accelerator for Bvh2 {
    fn closest(&self, ray: &Ray, interval: Interval, skip: Skip) -> Option<RawHit> {
        if self.deep {
            self.closest_in::<MAX_DEPTH>(ray, interval, skip)
        } else {
            self.closest_in::<USUAL_DEPTH>(ray, interval, skip)
        }
    }

    fn occluded(&self, ray: &Ray, interval: Interval, skip: Skip) -> bool {
        if self.deep {
            self.occluded_in::<MAX_DEPTH>(ray, interval, skip)
        } else {
            self.occluded_in::<USUAL_DEPTH>(ray, interval, skip)
        }
    }

    fn statistics(&self) -> Statistics {
        self.statistics.clone()
    }
}

/// How much boxes are padded, relative to the largest coordinate of ray origin and boxes.
///
/// The slab test itself errs by a few roundings, 2^-53 each. The test of a triangle errs by about 8
/// roundings times the ratio of its longest edge to its smallest height, so this pad lets hits on
/// triangles with ratios up to a thousand stay in their boxes; `build` sees to the needles beyond.
const PAD: f64 = 1.0 / (1u64 << 40) as f64;

/// A ray, prepared for tests against boxes.
struct Slabs {
    /// The origin as near planes see it, moved forward by the pad, so that boxes are entered early.
    near_origin: DVec3,
    /// The origin as far planes see it, so that boxes are left late.
    far_origin: DVec3,
    /// Infinite, with the right sign, along axes that the ray does not move in.
    reciprocal: DVec3,
    /// Whether the side of smallest coordinates is the near one (0) or the far one (1).
    near_side: [usize; 3],
}

impl Slabs {
    #[inline]
    fn new(ray: &Ray, reach: f64) -> Self {
        let pad = PAD * (ray.origin.abs().max_element() + reach);
        let near_side = ray
            .direction
            .to_array()
            .map(|d| usize::from(d.is_sign_negative()));
        let forward = DVec3::ONE.copysign(ray.direction) * pad;
        Self {
            near_origin: ray.origin + forward,
            far_origin: ray.origin - forward,
            reciprocal: ray.direction.recip(),
            near_side,
        }
    }

    /// Where the ray enters each child's box, and whether it is inside somewhere from `min` to `limit`.
    #[inline]
    fn enter(&self, node: &Node, min: f64, limit: f64) -> ([f64; 2], [bool; 2]) {
        let (mut near, mut far) = ([min; 2], [limit; 2]);
        for axis in 0..3 {
            let near_planes = node.planes[axis][self.near_side[axis]];
            let far_planes = node.planes[axis][1 - self.near_side[axis]];
            for child in 0..2 {
                let enter = (near_planes[child] - self.near_origin[axis]) * self.reciprocal[axis];
                let leave = (far_planes[child] - self.far_origin[axis]) * self.reciprocal[axis];
                // A NaN, from zero times infinity, changes nothing: the ray runs in that plane.
                near[child] = if enter > near[child] { enter } else { near[child] };
                far[child] = if leave < far[child] { leave } else { far[child] };
            }
        }
        (near, [near[0] <= far[0], near[1] <= far[1]])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use whitstone_testkit::accelerator_laws;

    #[test]
    fn obeys_the_laws_of_accelerators() {
        accelerator_laws::<Bvh2>("");
        accelerator_laws::<Bvh2>("max_leaf = 1");
        accelerator_laws::<Bvh2>("max_leaf = 1000");
    }
}
