//! The view of a case that the templates render.

use super::number::{Limited, Number, plain_count, precise, scientific, short};
use crate::explain::Reason;
use crate::opinion::Verdict;
use crate::pixels::LayerPictures;
use crate::sensitivity::{Effect, Parameter};
use crate::{CaseResult, Pictures, Status, WorstPixel};
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use whitstone_metrics::Tolerance;

/// Width at which a picture is easy to see, in pixels of the page.
pub(super) const PICTURE_WIDTH: usize = 384;
/// Maximum magnification.
pub(super) const LARGEST_SCALE: usize = 16;

/// A case, in the table and in its own section.
pub(super) struct CaseView<'a> {
    pub(super) case: &'a CaseResult,
    pub(super) id: String,
    pub(super) failed: bool,
    pub(super) verdict: Badge,
    /// Lower-case words for the filter.
    pub(super) words: String,
    pub(super) size: String,
    pub(super) reference: String,
    pub(super) source: &'a str,
    pub(super) twin: &'a str,
    pub(super) twin_meaning: &'static str,
    pub(super) interior: Limited,
    pub(super) bias: Limited,
    pub(super) explained: Limited,
    pub(super) unexplained: Limited,
    pub(super) stock: Limited,
    pub(super) nonfinite: Limited,
    pub(super) ids: Limited,
    pub(super) rmse: Number,
    pub(super) render_s: Number,
    pub(super) reference_s: Number,
    pub(super) mrays_per_s: Number,
    pub(super) checked: Vec<Checked>,
    pub(super) measured: Vec<Measured>,
    pub(super) pictures: Vec<Picture>,
    pub(super) pixels: String,
    pub(super) plugins: String,
    pub(super) worst: Vec<Pixel<'a>>,
    pub(super) over: Number,
    pub(super) layers: Vec<Layer<'a>>,
    pub(super) layer_pictures: Vec<LayerView<'a>>,
    pub(super) sensitivity: Vec<Sensed<'a>>,
}

/// A number with a limit.
pub(super) struct Checked {
    pub(super) name: &'static str,
    pub(super) note: String,
    pub(super) limited: Limited,
}

/// A number without a limit.
pub(super) struct Measured {
    pub(super) name: &'static str,
    pub(super) value: Number,
    pub(super) note: &'static str,
}

/// One of the three pictures.
pub(super) struct Picture {
    pub(super) caption: &'static str,
    pub(super) alternative: String,
    pub(super) data: String,
    /// Width on the page, in CSS pixels.
    pub(super) width: usize,
    pub(super) is_error: bool,
}

/// A row of the worst pixels.
pub(super) struct Pixel<'a> {
    pub(super) x: usize,
    pub(super) y: usize,
    pub(super) ours: [Component; 3],
    pub(super) reference: [Component; 3],
    pub(super) times: Number,
    pub(super) reason: Option<String>,
    pub(super) between: Option<String>,
    pub(super) tried: Option<String>,
    pub(super) first_difference: Option<&'a str>,
    pub(super) oracle: Option<Verdict>,
}

/// A channel of a pixel.
pub(super) struct Component {
    pub(super) text: String,
    /// Whether the two differ by more than the tolerance in this channel.
    pub(super) over: bool,
}

/// A row of the layers.
pub(super) struct Layer<'a> {
    pub(super) name: &'a str,
    /// For layers of ids.
    pub(super) differing: Option<Limited>,
    pub(super) rms: Number,
    pub(super) max_abs: Number,
}

/// The pictures of a layer on both sides.
pub(super) struct LayerView<'a> {
    pub(super) name: &'a str,
    pub(super) sides: [Picture; 2],
}

/// The smallest detectable change of a number of the scene.
pub(super) struct Sensed<'a> {
    pub(super) path: &'a str,
    pub(super) value: String,
    pub(super) change: Number,
    pub(super) of_itself: Number,
    pub(super) effect: String,
    /// Whether the comparison detects it.
    pub(super) seen: bool,
}

pub(super) fn data_uri(png: &[u8]) -> String {
    format!("data:image/png;base64,{}", base64(png))
}

pub(super) fn base64(bytes: &[u8]) -> String {
    STANDARD.encode(bytes)
}

pub(super) fn failed(case: &CaseResult) -> bool {
    !case.status.is_some_and(Status::is_right)
}

/// The appearance of a verdict.
#[derive(Clone, Copy)]
pub(super) struct Badge(Status);

