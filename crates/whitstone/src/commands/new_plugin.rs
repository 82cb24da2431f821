//! `new-plugin`: generates a package with a working plugin.

use super::list::family;
use crate::terminal::{Exit, Failure, make_folder};
use clap::Args;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::LazyLock;
use whitstone_core::{FamilyName, Registry};
use whitstone_image::atomic;

/// Generate a Cargo package with a working plugin, as a starting point for your own
///
/// The template is a superquadric for a shape, chalk for a material, ripples for a texture, a moon
/// for a light, and a fisheye for a camera. The package contains the plugin, its property tests,
/// which pass, an example scene, and a command line with this plugin and all of Whitstone's. It
/// depends on the crates of a checkout by path, or without a checkout on those of crates.io.
#[derive(Args, Debug)]
#[command(
    help_template = super::HELP_TEMPLATE,
    after_help = "Example:\n  whitstone new-plugin shape blob --into ../blob"
)]
pub struct Arguments {
    /// Family of the plugin: shape, material, texture, light or camera
    family: String,
    /// Type of the plugin, as scenes name it: lower-case letters, digits and _
    name: String,
    /// Folder to create [default: the name, in the working folder]
    #[arg(long, value_name = "FOLDER")]
    into: Option<PathBuf>,
    /// Root of the Whitstone checkout [default: the one that contains the working folder, if any]
    #[arg(long, value_name = "FOLDER")]
    whitstone: Option<PathBuf>,
}

/// The package that CI builds and tests, `examples/plugin-superquadric`: path and text of its
/// files. Written by `cargo xtask readme`, because a published package cannot contain another one.
static PACKAGE: LazyLock<BTreeMap<String, String>> = LazyLock::new(|| {
    serde_json::from_str(include_str!("scaffold/package.json")).expect("a map from paths to texts")
});

/// The files around the plugin.
const AROUND: [&str; 4] = ["Cargo.toml", "README.md", "src/lib.rs", "src/main.rs"];

/// A file of the package.
fn of_package(path: &str) -> &'static str {
    PACKAGE
        .get(path)
        .expect("the files of the package are listed here")
}

/// A plugin that serves as a template.
struct Scaffold {
    family: FamilyName,
    /// The name that is replaced. It must have no other meaning in the files.
    name: &'static str,
    plugin: &'static str,
    scene: &'static str,
    /// The twin for Mitsuba's driver.
    twin: Option<&'static str>,
}

/// The places where the files of the package refer to the plugin's twin.
const OF_TWIN: [&str; 4] = [
    "    registry.add_twin(\"mitsuba\", \"superquadric.py\", include_str!(\"superquadric.py\"));\n",
    ", and what Mitsuba's driver needs to render them",
    "cargo run --release -- validate scenes/superquadric.toml   # against a live Mitsuba\n",
    "- `src/superquadric.py`: its twin for Mitsuba's driver, which computes the same shape by another\n  method. `../../references/mitsuba/whitstone_mitsuba/twins.py` documents what such a file may\n  contain.\n",
];

/// All templates. The tests of the repository compile and test each of them.
fn scaffolds() -> [Scaffold; 5] {
    [
        Scaffold {
            family: FamilyName::Shape,
            name: "superquadric",
            plugin: of_package("src/superquadric.rs"),
            scene: of_package("scenes/superquadric.toml"),
            twin: Some(of_package("src/superquadric.py")),
        },
        Scaffold {
            family: FamilyName::Material,
            name: "chalk",
            plugin: include_str!("scaffold/chalk.rs"),
            scene: include_str!("scaffold/chalk.toml"),
            twin: None,
        },
        Scaffold {
            family: FamilyName::Texture,
            name: "ripples",
            plugin: include_str!("scaffold/ripples.rs"),
            scene: include_str!("scaffold/ripples.toml"),
            twin: None,
        },
        Scaffold {
            family: FamilyName::Light,
            name: "moon",
            plugin: include_str!("scaffold/moon.rs"),
            scene: include_str!("scaffold/moon.toml"),
            twin: None,
        },
        Scaffold {
            family: FamilyName::Camera,
            name: "fisheye",
            plugin: include_str!("scaffold/fisheye.rs"),
            scene: include_str!("scaffold/fisheye.toml"),
            twin: None,
        },
    ]
}

impl Scaffold {
    /// The files of a package with this plugin under another name: path and text.
    fn files(&self, name: &str) -> Vec<(String, String)> {
        let package = AROUND.into_iter().map(|path| {
            // The package's texts name the family ("One shape more").
            let (singular, plural) = (self.family.singular(), self.family.plural());
            let mut text = of_package(path).to_owned();
            if self.twin.is_none() {
                OF_TWIN.iter().for_each(|part| text = text.replace(part, ""));
            }
            let text = text
                .replace("Shapes", &camel(plural))
                .replace("shapes", plural)
                .replace("shape", singular);
            (path.to_owned(), renamed(&text, "superquadric", name))
        });
        let own = [("src", "rs", self.plugin), ("scenes", "toml", self.scene)];
        let twin = self.twin.map(|text| ("src", "py", text));
        let own = own.into_iter().chain(twin).map(|(folder, extension, text)| {
            (
                format!("{folder}/{name}.{extension}"),
                renamed(text, self.name, name),
            )
        });
        package.chain(own).collect()
    }
}

