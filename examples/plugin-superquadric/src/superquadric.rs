//! A superellipsoid (Barr, *Superquadrics and Angle-Preserving Transformations*, IEEE CG&A 1(1),
//! 1981).
//!
//! Its points satisfy N = 1 with N(x, y, z) = ‖(‖(x, y)‖_p, z)‖_q, p = 2/east_west, q =
//! 2/north_south, in units of the radii. For exponents up to 2, p and q are at least 1 and N is a
//! norm, so N - 1 is convex along a ray. Newton's method that starts outside and moves inwards
//! never overshoots the root of a convex function. It converges from one side, or reaches a point
//! where the function increases, and the ray misses. It needs no bracket and no tolerance, and does
//! not lose thin parts.
//!
//! - Twin: `superquadric.py`; the tests compare with bisection, and with the sphere and the
//!   octahedron that are its special cases.
//! - Example: `scenes/superquadric.toml`.

use schemars::JsonSchema;
use serde::Deserialize;
use std::f64::consts::{PI, TAU};
use toml::Spanned;
use whitstone_core::config::{Finite, Positive};
use whitstone_core::{
    Aabb, Context, DAffine3, DMat3, DVec2, DVec3, Interval, SurfaceAttributes, Plugin, Shape, ShapeHit, PreliminaryIntersection,
    Ray, SceneError, SceneErrors, LoweredShape, Shapes, Spans, SurfaceInteraction, Transform, solid,
};

/// A superellipsoid centred at the origin of its object space, with poles on the z axis. The normal
/// points away from the centre.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// Half extents along x, y and z in metres.
    #[serde(default = "ones")]
    radii: [Positive; 3],
    /// Roundness from pole to pole, from 0.1 to 2: towards 0 a cylinder with sharp rims, 1 round, 2
    /// pointed at the poles.
    #[serde(default)]
    #[schemars(with = "Option<f64>")]
    north_south: Option<Spanned<Finite>>,
    /// Roundness around the axis, from 0.1 to 2: towards 0 a square, 1 a circle, 2 a square rotated
    /// by 45 degrees.
    #[serde(default)]
    #[schemars(with = "Option<f64>")]
    east_west: Option<Spanned<Finite>>,
}

fn ones() -> [Positive; 3] {
    [Positive::new(1.0).expect("1 is positive"); 3]
}

/// The power of the norm for an exponent; 2 if there is none.
fn power(exponent: Option<Spanned<Finite>>, key: &str) -> Result<f64, SceneError> {
    let Some(exponent) = exponent else { return Ok(2.0) };
    let value = exponent.get_ref().get();
    if (0.1..=2.0).contains(&value) {
        return Ok(2.0 / value);
    }
    let message = format!("expected a {key} from 0.1 to 2, found {value}");
    let error = SceneError::at(exponent.span(), message);
    Err(error.with_help("above 2 it is not convex, below 0.1 its edges are too sharp: use a box"))
}

/// A superellipsoid in an object space where it extends from -1 to 1.
pub struct Superquadric {
    transform: Transform,
    p: f64,
    q: f64,
    /// Error bound of object coordinates after a transform to world space and back, per unit along
    /// each axis.
    slant: DMat3,
    bounds: Aabb,
}

/// Half an ulp of 1: the relative error of one rounding.
const UNIT: f64 = 0.5 * f64::EPSILON;

/// Relative error bound of the norm: two powers and a root of less than an ulp each, twice, and
/// their arguments.
const SLACK: f64 = 20.0 * UNIT;

impl Plugin<Shapes> for Superquadric {
    const TYPE: &'static str = "superquadric";
    type Config = Config;

    fn build(config: Config, transform: Transform, _: &mut dyn Context) -> Result<LoweredShape, SceneErrors> {
        let mut errors = SceneErrors::default();
        let p = errors.take(power(config.east_west, "east_west").map_err(SceneErrors::from));
        let q = errors.take(power(config.north_south, "north_south").map_err(SceneErrors::from));
        let radii = DVec3::from_array(config.radii.map(Positive::get));
        let scaled = *transform.world_from_object() * DAffine3::from_scale(radii);
        let transform = Transform::new(scaled).ok_or_else(|| {
            SceneErrors::from(SceneError::anywhere("the radii are too large or too small for double precision"))
        });
        let transform = errors.take(transform);
        match (p, q, transform) {
            (Some(p), Some(q), Some(transform)) => Ok(LoweredShape::Custom(Box::new(Self::new(transform, p, q)))),
            _ => Err(errors),
        }
    }
}

