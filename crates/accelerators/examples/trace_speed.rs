//! Measures the default BVH on a mesh, in millions of rays a second on one thread, and checks that
//! it agrees with testing every triangle:
//!
//! ```text
//! cargo run --release -p whitstone-accelerators --example trace_speed -- MESH [RAYS_TO_COMPARE]
//! ```

use std::sync::Arc;
use std::time::Instant;
use whitstone_accelerators::brute_force::BruteForce;
use whitstone_accelerators::bvh::Bvh;
use whitstone_core::{
    Aabb, Accelerator, Accelerators, DVec3, Geometry, Interval, PreliminaryIntersection, Ray, SelfHitFilter,
    Shapes, Transform,
};
use whitstone_shapes::mesh::Mesh;
use whitstone_testkit::build;

fn main() {
    let mut arguments = std::env::args().skip(1);
    let file = arguments.next().expect("the first argument is a mesh file");
    let compared: usize = arguments
        .next()
        .map_or(0, |n| n.parse().expect("the second is a number"));

    let start = Instant::now();
    let shape = build::<Shapes, Mesh>(&format!("file = '{file}'"), Transform::IDENTITY).unwrap();
    println!("read in {:.3} s", start.elapsed().as_secs_f64());
    let geometry = Arc::new(Geometry::new(vec![shape]));
    let bvh = build::<Accelerators, Bvh>("", geometry.clone()).unwrap();
    println!("{:?}", bvh.statistics());

    let elements = geometry.elements().map(|element| geometry.bounds(element));
    let bounds = elements.fold(Aabb::EMPTY, Aabb::union);
    for (name, rays) in [("picture", picture(&bounds)), ("random", random(&bounds))] {
        let intersect = |accelerator: &dyn Accelerator, ray: &Ray| {
            accelerator.intersect(ray, Interval::FORWARD, SelfHitFilter::NOTHING)
        };
        let best = |trace: &dyn Fn(&Ray) -> bool| {
            let seconds = (0..5).map(|_| {
                let start = Instant::now();
                let hits = rays.iter().filter(|ray| trace(ray)).count();
                (start.elapsed().as_secs_f64(), hits)
            });
            seconds.min_by(|a, b| a.0.total_cmp(&b.0)).unwrap()
        };
        let million = rays.len() as f64 / 1e6;
        let (seconds, hits) = best(&|ray| intersect(&*bvh, ray).is_some());
        println!(
            "{name}: closest {:.2} Mrays/s, {hits} of {} hit",
            million / seconds,
            rays.len()
        );
        let (seconds, hits) = best(&|ray| bvh.occluded(ray, Interval::FORWARD, SelfHitFilter::NOTHING));
        println!("{name}: occluded {:.2} Mrays/s, {hits} hit", million / seconds);

        if let Some(stride) = rays.len().checked_div(compared) {
            let all = build::<Accelerators, BruteForce>("", geometry.clone()).unwrap();
            let bits = |hit: PreliminaryIntersection| {
                (
                    hit.t.to_bits(),
                    hit.prim_uv.to_array().map(f64::to_bits),
                    hit.id(),
                )
            };
            let start = Instant::now();
            let mut count = 0;
            for ray in rays.iter().step_by(stride.max(1)) {
                let (expected, found) = (intersect(&*all, ray), intersect(&*bvh, ray));
                assert_eq!(expected.map(bits), found.map(bits), "{ray:?}");
                count += 1;
            }
            let seconds = start.elapsed().as_secs_f64();
            println!("{name}: {count} rays agree bit for bit with trying everything ({seconds:.1} s)");
        }
    }
}

/// Camera rays for an image of the whole mesh, 1024 x 1024 pixels.
fn picture(bounds: &Aabb) -> Vec<Ray> {
    let size = bounds.extent().max_element();
    let eye = bounds.center() + size * DVec3::new(0.3, 0.4, 1.6);
    let w = (eye - bounds.center()).normalize();
    let u = DVec3::Y.cross(w).normalize();
    let v = w.cross(u);
    let along = |i: usize| (i as f64 + 0.5) / 1024.0 - 0.5;
    let pixels = (0..1024 * 1024).map(|i| (along(i % 1024), along(i / 1024)));
    pixels
        .map(|(x, y)| Ray::new(eye, (0.7 * x * u + 0.7 * y * v - w).normalize()))
        .collect()
}

/// Incoherent rays, from a box three times as large as the mesh's bounds to points in the bounds.
fn random(bounds: &Aabb) -> Vec<Ray> {
    let mut state = 1u64;
    let mut unit = move || {
        state = state
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (state >> 11) as f64 / (1u64 << 53) as f64
    };
    let mut cube = move || DVec3::new(unit(), unit(), unit()) - 0.5;
    let mut point = move |scale: f64| bounds.center() + scale * bounds.extent() * cube();
    let mut ray = move || {
        let origin = point(3.0);
        Ray::new(origin, (point(1.0) - origin).normalize())
    };
    (0..1 << 20).map(|_| ray()).collect()
}
