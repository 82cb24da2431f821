//! Measures two images, checks the limits, and prints and writes the results.

use super::super::junit::{Case, Outcome};
use super::Arguments;
use super::channels::{self, ChannelDifference};
use super::input::CodeDifference;
use crate::terminal::{Exit, Failure};
use serde_json::{Value, json};
use std::path::Path;
use std::time::Instant;
use whitstone_image::Image;
use whitstone_metrics::areas::{Area, largest};
use whitstone_metrics::edges::edges;
use whitstone_metrics::flip::{flip, flip_ldr};
use whitstone_metrics::metrics::{self, NotFinite, WorstPixel};
use whitstone_metrics::range::{LAYERS, Ranges, is_vacuous};
use whitstone_metrics::significance::{Significance, Test, significance};
use whitstone_metrics::{CompareOptions, Mask, Metrics, Tolerance, compare, ssim};
use whitstone_validate::explain::Explanation;
use whitstone_validate::stored::Variation;
use whitstone_validate::{Variants, counted};

/// The significance level that is reported if none is given; informational only.
const LEVEL: f64 = 0.01;

/// The pixels over tolerance of a comparison.
pub(super) struct Judged {
    /// Those that the variation of the reference does not explain.
    pub(super) over: Mask,
    /// Those that it does explain; absent if the reference has no variation.
    pub(super) explained: Option<Mask>,
}

/// The results of a comparison.
pub(super) struct Comparison {
    pub(super) not_finite: NotFinite,
    /// Absent if values are not finite.
    pub(super) metrics: Option<Metrics>,
    /// Pixels at edges of layers, excluded from the interior; absent if no layer was named.
    pub(super) excluded: Option<usize>,
    /// The mean of FLIP over exposures, which images with codes lack, and at exposure 0.
    flip: Option<(Option<f64>, f64)>,
    /// For images with codes: how these differ.
    codes: Option<CodeDifference>,
    /// Other channels that were requested.
    channels: Vec<ChannelDifference>,
    /// If requested; the inner value is absent for an image smaller than the SSIM window.
    pub(super) ssim: Option<Option<f64>>,
    /// Present if the files have layers of variance.
    significance: Option<Significance>,
    /// Pixels over tolerance that the variation of the reference does not explain.
    pub(super) over: usize,
    /// Pixels over tolerance that it does explain; absent if the reference has no variation.
    pub(super) explained: Option<usize>,
    /// Ambiguous pixels over tolerance: our value lies between values of the reference and equals
    /// none of them. Absent if the reference has no variation.
    ambiguous: Option<usize>,
    /// Whether both images show one colour each.
    vacuous: bool,
    area: Option<Area>,
    pub(super) worst: Vec<WorstPixel>,
    seconds: f64,
    /// Each limit that was exceeded, with the value.
    pub(super) broken: Vec<String>,
    /// Each limit that only warns and was exceeded.
    pub(super) warnings: Vec<String>,
}

/// The pixels of `over` that the stored variation of the reference explains, and the number of
/// ambiguous ones; `None` if there is no variation.
fn explain(
    ours: &Image,
    reference: &Image,
    variants: &Variants,
    over: &Mask,
    tolerance: Tolerance,
) -> Result<Option<(Mask, usize)>, Failure> {
    let Some(ranges) = Ranges::of(reference).map_err(Failure::usage)? else {
        return Ok(None);
    };
    let mean = metrics::mean_reference(reference).map_err(Failure::usage)?;
    let variation = Variation {
        reference,
        ranges: Some(ranges),
        variants,
    };
    let mut explained = Mask::new(ours.width(), ours.height());
    let mut ambiguous = 0;
    for (x, y) in over.pixels() {
        match variation.explain(ours, [x, y], tolerance, mean) {
            Explanation::Value(_) => {
                explained.set(x, y, true);
            }
            Explanation::Between(_) => ambiguous += 1,
            Explanation::Nothing => {}
        }
    }
    Ok(Some((explained, ambiguous)))
}

