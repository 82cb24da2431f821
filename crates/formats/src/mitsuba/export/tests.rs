use super::*;
use crate::mitsuba::{Mitsuba, MitsubaPython};
use std::collections::BTreeSet;
use std::fs;
use whitstone_core::{ImportOptions, SceneFormat};

const HEAD: &str = "[film]\nwidth = 40\nheight = 20\n[camera]\ntype = 'perspective'\nfov = 30\nfov_axis = 'smaller'\n\
                    look_at = { origin = [0, 1, 5], target = [0, 1, 0] }\n";

struct Exported {
    _folder: tempfile::TempDir,
    path: PathBuf,
    text: String,
    notes: Vec<&'static str>,
}

fn export_with(extension: &str, scene: &str) -> Exported {
    let folder = tempfile::tempdir().unwrap();
    let base = folder.path().join("scenes");
    fs::create_dir(&base).unwrap();
    fs::write(
        base.join("m.obj"),
        "v 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl a\nf 1 2 3\nusemtl b\nf 3 2 1\n",
    )
    .unwrap();
    fs::write(base.join("a.png"), "not read").unwrap();
    fs::write(
        base.join("m.stl"),
        "solid m\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 0.1 0\nendloop\n\
         endfacet\nendsolid m\n",
    )
    .unwrap();
    let document: Table = toml::from_str(&format!("{HEAD}{scene}")).unwrap();
    let path = folder.path().join(format!("out.{extension}"));
    let scene = ExportScene {
        document: &document,
        base: &base,
    };
    let format: &dyn SceneFormat = if extension == "py" {
        &MitsubaPython
    } else {
        &Mitsuba
    };
    let notes = format.export(&scene, &path).unwrap().unwrap();
    Exported {
        text: fs::read_to_string(&path).unwrap(),
        notes: notes.iter().map(|note| note.feature.name).collect(),
        path,
        _folder: folder,
    }
}

fn exported(scene: &str) -> Exported {
    export_with("xml", scene)
}

/// The scene after export and import.
fn round_trip(scene: &str) -> Table {
    let exported = exported(scene);
    let imported = Mitsuba.import(&exported.path, &ImportOptions::all()).unwrap();
    let imported = imported.unwrap_or_else(|errors| panic!("{errors:?}\n{}", exported.text));
    toml::from_str(&imported.text).unwrap()
}

#[test]
fn a_scene_survives_export_and_import() {
    let scene = round_trip(
        "[integrator]\ntype = 'whitted'\nmax_depth = 3\n[[light]]\ntype = 'point'\nposition = [1, 2, 3]\nintensity = 4
         [[light]]\ntype = 'spot'\nposition = [0, 5, 0]\ntarget = [1, 0, 0]\nintensity = [1, 2, 3]\ncutoff_angle = 30
         [[light]]\ntype = 'directional'\ndirection = [0, -1, 0]\nirradiance = 2
         [[shape]]\ntype = 'sphere'\ncenter = [1, 0, 0]\nradius = 0.5\nmaterial = { type = 'dielectric', absorption = [0, 2, 4] }
         [[shape]]\ntype = 'rectangle'\nmaterial = { type = 'matte', reflectance = { type = 'checker', scale = 3, offset = [0.25, 0] } }
         [[shape]]\ntype = 'mesh'\nfile = 'm.obj'\ntransform = { scale = [-1, 1, 1] }\nmaterial = 'gold'
         [material.gold]\ntype = 'conductor'\nmetal = 'Au'",
    );
    let camera = &scene["camera"];
    assert_eq!(scene["film"]["width"].as_integer(), Some(40));
    let half = 15.0_f64.to_radians().tan() * 2.0;
    let fov = 2.0 * half.atan().to_degrees();
    assert!((camera["fov"].as_float().unwrap() - fov).abs() < 1e-9);
    assert_eq!(camera["look_at"]["origin"].to_string(), "[0.0, 1.0, 5.0]");
    assert_eq!(scene["integrator"]["max_depth"].as_integer(), Some(3));
    let lights = scene["light"].as_array().unwrap();
    assert_eq!(lights[0]["position"].to_string(), "[1.0, 2.0, 3.0]");
    assert_eq!(lights[1]["beam_width"].as_float(), Some(22.5));
    assert_eq!(lights[2]["irradiance"].as_float(), Some(2.0));
    let shapes = scene["shape"].as_array().unwrap();
    assert_eq!(shapes[0]["material"]["interior_ior"].as_float(), Some(1.5));
    assert_eq!(
        shapes[1]["material"]["reflectance"]["scale"].to_string(),
        "[3.0, 3.0]"
    );
    assert_eq!(
        shapes[1]["material"]["reflectance"]["offset"].to_string(),
        "[0.25, 0.0]"
    );
    assert_eq!(shapes[2]["file"].as_str(), Some("scenes/m.obj"));
    assert_eq!(scene["material"]["gold"]["eta"][0].as_float(), Some(0.14304));
}

