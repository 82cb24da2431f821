use super::*;
use std::fs;
use toml::{Table, Value};
use whitstone_core::{FormatError, Note};

/// A scene in a folder, with a PLY file and an image file that has no content.
fn try_import(text: &str) -> Result<(Table, Vec<Note>), Vec<FormatError>> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("s.pbrt");
    fs::write(&path, text).unwrap();
    fs::write(folder.path().join("a.ply"), PLY).unwrap();
    fs::write(folder.path().join("a.png"), "").unwrap();
    fs::write(
        folder.path().join("part.pbrt"),
        "Shape \"sphere\"\n  Shape \"spere\"\n",
    )
    .unwrap();
    fs::write(folder.path().join("loop.pbrt"), "Include \"loop.pbrt\"\n").unwrap();
    fs::write(
        folder.path().join("moved.pbrt"),
        "Translate 1 2 3 Shape \"disk\"\n",
    )
    .unwrap();
    let imported = Pbrt.import(&path, &ImportOptions::all()).unwrap();
    let imported = imported.map_err(|errors| errors.0)?;
    Ok((imported.text.parse().unwrap(), imported.notes))
}

const PLY: &str = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\n\
                   property float z\nelement face 1\nproperty list uchar int vertex_indices\n\
                   end_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n";

#[track_caller]
fn import(text: &str) -> Table {
    try_import(text).unwrap().0
}

/// The import of the world of a scene that is not mirrored.
#[track_caller]
fn world(text: &str) -> Table {
    import(&format!(
        "Scale -1 1 1\nCamera \"perspective\"\nWorldBegin\n{text}"
    ))
}

#[track_caller]
fn notes(text: &str) -> Vec<&'static str> {
    let (_, notes) = try_import(text).unwrap();
    notes.iter().map(|note| note.feature.name).collect()
}

/// The errors, each with its place and hint.
#[track_caller]
fn errors(text: &str) -> String {
    let errors = try_import(text).unwrap_err();
    let shown = errors.iter().map(|error| {
        let help = error
            .help
            .as_ref()
            .map_or(String::new(), |help| format!(" ({help})"));
        format!("{}: {}{help}", error.place, error.message)
    });
    shown.collect::<Vec<_>>().join("\n")
}

#[track_caller]
fn numbers(value: &Value) -> Vec<f64> {
    match value {
        Value::Array(values) => values.iter().flat_map(numbers).collect(),
        Value::Float(value) => vec![*value],
        Value::Integer(value) => vec![*value as f64],
        Value::Table(table) => table.values().flat_map(numbers).collect(),
        other => panic!("{other} is no number"),
    }
}

#[track_caller]
fn near(value: &Value, expected: &[f64]) {
    let found = numbers(value);
    assert_eq!(found.len(), expected.len(), "{found:?}");
    for (a, b) in found.iter().zip(expected) {
        assert!(
            (a - b).abs() < 1e-9 * (1.0 + b.abs()),
            "{found:?} is not {expected:?}"
        );
    }
}

/// The material of a shape.
#[track_caller]
fn material(scene: &Table, shape: usize) -> &Value {
    let id = scene["shape"][shape]["material"].as_str().unwrap();
    &scene["material"][id]
}

#[test]
fn a_camera_looks_as_in_pbrt() {
    let look = "LookAt 3 4 1.5  .5 .5 0  0 0 1\nCamera \"perspective\" \"float fov\" 45\nFilm \"rgb\" \"integer xresolution\" [400] \"integer yresolution\" [300]\nWorldBegin\nTranslate 1 2 3 Shape \"sphere\"\nLightSource \"point\" \"point3 from\" [1 2 3]";
    let scene = import(&format!("Scale -1 1 1 {look}"));
    near(&scene["camera"]["look_at"]["origin"], &[3.0, 4.0, 1.5]);
    assert_eq!(scene["camera"]["fov"].as_float(), Some(45.0));
    assert_eq!(scene["camera"]["fov_axis"].as_str(), Some("smaller"));
    assert_eq!(scene["film"]["width"].as_integer(), Some(400));
    near(
        &scene["shape"][0]["transform"]["matrix"],
        &[1.0, 0.0, 0.0, 1.0, 0.0, 1.0, 0.0, 2.0, 0.0, 0.0, 1.0, 3.0],
    );
    near(&scene["light"][0]["position"], &[2.0, 4.0, 6.0]);
    // Without the scale, the image shows pbrt's left-handed world: it is mirrored.
    let mirrored = import(look);
    near(&mirrored["camera"]["look_at"]["origin"], &[-3.0, 4.0, 1.5]);
    near(
        &mirrored["shape"][0]["transform"]["matrix"],
        &[-1.0, 0.0, 0.0, -1.0, 0.0, 1.0, 0.0, 2.0, 0.0, 0.0, 1.0, 3.0],
    );
    near(&mirrored["light"][0]["position"], &[-2.0, 4.0, 6.0]);
}

#[test]
fn windows_crops_and_lenses() {
    let scene = import(
        "Scale -1 1 1 Camera \"perspective\" \"float fov\" 90 \"float screenwindow\" [-1 1 -0.5 0.25]
         \"float lensradius\" 0.5 \"float focaldistance\" 4 Film \"rgb\" \"integer xresolution\" 100 \"integer yresolution\" 50
         \"float cropwindow\" [0.5 1 0 1] WorldBegin",
    );
    let camera = &scene["camera"];
    assert_eq!(camera["type"].as_str(), Some("thin_lens"));
    near(&camera["window"]["l"], &[0.0]);
    near(&camera["window"]["r"], &[1.0]);
    near(&camera["window"]["b"], &[-0.5]);
    near(&camera["window"]["t"], &[0.25]);
    near(&camera["aperture"], &[0.5]);
    near(&camera["focus_distance"], &[4.0]);
    assert_eq!(scene["film"]["width"].as_integer(), Some(50));
    let scene = import(
        "Scale -2 2 2 Camera \"orthographic\" Film \"rgb\" \"integer xresolution\" 30 \"integer yresolution\" 60 WorldBegin",
    );
    near(&scene["camera"]["width"], &[1.0]);
    let scene = import("Camera \"spherical\" \"string mapping\" \"equirectangular\" WorldBegin");
    near(&scene["camera"]["look_at"]["target"], &[-1.0, 0.0, 0.0]);
    // pbrt's defaults.
    let scene = import("WorldBegin Shape \"sphere\"");
    assert_eq!(scene["film"]["width"].as_integer(), Some(1280));
    near(&scene["camera"]["look_at"]["target"], &[0.0, 0.0, 1.0]);
    // A file of geometry only has none.
    let scene = import("Shape \"sphere\"");
    assert_eq!(scene["film"]["width"].as_integer(), Some(512));
}

