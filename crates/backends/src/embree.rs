//! Intel's Embree, as installed on the system.
//!
//! - Wald, Woop, Benthin, Johnson, Ernst, *Embree: a kernel framework for efficient CPU ray
//!   tracing*, SIGGRAPH 2014.
//! - Version 3 or 4, loaded when a scene first names it; it is neither linked nor shipped.
//! - Single rays: `rtcIntersect1`, `rtcOccluded1`. All meshes are geometries of one Embree scene,
//!   with the same numbers as in Whitstone.
//!
//! - Example: `--set accelerator.type=embree` with any scene.

mod ffi;

use crate::single::{Single, SingleHit, SingleRay, TriangleId, Triangles, meshes, others};
use ffi::Scene;
use schemars::JsonSchema;
use serde::Deserialize;
use std::sync::Arc;
use std::time::Instant;
use whitstone_core::{
    Accelerator, Accelerators, Context, Geometry, Plugin, SceneError, SceneErrors, Statistics,
};

/// Embree in single precision, for comparison; it must be installed.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// Embree's build quality.
    #[serde(default)]
    quality: Quality,
    /// Whether Embree avoids its shortcuts at the edges of triangles (its robust flag).
    #[serde(default)]
    robust: bool,
}

/// Embree's build quality.
#[derive(Clone, Copy, Debug, Default, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Quality {
    /// Morton codes.
    Low,
    /// Binned surface area heuristic.
    Medium,
    /// With spatial splits.
    #[default]
    High,
}

/// The plugin.
pub struct Embree(Scene);

/// Embree ignores triangles with coordinates beyond 1.8e18.
const FARTHEST: f64 = 1e18;

/// The installed version, such as "3.13.5", or why Embree cannot be loaded.
pub fn version() -> Result<String, String> {
    ffi::version().map_err(ToOwned::to_owned)
}

impl Plugin<Accelerators> for Embree {
    const TYPE: &'static str = "embree";
    type Config = Config;

    fn build(
        config: Config,
        geometry: Arc<Geometry>,
        _: &mut dyn Context,
    ) -> Result<Box<dyn Accelerator>, SceneErrors> {
        let start = Instant::now();
        let missing = |why: &str| {
            SceneError::anywhere(format!("Embree cannot be loaded: {why}")).with_help(
                "install it (Debian: `libembree3-3` or `libembree4-4`), or set `WHITSTONE_EMBREE` to the name or path of the library",
            )
        };
        let version = ffi::version().map_err(missing)?;
        meshes(&geometry, FARTHEST)?;
        let scene = Scene::new(&geometry, config.quality, config.robust).map_err(SceneError::anywhere)?;
        let others = others(&geometry);
        let statistics = Statistics::from([
            ("elements", geometry.elements().count() as f64),
            ("others", others.len() as f64),
            ("bytes", (scene.bytes() + size_of_val(&*others)) as f64),
            ("build_seconds", start.elapsed().as_secs_f64()),
        ]);
        Ok(Box::new(Single {
            geometry,
            triangles: Self(scene),
            others,
            statistics,
            approximation_note: format!("Embree {version} finds triangles in single precision"),
        }))
    }
}

impl Triangles for Embree {
    #[inline]
    fn intersect(&self, ray: &SingleRay, skip: Option<TriangleId>) -> Option<SingleHit> {
        let mut ray = *ray;
        loop {
            let hit = self.0.intersect(&ray)?;
            if skip != Some(hit.id) {
                return Some(hit);
            }
            // Continue behind this hit: a triangle is hit only once. A filter function would cost
            // time for every ray.
            ray.min = hit.t.next_up();
        }
    }

    #[inline]
    fn occluded(&self, ray: &SingleRay, skip: Option<TriangleId>) -> bool {
        // Embree does not report the occluding triangle. If one must be skipped, find the nearest
        // other one.
        self.0.occluded(ray) && (skip.is_none() || self.intersect(ray, skip).is_some())
    }
}
