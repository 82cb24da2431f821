//! Identity test: in every configuration, each accelerator returns, bit for bit, the result of
//! testing every element.
//!
//! It traces a million rays through twenty random scenes of mixed shapes. `cargo test --release -p
//! whitstone-accelerators --test identity --
//! --ignored` traces ten million, or any number given by the variable `WHITSTONE_RAYS`.

use std::fmt::Debug;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use whitstone_accelerators::{
    brute_force::BruteForce, bsp::Bsp, bvh::Bvh, bvh2::Bvh2, grid::Grid, kdtree::KdTree, obb_bvh::ObbBvh,
    octree::Octree, slab_bvh::SlabBvh,
};
use whitstone_core::{
    Accelerator, Accelerators, DAffine3, DMat3, DVec3, Geometry, Interval, LoweredShape, Plugin,
    PreliminaryIntersection, Ray, SelfHitFilter, Shapes, Statistics, Transform, TriangleMesh,
};
use whitstone_shapes::{
    cuboid::Cuboid, disk::Disk, plane::Plane, rectangle::Rectangle, sphere::Sphere, triangle::Triangle,
};
use whitstone_testkit::{Random, build, random_rays};

type Make = fn(&str, Arc<Geometry>) -> Box<dyn Accelerator>;

fn make<P: Plugin<Accelerators>>(text: &str, geometry: Arc<Geometry>) -> Box<dyn Accelerator> {
    build::<Accelerators, P>(text, geometry).unwrap_or_else(|error| panic!("{}: {error}", P::TYPE))
}

const CONFIGURATIONS: [(&str, Make, &str); 20] = [
    ("bvh", make::<Bvh>, "quality = \"fast\""),
    ("bvh", make::<Bvh>, "quality = \"balanced\""),
    ("bvh", make::<Bvh>, "quality = \"best\""),
    ("bvh2", make::<Bvh2>, ""),
    ("bvh2", make::<Bvh2>, "split = \"median\"\nmax_leaf = 1"),
    ("bvh2", make::<Bvh2>, "split = \"between\""),
    ("kdtree", make::<KdTree>, ""),
    ("kdtree", make::<KdTree>, "split = \"midpoint\""),
    ("kdtree", make::<KdTree>, "split = \"median\""),
    ("kdtree", make::<KdTree>, "split = \"between\""),
    ("grid", make::<Grid>, ""),
    ("grid", make::<Grid>, "levels = 2"),
    ("octree", make::<Octree>, ""),
    ("slab_bvh", make::<SlabBvh>, "planes = 6"),
    ("slab_bvh", make::<SlabBvh>, "planes = 14"),
    ("slab_bvh", make::<SlabBvh>, "planes = 26"),
    ("obb_bvh", make::<ObbBvh>, ""),
    ("bsp", make::<Bsp>, ""),
    ("bsp", make::<Bsp>, "split = \"median\""),
    ("bsp", make::<Bsp>, "split = \"between\""),
];

/// Number of scenes; they differ in the number, size, position and mixture of shapes.
const SCENES: u64 = 20;

#[test]
fn a_million_rays_over_mixed_shapes() {
    every_accelerator_agrees(1_000_000);
}

#[test]
#[ignore = "minutes: the same with ten times as many, or as many as WHITSTONE_RAYS says"]
fn ten_million_rays_over_mixed_shapes() {
    let rays = std::env::var("WHITSTONE_RAYS").ok();
    let rays = rays.map(|rays| rays.parse().expect("WHITSTONE_RAYS is a number"));
    every_accelerator_agrees(rays.unwrap_or(10_000_000));
}

fn all_over(geometry: &Arc<Geometry>) -> Vec<Named> {
    let made =
        |(name, make, text): (&'static str, Make, &'static str)| (name, text, make(text, geometry.clone()));
    CONFIGURATIONS.into_iter().map(made).collect()
}

fn every_accelerator_agrees(rays: u64) {
    let (next, hits) = (AtomicU64::new(0), AtomicU64::new(0));
    let threads = std::thread::available_parallelism().map_or(1, usize::from);
    std::thread::scope(|scope| {
        for _ in 0..threads {
            scope.spawn(|| {
                loop {
                    let number = next.fetch_add(1, Ordering::Relaxed);
                    if number >= SCENES {
                        return;
                    }
                    let geometry = Arc::new(scene(number));
                    match agree(&geometry, &all_over(&geometry), rays / SCENES, number) {
                        Ok(found) => hits.fetch_add(found, Ordering::Relaxed),
                        Err(difference) => panic!("{difference}"),
                    };
                }
            });
        }
    });
    let (hits, configurations) = (hits.into_inner(), CONFIGURATIONS.len());
    println!("{configurations} configurations agree on {rays} rays, of which {hits} hit");
    assert!(hits > rays / 4, "too few rays hit anything to say much: {hits}");
}

type Named = (&'static str, &'static str, Box<dyn Accelerator>);

/// Compares accelerators over a scene with testing every element. Returns how many rays hit, or the
/// first difference.
fn agree(geometry: &Arc<Geometry>, accelerators: &[Named], rays: u64, seed: u64) -> Result<u64, String> {
    let everything = make::<BruteForce>("", geometry.clone());
    let mut hits = 0;
    let mut skip = SelfHitFilter::NOTHING;
    for ray in random_rays(geometry, rays, seed) {
        let expected = everything.intersect(&ray, Interval::FORWARD, skip);
        hits += u64::from(expected.is_some());
        for (name, text, accelerator) in accelerators {
            let found = accelerator.intersect(&ray, Interval::FORWARD, skip);
            let hidden = accelerator.occluded(&ray, Interval::FORWARD, skip);
            if found.map(identity) != expected.map(identity) || hidden != expected.is_some() {
                return Err(format!(
                    "scene {seed}, {name} with \"{text}\", {ray:?}, {skip:?}: expected {expected:?}, found {found:?}, occluded {hidden}"
                ));
            }
        }
        // Sometimes the next ray starts from the primitive that was hit, which all must then skip.
        skip = expected
            .filter(|hit| hit.primitive % 2 == 1)
            .map_or(SelfHitFilter::NOTHING, |hit| SelfHitFilter::leaving(&hit));
    }
    Ok(hits)
}

