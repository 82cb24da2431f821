//! Images of other programs: EXR, PNG, JPEG, WebP, HDR (RGBE), PFM and TIFF files as planes of
//! `f32`.

use std::fmt;
use std::io::{BufRead, BufReader, Cursor, Read, Seek};
use std::path::Path;

use image::codecs::hdr::HdrDecoder;
use image::codecs::tiff::TiffDecoder;
use image::{DynamicImage, ImageDecoder};

use crate::exr_io;
use crate::limits::{self, Limits, ReadError, ReadFault, no_panic};
use crate::planes::{Image, ImageError, RGB};
use crate::texels::{self, decoder_limits, to_fault};
use crate::tone::srgb_to_linear;

/// The numbers of a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Codes {
    /// 8-bit codes: values are `code / 255`.
    Bits8,
    /// 16-bit codes: values are `code / 65535`.
    Bits16,
    /// Single-precision numbers, linear.
    Float,
    /// Half-precision numbers, linear.
    Half,
    /// Three mantissas of 8 bits and a shared exponent (HDR), linear.
    SharedExponent {
        /// An exposure was divided out: the exponent may be one lower than in the file.
        exposed: bool,
    },
}

impl Codes {
    /// Whether the numbers are linear values.
    #[must_use]
    pub fn is_float(self) -> bool {
        !matches!(self, Self::Bits8 | Self::Bits16)
    }

    /// The values that a file rounds to one of its numbers: the lowest and the highest. `largest`
    /// is the largest of the pixel's channels. Codes are not decoded; the first and the last one
    /// stand for all values beyond them.
    #[must_use]
    pub fn rounded_from(self, value: f64, largest: f64) -> [f64; 2] {
        let of_codes = |last: f64| {
            let half = 0.5 / last;
            [
                if value <= 0.0 {
                    f64::NEG_INFINITY
                } else {
                    value - half
                },
                if value >= 1.0 { f64::INFINITY } else { value + half },
            ]
        };
        match self {
            Self::Bits8 => of_codes(255.0),
            Self::Bits16 => of_codes(65535.0),
            Self::Float => [value; 2],
            Self::Half => {
                // 11 significant bits, of which the last is at least 2^-24.
                let unit = libm::ldexp(1.0, (exponent(value) - 11).max(-24));
                [value - 0.5 * unit, value + 0.5 * unit]
            }
            Self::SharedExponent { exposed } => {
                // Some writers round, and some (Ward's) leave out what follows the 8 bits.
                let unit = libm::ldexp(1.0, exponent(largest) - 8 + i32::from(exposed));
                [value - 0.5 * unit, value + unit]
            }
        }
    }
}

/// The least k with |value| < 2^k; the lowest possible for 0 and for what is not finite.
fn exponent(value: f64) -> i32 {
    let (mantissa, exponent) = libm::frexp(value);
    if mantissa == 0.0 || !mantissa.is_finite() {
        -1000
    } else {
        exponent
    }
}

impl fmt::Display for Codes {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Bits8 => "8-bit codes",
            Self::Bits16 => "16-bit codes",
            Self::Float => "floating-point numbers",
            Self::Half => "half-precision numbers",
            Self::SharedExponent { .. } => "numbers with a shared exponent",
        })
    }
}

/// An image file in memory.
#[derive(Debug, Clone, PartialEq)]
pub struct Picture {
    /// The channels of an EXR file, or `R`, `G`, `B` and, if the file has alpha, `A`. Codes are
    /// normalised and not decoded: see [`Transfer`].
    pub image: Image,
    /// The numbers of the file.
    pub codes: Codes,
}

/// The last code of 16 bits.
const LAST_CODE: f32 = 65535.0;

/// How codes represent linear values.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Transfer {
    /// A code is proportional to the value.
    Linear,
    /// IEC 61966-2-1.
    Srgb,
    /// The value is the normalised code to the power of this exponent.
    Gamma(f64),
}

impl Transfer {
    /// The linear value of a normalised code.
    #[must_use]
    pub fn decode(self, code: f64) -> f64 {
        match self {
            Self::Linear => code,
            Self::Srgb => srgb_to_linear(code),
            Self::Gamma(exponent) => libm::pow(code, exponent),
        }
    }

