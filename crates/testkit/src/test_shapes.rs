//! Shapes for the laws of accelerators: random triangles, slivers, grids of cubes, and balls.

use crate::ball::Ball;
use crate::random::Random;
use whitstone_core::{DVec3, LoweredShape, TriangleMesh};

/// A mesh of these triangles, three corners each.
pub(crate) fn mesh_of(positions: Vec<DVec3>) -> TriangleMesh {
    TriangleMesh {
        triangles: (0..positions.len() as u32 / 3)
            .map(|i| [3 * i, 3 * i + 1, 3 * i + 2])
            .collect(),
        positions,
        orientation: 1.0,
        ..TriangleMesh::default()
    }
}

/// Random triangles in [-1, 1]³, `size` large.
pub(crate) fn random_mesh(random: &mut Random, count: usize, size: f64) -> TriangleMesh {
    let corners = (0..count).flat_map(|_| {
        let center = random.cube();
        [0; 3].map(|_| center + size * random.cube())
    });
    mesh_of(corners.collect())
}

/// A shape of random triangles.
pub(crate) fn soup(random: &mut Random, count: usize, size: f64) -> LoweredShape {
    LoweredShape::Triangles(random_mesh(random, count, size))
}

/// A random ball in a cube of this scale.
pub(crate) fn ball(random: &mut Random, scale: f64) -> LoweredShape {
    LoweredShape::Custom(Box::new(Ball {
        center: scale * random.cube(),
        radius: scale * (0.01 + 0.2 * random.unit()),
    }))
}

/// Slivers in few planes, some along an axis and nearly inside one another, so that rays hit
/// several at nearly the same distance. The thinnest are only as wide as the rounding error.
pub(crate) fn slivers(random: &mut Random, count: usize) -> LoweredShape {
    let corners = (0..count).flat_map(|i| {
        let width = 10f64.powi(-(random.below(15) as i32));
        let (start, angle) = if i % 2 == 0 {
            let plane = [-0.5, 0.0, 0.5][i % 3];
            (
                DVec3::new(random.signed(), random.signed(), plane),
                7.0 * random.unit(),
            )
        } else {
            (DVec3::new(random.signed(), 1e-13 * random.signed(), 0.25), 0.0)
        };
        let (s, c) = f64::sin_cos(angle);
        let along = DVec3::new(c, s, 0.0);
        [start, start + along, start + width * DVec3::new(-s, c, 0.0)]
    });
    LoweredShape::Triangles(mesh_of(corners.collect()))
}

/// The faces of n³ cubes that fill [-1, 1]³, two triangles each; inner faces occur twice.
pub(crate) fn grid(n: usize) -> LoweredShape {
    let mut corners = Vec::new();
    let at = |i: usize| 2.0 * i as f64 / n as f64 - 1.0;
    for cell in 0..n * n * n {
        let low = [cell % n, cell / n % n, cell / n / n];
        for axis in 0..3 {
            for side in 0..2 {
                let corner = |b: usize, c: usize| {
                    let mut p = low;
                    p[axis] += side;
                    p[(axis + 1) % 3] += b;
                    p[(axis + 2) % 3] += c;
                    DVec3::from_array(p.map(at))
                };
                let [a, b, c, d] = [corner(0, 0), corner(1, 0), corner(1, 1), corner(0, 1)];
                corners.extend([a, b, c, a, c, d]);
            }
        }
    }
    LoweredShape::Triangles(mesh_of(corners))
}

/// A ball of 20,000 triangles around a point, of size 1, and in the same mesh a triangle of size
/// `ratio` next to it. All are moved by `offset` along each axis.
pub fn tiny_ball(ratio: f64, offset: f64) -> TriangleMesh {
    const SIDE: usize = 100;
    let at = |i: usize, j: usize| {
        let theta = std::f64::consts::PI * (i as f64 + 0.01) / (SIDE as f64 + 0.02);
        let phi = std::f64::consts::TAU * (j % SIDE) as f64 / SIDE as f64;
        let (s, c) = theta.sin_cos();
        0.5 * DVec3::new(s * phi.cos(), c, s * phi.sin())
    };
    let corners = (0..SIDE * SIDE).flat_map(|k| {
        let (i, j) = (k / SIDE, k % SIDE);
        let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
        [a, b, c, a, c, d]
    });
    let large = [
        DVec3::new(0.3, -0.2, 0.9),
        DVec3::new(-0.6, 0.1, 0.4),
        DVec3::new(0.2, 0.5, 0.3),
    ];
    let mut positions: Vec<DVec3> = corners.collect();
    positions.extend(large.map(|corner| DVec3::Z + ratio * corner));
    for position in &mut positions {
        *position += offset;
    }
    mesh_of(positions)
}
