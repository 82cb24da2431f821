//! A set of rays, and two ways to trace it: one call per ray, and one call per stream.

use super::data::{self, Query};
use rayon::prelude::*;
use std::path::Path;
use whitstone::core::stream::{HitStream, LANES, RayStream};
use whitstone::core::{Accelerator, InstanceId, PreliminaryIntersection, SelfHitFilter};

/// How rays are passed to an accelerator.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Mode {
    /// One call per ray.
    Single,
    /// One call for each stream of 256 rays.
    Batch,
}

impl Mode {
    pub(super) const ALL: [Self; 2] = [Self::Single, Self::Batch];

    pub(super) const fn name(self) -> &'static str {
        match self {
            Self::Single => "single",
            Self::Batch => "batch",
        }
    }
}

/// The same rays as single rays and as streams.
pub(super) struct Rays {
    single: Vec<Query>,
    streams: Vec<RayStream>,
    /// Whether any hit is sufficient.
    any: bool,
}

/// The result of a ray, for bitwise comparison: primitive, distance and parameters of the nearest
/// hit, or whether there is any hit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Answer {
    Nearest(Option<((InstanceId, u32, u32), [u64; 3])>),
    Any(bool),
}

/// The differences between two sets of answers.
#[derive(Debug, Default)]
pub(super) struct Difference {
    /// Number of answers that differ in any bit.
    pub(super) mismatches: usize,
    /// Number of answers that differ in the primitive or in whether there is a hit.
    pub(super) others: usize,
    /// Largest relative difference of the distance to the same primitive.
    pub(super) distance: f64,
}

fn nearest(hit: Option<PreliminaryIntersection>) -> Answer {
    Answer::Nearest(hit.map(|hit| {
        let numbers = [hit.t, hit.prim_uv.x, hit.prim_uv.y];
        (hit.id(), numbers.map(f64::to_bits))
    }))
}

impl Rays {
    /// Reads every `stride`th block of a file.
    pub(super) fn read(path: &Path, stride: usize, set: &str) -> Result<Self, String> {
        Ok(Self::new(data::rays(path, stride)?, set == "shadow"))
    }

    pub(super) fn new(single: Vec<Query>, any: bool) -> Self {
        let streams = single.chunks(LANES).map(|rays| {
            let mut stream = RayStream {
                len: rays.len(),
                ..RayStream::default()
            };
            for (lane, (ray, interval)) in rays.iter().enumerate() {
                stream.set(lane, *ray, interval.max, SelfHitFilter::NOTHING);
            }
            stream
        });
        Self {
            streams: streams.collect(),
            single,
            any,
        }
    }

    pub(super) fn len(&self) -> usize {
        self.single.len()
    }

    /// Traces all rays; returns the number of hits.
    pub(super) fn pass(&self, accelerator: &dyn Accelerator, mode: Mode) -> usize {
        match mode {
            Mode::Single => self.count_single(accelerator, &self.single),
            Mode::Batch => {
                let mut hits = Box::<HitStream>::default();
                let streams = self.streams.iter();
                streams
                    .map(|stream| self.count_stream(accelerator, stream, &mut hits))
                    .sum()
            }
        }
    }

    fn count_single(&self, accelerator: &dyn Accelerator, rays: &[Query]) -> usize {
        let hits = rays.iter().filter(|(ray, interval)| {
            if self.any {
                accelerator.occluded(ray, *interval, SelfHitFilter::NOTHING)
            } else {
                accelerator
                    .intersect(ray, *interval, SelfHitFilter::NOTHING)
                    .is_some()
            }
        });
        hits.count()
    }

    fn count_stream(&self, accelerator: &dyn Accelerator, stream: &RayStream, hits: &mut HitStream) -> usize {
        if self.any {
            let mut hidden = [false; LANES];
            accelerator.occluded_stream(stream, &mut hidden);
            hidden.iter().filter(|&&hidden| hidden).count()
        } else {
            accelerator.intersect_stream(stream, hits);
            (0..stream.len).filter(|&lane| hits.get(lane).is_some()).count()
        }
    }

