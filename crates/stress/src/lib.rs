//! Robustness suite: sweeps a parameter logarithmically to find where a renderer's answers become
//! unusable. The oracle judges every answer.
//!
//! A *family* is a file in `families`; [`FAMILIES`] lists them. At each value of its
//! parameter, a family gives the same queries to every engine that supports them. It compares the
//! answers with a truth that none of them computed: the arbitrary-precision oracle, or a closed
//! form.
//!
//! There are two error levels. An answer *passes* if it keeps Whitstone's promise, which is close
//! to the rounding error of double precision. An answer is *usable* up to an error bound that is
//! the same for every engine. That bound is so coarse that single precision meets it in easy cases.
//! The *frontier* of an engine is the first step at which its answers are unusable. Without the
//! second level, every single-precision engine would fail at the first step, and frontiers would be
//! meaningless.
//!
//! Each family also runs naive variants ([`whitstone_oracle::naive`]), which are expected to fail.
//! If none of them fails, the family proves nothing and is reported as vacuous.
//!
//! [`search`] hunts for values and rays between the steps for which the promise is broken.

pub mod families;
mod kernel;
mod lab;
pub mod plot;
mod rays;
mod report;
pub mod search;
mod single;
mod subject;
mod view;

pub use families::{ELSEWHERE, FAMILIES};
pub use kernel::{KernelReport, judge_kernel};
pub use lab::Lab;
pub use report::{EngineReport, FamilyReport, Step, Verdict, headline, precision, price, table, triangles};
pub use subject::{Pixels, SubjectReport, SubjectRuns, SubjectStep, judge_subject};

use serde::{Deserialize, Serialize};
use whitstone_core::Ray;
use whitstone_testkit::Random;

/// A renderer or library under test.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
pub enum Engine {
    /// Whitstone's plugins, as a scene uses them.
    #[serde(rename = "whitstone")]
    Whitstone,
    /// Mitsuba's own functions, in single precision, with robust intersections.
    #[serde(rename = "mitsuba")]
    Mitsuba,
    /// The same without robust intersections, which is Mitsuba's default.
    #[serde(rename = "mitsuba not robust")]
    MitsubaNotRobust,
    /// Embree on the same triangles, in single precision, inside Whitstone, with its robust flag;
    /// only if the program was built with it.
    #[serde(rename = "embree")]
    Embree,
    /// The same without its robust flag.
    #[serde(rename = "embree not robust")]
    EmbreeNotRobust,
    /// The crate obvhs on the same triangles, in single precision, inside Whitstone; only if the
    /// program was built with it.
    #[serde(rename = "obvhs")]
    Obvhs,
    /// Textbook formulas with numbers of 106 bits, whose results are rounded to double precision: a
    /// yardstick, which is too slow for pictures.
    #[serde(rename = "naive double-double")]
    NaiveDoubleDouble,
    /// Textbook formulas in double precision.
    #[serde(rename = "naive f64")]
    NaiveF64,
    /// Textbook formulas in single precision.
    #[serde(rename = "naive f32")]
    NaiveF32,
}

impl Engine {
    /// All engines, in the order of tables.
    pub const ALL: [Self; 9] = [
        Self::Whitstone,
        Self::Mitsuba,
        Self::MitsubaNotRobust,
        Self::Embree,
        Self::EmbreeNotRobust,
        Self::Obvhs,
        Self::NaiveDoubleDouble,
        Self::NaiveF64,
        Self::NaiveF32,
    ];

    /// Whether it is a backend, which a program may lack, and which may refuse a scene: its
    /// frontier is then there.
    pub fn is_backend(self) -> bool {
        matches!(self, Self::Embree | Self::EmbreeNotRobust | Self::Obvhs)
    }

