//! The GLB container.

use crate::Error;
use std::fs::File;
use std::io::{Read, Seek, SeekFrom};

/// Maximum size of the JSON of a document in bytes.
pub const MAX_JSON_BYTES: u64 = 256 << 20;

/// The JSON of a file and, of a .glb, the place of its binary chunk.
pub(crate) struct Container {
    pub(crate) json: Vec<u8>,
    /// Offset and length in bytes.
    pub(crate) binary: Option<[u64; 2]>,
}

impl Container {
    /// Splits a file. A .glb is known by its magic number, whatever its name.
    pub(crate) fn read(file: &mut File) -> Result<Self, Error> {
        let length = file.metadata().map_err(|error| unreadable(&error))?.len();
        let mut header = [0u8; 12];
        let is_binary = length >= 4 && {
            file.read_exact(&mut header[..4])
                .map_err(|error| unreadable(&error))?;
            &header[..4] == b"glTF"
        };
        if !is_binary {
            if length > MAX_JSON_BYTES {
                return Err(too_large());
            }
            file.seek(SeekFrom::Start(0))
                .map_err(|error| unreadable(&error))?;
            let json = bytes(file, length)?;
            return Ok(Self { json, binary: None });
        }
        if length < 12 {
            return Err(cut("its header"));
        }
        file.read_exact(&mut header[4..])
            .map_err(|error| unreadable(&error))?;
        let [version, total] = [word(&header, 4), word(&header, 8)];
        if version != 2 {
            return Err(Error::at(
                "",
                format!("expected version 2 of GLB, found {version}"),
            ));
        }
        if u64::from(total) > length {
            return Err(Error::at(
                "",
                format!("is cut: its header states {total} bytes, the file has {length}"),
            ));
        }
        let end = u64::from(total);
        let (json, after) = chunk(file, 12, end, *b"JSON", "a JSON chunk")?
            .ok_or_else(|| Error::at("", "expected a JSON chunk after the header"))?;
        if json[1] > MAX_JSON_BYTES {
            return Err(too_large());
        }
        file.seek(SeekFrom::Start(json[0]))
            .map_err(|error| unreadable(&error))?;
        let text = bytes(file, json[1])?;
        let binary = chunk(file, after, end, *b"BIN\0", "a binary chunk")?;
        Ok(Self {
            json: text,
            binary: binary.map(|(place, _)| place),
        })
    }
}

/// The contents of the chunk at an offset, as offset and length, and the end of the chunk; `None`
/// if there is no chunk of this kind.
fn chunk(
    file: &mut File,
    at: u64,
    end: u64,
    kind: [u8; 4],
    name: &str,
) -> Result<Option<([u64; 2], u64)>, Error> {
    if at == end {
        return Ok(None);
    }
    if at + 8 > end {
        return Err(cut(name));
    }
    let mut header = [0u8; 8];
    file.seek(SeekFrom::Start(at))
        .map_err(|error| unreadable(&error))?;
    file.read_exact(&mut header).map_err(|error| unreadable(&error))?;
    let length = u64::from(word(&header, 0));
    if at + 8 + length > end {
        return Err(cut(name));
    }
    let found = header[4..] == kind;
    Ok(found.then_some(([at + 8, length], at + 8 + length)))
}

fn word(bytes: &[u8], at: usize) -> u32 {
    u32::from_le_bytes([bytes[at], bytes[at + 1], bytes[at + 2], bytes[at + 3]])
}

fn bytes(file: &mut File, length: u64) -> Result<Vec<u8>, Error> {
    let mut bytes = Vec::new();
    file.take(length)
        .read_to_end(&mut bytes)
        .map_err(|error| unreadable(&error))?;
    Ok(bytes)
}

pub(crate) fn unreadable(error: &std::io::Error) -> Error {
    Error::at("", format!("cannot be read: {error}"))
}

fn cut(what: &str) -> Error {
    Error::at("", format!("is cut: it ends inside {what}"))
}

fn too_large() -> Error {
    Error::at(
        "",
        format!("its JSON is larger than {} MiB", MAX_JSON_BYTES >> 20),
    )
}
