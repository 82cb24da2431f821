//! A torus.
//!
//! The ray is reparameterised from its point nearest to the center with fused operations, so that a
//! distant ray origin costs no digits. The derivative of the quartic is then a depressed cubic. The
//! extrema of the quartic, found as roots of derivatives bracketed by roots of *their* derivatives
//! (Yuksel, *High-Performance Polynomial Root Finding for Graphics*, 2022, section 3), divide the
//! ray into pieces with at most one crossing each. The crossing itself is a root of the signed
//! distance to the surface, because the quartic cancels where the tube is thin. Both searches start
//! at a closed-form estimate and keep a bracket.
//!
//! - Twin: hosted by the Mitsuba driver, in double precision; POV-Ray `torus` (native).
//! - Example: `scenes/shapes/torus.toml`.

use crate::support::near::{comes_near_ball, goes_on};
use schemars::JsonSchema;
use serde::Deserialize;
use std::f64::consts::TAU;
use toml::Spanned;
use whitstone_core::config::Positive;
use whitstone_core::{
    Aabb, Context, DVec2, DVec3, Interval, LoweredShape, Plugin, PreliminaryIntersection, Ray, SceneError,
    SceneErrors, Shape, ShapeHit, Shapes, Spans, SurfaceAttributes, SurfaceInteraction, Transform, solid,
};

/// A torus around the z axis of its object space; its normals point out of the tube.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// Radius of the circle at the center of the tube, in metres.
    #[serde(default = "one")]
    major_radius: Positive,
    /// Radius of the tube in metres, less than `major_radius`.
    #[serde(default)]
    #[schemars(extend("default" = 0.25), with = "Positive")]
    minor_radius: Option<Spanned<Positive>>,
}

fn one() -> Positive {
    Positive::new(1.0).expect("1 is positive")
}

/// The torus in world space.
pub struct Torus {
    center: DVec3,
    /// Unit vector.
    axis: DVec3,
    major: f64,
    minor: f64,
    /// Orients the texture coordinates.
    transform: Transform,
}

impl Plugin<Shapes> for Torus {
    const TYPE: &'static str = "torus";
    type Config = Config;

    fn build(config: Config, transform: Transform, _: &mut dyn Context) -> Result<LoweredShape, SceneErrors> {
        let scale = transform.similarity_scale().ok_or_else(|| {
            SceneError::anywhere("the transform of a torus must scale equally in all directions")
                .with_help("an instance of a group may stretch it")
        })?;
        let major = config.major_radius.get();
        let (minor, place) = match config.minor_radius {
            Some(minor) => (minor.get_ref().get(), Some(minor.span())),
            None => (0.25, None),
        };
        if minor >= major {
            let error = SceneError::anywhere(format!(
                "expected a minor_radius less than the major_radius, {major}, found {minor}"
            ));
            let error = error.with_help("a thicker tube would intersect itself");
            return Err(SceneError { span: place, ..error }.into());
        }
        Ok(LoweredShape::Custom(Box::new(Self {
            center: transform.world_from_object().translation,
            axis: transform.world_from_object().matrix3.z_axis.normalize(),
            major: major * scale,
            minor: minor * scale,
            transform,
        })))
    }
}

/// Unit roundoff: half the distance from 1 to the next number.
const UNIT: f64 = 0.5 * f64::EPSILON;

/// Upper bound on the steps to one root: each step is half as long as the previous one or halves
/// the bracket.
const MAX_STEPS: u32 = 240;

/// A ray in units of the major radius, measured from its point nearest to the center: the point at
/// `s` is `q + s d`.
struct Line {
    q: DVec3,
    d: DVec3,
    axis: DVec3,
    /// Minor radius over major radius.
    minor: f64,
    /// The ray parameter at `s` is `start + (more + s * unit)`.
    start: f64,
    more: f64,
    unit: f64,
}

/// Derivative and direction of the signed distance to the surface at a point.
struct Distance {
    /// Derivative of the distance along the line.
    slope: f64,
    /// Unit vector from the axis to the point; zero on the axis.
    outward: DVec3,
    /// Unit normal; NaN at the center of the tube.
    normal: DVec3,
}

