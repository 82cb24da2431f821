//! What a family came to.

use crate::{About, Engine, Family, Lab, Sample};
use serde::{Deserialize, Serialize};
use std::fmt;

/// One step of one engine.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Step {
    /// Value of the knob.
    pub knob: f64,
    /// In the family's measure.
    pub error: f64,
    /// In the measure of the promise.
    pub strict: f64,
    /// Answers of the wrong class.
    pub failures: u64,
    /// Answers that are no numbers.
    pub nonfinite: u64,
    /// Where it was timed.
    pub ns_per_op: Option<f64>,
    /// Whether it keeps the promise.
    pub passes: bool,
    /// Whether it is of use.
    pub usable: bool,
}

/// One engine over all steps.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct EngineReport {
    /// Which.
    pub engine: Engine,
    /// The first value of the knob at which it is not usable; none if it is at all of them.
    pub frontier: Option<f64>,
    /// How many steps come before the frontier.
    pub usable_steps: usize,
    /// All that it answered; empty where it takes no part.
    pub steps: Vec<Step>,
    /// Whether it keeps the promise at every step.
    pub passes: bool,
    /// Why it takes no part.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub absent: Option<String>,
}

/// How a family ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// Whitstone keeps the promise everywhere, its frontier is not nearer than Mitsuba's, and a naive variant fails.
    Pass,
    /// Whitstone breaks the promise.
    Fails,
    /// Mitsuba gets further.
    Behind,
    /// No naive variant fails: the family proves nothing.
    Toothless,
}

/// A family over all steps.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct FamilyReport {
    /// Its name.
    pub family: String,
    /// Its numbers in the catalogue.
    pub catalogue: Vec<u32>,
    /// What is turned.
    pub knob: String,
    /// What `error` is.
    pub measure: String,
    /// What is promised.
    pub pass_level: String,
    /// Largest usable error.
    pub usable_level: f64,
    /// Values of the knob.
    pub knobs: Vec<f64>,
    /// Whitstone first.
    pub engines: Vec<EngineReport>,
    /// Whether a naive variant fails.
    pub naive_fails: bool,
    /// All in all.
    pub verdict: Verdict,
}

impl FamilyReport {
    /// Runs the family. `told` is called before every step.
    ///
    /// # Errors
    ///
    /// As [`Family::step`].
    pub fn measure(family: &dyn Family, lab: &Lab<'_>, told: &dyn Fn(f64)) -> Result<Self, String> {
        let about = family.about();
        let knobs = family.knobs();
        let mut engines: Vec<EngineReport> = Vec::new();
        for knob in &knobs {
            told(*knob);
            let answers = family.step(*knob, lab);
            let answers = answers.map_err(|problem| format!("{} at {knob:e}: {problem}", about.name))?;
            for (engine, answer) in answers {
                let place = engines.iter().position(|known| known.engine == engine);
                let place = place.unwrap_or_else(|| {
                    engines.push(EngineReport::new(engine));
                    engines.len() - 1
                });
                match answer {
                    Ok(sample) => engines[place].steps.push(Step::new(*knob, sample, &about)),
                    Err(why) => {
                        engines[place].absent.get_or_insert(why);
                    }
                }
            }
        }
        engines.sort_by_key(|engine| engine.engine);
        engines.iter_mut().for_each(EngineReport::conclude);
        Ok(Self::judge(&about, knobs, engines))
    }

    fn judge(about: &About, knobs: Vec<f64>, engines: Vec<EngineReport>) -> Self {
        let of = |engine| {
            engines
                .iter()
                .find(|report: &&EngineReport| report.engine == engine)
        };
        let takes_part = |report: &&EngineReport| !report.steps.is_empty();
        // The textbook in single precision never keeps a promise that is made for doubles: what it must fail is to be usable.
        let naive_fails = of(Engine::NaiveF64)
            .filter(takes_part)
            .is_some_and(|report| !report.passes)
            || of(Engine::NaiveF32)
                .filter(takes_part)
                .is_some_and(|report| report.frontier.is_some());
        let ours = of(Engine::Whitstone);
        let theirs = of(Engine::Mitsuba).filter(takes_part);
        let verdict = if !ours.is_some_and(|report| report.passes) {
            Verdict::Fails
        } else if ours
            .zip(theirs)
            .is_some_and(|(ours, theirs)| ours.usable_steps < theirs.usable_steps)
        {
            Verdict::Behind
        } else if !naive_fails {
            Verdict::Toothless
        } else {
            Verdict::Pass
        };
        Self {
            family: about.name.to_owned(),
            catalogue: about.catalogue.to_vec(),
            knob: about.knob.to_owned(),
            measure: about.measure.to_owned(),
            pass_level: about.promise.to_owned(),
            usable_level: about.usable,
            knobs,
            engines,
            naive_fails,
            verdict,
        }
    }

    /// What an engine's frontier is, in words.
    pub fn frontier(&self, engine: Engine) -> String {
        let report = self.engines.iter().find(|report| report.engine == engine);
        match report {
            Some(report) if report.steps.is_empty() => "–".to_owned(),
            Some(EngineReport {
                frontier: Some(knob), ..
            }) => format!("{knob:.0e}"),
            Some(_) => "none".to_owned(),
            None => "–".to_owned(),
        }
    }
}

impl EngineReport {
    fn new(engine: Engine) -> Self {
        Self {
            engine,
            frontier: None,
            usable_steps: 0,
            steps: Vec::new(),
            passes: false,
            absent: None,
        }
    }

