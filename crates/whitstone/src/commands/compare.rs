//! `compare`: compares two images, or two folders of images, number by number.

mod accept;
mod channels;
mod folders;
mod input;
mod measure;
mod page;
#[cfg(feature = "view")]
mod review;
mod thresholds;

use super::junit;
use crate::terminal::{Exit, Failure, write_json};
use channels::ChannelLimit;
use clap::Args;
use measure::{Comparison, Judged, measure};
use std::path::{Path, PathBuf};
use thresholds::Thresholds;
pub(super) use thresholds::with_two_hyphens;
use whitstone_image::{Image, ToneMap, Transfer};
use whitstone_metrics::edges::EdgeLayer;
use whitstone_metrics::error_map::trio;
use whitstone_metrics::range::Ranges;
use whitstone_metrics::{ErrorView, Tolerance};
use whitstone_validate::Variants;
use whitstone_validate::stored::read_variants;

/// Compare an image with a reference image, or a folder of images with a folder of references
///
/// Prints all metrics, the number of pixels over tolerance, and the worst pixels.
///
/// The files are OpenEXR, HDR, PFM, TIFF, PNG, JPEG or WebP; their channels R, G, B are compared.
/// Images of different sizes or without these channels are an error (exit code 2): nothing is
/// cropped or resampled. Non-finite values are counted first, and a single one fails the
/// comparison. A pixel is over tolerance if on any channel |ours - reference| > RELATIVE *
/// |reference| + ABSOLUTE * mean |reference|.
///
/// Two images with 8-bit or 16-bit codes are compared exactly instead, code by code, and by FLIP. A
/// file with codes and one with floating-point numbers are an error.
///
/// For two folders, all *.exr files with the same relative path are compared; --extension names
/// others. A file that exists in only one of them is an error.
///
/// Images with layers of variance are also tested for differences that noise does not explain:
/// docs/compare.md.
///
/// The limits -fail, -failpercent, -hardfail, -warn, -warnpercent and -hardwarn are those of
/// OpenImageIO's idiff; these may have one hyphen or two.
///
/// Exit code 0 if no given limit is exceeded, 1 if one is. Without limits no pixel may be over
/// tolerance.
#[derive(Args, Debug)]
#[command(
    help_template = super::HELP_TEMPLATE,
    after_help = "Examples:\n  whitstone compare ours.exr reference.exr --max-rel-rmse-interior 1e-5 --png trio.png\n  whitstone compare renders references --junit compare.xml\n  whitstone compare ours.png reference.png --max-code-difference 1"
)]
pub struct Arguments {
    /// Image under test, or a folder of images
    #[arg(value_name = "OURS")]
    ours: PathBuf,
    /// Reference image, or a folder of images
    #[arg(value_name = "REFERENCE")]
    reference: PathBuf,
    /// Another reference that is accepted; can be repeated. The comparison passes if it passes with
    /// one of them. For two folders, a folder of references; those that it lacks are no error
    #[arg(long, value_name = "PATH")]
    or: Vec<PathBuf>,
    /// Two images between whose values every value is accepted, with the same tolerance outside;
    /// for two folders, folders of such images, and images without a range are compared as usual
    #[arg(long, value_names = ["MIN", "MAX"], num_args = 2)]
    reference_range: Vec<PathBuf>,
    /// Make OURS the reference where the two differ or REFERENCE does not exist: write OURS to
    /// REFERENCE, atomically, and nothing else. Of two folders, images that exist only in REFERENCE
    /// stay
    #[arg(long)]
    accept: bool,
    #[cfg(feature = "view")]
    #[command(flatten)]
    review: review::ReviewArguments,
    /// Image that is black where the images need not agree; such pixels count as equal. For two
    /// folders, a folder of masks; images without a mask are compared whole
    #[arg(long, value_name = "PATH")]
    mask: Option<PathBuf>,
    /// Colours to compare in EXR files: LAYER.R, LAYER.G and LAYER.B, or a single channel [default:
    /// R, G, B]
    #[arg(long, value_name = "LAYER")]
    layer: Option<String>,
    /// Also compare this channel: a value that differs by more than LIMIT [default: 0] fails. The
    /// name may end in *, which stands for anything, as in 'normal.*=1e-4'; the first limit that
    /// covers a channel counts; can be repeated
    #[arg(long = "channel", value_name = "NAME[=LIMIT]", value_parser = ChannelLimit::parse)]
    channels: Vec<ChannelLimit>,
    /// How codes represent light, for all measures except the exact comparison: srgb, linear, or
    /// the exponent of a gamma curve
    #[arg(long, value_name = "CURVE", default_value = "srgb", value_parser = transfer)]
    transfer: Transfer,
    /// Largest difference of codes that counts as equal
    #[arg(long, value_name = "N", default_value_t = 0)]
    max_code_difference: u32,
    /// Extension of the files to compare in two folders; can be repeated
    #[arg(long, value_name = "EXT", default_value = "exr")]
    extension: Vec<String>,
    /// Write all numbers and the verdict to this file as JSON; - means standard output
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    /// Write the verdict to this file as JUnit XML, which most CI systems display
    #[arg(long, value_name = "FILE")]
    junit: Option<PathBuf>,
    /// Write a page to this file: all images with their verdicts, the pictures under a slider, the
    /// values of each pixel and all figures
    #[arg(long, value_name = "FILE")]
    html: Option<PathBuf>,
    /// Write a picture of the image, the reference, and the relative error with its colour scale;
    /// for two folders, write a folder of pictures
    #[arg(long, value_name = "PATH")]
    png: Option<PathBuf>,
    /// Exposure of the picture and of the images that SSIM compares, in stops
    #[arg(long, value_name = "STOPS", default_value_t = 0.0, allow_negative_numbers = true, value_parser = super::finite)]
    exposure: f64,
    /// Maximum root mean square difference
    #[arg(long, value_name = "X", value_parser = at_least_0)]
    max_rmse: Option<f64>,
    /// Maximum relative root mean square difference over the interior: all pixels except explained
    /// ones and those that --edges-of excludes
    #[arg(long, value_name = "X", value_parser = at_least_0)]
    max_rel_rmse_interior: Option<f64>,
    /// Exclude pixels at the edges of this layer of either image from the interior; numeric layers
    /// need a step, as in depth.Z=0.1; can be repeated
    #[arg(long = "edges-of", value_name = "LAYER[=STEP]", value_parser = edge_layer)]
    edges_of: Vec<EdgeLayer>,
    /// Maximum number of pixels over tolerance [default: 0 if no other limit is given, else
    /// unlimited]
    #[arg(long, value_name = "N")]
    max_over: Option<usize>,
    /// Maximum size of a connected area of pixels over tolerance, in pixels
    #[arg(long, value_name = "N")]
    max_area: Option<usize>,
    /// Tolerance of a pixel, as a fraction of the reference's value there
    #[arg(long, value_name = "RELATIVE", default_value_t = Tolerance::default().relative, value_parser = at_least_0)]
    relative: f64,
    /// Tolerance of a pixel, as a fraction of the mean of the reference
    #[arg(long, value_name = "ABSOLUTE", default_value_t = Tolerance::default().absolute, value_parser = at_least_0)]
    absolute: f64,
    /// Also compute the visible difference (FLIP), over exposures and at exposure 0
    #[arg(long)]
    flip: bool,
    /// Maximum mean of FLIP over exposures, 0 to 1
    #[arg(long, value_name = "X", value_parser = at_least_0)]
    max_flip: Option<f64>,
    /// Also compute the structural similarity (SSIM) of the displayed images
    #[arg(long)]
    ssim: bool,
    /// Minimum SSIM, at most 1
    #[arg(long, value_name = "X", allow_negative_numbers = true, value_parser = super::finite)]
    min_ssim: Option<f64>,
    /// Significance level over the whole image: fail if a difference is larger than noise explains
    /// at this level; needs layers of variance
    #[arg(long, value_name = "P", value_parser = probability)]
    significance: Option<f64>,
    #[command(flatten)]
    thresholds: Thresholds,
    /// Number of worst pixels to list
    #[arg(long, value_name = "N", default_value_t = 10)]
    worst: usize,
}

