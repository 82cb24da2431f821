//! Finds lights that reach no surface with local illumination.

use crate::box_tree::BoxTree;
use std::cell::OnceCell;
use std::sync::Arc;
use whitstone_core::{Aabb, BsdfFlags, Element, Geometry, Light, LightFlags, LoweredShape, Material};
use whitstone_scene::{Omitted, PluginTable};

/// Drops the lights that cannot reach any reflecting surface. `lights` are paired with their
/// tables. The image is unchanged, because these lights would contribute nothing.
pub(crate) fn omit_lights(
    tables: &[PluginTable<'_>],
    lights: &mut Vec<Arc<dyn Light>>,
    geometry: &Geometry,
    materials: &[Arc<dyn Material>],
) -> Vec<Omitted> {
    let receivers: Vec<Aabb> = geometry
        .shapes()
        .iter()
        .zip(materials)
        .zip(0..)
        // The materials of an instance are those of its group.
        .filter(|((shape, material), _)| {
            matches!(shape, LoweredShape::Instance(_)) || material.flags().intersects(BsdfFlags::LOCAL)
        })
        .map(|(_, shape)| geometry.bounds(Element::Custom { shape }))
        .collect();
    // Most lights affect one of the first receivers.
    let (first, _) = receivers.split_at(receivers.len().min(16));
    let tree = OnceCell::new();
    let affects = |light: &dyn Light| {
        first.iter().any(|bounds| light.affects_bounds(bounds))
            || tree
                .get_or_init(|| BoxTree::new(&receivers))
                .any(|bounds| light.affects_bounds(bounds))
    };
    let mut omitted = Vec::new();
    let mut number = 0;
    lights.retain(|light| {
        number += 1;
        // A light that is also visible, or that illuminates from all directions, is kept.
        let kept = light.flags() != LightFlags::SAMPLES || affects(&**light);
        if !kept {
            let why = if receivers.is_empty() {
                "no material in use has local illumination"
            } else {
                "it reaches no surface that reflects light"
            };
            omitted.push(Omitted {
                what: format!("light {number} ({})", tables[number - 1].name),
                why: why.to_owned(),
            });
        }
        kept
    });
    omitted
}
