//! Families of stiff and extreme cases: a knob is turned over decades, and everyone's error is
//! judged by the oracle.
//!
//! Every family is a file in `families`; [`FAMILIES`] lists them. At each step of its knob a family
//! asks every engine that can take part the same questions and holds the answers to a truth that
//! none of them computed: the oracle's many digits, or a closed form. There are two levels. What
//! *passes* is what Whitstone promises, near the rounding of double precision. What is *usable* is
//! the same for every engine, and so coarse that single precision has it where the case is easy:
//! the *frontier* of an engine is the first step at which it is not usable any more. Without the
//! second level, everything in single precision would break at the first step, and frontiers would
//! tell nothing.
//!
//! Each family also runs deliberately naive variants ([`whitstone_oracle::naive`]); where none of
//! them fails, the family proves nothing and is itself reported as toothless.

pub mod families;
mod lab;
pub mod plot;
mod rays;
mod report;

pub use families::{ELSEWHERE, FAMILIES};
pub use lab::Lab;
pub use report::{EngineReport, FamilyReport, Step, Verdict, headline, table};

use serde::{Deserialize, Serialize};

/// Who answers.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
pub enum Engine {
    /// The plugins, as a scene uses them.
    #[serde(rename = "whitstone")]
    Whitstone,
    /// Mitsuba's own functions, in single precision.
    #[serde(rename = "mitsuba")]
    Mitsuba,
    /// Embree over the same triangles, in single precision, where the program has it; all around it
    /// is Whitstone.
    #[serde(rename = "embree")]
    Embree,
    /// The textbook's, in double precision.
    #[serde(rename = "naive f64")]
    NaiveF64,
    /// The textbook's, in single precision.
    #[serde(rename = "naive f32")]
    NaiveF32,
}

impl Engine {
    /// Everyone, in the order of tables.
    pub const ALL: [Self; 5] = [
        Self::Whitstone,
        Self::Mitsuba,
        Self::Embree,
        Self::NaiveF64,
        Self::NaiveF32,
    ];

    /// As people read it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Whitstone => "whitstone",
            Self::Mitsuba => "mitsuba",
            Self::Embree => "embree",
            Self::NaiveF64 => "naive f64",
            Self::NaiveF32 => "naive f32",
        }
    }
}

/// What a family is about.
#[derive(Clone, Copy, Debug)]
pub struct About {
    /// As it is called on the command line.
    pub name: &'static str,
    /// Its numbers in the catalogue of `docs/stability.md`.
    pub catalogue: &'static [u32],
    /// What is turned, with its unit.
    pub knob: &'static str,
    /// What `error` is.
    pub measure: &'static str,
    /// What Whitstone promises: the largest strict error, in words.
    pub promise: &'static str,
    /// The same as a number.
    pub pass: f64,
    /// Largest error that is of use, the same for all engines.
    pub usable: f64,
}

/// What one engine made of one step.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Sample {
    /// Largest error, in the family's measure; of answers with the right class.
    pub error: f64,
    /// Largest error in the measure of the promise; the same where the family has one measure.
    pub strict: f64,
    /// Answers of the wrong class: a hit instead of a miss, another count.
    pub failures: u64,
    /// Answers that are not numbers.
    pub nonfinite: u64,
    /// Nanoseconds for each operation, where it was timed.
    pub ns_per_op: Option<f64>,
}

impl Sample {
    /// Of one measure.
    pub fn new(error: f64) -> Self {
        let mut sample = Self::default();
        sample.add(error);
        sample
    }

    /// One more error.
    pub fn add(&mut self, error: f64) {
        if error.is_finite() {
            self.error = self.error.max(error);
            self.strict = self.strict.max(error);
        } else {
            self.nonfinite += 1;
        }
    }

    /// All of another one's answers too; of two times the longer one.
    pub fn join(&mut self, other: &Self) {
        self.error = self.error.max(other.error);
        self.strict = self.strict.max(other.strict);
        self.failures += other.failures;
        self.nonfinite += other.nonfinite;
        self.ns_per_op = [self.ns_per_op, other.ns_per_op]
            .into_iter()
            .flatten()
            .reduce(f64::max);
    }
}

/// Why an engine takes no part, or what it answered.
pub type Answer = Result<Sample, String>;

/// A family of cases.
pub trait Family: Sync {
    /// What it is about.
    fn about(&self) -> About;

    /// The values of the knob, from the easy to the stiff.
    fn knobs(&self) -> Vec<f64>;

    /// Asks everyone.
    ///
    /// # Errors
    ///
    /// If the case cannot be built, which is a fault of the family or of a plugin.
    fn step(&self, knob: f64, lab: &Lab<'_>) -> Result<Vec<(Engine, Answer)>, String>;
}

/// Powers of ten from `first` to `last`, both included.
fn decades(first: i32, last: i32) -> Vec<f64> {
    let step = if first <= last { 1 } else { -1 };
    (0..=(last - first).abs())
        .map(|number| format!("1e{}", first + step * number).parse().unwrap_or(f64::NAN))
        .collect()
}
