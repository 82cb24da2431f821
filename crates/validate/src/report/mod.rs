//! The report that people look at: one HTML file without outside parts.
//!
//! `page.html` and `case.html` are its templates, compiled and escaped by `askama`; `view` turns results into what
//! they show; `page.css` and `page.js` go into the page as they are. It reads well without the script, which only sorts,
//! filters, copies and points at pixels.

mod number;
mod view;

#[cfg(test)]
mod tests;

use crate::Results;
use whitstone_image::error_map::{ErrorView, Quantity, Scale};

/// What the error pictures of a report show, and what its legend says.
pub const ERROR_VIEW: ErrorView = ErrorView {
    quantity: Quantity::Relative,
    scale: Scale::Log { min: 1e-7, max: 1e-1 },
};

/// The page: complete, without anything from a network, to be opened from disk.
pub fn html(results: &Results) -> String {
    view::Page::new(results).to_string()
}
