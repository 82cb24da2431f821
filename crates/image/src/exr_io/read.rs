//! Reads EXR files.

use std::collections::{BTreeMap, HashSet};
use std::io::{BufReader, Cursor, Read, Seek, SeekFrom};
use std::path::Path;

use exr::block::UncompressedBlock;
use exr::block::chunk::{Chunk, CompressedBlock};
use exr::meta::attribute::{AttributeValue, SampleType};
use exr::meta::header::Header;
use exr::meta::{BlockDescription, MetaData};
use exr::prelude::{Compression, Vec2, f16};

use super::ATTRIBUTE_PREFIX;
use crate::limits::{self, Limits, ReadError, ReadFault, no_panic};
use crate::planes::{Image, Placement};

/// First bytes of every EXR file.
pub(crate) const MAGIC: [u8; 4] = [0x76, 0x2f, 0x31, 0x01];

/// Minimum size of a chunk in bytes: its entry in the offset table, its coordinate and its length.
const MIN_CHUNK_BYTES: u64 = 8 + 4 + 4;

/// Reads all channels of an EXR file, and its `whitstone:*` attributes. [`Limits::IMAGE`] are
/// sensible limits.
///
/// # Errors
/// [`ReadError`], which names the path; see the [module](super) for unsupported files.
pub fn read(path: impl AsRef<Path>, limits: Limits) -> Result<Image, ReadError> {
    let path = path.as_ref();
    let file = limits::open(path).map_err(|fault| fault.at(path))?;
    let Decoded { image, .. } = decode_channels(file, limits, |_| true).map_err(|fault| fault.at(path))?;
    Ok(image)
}

/// As [`read`], from memory.
///
/// # Errors
/// As [`read`].
pub fn decode(bytes: &[u8], limits: Limits) -> Result<Image, ReadFault> {
    decode_channels(Cursor::new(bytes), limits, |_| true).map(|decoded| decoded.image)
}

/// What [`decode_channels`] reads.
pub(crate) struct Decoded {
    pub(crate) image: Image,
    /// The names of all channels of the file.
    pub(crate) names: Vec<String>,
    /// Whether a colour channel holds half-precision numbers.
    pub(crate) half_colors: bool,
}

/// Reads the channels whose names `keep` accepts; the others do not count towards the limits.
pub(crate) fn decode_channels(
    mut source: impl Read + Seek,
    limits: Limits,
    keep: impl Fn(&str) -> bool,
) -> Result<Decoded, ReadFault> {
    let length = source.seek(SeekFrom::End(0))?;
    source.rewind()?;
    let mut magic = [0; MAGIC.len()];
    let complete = length >= magic.len() as u64;
    if complete {
        source.read_exact(&mut magic)?;
        source.rewind()?;
    }
    if !complete || magic != MAGIC {
        return Err(ReadFault::UnknownFormat {
            expected: "an OpenEXR file",
        });
    }
    no_panic(|| decode_parts(BufReader::new(source), length, limits, keep))
}

