//! A material with holes: where it is not opaque, rays and shadow rays pass straight through.
//!
//! The surface has the weight `opacity`; an undeviated branch with the weight 1 - `opacity`
//! continues to what lies behind. A threshold would depend on the rounding of the texture, and a
//! random choice (as in Mitsuba's `mask`) would be noisy.
//!
//! - Twin: hosted by the Mitsuba driver, which weights the result of Mitsuba for the material.
//! - Example: `scenes/materials/mask.toml`.

use crate::support::reflectance::share;
use schemars::JsonSchema;
use serde::Deserialize;
use std::sync::Arc;
use whitstone_core::config::{MaterialRef, TextureRef};
use whitstone_core::{
    BsdfFlags, ColorSource, Context, DVec3, GlossyLobe, LightSamples, Material, Materials, Plugin, Rgb,
    SceneError, SceneErrors, SpecularRay, SpecularRayKind, SpecularRays, SurfaceAttributes,
    SurfaceInteraction, Transmittance,
};

/// A material with holes through which rays and shadow rays pass straight.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// Opacity, from 0 to 1; a texture or a colour.
    #[serde(default = "half")]
    opacity: TextureRef,
    /// Material of the opaque part. It must not refract.
    material: MaterialRef,
}

fn half() -> TextureRef {
    TextureRef::grey(0.5)
}

/// The `mask` material; see the module documentation.
pub struct Mask {
    opacity: ColorSource,
    inner: Arc<dyn Material>,
}

impl Plugin<Materials> for Mask {
    const TYPE: &'static str = "mask";
    type Config = Config;

    fn build(config: Config, (): (), context: &mut dyn Context) -> Result<Arc<dyn Material>, SceneErrors> {
        let mut errors = SceneErrors::default();
        let opacity = errors.take(share(&config.opacity, "an opacity", context));
        let inner = errors.take(context.material(&config.material));
        if let Some(inner) = &inner
            && (inner.flags().intersects(BsdfFlags::TRANSMISSION) || inner.transmissions() > 1)
        {
            let message = "a refracting material cannot have holes: a ray would continue in two directions";
            errors
                .0
                .push(SceneError::at(config.material.span.clone(), message));
        }
        match (opacity, inner) {
            (Some(opacity), Some(inner)) => errors.into_result(Arc::new(Self { opacity, inner })),
            _ => Err(errors),
        }
    }
}

fn complement(opacity: Rgb) -> Rgb {
    opacity.map(|share| 1.0 - share)
}

impl Material for Mask {
    fn flags(&self) -> BsdfFlags {
        match self.opacity {
            ColorSource::Constant(Rgb::WHITE) => self.inner.flags(),
            ColorSource::Constant(Rgb::BLACK) => BsdfFlags::NULL | BsdfFlags::CUT_OUTS,
            _ => self.inner.flags() | BsdfFlags::NULL | BsdfFlags::CUT_OUTS,
        }
    }

    fn needs(&self) -> SurfaceAttributes {
        self.opacity.needs() | self.inner.needs()
    }

    fn local_illumination(&self, point: &SurfaceInteraction, view: DVec3, light: &LightSamples<'_>) -> Rgb {
        self.inner.local_illumination(point, view, light) * self.opacity.value(point)
    }

    fn emission(&self, point: &SurfaceInteraction, view: DVec3) -> Rgb {
        self.inner.emission(point, view) * self.opacity.value(point)
    }

    fn shadow_transmittance(
        &self,
        point: &SurfaceInteraction,
        direction: DVec3,
        filtered: bool,
    ) -> Transmittance {
        let opacity = self.opacity.value(point);
        let inner = self.inner.shadow_transmittance(point, direction, filtered);
        Transmittance::straight(complement(opacity) + inner.weight * opacity)
    }

    fn specular_rays(&self, point: &SurfaceInteraction, view: DVec3, out: &mut SpecularRays) {
        let opacity = self.opacity.value(point);
        let mut inner = SpecularRays::default();
        self.inner.specular_rays(point, view, &mut inner);
        out.merge(&inner, opacity);
        let mut hole = SpecularRays::default();
        hole.push(SpecularRay {
            direction: -view,
            weight: complement(opacity),
            kind: SpecularRayKind::Null,
        });
        out.merge(&hole, Rgb::WHITE);
    }

    fn reflections(&self) -> u32 {
        self.inner.reflections()
    }

