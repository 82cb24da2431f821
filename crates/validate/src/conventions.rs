//! Finds the conventions by which a subject differs from the model: where it samples a pixel, its
//! reconstruction filter, reversed rows or columns, the axis of the field of view, light units, and
//! the transfer function.
//!
//! The subject renders two probe scenes. Whitstone renders them with 8 x 8 samples per pixel at
//! known places, from which the image under any hypothesis is composed. The hypothesis with the
//! smallest error is found by coordinate descent from the best of a coarse grid. A convention is
//! *found* if the error without it is clearly larger.

use crate::stop::Stop;
use crate::subject::render::{Job, SubjectError, render};
use crate::subject::{Subject, shifted};
use crate::validator::flatten_sources;
use serde::Serialize;
use std::fmt;
use std::path::Path;
use whitstone_core::Registry;
use whitstone_image::{Image, Transfer};
use whitstone_render::{BuildOptions, Pipeline, RenderOptions};
use whitstone_scene::Sources;

/// Samples per pixel along each axis: the resolution of an offset.
const SUPER: usize = 8;
/// Pixels at the border that are not compared: some hypotheses look beyond it.
const MARGIN: usize = 3;
/// Size of the probe images. They are not square, so that the axis of the field of view shows.
const SIZE: [usize; 2] = [96, 64];
/// Largest offset along an axis, in pixels.
const FARTHEST: i32 = 1;
/// A convention is found if the error without it is larger by this factor and by
/// [`CLEARLY_MORE`].
const CLEARLY: f64 = 1.25;
/// In units of the mean of the image.
const CLEARLY_MORE: f64 = 2e-4;
/// Largest relative difference of two factors that are taken as the same.
const SAME_FACTOR: f64 = 2e-3;

/// What both probes show: balls and a wall, without any symmetry. They are lit by what follows.
const PROBE: &str = r#"
[film]
width = 96
height = 64
[camera]
type = "perspective"
look_at = { origin = [0.3, 0.5, 5], target = [0, 0, 0] }
fov = 50
[[shape]]
type = "sphere"
center = [-1, 0.4, 0]
radius = 0.8
material = { type = "matte", reflectance = [0.8, 0.5, 0.3] }
[[shape]]
type = "sphere"
center = [0.9, -0.5, 0.5]
radius = 0.6
material = { type = "matte", reflectance = [0.3, 0.7, 0.5] }
[[shape]]
type = "rectangle"
transform = [{ rotate = { axis = [1, 0.4, 0], degrees = -25 } }, { translate = [0.5, 0.3, -2] }]
material = { type = "matte", reflectance = [0.4, 0.4, 0.9] }
"#;
/// The light of the first probe, and of the second.
const LIGHTS: [(&str, &str); 2] = [
    (
        "directional",
        "[[light]]\ntype = \"directional\"\ndirection = [-1, -2, -3]\nirradiance = 2\n",
    ),
    (
        "point",
        "[[light]]\ntype = \"point\"\nposition = [2, 3, 4]\nintensity = 40\n",
    ),
];

/// Factors between units of light that programs use, and their names.
const FACTORS: [(f64, &str); 9] = [
    (
        std::f64::consts::PI,
        "pi: a factor of 1/pi in the reflection, or in the light, is missing or twice",
    ),
    (
        4.0 * std::f64::consts::PI,
        "4 pi: the power of a point light is taken as its intensity",
    ),
    (2.0 * std::f64::consts::PI, "2 pi"),
    (std::f64::consts::PI * std::f64::consts::PI, "pi squared"),
    (4.0 * std::f64::consts::PI * std::f64::consts::PI, "4 pi squared"),
    (683.0, "683: photometric units are taken as radiometric ones"),
    (
        683.0 / (4.0 * std::f64::consts::PI),
        "683/(4 pi): lumen is taken as W/sr",
    ),
    (2.0, "2"),
    (4.0, "4"),
];

/// A reconstruction filter.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Filter {
    /// One sample.
    Point,
    /// The mean over a square of this width in pixels.
    Box(f64),
    /// A tent of this radius in pixels.
    Tent(f64),
    /// A Gaussian of this standard deviation in pixels.
    Gaussian(f64),
}

