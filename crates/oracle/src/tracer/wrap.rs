//! Wrap modes: lookups outside of an image or a block of voxels (section 10 of the model).

use serde::Deserialize;

/// The texel that a lookup outside of an image or a block reads.
#[derive(Clone, Copy, Default, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(super) enum Wrap {
    #[default]
    Repeat,
    Clamp,
    Mirror,
}

/// One wrap mode for both axes of an image, or one for each.
#[derive(Clone, Copy, Deserialize)]
#[serde(untagged)]
pub(super) enum Wraps {
    Both(Wrap),
    Each([Wrap; 2]),
}

impl Default for Wraps {
    fn default() -> Self {
        Self::Both(Wrap::Repeat)
    }
}

impl Wraps {
    pub(super) fn each(self) -> [Wrap; 2] {
        match self {
            Self::Both(wrap) => [wrap; 2],
            Self::Each(wraps) => wraps,
        }
    }
}

impl Wrap {
    /// Maps any index to 0..count.
    pub(super) fn index(self, i: f64, count: usize) -> usize {
        let count = count as f64;
        let inside = match self {
            Self::Repeat => i.rem_euclid(count),
            Self::Clamp => i.clamp(0.0, count - 1.0),
            Self::Mirror => {
                let k = i.rem_euclid(2.0 * count);
                if k < count { k } else { 2.0 * count - 1.0 - k }
            }
        };
        inside as usize
    }
}
