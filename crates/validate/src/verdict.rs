//! The verdict on a case: which renderer is right, and how certain that is.
//!
//! - *pass*: the two agree, and the pixels over tolerance are explained by the reference's own
//!   variation or confirmed by the oracle;
//! - *confirmed*: the reference is shown to be inexact in this scene, and the oracle contradicts
//!   our value in no pixel that it was asked about;
//! - *fail*: the oracle contradicts our value in at least one pixel;
//! - *undecided*: the two differ and neither reference nor oracle can decide; the reason is given.
//!
//! The oracle shares some code with our tracer ([`crate::shared`]), and a fault there would look
//! right to both. So the oracle alone is not enough to accept a pixel in which the reference shows
//! no sign of inaccuracy. The strongest sign is that the reference varies in the pixel itself. A
//! sign for the whole scene ([`crate::inexact`]) counts only if no shared code is in use.

use crate::explain::Explanation;
use crate::judge::{Judged, measure};
use crate::opinion::{Ask, MAX_ASKED, Opinion, Verdict};
use crate::oracle::{Hearing, choose};
use crate::protocol::SceneText;
use crate::result::{CaseResult, Status, counted};
use crate::shared;
use crate::tolerance::color_at;
use crate::validator::{Against, Ours, Validator};
use std::collections::BTreeMap;
use std::path::Path;
use whitstone_image::Image;
use whitstone_metrics::{Mask, metrics};

/// Number of the worst interior pixels that the oracle is queried about if only their mean error is
/// above its limit.
const WORST_OF_INTERIOR: usize = 32;
/// Number of evenly spaced interior pixels that are queried in addition.
const OTHERS_OF_INTERIOR: usize = 32;

/// Maximum ratio of an error to the largest deviation under a few other roundings.
const ROUNDINGS: f64 = 4.0;

/// The confidence that a sample gives, as text. If all of the queried pixels that the oracle
/// decides are right, at most this fraction of the others is wrong, with a confidence of 95 % (0.05
/// = (1 - p)^n).
fn confidence(queried: usize, undecided: usize, of: usize) -> String {
    let asked = queried - undecided;
    if asked >= of {
        return format!("all {of}");
    }
    if queried >= of {
        return format!("{asked} of {of}; it cannot decide the others");
    }
    let part = 100.0 * (1.0 - 0.05_f64.powf(1.0 / asked.max(1) as f64));
    format!("{asked} of {of}; with 95 % confidence at most {part:.1} % of the others are wrong")
}

