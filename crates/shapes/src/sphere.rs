//! A sphere.
//!
//! Roots: Haines, Günther, Akenine-Möller, *Precision improvements for ray/sphere intersection*,
//! Ray Tracing Gems (2019), ch. 7. Their discriminant, computed from the perpendicular distance, is
//! more accurate for small, distant spheres but *less* accurate for large spheres close to the ray
//! origin. The form is therefore chosen per ray.
//!
//! A ray that was spawned on the sphere and meets it again has travelled along a chord. The far end
//! of a chord is the mirror image of its near end, whatever the distance of the near end from the
//! surface. This keeps the angle of incidence over thousands of internal reflections, although each
//! ray starts at an offset from the surface.
//!
//! - Twin: Mitsuba `sphere` (native).
//! - Example: `scenes/shapes/sphere.toml`.

use crate::support::near::{check_radius, comes_near_ball, goes_on};
use schemars::JsonSchema;
use serde::Deserialize;
use std::f64::consts::TAU;
use whitstone_core::config::{Positive, Vector3};
use whitstone_core::simd::select;
use whitstone_core::{
    Aabb, Context, DVec2, DVec3, LoweredShape, NO_PRIMITIVE, Plugin, PreliminaryIntersection, Ray,
    SceneError, SceneErrors, ShapeHit, ShapeKernel, Shapes, Spans, SurfaceAttributes, SurfaceInteraction,
    SurfacePart, Transform, solid,
};

/// A sphere whose normals point away from its center.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// Center in object space, in metres.
    #[serde(default = "origin")]
    center: Vector3,
    /// Radius in metres.
    #[serde(default = "one")]
    radius: Positive,
}

fn origin() -> Vector3 {
    Vector3::new(0.0, 0.0, 0.0)
}

fn one() -> Positive {
    Positive::new(1.0).expect("1 is positive")
}

/// The sphere in world space.
#[derive(Clone)]
pub struct Sphere {
    center: DVec3,
    radius: f64,
    /// Orients the texture coordinates.
    transform: Transform,
}

impl Plugin<Shapes> for Sphere {
    const TYPE: &'static str = "sphere";
    type Config = Config;

    fn build(config: Config, transform: Transform, _: &mut dyn Context) -> Result<LoweredShape, SceneErrors> {
        let scale = transform.similarity_scale().ok_or_else(|| {
            SceneError::anywhere("the transform of a sphere must scale equally in all directions")
                .with_help("use the shape \"ellipsoid\"")
        })?;
        let radius = config.radius.get() * scale;
        check_radius(radius)?;
        Ok(LoweredShape::Custom(Box::new(Self {
            center: transform.point_to_world(config.center.get()),
            radius,
            transform,
        })))
    }
}

impl ShapeKernel for Sphere {
    fn bounds(&self) -> Aabb {
        Aabb {
            min: self.center - self.radius,
            max: self.center + self.radius,
        }
        // Pad by the rounding error of the corners.
        .padded(2.0 * f64::EPSILON * (self.center.abs().max_element() + self.radius))
    }

    #[inline(always)]
    fn may_hit(&self, ray: &Ray) -> bool {
        comes_near_ball(ray, self.center, self.radius)
    }

    #[inline(always)]
    fn hit(&self, ray: &Ray, min: f64, origin_primitive: u32) -> ShapeHit {
        nearest(self.roots(ray), min, origin_primitive)
    }

    #[inline(always)]
    fn is_far(&self, ray: &Ray) -> bool {
        // Closer than two radii, also after rounding; NaN counts as far.
        let close = (ray.origin - self.center).length_squared() < 3.9 * (self.radius * self.radius);
        !close
    }

    #[inline(always)]
    fn hit_near(&self, ray: &Ray, min: f64, origin_primitive: u32) -> ShapeHit {
        nearest(self.roots_near(ray), min, origin_primitive)
    }

    #[inline(always)]
    fn surface(
        &self,
        ray: &Ray,
        hit: &PreliminaryIntersection,
        needs: SurfaceAttributes,
    ) -> SurfaceInteraction {
        let (l, d) = (ray.origin - self.center, ray.direction);
        let chord = l - (2.0 * l.dot(d) / d.length_squared()) * d;
        let plain = ray.at(hit.t) - self.center;
        let is_chord = hit.prim_uv.x > 0.0;
        let from_center = DVec3::new(
            select(is_chord, chord.x, plain.x),
            select(is_chord, chord.y, plain.y),
            select(is_chord, chord.z, plain.z),
        );
        let n = unit_length(from_center.normalize());
        // Project the point onto the sphere: its error is then a few roundings of its coordinates,
        // however distant the ray origin.
        let position = self.center + self.radius * n;
        let error = 2.0 * f64::EPSILON * (self.center.abs().max_element() + self.radius);
        let mut point = SurfaceInteraction::new(position, error, n);
        if needs.contains(SurfaceAttributes::UV) {
            point.uv = self.uv(n);
        }
        point
    }

