//! Results of a family.

use crate::{About, Engine, Family, Lab, Limit, Sample, WORSE};
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
    /// How many of them are right for a slightly different input.
    pub excused: u64,
    /// Largest error in units in the last place of the engine's own format; and the same divided by
    /// the condition number.
    pub own_ulps: Option<[f64; 2]>,
    /// Largest condition number of the questions that hit, if it is measured.
    #[serde(default)]
    pub condition: Option<f64>,
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
    /// The first value beyond the frontier at which it is usable again.
    pub usable_again: Option<f64>,
    /// What limits it at the frontier, if that is known.
    pub limit: Option<Limit>,
    /// All results; empty if it takes no part.
    pub steps: Vec<Step>,
    /// Whether it keeps the promise at every step up to [`About::reach`].
    pub passes: bool,
    /// Why it takes no part.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub absent: Option<String>,
}

/// The result of a family.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// Whitstone keeps the promise, is nowhere much worse than the textbook formula in double
    /// precision, its frontier is at least as far as that of every other engine, and a naive
    /// variant fails.
    Pass,
    /// Whitstone breaks the promise.
    Fails,
    /// At some step Whitstone is much worse than the textbook formula in double precision.
    Worse,
    /// Another engine gets further.
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
    /// The last value at which the promise must hold.
    pub reach: f64,
    /// The first value at which Whitstone is much worse than the textbook formula in double
    /// precision.
    pub worse_at: Option<f64>,
    /// The error message of the last step, if Whitstone refuses its scene.
    pub refusal: Option<String>,
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
        let mut parameters = family.parameters();
        let until = parameters
            .iter()
            .position(|parameter| is_close(*parameter, about.reach));
        let until = until.ok_or_else(|| format!("{}: its reach is not a step", about.name))?;
        let mut engines: Vec<EngineReport> = Vec::new();
        let mut refused = None;
        for (number, parameter) in parameters.iter().enumerate() {
            progress(*parameter);
            let answers = match family.step(*parameter, lab) {
                Ok(answers) => answers,
                // Beyond the reach, a scene may be refused.
                Err(problem) if number > until && !problem.starts_with(UNANSWERED) => {
                    refused = Some((*parameter, problem));
                    break;
                }
                Err(problem) => return Err(format!("{} at {parameter:e}: {problem}", about.name)),
            };
            for (engine, answer) in answers {
                let place = engines.iter().position(|known| known.engine == engine);
                let place = place.unwrap_or_else(|| {
                    engines.push(EngineReport::new(engine));
                    engines.len() - 1
                });
                let report = &mut engines[place];
                match answer {
                    Ok(_) if report.limit == Some(Limit::Refused) => {}
                    Ok(sample) => report.steps.push(Step::new(*parameter, sample, &about)),
                    Err(_) if engine.is_backend() && !report.steps.is_empty() => {
                        report.frontier.get_or_insert(*parameter);
                        report.limit = Some(Limit::Refused);
                    }
                    Err(why) => {
                        report.absent.get_or_insert(why);
                    }
                }
            }
        }
        engines.sort_by_key(|engine| engine.engine);
        for engine in &mut engines {
            engine.conclude(until + 1, &about);
        }
        compare_at_frontiers(&mut engines);
        let ours = engines
            .iter_mut()
            .find(|engine| engine.engine == Engine::Whitstone);
        if let (Some((parameter, _)), Some(ours)) = (&refused, ours) {
            let last = parameters.iter().position(|known| known == parameter);
            parameters.truncate(last.map_or(parameters.len(), |last| last + 1));
            if ours.frontier.is_none() {
                ours.frontier = Some(*parameter);
                ours.limit = Some(Limit::Refused);
            }
        }
        let mut report = Self::judge(&about, parameters, engines, until + 1);
        report.refusal = refused.map(|(_, problem)| problem);
        Ok(report)
    }

    fn judge(about: &About, parameters: Vec<f64>, engines: Vec<EngineReport>, within: usize) -> Self {
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
                .is_some_and(|report| report.usable_steps < within);
        let ours = of(Engine::Whitstone);
        // More digits than anyone's are a yardstick, not a competitor.
        let is_other =
            |report: &&EngineReport| ![Engine::Whitstone, Engine::NaiveDoubleDouble].contains(&report.engine);
        let others = engines.iter().filter(is_other);
        let farthest = others.filter(takes_part).map(|report| report.usable_steps).max();
        let worse_at = ours
            .zip(of(Engine::NaiveF64))
            .and_then(|(ours, textbook)| first_worse(ours, textbook, about.floor));
        let verdict = if !ours.is_some_and(|report| report.passes) {
            Verdict::Fails
        } else if worse_at.is_some() {
            Verdict::Worse
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
            reach: about.reach,
            worse_at,
            refusal: None,
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

    /// The frontier of an engine as text, with its reason if that is known.
    pub fn frontier(&self, engine: Engine) -> String {
        let report = self.engines.iter().find(|report| report.engine == engine);
        let Some(report) = report else {
            return "–".to_owned();
        };
        if report.steps.is_empty() {
            let why = report.absent.as_deref().unwrap_or_default();
            return if why.starts_with(NO_TWIN) {
                "not offered"
            } else {
                "–"
            }
            .to_owned();
        }
        let Some(parameter) = report.frontier else {
            return "none".to_owned();
        };
        let mut text = match report.usable_steps {
            0 => "first step".to_owned(),
            _ => format!("{parameter:.0e}"),
        };
        if let Some(limit) = report.limit {
            text += &format!(" ({})", limit.name());
        }
        if let Some(again) = report.usable_again {
            text += &format!(", usable again at {again:.0e}");
        }
        text
    }
}

/// Compares errors in units in the last place times the condition number where both have them,
/// otherwise in the measure of the promise.
fn is_error_worse(ours: &Step, textbook: &Step, floor: f64) -> bool {
    let (ours, textbook, floor) = match (ours.own_ulps, textbook.own_ulps) {
        (Some([_, ours]), Some([_, textbook])) => (ours, textbook, ULPS),
        _ => (ours.strict, textbook.strict, floor),
    };
    ours > floor && ours > WORSE * textbook
}

/// The accepted error in units in the last place times the condition number.
const ULPS: f64 = 4.0;

/// Finds the reasons of frontiers that are not measured, from the engines that are usable there.
fn compare_at_frontiers(engines: &mut [EngineReport]) {
    let found: Vec<Option<Limit>> = engines.iter().map(|engine| reason(engine, engines)).collect();
    for (engine, found) in engines.iter_mut().zip(found) {
        engine.limit = engine.limit.or(found);
    }
}

/// The reason of an engine's frontier, from the others.
///
/// - An engine of the same or a lower precision is usable: the method.
/// - The textbook formula in a higher precision is: the format.
/// - Whitstone is, which has a higher precision, but the textbook formula in that precision is not:
///   the method.
/// - For the textbook formula in double precision, where Whitstone is unusable, too: its reason.
fn reason(engine: &EngineReport, all: &[EngineReport]) -> Option<Limit> {
    let frontier = engine.frontier?;
    let own = engine.engine.digits();
    let usable: Vec<Engine> = all
        .iter()
        .filter(|other| {
            let mut steps = other.steps.iter();
            steps.any(|step| step.parameter == frontier && step.usable)
        })
        .map(|other| other.engine)
        .collect();
    let takes_part = |engine| {
        let mut all = all.iter();
        all.any(|other| other.engine == engine && !other.steps.is_empty())
    };
    let longer = match own {
        24 => Engine::NaiveF64,
        _ => Engine::NaiveDoubleDouble,
    };
    if engine.engine == Engine::Whitstone {
        None
    } else if usable.iter().any(|other| other.digits() <= own) {
        Some(Limit::Method)
    } else if usable.contains(&longer) {
        Some(Limit::Format)
    } else if usable.contains(&Engine::Whitstone) && takes_part(longer) {
        Some(Limit::Method)
    } else if engine.engine == Engine::NaiveF64 {
        all.iter()
            .find(|other| other.engine == Engine::Whitstone)
            .filter(|ours| !ours.steps.is_empty())
            .and_then(|ours| ours.limit)
            .filter(|limit| *limit != Limit::Refused)
    } else {
        None
    }
}

/// The start of the error of a step without a truth, which says nothing about the engines.
pub(crate) const UNANSWERED: &str = "the oracle cannot answer";

/// The start of the reason why an engine takes no part if it has no such feature.
pub(crate) const NO_TWIN: &str = "no twin";

/// The first step at which Whitstone is much worse than a textbook formula.
fn first_worse(ours: &EngineReport, textbook: &EngineReport, floor: f64) -> Option<f64> {
    let mut pairs = ours.steps.iter().zip(&textbook.steps);
    let is_worse = |(ours, textbook): &(&Step, &Step)| {
        // The errors of answers of the right class only compare if both have as many.
        let wrong = |step: &Step| step.failures + step.nonfinite;
        let as_many = wrong(ours) >= wrong(textbook);
        wrong(ours) - ours.excused > wrong(textbook)
            || ours.nonfinite > textbook.nonfinite
            || as_many && is_error_worse(ours, textbook, floor)
    };
    pairs.find(is_worse).map(|(ours, _)| ours.parameter)
}

impl EngineReport {
    fn new(engine: Engine) -> Self {
        Self {
            engine,
            frontier: None,
            usable_steps: 0,
            usable_again: None,
            limit: None,
            steps: Vec::new(),
            passes: false,
            absent: None,
        }
    }

    /// `within` is the number of steps at which the promise must hold.
    fn conclude(&mut self, within: usize, about: &About) {
        // An engine that cannot take every step takes no part: its frontier would be meaningless.
        if self.absent.is_some() {
            self.steps.clear();
        }
        // The steps up to the reach must be usable, too: an excused answer is not.
        let mut promised = self.steps.iter().take(within);
        self.passes = !self.steps.is_empty() && promised.all(|step| step.passes && step.usable);
        self.usable_steps = self.steps.iter().take_while(|step| step.usable).count();
        let Some(first) = self.steps.get(self.usable_steps) else {
            return;
        };
        self.frontier = Some(first.parameter);
        let again = self.steps[self.usable_steps..].iter().find(|step| step.usable);
        self.usable_again = again.map(|step| step.parameter);
        self.limit = first.limit();
        if self.engine == Engine::Whitstone && self.limit.is_none() {
            self.limit = about.limit;
        }
    }
}

/// Largest error, in units in the last place, of an answer that is as good as its format can hold.
const OF_FORMAT: f64 = 16.0;

impl Step {
    fn new(parameter: f64, sample: Sample, about: &About) -> Self {
        let finite = sample.nonfinite == 0;
        Self {
            parameter,
            excused: sample.excused,
            own_ulps: sample.own_ulps,
            condition: sample.condition,
            error: sample.error,
            strict: sample.strict,
            failures: sample.failures,
            nonfinite: sample.nonfinite,
            ns_per_op: sample.ns_per_op,
            passes: finite && sample.failures == sample.excused && sample.strict <= about.pass,
            usable: finite && sample.failures == 0 && sample.error <= about.usable,
        }
    }

    /// The reason why it is unusable, if it is measured.
    fn limit(&self) -> Option<Limit> {
        let [ulps, by_condition] = self.own_ulps?;
        Some(if self.failures > self.excused || self.nonfinite > 0 {
            Limit::Method
        } else if self.failures == 0 && ulps <= OF_FORMAT {
            Limit::Format
        } else if by_condition <= OF_FORMAT {
            Limit::Condition
        } else {
            Limit::Method
        })
    }
}

impl fmt::Display for Verdict {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Pass => "pass",
            Self::Fails => "FAILS",
            Self::Worse => "WORSE",
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
            Self::MitsubaNotRobust => "Mitsuba, not robust",
            Self::Embree => "Embree",
            Self::EmbreeNotRobust => "Embree, not robust",
            Self::Obvhs => "obvhs",
            Self::NaiveDoubleDouble => "textbook double-double",
            Self::NaiveF64 => "textbook f64",
            Self::NaiveF32 => "textbook f32",
        }
    }
}

