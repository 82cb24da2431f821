//! Intervals of arbitrary-precision numbers with outward rounding: the exact result always lies
//! inside.
//!
//! Moore, Kearfott, Cloud, *Introduction to Interval Analysis* (2009), ch. 2. The bounds are
//! `dashu-float` numbers: binary, of any precision, with each operation correctly rounded down or
//! up. An exact result stays a single point. So with enough bits the sign of any polynomial in
//! doubles is known, including zero.

use dashu_float::round::mode::{Down, Up};
use dashu_float::{Context, FBig, FpResult, Repr};
use std::cmp::Ordering;
use std::fmt;
use std::ops::{Add, Mul, Neg, Sub};

/// An interval counts as decided if its relative width is at most two to the power of minus this:
/// 1/256 of a unit in the last place of a double.
const NARROW: isize = 60;

/// The precision does not suffice to decide; the caller retries with more bits.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Undecided;

/// A decided value, or [`Undecided`].
pub(crate) type Decided<T> = Result<T, Undecided>;

/// All numbers from `low` to `high`, both finite.
#[derive(Clone)]
pub struct Interval {
    low: Repr<2>,
    high: Repr<2>,
    /// Precision of results, in bits.
    bits: usize,
}

fn value<R: dashu_float::round::Round>(result: FpResult<FBig<R, 2>>) -> Repr<2> {
    // The exponents have 64 bits, and no operation here divides by zero.
    let rounded = result.expect("numbers of scenes do not overflow");
    rounded.value().into_repr()
}

/// -1, 0 or 1.
fn sign(x: &Repr<2>) -> i32 {
    match x.significand().is_zero() {
        true => 0,
        false if *x < Repr::zero() => -1,
        false => 1,
    }
}

impl Interval {
    /// Exactly this finite number. Results computed from it have a precision of `bits` bits.
    pub(crate) fn new(x: f64, bits: usize) -> Self {
        let x = Repr::try_from(x).expect("scenes and rays hold finite numbers");
        Self::point(x, bits)
    }

    fn point(x: Repr<2>, bits: usize) -> Self {
        Self {
            low: x.clone(),
            high: x,
            bits,
        }
    }

    /// A number with the precision of this interval.
    pub(crate) fn like(&self, x: f64) -> Self {
        Self::new(x, self.bits)
    }

    /// Precision of results computed from it, in bits.
    pub(crate) fn bits(&self) -> usize {
        self.bits
    }

    fn down(&self) -> Context<Down> {
        Context::new(self.bits)
    }

    fn up(&self) -> Context<Up> {
        Context::new(self.bits)
    }

    fn is_point(&self) -> bool {
        self.low == self.high
    }

    /// The interval from `down` of the endpoints `least` to `up` of the endpoints `greatest`. It is
    /// a single point if all endpoints are and the result is exact.
    fn ends(
        &self,
        least: [&Repr<2>; 2],
        greatest: [&Repr<2>; 2],
        down: impl Fn(&Repr<2>, &Repr<2>) -> Repr<2>,
        up: impl Fn(&Repr<2>, &Repr<2>) -> Repr<2>,
    ) -> Self {
        Self {
            low: down(least[0], least[1]),
            high: up(greatest[0], greatest[1]),
            bits: self.bits,
        }
    }

    /// Whether all of it is less than, equal to or greater than zero.
    pub(crate) fn sign(&self) -> Decided<Ordering> {
        match (sign(&self.low), sign(&self.high)) {
            (1, _) => Ok(Ordering::Greater),
            (_, -1) => Ok(Ordering::Less),
            (0, 0) => Ok(Ordering::Equal),
            _ => Err(Undecided),
        }
    }

    pub(crate) fn compare(&self, other: &Self) -> Decided<Ordering> {
        if self.high < other.low {
            Ok(Ordering::Less)
        } else if self.low > other.high {
            Ok(Ordering::Greater)
        } else if self.is_point() && other.is_point() {
            Ok(Ordering::Equal)
        } else {
            Err(Undecided)
        }
    }

    pub(crate) fn is_positive(&self) -> Decided<bool> {
        Ok(self.sign()? == Ordering::Greater)
    }

    /// Whether all of it is at most zero.
    pub(crate) fn is_at_most_zero(&self) -> Decided<bool> {
        Ok(self.sign()? != Ordering::Greater)
    }

    /// Whether it contains zero.
    pub(crate) fn has_zero(&self) -> bool {
        sign(&self.low) <= 0 && sign(&self.high) >= 0
    }

    /// The quotient. Undecided if the divisor may be zero.
    pub(crate) fn over(&self, divisor: &Self) -> Decided<Self> {
        if divisor.has_zero() {
            return Err(Undecided);
        }
        let (a, b) = (self, divisor);
        let positive = sign(&b.low) > 0;
        let (small, large) = if positive {
            (&a.low, &a.high)
        } else {
            (&a.high, &a.low)
        };
        let least = if sign(small) >= 0 { &b.high } else { &b.low };
        let greatest = if sign(large) >= 0 { &b.low } else { &b.high };
        Ok(self.ends(
            [small, least],
            [large, greatest],
            |x, y| value(self.down().div(x, y)),
            |x, y| value(self.up().div(x, y)),
        ))
    }

