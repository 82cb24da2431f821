//! `bvh` over a scene that is small enough for Miri, which checks the portable path for undefined
//! behaviour:
//!
//! ```text
//! export MIRIFLAGS="-Zmiri-tree-borrows -Zmiri-permissive-provenance -Zmiri-ignore-leaks"
//! cargo +nightly miri test -p whitstone-accelerators --test small
//! ```

use std::sync::Arc;
use whitstone_accelerators::bvh::Bvh;
use whitstone_core::{Accelerators, DVec3, Geometry, LoweredShape, Shapes, Transform, TriangleMesh};
use whitstone_shapes::plane::Plane;
use whitstone_shapes::sphere::Sphere;
use whitstone_testkit::{accelerator_agrees, build};

/// More triangles than one node holds, in four of five cases with numbers that are no single
/// precision ones.
fn mesh() -> TriangleMesh {
    let mut mesh = TriangleMesh {
        orientation: 1.0,
        ..TriangleMesh::default()
    };
    // Roberts' sequence: no two are near each other.
    let part = |i: u32, step: f64| (step * f64::from(i)).fract() - 0.5;
    for i in 0..if cfg!(miri) { 24 } else { 80 } {
        let at = |i| DVec3::new(part(i, 0.819_172), part(i, 0.671_043), part(i, 0.549_700));
        let center = 2.0 * at(i);
        let corners = [1, 2, 3].map(|k| center + 0.4 * at(7 * i + k));
        mesh.positions.extend(corners);
        mesh.triangles.push([3 * i, 3 * i + 1, 3 * i + 2]);
    }
    mesh
}

#[test]
fn a_small_world_agrees_with_trying_everything() {
    let ball = |text| build::<Shapes, Sphere>(text, Transform::IDENTITY).expect("it is a sphere");
    let wall = build::<Shapes, Plane>("", Transform::IDENTITY).expect("it is a plane");
    let mut exact = mesh();
    for p in &mut exact.positions {
        *p = p.as_vec3().as_dvec3();
    }
    let worlds = [
        vec![LoweredShape::Triangles(exact)],
        vec![
            LoweredShape::Triangles(mesh()),
            ball("center = [0.1, 0.2, 0.3]\nradius = 0.3"),
            ball("center = [-0.4, 0.1, 0.0]\nradius = 0.2"),
            wall,
        ],
    ];
    for shapes in worlds {
        let geometry = Arc::new(Geometry::new(shapes));
        for text in ["quality = \"fast\"", "quality = \"best\""] {
            let bvh = build::<Accelerators, Bvh>(text, geometry.clone()).expect("it is a hierarchy");
            // Single rays and streams.
            let rays: &[u32] = if cfg!(miri) { &[4] } else { &[4, 12, 600] };
            for &rays in rays {
                accelerator_agrees(&geometry, &*bvh, rays);
            }
        }
    }
}
