//! OpenEXR files: reads any flat file, writes one fixed kind.
//!
//! **Written**: one part, scan lines in increasing order, ZIP compression (16 lines), every channel
//! as float32, `chromaticities` of Rec. 709 with D65, the image's attributes as text attributes
//! `whitstone:NAME` in UTF-8. Equal images give equal bytes, for any number of threads.
//!
//! **Read**: scan lines or tiles, one part or several, any compression that the `exr` crate decodes
//! (all but HTJ2K), half, float or uint samples, which become `f32` (half exactly; uint rounded to
//! nearest above 2^24). Of several resolution levels, only the full one is read. Deep data and
//! subsampled channels are not supported and give an error.
//!
//! - *Windows.* The image is the **data window**: no pixel is added and none is dropped. The
//!   position of the data window in the display window is in
//!   [`Image::placement`](crate::Image::placement), and images placed differently do not compare.
//! - *Parts.* All parts must have the same data window. A channel keeps its name; where two parts
//!   have the same one, the later is called `PART.CHANNEL`.
//! - *Damage.* A truncated, contradictory or incomplete file (a missing or repeated block) is an
//!   error, and so is a panic in the decoder. Sizes are checked against [`Limits`](crate::Limits)
//!   before pixels are decoded.

mod read;
mod write;

pub use read::{decode, read};
pub use write::{encode, write, write_rows};

pub(crate) use read::{MAGIC, decode_channels};

/// Prefix of the names of Whitstone's text attributes in a file.
pub const ATTRIBUTE_PREFIX: &str = "whitstone:";

#[cfg(test)]
mod tests;
