//! 8-bit pictures for people, as PNG files.
//!
//! These are previews: nothing is measured from them.

use std::io;
use std::path::Path;

use image::codecs::jpeg::JpegEncoder;
use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{ExtendedColorType, ImageEncoder};

use crate::atomic::{self, WriteError};
use crate::planes::{Image, ImageError};
use crate::tone::{ToneMap, srgb_to_linear};

/// Colour of pixels that are NaN or infinite in any channel: magenta, which no colour map here
/// contains.
pub const NOT_FINITE: [u8; 3] = [255, 0, 255];

/// An 8-bit sRGB picture, row-major, top row first.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Raster {
    width: usize,
    height: usize,
    pixels: Vec<[u8; 3]>,
}

impl Raster {
    /// A picture of one colour; a side of 0 counts as 1.
    #[must_use]
    pub fn filled(width: usize, height: usize, color: [u8; 3]) -> Self {
        let (width, height) = (width.max(1), height.max(1));
        Self {
            width,
            height,
            pixels: vec![color; width * height],
        }
    }

    /// A picture whose pixel `(x, y)` is `color(x, y)`; a side of 0 counts as 1.
    #[must_use]
    pub fn from_fn(width: usize, height: usize, color: impl Fn(usize, usize) -> [u8; 3]) -> Self {
        let mut raster = Self::filled(width, height, [0; 3]);
        for (index, pixel) in raster.pixels.iter_mut().enumerate() {
            *pixel = color(index % raster.width, index / raster.width);
        }
        raster
    }

    /// The image as a screen displays it. A pixel with a channel that is NaN or infinite is
    /// [`NOT_FINITE`].
    ///
    /// # Errors
    /// [`ImageError::MissingChannel`] if R, G or B is missing.
    pub fn preview(image: &Image, tone: ToneMap) -> Result<Self, ImageError> {
        let planes = image.rgb()?;
        Ok(Self::from_fn(image.width(), image.height(), |x, y| {
            let pixel = planes.map(|plane| plane[y * image.width() + x]);
            if pixel.iter().all(|value| value.is_finite()) {
                pixel.map(|value| tone.encode(f64::from(value)))
            } else {
                NOT_FINITE
            }
        }))
    }

    /// Columns, at least 1.
    #[must_use]
    pub fn width(&self) -> usize {
        self.width
    }

    /// Rows, at least 1.
    #[must_use]
    pub fn height(&self) -> usize {
        self.height
    }

    /// All pixels, row-major, top row first.
    #[must_use]
    pub fn pixels(&self) -> &[[u8; 3]] {
        &self.pixels
    }

    /// A pixel, or `None` outside the picture.
    #[must_use]
    pub fn pixel(&self, x: usize, y: usize) -> Option<[u8; 3]> {
        (x < self.width && y < self.height).then(|| self.pixels[y * self.width + x])
    }

    /// Changes a pixel; outside the picture this does nothing.
    pub fn set(&mut self, x: usize, y: usize, color: [u8; 3]) {
        if x < self.width && y < self.height {
            self.pixels[y * self.width + x] = color;
        }
    }

    /// Copies another picture into this one, with its top left corner at `(x, y)`. Parts outside
    /// are clipped.
    pub fn draw(&mut self, other: &Self, x: usize, y: usize) {
        for (index, &color) in other.pixels.iter().enumerate() {
            self.set(
                x.saturating_add(index % other.width),
                y.saturating_add(index / other.width),
                color,
            );
        }
    }

    /// The picture with fewer pixels: each is the mean of the linear values of a block of pixels,
    /// so that it looks as the picture does from a distance. A side of 0 counts as 1, and one that
    /// is larger than that of this picture as equal to it.
    #[must_use]
    pub fn reduced(&self, width: usize, height: usize) -> Self {
        let (width, height) = (width.clamp(1, self.width), height.clamp(1, self.height));
        let part = |k: usize, parts: usize, side: usize| k * side / parts..(k + 1) * side / parts;
        Self::from_fn(width, height, |x, y| {
            let (columns, rows) = (part(x, width, self.width), part(y, height, self.height));
            let count = (columns.len() * rows.len()) as f64;
            let mut sum = [0.0; 3];
            for row in rows {
                for pixel in &self.pixels[row * self.width..][columns.clone()] {
                    for (sum, code) in sum.iter_mut().zip(pixel) {
                        *sum += srgb_to_linear(f64::from(*code) / 255.0);
                    }
                }
            }
            sum.map(|sum| ToneMap::default().encode(sum / count))
        })
    }

    /// The bytes of a JPEG file of a quality from 1 to 100. Unlike a PNG file it changes pixels.
    ///
    /// # Errors
    /// If a side is larger than a JPEG file can have.
    pub fn to_jpeg(&self, quality: u8) -> io::Result<Vec<u8>> {
        let mut bytes = Vec::new();
        self.encode(JpegEncoder::new_with_quality(&mut bytes, quality.clamp(1, 100)))?;
        Ok(bytes)
    }