    /// The answer for each ray.
    pub(super) fn answers(&self, accelerator: &dyn Accelerator, mode: Mode) -> Vec<Answer> {
        match mode {
            Mode::Single => {
                let answer = |&(ray, interval): &Query| match self.any {
                    true => Answer::Any(accelerator.occluded(&ray, interval, SelfHitFilter::NOTHING)),
                    false => nearest(accelerator.intersect(&ray, interval, SelfHitFilter::NOTHING)),
                };
                self.single.iter().map(answer).collect()
            }
            Mode::Batch => {
                let mut hits = Box::<HitStream>::default();
                let mut answers = Vec::with_capacity(self.len());
                for stream in &self.streams {
                    if self.any {
                        let mut hidden = [false; LANES];
                        accelerator.occluded_stream(stream, &mut hidden);
                        answers.extend(hidden[..stream.len].iter().map(|&hidden| Answer::Any(hidden)));
                    } else {
                        accelerator.intersect_stream(stream, &mut hits);
                        answers.extend((0..stream.len).map(|lane| nearest(hits.get(lane))));
                    }
                }
                answers
            }
        }
    }

    /// The differences between the answers and the expected ones.
    pub(super) fn difference(
        &self,
        accelerator: &dyn Accelerator,
        mode: Mode,
        expected: &[Answer],
    ) -> Difference {
        let mut difference = Difference::default();
        for (found, expected) in self.answers(accelerator, mode).iter().zip(expected) {
            difference.mismatches += usize::from(found != expected);
            match (found, expected) {
                (Answer::Nearest(Some((a, [found, ..]))), Answer::Nearest(Some((b, [t, ..])))) if a == b => {
                    let [found, t] = [*found, *t].map(f64::from_bits);
                    difference.distance = difference.distance.max((found - t).abs() / t);
                }
                _ => difference.others += usize::from(found != expected),
            }
        }
        difference
    }

    /// As [`Self::pass`], distributed over the current thread pool.
    pub(super) fn parallel_pass(&self, accelerator: &dyn Accelerator, mode: Mode) -> usize {
        // As many rays as a tile of a picture has.
        match mode {
            Mode::Single => {
                let hits = self.single.par_chunks(LANES);
                hits.map(|rays| self.count_single(accelerator, rays)).sum()
            }
            Mode::Batch => {
                let counts = self
                    .streams
                    .par_iter()
                    .map_init(Box::<HitStream>::default, |hits, stream| {
                        self.count_stream(accelerator, stream, hits)
                    });
                counts.sum()
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use whitstone::core::{DVec2, DVec3, Interval, Ray, Statistics};

    /// An accelerator whose single rays and streams disagree.
    struct Torn;

    const HIT: PreliminaryIntersection = PreliminaryIntersection {
        t: 1.0,
        prim_uv: DVec2::ZERO,
        instance: InstanceId::TOP_LEVEL,
        shape: 0,
        primitive: 0,
    };

    impl Accelerator for Torn {
        fn intersect(&self, ray: &Ray, _: Interval, _: SelfHitFilter) -> Option<PreliminaryIntersection> {
            (ray.origin.x < 300.0).then_some(HIT)
        }

        fn occluded(&self, ray: &Ray, _: Interval, _: SelfHitFilter) -> bool {
            ray.origin.x < 300.0
        }

        fn intersect_stream(&self, rays: &RayStream, hits: &mut HitStream) {
            hits.clear(rays);
            hits.set(0, &HIT);
        }

        fn occluded_stream(&self, _: &RayStream, hidden: &mut [bool; LANES]) {
            hidden[0] = true;
        }

        fn statistics(&self) -> Statistics {
            Statistics::new()
        }
    }

    #[test]
    fn streams_are_counted_and_compared_ray_by_ray() {
        for any in [false, true] {
            let ray = |i: i32| Ray::new(DVec3::new(f64::from(i), 0.0, 0.0), DVec3::Z);
            let rays = Rays::new((0..600).map(|i| (ray(i), Interval::FORWARD)).collect(), any);
            assert_eq!(rays.pass(&Torn, Mode::Single), 300);
            // The first ray of each of three streams.
            assert_eq!(rays.pass(&Torn, Mode::Batch), 3);
            let expected = rays.answers(&Torn, Mode::Single);
            assert_eq!(rays.difference(&Torn, Mode::Single, &expected).mismatches, 0);
            // 298 of the first 300 are missing, and ray 512 should not hit.
            let difference = rays.difference(&Torn, Mode::Batch, &expected);
            assert_eq!((difference.mismatches, difference.others), (299, 299));
            for mode in Mode::ALL {
                assert_eq!(rays.parallel_pass(&Torn, mode), rays.pass(&Torn, mode));
            }
        }
    }
}
