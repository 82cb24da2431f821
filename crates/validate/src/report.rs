//! The report that people look at: one HTML file without outside parts.

use crate::Results;

/// The page.
pub fn html(results: &Results) -> String {
    format!("<!doctype html><title>Whitstone</title><pre>{}</pre>", results.summary.cases)
}
