//! Compares ray-shape intersections with the oracle.

use crate::naive::{DoubleDouble, Textbook, textbook};
use crate::{Nearest, Oracle};
use std::fmt;
use std::path::Path;
use whitstone_core::{Aabb, DVec3, Interval, Ray, Registry, SceneErrors};
use whitstone_render::{BuildOptions, Pipeline};
use whitstone_scene::{Description, Plan, Sources};

/// Largest accepted error of a ray parameter, in units in the last place (ulp), divided by the
/// condition number.
pub const MAX_ULPS: f64 = 16.0;

/// Camera of a test scene; only its shape matters.
const CAMERA: &str =
    "camera = { type = \"perspective\", look_at = { origin = [0, 0, 9], target = [0, 0, 0] } }\n";

/// A scene with a single shape: the production pipeline, the oracle and the textbook formulas.
pub struct Subject {
    /// The pipeline of that scene.
    pub pipeline: Pipeline,
    /// The oracle for the shape.
    pub oracle: Oracle,
    /// Textbook formulas in single precision.
    pub textbook_f32: Box<dyn Textbook<f32>>,
    /// Textbook formulas in double precision.
    pub textbook_f64: Box<dyn Textbook<f64>>,
    /// Textbook formulas in double-double precision.
    pub textbook_double_double: Box<dyn Textbook<DoubleDouble>>,
}

impl Subject {
    /// Builds the subject from the text of a scene. The scene has exactly one shape outside of
    /// groups; the camera may be missing. File paths are relative to the folder `base`.
    ///
    /// # Errors
    ///
    /// All errors in the scene, formatted for people.
    pub fn new(text: &str, base: &Path, registry: &Registry) -> Result<Self, String> {
        let text = format!("{CAMERA}{text}");
        let sources = Sources::from_text("subject", &text, base, &[]);
        let sources = sources.map_err(|error| error.sources.report(&error.errors, false))?;
        let report = |errors: SceneErrors| sources.report(&errors, false);
        let description = Description::parse(&sources).into_result().map_err(report)?;
        let plan = Plan::new(&description, registry).into_result().map_err(report)?;
        Ok(Self {
            pipeline: Pipeline::build(&plan, registry, BuildOptions::default())
                .into_result()
                .map_err(report)?,
            oracle: Oracle::new(&description, 0).map_err(report)?,
            textbook_f32: textbook(&description, 0).map_err(report)?,
            textbook_f64: textbook(&description, 0).map_err(report)?,
            textbook_double_double: textbook(&description, 0).map_err(report)?,
        })
    }
}

/// Statistics of the agreement with the oracle, over many rays.
#[derive(Clone, Debug, Default)]
pub struct Agreement {
    /// Rays that hit, according to the oracle.
    pub hits: u64,
    /// Rays that miss, according to the oracle.
    pub misses: u64,
    /// Rays that the oracle cannot decide.
    pub unknown: u64,
    /// Rays with a wrong answer that is right for a slightly shifted ray: see [`Self::add`].
    pub ill_posed: u64,
    /// Rays with a wrong answer that is not ill-posed.
    pub wrong: u64,
    /// The largest error of t, in ulp of t, over rays that hit in both and are neither ill-posed
    /// nor wrong.
    pub most_ulps: f64,
    /// The largest quotient of that error and the condition number.
    pub most_ulps_by_condition: f64,
    /// The first ray with a wrong answer.
    pub first_wrong: Option<String>,
}

impl Agreement {
    /// Counts one ray. `found` is the ray parameter under test, `None` for a miss. `bounds` is the
    /// bounding box of the shape.
    ///
    /// An answer is right if it agrees on hit or miss, and if the error of t is at most
    /// [`MAX_ULPS`] ulp times the condition number. A wrong answer counts as *ill-posed*, which is
    /// no fault, if it is right for one of 26 rays whose origin is shifted by [`MAX_ULPS`] ulp of
    /// all coordinates involved. A backward stable method may give such an answer where a ray
    /// touches a surface or passes an edge.
    pub fn add(&mut self, oracle: &Oracle, ray: &Ray, found: Option<f64>, bounds: &Aabb) {
        let truth = oracle.nearest(ray, Interval::FORWARD);
        match &truth {
            Nearest::Hit { .. } => self.hits += 1,
            Nearest::Miss => self.misses += 1,
            Nearest::Unknown => {
                self.unknown += 1;
                return;
            }
        }
        let far = match &truth {
            Nearest::Hit { t, .. } => t.nearest(),
            _ => found.unwrap_or(0.0),
        };
        if let Some(error) = Error::of(&truth, found) {
            if error.is_small() {
                self.most_ulps = self.most_ulps.max(error.ulps);
                self.most_ulps_by_condition = self.most_ulps_by_condition.max(error.by_condition);
            } else if shifted(ray, far, bounds, f64::EPSILON).any(|ray| is_right(oracle, &ray, found)) {
                self.ill_posed += 1;
            } else {
                self.wrong += 1;
                self.first_wrong
                    .get_or_insert_with(|| format!("{found:?} instead of {truth:?} for {ray:?}"));
            }
        }
    }
}