fn decode_parts(
    source: BufReader<impl Read + Seek>,
    length: u64,
    limits: Limits,
    keep: impl Fn(&str) -> bool,
) -> Result<Decoded, ReadFault> {
    let reader = exr::block::read(source, false).map_err(to_fault)?;
    let meta = reader.meta_data().clone();
    check_headers(&meta, length, limits)?;
    let names = channel_names(&meta);
    let Some(first) = meta.headers.first() else {
        return Err(ReadFault::Damaged("the file has no parts".to_owned()));
    };
    let (width, height) = (first.layer_size.width(), first.layer_size.height());
    let kept = names.iter().flatten().filter(|name| keep(name)).count();
    limits.check(width, height, 4 * kept)?;

    // One plane for each accepted channel, `None` for the others.
    let mut planes: Vec<Vec<Option<Vec<f32>>>> = names
        .iter()
        .map(|part| {
            part.iter()
                .map(|name| keep(name).then(|| vec![0.0; width * height]))
                .collect()
        })
        .collect();
    let chunks = reader
        .filter_chunks(false, |_, tile, _| tile.is_largest_resolution_level())
        .map_err(to_fault)?;
    let mut seen = HashSet::new();
    let mut covered = vec![0_usize; meta.headers.len()];
    for chunk in chunks {
        let chunk = chunk.map_err(to_fault)?;
        check_dwa_counters(&chunk, &meta)?;
        let block = UncompressedBlock::decompress_chunk(chunk, &meta, false).map_err(to_fault)?;
        let (at, size, part) = (
            block.index.pixel_position,
            block.index.pixel_size,
            block.index.layer,
        );
        let header = &meta.headers[part];
        if block.index.level != Vec2(0, 0) || !seen.insert((part, at.x(), at.y())) {
            return Err(ReadFault::Damaged(format!(
                "the block at column {}, row {} occurs twice",
                at.x(),
                at.y()
            )));
        }
        if block.data.len() != size.area() * header.channels.bytes_per_pixel {
            return Err(ReadFault::Damaged(format!(
                "the block at column {}, row {} has {} bytes where {} are needed",
                at.x(),
                at.y(),
                block.data.len(),
                size.area() * header.channels.bytes_per_pixel
            )));
        }
        covered[part] += size.area();
        for line in block.lines(&header.channels) {
            let Some(plane) = &mut planes[part][line.location.channel] else {
                continue;
            };
            let start = line.location.position.y() * width + line.location.position.x();
            let samples = &mut plane[start..start + line.location.sample_count];
            convert(
                line.value,
                header.channels.list[line.location.channel].sample_type,
                samples,
            );
        }
    }
    if covered.iter().any(|&pixels| pixels != width * height) {
        return Err(ReadFault::Damaged("the file lacks some blocks".to_owned()));
    }
    let kinds = meta.headers.iter().flat_map(|header| &header.channels.list);
    let is_plain = |name: &str| ["R", "G", "B"].contains(&name);
    // Of files with layers the colours are those of one of them.
    let has_plain = names.iter().flatten().any(|name| is_plain(name));
    let is_color = |name: &str| match has_plain {
        true => is_plain(name),
        false => name.ends_with(['R', 'G', 'B', 'Y']),
    };
    let half_colors = (names.iter().flatten().zip(kinds))
        .any(|(name, channel)| channel.sample_type == SampleType::F16 && is_color(name));
    let all = names.iter().flatten().cloned().collect();
    Ok(Decoded {
        image: assemble(&meta, names, planes)?,
        names: all,
        half_colors,
    })
}

/// Converts native-endian samples of the decoder to `f32`.
fn convert(bytes: &[u8], kind: SampleType, samples: &mut [f32]) {
    match kind {
        SampleType::F16 => fill(bytes, samples, |bytes| f16::from_ne_bytes(bytes).to_f32()),
        SampleType::F32 => fill(bytes, samples, f32::from_ne_bytes),
        SampleType::U32 => fill(bytes, samples, |bytes| u32::from_ne_bytes(bytes) as f32),
    }
}

fn fill<const N: usize>(bytes: &[u8], samples: &mut [f32], value: impl Fn([u8; N]) -> f32) {
    for (sample, &bytes) in samples.iter_mut().zip(bytes.as_chunks::<N>().0) {
        *sample = value(bytes);
    }
}

fn check_headers(meta: &MetaData, length: u64, limits: Limits) -> Result<(), ReadFault> {
    let mut chunks = 0_u64;
    for header in &meta.headers {
        limits.check(header.layer_size.width(), header.layer_size.height(), 0)?;
        if let BlockDescription::Tiles(tiles) = header.blocks {
            // A tile may be larger than the image, and is always decoded completely.
            let (width, height) = (tiles.tile_size.width(), tiles.tile_size.height());
            let bytes = width as u128 * height as u128 * header.channels.bytes_per_pixel as u128;
            if bytes > u128::from(limits.max_bytes) {
                return Err(ReadFault::TooLarge {
                    width,
                    height,
                    bytes,
                    limits,
                });
            }
        }
        chunks = chunks.saturating_add(header.chunk_count as u64);
    }
    if chunks.saturating_mul(MIN_CHUNK_BYTES) > length {
        return Err(ReadFault::Damaged(format!(
            "{length} bytes cannot hold the {chunks} blocks of the image"
        )));
    }
    let window = |header: &Header| (header.own_attributes.layer_position, header.layer_size);
    if meta
        .headers
        .iter()
        .any(|header| window(header) != window(&meta.headers[0]))
    {
        return Err(ReadFault::Unsupported(
            "parts with different data windows; all parts must have the same one".to_owned(),
        ));
    }
    Ok(())
}

/// Names of the channels of each part, unique in the file.
fn channel_names(meta: &MetaData) -> Vec<Vec<String>> {
    let mut taken = HashSet::new();
    meta.headers
        .iter()
        .map(|header| {
            let part = header
                .own_attributes
                .layer_name
                .as_ref()
                .map(|name| lossy(name.as_slice()))
                .unwrap_or_default();
            header
                .channels
                .list
                .iter()
                .map(|channel| {
                    let plain = lossy(channel.name.as_slice());
                    let name = if taken.contains(&plain) {
                        format!("{part}.{plain}")
                    } else {
                        plain
                    };
                    taken.insert(name.clone());
                    name
                })
                .collect()
        })
        .collect()
}

