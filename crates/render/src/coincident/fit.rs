//! Finds an affine map near the identity that moves the surfaces of a shape by given distances
//! along their normals.

use whitstone_core::{DMat3, DVec3};

/// A surface of a shape and its displacement.
pub(crate) struct Target {
    /// Points of the surface, each with the normal there.
    pub(crate) points: Vec<(DVec3, DVec3)>,
    /// Displacement along the normal, in metres.
    pub(crate) along: f64,
    /// Width of a gap there, in metres.
    pub(crate) gap: f64,
}

/// The displacement field of a map: `shift + linear * p` is added to each point.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Change {
    pub(crate) linear: DMat3,
    shift: DVec3,
}

impl Change {
    /// The displacement of a point.
    pub(crate) fn of(&self, p: DVec3) -> DVec3 {
        self.shift + self.linear * p
    }
}

/// Number of coefficients of an affine map.
const UNKNOWNS: usize = 12;

/// Maximum error of a surface's position, in gaps.
const LOOSE: f64 = 0.25;

/// Damping of unconstrained directions, relative to the mean square of the constraints.
const DAMPING: f64 = 1e-10;

/// The smallest change that gives all surfaces their displacements; `None` if no affine map does.
pub(crate) fn fit(targets: &[Target]) -> Option<Change> {
    let points = || {
        targets
            .iter()
            .flat_map(|target| target.points.iter().map(move |point| (point, target)))
    };
    let count = points().count();
    let center = points().map(|((p, _), _)| *p).sum::<DVec3>() / count as f64;
    let size = points()
        .map(|((p, _), _)| (*p - center).abs().max_element())
        .fold(0.0, f64::max);
    let gap = targets.iter().map(|target| target.gap).fold(0.0, f64::max);
    // NaN fails the test.
    if !(size > 0.0 && size.is_finite() && gap > 0.0) {
        return None;
    }
    let row = |p: DVec3, n: DVec3| {
        let q = ((p - center) / size).to_array();
        let mut row = [0.0; UNKNOWNS];
        for axis in 0..3 {
            row[axis] = n[axis];
            for (k, q) in q.iter().enumerate() {
                row[3 + 3 * axis + k] = n[axis] * q;
            }
        }
        row
    };
    // Normal equations. All surfaces have equal weight; the unit is the gap.
    let mut matrix = [[0.0; UNKNOWNS]; UNKNOWNS];
    let mut right = [0.0; UNKNOWNS];
    for target in targets {
        let weight = 1.0 / target.points.len() as f64;
        for (p, n) in &target.points {
            let row = row(*p, *n);
            for i in 0..UNKNOWNS {
                right[i] += weight * row[i] * target.along / gap;
                for j in 0..UNKNOWNS {
                    matrix[i][j] += weight * row[i] * row[j];
                }
            }
        }
    }
    let trace: f64 = (0..UNKNOWNS).map(|i| matrix[i][i]).sum();
    for (i, row) in matrix.iter_mut().enumerate() {
        row[i] += DAMPING * trace;
    }
    let x = solve(matrix, right)?;
    let fits = |target: &Target| {
        target.points.iter().all(|(p, n)| {
            let moved: f64 = row(*p, *n).iter().zip(&x).map(|(a, b)| a * b).sum();
            (moved * gap - target.along).abs() <= LOOSE * target.gap
        })
    };
    if !targets.iter().all(fits) {
        return None;
    }
    let rows = [0, 1, 2].map(|axis| DVec3::from_slice(&x[3 + 3 * axis..6 + 3 * axis]));
    let linear = DMat3::from_cols_array_2d(&rows.map(|row| row.to_array())).transpose() * (gap / size);
    let shift = gap * DVec3::from_slice(&x[..3]) - linear * center;
    Some(Change { linear, shift })
}

/// Solves a symmetric positive definite system (Cholesky).
fn solve(mut a: [[f64; UNKNOWNS]; UNKNOWNS], mut b: [f64; UNKNOWNS]) -> Option<[f64; UNKNOWNS]> {
    for j in 0..UNKNOWNS {
        for k in 0..j {
            for i in j..UNKNOWNS {
                a[i][j] -= a[i][k] * a[j][k];
            }
        }
        let pivot = a[j][j];
        if pivot.is_nan() || pivot <= 0.0 {
            return None;
        }
        for row in a.iter_mut().skip(j) {
            row[j] /= pivot.sqrt();
        }
    }
    for i in 0..UNKNOWNS {
        for k in 0..i {
            b[i] -= a[i][k] * b[k];
        }
        b[i] /= a[i][i];
    }
    for i in (0..UNKNOWNS).rev() {
        for k in i + 1..UNKNOWNS {
            b[i] -= a[k][i] * b[k];
        }
        b[i] /= a[i][i];
    }
    Some(b)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn face(n: DVec3, along: f64) -> Target {
        let (x, y) = n.any_orthonormal_pair();
        let corners = [x + y, x - y, -x - y, -x + y].map(|p| (p + n + DVec3::splat(5.0), n));
        Target {
            points: corners.to_vec(),
            along,
            gap: 1e-12,
        }
    }

    #[test]
    fn each_face_of_a_box_moves_independently() {
        let gaps = [-1.0, -2.0, 0.0, -1.0, 0.0, -3.0];
        let faces = [
            DVec3::X,
            DVec3::NEG_X,
            DVec3::Y,
            DVec3::NEG_Y,
            DVec3::Z,
            DVec3::NEG_Z,
        ];
        let targets: Vec<Target> = faces.iter().zip(gaps).map(|(n, k)| face(*n, k * 1e-12)).collect();
        let change = fit(&targets).unwrap();
        for target in &targets {
            for (p, n) in &target.points {
                assert!((change.of(*p).dot(*n) - target.along).abs() < 1e-18, "{n}");
            }
        }
    }

    #[test]
    fn contradictory_displacements_have_no_fit() {
        assert!(fit(&[face(DVec3::X, 1e-12), face(DVec3::X, -1e-12)]).is_none());
    }
}
