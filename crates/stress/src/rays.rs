//! Families that query the nearest hit of rays with one shape; the oracle gives the truth.

use crate::lab::{Backends, join, single};
use crate::report::UNANSWERED;
use crate::{About, Answer, Engine, Family, Judged, Lab, Sample, view};
use std::hint::black_box;
use std::time::Instant;
use whitstone_core::{Aabb, DVec3, Interval, LoweredShape, Ray, SelfHitFilter};
use whitstone_oracle::agreement::{Agreement, Error, is_class_excused};
use whitstone_oracle::naive::{DoubleDouble, Real};
use whitstone_oracle::{Nearest, Oracle};
use whitstone_render::Pipeline;
use whitstone_testkit::Random;

/// Largest share of the rays of a step that the oracle may leave unanswered.
const MOST_UNKNOWN: f64 = 0.01;
/// Rejected rays per accepted ray before the step counts as impossible.
const TRIES: usize = 1000;
/// Maximum number of wrong answers of a step for which the oracle is asked whether a slightly
/// different ray excuses them. Further ones are excused if all of these are.
const MOST_EXCUSES: u64 = 20;

/// Rays at a shape. The strict measure is the error in units in the last place of a double, divided
/// by the condition number.
pub(crate) struct RayFamily {
    pub(crate) about: About,
    pub(crate) parameters: fn() -> Vec<f64>,
    /// A scene with one shape.
    pub(crate) scene: fn(f64) -> String,
    /// Generates a ray that clearly hits or clearly misses; `None` to reject it.
    pub(crate) ray: fn(f64, &mut Random) -> Option<Ray>,
    /// The unit of the error.
    pub(crate) unit: fn(f64, t: f64) -> f64,
    /// Whether the strict measure equals the error measure, instead of units in the last place.
    pub(crate) one_measure: bool,
    /// What an image of the scene shows.
    pub(crate) shown: Shown,
}

/// What a camera at the origin of one of the rays shows.
pub(crate) enum Shown {
    /// The whole shape, or the part of it that is seen from there.
    Whole,
    /// The origin of the world, as closely as the parameter is large.
    Close,
    /// Nothing: an image does not have such rays, or its pixels miss a shape so thin.
    Nothing,
}

impl Family for RayFamily {
    fn about(&self) -> About {
        self.about
    }

    fn parameters(&self) -> Vec<f64> {
        (self.parameters)()
    }