#[test]
fn samplers_and_integrators() {
    let sampler = |text: &str| {
        let scene = import(&format!(
            "Sampler {text} Integrator \"path\" \"integer maxdepth\" 3 WorldBegin"
        ));
        assert_eq!(scene["integrator"]["max_depth"].as_integer(), Some(2));
        scene["sampler"].to_string()
    };
    assert!(
        sampler("\"stratified\" \"bool jitter\" false \"integer xsamples\" 1 \"integer ysamples\" 1")
            .contains("center")
    );
    assert!(
        sampler("\"stratified\" \"bool jitter\" false \"integer xsamples\" 3 \"integer ysamples\" 3")
            .contains("grid")
    );
    assert!(sampler("\"stratified\"").contains("stratified"));
    assert!(sampler("\"halton\" \"integer pixelsamples\" 1000").contains("64"));
    assert!(
        errors("Sampler \"haltn\"\nWorldBegin")
            .starts_with("1:1: the sampler \"haltn\" is not supported (did you mean \"halton\"?)")
    );
}

#[test]
fn attributes_keep_the_state() {
    let scene = world(
        "Material \"diffuse\" \"rgb reflectance\" [1 0 0]
         AttributeBegin Material \"diffuse\" \"rgb reflectance\" [0 1 0] Translate 1 0 0
         CoordinateSystem \"there\" Shape \"sphere\" AttributeEnd
         TransformBegin Rotate 90 0 0 1 Translate 1 0 0 Shape \"sphere\" TransformEnd
         CoordSysTransform \"there\" Shape \"sphere\"
         Identity ConcatTransform [0 2 0 0  -2 0 0 0  0 0 2 0  5 6 7 1] Shape \"sphere\"
         Attribute \"shape\" \"float radius\" 3 Shape \"sphere\" Shape \"sphere\" \"float radius\" 4",
    );
    near(&material(&scene, 0)["reflectance"], &[0.0, 1.0, 0.0]);
    near(&material(&scene, 1)["reflectance"], &[1.0, 0.0, 0.0]);
    let moved = |shape: usize| numbers(&scene["shape"][shape]["transform"]["matrix"]);
    assert_eq!(moved(0)[3], 1.0);
    assert!((moved(1)[7] - 1.0).abs() < 1e-12);
    assert_eq!(moved(2)[3], 1.0);
    near(
        &scene["shape"][3]["transform"]["matrix"],
        &[0.0, -2.0, 0.0, 5.0, 2.0, 0.0, 0.0, 6.0, 0.0, 0.0, 2.0, 7.0],
    );
    near(&scene["shape"][4]["radius"], &[3.0]);
    near(&scene["shape"][5]["radius"], &[4.0]);
}

#[test]
fn shapes() {
    let scene = world(
        "Shape \"cylinder\" \"float radius\" 2 \"float zmin\" 0 \"float zmax\" 3
         Shape \"disk\" \"float height\" 5 \"float radius\" 2
         ReverseOrientation Shape \"disk\" ReverseOrientation
         Shape \"plymesh\" \"string filename\" \"a.ply\"
         Shape \"trianglemesh\" \"point3 P\" [0 0 0 1 0 0 0 1 0] \"normal N\" [0 0 -1 0 0 -1 0 0 -1]
         Shape \"bilinearmesh\" \"point3 P\" [-1 0 -1  1 0 -1  -1 0 1  1 0 1]
         Shape \"bilinearmesh\" \"point3 P\" [0 0 0  1 0 0  0 1 0  2 2 0]",
    );
    let kind = |shape: usize| scene["shape"][shape]["type"].as_str().unwrap();
    assert_eq!(
        [0, 1, 2, 3, 4, 5, 6].map(kind),
        [
            "cylinder",
            "disk",
            "disk",
            "mesh",
            "triangle",
            "rectangle",
            "polygon"
        ]
    );
    near(
        &scene["shape"][1]["transform"]["matrix"],
        &[2.0, 0.0, 0.0, 0.0, 0.0, 2.0, 0.0, 0.0, 0.0, 0.0, 1.0, 5.0],
    );
    assert_eq!(numbers(&scene["shape"][2]["transform"]["matrix"])[10], -1.0);
    // The side is that of the normals.
    near(
        &scene["shape"][4]["vertices"],
        &[0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 1.0, 0.0, 0.0],
    );
    near(
        &scene["shape"][5]["transform"]["matrix"],
        &[1.0, 0.0, 0.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.0, 1.0, 0.0, 0.0],
    );
    let many = "0 1 2 ".repeat(65);
    let text =
        format!("Shape \"trianglemesh\" \"point3 P\" [0 0 0 1 0 0 0 1 0] \"integer indices\" [{many}]");
    assert!(errors(&text).contains("at most 64 triangles (write larger meshes as PLY"));
}

#[test]
fn area_lights_are_lights_and_surfaces() {
    let scene = world(
        "AreaLightSource \"diffuse\" \"rgb L\" [1 2 3] \"float scale\" 2
         Shape \"trianglemesh\" \"point3 P\" [0 0 0 2 0 0 2 2 0 0 2 0] \"integer indices\" [0 1 2 0 2 3]
         Shape \"sphere\" \"float alpha\" 0
         AttributeBegin ReverseOrientation Shape \"sphere\" AttributeEnd
         AreaLightSource \"diffuse\" \"bool twosided\" true \"float power\" 3
         Shape \"disk\"",
    );
    let lights = scene["light"].as_array().unwrap();
    let kinds: Vec<&str> = lights
        .iter()
        .map(|light| light["shape"].as_str().unwrap())
        .collect();
    assert_eq!(kinds, ["rectangle", "sphere", "disk", "disk"]);
    near(&lights[0]["radiance"], &[2.0, 4.0, 6.0]);
    // The middle of the rectangle, whose sides have the length 2.
    let map = numbers(&lights[0]["transform"]["matrix"]);
    assert_eq!([map[3], map[7], map[11]], [1.0, 1.0, 0.0]);
    assert!((map[0] * map[5] - map[1] * map[4] - 1.0).abs() < 1e-12);
    let pi = std::f64::consts::PI;
    near(&lights[2]["radiance"], &[3.0 / (2.0 * pi * pi)]);
    assert_eq!(scene["shape"].as_array().unwrap().len(), 4);
    assert_eq!(material(&scene, 0)["front"]["type"].as_str(), Some("emissive"));
    // The sphere that is turned inside out shines inside.
    assert_eq!(material(&scene, 2)["back"]["type"].as_str(), Some("emissive"));
    assert_eq!(material(&scene, 3)["type"].as_str(), Some("emissive"));
}

