//! glTF files as scenes: what they import to, and hostile ones.
//!
//! Public files are read from `gltf/` in the folder that `WHITSTONE_TEST_DATA` names; tests whose
//! files are absent print "skipped".

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use serde_json::{Value, json};
use std::fs;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};
use whitstone::core::{ImportOptions, Registry};
use whitstone::scene::Sources;
use whitstone_tests::{build, load, program, test_data};

/// A pyramid and a strip with colours, a texture, a skin, morph targets, sparse and normalised
/// accessors, a camera, a light, an instanced mesh: everything that has an index in one small file.
fn rich() -> Value {
    let mut buffer: Vec<u8> = Vec::new();
    let mut views: Vec<Value> = Vec::new();
    let mut add = |bytes: Vec<u8>| {
        while !buffer.len().is_multiple_of(4) {
            buffer.push(0);
        }
        views.push(json!({ "buffer": 0, "byteOffset": buffer.len(), "byteLength": bytes.len() }));
        buffer.extend(bytes);
        views.len() - 1
    };
    let floats = |values: &[f32]| {
        values
            .iter()
            .flat_map(|value| value.to_le_bytes())
            .collect::<Vec<u8>>()
    };
    let points = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 1.0, 1.0, 0.0];
    let position = add(floats(&points));
    let normal = add(floats(&[0.0, 0.0, 1.0].repeat(4)));
    let uv = add(vec![0, 0, 255, 0, 0, 255, 255, 255]);
    let color = add(vec![
        255, 0, 0, 255, 0, 255, 0, 255, 0, 0, 255, 255, 255, 255, 255, 128,
    ]);
    let index = add(vec![0, 1, 2, 2, 1, 3]);
    let joints = add([0, 1, 0, 0].repeat(4));
    let weights = add(floats(&[0.5, 0.5, 0.0, 0.0].repeat(4)));
    let morph = add(floats(&[0.0, 0.0, 0.25].repeat(4)));
    let bind = add(floats(
        &[
            1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0,
        ]
        .repeat(2),
    ));
    let sparse_index = add(vec![3]);
    let sparse_value = add(floats(&[1.0, 1.0, 0.5]));
    let moved = add(floats(&[0.0, 0.0, 0.0, 2.0, 0.0, 0.0]));
    let png = add(fs::read(whitstone_tests::root().join("scenes/assets/corners.png")).unwrap());
    let accessor = |view: usize, component: u32, count: u32, kind: &str| json!({ "bufferView": view, "componentType": component, "count": count, "type": kind });
    let normalized = |view: usize, kind: &str| json!({ "bufferView": view, "componentType": 5121, "count": 4, "type": kind, "normalized": true });
    json!({
        "asset": { "version": "2.0" },
        "scene": 0,
        "scenes": [{ "nodes": [0, 1, 2, 3, 4, 6] }],
        "nodes": [
            { "mesh": 0, "translation": [-1.0, 0.0, 0.0], "weights": [0.5] },
            { "mesh": 1, "skin": 0 },
            { "camera": 0, "matrix": [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0.5, 0.5, 4, 1] },
            { "extensions": { "KHR_lights_punctual": { "light": 0 } }, "translation": [0.0, 0.0, 3.0] },
            { "children": [5], "rotation": [0.0, 0.0, 0.0, 1.0], "scale": [1.0, 1.0, -1.0] },
            { "translation": [0.0, 0.5, 0.0], "mesh": 1 },
            { "mesh": 1, "extensions": { "EXT_mesh_gpu_instancing": { "attributes": { "TRANSLATION": 11 } } } },
        ],
        "cameras": [{ "type": "perspective", "perspective": { "yfov": 0.8, "znear": 0.01, "aspectRatio": 1.5 } }],
        "extensionsUsed": ["KHR_lights_punctual", "EXT_mesh_gpu_instancing", "KHR_texture_transform"],
        "extensions": { "KHR_lights_punctual": { "lights": [{ "type": "spot", "intensity": 20.0, "spot": { "outerConeAngle": 0.7 } }] } },
        "meshes": [
            { "primitives": [{
                "attributes": { "POSITION": 0, "NORMAL": 1, "TEXCOORD_0": 2, "COLOR_0": 3 },
                "indices": 4, "material": 0, "targets": [{ "POSITION": 7 }],
            }] },
            { "primitives": [
                { "attributes": { "POSITION": 9, "JOINTS_0": 5, "WEIGHTS_0": 6, "TEXCOORD_0": 2 }, "mode": 5, "material": 1 },
                { "attributes": { "POSITION": 10, "JOINTS_0": 5, "WEIGHTS_0": 6 }, "mode": 6 },
            ] },
        ],
        "skins": [{ "joints": [4, 5], "inverseBindMatrices": 8 }],
        "materials": [
            {
                "pbrMetallicRoughness": {
                    "baseColorTexture": { "index": 0, "extensions": { "KHR_texture_transform": { "scale": [2.0, 2.0] } } },
                    "metallicRoughnessTexture": { "index": 0 }, "roughnessFactor": 0.3, "metallicFactor": 0.5,
                },
                "normalTexture": { "index": 0, "scale": 0.5 }, "alphaMode": "BLEND",
            },
            {
                "pbrMetallicRoughness": { "baseColorTexture": { "index": 0 } }, "alphaMode": "MASK", "alphaCutoff": 0.25,
                "emissiveFactor": [0.1, 0.2, 0.3], "emissiveTexture": { "index": 0 },
            },
        ],
        "textures": [{ "source": 0, "sampler": 0 }],
        "samplers": [{ "magFilter": 9729, "minFilter": 9987, "wrapS": 33071, "wrapT": 33648 }],
        "images": [{ "bufferView": png, "mimeType": "image/png" }],
        "accessors": [
            accessor(position, 5126, 4, "VEC3"),
            accessor(normal, 5126, 4, "VEC3"),
            normalized(uv, "VEC2"),
            normalized(color, "VEC4"),
            accessor(index, 5121, 6, "SCALAR"),
            accessor(joints, 5121, 4, "VEC4"),
            accessor(weights, 5126, 4, "VEC4"),
            accessor(morph, 5126, 4, "VEC3"),
            accessor(bind, 5126, 2, "MAT4"),
            {
                "bufferView": position, "componentType": 5126, "count": 4, "type": "VEC3",
                "min": [0, 0, 0], "max": [1, 1, 0.5],
                "sparse": {
                    "count": 1,
                    "indices": { "bufferView": sparse_index, "componentType": 5121 },
                    "values": { "bufferView": sparse_value },
                },
            },
            accessor(position, 5126, 4, "VEC3"),
            accessor(moved, 5126, 2, "VEC3"),
        ],
        "bufferViews": views,
        "buffers": [{
            "byteLength": buffer.len(),
            "uri": format!("data:application/octet-stream;base64,{}", STANDARD.encode(&buffer)),
        }],
    })
}

