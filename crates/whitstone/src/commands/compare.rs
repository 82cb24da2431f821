//! `compare`: two images, number by number.

use crate::terminal::{Exit, Failure, write_json};
use clap::Args;
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use whitstone_image::error_map::trio;
use whitstone_image::flip::{flip, flip_ldr};
use whitstone_image::metrics::{self, NotFinite, WorstPixel};
use whitstone_image::{
    CompareOptions, ErrorView, Image, Limits, Metrics, Tolerance, ToneMap, compare, exr_io,
};
use whitstone_validate::counted;

/// Compare an image with a reference: all metrics, the pixels over tolerance, the worst pixels
///
/// Both files are OpenEXR; their channels R, G, B are compared. Images of different sizes or without these
/// channels are an error (exit code 2): nothing is cropped or resampled. Values that are not finite are
/// counted first, and one is enough to fail. A pixel is over tolerance if on any channel
/// |ours - reference| > RELATIVE * |reference| + ABSOLUTE * mean |reference|.
///
/// Exit code 0 if all limits given are kept, 1 if not. Without limits no pixel may be over tolerance.
#[derive(Args, Debug)]
#[command(
    after_help = "Example:\n  whitstone compare ours.exr reference.exr --max-rel-rmse-interior 1e-5 --png trio.png"
)]
pub struct Arguments {
    /// The image under test
    #[arg(value_name = "OURS.exr")]
    ours: PathBuf,
    /// What it should be
    #[arg(value_name = "REFERENCE.exr")]
    reference: PathBuf,
    /// Write all numbers and the verdict to this file
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    /// Write a picture: ours, the reference, and the relative error with its colour scale
    #[arg(long, value_name = "FILE")]
    png: Option<PathBuf>,
    /// Brightness of the picture, in stops
    #[arg(long, value_name = "STOPS", default_value_t = 0.0, allow_negative_numbers = true, value_parser = super::finite)]
    exposure: f64,
    /// Largest root mean squared difference that passes
    #[arg(long, value_name = "X", value_parser = at_least_0)]
    max_rmse: Option<f64>,
    /// Largest relative root mean squared difference that passes
    #[arg(long, value_name = "X", value_parser = at_least_0)]
    max_rel_rmse_interior: Option<f64>,
    /// Most pixels over tolerance that pass [default: 0 if no other limit is given, else any number]
    #[arg(long, value_name = "N")]
    max_over: Option<usize>,
    /// Tolerance of a pixel, as a fraction of the reference's value there
    #[arg(long, value_name = "RELATIVE", default_value_t = Tolerance::default().relative, value_parser = at_least_0)]
    relative: f64,
    /// Tolerance of a pixel, as a fraction of the mean of the reference
    #[arg(long, value_name = "ABSOLUTE", default_value_t = Tolerance::default().absolute, value_parser = at_least_0)]
    absolute: f64,
    /// Also how visible the difference is (FLIP), over exposures and as shown at the exposure 0: seconds a megapixel
    #[arg(long)]
    flip: bool,
    /// Largest mean of FLIP over exposures that passes, 0 to 1
    #[arg(long, value_name = "X", value_parser = at_least_0)]
    max_flip: Option<f64>,
    /// How many of the worst pixels to list
    #[arg(long, value_name = "N", default_value_t = 10)]
    worst: usize,
}

fn at_least_0(text: &str) -> Result<f64, String> {
    match super::finite(text)? {
        value if value >= 0.0 => Ok(value),
        _ => Err("expected a number of at least 0".to_owned()),
    }
}

/// What was found.
struct Comparison {
    not_finite: NotFinite,
    /// Absent where values are not finite.
    metrics: Option<Metrics>,
    /// Means of FLIP over exposures and of what is shown as it is, if wanted.
    flip: Option<[f64; 2]>,
    over: usize,
    worst: Vec<WorstPixel>,
    /// Each limit that was not kept, with the value.
    broken: Vec<String>,
}

/// Runs the command.
pub fn run(arguments: &Arguments) -> Result<Exit, Failure> {
    let read = |path: &Path| exr_io::read(path, Limits::IMAGE).map_err(Failure::usage);
    let (ours, reference) = (read(&arguments.ours)?, read(&arguments.reference)?);
    let comparison = measure(arguments, &ours, &reference)?;
    print(&comparison, &ours, &reference);
    if let Some(path) = &arguments.png {
        let tone = ToneMap {
            exposure: arguments.exposure,
        };
        let picture = trio(&ours, &reference, tone, ErrorView::default()).map_err(Failure::usage)?;
        picture.write_png(path).map_err(Failure::environment)?;
    }
    if let Some(path) = &arguments.json {
        write_json(path, &report(arguments, &comparison))?;
    }
    Ok(if comparison.broken.is_empty() {
        Exit::Pass
    } else {
        Exit::Differs
    })
}

fn measure(arguments: &Arguments, ours: &Image, reference: &Image) -> Result<Comparison, Failure> {
    let tolerance = Tolerance {
        relative: arguments.relative,
        absolute: arguments.absolute,
    };
    let not_finite = metrics::count_not_finite(ours, reference).map_err(Failure::usage)?;
    let metrics = if not_finite == NotFinite::default() {
        let options = CompareOptions {
            tolerance,
            ..CompareOptions::default()
        };
        Some(compare(ours, reference, &options).map_err(Failure::usage)?)
    } else {
        None
    };
    let wanted = metrics.is_some() && (arguments.flip || arguments.max_flip.is_some());
    let flip = match wanted {
        true => Some([
            flip(ours, reference).map_err(Failure::usage)?.mean,
            flip_ldr(ours, reference).map_err(Failure::usage)?.mean,
        ]),
        false => None,
    };
    let over = metrics::over_tolerance(ours, reference, tolerance).map_err(Failure::usage)?;
    let worst = metrics::worst(ours, reference, arguments.worst, Some(&over)).map_err(Failure::usage)?;
    let mut comparison = Comparison {
        not_finite,
        metrics,
        flip,
        over: over.count(),
        worst,
        broken: Vec::new(),
    };
    comparison.broken = broken_limits(arguments, &comparison);
    Ok(comparison)
}

