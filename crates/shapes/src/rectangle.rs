//! A rectangle; a shearing transform makes it a parallelogram.
//!
//! - Twin: Mitsuba `rectangle` (native).
//! - Example: `scenes/shapes/rectangle.toml`.

use crate::frame::{Frame, flat_hit};
use schemars::JsonSchema;
use serde::Deserialize;
use whitstone_core::{
    Aabb, Context, DVec3, Needs, Plugin, PrimitiveHit, RawHit, Ray, SceneErrors, Shape, Shapes, Straight,
    SurfacePart, SurfacePoint, Transform,
};

/// The square -1 <= x, y <= 1 in the plane z = 0 of its object space; its normal is +z.
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

    fn build(_: Config, transform: Transform, _: &mut dyn Context) -> Result<Shape, SceneErrors> {
        let frame = Frame::new(transform);
        Ok(Shape::Opaque(Box::new(Self { frame })))
    }
}

impl Straight for Rectangle {
    fn bounds(&self) -> Aabb {
        self.frame.bounds(DVec3::new(1.0, 1.0, 0.0))
    }

    #[inline(always)]
    fn comes_near(&self, ray: &Ray) -> bool {
        self.frame.approaches(ray)
    }

    #[inline(always)]
    fn hit(&self, ray: &Ray, min: f64, leaves: u32) -> PrimitiveHit {
        let (t, params) = self.frame.meet_plane(ray);
        let inside = (params.x.abs() <= 1.0) & (params.y.abs() <= 1.0);
        flat_hit(t, params, inside, min, leaves)
    }

    #[inline(always)]
    fn surface(&self, _: &Ray, hit: &RawHit, needs: Needs) -> SurfacePoint {
        let (position, error) = self.frame.point(hit.params.extend(0.0), 2);
        let mut point = SurfacePoint::new(position, error, self.frame.normal(2));
        if needs.contains(Needs::UV) {
            point.uv = 0.5 * (hit.params + 1.0);
        }
        point
    }

    fn parts(&self) -> Vec<SurfacePart> {
        let corners = [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]];
        let corners = corners.map(|[x, y]| DVec3::new(x, y, 0.0));
        vec![self.frame.face(2, 1.0, corners)]
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
        let Shape::Opaque(square) = build::<Shapes, Rectangle>("", Transform::IDENTITY).unwrap() else {
            unreachable!()
        };
        let down = |x, y| Ray::new(DVec3::new(x, y, 1.0), DVec3::NEG_Z);
        assert!(
            square
                .closest(&down(1.0, -1.0), Interval::FORWARD, None)
                .is_some()
        );
        assert!(
            square
                .closest(&down(1.0f64.next_up(), 0.0), Interval::FORWARD, None)
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
