//! Smooth dielectrics such as glass, water and diamond: Fresnel reflection and refraction.
//!
//! Cook and Torrance 1982 (Fresnel); `optics.rs` derives forms without cancellation. Transmitted
//! radiance is scaled by the squared relative index, so that L/n² is preserved. Bodies with a
//! priority may overlap (Schmidt and Budge 2002, *Simple nested dielectrics in ray traced images*):
//! the core determines the media on the two sides of an interface, as in
//! `scenes/showcase/priorities.toml`.
//!
//! - Twin: Mitsuba `dielectric` (native); absorption by a formula of the driver.
//! - Example: `scenes/materials/dielectric.toml`.

use crate::support::body::Body;
use schemars::JsonSchema;
use serde::Deserialize;
use std::sync::Arc;
use toml::Spanned;
use whitstone_core::config::{Color, IntegerIn, Positive};
use whitstone_core::stream::{GROUP, SurfaceStream, groups};
use whitstone_core::{
    BsdfFlags, Context, DVec3, Material, Materials, Medium, Plugin, PrioritizedDielectric, Rgb, SceneError,
    SceneErrors, SpecularRay, SpecularRayKind, SpecularRayStreams, SpecularRays, SurfaceAttributes,
    SurfaceInteraction, Transmittance, simd, simd::select,
};

/// A smooth transparent body: Fresnel reflection and refraction.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// Index of refraction inside.
    #[serde(default = "glass")]
    interior_ior: Positive,
    /// Index of refraction outside.
    #[serde(default = "vacuum")]
    #[schemars(with = "Positive")]
    exterior_ior: Spanned<Positive>,
    /// Absorption coefficient inside, per metre.
    #[serde(default = "clear")]
    absorption: Color,
    /// Absorption coefficient outside, per metre, for rays that leave the body.
    #[serde(default = "clear_outside")]
    #[schemars(with = "Color")]
    exterior_absorption: Spanned<Color>,
    /// Priority for nested dielectrics (Schmidt and Budge 2002). Where bodies overlap, the one with
    /// the highest priority fills the space (ties: the first in the scene). A ray passes interfaces
    /// that do not change the dominant body undeviated; each counts as a branch. The exterior
    /// medium follows from the surrounding bodies.
    #[serde(default)]
    #[schemars(extend("x-default" = "none: the body does not take part"), with = "IntegerIn<0, 65535>")]
    priority: Option<IntegerIn<0, 65535>>,
}

fn glass() -> Positive {
    Positive::new(1.5).expect("1.5 is positive")
}

fn vacuum() -> Spanned<Positive> {
    Spanned::new(0..0, Positive::new(1.0).expect("1 is positive"))
}

fn clear() -> Color {
    Color::grey(0.0)
}

fn clear_outside() -> Spanned<Color> {
    Spanned::new(0..0, clear())
}

/// The `dielectric` material; see the module documentation.
pub struct Dielectric {
    body: Body,
    /// Priority and interior medium of a body that may overlap others.
    overlaps: Option<(u32, Medium)>,
}

impl Plugin<Materials> for Dielectric {
    const TYPE: &'static str = "dielectric";
    type Config = Config;

    fn build(config: Config, (): (), _: &mut dyn Context) -> Result<Arc<dyn Material>, SceneErrors> {
        let (ior, absorption) = (config.interior_ior.get(), config.absorption.get());
        let outside = (config.exterior_ior, config.exterior_absorption);
        let exterior = (outside.0.get_ref().get(), outside.1.get_ref().get());
        if config.priority.is_some() {
            let mut errors = SceneErrors::default();
            for (place, given, expected) in [
                (outside.0.span(), exterior.0 != 1.0, "1"),
                (outside.1.span(), !exterior.1.is_black(), "0"),
            ] {
                if given {
                    let message = format!(
                        "expected {expected}: with a priority, the exterior medium follows from the surrounding bodies"
                    );
                    let help = "give the surrounding body a priority too, or remove this one";
                    errors.0.push(SceneError::at(place, message).with_help(help));
                }
            }
            errors.into_result(())?;
        }
        let priority = config.priority.map(IntegerIn::get);
        Ok(Arc::new(Self {
            body: Body::new((ior, absorption), exterior),
            overlaps: priority.map(|priority| (priority, Medium { ior, absorption })),
        }))
    }
}

