//! The bytes of buffers, buffer views and images.

use crate::container::unreadable;
use crate::document::{Document, Error};
use crate::json;
use crate::usage::{self, Part};
use base64::Engine;
use base64::engine::{DecodePaddingMode, GeneralPurpose, GeneralPurposeConfig};
use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::{Component, Path, PathBuf};
use std::sync::OnceLock;

/// Maximum size of an image file in bytes.
const MAX_IMAGE_BYTES: u64 = 1 << 30;

/// Where the bytes of a buffer are.
pub(crate) enum Buffer {
    /// In a .glb: offset and length.
    Chunk([u64; 2]),
    /// In a file beside the document.
    File(PathBuf),
    /// In the URI itself, decoded on first use; with the stated length.
    Data(OnceLock<Vec<u8>>, u64),
    /// Faulty: reported on first use, since nothing may use it.
    Faulty(Error),
}

impl Buffer {
    pub(crate) fn all(root: &json::Root, binary: Option<[u64; 2]>) -> Result<Vec<Self>, Error> {
        let of = |(number, buffer): (usize, &json::Buffer)| {
            let length = buffer.byte_length.0;
            let faulty = |key: &str, message: String| {
                Self::Faulty(Error::at(format!("/buffers/{number}{key}"), message))
            };
            match (&buffer.uri, binary) {
                (None, Some([at, found])) if number == 0 => {
                    if found < length {
                        faulty(
                            "/byteLength",
                            format!("the buffer states {length} bytes, its chunk has {found}"),
                        )
                    } else {
                        Self::Chunk([at, length])
                    }
                }
                (None, _) => faulty("", "expected `uri`, or the binary chunk of a .glb".into()),
                (Some(uri), _) => match relative_path(uri) {
                    Ok(None) => Self::Data(OnceLock::new(), length),
                    Ok(Some(path)) => Self::File(path),
                    Err(message) => faulty("/uri", message),
                },
            }
        };
        Ok(root.buffers.iter().enumerate().map(of).collect())
    }
}

/// The relative path that a URI names; `None` for a data URI.
pub(crate) fn relative_path(uri: &str) -> Result<Option<PathBuf>, String> {
    if uri
        .get(..5)
        .is_some_and(|start| start.eq_ignore_ascii_case("data:"))
    {
        return Ok(None);
    }
    // A scheme is letters before a colon that comes before any slash.
    if let Some((scheme, _)) = uri.split_once(':')
        && !scheme.contains('/')
    {
        return Err(format!(
            "expected a data URI or a relative path, found the scheme \"{}\"",
            shorten(scheme)
        ));
    }
    let mut inside = PathBuf::new();
    for part in Path::new(&percent_decoded(uri)?).components() {
        let stays = match part {
            Component::CurDir => true,
            Component::Normal(name) => {
                inside.push(name);
                true
            }
            // What it leaves must have been entered.
            Component::ParentDir => inside.pop(),
            Component::RootDir | Component::Prefix(_) => false,
        };
        if !stays {
            return Err(format!(
                "\"{}\" leaves the folder of the file, which is not allowed",
                shorten(uri)
            ));
        }
    }
    Ok(Some(inside))
}

fn percent_decoded(uri: &str) -> Result<String, String> {
    let wrong = || format!("\"{}\" is not a valid URI", shorten(uri));
    let mut bytes = Vec::with_capacity(uri.len());
    let mut rest = uri.bytes();
    while let Some(byte) = rest.next() {
        if byte == b'%' {
            let mut digit = || (rest.next()? as char).to_digit(16);
            let (high, low) = (digit().ok_or_else(wrong)?, digit().ok_or_else(wrong)?);
            bytes.push((16 * high + low) as u8);
        } else {
            bytes.push(byte);
        }
    }
    match String::from_utf8(bytes) {
        Ok(path) if !path.contains('\0') => Ok(path),
        _ => Err(wrong()),
    }
}