/// A crossing of the surface by the line.
struct Crossing {
    t: f64,
    s: f64,
    /// Whether the line goes from outside to inside.
    enters: bool,
}

impl Crossing {
    fn hit(&self) -> ShapeHit {
        ShapeHit {
            t: self.t,
            primitive: 0,
            // The position on the line, which has more digits than t if the origin is distant.
            prim_uv: DVec2::new(self.s, 0.0),
        }
    }
}

impl Line {
    fn new(torus: &Torus, ray: &Ray) -> Self {
        // The difference and its rounding error (Knuth's TwoSum).
        let (o, c) = (ray.origin, torus.center);
        let l = o - c;
        let c_seen = o - l;
        let lost = (o - (l + c_seen)) + (c_seen - c);
        // The parameter is rounded, but the point at it is accurate: the terms cancel, and each is
        // fused.
        let scale = power_of_two_near(ray.direction);
        let d = scale * ray.direction;
        let a = d.length_squared();
        let along =
            |t: f64, p: DVec3| DVec3::new(t.mul_add(d.x, p.x), t.mul_add(d.y, p.y), t.mul_add(d.z, p.z));
        let start = -l.dot(d) / a;
        let q = along(start, l) + lost;
        let more = -q.dot(d) / a;
        Self {
            q: along(more, q) / torus.major,
            d,
            axis: torus.axis,
            minor: torus.minor / torus.major,
            start: scale * start,
            more: scale * more,
            unit: scale * torus.major,
        }
    }

    fn t(&self, s: f64) -> f64 {
        self.start + (self.more + s * self.unit)
    }

    /// The part of the line within a bounding sphere and between two planes around the torus.
    fn reach(&self) -> Option<(f64, f64)> {
        let a = self.d.length_squared();
        let radius = (1.0 + self.minor) * (1.0 + 1e-9);
        let chord = ((radius * radius - self.q.length_squared()) / a).sqrt();
        let (height, slope) = (self.q.dot(self.axis), self.d.dot(self.axis));
        // Far above the rounding error of the height.
        let half = self.minor * (1.0 + 1e-9) + 64.0 * UNIT;
        let (below, above) = ((-half - height) / slope, (half - height) / slope);
        if height.abs() > half && slope == 0.0 {
            return None;
        }
        // NaN (the line lies in one of the planes or misses the sphere) is ignored by min and max,
        // and fails the comparisons.
        let low = (-chord).max(below.min(above));
        let high = chord.min(below.max(above));
        (chord > 0.0 && low < high).then_some((low, high))
    }

    /// The data that locate the extrema of the quartic.
    fn turns(&self) -> Turns {
        let a = self.d.length_squared();
        let (h, k) = (self.q.dot(self.axis), self.d.dot(self.axis));
        let (radial, along) = (self.q - h * self.axis, self.d - k * self.axis);
        // The quartic is (|p|² + 1 - r²)² - 4 rho², with |p|² = w + a s² and rho² quadratic in s.
        // Its derivative over 4 a²:
        let w = self.q.length_squared();
        let p = ((w + (1.0 - self.minor) * (1.0 + self.minor)) - 2.0 * along.length_squared() / a) / a;
        let q = -2.0 * radial.dot(along) / (a * a);
        Turns {
            p,
            q,
            turn: (-p / 3.0).max(0.0).sqrt(),
            scale: 4.0 * a * a,
            error: (UNIT * self.minor).sqrt(),
        }
    }

    fn distance(&self, s: f64) -> Distance {
        let p = self.q + s * self.d;
        let height = p.dot(self.axis);
        let radial = p - height * self.axis;
        let rho = radial.length();
        let outward = if rho > 0.0 { radial / rho } else { DVec3::ZERO };
        let away = (rho - 1.0) * outward + height * self.axis;
        let from_circle = ((rho - 1.0) * (rho - 1.0) + height * height).sqrt();
        let normal = away / from_circle;
        Distance {
            slope: normal.dot(self.d),
            outward,
            normal,
        }
    }

