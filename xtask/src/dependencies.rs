//! Checks the dependencies of the workspace: every licence is allowed, and the table in
//! `Cargo.toml` matches their use.

use serde_json::Value;
use std::collections::BTreeSet;
use std::process::Command;

/// Allowed SPDX identifiers, with exceptions where they have one.
const ALLOWED: [&str; 12] = [
    "0BSD",
    "Apache-2.0",
    "Apache-2.0 WITH LLVM-exception",
    "BSD-2-Clause",
    "BSD-3-Clause",
    "BSL-1.0",
    "CC0-1.0",
    "ISC",
    "MIT",
    "MIT-0",
    "Unicode-3.0",
    "Zlib",
];

/// The problems of the dependencies, including those of other platforms and of tests.
pub(crate) fn check() -> Vec<String> {
    // The package outside the workspace has a lock file of its own, which can become outdated.
    let outside = "examples/plugin-superquadric";
    if let Err(problem) = metadata(&["--manifest-path", &format!("{outside}/Cargo.toml")]) {
        return vec![format!(
            "{problem}\n  copy Cargo.lock to {outside} and run `cargo metadata` there"
        )];
    }
    match metadata(&[]) {
        Err(problem) => vec![format!("cargo metadata: {problem}")],
        Ok(metadata) => {
            let manifest = std::fs::read_to_string("Cargo.toml").unwrap_or_default();
            let mut problems = check_licences(&metadata);
            problems.extend(check_table(&table(&manifest), &metadata));
            problems
        }
    }
}

fn metadata(more: &[&str]) -> Result<Value, String> {
    let cargo = std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into());
    let output = Command::new(cargo)
        .args(["metadata", "--format-version", "1", "--locked"])
        .args(more)
        .output()
        .map_err(|error| error.to_string())?;
    if !output.status.success() {
        return Err(String::from_utf8_lossy(&output.stderr).trim().to_owned());
    }
    serde_json::from_slice(&output.stdout).map_err(|error| error.to_string())
}

fn packages(metadata: &Value) -> impl Iterator<Item = &Value> {
    metadata["packages"].as_array().into_iter().flatten()
}

fn check_licences(metadata: &Value) -> Vec<String> {
    packages(metadata)
        .filter_map(|package| {
            let (name, version) = (package["name"].as_str()?, package["version"].as_str()?);
            match package["license"].as_str() {
                None => Some(format!("{name} {version}: names no licence")),
                Some(licence) if !is_allowed(licence) => Some(format!(
                    "{name} {version}: its licence \"{licence}\" is not allowed; xtask/src/dependencies.rs lists the allowed ones"
                )),
                Some(_) => None,
            }
        })
        .collect()
}

/// Names in `[workspace.dependencies]`.
fn table(manifest: &str) -> BTreeSet<&str> {
    let table = manifest.split("[workspace.dependencies]").nth(1);
    let table = table
        .and_then(|rest| rest.split("\n[").next())
        .unwrap_or_default();
    let entries = table.lines().filter_map(|line| line.split_once(" = "));
    entries.map(|(name, _)| name).collect()
}

/// Entries that no member uses, and dependencies of members that are not in the table.
fn check_table(table: &BTreeSet<&str>, metadata: &Value) -> Vec<String> {
    let mut used = BTreeSet::new();
    let mut problems = Vec::new();
    let members = metadata["workspace_members"].as_array();
    let is_member = |package: &Value| members.is_some_and(|members| members.contains(&package["id"]));
    for package in packages(metadata).filter(|package| is_member(package)) {
        for dependency in package["dependencies"].as_array().into_iter().flatten() {
            let name = dependency["rename"].as_str().or(dependency["name"].as_str());
            let name = name.unwrap_or_default();
            if !table.contains(name) {
                problems.push(format!(
                    "{}: its dependency `{name}` is not in the table of the workspace",
                    package["name"].as_str().unwrap_or_default()
                ));
            }
            used.insert(name);
        }
    }
    let unused = table.iter().filter(|name| !used.contains(*name));
    problems.extend(unused.map(|name| format!("Cargo.toml: no member uses the dependency `{name}`")));
    problems
}

