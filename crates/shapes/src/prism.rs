//! A prism: a simple polygon swept along the y axis.
//!
//! The ray is projected along the axis. The side of the projected line on which a vertex lies is
//! computed once for both of its edges, so that the line cannot pass between two of them, and the
//! edges that it crosses are entered and left in turn (Haines, *Point in Polygon Strategies*,
//! Graphics Gems IV, 1994). The heights clip the intervals between them, as the slabs of Kay and
//! Kajiya (1986) do.
//!
//! - Twin: hosted by the Mitsuba driver, in double precision; POV-Ray `prism` (native).
//! - Example: `scenes/shapes/prism.toml`.

use crate::support::frame::{Frame, UNIT};
use crate::support::near::comes_near_ball;
use crate::support::outline::{
    Crossing, Crossings, Line, MAX_POINTS, Points, edges, end_beyond, extent, pair_up, simple, twice_area,
    upright,
};
use crate::support::revolution::Heights;
use schemars::JsonSchema;
use serde::Deserialize;
use whitstone_core::config::Vector2;
use whitstone_core::{
    Aabb, Context, DVec2, DVec3, Interval, LoweredShape, Plugin, PreliminaryIntersection, Ray, SceneError,
    SceneErrors, Shape, ShapeHit, Shapes, Spans, SurfaceAttributes, SurfaceInteraction, SurfacePart,
    Transform, solid,
};

/// A simple polygon in the plane (x, z), convex or concave, swept along the y axis and closed by
/// caps; its normals point outward.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// The 3 to 4096 corners [x, z] of the cross-section in object space, in metres, in either
    /// sense. The last edge returns to the first point. Edges may meet only at their common point.
    #[schemars(with = "Vec<Vector2>", extend("minItems" = 3, "maxItems" = MAX_POINTS))]
    outline: Points,
    /// Lower and upper end along y, in metres.
    #[serde(default = "heights")]
    #[schemars(with = "Vector2")]
    y: Heights,
}

fn heights() -> Heights {
    Heights([0.0, 1.0])
}

/// Lower limit on twice the area of the outline, relative to the diagonal of its bounding rectangle
/// squared.
const LEAST_AREA: f64 = 1e-9;

/// A side of the prism, in the plane of the outline.
struct Side {
    from: DVec2,
    to: DVec2,
    /// Unit normal; it points outward.
    normal: DVec2,
    length: f64,
    /// Length of the outline before this side.
    before: f64,
}

/// The prism in world space.
///
/// Its own axes x, y, z are the axes z, x, y of object space: it stands along z. Primitives are the
/// sides, then the lower and the upper cap.
pub struct Prism {
    frame: Frame,
    sides: Vec<Side>,
    /// Whether the outline runs counter-clockwise, seen from above.
    counter_clockwise: bool,
    perimeter: f64,
    heights: [f64; 2],
    bounds: Aabb,
    /// Bounding ball in world space.
    center: DVec3,
    radius: f64,
    /// Bounding ball in the prism's own space.
    own_center: DVec3,
    own_radius: f64,
}

impl Plugin<Shapes> for Prism {
    const TYPE: &'static str = "prism";
    type Config = Config;

    fn build(config: Config, transform: Transform, _: &mut dyn Context) -> Result<LoweredShape, SceneErrors> {
        let outline: Vec<DVec2> = simple(&config.outline, 3, true)?
            .into_iter()
            .map(|p| DVec2::new(p.y, p.x))
            .collect();
        let here = |message: &str| SceneError::at(config.outline.span(), message);
        let twice_area = twice_area(&outline);
        if twice_area.abs() <= LEAST_AREA * extent(&outline).length_squared() {
            return Err(here("this outline encloses no area").into());
        }
        let Heights(heights) = config.y;
        let too_large = "the transform moves a corner out of the range of double precision";
        let transform = upright(transform).ok_or_else(|| here(too_large))?;
        let prism = Self::new(Frame::new(transform), &outline, twice_area > 0.0, heights);
        if !prism.bounds.is_finite() || !prism.radius.is_finite() {
            return Err(here(too_large).into());
        }
        Ok(LoweredShape::Custom(Box::new(prism)))
    }
}

