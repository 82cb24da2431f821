//! Every shape, held to the oracle: class of the hit and ray parameter.
//!
//! `WHITSTONE_RAYS` is how many rays each case gets at each place; release mode takes some microseconds to milliseconds
//! for each.

use std::path::Path;
use whitstone::core::{Aabb, Interval, Skip};
use whitstone_oracle::Oracle;
use whitstone_oracle::agreement::{Agreement, Subject};
use whitstone_oracle::cases::CASES;
use whitstone_testkit::{Aim, Random, placements};

fn rays() -> u32 {
    let rays = std::env::var("WHITSTONE_RAYS").ok();
    rays.map_or(60, |rays| rays.parse().expect("WHITSTONE_RAYS is a number"))
}

fn scenes() -> &'static Path {
    Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../../scenes"))
}

/// Holds all cases of a shape to the oracle at all places where it may stand.
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
            let geometry = &subject.pipeline.world.geometry;
            let elements = geometry.elements().map(|element| geometry.bounds(element));
            let bounds = elements.fold(Aabb::EMPTY, Aabb::union);
            let aim = Aim::at(bounds);
            let mut random = Random::new(5);
            let mut agreement = Agreement::default();
            for number in 0..rays() {
                let ray = aim.ray(number, &mut random);
                let hit = subject
                    .pipeline
                    .world
                    .accelerator
                    .closest(&ray, Interval::FORWARD, Skip::NOTHING);
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
    // Otherwise nothing is told.
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
    patch "patch",
    csg "csg",
    instance "instance",
);