/// A line parametrised from its point nearest to the centre: the point at `s` is `middle + s d`.
struct Line {
    middle: DVec3,
    d: DVec3,
    /// The ray parameter at `s` is `(start + s) * scale`.
    start: f64,
    scale: f64,
}

impl Line {
    fn new(ray: &Ray) -> Self {
        let scale = power_of_two_below_inverse(ray.direction);
        let d = scale * ray.direction;
        let a = d.length_squared();
        let along = |s: f64, o: DVec3| DVec3::new(s.mul_add(d.x, o.x), s.mul_add(d.y, o.y), s.mul_add(d.z, o.z));
        // Applied twice, to remove the error of the first parameter from a distant origin.
        let first = -ray.origin.dot(d) / a;
        let near = along(first, ray.origin);
        let more = -near.dot(d) / a;
        Self {
            middle: along(more, near),
            d,
            start: first + more,
            scale,
        }
    }

    fn at(&self, s: f64) -> DVec3 {
        self.middle + s * self.d
    }

    fn hit(&self, s: f64) -> ShapeHit {
        ShapeHit {
            t: (self.start + s) * self.scale,
            primitive: 0,
            // Parameter on the line, which is more accurate than t for distant origins.
            prim_uv: DVec2::new(s, 0.0),
        }
    }

    /// The part inside a slightly enlarged cube from -1 to 1. NaN, for a ray within a face,
    /// compares false and changes nothing.
    fn in_cube(&self) -> Option<(f64, f64)> {
        let (mut from, mut to) = (f64::NEG_INFINITY, f64::INFINITY);
        for axis in 0..3 {
            let (o, d) = (self.middle[axis], self.d[axis]);
            let side = (1.0 + 1e-9_f64).copysign(d);
            let (near, far) = ((-side - o) / d, (side - o) / d);
            if near > from {
                from = near;
            }
            if far < to {
                to = far;
            }
        }
        (from < to).then_some((from, to))
    }
}

/// A power of two that scales the largest coordinate to between 1 and 2.
fn power_of_two_below_inverse(v: DVec3) -> f64 {
    let exponent = (v.abs().max_element().to_bits() >> 52).clamp(1, 2045);
    f64::from_bits((2046 - exponent) << 52)
}

/// ‖(a, b)‖_p of non-negative numbers, and its derivatives. Scaled so that no power exceeds 1.
fn norm(a: f64, b: f64, p: f64) -> (f64, f64, f64) {
    let most = a.max(b);
    if most == 0.0 {
        return (0.0, 0.0, 0.0);
    }
    let sum = (a / most).powf(p) + (b / most).powf(p);
    let norm = most * sum.powf(1.0 / p);
    (norm, (a / norm).powf(p - 1.0), (b / norm).powf(p - 1.0))
}

impl Superquadric {
    fn new(transform: Transform, p: f64, q: f64) -> Self {
        let forward = transform.world_from_object().matrix3;
        let inverse = transform.object_from_world().matrix3;
        let residual = inverse * forward - DMat3::IDENTITY;
        let slant = residual.abs() + 4.0 * UNIT * (inverse.abs() * forward.abs());
        let cube = Aabb {
            min: DVec3::NEG_ONE,
            max: DVec3::ONE,
        };
        let bounds = transform.aabb_to_world(&cube);
        let most = bounds.min.abs().max(bounds.max.abs()).max_element();
        let steep = (forward.abs() * (slant * DVec3::ONE)).max_element();
        Self {
            bounds: bounds.padded(32.0 * f64::EPSILON * most + 4.0 * steep),
            transform,
            p,
            q,
            slant,
        }
    }

