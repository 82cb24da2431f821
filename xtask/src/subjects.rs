//! Writes into docs/subjects.md what `validate` and `conventions` find in the renderers of
//! `subjects`, from their stored results.

use crate::bench::machine;
use clap::Args;
use serde_json::{Map, Value, json};
use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::PathBuf;
use whitstone::image::atomic;
use whitstone::validate::Status;
use whitstone::{Exit, Failure};

/// The page that has the table, between its markers.
pub(crate) const PAGE: &str = "docs/subjects.md";
/// The stored result of `validate`.
pub(crate) const VALIDATED: &str = "studies/results/subjects.json";
/// The markers of its table.
pub(crate) const VALIDATED_MARKS: (&str, &str) = (
    "<!-- validation: written by `cargo xtask readme` -->",
    "<!-- end of validation -->",
);
/// What the names of the stored results of `conventions` begin with.
pub(crate) const RESULTS: &str = "conventions-";
/// The markers.
pub(crate) const MARKS: (&str, &str) = (
    "<!-- conventions: written by `cargo xtask readme` -->",
    "<!-- end of conventions -->",
);

/// Store the results of `validate` for several subjects
///
/// Keeps verdict and error of each scene in studies/results/subjects.json. `cargo xtask readme`
/// writes them into docs/subjects.md.
#[derive(Args, Debug)]
#[command(
    help_template = whitstone::commands::HELP_TEMPLATE,
    after_help = "Example:\n  cargo xtask validate scenes/shapes --subject cycles --subject povray --config subjects/whitstone.toml --json comparison.json\n  cargo xtask subjects comparison.json"
)]
pub(crate) struct Arguments {
    /// The file that `validate --subject NAME --subject NAME --json FILE` has written
    file: PathBuf,
}

/// Runs the command.
pub(crate) fn run(arguments: &Arguments) -> Result<Exit, Failure> {
    let failed = |why: String| Failure::usage(format!("{}: {why}", arguments.file.display()));
    let text = std::fs::read(&arguments.file).map_err(|error| failed(error.to_string()))?;
    let comparison: Value = serde_json::from_slice(&text).map_err(|error| failed(error.to_string()))?;
    let found = condensed(&comparison, &machine::date()).ok_or_else(|| {
        failed("expected the results of several subjects, as `validate --json` writes them".to_owned())
    })?;
    let mut all: Map<String, Value> = match std::fs::read(VALIDATED) {
        Ok(text) => serde_json::from_slice(&text).map_err(Failure::environment)?,
        Err(_) => Map::new(),
    };
    all.extend(found);
    let text = format!("{:#}\n", Value::Object(all));
    atomic::write_bytes(VALIDATED, text.as_bytes()).map_err(Failure::environment)?;
    println!("{VALIDATED}");
    Ok(Exit::Pass)
}

/// Verdict and error of every scene that was compared, by subject.
fn condensed(comparison: &Value, date: &str) -> Option<Map<String, Value>> {
    let mut subjects = Map::new();
    for subject in comparison["subjects"].as_array()? {
        let mut scenes = Map::new();
        for case in subject["results"].as_array()? {
            let scene = json!({
                "verdict": case["status"],
                "rmse": case["rmse"],
                "explained": case["explained"],
            });
            scenes.insert(case["scene"].as_str()?.to_owned(), scene);
        }
        let entry = json!({ "date": date, "scenes": scenes });
        subjects.insert(subject["name"].as_str()?.to_owned(), entry);
    }
    Some(subjects)
}

/// The verdict of a scene.
fn verdict(scene: &Value) -> Option<Status> {
    serde_json::from_value(scene["verdict"].clone()).ok()
}

fn is_right(scene: &Value) -> bool {
    verdict(scene).is_some_and(Status::is_right)
}

fn short(error: f64) -> String {
    if error == 0.0 {
        "0".to_owned()
    } else {
        format!("{error:.0e}")
    }
}

