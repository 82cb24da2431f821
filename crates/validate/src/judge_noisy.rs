//! Compares with a reference that has noise, and decides by the rule of [`Noisy`].

use crate::explain::Reason;
use crate::noisy::{AGREEING, Noisy, is_noisy};
use crate::opinion::{Ask, MAX_ASKED, Verdict};
use crate::oracle::{Hearing, Value, choose, verdict};
use crate::pixels::Pictures;
use crate::result::{CaseResult, Reference, Status, WorstPixel, counted};
use crate::tolerance::{allowed, color_at};
use crate::vacuous;
use crate::validator::{Against, Ours, Validator};
use crate::verdict::{rehits, wrong_status};
use std::path::Path;
use whitstone_image::Image;
use whitstone_metrics::significance::{SignificanceError, explained_by_noise};
use whitstone_metrics::{Mask, Tolerance, metrics, noisy_blocks, significance};

/// The probability that noise alone makes any pixel of an image significant.
const LEVEL: f64 = 0.01;
/// Standard errors on each side of a 95 % confidence interval.
const OF_95_PERCENT: f64 = 1.96;
/// Number of worst pixels that a result lists.
const WORST: usize = 20;

impl Validator<'_> {
    /// Compares our image with a noisy reference, and decides the case.
    pub(crate) fn judge_noisy(
        &mut self,
        path: &Path,
        case: &mut CaseResult,
        our_side: &Ours,
        against: &Against,
    ) -> Result<(), SignificanceError> {
        let (ours, reference, meta) = (&our_side.image, &against.stored.image, &against.stored.meta);
        case.reference = Some(Reference {
            name: meta.renderer.clone(),
            version: meta.version.clone(),
            variant: meta.variant.clone(),
            source: if against.live { "live" } else { "stored" }.to_owned(),
            k: meta.k,
        });
        case.twin = meta.twin.clone();
        case.reference_s = Some(meta.seconds);
        let tolerance = Tolerance::default();
        let not_finite = metrics::count_not_finite(ours, reference)?;
        case.nonfinite = not_finite.ours + not_finite.reference;
        let found = significance(ours, reference, LEVEL, tolerance)?;
        let significant = found.as_ref().map_or_else(
            || Mask::new(ours.width(), ours.height()),
            |found| found.mask.clone(),
        );
        let over = metrics::over_tolerance(ours, reference, tolerance)?;
        let (bias, bias_interval) = bias(ours, reference);
        let blocks = noisy_blocks(ours, reference)?;
        let noisy = Noisy {
            integrator: meta.integrator.clone(),
            agreeing: 1.0 - significant.count() as f64 / ours.pixel_count().max(1) as f64,
            significant: significant.count(),
            least_p: found.map_or(1.0, |found| found.least_p),
            bias,
            bias_interval,
            blocks: blocks.as_ref().map_or(0, |found| found.blocks),
            differing_blocks: blocks.as_ref().map_or(0, |found| found.differing),
            hidden_blocks: blocks.as_ref().map_or(0, |found| found.hidden),
        };
        crate::judge::measure(case, ours, reference, &significant)?;
        // They have no limits here, because noise is not our error.
        (case.rel_rmse_interior, case.signed_block_bias) = (None, None);
        case.compared = true;
        case.pixels_over_tolerance = over.count();
        case.unexplained = significant.count();
        case.explained = over.count() - case.unexplained;
        case.notes = vacuous::notes(ours, reference, &our_side.pipeline);
        case.notes
            .extend(our_side.pipeline.scene.geometry.search_limit_notes());
        case.coincident = vacuous::coincident(&our_side.pipeline);
        if self.pictures {
            let reasons = over.pixels().map(|(x, y)| {
                let reason = (!significant.contains(x, y)).then_some(Reason::Noise);
                ([x, y], reason)
            });
            case.pictures = Pictures::new(ours, reference, reasons);
        }
        for pixel in metrics::worst(ours, reference, WORST, Some(&significant))? {
            case.worst.push(WorstPixel {
                x: pixel.x,
                y: pixel.y,
                ours: pixel.ours,
                reference: pixel.reference,
                ..WorstPixel::default()
            });
        }
        let listed = |mask: &Mask| mask.pixels().map(|(x, y)| [x, y]).collect::<Vec<_>>();
        let question = match &blocks {
            _ if noisy.agreeing < AGREEING => Question::Pixels(listed(&significant)),
            Some(found) if found.differing > 0 => Question::Blocks(listed(&found.mask)),
            _ if meta.rehits > 0 && (noisy.agrees() || !is_noisy(ours)) => {
                let rows = (0..ours.height()).flat_map(|y| (0..ours.width()).map(move |x| [x, y]));
                Question::Rehits(rows.collect())
            }
            _ if !noisy.agrees() => Question::Bias(listed(&significant)),
            _ if significant.count() > 0 => Question::Few(listed(&significant)),
            _ => Question::Nothing,
        };
        if meta.rehits > 0 {
            let problem = rehits(meta.rehits);
            case.inexact.push(problem.clone());
            case.problems.push(problem);
        }
        let (status, verdict) = self.decide_noisy(path, case, ours, reference, question, &noisy)?;
        // Noise may explain any number of pixels.
        case.explained_limit = case.explained;
        case.settle(status, verdict);
        case.noisy = Some(noisy);
        Ok(())
    }

    fn decide_noisy(
        &self,
        path: &Path,
        case: &mut CaseResult,
        ours: &Image,
        reference: &Image,
        question: Question,
        noisy: &Noisy,
    ) -> Result<(Status, String), SignificanceError> {
        let (Question::Pixels(pixels)
        | Question::Few(pixels)
        | Question::Blocks(pixels)
        | Question::Bias(pixels)
        | Question::Rehits(pixels)) = &question
        else {
            if noisy.hides_differences() {
                let verdict = format!(
                    "the noise could hide half of the value in {} of {} blocks of pixels: use more samples or runs",
                    noisy.hidden_blocks, noisy.blocks
                );
                return Ok((Status::Undecided, verdict));
            }
            return Ok((Status::Pass, noisy.to_string()));
        };
        if !noisy.agrees() {
            case.problems.push(noisy.to_string());
        }
        let image = case.image_name();
        if self.oracle.when == Ask::Never {
            let verdict = format!("{image} differs from the reference, and the oracle was not queried");
            return Ok((Status::Undecided, verdict));
        }
        let hearing = self.hear(path, &choose(pixels, MAX_ASKED), ours, reference);
        let verdicts = verdicts(&hearing, ours, reference)?;
        case.opinion = Some(hearing.opinion(&verdicts, pixels.len()));
        let of = |wanted: Verdict| verdicts.iter().filter(|(_, found)| *found == wanted).count();
        let wrong = of(Verdict::Reference) + of(Verdict::Neither);
        let (right, both) = (of(Verdict::Ours), of(Verdict::Both));
        let decided = 2 * (right + both) >= verdicts.len() && right + both > 0;
        let other = match case.subject {
            Some(_) => "the reference",
            None => "stock Mitsuba",
        };
        let queried = counted(verdicts.len(), "pixel");
        if wrong > 0 {
            let verdict = format!("the oracle contradicts {image} in {}", counted(wrong, "pixel"));
            if matches!(question, Question::Few(_)) && is_noisy(ours) {
                let verdict = format!(
                    "{verdict}, where it differs from {other} by more than noise explains: a fault, or bright samples that \
                     are rare (use more samples or runs)"
                );
                return Ok((Status::Undecided, verdict));
            }
            return Ok((wrong_status(case), verdict));
        }
        Ok(match question {
            Question::Blocks(_) if is_noisy(ours) && !is_noisy(reference) && decided && right == 0 => (
                wrong_status(case),
                format!(
                    "the means of {} of {} blocks of pixels differ by more than noise explains, and the oracle confirms the \
                     reference in {both} of {queried} there",
                    noisy.differing_blocks, noisy.blocks
                ),
            ),
            Question::Blocks(_) | Question::Rehits(_) if !is_noisy(ours) && decided => (
                Status::Confirmed,
                format!(
                    "{other} is inaccurate here, and the oracle confirms {image} in {} of {queried}",
                    right + both
                ),
            ),
            Question::Rehits(_) if decided && !noisy.hides_differences() => (
                Status::Confirmed,
                format!(
                    "{image} agrees with {other}, and the oracle confirms both in {} of {queried}",
                    right + both
                ),
            ),
            Question::Rehits(_) => (
                Status::Undecided,
                format!(
                    "{other} is unreliable here, and the noise or the oracle leaves open whether {image} is right"
                ),
            ),
            Question::Few(_) if noisy.hides_differences() => (
                Status::Undecided,
                "the noise could hide half of the value in most blocks of pixels: use more samples or runs"
                    .to_owned(),
            ),
            Question::Few(pixels) => {
                case.unexplained = pixels.len() - right - both;
                case.explained += right + both;
                (Status::Pass, noisy.to_string())
            }
            Question::Pixels(pixels) if right == verdicts.len() && right == pixels.len().min(MAX_ASKED) => (
                Status::Confirmed,
                format!(
                    "{other} differs, and the oracle confirms {image} in {right} of the {} that differ",
                    counted(pixels.len(), "pixel")
                ),
            ),
            Question::Pixels(pixels) => (
                Status::Undecided,
                format!(
                    "{image} differs from {other}, and the oracle confirms it in only {right} of {}",
                    counted(pixels.len(), "pixel")
                ),
            ),
            _ => (
                Status::Undecided,
                "the means differ by more than noise explains, but no single pixel differs significantly"
                    .to_owned(),
            ),
        })
    }
}

