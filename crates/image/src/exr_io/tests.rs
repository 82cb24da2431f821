use std::io::Cursor;

use exr::prelude::{
    AnyChannel, AnyChannels, AttributeValue, Blocks, Compression, Encoding, FlatSamples, IntegerBounds,
    Layer, LayerAttributes, LineOrder, SmallVec, Text, Vec2, WritableImage as _, f16,
};
use proptest::prelude::*;

use super::*;
use crate::limits::{Limits, ReadFault};
use crate::planes::{Image, Placement};
use crate::test_data;

fn sample(width: usize, height: usize) -> Image {
    let mut image = Image::from_fn(width, height, |x, y| {
        [x as f32 / 7.0, -(y as f32), (x * y) as f32 * 1e-3]
    })
    .unwrap();
    let special = [
        f32::NAN,
        f32::INFINITY,
        f32::NEG_INFINITY,
        -0.0,
        f32::MIN_POSITIVE / 4.0,
        f32::MAX,
    ];
    let pixels = image.pixel_count();
    image
        .add_channel("depth.Z", special.into_iter().cycle().take(pixels).collect())
        .unwrap();
    image
        .add_channel("shape_id.I", (0..pixels).map(|i| i as f32 - 1.0).collect())
        .unwrap();
    for (name, value) in [
        ("scene_hash", "0123abcd"),
        ("samples", "16"),
        ("version", "0.1.0"),
        ("note", "größer, ∞"),
    ] {
        image.set_attribute(name, value).unwrap();
    }
    image
}

/// Bitwise equality, including NaN.
fn assert_same(a: &Image, b: &Image) {
    assert_eq!(
        (a.width(), a.height(), a.placement()),
        (b.width(), b.height(), b.placement())
    );
    assert_eq!(a.attributes(), b.attributes());
    let bits = |image: &Image| -> Vec<(String, Vec<u32>)> {
        image
            .channels()
            .map(|(name, plane)| (name.to_owned(), plane.iter().map(|v| v.to_bits()).collect()))
            .collect()
    };
    assert_eq!(bits(a), bits(b));
}

/// An EXR file of any kind, written by the `exr` crate itself.
fn foreign(
    size: (usize, usize),
    channels: Vec<(&str, FlatSamples)>,
    encoding: Encoding,
    attributes: LayerAttributes,
    display: Option<IntegerBounds>,
) -> Vec<u8> {
    let list: Vec<_> = channels
        .into_iter()
        .map(|(name, samples)| AnyChannel::new(name, samples))
        .collect();
    let channels = AnyChannels::sort(SmallVec::from_vec(list));
    let mut image = exr::prelude::Image::from_layer(Layer::new(size, attributes, encoding, channels));
    if let Some(display) = display {
        image.attributes.display_window = display;
    }
    let mut bytes = Cursor::new(Vec::new());
    image.write().non_parallel().to_buffered(&mut bytes).unwrap();
    bytes.into_inner()
}

fn encodings() -> Vec<Encoding> {
    use Compression::{B44, B44A, DWAA, DWAB, PIZ, PXR24, RLE, Uncompressed, ZIP1, ZIP16};
    let mut all = Vec::new();
    for compression in [
        Uncompressed,
        RLE,
        ZIP1,
        ZIP16,
        PIZ,
        PXR24,
        B44,
        B44A,
        DWAA(None),
        DWAB(None),
    ] {
        for blocks in [Blocks::ScanLines, Blocks::Tiles(Vec2(16, 8))] {
            all.push(Encoding {
                compression,
                blocks,
                line_order: LineOrder::Increasing,
            });
        }
    }
    all
}

fn ramp(count: usize) -> Vec<f32> {
    (0..count).map(|i| (i % 64) as f32 / 64.0).collect()
}

#[test]
fn round_trip_keeps_every_bit() {
    for (width, height) in [(1, 1), (37, 53), (5, 16), (300, 3)] {
        let image = sample(width, height);
        assert_same(&decode(&encode(&image).unwrap(), Limits::IMAGE).unwrap(), &image);
    }
}

#[test]
fn files_round_trip_and_equal_images_give_equal_bytes() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.exr");
    let image = sample(64, 200);
    write(&path, &image).unwrap();
    assert_same(&read(&path, Limits::IMAGE).unwrap(), &image);
    let bytes = std::fs::read(&path).unwrap();
    // The writer's hash map has other keys every time.
    for _ in 0..8 {
        assert!(encode(&image).unwrap() == bytes);
    }
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
}

