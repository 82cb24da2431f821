//! Mesh tangents from texture coordinates: section 8 of the model, `normal_map`.

use super::Mesh;
use std::collections::BTreeMap;
use whitstone_core::DVec3;

/// Relative size of a determinant of texture coordinates below which its sign is uncertain.
const CERTAIN: f64 = 1e-12;

impl Mesh {
    /// Computes the tangents. An error if rounding decides the sign of one that counts.
    pub(super) fn add_tangents(&mut self) -> Result<(), String> {
        let mut sums: BTreeMap<usize, DVec3> = BTreeMap::new();
        let mut signs = Vec::new();
        for (triangle, corners) in self.triangles.iter().enumerate() {
            let [a, b, c] = corners.map(DVec3::from_array);
            let [p, q, r] = self.uvs[triangle].unwrap_or_default();
            let [u1, v1] = [q[0] - p[0], q[1] - p[1]];
            let [u2, v2] = [r[0] - p[0], r[1] - p[1]];
            let d = u1 * v2 - u2 * v1;
            let t = (v2 * (b - a) - v1 * (c - a)) * sign(d);
            let size = (u1 * v2).abs() + (u2 * v1).abs();
            if size > 0.0 && d.abs() <= CERTAIN * size && (b - a).cross(c - a) != DVec3::ZERO {
                return Err("tangents of texture coordinates that lie in a line".to_owned());
            }
            signs.push(sign(d));
            if d != 0.0 && t != DVec3::ZERO {
                for vertex in self.vertices[triangle] {
                    *sums.entry(vertex).or_default() += t.normalize();
                }
            }
        }
        let of = |vertex: usize| sums.get(&vertex).map_or([0.0; 3], DVec3::to_array);
        let triangles = self.vertices.iter().zip(signs);
        self.tangents = triangles
            .map(|(three, sign)| Some((three.map(of), sign)))
            .collect();
        Ok(())
    }
}

/// -1 or 1; 1 for 0.
fn sign(x: f64) -> f64 {
    if x < 0.0 { -1.0 } else { 1.0 }
}
