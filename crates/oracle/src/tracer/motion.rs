//! Moving shapes: the scene at each time of its film, as a document without motion (sections 3 and
//! 9 of the model).

use super::{Tracer, Value};
use toml::{Table, Value as Toml};
use whitstone_core::{SceneError, SceneErrors};
use whitstone_scene::{Description, Sources};

/// Undecided times multiply the values that a pixel can take; beyond this number it is unknown.
const MAX_VALUES: usize = 4096;

/// Values that differ by less in every channel, relative to 1 or their size, count as one.
const SAME: f64 = 1e-9;

/// The tracers of a moving scene, one for each time of its film; none if nothing moves.
pub(super) fn tracers(description: &Description<'_>) -> Result<Vec<Tracer>, SceneErrors> {
    if !description.moves() {
        return Ok(Vec::new());
    }
    let anywhere = |message: String| SceneErrors::from(SceneError::anywhere(message));
    let document: Table = description
        .flattened
        .text
        .parse()
        .map_err(|error: toml::de::Error| anywhere(error.to_string()))?;
    let tracer = |time: f64| {
        let mut still = document.clone();
        stop_all(&mut still, time);
        let text = still.to_string();
        let sources = Sources::from_text("still", &text, &description.flattened.base, &[]);
        let sources = sources.map_err(|error| error.errors)?;
        let still = Description::parse(&sources).into_result()?;
        Tracer::still(&still)
    };
    // Positions in another text mean nothing to the caller.
    let placeless = |errors: SceneErrors| {
        let messages = errors
            .0
            .into_iter()
            .map(|error| SceneError::anywhere(error.message));
        SceneErrors(messages.collect())
    };
    let all = times(&document).into_iter().map(tracer);
    all.collect::<Result<_, _>>().map_err(placeless)
}

/// The times of the film.
fn times(document: &Table) -> Vec<f64> {
    let time = document.get("film").and_then(|film| film.get("time"));
    let key = |key: &str| time.and_then(|time| time.get(key)).and_then(number);
    match (key("open"), key("close"), key("count")) {
        (Some(open), Some(close), Some(count)) => (0..count as u32)
            .map(|k| open + (close - open) * (f64::from(k) + 0.5) / count)
            .collect(),
        _ => vec![time.and_then(number).unwrap_or(0.0)],
    }
}

fn number(value: &Toml) -> Option<f64> {
    value
        .as_float()
        .or(value.as_integer().map(|integer| integer as f64))
}

/// Replaces the motions of all shapes by their steps at a time.
fn stop_all(document: &mut Table, time: f64) {
    let stop_list = |table: &mut Table| {
        let shapes = table.get_mut("shape").and_then(Toml::as_array_mut);
        let shapes = shapes.into_iter().flatten().filter_map(Toml::as_table_mut);
        shapes.for_each(|shape| stop(shape, time));
    };
    stop_list(document);
    let groups = document
        .get_mut("group")
        .and_then(Toml::as_table_mut)
        .into_iter()
        .flatten();
    for (_, group) in groups {
        group.as_table_mut().into_iter().for_each(stop_list);
    }
}

fn stop(shape: &mut Table, time: f64) {
    let Some(Toml::Array(keyframes)) = shape.remove("motion") else {
        return;
    };
    let list = |steps: Option<Toml>| match steps {
        None => Vec::new(),
        Some(Toml::Array(steps)) => steps,
        Some(step) => vec![step],
    };
    let keyframes: Vec<(f64, Vec<Toml>)> = keyframes
        .into_iter()
        .filter_map(|keyframe| {
            let at = keyframe.get("time").and_then(number)?;
            Some((at, list(keyframe.get("transform").cloned())))
        })
        .collect();
    let mut steps = list(shape.remove("transform"));
    let first_after = keyframes.iter().position(|(at, _)| *at > time);
    steps.extend(match first_after {
        None => keyframes
            .last()
            .map(|(_, steps)| steps.clone())
            .unwrap_or_default(),
        Some(0) => keyframes[0].1.clone(),
        Some(after) => {
            let ((t_a, a), (t_b, b)) = (&keyframes[after - 1], &keyframes[after]);
            let u = (time - t_a) / (t_b - t_a);
            a.iter().zip(b).map(|(a, b)| between(a, b, u)).collect()
        }
    });
    shape.insert("transform".to_owned(), Toml::Array(steps));
}

