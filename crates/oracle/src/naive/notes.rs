//! Formulas of the lecture notes that differ from the Whitted model, in double precision.
//!
//! Sources: lecture notes on ray tracing, not published. Each function is the formula as it is
//! written there. `cargo xtask readme` measures their errors against the tracer
//! (`docs/variants.md`).

use whitstone_core::DVec3;

/// The shading model of the notes for one light and one channel: `c_r (c_a + c_l max(0, n·l)) +
/// c_l (h·n)^p`. The highlight has no coefficient `k_s` and no `max(0, .)`.
///
/// `n`, `l` and `v` are unit vectors: the normal, the directions to the light and to the viewer.
pub fn shade(reflectance: f64, ambient: f64, light: f64, exponent: i32, [n, l, v]: [DVec3; 3]) -> f64 {
    let h = (l + v).normalize();
    reflectance * (ambient + light * n.dot(l).max(0.0)) + light * h.dot(n).powi(exponent)
}

/// The start of a secondary ray, `distance` metres from the surface point along its own direction:
/// the fix of the notes for rays that hit the surface that they leave.
pub fn offset_along_direction(point: DVec3, direction: DVec3, distance: f64) -> DVec3 {
    point + distance * direction
}

/// Bilinear interpolation between the texels (i, j), (i+1, j), (i, j+1) and (i+1, j+1) with
/// `i = floor(u n_x)` and the fraction of `u n_x` as the weight: texels lie at the corners of their
/// squares instead of in the middle. `texel` gives the texel of a column and a row; indices of
/// `size` start again from 0.
pub fn bilinear(texel: impl Fn([usize; 2]) -> f64, size: [usize; 2], uv: [f64; 2]) -> f64 {
    let place = [0, 1].map(|axis| uv[axis].rem_euclid(1.0) * size[axis] as f64);
    let low = place.map(f64::floor);
    let weight = [place[0] - low[0], place[1] - low[1]];
    let mut sum = 0.0;
    for (j, y) in [(0, 1.0 - weight[1]), (1, weight[1])] {
        for (i, x) in [(0, 1.0 - weight[0]), (1, weight[0])] {
            let column = (low[0] as usize + i) % size[0];
            let row = (low[1] as usize + j) % size[1];
            sum += x * y * texel([column, row]);
        }
    }
    sum
}

/// A vertex of a triangle with the vectors of Phong shading in the notes: b to the viewer, n the
/// normal, s to the light. All have unit length.
#[derive(Clone, Copy, Debug)]
pub struct Vertex {
    /// To the viewer.
    pub b: DVec3,
    /// Normal.
    pub n: DVec3,
    /// To the light.
    pub s: DVec3,
}

/// The vectors b, n and s inside a triangle: those of its vertices, interpolated by barycentric
/// coordinates and normalised. Only n is interpolated in the model; b and s follow from the point.
pub fn interpolated(vertices: [Vertex; 3], weights: [f64; 3]) -> Vertex {
    let mean = |of: fn(&Vertex) -> DVec3| {
        let sum: DVec3 = vertices
            .iter()
            .zip(weights)
            .map(|(vertex, weight)| weight * of(vertex))
            .sum();
        sum.normalize()
    };
    Vertex {
        b: mean(|vertex| vertex.b),
        n: mean(|vertex| vertex.n),
        s: mean(|vertex| vertex.s),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_highlight_is_also_on_dark_sides() {
        let v = DVec3::Z;
        let l = DVec3::X;
        // Halfway between both, where h is.
        let bright = (l + v).normalize();
        assert!((shade(0.0, 0.0, 1.0, 8, [bright, l, v]) - 1.0).abs() < 1e-14);
        // Seen, and turned away from the light: n·l < 0, but not h·n.
        let dark = DVec3::new(-0.5, 0.0, 3.0_f64.sqrt() / 2.0);
        let found = shade(0.0, 0.0, 1.0, 2, [dark, l, v]);
        assert!(
            (found - 0.5 * ((3.0_f64.sqrt() - 1.0) / 2.0).powi(2)).abs() < 1e-14,
            "{found}"
        );
        // With h behind the surface odd exponents give negative light.
        let light = DVec3::new(-0.96, 0.0, -0.28);
        let seen = DVec3::new(0.96, 0.0, 0.28);
        assert!(shade(0.0, 0.0, 1.0, 3, [seen, light, v]) < 0.0);
    }

    #[test]
    fn texels_lie_at_corners() {
        let texels = [1.0, 2.0, 4.0, 8.0];
        let found = |u| bilinear(|[i, _]| texels[i], [4, 1], [u, 0.5]);
        assert_eq!(found(0.25), 2.0);
        // In the middle of texel 1, where the model has its value.
        assert_eq!(found(0.375), 3.0);
        // From the last texel to the first one.
        assert_eq!(found(0.875), 4.5);
        assert_eq!(found(1.25), 2.0);
    }

    #[test]
    fn interpolation_keeps_parallel_vectors_and_bends_others() {
        let vertex = |x: f64| Vertex {
            b: DVec3::Z,
            n: DVec3::Z,
            s: DVec3::new(-x, 0.0, 1.0).normalize(),
        };
        let found = interpolated([vertex(0.0), vertex(1.0), vertex(0.0)], [0.25, 0.5, 0.25]);
        assert_eq!((found.b, found.n), (DVec3::Z, DVec3::Z));
        // At x = 0.5, where the light is in the direction (-0.5, 0, 1).
        let exact = DVec3::new(-0.5, 0.0, 1.0).normalize();
        let off = found.s.angle_between(exact).to_degrees();
        assert!((3.5..5.0).contains(&off), "{off} degrees");
    }
}
