//! A metal: specular reflection weighted by the Fresnel equations for conductors.
//!
//! Born and Wolf, *Principles of Optics*, section 14.2, with a complex index of refraction
//! `eta + i k`. Let s and c be the sine and cosine of the angle of incidence.
//! `(a + i b)² = (eta + i k)² - s²` is computed without cancellation: given
//! `a² - b² = eta² - k² - s²` and `a b = eta k`, the larger square comes from a sum and the smaller
//! one from the product. Then
//!
//! - `R_s = ((a - c)² + b²)/((a + c)² + b²)`,
//! - `R_p = R_s ((a c - s²)² + b² c²)/((a c + s²)² + b² c²)`, which is
//!   `|(n² c - (a + i b))/(n² c + (a + i b))|²` written out.
//!
//! The indices of the named metals are Mitsuba's spectral tables integrated for linear Rec. 709, to
//! five decimals.
//!
//! - Twin: Mitsuba `conductor` in `twosided` (native).
//! - Example: `scenes/materials/conductor.toml`.

use crate::support::optics::reflect;
use crate::support::reflectance::share;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::sync::Arc;
use toml::Spanned;
use whitstone_core::config::{Color, TextureRef};
use whitstone_core::stream::{GROUP, SurfaceStream, groups};
use whitstone_core::{
    BsdfFlags, ColorSource, Context, DVec3, Material, Materials, Plugin, Rgb, SceneError, SceneErrors,
    SpecularRay, SpecularRayKind, SpecularRayStreams, SpecularRays, SurfaceAttributes, SurfaceInteraction,
    simd, simd::select,
};

/// Upper limit of eta and k, so that their squares and the products of these stay finite.
const MAX: f64 = 1e3;

/// A metal: a mirror whose colour follows from its index of refraction.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// A metal with a measured index, by its chemical symbol; replaces `eta` and `k`.
    #[serde(default)]
    #[schemars(extend("x-default" = "none: this, or `eta` and `k`, is required"), with = "Metal")]
    metal: Option<Spanned<Metal>>,
    /// Real part of the index of refraction, relative to the outside: a colour greater than 0, at
    /// most 1000.
    #[serde(default)]
    #[schemars(extend("x-default" = "that of `metal`"), with = "Color")]
    eta: Option<Spanned<Color>>,
    /// Imaginary part of the index of refraction (extinction coefficient): a colour from 0 to 1000.
    #[serde(default)]
    #[schemars(extend("x-default" = "that of `metal`"), with = "Color")]
    k: Option<Spanned<Color>>,
    /// Factor on the reflected radiance, from 0 to 1; a texture or a colour.
    #[serde(default = "one")]
    tint: TextureRef,
}

fn one() -> TextureRef {
    TextureRef::grey(1.0)
}

/// Metals by chemical symbol.
#[derive(Clone, Copy, Debug, Deserialize, Serialize, JsonSchema)]
enum Metal {
    Ag,
    Al,
    Au,
    Be,
    Cr,
    Cu,
    Hg,
    Ir,
    Ni,
    W,
}

impl Metal {
    /// `[eta, k]`, each as linear RGB.
    const fn index(self) -> [[f64; 3]; 2] {
        match self {
            Self::Ag => [[0.15528, 0.11673, 0.13839], [4.82835, 3.12222, 2.14690]],
            Self::Al => [[1.65750, 0.88040, 0.52124], [9.22381, 6.26950, 4.83700]],
            Self::Au => [[0.14304, 0.37531, 1.44205], [3.98300, 2.38556, 1.60336]],
            Self::Be => [[4.18501, 3.18503, 2.78406], [3.83547, 3.01012, 2.86899]],
            Self::Cr => [[4.36967, 2.91651, 1.65490], [5.20655, 4.23131, 3.75470]],
            Self::Cu => [[0.20101, 0.92375, 1.10222], [3.91326, 2.45305, 2.14209]],
            Self::Hg => [[2.39894, 1.44003, 0.90957], [6.32759, 4.37192, 3.42176]],
            Self::Ir => [[3.08630, 2.08219, 1.61791], [5.59215, 4.06709, 3.26731]],
            Self::Ni => [[2.36730, 1.66337, 1.46708], [4.49881, 3.05015, 2.34544]],
            Self::W => [[4.37082, 3.30025, 2.99841], [3.50064, 2.60487, 2.27323]],
        }
    }
}