impl Prism {
    fn new(frame: Frame, outline: &[DVec2], counter_clockwise: bool, heights: [f64; 2]) -> Self {
        let mut perimeter = 0.0;
        let sides = edges(outline).map(|(from, to)| {
            let (along, before) = (to - from, perimeter);
            let length = along.length();
            perimeter += length;
            let right = DVec2::new(along.y, -along.x) / length;
            Side {
                from,
                to,
                normal: if counter_clockwise { right } else { -right },
                length,
                before,
            }
        });
        let sides: Vec<Side> = sides.collect();
        let corners = || outline.iter().flat_map(move |p| heights.map(|z| p.extend(z)));
        let own = Aabb::around(corners());
        let own_center = own.center();
        let bounds = corners()
            .map(|p| frame.around_box(p, p))
            .fold(Aabb::EMPTY, Aabb::union);
        let center = bounds.center();
        let mut prism = Self {
            own_radius: 0.5 * own.extent().length(),
            own_center,
            frame,
            sides,
            counter_clockwise,
            perimeter,
            heights,
            bounds,
            center,
            radius: 0.0,
        };
        // Spawned rays start this far outside of the corners.
        prism.bounds = bounds.padded(2.0 * prism.largest_error());
        // Upper bound on the rounding error of the center and the extent.
        let rounding = 4.0 * f64::EPSILON * center.abs().max_element();
        prism.radius = (0.5 + 1e-9) * prism.bounds.extent().length() + rounding;
        prism
    }

    /// The largest error bound of a surface point. That of a face is largest at a corner.
    fn largest_error(&self) -> f64 {
        let error = |primitive: u32, prim_uv: DVec2| {
            self.surface_of(primitive, prim_uv, SurfaceAttributes::NOTHING)
                .error
        };
        let mut largest = 0.0_f64;
        for (side, primitive) in self.sides.iter().zip(0..) {
            for z in self.heights {
                for s in [0.0, 1.0] {
                    largest = largest.max(error(primitive, DVec2::new(s, z)));
                }
            }
            for upper in [false, true] {
                largest = largest.max(error(self.cap(upper), side.from));
            }
        }
        largest
    }

    /// The side with this number; `None` for a cap.
    fn side(&self, primitive: u32) -> Option<&Side> {
        self.sides.get(primitive as usize)
    }

    /// The number of a cap.
    fn cap(&self, upper: bool) -> u32 {
        self.sides.len() as u32 + u32::from(upper)
    }

    /// Unit normal of a primitive in the prism's own space.
    fn normal(&self, primitive: u32) -> DVec3 {
        match self.side(primitive) {
            Some(side) => side.normal.extend(0.0),
            None if primitive == self.cap(true) => DVec3::Z,
            None => DVec3::NEG_Z,
        }
    }

    /// The crossings of the sides by a line. `None` if it runs along the axis.
    fn crossings(&self, line: &Line) -> Option<Crossings> {
        let (o, d) = (line.origin.truncate(), line.direction.truncate());
        if d == DVec2::ZERO {
            return None;
        }
        let along_x = d.x.abs() >= d.y.abs();
        let mut found = Crossings::new();
        let side_of = |p: DVec2| d.perp_dot(p - o);
        let mut from = side_of(self.sides[0].from);
        for (side, primitive) in self.sides.iter().zip(0..) {
            let to = side_of(side.to);
            // On the line counts as on its left.
            if (from >= 0.0) != (to >= 0.0) {
                let s = from / (from - to);
                let p = side.from + s * (side.to - side.from);
                let t = if along_x {
                    (p.x - o.x) / d.x
                } else {
                    (p.y - o.y) / d.y
                };
                // The height of the hit is filled in by the caller.
                let hit = ShapeHit {
                    t,
                    primitive,
                    prim_uv: DVec2::new(s, 0.0),
                };
                let enters = (from >= 0.0) == self.counter_clockwise;
                found.push(Crossing { hit, enters });
            }
            from = to;
        }
        Some(found)
    }

    /// Whether the outline contains a point of its plane.
    fn contains(&self, p: DVec2) -> bool {
        self.sides.iter().fold(false, |inside, Side { from, to, .. }| {
            let (a, b) = (*from - p, *to - p);
            let crosses = (a.y > 0.0) != (b.y > 0.0) && (a.perp_dot(b) > 0.0) == (b.y > 0.0);
            inside ^ crosses
        })
    }