    /// Binary digits of the significand of its numbers.
    fn digits(self) -> u32 {
        match self {
            Self::Mitsuba
            | Self::MitsubaNotRobust
            | Self::Embree
            | Self::EmbreeNotRobust
            | Self::Obvhs
            | Self::NaiveF32 => 24,
            Self::Whitstone | Self::NaiveF64 => 53,
            Self::NaiveDoubleDouble => 106,
        }
    }

    /// The name for people.
    pub fn name(self) -> &'static str {
        match self {
            Self::Whitstone => "whitstone",
            Self::Mitsuba => "mitsuba",
            Self::MitsubaNotRobust => "mitsuba not robust",
            Self::Embree => "embree",
            Self::EmbreeNotRobust => "embree not robust",
            Self::Obvhs => "obvhs",
            Self::NaiveDoubleDouble => "naive double-double",
            Self::NaiveF64 => "naive f64",
            Self::NaiveF32 => "naive f32",
        }
    }
}

/// Description of a family.
#[derive(Clone, Copy, Debug)]
pub struct About {
    /// The name on the command line.
    pub name: &'static str,
    /// Numbers of its cases in the catalogue of known numerical hazards: each number is here, or in
    /// [`ELSEWHERE`].
    pub catalogue: &'static [u32],
    /// The parameter that is swept, with its unit.
    pub parameter: &'static str,
    /// The definition of `error`.
    pub measure: &'static str,
    /// Whitstone's promise, the largest accepted strict error, as text.
    pub promise: &'static str,
    /// The promise as a number.
    pub pass: f64,
    /// Largest error that is usable, the same for all engines.
    pub usable: f64,
    /// The last value of the parameter at which the promise must hold. Later steps only measure
    /// where Whitstone itself becomes unusable.
    pub reach: f64,
    /// 4 units in the last place times the condition number, in the measure of the promise. At
    /// every step, an error above it must be at most [`WORSE`] times the error of the textbook
    /// formula in double precision.
    pub floor: f64,
    /// What limits Whitstone at its frontier, if the steps do not measure it.
    pub limit: Option<Limit>,
}

/// See [`About::floor`].
pub const WORSE: f64 = 4.0;

/// The reason why an engine becomes unusable.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Limit {
    /// Its numbers are too coarse: the answers are as good as their format can hold, or a higher
    /// precision alone makes the textbook formula usable.
    Format,
    /// The question is ill-conditioned: the answers are right for an input that differs by a few
    /// roundings.
    Condition,
    /// Its method loses digits, or another engine of the same or a lower precision is usable.
    Method,
    /// The scene is refused with an error message.
    Refused,
}

impl Limit {
    /// The word in tables.
    pub fn name(self) -> &'static str {
        match self {
            Self::Format => "format",
            Self::Condition => "condition",
            Self::Method => "method",
            Self::Refused => "refused",
        }
    }
}

/// Errors of one engine at one step.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Sample {
    /// Largest error, in the family's measure, over answers of the right class.
    pub error: f64,
    /// Largest error, in the measure of the promise. Equal to `error` if the family has only one
    /// measure.
    pub strict: f64,
    /// Answers of the wrong class: a hit instead of a miss, or a wrong count.
    pub failures: u64,
    /// How many of them are right for an input that differs by 16 units in the last place of the
    /// engine's format. They are unusable, but break no promise.
    pub excused: u64,
    /// Largest error of the others, in units in the last place of the engine's own format; and the
    /// same divided by the condition number. `None` if it is not measured.
    pub own_ulps: Option<[f64; 2]>,
    /// Largest condition number of the questions that hit, if it is measured.
    pub condition: Option<f64>,
    /// Answers that are infinite or NaN.
    pub nonfinite: u64,
    /// Nanoseconds per operation, if it was timed.
    pub ns_per_op: Option<f64>,
}

impl Sample {
    /// A sample with this error in both measures.
    pub fn new(error: f64) -> Self {
        let mut sample = Self::default();
        sample.add(error);
        sample
    }

