//! The images of a case in the report: pictures, and compressed pixel values.
//!
//! The page's script displays the pixel values at any exposure and prints single ones. They are
//! compressed by zlib. The data is the mean of |reference| as a double and then *planes*, each with
//! a byte per pixel, row by row. Where two planes belong together, the low bytes come before the
//! high ones:
//!
//! | planes | contents |
//! |---|---|
//! | 2 x 3 | the reference's R, G, B as half floats: the step from the pixel before, with its sign in the last bit |
//! | 2 x 3 | our R, G, B in the same form, as steps from the reference |
//! | 3 | the relative residual, which half floats cannot resolve: [`code`] |
//! | 1 | FLIP from 0 to 255 |
//! | 1 | how the pixel was judged: [`judgement`] |

use crate::explain::Reason;
use half::f16;
use miniz_oxide::deflate::compress_to_vec_zlib;
use serde::{Deserialize, Serialize};
use whitstone_image::{Image, Raster, ToneMap};
use whitstone_metrics::error_map::{ErrorView, Quantity, Scale, error_map};
use whitstone_metrics::flip::flip_ldr;
use whitstone_metrics::layer_view;
use whitstone_metrics::metrics::{mean_reference, relative_residual};

/// Best compression: a page is written once and kept.
const LEVEL: u8 = 9;

/// Smaller residuals count as zero.
pub(crate) const LEAST_RESIDUAL: f64 = 1e-9;
/// Codes per decade: the step is a factor of about 1.2.
pub(crate) const CODES_A_DECADE: f64 = 12.5;
/// The code of a residual that is not finite.
const NOT_FINITE: u8 = 127;

/// The quantity that the error pictures of a report show, and its legend.
pub(crate) const ERROR_VIEW: ErrorView = ErrorView {
    quantity: Quantity::Relative,
    scale: Scale::Log { min: 1e-7, max: 1e-1 },
};

/// Pictures of a case, as files in memory.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Pictures {
    /// Ours, tone mapped, PNG.
    #[serde(with = "base64")]
    pub ours: Vec<u8>,
    /// The reference, tone mapped alike, PNG.
    #[serde(with = "base64")]
    pub reference: Vec<u8>,
    /// The relative error on a fixed colour scale, PNG.
    #[serde(with = "base64")]
    pub error: Vec<u8>,
    /// The pixels of both, packed.
    #[serde(with = "base64")]
    pub pixels: Vec<u8>,
    /// The layers that both have.
    #[serde(default)]
    pub layers: Vec<LayerPictures>,
}

/// A layer of both sides.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct LayerPictures {
    /// Its name.
    pub name: String,
    /// Ours, PNG.
    #[serde(with = "base64")]
    pub ours: Vec<u8>,
    /// The reference, PNG, in the same colours.
    #[serde(with = "base64")]
    pub reference: Vec<u8>,
}

impl Pictures {
    /// The pictures of two images of the same size. `judged` holds the pixels over tolerance and
    /// their explanations.
    pub fn new(
        ours: &Image,
        reference: &Image,
        judged: impl Iterator<Item = ([usize; 2], Option<Reason>)>,
    ) -> Option<Self> {
        Some(Self {
            ours: png(ours)?,
            reference: png(reference)?,
            error: error_map(ours, reference, ERROR_VIEW).ok()?.to_png().ok()?,
            pixels: pack(ours, reference, judged)?,
            layers: layer_view::layers(ours)
                .into_iter()
                .filter_map(|name| LayerPictures::new(ours, reference, name))
                .collect(),
        })
    }
}

/// The picture of one image, as [`Pictures`] shows it, PNG.
pub(crate) fn png(image: &Image) -> Option<Vec<u8>> {
    Raster::preview(image, ToneMap::default()).ok()?.to_png().ok()
}

impl LayerPictures {
    fn new(ours: &Image, reference: &Image, name: &str) -> Option<Self> {
        let [mine, theirs] = layer_view::layer_views(ours, reference, name)?;
        Some(Self {
            name: name.to_owned(),
            ours: mine.to_png().ok()?,
            reference: theirs.to_png().ok()?,
        })
    }
}

