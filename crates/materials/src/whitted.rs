//! The material of the lecture notes: Phong shading plus reflection and refraction with constant
//! weights.
//!
//! Whitted 1980, *An improved illumination model for shaded display*: `k_refl` and `k_refr` do not
//! depend on the angle, except that total internal reflection moves `k_refr` to the reflected ray.
//! Transmitted radiance is not scaled by the squared relative index.
//!
//! - Twin: hosted by the Mitsuba driver as a Python BSDF; POV-Ray `phong`, `reflection` and a
//!   filter (native), with a second texture for total internal reflection.
//! - Example: `scenes/materials/whitted.toml`.

use crate::support::body::Body;
use crate::support::gloss::{Gloss, Highlight};
use schemars::JsonSchema;
use serde::Deserialize;
use std::sync::Arc;
use whitstone_core::config::{Color, Positive, TextureRef};
use whitstone_core::stream::{Colors, LANES, SampleStreams, SurfaceStream};
use whitstone_core::{
    BsdfFlags, ColorSource, Context, DVec3, LightSamples, Material, Materials, Plugin, Rgb, SceneErrors,
    SpecularRay, SpecularRayKind, SpecularRayStreams, SpecularRays, SurfaceAttributes, SurfaceInteraction,
    Transmittance, simd,
};

/// Phong shading plus reflection and refraction with constant weights.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// Diffuse coefficient, per steradian; a texture or a colour.
    #[serde(default = "nothing")]
    k_d: TextureRef,
    /// Coefficient of the highlight, per steradian; a texture or a colour.
    #[serde(default = "nothing")]
    k_s: TextureRef,
    /// Exponent of the highlight; larger values make it sharper.
    #[serde(default = "sharp")]
    exponent: Positive,
    /// Ambient coefficient; a texture or a colour.
    #[serde(default)]
    #[schemars(extend("x-default" = "that of `k_d`"), with = "TextureRef")]
    k_a: Option<TextureRef>,
    /// Factor on the radiance of the reflected ray; a texture or a colour.
    #[serde(default = "nothing")]
    k_refl: TextureRef,
    /// Factor on the radiance of the refracted ray; a texture or a colour.
    #[serde(default = "nothing")]
    k_refr: TextureRef,
    /// Index of refraction inside.
    #[serde(default = "glass")]
    interior_ior: Positive,
    /// Index of refraction outside.
    #[serde(default = "vacuum")]
    exterior_ior: Positive,
    /// Absorption coefficient inside, per metre.
    #[serde(default = "clear")]
    absorption: Color,
    /// Absorption coefficient outside, per metre, for rays that leave the body.
    #[serde(default = "clear")]
    exterior_absorption: Color,
}

fn nothing() -> TextureRef {
    TextureRef::grey(0.0)
}

fn sharp() -> Positive {
    Positive::new(32.0).expect("32 is positive")
}

fn glass() -> Positive {
    Positive::new(1.5).expect("1.5 is positive")
}

fn vacuum() -> Positive {
    Positive::new(1.0).expect("1 is positive")
}

fn clear() -> Color {
    Color::grey(0.0)
}

/// The `whitted` material; see the module documentation.
pub struct Whitted {
    gloss: Gloss,
    k_refl: ColorSource,
    k_refr: ColorSource,
    body: Body,
}

impl Plugin<Materials> for Whitted {
    const TYPE: &'static str = "whitted";
    type Config = Config;

    fn build(config: Config, (): (), context: &mut dyn Context) -> Result<Arc<dyn Material>, SceneErrors> {
        let mut errors = SceneErrors::default();
        let exponent = config.exponent.get();
        let gloss = Gloss::new(config.k_a.as_ref(), &config.k_d, &config.k_s, exponent, context);
        let gloss = errors.take(gloss);
        let k_refl = errors.take(context.texture(&config.k_refl));
        let k_refr = errors.take(context.texture(&config.k_refr));
        let (Some(gloss), Some(k_refl), Some(k_refr)) = (gloss, k_refl, k_refr) else {
            return Err(errors);
        };
        let interior = (config.interior_ior.get(), config.absorption.get());
        let exterior = (config.exterior_ior.get(), config.exterior_absorption.get());
        Ok(Arc::new(Self {
            gloss,
            k_refl,
            k_refr,
            body: Body::new(interior, exterior),
        }))
    }
}

impl Material for Whitted {
    fn flags(&self) -> BsdfFlags {
        let mut lobes = BsdfFlags::NOTHING;
        if !self.gloss.is_black() {
            lobes = lobes | BsdfFlags::LOCAL;
        }
        if !self.k_refr.is_black() {
            lobes = lobes | BsdfFlags::TRANSMISSION | BsdfFlags::TRANSPARENT_SHADOWS;
        }
        // Total internal reflection moves the transmitted share to the reflected ray.
        let can_be_total = !self.k_refr.is_black() && !self.body.is_open();
        if !self.k_refl.is_black() || can_be_total {
            lobes = lobes | BsdfFlags::REFLECTION;
        }
        lobes
    }

