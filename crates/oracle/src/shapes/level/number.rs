//! Interval numbers, either of doubles, which is fast, or of arbitrary precision.

use crate::interval::Interval;
use std::cmp::Ordering;
use std::collections::BTreeMap;
use std::sync::{Mutex, PoisonError};

/// An interval number.
pub(crate) trait Number: Clone {
    /// Exactly this number, in the same type and precision.
    fn like(&self, x: f64) -> Self;
    fn plus(&self, other: &Self) -> Self;
    fn times(&self, other: &Self) -> Self;
    fn negated(&self) -> Self;
    fn squared(&self) -> Self;
    fn abs(&self) -> Self;
    fn min(&self, other: &Self) -> Self;
    fn hull(&self, other: &Self) -> Self;
    /// The quotient; `None` if the divisor may be zero.
    fn divided(&self, other: &Self) -> Option<Self>;
    /// The square root of the non-negative part.
    fn root(&self) -> Self;
    fn has_zero(&self) -> bool;
    /// Whether all of it is greater than zero.
    fn is_above(&self) -> bool;
    /// The endpoints, rounded outward to doubles.
    fn ends(&self) -> [f64; 2];
    /// The cosine and the sine of an angle in degrees.
    fn turn(&self) -> [Self; 2];
    /// The angle in radians of an angle in degrees.
    fn radians(&self) -> Self;
}

/// An interval of doubles with outward rounding.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Fast([f64; 2]);

impl Fast {
    pub(crate) fn new(low: f64, high: f64) -> Self {
        Self([low, high])
    }

    pub(crate) fn of(exact: &Interval) -> Self {
        Self([exact.below(), exact.above()])
    }

    /// Widens both endpoints to the next double: each operation is accurate to half a unit in the
    /// last place.
    fn wider(low: f64, high: f64) -> Self {
        // After an overflow it may be any number.
        match low.is_nan() || high.is_nan() {
            true => Self([f64::NEG_INFINITY, f64::INFINITY]),
            false => Self([low.next_down(), high.next_up()]),
        }
    }
}

impl Number for Fast {
    fn like(&self, x: f64) -> Self {
        Self([x; 2])
    }

    fn plus(&self, other: &Self) -> Self {
        Self::wider(self.0[0] + other.0[0], self.0[1] + other.0[1])
    }

    fn times(&self, other: &Self) -> Self {
        let [a, b] = self.0;
        let [c, d] = other.0;
        let all = [a * c, a * d, b * c, b * d];
        if all.into_iter().any(f64::is_nan) {
            return Self::wider(f64::NAN, f64::NAN);
        }
        Self::wider(
            all.into_iter().fold(f64::INFINITY, f64::min),
            all.into_iter().fold(f64::NEG_INFINITY, f64::max),
        )
    }

    fn negated(&self) -> Self {
        Self([-self.0[1], -self.0[0]])
    }

    fn squared(&self) -> Self {
        let [low, high] = Self::abs(self).0;
        Self([(low * low).next_down().max(0.0), (high * high).next_up()])
    }

    fn abs(&self) -> Self {
        let [low, high] = self.0;
        if low >= 0.0 {
            *self
        } else if high <= 0.0 {
            self.negated()
        } else {
            Self([0.0, high.max(-low)])
        }
    }

    fn min(&self, other: &Self) -> Self {
        Self([self.0[0].min(other.0[0]), self.0[1].min(other.0[1])])
    }

    fn hull(&self, other: &Self) -> Self {
        Self([self.0[0].min(other.0[0]), self.0[1].max(other.0[1])])
    }

    fn divided(&self, other: &Self) -> Option<Self> {
        let [c, d] = other.0;
        (!other.has_zero()).then(|| {
            let inverse = Self::wider(1.0 / d, 1.0 / c);
            self.times(&inverse)
        })
    }

    fn root(&self) -> Self {
        let [low, high] = self.0.map(|x| x.max(0.0).sqrt());
        Self([low.next_down().max(0.0), high.next_up()])
    }

    fn has_zero(&self) -> bool {
        self.0[0] <= 0.0 && self.0[1] >= 0.0
    }

    fn is_above(&self) -> bool {
        self.0[0] > 0.0
    }

    fn ends(&self) -> [f64; 2] {
        self.0
    }

    fn turn(&self) -> [Self; 2] {
        let middle = 0.5 * (self.0[0] + self.0[1]);
        // The library functions and the conversion are accurate to a few units in the last place of
        // the largest number.
        let far = (0.5 * (self.0[1] - self.0[0])).to_radians() + 1e-15 * (1.0 + middle.abs().to_radians());
        let (sin, cos) = middle.to_radians().sin_cos();
        [cos, sin].map(|x| Self([(x - far).max(-1.0), (x + far).min(1.0)]))
    }

