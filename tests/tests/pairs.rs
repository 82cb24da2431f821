//! Every pair of a shape and a material, a texture, a light and a camera has a reference in
//! Mitsuba, and passes. A scene holds all shapes side by side, with one material, texture, light or
//! camera. Listed as ignored where Mitsuba's environment is not there.

use libtest_mimic::{Arguments, Failed, Trial};
use std::collections::BTreeMap;
use std::fmt::Write;
use std::fs;
use std::path::{Path, PathBuf};
use std::time::Duration;
use whitstone::core::FamilyName;
use whitstone::render::RenderOptions;
use whitstone::validate::environment::Environment;
use whitstone::validate::{Installation, Mode, Options, REFERENCES, Renderer, Status, Validator};
use whitstone_tests::{load, root};

/// Shapes that are not in the pairs, and why.
const LEFT_OUT: [(&str, &str); 3] = [
    (
        "fractal",
        "a level set: its twin is POV-Ray's, with a stored reference",
    ),
    (
        "implicit",
        "a level set: its twin is POV-Ray's, with a stored reference",
    ),
    (
        "isosurface",
        "a level set: its twin is POV-Ray's, with a stored reference",
    ),
];

/// Keys of shapes that fill about [-1, 1]^3; others have none. The plane is a wall behind them.
const SHAPES: [(&str, &str); 16] = [
    (
        "triangle",
        "vertices = [[-1, -0.8, 0], [1, -0.8, 0.2], [0, 0.9, 0]]",
    ),
    ("mesh", "file = \"assets/star.obj\""),
    ("heightfield", "columns = 8\nrows = 6"),
    (
        "patch",
        "points = [[-0.9, -0.9, 0], [-0.3, -0.9, 0.2], [0.3, -0.9, 0.2], [0.9, -0.9, 0],\n\
         [-0.9, -0.3, 0.2], [-0.3, -0.3, 0.5], [0.3, -0.3, 0.5], [0.9, -0.3, 0.2],\n\
         [-0.9, 0.3, 0.2], [-0.3, 0.3, 0.5], [0.3, 0.3, 0.5], [0.9, 0.3, 0.2],\n\
         [-0.9, 0.9, 0], [-0.3, 0.9, 0.2], [0.3, 0.9, 0.2], [0.9, 0.9, 0]]",
    ),
    ("torus", "major_radius = 0.7\nminor_radius = 0.28"),
    (
        "polygon",
        "vertices = [[-0.9, -0.8, 0], [0.9, -0.8, 0], [0.9, 0.8, 0], [0, -0.1, 0], [-0.9, 0.8, 0]]",
    ),
    (
        "prism",
        "outline = [[-0.9, -0.8], [0.9, -0.8], [0.8, 0.8], [0, 0.2], [-0.8, 0.7]]\ny = [-0.7, 0.8]",
    ),
    (
        "lathe",
        "outline = [[0, -0.9], [0.8, -0.9], [0.4, -0.2], [0.9, 0.3], [0.6, 0.9], [0, 0.5]]",
    ),
    ("ellipsoid", "radii = [0.95, 0.8, 0.6]"),
    ("cylinder", "radius = 0.7\nz = [-0.7, 0.7]"),
    ("cone", "radii = [0.9, 0.2]\nz = [-0.7, 0.8]"),
    ("paraboloid", "radius = 0.9"),
    ("hyperboloid", "radius = 0.45\nslope = 0.8\nz = [-0.8, 0.8]"),
    (
        "quadric",
        "coefficients = [1, 2, 1.5, 1, -0.5, 2.2, 0.1, 0, 0, -0.4]\nbox = [[-0.9, -0.8, -0.7], [0.8, 0.8, 0.9]]",
    ),
    (
        "csg",
        "operation = \"difference\"\noperands = [{ type = \"box\", transform = { scale = 0.75 } },\n\
         { type = \"sphere\", center = [0.6, 0.5, 0.7], radius = 0.7 }]",
    ),
    ("instance", "group = \"g\""),
];

