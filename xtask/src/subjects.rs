//! Writes what `conventions` finds in the renderers of `subjects` into docs/subjects.md, from its
//! stored results.

use serde_json::Value;
use std::fmt::Write as _;

/// The page that has the table, between its markers.
pub(crate) const PAGE: &str = "docs/subjects.md";
/// What the names of the stored results begin with.
pub(crate) const RESULTS: &str = "conventions-";
/// The markers.
pub(crate) const MARKS: (&str, &str) = (
    "<!-- conventions: written by `cargo xtask readme` -->",
    "<!-- end of conventions -->",
);

fn entries<'v>(result: &'v Value, list: &str) -> impl Iterator<Item = (&'v str, &'v Value)> {
    let entries = result["conventions"][list].as_array().into_iter().flatten();
    entries.map(|entry| (entry[0].as_str().unwrap_or_default(), &entry[1]))
}

/// One row for each result, and one column for each probe that any of them has.
pub(crate) fn table(results: &[Value]) -> String {
    let mut probes: Vec<&str> = Vec::new();
    for (probe, _) in results.iter().flat_map(|result| entries(result, "errors")) {
        if !probes.contains(&probe) {
            probes.push(probe);
        }
    }
    let mut text = format!(
        "| subject | findings | {} | shadow rays start |\n",
        probes.join(" | ")
    );
    let _ = writeln!(text, "|{}", "---|".repeat(probes.len() + 3));
    for result in results {
        let findings = result["conventions"]["findings"].as_array();
        let name = result["subject"].as_str().unwrap_or_default();
        let _ = write!(text, "| `{name}` | {} |", findings.map_or(0, Vec::len));
        for probe in &probes {
            let error = entries(result, "errors").find(|(name, _)| name == probe);
            match error.and_then(|(_, error)| error.as_f64()) {
                Some(error) => {
                    let _ = write!(text, " {error:.0e} |");
                }
                None => text.push_str(" – |"),
            }
        }
        let spawn = entries(result, "measured").find(|(name, _)| *name == "spawn offset");
        let words = spawn.and_then(|(_, words)| words.as_str()).unwrap_or("–");
        let words = words.strip_prefix("shadow rays start ").unwrap_or(words);
        let _ = writeln!(text, " {words} |");
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn a_probe_that_is_skipped_has_no_number() {
        let result = |name: &str, errors: Value| {
            json!({ "subject": name, "conventions": {
                "findings": [],
                "errors": errors,
                "measured": [["spawn offset", "shadow rays start 1e-3 m along the ray"]],
            } })
        };
        let results = [
            result("a", json!([["glass", 1.2e-5]])),
            result("b", json!([["a spot", 3e-4], ["glass", 2e-4]])),
        ];
        assert_eq!(
            table(&results),
            "| subject | findings | glass | a spot | shadow rays start |\n\
             |---|---|---|---|---|\n\
             | `a` | 0 | 1e-5 | – | 1e-3 m along the ray |\n\
             | `b` | 0 | 2e-4 | 3e-4 | 1e-3 m along the ray |\n"
        );
    }
}
