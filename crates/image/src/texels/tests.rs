use image::codecs::jpeg::JpegEncoder;
use image::{ExtendedColorType, ImageBuffer, ImageFormat, Luma, LumaA, Rgb, Rgba};
use proptest::prelude::*;

use super::*;
use crate::test_data;

fn png(image: impl Into<DynamicImage>) -> Vec<u8> {
    let mut bytes = Cursor::new(Vec::new());
    image.into().write_to(&mut bytes, ImageFormat::Png).unwrap();
    bytes.into_inner()
}

fn exr(channels: &[(&str, Vec<f32>)]) -> Vec<u8> {
    let mut image = Image::new(3, 2).unwrap();
    for (name, samples) in channels {
        image.add_channel(*name, samples.clone()).unwrap();
    }
    exr_io::encode(&image).unwrap()
}

#[test]
fn codes_are_normalised_and_not_decoded() {
    let texels = decode(
        &png(ImageBuffer::from_fn(3, 2, |x, y| {
            Rgb([x as u8 * 100, y as u8, 255])
        })),
        Limits::TEXTURE,
    )
    .unwrap();
    assert_eq!(
        (texels.width, texels.height, texels.encoding),
        (3, 2, Encoding::Srgb8)
    );
    assert_eq!(texels.data[5], [200.0 / 255.0, 1.0 / 255.0, 1.0]);

    let texels = decode(
        &png(ImageBuffer::from_fn(3, 2, |x, _| {
            Rgb([x as u16 * 1000, 65535, 1])
        })),
        Limits::TEXTURE,
    )
    .unwrap();
    assert_eq!(texels.encoding, Encoding::Srgb16);
    assert_eq!(texels.data[2], [2000.0 / 65535.0, 1.0, 1.0 / 65535.0]);
}

#[test]
fn alpha_is_read_alone_or_reported_missing() {
    let alpha = |bytes: Vec<u8>| decode_from(Cursor::new(bytes), Limits::TEXTURE, Part::Alpha);
    for (bytes, expected) in [
        (png(ImageBuffer::from_pixel(1, 1, LumaA([9_u8, 51]))), 0.2),
        (png(ImageBuffer::from_pixel(1, 1, Rgba([9_u8, 8, 7, 51]))), 0.2),
        (png(ImageBuffer::from_pixel(1, 1, LumaA([9_u16, 13107]))), 0.2),
        (
            png(ImageBuffer::from_pixel(1, 1, Rgba([9_u16, 8, 7, 13107]))),
            0.2,
        ),
        (exr(&[("R", vec![0.5; 6]), ("A", vec![1.5; 6])]), 1.5),
        (exr(&[("A", vec![0.25; 6])]), 0.25),
    ] {
        assert_eq!(alpha(bytes).unwrap().data[0], [expected; 3]);
    }
    let mut jpeg = Vec::new();
    JpegEncoder::new(&mut jpeg)
        .encode(&[9; 3], 1, 1, ExtendedColorType::Rgb8)
        .unwrap();
    for bytes in [
        png(ImageBuffer::from_pixel(1, 1, Luma([9_u8]))),
        png(ImageBuffer::from_pixel(1, 1, Rgb([9_u16, 8, 7]))),
        exr(&[("R", vec![0.5; 6]), ("G", vec![0.5; 6]), ("B", vec![0.5; 6])]),
        jpeg,
    ] {
        assert!(matches!(alpha(bytes), Err(ReadFault::NoAlpha)));
    }
    let infinite = exr(&[("A", vec![0.0, f32::INFINITY, 0.0, 0.0, 0.0, 0.0])]);
    assert!(matches!(
        alpha(infinite),
        Err(ReadFault::NotFinite {
            channel: "A",
            x: 1,
            ..
        })
    ));
}

#[test]
fn alpha_is_ignored_and_grey_repeated() {
    let first = |bytes: Vec<u8>| decode(&bytes, Limits::TEXTURE).unwrap().data[0];
    let eight = 51.0 / 255.0;
    let sixteen = 13107.0 / 65535.0;
    assert_eq!(
        first(png(ImageBuffer::from_pixel(1, 1, Luma([51_u8])))),
        [eight; 3]
    );
    assert_eq!(
        first(png(ImageBuffer::from_pixel(1, 1, LumaA([51_u8, 0])))),
        [eight; 3]
    );
    assert_eq!(
        first(png(ImageBuffer::from_pixel(1, 1, Rgba([51_u8, 51, 51, 0])))),
        [eight; 3]
    );
    assert_eq!(
        first(png(ImageBuffer::from_pixel(1, 1, Luma([13107_u16])))),
        [sixteen; 3]
    );
    assert_eq!(
        first(png(ImageBuffer::from_pixel(1, 1, LumaA([13107_u16, 7])))),
        [sixteen; 3]
    );
    assert_eq!(
        first(png(ImageBuffer::from_pixel(
            1,
            1,
            Rgba([13107_u16, 13107, 13107, 7])
        ))),
        [sixteen; 3]
    );
}

