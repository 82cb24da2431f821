//! Tests of error-against-time studies: the claims of the stored studies hold, an injected fault in
//! their subject is detected, and errors in studies are reported at their place.

use serde_json::Value;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::sync::Arc;
use whitstone::core::*;
use whitstone_converge::{Cache, Engine, Lab, Options, SeriesReport, Study, StudyReport, Verdict};
use whitstone_testkit::Random;

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

fn measure(study: &Study, registry: &Registry, folder: &Path) -> Result<StudyReport, String> {
    let options = Options {
        repeats: 1,
        forced_repeats: Some(1),
        budget: 1.0,
        threads: 0,
        program: "whitstone".to_owned(),
        target: folder.to_owned(),
        stop: whitstone::validate::Stop::default(),
    };
    let none = Err("not in a test".to_owned());
    let mut lab = Lab::new(registry, none, "", Cache::new(folder.to_owned(), true), options);
    lab.measure(study, &|_| ())
}

/// The quick form of a stored study, with text replacements.
fn stored(name: &str, changes: &[[&str; 2]]) -> Study {
    let path = root().join("studies").join(name).with_extension("toml");
    let mut text = fs::read_to_string(&path).unwrap();
    for [from, to] in changes {
        assert!(text.contains(from), "{name} has {from}");
        text = text.replace(from, to);
    }
    Study::parse(name, &text, &root().join("studies"), true).unwrap_or_else(|report| panic!("{report}"))
}

fn judged(name: &str, changes: &[[&str; 2]], registry: &Registry) -> StudyReport {
    let folder = tempfile::tempdir().unwrap();
    measure(&stored(name, changes), registry, folder.path()).unwrap_or_else(|report| panic!("{report}"))
}

#[test]
fn the_quick_studies_hold() {
    let registry = whitstone::registry();
    let mut quick = 0;
    for entry in fs::read_dir(root().join("studies")).unwrap() {
        let path = entry.unwrap().path();
        if path.extension().is_none_or(|extension| extension != "toml") {
            continue;
        }
        let study = Study::load(&path, true).unwrap_or_else(|report| panic!("{report}"));
        if study.has_quick {
            quick += 1;
            let folder = tempfile::tempdir().unwrap();
            let report =
                measure(&study, &registry, folder.path()).unwrap_or_else(|report| panic!("{report}"));
            assert_eq!(
                report.verdict,
                Verdict::Pass,
                "{}: {:?}",
                report.study,
                report.problems
            );
        }
    }
    assert!(quick >= 4, "{quick} studies have a quick form");
}

/// A sampler that ignores the sample index.
struct Stuck(u32);

impl Plugin<Samplers> for Stuck {
    const TYPE: &'static str = "stuck";
    type Config = whitstone_samplers::stratified::Config;

    fn build(
        config: Self::Config,
        (): (),
        context: &mut dyn Context,
    ) -> Result<Box<dyn Sampler>, SceneErrors> {
        let right =
            <whitstone_samplers::stratified::Stratified as Plugin<Samplers>>::build(config, (), context)?;
        Ok(Box::new(Self(right.count())))
    }
}

impl Sampler for Stuck {
    fn count(&self) -> u32 {
        self.0
    }
    fn position(&self, [x, y]: [u32; 2], _: u32) -> DVec2 {
        let mut random = Random::new(u64::from(x) << 32 | u64::from(y));
        DVec2::new(random.unit(), random.unit())
    }
}

/// Random samples anywhere in the pixel: unbiased, but slower to converge than stratified ones.
struct Anywhere(u32);

impl Plugin<Samplers> for Anywhere {
    const TYPE: &'static str = "anywhere";
    type Config = whitstone_samplers::stratified::Config;

    fn build(
        config: Self::Config,
        (): (),
        context: &mut dyn Context,
    ) -> Result<Box<dyn Sampler>, SceneErrors> {
        let right =
            <whitstone_samplers::stratified::Stratified as Plugin<Samplers>>::build(config, (), context)?;
        Ok(Box::new(Self(right.count())))
    }
}