impl Validator<'_> {
    /// Decides a case that was compared, with the oracle if the comparison alone cannot.
    pub(crate) fn decide(
        &mut self,
        path: &Path,
        case: &mut CaseResult,
        our_side: &Ours,
        against: &Against,
        judged: &[Judged],
    ) {
        let (ours, reference) = (&our_side.image, &against.stored.image);
        let mut broken = case.broken_limits();
        if against.stored.meta.rehits > 0 {
            let problem = rehits(against.stored.meta.rehits);
            case.inexact.push(problem.clone());
            broken.push(problem);
        }
        if case.ambiguous > 0 {
            broken.push(format!(
                "ambiguous: {} lie between values of the reference and equal none of them",
                counted(case.ambiguous, "pixel")
            ));
        }
        broken.append(&mut case.problems);
        if broken.is_empty() {
            if self.oracle.when == Ask::Always {
                let pixels: Vec<[usize; 2]> = judged.iter().map(|one| one.pixel).collect();
                let hearing = self.hear(path, &choose(&pixels, MAX_ASKED), ours, reference);
                let verdicts = note(case, &hearing, ours, reference);
                case.opinion = Some(hearing.opinion(&verdicts, pixels.len()));
            }
            case.settle(
                Status::Pass,
                format!("{} agrees with the reference", case.image_name()),
            );
            return;
        }
        case.problems = broken;
        if self.oracle.when == Ask::Never {
            case.settle(
                Status::Undecided,
                format!(
                    "{} differs from the reference, and the oracle was not queried",
                    case.image_name()
                ),
            );
            return;
        }
        let (status, verdict) = self.ask_and_decide(path, case, our_side, against, judged);
        case.settle(status, verdict);
    }

    fn ask_and_decide(
        &mut self,
        path: &Path,
        case: &mut CaseResult,
        our_side: &Ours,
        against: &Against,
        judged: &[Judged],
    ) -> (Status, String) {
        let (ours, reference) = (&our_side.image, &against.stored.image);
        // If no pixel is left that the reference does not explain, nothing else could be queried.
        let explained_too =
            case.explained().is_over() || case.rel_rmse_interior.is_none() || self.oracle.when == Ask::Always;
        let mut in_question: Vec<[usize; 2]> = (judged.iter())
            .filter(|one| explained_too || !matches!(one.explanation, Explanation::Value(_)))
            .map(|one| one.pixel)
            .collect();
        if against.stored.meta.rehits > 0 {
            // Agreement with such a reference alone proves nothing.
            in_question = (0..ours.height())
                .flat_map(|y| (0..ours.width()).map(move |x| [x, y]))
                .collect();
        }
        let hearing = self.hear(path, &choose(&in_question, MAX_ASKED), ours, reference);
        let verdicts = note(case, &hearing, ours, reference);
        let opinion = hearing.opinion(&verdicts, in_question.len());
        case.opinion = Some(opinion.clone());
        let explanations: BTreeMap<[usize; 2], Explanation> =
            judged.iter().map(|one| (one.pixel, one.explanation)).collect();
        let of = |pixel: &[usize; 2]| explanations.get(pixel).copied().unwrap_or(Explanation::Nothing);
        let wrong: Vec<&([usize; 2], Verdict)> = (verdicts.iter())
            .filter(|(_, verdict)| matches!(verdict, Verdict::Reference | Verdict::Neither))
            .collect();
        // Rounding may decide where our tracer reports coincident surfaces that are not separated.
        let pipeline = &our_side.pipeline;
        let not_drawn_apart = !pipeline.coincident_unknown.is_empty()
            || pipeline.coincident.iter().any(|pair| pair.gap.is_none());
        let rounding = not_drawn_apart && wrong.iter().all(|(pixel, _)| of(pixel) != Explanation::Nothing);
        if !wrong.is_empty() && !rounding {
            return (wrong_status(case), contradicted(case, &opinion, wrong.len()));
        }
        if metrics::count_not_finite(ours, reference).is_ok_and(|count| count.ours > 0) {
            return (
                Status::Fail,
                format!("{} has values that are not finite", case.image_name()),
            );
        }
        let mut open = Vec::new();
        if !wrong.is_empty() {
            open.push(format!(
                "the oracle contradicts {} in {}, but our tracer could not separate all coincident surfaces",
                case.image_name(),
                counted(wrong.len(), "pixel")
            ));
        }
        if let Some(why) = &hearing.silent {
            open.push(format!("the oracle is not available: {why}"));
        }
        if hearing.out_of_time {
            open.push(format!(
                "the oracle answered for {} of {} pixels within its time limit of {} s",
                opinion.asked,
                in_question.len().min(MAX_ASKED),
                self.oracle.budget.as_secs()
            ));
        }
        let count = |of_interest: &dyn Fn(Explanation, Verdict) -> bool| {
            let chosen = verdicts.iter();
            chosen
                .filter(|(pixel, verdict)| of_interest(of(pixel), *verdict))
                .count()
        };
        let weak = case.inexact.clone();
        // Where the reference varies too, the pixel is ill-posed.
        let unknown = count(&|explanation, verdict| match verdict {
            Verdict::Unknown => !matches!(explanation, Explanation::Value(_)),
            Verdict::IllPosed => explanation == Explanation::Nothing && weak.is_empty(),
            _ => false,
        });
        if unknown > 0 {
            open.push(format!(
                "the oracle cannot decide {}: {} ill-posed, {} where a ray touches a surface or an edge",
                counted(unknown, "pixel"),
                opinion.ill_posed,
                opinion.unknown
            ));
        }
        let unknown_edges = count(&|explanation, verdict| {
            verdict == Verdict::Unknown && matches!(explanation, Explanation::Value(_))
        });
        // The limit is for the whole image, of which a part was queried.
        let queried = opinion.asked.max(1);
        if unknown_edges * in_question.len() > case.explained_limit * queried {
            open.push(format!(
                "of {}, the oracle cannot decide {unknown_edges} that the reference's variation explains; at most {} of all \
                 {} in question may be undecided",
                counted(queried, "queried pixel"),
                case.explained_limit,
                in_question.len()
            ));
        }
        let unsupported =
            count(&|explanation, verdict| verdict == Verdict::Ours && explanation == Explanation::Nothing);
        let shared = shared::possible_fault(&our_side.flattened.text);
        // A subject shares no code with the oracle. The export of its scene does.
        let alone = case.inexact.is_empty() && case.subject.is_none();
        if unsupported > 0 && (alone || shared.is_some()) {
            open.push(format!(
                "the oracle confirms {} in {} in which the reference does not vary: a fault in {} is possible",
                case.image_name(),
                counted(unsupported, "pixel"),
                shared.unwrap_or("the driver of the reference, or in code that our tracer shares with the oracle,")
            ));
        }
        if let Some(count) = case.layers.iter().filter_map(|layer| layer.differing_alone).max()
            && count > case.explained_limit
        {
            open.push(format!(
                "ids or path classes differ in {} that have the same colour, and the oracle has neither to compare",
                counted(count, "pixel")
            ));
        }
        if !open.is_empty() {
            return (
                Status::Undecided,
                format!(
                    "{} differs from the reference, and it is undecided which of them is right: {}",
                    case.image_name(),
                    open.join("; ")
                ),
            );
        }
        // Only pixels within tolerance remain.
        let before = (case.rel_rmse_interior, case.signed_block_bias);
        let mut all = Mask::new(ours.width(), ours.height());
        for one in judged {
            all.set(one.pixel[0], one.pixel[1], true);
        }
        if measure(case, ours, reference, &all).is_err() {
            (case.rel_rmse_interior, case.signed_block_bias) = before;
        }
        let confirmed = confidence(opinion.asked, opinion.unknown, in_question.len());
        if case.interior().is_over() || case.bias().is_over() || case.rel_rmse_interior.is_none() {
            return self.decide_interior(path, case, our_side, against, &all);
        }
        let rehits = against.stored.meta.rehits > 0;
        if !rehits && case.unexplained == 0 && case.explained + case.ambiguous <= case.explained_limit {
            // The reference was undecided, and the oracle decided.
            case.explained += std::mem::take(&mut case.ambiguous);
            case.problems.clear();
            return (
                Status::Pass,
                format!(
                    "{} agrees with the reference; the oracle confirms {confirmed} of the ambiguous pixels",
                    case.image_name()
                ),
            );
        }
        (
            Status::Confirmed,
            format!(
                "the reference is too inaccurate in this scene; the oracle confirms {} in the pixels in question ({confirmed})",
                case.image_name()
            ),
        )
    }

    /// Decides whose error exceeds the limit if no pixel is over tolerance.
    fn decide_interior(
        &mut self,
        path: &Path,
        case: &mut CaseResult,
        our_side: &Ours,
        against: &Against,
        excluded: &Mask,
    ) -> (Status, String) {
        let (ours, reference) = (&our_side.image, &against.stored.image);
        let inside = Mask::from_fn(ours.width(), ours.height(), |x, y| !excluded.contains(x, y));
        let worst = metrics::worst(ours, reference, WORST_OF_INTERIOR, Some(&inside)).unwrap_or_default();
        let worst: Vec<[usize; 2]> = worst.iter().map(|pixel| [pixel.x, pixel.y]).collect();
        if worst.is_empty() {
            return (
                Status::Confirmed,
                format!(
                    "the reference varies in every pixel; the oracle confirms {} in the queried ones",
                    case.image_name()
                ),
            );
        }
        let mut pixels = worst.clone();
        let all: Vec<[usize; 2]> = inside.pixels().map(|(x, y)| [x, y]).collect();
        for pixel in choose(&all, OTHERS_OF_INTERIOR) {
            if !pixels.contains(&pixel) {
                pixels.push(pixel);
            }
        }
        let hearing = self.hear(path, &pixels, ours, reference);
        let undecided = |why: &str| {
            (
                Status::Undecided,
                format!(
                    "the mean error or the bias of a block is above its limit, and it is undecided whose error it is: {why}"
                ),
            )
        };
        if let Some(why) = &hearing.silent {
            return undecided(&format!("the oracle is not available: {why}"));
        }
        let (count, [error, theirs]) = errors(&hearing, ours, reference);
        if 2 * count < pixels.len() {
            return undecided("the oracle decides less than half of the queried pixels");
        }
        let told = format!(
            "compared with the oracle in {count} pixels, the error of {} is {error:.2e} and that of the reference is {theirs:.2e}",
            case.image_name()
        );
        if error > case.limit {
            return (
                wrong_status(case),
                format!(
                    "the error of {} exceeds the limit {:.2e}: {told}{}",
                    case.image_name(),
                    case.limit,
                    approximated(case)
                ),
            );
        }
        let varying = self.varying(our_side, against, &worst);
        let shared = shared::possible_fault(&our_side.flattened.text).is_some();
        if (case.inexact.is_empty() || shared) && 2 * varying < worst.len() {
            return undecided(&format!(
                "{told}, but the reference shows no sign of inaccuracy (with other roundings it takes our values in {varying} of the \
                 {} worst pixels): a fault that our tracer shares with the oracle is possible",
                worst.len()
            ));
        }
        (
            Status::Confirmed,
            format!(
                "the reference is too inaccurate in this scene (with other roundings it takes our values in {varying} of the {} worst \
                 pixels): {told}",
                worst.len()
            ),
        )
    }

    /// The number of these pixels in which a live reference varies by at least a quarter of our
    /// difference if only its roundings change: a few perturbations underestimate an error. Shifts
    /// of the sample position do not count: where a texture is steep they explain any small error.
    fn varying(&mut self, ours: &Ours, against: &Against, pixels: &[[usize; 2]]) -> usize {
        let Some(live) = self.live.as_mut().filter(|_| against.live) else {
            return 0;
        };
        let text = SceneText {
            text: &ours.flattened.text,
            base: &ours.flattened.base,
        };
        let trials = self.options.renderer.roundings();
        let Ok(values) = live.probe(text, &ours.flattened.hash, pixels, &trials) else {
            return 0;
        };
        let varies = |(pixel, variants): (&[usize; 2], &Vec<Vec<[f64; 3]>>)| {
            let nominal = color_at(&against.stored.image, *pixel);
            let ours = color_at(&ours.image, *pixel);
            let mut most = [0.0_f64; 3];
            for value in variants.iter().flatten() {
                for c in 0..3 {
                    most[c] = most[c].max((value[c] - nominal[c]).abs());
                }
            }
            (0..3).all(|c| (ours[c] - nominal[c]).abs() <= ROUNDINGS * most[c])
        };
        pixels.iter().zip(&values).filter(|pair| varies(*pair)).count()
    }
}

