//! The files that a glTF file of a mesh refers to.
//!
//! The image depends on them, so that they belong to the hash of a scene. This crate has no parser
//! of glTF, which programs without meshes do not need: the values of all keys `uri` are found in
//! the text. A value that names no
//! file does not change the hash.

use std::fs::File;
use std::io::Read;
use std::path::{Component, Path, PathBuf};

/// Maximum size of the text of a glTF file, in bytes.
const MAX_TEXT: u64 = 1 << 30;
const KEY: &str = "\"uri\"";

/// The buffers and images of a glTF file, if it is one; all lie in its folder or below.
pub(crate) fn companions(path: &Path) -> Vec<PathBuf> {
    let extension = path.extension().unwrap_or_default().to_ascii_lowercase();
    if extension != "gltf" && extension != "glb" {
        return Vec::new();
    }
    let folder = path.parent().unwrap_or(Path::new(""));
    let found = text(path).map(|text| uris(&text).collect()).unwrap_or_default();
    let found: Vec<PathBuf> = found;
    found.iter().map(|uri| folder.join(uri)).collect()
}

/// The JSON of a file; `None` if it cannot be read.
fn text(path: &Path) -> Option<String> {
    // Opening a pipe would wait for a writer.
    if !std::fs::metadata(path).ok()?.is_file() {
        return None;
    }
    let mut file = File::open(path).ok()?;
    let mut head = [0; 20];
    let mut text = Vec::new();
    let length = match file.read_exact(&mut head) {
        // A header of three words, then the length and the type of the chunk of JSON.
        Ok(()) if head.starts_with(b"glTF") => {
            u64::from(u32::from_le_bytes([head[12], head[13], head[14], head[15]]))
        }
        Ok(()) => {
            text.extend(head);
            MAX_TEXT
        }
        Err(_) => return None,
    };
    file.take(length.min(MAX_TEXT)).read_to_end(&mut text).ok()?;
    String::from_utf8(text).ok()
}

/// The relative paths that are values of keys `uri`.
fn uris(text: &str) -> impl Iterator<Item = PathBuf> {
    text.match_indices(KEY).filter_map(|(at, _)| {
        let value = text[at + KEY.len()..].trim_start().strip_prefix(':')?;
        let value = value.trim_start().strip_prefix('"')?;
        if value
            .get(..5)
            .is_some_and(|start| start.eq_ignore_ascii_case("data:"))
        {
            return None;
        }
        let uri = decoded(value)?;
        // A scheme is letters before a colon that comes before any slash.
        let has_scheme = uri
            .split_once(':')
            .is_some_and(|(scheme, _)| !scheme.contains('/'));
        if has_scheme {
            return None;
        }
        let path = PathBuf::from(uri);
        let inside = |part| matches!(part, Component::Normal(_) | Component::CurDir);
        path.components().all(inside).then_some(path)
    })
}

/// A string of JSON up to its closing quotation mark, whose bytes may be percent-encoded.
fn decoded(value: &str) -> Option<String> {
    let mut bytes = Vec::new();
    let mut rest = value.bytes();
    // The first half of a character beyond 16 bits, which two escapes write (RFC 8259, section 7).
    let mut high = None;
    loop {
        let byte = match rest.next()? {
            b'"' => return String::from_utf8(bytes).ok(),
            b'\\' => match rest.next()? {
                escaped @ (b'/' | b'\\' | b'"') => escaped,
                b'u' => {
                    let unit = digits(&mut rest, 4)? as u16;
                    if (0xd800..0xdc00).contains(&unit) {
                        high = Some(unit);
                        continue;
                    }
                    let units = high.take().into_iter().chain([unit]);
                    let character = char::decode_utf16(units).next()?.ok()?;
                    bytes.extend_from_slice(character.encode_utf8(&mut [0; 4]).as_bytes());
                    continue;
                }
                _ => return None,
            },
            b'%' => u8::try_from(digits(&mut rest, 2)?).ok()?,
            plain => plain,
        };
        bytes.push(byte);
    }
}

/// A hexadecimal number of `count` digits.
fn digits(rest: &mut std::str::Bytes<'_>, count: usize) -> Option<u32> {
    (0..count).try_fold(0, |number, _| {
        Some(16 * number + char::from(rest.next()?).to_digit(16)?)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    const TEXT: &str = r#"{ "buffers": [
        { "uri": "a%20b.bin" }, { "uri" : "data:application/octet-stream;base64,AAAA" },
        { "uri": "\/etc\/passwd" }, { "uri": "../up.bin" }, { "byteLength": 4 },
        { "uri": "http://example.org/a.bin" }, { "uri": "b\u00fcro\ud83d\ude00.bin" }
    ], "images": [{ "uri":"textures\/wood.png" }] }"#;

    #[test]
    fn files_of_a_gltf_file_are_found() {
        let folder = tempfile::tempdir().unwrap();
        let expected =
            ["a b.bin", "b\u{fc}ro\u{1f600}.bin", "textures/wood.png"].map(|name| folder.path().join(name));
        let plain = folder.path().join("mesh.gltf");
        std::fs::write(&plain, TEXT).unwrap();
        assert_eq!(companions(&plain), expected);

        let binary = folder.path().join("mesh.GLB");
        let length = u32::try_from(TEXT.len()).unwrap().to_le_bytes();
        let head = [*b"glTF", [2, 0, 0, 0], [0; 4], length, *b"JSON"].concat();
        let after = br#"BIN {"uri": "not.json"}"#;
        std::fs::write(&binary, [&head, TEXT.as_bytes(), after].concat()).unwrap();
        assert_eq!(companions(&binary), expected);

        let other = folder.path().join("mesh.obj");
        std::fs::write(&other, TEXT).unwrap();
        assert!(companions(&other).is_empty());
        assert!(companions(&folder.path().join("missing.gltf")).is_empty());
    }
}
