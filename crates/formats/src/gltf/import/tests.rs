use super::*;
use crate::gltf::Gltf;
use serde_json::{Value as Json, json};
use std::fs;
use whitstone_core::SceneFormat;

/// A triangle with an orthographic camera.
fn scene() -> Json {
    let accessor = |kind: &str| json!({ "componentType": 5126, "count": 3, "type": kind, "min": [0, 0, 0], "max": [1, 1, 0] });
    json!({
        "asset": { "version": "2.0" },
        "scenes": [{ "nodes": [0, 1, 2] }],
        "nodes": [
            { "mesh": 0 },
            { "camera": 0, "translation": [0, 0, 2] },
            { "extensions": { "KHR_lights_punctual": { "light": 0 } } },
        ],
        "extensions": { "KHR_lights_punctual": { "lights": [{ "type": "spot" }] } },
        "cameras": [{
            "type": "orthographic",
            "orthographic": { "xmag": 1, "ymag": 2, "znear": 0.1, "zfar": 9 },
        }],
        "materials": [{}],
        "meshes": [{
            "primitives": [{ "attributes": { "POSITION": 0 }, "material": 0, "targets": [{ "POSITION": 0 }] }],
        }],
        "accessors": [accessor("VEC3"), accessor("VEC2")],
    })
}

/// The scene after the import of a document, and the noted features with their places.
fn imported(document: &Json, options: &ImportOptions) -> (Table, Vec<(&'static str, String)>) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("m.gltf");
    fs::write(&path, document.to_string()).unwrap();
    let imported = Gltf.import(&path, options).unwrap().unwrap();
    let notes = imported.notes.iter();
    let notes = notes.map(|note| (note.feature.name, note.places.join(" ")));
    (imported.text.parse().unwrap(), notes.collect())
}

#[test]
fn rays_pass_through_many_layers_of_alpha() {
    let integrator = |document: &Json, options: &ImportOptions| {
        let (scene, _) = imported(document, options);
        scene.get("integrator").cloned()
    };
    let mut document = scene();
    assert_eq!(integrator(&document, &ImportOptions::all()), None);
    document["materials"][0] = json!({
        "alphaMode": "BLEND",
        "pbrMetallicRoughness": { "baseColorFactor": [1, 1, 1, 0.5] },
        "emissiveFactor": [1, 1, 1],
    });
    let found = integrator(&document, &ImportOptions::all()).unwrap();
    assert_eq!(found["max_depth"].as_integer(), Some(32));
    assert_eq!(found["min_contribution"].as_float(), Some(1e-3));
    let part = ImportOptions {
        part: true,
        ..ImportOptions::all()
    };
    assert_eq!(integrator(&document, &part), None);
}

#[test]
fn morph_targets_that_are_not_read_are_noted() {
    let feature = "morph targets of colours and texture coordinates";
    let noted = |document: &Json| {
        let (_, notes) = imported(document, &ImportOptions::all());
        let mut found = notes.into_iter().filter(|(name, _)| *name == feature);
        found.next().map(|(_, places)| places)
    };
    let mut document = scene();
    assert_eq!(noted(&document), None);
    document["meshes"][0]["primitives"][0]["targets"] =
        json!([{ "POSITION": 0 }, { "COLOR_0": 0, "TEXCOORD_1": 1, "NORMAL": 0 }]);
    let at = "/meshes/0/primitives/0/targets/1";
    assert_eq!(noted(&document), Some(format!("{at}/COLOR_0 {at}/TEXCOORD_1")));
    // Only meshes of the scene count.
    document["scenes"][0]["nodes"] = json!([0, 1, 2]);
    document["meshes"] = json!([scene()["meshes"][0], document["meshes"][0]]);
    assert_eq!(noted(&document), None);
}

#[test]
fn orthographic_cameras_that_mirror_are_noted() {
    let noted = |key: &str, size: f64| {
        let mut document = scene();
        document["cameras"][0]["orthographic"][key] = json!(size);
        let (_, notes) = imported(&document, &ImportOptions::all());
        notes.contains(&("mirrored cameras", "/cameras/0".to_owned()))
    };
    assert!(!noted("xmag", 1.0));
    assert!(noted("xmag", -1.0));
    assert!(noted("ymag", -2.0));
}

#[test]
fn spots_without_angles_have_the_default_cone() {
    let angles = |light: Json| {
        let mut document = scene();
        document["extensions"]["KHR_lights_punctual"]["lights"][0] = light;
        let (scene, _) = imported(&document, &ImportOptions::all());
        let light = &scene["light"][0];
        ["cutoff_angle", "beam_width"].map(|key| light[key].as_float().unwrap().round())
    };
    assert_eq!(angles(json!({ "type": "spot" })), [45.0, 0.0]);
    assert_eq!(angles(json!({ "type": "spot", "spot": {} })), [45.0, 0.0]);
    let inner = json!({ "type": "spot", "spot": { "innerConeAngle": 0.5 } });
    assert_eq!(angles(inner), [45.0, 29.0]);
}
