//! The scenes that the kit prints for what breaks a law are scenes: the program accepts them, and
//! the laws are broken again there.

use std::path::Path;
use std::sync::Arc;
use whitstone::core::{Accelerators, Cameras, Lights, Material, Materials, Plugin, Shapes, Textures};
use whitstone::scene::Sources;
use whitstone_accelerators::bvh2::Bvh2;
use whitstone_cameras::perspective::Perspective;
use whitstone_lights::point::Point;
use whitstone_materials::matte::Matte;
use whitstone_materials::phong::Phong;
use whitstone_shapes::ellipsoid::Ellipsoid;
use whitstone_testkit::{Failure, Lawful, first_failure, holds_in, reciprocity_laws};
use whitstone_textures::checker::Checker;

/// Holds a good plugin to a law that nothing obeys.
fn failure<F: Lawful, P: Plugin<F>>(text: &str) -> Failure {
    let nothing: [fn(&F::Product); 1] = [|_| panic!("nothing obeys this")];
    let found = *first_failure::<F, P>(text, &nothing).expect_err("nothing obeys this law");
    assert_eq!((found.plugin, &*found.law), (P::TYPE, "nothing obeys this"));
    assert_eq!(holds_in::<F, P>(&found.scene, &nothing), Err(found.law.clone()));
    assert_eq!(holds_in::<F, P>(&found.scene, &[]), Ok(()), "{}", found.scene);
    found
}

#[test]
fn every_family_prints_scenes_that_render() {
    let registry = whitstone::registry();
    let look = "look_at = { origin = [0, 0, 5], target = [0, 0, 0] }";
    for found in [
        failure::<Shapes, Ellipsoid>("radii = [1, 0.5..2.0, 1]"),
        failure::<Accelerators, Bvh2>("max_leaf = 1..8"),
        failure::<Materials, Matte>("reflectance = 0.0..1"),
        failure::<Textures, Checker>("scale = [1..9, 1..9]"),
        failure::<Lights, Point>("position = [0, 4, 0]\nintensity = 1.0..100"),
        failure::<Cameras, Perspective>(&format!("{look}\nfov = 10.0..90")),
    ] {
        let sources = Sources::from_text("failing", &found.scene, Path::new(""), &[]);
        let sources = sources.unwrap_or_else(|error| panic!("{}: {error}", found.scene));
        let built = whitstone_tests::build(&sources, &registry);
        let pipeline = built.unwrap_or_else(|report| panic!("{}\n{report}", found.scene));
        let bits = whitstone_tests::bits(&pipeline, 1);
        assert!(!bits.is_empty(), "{}", found.scene);
        assert!(
            found.scene.starts_with("# nothing obeys this\n"),
            "{}",
            found.scene
        );
    }
}

/// Phong's highlight is not physical: the kit finds that, and prints the weakest highlight that
/// shows it.
#[test]
fn what_is_not_reciprocal_is_found() {
    let law: fn(&Arc<dyn Material>) = |material| reciprocity_laws(&**material);
    let found = first_failure::<Materials, Phong>("k_d = 0.2\nk_s = 0.1..1\nexponent = 1..50", &[law]);
    let found = found.expect_err("the cosine of the light is not in the highlight");
    assert!(found.law.contains("must be reciprocal"), "{found}");
    assert!(found.scene.contains("k_s = 0.1\n"), "{found}");
    assert_eq!(first_failure::<Materials, Phong>("k_s = 0", &[law]), Ok(()));
}
