//! Double-double numbers for the textbook formulas: sums of two doubles, of about 106 bits.
//!
//! The arithmetic is that of the crate qd, except where its results are not finite. The other
//! functions begin with those of `f64`, and correct them by a step of Newton's method.

use super::Real;
use qd::Quad;
use std::cmp::Ordering;
use std::ops::{Add, Div, Mul, Neg, Sub};

/// The sum of two doubles.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DoubleDouble(Quad);

/// π as the sum of two doubles.
const PI: DoubleDouble = DoubleDouble(Quad(std::f64::consts::PI, 1.224_646_799_147_353_2e-16));
/// Number of terms of a series for arguments of at most π / 16.
const TERMS: u32 = 12;

impl DoubleDouble {
    /// The product of two doubles, exact unless it underflows.
    pub(super) fn product(a: f64, b: f64) -> Self {
        Self::of(a) * Self::of(b)
    }

    /// `plain` is the same result in double precision, which stands where qd gives NaN instead of
    /// infinity.
    fn checked(result: Quad, plain: f64) -> Self {
        Self(if result.is_finite() {
            result
        } else {
            Quad(plain, 0.0)
        })
    }

    /// Cosine and sine.
    fn turn(self) -> [Self; 2] {
        let twice = Self::of(2.0);
        let turns = Self::of((self.to_f64() / std::f64::consts::TAU).round());
        let square = {
            let eighth = (self - turns * twice * PI) / Self::of(16.0);
            eighth * eighth
        };
        // 1 - cos, which loses no digits when the angle is doubled.
        let (mut term, mut less) = (Self::of(-1.0), Self::of(0.0));
        for k in 1..=TERMS {
            term = -(term * square) / Self::of(f64::from(2 * k * (2 * k - 1)));
            less = less + term;
        }
        for _ in 0..4 {
            less = twice * less * (twice - less);
        }
        let sine = (less * (twice - less)).sqrt();
        let is_above = self - turns * twice * PI > Self::of(0.0);
        [Self::of(1.0) - less, if is_above { sine } else { -sine }]
    }
}

impl Neg for DoubleDouble {
    type Output = Self;
    fn neg(self) -> Self {
        Self(-self.0)
    }
}

macro_rules! operators {
    ($($name:ident $function:ident $sign:tt;)*) => { $(
        impl $name for DoubleDouble {
            type Output = Self;
            fn $function(self, other: Self) -> Self {
                Self::checked(self.0 $sign other.0, self.0.0 $sign other.0.0)
            }
        }
    )* };
}

operators! {
    Add add +;
    Sub sub -;
    Mul mul *;
    Div div /;
}

impl PartialOrd for DoubleDouble {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        self.0.partial_cmp(other.0)
    }
}

impl Real for DoubleDouble {
    const EPSILON: f64 = f64::EPSILON * f64::EPSILON;
    const PI: Self = PI;

    fn of(x: f64) -> Self {
        Self(Quad::from_f64(x))
    }

    fn of_wide(x: Self) -> Self {
        x
    }

    fn to_f64(self) -> f64 {
        self.0.0
    }

    fn sqrt(self) -> Self {
        Self::checked(self.0.sqrt(), self.0.0.sqrt())
    }

    fn abs(self) -> Self {
        Self(self.0.abs())
    }

    fn cbrt(self) -> Self {
        let near = Self::of(self.to_f64().cbrt());
        let square = near * near;
        let root = near - (square * near - self) / (Self::of(3.0) * square);
        if root.0.is_finite() { root } else { near }
    }

    fn cos(self) -> Self {
        self.turn()[0]
    }

    fn tan(self) -> Self {
        let [cos, sin] = self.turn();
        sin / cos
    }

    fn acos(self) -> Self {
        let near = Self::of(self.to_f64().acos());
        let [cos, sin] = near.turn();
        let angle = near + (cos - self) / sin;
        if angle.0.is_finite() { angle } else { near }
    }

    fn exp(self) -> Self {
        Self::checked(self.0.exp(), self.0.0.exp())
    }

    fn powf(self, exponent: Self) -> Self {
        (Self(self.0.ln()) * exponent).exp()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Whether two numbers agree to 2^-100.
    fn same(a: DoubleDouble, b: DoubleDouble) -> bool {
        (a - b).abs() <= b.abs() * DoubleDouble::of(2f64.powi(-100))
    }

    #[test]
    fn functions_have_100_bits() {
        for x in [0.3, -0.9, 1e-9, 0.999_999_9, -1.0 / 3.0] {
            let x = DoubleDouble::of(x);
            let root = x.cbrt();
            assert!(same(root * root * root, x), "cube root of {x:?}");
            let off = (x.acos().cos() - x).abs();
            assert!(off < DoubleDouble::of(2f64.powi(-100)), "arc cosine of {x:?}");
            let square = x.abs().sqrt();
            assert!(same(square * square, x.abs()), "square root of {x:?}");
            assert!(same(DoubleDouble::of(1.0) / x * x, DoubleDouble::of(1.0)));
        }
        // By 50 digits.
        let cos = DoubleDouble(Quad(0.936_752_127_533_144_7, 4.637_088_260_214_747e-17));
        let million = DoubleDouble::of(1e6);
        assert!(
            (million.cos() - cos).abs() < DoubleDouble::of(1e-25),
            "{:?}",
            million.cos()
        );
        // tan -x = -tan x, and tan² + 1 = 1 / cos².
        for x in [0.7, 2.5, -4.0] {
            let x = DoubleDouble::of(x);
            let (cos, tan) = (x.cos(), x.tan());
            let one = DoubleDouble::of(1.0);
            assert!(same(tan * tan + one, one / (cos * cos)), "tangent of {x:?}");
            assert_eq!((-x).tan(), -tan);
            assert_eq!(tan.to_f64().signum(), x.to_f64().tan().signum());
        }
        let e = DoubleDouble(Quad(std::f64::consts::E, 1.445_646_891_729_250_2e-16));
        assert!(
            same(DoubleDouble::of(1.0).exp(), e),
            "{:?}",
            DoubleDouble::of(1.0).exp()
        );
        let root = DoubleDouble::of(3.0).powf(DoubleDouble::of(0.5));
        assert!(same(root * root, DoubleDouble::of(3.0)), "{root:?}");
    }

    #[test]
    fn infinities_are_those_of_doubles() {
        let of = DoubleDouble::of;
        assert_eq!((of(-1.0) / of(0.0)).to_f64(), f64::NEG_INFINITY);
        assert_eq!((of(1e200) * of(1e200)).to_f64(), f64::INFINITY);
        assert!((of(0.0) / of(0.0)).to_f64().is_nan());
        assert!(of(1.0) > of(f64::NEG_INFINITY) && of(1.0) < of(f64::INFINITY));
    }
}