/// A coat is Mitsuba's own, and rough metal and glass are its rough ones.
#[test]
fn plastic_and_rough_materials_are_written() {
    let shape = |material: &str| format!("[[shape]]\ntype = 'sphere'\nmaterial = {{ {material} }}");
    let plastic = shape("type = 'plastic', reflectance = [0.1, 0.2, 0.3], interior_ior = 1.4");
    let back = &round_trip(&plastic)["shape"][0]["material"];
    assert_eq!(
        (back["type"].as_str(), back["interior_ior"].as_float()),
        (Some("plastic"), Some(1.4))
    );
    assert_eq!(back["reflectance"].to_string(), "[0.1, 0.2, 0.3]");
    assert!(
        !exported(&plastic)
            .notes
            .iter()
            .any(|note| note.contains("plastic"))
    );
    let rough = |inner: &str| {
        exported(&shape(&format!(
            "type = 'rough', exponent = 50, material = {{ {inner} }}"
        )))
        .text
    };
    let metal = rough("type = 'conductor', metal = 'Cu'");
    let glass = rough("type = 'dielectric'");
    for text in [&metal, &glass] {
        let alpha = text.split("name=\"alpha\" value=\"").nth(1).unwrap();
        let alpha: f64 = alpha.split('"').next().unwrap().parse().unwrap();
        assert!((alpha * alpha - 2.0 / 202.0).abs() < 1e-9, "{alpha}");
    }
    assert!(
        metal.contains("roughconductor") && metal.contains("twosided"),
        "{metal}"
    );
    assert!(
        glass.contains("roughdielectric") && !glass.contains("twosided"),
        "{glass}"
    );
    assert!(rough("type = 'matte'").contains("type=\"diffuse\""));
}

/// The image of a spot light, upright and turned, has the same place after export and import.
#[test]
fn images_of_spots_survive_export_and_import() {
    for up in [[0.0, 0.0, -1.0], [0.6, 0.0, 0.8]] {
        let image = "image = { type = 'image', file = 'a.png', wrap = 'clamp' }";
        let text = format!(
            "[[light]]\ntype = 'spot'\nposition = [1, 5, 0]\ntarget = [1, 0, 0]\nintensity = 2\nup = {up:?}\n{image}"
        );
        let scene = round_trip(&text);
        let light = scene["light"][0].as_table().unwrap();
        let found = table::vector(light, "up").unwrap();
        assert!((found - DVec3::from(up)).length() < 1e-9, "{found}");
        let image = light["image"].as_table().unwrap();
        assert_eq!(image["file"].as_str(), Some("scenes/a.png"));
        assert!(!image.contains_key("scale") && !image.contains_key("mapping"));
        assert!(exported(&text).notes.is_empty() || exported(&text).notes == ["[sampler]"]);
    }
    // A colour becomes a factor of the intensity.
    let scene = round_trip(
        "[[light]]\ntype = 'spot'\nposition = [0, 5, 0]\ntarget = [1, 0, 0]\nintensity = [1, 2, 3]\nimage = 2",
    );
    assert_eq!(scene["light"][0]["intensity"].to_string(), "[2.0, 4.0, 6.0]");
    assert!(!scene["light"][0].as_table().unwrap().contains_key("image"));
}

#[test]
fn images_have_the_same_texture_coordinates() {
    let image = "reflectance = { type = 'image', file = 'a.png', color_space = 'linear', wrap = 'clamp', scale = [2, 3] }";
    let text = exported(&format!(
        "[[shape]]\ntype = 'rectangle'\nmaterial = {{ type = 'matte', {image} }}"
    ))
    .text;
    assert!(text.contains("<string name=\"filename\" value=\"scenes/a.png\"/>"));
    assert!(
        text.contains("<matrix value=\"2 0 0 0 0 -3 0 1 0 0 1 0 0 0 0 1\"/>"),
        "{text}"
    );
    assert!(text.contains("<boolean name=\"raw\" value=\"true\"/>"));
    // v of Mitsuba's spheres points down.
    let text = exported(&format!(
        "[[shape]]\ntype = 'sphere'\nmaterial = {{ type = 'matte', {image} }}"
    ))
    .text;
    assert!(
        text.contains("<matrix value=\"2 0 0 0 0 3 0 -2 0 0 1 0 0 0 0 1\"/>"),
        "{text}"
    );
    let cube = exported(&format!(
        "[[shape]]\ntype = 'box'\nmaterial = {{ type = 'matte', {image} }}"
    ))
    .text;
    assert_eq!(cube.matches("type=\"rectangle\"").count(), 6);
}

