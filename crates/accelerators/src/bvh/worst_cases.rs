//! Counts for geometry that is hard for boxes: elements that are tiny next to others, or far from
//! the origin of the coordinates.

use super::{Bvh, Quality};
use crate::bvh2::Bvh2;
use crate::support::leaves::child::Kind;
use std::sync::Arc;
use whitstone_core::{
    Accelerator, Accelerators, DVec3, Geometry, Interval, LoweredShape, Ray, Registry, SelfHitFilter,
};
use whitstone_simd::Level;
use whitstone_testkit::{Random, accelerator_agrees, build, tiny_ball};

/// The ratio of the sizes, and the offset in sizes of the ball.
const CASES: [(f64, f64); 14] = [
    (1e0, 0.0),
    (1e4, 0.0),
    (1e5, 0.0),
    (1e6, 0.0),
    (1e7, 0.0),
    (1e9, 0.0),
    (1e12, 0.0),
    (1e0, 1e6),
    (1e0, 1e12),
    (1e0, 1e15),
    (1e6, 1e6),
    (1e6, 1e12),
    (1e12, 1e6),
    (1e12, 1e12),
];

fn scene(ratio: f64, offset: f64) -> Arc<Geometry> {
    Arc::new(Geometry::new(vec![LoweredShape::Triangles(tiny_ball(
        ratio, offset,
    ))]))
}

/// Rays from around the ball to points inside it.
fn rays(offset: f64) -> Vec<Ray> {
    let mut random = Random::new(1);
    let ray = |_| {
        let origin = DVec3::splat(offset) + 3.0 * random.direction();
        let to = DVec3::splat(offset) + 0.3 * random.cube();
        Ray::new(origin, to - origin)
    };
    (0..100).map(ray).collect()
}

/// The nodes, and the elements of leaves, that a ray visits if it is not shortened by hits.
fn visited(bvh: &Bvh, ray: &Ray) -> usize {
    let Some(local) = bvh.leaves().frame.ray(ray, &Interval::FORWARD) else {
        return bvh.leaves().slots.len();
    };
    let mut open: Vec<_> = bvh.root().into_iter().collect();
    let mut count = 0;
    while let Some(child) = open.pop() {
        let node = match child.kind() {
            Kind::Inner(node) => node,
            Kind::Triangles(_, elements) | Kind::Mixed(_, elements) => {
                count += elements;
                continue;
            }
        };
        count += 1;
        for (child, corners) in bvh.children(node) {
            let (mut near, mut far) = (local.min, local.max);
            for axis in 0..3 {
                let side = local.side(axis);
                let plane = |side: usize| corners[side][axis] as f32;
                near = near.max(plane(side) * local.reciprocal[axis] + local.near[axis]);
                far = far.min(plane(1 - side) * local.reciprocal[axis] + local.far[axis]);
            }
            if near <= far {
                open.push(child);
            }
        }
    }
    count
}

/// The mean cost of a ray in the accelerator that is chosen for the scene.
fn cost_of_choice(ratio: f64, offset: f64) -> (String, f64) {
    let geometry = scene(ratio, offset);
    let mut registry = Registry::default();
    crate::register(&mut registry).unwrap();
    let (name, _) = registry.automatic_accelerator(&geometry).unwrap();
    let rays = rays(offset);
    let count: usize = match name.as_str() {
        "bvh" => {
            let count = |quality: Quality| -> usize {
                let bvh = Bvh::new(geometry.clone(), quality, Level::current());
                rays.iter().map(|ray| visited(&bvh, ray)).sum()
            };
            count(Quality::Balanced).max(count(Quality::Auto))
        }
        "bvh2" => {
            let bvh2 = build::<Accelerators, Bvh2>("", geometry).unwrap();
            let effort = |ray| bvh2.traversal_statistics(ray, Interval::FORWARD, SelfHitFilter::NOTHING);
            let all = rays.iter().filter_map(effort);
            all.map(|effort| (effort.steps + effort.tests) as usize).sum()
        }
        other => panic!("{other}"),
    };
    (name, count as f64 / rays.len() as f64)
}

#[test]
fn no_ratio_of_sizes_and_no_offset_makes_the_automatic_choice_slow() {
    let found: Vec<_> = CASES
        .iter()
        .map(|&(ratio, offset)| (ratio, offset, cost_of_choice(ratio, offset)))
        .collect();
    assert!(found.iter().all(|(_, _, (_, cost))| *cost < 200.0), "{found:?}");
    assert_eq!(found[0].2.0, "bvh");
    assert_eq!(found[3].2.0, "bvh2");
}

/// Elements in one cell of the grid of the fast build.
#[test]
fn a_fast_build_is_given_up_where_it_would_be_slow() {
    let nodes = |geometry: &Arc<Geometry>, quality: Quality| {
        let bvh = Bvh::new(geometry.clone(), quality, Level::current());
        bvh.statistics()["nodes"]
    };
    let even = scene(1e0, 0.0);
    let [auto, fast, balanced] =
        [Quality::Auto, Quality::Fast, Quality::Balanced].map(|quality| nodes(&even, quality));
    assert!(auto == fast && fast != balanced, "{auto} {fast} {balanced}");
    let uneven = scene(1e4, 0.0);
    let [auto, fast, balanced] =
        [Quality::Auto, Quality::Fast, Quality::Balanced].map(|quality| nodes(&uneven, quality));
    assert!(auto == balanced && fast != balanced, "{auto} {fast} {balanced}");
}

/// What the choice avoids.
#[test]
fn single_precision_boxes_of_tiny_elements_do_not_help() {
    let bvh = Bvh::new(scene(1e7, 0.0), Quality::Balanced, Level::current());
    let count: usize = rays(0.0).iter().map(|ray| visited(&bvh, ray)).sum();
    assert!(count > 100 * 10_000, "{count}");
}

#[test]
fn hits_in_hard_geometry_are_those_of_testing_every_element() {
    for (ratio, offset) in CASES {
        let geometry = scene(ratio, offset);
        accelerator_agrees(
            &geometry,
            &Bvh::new(geometry.clone(), Quality::Balanced, Level::current()),
            28,
        );
        let bvh2 = build::<Accelerators, Bvh2>("", geometry.clone()).unwrap();
        accelerator_agrees(&geometry, &*bvh2, 28);
        for ray in rays(offset).iter().take(20) {
            let hit = |accelerator: &dyn Accelerator| {
                accelerator
                    .intersect(ray, Interval::FORWARD, SelfHitFilter::NOTHING)
                    .map(|hit| (hit.t.to_bits(), hit.primitive))
            };
            let brute = build::<Accelerators, crate::brute_force::BruteForce>("", geometry.clone()).unwrap();
            assert_eq!(hit(&*bvh2), hit(&*brute), "{ratio:e}, {offset:e}, {ray:?}");
        }
    }
}
