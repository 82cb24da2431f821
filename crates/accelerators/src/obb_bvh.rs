//! A BVH of oriented bounding boxes (OBBs): each node has its own frame.
//!
//! - Fit: along the principal axes of the corners of the contents (Gottschalk, Lin, Manocha,
//!   *OBBTree: a hierarchical structure for rapid interference detection*, 1996, section 4), or
//!   along the coordinate axes where that box is smaller. Each node is fitted to its own elements,
//!   not to its children's boxes.
//! - Build: top down over axis-parallel boxes; see `binary`.
//! - Traversal: nearer child first, with an explicit stack. The ray is transformed into the frame
//!   of each box: six dot products before the three interval tests.
//! - Cost model: a step takes two to three times that of an axis-parallel box, so an oriented box
//!   pays off only where it is hit less than a half to a third as often. It saves a third of the
//!   steps on slanted hairs and a sixth on compact meshes: neither pays off (figures in
//!   `docs/accelerators.md`). Memory: 15 numbers a node, at most two nodes per element. Build: O(n
//!   log n), as every level is fitted anew. A rigidly moving part needs no new fit, only a new
//!   frame (`docs/motion.md`).
//!
//! - Twin: none needed; the image does not depend on it.
//! - Example: `scenes/accelerators/obb_bvh.toml`.

use crate::support::binary::{Builder, MAX_DEPTH, STEP_COST};
use crate::support::elements::{Elements, Item, Searched, Structure, Visitor, WideRay};
use crate::support::hierarchy::{Below, Hierarchy, Volume};
use crate::support::principal::{COORDINATE_AXES, principal_axes};
use crate::support::split::{Axes, Split};
use schemars::JsonSchema;
use serde::Deserialize;
use std::num::NonZeroU32;
use std::sync::Arc;
use whitstone_core::{
    Aabb, Accelerator, Accelerators, Context, DAffine3, DMat3, DVec3, DebugBounds, Geometry, Plugin,
    SceneErrors, Statistics,
};

/// A BVH of oriented boxes: fewer but slower steps. Even on slanted hairs it is not faster than
/// axis-parallel boxes.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// Maximum number of elements in a leaf. With `split` "sah" or "between", leaves are smaller
    /// where that lowers the estimated cost.
    #[serde(default = "four")]
    max_leaf: NonZeroU32,
    /// How to choose the split position.
    #[serde(default)]
    split: Split,
    /// Which axes to try for a split.
    #[serde(default)]
    axes: Axes,
}

fn four() -> NonZeroU32 {
    const { NonZeroU32::new(4).unwrap() }
}

/// Cost of a step, relative to that of an axis-parallel box.
const STEPS: f64 = 3.0;

/// A box in its own frame.
#[derive(Clone, Copy, Debug)]
struct Oriented {
    /// Orthogonal, of unit length up to rounding.
    axes: [DVec3; 3],
    /// Smallest and largest dot product of each axis with a point inside.
    min: [f64; 3],
    max: [f64; 3],
}

impl Oriented {
    /// The box around points with the given axes. Each face passes through the outermost point, so
    /// rounding of the axes does not matter.
    fn along(points: &[DVec3], axes: [DVec3; 3]) -> Self {
        let end = |start: f64, choose: fn(f64, f64) -> f64| {
            axes.map(|axis| points.iter().map(|p| axis.dot(*p)).fold(start, choose))
        };
        Self {
            axes,
            min: end(f64::INFINITY, f64::min),
            max: end(f64::NEG_INFINITY, f64::max),
        }
    }

    /// Entry distance, if the ray is inside between `min` and `limit`.
    #[inline]
    fn enter(&self, ray: &WideRay, min: f64, limit: f64) -> Option<f64> {
        let mut inside = (min, limit);
        for i in 0..3 {
            let along = ray.along(self.axes[i]);
            inside = along.between(self.min[i], self.max[i], inside);
        }
        (inside.0 <= inside.1).then_some(inside.0)
    }
}

impl Volume for Oriented {
    /// The smaller of the two candidates.
    fn around(items: &[Item], geometry: &Geometry) -> Self {
        let points: Vec<DVec3> = items.iter().flat_map(|item| item.hull(geometry)).collect();
        let straight = Self::along(&points, COORDINATE_AXES);
        let askew = Self::along(&points, principal_axes(&points));
        if askew.half_area() < straight.half_area() {
            askew
        } else {
            straight
        }
    }

    /// `None`: the children's boxes say too little, so each box is fitted to its own elements.
    fn joined(_: &Self, _: &Self) -> Option<Self> {
        None
    }

    /// The same box in a moved frame. The rounding of the frame, and of the moved elements, is far
    /// below the padding of rays.
    fn moved(&self, rigid: &DAffine3) -> Option<Self> {
        let turn = rigid.matrix3;
        // Otherwise the ends along the axes would change.
        if !(turn.transpose() * turn).abs_diff_eq(DMat3::IDENTITY, 1e-14) {
            return None;
        }
        let axes = self.axes.map(|axis| turn * axis);
        let shifted = |ends: [f64; 3]| std::array::from_fn(|i| ends[i] + axes[i].dot(rigid.translation));
        Some(Self {
            axes,
            min: shifted(self.min),
            max: shifted(self.max),
        })
    }

