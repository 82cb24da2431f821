//! Laws of accelerators.

use crate::broken::Broken;
use crate::instances::{Naive, Shapes, instance_geometries, instance_triangles};
use crate::random::Random;
use crate::shapes::same_bits;
use crate::streams::{Query, accelerator_streams};
use crate::test_shapes::{ball, grid, mesh_of, random_mesh, slivers, soup};
use crate::{Wall, build};
use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, PoisonError};
use whitstone_core::triangle::ShearedRay;
use whitstone_core::{
    Accelerator, Accelerators, DAffine3, DMat3, DVec3, Geometry, Interval, LoweredShape, Plugin,
    PreliminaryIntersection, Ray, SelfHitFilter, TriangleMesh,
};

/// Checks that an accelerator gives bit for bit the results of testing every element in order, for
/// nearest hits and occlusion, in any interval and with any skipped primitive.
///
/// The geometries are: nothing, one triangle, random triangles and balls, coincident elements,
/// grids of axis-parallel faces with rays in their planes, slivers, an unbounded wall, elements of
/// very different sizes, and instances (nested, coincident, sheared, unbounded, of slivers) with
/// the accelerator on both levels. Rays come one by one and in streams. Geometries of triangles are
/// also moved, and accelerators that can be refitted must give the results for the moved triangles.
///
/// # Panics
///
/// If the accelerator cannot be built or its results differ; the message names the geometry and the
/// ray.
pub fn accelerator_laws<P: Plugin<Accelerators>>(text: &str) {
    accelerator_laws_of_part::<P>(text, 1);
}

/// [`accelerator_laws`] with one of `part` rays, for accelerators that test every element: they
/// take as long as what they are compared with.
///
/// # Panics
///
/// As [`accelerator_laws`].
pub fn accelerator_laws_of_part<P: Plugin<Accelerators>>(text: &str, part: u32) {
    let build = |geometry| match build::<Accelerators, P>(text, geometry) {
        Ok(accelerator) => accelerator,
        Err(error) => panic!("{}: {error}", P::TYPE),
    };
    let broken = first_broken(build, part);
    let broken = broken.err().map(|broken| broken.law);
    assert_eq!(broken, None, "{} with \"{text}\"", P::TYPE);
}

/// Compares an accelerator over some geometry with testing every element, for `rays` rays around
/// the geometry and in its faces.
///
/// # Panics
///
/// At the first difference; the message names the ray.
pub fn accelerator_agrees(geometry: &Geometry, accelerator: &dyn Accelerator, rays: u32) {
    let broken = compare(geometry, accelerator, rays).err();
    assert_eq!(broken.map(|broken| broken.law), None);
}

/// Random rays in and around a geometry: between arbitrary points, to corners, along axes, in
/// planes of faces, nearly parallel to triangles, and from very far away. Deterministic for a given
/// seed.
pub fn random_rays(geometry: &Geometry, count: u64, seed: u64) -> impl Iterator<Item = Ray> {
    let mut random = Random::new(seed);
    let aim = Aim::new(geometry);
    (0..count).map(move |number| aim.ray((number % 7) as u32, &mut random))
}

/// A ray with all its hits, and what is asked about it.
struct Question {
    ray: Ray,
    skip: SelfHitFilter,
    intervals: [Interval; 3],
    hits: Vec<PreliminaryIntersection>,
}

/// Questions about a geometry, with the answers of testing every element.
struct Questions {
    single: Vec<Question>,
    /// Those of streams: of the same rays, and of bundles.
    streams: [Vec<Query>; 2],
}

