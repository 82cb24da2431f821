//! A matte surface that is darker towards its rim, as dust is (Minnaert, *The Reciprocity Principle
//! in Lunar Photometry*, 1941).
//!
//! f = reflectance/pi (cos of the light · cos of the viewer)^(darkening - 1). It is reciprocal, and
//! its reflection of uniform light from all directions has the closed form in `local`.
//!
//! - Twin: none; the tests hold it to energy, reciprocity, and to the matte surface that it
//!   becomes.
//! - Example: `scenes/chalk.toml`.

use schemars::JsonSchema;
use serde::Deserialize;
use std::f64::consts::FRAC_1_PI;
use std::sync::Arc;
use toml::Spanned;
use whitstone_core::config::{Finite, TextureRef};
use whitstone_core::{
    ColorSource, Context, DVec3, Illumination, Lobes, Material, Materials, Needs, Plugin, Rgb, SceneError,
    SceneErrors, SurfacePoint,
};

/// A matte surface that is darker towards its rim.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// Fraction of the light that is reflected at normal incidence and viewing, from 0 to 1; a
    /// texture or a colour.
    #[serde(default = "half")]
    reflectance: TextureRef,
    /// At least 1: 1 is a plain matte surface, more is darker towards the rim. 1.5 if left out.
    #[serde(default)]
    #[schemars(with = "Option<f64>")]
    darkening: Option<Spanned<Finite>>,
}

fn half() -> TextureRef {
    TextureRef::grey(0.5)
}

/// See the module.
pub struct Chalk {
    reflectance: ColorSource,
    darkening: f64,
}

impl Plugin<Materials> for Chalk {
    const TYPE: &'static str = "chalk";
    type Config = Config;

    fn build(config: Config, (): (), context: &mut dyn Context) -> Result<Arc<dyn Material>, SceneErrors> {
        let mut errors = SceneErrors::default();
        let darkening = match &config.darkening {
            Some(value) if value.get_ref().get() < 1.0 => {
                let message = format!(
                    "expected a darkening of at least 1, found {}",
                    value.get_ref().get()
                );
                errors.0.push(SceneError::at(value.span(), message));
                1.0
            }
            Some(value) => value.get_ref().get(),
            None => 1.5,
        };
        // All errors are reported at once.
        let reflectance = errors.take(context.texture(&config.reflectance));
        let reflectance = reflectance.unwrap_or(ColorSource::Constant(Rgb::BLACK));
        errors.into_result(Arc::new(Self {
            reflectance,
            darkening,
        }) as Arc<dyn Material>)
    }
}

impl Material for Chalk {
    fn lobes(&self) -> Lobes {
        if self.reflectance.is_black() {
            Lobes::NOTHING
        } else {
            Lobes::LOCAL
        }
    }

    fn needs(&self) -> Needs {
        Needs::SHADING_NORMAL | self.reflectance.needs()
    }

    fn local(&self, point: &SurfacePoint, view: DVec3, light: &Illumination<'_>) -> Rgb {
        let n = point.n_towards(view);
        // No light below the horizon: a negative base has no real power.
        let cosine = |direction: DVec3| n.dot(direction).max(0.0);
        let mut irradiance = Rgb::BLACK;
        for incoming in light.lights {
            irradiance += incoming.irradiance * cosine(incoming.direction).powf(self.darkening);
        }
        // The integral of f cos over the hemisphere.
        let from_everywhere = light.ambient * (2.0 / (self.darkening + 1.0));
        let rim = cosine(view).powf(self.darkening - 1.0);
        self.reflectance.value(point) * (from_everywhere + irradiance * FRAC_1_PI) * rim
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use whitstone_core::Incoming;
    use whitstone_testkit::build;

    whitstone_testkit::material_laws!(
        Chalk: material_laws + furnace_laws + energy_laws + reciprocity_laws,
        "",
        "reflectance = [0, 0.5, 1]",
        "reflectance = 0.0..1\ndarkening = 1.0..4",
    );

    #[test]
    fn without_darkening_it_is_matte() {
        let material = build::<Materials, Chalk>("reflectance = 0.5\ndarkening = 1", ()).unwrap();
        let point = SurfacePoint::new(DVec3::ZERO, 0.0, DVec3::Z);
        let light = Illumination {
            ambient: Rgb::BLACK,
            lights: &[Incoming {
                direction: DVec3::new(0.6, 0.0, 0.8),
                irradiance: Rgb::WHITE,
            }],
        };
        let found = material.local(&point, DVec3::new(0.0, 0.6, 0.8), &light);
        assert!((found.g - 0.5 * 0.8 * FRAC_1_PI).abs() < 1e-15, "{found:?}");
    }

    #[test]
    fn too_little_darkening_is_told_at_its_place() {
        let errors = build::<Materials, Chalk>("darkening = 0.5", ()).err().unwrap();
        assert_eq!(errors.0[0].span, Some(12..15));
    }
}
