//! What all runs have tried together, in a file.

use super::Run;
use crate::labels::grouped;
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::fs;
use std::path::Path;
use std::time::Duration;
use whitstone::Failure;
use whitstone::image::atomic;

/// The totals of a kind.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Total {
    executions: u64,
    /// Known for random scenes only, as is the number of valid ones.
    scenes: Option<u64>,
    valid: Option<u64>,
    seconds: u64,
    findings: u64,
    /// The first random scene that no run has reached.
    next: Option<u64>,
}

/// The totals of each kind.
#[derive(Debug, Default)]
pub(super) struct Totals(BTreeMap<String, Total>);

impl Totals {
    /// Those in a file; none if it does not exist.
    pub(super) fn read(path: &Path) -> Result<Self, Failure> {
        let bad = |problem: String| Failure::usage(format!("{}: {problem}", path.display()));
        match fs::read(path) {
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => Ok(Self::default()),
            Err(error) => Err(bad(error.to_string())),
            Ok(bytes) => {
                let value = serde_json::from_slice(&bytes).map_err(|error| bad(error.to_string()))?;
                Self::parse(&value).ok_or_else(|| bad("expected the totals of `fuzz --json`".to_owned()))
            }
        }
    }

    fn parse(value: &Value) -> Option<Self> {
        let kinds = value["kinds"].as_object()?.iter();
        let totals = kinds.map(|(kind, total)| {
            let number = |key: &str| total[key].as_u64();
            let total = Total {
                executions: number("executions")?,
                scenes: number("scenes"),
                valid: number("valid"),
                seconds: number("seconds")?,
                findings: number("findings")?,
                next: number("next"),
            };
            Some((kind.clone(), total))
        });
        Some(Self(totals.collect::<Option<_>>()?))
    }

    /// The first random scene that no run has reached.
    pub(super) fn next(&self, kind: &str) -> u64 {
        self.0.get(kind).and_then(|total| total.next).unwrap_or(0)
    }

    pub(super) fn add(&mut self, kind: &str, run: &Run, took: Duration) {
        let total = self.0.entry(kind.to_owned()).or_default();
        total.executions += run.executions;
        let sum = |before: Option<u64>, now: Option<u64>| match (before, now) {
            (None, None) => None,
            _ => Some(before.unwrap_or(0) + now.unwrap_or(0)),
        };
        total.scenes = sum(total.scenes, run.scenes);
        total.valid = sum(total.valid, run.valid);
        total.seconds += took.as_secs_f64().round() as u64;
        total.findings += run.findings as u64;
        // A run may have begun anywhere.
        total.next = total.next.max(run.next);
    }

    pub(super) fn write(&self, path: &Path) -> Result<(), Failure> {
        let kinds: BTreeMap<&String, Value> = (self.0.iter())
            .map(|(kind, total)| {
                let mut entry = json!({
                    "executions": total.executions, "seconds": total.seconds, "findings": total.findings,
                });
                for (key, value) in [
                    ("scenes", total.scenes),
                    ("valid", total.valid),
                    ("next", total.next),
                ] {
                    if let Some(value) = value {
                        entry[key] = value.into();
                    }
                }
                (kind, entry)
            })
            .collect();
        let text = serde_json::to_string_pretty(&json!({ "kinds": kinds })).map_err(Failure::environment)?;
        atomic::write_bytes(path, format!("{text}\n").as_bytes()).map_err(Failure::environment)
    }
}

/// The stored totals as a table; the last row has the sums of all kinds of files.
pub(crate) fn table(value: &Value) -> String {
    let mut page =
        "| kind | executions | scenes | valid | hours | findings |\n|---|---|---|---|---|---|\n".to_owned();
    let mut row = |kind: &str, [executions, seconds, findings]: [u64; 3], scenes: [Option<u64>; 2]| {
        let [scenes, valid] = scenes.map(|number| number.map_or_else(|| "–".to_owned(), grouped));
        let _ = writeln!(
            page,
            "| {kind} | {} | {scenes} | {valid} | {:.1} | {findings} |",
            grouped(executions),
            seconds as f64 / 3600.0,
        );
    };
    let mut files = [0; 3];
    for (kind, total) in value["kinds"].as_object().into_iter().flatten() {
        let number = |key: &str| total[key].as_u64();
        let counts = ["executions", "seconds", "findings"].map(|key| number(key).unwrap_or(0));
        row(&format!("`{kind}`"), counts, ["scenes", "valid"].map(number));
        if number("scenes").is_none() {
            files = std::array::from_fn(|index| files[index] + counts[index]);
        }
    }
    row("all kinds of files", files, [None; 2]);
    page
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn runs_add_up() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("fuzz.json");
        let run = |executions, valid, next| Run {
            executions,
            scenes: valid,
            valid,
            findings: 1,
            next,
        };
        for (executions, next) in [(10, 10), (5, 15), (7, 3)] {
            let mut totals = Totals::read(&path).unwrap();
            totals.add(
                "scenes",
                &run(executions, Some(3), Some(next)),
                Duration::from_millis(1800),
            );
            totals.add("ply", &run(1000, None, None), Duration::from_secs(3600));
            totals.write(&path).unwrap();
        }
        let totals = Totals::read(&path).unwrap();
        assert_eq!(totals.next("scenes"), 15);
        assert_eq!(totals.next("mitsuba"), 0);
        let stored = serde_json::from_slice(&fs::read(&path).unwrap()).unwrap();
        assert_eq!(
            table(&stored),
            "| kind | executions | scenes | valid | hours | findings |\n|---|---|---|---|---|---|\n\
             | `ply` | 3,000 | – | – | 3.0 | 3 |\n| `scenes` | 22 | 9 | 9 | 0.0 | 3 |\n\
             | all kinds of files | 3,000 | – | – | 3.0 | 3 |\n"
        );
        fs::write(&path, "{\"kinds\": {\"ply\": {\"executions\": 1}}}").unwrap();
        assert!(Totals::read(&path).is_err());
    }
}