/// The geometries of the laws with their questions.
struct Known {
    plain: Vec<(&'static str, Arc<Geometry>, Questions)>,
    /// Other places of the triangles of plain geometries, by their numbers.
    moved: Vec<(usize, Moved)>,
    instances: Vec<(&'static str, Shapes, Questions)>,
}

impl Known {
    /// For one of `part` rays of each geometry. Many accelerators are asked the same: testing every
    /// element takes most of the time, and happens once.
    fn of(part: u32) -> Arc<Self> {
        static KNOWN: Mutex<BTreeMap<u32, Arc<Known>>> = Mutex::new(BTreeMap::new());
        let mut known = KNOWN.lock().unwrap_or_else(PoisonError::into_inner);
        known
            .entry(part)
            .or_insert_with(|| Arc::new(Self::new(part)))
            .clone()
    }

    fn new(part: u32) -> Self {
        let plain = geometries().into_iter().map(|(name, shapes, rays)| {
            let geometry = Arc::new(Geometry::new(shapes));
            let questions = Questions::new(&geometry, rays.div_ceil(part));
            (name, geometry, questions)
        });
        let plain: Vec<_> = plain.collect();
        let moved = plain
            .iter()
            .enumerate()
            .flat_map(|(number, (_, geometry, questions))| {
                let rays = (questions.single.len() as u32).div_ceil(4);
                Moved::all(geometry, rays)
                    .into_iter()
                    .map(move |moved| (number, moved))
            });
        let instances = instance_geometries().into_iter().map(|(name, shapes, rays)| {
            let truth = Geometry::new(shapes(&naive));
            (name, shapes, Questions::new(&truth, rays.div_ceil(part)))
        });
        Self {
            moved: moved.collect(),
            plain,
            instances: instances.collect(),
        }
    }
}

/// A geometry whose triangles have moved.
struct Moved {
    geometry: Arc<Geometry>,
    /// The map, if it is a rotation and translation.
    rigid: Option<DAffine3>,
    questions: Questions,
}

impl Moved {
    /// A geometry of triangles twisted, and turned as a whole; nothing for other geometries.
    fn all(geometry: &Geometry, rays: u32) -> Vec<Self> {
        let moved = |rigid: Option<DAffine3>| {
            let turn = |p: DVec3| match rigid {
                Some(rigid) => rigid.transform_point3(p),
                None => DMat3::from_rotation_y(0.7 * p.y) * p + 0.1 * p.x * DVec3::Y,
            };
            let shapes = geometry.shapes().iter().map(|shape| match shape {
                LoweredShape::Triangles(mesh) => {
                    let mut mesh = mesh.clone();
                    mesh.positions.iter_mut().for_each(|p| *p = turn(*p));
                    Some(LoweredShape::Triangles(mesh))
                }
                _ => None,
            });
            let geometry = Arc::new(Geometry::new(shapes.collect::<Option<_>>()?));
            Some(Self {
                questions: Questions::new(&geometry, rays),
                geometry,
                rigid,
            })
        };
        let rotation = DMat3::from_axis_angle(DVec3::new(1.0, 2.0, -0.5).normalize(), 1.1);
        let rigid = DAffine3::from_mat3_translation(rotation, DVec3::new(3.0, -0.25, 0.1));
        [None, Some(rigid)].into_iter().filter_map(moved).collect()
    }
}

fn naive(geometry: Arc<Geometry>) -> Box<dyn Accelerator> {
    Box::new(Naive::new(geometry))
}

/// The first difference, for one of `part` rays of each geometry.
fn first_broken(build: impl Fn(Arc<Geometry>) -> Box<dyn Accelerator>, part: u32) -> Result<(), Broken> {
    let known = Known::of(part);
    for (number, (name, geometry, questions)) in known.plain.iter().enumerate() {
        let accelerator = build(geometry.clone());
        let asked = questions.ask(&*accelerator);
        asked.map_err(|broken| broken.within(&format!("over {name}")))?;
        let moved = known.moved.iter().filter(|(of, _)| *of == number);
        for (_, moved) in moved {
            let refitted = accelerator.refitted(&moved.geometry, moved.rigid.as_ref());
            let asked = refitted.map(|refitted| moved.questions.ask(&*refitted));
            let within = |broken: Broken| broken.within(&format!("refitted to {name} that has moved"));
            asked.unwrap_or(Ok(())).map_err(within)?;
        }
    }
    for (name, shapes, questions) in &known.instances {
        // The accelerator under test on both levels: over the instances and inside the groups. Then
        // only inside the groups, with instances that are queried one by one, by streams.
        let geometry = || Arc::new(Geometry::new(shapes(&build)));
        for accelerator in [build(geometry()), naive(geometry())] {
            let asked = questions.ask(&*accelerator);
            asked.map_err(|broken| broken.within(&format!("over {name}")))?;
        }
    }
    Ok(())
}

/// Compares the two for `rays` rays; the error names the first ray for which they differ.
pub(crate) fn compare(geometry: &Geometry, accelerator: &dyn Accelerator, rays: u32) -> Result<(), Broken> {
    Questions::new(geometry, rays).ask(accelerator)
}

impl Questions {
    fn new(geometry: &Geometry, rays: u32) -> Self {
        let mut random = Random::new(u64::from(rays));
        let aim = Aim::new(geometry);
        let mut skip = SelfHitFilter::NOTHING;
        let (mut single, mut queries, mut bundles) = (Vec::new(), Vec::new(), Vec::new());
        for number in 0..rays {
            let ray = aim.ray(number, &mut random);
            let hits = everything(geometry, &ray, skip);
            // An interval that ends exactly at a hit distinguishes open from closed intervals.
            let ends = match hits.len() {
                0 => [random.unit(), f64::INFINITY],
                n => [hits[random.below(n)].t, hits[random.below(n)].t],
            };
            queries.extend([f64::INFINITY, ends[0].abs()].map(|limit| (ray, limit, skip)));
            if number.is_multiple_of(BUNDLE as u32 / 4) {
                for limit in [f64::INFINITY, 1.5 * ends[0].abs()] {
                    bundles.extend(aim.bundle(&ray, &mut random).map(|ray| (ray, limit, skip)));
                }
            }
            let question = Question {
                ray,
                skip,
                intervals: [
                    Interval::FORWARD,
                    Interval::up_to(ends[0].abs()),
                    Interval {
                        min: ends[1].max(0.0),
                        max: f64::INFINITY,
                    },
                ],
                hits,
            };
            skip = match question.nearest(Interval::FORWARD) {
                Some(hit) if number.is_multiple_of(3) => SelfHitFilter::leaving(&hit),
                _ => SelfHitFilter::NOTHING,
            };
            single.push(question);
        }
        Self {
            single,
            streams: [queries, bundles],
        }
    }

    /// The first ray for which an accelerator has another answer.
    fn ask(&self, accelerator: &dyn Accelerator) -> Result<(), Broken> {
        for question in &self.single {
            question.ask(accelerator)?;
        }
        for queries in &self.streams {
            accelerator_streams(accelerator, queries)?;
        }
        Ok(())
    }
}

impl Question {
    fn nearest(&self, interval: Interval) -> Option<PreliminaryIntersection> {
        let inside = self.hits.iter().filter(|hit| interval.contains(hit.t)).copied();
        inside.reduce(|best, hit| if hit.is_nearer_than(&best) { hit } else { best })
    }

    fn ask(&self, accelerator: &dyn Accelerator) -> Result<(), Broken> {
        let Self { ray, skip, .. } = self;
        for interval in self.intervals {
            let expected = self.nearest(interval);
            let found = accelerator.intersect(ray, interval, *skip);
            let same = match (&expected, &found) {
                (None, None) => true,
                (Some(a), Some(b)) => same_bits(a, b),
                _ => false,
            };
            if !same {
                let law = format!("{ray:?}, {interval:?}, {skip:?}: expected {expected:?}, found {found:?}");
                return Err(Broken::at(ray, law));
            }
            let occluded = accelerator.occluded(ray, interval, *skip);
            if occluded != expected.is_some() {
                let law = format!("{ray:?}, {interval:?}, {skip:?}: occluded is {occluded}");
                return Err(Broken::at(ray, law));
            }
        }
        Ok(())
    }
}

/// Number of rays in a bundle of similar rays: enough that whole lane groups are similar, wherever
/// the groups begin.
const BUNDLE: usize = 32;

/// All hits of all elements in front of the ray.
fn everything(geometry: &Geometry, ray: &Ray, skip: SelfHitFilter) -> Vec<PreliminaryIntersection> {
    let sheared = ShearedRay::new(ray);
    // An element returns only its nearest hit: to find all, query again from there.
    let mut hits = Vec::new();
    for element in geometry.elements() {
        let mut interval = Interval::FORWARD;
        while let Some(hit) = geometry.intersect(element, ray, &sheared, interval, skip) {
            hits.push(hit);
            interval.min = hit.t;
        }
    }
    hits
}

/// Generates rays in and around a geometry.
struct Aim {
    center: DVec3,
    size: f64,
    /// Sampled corners of triangles: rays go through them and lie in axis-parallel planes through
    /// them.
    corners: Vec<DVec3>,
    /// Sampled triangles: rays go through their interior, however thin they are.
    triangles: Vec<[DVec3; 3]>,
}

impl Aim {
    fn new(geometry: &Geometry) -> Self {
        let bounds = geometry
            .elements()
            .map(|element| geometry.bounds(element))
            .filter(|aabb| aabb.is_finite())
            .fold(whitstone_core::Aabb::EMPTY, whitstone_core::Aabb::union);
        let (center, size) = if bounds.is_empty() {
            (DVec3::ZERO, 1.0)
        } else {
            (bounds.center(), bounds.extent().max_element().max(1e-3))
        };
        let meshes = geometry.shapes().iter().filter_map(|shape| match shape {
            LoweredShape::Triangles(mesh) => Some(mesh),
            _ => None,
        });
        let all = meshes.flat_map(|mesh| (0..mesh.triangles.len() as u32).map(|i| mesh.corners(i)));
        let mut triangles: Vec<[DVec3; 3]> = all.take(1 << 14).collect();
        triangles.extend(instance_triangles(geometry));
        let mut corners: Vec<DVec3> = triangles.iter().map(|triangle| triangle[0]).collect();
        corners.push(center);
        Self {
            center,
            size,
            corners,
            triangles,
        }
    }

    fn ray(&self, number: u32, random: &mut Random) -> Ray {
        let corner = self.corners[random.below(self.corners.len())];
        let around = self.center + 0.7 * self.size * random.cube();
        match number % 7 {
            // Between arbitrary points.
            0 => Ray::new(around, random.direction()),
            1 => {
                let origin = self.center + 4.0 * self.size * random.direction();
                Ray::new(origin, (around - origin).normalize())
            }
            // To a corner, where several elements are hit at the same distance.
            2 => {
                let origin = self.center + 2.0 * self.size * random.direction();
                Ray::new(origin, corner - origin)
            }
            // Along an axis through a corner, hence in planes of boxes, with zeros of both signs.
            3 => {
                let mut direction =
                    DVec3::from_array([0; 3].map(|_| if random.unit() < 0.5 { 0.0 } else { -0.0 }));
                let axis = random.below(3);
                direction[axis] = random.signed();
                let mut origin = corner;
                origin[axis] -= 2.0 * self.size * direction[axis].signum();
                Ray::new(origin, direction)
            }
            // In an axis-parallel plane through a corner.
            4 => {
                let axis = random.below(3);
                let mut origin = around;
                origin[axis] = corner[axis];
                let mut direction = random.direction();
                direction[axis] = if random.unit() < 0.5 { 0.0 } else { -0.0 };
                Ray::new(origin, direction)
            }
            // To the interior of a triangle at grazing incidence, where a small error of direction
            // is a large error of distance.
            5 if !self.triangles.is_empty() => {
                let [a, b, c] = self.triangles[random.below(self.triangles.len())];
                let (u, v) = (0.5 * random.unit(), 0.5 * random.unit());
                let inside = a + u * (b - a) + v * (c - a);
                let origin = inside + self.size * (random.direction() * DVec3::new(1.0, 1.0, 0.1));
                Ray::new(origin, inside - origin)
            }
            // From very far away.
            _ => {
                let origin = self.center + 1e5 * self.size * random.direction();
                Ray::new(origin, 1e-3 * (around - origin))
            }
        }
    }
}

impl Aim {
    /// A ray and similar ones, so that accelerators may process them as a packet.
    fn bundle(&self, ray: &Ray, random: &mut Random) -> [Ray; BUNDLE] {
        let spread = 10f64.powf(-1.0 - 5.0 * random.unit());
        [0; BUNDLE].map(|_| Ray {
            origin: ray.origin + spread * self.size * random.cube(),
            direction: ray.direction + spread * ray.direction.length() * random.cube(),
        })
    }
}

/// Geometries, each with its name and its number of rays.
fn geometries() -> Vec<(&'static str, Vec<LoweredShape>, u32)> {
    let mut random = Random::new(7);
    let mut mixed = vec![soup(&mut random, 700, 0.2)];
    mixed.extend((0..60).map(|_| ball(&mut random, 1.0)));
    mixed.push(soup(&mut random, 1, 1.0));
    let wall = Wall {
        point: 0.1 * DVec3::Y,
        normal: DVec3::Y,
    };
    let with_wall = vec![
        soup(&mut random, 50, 0.5),
        LoweredShape::Custom(Box::new(wall)),
        grid(3),
    ];
    let mut apart = vec![soup(&mut random, 200, 0.3), ball(&mut random, 1e-6)];
    for scale in [1e-6, 1e6] {
        let mut mesh = random_mesh(&mut random, 100, 0.3);
        mesh.positions.iter_mut().for_each(|p| *p *= scale);
        apart.push(LoweredShape::Triangles(mesh));
    }
    let twins = || soup(&mut Random::new(3), 40, 0.4);
    let one_place = vec![DVec3::ZERO, DVec3::X, DVec3::Y];
    let one_place = TriangleMesh {
        triangles: vec![[0, 1, 2]; 5000],
        ..mesh_of(one_place)
    };
    vec![
        ("nothing", vec![], 60),
        (
            "a mesh without triangles",
            vec![LoweredShape::Triangles(mesh_of(vec![]))],
            60,
        ),
        ("one triangle", vec![soup(&mut random, 1, 1.0)], 600),
        ("triangles and balls", mixed, 6000),
        ("a grid of axis-parallel faces", vec![grid(6)], 4000),
        ("the same grid twice", vec![grid(3), grid(3)], 3000),
        ("coincident meshes", vec![twins(), twins(), twins()], 3000),
        (
            "5000 times the same triangle",
            vec![LoweredShape::Triangles(one_place)],
            120,
        ),
        ("slivers", vec![slivers(&mut random, 300)], 6000),
        ("an unbounded wall", with_wall, 3000),
        ("elements of very different sizes", apart, 3000),
        ("a large random mesh", vec![soup(&mut random, 20_000, 0.03)], 240),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;
    use whitstone_core::{Element, Statistics};

    /// Tests every element, correctly or with a deliberate fault.
    struct Faulty {
        geometry: Arc<Geometry>,
        elements: Vec<Element>,
        fault: Fault,
    }

    #[derive(Clone, Copy, Debug, PartialEq)]
    enum Fault {
        None,
        LastWinsTies,
        ForgetsOne,
        ForgetsWhatIsEndless,
        ForgetsSkip,
        ForgetsMin,
        ClosedInterval,
        ShadowsIgnoreMax,
        MissesFlatBoxes,
        RefitsNothing,
    }

    impl Faulty {
        fn hits(
            &self,
            ray: &Ray,
            interval: Interval,
            skip: SelfHitFilter,
        ) -> impl Iterator<Item = PreliminaryIntersection> {
            let sheared = ShearedRay::new(ray);
            self.elements.iter().filter_map(move |&element| {
                let bounds = self.geometry.bounds(element);
                match self.fault {
                    Fault::ForgetsWhatIsEndless if !bounds.is_finite() => return None,
                    Fault::MissesFlatBoxes => {
                        let (a, b) = (
                            (bounds.min - ray.origin) / ray.direction,
                            (bounds.max - ray.origin) / ray.direction,
                        );
                        let near = a.min(b).max_element();
                        let far = a.max(b).min_element();
                        if !near.is_nan() && near > far {
                            return None;
                        }
                    }
                    _ => {}
                }
                self.geometry.intersect(element, ray, &sheared, interval, skip)
            })
        }
    }

    impl Accelerator for Faulty {
        fn intersect(
            &self,
            ray: &Ray,
            mut interval: Interval,
            mut skip: SelfHitFilter,
        ) -> Option<PreliminaryIntersection> {
            match self.fault {
                Fault::ForgetsSkip => skip = SelfHitFilter::NOTHING,
                Fault::ForgetsMin => interval.min = 0.0,
                Fault::ClosedInterval => interval.max = interval.max.next_up(),
                _ => {}
            }
            let last = self.fault == Fault::LastWinsTies;
            let beats = |a: &PreliminaryIntersection, b: &PreliminaryIntersection| {
                a.is_nearer_than(b) || (last && a.t == b.t)
            };
            self.hits(ray, interval, skip)
                .reduce(|best, hit| if beats(&hit, &best) { hit } else { best })
        }

        fn occluded(&self, ray: &Ray, mut interval: Interval, skip: SelfHitFilter) -> bool {
            if self.fault == Fault::ShadowsIgnoreMax {
                interval.max = f64::INFINITY;
            }
            self.hits(ray, interval, skip).next().is_some()
        }

        fn refitted(
            &self,
            geometry: &Arc<Geometry>,
            _rigid: Option<&DAffine3>,
        ) -> Option<Box<dyn Accelerator>> {
            let geometry = match self.fault {
                Fault::RefitsNothing => &self.geometry,
                _ => geometry,
            };
            Some(Box::new(Self {
                geometry: geometry.clone(),
                elements: self.elements.clone(),
                fault: self.fault,
            }))
        }

        fn statistics(&self) -> Statistics {
            Statistics::default()
        }
    }

    fn verdict(fault: Fault) -> Result<(), Broken> {
        let build = |geometry: Arc<Geometry>| {
            let mut elements: Vec<Element> = geometry.elements().collect();
            if fault == Fault::ForgetsOne && elements.len() > 100 {
                elements.pop();
            }
            Box::new(Faulty {
                geometry,
                elements,
                fault,
            }) as Box<dyn Accelerator>
        };
        first_broken(build, 8)
    }

    #[test]
    fn testing_every_element_passes() {
        assert_eq!(verdict(Fault::None), Ok(()));
    }

    #[test]
    fn every_fault_is_found() {
        for fault in [
            Fault::LastWinsTies,
            Fault::ForgetsOne,
            Fault::ForgetsWhatIsEndless,
            Fault::ForgetsSkip,
            Fault::ForgetsMin,
            Fault::ClosedInterval,
            Fault::ShadowsIgnoreMax,
            Fault::MissesFlatBoxes,
            Fault::RefitsNothing,
        ] {
            assert!(verdict(fault).is_err(), "{fault:?}");
        }
    }
}
