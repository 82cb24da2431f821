//! Reflection mapping: the reflections of a material are looked up in a map, not traced.
//!
//! Blinn and Newell, *Texture and reflection in computer generated images*, 1976: the map shows
//! what lies in the reflected direction, as if it were infinitely far away. A reflection then costs
//! no ray, but shows neither the scene nor the surface itself. Other materials of the same scene
//! still trace theirs. `bake cubemap` makes a map from a scene; docs/comparisons.md measures its
//! error.
//!
//! - Twin: a formula of the Mitsuba driver, which looks up the directions that Mitsuba's BSDFs
//!   give.
//! - Example: `scenes/materials/reflection_map.toml`.

use schemars::JsonSchema;
use serde::Deserialize;
use std::sync::Arc;
use toml::Spanned;
use whitstone_core::config::{MaterialRef, TextureRef};
use whitstone_core::direction_map::{DirectionMap, Faces};
use whitstone_core::stream::{Colors, SampleStreams, SurfaceStream};
use whitstone_core::{
    BsdfFlags, Context, DVec3, GlossyLobe, LightSamples, Material, Materials, Plugin, Rgb, SceneErrors,
    SpecularRayKind, SpecularRayStreams, SpecularRays, SurfaceAttributes, SurfaceInteraction, Transmittance,
};

/// Reflections that are looked up in a map by their direction, not traced.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// Radiance in W/(m² sr) as a texture on the sphere of directions, such as a latitude-longitude
    /// map, or a colour.
    #[serde(default)]
    #[schemars(extend("x-default" = "none: this or `faces` is required"), with = "TextureRef")]
    radiance: Option<TextureRef>,
    /// Radiance in W/(m² sr) as a cube map: six square images of the same size.
    #[serde(default)]
    #[schemars(extend("x-default" = "none: this or `radiance` is required"), with = "Faces")]
    faces: Option<Spanned<Faces>>,
    /// Material whose reflections are looked up. Its other terms, transmission included, stay as
    /// they are.
    material: MaterialRef,
}

/// The `reflection_map` material; see the module documentation.
pub struct ReflectionMap {
    map: DirectionMap,
    inner: Arc<dyn Material>,
}

impl Plugin<Materials> for ReflectionMap {
    const TYPE: &'static str = "reflection_map";
    type Config = Config;

    fn build(config: Config, (): (), context: &mut dyn Context) -> Result<Arc<dyn Material>, SceneErrors> {
        let mut errors = SceneErrors::default();
        let map = errors.take(DirectionMap::new(
            config.radiance.as_ref(),
            config.faces.as_ref(),
            context,
        ));
        let inner = errors.take(context.material(&config.material));
        match (map, inner) {
            (Some(map), Some(inner)) => Ok(Arc::new(Self { map, inner })),
            _ => Err(errors),
        }
    }
}

impl Material for ReflectionMap {
    fn flags(&self) -> BsdfFlags {
        let flags = self.inner.flags();
        let rest = flags.without(BsdfFlags::REFLECTION);
        if rest == flags || self.map.is_black() {
            rest
        } else {
            rest | BsdfFlags::EMISSION
        }
    }

    fn needs(&self) -> SurfaceAttributes {
        self.inner.needs()
    }

    fn local_illumination(&self, point: &SurfaceInteraction, view: DVec3, light: &LightSamples<'_>) -> Rgb {
        self.inner.local_illumination(point, view, light)
    }

    fn local_illumination_stream(
        &self,
        points: &SurfaceStream,
        ambient: Rgb,
        lights: &SampleStreams,
        out: &mut Colors,
    ) {
        self.inner.local_illumination_stream(points, ambient, lights, out);
    }

    fn emission(&self, point: &SurfaceInteraction, view: DVec3) -> Rgb {
        let mut sum = self.inner.emission(point, view);
        let mut branches = SpecularRays::default();
        self.inner.specular_rays(point, view, &mut branches);
        let reflected = branches
            .iter()
            .filter(|branch| branch.kind == SpecularRayKind::Reflection);
        for branch in reflected {
            // Rule G of the model, as for traced rays.
            let seen = |direction: DVec3| match point.same_side(view, direction) {
                true => self.map.value(direction),
                false => Rgb::BLACK,
            };
            let radiance = match self.inner.glossy_lobe(point, view, branch.kind) {
                None => seen(branch.direction),
                Some(lobe) => {
                    let all = lobe.directions(branch.direction);
                    let share = 1.0 / all.len() as f64;
                    all.map(seen).sum::<Rgb>() * share
                }
            };
            sum += branch.weight * radiance;
        }
        sum
    }

    fn shadow_transmittance(
        &self,
        point: &SurfaceInteraction,
        direction: DVec3,
        filtered: bool,
    ) -> Transmittance {
        self.inner.shadow_transmittance(point, direction, filtered)
    }

