//! The view of the results that the templates render.

use super::case::{CaseView, PICTURE_WIDTH, data_uri, failed, reference_name};
use super::changes::{Changes, Kind};
use super::extras::{Diagram, Extras};
use super::number::{Number, short};
use super::script::{drawing, plugins};
use crate::matrix::{Row, Tally, rows};
use crate::pixels::ERROR_VIEW;
use crate::{CaseResult, Provenance, Results, SkippedScene, Status, counted};
use askama::Template;
use std::collections::{BTreeMap, BTreeSet};
use whitstone_metrics::Tolerance;
use whitstone_metrics::error_map::legend;

/// The style of all pages.
pub(super) const STYLE: &str = include_str!("page.css");
/// Sorts tables.
pub(super) const SORT: &str = include_str!("sort.js");

/// The whole page.
#[derive(Template)]
#[template(path = "page.html", config = "src/report/askama.toml")]
pub(super) struct Page<'a> {
    style: &'static str,
    scripts: [&'static str; 4],
    verdict: Verdict,
    tiles: Vec<Tile>,
    references: &'a str,
    live: bool,
    provenance: Vec<(&'static str, String)>,
    tolerance: String,
    scale: ScaleView,
    /// The data with which the script draws error pictures, as JSON.
    drawing: String,
    /// By family, for the filter.
    plugins: BTreeMap<&'a str, BTreeSet<&'a str>>,
    columns: &'static [Column],
    cases: Vec<CaseView<'a>>,
    skipped: &'a [SkippedScene],
    matrix: Vec<Row<'a>>,
    sections: Vec<Section<'a>>,
    changes: Option<&'a Changes>,
    kind: PageKind<'a>,
}

/// The part of a report that a page contains.
#[derive(Clone, Copy, Debug)]
pub(super) enum PageKind<'a> {
    /// The whole report.
    Whole,
    /// The tables. Cases are on pages of their own; the map has their paths by scene.
    Index(&'a BTreeMap<&'a str, String>),
    /// The cases of a scene, with the path of the index.
    Scene(&'a str),
}

/// A kind of diagrams.
struct Section<'a> {
    id: &'static str,
    heading: &'static str,
    note: &'static str,
    /// Whether each is initially open.
    open: bool,
    diagrams: &'a [Diagram],
}

/// The headline of the page.
struct Verdict {
    passed: bool,
    text: String,
}

/// A number of the header.
struct Tile {
    label: &'static str,
    value: Number,
    bad: bool,
}

/// The colours of the error pictures.
pub(super) struct ScaleView {
    /// Its strip is at the top.
    pub(super) legend: String,
    pub(super) low: String,
    pub(super) middle: String,
    pub(super) high: String,
}

impl ScaleView {
    pub(super) fn new() -> Self {
        let (low, high) = ERROR_VIEW.scale.ends();
        Self {
            legend: legend(ERROR_VIEW.scale, PICTURE_WIDTH)
                .ok()
                .and_then(|raster| raster.to_png().ok())
                .map(|png| data_uri(&png))
                .unwrap_or_default(),
            low: short(low),
            middle: short(ERROR_VIEW.scale.middle()),
            high: short(high),
        }
    }
}

/// A column of the summary table.
struct Column {
    label: &'static str,
    meaning: &'static str,
    numeric: bool,
}

const fn column(label: &'static str, numeric: bool, meaning: &'static str) -> Column {
    Column {
        label,
        meaning,
        numeric,
    }
}