    fn step(&self, parameter: f64, lab: &Lab<'_>) -> Result<Vec<(Engine, Answer)>, String> {
        let scene = (self.scene)(parameter);
        let subject = lab.subject(&scene)?;
        let mut random = Random::new(parameter.to_bits());
        let mut rays = Vec::new();
        for _ in 0..TRIES * lab.rays {
            rays.extend((self.ray)(parameter, &mut random));
            if rays.len() == lab.rays {
                break;
            }
        }
        if rays.len() < lab.rays {
            return Err(format!(
                "only {} of {} rays could be generated: the others do not clearly hit or miss",
                rays.len(),
                lab.rays
            ));
        }
        let truths: Vec<Nearest> = rays
            .iter()
            .map(|ray| subject.oracle.nearest(ray, Interval::FORWARD))
            .collect();

        let unknown = truths.iter().filter(|truth| matches!(truth, Nearest::Unknown));
        let unknown = unknown.count();
        // On a busy machine the oracle may give up on a single ray.
        if unknown >= 5 && unknown as f64 > MOST_UNKNOWN * rays.len() as f64 {
            return Err(format!("{UNANSWERED} {unknown} of {} rays", rays.len()));
        }

        let bounds = bounds_of(&subject.pipeline);
        let questions = Questions {
            parameter,
            oracle: &subject.oracle,
            bounds: &bounds,
            rays: &rays,
            truths: &truths,
        };
        let judge = |found: &[Option<f64>], spacing| self.judge(&questions, found, spacing);
        let (double_spacing, single_spacing) = (f64::EPSILON, f64::from(f32::EPSILON));

        let (ours, ns) = traced(&subject.pipeline, &rays);
        let mut whitstone = judge(&ours, double_spacing);
        whitstone.ns_per_op = Some(ns);
        if !self.one_measure {
            let mut agreement = Agreement::default();
            for (ray, found) in rays.iter().zip(&ours) {
                agreement.add(&subject.oracle, ray, *found, &bounds);
            }
            // Without answers of the right class that are too far off, those that a slightly
            // different ray excuses do not count for the promise.
            if agreement.wrong <= whitstone.failures - whitstone.excused {
                whitstone.strict = agreement.most_ulps_by_condition;
                whitstone.own_ulps = whitstone.own_ulps.map(|[ulps, _]| [ulps, whitstone.strict]);
            }
        }

        let (double, ns) = timed(&rays, |ray| {
            subject
                .textbook_f64
                .intersect(ray.origin.to_array(), ray.direction.to_array())
        });
        let mut naive_f64 = judge(&double, double_spacing);
        naive_f64.ns_per_op = Some(ns);
        let singles: Vec<_> = rays
            .iter()
            .map(|ray| [ray.origin, ray.direction].map(|v| v.as_vec3().to_array()))
            .collect();
        let (found, ns) = timed(&singles, |[o, d]| {
            subject.textbook_f32.intersect(*o, *d).map(f64::from)
        });
        let mut naive_f32 = judge(&found, single_spacing);
        naive_f32.ns_per_op = Some(ns);
        let doubles: Vec<_> = rays
            .iter()
            .map(|ray| [ray.origin, ray.direction].map(|v| v.to_array().map(DoubleDouble::of)))
            .collect();
        let (found, ns) = timed(&doubles, |[o, d]| {
            let found = subject.textbook_double_double.intersect(*o, *d);
            found.map(Real::to_f64)
        });
        let mut double_double = judge(&found, double_spacing);
        double_double.ns_per_op = Some(ns);
        let mitsuba = |robust| {
            let answer = lab.mitsuba_closest(&scene, &rays, robust);
            answer.map(|(found, ns)| {
                let mut sample = judge(&found, single_spacing);
                sample.ns_per_op = Some(ns);
                sample
            })
        };
        let mut answers = vec![
            (Engine::Whitstone, Ok(whitstone)),
            (Engine::Mitsuba, mitsuba(true)),
            (Engine::NaiveDoubleDouble, Ok(double_double)),
            (Engine::NaiveF64, Ok(naive_f64)),
            (Engine::NaiveF32, Ok(naive_f32)),
        ];
        let shapes = subject.pipeline.scene.geometry.shapes();
        let of_triangles = shapes
            .iter()
            .all(|shape| matches!(shape, LoweredShape::Triangles(_)));
        if of_triangles {
            answers.push((Engine::MitsubaNotRobust, mitsuba(false)));
            let mut backends = Backends::default();
            backends.ask(lab, &scene, &|pipeline| {
                let (found, ns) = traced(pipeline, &rays);
                let mut sample = judge(&found, single_spacing);
                sample.ns_per_op = Some(ns);
                sample
            });
            answers.extend(backends.into_answers());
        }
        Ok(answers)
    }

    fn view(&self, parameter: f64, lab: &Lab<'_>) -> Result<String, String> {
        let scene = (self.scene)(parameter);
        let mut random = Random::new(parameter.to_bits());
        let ray = (0..TRIES).find_map(|_| (self.ray)(parameter, &mut random));
        let ray = ray.ok_or("no ray could be generated")?;
        let (target, radius) = match self.shown {
            Shown::Nothing => return Err("no small image shows its rays".to_owned()),
            Shown::Close => (DVec3::ZERO, 2.0 * parameter),
            Shown::Whole => {
                let bounds = bounds_of(&lab.pipeline(&scene)?);
                (bounds.center(), 0.75 * bounds.extent().length())
            }
        };
        Ok(view::along(&scene, &ray, target, radius))
    }

