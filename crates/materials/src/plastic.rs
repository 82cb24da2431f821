//! Plastic, lacquer and glaze: a diffuse base under a clear dielectric coat.
//!
//! The coat reflects a share R of the light by Fresnel's equations. The rest enters it, is
//! scattered by the base, and in part reflected back and forth between base and coat before it
//! leaves, as in Mitsuba's `plastic` with `nonlinear = false` (Jakob and others, *Mitsuba 3*). With
//! the diffuse reflectance F of the coat from inside and `m = interior_ior/exterior_ior`, that
//! material is `reflectance (1 - R(v)) (1 - R(l))/(m² (1 - F_inside))/pi`; here the factor
//! `m² (1 - F_inside) = 1 - F_outside` is exact (`optics.rs`), and the coat is on both sides. So
//! the share `reflectance` of the light that enters the coat leaves it again. Reflections in the
//! coat may be blurred by the lobe of `glossy`.
//!
//! - Twin: hosted by the Mitsuba driver, which scales Mitsuba's `plastic` to the exact diffuse
//!   reflectance.
//! - Example: `scenes/materials/plastic.toml`.

use crate::support::lobe::{Exponent, Lobe, Samples};
use crate::support::optics::{Interface, reflect};
use crate::support::reflectance::reflectance;
use schemars::JsonSchema;
use serde::Deserialize;
use std::f64::consts::FRAC_1_PI;
use std::sync::Arc;
use whitstone_core::config::{Positive, TextureRef};
use whitstone_core::{
    BsdfFlags, ColorSource, Context, DVec3, GlossyLobe, LightSamples, Material, Materials, Plugin, Rgb,
    SceneErrors, SpecularRay, SpecularRayKind, SpecularRays, SurfaceAttributes, SurfaceInteraction,
};

/// A diffuse base under a dielectric coat, on both sides, such as plastic or lacquer.
///
/// The coat reflects more towards grazing angles, by Fresnel's equations. Lights illuminate the
/// base, but show no highlights on the coat: it reflects surfaces and the background. With
/// `samples` above 1, each bounce multiplies the number of rays by samples², as for `glossy`.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// Share of the light that enters the coat and leaves it again, from 0 to 1; a texture or a
    /// colour.
    #[serde(default = "half")]
    reflectance: TextureRef,
    /// Index of refraction of the coat.
    #[serde(default = "glass")]
    interior_ior: Positive,
    /// Index of refraction outside.
    #[serde(default = "vacuum")]
    exterior_ior: Positive,
    #[serde(default)]
    exponent: Exponent,
    /// The directions of the reflection form a grid of n x n, which is mapped to the lobe; this is
    /// n, 1 to 8. 1 is a smooth coat.
    #[serde(default = "Samples::of::<1>")]
    samples: Samples,
}

fn half() -> TextureRef {
    TextureRef::grey(0.5)
}

fn glass() -> Positive {
    Positive::new(1.5).expect("1.5 is positive")
}

fn vacuum() -> Positive {
    Positive::new(1.0).expect("1 is positive")
}

/// The `plastic` material; see the module documentation.
pub struct Plastic {
    reflectance: ColorSource,
    /// The coat, from outside.
    coat: Interface,
    /// 1/(1 - F).
    gain: f64,
    lobe: Lobe,
}

impl Plugin<Materials> for Plastic {
    const TYPE: &'static str = "plastic";
    type Config = Config;

    fn build(config: Config, (): (), context: &mut dyn Context) -> Result<Arc<dyn Material>, SceneErrors> {
        let coat = Interface::new(config.exterior_ior.get(), config.interior_ior.get());
        Ok(Arc::new(Self {
            reflectance: reflectance(&config.reflectance, context)?,
            // It underflows for absurd indices.
            gain: 1.0 / coat.diffuse_transmittance().max(f64::MIN_POSITIVE),
            coat,
            lobe: Lobe::new(config.exponent, config.samples),
        }))
    }
}

impl Material for Plastic {
    fn flags(&self) -> BsdfFlags {
        let mut flags = BsdfFlags::NOTHING;
        if !self.reflectance.is_black() {
            flags = flags | BsdfFlags::LOCAL;
        }
        if !self.coat.is_open() {
            flags = flags | BsdfFlags::REFLECTION;
        }
        flags
    }

