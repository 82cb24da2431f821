use crate::buffers::Buffer;
use crate::container::{Container, unreadable};
use crate::json;
use std::fmt;
use std::fs::File;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};
use std::time::SystemTime;

/// A parsed glTF file. Its buffers and images are read on demand.
pub struct Document {
    /// The JSON. Its indices are not checked.
    pub root: json::Root,
    pub(crate) path: PathBuf,
    pub(crate) buffers: Vec<Buffer>,
}

/// An error in a glTF file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Error {
    /// JSON pointer of the faulty value; empty for the file as a whole.
    pub pointer: String,
    /// The error.
    pub message: String,
}

impl Error {
    pub(crate) fn at(pointer: impl Into<String>, message: impl Into<String>) -> Self {
        Self {
            pointer: pointer.into(),
            message: message.into(),
        }
    }
}

impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.pointer.is_empty() {
            f.write_str(&self.message)
        } else {
            write!(f, "{}: {}", self.pointer, self.message)
        }
    }
}

impl std::error::Error for Error {}

/// The extensions that may be required without an error, besides those of materials: they are
/// understood, or their absence leaves the shape of everything as it is.
const ACCEPTED: [&str; 17] = [
    "EXT_lights_ies",
    "EXT_lights_image_based",
    "EXT_mesh_gpu_instancing",
    "EXT_texture_webp",
    "KHR_animation_pointer",
    "KHR_audio_emitter",
    "KHR_audio_graph",
    "KHR_interactivity",
    "KHR_lights_punctual",
    "KHR_mesh_quantization",
    "KHR_node_hoverability",
    "KHR_node_selectability",
    "KHR_node_visibility",
    "KHR_physics_rigid_bodies",
    "KHR_texture_transform",
    "KHR_xmp",
    "KHR_xmp_json_ld",
];

/// Extensions of materials, which at worst change how a surface looks.
const OF_MATERIALS: [&str; 2] = ["KHR_materials_", "EXT_materials_"];

/// Modification time and length: what identifies the contents of a file.
type Stamp = (PathBuf, Option<SystemTime>, u64);

/// The last document, since the shapes and textures of a scene open the same file one after
/// another.
static LAST: Mutex<Option<(Stamp, Arc<Document>)>> = Mutex::new(None);

/// Opens a regular file. Opening a pipe would wait for a writer.
fn open(path: &Path) -> Result<File, Error> {
    let metadata = std::fs::metadata(path).map_err(|error| unreadable(&error))?;
    if !metadata.is_file() {
        return Err(Error::at("", "cannot be read: not a regular file"));
    }
    File::open(path).map_err(|error| unreadable(&error))
}

impl Document {
    /// Opens a .gltf or .glb file.
    pub fn open(path: &Path) -> Result<Arc<Self>, Error> {
        let mut file = open(path)?;
        let metadata = file.metadata().map_err(|error| unreadable(&error))?;
        let stamp = (path.to_owned(), metadata.modified().ok(), metadata.len());
        let last = LAST.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
        if let Some((known, document)) = &*last
            && *known == stamp
        {
            return Ok(document.clone());
        }
        drop(last);
        let document = Arc::new(Self::parse(path, &mut file)?);
        let mut last = LAST.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
        *last = Some((stamp, document.clone()));
        Ok(document)
    }

    fn parse(path: &Path, file: &mut File) -> Result<Self, Error> {
        let Container { json, binary } = Container::read(file)?;
        let text = json.strip_prefix(b"\xef\xbb\xbf").unwrap_or(&json);
        let root = match deserialized(text) {
            // The crate wants nodes in every scene and a node in every channel of an animation; the
            // specification does not.
            Err(error) if error.message.starts_with("missing field `node") => match mended(text) {
                Some(text) => deserialized(&text)?,
                None => return Err(error),
            },
            other => other?,
        };
        if !root.asset.version.starts_with("2.") {
            return Err(Error::at(
                "/asset/version",
                format!("expected version 2.0, found \"{}\"", root.asset.version),
            ));
        }
        for (number, name) in root.extensions_required.iter().enumerate() {
            let accepted = ACCEPTED.contains(&name.as_str())
                || OF_MATERIALS.iter().any(|prefix| name.starts_with(prefix));
            if !accepted {
                return Err(Error::at(
                    format!("/extensionsRequired/{number}"),
                    format!("the file requires the extension {name}, which is not supported"),
                ));
            }
        }
        let buffers = Buffer::all(&root, binary)?;
        Ok(Self {
            root,
            path: path.to_owned(),
            buffers,
        })
    }