/// The rest of a material's table; others have none.
const MATERIALS: [(&str, &str); 18] = [
    ("matte", "reflectance = [0.7, 0.6, 0.4]"),
    ("phong", "k_d = 0.4, k_s = 0.3, exponent = 12"),
    ("blinn_phong", "k_d = 0.4, k_s = 0.3, exponent = 20"),
    (
        "tabulated",
        "values = [[1.2, 0.9, 1.5], [[0.1, 0.2, 0.1], 0.2, 0.3], [0.05, 0.1, 0.2]], spacing = \"square_root\"",
    ),
    (
        "whitted",
        "k_d = 0.3, k_s = 0.2, k_refl = 0.2, k_refr = 0.4, interior_ior = 1.3",
    ),
    ("mirror", "reflectance = 0.9"),
    ("glossy", "exponent = 200, samples = 2"),
    (
        "rough",
        "exponent = 200, samples = 2, material = { type = \"conductor\", metal = \"Cu\" }",
    ),
    ("plastic", "reflectance = [0.7, 0.2, 0.1], interior_ior = 1.7"),
    ("conductor", "metal = \"Cu\""),
    ("dielectric", "absorption = [0.4, 0.1, 0.2]"),
    ("thin_dielectric", "tint = [0.9, 0.8, 0.7]"),
    (
        "emissive",
        "radiance = [0.3, 0.2, 0.1], material = { type = \"matte\" }",
    ),
    (
        "mask",
        "opacity = [0.7, 0.5, 0.6], material = { type = \"matte\" }",
    ),
    (
        "mix",
        "weight = 0.3, a = { type = \"matte\" }, b = { type = \"mirror\" }",
    ),
    (
        "two_sided",
        "front = { type = \"matte\", reflectance = [0.2, 0.5, 0.6] }, back = { type = \"mirror\" }",
    ),
    (
        "reflection_map",
        "radiance = { type = \"noise\", scale = 2 }, material = { type = \"thin_dielectric\" }",
    ),
    (
        "normal_map",
        "axis = [0, 1, 0], material = { type = \"phong\" }, \
         map = { type = \"noise\", scale = 2, a = [0.3, 0.7, 0.9], b = [0.7, 0.3, 0.9] }",
    ),
];
const BUMP: &str =
    "height = { type = \"noise\", scale = 2, a = 0, b = 1 }, scale = 0.2, material = { type = \"matte\" }";

/// The rest of a texture's table; others have none.
const TEXTURES: [(&str, &str); 11] = [
    ("constant", "value = [0.3, 0.6, 0.5]"),
    ("checker", "scale = 4"),
    ("grid_lines", "width = 0.3, scale = 3"),
    ("image", "file = \"assets/corners.png\""),
    (
        "mix",
        "a = [0.3, 0.6, 0.5], b = [0.8, 0.2, 0.1], weight = { type = \"checker\", scale = 4 }",
    ),
    (
        "product",
        "factors = [[0.9, 0.6, 0.5], { type = \"checker\", scale = 4 }]",
    ),
    ("threshold", "input = { type = \"checker\", scale = 4 }"),
    ("noise", "kind = \"fbm\", scale = 1.5"),
    ("worley", "scale = 1.5"),
    (
        "solid",
        "size = [2, 1, 3], values = [0.3, 0.6, 0.5, 0.4, 0.7, 0.2], wrap = \"mirror\"",
    ),
    (
        "synthesized",
        "file = \"assets/stones.png\", size = [64, 48], block = 12, overlap = 4",
    ),
];

/// Keys of lights; others have none.
const LIGHTS: [(&str, &str); 8] = [
    ("point", "position = [5, 7, 12]\nintensity = 900"),
    ("directional", "direction = [-0.4, -0.6, -1]\nirradiance = 3"),
    (
        "spot",
        "position = [3, 4, 14]\ntarget = [0, 0, 0]\nintensity = 900\ncutoff_angle = 50\nbeam_width = 20",
    ),
    (
        "projector",
        "position = [3, 3, 14]\ntarget = [0, 0, 0]\nfov = 70\nintensity = 900\n\
         image = { type = \"image\", file = \"assets/corners.png\" }",
    ),
    (
        "area",
        "samples = 2\nradiance = 90\n\
         transform = [{ rotate = { axis = [1, 0, 0], degrees = 160 } }, { translate = [3, 4, 13] }]",
    ),
    ("ambient", "radiance = 0.5"),
    ("background", "radiance = [0.25, 0.35, 0.5]"),
    (
        "environment",
        "samples = 2\nradiance = { type = \"noise\", scale = 3, a = [0.1, 0.25, 0.6], b = [1, 0.95, 0.9] }",
    ),
];

