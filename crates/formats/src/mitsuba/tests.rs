use super::*;
use crate::table::as_color;
use std::collections::BTreeSet;
use std::fs;
use toml::{Table, Value};

const TRIANGLE: &str = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvn 0 0 1\nvt 0 0\nf 1/1/1 2/1/1 3/1/1\n";

fn import_text(text: &str, options: &ImportOptions) -> Result<Imported, FormatErrors> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.xml");
    fs::write(&path, text).unwrap();
    fs::write(folder.path().join("m.obj"), TRIANGLE).unwrap();
    fs::write(folder.path().join("flat.obj"), TRIANGLE.replace("/1/1", "")).unwrap();
    let png = b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR\0\0\0\x08\0\0\0\x04\x08\x02";
    fs::write(folder.path().join("t.png"), png).unwrap();
    import(&path, options)
}

/// The content of a scene as a document, and the names of the features in its notes.
fn load(content: &str) -> (Table, Vec<&'static str>) {
    let text = format!("<scene version='3.0.0'>{content}</scene>");
    let imported = import_text(&text, &ImportOptions::all()).unwrap_or_else(|errors| panic!("{errors:?}"));
    let notes = imported.notes.iter().map(|note| note.feature.name).collect();
    (toml::from_str(&imported.text).unwrap(), notes)
}

fn errors(content: &str) -> Vec<(String, String)> {
    let text = format!("<scene version='3.0.0'>{content}</scene>");
    let errors = import_text(&text, &ImportOptions::all()).unwrap_err();
    errors
        .0
        .into_iter()
        .map(|error| (error.place, error.message))
        .collect()
}

fn toml(text: &str) -> Table {
    toml::from_str(text).unwrap()
}

/// The material of a rectangle with this BSDF.
fn material(bsdf: &str) -> Value {
    let (scene, _) = load(&format!("<shape type='rectangle'>{bsdf}</shape>"));
    scene["shape"][0]["material"].clone()
}

/// The material in a `twosided`, as TOML of its keys.
fn bare(bsdf: &str, expected: &str) {
    let found = material(&format!("<bsdf type='twosided'>{bsdf}</bsdf>"));
    assert_eq!(found, Value::Table(toml(expected)), "{bsdf}");
}

fn camera(sensor: &str) -> Table {
    load(sensor).0["camera"].as_table().unwrap().clone()
}

fn number(value: &Value) -> f64 {
    value.as_float().unwrap()
}

#[test]
fn a_perspective_sensor_is_a_camera_with_near_limit_film_and_sampler() {
    let (scene, notes) = load(
        "<sensor type='perspective'><float name='fov' value='30'/><string name='fov_axis' value='smaller'/>
         <float name='focus_distance' value='6'/>
         <transform name='to_world'><lookat origin='0,1,5' target='0,1,0' up='0,1,0'/></transform>
         <film type='hdrfilm'><integer name='width' value='40'/><integer name='height' value='20'/>
         <rfilter type='box'/></film><sampler type='independent'><integer name='sample_count' value='999'/></sampler>
         </sensor><integrator type='path'><integer name='max_depth' value='5'/></integrator>",
    );
    let expected = "type = 'perspective'\nfov = 30.0\nfov_axis = 'smaller'\nnear = 0.01
         look_at = { origin = [0.0, 1.0, 5.0], target = [0.0, 1.0, 4.0], up = [0.0, 1.0, 0.0] }";
    assert_eq!(scene["camera"], Value::Table(toml(expected)));
    assert_eq!(scene["film"], Value::Table(toml("width = 40\nheight = 20")));
    assert_eq!(
        scene["sampler"],
        Value::Table(toml("type = 'sobol'\nsamples = 64"))
    );
    let integrator = "type = 'whitted'\nmax_depth = 3\nat_max_depth = 'black'";
    assert_eq!(scene["integrator"], Value::Table(toml(integrator)));
    assert_eq!(notes, ["integrator path", "sampler"]);
}

