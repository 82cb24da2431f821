//! An instance of a group of shapes.
//!
//! Rays are transformed to the group's space, not the shapes to world space (lecture notes: "ray
//! transformation instead of object transformation"). Directions are not normalised, so distances
//! need no conversion. Bounds and errors: `docs/accelerators.md` and Pharr, Jakob, Humphreys,
//! *Physically Based Rendering* (4th ed.), 6.8.6.
//!
//! - Twin: Mitsuba shapes (native), placed one by one by the product of all transforms.
//! - Example: `scenes/shapes/instance.toml`.

use schemars::JsonSchema;
use serde::Deserialize;
use std::collections::BTreeMap;
use whitstone_core::config::GroupRef;
use whitstone_core::{Context, Instance, LoweredShape, MaterialRef, Plugin, SceneErrors, Shapes, Transform};

/// An instance of a group of shapes.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// The id of the group, as in `[group.ID]`.
    group: GroupRef,
    /// Replacements of materials in this instance: each key is the id of a shared material, each
    /// value the material that is used instead of it.
    #[serde(default)]
    #[expect(dead_code, reason = "declares the key, which the plan of a scene reads")]
    materials: BTreeMap<String, MaterialRef>,
}

/// Lowers to an [`Instance`], which accelerators support.
pub struct Placed;

impl Plugin<Shapes> for Placed {
    const TYPE: &'static str = "instance";
    type Config = Config;

    fn build(
        config: Config,
        transform: Transform,
        context: &mut dyn Context,
    ) -> Result<LoweredShape, SceneErrors> {
        let group = context.group(&config.group)?;
        Ok(LoweredShape::Instance(Box::new(Instance::new(group, transform))))
    }
}

#[cfg(all(test, feature = "all"))]
mod tests {
    use super::*;
    use crate::{
        cuboid::Cuboid, disk::Disk, heightfield::Heightfield, plane::Plane, sphere::Sphere,
        triangle::Triangle,
    };
    use std::sync::Arc;
    use whitstone_core::{
        Accelerator, DAffine3, DMat3, DVec3, Geometry, Group, Interval, PreliminaryIntersection, Ray,
        SelfHitFilter, SurfaceAttributes, SurfaceInteraction,
    };
    use whitstone_testkit::{Naive, Random, TestContext, build, build_in, placements, shape_laws};

    fn group(shapes: Vec<LoweredShape>) -> Arc<Group> {
        let geometry = Arc::new(Geometry::new(shapes));
        Arc::new(Group::new(geometry.clone(), Box::new(Naive::new(geometry)), 1))
    }

    fn place(group: &Arc<Group>, transform: Transform) -> LoweredShape {
        let mut context = TestContext::default();
        context.groups.insert("it".to_owned(), group.clone());
        build_in::<Shapes, Placed>("group = \"it\"", transform, &mut context).unwrap()
    }

    fn one<P: Plugin<Shapes>>(text: &str) -> Vec<LoweredShape> {
        let turn = DMat3::from_axis_angle(DVec3::new(0.3, -1.0, 0.4).normalize(), 2.0);
        let transform = DAffine3::from_mat3_translation(0.9 * turn, DVec3::new(0.2, -0.3, 0.1));
        vec![build::<Shapes, P>(text, Transform::new(transform).unwrap()).unwrap()]
    }

    #[test]
    fn obeys_the_laws_of_shapes() {
        let triangles = [-0.8, 0.0, 0.8].map(|z| {
            let corners = format!(
                "vertices = [[-2, -2, {z}], [2, -2, {z}], [0, 3, {}]]\nnormals = [[0, 0, 1], [0, 1, 1], [1, 0, 1]]",
                z + 0.1
            );
            one::<Triangle>(&corners)
        });
        for (kind, shapes) in [
            ("sphere", one::<Sphere>("")),
            ("box", one::<Cuboid>("")),
            ("disk", one::<Disk>("")),
            ("plane", one::<Plane>("")),
            ("triangles", triangles.into_iter().flatten().collect()),
        ] {
            let group = group(shapes);
            for (name, transform) in placements() {
                eprintln!("{kind}, {name}");
                shape_laws(place(&group, transform), 2_000);
                // Nested instances. Distant tiny shapes lose their digits, and rotated thin shapes
                // are seldom hit.
                if !["tiny", "thin", "stretched"].contains(&name) {
                    let inner = self::group(vec![place(&group, transform)]);
                    shape_laws(place(&inner, placements()[1].1), 500);
                }
            }
        }
    }