impl fmt::Display for Filter {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Point => write!(f, "one sample"),
            Self::Box(width) => write!(f, "a box of {width} pixels"),
            Self::Tent(radius) => write!(f, "a tent with a radius of {radius} pixels"),
            Self::Gaussian(deviation) => write!(f, "a Gaussian with a deviation of {deviation} pixels"),
        }
    }
}

/// The filters that are tried.
const FILTERS: [Filter; 8] = [
    Filter::Point,
    Filter::Box(1.0),
    Filter::Box(2.0),
    Filter::Tent(1.0),
    Filter::Gaussian(0.25),
    Filter::Gaussian(0.375),
    Filter::Gaussian(0.5),
    Filter::Gaussian(0.75),
];

impl Filter {
    /// Distances in samples, and their weights.
    fn weights(self) -> Vec<(i32, f64)> {
        let unit = SUPER as f64;
        let (reach, weight): (f64, Box<dyn Fn(f64) -> f64>) = match self {
            Self::Point => (0.0, Box::new(|_| 1.0)),
            Self::Box(width) => {
                let half = 0.5 * width * unit;
                // The samples at both ends count by half.
                (
                    half,
                    Box::new(move |d: f64| if d.abs() < half { 1.0 } else { 0.5 }),
                )
            }
            Self::Tent(radius) => (radius * unit, Box::new(move |d: f64| radius * unit - d.abs())),
            Self::Gaussian(deviation) => {
                let deviation = deviation * unit;
                let reach = (3.0 * deviation).min(2.0 * unit);
                (
                    reach,
                    Box::new(move |d: f64| (-0.5 * (d / deviation).powi(2)).exp()),
                )
            }
        };
        let reach = reach as i32;
        let all: Vec<(i32, f64)> = (-reach..=reach).map(|d| (d, weight(f64::from(d)))).collect();
        let sum: f64 = all.iter().map(|(_, weight)| weight).sum();
        all.into_iter().map(|(d, weight)| (d, weight / sum)).collect()
    }
}

/// The transfer functions that are tried, with their names in a configuration.
const TRANSFERS: [(Transfer, &str); 3] = [
    (Transfer::Linear, "linear"),
    (Transfer::Srgb, "sRGB"),
    (Transfer::Gamma(2.2), "a gamma of 2.2"),
];

/// A hypothesis.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Guess {
    /// In samples, to the right and down.
    offset: [i32; 2],
    flip: [bool; 2],
    /// Whether the field of view is along y.
    along_y: bool,
    /// Index in [`TRANSFERS`].
    transfer: usize,
    filter: Filter,
}

/// A subject by the model.
const CONFORMING: Guess = Guess {
    offset: [0; 2],
    flip: [false; 2],
    along_y: false,
    transfer: 0,
    filter: Filter::Point,
};

/// A way in which a subject differs from the model.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Finding {
    /// The convention.
    pub convention: &'static str,
    /// What the subject does, as a sentence.
    pub sentence: String,
    /// The error of its image with this convention, in units of the mean.
    pub error: f64,
    /// The error of its image without it.
    pub error_without: f64,
    /// The key of the subject's table that states it, if there is one.
    pub key: Option<String>,
}

