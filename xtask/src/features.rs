//! `features`: every plugin feature compiles alone, without a warning.

use crate::{peers, verdict};
use std::process::Command;
use whitstone::core::Registry;
use whitstone::{Exit, Failure};

/// Checks each.
pub(crate) fn run(registry: &Registry) -> Result<Exit, Failure> {
    let cargo = std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into());
    let mut problems = Vec::new();
    let mut count = 0;
    let plugins = registry
        .entries()
        .filter(|entry| entry.crate_name != peers::CRATE);
    let plugins = plugins.map(|entry| (entry.crate_name, entry.name.to_owned()));
    // Which peers this program has does not matter: all are checked.
    let peers = peers::names().into_iter().map(|name| (peers::CRATE, name));
    for (package, feature) in plugins.chain(peers) {
        let output = Command::new(&cargo)
            .args([
                "check",
                "--quiet",
                "--package",
                package,
                "--no-default-features",
                "--features",
                &feature,
            ])
            .env("RUSTFLAGS", "-D warnings")
            // Other flags would rebuild everything: these checks have a folder of their own.
            .env("CARGO_TARGET_DIR", "target/features")
            .output()
            .map_err(Failure::environment)?;
        count += 1;
        if !output.status.success() {
            let text = String::from_utf8_lossy(&output.stderr).into_owned();
            problems.push(format!("{package} with feature `{feature}` alone:\n{text}"));
        }
    }
    verdict(&problems, &format!("features: {count} compile alone"))
}
