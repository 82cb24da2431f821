//! Finds the conventions by which a subject differs from the model: where it samples a pixel, its
//! reconstruction filter, the orientation of images and textures, the meaning of angles and of
//! light units, transfer functions, defaults, and distances that it leaves out.
//!
//! The subject renders small probe scenes. From the first one follows how its images are made:
//! Whitstone renders the probe with 8 x 8 samples per pixel at known places, from which the image
//! under any hypothesis is composed. The hypothesis with the smallest error is found by coordinate
//! descent from the best of a coarse grid. In the other probes the hypotheses are changes of the
//! scene. A convention is *found* if the error without it is clearly larger.

mod choices;
mod image;
mod probe;
mod spawn;
mod spot;
mod surfaces;

use crate::result::counted;
use crate::stop::Stop;
use crate::subject::Subject;
use crate::subject::render::SubjectError;
use choices::{Examined, Picked, changes, descend, examine};
pub use image::Filter;
use image::{ALL_FREE, Fit, Free, Guess, Samples, TRANSFERS, best, compose, fit};
use probe::{Lab, Probe, VIEWS};
use serde::Serialize;
use std::path::Path;
use whitstone_core::Registry;
use whitstone_image::{Image, Transfer};

/// A convention is found if the error without it is larger by this factor and by
/// [`CLEARLY_MORE`].
const CLEARLY: f64 = 1.25;
/// In units of the mean of the image.
const CLEARLY_MORE: f64 = 2e-4;
/// Largest relative difference of two factors that are taken as the same.
const SAME_FACTOR: f64 = 2e-3;
/// A larger error of the first probe is searched for in the scene, too.
const EXPLAINED: f64 = 5e-3;
/// The image of a probe with a larger error is not explained. If it is the first probe, the others
/// would say nothing.
const UNDERSTOOD: f64 = 0.1;
/// The largest difference of the same value in two runs, in units of the mean.
const REPEATED: f64 = 1e-5;

