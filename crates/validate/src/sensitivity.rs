//! How small a fault is seen: every number of a scene is changed on our side only, by less and less, until the comparison
//! with the reference no longer fails.
//!
//! A limit that is too wide shows as a number that can be far off unnoticed; a number that no pixel depends on is not
//! tested by the scene at all.

use crate::validator::flatten;
use crate::{CaseResult, Status, Validator};
use serde::Serialize;
use std::path::Path;
use toml::Value;

/// Changes are tried down to 10 to the minus this, as a part of the number.
const DECADES: u32 = 10;
/// Steps a decade.
const STEPS: u32 = 4;

/// A number of the scene.
#[derive(Clone, Debug, PartialEq)]
struct Parameter {
    /// As `--set` has it.
    path: String,
    value: f64,
    whole: bool,
}

/// How small a change of a number is seen.
#[derive(Debug, Serialize)]
pub struct Sensitivity {
    /// Where it stands, as `--set` has it.
    pub path: String,
    /// What it is.
    pub value: f64,
    /// What was found.
    #[serde(flatten)]
    pub seen: Seen,
}

/// What the comparison says of changes of a number.
#[derive(Debug, Serialize)]
#[serde(tag = "seen", rename_all = "snake_case")]
pub enum Seen {
    /// From this change on it fails.
    From {
        /// The smallest change that is seen, in the unit of the number.
        change: f64,
        /// As a part of the number; the change itself where that is 0.
        relative: f64,
        /// The first limit that is broken then.
        problem: String,
    },
    /// The image changes, but not so much that the comparison fails.
    Never {
        /// The largest change that was tried, in the unit of the number.
        tried: f64,
    },
    /// No pixel changes.
    NoPixel {
        /// The largest change that was tried, in the unit of the number.
        tried: f64,
    },
    /// Every other value that was tried is refused.
    Fixed,
}

/// What an evaluation of a changed scene says.
enum Verdict {
    Refused,
    Passes { same: bool },
    Fails(String),
}

/// Finds how small a change of each number of a scene is seen. `tell` gets the number of parameters done, and of all.
///
/// # Errors
///
/// If the scene cannot be read, or if the unchanged one already fails.
pub fn sensitivity(
    validator: &mut Validator<'_>,
    scene: &Path,
    tell: &dyn Fn(usize, usize),
) -> Result<Vec<Sensitivity>, String> {
    validator.without_pictures();
    validator.change_ours(Vec::new());
    let unchanged = validator.validate(scene);
    if unchanged.status != Some(Status::Pass) {
        let problems = unchanged.problems.join("; ");
        return Err(format!("the unchanged scene already fails: {problems}"));
    }
    let text = flatten(scene, validator.changed())?.text;
    let document: Value = toml::from_str(&text).map_err(|error| error.to_string())?;
    let parameters = parameters(&document);
    let mut found = Vec::new();
    for (done, parameter) in parameters.iter().enumerate() {
        tell(done, parameters.len());
        let mut ask = |whole: bool| {
            search(parameter.value, whole, |value| {
                let value = if whole {
                    format!("{value:.0}")
                } else {
                    format!("{value:?}")
                };
                validator.change_ours(vec![format!("{}={value}", parameter.path)]);
                verdict(&validator.validate(scene), &unchanged)
            })
        };
        // A whole number may stand where any would do.
        let mut seen = ask(false);
        if parameter.whole && matches!(seen, Seen::Fixed) {
            seen = ask(true);
        }
        found.push(Sensitivity {
            path: parameter.path.clone(),
            value: parameter.value,
            seen,
        });
    }
    validator.change_ours(Vec::new());
    Ok(found)
}

fn verdict(case: &CaseResult, unchanged: &CaseResult) -> Verdict {
    if case.scene_error {
        return Verdict::Refused;
    }
    match case.problems.first() {
        Some(problem) => Verdict::Fails(problem.clone()),
        None => Verdict::Passes {
            // All that is told of the difference to the reference, bit for bit.
            same: case.rmse == unchanged.rmse
                && case.max_abs == unchanged.max_abs
                && case.relmse == unchanged.relmse
                && case.mae == unchanged.mae
                && case.pixels_over_tolerance == unchanged.pixels_over_tolerance,
        },
    }
}

