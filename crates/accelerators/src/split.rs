//! How a structure chooses where to split, as the configuration names it.

use schemars::JsonSchema;
use serde::Deserialize;

/// Where to split.
#[derive(Clone, Copy, Debug, Default, Deserialize, JsonSchema, PartialEq, Eq)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Split {
    /// In the middle of the space.
    Midpoint,
    /// So that both sides hold equally many.
    Median,
    /// Where rays are expected to cost least, by the surface area heuristic.
    #[default]
    Sah,
}

/// Which axes to try.
#[derive(Clone, Copy, Debug, Default, Deserialize, JsonSchema, PartialEq, Eq)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Axes {
    /// The one in which the space to be split is longest.
    Longest,
    /// All three; the cheapest wins.
    #[default]
    All,
}

impl Axes {
    /// The axes to try where the space extends so far along each.
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
