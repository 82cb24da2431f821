//! A rough mirror with blurred reflections.
//!
//! Distribution ray tracing: Cook, Porter and Carpenter, *Distributed ray tracing*, SIGGRAPH 1984,
//! section 4.1, "Gloss". The lobe is Phong's `cos^exponent` around the mirror direction. It is
//! divided into parts of equal weight (Lafortune and Willems, *Using the modified Phong reflectance
//! model for physically based rendering*, 1994, for the weight inside a cone; Shirley and Chiu, *A
//! low distortion map between disk and square*, 1997, for the map from a square grid). One ray is
//! traced through the middle of each part, with the same pattern everywhere. With few samples this
//! shows several weaker mirror images instead of noise.
//!
//! - Twin: hosted by the Mitsuba driver, which samples the lobe around the direction of Mitsuba's
//!   mirror.
//! - Example: `scenes/materials/glossy.toml`.

use crate::support::lobe::{Exponent, Lobe, Samples};
use crate::support::optics::reflect;
use crate::support::reflectance::reflectance;
use schemars::JsonSchema;
use serde::Deserialize;
use std::sync::Arc;
use whitstone_core::config::TextureRef;
use whitstone_core::{
    BsdfFlags, ColorSource, Context, DVec3, GlossyLobe, Material, Materials, Plugin, SceneErrors,
    SpecularRay, SpecularRayKind, SpecularRays, SurfaceAttributes, SurfaceInteraction,
};

/// A mirror on both sides whose reflections are blurred by samples² fixed directions around the
/// mirror direction.
///
/// Each bounce multiplies the number of rays by samples², up to `max_depth` bounces;
/// `min_contribution` ends rays whose contribution is too small. More than 2^24 rays per camera
/// ray, counting glossy bounces only, are an error. Directions that point into the surface are
/// dropped, which darkens the reflection at grazing angles.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// Factor on the reflected radiance, from 0 to 1; a texture or a colour.
    #[serde(default = "one")]
    reflectance: TextureRef,
    #[serde(default)]
    exponent: Exponent,
    /// The directions form a grid of n x n, which is mapped to the lobe; this is n, 1 to 8. 1 is a
    /// perfect mirror.
    #[serde(default = "Samples::of::<4>")]
    samples: Samples,
}

fn one() -> TextureRef {
    TextureRef::grey(1.0)
}

/// The `glossy` material; see the module documentation.
pub struct Glossy {
    reflectance: ColorSource,
    lobe: Lobe,
}

impl Plugin<Materials> for Glossy {
    const TYPE: &'static str = "glossy";
    type Config = Config;

    fn build(config: Config, (): (), context: &mut dyn Context) -> Result<Arc<dyn Material>, SceneErrors> {
        Ok(Arc::new(Self {
            reflectance: reflectance(&config.reflectance, context)?,
            lobe: Lobe::new(config.exponent, config.samples),
        }))
    }
}

impl Material for Glossy {
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

