//! Writes EXR files.

use std::fs::File;
use std::io::{self, BufRead, BufReader, BufWriter, Cursor, Read, Seek, SeekFrom, Write};
use std::path::Path;

use exr::block::UncompressedBlock;
use exr::block::writer::ChunksWriter as _;
use exr::meta::attribute::{
    AttributeValue, ChannelDescription, Chromaticities, IntegerBounds, LineOrder, SampleType, Text,
};
use exr::meta::header::{Header, ImageAttributes, LayerAttributes};
use exr::meta::{BlockDescription, Headers};
use exr::prelude::{Compression, Vec2};

use super::ATTRIBUTE_PREFIX;
use crate::atomic::{self, WriteError};
use crate::planes::Image;

/// Maximum side and offset of a window: OpenEXR rejects boxes that reach 2^30.
const MAX_WINDOW: i64 = 1 << 29;

/// Writes all channels and attributes of an image, atomically (see [`atomic`]).
///
/// # Errors
/// [`WriteError`], which names the path. An image without channels cannot be written.
pub fn write(path: impl AsRef<Path>, image: &Image) -> Result<(), WriteError> {
    atomic::write(path, |file: &mut File| encode_into(image, file))
}

/// The bytes that [`write()`] writes.
///
/// # Errors
/// If the image has no channels, or a placement that does not fit into the format.
pub fn encode(image: &Image) -> io::Result<Vec<u8>> {
    let mut buffer = Cursor::new(Vec::new());
    encode_into(image, &mut buffer)?;
    Ok(buffer.into_inner())
}

/// Writes to an empty target that is positioned at its start.
fn encode_into<W: Read + Write + Seek>(image: &Image, out: &mut W) -> io::Result<()> {
    let header = header(image)?;
    let planes: Vec<&[f32]> = image.channels().map(|(_, samples)| samples).collect();
    let width = image.width();

    let mut buffered = BufWriter::new(&mut *out);
    exr::block::write(
        &mut buffered,
        Headers::from_vec(vec![header]),
        true,
        |meta, writer| {
            let channels = &meta.headers[0].channels;
            let blocks = meta.collect_ordered_block_data(|block| {
                UncompressedBlock::collect_block_data_from_lines(channels, block, |line| {
                    let start = line.location.position.y() * width + line.location.position.x();
                    let samples = &planes[line.location.channel][start..start + line.location.sample_count];
                    for (bytes, sample) in line.value.chunks_exact_mut(4).zip(samples) {
                        bytes.copy_from_slice(&sample.to_ne_bytes());
                    }
                })
            });
            // The wrapper exists only because compression consumes its writer.
            writer
                .on_progress(|_| ())
                .compress_all_blocks_parallel(&meta, blocks)
        },
    )
    .map_err(to_io)?;
    buffered.flush()?;
    drop(buffered);
    sort_attributes(out)
}

fn header(image: &Image) -> io::Result<Header> {
    let invalid = |text: &str| io::Error::new(io::ErrorKind::InvalidInput, text);
    if image.channels().len() == 0 {
        return Err(invalid("the image has no channels"));
    }
    let at = image.placement();
    let side = |pixels: usize| (1..=MAX_WINDOW).contains(&i64::try_from(pixels).unwrap_or(i64::MAX));
    let offset = |pixels: i32| i64::from(pixels).abs() <= MAX_WINDOW;
    let fits = side(at.frame_width) && side(at.frame_height) && offset(at.x) && offset(at.y);
    if !fits {
        return Err(invalid(
            "the placement of the image in its frame does not fit into an EXR file",
        ));
    }

    let text = |text: &str| Text::from_slice_unchecked(text.as_bytes());
    let channels = image
        .channels()
        .map(|(name, _)| ChannelDescription::named(text(name), SampleType::F32))
        .collect();
    let other = image
        .attributes()
        .iter()
        .map(|(name, value)| {
            (
                text(&format!("{ATTRIBUTE_PREFIX}{name}")),
                AttributeValue::Text(text(value)),
            )
        })
        .collect();
    let frame = IntegerBounds::from_dimensions(Vec2(at.frame_width, at.frame_height));
    Ok(
        Header::new(Text::default(), Vec2(image.width(), image.height()), channels)
            .with_encoding(
                Compression::ZIP16,
                BlockDescription::ScanLines,
                LineOrder::Increasing,
            )
            .with_shared_attributes(ImageAttributes {
                // ITU-R BT.709-6, table 1.
                chromaticities: Some(Chromaticities {
                    red: Vec2(0.64, 0.33),
                    green: Vec2(0.30, 0.60),
                    blue: Vec2(0.15, 0.06),
                    white: Vec2(0.3127, 0.3290),
                }),
                ..ImageAttributes::new(frame)
            })
            .with_attributes(LayerAttributes {
                other,
                layer_position: Vec2(at.x, at.y),
                ..LayerAttributes::default()
            }),
    )
}

/// Sorts the attributes of the only header by name. The `exr` crate stores them in a hash map with
/// random keys, so that the same image would give different bytes in every run. The length of the
/// header does not change, so all offsets remain valid.
fn sort_attributes<F: Read + Write + Seek>(file: &mut F) -> io::Result<()> {
    /// Magic number and version.
    const START: u64 = 8;
    file.seek(SeekFrom::Start(START))?;
    let mut reader = BufReader::new(&mut *file);
    let mut attributes: Vec<(Vec<u8>, Vec<u8>)> = Vec::new();
    loop {
        let mut name = Vec::new();
        reader.read_until(0, &mut name)?;
        if name.len() <= 1 {
            break;
        }
        // The rest of an attribute: type name, length, value.
        let mut rest = Vec::new();
        reader.read_until(0, &mut rest)?;
        let mut length = [0; 4];
        reader.read_exact(&mut length)?;
        rest.extend_from_slice(&length);
        let expected = u64::from(u32::from_le_bytes(length));
        if (&mut reader).take(expected).read_to_end(&mut rest)? as u64 != expected {
            return Err(io::ErrorKind::UnexpectedEof.into());
        }
        attributes.push((name, rest));
    }
    drop(reader);
    attributes.sort();
    file.seek(SeekFrom::Start(START))?;
    let sorted: Vec<u8> = attributes
        .into_iter()
        .flat_map(|(name, rest)| [name, rest])
        .flatten()
        .collect();
    file.write_all(&sorted)
}

fn to_io(error: exr::error::Error) -> io::Error {
    match error {
        exr::error::Error::Io(error) => error,
        other => io::Error::other(other.to_string()),
    }
}