/// In the order of the cells in `page.html`.
const COLUMNS: [Column; 15] = [
    column(
        "Verdict",
        false,
        "pass: all limits hold; confirmed: the reference is too inaccurate, and the oracle confirms ours; FAIL: ours is wrong; undecided: neither the reference nor the oracle can decide",
    ),
    column("Scene", false, "path below scenes/"),
    column("Interior error", true, "rel_rmse_interior, at most its limit"),
    column(
        "Block bias",
        true,
        "largest mean relative error of a block of 16 × 16 pixels, at most its limit",
    ),
    column(
        "Explained",
        true,
        "pixels over tolerance that the reference's own variation explains, at most their limit",
    ),
    column(
        "Unexplained",
        true,
        "pixels over tolerance that the reference's own variation does not explain; must be 0",
    ),
    column(
        "Not finite",
        true,
        "NaN or infinite values in either image; must be 0",
    ),
    column(
        "Ids differ",
        true,
        "pixels where the two images show different shapes or primitives, in the worst layer",
    ),
    column(
        "Stock differs",
        true,
        "pixels that differ from Mitsuba's own integrators by more than noise explains, at most 0.25 %",
    ),
    column("RMSE", true, "over all pixels, in units of radiance"),
    column("Twin", false, "how independent the reference is"),
    column("Reference", false, "rendered now (live) or stored"),
    column("Ours, s", true, "time to render, in seconds"),
    column("Reference, s", true, "time to trace, in seconds"),
    column("Mrays/s", true, "our rays per second, in millions"),
];

impl<'a> Page<'a> {
    /// Failures come first.
    pub(super) fn new(results: &'a Results, extras: &'a Extras, kind: PageKind<'a>) -> Self {
        let mut cases: Vec<CaseView> = results
            .results
            .iter()
            .enumerate()
            .map(|(index, case)| match kind {
                // Skips the parts that this page does not show.
                PageKind::Index(_) => CaseView::row(index, case),
                PageKind::Whole | PageKind::Scene(_) => {
                    CaseView::new(index, case, extras.sensitivity_of(case))
                }
            })
            .collect();
        cases.sort_by_key(|case| match case.case.status {
            Some(Status::Fail) => 0,
            None | Some(Status::Undecided) => 1,
            Some(Status::Confirmed) => 2,
            Some(Status::Pass) => 3,
        });
        Self {
            style: STYLE,
            scripts: [
                SORT,
                include_str!("page.js"),
                include_str!("viewer.js"),
                include_str!("studies.js"),
            ],
            verdict: verdict(results),
            tiles: tiles(results),
            references: &results.summary.references,
            live: results.summary.references == "live",
            provenance: provenance(&results.provenance, &results.results),
            tolerance: tolerance(),
            scale: ScaleView::new(),
            drawing: drawing(),
            plugins: plugins(&results.results),
            columns: &COLUMNS,
            cases,
            skipped: &results.skipped,
            matrix: rows(&results.matrix),
            sections: sections(extras),
            changes: extras.changes.as_ref(),
            kind,
        }
    }

    /// The address at which a case is shown.
    fn link(&self, view: &CaseView<'_>) -> String {
        match self.kind {
            PageKind::Index(pages) => pages.get(&*view.case.scene).cloned().unwrap_or_default(),
            PageKind::Whole | PageKind::Scene(_) => format!("#{}", view.id),
        }
    }

    fn is_index(&self) -> bool {
        matches!(self.kind, PageKind::Index(_))
    }

    /// The address of the index, on the page of a scene.
    fn up(&self) -> Option<&str> {
        match self.kind {
            PageKind::Scene(index) => Some(index),
            PageKind::Whole | PageKind::Index(_) => None,
        }
    }

    fn failed(&self) -> usize {
        self.cases.iter().filter(|case| case.failed).count()
    }
}

/// The sections that have diagrams.
fn sections(extras: &Extras) -> Vec<Section<'_>> {
    let all = [
        Section {
            id: "studies",
            heading: "Error against run time",
            note: "each point names its configuration and the command that measures it again",
            open: true,
            diagrams: &extras.diagrams,
        },
        Section {
            id: "stress",
            heading: "Ill-conditioned and extreme cases",
            note: "error against the parameter of each family and against time; filled dots are usable",
            open: false,
            diagrams: &extras.stress,
        },
    ];
    all.into_iter()
        .filter(|section| !section.diagrams.is_empty())
        .collect()
}

