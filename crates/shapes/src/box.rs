//! A box, or any parallelepiped by its transform.
//!
//! The slab test of Kay and Kajiya (1986) in object space, with near and far faces told by the *sign bit*
//! of the direction and comparisons that ignore NaN (Ize, *Robust BVH ray traversal*, JCGT 2(2), 2013):
//! rays that run in a face, with either sign of zero, are answered like their neighbours inside.
//!
//! - Twin: Mitsuba `cube` (native).
//! - Example: `scenes/shapes/box.toml`.

use crate::frame::Frame;
use schemars::JsonSchema;
use serde::Deserialize;
use whitstone_core::{
    Aabb, Context, DVec2, DVec3, Interval, Needs, Plugin, Primitive, PrimitiveHit, RawHit, Ray, SceneErrors,
    Shape, Shapes, SurfacePoint, Transform,
};

/// The cube from -1 to 1 along each axis of its object space; the outside is away from its center.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Config {}

/// In world space.
pub struct Cuboid {
    frame: Frame,
}

impl Plugin<Shapes> for Cuboid {
    const TYPE: &'static str = "box";
    type Config = Config;

    fn build(_: Config, transform: Transform, _: &mut dyn Context) -> Result<Shape, SceneErrors> {
        let frame = Frame::new(transform);
        Ok(Shape::Opaque(Box::new(Self { frame })))
    }
}

/// Where a ray in object space crosses the surface: parameter and face.
#[derive(Clone, Copy)]
struct Crossing {
    t: f64,
    face: usize,
}

/// Entry into and exit from the cube; `None` for a ray that misses it.
fn crossings(ray: &Ray) -> Option<[Crossing; 2]> {
    let mut entry = Crossing {
        t: f64::NEG_INFINITY,
        face: 0,
    };
    let mut exit = Crossing {
        t: f64::INFINITY,
        face: 0,
    };
    for axis in 0..3 {
        let (o, d) = (ray.origin[axis], ray.direction[axis]);
        let side = if d.is_sign_negative() { -1.0 } else { 1.0 };
        let (near, far) = ((-side - o) / d, (side - o) / d);
        // 0/0 is NaN and changes nothing: the origin lies in that face. Strict comparisons keep the
        // lowest face where several are crossed at once.
        if near > entry.t {
            entry = Crossing {
                t: near,
                face: 2 * axis + usize::from(side < 0.0),
            };
        }
        if far < exit.t {
            exit = Crossing {
                t: far,
                face: 2 * axis + usize::from(side > 0.0),
            };
        }
    }
    (entry.t <= exit.t).then_some([entry, exit])
}

/// Sign of the outward normal of a face along its axis.
fn side(face: usize) -> f64 {
    if face.is_multiple_of(2) { -1.0 } else { 1.0 }
}

/// The coordinates along the face of axis a, in the order a+1, a+2.
fn along(axis: usize) -> [usize; 2] {
    [(axis + 1) % 3, (axis + 2) % 3]
}

impl Primitive for Cuboid {
    fn bounds(&self) -> Aabb {
        self.frame.bounds(DVec3::ONE)
    }

    fn closest(&self, ray: &Ray, interval: Interval, leaves: Option<u32>) -> Option<PrimitiveHit> {
        let ray = self.frame.ray_to_object(ray);
        let mut candidates = crossings(&ray)?;
        if let Some(face) = leaves {
            // The box is convex: what leaves a face outward meets no other, what goes inward meets the
            // exit only. That is the rule "this face is skipped" without its rounding: a start on an edge
            // may lie beyond the neighbour's plane by an ulp.
            let face = face as usize;
            let outward = ray.direction[face / 2] * side(face);
            if outward >= 0.0 || candidates[1].face == face {
                return None;
            }
            candidates[0].t = f64::NAN;
        } else if candidates[0].t == candidates[1].t {
            // An edge or a corner is touched: the lowest face wins.
            candidates.sort_by_key(|crossing| crossing.face);
        }
        let Crossing { t, face } = candidates.into_iter().find(|c| interval.contains(c.t))?;
        let p = ray.at(t);
        let params = DVec2::from_array(along(face / 2).map(|axis| p[axis].clamp(-1.0, 1.0)));
        Some(PrimitiveHit {
            t,
            primitive: face as u32,
            params,
        })
    }

    fn surface(&self, _: &Ray, hit: &RawHit, needs: Needs) -> SurfacePoint {
        let face = hit.primitive as usize;
        let axis = face / 2;
        let [b, c] = along(axis);
        let mut p = DVec3::ZERO;
        (p[axis], p[b], p[c]) = (side(face), hit.params.x, hit.params.y);
        let (position, error) = self.frame.point(p, axis);
        let mut point = SurfacePoint::new(position, error, side(face) * self.frame.normal(axis));
        if needs.contains(Needs::UV) {
            point.uv = 0.5 * (hit.params + 1.0);
        }
        point
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use whitstone_testkit::{build, shape_laws_everywhere};

    fn cube() -> Box<dyn Primitive> {
        match build::<Shapes, Cuboid>("", Transform::IDENTITY).unwrap() {
            Shape::Opaque(cube) => cube,
            _ => unreachable!("a box is opaque"),
        }
    }

    fn closest(origin: [f64; 3], direction: [f64; 3], leaves: Option<u32>) -> Option<(f64, u32)> {
        let ray = Ray::new(origin.into(), direction.into());
        let hit = cube().closest(&ray, Interval::FORWARD, leaves)?;
        Some((hit.t, hit.primitive))
    }

    #[test]
    fn obeys_the_laws_of_shapes() {
        shape_laws_everywhere::<Cuboid>("", 2_000);
    }

    #[test]
    fn faces_are_numbered_and_bounds_are_exact() {
        for axis in 0..3 {
            for (face, sign) in [(2 * axis, -1.0), (2 * axis + 1, 1.0)] {
                let mut outward = DVec3::ZERO;
                outward[axis] = sign;
                let from_outside = closest((3.0 * outward).into(), (-outward).into(), None);
                assert_eq!(from_outside, Some((2.0, face as u32)));
                assert_eq!(closest([0.0; 3], outward.into(), None), Some((1.0, face as u32)));
            }
        }
        assert_eq!(
            cube().bounds(),
            Aabb {
                min: DVec3::NEG_ONE,
                max: DVec3::ONE
            }
        );
    }

    #[test]
    fn rays_in_a_face_hit_with_either_zero() {
        for zero in [0.0, -0.0] {
            for x in [-1.0, 1.0] {
                assert_eq!(closest([x, 0.0, 3.0], [zero, zero, -1.0], None), Some((2.0, 5)));
                assert_eq!(closest([2.0 * x, 0.0, 3.0], [zero, zero, -1.0], None), None);
            }
        }
    }

    #[test]
    fn at_an_edge_the_lowest_face_wins() {
        assert_eq!(closest([3.0, 3.0, 0.0], [-1.0, -1.0, 0.0], None), Some((2.0, 1)));
        // Touching an edge counts as a hit.
        assert_eq!(closest([2.0, 0.0, 0.0], [-1.0, 1.0, 0.0], None), Some((1.0, 1)));
    }

    #[test]
    fn what_leaves_an_edge_meets_no_neighbour() {
        let beyond = 1.0f64.next_up();
        assert_eq!(
            closest([beyond, 0.0, 1.0], [-0.5, 0.0, -1.0], Some(5)),
            Some((2.0, 4))
        );
        assert_eq!(closest([beyond, 0.0, 1.0], [-0.5, 0.0, 1.0], Some(5)), None);
    }
}
