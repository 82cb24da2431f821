//! Quaternion Julia sets and the Mandelbulb, at a chosen iteration depth.
//!
//! The set of depth n is where the n-th iterate is shorter than 2; its boundary is an ordinary
//! level set. Hart, Sandin, Kauffman, *Ray tracing deterministic 3-D fractals*, SIGGRAPH 1989, step
//! through the outside by a distance bound. Here a *ball* of points is iterated, and its radius
//! grows as fast as the map can stretch it. If the whole ball escapes, or stays, it contains no
//! surface. This bound works in both directions. The remaining ranges are halved (see `crossings`).
//! The Mandelbulb is that of D. White and P. Nylander (2009), with powers of complex numbers
//! instead of angles.
//!
//! - Twin: POV-Ray `isosurface` with the iterates as nested functions.
//! - Example: `scenes/shapes/fractal.toml`.

use crate::support::crossings::{Along, RootCount, crossings};
use crate::support::level::{BOX_MARGIN, Level, Sample, Segment, check_search};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::ops::ControlFlow;
use toml::Spanned;
use whitstone_core::config::{Finite, IntegerIn};
use whitstone_core::{
    Aabb, Context, DVec2, DVec3, DVec4, Interval, LimitReached, LoweredShape, Plugin,
    PreliminaryIntersection, Ray, SceneError, SceneErrors, Shape, ShapeHit, Shapes, Spans, SurfaceAttributes,
    SurfaceInteraction, Transform,
};

/// Escape radius: longer iterates never return.
const ESCAPE: f64 = 2.0;
/// Iteration stops beyond this length, before numbers overflow.
const FAR: f64 = 1e30;
/// Upper bound on the rounding error of one iteration, relative to its terms.
const ROUNDING: f64 = 32.0 * f64::EPSILON;

/// Default power of a Mandelbulb.
const DEFAULT_POWER: u32 = 8;

/// A fractal set of a chosen iteration depth; the outside is where the iteration escapes.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// The iterated map: "julia" or "mandelbulb".
    kind: Kind,
    /// Number of iterations.
    #[serde(default = "eight")]
    depth: IntegerIn<1, 30>,
    /// Julia: the quaternion constant, real part first; its length is at most 2.
    #[serde(default)]
    #[schemars(extend("x-default" = "none: required for \"julia\""), with = "[Finite; 4]")]
    c: Option<Spanned<[Finite; 4]>>,
    /// Julia: the fourth coordinate of all points.
    #[serde(default)]
    #[schemars(extend("default" = 0), with = "Finite")]
    w: Option<Spanned<Finite>>,
    /// Mandelbulb: the power.
    #[serde(default)]
    #[schemars(extend("default" = DEFAULT_POWER), with = "IntegerIn<2, 16>")]
    power: Option<Spanned<IntegerIn<2, 16>>>,
}

fn eight() -> IntegerIn<1, 30> {
    IntegerIn::new(8).expect("in range")
}

/// See [`Config::kind`].
#[derive(Clone, Copy, Debug, Deserialize, Serialize, JsonSchema, PartialEq)]
#[serde(rename_all = "snake_case")]
enum Kind {
    /// z² + c in quaternions.
    Julia,
    /// A power of z plus the starting point.
    Mandelbulb,
}

/// The fractal in its object space.
pub struct Fractal {
    level: Level,
    map: Map,
    depth: u32,
}

/// The iterated map.
#[derive(Clone, Copy, Debug)]
enum Map {
    Julia { c: DVec4, w: f64 },
    Mandelbulb { power: u32 },
}

impl Plugin<Shapes> for Fractal {
    const TYPE: &'static str = "fractal";
    type Config = Config;