    /// Decodes the colour channels of an image.
    pub fn apply(self, image: &mut Image) {
        // Codes of 8 bits are some of those of 16.
        let values = |code: usize| code as f32 / LAST_CODE;
        let decoded = |value: f32| self.decode(f64::from(value)) as f32;
        let table: Vec<f32> = match image.pixel_count() > LAST_CODE as usize {
            true => (0..=LAST_CODE as usize)
                .map(|code| decoded(values(code)))
                .collect(),
            false => Vec::new(),
        };
        for name in RGB {
            if let Some(plane) = image.channel_mut(name) {
                for value in plane {
                    // The table is used for exact codes only: rounding may err elsewhere.
                    let code = (*value * LAST_CODE + 0.5) as usize;
                    *value = match table.get(code) {
                        Some(known) if values(code) == *value => *known,
                        _ => decoded(*value),
                    };
                }
            }
        }
    }
}

/// The names of HDR files in their first line: Radiance writes the first, some programs the other.
const HDR: &[u8] = b"#?RADIANCE";
const OTHER_HDR: &[u8] = b"#?RGBE";

/// What [`read`] accepts, for messages.
const EXPECTED: &str = "an EXR, PNG, JPEG, WebP, HDR, PFM or TIFF file";

/// Reads an image. The first bytes determine the kind, not the name. [`Limits::IMAGE`] are the
/// usual limits.
///
/// - Grey is repeated to `R`, `G`, `B`, in an EXR file only if it has none of them and a channel
///   `Y`. Colours are not multiplied by alpha.
/// - Colour profiles, gamma chunks and orientations are ignored. The exposure in the header of an
///   HDR file is divided out.
/// - Values may be NaN or infinite.
///
/// # Errors
/// [`ReadError`] with a [`ReadFault`]: no such file, an unknown format, an empty, damaged or
/// truncated one, or sizes beyond the limits.
pub fn read(path: impl AsRef<Path>, limits: Limits) -> Result<Picture, ReadError> {
    let path = path.as_ref();
    let read = || decode_from(BufReader::new(limits::open(path)?), limits);
    read().map_err(|fault| fault.at(path))
}

/// As [`read`], from memory.
///
/// # Errors
/// As [`read`].
pub fn decode(bytes: &[u8], limits: Limits) -> Result<Picture, ReadFault> {
    decode_from(Cursor::new(bytes), limits)
}

fn decode_from<R: BufRead + Seek>(mut source: R, limits: Limits) -> Result<Picture, ReadFault> {
    let mut start = Vec::new();
    (&mut source).take(10).read_to_end(&mut start)?;
    source.rewind()?;
    let begins = |magic: &[u8]| start.starts_with(magic);
    if begins(&exr_io::MAGIC) {
        let decoded = exr_io::decode_channels(source, limits, |_| true)?;
        let mut image = decoded.image;
        if RGB.iter().all(|name| image.channel(name).is_none())
            && let Some(grey) = image.channel("Y").map(<[f32]>::to_vec)
        {
            add_colors(&mut image, [grey.clone(), grey.clone(), grey])?;
        }
        let codes = if decoded.half_colors {
            Codes::Half
        } else {
            Codes::Float
        };
        Ok(Picture { image, codes })
    } else if begins(HDR) {
        no_panic(|| decode_hdr(source, limits))
    } else if begins(OTHER_HDR) {
        // The decoder accepts only the first of the two names.
        source.read_exact(&mut [0; OTHER_HDR.len()])?;
        no_panic(|| decode_hdr(HDR.chain(source), limits))
    } else if begins(b"PF") || begins(b"Pf") {
        decode_pfm(source, limits)
    } else if begins(b"II*\0") || begins(b"MM\0*") {
        no_panic(|| {
            let mut decoder = TiffDecoder::new(source).map_err(to_fault)?;
            decoder.set_limits(decoder_limits(limits)).map_err(to_fault)?;
            from_decoder(decoder, limits)
        })
    } else if let Some(decoded) = texels::decode_image(source, limits) {
        from_dynamic(&decoded?)
    } else {
        Err(ReadFault::UnknownFormat { expected: EXPECTED })
    }
}

