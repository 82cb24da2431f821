//! Checks the dependencies of the workspace: every licence and every build script is allowed by
//! `deny.toml`, the table in `Cargo.toml` is sorted and matches their use, and published packages
//! contain their licence.

use serde_json::Value;
use std::collections::BTreeSet;
use std::path::Path;
use std::process::Command;

/// The file with the allowed licences and build scripts, which cargo-deny reads too. Its checks of
/// them are repeated here because it takes many minutes to build on a machine with two cores.
const RULES: &str = "deny.toml";

/// The problems of the dependencies, including those of other platforms and of tests.
pub(crate) fn check() -> Vec<String> {
    // Packages outside the workspace have lock files of their own, which can become outdated.
    for outside in ["examples/embed", "examples/plugin-superquadric", "tests/fuzz"] {
        if let Err(problem) = metadata(&["--manifest-path", &format!("{outside}/Cargo.toml")]) {
            return vec![format!(
                "{problem}\n  copy Cargo.lock to {outside} and run `cargo metadata` there"
            )];
        }
    }
    let metadata = match metadata(&["--all-features"]) {
        Err(problem) => return vec![format!("cargo metadata: {problem}")],
        Ok(metadata) => metadata,
    };
    let rules = std::fs::read_to_string(RULES).unwrap_or_default();
    let mut problems = match (names(&rules, LICENCES), names(&rules, BUILD_SCRIPTS)) {
        (Err(problem), _) | (_, Err(problem)) => vec![format!("{RULES}: {problem}")],
        (Ok(licences), Ok(scripts)) => {
            let mut problems = check_licences(&licences, &metadata);
            problems.extend(check_build_scripts(&scripts, &metadata));
            problems
        }
    };
    let manifest = std::fs::read_to_string("Cargo.toml").unwrap_or_default();
    problems.extend(check_order(&manifest));
    problems.extend(check_table(&table(&manifest), &metadata));
    problems.extend(missing_licences(&metadata));
    let package = std::fs::read_to_string(PACKAGE).unwrap_or_default();
    for file in PINNED {
        let pinned = std::fs::read_to_string(file).unwrap_or_default();
        problems.extend(other_pins(&package, file, &pinned));
    }
    problems
}

/// The Python package, whose extras pin what the private environments install.
const PACKAGE: &str = "crates/python/pyproject.toml";
/// What the private environments install.
const PINNED: [&str; 2] = [
    "references/mitsuba/requirements.in",
    "crates/whitstone/cluster/requirements.in",
];

/// The extras of the Python package that pin another version than the file.
fn other_pins(package: &str, file: &str, pinned: &str) -> Vec<String> {
    let package: toml::Table = package.parse().unwrap_or_default();
    let extras = (package.get("project"))
        .and_then(|project| project.get("optional-dependencies")?.as_table().cloned())
        .unwrap_or_default();
    let extras = extras.values().filter_map(toml::Value::as_array).flatten();
    let extras: BTreeSet<&str> = extras
        .filter_map(|extra| extra.as_str()?.split(';').next())
        .collect();
    let name = |pin: &str| pin.split("==").next().unwrap_or_default().to_owned();
    let pins = pinned.lines().filter_map(|line| line.split(';').next());
    // A pin with a condition is of no extra, or has another one for other versions of Python.
    pins.filter(|pin| !pin.starts_with('#') && !pin.is_empty())
        .filter(|pin| {
            extras
                .iter()
                .any(|extra| name(extra) == name(pin) && extra.contains("=="))
        })
        .filter(|pin| !extras.contains(pin))
        .map(|pin| format!("{PACKAGE}: an extra pins another version than {pin} in {file}"))
        .collect()
}

/// The published packages of the workspace that lack the text of a licence: the links to those in
/// the root become files when a package is made.
fn missing_licences(metadata: &Value) -> Vec<String> {
    let own =
        packages(metadata).filter(|package| package["source"].is_null() && package["publish"].is_null());
    let folders = own.filter_map(|package| Path::new(package["manifest_path"].as_str()?).parent());
    let files = folders.flat_map(|folder| ["LICENSE-MIT", "LICENSE-APACHE"].map(|name| folder.join(name)));
    files
        .filter(|file| !file.is_file())
        .map(|file| format!("{} is missing; link it to the file in the root", file.display()))
        .collect()
}

