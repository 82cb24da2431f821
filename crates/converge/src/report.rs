//! The results of a study, and the claims that they support.

use crate::cache::Record;
use crate::errors::Measured;
use crate::statistics::{Slope, Times, pareto, time_to};
use crate::study::{Against, Engine, Series, Setting, Study};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::fmt;
use std::path::{Component, Path, PathBuf};

/// An error is claimed only if it is at least this many times the floor of the truth.
pub(crate) const ABOVE_FLOOR: f64 = 2.0;
/// A time is noisy if its interval is wider than this fraction of its median.
const NOISY: f64 = 0.3;
/// A ratio is noisy if its bounds are farther apart than this factor.
const NOISY_RATIO: f64 = 2.0;
/// If other processes used more than this fraction of the processor time, all ratios are noisy: the
/// load affects engines differently.
const OTHERS: f64 = 0.1;

/// One setting of a configuration.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Point {
    /// The setting, such as `sampler.samples_per_axis=4`.
    pub setting: String,
    /// Its value, if it is a number.
    pub value: Option<f64>,
    /// Median wall-clock time of the rendering in seconds; `None` if it failed.
    pub seconds: Option<f64>,
    /// 95 % confidence interval of that median in seconds; with fewer than six repeats, their full
    /// range.
    pub interval: Option<[f64; 2]>,
    /// Width of that interval in seconds.
    pub spread: Option<f64>,
    /// Number of repeats.
    pub repeats: usize,
    /// Whether the times spread too much.
    pub noisy: bool,
    /// Median processor time of all threads in seconds.
    pub cpu_seconds: Option<f64>,
    /// Time to build the scene in seconds.
    pub build_seconds: Option<f64>,
    /// Peak memory of building and rendering in bytes.
    pub memory_bytes: Option<u64>,
    /// Rays traced.
    pub rays: Option<u64>,
    /// Samples per pixel.
    pub samples: Option<u32>,
    /// Number of triangles and other primitives.
    pub primitives: Option<u64>,
    /// Root mean square error over all pixels.
    pub rmse: Option<f64>,
    /// Relative mean square error over all pixels.
    pub relmse: Option<f64>,
    /// Largest absolute error over all pixels.
    pub max: Option<f64>,
    /// All errors, including those of interior pixels.
    pub errors: Option<Measured>,
    /// Whether the error is far enough above the error of the truth to be claimed.
    pub above_floor: bool,
    /// Whether no other point of its engine is both faster and more accurate.
    pub pareto: bool,
    /// The command that renders it again.
    pub command: String,
    /// Why it is missing or incomplete.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub problem: Option<String>,
}

impl Point {
    pub(crate) fn new(setting: &Setting, record: Result<&Record, &String>, command: String) -> Self {
        let known = record.ok();
        let times = known.and_then(|record| Times::of(&record.times));
        let errors = known.map(|record| record.errors);
        let missing = known.filter(|record| !record.is_complete());
        let missing =
            missing.map(|record| format!("only {} of {} repeats", record.times.len(), record.repeats));
        Self {
            setting: setting.label.clone(),
            value: setting.value,
            seconds: times.map(|times| times.median),
            interval: times.map(|times| times.interval),
            spread: times.map(|times| times.spread()),
            repeats: known.map_or(0, |record| record.times.len()),
            noisy: times.is_some_and(|times| times.spread() > NOISY * times.median),
            cpu_seconds: known
                .and_then(|record| Times::of(&record.cpu))
                .map(|times| times.median),
            build_seconds: known.map(|record| record.build_s),
            memory_bytes: known.and_then(|record| record.memory),
            rays: known.map(|record| record.rays).filter(|rays| *rays > 0),
            samples: known.map(|record| record.samples),
            primitives: known.and_then(|record| record.primitives),
            rmse: errors.map(|errors| errors.whole.rmse),
            relmse: errors.map(|errors| errors.whole.relmse),
            max: errors.map(|errors| errors.whole.max),
            errors,
            above_floor: false,
            pareto: false,
            command,
            problem: record.err().cloned().or(missing),
        }
    }

    /// Time and error, if both are known and may be claimed.
    fn claimed(&self) -> Option<[f64; 2]> {
        let whole = self.errors.is_some_and(|errors| errors.finite == 1.0);
        Some([self.seconds?, self.rmse?]).filter(|_| self.above_floor && whole)
    }
}

/// The time at which an error is reached.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub struct Reached {
    /// Interpolated linearly between two points on logarithmic axes.
    pub seconds: f64,
    /// The same, interpolated between the lower and between the upper ends of both intervals.
    pub interval: [f64; 2],
}