/// By halving the steps: what is seen is taken to be seen whenever it is larger.
fn search(value: f64, whole: bool, mut verdict: impl FnMut(f64) -> Verdict) -> Seen {
    let unit = if value == 0.0 { 1.0 } else { value.abs() };
    let (last, change) = if whole {
        // One, two, four, ...
        (
            10,
            Box::new(|step: u32| f64::from(1_u32 << step)) as Box<dyn Fn(u32) -> f64>,
        )
    } else {
        let change = move |step: u32| {
            let decades = f64::from(step) / f64::from(STEPS) - f64::from(DECADES);
            unit * 10f64.powf(decades)
        };
        (DECADES * STEPS, Box::new(change) as Box<dyn Fn(u32) -> f64>)
    };
    // The largest step that is no error, upwards or else downwards.
    let largest = [1.0, -1.0].into_iter().find_map(|sign| {
        (0..=last)
            .rev()
            .step_by(4)
            .find_map(|step| match verdict(value + sign * change(step)) {
                Verdict::Refused => None,
                answer => Some((sign, step, answer)),
            })
    });
    let Some((sign, mut high, answer)) = largest else {
        return Seen::Fixed;
    };
    let mut problem = match answer {
        Verdict::Fails(problem) => problem,
        Verdict::Passes { same: true } => return Seen::NoPixel { tried: change(high) },
        Verdict::Passes { same: false } | Verdict::Refused => return Seen::Never { tried: change(high) },
    };
    // Below `low` nothing is seen, or nothing was tried.
    let mut low = 0;
    while low < high {
        let middle = u32::midpoint(low, high);
        match verdict(value + sign * change(middle)) {
            Verdict::Fails(why) => {
                problem = why;
                high = middle;
            }
            Verdict::Passes { .. } | Verdict::Refused => low = middle + 1,
        }
    }
    Seen::From {
        change: change(high),
        relative: change(high) / unit,
        problem,
    }
}

/// The numbers that a picture could depend on: not those of the film, which both sides must share, and of what is expected.
fn parameters(document: &Value) -> Vec<Parameter> {
    let mut found = Vec::new();
    for (key, value) in document.as_table().into_iter().flatten() {
        if !["film", "expect"].contains(&key.as_str()) {
            collect(value, key, &mut found);
        }
    }
    found
}

fn collect(value: &Value, path: &str, found: &mut Vec<Parameter>) {
    let mut number = |value: f64, whole: bool| {
        found.push(Parameter {
            path: path.to_owned(),
            value,
            whole,
        });
    };
    match value {
        Value::Integer(value) => number(*value as f64, true),
        Value::Float(value) if value.is_finite() => number(*value, false),
        Value::Array(values) => {
            for (place, value) in values.iter().enumerate() {
                collect(value, &format!("{path}.{place}"), found);
            }
        }
        Value::Table(table) => {
            for (key, value) in table {
                collect(value, &format!("{path}.{key}"), found);
            }
        }
        _ => {}
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn passes() -> Verdict {
        Verdict::Passes { same: false }
    }

    #[test]
    fn the_smallest_change_that_is_seen_is_found() {
        let seen = search(-20.0, false, |value| {
            if (value + 20.0).abs() >= 1e-4 {
                Verdict::Fails("off".to_owned())
            } else {
                passes()
            }
        });
        let Seen::From { change, relative, .. } = seen else {
            panic!("{seen:?}");
        };
        assert!((1e-4..1.8e-4).contains(&change), "{change}");
        assert!((relative * 20.0 - change).abs() < 1e-12);
    }

    #[test]
    fn what_is_refused_is_tried_the_other_way_and_by_less() {
        // From 0 to 1, and seen from 0.9 down.
        let seen = search(1.0, false, |value| match value {
            value if !(0.0..=1.0).contains(&value) => Verdict::Refused,
            value if value <= 0.9 => Verdict::Fails("dark".to_owned()),
            _ => passes(),
        });
        assert!(
            matches!(&seen, Seen::From { change, .. } if (0.1..0.18).contains(change)),
            "{seen:?}"
        );
        assert!(matches!(search(1.0, false, |_| Verdict::Refused), Seen::Fixed));
    }

    #[test]
    fn what_changes_nothing_is_told_from_what_is_not_seen() {
        assert!(matches!(search(3.0, false, |_| passes()), Seen::Never { tried } if tried == 3.0));
        let same = |_| Verdict::Passes { same: true };
        assert!(matches!(search(0.0, false, same), Seen::NoPixel { tried } if tried == 1.0));
    }

    #[test]
    fn whole_numbers_change_by_whole_numbers() {
        let mut tried = Vec::new();
        let seen = search(5.0, true, |value| {
            tried.push(value);
            if value >= 7.0 {
                Verdict::Fails("more".to_owned())
            } else {
                passes()
            }
        });
        assert!(
            matches!(seen, Seen::From { change, .. } if change == 2.0),
            "{seen:?}"
        );
        assert!(tried.iter().all(|value| value.fract() == 0.0));
    }

    #[test]
    fn every_number_has_a_path() {
        let text =
            "[film]\nwidth = 4\n[[light]]\nposition = [1, 2.5]\n[camera.look_at]\nup = [0.5]\nname = \"x\"";
        let found = parameters(&toml::from_str(text).unwrap());
        let paths: Vec<(&str, f64, bool)> = found
            .iter()
            .map(|parameter| (parameter.path.as_str(), parameter.value, parameter.whole))
            .collect();
        assert_eq!(
            paths,
            [
                ("camera.look_at.up.0", 0.5, false),
                ("light.0.position.0", 1.0, true),
                ("light.0.position.1", 2.5, false)
            ]
        );
    }
}
