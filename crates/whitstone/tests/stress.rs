//! The stress families without Mitsuba: Whitstone keeps every promised error bound, and the naive
//! variants fail.

use whitstone_stress::search::{FOUND, repeat};
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

/// The worst cases of earlier searches.
#[test]
fn cases_that_a_search_found_keep_the_promise() {
    let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    std::env::set_current_dir(folder).expect("the repository is there");
    let registry = whitstone::registry();
    let lab = Lab::new(&registry, None, 20);
    for case in FOUND {
        let family = FAMILIES.iter().find(|family| family.about().name == case.family);
        let family = family.unwrap_or_else(|| panic!("no family {}", case.family));
        let judged = repeat(*family, case, &lab).unwrap_or_else(|problem| panic!("{problem}"));
        assert!(judged.wrong == 0 && judged.share <= 1.0, "{case:?}: {judged:?}");
    }
}