/// Factors between units of light that programs use, with what a brighter and a darker image mean.
const FACTORS: [(f64, &str, &str); 9] = [
    (
        std::f64::consts::PI,
        "pi: a factor of 1/pi in the reflection or in the light is missing",
        "pi: a factor of 1/pi in the reflection or in the light is there twice, or candela are taken as the lumen of a spot",
    ),
    (
        4.0 * std::f64::consts::PI,
        "4 pi: a power is taken as an intensity",
        "4 pi: the intensity of the light (W/sr, candela) is taken as its power (W, lumen)",
    ),
    (2.0 * std::f64::consts::PI, "2 pi", "2 pi"),
    (
        std::f64::consts::PI * std::f64::consts::PI,
        "pi squared",
        "pi squared",
    ),
    (
        4.0 * std::f64::consts::PI * std::f64::consts::PI,
        "4 pi squared",
        "4 pi squared: the intensity is taken as a power, and 1/pi is there twice",
    ),
    (
        683.0,
        "683: radiometric units are taken as photometric ones",
        "683: photometric units are taken as radiometric ones",
    ),
    (
        683.0 / (4.0 * std::f64::consts::PI),
        "683/(4 pi): W/sr are taken as lumen",
        "683/(4 pi): lumen are taken as W/sr",
    ),
    (2.0, "2", "2"),
    (4.0, "4", "4"),
];

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
    /// What was measured and is within what renderers do.
    pub measured: Vec<(&'static str, String)>,
    /// The error that no tried convention explains, in units of the mean, of each probe.
    pub errors: Vec<(&'static str, f64)>,
    /// Probes that were not rendered or not examined, and why.
    pub skipped: Vec<(&'static str, String)>,
}

/// Whether an error without a convention is clearly larger.
fn is_clear(with: f64, without: f64) -> bool {
    without > CLEARLY * with + CLEARLY_MORE
}

/// How the images of a subject are made.
struct Film {
    guess: Guess,
    free: Free,
    /// Takes its values to the model's.
    factor: f64,
    error: f64,
    /// Changes of all scenes by which the model does what the subject does.
    changes: Vec<String>,
    /// Whether it reads scenes in another way, so that other probes would say nothing.
    is_other: bool,
}

/// Why a probe says nothing.
enum NoProbe {
    /// The other probes are examined without it; the text is the reason.
    Skipped(String),
    /// The command cannot be run at all.
    Broken(String),
}

impl From<SubjectError> for NoProbe {
    fn from(error: SubjectError) -> Self {
        match error {
            SubjectError::NotExpressible(why) => Self::Skipped(why),
            SubjectError::Failed(why) => Self::Skipped(format!("the subject gave no image: {why}")),
            SubjectError::Environment(why) => Self::Broken(why),
        }
    }
}

impl From<String> for NoProbe {
    fn from(why: String) -> Self {
        Self::Broken(why)
    }
}

/// The image of a probe; the version with meshes where the one with spheres cannot be rendered.
fn image_of(lab: &Lab<'_>, probes: [Probe; 2]) -> Result<(Probe, Image), NoProbe> {
    let [probe, with_meshes] = probes;
    let (probe, image) = match lab.subject(&probe) {
        Err(SubjectError::NotExpressible(_)) if with_meshes.body != probe.body => {
            let image = lab.subject(&with_meshes)?;
            (with_meshes, image)
        }
        other => (probe, other?),
    };
    let planes = image.rgb().map_err(|error| NoProbe::Skipped(error.to_string()))?;
    let values = || planes.iter().flat_map(|plane| plane.iter());
    let not_finite = values().filter(|value| !value.is_finite()).count();
    if not_finite > 0 {
        let what = counted(not_finite, "value");
        return Err(NoProbe::Skipped(format!(
            "its image has {what} that are not finite"
        )));
    }
    if planes
        .iter()
        .all(|plane| plane.iter().all(|value| *value == plane[0]))
    {
        return Err(NoProbe::Skipped(
            "its image has one colour: it shows nothing of the scene".to_owned(),
        ));
    }
    Ok((probe, image))
}

/// Lets a subject render the probes, and finds its conventions. `target` is a folder for its files.
///
/// # Errors
/// If the command cannot be run, or gives no image of the first probes.
pub fn find(
    subject: &Subject,
    registry: &Registry,
    target: &Path,
    stage: &dyn Fn(&str),
    stop: &Stop,
) -> Result<Conventions, String> {
    let files = target.join("probes");
    probe::write_files(&files)?;
    let lab = Lab {
        registry,
        subject,
        target,
        files: &files,
        stage,
        stop,
    };
    let mut result = Conventions::default();
    let mut film: Option<Film> = None;
    for is_point in [false, true] {
        let probes = [false, true].map(|is_mesh| surfaces::light(is_mesh, is_point));
        let name = probes[0].name;
        let before = film.as_ref().map_or(Ok(()), understood);
        let examined = before
            .and_then(|()| image_of(&lab, probes))
            .and_then(|(probe, image)| {
                stage(&format!("examining {name}"));
                match &film {
                    None => {
                        film = Some(first(&lab, &probe, is_point, &image, &mut result)?);
                    }
                    Some(film) => of_point(&lab, &probe, &image, film, &mut result)?,
                }
                Ok(())
            });
        record(name, examined, &mut result)?;
    }
    let Some(film) = film else { return Ok(result) };
    let others = [
        ([surfaces::texture(), surfaces::texture()], surfaces::of_texture()),
        ([false, true].map(surfaces::glass), surfaces::of_glass()),
        ([surfaces::near(), surfaces::near()], surfaces::of_near()),
        ([surfaces::far(), surfaces::far()], surfaces::of_far()),
        ([false, true].map(surfaces::spot), surfaces::of_spot()),
    ];
    for (probes, choices) in others {
        let name = probes[0].name;
        let examined = understood(&film).and_then(|()| {
            let (probe, image) = image_of(&lab, probes)?;
            stage(&format!("examining {name}"));
            let found = examine(&lab, &probe, &choices, &image, &film)?;
            result.errors.push((name, found.fit.error));
            if let Some(finding) = unexplained(name, found.fit.error) {
                // Any hypothesis is better than another one by chance.
                result.findings.push(finding);
                return Ok(());
            }
            result.findings.extend(found.findings);
            if probe.folder == "spot" && found.picked.iter().all(Option::is_none) {
                let finding = units("a spot", &found.fit, &film);
                result.findings.extend(finding);
            }
            Ok(())
        });
        record(name, examined, &mut result)?;
    }
    let name = "a shadow at a contact";
    let measured = understood(&film).and_then(|()| match film.changes.is_empty() {
        true => Ok(spawn::measure(&lab, &film.guess, film.free)?),
        false => Ok(spawn::Spawn::Skipped("surfaces cast no shadows".to_owned())),
    });
    let measured = measured.map(|measured| match measured {
        spawn::Spawn::Finding(findings) => result.findings.extend(findings),
        spawn::Spawn::Measured(words) => result.measured.push(("spawn offset", words)),
        spawn::Spawn::Skipped(why) => result.skipped.push((name, why)),
    });
    record(name, measured, &mut result)?;
    Ok(result)
}

/// Fails if the first probe shows that other ones would say nothing.
fn understood(film: &Film) -> Result<(), NoProbe> {
    let why = match (film.error <= UNDERSTOOD, film.is_other) {
        (true, false) => return Ok(()),
        (true, true) => "the findings about the scene come first: repeat the command without them",
        (false, _) => "the image of the first probe is not understood, so this one would say nothing",
    };
    Err(NoProbe::Skipped(why.to_owned()))
}

/// Notes a probe that was skipped. An error ends the search.
fn record(name: &'static str, examined: Result<(), NoProbe>, result: &mut Conventions) -> Result<(), String> {
    match examined {
        Ok(()) => Ok(()),
        Err(NoProbe::Skipped(why)) => {
            result.skipped.push((name, why));
            Ok(())
        }
        Err(NoProbe::Broken(why)) => Err(why),
    }
}

/// The samples of all views of a probe with changes.
fn all_views(lab: &Lab<'_>, probe: &Probe, changes: &[String]) -> Result<Vec<Samples>, String> {
    (0..VIEWS.len())
        .map(|view| lab.all_samples(probe, changes, view))
        .collect()
}

/// Examines the image of the first probe: the conventions of the film and of the scene.
fn first(
    lab: &Lab<'_>,
    probe: &Probe,
    is_point: bool,
    image: &Image,
    result: &mut Conventions,
) -> Result<Film, NoProbe> {
    repeat(lab, probe, image, result)?;
    let choices = surfaces::of_light(is_point);
    let none: Picked = vec![None; choices.len()];
    let mut samples = all_views(lab, probe, &[])?;
    let (mut least, mut guess) = best(&samples, image, &|_| true);
    let fitted = |guess: &Guess, picked: &Picked| -> Result<f64, String> {
        let samples = lab.samples(probe, &changes(&choices, picked), guess)?;
        Ok(fit(&compose(&samples, guess), image, guess, ALL_FREE).error)
    };
    let (mut found, mut picked) = descend(&choices, &mut |picked| fitted(&guess, picked))?;
    if found.min(least) > EXPLAINED {
        // The scene may be so different that the first hypothesis about the image has no meaning.
        let mut singles = Vec::new();
        for (index, choice) in choices.iter().enumerate() {
            for value in choice.tried() {
                let mut single = none.clone();
                single[index] = Some(value);
                singles.push(single);
            }
        }
        for single in singles {
            (lab.stage)("searching");
            let samples = all_views(lab, probe, &changes(&choices, &single))?;
            let (error, other) = best(&samples, image, &|_| true);
            if found > CLEARLY * error {
                (found, guess, picked) = (error, other, single);
            }
            if found <= EXPLAINED {
                break;
            }
        }
        let (error, other) = descend(&choices, &mut |picked| fitted(&guess, picked))?;
        if error < found {
            picked = other;
        }
    }
    if picked != none {
        samples = all_views(lab, probe, &changes(&choices, &picked))?;
        (least, guess) = best(&samples, image, &|_| true);
    }
    if least > UNDERSTOOD {
        // Any hypothesis is better than another one by chance.
        result.errors.push((probe.name, least));
        result.findings.extend(unexplained(probe.name, least));
        return Ok(Film {
            guess,
            free: ALL_FREE,
            factor: 1.0,
            error: least,
            changes: Vec::new(),
            is_other: true,
        });
    }
    let mut error_of = |picked: &Picked| -> Result<f64, String> {
        let samples = all_views(lab, probe, &changes(&choices, picked))?;
        Ok(best(&samples, image, &|_| true).0)
    };
    let findings = choices::findings(&choices, &picked, least, &mut error_of)?;
    result.findings.extend(findings);
    result
        .findings
        .extend(of_image(&samples, image, least, &guess, lab.subject));
    let mut film = of_light(
        &samples,
        image,
        guess,
        lab.subject,
        is_point,
        &mut result.findings,
    );
    for (choice, picked) in choices.iter().zip(&picked) {
        match (choice.convention, picked) {
            (_, None) => {}
            (surfaces::SHADOWS, Some(_)) => film.changes.push(surfaces::WITHOUT_SHADOWS.to_owned()),
            _ => film.is_other = true,
        }
    }
    result.errors.push((probe.name, film.error));
    result
        .findings
        .sort_by(|a, b| b.error_without.total_cmp(&a.error_without));
    Ok(film)
}

/// Renders the probe again, and reports an image that differs.
fn repeat(lab: &Lab<'_>, probe: &Probe, image: &Image, result: &mut Conventions) -> Result<(), NoProbe> {
    if lab.subject.is_noisy() {
        return Ok(());
    }
    let again = lab.subject(probe)?;
    let (Ok(before), Ok(after)) = (image.rgb(), again.rgb()) else {
        return Ok(());
    };
    let pairs = || {
        before
            .iter()
            .flat_map(|plane| plane.iter())
            .zip(after.iter().flat_map(|plane| plane.iter()))
    };
    let count = pairs().count() as f64;
    let mean = pairs().map(|(value, _)| f64::from(value.abs())).sum::<f64>() / count;
    let difference = |(a, b): (&f32, &f32)| f64::from((a - b).abs()) / mean;
    let largest = pairs().map(difference).fold(0.0, f64::max);
    if largest > REPEATED {
        let squares = pairs().map(|pair| difference(pair).powi(2)).sum::<f64>();
        result.findings.push(Finding {
            convention: "repetition",
            sentence: "two runs give different images: the samples of the subject are random".to_owned(),
            error: 0.0,
            error_without: (squares / count).sqrt(),
            key: Some("runs = 16 # and {seed} in the command".to_owned()),
        });
    }
    Ok(())
}

/// Tests each convention of images that a hypothesis has.
fn of_image(
    samples: &[Samples],
    image: &Image,
    least: f64,
    found: &Guess,
    subject: &Subject,
) -> Vec<Finding> {
    let mut findings = Vec::new();
    let mut test = |convention, allowed: &dyn Fn(&Guess) -> bool, sentence: String, key: Option<String>| {
        let (without, _) = best(samples, image, allowed);
        if is_clear(least, without) {
            findings.push(Finding {
                convention,
                sentence,
                error: least,
                error_without: without,
                key,
            });
        }
    };
    let pixels = |samples: i32| f64::from(samples) / image::SUPER as f64;
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
                what,
                &move |guess| !guess.flip[axis],
                format!("the {what} of the image are reversed"),
                Some(flip_key(found.flip, subject.flip)),
            );
        }
    }
    if found.view != 0 {
        let sentence = VIEWS[found.view].sentence.to_owned();
        test("field of view", &|guess| guess.view == 0, sentence, None);
    }
    if found.order != 0 {
        let sentence = "red and blue are exchanged".to_owned();
        test("channels", &|guess| guess.order == 0, sentence, None);
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
    findings
}

