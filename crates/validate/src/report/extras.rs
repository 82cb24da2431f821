//! Further data for a page besides the results: diagrams, sensitivities and changes.

use super::changes::Changes;
use crate::CaseResult;
use crate::sensitivity::Parameter;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Further data for a page besides the results.
#[derive(Debug, Default)]
pub struct Extras {
    /// Diagrams of error against run time.
    pub diagrams: Vec<Diagram>,
    /// Diagrams of the stress families.
    pub stress: Vec<Diagram>,
    /// For each scene, the smallest detectable change of each of its numbers.
    pub sensitivity: BTreeMap<String, Vec<Parameter>>,
    /// The changes since an earlier run.
    pub changes: Option<Changes>,
}

impl Extras {
    /// Only for the unchanged scene, because it was measured there.
    pub(super) fn sensitivity_of(&self, case: &CaseResult) -> &[Parameter] {
        let known = self.sensitivity.get(&case.scene);
        known
            .filter(|_| case.config == "default")
            .map_or(&[], Vec::as_slice)
    }
}

/// A diagram of a study.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Diagram {
    /// Name of the study.
    pub name: String,
    /// One line.
    pub title: String,
    /// What the study measures.
    pub about: String,
    /// Its verdict.
    pub verdict: String,
    /// The picture. It is embedded unescaped, because it is well-formed SVG that this program
    /// generated.
    pub svg: String,
}
