//! Medians, slopes and interpolation on logarithmic axes.

use serde::Serialize;

/// The median of repeated times, with its confidence interval.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Times {
    /// The median in seconds.
    pub median: f64,
    /// 95 % confidence interval of the median in seconds; for fewer than six times their full
    /// range.
    pub interval: [f64; 2],
}

impl Times {
    /// The statistics; `None` without any times.
    pub fn of(times: &[f64]) -> Option<Self> {
        if times.is_empty() || !times.iter().all(|time| time.is_finite()) {
            return None;
        }
        let mut sorted = times.to_vec();
        sorted.sort_by(f64::total_cmp);
        let outside = outside(sorted.len());
        Some(Self {
            median: middle(&sorted),
            interval: [sorted[outside], sorted[sorted.len() - 1 - outside]],
        })
    }

    /// Width of the interval in seconds.
    pub fn spread(&self) -> f64 {
        self.interval[1] - self.interval[0]
    }
}

/// How many of `count` sorted values lie outside of the 95 % confidence interval of the median, on
/// each side.
///
/// The median lies beyond the `k`-th value from either end with the probability that `count` tosses
/// of a fair coin give fewer than `k` heads (Le Boudec, Performance Evaluation of Computer and
/// Communication Systems, 2010, theorem 2.1). This holds for any distribution, but the times must
/// be independent: so they are taken in two sessions.
fn outside(count: usize) -> usize {
    let mut outside = 0;
    let mut term = 0.5_f64.powi(count as i32);
    let mut fewer = term;
    while outside + 1 < count.div_ceil(2) {
        // The probability of `outside + 1` heads.
        term *= (count - outside) as f64 / (outside + 1) as f64;
        if fewer + term > 0.025 {
            break;
        }
        fewer += term;
        outside += 1;
    }
    outside
}

/// The median of at least one sorted value.
fn middle(sorted: &[f64]) -> f64 {
    let [below, above] = [(sorted.len() - 1) / 2, sorted.len() / 2];
    0.5 * (sorted[below] + sorted[above])
}

/// A straight line fitted to points on logarithmic axes.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Slope {
    /// Slope of the least-squares fit.
    pub slope: f64,
    /// 95 % confidence interval of the slope, if the points scatter randomly about a line.
    pub interval: [f64; 2],
}

/// Quantiles of Student's t distribution for 95 %, from one degree of freedom up.
const STUDENT: [f64; 30] = [
    12.706, 4.303, 3.182, 2.776, 2.571, 2.447, 2.365, 2.306, 2.262, 2.228, 2.201, 2.179, 2.160, 2.145, 2.131,
    2.120, 2.110, 2.101, 2.093, 2.086, 2.080, 2.074, 2.069, 2.064, 2.060, 2.056, 2.052, 2.048, 2.045, 2.042,
];

impl Slope {
    /// Fits (x, y), all greater than 0. `None` for fewer than three points, which always lie on a
    /// line, or for a single x.
    pub fn fit(points: &[[f64; 2]]) -> Option<Self> {
        let logs: Vec<[f64; 2]> = points.iter().map(|point| point.map(f64::ln)).collect();
        if logs.len() < 3 || logs.iter().flatten().any(|log| !log.is_finite()) {
            return None;
        }
        let count = logs.len() as f64;
        let mean = [0, 1].map(|axis| logs.iter().map(|log| log[axis]).sum::<f64>() / count);
        let sum = |a: usize, b: usize| -> f64 {
            logs.iter()
                .map(|log| (log[a] - mean[a]) * (log[b] - mean[b]))
                .sum()
        };
        let (xx, xy) = (sum(0, 0), sum(0, 1));
        if xx <= 1e-12 {
            return None;
        }
        let slope = xy / xx;
        let left = logs
            .iter()
            .map(|log| log[1] - mean[1] - slope * (log[0] - mean[0]));
        let scatter: f64 = left.map(|rest| rest * rest).sum();
        let error = (scatter / (count - 2.0) / xx).sqrt();
        let student = STUDENT[(logs.len() - 3).min(STUDENT.len() - 1)];
        Some(Self {
            slope,
            interval: [slope - student * error, slope + student * error],
        })
    }
}

/// The Pareto front: indices of (time, error) in ascending order of time.
pub fn pareto(points: &[[f64; 2]]) -> Vec<usize> {
    let mut order: Vec<usize> = (0..points.len())
        .filter(|index| points[*index].iter().all(|x| x.is_finite()))
        .collect();
    order.sort_by(|a, b| {
        let [a, b] = [points[*a], points[*b]];
        a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1]))
    });
    let mut best = f64::INFINITY;
    order.retain(|index| {
        let better = points[*index][1] < best;
        best = best.min(points[*index][1]);
        better
    });
    order
}

