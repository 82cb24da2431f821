//! Collects the data in the header comments of plugin files (twin, example, laws) for
//! `whitstone list --json`.

use crate::backends;
use serde_json::{Value, json};
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::{fs, io};
use whitstone::core::Registry;

/// Written by `cargo xtask readme`; embedded into the command line.
pub(crate) const FILE: &str = "crates/whitstone/src/plugins.json";

/// The content of the file.
pub(crate) fn json(registry: &Registry) -> String {
    // Sorted here, because the order of JSON maps depends on a feature that other packages may
    // enable.
    let mut families: BTreeMap<&str, BTreeMap<&str, BTreeMap<&str, Value>>> = BTreeMap::new();
    for entry in registry
        .entries()
        .filter(|entry| entry.crate_name != backends::CRATE)
    {
        let family = entry.family.plural();
        let path = format!("crates/{family}/src/{}.rs", entry.name);
        let source = fs::read_to_string(path).unwrap_or_default();
        let twin = note(&source, "Twin").map(|text| text.trim_end_matches('.').to_owned());
        let example = note(&source, "Example").map(|text| text.trim_matches(['`', '.']).to_owned());
        let notes = [
            ("twin", json!(twin)),
            ("example", json!(example)),
            ("laws", json!(laws(&source))),
        ];
        families
            .entry(family)
            .or_default()
            .insert(entry.name, BTreeMap::from(notes));
    }
    format!("{:#}\n", json!(families))
}

/// The package from which `whitstone new-plugin` makes others.
const PACKAGE: &str = "examples/plugin-superquadric";

/// Written by `cargo xtask readme`; embedded into the command line.
pub(crate) const PACKAGE_FILE: &str = "crates/whitstone/src/commands/scaffold/package.json";

/// The content of the file: the texts of the package by path.
pub(crate) fn package() -> io::Result<String> {
    let files = [
        "Cargo.toml",
        "README.md",
        "scenes/superquadric.toml",
        "src/lib.rs",
        "src/main.rs",
        "src/superquadric.py",
        "src/superquadric.rs",
    ];
    let mut texts = BTreeMap::new();
    for file in files {
        texts.insert(file, fs::read_to_string(Path::new(PACKAGE).join(file))?);
    }
    Ok(format!("{:#}\n", json!(texts)))
}

/// The text after a name in the list of a header, up to the next item.
pub(crate) fn note(source: &str, name: &str) -> Option<String> {
    let header = source.lines().map_while(|line| line.strip_prefix("//!"));
    let start = format!("- {name}: ");
    let mut lines = header.map(str::trim).skip_while(|line| !line.starts_with(&start));
    let first = lines.next()?.strip_prefix(&start)?.to_owned();
    let rest = lines.take_while(|line| !line.is_empty() && !line.starts_with("- "));
    Some(rest.fold(first, |text, line| format!("{text} {line}")))
}

/// The text of a header between its first sentence and its list: the method and its source.
pub(crate) fn method(source: &str) -> String {
    let header = source.lines().map_while(|line| line.strip_prefix("//!"));
    let lines = header.map(|line| line.strip_prefix(' ').unwrap_or(line));
    let body = lines
        .skip_while(|line| !line.is_empty())
        .take_while(|line| !line.starts_with("- Twin: "));
    let text = body.collect::<Vec<_>>().join("\n");
    text.trim().to_owned()
}

/// The functions called from tests whose names mark them as laws (property tests).
pub(crate) fn laws(source: &str) -> Vec<&str> {
    let words = source.split(|c: char| !c.is_alphanumeric() && c != '_');
    let laws: BTreeSet<&str> = words.filter(|word| is_law(word)).collect();
    laws.into_iter().collect()
}

fn is_law(word: &str) -> bool {
    (word.ends_with("_laws") || word.contains("_laws_")) && !word.starts_with("obeys")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn notes_and_laws_are_found() {
        let source = "//! A thing.\n//!\n//! - Twin: Mitsuba `thing`,\n//!   by hand.\n//! - Example: `scenes/shapes/thing.toml`.\n\nuse x::{thing_laws};\n#[test]\nfn obeys_the_laws_of_things() { thing_laws::<Thing>(\"\"); thing_laws_everywhere() }\n//! - Twin: no\n";
        assert_eq!(note(source, "Twin").as_deref(), Some("Mitsuba `thing`, by hand."));
        assert_eq!(
            note(source, "Example").as_deref(),
            Some("`scenes/shapes/thing.toml`.")
        );
        assert_eq!(note(source, "Source"), None);
        assert_eq!(
            method("//! A.\n//!\n//! By B\n//! (C).\n//!\n//! D.\n//!\n//! - Twin: e\n"),
            "By B\n(C).\n\nD."
        );
        assert_eq!(method("//! A.\n"), "");
        assert_eq!(laws(source), ["thing_laws", "thing_laws_everywhere"]);
    }
}