    fn specular_rays(&self, point: &SurfaceInteraction, view: DVec3, out: &mut SpecularRays) {
        let mut branches = SpecularRays::default();
        self.inner.specular_rays(point, view, &mut branches);
        for branch in branches.iter() {
            if branch.kind != SpecularRayKind::Reflection {
                out.push(*branch);
            }
        }
    }

    fn specular_rays_stream(&self, points: &SurfaceStream, out: &mut SpecularRayStreams) {
        self.inner.specular_rays_stream(points, out);
        out.reflection.weight.fill(points.len, Rgb::BLACK);
    }

    fn transmissions(&self) -> u32 {
        self.inner.transmissions()
    }

    fn glossy_lobe(
        &self,
        point: &SurfaceInteraction,
        view: DVec3,
        kind: SpecularRayKind,
    ) -> Option<GlossyLobe<'_>> {
        match kind {
            // They are looked up.
            SpecularRayKind::Reflection => None,
            _ => self.inner.glossy_lobe(point, view, kind),
        }
    }
}

#[cfg(all(test, feature = "all"))]
mod tests {
    use super::*;
    use crate::{bump::Bump, dielectric::Dielectric, glossy::Glossy, matte::Matte, mirror::Mirror};
    use whitstone_core::Texture;
    use whitstone_testkit::{TestContext, build_in, material_laws};

    /// The direction, shifted so that it is not negative.
    struct Directions;

    impl Texture for Directions {
        fn needs(&self) -> SurfaceAttributes {
            SurfaceAttributes::NOTHING
        }

        fn value(&self, point: &SurfaceInteraction) -> Rgb {
            Rgb::from(DVec3::ONE + point.position)
        }
    }

    /// A face of a cube map: its number.
    struct Face(f64);

    impl Texture for Face {
        fn needs(&self) -> SurfaceAttributes {
            SurfaceAttributes::UV
        }

        fn value(&self, _: &SurfaceInteraction) -> Rgb {
            Rgb::splat(self.0)
        }

        fn size(&self) -> Option<[usize; 2]> {
            Some([4, 4])
        }
    }

    const FACES: [&str; 6] = ["px", "nx", "py", "ny", "pz", "nz"];

    fn built(text: &str) -> Result<Arc<dyn Material>, SceneErrors> {
        let mut context = TestContext::default()
            .with_texture("directions", Directions)
            .with_material::<Mirror>("mirror", "reflectance = 0.5")
            .with_material::<Glossy>("glossy", "exponent = 20\nsamples = 3")
            .with_material::<Dielectric>("glass", "interior_ior = 1.5")
            .with_material::<Matte>("matte", "");
        for (name, number) in FACES.into_iter().zip(0..) {
            context = context.with_picture(name, Face(f64::from(number)));
        }
        build_in::<Materials, ReflectionMap>(text, (), &mut context)
    }

    #[test]
    fn laws() {
        for inner in ["mirror", "glossy", "glass", "matte"] {
            for map in ["\"directions\"", "0", "[0.5, 2, 1]"] {
                let text = format!("radiance = {map}\nmaterial = \"{inner}\"");
                material_laws(&*built(&text).unwrap());
            }
        }
    }

    #[test]
    fn reflections_are_looked_up_and_the_rest_is_traced() {
        let point = SurfaceInteraction::new(DVec3::ZERO, 0.0, DVec3::new(0.6, 0.8, 0.0));
        let view = DVec3::Y;
        let r = DVec3::new(0.96, 0.28, 0.0);
        let near = |found: Rgb, expected: DVec3| {
            let difference = DVec3::from_array(found.to_array()) - expected;
            assert!(difference.length() < 1e-14, "{found:?} instead of {expected}");
        };
        let mirror = built("radiance = \"directions\"\nmaterial = \"mirror\"").unwrap();
        near(mirror.emission(&point, view), 0.5 * (DVec3::ONE + r));
        assert_eq!(mirror.flags(), BsdfFlags::EMISSION);
        let mut branches = SpecularRays::default();
        mirror.specular_rays(&point, view, &mut branches);
        assert_eq!(branches.iter().count(), 0);

        let glass = built("radiance = \"directions\"\nmaterial = \"glass\"").unwrap();
        glass.specular_rays(&point, view, &mut branches);
        let through: Vec<_> = branches.iter().collect();
        assert_eq!(through.len(), 1);
        // What does not pass is reflected.
        near(
            glass.emission(&point, view),
            (1.0 - through[0].weight.r * 2.25) * (DVec3::ONE + r),
        );
        assert!(
            glass
                .flags()
                .contains(BsdfFlags::TRANSMISSION | BsdfFlags::EMISSION)
        );
        assert!(!glass.flags().contains(BsdfFlags::REFLECTION));
    }

