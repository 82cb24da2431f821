//! The cost that structures report (`sah_cost`): the sum over their cells, and the work of random
//! rays.

use std::sync::Arc;
use whitstone_accelerators::bvh2::Bvh2;
use whitstone_accelerators::grid::Grid;
use whitstone_accelerators::octree::Octree;
use whitstone_core::{
    Aabb, Accelerator, Accelerators, DVec3, Geometry, Interval, LoweredShape, Plugin, Ray, SelfHitFilter,
    TriangleMesh,
};
use whitstone_testkit::{Random, build};

/// Triangles of the size of points, so that each lies in one cell, most of them in one corner.
fn points(count: u32) -> Arc<Geometry> {
    let mut random = Random::new(7);
    let mut mesh = TriangleMesh {
        orientation: 1.0,
        ..TriangleMesh::default()
    };
    for i in 0..count {
        let at = DVec3::new(3.0, 2.0, 1.0) * DVec3::from_array([(); 3].map(|()| random.unit().powi(2)));
        let corners = [(); 3].map(|()| at + 1e-9 * random.cube());
        mesh.positions.extend(corners);
        mesh.triangles.push([3 * i, 3 * i + 1, 3 * i + 2]);
    }
    Arc::new(Geometry::new(vec![LoweredShape::Triangles(mesh)]))
}

fn made<P: Plugin<Accelerators>>(text: &str, geometry: &Arc<Geometry>) -> Box<dyn Accelerator> {
    build::<Accelerators, P>(text, geometry.clone()).expect("it builds")
}

fn positions(geometry: &Geometry) -> &[DVec3] {
    match &geometry.shapes()[0] {
        LoweredShape::Triangles(mesh) => &mesh.positions,
        _ => panic!("it is a mesh"),
    }
}

/// The boxes of all levels, with their level.
fn boxes(accelerator: &dyn Accelerator) -> Vec<(usize, Aabb)> {
    let bounds = accelerator.debug_bounds(usize::MAX).expect("it has boxes");
    let around = |bounds: &whitstone_core::DebugBounds| {
        (
            bounds.depth,
            Aabb::around(bounds.segments.iter().copied().flatten()),
        )
    };
    bounds.iter().map(around).collect()
}

fn statistic(accelerator: &dyn Accelerator, name: &str) -> f64 {
    accelerator.statistics()[name]
}

/// Number of triangles whose first corner lies in a box.
fn held(geometry: &Geometry, aabb: &Aabb) -> f64 {
    let inside = |p: &&DVec3| p.cmpge(aabb.min).all() && p.cmple(aabb.max).all();
    positions(geometry).iter().step_by(3).filter(inside).count() as f64
}

#[test]
fn the_cost_of_a_grid_is_the_sum_over_its_cells() {
    for count in [2, 50] {
        let geometry = points(count);
        let grid = made::<Grid>("", &geometry);
        let [(_, whole), occupied @ ..] = &boxes(&*grid)[..] else {
            panic!("the whole grid comes first");
        };
        let area = occupied[0].1.half_area() / whole.half_area();
        let tests: f64 = occupied.iter().map(|(_, cell)| held(&geometry, cell)).sum();
        assert_eq!(tests, f64::from(count));
        let expected = area * (0.5 * statistic(&*grid, "cells") + tests);
        let found = statistic(&*grid, "sah_cost");
        assert!(
            (found / expected - 1.0).abs() < 1e-9,
            "{count}: {found} {expected}"
        );
    }
}

#[test]
fn the_cost_of_an_octree_is_the_sum_over_its_nodes() {
    let geometry = points(200);
    let tree = made::<Octree>("", &geometry);
    let all = Aabb::around(positions(&geometry).iter().copied());
    let nodes = boxes(&*tree);
    // In depth-first order a node with children comes right before the first of them.
    let inner = |i: usize| nodes.get(i + 1).is_some_and(|(depth, _)| *depth > nodes[i].0);
    let cost = |(i, (_, node)): (usize, &(usize, Aabb))| {
        let crossed = Aabb {
            min: node.min.max(all.min),
            max: node.max.min(all.max),
        };
        let unit = if inner(i) { 2.0 } else { held(&geometry, node) };
        let empty = crossed.min.cmpgt(crossed.max).any();
        if empty { 0.0 } else { unit * crossed.half_area() }
    };
    let expected = nodes.iter().enumerate().map(cost).sum::<f64>() / all.half_area();
    let found = statistic(&*tree, "sah_cost");
    assert!(statistic(&*tree, "depth") > 2.0);
    assert!((found / expected - 1.0).abs() < 1e-6, "{found} {expected}");
}

/// The model promises the mean over uniformly distributed rays. It is measured.
#[test]
fn the_cost_is_the_mean_work_of_random_rays() {
    let geometry = points(150);
    let all = Aabb::around(positions(&geometry).iter().copied());
    let radius = 0.5 * all.extent().length();
    let mut random = Random::new(19);
    let mut rays = Vec::new();
    while rays.len() < 60_000 {
        // Lines through a ball are uniform if their directions are and they cross its great disk
        // uniformly.
        let direction = random.direction();
        let across = direction.any_orthonormal_vector();
        let (x, y) = (random.signed(), random.signed());
        if x * x + y * y > 1.0 {
            continue;
        }
        let beside = radius * (x * across + y * across.cross(direction));
        let ray = Ray::new(all.center() + beside - 2.0 * radius * direction, direction);
        let (mut near, mut far) = (f64::NEG_INFINITY, f64::INFINITY);
        for axis in 0..3 {
            let [a, b] = [all.min, all.max].map(|plane| (plane[axis] - ray.origin[axis]) / direction[axis]);
            (near, far) = (near.max(a.min(b)), far.min(a.max(b)));
        }
        if near <= far {
            rays.push(ray);
        }
    }
    for (name, step, accelerator) in [
        ("grid", 0.5, made::<Grid>("", &geometry)),
        ("grid of two levels", 0.5, made::<Grid>("levels = 2", &geometry)),
        ("octree", 2.0, made::<Octree>("", &geometry)),
        ("bvh2", 0.7, made::<Bvh2>("", &geometry)),
    ] {
        let work = |ray: &Ray| {
            let counted = accelerator
                .traversal_statistics(ray, Interval::FORWARD, SelfHitFilter::NOTHING)
                .expect("it counts");
            step * counted.steps as f64 + counted.tests as f64
        };
        let mean = rays.iter().map(work).sum::<f64>() / rays.len() as f64;
        let promised = statistic(&*accelerator, "sah_cost");
        assert!((mean / promised - 1.0).abs() < 0.015, "{name}: {mean} {promised}");
    }
}
