//! A search for the worst case of a family: an evolution strategy with one parent over the
//! parameter and the random numbers of a ray (Rechenberg 1973).
//!
//! Half of all generations are drawn at random; the others change the worst case so far. What it
//! finds becomes a fixed case in [`FOUND`].

mod found;

pub use found::{FOUND, Found};

use crate::{Family, Judged, Lab};
use whitstone_core::{DVec3, Ray};
use whitstone_testkit::Random;

/// Rays of one generation; they share the parameter, and so the scene.
const CHILDREN: usize = 32;
/// Random numbers of a ray that the search changes one by one; few rays use more.
const GENES: usize = 12;

/// The worst case that a search found.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Worst {
    /// Number of questions that were asked.
    pub questions: u64,
    /// Wrong classes among all answers, up to the reach of the family.
    pub wrong: u64,
    /// The worst answer.
    pub judged: Judged,
    /// The value of the parameter of the worst answer.
    pub parameter: f64,
    /// Its ray: origin and direction; `None` if the family traces no single rays.
    pub ray: Option<[f64; 6]>,
}

impl Worst {
    /// The worst case of two searches of one family.
    #[must_use]
    pub fn merged(self, other: Self) -> Self {
        let worse = if is_worse(&other.judged, &self.judged) {
            other
        } else {
            self
        };
        Self {
            questions: self.questions + other.questions,
            wrong: self.wrong + other.wrong,
            ..worse
        }
    }

    /// Whether an answer breaks the promise.
    pub fn breaks_promise(&self) -> bool {
        self.wrong > 0 || self.judged.share > 1.0
    }
}

/// Asks the question of a fixed case again.
///
/// # Errors
///
/// As [`Family::step`].
pub fn repeat(family: &dyn Family, case: &Found, lab: &Lab<'_>) -> Result<Judged, String> {
    let rays: Vec<Ray> = case.ray.iter().map(|numbers| ray_of(*numbers)).collect();
    let judged = family.judge_rays(case.parameter, &rays, lab)?;
    Ok(judged.into_iter().reduce(worse).unwrap_or(NOTHING))
}

/// Whether a family traces single rays, which are cheap questions.
pub fn traces_rays(family: &dyn Family) -> bool {
    let first = family.parameters().first().copied();
    first.is_some_and(|first| (0..1000).any(|seed| family.draw(first, &mut Random::new(seed)).is_some()))
}

const NOTHING: Judged = Judged { share: 0.0, wrong: 0 };

fn ray_of([x, y, z, dx, dy, dz]: [f64; 6]) -> Ray {
    Ray::new(DVec3::new(x, y, z), DVec3::new(dx, dy, dz))
}

fn is_worse(a: &Judged, b: &Judged) -> bool {
    (a.wrong, a.share) > (b.wrong, b.share)
}

fn worse(a: Judged, b: Judged) -> Judged {
    if is_worse(&b, &a) { b } else { a }
}

/// A point of the search space: the place of the parameter, from 0 (the first step) to 1 (the
/// reach), and the random numbers of the ray.
#[derive(Clone)]
struct Genome {
    place: f64,
    genes: [u64; GENES],
}

impl Genome {
    fn random(random: &mut Random) -> Self {
        Self {
            place: random.unit(),
            genes: std::array::from_fn(|_| random.bits()),
        }
    }

    /// The same with some random numbers changed a little or entirely.
    fn changed(&self, random: &mut Random) -> Self {
        let mut child = self.clone();
        for gene in &mut child.genes {
            match random.below(6) {
                0 => *gene = random.bits(),
                1 | 2 => {
                    // The high bits are the number, the low ones choose between alternatives.
                    let step = random.signed() * 10f64.powf(-8.0 * random.unit());
                    let moved = *gene as f64 + step * u64::MAX as f64;
                    *gene = (moved as u64) & !0xffff | *gene & 0xffff;
                }
                _ => {}
            }
        }
        child
    }

    /// The parameter, on a logarithmic scale.
    fn parameter(&self, steps: &[f64], is_continuous: bool) -> f64 {
        let last = steps.len() - 1;
        if !is_continuous {
            return steps[((self.place * steps.len() as f64) as usize).min(last)];
        }
        let (from, to) = (steps[0].ln(), steps[last].ln());
        (from + self.place * (to - from)).exp()
    }
}