/// Computes the requested measures and checks them against the limits.
pub(super) fn measure(
    arguments: &Arguments,
    ours: &Image,
    reference: &Image,
    variants: &Variants,
    codes: Option<CodeDifference>,
) -> Result<(Comparison, Judged), Failure> {
    let start = Instant::now();
    let tolerance = arguments.tolerance();
    let not_finite = metrics::count_not_finite(ours, reference).map_err(Failure::usage)?;
    let finite = not_finite == NotFinite::default();
    let exclude = match arguments.edges_of.as_slice() {
        [] => None,
        layers => Some(edges(ours, reference, layers).map_err(Failure::usage)?),
    };
    let over = match &codes {
        Some(codes) => codes.mask.clone(),
        None => metrics::over_tolerance(ours, reference, tolerance).map_err(Failure::usage)?,
    };
    let (explained, ambiguous) = explain(ours, reference, variants, &over, tolerance)?.unzip();
    let combined = |mask: &Mask, other: &Mask, member: fn(bool, bool) -> bool| {
        Mask::from_fn(ours.width(), ours.height(), |x, y| {
            member(mask.contains(x, y), other.contains(x, y))
        })
    };
    let over = match &explained {
        Some(explained) => combined(&over, explained, |over, explained| over && !explained),
        None => over,
    };
    let outside_interior = match (&exclude, &explained) {
        (Some(edges), Some(explained)) => Some(combined(edges, explained, |a, b| a || b)),
        (Some(mask), None) | (None, Some(mask)) => Some(mask.clone()),
        (None, None) => None,
    };
    let options = CompareOptions {
        tolerance,
        exclude: outside_interior.as_ref(),
        psnr_peak: None,
    };
    let when = |wanted: bool| finite && wanted;
    let metrics = match finite {
        true => Some(compare(ours, reference, &options).map_err(Failure::usage)?),
        false => None,
    };
    let wants_flip = arguments.flip || arguments.max_flip.is_some() || codes.is_some();
    let flip = match when(wants_flip) {
        true => {
            let hdr = match codes {
                None => Some(flip(ours, reference).map_err(Failure::usage)?.mean),
                Some(_) => None,
            };
            let ldr = match &codes {
                Some(codes) if codes.differing == 0 => 0.0,
                _ => flip_ldr(ours, reference).map_err(Failure::usage)?.mean,
            };
            Some((hdr, ldr))
        }
        false => None,
    };
    let ssim = match when(arguments.ssim || arguments.min_ssim.is_some()) {
        true => Some(ssim(ours, reference, arguments.tone()).map_err(Failure::usage)?),
        false => None,
    };
    if arguments.min_ssim.is_some() && ssim == Some(None) {
        return Err(Failure::usage(
            "the images are too small for SSIM, whose window has 11 x 11 pixels; omit --min-ssim",
        ));
    }
    let significance = match finite {
        true => {
            let level = arguments.significance.unwrap_or(LEVEL);
            significance(ours, reference, level, tolerance).map_err(Failure::usage)?
        }
        false => None,
    };
    if when(arguments.significance.is_some()) && significance.is_none() {
        return Err(Failure::usage(
            "--significance needs layers variance.R, variance.G, variance.B, or m2.R, m2.G, m2.B, in one of the images",
        ));
    }
    let worst = metrics::worst(ours, reference, arguments.worst, Some(&over)).map_err(Failure::usage)?;
    let mut comparison = Comparison {
        not_finite,
        metrics,
        excluded: exclude.map(|mask| mask.count()),
        flip,
        codes,
        channels: channels::compare(ours, reference, &arguments.channels).map_err(Failure::usage)?,
        ssim,
        significance,
        over: over.count(),
        explained: explained.as_ref().map(Mask::count),
        ambiguous,
        vacuous: is_vacuous(ours, reference).map_err(Failure::usage)?,
        area: largest(&over),
        worst,
        seconds: start.elapsed().as_secs_f64(),
        broken: Vec::new(),
        warnings: Vec::new(),
    };
    comparison.broken = comparison.broken_limits(arguments);
    if finite && arguments.thresholds.is_any() {
        let differences = largest_differences(ours, reference, comparison.codes.as_ref())?;
        let is_explained = |index: usize| explained.as_ref().is_some_and(|mask| mask.as_slice()[index]);
        let differences: Vec<f64> = (differences.into_iter().enumerate())
            .map(|(index, difference)| if is_explained(index) { 0.0 } else { difference })
            .collect();
        let [broken, warnings] = arguments.thresholds.check(&differences);
        comparison.broken.extend(broken);
        comparison.warnings = warnings;
    }
    Ok((comparison, Judged { over, explained }))
}

