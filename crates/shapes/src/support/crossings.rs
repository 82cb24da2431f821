//! Finds all sign changes of a function of one variable, in order, by bisection of ranges.
//!
//! Mitchell, *Robust ray intersection with interval arithmetic*, Graphics Interface 1990. A range
//! on which the function keeps its sign is skipped. A range on which its slope keeps its sign is a
//! bracket with at most one root, refined by Newton's method. All other ranges are halved.

use std::ops::ControlFlow;

/// A function of s in [0, 1], negative inside.
pub(crate) trait Along {
    /// Value and slope; the slope only speeds up the search.
    fn at(&self, s: f64) -> (f64, f64);

    /// Classifies the function on the range from `lo` to `hi`.
    fn over(&self, lo: f64, hi: f64) -> RootCount;

    /// Number of ranges examined at full resolution. After that, ranges not wider than [`COARSE`]
    /// are searched for a single root.
    fn steps(&self) -> u32 {
        STEPS
    }

    /// Called at most once, if [`Self::steps`] are exhausted at s: a crossing further on may be
    /// missed.
    fn limit_reached(&self, s: f64);
}

/// Classification of a function on a range.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum RootCount {
    /// The function keeps its sign.
    Zero,
    /// Its sign changes at most once, or further changes do not matter.
    AtMostOne,
    /// Nothing is known about its roots.
    Unknown,
}

/// A change of sign.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Crossing {
    pub s: f64,
    /// From positive (or zero) to negative.
    pub enters: bool,
}

/// The default of [`Along::steps`].
pub(crate) const STEPS: u32 = 1 << 13;
/// Minimum interval width once [`Along::steps`] are exhausted.
///
/// Without slope bounds (e.g. along a mandelbulb's axis) the subdivision budget is spent in one
/// place. Later intervals as narrow as this are still examined.
const COARSE: f64 = 1.0 / (1u64 << 14) as f64;
/// Maximum number of halvings of one range.
const DEPTH: usize = 46;
/// Ranges not wider than this are searched for a single root.
const NARROWEST: f64 = 1.0 / (1u64 << DEPTH) as f64;
/// Maximum number of steps to a root: every third step halves the bracket, for any slopes, down to
/// its 53 digits.
const REFINEMENTS: u32 = 159;

/// Calls `visit` for every crossing in order, until it breaks; returns the number of ranges
/// examined.
///
/// Crossings alternate. At most [`Along::steps`] + 2^15 + [`DEPTH`] + 1 ranges are examined, and
/// [`REFINEMENTS`] values per crossing.
pub(crate) fn crossings(f: &impl Along, mut visit: impl FnMut(Crossing) -> ControlFlow<()>) -> u32 {
    // Stack of pending ranges: the current one reaches from `lo` to the last end, the next one from
    // there to the previous end, and so on.
    let mut ends = [1.0; DEPTH + 1];
    let (mut last, mut lo, mut steps) = (0, 0.0, 0);
    let mut inside = f.at(lo).0 < 0.0;
    let most = f.steps();
    loop {
        let hi = ends[last];
        steps += 1;
        if steps == most + 1 {
            f.limit_reached(lo);
        }
        let narrowest = if steps > most { COARSE } else { NARROWEST };
        let known = if hi - lo <= narrowest {
            RootCount::AtMostOne
        } else {
            f.over(lo, hi)
        };
        match known {
            RootCount::Zero => {}
            RootCount::Unknown => {
                last += 1;
                ends[last] = 0.5 * (lo + hi);
                continue;
            }
            RootCount::AtMostOne => {
                let then = f.at(hi).0 < 0.0;
                if then != inside {
                    inside = then;
                    let crossing = Crossing {
                        s: refine(f, lo, hi, inside),
                        enters: inside,
                    };
                    if visit(crossing).is_break() {
                        return steps;
                    }
                }
            }
        }
        if last == 0 {
            return steps;
        }
        last -= 1;
        lo = hi;
    }
}

