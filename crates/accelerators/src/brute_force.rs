//! No acceleration: every element is tested, in order.
//!
//! It defines the correct result for all other accelerators. It is the fastest accelerator for very
//! few elements.
//!
//! - Twin: none needed; the image does not depend on it.
//! - Example: `scenes/accelerators/brute_force.toml`.

use schemars::JsonSchema;
use serde::Deserialize;
use std::sync::Arc;
use whitstone_core::stream::{HitStream, Lanes, RayStream};
use whitstone_core::triangle::ShearedRay;
use whitstone_core::{
    Accelerator, Accelerators, Context, Element, Geometry, Instance, InstanceId, Interval, LoweredShape,
    Plugin, PreliminaryIntersection, Ray, SceneErrors, SelfHitFilter, Statistics, TraversalStatistics,
};

/// Tests every element in order, without an acceleration structure.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Config {}

/// The `brute_force` accelerator; see the module documentation.
pub struct BruteForce {
    geometry: Arc<Geometry>,
}

impl Plugin<Accelerators> for BruteForce {
    const TYPE: &'static str = "brute_force";
    type Config = Config;

    fn build(
        _: Config,
        geometry: Arc<Geometry>,
        _: &mut dyn Context,
    ) -> Result<Box<dyn Accelerator>, SceneErrors> {
        Ok(Box::new(Self { geometry }))
    }
}

impl BruteForce {
    /// Calls `found` with the hit of each element inside the interval, until it returns false. The
    /// interval is never narrowed. Single-ray queries of this accelerator, unlike those of the
    /// others, therefore do not rely on the purity law of shapes.
    #[inline(always)]
    fn hits(
        &self,
        ray: &Ray,
        interval: Interval,
        skip: SelfHitFilter,
        mut found: impl FnMut(PreliminaryIntersection) -> bool,
    ) {
        // Created at the first mesh only: its divisions cost as much as an intersection test.
        let mut sheared = None;
        for (part, shape) in self.geometry.shapes().iter().zip(0u32..) {
            let leaves = skip.of_shape(InstanceId::TOP_LEVEL, shape);
            match part {
                LoweredShape::Custom(primitive) => {
                    if let Some(hit) = primitive.intersect(ray, interval, leaves)
                        && !found(hit.of_shape(InstanceId::TOP_LEVEL, shape))
                    {
                        return;
                    }
                }
                LoweredShape::Triangles(mesh) => {
                    let sheared = sheared.get_or_insert_with(|| ShearedRay::new(ray));
                    for triangle in 0..mesh.triangles.len() as u32 {
                        let element = Element::Triangle { shape, triangle };
                        if let Some(hit) = self.geometry.intersect(element, ray, sheared, interval, skip)
                            && !found(hit)
                        {
                            return;
                        }
                    }
                }
                LoweredShape::Instance(instance) => {
                    if let Some(hit) = instance.intersect(ray, interval, skip)
                        && !found(hit)
                    {
                        return;
                    }
                }
                // `LoweredShape` is non-exhaustive, but has no other variant.
                _ => {}
            }
        }
    }

    /// The instances of the scene.
    fn instances(&self) -> impl Iterator<Item = &Instance> {
        let any = self.geometry.paths() > 1;
        let shapes = if any { self.geometry.shapes() } else { &[] };
        shapes.iter().filter_map(|shape| match shape {
            LoweredShape::Instance(instance) => Some(&**instance),
            _ => None,
        })
    }
}

impl Accelerator for BruteForce {
    fn intersect(
        &self,
        ray: &Ray,
        interval: Interval,
        skip: SelfHitFilter,
    ) -> Option<PreliminaryIntersection> {
        let mut best: Option<PreliminaryIntersection> = None;
        self.hits(ray, interval, skip, |hit| {
            if best.as_ref().is_none_or(|best| hit.is_nearer_than(best)) {
                best = Some(hit);
            }
            true
        });
        best
    }

    fn occluded(&self, ray: &Ray, interval: Interval, skip: SelfHitFilter) -> bool {
        let mut occluded = false;
        self.hits(ray, interval, skip, |_| {
            occluded = true;
            false
        });
        occluded
    }

    fn intersect_stream(&self, rays: &RayStream, hits: &mut HitStream) {
        hits.clear(rays);
        for (part, shape) in self.geometry.shapes().iter().zip(0u32..) {
            match part {
                LoweredShape::Custom(primitive) => primitive.intersect_stream(shape, rays, hits),
                LoweredShape::Triangles(mesh) => mesh.intersect_stream(shape, rays, hits),
                _ => {}
            }
        }
        // Instances come last, because a hit outside instances wins at equal distance.
        for instance in self.instances() {
            instance.intersect_stream(rays, hits);
        }
    }

    fn occluded_stream(&self, rays: &RayStream, hidden: &mut Lanes<bool>) {
        hidden[..rays.len].fill(false);
        for (part, shape) in self.geometry.shapes().iter().zip(0u32..) {
            match part {
                LoweredShape::Custom(primitive) => primitive.occluded_stream(shape, rays, hidden),
                LoweredShape::Triangles(mesh) => mesh.occluded_stream(shape, rays, hidden),
                _ => {}
            }
        }
        for instance in self.instances() {
            instance.occluded_stream(rays, hidden);
        }
    }

    fn traversal_statistics(
        &self,
        _ray: &Ray,
        _interval: Interval,
        _skip: SelfHitFilter,
    ) -> Option<TraversalStatistics> {
        Some(TraversalStatistics {
            steps: 0,
            tests: self.geometry.elements().count() as u64,
        })
    }

    fn statistics(&self) -> Statistics {
        Statistics::from([
            ("elements", self.geometry.elements().count() as f64),
            ("bytes", 0.0),
        ])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use whitstone_testkit::accelerator_laws_of_part;

    #[test]
    fn obeys_the_laws_of_accelerators() {
        accelerator_laws_of_part::<BruteForce>("", 8);
    }
}
