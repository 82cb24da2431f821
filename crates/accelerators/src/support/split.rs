//! Configuration of split positions and axes.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::ops::Range;

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
    /// As "sah", but only between the median and the midpoint.
    Between,
}

impl Split {
    /// Whether the expected cost decides where to split and whether to split at all.
    pub(crate) fn asks_cost(self) -> bool {
        matches!(self, Self::Sah | Self::Between)
    }

    /// Which lower borders of `bins` equal bins to try; `median` is the bin that holds the median.
    pub(crate) fn borders(self, bins: usize, median: usize) -> Range<usize> {
        let middle = bins / 2;
        match self {
            Self::Midpoint => middle..middle + 1,
            // The borders of the bin of the median enclose it. The outermost are no splits.
            Self::Between => median.min(middle).max(1)..(median + 1).max(middle).min(bins - 1) + 1,
            Self::Sah | Self::Median => 1..bins,
        }
    }
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn borders_between_the_median_and_the_midpoint_include_both() {
        for (median, borders) in [(0, 1..5), (2, 2..5), (3, 3..5), (4, 4..6), (5, 4..7), (7, 4..8)] {
            assert_eq!(Split::Between.borders(8, median), borders);
        }
        assert_eq!(Split::Midpoint.borders(8, 0), 4..5);
        assert_eq!(Split::Sah.borders(8, 0), 1..8);
    }
}
