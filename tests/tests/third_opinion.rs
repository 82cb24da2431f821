//! The oracle's own tracer against the pipeline: two programs of one model.

use rayon::prelude::*;
use whitstone::scene::{Description, Plan, Sources};
use whitstone_core::Scratch;
use whitstone_oracle::tracer::{Tracer, Value};
use whitstone_tests::{load, scenes};

/// Pixels of each scene along a side, from a lattice that no scene is symmetric to.
const SIDE: u32 = 6;
/// Relative to the largest channel, beside the uncertainty that the oracle tells: what rounding
/// does along a tree.
const TOLERANCE: f64 = 1e-9;
/// The same where textures are filtered by footprints, which the pipeline finds by forward
/// differences and holds in single precision.
const FILTERED: f64 = 1e-5;

/// An uncertainty above this part of the largest channel decides nothing.
const SHARP: f64 = 1e-6;

/// With a change of our side only: how many pixels agree, differ, and are not known; `None` where
/// the oracle does not know the scene.
fn counts(scene: &std::path::Path, ours: &[String]) -> Option<[usize; 3]> {
    let registry = whitstone::registry();
    let sources = Sources::load(scene, &[], &registry).ok()?;
    let description = Description::parse(&sources).into_result().ok()?;
    Plan::new(&description, &registry).into_result().ok()?;
    let tracer = match Tracer::new(&description) {
        Ok(tracer) => tracer,
        Err(errors) => {
            let told = sources.report(&errors, false);
            // The pipeline has found all files.
            assert!(!told.contains("os error"), "{}: {told}", scene.display());
            return None;
        }
    };
    let pipeline = load(scene, ours, &registry).ok()?;
    let tolerance = if pipeline.scene.reads_footprints() {
        FILTERED
    } else {
        TOLERANCE
    };
    let size = pipeline.film.size;
    let mut found = [0; 3];
    for place in 0..SIDE * SIDE {
        let part = |k: u32, side: u32| ((f64::from(k) + 0.37) / f64::from(SIDE) * f64::from(side)) as u32;
        let pixel = [part(place % SIDE, size.width), part(place / SIDE, size.height)];
        let mine = pipeline.pixel(pixel, &mut Scratch::default()).to_array();
        found[match tracer.pixel(pixel) {
            Value::Unknown(_) => 2,
            Value::Known { rgb, uncertainty, .. } => {
                let largest = rgb.iter().fold(0.0_f64, |most, v| most.max(v.abs()));
                let near = |c: usize| (mine[c] - rgb[c]).abs() <= tolerance * largest + uncertainty[c];
                // To agree with what could be anything is no agreement.
                let is_sharp = uncertainty.iter().all(|width| *width <= SHARP * largest);
                if !(0..3).all(near) {
                    println!("pixel {pixel:?}: {mine:?}, the oracle {rgb:?}");
                }
                match (0..3).all(near) {
                    true if is_sharp => 0,
                    true => 2,
                    false => 1,
                }
            }
        }] += 1;
    }
    Some(found)
}

#[test]
fn pixels_are_those_of_the_oracle() {
    let found: Vec<_> = scenes()
        .into_par_iter()
        .filter_map(|scene| counts(&scene, &[]).map(|counts| (scene, counts)))
        .collect();
    let known = found.len();
    let mut problems = Vec::new();
    for (scene, [agree, differ, unknown]) in found {
        let name = scene.display();
        println!("{name}: {agree} agree, {differ} differ, {unknown} are not known");
        // Solids that are put together share faces, where two surfaces are at one place.
        if differ > 0 || unknown > agree / 3 {
            problems.push(format!(
                "{name}: {agree} agree, {differ} differ, {unknown} are not known"
            ));
        }
    }
    assert!(problems.is_empty(), "{}", problems.join("\n"));
    assert!(known > 90, "the oracle knows {known} scenes");
}

