//! Scenes are exported, and imported again.

use super::geometry::triangles;
use super::*;
use crate::Gltf;
use std::fs;
use whitstone_core::{ImportOptions, Imported, Registry, SceneFormat};
use whitstone_scene::Sources;

const HEAD: &str = "[film]\nwidth = 40\nheight = 20\n[camera]\ntype = 'perspective'\nfov = 30\nfov_axis = 'smaller'\n\
                    look_at = { origin = [0, 1, 5], target = [0, 1, 0] }\n";

/// A scene in a folder, exported to another one.
struct Exported {
    folder: tempfile::TempDir,
    path: PathBuf,
    document: Table,
    notes: Vec<Note>,
}

/// Exports a scene that names these files.
fn export_with(text: &str, extension: &str, files: &[(&str, &[u8])]) -> Exported {
    let folder = tempfile::tempdir().unwrap();
    let base = folder.path().join("from");
    fs::create_dir_all(&base).unwrap();
    for (name, bytes) in files {
        fs::write(base.join(name), bytes).unwrap();
    }
    let out = folder.path().join("to");
    fs::create_dir_all(&out).unwrap();
    let path = out.join(format!("scene.{extension}"));
    let document: Table = text.parse().unwrap();
    let scene = ExportScene {
        document: &document,
        base: &base,
    };
    let notes = Gltf.export(&scene, &path).unwrap().unwrap();
    Exported {
        folder,
        path,
        document,
        notes,
    }
}

fn export(text: &str) -> Exported {
    export_with(text, "gltf", &[])
}

impl Exported {
    fn import_with(&self, options: &ImportOptions) -> (Table, Imported) {
        let imported = Gltf.import(&self.path, options).unwrap().unwrap();
        (imported.text.parse().unwrap(), imported)
    }

    fn import(&self) -> Table {
        self.import_with(&ImportOptions::all()).0
    }

    fn json(&self) -> serde_json::Value {
        serde_json::from_str(&whitstone_gltf::Document::text(&self.path).unwrap()).unwrap()
    }

    /// The file with changed JSON.
    fn change(&self, change: impl FnOnce(&mut serde_json::Value)) {
        let mut json = self.json();
        change(&mut json);
        fs::write(&self.path, json.to_string()).unwrap();
    }

    fn noted(&self, feature: &str) -> bool {
        self.notes.iter().any(|note| note.feature.name == feature)
    }
}

/// Shapes, and the feature that is reported if other programs do not show them.
const SHAPES: [(&str, Option<&str>); 29] = [
    ("type = 'rectangle'", None),
    (
        "type = 'box'\ntransform = [{ scale = [1, 2, 3] }, { rotate = { axis = [1, 1, 0], degrees = 30 } }]",
        None,
    ),
    (
        "type = 'box'\ntransform = [{ rotate = { axis = [1, 1, 0], degrees = 30 } }, { scale = [1, 2, -3] }]",
        None,
    ),
    (
        "type = 'triangle'\nvertices = [[0, 0, 0], [1, 0, 0.1], [0, 1, 0]]",
        None,
    ),
    (
        "type = 'triangle'\nvertices = [[0, 0, 0], [1, 0, 0], [0, 1, 0]]\nuvs = [[0, 0], [1, 0.25], [0, 1]]\n\
         normals = [[0, 0, 2], [0, 0.1, 1], [0.1, 0, 1]]",
        None,
    ),
    (
        "type = 'polygon'\nvertices = [[0, 0, 0], [2, 0, 0], [2, 2, 0], [1, 0.5, 0], [0, 2, 0]]",
        None,
    ),
    ("type = 'heightfield'\ncolumns = 5\nrows = 3\nseed = 2", None),
    (
        "type = 'sphere'\nradius = 0.1",
        Some("[[shape]] without triangles"),
    ),
    ("type = 'plane'", Some("[[shape]] without triangles")),
    ("type = 'disk'", Some("[[shape]] without triangles")),
    (
        "type = 'torus'\nmajor_radius = 2",
        Some("[[shape]] without triangles"),
    ),
    (
        "type = 'patch'\nvertices = [[0, 0, 0]]\npatches = []",
        Some("[[shape]] without triangles"),
    ),
    (
        "type = 'isosurface'\nsize = [2, 2, 2]\nvalues = [0, 1, 0, 1, 0, 0.5, 0.25, 1]",
        Some("[[shape]] without triangles"),
    ),
    (
        "type = 'implicit'\nfield = { sphere = { radius = 1 } }",
        Some("[[shape]] without triangles"),
    ),
    (
        "type = 'fractal'\nkind = 'mandelbulb'",
        Some("[[shape]] without triangles"),
    ),
    (
        "type = 'ellipsoid'\nradii = [1, 2, 3]",
        Some("[[shape]] without triangles"),
    ),
    (
        "type = 'cylinder'\ncaps = false",
        Some("[[shape]] without triangles"),
    ),
    ("type = 'cone'", Some("[[shape]] without triangles")),
    ("type = 'paraboloid'", Some("[[shape]] without triangles")),
    ("type = 'hyperboloid'", Some("[[shape]] without triangles")),
    (
        "type = 'prism'\noutline = [[0, 0], [1, 0], [0, 1]]",
        Some("[[shape]] without triangles"),
    ),
    (
        "type = 'lathe'\noutline = [[1, 0], [0.5, 1]]",
        Some("[[shape]] without triangles"),
    ),
    (
        "type = 'quadric'\ncoefficients = [1, 1, 1, 0, 0, 0, 0, 0, 0, -1]",
        Some("[[shape]] without triangles"),
    ),
    (
        "type = 'csg'\noperation = 'union'\noperands = [{ type = 'box' }, { type = 'sphere', radius = 1.2 }]",
        Some("[[shape]] without triangles"),
    ),
    (
        "type = 'of_a_third_party'\nlist = [1, 2.5, 'x', true, { a = 1.0 }]",
        Some("[[shape]] without triangles"),
    ),
    (
        "type = 'instance'\ngroup = 'g'\ntransform = { translate = [1, 2, 3] }",
        Some("[[shape]] without triangles"),
    ),
    (
        "type = 'instance'\ngroup = 'nested'",
        Some("[[shape]] without triangles"),
    ),
    ("type = 'rectangle'\nid = 'a b'", None),
    (
        "type = 'box'\nmaterial = { type = 'matte', reflectance = [0.1, 0.2, 0.3] }",
        None,
    ),
];