    fn build(config: Config, transform: Transform, _: &mut dyn Context) -> Result<LoweredShape, SceneErrors> {
        let mut errors = SceneErrors::default();
        let mut refuse = |span, message: &str| errors.0.push(SceneError::at(span, message));
        let map = match config.kind {
            Kind::Julia => {
                if let Some(power) = &config.power {
                    refuse(
                        power.span(),
                        "only a \"mandelbulb\" has a `power`; that of a \"julia\" is 2",
                    );
                }
                let Some(c) = config.c else {
                    return Err(SceneError::anywhere("missing key `c`, the quaternion constant").into());
                };
                let sum = DVec4::from_array(c.get_ref().map(Finite::get));
                if sum.length() > ESCAPE {
                    refuse(
                        c.span(),
                        &format!(
                            "expected a `c` of length at most 2, found length {}",
                            sum.length()
                        ),
                    );
                }
                let w = config.w.map_or(0.0, |w| w.get_ref().get());
                Map::Julia { c: sum, w }
            }
            Kind::Mandelbulb => {
                for span in [config.c.map(|c| c.span()), config.w.map(|w| w.span())]
                    .into_iter()
                    .flatten()
                {
                    refuse(span, "only a \"julia\" has `c` and `w`");
                }
                Map::Mandelbulb {
                    power: config.power.map_or(DEFAULT_POWER, |power| power.get_ref().get()),
                }
            }
        };
        errors.into_result(())?;
        let depth = config.depth.get();
        let mut shape = Self::new(map, depth, transform);
        check_search(&shape).map_err(|message| {
            SceneError::anywhere(message).with_help(format!("use less than {depth} as `depth`"))
        })?;
        shape.level.reset_search_limit();
        Ok(LoweredShape::Custom(Box::new(shape)))
    }
}

/// A product of two complex numbers.
fn product(a: DVec2, b: DVec2) -> DVec2 {
    DVec2::new(a.x * b.x - a.y * b.y, a.x * b.y + a.y * b.x)
}

/// The powers n - 1 and n of a complex number.
fn powers(a: DVec2, n: u32) -> (DVec2, DVec2) {
    let mut before = DVec2::X;
    for _ in 1..n {
        before = product(before, a);
    }
    (before, product(before, a))
}

/// An iterate with its derivatives along N directions.
#[derive(Clone, Copy)]
struct Orbit<const N: usize> {
    z: DVec4,
    slopes: [DVec4; N],
}

impl Map {
    fn start<const N: usize>(&self, p: DVec3, directions: [DVec3; N]) -> Orbit<N> {
        let w = match self {
            Self::Julia { w, .. } => *w,
            Self::Mandelbulb { .. } => 0.0,
        };
        Orbit {
            z: p.extend(w),
            slopes: directions.map(|d| d.extend(0.0)),
        }
    }

    /// The next iterate of a point that started at `first`.
    fn next<const N: usize>(&self, first: &Orbit<N>, Orbit { z, slopes }: &Orbit<N>) -> Orbit<N> {
        match self {
            Self::Julia { c, .. } => {
                let (a, v) = (z.x, DVec3::new(z.y, z.z, z.w));
                let join = |real: f64, rest: DVec3| DVec4::new(real, rest.x, rest.y, rest.z);
                Orbit {
                    z: join(a * a - v.length_squared(), 2.0 * a * v) + *c,
                    slopes: slopes.map(|slope| {
                        let (b, u) = (slope.x, DVec3::new(slope.y, slope.z, slope.w));
                        2.0 * join(a * b - v.dot(u), a * u + b * v)
                    }),
                }
            }
            Self::Mandelbulb { power } => {
                // r (cos, sin) of the polar angle from +z, then (cos, sin) of the azimuth about z.
                let from_axis = libm::hypot(z.x, z.y);
                let polar = DVec2::new(z.z, from_axis);
                let about = if from_axis > 0.0 {
                    DVec2::new(z.x, z.y) / from_axis
                } else {
                    DVec2::X
                };
                let (polar_before, polar_power) = powers(polar, *power);
                let about_power = powers(about, *power).1;
                let n = f64::from(*power);
                let at = (polar_power.y * about_power).extend(polar_power.x).extend(0.0);
                let slopes = std::array::from_fn(|i| {
                    let slope = slopes[i];
                    let flat = DVec2::new(slope.x, slope.y);
                    // Components away from the axis and around it.
                    let (out, around) = (about.dot(flat), about.perp_dot(flat));
                    let polar_slope = n * product(polar_before, DVec2::new(slope.z, out));
                    let turn = if from_axis > 0.0 {
                        n * around / from_axis
                    } else {
                        0.0
                    };
                    let sideways = polar_slope.y * about_power + (polar_power.y * turn) * about_power.perp();
                    sideways.extend(polar_slope.x).extend(0.0) + first.slopes[i]
                });
                Orbit {
                    z: at + first.z,
                    slopes,
                }
            }
        }
    }

