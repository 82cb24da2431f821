//! The checks of `tidy` for third-party backends, which replace those for plugins. Backends
//! have no example scene, no stored reference and no property tests of accelerators, because they
//! are not built by default and their images are not ours.

use crate::parameters::undocumented_parameters;
use std::fs;
use std::path::Path;
use whitstone::core::Entry;

/// The crate that registers them.
pub(crate) const CRATE: &str = "whitstone-backends";

const FOLDER: &str = "crates/backends";
const TESTS: &str = "crates/backends/tests/backends.rs";
const DOCUMENTATION: &str = "docs/backends.md";

/// Its features: the names of the backends.
pub(crate) fn names() -> Vec<String> {
    features(&read(&format!("{FOLDER}/Cargo.toml")))
        .map(|(name, _)| name.to_owned())
        .collect()
}

fn read(path: &str) -> String {
    fs::read_to_string(path).unwrap_or_default()
}

/// Name and value of each feature except `default`.
fn features(manifest: &str) -> impl Iterator<Item = (&str, &str)> {
    let table = manifest.split("[features]").nth(1).unwrap_or_default();
    let table = table.split("\n[").next().unwrap_or_default();
    let entries = table.lines().filter_map(|line| line.split_once(" = "));
    entries.filter(|(name, _)| *name != "default")
}

/// Each backend must have a file, tests and documentation. Every crate that forwards it must have
/// it as a feature, and none may enable it by default. `built` are the backends in this program.
pub(crate) fn check(built: &[&Entry]) -> Vec<String> {
    let mut problems = check_names(&names(), &read);
    for entry in built {
        let keys = undocumented_parameters(entry);
        problems
            .extend(keys.map(|key| format!("{FOLDER}/src/{}.rs: `{key}` has no documentation", entry.name)));
        if entry.summary().is_empty() {
            problems.push(format!(
                "{FOLDER}/src/{}.rs: `Config` has no documentation",
                entry.name
            ));
        }
    }
    // Apart from the crate root and the shared files, each file is a backend.
    for file in fs::read_dir(Path::new(FOLDER).join("src"))
        .into_iter()
        .flatten()
        .flatten()
    {
        let name = file.file_name().to_string_lossy().into_owned();
        let stem = name.strip_suffix(".rs").unwrap_or("lib");
        if !["lib", "single"].contains(&stem) && !names().iter().any(|backend| backend == stem) {
            problems.push(format!(
                "{FOLDER}/src/{name}: there is no feature `{stem}` for this file"
            ));
        }
    }
    problems
}

fn check_names(names: &[String], read: &dyn Fn(&str) -> String) -> Vec<String> {
    let mut problems = Vec::new();
    let mut require = |good: bool, problem: String| {
        if !good {
            problems.push(problem);
        }
    };
    let lib = read(&format!("{FOLDER}/src/lib.rs"));
    for name in names {
        let file = format!("{FOLDER}/src/{name}.rs");
        let source = read(&file);
        require(
            source.starts_with("//! "),
            format!("{file}: no file, or no module documentation"),
        );
        require(
            source.contains(&format!("accelerator.type={name}")),
            format!("{file}: the documentation has no example \"--set accelerator.type={name}\""),
        );
        require(
            source.contains("approximation_note: "),
            format!("{file}: no `approximation_note`, which reports that images depend on the backend"),
        );
        require(
            lib.contains(&format!("registry.add::<whitstone_core::Accelerators, {name}::")),
            format!("{FOLDER}/src/lib.rs: does not register `{name}`"),
        );
        let tests = read(TESTS);
        for part in [
            format!("whitstone_backends::{name}::"),
            format!("type = \\\"{name}\\\""),
        ] {
            require(
                tests.contains(&part),
                format!("{TESTS}: does not contain `{part}`"),
            );
        }
        require(
            read(DOCUMENTATION).contains(&format!("`{name}`")),
            format!("{DOCUMENTATION}: does not describe `{name}`"),
        );
        for manifest in ["crates/whitstone/Cargo.toml", "xtask/Cargo.toml"] {
            let text = read(manifest);
            require(
                features(&text).any(|(feature, _)| feature == name),
                format!("{manifest}: does not forward the feature `{name}`"),
            );
        }
    }
    let defaults = [
        "crates/backends/Cargo.toml",
        "crates/whitstone/Cargo.toml",
        "xtask/Cargo.toml",
    ];
    for manifest in defaults {
        let text = read(manifest);
        let default = text.lines().find_map(|line| line.strip_prefix("default = "));
        require(
            !default.is_some_and(|default| names.iter().any(|name| default.contains(&format!("\"{name}\"")))),
            format!("{manifest}: a backend is enabled by default; backends must be opt-in"),
        );
    }
    problems
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_a_backend_lacks_is_named() {
        std::env::set_current_dir(crate::root()).unwrap();
        assert_eq!(names(), ["embree", "obvhs"]);
        assert_eq!(check(&[]), Vec::<String>::new());
        let missing = check_names(&["nonesuch".to_owned()], &read);
        assert_eq!(missing.len(), 9, "{missing:#?}");
        let on = check_names(&names(), &|path| {
            read(path).replace("default = []", "default = [\"embree\"]")
        });
        assert_eq!(on.len(), 1, "{on:#?}");
    }
}
