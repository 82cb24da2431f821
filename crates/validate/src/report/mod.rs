//! The report that people look at: one HTML file without outside parts.
//!
//! `page.html` and `case.html` are its templates, compiled and escaped by `askama`; `view` turns results into what
//! they show; `page.css` and the scripts go into the page as they are. It reads well without these, which sort, filter and
//! copy (`page.js`), show pixels in other ways than the pictures do (`viewer.js`) and point at the dots of diagrams (`studies.js`).

mod changes;
mod number;
mod script;
mod view;

#[cfg(test)]
pub(crate) mod tests;

pub use changes::{Baseline, Change, Changes, Kind};

use crate::Results;
use whitstone_image::error_map::{ErrorView, Quantity, Scale};

/// What the error pictures of a report show, and what its legend says.
pub const ERROR_VIEW: ErrorView = ErrorView {
    quantity: Quantity::Relative,
    scale: Scale::Log { min: 1e-7, max: 1e-1 },
};

/// What a page may have beside the results.
#[derive(Debug, Default)]
pub struct Extras {
    /// Diagrams of error against run time.
    pub diagrams: Vec<Diagram>,
    /// What changed since an earlier run.
    pub changes: Option<Changes>,
}

/// A diagram of a study.
#[derive(Clone, Debug)]
pub struct Diagram {
    /// Name of the study.
    pub name: String,
    /// One line.
    pub title: String,
    /// What it is to show.
    pub about: String,
    /// How it ended.
    pub verdict: String,
    /// The picture, well-formed and of our own making: it goes into the page as it is.
    pub svg: String,
}

/// The page: complete, without anything from a network, to be opened from disk.
pub fn html(results: &Results, extras: &Extras) -> String {
    view::Page::new(results, extras).to_string()
}