fn add_colors(image: &mut Image, planes: [Vec<f32>; 3]) -> Result<(), ReadFault> {
    for (name, plane) in RGB.into_iter().zip(planes) {
        image.add_channel(name, plane).map_err(invalid)?;
    }
    Ok(())
}

fn invalid(error: ImageError) -> ReadFault {
    ReadFault::Damaged(error.to_string())
}

/// The values of an HDR file as they are stored, without its exposure; `None` for other files.
pub(crate) fn decode_stored_hdr<R: BufRead + Seek>(
    source: &mut R,
    limits: Limits,
) -> Option<Result<Image, ReadFault>> {
    let decode = || {
        let mut start = Vec::new();
        source.take(10).read_to_end(&mut start)?;
        source.rewind()?;
        let other = start.starts_with(OTHER_HDR);
        if !other && !start.starts_with(HDR) {
            return Ok(None);
        }
        if other {
            // The decoder accepts only the first of the two names.
            source.read_exact(&mut [0; OTHER_HDR.len()])?;
        }
        let name = if other { HDR } else { &[] };
        let decoder = HdrDecoder::new(name.chain(source)).map_err(to_fault)?;
        Ok(Some(from_decoder(decoder, limits)?.image))
    };
    no_panic(decode).transpose()
}

fn decode_hdr(source: impl BufRead, limits: Limits) -> Result<Picture, ReadFault> {
    let decoder = HdrDecoder::new(source).map_err(to_fault)?;
    let exposure = decoder.metadata().exposure.unwrap_or(1.0);
    if !(exposure.is_finite() && exposure > 0.0) {
        return Err(ReadFault::Damaged(format!("the exposure is {exposure}")));
    }
    let mut picture = Picture {
        codes: Codes::SharedExponent {
            exposed: exposure != 1.0,
        },
        ..from_decoder(decoder, limits)?
    };
    if exposure != 1.0 {
        for name in RGB {
            let plane = picture.image.channel_mut(name).into_iter().flatten();
            plane.for_each(|value| *value /= exposure);
        }
    }
    Ok(picture)
}

fn from_decoder(decoder: impl ImageDecoder, limits: Limits) -> Result<Picture, ReadFault> {
    let (width, height) = decoder.dimensions();
    limits.check(width as usize, height as usize, size_of::<[f32; 4]>())?;
    from_dynamic(&DynamicImage::from_decoder(decoder).map_err(to_fault)?)
}

fn from_dynamic(decoded: &DynamicImage) -> Result<Picture, ReadFault> {
    use DynamicImage as D;
    let eight = |code: u8| f32::from(code) / 255.0;
    let sixteen = |code: u16| f32::from(code) / LAST_CODE;
    let size = (decoded.width() as usize, decoded.height() as usize);
    let channels = usize::from(decoded.color().channel_count());
    let bits8 = |codes: &[u8]| (Codes::Bits8, planes(size, channels, codes, eight));
    let bits16 = |codes: &[u16]| (Codes::Bits16, planes(size, channels, codes, sixteen));
    let floats = |values: &[f32]| (Codes::Float, planes(size, channels, values, |value| value));
    let (codes, image) = match decoded {
        D::ImageLuma8(image) => bits8(image),
        D::ImageLumaA8(image) => bits8(image),
        D::ImageRgb8(image) => bits8(image),
        D::ImageRgba8(image) => bits8(image),
        D::ImageLuma16(image) => bits16(image),
        D::ImageLumaA16(image) => bits16(image),
        D::ImageRgb16(image) => bits16(image),
        D::ImageRgba16(image) => bits16(image),
        D::ImageRgb32F(image) => floats(image),
        D::ImageRgba32F(image) => floats(image),
        other => {
            let message = format!("pixels of type {:?}", other.color());
            return Err(ReadFault::Unsupported(message));
        }
    };
    Ok(Picture { image: image?, codes })
}