const GROUPS: &str = "[[group.g.shape]]\ntype = 'box'\ntransform = { scale = 0.5 }\n[[group.g.shape]]\ntype = 'sphere'\n\
                      [[group.nested.shape]]\ntype = 'instance'\ngroup = 'g'\n\
                      [[group.unplaced.shape]]\ntype = 'mesh'\nfile = 'missing.ply'\n";

#[test]
fn shapes_come_back_exactly() {
    for (shape, feature) in SHAPES {
        for extension in ["gltf", "glb"] {
            let text = format!("{HEAD}{GROUPS}[[shape]]\n{shape}\n");
            let exported = export_with(&text, extension, &[]);
            assert_eq!(exported.import(), exported.document, "{shape}");
            if let Some(feature) = feature {
                assert!(exported.noted(feature), "{shape}");
            } else {
                assert!(!exported.noted("[[shape]] without triangles"), "{shape}");
            }
        }
    }
}

const TABLES: [&str; 42] = [
    "[[light]]\ntype = 'point'\nposition = [1, 2, 3]\nintensity = [1, 2, 3]\nfalloff = 'none'",
    "[[light]]\ntype = 'directional'\ndirection = [1, -2, 3]\nirradiance = 2",
    "[[light]]\ntype = 'spot'\nposition = [1, 2, 3]\ntarget = [0, 0, 0]\nintensity = 5",
    "[[light]]\ntype = 'projector'\nposition = [1, 2, 3]\ntarget = [0, 0, 0]\nintensity = 5\nimage = { type = 'checker' }",
    "[[light]]\ntype = 'area'\nradiance = 2\ntransform = { translate = [0, 3, 0] }",
    "[[light]]\ntype = 'area'\nradiance = 2\nfalloff = 'none'",
    "[[light]]\ntype = 'spot'\nposition = [1, 2, 3]\ntarget = [0, 0, 0]\nintensity = 5\nimage = { type = 'checker' }",
    "[[shape]]\ntype = 'box'\n[[shape]]\ntype = 'heightfield'\ncolumns = 2\nrows = 2\nheight = { type = 'noise' }\nscale = 2",
    "[[light]]\ntype = 'ambient'\nradiance = 0.25",
    "[[light]]\ntype = 'background'\nradiance = [0.1, 0.2, 0.30000000000000004]",
    "[[light]]\ntype = 'environment'\nradiance = { type = 'gradient' }\nsamples = 2",
    "[sampler]\ntype = 'sobol'\nsamples = 16",
    "[integrator]\ntype = 'whitted'\nmax_depth = 3\nmin_contribution = 1e-3",
    "[accelerator]\ntype = 'bvh'",
    "[expect]\nmax_error = 0.5",
    "[[shape]]\ntype = 'box'\nmaterial = 'm'\n[material.m]\ntype = 'phong'\nk_d = [0.1, 0.2, 0.3]\nexponent = 10",
    "[[shape]]\ntype = 'box'\nmaterial = 'm'\n[material.m]\ntype = 'blinn_phong'\n[material.unused]\ntype = 'matte'",
    "[[shape]]\ntype = 'box'\nmaterial = { type = 'whitted', k_d = 0.1, k_refl = 0.5 }",
    "[[shape]]\ntype = 'box'\nmaterial = { type = 'whitted', k_refr = 0.5, interior_ior = 1.1 }",
    "[[shape]]\ntype = 'box'\nmaterial = { type = 'mirror', reflectance = 0.9 }",
    "[[shape]]\ntype = 'box'\nmaterial = { type = 'glossy', exponent = 30 }",
    "[[shape]]\ntype = 'box'\nmaterial = { type = 'conductor', metal = 'Au' }",
    "[[shape]]\ntype = 'box'\nmaterial = { type = 'conductor', eta = 1, k = [2, 3, 4], tint = 0.5 }",
    "[[shape]]\ntype = 'box'\nmaterial = { type = 'dielectric', absorption = [0, 1, 2], priority = 3 }",
    "[[shape]]\ntype = 'box'\nmaterial = { type = 'dielectric', interior_ior = 1.0, exterior_ior = 1.5 }",
    "[[shape]]\ntype = 'box'\nmaterial = { type = 'thin_dielectric', tint = [0.5, 1, 1] }",
    "[[shape]]\ntype = 'box'\nmaterial = { type = 'emissive', radiance = [3, 2, 1], material = { type = 'matte' } }",
    "[[shape]]\ntype = 'box'\nmaterial = { type = 'mask', opacity = 0.25, material = { type = 'matte' } }",
    "[[shape]]\ntype = 'box'\nmaterial = { type = 'mask', material = 'm', opacity = { type = 'checker' } }\n[material.m]\ntype = 'mirror'",
    "[[shape]]\ntype = 'box'\nmaterial = { type = 'mix', a = { type = 'matte' }, b = { type = 'mirror' }, weight = 0.3 }",
    "[[shape]]\ntype = 'box'\nmaterial = { type = 'two_sided', front = { type = 'matte' }, back = { type = 'mirror' } }",
    "[[shape]]\ntype = 'box'\nmaterial = { type = 'reflection_map', radiance = [1, 2, 3], material = { type = 'mirror' } }",
    "[[shape]]\ntype = 'box'\nmaterial = { type = 'normal_map', map = [0.5, 0.6, 1], material = { type = 'matte' } }",
    "[[shape]]\ntype = 'box'\nmaterial = { type = 'bump', height = { type = 'noise' }, material = { type = 'matte' } }",
    "[[shape]]\ntype = 'box'\nmaterial = { type = 'matte', reflectance = 't' }\n[texture.t]\ntype = 'checker'\na = [1, 0, 0]",
    "[[shape]]\ntype = 'box'\nmaterial = { type = 'matte', reflectance = { type = 'gradient', stops = [{ at = 0, color = 1 }, { at = 1, color = [0, 1, 0] }] } }",
    "[[shape]]\ntype = 'box'\nmaterial = { type = 'matte', reflectance = { type = 'product', factors = [0.5, { type = 'constant', value = 0.5 }] } }",
    "[[shape]]\ntype = 'box'\nmaterial = { type = 'matte', reflectance = { type = 'mix', a = 1, b = [0, 0, 1], weight = 0.25 } }",
    "[[shape]]\ntype = 'box'\nmaterial = { type = 'matte', reflectance = { type = 'threshold', input = { type = 'worley' } } }",
    "[[shape]]\ntype = 'box'\nmaterial = { type = 'matte', reflectance = { type = 'solid', size = [1, 1, 1], values = [0.5] } }",
    "[[shape]]\ntype = 'box'\nmaterial = { type = 'matte', reflectance = { type = 'vertex_color' } }",
    "[[shape]]\ntype = 'box'\nmaterial = { type = 'of_a_third_party', a = 'x' }",
];

