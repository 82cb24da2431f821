//! Diffuse reflection with a highlight around the half vector.
//!
//! Blinn 1977, *Models of light reflection for computer synthesized pictures*, as in the lecture
//! notes: no 1/pi, and the highlight is not multiplied by n·l.
//!
//! - Twin: hosted by the Mitsuba driver as a Python BSDF; POV-Ray `specular` (native).
//! - Example: `scenes/materials/blinn_phong.toml`.

use crate::support::gloss::{Gloss, Highlight};
use schemars::JsonSchema;
use serde::Deserialize;
use std::sync::Arc;
use whitstone_core::config::{Positive, TextureRef};
use whitstone_core::stream::{Colors, SampleStreams, SurfaceStream};
use whitstone_core::{
    BsdfFlags, Context, DVec3, LightSamples, Material, Materials, Plugin, Rgb, SceneErrors,
    SurfaceAttributes, SurfaceInteraction,
};

/// Diffuse reflection with a highlight around the half vector.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// Diffuse coefficient, per steradian; a texture or a colour.
    #[serde(default = "half")]
    k_d: TextureRef,
    /// Coefficient of the highlight, per steradian; a texture or a colour.
    #[serde(default = "half")]
    k_s: TextureRef,
    /// Exponent of the highlight; larger values make it sharper.
    #[serde(default = "sharp")]
    exponent: Positive,
    /// Ambient coefficient; a texture or a colour.
    #[serde(default)]
    #[schemars(extend("x-default" = "that of `k_d`"), with = "TextureRef")]
    k_a: Option<TextureRef>,
}

fn half() -> TextureRef {
    TextureRef::grey(0.5)
}

fn sharp() -> Positive {
    Positive::new(32.0).expect("32 is positive")
}

/// The `blinn_phong` material; see the module documentation.
pub struct BlinnPhong {
    gloss: Gloss,
}

impl Plugin<Materials> for BlinnPhong {
    const TYPE: &'static str = "blinn_phong";
    type Config = Config;

    fn build(config: Config, (): (), context: &mut dyn Context) -> Result<Arc<dyn Material>, SceneErrors> {
        let Config {
            k_d,
            k_s,
            exponent,
            k_a,
        } = config;
        let gloss = Gloss::new(k_a.as_ref(), &k_d, &k_s, exponent.get(), context)?;
        Ok(Arc::new(Self { gloss }))
    }
}

impl Material for BlinnPhong {
    fn flags(&self) -> BsdfFlags {
        if self.gloss.is_black() {
            BsdfFlags::NOTHING
        } else {
            BsdfFlags::LOCAL
        }
    }

    fn needs(&self) -> SurfaceAttributes {
        self.gloss.needs()
    }

    fn local_illumination(&self, point: &SurfaceInteraction, view: DVec3, light: &LightSamples<'_>) -> Rgb {
        self.gloss
            .local_illumination(Highlight::BlinnPhong, point, view, light)
    }

    fn local_illumination_stream(
        &self,
        points: &SurfaceStream,
        ambient: Rgb,
        lights: &SampleStreams,
        out: &mut Colors,
    ) {
        self.gloss
            .local_illumination_stream(Highlight::BlinnPhong, points, ambient, lights, out);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use whitstone_core::IncidentLight;
    use whitstone_testkit::{build, material_laws};

    #[test]
    fn laws() {
        for text in [
            "",
            "k_d = [0, 1, 0.5]\nk_s = 1\nexponent = 1e8",
            "k_d = 0\nk_s = 0",
            "exponent = 1e-3",
        ] {
            material_laws(&*build::<Materials, BlinnPhong>(text, ()).unwrap());
        }
    }

    #[test]
    fn the_closed_form() {
        let material =
            build::<Materials, BlinnPhong>("k_d = 0.25\nk_s = [1, 2, 0]\nexponent = 4", ()).unwrap();
        let point = SurfaceInteraction::new(DVec3::ZERO, 0.0, DVec3::Z);
        let lights = [IncidentLight {
            direction: DVec3::new(0.96, 0.0, 0.28),
            irradiance: Rgb::splat(2.0),
        }];
        let light = LightSamples {
            ambient: Rgb::BLACK,
            lights: &lights,
        };
        // The half vector of (0.96, 0, 0.28) and z is (0.6, 0, 0.8).
        let found = material.local_illumination(&point, DVec3::Z, &light);
        let expected = [1.0, 2.0, 0.0].map(|k_s| 2.0 * (0.25 * 0.28 + k_s * 0.8_f64.powi(4)));
        for (a, b) in found.to_array().into_iter().zip(expected) {
            assert!((a - b).abs() < 1e-15, "{a} {b}");
        }
    }

    #[test]
    fn light_from_straight_across_has_no_highlight() {
        let material = build::<Materials, BlinnPhong>("k_d = 0", ()).unwrap();
        let point = SurfaceInteraction::new(DVec3::ZERO, 0.0, DVec3::Z);
        let v = DVec3::new(1.0, 0.0, 1e-300);
        let lights = [IncidentLight {
            direction: DVec3::new(-1.0, 0.0, 1e-300),
            irradiance: Rgb::WHITE,
        }];
        let light = LightSamples {
            ambient: Rgb::BLACK,
            lights: &lights,
        };
        assert_eq!(material.local_illumination(&point, v, &light), Rgb::BLACK);
    }
}
