//! A linear blend of two materials.
//!
//! All their terms are blended: emission, local illumination, specular rays and shadow
//! transmittance. Specular rays of the same kind are merged, and combinations that would need two
//! directions are rejected, so that a material has at most one reflected and one transmitted
//! direction, as in Whitted 1980 (`glossy` spreads the reflected one).
//!
//! - Twin: hosted by the Mitsuba driver, which weights the results of Mitsuba for both.
//! - Example: `scenes/materials/mix.toml`.

use crate::support::reflectance::share;
use schemars::JsonSchema;
use serde::Deserialize;
use std::sync::Arc;
use whitstone_core::config::{MaterialRef, TextureRef};
use whitstone_core::{
    BsdfFlags, ColorSource, Context, DVec3, GlossyLobe, LightSamples, Material, Materials, Plugin, Rgb,
    SceneError, SceneErrors, SpecularRayKind, SpecularRays, SurfaceAttributes, SurfaceInteraction,
    Transmittance,
};

/// A linear blend of two materials.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// The first material.
    a: MaterialRef,
    /// The second material.
    b: MaterialRef,
    /// Weight of `b`, from 0 to 1; a texture or a colour.
    #[serde(default = "half")]
    weight: TextureRef,
}

fn half() -> TextureRef {
    TextureRef::grey(0.5)
}

/// The `mix` material; see the module documentation.
pub struct Mix {
    a: Arc<dyn Material>,
    b: Arc<dyn Material>,
    weight: ColorSource,
}

impl Plugin<Materials> for Mix {
    const TYPE: &'static str = "mix";
    type Config = Config;

    fn build(config: Config, (): (), context: &mut dyn Context) -> Result<Arc<dyn Material>, SceneErrors> {
        let mut errors = SceneErrors::default();
        let weight = errors.take(share(&config.weight, "a weight", context));
        let a = errors.take(context.material(&config.a));
        let b = errors.take(context.material(&config.b));
        if let (Some(a), Some(b)) = (&a, &b)
            && let Err(message) = one_direction(&**a, &**b)
        {
            errors.0.push(SceneError::at(config.b.span.clone(), message));
        }
        match (a, b, weight) {
            (Some(a), Some(b), Some(weight)) => errors.into_result(Arc::new(Self { a, b, weight })),
            _ => Err(errors),
        }
    }
}

/// Checks that branches of the same kind have the same direction.
fn one_direction(a: &dyn Material, b: &dyn Material) -> Result<(), &'static str> {
    let spread = a.reflections() > 1 || b.reflections() > 1;
    let spread_through = a.transmissions() > 1 || b.transmissions() > 1;
    let (a, b) = (a.flags(), b.flags());
    let through = BsdfFlags::TRANSMISSION | BsdfFlags::NULL;
    let either = a | b;
    let refracts = either.contains(BsdfFlags::TRANSMISSION) || spread_through;
    if a.intersects(through) && b.intersects(through) && refracts {
        return Err(
            "both materials transmit rays, and one of them refracts: a ray would continue in two directions",
        );
    }
    let reflect = a.intersects(BsdfFlags::REFLECTION) && b.intersects(BsdfFlags::REFLECTION);
    if reflect && either.contains(BsdfFlags::NORMAL_MAPPED) {
        return Err(
            "both materials reflect, and one of them has a normal map or bumps: a ray would continue in two directions",
        );
    }
    if reflect && spread {
        return Err(
            "both materials reflect, and one of them is glossy: a ray would be reflected around two directions",
        );
    }
    Ok(())
}

impl Mix {
    /// Evaluates `of` for both materials and blends the results.
    fn blend(&self, point: &SurfaceInteraction, of: impl Fn(&dyn Material) -> Rgb) -> Rgb {
        let [a, b] = self.shares(point);
        of(&*self.a) * a + of(&*self.b) * b
    }

    fn shares(&self, point: &SurfaceInteraction) -> [Rgb; 2] {
        let weight = self.weight.value(point);
        [weight.map(|share| 1.0 - share), weight]
    }
}

impl Material for Mix {
    fn flags(&self) -> BsdfFlags {
        match self.weight {
            ColorSource::Constant(Rgb::BLACK) => self.a.flags(),
            ColorSource::Constant(Rgb::WHITE) => self.b.flags(),
            _ => self.a.flags() | self.b.flags(),
        }
    }

    fn needs(&self) -> SurfaceAttributes {
        self.weight.needs() | self.a.needs() | self.b.needs()
    }

    fn local_illumination(&self, point: &SurfaceInteraction, view: DVec3, light: &LightSamples<'_>) -> Rgb {
        self.blend(point, |material| material.local_illumination(point, view, light))
    }

    fn emission(&self, point: &SurfaceInteraction, view: DVec3) -> Rgb {
        self.blend(point, |material| material.emission(point, view))
    }

    fn shadow_transmittance(
        &self,
        point: &SurfaceInteraction,
        direction: DVec3,
        filtered: bool,
    ) -> Transmittance {
        let of = |material: &dyn Material| material.shadow_transmittance(point, direction, filtered);
        Transmittance {
            weight: self.blend(point, |material| of(material).weight),
            // At most one of them refracts.
            medium: of(&*self.a).medium.or(of(&*self.b).medium),
        }
    }

    fn specular_rays(&self, point: &SurfaceInteraction, view: DVec3, out: &mut SpecularRays) {
        let shares = self.shares(point);
        for (material, share) in [&self.a, &self.b].into_iter().zip(shares) {
            let mut part = SpecularRays::default();
            material.specular_rays(point, view, &mut part);
            out.merge(&part, share);
        }
    }