/// The planes of interleaved samples: grey or colours, then alpha if there is one.
fn planes<T: Copy>(
    (width, height): (usize, usize),
    channels: usize,
    samples: &[T],
    value: impl Fn(T) -> f32,
) -> Result<Image, ReadFault> {
    let pixels = || samples.chunks_exact(channels);
    let plane = |channel: usize| -> Vec<f32> { pixels().map(|pixel| value(pixel[channel])).collect() };
    let mut image = Image::new(width, height).map_err(invalid)?;
    add_colors(
        &mut image,
        match channels {
            1 | 2 => {
                let grey = plane(0);
                [grey.clone(), grey.clone(), grey]
            }
            _ => [plane(0), plane(1), plane(2)],
        },
    )?;
    if channels.is_multiple_of(2) {
        image.add_channel("A", plane(channels - 1)).map_err(invalid)?;
    }
    Ok(image)
}

/// Bytes of the header of a PFM file that are read at most.
const MAX_PFM_HEADER: u64 = 256;

/// Reads a PFM file (Debevec): three words of text, then rows from the bottom up. The sign of the
/// scale is the byte order; its magnitude has no common meaning and is ignored.
fn decode_pfm(mut source: impl BufRead, limits: Limits) -> Result<Picture, ReadFault> {
    let mut word = || -> Result<String, ReadFault> {
        let mut word = Vec::new();
        let mut byte = [0];
        for _ in 0..MAX_PFM_HEADER {
            source.read_exact(&mut byte).map_err(cut_off)?;
            match (byte[0].is_ascii_whitespace(), word.is_empty()) {
                (true, true) => {}
                (true, false) => break,
                (false, _) => word.push(byte[0]),
            }
        }
        Ok(String::from_utf8_lossy(&word).into_owned())
    };
    let grey = word()? == "Pf";
    let (width, height, scale) = (word()?, word()?, word()?);
    let number = |text: &str, what: &str| {
        text.parse::<usize>()
            .map_err(|_| ReadFault::Damaged(format!("the {what} is \"{text}\", expected a whole number")))
    };
    let (width, height) = (number(&width, "width")?, number(&height, "height")?);
    let little_endian = match scale.parse::<f64>() {
        Ok(scale) if scale < 0.0 => true,
        Ok(scale) if scale > 0.0 => false,
        _ => {
            let message = format!("the scale is \"{scale}\", expected a number other than 0");
            return Err(ReadFault::Damaged(message));
        }
    };
    let channels = if grey { 1 } else { 3 };
    limits.check(width, height, 4 * RGB.len())?;
    let mut image = Image::new(width, height).map_err(invalid)?;
    let mut planes = RGB.map(|_| vec![0.0_f32; width * height]);
    let mut row = vec![0; 4 * channels * width];
    for y in (0..height).rev() {
        source.read_exact(&mut row).map_err(cut_off)?;
        for (x, pixel) in row.chunks_exact(4 * channels).enumerate() {
            for (channel, plane) in planes.iter_mut().enumerate() {
                let at = 4 * (channel % channels);
                let bytes = [pixel[at], pixel[at + 1], pixel[at + 2], pixel[at + 3]];
                plane[y * width + x] = match little_endian {
                    true => f32::from_le_bytes(bytes),
                    false => f32::from_be_bytes(bytes),
                };
            }
        }
    }
    add_colors(&mut image, planes)?;
    Ok(Picture {
        image,
        codes: Codes::Float,
    })
}

