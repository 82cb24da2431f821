//! Images of Whitstone: planes of `f32`, their files, and what can be measured between two of them.
//!
//! | module | what it holds |
//! |---|---|
//! | [`planes`] | [`Image`]: named `f32` channels, row-major, top row first |
//! | [`exr_io`] | OpenEXR in (any flat file) and out (float32, scan lines, ZIP) |
//! | [`texels`] | texture files (PNG, JPEG, EXR) as raw normalised values |
//! | [`tone`] | exposure and the sRGB transfer functions |
//! | [`png`] | 8-bit rasters for people to look at |
//! | [`metrics`] | numbers between an image and its reference |
//! | [`mod@flip`] | how visible a difference is |
//! | [`layers`] | numbers between two AOV layers |
//! | [`error_map`] | pictures of the difference, with a legend |
//! | [`mask`] | sets of pixels |
//! | [`sum`] | compensated sums |
//! | [`atomic`] | files that are either complete or absent |
//!
//! Pixel `(x, y)` counts x to the right and y *down* from the top left corner, as everywhere in Whitstone; its sample
//! in a plane is at `y * width + x`. Colours are linear Rec. 709 RGB with D65 white.
//!
//! Nothing here panics on the contents of a file, resamples, or changes colours except where its name says so.

#![forbid(unsafe_code)]

pub mod atomic;
pub mod error_map;
pub mod exr_io;
pub mod flip;
pub mod layers;
pub mod limits;
pub mod mask;
pub mod metrics;
pub mod planes;
pub mod png;
pub mod sum;
pub mod texels;
pub mod tone;

#[cfg(test)]
mod test_data;

pub use error_map::{ErrorView, Quantity, Scale};
pub use flip::{Flip, flip};
pub use limits::{Limits, ReadError, ReadFault};
pub use mask::Mask;
pub use metrics::{CompareError, CompareOptions, Metrics, Side, Tolerance, compare};
pub use planes::{Image, ImageError, Placement};
pub use png::Raster;
pub use texels::{Encoding, Texels};
pub use tone::ToneMap;
