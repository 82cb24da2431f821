//! What the templates show of the results.

use super::changes::{Changes, Kind};
use super::number::{Limited, Number, plain_count, precise, scientific, short};
use super::script::{drawing, plugins};
use super::{ERROR_VIEW, Extras};
use crate::explain::Reason;
use crate::matrix::{Row, Tally, rows};
use crate::{CaseResult, LeftOut, Pictures, Provenance, Results, Status, WorstPixel, counted};
use askama::Template;
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use std::collections::{BTreeMap, BTreeSet};
use whitstone_image::Tolerance;
use whitstone_image::error_map::legend;

/// Width in which a picture is easy to see, in pixels of the page.
const PICTURE_WIDTH: usize = 384;
/// Larger pixels show nothing more.
const LARGEST_SCALE: usize = 16;

/// The whole page.
#[derive(Template)]
#[template(path = "page.html", config = "src/report/askama.toml")]
pub(super) struct Page<'a> {
    style: &'static str,
    scripts: [&'static str; 3],
    verdict: Verdict,
    tiles: Vec<Tile>,
    references: &'a str,
    live: bool,
    provenance: Vec<(&'static str, String)>,
    tolerance: String,
    scale: ScaleView,
    /// What the script draws error pictures by, as JSON.
    drawing: String,
    /// By family, for the filter.
    plugins: BTreeMap<&'a str, BTreeSet<&'a str>>,
    columns: &'static [Column],
    cases: Vec<CaseView<'a>>,
    left_out: &'a [LeftOut],
    matrix: Vec<Row<'a>>,
    diagrams: &'a [super::Diagram],
    changes: Option<&'a Changes>,
}

/// The first thing that a reader wants to know.
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
struct ScaleView {
    /// Its strip is at the top.
    legend: String,
    low: String,
    middle: String,
    high: String,
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
const COLUMNS: [Column; 14] = [
    column("Result", false, "pass: all limits are kept"),
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
        "pixels over tolerance that nothing explains: none may be",
    ),
    column(
        "Not finite",
        true,
        "NaN or infinite values in either picture: none may be",
    ),
    column(
        "Ids differ",
        true,
        "pixels where the two see another shape or primitive, in the worst layer",
    ),
    column("RMSE", true, "over all pixels, in units of radiance"),
    column("Twin", false, "how independent the reference is"),
    column("Reference", false, "rendered now (live) or kept (stored)"),
    column("Ours, s", true, "time to render, in seconds"),
    column("Reference, s", true, "time to trace, in seconds"),
    column("Mrays/s", true, "our rays a second, in millions"),
];

/// A case, in the table and in its own section.
struct CaseView<'a> {
    case: &'a CaseResult,
    id: String,
    failed: bool,
    /// Lower case, for the filter.
    words: String,
    size: String,
    reference: String,
    source: &'a str,
    twin: &'a str,
    twin_meaning: &'static str,
    interior: Limited,
    bias: Limited,
    explained: Limited,
    unexplained: Limited,
    nonfinite: Limited,
    ids: Limited,
    rmse: Number,
    render_s: Number,
    reference_s: Number,
    mrays_per_s: Number,
    checked: Vec<Checked>,
    measured: Vec<Measured>,
    pictures: Vec<Picture>,
    pixels: String,
    plugins: String,
    worst: Vec<Pixel<'a>>,
    over: Number,
    layers: Vec<Layer<'a>>,
}

/// A number with a limit.
struct Checked {
    name: &'static str,
    note: String,
    limited: Limited,
}

/// A number without.
struct Measured {
    name: &'static str,
    value: Number,
    note: &'static str,
}

/// One of the three pictures.
struct Picture {
    caption: &'static str,
    alternative: String,
    data: String,
    /// On the page, in CSS pixels.
    width: usize,
    is_error: bool,
}

/// A row of the worst pixels.
struct Pixel<'a> {
    x: usize,
    y: usize,
    ours: [Component; 3],
    reference: [Component; 3],
    times: Number,
    reason: Option<String>,
    tried: Option<String>,
    first_difference: Option<&'a str>,
}

/// A channel of a pixel.
struct Component {
    text: String,
    /// Whether the two differ by more than the tolerance here.
    over: bool,
}

/// A row of the layers.
struct Layer<'a> {
    name: &'a str,
    /// For layers of ids.
    differing: Option<Limited>,
    rms: Number,
    max_abs: Number,
}