    fn needs(&self) -> SurfaceAttributes {
        self.gloss.needs() | self.k_refl.needs() | self.k_refr.needs()
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

    fn shadow_transmittance(
        &self,
        point: &SurfaceInteraction,
        direction: DVec3,
        filtered: bool,
    ) -> Transmittance {
        if !filtered {
            return Transmittance::OPAQUE;
        }
        self.body.filter(point, direction, self.k_refr.value(point))
    }

    fn specular_rays(&self, point: &SurfaceInteraction, view: DVec3, out: &mut SpecularRays) {
        let passage = self.body.passage(point, view);
        let (k_refl, k_refr) = (self.k_refl.value(point), self.k_refr.value(point));
        let (reflected, transmitted) = weights(k_refl, k_refr, passage.crossing.total);
        if !reflected.is_black() {
            out.push(SpecularRay {
                direction: passage.reflected,
                weight: reflected,
                kind: SpecularRayKind::Reflection,
            });
        }
        if !transmitted.is_black() {
            out.push(SpecularRay {
                direction: passage.crossing.direction,
                weight: transmitted,
                kind: SpecularRayKind::Transmission {
                    absorption: passage.absorption,
                },
            });
        }
    }

    fn specular_rays_stream(&self, points: &SurfaceStream, out: &mut SpecularRayStreams) {
        self.k_refl.value_stream(points, &mut out.reflection.weight);
        self.k_refr.value_stream(points, &mut out.transmission.weight);
        simd::dispatch(
            #[inline(always)]
            || {
                for lane in 0..points.len.min(LANES) {
                    let passage = self.body.passage(&points.get(lane), points.view.get(lane));
                    let k_refl = out.reflection.weight.get(lane);
                    let k_refr = out.transmission.weight.get(lane);
                    let (reflected, transmitted) = weights(k_refl, k_refr, passage.crossing.total);
                    out.reflection.direction.set(lane, passage.reflected);
                    out.reflection.weight.set(lane, reflected);
                    out.transmission.direction.set(lane, passage.crossing.direction);
                    out.transmission.weight.set(lane, transmitted);
                    out.absorption.set(lane, passage.absorption);
                }
            },
        );
    }
}

/// Weights of the reflected and the transmitted ray. At total internal reflection, the reflected
/// ray receives both shares.
#[inline(always)]
fn weights(k_refl: Rgb, k_refr: Rgb, total: bool) -> (Rgb, Rgb) {
    (
        k_refl + Rgb::choose(total, k_refr, Rgb::BLACK),
        Rgb::choose(total, Rgb::BLACK, k_refr),
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use whitstone_testkit::{build, furnace_laws, material_laws};

    fn specular_rays(text: &str, n_g: DVec3, view: DVec3) -> Vec<SpecularRay> {
        let mut out = SpecularRays::default();
        let point = SurfaceInteraction::new(DVec3::ZERO, 0.0, n_g);
        build::<Materials, Whitted>(text, ())
            .unwrap()
            .specular_rays(&point, view, &mut out);
        out.iter().copied().collect()
    }

    #[test]
    fn laws() {
        for text in [
            "",
            "k_d = 0.3\nk_s = 0.4\nk_refl = [0, 0.5, 1]",
            "k_refl = 0.25\nk_refr = [0.75, 0, 0.1]\ninterior_ior = 2.4\nabsorption = [1, 0, 0]",
            "k_refr = 1\ninterior_ior = 1",
        ] {
            material_laws(&*build::<Materials, Whitted>(text, ()).unwrap());
        }
    }

    #[test]
    fn shares_that_sum_to_one_keep_the_energy() {
        for text in [
            "k_refl = 0.25\nk_refr = 0.75",
            "k_d = 0.2\nk_refl = 0.3\nk_refr = 0.5\ninterior_ior = 0.7",
        ] {
            furnace_laws(&*build::<Materials, Whitted>(text, ()).unwrap());
        }
    }

    #[test]
    fn shares_do_not_depend_on_the_angle_and_are_not_scaled() {
        for sin in [0.0, 0.5, 0.999_f64] {
            let view = DVec3::new(sin, 0.0, (1.0 - sin * sin).sqrt());
            let found = specular_rays(
                "k_refl = 0.25\nk_refr = [0.5, 0, 1]\nabsorption = 7",
                DVec3::Z,
                view,
            );
            let [r, t] = found[..] else { panic!("{found:?}") };
            assert_eq!((r.weight, t.weight), (Rgb::splat(0.25), Rgb::new(0.5, 0.0, 1.0)));
            assert_eq!(
                t.kind,
                SpecularRayKind::Transmission {
                    absorption: Rgb::splat(7.0)
                }
            );
            assert!((t.direction.x + sin / 1.5).abs() < 1e-15);
        }
    }

    #[test]
    fn what_cannot_be_transmitted_is_reflected() {
        let found = specular_rays(
            "k_refl = 0.25\nk_refr = [0.5, 0, 1]",
            DVec3::NEG_Z,
            DVec3::new(0.8, 0.0, 0.6),
        );
        let [r] = found[..] else { panic!("{found:?}") };
        assert_eq!(
            (r.weight, r.kind),
            (Rgb::new(0.75, 0.25, 1.25), SpecularRayKind::Reflection)
        );
    }

    #[test]
    fn lobes_are_exact() {
        let lobes = |text| build::<Materials, Whitted>(text, ()).unwrap().flags();
        assert_eq!(lobes(""), BsdfFlags::NOTHING);
        assert_eq!(lobes("k_s = 1"), BsdfFlags::LOCAL);
        assert_eq!(lobes("k_refl = 1"), BsdfFlags::REFLECTION);
        let through = BsdfFlags::TRANSMISSION | BsdfFlags::TRANSPARENT_SHADOWS;
        assert_eq!(lobes("k_refr = 1"), BsdfFlags::REFLECTION | through);
        assert_eq!(lobes("k_refr = 1\nexterior_ior = 1.5"), through);
    }
}
