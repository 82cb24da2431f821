//! Comparison of an image with its reference: metrics, statistics and pictures of the difference.
//!
//! | module | contents |
//! |---|---|
//! | [`metrics`] | error metrics of an image and its reference |
//! | [`mod@flip`] | FLIP: how visible a difference is |
//! | [`mod@ssim`] | SSIM: structural similarity of two pictures |
//! | [`mod@significance`] | test of whether noise explains a difference |
//! | [`range`] | the range of values that a reference takes; vacuous comparisons |
//! | [`layers`] | differences of two AOV layers |
//! | [`layer_view`] | pictures of AOV layers |
//! | [`error_map`] | pictures of the difference, with a legend |
//! | [`color_map`] | the colours of error maps as tables |
//! | [`mask`] | sets of pixels |
//! | [`areas`] | connected components of sets of pixels |
//! | [`edges`] | pixels at the edges in layers |
//! | [`sum`] | compensated sums |
//!
//! Images and their files are in `whitstone-image`. Pixel coordinates and colours are as there. No
//! function resamples an image: images of different sizes are a [`CompareError`].

#![cfg_attr(
    not(test),
    warn(clippy::disallowed_methods, reason = "the same image on every machine")
)]
#![forbid(unsafe_code)]

pub mod areas;
pub mod color_map;
pub mod edges;
pub mod error_map;
pub mod flip;
pub mod layer_view;
pub mod layers;
pub mod mask;
pub mod metrics;
pub mod noisy_blocks;
pub mod range;
pub mod significance;
pub mod ssim;
pub mod sum;

pub use color_map::ColorMap;
pub use error_map::{ErrorView, Quantity, Scale};
pub use flip::{Flip, flip};
pub use mask::Mask;
pub use metrics::{CompareError, CompareOptions, Metrics, Side, Tolerance, compare};
pub use noisy_blocks::{NoisyBlocks, noisy_blocks};
pub use significance::significance;
pub use ssim::ssim;
