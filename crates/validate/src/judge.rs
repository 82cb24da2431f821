//! Compares our image with the reference: finds the differences, explains them by the reference's
//! own variation, and computes the numbers that have limits. The verdict follows in
//! [`crate::verdict`].

use crate::explain::{Explanation, Range, Reason, explain};
use crate::pixels::Pictures;
use crate::protocol::SceneText;
use crate::result::{CaseResult, LayerResult, Reference, WorstPixel};
use crate::stored::Stored;
use crate::tolerance::{allowed, color_at};
use crate::validator::{Against, EXPLAINED_PIXELS, Ours, Validator};
use crate::{floor, inexact, tree, vacuous};
use whitstone_core::SurfaceAttributes;
use whitstone_image::Image;
use whitstone_metrics::{CompareError, CompareOptions, Mask, Tolerance, compare, layers, metrics};

/// Number of worst pixels that a result lists.
const WORST: usize = 20;
/// Number of unexplained pixels whose ray trees are compared.
const TREES: usize = 3;
/// Maximum number of pixels that are traced again by the reference. If more differ, there is a
/// fault, or the reference cannot render the scene; the rest counts as unexplained.
const MAX_TRACED_AGAIN: usize = 4096;

/// A pixel over tolerance.
pub(crate) struct Judged {
    pub(crate) pixel: [usize; 2],
    pub(crate) explanation: Explanation,
    /// The range of the values that a live reference took there.
    tried: Option<Range>,
}

impl Judged {
    fn unexplained(pixel: &[usize; 2]) -> Self {
        Self {
            pixel: *pixel,
            explanation: Explanation::Nothing,
            tried: None,
        }
    }

    /// The explanation, by the variation alone or together with the oracle.
    pub(crate) fn reason(&self) -> Option<Reason> {
        match self.explanation {
            Explanation::Value(reason) | Explanation::Between(reason) => Some(reason),
            Explanation::Nothing => None,
        }
    }
}