    /// Where a line enters the slab between the caps, and where it leaves it; the entry lies behind
    /// the exit if the line misses it.
    fn slab(&self, line: &Line) -> [ShapeHit; 2] {
        let (o, d) = (line.origin.z, line.direction.z);
        let [low, high] = self.heights;
        let downwards = d.is_sign_negative();
        let (first, last) = if downwards { (high, low) } else { (low, high) };
        let (near, far) = ((first - o) / d, (last - o) / d);
        // 0/0 is NaN and has no effect: the line lies in a cap.
        let near = if near.is_nan() { f64::NEG_INFINITY } else { near };
        let far = if far.is_nan() { f64::INFINITY } else { far };
        let hit = |t: f64, upper: bool| ShapeHit {
            primitive: self.cap(upper),
            ..ShapeHit::plain(t)
        };
        [hit(near, downwards), hit(far, !downwards)]
    }

    /// Completes a hit: the ray parameter, and the parameters of the surface.
    fn completed(&self, line: &Line, hit: ShapeHit) -> ShapeHit {
        let p = line.origin + hit.t * line.direction;
        let prim_uv = match self.side(hit.primitive) {
            Some(_) => DVec2::new(hit.prim_uv.x, p.z.clamp(self.heights[0], self.heights[1])),
            None => p.truncate(),
        };
        ShapeHit {
            t: line.moved + hit.t,
            prim_uv,
            ..hit
        }
    }

    /// The surface of a primitive: of a side at the fraction `prim_uv.x` of its length and the
    /// height `prim_uv.y`, of a cap at the point `prim_uv`.
    fn surface_of(&self, primitive: u32, prim_uv: DVec2, needs: SurfaceAttributes) -> SurfaceInteraction {
        let (p, slack, uv) = if let Some(side) = self.side(primitive) {
            let p = side.from + prim_uv.x * (side.to - side.from);
            // The product, the difference and the sum of the interpolation.
            let slack = 4.0 * UNIT * side.normal.abs().dot(side.from.abs() + side.to.abs());
            let [low, high] = self.heights;
            let u = (side.before + prim_uv.x * side.length) / self.perimeter;
            let uv = DVec2::new(u, (prim_uv.y - low) / (high - low));
            (p.extend(prim_uv.y), slack, uv)
        } else {
            let z = self.heights[usize::from(primitive == self.cap(true))];
            (prim_uv.extend(z), 0.0, prim_uv)
        };
        let normal = self.normal(primitive);
        let (position, error, n_g) = self.frame.point_with_gradient(p, normal, slack);
        let mut point = SurfaceInteraction::new(position, error, n_g);
        if needs.contains(SurfaceAttributes::UV) {
            point.uv = uv;
        }
        point
    }
}

impl Shape for Prism {
    fn bounds(&self) -> Aabb {
        self.bounds
    }

    fn intersect(&self, ray: &Ray, interval: Interval, origin_primitive: Option<u32>) -> Option<ShapeHit> {
        if !comes_near_ball(ray, self.center, self.radius) {
            return None;
        }
        let mut spans = Spans::new();
        self.spans(ray, &mut spans);
        let Some(origin) = origin_primitive else {
            return solid::first_end(&spans, interval, None);
        };
        let inside = self.goes_inside(ray, origin);
        end_beyond(&spans, inside, interval.min, |end, _| end.primitive == origin)
            .filter(|end| interval.contains(end.t))
    }

    fn surface(
        &self,
        _: &Ray,
        hit: &PreliminaryIntersection,
        needs: SurfaceAttributes,
    ) -> SurfaceInteraction {
        self.surface_of(hit.primitive, hit.prim_uv, needs)
    }

    fn surface_at_offset(
        &self,
        _: &SurfaceInteraction,
        hit: &PreliminaryIntersection,
        q: DVec3,
        needs: SurfaceAttributes,
    ) -> Option<SurfaceInteraction> {
        let p = self.frame.point_to_object(q);
        let prim_uv = match self.side(hit.primitive) {
            Some(side) => {
                let along = side.to - side.from;
                let s = (p.truncate() - side.from).dot(along) / along.length_squared();
                DVec2::new(s, p.z)
            }
            None => p.truncate(),
        };
        Some(self.surface_of(hit.primitive, prim_uv, needs))
    }

    fn is_solid(&self) -> bool {
        true
    }