#[test]
fn lights() {
    let scene = import(
        "Scale -1 1 1 Camera \"perspective\" \"float shutterclose\" 2 Film \"rgb\" \"float iso\" 200 WorldBegin
         LightSource \"point\" \"rgb I\" [1 2 3] \"float power\" 12.566370614359172
         LightSource \"distant\" \"point3 from\" [0 5 0] \"point3 to\" [0 0 0] \"float illuminance\" 3
         LightSource \"spot\" \"float coneangle\" 40 \"float conedeltaangle\" 10
         LightSource \"infinite\" \"rgb L\" [.1 .2 .3]",
    );
    // The exposure is 4.
    near(&scene["light"][0]["intensity"], &[4.0, 8.0, 12.0]);
    near(&scene["light"][1]["direction"], &[0.0, -5.0, 0.0]);
    near(&scene["light"][1]["irradiance"], &[12.0]);
    near(&scene["light"][2]["cutoff_angle"], &[40.0]);
    near(&scene["light"][2]["beam_width"], &[30.0]);
    near(&scene["light"][2]["target"], &[0.0, 0.0, 1.0]);
    near(&scene["light"][3]["radiance"], &[0.4, 0.8, 1.2]);
    let spectra = world(
        "LightSource \"point\" \"spectrum I\" \"stdillum-D65\" LightSource \"point\" \"blackbody I\" 2700
         LightSource \"point\" \"spectrum I\" [300 1 900 1]",
    );
    near(&spectra["light"][0]["intensity"], &[1.0]);
    let warm = numbers(&spectra["light"][1]["intensity"]);
    assert!(warm[0] > warm[1] && warm[1] > warm[2]);
    assert!(
        errors("LightSource \"infinite\" \"string filename\" \"a.exr\"")
            .contains("1:1: an infinite light with an image")
    );
}

#[test]
fn materials() {
    let scene = world(
        "Material \"dielectric\" \"spectrum eta\" \"glass-BK7\" Shape \"sphere\"
         ReverseOrientation Shape \"sphere\" ReverseOrientation
         Material \"thindielectric\" \"float eta\" 1.3 Shape \"sphere\"
         Material \"conductor\" Shape \"sphere\"
         Material \"conductor\" \"spectrum eta\" \"metal-Au-eta\" \"spectrum k\" \"metal-Au-k\" Shape \"sphere\"
         Material \"conductor\" \"rgb eta\" [1 2 3] \"rgb k\" [3 2 1] Shape \"sphere\"
         Material \"conductor\" \"rgb reflectance\" [.5 .5 .5] Shape \"sphere\"
         Material \"conductor\" \"float roughness\" .01 Shape \"sphere\"
         Material \"coateddiffuse\" Shape \"sphere\"
         Material \"diffusetransmission\" Shape \"sphere\"
         MakeNamedMaterial \"red\" \"string type\" \"diffuse\" \"rgb reflectance\" [1 0 0]
         MakeNamedMaterial \"none\" \"string type\" \"interface\"
         Material \"mix\" \"string materials\" [\"red\" \"none\"] \"float amount\" .25 Shape \"sphere\"
         NamedMaterial \"red\" Shape \"sphere\" \"float alpha\" .5
         NamedMaterial \"none\" Shape \"sphere\"",
    );
    let kinds: Vec<&str> = (0..12)
        .map(|shape| material(&scene, shape)["type"].as_str().unwrap())
        .collect();
    let expected = [
        "dielectric",
        "dielectric",
        "thin_dielectric",
        "conductor",
        "conductor",
        "conductor",
        "conductor",
        "glossy",
        "plastic",
        "matte",
        "mask",
        "mask",
    ];
    assert_eq!(kinds, expected);
    assert_eq!(scene["shape"].as_array().unwrap().len(), 12);
    near(&material(&scene, 0)["interior_ior"], &[1.5168]);
    near(&material(&scene, 1)["exterior_ior"], &[1.5168]);
    assert_eq!(material(&scene, 3)["metal"].as_str(), Some("Cu"));
    assert_eq!(material(&scene, 4)["metal"].as_str(), Some("Au"));
    // Reflectance at normal incidence: k² / (4 + k²).
    let k = material(&scene, 6)["k"].as_float().unwrap();
    assert!((k * k / (4.0 + k * k) - 0.5).abs() < 1e-12);
    near(&material(&scene, 10)["opacity"], &[0.75]);
    near(&material(&scene, 11)["opacity"], &[0.5]);
}

#[test]
fn textures() {
    let scene = world(
        "Texture \"i\" \"spectrum\" \"imagemap\" \"string filename\" \"a.png\" \"float scale\" .5 \"bool invert\" true
         \"string wrap\" \"clamp\" \"string filter\" \"point\" \"string encoding\" \"linear\" \"float uscale\" 2 \"float vdelta\" .5
         Texture \"c\" \"spectrum\" \"checkerboard\" \"rgb tex1\" [1 0 0] \"texture tex2\" \"i\"
         Texture \"f\" \"float\" \"constant\" \"float value\" .25
         Texture \"m\" \"spectrum\" \"mix\" \"texture tex1\" \"c\" \"texture amount\" \"f\"
         Translate 1 0 0
         Texture \"p\" \"spectrum\" \"imagemap\" \"string filename\" \"a.png\" \"string mapping\" \"planar\" \"vector3 v1\" [0 0 2]
         Texture \"3\" \"spectrum\" \"checkerboard\" \"integer dimension\" 3
         Texture \"s\" \"spectrum\" \"scale\" \"texture tex\" \"p\" \"float scale\" 3",
    );
    let texture = |id: &str| &scene["texture"][id];
    let image = &texture("i")["weight"]["factors"][1];
    assert_eq!(image["file"].as_str(), Some("a.png"));
    assert_eq!(image["wrap"].as_str(), Some("clamp"));
    assert_eq!(image["filter"].as_str(), Some("nearest"));
    assert_eq!(image["color_space"].as_str(), Some("linear"));
    near(&image["scale"], &[2.0, 1.0]);
    near(&image["offset"], &[0.0, 0.5]);
    assert_eq!(texture("c")["weight"]["type"].as_str(), Some("checker"));
    near(&texture("m")["weight"], &[0.25]);
    // q_x is twice z, q_y is y, and the origin is the texture's.
    let planar = numbers(&texture("p")["mapping"]["transform"]["matrix"]);
    assert_eq!(planar[..8], [0.0, 0.0, 2.0, 0.0, 0.0, 1.0, 0.0, 0.0]);
    assert_eq!(numbers(&texture("3")["mapping"]["transform"]["matrix"])[3], -1.0);
    assert_eq!(texture("s")["factors"][1].as_float(), Some(3.0));
}

#[test]
fn displacements_become_bump_maps() {
    let scene = world(
        "Texture \"h\" \"float\" \"imagemap\" \"string filename\" \"a.png\"
         Material \"diffuse\" \"texture displacement\" \"h\" Shape \"sphere\"",
    );
    let bump = material(&scene, 0);
    assert_eq!(
        (bump["type"].as_str(), bump["material"]["type"].as_str()),
        (Some("bump"), Some("matte"))
    );
    assert!(
        bump["height"]
            .as_str()
            .is_some_and(|id| scene["texture"].get(id).is_some())
    );
}

