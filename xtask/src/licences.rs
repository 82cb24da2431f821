//! The licences of the packages that are part of the program `whitstone`, for its users
//! (`whitstone doctor --licenses`).

use crate::dependencies::{metadata, packages};
use serde_json::Value;
use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;
use std::fs;
use std::path::Path;

/// Written by `cargo xtask readme`; embedded into the command line.
pub(crate) const FILE: &str = "crates/whitstone/src/licences.txt";

/// The content of the file.
pub(crate) fn text() -> Result<String, String> {
    let metadata = metadata(&[])?;
    let linked = linked(&metadata);
    let mut list = String::from("Packages that are part of this program:\n\n");
    let mut texts: BTreeMap<String, BTreeSet<&str>> = BTreeMap::new();
    for package in packages(&metadata) {
        let text = |key: &str| package[key].as_str().unwrap_or_default();
        // The workspace's own packages have no source.
        if !linked.contains(text("id")) || package["source"].is_null() {
            continue;
        }
        let (name, version) = (text("name"), text("version"));
        writeln!(
            list,
            "{name} {version} ({}) {}",
            text("license"),
            text("repository")
        )
        .map_err(|error| error.to_string())?;
        let folder = Path::new(text("manifest_path")).parent();
        for found in notices(folder.unwrap_or(Path::new("."))).map_err(|error| format!("{name}: {error}"))? {
            texts.entry(found).or_default().insert(name);
        }
    }
    for (text, names) in texts {
        let names: Vec<&str> = names.into_iter().collect();
        write!(list, "\n{}\n{}\n\n{text}\n", "-".repeat(80), names.join(", "))
            .map_err(|error| error.to_string())?;
    }
    Ok(list)
}

/// The ids of the packages that `whitstone` links, directly or not.
fn linked(metadata: &Value) -> BTreeSet<&str> {
    let nodes = metadata["resolve"]["nodes"].as_array();
    let nodes: BTreeMap<&str, &Value> = nodes
        .into_iter()
        .flatten()
        .filter_map(|node| Some((node["id"].as_str()?, node)))
        .collect();
    let start = packages(metadata).find(|package| package["name"] == "whitstone");
    let mut open: Vec<&str> = start
        .and_then(|package| package["id"].as_str())
        .into_iter()
        .collect();
    let mut found = BTreeSet::new();
    while let Some(id) = open.pop() {
        if !found.insert(id) {
            continue;
        }
        let links = |dependency: &&Value| {
            let kinds = dependency["dep_kinds"].as_array();
            kinds.into_iter().flatten().any(|kind| kind["kind"].is_null())
        };
        let dependencies = nodes.get(id).and_then(|node| node["deps"].as_array());
        let dependencies = dependencies.into_iter().flatten().filter(links);
        open.extend(dependencies.filter_map(|dependency| dependency["pkg"].as_str()));
    }
    found
}

/// The texts of the licences in the folder of a package. Where it leaves the choice, the one of
/// MIT.
fn notices(folder: &Path) -> std::io::Result<Vec<String>> {
    let mut files = Vec::new();
    for entry in fs::read_dir(folder)? {
        let entry = entry?;
        let name = entry.file_name().to_string_lossy().to_uppercase();
        let is_notice = ["LICENSE", "LICENCE", "COPYING", "NOTICE", "COPYRIGHT"]
            .iter()
            .any(|start| name.starts_with(start));
        if is_notice && entry.file_type()?.is_file() {
            files.push((name, entry.path()));
        }
    }
    files.sort();
    if files.iter().any(|(name, _)| name.contains("MIT")) {
        files.retain(|(name, _)| name.contains("MIT") || name.starts_with("NOTICE"));
    }
    let mut texts = Vec::new();
    for (_, path) in files {
        let text = String::from_utf8_lossy(&fs::read(path)?).replace("\r\n", "\n");
        let lines: Vec<&str> = text.lines().map(str::trim_end).collect();
        texts.push(lines.join("\n").trim().to_owned());
    }
    Ok(texts)
}