#[test]
fn windows_come_from_focal_lengths_offsets_and_crops() {
    let film = |keys: &str| {
        format!(
            "<film type='hdrfilm'><integer name='width' value='40'/><integer name='height' value='20'/>{keys}</film>"
        )
    };
    let default = camera(&format!("<sensor type='perspective'>{}</sensor>", film("")));
    // The diagonal of 36 x 24 mm at 50 mm, along a film of 2:1.
    let half = 36.0_f64.hypot(24.0) / 100.0 / 1.25_f64.sqrt();
    assert!((number(&default["window"]["r"]) - half).abs() < 1e-12);
    assert!((number(&default["window"]["t"]) - half / 2.0).abs() < 1e-12);
    let moved = camera(&format!(
        "<sensor type='perspective'><float name='fov' value='90'/><float name='principal_point_offset_x' value='0.25'/>
         <float name='principal_point_offset_y' value='0.5'/>{}</sensor>",
        film("<integer name='crop_width' value='10'/><integer name='crop_offset_x' value='20'/>")
    ));
    let window = ["l", "r", "b", "t"].map(|key| number(&moved["window"][key]));
    // From -0.5 to 1.5 in 40 columns, of which 20 to 30 remain; and from -1 to 0.
    for (found, expected) in window.into_iter().zip([0.5, 1.0, -1.0, 0.0]) {
        assert!((found - expected).abs() < 1e-12, "{window:?}");
    }
    let wide = camera(&format!(
        "<sensor type='orthographic'><transform name='to_world'><scale x='3' y='3'/></transform>{}</sensor>",
        film("")
    ));
    assert_eq!(number(&wide["width"]), 6.0);
    let stretched = camera(&format!(
        "<sensor type='orthographic'><transform name='to_world'><scale x='3' y='1'/></transform>{}</sensor>",
        film("")
    ));
    assert_eq!(
        (
            number(&stretched["window"]["r"]),
            number(&stretched["window"]["t"])
        ),
        (3.0, 0.5)
    );
    let lens = camera(
        "<sensor type='thinlens'><float name='fov' value='30'/><float name='aperture_radius' value='0.1'/>
         <float name='focus_distance' value='3'/></sensor>",
    );
    assert_eq!(
        (number(&lens["aperture"]), number(&lens["focus_distance"])),
        (0.1, 3.0)
    );
    assert!(lens.get("near").is_none());
}

#[test]
fn a_file_without_sensor_and_emitters_gets_fitted_ones() {
    let (scene, _) =
        load("<shape type='sphere'><point name='center' x='2'/><float name='radius' value='3'/></shape>");
    assert_eq!(
        scene["camera"]["look_at"]["target"].to_string(),
        "[2.0, 0.0, 0.0]"
    );
    assert_eq!(scene["light"].as_array().unwrap().len(), 3);
    let options = ImportOptions {
        part: true,
        prefix: "p/".into(),
        materials: [("b".to_owned(), "mine".to_owned())].into(),
        ..ImportOptions::all()
    };
    let text = "<scene version='3.0.0'><sensor type='perspective'/><bsdf type='diffuse' id='a'/><bsdf type='diffuse' id='b'/>
                <shape type='sphere' id='s'><ref id='a'/></shape><shape type='cube'><ref id='b'/></shape></scene>";
    let part = toml(&import_text(text, &options).unwrap().text);
    assert!(part.get("camera").is_none() && part.get("light").is_none() && part.get("integrator").is_none());
    assert_eq!(part["shape"][0]["material"].as_str(), Some("p/a"));
    assert_eq!(part["shape"][0]["id"].as_str(), Some("p/s"));
    assert_eq!(part["shape"][1]["material"].as_str(), Some("mine"));
    let unknown = ImportOptions {
        materials: [("c".to_owned(), "mine".to_owned())].into(),
        ..options.clone()
    };
    assert_eq!(
        import_text(text, &unknown).unwrap_err().0[0].help.as_deref(),
        Some("materials of the file: \"a\", \"b\"")
    );
    let camera = ImportOptions {
        camera: Some("7".into()),
        ..options
    };
    assert!(import_text(text, &camera).is_err());
}

#[test]
fn emitters_are_lights() {
    let (scene, notes) = load(
        "<emitter type='point'><point name='position' value='1 2 3'/><rgb name='intensity' value='4'/></emitter>
         <emitter type='directional'><vector name='direction' x='0' y='-1' z='0'/></emitter>
         <emitter type='spot'><transform name='to_world'><lookat origin='0,5,0' target='0,4,0' up='1,0,0'/></transform>
         <float name='cutoff_angle' value='40'/></emitter>
         <emitter type='constant'><rgb name='radiance' value='0.5'/></emitter>
         <emitter type='projector'><texture type='bitmap' name='irradiance'><string name='filename' value='t.png'/></texture>
         <float name='scale' value='2'/><float name='fov' value='30'/></emitter>
         <emitter type='envmap'><string name='filename' value='t.png'/><float name='scale' value='3'/></emitter>",
    );
    let lights = scene["light"].as_array().unwrap();
    assert_eq!(
        lights[0],
        Value::Table(toml(
            "type = 'point'\nposition = [1.0, 2.0, 3.0]\nintensity = 4.0"
        ))
    );
    assert_eq!(
        lights[1],
        Value::Table(toml(
            "type = 'directional'\ndirection = [0.0, -1.0, 0.0]\nirradiance = 1.0"
        ))
    );
    assert_eq!(
        lights[2],
        Value::Table(toml(
            "type = 'spot'\nposition = [0.0, 5.0, 0.0]\ntarget = [0.0, 4.0, 0.0]\nintensity = 1.0
             cutoff_angle = 40.0\nbeam_width = 30.0"
        ))
    );
    assert_eq!(
        lights[3],
        Value::Table(toml("type = 'environment'\nradiance = 0.5\nsamples = 4"))
    );
    // Mitsuba's v points down there: the image is upright.
    assert_eq!(
        lights[4]["image"],
        Value::Table(toml("type = 'image'\nfile = 't.png'"))
    );
    assert_eq!(number(&lights[4]["aspect"]), 2.0);
    assert_eq!(number(&lights[4]["intensity"]), 2.0 * std::f64::consts::PI);
    let image = &lights[5]["radiance"]["factors"][1];
    assert_eq!(number(&lights[5]["radiance"]["factors"][0]), 3.0);
    assert_eq!(image["scale"].to_string(), "[1.0, 0.75]");
    assert_eq!(image["offset"].to_string(), "[0.5, 0.125]");
    assert_eq!(notes[..2], ["integrator path", "unlimited max_depth"]);
    assert_eq!(notes[2..], ["emitter constant", "emitter envmap"]);
}

