//! Why a pixel differs: it is *explained* only by what the reference itself does.
//!
//! A pixel over tolerance is explained if our value lies within the range that the reference takes
//! there under tiny shifts of the sample position (an edge), under another spawn offset or the other
//! traversal (its own guard against self-intersection), or under perturbations of its numbers, those of
//! rays and those of vertices, by a few units in the last place (ill-conditioned). Our own variation never counts: in a trial, a rule that
//! let it count explained away 4,003 of 4,034 wrong pixels.

use crate::driver::Setting;
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
/// Size of those that go with vertices rounded otherwise.
const WITH_VERTICES: f64 = 2.0;
/// Perturbations of each size.
const SEEDS: u32 = 6;

/// What the reference was made to vary in.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", tag = "by")]
pub enum Reason {
    /// The sample position, by at most this many pixels.
    Shift {
        /// In pixels.
        radius_px: f64,
    },
    /// Its spawn offset or its traversal.
    SpawnOffset,
    /// Any of these, by the range kept with a stored reference.
    StoredRange,
    /// Its numbers, by units in the last place.
    Rounding {
        /// How many at most.
        ulps: f64,
    },
    /// The numbers of its rays by units in the last place, and those of its vertices by one.
    Vertices {
        /// Of the rays, at most.
        ulps: f64,
    },
}

/// A group of settings whose results span one range.
#[derive(Clone, Debug, PartialEq)]
pub struct Trial {
    /// What the group varies.
    pub reason: Reason,
    /// In which ways.
    pub settings: Vec<Setting>,
}

/// The trials in the order in which they are tried. Each range also holds those of smaller trials of the
/// same kind.
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

/// Those of POV-Ray, which computes in double precision, but for the vertices of meshes.
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
    /// Of a single value.
    pub fn of(value: [f64; 3]) -> Self {
        Self {
            min: value,
            max: value,
        }
    }

    /// Grown to hold `value`. What is not finite is left out: it explains nothing.
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

/// The first trial whose range holds our value. `variants` are the reference's values, one list a trial
/// in the order of [`trials`].
pub fn explain(
    ours: [f64; 3],
    nominal: [f64; 3],
    tolerance: [f64; 3],
    trials: &[Trial],
    variants: &[Vec<[f64; 3]>],
) -> Option<Reason> {
    if !ours.iter().chain(&nominal).all(|v| v.is_finite()) {
        return None;
    }
    let mut ranges = [Range::of(nominal); 4];
    for (trial, values) in trials.iter().zip(variants) {
        let range = match trial.reason {
            Reason::Shift { .. } => &mut ranges[0],
            Reason::SpawnOffset | Reason::StoredRange => &mut ranges[1],
            Reason::Rounding { .. } => &mut ranges[2],
            Reason::Vertices { .. } => &mut ranges[3],
        };
        for value in values {
            range.include(*value);
        }
        if range.holds(ours, tolerance) {
            return Some(trial.reason);
        }
    }
    None
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

    #[test]
    fn a_reference_that_does_not_vary_explains_nothing() {
        let found = explain([1.1; 3], [1.0; 3], [1e-3; 3], &trials(), &constant(1.0));
        assert_eq!(found, None);
    }

    #[test]
    fn an_edge_is_explained_by_the_smallest_shift_that_crosses_it() {
        let mut variants = constant(1.0);
        variants[1][5] = [0.2; 3];
        let found = explain([0.2; 3], [1.0; 3], [1e-3; 3], &trials(), &variants);
        assert_eq!(found, Some(Reason::Shift { radius_px: 1e-3 }));
        let beyond = explain([0.1; 3], [1.0; 3], [1e-3; 3], &trials(), &variants);
        assert_eq!(beyond, None, "a value outside the range is not explained");
    }

    #[test]
    fn values_that_are_not_finite_neither_explain_nor_are_explained() {
        let mut variants = constant(1.0);
        variants[2][0] = [f64::INFINITY; 3];
        assert_eq!(explain([9.0; 3], [1.0; 3], [1e-3; 3], &trials(), &variants), None);
        assert_eq!(
            explain([f64::NAN; 3], [1.0; 3], [1e-3; 3], &trials(), &variants),
            None
        );
    }

    #[test]
    fn no_channel_may_leave_the_range() {
        let mut variants = constant(1.0);
        variants[0][0] = [0.0, 0.0, 1.0];
        assert!(explain([0.5, 0.5, 1.0], [1.0; 3], [1e-3; 3], &trials(), &variants).is_some());
        assert!(explain([0.5, 0.5, 0.5], [1.0; 3], [1e-3; 3], &trials(), &variants).is_none());
    }
}