    fn reflections(&self) -> u32 {
        self.a.reflections().max(self.b.reflections())
    }

    fn transmissions(&self) -> u32 {
        self.a.transmissions().max(self.b.transmissions())
    }

    fn glossy_lobe(
        &self,
        point: &SurfaceInteraction,
        view: DVec3,
        kind: SpecularRayKind,
    ) -> Option<GlossyLobe<'_>> {
        // If either spreads its reflection, at most one of them reflects. The same holds for
        // transmissions, because a material that spreads them refracts.
        self.a
            .glossy_lobe(point, view, kind)
            .or_else(|| self.b.glossy_lobe(point, view, kind))
    }
}

#[cfg(all(test, feature = "all"))]
mod tests {
    use super::*;
    use crate::{
        conductor::Conductor, dielectric::Dielectric, emissive::Emissive, glossy::Glossy, mask::Mask,
        matte::Matte, mirror::Mirror, reflection_map::ReflectionMap, rough::Rough,
        thin_dielectric::ThinDielectric,
    };
    use whitstone_testkit::{TestContext, build_in, furnace_laws, material_laws};

    fn context() -> TestContext {
        TestContext::default()
            .with_material::<Matte>("matte", "reflectance = 0.5")
            .with_material::<Mirror>("mirror", "")
            .with_material::<Conductor>("gold", "metal = \"Au\"")
            .with_material::<ThinDielectric>("pane", "tint = 0.5")
            .with_material::<Dielectric>("glass", "absorption = 2")
            .with_material::<Rough>("frosted", "material = \"pane\"\nsamples = 3")
            .with_material::<ReflectionMap>("mapped", "radiance = 1\nmaterial = \"frosted\"")
            .with_material::<Glossy>("glossy", "samples = 3")
            .with_material::<Emissive>("lamp", "radiance = 3")
            .with_material::<Mask>("net", "material = \"matte\"")
    }

    fn mix(text: &str) -> Result<Arc<dyn Material>, SceneErrors> {
        build_in::<Materials, Mix>(text, (), &mut context())
    }

    fn weights(material: &dyn Material) -> Vec<f64> {
        let point = SurfaceInteraction::new(DVec3::ZERO, 0.0, DVec3::Z);
        let mut branches = SpecularRays::default();
        material.specular_rays(&point, DVec3::Z, &mut branches);
        branches.iter().map(|branch| branch.weight.g).collect()
    }

    #[test]
    fn laws() {
        for (text, keeps) in [
            ("a = \"matte\"\nb = \"mirror\"", true),
            ("a = \"matte\"\nb = \"gold\"\nweight = [0, 0.3, 1]", true),
            ("a = \"pane\"\nb = \"net\"\nweight = 0.7", true),
            ("a = \"glass\"\nb = \"matte\"", false),
            ("a = \"lamp\"\nb = \"matte\"", false),
            ("a = \"matte\"\nb = \"pane\"\nweight = 1", true),
        ] {
            let material = mix(text).unwrap();
            material_laws(&*material);
            if keeps {
                furnace_laws(&*material);
            }
        }
    }

    #[test]
    fn branches_in_one_direction_become_one() {
        assert_eq!(
            weights(&*mix("a = \"mirror\"\nb = \"mirror\"\nweight = 0.25").unwrap()),
            [1.0]
        );
        let found = weights(&*mix("a = \"mirror\"\nb = \"glass\"\nweight = 0.25").unwrap());
        let expected = [0.75 + 0.25 * 0.04, 0.25 * 0.96 / 2.25];
        assert_eq!(found.len(), 2);
        for (a, b) in found.into_iter().zip(expected) {
            assert!((a - b).abs() < 1e-15, "{a} {b}");
        }
    }

    #[test]
    fn light_is_weighted() {
        let material = mix("a = \"matte\"\nb = \"lamp\"\nweight = [0, 0.25, 1]").unwrap();
        let point = SurfaceInteraction::new(DVec3::ZERO, 0.0, DVec3::Z);
        let ambient = LightSamples {
            ambient: Rgb::splat(4.0),
            lights: &[],
        };
        let local = material.local_illumination(&point, DVec3::Z, &ambient);
        assert_eq!(local, Rgb::new(2.0, 1.5, 0.0));
        assert_eq!(material.emission(&point, DVec3::Z), Rgb::new(0.0, 0.75, 3.0));
    }

    #[test]
    fn what_cannot_be_is_refused_at_its_place() {
        for (text, place) in [
            ("a = \"glass\"\nb = \"pane\"", "\"pane\""),
            ("a = \"net\"\nb = \"glass\"", "\"glass\""),
            ("a = \"pane\"\nb = \"frosted\"", "\"frosted\""),
            ("a = \"frosted\"\nb = \"net\"", "\"net\""),
            // Only its transmission is spread.
            ("a = \"pane\"\nb = \"mapped\"", "\"mapped\""),
            ("a = \"mirror\"\nb = \"glossy\"", "\"glossy\""),
            ("a = \"glossy\"\nb = \"gold\"", "\"gold\""),
            ("a = \"matte\"\nb = \"mirror\"\nweight = 2", "2"),
        ] {
            let error = mix(text).err().unwrap().0.remove(0);
            assert_eq!(&text[error.span.unwrap()], place);
        }
        assert!(mix("a = \"matte\"").is_err());
    }
}