/// A configuration over all its settings.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct SeriesReport {
    /// The renderer.
    pub engine: Engine,
    /// The name in the study.
    pub configuration: String,
    /// In the order of the study.
    pub points: Vec<Point>,
    /// Slope of the error against the variable that the study chooses, on logarithmic axes.
    pub slope: Option<f64>,
    /// 95 % confidence interval of the slope.
    pub slope_interval: Option<[f64; 2]>,
    /// The range that the study expects.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub expected_slope: Option<[f64; 2]>,
    /// Times to reach errors that lie between two of its points.
    pub time_to: BTreeMap<String, Reached>,
    /// Why it takes no part.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub absent: Option<String>,
}

impl SeriesReport {
    pub(crate) fn new(
        series: &Series,
        mut points: Vec<Point>,
        floor: f64,
        against: Against,
        absent: Option<&str>,
    ) -> Self {
        for point in &mut points {
            point.above_floor = point.rmse.is_some_and(|rmse| rmse > ABOVE_FLOOR * floor);
        }
        let steps: Vec<[f64; 2]> = points.iter().filter_map(|point| step(point, against)).collect();
        let fit = Slope::fit(&steps);
        Self {
            engine: series.engine,
            configuration: series.name.clone(),
            slope: fit.map(|fit| fit.slope),
            slope_interval: fit.map(|fit| fit.interval),
            expected_slope: series.slope,
            points,
            time_to: BTreeMap::new(),
            absent: absent.map(str::to_owned),
        }
    }

    fn reach(&mut self, level: f64) {
        let points: Vec<&Point> = self
            .points
            .iter()
            .filter(|point| point.claimed().is_some())
            .collect();
        let axes: Vec<[f64; 2]> = points.iter().filter_map(|point| point.claimed()).collect();
        let Some((seconds, between)) = time_to(&axes, level) else {
            return;
        };
        // The same interpolation weight, with other times at both ends.
        let at = |which: usize| {
            let ends =
                between.map(|index| [points[index].interval.unwrap_or_default()[which], axes[index][1]]);
            if between[0] == between[1] {
                return ends[0][0];
            }
            let part = (ends[0][1] / level).ln() / (ends[0][1] / ends[1][1]).ln();
            ends[0][0] * (ends[1][0] / ends[0][0]).powf(part)
        };
        let interval = [at(0), at(1)];
        self.time_to
            .insert(level_name(level), Reached { seconds, interval });
    }

    fn name(&self) -> String {
        format!("{} ({})", self.configuration, self.engine.name())
    }
}

/// The coordinates for the slope fit.
fn step(point: &Point, against: Against) -> Option<[f64; 2]> {
    let x = match against {
        Against::Samples => f64::from(point.samples?),
        Against::Rays => point.rays? as f64,
        Against::Primitives => point.primitives? as f64,
        Against::Value => point.value?,
    };
    let rmse = point
        .rmse
        .filter(|_| point.above_floor && point.errors.is_none_or(|errors| errors.finite == 1.0))?;
    (x > 0.0 && rmse > 0.0).then_some([x, rmse])
}

/// The key of an error level, such as `1e-2`.
pub fn level_name(level: f64) -> String {
    format!("{level:e}")
}

/// The times of both engines to reach an error, each with its best configuration.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct TimeTo {
    /// The error.
    pub error: f64,
    /// Whitstone's time in seconds.
    pub whitstone_s: Option<f64>,
    /// Whitstone's configuration.
    pub whitstone: Option<String>,
    /// Mitsuba's time in seconds.
    pub mitsuba_s: Option<f64>,
    /// Mitsuba's configuration.
    pub mitsuba: Option<String>,
    /// Whitstone's time over Mitsuba's.
    pub ratio: Option<f64>,
    /// The conservative bounds: interval ends instead of medians, in the worst combination.
    pub ratio_interval: Option<[f64; 2]>,
    /// Whether these bounds are too far apart.
    pub noisy: bool,
}

/// The result of a study.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// All expectations hold.
    Pass,
    /// An expectation does not hold.
    Fails,
    /// Some settings could not be measured; another run continues from there.
    Incomplete,
    /// The truth is not accurate enough for any claim.
    Withheld,
}

impl fmt::Display for Verdict {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(match self {
            Self::Pass => "pass",
            Self::Fails => "FAILS",
            Self::Incomplete => "INCOMPLETE",
            Self::Withheld => "WITHHELD",
        })
    }
}

