//! The matrix of settings: what must hold is held, what a scene does not need is left out, and what
//! is left out would have shown nothing.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;
use whitstone::core::{
    Accelerator, Accelerators, Context, Geometry, Interval, Plugin, PreliminaryIntersection, Ray, Registry,
    SceneErrors, SelfHitFilter, Statistics,
};
use whitstone::validate::matrix::{Cell, Outcome};
use whitstone::validate::{Installation, Mode, Options, REFERENCES, Renderer, Validator};
use whitstone_accelerators::brute_force::{self, BruteForce};
use whitstone_tests::{bits, load, program, root, scenes, small};

fn cells(registry: &Registry, scene: &Path, overrides: &[&str], target: &Path) -> Vec<Cell> {
    let options = Options {
        scenes: root().join("scenes"),
        references: root().join(REFERENCES),
        installation: Installation::default(),
        renderer: Renderer::MITSUBA,
        target: target.to_owned(),
        mode: Mode::Stored,
        reuse: true,
        threads: 2,
        overrides: overrides.iter().map(|text| (*text).to_owned()).collect(),
        ours_overrides: Vec::new(),
        shared_overrides: Vec::new(),
        time_limit: Duration::from_secs(60),
        program: "whitstone".to_owned(),
        flags: String::new(),
    };
    let mut validator = Validator::new(registry, options, &|_| {}).expect("stored references need nothing");
    validator.matrix(scene).0
}

/// (setting, outcome, what was told) of a sweep.
fn axis<'a>(cells: &'a [Cell], axis: &str) -> Vec<(&'a str, Outcome, &'a str)> {
    let found = cells.iter().filter(|cell| cell.axis == axis);
    found
        .map(|cell| (&*cell.setting, cell.outcome, &*cell.detail))
        .collect()
}

const SMALL: [&str; 2] = ["film.width=32", "film.height=24"];

#[test]
fn what_a_scene_does_not_need_is_left_out() {
    let (registry, folder) = (whitstone::registry(), tempfile::tempdir().unwrap());
    let scene = root().join("scenes/shapes/sphere.toml");
    let plain = ["film={width=16,height=16}", "shape.0.material={type=\"matte\"}"];
    let found = cells(&registry, &scene, &plain, folder.path());
    for (name, why) in [
        ("accelerator", "fit into one leaf"),
        ("threads", "one tile"),
        ("max_depth", "no material in use reflects or refracts"),
        ("filter", "no texture in use"),
    ] {
        let cells = axis(&found, name);
        assert_eq!(cells.len(), 1, "{name}: {found:?}");
        assert_eq!((cells[0].0, cells[0].1), ("all", Outcome::Skipped), "{name}");
        assert!(cells[0].2.contains(why), "{name}: {}", cells[0].2);
    }
    // A texture without a filter, and an integrator that follows nothing.
    let checker = root().join("scenes/textures/checker.toml");
    let found = cells(&registry, &checker, &SMALL, folder.path());
    assert!(axis(&found, "filter")[0].2.contains("has a filter"), "{found:?}");
    let classic = root().join("scenes/showcase/classic.toml");
    let appel = [SMALL[0], SMALL[1], "integrator={type=\"appel\"}"];
    let found = cells(&registry, &classic, &appel, folder.path());
    assert!(
        axis(&found, "max_depth")[0].2.contains("appel does not follow"),
        "{found:?}"
    );
}

#[test]
fn what_must_not_change_the_picture_does_not() {
    let (registry, folder) = (whitstone::registry(), tempfile::tempdir().unwrap());
    let scene = root().join("scenes/showcase/textured_mesh.toml");
    let found = cells(&registry, &scene, &SMALL, folder.path());
    let accelerators = axis(&found, "accelerator");
    assert!(accelerators.len() > 5, "{found:?}");
    assert!(
        accelerators.iter().all(|cell| cell.1 == Outcome::Pass),
        "{accelerators:?}"
    );
    assert_eq!(
        axis(&found, "threads")
            .iter()
            .map(|cell| (cell.0, cell.1))
            .collect::<Vec<_>>(),
        [("1", Outcome::Pass), ("3", Outcome::Pass)]
    );
    // No live reference here: told, not passed.
    let filter = axis(&found, "filter");
    assert_eq!(
        filter.iter().map(|cell| cell.0).collect::<Vec<_>>(),
        ["bilinear", "ewa", "nearest", "trilinear"]
    );
    assert!(
        filter
            .iter()
            .all(|cell| cell.1 == Outcome::Skipped && cell.2.contains("a live reference is needed")),
        "{filter:?}"
    );
}

/// Sees no shape of number 1 or above.
struct Blind(Box<dyn Accelerator>);

impl Plugin<Accelerators> for Blind {
    const TYPE: &'static str = "blind";
    type Config = brute_force::Config;

    fn build(
        config: Self::Config,
        geometry: Arc<Geometry>,
        context: &mut dyn Context,
    ) -> Result<Box<dyn Accelerator>, SceneErrors> {
        let inner = <BruteForce as Plugin<Accelerators>>::build(config, geometry, context)?;
        Ok(Box::new(Self(inner)))
    }
}

