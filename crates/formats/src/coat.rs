//! A diffuse surface under a smooth coat: `plastic` of Mitsuba, `coateddiffuse` of pbrt.
//!
//! The base has the albedo ρ, and the coat reflects the share F of its light back to it. With one
//! factor for all colours, the share `reflectance` of the light that enters the coat leaves it, as
//! in the material `plastic`. If each reflection in the coat meets the albedo again, the share is
//! `ρ (1 - F)/(1 - ρ F)`, so that colours are more saturated (Jakob and others, *Mitsuba 3*,
//! `plastic` with `nonlinear`; pbrt's random walk without a medium).

use crate::document::{color, typed};
use crate::mitsuba::material::product;
use crate::table::as_color;
use toml::{Table, Value};

/// Nodes of the integral of F: its error is below 1e-5 for common glasses.
const NODES: u32 = 512;

/// The material of a base whose albedo counts in each reflection. A texture is scaled as grey of
/// 0.5 is.
pub(crate) fn of_albedo(albedo: Value, interior_ior: f64, exterior_ior: f64) -> Table {
    let back = reflected_back(interior_ior / exterior_ior);
    let share = |albedo: f64| albedo * (1.0 - back) / (1.0 - albedo * back);
    let reflectance = match as_color(&albedo) {
        Some(albedo) => color(albedo.map(share)),
        None => product([share(0.5) / 0.5; 3], albedo),
    };
    plastic(reflectance, interior_ior, exterior_ior)
}

/// The albedo of a base that gives the reflectance of a `plastic`: the inverse of [`of_albedo`].
pub(crate) fn albedo(reflectance: [f64; 3], m: f64) -> [f64; 3] {
    let back = reflected_back(m);
    reflectance.map(|share| share / (1.0 - back + share * back))
}

/// A base whose reflections in the coat have one factor for all colours.
pub(crate) fn plastic(reflectance: Value, interior_ior: f64, exterior_ior: f64) -> Table {
    typed(
        "plastic",
        [
            ("reflectance", reflectance),
            ("interior_ior", Value::Float(interior_ior)),
            ("exterior_ior", Value::Float(exterior_ior)),
        ],
    )
}

/// F: the share of diffuse light that a coat of relative index `m` reflects back to its base. What
/// passes from outside is `1 - F_outside`, and from inside `(1 - F_outside)/m²`.
fn reflected_back(m: f64) -> f64 {
    let outside: f64 = (0..NODES)
        .map(|i| {
            let cosine = (f64::from(i) + 0.5) / f64::from(NODES);
            2.0 * cosine * reflected(cosine, m) / f64::from(NODES)
        })
        .sum();
    (1.0 - (1.0 - outside) / (m * m)).clamp(0.0, 1.0)
}

/// Fresnel's equations for unpolarised light, from outside.
fn reflected(cosine: f64, m: f64) -> f64 {
    let squared = 1.0 - (1.0 - cosine * cosine) / (m * m);
    if squared <= 0.0 {
        return 1.0;
    }
    let below = squared.sqrt();
    let s = (cosine - m * below) / (cosine + m * below);
    let p = (m * cosine - below) / (m * cosine + below);
    (s * s + p * p) / 2.0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn light_is_reflected_back_as_in_the_tables() {
        // Judd, *Fresnel reflection of diffusely incident light*, 1942.
        for (m, known) in [(1.0, 0.0), (1.33, 0.472), (1.5, 0.596)] {
            assert!(
                (reflected_back(m) - known).abs() < 2e-3,
                "{m}: {}",
                reflected_back(m)
            );
        }
    }

    #[test]
    fn albedo_and_reflectance_are_inverse() {
        let table = of_albedo(color([0.1, 0.5, 1.0]), 1.5, 1.0);
        let reflectance = as_color(&table["reflectance"]).unwrap();
        assert!(reflectance[0] < 0.1 && reflectance[2] == 1.0, "{reflectance:?}");
        for (found, known) in albedo(reflectance, 1.5).into_iter().zip([0.1, 0.5, 1.0]) {
            assert!((found - known).abs() < 1e-12, "{found} {known}");
        }
    }
}