/// What is in question, and the pixels that the oracle can be queried about.
enum Question {
    Nothing,
    /// Single pixels differ.
    Pixels(Vec<[usize; 2]>),
    /// Single pixels differ, but no more of them than may.
    Few(Vec<[usize; 2]>),
    /// The means of blocks differ.
    Blocks(Vec<[usize; 2]>),
    /// Only the mean of the image differs; no pixel explains it.
    Bias(Vec<[usize; 2]>),
    /// Nothing differs, and the reference is not reliable.
    Rehits(Vec<[usize; 2]>),
}

/// The oracle's verdicts. For an image with noise, takes the value within the noise that is nearest
/// to the oracle's.
fn verdicts(
    hearing: &Hearing,
    ours: &Image,
    reference: &Image,
) -> Result<Vec<([usize; 2], Verdict)>, SignificanceError> {
    let noise = [
        explained_by_noise(ours, LEVEL)?,
        explained_by_noise(reference, LEVEL)?,
    ];
    let mean = metrics::mean_reference(reference).unwrap_or(0.0);
    let width = ours.width();
    let of_pixel = |(pixel, value): &([usize; 2], Value)| {
        let [x, y] = *pixel;
        let nominal = color_at(reference, *pixel);
        let sides = [color_at(ours, *pixel), nominal];
        let [ours, reference] = [0, 1].map(|side| match (&noise[side], value) {
            (Some(limits), Some(([rgb, _], _))) => std::array::from_fn(|channel| {
                let limit = limits[channel][y * width + x];
                rgb[channel].clamp(sides[side][channel] - limit, sides[side][channel] + limit)
            }),
            _ => sides[side],
        });
        (*pixel, verdict(value, ours, reference, allowed(nominal, mean)))
    };
    Ok(hearing.values.iter().map(of_pixel).collect())
}

