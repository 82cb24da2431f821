//! A perfect mirror on both sides.
//!
//! Whitted 1980, section 2, with the reflected ray only.
//!
//! - Twin: Mitsuba `conductor` with `material = "none"` in `twosided` (native).
//! - Example: `scenes/materials/mirror.toml`.

use crate::support::optics::reflect;
use crate::support::reflectance::reflectance;
use schemars::JsonSchema;
use serde::Deserialize;
use std::sync::Arc;
use whitstone_core::config::TextureRef;
use whitstone_core::stream::{GROUP, SurfaceStream, groups};
use whitstone_core::{
    BsdfFlags, ColorSource, Context, DVec3, Material, Materials, Plugin, Rgb, SceneErrors, SpecularRay,
    SpecularRayKind, SpecularRayStreams, SpecularRays, SurfaceAttributes, SurfaceInteraction, simd,
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
    fn flags(&self) -> BsdfFlags {
        if self.reflectance.is_black() {
            BsdfFlags::NOTHING
        } else {
            BsdfFlags::REFLECTION
        }
    }

    fn needs(&self) -> SurfaceAttributes {
        SurfaceAttributes::SHADING_NORMAL | self.reflectance.needs()
    }

    fn specular_rays(&self, point: &SurfaceInteraction, view: DVec3, out: &mut SpecularRays) {
        out.push(SpecularRay {
            direction: reflect(point.n_towards(view), view),
            weight: self.reflectance.value(point),
            kind: SpecularRayKind::Reflection,
        });
    }

    fn specular_rays_stream(&self, points: &SurfaceStream, out: &mut SpecularRayStreams) {
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
        let point = SurfaceInteraction::new(DVec3::ZERO, 0.0, DVec3::Z);
        for side in [1.0, -1.0] {
            let mut branches = SpecularRays::default();
            material.specular_rays(&point, DVec3::new(0.6, 0.0, side * 0.8), &mut branches);
            let branch = branches.iter().next().unwrap();
            assert!((branch.direction - DVec3::new(-0.6, 0.0, side * 0.8)).length() < 1e-15);
            assert_eq!(branch.weight, Rgb::new(1.0, 0.5, 0.0));
        }
    }

    #[test]
    fn lobes_are_exact() {
        let lobes = |text| build::<Materials, Mirror>(text, ()).unwrap().flags();
        assert_eq!(lobes("reflectance = 0"), BsdfFlags::NOTHING);
        assert_eq!(lobes(""), BsdfFlags::REFLECTION);
    }

    #[test]
    fn a_reflectance_above_one_is_refused_at_its_place() {
        let text = "reflectance = [0, 1.5, 1]";
        let error = build::<Materials, Mirror>(text, ()).err().unwrap().0.remove(0);
        assert_eq!(&text[error.span.unwrap()], "[0, 1.5, 1]");
        assert!(build::<Materials, Mirror>("reflectance = 1", ()).is_ok());
    }
}
