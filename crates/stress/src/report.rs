//! Results of a family.

use crate::{About, Engine, Family, Lab, Sample};
use serde::{Deserialize, Serialize};
use std::fmt;

/// One step of one engine.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Step {
    /// Value of the parameter.
    pub parameter: f64,
    /// Error in the family's measure.
    pub error: f64,
    /// Error in the measure of the promise.
    pub strict: f64,
    /// Answers of the wrong class.
    pub failures: u64,
    /// Answers that are infinite or NaN.
    pub nonfinite: u64,
    /// Nanoseconds per operation, if it was timed.
    pub ns_per_op: Option<f64>,
    /// Whether it keeps the promise.
    pub passes: bool,
    /// Whether it is usable.
    pub usable: bool,
}

/// One engine over all steps.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct EngineReport {
    /// The engine.
    pub engine: Engine,
    /// The first value of the parameter at which it is not usable; `None` if it is usable at all of
    /// them.
    pub frontier: Option<f64>,
    /// Number of steps before the frontier.
    pub usable_steps: usize,
    /// All results; empty if it takes no part.
    pub steps: Vec<Step>,
    /// Whether it keeps the promise at every step.
    pub passes: bool,
    /// Why it takes no part.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub absent: Option<String>,
}

/// The result of a family.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// Whitstone keeps the promise everywhere, its frontier is at least as far as Mitsuba's and
    /// Embree's, and a naive variant fails.
    Pass,
    /// Whitstone breaks the promise.
    Fails,
    /// Mitsuba or Embree gets further.
    Behind,
    /// No naive variant fails: the family is vacuous.
    Vacuous,
}

/// A family over all steps.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct FamilyReport {
    /// Its name.
    pub family: String,
    /// Its numbers in the catalogue.
    pub catalogue: Vec<u32>,
    /// The parameter that is swept.
    pub parameter: String,
    /// The definition of `error`.
    pub measure: String,
    /// The promise.
    pub pass_level: String,
    /// Largest usable error.
    pub usable_level: f64,
    /// Values of the parameter.
    pub parameters: Vec<f64>,
    /// All engines, Whitstone first.
    pub engines: Vec<EngineReport>,
    /// Whether a naive variant fails.
    pub naive_fails: bool,
    /// The overall result.
    pub verdict: Verdict,
}

impl FamilyReport {
    /// Runs the family. `progress` is called before every step.
    ///
    /// # Errors
    ///
    /// As [`Family::step`].
    pub fn measure(family: &dyn Family, lab: &Lab<'_>, progress: &dyn Fn(f64)) -> Result<Self, String> {
        let about = family.about();
        let parameters = family.parameters();
        let mut engines: Vec<EngineReport> = Vec::new();
        for parameter in &parameters {
            progress(*parameter);
            let answers = family.step(*parameter, lab);
            let answers = answers.map_err(|problem| format!("{} at {parameter:e}: {problem}", about.name))?;
            for (engine, answer) in answers {
                let place = engines.iter().position(|known| known.engine == engine);
                let place = place.unwrap_or_else(|| {
                    engines.push(EngineReport::new(engine));
                    engines.len() - 1
                });
                match answer {
                    Ok(sample) => engines[place].steps.push(Step::new(*parameter, sample, &about)),
                    Err(why) => {
                        engines[place].absent.get_or_insert(why);
                    }
                }
            }
        }
        engines.sort_by_key(|engine| engine.engine);
        engines.iter_mut().for_each(EngineReport::conclude);
        Ok(Self::judge(&about, parameters, engines))
    }

