//! Degenerate input: every accelerator builds in bounded time and memory, and returns the same as
//! testing every element.

use std::sync::Arc;
use std::time::{Duration, Instant};
use whitstone_accelerators::{
    brute_force::BruteForce, bsp::Bsp, bvh::Bvh, bvh2::Bvh2, grid::Grid, kdtree::KdTree, obb_bvh::ObbBvh,
    octree::Octree, slab_bvh::SlabBvh,
};
use whitstone_core::{
    Aabb, Accelerator, Accelerators, DVec2, DVec3, Geometry, Interval, LoweredShape, Plugin,
    PreliminaryIntersection, Ray, SelfHitFilter, Shape, ShapeHit, SurfaceAttributes, SurfaceInteraction,
    TriangleMesh,
};
use whitstone_testkit::{Random, build, random_rays};

type Make = fn(&str, Arc<Geometry>) -> Box<dyn Accelerator>;

fn make<P: Plugin<Accelerators>>(text: &str, geometry: Arc<Geometry>) -> Box<dyn Accelerator> {
    build::<Accelerators, P>(text, geometry).unwrap_or_else(|error| panic!("{}: {error}", P::TYPE))
}

const CONFIGURATIONS: [(&str, Make, &str); 16] = [
    ("bvh", make::<Bvh>, "quality = \"fast\""),
    ("bvh", make::<Bvh>, "quality = \"balanced\""),
    ("bvh", make::<Bvh>, "quality = \"best\""),
    ("bvh2", make::<Bvh2>, ""),
    ("bvh2", make::<Bvh2>, "split = \"midpoint\""),
    ("bvh2", make::<Bvh2>, "split = \"between\""),
    ("kdtree", make::<KdTree>, ""),
    ("kdtree", make::<KdTree>, "split = \"median\""),
    ("kdtree", make::<KdTree>, "split = \"between\""),
    ("grid", make::<Grid>, ""),
    ("grid", make::<Grid>, "levels = 2"),
    ("octree", make::<Octree>, ""),
    ("slab_bvh", make::<SlabBvh>, ""),
    ("obb_bvh", make::<ObbBvh>, ""),
    ("bsp", make::<Bsp>, ""),
    ("bsp", make::<Bsp>, "split = \"between\""),
];

/// Bytes per element: more than any structure needs for any of these inputs.
const MAX_BYTES: f64 = 256.0;

/// Far more than any build needs, and far less than quadratic growth would take.
const MAX_TIME: Duration = Duration::from_secs(300);

fn mesh(positions: Vec<DVec3>, triangles: Vec<[u32; 3]>) -> LoweredShape {
    LoweredShape::Triangles(TriangleMesh {
        positions,
        triangles,
        orientation: 1.0,
        ..TriangleMesh::default()
    })
}

fn separate(positions: Vec<DVec3>) -> LoweredShape {
    let triangles = (0..positions.len() as u32 / 3).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]);
    let triangles = triangles.collect();
    mesh(positions, triangles)
}

/// Builds every accelerator over a geometry and checks its build time, memory and results.
fn all_take(name: &str, shapes: Vec<LoweredShape>, rays: u64) {
    let geometry = Arc::new(Geometry::new(shapes));
    let count = geometry.elements().count().max(64) as f64;
    let everything = make::<BruteForce>("", geometry.clone());
    let intersect = |accelerator: &dyn Accelerator, ray: &Ray| {
        let hit = accelerator.intersect(ray, Interval::FORWARD, SelfHitFilter::NOTHING);
        hit.map(|hit| (hit.id(), hit.t.to_bits()))
    };
    let expected: Vec<_> = random_rays(&geometry, rays, 5)
        .map(|ray| (ray, intersect(&*everything, &ray)))
        .collect();
    for (kind, make, text) in CONFIGURATIONS {
        let start = Instant::now();
        let accelerator = make(text, geometry.clone());
        let time = start.elapsed();
        let bytes = accelerator.statistics()["bytes"] / count;
        println!("{name}: {kind} {text}: {time:.2?}, {bytes:.1} bytes an element");
        assert!(time < MAX_TIME, "{name}: {kind} with \"{text}\" took {time:?}");
        assert!(
            bytes < MAX_BYTES,
            "{name}: {kind} with \"{text}\" takes {bytes} bytes an element"
        );
        for (ray, expected) in &expected {
            let found = intersect(&*accelerator, ray);
            assert_eq!(found, *expected, "{name}: {kind} with \"{text}\", {ray:?}");
        }
    }
}