    /// The bytes of a PNG file (8-bit RGB). Equal pictures give equal bytes.
    ///
    /// # Errors
    /// If a side is larger than a PNG file can have.
    pub fn to_png(&self) -> io::Result<Vec<u8>> {
        let mut bytes = Vec::new();
        let (compression, filter) = (CompressionType::Default, FilterType::Adaptive);
        self.encode(PngEncoder::new_with_quality(&mut bytes, compression, filter))?;
        Ok(bytes)
    }

    fn encode(&self, encoder: impl ImageEncoder) -> io::Result<()> {
        let side = |pixels: usize| u32::try_from(pixels).map_err(io::Error::other);
        encoder
            .write_image(
                self.pixels.as_flattened(),
                side(self.width)?,
                side(self.height)?,
                ExtendedColorType::Rgb8,
            )
            .map_err(io::Error::other)
    }

    /// Writes a PNG file atomically (see [`atomic`]).
    ///
    /// # Errors
    /// [`WriteError`], which names the path.
    pub fn write_png(&self, path: impl AsRef<Path>) -> Result<(), WriteError> {
        atomic::write(path, |file| io::Write::write_all(file, &self.to_png()?))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn previews_are_tone_mapped_and_flag_values_that_are_not_finite() {
        let bad = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY];
        let image = Image::from_fn(4, 1, |x, _| {
            if x < 3 {
                [0.5, bad[x], 0.5]
            } else {
                [0.0, 0.5, 2.0]
            }
        })
        .unwrap();
        let raster = Raster::preview(&image, ToneMap::default()).unwrap();
        assert_eq!(
            raster.pixels(),
            [NOT_FINITE, NOT_FINITE, NOT_FINITE, [0, 188, 255]]
        );
        assert!(Raster::preview(&Image::new(1, 1).unwrap(), ToneMap::default()).is_err());
    }

    #[test]
    fn png_round_trip_in_memory_and_on_disk() {
        let raster = Raster::from_fn(5, 3, |x, y| [x as u8 * 50, y as u8 * 100, 7]);
        let bytes = raster.to_png().unwrap();
        assert_eq!(bytes, raster.to_png().unwrap());
        let decoded = image::load_from_memory(&bytes).unwrap().into_rgb8();
        assert_eq!(decoded.dimensions(), (5, 3));
        assert_eq!(decoded.as_raw(), raster.pixels().as_flattened());

        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.png");
        raster.write_png(&path).unwrap();
        assert_eq!(std::fs::read(&path).unwrap(), bytes);
    }

    #[test]
    fn jpeg_round_trip_is_close() {
        let raster = Raster::from_fn(16, 8, |x, y| [x as u8 * 9, 100 + y as u8 * 9, 90]);
        let bytes = raster.to_jpeg(90).unwrap();
        assert_eq!(bytes, raster.to_jpeg(90).unwrap());
        let decoded = image::load_from_memory(&bytes).unwrap().into_rgb8();
        assert_eq!(decoded.dimensions(), (16, 8));
        for (found, code) in decoded.as_raw().iter().zip(raster.pixels().as_flattened()) {
            assert!(found.abs_diff(*code) < 16, "{found} for {code}");
        }
        assert!(Raster::filled(1, 70_000, [0; 3]).to_jpeg(90).is_err());
    }

    #[test]
    fn a_reduced_picture_has_means_of_linear_values() {
        // Columns of black and white: half of the light has the code 188.
        let stripes = Raster::from_fn(8, 6, |x, _| [if x % 2 == 0 { 0 } else { 255 }; 3]);
        assert_eq!(stripes.reduced(4, 3), Raster::filled(4, 3, [188; 3]));
        assert_eq!(stripes.reduced(8, 6), stripes);
        assert_eq!(stripes.reduced(99, 99), stripes);
        // Every pixel belongs to one block, also where the sizes do not divide.
        let reduced = Raster::filled(7, 5, [9; 3]).reduced(3, 0);
        assert_eq!(reduced, Raster::filled(3, 1, [9; 3]));
    }

    #[test]
    fn drawing_is_clipped_at_the_border() {
        let mut raster = Raster::filled(3, 3, [0; 3]);
        raster.draw(&Raster::filled(2, 2, [9; 3]), 2, 1);
        assert_eq!(
            raster.pixels().iter().filter(|&&pixel| pixel == [9; 3]).count(),
            2
        );
        assert_eq!(raster.pixel(2, 2), Some([9; 3]));
        assert_eq!(raster.pixel(3, 0), None);
        raster.draw(&Raster::filled(2, 2, [9; 3]), usize::MAX, 0);
    }
}
