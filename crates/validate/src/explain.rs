//! Explains why a pixel differs. A pixel over tolerance is *explained* only by the reference's own
//! variation.
//!
//! The reference traces the pixel again under tiny shifts of the sample position (an edge), under
//! another spawn offset or the other traversal (its own guard against self-intersection), and under
//! perturbations of its rays and vertices by a few units in the last place (ill-conditioned). If it
//! takes our value under one of these, the pixel is explained. If our value only lies between its
//! values, the pixel is *ambiguous*. Where one yes-or-no test is undecided, the right value is one
//! of the two and never a mixture. Where several are, the reference cannot decide, but the oracle
//! can. Our own variation never counts: in a trial, a rule that let it count explained away 4,003
//! of 4,034 wrong pixels.

use crate::protocol::Setting;
use serde::{Deserialize, Serialize};
use std::f64::consts::TAU;

/// Shifts of the sample position that are tried, in pixels, smallest first.
pub const RADII: [f64; 3] = [1e-4, 1e-3, 1e-2];
/// Directions of each shift.
const DIRECTIONS: u32 = 16;
/// Other spawn offsets that are tried, in the driver's unit; the default is 4.
const SPAWN_OFFSETS: [f64; 4] = [2.0, 8.0, 16.0, 64.0];
/// Sizes of the perturbations of the reference's numbers, in its units in the last place.
const PERTURBATIONS: [f64; 2] = [2.0, 8.0];
/// Size of the perturbations that are combined with differently rounded vertices.
const WITH_VERTICES: f64 = 2.0;
/// Size of the perturbations in units of the largest component.
const OF_LARGEST: f64 = 1.0;
/// Number of perturbations of each size.
const SEEDS: u32 = 6;

/// The quantity of the reference that was varied.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", tag = "by")]
pub enum Reason {
    /// The sample position, by at most this many pixels.
    Shift {
        /// Maximum shift in pixels.
        radius_px: f64,
    },
    /// Its spawn offset or its traversal.
    SpawnOffset,
    /// Its noise.
    Noise,
    /// Any of these, by the values that are stored with the reference.
    Stored,
    /// Its numbers, by units in the last place.
    Rounding {
        /// Maximum number of units.
        ulps: f64,
    },
    /// The numbers of its rays by units in the last place, and those of its vertices by one.
    Vertices {
        /// Maximum number of units of the rays.
        ulps: f64,
    },
}

/// A group of settings whose results span one range.
#[derive(Clone, Debug, PartialEq)]
pub struct Trial {
    /// What the group varies.
    pub reason: Reason,
    /// The settings of the group.
    pub settings: Vec<Setting>,
}

/// The trials in the order in which they are tried. Each range also holds those of smaller trials
/// of the same kind.
pub fn trials() -> Vec<Trial> {
    let shift = |radius: f64| Trial {
        reason: Reason::Shift { radius_px: radius },
        settings: (0..DIRECTIONS)
            .map(|i| {
                let (sin, cos) = (f64::from(i) * TAU / f64::from(DIRECTIONS)).sin_cos();
                Setting {
                    dx: radius * cos,
                    dy: radius * sin,
                    ..Setting::default()
                }
            })
            .collect(),
    };
    let spawn = Trial {
        reason: Reason::SpawnOffset,
        settings: SPAWN_OFFSETS
            .iter()
            .flat_map(|&k| {
                [true, false].map(|robust| Setting {
                    k,
                    robust,
                    ..Setting::default()
                })
            })
            .chain([Setting {
                robust: false,
                ..Setting::default()
            }])
            .collect(),
    };
    let perturbed = |ulps: f64, vertices: bool| -> Vec<Setting> {
        (1..=SEEDS)
            .map(|seed| Setting {
                ulps,
                seed,
                vertices,
                ..Setting::default()
            })
            .collect()
    };
    let rounding = |ulps: f64| Trial {
        reason: Reason::Rounding { ulps },
        settings: perturbed(ulps, false),
    };
    let vertices = Trial {
        reason: Reason::Vertices { ulps: WITH_VERTICES },
        settings: perturbed(WITH_VERTICES, true),
    };
    let shifts = RADII.into_iter().map(shift);
    shifts
        .chain([spawn])
        .chain(PERTURBATIONS.into_iter().map(rounding))
        .chain([vertices])
        .collect()
}

/// The trials that change only roundings and self-intersection guards.
pub(crate) fn roundings(trials: Vec<Trial>) -> Vec<Trial> {
    let is_shift = |trial: &Trial| matches!(trial.reason, Reason::Shift { .. });
    trials.into_iter().filter(|trial| !is_shift(trial)).collect()
}

/// Perturbations of Mitsuba's rays by one unit of their largest component.
///
/// A small component of a direction results from sums of larger terms, in a rotation or a
/// reflection, and has their rounding error.
pub(crate) fn of_largest_component() -> Trial {
    Trial {
        reason: Reason::Rounding { ulps: OF_LARGEST },
        settings: (1..=SEEDS)
            .map(|seed| Setting {
                ulps: OF_LARGEST,
                seed,
                largest: true,
                ..Setting::default()
            })
            .collect(),
    }
}

/// The trials for POV-Ray, which computes in double precision except for the vertices of meshes.
pub(crate) fn trials_of_povray() -> Vec<Trial> {
    let of_rays = |trial: &Trial| matches!(trial.reason, Reason::Shift { .. });
    let shifts = trials().into_iter().filter(of_rays);
    let guards = Trial {
        reason: Reason::SpawnOffset,
        settings: SPAWN_OFFSETS
            .iter()
            .map(|&k| Setting {
                k,
                ..Setting::default()
            })
            .collect(),
    };
    let vertices = Trial {
        reason: Reason::Vertices { ulps: 0.0 },
        settings: (1..=SEEDS)
            .map(|seed| Setting {
                seed,
                vertices: true,
                ..Setting::default()
            })
            .collect(),
    };
    shifts.chain([guards, vertices]).collect()
}

