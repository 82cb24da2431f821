//! The stress families without Mitsuba: Whitstone keeps every promised error bound, and the naive
//! variants fail.

use whitstone_stress::{FAMILIES, FamilyReport, Lab, Verdict};

#[test]
fn every_promise_is_kept() {
    let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    std::env::set_current_dir(folder).expect("the repository is there");
    let registry = whitstone::registry();
    let lab = Lab::new(&registry, None, 60);
    let mut bad = Vec::new();
    for family in FAMILIES {
        let report =
            FamilyReport::measure(family, &lab, &|_| ()).unwrap_or_else(|problem| panic!("{problem}"));
        if report.verdict != Verdict::Pass {
            bad.push(format!(
                "{}: {}: {:#?}",
                report.family, report.verdict, report.engines
            ));
        }
    }
    assert!(bad.is_empty(), "{}", bad.join("\n"));
}