fn write(folder: &Path, name: &str, document: &Value) -> PathBuf {
    let path = folder.join(name);
    fs::write(&path, document.to_string()).unwrap();
    path
}

/// The report of what is wrong with a file, if anything.
fn wrong(path: &Path, registry: &Registry) -> Option<String> {
    load(path, &["film={width=4,height=4}".to_owned()], registry).err()
}

#[test]
fn a_file_with_everything_is_a_scene() {
    let registry = whitstone::registry();
    let folder = tempfile::tempdir().unwrap();
    let path = write(folder.path(), "rich.gltf", &rich());
    let sources = Sources::load(&path, &[], &registry).unwrap();
    let pipeline = build(&sources, &registry).unwrap();
    assert_eq!((pipeline.film.size.width, pipeline.film.size.height), (512, 341));
    let names: Vec<&str> = sources.notes()[0]
        .1
        .iter()
        .map(|note| note.feature.name)
        .collect();
    for expected in [
        "skins",
        "instances",
        "EXT_mesh_gpu_instancing",
        "KHR_lights_punctual",
        "alpha mode MASK",
        "alpha mode BLEND",
        "tangents from texture coordinates",
        "mip maps",
        "no material",
    ] {
        assert!(names.contains(&expected), "{expected} is not among {names:?}");
    }
}