impl<'a> Page<'a> {
    /// Failures come first.
    pub(super) fn new(results: &'a Results, extras: &'a Extras) -> Self {
        let mut cases: Vec<CaseView> = results
            .results
            .iter()
            .enumerate()
            .map(|(index, case)| CaseView::new(index, case))
            .collect();
        cases.sort_by_key(|case| !case.failed);
        let (low, high) = ERROR_VIEW.scale.ends();
        Self {
            style: include_str!("page.css"),
            scripts: [
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
            scale: ScaleView {
                legend: legend(ERROR_VIEW.scale, PICTURE_WIDTH)
                    .ok()
                    .and_then(|raster| raster.to_png().ok())
                    .map(|png| data_uri(&png))
                    .unwrap_or_default(),
                low: short(low),
                middle: short(ERROR_VIEW.scale.middle()),
                high: short(high),
            },
            drawing: drawing(),
            plugins: plugins(&results.results),
            columns: &COLUMNS,
            cases,
            left_out: &results.left_out,
            matrix: rows(&results.matrix),
            diagrams: &extras.diagrams,
            changes: extras.changes.as_ref(),
        }
    }

    fn failed(&self) -> usize {
        self.cases.iter().filter(|case| case.failed).count()
    }
}

fn verdict(results: &Results) -> Verdict {
    let cases = results.results.len();
    let failed = results.results.iter().filter(|case| failed(case)).count();
    let settings = match Tally::of(&results.matrix).failed {
        0 => String::new(),
        count => format!(
            "; {} of the matrix {} not hold",
            counted(count, "setting"),
            if count == 1 { "does" } else { "do" }
        ),
    };
    let text = match (cases, failed) {
        (0, _) => "No case was run".to_owned(),
        (1, 0) => "The one case passes".to_owned(),
        (n, 0) => format!("All {n} cases pass"),
        (1, _) => "The one case fails".to_owned(),
        (n, 1) => format!("1 of {n} cases fails"),
        (n, failed) => format!("{failed} of {n} cases fail"),
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
    vec![
        count("cases", summary.cases, false),
        count("passed", summary.passed, false),
        count("failed", summary.failed, summary.failed > 0),
        count("pixels explained", summary.explained, false),
        count("pixels unexplained", summary.unexplained, summary.unexplained > 0),
        count("values not finite", summary.nonfinite, summary.nonfinite > 0),
        count("scenes left out", summary.left_out, false),
        Tile {
            label: "median interior error",
            value: Number::error(summary.median_rel_rmse_interior).or("no case has one"),
            bad: false,
        },
        Tile {
            label: "in all",
            value: Number::with_unit(summary.seconds, "s"),
            bad: false,
        },
    ]
}

fn provenance(provenance: &Provenance, cases: &[CaseResult]) -> Vec<(&'static str, String)> {
    let threads = |threads: usize| match threads {
        0 => "one thread a core".to_owned(),
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

fn reference_name(case: &CaseResult) -> Option<String> {
    let reference = case.reference.as_ref()?;
    Some(format!(
        "{} {}, {}",
        reference.name, reference.version, reference.variant
    ))
}

/// When a pixel counts as different, as the comparison has it.
fn tolerance() -> String {
    let tolerance = Tolerance::default();
    format!(
        "|ours − reference| > {} · |reference| + {} · mean of |reference|",
        short(tolerance.relative),
        short(tolerance.absolute)
    )
}

fn data_uri(png: &[u8]) -> String {
    format!("data:image/png;base64,{}", STANDARD.encode(png))
}

fn failed(case: &CaseResult) -> bool {
    case.status != Some(Status::Pass)
}

impl<'a> CaseView<'a> {
    fn new(index: usize, case: &'a CaseResult) -> Self {
        let rendered = case.width > 0;
        let ids = Limited::count(case.worst_ids());
        let ours = |value: f64| Number::plain(rendered.then_some(value)).or("it was not rendered");
        let source = case
            .reference
            .as_ref()
            .map_or("none", |reference| reference.source.as_str());
        let twin = if case.twin.is_empty() { "none" } else { &case.twin };
        let failed = failed(case);
        let mut view = Self {
            case,
            id: format!("case-{}", index + 1),
            failed,
            words: format!(
                "{} {} {twin} {source} {} {}",
                case.scene,
                case.config,
                if failed { "fail" } else { "pass" },
                case.plugins.join(" ")
            )
            .to_lowercase(),
            size: if rendered {
                format!(
                    "{} × {} pixels, {} a pixel",
                    case.width,
                    case.height,
                    samples(case.samples)
                )
            } else {
                "not rendered".to_owned()
            },
            reference: reference(case),
            source,
            twin,
            twin_meaning: twin_meaning(twin),
            interior: Limited::error(case.interior()),
            bias: Limited::error(case.bias()),
            explained: Limited::count(case.explained()),
            unexplained: Limited::count(case.unexplained()),
            nonfinite: Limited::count(case.nonfinite()),
            ids: Limited {
                value: ids.value.or("no layer of ids was compared"),
                ..ids
            },
            rmse: Number::error(case.rmse),
            render_s: ours(case.render_s),
            reference_s: Number::plain(case.reference_s).or("there is no reference"),
            mrays_per_s: ours(case.mrays_per_s),
            checked: Vec::new(),
            measured: Vec::new(),
            pictures: case
                .pictures
                .as_ref()
                .map_or_else(Vec::new, |pictures| views(case, pictures)),
            pixels: case
                .pictures
                .as_ref()
                .map_or_else(String::new, |pictures| STANDARD.encode(&pictures.pixels)),
            plugins: case.plugins.join(" "),
            worst: case
                .worst
                .iter()
                .map(|pixel| Pixel::new(pixel, case.mean_reference))
                .collect(),
            over: Number::count(case.compared.then_some(case.pixels_over_tolerance as u64)),
            layers: layers(case),
        };
        view.checked = view.checked();
        view.measured = view.measured();
        view
    }

    /// The cells with limits, in the order of [`COLUMNS`].
    fn limited(&self) -> [&Limited; 6] {
        [
            &self.interior,
            &self.bias,
            &self.explained,
            &self.unexplained,
            &self.nonfinite,
            &self.ids,
        ]
    }

    fn checked(&self) -> Vec<Checked> {
        let row = |name, note: String, limited: &Limited| Checked {
            name,
            note,
            limited: limited.clone(),
        };
        let bias = self.case.signed_block_bias.map_or_else(String::new, |block| {
            format!(
                "ours is {} in {} of the block at ({}, {}), {} pixels",
                if block.bias < 0.0 { "darker" } else { "brighter" },
                block.channel,
                block.x,
                block.y,
                block.pixels
            )
        });
        let radius = if self.case.explained_radius_px > 0.0 {
            format!(
                "by shifts of at most {} pixel",
                short(self.case.explained_radius_px)
            )
        } else {
            String::new()
        };
        vec![
            row("interior error", "rel_rmse_interior".to_owned(), &self.interior),
            row("block bias", bias, &self.bias),
            row("pixels explained", radius, &self.explained),
            row("pixels unexplained", String::new(), &self.unexplained),
            row("values not finite", String::new(), &self.nonfinite),
            row(
                "pixels whose ids differ",
                "in the worst layer".to_owned(),
                &self.ids,
            ),
        ]
    }

    fn measured(&self) -> Vec<Measured> {
        let case = self.case;
        let row = |name, value: Number, note| Measured { name, value, note };
        let ours = |value: f64, unit| {
            Number::with_unit((case.width > 0).then_some(value), unit).or("it was not rendered")
        };
        vec![
            row("pixels over tolerance", self.over.clone(), ""),
            row("RMSE", self.rmse.clone(), "all pixels"),
            row(
                "relMSE",
                Number::error(case.relmse),
                "mean of d² / (reference² + 0.01)",
            ),
            row("mean |d|", Number::error(case.mae), ""),
            row("largest |d|", Number::error(case.max_abs), ""),
            row("mean |reference|", Number::plain(case.mean_reference), ""),
            row(
                "floor",
                Number::error((case.floor > 0.0).then_some(case.floor))
                    .or("the floor comes with the reference"),
                "the reference's own error",
            ),
            row(
                "drift",
                Number::error(case.drift).or("needs a live and a stored reference"),
                "of the live from the stored reference",
            ),
            row("built in", ours(case.build_s, "s"), ""),
            row("rendered in", ours(case.render_s, "s"), ""),
            row(
                "reference traced in",
                Number::with_unit(case.reference_s, "s").or("there is no reference"),
                "",
            ),
            row(
                "our rays",
                Number::count((case.width > 0).then_some(case.rays)).or("it was not rendered"),
                "shadow rays included",
            ),
            row("our speed", ours(case.mrays_per_s, "Mrays/s"), ""),
        ]
    }

    /// "3 of 134".
    fn worst_shown(&self) -> String {
        format!("{} of {}", self.worst.len(), self.over)
    }
}

fn samples(samples: u32) -> String {
    match samples {
        1 => "1 sample".to_owned(),
        n => format!("{n} samples"),
    }
}

fn reference(case: &CaseResult) -> String {
    match (&case.reference, reference_name(case)) {
        (Some(reference), Some(name)) => {
            format!(
                "{}, {name}, spawn offset K = {}",
                reference.source,
                plain_count(reference.k)
            )
        }
        _ => "none".to_owned(),
    }
}

fn twin_meaning(twin: &str) -> &'static str {
    match twin {
        "native" => "the reference's own plugins compute all of it",
        "hosted" => "some formulas are plugins of ours that run inside Mitsuba",
        "formula" => "the driver adds some terms by itself, or builds them of the reference's parts",
        "tessellated" => "Mitsuba sees a mesh in place of a shape that it does not have",
        _ => "",
    }
}

fn views(case: &CaseResult, pictures: &Pictures) -> Vec<Picture> {
    let scale = ((PICTURE_WIDTH + case.width / 2) / case.width.max(1)).clamp(1, LARGEST_SCALE);
    let picture = |caption, alternative: String, png: &[u8], is_error| Picture {
        caption,
        alternative,
        data: data_uri(png),
        width: case.width * scale,
        is_error,
    };
    let error = format!(
        "Relative error of {}, pixel by pixel: {} pixels are over tolerance, the interior error is {}",
        case.scene,
        case.pixels_over_tolerance,
        case.rel_rmse_interior
            .map_or_else(|| "not known".to_owned(), scientific),
    );
    vec![
        picture(
            "ours",
            format!("{}, rendered by Whitstone", case.scene),
            &pictures.ours,
            false,
        ),
        picture(
            "reference",
            format!("{}, the reference", case.scene),
            &pictures.reference,
            false,
        ),
        picture("relative error", error, &pictures.error, true),
    ]
}

impl<'a> Pixel<'a> {
    fn new(pixel: &'a WorstPixel, mean_reference: Option<f64>) -> Self {
        let tolerance = Tolerance::default();
        // Without a mean only what is not finite is known to differ.
        let times: [Option<f64>; 3] = std::array::from_fn(|channel| {
            let (ours, reference) = (
                f64::from(pixel.ours[channel]),
                f64::from(pixel.reference[channel]),
            );
            let difference = (ours - reference).abs();
            if !difference.is_finite() {
                Some(f64::INFINITY)
            } else if difference == 0.0 {
                Some(0.0)
            } else {
                mean_reference.map(|mean| {
                    difference / (tolerance.relative * reference.abs() + tolerance.absolute * mean)
                })
            }
        });
        let components = |values: [f32; 3]| {
            std::array::from_fn(|channel| Component {
                text: precise(f64::from(values[channel])),
                over: times[channel].is_some_and(|times| times > 1.0),
            })
        };
        let largest = times.iter().flatten().copied().reduce(f64::max);
        Self {
            x: pixel.x,
            y: pixel.y,
            ours: components(pixel.ours),
            reference: components(pixel.reference),
            times: Number::plain(largest.filter(|times| *times > 0.0))
                .or("the mean of the reference is not known"),
            reason: pixel.reason.as_ref().map(in_words),
            tried: pixel.tried.map(|[min, max]| {
                let color = |values: [f64; 3]| values.map(precise).join(", ");
                format!("all tried: {} to {}", color(min), color(max))
            }),
            first_difference: pixel.first_difference.as_deref(),
        }
    }
}

/// What explains a pixel.
fn in_words(reason: &Reason) -> String {
    match reason {
        Reason::Shift { radius_px } => format!(
            "an edge: a shift of {} pixel takes the reference to our value",
            short(*radius_px)
        ),
        Reason::SpawnOffset => {
            "the reference takes our value with another spawn offset or traversal".to_owned()
        }
        Reason::StoredRange => "within the range that is kept with the stored reference".to_owned(),
        Reason::Rounding { ulps } => format!(
            "ill-conditioned: {} units in the last place take the reference to our value",
            plain_count(*ulps)
        ),
        Reason::Vertices { ulps } => format!(
            "ill-conditioned: {} units in the last place of its rays and one of its vertices take the reference to our value",
            plain_count(*ulps)
        ),
    }
}

fn layers(case: &CaseResult) -> Vec<Layer<'_>> {
    case.layers
        .iter()
        .map(|layer| Layer {
            name: &layer.name,
            differing: layer.differing.map(|_| Limited::count(case.ids(layer))),
            rms: Number::error(layer.rms).or("ids are compared as they are"),
            max_abs: Number::error(layer.max_abs).or("ids are compared as they are"),
        })
        .collect()
}