fn pack(
    ours: &Image,
    reference: &Image,
    judged: impl Iterator<Item = ([usize; 2], Option<Reason>)>,
) -> Option<Vec<u8>> {
    let count = ours.pixel_count();
    let mean = mean_reference(reference).ok()?;
    let mut bytes = mean.to_le_bytes().to_vec();
    let (ours_planes, reference_planes) = (ours.rgb().ok()?, reference.rgb().ok()?);
    for plane in reference_planes {
        let mut before = 0;
        push_steps(
            &mut bytes,
            plane.iter().map(|&value| {
                let bits = half(value);
                let step = bits.wrapping_sub(before);
                before = bits;
                step
            }),
        );
    }
    let pairs = || ours_planes.into_iter().zip(reference_planes);
    for (ours, reference) in pairs() {
        let steps = ours.iter().zip(reference);
        push_steps(
            &mut bytes,
            steps.map(|(&ours, &reference)| half(ours).wrapping_sub(half(reference))),
        );
    }
    for (ours, reference) in pairs() {
        let residuals = ours
            .iter()
            .zip(reference)
            .map(|(&ours, &reference)| code(relative_residual(f64::from(ours), f64::from(reference), mean)));
        bytes.extend(residuals);
    }
    match flip_ldr(ours, reference) {
        Ok(flip) => bytes.extend(flip.map.iter().map(|value| (value * 255.0).round() as u8)),
        // FLIP is undefined for values that are not finite.
        Err(_) => bytes.resize(bytes.len() + count, 0),
    }
    let start = bytes.len();
    bytes.resize(start + count, 0);
    for ([x, y], reason) in judged {
        *bytes.get_mut(start + y * ours.width() + x)? = judgement(reason);
    }
    Some(compress_to_vec_zlib(&bytes, LEVEL))
}

/// The bits of the nearest half float. Finite values stay finite.
fn half(value: f32) -> u16 {
    let limited = match value.is_finite() {
        true => value.clamp(f16::MIN.to_f32(), f16::MAX.to_f32()),
        false => value,
    };
    f16::from_f32(limited).to_bits()
}

/// Appends the low bytes, then the high bytes. Small steps of either sign become small numbers.
fn push_steps(bytes: &mut Vec<u8>, steps: impl Iterator<Item = u16>) {
    let folded: Vec<u16> = steps
        .map(|step| (step << 1) ^ ((step as i16) >> 15) as u16)
        .collect();
    bytes.extend(folded.iter().map(|step| *step as u8));
    bytes.extend(folded.iter().map(|step| (step >> 8) as u8));
}

/// A residual on a logarithmic scale: 0 for none, then 1 for [`LEAST_RESIDUAL`] and up to 126, 127
/// if it is not finite; the highest bit is its sign.
fn code(residual: f64) -> u8 {
    let size = (residual.abs() / LEAST_RESIDUAL).log10() * CODES_A_DECADE;
    let sign = if residual < 0.0 { 128 } else { 0 };
    if !residual.is_finite() {
        NOT_FINITE
    } else if size < -0.5 {
        0
    } else {
        sign | ((size.round() as u8).min(125) + 1)
    }
}

/// The judgement of a pixel: an index into the list of the page's script; 0 is within tolerance.
pub(crate) fn judgement(reason: Option<Reason>) -> u8 {
    match reason {
        None => 1,
        Some(Reason::Shift { .. }) => 2,
        Some(Reason::SpawnOffset) => 3,
        Some(Reason::Stored | Reason::Noise) => 4,
        Some(Reason::Rounding { .. }) => 5,
        Some(Reason::Vertices { .. }) => 6,
    }
}

/// Bytes as base64 strings in JSON.
mod base64 {
    use base64::Engine;
    use base64::engine::general_purpose::STANDARD;
    use serde::de::Error;
    use serde::{Deserialize, Deserializer, Serializer};