#[test]
fn objects_and_files() {
    let scene = import(
        "WorldBegin ObjectBegin \"o\" Translate 1 0 0 Shape \"sphere\" ObjectEnd
         Translate 0 1 0 ObjectInstance \"o\" Import \"moved.pbrt\" Shape \"sphere\" Include \"moved.pbrt\" Shape \"sphere\"",
    );
    let moved = |table: &Value| {
        let map = numbers(&table["transform"]["matrix"]);
        [map[0], map[3], map[7], map[11]]
    };
    assert_eq!(moved(&scene["group"]["o"]["shape"][0]), [1.0, 1.0, 0.0, 0.0]);
    // The world is mirrored, the group is not.
    assert_eq!(moved(&scene["shape"][0]), [-1.0, 0.0, 1.0, 0.0]);
    assert_eq!(moved(&scene["shape"][1]), [-1.0, -1.0, 3.0, 3.0]);
    assert_eq!(moved(&scene["shape"][2]), [-1.0, 0.0, 1.0, 0.0]);
    assert_eq!(moved(&scene["shape"][4]), [-1.0, -1.0, 3.0, 3.0]);
    let (_, notes) =
        try_import("WorldBegin MediumInterface \"a\" \"\" MakeNamedMedium \"a\" \"string type\" \"cloud\"")
            .unwrap();
    let media = notes
        .iter()
        .find(|note| note.feature.name == "MakeNamedMedium, MediumInterface")
        .unwrap();
    assert_eq!(media.places, ["1:12", "1:35"]);
}

#[test]
fn errors_name_the_place_and_the_nearest_name() {
    let cases = [
        (
            "\nShape \"spher\"",
            "2:1: the shape \"spher\" is not supported (did you mean \"sphere\"?)",
        ),
        (
            "Shap \"sphere\"",
            "1:1: unknown directive `Shap` (did you mean \"Shape\"?)",
        ),
        (
            "Shape \"sphere\" \"float radios\" 1",
            "1:16: unknown parameter \"radios\" of Shape \"sphere\" (did you mean \"radius\"?)",
        ),
        (
            "Shape \"sphere\" \"flot radius\" 1",
            "1:16: unknown type of parameter \"flot\" (did you mean \"float\"?)",
        ),
        (
            "Include \"part.pbrt\"",
            "part.pbrt:2:3: the shape \"spere\" is not supported (did you mean \"sphere\"?)",
        ),
        (
            "Include \"loop.pbrt\"",
            "loop.pbrt:1:9: \"loop.pbrt\" includes itself",
        ),
        (
            "Include \"../x.pbrt\"",
            "1:9: \"../x.pbrt\" is outside of the folder of the scene; `convert --allow-outside` reads it",
        ),
        (
            "Include \"no.pbrt\"",
            "1:9: cannot read \"no.pbrt\": there is no such file",
        ),
        ("AttributeBegin", "1:1: the file ends before its AttributeEnd"),
        (
            "AttributeBegin TransformEnd AttributeEnd",
            "1:29: AttributeEnd without AttributeBegin",
        ),
        (
            "WorldEnd",
            "1:1: unknown directive `WorldEnd` (the file is for pbrt-v3: convert it with `pbrt --upgrade`)",
        ),
        (
            "Shape \"sphere\" \"float radius\" 1e99",
            "1:31: the number `1e99` is out of range",
        ),
        (
            "Shape \"sphere\" \"float radius\" nan",
            "1:31: expected a number, found `nan`",
        ),
        (
            "Shape \"sphere\" \"float radius\" [1 2",
            "1:35: expected `]`, found the end of the file",
        ),
        (
            "Translate 1 2",
            "1:14: expected 3 numbers, found the end of the file",
        ),
        ("Shape \"sphere", "1:7: the file ends inside a string"),
        (
            "Shape \"trianglemesh\" \"point3 P\" [1 2]",
            "1:33: \"P\" has 2 values, which are no point3",
        ),
        (
            "Shape \"trianglemesh\" \"point3 P\" [0 0 0 1 0 0 0 1 0] \"integer indices\" [0 1 3]",
            "1:1: there is no point 3: \"P\" has 3 points",
        ),
        (
            "Material \"diffuse\" \"texture reflectance\" \"x\"",
            "1:20: no spectrum texture is called \"x\" here",
        ),
        ("NamedMaterial \"x\"", "1:15: no material is called \"x\" here"),
        ("ObjectInstance \"x\"", "1:16: no object is called \"x\""),
        (
            "Scale 0 1 1 Shape \"disk\"",
            "1:13: the transform of a shape cannot be inverted or is too large",
        ),
        (
            "Shape \"sphere\" \"float zmin\" 0",
            "1:1: a part of Shape \"sphere\" is not supported, only the whole",
        ),
    ];
    for (text, expected) in cases {
        assert_eq!(errors(text), expected, "{text}");
    }
    // All at once.
    let all =
        errors("Shape \"spher\"\nFoo 1 2 3\n[ Shape \"disc\" \"float a\" [1 [\nTranslate 1 Shape \"curve\"");
    let places: Vec<&str> = all.lines().map(|line| line.split(": ").next().unwrap()).collect();
    assert_eq!(places, ["1:1", "2:1", "3:29", "4:13", "4:13"], "{all}");
}

#[test]
fn notes_tell_what_is_lost() {
    let text =
        "Integrator \"volpath\" PixelFilter \"box\" Sampler \"sobol\" WorldBegin Material \"coateddiffuse\"";
    assert_eq!(notes(text), ["Material coateddiffuse", "Integrator"]);
}

/// A scene of everything.
const RICH: &str = "Option \"seed\" 1\nScale -1 1 1 LookAt 0 1 5 0 0 0 0 1 0\nCamera \"perspective\" \"float fov\" [40]\n\
    Film \"rgb\" \"integer xresolution\" [64] \"integer yresolution\" [48] \"string filename\" \"x.exr\"\n\
    Sampler \"halton\" \"integer pixelsamples\" 16\nIntegrator \"path\" \"integer maxdepth\" [5]\n\
    PixelFilter \"box\"\nWorldBegin # the world\n\
    Texture \"c\" \"spectrum\" \"checkerboard\" \"float uscale\" 8 \"rgb tex1\" [.1 .2 .3] \"rgb tex2\" [.8 .8 .8]\n\
    Texture \"i\" \"spectrum\" \"imagemap\" \"string filename\" \"a.png\"\n\
    AttributeBegin\nMaterial \"diffuse\" \"texture reflectance\" \"c\"\nTranslate 0 -1 0 Rotate 30 1 2 3\n\
    Shape \"bilinearmesh\" \"point3 P\" [-9 0 -9 9 0 -9 -9 0 9 9 0 9]\nAttributeEnd\n\
    LightSource \"point\" \"point3 from\" [1 5 2] \"blackbody I\" 3000 \"float scale\" 10\n\
    AttributeBegin AreaLightSource \"diffuse\" \"rgb L\" [5 5 5]\n\
    Shape \"trianglemesh\" \"point3 P\" [0 3 0 2 3 0 2 3 2 0 3 2] \"integer indices\" [0 1 2 0 2 3]\nAttributeEnd\n\
    MakeNamedMaterial \"g\" \"string type\" \"dielectric\" \"float eta\" 1.5\nNamedMaterial \"g\"\n\
    ObjectBegin \"o\" Shape \"sphere\" \"float radius\" .5 ObjectEnd\n\
    AttributeBegin ConcatTransform [1 0 0 0 0 1 0 0 0 0 1 0 1 2 3 1] ObjectInstance \"o\" AttributeEnd\n\
    Include \"moved.pbrt\"\nShape \"plymesh\" \"string filename\" \"a.ply\"\n\
    LightSource \"infinite\" \"spectrum L\" [400 1 700 2]\nMaterial \"conductor\" \"spectrum eta\" \"metal-Au-eta\"\n\
    Shape \"cylinder\" \"float radius\" .3 \"bool x\" false\n";

