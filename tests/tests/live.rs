//! What only a live Mitsuba can show; listed as ignored where its environment is not there
//! (`cargo xtask validate` makes it).

use libtest_mimic::{Arguments, Failed, Trial};
use std::fmt::Write;
use std::fs;
use std::path::{Path, PathBuf};
use std::time::Duration;
use whitstone::image::{Limits, exr_io};
use whitstone::render::RenderOptions;
use whitstone::validate::driver::SceneText;
use whitstone::validate::environment::Environment;
use whitstone::validate::exported::{self, ExportedMitsuba};
use whitstone::validate::matrix::{Cell, Outcome};
use whitstone::validate::reduce::reduce;
use whitstone::validate::{
    CaseResult, Installation, Mode, Options, REFERENCES, Renderer, Status, Validator, WorstPixel, flatten,
    tree,
};
use whitstone_tests::{load, program, root};

const CAMERA: &str = "film = { width = 64, height = 64 }\n[camera]\ntype = \"perspective\"\n";
const SKY: &str = "[[light]]\ntype = \"background\"\nradiance = [0.2, 0.3, 0.4]\n";

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

/// Validates a scene in a folder of its own, beside a mesh.
fn validate(scene: &str, mesh: &str) -> Result<CaseResult, Failed> {
    let folder = tempfile::tempdir()?;
    fs::write(folder.path().join("mesh.obj"), mesh)?;
    let path = folder.path().join("scene.toml");
    fs::write(&path, scene)?;
    let registry = whitstone::registry();
    let mut validator = Validator::new(&registry, options(), &|_| {})?;
    let case = validator.validate(&path);
    Ok(CaseResult {
        pictures: None,
        ..case
    })
}

fn check(holds: bool, case: &CaseResult) -> Result<(), Failed> {
    if holds {
        Ok(())
    } else {
        Err(format!("{case:#?}").into())
    }
}

/// A ball of small facets, without normals.
fn ball(rows: u32, columns: u32) -> String {
    let mut text = String::new();
    for row in 0..=rows {
        for column in 0..columns {
            let (sin, cos) = (std::f64::consts::PI * f64::from(row) / f64::from(rows)).sin_cos();
            let (y, x) = (std::f64::consts::TAU * f64::from(column) / f64::from(columns)).sin_cos();
            let _ = writeln!(text, "v {} {} {}", sin * x, sin * y, cos);
        }
    }
    for row in 0..rows {
        for column in 0..columns {
            let at = |row, column: u32| row * columns + column % columns + 1;
            let [a, b, c, d] = [
                at(row, column),
                at(row + 1, column),
                at(row + 1, column + 1),
                at(row, column + 1),
            ];
            let _ = writeln!(text, "f {a} {b} {c} {d}");
        }
    }
    text
}

/// Rounding a vertex turns a small facet, and the mirror doubles it. A floor that knows of rays
/// only is 4.8e-7.
fn small_facets_keep_their_limit() -> Result<(), Failed> {
    let scene = format!(
        "{CAMERA}look_at = {{ origin = [0, 1, 4], target = [0, 0, 0] }}\n{SKY}\
         [[light]]\ntype = \"point\"\nposition = [3, 5, 4]\nintensity = 60\n\
         [[shape]]\ntype = \"mesh\"\nfile = \"mesh.obj\"\nmaterial = {{ type = \"mirror\" }}\n\
         transform = {{ rotate = {{ axis = [1, 2, 3], degrees = 31 }} }}\n\
         [[shape]]\ntype = \"sphere\"\nradius = 9\n\
         material = {{ type = \"matte\", reflectance = {{ type = \"checker\", scale = [40, 20] }} }}\n"
    );
    let case = validate(&scene, &ball(120, 240))?;
    let beyond_rays = case.rel_rmse_interior.is_some_and(|error| error > 9.6e-7);
    check(case.status == Some(Status::Pass) && beyond_rays, &case)
}

/// Ten kilometres from the origin, single precision is off by a hundredth of a ball of 10 cm.
fn far_from_the_origin_the_reference_is_called_inexact() -> Result<(), Failed> {
    let scene = format!(
        "{CAMERA}look_at = {{ origin = [10000, 0.2, 0.6], target = [10000, 0.1, 0] }}\n{SKY}\
         [[shape]]\ntype = \"sphere\"\ncenter = [10000, 0.1, 0]\nradius = 0.1\nmaterial = {{ type = \"dielectric\" }}\n\
         [[shape]]\ntype = \"rectangle\"\nmaterial = {{ type = \"matte\", reflectance = {{ type = \"checker\" }} }}\n\
         transform = [{{ rotate = {{ axis = [1, 0, 0], degrees = -90 }} }}, {{ translate = [10000, 0, 0] }}]\n\
         [[light]]\ntype = \"point\"\nposition = [10001, 2, 1]\nintensity = 3\n"
    );
    let case = validate(&scene, "")?;
    let told = case
        .inexact
        .iter()
        .any(|note| note.contains("spawned on shape 0"));
    let ranges = case.worst.iter().any(|pixel| pixel.tried.is_some());
    check(
        case.status == Some(Status::Confirmed) && case.unexplained > 0 && told && ranges,
        &case,
    )
}