#[test]
fn lights_materials_and_textures_come_back_exactly() {
    for table in TABLES {
        let exported = export(&format!("{HEAD}{table}\n"));
        assert_eq!(exported.import(), exported.document, "{table}");
        // Other programs can read the file, too.
        exported.change(|json| drop(json.as_object_mut().unwrap().remove("extras")));
        if table.contains("[[shape]]") {
            exported.import();
        }
    }
}

#[test]
fn cameras_come_back_exactly_and_other_programs_see_the_same_view() {
    let look = "look_at = { origin = [1, 2, 5], target = [0, 1, 0] }";
    let cameras = [
        (
            "type = 'perspective'\nfov = 30\nfov_axis = 'y'\nnear = 0.5",
            "[0.0, 0.0]",
        ),
        (
            "type = 'perspective'\nwindow = { l = -1, r = 1, b = -0.5, t = 0.5, d = 2 }",
            "",
        ),
        (
            "type = 'perspective'\nwindow = { l = -1, r = 2, b = -0.5, t = 0.5 }",
            "[camera] window that is not centred",
        ),
        (
            "type = 'thin_lens'\naperture = 0.1\nfocus_distance = 3",
            "[camera] thin_lens",
        ),
        ("type = 'environment'", "[camera] of another type"),
        ("type = 'orthographic'\nwidth = 3\nnear = -1", ""),
        (
            "type = 'orthographic'\nwindow = { l = 0, r = 4, b = 1, t = 3 }",
            "",
        ),
    ];
    for (camera, feature) in cameras {
        let text =
            format!("[film]\nwidth = 40\nheight = 20\n[camera]\n{camera}\n{look}\n[[shape]]\ntype = 'box'\n");
        let exported = export(&text);
        assert_eq!(exported.import(), exported.document, "{camera}");
        assert!(
            feature.is_empty() || feature.starts_with("[0") || exported.noted(feature),
            "{camera}"
        );
    }
    let text = format!("{HEAD}near = 0.5\n[[shape]]\ntype = 'box'\n");
    let exported = export(&text);
    exported.change(|json| drop(json.as_object_mut().unwrap().remove("extras")));
    let again = exported.import();
    let camera = again["camera"].as_table().unwrap();
    assert_eq!(camera["fov_axis"].as_str(), Some("y"));
    assert!((table::number(camera, "fov").unwrap() - 30.0).abs() < 1e-4);
    assert_eq!(camera["near"].as_float(), Some(0.5));
    let look_at = camera["look_at"].as_table().unwrap();
    assert_eq!(table::vector(look_at, "origin"), Some(DVec3::new(0.0, 1.0, 5.0)));
    assert_eq!(table::vector(look_at, "target"), Some(DVec3::new(0.0, 1.0, 4.0)));
    assert_eq!(again["film"]["height"].as_integer(), Some(256));
}