/// Mitsuba's u grows along x of `to_world` and its v along y, from the top row of an image.
#[test]
fn textures_of_spots_are_images() {
    let spot = |to_world: &str, texture: &str| {
        let text = format!(
            "<emitter type='spot'><transform name='to_world'>{to_world}</transform>
             <texture name='texture' {texture}</texture></emitter>"
        );
        let (scene, notes) = load(&text);
        assert_eq!(notes[..], ["integrator path", "unlimited max_depth"]);
        scene["light"][0].clone()
    };
    let bitmap = "type='bitmap'><string name='filename' value='t.png'/>";
    let vector = |light: &Value, key: &str| {
        let parts = light[key].as_array().unwrap().iter().map(number);
        parts.collect::<Vec<f64>>()
    };
    // `lookat` has x to the left and y up: seen from the light, the bitmap is turned by 180
    // degrees.
    let upright = spot("<lookat origin='0,5,0' target='0,4,0' up='1,0,0'/>", bitmap);
    assert_eq!(vector(&upright, "up"), [-1.0, 0.0, 0.0]);
    assert_eq!(
        upright["image"],
        Value::Table(toml("type = 'image'\nfile = 't.png'"))
    );
    // A transform that mirrors exchanges left and right; only the direction of v differs.
    let mirrored = spot("<matrix value='1 0 0 0 0 1 0 0 0 0 -1 5 0 0 0 1'/>", bitmap);
    assert_eq!(vector(&mirrored, "target"), [0.0, 0.0, 4.0]);
    assert_eq!(vector(&mirrored, "up"), [0.0, 1.0, 0.0]);
    let flipped = toml("type = 'image'\nfile = 't.png'\nscale = [1.0, -1.0]\noffset = [0.0, 1.0]");
    assert_eq!(mirrored["image"], Value::Table(flipped));
}

#[test]
fn shapes_keep_their_geometry() {
    let (scene, _) = load(
        "<shape type='rectangle'><boolean name='flip_normals' value='true'/></shape>
         <shape type='cylinder'><point name='p0' x='1'/><point name='p1' x='1' z='4'/><float name='radius' value='2'/></shape>
         <shape type='obj'><string name='filename' value='m.obj'/><boolean name='face_normals' value='true'/></shape>
         <shape type='shapegroup' id='g'><shape type='disk'/><shape type='cube'/></shape>
         <shape type='instance'><ref id='g'/><transform name='to_world'><translate y='3'/></transform></shape>
         <shape type='instance'><ref id='g'/></shape>",
    );
    let shapes = scene["shape"].as_array().unwrap();
    assert_eq!(
        shapes[0]["transform"]["matrix"][2].to_string(),
        "[-0.0, -0.0, -1.0, 0.0]".replace("-0.0", "0.0")
    );
    assert_eq!(shapes[1]["z"].to_string(), "[0.0, 4.0]");
    assert_eq!(shapes[1]["caps"].as_bool(), Some(false));
    assert_eq!(shapes[1]["transform"]["matrix"][0][3].as_float(), Some(1.0));
    assert_eq!(shapes[2]["shading"].as_str(), Some("flat"));
    assert_eq!(scene["group"]["g"]["shape"].as_array().unwrap().len(), 2);
    assert_eq!(shapes[3]["group"].as_str(), Some("g"));
    assert_eq!(shapes.len(), 5);
}

#[test]
fn diffuse_surfaces_are_black_from_behind() {
    let expected = "type = 'two_sided'\nfront = { type = 'matte', reflectance = 0.5 }\nback = { type = 'matte', reflectance = 0.0 }";
    assert_eq!(material("<bsdf type='diffuse'/>"), Value::Table(toml(expected)));
    assert_eq!(material(""), Value::Table(toml(expected)));
    let (scene, _) =
        load("<shape type='cube'><boolean name='flip_normals' value='true'/><bsdf type='diffuse'/></shape>");
    assert_eq!(
        scene["shape"][0]["material"]["back"]["reflectance"].as_float(),
        Some(0.5)
    );
}