/// Two rectangles in one plane, or the second one this far above it; one is turned within it.
/// Single precision does not tell their distances apart.
fn coplanar(gap: f64) -> String {
    let shape = |turn: f64, reflectance: f64, above: f64| {
        format!(
            "[[shape]]\ntype = \"rectangle\"\nmaterial = {{ type = \"matte\", reflectance = {reflectance} }}\ntransform = [\
             {{ rotate = {{ axis = [0, 0, 1], degrees = {turn} }} }}, {{ translate = [0, 0, {above:?}] }}, {{ rotate = {{ axis = [1, 2, 0.5], degrees = 33 }} }}]\n"
        )
    };
    format!(
        "{CAMERA}look_at = {{ origin = [0, 1, 4], target = [0, 0, 0] }}\n\
         [[light]]\ntype = \"ambient\"\nradiance = 1\n{}{}",
        shape(0.0, 0.2, 0.0),
        shape(45.0, 0.8, gap)
    )
}

/// Too wide a gap for surfaces that coincide, and too narrow for single precision.
const NEARLY: f64 = 1e-13;

fn surfaces_that_nearly_coincide_are_named() -> Result<(), Failed> {
    let case = validate(&coplanar(NEARLY), "")?;
    let named = |text: &String| text.contains("coincident surfaces: rounding decides");
    let told = case
        .worst
        .iter()
        .any(|pixel| pixel.first_difference.as_ref().is_some_and(named));
    check(case.status != Some(Status::Fail) && told, &case)
}

fn coincident_surfaces_are_seen_in_the_same_order() -> Result<(), Failed> {
    let case = validate(&coplanar(0.0), "")?;
    let drawn_apart = case
        .coincident
        .iter()
        .any(|pair| pair.contains("separated by a gap"));
    check(case.status == Some(Status::Pass) && drawn_apart, &case)
}

/// The second of two rectangles in one plane is seen in front of the first one.
fn a_wrong_order_of_coincident_surfaces_fails() -> Result<(), Failed> {
    let registry = whitstone::registry();
    let scene = Path::new("scenes/community/nasty_coincident_kinds.toml");
    let moved = "shape.4.transform=[{ scale = [0.4, 0.5, 1] }, { translate = [0, 0.8, -0.79999999] }]";
    let fault = Options {
        ours_overrides: vec![moved.to_owned()],
        ..options()
    };
    let mut validator = Validator::new(&registry, fault, &|_| {})?;
    validator.without_pictures();
    let case = validator.validate(scene);
    check(case.status == Some(Status::Fail), &case)
}

/// Node by node: also misses, leaves at the depth limit, and absorbing media.
fn ray_trees_agree() -> Result<(), Failed> {
    let registry = whitstone::registry();
    let mut validator = Validator::new(&registry, options(), &|_| {})?;
    let live = validator.live().ok_or("the mode is live")?;
    let mut limits = 0;
    for (scene, integrator) in [
        ("classic", "{ type = \"whitted\" }"),
        ("classic", "{ type = \"appel\" }"),
        ("nested_dielectrics", "{ type = \"whitted\", max_depth = 3 }"),
    ] {
        let path = Path::new("scenes/showcase").join(scene).with_extension("toml");
        let overrides = [format!("integrator={integrator}")];
        let (pipeline, flattened) = (
            load(&path, &overrides, &registry)?,
            flatten(&path, &overrides, &registry)?,
        );
        let text = SceneText {
            text: &flattened.text,
            base: &flattened.base,
        };
        for pixel in [[10, 10], [60, 90], [96, 100], [130, 100], [150, 120]] {
            let ours = tree::ours(&pipeline, pixel, 0);
            let theirs = live.tree(text, pixel, 0)?;
            limits += ours.iter().filter(|node| node.limit).count();
            if let Some(difference) = tree::first_difference(&ours, &theirs) {
                return Err(format!("{scene}, {integrator}, {pixel:?}: {difference}").into());
            }
        }
    }
    if limits == 0 {
        return Err("no tree has a leaf at the depth limit".into());
    }
    Ok(())
}

