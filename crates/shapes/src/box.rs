//! An axis-aligned cube in object space; its transform makes it any parallelepiped.
//!
//! Slab test of Kay and Kajiya (1986) in object space. The *sign bit* of the direction selects the
//! near and far faces, and comparisons ignore NaN (Ize, *Robust BVH ray traversal*, JCGT 2(2),
//! 2013). Rays that run within a face therefore give the same answer as neighbouring rays just
//! inside, for either sign of zero.
//!
//! - Twin: Mitsuba `cube` (native).
//! - Example: `scenes/shapes/box.toml`.

use crate::support::frame::Frame;
use crate::support::near::comes_near_ball;
use schemars::JsonSchema;
use serde::Deserialize;
use whitstone_core::simd::select;
use whitstone_core::{
    Aabb, Context, DVec2, DVec3, LoweredShape, NO_PRIMITIVE, Plugin, PreliminaryIntersection, Ray,
    SceneErrors, ShapeHit, ShapeKernel, Shapes, Spans, SurfaceAttributes, SurfaceInteraction, SurfacePart,
    Transform, solid,
};

/// The cube from -1 to 1 along each axis of its object space; its normals point outward.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Config {}

/// The box in world space.
#[derive(Clone)]
pub struct Cuboid {
    frame: Frame,
    /// Center and radius of a bounding sphere.
    center: DVec3,
    radius: f64,
    /// Half the extent in object space of the box that holds the origins of all spawned rays.
    reach: DVec3,
}

impl Plugin<Shapes> for Cuboid {
    const TYPE: &'static str = "box";
    type Config = Config;

    fn build(_: Config, transform: Transform, _: &mut dyn Context) -> Result<LoweredShape, SceneErrors> {
        let frame = Frame::new(transform);
        let reach = frame.reach_of_spawned_rays();
        let bounds = frame.bounds(reach);
        let center = bounds.center();
        // Upper bound on the rounding error of the center and the extent.
        let rounding = 4.0 * f64::EPSILON * center.abs().max_element();
        Ok(LoweredShape::Custom(Box::new(Self {
            center,
            radius: (0.5 + 1e-9) * bounds.extent().length() + rounding,
            reach,
            frame,
        })))
    }
}

/// An intersection of an object-space ray with the surface: ray parameter and face.
#[derive(Clone, Copy)]
struct Crossing {
    t: f64,
    face: u32,
}

/// Entry into and exit from the cube; the entry lies behind the exit if the ray misses.
#[inline(always)]
fn crossings(ray: &Ray) -> [Crossing; 2] {
    let mut entry = Crossing {
        t: f64::NEG_INFINITY,
        face: 0,
    };
    let mut exit = Crossing {
        t: f64::INFINITY,
        face: 0,
    };
    for axis in 0..3_u32 {
        let (o, d) = (ray.origin[axis as usize], ray.direction[axis as usize]);
        let downwards = d.is_sign_negative();
        let side = 1.0_f64.copysign(d);
        let (near, far) = ((-side - o) / d, (side - o) / d);
        // 0/0 is NaN and has no effect: the origin lies in that face. The strict comparison keeps
        // the lowest face number if several faces are crossed at once.
        let later = near > entry.t;
        entry.t = select(later, near, entry.t);
        entry.face = select(later, 2 * axis + u32::from(downwards), entry.face);
        let sooner = far < exit.t;
        exit.t = select(sooner, far, exit.t);
        exit.face = select(sooner, 2 * axis + u32::from(!downwards), exit.face);
    }
    [entry, exit]
}

/// Converts a crossing to a hit whose parameters are the coordinates on the face.
#[inline(always)]
fn hit_at(ray: &Ray, crossing: Crossing) -> ShapeHit {
    let Crossing { t, face } = crossing;
    let across = turned(ray.at(t), face >> 1);
    ShapeHit {
        t,
        primitive: face,
        prim_uv: DVec2::new(across.y.clamp(-1.0, 1.0), across.z.clamp(-1.0, 1.0)),
    }
}

/// Sign of the outward normal of a face along its axis.
#[inline(always)]
fn side(face: u32) -> f64 {
    select(face & 1 == 0, -1.0, 1.0)
}

/// The coordinates of `p` along axes a, a+1 and a+2 (modulo 3).
#[inline(always)]
fn turned(p: DVec3, axis: u32) -> DVec3 {
    let pick = |x, y, z| select(axis == 0, x, select(axis == 1, y, z));
    DVec3::new(pick(p.x, p.y, p.z), pick(p.y, p.z, p.x), pick(p.z, p.x, p.y))
}

impl ShapeKernel for Cuboid {
    const VECTOR_UV: bool = true;