#[test]
fn jpeg_is_read_and_its_truncation_found() {
    let mut bytes = Vec::new();
    let pixels: Vec<u8> = (0..64 * 64 * 3).map(|i| (i % 251) as u8).collect();
    JpegEncoder::new_with_quality(&mut bytes, 90)
        .encode(&pixels, 64, 64, ExtendedColorType::Rgb8)
        .unwrap();
    let texels = decode(&bytes, Limits::TEXTURE).unwrap();
    assert_eq!(
        (texels.width, texels.height, texels.encoding),
        (64, 64, Encoding::Srgb8)
    );

    let mut grey = Vec::new();
    JpegEncoder::new_with_quality(&mut grey, 100)
        .encode(&[51; 64], 8, 8, ExtendedColorType::L8)
        .unwrap();
    assert_eq!(
        decode(&grey, Limits::TEXTURE).unwrap().data,
        [[51.0 / 255.0; 3]; 64]
    );

    for length in 0..bytes.len() {
        assert!(
            decode(&bytes[..length], Limits::TEXTURE).is_err(),
            "{length} of {}",
            bytes.len()
        );
    }
}

/// The thumbnail in the metadata is a whole JPEG file with an end marker.
#[test]
fn the_end_of_a_thumbnail_is_not_that_of_a_jpeg() {
    let encoded = |size: u16| {
        let side = usize::from(size);
        let pixels: Vec<u8> = (0..side * side * 3).map(|i| (i % 251) as u8).collect();
        let mut bytes = Vec::new();
        JpegEncoder::new(&mut bytes)
            .encode(&pixels, size.into(), size.into(), ExtendedColorType::Rgb8)
            .unwrap();
        bytes
    };
    let (image, thumbnail) = (encoded(64), encoded(8));
    let mut bytes = image[..2].to_vec();
    bytes.extend([0xff, 0xe1]);
    bytes.extend((8 + thumbnail.len() as u16).to_be_bytes());
    bytes.extend(b"Exif\0\0");
    bytes.extend(&thumbnail);
    bytes.extend(&image[2..]);
    let expected = decode(&image, Limits::TEXTURE).unwrap();
    assert_eq!(decode(&bytes, Limits::TEXTURE).unwrap(), expected);
    assert!(to_png(&bytes, Limits::TEXTURE).unwrap().is_ok());
    for length in bytes.len() - 200..bytes.len() {
        let cut = &bytes[..length];
        assert!(decode(cut, Limits::TEXTURE).is_err(), "{length}");
        assert!(to_png(cut, Limits::TEXTURE).unwrap().is_err(), "{length}");
    }
}

#[test]
fn every_truncation_of_a_png_is_an_error() {
    let bytes = png(ImageBuffer::from_fn(30, 20, |x, y| {
        Rgb([x as u8 * 7, y as u8 * 11, (x * y) as u8])
    }));
    // The last 12 bytes are the end chunk, which holds no pixels.
    for length in 0..bytes.len() - 12 {
        assert!(
            decode(&bytes[..length], Limits::TEXTURE).is_err(),
            "{length} of {}",
            bytes.len()
        );
    }
}

#[test]
fn hdr_gives_linear_values_as_they_are_stored() {
    let mut hdr = Vec::new();
    image::codecs::hdr::HdrEncoder::new(&mut hdr)
        .encode(&[Rgb([2.0, 0.5, 1.0]), Rgb([1024.0, 0.0, 256.0])], 2, 1)
        .unwrap();
    let expected = [[2.0, 0.5, 1.0], [1024.0, 0.0, 256.0]];
    let text = b"FORMAT=32-bit_rle_rgbe\n";
    let place = hdr.windows(text.len()).position(|part| part == text).unwrap();
    let mut exposed = hdr.clone();
    exposed.splice(place..place, *b"EXPOSURE=4\n");
    let mut renamed = hdr.clone();
    renamed.splice(..b"#?RADIANCE".len(), *b"#?RGBE");
    for bytes in [&hdr, &exposed, &renamed] {
        let texels = decode(bytes, Limits::TEXTURE).unwrap();
        assert_eq!(
            (texels.width, texels.height, texels.encoding),
            (2, 1, Encoding::Linear)
        );
        assert_eq!(texels.data, expected);
    }
    assert!(matches!(
        decode_alpha(&hdr, Limits::TEXTURE),
        Err(ReadFault::NoAlpha)
    ));
    assert!(decode(&hdr[..hdr.len() - 1], Limits::TEXTURE).is_err());
}