/// `explain --pixel` shows both trees, and where they part if one side is another scene.
fn explain_shows_both_trees() -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    let json = folder.path().join("pixel.json");
    let explain = |scene: &Path, pixel: &str, more: &[&str]| -> Result<(String, serde_json::Value), Failed> {
        let output = program!()
            .current_dir(root())
            .arg("explain")
            .arg(scene)
            .args(["--pixel", pixel, "--reference", "live"])
            .arg("--json")
            .arg(&json)
            .args(more)
            .output()?;
        if !output.status.success() {
            return Err(String::from_utf8_lossy(&output.stderr).into_owned().into());
        }
        let report = serde_json::from_slice(&fs::read(&json)?)?;
        Ok((String::from_utf8_lossy(&output.stdout).into_owned(), report))
    };
    let classic = Path::new("scenes/showcase/classic.toml");
    let (text, report) = explain(classic, "130,80", &[])?;
    let reference = &report["pixel"]["reference"];
    let rays = |side: &serde_json::Value| side["rays"].as_array().map(Vec::len);
    let agree = reference["first_difference"].is_null()
        && rays(reference) == rays(&report["pixel"])
        && rays(reference) > Some(3)
        && text.contains("the ray trees agree: ")
        && text.contains("ours  ");
    if !agree {
        return Err(format!("{text}\n{reference}").into());
    }
    // The tree goes on below the rays that are shown.
    let (short, _) = explain(classic, "130,80", &["--max-rays", "2"])?;
    if short.matches("throughput").count() != 2 || !short.contains("more that agree; increase --max-rays") {
        return Err(short.into());
    }
    let case = validate(&coplanar(NEARLY), "")?;
    let scene = folder.path().join("scene.toml");
    fs::write(&scene, coplanar(NEARLY))?;
    let differs = |pixel: &&WorstPixel| pixel.first_difference.is_some();
    let worst = case.worst.iter().find(differs).ok_or("no pixel differs")?;
    let (text, report) = explain(&scene, &format!("{},{}", worst.x, worst.y), &[])?;
    let told = &report["pixel"]["reference"]["first_difference"];
    match told.as_str() {
        Some(what) if what.starts_with("camera ray: ours hits shape") => {}
        _ => return Err(told.to_string().into()),
    }
    check(
        text.contains("the ray trees first differ at camera ray: ours hits shape"),
        &case,
    )
}

/// A fault in one number, in a scene with much else in it: what is left has little but that number
/// in it.
fn what_fails_shrinks() -> Result<(), Failed> {
    let registry = whitstone::registry();
    let fault = Options {
        ours_overrides: vec!["integrator.max_depth=1".to_owned()],
        shared_overrides: Vec::new(),
        ..options()
    };
    let mut validator = Validator::new(&registry, fault, &|_| {})?;
    let scene = Path::new("scenes/showcase/classic.toml");
    let left = reduce(
        &mut validator,
        scene,
        &["film.width=64".to_owned(), "film.height=48".to_owned()],
        &|_| {},
    )?;
    let folder = tempfile::tempdir()?;
    let path = folder.path().join("left.toml");
    fs::write(&path, &left)?;
    let again = load(&path, &[], &registry)?;
    // Two mirrors, or one and a glass: of the four shapes at most three are left.
    let reflecting = left.contains("mirror") || left.contains("dielectric");
    let shapes = again.scene.geometry.shapes().len();
    if !reflecting || shapes > 3 || left.lines().count() > 40 {
        return Err(format!("{shapes} shapes in\n{left}").into());
    }
    // Without the fault there is nothing to look for.
    let mut sound = Validator::new(&registry, options(), &|_| {})?;
    match reduce(&mut sound, scene, &[], &|_| {}) {
        Err(why) if why.contains("does not fail") => Ok(()),
        other => Err(format!("{other:?}").into()),
    }
}

/// All texture filters are compared with the reference; a setting that it cannot render is skipped
/// with the reason.
fn settings_without_a_twin_are_left_out() -> Result<(), Failed> {
    let registry = whitstone::registry();
    let mut validator = Validator::new(&registry, options(), &|_| {})?;
    let mut filters = |scene: &str| -> Vec<Cell> {
        let (cells, _) = validator.matrix(Path::new(scene));
        cells.into_iter().filter(|cell| cell.axis == "filter").collect()
    };
    let of = |cells: &[Cell], setting: &str| cells.iter().find(|cell| cell.setting == setting).cloned();
    let mesh = filters("scenes/showcase/textured_mesh.toml");
    // The height of its bump map is a texture.
    let bump = filters("scenes/materials/bump.toml");
    for (cells, setting) in [
        (&mesh, "nearest"),
        (&mesh, "trilinear"),
        (&mesh, "ewa"),
        (&bump, "ewa"),
    ] {
        let cell = of(cells, setting);
        if cell.as_ref().is_none_or(|cell| cell.outcome != Outcome::Pass) {
            return Err(format!("{setting}: {cell:#?}").into());
        }
    }
    let cell = of(&filters("scenes/showcase/bump_map.toml"), "ewa");
    let skipped = cell.as_ref().is_some_and(|cell| {
        cell.outcome == Outcome::Skipped && cell.detail.contains("no twin for a bump map by (u, v)")
    });
    if skipped {
        return Ok(());
    }
    Err(format!("{cell:#?}").into())
}

