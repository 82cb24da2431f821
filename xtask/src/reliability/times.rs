//! Files of several runs, compared where undisturbed runs agree: times differ from run to run.

use super::{extension, is_whole};
use serde_json::Value;

/// What `converge` decides from times. A decision can be the same in many runs and another one in
/// the next, so that a few runs do not show that it differs.
const DECISIONS: [&str; 5] = ["affordable", "batch", "noisy", "pareto", "withheld"];

/// A TOML file.
pub(super) fn table(bytes: &[u8]) -> Option<Value> {
    let table: toml::Table = toml::from_str(std::str::from_utf8(bytes).ok()?).ok()?;
    serde_json::to_value(table).ok()
}

/// The values of a file; none if it has another format.
fn values(name: &str, bytes: &[u8]) -> Option<Value> {
    match extension(name) {
        "json" => serde_json::from_slice(bytes).ok(),
        "toml" => table(bytes),
        _ => None,
    }
}

/// Whether a file is that of undisturbed runs, where they agree. A web page or a report in XML that
/// differs from run to run must be complete: its numbers are those of a JSON file.
pub(super) fn is_same(name: &str, bytes: &[u8], undisturbed: &[&Vec<u8>]) -> bool {
    let Some(first) = undisturbed.first() else {
        return false;
    };
    if undisturbed.iter().all(|other| other == first) {
        return bytes == *first;
    }
    let expected: Option<Vec<Value>> = undisturbed.iter().map(|bytes| values(name, bytes)).collect();
    match expected {
        Some(expected) => values(name, bytes)
            .is_some_and(|value| agrees(Some(&value), &expected.iter().map(Some).collect::<Vec<_>>())),
        None => is_whole(name, bytes, Some(first)),
    }
}

/// Whether a value, or its absence, is the one in which all runs agree. Where they do not, every
/// value is accepted.
fn agrees(value: Option<&Value>, expected: &[Option<&Value>]) -> bool {
    if expected.iter().all(|other| *other == expected[0]) {
        return value == expected[0];
    }
    let objects: Option<Vec<_>> = expected
        .iter()
        .map(|other| other.and_then(Value::as_object))
        .collect();
    if let Some(objects) = objects {
        let found = value.and_then(Value::as_object);
        return found.is_some_and(|found| {
            let keys = objects.iter().flat_map(|object| object.keys());
            let mut keys = keys.chain(found.keys());
            keys.all(|key| {
                let expected: Vec<_> = objects.iter().map(|object| object.get(key)).collect();
                DECISIONS.contains(&key.as_str()) || agrees(found.get(key), &expected)
            })
        });
    }
    let arrays: Option<Vec<_>> = expected
        .iter()
        .map(|other| other.and_then(Value::as_array))
        .collect();
    match (arrays, value) {
        (Some(arrays), Some(Value::Array(found))) => {
            // Other lengths are values that differ.
            arrays.iter().any(|array| array.len() != arrays[0].len())
                || found.len() == arrays[0].len()
                    && found.iter().enumerate().all(|(index, value)| {
                        let expected: Vec<_> = arrays.iter().map(|array| array.get(index)).collect();
                        agrees(Some(value), &expected)
                    })
        }
        (Some(_), _) => false,
        (None, _) => true,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_values_that_differ_may_differ() {
        let same = |name, runs: [&str; 2], found: &str| {
            let runs = runs.map(|run| run.as_bytes().to_vec());
            is_same(name, found.as_bytes(), &[&runs[0], &runs[1]])
        };
        let point = |rmse: &str, seconds: &str| {
            format!(r#"{{"points": [{{"rmse": {rmse}, "seconds": {seconds}}}]}}"#)
        };
        let runs = [
            &*point("0.11301773271096931", "1.5"),
            &*point("0.11301773271096931", "1.75"),
        ];
        assert!(same("c.json", runs, &point("0.11301773271096931", "2.5")));
        // The next number.
        assert!(!same("c.json", runs, &point("0.11301773271096932", "1.5")));
        assert!(!same("c.json", runs, r#"{"points": []}"#));
        assert!(!same("c.json", runs, "{"));
        let more = r#"{"points": [{"rmse": 0.11301773271096931, "seconds": 1.5, "other": 1}]}"#;
        assert!(!same("c.json", runs, more));
        let decided = |other| format!(r#"{{"seconds": 1.{other}, "pareto": {}}}"#, other < 3);
        assert!(same("c.json", [&*decided(1), &*decided(2)], &decided(3)));
        // What only some runs have may be absent.
        assert!(same("c.json", ["{}", r#"{"spread": 1}"#], "{}"));
        let runs = ["floor = 0.5\nseconds = 1.0", "floor = 0.5\nseconds = 2.0"];
        assert!(same("meta.toml", runs, "floor = 0.5\nseconds = 3.0"));
        assert!(!same("meta.toml", runs, "floor = 0.25\nseconds = 1.0"));
        assert!(same("x.exr", ["image"; 2], "image") && !same("x.exr", ["image"; 2], "imaga"));
        assert!(!is_same("x.exr", b"image", &[]));
    }
}
