//! Checks that the compiler cannot make: the same name in all places of a plugin, and lists that
//! are complete.

use crate::parameters::{undeclared_defaults, undocumented_parameters};
use crate::{assets, backends, dependencies, links, places, topics, verdict, width};
use std::fs;
use std::path::{Path, PathBuf};
use whitstone::core::{Entry, FamilyName, Registry};
use whitstone::validate::Renderer;
use whitstone::validate::stored::Stored;
use whitstone::{Exit, Failure};

/// The exact definition of each plugin.
const MODEL: &str = "docs/whitted-model.md";
/// Has a folder for each family, and a file for each plugin with a twin in POV-Ray.
const POVRAY_TWINS: &str = "references/povray/whitstone_povray";
/// A source file with more lines is reported, because it could be split.
const MANY_LINES: usize = 700;

/// Runs all checks.
pub(crate) fn run(registry: &Registry) -> Result<Exit, Failure> {
    let mut problems = Vec::new();
    let (backends, plugins): (Vec<_>, Vec<_>) = registry
        .entries()
        .partition(|entry| entry.crate_name == backends::CRATE);
    for entry in &plugins {
        let found = check_plugin(entry);
        if !found.is_empty() {
            problems.push(unfinished(entry));
        }
        problems.extend(found);
    }
    problems.extend(backends::check(&backends));
    problems.extend(check_strays(registry));
    problems.extend(check_orphans(registry));
    problems.extend(assets::check());
    problems.extend(check_stored());
    problems.extend(check_sources());
    problems.extend(width::check());
    problems.extend(check_studies());
    problems.extend(topics::check(registry));
    problems.extend(links::check());
    problems.extend(dependencies::check());
    verdict(
        &problems,
        &format!(
            "tidy: {} plugins, each with file, feature, example, twin and documentation; {} backends",
            plugins.len(),
            backends::names().len()
        ),
    )
}

fn read(path: &Path) -> String {
    fs::read_to_string(path).unwrap_or_default()
}

/// How to complete a plugin that lacks something.
fn unfinished(entry: &Entry) -> String {
    let all = places::places(entry.family, entry.name);
    let list = all.iter().zip(1..).map(|(place, number)| {
        let mark = if place.there { "" } else { " (missing)" };
        format!("\n  {number} {}{mark}: {}", place.path.display(), place.what)
    });
    let list: String = list.collect();
    format!(
        "{} {}: incomplete; its places are:{list}",
        entry.family.singular(),
        entry.name
    )
}

/// Checks file, feature, example, twin, documentation and laws.
fn check_plugin(entry: &Entry) -> Vec<String> {
    let (family, name) = (entry.family.plural(), entry.name);
    let krate = PathBuf::from("crates").join(family);
    let file = krate.join("src").join(format!("{name}.rs"));
    let example = PathBuf::from("scenes").join(family).join(format!("{name}.toml"));
    let source = read(&file);
    let mut problems = Vec::new();
    let mut require = |good: bool, problem: String| {
        if !good {
            problems.push(problem);
        }
    };
    require(
        !source.is_empty(),
        format!(
            "{}: missing or empty; the plugin {name} needs this file",
            file.display()
        ),
    );
    require(
        source.starts_with("//! "),
        format!("{}: no module documentation", file.display()),
    );
    for heading in ["Twin:", "Example:"] {
        require(
            source.contains(heading),
            format!("{}: the documentation has no line \"{heading}\"", file.display()),
        );
    }
    require(
        source.contains(&format!("scenes/{family}/{name}.toml")),
        format!(
            "{}: the documentation does not name {}",
            file.display(),
            example.display()
        ),
    );
    for key in undeclared_defaults(entry) {
        require(
            false,
            format!(
                "{}: the optional key `{key}` declares no default; add a constant default, or describe it with \
                 #[schemars(extend(\"x-default\" = \"...\"))]",
                file.display()
            ),
        );
    }
    let laws = format!("{}_laws", entry.family.singular());
    require(
        source.contains(&laws),
        format!("{}: no test calls `{laws}`", file.display()),
    );
    let manifest = read(&krate.join("Cargo.toml"));
    require(
        manifest
            .lines()
            .any(|line| line.starts_with(&format!("{name} = ["))),
        format!("{}/Cargo.toml: no feature `{name}`", krate.display()),
    );
    let text = read(&example);
    require(
        !text.is_empty(),
        format!(
            "{}: missing or empty; the plugin {name} needs this example scene",
            example.display()
        ),
    );
    require(
        text.contains(&format!("\"{name}\"")),
        format!("{}: does not use type = \"{name}\"", example.display()),
    );
    require(
        !entry.summary().is_empty(),
        format!("{}: `Config` has no documentation", file.display()),
    );
    problems.extend(
        undocumented_parameters(entry).map(|key| format!("{}: `{key}` has no documentation", file.display())),
    );
    // The driver's reader is the twin; accelerators do not affect the image.
    if entry.family != FamilyName::Accelerator {
        if !is_modelled(&read(Path::new(MODEL)), name) {
            problems.push(format!(
                "{MODEL}: does not define the {} **{name}**",
                entry.family.singular()
            ));
        }
        let known = driver_sources().contains(&format!("\"{name}\"")) || povray_twin(family, name).is_file();
        if !known {
            problems.push(format!(
                "references/mitsuba, references/povray: no twin of the {} type \"{name}\"",
                entry.family.singular()
            ));
        }
    }
    problems
}