    fn glossy_lobe(
        &self,
        point: &SurfaceInteraction,
        view: DVec3,
        kind: SpecularRayKind,
    ) -> Option<GlossyLobe<'_>> {
        self.inner.glossy_lobe(point, view, kind)
    }
}

#[cfg(all(test, feature = "all"))]
mod tests {
    use super::*;
    use crate::{dielectric::Dielectric, matte::Matte, mirror::Mirror, thin_dielectric::ThinDielectric};
    use whitstone_testkit::{TestContext, build_in, furnace_laws, material_laws};

    fn context() -> TestContext {
        TestContext::default()
            .with_material::<Matte>("matte", "reflectance = 0.5")
            .with_material::<Mirror>("mirror", "")
            .with_material::<ThinDielectric>("pane", "tint = 0.5")
            .with_material::<Dielectric>("glass", "")
    }

    fn mask(text: &str) -> Result<Arc<dyn Material>, SceneErrors> {
        build_in::<Materials, Mask>(text, (), &mut context())
    }

    #[test]
    fn laws() {
        for text in [
            "material = \"matte\"",
            "material = \"mirror\"\nopacity = [0, 0.3, 1]",
            "material = \"pane\"\nopacity = 0.7",
            "material = \"matte\"\nopacity = 0",
            "material = \"mirror\"\nopacity = 1",
        ] {
            let material = mask(text).unwrap();
            material_laws(&*material);
            furnace_laws(&*material);
        }
    }

    #[test]
    fn shares_of_what_is_there_and_of_what_is_behind() {
        let point = SurfaceInteraction::new(DVec3::ZERO, 0.0, DVec3::Z);
        let ambient = LightSamples {
            ambient: Rgb::splat(4.0),
            lights: &[],
        };
        let material = mask("material = \"matte\"\nopacity = [0, 0.25, 1]").unwrap();
        let local = material.local_illumination(&point, DVec3::Z, &ambient);
        assert_eq!(local, Rgb::new(0.0, 0.5, 2.0));
        let mut branches = SpecularRays::default();
        material.specular_rays(&point, DVec3::Z, &mut branches);
        let all: Vec<SpecularRay> = branches.iter().copied().collect();
        let expected = SpecularRay {
            direction: DVec3::NEG_Z,
            weight: Rgb::new(1.0, 0.75, 0.0),
            kind: SpecularRayKind::Null,
        };
        assert_eq!(all, [expected]);
        // Holes let light through even if shadows are not filtered.
        assert_eq!(
            material.shadow_transmittance(&point, DVec3::Z, false),
            Transmittance::straight(expected.weight)
        );
    }

    #[test]
    fn a_pane_with_holes_goes_on_in_one_branch() {
        let material = mask("material = \"pane\"\nopacity = 0.5").unwrap();
        let point = SurfaceInteraction::new(DVec3::ZERO, 0.0, DVec3::Z);
        let mut branches = SpecularRays::default();
        material.specular_rays(&point, DVec3::Z, &mut branches);
        let weights: Vec<f64> = branches.iter().map(|branch| branch.weight.g).collect();
        let expected = [0.5 * 0.08 / 1.04, 0.5 + 0.25 * 0.96 / 1.04];
        for (a, b) in weights.iter().zip(expected) {
            assert!((a - b).abs() < 1e-15, "{a} {b}");
        }
        assert_eq!(
            material.shadow_transmittance(&point, DVec3::Z, false).weight,
            Rgb::splat(0.5)
        );
        let filtered = material.shadow_transmittance(&point, DVec3::Z, true).weight.g;
        assert!((filtered - expected[1]).abs() < 1e-15);
    }

    #[test]
    fn lobes_are_exact() {
        let lobes = |text| mask(text).unwrap().flags();
        let hole = BsdfFlags::NULL | BsdfFlags::CUT_OUTS;
        assert_eq!(lobes("material = \"matte\""), BsdfFlags::LOCAL | hole);
        assert_eq!(lobes("material = \"matte\"\nopacity = 1"), BsdfFlags::LOCAL);
        assert_eq!(lobes("material = \"matte\"\nopacity = 0"), hole);
    }

    #[test]
    fn what_cannot_be_is_refused_at_its_place() {
        for (text, place) in [
            ("material = \"glass\"", "\"glass\""),
            ("material = \"matte\"\nopacity = 1.5", "1.5"),
            ("material = \"none\"", "\"none\""),
            ("material = 1", "1"),
        ] {
            let error = mask(text).err().unwrap().0.remove(0);
            assert_eq!(&text[error.span.unwrap()], place);
        }
    }
}
