//! A mirror that is not quite smooth: what it shows is blurred.
//!
//! Distribution ray tracing: Cook, Porter and Carpenter, *Distributed ray tracing*, SIGGRAPH 1984,
//! section 4.1, "Gloss". The lobe is that of Phong, `cos^exponent` about the mirror direction, cut
//! into parts of equal share (Lafortune and Willems, *Using the modified Phong reflectance model
//! for physically based rendering*, 1994, for the share inside a cone; Shirley and Chiu, *A low
//! discrepancy map between disk and square*, 1997, for the square). One ray goes through the middle
//! of each part, the same ones everywhere: instead of noise there are, with few of them, several
//! weaker mirror images.
//!
//! - Twin: through the driver, which spreads what Mitsuba's mirror answers.
//! - Example: `scenes/materials/glossy.toml`.

use crate::optics::reflect;
use crate::reflectance::reflectance;
use schemars::JsonSchema;
use serde::Deserialize;
use std::f64::consts::{FRAC_PI_2, FRAC_PI_4};
use std::sync::Arc;
use whitstone_core::config::{IntegerIn, Positive, TextureRef};
use whitstone_core::{
    Branch, BranchKind, Branches, ColorSource, Context, DVec3, Distribution, Lobes, Material, Materials,
    Needs, Plugin, SceneErrors, SurfacePoint,
};

/// A mirror on both sides that blurs, by samples² fixed directions about that of the mirror.
///
/// Each bounce multiplies the rays by samples², up to `max_depth` bounces: `min_contribution` ends
/// those that no longer count. More than 2^24 rays from one camera ray, glossy bounces alone
/// counted, are an error. Directions that go into the surface are lost: it darkens at grazing
/// angles.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// Factor on what is seen in it, from 0 to 1; a texture or a colour.
    #[serde(default = "one")]
    reflectance: TextureRef,
    /// Of the cosine of the angle to the mirror direction, above 0: the larger, the sharper. Half
    /// of the light is within 7 degrees with 100, within 2 with 1000.
    #[serde(default = "hundred")]
    exponent: Positive,
    /// Side of the square of directions, 1 to 8: so many times so many rays. With 1 it is a mirror.
    #[serde(default = "four")]
    samples: IntegerIn<1, 8>,
}

fn one() -> TextureRef {
    TextureRef::grey(1.0)
}

fn hundred() -> Positive {
    Positive::new(100.0).expect("it is positive")
}

fn four() -> IntegerIn<1, 8> {
    IntegerIn::new(4).expect("4 is in range")
}

/// See the module.
pub struct Glossy {
    reflectance: ColorSource,
    /// Unit vectors about +z; more than one.
    lobe: Vec<DVec3>,
}

impl Plugin<Materials> for Glossy {
    const TYPE: &'static str = "glossy";
    type Config = Config;

    fn build(config: Config, (): (), context: &mut dyn Context) -> Result<Arc<dyn Material>, SceneErrors> {
        Ok(Arc::new(Self {
            reflectance: reflectance(&config.reflectance, context)?,
            lobe: lobe(config.samples.get(), config.exponent.get()),
        }))
    }
}

/// The middle of each of n x n parts of a lobe about +z.
fn lobe(n: u32, exponent: f64) -> Vec<DVec3> {
    let middle = |index: u32| (2.0 * f64::from(index) + 1.0 - f64::from(n)) / f64::from(n);
    let at = |index: u32| {
        let (s, phi) = on_disk(middle(index % n), middle(index / n));
        // cos^(exponent + 1) is what lies outside of a cone; near 1 the sine keeps its digits this
        // way.
        let log_cos = (-s * s).ln_1p() / (exponent + 1.0);
        let sin = (-(2.0 * log_cos).exp_m1()).sqrt().copysign(s);
        DVec3::new(sin * phi.cos(), sin * phi.sin(), log_cos.exp())
    };
    (0..n * n).map(at).collect()
}

/// The concentric map of the square to the disk: radius, which may be negative, and angle.
fn on_disk(p: f64, q: f64) -> (f64, f64) {
    if p.abs() > q.abs() {
        (p, FRAC_PI_4 * (q / p))
    } else if q == 0.0 {
        (0.0, 0.0)
    } else {
        (q, FRAC_PI_2 - FRAC_PI_4 * (p / q))
    }
}

