//! Every scene of the repository, written in another format and read again, has the same image, or
//! the conversion tells what it changed.

use rayon::prelude::*;
use std::path::Path;
use toml::Value;
use whitstone::core::{ExportScene, Note, Registry, Treatment};
use whitstone::render::{Pipeline, RenderOptions};
use whitstone::scene::{Description, Sources};
use whitstone_tests::{build, load, root, scenes, small};

/// A pixel differs if a channel is further away than this part of its value or, for dark ones, of
/// the image's mean: the tolerance of `validate`.
const TOLERANCE: (f32, f32) = (1e-3, 1e-4);

/// Single precision moves edges by a rounding, which can flip a few pixels.
const MAX_FLIPPED: f64 = 0.01;

/// What became of a scene.
enum Outcome {
    /// The same image.
    Same,
    /// Another image; what the conversion says that it approximates or drops.
    Told(String),
    /// The format cannot hold it, and the conversion says why.
    Refused,
    /// Another image, and nothing is said.
    Silent(String),
}

fn image(pipeline: &Pipeline) -> Vec<[f32; 3]> {
    let film = pipeline.render(RenderOptions {
        threads: 1,
        ..RenderOptions::default()
    });
    film.rgb
}

/// The fraction of pixels that differ.
fn differing(one: &[[f32; 3]], two: &[[f32; 3]]) -> f64 {
    if one.len() != two.len() {
        return 1.0;
    }
    let values = || one.iter().flatten();
    let mean = values().map(|value| value.abs()).sum::<f32>() / values().count().max(1) as f32;
    let far = |(a, b): (&f32, &f32)| (a - b).abs() > TOLERANCE.0 * a.abs() + TOLERANCE.1 * mean;
    let differ = |(one, two): &(&[f32; 3], &[f32; 3])| one.iter().zip(two.iter()).any(far);
    one.iter().zip(two).filter(differ).count() as f64 / one.len().max(1) as f64
}

/// Losses that change no image here: the positions of samples are those of `center` on both sides,
/// a far limit is added by Mitsuba's format itself, and integrators come back as what they were.
const WITHOUT_EFFECT: [&str; 9] = [
    "[sampler]",
    "sampler",
    "far_clip",
    "[integrator] whitted",
    "[integrator]",
    "Integrator",
    "integrator direct",
    "integrator path",
    "Sampler",
];

/// What is approximated and dropped with an effect on the image.
fn losses(notes: &[Note]) -> Vec<&'static str> {
    let lost = notes
        .iter()
        .filter(|note| note.feature.treatment > Treatment::Kept);
    let names = lost.map(|note| note.feature.name);
    names.filter(|name| !WITHOUT_EFFECT.contains(name)).collect()
}

/// The scene without what no other format holds: layers, light without a place or direction, the
/// positions of samples, and the cut of faint rays.
fn simplified(mut document: toml::Table) -> toml::Table {
    let kept = ["point", "directional", "spot"];
    let kind = |light: &Value| light.get("type").and_then(Value::as_str).map(str::to_owned);
    if let Some(Value::Array(lights)) = document.get_mut("light") {
        lights.retain(|light| kind(light).is_some_and(|kind| kept.contains(&kind.as_str())));
    }
    if document
        .get("light")
        .and_then(Value::as_array)
        .is_none_or(Vec::is_empty)
    {
        let light: toml::Table = "type = \"directional\"\ndirection = [-1, -2, -3]\nirradiance = 3"
            .parse()
            .unwrap();
        document.insert("light".into(), Value::Array(vec![Value::Table(light)]));
    }
    document.remove("sampler");
    if let Some(Value::Table(integrator)) = document.get_mut("integrator") {
        integrator.remove("min_contribution");
    }
    if let Some(Value::Table(film)) = document.get_mut("film") {
        film.remove("aovs");
        film.remove("paths");
    }
    document
}

