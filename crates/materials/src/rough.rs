//! A material with blurred reflections and transmissions: rough metal, rough glass, frosted panes.
//!
//! Distribution ray tracing: Cook, Porter and Carpenter, *Distributed ray tracing*, SIGGRAPH 1984,
//! "Gloss" and "Translucency". The lobe is that of `glossy`, around the direction of each specular
//! ray of the material. Weights, such as those of Fresnel's equations, are those of the smooth
//! surface. Unlike a microfacet model (Walter, Marschner, Li and Torrance, *Microfacet models for
//! refraction through rough surfaces*, 2007), lights show no highlights, and there is no noise.
//!
//! - Twin: hosted by the Mitsuba driver, which samples the lobe around the directions of Mitsuba's
//!   smooth materials.
//! - Example: `scenes/materials/rough.toml`.

use crate::support::lobe::{Exponent, Lobe, Samples};
use schemars::JsonSchema;
use serde::Deserialize;
use std::sync::Arc;
use whitstone_core::config::MaterialRef;
use whitstone_core::stream::{Colors, SampleStreams, SurfaceStream};
use whitstone_core::{
    BsdfFlags, Context, DVec3, GlossyLobe, LightSamples, Material, Materials, Plugin, Rgb, SceneError,
    SceneErrors, SpecularRayKind, SpecularRayStreams, SpecularRays, SurfaceAttributes, SurfaceInteraction,
    Transmittance,
};

/// Another material whose reflected and transmitted rays are blurred by samples² fixed directions
/// each: rough metal around `conductor`, rough glass around `dielectric`.
///
/// Each bounce multiplies the number of rays by samples², or by twice as many where the material
/// both reflects and transmits, up to `max_depth` bounces; `min_contribution` ends rays whose
/// contribution is too small. More than 2^24 rays per camera ray, counting such bounces only, are
/// an error. Directions on the wrong side of the surface are dropped, which darkens grazing angles.
/// Filtered shadows pass rough glass undeviated, as they do smooth glass.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// The material whose rays are blurred. It must not contain a `mask` or a material whose rays
    /// are blurred already (`glossy`, `rough`, or `plastic` with `samples` above 1).
    material: MaterialRef,
    #[serde(default)]
    exponent: Exponent,
    /// The directions form a grid of n x n, which is mapped to the lobe; this is n, 1 to 8. 1 is
    /// the material itself.
    #[serde(default = "Samples::of::<4>")]
    samples: Samples,
}

/// The `rough` material; see the module documentation.
pub struct Rough {
    inner: Arc<dyn Material>,
    lobe: Lobe,
}

impl Plugin<Materials> for Rough {
    const TYPE: &'static str = "rough";
    type Config = Config;

    fn build(config: Config, (): (), context: &mut dyn Context) -> Result<Arc<dyn Material>, SceneErrors> {
        let inner = context.material(&config.material)?;
        let mut errors = SceneErrors::default();
        let mut refuse = |message: &str, help: &str| {
            let error = SceneError::at(config.material.span.clone(), message);
            errors.0.push(error.with_help(help));
        };
        if inner.flags().intersects(BsdfFlags::CUT_OUTS) {
            refuse(
                "expected a material without holes: they would be blurred, too",
                "make the `mask` of the rough material instead",
            );
        }
        if inner.reflections() > 1 || inner.transmissions() > 1 {
            refuse(
                "expected a material whose rays are not blurred already",
                "use `mirror` instead of `glossy`, or `samples = 1`",
            );
        }
        errors.into_result(Arc::new(Self {
            inner,
            lobe: Lobe::new(config.exponent, config.samples),
        }))
    }
}

impl Rough {
    /// The number of rays over which each specular ray of these kinds is spread.
    fn rays(&self, kinds: BsdfFlags) -> u32 {
        if self.inner.flags().intersects(kinds) {
            self.lobe.rays()
        } else {
            1
        }
    }
}

impl Material for Rough {
    fn flags(&self) -> BsdfFlags {
        self.inner.flags()
    }

    fn needs(&self) -> SurfaceAttributes {
        // The lobe turns with the shading normal.
        self.inner.needs() | SurfaceAttributes::SHADING_NORMAL
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
        self.inner.emission(point, view)
    }

