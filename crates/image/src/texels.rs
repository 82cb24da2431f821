//! Texture files: raw values, normalised, not decoded from sRGB.

use std::io::{BufRead, BufReader, Cursor, Read as _, Seek};
use std::path::Path;

use image::codecs::jpeg::JpegDecoder;
use image::codecs::png::{PngDecoder, PngEncoder};
use image::codecs::webp::WebPDecoder;
use image::{DynamicImage, ImageDecoder, ImageError};

use crate::exr_io;
use crate::limits::{self, Limits, ReadError, ReadFault, no_panic};
use crate::picture;
use crate::planes::{Image, RGB};

/// The encoding of the values of a texture file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Encoding {
    /// From 8-bit codes: values are `code / 255`, to be decoded with
    /// [`srgb_to_linear`](crate::tone::srgb_to_linear) unless the scene says that they are linear.
    Srgb8,
    /// From 16-bit codes: values are `code / 65535`, otherwise like `Srgb8`.
    Srgb16,
    /// From floating-point numbers: values as in the file, linear, of any sign and magnitude.
    Linear,
}

/// A texture file in memory.
#[derive(Debug, Clone, PartialEq)]
pub struct Texels {
    /// Columns, at least 1.
    pub width: usize,
    /// Rows, at least 1.
    pub height: usize,
    /// `width * height` texels (R, G, B), row-major, top row first. All values are finite.
    pub data: Vec<[f32; 3]>,
    /// The encoding of the file.
    pub encoding: Encoding,
}

/// Reads a PNG, JPEG, WebP, EXR or HDR file. The first bytes determine the kind, not the name.
/// [`Limits::TEXTURE`] are the usual limits.
///
/// - Alpha is ignored (colours are not multiplied by it, see [`read_alpha`]), grey is repeated to
///   RGB, palettes and codes of fewer than 8 bits are expanded to 8.
/// - Colour profiles, gamma chunks, EXIF orientation and the exposure of HDR files are ignored: the
///   scene defines the meaning of the values.
/// - An animated PNG gives its default image. An EXR file gives the data window and the channels R,
///   G, B, or else Y.
///
/// # Errors
/// [`ReadError`] with a [`ReadFault`]: no such file, an unknown format, an empty, damaged or
/// truncated one, sizes beyond the limits, no colour channels, or (EXR) values that are NaN or
/// infinite.
pub fn read(path: impl AsRef<Path>, limits: Limits) -> Result<Texels, ReadError> {
    read_part(path.as_ref(), limits, Part::Color)
}

/// Reads the alpha channel of a file like [`read`], repeated to three channels. Its codes are
/// always linear.
///
/// In an EXR file it is the channel A. A palette has alpha if a chunk defines its transparency. A
/// JPEG has none.
///
/// # Errors
/// As [`read`], and [`ReadFault::NoAlpha`].
pub fn read_alpha(path: impl AsRef<Path>, limits: Limits) -> Result<Texels, ReadError> {
    read_part(path.as_ref(), limits, Part::Alpha)
}

fn read_part(path: &Path, limits: Limits, part: Part) -> Result<Texels, ReadError> {
    let read = || {
        let file = limits::open(path)?;
        decode_from(BufReader::new(file), limits, part)
    };
    read().map_err(|fault| fault.at(path))
}

/// The requested part of a pixel.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Part {
    Color,
    Alpha,
}

impl Part {
    /// Extracts the part from grey, grey and alpha, a colour, or a colour and alpha.
    fn of<T: Copy>(self, pixel: &[T]) -> Option<[T; 3]> {
        match (self, pixel) {
            (Self::Color, &[grey] | &[grey, _]) => Some([grey; 3]),
            (Self::Color, &[r, g, b] | &[r, g, b, _]) => Some([r, g, b]),
            (Self::Alpha, &[_, alpha] | &[_, _, _, alpha]) => Some([alpha; 3]),
            _ => None,
        }
    }
}

/// As [`read`], from memory.
///
/// # Errors
/// As [`read`].
pub fn decode(bytes: &[u8], limits: Limits) -> Result<Texels, ReadFault> {
    decode_from(Cursor::new(bytes), limits, Part::Color)
}

/// As [`read_alpha`], from memory.
///
/// # Errors
/// As [`read_alpha`].
pub fn decode_alpha(bytes: &[u8], limits: Limits) -> Result<Texels, ReadFault> {
    decode_from(Cursor::new(bytes), limits, Part::Alpha)
}