impl Sampler for Anywhere {
    fn count(&self) -> u32 {
        self.0
    }
    fn position(&self, [x, y]: [u32; 2], index: u32) -> DVec2 {
        let seed = u64::from(index) << 40 | u64::from(x) << 20 | u64::from(y);
        let mut random = Random::new(seed.wrapping_mul(0x9e37_79b9_7f4a_7c15));
        DVec2::new(random.unit(), random.unit())
    }
}

/// An accelerator that misses one in some hundred hits.
struct Leaky(Box<dyn Accelerator>);

impl Plugin<Accelerators> for Leaky {
    const TYPE: &'static str = "leaky";
    type Config = whitstone_accelerators::bvh2::Config;

    fn build(
        config: Self::Config,
        geometry: Arc<Geometry>,
        context: &mut dyn Context,
    ) -> Result<Box<dyn Accelerator>, SceneErrors> {
        type Right = whitstone_accelerators::bvh2::Bvh2;
        Ok(Box::new(Self(<Right as Plugin<Accelerators>>::build(
            config, geometry, context,
        )?)))
    }
}

impl Accelerator for Leaky {
    fn intersect(
        &self,
        ray: &Ray,
        interval: Interval,
        skip: SelfHitFilter,
    ) -> Option<PreliminaryIntersection> {
        let lost = |hit: &PreliminaryIntersection| hit.primitive.is_multiple_of(128);
        self.0.intersect(ray, interval, skip).filter(|hit| !lost(hit))
    }
    fn occluded(&self, ray: &Ray, interval: Interval, skip: SelfHitFilter) -> bool {
        self.0.occluded(ray, interval, skip)
    }
    fn statistics(&self) -> Statistics {
        self.0.statistics()
    }
}

fn with_faults() -> Registry {
    let mut registry = whitstone::registry();
    registry.add::<Samplers, Stuck>("faults").unwrap();
    registry.add::<Samplers, Anywhere>("faults").unwrap();
    registry.add::<Accelerators, Leaky>("faults").unwrap();
    registry
}

fn fails(name: &str, changes: &[[&str; 2]], expected: &str) {
    let report = judged(name, changes, &with_faults());
    let found = report.problems.iter().any(|problem| problem.contains(expected));
    assert!(
        report.verdict == Verdict::Fails && found,
        "{name}: {} {:?}",
        report.verdict,
        report.problems
    );
}

#[test]
fn a_sampler_that_ignores_its_offset_is_found() {
    fails(
        "patterns",
        &[["{ type = \"stratified\" }", "{ type = \"stuck\" }"]],
        "stratified (whitstone): the slope is",
    );
}

#[test]
fn a_sampler_without_strata_is_found() {
    fails(
        "patterns",
        &[["{ type = \"stratified\" }", "{ type = \"anywhere\" }"]],
        "stratified (whitstone): the slope is",
    );
}

#[test]
fn an_accelerator_that_loses_hits_is_found() {
    fails(
        "accelerators",
        &[["type = \"bvh2\"", "type = \"leaky\""]],
        "differ in the error at sampler.samples_per_axis=1",
    );
}

#[test]
fn flat_normals_in_the_place_of_smooth_ones_are_found() {
    let change = [
        "name = \"smooth\"",
        "name = \"smooth\"\nset = ['shape.ball.shading=\"flat\"']",
    ];
    fails("tessellation", &[change], "smooth (whitstone): the slope is");
}

#[test]
fn an_error_that_is_not_reached_is_found() {
    fails(
        "lens",
        &[["points = 6", "points = 2"]],
        "does not reach an error of 1e-2",
    );
}

// ---- the command
// -------------------------------------------------------------------------------------------------