/// How many scenes pass, and with which errors.
pub(crate) fn validated(stored: &Value) -> String {
    let mut text =
        "| subject | measured | scenes that pass | RMSE | with explained pixels | undecided | wrong |\n\
        |---|---|---|---|---|---|---|\n"
            .to_owned();
    // Sorted, because the order of a JSON object depends on how this program was built.
    let subjects: BTreeMap<_, _> = stored.as_object().into_iter().flatten().collect();
    for (name, subject) in subjects {
        let date = subject["date"].as_str().unwrap_or_default();
        let scenes = || subject["scenes"].as_object().into_iter().flatten();
        let range = |explained: bool| {
            let errors = scenes()
                .filter(|(_, scene)| is_right(scene) && (scene["explained"].as_u64() > Some(0)) == explained)
                .filter_map(|(_, scene)| scene["rmse"].as_f64());
            let (least, most) = errors.fold((f64::INFINITY, 0.0_f64), |(least, most), error| {
                (least.min(error), most.max(error))
            });
            match least <= most {
                true => format!("{} to {}", short(least), short(most)),
                false => "–".to_owned(),
            }
        };
        let having = |status: Status| scenes().filter(move |(_, scene)| verdict(scene) == Some(status));
        let wrong: Vec<String> = having(Status::Fail)
            .map(|(scene, _)| format!("`{scene}`"))
            .collect();
        let _ = writeln!(
            text,
            "| `{name}` | {date} | {} of {} | {} | {} | {} | {} |",
            scenes().filter(|(_, scene)| is_right(scene)).count(),
            scenes().count(),
            range(false),
            range(true),
            having(Status::Undecided).count(),
            if wrong.is_empty() {
                "–".to_owned()
            } else {
                wrong.join(", ")
            },
        );
    }
    text
}

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
    fn scenes_that_pass_are_counted() {
        let case = |scene: &str, status: &str, rmse: f64, explained: u32| json!({ "scene": scene, "status": status, "rmse": rmse, "explained": explained });
        let results = [
            case("a", "pass", 1e-6, 0),
            case("b", "confirmed", 2e-5, 0),
            case("c", "pass", 1e-3, 2),
            case("d", "fail", 0.1, 0),
            case("e", "undecided", 0.1, 0),
        ];
        let stored = condensed(
            &json!({ "subjects": [{ "name": "n", "results": results }] }),
            "2000-01-01",
        )
        .unwrap();
        assert!(
            validated(&Value::Object(stored))
                .ends_with("| `n` | 2000-01-01 | 3 of 5 | 1e-6 to 2e-5 | 1e-3 to 1e-3 | 1 | `d` |\n")
        );
        assert_eq!(condensed(&json!({ "results": results }), ""), None);
    }

    /// The page explains each scene that is wrong, in the paragraph of the renderer.
    #[test]
    fn wrong_scenes_are_explained() {
        let root = concat!(env!("CARGO_MANIFEST_DIR"), "/../");
        let read = |path: &str| std::fs::read_to_string(format!("{root}{path}")).unwrap();
        let page = read(PAGE);
        let plain = |title: &str| -> String {
            let letters = title.chars().filter(char::is_ascii_alphanumeric);
            letters.map(|letter| letter.to_ascii_lowercase()).collect()
        };
        let paragraphs: Vec<(String, &str)> = (page.split("\n- **").skip(1))
            .filter_map(|text| text.split_once("**"))
            .map(|(title, text)| (plain(title), text))
            .collect();
        let stored: Value = serde_json::from_str(&read(VALIDATED)).unwrap();
        for (name, subject) in stored.as_object().unwrap() {
            let paragraph = paragraphs.iter().find(|(title, _)| title == name);
            let text = paragraph.map_or("", |(_, text)| text);
            for (scene, result) in subject["scenes"].as_object().unwrap() {
                assert!(
                    verdict(result) != Some(Status::Fail) || text.contains(&format!("`{scene}`")),
                    "{name}: {scene}"
                );
            }
        }
    }

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
