//! What lies outside of a grid of texels or voxels.

use schemars::JsonSchema;
use serde::Deserialize;

/// What lies outside of the picture.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Wrap {
    /// The picture again.
    #[default]
    Repeat,
    /// Its border.
    Clamp,
    /// Its mirror image.
    Mirror,
}

impl Wrap {
    /// The texel that stands at an index, which is a whole number of any size, or none at all.
    pub(crate) fn index(self, index: f64, count: usize) -> usize {
        let n = count as f64;
        if index >= 0.0 && index < n {
            return index as usize;
        }
        // In floating-point numbers, where nothing overflows: the remainder of whole numbers is exact.
        let inside = match self {
            Self::Repeat => index.rem_euclid(n),
            Self::Clamp => index.clamp(0.0, n - 1.0),
            Self::Mirror => {
                let folded = index.rem_euclid(2.0 * n);
                if folded < n {
                    folded
                } else {
                    2.0 * n - 1.0 - folded
                }
            }
        };
        // NaN, from an infinite index, becomes 0.
        inside as usize
    }
}