impl Material for Dielectric {
    fn flags(&self) -> BsdfFlags {
        // The medium in front of an interface is unknown here if the body may overlap others.
        if self.body.is_open() && self.overlaps.is_none() {
            BsdfFlags::TRANSMISSION | BsdfFlags::TRANSPARENT_SHADOWS
        } else {
            BsdfFlags::REFLECTION | BsdfFlags::TRANSMISSION | BsdfFlags::TRANSPARENT_SHADOWS
        }
    }

    fn prioritized(&self) -> Option<&dyn PrioritizedDielectric> {
        self.overlaps.is_some().then_some(self)
    }

    fn needs(&self) -> SurfaceAttributes {
        SurfaceAttributes::SHADING_NORMAL
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
        let weight = Rgb::splat(self.body.unbent(point, direction));
        self.body.filter(point, direction, weight)
    }

    fn specular_rays(&self, point: &SurfaceInteraction, view: DVec3, out: &mut SpecularRays) {
        Split::new(&self.body, point, view).push(out);
    }

    fn specular_rays_stream(&self, points: &SurfaceStream, out: &mut SpecularRayStreams) {
        out.clear_media = self.body.is_clear();
        simd::dispatch(
            #[inline(always)]
            || {
                for start in groups(points.len) {
                    for lane in start..start + GROUP {
                        let split = Split::new(&self.body, &points.get(lane), points.view.get(lane));
                        let (reflectance, transmittance) = (split.reflectance, split.transmittance);
                        out.reflection.direction.set(lane, split.reflected);
                        out.reflection.weight.set(lane, Rgb::splat(reflectance));
                        out.transmission.direction.set(lane, split.transmitted);
                        out.transmission.weight.set(lane, Rgb::splat(transmittance));
                        out.absorption.set(lane, split.absorption);
                    }
                }
            },
        );
    }
}

/// Both branches at a point. A branch with weight zero is not traced.
struct Split {
    reflected: DVec3,
    reflectance: f64,
    transmitted: DVec3,
    /// Factor on transmitted radiance, including the squared relative index.
    transmittance: f64,
    /// Absorption coefficient of the medium on the other side, per metre.
    absorption: Rgb,
}

impl Split {
    #[inline(always)]
    fn new(body: &Body, point: &SurfaceInteraction, view: DVec3) -> Self {
        let passage = body.passage(point, view);
        let (crossing, eta) = (&passage.crossing, passage.interface.eta());
        let fresnel = passage.interface.fresnel(crossing);
        // In this order, because eta² may overflow even if the product is finite.
        let transmittance = fresnel.transmitted * eta * eta;
        Self {
            reflected: passage.reflected,
            reflectance: select(crossing.total, 1.0, fresnel.reflected),
            transmitted: crossing.direction,
            transmittance: select(crossing.total, 0.0, transmittance),
            absorption: passage.absorption,
        }
    }

    fn push(&self, out: &mut SpecularRays) {
        if self.reflectance > 0.0 {
            out.push(SpecularRay {
                direction: self.reflected,
                weight: Rgb::splat(self.reflectance),
                kind: SpecularRayKind::Reflection,
            });
        }
        if self.transmittance > 0.0 {
            out.push(SpecularRay {
                direction: self.transmitted,
                weight: Rgb::splat(self.transmittance),
                kind: SpecularRayKind::Transmission {
                    absorption: self.absorption,
                },
            });
        }
    }
}

/// The body equivalent to an interface between two media. `from` is the medium on the side of the
/// viewer in direction `view`.
fn between(point: &SurfaceInteraction, view: DVec3, from: Medium, to: Medium) -> Body {
    let [from, to] = [from, to].map(|medium| (medium.ior, medium.absorption));
    if point.n_g.dot(view) > 0.0 {
        Body::new(to, from)
    } else {
        Body::new(from, to)
    }
}

impl PrioritizedDielectric for Dielectric {
    fn priority(&self) -> u32 {
        self.overlaps.map_or(0, |(priority, _)| priority)
    }

    fn medium(&self) -> Medium {
        self.overlaps.map_or(Medium::NONE, |(_, medium)| medium)
    }