    /// The square root. Undecided if the number may be negative.
    pub(crate) fn sqrt(&self) -> Decided<Self> {
        if sign(&self.low) < 0 {
            return Err(Undecided);
        }
        Ok(Self {
            low: value(self.down().sqrt(&self.low)),
            high: value(self.up().sqrt(&self.high)),
            bits: self.bits,
        })
    }

    pub(crate) fn squared(&self) -> Self {
        if self.has_zero() && !self.is_point() {
            let [low, high] = [&self.low, &self.high].map(|x| value(self.up().sqr(x)));
            return Self {
                low: Repr::zero(),
                high: low.max(high),
                bits: self.bits,
            };
        }
        self * self
    }

    pub(crate) fn abs(&self) -> Self {
        match (sign(&self.low), sign(&self.high)) {
            (low, _) if low >= 0 => self.clone(),
            (_, high) if high <= 0 => -self,
            _ => Self {
                low: Repr::zero(),
                high: self.high.clone().max(-self.low.clone()),
                bits: self.bits,
            },
        }
    }

    /// Encloses the minimum of a number in `self` and one in `other`.
    pub(crate) fn min(&self, other: &Self) -> Self {
        Self {
            low: self.low.clone().min(other.low.clone()),
            high: self.high.clone().min(other.high.clone()),
            bits: self.bits,
        }
    }

    pub(crate) fn max(&self, other: &Self) -> Self {
        -((-self).min(&-other))
    }

    /// The smallest interval that contains both.
    pub(crate) fn hull(&self, other: &Self) -> Self {
        Self {
            low: self.low.clone().min(other.low.clone()),
            high: self.high.clone().max(other.high.clone()),
            bits: self.bits,
        }
    }

    /// The intersection; `None` if it is empty.
    pub(crate) fn common(&self, other: &Self) -> Option<Self> {
        let low = self.low.clone().max(other.low.clone());
        let high = self.high.clone().min(other.high.clone());
        (low <= high).then_some(Self {
            low,
            high,
            bits: self.bits,
        })
    }

    /// The lower endpoint as a single point.
    pub(crate) fn from(&self) -> Self {
        Self::point(self.low.clone(), self.bits)
    }

    pub(crate) fn to(&self) -> Self {
        Self::point(self.high.clone(), self.bits)
    }

    /// A point inside the interval: `at` = 0 is the lower endpoint, 1 the upper one.
    pub(crate) fn within(&self, at: f64) -> Self {
        let there = self.from() + (self.to() - self.from()) * self.like(at);
        there.from()
    }

    pub(crate) fn width(&self) -> Self {
        (self.to() - self.from()).to()
    }

    /// Whether its relative width is below the limit of `NARROW`.
    pub(crate) fn is_narrow(&self) -> bool {
        self.is_point() || {
            let scale = Repr::new(1.into(), NARROW);
            let width = value(self.up().mul(&self.width().high, &scale));
            width <= self.abs().low
        }
    }

    /// The double nearest to the midpoint.
    pub fn nearest(&self) -> f64 {
        self.within(0.5).low.to_f64().value()
    }

    /// The lower endpoint, rounded down to a double.
    pub fn below(&self) -> f64 {
        FBig::<Down, 2>::from_repr(self.low.clone(), Context::new(0))
            .to_f64()
            .value()
    }

    /// The upper endpoint, rounded up to a double.
    pub fn above(&self) -> f64 {
        FBig::<Up, 2>::from_repr(self.high.clone(), Context::new(0))
            .to_f64()
            .value()
    }

    /// The largest distance between `x` and a number in the interval, rounded up to a double.
    pub fn farthest(&self, x: f64) -> f64 {
        (self - &self.like(x)).abs().above()
    }
}

impl Neg for &Interval {
    type Output = Interval;
    fn neg(self) -> Interval {
        Interval {
            low: -self.high.clone(),
            high: -self.low.clone(),
            bits: self.bits,
        }
    }
}

impl Neg for Interval {
    type Output = Self;
    fn neg(self) -> Self {
        -&self
    }
}

impl Add for &Interval {
    type Output = Interval;
    fn add(self, other: Self) -> Interval {
        self.ends(
            [&self.low, &other.low],
            [&self.high, &other.high],
            |x, y| value(self.down().add(x, y)),
            |x, y| value(self.up().add(x, y)),
        )
    }
}

impl Sub for &Interval {
    type Output = Interval;
    fn sub(self, other: Self) -> Interval {
        self.ends(
            [&self.low, &other.high],
            [&self.high, &other.low],
            |x, y| value(self.down().sub(x, y)),
            |x, y| value(self.up().sub(x, y)),
        )
    }
}

