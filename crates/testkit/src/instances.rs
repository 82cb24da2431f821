//! Instances of groups of shapes, for the laws of accelerators.

use crate::random::Random;
use crate::test_shapes::{ball, slivers, soup};
use crate::{Wall, placements};
use std::sync::Arc;
use whitstone_core::stream::{HitStream, Lanes, RayStream};
use whitstone_core::triangle::ShearedRay;
use whitstone_core::{
    Accelerator, DAffine3, DMat3, DVec3, Geometry, Group, Instance, Interval, LoweredShape,
    PreliminaryIntersection, Ray, SelfHitFilter, Statistics, Transform,
};

/// Tests every element: correct by definition.
pub struct Naive {
    geometry: Arc<Geometry>,
}

impl Naive {
    /// Built over a geometry.
    pub fn new(geometry: Arc<Geometry>) -> Self {
        Self { geometry }
    }

    fn hits(
        &self,
        ray: &Ray,
        interval: Interval,
        skip: SelfHitFilter,
    ) -> impl Iterator<Item = PreliminaryIntersection> {
        let sheared = ShearedRay::new(ray);
        let elements = self.geometry.elements();
        elements.filter_map(move |element| self.geometry.intersect(element, ray, &sheared, interval, skip))
    }
}

impl Accelerator for Naive {
    fn intersect(
        &self,
        ray: &Ray,
        interval: Interval,
        skip: SelfHitFilter,
    ) -> Option<PreliminaryIntersection> {
        let hits = self.hits(ray, interval, skip);
        hits.reduce(|best, hit| if hit.is_nearer_than(&best) { hit } else { best })
    }

    fn occluded(&self, ray: &Ray, interval: Interval, skip: SelfHitFilter) -> bool {
        self.hits(ray, interval, skip).next().is_some()
    }

    /// Queries instances by stream, so that their stream methods are under test too.
    fn intersect_stream(&self, rays: &RayStream, hits: &mut HitStream) {
        hits.clear(rays);
        for (part, shape) in self.geometry.shapes().iter().zip(0..) {
            match part {
                LoweredShape::Triangles(mesh) => mesh.intersect_stream(shape, rays, hits),
                LoweredShape::Custom(primitive) => primitive.intersect_stream(shape, rays, hits),
                _ => {}
            }
        }
        for part in self.geometry.shapes() {
            if let LoweredShape::Instance(instance) = part {
                instance.intersect_stream(rays, hits);
            }
        }
    }

    fn occluded_stream(&self, rays: &RayStream, hidden: &mut Lanes<bool>) {
        hidden[..rays.len].fill(false);
        for (part, shape) in self.geometry.shapes().iter().zip(0..) {
            match part {
                LoweredShape::Triangles(mesh) => mesh.occluded_stream(shape, rays, hidden),
                LoweredShape::Custom(primitive) => primitive.occluded_stream(shape, rays, hidden),
                LoweredShape::Instance(instance) => instance.occluded_stream(rays, hidden),
                _ => {}
            }
        }
    }

    fn statistics(&self) -> Statistics {
        Statistics::default()
    }
}

/// Builds the accelerators over groups.
pub(crate) type Build<'a> = &'a dyn Fn(Arc<Geometry>) -> Box<dyn Accelerator>;

/// A group with the accelerator built over its shapes; `first_shape` is their first scene-wide
/// number.
fn group(build: Build<'_>, shapes: Vec<LoweredShape>, first_shape: u32) -> Arc<Group> {
    let geometry = Arc::new(Geometry::new(shapes));
    Arc::new(Group::new(geometry.clone(), build(geometry), first_shape))
}

fn instance(group: &Arc<Group>, transform: Transform) -> LoweredShape {
    LoweredShape::Instance(Box::new(Instance::new(group.clone(), transform)))
}

/// A random transform that rotates, scales, shears slightly and translates; every second one
/// mirrors.
fn anywhere(random: &mut Random, size: f64) -> Transform {
    let turn = || DMat3::from_axis_angle(DVec3::new(0.6, 0.0, 0.8), 1.0);
    let stretch = DVec3::new(size, -size, size) * (DVec3::ONE + 0.7 * random.cube());
    let shear = DMat3::from_cols(DVec3::X, DVec3::new(random.signed(), 1.0, 0.0), DVec3::Z);
    let matrix =
        DMat3::from_axis_angle(random.direction(), 3.0) * shear * DMat3::from_diagonal(stretch) * turn();
    Transform::new(DAffine3::from_mat3_translation(matrix, random.cube()))
        .expect("the transform is invertible")
}

