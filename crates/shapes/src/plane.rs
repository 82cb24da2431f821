//! An endless plane.
//!
//! The ray is taken into object space, where the plane is z = 0: one subtraction and one division.
//!
//! - Twin: Mitsuba `disk` of radius 1e7, textured by position (native): a rectangle of that size is a mesh
//!   there and loses rows at the horizon.
//! - Example: `scenes/shapes/plane.toml`.

use crate::frame::Frame;
use schemars::JsonSchema;
use serde::Deserialize;
use whitstone_core::{
    Aabb, Context, Interval, Needs, Plugin, Primitive, PrimitiveHit, RawHit, Ray, SceneError, SceneErrors,
    Shape, Shapes, SurfacePoint, Transform,
};

/// The endless plane z = 0 of its object space; the outside is +z.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Config {}

/// In world space.
pub struct Plane {
    frame: Frame,
}

impl Plugin<Shapes> for Plane {
    const TYPE: &'static str = "plane";
    type Config = Config;

    fn build(_: Config, transform: Transform, _: &mut dyn Context) -> Result<Shape, SceneErrors> {
        transform.similarity_scale().ok_or_else(|| {
            SceneError::anywhere("the transform of a plane must scale equally in all directions")
        })?;
        let frame = Frame::new(transform);
        Ok(Shape::Opaque(Box::new(Self { frame })))
    }
}

impl Primitive for Plane {
    fn bounds(&self) -> Aabb {
        Aabb::EVERYTHING
    }

    fn closest(&self, ray: &Ray, interval: Interval, leaves: Option<u32>) -> Option<PrimitiveHit> {
        if leaves.is_some() {
            return None;
        }
        let (t, params) = self.frame.meet_plane(ray, interval)?;
        let hit = params.is_finite();
        hit.then_some(PrimitiveHit {
            t,
            primitive: 0,
            params,
        })
    }

    fn surface(&self, _: &Ray, hit: &RawHit, needs: Needs) -> SurfacePoint {
        let (position, error) = self.frame.point(hit.params.extend(0.0), 2);
        let mut point = SurfacePoint::new(position, error, self.frame.normal(2));
        if needs.contains(Needs::UV) {
            point.uv = hit.params;
        }
        point
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use whitstone_core::DVec3;
    use whitstone_testkit::{build, shape_laws_everywhere};

    #[test]
    fn obeys_the_laws_of_shapes() {
        shape_laws_everywhere::<Plane>("", 2_000);
    }

    #[test]
    fn texture_coordinates_count_object_units() {
        let plane = build::<Shapes, Plane>("", Transform::IDENTITY).unwrap();
        let Shape::Opaque(plane) = plane else {
            unreachable!()
        };
        let ray = Ray::new(DVec3::new(3.0, -4.0, 2.0), DVec3::NEG_Z);
        let hit = plane.closest(&ray, Interval::FORWARD, None).unwrap();
        assert_eq!((hit.t, hit.params.to_array()), (2.0, [3.0, -4.0]));
        assert_eq!(plane.closest(&ray, Interval::FORWARD, Some(0)), None);
        let parallel = Ray::new(DVec3::ZERO, DVec3::X);
        assert_eq!(plane.closest(&parallel, Interval::FORWARD, None), None);
    }
}