/// Place and other keys of cameras; others have the place of the first.
const CAMERAS: [(&str, &str); 4] = [
    (
        "perspective",
        "look_at = { origin = [0, 0, 14], target = [0, 0, 0] }\nfov = 52",
    ),
    (
        "orthographic",
        "look_at = { origin = [0, 0, 14], target = [0, 0, 0] }\nwidth = 13.5",
    ),
    (
        "thin_lens",
        "look_at = { origin = [0, 0, 14], target = [0, 0, 0] }\nfov = 52\naperture = 0.2\nfocus_distance = 14\nlens_samples = 2",
    ),
    (
        "environment",
        "look_at = { origin = [0, 0, 4], target = [0, 0, 0] }",
    ),
];

/// Shapes that the driver intersects by itself.
const HOSTED: [&str; 11] = [
    "cone",
    "csg",
    "cylinder",
    "ellipsoid",
    "hyperboloid",
    "lathe",
    "paraboloid",
    "polygon",
    "prism",
    "quadric",
    "torus",
];

/// A sky that mirrors and glass show something of.
const SKY: &str = "[[light]]\ntype = \"environment\"\nradiance = { type = \"noise\", a = [0.1, 0.25, 0.6], b = [1, 0.95, 0.9] }\n";
const MATTE: &str = "{ type = \"matte\", reflectance = [0.7, 0.6, 0.4] }";

/// Pixels in which every shape must be seen.
const SEEN: usize = 15;

fn keys<'a>(table: &[(&str, &'a str)], kind: &str) -> &'a str {
    let found = table.iter().find(|(name, _)| *name == kind);
    found.map_or("", |(_, keys)| keys)
}

fn light(kind: &str) -> String {
    format!("[[light]]\ntype = \"{kind}\"\n{}\n", keys(&LIGHTS, kind))
}

/// The types of a family, in order.
fn types(family: FamilyName) -> Vec<&'static str> {
    let registry = whitstone::registry();
    let mut found: Vec<_> = registry
        .entries()
        .filter(|entry| entry.family == family)
        .collect();
    found.sort_by_key(|entry| entry.name);
    found.into_iter().map(|entry| entry.name).collect()
}

/// Shapes with a twin, the wall last.
fn shapes() -> Vec<&'static str> {
    let paired = |name: &&str| *name != "plane" && LEFT_OUT.iter().all(|(other, _)| other != name);
    let mut found: Vec<_> = types(FamilyName::Shape).into_iter().filter(paired).collect();
    found.push("plane");
    found
}

/// All shapes with one material, seen by a camera.
fn scene(camera: &str, lights: &str, material: &str) -> String {
    // All around is twice as wide as high.
    let [width, height] = if camera == "environment" {
        [200, 100]
    } else {
        [100, 80]
    };
    let camera_keys = CAMERAS
        .iter()
        .find(|(name, _)| *name == camera)
        .unwrap_or(&CAMERAS[0])
        .1;
    let mut text = format!(
        "[film]\nwidth = {width}\nheight = {height}\naovs = [\"shape_id\"]\n[camera]\ntype = \"{camera}\"\n{camera_keys}\n\
         [integrator]\ntype = \"whitted\"\nmax_depth = 4\nshadows = \"filtered\"\n{lights}"
    );
    for (number, kind) in shapes().into_iter().enumerate() {
        let _ = writeln!(text, "[[shape]]\ntype = \"{kind}\"\n{}", keys(&SHAPES, kind));
        if kind != "instance" {
            let _ = writeln!(text, "material = {material}");
        }
        let [x, y] = place(number);
        let _ = if kind == "plane" {
            writeln!(
                text,
                "transform = [{{ rotate = {{ axis = [1, 0, 0], degrees = -20 }} }}, {{ translate = [0, 0, -4] }}]"
            )
        } else {
            writeln!(
                text,
                "transform = [{{ rotate = {{ axis = [1, 0.3, 0], degrees = -16 }} }}, \
                 {{ rotate = {{ axis = [0, 1, 0], degrees = {:?} }} }}, {{ translate = [{x:?}, {y:?}, 0] }}]",
                // Towards a camera in the middle.
                14.0 - 4.5 * x
            )
        };
    }
    let _ = writeln!(
        text,
        "[[group.g.shape]]\ntype = \"ellipsoid\"\nradii = [0.5, 0.9, 0.7]\nmaterial = {material}"
    );
    text
}