/// Writes a scene as a file with this extension, reads it again, and compares the images.
fn round_trip(scene: &Path, extension: &str, registry: &Registry) -> Outcome {
    let sources =
        Sources::load(scene, &small(), registry).unwrap_or_else(|error| panic!("{:?}", error.errors));
    let description = Description::parse(&sources).into_result().unwrap();
    let mut document: toml::Table = description.flattened.text.parse().unwrap();
    // glTF holds everything.
    let mut changes = small();
    if extension != "glb" {
        document = simplified(document);
        changes.push("sampler={type=\"center\"}".to_owned());
    }
    let exported = ExportScene {
        document: &document,
        base: &description.flattened.base,
    };
    let folder = tempfile::tempdir().unwrap();
    let original = folder.path().join("original.toml");
    let toml = registry.format_of(&original).unwrap();
    toml.export(&exported, &original).unwrap().unwrap();
    let original = image(&load(&original, &[], registry).unwrap());

    let out = folder.path().join(format!("scene.{extension}"));
    let format = registry.format_of(&out).unwrap();
    let Ok(notes) = format.export(&exported, &out).unwrap() else {
        return Outcome::Refused;
    };
    let mut told = losses(&notes);
    let other = |told: Vec<&str>, why: String| match told.is_empty() {
        true => Outcome::Silent(why),
        false => Outcome::Told(format!("{why}: {}", told.join("; "))),
    };
    let again = match Sources::load(&out, &changes, registry) {
        Ok(again) => again,
        // For example a scene without any shape that the format knows.
        Err(error) => return other(told, error.sources.report(&error.errors, false)),
    };
    told.extend(again.notes().iter().flat_map(|(_, notes)| losses(notes)));
    match build(&again, registry) {
        Ok(pipeline) => match differing(&original, &image(&pipeline)) {
            part if part <= MAX_FLIPPED => Outcome::Same,
            part => other(told, format!("{:.1} % of the pixels differ", 100.0 * part)),
        },
        Err(report) => other(told, report),
    }
}

/// The number of scenes with the same image, with what was changed told, and refused.
fn all(extension: &str) -> [usize; 3] {
    let registry = whitstone::registry();
    let outcomes: Vec<(String, Outcome)> = scenes()
        .par_iter()
        .map(|scene| {
            let name = scene.strip_prefix(root()).unwrap_or(scene).display().to_string();
            (name, round_trip(scene, extension, &registry))
        })
        .collect();
    let mut counts = [0; 3];
    let mut silent = Vec::new();
    for (name, outcome) in outcomes {
        match outcome {
            Outcome::Same => counts[0] += 1,
            Outcome::Told(what) => {
                println!("{extension}: {name}: {what}");
                counts[1] += 1;
            }
            Outcome::Refused => counts[2] += 1,
            Outcome::Silent(why) => silent.push(format!("{name}: {why}")),
        }
    }
    assert!(
        silent.is_empty(),
        "not the same, and not told:\n{}",
        silent.join("\n")
    );
    let [same, told, refused] = counts;
    println!(
        "{extension}: {same} scenes have the same image, {told} with changes that are told, {refused} refused"
    );
    counts
}

#[test]
fn gltf_keeps_every_scene() {
    let [same, told, refused] = all("glb");
    assert!(same > 0 && told == 0 && refused == 0, "{same}, {told}, {refused}");
}

#[test]
fn xml_tells_what_it_changes() {
    let [same, ..] = all("xml");
    assert!(same >= 25, "only {same} scenes have the same image");
}

#[test]
fn pbrt_tells_what_it_changes() {
    let [same, ..] = all("pbrt");
    assert!(same >= 25, "only {same} scenes have the same image");
}

/// A conversion that loses something without a word is found.
#[test]
fn a_silent_change_is_found() {
    let registry = whitstone::registry();
    let scene = root().join("scenes/showcase/classic.toml");
    let ours = image(&load(&scene, &small(), &registry).unwrap());
    let mut changes = small();
    changes.push("shape.glass.material.interior_ior=1.6".to_owned());
    let theirs = image(&load(&scene, &changes, &registry).unwrap());
    assert!(differing(&ours, &theirs) > MAX_FLIPPED);
    assert_eq!(differing(&ours, &ours), 0.0);
}