#[test]
fn mutants_are_scenes_or_errors() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("a.ply"), PLY).unwrap();
    fs::write(folder.path().join("a.png"), "").unwrap();
    fs::write(
        folder.path().join("moved.pbrt"),
        "Translate 1 2 3 Shape \"disk\"\n",
    )
    .unwrap();
    let path = folder.path().join("s.pbrt");
    let rich = RICH.replace(" \"bool x\" false", "");
    let mut seed = 1_u64;
    let mut random = move |below: usize| {
        // Knuth's generator.
        seed = seed
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (seed >> 33) as usize % below
    };
    let numbers = [
        "0",
        "-1",
        "1e38",
        "-1e38",
        "1e-38",
        "1e308",
        "-2147483648",
        "4294967296",
        "0.5",
        "nan",
        "[",
        "]",
        "\"a\"",
    ];
    let bytes = b"\"[]#\\\n\0 -.e09azA\xff\x80";
    fs::write(&path, &rich).unwrap();
    assert_eq!(Pbrt.import(&path, &ImportOptions::all()).unwrap().err(), None);
    let mut whole = 0;
    for mutant in 0..2000 {
        let mut text = rich.clone().into_bytes();
        match mutant % 4 {
            0 => text[random(rich.len())] = bytes[random(bytes.len())],
            1 => drop(text.remove(random(rich.len()))),
            2 => {
                // One number becomes another.
                let words: Vec<&str> = rich.split(' ').collect();
                let mut words: Vec<String> = words.into_iter().map(str::to_owned).collect();
                let places: Vec<usize> = (0..words.len())
                    .filter(|place| words[*place].trim_matches(['[', ']']).parse::<f64>().is_ok())
                    .collect();
                let place = places[random(places.len())];
                let number = words[place].trim_matches(['[', ']']).to_owned();
                words[place] = words[place].replace(&number, numbers[random(numbers.len())]);
                text = words.join(" ").into_bytes();
            }
            _ => text.truncate(random(rich.len())),
        }
        fs::write(&path, &text).unwrap();
        match Pbrt.import(&path, &ImportOptions::all()).unwrap() {
            Ok(imported) => {
                whole += 1;
                imported.text.parse::<Table>().unwrap();
            }
            Err(errors) => assert!(!errors.0.is_empty() && errors.0.len() <= 101),
        }
    }
    assert!(whole > 200 && whole < 1800, "{whole} of 2000");
}

#[test]
fn definitions_that_nothing_uses_may_be_unsupported() {
    let defined = "Texture \"t\" \"float\" \"fbm\"\n\
                   Texture \"u\" \"float\" \"scale\" \"texture tex\" \"t\"\n\
                   MakeNamedMaterial \"m\" \"string type\" \"hair\"\n\
                   MakeNamedMaterial \"n\" \"string type\" \"mix\" \"string materials\" [\"m\" \"m\"]\n";
    import(defined);
    for (used, expected) in [
        (
            "NamedMaterial \"m\"\nNamedMaterial \"m\"",
            "3:1: the material \"hair\" is not supported",
        ),
        (
            "NamedMaterial \"n\"",
            "3:1: the material \"hair\" is not supported",
        ),
        (
            "Material \"diffuse\" \"texture displacement\" \"u\"",
            "1:1: the texture \"fbm\" is not supported",
        ),
    ] {
        assert_eq!(errors(&format!("{defined}{used}")), expected, "{used}");
    }
}

#[test]
fn hostile_files_end_soon() {
    let deep = "AttributeBegin\n".repeat(100_000);
    assert!(errors(&deep).contains("more than 1024 attributes inside each other"));
    let nested: String = (0..1000)
        .map(|k| {
            format!(
                "Texture \"t{}\" \"spectrum\" \"scale\" \"texture tex\" \"t{k}\"\n",
                k + 1
            )
        })
        .collect();
    let used: String = (0..1000)
        .map(|k| format!("Material \"diffuse\" \"texture reflectance\" \"t{k}\"\n"))
        .collect();
    let text = format!("Texture \"t0\" \"spectrum\" \"checkerboard\"\n{nested}{used}");
    assert!(errors(&text).contains("nested more than 12 deep"));
    let mixed: String = (0..100)
        .map(|k| format!("MakeNamedMaterial \"m{}\" \"string type\" \"mix\" \"string materials\" [\"m{k}\" \"m{k}\"]\n", k + 1))
        .collect();
    let used: String = (0..100).map(|k| format!("NamedMaterial \"m{k}\"\n")).collect();
    let text = format!("MakeNamedMaterial \"m0\" \"string type\" \"diffuse\"\n{mixed}{used}");
    assert!(errors(&text).contains("nested more than 12 deep"));
    let scaled = "Scale 1e30 1e30 1e30\n".repeat(50);
    assert!(errors(&format!("{scaled}Shape \"sphere\"")).contains("too large"));
    let zeros = "1".repeat(1 << 20);
    assert!(errors(&format!("Translate {zeros} 0 0")).contains("too long"));
    errors(&"[".repeat(1 << 20));
    errors(&"Attribute \"shape\" \"float x\" 1 \"float x\" 2\n".repeat(1 << 12));
}

// Export.

/// A document that is exported to a folder and imported again: the written text, the imported
/// scene, and the notes of both.
fn round_trip(
    document: &Table,
    base: &Path,
    out: &Path,
) -> Result<(String, Table, Vec<Note>), Vec<FormatError>> {
    let scene = ExportScene { document, base };
    let mut notes = Pbrt.export(&scene, out).unwrap().map_err(|errors| errors.0)?;
    let text = fs::read_to_string(out).unwrap();
    let imported = Pbrt
        .import(out, &ImportOptions::all())
        .unwrap()
        .map_err(|errors| errors.0)?;
    notes.extend(imported.notes);
    Ok((text, imported.text.parse().unwrap(), notes))
}

/// The scene that comes back, and the names of all notes. A second round trip changes nothing.
#[track_caller]
fn back(text: &str) -> (Table, Vec<&'static str>) {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("a.ply"), PLY).unwrap();
    fs::write(folder.path().join("a.png"), "").unwrap();
    let obj = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 1\nf 1/1 2/1 3/2 4/2\nf -4 -3 -2\n";
    fs::write(folder.path().join("a.obj"), obj).unwrap();
    let document: Table = text.parse().unwrap();
    let out = folder.path().join("out.pbrt");
    let (written, first, notes) = round_trip(&document, folder.path(), &out).unwrap();
    let (_, second, _) = round_trip(&first, folder.path(), &folder.path().join("again.pbrt"))
        .unwrap_or_else(|errors| panic!("{errors:?}\n{written}"));
    same(&resolved(&first), &resolved(&second), &written);
    (first, notes.iter().map(|note| note.feature.name).collect())
}