#[test]
fn bsdfs_are_materials() {
    bare(
        "<bsdf type='diffuse'><rgb name='reflectance' value='0.1 0.2 0.3'/></bsdf>",
        "type = 'matte'\nreflectance = [0.1, 0.2, 0.3]",
    );
    bare("<bsdf type='conductor'/>", "type = 'mirror'\nreflectance = 1.0");
    bare(
        "<bsdf type='conductor'><string name='material' value='Au'/><float name='specular_reflectance' value='0.5'/></bsdf>",
        "type = 'conductor'\nmetal = 'Au'\ntint = 0.5",
    );
    bare(
        "<bsdf type='conductor'><rgb name='eta' value='1 2 3'/><spectrum name='k' value='4'/></bsdf>",
        "type = 'conductor'\neta = [1.0, 2.0, 3.0]\nk = 4.0\ntint = 1.0",
    );
    let glass = material(
        "<bsdf type='dielectric'><string name='int_ior' value='water'/><float name='ext_ior' value='1'/></bsdf>",
    );
    assert_eq!(
        glass,
        Value::Table(toml(
            "type = 'dielectric'\ninterior_ior = 1.333\nexterior_ior = 1.0"
        ))
    );
    let pane = material("<bsdf type='thindielectric'/>");
    assert_eq!(
        pane,
        Value::Table(toml(
            "type = 'thin_dielectric'\ninterior_ior = 1.5046\nexterior_ior = 1.000277\ntint = 1.0"
        ))
    );
    let open = material("<bsdf type='null'/>");
    assert_eq!(number(&open["opacity"]), 0.0);
    let mask = material("<bsdf type='mask'><bsdf type='twosided'><bsdf type='diffuse'/></bsdf></bsdf>");
    assert_eq!(
        mask,
        Value::Table(toml(
            "type = 'mask'\nopacity = 0.5\nmaterial = { type = 'matte', reflectance = 0.5 }"
        ))
    );
    let blend = material(
        "<bsdf type='blendbsdf'><float name='weight' value='0.25'/><bsdf type='thindielectric'/><bsdf type='null'/></bsdf>",
    );
    assert_eq!(
        (number(&blend["weight"]), blend["a"]["type"].as_str()),
        (0.25, Some("thin_dielectric"))
    );
    let sides = material("<bsdf type='twosided'><bsdf type='diffuse'/><bsdf type='conductor'/></bsdf>");
    assert_eq!(
        (sides["front"]["type"].as_str(), sides["back"]["type"].as_str()),
        (Some("matte"), Some("mirror"))
    );
    let plastic = material("<bsdf type='twosided'><bsdf type='plastic'/></bsdf>");
    assert_eq!(plastic["type"].as_str(), Some("plastic"));
    assert_eq!(
        (number(&plastic["reflectance"]), number(&plastic["interior_ior"])),
        (0.5, 1.49)
    );
    let nonlinear = material(
        "<bsdf type='twosided'><bsdf type='plastic'><boolean name='nonlinear' value='true'/></bsdf></bsdf>",
    );
    // Each reflection in the coat meets the albedo again.
    let share = number(&nonlinear["reflectance"]);
    assert!((0.25..0.35).contains(&share), "{share}");
    let rough = material(
        "<bsdf type='twosided'><bsdf type='roughplastic'><float name='alpha' value='0.2'/></bsdf></bsdf>",
    );
    assert!((number(&rough["exponent"]) - 48.0).abs() < 1e-9);
    let metal = material(
        "<bsdf type='twosided'><bsdf type='roughconductor'><string name='material' value='Ag'/></bsdf></bsdf>",
    );
    assert_eq!(metal["type"].as_str(), Some("glossy"));
    let bump = material(
        "<bsdf type='bumpmap'><texture type='bitmap'><string name='filename' value='t.png'/></texture><float name='scale' value='0.25'/><bsdf type='dielectric'/></bsdf>",
    );
    assert_eq!(
        (
            bump["type"].as_str(),
            bump["material"]["type"].as_str(),
            number(&bump["scale"])
        ),
        (Some("bump"), Some("dielectric"), 0.25)
    );
}

