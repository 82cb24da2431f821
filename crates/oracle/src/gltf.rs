//! Reads glTF 2.0 files: the JSON part, the buffers and the images.
//!
//! Errors are texts without the name of the file. A file that breaks a rule of the specification is
//! an error here, even if its meaning can be guessed.

mod accessor;

pub(crate) use accessor::Numbers;

use base64::Engine as _;
use base64::alphabet::STANDARD;
use base64::engine::DecodePaddingMode;
use base64::engine::general_purpose::{GeneralPurpose, GeneralPurposeConfig};
use serde_json::Value;
use std::cell::OnceCell;
use std::path::{Path, PathBuf};

/// Base64 with or without padding.
const BASE64: GeneralPurpose = GeneralPurpose::new(
    &STANDARD,
    GeneralPurposeConfig::new().with_decode_padding_mode(DecodePaddingMode::Indifferent),
);

/// A file with its folder.
pub(crate) struct Gltf {
    json: Value,
    /// The binary chunk of a .glb file.
    chunk: Option<Vec<u8>>,
    /// The bytes of buffers that were read.
    buffers: Vec<OnceCell<Vec<u8>>>,
    folder: PathBuf,
}

/// Whether the name of a file says that it is glTF.
pub(crate) fn is_gltf(path: &Path) -> bool {
    let extension = path
        .extension()
        .unwrap_or_default()
        .to_string_lossy()
        .to_lowercase();
    ["gltf", "glb"].contains(&&*extension)
}

/// A number of four bytes at an offset.
fn word(bytes: &[u8], at: usize) -> Option<usize> {
    let four = bytes.get(at..at.checked_add(4)?)?;
    Some(u32::from_le_bytes(four.try_into().ok()?) as usize)
}

/// The JSON chunk of a .glb file, and its binary chunk.
fn chunks(bytes: &[u8]) -> Option<(&[u8], Option<&[u8]>)> {
    const JSON: usize = 0x4e4f_534a;
    const BINARY: usize = 0x004e_4942;
    if word(bytes, 4)? != 2 {
        return None;
    }
    let file = bytes.get(..word(bytes, 8)?)?;
    let chunk = |at: usize| {
        let start = at.checked_add(8)?;
        let end = start.checked_add(word(file, at)?)?;
        Some((word(file, at + 4)?, file.get(start..end)?, end))
    };
    let (kind, json, end) = chunk(12)?;
    if kind != JSON {
        return None;
    }
    if end == file.len() {
        return Some((json, None));
    }
    let (kind, binary, _) = chunk(end)?;
    Some((json, (kind == BINARY).then_some(binary)))
}

impl Gltf {
    pub(crate) fn read(path: &Path) -> Result<Self, String> {
        let bytes = std::fs::read(path).map_err(|fault| fault.to_string())?;
        let (json, chunk) = match bytes.starts_with(b"glTF") {
            true => chunks(&bytes).ok_or("malformed chunks")?,
            false => (&*bytes, None),
        };
        // A byte order mark is no text.
        let json = json.strip_prefix(b"\xef\xbb\xbf").unwrap_or(json);
        let json: Value = serde_json::from_slice(json).map_err(|fault| fault.to_string())?;
        let version = json.pointer("/asset/version").and_then(Value::as_str);
        if !version.is_some_and(|version| version.starts_with("2.")) {
            return Err("its version is not 2".to_owned());
        }
        let buffers = json.get("buffers").and_then(Value::as_array).map_or(0, Vec::len);
        Ok(Self {
            buffers: vec![OnceCell::new(); buffers],
            json,
            chunk: chunk.map(<[u8]>::to_vec),
            folder: path.parent().unwrap_or(Path::new("")).to_owned(),
        })
    }

    /// Element `index` of a list at the top level.
    pub(crate) fn element(&self, list: &str, index: usize) -> Result<&Value, String> {
        let found = self.json.get(list).and_then(|list| list.get(index));
        found.ok_or_else(|| format!("no element {index} in `{list}`"))
    }

    /// A list at the top level, empty if it is absent.
    pub(crate) fn list(&self, list: &str) -> &[Value] {
        let found = self.json.get(list).and_then(Value::as_array);
        found.map_or(&[], Vec::as_slice)
    }