/// The smallest and largest value of each channel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Range {
    /// Smallest.
    pub min: [f64; 3],
    /// Largest.
    pub max: [f64; 3],
}

impl Range {
    /// The range of a single value.
    pub fn of(value: [f64; 3]) -> Self {
        Self {
            min: value,
            max: value,
        }
    }

    /// Extends the range to include `value`. Ignores values that are not finite: they explain
    /// nothing.
    pub fn include(&mut self, value: [f64; 3]) {
        if value.iter().all(|v| v.is_finite()) {
            for (c, v) in value.into_iter().enumerate() {
                self.min[c] = self.min[c].min(v);
                self.max[c] = self.max[c].max(v);
            }
        }
    }

    /// Whether `value` lies inside, or outside by at most `tolerance[channel]`.
    pub fn holds(&self, value: [f64; 3], tolerance: [f64; 3]) -> bool {
        (0..3).all(|c| value[c] >= self.min[c] - tolerance[c] && value[c] <= self.max[c] + tolerance[c])
    }
}

/// What the reference's own variation says about a pixel over tolerance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Explanation {
    /// The reference takes our value under this variation.
    Value(Reason),
    /// Our value lies between values that the reference takes under this variation, but equals none
    /// of them.
    Between(Reason),
    /// Our value lies outside the range of all values of the reference.
    Nothing,
}

/// Compares our value with the reference's values. `variants` has one list per trial, in the order
/// of `trials`. Each trial also includes the values of the smaller trials of its kind before it.
pub fn explain(
    ours: [f64; 3],
    nominal: [f64; 3],
    tolerance: [f64; 3],
    trials: &[Trial],
    variants: &[Vec<[f64; 3]>],
) -> Explanation {
    if !ours.iter().chain(&nominal).all(|v| v.is_finite()) {
        return Explanation::Nothing;
    }
    let mut between = None;
    let mut ranges = [Range::of(nominal); 4];
    for (trial, values) in trials.iter().zip(variants) {
        if values.iter().any(|value| agree(ours, *value, tolerance)) {
            return Explanation::Value(trial.reason);
        }
        let range = match trial.reason {
            Reason::Shift { .. } => &mut ranges[0],
            Reason::SpawnOffset | Reason::Stored | Reason::Noise => &mut ranges[1],
            Reason::Rounding { .. } => &mut ranges[2],
            Reason::Vertices { .. } => &mut ranges[3],
        };
        for value in values {
            range.include(*value);
        }
        if between.is_none() && range.holds(ours, tolerance) {
            between = Some(trial.reason);
        }
    }
    between.map_or(Explanation::Nothing, Explanation::Between)
}

/// Whether two colours differ by at most `tolerance[channel]`. Values that are not finite agree
/// with nothing.
pub fn agree(a: [f64; 3], b: [f64; 3], tolerance: [f64; 3]) -> bool {
    (0..3).all(|c| (a[c] - b[c]).abs() <= tolerance[c])
}

#[cfg(test)]
mod tests {
    use super::*;

    fn constant(value: f64) -> Vec<Vec<[f64; 3]>> {
        trials()
            .iter()
            .map(|trial| vec![[value; 3]; trial.settings.len()])
            .collect()
    }

    fn of(ours: f64, nominal: f64, variants: &[Vec<[f64; 3]>]) -> Explanation {
        explain([ours; 3], [nominal; 3], [1e-3; 3], &trials(), variants)
    }

    #[test]
    fn a_reference_that_does_not_vary_explains_nothing() {
        assert_eq!(of(1.1, 1.0, &constant(1.0)), Explanation::Nothing);
    }

    #[test]
    fn an_edge_is_explained_by_the_smallest_shift_that_crosses_it() {
        let mut variants = constant(1.0);
        variants[1][5] = [0.2; 3];
        let shift = Reason::Shift { radius_px: 1e-3 };
        assert_eq!(of(0.2, 1.0, &variants), Explanation::Value(shift));
        assert_eq!(
            of(0.1, 1.0, &variants),
            Explanation::Nothing,
            "a value outside the range is not explained"
        );
    }

    #[test]
    fn a_mixture_of_both_sides_of_an_edge_is_not_explained_by_it() {
        let mut variants = constant(1.0);
        variants[1][5] = [0.2; 3];
        let shift = Reason::Shift { radius_px: 1e-3 };
        assert_eq!(of(0.6, 1.0, &variants), Explanation::Between(shift));
        // A later trial that takes the value itself explains it.
        variants[4][0] = [0.6; 3];
        assert_eq!(of(0.6, 1.0, &variants), Explanation::Value(trials()[4].reason));
    }

    #[test]
    fn values_that_are_not_finite_neither_explain_nor_are_explained() {
        let mut variants = constant(1.0);
        variants[2][0] = [f64::INFINITY; 3];
        assert_eq!(of(9.0, 1.0, &variants), Explanation::Nothing);
        assert_eq!(of(f64::NAN, 1.0, &variants), Explanation::Nothing);
    }

    #[test]
    fn no_channel_may_leave_the_range() {
        let mut variants = constant(1.0);
        variants[0][0] = [0.0, 0.0, 1.0];
        let found = |ours| explain(ours, [1.0; 3], [1e-3; 3], &trials(), &variants);
        assert!(matches!(found([0.5, 0.5, 1.0]), Explanation::Between(_)));
        assert!(matches!(found([0.0, 0.0, 1.0]), Explanation::Value(_)));
        assert_eq!(found([0.5, 0.5, 0.5]), Explanation::Nothing);
    }
}
