//! A rectangle; a shearing transform makes it a parallelogram.
//!
//! - Twin: Mitsuba `rectangle` (native).
//! - Example: `scenes/shapes/rectangle.toml`.

use crate::support::frame::{Frame, flat_hit};
use schemars::JsonSchema;
use serde::Deserialize;
use whitstone_core::{
    Aabb, Context, DVec3, LoweredShape, Plugin, PreliminaryIntersection, Ray, SceneErrors, ShapeHit,
    ShapeKernel, Shapes, SurfaceAttributes, SurfaceInteraction, SurfacePart, Transform,
};

/// The square -1 <= x, y <= 1 in the plane z = 0 of its object space; its normal is +z.
///
/// The texture coordinates are ((x + 1)/2, (y + 1)/2).
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Config {}

/// The rectangle in world space.
#[derive(Clone)]
pub struct Rectangle {
    frame: Frame,
}

impl Plugin<Shapes> for Rectangle {
    const TYPE: &'static str = "rectangle";
    type Config = Config;

    fn build(_: Config, transform: Transform, _: &mut dyn Context) -> Result<LoweredShape, SceneErrors> {
        let frame = Frame::new(transform);
        Ok(LoweredShape::Custom(Box::new(Self { frame })))
    }
}

impl ShapeKernel for Rectangle {
    const VECTOR_UV: bool = true;

    fn bounds(&self) -> Aabb {
        self.frame.bounds(DVec3::new(1.0, 1.0, 0.0))
    }

    #[inline(always)]
    fn may_hit(&self, ray: &Ray) -> bool {
        self.frame.approaches(ray)
    }

    #[inline(always)]
    fn hit(&self, ray: &Ray, min: f64, origin_primitive: u32) -> ShapeHit {
        let (t, prim_uv) = self.frame.meet_plane(ray);
        let inside = (prim_uv.x.abs() <= 1.0) & (prim_uv.y.abs() <= 1.0);
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
            point.uv = 0.5 * (hit.prim_uv + 1.0);
        }
        point
    }

    fn parts(&self) -> Vec<SurfacePart> {
        let corners = [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]];
        let corners = corners.map(|[x, y]| DVec3::new(x, y, 0.0));
        vec![self.frame.face(2, 1.0, corners)]
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
}

#[cfg(test)]
mod tests {
    use super::*;
    use whitstone_core::Interval;
    use whitstone_testkit::{build, shape_laws_everywhere};

    #[test]
    fn obeys_the_laws_of_shapes() {
        shape_laws_everywhere::<Rectangle>("", 2_000);
    }

    #[test]
    fn the_border_belongs_to_it_and_bounds_are_exact() {
        let LoweredShape::Custom(square) = build::<Shapes, Rectangle>("", Transform::IDENTITY).unwrap()
        else {
            unreachable!()
        };
        let down = |x, y| Ray::new(DVec3::new(x, y, 1.0), DVec3::NEG_Z);
        assert!(
            square
                .intersect(&down(1.0, -1.0), Interval::FORWARD, None)
                .is_some()
        );
        assert!(
            square
                .intersect(&down(1.0f64.next_up(), 0.0), Interval::FORWARD, None)
                .is_none()
        );
        let corner = DVec3::new(1.0, 1.0, 0.0);
        assert_eq!(
            square.bounds(),
            Aabb {
                min: -corner,
                max: corner
            }
        );
    }
}
