//! Checks the links between documents: their files exist, and links of the book lead to pages of
//! the book.

use std::fs;
use std::path::{Path, PathBuf};

/// Documents outside `docs/`.
const OTHERS: [&str; 7] = [
    "README.md",
    "ARCHITECTURE.md",
    "CONTRIBUTING.md",
    "CHANGELOG.md",
    "examples/plugin-superquadric/README.md",
    "references/mitsuba/README.md",
    "references/povray/README.md",
];
/// The table of contents of the book.
const SUMMARY: &str = "docs/SUMMARY.md";

/// Broken links, and documents that are missing in the book.
pub(crate) fn check() -> Vec<String> {
    let mut documents: Vec<PathBuf> = OTHERS.into_iter().map(PathBuf::from).collect();
    documents.extend(below(Path::new("docs")));
    let mut problems = Vec::new();
    for document in &documents {
        let text = fs::read_to_string(document).unwrap_or_default();
        problems.extend(dead(document, &text));
    }
    let summary = fs::read_to_string(SUMMARY).unwrap_or_default();
    let listed: Vec<&str> = targets(&summary).collect();
    for page in below(Path::new("docs")) {
        let path = page.strip_prefix("docs").unwrap_or(&page).display().to_string();
        if page != Path::new(SUMMARY) && !listed.contains(&path.as_str()) {
            problems.push(format!("{SUMMARY}: {path} is missing; run `cargo xtask readme`"));
        }
    }
    problems
}

/// The links of a document whose files do not exist.
fn dead(document: &Path, text: &str) -> Vec<String> {
    let folder = document.parent().unwrap_or(Path::new(""));
    let inside = targets(text).filter(|target| !target.contains("://") && !target.starts_with('#'));
    let files = inside.map(|target| target.split('#').next().unwrap_or(target));
    let missing = files.filter(|target| !folder.join(target).exists());
    let missing = missing.map(|target| format!("{}: broken link to {target}", document.display()));
    missing.collect()
}

/// The targets of the links and pictures of a text, outside code.
fn targets(text: &str) -> impl Iterator<Item = &str> {
    let mut in_code = false;
    let lines = text.lines().filter(move |line| {
        let fence = line.trim_start().starts_with("```");
        in_code ^= fence;
        !in_code && !fence
    });
    lines.flat_map(|line| {
        let parts = line.split("](").skip(1);
        parts
            .filter_map(|rest| rest.split(')').next())
            .filter(|target| !target.contains(' '))
    })
}

/// All documents in a folder and its subfolders.
fn below(folder: &Path) -> Vec<PathBuf> {
    let mut found = Vec::new();
    for entry in fs::read_dir(folder).into_iter().flatten().flatten() {
        let path = entry.path();
        if path.is_dir() {
            found.extend(below(&path));
        } else if path.extension().is_some_and(|extension| extension == "md") {
            found.push(path);
        }
    }
    found.sort();
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dead_links_are_found_and_code_is_no_link() {
        std::env::set_current_dir(crate::root()).unwrap();
        let text = "[a](shapes.md) [b](gone.md) ![c](images/gone.png) [d](https://gone.example/x) [e](#f)\n\
                    ```\n[g](not-this.md)\n```\n[h](shapes.md#part) [i](../README.md)";
        let found = dead(Path::new("docs/some.md"), text);
        assert_eq!(found.len(), 2, "{found:?}");
        assert!(found[0].contains("gone.md") && found[1].contains("images/gone.png"));
        assert_eq!(check(), Vec::<String>::new());
    }
}
