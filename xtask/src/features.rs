//! `features`: every plugin feature compiles alone, without a warning.

use crate::{backends, verdict};
use std::process::Command;
use std::sync::atomic::{AtomicUsize, Ordering};
use whitstone::core::Registry;
use whitstone::{Exit, Failure};

/// Checks each feature. Several checks run in parallel, with one thread each, because most of them
/// compile only one crate.
pub(crate) fn run(registry: &Registry) -> Result<Exit, Failure> {
    let plugins = registry
        .entries()
        .filter(|entry| entry.crate_name != backends::CRATE);
    let plugins = plugins.map(|entry| (entry.crate_name, entry.name.to_owned()));
    // All backends are checked, regardless of those in this program.
    let backends = backends::names().into_iter().map(|name| (backends::CRATE, name));
    let features: Vec<(&str, String)> = plugins.chain(backends).collect();
    let next = AtomicUsize::new(0);
    let worker = |number: usize| -> std::io::Result<Vec<String>> {
        let mut problems = Vec::new();
        while let Some((package, feature)) = features.get(next.fetch_add(1, Ordering::Relaxed)) {
            problems.extend(problem(package, feature, number)?);
        }
        Ok(problems)
    };
    let workers = std::thread::available_parallelism().map_or(1, |count| count.get().min(4));
    let results: Vec<Result<_, Failure>> = std::thread::scope(|scope| {
        let handles: Vec<_> = (0..workers)
            .map(|number| std::thread::Builder::new().spawn_scoped(scope, move || worker(number)))
            .collect();
        handles
            .into_iter()
            .map(|handle| Ok(handle.map_err(Failure::environment)?.join()))
            .collect()
    });
    let mut problems = Vec::new();
    for result in results {
        let result = result?.map_err(|_| Failure::environment("a check panicked"))?;
        problems.extend(result.map_err(Failure::environment)?);
    }
    verdict(
        &problems,
        &format!("features: each of {} compiles alone", features.len()),
    )
}

/// The compiler's messages for a single feature.
fn problem(package: &str, feature: &str, worker: usize) -> std::io::Result<Option<String>> {
    let cargo = std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into());
    let output = Command::new(cargo)
        .args(["check", "--quiet", "--package", package])
        .args(["--no-default-features", "--features", feature])
        .env("RUSTFLAGS", "-D warnings")
        .env("CARGO_INCREMENTAL", "0")
        // Other flags would rebuild everything, and cargo locks its folder, so each worker has its
        // own.
        .env("CARGO_TARGET_DIR", format!("target/features/{worker}"))
        .output()?;
    let text = String::from_utf8_lossy(&output.stderr);
    let problem = || format!("{package} with feature `{feature}` alone:\n{text}");
    Ok((!output.status.success()).then(problem))
}
