//! Images of Whitstone: planes of `f32`, and their files. Comparisons of two images are in
//! `whitstone-metrics`.
//!
//! | module | contents |
//! |---|---|
//! | [`planes`] | [`Image`]: named `f32` channels, row-major, top row first |
//! | [`exr_io`] | OpenEXR in (any flat file) and out (float32, scan lines, ZIP) |
//! | [`picture`] | images of other programs (EXR, PNG, JPEG, WebP, HDR, PFM, TIFF) |
//! | [`texels`] | texture files (PNG, JPEG, WebP, EXR, HDR) as raw normalised values |
//! | [`tone`] | exposure, tone curves and the sRGB transfer functions |
//! | [`png`] | 8-bit pictures for people |
//! | [`limits`] | sizes that files may have; errors of reading |
//! | [`atomic`] | files that are either complete or absent |
//!
//! Pixel `(x, y)` counts x to the right and y *down* from the top left corner, as everywhere in
//! Whitstone; its sample in a plane is at `y * width + x`. Colours are linear Rec. 709 RGB with D65
//! white.
//!
//! No function panics on the contents of a file or resamples an image. Colours change only where a
//! function's name says so.

#![cfg_attr(
    not(test),
    warn(clippy::disallowed_methods, reason = "the same image on every machine")
)]
#![forbid(unsafe_code)]

pub mod atomic;
pub mod exr_io;
pub mod limits;
pub mod picture;
pub mod planes;
pub mod png;
pub mod texels;
pub mod tone;

#[cfg(test)]
mod test_data;

pub use limits::{Limits, ReadError, ReadFault};
pub use picture::{Codes, Picture, Transfer};
pub use planes::{Image, ImageError, Placement};
pub use png::Raster;
pub use texels::{Encoding, Texels};
pub use tone::{ToneCurve, ToneMap};