impl Mul for &Interval {
    type Output = Interval;
    fn mul(self, other: Self) -> Interval {
        let (a, b) = (self, other);
        let down = |x: &Repr<2>, y: &Repr<2>| value(self.down().mul(x, y));
        let up = |x: &Repr<2>, y: &Repr<2>| value(self.up().mul(x, y));
        let positive = |x: &Interval| sign(&x.low) >= 0;
        let negative = |x: &Interval| sign(&x.high) <= 0;
        let (least, greatest) = match () {
            () if positive(a) && positive(b) => ([&a.low, &b.low], [&a.high, &b.high]),
            () if negative(a) && negative(b) => ([&a.high, &b.high], [&a.low, &b.low]),
            () if positive(a) && negative(b) => ([&a.high, &b.low], [&a.low, &b.high]),
            () if negative(a) && positive(b) => ([&a.low, &b.high], [&a.high, &b.low]),
            () if positive(a) => ([&a.high, &b.low], [&a.high, &b.high]),
            () if negative(a) => ([&a.low, &b.high], [&a.low, &b.low]),
            () if positive(b) => ([&a.low, &b.high], [&a.high, &b.high]),
            () if negative(b) => ([&a.high, &b.low], [&a.low, &b.low]),
            // Both contain zero in their interior.
            () => {
                return Interval {
                    low: down(&a.low, &b.high).min(down(&a.high, &b.low)),
                    high: up(&a.low, &b.low).max(up(&a.high, &b.high)),
                    bits: self.bits,
                };
            }
        };
        self.ends(least, greatest, down, up)
    }
}

/// The same operators for values instead of references, to keep formulas readable.
macro_rules! by_value {
    ($($operation:ident $method:ident),*) => { $(
        impl $operation for Interval {
            type Output = Interval;
            fn $method(self, other: Self) -> Interval {
                (&self).$method(&other)
            }
        }
        impl $operation<&Interval> for Interval {
            type Output = Interval;
            fn $method(self, other: &Self) -> Interval {
                (&self).$method(other)
            }
        }
        impl $operation<Interval> for &Interval {
            type Output = Interval;
            fn $method(self, other: Interval) -> Interval {
                self.$method(&other)
            }
        }
    )* };
}

by_value!(Add add, Sub sub, Mul mul);

impl fmt::Debug for Interval {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "[{:?}, {:?}]", self.below(), self.above())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn between(low: f64, high: f64) -> Interval {
        Interval::new(low, 128).hull(&Interval::new(high, 128))
    }

    /// Checks every combination of endpoint signs against the products of all pairs of endpoints.
    #[test]
    fn products_and_quotients_are_those_of_the_ends() {
        let ends = [-3.0, -2.0, 0.0, 4.0, 5.0];
        let all = || {
            ends.iter()
                .flat_map(|a| ends.iter().map(|b| (*a, *b)))
                .filter(|(a, b)| a <= b)
        };
        for (a, b) in all() {
            for (c, d) in all() {
                let extremes = |values: [f64; 4]| {
                    (
                        values.into_iter().fold(f64::INFINITY, f64::min),
                        values.into_iter().fold(-f64::INFINITY, f64::max),
                    )
                };
                let product = between(a, b) * between(c, d);
                let expected = extremes([a * c, a * d, b * c, b * d]);
                assert_eq!(
                    (product.below(), product.above()),
                    expected,
                    "[{a}, {b}] [{c}, {d}]"
                );
                match between(a, b).over(&between(c, d)) {
                    Err(Undecided) => assert!(c <= 0.0 && d >= 0.0),
                    Ok(quotient) => {
                        let expected = extremes([a / c, a / d, b / c, b / d]);
                        assert!((quotient.nearest() - 0.5 * (expected.0 + expected.1)).abs() < 1e-15);
                        assert!(quotient.below() <= expected.0 && quotient.above() >= expected.1);
                    }
                }
            }
        }
    }

    #[test]
    fn rounding_is_outward_and_what_is_exact_is_a_point() {
        let third = between(1.0, 1.0).over(&between(3.0, 3.0)).unwrap();
        assert_eq!(
            (&third * third.like(3.0) - third.like(1.0)).sign(),
            Err(Undecided)
        );
        assert!(third.below() < third.above() && third.is_narrow());
        let half = between(1.0, 1.0).over(&between(2.0, 2.0)).unwrap();
        assert_eq!((&half + &half - half.like(1.0)).sign(), Ok(Ordering::Equal));
        assert_eq!(
            between(4.0, 9.0).sqrt().map(|root| (root.below(), root.above())),
            Ok((2.0, 3.0))
        );
        assert_eq!(between(-1.0, 1.0).squared().below(), 0.0);
        assert_eq!(
            Interval::new(1e300, 128)
                .hull(&Interval::new(-1e-300, 128))
                .sign(),
            Err(Undecided)
        );
    }
}