    /// Radius of a ball around the next iterate of `z` that contains the next iterates of all
    /// points within `r` of `z`. The orbits of these points started in a ball of radius `first`.
    fn spread(&self, z: DVec4, r: f64, first: f64) -> f64 {
        let length = z.length();
        match self {
            // (z + e)² = z² + z e + e z + e², and quaternion lengths multiply.
            Self::Julia { c, .. } => r * (2.0 * length + r) + ROUNDING * (length * length + c.length()),
            Self::Mandelbulb { power } => {
                let n = f64::from(*power);
                let most = (length + r).powi(*power as i32 - 1);
                // Around the axis the map stretches by another factor of sin(n θ)/sin θ.
                let sine = (libm::hypot(z.x, z.y) - r) / (length + r);
                let around = if sine > 1.0 / n { 1.0 / sine } else { n };
                n * most * around * r + first + ROUNDING * n * (most * (length + r) + ESCAPE)
            }
        }
    }
}

/// Whether a ball of points stays, escapes, or may contain the surface.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Fate {
    Escapes,
    Stays,
    /// May contain the surface; true if a line through the ball's center crosses the surface at
    /// most once in the ball.
    Open(bool),
}

impl Fractal {
    fn new(map: Map, depth: u32, transform: Transform) -> Self {
        // No point of the set is longer: its first iterate would be longer than 2.
        let reach = match map {
            Map::Julia { c, .. } => (ESCAPE + c.length()).sqrt().min(ESCAPE),
            Map::Mandelbulb { power } => (0..60).fold(ESCAPE, |reach: f64, _| {
                libm::pow(ESCAPE + reach, 1.0 / f64::from(power))
            }),
        };
        let corner = DVec3::splat(reach * (1.0 + BOX_MARGIN));
        Self {
            level: Level::new(transform, -corner, corner),
            map,
            depth,
        }
    }

    /// ln(|z|²/4) of the last iterate, which is negative inside, and its derivatives.
    fn value<const N: usize>(&self, p: DVec3, directions: [DVec3; N]) -> (f64, [f64; N]) {
        let first = self.map.start(p, directions);
        let mut orbit = first;
        for _ in 0..self.depth {
            if orbit.z.length_squared() > FAR * FAR {
                break;
            }
            orbit = self.map.next(&first, &orbit);
        }
        let squared = orbit.z.length_squared();
        let slopes = orbit.slopes.map(|slope| 2.0 * orbit.z.dot(slope) / squared);
        (libm::log(0.25 * squared), slopes)
    }

    /// Classifies a ball, and the line through its center.
    fn fate(&self, center: DVec3, radius: f64, direction: DVec3) -> Fate {
        let first = self.map.start(center, [direction]);
        let (mut orbit, mut r, mut slope_r) = (first, radius, 0.0);
        for step in 0..=self.depth {
            let length = orbit.z.length();
            if length - r > ESCAPE {
                return Fate::Escapes;
            }
            if step == self.depth {
                if length + r < ESCAPE {
                    return Fate::Stays;
                }
                // Whether the derivative of |z|² along the line keeps its sign.
                let slope = orbit.slopes[0];
                let doubt = length * slope_r + r * (slope.length() + slope_r);
                return Fate::Open(orbit.z.dot(slope).abs() > doubt);
            }
            if r.is_nan() || r >= ESCAPE {
                break;
            }
            slope_r = match self.map {
                Map::Julia { .. } => {
                    let slope = orbit.slopes[0].length();
                    2.0 * (length * slope_r + r * (slope + slope_r)) + ROUNDING * length * slope
                }
                // The variation of the slopes has no bound near the axis.
                Map::Mandelbulb { .. } => f64::INFINITY,
            };
            r = self.map.spread(orbit.z, r, radius);
            orbit = self.map.next(&first, &orbit);
        }
        Fate::Open(false)
    }