/// A JPEG or WebP file as an RGBA PNG file with the same 8-bit codes; `None` for other files.
///
/// JPEG decoders differ: the standard (ITU-T T.81) bounds the error of the inverse transform and
/// leaves the interpolation of the colour channels free. Programs that must see the same texels can
/// read this file instead.
///
/// # Errors
/// As [`read`].
pub fn to_png(bytes: &[u8], limits: Limits) -> Option<Result<Vec<u8>, ReadFault>> {
    if !is_jpeg_or_webp(bytes) {
        return None;
    }
    let jpeg = bytes.starts_with(JPEG);
    let convert = || {
        let source = Cursor::new(bytes);
        let decoded = if jpeg {
            let decoder = JpegDecoder::new(source).map_err(to_fault)?;
            let (width, height) = decoder.dimensions();
            limits.check(width as usize, height as usize, size_of::<[f32; 3]>())?;
            check_end_of_jpeg(bytes)?;
            DynamicImage::from_decoder(decoder)
        } else {
            let decoder = WebPDecoder::new(source).map_err(to_fault)?;
            let (width, height) = decoder.dimensions();
            limits.check(width as usize, height as usize, size_of::<[f32; 3]>())?;
            DynamicImage::from_decoder(decoder)
        };
        let rgba = DynamicImage::ImageRgba8(decoded.map_err(to_fault)?.to_rgba8());
        let mut png = Vec::new();
        rgba.write_with_encoder(PngEncoder::new(&mut png))
            .map_err(to_fault)?;
        Ok(png)
    };
    Some(no_panic(convert))
}

/// Whether a file that begins with these bytes is a JPEG or WebP file; 12 bytes suffice.
pub fn is_jpeg_or_webp(start: &[u8]) -> bool {
    start.starts_with(JPEG) || is_webp(start)
}

fn is_webp(start: &[u8]) -> bool {
    // The container RIFF, its length, and the name of the format.
    start.starts_with(b"RIFF") && start.get(8..12) == Some(b"WEBP")
}

const PNG: &[u8] = b"\x89PNG\r\n\x1a\n";
const JPEG: &[u8] = b"\xff\xd8\xff";

fn decode_from<R: BufRead + Seek>(mut source: R, limits: Limits, part: Part) -> Result<Texels, ReadFault> {
    if let Some(decoded) = decode_image(&mut source, limits) {
        return from_integers(decoded?, part);
    }
    source.rewind()?;
    if let Some(decoded) = picture::decode_stored_hdr(&mut source, limits) {
        return from_floats(&decoded?, Vec::new(), part);
    }
    source.rewind()?;
    let mut start = Vec::new();
    (&mut source)
        .take(exr_io::MAGIC.len() as u64)
        .read_to_end(&mut start)?;
    source.rewind()?;
    if start == exr_io::MAGIC {
        let decoded = exr_io::decode_channels(source, limits, |name| match part {
            Part::Color => RGB.contains(&name) || name == "Y",
            Part::Alpha => name == "A",
        })?;
        from_floats(&decoded.image, decoded.names, part)
    } else {
        Err(ReadFault::UnknownFormat {
            expected: "a PNG, JPEG, WebP, EXR or HDR file",
        })
    }
}

/// Decodes a PNG, JPEG or WebP file to codes; `None` for other files.
pub(crate) fn decode_image<R: BufRead + Seek>(
    mut source: R,
    limits: Limits,
) -> Option<Result<DynamicImage, ReadFault>> {
    let mut decode = || {
        let mut start = Vec::new();
        (&mut source).take(12).read_to_end(&mut start)?;
        source.rewind()?;
        if start.starts_with(PNG) {
            let decoder = PngDecoder::with_limits(&mut source, decoder_limits(limits)).map_err(to_fault)?;
            checked(decoder, limits).map(Some)
        } else if start.starts_with(JPEG) {
            jpeg_codes(&mut source, limits).map(Some)
        } else if is_webp(&start) {
            let mut decoder = WebPDecoder::new(&mut source).map_err(to_fault)?;
            decoder.set_limits(decoder_limits(limits)).map_err(to_fault)?;
            checked(decoder, limits).map(Some)
        } else {
            Ok(None)
        }
    };
    no_panic(&mut decode).transpose()
}

/// [`Limits::check`] checks the size; this bounds the temporary memory of the decoder.
pub(crate) fn decoder_limits(limits: Limits) -> image::Limits {
    let mut bounds = image::Limits::no_limits();
    bounds.max_alloc = Some(limits.max_bytes);
    bounds
}

/// Bytes of a JPEG file that are read regardless of the limits.
const MAX_JPEG_EXTRAS: u64 = 64 << 20;

fn jpeg_codes(source: impl BufRead, limits: Limits) -> Result<DynamicImage, ReadFault> {
    let mut bytes = Vec::new();
    // If the limit is small, the metadata of a file may be larger than the limit.
    source
        .take(limits.max_bytes.max(MAX_JPEG_EXTRAS))
        .read_to_end(&mut bytes)?;
    let decoder = JpegDecoder::new(Cursor::new(&bytes)).map_err(to_fault)?;
    let decoded = checked(decoder, limits)?;
    check_end_of_jpeg(&bytes)?;
    Ok(decoded)
}

/// An error if a JPEG file is truncated: the decoder fills missing pixels at the end with grey.
fn check_end_of_jpeg(bytes: &[u8]) -> Result<(), ReadFault> {
    // The end marker cannot occur inside a scan, where 0xff is followed by 0 or a restart marker.
    let scan = first_scan(bytes).and_then(|start| bytes.get(start..));
    if scan.is_some_and(|scan| scan.windows(2).any(|pair| pair == [0xff, 0xd9])) {
        return Ok(());
    }
    Err(ReadFault::Damaged("the file is truncated".to_owned()))
}