    fn spans(&self, ray: &Ray, spans: &mut Spans) {
        let ray = self.frame.ray_to_object(ray);
        let line = Line::near(&ray, self.own_center, self.own_radius);
        let [entry, exit] = self.slab(&line);
        let mut push = |enter: ShapeHit, leave: ShapeHit| {
            // At a rim the side wins.
            let enter = if enter.t >= entry.t { enter } else { entry };
            let leave = if leave.t <= exit.t { leave } else { exit };
            if enter.t < leave.t {
                solid::push(spans, self.completed(&line, enter), self.completed(&line, leave));
            }
        };
        match self.crossings(&line) {
            Some(mut crossings) => pair_up(&mut crossings, push),
            None if self.contains(line.origin.truncate()) => push(entry, exit),
            None => {}
        }
    }

    fn goes_inside(&self, ray: &Ray, primitive: u32) -> bool {
        let ray = self.frame.ray_to_object(ray);
        self.normal(primitive).dot(ray.direction) < 0.0
    }

    fn primitives(&self) -> u32 {
        self.sides.len() as u32 + 2
    }

    fn parts(&self) -> Vec<SurfacePart> {
        let place = |p: DVec3, axis: usize| self.frame.point(p, axis).0;
        let [low, high] = self.heights;
        let caps = [false, true].map(|upper| {
            let (corners, filled) = covering(&self.sides);
            let z = self.heights[usize::from(upper)];
            SurfacePart::Polygon {
                normal: (if upper { 1.0 } else { -1.0 }) * self.frame.normal(2),
                corners: corners.into_iter().map(|p| place(p.extend(z), 2)).collect(),
                filled,
            }
        });
        let sides = self.sides.iter().zip(0..).map(|(side, primitive)| {
            let corners = [
                side.from.extend(low),
                side.to.extend(low),
                side.to.extend(high),
                side.from.extend(high),
            ];
            let point = self.surface_of(primitive, DVec2::ZERO, SurfaceAttributes::NOTHING);
            SurfacePart::Polygon {
                normal: point.n_g,
                corners: corners.map(|p| place(p, 2)).to_vec(),
                filled: true,
            }
        });
        caps.into_iter().chain(sides).collect()
    }
}

/// A convex polygon that contains the outline, and whether the outline fills it: the outline itself
/// if it is convex, otherwise its bounding rectangle.
fn covering(sides: &[Side]) -> (Vec<DVec2>, bool) {
    let along = |side: &Side| side.to - side.from;
    let next = sides.iter().cycle().skip(1);
    let turns = sides.iter().zip(next).map(|(a, b)| along(a).perp_dot(along(b)));
    let turns: Vec<f64> = turns.collect();
    // A simple polygon that always turns the same way is convex.
    if turns.iter().all(|turn| *turn >= 0.0) || turns.iter().all(|turn| *turn <= 0.0) {
        return (sides.iter().map(|side| side.from).collect(), true);
    }
    let all = Aabb::around(sides.iter().map(|side| side.from.extend(0.0)));
    let (min, max) = (all.min, all.max);
    let corners = [[min.x, min.y], [max.x, min.y], [max.x, max.y], [min.x, max.y]];
    (corners.map(DVec2::from_array).to_vec(), false)
}

#[cfg(test)]
mod tests {
    use super::*;
    use whitstone_core::InstanceId;
    use whitstone_testkit::{build, shape_laws_everywhere};

    /// The letter U, clockwise seen from above.
    const LETTER: &str =
        "outline = [[-1, -1], [1, -1], [1, 1], [0.4, 0.9], [0.5, -0.3], [-0.5, -0.5], [-0.6, 1], [-1, 1]]";

    fn prism(text: &str) -> Box<dyn Shape> {
        match build::<Shapes, Prism>(text, Transform::IDENTITY) {
            Ok(LoweredShape::Custom(prism)) => prism,
            Ok(_) => unreachable!("a prism is a custom shape"),
            Err(error) => panic!("{error}"),
        }
    }

    fn error(text: &str) -> SceneError {
        build::<Shapes, Prism>(text, Transform::IDENTITY)
            .err()
            .expect("it is refused")
            .0
            .remove(0)
    }