#[test]
fn errors_name_the_place_in_the_file() {
    let registry = whitstone::registry();
    let folder = tempfile::tempdir().unwrap();
    for (pointer, value, expected) in [
        (
            "/accessors/0/bufferView",
            json!(99),
            "/accessors/0/bufferView: expected the index of an entry of `bufferViews`",
        ),
        ("/accessors/4/count", json!(7), "/accessors/4"),
        ("/nodes/0/mesh", json!(7), "/nodes/0/mesh"),
        ("/nodes/5/children", json!([4]), "cycle"),
        ("/nodes/5/children", json!([0]), "no error"),
        (
            "/nodes/3/children",
            json!([5]),
            "/nodes/4/children/0: node 5 is already a child of node 3",
        ),
        (
            "/meshes/0/primitives/0/attributes/NORMAL",
            json!(2),
            "/accessors/2/type: expected VEC3",
        ),
        (
            "/accessors/4/componentType",
            json!(5126),
            "expected 5121, 5123 or 5125",
        ),
        (
            "/buffers/0/uri",
            json!("http://localhost/a.bin"),
            "the scheme \"http\"",
        ),
        ("/buffers/0/uri", json!("../a.bin"), "leaves the folder"),
        (
            "/buffers/0/byteLength",
            json!(1_u64 << 62),
            "/buffers/0/byteLength",
        ),
        ("/accessors/0/count", json!(1_u64 << 62), "/accessors/0"),
        (
            "/materials/0/normalTexture/index",
            json!(3),
            "/materials/0/normalTexture/index",
        ),
        (
            "/asset/version",
            json!("1.0"),
            "/asset/version: expected version 2.0",
        ),
        (
            "/extensionsRequired",
            json!(["KHR_draco_mesh_compression"]),
            "/extensionsRequired/0",
        ),
        (
            "/meshes/0/primitives/0/mode",
            json!(9),
            "/meshes/0/primitives/0/mode",
        ),
        ("/skins/0/joints/1", json!(70), "/skins/0/joints/1"),
    ] {
        let mut document = rich();
        let (parent, key) = pointer.rsplit_once('/').unwrap();
        match document.pointer_mut(parent).unwrap() {
            Value::Object(map) => drop(map.insert(key.to_owned(), value)),
            Value::Array(list) => list[key.parse::<usize>().unwrap()] = value,
            other => panic!("{other} has no keys"),
        }
        let name = format!("{}.gltf", pointer.replace('/', "-"));
        let path = write(folder.path(), &name, &document);
        let report = wrong(&path, &registry).unwrap_or_else(|| "no error".to_owned());
        assert!(report.contains(expected), "{pointer}: {report}");
    }
}

/// The scene that a file is imported to.
fn imported(path: &Path, options: &ImportOptions, registry: &Registry) -> toml::Table {
    let format = registry.format_of(path).unwrap();
    let imported = format.import(path, options).unwrap().unwrap();
    imported.text.parse().unwrap()
}

#[test]
fn photometric_lights_are_divided_by_683() {
    let registry = whitstone::registry();
    let folder = tempfile::tempdir().unwrap();
    let path = write(folder.path(), "rich.gltf", &rich());
    let red = |options: &ImportOptions| {
        let scene = imported(&path, options, &registry);
        let intensity = &scene["light"][0]["intensity"];
        intensity.as_float().or_else(|| intensity[0].as_float()).unwrap()
    };
    let raw = ImportOptions::all();
    let photometric = ImportOptions {
        photometric: true,
        ..ImportOptions::all()
    };
    assert_eq!(red(&raw), 20.0);
    assert_eq!(red(&photometric), 20.0 / 683.0);
    // As a part of a scene.
    let part = |keys: &str| {
        let text = format!("[[import]]\nfile = \"rich.gltf\"\n{keys}\n");
        let scene = folder.path().join("scene.toml");
        fs::write(&scene, text).unwrap();
        load(&scene, &[], &registry).unwrap().scene_hash
    };
    assert_ne!(part(""), part("photometric = true"));
}