/// Whether allowed licences satisfy an SPDX expression. `/` is the old way to write OR, and some
/// packages write operators in lower case.
fn is_allowed(expression: &str) -> bool {
    let spaced = expression
        .replace('(', " ( ")
        .replace(')', " ) ")
        .replace('/', " OR ")
        .replace(" or ", " OR ");
    let mut words = spaced.split_whitespace().peekable();
    any(&mut words) == Some(true) && words.next().is_none()
}

type Words<'a> = std::iter::Peekable<std::str::SplitWhitespace<'a>>;

/// Evaluates alternatives. `None` for an invalid expression.
fn any(words: &mut Words<'_>) -> Option<bool> {
    let mut met = all(words)?;
    while words.next_if_eq(&"OR").is_some() {
        met |= all(words)?;
    }
    Some(met)
}

fn all(words: &mut Words<'_>) -> Option<bool> {
    let mut met = one(words)?;
    while words.next_if_eq(&"AND").is_some() {
        met &= one(words)?;
    }
    Some(met)
}

fn one(words: &mut Words<'_>) -> Option<bool> {
    let mut licence = match words.next()? {
        "(" => {
            let met = any(words)?;
            return words.next_if_eq(&")").map(|_| met);
        }
        licence => licence.to_owned(),
    };
    if words.next_if_eq(&"WITH").is_some() {
        licence = format!("{licence} WITH {}", words.next()?);
    }
    Some(ALLOWED.contains(&licence.as_str()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn expressions_are_met_or_not() {
        for good in [
            "MIT",
            "MIT/Apache-2.0",
            "MIT or Apache-2.0",
            "Unlicense OR MIT",
            "(MIT OR Apache-2.0) AND Unicode-3.0",
            "GPL-3.0 OR Apache-2.0 WITH LLVM-exception",
            "GPL-3.0 OR MIT AND Zlib",
        ] {
            assert!(is_allowed(good), "{good}");
        }
        for bad in [
            "",
            "MPL-2.0",
            "MIT AND MPL-2.0",
            "(MIT OR MPL-2.0) AND GPL-3.0",
            "MIT AND (GPL-3.0 OR AGPL-3.0)",
            "Apache-2.0 WITH Other-exception",
            "MIT OR",
            "(MIT",
            "MIT)",
            "MIT MIT",
        ] {
            assert!(!is_allowed(bad), "{bad}");
        }
    }

    #[test]
    fn what_is_not_allowed_is_named() {
        let package =
            |name: &str, licence: Value| json!({ "name": name, "version": "1.0.0", "license": licence });
        let metadata = json!({ "packages": [
            package("good", json!("MIT")),
            package("copyleft", json!("MPL-2.0")),
            package("silent", Value::Null),
        ] });
        let problems = check_licences(&metadata);
        assert_eq!(problems.len(), 2);
        assert!(problems[0].starts_with("copyleft 1.0.0: its licence \"MPL-2.0\""));
        assert_eq!(problems[1], "silent 1.0.0: names no licence");
    }

    #[test]
    fn the_table_is_what_is_used() {
        let manifest = "[workspace.dependencies]\nglam = \"1\"\ntobj = { version = \"4\" }\n\n[profile.dev]\nopt-level = 2\n";
        assert_eq!(table(manifest), BTreeSet::from(["glam", "tobj"]));
        let metadata = json!({
            "workspace_members": ["ours"],
            "packages": [
                { "id": "ours", "name": "core", "dependencies": [
                    { "name": "glam", "rename": null },
                    { "name": "own", "rename": "other" },
                ] },
                { "id": "theirs", "name": "glam", "dependencies": [{ "name": "tobj", "rename": null }] },
            ],
        });
        assert_eq!(
            check_table(&table(manifest), &metadata),
            [
                "core: its dependency `other` is not in the table of the workspace",
                "Cargo.toml: no member uses the dependency `tobj`",
            ]
        );
    }
}
