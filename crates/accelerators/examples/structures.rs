//! Cost of a ray in each structure, on one thread, over a generated mesh: steps (inner nodes or
//! cells visited), element tests, and time compared with `bvh2` in the same run. The counts are the
//! same on every processor.
//!
//! ```text
//! cargo run --release -p whitstone-accelerators --example structures -- [TRIANGLES] [MESH] [NAME]
//! ```
//!
//! MESH is `ball` (bumpy, with compact, evenly spread triangles), `needles` (long, thin, slanted
//! triangles) or `stadium` (the ball inside one of 128 triangles that is a hundred times as large).
//! NAME keeps only the rows that contain it, and `bvh2`.

use std::sync::Arc;
use std::time::Instant;
use whitstone_accelerators::{
    brute_force::BruteForce, bsp::Bsp, bvh::Bvh, bvh2::Bvh2, grid::Grid, kdtree::KdTree, obb_bvh::ObbBvh,
    octree::Octree, slab_bvh::SlabBvh,
};
use whitstone_core::{
    Accelerator, Accelerators, DVec3, Geometry, Interval, LoweredShape, Plugin, Ray, SelfHitFilter,
    TraversalStatistics, TriangleMesh,
};
use whitstone_testkit::build;

fn main() {
    let mut arguments = std::env::args().skip(1);
    let triangles: usize = arguments.next().map_or(100_000, |n| n.parse().expect("a number"));
    let kind = arguments.next().unwrap_or_else(|| "ball".to_owned());
    let only = arguments.next().unwrap_or_default();
    let side = ((triangles / 2) as f64).sqrt() as usize;
    let mut shapes = vec![LoweredShape::Triangles(match kind.as_str() {
        "needles" => needles(triangles),
        _ => ball(side, DVec3::ZERO, 1.0),
    })];
    if kind == "stadium" {
        // The ball is the teapot in the stadium.
        shapes.push(LoweredShape::Triangles(ball(8, DVec3::ZERO, 100.0)));
    }
    let geometry = Arc::new(Geometry::new(shapes));
    println!("{kind}, {} triangles", geometry.elements().count());
    println!(
        "{:34} {:>8} {:>7} {:>7} {:>7} {:>8} {:>9} {:>7}",
        "", "build s", "B/tri", "steps", "tests", "ns/ray", "ns/shadow", "x bvh2"
    );
    let mut bvh2 = 1.0;
    let mut row = |accelerator: Box<dyn Accelerator>, name: &str| {
        if !name.contains(&only) && name != "bvh2" {
            return;
        }
        let statistics = accelerator.statistics();
        let (nearest, any) = cost(&*accelerator);
        if name == "bvh2" {
            bvh2 = nearest;
        }
        println!(
            "{name:34} {:8.3} {:7.1} {:>7} {:>7} {nearest:8.0} {any:9.0} {:7.2}",
            statistics.get("build_seconds").copied().unwrap_or(0.0),
            statistics["bytes"] / geometry.elements().count() as f64,
            traversal_statistics(&*accelerator, |effort| effort.steps),
            traversal_statistics(&*accelerator, |effort| effort.tests),
            nearest / bvh2
        );
    };
    fn made<P: Plugin<Accelerators>>(geometry: &Arc<Geometry>, text: &str) -> (Box<dyn Accelerator>, String) {
        let built = build::<Accelerators, P>(text, geometry.clone()).expect("it builds");
        (
            built,
            format!("{} {}", P::TYPE, text.replace('\n', " "))
                .trim()
                .to_owned(),
        )
    }
    let g = &geometry;
    for text in [
        "",
        "split = 'midpoint'",
        "split = 'median'",
        "split = 'between'",
        "axes = 'longest'",
    ] {
        let (built, name) = made::<Bvh2>(g, text);
        row(built, &name);
    }
    for text in ["width = 'eight'", "width = 'sixteen'"] {
        let (built, name) = made::<Bvh>(g, text);
        row(built, &name);
    }
    for text in ["", "split = 'midpoint'", "split = 'median'", "split = 'between'"] {
        let (built, name) = made::<KdTree>(g, text);
        row(built, &name);
    }
    for text in ["density = 2", "", "density = 8", "levels = 2"] {
        let (built, name) = made::<Grid>(g, text);
        row(built, &name);
    }
    for text in ["", "max_leaf = 4"] {
        let (built, name) = made::<Octree>(g, text);
        row(built, &name);
    }
    for text in ["planes = 6", "planes = 14", "planes = 26"] {
        let (built, name) = made::<SlabBvh>(g, text);
        row(built, &name);
    }
    for text in ["", "split = 'median'"] {
        let (built, name) = made::<ObbBvh>(g, text);
        row(built, &name);
    }
    for text in ["", "split = 'median'"] {
        let (built, name) = made::<Bsp>(g, text);
        row(built, &name);
    }
    if triangles <= 1000 {
        let (built, name) = made::<BruteForce>(g, "");
        row(built, &name);
    }
}