/// The `conductor` material; see the module documentation.
pub struct Conductor {
    channels: [Index; 3],
    tint: ColorSource,
}

/// A complex index of refraction of one channel.
#[derive(Clone, Copy)]
struct Index {
    /// eta² - k².
    difference: f64,
    /// eta k.
    product: f64,
}

impl Index {
    fn new(eta: f64, k: f64) -> Self {
        Self {
            difference: (eta - k) * (eta + k),
            product: eta * k,
        }
    }

    /// Reflectance for unpolarised light, given the cosine and the sine of incidence.
    #[inline(always)]
    fn reflectance(self, c: f64, s: f64) -> f64 {
        let s2 = s * s;
        let t = self.difference - s2;
        let q = self.product;
        // (a² + b²)² = (a² - b²)² + (2 a b)².
        let larger = 0.5 * ((t * t + 4.0 * q * q).sqrt() + t.abs());
        let smaller = select(larger > 0.0, q * q / larger, 0.0);
        let (a2, b2) = (
            select(t >= 0.0, larger, smaller),
            select(t >= 0.0, smaller, larger),
        );
        let a = a2.sqrt();
        let square = |x: f64| x * x;
        // The reflectance is 1 at grazing incidence, and for an index that underflows to 0.
        let ratio = |part: f64, whole: f64| select(whole > 0.0, part / whole, 1.0);
        let r_s = ratio(square(a - c) + b2, square(a + c) + b2);
        let cross = b2 * c * c;
        let r_p = r_s * ratio(square(a * c - s2) + cross, square(a * c + s2) + cross);
        0.5 * (r_s + r_p)
    }
}

impl Plugin<Materials> for Conductor {
    const TYPE: &'static str = "conductor";
    type Config = Config;

    fn build(config: Config, (): (), context: &mut dyn Context) -> Result<Arc<dyn Material>, SceneErrors> {
        let mut errors = SceneErrors::default();
        let tint = errors.take(share(&config.tint, "a tint", context));
        let index = errors.take(index(&config));
        match (tint, index) {
            (Some(tint), Some([eta, k])) => {
                let channels = [0, 1, 2].map(|channel| Index::new(eta[channel], k[channel]));
                Ok(Arc::new(Self { channels, tint }))
            }
            _ => Err(errors),
        }
    }
}

/// `[eta, k]` from the configuration.
fn index(config: &Config) -> Result<[[f64; 3]; 2], SceneErrors> {
    let mut errors = SceneErrors::default();
    let mut number = |color: &Option<Spanned<Color>>, name: &str, zero: bool| {
        let color = color.as_ref()?;
        let channels = color.get_ref().get().to_array();
        let wrong = channels.into_iter().find(|x| *x > MAX || (*x == 0.0 && !zero));
        if let Some(wrong) = wrong {
            let least = if zero { "of at least 0" } else { "above 0" };
            let message = format!("expected `{name}` {least} and at most {MAX}, found {wrong}");
            errors.0.push(SceneError::at(color.span(), message));
        }
        Some(channels)
    };
    let (eta, k) = (number(&config.eta, "eta", false), number(&config.k, "k", true));
    let help = "either metal = \"Au\", or both eta and k";
    match (&config.metal, eta, k) {
        (Some(metal), None, None) => return Ok(metal.get_ref().index()),
        (None, Some(eta), Some(k)) if errors.0.is_empty() => return Ok([eta, k]),
        (None, Some(_), Some(_)) => {}
        (Some(metal), ..) => {
            let error = SceneError::at(metal.span(), "`metal` already defines `eta` and `k`");
            errors.0.push(error.with_help(help));
        }
        (None, ..) => {
            let error = SceneError::anywhere("the index of refraction is missing");
            errors.0.push(error.with_help(help));
        }
    }
    Err(errors)
}

