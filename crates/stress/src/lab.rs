//! The test environment of the families: plugins, the oracle, and Mitsuba if it is available.

use crate::{Answer, Engine, Sample};
use serde_json::{Value, json};
use std::path::Path;
use std::sync::Mutex;
use whitstone_core::{DVec3, FamilyName, Ray, Registry, Rgb, Scratch, TreeNode};
use whitstone_oracle::agreement::Subject;
use whitstone_oracle::naive::{Real, Textbook, textbook};
use whitstone_render::{BuildOptions, Pipeline};
use whitstone_scene::{Description, Sources};
use whitstone_validate::driver::{Driver, DriverError};

/// The parts that scenes of families omit.
const CAMERA: &str =
    "camera = { type = \"perspective\", look_at = { origin = [0, 0, 9], target = [0, 0, 0] } }\n";

/// Accelerators that trace triangles in single precision, with their settings; their crate is
/// optional.
const BACKENDS: [(Engine, &str, &str); 3] = [
    (Engine::Embree, "embree", ", robust = true"),
    (Engine::EmbreeNotRobust, "embree", ", robust = false"),
    (Engine::Obvhs, "obvhs", ""),
];

/// The engines, ready for queries.
pub struct Lab<'a> {
    registry: &'a Registry,
    mitsuba: Option<Mutex<Driver>>,
    /// Number of queries per step.
    pub rays: usize,
}

impl<'a> Lab<'a> {
    /// Without a driver, Mitsuba takes no part. `rays` is the number of queries per step, at least
    /// one.
    pub fn new(registry: &'a Registry, mitsuba: Option<Driver>, rays: usize) -> Self {
        Self {
            registry,
            mitsuba: mitsuba.map(Mutex::new),
            rays: rays.max(1),
        }
    }

    /// All plugins and formats.
    pub(crate) fn registry(&self) -> &'a Registry {
        self.registry
    }

    /// Returns the driver, for other uses.
    pub fn into_driver(self) -> Option<Driver> {
        self.mitsuba.and_then(|driver| driver.into_inner().ok())
    }

    /// The engines that take part in at least one family: backends only if the program includes
    /// them.
    pub fn engines(&self) -> impl Iterator<Item = Engine> + use<> {
        Self::engines_of(self.registry)
    }

    /// Like [`Self::engines`], for a registry.
    pub fn engines_of(registry: &Registry) -> impl Iterator<Item = Engine> + use<> {
        let missing =
            |(_, name, _): &&(Engine, &str, &str)| registry.get(FamilyName::Accelerator, name).is_err();
        let missing: Vec<Engine> = BACKENDS.iter().filter(missing).map(|backend| backend.0).collect();
        let is_here = move |engine: &Engine| !missing.contains(engine);
        Engine::ALL.into_iter().filter(is_here)
    }

    /// All accelerators that promise exact answers, which third-party ones do not.
    pub(crate) fn accelerators(&self) -> impl Iterator<Item = &'static str> {
        let all = self.registry.entries();
        let ours = all.filter(|entry| {
            entry.family == FamilyName::Accelerator && entry.crate_name != "whitstone-backends"
        });
        ours.map(|entry| entry.name)
    }

    /// A scene of one shape, and the oracle for it.
    pub(crate) fn subject(&self, scene: &str) -> Result<Subject, String> {
        Subject::new(scene, Path::new("scenes"), self.registry)
    }

    /// Builds a scene for rendering. The camera may be missing.
    pub(crate) fn pipeline(&self, scene: &str) -> Result<Pipeline, String> {
        let text = with_camera(scene);
        let sources = Sources::from_text("stress", &text, Path::new("scenes"), &[]);
        let sources = sources.map_err(|error| error.sources.report(&error.errors, false))?;
        let report = |errors| sources.report(&errors, false);
        Pipeline::load(&sources, self.registry, BuildOptions::default()).map_err(report)
    }

    /// Runs one of the operations for single rays; an error if Mitsuba takes no part.
    pub(crate) fn mitsuba(&self, mut request: Value) -> Result<Value, String> {
        let Some(driver) = &self.mitsuba else {
            return Err("not requested".to_owned());
        };
        if let Some(scene) = request["scene"].as_str() {
            let scene = with_camera(scene);
            request["scene"] = Value::from(scene);
            request["base"] = Value::from("scenes");
        }
        let mut driver = driver.lock().map_err(|_| "its driver crashed".to_owned())?;
        driver.request(&request).map_err(|error| match error {
            DriverError::Unsupported(why) => format!("no twin: {why}"),
            other => other.to_string(),
        })
    }

    /// Red values of pixels by the driver; Mitsuba intersects rays and shapes and looks up
    /// textures.
    pub(crate) fn mitsuba_pixels(&self, scene: &str, pixels: &[[u32; 2]]) -> Result<Vec<f64>, String> {
        let answer =
            self.mitsuba(json!({ "op": "probe", "scene": scene, "pixels": pixels, "settings": [{}] }))?;
        let values = answer["values"][0].as_array().ok_or("no values")?;
        Ok(values
            .iter()
            .map(|rgb| rgb[0].as_f64().unwrap_or(f64::NAN))
            .collect())
    }

    /// Mitsuba's nearest hits, and nanoseconds per ray.
    pub(crate) fn mitsuba_closest(
        &self,
        scene: &str,
        rays: &[Ray],
        robust: bool,
    ) -> Result<(Vec<Option<f64>>, f64), String> {
        let setting = json!({ "robust": robust });
        let answer = self.mitsuba(
            json!({ "op": "closest", "threads": 1, "scene": scene, "rays": rows(rays), "setting": setting }),
        )?;
        let distances = answer["t"].as_array().ok_or("no distances")?;
        // "nan" counts as an answer; "inf" is a miss.
        let found = distances.iter().map(|t| match t.as_str() {
            Some("inf") => None,
            _ => Some(t.as_f64().unwrap_or(f64::NAN)),
        });
        let found: Vec<_> = found.collect();
        if found.len() != rays.len() {
            return Err(format!(
                "the driver gave {} answers for {} rays",
                found.len(),
                rays.len()
            ));
        }
        Ok((found, answer["ns_per_ray"].as_f64().unwrap_or(f64::NAN)))
    }
}