    /// The JSON of a file as its text.
    ///
    /// # Errors
    ///
    /// If the file cannot be read, or is no container of UTF-8.
    pub fn text(path: &Path) -> Result<String, Error> {
        let mut file = open(path)?;
        let json = Container::read(&mut file)?.json;
        String::from_utf8(json).map_err(|error| Error::at("", format!("is not UTF-8: {error}")))
    }

    /// All bytes of a buffer.
    ///
    /// # Errors
    ///
    /// If there is no such buffer, or if it cannot be read.
    pub fn buffer(&self, number: usize) -> Result<Vec<u8>, Error> {
        let buffer = Self::item(&self.root.buffers, number, "buffers", || "/buffers".into())?;
        self.buffer_bytes(number, 0, buffer.byte_length.0)
    }

    /// The path of the file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The paths of the files that it refers to: buffers and images. Faulty URIs are left out, and
    /// images that are not there: it may be that no texture uses them.
    pub fn companions(&self) -> Vec<PathBuf> {
        let place = |uri: &str| {
            let relative = crate::buffers::relative_path(uri).ok().flatten()?;
            Some(self.folder().join(relative))
        };
        let buffers = self.root.buffers.iter();
        let buffers = buffers.filter_map(|buffer| place(buffer.uri.as_deref()?));
        let images = self.root.images.iter();
        let images = images.filter_map(|image| place(image.uri.as_deref()?));
        buffers.chain(images.filter(|path| path.exists())).collect()
    }

    /// The folder that its URIs are relative to.
    pub fn folder(&self) -> &Path {
        self.path.parent().unwrap_or(Path::new(""))
    }

    /// The element of a list with this index; an error at the pointer of the index if there is
    /// none.
    pub fn item<'a, T>(
        list: &'a [T],
        index: usize,
        name: &str,
        pointer: impl FnOnce() -> String,
    ) -> Result<&'a T, Error> {
        list.get(index).ok_or_else(|| {
            let message = match list.len() {
                0 => format!("expected the index of an entry of `{name}`, found {index}: there are none"),
                length => {
                    format!("expected the index of an entry of `{name}`, below {length}, found {index}")
                }
            };
            Error::at(pointer(), message)
        })
    }
}

/// The types of a JSON document.
fn deserialized(text: &[u8]) -> Result<json::Root, Error> {
    let mut deserializer = serde_json::Deserializer::from_slice(text);
    let root: json::Root = serde_path_to_error::deserialize(&mut deserializer).map_err(|error| {
        let pointer = pointer(error.path());
        let inner = error.into_inner();
        let place =
            (inner.line() > 0).then(|| format!(" (line {}, column {})", inner.line(), inner.column()));
        let text = inner.to_string();
        // The position is added in the same form for all errors.
        let text = text.split(" at line ").next().unwrap_or(&text);
        Error::at(pointer, format!("{text}{}", place.unwrap_or_default()))
    })?;
    deserializer
        .end()
        .map_err(|error| Error::at("", format!("text after the JSON document: {error}")))?;
    Ok(root)
}

/// The list behind a key.
fn list<'d>(value: &'d mut json::Value, key: &str) -> Option<&'d mut Vec<json::Value>> {
    value.get_mut(key)?.as_array_mut()
}

/// The document with an empty list of nodes in each scene that has none, and without channels of
/// animations that name no node: extensions say what such a channel moves.
fn mended(text: &[u8]) -> Option<Vec<u8>> {
    let mut document: json::Value = serde_json::from_slice(text).ok()?;
    for scene in list(&mut document, "scenes").into_iter().flatten() {
        let nodes = scene.as_object_mut()?.entry("nodes");
        nodes.or_insert_with(|| json::Value::Array(Vec::new()));
    }
    for animation in list(&mut document, "animations").into_iter().flatten() {
        if let Some(channels) = list(animation, "channels") {
            channels
                .retain(|channel| !channel["target"].is_object() || channel["target"].get("node").is_some());
        }
    }
    serde_json::to_vec(&document).ok()
}

/// A path of the deserialiser as a JSON pointer.
fn pointer(path: &serde_path_to_error::Path) -> String {
    use serde_path_to_error::Segment;
    let mut pointer = String::new();
    for segment in path {
        match segment {
            Segment::Seq { index } => pointer.push_str(&format!("/{index}")),
            Segment::Map { key } | Segment::Enum { variant: key } => {
                pointer.push('/');
                pointer.push_str(&key.replace('~', "~0").replace('/', "~1"));
            }
            Segment::Unknown => {}
        }
    }
    pointer
}