/// Rays from all around into the middle.
fn rays() -> Vec<Ray> {
    let mut random = random();
    let mut cube = || DVec3::new(random(), random(), random());
    let mut ray = || {
        let origin = 1.5 * cube();
        Ray::new(origin, (cube() - origin).normalize())
    };
    (0..4000).map(|_| ray()).collect()
}

/// Mean of a counter over all rays; "-" if the accelerator does not count.
fn traversal_statistics(accelerator: &dyn Accelerator, of: impl Fn(TraversalStatistics) -> u64) -> String {
    let rays = rays();
    let count = |ray: &Ray| {
        accelerator
            .traversal_statistics(ray, Interval::FORWARD, SelfHitFilter::NOTHING)
            .map(&of)
    };
    let sum: Option<u64> = rays.iter().map(count).sum();
    sum.map_or_else(
        || "-".to_owned(),
        |sum| format!("{:.1}", sum as f64 / rays.len() as f64),
    )
}

/// Nanoseconds per ray for nearest hits and for any hits: the best of some rounds.
fn cost(accelerator: &dyn Accelerator) -> (f64, f64) {
    let rays = rays();
    // The best of several rounds of few rays each, to reduce the effect of other load.
    let best = |trace: &dyn Fn(&Ray) -> bool| {
        let chunks = rays.chunks(500).map(|rays| {
            let rounds = (0..8).map(|_| {
                let start = Instant::now();
                std::hint::black_box(rays.iter().filter(|ray| trace(ray)).count());
                start.elapsed().as_secs_f64()
            });
            rounds.fold(f64::INFINITY, f64::min)
        });
        chunks.sum::<f64>() / rays.len() as f64 * 1e9
    };
    (
        best(&|ray| {
            accelerator
                .intersect(ray, Interval::FORWARD, SelfHitFilter::NOTHING)
                .is_some()
        }),
        best(&|ray| accelerator.occluded(ray, Interval::up_to(1.0), SelfHitFilter::NOTHING)),
    )
}

/// A reproducible sequence of numbers from -1 to 1.
fn random() -> impl FnMut() -> f64 {
    let mut state = 1u64;
    move || {
        state = state
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (state >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    }
}

/// A bumpy ball of 2 n² triangles.
fn ball(n: usize, center: DVec3, radius: f64) -> TriangleMesh {
    let at = |i: usize, j: usize| {
        let theta = std::f64::consts::PI * (i as f64 + 0.01) / (n as f64 + 0.02);
        let phi = std::f64::consts::TAU * (j % n) as f64 / n as f64;
        let bumps = 1.0 + 0.1 * (9.0 * theta).sin() * (7.0 * phi).sin();
        let (s, c) = theta.sin_cos();
        center + radius * bumps * DVec3::new(s * phi.cos(), c, s * phi.sin())
    };
    let corners = (0..n * n).flat_map(|k| {
        let (i, j) = (k / n, k % n);
        let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
        [a, b, c, a, c, d]
    });
    mesh(corners.collect())
}

/// Slanted hairs.
fn needles(count: usize) -> TriangleMesh {
    let mut random = random();
    let mut cube = move || DVec3::new(random(), random(), random());
    let corners = (0..count).flat_map(|_| {
        let (start, along) = (cube(), 0.1 * (DVec3::ONE + 0.2 * cube()));
        [start, start + along, start + 0.5 * along + 0.002 * cube()]
    });
    mesh(corners.collect())
}

fn mesh(positions: Vec<DVec3>) -> TriangleMesh {
    TriangleMesh {
        triangles: (0..positions.len() as u32 / 3)
            .map(|i| [3 * i, 3 * i + 1, 3 * i + 2])
            .collect(),
        positions,
        orientation: 1.0,
        ..TriangleMesh::default()
    }
}
