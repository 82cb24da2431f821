//! Scene-wide limits: number of prioritised dielectrics, growth of glossy ray trees.

use std::sync::Arc;
use whitstone_core::{Integrator, Material, NestedDielectrics, SceneError, SceneErrors, SourceSpan};
use whitstone_scene::Plan;

/// Maximum number of rays into which one camera ray may branch by lobes.
const MAX_REFLECTIONS: f64 = (1 << 24) as f64;

/// Checks the prioritised dielectrics: their number is limited, and they must not be in groups.
/// `materials` are those of all shapes.
pub(crate) fn prioritized(plan: &Plan<'_, '_>, materials: &[Arc<dyn Material>], errors: &mut SceneErrors) {
    let alone = plan.description.shapes.len();
    let all = plan.appearances.all.iter().zip(materials).enumerate();
    let bodies =
        all.filter(|(_, (shape, material))| shape.table.group.is_none() && material.prioritized().is_some());
    for (count, (number, (shape, _))) in bodies.enumerate() {
        let place = shape.material.as_ref().map(|(span, _)| span.clone());
        let message = if number >= alone {
            "a shape in a group must not have a priority: all its instances would be one body".to_owned()
        } else if count == NestedDielectrics::MAX {
            format!(
                "expected at most {} shapes with a priority, found more",
                NestedDielectrics::MAX
            )
        } else {
            continue;
        };
        errors.0.push(SceneError {
            span: place,
            ..SceneError::anywhere(message)
        });
    }
}

/// Checks that the number of rays by lobes (glossy reflection, rough glass) stays limited.
/// `materials` are those of all shapes, if there are no errors.
pub(crate) fn glossy_rays(
    plan: &Plan<'_, '_>,
    materials: &[Arc<dyn Material>],
    integrator: &dyn Integrator,
    errors: &mut SceneErrors,
) {
    if !errors.0.is_empty() {
        return;
    }
    let mut reported: Vec<SourceSpan> = Vec::new();
    for (shape, material) in plan.appearances.all.iter().zip(materials) {
        let spread = [material.reflections(), material.transmissions()];
        // The most rays into which one specular ray is split, each with this share of its weight.
        let shares = spread[0].max(spread[1]);
        let Some((place, _)) = shape.material.as_ref().filter(|_| shares > 1) else {
            continue;
        };
        // At a bounce, both a reflection and a transmission may be spread.
        let directions: u32 = spread.into_iter().filter(|rays| *rays > 1).sum();
        let bounces = integrator.max_split_depth(shares);
        let power = |base: u32, bounces: u32| libm::pow(f64::from(base), f64::from(bounces));
        let rays = |bounces: u32| power(directions, bounces);
        if rays(bounces) <= MAX_REFLECTIONS || reported.contains(place) {
            continue;
        }
        reported.push(place.clone());
        let message = format!(
            "with this material one camera ray may become {directions}^{bounces} rays, more than 2^24"
        );
        let most = (1..bounces)
            .take_while(|bounces| rays(*bounces) <= MAX_REFLECTIONS)
            .count() as u32;
        // The smallest power of ten for which one more bounce is skipped.
        let power = libm::log10(power(shares, most + 1)).floor();
        let help = format!(
            "set `max_depth` of the integrator to at most {most} or its `min_contribution` to at least 1e-{power}, or reduce `samples`"
        );
        errors
            .0
            .push(SceneError::at(place.clone(), message).with_help(help));
    }
}
