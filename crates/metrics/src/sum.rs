//! Compensated sums, so that a mean over millions of pixels does not depend on their order.

/// Sum of `f64` with a running compensation (Neumaier 1974, *Rundungsfehleranalyse einiger
/// Verfahren zur Summation endlicher Summen*, "improved Kahan-Babuska").
///
/// For terms of one sign the relative error is about 2^-53 whatever their number (below 10^15) and
/// order.
#[derive(Debug, Clone, Copy, Default)]
pub struct Sum {
    sum: f64,
    compensation: f64,
}

impl Sum {
    /// Adds a finite term.
    #[inline]
    pub fn add(&mut self, term: f64) {
        let next = self.sum + term;
        // The lost part is the low part of the smaller number.
        self.compensation += if self.sum.abs() >= term.abs() {
            (self.sum - next) + term
        } else {
            (term - next) + self.sum
        };
        self.sum = next;
    }

    /// Adds the terms of another sum.
    #[inline]
    pub fn merge(&mut self, other: Self) {
        self.add(other.sum);
        self.add(other.compensation);
    }

    /// The sum so far.
    #[must_use]
    pub fn total(&self) -> f64 {
        self.sum + self.compensation
    }
}

impl FromIterator<f64> for Sum {
    fn from_iter<I: IntoIterator<Item = f64>>(terms: I) -> Self {
        let mut sum = Self::default();
        terms.into_iter().for_each(|term| sum.add(term));
        sum
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn small_terms_are_not_lost() {
        let terms = [1.0, 1e100, 1.0, -1e100];
        assert_eq!(terms.iter().sum::<f64>(), 0.0);
        assert_eq!(terms.into_iter().collect::<Sum>().total(), 2.0);
    }

    #[test]
    fn ten_million_tenths() {
        let total = std::iter::repeat_n(0.1, 10_000_000).collect::<Sum>().total();
        assert_eq!(total, 1_000_000.0);
        assert_ne!(std::iter::repeat_n(0.1, 10_000_000).sum::<f64>(), 1_000_000.0);
    }

    proptest! {
        #[test]
        fn parts_do_not_matter(terms in prop::collection::vec(0.0..1e6f64, 1..400), size in 1..50usize) {
            let whole = terms.iter().copied().collect::<Sum>().total();
            let mut sum = Sum::default();
            terms.chunks(size).for_each(|part| sum.merge(part.iter().copied().collect()));
            prop_assert!((whole - sum.total()).abs() <= whole * f64::EPSILON);
        }

        #[test]
        fn order_does_not_matter(mut terms in prop::collection::vec(0.0..1e6f64, 1..400)) {
            let forward = terms.iter().copied().collect::<Sum>().total();
            terms.sort_by(f64::total_cmp);
            let sorted = terms.iter().copied().collect::<Sum>().total();
            let backward = terms.iter().rev().copied().collect::<Sum>().total();
            prop_assert!((forward - sorted).abs() <= forward * f64::EPSILON);
            prop_assert!((forward - backward).abs() <= forward * f64::EPSILON);
        }
    }
}
