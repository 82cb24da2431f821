//! Nanoseconds per ray where a mesh is tiny next to a triangle, or far from the origin of the
//! coordinates: a ball of 20,000 triangles of size 1, a triangle of size RATIO behind it, both
//! OFFSET from the origin. `chosen` is what `auto` chooses.
//!
//! ```text
//! cargo run --release -p whitstone-accelerators --example sizes
//! ```

use std::sync::Arc;
use std::time::Instant;
use whitstone_accelerators::{bvh::Bvh, bvh2::Bvh2, kdtree::KdTree, octree::Octree, slab_bvh::SlabBvh};
use whitstone_core::{
    Accelerator, Accelerators, DVec3, Geometry, Interval, LoweredShape, Plugin, Ray, Registry, SelfHitFilter,
};
use whitstone_testkit::{Random, build, tiny_ball};

fn main() {
    let mut registry = Registry::default();
    whitstone_accelerators::register(&mut registry).expect("the types are distinct");
    let cases = [
        (1e0, 0.0),
        (1e3, 0.0),
        (1e4, 0.0),
        (2e4, 0.0),
        (3e4, 0.0),
        (5e4, 0.0),
        (7e4, 0.0),
        (1e5, 0.0),
        (1e6, 0.0),
        (1e7, 0.0),
        (1e9, 0.0),
        (1e12, 0.0),
        (1e0, 1e6),
        (1e0, 1e9),
        (1e0, 1e12),
        (1e0, 1e13),
        (1e0, 1e14),
        (1e0, 1e15),
        (1e6, 1e12),
        (1e12, 1e12),
        (1e12, 1e6),
    ];
    println!("   ratio   offset      bvh     bvh2   kdtree slab_bvh   octree  chosen");
    for (ratio, offset) in cases {
        let geometry = Arc::new(Geometry::new(vec![LoweredShape::Triangles(tiny_ball(
            ratio, offset,
        ))]));
        let chosen = registry.automatic_accelerator(&geometry).expect("there is one").0;
        print!("{ratio:8.0e} {offset:8.0e}");
        for make in [
            made::<Bvh>,
            made::<Bvh2>,
            made::<KdTree>,
            made::<SlabBvh>,
            made::<Octree>,
        ] {
            print!(" {:8.0}", cost(&*make(&geometry), offset));
        }
        println!("  {chosen}");
    }
}

fn made<P: Plugin<Accelerators>>(geometry: &Arc<Geometry>) -> Box<dyn Accelerator> {
    build::<Accelerators, P>("", geometry.clone()).expect("it builds")
}

/// Nanoseconds per ray: the best of some rounds.
fn cost(accelerator: &dyn Accelerator, offset: f64) -> f64 {
    let mut random = Random::new(1);
    let rays: Vec<Ray> = (0..200)
        .map(|_| {
            let origin = DVec3::splat(offset) + 3.0 * random.direction();
            Ray::new(origin, DVec3::splat(offset) + 0.7 * random.cube() - origin)
        })
        .collect();
    let round = || {
        let start = Instant::now();
        let trace = |ray: &&Ray| {
            accelerator
                .intersect(ray, Interval::FORWARD, SelfHitFilter::NOTHING)
                .is_some()
        };
        std::hint::black_box(rays.iter().filter(trace).count());
        start.elapsed().as_secs_f64() / rays.len() as f64 * 1e9
    };
    let first = round();
    let rounds = if first > 1e5 { 1 } else { 20 };
    (0..rounds).map(|_| round()).fold(first, f64::min)
}