    fn emission_stream(&self, points: &SurfaceStream, out: &mut Colors) {
        self.inner.emission_stream(points, out);
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
        self.inner.specular_rays(point, view, out);
    }

    fn specular_rays_stream(&self, points: &SurfaceStream, out: &mut SpecularRayStreams) {
        self.inner.specular_rays_stream(points, out);
    }

    fn reflections(&self) -> u32 {
        self.rays(BsdfFlags::REFLECTION)
    }

    fn transmissions(&self) -> u32 {
        self.rays(BsdfFlags::TRANSMISSION | BsdfFlags::NULL)
    }

    fn glossy_lobe(
        &self,
        point: &SurfaceInteraction,
        view: DVec3,
        kind: SpecularRayKind,
    ) -> Option<GlossyLobe<'_>> {
        let rays = match kind {
            SpecularRayKind::Reflection => self.reflections(),
            SpecularRayKind::Transmission { .. } | SpecularRayKind::Null => self.transmissions(),
        };
        // A mask around this material has an undeviated ray of its own.
        self.lobe.of(point, view, kind).filter(|_| rays > 1)
    }
}

#[cfg(all(test, feature = "all"))]
mod tests {
    use super::*;
    use crate::{
        bump::Bump, conductor::Conductor, dielectric::Dielectric, emissive::Emissive, glossy::Glossy,
        mask::Mask, matte::Matte, mirror::Mirror, mix::Mix, reflection_map::ReflectionMap,
        thin_dielectric::ThinDielectric, two_sided::TwoSided, whitted::Whitted,
    };
    use whitstone_core::SpecularRay;
    use whitstone_testkit::{
        TestContext, build_in, dielectric_laws, furnace_laws, material_laws, sided_material_laws,
    };

    fn context() -> TestContext {
        TestContext::default()
            .with_material::<Matte>("matte", "reflectance = 0.5")
            .with_material::<Mirror>("mirror", "reflectance = 0.5")
            .with_material::<Glossy>("glossy", "reflectance = 0.5")
            .with_material::<Glossy>("smooth", "samples = 1")
            .with_material::<Conductor>("gold", "metal = \"Au\"")
            .with_material::<Dielectric>("glass", "absorption = 2")
            .with_material::<ThinDielectric>("pane", "tint = 0.5")
            .with_material::<Emissive>("lamp", "radiance = 3")
            .with_material::<Whitted>("varnish", "k_d = 0.3\nk_refl = 0.2\nk_refr = 0.4")
    }

    fn rough(text: &str) -> Result<Arc<dyn Material>, SceneErrors> {
        build_in::<Materials, Rough>(text, (), &mut context())
    }

    /// All directions and weights of a kind of ray.
    fn rays(
        material: &dyn Material,
        point: &SurfaceInteraction,
        view: DVec3,
        reflected: bool,
    ) -> Vec<(DVec3, Rgb)> {
        let mut branches = SpecularRays::default();
        material.specular_rays(point, view, &mut branches);
        let of_kind = |branch: &&SpecularRay| (branch.kind == SpecularRayKind::Reflection) == reflected;
        let Some(branch) = branches.iter().find(of_kind) else {
            return Vec::new();
        };
        match material.glossy_lobe(point, view, branch.kind) {
            None => vec![(branch.direction, branch.weight)],
            Some(lobe) => {
                let all = lobe.directions(branch.direction);
                let weight = branch.weight * (1.0 / all.len() as f64);
                all.map(|direction| (direction, weight)).collect()
            }
        }
    }

    #[test]
    fn laws() {
        for text in [
            "material = \"gold\"",
            "material = \"mirror\"\nsamples = 8\nexponent = 1e-9",
            "material = \"pane\"\nexponent = 1e300\nsamples = 3",
            "material = \"matte\"",
            "material = \"mirror\"\nsamples = 1",
        ] {
            let material = rough(text).unwrap();
            material_laws(&*material);
            furnace_laws(&*material);
        }
        for inner in ["varnish", "lamp"] {
            material_laws(&*rough(&format!("material = \"{inner}\"\nsamples = 2")).unwrap());
        }
        let glass = rough("material = \"glass\"\nsamples = 2").unwrap();
        material_laws(&*glass);
        dielectric_laws(&*glass, 1.5, 1.0);
    }