    /// Parameter and primitive of all hits in order.
    fn hits(prism: &dyn Shape, origin: [f64; 3], direction: [f64; 3]) -> Vec<(f64, u32)> {
        let ray = Ray::new(origin.into(), direction.into());
        let mut found = Vec::new();
        let mut interval = Interval::FORWARD;
        while let Some(hit) = prism.intersect(&ray, interval, None) {
            interval.min = hit.t;
            found.push((hit.t, hit.primitive));
        }
        found
    }

    #[test]
    fn obeys_the_laws_of_shapes() {
        shape_laws_everywhere::<Prism>(LETTER, 4_000);
        shape_laws_everywhere::<Prism>("outline = [[0, 0], [0, 1], [1, 0]]\ny = [-0.25, 2]", 2_000);
        // A gear, a star with slivers, and a round outline with many corners.
        let gear = |teeth: u32, low: f64| {
            let corner = |k: u32| {
                let (sin, cos) = (f64::from(k) * std::f64::consts::PI / f64::from(teeth)).sin_cos();
                let r = if k.is_multiple_of(2) { 1.0 } else { low };
                format!("[{:?}, {:?}]", r * cos, r * sin)
            };
            let corners: Vec<String> = (0..2 * teeth).map(corner).collect();
            format!("outline = [{}]\ny = [-1, 0.5]", corners.join(", "))
        };
        shape_laws_everywhere::<Prism>(&gear(12, 0.8), 2_000);
        shape_laws_everywhere::<Prism>(&gear(9, 0.15), 4_000);
        shape_laws_everywhere::<Prism>(&gear(300, 1.0), 1_000);
    }

    #[test]
    fn the_sense_of_the_outline_does_not_matter() {
        let mut points: Vec<&str> = "[-1, -1]; [1, -1]; [1, 1]; [0, 0]; [-1, 1]".split("; ").collect();
        for reversed in [false, true] {
            let prism = prism(&format!("outline = [{}]\ny = [0, 2]", points.join(", ")));
            // Through both arms: x is the first number of a point, z the second.
            let found = hits(&*prism, [-3.0, 1.0, 0.5], [1.0, 0.0, 0.0]);
            let at: Vec<f64> = found.iter().map(|hit| hit.0).collect();
            assert_eq!(at, [2.0, 2.5, 3.5, 4.0]);
            // From above and below: caps.
            let cap = |upper: u32| 5 + upper;
            assert_eq!(
                hits(&*prism, [-0.8, 5.0, 0.5], [0.0, -1.0, 0.0]),
                [(3.0, cap(1)), (5.0, cap(0))]
            );
            assert_eq!(hits(&*prism, [0.0, 5.0, 0.5], [0.0, -1.0, 0.0]), []);
            for (origin, direction) in [
                ([-3.0, 1.0, 0.5], [1.0, 0.0, 0.0]),
                ([0.2, 1.0, -4.0], [0.0, 0.0, 1.0]),
                ([-0.8, 5.0, 0.5], [0.0, -1.0, 0.0]),
                ([-0.8, -5.0, 0.5], [0.0, 1.0, 0.0]),
            ] {
                let ray = Ray::new(origin.into(), direction.into());
                let hit = prism.intersect(&ray, Interval::FORWARD, None).unwrap();
                let hit = hit.of_shape(InstanceId::TOP_LEVEL, 0);
                let point = prism.surface(&ray, &hit, SurfaceAttributes::NOTHING);
                assert!((point.n_g + ray.direction).length() < 1e-15, "{reversed} {ray:?}");
            }
            points.reverse();
        }
    }

    #[test]
    fn texture_coordinates_follow_the_outline() {
        let prism = prism("outline = [[0, 0], [3, 0], [3, 1], [0, 1]]\ny = [2, 4]");
        let uv = |origin: [f64; 3], direction: [f64; 3]| {
            let ray = Ray::new(origin.into(), direction.into());
            let hit = prism.intersect(&ray, Interval::FORWARD, None).unwrap();
            let hit = hit.of_shape(InstanceId::TOP_LEVEL, 0);
            (hit.primitive, prism.surface(&ray, &hit, SurfaceAttributes::UV).uv)
        };
        // The perimeter is 8.
        assert_eq!(uv([2.0, 3.0, -1.0], [0.0, 0.0, 1.0]), (0, DVec2::new(0.25, 0.5)));
        assert_eq!(
            uv([5.0, 2.5, 0.5], [-1.0, 0.0, 0.0]),
            (1, DVec2::new(0.4375, 0.25))
        );
        assert_eq!(
            uv([-5.0, 2.5, 0.5], [1.0, 0.0, 0.0]),
            (3, DVec2::new(0.9375, 0.25))
        );
        // On caps (z, x).
        assert_eq!(uv([2.5, 9.0, 0.75], [0.0, -1.0, 0.0]), (5, DVec2::new(0.75, 2.5)));
        assert_eq!(uv([2.5, 0.0, 0.75], [0.0, 1.0, 0.0]), (4, DVec2::new(0.75, 2.5)));
    }

