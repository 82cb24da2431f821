//! When the oracle is queried, and its verdicts.

use serde::{Deserialize, Serialize};
use std::fmt;
use std::time::Duration;

/// Maximum number of pixels of a scene that are queried; of more, an even selection.
pub const MAX_ASKED: usize = 200;

/// When the oracle is queried, and for how long.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct OraclePolicy {
    /// Which pixels are queried.
    pub when: Ask,
    /// Wall time limit for one scene.
    pub budget: Duration,
}

impl Default for OraclePolicy {
    fn default() -> Self {
        Self {
            when: Ask::Needed,
            budget: Duration::from_secs(60),
        }
    }
}

/// Which pixels the oracle is queried about.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Ask {
    /// None. Then it stays undecided whether the reference is wrong.
    Never,
    /// Those on which the verdict depends.
    #[default]
    Needed,
    /// All pixels over tolerance, including the explained ones.
    Always,
}

/// The oracle's verdict on a pixel.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// Only ours is within tolerance of the oracle's value.
    Ours,
    /// Only the reference is within tolerance.
    Reference,
    /// Both are within tolerance: they lie on different sides of the oracle's value.
    Both,
    /// Neither is within tolerance.
    Neither,
    /// The pixel is ill-posed: tiny changes of the inputs change it by more than the tolerance, and
    /// ours is one of the values that it takes.
    IllPosed,
    /// The oracle has no value, or an uncertain one that does not decide.
    Unknown,
}

impl fmt::Display for Verdict {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Ours => "ours is right",
            Self::Reference => "the reference is right",
            Self::Both => "both are right",
            Self::Neither => "neither is right",
            Self::IllPosed => "the pixel is ill-posed",
            Self::Unknown => "undecided",
        })
    }
}

/// The oracle's answers about a case.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Opinion {
    /// Pixels in question.
    pub in_question: usize,
    /// Pixels that were answered within the time limit.
    pub asked: usize,
    /// Number of pixels with each verdict: see [`Verdict`].
    pub ours: usize,
    /// See [`Verdict`].
    pub reference: usize,
    /// See [`Verdict`].
    pub both: usize,
    /// See [`Verdict`].
    pub neither: usize,
    /// See [`Verdict`].
    pub ill_posed: usize,
    /// See [`Verdict`].
    pub unknown: usize,
    /// Whether the time limit was reached before all pixels were answered.
    pub out_of_time: bool,
    /// Wall time in seconds.
    pub seconds: f64,
    /// Why the oracle cannot handle this scene, if so.
    pub silent: Option<String>,
}

impl Opinion {
    /// Adds the verdict on a pixel.
    pub(crate) fn count(&mut self, verdict: Verdict) {
        self.asked += 1;
        *match verdict {
            Verdict::Ours => &mut self.ours,
            Verdict::Reference => &mut self.reference,
            Verdict::Both => &mut self.both,
            Verdict::Neither => &mut self.neither,
            Verdict::IllPosed => &mut self.ill_posed,
            Verdict::Unknown => &mut self.unknown,
        } += 1;
    }
}

impl fmt::Display for Opinion {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some(why) = &self.silent {
            return write!(f, "not available: {why}");
        }
        let Self {
            in_question,
            asked,
            ours,
            reference,
            both,
            neither,
            ill_posed,
            unknown,
            ..
        } = self;
        write!(
            f,
            "{asked} of {in_question} pixels queried in {:.1} s: ours right {ours}, reference right {reference}, both {both}, \
             neither {neither}, ill-posed {ill_posed}, undecided {unknown}",
            self.seconds
        )?;
        if self.out_of_time {
            f.write_str(" (stopped at its time limit)")?;
        }
        Ok(())
    }
}