impl fmt::Display for Agreement {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "{} hits, {} misses, {} unknown, {} ill-posed, {} wrong; at most {:.3} ulp, {:.3} ulp x condition",
            self.hits,
            self.misses,
            self.unknown,
            self.ill_posed,
            self.wrong,
            self.most_ulps,
            self.most_ulps_by_condition
        )?;
        match &self.first_wrong {
            Some(first) => write!(f, "; {first}"),
            None => Ok(()),
        }
    }
}

/// Errors over many rays, well-conditioned or not.
#[derive(Clone, Copy, Debug, Default)]
pub struct Errors {
    /// Rays that the oracle can decide.
    pub rays: u64,
    /// Rays that hit instead of miss, or the reverse.
    pub wrong_class: u64,
    /// The largest error of t among the others, in ulp of t.
    pub most_ulps: f64,
}

impl Errors {
    /// Counts one ray; `found` is `None` for a miss.
    pub fn add(&mut self, truth: &Nearest, found: Option<f64>) {
        self.rays += u64::from(!matches!(truth, Nearest::Unknown));
        if let Some(error) = Error::of(truth, found) {
            if error.ulps.is_finite() {
                self.most_ulps = self.most_ulps.max(error.ulps);
            } else {
                self.wrong_class += 1;
            }
        }
    }
}

/// Error of a ray parameter; infinite if hit and miss are confused.
#[derive(Clone, Copy, Debug)]
pub struct Error {
    /// In ulp of the true parameter.
    pub ulps: f64,
    /// The same, divided by the condition number.
    pub by_condition: f64,
}

impl Error {
    /// The error of `found`. `None` if both miss or the oracle cannot decide.
    pub fn of(truth: &Nearest, found: Option<f64>) -> Option<Self> {
        let wrong = Self {
            ulps: f64::INFINITY,
            by_condition: f64::INFINITY,
        };
        match (truth, found) {
            (Nearest::Unknown, _) | (Nearest::Miss, None) => None,
            (Nearest::Hit { t, condition, .. }, Some(found)) if found.is_finite() => {
                let ulps = t.farthest(found) / ulp(t.nearest());
                Some(Self {
                    ulps,
                    by_condition: ulps / condition,
                })
            }
            _ => Some(wrong),
        }
    }

    fn is_small(self) -> bool {
        self.by_condition <= MAX_ULPS
    }
}

/// The distance to the next double away from zero.
fn ulp(t: f64) -> f64 {
    let t = t.abs();
    t.next_up() - t
}

/// Whether a wrong class (a hit instead of a miss, or the reverse) is right for one of 26 rays
/// whose origin is shifted by [`MAX_ULPS`] units in the last place of all coordinates involved.
/// `epsilon` is the relative spacing of the format.
pub fn is_class_excused(oracle: &Oracle, ray: &Ray, found: Option<f64>, bounds: &Aabb, epsilon: f64) -> bool {
    let far = match oracle.nearest(ray, Interval::FORWARD) {
        Nearest::Hit { t, .. } => t.nearest(),
        _ => found.filter(|t| t.is_finite()).unwrap_or(0.0),
    };
    shifted(ray, far, bounds, epsilon).any(|ray| match oracle.nearest(&ray, Interval::FORWARD) {
        Nearest::Unknown => true,
        Nearest::Hit { .. } => found.is_some(),
        Nearest::Miss => found.is_none(),
    })
}

fn is_right(oracle: &Oracle, ray: &Ray, found: Option<f64>) -> bool {
    match (oracle.nearest(ray, Interval::FORWARD), found) {
        (Nearest::Unknown, _) => true,
        (Nearest::Miss, found) => found.is_none(),
        (truth, found) => Error::of(&truth, found).is_none_or(Error::is_small),
    }
}

/// The ray with its origin moved to each corner, edge and face of a small box around it.
fn shifted(ray: &Ray, t: f64, bounds: &Aabb, epsilon: f64) -> impl Iterator<Item = Ray> + use<> {
    let ray = *ray;
    let finite = |v: DVec3| DVec3::select(v.is_finite_mask(), v, DVec3::ZERO);
    let reach = finite(bounds.min.abs()).max(finite(bounds.max.abs()));
    let scale = ray.origin.abs() + (t * ray.direction).abs() + reach;
    let step = MAX_ULPS * epsilon * scale;
    let sides = || [-1.0, 0.0, 1.0].into_iter();
    let boxes =
        sides().flat_map(move |x| sides().flat_map(move |y| sides().map(move |z| DVec3::new(x, y, z))));
    boxes
        .filter(|side| *side != DVec3::ZERO)
        .map(move |side| Ray::new(ray.origin + side * step, ray.direction))
}