    fn judge(about: &About, parameters: Vec<f64>, engines: Vec<EngineReport>) -> Self {
        let of = |engine| {
            engines
                .iter()
                .find(|report: &&EngineReport| report.engine == engine)
        };
        let takes_part = |report: &&EngineReport| !report.steps.is_empty();
        // Textbook formulas in single precision never meet a promise made for doubles, so they only
        // count as failing if they are unusable.
        let naive_fails = of(Engine::NaiveF64)
            .filter(takes_part)
            .is_some_and(|report| !report.passes)
            || of(Engine::NaiveF32)
                .filter(takes_part)
                .is_some_and(|report| report.frontier.is_some());
        let ours = of(Engine::Whitstone);
        let theirs = [Engine::Mitsuba, Engine::Embree].map(|engine| of(engine).filter(takes_part));
        let farthest = theirs
            .into_iter()
            .flatten()
            .map(|report| report.usable_steps)
            .max();
        let verdict = if !ours.is_some_and(|report| report.passes) {
            Verdict::Fails
        } else if ours
            .zip(farthest)
            .is_some_and(|(ours, farthest)| ours.usable_steps < farthest)
        {
            Verdict::Behind
        } else if !naive_fails {
            Verdict::Vacuous
        } else {
            Verdict::Pass
        };
        Self {
            family: about.name.to_owned(),
            catalogue: about.catalogue.to_vec(),
            parameter: about.parameter.to_owned(),
            measure: about.measure.to_owned(),
            pass_level: about.promise.to_owned(),
            usable_level: about.usable,
            parameters,
            engines,
            naive_fails,
            verdict,
        }
    }

    /// Whether an engine took part.
    pub fn takes_part(&self, engine: Engine) -> bool {
        let mut all = self.engines.iter();
        all.any(|report| report.engine == engine && !report.steps.is_empty())
    }

    /// The frontier of an engine as text.
    pub fn frontier(&self, engine: Engine) -> String {
        let report = self.engines.iter().find(|report| report.engine == engine);
        match report {
            Some(report) if report.steps.is_empty() => "–".to_owned(),
            Some(EngineReport {
                frontier: Some(parameter),
                ..
            }) => format!("{parameter:.0e}"),
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
        // An engine that cannot take every step takes no part: its frontier would be meaningless.
        if self.absent.is_some() {
            self.steps.clear();
        }
        self.passes =
            !self.steps.is_empty() && self.absent.is_none() && self.steps.iter().all(|step| step.passes);
        self.usable_steps = self.steps.iter().take_while(|step| step.usable).count();
        self.frontier = self.steps.get(self.usable_steps).map(|step| step.parameter);
    }
}

impl Step {
    fn new(parameter: f64, sample: Sample, about: &About) -> Self {
        let sound = sample.failures == 0 && sample.nonfinite == 0;
        Self {
            parameter,
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
            Self::Vacuous => "VACUOUS",
        })
    }
}

impl Engine {
    fn title(self) -> &'static str {
        match self {
            Self::Whitstone => "Whitstone",
            Self::Mitsuba => "Mitsuba",
            Self::Embree => "Embree",
            naive => naive.name(),
        }
    }
}

/// Filters engines for a table: Embree, which is optional, appears only if it took part in a
/// family.
fn shown<const N: usize>(engines: [Engine; N], reports: &[FamilyReport]) -> Vec<Engine> {
    let asked = |engine| reports.iter().any(|report| report.takes_part(engine));
    let is_shown = |engine: &Engine| *engine != Engine::Embree || asked(*engine);
    engines.into_iter().filter(is_shown).collect()
}

/// A row of a Markdown table.
fn row(cells: impl IntoIterator<Item = String>) -> String {
    let cells: Vec<String> = cells.into_iter().collect();
    format!("| {} |\n", cells.join(" | "))
}

/// The delimiter row of a Markdown table.
fn rule(columns: usize) -> String {
    format!("|{}\n", "---|".repeat(columns))
}

