//! A single triangle.
//!
//! It lowers to a mesh of one triangle and uses the core's watertight intersection test.
//!
//! - Twin: Mitsuba mesh of one triangle (native).
//! - Example: `scenes/shapes/triangle.toml`.

use crate::support::lower::{Lowered, Triangles, lower};
use schemars::JsonSchema;
use serde::Deserialize;
use whitstone_core::config::{Vector2, Vector3};
use whitstone_core::{Context, DVec2, LoweredShape, Plugin, SceneError, SceneErrors, Shapes, Transform};

/// A triangle; its front face is counter-clockwise.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// The corners a, b, c in object space, in metres.
    vertices: [Vector3; 3],
    /// Shading normals at the corners in object space, nonzero, of any length.
    #[schemars(extend("x-default" = "the geometric normal"))]
    normals: Option<[Vector3; 3]>,
    /// Texture coordinates at the corners.
    #[schemars(extend("x-default" = "the barycentric weights of b and c"))]
    uvs: Option<[Vector2; 3]>,
}

/// Lowers to a mesh of one triangle.
pub struct Triangle;

impl Plugin<Shapes> for Triangle {
    const TYPE: &'static str = "triangle";
    type Config = Config;

    fn build(
        config: Config,
        transform: Transform,
        context: &mut dyn Context,
    ) -> Result<LoweredShape, SceneErrors> {
        let normals = config
            .normals
            .map_or(vec![], |normals| normals.map(Vector3::get).to_vec());
        let object = Triangles {
            positions: config.vertices.map(Vector3::get).to_vec(),
            normals,
            uvs: match config.uvs {
                Some(uvs) => uvs.map(Vector2::get).to_vec(),
                None => vec![DVec2::ZERO, DVec2::X, DVec2::Y],
            },
            triangles: vec![[0, 1, 2]],
            ..Triangles::default()
        };
        if object.normals.iter().any(|n| n.try_normalize().is_none()) {
            return Err(SceneError::anywhere("a normal of a triangle must not have length zero").into());
        }
        let Lowered { mesh, flat } = lower(object, &transform).ok_or_else(|| {
            SceneError::anywhere(
                "the transform moves a corner of this triangle out of the range of double precision",
            )
        })?;
        if flat > 0 {
            context.warn(SceneError::anywhere("this triangle has no area and is never hit"));
        }
        Ok(LoweredShape::Triangles(mesh))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use whitstone_core::{DVec3, TriangleMesh};
    use whitstone_testkit::{TestContext, build, build_in, shape_laws_everywhere};

    const CORNERS: &str = "vertices = [[0, 0, 0], [2, 0, 0], [0, 1, 0.5]]\n";

    fn mesh(more: &str) -> TriangleMesh {
        match build::<Shapes, Triangle>(&format!("{CORNERS}{more}"), Transform::IDENTITY) {
            Ok(LoweredShape::Triangles(mesh)) => mesh,
            _ => panic!("a triangle is a mesh"),
        }
    }

    #[test]
    fn obeys_the_laws_of_shapes() {
        shape_laws_everywhere::<Triangle>(CORNERS, 4_000);
        let normals = "normals = [[0, 0, 1], [0, 1, 1], [1, 0, 3]]";
        shape_laws_everywhere::<Triangle>(&format!("{CORNERS}{normals}"), 4_000);
    }

    #[test]
    fn texture_coordinates_are_barycentric_unless_given() {
        assert_eq!(mesh("").uvs, [DVec2::ZERO, DVec2::X, DVec2::Y]);
        assert_eq!(
            mesh("uvs = [[0, 0], [3, 0], [0, 4]]").uvs[2],
            DVec2::new(0.0, 4.0)
        );
        assert_eq!(
            mesh("normals = [[0, 0, 2], [1, 0, 0], [0, 1, 0]]").normals[0],
            DVec3::Z
        );
    }

    #[test]
    fn what_cannot_be_is_refused_and_what_is_odd_is_told() {
        let fails = |text: &str| build::<Shapes, Triangle>(text, Transform::IDENTITY).is_err();
        assert!(fails("vertices = [[0, 0, 0], [1, 0, 0]]"));
        assert!(fails("vertices = [[0, 0, 0], [1, 0, 0], [0, nan, 0]]"));
        assert!(fails(&format!(
            "{CORNERS}normals = [[0, 0, 0], [1, 0, 0], [0, 1, 0]]"
        )));
        assert!(fails(&format!("{CORNERS}uvs = [[0, 0], [1, 0]]")));
        let mut context = TestContext::default();
        let flat = "vertices = [[0, 0, 0], [1, 1, 1], [3, 3, 3]]";
        assert!(build_in::<Shapes, Triangle>(flat, Transform::IDENTITY, &mut context).is_ok());
        assert_eq!(context.warnings.len(), 1);
    }
}