/// A fault of a millionth in one number is seen.
/// The transmitted ray of `whitted` with `k_refr = 0` has its own index of refraction and no
/// weight: it must not replace that of the glass it is mixed with.
#[test]
fn a_mix_has_the_directions_of_the_rays_with_weight() {
    let folder = tempfile::tempdir().unwrap();
    let scene = folder.path().join("mix.toml");
    let text = r#"
film = { width = 60, height = 60 }
light = [{ type = "background", radiance = 0.18 }]
[camera]
type = "perspective"
look_at = { origin = [0, 1, 6], target = [0, 1, 0] }
fov = 24
[[shape]]
type = "sphere"
center = [0, 1, 0]
material = { type = "mix", a = { type = "whitted", k_a = 0.5 }, b = { type = "dielectric", interior_ior = 1.55 }, weight = 0.75 }
[[shape]]
type = "rectangle"
transform = [{ scale = 9 }, { translate = [0, 0, -4] }]
material = { type = "emissive", radiance = { type = "checker", a = 1, b = 0.2, scale = 9 } }
"#;
    std::fs::write(&scene, text).unwrap();
    let [agree, differ, _] = counts(&scene, &[]).unwrap();
    assert!(agree > 20 && differ == 0, "{agree} agree, {differ} differ");
}

/// The oracle moves the vertices itself: a change of the height that moves them by a few millionths
/// of the ball is found.
#[test]
fn displaced_meshes_are_known() {
    let scene = |name: &str| whitstone_tests::root().join(format!("scenes/showcase/{name}.toml"));
    let vectors = "displacement_vectors";
    for name in ["displacement", "height_map", "subdivision", vectors] {
        let [agree, differ, unknown] = counts(&scene(name), &[]).expect("the oracle knows it");
        assert!(
            agree > 30 && differ == 0,
            "{name}: {agree} agree, {differ} differ, {unknown} are not known"
        );
    }
    for (name, fault) in [
        ("displacement", "shape.ball.displacement.scale=0.160001"),
        ("displacement", "shape.ball.displacement.offset=0.50001"),
        (vectors, "shape.ball.displacement.scale=0.350002"),
        (vectors, "shape.ring.displacement.axis=[0, 0.00001, 1]"),
    ] {
        let [agree, differ, _] = counts(&scene(name), &[fault.to_owned()]).expect("the oracle knows it");
        assert!(differ >= 3, "{fault}: {agree} agree, {differ} differ");
    }
}

/// Reflections that are looked up in a cube map and in a texture.
#[test]
fn looked_up_reflections_are_known() {
    let scene = whitstone_tests::root().join("scenes/materials/reflection_map.toml");
    let [agree, differ, unknown] = counts(&scene, &[]).expect("the oracle knows it");
    assert!(
        agree > 30 && differ == 0,
        "{agree} agree, {differ} differ, {unknown} are not known"
    );
    for fault in [
        "shape.looked_up.material.material.reflectance=[1, 0.90001, 0.8]",
        "shape.glass.material.radiance.scale=3.0001",
        "shape.glass.material.material.interior_ior=1.50001",
    ] {
        let [agree, differ, _] = counts(&scene, &[fault.to_owned()]).expect("the oracle knows it");
        assert!(differ >= 3, "{fault}: {agree} agree, {differ} differ");
    }
}

#[test]
fn the_comparison_bites() {
    let scene = whitstone_tests::root().join("scenes/showcase/classic.toml");
    for fault in ["camera.fov=45.000045", "light.0.intensity=60.00006"] {
        let [agree, differ, _] = counts(&scene, &[fault.to_owned()]).expect("the oracle knows it");
        // Some pixels show the background alone.
        assert!(3 * differ > agree, "{fault}: {agree} agree, {differ} differ");
    }
    // Of filters by footprints.
    for (scene, fault) in [
        ("horizon_trilinear", "texture.ground.scale=0.2505"),
        ("horizon_ewa", "texture.ground.max_anisotropy=15"),
    ] {
        let scene = whitstone_tests::root().join(format!("scenes/showcase/{scene}.toml"));
        let [agree, differ, _] = counts(&scene, &[fault.to_owned()]).expect("the oracle knows it");
        assert!(differ >= 3, "{fault}: {agree} agree, {differ} differ");
    }
}
