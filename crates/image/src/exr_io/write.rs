//! Writes EXR files.

use std::borrow::Cow;
use std::fs::File;
use std::io::{self, BufRead, BufReader, BufWriter, Cursor, Read, Seek, SeekFrom, Write};
use std::ops::Range;
use std::path::Path;

use exr::block::chunk::{Chunk, CompressedBlock, CompressedScanLineBlock};
use exr::block::writer::ChunksWriter as _;
use exr::meta::attribute::{
    AttributeValue, ChannelDescription, Chromaticities, IntegerBounds, LineOrder, SampleType, Text,
};
use exr::meta::header::{Header, ImageAttributes, LayerAttributes};
use exr::meta::{BlockDescription, Headers};
use exr::prelude::{Compression, Vec2};
use rayon::prelude::*;

use super::ATTRIBUTE_PREFIX;
use crate::atomic::{self, WriteError};
use crate::planes::{Image, Placement};

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

/// Writes an image of `height` rows that is never in memory as a whole. `rows` is called with
/// ranges of rows, from the top, and returns an image of these rows. The image `first` has the
/// channels, the attributes and the width of all of them; its own rows and its placement are
/// ignored. The bytes are those that [`write()`] writes of the whole image.
///
/// # Errors
/// [`WriteError`], which names the path; also if rows have other channels or another size than
/// asked for.
pub fn write_rows(
    path: impl AsRef<Path>,
    first: &Image,
    [width, height]: [usize; 2],
    mut rows: impl FnMut(Range<usize>) -> io::Result<Image>,
) -> Result<(), WriteError> {
    atomic::write(path, |file: &mut File| {
        let placement = Placement {
            x: 0,
            y: 0,
            frame_width: width,
            frame_height: height,
        };
        let header = header(first, [width, height], placement)?;
        let names: Vec<String> = first.channels().map(|(name, _)| name.to_owned()).collect();
        write_blocks(file, header, (0, height), |blocks| {
            let range = blocks.start * BLOCK..height.min(blocks.end * BLOCK);
            let expected = [width, range.len()];
            let band = rows(range)?;
            let alike = [band.width(), band.height()] == expected
                && band
                    .channels()
                    .map(|(name, _)| name)
                    .eq(names.iter().map(String::as_str));
            if !alike {
                return Err(io::Error::other("rows of another size or with other channels"));
            }
            Ok((Cow::Owned(band), blocks.start))
        })
    })
}

/// Writes to an empty target that is positioned at its start.
fn encode_into<W: Read + Write + Seek>(image: &Image, out: &mut W) -> io::Result<()> {
    let header = header(image, [image.width(), image.height()], image.placement())?;
    let rows = (image.placement().y, image.height());
    write_blocks(out, header, rows, |_| Ok((Cow::Borrowed(image), 0)))
}

/// Writes a header and the blocks of `height` rows, of which the first has the coordinate `y`.
/// `source` returns an image with the rows of some blocks, and the number of its first block.
fn write_blocks<'i, W: Read + Write + Seek>(
    out: &mut W,
    header: Header,
    (y, height): (i32, usize),
    mut source: impl FnMut(Range<usize>) -> io::Result<(Cow<'i, Image>, usize)>,
) -> io::Result<()> {
    let mut buffered = BufWriter::new(&mut *out);
    exr::block::write(
        &mut buffered,
        Headers::from_vec(vec![header]),
        true,
        |_, writer| {
            let blocks = height.div_ceil(BLOCK);
            // A batch at a time, so that few compressed blocks are in memory.
            let batch = 4 * rayon::current_num_threads();
            for start in (0..blocks).step_by(batch) {
                let numbers = start..blocks.min(start + batch);
                let (image, first) = source(numbers.clone())?;
                let numbers = numbers.into_par_iter();
                let compressed: Vec<Vec<u8>> =
                    numbers.map(|block| compressed(&image, block - first)).collect();
                for (block, compressed_pixels_le) in (start..).zip(compressed) {
                    // The sizes and offsets are far below 2^31.
                    let y_coordinate = y + (block * BLOCK) as i32;
                    let chunk = Chunk {
                        layer_index: 0,
                        compressed_block: CompressedBlock::ScanLine(CompressedScanLineBlock {
                            y_coordinate,
                            compressed_pixels_le,
                        }),
                    };
                    writer.write_chunk(block, chunk)?;
                }
            }
            Ok(())
        },
    )
    .map_err(to_io)?;
    buffered.flush()?;
    drop(buffered);
    sort_attributes(out)
}

/// Number of lines in a block of ZIP compression.
const BLOCK: usize = 16;

/// Level of deflate. Compared with level 4, which the `exr` crate uses, it takes a quarter of the
/// time, and files are 6% larger.
const LEVEL: u8 = 1;

/// A block of lines as it is in the file: compressed, unless that makes it larger.
///
/// ZIP compression of OpenEXR: the samples, line by line and channel by channel in little-endian
/// order; of these, the bytes at even places, then those at odd places; of these, the differences
/// of neighbours plus 128, in a zlib stream.
fn compressed(image: &Image, block: usize) -> Vec<u8> {
    let width = image.width();
    let lines = block * BLOCK..image.height().min((block + 1) * BLOCK);
    // Line by line, and of each line channel by channel.
    let rows = || {
        let planes = |line: usize| {
            image
                .channels()
                .map(move |(_, plane)| &plane[line * width..][..width])
        };
        lines.clone().flat_map(planes)
    };
    let samples = width * lines.len() * image.channels().len();
    let mut halves = vec![0; 4 * samples];
    let (even, odd) = halves.split_at_mut(2 * samples);
    let (mut even, mut odd) = (even.as_chunks_mut::<2>().0, odd.as_chunks_mut::<2>().0);
    for row in rows() {
        let (even_row, odd_row);
        (even_row, even) = even.split_at_mut(width);
        (odd_row, odd) = odd.split_at_mut(width);
        for ((even, odd), sample) in even_row.iter_mut().zip(odd_row).zip(row) {
            // With shifts, which can be vectorised: bytes 0 and 2, and bytes 1 and 3.
            let bits = sample.to_bits();
            let pair = |bits: u32| ((bits & 0xff | bits >> 8 & 0xff00) as u16).to_le_bytes();
            (*even, *odd) = (pair(bits), pair(bits >> 8));
        }
    }
    // Not in place, so that no difference waits for the one before.
    let mut differences = halves.clone();
    for ((difference, byte), before) in differences[1..].iter_mut().zip(&halves[1..]).zip(&halves) {
        *difference = byte.wrapping_sub(*before).wrapping_add(128);
    }
    let compressed = miniz_oxide::deflate::compress_to_vec_zlib(&differences, LEVEL);
    if compressed.len() < halves.len() {
        compressed
    } else {
        rows().flatten().flat_map(|sample| sample.to_le_bytes()).collect()
    }
}

/// The header of an image of this size and placement with the channels and attributes of `image`.
fn header(image: &Image, [width, height]: [usize; 2], at: Placement) -> io::Result<Header> {
    let invalid = |text: &str| io::Error::new(io::ErrorKind::InvalidInput, text);
    if image.channels().len() == 0 {
        return Err(invalid("the image has no channels"));
    }
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
    Ok(Header::new(Text::default(), Vec2(width, height), channels)
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
        }))
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
