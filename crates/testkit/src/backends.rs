//! Laws of third-party accelerators in single precision (backends): they differ from ours by
//! rounding and declare it.

use crate::ball::Ball;
use crate::random::Random;
use crate::shapes::same_bits;
use crate::streams::accelerator_streams;
use crate::{Wall, build};
use std::sync::Arc;
use whitstone_core::triangle::ShearedRay;
use whitstone_core::{
    Accelerator, Accelerators, DVec3, Geometry, Interval, LoweredShape, Plugin, PreliminaryIntersection, Ray,
    SelfHitFilter, TriangleMesh,
};

/// Number of test rays. One in 500 may hit another primitive: those that pass an edge within
/// rounding.
const RAYS: u32 = 20_000;
const MAX_OTHERS: u32 = RAYS / 500;

/// Tolerance of distances, relative to the size of the scene and the distance of the ray's origin.
const CLOSE: f64 = 2e-5;

/// Checks that a backend finds, within single precision, the results of testing every element in
/// double precision, over triangles of two meshes, balls and an unbounded wall; for elements other
/// than triangles the results must be exact. The backend never reports the skipped primitive or a
/// hit outside the interval, its streams agree bit for bit with its single rays, and it declares
/// that images depend on it.
///
/// # Panics
///
/// If it cannot be built or breaks a law; the message says how.
pub fn backend_laws<P: Plugin<Accelerators>>(text: &str) {
    for (name, shapes) in geometries() {
        let geometry = Arc::new(Geometry::new(shapes));
        let accelerator = match build::<Accelerators, P>(text, geometry.clone()) {
            Ok(accelerator) => accelerator,
            Err(error) => panic!("{}: {error}", P::TYPE),
        };
        let broken = backend_agrees(&geometry, &*accelerator);
        assert_eq!(broken.err(), None, "{} with \"{text}\" over {name}", P::TYPE);
    }
}

/// Checks a built accelerator against the laws of [`backend_laws`].
///
/// # Errors
///
/// The first law that is broken.
pub fn backend_agrees(geometry: &Geometry, accelerator: &dyn Accelerator) -> Result<(), String> {
    if accelerator.approximation_note().is_none() {
        return Err("it does not declare that images depend on it".to_owned());
    }
    let mut random = Random::new(7);
    let (mut others, mut queries, mut skip) = (0, Vec::new(), SelfHitFilter::NOTHING);
    let mut start = 2.0 * random.cube();
    for _ in 0..RAYS {
        let ray = Ray::new(start, (random.cube() - start).normalize());
        let expected = nearest(geometry, &ray, Interval::FORWARD, skip);
        let found = accelerator.intersect(&ray, Interval::FORWARD, skip);
        match (expected, found) {
            (None, None) => {}
            (Some(a), Some(b)) if a.id() == b.id() => {
                let triangle = matches!(geometry.shapes()[a.shape as usize], LoweredShape::Triangles(_));
                let (far, apart) = ((a.t - b.t).abs(), (a.prim_uv - b.prim_uv).length());
                if !triangle && !same_bits(&a, &b) {
                    return Err(format!("{ray:?}: {b:?} is not a triangle and differs from {a:?}"));
                }
                let close = CLOSE * (1.0 + start.abs().max_element());
                if triangle && (far > close || apart * size(geometry, &a) > 10.0 * close) {
                    return Err(format!("{ray:?}: {b:?} is too far from {a:?}"));
                }
            }
            _ => others += 1,
        }
        if let Some(hit) = found {
            if Some(hit.id()) == skip.id()
                && matches!(geometry.shapes()[hit.shape as usize], LoweredShape::Triangles(_))
            {
                return Err(format!("{ray:?} hits its own start: {hit:?}"));
            }
            for interval in [
                Interval::up_to(hit.t),
                Interval {
                    min: hit.t,
                    max: f64::INFINITY,
                },
            ] {
                let inside = accelerator.intersect(&ray, interval, skip);
                if let Some(hit) = inside.filter(|hit| !interval.contains(hit.t)) {
                    return Err(format!(
                        "{ray:?}: the hit {hit:?} is outside the interval {interval:?}"
                    ));
                }
            }
        }
        if accelerator.occluded(&ray, Interval::FORWARD, skip) != found.is_some() {
            others += 1;
        }
        queries.push((ray, f64::INFINITY, skip));
        (start, skip) = match expected {
            // Half of the rays start on the hit of the previous ray.
            Some(hit) if random.unit() < 0.5 => {
                (ray.origin + hit.t * ray.direction, SelfHitFilter::leaving(&hit))
            }
            _ => (2.0 * random.cube(), SelfHitFilter::NOTHING),
        };
    }
    if others > MAX_OTHERS {
        return Err(format!(
            "{others} of {RAYS} rays have another result, more than {MAX_OTHERS}"
        ));
    }
    accelerator_streams(accelerator, &queries)
}

/// The longest edge of the triangle that was hit.
fn size(geometry: &Geometry, hit: &PreliminaryIntersection) -> f64 {
    match &geometry.shapes()[hit.shape as usize] {
        LoweredShape::Triangles(mesh) => {
            let [a, b, c] = mesh.corners(hit.primitive);
            (b - a).length().max((c - b).length()).max((a - c).length())
        }
        _ => 1.0,
    }
}