impl Validator<'_> {
    /// Computes the numbers of a case, and returns the pixels over tolerance.
    pub(crate) fn judge(
        &mut self,
        case: &mut CaseResult,
        ours: &Ours,
        against: &Against,
    ) -> Result<Vec<Judged>, CompareError> {
        let Stored {
            image: reference,
            meta,
            ..
        } = &against.stored;
        case.reference = Some(Reference {
            name: meta.renderer.clone(),
            version: meta.version.clone(),
            variant: meta.variant.clone(),
            source: if against.live { "live" } else { "stored" }.to_owned(),
            k: meta.k,
        });
        case.twin = meta.twin.clone();
        case.floor = meta.floor;
        case.moved = meta.moved;
        case.reference_s = Some(meta.seconds);
        let textured = ours.pipeline.scene.needs().contains(SurfaceAttributes::UV);
        let cap = floor::cap(self.options.renderer.largest_limit(), textured);
        if case.limit == 0.0 {
            case.limit = floor::limit(meta.floor, cap);
        }
        case.bias_limit = floor::bias_limit(meta.floor, cap);
        if case.subject.is_some() {
            // A subject that states its own limit has its own floor.
            case.bias_limit = case.bias_limit.max(2.0 * case.limit);
        }
        let not_finite = metrics::count_not_finite(&ours.image, reference)?;
        case.nonfinite = not_finite.ours + not_finite.reference;
        let tolerance = Tolerance::default();
        let over = metrics::over_tolerance(&ours.image, reference, tolerance)?;
        case.pixels_over_tolerance = over.count();
        let judged = self.explain(ours, against, &over, case);
        if self.pictures {
            let reasons = judged.iter().map(|one| (one.pixel, one.reason()));
            case.pictures = Pictures::new(&ours.image, reference, reasons);
        }
        for one in &judged {
            match one.explanation {
                Explanation::Value(Reason::Shift { radius_px }) => {
                    case.explained += 1;
                    case.explained_radius_px = case.explained_radius_px.max(radius_px);
                }
                Explanation::Value(_) => case.explained += 1,
                Explanation::Between(_) => case.ambiguous += 1,
                Explanation::Nothing => case.unexplained += 1,
            }
        }
        self.list_worst(case, ours, reference, &over, &judged)?;
        self.compare_layers(case, &ours.image, reference, &over, &mask(&judged, &over))?;
        measure(case, &ours.image, reference, &mask(&judged, &over))?;
        case.compared = true;
        case.notes = vacuous::notes(&ours.image, reference, &ours.pipeline);
        case.notes.extend(meta.notes.iter().cloned());
        case.notes
            .extend(ours.pipeline.scene.geometry.search_limit_notes());
        case.coincident = vacuous::coincident(&ours.pipeline);
        if case.ambiguous > 0 || !case.broken_limits().is_empty() {
            case.inexact = inexact::notes(case, &ours.pipeline.scene.geometry, self.options.renderer, cap);
        }
        Ok(judged)
    }

    /// Determines for each pixel over tolerance whether the reference could have taken our value.
    fn explain(&mut self, ours: &Ours, against: &Against, over: &Mask, case: &mut CaseResult) -> Vec<Judged> {
        let pixels: Vec<[usize; 2]> = over.pixels().map(|(x, y)| [x, y]).collect();
        let reference = &against.stored.image;
        let mean = metrics::mean_reference(reference).unwrap_or(0.0);
        let most = MAX_TRACED_AGAIN.max(20 * case.explained_limit.max(EXPLAINED_PIXELS));
        let (asked, beyond) = pixels.split_at(pixels.len().min(most));
        let mut judged: Vec<Judged> = Vec::new();
        if !against.live {
            let variation = against.stored.variation();
            for &pixel in asked {
                judged.push(Judged {
                    explanation: variation.explain(&ours.image, pixel, Tolerance::default(), mean),
                    ..Judged::unexplained(&pixel)
                });
            }
        } else if !asked.is_empty() {
            let text = SceneText {
                text: &ours.flattened.text,
                base: &ours.flattened.base,
            };
            (self.stage)(&format!("tracing {} pixels of the reference again", asked.len()));
            let trials = self.options.renderer.trials();
            let answer = self
                .live
                .as_mut()
                .map(|live| live.probe(text, &ours.flattened.hash, asked, &trials));
            match answer {
                Some(Ok(values)) => {
                    for (&pixel, variants) in asked.iter().zip(&values) {
                        let nominal = color_at(reference, pixel);
                        let value = color_at(&ours.image, pixel);
                        let mut tried = Range::of(nominal);
                        variants
                            .iter()
                            .flatten()
                            .for_each(|variant| tried.include(*variant));
                        judged.push(Judged {
                            pixel,
                            explanation: explain(value, nominal, allowed(nominal, mean), &trials, variants),
                            tried: Some(tried),
                        });
                    }
                }
                Some(Err(error)) => {
                    case.problems
                        .push(format!("pixels could not be traced again: {error}"));
                    judged.extend(asked.iter().map(Judged::unexplained));
                }
                None => judged.extend(asked.iter().map(Judged::unexplained)),
            }
        }
        judged.extend(beyond.iter().map(Judged::unexplained));
        judged
    }

    fn list_worst(
        &mut self,
        case: &mut CaseResult,
        ours: &Ours,
        reference: &Image,
        over: &Mask,
        judged: &[Judged],
    ) -> Result<(), CompareError> {
        let mut unexplained = Mask::new(over.width(), over.height());
        for Judged { pixel: [x, y], .. } in judged.iter().filter(|one| one.reason().is_none()) {
            unexplained.set(*x, *y, true);
        }
        let mut worst = metrics::worst(&ours.image, reference, WORST, Some(&unexplained))?;
        let rest = metrics::worst(&ours.image, reference, WORST, Some(over))?;
        worst.extend(
            rest.into_iter()
                .filter(|pixel| !unexplained.contains(pixel.x, pixel.y)),
        );
        worst.truncate(WORST);
        let too_many = case.explained > case.explained_limit;
        for (rank, pixel) in worst.iter().enumerate() {
            let place = [pixel.x, pixel.y];
            let found = judged.iter().find(|one| one.pixel == place);
            let explanation = found.map_or(Explanation::Nothing, |one| one.explanation);
            let tried = found.and_then(|one| one.tried);
            let first_difference =
                if (too_many || !matches!(explanation, Explanation::Value(_))) && rank < TREES {
                    self.first_difference(ours, place)
                } else {
                    None
                };
            case.worst.push(WorstPixel {
                x: pixel.x,
                y: pixel.y,
                ours: pixel.ours,
                reference: pixel.reference,
                reason: match explanation {
                    Explanation::Value(reason) => Some(reason),
                    _ => None,
                },
                between: match explanation {
                    Explanation::Between(reason) => Some(reason),
                    _ => None,
                },
                tried: tried
                    .filter(|_| !matches!(explanation, Explanation::Value(_)))
                    .map(|range| [range.min, range.max]),
                first_difference,
                oracle: None,
            });
        }
        Ok(())
    }

    /// A description of the first difference between our ray tree and the live reference's, or of
    /// why it is not available. Stored references, POV-Ray and subjects have no trees.
    fn first_difference(&mut self, ours: &Ours, pixel: [usize; 2]) -> Option<String> {
        if self.has_subject() {
            // Its ray trees are not known.
            return None;
        }
        let live = self
            .live
            .as_mut()
            .filter(|live| live.renderer().has_ray_trees())?;
        (self.stage)("comparing ray trees");
        let text = SceneText {
            text: &ours.flattened.text,
            base: &ours.flattened.base,
        };
        let samples = ours.pipeline.samples();
        for sample in 0..samples {
            let theirs = match live.tree(text, pixel, sample) {
                Ok(theirs) => theirs,
                Err(error) => return Some(format!("sample {sample}: the reference's ray tree: {error}")),
            };
            let mine = tree::ours(&ours.pipeline, pixel, sample);
            if let Some(difference) = tree::first_difference(&mine, &theirs) {
                return Some(format!("sample {sample}: {difference}"));
            }
        }
        Some("the ray trees agree: the difference is in how they are summed".to_owned())
    }

    fn compare_layers(
        &self,
        case: &mut CaseResult,
        ours: &Image,
        reference: &Image,
        over: &Mask,
        explained: &Mask,
    ) -> Result<(), CompareError> {
        let names: Vec<String> = ours
            .channels()
            .map(|(name, _)| name.to_owned())
            .filter(|name| name.contains('.'))
            .collect();
        // Numbers can only agree where both hit the same primitive.
        let mut apart = explained.clone();
        for name in names.iter().filter(|name| name.ends_with(".I")) {
            let ids = layers::compare_ids(ours, reference, name, None)?;
            let mut alone = 0;
            for (x, y) in ids.differing.pixels() {
                apart.set(x, y, true);
                alone += usize::from(!over.contains(x, y));
            }
            case.layers.push(LayerResult {
                name: name.clone(),
                differing: Some(ids.differing.count()),
                differing_alone: Some(alone),
                rms: None,
                max_abs: None,
            });
        }
        let mean = metrics::mean_reference(reference).unwrap_or(0.0);
        for name in names.iter().filter(|name| !name.ends_with(".I")) {
            let off = is_path_class(name)
                .then(|| off_tolerance(ours, reference, name, mean, explained))
                .flatten();
            let numbers = layers::compare_floats(ours, reference, name, Some(&apart))?;
            case.layers.push(LayerResult {
                name: name.clone(),
                differing: off.as_ref().map(Mask::count),
                differing_alone: off.map(|off| off.pixels().filter(|(x, y)| !over.contains(*x, *y)).count()),
                rms: Some(numbers.rms),
                max_abs: Some(numbers.max_abs),
            });
        }
        Ok(())
    }
}

