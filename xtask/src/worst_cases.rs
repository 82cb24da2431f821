//! Generates the tables of worst cases in `docs/accelerators.md` from the stored result of
//! `bench worst-cases`.

use crate::labels::grouped;
use serde_json::Value;
use std::fmt::Write as _;

/// The page that contains the tables.
pub(crate) const PAGE: &str = "docs/accelerators.md";
/// The result.
pub(crate) const RESULT: &str = "studies/results/worst_cases.json";

fn text<'v>(value: &'v Value, key: &str) -> &'v str {
    value[key].as_str().unwrap_or_default()
}

fn list<'v>(value: &'v Value, key: &str) -> &'v [Value] {
    value[key].as_array().map_or(&[], Vec::as_slice)
}

/// One table for each family.
pub(crate) fn tables(result: &Value) -> String {
    let mut page = format!(
        "Measured on {}, {}, load average\n\
         {:.1}, with {} rays, and {} triangles where the family does not vary their number.\n\
         The time of the structure that is chosen automatically is in bold. Embree has high quality and\n\
         single precision: with a large size or offset it traces rounded rays and triangles.\n",
        text(result, "processor"),
        text(result, "date"),
        result["load"].as_f64().unwrap_or(f64::NAN),
        result["rays"],
        result["triangles"],
    );
    for family in list(result, "families") {
        let steps = list(family, "steps");
        let mut names: Vec<&String> = steps
            .iter()
            .filter_map(|step| step["times"].as_object())
            .flat_map(|times| times.keys())
            .collect();
        names.sort();
        names.dedup();
        let _ = write!(
            page,
            "\n**{}**: {}\n\n| |",
            text(family, "family"),
            text(family, "parameter")
        );
        for name in &names {
            let _ = write!(page, " `{name}` |");
        }
        let _ = writeln!(page, "\n|{}", "---|".repeat(names.len() + 1));
        for step in steps {
            let _ = write!(page, "| {:e} |", step["parameter"].as_f64().unwrap_or(f64::NAN));
            for name in &names {
                match step["times"][name.as_str()]["ns"].as_f64() {
                    None => page.push_str(" – |"),
                    Some(time) if step["auto"] == name.as_str() => {
                        let _ = write!(page, " **{}** |", rounded(time));
                    }
                    Some(time) => {
                        let _ = write!(page, " {} |", rounded(time));
                    }
                }
            }
            page.push('\n');
        }
    }
    page
}

/// Nanoseconds with two digits.
fn rounded(time: f64) -> String {
    let unit = 10f64.powf(time.max(1.0).log10().floor() - 1.0).max(1.0);
    grouped(((time / unit).round() * unit) as u64)
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn the_choice_is_bold_and_what_is_missing_is_a_dash() {
        let result = json!({
            "processor": "P", "date": "D", "load": 0.25, "rays": 4, "triangles": 5,
            "families": [{ "family": "fan", "parameter": "x", "steps": [
                { "parameter": 10.0, "auto": "b", "times": { "a": { "ns": 1234.0 }, "b": { "ns": 56.4 } } },
                { "parameter": 1e3, "auto": "b", "times": { "b": { "ns": 7_651_234.0 } } },
            ] }],
        });
        let page = tables(&result);
        assert!(page.contains(
            "| | `a` | `b` |\n|---|---|---|\n| 1e1 | 1,200 | **56** |\n| 1e3 | – | **7,700,000** |\n"
        ));
    }
}