/// Transmission is the factor times the red of its texture, where there is no metal.
#[test]
fn transmission_is_mixed_by_factor_texture_and_metalness() {
    let registry = whitstone::registry();
    let folder = tempfile::tempdir().unwrap();
    let materials = |factor: f64, texture: bool, metal: Value| {
        let mut document = rich();
        let mut transmission = json!({ "transmissionFactor": factor });
        if texture {
            transmission["transmissionTexture"] = json!({ "index": 0 });
        }
        document["materials"] = json!([
            { "pbrMetallicRoughness": metal, "extensions": { "KHR_materials_transmission": transmission } },
            {},
        ]);
        let path = write(folder.path(), "glass.gltf", &document);
        let scene = imported(&path, &ImportOptions::all(), &registry);
        load(&path, &[], &registry).unwrap();
        let textures = scene.get("texture").map(|all| toml::to_string(all).unwrap());
        toml::to_string(&scene["material"]).unwrap() + &textures.unwrap_or_default()
    };
    let (none, half, image) = (
        json!({ "metallicFactor": 0.0 }),
        json!({ "metallicFactor": 0.5 }),
        json!({ "metallicFactor": 1.0, "metallicRoughnessTexture": { "index": 0 } }),
    );
    assert!(!materials(1.0, false, none.clone()).contains("mix"));
    assert!(materials(0.5, false, half).contains("weight = 0.25"));
    let by_texture = materials(0.5, true, none);
    assert!(
        by_texture.contains("channel = \"red\"") && by_texture.contains("factors = [0.5, "),
        "{by_texture}"
    );
    let by_metal = materials(1.0, false, image);
    assert!(
        by_metal.contains("channel = \"blue\"") && by_metal.contains("thin_dielectric"),
        "{by_metal}"
    );
    // All metal: nothing is transmitted.
    assert!(!materials(1.0, true, json!({})).contains("thin_dielectric"));
}

/// Metals, gloss, transmission, volumes, holes, normal maps and emission in all combinations.
#[test]
fn all_combinations_of_materials_are_scenes() {
    let registry = whitstone::registry();
    let folder = tempfile::tempdir().unwrap();
    let shares = [0.0, 0.5, 1.0];
    for case in 0..3 * 3 * 3 * 2 * 2 * 2 * 3 {
        let mut rest = case;
        let mut one_of = |count: usize| {
            let chosen = rest % count;
            rest /= count;
            chosen
        };
        let mut material = json!({
            "pbrMetallicRoughness": { "metallicFactor": shares[one_of(3)], "roughnessFactor": shares[one_of(3)],
                                      "baseColorFactor": [0.8, 0.5, 0.3, 0.5] },
            "extensions": { "KHR_materials_transmission": { "transmissionFactor": shares[one_of(3)] } },
        });
        if one_of(2) == 1 {
            material["extensions"]["KHR_materials_volume"] = json!({ "thicknessFactor": 1 });
        }
        if one_of(2) == 1 {
            material["normalTexture"] = json!({ "index": 0 });
        }
        if one_of(2) == 1 {
            material["emissiveFactor"] = json!([1, 0.5, 0]);
        }
        material["alphaMode"] = json!(["OPAQUE", "MASK", "BLEND"][one_of(3)]);
        let mut document = rich();
        let text = material.to_string();
        document["materials"] = json!([material, {}]);
        let path = write(folder.path(), "case.gltf", &document);
        assert_eq!(wrong(&path, &registry), None, "{text}");
    }
}

