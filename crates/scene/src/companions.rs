//! The files that a glTF file of a mesh refers to.
//!
//! The image depends on them, so that they belong to the hash of a scene. This crate has no parser
//! of glTF, which programs without meshes do not need: the values of all keys `uri` are found in
//! the text. One that no file has adds nothing.

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
        let path = PathBuf::from(decoded(value)?);
        let inside = |part| matches!(part, Component::Normal(_) | Component::CurDir);
        path.components().all(inside).then_some(path)
    })
}

/// A string of JSON up to its closing quotation mark, whose bytes may be percent-encoded.
fn decoded(value: &str) -> Option<String> {
    let mut bytes = Vec::new();
    let mut rest = value.bytes();
    loop {
        let byte = match rest.next()? {
            b'"' => return String::from_utf8(bytes).ok(),
            b'\\' => match rest.next()? {
                escaped @ (b'/' | b'\\' | b'"') => escaped,
                _ => return None,
            },
            b'%' => {
                let mut digit = || char::from(rest.next()?).to_digit(16);
                u8::try_from(16 * digit()? + digit()?).ok()?
            }
            plain => plain,
        };
        bytes.push(byte);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TEXT: &str = r#"{ "buffers": [
        { "uri": "a%20b.bin" }, { "uri" : "data:application/octet-stream;base64,AAAA" },
        { "uri": "\/etc\/passwd" }, { "uri": "../up.bin" }, { "byteLength": 4 }
    ], "images": [{ "uri":"textures\/wood.png" }] }"#;

    #[test]
    fn files_of_a_gltf_file_are_found() {
        let folder = tempfile::tempdir().unwrap();
        let expected = ["a b.bin", "textures/wood.png"].map(|name| folder.path().join(name));
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
