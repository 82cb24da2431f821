//! A flat disk.
//!
//! - Twin: Mitsuba `disk` (native).
//! - Example: `scenes/shapes/disk.toml`.

use crate::support::frame::{Frame, flat_hit};
use crate::support::near::goes_on;
use schemars::JsonSchema;
use serde::Deserialize;
use std::f64::consts::TAU;
use whitstone_core::{
    Aabb, Context, DVec2, DVec3, LoweredShape, Plugin, PreliminaryIntersection, Ray, SceneError, SceneErrors,
    ShapeHit, ShapeKernel, Shapes, SurfaceAttributes, SurfaceInteraction, SurfacePart, Transform,
};

/// The disk x² + y² <= 1 in the plane z = 0 of its object space; its normal is +z.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Config {}

/// The disk in world space.
#[derive(Clone)]
pub struct Disk {
    frame: Frame,
}

impl Plugin<Shapes> for Disk {
    const TYPE: &'static str = "disk";
    type Config = Config;

    fn build(_: Config, transform: Transform, _: &mut dyn Context) -> Result<LoweredShape, SceneErrors> {
        let m = transform.world_from_object().matrix3;
        let (x, y) = (m.x_axis.length(), m.y_axis.length());
        let round = (x - y).abs() <= 1e-9 * x && m.x_axis.dot(m.y_axis).abs() <= 1e-9 * x * y;
        if !round {
            return Err(
                SceneError::anywhere("the transform of a disk must keep it circular")
                    .with_help("scale equally in x and y, and do not shear x against y")
                    .into(),
            );
        }
        let frame = Frame::new(transform);
        Ok(LoweredShape::Custom(Box::new(Self { frame })))
    }
}

impl ShapeKernel for Disk {
    fn bounds(&self) -> Aabb {
        let [x, y, _] = self.frame.columns(DVec3::ONE);
        // Along each world axis the disk extends by sqrt(x² + y²). This is exact if x or y is zero;
        // otherwise it is enlarged by the rounding error of the squares, the sum and the root.
        let reach = |x: f64, y: f64| match (x, y) {
            (0.0, other) | (other, 0.0) => other.abs(),
            _ => libm::hypot(x, y) * (1.0 + 2.0 * f64::EPSILON),
        };
        self.frame.around([0, 1, 2].map(|i| reach(x[i], y[i])))
    }

    #[inline(always)]
    fn may_hit(&self, ray: &Ray) -> bool {
        self.frame.approaches(ray)
    }

    #[inline(always)]
    fn hit(&self, ray: &Ray, min: f64, origin_primitive: u32) -> ShapeHit {
        let (t, prim_uv) = self.frame.meet_plane(ray);
        let inside = prim_uv.length_squared() <= 1.0;
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
            let phi = libm::atan2(hit.prim_uv.y, hit.prim_uv.x);
            let phi = if phi < 0.0 { phi + TAU } else { phi };
            point.uv = DVec2::new(hit.prim_uv.length(), phi / TAU);
        }
        point
    }

    fn parts(&self) -> Vec<SurfacePart> {
        vec![self.frame.round_face(1.0, 0.0, 1.0)]
    }

    fn surface_at_offset(
        &self,
        point: &SurfaceInteraction,
        hit: &PreliminaryIntersection,
        q: DVec3,
        needs: SurfaceAttributes,
    ) -> Option<SurfaceInteraction> {
        let prim_uv = self.frame.point_to_object(q).truncate();
        let there = PreliminaryIntersection { prim_uv, ..*hit };
        let there = ShapeKernel::surface(self, &Ray::new(q, self.frame.normal(2)), &there, needs);
        Some(goes_on(there, point))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use whitstone_core::{DAffine3, DMat3};
    use whitstone_testkit::{TestContext, shape_laws_everywhere};

    #[test]
    fn obeys_the_laws_of_shapes() {
        shape_laws_everywhere::<Disk>("", 2_000);
    }

    #[test]
    fn a_transform_that_makes_an_ellipse_is_refused() {
        let build = |m| {
            let transform = Transform::new(DAffine3::from_mat3(m)).unwrap();
            Disk::build(Config {}, transform, &mut TestContext::default())
        };
        assert!(build(DMat3::from_diagonal(DVec3::new(2.0, 3.0, 1.0))).is_err());
        assert!(build(DMat3::from_cols(DVec3::X, DVec3::new(0.6, 0.8, 0.0), DVec3::Z)).is_err());
        assert!(build(DMat3::from_diagonal(DVec3::new(2.0, -2.0, 5.0))).is_ok());
    }
}