    fn along<'a>(&'a self, segment: &'a Segment) -> Line<'a> {
        Line {
            shape: self,
            segment,
            length: segment.direction.length(),
        }
    }

    fn sample(&self, p: DVec3) -> Sample {
        let (value, gradient) = self.value(p, DVec3::AXES);
        // Iterate a ball of radius 0 to bound the rounding errors.
        let first = self.map.start(p, []);
        let (mut orbit, mut r) = (first, 0.0);
        for _ in 0..self.depth {
            r = self.map.spread(orbit.z, r, 0.0);
            orbit = self.map.next(&first, &orbit);
        }
        let length = orbit.z.length();
        Sample {
            value,
            gradient: DVec3::from_array(gradient),
            error: if r < 0.5 * length {
                4.0 * r / length
            } else {
                f64::INFINITY
            },
        }
    }
}

/// The last iterate along the part of a ray inside the box.
struct Line<'a> {
    shape: &'a Fractal,
    segment: &'a Segment,
    length: f64,
}

impl Along for Line<'_> {
    fn at(&self, s: f64) -> (f64, f64) {
        let (value, [slope]) = self.shape.value(self.segment.at(s), [self.segment.direction]);
        (value, slope)
    }

    fn over(&self, lo: f64, hi: f64) -> RootCount {
        let p = self.segment.at(0.5 * (lo + hi));
        let radius = 0.5 * (hi - lo) * self.length + f64::EPSILON * ESCAPE;
        match self.shape.fate(p, radius, self.segment.direction) {
            Fate::Escapes | Fate::Stays => RootCount::Zero,
            Fate::Open(true) => RootCount::AtMostOne,
            Fate::Open(false) => RootCount::Unknown,
        }
    }

    fn limit_reached(&self, s: f64) {
        self.shape.level.limit_reached(self.segment.at(s));
    }
}

impl Shape for Fractal {
    fn bounds(&self) -> Aabb {
        self.level.bounds()
    }

    fn intersect(&self, ray: &Ray, interval: Interval, origin_primitive: Option<u32>) -> Option<ShapeHit> {
        let ray = self.level.ray(ray);
        let segment = self.level.clip(&ray)?;
        let origin_primitive = origin_primitive.map(|_| self.value(ray.origin, [ray.direction]).1[0]);
        self.level
            .intersect(&ray, &segment, &self.along(&segment), origin_primitive, interval)
    }

    fn surface(&self, ray: &Ray, hit: &PreliminaryIntersection, _: SurfaceAttributes) -> SurfaceInteraction {
        let p = self.level.ray(ray).at(hit.t);
        self.level.surface(ray, p, |p| self.sample(p))
    }

    fn is_solid(&self) -> bool {
        true
    }

    fn spans(&self, ray: &Ray, spans: &mut Spans) {
        self.level.spans(&self.level.ray(ray), spans, |segment, tell| {
            crossings(&self.along(segment), |crossing| {
                tell(crossing, DVec2::ZERO);
                ControlFlow::Continue(())
            });
        });
    }

    fn search_limit(&self) -> Option<LimitReached> {
        self.level.search_limit()
    }