    #[test]
    fn around_a_mirror_it_is_glossy() {
        let mut context = context();
        let glossy = build_in::<Materials, Glossy>("reflectance = 0.5", (), &mut context).unwrap();
        let material = rough("material = \"mirror\"").unwrap();
        assert_eq!((material.reflections(), material.transmissions()), (16, 1));
        let view = DVec3::new(0.6, 0.8, 0.0);
        for n in [DVec3::Y, DVec3::new(1.0, 2.0, -0.5).normalize()] {
            let point = SurfaceInteraction::new(DVec3::ZERO, 0.0, n);
            let found = rays(&*material, &point, view, true);
            assert_eq!(found, rays(&*glossy, &point, view, true));
            assert_eq!(found.len(), 16);
        }
    }

    /// Transmitted directions surround the refracted one and keep the weight of the smooth glass
    /// together. At normal incidence they are the reflected ones of the opposite normal.
    #[test]
    fn both_rays_of_glass_are_spread() {
        let material = rough("material = \"glass\"\nexponent = 50\nsamples = 3").unwrap();
        let smooth = rough("material = \"glass\"\nsamples = 1").unwrap();
        assert_eq!((material.reflections(), material.transmissions()), (9, 9));
        assert_eq!((smooth.reflections(), smooth.transmissions()), (1, 1));
        let view = DVec3::new(0.6, 0.8, 0.0);
        let point = SurfaceInteraction::new(DVec3::ZERO, 0.0, DVec3::Y);
        for reflected in [false, true] {
            let found = rays(&*material, &point, view, reflected);
            let [(middle, weight)] = rays(&*smooth, &point, view, reflected)[..] else {
                panic!("smooth glass has one ray of a kind")
            };
            let sum: DVec3 = found.iter().map(|(direction, _)| *direction).sum();
            assert!(sum.cross(middle).length() < 1e-14);
            assert!((found[4].0 - middle).length() < 1e-14);
            let total: Rgb = found.iter().map(|(_, weight)| *weight).sum();
            assert!((total.g - weight.g).abs() < 1e-15);
            // The corners of the grid are on the ring 2/3 of the disk: cos^51 is 1 - 4/9.
            let cosine = (5.0_f64 / 9.0).powf(1.0 / 51.0);
            assert!((found[0].0.dot(middle) - cosine).abs() < 1e-14);
        }
        let down = rays(&*material, &point, DVec3::Y, false);
        let under = SurfaceInteraction::new(DVec3::ZERO, 0.0, DVec3::NEG_Y);
        let mirrored = rays(&*material, &under, DVec3::NEG_Y, true);
        for ((a, _), (b, _)) in down.iter().zip(&mirrored) {
            assert!((*a - *b).length() < 1e-14, "{a} {b}");
        }
    }

    /// All that is not a specular ray is that of the material.
    #[test]
    fn local_terms_and_filters_are_those_of_the_material() {
        let mut context = context();
        let point = SurfaceInteraction::new(DVec3::ZERO, 0.0, DVec3::Z);
        let view = DVec3::new(0.0, 0.6, 0.8);
        let light = LightSamples {
            ambient: Rgb::splat(2.0),
            lights: &[],
        };
        let varnish = rough("material = \"varnish\"").unwrap();
        assert!((varnish.local_illumination(&point, view, &light).g - 0.6).abs() < 1e-15);
        let smooth = build_in::<Materials, Dielectric>("absorption = 2", (), &mut context).unwrap();
        let glass = rough("material = \"glass\"").unwrap();
        for filtered in [false, true] {
            assert_eq!(
                glass.shadow_transmittance(&point, -view, filtered),
                smooth.shadow_transmittance(&point, -view, filtered)
            );
        }
        let glow = rough("material = \"lamp\"").unwrap();
        assert_eq!(glow.emission(&point, view), Rgb::splat(3.0));
    }