const SCENE: &str = r#"
[film]
width = 32
height = 24
[camera]
type = "perspective"
look_at = { origin = [0, 0, 4], target = [0, 0, 0] }
[[light]]
type = "background"
radiance = 0.5
[[shape]]
id = "ball"
type = "sphere"
radius = 0.8
"#;

const STUDY: &str = r#"title = "A ball"
about = "Edges."
scene = "scene.toml"
levels = [1e-2]

[truth]
set = ['sampler={ type = "grid", samples_per_axis = 32 }']
check = [{ set = ['sampler={ type = "sobol", samples = 1024 }'] }]

[[series]]
name = "grid"
set = ['sampler={ type = "grid" }']
sweep = { "sampler.samples_per_axis" = [1, 2, 4, 8] }
"#;

struct Place(tempfile::TempDir);

impl Place {
    fn new(study: &str) -> Self {
        let place = Self(tempfile::tempdir().unwrap());
        place.write("scene.toml", SCENE);
        place.write("study.toml", study);
        place
    }

    fn write(&self, name: &str, text: &str) {
        fs::write(self.0.path().join(name), text).unwrap();
    }

    fn run(&self, arguments: &[&str]) -> Output {
        self.converge(&["study.toml", "--repeats", "3"], arguments)
    }

    /// Of the scene, without a study.
    fn of_scene(&self, arguments: &[&str]) -> Output {
        self.converge(&["scene.toml", "--no-mitsuba", "--repeats", "1"], arguments)
    }

    fn converge(&self, first: &[&str], more: &[&str]) -> Output {
        Command::new(env!("CARGO_BIN_EXE_whitstone"))
            .current_dir(self.0.path())
            .args(["converge", "--json", "out.json"])
            .args(first)
            .args(more)
            .output()
            .unwrap()
    }

    fn json(&self) -> Value {
        serde_json::from_slice(&fs::read(self.0.path().join("out.json")).unwrap()).unwrap()
    }
}

fn texts(output: &Output) -> String {
    [&output.stdout[..], &output.stderr[..]]
        .map(String::from_utf8_lossy)
        .concat()
}

#[test]
fn a_study_is_measured_written_and_resumed() {
    let place = Place::new(STUDY);
    place.write(
        "page.md",
        "a\n<!-- studies: written by `cargo xtask converge --page` -->\n<!-- end of studies -->\nb\n",
    );
    let output = place.run(&["--csv", "out.csv", "--plots", "plots", "--page", "page.md"]);
    assert_eq!(output.status.code(), Some(0), "{}", texts(&output));
    let first = place.json();
    let study = &first["studies"][0];
    for key in [
        "study",
        "scene",
        "truth",
        "floor_rmse",
        "series",
        "time_to",
        "noisy",
    ] {
        assert!(!study[key].is_null(), "{key}");
    }
    let series = &study["series"][0];
    assert_eq!(
        [&series["engine"], &series["configuration"]],
        ["whitstone", "grid"]
    );
    assert!(series["slope"].as_f64().unwrap() < -0.5 && series["slope_interval"][0].is_f64());
    let point = &series["points"][2];
    for key in [
        "setting",
        "seconds",
        "spread",
        "rmse",
        "relmse",
        "rays",
        "cpu_seconds",
        "command",
    ] {
        assert!(!point[key].is_null(), "{key}");
    }
    assert_eq!(
        (&point["samples"], &point["repeats"]),
        (&Value::from(16), &Value::from(3))
    );
    assert!(study["time_to"]["1e-2"]["whitstone_s"].is_f64());
    assert!(study["time_to"]["1e-2"]["ratio"].is_null());
    let csv = fs::read_to_string(place.0.path().join("out.csv")).unwrap();
    assert_eq!(csv.lines().count(), 5);
    let columns = csv.lines().next().unwrap().split(',').count();
    assert!(
        csv.lines().all(|line| line.split(',').count() == columns),
        "{csv}"
    );
    let svg = fs::read_to_string(place.0.path().join("plots/study.svg")).unwrap();
    assert!(
        svg.contains("whitstone, grid, sampler.samples_per_axis=4: RMSE")
            && svg.contains("render scene.toml --set")
    );
    assert!(svg.contains("prefers-color-scheme: dark") && !svg.contains("NaN"));
    let page = fs::read_to_string(place.0.path().join("page.md")).unwrap();
    assert!(page.starts_with("a\n") && page.contains("| grid | whitstone | 4 |") && page.ends_with("b\n"));

    // Finished measurements are not repeated, unless requested.
    assert_eq!(place.run(&[]).status.code(), Some(0));
    assert_eq!(place.json()["studies"], first["studies"]);
    assert_eq!(place.run(&["--fresh"]).status.code(), Some(0));
    let times = |json: &Value| -> Vec<Value> {
        let points = json["studies"][0]["series"][0]["points"].as_array().unwrap();
        points.iter().map(|point| point["seconds"].clone()).collect()
    };
    assert_ne!(times(&place.json()), times(&first));
}

