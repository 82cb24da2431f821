//! An infinite plane.
//!
//! The ray is transformed to object space, where the plane is z = 0: one subtraction and one
//! division.
//!
//! - Twin: Mitsuba `disk` of radius 1e12, textured by position (native): a rectangle of that size
//!   is a mesh there and misses rows of pixels near the horizon.
//! - Example: `scenes/shapes/plane.toml`.

use crate::support::frame::{Frame, flat_hit};
use schemars::JsonSchema;
use serde::Deserialize;
use whitstone_core::{
    Aabb, Context, DVec3, LoweredShape, Plugin, PreliminaryIntersection, Ray, SceneError, SceneErrors,
    ShapeHit, ShapeKernel, Shapes, Spans, SurfaceAttributes, SurfaceInteraction, SurfacePart, Transform,
    solid,
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

    fn build(_: Config, transform: Transform, _: &mut dyn Context) -> Result<LoweredShape, SceneErrors> {
        transform.similarity_scale().ok_or_else(|| {
            SceneError::anywhere("the transform of a plane must scale equally in all directions")
        })?;
        let frame = Frame::new(transform);
        Ok(LoweredShape::Custom(Box::new(Self { frame })))
    }
}

impl ShapeKernel for Plane {
    const VECTOR_UV: bool = true;

    fn bounds(&self) -> Aabb {
        Aabb::EVERYTHING
    }

    #[inline(always)]
    fn may_hit(&self, ray: &Ray) -> bool {
        self.frame.approaches(ray)
    }

    #[inline(always)]
    fn hit(&self, ray: &Ray, min: f64, origin_primitive: u32) -> ShapeHit {
        let (t, prim_uv) = self.frame.meet_plane(ray);
        let inside = (prim_uv.x.abs() < f64::INFINITY) & (prim_uv.y.abs() < f64::INFINITY);
        flat_hit(t, prim_uv, inside, min, origin_primitive)
    }

    #[inline(always)]
    fn surface(
        &self,
        _: &Ray,
        hit: &PreliminaryIntersection,
        needs: SurfaceAttributes,
    ) -> SurfaceInteraction {
        let (position, error) = self.frame.point(hit.prim_uv.extend(0.0), 2);
        let mut point = SurfaceInteraction::new(position, error, self.frame.normal(2));
        if needs.contains(SurfaceAttributes::UV) {
            point.uv = hit.prim_uv;
        }
        point
    }

    fn surface_at_offset(
        &self,
        _: &SurfaceInteraction,
        hit: &PreliminaryIntersection,
        q: DVec3,
        needs: SurfaceAttributes,
    ) -> Option<SurfaceInteraction> {
        let prim_uv = self.frame.point_to_object(q).truncate();
        let there = PreliminaryIntersection { prim_uv, ..*hit };
        Some(ShapeKernel::surface(
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
    fn is_solid(&self) -> bool {
        true
    }

    fn spans(&self, ray: &Ray, spans: &mut Spans) {
        let (t, prim_uv) = self.frame.meet_plane(ray);
        let [from, to] = [f64::NEG_INFINITY, f64::INFINITY].map(ShapeHit::plain);
        let crossing = ShapeHit {
            t,
            primitive: 0,
            prim_uv,
        };
        let object = self.frame.ray_to_object(ray);
        let (height, slope) = (object.origin.z, object.direction.z);
        // A parallel or nearly parallel line has no finite crossing: it lies inside or outside as a
        // whole.
        if !(t.is_finite() && prim_uv.is_finite()) {
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
        let LoweredShape::Custom(plane) = plane else {
            unreachable!()
        };
        let ray = Ray::new(DVec3::new(3.0, -4.0, 2.0), DVec3::NEG_Z);
        let hit = plane.intersect(&ray, Interval::FORWARD, None).unwrap();
        assert_eq!((hit.t, hit.prim_uv.to_array()), (2.0, [3.0, -4.0]));
        assert_eq!(plane.intersect(&ray, Interval::FORWARD, Some(0)), None);
        let parallel = Ray::new(DVec3::ZERO, DVec3::X);
        assert_eq!(plane.intersect(&parallel, Interval::FORWARD, None), None);
    }
}