    fn parts(&self) -> Vec<SurfacePart> {
        vec![SurfacePart::Sphere {
            center: self.center,
            radius: self.radius,
        }]
    }

    fn surface_at_offset(
        &self,
        point: &SurfaceInteraction,
        hit: &PreliminaryIntersection,
        q: DVec3,
        needs: SurfaceAttributes,
    ) -> Option<SurfaceInteraction> {
        // The ray to `q` is no chord.
        let there = PreliminaryIntersection {
            t: 0.0,
            prim_uv: DVec2::ZERO,
            ..*hit
        };
        let there = ShapeKernel::surface(self, &Ray::new(q, point.n_g), &there, needs);
        Some(goes_on(there, point))
    }

    fn is_solid(&self) -> bool {
        true
    }

    fn spans(&self, ray: &Ray, spans: &mut Spans) {
        let [enter, exit] = self.roots(ray).map(ShapeHit::plain);
        solid::push(spans, enter, exit);
    }
}

impl Sphere {
    /// The two ray parameters at which the line of a ray meets the sphere, in ascending order, or
    /// NaN.
    #[inline(always)]
    fn roots(&self, ray: &Ray) -> [f64; 2] {
        let (l, d) = (ray.origin - self.center, ray.direction);
        let (a, b) = (d.length_squared(), l.dot(d));
        let distance = l.length();
        // |l|² - r², factored to avoid cancellation.
        let c = (distance - self.radius) * (distance + self.radius);
        let perpendicular = (l - (b / a) * d).length();
        let near_form = b * b - a * c;
        let far_form = a * (self.radius - perpendicular) * (self.radius + perpendicular);
        let discriminant = select(distance < 2.0 * self.radius, near_form, far_form);
        ascending([a, b, c], discriminant)
    }

    /// [`Self::roots`] for rays that are not far, whose discriminant is always the near form.
    #[inline(always)]
    fn roots_near(&self, ray: &Ray) -> [f64; 2] {
        let (l, d) = (ray.origin - self.center, ray.direction);
        let (a, b) = (d.length_squared(), l.dot(d));
        let distance = l.length();
        let c = (distance - self.radius) * (distance + self.radius);
        ascending([a, b, c], b * b - a * c)
    }

    fn uv(&self, n: DVec3) -> DVec2 {
        let local = self
            .transform
            .object_from_world()
            .transform_vector3(n)
            .normalize();
        let phi = libm::atan2(local.y, local.x);
        let phi = if phi < 0.0 { phi + TAU } else { phi };
        // acos loses half the digits near the poles; atan2 does not.
        let theta = libm::atan2(local.truncate().length(), local.z);
        DVec2::new(phi / TAU, 1.0 - theta / std::f64::consts::PI)
    }
}

/// Corrects the length of a normalised vector, whose error has the same sign in most directions.
/// The angles of reflection would drift by it.
#[inline(always)]
fn unit_length(n: DVec3) -> DVec3 {
    let squares = n * n;
    let (low, high) = (squares.x.min(squares.y), squares.x.max(squares.y));
    // The largest square minus 1 is almost exact, and so is its sum with the others.
    let excess = (high.max(squares.z) - 1.0) + (low + high.min(squares.z));
    n - 0.5 * excess * n
}

/// The roots of `a t² + 2 b t + c`, in ascending order, or NaN.
#[inline(always)]
fn ascending([a, b, c]: [f64; 3], discriminant: f64) -> [f64; 2] {
    // One root comes from the sum that does not cancel, the other from the product of the roots.
    // Both are NaN if the discriminant is negative.
    let q = -(b + discriminant.sqrt().copysign(b));
    let (one, other) = (c / q, q / a);
    let ascending = one < other;
    [select(ascending, one, other), select(ascending, other, one)]
}