/// What a base colour tints on its way through a volume, the volume absorbs.
#[test]
fn the_base_colour_of_a_volume_is_absorbed() {
    let registry = whitstone::registry();
    let folder = tempfile::tempdir().unwrap();
    let glass = |base: Value, volume: Value| {
        let mut document = rich();
        let extensions = json!({ "KHR_materials_transmission": { "transmissionFactor": 1 }, "KHR_materials_volume": volume });
        let metal = json!({ "metallicFactor": 0, "baseColorFactor": base });
        document["materials"] = json!([{ "pbrMetallicRoughness": metal, "extensions": extensions }, {}]);
        document["meshes"][0]["primitives"][0]["attributes"] = json!({ "POSITION": 0 });
        let path = write(folder.path(), "glass.gltf", &document);
        let scene = imported(&path, &ImportOptions::all(), &registry);
        let materials = scene["material"].as_table().unwrap().values();
        let glass = materials.filter_map(|material| material.get("absorption")).next();
        // Grey is one number.
        match glass.unwrap() {
            toml::Value::Array(parts) => [0, 1, 2].map(|part| parts[part].as_float().unwrap()),
            grey => [grey.as_float().unwrap(); 3],
        }
    };
    let close = |found: [f64; 3], expected: [f64; 3]| {
        let far = found.iter().zip(expected).any(|(a, b)| (a - b).abs() > 1e-6);
        assert!(!far, "{found:?} {expected:?}");
    };
    let white = json!([1, 1, 1, 1]);
    let green = json!([0.25, 1, 0.5, 1]);
    let ln2 = std::f64::consts::LN_2;
    let clear = json!({ "thicknessFactor": 2 });
    close(glass(white.clone(), clear.clone()), [0.0; 3]);
    // A quarter and a half after 2 m; then also a half of everything after 1 m.
    close(glass(green.clone(), clear), [ln2, 0.0, ln2 / 2.0]);
    let half = json!({ "thicknessFactor": 2, "attenuationDistance": 1, "attenuationColor": [0.5, 0.5, 0.5] });
    close(glass(green, half.clone()), [2.0 * ln2, ln2, 1.5 * ln2]);
    close(glass(white, half), [ln2; 3]);
}

/// Extensions may say what a channel moves, and then it names no node.
#[test]
fn channels_of_animations_may_name_no_node() {
    let registry = whitstone::registry();
    let folder = tempfile::tempdir().unwrap();
    let mut document = rich();
    document["animations"] = json!([{
        "samplers": [{ "input": 0, "output": 1 }],
        "channels": [
            { "sampler": 0, "target": { "path": "pointer", "extensions": { "KHR_animation_pointer": { "pointer": "/materials/0/emissiveFactor" } } } },
            { "sampler": 0, "target": { "node": 0, "path": "translation" } },
        ],
    }]);
    let path = write(folder.path(), "pointer.gltf", &document);
    assert_eq!(wrong(&path, &registry), None);
    // Other errors keep their place.
    document["animations"][0]["channels"][1] = json!({ "sampler": 0 });
    let path = write(folder.path(), "target.gltf", &document);
    let report = wrong(&path, &registry).unwrap();
    assert!(report.contains("missing field `target`"), "{report}");
}

/// Names become ids, whatever characters they have.
#[test]
fn names_may_have_any_characters() {
    let registry = whitstone::registry();
    let folder = tempfile::tempdir().unwrap();
    for name in [
        "3'-0\" x 7'-0\"",
        "C:\\O'Brien\\wood.png",
        "two\nlines\t",
        "'''\"\"\"",
        "\u{7f}\u{1}\u{85}",
        "Größe.a b",
    ] {
        let mut document = rich();
        document["materials"][0]["name"] = json!(name);
        document["images"][0]["name"] = json!(name);
        document["meshes"][1]["name"] = json!(name);
        let path = write(folder.path(), "names.gltf", &document);
        assert_eq!(wrong(&path, &registry), None, "{name:?}");
        let scene = imported(&path, &ImportOptions::all(), &registry);
        let ids = scene["material"].as_table().unwrap();
        assert!(
            ids.keys().any(|id| id.contains(name)),
            "{name:?} is not among {ids:?}"
        );
    }
}

/// Every extension without effect is reported, so that `--strict` refuses the file.
#[test]
fn extensions_of_primitives_and_of_the_file_are_told() {
    let registry = whitstone::registry();
    let folder = tempfile::tempdir().unwrap();
    let mut document = rich();
    document["extensions"]["EXT_lights_image_based"] = json!({ "lights": [] });
    document["meshes"][0]["primitives"][0]["extensions"] = json!({
        "KHR_materials_variants": { "mappings": [{ "material": 1, "variants": [0] }] },
        "EXT_of_tomorrow": {},
    });
    let path = write(folder.path(), "extensions.gltf", &document);
    let format = registry.format_of(&path).unwrap();
    let imported = format.import(&path, &ImportOptions::all()).unwrap().unwrap();
    let names: Vec<&str> = imported.notes.iter().map(|note| note.feature.name).collect();
    for expected in [
        "EXT_lights_image_based",
        "KHR_materials_variants",
        "unknown extensions",
    ] {
        assert!(names.contains(&expected), "{expected} is not among {names:?}");
    }
}

