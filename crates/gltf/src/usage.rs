//! How much of its files a process has read: what nobody asks for is neither read nor decoded.

use crate::document::Document;
use crate::json;
use crate::json::accessor::Type;
use crate::json::validation::Checked;
use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;
use std::sync::{Mutex, PoisonError};

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

/// What was decoded of each file.
static DECODED: Mutex<BTreeMap<PathBuf, BTreeSet<Part>>> = Mutex::new(BTreeMap::new());

/// The files of which this process has decoded something, by path.
pub fn usage() -> Vec<(PathBuf, Usage)> {
    let decoded = DECODED.lock().unwrap_or_else(PoisonError::into_inner).clone();
    let of = |(path, parts): (PathBuf, BTreeSet<Part>)| {
        let document = Document::open(&path).ok()?;
        let sum = |parts: &mut dyn Iterator<Item = Part>| {
            parts
                .map(|part| size(&document, part))
                .fold(0, u64::saturating_add)
        };
        let accessors = (0..document.root.accessors.len()).map(Part::Accessor);
        let images = (0..document.root.images.len()).map(Part::Image);
        let usage = Usage {
            bytes: sum(&mut accessors.chain(images)),
            decoded: sum(&mut parts.into_iter()),
        };
        Some((path, usage))
    };
    decoded.into_iter().filter_map(of).collect()
}

/// Notes that a part of a file was decoded.
pub(crate) fn decoded(document: &Document, part: Part) {
    let mut files = DECODED.lock().unwrap_or_else(PoisonError::into_inner);
    match files.get_mut(document.path()) {
        Some(parts) => drop(parts.insert(part)),
        None => drop(files.insert(document.path().to_owned(), BTreeSet::from([part]))),
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
        Some(file) => std::fs::metadata(document.folder().join(file)).map_or(0, |metadata| metadata.len()),
        // Base64 has four characters for three bytes.
        None => image.uri.as_ref().map_or(0, |uri| uri.len() as u64 / 4 * 3),
    }
}
