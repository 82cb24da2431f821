//! Principal axes of a set of points: the directions of largest and smallest spread.

use whitstone_core::{Aabb, DVec3};

/// The coordinate axes.
pub(crate) const COORDINATE_AXES: [DVec3; 3] = [DVec3::X, DVec3::Y, DVec3::Z];

/// Principal axes of points: three orthogonal unit vectors, the largest spread first. They are the
/// eigenvectors of the covariance (Gottschalk, Lin, Manocha, *OBBTree*, 1996, section 4), or the
/// coordinate axes where these are undefined, as for coincident points.
pub(crate) fn principal_axes(points: &[DVec3]) -> [DVec3; 3] {
    let bounds = Aabb::around(points.iter().copied());
    let scale = bounds.extent().max_element();
    let count = points.len() as f64;
    // Scaled, so that squares do not overflow.
    let scaled = || points.iter().map(|&p| (p - bounds.min) / scale);
    let mean = scaled().sum::<DVec3>() / count;
    let mut covariance = [[0.0; 3]; 3];
    for p in scaled() {
        let p = (p - mean).to_array();
        for i in 0..3 {
            for j in 0..3 {
                covariance[i][j] += p[i] * p[j] / count;
            }
        }
    }
    let axes = eigenvectors(covariance);
    let sound = axes.iter().all(|axis| (axis.length_squared() - 1.0).abs() < 1e-6);
    if sound { axes } else { COORDINATE_AXES }
}

/// Unit eigenvectors of a symmetric matrix, that of the largest eigenvalue first, by Jacobi
/// rotations, each of which zeroes one off-diagonal element (Jacobi 1846).
fn eigenvectors(mut m: [[f64; 3]; 3]) -> [DVec3; 3] {
    let mut vectors = COORDINATE_AXES;
    // Each round squares the off-diagonal remainder: six are more than enough.
    for _ in 0..6 {
        for (p, q) in [(0, 1), (0, 2), (1, 2)] {
            if m[p][q] == 0.0 {
                continue;
            }
            let theta = 0.5 * (m[q][q] - m[p][p]) / m[p][q];
            let t = 1.0_f64.copysign(theta) / (theta.abs() + libm::hypot(theta, 1.0));
            let c = 1.0 / libm::hypot(t, 1.0);
            let s = t * c;
            for row in &mut m {
                (row[p], row[q]) = (c * row[p] - s * row[q], s * row[p] + c * row[q]);
            }
            for k in 0..3 {
                (m[p][k], m[q][k]) = (c * m[p][k] - s * m[q][k], s * m[p][k] + c * m[q][k]);
            }
            (vectors[p], vectors[q]) = (c * vectors[p] - s * vectors[q], s * vectors[p] + c * vectors[q]);
        }
    }
    let mut order = [0, 1, 2];
    order.sort_by(|&a, &b| m[b][b].total_cmp(&m[a][a]));
    order.map(|i| vectors[i])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_along_a_line_and_in_a_plane_and_in_one_place() {
        let (a, b) = (DVec3::new(1.0, 2.0, -2.0) / 3.0, DVec3::new(2.0, 1.0, 2.0) / 3.0);
        let points: Vec<DVec3> = (0..50)
            .map(|i| {
                let (x, y) = (f64::from(i % 10) - 4.5, f64::from(i / 10) - 2.0);
                DVec3::splat(1e3) + 4.0 * x * a + y * b
            })
            .collect();
        let axes = principal_axes(&points);
        assert!((axes[0].dot(a).abs() - 1.0).abs() < 1e-9, "{axes:?}");
        assert!((axes[1].dot(b).abs() - 1.0).abs() < 1e-9, "{axes:?}");
        assert!(axes[2].dot(a.cross(b)).abs() > 1.0 - 1e-9, "{axes:?}");
        assert_eq!(principal_axes(&[DVec3::ONE; 4]), COORDINATE_AXES);
        assert_eq!(principal_axes(&[]), COORDINATE_AXES);
    }
}