    /// Materials made of a rough one spread in the same way.
    #[test]
    fn it_is_rough_inside_others_too() {
        let mut context = context()
            .with_material::<Conductor>("steel", "eta = 2\nk = 3")
            .with_material::<Mirror>("white", "")
            .with_material::<Rough>("brushed", "material = \"steel\"")
            .with_material::<Rough>("frosted", "material = \"glass\"\nsamples = 2")
            .with_material::<Rough>("etched", "material = \"pane\"\nsamples = 2");
        let point = SurfaceInteraction::new(DVec3::ZERO, 0.0, DVec3::Y);
        let view = DVec3::new(0.6, 0.8, 0.0);
        let brushed = build_in::<Materials, Rough>("material = \"steel\"", (), &mut context).unwrap();
        let expected = rays(&*brushed, &point, view, true);
        let masked = build_in::<Materials, Mask>("material = \"brushed\"", (), &mut context).unwrap();
        let mixed = build_in::<Materials, Mix>("a = \"matte\"\nb = \"brushed\"", (), &mut context).unwrap();
        for material in [&masked, &mixed] {
            material_laws(&**material);
            let found = rays(&**material, &point, view, true);
            assert_eq!(found.len(), 16);
            assert!(found.iter().zip(&expected).all(|(a, b)| a.0 == b.0));
            assert_eq!(material.transmissions(), 1);
        }
        // The holes stay sharp.
        let holes = rays(&*masked, &point, view, false);
        assert_eq!(holes, [(-view, Rgb::splat(0.5))]);
        let sides =
            build_in::<Materials, TwoSided>("front = \"frosted\"\nback = \"brushed\"", (), &mut context)
                .unwrap();
        sided_material_laws(&*sides);
        assert_eq!((sides.reflections(), sides.transmissions()), (16, 4));
        assert_eq!(rays(&*sides, &point, view, false).len(), 4);
        let mapped = "radiance = 1\nmaterial = \"frosted\"";
        let mapped = build_in::<Materials, ReflectionMap>(mapped, (), &mut context).unwrap();
        material_laws(&*mapped);
        assert_eq!((mapped.reflections(), mapped.transmissions()), (1, 4));
        assert_eq!(rays(&*mapped, &point, view, false).len(), 4);
        let bumpy =
            build_in::<Materials, Bump>("height = 1\nmaterial = \"frosted\"", (), &mut context).unwrap();
        assert_eq!(rays(&*bumpy, &point, view, false).len(), 4);
        // A ray would continue both undeviated and around its direction.
        for text in ["material = \"etched\"", "material = \"frosted\""] {
            assert!(
                build_in::<Materials, Mask>(text, (), &mut context).is_err(),
                "{text}"
            );
        }
        for text in [
            "a = \"etched\"\nb = \"pane\"",
            "a = \"pane\"\nb = \"frosted\"",
            "a = \"brushed\"\nb = \"white\"",
        ] {
            assert!(
                build_in::<Materials, Mix>(text, (), &mut context).is_err(),
                "{text}"
            );
        }
    }

    #[test]
    fn faults_are_refused_at_their_places() {
        let mut context = context()
            .with_material::<Mask>("net", "opacity = 0.5\nmaterial = \"mirror\"")
            .with_material::<Rough>("frosted", "material = \"glass\"\nsamples = 2")
            .with_material::<ReflectionMap>("mapped", "radiance = 1\nmaterial = \"frosted\"");
        for (text, place) in [
            ("material = \"mirror\"\nexponent = 0", "0"),
            ("material = \"mirror\"\nsamples = 9", "9"),
            ("material = \"glossy\"", "\"glossy\""),
            ("material = \"net\"", "\"net\""),
            ("material = \"frosted\"", "\"frosted\""),
            // Only its transmission is spread.
            ("material = \"mapped\"", "\"mapped\""),
            ("material = 3", "3"),
        ] {
            let error = build_in::<Materials, Rough>(text, (), &mut context);
            let error = error.err().unwrap().0.remove(0);
            assert_eq!(&text[error.span.unwrap()], place);
        }
        assert!(build_in::<Materials, Rough>("material = \"smooth\"", (), &mut context).is_ok());
        assert!(build_in::<Materials, Rough>("", (), &mut context).is_err());
    }
}