/// A scene in which the ids of materials and textures are replaced by what they stand for.
fn resolved(scene: &Table) -> Value {
    fn value(scene: &Table, inner: &Value, key: &str) -> Value {
        match inner {
            Value::String(id) if !matches!(key, "type" | "file" | "group") => ["material", "texture"]
                .into_iter()
                .find_map(|family| scene.get(family)?.get(id))
                .map_or(inner.clone(), |table| value(scene, table, "")),
            Value::Array(values) => {
                Value::Array(values.iter().map(|inner| value(scene, inner, key)).collect())
            }
            Value::Table(table) => Value::Table(
                table
                    .iter()
                    .map(|(key, inner)| (key.clone(), value(scene, inner, key)))
                    .collect(),
            ),
            _ => inner.clone(),
        }
    }
    let mut rest = scene.clone();
    rest.remove("material");
    rest.remove("texture");
    value(scene, &Value::Table(rest), "")
}

/// Fails where two values differ by more than rounding.
#[track_caller]
fn same(a: &Value, b: &Value, what: &str) {
    match (a, b) {
        (Value::Float(a), Value::Float(b)) => {
            assert!((a - b).abs() < 1e-9 * (1.0 + a.abs()), "{a} {b} {what}")
        }
        (Value::Array(a), Value::Array(b)) if a.len() == b.len() => {
            for (a, b) in a.iter().zip(b) {
                same(a, b, what);
            }
        }
        (Value::Table(a), Value::Table(b)) if a.keys().eq(b.keys()) => {
            for (key, a) in a {
                same(a, &b[key], what);
            }
        }
        _ => assert_eq!(a, b, "{what}"),
    }
}

const CAMERA: &str = "[film]\nwidth = 30\nheight = 20\n[camera]\ntype = \"perspective\"\nfov = 60\n\
                      look_at = { origin = [1, 2, 3], target = [1, 2, 2] }\n";

#[test]
fn views_come_back() {
    let (scene, notes) = back(CAMERA);
    assert_eq!(scene["film"]["width"].as_integer(), Some(30));
    near(&scene["camera"]["look_at"]["origin"], &[1.0, 2.0, 3.0]);
    near(&scene["camera"]["look_at"]["target"], &[1.0, 2.0, 2.0]);
    near(&scene["camera"]["look_at"]["up"], &[0.0, 1.0, 0.0]);
    assert_eq!(scene["camera"]["fov_axis"].as_str(), Some("smaller"));
    let half = (scene["camera"]["fov"].as_float().unwrap() / 2.0)
        .to_radians()
        .tan();
    assert!((half * 1.5 - 30_f64.to_radians().tan()).abs() < 1e-12);
    assert_eq!(scene["sampler"]["type"].as_str(), Some("center"));
    assert_eq!(scene["integrator"]["max_depth"].as_integer(), Some(6));
    assert_eq!(notes, ["[integrator]", "Integrator"]);
    let with = |camera: &str| {
        back(&format!("[film]\nwidth = 30\nheight = 20\n{camera}\nlook_at = {{ origin = [3, 1, 0], target = [0, 0, 0], up = [0, 0, 1] }}\n")).0
    };
    let scene = with("[camera]\ntype = \"perspective\"\nwindow = { l = -1, r = 2, b = -3, t = 4, d = 2 }");
    near(&scene["camera"]["window"]["r"], &[1.0]);
    near(&scene["camera"]["window"]["b"], &[-1.5]);
    let scene = with(
        "[camera]\ntype = \"thin_lens\"\nfov = 20\nfov_axis = \"y\"\naperture = 0.25\nfocus_distance = 3",
    );
    near(&scene["camera"]["fov"], &[20.0]);
    near(&scene["camera"]["aperture"], &[0.25]);
    near(&scene["camera"]["focus_distance"], &[3.0]);
    let scene = with("[camera]\ntype = \"orthographic\"\nwidth = 5");
    near(&scene["camera"]["width"], &[5.0]);
    let scene = with("[camera]\ntype = \"orthographic\"\nwindow = { l = -1, r = 2, b = -3, t = 4 }");
    near(&scene["camera"]["window"]["t"], &[4.0]);
    let scene = with("[camera]\ntype = \"environment\"");
    let target = numbers(&scene["camera"]["look_at"]["target"]);
    let length = 10_f64.sqrt();
    assert!((target[0] - 3.0 + 3.0 / length).abs() < 1e-9 && (target[1] - 1.0 + 1.0 / length).abs() < 1e-9);
    for (sampler, kind) in [
        ("grid", "grid"),
        ("stratified", "stratified"),
        ("sobol", "sobol"),
        ("adaptive", "sobol"),
    ] {
        let (scene, _) = back(&format!("{CAMERA}[sampler]\ntype = \"{sampler}\"\n"));
        assert_eq!(scene["sampler"]["type"].as_str(), Some(kind));
    }
}

#[test]
fn lights_come_back() {
    let (scene, notes) = back(&format!(
        "{CAMERA}[[light]]\ntype = \"point\"\nposition = [1, 2, 3]\nintensity = [0.1, 0.2, 0.3]\n\
         [[light]]\ntype = \"directional\"\ndirection = [1, -2, 3]\nirradiance = 3\n\
         [[light]]\ntype = \"spot\"\nposition = [1, 2, 3]\ntarget = [0, 0, 0]\nintensity = 2\ncutoff_angle = 40\n\
         [[light]]\ntype = \"environment\"\nradiance = 0.25\n\
         [[light]]\ntype = \"ambient\"\nradiance = 0.25\n"
    ));
    let lights = scene["light"].as_array().unwrap();
    assert_eq!(lights.len(), 4);
    near(&lights[0]["intensity"], &[0.1, 0.2, 0.3]);
    near(&lights[0]["position"], &[1.0, 2.0, 3.0]);
    near(&lights[1]["direction"], &[1.0, -2.0, 3.0]);
    near(&lights[1]["irradiance"], &[3.0]);
    near(&lights[2]["beam_width"], &[30.0]);
    near(&lights[3]["radiance"], &[0.25]);
    assert!(notes.contains(&"[[light]] ambient"));
    let (_, notes) = back(&format!(
        "{CAMERA}[[light]]\ntype = \"spot\"\nposition = [1, 2, 3]\ntarget = [0, 0, 0]\nintensity = 2\nimage = 1\n\
         [[light]]\ntype = \"area\"\nradiance = 2\nfalloff = \"none\"\n\
         [[shape]]\ntype = \"heightfield\"\nheight = {{ type = \"noise\" }}\n\
         [[shape]]\ntype = \"heightfield\"\nheight = 0.25\n"
    ));
    for feature in [
        "[[light]] image of a spot",
        "[[light]] falloff none",
        "[[shape]] heightfield with a texture",
    ] {
        assert!(notes.contains(&feature), "{feature}: {notes:?}");
    }
    assert!(!notes.contains(&"[[light]] area"));
}

