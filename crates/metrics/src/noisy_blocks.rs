//! Differences that noise hides in single pixels and not in blocks of them: exchanged channels, a
//! mirrored image, a shadow in another place.
//!
//! The noise of the mean of a block is a sixteenth of that of a pixel. A block differs if, in one
//! channel, the sums of its pixels differ by more than [`STANDARD_ERRORS`] standard errors and by
//! more than [`LEAST`] of the sum of |reference| + `mean_reference`.

use crate::metrics::{BLOCK, Pair};
use crate::significance::{Noise, SignificanceError};
use crate::{Mask, Side};
use whitstone_image::Image;
use whitstone_image::planes::RGB;

/// Standard errors that noise may cause: chance exceeds 5 in about one of a million blocks, and a
/// pixel filter, which correlates the noise of neighbours, needs three times as many.
pub const STANDARD_ERRORS: f64 = 15.0;
/// Relative differences up to this are not taken as one: rare bright paths that no run has found
/// are missing from the mean and from its variance.
pub const LEAST: f64 = 0.05;
/// A block whose noise is above this part of its sum shows nothing.
const HIDDEN: f64 = 0.5;

/// The blocks of a pair of images of which at least one has layers of variance.
#[derive(Clone, Debug, PartialEq)]
pub struct NoisyBlocks {
    /// Number of blocks.
    pub blocks: usize,
    /// Blocks that differ.
    pub differing: usize,
    /// Whole blocks in which noise could hide a difference of half of the value.
    pub hidden: usize,
    /// The pixels of the blocks that differ.
    pub mask: Mask,
}

/// Compares two images in blocks of 16 x 16 pixels; `None` if neither has layers of variance.
///
/// # Errors
/// [`SignificanceError`], as of [`significance`](crate::significance()).
pub fn noisy_blocks(ours: &Image, reference: &Image) -> Result<Option<NoisyBlocks>, SignificanceError> {
    let pair = Pair::new(ours, reference)?;
    pair.check_finite()?;
    let (width, height) = (ours.width(), ours.height());
    let mut variances = RGB.map(|_| vec![0.0_f64; pair.pixels()]);
    let mut is_noisy = false;
    for (image, side) in [(ours, Side::Ours), (reference, Side::Reference)] {
        if let Some(noise) = Noise::of(image, side)? {
            is_noisy = true;
            noise.add_variances(width, &mut variances)?;
        }
    }
    if !is_noisy {
        return Ok(None);
    }
    let mean = pair.mean_reference();
    let mut found = NoisyBlocks {
        blocks: 0,
        differing: 0,
        hidden: 0,
        mask: Mask::new(width, height),
    };
    for top in (0..height).step_by(BLOCK) {
        for left in (0..width).step_by(BLOCK) {
            let (right, bottom) = ((left + BLOCK).min(width), (top + BLOCK).min(height));
            let pixels = || (top..bottom).flat_map(|y| (left..right).map(move |x| [x, y]));
            let (mut differs, mut hidden) = (false, false);
            for (channel, variances) in variances.iter().enumerate() {
                let (mut difference, mut size, mut variance) = (0.0, 0.0, 0.0);
                for [x, y] in pixels() {
                    let index = y * width + x;
                    let (ours, reference) = pair.at(index)[channel];
                    difference += ours - reference;
                    size += reference.abs() + mean;
                    variance += variances[index];
                }
                let noise = STANDARD_ERRORS * variance.sqrt();
                differs |= difference.abs() > noise.max(LEAST * size);
                hidden |= noise > HIDDEN * size;
            }
            found.blocks += 1;
            // Those at the borders may be small, and their noise large.
            let is_whole = right - left == BLOCK && bottom - top == BLOCK;
            found.hidden += usize::from(hidden && is_whole);
            if differs {
                found.differing += 1;
                for [x, y] in pixels() {
                    found.mask.set(x, y, true);
                }
            }
        }
    }
    Ok(Some(found))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Twice as wide as high; a gradient with noise of a standard deviation of 0.3 in each of the
    /// runs, deterministic and without a mean.
    fn noisy(runs: f32, color: impl Fn(usize, usize) -> [f32; 3]) -> Image {
        let mut state = 1_u32;
        let mut noise = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 8) as f32 / (1 << 24) as f32 - 0.5
        };
        // Of a uniform distribution.
        let deviation = 0.3 / runs.sqrt();
        let width = deviation * 12.0_f32.sqrt();
        let mut image =
            Image::from_fn(64, 32, |x, y| color(x, y).map(|value| value + width * noise())).unwrap();
        for name in ["variance.R", "variance.G", "variance.B"] {
            image.add_channel(name, vec![0.09; 64 * 32]).unwrap();
        }
        image.add_channel("samples.N", vec![runs; 64 * 32]).unwrap();
        image
    }

    fn gradient(x: usize, _: usize) -> [f32; 3] {
        [0.2 + x as f32 / 64.0, 0.5, 0.3]
    }

    #[test]
    fn noise_alone_makes_no_difference() {
        let exact = Image::from_fn(64, 32, gradient).unwrap();
        let found = noisy_blocks(&noisy(4.0, gradient), &exact).unwrap().unwrap();
        assert_eq!((found.blocks, found.differing, found.hidden), (8, 0, 0));
        let both = noisy_blocks(&noisy(2.0, gradient), &noisy(4.0, gradient))
            .unwrap()
            .unwrap();
        assert_eq!(both.differing, 0);
        assert_eq!(noisy_blocks(&exact, &exact).unwrap(), None);
    }

    #[test]
    fn exchanged_channels_and_mirrored_images_differ() {
        let exact = Image::from_fn(64, 32, gradient).unwrap();
        let exchanged = noisy(2.0, |x, y| {
            let [r, g, b] = gradient(x, y);
            [b, g, r]
        });
        let found = noisy_blocks(&exchanged, &exact).unwrap().unwrap();
        assert!(found.differing >= 4, "{found:?}");
        let mirrored = noisy(2.0, |x, y| gradient(63 - x, y));
        let found = noisy_blocks(&mirrored, &exact).unwrap().unwrap();
        assert!(found.differing >= 4, "{found:?}");
        assert!(found.mask.contains(0, 0) && found.mask.count() == 256 * found.differing);
    }

    #[test]
    fn much_noise_hides_everything() {
        let exact = Image::from_fn(64, 32, |_, _| [0.05; 3]).unwrap();
        let found = noisy_blocks(&noisy(2.0, |_, _| [0.05; 3]), &exact)
            .unwrap()
            .unwrap();
        assert_eq!(found.hidden, found.blocks);
    }
}