#[test]
fn nothing_and_one_primitive() {
    all_take("nothing", vec![], 100);
    let corners = vec![DVec3::ZERO, DVec3::X, DVec3::Y];
    all_take("one triangle", vec![separate(corners)], 1000);
}

#[test]
fn a_million_triangles_in_one_place() {
    let corners = vec![DVec3::ZERO, DVec3::X, DVec3::Y];
    all_take("one place", vec![mesh(corners, vec![[0, 1, 2]; 1_000_000])], 3);
}

#[test]
fn many_points() {
    // Each triangle is smaller than the padding of a ray, and no two are in the same place.
    let mut random = Random::new(1);
    let corners = (0..200_000).flat_map(|_| {
        let p = 1e-14 * random.cube();
        [p, p + 1e-15 * DVec3::X, p + 1e-15 * DVec3::Y]
    });
    let far = [DVec3::ONE, DVec3::ONE + DVec3::X, DVec3::ONE + DVec3::Y];
    all_take("points", vec![separate(corners.chain(far).collect())], 3);
}

#[test]
fn all_in_one_plane() {
    let mut random = Random::new(2);
    for axis in [DVec3::X, DVec3::Y, DVec3::Z] {
        let (u, v) = axis.any_orthonormal_pair();
        let corners = (0..60_000).flat_map(|_| {
            let center = random.signed() * u + random.signed() * v;
            [0; 3].map(|_| center + 0.01 * (random.signed() * u + random.signed() * v) + 0.5 * axis)
        });
        all_take("one plane", vec![separate(corners.collect())], 70);
    }
}

#[test]
fn sizes_of_a_millionth_within_a_million() {
    let mut random = Random::new(3);
    let corners = (0..30_000).flat_map(|i| {
        let size = [1e-6, 1.0, 1e6][i % 3];
        let center = [1.0, 1e3, 1e6][i / 3 % 3] * random.cube();
        [0; 3].map(|_| center + 0.1 * size * random.cube())
    });
    all_take("sizes", vec![separate(corners.collect())], 700);
}

/// A shape with the given bounds that every ray hits at t = 1.
struct Odd(Aabb);

impl Shape for Odd {
    fn bounds(&self) -> Aabb {
        self.0
    }

    fn intersect(&self, _: &Ray, interval: Interval, _: Option<u32>) -> Option<ShapeHit> {
        interval.contains(1.0).then_some(ShapeHit {
            t: 1.0,
            primitive: 0,
            prim_uv: DVec2::ZERO,
        })
    }

    fn surface(&self, ray: &Ray, hit: &PreliminaryIntersection, _: SurfaceAttributes) -> SurfaceInteraction {
        SurfaceInteraction::new(ray.at(hit.t), 0.0, DVec3::Z)
    }
}

#[test]
fn bounds_that_are_no_numbers_or_endless() {
    let aabb = |min: f64, max: f64| Aabb {
        min: DVec3::splat(min),
        max: DVec3::splat(max),
    };
    let half = Aabb {
        min: DVec3::ZERO,
        max: DVec3::new(1.0, f64::INFINITY, 1.0),
    };
    let partly = Aabb {
        min: DVec3::new(0.0, f64::NAN, 0.0),
        max: DVec3::ONE,
    };
    let (huge, endless) = (f64::MAX, f64::INFINITY);
    for bounds in [
        aabb(f64::NAN, f64::NAN),
        aabb(-endless, endless),
        aabb(-huge, huge),
        half,
        partly,
        Aabb::EMPTY,
    ] {
        let mut random = Random::new(4);
        let corners = (0..900).map(|_| 3.0 * random.cube()).collect();
        let odd = LoweredShape::Custom(Box::new(Odd(bounds)));
        all_take(&format!("{bounds:?}"), vec![separate(corners), odd], 200);
    }
}

#[test]
fn corners_that_are_no_numbers_or_endless() {
    let mut random = Random::new(6);
    let odd = [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 1e200, f64::MAX];
    let corners = (0..3000).map(|i| {
        let mut p = random.cube();
        if i % 10 == 0 {
            p[random.below(3)] = odd[random.below(5)];
        }
        p
    });
    all_take("odd corners", vec![separate(corners.collect())], 200);
}