/// The mirror direction and the Fresnel reflectance.
#[inline(always)]
fn reflected(channels: &[Index; 3], point: &SurfaceInteraction, view: DVec3) -> (DVec3, Rgb) {
    let n = point.n_towards(view);
    // If the view grazes the geometric surface, rounding may put the viewer behind the normal. Rule
    // G of the Whitted model (a reflected ray must leave on the viewer's side of the surface) then
    // drops that branch.
    let (c, s) = (n.dot(view).abs(), n.cross(view).length());
    let [r, g, b] = channels.map(|index| index.reflectance(c, s));
    (reflect(n, view), Rgb::new(r, g, b))
}

impl Material for Conductor {
    fn flags(&self) -> BsdfFlags {
        if self.tint.is_black() {
            BsdfFlags::NOTHING
        } else {
            BsdfFlags::REFLECTION
        }
    }

    fn needs(&self) -> SurfaceAttributes {
        SurfaceAttributes::SHADING_NORMAL | self.tint.needs()
    }

    fn specular_rays(&self, point: &SurfaceInteraction, view: DVec3, out: &mut SpecularRays) {
        let (direction, fresnel) = reflected(&self.channels, point, view);
        out.push(SpecularRay {
            direction,
            weight: fresnel * self.tint.value(point),
            kind: SpecularRayKind::Reflection,
        });
    }