#[test]
fn shapes_come_back() {
    let transform =
        "transform = [{ rotate = { axis = [1, 2, 3], degrees = 40 } }, { translate = [1, 2, 3] }]\n";
    let (scene, notes) = back(&format!(
        "{CAMERA}[[shape]]\ntype = \"sphere\"\nradius = 2\ncenter = [0, 0, 1]\n{transform}\
         [[shape]]\ntype = \"rectangle\"\n{transform}[[shape]]\ntype = \"disk\"\n{transform}\
         [[shape]]\ntype = \"triangle\"\nvertices = [[0, 0, 0], [1, 0, 0], [0, 0.1, 3]]\n{transform}\
         [[shape]]\ntype = \"mesh\"\nfile = \"a.ply\"\n{transform}[[shape]]\ntype = \"mesh\"\nfile = \"a.obj\"\n\
         [[shape]]\ntype = \"polygon\"\nvertices = [[0, 0, 0], [2, 0, 0], [2, 1, 0], [0, 3, 0]]\n\
         [[shape]]\ntype = \"cylinder\"\nradius = 0.5\nz = [0, 2]\n\
         [[shape]]\ntype = \"instance\"\ngroup = \"g\"\n{transform}\
         [[shape]]\ntype = \"instance\"\ngroup = \"g\"\n\
         [[shape]]\ntype = \"box\"\n[[shape]]\ntype = \"torus\"\n\
         [[group.g.shape]]\ntype = \"disk\"\n{transform}material = {{ type = \"matte\" }}\n"
    ));
    let shapes = scene["shape"].as_array().unwrap();
    let kinds: Vec<&str> = shapes
        .iter()
        .map(|shape| shape["type"].as_str().unwrap())
        .collect();
    let first = [
        "sphere",
        "rectangle",
        "disk",
        "triangle",
        "mesh",
        "mesh",
        "polygon",
        "cylinder",
        "disk",
        "disk",
        "instance",
        "instance",
    ];
    assert_eq!(kinds[..12], first);
    assert_eq!(kinds[12..], ["rectangle"; 6]);
    let axis = whitstone_core::DVec3::new(1.0, 2.0, 3.0);
    let map = whitstone_core::DAffine3::from_translation(axis)
        * whitstone_core::DAffine3::from_axis_angle(axis.normalize(), 40_f64.to_radians());
    let expected = numbers(&crate::document::transform(&map));
    for shape in [1, 2, 3, 4, 10] {
        near(&shapes[shape]["transform"]["matrix"], &expected);
    }
    near(&scene["group"]["g"]["shape"][0]["transform"]["matrix"], &expected);
    near(&shapes[0]["radius"], &[2.0]);
    near(
        &shapes[3]["vertices"],
        &[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.1, 3.0],
    );
    near(
        &shapes[6]["vertices"],
        &[0.0, 0.0, 0.0, 2.0, 0.0, 0.0, 2.0, 1.0, 0.0, 0.0, 3.0, 0.0],
    );
    // The first face of the box is that of -x, with u along y, v along z.
    near(
        &shapes[12]["transform"]["matrix"],
        &[0.0, 0.0, -1.0, -1.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0],
    );
    assert_eq!(shapes[4]["file"].as_str(), Some("a.ply"));
    assert_eq!(shapes[5]["file"].as_str(), Some("out-mesh2.ply"));
    assert_eq!(notes, ["[integrator]", "[[shape]] of another type", "Integrator"]);
}

#[test]
fn area_lights_come_back() {
    let (scene, _) = back(&format!(
        "{CAMERA}[[light]]\ntype = \"area\"\nradiance = 3\ntransform = {{ translate = [1, 0, 0] }}\n\
         [[light]]\ntype = \"area\"\nshape = \"sphere\"\nradiance = [1, 2, 3]\ntransform = {{ scale = 2 }}\n\
         [[light]]\ntype = \"area\"\nshape = \"mesh\"\nfile = \"a.ply\"\nradiance = 4\n\
         [[shape]]\ntype = \"sphere\"\nradius = 2\nmaterial = {{ type = \"two_sided\", front = {{ type = \"emissive\", radiance = [1, 2, 3] }}, back = {{ type = \"matte\" }} }}\n"
    ));
    let lights = scene["light"].as_array().unwrap();
    let kinds: Vec<&str> = lights
        .iter()
        .map(|light| light["shape"].as_str().unwrap())
        .collect();
    assert_eq!(kinds, ["sphere", "rectangle", "mesh"]);
    near(&lights[0]["radiance"], &[1.0, 2.0, 3.0]);
    near(&lights[1]["radiance"], &[3.0]);
    assert_eq!(numbers(&lights[1]["transform"]["matrix"])[3], 1.0);
    assert_eq!(lights[2]["file"].as_str(), Some("a.ply"));
    assert_eq!(scene["shape"].as_array().unwrap().len(), 1);
    assert_eq!(material(&scene, 0)["front"]["type"].as_str(), Some("emissive"));
}

