//! Glass, water, diamond: reflection and refraction by Fresnel's equations.
//!
//! Cook and Torrance 1982 (Fresnel); the forms that do not cancel are derived in `optics.rs`. Transmitted
//! radiance is scaled by the squared relative index: what is kept is L/n².
//!
//! - Twin: Mitsuba `dielectric` (native); absorption through the driver.
//! - Example: `scenes/materials/dielectric.toml`.

use crate::body::Body;
use schemars::JsonSchema;
use serde::Deserialize;
use std::sync::Arc;
use whitstone_core::config::{Color, Positive};
use whitstone_core::stream::{GROUP, PointStream, groups};
use whitstone_core::{
    Branch, BranchKind, BranchStreams, Branches, Context, DVec3, Filter, Lobes, Material, Materials, Needs,
    Plugin, Rgb, SceneErrors, SurfacePoint, simd, simd::select,
};

/// A smooth transparent body: reflection and refraction by Fresnel's equations.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// Index of refraction inside.
    #[serde(default = "glass")]
    interior_ior: Positive,
    /// Index of refraction outside.
    #[serde(default = "vacuum")]
    exterior_ior: Positive,
    /// Absorption coefficient inside, per metre.
    #[serde(default = "clear")]
    absorption: Color,
    /// Absorption coefficient outside, per metre, of rays that leave the body.
    #[serde(default = "clear")]
    exterior_absorption: Color,
}

fn glass() -> Positive {
    Positive::new(1.5).expect("1.5 is positive")
}

fn vacuum() -> Positive {
    Positive::new(1.0).expect("1 is positive")
}

fn clear() -> Color {
    Color::grey(0.0)
}

/// See the module.
pub struct Dielectric {
    body: Body,
}

impl Plugin<Materials> for Dielectric {
    const TYPE: &'static str = "dielectric";
    type Config = Config;

    fn build(config: Config, (): (), _: &mut dyn Context) -> Result<Arc<dyn Material>, SceneErrors> {
        let interior = (config.interior_ior.get(), config.absorption.get());
        let exterior = (config.exterior_ior.get(), config.exterior_absorption.get());
        Ok(Arc::new(Self {
            body: Body::new(interior, exterior),
        }))
    }
}

impl Material for Dielectric {
    fn lobes(&self) -> Lobes {
        if self.body.is_open() {
            Lobes::TRANSMISSION | Lobes::FILTERS
        } else {
            Lobes::REFLECTION | Lobes::TRANSMISSION | Lobes::FILTERS
        }
    }

    fn needs(&self) -> Needs {
        Needs::SHADING_NORMAL
    }

    fn shadow(&self, point: &SurfacePoint, direction: DVec3, filtered: bool) -> Filter {
        if !filtered {
            return Filter::OPAQUE;
        }
        let weight = Rgb::splat(self.body.unbent(point, direction));
        self.body.filter(point, direction, weight)
    }

    fn branches(&self, point: &SurfacePoint, view: DVec3, out: &mut Branches) {
        let split = self.split(point, view);
        if split.reflectance > 0.0 {
            out.push(Branch {
                direction: split.reflected,
                weight: Rgb::splat(split.reflectance),
                kind: BranchKind::Reflection,
            });
        }
        if split.transmittance > 0.0 {
            out.push(Branch {
                direction: split.transmitted,
                weight: Rgb::splat(split.transmittance),
                kind: BranchKind::Transmission {
                    absorption: split.absorption,
                },
            });
        }
    }

