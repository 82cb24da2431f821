//! Compares every shape with the oracle: hit or miss, and the ray parameter.
//!
//! `WHITSTONE_RAYS` is the number of rays for each case and placement. In release mode a ray takes
//! some microseconds to milliseconds.

use std::path::Path;
use whitstone::core::{Aabb, DVec3, Interval, Ray, SelfHitFilter, SurfaceAttributes};
use whitstone_oracle::Oracle;
use whitstone_oracle::agreement::{Agreement, Error, MAX_ULPS, Subject};
use whitstone_oracle::cases::CASES;
use whitstone_testkit::{Aim, Random, placements};

fn rays() -> u32 {
    let rays = std::env::var("WHITSTONE_RAYS").ok();
    rays.map_or(60, |rays| rays.parse().expect("WHITSTONE_RAYS is a number"))
}

fn scenes() -> &'static Path {
    Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../../scenes"))
}

/// Compares all cases of a shape with the oracle at all placements.
fn agrees(shape: &str) {
    let registry = whitstone::registry();
    let (mut broken, mut hits, mut unknown) = (Vec::new(), 0, 0);
    for case in CASES.iter().filter(|case| case.shape == shape) {
        for (name, place) in placements() {
            let scene = case.scene(place.world_from_object());
            let subject = match Subject::new(&scene, scenes(), &registry) {
                Ok(subject) => subject,
                Err(error) => {
                    assert!(name != "as it is", "{error}");
                    continue;
                }
            };
            let geometry = &subject.pipeline.scene.geometry;
            let elements = geometry.elements().map(|element| geometry.bounds(element));
            let bounds = elements.fold(Aabb::EMPTY, Aabb::union);
            let aim = Aim::at(bounds);
            let mut random = Random::new(5);
            let mut agreement = Agreement::default();
            for number in 0..rays() {
                let ray = aim.ray(number, &mut random);
                let hit = subject.pipeline.scene.accelerator.intersect(
                    &ray,
                    Interval::FORWARD,
                    SelfHitFilter::NOTHING,
                );
                agreement.add(&subject.oracle, &ray, hit.map(|hit| hit.t), &bounds);
            }
            println!(
                "{shape} {:?}, {name}: {agreement}",
                case.keys.lines().next().unwrap_or_default()
            );
            hits += agreement.hits;
            unknown += agreement.unknown;
            if agreement.wrong > 0 {
                broken.push(format!("{} {name}: {agreement}", case.keys));
            }
        }
    }
    assert!(broken.is_empty(), "{}", broken.join("\n"));
    // Otherwise the test would be vacuous.
    assert!(
        hits > 100 && unknown < hits / 50,
        "{hits} hits, {unknown} unknown"
    );
}

macro_rules! shapes {
    ($($name:ident $shape:literal),* $(,)?) => {
        $(
            #[test]
            fn $name() {
                agrees($shape);
            }
        )*

        #[test]
        fn every_shape_that_the_oracle_knows_is_here() {
            let mut here = [$($shape),*];
            here.sort_unstable();
            assert_eq!(here, Oracle::KNOWN);
        }
    };
}

shapes!(
    sphere "sphere",
    plane "plane",
    rectangle "rectangle",
    disk "disk",
    cuboid "box",
    triangle "triangle",
    mesh "mesh",
    heightfield "heightfield",
    ellipsoid "ellipsoid",
    cylinder "cylinder",
    cone "cone",
    paraboloid "paraboloid",
    hyperboloid "hyperboloid",
    quadric "quadric",
    torus "torus",
    polygon "polygon",
    prism "prism",
    lathe "lathe",
    patch "patch",
    csg "csg",
    instance "instance",
    isosurface "isosurface",
    implicit "implicit",
    fractal "fractal",
);

/// A ray that leaves a cap inwards close to the rim hits the side at that small distance. The
/// property test of leaving rays permits this hit; this test shows that it is correct.
#[test]
fn what_leaves_a_cap_beside_its_rim_meets_the_side_where_it_is() {
    let registry = whitstone::registry();
    let places = placements();
    let (_, far) = places
        .iter()
        .find(|(name, _)| *name == "far away")
        .expect("it is one");
    // With the radius of the shape and the height of its cap.
    for (shape, radius, height) in [("cone", 0.7, 0.0), ("cylinder", 0.7, 1.0)] {
        let case = CASES.iter().find(|case| case.shape == shape).expect("it is one");
        let scene = case.scene(far.world_from_object());
        let Subject { pipeline, oracle, .. } = Subject::new(&scene, scenes(), &registry).unwrap();
        let world = &pipeline.scene;
        let intersect = |ray: &Ray, skip| world.accelerator.intersect(ray, Interval::FORWARD, skip);
        let mut random = Random::new(8);
        let mut near = 0;
        for number in 0..2_000 {
            let gap = 10f64.powi(-8 + number % 4);
            let rim = random.direction().with_z(0.0).normalize();
            let target = (radius - gap) * rim + height * DVec3::Z;
            let origin = target + DVec3::new(0.0, 0.0, if height > 0.0 { 2.0 } else { -2.0 });
            let [target, origin] = [target, origin].map(|p| far.world_from_object().transform_point3(p));
            let ray = Ray::new(origin, target - origin);
            let hit = intersect(&ray, SelfHitFilter::NOTHING).expect("the cap is there");
            let point = world.geometry.surface(&ray, &hit, SurfaceAttributes::NOTHING);
            let inward = (-point.n_g + 3.0 * point.n_g.cross(random.direction())).normalize();
            let away = Ray::new(point.spawn_origin(inward), inward);
            let again = intersect(&away, SelfHitFilter::leaving(&hit));
            let truth = oracle.nearest(&away, Interval::FORWARD);
            let error = Error::of(&truth, again.map(|again| again.t));
            let small = error.is_some_and(|error| error.by_condition <= MAX_ULPS);
            assert!(small, "{shape}, {gap}: {again:?} instead of {truth:?}");
            // At this distance the property test would not permit a hit of the same part.
            let slack = point.error + 8.0 * f64::EPSILON * point.position.abs().max_element();
            near += usize::from(again.is_some_and(|again| again.t <= 1e3 * slack));
        }
        assert!(near > 400, "{near}");
    }
}
