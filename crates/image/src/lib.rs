//! Images of Whitstone: planes of `f32`, their files, and comparisons of two images.
//!
//! | module | contents |
//! |---|---|
//! | [`planes`] | [`Image`]: named `f32` channels, row-major, top row first |
//! | [`exr_io`] | OpenEXR in (any flat file) and out (float32, scan lines, ZIP) |
//! | [`texels`] | texture files (PNG, JPEG, EXR) as raw normalised values |
//! | [`tone`] | exposure and the sRGB transfer functions |
//! | [`png`] | 8-bit pictures for people |
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
//! | [`atomic`] | files that are either complete or absent |
//!
//! Pixel `(x, y)` counts x to the right and y *down* from the top left corner, as everywhere in
//! Whitstone; its sample in a plane is at `y * width + x`. Colours are linear Rec. 709 RGB with D65
//! white.
//!
//! No function panics on the contents of a file or resamples an image. Colours change only where a
//! function's name says so.

#![forbid(unsafe_code)]

pub mod areas;
pub mod atomic;
pub mod color_map;
pub mod edges;
pub mod error_map;
pub mod exr_io;
pub mod flip;
pub mod layer_view;
pub mod layers;
pub mod limits;
pub mod mask;
pub mod metrics;
pub mod planes;
pub mod png;
pub mod range;
pub mod significance;
pub mod ssim;
pub mod sum;
pub mod texels;
pub mod tone;

#[cfg(test)]
mod test_data;

pub use color_map::ColorMap;
pub use error_map::{ErrorView, Quantity, Scale};
pub use flip::{Flip, flip};
pub use limits::{Limits, ReadError, ReadFault};
pub use mask::Mask;
pub use metrics::{CompareError, CompareOptions, Metrics, Side, Tolerance, compare};
pub use planes::{Image, ImageError, Placement};
pub use png::Raster;
pub use significance::significance;
pub use ssim::ssim;
pub use texels::{Encoding, Texels};
pub use tone::ToneMap;
