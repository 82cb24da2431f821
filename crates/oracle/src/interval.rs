//! Intervals of multi-precision numbers, rounded outward: what is computed lies in them.
//!
//! Moore, Kearfott, Cloud, *Introduction to Interval Analysis* (2009), ch. 2. The numbers are those
//! of `dashu-float`: binary, of any precision, each operation correctly rounded downwards or
//! upwards as asked. What is exact stays a single point, so with enough digits the sign of any
//! polynomial in doubles is known, zero included.

use dashu_float::round::mode::{Down, Up};
use dashu_float::{Context, FBig, FpResult, Repr};
use std::cmp::Ordering;
use std::fmt;
use std::ops::{Add, Mul, Neg, Sub};

/// Two to the power of minus this, relative, is how wide a decided number may be: 1/256 of a unit
/// in the last place of a double.
const NARROW: isize = 60;

/// The digits did not suffice to tell: ask again with more.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Undecided;

/// What is decided, or not yet.
pub(crate) type Decided<T> = Result<T, Undecided>;

/// All numbers from `low` to `high`, both finite.
#[derive(Clone)]
pub struct Interval {
    low: Repr<2>,
    high: Repr<2>,
    /// Bits of results.
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
    /// Exactly this finite number; `bits` is the precision of what is computed from it.
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

    /// A number with the precision of this one.
    pub(crate) fn like(&self, x: f64) -> Self {
        Self::new(x, self.bits)
    }

    /// Bits of what is computed from it.
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

    /// The results for the pairs of ends that give the least and the greatest value; where both
    /// pairs are of single points and the result is exact, it is one.
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

    /// Less than, equal to or greater than zero.
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

    /// At most zero.
    pub(crate) fn is_at_most_zero(&self) -> Decided<bool> {
        Ok(self.sign()? != Ordering::Greater)
    }

    /// Whether zero is in it.
    pub(crate) fn has_zero(&self) -> bool {
        sign(&self.low) <= 0 && sign(&self.high) >= 0
    }

    /// The quotient, by what is certainly not zero.
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

    /// The root of what is certainly not negative.
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

    /// The lesser of a number from this and one from the other.
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

    /// From the lowest to the highest of both.
    pub(crate) fn hull(&self, other: &Self) -> Self {
        Self {
            low: self.low.clone().min(other.low.clone()),
            high: self.high.clone().max(other.high.clone()),
            bits: self.bits,
        }
    }

    /// What both have in common.
    pub(crate) fn common(&self, other: &Self) -> Option<Self> {
        let low = self.low.clone().max(other.low.clone());
        let high = self.high.clone().min(other.high.clone());
        (low <= high).then_some(Self {
            low,
            high,
            bits: self.bits,
        })
    }

    /// The ends as single points.
    pub(crate) fn from(&self) -> Self {
        Self::point(self.low.clone(), self.bits)
    }

    pub(crate) fn to(&self) -> Self {
        Self::point(self.high.clone(), self.bits)
    }

    /// A point between the ends, `at` of the way.
    pub(crate) fn within(&self, at: f64) -> Self {
        let there = self.from() + (self.to() - self.from()) * self.like(at);
        there.from()
    }

    pub(crate) fn width(&self) -> Self {
        (self.to() - self.from()).to()
    }

    /// Whether it is known to a small part of a unit in the last place of a double.
    pub(crate) fn is_narrow(&self) -> bool {
        self.is_point() || {
            let scale = Repr::new(1.into(), NARROW);
            let width = value(self.up().mul(&self.width().high, &scale));
            width <= self.abs().low
        }
    }

    /// The double nearest to its middle.
    pub fn nearest(&self) -> f64 {
        self.within(0.5).low.to_f64().value()
    }

    /// A double that is not above it.
    pub fn below(&self) -> f64 {
        FBig::<Down, 2>::from_repr(self.low.clone(), Context::new(0))
            .to_f64()
            .value()
    }

    /// A double that is not below it.
    pub fn above(&self) -> f64 {
        FBig::<Up, 2>::from_repr(self.high.clone(), Context::new(0))
            .to_f64()
            .value()
    }

    /// The largest distance of a number from this, as a double that is not too small.
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
            // Both hold zero inside.
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

/// The same for values, so that formulas can be read.
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

    /// Every sign that an end can have, against all pairs of ends.
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