    /// The extensions that the file requires.
    pub(crate) fn required(&self) -> impl Iterator<Item = &str> {
        self.list("extensionsRequired").iter().filter_map(Value::as_str)
    }

    /// The bytes that a URI holds or names.
    fn resolve(&self, uri: &str) -> Result<Vec<u8>, String> {
        let malformed = || "a malformed URI".to_owned();
        if let Some(data) = uri.strip_prefix("data:") {
            let (kind, data) = data.split_once(',').ok_or_else(malformed)?;
            return match kind.strip_suffix(";base64") {
                Some(_) => BASE64.decode(data).map_err(|fault| fault.to_string()),
                None => unescaped(data).ok_or_else(malformed),
            };
        }
        if uri.contains(':') || uri.starts_with('/') {
            return Err("a URI that is not relative".to_owned());
        }
        let name = String::from_utf8(unescaped(uri).ok_or_else(malformed)?);
        let name = name.map_err(|fault| fault.to_string())?;
        std::fs::read(self.folder.join(name)).map_err(|fault| fault.to_string())
    }

    /// The bytes of a buffer.
    fn buffer(&self, index: usize) -> Result<&[u8], String> {
        let cell = self
            .buffers
            .get(index)
            .ok_or_else(|| format!("no buffer {index}"))?;
        if let Some(bytes) = cell.get() {
            return Ok(bytes);
        }
        let bytes = self.read_buffer(index)?;
        Ok(cell.get_or_init(|| bytes))
    }

    fn read_buffer(&self, index: usize) -> Result<Vec<u8>, String> {
        let buffer = self.element("buffers", index)?;
        let mut bytes = match buffer.get("uri") {
            Some(uri) => self.resolve(uri.as_str().ok_or("a malformed URI")?)?,
            None if index == 0 => self.chunk.clone().ok_or("a buffer without data")?,
            None => return Err("a buffer without data".to_owned()),
        };
        let length = number(buffer, "byteLength", None)?;
        if length > bytes.len() {
            return Err(format!("buffer {index} is too short"));
        }
        bytes.truncate(length);
        Ok(bytes)
    }

    /// The bytes of a buffer view.
    fn view(&self, index: usize) -> Result<&[u8], String> {
        let view = self.element("bufferViews", index)?;
        let buffer = self.buffer(number(view, "buffer", None)?)?;
        let start = number(view, "byteOffset", Some(0))?;
        let end = start.checked_add(number(view, "byteLength", None)?);
        let bytes = end.and_then(|end| buffer.get(start..end));
        bytes.ok_or_else(|| format!("buffer view {index} is out of range"))
    }

    /// The encoded bytes of an image.
    pub(crate) fn image(&self, index: usize) -> Result<Vec<u8>, String> {
        let image = self.element("images", index)?;
        match (image.get("uri"), image.get("bufferView")) {
            (Some(uri), None) => self.resolve(uri.as_str().ok_or("a malformed URI")?),
            (None, Some(_)) => Ok(self.view(number(image, "bufferView", None)?)?.to_vec()),
            _ => Err(format!("image {index} has no data")),
        }
    }
}

/// A whole number of an object, or its default.
pub(crate) fn number(object: &Value, key: &str, default: Option<usize>) -> Result<usize, String> {
    let malformed = || format!("a malformed `{key}`");
    match object.get(key) {
        None => default.ok_or_else(malformed),
        Some(value) => {
            let value = value.as_u64().and_then(|value| usize::try_from(value).ok());
            value.ok_or_else(malformed)
        }
    }
}

/// Decodes percent escapes.
fn unescaped(text: &str) -> Option<Vec<u8>> {
    let mut bytes = Vec::new();
    let mut rest = text.as_bytes();
    while let Some((first, others)) = rest.split_first() {
        rest = others;
        if *first == b'%' {
            let (digits, others) = others.split_at_checked(2)?;
            bytes.push(u8::from_str_radix(std::str::from_utf8(digits).ok()?, 16).ok()?);
            rest = others;
        } else {
            bytes.push(*first);
        }
    }
    Some(bytes)
}