    pub(super) fn serialize<S: Serializer>(bytes: &[u8], serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(&STANDARD.encode(bytes))
    }

    pub(super) fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Vec<u8>, D::Error> {
        let text = String::deserialize(deserializer)?;
        STANDARD.decode(text).map_err(Error::custom)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use miniz_oxide::inflate::decompress_to_vec_zlib;

    #[test]
    fn residuals_keep_their_size_to_a_tenth_and_their_sign() {
        for exponent in -90..=10 {
            let value = 10f64.powf(f64::from(exponent) / 10.0);
            for residual in [value, -value] {
                let code = code(residual);
                let size = LEAST_RESIDUAL * 10f64.powf(f64::from((code & 127) - 1) / CODES_A_DECADE);
                assert!((size / value - 1.0).abs() < 0.1, "{residual}: {size}");
                assert_eq!(code > 127, residual < 0.0);
            }
        }
        assert_eq!(
            [0.0, 8e-10, -1e-12, 1e9, f64::NAN, f64::INFINITY].map(code),
            [0, 0, 0, 126, 127, 127]
        );
    }

    #[test]
    fn pixels_are_packed_as_it_is_told() {
        let of = |scale: f32| {
            Image::from_fn(20, 10, move |x, y| {
                [x as f32 * 0.25 * scale, y as f32, -1e9 * scale]
            })
            .unwrap()
        };
        let (ours, reference) = (of(1.001), of(1.0));
        let judged = [([3, 2], None), ([19, 9], Some(Reason::Rounding { ulps: 2.0 }))];
        let packed = pack(&ours, &reference, judged.into_iter()).unwrap();
        let bytes = decompress_to_vec_zlib(&packed).unwrap();
        let count = 200;
        assert_eq!(bytes.len(), 8 + 17 * count);
        assert!(packed.len() < bytes.len() / 6, "{}", packed.len());
        assert_eq!(
            f64::from_le_bytes(bytes[..8].try_into().unwrap()),
            mean_reference(&reference).unwrap()
        );
        let steps = |plane: usize, pixel: usize| {
            let start = 8 + 2 * plane * count;
            let folded = u16::from_le_bytes([bytes[start + pixel], bytes[start + count + pixel]]);
            (folded >> 1) ^ (folded & 1).wrapping_neg()
        };
        for (channel, expected) in [(0, 19.0 * 0.25), (1, 9.0), (2, -65504.0)] {
            let bits = (0..count).fold(0_u16, |bits, pixel| bits.wrapping_add(steps(channel, pixel)));
            assert_eq!(f16::from_bits(bits).to_f32(), expected);
            let ours = bits.wrapping_add(steps(3 + channel, count - 1));
            let value = f16::from_bits(ours).to_f32();
            assert!((value / expected - 1.0).abs() < 2e-3, "{value}");
        }
        let tail = &bytes[8 + 16 * count..];
        assert_eq!(tail.iter().filter(|&&code| code != 0).count(), 2);
        assert_eq!([tail[2 * 20 + 3], tail[199]], [1, 5]);
    }

    #[test]
    fn what_is_not_finite_is_packed_too() {
        let bad = Image::from_fn(4, 3, |x, _| [[f32::NAN, f32::INFINITY][x % 2]; 3]).unwrap();
        let good = Image::from_fn(4, 3, |_, _| [1.0; 3]).unwrap();
        let nothing = std::iter::empty;
        for (ours, reference) in [(&bad, &good), (&good, &bad), (&bad, &bad)] {
            let pictures = Pictures::new(ours, reference, nothing()).unwrap();
            let text = serde_json::to_string(&pictures).unwrap();
            let read: Pictures = serde_json::from_str(&text).unwrap();
            assert_eq!((read.pixels, read.error), (pictures.pixels, pictures.error));
        }
        assert!(Pictures::new(&bad, &Image::from_fn(3, 4, |_, _| [1.0; 3]).unwrap(), nothing()).is_none());
    }
}