/// Where the middle of a shape is.
fn place(number: usize) -> [f64; 2] {
    [
        2.6 * ((number % 5) as f64 - 2.0),
        2.6 * (1.5 - (number / 5) as f64),
    ]
}

/// Scenes of one family by the type that they are about.
type Scenes = BTreeMap<&'static str, String>;

fn materials() -> Scenes {
    let lights = [light("point"), SKY.to_owned(), light("ambient")].concat();
    let table = |kind: &str| {
        let keys = if kind == "bump" {
            BUMP
        } else {
            keys(&MATERIALS, kind)
        };
        let separator = if keys.is_empty() { "" } else { ", " };
        format!("{{ type = \"{kind}\"{separator}{keys} }}")
    };
    let family = types(FamilyName::Material).into_iter();
    family
        .map(|kind| (kind, scene("perspective", &lights, &table(kind))))
        .collect()
}

fn textures() -> Scenes {
    let lights = [light("point"), SKY.to_owned(), light("ambient")].concat();
    let table = |kind: &str| {
        let keys = keys(&TEXTURES, kind);
        let separator = if keys.is_empty() { "" } else { ", " };
        format!("{{ type = \"matte\", reflectance = {{ type = \"{kind}\"{separator}{keys} }} }}")
    };
    let family = types(FamilyName::Texture).into_iter();
    family
        .map(|kind| (kind, scene("perspective", &lights, &table(kind))))
        .collect()
}

fn lights() -> Scenes {
    // What the light does to the shape is seen: its background through glass, its ambient light in
    // a texture.
    let material = |kind: &str| match kind {
        "background" => "{ type = \"dielectric\", absorption = [0.4, 0.1, 0.2] }",
        "ambient" => "{ type = \"matte\", reflectance = { type = \"noise\", scale = 2 } }",
        _ => MATTE,
    };
    let family = types(FamilyName::Light).into_iter();
    family
        .map(|kind| (kind, scene("perspective", &light(kind), material(kind))))
        .collect()
}

fn cameras() -> Scenes {
    let lights = [light("point"), SKY.to_owned(), light("ambient")].concat();
    let family = types(FamilyName::Camera).into_iter();
    family.map(|kind| (kind, scene(kind, &lights, MATTE))).collect()
}

fn options() -> Options {
    Options {
        scenes: PathBuf::from("scenes"),
        references: PathBuf::from(REFERENCES),
        installation: Installation::default(),
        target: PathBuf::from("target/whitstone"),
        renderer: Renderer::MITSUBA,
        mode: Mode::Live,
        reuse: true,
        threads: 0,
        overrides: Vec::new(),
        ours_overrides: Vec::new(),
        shared_overrides: Vec::new(),
        time_limit: Duration::from_secs(120),
        program: "whitstone".to_owned(),
        flags: String::new(),
    }
}

/// A folder for scenes next to the assets that they name.
fn folder() -> Result<tempfile::TempDir, Failed> {
    let folder = tempfile::tempdir()?;
    fs::create_dir(folder.path().join("assets"))?;
    for name in ["star.obj", "corners.png", "stones.png"] {
        fs::copy(
            Path::new("scenes/assets").join(name),
            folder.path().join("assets").join(name),
        )?;
    }
    Ok(folder)
}