impl Badge {
    /// The class in the style sheet.
    pub(super) fn class(self) -> &'static str {
        match self.0 {
            Status::Pass => "pass",
            Status::Confirmed => "pass confirmed",
            Status::Fail => "fail",
            Status::Undecided => "fail undecided",
        }
    }

    pub(super) fn mark(self) -> &'static str {
        match self.0 {
            Status::Pass | Status::Confirmed => "✓",
            Status::Fail => "✗",
            Status::Undecided => "?",
        }
    }

    pub(super) fn word(self) -> &'static str {
        self.0.word()
    }
}

impl<'a> CaseView<'a> {
    /// The complete view. `parameters` gives the smallest detectable change of each number.
    pub(super) fn new(index: usize, case: &'a CaseResult, parameters: &'a [Parameter]) -> Self {
        let mut view = Self::row(index, case);
        view.checked = view.checked();
        view.measured = view.measured();
        view.layers = layers(case);
        view.sensitivity = parameters.iter().map(Sensed::new).collect();
        if let Some(pictures) = &case.pictures {
            view.pictures = views(case, pictures);
            view.pixels = STANDARD.encode(&pictures.pixels);
            view.layer_pictures = layer_views(case, pictures);
        }
        let pixel = |pixel| Pixel::new(pixel, case.mean_reference);
        view.worst = case.worst.iter().map(pixel).collect();
        view
    }