    fn draw(&self, parameter: f64, random: &mut Random) -> Option<Ray> {
        (self.ray)(parameter, random)
    }

    fn judge_rays(&self, parameter: f64, rays: &[Ray], lab: &Lab<'_>) -> Result<Vec<Judged>, String> {
        let subject = lab.subject(&(self.scene)(parameter))?;
        let bounds = bounds_of(&subject.pipeline);
        let accelerator = &subject.pipeline.scene.accelerator;
        let judged = rays.iter().map(|ray| {
            let hit = accelerator.intersect(ray, Interval::FORWARD, SelfHitFilter::NOTHING);
            let found = hit.map(|hit| hit.t);
            if !self.one_measure {
                let mut agreement = Agreement::default();
                agreement.add(&subject.oracle, ray, found, &bounds);
                return Judged {
                    share: agreement.most_ulps_by_condition / self.about.pass,
                    wrong: agreement.wrong,
                };
            }
            let truths = [subject.oracle.nearest(ray, Interval::FORWARD)];
            let questions = Questions {
                parameter,
                oracle: &subject.oracle,
                bounds: &bounds,
                rays: &[*ray],
                truths: &truths,
            };
            Judged::new(&self.judge(&questions, &[found], f64::EPSILON), self.about.pass)
        });
        Ok(judged.collect())
    }
}

/// The bounding box of all shapes of a scene.
pub(crate) fn bounds_of(pipeline: &Pipeline) -> Aabb {
    let geometry = &pipeline.scene.geometry;
    let boxes = geometry.elements().map(|element| geometry.bounds(element));
    boxes.fold(Aabb::EMPTY, Aabb::union)
}

/// The rays of a step, and the truth about them.
struct Questions<'a> {
    parameter: f64,
    oracle: &'a Oracle,
    bounds: &'a Aabb,
    rays: &'a [Ray],
    truths: &'a [Nearest],
}

impl RayFamily {
    /// Judges the answers of an engine whose numbers have this relative spacing.
    fn judge(&self, questions: &Questions<'_>, found: &[Option<f64>], spacing: f64) -> Sample {
        let Questions {
            parameter,
            oracle,
            bounds,
            rays,
            truths,
        } = *questions;
        let mut sample = Sample::default();
        let (mut own, mut worst) = ([0.0_f64; 2], 1.0_f64);
        for ((ray, truth), found) in rays.iter().zip(truths).zip(found) {
            match (truth, found) {
                (Nearest::Unknown, _) | (Nearest::Miss, None) => {}
                (Nearest::Hit { t, condition, .. }, Some(found)) if found.is_finite() => {
                    let error = t.farthest(*found) / (self.unit)(parameter, t.nearest());
                    let ulps = t.farthest(*found) / (spacing * t.nearest());
                    own = [own[0].max(ulps), own[1].max(ulps / condition)];
                    worst = worst.max(*condition);
                    sample.error = sample.error.max(error);
                    let ulps = Error::of(truth, Some(*found)).map_or(0.0, |error| error.by_condition);
                    sample.strict = sample.strict.max(if self.one_measure { error } else { ulps });
                }
                (_, Some(found)) if !found.is_finite() => sample.nonfinite += 1,
                (_, found) => {
                    sample.failures += 1;
                    if sample.failures <= MOST_EXCUSES {
                        let excused = is_class_excused(oracle, ray, *found, bounds, spacing);
                        sample.excused += u64::from(excused);
                    } else if sample.excused + 1 == sample.failures {
                        sample.excused += 1;
                    }
                }
            }
        }
        sample.own_ulps = Some(own);
        sample.condition = Some(worst);
        sample
    }
}