    fn needs(&self) -> SurfaceAttributes {
        SurfaceAttributes::SHADING_NORMAL | self.reflectance.needs()
    }

    fn local_illumination(&self, point: &SurfaceInteraction, view: DVec3, light: &LightSamples<'_>) -> Rgb {
        let n = point.n_towards(view);
        // The irradiance below the coat.
        let mut entered = Rgb::BLACK;
        for incoming in light.lights {
            let cosine = n.dot(incoming.direction);
            if cosine > 0.0 {
                let share = self.coat.shares(n, incoming.direction).transmitted;
                entered += incoming.irradiance * (cosine * share);
            }
        }
        let leaving = self.coat.shares(n, view).transmitted;
        let radiance = light.ambient + entered * (self.gain * FRAC_1_PI);
        self.reflectance.value(point) * radiance * leaving
    }

    fn specular_rays(&self, point: &SurfaceInteraction, view: DVec3, out: &mut SpecularRays) {
        let n = point.n_towards(view);
        let reflected = self.coat.shares(n, view).reflected;
        if reflected > 0.0 {
            out.push(SpecularRay {
                direction: reflect(n, view),
                weight: Rgb::splat(reflected),
                kind: SpecularRayKind::Reflection,
            });
        }
    }

    fn reflections(&self) -> u32 {
        if self.coat.is_open() { 1 } else { self.lobe.rays() }
    }

    fn glossy_lobe(
        &self,
        point: &SurfaceInteraction,
        view: DVec3,
        kind: SpecularRayKind,
    ) -> Option<GlossyLobe<'_>> {
        self.lobe.of_reflection(point, view, kind)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use whitstone_core::IncidentLight;
    use whitstone_testkit::{build, energy_laws, furnace_laws, material_laws, reciprocity_laws};

    fn plastic(text: &str) -> Arc<dyn Material> {
        build::<Materials, Plastic>(text, ()).unwrap()
    }

    #[test]
    fn laws() {
        for text in [
            "",
            "reflectance = 1\ninterior_ior = 1.9",
            "reflectance = [0, 0.3, 1]\ninterior_ior = 1.000000000001",
            "reflectance = 0\nsamples = 3",
            "interior_ior = 1\nsamples = 2",
            "interior_ior = 2.5\nexterior_ior = 1.3\nsamples = 8\nexponent = 7",
        ] {
            let material = plastic(text);
            material_laws(&*material);
            furnace_laws(&*material);
            energy_laws(&*material);
            reciprocity_laws(&*material);
        }
        for text in [
            "exterior_ior = 1.5\ninterior_ior = 1",
            "interior_ior = 1e150",
            "interior_ior = 1e-150",
            "interior_ior = 1e6",
        ] {
            material_laws(&*plastic(text));
            furnace_laws(&*plastic(text));
        }
    }

    /// Under the same radiance from everywhere, the local term is `reflectance (1 - R)`, whether
    /// that radiance is an ambient light or comes from many lights.
    #[test]
    fn what_enters_the_coat_leaves_it_again() {
        let point = SurfaceInteraction::new(DVec3::ZERO, 0.0, DVec3::Z);
        let view = DVec3::new(0.0, 0.8, 0.6);
        for (interior, exterior) in [(1.5, 1.0), (3.0, 1.0), (1.02, 1.0), (1.3, 1.5)] {
            let material = plastic(&format!(
                "reflectance = 0.25\ninterior_ior = {interior:?}\nexterior_ior = {exterior:?}"
            ));
            // Rings of equal steps of the sine, because the cosine has a root at total reflection.
            let count = 200_000;
            let lights: Vec<IncidentLight> = (0..count)
                .map(|i| {
                    let sine = (f64::from(i) + 0.5) / f64::from(count);
                    let cosine = ((1.0 - sine) * (1.0 + sine)).sqrt();
                    IncidentLight {
                        direction: DVec3::new(sine, 0.0, cosine),
                        // A radiance of 1 over a solid angle of tau sine dsine/cosine.
                        irradiance: Rgb::splat(std::f64::consts::TAU * sine / cosine / f64::from(count)),
                    }
                })
                .collect();
            let of = |ambient: f64, lights: &[IncidentLight]| {
                let ambient = Rgb::splat(ambient);
                material
                    .local_illumination(&point, view, &LightSamples { ambient, lights })
                    .g
            };
            let mut branches = SpecularRays::default();
            material.specular_rays(&point, view, &mut branches);
            let reflected = branches.iter().next().map_or(0.0, |branch| branch.weight.g);
            let expected = 0.25 * (1.0 - reflected);
            assert!((of(1.0, &[]) - expected).abs() < 1e-15);
            let found = of(0.0, &lights);
            assert!(
                (found - expected).abs() < 1e-5 * expected,
                "{interior}: {found} {expected}"
            );
        }
    }