#[test]
fn the_header_has_the_documented_contents() {
    let bytes = encode(&sample(8, 8)).unwrap();
    let meta = exr::meta::MetaData::read_from_buffered(bytes.as_slice(), true).unwrap();
    let header = &meta.headers[0];
    assert_eq!(header.compression, Compression::ZIP16);
    assert_eq!(header.blocks, exr::meta::BlockDescription::ScanLines);
    assert!(
        header
            .channels
            .list
            .iter()
            .all(|c| c.sample_type == exr::prelude::SampleType::F32)
    );
    let chromaticities = header.shared_attributes.chromaticities.unwrap();
    assert_eq!(chromaticities.red, Vec2(0.64, 0.33));
    assert_eq!(chromaticities.white, Vec2(0.3127, 0.329));
    let hash = header
        .own_attributes
        .other
        .get(&Text::from("whitstone:scene_hash"));
    assert_eq!(hash, Some(&AttributeValue::Text(Text::from("0123abcd"))));
    // Channels and attributes in the order of their names.
    let position = |text: &str| {
        bytes
            .windows(text.len())
            .position(|window| window == text.as_bytes())
            .unwrap()
    };
    assert!(position("chromaticities\0") < position("compression\0"));
    assert!(position("whitstone:samples\0") < position("whitstone:scene_hash\0"));
}

#[test]
fn placement_round_trips_and_different_windows_do_not_compare() {
    let mut image = sample(4, 3);
    image.set_placement(Placement {
        x: -2,
        y: 5,
        frame_width: 100,
        frame_height: 50,
    });
    assert_same(&decode(&encode(&image).unwrap(), Limits::IMAGE).unwrap(), &image);

    let attributes = LayerAttributes {
        layer_position: Vec2(7, -3),
        ..LayerAttributes::default()
    };
    let display = IntegerBounds::new(Vec2(5, -10), Vec2(40, 30));
    let samples = vec![("R", FlatSamples::F32(ramp(6)))];
    let bytes = foreign(
        (3, 2),
        samples,
        Encoding::FAST_LOSSLESS,
        attributes,
        Some(display),
    );
    let image = decode(&bytes, Limits::IMAGE).unwrap();
    assert_eq!((image.width(), image.height()), (3, 2));
    assert_eq!(
        image.placement(),
        Placement {
            x: 2,
            y: 7,
            frame_width: 40,
            frame_height: 30
        }
    );
    assert_eq!(image.channel("R").unwrap(), ramp(6));

    image_refuses(|placement| placement.frame_width = 0);
    image_refuses(|placement| placement.frame_height = usize::MAX);
    image_refuses(|placement| placement.x = i32::MIN);
    image_refuses(|placement| placement.y = i32::MAX);
}

fn image_refuses(change: impl Fn(&mut Placement)) {
    let mut image = sample(2, 2);
    let mut placement = image.placement();
    change(&mut placement);
    image.set_placement(placement);
    assert_eq!(
        encode(&image).unwrap_err().kind(),
        std::io::ErrorKind::InvalidInput
    );
}

#[test]
fn an_image_without_channels_is_not_written() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("none.exr");
    let error = write(&path, &Image::new(2, 2).unwrap()).unwrap_err();
    assert!(
        error.to_string().contains("none.exr") && error.to_string().contains("no channels"),
        "{error}"
    );
    assert!(!path.exists());
}

#[test]
fn every_encoding_and_sample_type_is_read() {
    let (width, height) = (50, 41);
    let count = width * height;
    for encoding in encodings() {
        let half: Vec<f16> = ramp(count).into_iter().map(f16::from_f32).collect();
        let uint: Vec<u32> = (0..count as u32).collect();
        let channels = vec![
            ("Hf", FlatSamples::F16(half)),
            ("R", FlatSamples::F32(ramp(count))),
            ("id", FlatSamples::U32(uint)),
        ];
        let bytes = foreign(
            (width, height),
            channels,
            encoding,
            LayerAttributes::default(),
            None,
        );
        let image = decode(&bytes, Limits::IMAGE).unwrap_or_else(|fault| panic!("{encoding:?}: {fault}"));
        assert_eq!((image.width(), image.height()), (width, height), "{encoding:?}");
        let expected: Vec<f32> = (0..count).map(|i| i as f32).collect();
        assert_eq!(image.channel("id").unwrap(), expected, "{encoding:?}");
        let lossy = encoding.compression.may_loose_data();
        for name in ["Hf", "R"] {
            let worst = image
                .channel(name)
                .unwrap()
                .iter()
                .zip(ramp(count))
                .map(|(a, b)| (a - b).abs())
                .fold(0.0, f32::max);
            assert!(
                worst <= if lossy { 0.3 } else { 0.0 },
                "{encoding:?} {name}: {worst}"
            );
        }
    }
}

