//! The changes since an earlier run: compares results with older results.

use crate::{CaseResult, Results, Status};
use serde::Deserialize;
use std::collections::BTreeMap;

/// Errors with a smaller relative difference count as equal, because processors differ in their
/// order of rounding.
const SAME: f64 = 0.05;

/// The cases of an older `results.json`, with the fields that it has.
#[derive(Debug, Deserialize)]
pub struct Baseline {
    results: Vec<CaseResult>,
}

/// The changes since an earlier run.
#[derive(Debug, Default)]
pub struct Changes {
    /// The name of the older results.
    pub baseline: String,
    /// One row for each number that changed, the worst changes first.
    pub rows: Vec<Change>,
    /// Number of unchanged cases.
    pub same: usize,
}

/// A number that changed.
#[derive(Clone, Debug, PartialEq)]
pub struct Change {
    /// The scene of the case.
    pub scene: String,
    /// The name of the number.
    pub what: &'static str,
    /// The older value.
    pub before: String,
    /// The newer value.
    pub after: String,
    /// Whether it is better or worse.
    pub kind: Kind,
}

/// Whether a change is better or worse.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Kind {
    /// A case that passed now fails or is missing.
    Broken,
    /// A number became worse, within its limits or in a failing case.
    Worse,
    /// Any other difference.
    Other,
    /// Better, or new.
    Better,
}

impl Kind {
    /// The name of the kind.
    pub fn name(self) -> &'static str {
        match self {
            Self::Broken => "broken",
            Self::Worse => "worse",
            Self::Other => "changed",
            Self::Better => "better",
        }
    }
}

impl Changes {
    /// The changes from an older run, called `name`, to a newer one. Cases are matched by scene,
    /// configuration and reference renderer. Times are ignored, because they depend on the machine.
    pub fn between(name: String, old: &Baseline, new: &Results) -> Self {
        let before: BTreeMap<_, &CaseResult> = old.results.iter().map(|case| (key(case), case)).collect();
        let mut rows = Vec::new();
        let mut same = 0;
        let mut seen = Vec::new();
        for case in &new.results {
            seen.push(key(case));
            let found = match before.get(&key(case)) {
                Some(old) => changes(old, case),
                None => vec![change(case, "the case", "–", "new", Kind::Better)],
            };
            same += usize::from(found.is_empty());
            rows.extend(found);
        }
        let gone = before.iter().filter(|(key, _)| !seen.contains(key));
        rows.extend(gone.map(|(_, case)| change(case, "the case", status(case), "gone", Kind::Broken)));
        rows.sort_by_key(|row| row.kind);
        Self {
            baseline: name,
            rows,
            same,
        }
    }

    /// The number of cases that passed and do not pass any more.
    pub fn broken(&self) -> usize {
        self.rows.iter().filter(|row| row.kind == Kind::Broken).count()
    }
}

type Key = (String, String, String);

fn key(case: &CaseResult) -> Key {
    let reference = case.reference.as_ref();
    (
        case.scene.clone(),
        case.config.clone(),
        // A case that was not compared has no reference: it matches any.
        reference.map_or_else(String::new, |reference| reference.name.clone()),
    )
}

fn status(case: &CaseResult) -> &'static str {
    case.status.unwrap_or(Status::Undecided).word()
}

fn change(
    case: &CaseResult,
    what: &'static str,
    before: impl Into<String>,
    after: impl Into<String>,
    kind: Kind,
) -> Change {
    Change {
        scene: case.scene.clone(),
        what,
        before: before.into(),
        after: after.into(),
        kind,
    }
}

fn changes(old: &CaseResult, new: &CaseResult) -> Vec<Change> {
    let mut found = Vec::new();
    if old.status != new.status {
        let kind = match new.status {
            Some(Status::Pass) => Kind::Better,
            Some(Status::Confirmed) => Kind::Other,
            _ => Kind::Broken,
        };
        found.push(change(new, "verdict", status(old), status(new), kind));
    }
    let worse = |more: bool| if more { Kind::Worse } else { Kind::Better };
    let errors = [
        ("interior error", old.rel_rmse_interior, new.rel_rmse_interior),
        ("RMSE", old.rmse, new.rmse),
        ("floor", Some(old.floor), Some(new.floor)),
        ("limit", Some(old.limit), Some(new.limit)),
    ];
    for (what, before, after) in errors {
        let (from, to) = (before.unwrap_or(0.0), after.unwrap_or(0.0));
        if before.is_some() == after.is_some() && (from - to).abs() <= SAME * from.abs().max(to.abs()) {
            continue;
        }
        let text = |value: Option<f64>| value.map_or_else(|| "–".to_owned(), |value| format!("{value:.2e}"));
        let kind = match what {
            "interior error" | "RMSE" => worse(after.is_none() || to > from),
            _ => Kind::Other,
        };
        found.push(change(new, what, text(before), text(after), kind));
    }
    let counts = [
        (
            "pixels over tolerance",
            old.pixels_over_tolerance,
            new.pixels_over_tolerance,
        ),
        ("pixels unexplained", old.unexplained, new.unexplained),
        ("values not finite", old.nonfinite, new.nonfinite),
    ];
    for (what, before, after) in counts.into_iter().filter(|(_, before, after)| before != after) {
        found.push(change(
            new,
            what,
            before.to_string(),
            after.to_string(),
            worse(after > before),
        ));
    }
    let version = |case: &CaseResult| {
        let told = |r: &crate::Reference| format!("{} {}, {}, {}", r.name, r.version, r.variant, r.source);
        case.reference.as_ref().map_or_else(|| "none".to_owned(), told)
    };
    let others = [
        ("reference", version(old), version(new)),
        ("twin", old.twin.clone(), new.twin.clone()),
        ("size", size(old), size(new)),
        ("skipped work", old.omitted.join("; "), new.omitted.join("; ")),
        ("plugins", old.plugins.join(", "), new.plugins.join(", ")),
    ];
    for (what, before, after) in others.into_iter().filter(|(_, before, after)| before != after) {
        found.push(change(new, what, before, after, Kind::Other));
    }
    found
}

