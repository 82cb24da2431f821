//! Diffuse reflection with a highlight around the mirror direction.
//!
//! Phong 1975, *Illumination for computer generated pictures*, as in the lecture notes: no 1/pi,
//! and the highlight is not multiplied by n·l.
//!
//! - Twin: hosted by the Mitsuba driver as a Python BSDF (Mitsuba's own `phong` is normalised);
//!   POV-Ray `phong` (native).
//! - Example: `scenes/materials/phong.toml`.

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

/// Diffuse reflection with a highlight around the mirror direction.
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

/// The `phong` material; see the module documentation.
pub struct Phong {
    gloss: Gloss,
}

impl Plugin<Materials> for Phong {
    const TYPE: &'static str = "phong";
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

impl Material for Phong {
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
            .local_illumination(Highlight::Phong, point, view, light)
    }

    fn local_illumination_stream(
        &self,
        points: &SurfaceStream,
        ambient: Rgb,
        lights: &SampleStreams,
        out: &mut Colors,
    ) {
        self.gloss
            .local_illumination_stream(Highlight::Phong, points, ambient, lights, out);
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
            material_laws(&*build::<Materials, Phong>(text, ()).unwrap());
        }
    }

    #[test]
    fn the_closed_form() {
        let material = build::<Materials, Phong>("k_d = 0.25\nk_s = [1, 2, 0]\nexponent = 2", ()).unwrap();
        let point = SurfaceInteraction::new(DVec3::ZERO, 0.0, DVec3::Z);
        let lights = [IncidentLight {
            direction: DVec3::new(0.6, 0.0, 0.8),
            irradiance: Rgb::splat(2.0),
        }];
        let light = LightSamples {
            ambient: Rgb::splat(4.0),
            lights: &lights,
        };
        // The mirror direction of the light is (-0.6, 0, 0.8): its cosine with the viewer is 0.8.
        let found = material.local_illumination(&point, DVec3::Z, &light);
        let expected = [1.0, 2.0, 0.0].map(|k_s| 1.0 + 2.0 * (0.25 * 0.8 + k_s * 0.64));
        for (a, b) in found.to_array().into_iter().zip(expected) {
            assert!((a - b).abs() < 1e-15, "{a} {b}");
        }
        // Seen from below, the result is the same because materials show both sides. The light
        // above does not count.
        let below = LightSamples {
            ambient: Rgb::splat(4.0),
            lights: &[],
        };
        assert_eq!(
            material.local_illumination(&point, DVec3::NEG_Z, &below),
            Rgb::WHITE
        );
        let behind = material.local_illumination(&point, DVec3::NEG_Z, &light);
        assert_eq!(behind, Rgb::WHITE);
    }

    #[test]
    fn k_a_is_k_d_unless_given() {
        let ambient = |text| {
            let light = LightSamples {
                ambient: Rgb::WHITE,
                lights: &[],
            };
            let point = SurfaceInteraction::new(DVec3::ZERO, 0.0, DVec3::Z);
            build::<Materials, Phong>(text, ())
                .unwrap()
                .local_illumination(&point, DVec3::Z, &light)
                .g
        };
        assert_eq!(ambient("k_d = 0.7"), 0.7);
        assert_eq!(ambient("k_d = 0.7\nk_a = 0.1"), 0.1);
    }

    #[test]
    fn lobes_are_exact() {
        let lobes = |text| build::<Materials, Phong>(text, ()).unwrap().flags();
        assert_eq!(lobes("k_d = 0\nk_s = 0"), BsdfFlags::NOTHING);
        assert_eq!(lobes("k_d = 0\nk_s = 0\nk_a = 1"), BsdfFlags::LOCAL);
    }

    #[test]
    fn all_bad_values_are_refused() {
        let errors = build::<Materials, Phong>("k_d = -1\nexponent = 0\nk_s = [1, 2]", ())
            .err()
            .unwrap();
        assert_eq!(errors.0.len(), 3);
    }
}