/// The bytes of a data URI.
fn decoded(uri: &str) -> Result<Vec<u8>, String> {
    // Files with and without padding exist.
    const DECODER: GeneralPurpose = GeneralPurpose::new(
        &base64::alphabet::STANDARD,
        GeneralPurposeConfig::new().with_decode_padding_mode(DecodePaddingMode::Indifferent),
    );
    let (head, body) = uri
        .split_once(',')
        .ok_or("a data URI has a comma before its data, this one has none")?;
    if !head.ends_with(";base64") {
        return Err("expected a data URI in base64".into());
    }
    DECODER
        .decode(body.as_bytes())
        .map_err(|error| format!("its base64 is malformed: {error}"))
}

fn shorten(text: &str) -> String {
    match text.char_indices().nth(60) {
        Some((end, _)) => format!("{}...", &text[..end]),
        None => text.to_owned(),
    }
}

impl Document {
    /// `length` bytes of a buffer from `offset` on. Nothing is allocated before the range is
    /// checked.
    pub(crate) fn buffer_bytes(&self, number: usize, offset: u64, length: u64) -> Result<Vec<u8>, Error> {
        let pointer = || format!("/buffers/{number}");
        match &self.buffers[number] {
            Buffer::Faulty(error) => Err(error.clone()),
            Buffer::Chunk([at, _]) => {
                read_range(&self.path, at + offset, length).map_err(|message| Error::at(pointer(), message))
            }
            Buffer::File(path) => {
                let fault = |message| Error::at(format!("/buffers/{number}/uri"), named(path, message));
                read_range(&self.folder().join(path), offset, length).map_err(fault)
            }
            Buffer::Data(bytes, stated) => {
                let bytes = match bytes.get() {
                    Some(bytes) => bytes,
                    None => {
                        let uri = self.root.buffers[number].uri.as_deref().unwrap_or_default();
                        let found = decoded(uri)
                            .map_err(|message| Error::at(format!("/buffers/{number}/uri"), message))?;
                        bytes.get_or_init(|| found)
                    }
                };
                if (bytes.len() as u64) < *stated {
                    return Err(Error::at(
                        format!("/buffers/{number}/byteLength"),
                        format!("the buffer states {stated} bytes, its URI has {}", bytes.len()),
                    ));
                }
                // The range is inside of the stated length, and so of the bytes.
                Ok(bytes[offset as usize..(offset + length) as usize].to_vec())
            }
        }
    }

    /// Bytes of a buffer view: `length` of them from `offset` on. `pointer` is the place that
    /// refers to the view.
    pub(crate) fn view_bytes(
        &self,
        number: usize,
        offset: u64,
        length: u64,
        pointer: &dyn Fn() -> String,
    ) -> Result<Vec<u8>, Error> {
        let view = Self::item(&self.root.buffer_views, number, "bufferViews", pointer)?;
        let at = |key: &str| format!("/bufferViews/{number}{key}");
        if let Some(extensions) = &view.extensions
            && let Some(name) = ["EXT_meshopt_compression", "KHR_meshopt_compression"]
                .iter()
                .find(|name| extensions.others.contains_key(**name))
            && matches!(self.buffers.get(view.buffer.value()), Some(Buffer::Faulty(_)))
        {
            let message = format!("its data is compressed by {name}, which is not supported");
            return Err(Error::at(at(&format!("/extensions/{name}")), message));
        }
        let buffer = Self::item(&self.root.buffers, view.buffer.value(), "buffers", || {
            at("/buffer")
        })?;
        let start = view.byte_offset.map_or(0, |offset| offset.0);
        let (whole, stated) = (view.byte_length.0, buffer.byte_length.0);
        if start.checked_add(whole).is_none_or(|end| end > stated) {
            let message = format!(
                "the view needs bytes {start} to {}, its buffer has {stated}",
                u128::from(start) + u128::from(whole)
            );
            return Err(Error::at(at("/byteLength"), message));
        }
        if offset.checked_add(length).is_none_or(|end| end > whole) {
            let message = format!(
                "needs bytes {offset} to {} of buffer view {number}, which has {whole}",
                u128::from(offset) + u128::from(length)
            );
            return Err(Error::at(pointer(), message));
        }
        self.buffer_bytes(view.buffer.value(), start + offset, length)
    }

