//! Classes of light paths: the radiance of a pixel, split by the signatures of its paths.
//!
//! Heckbert, *Adaptive radiosity textures for bidirectional ray tracing*, SIGGRAPH 1990 (regular
//! expressions for light paths). The events and the syntax are those of section 11 of
//! `docs/whitted-model.md`. The scene crate compiles the expressions; this module only follows the
//! resulting automaton, one state for each ray.

use crate::{PathLetter, Rgb};
use std::sync::Arc;

/// The last events of a path: where its radiance comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PathEnd {
    /// D L: light sources, reflected by local illumination.
    Light,
    /// D A: the ambient term.
    Ambient,
    /// O: an emissive surface.
    Emission,
    /// B: the background, also in place of a branch beyond the depth limit.
    Background,
}

impl PathEnd {
    /// All ends, in the order of [`PathClassState::ends`].
    pub const ALL: [Self; 4] = [Self::Light, Self::Ambient, Self::Emission, Self::Background];

    /// Its events.
    pub const fn events(self) -> &'static str {
        match self {
            Self::Light => "DL",
            Self::Ambient => "DA",
            Self::Emission => "O",
            Self::Background => "B",
        }
    }
}

/// The event of a branch: S for a mirror reflection, G for one ray of a glossy reflection, T for a
/// transmission.
pub const BRANCH_EVENTS: [char; 3] = ['S', 'G', 'T'];

/// A state of the automaton of [`PathClasses`].
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct PathClassState {
    /// The state after each of [`BRANCH_EVENTS`].
    pub next: [u32; BRANCH_EVENTS.len()],
    /// For each end, the classes of the paths that end so.
    pub ends: [Vec<u32>; PathEnd::ALL.len()],
}

/// Classes of light paths, as a deterministic automaton.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PathClasses {
    /// The names of the classes.
    pub names: Vec<String>,
    /// The states; the first one is that of a camera ray.
    pub states: Vec<PathClassState>,
}

impl PathClasses {
    /// EXR channels of the classes: the red, green and blue of each.
    pub fn channels(&self) -> Vec<String> {
        let channel = |name: &String| ["R", "G", "B"].map(|letter| format!("path.{name}.{letter}"));
        self.names.iter().flat_map(channel).collect()
    }

    /// Whether every path is in exactly one class, so that the classes sum to the image.
    pub fn is_partition(&self) -> bool {
        let mut ends = self.states.iter().flat_map(|state| &state.ends);
        ends.all(|classes| classes.len() == 1)
    }
}

/// The radiance along a camera ray by class: what [`Scratch::paths`](crate::Scratch::paths)
/// collects.
pub struct PathSums {
    classes: Arc<PathClasses>,
    /// The sum of each class so far.
    pub sums: Vec<Rgb>,
}

impl PathSums {
    /// Sums of 0.
    pub fn new(classes: Arc<PathClasses>) -> Self {
        let sums = vec![Rgb::BLACK; classes.names.len()];
        Self { classes, sums }
    }

    /// The state of a ray that its parent, in state `from`, spawned.
    #[inline]
    pub fn after(&self, from: u32, letter: PathLetter) -> u32 {
        let event = match letter {
            PathLetter::R => 0,
            PathLetter::Among(_) => 1,
            PathLetter::T | PathLetter::Through(_) => 2,
        };
        self.classes.states[from as usize].next[event]
    }

    /// Adds the radiance of the paths of a ray in state `state` that have this end.
    #[inline]
    pub fn add(&mut self, state: u32, end: PathEnd, radiance: Rgb) {
        for class in &self.classes.states[state as usize].ends[end as usize] {
            self.sums[*class as usize] += radiance;
        }
    }
}
