//! Optics with 400 bits: Fresnel equations, refraction, cosine lobes, absorption.
//!
//! The formulas of `docs/whitted-model.md` in their plainest form: at this precision, cancellation
//! does not affect a double. All inputs are taken as exactly the doubles that they are. Directions
//! need not have unit length.

use dashu_float::{Context, FBig, round::mode::HalfEven};
use whitstone_core::DVec3;

const BITS: usize = 400;

type Number = FBig<HalfEven, 2>;

fn number(x: f64) -> Number {
    let exact: Number = FBig::try_from(x).expect("a finite number");
    exact.with_precision(BITS).value()
}

fn nearest(x: &Number) -> f64 {
    x.to_f64().value()
}

fn root(x: &Number) -> Number {
    Context::<HalfEven>::new(BITS)
        .sqrt(x.repr())
        .expect("squares are not negative")
        .value()
}

fn dot(a: DVec3, b: DVec3) -> Number {
    (0..3).fold(number(0.0), |sum, i| sum + number(a[i]) * number(b[i]))
}

/// The refracted ray at a smooth interface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Refraction {
    /// Fraction of unpolarised light that is reflected, in [0, 1].
    pub reflectance: f64,
    /// Cosine between the transmitted ray and the normal, in (0, 1].
    pub cosine: f64,
}

/// Refracts a ray with this direction at a surface with this normal, which has exactly unit length.
/// `ior` is the index of refraction on the far side, relative to the near side. `None` for total
/// internal reflection.
pub fn refract(direction: DVec3, normal: DVec3, ior: f64) -> Option<Refraction> {
    let (length, along) = (dot(direction, direction), dot(direction, normal));
    let square = &along * &along / &length;
    let (one, eta) = (number(1.0), number(ior));
    let transmitted = &one - (&one - &square) / (&eta * &eta);
    if transmitted <= number(0.0) {
        return None;
    }
    let (here, there) = (root(&square), root(&transmitted));
    let amplitude = |a: Number, b: Number| (&a - &b) / (&a + &b);
    let s = amplitude(here.clone(), &eta * &there);
    let p = amplitude(&eta * &here, there.clone());
    Some(Refraction {
        reflectance: nearest(&((&s * &s + &p * &p) / number(2.0))),
        cosine: nearest(&there),
    })
}

/// The cosine of the angle between two directions, to the power of `exponent`; 0 if the cosine is
/// not positive.
pub fn lobe(a: DVec3, b: DVec3, exponent: f64) -> f64 {
    let along = dot(a, b);
    if along <= number(0.0) {
        return 0.0;
    }
    // The logarithm of the squared cosine needs no square root.
    let square = &along * &along / (dot(a, a) * dot(b, b));
    nearest(&(square.ln() * number(exponent) / number(2.0)).exp())
}

/// exp(-x).
pub fn decay(x: f64) -> f64 {
    nearest(&(-number(x)).exp())
}

/// `base` to the power of a non-negative integer.
pub fn power(base: f64, exponent: u32) -> f64 {
    let base = number(base);
    let mut result = number(1.0);
    for bit in (0..u32::BITS).rev() {
        result = &result * &result;
        if exponent >> bit & 1 == 1 {
            result *= &base;
        }
    }
    nearest(&result)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn known_values() {
        let head_on = refract(DVec3::new(0.0, 0.0, -3.0), DVec3::Z, 1.5).expect("no total reflection");
        assert_eq!(head_on.reflectance, 0.04);
        assert_eq!(head_on.cosine, 1.0);
        assert_eq!(refract(DVec3::new(1.0, 0.0, -0.1), DVec3::Z, 0.5), None);
        // At Brewster's angle, 60 degrees for an index of sqrt(3), only one polarisation is
        // reflected: (1 - 3)² / (1 + 3)² / 2.
        let brewster = refract(DVec3::new(3f64.sqrt(), 0.0, -1.0), DVec3::Z, 3f64.sqrt());
        assert!((brewster.expect("no total reflection").reflectance - 0.125).abs() < 1e-15);
        assert_eq!(lobe(DVec3::X, DVec3::new(1.0, 1.0, 0.0), 2.0), 0.5);
        assert_eq!(lobe(DVec3::X, DVec3::new(-1.0, 1.0, 0.0), 2.0), 0.0);
        assert_eq!(decay(0.0), 1.0);
        assert_eq!(decay(1.0), (-1f64).exp());
        assert_eq!(decay(1e6), 0.0);
        assert_eq!(power(0.5, 10), 0.5f64.powi(10));
        assert_eq!(power(0.99, 0), 1.0);
    }

    #[test]
    fn the_plain_form_in_double_precision_is_worse() {
        // (eta - 1)² / (eta + 1)² for an index so close to 1 that the plain formula loses half of
        // its digits in doubles.
        let ior = 1.0 + 1e-9;
        let exact = refract(DVec3::new(1.0, 0.0, -1.0), DVec3::Z, ior).expect("no total reflection");
        let (here, there) = (0.5f64.sqrt(), (1.0 - 0.5 / (ior * ior)).sqrt());
        let s = (here - ior * there) / (here + ior * there);
        let p = (ior * here - there) / (ior * here + there);
        let plain = 0.5 * (s * s + p * p);
        assert!((plain / exact.reflectance - 1.0).abs() > 1e-9);
    }
}
