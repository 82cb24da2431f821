//! Real roots of polynomials of any degree.
//!
//! Descartes' rule of signs in the Bernstein basis bounds the number of roots in a piece. Pieces
//! that may hold more than one are bisected (Rouillier and Zimmermann, *Efficient isolation of
//! polynomial's real roots*, 2004, and the references there). The interval form of Newton's method
//! then refines each root (Moore, Kearfott, Cloud 2009, ch. 8).

use crate::interval::{Decided, Interval, Undecided};
use std::cmp::Ordering;

/// Positions to split a piece at: the middle, or a place next to it if the middle may be a root.
const CUTS: [f64; 4] = [0.5, 0.46875, 0.5625, 0.4140625];

/// Coefficients of the powers, the constant first.
#[derive(Clone, Debug)]
pub(crate) struct Polynomial(pub(crate) Vec<Interval>);

impl Polynomial {
    pub(crate) fn at(&self, t: &Interval) -> Interval {
        let mut powers = self.0.iter().rev();
        let first = powers.next().cloned().unwrap_or_else(|| t.like(0.0));
        powers.fold(first, |sum, coefficient| sum * t + coefficient)
    }

    pub(crate) fn derivative(&self) -> Self {
        let terms = self.0.iter().enumerate().skip(1);
        Self(terms.map(|(k, c)| c * c.like(k as f64)).collect())
    }

    pub(crate) fn times(&self, other: &Self) -> Self {
        let zero = self.0[0].like(0.0);
        let mut product = vec![zero; self.0.len() + other.0.len() - 1];
        for (i, a) in self.0.iter().enumerate() {
            for (j, b) in other.0.iter().enumerate() {
                product[i + j] = &product[i + j] + a * b;
            }
        }
        Self(product)
    }

    pub(crate) fn minus(mut self, other: &Self) -> Self {
        for (a, b) in self.0.iter_mut().zip(&other.0) {
            *a = &*a - b;
        }
        self
    }

    /// The roots between `from` and `to`, which must not be roots, in ascending order. Each comes
    /// with a number that has the sign of the derivative there.
    pub(crate) fn roots(&self, from: &Interval, to: &Interval) -> Decided<Vec<(Interval, Interval)>> {
        let mut found = Vec::new();
        let piece = Piece {
            values: self.bernstein(from, to),
            from: from.clone(),
            to: to.clone(),
        };
        let mut waiting = vec![(piece, from.bits())];
        while let Some((piece, depth)) = waiting.pop() {
            match piece.variations() {
                Ok(0) => {}
                Ok(1) => {
                    let [first, .., last] = &piece.values[..] else {
                        return Err(Undecided);
                    };
                    let t = self.refine(piece.from.hull(&piece.to), first.sign()?)?;
                    found.push((t, last.clone()));
                }
                _ if depth == 0 => return Err(Undecided),
                _ => {
                    let [left, right] = piece.cut()?;
                    waiting.push((right, depth - 1));
                    waiting.push((left, depth - 1));
                }
            }
        }
        Ok(found)
    }

    /// The Bernstein coefficients over a piece, all multiplied by the same positive number to avoid
    /// rounded quotients.
    fn bernstein(&self, from: &Interval, to: &Interval) -> Vec<Interval> {
        let n = self.0.len() - 1;
        let width = to - from;
        // The coefficients of p(from + s width) in powers of s: repeated Horner's scheme.
        let mut shifted = self.0.clone();
        for low in 0..n {
            for k in (low..n).rev() {
                shifted[k] = &shifted[k] + &shifted[k + 1] * from;
            }
        }
        let mut scale = from.like(1.0);
        for coefficient in &mut shifted {
            *coefficient = &*coefficient * &scale;
            scale = scale * &width;
        }
        let common = (0..=n as u64)
            .map(|k| binomial(n as u64, k))
            .fold(1, least_common);
        let term = |k: usize, j: usize| {
            let factor = binomial(k as u64, j as u64) * (common / binomial(n as u64, j as u64));
            &shifted[j] * from.like(factor as f64)
        };
        (0..=n)
            .map(|k| (1..=k).fold(term(k, 0), |sum, j| sum + term(k, j)))
            .collect()
    }