    fn specular_rays_between(
        &self,
        point: &SurfaceInteraction,
        view: DVec3,
        from: Medium,
        to: Medium,
        out: &mut SpecularRays,
    ) {
        Split::new(&between(point, view, from, to), point, view).push(out);
    }

    fn transmittance_between(
        &self,
        point: &SurfaceInteraction,
        direction: DVec3,
        from: Medium,
        to: Medium,
    ) -> Rgb {
        Rgb::splat(between(point, -direction, from, to).unbent(point, direction))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use whitstone_testkit::{build, dielectric_laws, material_laws};

    fn specular_rays(text: &str, n_g: DVec3, view: DVec3) -> Vec<SpecularRay> {
        let mut out = SpecularRays::default();
        let point = SurfaceInteraction::new(DVec3::ZERO, 0.0, n_g);
        build::<Materials, Dielectric>(text, ())
            .unwrap()
            .specular_rays(&point, view, &mut out);
        out.iter().copied().collect()
    }

    #[test]
    fn laws() {
        for (interior, exterior) in [
            (1.5, 1.0),
            (1.0, 1.5),
            (1.0 + 1e-12, 1.0),
            (1.3, 1.3),
            (1e6, 1.0),
            (0.5, 2.0),
        ] {
            let text =
                format!("interior_ior = {interior:?}\nexterior_ior = {exterior:?}\nabsorption = [0, 1, 1e9]");
            let material = build::<Materials, Dielectric>(&text, ()).unwrap();
            material_laws(&*material);
            dielectric_laws(&*material, interior, exterior);
        }
    }

    #[test]
    fn normal_incidence_on_glass() {
        let outside = specular_rays("absorption = 2\nexterior_absorption = 3", DVec3::Z, DVec3::Z);
        let [r, t] = outside[..] else {
            panic!("{outside:?}")
        };
        assert!((r.weight.g - 0.04).abs() < 1e-16);
        assert!((t.weight.g - 0.96 / 2.25).abs() < 1e-15);
        assert_eq!((r.direction, t.direction), (DVec3::Z, DVec3::NEG_Z));
        assert_eq!(
            t.kind,
            SpecularRayKind::Transmission {
                absorption: Rgb::splat(2.0)
            }
        );
        let inside = specular_rays("absorption = 2\nexterior_absorption = 3", DVec3::NEG_Z, DVec3::Z);
        assert!((inside[1].weight.g - 0.96 * 2.25).abs() < 1e-15);
        assert_eq!(
            inside[1].kind,
            SpecularRayKind::Transmission {
                absorption: Rgb::splat(3.0)
            }
        );
    }

    #[test]
    fn streams_tell_whether_a_side_absorbs() {
        let is_clear = |text: &str| {
            let mut out = SpecularRayStreams::default();
            let material = build::<Materials, Dielectric>(text, ()).unwrap();
            material.specular_rays_stream(&SurfaceStream::default(), &mut out);
            out.clear_media
        };
        assert!(is_clear(""));
        assert!(!is_clear("absorption = [0, 0, 1]"));
        assert!(!is_clear("exterior_absorption = [0, 1, 0]"));
    }

    #[test]
    fn total_internal_reflection_is_one_branch() {
        let found = specular_rays("", DVec3::NEG_Z, DVec3::new(0.8, 0.0, 0.6));
        let [r] = found[..] else { panic!("{found:?}") };
        assert_eq!((r.weight, r.kind), (Rgb::WHITE, SpecularRayKind::Reflection));
    }

    #[test]
    fn equal_indices_are_not_there() {
        let view = DVec3::new(0.3, 0.1, 0.7).normalize();
        let found = specular_rays("interior_ior = 1.2\nexterior_ior = 1.2", DVec3::Z, view);
        let [t] = found[..] else { panic!("{found:?}") };
        assert_eq!((t.direction, t.weight), (-view, Rgb::WHITE));
        let material = build::<Materials, Dielectric>("interior_ior = 1", ()).unwrap();
        assert_eq!(
            material.flags(),
            BsdfFlags::TRANSMISSION | BsdfFlags::TRANSPARENT_SHADOWS
        );
    }

    #[test]
    fn filtered_shadows_lose_as_much_at_both_faces() {
        let text = "absorption = 2\nexterior_absorption = 3";
        let material = build::<Materials, Dielectric>(text, ()).unwrap();
        let point = SurfaceInteraction::new(DVec3::ZERO, 0.0, DVec3::Z);
        assert_eq!(
            material.shadow_transmittance(&point, DVec3::Z, false),
            Transmittance::OPAQUE
        );
        let (down, up) = (DVec3::new(0.8, 0.0, -0.6), DVec3::new(0.8, 0.0, 0.6));
        let (inwards, outwards) = (
            material.shadow_transmittance(&point, down, true),
            material.shadow_transmittance(&point, up, true),
        );
        // 1 - R at 0.6 onto an index of 1.5, with cos_t = sqrt(1 - 0.64/2.25).
        let cos_t = (1.0 - 0.64 / 2.25_f64).sqrt();
        let r_s = (0.6 - 1.5 * cos_t) / (0.6 + 1.5 * cos_t);
        let r_p = (1.5 * 0.6 - cos_t) / (1.5 * 0.6 + cos_t);
        let expected = 1.0 - 0.5 * (r_s * r_s + r_p * r_p);
        assert!((inwards.weight.g - expected).abs() < 1e-15);
        assert_eq!(inwards.weight, outwards.weight);
        assert_eq!(inwards.medium, Some(Rgb::splat(2.0)));
        assert_eq!(outwards.medium, Some(Rgb::splat(3.0)));
    }

    /// Between two given media, a body with a priority behaves like one that names both media
    /// itself.
    #[test]
    fn a_priority_changes_nothing_but_what_the_faces_are_between() {
        let build = |text: &str| build::<Materials, Dielectric>(text, ()).unwrap();
        let ranked = build("interior_ior = 1.33\nabsorption = 2\npriority = 3");
        let body = ranked.prioritized().unwrap();
        assert_eq!((body.priority(), body.medium().ior), (3, 1.33));
        assert_eq!(
            ranked.flags(),
            BsdfFlags::REFLECTION | BsdfFlags::TRANSMISSION | BsdfFlags::TRANSPARENT_SHADOWS
        );
        let named = build("interior_ior = 1.33\nabsorption = 2\nexterior_ior = 1.6\nexterior_absorption = 5");
        assert!(named.prioritized().is_none());
        let glass = Medium {
            ior: 1.6,
            absorption: Rgb::splat(5.0),
        };
        let view = DVec3::new(0.3, 0.1, 0.7).normalize();
        for n in [DVec3::Z, DVec3::NEG_Z] {
            let point = SurfaceInteraction::new(DVec3::ZERO, 0.0, n);
            let (from, to) = match n == DVec3::Z {
                true => (glass, body.medium()),
                false => (body.medium(), glass),
            };
            let (mut found, mut expected) = (SpecularRays::default(), SpecularRays::default());
            body.specular_rays_between(&point, view, from, to, &mut found);
            named.specular_rays(&point, view, &mut expected);
            assert!(found.iter().eq(expected.iter()));
            let filter = body.transmittance_between(&point, -view, from, to);
            assert_eq!(filter, named.shadow_transmittance(&point, -view, true).weight);
        }
    }

    #[test]
    fn what_a_priority_decides_is_not_said_twice() {
        let text = "priority = 1\nexterior_ior = 1.33\nexterior_absorption = [0, 1, 0]";
        let errors = build::<Materials, Dielectric>(text, ()).err().unwrap().0;
        let places: Vec<&str> = errors.iter().map(|e| &text[e.span.clone().unwrap()]).collect();
        assert_eq!(places, ["1.33", "[0, 1, 0]"]);
        assert!(errors[0].message.starts_with("expected 1: with a priority"));
        assert!(build::<Materials, Dielectric>("priority = 0\nexterior_ior = 1", ()).is_ok());
    }

    #[test]
    fn bad_values_are_refused() {
        for text in [
            "interior_ior = 0",
            "exterior_ior = -1",
            "absorption = -1",
            "interior_ior = inf",
            "priority = -1",
            "priority = 1.5",
            "priority = 65536",
            "ior = 1",
        ] {
            assert!(build::<Materials, Dielectric>(text, ()).is_err(), "{text}");
        }
    }
}