/// The largest difference of each pixel over its channels; codes count from 0 to 1.
fn largest_differences(
    ours: &Image,
    reference: &Image,
    codes: Option<&CodeDifference>,
) -> Result<Vec<f64>, Failure> {
    if let Some(codes) = codes {
        return Ok(codes.normalised().collect());
    }
    let (ours, reference) = (
        ours.rgb().map_err(Failure::usage)?,
        reference.rgb().map_err(Failure::usage)?,
    );
    let at = |index: usize| {
        let planes = ours.iter().zip(&reference);
        planes
            .map(|(ours, reference)| (f64::from(ours[index]) - f64::from(reference[index])).abs())
            .fold(0.0, f64::max)
    };
    Ok((0..ours[0].len()).map(at).collect())
}

impl Comparison {
    pub(super) fn exit(&self) -> Exit {
        match self.broken.is_empty() {
            true => Exit::Pass,
            false => Exit::Differs,
        }
    }

    /// How far the comparison is from passing, to choose among several references: the number of
    /// limits that are exceeded, then the pixels over tolerance and those of other channels.
    pub(super) fn distance(&self) -> (usize, usize) {
        let of_channels: usize = self.channels.iter().map(|channel| channel.pixels).sum();
        (self.broken.len(), self.over + of_channels)
    }

    fn broken_limits(&self, arguments: &Arguments) -> Vec<String> {
        let mut broken = Vec::new();
        let NotFinite { ours, reference } = self.not_finite;
        if ours + reference > 0 {
            broken.push(format!("not finite: {}", counted(ours + reference, "value")));
        }
        if let Some(metrics) = &self.metrics {
            let interior = (metrics.rel_rmse_interior, arguments.max_rel_rmse_interior);
            if let (None, Some(_)) = interior {
                broken.push("there are no interior pixels to compare: all pixels are at edges".to_owned());
            }
            let limits = [
                ("rmse", Some(metrics.rmse), arguments.max_rmse),
                ("rel_rmse_interior", interior.0, interior.1),
                (
                    "flip",
                    self.flip.map(|(hdr, ldr)| hdr.unwrap_or(ldr)),
                    arguments.max_flip,
                ),
            ];
            for (name, value, limit) in limits {
                if let (Some(value), Some(limit)) = (value, limit)
                    && value > limit
                {
                    broken.push(format!("{name} {value:.3e} is above the limit {limit:.3e}"));
                }
            }
        }
        if let (Some(Some(value)), Some(limit)) = (self.ssim, arguments.min_ssim)
            && value < limit
        {
            broken.push(format!("ssim {value:.6} is below the limit {limit:.6}"));
        }
        if let (Some(found), Some(_)) = (&self.significance, arguments.significance)
            && found.pixels > 0
        {
            broken.push(format!(
                "noise does not explain {} at the level {}",
                counted(found.pixels, "pixel"),
                found.level
            ));
        }
        if let Some(limit) = arguments.max_over()
            && self.over > limit
        {
            broken.push(match &self.codes {
                Some(_) => format!("{} pixels have other codes; the limit is {limit}", self.over),
                None => format!("{} pixels are over tolerance; the limit is {limit}", self.over),
            });
        }
        if let (Some(area), Some(limit)) = (self.area, arguments.max_area)
            && area.pixels > limit
        {
            broken.push(format!(
                "{} connected pixels are over tolerance; the limit is {limit}",
                area.pixels
            ));
        }
        let channels = self.channels.iter().filter(|channel| channel.pixels > 0);
        broken.extend(channels.map(|channel| format!("{}: {}", channel.name, channel.words())));
        broken
    }

