//! Number types for evaluating functions: plain numbers, intervals, and dual numbers over either.
//!
//! A function is written once, generic over [`Number`]. With [`Enclosure`] it returns bounds of its
//! values over a range of arguments (Moore, *Interval Analysis*, 1966); with [`Dual`] it also
//! returns its derivatives (forward-mode differentiation; Griewank and Walther, *Evaluating
//! Derivatives*, 2008, ch. 3). Every interval operation rounds outward, so the interval contains
//! the result of the same expression in plain numbers.

use std::ops::{Add, Mul, Neg, Sub};

/// The operations that fields are computed with.
pub(crate) trait Number:
    Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> + Neg<Output = Self>
{
    fn constant(value: f64) -> Self;
    fn square(self) -> Self;
    /// The square root of a number that is negative by rounding at most.
    fn root(self) -> Self;
    fn magnitude(self) -> Self;
    fn least(self, other: Self) -> Self;
    fn sine_cosine(self) -> (Self, Self);

    fn greatest(self, other: Self) -> Self {
        -(-self).least(-other)
    }

    fn times(self, factor: f64) -> Self {
        self * Self::constant(factor)
    }

    fn plus(self, term: f64) -> Self {
        self + Self::constant(term)
    }
}

/// A [`Number`] over which dual numbers can be built.
pub(crate) trait Scalar: Number {
    /// The reciprocal of a number that may be 0, where any slope is allowed.
    fn reciprocal(self) -> Self;
    /// The smallest interval that contains both; the first one for plain numbers, whose comparisons
    /// are certain.
    fn hull(self, other: Self) -> Self;
    /// Whether it is below the other, if that is certain.
    fn below(self, other: Self) -> Option<bool>;
}

impl Number for f64 {
    #[inline]
    fn constant(value: f64) -> Self {
        value
    }
    #[inline]
    fn square(self) -> Self {
        self * self
    }
    #[inline]
    fn root(self) -> Self {
        self.max(0.0).sqrt()
    }
    #[inline]
    fn magnitude(self) -> Self {
        self.abs()
    }
    #[inline]
    fn least(self, other: Self) -> Self {
        self.min(other)
    }
    #[inline]
    fn sine_cosine(self) -> (Self, Self) {
        libm::sincos(self)
    }
}

impl Scalar for f64 {
    #[inline]
    fn reciprocal(self) -> Self {
        // The tip of a cone: the slope is arbitrarily set to 0.
        if self == 0.0 { 0.0 } else { 1.0 / self }
    }
    #[inline]
    fn hull(self, _: Self) -> Self {
        self
    }
    #[inline]
    fn below(self, other: Self) -> Option<bool> {
        // Plain comparisons are certain; of equal numbers, the first counts as below.
        Some(self <= other)
    }
}

/// All numbers from `lo` to `hi`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Enclosure {
    pub lo: f64,
    pub hi: f64,
}

impl Enclosure {
    pub(crate) const fn new(lo: f64, hi: f64) -> Self {
        Self { lo, hi }
    }

    /// Widens an interval by one ulp on each side: the error of one rounding.
    #[inline]
    fn outward(lo: f64, hi: f64) -> Self {
        Self {
            lo: lo.next_down(),
            hi: hi.next_up(),
        }
    }

    /// The largest absolute value.
    pub(crate) fn reach(self) -> f64 {
        self.lo.abs().max(self.hi.abs())
    }

    /// Whether the interval contains 0.
    pub(crate) fn has_zero(self) -> bool {
        self.lo <= 0.0 && self.hi >= 0.0
    }

    pub(crate) fn union(self, other: Self) -> Self {
        Self::new(self.lo.min(other.lo), self.hi.max(other.hi))
    }

    /// The common part; empty (`lo > hi`) if there is none.
    pub(crate) fn intersection(self, other: Self) -> Self {
        Self::new(self.lo.max(other.lo), self.hi.min(other.hi))
    }
}

impl Add for Enclosure {
    type Output = Self;
    #[inline]
    fn add(self, other: Self) -> Self {
        Self::outward(self.lo + other.lo, self.hi + other.hi)
    }
}

impl Sub for Enclosure {
    type Output = Self;
    #[inline]
    fn sub(self, other: Self) -> Self {
        Self::outward(self.lo - other.hi, self.hi - other.lo)
    }
}

impl Neg for Enclosure {
    type Output = Self;
    #[inline]
    fn neg(self) -> Self {
        Self::new(-self.hi, -self.lo)
    }
}

