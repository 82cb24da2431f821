//! Finds lines of prose that are too wide: comments and Markdown of more than 100 columns.
//!
//! Code, tables, pictures, fenced blocks and blocks that are indented like code are exempt.

use std::fs;
use std::path::{Path, PathBuf};

/// Maximum number of characters in a line.
const MAX: usize = 100;
/// Folders that are checked.
const FOLDERS: [&str; 10] = [
    "benches",
    "crates",
    "docs",
    "examples",
    "references",
    "scenes",
    "studies",
    "tests",
    "xtask",
    ".ci",
];
/// Files that a command writes, or that a test compares byte by byte.
const GENERATED: [&str; 3] = ["docs/plugins", "tests/bad", "target"];

/// Every line that is too long.
pub(crate) fn check() -> Vec<String> {
    let mut problems = Vec::new();
    let top = ["README.md", "ARCHITECTURE.md", "CONTRIBUTING.md", "CHANGELOG.md"];
    let mut files: Vec<PathBuf> = top.into_iter().map(PathBuf::from).collect();
    FOLDERS
        .into_iter()
        .for_each(|folder| find(Path::new(folder), &mut files));
    files.sort();
    for file in files {
        let text = fs::read_to_string(&file).unwrap_or_default();
        let extension = file.extension().and_then(|extension| extension.to_str());
        for number in too_long(&text, marks(extension)) {
            problems.push(format!(
                "{}:{number}: this line has more than {MAX} columns; wrap it",
                file.display()
            ));
        }
    }
    problems
}

fn find(folder: &Path, files: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(folder).into_iter().flatten().flatten() {
        let path = entry.path();
        let is_generated = GENERATED.iter().any(|generated| path.ends_with(generated));
        if path.is_dir() && !is_generated {
            find(&path, files);
        } else if path.is_file() && is_text(&path) {
            files.push(path);
        }
    }
}

fn is_text(path: &Path) -> bool {
    let extension = path.extension().and_then(|extension| extension.to_str());
    matches!(extension, Some("md" | "rs" | "py" | "toml" | "sh")) || path.ends_with(".ci/run")
}

/// The markers of prose in files of a kind; none for Markdown, which is all prose.
fn marks(extension: Option<&str>) -> &'static [&'static str] {
    match extension {
        Some("md") => &[],
        Some("rs") => &["///", "//!", "//"],
        _ => &["#"],
    }
}

/// The numbers of the lines that are too long.
fn too_long(text: &str, marks: &[&str]) -> Vec<usize> {
    let mut found = Vec::new();
    let mut fenced = false;
    for (line, number) in text.lines().zip(1..) {
        let trimmed = line.trim_start();
        let body = if marks.is_empty() {
            line
        } else {
            let Some(body) = marks.iter().find_map(|mark| trimmed.strip_prefix(mark)) else {
                fenced = false;
                continue;
            };
            // `#!` and the directives of other languages are not prose.
            if marks == ["#"] && !body.starts_with(' ') {
                continue;
            }
            body.strip_prefix(' ').unwrap_or(body)
        };
        if body.trim_start().starts_with("```") {
            fenced = !fenced;
        }
        let code = fenced || body.starts_with("    ");
        let whole = ["|", "![", "<!--"]
            .iter()
            .any(|mark| body.trim_start().starts_with(mark));
        // A link or a path cannot be broken.
        let is_one_word = !body.trim().contains(' ');
        if !code && !whole && !is_one_word && line.chars().count() > MAX {
            found.push(number);
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prose_is_counted_and_code_is_not() {
        let long = "word ".repeat(21);
        let markdown = format!("{long}\n```\n{long}\n```\n| {long}\n    {long}\n- {long}\nshort\n");
        assert_eq!(too_long(&markdown, marks(Some("md"))), [1, 7]);
        let rust =
            format!("    // {long}\n    let x = 1; // {long}\n/// ```\n/// {long}\n/// ```\n//! {long}\n");
        assert_eq!(too_long(&rust, marks(Some("rs"))), [1, 6]);
        let python = format!("# {long}\nvalue = 1  # {long}\n#     {long}\n");
        assert_eq!(too_long(&python, marks(Some("py"))), [1]);
        assert_eq!(too_long(&"é".repeat(MAX), &[]), Vec::<usize>::new());
    }
}
