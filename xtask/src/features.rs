//! `features`: every plugin feature compiles alone, without a warning.

use crate::{backends, verdict};
use std::collections::BTreeMap;
use std::process::Command;
use whitstone::core::Registry;
use whitstone::{Exit, Failure};

/// Checks each feature: the first of all packages at once, then the second, and so on. These
/// packages do not depend on each other, so that each is compiled with one feature alone.
pub(crate) fn run(registry: &Registry) -> Result<Exit, Failure> {
    let mut features: BTreeMap<&str, Vec<&str>> = BTreeMap::new();
    for plugin in registry.entries() {
        if plugin.crate_name != backends::CRATE {
            features.entry(plugin.crate_name).or_default().push(plugin.name);
        }
    }
    // All backends are checked, regardless of those in this program.
    let backends = backends::names();
    let count = features.values().map(Vec::len).sum::<usize>() + backends.len();
    let most = features.values().map(Vec::len).max().unwrap_or(0);
    let mut rounds: Vec<Vec<String>> = (0..most)
        .map(|round| {
            let of_package = |(package, names): (&&str, &Vec<&str>)| {
                names.get(round).map(|name| format!("{package}/{name}"))
            };
            features.iter().filter_map(of_package).collect()
        })
        .collect();
    rounds.extend(
        backends
            .iter()
            .map(|name| vec![format!("{}/{name}", backends::CRATE)]),
    );
    let mut problems = Vec::new();
    for round in rounds {
        problems.extend(problem(&round).map_err(Failure::environment)?);
    }
    verdict(&problems, &format!("features: each of {count} compiles alone"))
}

/// The compiler's messages for some features, `PACKAGE/FEATURE`, each of another package.
fn problem(features: &[String]) -> std::io::Result<Option<String>> {
    let cargo = std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into());
    let packages = features.iter().filter_map(|feature| feature.split('/').next());
    let output = Command::new(cargo)
        .args(["check", "--quiet", "--no-default-features", "--keep-going"])
        .args(packages.flat_map(|package| ["--package", package]))
        .args(["--features", &features.join(",")])
        .env("RUSTFLAGS", "-D warnings")
        .env("CARGO_INCREMENTAL", "0")
        // Other flags would rebuild everything.
        .env("CARGO_TARGET_DIR", "target/features")
        .output()?;
    let text = String::from_utf8_lossy(&output.stderr);
    let problem = || format!("each of these features alone: {}\n{text}", features.join(", "));
    Ok((!output.status.success()).then(problem))
}