#[test]
fn texture_coordinates_are_converted_for_each_shape() {
    let bsdf = "<bsdf type='twosided'><bsdf type='diffuse'><texture type='bitmap' name='reflectance'>
                <string name='filename' value='t.png'/><boolean name='raw' value='true'/><string name='wrap_mode' value='clamp'/>
                <transform name='to_uv'><scale x='2' y='3'/><translate x='0.5'/></transform></texture></bsdf></bsdf>";
    let image = |shape: &str| load(shape).0["shape"][0]["material"]["reflectance"].clone();
    let head = "type = 'image'\nfile = 't.png'\ncolor_space = 'linear'\nwrap = 'clamp'\n";
    // Of a rectangle both programs have v upwards, of an image Mitsuba has it downwards.
    let found = image(&format!("<shape type='rectangle'>{bsdf}</shape>"));
    assert_eq!(
        found,
        Value::Table(toml(&format!("{head}scale = [2.0, -3.0]\noffset = [0.5, 1.0]")))
    );
    // Mitsuba turns v of an OBJ file.
    let obj = "<string name='filename' value='m.obj'/>";
    let found = image(&format!("<shape type='obj'>{obj}{bsdf}</shape>"));
    assert_eq!(
        found,
        Value::Table(toml(&format!("{head}scale = [2.0, 3.0]\noffset = [0.5, -2.0]")))
    );
    let rotated = bsdf.replace("<scale x='2' y='3'/>", "<rotate z='1' angle='90'/>");
    let found = image(&format!("<shape type='rectangle'>{rotated}</shape>"));
    assert!(found["mapping"]["transform"]["matrix"][0][1].as_float().unwrap() < -0.99);
    let checker = "<bsdf type='twosided'><bsdf type='diffuse'><texture type='checkerboard' name='reflectance'/></bsdf></bsdf>";
    let found = image(&format!("<shape type='rectangle'>{checker}</shape>"));
    assert_eq!(
        found,
        Value::Table(toml("type = 'checker'\na = 0.4\nb = 0.2\nscale = [2.0, 2.0]"))
    );
    // A cube with a texture has Mitsuba's texture coordinates on each face.
    let (scene, _) = load(&format!("<shape type='cube'>{checker}</shape>"));
    assert_eq!(scene["shape"].as_array().unwrap().len(), 6);
}

#[test]
fn normal_maps_have_the_tangents_of_their_shapes() {
    let bsdf = "<bsdf type='normalmap'><texture type='bitmap' name='normalmap'><string name='filename' value='t.png'/>
                <boolean name='raw' value='true'/></texture><bsdf type='dielectric'/></bsdf>";
    let turned = "<transform name='to_world'><rotate y='1' angle='90'/></transform>";
    let rectangle = load(&format!("<shape type='rectangle'>{turned}{bsdf}</shape>")).0;
    assert_eq!(
        rectangle["shape"][0]["material"]["tangent"][2].as_float(),
        Some(-1.0)
    );
    let sphere = load(&format!("<shape type='sphere'>{bsdf}</shape>")).0;
    assert_eq!(
        sphere["shape"][0]["material"]["axis"].to_string(),
        "[0.0, 0.0, 1.0]"
    );
    let mesh = load(&format!(
        "<shape type='obj'><string name='filename' value='m.obj'/>{bsdf}</shape>"
    ))
    .0;
    assert_eq!(mesh["shape"][0]["material"]["tangent"].as_str(), Some("mesh"));
    assert_eq!(mesh["shape"][0]["tangents"].as_bool(), Some(true));
    let (disk, notes) = load(&format!("<shape type='disk'>{bsdf}</shape>"));
    assert_eq!(disk["shape"][0]["material"]["type"].as_str(), Some("dielectric"));
    assert!(notes.contains(&"normalmap without tangents"));
}

#[test]
fn area_emitters_are_lights_and_visible_on_one_side() {
    let emitter = "<emitter type='area'><rgb name='radiance' value='5'/></emitter>";
    let (scene, notes) = load(&format!(
        "<shape type='rectangle'>{emitter}<transform name='to_world'><translate z='2'/></transform></shape>
         <shape type='cube'>{emitter}</shape><shape type='cylinder'>{emitter}</shape>
         <shape type='obj'><string name='filename' value='m.obj'/>{emitter}</shape>"
    ));
    let lights = scene["light"].as_array().unwrap();
    assert_eq!(lights.len(), 1 + 6 + 1);
    let expected = "type = 'area'\nshape = 'rectangle'\nradiance = 5.0
         transform = { matrix = [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 2.0]] }";
    assert_eq!(lights[0], Value::Table(toml(expected)));
    assert_eq!(
        lights[7],
        Value::Table(toml(
            "type = 'area'\nshape = 'mesh'\nradiance = 5.0\nfile = 'm.obj'"
        ))
    );
    let material = "type = 'two_sided'\nfront = { type = 'emissive', radiance = 5.0 }\nback = { type = 'matte', reflectance = 0.0 }";
    assert_eq!(scene["shape"][0]["material"], Value::Table(toml(material)));
    assert_eq!(
        notes
            .iter()
            .filter(|name| name.starts_with("emitter area"))
            .count(),
        2
    );
}