/// The truth: the rendering that errors are measured against.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct TruthReport {
    /// The renderer.
    pub engine: Engine,
    /// Its changes of the scene.
    pub configuration: String,
    /// Whether each series has its own truth.
    pub of_series: bool,
    /// Other renderings of the truth; the floor is the largest distance to them.
    pub checks: Vec<String>,
    /// The command that measures the study again.
    pub command: String,
}

/// A study with its claims.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct StudyReport {
    /// Its name.
    pub study: String,
    /// The title, one line.
    pub title: String,
    /// The purpose of the study.
    pub about: String,
    /// The scene that is changed.
    pub scene: String,
    /// The truth.
    pub truth: TruthReport,
    /// Error of the truth itself: nothing below it is claimed.
    pub floor_rmse: f64,
    /// The variable of the slopes.
    pub against: Against,
    /// The name of the error measure.
    pub measure: String,
    /// The name of the swept value, if slopes are taken against it.
    pub parameter: String,
    /// All measurements.
    pub series: Vec<SeriesReport>,
    /// By error level, such as `1e-2`.
    pub time_to: BTreeMap<String, TimeTo>,
    /// Whether the times spread too much: for one of the ratios or, if there are none, for most of
    /// the points.
    pub noisy: bool,
    /// Fraction of the processor time that other processes used during the timing, if the system
    /// reports it.
    #[serde(default)]
    pub others: Option<f64>,
    /// The overall result.
    pub verdict: Verdict,
    /// Expectations that do not hold, and failed measurements.
    pub problems: Vec<String>,
    /// Claims that are withheld, with the reasons.
    pub withheld: Vec<String>,
    /// Whether this is the quick version.
    pub quick: bool,
}

impl StudyReport {
    pub(crate) fn new(
        study: &Study,
        truth: TruthReport,
        floor: f64,
        mut series: Vec<SeriesReport>,
        mut notes: Vec<String>,
        others: Option<f64>,
    ) -> Self {
        for level in &study.levels {
            series.iter_mut().for_each(|series| series.reach(*level));
        }
        mark_fronts(&mut series);
        let mut time_to: BTreeMap<String, TimeTo> = study
            .levels
            .iter()
            .map(|level| (level_name(*level), best(&series, *level)))
            .collect();
        if let Some(part) = others.filter(|part| *part > OTHERS) {
            notes.push(format!(
                "no ratio of times: other processes used {:.0}% of the processor time",
                100.0 * part
            ));
            for both in time_to.values_mut() {
                both.noisy = both.ratio.is_some();
            }
        }
        let compared: Vec<&TimeTo> = time_to.values().filter(|both| both.ratio.is_some()).collect();
        let points: Vec<&Point> = series.iter().flat_map(|series| &series.points).collect();
        let noisy = match compared.is_empty() {
            true => 2 * points.iter().filter(|point| point.noisy).count() > points.len(),
            false => compared.iter().any(|both| both.noisy),
        };
        let mut report = Self {
            study: study.name.clone(),
            title: study.title.clone(),
            about: study.about.clone(),
            scene: plain_path(&study.scene_path),
            truth,
            floor_rmse: floor,
            against: study.against,
            measure: "RMSE".to_owned(),
            parameter: study.against.name().to_owned(),
            time_to,
            noisy,
            others,
            verdict: Verdict::Pass,
            problems: Vec::new(),
            withheld: notes,
            quick: study.quick,
            series,
        };
        report.withhold();
        let fails = report.expectations(study);
        let partial = report.partial();
        report.verdict = if !fails.is_empty() {
            Verdict::Fails
        } else if !partial.is_empty() {
            Verdict::Incomplete
        } else if report.nothing_to_claim() {
            Verdict::Withheld
        } else {
            Verdict::Pass
        };
        report.problems = [fails, partial].concat();
        report
    }

    /// The error levels with the times to reach them, the largest error first.
    pub fn levels(&self) -> Vec<(&str, &TimeTo)> {
        let mut levels: Vec<(&str, &TimeTo)> =
            self.time_to.iter().map(|(name, both)| (&**name, both)).collect();
        levels.sort_by(|a, b| b.1.error.total_cmp(&a.1.error));
        levels
    }

    /// The setting of Whitstone that needs the least processor time for an error of at most
    /// `error`, with its configuration. The error of the truth is added, since it may hide as much.
    pub fn cheapest(&self, error: f64) -> Option<(&SeriesReport, &Point)> {
        let ours = self
            .series
            .iter()
            .filter(|series| series.engine == Engine::Whitstone);
        let points = ours.flat_map(|series| series.points.iter().map(move |point| (series, point)));
        let good = points.filter_map(|(series, point)| {
            let whole = point.errors.is_some_and(|errors| errors.finite == 1.0);
            let reached = whole && point.rmse? + self.floor_rmse <= error;
            reached.then_some((point.cpu_seconds.or(point.seconds)?, series, point))
        });
        good.min_by(|a, b| a.0.total_cmp(&b.0))
            .map(|(_, series, point)| (series, point))
    }