    /// The bytes of an image file, which are a PNG, JPEG or WebP file.
    pub fn image(&self, number: usize) -> Result<Vec<u8>, Error> {
        let all = self.root.images.len();
        let image = self.root.images.get(number).ok_or_else(|| {
            Error::at(
                "/images",
                format!("there is no image {number}: the file has {all}"),
            )
        })?;
        usage::decoded(self, Part::Image(number));
        let pointer = |key: &str| format!("/images/{number}{key}");
        match (&image.uri, image.buffer_view) {
            (None, Some(view)) => {
                let place = || pointer("/bufferView");
                let list = &self.root.buffer_views;
                let length = Self::item(list, view.value(), "bufferViews", place)?
                    .byte_length
                    .0;
                self.view_bytes(view.value(), 0, length, &place)
            }
            (Some(uri), None) => {
                let fault = |message: String| Error::at(pointer("/uri"), message);
                match relative_path(uri).map_err(fault)? {
                    None => decoded(uri).map_err(fault),
                    Some(name) => {
                        let path = self.folder().join(&name);
                        let fault = |message: String| fault(named(&name, message));
                        let length = std::fs::metadata(&path)
                            .map_err(|error| fault(format!("cannot be read: {error}")))?
                            .len();
                        if length > MAX_IMAGE_BYTES {
                            return Err(fault(format!("is larger than {} MiB", MAX_IMAGE_BYTES >> 20)));
                        }
                        read_range(&path, 0, length).map_err(fault)
                    }
                }
            }
            (None, None) => Err(Error::at(pointer(""), "expected `uri` or `bufferView`")),
            (Some(_), Some(_)) => Err(Error::at(
                pointer(""),
                "expected either `uri` or `bufferView`, found both",
            )),
        }
    }

    /// The path of an image in a file of its own, relative to the folder of the document; `None` if
    /// it is part of the document or faulty.
    pub fn image_file(&self, number: usize) -> Option<PathBuf> {
        let image = self.root.images.get(number)?;
        relative_path(image.uri.as_deref()?).ok().flatten()
    }
}

/// A message about a file that the document names.
fn named(path: &Path, message: String) -> String {
    format!("\"{}\" {message}", path.display())
}

fn read_range(path: &Path, offset: u64, length: u64) -> Result<Vec<u8>, String> {
    let told = |error: std::io::Error| unreadable(&error).message;
    let mut file = File::open(path).map_err(told)?;
    let metadata = file.metadata().map_err(told)?;
    if !metadata.is_file() {
        return Err("cannot be read: not a regular file".into());
    }
    if offset + length > metadata.len() {
        return Err(format!(
            "is cut: bytes {offset} to {} are needed, the file has {}",
            offset + length,
            metadata.len()
        ));
    }
    file.seek(SeekFrom::Start(offset)).map_err(told)?;
    let mut bytes = Vec::new();
    file.take(length).read_to_end(&mut bytes).map_err(told)?;
    if bytes.len() as u64 == length {
        Ok(bytes)
    } else {
        Err("cannot be read: it became shorter".into())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_files_below_the_folder_and_data_are_read() {
        let path = |uri| relative_path(uri).map(|path| path.map(|path| path.display().to_string()));
        assert_eq!(path("a%20b/c.bin"), Ok(Some("a b/c.bin".into())));
        assert_eq!(path("./a/../b/c.bin"), Ok(Some("b/c.bin".into())));
        assert_eq!(path("data:;base64,"), Ok(None));
        for wrong in [
            "../a.bin",
            "/etc/passwd",
            "http://a/b.bin",
            "file:a",
            "a%2",
            "a%00",
            "a/../../b",
            "%2e%2e/b",
        ] {
            assert!(path(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn base64_with_and_without_padding() {
        assert_eq!(decoded("data:a/b;base64,AAEC/w==").unwrap(), [0, 1, 2, 255]);
        assert_eq!(decoded("data:;base64,AAEC/w").unwrap(), [0, 1, 2, 255]);
        for wrong in ["data:;base64", "data:,abc", "data:;base64,*"] {
            assert!(decoded(wrong).is_err(), "{wrong}");
        }
    }
}