impl Material for Glossy {
    fn lobes(&self) -> Lobes {
        if self.reflectance.is_black() {
            Lobes::NOTHING
        } else {
            Lobes::REFLECTION
        }
    }

    fn needs(&self) -> Needs {
        Needs::SHADING_NORMAL | self.reflectance.needs()
    }

    fn branches(&self, point: &SurfacePoint, view: DVec3, out: &mut Branches) {
        out.push(Branch {
            direction: reflect(point.n_towards(view), view),
            weight: self.reflectance.value(point),
            kind: BranchKind::Reflection,
        });
    }

    fn reflections(&self) -> u32 {
        self.lobe.len() as u32
    }

    fn distribution(&self, point: &SurfacePoint, view: DVec3) -> Option<Distribution<'_>> {
        (self.lobe.len() > 1).then(|| Distribution {
            n: point.n_towards(view),
            lobe: &self.lobe,
        })
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

    fn directions(material: &dyn Material, point: &SurfacePoint, view: DVec3) -> Vec<DVec3> {
        let mut branches = Branches::default();
        material.branches(point, view, &mut branches);
        let mirrored = branches.iter().next().unwrap().direction;
        let spread = material.distribution(point, view);
        spread.map_or_else(|| vec![mirrored], |spread| spread.directions(mirrored).collect())
    }

    /// Of each ring of the concentric map, the share of the lobe inside is the area of the disk
    /// inside.
    #[test]
    fn parts_are_of_equal_share() {
        for exponent in [0.5, 20.0, 1e5] {
            for n in 1..=8 {
                for (index, q) in lobe(n, exponent).into_iter().enumerate() {
                    let middle = |index: usize| (2.0 * index as f64 + 1.0) / f64::from(n) - 1.0;
                    let (i, j) = (index % n as usize, index / n as usize);
                    let ring = middle(i).abs().max(middle(j).abs());
                    let inside = 1.0 - q.z.powf(exponent + 1.0);
                    assert!((inside - ring * ring).abs() < 1e-9, "{exponent} {n} {index}: {q}");
                    assert!((q.length() - 1.0).abs() < 1e-15);
                }
            }
        }
        // The mean cosine of the lobe is (e + 1)/(e + 2), up to the error of a rule of midpoints.
        let mean = lobe(8, 20.0).iter().map(|q| q.z).sum::<f64>() / 64.0;
        assert!((mean - 21.0 / 22.0).abs() < 1e-2, "{mean}");
    }

    #[test]
    fn one_sample_is_a_mirror_and_large_exponents_tend_to_it() {
        let point = SurfacePoint::new(DVec3::ZERO, 0.0, DVec3::Y);
        let view = DVec3::new(0.6, 0.8, 0.0);
        let mirrored = DVec3::new(-0.6, 0.8, 0.0);
        assert_eq!(glossy("samples = 1").reflections(), 1);
        assert!(glossy("samples = 1").distribution(&point, view).is_none());
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

    /// They lie evenly about the mirror direction, whatever the frame.
    #[test]
    fn the_mirror_direction_is_in_the_middle() {
        for n in [
            DVec3::Y,
            -DVec3::new(0.48, 0.64, 0.6),
            DVec3::new(1.0, -2.0, 0.5).normalize(),
        ] {
            let point = SurfacePoint::new(DVec3::ZERO, 0.0, n);
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

    /// What is made of it spreads as it does, bumps about their own normal.
    #[test]
    fn it_is_glossy_inside_others_too() {
        let mut context = TestContext::default()
            .with_material::<Glossy>("glossy", "reflectance = 0.5")
            .with_material::<Matte>("matte", "")
            .with_material::<Mirror>("mirror", "")
            .with_material::<Glossy>("smooth", "samples = 1")
            .with_material::<Dielectric>("glass", "");
        let point = SurfacePoint::new(DVec3::ZERO, 0.0, DVec3::Y);
        let view = DVec3::new(0.6, 0.8, 0.0);
        let expected = directions(&*glossy(""), &point, view);
        let text = "a = \"matte\"\nb = \"glossy\"";
        let mixed = build_in::<Materials, Mix>(text, (), &mut context).unwrap();
        let masked = build_in::<Materials, Mask>("material = \"glossy\"", (), &mut context).unwrap();
        for material in [&mixed, &masked] {
            material_laws(&**material);
            furnace_laws(&**material);
            assert_eq!(directions(&**material, &point, view), expected);
            let mut branches = Branches::default();
            material.branches(&point, view, &mut branches);
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
