//! What a verdict does not say: that nothing was seen, that a body has holes, that surfaces coincide.

use whitstone_image::Image;
use whitstone_image::range::is_vacuous;
use whitstone_scene::Pipeline;

/// Most pairs of coincident surfaces that are listed.
const MOST_COINCIDENT: usize = 8;

/// Remarks about a comparison that change no verdict.
pub(crate) fn notes(ours: &Image, reference: &Image, pipeline: &Pipeline) -> Vec<String> {
    let mut notes = Vec::new();
    if is_vacuous(ours, reference).unwrap_or(false) {
        notes.push("each image shows one colour: nothing but this colour was compared".to_owned());
    }
    for (shape, defects) in pipeline.world.open_refracting_meshes() {
        notes.push(format!(
            "shape {shape} refracts and is not a closed mesh: it has {defects}"
        ));
    }
    let pairs = &pipeline.coincident;
    notes.extend(
        pairs
            .iter()
            .take(MOST_COINCIDENT)
            .map(|pair| format!("coincident surfaces: {pair}")),
    );
    if pairs.len() > MOST_COINCIDENT {
        notes.push(format!(
            "coincident surfaces: {} more pairs, which `explain` lists",
            pairs.len() - MOST_COINCIDENT
        ));
    }
    notes.extend(pipeline.coincident_unknown.iter().cloned());
    notes
}
