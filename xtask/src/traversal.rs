//! Generates the tables of ray rates in `docs/accelerators.md` from the stored results of `bench
//! accelerators`.

use crate::run_time::wrapped;
use serde_json::Value;
use std::fmt::Write as _;

/// Prefix of the names of the results, by machine and instruction set.
pub(crate) const RESULTS: &str = "accelerators-";

/// The accelerator whose rates are shown for each mesh.
const SHOWN: &str = "bvh:best";
const SETS: [&str; 3] = ["primary", "shadow", "bounce"];

fn text<'v>(value: &'v Value, key: &str) -> &'v str {
    value[key].as_str().unwrap_or_default()
}

fn name(row: &Value) -> String {
    match row["quality"].as_str() {
        None | Some("") => text(row, "accelerator").to_owned(),
        Some(quality) => format!("{}:{quality}", text(row, "accelerator")),
    }
}

/// The different values, in the order of their first occurrence.
fn different(values: impl Iterator<Item = String>) -> Vec<String> {
    let mut all: Vec<String> = Vec::new();
    for value in values {
        if !all.contains(&value) {
            all.push(value);
        }
    }
    all
}

/// Geometric mean of the ratios to Embree over the rows of an accelerator in a mode and some sets.
fn mean(rows: &[Value], accelerator: &str, mode: &str, sets: &[&str]) -> Option<f64> {
    let ratios: Vec<f64> = rows
        .iter()
        .filter(|row| name(row) == accelerator && row["mode"] == mode && sets.contains(&text(row, "set")))
        .filter_map(|row| row["ratio_to_embree"].as_f64())
        .collect();
    let sum: f64 = ratios.iter().map(|ratio| ratio.ln()).sum();
    (!ratios.is_empty()).then(|| (sum / ratios.len() as f64).exp())
}

fn both(rows: &[Value], accelerator: &str, sets: &[&str]) -> String {
    let of = |mode| {
        mean(rows, accelerator, mode, sets).map_or_else(|| "–".to_owned(), |mean| format!("{mean:.2}"))
    };
    format!("{} / {}", of("single"), of("batch"))
}

/// The tables of one result.
fn tables(result: &Value) -> String {
    let rows = result["rows"].as_array().map_or(&[][..], Vec::as_slice);
    let version = text(&result["summary"], "embree_version");
    let answers: u64 = rows.iter().filter_map(|row| row["rays"].as_u64()).sum();
    let wrong: u64 = rows.iter().filter_map(|row| row["mismatches"].as_u64()).sum();
    let mut page = wrapped(&format!(
        "**{}, {}**, {}, load average {:.1}, medians of {} rounds, Embree {version} at quality HIGH. Of {answers} answers {wrong} differ from those of `bvh2`.",
        text(result, "processor"),
        text(result, "simd"),
        text(result, "date"),
        result["load"].as_f64().unwrap_or(f64::NAN),
        result["rounds"],
    ));
    page.push_str("\n\n| `bvh`, `quality = \"best\"` | primary | shadow | bounce | build, s | bytes a triangle |\n|---|---|---|---|---|---|\n");
    for mesh in different(rows.iter().map(|row| text(row, "mesh").to_owned())) {
        let of_mesh = || {
            rows.iter()
                .filter(|row| text(row, "mesh") == mesh && name(row) == SHOWN)
        };
        let _ = write!(page, "| {mesh} |");
        for set in SETS {
            let cell = |mode: &str| {
                let row = of_mesh().find(|row| row["set"] == set && row["mode"] == mode);
                row.map_or_else(String::new, |row| {
                    let rate = row["mrays_per_s"].as_f64().unwrap_or(f64::NAN);
                    match row["ratio_to_embree"].as_f64() {
                        Some(ratio) => format!("{rate:.1}, {ratio:.2}"),
                        None => format!("{rate:.1}"),
                    }
                })
            };
            let _ = write!(page, " {} / {} |", cell("single"), cell("batch"));
        }
        if let Some(row) = of_mesh().next() {
            let number = |key: &str| row[key].as_f64().unwrap_or(f64::NAN);
            let _ = write!(
                page,
                " {:.3} | {:.1} |",
                number("build_s"),
                number("bytes_per_triangle")
            );
        }
        page.push('\n');
    }
    page.push_str("\n| ratios to Embree, mean | primary | shadow | bounce | all |\n|---|---|---|---|---|\n");
    for accelerator in different(rows.iter().map(name)) {
        let _ = write!(page, "| `{accelerator}` |");
        for set in SETS {
            let _ = write!(page, " {} |", both(rows, &accelerator, &[set]));
        }
        let _ = writeln!(page, " {} |", both(rows, &accelerator, &SETS));
    }
    page
}

/// The tables of all results.
pub(crate) fn section(results: &[Value]) -> String {
    results.iter().map(tables).collect::<Vec<_>>().join("\n")
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn means_are_geometric_and_of_one_accelerator() {
        let row = |quality: &str, mode: &str, set: &str, ratio: f64| {
            json!({
                "accelerator": "bvh", "quality": quality, "mode": mode, "mesh": "bunny", "set": set, "rays": 10,
                "mrays_per_s": 3.0, "ratio_to_embree": ratio, "build_s": 0.5, "bytes_per_triangle": 50.0, "mismatches": 0,
            })
        };
        let result = json!({
            "processor": "P", "simd": "S", "date": "D", "load": 0.5, "rounds": 3, "summary": { "embree_version": "3" },
            "rows": [
                row("best", "single", "primary", 1.0), row("best", "batch", "primary", 2.0),
                row("best", "single", "shadow", 4.0), row("", "single", "primary", 9.0),
            ],
        });
        let page = section(&[result]);
        assert!(
            page.contains("| `bvh:best` | 1.00 / 2.00 | 4.00 / – | – / – | 2.00 / 2.00 |"),
            "{page}"
        );
        assert!(page.contains("| `bvh` | 9.00 / – |"), "{page}");
        assert!(page.contains("| bunny | 3.0, 1.00 / 3.0, 2.00 |"), "{page}");
        assert!(page.contains("Of 40 answers 0 differ"), "{page}");
    }
}