#[test]
fn other_programs_see_materials_and_lights() {
    let text = format!(
        "{HEAD}[[light]]\ntype = 'spot'\nposition = [0, 4, 0]\ntarget = [0, 0, 0]\nintensity = [2, 4, 1]\n\
         cutoff_angle = 30\nbeam_width = 10\n\
         [[shape]]\ntype = 'box'\nmaterial = 'matte'\n[[shape]]\ntype = 'box'\nmaterial = 'mirror'\n\
         [[shape]]\ntype = 'box'\nmaterial = 'glass'\n[[shape]]\ntype = 'box'\nmaterial = 'lamp'\n\
         [[shape]]\ntype = 'box'\nmaterial = 'mask'\n[[shape]]\ntype = 'box'\nmaterial = 'gold'\n\
         [material.matte]\ntype = 'matte'\nreflectance = [0.1, 0.2, 0.3]\n\
         [material.mirror]\ntype = 'mirror'\nreflectance = 0.9\n\
         [material.glass]\ntype = 'dielectric'\ninterior_ior = 1.3\nabsorption = [1, 2, 0]\n\
         [material.lamp]\ntype = 'emissive'\nradiance = [4, 2, 1]\n\
         [material.mask]\ntype = 'mask'\nopacity = 0.25\nmaterial = 'matte'\n\
         [material.gold]\ntype = 'conductor'\nmetal = 'Au'\n"
    );
    let exported = export(&text);
    let json = exported.json();
    let named = |name: &str| {
        let all = json["materials"].as_array().unwrap();
        all.iter()
            .find(|material| material["name"] == name)
            .unwrap()
            .clone()
    };
    let pbr = |name: &str| named(name)["pbrMetallicRoughness"].clone();
    assert_eq!(pbr("matte")["baseColorFactor"], json!([0.1, 0.2, 0.3, 1.0]));
    // Without a coat, which glTF has otherwise.
    let coat = |name: &str| named(name)["extensions"]["KHR_materials_specular"].clone();
    assert_eq!(coat("matte"), json!({ "specularFactor": 0.0 }));
    assert!(coat("mirror").is_null() && coat("glass").is_null());
    assert!(exported.noted("[material] mirror"));
    assert_eq!(
        (&pbr("matte")["metallicFactor"], &pbr("matte")["roughnessFactor"]),
        (&json!(0.0), &json!(1.0))
    );
    assert_eq!(
        (
            &pbr("mirror")["metallicFactor"],
            &pbr("mirror")["roughnessFactor"]
        ),
        (&json!(1.0), &json!(0.0))
    );
    assert!(pbr("gold")["baseColorFactor"][0].as_f64().unwrap() > 0.9);
    let glass = &named("glass")["extensions"];
    assert_eq!(glass["KHR_materials_ior"]["ior"], json!(1.3));
    assert_eq!(glass["KHR_materials_volume"]["attenuationDistance"], json!(0.5));
    assert_eq!(named("lamp")["emissiveFactor"], json!([1.0, 0.5, 0.25]));
    assert_eq!(
        named("lamp")["extensions"]["KHR_materials_emissive_strength"]["emissiveStrength"],
        json!(4.0)
    );
    assert_eq!(named("mask")["alphaMode"], "BLEND");
    assert_eq!(pbr("mask")["baseColorFactor"][3], json!(0.25));
    // Without the extras this importer is another program.
    exported.change(|json| drop(json.as_object_mut().unwrap().remove("extras")));
    let again = exported.import();
    let glass = again["material"]["glass"].as_table().unwrap();
    assert_eq!(table::kind(glass), "dielectric");
    let absorption = table::color(glass, "absorption", [9.0; 3]);
    assert!(DVec3::from(absorption).abs_diff_eq(DVec3::new(1.0, 2.0, 0.0), 1e-5));
    let light = again["light"][0].as_table().unwrap();
    assert_eq!(table::color(light, "intensity", [0.0; 3]), [2.0, 4.0, 1.0]);
    assert!((table::number(light, "cutoff_angle").unwrap() - 30.0).abs() < 1e-4);
    assert!(
        table::vector(light, "target")
            .unwrap()
            .abs_diff_eq(DVec3::new(0.0, 3.0, 0.0), 1e-6)
    );
}

const OBJ: &str = "v 0 0 0\nv 1 0 0 \nv 0 1.1 0\nv 0 0 1.3\nvn 0 0 -1\nvn 1 1 1\nvt 0.1 0.2\nvt 0.5 0.75\nusemtl one\n\
                   f 1/1/1 3/2/1 2/1/1\nf 2/2/2 3/1/2 4/2/2\nusemtl two\nf 1 2 4\nf 1 4 3 2\n";
const PLY: &str = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n\
                   property uchar red\nproperty uchar green\nproperty uchar blue\nelement face 1\n\
                   property list uchar int vertex_indices\nend_header\n0 0 0.1 255 0 51\n1 0 0 0 255 0\n0 1 0 0 0 255\n3 0 1 2\n";
const STL: &str = "solid a\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0.7\nendloop\nendfacet\nendsolid\n";

/// The corners of all triangles: positions, normals, texture coordinates, colours.
fn corners(shape: &Table, base: &Path) -> Vec<(DVec3, DVec3, [f32; 2], [f32; 4])> {
    let found = triangles(shape, base).unwrap();
    let vector =
        |list: &[[f32; 3]], k: usize| DVec3::from(list.get(k).map_or([0.0; 3], |v| v.map(f64::from)));
    let corner = |k: u32| {
        let k = k as usize;
        (
            vector(&found.positions, k),
            vector(&found.normals, k),
            found.uvs[0].get(k).copied().unwrap_or([0.0, 1.0]),
            found.colors.get(k).copied().unwrap_or([1.0; 4]),
        )
    };
    found.indices.iter().flatten().map(|k| corner(*k)).collect()
}