#[test]
fn exr_gives_linear_values_of_any_size() {
    let ramp: Vec<f32> = (0..6).map(|i| i as f32 * 1e6 - 3.0).collect();
    let rgb = [
        ("R", ramp.clone()),
        ("G", vec![0.5; 6]),
        ("B", vec![0.25; 6]),
        ("A", vec![f32::NAN; 6]),
        ("depth.Z", vec![f32::NAN; 6]),
    ];
    let texels = decode(&exr(&rgb), Limits::TEXTURE).unwrap();
    assert_eq!(
        (texels.width, texels.height, texels.encoding),
        (3, 2, Encoding::Linear)
    );
    assert_eq!(texels.data[4], [ramp[4], 0.5, 0.25]);
    assert_eq!(
        decode(&exr(&[("Y", ramp.clone())]), Limits::TEXTURE)
            .unwrap()
            .data[4],
        [ramp[4]; 3]
    );
}

#[test]
fn exr_without_colour_or_with_nan_is_rejected() {
    let fault = decode(
        &exr(&[("R", vec![0.0; 6]), ("B", vec![0.0; 6]), ("Z", vec![0.0; 6])]),
        Limits::TEXTURE,
    )
    .unwrap_err();
    assert!(
        matches!(&fault, ReadFault::NoColor { available } if available == &["B", "R", "Z"]),
        "{fault}"
    );
    for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
        let green = vec![0.0, 0.0, 0.0, 0.0, bad, bad];
        let fault = decode(
            &exr(&[("R", vec![0.0; 6]), ("G", green), ("B", vec![0.0; 6])]),
            Limits::TEXTURE,
        )
        .unwrap_err();
        assert!(
            matches!(
                fault,
                ReadFault::NotFinite {
                    count: 2,
                    channel: "G",
                    x: 1,
                    y: 1,
                    ..
                }
            ),
            "{fault}"
        );
    }
}

#[test]
fn limits_are_checked_before_pixels_are_decoded() {
    let image = png(ImageBuffer::from_pixel(40, 30, Rgb([1_u8, 2, 3])));
    let mut jpeg = Vec::new();
    JpegEncoder::new(&mut jpeg)
        .encode(&[9; 1200], 40, 30, ExtendedColorType::L8)
        .unwrap();
    let float = exr_io::encode(&Image::from_fn(40, 30, |_, _| [0.0; 3]).unwrap()).unwrap();
    let enough = Limits {
        max_width: 40,
        max_height: 30,
        max_bytes: 40 * 30 * 12,
    };
    for bytes in [image, jpeg, float] {
        assert!(decode(&bytes, enough).is_ok());
        for limits in [
            Limits {
                max_width: 39,
                ..enough
            },
            Limits {
                max_height: 29,
                ..enough
            },
            Limits {
                max_bytes: 40 * 30 * 12 - 1,
                ..enough
            },
        ] {
            let fault = decode(&bytes, limits).unwrap_err();
            assert!(
                matches!(
                    fault,
                    ReadFault::TooLarge {
                        width: 40,
                        height: 30,
                        ..
                    }
                ),
                "{fault}"
            );
        }
    }
}

/// A PNG file with nothing but a header of that size, checksum and all.
fn png_header(width: u32, height: u32) -> Vec<u8> {
    let crc = |bytes: &[u8]| {
        !bytes.iter().fold(u32::MAX, |crc, &byte| {
            (0..8).fold(crc ^ u32::from(byte), |crc, _| {
                (crc >> 1) ^ if crc & 1 == 1 { 0xedb8_8320 } else { 0 }
            })
        })
    };
    let mut header = b"IHDR".to_vec();
    header.extend(width.to_be_bytes());
    header.extend(height.to_be_bytes());
    header.extend([8, 2, 0, 0, 0]);
    let mut bytes = b"\x89PNG\r\n\x1a\n\0\0\0\x0d".to_vec();
    bytes.extend(&header);
    bytes.extend(crc(&header).to_be_bytes());
    bytes.extend(b"\0\0\0\0IDAT\x35\xaf\x06\x1e");
    bytes
}