impl Mul for Enclosure {
    type Output = Self;
    #[inline]
    fn mul(self, other: Self) -> Self {
        // Infinite ends stand for large finite numbers, so 0 times infinity is 0.
        let product = |a: f64, b: f64| if a == 0.0 || b == 0.0 { 0.0 } else { a * b };
        let [a, b] = [product(self.lo, other.lo), product(self.lo, other.hi)];
        let [c, d] = [product(self.hi, other.lo), product(self.hi, other.hi)];
        Self::outward(a.min(b).min(c.min(d)), a.max(b).max(c.max(d)))
    }
}

impl Number for Enclosure {
    #[inline]
    fn constant(value: f64) -> Self {
        Self::new(value, value)
    }
    #[inline]
    fn square(self) -> Self {
        let Self { lo, hi } = self.magnitude();
        Self::new((lo * lo).next_down().max(0.0), (hi * hi).next_up())
    }
    #[inline]
    fn root(self) -> Self {
        let (lo, hi) = (self.lo.max(0.0).sqrt(), self.hi.max(0.0).sqrt());
        Self::new(lo.next_down().max(0.0), hi.next_up())
    }
    #[inline]
    fn magnitude(self) -> Self {
        if self.lo >= 0.0 {
            self
        } else if self.hi <= 0.0 {
            -self
        } else {
            Self::new(0.0, self.reach())
        }
    }
    #[inline]
    fn least(self, other: Self) -> Self {
        Self::new(self.lo.min(other.lo), self.hi.min(other.hi))
    }
    fn sine_cosine(self) -> (Self, Self) {
        // Neither function changes faster than its argument; the library functions are accurate to
        // a few roundings.
        let middle = 0.5 * (self.lo + self.hi);
        let reach = (middle - self.lo).max(self.hi - middle) * (1.0 + 4.0 * f64::EPSILON)
            + 4.0 * f64::EPSILON * (1.0 + middle.abs());
        let around = |value: f64| Self::new((value - reach).max(-1.0), (value + reach).min(1.0));
        if reach.is_nan() || reach >= 2.0 {
            return (Self::new(-1.0, 1.0), Self::new(-1.0, 1.0));
        }
        let (sine, cosine) = libm::sincos(middle);
        (around(sine), around(cosine))
    }
}

impl Scalar for Enclosure {
    #[inline]
    fn reciprocal(self) -> Self {
        if self.lo > 0.0 || self.hi < 0.0 {
            Self::outward(1.0 / self.hi, 1.0 / self.lo)
        } else {
            Self::new(f64::NEG_INFINITY, f64::INFINITY)
        }
    }
    #[inline]
    fn hull(self, other: Self) -> Self {
        self.union(other)
    }
    #[inline]
    fn below(self, other: Self) -> Option<bool> {
        if self.hi < other.lo {
            Some(true)
        } else if other.hi < self.lo {
            Some(false)
        } else {
            None
        }
    }
}

/// A value with its derivatives along N directions.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Dual<T, const N: usize> {
    pub value: T,
    pub slopes: [T; N],
}

impl<T: Scalar, const N: usize> Dual<T, N> {
    fn map(self, value: T, slope: T) -> Self {
        let slopes = self.slopes.map(|own| own * slope);
        Self { value, slopes }
    }

    fn join(self, other: Self, value: T, slope: impl Fn(T, T) -> T) -> Self {
        let slopes = std::array::from_fn(|i| slope(self.slopes[i], other.slopes[i]));
        Self { value, slopes }
    }
}

impl<T: Scalar, const N: usize> Add for Dual<T, N> {
    type Output = Self;
    fn add(self, other: Self) -> Self {
        self.join(other, self.value + other.value, |a, b| a + b)
    }
}

impl<T: Scalar, const N: usize> Sub for Dual<T, N> {
    type Output = Self;
    fn sub(self, other: Self) -> Self {
        self.join(other, self.value - other.value, |a, b| a - b)
    }
}

impl<T: Scalar, const N: usize> Neg for Dual<T, N> {
    type Output = Self;
    fn neg(self) -> Self {
        let slopes = self.slopes.map(|slope| -slope);
        Self {
            value: -self.value,
            slopes,
        }
    }
}

impl<T: Scalar, const N: usize> Mul for Dual<T, N> {
    type Output = Self;
    #[expect(
        clippy::suspicious_arithmetic_impl,
        reason = "the slope of a product is a sum"
    )]
    fn mul(self, other: Self) -> Self {
        let (a, b) = (self.value, other.value);
        self.join(other, a * b, |da, db| da * b + a * db)
    }
}