/// Finds ambient light, a background, and a factor of all values.
fn of_light(
    samples: &[Samples],
    image: &Image,
    guess: Guess,
    subject: &Subject,
    is_point: bool,
    findings: &mut Vec<Finding>,
) -> Film {
    let composed = compose(&samples[guess.view], &guess);
    let with = |free: Free| fit(&composed, image, &guess, free);
    let mut free = ALL_FREE;
    let no_background = Free {
        background: false,
        ..free
    };
    let words = |color: [f64; 3]| color.map(|part| format!("{part:.3}")).join(", ");
    let (full, without) = (with(free), with(no_background).error);
    match is_clear(full.error, without) {
        true => findings.push(Finding {
            convention: "background",
            sentence: format!(
                "where a ray hits nothing, the image shows ({}) in its middle instead of black",
                words(full.background)
            ),
            error: full.error,
            error_without: without,
            key: None,
        }),
        false => free = no_background,
    }
    let no_ambient = Free {
        ambient: false,
        ..free
    };
    let (full, without) = (with(free), with(no_ambient).error);
    match is_clear(full.error, without) {
        true => findings.push(Finding {
            convention: "ambient light",
            sentence: format!(
                "surfaces also have the light of an ambient radiance of ({}), which is not in the scene",
                words(full.ambient)
            ),
            error: full.error,
            error_without: without,
            key: None,
        }),
        false => free = no_ambient,
    }
    let full = with(free);
    let unscaled = with(Free {
        factor: false,
        ..free
    });
    let is_scaled = is_clear(full.error, unscaled.error);
    if is_scaled {
        let light = match is_point {
            false => "a directional light",
            true => "a point light",
        };
        findings.push(Finding {
            convention: "light units",
            sentence: factor_sentence(light, full.factor),
            error: full.error,
            error_without: unscaled.error,
            key: Some(format!("scale = {:?}", few_digits(full.factor * subject.scale))),
        });
    }
    Film {
        guess,
        free,
        factor: if is_scaled { full.factor } else { 1.0 },
        error: full.error,
        changes: Vec::new(),
        is_other: false,
    }
}

