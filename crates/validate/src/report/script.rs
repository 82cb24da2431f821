//! The data for the scripts of the page.

use crate::CaseResult;
use crate::pixels::{CODES_A_DECADE, ERROR_VIEW, LEAST_RESIDUAL};
use std::collections::{BTreeMap, BTreeSet};
use whitstone_metrics::ColorMap;

/// The other error pictures that the page itself draws, with scales that are the same in all
/// reports: smallest and largest value in units of radiance, and smallest and largest magnitude of
/// the signed relative error.
const ABSOLUTE: [f64; 2] = [1e-7, 1e-1];
const SIGNED: [f64; 2] = [1e-7, 1e-1];

/// The tables and numbers that scripts need to draw error pictures in the colours of the report, as
/// JSON.
pub fn drawing() -> String {
    let table = |map: ColorMap| map.table().concat();
    serde_json::json!({
        "turbo": table(ColorMap::Turbo),
        "diverging": table(ColorMap::Diverging),
        "magma": table(ColorMap::Magma),
        "relative": ERROR_VIEW.scale.ends(),
        "absolute": ABSOLUTE,
        "signed": SIGNED,
        "least": LEAST_RESIDUAL,
        "codes": CODES_A_DECADE,
    })
    .to_string()
}

/// All plugins that the cases use, by family.
pub(super) fn plugins(cases: &[CaseResult]) -> BTreeMap<&str, BTreeSet<&str>> {
    let mut families: BTreeMap<&str, BTreeSet<&str>> = BTreeMap::new();
    for plugin in cases.iter().flat_map(|case| &case.plugins) {
        let (family, name) = plugin.split_once('/').unwrap_or(("", plugin));
        families.entry(family).or_default().insert(name);
    }
    families
}