    /// All figures with their names.
    pub(super) fn figures(&self, ours: &Image, reference: &Image) -> Vec<(String, String)> {
        let mut rows = Vec::new();
        let mut row = |name: &str, value: String| rows.push((name.to_owned(), value));
        row("size", format!("{} x {}", ours.width(), ours.height()));
        let NotFinite {
            ours: in_ours,
            reference: in_reference,
        } = self.not_finite;
        row(
            "not finite",
            format!("{in_ours} in ours, {in_reference} in the reference"),
        );
        for (name, value) in self.metrics.iter().flat_map(|metrics| self.metric_rows(metrics)) {
            row(name, value);
        }
        if let Some((hdr, ldr)) = self.flip {
            let hdr = hdr.map_or_else(String::new, |hdr| format!("{hdr:.6} over exposures, "));
            row("flip", format!("{hdr}{ldr:.6} at exposure 0"));
        }
        if let Some(codes) = &self.codes {
            let value = format!(
                "{}, of which {} differ by more than the limit; the largest difference is {}, of {}",
                counted(codes.differing, "pixel"),
                codes.pixels,
                codes.largest,
                codes.kind
            );
            row("other codes", value);
        }
        if let Some(ssim) = self.ssim {
            let value = ssim.map_or_else(
                || "- (the image is smaller than the SSIM window of 11 x 11 pixels)".to_owned(),
                |ssim| format!("{ssim:.6}"),
            );
            row("ssim", value);
        }
        if let Some(found) = &self.significance {
            let test = match found.test {
                Test::Student => "Student's test",
                Test::Welch => "Welch's test",
            };
            let value = format!(
                "{} at the level {} ({test}); least p {:.2e}, significant below {:.2e}",
                counted(found.pixels, "pixel"),
                found.level,
                found.least_p,
                found.threshold
            );
            row("not explained by noise", value);
        }
        row(
            "pixels over tolerance",
            format!("{} of {}", self.over, ours.pixel_count()),
        );
        if let Some(explained) = self.explained {
            let value = format!(
                "{} with a value that the reference takes under its own variation; not counted as over tolerance",
                counted(explained, "pixel")
            );
            row("explained", value);
        }
        if let Some(ambiguous) = self.ambiguous.filter(|count| *count > 0) {
            let value = format!(
                "{} between values that the reference takes under its own variation; counted as over tolerance",
                counted(ambiguous, "pixel")
            );
            row("ambiguous", value);
        }
        if self.vacuous {
            row(
                "vacuous",
                "each image shows one colour only, so the comparison proves nothing".to_owned(),
            );
        }
        if let Some(Area { pixels, from, to }) = self.area {
            let value = format!(
                "{} within ({}, {}) to ({}, {})",
                counted(pixels, "pixel"),
                from[0],
                from[1],
                to[0],
                to[1]
            );
            row("largest connected area", value);
        }
        for channel in &self.channels {
            row(&channel.name, channel.words());
        }
        let is_other = |name: &str| {
            !["R", "G", "B"].contains(&name)
                && !LAYERS.contains(&name)
                && !self.channels.iter().any(|channel| channel.name == name)
        };
        let others = |image: &Image| -> Vec<String> {
            let names = image.channels().map(|(name, _)| name);
            names.filter(|name| is_other(name)).map(str::to_owned).collect()
        };
        let mut not_compared = [others(ours), others(reference)].concat();
        not_compared.sort();
        not_compared.dedup();
        if !not_compared.is_empty() {
            row("channels not compared", not_compared.join(", "));
        }
        rows
    }

    pub(super) fn print(&self, ours: &Image, reference: &Image) {
        for (name, value) in self.figures(ours, reference) {
            println!("{name:<22} {value}");
        }
        for pixel in &self.worst {
            println!(
                "  pixel ({}, {}): ours {:?}, reference {:?}, relative {:.3e}",
                pixel.x, pixel.y, pixel.ours, pixel.reference, pixel.residual
            );
        }
        for warning in &self.warnings {
            println!("WARNING: {warning}");
        }
        match self.broken.as_slice() {
            [] => println!("pass"),
            broken => println!("DIFFERS: {}", broken.join("; ")),
        }
    }