#[test]
fn a_huge_or_empty_header_is_rejected() {
    let fault = decode(&png_header(20_000, 20_000), Limits::TEXTURE).unwrap_err();
    assert!(matches!(fault, ReadFault::TooLarge { .. }), "{fault}");
    assert!(
        fault.to_string().contains("16384 x 16384") && fault.to_string().contains("2147483648"),
        "{fault}"
    );
    assert!(decode(&png_header(u32::MAX >> 1, u32::MAX >> 1), Limits::TEXTURE).is_err());
    assert!(decode(&png_header(0, 5), Limits::TEXTURE).is_err());
    assert!(decode(&png_header(5, 0), Limits::TEXTURE).is_err());
}

#[test]
fn the_contents_determine_the_format() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("wrong.jpg");
    std::fs::write(&path, png(ImageBuffer::from_pixel(2, 2, Luma([0_u8])))).unwrap();
    assert_eq!(read(&path, Limits::TEXTURE).unwrap().encoding, Encoding::Srgb8);
    std::fs::write(&path, "a text").unwrap();
    let error = read(&path, Limits::TEXTURE).unwrap_err();
    assert!(
        error
            .to_string()
            .ends_with("wrong.jpg: not a PNG, JPEG, WebP, EXR or HDR file"),
        "{error}"
    );
    std::fs::write(&path, "").unwrap();
    let error = read(&path, Limits::TEXTURE).unwrap_err();
    assert!(error.to_string().ends_with("the file is empty"), "{error}");
    assert!(matches!(
        read(folder.path().join("none"), Limits::TEXTURE)
            .unwrap_err()
            .fault,
        ReadFault::Io(_)
    ));
    assert!(read(folder.path(), Limits::TEXTURE).is_err());
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(200))]

    #[test]
    fn changed_bytes_never_panic(changes in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..6)) {
        let limits = Limits { max_width: 512, max_height: 512, max_bytes: 16 << 20 };
        let mut jpeg = Vec::new();
        let pixels: Vec<u8> = (0..24 * 24 * 3).map(|i| (i % 251) as u8).collect();
        JpegEncoder::new(&mut jpeg).encode(&pixels, 24, 24, ExtendedColorType::Rgb8).unwrap();
        for mut bytes in [jpeg, png(ImageBuffer::from_fn(24, 24, |x, y| Rgb([x as u8, y as u8, 9])))] {
            for (index, value) in &changes {
                let length = bytes.len();
                bytes[index.index(length)] = *value;
            }
            let _ = decode(&bytes, limits);
        }
    }
}

#[test]
fn the_public_png_suite_is_read() {
    let Some(files) = test_data::files("png/pngsuite") else {
        return;
    };
    assert!(files.len() > 50);
    for path in files {
        let texels = read(&path, Limits::TEXTURE).unwrap();
        let name = path
            .file_stem()
            .unwrap_or_default()
            .to_string_lossy()
            .into_owned();
        let expected = if name.ends_with("16") {
            Encoding::Srgb16
        } else {
            Encoding::Srgb8
        };
        assert_eq!(texels.encoding, expected, "{name}");
        if name.starts_with("bas") {
            assert_eq!((texels.width, texels.height), (32, 32), "{name}");
        }
        // Interlaced or not, the picture is the same.
        if name.as_bytes()[3] == b'i' && name.starts_with("bas") {
            let plain = path.with_file_name(format!("basn{}.png", &name[4..]));
            assert_eq!(read(&plain, Limits::TEXTURE).unwrap(), texels, "{name}");
        }
    }
}

#[test]
fn public_jpeg_files_are_read() {
    let Some(files) = test_data::files("textures/normalmaps_cc0") else {
        return;
    };
    assert!(!files.is_empty());
    for path in files {
        let texels = read(&path, Limits::TEXTURE).unwrap();
        assert_eq!(texels.data.len(), texels.width * texels.height);
        // Normal maps point out of the surface.
        let blue: f32 = texels.data.iter().map(|texel| texel[2]).sum::<f32>() / texels.data.len() as f32;
        assert!(blue > 0.5, "{}: {blue}", path.display());
    }
}
