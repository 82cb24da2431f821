//! Generates `docs/reliability.md` from the stored counts.

use super::{PROMISES, stored};
use crate::fuzz;
use crate::run_time::wrapped;
use serde_json::Value;
use std::fmt::Write as _;

/// The page.
pub(crate) const PAGE: &str = "docs/reliability.md";
/// The stored counts.
pub(crate) const RESULT: &str = "studies/results/reliability.json";

/// The whole page.
pub(crate) fn page(result: &Value, fuzzed: &Value) -> String {
    let mut page = format!(
        "# Reliability\n\n{}\n\n| promise | attempts | broken |\n|---|---|---|\n",
        wrapped(&format!(
            "This page lists what the program guarantees under faults, and how each guarantee is tested. `cargo xtask reliability` tests each of them and counts the attempts; CI runs `cargo xtask reliability --quick`. The counts are those of `{RESULT}`."
        ))
    );
    for promise in &PROMISES {
        let [tried, failed] = match stored(result, promise) {
            None => ["not yet counted"; 2].map(str::to_owned),
            Some(result) if result["skipped"].is_string() => ["skipped"; 2].map(str::to_owned),
            Some(result) => {
                let quick = if result["quick"] == true {
                    " (quick run)"
                } else {
                    ""
                };
                [
                    format!("{}{quick}", result["tried"]),
                    result["failed"].to_string(),
                ]
            }
        };
        let _ = writeln!(page, "| {} | {tried} | {failed} |", promise.name);
    }
    for promise in &PROMISES {
        let _ = write!(
            page,
            "\n## {}\n\n{}\n",
            promise.name.trim_end_matches('.'),
            wrapped(promise.how)
        );
    }
    page += "\n";
    page += FUZZING;
    let _ = write!(
        page,
        "\n{}\n\n{}\n",
        wrapped(&format!(
            "Executions so far (`{}`, to which `cargo xtask fuzz --json` adds):",
            fuzz::RESULT
        )),
        fuzz::table(fuzzed)
    );
    page += MUTATION;
    page += BY_TESTS;
    page
}

const FUZZING: &str = "## Fuzzing

`cargo xtask fuzz` feeds damaged files to everything that reads files: scenes of every format,
meshes, materials and images. It is guided by coverage (libFuzzer, with the counters of the stable
compiler): a damaged file that reaches new code is damaged further. Scenes that are valid are also
rendered. A panic, an answer that takes more than 10 s, more than 2 GiB of memory, or an error
without a text or place is a finding. The time is given by `--seconds`: `cargo xtask fuzz gltf ply
--seconds 3600`.

`cargo xtask fuzz scenes` makes random scenes from the JSON Schema, three in four of them valid,
with all plugins, and with numbers from ordinary to extreme. A valid scene is rendered with every
accelerator, with three threads, and with each set of vector instructions; all images must be the
same, bit for bit. Each image, and each refusal, counts as an execution. Images have 16 x 12 pixels,
those of slow shapes (fractals, implicit surfaces) fewer; without an accelerator, scenes of up to a
million pairs of a ray and an element are rendered, and a scene whose image takes more than half a
second is rendered once with each set of instructions. `cargo xtask fuzz mitsuba` validates such
scenes against Mitsuba. CI runs `cargo xtask fuzz scenes mitsuba --seconds 20`. What a run finds is
repaired and becomes a test. Runs of kinds without a row in the table below were not recorded.
";

const MUTATION: &str = "## Mutation tests

[cargo-mutants](https://mutants.rs) changes one operator or one result at a time in the code of
cameras, lights, materials and textures, and runs the unit tests of that crate: a change that no
test detects gets a test. `.cargo/mutants.toml` lists the changes that no test can detect, with the
reasons, and CONTRIBUTING.md has the command.

";

const BY_TESTS: &str = "## Promises that tests keep

| promise | test |
|---|---|
| Ctrl-C ends a command, keeps what is finished, and ends the driver. | [interrupts](../tests/tests/interrupts.rs) |
| A second Ctrl-C ends at once. | [interrupts](../tests/tests/interrupts.rs) |
| Files without end, pipes and files of the system are refused. | [hostile_files](../tests/tests/hostile_files.rs) |
| With `--root DIR`, no file outside of DIR is read. | [hostile_files](../tests/tests/hostile_files.rs) |
| A ray tree of more than `--max-tree-rays` rays is an error. | [hostile_files](../tests/tests/hostile_files.rs) |
| Where the system allows no threads, one thread renders, and `view` ends with an error. | [hostile_files](../tests/tests/hostile_files.rs) |
| Names cannot send control characters to the terminal. | [hostile_files](../tests/tests/hostile_files.rs) |
| A scene file cut at any byte is read, or gives an error with a place. | [fuzz](../tests/tests/fuzz.rs) |
| Damaged images in the cache of live references are made again. | [live](../crates/validate/src/live.rs) |
| Links in the cache of live references are not followed. | [fake_mitsuba](../tests/tests/fake_mitsuba.rs) |
| A driver that hangs, floods its output or ends early is reported. | [validation](../tests/tests/validation.rs) |
| The image does not depend on accelerator, threads or SIMD instructions. | [determinism](../tests/tests/determinism.rs) |
";