fn at_least_0(text: &str) -> Result<f64, String> {
    match super::finite(text)? {
        value if value >= 0.0 => Ok(value),
        _ => Err("expected a number of at least 0".to_owned()),
    }
}

fn transfer(text: &str) -> Result<Transfer, String> {
    match text {
        "srgb" => Ok(Transfer::Srgb),
        "linear" => Ok(Transfer::Linear),
        _ => match super::finite(text) {
            Ok(exponent) if exponent > 0.0 => Ok(Transfer::Gamma(exponent)),
            _ => Err("expected srgb, linear or a number above 0".to_owned()),
        },
    }
}

fn probability(text: &str) -> Result<f64, String> {
    match super::finite(text)? {
        value if value > 0.0 && value < 1.0 => Ok(value),
        _ => Err("expected a number above 0 and below 1".to_owned()),
    }
}

fn edge_layer(text: &str) -> Result<EdgeLayer, String> {
    let (channel, step) = match text.rsplit_once('=') {
        Some((channel, step)) => (channel, at_least_0(step)?),
        None if text.ends_with(".I") => (text, 0.0),
        None => {
            return Err(format!(
                "the layer {text} needs a step: write {text}=STEP; only id layers, whose names end in .I, need none"
            ));
        }
    };
    Ok(EdgeLayer {
        channel: channel.to_owned(),
        step,
    })
}