/// Several families with one shape each, reported as one: the worst shape counts. An engine takes
/// part if it supports all shapes; backends get those of triangles.
pub(crate) struct Several(pub(crate) &'static [RayFamily]);

impl Family for Several {
    fn about(&self) -> About {
        self.0[0].about
    }

    fn parameters(&self) -> Vec<f64> {
        (self.0[0].parameters)()
    }

    fn step(&self, parameter: f64, lab: &Lab<'_>) -> Result<Vec<(Engine, Answer)>, String> {
        let mut all: Vec<(Engine, Answer)> = Vec::new();
        for family in self.0 {
            for (engine, answer) in family.step(parameter, lab)? {
                match all.iter_mut().find(|(known, _)| *known == engine) {
                    None => all.push((engine, answer)),
                    Some((_, known)) => join(known, answer),
                }
            }
        }
        Ok(all)
    }

    fn view(&self, parameter: f64, lab: &Lab<'_>) -> Result<String, String> {
        self.0[0].view(parameter, lab)
    }

    /// All shapes have the same rays.
    fn draw(&self, parameter: f64, random: &mut Random) -> Option<Ray> {
        self.0[0].draw(parameter, random)
    }

    fn judge_rays(&self, parameter: f64, rays: &[Ray], lab: &Lab<'_>) -> Result<Vec<Judged>, String> {
        let mut worst: Vec<Judged> = Vec::new();
        for family in self.0 {
            let judged = family.judge_rays(parameter, rays, lab)?;
            worst.resize(judged.len(), Judged { share: 0.0, wrong: 0 });
            for (worst, more) in worst.iter_mut().zip(judged) {
                worst.share = worst.share.max(more.share);
                worst.wrong += more.wrong;
            }
        }
        Ok(worst)
    }
}

/// Distances of the nearest hits, and nanoseconds per ray.
fn traced(pipeline: &Pipeline, rays: &[Ray]) -> (Vec<Option<f64>>, f64) {
    let accelerator = &pipeline.scene.accelerator;
    timed(rays, |ray| {
        let hit = accelerator.intersect(ray, Interval::FORWARD, SelfHitFilter::NOTHING);
        hit.map(|hit| hit.t)
    })
}

/// All answers, and nanoseconds per query in the best of three runs.
fn timed<Q, A>(questions: &[Q], answer: impl Fn(&Q) -> A) -> (Vec<A>, f64) {
    let mut best = f64::INFINITY;
    let mut answers = Vec::new();
    for _ in 0..3 {
        answers.clear();
        let start = Instant::now();
        answers.extend(questions.iter().map(|question| answer(black_box(question))));
        best = best.min(start.elapsed().as_secs_f64());
    }
    (answers, best * 1e9 / questions.len() as f64)
}

/// A ray in single precision from `origin` that passes `center` at the distance `miss`, in a random
/// direction around it. `None` if the rounded distance is within 1 % of `edge`, where the class
/// would not be clear.
pub(crate) fn past(center: DVec3, origin: DVec3, miss: f64, edge: f64, random: &mut Random) -> Option<Ray> {
    let ray = past_in_double(center, origin, miss, edge, random)?;
    let ray = single(ray.origin, ray.direction);
    let nearest = (center - ray.origin).cross(ray.direction).length() / ray.direction.length();
    ((nearest / edge - 1.0).abs() > 0.01).then_some(ray)
}

/// The same without rounding to single precision, for distances at which its rays miss everything.
pub(crate) fn past_in_double(
    center: DVec3,
    origin: DVec3,
    miss: f64,
    edge: f64,
    random: &mut Random,
) -> Option<Ray> {
    let to = center - origin;
    let distance = to.length();
    let (side, up) = to.normalize().any_orthonormal_pair();
    let turn = std::f64::consts::TAU * random.unit();
    let sine = (miss / distance).min(1.0);
    let across = side * turn.cos() + up * turn.sin();
    let ray = Ray::new(origin, (1.0 - sine * sine).sqrt() * to / distance + sine * across);
    ((miss / edge - 1.0).abs() > 0.01).then_some(ray)
}

/// A number in [0, 0.95) or, one time in four, in [1.05, 1.6).
pub(crate) fn clear(random: &mut Random) -> f64 {
    match random.below(4) {
        0 => 1.05 + 0.55 * random.unit(),
        _ => 0.95 * random.unit(),
    }
}