    fn measured(&self) -> impl Iterator<Item = &Point> {
        self.series
            .iter()
            .flat_map(|series| &series.points)
            .filter(|point| point.rmse.is_some())
    }

    fn nothing_to_claim(&self) -> bool {
        self.measured().count() > 0 && !self.measured().any(|point| point.above_floor)
    }

    /// Records the claims that the floor rules out.
    fn withhold(&mut self) {
        let mut told = Vec::new();
        for series in &self.series {
            let points = || series.points.iter().filter(|point| point.rmse.is_some());
            let below: Vec<&str> = points()
                .filter(|point| !point.above_floor)
                .map(|point| &*point.setting)
                .collect();
            let all = points().count();
            if below.is_empty() {
                continue;
            }
            let floor = self.floor_rmse;
            told.push(if below.len() == all {
                format!(
                    "{}: the truth has not converged: its own error, {floor:.1e}, is not well below any of the errors here",
                    series.name()
                )
            } else {
                format!("{}: no claim about {}: within {ABOVE_FLOOR} times the truth's own error, {floor:.1e}", series.name(), below.join(", "))
            });
        }
        self.withheld.extend(told);
    }

    /// Failed and incomplete measurements.
    fn partial(&self) -> Vec<String> {
        let mut told = Vec::new();
        for series in &self.series {
            for point in &series.points {
                if let Some(problem) = &point.problem {
                    told.push(format!("{}, {}: {problem}", series.name(), point.setting));
                }
                if let Some(errors) = point.errors.filter(|errors| errors.finite < 1.0) {
                    let part = 100.0 * (1.0 - errors.finite);
                    told.push(format!(
                        "{}, {}: {part:.3}% of the pixels are not finite",
                        series.name(),
                        point.setting
                    ));
                }
            }
        }
        told
    }

    /// Expectations that do not hold.
    fn expectations(&self, study: &Study) -> Vec<String> {
        let mut fails = Vec::new();
        for series in self.series.iter().filter(|series| series.absent.is_none()) {
            let Some([least, most]) = series.expected_slope else {
                continue;
            };
            match series.slope {
                Some(slope) if (least..=most).contains(&slope) => {}
                Some(slope) => fails.push(format!(
                    "{}: the slope is {slope:.3}, expected {least} to {most}",
                    series.name()
                )),
                None => fails.push(format!("{}: no slope, expected {least} to {most}", series.name())),
            }
        }
        for [steeper, flatter] in &study.expect.steeper {
            for engine in Engine::RENDERERS {
                let of = |name: &str| {
                    let mut all = self.series.iter().filter(|series| series.engine == engine);
                    all.find(|series| series.configuration == name && series.absent.is_none())
                };
                let (Some(a), Some(b)) = (of(steeper), of(flatter)) else {
                    continue;
                };
                let apart = a
                    .slope_interval
                    .zip(b.slope_interval)
                    .is_some_and(|(a, b)| a[1] < b[0]);
                if !apart {
                    fails.push(format!(
                        "{} does not fall faster than {}: slopes {} and {}",
                        a.name(),
                        b.name(),
                        interval(a),
                        interval(b)
                    ));
                }
            }
        }
        for [smaller, greater] in &study.expect.smaller {
            fails.extend(self.not_smaller(smaller, greater));
        }
        if study.expect.same_error {
            fails.extend(self.unequal());
        }
        for level in &study.expect.reached {
            let name = level_name(*level);
            if self
                .time_to
                .get(&name)
                .is_none_or(|both| both.whitstone_s.is_none())
            {
                fails.push(format!(
                    "whitstone does not reach an error of {name} between two settings"
                ));
            }
        }
        fails
    }