    #[test]
    fn only_what_is_looked_up_counts_as_emission() {
        let flags = |map: &str, inner: &str| {
            let text = format!("radiance = {map}\nmaterial = \"{inner}\"");
            built(&text).unwrap().flags()
        };
        assert_eq!(flags("1", "matte"), BsdfFlags::LOCAL);
        assert_eq!(flags("0", "mirror"), BsdfFlags::NOTHING);
        assert_eq!(flags("1", "mirror"), BsdfFlags::EMISSION);
    }

    /// A slope of 0.75 along x turns the normal (0, 0, 1) to (0.6, 0, 0.8).
    #[test]
    fn bumps_bend_what_is_looked_up() {
        let mut context = TestContext::default()
            .with_texture("directions", Directions)
            .with_material::<Mirror>("mirror", "reflectance = 0.5")
            .with_material::<ReflectionMap>("map", "radiance = \"directions\"\nmaterial = \"mirror\"");
        let text = "vector_map = [1, 0.5, 0.5]\nscale = 0.75\nmaterial = \"map\"";
        let bent = build_in::<Materials, Bump>(text, (), &mut context).unwrap();
        let point = SurfaceInteraction::new(DVec3::ZERO, 0.0, DVec3::Z);
        let found = DVec3::from_array(bent.emission(&point, DVec3::Z).to_array());
        let expected = 0.5 * (DVec3::ONE + DVec3::new(0.96, 0.0, 0.28));
        assert!((found - expected).length() < 1e-14, "{found}");
    }

    #[test]
    fn a_glossy_reflection_is_the_mean_of_its_directions() {
        let point = SurfaceInteraction::new(DVec3::ZERO, 0.0, DVec3::Y);
        let view = DVec3::new(-0.6, 0.8, 0.0);
        let glossy = built("radiance = \"directions\"\nmaterial = \"glossy\"").unwrap();
        let mut context = TestContext::default();
        let traced = build_in::<Materials, Glossy>("exponent = 20\nsamples = 3", (), &mut context).unwrap();
        let lobe = traced
            .glossy_lobe(&point, view, SpecularRayKind::Reflection)
            .unwrap();
        let all: Vec<DVec3> = lobe.directions(DVec3::new(0.6, 0.8, 0.0)).collect();
        assert_eq!(all.len(), 9);
        let kept = all.iter().filter(|d| d.y > 0.0);
        let expected = kept.map(|d| DVec3::ONE + *d).sum::<DVec3>() / 9.0;
        let found = DVec3::from_array(glossy.emission(&point, view).to_array());
        assert!(
            (found - expected).length() < 1e-14,
            "{found} instead of {expected}"
        );
        assert_eq!(glossy.reflections(), 1);
        assert!(
            glossy
                .glossy_lobe(&point, view, SpecularRayKind::Reflection)
                .is_none()
        );
    }

    #[test]
    fn rule_g_drops_lookups_below_the_surface() {
        let mut point = SurfaceInteraction::new(DVec3::ZERO, 0.0, DVec3::Y);
        point.n_s = DVec3::new(0.8, 0.6, 0.0);
        // The reflected direction is (0.96, -0.28, 0), below the surface.
        let mirror = built("radiance = 1\nmaterial = \"mirror\"").unwrap();
        assert_eq!(mirror.emission(&point, DVec3::Y), Rgb::BLACK);
    }

    #[test]
    fn the_faces_of_a_cube_are_those_of_the_direction() {
        let faces = FACES
            .map(|name| format!("faces.{name}.file = \"{name}\"\n"))
            .concat();
        let mirror = built(&format!("material = \"mirror\"\n{faces}")).unwrap();
        for (number, axis) in [DVec3::X, DVec3::Y, DVec3::Z].into_iter().enumerate() {
            for (side, direction) in [axis, -axis].into_iter().enumerate() {
                let point = SurfaceInteraction::new(DVec3::ZERO, 0.0, direction);
                let expected = Rgb::splat(0.5 * (2 * number + side) as f64);
                assert_eq!(mirror.emission(&point, direction), expected);
            }
        }
    }

    #[test]
    fn bad_values_are_refused_at_their_places() {
        let text = "radiance = -1\nmaterial = 3";
        let errors = built(text).err().unwrap();
        let mut found: Vec<&str> = errors.0.iter().map(|e| &text[e.span.clone().unwrap()]).collect();
        found.sort_unstable();
        assert_eq!(found, ["-1", "3"]);
        assert!(built("material = \"mirror\"").is_err());
        let faces = FACES.map(|name| format!("{name} = {{ file = \"{name}\" }}"));
        let both = format!(
            "radiance = 1\nfaces = {{ {} }}\nmaterial = \"mirror\"",
            faces.join(", ")
        );
        let errors = built(&both).err().unwrap();
        assert!(errors.0[0].message.contains("exclude each other"));
    }
}
