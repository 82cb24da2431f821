//! A perfect mirror on both sides.
//!
//! Whitted 1980, section 2, with the reflected ray only.
//!
//! - Twin: Mitsuba `conductor` with `material = "none"` in `twosided` (native).
//! - Example: `scenes/materials/mirror.toml`.

use crate::optics::reflect;
use crate::reflectance::reflectance;
use schemars::JsonSchema;
use serde::Deserialize;
use std::sync::Arc;
use whitstone_core::config::TextureRef;
use whitstone_core::stream::{GROUP, PointStream, groups};
use whitstone_core::{
    Branch, BranchKind, BranchStreams, Branches, ColorSource, Context, DVec3, Lobes, Material, Materials,
    Needs, Plugin, Rgb, SceneErrors, SurfacePoint, simd,
};

/// A perfect mirror on both sides.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// Factor on the reflected radiance, from 0 to 1; a texture or a colour.
    #[serde(default = "one")]
    reflectance: TextureRef,
}

fn one() -> TextureRef {
    TextureRef::grey(1.0)
}

/// The `mirror` material; see the module documentation.
pub struct Mirror {
    reflectance: ColorSource,
}

impl Plugin<Materials> for Mirror {
    const TYPE: &'static str = "mirror";
    type Config = Config;

    fn build(config: Config, (): (), context: &mut dyn Context) -> Result<Arc<dyn Material>, SceneErrors> {
        Ok(Arc::new(Self {
            reflectance: reflectance(&config.reflectance, context)?,
        }))
    }
}

impl Material for Mirror {
    fn lobes(&self) -> Lobes {
        if self.reflectance.is_black() {
            Lobes::NOTHING
        } else {
            Lobes::REFLECTION
        }
    }

    fn needs(&self) -> Needs {
        Needs::SHADING_NORMAL | self.reflectance.needs()
    }

    fn branches(&self, point: &SurfacePoint, view: DVec3, out: &mut Branches) {
        out.push(Branch {
            direction: reflect(point.n_towards(view), view),
            weight: self.reflectance.value(point),
            kind: BranchKind::Reflection,
        });
    }

    fn branches_stream(&self, points: &PointStream, out: &mut BranchStreams) {
        self.reflectance.value_stream(points, &mut out.reflection.weight);
        out.transmission.weight.fill(points.len, Rgb::BLACK);
        simd::dispatch(
            #[inline(always)]
            || {
                for start in groups(points.len) {
                    for lane in start..start + GROUP {
                        let view = points.view.get(lane);
                        let n = points.get(lane).n_towards(view);
                        out.reflection.direction.set(lane, reflect(n, view));
                    }
                }
            },
        );
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use whitstone_core::Rgb;
    use whitstone_testkit::{build, furnace_laws, material_laws};

    #[test]
    fn laws() {
        for text in ["", "reflectance = [0, 0.3, 1]", "reflectance = 0"] {
            let material = build::<Materials, Mirror>(text, ()).unwrap();
            material_laws(&*material);
            furnace_laws(&*material);
        }
    }

    #[test]
    fn both_sides_reflect() {
        let material = build::<Materials, Mirror>("reflectance = [1, 0.5, 0]", ()).unwrap();
        let point = SurfacePoint::new(DVec3::ZERO, 0.0, DVec3::Z);
        for side in [1.0, -1.0] {
            let mut branches = Branches::default();
            material.branches(&point, DVec3::new(0.6, 0.0, side * 0.8), &mut branches);
            let branch = branches.iter().next().unwrap();
            assert!((branch.direction - DVec3::new(-0.6, 0.0, side * 0.8)).length() < 1e-15);
            assert_eq!(branch.weight, Rgb::new(1.0, 0.5, 0.0));
        }
    }

    #[test]
    fn lobes_are_exact() {
        let lobes = |text| build::<Materials, Mirror>(text, ()).unwrap().lobes();
        assert_eq!(lobes("reflectance = 0"), Lobes::NOTHING);
        assert_eq!(lobes(""), Lobes::REFLECTION);
    }

    #[test]
    fn a_reflectance_above_one_is_refused_at_its_place() {
        let text = "reflectance = [0, 1.5, 1]";
        let error = build::<Materials, Mirror>(text, ()).err().unwrap().0.remove(0);
        assert_eq!(&text[error.span.unwrap()], "[0, 1.5, 1]");
        assert!(build::<Materials, Mirror>("reflectance = 1", ()).is_ok());
    }
}
