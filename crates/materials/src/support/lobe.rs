//! A lobe of fixed directions, over which `glossy`, `rough` and `plastic` spread specular rays.
//!
//! Phong's `cos^exponent` around the direction of the specular ray, divided into parts of equal
//! weight: Lafortune and Willems, *Using the modified Phong reflectance model for physically based
//! rendering*, 1994, for the weight inside a cone; Shirley and Chiu, *A low distortion map between
//! disk and square*, 1997, for the map from a square grid.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::f64::consts::{FRAC_PI_2, FRAC_PI_4};
use whitstone_core::config::{IntegerIn, Positive};
use whitstone_core::{DVec3, GlossyLobe, SpecularRayKind, SurfaceInteraction};

/// Exponent of the cosine of the angle to the middle of the lobe, greater than 0; larger values are
/// sharper. Half of the light is within 6.7 degrees for 100, and within 2.1 degrees for 1000.
#[derive(Clone, Copy, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(transparent)]
#[schemars(inline)]
pub(crate) struct Exponent(Positive);

impl Default for Exponent {
    fn default() -> Self {
        Self(Positive::new(100.0).expect("100 is positive"))
    }
}

/// The key `samples`: the directions form a grid of n x n, which is mapped to the lobe; this is n.
pub(crate) type Samples = IntegerIn<1, 8>;

/// `samples`² unit vectors around +z, the direction of a specular ray.
pub(crate) struct Lobe(Vec<DVec3>);

impl Lobe {
    pub(crate) fn new(exponent: Exponent, samples: Samples) -> Self {
        Self(directions(samples.get(), exponent.0.get()))
    }

    /// The number of rays over which a specular ray is spread.
    pub(crate) fn rays(&self) -> u32 {
        self.0.len() as u32
    }

    /// The lobe over which a specular ray of this kind is spread; `None` if it has one direction.
    pub(crate) fn of(
        &self,
        point: &SurfaceInteraction,
        view: DVec3,
        kind: SpecularRayKind,
    ) -> Option<GlossyLobe<'_>> {
        let n = point.n_towards(view);
        (self.0.len() > 1).then_some(GlossyLobe {
            n: match kind {
                SpecularRayKind::Reflection => n,
                SpecularRayKind::Transmission { .. } | SpecularRayKind::Null => -n,
            },
            lobe: &self.0,
        })
    }

    /// [`Self::of`] for a material that spreads reflections only. A composite material may ask for
    /// the lobe of its own undeviated ray.
    pub(crate) fn of_reflection(
        &self,
        point: &SurfaceInteraction,
        view: DVec3,
        kind: SpecularRayKind,
    ) -> Option<GlossyLobe<'_>> {
        self.of(point, view, kind)
            .filter(|_| kind == SpecularRayKind::Reflection)
    }
}

/// The middle direction of each of n x n parts of a lobe around +z.
fn directions(n: u32, exponent: f64) -> Vec<DVec3> {
    let middle = |index: u32| (2.0 * f64::from(index) + 1.0 - f64::from(n)) / f64::from(n);
    let at = |index: u32| {
        let (s, phi) = on_disk(middle(index % n), middle(index / n));
        // cos^(exponent + 1) is the weight outside of a cone. Near 1, this form keeps the sine
        // accurate.
        let log_cos = libm::log1p(-s * s) / (exponent + 1.0);
        let sin = (-libm::expm1(2.0 * log_cos)).sqrt().copysign(s);
        DVec3::new(sin * libm::cos(phi), sin * libm::sin(phi), libm::exp(log_cos))
    };
    (0..n * n).map(at).collect()
}

/// The concentric map from the square to the disk: the radius, which may be negative, and the
/// angle.
fn on_disk(p: f64, q: f64) -> (f64, f64) {
    if p.abs() > q.abs() {
        (p, FRAC_PI_4 * (q / p))
    } else if q == 0.0 {
        (0.0, 0.0)
    } else {
        (q, FRAC_PI_2 - FRAC_PI_4 * (p / q))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn squares_become_rings() {
        for (p, q, expected) in [
            (0.5, 0.25, (0.5, 0.125)),
            (0.25, 0.5, (0.5, 0.375)),
            (-0.5, 0.25, (-0.5, -0.125)),
            (0.25, -0.5, (-0.5, 0.625)),
            (0.5, 0.5, (0.5, 0.25)),
            (0.0, 0.0, (0.0, 0.0)),
        ] {
            let (radius, angle) = on_disk(p, q);
            assert_eq!((radius, angle / std::f64::consts::PI), expected, "{p} {q}");
        }
    }

    /// For each ring of the concentric map, the weight of the lobe inside equals the disk area
    /// inside.
    #[test]
    fn parts_are_of_equal_share() {
        for exponent in [0.5, 20.0, 1e5] {
            for n in 1..=8 {
                for (index, q) in directions(n, exponent).into_iter().enumerate() {
                    let middle = |index: usize| (2.0 * index as f64 + 1.0) / f64::from(n) - 1.0;
                    let (i, j) = (index % n as usize, index / n as usize);
                    let ring = middle(i).abs().max(middle(j).abs());
                    let inside = 1.0 - q.z.powf(exponent + 1.0);
                    assert!((inside - ring * ring).abs() < 1e-9, "{exponent} {n} {index}: {q}");
                    assert!((q.length() - 1.0).abs() < 1e-15);
                }
            }
        }
        // The mean cosine of the lobe is (e + 1)/(e + 2), up to the error of the midpoint rule.
        let mean = directions(8, 20.0).iter().map(|q| q.z).sum::<f64>() / 64.0;
        assert!((mean - 21.0 / 22.0).abs() < 1e-2, "{mean}");
    }
}