/// Whether a channel is a part of the radiance: that of a path class.
fn is_path_class(name: &str) -> bool {
    name.starts_with("path.")
}

/// The pixels whose values in a path class differ by more than the tolerance of the radiance, apart
/// from the explained ones. `None` if the reference has no such layer.
fn off_tolerance(ours: &Image, reference: &Image, name: &str, mean: f64, explained: &Mask) -> Option<Mask> {
    let (mine, theirs) = (ours.channel(name)?, reference.channel(name)?);
    let mut off = Mask::new(ours.width(), ours.height());
    for y in 0..ours.height() {
        for x in 0..ours.width() {
            let place = y * ours.width() + x;
            // A part of the radiance has the rounding errors of all of it.
            let [r, g, b] = allowed(color_at(reference, [x, y]), mean);
            let difference = (f64::from(mine[place]) - f64::from(theirs[place])).abs();
            // Not `>`, so that NaN counts as a difference.
            let near = difference <= r.max(g).max(b);
            off.set(x, y, !near && !explained.contains(x, y));
        }
    }
    Some(off)
}

/// The pixels that the reference's variation explains, by itself or together with the oracle.
pub(crate) fn mask(judged: &[Judged], over: &Mask) -> Mask {
    let mut mask = Mask::new(over.width(), over.height());
    for one in judged.iter().filter(|one| one.reason().is_some()) {
        mask.set(one.pixel[0], one.pixel[1], true);
    }
    mask
}

