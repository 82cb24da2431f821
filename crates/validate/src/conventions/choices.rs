//! Hypotheses that are changes of a probe scene, such as another index of refraction.

use super::image::{Filter, Fit, Guess, compose, fit};
use super::probe::{Lab, Probe};
use super::spot::Spot;
use super::{Film, Finding, is_clear};
use whitstone_image::Image;

/// Changes of the scene, as for `--set`, or of its spot, and what the subject does, as a sentence.
pub(super) struct Alternative {
    pub(super) changes: Vec<String>,
    spot: Option<Box<dyn Fn(Spot) -> Spot>>,
    pub(super) sentence: String,
    pub(super) key: Option<String>,
}

impl Alternative {
    pub(super) fn new(changes: &[&str], sentence: impl Into<String>) -> Self {
        Self {
            changes: changes.iter().map(|&change| change.to_owned()).collect(),
            spot: None,
            sentence: sentence.into(),
            key: None,
        }
    }

    pub(super) fn of_spot(change: impl Fn(Spot) -> Spot + 'static, sentence: impl Into<String>) -> Self {
        Self {
            spot: Some(Box::new(change)),
            ..Self::new(&[], sentence)
        }
    }
}

/// A number that the subject may have instead of the model's.
pub(super) struct Number {
    pub(super) tried: Vec<f64>,
    pub(super) changes: Box<dyn Fn(f64) -> Vec<String>>,
    pub(super) sentence: Box<dyn Fn(f64) -> String>,
}

/// A convention of a subject that differs from the model.
pub(super) enum Others {
    Words(Vec<Alternative>),
    Number(Number),
}

/// A convention that a probe tests.
pub(super) struct Choice {
    pub(super) convention: &'static str,
    pub(super) others: Others,
}

impl Choice {
    pub(super) fn words(convention: &'static str, alternatives: Vec<Alternative>) -> Self {
        Self {
            convention,
            others: Others::Words(alternatives),
        }
    }

    /// What is tried, as indices or values.
    pub(super) fn tried(&self) -> Vec<f64> {
        match &self.others {
            Others::Words(alternatives) => (0..alternatives.len()).map(|index| index as f64).collect(),
            Others::Number(number) => number.tried.clone(),
        }
    }

    fn changes(&self, picked: f64) -> Vec<String> {
        match &self.others {
            Others::Words(alternatives) => alternatives[picked as usize].changes.clone(),
            Others::Number(number) => (number.changes)(picked),
        }
    }

    /// The spot with this convention.
    fn of_spot(&self, picked: f64, spot: Spot) -> Spot {
        match &self.others {
            Others::Words(alternatives) => match &alternatives[picked as usize].spot {
                Some(change) => change(spot),
                None => spot,
            },
            Others::Number(_) => spot,
        }
    }

    fn sentence(&self, picked: f64) -> String {
        match &self.others {
            Others::Words(alternatives) => alternatives[picked as usize].sentence.clone(),
            Others::Number(number) => (number.sentence)(picked),
        }
    }

    fn key(&self, picked: f64) -> Option<String> {
        match &self.others {
            Others::Words(alternatives) => alternatives[picked as usize].key.clone(),
            Others::Number(_) => None,
        }
    }
}

/// For each choice what the subject does, if that is not what the model does.
pub(super) type Picked = Vec<Option<f64>>;

/// The changes of the scene by which the model does what was picked.
pub(super) fn changes(choices: &[Choice], picked: &Picked) -> Vec<String> {
    let (mut changes, mut spot) = (Vec::new(), Spot::STATED);
    for (choice, picked) in choices.iter().zip(picked) {
        if let Some(picked) = *picked {
            changes.extend(choice.changes(picked));
            spot = choice.of_spot(picked, spot);
        }
    }
    if spot != Spot::STATED {
        // It replaces all lights, so that other changes come after it.
        changes.insert(0, spot.change());
    }
    changes
}

/// The choices with the smallest error, by coordinate descent from the model, and that error.
pub(super) fn descend(
    choices: &[Choice],
    error: &mut dyn FnMut(&Picked) -> Result<f64, String>,
) -> Result<(f64, Picked), String> {
    let mut best: Picked = vec![None; choices.len()];
    let mut least = error(&best)?;
    for _ in 0..3 {
        let before = best.clone();
        for (index, choice) in choices.iter().enumerate() {
            for value in choice.tried() {
                let mut trial = best.clone();
                trial[index] = Some(value);
                let found = error(&trial)?;
                if least > super::CLEARLY * found + 0.1 * super::CLEARLY_MORE {
                    (least, best) = (found, trial);
                }
            }
        }
        for (index, choice) in choices.iter().enumerate() {
            if matches!(choice.others, Others::Number(_)) && best[index].is_some() {
                (least, best) = refine(index, least, best, error)?;
            }
        }
        if best == before {
            break;
        }
    }
    Ok((least, best))
}

