//! Width and height of image files, from their headers.

use std::fs;
use std::io::Read;
use std::path::Path;

/// Bytes of a header that are read. A JPEG may have large comments before its size.
const HEADER: u64 = 4 << 20;

/// Width and height of a PNG, JPEG, OpenEXR or HDR file; none if the header is not understood.
pub(crate) fn image_size(path: &Path) -> Option<(u32, u32)> {
    if !fs::metadata(path).ok()?.is_file() {
        return None;
    }
    let mut bytes = Vec::new();
    fs::File::open(path)
        .ok()?
        .take(HEADER)
        .read_to_end(&mut bytes)
        .ok()?;
    let (width, height) = if bytes.starts_with(b"\x89PNG\r\n\x1a\n") {
        let number = |at: usize| {
            bytes
                .get(at..at + 4)
                .and_then(|b| Some(u32::from_be_bytes(b.try_into().ok()?)))
        };
        (number(16)?, number(20)?)
    } else if bytes.starts_with(&[0xff, 0xd8]) {
        jpeg(&bytes)?
    } else if bytes.starts_with(&[0x76, 0x2f, 0x31, 0x01]) {
        exr(&bytes)?
    } else if bytes.starts_with(b"#?") {
        hdr(&bytes)?
    } else {
        return None;
    };
    (width > 0 && height > 0).then_some((width, height))
}

fn jpeg(bytes: &[u8]) -> Option<(u32, u32)> {
    let number = |at: usize| bytes.get(at..at + 2).map(|b| u16::from_be_bytes([b[0], b[1]]));
    let mut at = 2;
    loop {
        if *bytes.get(at)? != 0xff {
            return None;
        }
        let marker = *bytes.get(at + 1)?;
        match marker {
            // A fill byte.
            0xff => at += 1,
            // Start of frame, except the markers of tables between them.
            0xc0..=0xcf if !matches!(marker, 0xc4 | 0xc8 | 0xcc) => {
                return Some((number(at + 7)?.into(), number(at + 5)?.into()));
            }
            _ => at += 2 + usize::from(number(at + 2)?.max(2)),
        }
    }
}

/// From the line after the header and an empty line, such as `-Y 512 +X 1024`.
fn hdr(bytes: &[u8]) -> Option<(u32, u32)> {
    let end = bytes.windows(2).position(|pair| pair == b"\n\n")? + 2;
    let line = bytes[end..].split(|byte| *byte == b'\n').next()?;
    let words: Vec<&str> = std::str::from_utf8(line).ok()?.split_ascii_whitespace().collect();
    match words[..] {
        ["-Y", height, "+X", width] => Some((width.parse().ok()?, height.parse().ok()?)),
        _ => None,
    }
}

fn exr(bytes: &[u8]) -> Option<(u32, u32)> {
    let mut rest = bytes.get(8..)?;
    let text = |rest: &mut &[u8]| -> Option<Vec<u8>> {
        let end = rest.iter().position(|byte| *byte == 0)?;
        let text = rest[..end].to_vec();
        *rest = &rest[end + 1..];
        Some(text)
    };
    loop {
        let name = text(&mut rest)?;
        if name.is_empty() {
            return None;
        }
        text(&mut rest)?;
        let size = u32::from_le_bytes(rest.get(..4)?.try_into().ok()?) as usize;
        let value = rest.get(4..)?.get(..size)?;
        if name == b"dataWindow" {
            let number = |k: usize| Some(i32::from_le_bytes(value.get(4 * k..4 * k + 4)?.try_into().ok()?));
            let side = |low: i32, high: i32| u32::try_from(i64::from(high) - i64::from(low) + 1).ok();
            return Some((side(number(0)?, number(2)?)?, side(number(1)?, number(3)?)?));
        }
        rest = &rest[4 + size..];
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_are_read_from_headers() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("x");
        let size = |bytes: &[u8]| {
            fs::write(&path, bytes).unwrap();
            image_size(&path)
        };
        assert_eq!(
            size(b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR\0\0\0\x07\0\0\0\x05\x08\x02"),
            Some((7, 5))
        );
        let jpeg = [
            &[
                0xff, 0xd8, 0xff, 0xe0, 0, 4, 1, 1, 0xff, 0xff, 0xc0, 0, 11, 8, 0, 5, 0, 7, 3,
            ][..],
            &[0; 8],
        ]
        .concat();
        assert_eq!(size(&jpeg), Some((7, 5)));
        let mut exr = vec![0x76, 0x2f, 0x31, 0x01, 2, 0, 0, 0];
        exr.extend(b"a\0int\0\x04\0\0\0abcddataWindow\0box2i\0\x10\0\0\0");
        for number in [-1_i32, 2, 5, 6] {
            exr.extend(number.to_le_bytes());
        }
        assert_eq!(size(&exr), Some((7, 5)));
        for length in 0..exr.len() {
            size(&exr[..length]);
        }
        for length in 0..jpeg.len() {
            size(&jpeg[..length]);
        }
        assert_eq!(size(b"garbage"), None);
        assert_eq!(image_size(Path::new("/nonexistent")), None);
    }
}