fn broken_limits(arguments: &Arguments, comparison: &Comparison) -> Vec<String> {
    let mut broken = Vec::new();
    let NotFinite { ours, reference } = comparison.not_finite;
    if ours + reference > 0 {
        broken.push(format!("not finite: {}", counted(ours + reference, "value")));
    }
    if let Some(metrics) = &comparison.metrics {
        let limits = [
            ("rmse", Some(metrics.rmse), arguments.max_rmse),
            (
                "rel_rmse_interior",
                metrics.rel_rmse_interior,
                arguments.max_rel_rmse_interior,
            ),
            ("flip", comparison.flip.map(|[hdr, _]| hdr), arguments.max_flip),
        ];
        for (name, value, limit) in limits {
            if let (Some(value), Some(limit)) = (value, limit)
                && value > limit
            {
                broken.push(format!("{name} {value:.3e} is above the limit {limit:.3e}"));
            }
        }
    }
    if let Some(limit) = max_over(arguments)
        && comparison.over > limit
    {
        broken.push(format!(
            "{} pixels are over tolerance, more than {limit}",
            comparison.over
        ));
    }
    broken
}

fn max_over(arguments: &Arguments) -> Option<usize> {
    let other_limits = [
        arguments.max_rmse,
        arguments.max_rel_rmse_interior,
        arguments.max_flip,
    ]
    .iter()
    .any(Option::is_some);
    arguments.max_over.or((!other_limits).then_some(0))
}

fn print(comparison: &Comparison, ours: &Image, reference: &Image) {
    let NotFinite {
        ours: in_ours,
        reference: in_reference,
    } = comparison.not_finite;
    let row = |name: &str, value: &str| println!("{name:<22} {value}");
    let optional = |value: Option<f64>| value.map_or_else(|| "-".to_owned(), |v| format!("{v:.6e}"));
    row("size", &format!("{} x {}", ours.width(), ours.height()));
    row(
        "not finite",
        &format!("{in_ours} in ours, {in_reference} in the reference"),
    );
    if let Some(metrics) = &comparison.metrics {
        row("rmse", &format!("{:.6e}", metrics.rmse));
        row(
            "rel_rmse_interior",
            &format!("{} (no pixel excluded)", optional(metrics.rel_rmse_interior)),
        );
        row("relmse", &format!("{:.6e}", metrics.relmse));
        row("mape", &format!("{:.6e}", metrics.mape));
        row("smape", &format!("{:.6e}", metrics.smape));
        row("mae", &format!("{:.6e}", metrics.mae));
        row("max_abs", &format!("{:.6e}", metrics.max_abs));
        row("signed_mean", &format!("{:.6e}", metrics.signed_mean));
        let psnr = metrics
            .psnr
            .map_or_else(|| "-".to_owned(), |psnr| format!("{psnr:.2} dB"));
        row("psnr", &format!("{psnr} (peak {:.6e})", metrics.psnr_peak));
        row("mean_reference", &format!("{:.6e}", metrics.mean_reference));
        if let Some(block) = &metrics.signed_block_bias {
            let place = format!(
                "{:.6e} in {} of the block at ({}, {})",
                block.bias, block.channel, block.x, block.y
            );
            row("signed_block_bias", &place);
        }
    }
    if let Some([hdr, ldr]) = comparison.flip {
        row(
            "flip",
            &format!("{hdr:.6} over exposures, {ldr:.6} at exposure 0"),
        );
    }
    row(
        "pixels over tolerance",
        &format!("{} of {}", comparison.over, ours.pixel_count()),
    );
    for pixel in &comparison.worst {
        println!(
            "  pixel ({}, {}): ours {:?}, reference {:?}, relative {:.3e}",
            pixel.x, pixel.y, pixel.ours, pixel.reference, pixel.residual
        );
    }
    let others = |image: &Image| -> Vec<String> {
        let names = image.channels().map(|(name, _)| name.to_owned());
        names
            .filter(|name| !["R", "G", "B"].contains(&name.as_str()))
            .collect()
    };
    let mut not_compared = [others(ours), others(reference)].concat();
    not_compared.sort();
    not_compared.dedup();
    if !not_compared.is_empty() {
        row("channels not compared", &not_compared.join(", "));
    }
    match comparison.broken.as_slice() {
        [] => println!("pass"),
        broken => println!("DIFFERS: {}", broken.join("; ")),
    }
}

fn report(arguments: &Arguments, comparison: &Comparison) -> Value {
    // JSON has no infinity: a residual of a value that is not finite is null, and so is the value.
    json!({
        "ours": arguments.ours,
        "reference": arguments.reference,
        "status": if comparison.broken.is_empty() { "pass" } else { "fail" },
        "problems": comparison.broken,
        "limits": {
            "max_rmse": arguments.max_rmse,
            "max_rel_rmse_interior": arguments.max_rel_rmse_interior,
            "max_over": max_over(arguments),
            "max_flip": arguments.max_flip,
        },
        "tolerance": { "relative": arguments.relative, "absolute": arguments.absolute },
        "nonfinite": comparison.not_finite,
        "metrics": comparison.metrics,
        "flip": comparison.flip.map(|[hdr, _]| hdr),
        "flip_ldr": comparison.flip.map(|[_, ldr]| ldr),
        "pixels_over_tolerance": comparison.over,
        "worst": comparison.worst,
    })
}