/// A value with each number x_a + u (x_b - x_a).
fn between(a: &Toml, b: &Toml, u: f64) -> Toml {
    if let (Some(a), Some(b)) = (number(a), number(b)) {
        return Toml::Float(a + u * (b - a));
    }
    match (a, b) {
        (Toml::Array(a), Toml::Array(b)) => {
            Toml::Array(a.iter().zip(b).map(|(a, b)| between(a, b, u)).collect())
        }
        // Of a scale, one factor is three equal ones.
        (Toml::Array(a), b) => Toml::Array(a.iter().map(|a| between(a, b, u)).collect()),
        (a, Toml::Array(b)) => Toml::Array(b.iter().map(|b| between(a, b, u)).collect()),
        (Toml::Table(a), Toml::Table(b)) => {
            let mixed = a
                .iter()
                .filter_map(|(key, a)| Some((key.clone(), between(a, b.get(key)?, u))));
            Toml::Table(mixed.collect())
        }
        (a, _) => a.clone(),
    }
}

/// The mean of the values at all times.
pub(super) fn mean(values: Vec<Value>) -> Value {
    let share = 1.0 / values.len() as f64;
    let mut rgb = [0.0; 3];
    let mut uncertainty = [0.0; 3];
    let mut seen = vec![[0.0; 3]];
    for value in values {
        let Value::Known {
            rgb: here,
            uncertainty: doubt,
            seen: alternatives,
        } = value
        else {
            return value;
        };
        for c in 0..3 {
            rgb[c] += share * here[c];
            uncertainty[c] += share * doubt[c];
        }
        let mut distinct: Vec<[f64; 3]> = vec![here];
        for other in alternatives {
            let same = |known: &[f64; 3]| {
                (0..3).all(|c| (known[c] - other[c]).abs() <= SAME * known[c].abs().max(1.0))
            };
            if !distinct.iter().any(same) {
                distinct.push(other);
            }
        }
        let sums = seen.iter().flat_map(|sum: &[f64; 3]| {
            let add = |other: &[f64; 3]| std::array::from_fn(|c| sum[c] + share * other[c]);
            distinct.iter().map(add).collect::<Vec<[f64; 3]>>()
        });
        seen = sums.collect();
        if seen.len() > MAX_VALUES {
            return Value::Unknown("a moving edge touches the pixel's rays at several times".to_owned());
        }
    }
    Value::Known {
        rgb,
        uncertainty,
        seen,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::shows;

    /// A bright square that moves to the right, past the view along (x, y) = (0, 0).
    const SQUARE: &str = "[[shape]]\ntype = \"rectangle\"\nmaterial = { type = \"emissive\", radiance = 1 }\n\
        motion = [{ time = 0, transform = { translate = [-4, 0, 0] } }, { time = 1, transform = { translate = [4, 0, 0] } }]\n";

    #[test]
    fn the_mean_is_over_the_middles_of_the_intervals() {
        // The square covers the origin for |8 t - 4| <= 1: at 3/8 < t < 5/8.
        for (open, close, count, covered) in [(0.0, 1.0, 2, 0.0), (0.0, 1.0, 8, 2.0), (0.25, 0.75, 16, 8.0)] {
            let text = format!("[film.time]\nopen = {open}\nclose = {close}\ncount = {count}\n{SQUARE}");
            shows([0.0, 0.0], &text, &[], [covered / f64::from(count); 3]);
        }
    }

    #[test]
    fn values_of_undecided_times_are_combined() {
        let known = |rgb: f64, other: f64| Value::Known {
            rgb: [rgb; 3],
            uncertainty: [(rgb - other).abs(); 3],
            seen: vec![[rgb; 3], [other; 3], [other + 1e-12; 3]],
        };
        let Value::Known {
            rgb,
            uncertainty,
            seen,
        } = mean(vec![known(1.0, 0.0), known(2.0, 4.0)])
        else {
            panic!("the values are known");
        };
        assert_eq!((rgb, uncertainty), ([1.5; 3], [1.5; 3]));
        let mut seen: Vec<f64> = seen.iter().map(|value| value[0]).collect();
        seen.sort_by(f64::total_cmp);
        assert_eq!(seen, [1.0, 1.5, 2.0, 2.5]);
        assert!(matches!(mean(vec![known(1.0, 0.0); 13]), Value::Unknown(_)));
        assert_eq!(
            mean(vec![Value::Unknown("late".to_owned())]),
            Value::Unknown("late".to_owned())
        );
    }
}
