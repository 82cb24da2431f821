//! No acceleration: every element is tried, in order.
//!
//! The definition of the right answer, and the fastest for a handful of elements.
//!
//! - Twin: none needed; the image does not depend on it.
//! - Example: `scenes/accelerators/brute_force.toml`.

use schemars::JsonSchema;
use serde::Deserialize;
use std::cell::LazyCell;
use std::sync::Arc;
use whitstone_core::triangle::ShearedRay;
use whitstone_core::{
    Accelerator, Accelerators, Context, Element, Geometry, Interval, Plugin, RawHit, Ray, SceneErrors, Skip,
    Statistics,
};

/// Tries every element in order, without any structure.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Config {}

/// A list.
pub struct BruteForce {
    geometry: Arc<Geometry>,
    opaque: Vec<Element>,
    triangles: Vec<Element>,
}

impl Plugin<Accelerators> for BruteForce {
    const TYPE: &'static str = "brute_force";
    type Config = Config;

    fn build(
        _: Config,
        geometry: Arc<Geometry>,
        _: &mut dyn Context,
    ) -> Result<Box<dyn Accelerator>, SceneErrors> {
        let is_triangle = |element: &Element| matches!(element, Element::Triangle { .. });
        let (triangles, opaque) = geometry.elements().partition(is_triangle);
        Ok(Box::new(Self {
            geometry,
            opaque,
            triangles,
        }))
    }
}

impl BruteForce {
    /// The hits of all elements inside the interval, which is never narrowed: the purity of the shapes
    /// is what other accelerators rely on and this one need not.
    fn hits(&self, ray: &Ray, interval: Interval, skip: Skip) -> impl Iterator<Item = RawHit> {
        let (ray, geometry) = (*ray, &*self.geometry);
        let opaque = self
            .opaque
            .iter()
            .filter_map(move |&element| geometry.intersect_opaque(element, &ray, interval, skip));
        // Made for the first triangle only: the divisions cost as much as a hit.
        let sheared = LazyCell::new(move || ShearedRay::new(&ray));
        let triangles = self
            .triangles
            .iter()
            .filter_map(move |&element| geometry.intersect(element, &ray, &sheared, interval, skip));
        opaque.chain(triangles)
    }
}

impl Accelerator for BruteForce {
    fn closest(&self, ray: &Ray, interval: Interval, skip: Skip) -> Option<RawHit> {
        self.hits(ray, interval, skip)
            .reduce(|best, hit| if hit.beats(&best) { hit } else { best })
    }

    fn occluded(&self, ray: &Ray, interval: Interval, skip: Skip) -> bool {
        self.hits(ray, interval, skip).next().is_some()
    }

    fn statistics(&self) -> Statistics {
        let elements = self.opaque.len() + self.triangles.len();
        let bytes = elements * size_of::<Element>();
        Statistics::from([("elements", elements as f64), ("bytes", bytes as f64)])
    }
}
