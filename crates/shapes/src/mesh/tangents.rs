//! Tangents from texture coordinates, for normal maps in the frame of a mesh.
//!
//! The tangent of a vertex is the mean direction of increasing u over its triangles (Lengyel,
//! *Mathematics for 3D Game Programming and Computer Graphics*, section 7.8).

use super::Triangles;
use whitstone_core::{DVec2, DVec3};

/// Adds tangents to a mesh that has none. Without texture coordinates they are zero.
pub(super) fn add(object: &mut Triangles) {
    if !object.attributes.tangents.is_empty() {
        return;
    }
    let mut tangents = vec![DVec3::ZERO; object.positions.len()];
    for triangle in &object.triangles {
        let corners = triangle.map(|vertex| vertex as usize);
        let [a, b, c] = corners.map(|vertex| object.positions[vertex]);
        let [p, q, r] = corners.map(|vertex| object.uvs.get(vertex).copied().unwrap_or_default());
        let (first, second) = (q - p, r - p);
        let area = first.perp_dot(second);
        let along = (second.y * (b - a) - first.y * (c - a)) * area.signum();
        if area != 0.0
            && let Some(unit) = along.try_normalize()
        {
            for vertex in corners {
                tangents[vertex] += unit;
            }
        }
    }
    object.attributes.tangents = tangents;
    object.attributes.handedness = handedness(&object.uvs, &object.triangles);
}

/// Whether the texture coordinates of each triangle run counter-clockwise (1) or clockwise (-1).
pub(super) fn handedness(uvs: &[DVec2], triangles: &[[u32; 3]]) -> Vec<f64> {
    let sign = |triangle: &[u32; 3]| {
        let [p, q, r] = triangle.map(|vertex| uvs.get(vertex as usize).copied().unwrap_or_default());
        if (q - p).perp_dot(r - p) < 0.0 { -1.0 } else { 1.0 }
    };
    triangles.iter().map(sign).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tangents_point_along_u_and_know_mirrored_coordinates() {
        let mut object = Triangles {
            positions: vec![DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::Z],
            uvs: vec![DVec2::ZERO, DVec2::Y, DVec2::X, DVec2::ZERO],
            triangles: vec![[0, 1, 2], [1, 0, 2], [0, 3, 3]],
            ..Triangles::default()
        };
        add(&mut object);
        // u grows along y; the corner order changes nothing.
        assert_eq!(
            object.attributes.tangents,
            [2.0 * DVec3::Y, 2.0 * DVec3::Y, 2.0 * DVec3::Y, DVec3::ZERO]
        );
        // Seen from +z, u runs up and v to the right.
        assert_eq!(object.attributes.handedness, [-1.0, 1.0, 1.0]);
    }
}