/// The number of pixels in which the oracle's value is certain, and the relative RMS errors of ours
/// and of the reference there.
fn errors(hearing: &Hearing, ours: &Image, reference: &Image) -> (usize, [f64; 2]) {
    let mean = metrics::mean_reference(reference).unwrap_or(0.0);
    let mut sums = [0.0_f64; 2];
    let mut count = 0_usize;
    for (pixel, value) in &hearing.values {
        let Some(([rgb, uncertainty], _)) = value else {
            continue;
        };
        count += 1;
        for channel in 0..3 {
            for (sum, image) in sums.iter_mut().zip([ours, reference]) {
                let distance = (color_at(image, *pixel)[channel] - rgb[channel]).abs();
                // Files store single precision, whose rounding is no error.
                let known = uncertainty[channel] + rgb[channel].abs() * f64::from(f32::EPSILON) / 2.0;
                let scale = (rgb[channel].abs() + mean).max(f64::MIN_POSITIVE);
                *sum += ((distance - known).max(0.0) / scale).powi(2);
            }
        }
    }
    (count, sums.map(|sum| (sum / (3 * count).max(1) as f64).sqrt()))
}

/// Stores the oracle's verdicts on the worst pixels, and returns all verdicts.
fn note(
    case: &mut CaseResult,
    hearing: &Hearing,
    ours: &Image,
    reference: &Image,
) -> Vec<([usize; 2], Verdict)> {
    let verdicts: Vec<([usize; 2], Verdict)> = hearing.verdicts(ours, reference).collect();
    for worst in &mut case.worst {
        let found = verdicts.iter().find(|(pixel, _)| *pixel == [worst.x, worst.y]);
        worst.oracle = found.map(|(_, verdict)| *verdict);
    }
    verdicts
}