/// Whether the model defines a plugin: its name is in bold type, alone or in a list of names.
fn is_modelled(model: &str, name: &str) -> bool {
    model.contains(&format!("**{name}**"))
}

/// Plugin files that are not registered. They have a line "Twin:", which helper files do not.
fn check_orphans(registry: &Registry) -> Vec<String> {
    let mut problems = Vec::new();
    for family in FamilyName::ALL {
        for file in files(&Path::new("crates").join(family.plural()).join("src"), "rs") {
            let stem = file.file_stem().unwrap_or_default().to_string_lossy();
            if is_plugin(&read(&file)) && registry.get(family, &stem).is_err() {
                problems.push(format!(
                    "{}: has a line \"Twin:\" like a plugin, but no {} type \"{stem}\" is registered",
                    file.display(),
                    family.singular()
                ));
            }
        }
    }
    problems
}

fn is_plugin(source: &str) -> bool {
    let documentation = source.lines().take_while(|line| line.starts_with("//!"));
    documentation.into_iter().any(|line| line.contains("Twin:"))
}

/// The twin of a plugin in POV-Ray, if it has one.
fn povray_twin(family: &str, name: &str) -> PathBuf {
    Path::new(POVRAY_TWINS)
        .join(family)
        .join(name)
        .with_extension("py")
}

fn driver_sources() -> String {
    let folder = Path::new("references/mitsuba/whitstone_mitsuba");
    files(folder, "py").iter().map(|path| read(path)).collect()
}

/// Files in a folder and its subfolders with an extension, sorted.
fn files(folder: &Path, extension: &str) -> Vec<PathBuf> {
    let mut found = Vec::new();
    for entry in fs::read_dir(folder).into_iter().flatten().flatten() {
        let path = entry.path();
        if path.is_dir() {
            found.extend(files(&path, extension));
        } else if path.extension().is_some_and(|e| e == extension) {
            found.push(path);
        }
    }
    found.sort();
    found
}

/// Example scenes, features and twins without a plugin.
fn check_strays(registry: &Registry) -> Vec<String> {
    let mut problems = Vec::new();
    for family in FamilyName::ALL {
        let known = |name: &str| registry.get(family, name).is_ok();
        for scene in files(&Path::new("scenes").join(family.plural()), "toml") {
            let stem = scene
                .file_stem()
                .unwrap_or_default()
                .to_string_lossy()
                .into_owned();
            if !known(&stem) {
                problems.push(format!(
                    "{}: there is no {} type \"{stem}\"",
                    scene.display(),
                    family.singular()
                ));
            }
        }
        for twin in files(&Path::new(POVRAY_TWINS).join(family.plural()), "py") {
            let stem = twin.file_stem().unwrap_or_default().to_string_lossy();
            if !stem.starts_with('_') && !known(&stem) {
                problems.push(format!(
                    "{}: there is no {} type of this name",
                    twin.display(),
                    family.singular()
                ));
            }
        }
        let path = Path::new("crates").join(family.plural()).join("Cargo.toml");
        let manifest = read(&path);
        let features = manifest.split("[features]").nth(1).unwrap_or_default();
        let features = features.split("\n[").next().unwrap_or_default();
        for line in features.lines() {
            let Some((name, _)) = line.split_once(" = ") else {
                continue;
            };
            if !["default", "all"].contains(&name) && !known(name) {
                problems.push(format!(
                    "{}: the feature `{name}` registers no plugin",
                    path.display()
                ));
            }
            if !["default", "all"].contains(&name) && !features.contains(&format!("\"{name}\"")) {
                problems.push(format!(
                    "{}: the feature `{name}` is not in `all`",
                    path.display()
                ));
            }
        }
    }
    problems
}

