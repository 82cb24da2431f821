//! Mesh tangents from texture coordinates: section 8 of the model, `normal_map`.

use super::Mesh;
use std::collections::BTreeMap;
use whitstone_core::DVec3;

/// Relative size of a determinant of rounded differences below which its sign is uncertain.
const CERTAIN: f64 = 1e-12;

impl Mesh {
    /// Computes the tangents. An error if rounding decides the sign of one that counts.
    pub(super) fn add_tangents(&mut self) -> Result<(), String> {
        let mut sums: BTreeMap<usize, DVec3> = BTreeMap::new();
        let mut signs = Vec::new();
        for (triangle, corners) in self.triangles.iter().enumerate() {
            let [a, b, c] = corners.map(DVec3::from_array);
            let [p, q, r] = self.uvs[triangle].unwrap_or_default();
            let d = determinant(p, q, r);
            if d.is_none() && (b - a).cross(c - a) != DVec3::ZERO {
                return Err("tangents of texture coordinates that almost lie in a line".to_owned());
            }
            let d = d.unwrap_or(0.0);
            let t = ((r[1] - p[1]) * (b - a) - (q[1] - p[1]) * (c - a)) * sign(d);
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

/// `u1 v2 - u2 v1` with the right sign, and 0 only where it is exactly 0; `None` if that is
/// uncertain.
///
/// If the differences are exact, as they are for most numbers of single precision, the rounding
/// error of each product is known exactly (Dekker 1971).
fn determinant(p: [f64; 2], q: [f64; 2], r: [f64; 2]) -> Option<f64> {
    let [u1, v1, u2, v2] = [(q[0], p[0]), (q[1], p[1]), (r[0], p[0]), (r[1], p[1])].map(|(x, y)| x - y);
    let exact = |x: f64, y: f64| {
        let d = x - y;
        d + y == x && x - d == y
    };
    let (one, other) = (u1 * v2, u2 * v1);
    let all_exact = exact(q[0], p[0]) && exact(q[1], p[1]) && exact(r[0], p[0]) && exact(r[1], p[1]);
    let d = match all_exact {
        true => (one - other) + (u1.mul_add(v2, -one) - u2.mul_add(v1, -other)),
        false => one - other,
    };
    let size = one.abs() + other.abs();
    (all_exact || size == 0.0 || d.abs() > CERTAIN * size).then_some(d)
}

/// -1 or 1; 1 for 0.
fn sign(x: f64) -> f64 {
    if x < 0.0 { -1.0 } else { 1.0 }
}

#[cfg(test)]
mod tests {
    use super::determinant;

    #[test]
    fn the_sign_of_a_determinant_is_exact_or_uncertain() {
        let at = |x: f32, y: f32| [f64::from(x), f64::from(y)];
        // In a line, which rounded products do not tell.
        let (p, q, r) = (at(0.1, 0.1), at(0.4, 0.4), at(0.7, 0.7));
        assert_eq!(determinant(p, q, r), Some(0.0));
        // Off the line by one unit in the last place of single precision.
        for (y, sign) in [(0.7_f32.next_up(), 1.0), (0.7_f32.next_down(), -1.0)] {
            let found = determinant(p, q, at(0.7, y)).unwrap();
            assert!(found != 0.0 && found.signum() == sign, "{found}");
        }
        // Differences that are rounded.
        assert_eq!(determinant([1e-17, 1e-17], [0.5, 0.5], [1.0, 1.0]), None);
        assert!(determinant([1e-17, 0.0], [0.5, 0.5], [1.0, 0.2]).is_some());
    }
}