    /// The parameter `s` of the ray origin.
    fn at_start(&self) -> f64 {
        (-self.start - self.more) / self.unit
    }

    /// Derivative of the distance to the surface at the ray origin: positive if the ray goes
    /// outward.
    fn slope_at_start(&self) -> f64 {
        self.distance(self.at_start()).slope
    }

    /// The signed distance to the surface and its derivative; the derivative is NaN on the axis and
    /// at the center of the tube.
    fn value(&self, s: f64) -> (f64, f64) {
        let p = self.q + s * self.d;
        let height = p.dot(self.axis);
        let radial = p - height * self.axis;
        let rho = radial.length();
        let from_circle = ((rho - 1.0) * (rho - 1.0) + height * height).sqrt();
        let slope = (rho - 1.0) * (radial.dot(self.d) / rho) + height * self.d.dot(self.axis);
        (from_circle - self.minor, slope / from_circle)
    }

    /// Distance from a minimum of the quartic inside the tube to the roots of the parabola fitted
    /// there; NaN if the point is outside. `curvature` is the second derivative.
    fn half_width(&self, s: f64, curvature: f64) -> f64 {
        let p = self.q + s * self.d;
        let height = p.dot(self.axis);
        let rho = (p - height * self.axis).length();
        let squared = |x: f64| x * x + height * height;
        // The quartic is the product of the terms of the circle and of its mirror image.
        let (near, far) = (squared(rho - 1.0), squared(rho + 1.0));
        let minor = self.minor;
        let quartic = (near.sqrt() - minor) * (near.sqrt() + minor) * (far - minor * minor);
        (-2.0 * quartic / curvature).sqrt()
    }

    /// All crossings, at most four, in ascending order; each is computed on demand.
    fn crossings(&self) -> impl Iterator<Item = Crossing> + '_ {
        let turns = self.turns();
        // Bound on the second derivative of the distance at the surface, which is `minor` away from
        // the circle and at least 1 - `minor` from the axis.
        let bend = self.d.length_squared() / self.minor.min(1.0 - self.minor);
        let ends = self.reach().map(|(low, high)| {
            let turn = |at: f64| at.clamp(low, high);
            [low, turn(-turns.turn), turn(turns.turn), high]
        });
        // The stages are minimum, maximum, minimum and the end of the range, if they exist.
        let stages = ends.map_or(0..0, |_| 0..4);
        let ends = ends.unwrap_or_default();
        let (mut from, mut inside, mut width) = (ends[0], false, f64::NAN);
        stages.filter_map(move |stage| {
            let last = stage == 3;
            // The maximum and the end matter only after a minimum inside the tube.
            if !inside && (stage == 1 || last) {
                return None;
            }
            let to = if last {
                ends[3]
            } else {
                turns.between(ends[stage], ends[stage + 1])?
            };
            let before = inside;
            // The end of the range is outside by construction.
            inside = !last && self.value(to).0 < 0.0;
            if inside && stage != 1 {
                width = self.half_width(to, turns.scale * turns.cubic(to).1);
            }
            let start = if inside { to - width } else { from + width };
            let bracket = (from, to);
            from = to;
            (before != inside).then(|| {
                let s = root(|s| self.value(s), bracket, inside, start, bend, UNIT);
                Crossing {
                    t: self.t(s),
                    s,
                    enters: inside,
                }
            })
        })
    }
}

/// The derivative of the quartic over `scale`: the cubic `s³ + p s + q`, with extrema at ±`turn` if
/// it has any.
struct Turns {
    p: f64,
    q: f64,
    turn: f64,
    scale: f64,
    /// Tolerance for the position of an extremum; its height is off by the square of it.
    error: f64,
}

impl Turns {
    fn cubic(&self, s: f64) -> (f64, f64) {
        let Self { p, q, .. } = *self;
        ((s * s + p) * s + q, 3.0 * s * s + p)
    }