/// Stored references: at least one for every scene, none without a scene, and a limited total size.
fn check_stored() -> Vec<String> {
    let root = Path::new("references/images");
    let mut problems = Vec::new();
    let mut bytes = 0;
    for file in files(root, "exr") {
        bytes += fs::metadata(&file).map_or(0, |metadata| metadata.len());
        let key = file
            .parent()
            .and_then(|folder| folder.strip_prefix(root).ok())
            .unwrap_or(Path::new(""));
        let scene = Path::new("scenes").join(key).with_extension("toml");
        if !scene.is_file() {
            problems.push(format!(
                "{}: the scene {} of this reference does not exist",
                file.display(),
                scene.display()
            ));
        }
    }
    if bytes > 32 << 20 {
        problems.push(format!("{}: {bytes} bytes; the limit is 32 MiB", root.display()));
    }
    let scenes = whitstone::validate::find_scenes(&[PathBuf::from("scenes")]).unwrap_or_default();
    for scene in scenes {
        let key = whitstone::validate::scene_key(&scene, Path::new("scenes"));
        let folder = root.join(&key);
        if !Renderer::ALL
            .into_iter()
            .any(|renderer| Stored::is_in(&folder, renderer))
        {
            problems.push(format!(
                "{}: no stored reference; run `cargo xtask reference --accept` for this scene, with \
                 `--reference povray` if Mitsuba cannot render it",
                scene.display()
            ));
        }
    }
    problems
}

/// Studies of error against run time: each is on the page with its picture, and no picture belongs
/// to a deleted study.
fn check_studies() -> Vec<String> {
    let (page, pictures) = (
        Path::new("docs/convergence.md"),
        Path::new("docs/images/converge"),
    );
    let text = read(page);
    let stored = fs::read_dir("studies").into_iter().flatten().flatten();
    let paths = stored.map(|entry| entry.path());
    let stems = paths.filter(|path| path.extension().is_some_and(|e| e == "toml"));
    let names: Vec<String> = stems
        .filter_map(|path| Some(path.file_stem()?.to_string_lossy().into_owned()))
        .collect();
    let mut problems = Vec::new();
    for name in &names {
        let shown = text.contains(&format!("(../studies/{name}.toml)"));
        if !shown || !pictures.join(name).with_extension("svg").is_file() {
            problems.push(format!(
                "studies/{name}.toml: {} lacks it, or its picture is missing; run the command in CONTRIBUTING.md, section Measuring",
                page.display()
            ));
        }
    }
    for picture in files(pictures, "svg") {
        let stem = picture
            .file_stem()
            .unwrap_or_default()
            .to_string_lossy()
            .into_owned();
        if !names.contains(&stem) {
            problems.push(format!(
                "{}: there is no study of this name; delete the picture",
                picture.display()
            ));
        }
    }
    problems
}

/// Source files that are too long, and unfinished work.
fn check_sources() -> Vec<String> {
    let mut problems = Vec::new();
    // Split into parts, so that this file does not match itself.
    let words = [
        ["to", "do!("].concat(),
        ["unimple", "mented!("].concat(),
        ["FIX", "ME"].concat(),
    ];
    for folder in ["benches", "crates", "xtask", "tests", "references", "subjects"] {
        for file in files(Path::new(folder), "rs")
            .into_iter()
            .chain(files(Path::new(folder), "py"))
        {
            let text = read(&file);
            let lines = text.lines().count();
            if lines > MANY_LINES {
                println!(
                    "hint: {}: {lines} lines; consider splitting the file",
                    file.display()
                );
            }
            for word in words.iter().filter(|word| text.contains(word.as_str())) {
                problems.push(format!("{}: unfinished: {word}", file.display()));
            }
        }
    }
    problems
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_model_names_a_plugin_in_bold() {
        let model = "- **constant**: `value`.\n| **disk** | | z = 0 |\nthe capsule, `capsule`";
        assert!(is_modelled(model, "constant") && is_modelled(model, "disk"));
        assert!(!is_modelled(model, "capsule") && !is_modelled(model, "dis"));
    }

    #[test]
    fn a_plugin_is_known_by_its_twin() {
        assert!(is_plugin("//! A ball.\n//!\n//! - Twin: `sphere`.\n\nuse x;\n"));
        assert!(!is_plugin("//! A helper.\n\n// Twin: none\n"));
    }

    /// All plugin sources of the repository, with no plugin registered.
    #[test]
    fn unregistered_files_are_found() {
        std::env::set_current_dir(crate::root()).unwrap();
        let found = check_orphans(&Registry::default());
        let named = |name: &str| found.iter().any(|problem| problem.starts_with(name));
        assert!(
            named("crates/shapes/src/sphere.rs") && named("crates/lights/src/spot.rs"),
            "{found:?}"
        );
        assert!(!named("crates/shapes/src/frame.rs"), "{found:?}");
        assert_eq!(check_orphans(&whitstone::registry()), Vec::<String>::new());
    }
}
