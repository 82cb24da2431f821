//! A matte surface that darkens towards its rim, like dust (Minnaert, *The Reciprocity Principle
//! in Lunar Photometry*, 1941).
//!
//! The BRDF is f = reflectance/pi (cos of the light · cos of the viewer)^darkening. It is
//! reciprocal, and its reflection of uniform illumination has the closed form in
//! `local_illumination`.
//!
//! - Twin: none; the tests check energy, reciprocity, and the matte surface as a special case.
//! - Example: `scenes/chalk.toml`.

use schemars::JsonSchema;
use serde::Deserialize;
use std::f64::consts::FRAC_1_PI;
use std::sync::Arc;
use whitstone_core::config::{NonNegative, TextureRef};
use whitstone_core::{
    BsdfFlags, ColorSource, Context, DVec3, LightSamples, Material, Materials, Plugin, Rgb, SceneError,
    SceneErrors, SurfaceAttributes, SurfaceInteraction,
};

/// A matte surface that darkens towards its rim.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// Share of the light that is reflected at normal incidence towards the normal, from 0 to 1; a
    /// texture or a colour.
    #[serde(default = "half")]
    reflectance: TextureRef,
    /// 0 is a plain matte surface; larger values are darker towards the rim.
    #[serde(default = "half_as_dark")]
    darkening: NonNegative,
}

fn half() -> TextureRef {
    TextureRef::grey(0.5)
}

fn half_as_dark() -> NonNegative {
    NonNegative::new(0.5).expect("0.5 is not negative")
}

/// The material that `Config` describes; see the module documentation.
pub struct Chalk {
    reflectance: ColorSource,
    darkening: f64,
}

impl Plugin<Materials> for Chalk {
    const TYPE: &'static str = "chalk";
    type Config = Config;

    fn build(config: Config, (): (), context: &mut dyn Context) -> Result<Arc<dyn Material>, SceneErrors> {
        let reflectance = context.texture(&config.reflectance)?;
        if let ColorSource::Constant(color) = reflectance
            && color.max_component() > 1.0
        {
            let found = color.max_component();
            let mut error =
                SceneError::anywhere(format!("expected a reflectance from 0 to 1, found {found}"));
            error.span = config.reflectance.span.clone();
            return Err(error.into());
        }
        Ok(Arc::new(Self {
            reflectance,
            darkening: config.darkening.get(),
        }))
    }
}

impl Material for Chalk {
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
        // Clamped at the horizon: a negative base has no real power.
        let cosine = |direction: DVec3| n.dot(direction).max(0.0);
        let mut irradiance = Rgb::BLACK;
        for incoming in light.lights {
            irradiance += incoming.irradiance * cosine(incoming.direction).powf(self.darkening + 1.0);
        }
        // The integral of f cos over the hemisphere, times the ambient radiance.
        let from_everywhere = light.ambient * (2.0 / (self.darkening + 2.0));
        let rim = cosine(view).powf(self.darkening);
        self.reflectance.value(point) * (from_everywhere + irradiance * FRAC_1_PI) * rim
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use whitstone_core::IncidentLight;
    use whitstone_testkit::build;

    whitstone_testkit::material_laws!(
        Chalk: material_laws + furnace_laws + energy_laws + reciprocity_laws,
        "",
        "reflectance = [0, 0.5, 1]",
        "reflectance = 0.0..1\ndarkening = 0.0..3",
    );

    #[test]
    fn more_light_than_falls_on_it_is_refused() {
        let error = build::<Materials, Chalk>("reflectance = 1.5", ()).err().unwrap();
        assert!(error.to_string().contains("from 0 to 1, found 1.5"), "{error}");
    }

    #[test]
    fn without_darkening_it_is_matte() {
        let material = build::<Materials, Chalk>("reflectance = 0.5\ndarkening = 0", ()).unwrap();
        let point = SurfaceInteraction::new(DVec3::ZERO, 0.0, DVec3::Z);
        let light = LightSamples {
            ambient: Rgb::BLACK,
            lights: &[IncidentLight {
                direction: DVec3::new(0.6, 0.0, 0.8),
                irradiance: Rgb::WHITE,
            }],
        };
        let found = material.local_illumination(&point, DVec3::new(0.0, 0.6, 0.8), &light);
        assert!((found.g - 0.5 * 0.8 * FRAC_1_PI).abs() < 1e-15, "{found:?}");
    }
}