    #[test]
    fn the_closed_form() {
        let material = plastic("reflectance = [0.5, 1, 0]");
        let lights = [IncidentLight {
            direction: DVec3::new(0.6, 0.0, 0.8),
            irradiance: Rgb::splat(2.0),
        }];
        let light = LightSamples {
            ambient: Rgb::BLACK,
            lights: &lights,
        };
        // R at a cosine of 0.8 onto an index of 1.5, with cos_t = sqrt(1 - 0.36/2.25).
        let cos_t = 0.84_f64.sqrt();
        let r_s = (0.8 - 1.5 * cos_t) / (0.8 + 1.5 * cos_t);
        let r_p = (1.2 - cos_t) / (1.2 + cos_t);
        let into = 1.0 - 0.5 * (r_s * r_s + r_p * r_p);
        let expected = 0.5 * 0.96 * into / 0.908_222_040_657_648_3 / std::f64::consts::PI * 0.8 * 2.0;
        for n in [DVec3::Z, DVec3::NEG_Z] {
            let point = SurfaceInteraction::new(DVec3::ZERO, 0.0, n);
            let found = material.local_illumination(&point, DVec3::Z, &light);
            assert!((found.r - expected).abs() < 1e-15, "{} {expected}", found.r);
            assert_eq!((found.g, found.b), (2.0 * found.r, 0.0));
            let mut branches = SpecularRays::default();
            material.specular_rays(&point, DVec3::Z, &mut branches);
            let [branch] = branches.iter().collect::<Vec<_>>()[..] else {
                panic!("the coat reflects")
            };
            assert!((branch.weight.g - 0.04).abs() < 1e-16);
            assert_eq!(branch.direction, DVec3::Z);
        }
    }

    #[test]
    fn an_open_coat_is_none() {
        let material = plastic("interior_ior = 1\nsamples = 2");
        assert_eq!(material.flags(), BsdfFlags::LOCAL);
        assert_eq!(material.reflections(), 1);
        let blurred = plastic("samples = 3");
        assert_eq!(blurred.reflections(), 9);
        let point = SurfaceInteraction::new(DVec3::ZERO, 0.0, DVec3::Z);
        let lobe = blurred.glossy_lobe(&point, DVec3::Z, SpecularRayKind::Reflection);
        assert_eq!(lobe.unwrap().lobe.len(), 9);
        assert_eq!(plastic("reflectance = 0").flags(), BsdfFlags::REFLECTION);
        let point = SurfaceInteraction::new(DVec3::ZERO, 0.0, DVec3::Z);
        let light = LightSamples {
            ambient: Rgb::WHITE,
            lights: &[],
        };
        assert_eq!(material.local_illumination(&point, DVec3::Z, &light).g, 0.5);
    }

    #[test]
    fn faults_are_refused_at_their_places() {
        for (text, place) in [
            ("reflectance = 1.5", "1.5"),
            ("interior_ior = 0", "0"),
            ("exterior_ior = -1", "-1"),
            ("exponent = 0", "0"),
            ("samples = 9", "9"),
        ] {
            let error = build::<Materials, Plastic>(text, ()).err().unwrap().0.remove(0);
            assert_eq!(&text[error.span.unwrap()], place);
        }
    }
}
