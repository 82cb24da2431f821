//! Compares with a reference that has noise, and decides by the rule of [`Noisy`].

use crate::explain::Reason;
use crate::noisy::{AGREEING, Noisy};
use crate::opinion::{Ask, MAX_ASKED, Verdict};
use crate::oracle::choose;
use crate::pixels::Pictures;
use crate::result::{CaseResult, Reference, Status, WorstPixel, counted};
use crate::vacuous;
use crate::validator::{Against, Ours, Validator};
use std::path::Path;
use whitstone_image::Image;
use whitstone_metrics::significance::SignificanceError;
use whitstone_metrics::{Mask, Tolerance, metrics, significance};

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
        let noisy = Noisy {
            integrator: meta.integrator.clone(),
            agreeing: 1.0 - significant.count() as f64 / ours.pixel_count().max(1) as f64,
            significant: significant.count(),
            least_p: found.map_or(1.0, |found| found.least_p),
            bias,
            bias_interval,
        };
        crate::judge::measure(case, ours, reference, &significant)?;
        // They have no limits here, because noise is not our error.
        (case.rel_rmse_interior, case.signed_block_bias) = (None, None);
        case.compared = true;
        case.pixels_over_tolerance = over.count();
        case.unexplained = if noisy.agrees() { 0 } else { significant.count() };
        case.explained = over.count() - case.unexplained;
        // Noise may explain any number of pixels.
        case.explained_limit = case.explained;
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
        self.decide_noisy(path, case, ours, reference, &significant, &noisy);
        case.noisy = Some(noisy);
        Ok(())
    }

    fn decide_noisy(
        &self,
        path: &Path,
        case: &mut CaseResult,
        ours: &Image,
        reference: &Image,
        significant: &Mask,
        noisy: &Noisy,
    ) {
        if noisy.agrees() {
            case.settle(Status::Pass, noisy.to_string());
            return;
        }
        case.problems.push(noisy.to_string());
        if self.oracle.when == Ask::Never {
            let image = case.image_name();
            let verdict = format!("{image} differs from the reference, and the oracle was not queried");
            case.settle(Status::Undecided, verdict);
            return;
        }
        let pixels: Vec<[usize; 2]> = significant.pixels().map(|(x, y)| [x, y]).collect();
        let hearing = self.hear(path, &choose(&pixels, MAX_ASKED), ours, reference);
        let verdicts: Vec<([usize; 2], Verdict)> = hearing.verdicts(ours, reference).collect();
        let opinion = hearing.opinion(&verdicts, pixels.len());
        let of = |wanted: Verdict| verdicts.iter().filter(|(_, found)| *found == wanted).count();
        let wrong = of(Verdict::Reference) + of(Verdict::Neither);
        let right = of(Verdict::Ours);
        let image = case.image_name();
        let other = match case.subject {
            Some(_) => "the reference",
            None => "stock Mitsuba",
        };
        let (status, verdict) = if wrong > 0 {
            (
                Status::Fail,
                format!("the oracle contradicts {image} in {}", counted(wrong, "pixel")),
            )
        } else if noisy.agreeing >= AGREEING {
            // Only the bias is in question: the few pixels that differ do not explain it.
            let verdict = "the mean differs by more than noise explains, which no single pixel shows";
            (Status::Undecided, verdict.to_owned())
        } else if right == verdicts.len() && right == pixels.len().min(MAX_ASKED) && right > 0 {
            (
                Status::Confirmed,
                format!(
                    "{other} differs, and the oracle confirms {image} in {right} of the {} that differ",
                    counted(pixels.len(), "pixel")
                ),
            )
        } else {
            (
                Status::Undecided,
                format!(
                    "{image} differs from {other}, and the oracle confirms it in only {right} of {}",
                    counted(pixels.len(), "pixel")
                ),
            )
        };
        case.opinion = Some(opinion);
        case.settle(status, verdict);
    }
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
