//! Measures the smallest detectable change of each parameter: changes every number of a scene on
//! our side only, by growing amounts, until the comparison fails.

use crate::opinion::Ask;
use crate::{CaseResult, Status, Validator, flatten};
use serde::{Deserialize, Serialize};
use std::cell::Cell;
use std::hash::{DefaultHasher, Hash, Hasher};
use std::path::Path;
use toml::Value;
use whitstone_image::Image;

/// The smallest change that is tried, as a fraction of the number.
const FIRST: f64 = 1e-7;
/// Number of decades that are tried: up to ten times the number.
const DECADES: i32 = 8;
/// Number of bisections of the decade in which a change is first detected, on a logarithmic scale.
/// Two give a factor of 1.8.
const HALVINGS: usize = 2;

/// A number of a scene, and its smallest detectable change.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Parameter {
    /// Its path, as for `--set`.
    pub path: String,
    /// Its value.
    pub value: f64,
    /// The effect of a change.
    pub effect: Effect,
}

/// The effect of a change.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", tag = "effect")]
pub enum Effect {
    /// The comparison fails.
    Seen {
        /// The smallest change for which it fails, in the unit of the number.
        change: f64,
        /// The first limit that was exceeded.
        problem: String,
    },
    /// The picture changes, and all limits hold.
    Unseen {
        /// The largest change that was tried.
        change: f64,
    },
    /// No pixel changes.
    NoPixel {
        /// The largest change that was tried.
        change: f64,
    },
    /// The scene rejects a change, and no smaller one was detected.
    Refused {
        /// The change.
        change: f64,
        /// The reason.
        problem: String,
    },
}

impl Validator<'_> {
    /// Changes the numbers of a scene one after another, except those of `[expect]` and `[film]`.
    /// `progress` receives the index, the total and the path of the current number.
    ///
    /// # Errors
    /// The scene is wrong, or does not pass without changes.
    pub fn sensitivity(
        &mut self,
        path: &Path,
        progress: &dyn Fn(usize, usize, &str),
    ) -> Result<Vec<Parameter>, String> {
        self.without_pictures();
        // Only the comparison itself is tested here.
        self.oracle.when = Ask::Never;
        let text = flatten(path, &[], self.registry)?.text;
        let table: Value = toml::from_str(&text).map_err(|error| error.to_string())?;
        let mut numbers = Vec::new();
        collect(&table, "", &mut numbers);
        let picture = Cell::new(0);
        let plain = self.trial(path, None, &|image| picture.set(hash(image)));
        if plain.status != Some(Status::Pass) {
            return Err(format!(
                "the scene does not pass without changes:\n{}",
                plain.problems.join("\n")
            ));
        }
        let picture = picture.get();
        let mut found = Vec::new();
        for (index, (name, number)) in numbers.iter().enumerate() {
            progress(index, numbers.len(), name);
            let number = &self.kind(path, name, *number);
            let effect = self.effect(path, name, *number, picture);
            found.push(Parameter {
                path: name.clone(),
                value: number.value(),
                effect,
            });
        }
        Ok(found)
    }

    /// Whether a number is an integer or a real. Most whole numbers in scenes are reals; only a
    /// scene that rejects a fraction there shows an integer.
    fn kind(&mut self, path: &Path, name: &str, number: Number) -> Number {
        let real = Number::Real(number.value());
        let refused = |case: &CaseResult| case.scene_error;
        match number {
            Number::Whole(_) if refused(&self.changed(path, name, real, real.steps()[0]).0) => number,
            _ => real,
        }
    }

    fn effect(&mut self, path: &Path, name: &str, number: Number, plain: u64) -> Effect {
        let mut moved = false;
        let mut last = 0.0;
        for step in number.steps() {
            let (case, picture) = self.changed(path, name, number, step);
            if case.scene_error {
                let problem = case
                    .problems
                    .first()
                    .map_or("", |report| first_line(report))
                    .to_owned();
                return match (moved, last > 0.0) {
                    (true, _) => Effect::Unseen { change: last },
                    (false, true) => Effect::NoPixel { change: last },
                    _ => Effect::Refused {
                        change: step,
                        problem,
                    },
                };
            }
            moved |= picture != plain;
            if case.status != Some(Status::Pass) {
                return self.refined(path, name, number, [last, step], &case);
            }
            last = step;
        }
        match moved {
            true => Effect::Unseen { change: last },
            false => Effect::NoPixel { change: last },
        }
    }

    /// Narrows the interval between a change that is not detected, or zero, and one that is.
    fn refined(
        &mut self,
        path: &Path,
        name: &str,
        number: Number,
        between: [f64; 2],
        seen: &CaseResult,
    ) -> Effect {
        let [mut unseen, mut change] = between;
        let mut problem = problem(seen);
        for _ in 0..HALVINGS {
            let middle = (unseen * change).sqrt();
            if unseen == 0.0 || matches!(number, Number::Whole(_)) {
                break;
            }
            let (case, _) = self.changed(path, name, number, middle);
            if case.status == Some(Status::Pass) {
                unseen = middle;
            } else {
                change = middle;
                problem = self::problem(&case);
            }
        }
        Effect::Seen { change, problem }
    }

    fn changed(&mut self, path: &Path, name: &str, number: Number, step: f64) -> (CaseResult, u64) {
        let picture = Cell::new(0);
        let change = format!("{name}={}", number.after(step));
        let case = self.trial(path, Some(change), &|image| picture.set(hash(image)));
        (case, picture.get())
    }
}

