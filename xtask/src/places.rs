//! The files in which a plugin of the repository is registered by hand: six at most.

use clap::Args;
use std::fs;
use std::path::{Path, PathBuf};
use whitstone::core::FamilyName;
use whitstone::{Exit, Failure};

/// Check the repository for problems that the compiler cannot find
///
/// Every plugin must have its file, feature, example, twin and documentation, every scene a stored
/// reference, every link a target, and every dependency an allowed licence. With --plugin, the
/// command instead lists the places that one plugin needs, and whether each is complete.
///
/// Exit code 0 if there is no problem, 1 if there is one.
#[derive(Args, Debug)]
#[command(
    help_template = whitstone::commands::HELP_TEMPLATE,
    after_help = "Examples:\n  cargo xtask tidy\n  cargo xtask tidy --plugin shape capsule"
)]
pub(crate) struct Arguments {
    /// List the places of one plugin, whether or not they exist yet
    #[arg(long, num_args = 2, value_names = ["FAMILY", "NAME"])]
    pub(crate) plugin: Option<Vec<String>>,
}

/// A file that contains a part of a plugin.
pub(crate) struct Place {
    /// The path. For a twin that does not exist yet, the place where it belongs.
    pub(crate) path: PathBuf,
    /// The plugin's part of the file.
    pub(crate) what: String,
    /// Whether that part exists.
    pub(crate) there: bool,
}

/// The places that CONTRIBUTING.md lists under "Adding a plugin".
pub(crate) fn places(family: FamilyName, name: &str) -> Vec<Place> {
    let plural = family.plural();
    let krate = Path::new("crates").join(plural);
    let read = |path: &Path| fs::read_to_string(path).unwrap_or_default();
    let place = |path: PathBuf, what: String, there: bool| Place { path, what, there };
    let (plugin, lib, manifest) = (
        krate.join("src").join(name).with_extension("rs"),
        krate.join("src/lib.rs"),
        krate.join("Cargo.toml"),
    );
    let scene = Path::new("scenes").join(plural).join(name).with_extension("toml");
    let model = PathBuf::from("docs/whitted-model.md");
    // Once for the module, once for the line in `register`.
    let registered = read(&lib).matches(&format!("feature = \"{name}\"")).count() >= 2;
    let feature = read(&manifest)
        .lines()
        .any(|line| line.starts_with(&format!("{name} = [")));
    let mut all = vec![
        place(
            plugin.clone(),
            "the plugin with its laws".to_owned(),
            plugin.is_file(),
        ),
        place(
            lib,
            "the module and a line in `register`, under the feature".to_owned(),
            registered,
        ),
        place(manifest, format!("the feature `{name}`, also in `all`"), feature),
        place(scene.clone(), "the example".to_owned(), scene.is_file()),
    ];
    // The image does not depend on the accelerator.
    if family != FamilyName::Accelerator {
        let modelled = read(&model).contains(&format!("**{name}**"));
        all.push(place(
            model,
            format!("the exact definition of **{name}**"),
            modelled,
        ));
        let (path, there) = twin(family, name);
        all.push(place(
            path,
            "its twin, in Mitsuba or in POV-Ray".to_owned(),
            there,
        ));
    }
    all
}

/// The path of the twin, existing or not.
fn twin(family: FamilyName, name: &str) -> (PathBuf, bool) {
    let plural = family.plural();
    let quoted = format!("\"{name}\"");
    let driver = Path::new("references/mitsuba/whitstone_mitsuba");
    let files = fs::read_dir(driver).into_iter().flatten().flatten();
    let mut sources = files
        .map(|entry| entry.path())
        .filter(|path| path.extension().is_some_and(|e| e == "py"));
    let named = |path: &PathBuf| fs::read_to_string(path).is_ok_and(|text| text.contains(&quoted));
    // The driver reads it together with the document.
    let file = if family == FamilyName::Integrator {
        "document"
    } else {
        plural
    };
    let own = driver.join(file).with_extension("py");
    let povray = Path::new("references/povray/whitstone_povray")
        .join(plural)
        .join(name)
        .with_extension("py");
    if named(&own) {
        (own, true)
    } else if povray.is_file() {
        (povray, true)
    } else if let Some(found) = sources.find(named) {
        (found, true)
    } else {
        (own, false)
    }
}

/// Lists the places of a plugin. Places without it are problems.
pub(crate) fn run(plugin: &[String]) -> Result<Exit, Failure> {
    let [family, name] = plugin else {
        return Err(Failure::usage(
            "expected a family and a name, for example `--plugin shape capsule`",
        ));
    };
    let families = FamilyName::ALL.into_iter();
    let mut families = families.filter(|known| family == known.singular() || family == known.plural());
    let Some(family) = families.next() else {
        return Err(Failure::usage(format!(
            "unknown family \"{family}\"; expected one of {}",
            FamilyName::ALL.map(FamilyName::singular).join(", ")
        )));
    };
    let all = places(family, name);
    for (number, place) in all.iter().enumerate() {
        let mark = if place.there { "present" } else { "missing" };
        println!("{} {mark} {}: {}", number + 1, place.path.display(), place.what);
    }
    println!(
        "  also needed: a line in CHANGELOG.md; the commands in CONTRIBUTING.md write pages, pictures and stored references"
    );
    let missing = all.iter().filter(|place| !place.there).count();
    println!(
        "{} {name}: missing in {missing} of {} places",
        family.singular(),
        all.len()
    );
    Ok(if missing == 0 { Exit::Pass } else { Exit::Differs })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// At most six places, all complete for a registered plugin, none for an unregistered one.
    #[test]
    fn every_plugin_takes_six_places_at_most() {
        std::env::set_current_dir(crate::root()).unwrap();
        let registry = whitstone::registry();
        for entry in registry
            .entries()
            .filter(|entry| entry.crate_name != crate::backends::CRATE)
        {
            let found = places(entry.family, entry.name);
            assert!(found.len() <= 6);
            let missing = found
                .iter()
                .filter(|place| !place.there)
                .map(|place| place.path.clone());
            let missing: Vec<PathBuf> = missing.collect();
            assert!(
                missing.is_empty(),
                "{} {}: {missing:?}",
                entry.family.singular(),
                entry.name
            );
        }
        let found = places(FamilyName::Shape, "no_such_shape");
        assert_eq!(found.len(), 6);
        assert!(found.iter().all(|place| !place.there));
    }
}