    fn specular_rays_stream(&self, points: &SurfaceStream, out: &mut SpecularRayStreams) {
        self.tint.value_stream(points, &mut out.reflection.weight);
        out.transmission.weight.fill(points.len, Rgb::BLACK);
        // An unaliased local copy: it stays in registers.
        let channels = self.channels;
        let reflection = &mut out.reflection;
        simd::dispatch(
            #[inline(always)]
            || {
                for start in groups(points.len) {
                    for lane in start..start + GROUP {
                        let view = points.view.get(lane);
                        let (direction, fresnel) = reflected(&channels, &points.get(lane), view);
                        reflection.direction.set(lane, direction);
                        reflection.weight.set(lane, fresnel * reflection.weight.get(lane));
                    }
                }
            },
        );
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use whitstone_testkit::{build, furnace_laws, material_laws};

    /// The textbook form in complex numbers: r = (n_1 c_1 - n_2 c_2)/(n_1 c_1 + n_2 c_2), and
    /// likewise for the other polarisation.
    fn textbook(eta: f64, k: f64, c: f64) -> f64 {
        type C = (f64, f64);
        let mul = |a: C, b: C| (a.0 * b.0 - a.1 * b.1, a.0 * b.1 + a.1 * b.0);
        let square = |a: C| a.0 * a.0 + a.1 * a.1;
        let root = |a: C| {
            let (r, phi) = (square(a).sqrt(), a.1.atan2(a.0));
            (r.sqrt() * (phi / 2.0).cos(), r.sqrt() * (phi / 2.0).sin())
        };
        let n2 = mul((eta, k), (eta, k));
        // n_2 cos(theta_2).
        let g = root((n2.0 - (1.0 - c * c), n2.1));
        let ratio = |a: C, b: C| square((a.0 - b.0, a.1 - b.1)) / square((a.0 + b.0, a.1 + b.1));
        let r_s = ratio((c, 0.0), g);
        let r_p = ratio(mul(n2, (c, 0.0)), g);
        0.5 * (r_s + r_p)
    }

    #[test]
    fn laws() {
        for text in [
            "metal = \"Au\"",
            "metal = \"Al\"\ntint = [1, 0.5, 0]",
            "eta = 1\nk = 0",
            "eta = [1e-300, 1000, 0.5]\nk = [0, 1000, 1e-200]",
            "eta = 1e-160\nk = 1e-160",
            "eta = 1\nk = 1\ntint = 0",
        ] {
            let material = build::<Materials, Conductor>(text, ()).unwrap();
            material_laws(&*material);
            furnace_laws(&*material);
        }
    }

    #[test]
    fn fresnel_as_in_the_textbook() {
        for (eta, k) in [
            (0.143, 3.983),
            (1.5, 0.0),
            (4.0, 4.0),
            (0.5, 0.0),
            (2.5, 1e-3),
            (0.01, 20.0),
        ] {
            for step in 0..=100 {
                let c = f64::from(step) / 100.0;
                let found = Index::new(eta, k).reflectance(c, (1.0 - c * c).sqrt());
                let off = (found - textbook(eta, k, c)).abs();
                assert!(off < 1e-13, "eta {eta}, k {k}, cosine {c}: off by {off}");
            }
        }
    }

    #[test]
    fn normal_incidence_has_a_closed_form() {
        // ((eta - 1)² + k²)/((eta + 1)² + k²).
        let material =
            build::<Materials, Conductor>("eta = [0.2, 1, 3]\nk = [4, 2, 0]\ntint = 0.5", ()).unwrap();
        let point = SurfaceInteraction::new(DVec3::ZERO, 0.0, DVec3::Z);
        for view in [DVec3::Z, DVec3::NEG_Z] {
            let mut branches = SpecularRays::default();
            material.specular_rays(&point, view, &mut branches);
            let branch = branches.iter().next().unwrap();
            assert_eq!(branch.direction, view);
            let expected = [16.64 / 17.44, 4.0 / 8.0, 4.0 / 16.0].map(|r| 0.5 * r);
            for (a, b) in branch.weight.to_array().into_iter().zip(expected) {
                assert!((a - b).abs() < 1e-15, "{a} {b}");
            }
        }
    }

    #[test]
    fn metals_have_their_colours() {
        let reflected = |metal: &str| {
            let text = format!("metal = \"{metal}\"");
            let material = build::<Materials, Conductor>(&text, ()).unwrap();
            let point = SurfaceInteraction::new(DVec3::ZERO, 0.0, DVec3::Z);
            let mut branches = SpecularRays::default();
            material.specular_rays(&point, DVec3::Z, &mut branches);
            branches.iter().next().unwrap().weight
        };
        for (metal, expected) in [("Ag", [0.97, 0.95, 0.91]), ("Au", [0.97, 0.81, 0.32])] {
            for (a, b) in reflected(metal).to_array().into_iter().zip(expected) {
                assert!((a - b).abs() < 0.02, "{metal}: {a}, not {b}");
            }
        }
        let copper = reflected("Cu");
        assert!(copper.r > copper.g && copper.g > copper.b);
    }

    #[test]
    fn without_absorption_the_critical_angle_reflects_totally() {
        assert_eq!(Index::new(0.5, 0.0).reflectance(0.75_f64.sqrt(), 0.5), 1.0);
    }

    #[test]
    fn lobes_are_exact() {
        let lobes = |text| build::<Materials, Conductor>(text, ()).unwrap().flags();
        assert_eq!(lobes("metal = \"Cu\"\ntint = 0"), BsdfFlags::NOTHING);
        assert_eq!(lobes("metal = \"Cu\""), BsdfFlags::REFLECTION);
    }

    #[test]
    fn bad_indices_are_refused_at_their_places() {
        for (text, place) in [
            ("metal = \"Ag\"\nk = 1", "\"Ag\""),
            ("eta = 0\nk = 1", "0"),
            ("eta = 1\nk = 2000", "2000"),
            ("metal = \"Zn\"", "\"Zn\""),
            ("metal = \"Ag\"\ntint = 2", "2"),
        ] {
            let error = build::<Materials, Conductor>(text, ()).err().unwrap().0.remove(0);
            assert_eq!(&text[error.span.unwrap()], place);
        }
        assert!(build::<Materials, Conductor>("eta = 1", ()).is_err());
    }
}