#[test]
fn meshes_of_files_come_back_in_single_precision() {
    let glb = export_with(
        &format!("{HEAD}[[shape]]\ntype = 'mesh'\nfile = 'a.obj'\n"),
        "glb",
        &[("a.obj", OBJ.as_bytes())],
    );
    let glb = fs::read(&glb.path).unwrap();
    let files: [(&str, &[u8]); 4] = [
        ("a.obj", OBJ.as_bytes()),
        ("a.ply", PLY.as_bytes()),
        ("a.stl", STL.as_bytes()),
        ("a.glb", &glb),
    ];
    let keys = [
        "file = 'a.obj'",
        "file = 'a.obj'\npart = 'one'\nshading = 'flat'",
        "file = 'a.obj'\npart = 'two'\nmaterial = { type = 'matte', reflectance = { type = 'checker' } }",
        "file = 'a.obj'\nuv_sets = []\ntransform = { scale = [1, 2, 1] }",
        "file = 'a.obj'\ntangents = true",
        "file = 'a.ply'\nvertex_colors = true\nmaterial = { type = 'matte', reflectance = { type = 'vertex_color' } }",
        "file = 'a.stl'",
        "file = 'a.glb'\nuv_sets = [0, 3]",
    ];
    for keys in keys {
        for extension in ["gltf", "glb"] {
            let exported = export_with(
                &format!("{HEAD}[[shape]]\ntype = 'mesh'\n{keys}\n"),
                extension,
                &files,
            );
            let mut again = exported.import();
            let shape = again["shape"][0].as_table_mut().unwrap();
            let name = exported.path.file_name().unwrap().to_str();
            assert_eq!(shape["file"].as_str(), name);
            let original = exported.document["shape"][0].as_table().unwrap();
            let before = corners(original, &exported.folder.path().join("from"));
            let after = corners(shape, &exported.folder.path().join("to"));
            assert_eq!(before.len(), after.len(), "{keys}");
            for (a, b) in before.iter().zip(&after) {
                assert!(
                    a.0.abs_diff_eq(b.0, 1e-6) && a.1.abs_diff_eq(b.1, 1e-6),
                    "{keys}: {a:?} {b:?}"
                );
                let near = |a: &[f32], b: &[f32]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-6);
                assert!(near(&a.2, &b.2) && near(&a.3, &b.3), "{keys}: {a:?} {b:?}");
            }
            // Nothing else has changed.
            for key in ["material", "transform", "shading", "tangents", "vertex_colors"] {
                assert_eq!(shape.get(key), original.get(key), "{keys}");
            }
            assert_eq!(
                fs::read_dir(exported.path.parent().unwrap()).unwrap().count(),
                if extension == "glb" { 1 } else { 2 },
                "{keys}"
            );
        }
    }
}

/// A .gltf file and its buffer: a triangle with all attributes.
fn all_attributes() -> (Vec<u8>, Vec<u8>) {
    let mut buffer = Buffer::default();
    let corners = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
    let attributes = json!({
        "POSITION": buffer.attribute(&corners, true),
        "NORMAL": buffer.attribute(&[[0.0, 0.0, 1.0]; 3], false),
        "TANGENT": buffer.attribute(&[[0.0, 1.0, 0.0, -1.0]; 3], false),
        "TEXCOORD_0": buffer.attribute(&[[0.0, 0.25], [0.5, 0.75], [1.0, 1.0]], false),
        "TEXCOORD_3": buffer.attribute(&[[0.75, 0.5], [0.5, 0.25], [1.0, 0.0]], false),
        "COLOR_0": buffer.attribute(&[[0.75, 0.5, 0.25, 0.5], [0.5, 0.25, 1.0, 1.0], [1.0; 4]], false),
    });
    let indices = buffer.indices(&[[0, 1, 2]], 3);
    let mesh = json!({ "primitives": [{ "attributes": attributes, "indices": indices }] });
    let file = json!({
        "asset": { "version": "2.0" },
        "meshes": [{ "primitives": [{ "attributes": {} }] }, mesh],
        "accessors": buffer.accessors,
        "bufferViews": buffer.views,
        "buffers": [{ "byteLength": buffer.bytes.len(), "uri": "a.bin" }],
    });
    (file.to_string().into_bytes(), buffer.bytes)
}

#[test]
fn all_attributes_of_a_gltf_mesh_come_back() {
    let (file, bytes) = all_attributes();
    let text = format!(
        "{HEAD}[[shape]]\ntype = 'mesh'\nfile = 'a.gltf'\nmesh = 1\nprimitive = 0\nuv_sets = [3, 0]\n\
         tangents = true\nvertex_colors = true\nmaterial = {{ type = 'normal_map', map = [0, 1, 0.5], tangent = 'mesh', \
         material = {{ type = 'matte', reflectance = {{ type = 'vertex_color' }} }} }}\n"
    );
    let exported = export_with(&text, "glb", &[("a.gltf", &file), ("a.bin", &bytes)]);
    let again = exported.import();
    let shape = again["shape"][0].as_table().unwrap();
    assert_eq!(shape["uv_sets"].to_string(), "[0, 1]");
    let original = exported.document["shape"][0].as_table().unwrap();
    let before = triangles(original, &exported.folder.path().join("from")).unwrap();
    assert_eq!(before.tangents, [[0.0, 1.0, 0.0, -1.0]; 3]);
    assert_eq!(before.uvs[0][0], [0.75, 0.5]);
    assert_eq!(before.uvs[1][0], [0.0, 0.25]);
    assert_eq!(before.colors[0], [0.75, 0.5, 0.25, 0.5]);
    assert_eq!(triangles(shape, &exported.folder.path().join("to")), Ok(before));
    let json = exported.json();
    let written = json["meshes"][0]["primitives"][0]["attributes"]
        .as_object()
        .unwrap();
    assert_eq!(written.len(), 6);
}