    /// N and its gradient.
    fn value(&self, point: DVec3) -> (f64, DVec3) {
        let v = point.abs();
        let (r, by_x, by_y) = norm(v.x, v.y, self.p);
        let (n, by_r, by_z) = norm(r, v.z, self.q);
        let gradient = DVec3::new(by_r * by_x, by_r * by_y, by_z);
        (n, gradient.copysign(point))
    }

    /// N - 1 along a line, and its derivative.
    fn along(&self, line: &Line, s: f64) -> (f64, f64) {
        let (n, gradient) = self.value(line.at(s));
        (n - 1.0, gradient.dot(line.d))
    }

    /// The first intersection, before `to`, of a line that starts outside. Newton's method does not
    /// overshoot the root.
    fn enters(&self, line: &Line, from: f64, to: f64) -> Option<f64> {
        let mut s = from;
        // At a tangent, each step halves the remaining distance: more steps than binary digits
        // suffice.
        for _ in 0..128 {
            let (value, slope) = self.along(line, s);
            if value <= 0.0 {
                return Some(s);
            }
            if slope >= 0.0 {
                return None;
            }
            let next = s - value / slope;
            if next > to {
                return None;
            }
            if next <= s {
                return Some(s);
            }
            s = next;
        }
        Some(s)
    }

    /// Parameters of entry and exit.
    fn crossings(&self, line: &Line) -> Option<[f64; 2]> {
        let (from, to) = line.in_cube()?;
        let enter = self.enters(line, from, to)?;
        let back = Line {
            d: -line.d,
            ..*line
        };
        let exit = -self.enters(&back, -to, -enter)?;
        Some([enter, exit])
    }

    fn line(&self, ray: &Ray) -> Line {
        Line::new(&self.transform.ray_to_object(ray))
    }

    /// Derivative of N along the ray at its origin: positive if the ray leaves the surface.
    fn slope_at_start(&self, line: &Line) -> f64 {
        self.along(line, -line.start).1
    }
}

impl Shape for Superquadric {
    fn bounds(&self) -> Aabb {
        self.bounds
    }

    fn intersect(&self, ray: &Ray, interval: Interval, origin_primitive: Option<u32>) -> Option<ShapeHit> {
        let line = self.line(ray);
        // The shape is convex: rays that leave it outwards do not hit it again, and rays that go
        // inside hit the exit only.
        let leaving = origin_primitive.is_some();
        if leaving && self.slope_at_start(&line) >= 0.0 {
            return None;
        }
        let [enter, exit] = self.crossings(&line)?.map(|s| line.hit(s));
        let enters = !leaving && enter.t > interval.min.max(0.0);
        let hit = if enters { enter } else { exit };
        interval.contains(hit.t).then_some(hit)
    }

    fn surface(&self, ray: &Ray, hit: &PreliminaryIntersection, needs: SurfaceAttributes) -> SurfaceInteraction {
        let met = self.line(ray).at(hit.prim_uv.x);
        let (n, gradient) = self.value(met);
        let p = met / n;
        let forward = self.transform.world_from_object();
        let across = self.transform.object_from_world().matrix3.transpose() * gradient;
        let length = across.length();
        let normal = across / length;
        let position = forward.transform_point3(p);
        // The error of N divided by the length of its world-space gradient is the distance to the
        // surface. The roundings of three products and three sums are added.
        let slack = (gradient.abs().dot(self.slant * p.abs()) + SLACK) / length;
        let terms = forward.translation.abs() + forward.matrix3.abs() * p.abs();
        let error = slack + 5.0 * UNIT * normal.abs().dot(terms);
        let mut point = SurfaceInteraction::new(position, error, normal);
        if needs.contains(SurfaceAttributes::UV) {
            let around = p.y.atan2(p.x);
            let around = if around < 0.0 { around + TAU } else { around };
            let down = p.truncate().length().atan2(p.z);
            point.uv = DVec2::new(around / TAU, 1.0 - down / PI);
        }
        point
    }

    fn is_solid(&self) -> bool {
        true
    }

    fn spans(&self, ray: &Ray, spans: &mut Spans) {
        let line = self.line(ray);
        if let Some([enter, exit]) = self.crossings(&line) {
            solid::push(spans, line.hit(enter), line.hit(exit));
        }
    }