    /// Adds an error to both measures; one that is not finite is only counted.
    pub fn add(&mut self, error: f64) {
        if error.is_finite() {
            self.error = self.error.max(error);
            self.strict = self.strict.max(error);
        } else {
            self.nonfinite += 1;
        }
    }

    /// Merges another sample; keeps the longer of both times.
    pub fn join(&mut self, other: &Self) {
        self.error = self.error.max(other.error);
        self.strict = self.strict.max(other.strict);
        self.failures += other.failures;
        self.excused += other.excused;
        self.own_ulps = match (self.own_ulps, other.own_ulps) {
            (Some([a, b]), Some([c, d])) => Some([a.max(c), b.max(d)]),
            (one, other) => one.or(other),
        };
        self.nonfinite += other.nonfinite;
        let larger = |one: Option<f64>, other| one.into_iter().chain(other).reduce(f64::max);
        self.condition = larger(self.condition, other.condition);
        self.ns_per_op = larger(self.ns_per_op, other.ns_per_op);
    }
}

/// The errors of an engine, or the reason why it takes no part.
pub type Answer = Result<Sample, String>;

/// A family of test cases.
pub trait Family: Sync {
    /// Its description.
    fn about(&self) -> About;

    /// Values of the parameter, from easy to hard.
    fn parameters(&self) -> Vec<f64>;

    /// Queries every engine at one value of the parameter.
    ///
    /// # Errors
    ///
    /// If the case cannot be built, which is a bug of the family or of a plugin.
    fn step(&self, parameter: f64, lab: &Lab<'_>) -> Result<Vec<(Engine, Answer)>, String>;

    /// A scene whose image shows the hazard, for renderers that only give images: with a camera and
    /// few pixels, and with files relative to the folder `scenes`.
    ///
    /// # Errors
    ///
    /// Why there is none.
    fn view(&self, parameter: f64, lab: &Lab<'_>) -> Result<String, String> {
        let _ = (parameter, lab);
        Err("its answers are numbers that no image shows".to_owned())
    }

    /// Whether values of the parameter between the steps make sense: the search draws them, too.
    fn is_continuous(&self) -> bool {
        true
    }

    /// Draws a ray for the search; `None` if the family traces no single rays, or if the numbers
    /// give no ray.
    fn draw(&self, parameter: f64, random: &mut Random) -> Option<Ray> {
        let _ = (parameter, random);
        None
    }

    /// Judges Whitstone's answers for these rays, one by one. A family that traces no single rays
    /// runs its step, and judges it as one.
    ///
    /// # Errors
    ///
    /// As [`Self::step`].
    fn judge_rays(&self, parameter: f64, rays: &[Ray], lab: &Lab<'_>) -> Result<Vec<Judged>, String> {
        let _ = rays;
        let answers = self.step(parameter, lab)?;
        let ours = answers
            .into_iter()
            .find(|(engine, _)| *engine == Engine::Whitstone);
        let sample = ours.ok_or("Whitstone takes no part")?.1?;
        Ok(vec![Judged::new(&sample, self.about().pass)])
    }
}

/// How well Whitstone keeps its promise, for one ray or one step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Judged {
    /// The error over the promised one; infinite if the promise allows no error.
    pub share: f64,
    /// Wrong classes, and answers that are infinite or NaN.
    pub wrong: u64,
}

impl Judged {
    /// From the answers to a step, with the promised error.
    fn new(sample: &Sample, pass: f64) -> Self {
        let share = match sample.strict {
            0.0 => 0.0,
            strict => strict / pass,
        };
        Self {
            share,
            wrong: sample.failures - sample.excused + sample.nonfinite,
        }
    }
}

/// Powers of ten from `10^first` to `10^last`, both included.
fn decades(first: i32, last: i32) -> Vec<f64> {
    let step = if first <= last { 1 } else { -1 };
    (0..=(last - first).abs())
        .map(|number| format!("1e{}", first + step * number).parse().unwrap_or(f64::NAN))
        .collect()
}
