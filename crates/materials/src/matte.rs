//! Lambertian diffuse reflection: the reflected radiance is the same in all directions.
//!
//! Lambert 1760, *Photometria*. The BRDF is reflectance/pi. The materials of the lecture notes
//! (`phong`, `blinn_phong`, `whitted`) have no factor 1/pi.
//!
//! - Twin: Mitsuba `diffuse` in `twosided` (native).
//! - Example: `scenes/materials/matte.toml`.

use crate::support::reflectance::reflectance;
use schemars::JsonSchema;
use serde::Deserialize;
use std::f64::consts::FRAC_1_PI;
use std::sync::Arc;
use whitstone_core::config::TextureRef;
use whitstone_core::stream::{Colors, GROUP, SampleStreams, SurfaceStream, groups};
use whitstone_core::{
    BsdfFlags, ColorSource, Context, DVec3, LightSamples, Material, Materials, Plugin, Rgb, SceneErrors,
    SurfaceAttributes, SurfaceInteraction, simd,
};

/// Lambertian diffuse reflection: the reflected radiance is the same in all directions.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// Share of the light that is reflected (albedo), from 0 to 1; a texture or a colour.
    #[serde(default = "half")]
    reflectance: TextureRef,
}

fn half() -> TextureRef {
    TextureRef::grey(0.5)
}

/// The `matte` material; see the module documentation.
pub struct Matte {
    reflectance: ColorSource,
}

impl Plugin<Materials> for Matte {
    const TYPE: &'static str = "matte";
    type Config = Config;

    fn build(config: Config, (): (), context: &mut dyn Context) -> Result<Arc<dyn Material>, SceneErrors> {
        let reflectance = reflectance(&config.reflectance, context)?;
        Ok(Arc::new(Self { reflectance }))
    }
}

impl Material for Matte {
    fn flags(&self) -> BsdfFlags {
        if self.reflectance.is_black() {
            BsdfFlags::NOTHING
        } else {
            BsdfFlags::LOCAL
        }
    }

    fn needs(&self) -> SurfaceAttributes {
        SurfaceAttributes::SHADING_NORMAL | self.reflectance.needs()
    }

    fn local_illumination(&self, point: &SurfaceInteraction, view: DVec3, light: &LightSamples<'_>) -> Rgb {
        let n = point.n_towards(view);
        let mut irradiance = Rgb::BLACK;
        for incoming in light.lights {
            irradiance += facing(n, incoming.direction, incoming.irradiance);
        }
        reflected(self.reflectance.value(point), light.ambient, irradiance)
    }

    fn local_illumination_stream(
        &self,
        points: &SurfaceStream,
        ambient: Rgb,
        lights: &SampleStreams,
        out: &mut Colors,
    ) {
        self.reflectance.value_stream(points, out);
        simd::dispatch(
            #[inline(always)]
            || {
                for start in groups(points.len) {
                    let mut irradiance = [Rgb::BLACK; GROUP];
                    for light in lights.iter() {
                        for (k, sum) in irradiance.iter_mut().enumerate() {
                            let lane = start + k;
                            let n = points.get(lane).n_towards(points.view.get(lane));
                            *sum += facing(n, light.direction.get(lane), light.irradiance.get(lane));
                        }
                    }
                    for (k, irradiance) in irradiance.into_iter().enumerate() {
                        let lane = start + k;
                        out.set(lane, reflected(out.get(lane), ambient, irradiance));
                    }
                }
            },
        );
    }
}

/// Irradiance on a surface with unit normal `n`, of light that a facing surface receives.
#[inline(always)]
fn facing(n: DVec3, direction: DVec3, irradiance: Rgb) -> Rgb {
    irradiance * n.dot(direction).max(0.0)
}

/// Reflected radiance.
#[inline(always)]
fn reflected(reflectance: Rgb, ambient: Rgb, irradiance: Rgb) -> Rgb {
    reflectance * (ambient + irradiance * FRAC_1_PI)
}

#[cfg(test)]
mod tests {
    use super::*;
    use whitstone_core::IncidentLight;
    use whitstone_testkit::build;

    whitstone_testkit::material_laws!(
        Matte: material_laws + furnace_laws + energy_laws + reciprocity_laws,
        "",
        "reflectance = [0, 0.3, 1]",
        "reflectance = 0",
        "reflectance = [0.0..1, 0.0..1, 0.0..1]",
    );

    #[test]
    fn the_closed_form() {
        let material = build::<Materials, Matte>("reflectance = 0.5", ()).unwrap();
        let point = SurfaceInteraction::new(DVec3::ZERO, 0.0, DVec3::Z);
        let lights = [
            IncidentLight {
                direction: DVec3::new(0.6, 0.0, 0.8),
                irradiance: Rgb::splat(2.0),
            },
            IncidentLight {
                direction: DVec3::Z,
                irradiance: Rgb::new(1.0, 0.0, 0.0),
            },
        ];
        let light = LightSamples {
            ambient: Rgb::splat(4.0),
            lights: &lights,
        };
        let found = material.local_illumination(&point, DVec3::Z, &light);
        assert!((found.r - (2.0 + 0.5 * 2.6 / std::f64::consts::PI)).abs() < 1e-15);
        assert!((found.g - (2.0 + 0.5 * 1.6 / std::f64::consts::PI)).abs() < 1e-15);
    }

    #[test]
    fn lobes_are_exact() {
        let lobes = |text| build::<Materials, Matte>(text, ()).unwrap().flags();
        assert_eq!(lobes("reflectance = [0, 0, 0]"), BsdfFlags::NOTHING);
        assert_eq!(lobes("reflectance = [0, 1e-9, 0]"), BsdfFlags::LOCAL);
    }

    #[test]
    fn a_reflectance_above_one_is_refused_at_its_place() {
        let text = "reflectance = [0, 1.5, 1]";
        let error = build::<Materials, Matte>(text, ()).err().unwrap().0.remove(0);
        assert_eq!(&text[error.span.unwrap()], "[0, 1.5, 1]");
        assert!(build::<Materials, Matte>("reflectance = -0.1", ()).is_err());
    }
}