    fn conclude(&mut self) {
        // Who cannot take every step takes no part: a frontier would say nothing.
        if self.absent.is_some() {
            self.steps.clear();
        }
        self.passes =
            !self.steps.is_empty() && self.absent.is_none() && self.steps.iter().all(|step| step.passes);
        self.usable_steps = self.steps.iter().take_while(|step| step.usable).count();
        self.frontier = self.steps.get(self.usable_steps).map(|step| step.knob);
    }
}

impl Step {
    fn new(knob: f64, sample: Sample, about: &About) -> Self {
        let sound = sample.failures == 0 && sample.nonfinite == 0;
        Self {
            knob,
            error: sample.error,
            strict: sample.strict,
            failures: sample.failures,
            nonfinite: sample.nonfinite,
            ns_per_op: sample.ns_per_op,
            passes: sound && sample.strict <= about.pass,
            usable: sound && sample.error <= about.usable,
        }
    }
}

impl fmt::Display for Verdict {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Pass => "pass",
            Self::Fails => "FAILS",
            Self::Behind => "BEHIND",
            Self::Toothless => "TOOTHLESS",
        })
    }
}

/// The frontiers of all families as a table in Markdown.
pub fn table(reports: &[FamilyReport]) -> String {
    let mut text = String::from(
        "| family | what is turned | Whitstone | Mitsuba | naive f64 | naive f32 | verdict |\n|---|---|---|---|---|---|---|\n",
    );
    for report in reports {
        let of = |engine| report.frontier(engine);
        text += &format!(
            "| {} | {} | {} | {} | {} | {} | {} |\n",
            report.family,
            report.knob,
            of(Engine::Whitstone),
            of(Engine::Mitsuba),
            of(Engine::NaiveF64),
            of(Engine::NaiveF32),
            report.verdict
        );
    }
    text
}

/// Frontiers of Whitstone and Mitsuba, in the families where both take part.
pub fn headline(reports: &[FamilyReport]) -> String {
    let mut text = String::from(
        "| family | what is turned, and how far | Whitstone breaks at | Mitsuba breaks at |\n|---|---|---|---|\n",
    );
    for report in reports {
        let [ours, theirs] = [Engine::Whitstone, Engine::Mitsuba].map(|engine| report.frontier(engine));
        let (Some(first), Some(last)) = (report.knobs.first(), report.knobs.last()) else {
            continue;
        };
        if theirs != "–" {
            text += &format!(
                "| {} | {}: {first:.0e} to {last:.0e} | {ours} | {theirs} |\n",
                report.family, report.knob
            );
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Engines that break the usable level at these errors, over a knob of three decades; all promises are 1.
    fn judged(errors: [(Engine, [f64; 3]); 3]) -> FamilyReport {
        struct Fixed([(Engine, [f64; 3]); 3]);
        impl Family for Fixed {
            fn about(&self) -> About {
                About {
                    name: "fixed",
                    catalogue: &[],
                    knob: "nothing",
                    measure: "none",
                    promise: "1",
                    pass: 1.0,
                    usable: 10.0,
                }
            }
            fn knobs(&self) -> Vec<f64> {
                vec![1.0, 10.0, 100.0]
            }
            fn step(&self, knob: f64, _: &Lab<'_>) -> Result<Vec<(Engine, crate::Answer)>, String> {
                let at = knob.log10().round() as usize;
                Ok(self
                    .0
                    .iter()
                    .map(|(engine, errors)| (*engine, Ok(Sample::new(errors[at]))))
                    .collect())
            }
        }
        let registry = whitstone_core::Registry::default();
        let lab = Lab::new(&registry, None, 1);
        FamilyReport::measure(&Fixed(errors), &lab, &|_| ()).expect("it has no errors")
    }

    #[test]
    fn verdicts() {
        use Engine::{Mitsuba, NaiveF32, Whitstone};
        let (good, naive) = ((Whitstone, [0.0, 0.5, 1.0]), (NaiveF32, [0.0, 20.0, 20.0]));
        let report = judged([good, (Mitsuba, [2.0, 5.0, 50.0]), naive]);
        assert_eq!(report.verdict, Verdict::Pass);
        assert_eq!(report.frontier(Whitstone), "none");
        assert_eq!(report.frontier(Mitsuba), "1e2");
        assert_eq!(report.frontier(NaiveF32), "1e1");
        // A broken promise, also where it is still of use.
        let broken = (Whitstone, [0.0, 1.1, 1.0]);
        assert_eq!(
            judged([broken, (Mitsuba, [2.0; 3]), naive]).verdict,
            Verdict::Fails
        );
        // No number is worse than any.
        let none = (Whitstone, [0.0, f64::NAN, 0.0]);
        assert_eq!(judged([none, (Mitsuba, [2.0; 3]), naive]).verdict, Verdict::Fails);
        // Nothing that fails proves nothing.
        assert_eq!(
            judged([good, (Mitsuba, [2.0; 3]), (NaiveF32, [9.0; 3])]).verdict,
            Verdict::Toothless
        );
    }

    #[test]
    fn a_picture_has_every_engine() {
        use Engine::{Mitsuba, NaiveF32, Whitstone};
        let report = judged([
            (Whitstone, [0.0; 3]),
            (Mitsuba, [2.0, 5.0, 50.0]),
            (NaiveF32, [20.0; 3]),
        ]);
        let svg = crate::plot::svg(&report);
        for engine in [Whitstone, Mitsuba, NaiveF32] {
            assert!(svg.contains(&format!(
                "{} (frontier {})",
                engine.name(),
                report.frontier(engine)
            )));
        }
        assert!(!svg.contains("NaN") && !svg.contains("inf"), "{svg}");
        assert!(
            headline(std::slice::from_ref(&report)).contains("| fixed | nothing: 1e0 to 1e2 | none | 1e2 |")
        );
        assert!(table(&[report]).contains("| none | 1e2 | – | 1e0 | pass |"));
    }
}