fn problem(case: &CaseResult) -> String {
    case.problems
        .first()
        .map_or("", |text| first_line(text))
        .to_owned()
}

fn first_line(text: &str) -> &str {
    text.lines().next().unwrap_or_default()
}

fn hash(image: &Image) -> u64 {
    let mut hasher = DefaultHasher::new();
    for (name, samples) in image.channels() {
        name.hash(&mut hasher);
        samples
            .iter()
            .for_each(|sample| sample.to_bits().hash(&mut hasher));
    }
    hasher.finish()
}

/// A number in a scene file.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Number {
    Whole(i64),
    Real(f64),
}

impl Number {
    fn value(self) -> f64 {
        match self {
            Self::Whole(value) => value as f64,
            Self::Real(value) => value,
        }
    }

    /// Growing changes in the unit of the number. Whole numbers grow by one, and by their own
    /// value; the scale of zero is one.
    fn steps(self) -> Vec<f64> {
        match self {
            Self::Whole(value) => {
                let mut steps = vec![1.0, (value.abs() as f64).max(2.0)];
                steps.dedup();
                steps
            }
            Self::Real(value) => {
                let size = if value == 0.0 { 1.0 } else { value.abs() };
                (0..=DECADES)
                    .map(|decade| size * FIRST * 10f64.powi(decade))
                    .collect()
            }
        }
    }

    /// The TOML text of the number after a change.
    fn after(self, step: f64) -> String {
        match self {
            Self::Whole(value) => value.saturating_add(step as i64).to_string(),
            // With a point or an exponent, so that it remains a float.
            Self::Real(value) => format!("{:?}", value + step),
        }
    }
}

/// All numbers of a table except the film and the expected results.
fn collect(value: &Value, path: &str, numbers: &mut Vec<(String, Number)>) {
    let below = |key: &str| match path {
        "" => key.to_owned(),
        _ => format!("{path}.{key}"),
    };
    match value {
        Value::Integer(value) => numbers.push((path.to_owned(), Number::Whole(*value))),
        Value::Float(value) if value.is_finite() => numbers.push((path.to_owned(), Number::Real(*value))),
        Value::Array(values) => {
            for (index, value) in values.iter().enumerate() {
                collect(value, &below(&index.to_string()), numbers);
            }
        }
        Value::Table(table) => {
            // Another image size is not a fault that could be small.
            let skipped = |key: &str| path.is_empty() && ["expect", "film"].contains(&key);
            for (key, value) in table.iter().filter(|(key, _)| !skipped(key)) {
                collect(value, &below(key), numbers);
            }
        }
        _ => {}
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_number_is_found_by_its_path() {
        let text = "film = { width = 3 }\n[expect]\nexplained = 3\n[camera]\nfov = 45.0\norigin = [0.0, 1, 2.5]\n\
                    [[shape]]\nradius = 2\nname = \"a\"\n[[shape]]\ndeep = { er = -1e-3 }\n";
        let mut numbers = Vec::new();
        collect(&toml::from_str(text).unwrap(), "", &mut numbers);
        let names: Vec<&str> = numbers.iter().map(|(name, _)| name.as_str()).collect();
        assert_eq!(
            names,
            [
                "camera.fov",
                "camera.origin.0",
                "camera.origin.1",
                "camera.origin.2",
                "shape.0.radius",
                "shape.1.deep.er"
            ]
        );
    }

    #[test]
    fn changes_grow_and_keep_the_kind_of_number() {
        let real = Number::Real(-2.0);
        assert_eq!(real.steps().len(), 9);
        assert!(
            real.steps()
                .windows(2)
                .all(|pair| (pair[1] / pair[0] - 10.0).abs() < 1e-9)
        );
        assert_eq!(
            (real.after(2.0), real.after(0.5)),
            ("0.0".to_owned(), "-1.5".to_owned())
        );
        assert_eq!(Number::Real(0.0).steps()[0], FIRST);
        assert_eq!(Number::Whole(7).steps(), [1.0, 7.0]);
        assert_eq!(Number::Whole(7).after(7.0), "14");
    }
}