#[test]
fn instances_share_meshes() {
    let text = format!(
        "{HEAD}[[group.g.shape]]\ntype = 'box'\n[[group.g.shape]]\ntype = 'rectangle'\ntransform = {{ scale = 2 }}\n\
         [[group.one.shape]]\ntype = 'box'\n\
         [[group.both.shape]]\ntype = 'instance'\ngroup = 'g'\ntransform = {{ translate = [1, 0, 0] }}\n\
         [[group.both.shape]]\ntype = 'instance'\ngroup = 'one'\n\
         [[shape]]\ntype = 'instance'\ngroup = 'both'\n\
         [[shape]]\ntype = 'instance'\ngroup = 'both'\ntransform = {{ matrix = [[1, 0.5, 0, 3], [0, 1, 0, 0], [0, 0, 1, 0]] }}\n\
         [[shape]]\ntype = 'instance'\ngroup = 'one'\ntransform = {{ scale = [1, 1, -1] }}\n"
    );
    let exported = export(&text);
    let json = exported.json();
    // Equal shapes of different groups share one, too.
    assert_eq!(json["meshes"].as_array().unwrap().len(), 2);
    // The ordinary import finds every box at its place.
    exported.change(|json| drop(json.as_object_mut().unwrap().remove("extras")));
    let again = exported.import();
    let mut places: Vec<DVec3> = table::tables(&again, "shape")
        .into_iter()
        .filter(|shape| table::text(shape, "group") == Some("group.g.shape[0]"))
        .map(|shape| table::transform(shape).transform_point3(DVec3::new(0.0, 1.0, 1.0)))
        .collect();
    places.sort_by(|a, b| a.to_array().partial_cmp(&b.to_array()).unwrap());
    let expected = [
        [0.0, 1.0, -1.0],
        [0.0, 1.0, 1.0],
        [1.0, 1.0, 1.0],
        [3.5, 1.0, 1.0],
        [4.5, 1.0, 1.0],
    ];
    assert_eq!(places.len(), expected.len(), "{}", again);
    for (place, expected) in places.iter().zip(expected) {
        assert!(place.abs_diff_eq(expected.into(), 1e-6), "{places:?}");
    }
}

#[test]
fn meshes_that_change_keep_their_files() {
    let text = format!(
        "{HEAD}[[shape]]\ntype = 'mesh'\nfile = 'a.stl'\nsubdivision = {{ scheme = 'loop', levels = 2 }}\n\
         [[shape]]\ntype = 'mesh'\nfile = 'a.stl'\ndisplacement = {{ height = {{ type = 'noise' }} }}\n\
         [[shape]]\ntype = 'mesh'\nfile = 'b.stl'\n\
         [[light]]\ntype = 'area'\nshape = 'mesh'\nfile = 'b.stl'\nradiance = 1\n"
    );
    let files = [("a.stl", STL.as_bytes()), ("b.stl", STL.as_bytes())];
    let exported = export_with(&text, "glb", &files);
    assert!(exported.noted("[scene] files next to a .glb"));
    assert!(exported.noted("[[shape]] mesh with displacement"));
    let again = exported.import();
    for (table, file) in [
        (&again["shape"][0], "scene-files/a.stl"),
        (&again["shape"][1], "scene-files/a.stl"),
        (&again["shape"][2], "scene-files/b.stl"),
        (&again["light"][0], "scene-files/b.stl"),
    ] {
        assert_eq!(table["file"].as_str(), Some(file));
    }
    assert!(exported.folder.path().join("to/scene-files/a.stl").is_file());
    // Other programs see the subdivided mesh.
    let indices = exported.json()["meshes"][0]["primitives"][0]["indices"]
        .as_u64()
        .unwrap();
    assert_eq!(exported.json()["accessors"][indices as usize]["count"], json!(48));
}

#[test]
fn only_meshes_that_rounding_changes_are_approximated() {
    let noted = |offset: f64| {
        let text = format!("{HEAD}[[shape]]\ntype = 'mesh'\nfile = 'a.obj'\n");
        let obj = format!(
            "v {offset} 0 0\nv {} 0 0\nv {offset} 1 0\nf 1 2 3\n",
            offset + 1.0
        );
        let exported = export_with(&text, "gltf", &[("a.obj", obj.as_bytes())]);
        ["[[shape]] mesh", "[[shape]] mesh far from its own origin"].map(|name| exported.noted(name))
    };
    assert_eq!(noted(0.1), [true, false]);
    assert_eq!(noted(100.1), [false, true]);
}