/// The root between `lo` and `hi`, where the sign changes to that of `hi`.
pub(crate) fn refine(f: &impl Along, mut lo: f64, mut hi: f64, hi_is_inside: bool) -> f64 {
    let mut s = 0.5 * (lo + hi);
    for step in 1..=REFINEMENTS {
        let (value, slope) = f.at(s);
        if (value < 0.0) == hi_is_inside {
            hi = s;
        } else {
            lo = s;
        }
        let newton = s - value / slope;
        let middle = 0.5 * (lo + hi);
        // Newton's method may converge slowly, leave the bracket or give NaN.
        let useful = slope.is_finite() && newton >= lo && newton <= hi;
        let next = if step % 3 != 0 && useful { newton } else { middle };
        let done = next == s || middle <= lo || middle >= hi;
        s = next;
        if done {
            break;
        }
    }
    s
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::support::enclosure::{Dual, Enclosure, Number};
    use whitstone_testkit::Random;

    /// Maximum number of ranges: after [`STEPS`], all coarse ranges in [0, 1] and the ranges that
    /// contain them.
    const MAX_STEPS: u32 = STEPS + (1 << 15) + DEPTH as u32 + 1;

    /// The product of (s - root) over all roots.
    struct Polynomial(Vec<f64>);

    impl Polynomial {
        fn eval<N: Number>(&self, s: N) -> N {
            let factors = self.0.iter().map(|root| s.plus(-root));
            factors.fold(N::constant(1.0), |product, factor| product * factor)
        }
    }

    impl Along for Polynomial {
        fn at(&self, s: f64) -> (f64, f64) {
            let found = self.eval(Dual {
                value: s,
                slopes: [1.0],
            });
            (found.value, found.slopes[0])
        }

        fn over(&self, lo: f64, hi: f64) -> RootCount {
            let slopes = [Enclosure::constant(1.0)];
            let found = self.eval(Dual {
                value: Enclosure::new(lo, hi),
                slopes,
            });
            if !found.value.has_zero() {
                RootCount::Zero
            } else if !found.slopes[0].has_zero() {
                RootCount::AtMostOne
            } else {
                RootCount::Unknown
            }
        }

        fn limit_reached(&self, s: f64) {
            assert!(self.0[0] == self.0[1], "{:?} at {s}", self.0);
        }
    }

    fn all(f: &impl Along) -> (Vec<Crossing>, u32) {
        let mut found = Vec::new();
        let steps = crossings(f, |crossing| {
            found.push(crossing);
            ControlFlow::Continue(())
        });
        (found, steps)
    }

    #[test]
    fn all_roots_of_polynomials_are_found_in_order() {
        let mut random = Random::new(3);
        let (mut most, mut missed_by_samples) = (0, 0);
        for case in 0..2_000 {
            let count = 1 + random.below(6);
            let mut roots: Vec<f64> = (0..count).map(|_| random.unit()).collect();
            // Roots that are close together.
            if case % 2 == 0 && count > 1 {
                roots[1] = (roots[0] + 10f64.powf(-8.0 * random.unit())).min(0.999);
            }
            roots.sort_by(f64::total_cmp);
            if roots.windows(2).any(|pair| pair[1] - pair[0] < 1e-9) {
                continue;
            }
            let f = Polynomial(roots.clone());
            let (found, steps) = all(&f);
            assert_eq!(found.len(), count, "{roots:?} {found:?}");
            for (found, root) in found.iter().zip(&roots) {
                // The error of a root is inversely proportional to the slope there.
                let gap = roots.iter().map(|r| (r - root).abs()).filter(|d| *d > 0.0);
                let slope: f64 = gap.product();
                assert!((found.s - root).abs() < 1e-14 / slope, "{found:?} {root}");
            }
            assert!(
                found
                    .windows(2)
                    .all(|pair| pair[0].enters != pair[1].enters && pair[0].s < pair[1].s)
            );
            most = most.max(steps);
            // Shows that the test can fail: a thousand samples miss close pairs.
            let signs: Vec<bool> = (0..=1000).map(|i| f.at(f64::from(i) / 1000.0).0 < 0.0).collect();
            missed_by_samples += usize::from(signs.windows(2).filter(|s| s[0] != s[1]).count() < count);
        }
        assert!(most < 2_000, "{most}");
        assert!(missed_by_samples > 100, "{missed_by_samples}");
    }

    #[test]
    fn roots_that_only_touch_are_no_crossings_and_take_bounded_steps() {
        let (found, steps) = all(&Polynomial(vec![0.3, 0.3]));
        assert_eq!(found, []);
        assert!(steps <= MAX_STEPS);
        // Zero everywhere.
        struct Nothing(std::cell::Cell<u32>);
        impl Along for Nothing {
            fn at(&self, _: f64) -> (f64, f64) {
                (0.0, f64::NAN)
            }
            fn over(&self, _: f64, _: f64) -> RootCount {
                RootCount::Unknown
            }
            fn limit_reached(&self, s: f64) {
                assert!(s < 1e-9, "{s}");
                self.0.set(self.0.get() + 1);
            }
        }
        let nothing = Nothing(std::cell::Cell::new(0));
        let (found, steps) = all(&nothing);
        assert_eq!(nothing.0.get(), 1);
        assert_eq!(found, []);
        assert!(steps <= MAX_STEPS, "{steps}");
    }

    /// A gap after a range that stays unclassified however often it is halved.
    #[test]
    fn what_comes_behind_a_hard_place_is_seen() {
        struct Behind;
        impl Along for Behind {
            fn at(&self, s: f64) -> (f64, f64) {
                (if (0.6..0.601).contains(&s) { 1.0 } else { -1.0 }, f64::NAN)
            }
            fn over(&self, lo: f64, hi: f64) -> RootCount {
                let gap = lo <= 0.601 && hi >= 0.6;
                if lo < 0.3 && hi > 0.2 || gap {
                    RootCount::Unknown
                } else {
                    RootCount::Zero
                }
            }
            fn limit_reached(&self, s: f64) {
                assert!((0.2..0.3).contains(&s), "{s}");
            }
        }
        let (found, steps) = all(&Behind);
        let places: Vec<f64> = found.iter().map(|crossing| crossing.s).collect();
        assert!(steps > STEPS && steps <= MAX_STEPS, "{steps}");
        assert!(places.len() == 2, "{places:?}");
        assert!(
            (places[0] - 0.6).abs() < 1e-12 && (places[1] - 0.601).abs() < 1e-12,
            "{places:?}"
        );
    }

    #[test]
    fn a_bracket_is_closed_whatever_the_slope_says() {
        struct Step(f64);
        impl Along for Step {
            fn at(&self, s: f64) -> (f64, f64) {
                (if s < 0.123 { 1.0 } else { -1.0 }, self.0)
            }
            fn over(&self, _: f64, _: f64) -> RootCount {
                RootCount::AtMostOne
            }
            fn limit_reached(&self, _: f64) {}
        }
        for slope in [0.0, f64::NAN, f64::INFINITY, -1e-300, 3.0, -3.0] {
            let (found, _) = all(&Step(slope));
            assert_eq!(found.len(), 1);
            assert!((found[0].s - 0.123).abs() < 1e-9, "{slope}: {found:?}");
        }
    }
}
