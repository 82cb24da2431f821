//! The report for people: one HTML file without external parts.
//!
//! `page.html` and `case.html` are its templates, compiled and escaped by `askama`. `view` converts
//! results to the data of the templates. `page.css` and the scripts are embedded unchanged. The
//! page is readable without scripts. They sort (`sort.js`), filter and copy (`page.js`), display
//! pixels in other ways than the pictures (`viewer.js`) and highlight the points of diagrams
//! (`studies.js`).
//!
//! `comparison` is the page for several subjects, `review` that of `compare --review`, which loads
//! the pictures of a pair when it is opened.

mod case;
mod changes;
mod comparison;
mod extras;
mod number;
mod review;
mod script;
mod view;

#[cfg(test)]
pub(crate) mod tests;

pub use changes::{Baseline, Change, Changes, Kind};
pub use comparison::{Compared, Comparison, NamedResults, Pair};
pub use extras::{Diagram, Extras};
pub use review::{ReviewDetails, ReviewPixel, ReviewRow, compare_page, review_details, review_page};
pub use script::drawing;

use crate::matrix::{Cell, Tally};
use crate::{CaseResult, Results, Summary};
use std::collections::{BTreeMap, BTreeSet};
use view::{Page, PageKind};

/// Maximum number of cases on one page. With more, each scene gets its own page.
pub const ON_ONE_PAGE: usize = 150;

/// The page of all scenes.
const INDEX: &str = "index.html";
/// Folder of the pages of scenes, next to it.
pub const SCENES: &str = "scenes";

/// The complete page, without anything from a network, to be opened from disk.
pub fn html(results: &Results, extras: &Extras) -> String {
    Page::new(results, extras, PageKind::Whole).to_string()
}

/// The files of a report by path: a single page, or for more than [`ON_ONE_PAGE`] cases an index
/// and a page for each scene.
pub fn pages(results: &Results, extras: &Extras) -> Vec<(String, String)> {
    if results.results.len() <= ON_ONE_PAGE {
        return vec![(INDEX.to_owned(), html(results, extras))];
    }
    let paths = paths(results);
    let index = Page::new(results, extras, PageKind::Index(&paths)).to_string();
    let up = format!("../{INDEX}");
    let scene_extras = Extras {
        sensitivity: extras.sensitivity.clone(),
        ..Extras::default()
    };
    let scenes = paths.iter().map(|(scene, path)| {
        let page = Page::new(&of_scene(results, scene), &scene_extras, PageKind::Scene(&up)).to_string();
        (path.clone(), page)
    });
    std::iter::once((INDEX.to_owned(), index)).chain(scenes).collect()
}

/// A path for each scene: its name, with only those characters that every file system supports.
fn paths(results: &Results) -> BTreeMap<&str, String> {
    let mut taken = BTreeSet::new();
    let mut paths = BTreeMap::new();
    for case in &results.results {
        paths.entry(case.scene.as_str()).or_insert_with(|| {
            let plain = |c: char| {
                if c.is_ascii_alphanumeric() || c == '_' {
                    c
                } else {
                    '-'
                }
            };
            let name: String = case.scene.chars().map(plain).collect();
            let mut path = format!("{SCENES}/{name}.html");
            let mut number = 1;
            while !taken.insert(path.to_lowercase()) {
                number += 1;
                path = format!("{SCENES}/{name}-{number}.html");
            }
            path
        });
    }
    paths
}

/// The part of the results that belongs to one scene.
fn of_scene(results: &Results, scene: &str) -> Results {
    let cases: Vec<CaseResult> = results
        .results
        .iter()
        .filter(|case| case.scene == scene)
        .cloned()
        .collect();
    let matrix: Vec<Cell> = results
        .matrix
        .iter()
        .filter(|cell| cell.scene == scene)
        .cloned()
        .collect();
    let seconds = cases.iter().map(|case| case.build_s + case.render_s).sum();
    let mut summary = Summary::of(&cases, results.summary.references.clone(), seconds);
    summary.matrix = Tally::of(&matrix);
    Results {
        summary,
        provenance: results.provenance.clone(),
        results: cases,
        skipped: Vec::new(),
        matrix,
    }
}