#[test]
fn a_study_that_fails_half_way_keeps_its_results_and_continues_later() {
    let study = STUDY.replace(
        r#"sweep = { "sampler.samples_per_axis" = [1, 2, 4, 8] }"#,
        r#"sweep = { "shape.ball" = [
            { type = "sphere", radius = 0.8 },
            { type = "mesh", file = "late.obj" },
            { type = "sphere", radius = 0.9 },
        ] }"#,
    );
    let place = Place::new(&study);
    let output = place.run(&[]);
    assert_eq!(output.status.code(), Some(1), "{}", texts(&output));
    let first = place.json();
    assert_eq!(first["studies"][0]["verdict"], "incomplete");
    let points = &first["studies"][0]["series"][0]["points"];
    assert!(points[0]["seconds"].is_f64() && points[1]["seconds"].is_null() && points[2]["seconds"].is_f64());
    assert!(
        points[1]["problem"].as_str().unwrap().contains("late.obj"),
        "{points}"
    );

    place.write("late.obj", "v -1 -1 0\nv 1 -1 0\nv 0 1 0\nf 1 2 3\n");
    let output = place.run(&[]);
    assert_eq!(output.status.code(), Some(0), "{}", texts(&output));
    let second = place.json();
    let now = &second["studies"][0]["series"][0]["points"];
    assert!(now[1]["seconds"].is_f64() && now[1].get("problem").is_none());
    // The other points are those of the first run.
    assert_eq!(now[0]["seconds"], points[0]["seconds"]);
}