fn verdict(results: &Results) -> Verdict {
    let cases = results.results.len();
    let failed = results.results.iter().filter(|case| failed(case)).count();
    let settings = match Tally::of(&results.matrix).failed {
        0 => String::new(),
        count => format!(
            "; {} of the matrix {}",
            counted(count, "setting"),
            if count == 1 { "fails" } else { "fail" }
        ),
    };
    let text = match (cases, failed) {
        (0, _) => "No case was run".to_owned(),
        (1, 0) => "The one case passes".to_owned(),
        (n, 0) => format!("All {n} cases pass"),
        (1, _) => "The one case does not pass".to_owned(),
        (n, 1) => format!("1 of {n} cases does not pass"),
        (n, failed) => format!("{failed} of {n} cases do not pass"),
    };
    let of = |status| {
        results
            .results
            .iter()
            .filter(|case| case.status == Some(status))
            .count()
    };
    let kinds = [
        (of(Status::Fail), "wrong"),
        (of(Status::Undecided), "undecided"),
        (of(Status::Confirmed), "confirmed by the oracle"),
    ];
    let kinds: Vec<String> = (kinds.iter().filter(|(count, _)| *count > 0))
        .map(|(count, what)| format!("{count} {what}"))
        .collect();
    let text = match kinds.is_empty() {
        true => text,
        false => format!("{text} ({})", kinds.join(", ")),
    };
    Verdict {
        passed: cases > 0 && failed == 0 && settings.is_empty(),
        text: text + &settings,
    }
}

fn tiles(results: &Results) -> Vec<Tile> {
    let summary = &results.summary;
    let count = |label, value: usize, bad| Tile {
        label,
        value: Number::count(value as u64),
        bad,
    };
    let mut tiles = vec![
        count("cases", summary.cases, false),
        count("passed", summary.passed, false),
        count("confirmed", summary.confirmed, false),
        count("failed", summary.failed, summary.failed > 0),
        count("undecided", summary.undecided, summary.undecided > 0),
        count("pixels explained", summary.explained, false),
        count("pixels unexplained", summary.unexplained, summary.unexplained > 0),
        count("values not finite", summary.nonfinite, summary.nonfinite > 0),
        count("scenes skipped", summary.skipped, false),
        count(
            "scenes not compared: interrupted",
            summary.not_run,
            summary.not_run > 0,
        ),
        Tile {
            label: "median interior error",
            value: Number::error(summary.median_rel_rmse_interior).or("no case has one"),
            bad: false,
        },
        Tile {
            label: "total time",
            value: Number::with_unit(summary.seconds, "s"),
            bad: false,
        },
    ];
    if summary.not_run > 0 {
        tiles.push(count("interrupted: scenes not compared", summary.not_run, true));
    }
    tiles
}

fn provenance(provenance: &Provenance, cases: &[CaseResult]) -> Vec<(&'static str, String)> {
    let threads = |threads: usize| match threads {
        0 => "one thread per core".to_owned(),
        1 => "1 thread".to_owned(),
        n => format!("{n} threads"),
    };
    let mut rows = vec![(
        "Whitstone",
        format!("{}, {}", provenance.whitstone, threads(provenance.threads)),
    )];
    match (&provenance.mitsuba, &provenance.povray) {
        (_, Some(found)) => rows.extend([
            (
                "POV-Ray",
                format!("{}, {}", found.povray, threads(found.threads as usize)),
            ),
            ("Python", found.python.clone()),
            ("CPU", found.cpu.clone()),
        ]),
        (Some(hello), None) => rows.extend([
            (
                "Mitsuba",
                format!(
                    "{}, {}, {}",
                    hello.mitsuba,
                    hello.variant,
                    threads(hello.threads as usize)
                ),
            ),
            ("Dr.Jit", hello.drjit.clone()),
            ("Python", hello.python.clone()),
            ("LLVM", format!("{} ({})", hello.llvm_version, hello.libllvm)),
            ("CPU", hello.cpu.clone()),
        ]),
        (None, None) => {
            let stored: BTreeSet<String> = cases.iter().filter_map(reference_name).collect();
            rows.extend(stored.into_iter().map(|name| ("stored reference", name)));
        }
    }
    rows
}

/// When a pixel is over tolerance, by the rule of the comparison.
fn tolerance() -> String {
    let tolerance = Tolerance::default();
    format!(
        "|ours − reference| > {} · |reference| + {} · mean of |reference|",
        short(tolerance.relative),
        short(tolerance.absolute)
    )
}