#[test]
fn unknown_plugins_and_parameters_are_errors_with_places() {
    let found = errors(
        "\n<shape type='serialized'/>\n<shape type='sphere'><bsdf type='hair'/><float name='radios' value='1'/></shape>
<emitter type='sunsky'/>\n<integrator type='ptracer'/>\n<sensor type='radiancemeter'/>
<shape type='rectangle'><bsdf type='diffuse'><texture name='reflectance' type='volume'/></bsdf></shape>",
    );
    let all: Vec<String> = found
        .iter()
        .map(|(place, message)| format!("{place} {message}"))
        .collect();
    for expected in [
        "2:1 the shape \"serialized\" is not supported",
        "3:22 the bsdf \"hair\" is not supported",
        "3:41 unknown: the parameter \"radios\" of the shape \"sphere\"",
        "4:1 the emitter \"sunsky\" is not supported",
        "5:1 the integrator \"ptracer\" is not supported",
        "6:1 the sensor \"radiancemeter\" is not supported",
        "7:46 the texture \"volume\" is not supported",
    ] {
        assert!(all.iter().any(|error| error == expected), "{expected}: {all:#?}");
    }
    for (content, message) in [
        (
            "<bsdf type='twosided' id='a'><ref id='a'/></bsdf><shape type='sphere'><ref id='a'/></shape>",
            "the bsdf \"a\" contains itself",
        ),
        (
            "<shape type='shapegroup' id='g'><shape type='instance'><ref id='g'/></shape></shape><shape type='instance'><ref id='g'/></shape>",
            "the shape \"g\" contains itself",
        ),
        (
            "<shape type='sphere'><transform name='to_world'><scale x='2'/></transform></shape>",
            "the transform of a sphere must scale all axes equally",
        ),
        (
            "<shape type='sphere'><transform name='to_world'><scale value='0'/></transform></shape>",
            "\"to_world\" cannot be inverted",
        ),
        (
            "<shape type='obj'><string name='filename' value='none.obj'/></shape>",
            "there is no file \"none.obj\"",
        ),
        (
            "<shape type='obj'><string name='filename' value='/etc/passwd'/></shape>",
            "\"/etc/passwd\" is outside of the folder of the scene; `convert --allow-outside` reads it",
        ),
        (
            "<emitter type='envmap'><string name='filename' value='m.obj'/></emitter>",
            "\"m.obj\" has a format that is not read; convert it to EXR or PNG",
        ),
        (
            "<sensor type='perspective'><float name='fov' value='180'/></sensor>",
            "expected a field of view between 0 and 180 degrees, found 180",
        ),
        (
            "<shape type='sphere'><bsdf type='conductor'><string name='material' value='Xx'/></bsdf></shape>",
            "unknown metal \"Xx\"; known metals are Ag, Al, Au, Be, Cr, Cu, Hg, Ir, Ni, W",
        ),
        (
            "<shape type='sphere'><string name='radius' value='1'/></shape>",
            "expected a number as \"radius\"",
        ),
        (
            "<sensor type='perspective'><film type='hdrfilm'><integer name='width' value='0'/></film></sensor>",
            "expected 1 to 65536 pixels as \"width\"",
        ),
    ] {
        assert_eq!(errors(content)[0].1, message);
    }
}

#[test]
fn materials_that_refer_to_each_other_take_linear_time() {
    // Each refers twice to the one before.
    let chain: String = (1..40)
        .map(|i| format!("<bsdf type='blendbsdf' id='b{i}'><float name='weight' value='0.5'/><ref id='b{0}'/><ref id='b{0}'/></bsdf>", i - 1))
        .collect();
    let text = |last: usize| {
        format!("<bsdf type='null' id='b0'/>{chain}<shape type='sphere'><ref id='b{last}'/></shape>")
    };
    let (scene, _) = load(&text(12));
    assert_eq!(scene["material"].as_table().unwrap().len(), 13);
    assert_eq!(errors(&text(39))[0].1, "objects are nested more than 16 deep");
    // Many shapes share them.
    let shapes = "<shape type='cube'><ref id='b12'/></shape><shape type='rectangle'><ref id='b12'/></shape>"
        .repeat(5_000);
    let shared = load(&format!("{}{shapes}", text(12))).0;
    assert_eq!(shared["material"].as_table().unwrap().len(), 13);
    let many = "<shape type='obj'><string name='filename' value='flat.obj'/></shape>".repeat(20_000);
    let (_, notes) = load(&many);
    assert!(notes.contains(&"mesh without normals"));
}

#[test]
fn paths_have_as_many_edges_as_in_mitsuba() {
    let scene = |depth: i64| {
        load(&format!(
            "<integrator type='path'><integer name='max_depth' value='{depth}'/></integrator>
             <shape type='sphere'><emitter type='area'/></shape><emitter type='point'/><emitter type='constant'/>"
        ))
    };
    let alone =
        "<integrator type='path'><integer name='max_depth' value='9'/></integrator><shape type='sphere'/>";
    assert_eq!(load(alone).0["integrator"]["max_depth"].as_integer(), Some(7));
    // Mirrors see the surroundings at the end of a path.
    for (depth, bounces) in [(-1, 16), (0, 0), (1, 0), (2, 1), (3, 2), (9, 8)] {
        let (scene, notes) = scene(depth);
        assert_eq!(scene["integrator"]["max_depth"].as_integer(), Some(bounces));
        let lights = scene["light"].as_array().unwrap();
        let unlit = (0..2).contains(&depth);
        assert_eq!(notes.contains(&"max_depth below 2"), unlit, "{depth}");
        assert_eq!(lights.len(), if unlit { 1 } else { 3 }, "{depth}");
        if unlit {
            assert_eq!(lights[0]["samples"].as_integer(), Some(0));
        }
    }
}