fn identity(hit: PreliminaryIntersection) -> impl Debug + PartialEq {
    (
        hit.id(),
        hit.t.to_bits(),
        hit.prim_uv.to_array().map(f64::to_bits),
    )
}

/// From 10 to 320 shapes of all kinds; the meshes among them have up to 40 triangles.
fn scene(number: u64) -> Geometry {
    let mut random = Random::new(1000 + number);
    let count = 10 << (number % 6);
    // The more shapes, the smaller they are, so that not all rays end at once.
    let size = [1.0, 1e-3, 1e3, 1.0][number as usize % 4];
    let center = [DVec3::ZERO, 100.0 * size * random.direction()][number as usize / 2 % 2];
    let part = size * 1.5 / f64::from(count as u32).cbrt();
    let shapes = (0..count).map(|i| {
        // Many infinite planes would hide everything.
        let kind = if i == 0 && number.is_multiple_of(4) {
            6
        } else {
            random.below(6)
        };
        let place = |random: &mut Random, even: bool| placement(random, center, size, part, even);
        let shape = match kind {
            0 => build::<Shapes, Sphere>("", place(&mut random, true)),
            1 => build::<Shapes, Disk>("", place(&mut random, true)),
            2 => build::<Shapes, Cuboid>("", place(&mut random, false)),
            3 => build::<Shapes, Rectangle>("", place(&mut random, false)),
            4 => {
                let corners = "vertices = [[-1, -1, 0], [1, 0, 0], [0, 1, 0]]";
                build::<Shapes, Triangle>(corners, place(&mut random, false))
            }
            5 => {
                let place = place(&mut random, false);
                Ok(mesh(&mut random, &place))
            }
            _ => build::<Shapes, Plane>("", place(&mut random, true)),
        };
        shape.unwrap_or_else(|error| panic!("scene {number}: {error}"))
    });
    Geometry::new(shapes.collect())
}

/// A random placement near the center; every third is axis-parallel, so that faces lie in planes of
/// boxes.
fn placement(random: &mut Random, center: DVec3, size: f64, part: f64, even: bool) -> Transform {
    let turned = if random.below(3) == 0 {
        DMat3::IDENTITY
    } else {
        let x = random.direction();
        let (y, z) = x.any_orthonormal_pair();
        DMat3::from_cols(x, y, z)
    };
    let scale = DVec3::from_array([0; 3].map(|_| part * (0.1 + random.unit())));
    let scale = if even { DVec3::splat(scale.x) } else { scale };
    let transform = DAffine3 {
        matrix3: turned * DMat3::from_diagonal(scale),
        translation: center + size * random.cube(),
    };
    Transform::new(transform).unwrap_or(Transform::IDENTITY)
}

/// Triangles near one another; some are duplicates, some are thin.
fn mesh(random: &mut Random, place: &Transform) -> LoweredShape {
    let count = 1 + random.below(40);
    let mut positions = Vec::new();
    for i in 0..count {
        let [a, along, aside] = [random.cube(), random.cube(), random.cube()];
        let width = [1.0, 1e-3][random.below(2)];
        let corners = match positions.last_chunk::<3>() {
            Some(last) if i % 5 == 4 => *last,
            _ => [a, a + 0.5 * along, a + 0.5 * width * aside].map(|p| place.point_to_world(p)),
        };
        positions.extend(corners);
    }
    LoweredShape::Triangles(TriangleMesh {
        triangles: (0..count as u32).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect(),
        positions,
        orientation: 1.0,
        ..TriangleMesh::default()
    })
}

/// An accelerator that is wrong by one unit in the last place, once in `once_in` hits.
struct SeldomWrong {
    right: Box<dyn Accelerator>,
    hits: AtomicU64,
    once_in: u64,
}

impl Accelerator for SeldomWrong {
    fn intersect(
        &self,
        ray: &Ray,
        interval: Interval,
        skip: SelfHitFilter,
    ) -> Option<PreliminaryIntersection> {
        let mut hit = self.right.intersect(ray, interval, skip)?;
        if self.hits.fetch_add(1, Ordering::Relaxed) % self.once_in == self.once_in - 1 {
            hit.t = hit.t.next_up();
        }
        Some(hit)
    }

    fn occluded(&self, ray: &Ray, interval: Interval, skip: SelfHitFilter) -> bool {
        self.right.occluded(ray, interval, skip)
    }

    fn statistics(&self) -> Statistics {
        self.right.statistics()
    }
}

#[test]
fn one_wrong_hit_is_found() {
    let geometry = Arc::new(scene(3));
    let seldom_wrong = |once_in: u64| -> [Named; 1] {
        let wrong = SeldomWrong {
            right: make::<Bvh2>("", geometry.clone()),
            hits: AtomicU64::new(0),
            once_in,
        };
        [("seldom wrong", "", Box::new(wrong))]
    };
    let hits = agree(&geometry, &seldom_wrong(u64::MAX), 10_000, 3).expect("it is never wrong");
    assert!(agree(&geometry, &seldom_wrong(hits), 10_000, 3).is_err());
}