fn contradicted(case: &CaseResult, opinion: &Opinion, wrong: usize) -> String {
    format!(
        "{} is wrong: of {} that the oracle was queried about, it contradicts that image in {wrong} and agrees with the \
         reference in {}{}",
        case.image_name(),
        counted(opinion.asked, "pixel"),
        opinion.reference + opinion.both,
        approximated(case)
    )
}

/// What makes a reference unreliable everywhere.
pub(crate) fn rehits(count: u64) -> String {
    format!("{count} of the reference's spawned rays hit again the surface that they had just left")
}

/// The verdict on a wrong image. A subject whose scene is an approximation may be right about that
/// scene, and the oracle knows only the original one.
pub(crate) fn wrong_status(case: &CaseResult) -> Status {
    match &case.subject {
        Some(subject) if !subject.approximated.is_empty() => Status::Undecided,
        _ => Status::Fail,
    }
}

/// What the export for a subject approximates, as the end of a sentence.
fn approximated(case: &CaseResult) -> String {
    match &case.subject {
        Some(subject) if !subject.approximated.is_empty() => format!(
            "; the exported scene is an approximation, which may be the reason: {}",
            subject.approximated.join("; ")
        ),
        _ => String::new(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sample_says_how_sure_it_is() {
        assert_eq!(confidence(7, 0, 7), "all 7");
        assert_eq!(confidence(7, 2, 7), "5 of 7; it cannot decide the others");
        // The rule of three: 3/200.
        assert!(confidence(200, 0, 3000).contains("at most 1.5 % of the others"));
        assert!(confidence(220, 20, 3000).starts_with("200 of 3000; with 95 % confidence at most 1.5 %"));
    }
}