fn cut_off(error: std::io::Error) -> ReadFault {
    if error.kind() == std::io::ErrorKind::UnexpectedEof {
        ReadFault::Damaged("the file is truncated".to_owned())
    } else {
        ReadFault::Io(error)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::codecs::hdr::HdrEncoder;
    use image::codecs::png::PngEncoder;
    use image::codecs::tiff::TiffEncoder;
    use image::{ExtendedColorType, ImageEncoder};

    fn at(picture: &Picture, x: usize, y: usize) -> [f32; 3] {
        let index = y * picture.image.width() + x;
        picture.image.rgb().unwrap().map(|plane| plane[index])
    }

    fn decoded(bytes: &[u8]) -> Picture {
        decode(bytes, Limits::IMAGE).unwrap()
    }

    #[test]
    fn codes_of_png_and_tiff_are_normalised() {
        let codes: [u8; 8] = [255, 0, 51, 102, 0, 255, 204, 255];
        let mut png = Vec::new();
        let encoder = PngEncoder::new(&mut png);
        encoder
            .write_image(&codes, 2, 1, ExtendedColorType::Rgba8)
            .unwrap();
        let picture = decoded(&png);
        assert_eq!(picture.codes, Codes::Bits8);
        assert_eq!(at(&picture, 0, 0), [1.0, 0.0, 0.2]);
        assert_eq!(at(&picture, 1, 0), [0.0, 1.0, 0.8]);
        assert_eq!(picture.image.channel("A"), Some(&[0.4, 1.0][..]));

        let wide: Vec<u8> = [65535_u16, 13107, 0]
            .iter()
            .flat_map(|code| code.to_ne_bytes())
            .collect();
        let mut tiff = Cursor::new(Vec::new());
        let encoder = TiffEncoder::new(&mut tiff);
        encoder
            .write_image(&wide, 1, 1, ExtendedColorType::Rgb16)
            .unwrap();
        let picture = decoded(tiff.get_ref());
        assert_eq!(picture.codes, Codes::Bits16);
        assert_eq!(at(&picture, 0, 0), [1.0, 0.2, 0.0]);
        assert_eq!(picture.image.channel("A"), None);
    }

    #[test]
    fn rounded_numbers_stand_for_an_interval() {
        assert_eq!(Codes::Float.rounded_from(0.1, 1.0), [0.1, 0.1]);
        let [low, high] = Codes::Bits8.rounded_from(0.0, 1.0);
        assert_eq!((low, high), (f64::NEG_INFINITY, 0.5 / 255.0));
        assert_eq!(Codes::Bits16.rounded_from(1.0, 1.0)[1], f64::INFINITY);
        // Between 1 and 2 a half-precision number has steps of 2^-10, below 2^-14 of 2^-24.
        let step = 1.0 / 1024.0;
        assert_eq!(
            Codes::Half.rounded_from(1.5, 1.5),
            [1.5 - step / 2.0, 1.5 + step / 2.0]
        );
        let least = libm::exp2(-25.0);
        assert_eq!(Codes::Half.rounded_from(0.0, 1.0), [-least, least]);
        // The exponent is that of the largest channel: steps of 2^-7 from 1 on.
        let step = 1.0 / 128.0;
        assert_eq!(
            Codes::SharedExponent { exposed: false }.rounded_from(0.25, 1.0),
            [0.25 - step / 2.0, 0.25 + step]
        );
        for value in (1..1000_u16).map(|value| f64::from(value) / 300.0) {
            let half = exr::prelude::f16::from_f64(value).to_f64();
            let [low, high] = Codes::Half.rounded_from(half, 0.0);
            assert!(low <= value && value <= high, "{value} as {half}");
        }
    }

    #[test]
    fn transfers_are_decoded() {
        let code = 188.0 / 255.0;
        assert_eq!(Transfer::Linear.decode(code), code);
        assert!((Transfer::Srgb.decode(code) - 0.502_886).abs() < 1e-6);
        assert!((Transfer::Gamma(2.0).decode(0.5) - 0.25).abs() < 1e-15);
        let mut image = Image::from_rgb(1, 1, &[[0.5, 1.0, 0.0]]).unwrap();
        Transfer::Gamma(2.0).apply(&mut image);
        assert_eq!(image.rgb().unwrap().map(|plane| plane[0]), [0.25, 1.0, 0.0]);
    }

    #[test]
    fn hdr_is_read_and_its_exposure_divided_out() {
        let mut hdr = Vec::new();
        HdrEncoder::new(&mut hdr)
            .encode(&[image::Rgb([2.0, 0.5, 1.0])], 1, 1)
            .unwrap();
        let picture = decoded(&hdr);
        assert_eq!(
            (picture.codes, at(&picture, 0, 0)),
            (Codes::SharedExponent { exposed: false }, [2.0, 0.5, 1.0])
        );
        let text = b"FORMAT=32-bit_rle_rgbe\n";
        let place = hdr.windows(text.len()).position(|part| part == text).unwrap();
        hdr.splice(place..place, *b"EXPOSURE=4\n");
        assert_eq!(at(&decoded(&hdr), 0, 0), [0.5, 0.125, 0.25]);
        let radiance = decoded(&hdr);
        hdr.splice(..HDR.len(), OTHER_HDR.iter().copied());
        assert_eq!(decoded(&hdr), radiance);
    }

    #[test]
    fn rows_of_pfm_are_stored_from_the_bottom_up_in_either_byte_order() {
        let values: [f32; 6] = [1.0, 2.0, 3.0, 4.0, f32::NAN, 6.0];
        let little: Vec<u8> = values.iter().flat_map(|value| value.to_le_bytes()).collect();
        let big: Vec<u8> = values.iter().flat_map(|value| value.to_be_bytes()).collect();
        for (header, bytes) in [("PF\n1 2\n-1.0\n", little), ("PF 1 2 1.0\n", big)] {
            let picture = decoded(&[header.as_bytes(), &bytes].concat());
            assert_eq!(at(&picture, 0, 1), [1.0, 2.0, 3.0]);
            assert!(at(&picture, 0, 0)[1].is_nan());
        }
        let grey = decoded(&[b"Pf 1 1 -1\n", &2.5_f32.to_le_bytes()[..]].concat());
        assert_eq!(at(&grey, 0, 0), [2.5; 3]);
    }

    #[test]
    fn damaged_files_are_reported() {
        let fault = |bytes: &[u8]| decode(bytes, Limits::IMAGE).unwrap_err().to_string();
        assert_eq!(fault(b"PF 2 2 -1\n1234"), "damaged: the file is truncated");
        assert_eq!(fault(b"PF"), "damaged: the file is truncated");
        assert!(fault(b"PF x 2 -1\n").contains("the width is \"x\""));
        assert!(fault(b"PF 2 2 0\n").contains("expected a number other than 0"));
        assert!(fault(b"PF 2 99999999 -1\n").contains("the limits are"));
        // The number of bytes has more than 128 bits.
        let most = usize::MAX;
        assert!(fault(format!("PF {most} {most} -1\n").as_bytes()).contains("the limits are"));
        assert!(fault(b"#?RADIANCE\n").contains("damaged"));
        assert!(fault(b"MM\0*\0\0").contains("damaged"));
        assert_eq!(fault(b"GIF89a...."), format!("not {EXPECTED}"));
        assert_eq!(fault(b""), format!("not {EXPECTED}"));
    }

    /// Large images are decoded by a table, with the same values.
    #[test]
    fn the_table_of_codes_has_the_decoded_values() {
        let width = 70_000;
        // Codes of 8 and of 16 bits, and values that are no codes.
        let value = |x: usize| match x % 4 {
            0 => (x % 256) as f32 / 255.0,
            1 => (x % 65536) as f32 / 65535.0,
            2 => x as f32 * 1e-5 - 0.1,
            _ => 1.5,
        };
        let mut image = Image::from_fn(width, 1, |x, _| [value(x); 3]).unwrap();
        for transfer in [Transfer::Srgb, Transfer::Gamma(2.2), Transfer::Linear] {
            let before = image.clone();
            transfer.apply(&mut image);
            for (x, found) in image.channel("G").unwrap().iter().enumerate() {
                let expected = transfer.decode(f64::from(value(x))) as f32;
                assert!(found.to_bits() == expected.to_bits(), "{x}: {found} {expected}");
            }
            image = before;
        }
    }

    #[test]
    fn a_grey_exr_has_colours() {
        let mut image = Image::new(1, 1).unwrap();
        image.add_channel("Y", vec![0.75]).unwrap();
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("grey.exr");
        exr_io::write(&path, &image).unwrap();
        let picture = read(&path, Limits::IMAGE).unwrap();
        assert_eq!(at(&picture, 0, 0), [0.75; 3]);
    }
}
