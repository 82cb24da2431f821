//! The pictures and figures of a pair, and the page of `--html`.

use super::{Arguments, Compared, Files, input};
use crate::terminal::{Failure, write_text};
use std::path::Path;
use whitstone_image::Image;
use whitstone_validate::Pictures;
use whitstone_validate::explain::Reason;
use whitstone_validate::report::{ReviewDetails, ReviewPixel, ReviewRow, compare_page, review_details};

/// A pair of the page.
pub(super) struct Entry {
    /// The name of our image.
    pub(super) name: String,
    /// The word of its verdict.
    pub(super) word: &'static str,
    /// Whether it passes or was accepted.
    pub(super) is_right: bool,
    /// Each limit that it exceeds, or why there is no comparison.
    pub(super) problems: Vec<String>,
    /// Its pictures and figures.
    pub(super) details: String,
}

/// Writes the page of all pairs.
pub(super) fn write(arguments: &Arguments, path: &Path, entries: &[Entry]) -> Result<(), Failure> {
    let row = |entry| {
        let entry: &Entry = entry;
        ReviewRow {
            name: &entry.name,
            word: entry.word,
            is_right: entry.is_right,
            problems: &entry.problems,
            writes: None,
            accepted: false,
            details: &entry.details,
        }
    };
    let rows: Vec<ReviewRow<'_>> = entries.iter().map(row).collect();
    write_text(path, &compare_page(&title(arguments), &rows))
}

/// What is compared.
pub(super) fn title(arguments: &Arguments) -> String {
    let [ours, reference] = [&arguments.ours, &arguments.reference];
    format!("{} and {}", ours.display(), reference.display())
}

/// The details of a pair: of its comparison, or if there is none, of the images that can be read.
pub(super) fn details(
    arguments: &Arguments,
    files: &Files,
    compared: Option<&Compared>,
    notes: Vec<String>,
) -> String {
    if let Some(compared) = compared {
        return shown(compared, notes);
    }
    let read = |path: &Path| {
        let read = input::read(path, arguments.layer.as_deref(), arguments.transfer);
        read.ok().map(input::Input::linear)
    };
    let images = [read(&files.ours), read(files.reference())];
    review_details(&ReviewDetails {
        images: images.each_ref().map(Option::as_ref),
        notes,
        ..ReviewDetails::default()
    })
}

/// The details of a pair that can be compared.
fn shown(compared: &Compared, mut notes: Vec<String>) -> String {
    let [ours, reference] = &compared.images;
    let judged = &compared.judged;
    let over = judged.over.pixels().map(|(x, y)| ([x, y], None));
    let explained = judged.explained.iter().flat_map(|mask| mask.pixels());
    let explained = explained.map(|(x, y)| ([x, y], Some(Reason::Stored)));
    notes.push(format!("compared with {}", compared.reference.display()));
    notes.extend(compared.comparison.warnings.iter().cloned());
    let pixel = |pixel: &whitstone_metrics::metrics::WorstPixel| ReviewPixel {
        at: [pixel.x, pixel.y],
        ours: pixel.ours,
        reference: pixel.reference,
        relative: pixel.residual,
    };
    let figures = compared.comparison.figures(ours, reference).into_iter();
    review_details(&ReviewDetails {
        images: [Some::<&Image>(ours), Some(reference)],
        pictures: Pictures::new(ours, reference, over.chain(explained)),
        figures: figures.collect(),
        worst: compared.comparison.worst.iter().map(pixel).collect(),
        notes,
    })
}
