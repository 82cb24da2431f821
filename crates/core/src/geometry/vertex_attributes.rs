//! Attributes of mesh vertices besides normals and the first texture coordinates.

use crate::stream::{LANES, Lanes};
use crate::{Rgb, SurfaceAttributes};
use glam::{DMat3, DVec2, DVec3};

/// Vertex attributes that only meshes have, interpolated at a surface point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct VertexAttributes {
    /// Vertex colour; white without one.
    pub color: Rgb,
    /// Alpha of the vertex colour; 1 without one.
    pub alpha: f64,
    /// Second set of texture coordinates.
    pub second_uv: DVec2,
    /// Tangent in world space, not normalised; zero without one.
    pub tangent: DVec3,
    /// 1 if the bitangent is `n_s x tangent`, -1 if it is the opposite.
    pub handedness: f64,
}

impl VertexAttributes {
    /// Those of a shape without vertex attributes.
    pub const NONE: Self = Self {
        color: Rgb::new(1.0, 1.0, 1.0),
        alpha: 1.0,
        second_uv: DVec2::ZERO,
        tangent: DVec3::ZERO,
        handedness: 1.0,
    };

    /// The attributes as they are after a transform with this linear part.
    #[must_use]
    pub(crate) fn transformed(mut self, linear: &DMat3) -> Self {
        if self.tangent != DVec3::ZERO {
            self.tangent = *linear * self.tangent;
            self.handedness *= linear.determinant().signum();
        }
        self
    }
}

impl Default for VertexAttributes {
    fn default() -> Self {
        Self::NONE
    }
}

/// Vertex attributes for each point of a stream.
#[derive(Clone)]
pub struct VertexAttributeStream(pub Lanes<VertexAttributes>);

impl Default for VertexAttributeStream {
    fn default() -> Self {
        Self([VertexAttributes::NONE; LANES])
    }
}

/// The vertex attributes of a mesh. Each list has an element for each vertex, or none.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct MeshAttributes {
    /// Linear RGBA.
    pub colors: Vec<[f64; 4]>,
    /// Second set of texture coordinates.
    pub second_uvs: Vec<DVec2>,
    /// Tangents in world space.
    pub tangents: Vec<DVec3>,
    /// For each *triangle*, if there are tangents: see [`VertexAttributes::handedness`].
    pub handedness: Vec<f64>,
}

impl MeshAttributes {
    /// The attributes at barycentric coordinates of a triangle.
    pub(crate) fn at(
        &self,
        triangle: usize,
        vertices: [u32; 3],
        weights: [f64; 3],
        needs: SurfaceAttributes,
    ) -> VertexAttributes {
        let mut found = VertexAttributes::NONE;
        let corners = vertices.map(|vertex| vertex as usize);
        if needs.contains(SurfaceAttributes::VERTEX_COLOR) && !self.colors.is_empty() {
            let [a, b, c] = corners.map(|vertex| self.colors[vertex]);
            let blend = |k: usize| weights[0] * a[k] + weights[1] * b[k] + weights[2] * c[k];
            found.color = Rgb::new(blend(0), blend(1), blend(2));
            found.alpha = blend(3);
        }
        if needs.contains(SurfaceAttributes::SECOND_UV) && !self.second_uvs.is_empty() {
            let [a, b, c] = corners.map(|vertex| self.second_uvs[vertex]);
            found.second_uv = weights[0] * a + weights[1] * b + weights[2] * c;
        }
        if needs.contains(SurfaceAttributes::TANGENT) && !self.tangents.is_empty() {
            let [a, b, c] = corners.map(|vertex| self.tangents[vertex]);
            found.tangent = weights[0] * a + weights[1] * b + weights[2] * c;
            found.handedness = self.handedness[triangle];
        }
        found
    }
}