    fn branches_stream(&self, points: &PointStream, out: &mut BranchStreams) {
        simd::dispatch(
            #[inline(always)]
            || {
                for start in groups(points.len) {
                    for lane in start..start + GROUP {
                        let split = self.split(&points.get(lane), points.view.get(lane));
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

/// Both branches at a point; one of weight zero is none.
struct Split {
    reflected: DVec3,
    reflectance: f64,
    transmitted: DVec3,
    /// Of radiance: scaled by the squared relative index.
    transmittance: f64,
    /// Of the medium on the other side.
    absorption: Rgb,
}

impl Dielectric {
    #[inline(always)]
    fn split(&self, point: &SurfacePoint, view: DVec3) -> Split {
        let passage = self.body.passage(point, view);
        let (crossing, eta) = (&passage.crossing, passage.interface.eta());
        let fresnel = passage.interface.fresnel(crossing);
        // In this order, since eta² may overflow where the product is a number.
        let transmittance = fresnel.transmitted * eta * eta;
        Split {
            reflected: passage.reflected,
            reflectance: select(crossing.total, 1.0, fresnel.reflected),
            transmitted: crossing.direction,
            transmittance: select(crossing.total, 0.0, transmittance),
            absorption: passage.absorption,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use whitstone_testkit::{build, dielectric_laws, material_laws};

    fn branches(text: &str, n_g: DVec3, view: DVec3) -> Vec<Branch> {
        let mut out = Branches::default();
        let point = SurfacePoint::new(DVec3::ZERO, 0.0, n_g);
        build::<Materials, Dielectric>(text, ())
            .unwrap()
            .branches(&point, view, &mut out);
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
        let outside = branches("absorption = 2\nexterior_absorption = 3", DVec3::Z, DVec3::Z);
        let [r, t] = outside[..] else {
            panic!("{outside:?}")
        };
        assert!((r.weight.g - 0.04).abs() < 1e-16);
        assert!((t.weight.g - 0.96 / 2.25).abs() < 1e-15);
        assert_eq!((r.direction, t.direction), (DVec3::Z, DVec3::NEG_Z));
        assert_eq!(
            t.kind,
            BranchKind::Transmission {
                absorption: Rgb::splat(2.0)
            }
        );
        let inside = branches("absorption = 2\nexterior_absorption = 3", DVec3::NEG_Z, DVec3::Z);
        assert!((inside[1].weight.g - 0.96 * 2.25).abs() < 1e-15);
        assert_eq!(
            inside[1].kind,
            BranchKind::Transmission {
                absorption: Rgb::splat(3.0)
            }
        );
    }

    #[test]
    fn total_internal_reflection_is_one_branch() {
        let found = branches("", DVec3::NEG_Z, DVec3::new(0.8, 0.0, 0.6));
        let [r] = found[..] else { panic!("{found:?}") };
        assert_eq!((r.weight, r.kind), (Rgb::WHITE, BranchKind::Reflection));
    }

    #[test]
    fn equal_indices_are_not_there() {
        let view = DVec3::new(0.3, 0.1, 0.7).normalize();
        let found = branches("interior_ior = 1.2\nexterior_ior = 1.2", DVec3::Z, view);
        let [t] = found[..] else { panic!("{found:?}") };
        assert_eq!((t.direction, t.weight), (-view, Rgb::WHITE));
        let material = build::<Materials, Dielectric>("interior_ior = 1", ()).unwrap();
        assert_eq!(material.lobes(), Lobes::TRANSMISSION | Lobes::FILTERS);
    }

    #[test]
    fn filtered_shadows_lose_as_much_at_both_faces() {
        let text = "absorption = 2\nexterior_absorption = 3";
        let material = build::<Materials, Dielectric>(text, ()).unwrap();
        let point = SurfacePoint::new(DVec3::ZERO, 0.0, DVec3::Z);
        assert_eq!(material.shadow(&point, DVec3::Z, false), Filter::OPAQUE);
        let (down, up) = (DVec3::new(0.8, 0.0, -0.6), DVec3::new(0.8, 0.0, 0.6));
        let (inwards, outwards) = (
            material.shadow(&point, down, true),
            material.shadow(&point, up, true),
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

    #[test]
    fn bad_values_are_refused() {
        for text in [
            "interior_ior = 0",
            "exterior_ior = -1",
            "absorption = -1",
            "interior_ior = inf",
            "ior = 1",
        ] {
            assert!(build::<Materials, Dielectric>(text, ()).is_err(), "{text}");
        }
    }
}