impl Arguments {
    /// The files of a comparison of two images.
    fn files(&self) -> Files {
        Files {
            ours: self.ours.clone(),
            references: std::iter::once(&self.reference)
                .chain(&self.or)
                .cloned()
                .collect(),
            mask: self.mask.clone(),
            range: range(&self.reference_range, None),
        }
    }

    fn tolerance(&self) -> Tolerance {
        Tolerance {
            relative: self.relative,
            absolute: self.absolute,
        }
    }

    fn tone(&self) -> ToneMap {
        ToneMap {
            exposure: self.exposure,
            ..ToneMap::default()
        }
    }

    /// The limit of the number of pixels over tolerance; none if other limits are given.
    fn max_over(&self) -> Option<usize> {
        let measured = [
            self.max_rmse,
            self.max_rel_rmse_interior,
            self.max_flip,
            self.min_ssim,
            self.significance,
        ];
        let others =
            self.max_area.is_some() || self.thresholds.can_fail() || measured.iter().any(Option::is_some);
        self.max_over.or((!others).then_some(0))
    }
}

/// Runs the command.
pub fn run(arguments: &Arguments) -> Result<Exit, Failure> {
    let folder = arguments.ours.is_dir();
    let mut others = (arguments.or.iter())
        .chain(&arguments.mask)
        .chain(&arguments.reference_range);
    if let Some(other) = others.find(|other| other.is_dir() != folder) {
        return Err(Failure::usage(format!(
            "{} should be {}, like {}",
            other.display(),
            if folder { "a folder" } else { "a file" },
            arguments.ours.display()
        )));
    }
    match [folder, arguments.reference.is_dir()] {
        [true, true] => folders::run(arguments),
        [false, false] => run_files(arguments),
        [ours, _] => {
            let (folder, file) = match ours {
                true => (&arguments.ours, &arguments.reference),
                false => (&arguments.reference, &arguments.ours),
            };
            Err(Failure::usage(format!(
                "{} is a folder and {} is not; name two images or two folders",
                folder.display(),
                file.display()
            )))
        }
    }
}