    /// They hold the origins of all rays spawned on the box, so that it is also tested for those
    /// that start just beyond their exit.
    fn bounds(&self) -> Aabb {
        self.frame.bounds(self.reach)
    }

    #[inline(always)]
    fn may_hit(&self, ray: &Ray) -> bool {
        comes_near_ball(ray, self.center, self.radius)
    }

    #[inline(always)]
    fn hit(&self, ray: &Ray, min: f64, origin_primitive: u32) -> ShapeHit {
        let ray = self.frame.ray_to_object(ray);
        let [entry, exit] = crossings(&ray);
        let leaving = origin_primitive != NO_PRIMITIVE;
        // The box is convex: a ray spawned on a face hits nothing if it goes outward, and only the
        // exit if it goes inward. Unlike skipping the spawn face only, this is robust to rounding:
        // a spawn point on an edge may lie one ulp beyond the adjacent face.
        let outward = turned(ray.direction, origin_primitive >> 1).x * side(origin_primitive) >= 0.0;
        let never = outward | (exit.face == origin_primitive);
        // Rounding puts some of the spawned rays outside, where they may miss the box.
        let spawned = leaving & ray.origin.abs().cmple(self.reach).all();
        let meets = ((entry.t <= exit.t) | spawned) & !(leaving & never);
        // The ray touches an edge or a corner: the lowest face number wins. Of two opposite faces
        // of a very thin box, the ray meets the one that it enters by.
        let touched = (entry.t == exit.t) & (entry.face >> 1 != exit.face >> 1);
        let first_face = select(touched & (exit.face < entry.face), exit.face, entry.face);
        let enters = !leaving & (entry.t > min);
        // In a box thinner than rounding, or at an edge, a ray that goes inward may start beyond
        // its exit. It leaves there at once.
        let leaves = select(spawned & (exit.t <= 0.0), f64::MIN_POSITIVE, exit.t);
        let t = select(enters, entry.t, leaves);
        let face = select(enters, first_face, exit.face);
        ShapeHit {
            t: select(meets & (t > min), t, f64::NAN),
            ..hit_at(&ray, Crossing { t, face })
        }
    }

    #[inline(always)]
    fn surface(
        &self,
        _: &Ray,
        hit: &PreliminaryIntersection,
        needs: SurfaceAttributes,
    ) -> SurfaceInteraction {
        let (face, DVec2 { x: b, y: c }) = (hit.primitive, hit.prim_uv);
        let axis = face >> 1;
        // Inverse of the cyclic permutation of the axes.
        let p = turned(DVec3::new(side(face), b, c), (3 - axis) % 3);
        let (position, error) = self.frame.point(p, axis as usize);
        let mut point =
            SurfaceInteraction::new(position, error, side(face) * self.frame.normal(axis as usize));
        if needs.contains(SurfaceAttributes::UV) {
            point.uv = 0.5 * (hit.prim_uv + 1.0);
        }
        point
    }