    /// The root between two positions with no extremum in between, if there is one.
    fn between(&self, from: f64, to: f64) -> Option<f64> {
        let negative = |s: f64| self.cubic(s).0 < 0.0;
        let falls = negative(to);
        (negative(from) != falls).then(|| {
            let start = self.near_root(0.5 * (from + to));
            let bend = 6.0 * from.abs().max(to.abs());
            root(|s| self.cubic(s), (from, to), falls, start, bend, self.error)
        })
    }

    /// An approximate root. If there are three, the one on the same side of the extrema as `s`, or
    /// between them; otherwise the only one.
    fn near_root(&self, s: f64) -> f64 {
        let Self { p, q, turn, .. } = *self;
        let (third, half) = (p / 3.0, 0.5 * q);
        let discriminant = half * half + third * third * third;
        if discriminant >= 0.0 {
            // Cardano's formula.
            let w = libm::cbrt(half.abs() + discriminant.sqrt()).copysign(-half);
            return w - third / w;
        }
        // s = 2 turn y, with 4 y³ - 3 y = x. The largest root is cos(acos(x) / 3), approximated to
        // four thousandths.
        let x = -half / (turn * turn * turn);
        let largest = |x: f64| 0.5 + ((1.0 + x) / 6.0).sqrt() - 0.0387 * (1.0 + x);
        let y = if s > turn {
            largest(x)
        } else if s < -turn {
            -largest(-x)
        } else {
            // The sum of the three roots is zero.
            largest(-x) - largest(x)
        };
        2.0 * turn * y
    }
}

/// The root between two positions at which a function (value and slope) has different signs.
///
/// Newton's method inside a bracket, starting at `start` if that is in the bracket. `falls` says
/// whether the function is negative at the second position.
///
/// The iteration ends if the remaining error is less than `error`. For Newton's method that error
/// is at most half of `bend` (a bound on the second derivative) over the slope, times the square of
/// the step. If the slope gives no such bound, the step itself must be at most `error` times the
/// larger of |s| and 1/8.
fn root(
    f: impl Fn(f64) -> (f64, f64),
    (mut from, mut to): (f64, f64),
    falls: bool,
    start: f64,
    bend: f64,
    error: f64,
) -> f64 {
    let inside = |s: f64, from: f64, to: f64| s >= from && s <= to;
    // NaN is not inside, either.
    let mut s = if inside(start, from, to) {
        start
    } else {
        0.5 * (from + to)
    };
    let mut before = to - from;
    for _ in 1..MAX_STEPS {
        let (value, slope) = f(s);
        if (value < 0.0) == falls {
            to = s;
        } else {
            from = s;
        }
        let newton = s - value / slope;
        // Reject Newton steps that do not halve: they do not converge.
        let good = inside(newton, from, to) && (newton - s).abs() <= 0.5 * before;
        let next = if good { newton } else { 0.5 * (from + to) };
        before = (next - s).abs();
        let done = good && 0.5 * bend * before * before <= error * slope.abs();
        if done || before <= error * s.abs().max(0.125) {
            return next;
        }
        s = next;
    }
    s
}

/// The power of two that scales the largest coordinate to between 1 and 2, for vectors of any
/// reasonable length.
fn power_of_two_near(v: DVec3) -> f64 {
    let exponent = (v.abs().max_element().to_bits() >> 52).clamp(1, 2045);
    f64::from_bits((2046 - exponent) << 52)
}

impl Shape for Torus {
    fn bounds(&self) -> Aabb {
        let a = self.axis;
        let across = DVec3::new(
            libm::hypot(a.y, a.z),
            libm::hypot(a.z, a.x),
            libm::hypot(a.x, a.y),
        );
        let reach = self.major * across + self.minor;
        Aabb {
            min: self.center - reach,
            max: self.center + reach,
        }
        .padded(self.error())
    }

    fn intersect(&self, ray: &Ray, interval: Interval, origin_primitive: Option<u32>) -> Option<ShapeHit> {
        if !comes_near_ball(ray, self.center, self.major + self.minor) {
            return None;
        }
        let line = Line::new(self, ray);
        // After a ray spawned outward, the next crossing must enter the torus, and vice versa. If
        // the first crossing is of the other kind, it is the spawn point itself, which rounding has
        // put on the wrong side.
        let mut expected = origin_primitive.map(|_| line.slope_at_start() > 0.0);
        let mut crossings = line.crossings().filter(|crossing| crossing.t > 0.0);
        crossings
            .find(|crossing| {
                let is_start = expected.take().is_some_and(|enters| crossing.enters != enters);
                !is_start && crossing.t > interval.min
            })
            .filter(|crossing| interval.contains(crossing.t))
            .map(|crossing| crossing.hit())
    }

