//! Configuration of split positions and axes.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// How to choose the split position.
#[derive(Clone, Copy, Debug, Default, Deserialize, Serialize, JsonSchema, PartialEq, Eq)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Split {
    /// At the spatial midpoint.
    Midpoint,
    /// So that both sides hold the same number of elements.
    Median,
    /// Where the expected cost is least, by the surface area heuristic.
    #[default]
    Sah,
}

/// Which axes to try.
#[derive(Clone, Copy, Debug, Default, Deserialize, Serialize, JsonSchema, PartialEq, Eq)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Axes {
    /// The longest axis of the space to split.
    Longest,
    /// All three; the cheapest wins.
    #[default]
    All,
}

impl Axes {
    /// The axes to try for a space of this extent along each axis.
    pub(crate) fn of(self, extent: [f64; 3]) -> impl Iterator<Item = usize> {
        let longest = (0..3).fold(
            0,
            |best, axis| {
                if extent[axis] > extent[best] { axis } else { best }
            },
        );
        (0..3).filter(move |&axis| self == Self::All || axis == longest)
    }
}
