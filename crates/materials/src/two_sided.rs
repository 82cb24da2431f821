//! Different materials on the front and the back.
//!
//! The geometric normal determines the visible side, as for the media of transparent bodies.
//!
//! - Twin: hosted by the Mitsuba driver, which evaluates both in Mitsuba.
//! - Example: `scenes/materials/two_sided.toml`.

use schemars::JsonSchema;
use serde::Deserialize;
use std::sync::Arc;
use whitstone_core::config::MaterialRef;
use whitstone_core::{
    BsdfFlags, Context, DVec3, GlossyLobe, LightSamples, Material, Materials, Plugin, Rgb, SceneErrors,
    SpecularRayKind, SpecularRays, SurfaceAttributes, SurfaceInteraction, Transmittance,
};

/// Different materials on the outside and the inside.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// Material on the outside, the side that the geometric normal points to.
    front: MaterialRef,
    /// Material on the inside.
    back: MaterialRef,
}

/// The `two_sided` material; see the module documentation.
pub struct TwoSided {
    front: Arc<dyn Material>,
    back: Arc<dyn Material>,
}

impl Plugin<Materials> for TwoSided {
    const TYPE: &'static str = "two_sided";
    type Config = Config;

    fn build(config: Config, (): (), context: &mut dyn Context) -> Result<Arc<dyn Material>, SceneErrors> {
        let mut errors = SceneErrors::default();
        let front = errors.take(context.material(&config.front));
        let back = errors.take(context.material(&config.back));
        match (front, back) {
            (Some(front), Some(back)) => Ok(Arc::new(Self { front, back })),
            _ => Err(errors),
        }
    }
}

impl TwoSided {
    /// The material seen by a viewer in this direction.
    fn seen(&self, point: &SurfaceInteraction, view: DVec3) -> &dyn Material {
        if point.n_g.dot(view) > 0.0 {
            &*self.front
        } else {
            &*self.back
        }
    }
}

impl Material for TwoSided {
    fn flags(&self) -> BsdfFlags {
        self.front.flags() | self.back.flags()
    }

    fn needs(&self) -> SurfaceAttributes {
        self.front.needs() | self.back.needs()
    }

    fn local_illumination(&self, point: &SurfaceInteraction, view: DVec3, light: &LightSamples<'_>) -> Rgb {
        self.seen(point, view).local_illumination(point, view, light)
    }

    fn emission(&self, point: &SurfaceInteraction, view: DVec3) -> Rgb {
        self.seen(point, view).emission(point, view)
    }

    fn shadow_transmittance(
        &self,
        point: &SurfaceInteraction,
        direction: DVec3,
        filtered: bool,
    ) -> Transmittance {
        self.seen(point, -direction)
            .shadow_transmittance(point, direction, filtered)
    }

    fn specular_rays(&self, point: &SurfaceInteraction, view: DVec3, out: &mut SpecularRays) {
        self.seen(point, view).specular_rays(point, view, out);
    }

    fn reflections(&self) -> u32 {
        self.front.reflections().max(self.back.reflections())
    }

    fn transmissions(&self) -> u32 {
        self.front.transmissions().max(self.back.transmissions())
    }

    fn glossy_lobe(
        &self,
        point: &SurfaceInteraction,
        view: DVec3,
        kind: SpecularRayKind,
    ) -> Option<GlossyLobe<'_>> {
        self.seen(point, view).glossy_lobe(point, view, kind)
    }
}

#[cfg(all(test, feature = "all"))]
mod tests {
    use super::*;
    use crate::{
        dielectric::Dielectric, emissive::Emissive, mirror::Mirror, thin_dielectric::ThinDielectric,
    };
    use whitstone_core::SpecularRayKind;
    use whitstone_testkit::{TestContext, build_in, sided_material_laws};

    fn two_sided(text: &str) -> Result<Arc<dyn Material>, SceneErrors> {
        let mut context = TestContext::default()
            .with_material::<Emissive>("lamp", "radiance = 2")
            .with_material::<Mirror>("mirror", "")
            .with_material::<ThinDielectric>("pane", "tint = 0.5")
            .with_material::<Dielectric>("glass", "absorption = 2");
        build_in::<Materials, TwoSided>(text, (), &mut context)
    }

    #[test]
    fn laws() {
        for text in [
            "front = \"lamp\"\nback = \"mirror\"",
            "front = \"mirror\"\nback = \"glass\"",
            "front = \"pane\"\nback = \"glass\"",
        ] {
            sided_material_laws(&*two_sided(text).unwrap());
        }
    }

    #[test]
    fn each_side_has_its_own() {
        let material = two_sided("front = \"lamp\"\nback = \"glass\"").unwrap();
        let point = SurfaceInteraction::new(DVec3::ZERO, 0.0, DVec3::Z);
        let kinds = |view| {
            let mut branches = SpecularRays::default();
            material.specular_rays(&point, view, &mut branches);
            branches.iter().map(|branch| branch.kind).collect::<Vec<_>>()
        };
        assert_eq!(material.emission(&point, DVec3::Z), Rgb::splat(2.0));
        assert_eq!(material.emission(&point, DVec3::NEG_Z), Rgb::BLACK);
        assert_eq!(kinds(DVec3::Z), []);
        let absorption = Rgb::BLACK;
        let both = [
            SpecularRayKind::Reflection,
            SpecularRayKind::Transmission { absorption },
        ];
        assert_eq!(kinds(DVec3::NEG_Z), both);
        // A shadow ray is filtered by the side that it arrives at.
        assert_eq!(
            material.shadow_transmittance(&point, DVec3::NEG_Z, true),
            Transmittance::OPAQUE
        );
        assert!(material.shadow_transmittance(&point, DVec3::Z, true).weight.g > 0.9);
    }

    #[test]
    fn both_sides_are_required() {
        assert!(two_sided("front = \"lamp\"").is_err());
        assert_eq!(two_sided("front = 1\nback = 2").err().unwrap().0.len(), 2);
    }
}