/// The offset of the marker that begins the first scan of a JPEG file. Segments before it are
/// skipped by their lengths: a thumbnail in one of them has markers of its own.
fn first_scan(bytes: &[u8]) -> Option<usize> {
    // After the marker that begins the image.
    let mut at = 2;
    loop {
        match *bytes.get(at..at + 2)? {
            [0xff, 0xda] => return Some(at),
            // Markers without a segment.
            [0xff, 0 | 1 | 0xd0..=0xd9] => at += 2,
            [0xff, marker] if marker != 0xff => {
                let length = bytes.get(at + 2..at + 4)?;
                at += 2 + usize::from(u16::from_be_bytes([length[0], length[1]]).max(2));
            }
            // A fill byte, or one that the decoder skips, too.
            _ => at += 1,
        }
    }
}

/// The codes of an image within the limits.
fn checked(decoder: impl ImageDecoder, limits: Limits) -> Result<DynamicImage, ReadFault> {
    let (width, height) = decoder.dimensions();
    limits.check(width as usize, height as usize, size_of::<[f32; 3]>())?;
    DynamicImage::from_decoder(decoder).map_err(to_fault)
}

fn from_integers(decoded: DynamicImage, part: Part) -> Result<Texels, ReadFault> {
    let (width, height) = (decoded.width() as usize, decoded.height() as usize);
    let color = decoded.color();
    if part == Part::Alpha && !color.has_alpha() {
        return Err(ReadFault::NoAlpha);
    }
    let channels = usize::from(color.channel_count());
    let eight = |codes: Vec<u8>| {
        let pixels = codes.chunks_exact(channels).filter_map(|pixel| part.of(pixel));
        let data = pixels.map(|codes| codes.map(|code| f32::from(code) / 255.0));
        (data.collect(), Encoding::Srgb8)
    };
    let sixteen = |codes: Vec<u16>| {
        let pixels = codes.chunks_exact(channels).filter_map(|pixel| part.of(pixel));
        let data = pixels.map(|codes| codes.map(|code| f32::from(code) / 65535.0));
        (data.collect(), Encoding::Srgb16)
    };
    let (data, encoding) = match decoded {
        DynamicImage::ImageLuma8(image) => eight(image.into_raw()),
        DynamicImage::ImageLumaA8(image) => eight(image.into_raw()),
        DynamicImage::ImageRgb8(image) => eight(image.into_raw()),
        DynamicImage::ImageRgba8(image) => eight(image.into_raw()),
        DynamicImage::ImageLuma16(image) => sixteen(image.into_raw()),
        DynamicImage::ImageLumaA16(image) => sixteen(image.into_raw()),
        DynamicImage::ImageRgb16(image) => sixteen(image.into_raw()),
        DynamicImage::ImageRgba16(image) => sixteen(image.into_raw()),
        other => {
            return Err(ReadFault::Unsupported(format!(
                "pixels of type {:?}",
                other.color()
            )));
        }
    };
    Ok(Texels {
        width,
        height,
        data,
        encoding,
    })
}

fn from_floats(image: &Image, available: Vec<String>, part: Part) -> Result<Texels, ReadFault> {
    let planes = match (part, image.rgb(), image.channel("Y")) {
        (Part::Alpha, ..) => [image.channel("A").ok_or(ReadFault::NoAlpha)?; 3],
        (Part::Color, Ok(planes), _) => planes,
        (Part::Color, Err(_), Some(grey)) => [grey; 3],
        (Part::Color, Err(_), None) => return Err(ReadFault::NoColor { available }),
    };
    let data: Vec<[f32; 3]> = (0..image.pixel_count())
        .map(|index| planes.map(|plane| plane[index]))
        .collect();
    let bad = |texel: &[f32; 3]| texel.iter().filter(|value| !value.is_finite()).count();
    if let Some(index) = data.iter().position(|texel| bad(texel) > 0) {
        let channel = data[index]
            .iter()
            .position(|value| !value.is_finite())
            .unwrap_or(0);
        return Err(ReadFault::NotFinite {
            count: data.iter().map(bad).sum(),
            channel: if part == Part::Alpha { "A" } else { RGB[channel] },
            x: index % image.width(),
            y: index / image.width(),
            value: data[index][channel],
        });
    }
    Ok(Texels {
        width: image.width(),
        height: image.height(),
        data,
        encoding: Encoding::Linear,
    })
}

pub(crate) fn to_fault(error: ImageError) -> ReadFault {
    match error {
        ImageError::IoError(error) if error.kind() == std::io::ErrorKind::UnexpectedEof => {
            ReadFault::Damaged("the file is truncated".to_owned())
        }
        ImageError::IoError(error) => ReadFault::Io(error),
        ImageError::Unsupported(error) => ReadFault::Unsupported(error.to_string()),
        ImageError::Limits(error) => ReadFault::Unsupported(format!("decoding exceeds the limits: {error}")),
        other => ReadFault::Damaged(other.to_string()),
    }
}

#[cfg(test)]
mod tests;