/// Names that the rules allow.
type Allowed = BTreeSet<String>;

/// The key of SPDX identifiers, with exceptions where they have one.
const LICENCES: &str = "licenses.allow";
/// The key of packages of others that may have a build script.
const BUILD_SCRIPTS: &str = "bans.build.allow-build-scripts";

/// A list of names in the rules.
fn names(rules: &str, key: &str) -> Result<Allowed, String> {
    let rules: toml::Table = rules
        .parse()
        .map_err(|error: toml::de::Error| error.to_string())?;
    let rules = toml::Value::Table(rules);
    let list = key.split('.').try_fold(&rules, |table, key| table.get(key));
    let list = list.and_then(toml::Value::as_array);
    let list = list.ok_or_else(|| format!("{key} is not a list"))?;
    list.iter()
        .map(|name| {
            let name = name.as_str();
            name.map(str::to_owned)
                .ok_or_else(|| format!("{key} contains something other than names"))
        })
        .collect()
}

/// Packages of others whose build script is not in the list, and entries of the list without one.
fn check_build_scripts(allowed: &Allowed, metadata: &Value) -> Vec<String> {
    let has_script = |package: &&Value| {
        let mut targets = package["targets"].as_array().into_iter().flatten();
        !package["source"].is_null() && targets.any(|target| target["kind"][0] == "custom-build")
    };
    let found: BTreeSet<&str> = packages(metadata)
        .filter(has_script)
        .filter_map(|package| package["name"].as_str())
        .collect();
    let new = found.iter().filter(|name| !allowed.contains(**name));
    let new = new.map(|name| {
        format!(
            "{name} has a build script; read it, and add it to {BUILD_SCRIPTS} in {RULES}, in the group of what it does"
        )
    });
    let gone = allowed.iter().filter(|name| !found.contains(name.as_str()));
    let gone =
        gone.map(|name| format!("{RULES}: {BUILD_SCRIPTS} contains {name}, which has no build script here"));
    new.chain(gone).collect()
}

pub(crate) fn metadata(more: &[&str]) -> Result<Value, String> {
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

pub(crate) fn packages(metadata: &Value) -> impl Iterator<Item = &Value> {
    metadata["packages"].as_array().into_iter().flatten()
}

fn check_licences(allowed: &Allowed, metadata: &Value) -> Vec<String> {
    packages(metadata)
        .filter_map(|package| {
            let (name, version) = (package["name"].as_str()?, package["version"].as_str()?);
            match package["license"].as_str() {
                None => Some(format!("{name} {version}: names no licence")),
                Some(licence) if !is_allowed(allowed, licence) => Some(format!(
                    "{name} {version}: its licence \"{licence}\" is not allowed; {RULES} lists the allowed ones"
                )),
                Some(_) => None,
            }
        })
        .collect()
}

/// The lines of `[workspace.dependencies]`.
fn lines(manifest: &str) -> std::str::Lines<'_> {
    let table = manifest.split("[workspace.dependencies]").nth(1);
    let table = table.and_then(|rest| rest.split("\n[").next());
    table.unwrap_or_default().lines()
}

/// Names in `[workspace.dependencies]`.
fn table(manifest: &str) -> BTreeSet<&str> {
    let entries = lines(manifest).filter_map(|line| line.split_once(" = "));
    entries.map(|(name, _)| name).collect()
}