/// Examines the image of a point light, whose units may be others than those of a directional one.
fn of_point(
    lab: &Lab<'_>,
    probe: &Probe,
    image: &Image,
    film: &Film,
    result: &mut Conventions,
) -> Result<(), NoProbe> {
    // What concerns all lights was found in the first probe; the last choice is the falloff.
    let mut choices = surfaces::of_light(true);
    let choices = choices.split_off(choices.len() - 1);
    let Examined {
        fit: found,
        findings,
        picked,
    } = examine(lab, probe, &choices, image, film)?;
    result.errors.push((probe.name, found.error));
    if let Some(finding) = unexplained(probe.name, found.error) {
        result.findings.push(finding);
        return Ok(());
    }
    result.findings.extend(findings);
    if picked.last().is_some_and(Option::is_none) {
        result.findings.extend(units("a point light", &found, film));
    }
    Ok(())
}

/// The finding that nothing explains the image of a probe with this error, if it is so.
fn unexplained(name: &str, error: f64) -> Option<Finding> {
    (error > UNDERSTOOD).then(|| Finding {
        convention: "unexplained",
        sentence: format!("the image of {name} differs, and no tried hypothesis explains it"),
        error,
        error_without: error,
        key: None,
    })
}

/// The factor of the values of a light, compared with those of a directional light.
fn units(light: &'static str, found: &Fit, film: &Film) -> Option<Finding> {
    let relative = found.factor / film.factor;
    let without = (relative - 1.0).abs();
    let is_other = without > SAME_FACTOR.max(CLEARLY * found.error);
    is_other.then(|| Finding {
        convention: match light {
            "a spot" => "units of spots",
            _ => "units of point lights",
        },
        sentence: factor_sentence(&format!("{light}, compared with a directional one,"), relative),
        error: found.error,
        error_without: without,
        key: None,
    })
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

/// A number rounded to nine significant digits, or to six if they say the same: it must not use up
/// the limits of a comparison.
fn few_digits(value: f64) -> f64 {
    let rounded = |digits: usize| format!("{value:.*e}", digits - 1).parse().unwrap_or(value);
    let six: f64 = rounded(6);
    if (six - value).abs() < 1e-7 * value.abs() {
        six
    } else {
        rounded(9)
    }
}

fn factor_sentence(light: &str, factor: f64) -> String {
    // The factor takes the subject's values to the model's.
    let is_brighter = factor < 1.0;
    let by = if is_brighter { 1.0 / factor } else { factor };
    let known = FACTORS
        .iter()
        .find(|(known, ..)| (by / known - 1.0).abs() < SAME_FACTOR);
    let name = known.map_or_else(String::new, |(_, brighter, darker)| {
        format!(", which is {}", if is_brighter { brighter } else { darker })
    });
    let word = if is_brighter { "brighter" } else { "darker" };
    format!("{light} is {word} by a factor of {by:.5}{name}")
}