#[test]
fn nodes_that_are_not_visible_are_left_out() {
    let registry = whitstone::registry();
    let folder = tempfile::tempdir().unwrap();
    let mut document = rich();
    let shapes = |document: &Value| {
        let path = write(folder.path(), "nodes.gltf", document);
        imported(&path, &ImportOptions::all(), &registry)["shape"]
            .as_array()
            .unwrap()
            .len()
    };
    let all = shapes(&document);
    document["nodes"][0]["extensions"] = json!({ "KHR_node_visibility": { "visible": false } });
    assert!(shapes(&document) < all);
    document["nodes"][0]["extensions"] = json!({ "KHR_node_visibility": { "visible": true } });
    assert_eq!(shapes(&document), all);
}

#[test]
fn required_extensions_of_materials_are_no_error() {
    let registry = whitstone::registry();
    let folder = tempfile::tempdir().unwrap();
    let mut document = rich();
    document["extensionsRequired"] = json!(["KHR_materials_clearcoat", "KHR_node_visibility"]);
    let path = write(folder.path(), "required.gltf", &document);
    assert_eq!(wrong(&path, &registry), None);
    for name in ["KHR_texture_basisu", "EXT_meshopt_compression", "VENDOR_anything"] {
        document["extensionsRequired"] = json!([name]);
        let path = write(folder.path(), "required.gltf", &document);
        let told = wrong(&path, &registry).unwrap();
        assert!(
            told.contains("/extensionsRequired/0") && told.contains(name),
            "{told}"
        );
    }
}

/// `convert` keeps its input, and a strict run that would drop something writes nothing.
#[test]
fn convert_overwrites_no_input_and_strict_runs_write_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let path = write(folder.path(), "rich.gltf", &rich());
    let before = fs::read(&path).unwrap();
    let convert = |to: &str, more: &[&str]| {
        let output = program!()
            .current_dir(folder.path())
            .args(["convert", "rich.gltf", to])
            .args(more)
            .output()
            .unwrap();
        let told = String::from_utf8_lossy(&output.stderr).into_owned();
        (output.status.code(), told)
    };
    let (code, told) = convert("rich.gltf", &[]);
    assert_eq!(code, Some(2), "{told}");
    assert!(told.contains("the scene reads this file"), "{told}");
    assert_eq!(fs::read(&path).unwrap(), before);
    // PBRT has no counterpart of some of this.
    let (code, told) = convert("strict.pbrt", &["--strict"]);
    assert_eq!(code, Some(2), "{told}");
    assert!(told.contains("--strict forbids it"), "{told}");
    assert_eq!(whitstone_tests::entries(folder.path()), ["rich.gltf"]);
    let (code, told) = convert("rich.toml", &["--strict"]);
    assert_eq!(code, Some(0), "{told}");
}

/// The places of all numbers in a document.
fn numbers(value: &Value, at: &str, found: &mut Vec<String>) {
    match value {
        Value::Number(_) => found.push(at.to_owned()),
        Value::Array(items) => {
            for (number, item) in items.iter().enumerate() {
                numbers(item, &format!("{at}/{number}"), found);
            }
        }
        Value::Object(map) => {
            for (key, item) in map {
                numbers(item, &format!("{at}/{key}"), found);
            }
        }
        _ => {}
    }
}

