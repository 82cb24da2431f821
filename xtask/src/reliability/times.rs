//! Files of two runs, compared without the times that they contain.

use super::{extension, is_whole};
use serde_json::Value;

/// Keys whose values depend on time, the load of the machine or its memory. Among them is the hash
/// of contents that have others.
const KEYS: [&str; 27] = [
    "affordable",
    "batch",
    "build_s",
    "build_seconds",
    "cpu",
    "cpu_seconds",
    "hash",
    "interval",
    "load",
    "memory",
    "memory_bytes",
    "noisy",
    "others",
    "pareto",
    "seconds",
    "spread",
    "time_to",
    "times",
    "used",
    "withheld",
    "mitsuba_s",
    "mrays_per_s",
    "ratio",
    "ratio_interval",
    "reference_s",
    "render_s",
    "whitstone_s",
];

/// A TOML file.
pub(super) fn table(bytes: &[u8]) -> Option<Value> {
    let table: toml::Table = toml::from_str(std::str::from_utf8(bytes).ok()?).ok()?;
    serde_json::to_value(table).ok()
}

/// A file without its times, as a text with all digits of its numbers.
fn timeless(name: &str, bytes: &[u8]) -> Option<String> {
    let mut value = match extension(name) {
        "json" => serde_json::from_slice(bytes).ok()?,
        "toml" => table(bytes)?,
        _ => return None,
    };
    strip(&mut value);
    Some(value.to_string())
}

fn strip(value: &mut Value) {
    match value {
        Value::Array(items) => items.iter_mut().for_each(strip),
        Value::Object(entries) => {
            entries.retain(|key, _| !KEYS.contains(&key.as_str()));
            entries.values_mut().for_each(strip);
        }
        _ => {}
    }
}

/// Whether a file is that of an undisturbed run, times excepted. A web page must be complete: its
/// numbers are those of a JSON file.
pub(super) fn is_same(name: &str, bytes: &[u8], undisturbed: Option<&Vec<u8>>) -> bool {
    let Some(expected) = undisturbed else {
        return false;
    };
    match timeless(name, expected) {
        Some(expected) => timeless(name, bytes) == Some(expected),
        None => is_whole(name, bytes, undisturbed),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_times_may_differ() {
        let same = |name, one: &str, other: &str| is_same(name, one.as_bytes(), Some(&other.into()));
        let point = |rmse: &str, seconds: &str| {
            format!(r#"{{"points": [{{"rmse": {rmse}, "seconds": {seconds}}}]}}"#)
        };
        let one = point("0.11301773271096931", "1.5");
        assert!(same("c.json", &one, &point("0.11301773271096931", "2.5")));
        // The next number.
        assert!(!same("c.json", &one, &point("0.11301773271096932", "1.5")));
        assert!(!same("c.json", &one, "{"));
        assert!(same(
            "meta.toml",
            "floor = 0.5\nseconds = 1.0",
            "floor = 0.5\nseconds = 2.0"
        ));
        assert!(!same("meta.toml", "floor = 0.5", "floor = 0.25"));
        assert!(same("x.exr", "image", "image") && !same("x.exr", "image", "imaga"));
        assert!(!is_same("x.exr", b"image", None));
    }
}