    fn radians(&self) -> Self {
        let pi = Self::wider(std::f64::consts::PI, std::f64::consts::PI);
        self.times(&pi).divided(&self.like(180.0)).unwrap_or(*self)
    }
}

impl Number for Interval {
    fn like(&self, x: f64) -> Self {
        Self::like(self, x)
    }

    fn plus(&self, other: &Self) -> Self {
        self + other
    }

    fn times(&self, other: &Self) -> Self {
        self * other
    }

    fn negated(&self) -> Self {
        -self
    }

    fn squared(&self) -> Self {
        Self::squared(self)
    }

    fn abs(&self) -> Self {
        Self::abs(self)
    }

    fn min(&self, other: &Self) -> Self {
        Self::min(self, other)
    }

    fn hull(&self, other: &Self) -> Self {
        Self::hull(self, other)
    }

    fn divided(&self, other: &Self) -> Option<Self> {
        self.over(other).ok()
    }

    fn root(&self) -> Self {
        let positive = Self::max(self, &Self::like(self, 0.0));
        positive.sqrt().unwrap_or(positive)
    }

    fn has_zero(&self) -> bool {
        Self::has_zero(self)
    }

    fn is_above(&self) -> bool {
        self.sign() == Ok(Ordering::Greater)
    }

    fn ends(&self) -> [f64; 2] {
        [self.below(), self.above()]
    }

    fn turn(&self) -> [Self; 2] {
        let middle = self.within(0.5);
        let far = (self - &middle).abs().to().radians().to();
        let around = far.clone().hull(&-&far);
        let one = Self::like(self, 1.0);
        let most = one.hull(&-&one);
        circle(&middle.radians()).map(|x| {
            let wide = x + around.clone();
            wide.common(&most).unwrap_or(most.clone())
        })
    }

    fn radians(&self) -> Self {
        let part = self * &pi(self);
        part.over(&Self::like(self, 180.0)).unwrap_or(part)
    }
}

/// Pi by Machin's formula: 16 atan(1/5) - 4 atan(1/239).
fn pi(like: &Interval) -> Interval {
    static KNOWN: Mutex<BTreeMap<usize, Interval>> = Mutex::new(BTreeMap::new());
    let bits = like.bits();
    let known = KNOWN
        .lock()
        .unwrap_or_else(PoisonError::into_inner)
        .get(&bits)
        .cloned();
    known.unwrap_or_else(|| {
        let found = like.like(16.0) * arc_cotangent(&like.like(5.0))
            - like.like(4.0) * arc_cotangent(&like.like(239.0));
        let mut all = KNOWN.lock().unwrap_or_else(PoisonError::into_inner);
        all.insert(bits, found.clone());
        found
    })
}

/// atan(1/n) by its series; the truncation error is less than the last term.
fn arc_cotangent(n: &Interval) -> Interval {
    let one = n.like(1.0);
    let over = |a: &Interval, b: &Interval| a.over(b).unwrap_or_else(|_| one.clone());
    let square = n * n;
    let mut power = over(&one, n);
    let mut sum = power.clone();
    for k in 1..=n.bits() {
        power = -over(&power, &square);
        let term = over(&power, &n.like((2 * k + 1) as f64));
        sum = sum + term.clone();
        if term.abs().above() < (-(n.bits() as f64) - 8.0).exp2() {
            let left = term.abs().to();
            return sum + left.hull(&-&left);
        }
    }
    sum
}

/// Cosine and sine of a narrow interval: the series at a fraction of the angle, then repeated angle
/// doubling.
fn circle(angle: &Interval) -> [Interval; 2] {
    let mut halvings = 0;
    let mut x = angle.clone();
    while x.abs().above() > 0.25 {
        x = x * angle.like(0.5);
        halvings += 1;
    }
    let square = &x * &x;
    let [mut cos, mut sin] = [angle.like(1.0), x.clone()];
    let [mut even, mut odd] = [angle.like(1.0), x];
    let least = (-(angle.bits() as f64) - 8.0).exp2();
    for k in 1..=angle.bits() {
        let k = 2.0 * k as f64;
        let next = |term: &Interval, a: f64, b: f64| {
            let product = -(term * &square);
            product.over(&angle.like(a * b)).unwrap_or(product)
        };
        even = next(&even, k - 1.0, k);
        odd = next(&odd, k, k + 1.0);
        cos = cos + even.clone();
        sin = sin + odd.clone();
        if even.abs().above() < least {
            // Each remaining term is less than half of the one before.
            let left = even.abs().to();
            let left = left.hull(&-&left);
            cos = cos + left.clone();
            sin = sin + left;
            break;
        }
    }
    for _ in 0..halvings {
        let double = angle.like(2.0) * (&cos * &sin);
        cos = angle.like(1.0) - angle.like(2.0) * Interval::squared(&sin);
        sin = double;
    }
    [cos, sin]
}