    fn goes_inside(&self, ray: &Ray, _: u32) -> bool {
        self.slope_at_start(&self.line(ray)) < 0.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use whitstone_testkit::{Random, build};

    whitstone_testkit::shape_laws!(
        Superquadric,
        "",
        "north_south = 0.3\neast_west = 0.3",
        "north_south = 2\neast_west = 2",
        "north_south = 0.1\neast_west = 2",
        "radii = [1, 2, 0.5]\nnorth_south = 1.5\neast_west = 0.5",
        "north_south = 0.1..2\neast_west = 0.1..2",
    );

    fn shape(text: &str) -> Box<dyn Shape> {
        match build::<Shapes, Superquadric>(text, Transform::IDENTITY) {
            Ok(LoweredShape::Custom(shape)) => shape,
            _ => panic!("it is a custom shape"),
        }
    }

    /// Rays from outside towards the ball of radius 3 around the centre.
    fn rays(count: usize) -> impl Iterator<Item = Ray> {
        let mut random = Random::new(7);
        (0..count).map(move |_| {
            let origin = 4.0 * random.direction();
            Ray::new(origin, (1.2 * random.cube() - origin).normalize())
        })
    }

    /// The first of 3000 steps along the ray where the sum of powers falls below 1, refined by
    /// bisection.
    fn by_bisection(ray: &Ray, [north_south, east_west]: [f64; 2]) -> Option<f64> {
        let outside = |t: f64| {
            let p = ray.at(t).abs();
            let around = p.x.powf(2.0 / east_west) + p.y.powf(2.0 / east_west);
            around.powf(east_west / north_south) + p.z.powf(2.0 / north_south) > 1.0
        };
        let places = (0..3000).map(|i| f64::from(i) * 2e-3 + 1.0);
        let (mut before, mut behind) = places.map(|t| (t, t + 2e-3)).find(|(_, t)| !outside(*t))?;
        while behind - before > 4.0 * f64::EPSILON * behind {
            let middle = 0.5 * (before + behind);
            if outside(middle) { before = middle } else { behind = middle }
        }
        Some(before)
    }

    #[test]
    fn agrees_with_bisection() {
        for exponents in [[1.0, 1.0], [0.2, 0.2], [1.7, 0.4], [2.0, 2.0], [0.1, 1.3]] {
            let [north_south, east_west] = exponents;
            let shape = shape(&format!("north_south = {north_south}\neast_west = {east_west}"));
            let mut hits = 0;
            for ray in rays(500) {
                let ours = shape.intersect(&ray, Interval::FORWARD, None).map(|hit| hit.t);
                let Some(expected) = by_bisection(&ray, exponents) else {
                    // The steps may miss a corner.
                    continue;
                };
                let ours = ours.expect("what is hit by bisection is hit");
                assert!((ours - expected).abs() < 1e-9, "{exponents:?}: {ours} and {expected}");
                hits += 1;
            }
            assert!(hits > 100, "{exponents:?}: {hits} hits");
        }
    }

    #[test]
    fn becomes_a_sphere_and_an_octahedron() {
        for ray in rays(500) {
            let round = shape("").intersect(&ray, Interval::FORWARD, None);
            let b = ray.origin.dot(ray.direction);
            let discriminant = b * b - ray.origin.length_squared() + 1.0;
            assert_eq!(round.is_some(), discriminant > 0.0);
            if let Some(hit) = round {
                assert!((hit.t - (-b - discriminant.sqrt())).abs() < 1e-12 / discriminant.sqrt());
            }
            let pointed = shape("north_south = 2\neast_west = 2").intersect(&ray, Interval::FORWARD, None);
            if let Some(hit) = pointed {
                let sum = ray.at(hit.t).abs().element_sum();
                assert!((sum - 1.0).abs() < 1e-14, "{sum}");
            }
        }
    }

    #[test]
    fn exponents_out_of_range_are_told_at_their_place() {
        let errors = build::<Shapes, Superquadric>("north_south = 3\neast_west = 0", Transform::IDENTITY);
        let errors = errors.err().expect("both are refused").0;
        let spans: Vec<_> = errors.iter().map(|error| error.span.clone()).collect();
        assert_eq!(spans, [Some(28..29), Some(14..15)]);
    }
}
