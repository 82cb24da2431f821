//! A surface that emits light by itself, on top of any other material.
//!
//! The incandescence term of the lecture notes: radiance that is independent of the lights. It is
//! visible to the camera and in reflections and refractions, but illuminates no other surface. Use
//! a light for that.
//!
//! - Twin: hosted by the Mitsuba driver, which adds the texture's value.
//! - Example: `scenes/materials/emissive.toml`.

use schemars::JsonSchema;
use serde::Deserialize;
use std::sync::Arc;
use whitstone_core::config::{MaterialRef, TextureRef};
use whitstone_core::stream::{Colors, SampleStreams, SurfaceStream};
use whitstone_core::{
    BsdfFlags, ColorSource, Context, DVec3, GlossyLobe, LightSamples, Material, Materials, Plugin, Rgb,
    SceneErrors, SpecularRayKind, SpecularRayStreams, SpecularRays, SurfaceAttributes, SurfaceInteraction,
    Transmittance,
};

/// A surface that emits light by itself, on top of any other material.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// Emitted radiance, on both sides, in W/(m² sr); a texture or a colour.
    #[serde(default = "one")]
    radiance: TextureRef,
    /// Material that supplies all other terms.
    #[serde(default)]
    #[schemars(extend("x-default" = "none (reflects nothing)"), with = "MaterialRef")]
    material: Option<MaterialRef>,
}

fn one() -> TextureRef {
    TextureRef::grey(1.0)
}

/// The `emissive` material; see the module documentation.
pub struct Emissive {
    radiance: ColorSource,
    under: Arc<dyn Material>,
}

/// Material that reflects nothing.
struct Black;

impl Material for Black {
    fn flags(&self) -> BsdfFlags {
        BsdfFlags::NOTHING
    }

    fn needs(&self) -> SurfaceAttributes {
        SurfaceAttributes::NOTHING
    }
}

impl Plugin<Materials> for Emissive {
    const TYPE: &'static str = "emissive";
    type Config = Config;

    fn build(config: Config, (): (), context: &mut dyn Context) -> Result<Arc<dyn Material>, SceneErrors> {
        let mut errors = SceneErrors::default();
        let radiance = errors.take(context.texture(&config.radiance));
        let under = match &config.material {
            Some(material) => errors.take(context.material(material)),
            None => Some(Arc::new(Black) as Arc<dyn Material>),
        };
        match (radiance, under) {
            (Some(radiance), Some(under)) => Ok(Arc::new(Self { radiance, under })),
            _ => Err(errors),
        }
    }
}

impl Material for Emissive {
    fn flags(&self) -> BsdfFlags {
        if self.radiance.is_black() {
            self.under.flags()
        } else {
            self.under.flags() | BsdfFlags::EMISSION
        }
    }

    fn needs(&self) -> SurfaceAttributes {
        self.under.needs() | self.radiance.needs()
    }

    fn local_illumination(&self, point: &SurfaceInteraction, view: DVec3, light: &LightSamples<'_>) -> Rgb {
        self.under.local_illumination(point, view, light)
    }

    fn local_illumination_stream(
        &self,
        points: &SurfaceStream,
        ambient: Rgb,
        lights: &SampleStreams,
        out: &mut Colors,
    ) {
        self.under.local_illumination_stream(points, ambient, lights, out);
    }

    fn emission(&self, point: &SurfaceInteraction, view: DVec3) -> Rgb {
        self.radiance.value(point) + self.under.emission(point, view)
    }

    fn shadow_transmittance(
        &self,
        point: &SurfaceInteraction,
        direction: DVec3,
        filtered: bool,
    ) -> Transmittance {
        self.under.shadow_transmittance(point, direction, filtered)
    }

    fn specular_rays(&self, point: &SurfaceInteraction, view: DVec3, out: &mut SpecularRays) {
        self.under.specular_rays(point, view, out);
    }

    fn specular_rays_stream(&self, points: &SurfaceStream, out: &mut SpecularRayStreams) {
        self.under.specular_rays_stream(points, out);
    }

    fn reflections(&self) -> u32 {
        self.under.reflections()
    }

    fn transmissions(&self) -> u32 {
        self.under.transmissions()
    }

    fn glossy_lobe(
        &self,
        point: &SurfaceInteraction,
        view: DVec3,
        kind: SpecularRayKind,
    ) -> Option<GlossyLobe<'_>> {
        self.under.glossy_lobe(point, view, kind)
    }
}

#[cfg(all(test, feature = "all"))]
mod tests {
    use super::*;
    use crate::{matte::Matte, mirror::Mirror};
    use whitstone_testkit::{TestContext, build, build_in, material_laws};

    #[test]
    fn laws() {
        for text in ["", "radiance = [0, 0.3, 1e9]", "radiance = 0"] {
            material_laws(&*build::<Materials, Emissive>(text, ()).unwrap());
        }
        let mut context = TestContext::default()
            .with_material::<Mirror>("mirror", "reflectance = 0.5")
            .with_material::<Matte>("matte", "");
        for under in ["mirror", "matte"] {
            let text = format!("radiance = 2\nmaterial = \"{under}\"");
            material_laws(&*build_in::<Materials, Emissive>(&text, (), &mut context).unwrap());
        }
    }

    #[test]
    fn it_glows_over_what_it_is() {
        let mut context = TestContext::default().with_material::<Mirror>("under", "reflectance = 0.5");
        let text = "radiance = [2, 1, 0]\nmaterial = \"under\"";
        let material = build_in::<Materials, Emissive>(text, (), &mut context).unwrap();
        let point = SurfaceInteraction::new(DVec3::ZERO, 0.0, DVec3::Z);
        for view in [DVec3::Z, DVec3::NEG_Z] {
            assert_eq!(material.emission(&point, view), Rgb::new(2.0, 1.0, 0.0));
        }
        let mut branches = SpecularRays::default();
        material.specular_rays(&point, DVec3::Z, &mut branches);
        assert_eq!(branches.iter().next().unwrap().weight, Rgb::splat(0.5));
    }

    #[test]
    fn lobes_are_exact() {
        let lobes = |text| build::<Materials, Emissive>(text, ()).unwrap().flags();
        assert_eq!(lobes("radiance = 0"), BsdfFlags::NOTHING);
        assert_eq!(lobes(""), BsdfFlags::EMISSION);
    }

    #[test]
    fn bad_values_are_refused_at_their_places() {
        let text = "radiance = -1\nmaterial = 3";
        let errors = build::<Materials, Emissive>(text, ()).err().unwrap();
        let mut found: Vec<&str> = errors.0.iter().map(|e| &text[e.span.clone().unwrap()]).collect();
        found.sort_unstable();
        assert_eq!(found, ["-1", "3"]);
    }
}