/// Entries of the table that are not sorted by name. Blank lines separate groups.
fn check_order(manifest: &str) -> Vec<String> {
    let mut problems = Vec::new();
    let mut before = "";
    for line in lines(manifest) {
        if line.is_empty() {
            before = "";
        } else if let Some((name, _)) = line.split_once(" = ") {
            if name < before {
                problems.push(format!(
                    "Cargo.toml: the dependency `{name}` belongs before `{before}`"
                ));
            }
            before = name;
        }
    }
    problems
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
fn is_allowed(allowed: &Allowed, expression: &str) -> bool {
    let spaced = expression
        .replace('(', " ( ")
        .replace(')', " ) ")
        .replace('/', " OR ")
        .replace(" or ", " OR ");
    let mut words = spaced.split_whitespace().peekable();
    any(allowed, &mut words) == Some(true) && words.next().is_none()
}

type Words<'a> = std::iter::Peekable<std::str::SplitWhitespace<'a>>;

/// Evaluates alternatives. `None` for an invalid expression.
fn any(allowed: &Allowed, words: &mut Words<'_>) -> Option<bool> {
    let mut met = all(allowed, words)?;
    while words.next_if_eq(&"OR").is_some() {
        met |= all(allowed, words)?;
    }
    Some(met)
}

fn all(allowed: &Allowed, words: &mut Words<'_>) -> Option<bool> {
    let mut met = one(allowed, words)?;
    while words.next_if_eq(&"AND").is_some() {
        met &= one(allowed, words)?;
    }
    Some(met)
}

fn one(allowed: &Allowed, words: &mut Words<'_>) -> Option<bool> {
    let mut licence = match words.next()? {
        "(" => {
            let met = any(allowed, words)?;
            return words.next_if_eq(&")").map(|_| met);
        }
        licence => licence.to_owned(),
    };
    if words.next_if_eq(&"WITH").is_some() {
        licence = format!("{licence} WITH {}", words.next()?);
    }
    Some(allowed.contains(&licence))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn extras_of_other_versions_are_found() {
        let package = "[project.optional-dependencies]\n\
            a = [\"distributed==1.0; python_version >= '3.10'\"]\nb = [\"tomli\"]\n";
        let found = |pinned: &str| other_pins(package, "x.in", pinned).len();
        assert_eq!(
            found("# a comment\ndistributed==1.0\nnumpy==2.0\ntomli==3; python_version < '3.11'\n"),
            0
        );
        assert_eq!(found("distributed==1.1\n"), 1);
    }
    use serde_json::json;

    fn ours() -> Allowed {
        names(include_str!("../../deny.toml"), LICENCES).unwrap()
    }

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
            assert!(is_allowed(&ours(), good), "{good}");
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
            assert!(!is_allowed(&ours(), bad), "{bad}");
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
        let problems = check_licences(&ours(), &metadata);
        assert_eq!(problems.len(), 2);
        assert!(problems[0].starts_with("copyleft 1.0.0: its licence \"MPL-2.0\""));
        assert_eq!(problems[1], "silent 1.0.0: names no licence");
    }

    #[test]
    fn build_scripts_that_are_not_listed_are_named() {
        let allowed = names(
            "[bans.build]\nallow-build-scripts = [\"known\", \"gone\"]",
            BUILD_SCRIPTS,
        );
        let package = |name: &str, source: Value, kind: &str| {
            let targets = json!([{ "kind": ["lib"] }, { "kind": [kind] }]);
            json!({ "name": name, "source": source, "targets": targets })
        };
        let metadata = json!({ "packages": [
            package("own", Value::Null, "custom-build"),
            package("known", json!("registry"), "custom-build"),
            package("new", json!("registry"), "custom-build"),
            package("plain", json!("registry"), "bin"),
        ] });
        let problems = check_build_scripts(&allowed.unwrap(), &metadata);
        assert_eq!(problems.len(), 2, "{problems:?}");
        assert!(
            problems[0].starts_with("new has a build script"),
            "{}",
            problems[0]
        );
        assert!(problems[1].contains("contains gone"), "{}", problems[1]);
    }

    #[test]
    fn rules_without_a_list_of_names_are_an_error() {
        let one = names("[licenses]\nallow = [\"MIT\"]", LICENCES).unwrap();
        assert!(is_allowed(&one, "MIT") && !is_allowed(&one, "Zlib"));
        for bad in [
            "",
            "[licenses]",
            "[licenses]\nallow = \"MIT\"",
            "[licenses]\nallow = [1]",
            "[",
        ] {
            assert!(names(bad, LICENCES).is_err(), "{bad}");
        }
    }

    #[test]
    fn a_table_that_is_not_sorted_is_reported() {
        let manifest =
            "[workspace.dependencies]\nours = 1\n\n# Why.\nb = 1\nc = 1\na = 1\n\n[x]\nb = 1\na = 1\n";
        assert_eq!(
            check_order(manifest),
            ["Cargo.toml: the dependency `a` belongs before `c`"]
        );
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