    fn reflections(&self) -> u32 {
        self.lobe.rays()
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

#[cfg(all(test, feature = "all"))]
mod tests {
    use super::*;
    use crate::{bump::Bump, dielectric::Dielectric, mask::Mask, matte::Matte, mirror::Mirror, mix::Mix};
    use whitstone_core::Rgb;
    use whitstone_testkit::{TestContext, build, build_in, furnace_laws, material_laws};

    fn glossy(text: &str) -> Arc<dyn Material> {
        build::<Materials, Glossy>(text, ()).unwrap()
    }

    #[test]
    fn laws() {
        for text in [
            "",
            "reflectance = [0, 0.3, 1]\nsamples = 8",
            "samples = 3\nexponent = 1e-9",
            "exponent = 1e300",
            "samples = 1",
            "reflectance = 0",
        ] {
            let material = glossy(text);
            material_laws(&*material);
            furnace_laws(&*material);
        }
    }

    fn directions(material: &dyn Material, point: &SurfaceInteraction, view: DVec3) -> Vec<DVec3> {
        let mut branches = SpecularRays::default();
        material.specular_rays(point, view, &mut branches);
        let mirrored = branches.iter().next().unwrap().direction;
        let spread = material.glossy_lobe(point, view, SpecularRayKind::Reflection);
        spread.map_or_else(|| vec![mirrored], |spread| spread.directions(mirrored).collect())
    }

    #[test]
    fn one_sample_is_a_mirror_and_large_exponents_tend_to_it() {
        let point = SurfaceInteraction::new(DVec3::ZERO, 0.0, DVec3::Y);
        let view = DVec3::new(0.6, 0.8, 0.0);
        let mirrored = DVec3::new(-0.6, 0.8, 0.0);
        assert_eq!(glossy("samples = 1").reflections(), 1);
        let smooth = glossy("samples = 1");
        assert!(
            smooth
                .glossy_lobe(&point, view, SpecularRayKind::Reflection)
                .is_none()
        );
        let mut last = 2.0;
        for exponent in ["1", "1e2", "1e4", "1e6", "1e12", "1e300"] {
            let material = glossy(&format!("exponent = {exponent}"));
            let found = directions(&*material, &point, view);
            assert_eq!(found.len(), 16);
            let farthest = found.iter().map(|d| (*d - mirrored).length()).fold(0.0, f64::max);
            assert!(farthest < 0.5 * last, "{exponent}: {farthest}");
            last = farthest;
        }
        assert!(last < 1e-15);
    }

    /// The directions are evenly distributed around the mirror direction, for any frame.
    #[test]
    fn the_mirror_direction_is_in_the_middle() {
        for n in [
            DVec3::Y,
            -DVec3::new(0.48, 0.64, 0.6),
            DVec3::new(1.0, -2.0, 0.5).normalize(),
        ] {
            let point = SurfaceInteraction::new(DVec3::ZERO, 0.0, n);
            let view = (n + 0.7 * n.any_orthonormal_vector()).normalize();
            for text in ["", "samples = 3", "samples = 8\nexponent = 2"] {
                let material = glossy(text);
                let found = directions(&*material, &point, view);
                let mirrored = reflect(n, view);
                let sum: DVec3 = found.iter().sum();
                assert!(
                    sum.cross(mirrored).length() < 1e-13 * found.len() as f64,
                    "{text}"
                );
                let nearest = found.iter().map(|d| (*d - mirrored).length()).fold(9.0, f64::min);
                assert_eq!(nearest < 1e-7, text == "samples = 3", "{text}");
            }
        }
    }

    /// Materials made of a glossy one spread in the same way; bumps spread around their own normal.
    #[test]
    fn it_is_glossy_inside_others_too() {
        let mut context = TestContext::default()
            .with_material::<Glossy>("glossy", "reflectance = 0.5")
            .with_material::<Matte>("matte", "")
            .with_material::<Mirror>("mirror", "")
            .with_material::<Glossy>("smooth", "samples = 1")
            .with_material::<Dielectric>("glass", "");
        let point = SurfaceInteraction::new(DVec3::ZERO, 0.0, DVec3::Y);
        let view = DVec3::new(0.6, 0.8, 0.0);
        let expected = directions(&*glossy(""), &point, view);
        let text = "a = \"matte\"\nb = \"glossy\"";
        let mixed = build_in::<Materials, Mix>(text, (), &mut context).unwrap();
        let masked = build_in::<Materials, Mask>("material = \"glossy\"", (), &mut context).unwrap();
        for material in [&mixed, &masked] {
            material_laws(&**material);
            furnace_laws(&**material);
            assert_eq!(directions(&**material, &point, view), expected);
            let mut branches = SpecularRays::default();
            material.specular_rays(&point, view, &mut branches);
            assert_eq!(branches.iter().next().unwrap().weight, Rgb::splat(0.25));
        }
        let flat =
            build_in::<Materials, Bump>("height = 1\nmaterial = \"glossy\"", (), &mut context).unwrap();
        assert_eq!(directions(&*flat, &point, view), expected);
        for (a, b) in [("glossy", "mirror"), ("glass", "glossy"), ("glossy", "glossy")] {
            let text = format!("a = \"{a}\"\nb = \"{b}\"");
            let error = build_in::<Materials, Mix>(&text, (), &mut context).err().unwrap();
            assert!(error.0[0].message.contains("glossy"), "{text}");
        }
        let text = "a = \"smooth\"\nb = \"mirror\"";
        assert!(build_in::<Materials, Mix>(text, (), &mut context).is_ok());
    }

    #[test]
    fn faults_are_refused_at_their_places() {
        for (text, place) in [
            ("reflectance = 1.5", "1.5"),
            ("exponent = 0", "0"),
            ("samples = 9", "9"),
            ("samples = 0", "0"),
        ] {
            let error = build::<Materials, Glossy>(text, ()).err().unwrap().0.remove(0);
            assert_eq!(&text[error.span.unwrap()], place);
        }
    }
}