#[test]
fn materials_and_textures_come_back() {
    let shape = |material: &str| format!("[[shape]]\ntype = \"sphere\"\nmaterial = {material}\n");
    let materials = [
        "{ type = \"matte\", reflectance = [0.1, 0.2, 0.3] }",
        "{ type = \"dielectric\", interior_ior = 1.25 }",
        "{ type = \"thin_dielectric\", interior_ior = 1.3 }",
        "{ type = \"conductor\", metal = \"Au\" }",
        "{ type = \"conductor\", eta = [1, 2, 3], k = 4 }",
        "{ type = \"mix\", a = \"red\", b = { type = \"dielectric\" }, weight = 0.25 }",
        "{ type = \"mask\", opacity = 0.5, material = \"red\" }",
        "{ type = \"matte\", reflectance = \"image\" }",
        "{ type = \"matte\", reflectance = { type = \"checker\", a = 0.1, b = [1, 0, 0], scale = [2, 4], offset = [0, 0.5] } }",
        "{ type = \"matte\", reflectance = { type = \"checker3d\", a = 0.1, b = 1, scale = 4, offset = [0, 0.5, 0] } }",
        "{ type = \"matte\", reflectance = { type = \"mix\", a = \"image\", b = 0.5, weight = 0.25 } }",
        "{ type = \"matte\", reflectance = { type = \"product\", factors = [\"image\", 0.5] } }",
        "{ type = \"matte\", reflectance = { type = \"image\", file = \"a.png\", mapping = { projection = \"planar\", transform = { scale = [2, 3, 6] } } } }",
        "{ type = \"mirror\", reflectance = 0.5 }",
        "\"a \\\"b\\\"\"",
    ];
    let shapes: String = materials.iter().map(|material| shape(material)).collect();
    let (scene, notes) = back(&format!(
        "{CAMERA}{shapes}[material.red]\ntype = \"matte\"\nreflectance = [1, 0, 0]\n\
         [material.\"a \\\"b\\\"\"]\ntype = \"matte\"\nreflectance = 0.75\n\
         [texture.image]\ntype = \"image\"\nfile = \"a.png\"\nwrap = \"clamp\"\nfilter = \"nearest\"\ncolor_space = \"linear\"\n"
    ));
    near(&material(&scene, 0)["reflectance"], &[0.1, 0.2, 0.3]);
    near(&material(&scene, 1)["interior_ior"], &[1.25]);
    near(&material(&scene, 2)["interior_ior"], &[1.3]);
    assert_eq!(material(&scene, 3)["metal"].as_str(), Some("Au"));
    near(&material(&scene, 4)["eta"], &[1.0, 2.0, 3.0]);
    near(&material(&scene, 5)["weight"], &[0.25]);
    assert_eq!(material(&scene, 5)["a"].as_str(), Some("red"));
    near(&material(&scene, 6)["opacity"], &[0.5]);
    let texture = |shape: usize| {
        let id = material(&scene, shape)["reflectance"].as_str().unwrap();
        &scene["texture"][id]
    };
    assert_eq!(texture(7)["wrap"].as_str(), Some("clamp"));
    assert_eq!(texture(7)["filter"].as_str(), Some("nearest"));
    assert_eq!(texture(7)["color_space"].as_str(), Some("linear"));
    near(&texture(8)["scale"], &[2.0, 4.0]);
    near(&texture(8)["offset"], &[0.0, 0.5]);
    near(&texture(8)["b"], &[1.0, 0.0, 0.0]);
    let solid = numbers(&texture(9)["mapping"]["transform"]["matrix"]);
    assert_eq!([solid[0], solid[5], solid[7]], [4.0, 4.0, 0.5]);
    near(&texture(10)["weight"], &[0.25]);
    near(&texture(11)["factors"][1], &[0.5]);
    let planar = numbers(&texture(12)["mapping"]["transform"]["matrix"]);
    assert_eq!([planar[0], planar[5]], [2.0, 3.0]);
    assert_eq!(material(&scene, 13)["type"].as_str(), Some("conductor"));
    near(&material(&scene, 14)["reflectance"], &[0.75]);
    assert_eq!(notes, ["[integrator]", "[material] mirror", "Integrator"]);
}

/// All scenes of the repository: export and import end without a panic.
#[test]
fn scenes_of_the_repository() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../scenes");
    let mut pending = vec![root.clone()];
    let mut paths = Vec::new();
    while let Some(folder) = pending.pop() {
        for entry in fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                pending.push(path);
            } else if path.extension().is_some_and(|extension| extension == "toml") {
                paths.push(path);
            }
        }
    }
    paths.sort();
    let mut registry = whitstone_core::Registry::default();
    crate::register(&mut registry);
    let mut dropped = std::collections::BTreeMap::<&str, usize>::new();
    let (mut read, mut whole, mut refused) = (0, 0, Vec::new());
    for path in &paths {
        let Ok(sources) = whitstone_scene::Sources::load(path, &[], &registry) else {
            continue;
        };
        let Ok(description) = whitstone_scene::Description::parse(&sources).into_result() else {
            continue;
        };
        let document: Table = description.flattened.text.parse().unwrap();
        let folder = tempfile::tempdir().unwrap();
        read += 1;
        match round_trip(
            &document,
            &description.flattened.base,
            &folder.path().join("s.pbrt"),
        ) {
            Ok((_, _, notes)) => {
                let lost: Vec<&Note> = notes
                    .iter()
                    .filter(|note| note.feature.treatment == whitstone_core::Treatment::Dropped)
                    .collect();
                whole += usize::from(lost.is_empty());
                for note in lost {
                    *dropped.entry(note.feature.name).or_default() += 1;
                }
            }
            Err(errors) => {
                assert!(!errors.is_empty());
                let name = path.strip_prefix(&root).unwrap().display();
                refused.push(format!("{name}: {}: {}", errors[0].place, errors[0].message));
            }
        }
    }
    println!(
        "{read} of {} scenes exported, {whole} without a dropped note, {} refused:",
        paths.len(),
        refused.len()
    );
    println!("{}", refused.join("\n"));
    for (name, count) in dropped {
        println!("{count} scenes: {name}");
    }
    assert!(read > 100 && whole > 20 && refused.len() < read / 10);
}

/// The albedo of a base under a coat is that which gives the reflectance; a rough metal has the
/// width of the lobe.
#[test]
fn plastic_and_rough_materials_are_written() {
    let scene = "[camera]\ntype = 'perspective'\nfov = 40\nlook_at = { origin = [0, 0, 5], target = [0, 0, 0] }\n\
         [[shape]]\ntype = 'sphere'\nmaterial = { type = 'plastic', reflectance = [0.1, 0.5, 1], interior_ior = 1.4 }\n\
         [[shape]]\ntype = 'sphere'\nmaterial = { type = 'rough', material = { type = 'conductor', metal = 'Cu' } }\n\
         [[shape]]\ntype = 'sphere'\nmaterial = { type = 'rough', material = { type = 'thin_dielectric' } }\n";
    let (back, notes) = back(scene);
    let plastic = material(&back, 0);
    assert_eq!(plastic["type"].as_str(), Some("plastic"));
    near(&plastic["reflectance"], &[0.1, 0.5, 1.0]);
    near(&plastic["interior_ior"], &[1.4]);
    assert_eq!(material(&back, 1)["type"].as_str(), Some("glossy"));
    assert_eq!(material(&back, 2)["type"].as_str(), Some("thin_dielectric"));
    assert!(notes.contains(&"[material] plastic") && notes.contains(&"[material] rough"));
}

#[test]
fn transform_blocks_keep_all_attributes() {
    let scene = world(
        "TransformBegin AreaLightSource \"diffuse\" \"rgb L\" [5 5 5] Material \"conductor\" Translate 0 3 0 \
         Shape \"sphere\" TransformEnd Shape \"sphere\"",
    );
    assert_eq!(scene["light"].as_array().unwrap().len(), 1);
    let shapes = scene["shape"].as_array().unwrap();
    assert_ne!(shapes[0].get("material"), shapes[1].get("material"));
    // The two names may be mixed.
    world("TransformBegin Translate 0 3 0 AttributeEnd AttributeBegin TransformEnd Shape \"sphere\"");
}

#[test]
fn spread_reflections_end_when_they_count_little() {
    let integrator = |material: &str| {
        let text = format!(
            "Integrator \"path\" \"integer maxdepth\" 8 Camera \"perspective\" WorldBegin\n{material} Shape \"sphere\""
        );
        let scene = import(&text);
        scene["integrator"]
            .get("min_contribution")
            .and_then(Value::as_float)
    };
    assert_eq!(
        integrator("Material \"conductor\" \"float roughness\" 0.1"),
        Some(1e-3)
    );
    assert_eq!(integrator("Material \"diffuse\""), None);
}