    fn metric_rows(&self, metrics: &Metrics) -> Vec<(&'static str, String)> {
        let mut rows = Vec::new();
        let mut row = |name: &'static str, value: String| rows.push((name, value));
        let optional = |value: Option<f64>| value.map_or_else(|| "-".to_owned(), |v| format!("{v:.6e}"));
        row("rmse", format!("{:.6e}", metrics.rmse));
        let excluded = match (self.excluded, self.explained) {
            (None, None | Some(0)) => "no pixel excluded".to_owned(),
            (Some(count), None | Some(0)) => format!("{} at edges excluded", counted(count, "pixel")),
            (None, Some(count)) => format!("{} explained, excluded", counted(count, "pixel")),
            (Some(edges), Some(count)) => format!(
                "{} at edges, {count} explained, excluded",
                counted(edges, "pixel")
            ),
        };
        row(
            "rel_rmse_interior",
            format!("{} ({excluded})", optional(metrics.rel_rmse_interior)),
        );
        row("relmse", format!("{:.6e}", metrics.relmse));
        row("mape", format!("{:.6e}", metrics.mape));
        row("smape", format!("{:.6e}", metrics.smape));
        row("mae", format!("{:.6e}", metrics.mae));
        row("max_abs", format!("{:.6e}", metrics.max_abs));
        row("signed_mean", format!("{:.6e}", metrics.signed_mean));
        let psnr = metrics
            .psnr
            .map_or_else(|| "-".to_owned(), |psnr| format!("{psnr:.2} dB"));
        row("psnr", format!("{psnr} (peak {:.6e})", metrics.psnr_peak));
        row("mean_reference", format!("{:.6e}", metrics.mean_reference));
        if let Some(block) = &metrics.signed_block_bias {
            let place = format!(
                "{:.6e} in {} of the block at ({}, {})",
                block.bias, block.channel, block.x, block.y
            );
            row("signed_block_bias", place);
        }
        rows
    }

    pub(super) fn json(&self, arguments: &Arguments, ours: &Path, reference: &Path) -> Value {
        // JSON has no infinity: a value that is not finite and its residual become null.
        json!({
            "ours": ours,
            "reference": reference,
            "status": if self.broken.is_empty() { "pass" } else { "fail" },
            "problems": self.broken,
            "warnings": self.warnings,
            "limits": {
                "max_rmse": arguments.max_rmse,
                "max_rel_rmse_interior": arguments.max_rel_rmse_interior,
                "max_over": arguments.max_over(),
                "max_code_difference": arguments.max_code_difference,
                "max_area": arguments.max_area,
                "max_flip": arguments.max_flip,
                "min_ssim": arguments.min_ssim,
                "significance": arguments.significance,
                "idiff": arguments.thresholds,
            },
            "tolerance": { "relative": arguments.relative, "absolute": arguments.absolute },
            "nonfinite": self.not_finite,
            "metrics": self.metrics,
            "edge_pixels": self.excluded,
            "flip": self.flip.and_then(|(hdr, _)| hdr),
            "flip_ldr": self.flip.map(|(_, ldr)| ldr),
            "codes": self.codes,
            "channels": self.channels,
            "ssim": self.ssim.flatten(),
            "significance": self.significance,
            "pixels_over_tolerance": self.over,
            "pixels_explained": self.explained,
            "pixels_ambiguous": self.ambiguous,
            "vacuous": self.vacuous,
            "largest_area": self.area,
            "worst": self.worst,
        })
    }

    pub(super) fn junit(&self, name: String) -> Case {
        Case {
            name,
            seconds: self.seconds,
            outcome: match self.broken.is_empty() {
                true => Outcome::Pass,
                false => Outcome::Fails(self.broken.join("\n")),
            },
        }
    }
}
