//! Lowering of object-space triangles to a world-space mesh, shared by triangle and mesh.

use whitstone_core::{DVec2, DVec3, MeshAttributes, Transform, TriangleMesh};

/// Triangles in object space. There are as many of each vertex attribute as positions, or none.
#[derive(Clone, Debug, Default)]
pub(crate) struct Triangles {
    pub(crate) positions: Vec<DVec3>,
    pub(crate) normals: Vec<DVec3>,
    pub(crate) uvs: Vec<DVec2>,
    /// All vertex indices are less than the number of positions.
    pub(crate) triangles: Vec<[u32; 3]>,
    /// Vertex colours, second texture coordinates and tangents, as in [`MeshAttributes`] but in
    /// object space.
    pub(crate) attributes: MeshAttributes,
}

/// A mesh in world space, and its number of degenerate triangles.
pub(crate) struct Lowered {
    pub(crate) mesh: TriangleMesh,
    /// Number of triangles without area.
    pub(crate) flat: usize,
}

/// Transforms triangles to world space; `None` if a position is not finite there.
pub(crate) fn lower(object: Triangles, transform: &Transform) -> Option<Lowered> {
    let Triangles {
        mut positions,
        mut normals,
        uvs,
        mut triangles,
        mut attributes,
    } = object;
    for p in &mut positions {
        *p = transform.point_to_world(*p);
        if !p.is_finite() {
            return None;
        }
    }
    // Normals without a direction stay zero: they contribute nothing to interpolation.
    for n in &mut normals {
        let unit = n.try_normalize();
        *n = unit.map_or(DVec3::ZERO, |unit| transform.normal_to_world(unit));
    }
    let mut flat = 0;
    for triangle in &mut triangles {
        let [a, b, c] = triangle.map(|i| positions[i as usize]);
        // Collapse degenerate triangles to one point. Rounding could otherwise report a hit with a
        // NaN or non-unit normal. With three equal corners every edge function is exactly zero, so
        // the test always rejects the triangle.
        if !(b - a).cross(c - a).length_squared().is_normal() {
            *triangle = [triangle[0]; 3];
            flat += 1;
        }
    }
    let linear = transform.world_from_object().matrix3;
    let mirrors = linear.determinant() < 0.0;
    for tangent in &mut attributes.tangents {
        *tangent = linear * *tangent;
    }
    if mirrors {
        for handedness in &mut attributes.handedness {
            *handedness = -*handedness;
        }
    }
    let mesh = TriangleMesh {
        positions,
        normals,
        uvs,
        triangles,
        orientation: if mirrors { -1.0 } else { 1.0 },
        attributes: (attributes != MeshAttributes::default()).then(|| Box::new(attributes)),
    };
    Some(Lowered { mesh, flat })
}

#[cfg(test)]
mod tests {
    use super::*;
    use whitstone_core::DAffine3;

    #[test]
    fn mirroring_keeps_winding_and_says_so() {
        let object = Triangles {
            positions: vec![DVec3::ZERO, DVec3::X, DVec3::Y],
            triangles: vec![[0, 1, 2]],
            ..Triangles::default()
        };
        let mirror = Transform::new(DAffine3::from_scale(DVec3::new(1.0, 1.0, -1.0))).unwrap();
        let lowered = lower(object, &mirror).unwrap();
        assert_eq!(lowered.mesh.triangles, [[0, 1, 2]]);
        assert_eq!(lowered.mesh.orientation, -1.0);
    }

    #[test]
    fn flat_triangles_are_counted_and_collapsed() {
        let object = Triangles {
            positions: vec![DVec3::ZERO, DVec3::splat(0.1), DVec3::splat(0.3), DVec3::X],
            normals: vec![DVec3::ZERO, DVec3::ZERO, 2.0 * DVec3::Z, DVec3::X],
            triangles: vec![[0, 1, 2], [0, 1, 3], [3, 3, 1]],
            ..Triangles::default()
        };
        let lowered = lower(object, &Transform::IDENTITY).unwrap();
        assert_eq!(lowered.flat, 2);
        // Normals have unit length down to the size at which triangles count as degenerate.
        let small = |size: f64| {
            let corners = [DVec3::ZERO, DVec3::X, DVec3::Y];
            let object = Triangles {
                positions: corners.map(|corner| size * corner).to_vec(),
                triangles: vec![[0, 1, 2]],
                ..Triangles::default()
            };
            lower(object, &Transform::IDENTITY).unwrap().flat
        };
        assert_eq!([1e-76, 1e-80, 1e-100].map(small), [0, 1, 1]);
        assert_eq!(lowered.mesh.triangles, [[0, 0, 0], [0, 1, 3], [3, 3, 3]]);
        assert_eq!(
            lowered.mesh.normals,
            [DVec3::ZERO, DVec3::ZERO, DVec3::Z, DVec3::X]
        );
    }
}