fn run_files(arguments: &Arguments) -> Result<Exit, Failure> {
    #[cfg(feature = "view")]
    if arguments.review.is_wanted() {
        return review_files(arguments);
    }
    let found = arguments.files().compare(arguments);
    if arguments.accept
        && found
            .as_ref()
            .map_or(true, |found| !found.comparison.broken.is_empty())
    {
        accept::accept(&arguments.ours, &arguments.reference)?;
        report(arguments, &found, true)?;
        return Ok(Exit::Pass);
    }
    let exit = match &found {
        Ok(found) => found.comparison.exit(),
        Err(_) => {
            write(arguments, &found, false)?;
            return found.map(|_| Exit::Differs);
        }
    };
    report(arguments, &found, false)?;
    Ok(exit)
}

/// Shows the pair on a page, on which it can be accepted.
#[cfg(feature = "view")]
fn review_files(arguments: &Arguments) -> Result<Exit, Failure> {
    let seen = review::Seen::of(&arguments.ours, &arguments.reference);
    let found = arguments.files().compare(arguments);
    if !arguments.ours.is_file() {
        return found.map(|found| found.comparison.exit());
    }
    let name = arguments.ours.display().to_string();
    let (comparable, problems) = match &found {
        Ok(found) => {
            let [ours, reference] = &found.images;
            found.comparison.print(ours, reference);
            (true, found.comparison.broken.clone())
        }
        Err(problem) => {
            println!("not comparable: {}", problem.text());
            (false, vec![problem.text().to_owned()])
        }
    };
    let item = review::Item {
        name: &name,
        files: arguments.files(),
        seen,
        comparable,
        problems,
    };
    match review::run(arguments, &[item])?[..] {
        [true] => {
            write(arguments, &found, true)?;
            Ok(Exit::Pass)
        }
        _ => {
            let found = found?;
            let exit = found.comparison.exit();
            write(arguments, &Ok(found), false)?;
            Ok(exit)
        }
    }
}

/// Prints and writes the result of a comparison, after which ours may have become the reference.
fn report(arguments: &Arguments, found: &Result<Compared, Failure>, accepted: bool) -> Result<(), Failure> {
    match found {
        Ok(found) => {
            let [ours, reference] = &found.images;
            found.comparison.print(ours, reference);
            if !arguments.or.is_empty() {
                println!("{:<22} {}", "compared with", found.reference.display());
            }
        }
        Err(problem) => println!("not comparable: {}", problem.text()),
    }
    if accepted {
        println!(
            "accepted: {} now has the contents of {}",
            arguments.reference.display(),
            arguments.ours.display()
        );
    }
    write(arguments, found, accepted)
}

/// Writes the result of a comparison.
fn write(arguments: &Arguments, found: &Result<Compared, Failure>, accepted: bool) -> Result<(), Failure> {
    let name = arguments.ours.display().to_string();
    let mut value = serde_json::json!({ "ours": arguments.ours, "reference": arguments.reference });
    let mut case = junit::Case {
        name: name.clone(),
        seconds: 0.0,
        outcome: junit::Outcome::Pass,
    };
    match found {
        Ok(found) => {
            let [ours, reference] = &found.images;
            if let Some(path) = &arguments.png {
                write_trio(arguments, ours, reference, path)?;
            }
            value = found
                .comparison
                .json(arguments, &arguments.ours, &found.reference);
            if !accepted {
                case = found.comparison.junit(name);
            }
        }
        Err(problem) => {
            value["status"] = "error".into();
            value["problems"] = serde_json::json!([problem.text()]);
            if !accepted {
                case.outcome = junit::Outcome::Error(problem.text().to_owned());
            }
        }
    }
    if accepted {
        value["status"] = "accepted".into();
    }
    if let Some(path) = &arguments.json {
        write_json(path, &value)?;
    }
    if let Some(path) = &arguments.html {
        let problems = match found {
            Ok(found) => found.comparison.broken.clone(),
            Err(problem) => vec![problem.text().to_owned()],
        };
        let entry = page::Entry {
            name: case.name.clone(),
            word: word(found.is_ok(), problems.is_empty(), accepted),
            is_right: accepted || problems.is_empty(),
            problems,
            details: page::details(arguments, &arguments.files(), found.as_ref().ok(), Vec::new()),
        };
        page::write(arguments, path, &[entry])?;
    }
    if let Some(path) = &arguments.junit {
        junit::write(path, "whitstone compare", &[case])?;
    }
    Ok(())
}