    fn is_solid(&self) -> bool {
        true
    }

    fn spans(&self, ray: &Ray, spans: &mut Spans) {
        let line = Line::new(self, ray);
        let mut crossings = line.crossings();
        // Each entry is followed by its exit.
        while let (Some(enter), Some(exit)) = (crossings.next(), crossings.next()) {
            solid::push(spans, enter.hit(), exit.hit());
        }
    }

    fn goes_inside(&self, ray: &Ray, _: u32) -> bool {
        Line::new(self, ray).slope_at_start() < 0.0
    }

    fn surface(
        &self,
        ray: &Ray,
        hit: &PreliminaryIntersection,
        needs: SurfaceAttributes,
    ) -> SurfaceInteraction {
        let Distance { outward, normal, .. } = Line::new(self, ray).distance(hit.prim_uv.x);
        let normal = normal.normalize();
        let position = self.center + (self.major * outward + self.minor * normal);
        let mut point = SurfaceInteraction::new(position, self.error(), normal);
        if needs.contains(SurfaceAttributes::UV) {
            point.uv = self.uv(outward, normal);
        }
        point
    }

    fn surface_at_offset(
        &self,
        point: &SurfaceInteraction,
        hit: &PreliminaryIntersection,
        q: DVec3,
        needs: SurfaceAttributes,
    ) -> Option<SurfaceInteraction> {
        let ray = Ray::new(q, self.axis);
        let line = Line::new(self, &ray);
        let prim_uv = DVec2::new(line.at_start(), 0.0);
        let there = self.surface(&ray, &PreliminaryIntersection { prim_uv, ..*hit }, needs);
        Some(goes_on(there, point))
    }
}

impl Torus {
    /// Error bound of a projected point along its normal: the rounding errors of unit vectors and
    /// sums.
    fn error(&self) -> f64 {
        4.0 * f64::EPSILON * (self.center.abs().max_element() + self.major + self.minor)
    }