/// Runs the command.
pub fn run(arguments: &Arguments, registry: &Registry) -> Result<Exit, Failure> {
    let family = family(&arguments.family)?;
    let Some(scaffold) = scaffolds().into_iter().find(|scaffold| scaffold.family == family) else {
        return Err(Failure::usage(format!(
            "there is no template for the family {}; expected shape, material, texture, light or camera. \
             Copy a plugin of crates/{} instead",
            family.singular(),
            family.plural()
        )));
    };
    let name = &arguments.name;
    check(family, name, registry)?;
    let into = arguments.into.clone().unwrap_or_else(|| name.into());
    if into.exists() {
        return Err(Failure::usage(format!(
            "{} already exists; choose another folder with --into",
            into.display()
        )));
    }
    let crates = match arguments.whitstone.clone().or_else(around) {
        None => None,
        Some(folder) => Some(
            folder
                .join("crates")
                .canonicalize()
                .ok()
                .filter(|folder| folder.join("core/Cargo.toml").is_file())
                .ok_or_else(|| {
                    Failure::usage(format!(
                        "{} is not the root of a Whitstone checkout: it has no crates/core/Cargo.toml",
                        folder.display()
                    ))
                })?,
        ),
    };
    for (file, text) in scaffold.files(name) {
        let path = into.join(file);
        let text = located(&text, crates.as_deref());
        make_folder(path.parent().unwrap_or(Path::new(".")))?;
        atomic::write_bytes(&path, text.as_bytes()).map_err(Failure::environment)?;
    }
    println!("created {}", into.display());
    println!(
        "next: cd {}; cargo test; cargo run --release -- render scenes/{name}.toml --png",
        into.display()
    );
    Ok(Exit::Pass)
}

/// Replaces the paths of the example in the repository: by those of a checkout, or by the versions
/// of the published packages.
fn located(text: &str, crates: Option<&Path>) -> String {
    let Some(crates) = crates else {
        let version = concat!("version = \"", env!("CARGO_PKG_VERSION"), "\"");
        let packages = ["whitstone", "core", "testkit"];
        let text = packages.into_iter().fold(text.to_owned(), |text, package| {
            text.replace(&format!("path = \"../../crates/{package}\""), version)
        });
        return text.replace("../../references", "references");
    };
    let references = crates.with_file_name("references");
    text.replace("../../crates", &crates.display().to_string())
        .replace("../../references", &references.display().to_string())
}

/// Checks that a type can name a module and a package, and is not in use.
fn check(family: FamilyName, name: &str, registry: &Registry) -> Result<(), Failure> {
    let letters = name.chars().all(|c| matches!(c, 'a'..='z' | '0'..='9' | '_'));
    if !letters
        || !name.starts_with(|c: char| c.is_ascii_lowercase())
        || name.len() > 40
        || KEYWORDS.contains(&name)
    {
        return Err(Failure::usage(format!(
            "\"{name}\" cannot be a type name; expected at most 40 lower-case letters, digits and _, a letter first, and no Rust keyword"
        )));
    }
    match registry.get(family, name) {
        Ok(entry) => Err(Failure::usage(format!(
            "the {} type \"{name}\" already exists in {}; choose another name",
            family.singular(),
            entry.crate_name
        ))),
        Err(_) => Ok(()),
    }
}

/// Rust's keywords, also the reserved ones: names that cannot be a module.
const KEYWORDS: [&str; 51] = [
    "abstract", "as", "async", "await", "become", "box", "break", "const", "continue", "crate", "do", "dyn",
    "else", "enum", "extern", "false", "final", "fn", "for", "gen", "if", "impl", "in", "let", "loop",
    "macro", "match", "mod", "move", "mut", "override", "priv", "pub", "ref", "return", "self", "static",
    "struct", "super", "trait", "true", "try", "type", "typeof", "unsafe", "unsized", "use", "virtual",
    "where", "while", "yield",
];

/// Replaces every spelling of the old name by that of the new one.
fn renamed(text: &str, old: &str, name: &str) -> String {
    text.replace(&camel(old), &camel(name)).replace(old, name)
}

/// "half_blob" in the spelling of a Rust type.
fn camel(name: &str) -> String {
    let words = name.split('_').map(|word| {
        let mut letters = word.chars();
        letters.next().map_or(String::new(), |first| {
            first.to_ascii_uppercase().to_string() + letters.as_str()
        })
    });
    words.collect()
}

/// The repository that contains the working folder.
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
            ("Blob", "lower-case letters"),
            ("2d", "lower-case letters"),
            ("match", "Rust"),
        ] {
            let Err(Failure::Usage(message)) = check(FamilyName::Shape, name, &registry) else {
                panic!("{name} is rejected");
            };
            assert!(message.contains(expected), "{message}");
        }
        assert!(check(FamilyName::Shape, "half_blob", &registry).is_ok());
        // Another family may use the same name.
        assert!(check(FamilyName::Light, "sphere", &registry).is_ok());
    }

    #[test]
    fn nothing_keeps_the_old_name_or_the_old_family() {
        for scaffold in scaffolds() {
            let files = scaffold.files("half_blob");
            assert_eq!(files.len(), 6 + usize::from(scaffold.twin.is_some()));
            let of_twin = files.iter().filter(|(_, text)| text.contains("twin")).count();
            assert_eq!(of_twin > 0, scaffold.twin.is_some(), "{:?}", files[1]);
            for (file, text) in &files {
                let text = text.to_lowercase();
                assert!(
                    !text.contains(scaffold.name) && !text.contains("superquadric"),
                    "{file}: {text}"
                );
                let other = scaffold.family != FamilyName::Shape && !file.starts_with("scenes");
                assert!(
                    !(other && text.contains("shape")),
                    "{file} of a {}",
                    scaffold.family.singular()
                );
            }
            let registers = format!(
                "registry.add::<{}, half_blob::HalfBlob>",
                camel(scaffold.family.plural())
            );
            assert!(
                files.iter().any(|(_, text)| text.contains(&registers)),
                "{registers}"
            );
        }
        assert_eq!(
            renamed("Superquadric::new", "superquadric", "half_blob"),
            "HalfBlob::new"
        );
    }
}