    /// Only the fields that the table shows.
    pub(super) fn row(index: usize, case: &'a CaseResult) -> Self {
        let rendered = case.width > 0;
        let stock = Limited::count(case.stock());
        let ids = Limited::count(case.worst_ids());
        let ours = |value: f64| Number::plain(rendered.then_some(value)).or("it was not rendered");
        let source = case
            .reference
            .as_ref()
            .map_or("none", |reference| reference.source.as_str());
        let twin = if case.twin.is_empty() { "none" } else { &case.twin };
        let failed = failed(case);
        Self {
            case,
            id: format!("case-{}", index + 1),
            failed,
            verdict: Badge(case.status.unwrap_or(Status::Undecided)),
            words: format!(
                "{} {} {twin} {source} {} {}",
                case.scene,
                case.config,
                case.status.unwrap_or(Status::Undecided).word(),
                case.plugins.join(" ")
            )
            .to_lowercase(),
            size: if rendered {
                format!(
                    "{} × {} pixels, {} per pixel",
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
                value: ids.value.or("no id layer was compared"),
                ..ids
            },
            stock: Limited {
                value: stock.value.or("it was not compared with stock Mitsuba"),
                ..stock
            },
            rmse: Number::error(case.rmse),
            render_s: ours(case.render_s),
            reference_s: Number::plain(case.reference_s).or("there is no reference"),
            mrays_per_s: ours(case.mrays_per_s),
            checked: Vec::new(),
            measured: Vec::new(),
            pictures: Vec::new(),
            pixels: String::new(),
            plugins: case.plugins.join(" "),
            worst: Vec::new(),
            over: Number::count(case.compared.then_some(case.pixels_over_tolerance as u64)),
            layers: Vec::new(),
            layer_pictures: Vec::new(),
            sensitivity: Vec::new(),
        }
    }

    /// The cells with limits, in the order of the columns of the table.
    pub(super) fn limited(&self) -> [&Limited; 7] {
        [
            &self.interior,
            &self.bias,
            &self.explained,
            &self.unexplained,
            &self.nonfinite,
            &self.ids,
            &self.stock,
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
            row(
                "pixels ambiguous",
                "between values of the reference; the oracle decides".to_owned(),
                &Limited::count(self.case.ambiguous()),
            ),
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
            row(
                "mean |reference|",
                Number::plain(case.mean_reference),
                "very bright values are limited",
            ),
            row(
                "floor",
                Number::error((case.floor > 0.0).then_some(case.floor))
                    .or("the floor comes with the reference"),
                "the reference's own error",
            ),
            row(
                "drift",
                Number::error(case.drift).or("needs a live and a stored reference"),
                "difference between the live and the stored reference",
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
                "including shadow rays",
            ),
            row("our speed", ours(case.mrays_per_s, "Mrays/s"), ""),
        ]
    }

    /// "3 of 134".
    pub(super) fn worst_shown(&self) -> String {
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

/// The name of the renderer of a case's reference.
pub(super) fn reference_name(case: &CaseResult) -> Option<String> {
    let reference = case.reference.as_ref()?;
    Some(format!(
        "{} {}, {}",
        reference.name, reference.version, reference.variant
    ))
}

fn twin_meaning(twin: &str) -> &'static str {
    match twin {
        "native" => "the reference's own plugins compute all of it",
        "hosted" => "the driver computes some shapes, materials, textures or lights itself",
        "formula" => "the driver computes other terms itself, or composes them from parts of the reference",
        "tessellated" => "Mitsuba renders a mesh instead of a shape that it lacks",
        _ => "",
    }
}

/// The renderer under test.
fn renderer(case: &CaseResult) -> &str {
    case.subject.as_ref().map_or("Whitstone", |subject| &subject.name)
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
            .map_or_else(|| "unknown".to_owned(), scientific),
    );
    vec![
        picture(
            "ours",
            format!("{}, rendered by {}", case.scene, renderer(case)),
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

/// Small pictures, side by side.
fn layer_views<'a>(case: &CaseResult, pictures: &'a Pictures) -> Vec<LayerView<'a>> {
    let scale = (PICTURE_WIDTH / 2).div_ceil(case.width.max(1)).min(LARGEST_SCALE);
    let width = (case.width * scale).min(PICTURE_WIDTH);
    let side = |caption, alternative: String, png: &[u8]| Picture {
        caption,
        alternative,
        data: data_uri(png),
        width,
        is_error: false,
    };
    let view = |LayerPictures {
                    name,
                    ours,
                    reference,
                }: &'a LayerPictures| LayerView {
        name,
        sides: [
            side(
                "ours",
                format!("{name} of {}, rendered by {}", case.scene, renderer(case)),
                ours,
            ),
            side(
                "reference",
                format!("{name} of {}, the reference", case.scene),
                reference,
            ),
        ],
    };
    pictures.layers.iter().map(view).collect()
}

impl<'a> Sensed<'a> {
    fn new(parameter: &'a Parameter) -> Self {
        let (change, effect) = match &parameter.effect {
            Effect::Seen { change, problem } => (*change, problem.clone()),
            Effect::Unseen { change } => (
                *change,
                "not detected up to this change, although pixels change".to_owned(),
            ),
            Effect::NoPixel { change } => (*change, "no pixel differs up to this change".to_owned()),
            Effect::Refused { change, problem } => (*change, format!("refused: {problem}")),
        };
        let part = (parameter.value != 0.0).then(|| change / parameter.value.abs());
        Self {
            path: &parameter.path,
            value: precise(parameter.value),
            change: Number::error(change),
            of_itself: Number::error(part).or("it is 0"),
            effect,
            seen: matches!(parameter.effect, Effect::Seen { .. }),
        }
    }
}

impl<'a> Pixel<'a> {
    fn new(pixel: &'a WorstPixel, mean_reference: Option<f64>) -> Self {
        let tolerance = Tolerance::default();
        // Without a mean, only values that are not finite are known to differ.
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
            between: pixel.between.map(|_| {
                "ours lies between values that the reference takes, and equals none of them".to_owned()
            }),
            tried: pixel.tried.map(|[min, max]| {
                let color = |values: [f64; 3]| values.map(precise).join(", ");
                format!("range of all variations: {} to {}", color(min), color(max))
            }),
            first_difference: pixel.first_difference.as_deref(),
            oracle: pixel.oracle,
        }
    }
}

/// A description of a pixel's explanation.
fn in_words(reason: &Reason) -> String {
    match reason {
        Reason::Shift { radius_px } => format!(
            "an edge: a shift of {} pixel makes the reference take our value",
            short(*radius_px)
        ),
        Reason::SpawnOffset => {
            "the reference takes our value with another spawn offset or traversal".to_owned()
        }
        Reason::Noise => "the noise of the reference".to_owned(),
        Reason::Stored => "one of the values that are stored with the reference".to_owned(),
        Reason::Rounding { ulps } => format!(
            "ill-conditioned: {} units in the last place make the reference take our value",
            plain_count(*ulps)
        ),
        Reason::Vertices { ulps } => format!(
            "ill-conditioned: {} units in the last place of its rays and one of its vertices make the reference take our value",
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
            rms: Number::error(layer.rms).or("ids are compared for equality"),
            max_abs: Number::error(layer.max_abs).or("ids are compared for equality"),
        })
        .collect()
}