#[test]
fn images_are_copied_or_embedded() {
    let image = "{ type = 'image', file = 'x y.png', scale = [2, 3], wrap = 'clamp', filter = 'nearest' }";
    let text = format!(
        "{HEAD}[[shape]]\ntype = 'box'\nmaterial = {{ type = 'matte', reflectance = {image} }}\n\
         [[light]]\ntype = 'environment'\nradiance = {{ type = 'image', file = 'sky.exr' }}\n\
         [texture.unused]\ntype = 'image'\nfile = 'missing.png'\n"
    );
    let png = b"\x89PNG\r\n\x1a\nnot decoded";
    let files: [(&str, &[u8]); 2] = [("x y.png", png), ("sky.exr", b"exr")];
    let exported = export_with(&text, "gltf", &files);
    let again = exported.import();
    let texture = &again["shape"][0]["material"]["reflectance"];
    assert_eq!(texture["file"].as_str(), Some("scene-files/x y.png"));
    assert_eq!(
        again["light"][0]["radiance"]["file"].as_str(),
        Some("scene-files/sky.exr")
    );
    assert_eq!(exported.json()["images"][0]["uri"], "scene-files/x%20y.png");
    let info = &exported.json()["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"];
    assert_eq!(
        info["extensions"]["KHR_texture_transform"]["scale"],
        json!([2.0, 3.0])
    );
    // The ordinary import maps the image as before.
    exported.change(|json| drop(json.as_object_mut().unwrap().remove("extras")));
    let textures = exported.import()["texture"].as_table().unwrap().clone();
    let map = table::transform(textures.values().next().unwrap()["mapping"].as_table().unwrap());
    assert!(
        map.abs_diff_eq(DAffine3::from_scale(DVec3::new(2.0, 3.0, 1.0)), 1e-6),
        "{map:?}"
    );

    let exported = export_with(&text, "glb", &files);
    let again = exported.import();
    let texture = &again["shape"][0]["material"]["reflectance"];
    assert_eq!(texture["file"].as_str(), Some("scene.glb"));
    let document = whitstone_gltf::Document::open(&exported.path).unwrap();
    assert_eq!(
        document
            .image(texture["image"].as_integer().unwrap() as usize)
            .unwrap(),
        png
    );
    assert_eq!(again["texture"]["unused"]["file"].as_str(), Some("missing.png"));
}

#[test]
fn a_changed_file_is_imported_as_that_of_another_program() {
    let text = format!("{HEAD}[[shape]]\ntype = 'box'\n[[shape]]\ntype = 'sphere'\n");
    let exported = export(&text);
    // Another order of keys and other white space are no change.
    exported.change(|_| {});
    assert_eq!(exported.import(), exported.document);
    exported.change(|json| json["materials"][0]["pbrMetallicRoughness"]["roughnessFactor"] = json!(0.5));
    let (again, imported) = exported.import_with(&ImportOptions::all());
    assert_eq!(again["shape"].as_array().unwrap().len(), 1);
    let noted = |imported: &Imported, name: &str| imported.notes.iter().any(|note| note.feature.name == name);
    assert!(noted(&imported, "Whitstone scene, changed"));
    // So is a changed buffer.
    let exported = export(&text);
    let buffer = exported.path.with_extension("bin");
    let mut bytes = fs::read(&buffer).unwrap();
    bytes[3] ^= 1;
    fs::write(&buffer, bytes).unwrap();
    let (_, imported) = exported.import_with(&ImportOptions::all());
    assert!(noted(&imported, "Whitstone scene, changed"));
    // The scene must not read other files.
    let exported = export_with(
        &format!("{HEAD}[[shape]]\ntype = 'isosurface'\nfile = 'a.raw'\nsize = [2, 2, 2]\n"),
        "gltf",
        &[("a.raw", b"0")],
    );
    exported.change(|json| json["extras"]["whitstone"]["scene"]["shape"][0]["file"] = json!("../from/a.raw"));
    let refused = Gltf.import(&exported.path, &ImportOptions::all()).unwrap();
    assert!(refused.unwrap_err().0[0].message.contains("outside"));
    // And a selected part.
    let exported = export(&text);
    let options = ImportOptions {
        node: Some("shape[0]".into()),
        ..ImportOptions::all()
    };
    let (again, imported) = exported.import_with(&options);
    assert!(noted(&imported, "Whitstone scene, in parts"));
    assert_eq!(again["shape"].as_array().unwrap().len(), 1);
}

#[test]
fn a_part_of_another_scene_has_its_prefix_and_place() {
    let text = format!(
        "{HEAD}[sampler]\ntype = 'grid'\n[[light]]\ntype = 'point'\nposition = [1, 0, 0]\nintensity = 1\n\
         [[group.g.shape]]\ntype = 'sphere'\nmaterial = 'm'\n\
         [[shape]]\ntype = 'instance'\ngroup = 'g'\nid = 'i'\ntransform = {{ scale = 2 }}\n\
         [[shape]]\ntype = 'plane'\nmaterial = {{ type = 'mix', a = 'm', b = 'n', weight = 't' }}\n\
         [material.m]\ntype = 'matte'\nreflectance = 't'\n[material.n]\ntype = 'matte'\n\
         [texture.t]\ntype = 'noise'\nkind = 'fbm'\n"
    );
    let exported = export(&text);
    let options = ImportOptions {
        prefix: "p/".into(),
        transform: DAffine3::from_translation(DVec3::Y) * DAffine3::from_scale(DVec3::splat(2.0)),
        part: true,
        materials: [("n".to_owned(), "mine".to_owned())].into(),
        ..ImportOptions::all()
    };
    let (again, _) = exported.import_with(&options);
    assert!(again.get("sampler").is_none());
    assert_eq!(
        table::vector(again["light"][0].as_table().unwrap(), "position"),
        Some(DVec3::new(2.0, 1.0, 0.0))
    );
    let instance = again["shape"][0].as_table().unwrap();
    assert_eq!(
        (instance["group"].as_str(), instance["id"].as_str()),
        (Some("p/g"), Some("p/i"))
    );
    assert_eq!(
        table::transform(instance).transform_point3(DVec3::X),
        DVec3::new(4.0, 1.0, 0.0)
    );
    let mix = &again["shape"][1]["material"];
    assert_eq!(
        ["a", "b", "weight"].map(|key| mix[key].as_str()),
        [Some("p/m"), Some("mine"), Some("p/t")]
    );
    assert_eq!(
        again["group"]["p/g"]["shape"][0]["material"].as_str(),
        Some("p/m")
    );
    assert!(again["group"]["p/g"]["shape"][0].get("transform").is_none());
    let material = again["material"].as_table().unwrap();
    assert_eq!(material.keys().collect::<Vec<_>>(), ["p/m"]);
    let texture = again["texture"]["p/t"].as_table().unwrap();
    assert_eq!(texture["kind"].as_str(), Some("fbm"));
    let map = table::transform(texture["mapping"].as_table().unwrap());
    assert_eq!(map.transform_point3(DVec3::new(2.0, 1.0, 0.0)), DVec3::X);
    let unknown = ImportOptions {
        materials: [("x".to_owned(), "y".to_owned())].into(),
        ..ImportOptions::all()
    };
    assert!(Gltf.import(&exported.path, &unknown).unwrap().is_err());
}

