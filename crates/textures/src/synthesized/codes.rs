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

#[cfg(test)]
mod tests {
    use super::*;

    const CODES: [[u8; 3]; 4] = [[1, 2, 3], [4, 200, 6], [7, 8, 255], [10, 11, 0]];

    #[test]
    fn each_texel_becomes_four_and_the_last_ones_more() {
        let codes = Codes {
            width: 2,
            height: 2,
            data: CODES.to_vec(),
        };
        let doubled = codes.doubled([5, 6]);
        let [a, b, c, d] = CODES;
        let (above, below) = ([a, a, b, b, b], [c, c, d, d, d]);
        let expected = [above, above, below, below, below, below];
        assert_eq!((doubled.width, doubled.height), (5, 6));
        assert_eq!(doubled.data, expected.as_flattened());
    }

    #[test]
    fn differences_are_sums_of_squares() {
        let [a, b, c, d] = CODES;
        assert_eq!(difference(a, b), 9 + 198 * 198 + 9);
        assert_eq!(difference(b, a), difference(a, b));
        assert_eq!(
            differences(&[a, c], &[b, d]),
            difference(a, b) + 9 + 9 + 255 * 255
        );
    }

    #[test]
    fn codes_are_linear_only_if_the_scene_says_so() {
        let table = |color_space| {
            let codes = Codes {
                width: 1,
                height: 1,
                data: vec![[128; 3]],
            };
            let Store::Eight(_, table) = codes.store(color_space) else {
                unreachable!("codes are stored as codes")
            };
            table[128]
        };
        assert_eq!(table(ColorSpace::Linear), 128.0 / 255.0);
        assert_eq!(table(ColorSpace::Auto), table(ColorSpace::Srgb));
        assert!(table(ColorSpace::Srgb) < 0.22);
    }
}
