use super::*;
use std::fs;
use std::path::PathBuf;

const CUBE: &str = "mtllib m.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 2\nvt 0 0\nusemtl a\nf 1/1 2/1 3/1\n\
                    usemtl b\nf 1/1 2/1 4/1\nusemtl a\nf 2/1 3/1 4/1\n";

struct Files {
    _folder: tempfile::TempDir,
    path: PathBuf,
}

fn files(obj: &str, mtl: &str) -> Files {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("x.obj");
    fs::write(&path, obj).unwrap();
    fs::write(folder.path().join("m.mtl"), mtl).unwrap();
    for name in ["t.png", "o.png", "n.png", "h.png", "dir/t.png", "s/t.png"] {
        let image = folder.path().join(name);
        fs::create_dir_all(image.parent().unwrap()).unwrap();
        fs::write(image, "an image").unwrap();
    }
    Files {
        _folder: folder,
        path,
    }
}

fn load(obj: &str, mtl: &str, options: &ImportOptions) -> (Table, Vec<(&'static str, Vec<String>)>) {
    let files = files(obj, mtl);
    let imported = import(&files.path, options).unwrap();
    let notes = imported
        .notes
        .into_iter()
        .map(|note| (note.feature.name, note.places))
        .collect();
    (toml::from_str(&imported.text).unwrap(), notes)
}

fn fails(obj: &str, mtl: &str) -> Vec<(String, String)> {
    let errors = import(&files(obj, mtl).path, &ImportOptions::all()).unwrap_err();
    errors
        .0
        .into_iter()
        .map(|error| (error.place, error.message))
        .collect()
}

/// The material of a file with one material.
fn material(mtl: &str) -> Table {
    let obj = CUBE.replace("usemtl b", "usemtl a");
    let (scene, _) = load(&obj, &format!("newmtl a\n{mtl}"), &ImportOptions::all());
    let mut material = scene["material"]["a"].as_table().unwrap().clone();
    if let Some(textures) = scene.get("texture") {
        material.insert("textures".into(), textures.clone());
    }
    material
}

fn toml(text: &str) -> Table {
    toml::from_str(text).unwrap()
}

#[test]
fn each_material_is_a_shape_with_a_fitted_camera_and_lights() {
    let mtl = "newmtl a\nKd 0.1 0.2 0.3\nillum 1\nnewmtl b\nKd 1 1 1\n";
    let (scene, notes) = load(CUBE, mtl, &ImportOptions::all());
    let shapes = scene["shape"].as_array().unwrap();
    assert_eq!(shapes.len(), 2);
    assert_eq!(shapes[0]["part"].as_str(), Some("a"));
    assert_eq!(shapes[1]["part"].as_str(), Some("b"));
    assert_eq!(shapes[1]["material"].as_str(), Some("b"));
    assert_eq!(
        scene["material"]["a"],
        Value::Table(toml("type = \"matte\"\nreflectance = [0.1, 0.2, 0.3]"))
    );
    assert_eq!(
        scene["camera"]["look_at"]["target"].to_string(),
        "[0.5, 0.5, 1.0]"
    );
    assert_eq!(scene["light"].as_array().unwrap().len(), 3);
    assert_eq!(notes, []);
}

#[test]
fn a_part_has_a_prefix_and_a_transform_but_no_camera_and_lights() {
    let options = ImportOptions {
        part: true,
        prefix: "x/".into(),
        transform: whitstone_core::DAffine3::from_scale(whitstone_core::DVec3::splat(2.0)),
        materials: [("b".to_owned(), "mine".to_owned())].into(),
        ..ImportOptions::all()
    };
    let (scene, _) = load(CUBE, "newmtl a\nnewmtl b\n", &options);
    assert!(scene.get("camera").is_none() && scene.get("light").is_none() && scene.get("film").is_none());
    assert!(scene["material"].get("x/a").is_some());
    assert_eq!(scene["shape"][1]["material"].as_str(), Some("mine"));
    assert_eq!(
        scene["shape"][0]["transform"]["matrix"][2][2].as_float(),
        Some(2.0)
    );
    let options = ImportOptions {
        materials: [("c".to_owned(), "mine".to_owned())].into(),
        ..options
    };
    let errors = import(&files(CUBE, "").path, &options).unwrap_err();
    assert_eq!(
        errors.0[0].help.as_deref(),
        Some("materials of the file: \"a\", \"b\"")
    );
    let node = ImportOptions {
        node: Some("b".into()),
        ..ImportOptions::all()
    };
    assert!(import(&files(CUBE, "").path, &node).is_err());
}

#[test]
fn highlights_and_reflections_have_units() {
    let shiny = material("Kd 0.5\nKs 0.2\nNs 100\nKa 0.5 0.5 0.5\n");
    let expected = format!(
        "type = \"blinn_phong\"\nk_d = {}\nk_s = {}\nk_a = 0.5\nexponent = 100.0",
        0.5 / PI,
        0.2 / PI
    );
    assert_eq!(shiny, toml(&expected));
    let reflecting = material("Kd 0.5\nKs 0.2\nNs 100\nillum 3\n");
    assert_eq!(reflecting["type"].as_str(), Some("whitted"));
    assert_eq!(reflecting["k_refl"].as_float(), Some(0.2));
    assert_eq!(reflecting["exponent"].as_float(), Some(25.0));
    // Without a highlight, it is matte.
    assert_eq!(
        material("Kd 0.5\nKs 1\nillum 1\n"),
        toml("type = \"matte\"\nreflectance = 0.5")
    );
    assert_eq!(
        material("Kd 2 0.5 0.5\n"),
        toml("type = \"matte\"\nreflectance = [1.0, 0.5, 0.5]")
    );
    assert_eq!(
        material("illum 7\nNi 1.33\nd 0.1\n"),
        toml("type = \"dielectric\"\ninterior_ior = 1.33")
    );
}

#[test]
fn a_glass_that_would_be_invisible_is_opaque() {
    // What Maya writes for its usual materials.
    let maya = "illum 4\nKd 0.5 0.25 0.125\nKa 0 0 0\nTf 1 1 1\nNi 1.00\n";
    let expected = toml("type = \"matte\"\nreflectance = [0.5, 0.25, 0.125]");
    assert_eq!(material(maya), expected);
    let (_, notes) = load(CUBE, &format!("newmtl a\n{maya}"), &ImportOptions::all());
    assert!(
        notes.iter().any(|note| note.0 == "illum 4, 6, 7, 9 with Ni 1"),
        "{notes:?}"
    );
    assert_eq!(
        material(&maya.replace("1.00", "1.5"))["type"].as_str(),
        Some("dielectric")
    );
}

#[test]
fn an_opacity_is_one_number() {
    let png = |colour_type: u8| {
        let mut bytes = b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR\0\0\0\x01\0\0\0\x01\x08".to_vec();
        bytes.extend([colour_type, 0, 0, 0]);
        bytes
    };
    for (file, option, expected) in [
        (Some(6), "", "alpha"),
        (Some(4), "", "alpha"),
        (Some(2), "", "green"),
        (Some(0), "", "green"),
        (Some(2), "-imfchan m ", "green"),
        (Some(6), "-imfchan m ", "alpha"),
        (Some(6), "-imfchan r ", "red"),
        (Some(6), "-imfchan l ", "green"),
        (None, "", "green"),
        (None, "-imfchan m ", "alpha"),
    ] {
        let files = files(CUBE, &format!("newmtl a\nmap_d {option}o.png\nnewmtl b\n"));
        // Neither a PNG nor anything else.
        let image = file.map_or(b"?".to_vec(), png);
        fs::write(files.path.with_file_name("o.png"), image).unwrap();
        let text = import(&files.path, &ImportOptions::all()).unwrap().text;
        let channel = format!("channel = \"{expected}\"");
        assert!(text.contains(&channel), "{file:?} {option}: {text}");
    }
}

#[test]
fn textures_multiply_and_are_shared() {
    let textured =
        material("Kd 0.5 1 1\nmap_Kd -s 2 2 -clamp on dir\\t.png\nmap_d -imfchan m o.png\nd 0.5\n");
    assert_eq!(
        textured,
        toml(
            "type = \"mask\"\nopacity = { type = \"product\", factors = [0.5, \"o\"] }\n\
             material = { type = \"matte\", reflectance = { type = \"product\", factors = [[0.5, 1.0, 1.0], \"t\"] } }\n\
             [textures.t]\ntype = \"image\"\nfile = \"dir/t.png\"\nwrap = \"clamp\"\nscale = [2.0, 2.0]\n\
             [textures.o]\ntype = \"image\"\nfile = \"o.png\"\nchannel = \"alpha\"\n"
        )
    );
    let shiny = material("Kd 1\nKs 1\nmap_Kd t.png\nmap_Ks s/t.png\nillum 3\n");
    assert_eq!(shiny["k_a"].as_str(), Some("t"));
    assert_eq!(shiny["k_refl"].as_str(), Some("t-2"));
    assert_eq!(shiny["textures"].as_table().unwrap().len(), 2);
}

#[test]
fn normal_maps_need_tangents_and_emission_is_added() {
    let mtl = "newmtl a\nKd 1\nnorm -bm 0.5 n.png\nKe 2 2 2\nmap_Bump -bm 0.25 h.png\nnewmtl b\n";
    let (scene, notes) = load(CUBE, mtl, &ImportOptions::all());
    assert_eq!(scene["shape"][0]["tangents"].as_bool(), Some(true));
    assert!(scene["shape"][1].get("tangents").is_none());
    assert_eq!(
        scene["material"]["a"],
        Value::Table(toml(
            "type = \"emissive\"\nradiance = 2.0\n[material]\ntype = \"bump\"\nheight = \"h\"\nscale = 0.25\n\
             [material.material]\ntype = \"normal_map\"\nmap = \"n\"\nstrength = 0.5\n\
             tangent = \"mesh\"\nmaterial = { type = \"matte\", reflectance = 1.0 }"
        ))
    );
    assert_eq!(scene["texture"]["n"]["color_space"].as_str(), Some("linear"));
    assert_eq!(
        notes,
        [("bump", vec!["a".to_owned()]), ("Ke", vec!["a".to_owned()])]
    );
}

#[test]
fn vertex_colours_multiply() {
    let obj = "v 0 0 0 1 0 0\nv 1 0 0 0 1 0\nv 0 1 0 0 0 1\nf 1 2 3\n";
    let (scene, _) = load(obj, "", &ImportOptions::all());
    let shape = &scene["shape"][0];
    assert_eq!(shape["vertex_colors"].as_bool(), Some(true));
    assert_eq!(
        shape["material"]["reflectance"]["type"].as_str(),
        Some("vertex_color")
    );
    assert!(shape.get("part").is_none());
    let imported = import(&files(obj, "").path, &ImportOptions::all()).unwrap();
    let treatment = imported.notes[0].feature.treatment;
    assert_eq!(treatment, whitstone_core::Treatment::Approximated);
}

#[test]
fn faces_whose_triangles_cover_more_are_noted() {
    let obj = "v 4 0 0\nv 1 1 0\nv 0 4 0\nv 0 0 0\nf 1 2 3 4\n";
    let (_, notes) = load(obj, "", &ImportOptions::all());
    assert_eq!(notes, [("concave faces", vec!["line 5".to_owned()])]);
}

#[test]
fn maps_without_a_readable_file_leave_the_plain_colour() {
    let mtl = "newmtl a\nKd 0.1 0.2 0.3\nmap_Kd none.png\nmap_Ks m.mtl\nmap_Ke none.exr\nmap_d none.png\n\
               norm none.png\nbump h.tga\nnewmtl b\n";
    let (scene, notes) = load(CUBE, mtl, &ImportOptions::all());
    assert_eq!(
        scene["material"]["a"],
        Value::Table(toml("type = \"matte\"\nreflectance = [0.1, 0.2, 0.3]"))
    );
    assert!(scene.get("texture").is_none());
    let places: Vec<String> = (3..=8).map(|line| format!("m.mtl:{line}")).collect();
    assert_eq!(notes, [("map without a readable file", places)]);
}

#[test]
fn an_image_of_another_machine_is_found_next_to_its_library() {
    for path in ["C:\\Users\\me\\t.png", "d:/maps/t.png", "\\\\server\\maps\\t.png"] {
        let found = material(&format!("map_Kd {path}\n"));
        assert_eq!(found["textures"]["t"]["file"].as_str(), Some("t.png"), "{path}");
    }
}

#[test]
fn names_of_materials_may_be_in_latin_1() {
    let files = files("", "");
    let obj = b"mtllib m.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl gr\xfcn\nf 1 2 3\nusemtl gr\xe0\nf 1 2 3\n";
    let mtl = b"newmtl gr\xfcn\nKd 0.25\nnewmtl gr\xe0 \nKd 0.75\n";
    fs::write(&files.path, obj).unwrap();
    fs::write(files.path.with_file_name("m.mtl"), mtl).unwrap();
    let imported = import(&files.path, &ImportOptions::all()).unwrap();
    let scene: Table = toml::from_str(&imported.text).unwrap();
    let names = [("gr\u{fc}n", 0.25), ("gr\u{e0}", 0.75)];
    for (place, (name, reflectance)) in names.into_iter().enumerate() {
        assert_eq!(scene["shape"][place]["part"].as_str(), Some(name));
        let found = &scene["material"][name]["reflectance"];
        assert_eq!(found.as_float(), Some(reflectance), "{name}");
    }
    let part = only_part(obj, names[0].0);
    assert_eq!(part.iter().filter(|byte| **byte == b'f').count(), 1);
}

#[test]
fn missing_materials_are_noted_and_errors_name_file_and_line() {
    let (scene, notes) = load(&CUBE.replace("m.mtl", "none.mtl"), "", &ImportOptions::all());
    assert_eq!(scene["shape"][0]["part"].as_str(), Some("a"));
    assert_eq!(notes[0], ("mtllib without a file", vec!["none.mtl".to_owned()]));
    assert_eq!(notes[1].0, "usemtl without a material");
    assert_eq!(
        fails(CUBE, "newmtl a\nKd 1 x\nmap_Kd ../../t.png\n"),
        [
            (
                "m.mtl:2".to_owned(),
                "expected a finite number, found \"x\"".to_owned()
            ),
            (
                "m.mtl:3".to_owned(),
                "\"../../t.png\" is outside of the folder of the scene; `convert --allow-outside` reads it"
                    .to_owned()
            ),
        ]
    );
    assert_eq!(fails(&CUBE.replace("m.mtl", "/etc/hosts"), "")[0].0, "1");
    assert!(import(Path::new("/nonexistent.obj"), &ImportOptions::all()).is_err());
}

#[test]
fn every_noted_feature_is_in_the_table() {
    let mtl = "newmtl a\nillum 11\nKs 1\nNs 0\nKa 1 0 1\nTf 0.5\nd -halo 0.5\nKd spectral x\nmap_Ka a\nmap_Ns a\nmap_Tr a\n\
               disp a\ndecal a\nrefl -type sphere a\nsharpness 60\nmap_aat on\nPr 0.5\nwhat\nmap_Kd -t 1 1 1 -mm 0 1 -boost 2 \
               -texres 5 -blendu on -cc on -bm 2 t.png\n";
    let obj = format!("{CUBE}s 1\nl 1 2\nsurf 1\nwhat\n");
    for illum in [0, 3, 4, 5, 10] {
        load(
            &obj,
            &mtl.replace("11", &illum.to_string()),
            &ImportOptions::all(),
        );
    }
    let (_, notes) = load(&obj, mtl, &ImportOptions::all());
    assert!(notes.len() > 20);
}

#[test]
fn garbage_gives_no_panic() {
    let garbage: Vec<u8> = (0..1_u32 << 20)
        .map(|i| (i.wrapping_mul(2_654_435_761) >> 23) as u8)
        .collect();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("x.obj");
    fs::write(&path, &garbage).unwrap();
    import(&path, &ImportOptions::all()).unwrap();
    let _ = mtl::parse(&garbage);
}

#[test]
fn a_part_has_the_faces_of_one_material() {
    let text = "v 0 0 0\nf 1 \\\n 1 1\nusemtl a\nf 2 2 2\nusemtl  b \r\nf 3 3 3\nusemtl a\nf 4 4 4\n";
    let part = |name: &str| {
        let text = String::from_utf8(only_part(text.as_bytes(), name)).unwrap();
        text.lines()
            .filter(|line| line.starts_with('f'))
            .map(str::to_owned)
            .collect::<Vec<_>>()
    };
    assert_eq!(part("a"), ["f 2 2 2", "f 4 4 4"]);
    assert_eq!(part("b"), ["f 3 3 3"]);
    assert_eq!(part(""), ["f 1 \\"]);
}