/// What the probes show.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Conventions {
    /// The differences from the model, the clearest one first.
    pub findings: Vec<Finding>,
    /// The error that no tried convention explains, in units of the mean, of each probe.
    pub errors: Vec<(&'static str, f64)>,
    /// Probes that the subject could not render, and why.
    pub skipped: Vec<(&'static str, String)>,
}

/// Whitstone's samples of a probe: position (x, y) is at (x, y)/[`SUPER`] pixels.
struct Samples {
    /// With the field of view along x, and along y.
    planes: [[Vec<f32>; 3]; 2],
}

/// The probe's image under a hypothesis, without flips: three planes.
fn compose(samples: &Samples, guess: &Guess) -> [Vec<f64>; 3] {
    let weights = guess.filter.weights();
    let [width, height] = SIZE;
    let (columns, rows) = (width * SUPER, height * SUPER);
    let half = SUPER as i32 / 2;
    let at = |pixel: usize, offset: i32, d: i32, end: usize| {
        let place = (pixel * SUPER) as i32 + half + offset + d;
        place.clamp(0, end as i32 - 1) as usize
    };
    let planes = &samples.planes[usize::from(guess.along_y)];
    std::array::from_fn(|channel| {
        let plane = &planes[channel];
        let mut filtered = vec![0.0; width * rows];
        for y in 0..rows {
            for x in 0..width {
                let sum = weights.iter().map(|&(d, weight)| {
                    weight * f64::from(plane[y * columns + at(x, guess.offset[0], d, columns)])
                });
                filtered[y * width + x] = sum.sum();
            }
        }
        let mut image = vec![0.0; width * height];
        for y in 0..height {
            for x in 0..width {
                let sum = weights
                    .iter()
                    .map(|&(d, weight)| weight * filtered[at(y, guess.offset[1], d, rows) * width + x]);
                image[y * width + x] = sum.sum();
            }
        }
        image
    })
}

/// The error of an image under a hypothesis in units of the mean, and the factor that takes the
/// image to the model's values. With `scaled`, the factor is the best one, otherwise 1.
fn error(samples: &Samples, image: &Image, guess: &Guess, scaled: bool) -> (f64, f64) {
    let expected = compose(samples, guess);
    let Ok(planes) = image.rgb() else {
        return (f64::INFINITY, 1.0);
    };
    let [width, height] = SIZE;
    let transfer = TRANSFERS[guess.transfer].0;
    let mut pairs = Vec::with_capacity(3 * width * height);
    for (expected, plane) in expected.iter().zip(planes) {
        for y in MARGIN..height - MARGIN {
            for x in MARGIN..width - MARGIN {
                let from_x = if guess.flip[0] { width - 1 - x } else { x };
                let from_y = if guess.flip[1] { height - 1 - y } else { y };
                let value = transfer.decode(f64::from(plane[from_y * width + from_x]));
                pairs.push((value, expected[y * width + x]));
            }
        }
    }
    let sum = |of: &dyn Fn(f64, f64) -> f64| {
        pairs
            .iter()
            .map(|&(value, expected)| of(value, expected))
            .sum::<f64>()
    };
    let factor = match scaled {
        true => sum(&|value, expected| value * expected) / sum(&|value, _| value * value),
        false => 1.0,
    };
    if !(factor.is_finite() && factor > 0.0) {
        return (f64::INFINITY, 1.0);
    }
    let count = pairs.len() as f64;
    let squares = sum(&|value, expected| (factor * value - expected).powi(2)) / count;
    let mean = sum(&|_, expected| expected) / count;
    let error = squares.sqrt() / mean;
    (if error.is_finite() { error } else { f64::INFINITY }, factor)
}

/// All hypotheses that differ from one in a single convention.
fn neighbours(guess: &Guess, offsets: &[i32]) -> Vec<Guess> {
    let mut found = Vec::new();
    for &x in offsets {
        for &y in offsets {
            found.push(Guess {
                offset: [x, y],
                ..*guess
            });
        }
    }
    for flip in [[false, false], [true, false], [false, true], [true, true]] {
        found.push(Guess { flip, ..*guess });
    }
    found.extend([false, true].map(|along_y| Guess { along_y, ..*guess }));
    found.extend((0..TRANSFERS.len()).map(|transfer| Guess { transfer, ..*guess }));
    found.extend(FILTERS.map(|filter| Guess { filter, ..*guess }));
    found
}

/// The hypothesis with the smallest error among those that `allowed` accepts.
fn best(samples: &Samples, image: &Image, allowed: &dyn Fn(&Guess) -> bool) -> (f64, Guess) {
    let mut best = (f64::INFINITY, CONFORMING);
    let consider = |guess: &Guess, best: &mut (f64, Guess)| {
        if allowed(guess) {
            let (error, _) = error(samples, image, guess, true);
            // Of equal ones the first, which is nearest to the model.
            if error < best.0 {
                *best = (error, *guess);
            }
        }
    };
    // What is discrete, on a coarse grid.
    for along_y in [false, true] {
        for flip in [[false, false], [true, false], [false, true], [true, true]] {
            for transfer in 0..TRANSFERS.len() {
                let guess = Guess {
                    along_y,
                    flip,
                    transfer,
                    ..CONFORMING
                };
                consider(&guess, &mut best);
            }
        }
    }
    let half = SUPER as i32 / 2;
    let far = FARTHEST * SUPER as i32;
    for _ in 0..4 {
        let before = best;
        let coarse: Vec<i32> = (-far..=far).step_by(half as usize).collect();
        for guess in neighbours(&before.1, &coarse) {
            consider(&guess, &mut best);
        }
        let [x, y] = best.1.offset;
        for dx in -half + 1..half {
            for dy in -half + 1..half {
                let guess = Guess {
                    offset: [(x + dx).clamp(-far, far), (y + dy).clamp(-far, far)],
                    ..best.1
                };
                consider(&guess, &mut best);
            }
        }
        if best == before {
            break;
        }
    }
    best
}

/// What an image of the first probe shows.
///
/// Returns the remaining error, the findings, and the factor of a directional light; 1 if it is not
/// found.
fn examine(samples: &Samples, image: &Image, subject: &Subject) -> (f64, Vec<Finding>, f64) {
    let (least, found) = best(samples, image, &|_| true);
    let mut findings = Vec::new();
    let mut test = |convention, allowed: &dyn Fn(&Guess) -> bool, sentence: String, key: Option<String>| {
        let (without, _) = best(samples, image, allowed);
        if without > CLEARLY * least + CLEARLY_MORE {
            findings.push(Finding {
                convention,
                sentence,
                error: least,
                error_without: without,
                key,
            });
        }
    };
    let pixels = |samples: i32| f64::from(samples) / SUPER as f64;
    if found.offset != [0; 2] {
        let [x, y] = found.offset.map(pixels);
        let total = [x + subject.offset[0], y + subject.offset[1]];
        test(
            "pixel offset",
            &|guess| guess.offset == [0; 2],
            format!("pixels are sampled {} from their centres", direction(x, y)),
            Some(format!("offset = [{:?}, {:?}]", total[0], total[1])),
        );
    }
    if found.filter != Filter::Point {
        test(
            "pixel filter",
            &|guess| guess.filter == Filter::Point,
            format!("a pixel is {} instead of one sample at its centre", found.filter),
            None,
        );
    }
    for (axis, what) in [(0, "columns"), (1, "rows")] {
        if found.flip[axis] {
            test(
                if axis == 0 { "columns" } else { "rows" },
                &move |guess| !guess.flip[axis],
                format!("the {what} of the image are reversed"),
                Some(flip_key(found.flip, subject.flip)),
            );
        }
    }
    if found.along_y {
        test(
            "field of view",
            &|guess| !guess.along_y,
            "the field of view is along y instead of x".to_owned(),
            None,
        );
    }
    if found.transfer != 0 {
        let (transfer, name) = TRANSFERS[found.transfer];
        test(
            "transfer",
            &|guess| guess.transfer == 0,
            format!("the values have the transfer function of {name}, and are declared as linear"),
            match transfer {
                Transfer::Linear => None,
                Transfer::Srgb => Some("transfer = \"srgb\"".to_owned()),
                Transfer::Gamma(exponent) => Some(format!("transfer = \"gamma\"\ngamma = {exponent}")),
            },
        );
    }
    let (_, factor) = error(samples, image, &found, true);
    let (unscaled, _) = error(samples, image, &found, false);
    let is_scaled = unscaled > CLEARLY * least + CLEARLY_MORE;
    if is_scaled {
        findings.push(Finding {
            convention: "light units",
            sentence: factor_sentence("directional light", factor),
            error: least,
            error_without: unscaled,
            key: Some(format!("scale = {:?}", six_digits(factor * subject.scale))),
        });
    }
    findings.sort_by(|a, b| b.error_without.total_cmp(&a.error_without));
    (least, findings, if is_scaled { factor } else { 1.0 })
}

fn direction(x: f64, y: f64) -> String {
    let part = |value: f64, [before, after]: [&str; 2]| match value {
        0.0 => None,
        value => Some(format!(
            "{} {}",
            value.abs(),
            if value < 0.0 { before } else { after }
        )),
    };
    let parts = [part(x, ["to the left", "to the right"]), part(y, ["up", "down"])];
    let parts: Vec<String> = parts.into_iter().flatten().collect();
    format!("{} (in pixels)", parts.join(" and "))
}

/// The key that adds flips to those of the configuration.
fn flip_key(found: [bool; 2], stated: [bool; 2]) -> String {
    let name = match [found[0] != stated[0], found[1] != stated[1]] {
        [true, true] => "xy",
        [true, false] => "x",
        [false, true] => "y",
        [false, false] => return "# without the key `flip`".to_owned(),
    };
    format!("flip = \"{name}\"")
}

/// A number rounded to six significant digits.
fn six_digits(value: f64) -> f64 {
    format!("{value:.5e}").parse().unwrap_or(value)
}

fn factor_sentence(light: &str, factor: f64) -> String {
    // The factor takes the subject's values to the model's.
    let (larger, by) = if factor < 1.0 {
        ("brighter", 1.0 / factor)
    } else {
        ("darker", factor)
    };
    let known = FACTORS
        .iter()
        .find(|(known, _)| (by / known - 1.0).abs() < SAME_FACTOR);
    let name = known.map_or_else(String::new, |(_, name)| format!(", which is {name}"));
    format!("a {light} is {larger} by a factor of {by:.5}{name}")
}

/// Renders a probe with samples at multiples of 1/[`SUPER`] pixels, shifted by a part of a pixel.
fn samples(text: &str, registry: &Registry, subject: &Subject) -> Result<Samples, String> {
    let plane = |along_y: bool| -> Result<[Vec<f32>; 3], String> {
        let mut overrides = subject.set.clone();
        overrides.push(format!("film.width={}", SIZE[0] * SUPER));
        overrides.push(format!("film.height={}", SIZE[1] * SUPER));
        if along_y {
            overrides.push("camera.fov_axis=\"y\"".to_owned());
        }
        let load = |overrides: &[String]| {
            Sources::from_text("probe.toml", text, Path::new(""), overrides)
                .map_err(|error| error.sources.report(&error.errors, false))
        };
        let flattened = flatten_sources(&load(&overrides)?)?;
        // The camera sees the centre of a pixel. A sample is at the top left corner of one.
        let shift = subject.offset.map(|part| part * SUPER as f64 - 0.5);
        overrides.push(shifted(&flattened.text, shift)?);
        let sources = load(&overrides)?;
        let pipeline = Pipeline::load(&sources, registry, BuildOptions::default())
            .map_err(|errors| sources.report(&errors, false))?;
        let film = pipeline.render(RenderOptions::default());
        Ok(std::array::from_fn(|channel| {
            film.rgb.iter().map(|rgb| rgb[channel]).collect()
        }))
    };
    Ok(Samples {
        planes: [plane(false)?, plane(true)?],
    })
}

/// Lets a subject render the probes, and finds its conventions. `target` is a folder for its files.
///
/// # Errors
/// If the command cannot be run, or gives no image.
pub fn find(
    subject: &Subject,
    registry: &Registry,
    target: &Path,
    stage: &dyn Fn(&str),
    stop: &Stop,
) -> Result<Conventions, String> {
    let mut result = Conventions::default();
    let mut directional = 1.0;
    for (index, (name, light)) in LIGHTS.into_iter().enumerate() {
        let text = format!("{PROBE}{light}");
        let sources = Sources::from_text("probe.toml", &text, Path::new(""), &subject.set)
            .map_err(|error| error.sources.report(&error.errors, false))?;
        let scene = flatten_sources(&sources)?;
        let folder = Path::new("conventions").join(name);
        let job = Job {
            registry,
            target,
            folder: &folder,
            scene: &scene,
            size: SIZE,
            threads: 0,
            stage,
            stop,
        };
        let image = match render(subject, &job) {
            Ok(rendered) => rendered.image,
            Err(SubjectError::NotExpressible(why)) => {
                result.skipped.push((name, why));
                continue;
            }
            Err(error) => return Err(error.to_string()),
        };
        stage(&format!("examining {name}"));
        let samples = samples(&text, registry, subject)?;
        if index == 0 {
            let (error, findings, factor) = examine(&samples, &image, subject);
            result.errors.push((name, error));
            result.findings = findings;
            directional = factor;
        } else {
            let (least, found) = best(&samples, &image, &|_| true);
            result.errors.push((name, least));
            let (_, factor) = error(&samples, &image, &found, true);
            let relative = factor / directional;
            let without = (relative - 1.0).abs();
            if without > SAME_FACTOR.max(CLEARLY * least) {
                result.findings.push(Finding {
                    convention: "units of point lights",
                    sentence: factor_sentence("point light, compared with a directional one,", relative),
                    error: least,
                    error_without: without,
                    key: None,
                });
            }
        }
    }
    Ok(result)
}