#[test]
fn area_lights_are_emitters_of_their_surfaces() {
    let light = "[[light]]\ntype = 'area'\nradiance = 5\ntransform = { translate = [0, 2, 0] }\n";
    let alone = exported(light);
    assert_eq!(alone.text.matches("<emitter type=\"area\">").count(), 1);
    let surface = "[[shape]]\ntype = 'rectangle'\ntransform = { translate = [0, 2, 0] }
                   material = { type = 'two_sided', front = { type = 'emissive', radiance = 5 }, back = 'm' }
                   [material.m]\ntype = 'matte'";
    let both = exported(&format!("{light}{surface}"));
    assert_eq!(both.text.matches("<emitter type=\"area\">").count(), 1);
    assert_eq!(both.notes, ["[[light]] area", "[sampler]"]);
}

#[test]
fn parts_and_triangles_are_written_as_meshes() {
    let parts = exported(
        "[[shape]]\ntype = 'mesh'\nfile = 'm.obj'\npart = 'b'\n[[shape]]\ntype = 'triangle'\nvertices = [[0, 0, 0], [1, 0, 0], [0, 1, 0.5]]",
    );
    let folder = parts.path.parent().unwrap();
    let part = fs::read_to_string(folder.join("out-mesh1.obj")).unwrap();
    assert!(part.contains("f 3 2 1") && !part.contains("f 1 2 3"));
    let triangle = fs::read_to_string(folder.join("out-mesh2.obj")).unwrap();
    assert_eq!(
        triangle,
        "v 0 0 0\nv 1 0 0\nv 0 1 0.5\nvt 0 0\nvt 1 0\nvt 0 1\nf 1/1 2/2 3/3\n"
    );
    let document: Table =
        toml::from_str(&format!("{HEAD}[[shape]]\ntype = 'mesh'\nfile = 'none.obj'")).unwrap();
    let scene = ExportScene {
        document: &document,
        base: folder,
    };
    let errors = Mitsuba
        .export(&scene, &folder.join("x.xml"))
        .unwrap()
        .unwrap_err();
    assert_eq!(
        errors.0[0].message,
        "cannot read \"none.obj\": there is no such file"
    );
}

#[test]
fn groups_become_shapegroups_and_shared_materials_become_references() {
    let scene = "[[group.g.shape]]\ntype = 'disk'\nmaterial = 'm'\n[[shape]]\ntype = 'instance'\ngroup = 'g'
                 [[shape]]\ntype = 'instance'\ngroup = 'g'\ntransform = { translate = [1, 0, 0] }
                 [[shape]]\ntype = 'cylinder'\nmaterial = 'm'\n[material.m]\ntype = 'mirror'";
    let text = exported(scene).text;
    assert_eq!(text.matches("type=\"shapegroup\"").count(), 1);
    assert_eq!(text.matches("<ref id=\"group g\"/>").count(), 2);
    // The side and two caps of the cylinder, and the disk.
    assert_eq!(text.matches("<ref id=\"m\"/>").count(), 4);
    assert_eq!(text.matches("type=\"conductor\"").count(), 1);
    let python = export_with("py", scene).text;
    assert!(python.contains("\"m\": {\n"));
    assert!(python.contains("{\"type\": \"ref\", \"id\": \"group g\"}"));
}

#[test]
fn meshes_that_mitsuba_does_not_read_are_written_as_ply() {
    let exported = exported("[[shape]]\ntype = 'mesh'\nfile = 'm.stl'");
    assert!(
        exported
            .text
            .contains("<string name=\"filename\" value=\"out-mesh1.ply\"/>")
    );
    let ply = fs::read(exported.path.with_file_name("out-mesh1.ply")).unwrap();
    let header = String::from_utf8_lossy(&ply);
    assert!(header.contains("element vertex 3\nproperty double x\n") && header.contains("element face 1\n"));
    // Single precision does not hold 0.1.
    assert!(ply.windows(8).any(|bytes| bytes == 0.1_f64.to_le_bytes()));
}