/// Tries each number in small steps: what is seen through glass shows its index only nearby.
fn scan(
    choices: &[Choice],
    mut least: f64,
    mut best: Picked,
    error: &mut dyn FnMut(&Picked) -> Result<f64, String>,
) -> Result<(f64, Picked), String> {
    for (index, choice) in choices.iter().enumerate() {
        let Others::Number(number) = &choice.others else {
            continue;
        };
        let (from, to) = number.tried.iter().fold((f64::MAX, 0.0), |(from, to), value| {
            (value.min(from), value.max(to))
        });
        let step = (to / from).powf(1.0 / 120.0).max(1.01);
        let before = best.clone();
        let mut value: f64 = from;
        while value < to {
            let mut trial = before.clone();
            trial[index] = Some(value);
            let found = error(&trial)?;
            if least > super::CLEARLY * found + 0.1 * super::CLEARLY_MORE {
                (least, best) = (found, trial);
            }
            value *= step;
        }
        if best != before {
            (least, best) = refine(index, least, best, error)?;
        }
    }
    Ok((least, best))
}

/// Searches near a number that was found.
fn refine(
    index: usize,
    mut least: f64,
    mut best: Picked,
    error: &mut dyn FnMut(&Picked) -> Result<f64, String>,
) -> Result<(f64, Picked), String> {
    let mut step = 0.16;
    while step > 5e-4 {
        let mut is_better = false;
        for sign in [-1.0, 1.0] {
            let mut trial = best.clone();
            trial[index] = best[index].map(|value| value * (1.0 + sign * step));
            let found = error(&trial)?;
            // A round number stays unless another one is clearly better.
            if found < 0.95 * least - 0.1 * super::CLEARLY_MORE {
                (least, best, is_better) = (found, trial, true);
            }
        }
        if !is_better {
            step *= 0.5;
        }
    }
    Ok((least, best))
}

/// What a probe shows.
pub(super) struct Examined {
    pub(super) fit: Fit,
    pub(super) findings: Vec<Finding>,
    pub(super) picked: Picked,
}

/// Finds which of the alternatives a subject's image of a probe shows.
pub(super) fn examine(
    lab: &Lab<'_>,
    probe: &Probe,
    choices: &[Choice],
    image: &Image,
    film: &Film,
) -> Result<Examined, String> {
    let Film { guess, free, .. } = film;
    let fitted = |picked: &Picked| -> Result<Fit, String> {
        let all = [&film.changes[..], &changes(choices, picked)].concat();
        let samples = lab.samples(probe, &all, guess)?;
        Ok(fit(&compose(&samples, guess), image, guess, *free))
    };
    let mut error = |picked: &Picked| Ok(fitted(picked)?.error);
    let (mut least, mut picked) = descend(choices, &mut error)?;
    if least > super::EXPLAINED {
        // One sample per pixel is enough to find a number, and many are tried.
        let point = Guess {
            filter: Filter::Point,
            ..*guess
        };
        let mut quick = |picked: &Picked| -> Result<f64, String> {
            let all = [&film.changes[..], &changes(choices, picked)].concat();
            let samples = lab.samples(probe, &all, &point)?;
            Ok(fit(&compose(&samples, &point), image, &point, *free).error)
        };
        let before = quick(&picked)?;
        let (_, scanned) = scan(choices, before, picked.clone(), &mut quick)?;
        let found = error(&scanned)?;
        if least > super::CLEARLY * found {
            (least, picked) = (found, scanned);
        }
    }
    let findings = findings(choices, &picked, least, &mut error)?;
    Ok(Examined {
        fit: fitted(&picked)?,
        findings,
        picked,
    })
}

/// The choices that are clearly better than what the model does.
pub(super) fn findings(
    choices: &[Choice],
    picked: &Picked,
    least: f64,
    error: &mut dyn FnMut(&Picked) -> Result<f64, String>,
) -> Result<Vec<Finding>, String> {
    let mut findings = Vec::new();
    for (index, choice) in choices.iter().enumerate() {
        let Some(value) = picked[index] else { continue };
        let mut without = picked.clone();
        without[index] = None;
        let without = error(&without)?;
        if is_clear(least, without) {
            findings.push(Finding {
                convention: choice.convention,
                sentence: choice.sentence(value),
                error: least,
                error_without: without,
                key: choice.key(value),
            });
        }
    }
    Ok(findings)
}