/// Searches for the worst answer of Whitstone up to the reach of a family, until `is_done` holds
/// for the number of questions asked. Equal seeds give equal searches.
///
/// # Errors
///
/// As [`Family::step`].
pub fn search(
    family: &dyn Family,
    lab: &Lab<'_>,
    seed: u64,
    is_done: &dyn Fn(u64) -> bool,
) -> Result<Worst, String> {
    let about = family.about();
    let mut steps = family.parameters();
    let until = steps
        .iter()
        .position(|step| crate::report::is_close(*step, about.reach));
    steps.truncate(until.map_or(steps.len(), |until| until + 1));
    let name = about.name.bytes();
    let mut random = Random::new(name.fold(seed, |seed, byte| seed.rotate_left(9) ^ u64::from(byte)));
    let mut parent = Genome::random(&mut random);
    let mut worst = Worst {
        questions: 0,
        wrong: 0,
        judged: NOTHING,
        parameter: steps[0],
        ray: None,
    };
    while !is_done(worst.questions) {
        let is_change = random.below(2) == 0 && worst.questions > 0;
        let mut first = match is_change {
            true => parent.clone(),
            false => Genome::random(&mut random),
        };
        if is_change && random.below(2) == 0 {
            let step = random.signed() * 10f64.powf(-4.0 * random.unit());
            first.place = (first.place + step).clamp(0.0, 1.0);
        }
        let parameter = first.parameter(&steps, family.is_continuous());
        let mut children = Vec::new();
        for _ in 0..CHILDREN {
            let child = match is_change {
                true => first.changed(&mut random),
                false => Genome {
                    place: first.place,
                    ..Genome::random(&mut random)
                },
            };
            // The numbers after the first ones depend on them.
            let seed = child
                .genes
                .iter()
                .fold(0, |seed: u64, gene| seed.rotate_left(5) ^ gene);
            let mut numbers = Random::beginning_with(child.genes.to_vec(), seed);
            if let Some(ray) = family.draw(parameter, &mut numbers) {
                children.push((child, ray));
            }
        }
        let rays: Vec<Ray> = children.iter().map(|(_, ray)| *ray).collect();
        let judged = family
            .judge_rays(parameter, &rays, lab)
            .map_err(|problem| format!("{} at {parameter:e}: {problem}", about.name))?;
        // A family that traces no single rays has one answer for all queries of a step.
        worst.questions += match (rays.len(), judged.len()) {
            (0, 0) => 1,
            (0, _) => lab.rays as u64,
            (rays, _) => rays as u64,
        };
        for (number, judged) in judged.iter().enumerate() {
            worst.wrong += judged.wrong;
            if is_worse(judged, &worst.judged) {
                let child = children.get(number);
                parent = child.map_or_else(|| first.clone(), |(genome, _)| genome.clone());
                worst.judged = *judged;
                worst.parameter = parameter;
                worst.ray = child.map(|(_, ray)| {
                    let [[x, y, z], [dx, dy, dz]] = [ray.origin, ray.direction].map(|v| v.to_array());
                    [x, y, z, dx, dy, dz]
                });
            }
        }
    }
    Ok(worst)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{About, Answer, Engine, Sample};

    /// An error that is large only in a small part of a plane of two numbers, at one parameter.
    struct Peak;

    impl Family for Peak {
        fn about(&self) -> About {
            About {
                name: "peak",
                catalogue: &[],
                parameter: "nothing",
                measure: "none",
                promise: "1",
                pass: 1.0,
                usable: 1.0,
                reach: 1e6,
                floor: 1.0,
                limit: None,
            }
        }
        fn parameters(&self) -> Vec<f64> {
            crate::decades(0, 9)
        }
        fn step(&self, _: f64, _: &Lab<'_>) -> Result<Vec<(Engine, Answer)>, String> {
            Ok(vec![(Engine::Whitstone, Ok(Sample::new(0.25)))])
        }
        fn draw(&self, _: f64, random: &mut Random) -> Option<Ray> {
            Some(Ray::new(DVec3::new(random.unit(), random.unit(), 0.0), DVec3::Z))
        }
        fn judge_rays(&self, parameter: f64, rays: &[Ray], _: &Lab<'_>) -> Result<Vec<Judged>, String> {
            assert!((1.0..1e6 * 1.001).contains(&parameter), "{parameter}");
            let judged = rays.iter().map(|ray| {
                let off = (ray.origin - DVec3::new(0.3, 0.8, 0.0)).length() + (parameter.log10() - 4.2).abs();
                let wrong = u64::from(off < 1e-3);
                Judged {
                    share: 0.5 / (1.0 + off),
                    wrong,
                }
            });
            Ok(judged.collect())
        }
    }

    #[test]
    fn a_peak_is_found_that_random_questions_miss() {
        let registry = whitstone_core::Registry::default();
        let lab = Lab::new(&registry, None, 1);
        let found = search(&Peak, &lab, 1, &|questions| questions >= 100_000).unwrap();
        assert!(found.breaks_promise() && found.wrong > 0, "{found:?}");
        assert_eq!(
            found,
            search(&Peak, &lab, 1, &|questions| questions >= 100_000).unwrap()
        );
        let mut random = Random::new(1);
        let steps = crate::decades(0, 6);
        for _ in 0..20_000 {
            let genome = Genome::random(&mut random);
            let ray = Peak.draw(1.0, &mut random).unwrap();
            let judged = Peak
                .judge_rays(genome.parameter(&steps, true), &[ray], &lab)
                .unwrap();
            assert_eq!(judged[0].wrong, 0);
        }
        // A fixed case is asked again.
        let case = Found {
            family: "peak",
            parameter: found.parameter,
            ray: found.ray,
        };
        assert_eq!(repeat(&Peak, &case, &lab), Ok(found.judged));
    }

    #[test]
    fn a_family_without_rays_is_searched_by_its_steps() {
        let registry = whitstone_core::Registry::default();
        let lab = Lab::new(&registry, None, 7);
        struct Steps;
        impl Family for Steps {
            fn about(&self) -> About {
                Peak.about()
            }
            fn parameters(&self) -> Vec<f64> {
                Peak.parameters()
            }
            fn step(&self, parameter: f64, _: &Lab<'_>) -> Result<Vec<(Engine, Answer)>, String> {
                let error = if (1e2..1e3).contains(&parameter) { 3.0 } else { 0.5 };
                Ok(vec![(Engine::Whitstone, Ok(Sample::new(error)))])
            }
        }
        let found = search(&Steps, &lab, 3, &|questions| questions >= 700).unwrap();
        assert_eq!((found.questions, found.judged.share, found.ray), (700, 3.0, None));
        assert!(found.breaks_promise() && (1e2..1e3).contains(&found.parameter));
    }
}