    /// Refines the only root in an interval; `below` is the sign at its lower end.
    fn refine(&self, mut t: Interval, below: Ordering) -> Decided<Interval> {
        let derivative = self.derivative();
        // Bisection alone takes one step per bit.
        for _ in 0..2 * t.bits() {
            let before = t.clone();
            let middle = t.within(0.5);
            let value = self.at(&middle);
            if let Ok(step) = value.over(&derivative.at(&t)) {
                // The intersection cannot be empty, because the root lies in both.
                t = t.common(&(&middle - step)).ok_or(Undecided)?;
            } else {
                for cut in CUTS {
                    let middle = t.within(cut);
                    let Ok(sign) = self.at(&middle).sign() else {
                        continue;
                    };
                    t = match sign {
                        Ordering::Equal => return Ok(middle),
                        _ if sign == below => middle.hull(&t.to()),
                        _ => t.from().hull(&middle),
                    };
                    break;
                }
            }
            let (was, is) = (before.width(), t.width());
            // A step that keeps three quarters of the width has reached the limit of this
            // precision.
            let stuck = (&is + &is + &is + &is).compare(&(&was + &was + &was));
            if t.is_narrow() && stuck != Ok(Ordering::Less) || is.compare(&was) == Ok(Ordering::Equal) {
                break;
            }
        }
        Ok(t)
    }
}

fn binomial(n: u64, k: u64) -> u64 {
    (0..k).fold(1, |product, i| product * (n - i) / (i + 1))
}

fn least_common(a: u64, b: u64) -> u64 {
    let (mut x, mut y) = (a, b);
    while y != 0 {
        (x, y) = (y, x % y);
    }
    a / x * b
}

/// A polynomial restricted to a part of the line.
struct Piece {
    values: Vec<Interval>,
    from: Interval,
    to: Interval,
}

impl Piece {
    /// Number of sign changes: the number of roots, or more by an even number.
    fn variations(&self) -> Decided<usize> {
        let mut changes = 0;
        let mut last = Ordering::Equal;
        for value in &self.values {
            let sign = value.sign()?;
            if sign != Ordering::Equal {
                changes += usize::from(last != Ordering::Equal && last != sign);
                last = sign;
            }
        }
        Ok(changes)
    }

    /// Splits the piece by de Casteljau's algorithm, at a point that is no root.
    fn cut(&self) -> Decided<[Self; 2]> {
        for at in CUTS {
            let one = self.from.like(at);
            let rest = self.from.like(1.0 - at);
            let mut row = self.values.clone();
            let (mut left, mut right) = (Vec::new(), Vec::new());
            while let (Some(first), Some(last)) = (row.first(), row.last()) {
                left.push(first.clone());
                right.push(last.clone());
                row = row
                    .windows(2)
                    .map(|pair| &pair[0] * &rest + &pair[1] * &one)
                    .collect();
            }
            right.reverse();
            if matches!(right[0].sign(), Ok(Ordering::Less | Ordering::Greater)) {
                let middle = &self.from + (&self.to - &self.from) * &one;
                return Ok([
                    Self {
                        values: left,
                        from: self.from.clone(),
                        to: middle.clone(),
                    },
                    Self {
                        values: right,
                        from: middle,
                        to: self.to.clone(),
                    },
                ]);
            }
        }
        Err(Undecided)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn roots_with(coefficients: &[f64], bits: usize) -> Decided<Vec<f64>> {
        let number = |x: f64| Interval::new(x, bits);
        let polynomial = Polynomial(coefficients.iter().map(|c| number(*c)).collect());
        let found = polynomial.roots(&number(-1e6), &number(1e6))?;
        let middle = |(t, _): &(Interval, Interval)| {
            assert!(t.is_narrow());
            t.nearest()
        };
        Ok(found.iter().map(middle).collect())
    }

    fn roots(coefficients: &[f64]) -> Decided<Vec<f64>> {
        roots_with(coefficients, 128).or_else(|Undecided| roots_with(coefficients, 256))
    }

    #[test]
    fn roots_of_known_polynomials() {
        // (t - 1)(t - 2)(t - 3)(t - 4), and the same with two of the roots 1e-9 apart.
        assert_eq!(
            roots(&[24.0, -50.0, 35.0, -10.0, 1.0]),
            Ok(vec![1.0, 2.0, 3.0, 4.0])
        );
        assert_eq!(roots(&[-2.0, 0.0, 1.0]), Ok(vec![-(2f64.sqrt()), 2f64.sqrt()]));
        assert_eq!(roots(&[1.0, 0.0, 1.0]), Ok(vec![]));
        // A double or triple root is undecided: the first is no crossing, the second has a zero
        // slope.
        assert_eq!(roots(&[1.0, -2.0, 1.0]), Err(Undecided));
        // 2^60 t² - 2 t + 2^-60 (1 - 2^-40): two roots that the quadratic formula in doubles cannot
        // separate.
        let close = roots(&[(1.0 - 2f64.powi(-40)) * 2f64.powi(-60), -2.0, 2f64.powi(60)]).unwrap();
        let expected = [-1.0, 1.0].map(|side| (1.0 + side * 2f64.powi(-20)) * 2f64.powi(-60));
        assert_eq!(close, expected);
    }
}