#[test]
fn moved_images_of_spots_turn_and_heights_stay_in_object_space() {
    let noise = "{ type = 'noise' }";
    let spot = "[[light]]\ntype = 'spot'\nposition = [1, 0, 0]\ntarget = [1, 0, -1]\nintensity = 1\n";
    let exported = export(&format!(
        "{HEAD}{spot}image = 't'\n{spot}[[shape]]\ntype = 'box'\n\
         [[shape]]\ntype = 'heightfield'\ncolumns = 2\nrows = 2\nheight = {noise}\n\
         [texture.t]\ntype = 'checker'\n"
    ));
    let options = ImportOptions {
        prefix: "p/".into(),
        transform: DAffine3::from_rotation_z(-std::f64::consts::FRAC_PI_2),
        part: true,
        ..ImportOptions::all()
    };
    let (again, _) = exported.import_with(&options);
    let [with, without] = [0, 1].map(|k| again["light"][k].as_table().unwrap());
    let up = table::vector(with, "up").unwrap();
    assert!((up - DVec3::X).length() < 1e-12, "{up}");
    assert_eq!(with["image"].as_str(), Some("p/t"));
    assert!(!without.contains_key("up"));
    let height = again["shape"][1]["height"].as_table().unwrap();
    assert!(!height.contains_key("mapping"));
}

/// A document without what names the files of its meshes and images.
fn without_files(value: &mut Value) {
    match value {
        Value::Array(items) => items.iter_mut().for_each(without_files),
        Value::Table(table) => {
            if table.contains_key("file") {
                for key in [
                    "file",
                    "image",
                    "part",
                    "mesh",
                    "primitive",
                    "uv_sets",
                    "skin",
                    "weights",
                ] {
                    table.remove(key);
                }
            }
            table.iter_mut().for_each(|(_, item)| without_files(item));
        }
        _ => {}
    }
}

/// Imports a file without its extras.
fn as_another_program(path: &Path) {
    let mut json: serde_json::Value = serde_json::from_slice(&fs::read(path).unwrap()).unwrap();
    json.as_object_mut().unwrap().remove("extras");
    let plain = path.with_extension("plain.gltf");
    fs::write(&plain, json.to_string()).unwrap();
    match Gltf.import(&plain, &ImportOptions::all()).unwrap() {
        Ok(imported) => drop(imported.text.parse::<Table>().unwrap()),
        Err(errors) => assert_eq!(
            errors.0[0].message,
            "the scene has no triangles",
            "{}",
            path.display()
        ),
    }
    fs::remove_file(plain).unwrap();
}

#[test]
fn all_scenes_of_the_repository_come_back() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../scenes");
    let mut registry = Registry::default();
    crate::register(&mut registry);
    let mut folders = vec![root];
    let mut scenes = Vec::new();
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
            } else if path.extension().is_some_and(|extension| extension == "toml") {
                scenes.push(path);
            }
        }
    }
    scenes.sort();
    let [mut exactly, mut in_single_precision] = [0, 0];
    for path in &scenes {
        // Scenes that are too large for a test.
        let sources = match Sources::load(path, &[], &registry) {
            Ok(sources) => sources,
            Err(error) => panic!("{}: {:?}", path.display(), error.errors),
        };
        let description = whitstone_scene::Description::parse(&sources)
            .into_result()
            .unwrap();
        let document: Table = description.flattened.text.parse().unwrap();
        let scene = ExportScene {
            document: &document,
            base: &description.flattened.base,
        };
        let large = document.to_string().contains("columns = ") && path.to_string_lossy().contains("scale");
        if large {
            continue;
        }
        let folder = match std::env::var_os("WHITSTONE_EXPORTS") {
            Some(folder) => PathBuf::from(folder),
            None => tempfile::tempdir().unwrap().keep(),
        };
        let stem = path.file_stem().unwrap().to_str().unwrap();
        let written = ["gltf", "glb"].map(|extension| {
            let out = folder.join(format!("{stem}.{extension}"));
            Gltf.export(&scene, &out)
                .unwrap()
                .unwrap_or_else(|error| panic!("{}: {error:?}", path.display()));
            Gltf.import(&out, &ImportOptions::all()).unwrap().unwrap()
        });
        let [_, imported] = written;
        as_another_program(&folder.join(format!("{stem}.gltf")));
        let mut again = Value::Table(imported.text.parse().unwrap());
        let normal = crate::document::Document::from_table(&document).to_toml();
        let mut expected = Value::Table(normal.parse().unwrap());
        if again == expected {
            exactly += 1;
        } else {
            without_files(&mut again);
            without_files(&mut expected);
            assert_eq!(again, expected, "{}", path.display());
            in_single_precision += 1;
        }
        if std::env::var_os("WHITSTONE_EXPORTS").is_none() {
            fs::remove_dir_all(folder).unwrap();
        }
    }
    println!(
        "{} scenes: {exactly} come back exactly, {in_single_precision} but for their files",
        scenes.len()
    );
}