/// The noise of Mitsuba's own integrator halves when the samples are quadrupled, down to our image;
/// what it would render differently is named.
fn own_integrators_approach_our_image() -> Result<(), Failed> {
    let registry = whitstone::registry();
    let installation = Installation::default();
    let environment = Environment::existing(&installation).ok_or("no environment")?;
    let mut mitsuba = ExportedMitsuba::start(&environment, "llvm_ad_rgb", 0)?;
    let folder = tempfile::tempdir()?;
    let overrides = [
        "light.1.radiance=0",
        "light.0.samples=8",
        "sampler={ type = \"grid\", samples_per_axis = 8 }",
        "film.width=48",
        "film.height=36",
    ]
    .map(str::to_owned);
    let scene = Path::new("studies/scenes/soft_shadow.toml");
    let film = load(scene, &overrides, &registry)?.render(RenderOptions::default());
    let truth = film.to_image("")?;
    let export = exported::export(&registry, &flatten(scene, &overrides, &registry)?, folder.path())?;
    if !export.lost.is_empty() {
        return Err(format!("lost: {:?}", export.lost).into());
    }
    mitsuba.load(&export.file)?;
    let mut errors = Vec::new();
    for samples in [16, 64, 256] {
        mitsuba.render(samples, 0)?;
        let file = folder.path().join("image.exr");
        mitsuba.write(&file)?;
        let image = exr_io::read(&file, Limits::IMAGE)?;
        let (ours, theirs) = (truth.rgb()?, image.rgb()?);
        let pairs = ours.into_iter().flatten().zip(theirs.into_iter().flatten());
        let sum: f64 = pairs.map(|(a, b)| f64::from(a - b).powi(2)).sum();
        errors.push((sum / ours.iter().map(|channel| channel.len() as f64).sum::<f64>()).sqrt());
    }
    let ratios: Vec<f64> = errors.windows(2).map(|pair| pair[0] / pair[1]).collect();
    if !ratios.iter().all(|ratio| (1.6..2.5).contains(ratio)) {
        return Err(format!("{errors:?}").into());
    }
    // With the background, which lights the floor in Mitsuba, it is another image.
    let lit = flatten(scene, &overrides[1..], &registry)?;
    let export = exported::export(&registry, &lit, folder.path())?;
    if export.lost != ["[[light]] background"] {
        return Err(format!("lost: {:?}", export.lost).into());
    }
    // A glowing post lights the floor there too; a glowing wall behind glass lights nothing.
    let post = "shape.post.material={ type = \"emissive\", radiance = 1 }".to_owned();
    let glowing = flatten(scene, &[post, overrides[0].clone()], &registry)?;
    let export = exported::export(&registry, &glowing, folder.path())?;
    let glass = flatten(Path::new("studies/scenes/glass_and_glow.toml"), &[], &registry)?;
    let other = exported::export(&registry, &glass, folder.path())?;
    if export.lost == ["[material] emissive"] && other.lost.is_empty() {
        Ok(())
    } else {
        Err(format!("lost: {:?}, {:?}", export.lost, other.lost).into())
    }
}

/// A test that a machine without Mitsuba leaves out.
type Test = fn() -> Result<(), Failed>;

fn main() {
    let arguments = Arguments::from_args();
    // Scenes are named from the repository.
    std::env::set_current_dir(root()).expect("the repository is there");
    let live = Environment::existing(&Installation::default()).is_some();
    let tests: [(&str, Test); 10] = [
        ("small facets keep their limit", small_facets_keep_their_limit),
        (
            "far from the origin the reference is called inexact",
            far_from_the_origin_the_reference_is_called_inexact,
        ),
        (
            "surfaces that nearly coincide are named",
            surfaces_that_nearly_coincide_are_named,
        ),
        (
            "coincident surfaces are seen in the same order",
            coincident_surfaces_are_seen_in_the_same_order,
        ),
        (
            "a wrong order of coincident surfaces fails",
            a_wrong_order_of_coincident_surfaces_fails,
        ),
        ("ray trees agree", ray_trees_agree),
        ("explain shows both trees", explain_shows_both_trees),
        ("what fails shrinks", what_fails_shrinks),
        (
            "settings without a twin are left out",
            settings_without_a_twin_are_left_out,
        ),
        (
            "own integrators approach our image",
            own_integrators_approach_our_image,
        ),
    ];
    let trials = tests.map(|(name, test)| Trial::test(name, test).with_ignored_flag(!live));
    libtest_mimic::run(&arguments, trials.into()).exit();
}
