//! An infinite plane.
//!
//! The ray is transformed to object space, where the plane is z = 0: one subtraction and one
//! division.
//!
//! - Twin: Mitsuba `disk` of radius 1e7, textured by position (native): a rectangle of that size is
//!   a mesh there and loses rows at the horizon.
//! - Example: `scenes/shapes/plane.toml`.

use crate::frame::{Frame, flat_hit};
use schemars::JsonSchema;
use serde::Deserialize;
use whitstone_core::{
    Aabb, Context, DVec3, Needs, Plugin, PrimitiveHit, RawHit, Ray, SceneError, SceneErrors, Shape, Shapes,
    Spans, Straight, SurfacePart, SurfacePoint, Transform, solid,
};

/// The infinite plane z = 0 of its object space; its normal is +z.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Config {}

/// The plane in world space.
#[derive(Clone)]
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

impl Straight for Plane {
    fn bounds(&self) -> Aabb {
        Aabb::EVERYTHING
    }

    #[inline(always)]
    fn comes_near(&self, ray: &Ray) -> bool {
        self.frame.approaches(ray)
    }

    #[inline(always)]
    fn hit(&self, ray: &Ray, min: f64, leaves: u32) -> PrimitiveHit {
        let (t, params) = self.frame.meet_plane(ray);
        let inside = (params.x.abs() < f64::INFINITY) & (params.y.abs() < f64::INFINITY);
        flat_hit(t, params, inside, min, leaves)
    }

    #[inline(always)]
    fn surface(&self, _: &Ray, hit: &RawHit, needs: Needs) -> SurfacePoint {
        let (position, error) = self.frame.point(hit.params.extend(0.0), 2);
        let mut point = SurfacePoint::new(position, error, self.frame.normal(2));
        if needs.contains(Needs::UV) {
            point.uv = hit.params;
        }
        point
    }

    fn beside(&self, _: &SurfacePoint, hit: &RawHit, q: DVec3, needs: Needs) -> Option<SurfacePoint> {
        let params = self.frame.point_to_object(q).truncate();
        let there = RawHit { params, ..*hit };
        Some(Straight::surface(
            self,
            &Ray::new(q, self.frame.normal(2)),
            &there,
            needs,
        ))
    }

    fn parts(&self) -> Vec<SurfacePart> {
        vec![SurfacePart::Plane {
            point: self.frame.point(DVec3::ZERO, 2).0,
            normal: self.frame.normal(2),
        }]
    }

    /// As a CSG operand, the plane is the half-space below it.
    fn solid(&self) -> bool {
        true
    }

    fn spans(&self, ray: &Ray, spans: &mut Spans) {
        let (t, params) = self.frame.meet_plane(ray);
        let [from, to] = [f64::NEG_INFINITY, f64::INFINITY].map(PrimitiveHit::plain);
        let crossing = PrimitiveHit {
            t,
            primitive: 0,
            params,
        };
        let object = self.frame.ray_to_object(ray);
        let (height, slope) = (object.origin.z, object.direction.z);
        // A parallel or nearly parallel line has no finite crossing: it lies inside or outside as a
        // whole.
        if !(t.is_finite() && params.is_finite()) {
            if height < 0.0 {
                solid::push(spans, from, to);
            }
        } else if slope < 0.0 {
            solid::push(spans, crossing, to);
        } else {
            solid::push(spans, from, crossing);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use whitstone_core::Interval;
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