    fn half_area(&self) -> f64 {
        let [x, y, z] = [0, 1, 2].map(|i| self.max[i] - self.min[i]);
        x * y + y * z + z * x
    }

    fn outline(&self, depth: usize) -> DebugBounds {
        let (min, max) = (self.min.into(), self.max.into());
        DebugBounds::of_parallelepiped(depth, &Aabb { min, max }, self.axes)
    }
}

/// The hierarchy.
pub struct ObbBvh(Hierarchy<Oriented>);

impl Plugin<Accelerators> for ObbBvh {
    const TYPE: &'static str = "obb_bvh";
    type Config = Config;

    fn build(
        config: Config,
        geometry: Arc<Geometry>,
        _: &mut dyn Context,
    ) -> Result<Box<dyn Accelerator>, SceneErrors> {
        let builder = Builder {
            max_leaf: config.max_leaf.get() as usize,
            split: config.split,
            axes: config.axes,
            step_cost: STEPS * STEP_COST,
        };
        Ok(Box::new(Searched::new(geometry, |geometry, elements| {
            Self(Hierarchy::new(geometry, elements, &builder))
        })?))
    }
}

impl Structure for ObbBvh {
    #[inline]
    fn visit(&self, ray: &WideRay, min: f64, mut limit: f64, visitor: &mut impl Visitor) -> Option<f64> {
        let Self(hierarchy) = self;
        let enter = |node: u32, limit: f64| hierarchy.volume(node).enter(ray, min, limit);
        let Some(mut node) = hierarchy.root().filter(|&root| enter(root, limit).is_some()) else {
            return Some(limit);
        };
        // One entry per level: the deferred child.
        let mut stack = [(0.0, 0); MAX_DEPTH];
        let mut height = 0;
        loop {
            match hierarchy.below(node) {
                Below::Elements(elements) => {
                    for &element in elements {
                        limit = visitor.test(element)?;
                    }
                }
                Below::Children(first) => {
                    visitor.step();
                    match (enter(first, limit), enter(first + 1, limit)) {
                        (Some(left), Some(right)) => {
                            let swap = u32::from(right < left);
                            stack[height] = (left.max(right), first + 1 - swap);
                            height += 1;
                            node = first + swap;
                            continue;
                        }
                        (Some(_), None) => {
                            node = first;
                            continue;
                        }
                        (None, Some(_)) => {
                            node = first + 1;
                            continue;
                        }
                        (None, None) => {}
                    }
                }
            }
            loop {
                if height == 0 {
                    return Some(limit);
                }
                height -= 1;
                let (near, later) = stack[height];
                node = later;
                // `<=`: at equal distance an element of lower index may follow, which wins the tie.
                if near <= limit {
                    break;
                }
            }
        }
    }

    fn refitted(&self, geometry: &Geometry, elements: &Elements, rigid: Option<&DAffine3>) -> Option<Self> {
        self.0.refitted(geometry, &elements.items, rigid).map(Self)
    }

    fn statistics(&self) -> Statistics {
        let askew = |oriented: &&Oriented| oriented.axes != COORDINATE_AXES;
        let mut statistics = self.0.statistics();
        statistics.insert("askew", self.0.volumes().filter(askew).count() as f64);
        statistics
    }

    fn debug_bounds(&self, deepest: usize) -> Vec<DebugBounds> {
        self.0.debug_bounds(deepest)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use whitstone_testkit::accelerator_laws;

    #[test]
    fn a_moved_frame_has_the_box_of_the_moved_points() {
        let rotation = DAffine3::from_axis_angle(DVec3::new(1.0, 2.0, 3.0).normalize(), 0.8);
        let rigid = DAffine3::from_translation(DVec3::new(5.0, -2.0, 1.0)) * rotation;
        let points = [DVec3::ZERO, DVec3::X, 2.0 * DVec3::Y, DVec3::ONE];
        let oriented = Oriented::along(&points, principal_axes(&points));
        let moved = oriented.moved(&rigid).unwrap();
        for p in points {
            let p = rigid.transform_point3(p);
            for i in 0..3 {
                let along = moved.axes[i].dot(p);
                assert!(moved.min[i] - 1e-14 <= along && along <= moved.max[i] + 1e-14);
            }
        }
        assert!((moved.half_area() / oriented.half_area() - 1.0).abs() < 1e-13);
        // Boxes that are stretched need a new fit.
        assert!(
            oriented
                .moved(&DAffine3::from_scale(DVec3::new(1.0, 1.0, 1.0 + 1e-9)))
                .is_none()
        );
    }

    #[test]
    fn obeys_the_laws_of_accelerators() {
        for text in [
            "",
            "max_leaf = 1",
            "split = \"midpoint\"\naxes = \"longest\"",
            "split = \"between\"",
            "split = \"median\"",
        ] {
            accelerator_laws::<ObbBvh>(text);
        }
    }
}