/// Answers of the backends that the program includes, over one or several scenes of triangles.
#[derive(Default)]
pub(crate) struct Backends(Vec<(Engine, Answer)>);

impl Backends {
    /// Adds the answers to the questions about a scene.
    pub(crate) fn ask(&mut self, lab: &Lab<'_>, scene: &str, judge: &dyn Fn(&Pipeline) -> Sample) {
        for (engine, name, settings) in BACKENDS {
            if lab.registry.get(FamilyName::Accelerator, name).is_err() {
                continue;
            }
            let scene = format!("accelerator = {{ type = \"{name}\"{settings} }}\n{scene}");
            let answer = lab.pipeline(&scene).map(|pipeline| judge(&pipeline));
            match self.0.iter_mut().find(|(known, _)| *known == engine) {
                None => self.0.push((engine, answer)),
                Some((_, known)) => join(known, answer),
            }
        }
    }

    /// An answer for each.
    pub(crate) fn into_answers(self) -> Vec<(Engine, Answer)> {
        self.0
    }
}

/// Merges the answers of an engine to two parts of a step; it takes part only if it answers both.
pub(crate) fn join(known: &mut Answer, answer: Answer) {
    match (known, answer) {
        (Ok(sample), Ok(more)) => sample.join(&more),
        (known, Err(why)) => *known = Err(why),
        (Err(_), Ok(_)) => {}
    }
}

fn with_camera(scene: &str) -> String {
    match scene.contains("camera") {
        true => scene.to_owned(),
        false => format!("{CAMERA}{scene}"),
    }
}

/// The textbook implementation of a shape of a scene.
pub(crate) fn textbook_of<R: Real>(scene: &str, number: usize) -> Result<Box<dyn Textbook<R>>, String> {
    let text = with_camera(scene);
    let sources = Sources::from_text("stress", &text, Path::new("scenes"), &[]);
    let sources = sources.map_err(|error| error.sources.report(&error.errors, false))?;
    let report = |errors| sources.report(&errors, false);
    let description = Description::parse(&sources).into_result().map_err(report)?;
    textbook(&description, number).map_err(report)
}

/// Rays in the form of the protocol.
pub(crate) fn rows(rays: &[Ray]) -> Vec<[f64; 6]> {
    rays.iter()
        .map(
            |Ray {
                 origin: o,
                 direction: d,
             }| [o.x, o.y, o.z, d.x, d.y, d.z],
        )
        .collect()
}

/// The radiance of a ray by the integrator.
pub(crate) fn radiance(pipeline: &Pipeline, ray: &Ray) -> Rgb {
    let mut scratch = Scratch::default();
    pipeline.integrator.radiance(&pipeline.scene, ray, &mut scratch)
}

/// The ray tree of a ray.
pub(crate) fn tree(pipeline: &Pipeline, ray: &Ray) -> Vec<TreeNode> {
    let mut scratch = Scratch::recording();
    pipeline.integrator.radiance(&pipeline.scene, ray, &mut scratch);
    scratch.record.unwrap_or_default()
}

/// The ray rounded to single precision, so that every engine gets the same one.
pub(crate) fn single(origin: DVec3, direction: DVec3) -> Ray {
    Ray::new(origin.as_vec3().as_dvec3(), direction.as_vec3().as_dvec3())
}
