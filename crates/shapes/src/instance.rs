//! A copy of a group of shapes.
//!
//! Rays are taken into the group's space instead of the shapes into the world (lecture notes: "ray transformation
//! instead of object transformation"), with directions of any length, so that distances need no conversion. Bounds and
//! errors: `docs/accelerators.md` and Pharr, Jakob, Humphreys, *Physically Based Rendering* (4th ed.), 6.8.6.
//!
//! - Twin: Mitsuba shapes (native), placed one by one by the product of all transforms.
//! - Example: `scenes/shapes/instance.toml`.

use schemars::JsonSchema;
use serde::Deserialize;
use whitstone_core::config::GroupRef;
use whitstone_core::{Context, Instance, Plugin, SceneErrors, Shape, Shapes, Transform};

/// A copy of a group of shapes; they bring their materials with them.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// The id of the group, as in `[group.ID]`.
    group: GroupRef,
}

/// Becomes an [`Instance`], which accelerators know.
pub struct Placed;

impl Plugin<Shapes> for Placed {
    const TYPE: &'static str = "instance";
    type Config = Config;

    fn build(config: Config, transform: Transform, context: &mut dyn Context) -> Result<Shape, SceneErrors> {
        let group = context.group(&config.group)?;
        Ok(Shape::Instance(Box::new(Instance::new(group, transform))))
    }
}

#[cfg(all(test, feature = "all"))]
mod tests {
    use super::*;
    use crate::{cuboid::Cuboid, disk::Disk, plane::Plane, sphere::Sphere, triangle::Triangle};
    use std::sync::Arc;
    use whitstone_core::{DAffine3, DMat3, DVec3, Geometry, Group};
    use whitstone_testkit::{Naive, TestContext, build, build_in, placements, shape_laws};

    fn group(shapes: Vec<Shape>) -> Arc<Group> {
        let geometry = Arc::new(Geometry::new(shapes));
        Arc::new(Group::new(geometry.clone(), Box::new(Naive::new(geometry)), 1))
    }

    fn place(group: &Arc<Group>, transform: Transform) -> Shape {
        let mut context = TestContext::default();
        context.groups.insert("it".to_owned(), group.clone());
        build_in::<Shapes, Placed>("group = \"it\"", transform, &mut context).unwrap()
    }

    fn one<P: Plugin<Shapes>>(text: &str) -> Vec<Shape> {
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
                // Copies of copies; what is tiny loses its digits far away, what is thin is seldom hit when turned.
                if !["tiny", "thin", "stretched"].contains(&name) {
                    let inner = self::group(vec![place(&group, transform)]);
                    shape_laws(place(&inner, placements()[1].1), 500);
                }
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