impl Accelerator for Blind {
    fn intersect(
        &self,
        ray: &Ray,
        interval: Interval,
        skip: SelfHitFilter,
    ) -> Option<PreliminaryIntersection> {
        self.0.intersect(ray, interval, skip).filter(|hit| hit.shape == 0)
    }
    fn occluded(&self, ray: &Ray, interval: Interval, skip: SelfHitFilter) -> bool {
        self.0.occluded(ray, interval, skip)
    }
    fn statistics(&self) -> Statistics {
        self.0.statistics()
    }
}

#[test]
fn an_accelerator_that_changes_the_picture_fails_by_name() {
    let folder = tempfile::tempdir().unwrap();
    let mut registry = whitstone::registry();
    registry.add::<Accelerators, Blind>("faults").unwrap();
    let scene = root().join("scenes/showcase/classic.toml");
    let many = root().join("scenes/showcase/textured_mesh.toml");
    let found = [
        cells(&registry, &scene, &SMALL, folder.path()),
        cells(&registry, &many, &SMALL, folder.path()),
    ];
    let failed = found
        .iter()
        .flatten()
        .filter(|cell| cell.outcome == Outcome::Fail);
    let failed: Vec<&Cell> = failed.collect();
    assert!(!failed.is_empty(), "{found:?}");
    assert!(failed.iter().all(|cell| cell.setting == "blind"), "{failed:?}");
    assert!(failed[0].detail.contains("pixels differ"), "{failed:?}");
}

/// The reasons are true: depth does not matter where the sweep is left out, and does in most scenes
/// where it is not.
#[test]
fn sweeps_are_left_out_where_they_show_nothing() {
    let (registry, folder) = (whitstone::registry(), tempfile::tempdir().unwrap());
    let (mut skipped, mut needed, mut matters) = (0, 0, 0);
    let folders = ["materials", "textures", "lights", "integrators"];
    let few = scenes().into_iter().filter(|scene| {
        folders
            .iter()
            .any(|folder| scene.to_string_lossy().contains(&format!("/{folder}/")))
    });
    for scene in few {
        let picture = |more: &str| {
            let changed = [&small()[..], &[more.to_owned()]].concat();
            load(&scene, &changed, &registry).map(|pipeline| bits(&pipeline, 2))
        };
        // Of the integrators, this one alone has a depth.
        let whitted = |depth: u32| picture(&format!("integrator={{type=\"whitted\",max_depth={depth}}}"));
        let (Ok(none), Ok(some)) = (whitted(0), whitted(3)) else {
            continue;
        };
        let changed = ["film={width=16,height=12}", "integrator={type=\"whitted\"}"];
        let found = cells(&registry, &scene, &changed, folder.path());
        if axis(&found, "max_depth").len() == 1 {
            assert_eq!(none, some, "{}: the sweep was left out", scene.display());
            skipped += 1;
        } else {
            needed += 1;
            matters += usize::from(none != some);
        }
    }
    assert!(skipped > 10 && needed > 3, "{skipped} and {needed}");
    assert!(matters > needed / 2, "{matters} of {needed}");
}

#[test]
fn the_command_tells_cells_and_reasons() {
    let folder = tempfile::tempdir().unwrap();
    let report: PathBuf = folder.path().join("report.json");
    let junit: PathBuf = folder.path().join("junit.xml");
    let output = program!()
        .current_dir(root())
        .args([
            "validate",
            "scenes/shapes/sphere.toml",
            "--reference",
            "stored",
            "--matrix",
            "--target",
        ])
        .arg(folder.path().join("target"))
        .arg("--json")
        .arg(&report)
        .arg("--junit")
        .arg(&junit)
        .output()
        .unwrap();
    let stdout = String::from_utf8_lossy(&output.stdout);
    assert_eq!(output.status.code(), Some(0), "{stdout}");
    let junit = std::fs::read_to_string(junit).unwrap();
    for case in [
        "shapes/sphere\"",
        "shapes/sphere, threads 1\"",
        "shapes/sphere, threads 3\"",
    ] {
        assert!(junit.contains(case), "{case}: {junit}");
    }
    assert!(
        stdout.contains("skipped, all: no texture in use has a filter"),
        "{stdout}"
    );
    assert!(stdout.contains("agrees with own picture: 1, 3"), "{stdout}");
    let report: serde_json::Value = serde_json::from_slice(&std::fs::read(report).unwrap()).unwrap();
    assert_eq!(report["summary"]["matrix"]["passed"], 2);
    let cells = report["matrix"].as_array().unwrap();
    let depth = cells.iter().find(|cell| cell["axis"] == "max_depth").unwrap();
    assert_eq!(depth["outcome"], "skipped");
    assert!(
        depth["detail"].as_str().unwrap().contains("no material in use"),
        "{depth}"
    );
    let page = std::fs::read_to_string(folder.path().join("target/validate/index.html")).unwrap();
    assert!(page.contains("id=\"matrix\"") && page.contains("no material in use reflects or refracts"));
}