fn size(case: &CaseResult) -> String {
    format!("{} x {}, {} per pixel", case.width, case.height, case.samples)
}

#[cfg(test)]
mod tests {
    use super::super::tests::{example, results};
    use super::*;

    fn old(change: impl FnOnce(&mut Vec<CaseResult>)) -> Baseline {
        let mut cases = example().results;
        change(&mut cases);
        // As read from a file.
        let text = serde_json::to_string(&results(cases, "live")).unwrap();
        serde_json::from_str(&text).unwrap()
    }

    #[test]
    fn the_same_run_has_changed_nothing() {
        let changes = Changes::between("old".to_owned(), &old(|_| {}), &example());
        assert_eq!(
            (changes.rows, changes.same),
            (Vec::new(), example().results.len())
        );
    }

    #[test]
    fn each_change_is_told_and_weighed() {
        type Alter = fn(&mut Vec<CaseResult>);
        let alter: [(Alter, &str, Kind); 8] = [
            (
                |cases| cases[2].status = Some(Status::Pass),
                "verdict",
                Kind::Broken,
            ),
            (
                |cases| cases[0].status = Some(Status::Fail),
                "verdict",
                Kind::Better,
            ),
            (
                |cases| cases[0].rel_rmse_interior = Some(1e-7),
                "interior error",
                Kind::Worse,
            ),
            (
                |cases| cases[0].rel_rmse_interior = Some(1e-6),
                "interior error",
                Kind::Better,
            ),
            (
                |cases| cases[0].rel_rmse_interior = None,
                "interior error",
                Kind::Better,
            ),
            (
                |cases| cases[1].unexplained = 3,
                "pixels unexplained",
                Kind::Better,
            ),
            (|cases| cases[1].omitted.clear(), "skipped work", Kind::Other),
            (|cases| cases[1].twin = "hosted".to_owned(), "twin", Kind::Other),
        ];
        for (alter, what, kind) in alter {
            let changes = Changes::between(String::new(), &old(alter), &example());
            let found: Vec<_> = changes.rows.iter().map(|row| (row.what, row.kind)).collect();
            let expected = match what {
                // No value is neither larger nor smaller than one.
                "interior error" => found.iter().any(|row| row.0 == what),
                _ => found == [(what, kind)],
            };
            assert!(expected, "{what}: {found:?}");
            assert_eq!(changes.broken(), usize::from(kind == Kind::Broken));
        }
    }

    #[test]
    fn cases_come_and_go_and_small_changes_are_none() {
        let changes = Changes::between(String::new(), &old(|cases| drop(cases.remove(0))), &example());
        assert_eq!(changes.rows[0].after, "new");
        let more = |cases: &mut Vec<CaseResult>| {
            cases[0].rel_rmse_interior = cases[0].rel_rmse_interior.map(|value| value * 1.04);
            cases.push(CaseResult {
                scene: "shapes/gone".to_owned(),
                ..CaseResult::default()
            });
        };
        let changes = Changes::between(String::new(), &old(more), &example());
        assert_eq!((changes.rows.len(), changes.broken()), (1, 1));
        assert_eq!(
            (changes.rows[0].scene.as_str(), changes.rows[0].after.as_str()),
            ("shapes/gone", "gone")
        );
    }

    #[test]
    fn results_of_old_versions_are_read() {
        let text = r#"{"results": [{"scene": "shapes/sphere", "config": "default", "status": "pass"}]}"#;
        let old: Baseline = serde_json::from_str(text).unwrap();
        assert_eq!(old.results[0].scene, "shapes/sphere");
    }
}
