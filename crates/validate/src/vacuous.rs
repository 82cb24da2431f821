//! Remarks that do not affect the verdict: a vacuous comparison, a refracting mesh with holes,
//! coincident surfaces.

use whitstone_image::Image;
use whitstone_metrics::range::is_vacuous;
use whitstone_render::Pipeline;

/// Maximum number of pairs of coincident surfaces that are listed.
const MAX_COINCIDENT: usize = 8;

/// Remarks about a comparison that do not affect the verdict.
pub(crate) fn notes(ours: &Image, reference: &Image, pipeline: &Pipeline) -> Vec<String> {
    let mut notes = Vec::new();
    if is_vacuous(ours, reference).unwrap_or(false) {
        notes.push("each image shows one colour only, so the comparison is vacuous".to_owned());
    }
    for (shape, defects) in pipeline.scene.open_refracting_meshes() {
        notes.push(format!(
            "shape {shape} refracts and is not a closed mesh: it has {defects}"
        ));
    }
    notes
}

/// The pairs of coincident surfaces of a scene, and the surfaces that were not examined for them.
pub(crate) fn coincident(pipeline: &Pipeline) -> Vec<String> {
    let pairs = &pipeline.coincident;
    let mut told: Vec<String> = pairs
        .iter()
        .take(MAX_COINCIDENT)
        .map(ToString::to_string)
        .collect();
    if pairs.len() > MAX_COINCIDENT {
        told.push(format!(
            "{} more pairs, which `explain` lists",
            pairs.len() - MAX_COINCIDENT
        ));
    }
    told.extend(pipeline.coincident_unknown.iter().cloned());
    told
}
