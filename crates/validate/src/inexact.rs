//! Finds scenes in which the reference is too inaccurate to decide.
//!
//! Mitsuba computes in single precision. Far from the origin, in tiny shapes and after many
//! reflections at curved surfaces, its own error exceeds the tolerance, and pixels stay unexplained
//! although ours are right. The verdict does not change: a case that cannot be confirmed does not
//! pass. The notes only show which renderer may be inaccurate.

use crate::protocol::Setting;
use crate::renderer::Renderer;
use crate::result::CaseResult;
use whitstone_core::{Aabb, Geometry};

/// A spawn offset above this fraction of a shape's size is reported. For a ball of one metre some
/// metres from the origin the fraction is 1e-6.
const LARGE_OFFSET: f64 = 1e-4;

/// The evidence that the reference is inaccurate in this scene, one sentence each.
pub(crate) fn notes(case: &CaseResult, geometry: &Geometry, renderer: Renderer, cap: f64) -> Vec<String> {
    let mut notes = Vec::new();
    let k = case
        .reference
        .as_ref()
        .map_or(Setting::default().k, |reference| reference.k);
    if renderer.is_single_precision()
        && let Some(worst) = worst_offset(geometry, k)
        && worst.ratio() > LARGE_OFFSET
    {
        notes.push(format!(
            "it offsets rays that are spawned on shape {} by {:.1e} m, {:.1e} of the shape's size of {:.1e} m: single precision is \
             too coarse {:.1e} m away from the origin",
            worst.shape,
            worst.step,
            worst.ratio(),
            worst.size,
            worst.far,
        ));
    }
    let most = 0.5 * cap;
    if case.floor > most {
        notes.push(format!(
            "its own error in this scene is {:.1e}, more than half of the largest possible limit, {:.0e}",
            case.floor, cap,
        ));
    }
    if let Some(moved) = case.moved
        && moved > case.explained_limit
    {
        notes.push(format!(
            "it varies by more than the tolerance at {moved} pixels when its spawn offset, its \
             traversal or its roundings change; {} may differ",
            case.explained_limit,
        ));
    }
    notes
}

/// The distance by which the reference moves the origins of rays that leave a shape, with the
/// shape's size.
struct Offset {
    shape: u32,
    /// Largest absolute coordinate, in metres.
    far: f64,
    /// The offset, in metres.
    step: f64,
    /// Diagonal of the bounds, in metres.
    size: f64,
}

impl Offset {
    fn ratio(&self) -> f64 {
        self.step / self.size
    }
}

/// The shape that is smallest compared with its distance from the origin. Infinite shapes have no
/// size.
fn worst_offset(geometry: &Geometry, k: f64) -> Option<Offset> {
    let mut bounds = vec![Aabb::EMPTY; geometry.shapes().len()];
    for element in geometry.elements() {
        let of_shape = &mut bounds[element.shape() as usize];
        *of_shape = of_shape.union(geometry.bounds(element));
    }
    let offsets = bounds.into_iter().zip(0u32..).filter_map(|(aabb, shape)| {
        let size = aabb.extent().length();
        let far = aabb.min.abs().max(aabb.max.abs()).max_element();
        let step = k * (-24.0_f64).exp2() * (1.0 + far);
        (size > 0.0 && size.is_finite()).then_some(Offset {
            shape,
            far,
            step,
            size,
        })
    });
    offsets.max_by(|a, b| a.ratio().total_cmp(&b.ratio()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::floor;
    use whitstone_core::{DVec3, LoweredShape, TriangleMesh};

    fn triangle(at: f64, size: f64) -> LoweredShape {
        let corner = |direction: DVec3| DVec3::new(at, 0.0, 0.0) + direction * size;
        LoweredShape::Triangles(TriangleMesh {
            positions: vec![corner(DVec3::ZERO), corner(DVec3::X), corner(DVec3::Y)],
            normals: Vec::new(),
            uvs: Vec::new(),
            triangles: vec![[0, 1, 2]],
            orientation: 1.0,
            attributes: None,
        })
    }

    fn found(shapes: Vec<LoweredShape>, change: impl Fn(&mut CaseResult)) -> Vec<String> {
        let mut case = CaseResult {
            explained_limit: 8,
            moved: Some(8),
            floor: 2.5e-5,
            ..CaseResult::default()
        };
        change(&mut case);
        notes(
            &case,
            &Geometry::new(shapes),
            Renderer::MITSUBA,
            floor::cap(Renderer::MITSUBA.largest_limit(), false),
        )
    }

    #[test]
    fn an_ordinary_scene_has_none() {
        assert_eq!(
            found(vec![triangle(10.0, 1.0), triangle(0.0, 0.01)], |_| {}),
            Vec::<String>::new()
        );
        assert_eq!(found(Vec::new(), |case| case.moved = None), Vec::<String>::new());
    }

    #[test]
    fn each_sign_is_told_with_its_numbers() {
        let far = found(vec![triangle(0.0, 1.0), triangle(1e4, 0.1)], |_| {});
        assert!(
            far.len() == 1 && far[0].contains("shape 1 by 2.4e-3 m, 1.7e-2 of"),
            "{far:?}"
        );
        let rough = found(Vec::new(), |case| case.floor = 2.6e-5);
        assert!(
            rough.len() == 1 && rough[0].contains("is 2.6e-5, more than half"),
            "{rough:?}"
        );
        let chaotic = found(Vec::new(), |case| case.moved = Some(9));
        assert!(
            chaotic.len() == 1 && chaotic[0].contains("at 9 pixels"),
            "{chaotic:?}"
        );
    }
}