/// Shapes that are seen in too few pixels.
fn unseen(path: &Path) -> Result<Vec<&'static str>, Failed> {
    let pipeline = load(path, &[], &whitstone::registry())?;
    let film = pipeline.render(RenderOptions {
        threads: 1,
        ..RenderOptions::default()
    });
    let ids = film.layers.iter().find(|(name, _)| name.starts_with("shape_id"));
    let ids = &ids.ok_or("no ids of shapes")?.1;
    let shapes = shapes();
    let number = |place: usize| {
        if shapes[place] == "instance" {
            shapes.len()
        } else {
            place
        }
    };
    let count = |place: usize| ids.iter().filter(|id| **id == number(place) as f32).count();
    let few = (0..shapes.len()).filter(|place| count(*place) < SEEN);
    Ok(few.map(|place| shapes[place]).collect())
}

/// All scenes of a family pass against a live Mitsuba, and show all shapes.
fn pass(scenes: &Scenes) -> Result<(), Failed> {
    let folder = folder()?;
    let registry = whitstone::registry();
    let mut validator = Validator::new(&registry, options(), &|_| {})?;
    let mut problems = String::new();
    for (kind, text) in scenes {
        let path = folder.path().join(kind).with_extension("toml");
        fs::write(&path, text)?;
        let unseen = unseen(&path)?;
        if !unseen.is_empty() {
            let _ = writeln!(problems, "{kind}: hardly seen: {}", unseen.join(", "));
        }
        let case = validator.validate(&path);
        if case.status != Some(Status::Pass) || case.unexplained > 0 {
            let case = whitstone::validate::CaseResult {
                pictures: None,
                ..case
            };
            let _ = writeln!(problems, "{kind}: {case:#?}");
        }
    }
    if problems.is_empty() {
        Ok(())
    } else {
        Err(problems.into())
    }
}

/// What is left out has no twin indeed; what is not has one, see the others.
fn what_is_left_out_has_no_twin() -> Result<(), Failed> {
    let registry = whitstone::registry();
    let mut validator = Validator::new(&registry, options(), &|_| {})?;
    for (kind, why) in LEFT_OUT {
        let path = Path::new("scenes/shapes").join(kind).with_extension("toml");
        let case = validator.validate(&path);
        if case.no_twin.is_empty() {
            return Err(format!("{kind} has a twin now, it is no longer \"{why}\"").into());
        }
    }
    Ok(())
}

/// A fault in one shape of many is seen: each is moved by 2 mm.
fn faults_are_seen() -> Result<(), Failed> {
    let folder = folder()?;
    let path = folder.path().join("matte.toml");
    fs::write(&path, &materials()["matte"])?;
    let registry = whitstone::registry();
    for (number, kind) in shapes().into_iter().enumerate() {
        if !HOSTED.contains(&kind) {
            continue;
        }
        let [x, y] = place(number);
        let moved = format!("shape.{number}.transform.2.translate=[{:?}, {y:?}, 0]", x + 0.002);
        let faulty = Options {
            ours_overrides: vec![moved],
            ..options()
        };
        let case = Validator::new(&registry, faulty, &|_| {})?.validate(&path);
        if matches!(case.status, Some(Status::Pass | Status::Confirmed)) {
            return Err(format!("{kind}: a fault passes").into());
        }
    }
    Ok(())
}

fn main() {
    let arguments = Arguments::from_args();
    // Assets are named from the repository.
    std::env::set_current_dir(root()).expect("the repository is there");
    let live = Environment::existing(&Installation::default()).is_some();
    type Test = fn() -> Result<(), Failed>;
    let tests: [(&str, Test); 6] = [
        ("every shape with every material", || pass(&materials())),
        ("every shape with every texture", || pass(&textures())),
        ("every light with every shape", || pass(&lights())),
        ("every camera with every shape", || pass(&cameras())),
        ("what is left out has no twin", what_is_left_out_has_no_twin),
        ("faults are seen", faults_are_seen),
    ];
    let trials = tests.map(|(name, test)| Trial::test(name, test).with_ignored_flag(!live));
    libtest_mimic::run(&arguments, trials.into()).exit();
}
