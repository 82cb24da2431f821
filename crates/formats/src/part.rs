//! What all importers of single objects share: options, transform, fitted camera and lights.

use crate::document::{Document, transform};
use crate::files::shorten;
use crate::fit;
use toml::Table;
use whitstone_core::{DAffine3, DVec3, FormatError, ImportOptions};

/// Bounds of an imported object in metres, before the transform of the options; empty if `low` is
/// greater than `high`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Part {
    pub(crate) low: DVec3,
    pub(crate) high: DVec3,
}

impl Part {
    /// The bounds of nothing.
    pub(crate) const EMPTY: Self = Self {
        low: DVec3::INFINITY,
        high: DVec3::NEG_INFINITY,
    };

    /// Adds a point; points that are not finite are skipped.
    pub(crate) fn add(&mut self, point: DVec3) {
        if point.is_finite() {
            self.low = self.low.min(point);
            self.high = self.high.max(point);
        }
    }

    /// The bounds of the transformed box.
    pub(crate) fn transformed(&self, map: &DAffine3) -> Self {
        if !self.low.cmple(self.high).all() {
            return *self;
        }
        let mut bounds = Self::EMPTY;
        for corner in 0..8 {
            let pick = |axis: usize| {
                if corner >> axis & 1 == 0 {
                    self.low[axis]
                } else {
                    self.high[axis]
                }
            };
            bounds.add(map.transform_point3(DVec3::new(pick(0), pick(1), pick(2))));
        }
        bounds
    }

    /// Adds a film, a camera and lights to a document that is a whole scene.
    pub(crate) fn fit(&self, document: &mut Document, options: &ImportOptions) {
        if options.part {
            return;
        }
        let Self { low, high } = self.transformed(&options.transform);
        document.single.push(("film", fit::film()));
        document.single.push(("camera", fit::camera(low, high)));
        document.lights.extend(fit::lights(low, high));
    }
}

/// Adds the transform of the options to a shape that has none.
pub(crate) fn place(shape: &mut Table, options: &ImportOptions) {
    if options.transform != DAffine3::IDENTITY {
        shape.insert("transform".to_owned(), transform(&options.transform));
    }
}

/// An error if the options select something that a file without scenes, nodes and cameras lacks.
pub(crate) fn no_selection(options: &ImportOptions, what: &str) -> Result<(), FormatError> {
    let selections = [
        ("scenes", &options.scene),
        ("nodes", &options.node),
        ("cameras", &options.camera),
    ];
    match selections.into_iter().find(|(_, selection)| selection.is_some()) {
        None => Ok(()),
        Some((plural, _)) => Err(FormatError::anywhere(format!("{what} has no {plural} to select"))),
    }
}

/// The error of a key of `materials` that the file does not have.
pub(crate) fn unknown_material(name: &str, known: &[String]) -> FormatError {
    let message = format!("no material is called \"{}\"", shorten(name));
    let known: Vec<String> = known
        .iter()
        .take(20)
        .map(|name| format!("\"{}\"", shorten(name)))
        .collect();
    let error = FormatError::anywhere(message);
    if known.is_empty() {
        error.with_help("the file has no materials")
    } else {
        error.with_help(format!("materials of the file: {}", known.join(", ")))
    }
}