#[test]
fn what_has_no_counterpart_is_noted() {
    let notes = |scene: &str| exported(scene).notes;
    let shape = |material: &str| format!("[[shape]]\ntype = 'sphere'\nmaterial = {{ {material} }}\n");
    for (scene, feature) in [
        (
            "[[light]]\ntype = 'ambient'\nradiance = 1".to_owned(),
            "[[light]] ambient",
        ),
        (
            "[[light]]\ntype = 'point'\nposition = [0, 0, 0]\nintensity = 1\nfalloff = 'none'".to_owned(),
            "[[light]] falloff none",
        ),
        (
            "[[light]]\ntype = 'area'\nradiance = 1\nfalloff = 'none'".to_owned(),
            "[[light]] falloff none",
        ),
        (
            "[[shape]]\ntype = 'heightfield'\nheight = { type = 'noise' }".to_owned(),
            "[[shape]] heightfield with a texture",
        ),
        (
            "[[shape]]\ntype = 'torus'".to_owned(),
            "[[shape]] of another type",
        ),
        (
            "[[shape]]\ntype = 'mesh'\nfile = 'm.obj'\ndisplacement = 1".to_owned(),
            "[[shape]] mesh with displacement",
        ),
        (
            shape("type = 'matte', reflectance = { type = 'noise' }"),
            "[texture] of another type",
        ),
        (
            shape("type = 'matte', reflectance = { type = 'checker', mapping = { projection = 'solid' } }"),
            "[texture] mapping",
        ),
        (
            shape("type = 'matte', reflectance = { type = 'image', file = 'm.glb', image = 0 }"),
            "[texture] image of another format",
        ),
        (
            "[[light]]\ntype = 'environment'\nradiance = { type = 'image', file = 'sky.webp' }".to_owned(),
            "[[light]] environment that is no plain image",
        ),
        (shape("type = 'phong'"), "[material] phong, blinn_phong, whitted"),
        (shape("type = 'whitted', k_refr = 1"), "[material] k_refr"),
        (shape("type = 'emissive'"), "[material] emissive"),
        (
            shape("type = 'bump', height = 1, material = { type = 'matte' }"),
            "[material] bump",
        ),
        (
            shape("type = 'reflection_map', radiance = 1, material = { type = 'mirror' }"),
            "[material] reflection_map",
        ),
        (
            shape("type = 'plastic', samples = 2"),
            "[material] plastic with samples",
        ),
        (
            shape("type = 'rough', material = { type = 'conductor', metal = 'Cu' }"),
            "[material] rough",
        ),
        (shape("type = 'strange'"), "[*] plugins of third parties"),
    ] {
        assert!(notes(&scene).contains(&feature), "{scene}: {:?}", notes(&scene));
    }
    // A background is exact if nothing is diffuse.
    let background = "[[light]]\ntype = 'background'\nradiance = 1\n";
    assert!(notes(&format!("{background}[[shape]]\ntype = 'sphere'")).contains(&"[[light]] background"));
    assert_eq!(
        notes(&format!("{background}{}", shape("type = 'mirror'"))),
        ["[sampler]"]
    );
    let two = exported(&format!("{background}{background}"));
    assert!(two.text.contains("<rgb name=\"radiance\" value=\"2, 2, 2\"/>"));
}

#[test]
fn wrong_documents_give_no_panic() {
    for scene in [
        "[[shape]]\ntype = 3",
        "[[shape]]\ntype = 'mesh'\nfile = 3",
        "[[shape]]\ntype = 'sphere'\nmaterial = 'none'",
        "[[shape]]\ntype = 'sphere'\nmaterial = 'a'\n[material.a]\ntype = 'two_sided'\nfront = 'a'\nback = 'a'",
        "[[shape]]\ntype = 'sphere'\nmaterial = 'a'\n[material.a]\ntype = 'emissive'\nmaterial = 'a'",
        "[[shape]]\ntype = 'instance'\ngroup = 'none'",
        "[[shape]]\ntype = 'triangle'\nvertices = [1]",
        "[[shape]]\ntype = 'sphere'\ntransform = [{ matrix = [[1]] }, 3, { rotate = { axis = [0, 0, 0] } }]",
        "[[light]]\ntype = 'projector'\nposition = [0, 0, 0]\ntarget = [0, 0, 0]\nimage = 1",
        "[[light]]\ntype = 'environment'",
        "[group]\na = 3\n[texture]\nb = 3",
    ] {
        exported(scene);
    }
}

#[test]
fn every_noted_feature_is_in_the_table() {
    let sources = [
        include_str!("../export.rs"),
        include_str!("material.rs"),
        include_str!("shape.rs"),
        include_str!("texture.rs"),
        include_str!("view.rs"),
    ];
    let mut names = BTreeSet::new();
    for source in sources {
        for caller in ["self.note(", "self.mean("] {
            for call in source.split(caller).skip(1) {
                let end = call.find(')').unwrap();
                names.extend(
                    call[..end]
                        .split('"')
                        .skip(1)
                        .step_by(2)
                        .filter(|name| name.contains(['[', ' '])),
                );
            }
        }
    }
    assert!(names.len() > 30);
    for name in names {
        assert!(FEATURES.iter().any(|feature| feature.name == name), "{name}");
    }
}