#[test]
fn parts_are_merged_and_channel_names_stay_distinct() {
    let part = |name: &str, channels: Vec<&'static str>, size| {
        let list: Vec<_> = channels
            .into_iter()
            .map(|c| AnyChannel::new(c, FlatSamples::F32(ramp(6))))
            .collect();
        Layer::new(
            size,
            LayerAttributes::named(name),
            Encoding::FAST_LOSSLESS,
            AnyChannels::sort(SmallVec::from_vec(list)),
        )
    };
    let bytes = |second: (usize, usize)| {
        let image = exr::prelude::Image::empty(exr::prelude::ImageAttributes::with_size((3, 2)))
            .with_layer(part("beauty", vec!["R", "G"], (3, 2)))
            .with_layer(part("other", vec!["R", "Z"], second));
        let mut bytes = Cursor::new(Vec::new());
        image.write().non_parallel().to_buffered(&mut bytes).unwrap();
        bytes.into_inner()
    };
    let image = decode(&bytes((3, 2)), Limits::IMAGE).unwrap();
    assert_eq!(
        image.channels().map(|(name, _)| name).collect::<Vec<_>>(),
        ["G", "R", "Z", "other.R"]
    );
    assert!(matches!(
        decode(&bytes((2, 3)), Limits::IMAGE),
        Err(ReadFault::Unsupported(_))
    ));
}

#[test]
fn limits_are_checked_and_named() {
    let bytes = encode(&sample(20, 10)).unwrap();
    for limits in [
        Limits {
            max_width: 19,
            ..Limits::IMAGE
        },
        Limits {
            max_height: 9,
            ..Limits::IMAGE
        },
        Limits {
            max_bytes: 20 * 10 * 4 * 5 - 1,
            ..Limits::IMAGE
        },
    ] {
        let fault = decode(&bytes, limits).unwrap_err();
        assert!(
            matches!(
                fault,
                ReadFault::TooLarge {
                    width: 20,
                    height: 10,
                    ..
                }
            ),
            "{fault}"
        );
        assert!(
            fault.to_string().contains(&limits.max_bytes.to_string()),
            "{fault}"
        );
    }
    assert!(
        decode(
            &bytes,
            Limits {
                max_width: 20,
                max_height: 10,
                max_bytes: 20 * 10 * 4 * 5
            }
        )
        .is_ok()
    );
}

/// Rewrites the data window in the header.
fn with_data_window(bytes: &[u8], window: [i32; 4]) -> Vec<u8> {
    let mark = b"dataWindow\0box2i\0\x10\0\0\0";
    let start = bytes.windows(mark.len()).position(|w| w == mark).unwrap() + mark.len();
    let mut changed = bytes.to_vec();
    for (slot, value) in changed[start..].as_chunks_mut::<4>().0.iter_mut().zip(window) {
        *slot = value.to_le_bytes();
    }
    changed
}

#[test]
fn a_small_file_with_a_huge_declared_size_is_rejected() {
    let bytes = encode(&sample(20, 10)).unwrap();
    for (right, bottom) in [
        (65535, 65535),
        (1 << 29, 1 << 29),
        (i32::MAX, i32::MAX),
        (1 << 26, 0),
    ] {
        let fault = decode(&with_data_window(&bytes, [0, 0, right, bottom]), Limits::IMAGE).unwrap_err();
        assert!(
            matches!(fault, ReadFault::TooLarge { .. } | ReadFault::Damaged(_)),
            "{fault}"
        );
    }
    // Within the limits, but not with this few bytes.
    let mark = b"chunkCount\0int\0\x04\0\0\0";
    let mut changed = with_data_window(&bytes, [0, 0, 99, 16383]);
    let count = changed.windows(mark.len()).position(|w| w == mark).unwrap() + mark.len();
    changed[count..count + 4].copy_from_slice(&1024_i32.to_le_bytes());
    let fault = decode(&changed, Limits::IMAGE).unwrap_err();
    assert!(
        matches!(&fault, ReadFault::Damaged(reason) if reason.contains("cannot hold")),
        "{fault}"
    );
}