    fn goes_inside(&self, ray: &Ray, _: u32) -> bool {
        let ray = self.level.ray(ray);
        self.value(ray.origin, [ray.direction]).1[0] < 0.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use whitstone_testkit::{Random, build, shape_laws_everywhere};

    const C: [f64; 4] = [-0.2, 0.6, 0.2, 0.2];

    fn julia(depth: u32) -> Fractal {
        let map = Map::Julia {
            c: DVec4::from_array(C),
            w: 0.1,
        };
        Fractal::new(map, depth, Transform::IDENTITY)
    }

    fn bulb(power: u32, depth: u32) -> Fractal {
        Fractal::new(Map::Mandelbulb { power }, depth, Transform::IDENTITY)
    }

    /// Whether a point is in the set, computed with angles.
    fn is_inside(shape: &Fractal, p: DVec3) -> bool {
        let mut z = p.extend(0.1);
        for _ in 0..shape.depth {
            match shape.map {
                Map::Julia { c, .. } => {
                    // In the plane of the real axis and the imaginary part, squaring doubles the
                    // angle.
                    let rest = DVec3::new(z.y, z.z, z.w);
                    let (length, angle) = (z.length(), rest.length().atan2(z.x));
                    let unit = rest.normalize_or_zero();
                    let square = length * length * (2.0 * angle).sin() * unit;
                    z = DVec4::new(
                        length * length * (2.0 * angle).cos(),
                        square.x,
                        square.y,
                        square.z,
                    ) + c;
                }
                Map::Mandelbulb { power } => {
                    let q = z.truncate();
                    let n = f64::from(power);
                    let (r, theta) = (q.length(), q.x.hypot(q.y).atan2(q.z));
                    let (theta, phi) = (n * theta, n * q.y.atan2(q.x));
                    let turned = DVec3::new(theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos());
                    z = (r.powf(n) * turned + p).extend(0.0);
                }
            }
            if z.length() > 1e6 {
                return false;
            }
        }
        z.length() < 2.0
    }

    fn aimed(random: &mut Random) -> Ray {
        let origin = 3.0 * random.direction();
        Ray::new(origin, (0.8 * random.cube() - origin).normalize())
    }

    #[test]
    fn obeys_the_laws_of_shapes() {
        for depth in [1, 6] {
            let text = format!("kind = \"julia\"\nc = [-0.2, 0.6, 0.2, 0.2]\nw = 0.1\ndepth = {depth}");
            shape_laws_everywhere::<Fractal>(&text, 2_000);
        }
        shape_laws_everywhere::<Fractal>("kind = \"mandelbulb\"\ndepth = 2", 500);
        shape_laws_everywhere::<Fractal>("kind = \"mandelbulb\"\npower = 3\ndepth = 3", 500);
    }

    #[test]
    fn the_set_of_a_square_is_a_ball() {
        let map = Map::Julia {
            c: DVec4::ZERO,
            w: 0.0,
        };
        // The set is |z^8| < 2.
        let shape = Fractal::new(map, 3, Transform::IDENTITY);
        let ray = Ray::new(DVec3::new(0.0, 0.0, 4.0), DVec3::NEG_Z);
        let hit = shape.intersect(&ray, Interval::FORWARD, None).unwrap();
        assert!((hit.t - (4.0 - 2f64.powf(0.125))).abs() < 1e-14, "{hit:?}");
    }

    /// No point is inside before the first root, and a point just behind it is inside.
    #[test]
    fn roots_are_those_of_iteration_by_angles() {
        let mut random = Random::new(29);
        let mut missed_by_steps = 0;
        for shape in [
            julia(1),
            julia(4),
            julia(9),
            bulb(8, 1),
            bulb(8, 3),
            bulb(2, 5),
            bulb(5, 2),
        ] {
            let (mut hits, rays) = (0, 150);
            for _ in 0..rays {
                let ray = aimed(&mut random);
                let found = shape.intersect(&ray, Interval::FORWARD, None);
                let end = found.map_or(6.0, |hit| hit.t);
                let samples = 1000;
                let inside = (0..samples)
                    .filter(|i| is_inside(&shape, ray.at((end - 1e-9) * f64::from(*i) / f64::from(samples))));
                assert_eq!(inside.count(), 0, "{ray:?} {:?}", shape.map);
                let Some(hit) = found else { continue };
                hits += 1;
                // A thin feature may end before the next sample.
                let behind = (1..=40).any(|k| is_inside(&shape, ray.at(hit.t + 0.5f64.powi(k))));
                assert!(behind, "{ray:?} {hit:?} {:?}", shape.map);
                // Shows that the test can fail: steps of 0.05 miss thin features.
                let seen = (0..120)
                    .map(|i| 0.05 * f64::from(i))
                    .find(|t| is_inside(&shape, ray.at(*t)));
                missed_by_steps += usize::from(seen.is_none_or(|t| t > hit.t + 0.05));
            }
            assert!(hits > 40, "{hits} {:?}", shape.map);
        }
        assert!(missed_by_steps > 10, "{missed_by_steps}");
    }

    #[test]
    fn balls_hold_what_they_say() {
        let mut random = Random::new(30);
        let (mut told, mut open) = (0, 0);
        for shape in [julia(3), julia(8), bulb(8, 2), bulb(3, 4)] {
            for _ in 0..3_000 {
                let (center, radius) = (1.3 * random.cube(), 10f64.powf(-1.0 - 5.0 * random.unit()));
                let direction = random.direction();
                let fate = shape.fate(center, radius, direction);
                let at = |s: f64| shape.value(center + s * radius * direction, [direction]);
                match fate {
                    Fate::Open(false) => open += 1,
                    Fate::Open(true) => {
                        let sign = at(0.0).1[0] > 0.0;
                        assert!((-5..=5).all(|i| (at(f64::from(i) / 5.0).1[0] > 0.0) == sign));
                    }
                    fate => {
                        told += 1;
                        for _ in 0..6 {
                            let p = center + radius * random.unit() * random.direction();
                            assert_eq!(is_inside(&shape, p), fate == Fate::Stays, "{p} {:?}", shape.map);
                        }
                    }
                }
            }
        }
        assert!(told > 6_000 && open > 100, "{told} {open}");
    }

    /// A deeper set is a subset of a shallower one: along a ray, it is never hit earlier.
    #[test]
    fn depth_goes_one_way_and_ends() {
        let mut random = Random::new(31);
        for deepest in [julia(30), bulb(8, 30)] {
            let rays: Vec<Ray> = (0..60).map(|_| aimed(&mut random)).collect();
            let first = |depth: u32| -> Vec<f64> {
                let shape = Fractal::new(deepest.map, depth, Transform::IDENTITY);
                let t = |ray: &Ray| {
                    shape
                        .intersect(ray, Interval::FORWARD, None)
                        .map_or(10.0, |hit| hit.t)
                };
                rays.iter().map(t).collect()
            };
            let truth = first(30);
            let mut before = f64::INFINITY;
            let mut last: Option<Vec<f64>> = None;
            for depth in [1, 2, 3, 4, 6, 8, 11, 15, 20, 25] {
                let found = first(depth);
                if let Some(last) = last {
                    // At greater depths, rounding moves iterates by more than the sets differ.
                    let later = |(now, then): (&f64, &f64)| *now >= then - 1e-9;
                    assert!(depth > 15 || found.iter().zip(&last).all(later), "{depth}");
                }
                let squares = found.iter().zip(&truth).map(|(a, b)| (a - b) * (a - b));
                let error = (squares.sum::<f64>() / rays.len() as f64).sqrt();
                assert!(error <= before + 1e-3, "{depth}: {error} after {before}");
                (before, last) = (error, Some(found));
            }
        }
    }

    #[test]
    fn steps_are_few() {
        let mut random = Random::new(32);
        for (shape, mean) in [(julia(4), 100), (julia(12), 400), (bulb(8, 3), 1000)] {
            let rays = 400;
            let mut sum = 0;
            for _ in 0..rays {
                let ray = aimed(&mut random);
                let Some(segment) = shape.level.clip(&ray) else {
                    continue;
                };
                let length = segment.direction.length();
                let line = Line {
                    shape: &shape,
                    segment: &segment,
                    length,
                };
                sum += crossings(&line, |_| ControlFlow::Break(()));
            }
            assert!(sum < mean * rays, "{:?}: {}", shape.map, sum / rays);
        }
    }

    #[test]
    fn keys_of_the_other_kind_are_refused() {
        let message = |text: &str| {
            let error = build::<Shapes, Fractal>(text, Transform::IDENTITY)
                .err()
                .unwrap()
                .0
                .remove(0);
            error.message
        };
        assert!(message("kind = \"julia\"").starts_with("missing key `c`"));
        assert!(message("kind = \"julia\"\nc = [0, 0, 0, 0]\npower = 3").contains("mandelbulb"));
        assert!(message("kind = \"julia\"\nc = [2, 1, 0, 0]").contains("at most 2, found length"));
        assert!(message("kind = \"mandelbulb\"\nw = 0").contains("julia"));
        assert!(message("kind = \"mandelbulb\"\ndepth = 31").contains("from 1 to 30"));
        assert!(message("kind = \"mandelbrot\"").contains("unknown value"));
    }
}