/// 10,000 documents in which one number is another one: no panic, and none takes long.
#[test]
fn files_with_one_changed_number_never_panic() {
    let registry = whitstone::registry();
    let folder = tempfile::tempdir().unwrap();
    let original = rich();
    let mut places = Vec::new();
    numbers(&original, "", &mut places);
    let values: Vec<Value> = [
        json!(-1),
        json!(0),
        json!(1),
        json!(2),
        json!(3),
        json!(4),
        json!(5),
        json!(7),
        json!(11),
        json!(12),
        json!(13),
        json!(17),
        json!(100),
        json!(255),
        json!(256),
        json!(5120),
        json!(5121),
        json!(5122),
        json!(5123),
        json!(5125),
        json!(5126),
        json!(65535),
        json!(65536),
        json!(1 << 27),
        json!((1_u64 << 31) - 1),
        json!(1_u64 << 31),
        json!(u64::from(u32::MAX)),
        json!(1_u64 << 32),
        json!(1_u64 << 53),
        json!(1_u64 << 62),
        json!(u64::MAX),
        json!(i64::MIN),
        json!(0.5),
        json!(-0.25),
        json!(1e-30),
        json!(1e30),
        json!(1e300),
        json!(-1e300),
        json!(1e-300),
        json!(f64::MIN_POSITIVE),
        json!(3.4e38),
        json!(6),
        json!(8),
        json!(9),
        json!(10),
        json!(16),
        json!(20),
        json!(32),
        json!(48),
        json!(64),
        json!(127),
        json!(128),
        json!(1000),
        json!(33071),
        json!(9729),
        json!(-2),
        json!(3.5e38),
        json!(9728),
        json!(9984),
        json!(33648),
    ]
    .to_vec();
    let all = places.len() * values.len();
    assert!(all >= 10_000, "{all}");
    let step = all / 10_000;
    let (mut tried, mut accepted, mut longest) = (0, 0, Duration::ZERO);
    for number in (0..all).step_by(step) {
        let (place, value) = (&places[number / values.len()], &values[number % values.len()]);
        let mut document = original.clone();
        *document.pointer_mut(place).unwrap() = value.clone();
        // Another name each time: an opened document is known by its name, time and length.
        let path = write(folder.path(), &format!("{number}.gltf"), &document);
        let start = Instant::now();
        let report = wrong(&path, &registry);
        let took = start.elapsed();
        assert!(took < whitstone_tests::ENDLESS, "{place} = {value} took {took:?}");
        longest = longest.max(took);
        fs::remove_file(&path).unwrap();
        accepted += usize::from(report.is_none());
        tried += 1;
    }
    println!("{tried} files, {accepted} accepted, at most {longest:?}");
    assert!(tried >= 10_000 && accepted > tried / 20 && accepted < tried * 19 / 20);
}

fn files_below(folder: &Path, found: &mut Vec<PathBuf>) {
    let mut entries: Vec<PathBuf> = fs::read_dir(folder)
        .into_iter()
        .flatten()
        .flatten()
        .map(|entry| entry.path())
        .collect();
    entries.sort();
    for path in entries {
        if path.is_dir() {
            files_below(&path, found);
        } else if path
            .extension()
            .is_some_and(|extension| extension == "gltf" || extension == "glb")
        {
            found.push(path);
        }
    }
}

#[test]
fn public_models_are_scenes() {
    let Some(folder) = test_data("gltf") else { return };
    let registry = whitstone::registry();
    let mut files = Vec::new();
    files_below(&folder.join("sample-assets"), &mut files);
    for path in &files {
        if let Some(report) = wrong(path, &registry) {
            panic!("{}: {report}", path.display());
        }
    }
    println!("{} files", files.len());
}

/// Files that the official validator finds faulty, beside its reports: refused, or loaded where the
/// fault touches nothing in use.
#[test]
fn faulty_public_files_do_no_harm() {
    let Some(folder) = test_data("gltf") else { return };
    let registry = whitstone::registry();
    let mut files = Vec::new();
    files_below(&folder.join("validator-negative"), &mut files);
    for path in &files {
        let start = Instant::now();
        let report = wrong(path, &registry);
        assert!(start.elapsed() < whitstone_tests::ENDLESS, "{}", path.display());
        println!(
            "{}: {}",
            path.file_name().unwrap_or_default().to_string_lossy(),
            report
                .as_deref()
                .map_or("loaded", |report| report.lines().next().unwrap_or_default())
        );
    }
}
