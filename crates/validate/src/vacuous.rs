//! What a pass does not say: nothing was seen, or a body has holes.

use whitstone_core::World;
use whitstone_image::Image;
use whitstone_image::range::is_vacuous;

/// Sentences about a comparison that shows nothing, and about meshes that refract and are not closed. They change no verdict.
pub(crate) fn notes(ours: &Image, reference: &Image, world: &World) -> Vec<String> {
    let mut notes = Vec::new();
    if is_vacuous(ours, reference).unwrap_or(false) {
        notes.push("each image shows one colour: nothing but this colour was compared".to_owned());
    }
    for (shape, defects) in world.open_refracting_meshes() {
        notes.push(format!(
            "shape {shape} refracts and is not a closed mesh: it has {defects}"
        ));
    }
    notes
}