impl<T: Scalar, const N: usize> Number for Dual<T, N> {
    fn constant(value: f64) -> Self {
        Self {
            value: T::constant(value),
            slopes: [T::constant(0.0); N],
        }
    }
    fn square(self) -> Self {
        self.map(self.value.square(), self.value.times(2.0))
    }
    fn root(self) -> Self {
        let root = self.value.root();
        self.map(root, root.times(2.0).reciprocal())
    }
    fn magnitude(self) -> Self {
        match T::constant(0.0).below(self.value) {
            Some(true) => self,
            Some(false) => -self,
            None => Self {
                value: self.value.magnitude(),
                slopes: self.slopes.map(|slope| slope.hull(-slope)),
            },
        }
    }
    fn least(self, other: Self) -> Self {
        match self.value.below(other.value) {
            Some(true) => self,
            Some(false) => other,
            None => self.join(other, self.value.least(other.value), T::hull),
        }
    }
    fn sine_cosine(self) -> (Self, Self) {
        let (sine, cosine) = self.value.sine_cosine();
        (self.map(sine, cosine), self.map(cosine, -sine))
    }
    fn times(self, factor: f64) -> Self {
        let factor = T::constant(factor);
        self.map(self.value * factor, factor)
    }
    fn plus(self, term: f64) -> Self {
        Self {
            value: self.value.plus(term),
            slopes: self.slopes,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use whitstone_testkit::Random;

    /// A function that uses most operations.
    fn function<N: Number>(x: N, y: N) -> N {
        let (sine, cosine) = (x * y).sine_cosine();
        let length = (x.square() + y.square()).root();
        (sine - cosine.times(0.3))
            .least(length.plus(-0.7))
            .greatest(x.magnitude() - y)
    }

    #[test]
    fn ranges_hold_all_values_and_slopes() {
        let mut random = Random::new(11);
        for _ in 0..20_000 {
            let mut range = || {
                let (lo, width) = (2.0 * random.signed(), 10f64.powf(-12.0 * random.unit()));
                Enclosure::new(lo, lo + width)
            };
            let (x, y) = (range(), range());
            let dual = |value, dx: f64, dy: f64| Dual {
                value,
                slopes: [Enclosure::constant(dx), Enclosure::constant(dy)],
            };
            let held = function(dual(x, 1.0, 0.0), dual(y, 0.0, 1.0));
            for _ in 0..8 {
                let mut inside = |e: Enclosure| (e.lo + (e.hi - e.lo) * random.unit()).clamp(e.lo, e.hi);
                let (x, y) = (inside(x), inside(y));
                let point = |value, slopes| Dual { value, slopes };
                let found = function(point(x, [1.0, 0.0]), point(y, [0.0, 1.0]));
                let holds = |e: Enclosure, value: f64| e.lo <= value && value <= e.hi;
                assert!(holds(held.value, found.value), "{held:?} {found:?}");
                assert!(holds(held.value, function(x, y)));
                // Slopes have rounding errors of their own.
                for (held, found) in held.slopes.into_iter().zip(found.slopes) {
                    assert!(
                        held.lo - 1e-12 <= found && found <= held.hi + 1e-12,
                        "{held:?} {found}"
                    );
                }
            }
        }
    }

    #[test]
    fn slopes_are_those_of_differences() {
        let mut random = Random::new(12);
        for _ in 0..2_000 {
            let (x, y) = (2.0 * random.signed(), 2.0 * random.signed());
            let dual = |value, slope| Dual {
                value,
                slopes: [slope],
            };
            let along = function(dual(x, 1.0), dual(y, -2.0));
            let step = 1e-7;
            let (before, after) = (
                function(x - step, y + 2.0 * step),
                function(x + step, y - 2.0 * step),
            );
            let middle = (after + before) / 2.0 - along.value;
            // Not across a crease.
            if middle.abs() < 1e-12 {
                assert!(((after - before) / (2.0 * step) - along.slopes[0]).abs() < 1e-6);
            }
        }
    }

    #[test]
    fn infinite_ends_make_no_nan() {
        let all = Enclosure::new(-1.0, 1.0).reciprocal();
        let product = all * Enclosure::constant(0.0);
        assert!(product.reach() < 1e-300, "{product:?}");
        assert!((all * Enclosure::new(-1.0, 2.0)).reach() == f64::INFINITY);
    }
}
