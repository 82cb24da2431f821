//! Holding an intersection to the oracle.

use crate::naive::{Textbook, textbook};
use crate::{Nearest, Oracle};
use std::fmt;
use std::path::Path;
use whitstone_core::{Aabb, DVec3, Interval, Ray, Registry, SceneErrors};
use whitstone_scene::{Description, Pipeline, Plan, Sources};

/// Most units in the last place, times the condition, that a ray parameter may be off.
pub const MOST_ULPS: f64 = 16.0;

/// What a scene needs besides shapes.
const CAMERA: &str =
    "camera = { type = \"perspective\", look_at = { origin = [0, 0, 9], target = [0, 0, 0] } }\n";

/// A scene with one shape, as it is built by the plugins, and the oracle for it.
pub struct Subject {
    /// With nothing else in it but what the shape places.
    pub pipeline: Pipeline,
    /// For the shape.
    pub oracle: Oracle,
    /// What books say, in single precision.
    pub textbook_f32: Box<dyn Textbook<f32>>,
    /// The same in double precision.
    pub textbook_f64: Box<dyn Textbook<f64>>,
}

impl Subject {
    /// From the text of a scene whose only shape that is not in a group it is; `base` is the folder
    /// that its files are relative to. A camera need not be there.
    ///
    /// # Errors
    ///
    /// All that is wrong with the scene, as people read it.
    pub fn new(text: &str, base: &Path, registry: &Registry) -> Result<Self, String> {
        let text = format!("{CAMERA}{text}");
        let sources = Sources::from_text("subject", &text, base, &[]);
        let sources = sources.map_err(|error| error.sources.report(&error.errors, false))?;
        let report = |errors: SceneErrors| sources.report(&errors, false);
        let description = Description::parse(&sources).map_err(report)?;
        let plan = Plan::new(&description, registry).map_err(report)?;
        Ok(Self {
            pipeline: Pipeline::build(&plan, registry).map_err(report)?,
            oracle: Oracle::new(&description, 0).map_err(report)?,
            textbook_f32: textbook(&description, 0).map_err(report)?,
            textbook_f64: textbook(&description, 0).map_err(report)?,
        })
    }
}

/// How well hits agree with the oracle's, over many rays.
#[derive(Clone, Debug, Default)]
pub struct Agreement {
    /// Rays that the oracle says hit.
    pub hits: u64,
    /// Rays that it says miss.
    pub misses: u64,
    /// Rays of which it says that no one can know.
    pub unknown: u64,
    /// Rays with the wrong answer, but a right one for a ray beside it: see [`Self::add`].
    pub ill_posed: u64,
    /// Rays with a wrong answer.
    pub wrong: u64,
    /// The largest error of t where both hit and neither of the two above applies, in units in the
    /// last place of t.
    pub most_ulps: f64,
    /// The largest quotient of such an error and the condition.
    pub most_ulps_by_condition: f64,
    /// The first ray with a wrong answer.
    pub first_wrong: Option<String>,
}

impl Agreement {
    /// Counts one ray. `found` is the ray parameter that someone else says, `bounds` those of the
    /// shape.
    ///
    /// An answer is right if hit or miss is, and t is off by at most [`MOST_ULPS`] units in the
    /// last place times the condition. One that is not is *ill-posed*, which is no fault, if it is
    /// right for a ray that starts beside this one: so far away as so many units in the last place
    /// of all coordinates involved, in one of 26 directions. That is what any backward stable
    /// method may do where a ray touches a surface or passes an edge.
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
            } else if shifted(ray, far, bounds).any(|ray| is_right(oracle, &ray, found)) {
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

/// What the errors of many rays come to, without asking whether they could be helped.
#[derive(Clone, Copy, Debug, Default)]
pub struct Errors {
    /// Rays of which the oracle knows the answer.
    pub rays: u64,
    /// Those with a hit instead of a miss, or the other way round.
    pub wrong_class: u64,
    /// The largest error of t among the others, in units in the last place of t.
    pub most_ulps: f64,
}

impl Errors {
    /// Counts one ray.
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

/// Of a ray parameter; infinite where the class is wrong.
#[derive(Clone, Copy, Debug)]
pub struct Error {
    /// In units in the last place of the true parameter.
    pub ulps: f64,
    /// The same over the condition.
    pub by_condition: f64,
}

impl Error {
    /// `None` where there is nothing to compare: both miss, or the oracle does not know.
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
        self.by_condition <= MOST_ULPS
    }
}

/// The distance to the next double away from zero.
fn ulp(t: f64) -> f64 {
    let t = t.abs();
    t.next_up() - t
}

fn is_right(oracle: &Oracle, ray: &Ray, found: Option<f64>) -> bool {
    match (oracle.nearest(ray, Interval::FORWARD), found) {
        (Nearest::Unknown, _) => true,
        (Nearest::Miss, found) => found.is_none(),
        (truth, found) => Error::of(&truth, found).is_none_or(Error::is_small),
    }
}

/// Rays beside a ray, at the corners, edges and faces of a little box about its origin.
fn shifted(ray: &Ray, t: f64, bounds: &Aabb) -> impl Iterator<Item = Ray> + use<> {
    let ray = *ray;
    let finite = |v: DVec3| DVec3::select(v.is_finite_mask(), v, DVec3::ZERO);
    let reach = finite(bounds.min.abs()).max(finite(bounds.max.abs()));
    let scale = ray.origin.abs() + (t * ray.direction).abs() + reach;
    let step = MOST_ULPS * f64::EPSILON * scale;
    let sides = || [-1.0, 0.0, 1.0].into_iter();
    let boxes =
        sides().flat_map(move |x| sides().flat_map(move |y| sides().map(move |z| DVec3::new(x, y, z))));
    boxes
        .filter(|side| *side != DVec3::ZERO)
        .map(move |side| Ray::new(ray.origin + side * step, ray.direction))
}