    /// Rays through edges and corners: the sides have no cracks.
    #[test]
    fn no_ray_slips_between_two_sides() {
        let corner = |k: u32| {
            let (sin, cos) = (0.1 + f64::from(k) * std::f64::consts::TAU / 7.0).sin_cos();
            DVec2::new(cos, sin)
        };
        let corners: Vec<DVec2> = (0..7).map(corner).collect();
        let text: Vec<String> = corners
            .iter()
            .map(|p| format!("[{:?}, {:?}]", p.x, p.y))
            .collect();
        let prism = prism(&format!("outline = [{}]\ny = [-1, 1]", text.join(", ")));
        let mut random = whitstone_testkit::Random::new(11);
        for i in 0..20_000 {
            let p = corners[i % 7];
            let target = DVec3::new(p.x, 0.9 * random.signed(), p.y);
            // From inside, so that the ray must leave.
            let origin = 0.5 * DVec3::new(random.signed(), random.signed(), random.signed());
            let ray = Ray::new(origin, target - origin);
            let hit = prism.intersect(&ray, Interval::FORWARD, None);
            let t = hit.map_or(f64::NAN, |hit| hit.t);
            assert!((t - 1.0).abs() < 1e-12, "{ray:?} {t}");
        }
    }

    #[test]
    fn what_leaves_a_side_crosses_the_gap() {
        // From the inner side of the left arm of a U to that of the right one.
        let prism = prism("outline = [[0, 0], [3, 0], [3, 2], [2, 2], [2, 1], [1, 1], [1, 2], [0, 2]]");
        let leave = |x: f64, d: f64, primitive: u32| {
            let ray = Ray::new(DVec3::new(x, 0.5, 1.5), DVec3::new(d, 0.0, 0.0));
            prism
                .intersect(&ray, Interval::FORWARD, Some(primitive))
                .map(|hit| (hit.t, hit.primitive))
        };
        for x in [1.0, 1.0f64.next_up(), 1.0f64.next_down()] {
            let (t, primitive) = leave(x, 1.0, 5).unwrap();
            assert!((t - 1.0).abs() < 1e-15 && primitive == 3);
            let (t, primitive) = leave(x, -1.0, 5).unwrap();
            assert!((t - 1.0).abs() < 1e-15 && primitive == 7);
        }
        for x in [0.0, -f64::EPSILON, f64::EPSILON] {
            assert_eq!(leave(x, -1.0, 7), None);
        }
    }

    #[test]
    fn what_is_no_prism_is_refused() {
        let ring = |points: &str| error(&format!("outline = [{points}]"));
        let few = ring("[0, 0], [1, 0]");
        assert_eq!(few.message, "expected 3 to 4096 points, found 2");
        assert_eq!(few.span, Some(10..26));
        let again = ring("[0, 0], [1, 0], [1, 1], [0, 0]");
        assert_eq!(again.message, "points 0 and 3 of this outline coincide");
        assert_eq!(again.span, Some(35..41));
        assert!(again.help.is_some());
        let eight = ring("[0, 0], [2, 2], [2, 0], [0, 1]");
        assert_eq!(eight.message, "edges 0 and 2 of this outline intersect");
        let thin = ring("[0, 0], [1, 0], [2, 1e-10]");
        assert_eq!(thin.message, "this outline encloses no area");
        let huge = ring("[0, 0], [1e200, 0], [0, 1e200]");
        assert!(huge.message.contains("too far apart"));
        let heights = error("outline = [[0, 0], [1, 0], [0, 1]]\ny = [1, 1]");
        assert!(heights.message.contains("ascending order"), "{heights}");
        assert!(error("").message.contains("outline"));
    }
}