#[test]
fn errors_are_reported_at_their_place() {
    let sweep = r#""sampler.samples_per_axis" = [1, 2, 4, 8]"#;
    let cases: [(&str, &str, &[&str]); 9] = [
        (
            sweep,
            r#""samplr.n" = [1, 2]"#,
            &[
                "study.toml:13:11",
                "unknown table `samplr`",
                "did you mean `sampler`?",
            ],
        ),
        (
            sweep,
            r#""sampler.samples_per_axi" = [1, 2]"#,
            &[
                "study.toml:13:11",
                "unknown key `samples_per_axi`",
                "did you mean `samples_per_axis`?",
            ],
        ),
        (
            sweep,
            r#""camera.fvo" = [1, 2]"#,
            &["study.toml:13:11", "did you mean `fov`?"],
        ),
        (
            sweep,
            r#""sampler.samples_per_axis" = []"#,
            &[
                "study.toml:13:40",
                "an empty sweep: `sampler.samples_per_axis` has no values",
            ],
        ),
        (sweep, "", &["study.toml:13:9", "an empty sweep"]),
        (
            sweep,
            r#""sampler.samples_per_axis" = [1, 2], "sampler.m" = [1]"#,
            &["study.toml:13:", "as many values as the others"],
        ),
        (
            sweep,
            r#""sampler.samples_per_axis" = [1, 2, 100]"#,
            &["study.toml:13:11", "1 to 64"],
        ),
        (
            "about",
            "abut",
            &["study.toml:2:1", "unknown key `abut`", "did you mean `about`?"],
        ),
        ("scene.toml", "none.toml", &["none.toml", "No such file"]),
    ];
    for (from, to, expected) in cases {
        let place = Place::new(&STUDY.replace(from, to));
        let output = place.run(&[]);
        let text = texts(&output);
        assert_eq!(output.status.code(), Some(2), "{to}: {text}");
        for words in expected {
            assert!(text.contains(words), "{to}: no {words:?} in\n{text}");
        }
    }
    // Two faults are two messages.
    let place = Place::new(
        &STUDY
            .replace(sweep, r#""sampler.samples_per_axis" = []"#)
            .replace("levels = [1e-2]", "levels = [-1.0]"),
    );
    let text = texts(&place.run(&[]));
    assert!(
        text.contains("greater than 0") && text.contains("an empty sweep"),
        "{text}"
    );
}

#[test]
fn nothing_is_claimed_of_a_truth_that_has_not_converged() {
    let study = STUDY
        .replace("samples_per_axis = 32", "samples_per_axis = 1")
        .replace(
            r#"sampler={ type = "sobol", samples = 1024 }"#,
            r#"sampler={ type = "sobol", samples = 1 }"#,
        )
        .replace("[1, 2, 4, 8]", "[2, 4, 8]");
    let place = Place::new(&study);
    let output = place.run(&[]);
    let text = texts(&output);
    assert_eq!(output.status.code(), Some(1), "{text}");
    assert!(text.contains("the truth has not converged"), "{text}");
    let found = place.json();
    let study = &found["studies"][0];
    assert_eq!(study["verdict"], "withheld");
    assert!(study["series"][0]["slope"].is_null() && study["time_to"]["1e-2"]["whitstone_s"].is_null());
}

#[test]
fn a_scene_has_a_study_without_writing_one() {
    let place = Place::new(STUDY);
    let output = place.of_scene(&[]);
    assert_eq!(output.status.code(), Some(0), "{}", texts(&output));
    let series = place.json()["studies"][0]["series"].as_array().unwrap().len();
    assert_eq!(series, 4);
    let unknown = Command::new(env!("CARGO_BIN_EXE_whitstone"))
        .current_dir(root())
        .args(["converge", "sampels"])
        .output()
        .unwrap();
    assert_eq!(unknown.status.code(), Some(2));
    assert!(
        texts(&unknown).contains("did you mean \"samples\"?"),
        "{}",
        texts(&unknown)
    );
}

/// The recommended setting reaches the error against a truth of its own, of scenes that no study
/// uses.
#[test]
fn a_recommended_setting_reaches_the_error() {
    for (scene, error) in [
        ("scenes/shapes/torus.toml", 4e-3),
        ("scenes/textures/rings.toml", 1e-2),
        ("scenes/materials/dielectric.toml", 1e-2),
    ] {
        let folder = tempfile::tempdir().unwrap();
        let small = |name: &str| {
            let text = format!(
                "include = [{:?}]\nfilm = {{ width = 40, height = 30 }}\n",
                root().join(scene)
            );
            let path = folder.path().join(name);
            fs::write(&path, text).unwrap();
            path
        };
        let path = small("small.toml");
        let json = folder.path().join("result.json");
        let output = Command::new(env!("CARGO_BIN_EXE_whitstone"))
            .arg("converge")
            .arg(&path)
            .args(["--recommend", &error.to_string(), "--repeats", "1"])
            .arg("--target")
            .arg(folder.path())
            .arg("--json")
            .arg(&json)
            .output()
            .unwrap();
        let text = String::from_utf8(output.stdout).unwrap();
        assert!(
            output.status.success(),
            "{text}{}",
            String::from_utf8_lossy(&output.stderr)
        );
        let line = text
            .lines()
            .find(|line| line.contains("cheapest for an error"))
            .unwrap();
        let report: Value = serde_json::from_slice(&fs::read(&json).unwrap()).unwrap();
        let report: StudyReport = serde_json::from_value(report["studies"][0].clone()).unwrap();
        let (series, point) = report.cheapest(error).unwrap();
        assert!(
            line.contains(&point.setting) && line.contains(&series.configuration),
            "{line}"
        );
        // Others do not reach it.
        let mut points = report.series.iter().flat_map(|series| &series.points);
        assert!(points.any(|point| point.rmse.unwrap() > error));
        // Against a truth that the command did not use.
        let rendered = |sets: &[&str]| {
            let sets: Vec<String> = sets.iter().map(|set| (*set).to_owned()).collect();
            let registry = whitstone::registry();
            let sources = whitstone::scene::Sources::load(&path, &sets, &registry).unwrap();
            let options = whitstone::render::BuildOptions::default();
            let pipeline = whitstone::render::Pipeline::load(&sources, &registry, options).unwrap();
            pipeline.render(whitstone::render::RenderOptions::default()).rgb
        };
        let command = point.command.trim_end_matches(" -o ours.exr");
        let sampler = command
            .split("--set")
            .skip(1)
            .map(|set| set.trim().trim_matches('\''));
        let ours = rendered(&sampler.collect::<Vec<_>>());
        let truth = rendered(&["sampler={ type = \"stratified\", samples_per_axis = 48 }"]);
        let squares = ours
            .iter()
            .zip(&truth)
            .flat_map(|(a, b)| (0..3).map(|c| f64::from(a[c] - b[c]).powi(2)));
        let rmse = (squares.sum::<f64>() / (3 * ours.len()) as f64).sqrt();
        assert!(rmse < 1.1 * error, "{scene}: {rmse} with {}", point.command);
    }
}

/// Another renderer takes part by its command; its times are those of whole commands.
#[test]
fn a_command_is_a_series_of_its_own() {
    let place = Place::new(STUDY);
    let measured = |subject: &str| {
        let output = place.of_scene(&["--subject", subject]);
        (output, place.json())
    };
    let program = env!("CARGO_BIN_EXE_whitstone");
    let sampler = r#"{{ type = \"sobol\", samples = {samples} }}"#;
    let (output, value) = measured(&format!(
        r#"twin={{ command = "'{program}' render {{scene}} -o {{output}} --set 'sampler={sampler}'" }}"#
    ));
    assert!(output.status.success(), "{}", texts(&output));
    let report: StudyReport = serde_json::from_value(value["studies"][0].clone()).unwrap();
    let named = |name: &str, engine: Engine| {
        let mut all = report.series.iter();
        all.find(|series| series.configuration == name && series.engine == engine)
            .unwrap_or_else(|| panic!("{name}"))
    };
    let sobol = named("sobol", Engine::Whitstone);
    let rmse = |series: &SeriesReport| -> Vec<_> { series.points.iter().map(|point| point.rmse).collect() };
    for name in ["whitstone", "twin"] {
        let command = named(name, Engine::Command);
        assert_eq!(rmse(command)[..4], rmse(sobol)[..4], "{name}");
        assert_eq!(command.points.len(), 5);
        assert!(command.points[0].seconds > sobol.points[0].seconds, "{name}");
    }
    let printed = String::from_utf8_lossy(&output.stdout);
    assert!(printed.contains("whole commands: whitstone "), "{printed}");

    // The report names a failing command once; the other series are measured.
    let (output, value) = measured("broken={ command = 'false {scene} {output} {samples}' }");
    assert_eq!(output.status.code(), Some(1));
    let problems = value["studies"][0]["problems"].as_array().unwrap();
    let broken = |problem: &&Value| problem.as_str().unwrap().contains("broken (whole command)");
    assert_eq!(problems.iter().filter(broken).count(), 1, "{problems:?}");
    let (output, _) = measured("broken={ command = 'false {scene}' }");
    assert_eq!(output.status.code(), Some(2));
}