    fn nearest(
        shape: LoweredShape,
        rays: &[(Ray, SelfHitFilter)],
    ) -> Vec<Option<(PreliminaryIntersection, SurfaceInteraction)>> {
        let geometry = Arc::new(Geometry::new(vec![shape]));
        let all = Naive::new(geometry.clone());
        let one = |(ray, skip): &(Ray, SelfHitFilter)| {
            let hit = all.intersect(ray, Interval::FORWARD, *skip)?;
            Some((hit, geometry.surface(ray, &hit, SurfaceAttributes::NOTHING)))
        };
        rays.iter().map(one).collect()
    }

    /// The faces of the box coincide with those of its bounds, so bounds that are too tight cause
    /// misses.
    #[test]
    fn a_copy_is_hit_where_the_shape_itself_would_be() {
        let mut random = Random::new(5);
        let cube = group(vec![build::<Shapes, Cuboid>("", Transform::IDENTITY).unwrap()]);
        let askew = DMat3::from_cols(DVec3::X, DVec3::new(3e4, 1.0, 0.0), DVec3::Z);
        let askew = Transform::new(DAffine3::from_mat3(askew)).unwrap();
        for (name, transform) in placements().into_iter().chain([("askew", askew)]) {
            let itself = build::<Shapes, Cuboid>("", transform).unwrap();
            let rays: Vec<(Ray, SelfHitFilter)> = (0..4000)
                .map(|i| {
                    let mut target = 0.99 * random.cube();
                    target[i % 3] = 1f64.copysign(random.signed());
                    let origin = [1.5, 4.0, 200.0][i % 3] * random.direction() + target;
                    let [target, origin] = [target, origin].map(|p| transform.point_to_world(p));
                    (Ray::new(origin, target - origin), SelfHitFilter::NOTHING)
                })
                .collect();
            let pairs = nearest(itself, &rays)
                .into_iter()
                .zip(nearest(place(&cube, transform), &rays));
            for ((itself, copy), (ray, _)) in pairs.zip(&rays) {
                let ((a, at), (b, bt)) = match (itself, copy) {
                    (None, None) => continue,
                    (Some(a), Some(b)) => ((a.0, a.1.position), (b.0, b.1.position)),
                    _ => panic!("{name}: {ray:?}: {itself:?} and {copy:?}"),
                };
                let (size, far) = (ray.direction.length(), at.distance(bt));
                assert!(
                    (a.t - b.t).abs() < 1e-9 && far < 1e-9 * size,
                    "{name}: {ray:?}: {a:?} and {b:?}"
                );
            }
        }
    }

    /// Rays are spawned on one of two coplanar triangles at an angle so flat that they would hit
    /// the other one if rounding put their origin below the plane.
    #[test]
    fn rays_that_leave_a_copy_clear_what_lies_beside() {
        let mut random = Random::new(6);
        let text = "columns = 1\nrows = 1\namplitude = 0";
        let square = group(vec![
            build::<Shapes, Heightfield>(text, Transform::IDENTITY).unwrap(),
        ]);
        for (name, transform) in placements() {
            let shape = || place(&square, transform);
            let rays: Vec<(Ray, SelfHitFilter)> = (0..4000)
                .map(|i| {
                    let along = 0.9 * random.signed();
                    let beside = random.signed() * 10f64.powi(-(7 + i % 8));
                    let target = transform.point_to_world(DVec3::new(along + beside, along - beside, 0.0));
                    let origin = transform.point_to_world(DVec3::new(random.signed(), random.signed(), 1.0));
                    (Ray::new(origin, target - origin), SelfHitFilter::NOTHING)
                })
                .collect();
            let hits = nearest(shape(), &rays);
            let leaving: Vec<(Ray, SelfHitFilter)> = hits
                .into_iter()
                .flatten()
                .flat_map(|(hit, point)| {
                    let side = point.n_g.cross(random.direction()).normalize();
                    [1e-2, 1e-4, 1e-6].map(|slope| {
                        let d = side + slope * point.n_g;
                        (Ray::new(point.spawn_origin(d), d), SelfHitFilter::leaving(&hit))
                    })
                })
                .collect();
            assert!(leaving.len() > 6000, "{name}: {}", leaving.len());
            for (found, (ray, _)) in nearest(shape(), &leaving).into_iter().zip(&leaving) {
                assert!(found.is_none(), "{name}: {ray:?} meets {found:?}");
            }
        }
    }

    #[test]
    fn a_group_that_is_not_there_is_told_at_its_name() {
        let error = build::<Shapes, Placed>("group = \"bush\"", Transform::IDENTITY)
            .err()
            .unwrap()
            .0
            .remove(0);
        assert_eq!(error.message, "no group has the id \"bush\"");
        assert_eq!(error.span, Some(8..14));
    }
}