/// The word of a verdict.
fn word(is_comparable: bool, passes: bool, accepted: bool) -> &'static str {
    match (accepted, is_comparable, passes) {
        (true, ..) => "accepted",
        (false, false, _) => "not comparable",
        (false, true, true) => "pass",
        (false, true, false) => "differs",
    }
}

/// The files of a comparison.
#[derive(Clone)]
struct Files {
    ours: PathBuf,
    /// The reference that accepting writes, then others that are accepted too.
    references: Vec<PathBuf>,
    mask: Option<PathBuf>,
    range: Option<[PathBuf; 2]>,
}

impl Files {
    /// The reference that accepting writes.
    fn reference(&self) -> &Path {
        &self.references[0]
    }

    /// Compares with the first reference that passes; if none does, with the one that breaks the
    /// fewest limits, and of these with the one that has the fewest pixels over tolerance.
    fn compare(&self, arguments: &Arguments) -> Result<Compared, Failure> {
        let mut best: Option<Compared> = None;
        for reference in &self.references {
            let found = self.compare_with(arguments, reference)?;
            if found.comparison.broken.is_empty() {
                return Ok(found);
            }
            if best
                .as_ref()
                .is_none_or(|best| found.comparison.distance() < best.comparison.distance())
            {
                best = Some(found);
            }
        }
        best.ok_or_else(|| Failure::usage("there is no reference"))
    }

    fn compare_with(&self, arguments: &Arguments, reference: &Path) -> Result<Compared, Failure> {
        let read = |path: &Path| input::read(path, arguments.layer.as_deref(), arguments.transfer);
        let (ours, of_reference) = rayon::join(|| read(&self.ours), || read(reference));
        let mut inputs = [ours?, of_reference?];
        if let Some([least, most]) = &self.range {
            input::widen(&mut inputs, [least, most]).map_err(Failure::usage)?;
        }
        if let Some(mask) = &self.mask {
            input::hide(&mut inputs, mask).map_err(Failure::usage)?;
        }
        let codes =
            input::codes(&inputs[0], &inputs[1], arguments.max_code_difference).map_err(Failure::usage)?;
        let [ours, of_reference] = inputs;
        let images: [Image; 2] = rayon::join(|| ours.linear(), || of_reference.linear()).into();
        let variants = match Ranges::of(&images[1]).map_err(Failure::usage)? {
            Some(_) => read_variants(&variants_of(reference)).map_err(Failure::usage)?,
            None => Variants::default(),
        };
        let (comparison, judged) = measure(arguments, &images[0], &images[1], &variants, codes)?;
        Ok(Compared {
            comparison,
            judged,
            images,
            reference: reference.to_owned(),
        })
    }
}

/// The two images of a range; of folders the ones at a path, if there are such.
fn range(paths: &[PathBuf], below: Option<&Path>) -> Option<[PathBuf; 2]> {
    let [least, most] = paths else { return None };
    let Some(below) = below else {
        return Some([least.clone(), most.clone()]);
    };
    let both = [least.join(below), most.join(below)];
    both.iter().any(|path| path.exists()).then_some(both)
}

/// A comparison of two files.
struct Compared {
    comparison: Comparison,
    judged: Judged,
    /// Ours, and the reference.
    images: [Image; 2],
    reference: PathBuf,
}

/// The file of the values that a stored reference takes, next to its image.
fn variants_of(reference: &Path) -> PathBuf {
    reference.with_extension("variants.exr")
}

fn write_trio(arguments: &Arguments, ours: &Image, reference: &Image, path: &Path) -> Result<(), Failure> {
    let picture = trio(ours, reference, arguments.tone(), ErrorView::default()).map_err(Failure::usage)?;
    picture.write_png(path).map_err(Failure::environment)
}