#[test]
fn a_dwa_block_cannot_declare_terabytes() {
    let channels = vec![(
        "R",
        FlatSamples::F16(ramp(1024).into_iter().map(f16::from_f32).collect()),
    )];
    let encoding = Encoding {
        compression: Compression::DWAA(None),
        blocks: Blocks::ScanLines,
        line_order: LineOrder::Increasing,
    };
    let bytes = foreign((32, 32), channels, encoding, LayerAttributes::default(), None);
    assert!(decode(&bytes, Limits::IMAGE).is_ok());
    // The block: y, length, then the counters.
    let meta = exr::meta::MetaData::read_from_buffered(bytes.as_slice(), true).unwrap();
    assert_eq!(meta.headers[0].chunk_count, 1);
    let mut claims = 0;
    for start in 0..bytes.len().saturating_sub(88) {
        // The first counter is the version, 2; the unknown section is empty.
        if bytes[start..start + 16] == [2, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0] {
            for counter in [1, 6, 7, 8, 9] {
                let mut changed = bytes.clone();
                changed[start + 8 * counter..][..8].copy_from_slice(&(1_u64 << 45).to_le_bytes());
                let fault = decode(&changed, Limits::IMAGE).unwrap_err();
                claims += usize::from(matches!(&fault, ReadFault::Damaged(reason) if reason.contains("DWA")));
            }
        }
    }
    assert_eq!(claims, 5);
}

#[test]
fn missing_and_repeated_blocks_are_found() {
    let image = sample(8, 48);
    let bytes = encode(&image).unwrap();
    // The offset table: three entries right after the header.
    let meta_end = bytes.windows(8).position(|w| {
        let offset = u64::from_le_bytes(w.try_into().unwrap()) as usize;
        offset < bytes.len() && bytes[offset.min(bytes.len() - 4)..].starts_with(&[0; 4]) && offset > 300
    });
    let table = meta_end.unwrap();
    let mut repeated = bytes.clone();
    repeated.copy_within(table..table + 8, table + 8);
    assert!(
        matches!(decode(&repeated, Limits::IMAGE), Err(ReadFault::Damaged(reason)) if reason.contains("twice"))
    );
    let mut absent = bytes.clone();
    absent[table + 8..table + 16].fill(0);
    assert!(decode(&absent, Limits::IMAGE).is_err());
}

#[test]
fn every_truncation_is_an_error() {
    let bytes = encode(&sample(20, 40)).unwrap();
    for length in 0..bytes.len() {
        assert!(
            decode(&bytes[..length], Limits::IMAGE).is_err(),
            "{length} of {} bytes",
            bytes.len()
        );
    }
}

#[test]
fn other_files_are_not_exr() {
    for bytes in [&b""[..], b"\x76\x2f", b"\x89PNG\r\n\x1a\n", b"hello, world"] {
        assert!(matches!(
            decode(bytes, Limits::IMAGE),
            Err(ReadFault::UnknownFormat { .. })
        ));
    }
    let error = read("no/such/file.exr", Limits::IMAGE).unwrap_err();
    assert!(
        error.to_string().contains("file.exr") && matches!(error.fault, ReadFault::Io(_)),
        "{error}"
    );
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    /// Corrupted bytes give another image or an error, never a panic. The decoder's own panics are
    /// caught.
    #[test]
    fn changed_bytes_never_panic(changes in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..6)) {
        let limits = Limits { max_width: 512, max_height: 512, max_bytes: 16 << 20 };
        for encoding in encodings() {
            let half = ramp(400).into_iter().map(f16::from_f32).collect();
            let channels = vec![("R", FlatSamples::F16(half)), ("Z", FlatSamples::F32(ramp(400)))];
            let mut bytes = foreign((20, 20), channels, encoding, LayerAttributes::default(), None);
            for (index, value) in &changes {
                let length = bytes.len();
                bytes[index.index(length)] = *value;
            }
            let _ = decode(&bytes, limits);
        }
    }
}