/// The time at which the Pareto front reaches an error, with the indices of the points that it lies
/// between.
///
/// The time is interpolated linearly on logarithmic axes. If the fastest point is already more
/// accurate, and only slower points are less accurate, it is the time of the fastest point. `None`
/// if the error is outside the range of all points.
pub fn time_to(points: &[[f64; 2]], error: f64) -> Option<(f64, [usize; 2])> {
    let front = pareto(points);
    let [first, last] = [*front.first()?, *front.last()?];
    let largest = points.iter().map(|point| point[1]).fold(0.0, f64::max);
    if !(points[last][1] <= error && error <= largest && points[last][1] > 0.0 && points[first][0] > 0.0) {
        return None;
    }
    if points[first][1] <= error {
        return Some((points[first][0], [first, first]));
    }
    front.windows(2).find_map(|pair| {
        let [[t0, e0], [t1, e1]] = [points[pair[0]], points[pair[1]]];
        let part = (e0 / error).ln() / (e0 / e1).ln();
        (e1 <= error).then(|| (t0 * (t1 / t0).powf(part), [pair[0], pair[1]]))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_middle_and_where_it_lies() {
        let times = Times::of(&[5.0, 1.0, 3.0, 2.0, 4.0]).unwrap();
        assert_eq!((times.median, times.interval), (3.0, [1.0, 5.0]));
        assert_eq!(Times::of(&[1.0, 4.0]).unwrap().median, 2.5);
        assert_eq!(Times::of(&[7.0]).unwrap().interval, [7.0, 7.0]);
        assert!(Times::of(&[]).is_none() && Times::of(&[f64::NAN]).is_none());
        // A single outlier does not matter.
        let mut many = vec![1.0; 14];
        many.push(100.0);
        assert_eq!(Times::of(&many).unwrap().interval, [1.0, 1.0]);
    }

    /// The table of Le Boudec, appendix A: ranks of the 95 % confidence interval, where it is
    /// symmetric.
    #[test]
    fn ranks_are_those_of_the_table() {
        for (count, lower) in [(6, 1), (10, 2), (15, 4), (20, 6), (30, 10), (50, 18)] {
            assert_eq!(outside(count) + 1, lower, "{count}");
        }
        assert!((1..6).all(|count| outside(count) == 0));
    }

    #[test]
    fn a_power_is_found_exactly() {
        let points: Vec<[f64; 2]> = [1.0, 2.0, 8.0, 32.0]
            .map(|x: f64| [x, 3.0 * x.powf(-0.75)])
            .to_vec();
        let fit = Slope::fit(&points).unwrap();
        assert!((fit.slope + 0.75).abs() < 1e-12 && fit.interval[1] - fit.interval[0] < 1e-9);
        assert_eq!(Slope::fit(&points[..2]), None);
        assert_eq!(Slope::fit(&[[1.0, 1.0], [1.0, 2.0], [1.0, 3.0]]), None);
        assert_eq!(Slope::fit(&[[1.0, 1.0], [2.0, 0.0], [3.0, 3.0]]), None);
    }

    /// The textbook example 9.1: y = x with one point off, checked by hand.
    #[test]
    fn the_interval_is_that_of_student() {
        let e = std::f64::consts::E;
        let fit = Slope::fit(&[[1.0, 1.0], [e, e], [e * e, e * e], [e.powi(3), e.powi(4)]]).unwrap();
        // Residuals of (0,0), (1,1), (2,2), (3,4): slope 1.3, sum of squares 0.3, so the standard
        // error is sqrt(0.15/5).
        assert!((fit.slope - 1.3).abs() < 1e-12);
        let half = 4.303 * (0.15_f64 / 5.0).sqrt();
        assert!((fit.interval[1] - fit.slope - half).abs() < 1e-9);
    }

    #[test]
    fn only_what_is_between_is_claimed() {
        let points = [[1.0, 1e-1], [10.0, 1e-2], [5.0, 2e-1], [100.0, 1e-4]];
        assert_eq!(pareto(&points), [0, 1, 3]);
        let (time, between) = time_to(&points, 1e-3).unwrap();
        assert!((time - 10.0 * 10f64.sqrt()).abs() < 1e-9);
        assert_eq!(between, [1, 3]);
        assert_eq!(time_to(&points, 1e-2).unwrap().0, 10.0);
        for beyond in [0.5, 1e-5] {
            assert_eq!(time_to(&points, beyond), None);
        }
        // Only a slower point is less accurate than this.
        assert_eq!(time_to(&points, 0.15), Some((1.0, [0, 0])));
        assert_eq!(time_to(&[[1.0, 0.0], [2.0, 0.0]], 0.0), None);
    }
}
