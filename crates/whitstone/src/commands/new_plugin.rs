//! `new-plugin`: a package with a plugin that works, to be changed.

use super::list::family;
use crate::terminal::{Exit, Failure};
use clap::Args;
use std::path::{Path, PathBuf};
use whitstone_core::{FamilyName, Registry};
use whitstone_image::atomic;

/// Write a package with a shape that works and obeys the laws, to be changed into one of your own
///
/// It is a superquadric under another name: the plugin, its laws, an example scene and a command line that has all of Whitstone's plugins
/// beside it. It stands on Whitstone's crates by path.
#[derive(Args, Debug)]
#[command(after_help = "Example:\n  whitstone new-plugin shape blob --into ../blob")]
pub struct Arguments {
    /// Family of the plugin: shape
    family: String,
    /// Its type, as scenes will name it: small letters, digits and _
    name: String,
    /// The folder to make [default: the name, in the working folder]
    #[arg(long, value_name = "FOLDER")]
    into: Option<PathBuf>,
    /// Where Whitstone's repository is [default: around the working folder]
    #[arg(long, value_name = "FOLDER")]
    whitstone: Option<PathBuf>,
}

/// The package that is copied: one that CI builds and tests.
const FILES: [(&str, &str); 6] = [
    (
        "Cargo.toml",
        include_str!("../../../../examples/plugin-superquadric/Cargo.toml"),
    ),
    (
        "README.md",
        include_str!("../../../../examples/plugin-superquadric/README.md"),
    ),
    (
        "src/lib.rs",
        include_str!("../../../../examples/plugin-superquadric/src/lib.rs"),
    ),
    (
        "src/main.rs",
        include_str!("../../../../examples/plugin-superquadric/src/main.rs"),
    ),
    (
        "src/superquadric.rs",
        include_str!("../../../../examples/plugin-superquadric/src/superquadric.rs"),
    ),
    (
        "scenes/superquadric.toml",
        include_str!("../../../../examples/plugin-superquadric/scenes/superquadric.toml"),
    ),
];

/// Runs the command.
pub fn run(arguments: &Arguments, registry: &Registry) -> Result<Exit, Failure> {
    let family = family(&arguments.family)?;
    if family != FamilyName::Shape {
        return Err(Failure::usage(format!(
            "there is a package to copy for shapes only; a {} is written like those of crates/{}",
            family.singular(),
            family.plural()
        )));
    }
    let name = &arguments.name;
    check(name, registry)?;
    let into = arguments.into.clone().unwrap_or_else(|| name.into());
    if into.exists() {
        return Err(Failure::usage(format!("{} is there already", into.display())));
    }
    let whitstone = match &arguments.whitstone {
        Some(folder) => folder.clone(),
        None => around().ok_or_else(|| {
            Failure::usage(
                "Whitstone's repository is not around the working folder: --whitstone says where it is",
            )
        })?,
    };
    let crates = whitstone.join("crates");
    let crates = crates
        .canonicalize()
        .ok()
        .filter(|folder| folder.join("core/Cargo.toml").is_file())
        .ok_or_else(|| Failure::usage(format!("{} is not Whitstone's repository", whitstone.display())))?;
    for (file, text) in FILES {
        let path = into.join(renamed(file, name));
        let text = renamed(text, name).replace("../../crates", &crates.display().to_string());
        let folder = path.parent().unwrap_or(Path::new("."));
        std::fs::create_dir_all(folder).map_err(Failure::environment)?;
        atomic::write_bytes(&path, text.as_bytes()).map_err(Failure::environment)?;
    }
    println!("{}: written", into.display());
    println!(
        "next: cd {}; cargo test; cargo run --release -- render scenes/{name}.toml --png",
        into.display()
    );
    Ok(Exit::Pass)
}

/// A type that can be a module, a package, and that is not there yet.
fn check(name: &str, registry: &Registry) -> Result<(), Failure> {
    let letters = name.chars().all(|c| matches!(c, 'a'..='z' | '0'..='9' | '_'));
    if !letters
        || !name.starts_with(|c: char| c.is_ascii_lowercase())
        || name.len() > 40
        || KEYWORDS.contains(&name)
    {
        return Err(Failure::usage(format!(
            "{name}: expected a name of small letters, digits and _, that begins with a letter and is no word of Rust"
        )));
    }
    match registry.get(FamilyName::Shape, name) {
        Ok(entry) => Err(Failure::usage(format!(
            "{} has the shape type \"{name}\" already",
            entry.crate_name
        ))),
        Err(_) => Ok(()),
    }
}

/// Words that can be no module; and the crates that the package uses.
const KEYWORDS: [&str; 41] = [
    "abstract", "as", "async", "await", "become", "box", "break", "const", "continue", "crate", "do", "dyn",
    "else", "enum", "extern", "false", "final", "fn", "for", "gen", "if", "impl", "in", "let", "loop",
    "macro", "match", "mod", "move", "mut", "override", "priv", "pub", "ref", "return", "self", "static",
    "struct", "super", "trait", "type",
];

/// With the new name in every spelling of the old one.
fn renamed(text: &str, name: &str) -> String {
    let camel: String = name
        .split('_')
        .map(|word| {
            let mut letters = word.chars();
            letters.next().map_or(String::new(), |first| {
                first.to_ascii_uppercase().to_string() + letters.as_str()
            })
        })
        .collect();
    text.replace("Superquadric", &camel).replace("superquadric", name)
}

/// The repository around the working folder.
fn around() -> Option<PathBuf> {
    let here = std::env::current_dir().ok()?;
    here.ancestors()
        .find(|folder| folder.join("crates/whitstone/Cargo.toml").is_file())
        .map(Path::to_owned)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_checked() {
        let registry = crate::registry();
        for (name, expected) in [
            ("sphere", "already"),
            ("Blob", "small letters"),
            ("2d", "small letters"),
            ("match", "Rust"),
        ] {
            let Err(Failure::Usage(message)) = check(name, &registry) else {
                panic!("{name} is refused");
            };
            assert!(message.contains(expected), "{message}");
        }
        assert!(check("half_blob", &registry).is_ok());
    }

    #[test]
    fn nothing_keeps_the_old_name() {
        for (file, text) in FILES {
            let text = renamed(text, "half_blob");
            assert!(!text.to_lowercase().contains("superquadric"), "{file}");
        }
        assert_eq!(renamed("Superquadric::new", "half_blob"), "HalfBlob::new");
    }
}