/// Expected colours are those of Mitsuba 3.9.1 in `scalar_rgb`.
#[test]
fn spectra_become_colours() {
    let close = |found: &Value, expected: [f64; 3], tolerance: f64| {
        let found = as_color(found).unwrap();
        let near = (0..3).all(|i| (found[i] - expected[i]).abs() <= tolerance);
        assert!(near, "{found:?}, expected {expected:?}");
    };
    let emitter = |value: &str| {
        let text = format!("<emitter type='point'><spectrum name='intensity' value='{value}'/></emitter>");
        load(&text).0["light"][0]["intensity"].clone()
    };
    close(&emitter("2"), [2.40958, 1.896582, 1.817832], 0.01);
    close(&emitter("400:0.5, 700:0.1"), [0.223724, 0.292872, 0.406243], 0.01);
    let (scene, notes) = load(
        "<shape type='sphere'><emitter type='area'>
         <spectrum name='radiance' value='400:0, 500:8, 600:15.6, 700:18.4'/></emitter></shape>",
    );
    close(&scene["light"][0]["radiance"], [20.7108, 10.8546, 2.77115], 0.2);
    assert!(notes.contains(&"spectrum of wavelengths"));
    let reflectance = |value: &str| {
        let bsdf = format!("<bsdf type='diffuse'><spectrum name='reflectance' value='{value}'/></bsdf>");
        let text = format!("<shape type='sphere'><bsdf type='twosided'>{bsdf}</bsdf></shape>");
        load(&text).0["shape"][0]["material"]["reflectance"].clone()
    };
    close(&reflectance("0.25"), [0.25; 3], 0.0);
    close(
        &reflectance("400:0.5, 700:0.1"),
        [0.176012, 0.309296, 0.443038],
        0.02,
    );
    close(
        &reflectance("400:0, 500:1, 600:0.2, 700:0.9"),
        [0.125051, 0.701716, 0.533343],
        0.03,
    );
}

#[test]
fn shares_are_one_number() {
    let material = |text: &str| {
        let (scene, notes) = load(&format!("<shape type='sphere'>{text}</shape>"));
        (scene["shape"][0]["material"].clone(), notes)
    };
    let inner = "<bsdf type='twosided'><bsdf type='diffuse'/></bsdf>";
    let (mask, notes) = material(&format!(
        "<bsdf type='mask'><rgb name='opacity' value='0.9 0.6 0'/>{inner}</bsdf>"
    ));
    assert_eq!(mask["opacity"].as_float(), Some(0.5));
    assert!(notes.contains(&"holes in path and direct"));
    let (mask, _) = material(&format!(
        "<bsdf type='mask'><texture type='checkerboard' name='opacity'>
         <rgb name='color0' value='0 0 0.3'/><rgb name='color1' value='1'/></texture>{inner}</bsdf>"
    ));
    let b = as_color(&mask["opacity"]["b"]).unwrap();
    assert!((b[0] - 0.1).abs() < 1e-15, "{b:?}");
    assert_eq!(as_color(&mask["opacity"]["a"]), Some([1.0; 3]));
    let (_, notes) = material(&format!(
        "<bsdf type='blendbsdf'><texture type='bitmap' name='weight'>
         <string name='filename' value='t.png'/></texture>{inner}{inner}</bsdf>"
    ));
    assert!(notes.contains(&"opacity or weight by a bitmap"));
    assert!(!notes.contains(&"holes in path and direct"));
}

#[test]
fn maps_lean_the_same_way_on_both_sides() {
    let map = "<texture type='bitmap' name='normalmap'><string name='filename' value='t.png'/></texture>";
    let bump = "<texture type='bitmap'><string name='filename' value='t.png'/></texture>";
    let diffuse = "<bsdf type='diffuse'/>";
    let normal_map = format!("<bsdf type='normalmap'>{map}{diffuse}</bsdf>");
    let bump_map = format!("<bsdf type='bumpmap'>{bump}{diffuse}</bsdf>");
    let sides = |inner: &str| {
        let text = format!("<shape type='rectangle'><bsdf type='twosided'>{inner}</bsdf></shape>");
        load(&text).0["shape"][0]["material"].clone()
    };
    let material = sides(&normal_map);
    assert_eq!(material["front"].get("strength"), None);
    assert_eq!(material["back"]["strength"].as_float(), Some(-1.0));
    let material = sides(&bump_map);
    assert_eq!(material["front"]["scale"].as_float(), Some(1.0));
    assert_eq!(material["back"]["scale"].as_float(), Some(-1.0));
    let material = sides(&format!("{diffuse}{normal_map}"));
    assert_eq!(material["front"]["type"].as_str(), Some("matte"));
    assert_eq!(material["back"]["strength"].as_float(), Some(-1.0));
}

