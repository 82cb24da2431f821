//! Markdown pages with parts that a command writes between marker comments.

use crate::terminal::Failure;
use std::path::Path;
use whitstone_image::atomic;

/// The two lines that delimit a part; they are kept.
pub(super) type Marks = [&'static str; 2];

/// Puts each text between its markers, if the page has them. A page with none of the markers is an
/// error.
pub(super) fn write(path: &Path, parts: &[(Marks, String)]) -> Result<(), Failure> {
    let at = |problem: String| Failure::usage(format!("{}: {problem}", path.display()));
    let mut page = std::fs::read_to_string(path).map_err(|error| at(error.to_string()))?;
    let mut written = false;
    for ([begin, end], text) in parts {
        if let (Some(from), Some(to)) = (page.find(begin), page.find(end)) {
            page = format!("{}{begin}\n\n{text}\n{}", &page[..from], &page[to..]);
            written = true;
        }
    }
    if !written {
        let wanted: Vec<String> = parts
            .iter()
            .map(|([begin, end], _)| format!("{begin} and {end}"))
            .collect();
        return Err(at(format!(
            "the page has no marker comments; expected {}",
            wanted.join(", or ")
        )));
    }
    atomic::write_bytes(path, page.as_bytes()).map_err(Failure::environment)
}