/// Filters engines for a table: those that are optional appear only if they took part in a family.
fn shown<const N: usize>(engines: [Engine; N], reports: &[FamilyReport]) -> Vec<Engine> {
    let asked = |engine| reports.iter().any(|report| report.takes_part(engine));
    let is_shown = |engine: &Engine| !engine.is_backend() || asked(*engine);
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
    let engines = shown(
        [
            Engine::Whitstone,
            Engine::Mitsuba,
            Engine::Embree,
            Engine::NaiveDoubleDouble,
            Engine::NaiveF64,
            Engine::NaiveF32,
        ],
        reports,
    );
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

/// Frontiers of all engines, in the families where a third-party one takes part.
pub fn headline(reports: &[FamilyReport]) -> String {
    let third_party = [Engine::Mitsuba, Engine::Embree];
    let engines = shown(
        [
            Engine::Whitstone,
            Engine::NaiveF64,
            Engine::Mitsuba,
            Engine::Embree,
            Engine::NaiveF32,
        ],
        reports,
    );
    let after = |first: [String; 2], cells: Vec<String>| row(first.into_iter().chain(cells));
    let titles = engines.iter().map(|engine| engine.title().to_owned());
    let first = ["family", "parameter and its range"].map(str::to_owned);
    let mut text = after(first, titles.collect()) + &rule(engines.len() + 2);
    for report in reports {
        let (Some(from), Some(to)) = (report.parameters.first(), report.parameters.last()) else {
            continue;
        };
        if third_party.iter().any(|engine| report.takes_part(*engine)) {
            let what = format!("{}: {from:.0e} to {to:.0e}", report.parameter);
            let frontiers = engines.iter().map(|engine| report.frontier(*engine)).collect();
            text += &after([report.family.clone(), what], frontiers);
        }
    }
    text
}

/// Frontiers of the engines that intersect triangles, in the families that have only these; empty
/// if the program includes no backend.
pub fn triangles(reports: &[FamilyReport]) -> String {
    let all = [
        Engine::Whitstone,
        Engine::Mitsuba,
        Engine::MitsubaNotRobust,
        Engine::Embree,
        Engine::EmbreeNotRobust,
        Engine::Obvhs,
    ];
    let engines = shown(all, reports);
    let is_asked = |report: &&FamilyReport| {
        let mut backends = engines.iter().filter(|engine| engine.is_backend());
        backends.any(|engine| report.takes_part(*engine))
    };
    let mut asked = reports.iter().filter(is_asked).peekable();
    if asked.peek().is_none() {
        return String::new();
    }
    let titles = engines.iter().map(|engine| engine.title().to_owned());
    let mut text = row(["family".to_owned()].into_iter().chain(titles)) + &rule(engines.len() + 1);
    for report in asked {
        let frontiers = engines.iter().map(|engine| report.frontier(*engine));
        text += &row([report.family.clone()].into_iter().chain(frontiers));
    }
    text
}

/// Work and precision at the reach of each family whose answers have a condition number: the
/// forward error in units in the last place of each format, and the backward error, which is the
/// forward error over the condition number.
pub fn precision(reports: &[FamilyReport]) -> String {
    let engines = [
        Engine::NaiveF32,
        Engine::NaiveF64,
        Engine::NaiveDoubleDouble,
        Engine::Whitstone,
    ];
    let titles = engines.iter().map(|engine| engine.title().to_owned());
    let first = ["family", "at", "condition"].map(str::to_owned).into_iter();
    let mut text = row(first.chain(titles)) + &rule(engines.len() + 3);
    for report in reports {
        let step = |engine| {
            let found = report.engines.iter().find(|known| known.engine == engine)?;
            let mut steps = found.steps.iter();
            steps.find(|step| is_close(step.parameter, report.reach))
        };
        let Some(condition) = step(Engine::Whitstone).and_then(|step| step.condition) else {
            continue;
        };
        let cells = engines.iter().map(|engine| match step(*engine) {
            Some(step) if step.failures > step.excused || step.nonfinite > 0 => "wrong class".to_owned(),
            Some(Step {
                own_ulps: Some([forward, backward]),
                ..
            }) => format!("{}; {}", ulps(*forward), ulps(*backward)),
            _ => "–".to_owned(),
        });
        let first = [
            report.family.clone(),
            format!("{:.0e}", report.reach),
            ulps(condition),
        ];
        text += &row(first.into_iter().chain(cells));
    }
    text
}

/// A number with two significant digits.
fn ulps(number: f64) -> String {
    match number {
        0.0 => "0".to_owned(),
        small if small < 0.095 => format!("{number:.0e}"),
        small if small < 9.95 => format!("{number:.1}"),
        middle if middle < 1e4 => format!("{number:.0}"),
        _ => format!("{number:.0e}"),
    }
}

/// The price of each method: time per ray of Whitstone and of the textbook formula in each
/// precision, each the median of the steps up to the reach, and the quotient of the first and that
/// in double precision. A family with several shapes has the longest time of them.
pub fn price(reports: &[FamilyReport]) -> String {
    let titles = [
        "family",
        "Whitstone, ns",
        "textbook f64, ns",
        "factor",
        "textbook f32, ns",
        "textbook double-double, ns",
    ];
    let mut text = row(titles.map(str::to_owned)) + &rule(titles.len());
    for report in reports {
        let median = |engine| {
            let found = report.engines.iter().find(|known| known.engine == engine)?;
            let until = report
                .parameters
                .iter()
                .position(|known| is_close(*known, report.reach))?;
            let steps = found.steps.iter().take(until + 1);
            let mut times: Vec<f64> = steps.filter_map(|step| step.ns_per_op).collect();
            times.sort_by(f64::total_cmp);
            times.get(times.len() / 2).copied()
        };
        if let (Some(ours), Some(textbook)) = (median(Engine::Whitstone), median(Engine::NaiveF64)) {
            let written = |ns: f64| format!("{ns:.0}");
            let others = [Engine::NaiveF32, Engine::NaiveDoubleDouble];
            let others = others.map(|engine| median(engine).map_or("–".to_owned(), written));
            let first = [
                report.family.clone(),
                written(ours),
                written(textbook),
                format!("{:.1}", ours / textbook),
            ];
            text += &row(first.into_iter().chain(others));
        }
    }
    text
}

/// Whether a step is the one that a family declares.
pub(crate) fn is_close(parameter: f64, declared: f64) -> bool {
    (parameter / declared - 1.0).abs() < 1e-9
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A report for engines with these errors at the three steps; all promises are 1.
    fn judged(errors: [(Engine, [f64; 3]); 3]) -> FamilyReport {
        judged_up_to(100.0, errors)
    }

    /// The same with a reach.
    fn judged_up_to(reach: f64, errors: [(Engine, [f64; 3]); 3]) -> FamilyReport {
        struct Fixed(f64, [(Engine, [f64; 3]); 3]);
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
                    reach: self.0,
                    floor: 0.1,
                    limit: None,
                }
            }
            fn parameters(&self) -> Vec<f64> {
                vec![1.0, 10.0, 100.0]
            }
            fn step(&self, parameter: f64, _: &Lab<'_>) -> Result<Vec<(Engine, crate::Answer)>, String> {
                let at = parameter.log10().round() as usize;
                Ok(self
                    .1
                    .iter()
                    .map(|(engine, errors)| (*engine, Ok(Sample::new(errors[at]))))
                    .collect())
            }
        }
        let registry = whitstone_core::Registry::default();
        let lab = Lab::new(&registry, None, 1);
        FamilyReport::measure(&Fixed(reach, errors), &lab, &|_| ()).expect("it has no errors")
    }

    #[test]
    fn verdicts() {
        use Engine::{Mitsuba, NaiveF32, Whitstone};
        let (good, naive) = ((Whitstone, [0.0, 0.5, 1.0]), (NaiveF32, [0.0, 20.0, 20.0]));
        let report = judged([good, (Mitsuba, [2.0, 5.0, 50.0]), naive]);
        assert_eq!(report.verdict, Verdict::Pass);
        assert_eq!(report.frontier(Whitstone), "none");
        assert_eq!(report.frontier(Mitsuba), "1e2");
        assert_eq!(report.frontier(NaiveF32), "1e1 (method)");
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
    fn much_worse_than_the_textbook_is_a_failure() {
        use Engine::{NaiveF32, NaiveF64, Whitstone};
        let single = (NaiveF32, [20.0; 3]);
        // 4 times the error of the textbook, or the floor of 0.1.
        let report = judged([(Whitstone, [0.1, 0.4, 0.0]), (NaiveF64, [0.0, 0.1, 0.0]), single]);
        assert_eq!((report.verdict, report.worse_at), (Verdict::Pass, None));
        let report = judged([(Whitstone, [0.0, 0.41, 0.0]), (NaiveF64, [0.0, 0.1, 0.0]), single]);
        assert_eq!((report.verdict, report.worse_at), (Verdict::Worse, Some(10.0)));
        // A textbook that gets further.
        let report = judged([(Whitstone, [0.0, 0.0, 1.0]), (NaiveF64, [0.5; 3]), single]);
        assert_eq!(report.verdict, Verdict::Pass);
    }

    #[test]
    fn frontiers_say_whether_the_curve_is_monotonic() {
        use Engine::{Mitsuba, NaiveF32, Whitstone};
        let report = judged([
            (Whitstone, [0.0; 3]),
            (Mitsuba, [0.0, 20.0, 1.0]),
            (NaiveF32, [20.0; 3]),
        ]);
        assert_eq!(report.frontier(Mitsuba), "1e1, usable again at 1e2");
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
            headline(std::slice::from_ref(&report))
                .contains("| fixed | nothing: 1e0 to 1e2 | none | – | 1e2 | first step (method) |")
        );
        assert!(table(&[report]).contains("| none | 1e2 | – | – | first step (method) | pass |"));
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
            Some(
                "| family | parameter | Whitstone | Mitsuba | Embree | textbook double-double | textbook f64 | textbook f32 | verdict |"
            )
        );
        assert!(table(one).contains("| none | – | 1e1 | – | – | first step (method) | pass |"));
        assert!(headline(one).contains("| none | – | – | 1e1 | first step (method) |"));
        assert!(crate::plot::svg(&report).contains("embree (frontier 1e1)"));
        assert!(triangles(one).contains("| family | Whitstone | Mitsuba | Mitsuba, not robust | Embree |"));
        assert!(triangles(one).contains("| fixed | none | – | – | 1e1 |"));
        let without = judged([good, (Engine::Mitsuba, [1.0; 3]), (NaiveF32, [20.0; 3])]);
        assert_eq!(triangles(&[without]), "");
    }

    #[test]
    fn more_digits_are_no_competitor() {
        use Engine::{NaiveDoubleDouble, NaiveF32, Whitstone};
        let ours = (Whitstone, [0.0, 0.5, 20.0]);
        let naive = (NaiveF32, [20.0; 3]);
        let with = |other| judged_up_to(10.0, [ours, (other, [0.0; 3]), naive]).verdict;
        assert_eq!(with(Engine::Mitsuba), Verdict::Behind);
        assert_eq!(with(NaiveDoubleDouble), Verdict::Pass);
    }

    #[test]
    fn engines_that_are_usable_name_the_reason() {
        use Engine::{Mitsuba, NaiveDoubleDouble, NaiveF32, NaiveF64, Whitstone};
        let ours = (Whitstone, [0.0, 0.5, 1.0]);
        let fails = |engine| (engine, [0.0, 20.0, 20.0]);
        // Neither textbook formula is usable: only Whitstone's method is.
        let report = judged([ours, fails(Mitsuba), fails(NaiveF64)]);
        assert_eq!(report.frontier(NaiveF64), "1e1 (method)");
        assert_eq!(report.frontier(Mitsuba), "1e1 (method)");
        // The same formula with more digits is usable, and nothing with as few.
        let report = judged([(NaiveF64, [0.0; 3]), fails(Mitsuba), fails(NaiveF32)]);
        assert_eq!(report.frontier(Mitsuba), "1e1 (format)");
        assert_eq!(report.frontier(NaiveF32), "1e1 (format)");
        // Another engine with as few digits is usable.
        let report = judged([(NaiveF64, [0.0; 3]), (Mitsuba, [0.0; 3]), fails(NaiveF32)]);
        assert_eq!(report.frontier(NaiveF32), "1e1 (method)");
        // Double precision is too short for both, whatever the method.
        let report = judged([fails(Whitstone), fails(NaiveF64), (NaiveDoubleDouble, [0.0; 3])]);
        assert_eq!(report.frontier(NaiveF64), "1e1 (format)");
        assert_eq!(report.frontier(Whitstone), "1e1");
        // More digits than Whitstone's do not help the textbook.
        let report = judged([ours, fails(NaiveDoubleDouble), fails(NaiveF64)]);
        assert_eq!(report.frontier(NaiveDoubleDouble), "1e1 (method)");
    }

    #[test]
    fn a_backend_that_refuses_a_step_has_its_frontier_there() {
        struct Refuses;
        impl Family for Refuses {
            fn about(&self) -> About {
                About {
                    name: "refuses",
                    catalogue: &[],
                    parameter: "nothing",
                    measure: "none",
                    promise: "1",
                    pass: 1.0,
                    usable: 10.0,
                    reach: 100.0,
                    floor: 0.1,
                    limit: None,
                }
            }
            fn parameters(&self) -> Vec<f64> {
                vec![1.0, 10.0, 100.0]
            }
            fn step(&self, parameter: f64, _: &Lab<'_>) -> Result<Vec<(Engine, crate::Answer)>, String> {
                let large = parameter > 1.0;
                let answer = if large {
                    Err("too large".to_owned())
                } else {
                    Ok(Sample::new(0.5))
                };
                Ok(vec![
                    (Engine::Whitstone, Ok(Sample::new(0.0))),
                    (Engine::Mitsuba, answer.clone()),
                    (Engine::Obvhs, answer),
                ])
            }
        }
        let registry = whitstone_core::Registry::default();
        let lab = Lab::new(&registry, None, 1);
        let report = FamilyReport::measure(&Refuses, &lab, &|_| ()).expect("it has no errors");
        assert_eq!(report.frontier(Engine::Obvhs), "1e1 (refused)");
        // Others take no part, because a frontier by a missing feature would mean nothing.
        assert_eq!(report.frontier(Engine::Mitsuba), "–");
    }
}