pub(crate) type Shapes = fn(Build<'_>) -> Vec<LoweredShape>;

/// Geometries with instances of groups, each with its name and its number of rays. Each is built
/// twice: for the reference result and for the accelerator under test.
pub(crate) fn instance_geometries() -> [(&'static str, Shapes, u32); 6] {
    [
        (
            "instances anywhere, next to other shapes",
            |build| {
                let mut random = Random::new(11);
                let mut inside = vec![soup(&mut random, 150, 0.3)];
                inside.extend((0..6).map(|_| ball(&mut random, 1.0)));
                let group = group(build, inside, 16);
                let mut shapes = vec![soup(&mut random, 60, 0.3), ball(&mut random, 1.0)];
                shapes.extend((0..14).map(|_| instance(&group, anywhere(&mut random, 0.4))));
                shapes
            },
            400,
        ),
        (
            "instances that coincide with each other and with the same shapes outside groups",
            |build| {
                let inside = || vec![soup(&mut Random::new(3), 80, 0.4)];
                let group = group(build, inside(), 6);
                let mut shapes: Vec<LoweredShape> =
                    (0..3).map(|_| instance(&group, Transform::IDENTITY)).collect();
                shapes.extend(inside());
                shapes.extend((0..2).map(|_| instance(&group, Transform::IDENTITY)));
                shapes
            },
            400,
        ),
        (
            "nested instances",
            |build| {
                let mut random = Random::new(12);
                let leaf = group(build, vec![soup(&mut random, 60, 0.5), ball(&mut random, 1.0)], 5);
                let mut shapes: Vec<LoweredShape> = (0..4)
                    .map(|_| instance(&leaf, anywhere(&mut random, 0.5)))
                    .collect();
                shapes.insert(2, soup(&mut random, 20, 0.3));
                let branch = group(build, shapes, 7);
                (0..5)
                    .map(|i| instance([&branch, &leaf][i % 2], anywhere(&mut random, 0.6)))
                    .collect()
            },
            400,
        ),
        (
            "instances that are tiny, huge, far away, thin and sheared",
            |build| {
                let mut random = Random::new(13);
                let group = group(
                    build,
                    vec![soup(&mut random, 50, 0.5), ball(&mut random, 1.0)],
                    20,
                );
                let mut shapes: Vec<LoweredShape> = placements()
                    .into_iter()
                    .map(|(_, place)| instance(&group, place))
                    .collect();
                let askew = DMat3::from_cols(DVec3::X, DVec3::new(3e4, 1.0, 0.0), DVec3::Z);
                shapes
                    .extend(Transform::new(DAffine3::from_mat3(askew)).map(|askew| instance(&group, askew)));
                shapes
            },
            400,
        ),
        (
            "instances of an unbounded wall",
            |build| {
                let mut random = Random::new(14);
                let wall = Wall {
                    point: 0.1 * DVec3::Y,
                    normal: DVec3::Y,
                };
                let inside = vec![LoweredShape::Custom(Box::new(wall)), soup(&mut random, 40, 0.3)];
                let group = group(build, inside, 4);
                let mut shapes = vec![soup(&mut random, 40, 0.3)];
                shapes.extend((0..3).map(|_| instance(&group, anywhere(&mut random, 0.5))));
                shapes
            },
            300,
        ),
        (
            "instances of slivers and of an empty group",
            |build| {
                let mut random = Random::new(15);
                let thin = group(build, vec![slivers(&mut random, 120)], 8);
                let nothing = group(build, vec![], 9);
                let mut shapes = vec![instance(&nothing, Transform::IDENTITY)];
                shapes.extend((0..6).map(|_| instance(&thin, anywhere(&mut random, 0.7))));
                shapes
            },
            500,
        ),
    ]
}

/// Some triangles of instances, in the space of the geometry.
pub(crate) fn instance_triangles(geometry: &Geometry) -> Vec<[DVec3; 3]> {
    let mut corners = Vec::new();
    for shape in geometry.shapes() {
        let LoweredShape::Instance(instance) = shape else {
            continue;
        };
        let first = corners.len();
        let inside = instance.group().geometry();
        for shape in inside.shapes() {
            if let LoweredShape::Triangles(mesh) = shape {
                corners.extend((0..mesh.triangles.len().min(50) as u32).map(|i| mesh.corners(i)));
            }
        }
        let inner = instance_triangles(inside);
        let to_world = |p| instance.transform().point_to_world(p);
        corners.extend(inner);
        corners[first..]
            .iter_mut()
            .for_each(|triangle| *triangle = triangle.map(to_world));
    }
    corners
}
