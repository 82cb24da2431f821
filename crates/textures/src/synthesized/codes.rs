//! 8-bit texels and their differences, in integers.

use crate::support::raster::{ColorSpace, Store};
use whitstone_image::texels::Texels;

/// 8-bit texels, the top row first.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Codes {
    pub(super) width: usize,
    pub(super) height: usize,
    pub(super) data: Vec<[u8; 3]>,
}

impl Codes {
    pub(super) fn of(texels: &Texels) -> Self {
        // Rounding recovers the code, whose value is the nearest f32.
        let code = |value: f32| (f64::from(value) * 255.0).round() as u8;
        Self {
            width: texels.width,
            height: texels.height,
            data: texels.data.iter().map(|texel| texel.map(code)).collect(),
        }
    }

    pub(super) fn row(&self, x: usize, y: usize, length: usize) -> &[[u8; 3]] {
        &self.data[y * self.width + x..][..length]
    }

    pub(super) fn store(self, color_space: ColorSpace) -> Store {
        Store::eight(self.data, color_space != ColorSpace::Linear)
    }
}

/// Squared difference of two texels: the sum over the channels.
pub(super) fn difference(a: [u8; 3], b: [u8; 3]) -> u32 {
    (0..3).map(|k| u32::from(a[k].abs_diff(b[k])).pow(2)).sum()
}

/// Squared difference of two rows of at most 256 texels, so that the sum does not overflow.
#[inline(always)]
pub(super) fn differences(a: &[[u8; 3]], b: &[[u8; 3]]) -> u32 {
    let both = a.as_flattened().iter().zip(b.as_flattened());
    both.map(|(a, b)| u32::from(a.abs_diff(*b)).pow(2)).sum()
}
