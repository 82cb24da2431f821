//! Triangles in object space, made ready for the core: what triangle and mesh have in common.

use whitstone_core::{DVec2, DVec3, Transform, TriangleMesh};

/// Triangles in object space. Normals and texture coordinates are as many as positions, or none.
#[derive(Debug, Default)]
pub(crate) struct Triangles {
    pub(crate) positions: Vec<DVec3>,
    pub(crate) normals: Vec<DVec3>,
    pub(crate) uvs: Vec<DVec2>,
    /// All vertex numbers are below the number of positions.
    pub(crate) triangles: Vec<[u32; 3]>,
}

/// A mesh in world space, and what was odd about it.
pub(crate) struct Lowered {
    pub(crate) mesh: TriangleMesh,
    /// Triangles without an area.
    pub(crate) flat: usize,
}

/// Into world space; `None` if a position is no longer finite there.
pub(crate) fn lower(object: Triangles, transform: &Transform) -> Option<Lowered> {
    let Triangles {
        mut positions,
        mut normals,
        uvs,
        mut triangles,
    } = object;
    for p in &mut positions {
        *p = transform.point_to_world(*p);
        if !p.is_finite() {
            return None;
        }
    }
    // Normals that have no direction stay zero: they add nothing where they are interpolated.
    for n in &mut normals {
        let unit = n.try_normalize();
        *n = unit.map_or(DVec3::ZERO, |unit| transform.normal_to_world(unit));
    }
    let mut flat = 0;
    for triangle in &mut triangles {
        let [a, b, c] = triangle.map(|i| positions[i as usize]);
        // Rounding could let a ray hit a triangle whose corners lie in a line, and its normal is
        // not a number, or not of unit length where its square has lost digits. Where all corners
        // are one, all edge functions are exactly zero: it is never hit.
        if !(b - a).cross(c - a).length_squared().is_normal() {
            *triangle = [triangle[0]; 3];
            flat += 1;
        }
    }
    let mirrors = transform.world_from_object().matrix3.determinant() < 0.0;
    let mesh = TriangleMesh {
        positions,
        normals,
        uvs,
        triangles,
        orientation: if mirrors { -1.0 } else { 1.0 },
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
        // Normals have unit length down to where there are none.
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