    /// Settings at which the first series does not have the smaller error, or a message that the
    /// two have no setting in common.
    fn not_smaller(&self, smaller: &str, greater: &str) -> Vec<String> {
        let (mut fails, mut compared) = (Vec::new(), 0);
        for engine in Engine::RENDERERS {
            let of = |name: &str| {
                let mut all = self.series.iter().filter(|series| series.engine == engine);
                all.find(|series| series.configuration == name && series.absent.is_none())
            };
            let (Some(a), Some(b)) = (of(smaller), of(greater)) else {
                continue;
            };
            for (point, other) in a.points.iter().flat_map(|point| {
                let others = b.points.iter().filter(|other| other.setting == point.setting);
                others.map(move |other| (point, other))
            }) {
                compared += 1;
                if !(point.rmse < other.rmse && point.rmse.is_some()) {
                    fails.push(format!(
                        "{}, {}: the error is not below that of {}",
                        a.name(),
                        point.setting,
                        b.name()
                    ));
                }
            }
        }
        if compared == 0 {
            fails.push(format!("{smaller} and {greater} have no setting in common"));
        }
        fails
    }

    /// Series whose errors differ from those of the first series of their engine.
    fn unequal(&self) -> Vec<String> {
        let mut fails = Vec::new();
        for engine in Engine::RENDERERS {
            let mut of = self
                .series
                .iter()
                .filter(|series| series.engine == engine && series.absent.is_none());
            let Some(first) = of.next() else { continue };
            for series in of {
                for (a, b) in first.points.iter().zip(&series.points) {
                    if a.rmse.map(f64::to_bits) != b.rmse.map(f64::to_bits) {
                        fails.push(format!(
                            "{} and {} differ in the error at {}: {} and {}",
                            first.name(),
                            series.name(),
                            b.setting,
                            optional(a.rmse),
                            optional(b.rmse)
                        ));
                    }
                }
            }
        }
        fails
    }
}

/// The path without components that enter a folder and leave it again.
fn plain_path(path: &Path) -> String {
    let mut parts: Vec<Component<'_>> = Vec::new();
    for part in path.components() {
        match (part, parts.last()) {
            (Component::ParentDir, Some(Component::Normal(_))) => drop(parts.pop()),
            _ => parts.push(part),
        }
    }
    let plain: PathBuf = parts.into_iter().collect();
    plain.display().to_string().replace('\\', "/")
}

/// Formats a number for people.
pub(crate) fn optional(value: Option<f64>) -> String {
    value.map_or_else(|| "–".to_owned(), |value| format!("{value:.2e}"))
}

/// Formats a slope with its interval for people.
pub(crate) fn interval(series: &SeriesReport) -> String {
    match (series.slope, series.slope_interval) {
        (Some(slope), Some([least, most])) => format!("{slope:.2} ({least:.2} to {most:.2})"),
        _ => "–".to_owned(),
    }
}

/// Marks the Pareto-optimal points of each engine.
fn mark_fronts(series: &mut [SeriesReport]) {
    for engine in Engine::RENDERERS {
        let mut places = Vec::new();
        let mut axes = Vec::new();
        for (number, of) in series.iter().enumerate().filter(|(_, of)| of.engine == engine) {
            for (index, point) in of.points.iter().enumerate() {
                if let Some(claimed) = point.claimed() {
                    places.push((number, index));
                    axes.push(claimed);
                }
            }
        }
        for index in pareto(&axes) {
            let (number, point) = places[index];
            series[number].points[point].pareto = true;
        }
    }
}

fn best(series: &[SeriesReport], error: f64) -> TimeTo {
    let level = &level_name(error);
    let of = |engines: &[Engine]| {
        let all = series.iter().filter(|series| engines.contains(&series.engine));
        let reached = all.filter_map(|series| Some((series, series.time_to.get(level)?)));
        reached.min_by(|a, b| a.1.seconds.total_cmp(&b.1.seconds))
    };
    let ours = of(&[Engine::Whitstone]);
    let theirs = of(&[Engine::Mitsuba, Engine::StockMitsuba]);
    let name = |found: Option<(&SeriesReport, &Reached)>| {
        found.map(|(series, _)| match series.engine {
            Engine::StockMitsuba => format!("{}, stock", series.configuration),
            _ => series.configuration.clone(),
        })
    };
    let seconds = |found: Option<(&SeriesReport, &Reached)>| found.map(|(_, reached)| reached.seconds);
    let both = ours.zip(theirs).map(|((_, ours), (_, theirs))| {
        let bounds = [
            ours.interval[0] / theirs.interval[1],
            ours.interval[1] / theirs.interval[0],
        ];
        (ours.seconds / theirs.seconds, bounds)
    });
    TimeTo {
        error,
        whitstone_s: seconds(ours),
        whitstone: name(ours),
        mitsuba_s: seconds(theirs),
        mitsuba: name(theirs),
        ratio: both.map(|(ratio, _)| ratio),
        ratio_interval: both.map(|(_, bounds)| bounds),
        noisy: both.is_some_and(|(_, [least, most])| (most / least).is_nan() || most / least > NOISY_RATIO),
    }
}
