//! Files of several runs, compared where undisturbed runs agree: times differ from run to run.

use super::{extension, is_whole};
use serde_json::Value;

/// The load of the machine, the processor time of other programs, and what `converge` decides from
/// times. They can be the same in many runs and another in the next, so that a few runs do not show
/// that they differ.
const OF_THE_MOMENT: [&str; 7] = [
    "affordable",
    "batch",
    "load",
    "noisy",
    "others",
    "pareto",
    "withheld",
];

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

/// Where a file is not that of undisturbed runs, although they agree there. A web page or a report
/// in XML that differs from run to run must be complete: its numbers are those of a JSON file.
pub(super) fn difference(name: &str, bytes: &[u8], undisturbed: &[&Vec<u8>]) -> Option<String> {
    let whole = |is_so: bool| (!is_so).then(String::new);
    let Some(first) = undisturbed.first() else {
        return whole(false);
    };
    let agree = undisturbed.iter().all(|other| other == first);
    if agree && bytes == *first {
        return None;
    }
    // The times of a report can be the same in several runs and another in the next.
    if extension(name) == "xml" && undisturbed.iter().all(|other| timeless(other) == timeless(bytes)) {
        return None;
    }
    let expected: Option<Vec<Value>> = undisturbed.iter().map(|bytes| values(name, bytes)).collect();
    match (expected, values(name, bytes)) {
        (Some(expected), Some(value)) => {
            // The same values in other bytes are a difference, too.
            let is_other = !agree || value != expected[0];
            let expected: Vec<_> = expected.iter().map(Some).collect();
            other_value("", Some(&value), &expected).or_else(|| whole(is_other))
        }
        (Some(_), None) => whole(false),
        (None, _) => whole(!agree && is_whole(name, bytes, Some(first))),
    }
}

/// The text of a report in XML without the values of its attributes `time`.
fn timeless(bytes: &[u8]) -> Vec<String> {
    let text = String::from_utf8_lossy(bytes);
    let mut parts = text.split(" time=\"");
    let first = parts.next().map(str::to_owned);
    let rest = parts.map(|part| {
        part.trim_start_matches(|c: char| c.is_ascii_digit() || c == '.')
            .to_owned()
    });
    first.into_iter().chain(rest).collect()
}

/// The place of a value, or of its absence, that is not the one in which all runs agree. Where they
/// do not, every value is accepted.
fn other_value(place: &str, value: Option<&Value>, expected: &[Option<&Value>]) -> Option<String> {
    let told = |is_so: bool| {
        let text = |value: Option<&Value>| value.map_or("nothing".to_owned(), Value::to_string);
        let short = |text: String| text.chars().take(60).collect::<String>();
        (!is_so).then(|| {
            format!(
                "{place} is {} instead of {}",
                short(text(value)),
                short(text(expected[0]))
            )
        })
    };
    if value == expected[0] && expected.iter().all(|other| *other == expected[0]) {
        return None;
    }
    let objects: Option<Vec<_>> = expected
        .iter()
        .map(|other| other.and_then(Value::as_object))
        .collect();
    if let (Some(objects), Some(found)) = (&objects, value.and_then(Value::as_object)) {
        let keys = objects.iter().flat_map(|object| object.keys());
        let mut keys = keys
            .chain(found.keys())
            .filter(|key| !OF_THE_MOMENT.contains(&key.as_str()));
        return keys.find_map(|key| {
            let expected: Vec<_> = objects.iter().map(|object| object.get(key)).collect();
            other_value(&format!("{place}/{key}"), found.get(key), &expected)
        });
    }
    let arrays: Option<Vec<_>> = expected
        .iter()
        .map(|other| other.and_then(Value::as_array))
        .collect();
    match (arrays, value) {
        // Other lengths are values that differ.
        (Some(arrays), Some(Value::Array(_)))
            if arrays.iter().any(|array| array.len() != arrays[0].len()) =>
        {
            None
        }
        (Some(arrays), Some(Value::Array(found))) if found.len() == arrays[0].len() => {
            found.iter().enumerate().find_map(|(index, value)| {
                let expected: Vec<_> = arrays.iter().map(|array| array.get(index)).collect();
                other_value(&format!("{place}/{index}"), Some(value), &expected)
            })
        }
        (Some(_), _) => told(false),
        (None, _) => told(objects.is_none() && expected.iter().any(|other| *other != expected[0])),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_values_that_differ_may_differ() {
        let same = |name, runs: [&str; 2], found: &str| {
            let runs = runs.map(|run| run.as_bytes().to_vec());
            difference(name, found.as_bytes(), &[&runs[0], &runs[1]]).is_none()
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
        let loaded = |load: &str| format!(r#"{{"load": {load}, "threads": 2}}"#).into_bytes();
        assert!(difference("c.json", &loaded("3.9"), &[&loaded("3.72"), &loaded("3.72")]).is_none());
        let decided = |other| format!(r#"{{"seconds": 1.{other}, "pareto": {}}}"#, other < 3);
        assert!(same("c.json", [&*decided(1), &*decided(2)], &decided(3)));
        // What only some runs have may be absent.
        assert!(same("c.json", ["{}", r#"{"spread": 1}"#], "{}"));
        let runs = ["floor = 0.5\nseconds = 1.0", "floor = 0.5\nseconds = 2.0"];
        assert!(same("meta.toml", runs, "floor = 0.5\nseconds = 3.0"));
        assert!(!same("meta.toml", runs, "floor = 0.25\nseconds = 1.0"));
        assert!(same("x.exr", ["image"; 2], "image") && !same("x.exr", ["image"; 2], "imaga"));
        assert!(difference("x.exr", b"image", &[]).is_some());
        let report = |name: &str, time: &str| format!("<testcase name=\"{name}\" time=\"{time}\"/>");
        let runs = [&*report("a", "0.001"), &*report("a", "0.001")];
        assert!(same("j.xml", runs, &report("a", "0.013")));
        assert!(!same("j.xml", runs, &report("b", "0.001")));
        assert!(!same("j.xml", runs, &report("a", "no")));
        // The place is told.
        let runs = [point("0.5", "1.5"), point("0.5", "1.75")].map(String::into_bytes);
        assert_eq!(
            difference("c.json", point("0.25", "2").as_bytes(), &[&runs[0], &runs[1]]),
            Some("/points/0/rmse is 0.25 instead of 0.5".to_owned())
        );
        // Where all runs agree, so must the bytes.
        assert!(difference("c.json", b"{ }", &[&b"{}".to_vec()]).is_some());
    }
}
