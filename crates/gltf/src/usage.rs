//! How much of its files a process has read: what nobody asks for is neither read nor decoded.

use crate::document::Document;
use crate::json;
use crate::json::accessor::Type;
use crate::json::validation::Checked;
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};

/// The data of a file that this process has opened.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Usage {
    /// Bytes of all accessors and images, as they are stored.
    pub bytes: u64,
    /// Bytes of those that were decoded.
    pub decoded: u64,
}

/// An accessor or image by its index.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Part {
    Accessor(usize),
    Image(usize),
}

#[derive(Default)]
struct File {
    usage: Usage,
    counted: BTreeSet<Part>,
}

static FILES: Mutex<BTreeMap<PathBuf, File>> = Mutex::new(BTreeMap::new());

fn files() -> MutexGuard<'static, BTreeMap<PathBuf, File>> {
    FILES.lock().unwrap_or_else(PoisonError::into_inner)
}

/// The files that this process has opened, by path.
pub fn usage() -> Vec<(PathBuf, Usage)> {
    let files = files();
    files
        .iter()
        .map(|(path, file)| (path.clone(), file.usage.clone()))
        .collect()
}

/// Notes that a file was opened.
pub(crate) fn opened(path: &Path, document: &Document) {
    let parts = (0..document.root.accessors.len()).map(Part::Accessor);
    let parts = parts.chain((0..document.root.images.len()).map(Part::Image));
    let bytes = parts
        .map(|part| size(document, part))
        .fold(0, u64::saturating_add);
    let usage = Usage { bytes, decoded: 0 };
    let counted = BTreeSet::new();
    files().insert(path.to_owned(), File { usage, counted });
}

/// Notes that a part of a file was decoded.
pub(crate) fn decoded(document: &Document, part: Part) {
    let mut files = files();
    if let Some(file) = files.get_mut(document.path())
        && file.counted.insert(part)
    {
        file.usage.decoded = file.usage.decoded.saturating_add(size(document, part));
    }
}

/// The bytes of a part as it is stored; 0 if it is faulty.
fn size(document: &Document, part: Part) -> u64 {
    match part {
        Part::Accessor(number) => document.root.accessors.get(number).map_or(0, size_of_accessor),
        Part::Image(number) => size_of_image(document, number),
    }
}

fn size_of_accessor(accessor: &json::Accessor) -> u64 {
    let (Checked::Valid(component), Checked::Valid(kind)) = (&accessor.component_type, &accessor.type_)
    else {
        return 0;
    };
    let width = match kind {
        Type::Scalar => 1,
        Type::Vec2 => 2,
        Type::Vec3 => 3,
        Type::Vec4 | Type::Mat2 => 4,
        Type::Mat3 => 9,
        Type::Mat4 => 16,
    };
    let element = component.0.size() as u64 * width;
    let dense = accessor.buffer_view.map_or(0, |_| accessor.count.0);
    let sparse = accessor.sparse.as_ref();
    let changed = sparse.map_or(0, |sparse| {
        let index = match &sparse.indices.component_type {
            Checked::Valid(component) => component.0.size() as u64,
            Checked::Invalid => 0,
        };
        sparse.count.0.saturating_mul(index + element)
    });
    dense.saturating_mul(element).saturating_add(changed)
}

fn size_of_image(document: &Document, number: usize) -> u64 {
    let Some(image) = document.root.images.get(number) else {
        return 0;
    };
    if let Some(view) = image.buffer_view {
        let view = document.root.buffer_views.get(view.value());
        return view.map_or(0, |view| view.byte_length.0);
    }
    match document.image_file(number) {
        Some(file) => {
            let folder = document.path().parent().unwrap_or(Path::new(""));
            std::fs::metadata(folder.join(file)).map_or(0, |metadata| metadata.len())
        }
        // Base64 has four characters for three bytes.
        None => image.uri.as_ref().map_or(0, |uri| uri.len() as u64 / 4 * 3),
    }
}