/// The nearest hit beyond `min`. Its `prim_uv.x` is 1 if the ray was spawned on the sphere, so that
/// it has travelled along a chord, and 0 if not.
#[inline(always)]
fn nearest([first, second]: [f64; 2], min: f64, origin_primitive: u32) -> ShapeHit {
    // For a ray spawned on the sphere, the root of smaller magnitude is the spawn point itself,
    // moved off zero by the offset of the ray origin and by rounding.
    let origin_primitive = origin_primitive != NO_PRIMITIVE;
    let second_is_start = second.abs() < first.abs();
    let first_counts = (first > min) & !(origin_primitive & !second_is_start);
    let second_counts = (second > min) & !(origin_primitive & second_is_start);
    let later = select(second_counts, second, f64::NAN);
    ShapeHit {
        t: select(first_counts, first, later),
        primitive: 0,
        prim_uv: DVec2::new(select(origin_primitive, 1.0, 0.0), 0.0),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use whitstone_core::{Interval, Shape};
    use whitstone_testkit::{build, shape_laws_everywhere};

    fn unit() -> Sphere {
        Sphere {
            center: DVec3::ZERO,
            radius: 1.0,
            transform: Transform::IDENTITY,
        }
    }

    #[test]
    fn obeys_the_laws_of_shapes() {
        shape_laws_everywhere::<Sphere>("", 2_000);
        shape_laws_everywhere::<Sphere>("center = [1, -2, 3]\nradius = 0.01", 2_000);
    }

    #[test]
    fn a_ray_that_leaves_meets_the_far_side_only() {
        let ray = Ray::new(DVec3::X, DVec3::NEG_X);
        let hit = unit().intersect(&ray, Interval::FORWARD, Some(0)).unwrap();
        assert_eq!(hit.t, 2.0);
        let away = Ray::new(DVec3::X, DVec3::X);
        assert_eq!(unit().intersect(&away, Interval::FORWARD, Some(0)), None);
    }

    /// Points next to a hit do not depend on where the ray came from.
    #[test]
    fn neighbours_of_the_end_of_a_chord_are_next_to_it() {
        let ball = unit();
        let ray = Ray::new(DVec3::new(0.6, 0.8, 0.0), DVec3::new(-1.0, 0.1, 0.2).normalize());
        let hit = ball.intersect(&ray, Interval::FORWARD, Some(0)).unwrap();
        let hit = hit.of_shape(whitstone_core::InstanceId::TOP_LEVEL, 0);
        let point = Shape::surface(&ball, &ray, &hit, SurfaceAttributes::UV);
        let q = point.position + 1e-4 * point.n_g.any_orthonormal_vector();
        let next = Shape::surface_at_offset(&ball, &point, &hit, q, SurfaceAttributes::UV).unwrap();
        assert!(next.n_s.distance(point.n_s) < 2e-4, "{} {}", next.n_s, point.n_s);
        assert!(next.uv.distance(point.uv) < 1e-3, "{} {}", next.uv, point.uv);
    }

    /// Grazing reflections along the inside: each chord turns by the same angle. A rounding of one
    /// direction is magnified by the number of reflections that follow, and roundings add like the
    /// steps of a random walk.
    #[test]
    fn chords_keep_their_length() {
        let ball = unit();
        for depth in [0.2, 1e-2, 1e-6, 1e-10] {
            let start = 1.0 - depth;
            // From the depth as rounded.
            let half = 2.0 * (0.5_f64 * (1.0 - start)).sqrt().asin();
            let (mut ray, mut origin_primitive) = (Ray::new(DVec3::new(0.0, start, 0.0), DVec3::X), None);
            let bounces = 1000;
            for _ in 0..bounces {
                let hit = ball.intersect(&ray, Interval::FORWARD, origin_primitive).unwrap();
                let hit = hit.of_shape(whitstone_core::InstanceId::TOP_LEVEL, 0);
                let point = Shape::surface(&ball, &ray, &hit, SurfaceAttributes::NOTHING);
                let d = ray.direction - 2.0 * point.n_g.dot(ray.direction) * point.n_g;
                let d = d.normalize();
                (ray, origin_primitive) = (Ray::new(point.spawn_origin(d), d), Some(0));
            }
            let turn = half * f64::from(2 * bounces - 1);
            let error = ray.origin.distance(DVec3::new(turn.sin(), turn.cos(), 0.0));
            let condition = 2.0 * (f64::from(bounces).powi(3) / 3.0).sqrt() / half.sin();
            assert!(
                error < 4.0 * f64::EPSILON * condition,
                "{depth}: {error:e}, {} ulp x condition",
                error / (f64::EPSILON * condition)
            );
        }
    }

    #[test]
    fn radii_without_squares_are_refused() {
        for (radius, refused) in [(1e-150, false), (1e150, false), (1e-160, true), (1e160, true)] {
            let built = build::<Shapes, Sphere>(&format!("radius = {radius:e}"), Transform::IDENTITY);
            assert_eq!(built.is_err(), refused, "{radius:e}");
        }
    }

    #[test]
    fn a_far_sphere_is_hit_where_it_is() {
        let ray = Ray::new(DVec3::new(1e7, 0.6, 0.0), DVec3::NEG_X);
        let hit = unit().intersect(&ray, Interval::FORWARD, None).unwrap();
        assert!((hit.t - (1e7 - 0.8)).abs() < 4e-9);
    }
}