    fn parts(&self) -> Vec<SurfacePart> {
        let faces = [0, 1, 2].into_iter().flat_map(|axis| [(axis, -1.0), (axis, 1.0)]);
        let face = |(axis, side): (usize, f64)| {
            let corners = [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]];
            let corner = |[u, v]: [f64; 2]| {
                let mut p = DVec3::ZERO;
                (p[axis], p[(axis + 1) % 3], p[(axis + 2) % 3]) = (side, u, v);
                p
            };
            self.frame.face(axis, side, corners.map(corner))
        };
        faces.map(face).collect()
    }

    fn surface_at_offset(
        &self,
        _: &SurfaceInteraction,
        hit: &PreliminaryIntersection,
        q: DVec3,
        needs: SurfaceAttributes,
    ) -> Option<SurfaceInteraction> {
        let p = turned(self.frame.point_to_object(q), hit.primitive >> 1);
        let prim_uv = DVec2::new(p.y, p.z);
        let there = PreliminaryIntersection { prim_uv, ..*hit };
        Some(ShapeKernel::surface(self, &Ray::new(q, p), &there, needs))
    }

    fn is_solid(&self) -> bool {
        true
    }

    fn spans(&self, ray: &Ray, spans: &mut Spans) {
        let ray = self.frame.ray_to_object(ray);
        let [enter, exit] = crossings(&ray).map(|crossing| hit_at(&ray, crossing));
        solid::push(spans, enter, exit);
    }

    fn primitives(&self) -> u32 {
        6
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use whitstone_core::{DAffine3, Interval, Shape};
    use whitstone_testkit::{build, shape_laws_everywhere};

    fn cube() -> Box<dyn Shape> {
        match build::<Shapes, Cuboid>("", Transform::IDENTITY).unwrap() {
            LoweredShape::Custom(cube) => cube,
            _ => unreachable!("a box is a custom shape"),
        }
    }

    fn intersect(origin: [f64; 3], direction: [f64; 3], origin_primitive: Option<u32>) -> Option<(f64, u32)> {
        let ray = Ray::new(origin.into(), direction.into());
        let hit = cube().intersect(&ray, Interval::FORWARD, origin_primitive)?;
        Some((hit.t, hit.primitive))
    }

    #[test]
    fn obeys_the_laws_of_shapes() {
        shape_laws_everywhere::<Cuboid>("", 2_000);
    }

    #[test]
    fn faces_are_numbered_and_bounds_are_tight() {
        for axis in 0..3 {
            for (face, sign) in [(2 * axis, -1.0), (2 * axis + 1, 1.0)] {
                let mut outward = DVec3::ZERO;
                outward[axis] = sign;
                let from_outside = intersect((3.0 * outward).into(), (-outward).into(), None);
                assert_eq!(from_outside, Some((2.0, face as u32)));
                assert_eq!(
                    intersect([0.0; 3], outward.into(), None),
                    Some((1.0, face as u32))
                );
            }
        }
        let Aabb { min, max } = cube().bounds();
        for (bound, exact) in [(-min, DVec3::ONE), (max, DVec3::ONE)] {
            let beyond = bound - exact;
            assert!(beyond.min_element() > 0.0 && beyond.max_element() < 16.0 * f64::EPSILON);
        }
    }

    #[test]
    fn rays_in_a_face_hit_with_either_zero() {
        for zero in [0.0, -0.0] {
            for x in [-1.0, 1.0] {
                assert_eq!(intersect([x, 0.0, 3.0], [zero, zero, -1.0], None), Some((2.0, 5)));
                assert_eq!(intersect([2.0 * x, 0.0, 3.0], [zero, zero, -1.0], None), None);
            }
        }
    }

    #[test]
    fn at_an_edge_the_lowest_face_wins() {
        assert_eq!(
            intersect([3.0, 3.0, 0.0], [-1.0, -1.0, 0.0], None),
            Some((2.0, 1))
        );
        // Touching an edge counts as a hit.
        assert_eq!(intersect([2.0, 0.0, 0.0], [-1.0, 1.0, 0.0], None), Some((1.0, 1)));
    }

    #[test]
    fn a_ray_that_goes_inward_leaves_again() {
        // At an edge.
        let beyond = 1.0f64.next_up();
        let now = f64::MIN_POSITIVE;
        assert_eq!(
            intersect([beyond, 0.0, 1.0], [0.5, 0.0, -1.0], Some(5)),
            Some((now, 1))
        );
        // In a pane that is thinner than the offset of spawned rays.
        for exponent in [30, 47, 51, 60, 100, 1000] {
            let half = 2f64.powi(-exponent);
            let scale = DAffine3::from_scale(DVec3::new(1.0, 1.0, half));
            let at = DAffine3::from_translation(DVec3::Z) * scale;
            let LoweredShape::Custom(pane) =
                build::<Shapes, Cuboid>("", Transform::new(at).unwrap()).unwrap()
            else {
                unreachable!("a box is a custom shape")
            };
            let ray = Ray::new(DVec3::new(0.1, 0.2, 3.0), DVec3::new(0.1, 0.0, -1.0));
            let hit = pane.intersect(&ray, Interval::FORWARD, None).unwrap();
            assert_eq!(hit.primitive, 5);
            let hit = hit.of_shape(whitstone_core::InstanceId::TOP_LEVEL, 0);
            let point = pane.surface(&ray, &hit, SurfaceAttributes::NOTHING);
            let inner = Ray::new(point.spawn_origin(ray.direction), ray.direction);
            // Otherwise an accelerator would not test the pane.
            let Aabb { min, max } = pane.bounds();
            assert!(inner.origin.cmpge(min).all() && inner.origin.cmple(max).all());
            let exit = pane.intersect(&inner, Interval::FORWARD, Some(5));
            assert_eq!(exit.map(|hit| hit.primitive), Some(4), "2^-{exponent}");
        }
    }

    #[test]
    fn only_spawned_rays_leave_at_once() {
        // Beyond the exit, and past the box.
        assert_eq!(intersect([1.1, 0.0, 0.9], [0.5, 0.0, -1.0], Some(5)), None);
        assert_eq!(intersect([-5.0, 0.0, 0.0], [1.0, 0.0, -1.0], Some(5)), None);
    }

    #[test]
    fn what_leaves_an_edge_meets_no_neighbour() {
        let beyond = 1.0f64.next_up();
        assert_eq!(
            intersect([beyond, 0.0, 1.0], [-0.5, 0.0, -1.0], Some(5)),
            Some((2.0, 4))
        );
        assert_eq!(intersect([beyond, 0.0, 1.0], [-0.5, 0.0, 1.0], Some(5)), None);
    }
}