/// The frontiers of all families as a Markdown table.
pub fn table(reports: &[FamilyReport]) -> String {
    let engines = shown(Engine::ALL, reports);
    let around = |first: [&str; 2], cells: Vec<String>, last: &str| {
        let first = first.map(str::to_owned).into_iter();
        row(first.chain(cells).chain([last.to_owned()]))
    };
    let titles = engines.iter().map(|engine| engine.title().to_owned()).collect();
    let mut text = around(["family", "parameter"], titles, "verdict") + &rule(engines.len() + 3);
    for report in reports {
        let frontiers = engines.iter().map(|engine| report.frontier(*engine)).collect();
        text += &around(
            [&report.family, &report.parameter],
            frontiers,
            &report.verdict.to_string(),
        );
    }
    text
}

/// Frontiers of Whitstone and of the third-party engines, in the families where one of these takes
/// part.
pub fn headline(reports: &[FamilyReport]) -> String {
    let engines = shown([Engine::Whitstone, Engine::Mitsuba, Engine::Embree], reports);
    let after = |first: [String; 2], cells: Vec<String>| row(first.into_iter().chain(cells));
    let titles = engines
        .iter()
        .map(|engine| format!("frontier of {}", engine.title()));
    let first = ["family", "parameter and its range"].map(str::to_owned);
    let mut text = after(first, titles.collect()) + &rule(engines.len() + 2);
    for report in reports {
        let (Some(from), Some(to)) = (report.parameters.first(), report.parameters.last()) else {
            continue;
        };
        if engines[1..].iter().any(|engine| report.takes_part(*engine)) {
            let what = format!("{}: {from:.0e} to {to:.0e}", report.parameter);
            let frontiers = engines.iter().map(|engine| report.frontier(*engine)).collect();
            text += &after([report.family.clone(), what], frontiers);
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A report for engines with these errors at the three steps; all promises are 1.
    fn judged(errors: [(Engine, [f64; 3]); 3]) -> FamilyReport {
        struct Fixed([(Engine, [f64; 3]); 3]);
        impl Family for Fixed {
            fn about(&self) -> About {
                About {
                    name: "fixed",
                    catalogue: &[],
                    parameter: "nothing",
                    measure: "none",
                    promise: "1",
                    pass: 1.0,
                    usable: 10.0,
                }
            }
            fn parameters(&self) -> Vec<f64> {
                vec![1.0, 10.0, 100.0]
            }
            fn step(&self, parameter: f64, _: &Lab<'_>) -> Result<Vec<(Engine, crate::Answer)>, String> {
                let at = parameter.log10().round() as usize;
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
        // A broken promise, even where the answer is still usable.
        let broken = (Whitstone, [0.0, 1.1, 1.0]);
        assert_eq!(
            judged([broken, (Mitsuba, [2.0; 3]), naive]).verdict,
            Verdict::Fails
        );
        // NaN is worse than any number.
        let none = (Whitstone, [0.0, f64::NAN, 0.0]);
        assert_eq!(judged([none, (Mitsuba, [2.0; 3]), naive]).verdict, Verdict::Fails);
        // If nothing fails, the family proves nothing.
        assert_eq!(
            judged([good, (Mitsuba, [2.0; 3]), (NaiveF32, [9.0; 3])]).verdict,
            Verdict::Vacuous
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
        assert!(!svg.contains("embree") && !table(std::slice::from_ref(&report)).contains("Embree"));
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

    #[test]
    fn embree_has_a_column_where_it_takes_part() {
        use Engine::{Embree, NaiveF32, Whitstone};
        let good = (Whitstone, [0.0; 3]);
        let report = judged([good, (Embree, [1.0, 50.0, 50.0]), (NaiveF32, [20.0; 3])]);
        assert_eq!(report.verdict, Verdict::Pass);
        let one = std::slice::from_ref(&report);
        assert_eq!(
            table(one).lines().next(),
            Some("| family | parameter | Whitstone | Mitsuba | Embree | naive f64 | naive f32 | verdict |")
        );
        assert!(table(one).contains("| none | – | 1e1 | – | 1e0 | pass |"));
        assert!(headline(one).contains("| none | – | 1e1 |"));
        assert!(crate::plot::svg(&report).contains("embree (frontier 1e1)"));
    }
}
