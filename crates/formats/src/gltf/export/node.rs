//! Transforms of nodes.

use crate::gltf::import::shortest;
use serde_json::Value;
use whitstone_core::{DAffine3, DMat3, DVec3};

/// Largest cosine of columns that count as perpendicular.
const PERPENDICULAR: f64 = 1e-6;

/// An affine map as transforms of nodes, the outermost first: one, or two if it shears, since the
/// matrix of a node must be a product of translation, rotation and scale.
pub(super) fn factors(map: &DAffine3) -> Vec<DAffine3> {
    let matrix: DMat3 = map.matrix3;
    let columns = [matrix.x_axis, matrix.y_axis, matrix.z_axis].map(|column| column.normalize_or_zero());
    let perpendicular = [(0, 1), (1, 2), (2, 0)]
        .into_iter()
        .all(|(a, b)| columns[a].dot(columns[b]).abs() < PERPENDICULAR);
    if perpendicular {
        return vec![*map];
    }
    let turned = principal_axes(&(matrix.transpose() * matrix));
    vec![
        DAffine3::from_mat3_translation(matrix * turned, map.translation),
        DAffine3::from_mat3(turned.transpose()),
    ]
}

/// A rotation whose columns are eigenvectors of a symmetric matrix, by Jacobi's method.
fn principal_axes(symmetric: &DMat3) -> DMat3 {
    let mut matrix = *symmetric;
    let mut axes = DMat3::IDENTITY;
    for _ in 0..32 {
        for (p, q) in [(0, 1), (0, 2), (1, 2)] {
            let off = matrix.col(q)[p];
            let scale = matrix.col(p)[p].abs() + matrix.col(q)[q].abs();
            if off.abs() <= f64::EPSILON * scale * 1e-3 {
                continue;
            }
            let theta = (matrix.col(q)[q] - matrix.col(p)[p]) / (2.0 * off);
            let t = 1_f64.copysign(theta) / (theta.abs() + (theta * theta + 1.0).sqrt());
            let cos = 1.0 / (t * t + 1.0).sqrt();
            let sin = t * cos;
            let mut turn = DMat3::IDENTITY;
            turn.col_mut(p)[p] = cos;
            turn.col_mut(q)[q] = cos;
            turn.col_mut(q)[p] = sin;
            turn.col_mut(p)[q] = -sin;
            matrix = turn.transpose() * matrix * turn;
            axes *= turn;
        }
    }
    axes
}

/// The key `matrix` of a node; none for the identity.
pub(super) fn matrix(map: &DAffine3) -> Option<Value> {
    if *map == DAffine3::IDENTITY {
        return None;
    }
    let columns = [
        (map.matrix3.x_axis, 0.0),
        (map.matrix3.y_axis, 0.0),
        (map.matrix3.z_axis, 0.0),
        (map.translation, 1.0),
    ];
    let numbers = columns.iter().flat_map(|(column, last)| {
        let DVec3 { x, y, z } = *column;
        [x, y, z, *last]
    });
    // Zeros without a sign.
    Some(numbers.map(|part| shortest(part as f32) + 0.0).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sheared_maps_become_two_of_rotations_and_scales() {
        let turn = DAffine3::from_axis_angle(DVec3::new(1.0, 2.0, 3.0).normalize(), 0.7);
        let maps = [
            DAffine3::from_scale(DVec3::new(1.0, -2.0, 3.0)) * turn,
            DAffine3::from_mat3_translation(
                DMat3::from_cols(DVec3::X, DVec3::new(5.0, 1.0, 0.0), DVec3::new(0.1, 0.2, 1e-3)),
                DVec3::ONE,
            ),
        ];
        for map in maps {
            let parts = factors(&map);
            let [outer, inner] = parts[..] else {
                panic!("{parts:?}")
            };
            assert!((outer * inner).abs_diff_eq(map, 1e-12));
            for part in [outer, inner] {
                assert_eq!(factors(&part).len(), 1, "{part:?}");
            }
        }
        let rotated = turn * DAffine3::from_scale(DVec3::new(1.0, -2.0, 3.0));
        assert_eq!(factors(&rotated), [rotated]);
    }
}