fn assemble(
    meta: &MetaData,
    names: Vec<Vec<String>>,
    planes: Vec<Vec<Option<Vec<f32>>>>,
) -> Result<Image, ReadFault> {
    let damaged = |error: crate::planes::ImageError| ReadFault::Damaged(error.to_string());
    let first = &meta.headers[0];
    let mut image = Image::new(first.layer_size.width(), first.layer_size.height()).map_err(damaged)?;
    for (name, plane) in names.into_iter().flatten().zip(planes.into_iter().flatten()) {
        if let Some(plane) = plane {
            image.add_channel(name, plane).map_err(damaged)?;
        }
    }

    let display = first.shared_attributes.display_window;
    let data = first.own_attributes.layer_position;
    let offset = |data: i32, display: i32| {
        data.checked_sub(display)
            .ok_or_else(|| ReadFault::Damaged("the windows are too far apart".to_owned()))
    };
    image.set_placement(Placement {
        x: offset(data.x(), display.position.x())?,
        y: offset(data.y(), display.position.y())?,
        frame_width: display.size.width(),
        frame_height: display.size.height(),
    });

    let mut attributes = BTreeMap::new();
    for (name, value) in first
        .shared_attributes
        .other
        .iter()
        .chain(&first.own_attributes.other)
    {
        if let (Some(name), AttributeValue::Text(text)) =
            (lossy(name.as_slice()).strip_prefix(ATTRIBUTE_PREFIX), value)
        {
            attributes.insert(name.to_owned(), lossy(text.as_slice()));
        }
    }
    for (name, value) in attributes {
        image.set_attribute(name, value).map_err(damaged)?;
    }
    Ok(image)
}

/// Rejects counters at the start of a DWA block that are too large for its size. The decoder
/// allocates that much before it reads the data, and a failed allocation ends the program.
fn check_dwa_counters(chunk: &Chunk, meta: &MetaData) -> Result<(), ReadFault> {
    /// Indices, among the eleven 64-bit counters, of the output sizes: bytes of the unknown stage
    /// and of the two run-length stages, AC and DC coefficients.
    const OUTPUT_COUNTERS: [usize; 5] = [1, 6, 7, 8, 9];
    let Some(header) = meta.headers.get(chunk.layer_index) else {
        return Err(ReadFault::Damaged(
            "a block refers to a part that does not exist".to_owned(),
        ));
    };
    let data = match &chunk.compressed_block {
        CompressedBlock::ScanLine(block) => &block.compressed_pixels_le,
        CompressedBlock::Tile(block) => &block.compressed_pixels_le,
        _ => return Ok(()),
    };
    if !matches!(header.compression, Compression::DWAA(_) | Compression::DWAB(_)) {
        return Ok(());
    }
    let tile = header
        .get_block_data_indices(&chunk.compressed_block)
        .map_err(to_fault)?;
    let size = header
        .get_absolute_block_pixel_coordinates(tile)
        .map_err(to_fault)?
        .size;
    if data.len() == size.area() * header.channels.bytes_per_pixel {
        // Stored uncompressed, because compression would not have helped.
        return Ok(());
    }
    // Coefficients come in blocks of 8 x 8; no stage holds more than twice the bytes of the
    // samples.
    let bound = (size.width() as u64 + 8)
        .saturating_mul(size.height() as u64 + 8)
        .saturating_mul(8 * header.channels.list.len() as u64)
        .saturating_add(4096);
    let counters = data.as_chunks::<8>().0;
    for index in OUTPUT_COUNTERS {
        if counters
            .get(index)
            .is_some_and(|&bytes| u64::from_le_bytes(bytes) > bound)
        {
            return Err(ReadFault::Damaged(
                "a DWA block declares more data than its pixels can need".to_owned(),
            ));
        }
    }
    Ok(())
}

fn lossy(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

fn to_fault(error: exr::error::Error) -> ReadFault {
    match error {
        exr::error::Error::Io(error) => ReadFault::Io(error),
        exr::error::Error::NotSupported(reason) => ReadFault::Unsupported(reason.into_owned()),
        exr::error::Error::Invalid(reason) => ReadFault::Damaged(reason.into_owned()),
        exr::error::Error::Aborted => ReadFault::Damaged("reading was cancelled".to_owned()),
    }
}
