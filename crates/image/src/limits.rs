//! Memory limits for reading files, and read errors.

use std::fs::{self, File};
use std::io;
use std::path::{Path, PathBuf};

/// Upper bounds that are checked against the header of a file, before its pixels are decoded.
///
/// The decoder temporarily needs a small multiple of `max_bytes`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Limits {
    /// Maximum number of columns.
    pub max_width: usize,
    /// Maximum number of rows.
    pub max_height: usize,
    /// Maximum number of bytes of the *decoded* values: 4 bytes for each sample of an image, 12 for
    /// each texel of a texture.
    pub max_bytes: u64,
}

impl Limits {
    /// For rendered images and references: 65536 x 65536, 4 GiB.
    pub const IMAGE: Self = Self {
        max_width: 65536,
        max_height: 65536,
        max_bytes: 4 << 30,
    };
    /// For textures: 16384 x 16384, 2 GiB, which is 16384 x 10922 at 12 bytes.
    pub const TEXTURE: Self = Self {
        max_width: 16384,
        max_height: 16384,
        max_bytes: 2 << 30,
    };

    /// Rejects empty sizes and sizes beyond the limits.
    pub(crate) fn check(&self, width: usize, height: usize, bytes_per_pixel: usize) -> Result<(), ReadFault> {
        if width == 0 || height == 0 {
            return Err(ReadFault::Empty { width, height });
        }
        // Two numbers of 63 bits leave two bits of 128.
        let bytes = (width as u128 * height as u128).saturating_mul(bytes_per_pixel as u128);
        let too_large =
            width > self.max_width || height > self.max_height || bytes > u128::from(self.max_bytes);
        if too_large || width.saturating_mul(height) > crate::planes::MAX_PIXELS {
            return Err(ReadFault::TooLarge {
                width,
                height,
                bytes,
                limits: *self,
            });
        }
        Ok(())
    }
}

/// Opens a file that has contents. A pipe, a device and a file of the system whose length is
/// unknown are rejected before they are opened, because reading them could wait for ever.
pub(crate) fn open(path: &Path) -> Result<File, ReadFault> {
    let metadata = fs::metadata(path)?;
    if !metadata.is_file() {
        return Err(ReadFault::Io(io::Error::other("not a regular file")));
    }
    if metadata.len() == 0 {
        return Err(ReadFault::Io(io::Error::other("the file is empty")));
    }
    Ok(File::open(path)?)
}

/// A file could not be read.
#[derive(Debug, thiserror::Error)]
#[error("{}: {fault}", path.display())]
pub struct ReadError {
    /// The file.
    pub path: PathBuf,
    /// What is wrong with it.
    pub fault: ReadFault,
}

/// What is wrong with a file.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ReadFault {
    /// An error of the operating system.
    #[error("cannot read: {0}")]
    Io(#[from] io::Error),
    /// The first bytes match no supported format.
    #[error("not {expected}")]
    UnknownFormat {
        /// The supported formats.
        expected: &'static str,
    },
    /// The file has no pixels.
    #[error("the image is empty: {width} x {height} pixels")]
    Empty {
        /// Columns in the header.
        width: usize,
        /// Rows in the header.
        height: usize,
    },
    /// The size in the header exceeds the limits. Nothing was decoded.
    #[error(
        "{width} x {height} pixels, {bytes} bytes decoded: the limits are {} x {} pixels, {} pixels in total and {} bytes",
        limits.max_width, limits.max_height, crate::planes::MAX_PIXELS, limits.max_bytes
    )]
    TooLarge {
        /// Columns in the header.
        width: usize,
        /// Rows in the header.
        height: usize,
        /// Bytes that the decoded values would take.
        bytes: u128,
        /// The limits in force.
        limits: Limits,
    },
    /// A valid file of an unsupported kind.
    #[error("not supported: {0}")]
    Unsupported(String),
    /// The file is truncated or contradicts itself.
    #[error("damaged: {0}")]
    Damaged(String),
    /// A texture has no colour channels.
    #[error("expected the channels R, G, B or the channel Y, found: {}", available.join(", "))]
    NoColor {
        /// The existing channels.
        available: Vec<String>,
    },
    /// A texture has no alpha channel.
    #[error("the file has no alpha channel")]
    NoAlpha,
    /// A texture has a value that is NaN or infinite.
    #[error(
        "expected finite values, found {count} that are not; the first is {value} in channel {channel} at column {x}, row {y}"
    )]
    NotFinite {
        /// Number of such values.
        count: usize,
        /// Channel of the first: `R`, `G`, `B` or `A`.
        channel: &'static str,
        /// Its column.
        x: usize,
        /// Its row.
        y: usize,
        /// Its value.
        value: f32,
    },
}

impl ReadFault {
    /// The fault with the path of the file.
    pub(crate) fn at(self, path: &Path) -> ReadError {
        ReadError {
            path: path.to_owned(),
            fault: self,
        }
    }
}

/// Runs a decoder of another crate and converts a panic in it to a damaged file.
///
/// The panic's message still goes through the program's panic hook (that is, to standard error),
/// because the hook belongs to the whole program and not to this library.
pub(crate) fn no_panic<T>(decoder: impl FnOnce() -> Result<T, ReadFault>) -> Result<T, ReadFault> {
    // Nothing that the closure borrows is used again after a panic.
    std::panic::catch_unwind(std::panic::AssertUnwindSafe(decoder)).unwrap_or_else(|payload| {
        let text = payload
            .downcast_ref::<&str>()
            .map(|text| (*text).to_owned())
            .or_else(|| payload.downcast_ref::<String>().cloned())
            .unwrap_or_else(|| "unknown reason".to_owned());
        Err(ReadFault::Damaged(format!("the decoder failed: {text}")))
    })
}
