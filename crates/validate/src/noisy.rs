//! The rule for images that have noise, and its result: Mitsuba's own integrators as a reference,
//! and noisy subjects.
//!
//! A pixel agrees if it is within the pixel tolerance, or if noise explains the difference
//! ([`whitstone_metrics::significance`]). As in Mitsuba's own `test_renders.py`, 99.75 % of the
//! pixels must agree, because single precision moves edges, and Mitsuba's own spawn offsets are
//! larger than the driver's. The mean of all values must be unbiased too, and so must that of each
//! channel of each block of 16 x 16 pixels ([`whitstone_metrics::noisy_blocks`]), which detects
//! errors that are too faint in a single pixel. Where noise could hide half of the value of most
//! blocks, nothing is decided.

use serde::{Deserialize, Serialize};
use whitstone_image::Image;

/// Fraction of the pixels that must agree.
pub(crate) const AGREEING: f64 = 0.9975;
/// Bias of the mean that rounding may cause: the relative tolerance of a pixel.
const BIAS: f64 = 1e-3;

/// The result of a comparison with a noisy image.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Noisy {
    /// Integrator of the reference: "direct", "path" or "volpathmis". Empty if the reference has no
    /// noise.
    pub integrator: String,
    /// Fraction of the pixels that agree.
    pub agreeing: f64,
    /// Pixels whose difference noise does not explain.
    pub significant: usize,
    /// Smallest probability that a difference is due to chance.
    pub least_p: f64,
    /// Relative difference of the means of all values.
    pub bias: f64,
    /// Half the width of the bias's 95 % confidence interval.
    pub bias_interval: f64,
    /// Blocks of 16 x 16 pixels.
    #[serde(default)]
    pub blocks: usize,
    /// Blocks whose difference noise does not explain.
    #[serde(default)]
    pub differing_blocks: usize,
    /// Blocks in which noise could hide a difference of half of the value.
    #[serde(default)]
    pub hidden_blocks: usize,
}

impl Noisy {
    /// Maximum number of pixels that may differ.
    pub fn limit(pixels: usize) -> usize {
        ((1.0 - AGREEING) * pixels as f64) as usize
    }

    /// Whether the images agree by this rule.
    pub fn agrees(&self) -> bool {
        self.agreeing >= AGREEING
            && self.bias.abs() <= BIAS + self.bias_interval
            && self.differing_blocks == 0
    }

    /// Whether most of the image is too noisy to show a difference.
    pub fn hides_differences(&self) -> bool {
        2 * self.hidden_blocks > self.blocks
    }
}

impl std::fmt::Display for Noisy {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        // Rounded down, so that only all pixels read as 100 %.
        write!(
            f,
            "{:.2} % of the pixels agree with ",
            (1e4 * self.agreeing).floor() / 100.0
        )?;
        match self.integrator.as_str() {
            "" => write!(f, "the reference")?,
            integrator => write!(f, "Mitsuba's `{integrator}`")?,
        }
        write!(
            f,
            " (at least {} % must), bias {:+.1e}",
            100.0 * AGREEING,
            self.bias
        )?;
        if self.bias_interval > 0.0 {
            write!(f, " ± {:.0e}", self.bias_interval)?;
        }
        if self.differing_blocks > 0 {
            let Self {
                differing_blocks,
                blocks,
                ..
            } = self;
            write!(
                f,
                "; the means of {differing_blocks} of {blocks} blocks of 16 x 16 pixels differ"
            )?;
        }
        Ok(())
    }
}

/// Whether an image has layers of variance.
pub(crate) fn is_noisy(image: &Image) -> bool {
    image.channel("variance.R").is_some()
}