#[test]
fn what_mitsuba_does_by_default_is_noted() {
    let map = |more: &str| {
        format!(
            "<shape type='rectangle'><bsdf type='normalmap'><texture name='normalmap' type='bitmap'>\
             <string name='filename' value='t.png'/></texture>{more}<bsdf type='diffuse'/></bsdf></shape>"
        )
    };
    let shadowing = |text: &str| load(text).1.contains(&"use_shadowing_function");
    assert!(shadowing(&map("")));
    assert!(!shadowing(&map(
        "<boolean name='use_shadowing_function' value='false'/>"
    )));
    assert!(shadowing(&map("").replace("'normalmap'><", "'bumpmap'><")));
    let sensor = "<sensor type='perspective'/>";
    assert!(!load(sensor).1.contains(&"sensors after the first"));
    assert!(load(&sensor.repeat(2)).1.contains(&"sensors after the first"));
    let light = "<emitter type='point'><float name='sampling_weight' value='2'/></emitter>";
    assert_eq!(load(light).0["light"].as_array().unwrap().len(), 1);
}

#[test]
fn an_area_emitter_may_be_shared() {
    let (scene, _) = load(
        "<emitter type='area' id='e'><rgb name='radiance' value='2'/></emitter>
         <shape type='sphere'><ref id='e'/></shape>",
    );
    assert_eq!(scene["light"].as_array().unwrap().len(), 1);
    assert_eq!(as_color(&scene["light"][0]["radiance"]), Some([2.0; 3]));
}

#[test]
fn every_noted_feature_is_in_the_table() {
    let sources = [
        include_str!("light.rs"),
        include_str!("material.rs"),
        include_str!("sensor.rs"),
        include_str!("shape.rs"),
        include_str!("texture.rs"),
        include_str!("translate.rs"),
    ];
    let mut names = BTreeSet::new();
    for source in sources {
        for call in source.split("self.note(").skip(1) {
            let ends = [" at", ".at"].into_iter().filter_map(|end| call.find(end));
            let end = ends.min().unwrap();
            names.extend(call[..end].split('"').skip(1).step_by(2));
        }
    }
    names.remove("path");
    assert!(names.len() > 20);
    for name in names {
        let known = FEATURES.iter().any(|feature| feature.name == name);
        assert!(known || name == "roughplastic", "{name}");
    }
    let distinct: BTreeSet<&str> = FEATURES.iter().map(|feature| feature.name).collect();
    assert_eq!(distinct.len(), FEATURES.len());
}

#[test]
fn a_sensor_without_a_sampler_has_that_of_mitsuba() {
    let (scene, notes) = load("<sensor type='perspective'/><shape type='sphere'/>");
    assert_eq!(
        scene["sampler"],
        Value::Table(toml("type = 'sobol'\nsamples = 4"))
    );
    assert!(notes.contains(&"sampler"), "{notes:?}");
}

#[test]
fn comments_may_contain_dashes() {
    let (scene, _) = load("<!-- ---- shapes -- größer ---->\n<shape type='sphere'/><!----->");
    assert_eq!(scene["shape"].as_array().unwrap().len(), 1);
    // Places count them, and the reason of an error is whole.
    let found = errors("<!-- -- -->\n<shape type=sphere/>");
    let (place, message) = &found[0];
    assert!(place.starts_with("2:"), "{found:?}");
    assert_eq!(message, "invalid XML: expected a quote not 's'");
}

#[test]
fn only_a_file_without_emitters_gets_lights() {
    let lights = |content: &str| load(content).0.contains_key("light");
    assert!(lights("<shape type='sphere'/>"));
    let dome = "<shape type='sphere'><float name='radius' value='50'/>\
        <boolean name='flip_normals' value='true'/><emitter type='area'/></shape>";
    assert!(!lights(dome));
    assert!(lights("<shape type='sphere'><emitter type='area'/></shape>"));
}

#[test]
fn spread_reflections_end_when_they_count_little() {
    let integrator = |bsdf: &str| {
        let path = "<integrator type='path'><integer name='max_depth' value='8'/></integrator>";
        let (scene, _) = load(&format!("{path}<shape type='sphere'>{bsdf}</shape>"));
        scene["integrator"]
            .get("min_contribution")
            .and_then(Value::as_float)
    };
    assert_eq!(
        integrator("<bsdf type='twosided'><bsdf type='roughconductor'/></bsdf>"),
        Some(1e-3)
    );
    assert_eq!(integrator("<bsdf type='conductor'/>"), None);
}