    fn uv(&self, outward: DVec3, normal: DVec3) -> DVec2 {
        let inverse = self.transform.object_from_world();
        let [outward, normal] = [outward, normal].map(|v| inverse.transform_vector3(v));
        let turns = |y: f64, x: f64| {
            let angle = libm::atan2(y, x);
            (if angle < 0.0 { angle + TAU } else { angle }) / TAU
        };
        let around = outward.truncate();
        // Both arguments have the same factor, which does not affect the angle.
        let away = normal.truncate().dot(around) / around.length();
        DVec2::new(turns(outward.y, outward.x), turns(normal.z, away))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use whitstone_testkit::{build, shape_laws_everywhere};

    fn ring(text: &str) -> Box<dyn Shape> {
        match build::<Shapes, Torus>(text, Transform::IDENTITY) {
            Ok(LoweredShape::Custom(ring)) => ring,
            _ => panic!("a torus is a custom shape"),
        }
    }

    /// All hits in order.
    fn hits(ring: &dyn Shape, origin: [f64; 3], direction: [f64; 3]) -> Vec<f64> {
        let ray = Ray::new(origin.into(), direction.into());
        let mut found = Vec::new();
        let mut interval = Interval::FORWARD;
        while let Some(hit) = ring.intersect(&ray, interval, None) {
            interval.min = hit.t;
            found.push(hit.t);
        }
        found
    }

    #[test]
    fn obeys_the_laws_of_shapes() {
        shape_laws_everywhere::<Torus>("", 2_000);
        shape_laws_everywhere::<Torus>("major_radius = 2\nminor_radius = 1.9", 2_000);
        shape_laws_everywhere::<Torus>("minor_radius = 0.02", 20_000);
    }

    #[test]
    fn special_rays() {
        let ring = ring("major_radius = 2\nminor_radius = 0.5");
        let of = |origin, direction| hits(ring.as_ref(), origin, direction);
        // Through all four walls; along the axis; through the hole parallel to the axis; from
        // inside the tube.
        assert_eq!(of([4.0, 0.0, 0.0], [-1.0, 0.0, 0.0]), [1.5, 2.5, 5.5, 6.5]);
        assert!(of([0.0, 0.0, 9.0], [0.0, 0.0, -1.0]).is_empty());
        assert!(of([1.4, 0.0, 9.0], [0.0, 0.0, -1.0]).is_empty());
        assert_eq!(of([2.0, 0.0, 0.0], [0.0, 0.0, 1.0]), [0.5]);
        assert_eq!(of([2.0, 0.0, 3.0], [0.0, 0.0, -2.0]), [1.25, 1.75]);
        // Just above the plane that touches the torus on top, and just below it.
        assert!(of([0.0, 9.0, 0.5 + 1e-12], [0.0, -1.0, 0.0]).is_empty());
        assert_eq!(of([0.0, 9.0, 0.5 - 1e-9], [0.0, -1.0, 0.0]).len(), 4);
        // Through the outer rim with two crossings, and past it with none.
        assert_eq!(of([2.4, 9.0, 0.0], [0.0, -1.0, 0.0]).len(), 2);
        assert_eq!(of([2.51, 9.0, 0.0], [0.0, -1.0, 0.0]).len(), 0);
        // At extreme distances the result is arbitrary but must be finite.
        for far in [f64::MAX, 1e200] {
            assert!(
                of([far, far, 0.0], [-1.0, -1.0, 0.0])
                    .into_iter()
                    .all(f64::is_finite)
            );
        }
    }

    #[test]
    fn what_leaves_crosses_the_hole() {
        let ring = ring("major_radius = 2\nminor_radius = 0.5");
        let leave = |x: f64, d: f64| {
            let ray = Ray::new(DVec3::new(x, 0.0, 0.0), DVec3::new(d, 0.0, 0.0));
            ring.intersect(&ray, Interval::FORWARD, Some(0)).map(|hit| hit.t)
        };
        for x in [1.5, 1.5f64.next_up(), 1.5f64.next_down()] {
            assert!((leave(x, -1.0).unwrap() - 3.0).abs() < 1e-12);
            assert!((leave(x, 1.0).unwrap() - 1.0).abs() < 1e-12);
        }
        for x in [2.5, 2.5f64.next_up(), 2.5f64.next_down()] {
            assert_eq!(leave(x, 1.0), None);
            assert!((leave(x, -1.0).unwrap() - 1.0).abs() < 1e-12);
        }
    }

    #[test]
    fn texture_coordinates_are_angles() {
        let ring = ring("major_radius = 2\nminor_radius = 0.5");
        let ray = Ray::new(DVec3::new(0.0, 4.0, 2.0), DVec3::new(0.0, -1.0, -1.0));
        let hit = ring.intersect(&ray, Interval::FORWARD, None).unwrap();
        let hit = hit.of_shape(whitstone_core::InstanceId::TOP_LEVEL, 0);
        let point = ring.surface(&ray, &hit, SurfaceAttributes::UV);
        assert!((point.uv - DVec2::new(0.25, 0.125)).abs().max_element() < 1e-15);
        let half = 0.5f64.sqrt();
        assert!((point.n_g - DVec3::new(0.0, half, half)).length() < 1e-15);
    }

    #[test]
    fn a_tube_as_thick_as_its_ring_is_refused() {
        let error = |text: &str| {
            build::<Shapes, Torus>(text, Transform::IDENTITY)
                .err()
                .unwrap()
                .0
                .remove(0)
        };
        let thick = error("minor_radius = 1");
        assert_eq!(
            thick.message,
            "expected a minor_radius less than the major_radius, 1, found 1"
        );
        assert_eq!(thick.span, Some(15..16));
        assert!(error("major_radius = 0.1").message.ends_with("0.1, found 0.25"));
    }
}