/// The relative difference of the means of all values, and half the width of its 95 % confidence
/// interval.
fn bias(ours: &Image, reference: &Image) -> (f64, f64) {
    let (Ok(mine), Ok(theirs)) = (ours.rgb(), reference.rgb()) else {
        return (f64::NAN, 0.0);
    };
    let sum = |planes: [&[f32]; 3]| {
        let values = planes.into_iter().flatten();
        values.map(|&value| f64::from(value)).sum::<f64>()
    };
    let (mine, theirs) = (sum(mine), sum(theirs));
    let variance = variance_of_sum(ours) + variance_of_sum(reference);
    if theirs == 0.0 {
        return (if mine == 0.0 { 0.0 } else { f64::INFINITY }, 0.0);
    }
    (
        (mine - theirs) / theirs.abs(),
        OF_95_PERCENT * variance.sqrt() / theirs.abs(),
    )
}

/// The variance of the sum of all values of an image; 0 for one without noise.
fn variance_of_sum(image: &Image) -> f64 {
    let samples = image
        .channel("samples.N")
        .map_or(1.0, |counts| f64::from(counts[0]));
    // The channels of a path are reflected and absorbed together: their errors are taken as fully
    // correlated, so that they add up.
    let variances: Vec<&[f32]> = ["variance.R", "variance.G", "variance.B"]
        .into_iter()
        .filter_map(|name| image.channel(name))
        .collect();
    (0..image.pixel_count())
        .map(|index| {
            let errors = variances
                .iter()
                .map(|plane| (f64::from(plane[index]) / samples).sqrt());
            errors.sum::<f64>().powi(2)
        })
        .sum()
}
