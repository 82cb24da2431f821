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

    /// The next coarser resolution: means of 2 x 2 texels, halves rounded up.
    pub(super) fn halved(&self) -> Self {
        let (width, height) = (self.width / 2, self.height / 2);
        let mean = |x: usize, y: usize| {
            let rows = [0, 1].map(|row| self.row(2 * x, 2 * y + row, 2));
            [0, 1, 2].map(|c| {
                let sum: u32 = rows
                    .iter()
                    .flat_map(|row| row.iter())
                    .map(|t| u32::from(t[c]))
                    .sum();
                ((sum + 2) / 4) as u8
            })
        };
        Self {
            width,
            height,
            data: (0..width * height)
                .map(|at| mean(at % width, at / width))
                .collect(),
        }
    }

    /// The next finer resolution, of this size: each texel becomes four.
    pub(super) fn doubled(&self, [width, height]: [usize; 2]) -> Self {
        let texel = |x: usize, y: usize| {
            let [x, y] = [(x / 2).min(self.width - 1), (y / 2).min(self.height - 1)];
            self.data[y * self.width + x]
        };
        Self {
            width,
            height,
            data: (0..width * height)
                .map(|at| texel(at % width, at / width))
                .collect(),
        }
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