/// Computes the errors of a case. The interior excludes the pixels of `exclude`.
pub(crate) fn measure(
    case: &mut CaseResult,
    ours: &Image,
    reference: &Image,
    exclude: &Mask,
) -> Result<(), CompareError> {
    if case.nonfinite > 0 {
        return Ok(());
    }
    let options = CompareOptions {
        exclude: Some(exclude),
        ..CompareOptions::default()
    };
    let measured = compare(ours, reference, &options)?;
    case.rmse = Some(measured.rmse);
    case.rel_rmse_interior = measured.rel_rmse_interior;
    case.relmse = Some(measured.relmse);
    case.mae = Some(measured.mae);
    case.max_abs = Some(measured.max_abs);
    case.mean_reference = Some(measured.mean_reference);
    case.signed_block_bias = measured.signed_block_bias;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two classes that are exchanged in a pixel sum to the same image.
    #[test]
    fn exchanged_path_classes_are_found() {
        let image = |a: [f32; 3], b: [f32; 3]| {
            let rgb: Vec<[f32; 3]> = a.iter().zip(&b).map(|(a, b)| [a + b; 3]).collect();
            let mut image = Image::from_rgb(3, 1, &rgb).unwrap();
            image.add_channel("path.a.R", a.to_vec()).unwrap();
            image.add_channel("path.b.R", b.to_vec()).unwrap();
            image
        };
        let reference = image([0.5, 0.25, 0.0], [0.25, 0.5, 1.0]);
        let nothing = Mask::new(3, 1);
        let off = |ours: &Image, explained: &Mask| {
            ["path.a.R", "path.b.R"].map(|name| {
                off_tolerance(ours, &reference, name, 0.5, explained)
                    .unwrap()
                    .count()
            })
        };
        assert!(is_path_class("path.a.R") && !is_path_class("depth.Z"));
        assert_eq!(off(&reference, &nothing), [0, 0]);
        let exchanged = image([0.25, 0.25, 0.0], [0.5, 0.5, 1.0]);
        assert_eq!(off(&exchanged, &nothing), [1, 1]);
        assert_eq!(
            off(&image([f32::NAN, 0.25, 0.0], [0.25, 0.5, 1.0]), &nothing),
            [1, 0]
        );
        let mut explained = nothing.clone();
        explained.set(0, 0, true);
        assert_eq!(off(&exchanged, &explained), [0, 0]);
        assert!(off_tolerance(&exchanged, &reference, "path.c.R", 0.5, &nothing).is_none());
    }
}
