//! The cells of the settings matrix, their counts, and their groups for printing.

use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// The comparison for settings that must not change the picture.
pub const OWN: &str = "own picture";

/// One setting of a scene, or a sweep that the scene does not need.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Cell {
    /// Path of the scene below `scenes/`, without `.toml`.
    pub scene: String,
    /// The swept parameter: "accelerator", "threads", "max_depth" or "filter".
    pub axis: String,
    /// The setting; "all" if the whole sweep is skipped.
    pub setting: String,
    /// The outcome.
    pub outcome: Outcome,
    /// The picture that it was compared with: [`OWN`], or the reference; empty if it was skipped.
    pub against: String,
    /// The findings, or why it was skipped.
    pub detail: String,
}

/// The outcome of a cell.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Outcome {
    /// The check passed.
    Pass,
    /// The check failed, or the setting cannot be rendered.
    Fail,
    /// The setting was skipped.
    Skipped,
}

/// The number of cells of each outcome.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Tally {
    /// Number of cells that passed.
    pub passed: usize,
    /// Number of cells that failed.
    pub failed: usize,
    /// Number of skipped cells; a whole sweep counts once.
    pub skipped: usize,
}

impl Tally {
    /// Counts some cells.
    pub fn of(cells: &[Cell]) -> Self {
        let count = |outcome| cells.iter().filter(|cell| cell.outcome == outcome).count();
        Self {
            passed: count(Outcome::Pass),
            failed: count(Outcome::Fail),
            skipped: count(Outcome::Skipped),
        }
    }
}

/// The cells of one sweep of one scene, for printing.
#[derive(Debug, PartialEq, Eq)]
pub struct Row<'a> {
    /// The scene.
    pub scene: &'a str,
    /// The swept parameter.
    pub axis: &'a str,
    /// The picture that the cells were compared with.
    pub against: &'a str,
    /// Settings that passed.
    pub passed: Vec<&'a str>,
    /// Settings that failed, and the findings.
    pub failed: Vec<(&'a str, &'a str)>,
    /// Skipped settings, grouped by reason.
    pub skipped: Vec<(String, &'a str)>,
}

/// Groups the cells by scene and sweep, in order.
pub fn rows(cells: &[Cell]) -> Vec<Row<'_>> {
    let same = |a: &Cell, b: &Cell| a.scene == b.scene && a.axis == b.axis;
    let groups = cells.chunk_by(same);
    groups.map(row).collect()
}

fn row(cells: &[Cell]) -> Row<'_> {
    let of = |outcome| cells.iter().filter(move |cell| cell.outcome == outcome);
    let mut skipped: BTreeMap<&str, Vec<&str>> = BTreeMap::new();
    for cell in of(Outcome::Skipped) {
        skipped.entry(&cell.detail).or_default().push(&cell.setting);
    }
    Row {
        scene: &cells[0].scene,
        axis: &cells[0].axis,
        against: cells.iter().map(|cell| &*cell.against).max().unwrap_or_default(),
        passed: of(Outcome::Pass).map(|cell| &*cell.setting).collect(),
        failed: of(Outcome::Fail)
            .map(|cell| (&*cell.setting, &*cell.detail))
            .collect(),
        skipped: skipped
            .into_iter()
            .map(|(why, settings)| (settings.join(", "), why))
            .collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cells_of_a_sweep_are_one_row() {
        let cell = |axis: &str, setting: &str, outcome, detail: &str| Cell {
            scene: "a".to_owned(),
            axis: axis.to_owned(),
            setting: setting.to_owned(),
            outcome,
            against: if outcome == Outcome::Skipped {
                ""
            } else {
                "own picture"
            }
            .to_owned(),
            detail: detail.to_owned(),
        };
        let cells = [
            cell("accelerator", "bvh", Outcome::Pass, "bit-identical"),
            cell("accelerator", "grid", Outcome::Fail, "3 pixels"),
            cell("accelerator", "x", Outcome::Skipped, "expensive"),
            cell("accelerator", "y", Outcome::Skipped, "expensive"),
            cell("filter", "all", Outcome::Skipped, "no texture"),
        ];
        let found = rows(&cells);
        assert_eq!(found.len(), 2);
        assert_eq!((found[0].axis, found[0].against), ("accelerator", "own picture"));
        assert_eq!(found[0].passed, ["bvh"]);
        assert_eq!(found[0].failed, [("grid", "3 pixels")]);
        assert_eq!(found[0].skipped, [("x, y".to_owned(), "expensive")]);
        assert_eq!(found[1].skipped, [("all".to_owned(), "no texture")]);
        let tally = Tally {
            passed: 1,
            failed: 1,
            skipped: 3,
        };
        assert_eq!(Tally::of(&cells), tally);
    }
}