#[test]
fn public_test_images_are_read() {
    let Some(files) = test_data::files("exr/TestImages") else {
        return;
    };
    let mut read_any = false;
    for path in files
        .iter()
        .filter(|path| path.extension() == Some("exr".as_ref()))
    {
        let image = read(path, Limits::IMAGE).unwrap();
        read_any = true;
        let bad = image
            .channels()
            .flat_map(|(_, plane)| plane)
            .filter(|value| !value.is_finite())
            .count();
        // These two files contain such values on purpose; the others must have none.
        let special = ["AllHalfValues", "NanInf"]
            .iter()
            .any(|part| path.to_string_lossy().contains(part));
        assert_eq!(bad > 0, special, "{}: {bad}", path.display());
        assert_same(&decode(&encode(&image).unwrap(), Limits::IMAGE).unwrap(), &image);
    }
    assert!(read_any);
}

#[test]
fn public_windows_are_read() {
    let Some(files) = test_data::files("exr/DisplayWindow") else {
        return;
    };
    let placements: Vec<_> = files
        .iter()
        .filter(|path| path.extension() == Some("exr".as_ref()))
        .map(|path| {
            let image = read(path, Limits::IMAGE).unwrap();
            assert_eq!((image.width(), image.height()), (400, 300), "{}", path.display());
            image.placement()
        })
        .collect();
    assert!(placements.len() > 10);
    assert!(placements.iter().any(|at| at.x < 0) && placements.iter().any(|at| at.x > 0));
    assert!(
        placements.iter().any(|at| at.frame_width > 400) && placements.iter().any(|at| at.frame_width < 400)
    );
}

#[test]
fn public_damaged_files_give_errors() {
    let Some(files) = test_data::files("exr/Damaged-sample") else {
        return;
    };
    assert!(!files.is_empty());
    for path in files {
        let error = read(&path, Limits::IMAGE).unwrap_err();
        println!("refused: {error}");
    }
}

#[test]
fn public_environment_maps_are_read() {
    for folder in ["textures/hdri_exr_cc0", "textures/hdri_exr_cc0_zip256"] {
        let Some(files) = test_data::files(folder) else {
            return;
        };
        for path in files
            .iter()
            .filter(|path| path.extension() == Some("exr".as_ref()))
        {
            let image = read(path, Limits::IMAGE).unwrap();
            let values = image.rgb().unwrap().into_iter().flatten();
            let mean = values.map(|value| f64::from(value.abs())).sum::<f64>()
                / (3 * image.width() * image.height()) as f64;
            assert!(mean > 0.01 && mean < 100.0, "{}: {mean}", path.display());
        }
    }
}

/// An image that is written some rows at a time has the bytes of the whole one.
#[test]
fn rows_give_the_bytes_of_the_whole_image() {
    let folder = tempfile::tempdir().unwrap();
    for [width, height] in [[1, 1], [5, 16], [3, 17], [7, 700]] {
        let value = |x: usize, y: usize| (x * 31 + y * 17) as f32 * 0.37;
        let mut whole = Image::from_fn(width, height, |x, y| [value(x, y), f32::NAN, -value(y, x)]).unwrap();
        let depth = (0..width * height).map(|k| k as f32).collect();
        whole.add_channel("depth.Z", depth).unwrap();
        whole.set_attribute("scene_hash", "abc").unwrap();
        let part = |rows: std::ops::Range<usize>| {
            let mut part = Image::new(width, rows.len()).unwrap();
            for (name, plane) in whole.channels() {
                let values = plane[rows.start * width..rows.end * width].to_vec();
                part.add_channel(name, values).unwrap();
            }
            part
        };
        let mut first = part(0..1);
        first.set_attribute("scene_hash", "abc").unwrap();
        let path = folder.path().join("rows.exr");
        write_rows(&path, &first, [width, height], |rows| Ok(part(rows))).unwrap();
        let bytes = std::fs::read(&path).unwrap();
        assert!(bytes == encode(&whole).unwrap(), "{width} x {height}");
        // Other rows than asked for leave the file as it was.
        for wrong in [
            Image::new(width, height + 1).unwrap(),
            Image::new(width, 1).unwrap(),
        ] {
            let error = write_rows(&path, &first, [width, height], |_| Ok(wrong.clone())).unwrap_err();
            assert!(error.to_string().contains("rows of another size"), "{error}");
        }
        assert!(std::fs::read(&path).unwrap() == bytes);
    }
}