fn nearest(
    geometry: &Geometry,
    ray: &Ray,
    interval: Interval,
    skip: SelfHitFilter,
) -> Option<PreliminaryIntersection> {
    let sheared = ShearedRay::new(ray);
    let hits = geometry
        .elements()
        .filter_map(|element| geometry.intersect(element, ray, &sheared, interval, skip));
    hits.reduce(|best, hit| if hit.is_nearer_than(&best) { hit } else { best })
}

fn geometries() -> Vec<(&'static str, Vec<LoweredShape>)> {
    let mut random = Random::new(1);
    let mut mesh = |count: u32| {
        let mut mesh = TriangleMesh {
            orientation: 1.0,
            ..TriangleMesh::default()
        };
        for i in 0..count {
            let center = random.cube();
            let corner = |v: DVec3| center + 0.4 * v;
            mesh.positions
                .extend([random.cube(), random.cube(), random.cube()].map(corner));
            mesh.triangles.push([3 * i, 3 * i + 1, 3 * i + 2]);
        }
        mesh
    };
    let ball = |x: f64| -> LoweredShape {
        LoweredShape::Custom(Box::new(Ball {
            center: DVec3::new(x, 0.1, 0.3 * x),
            radius: 0.25,
        }))
    };
    let wall = || {
        LoweredShape::Custom(Box::new(Wall {
            point: DVec3::new(0.0, 0.0, -1.5),
            normal: DVec3::Z,
        }))
    };
    vec![
        ("nothing", Vec::new()),
        ("an empty mesh", vec![LoweredShape::Triangles(mesh(0))]),
        ("one triangle", vec![LoweredShape::Triangles(mesh(1))]),
        ("balls and a wall", vec![ball(-0.5), wall(), ball(0.5), ball(0.6)]),
        (
            "everything",
            vec![
                LoweredShape::Triangles(mesh(40)),
                ball(-0.6),
                LoweredShape::Triangles(mesh(0)),
                wall(),
                LoweredShape::Triangles(mesh(30)),
                ball(0.7),
            ],
        ),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;
    use whitstone_core::Statistics;
    use whitstone_core::stream::{HitStream, RayStream};

    /// Tests every element, with one deliberate fault.
    struct Faulty {
        geometry: Geometry,
        fault: &'static str,
    }

    impl Accelerator for Faulty {
        fn intersect(
            &self,
            ray: &Ray,
            interval: Interval,
            skip: SelfHitFilter,
        ) -> Option<PreliminaryIntersection> {
            let skip = if self.fault == "leaves" {
                SelfHitFilter::NOTHING
            } else {
                skip
            };
            let interval = match self.fault {
                "interval" => Interval {
                    max: f64::INFINITY,
                    ..interval
                },
                _ => interval,
            };
            let mut hit = nearest(&self.geometry, ray, interval, skip)?;
            match self.fault {
                "distance" => hit.t += 1e-4,
                "opaque" => hit.prim_uv.x += 1e-9,
                "weights" => hit.prim_uv *= 0.9,
                "identity" => hit.primitive += 1000,
                _ => {}
            }
            Some(hit)
        }

        fn occluded(&self, ray: &Ray, interval: Interval, skip: SelfHitFilter) -> bool {
            self.fault != "shadows" && nearest(&self.geometry, ray, interval, skip).is_some()
        }

        fn intersect_stream(&self, rays: &RayStream, hits: &mut HitStream) {
            hits.clear(rays);
            for lane in 0..rays.len {
                let hit = self.intersect(&rays.ray(lane), rays.interval(lane), rays.skip.skip(lane));
                if let Some(mut hit) = hit {
                    hit.t += if self.fault == "streams" { 1e-12 } else { 0.0 };
                    hits.set(lane, &hit);
                }
            }
        }

        fn statistics(&self) -> Statistics {
            Statistics::new()
        }

        fn approximation_note(&self) -> Option<&str> {
            (self.fault != "silent").then_some("a test")
        }
    }

    #[test]
    fn every_fault_is_found() {
        let check = |fault| {
            let (_, shapes) = geometries().pop().expect("there are geometries");
            let geometry = Geometry::new(shapes);
            backend_agrees(
                &geometry,
                &Faulty {
                    geometry: Geometry::new(geometries().pop().expect("as above").1),
                    fault,
                },
            )
        };
        assert_eq!(check(""), Ok(()));
        for (fault, message) in [
            ("silent", "does not declare"),
            ("leaves", "hits its own start"),
            ("interval", "is outside the interval"),
            ("distance", "too far from"),
            ("opaque", "differs from"),
            ("weights", "too far from"),
            ("identity", "rays have another result"),
            ("shadows", "rays have another result"),
            ("streams", ""),
        ] {
            let broken = check(fault);
            let reported = broken.as_ref().is_err_and(|error| error.contains(message));
            assert!(reported, "{fault}: {broken:?}");
        }
    }
}
