//! A lathe: a polyline turned about the y axis.
//!
//! Each segment makes a cone, a cylinder, a disk or a ring (Haines, *Essential ray tracing
//! algorithms*, in Glassner (ed.), *An Introduction to Ray Tracing*, 1989, ch. 2, 5.2). Whether the
//! ray passes the circle of a point inside or outside is computed once for both of its segments, so
//! that the ray cannot pass between two of them: a segment is crossed once if its ends differ, and
//! otherwise never or twice. The discriminant is written as a difference of squares that are
//! products of coordinates, because that of the quadratic equation cancels where the ray starts far
//! away; the roots are the non-cancelling forms of Press et al., *Numerical Recipes*, 5.6.
//!
//! - Twin: hosted by the Mitsuba driver, in double precision; POV-Ray `lathe` (native).
//! - Example: `scenes/shapes/lathe.toml`.

use crate::support::conic::angle;
use crate::support::frame::{Frame, UNIT};
use crate::support::near::{check_radius, comes_near_ball, goes_on};
use crate::support::outline::{
    Crossing, Crossings, Line, MAX_POINTS, Points, end_beyond, extent, pair_up, simple, twice_area, upright,
};
use schemars::JsonSchema;
use serde::Deserialize;
use whitstone_core::config::Vector2;
use whitstone_core::{
    Aabb, Context, DVec2, DVec3, Interval, LoweredShape, Plugin, PreliminaryIntersection, Ray, SceneError,
    SceneErrors, Shape, ShapeHit, Shapes, Spans, SurfaceAttributes, SurfaceInteraction, SurfacePart,
    Transform, solid,
};

/// A polyline turned about the y axis. If both of its ends lie on the axis it is closed, and its
/// normals point outward; otherwise they point away from the axis where the polyline goes up.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// The 2 to 4096 points [r, y] in object space, in metres: distance from the axis, at least 0,
    /// and height. Segments may meet only at their common point, and none may lie on the axis.
    #[schemars(with = "Vec<Vector2>", extend("minItems" = 2, "maxItems" = MAX_POINTS))]
    outline: Points,
}

/// Lower limit on twice the area between a closed outline and the axis, relative to the diagonal of
/// the bounding rectangle squared.
const LEAST_AREA: f64 = 1e-9;
/// Upper limit on coordinates, in metres: keeps squares finite.
const MAX_REACH: f64 = 1e150;

/// A segment of the outline, in the plane (r, z).
struct Segment {
    from: DVec2,
    to: DVec2,
    /// Unit vector.
    along: DVec2,
    length: f64,
    /// Length of the outline before this segment.
    before: f64,
}

/// The lathe in world space.
///
/// Its own axes x, y, z are the axes z, x, y of object space: it stands along z. Primitives are the
/// segments.
pub struct Lathe {
    frame: Frame,
    segments: Vec<Segment>,
    /// Whether both ends of the outline lie on the axis.
    closed: bool,
    /// 1 if the normals are on the right of the outline, where r grows to the right and z up; -1 if
    /// they are on its left.
    side: f64,
    total: f64,
    bounds: Aabb,
    /// Bounding ball in world space.
    center: DVec3,
    radius: f64,
    /// Bounding ball in the lathe's own space.
    own_center: DVec3,
    own_radius: f64,
}

impl Plugin<Shapes> for Lathe {
    const TYPE: &'static str = "lathe";
    type Config = Config;

    fn build(config: Config, transform: Transform, _: &mut dyn Context) -> Result<LoweredShape, SceneErrors> {
        let points = config.outline.get_ref();
        if let Some(point) = points.iter().find(|point| point.get_ref().get().x < 0.0) {
            let [r, y] = point.get_ref().get().to_array();
            let message = format!("expected a distance from the axis of at least 0, found [{r}, {y}]");
            return Err(SceneError::at(point.span(), message).into());
        }
        let outline = simple(&config.outline, 2, false)?;
        let here = |message: String| SceneError::at(config.outline.span(), message);
        if let Some(k) = outline.windows(2).position(|ends| ends[0].x + ends[1].x == 0.0) {
            let message = format!("points {k} and {} of this outline both lie on the axis", k + 1);
            let error = SceneError::at(points[k + 1].span(), message);
            let help = "a closed outline only begins and ends on the axis";
            return Err(error.with_help(help).into());
        }
        let size = extent(&outline);
        check_radius(size.length()).map_err(|error| here(error.message))?;
        let closed = outline[0].x == 0.0 && outline[outline.len() - 1].x == 0.0;
        let twice_area = twice_area(&outline);
        if closed && twice_area.abs() <= LEAST_AREA * size.length_squared() {
            return Err(here("this outline encloses no area with the axis".to_owned()).into());
        }
        let too_large =
            || here("the transform moves a point out of the range of double precision".to_owned());
        let transform = upright(transform).ok_or_else(too_large)?;
        let lathe = Self::new(
            Frame::new(transform),
            &outline,
            closed,
            if closed && twice_area < 0.0 { -1.0 } else { 1.0 },
        );
        let reach = lathe.bounds.min.abs().max(lathe.bounds.max.abs());
        // Written so that NaN fails.
        if !reach.cmplt(DVec3::splat(MAX_REACH)).all() {
            return Err(too_large().into());
        }
        Ok(LoweredShape::Custom(Box::new(lathe)))
    }
}

impl Lathe {
    fn new(frame: Frame, outline: &[DVec2], closed: bool, side: f64) -> Self {
        let mut total = 0.0;
        let segments = outline.windows(2).map(|ends| {
            let (from, to) = (ends[0], ends[1]);
            let (length, before) = (from.distance(to), total);
            total += length;
            Segment {
                from,
                to,
                along: (to - from) / length,
                length,
                before,
            }
        });
        let segments: Vec<Segment> = segments.collect();
        let low = outline.iter().fold(f64::INFINITY, |low, p| low.min(p.y));
        let high = outline.iter().fold(f64::NEG_INFINITY, |high, p| high.max(p.y));
        let widest = outline.iter().fold(0.0_f64, |widest, p| widest.max(p.x));
        let around = |p: &DVec2| frame.around_disk(DVec3::new(0.0, 0.0, p.y), p.x);
        let bounds = outline.iter().map(around).fold(Aabb::EMPTY, Aabb::union);
        let center = bounds.center();
        // Upper bound on the rounding error of the center and the extent.
        let rounding = 4.0 * f64::EPSILON * center.abs().max_element();
        Self {
            frame,
            segments,
            closed,
            side,
            total,
            bounds,
            center,
            radius: (0.5 + 1e-9) * bounds.extent().length() + rounding,
            own_center: DVec3::new(0.0, 0.0, 0.5 * (low + high)),
            own_radius: libm::hypot(0.5 * (high - low), widest),
        }
    }

    /// All crossings of a line, measured from its own origin.
    fn crossings(&self, line: &Line) -> Crossings {
        let (o, d) = (line.origin.truncate(), line.direction.truncate());
        let (height, slope) = (line.origin.z, line.direction.z);
        // Where the line passes the height of a point, and whether it is outside of its circle
        // there.
        let pass = |point: DVec2| {
            if slope == 0.0 {
                let above = point.y > height;
                return (if above { f64::INFINITY } else { f64::NEG_INFINITY }, true);
            }
            let t = (point.y - height) / slope;
            let within = (o + t * d).length_squared() < point.x * point.x;
            (t, !within)
        };
        let mut found = Crossings::new();
        let mut from = pass(self.segments[0].from);
        for (segment, primitive) in self.segments.iter().zip(0..) {
            let to = pass(segment.to);
            let ends = if from.0 <= to.0 { [from, to] } else { [to, from] };
            let hit = |t: f64, prim_uv: DVec2| ShapeHit {
                t: line.moved + t,
                primitive,
                prim_uv,
            };
            if !segment.is_flat() {
                let roots = segment.roots(o, d, [height, slope], ends);
                found.extend(roots.into_iter().flatten().map(|(t, outward)| Crossing {
                    hit: hit(t, DVec2::ZERO),
                    enters: outward != (self.side * segment.along.y > 0.0),
                }));
            } else if from.1 != to.1 {
                // The normal is along z.
                found.push(Crossing {
                    hit: hit(from.0, o + from.0 * d),
                    enters: self.side * segment.along.x * slope > 0.0,
                });
            }
            from = to;
        }
        found
    }

    /// The surface of a segment near a point of the lathe's own space, extrapolated beyond its ends
    /// if `extrapolated`.
    fn surface_near(
        &self,
        p: DVec3,
        primitive: u32,
        extrapolated: bool,
        needs: SurfaceAttributes,
    ) -> SurfaceInteraction {
        let segment = &self.segments[primitive as usize];
        let (around, r) = (p.truncate(), p.truncate().length());
        let outward = if r > 0.0 { around / r } else { DVec2::X };
        let s = (DVec2::new(r, p.z) - segment.from).dot(segment.along);
        let s = if extrapolated {
            s
        } else {
            s.clamp(0.0, segment.length)
        };
        let on = segment.from + s * segment.along;
        let DVec2 { x: a_r, y: a_z } = segment.along;
        // At an apex the normal is along the axis.
        let across = if r > 0.0 || a_r == 0.0 { a_z } else { 0.0 };
        let gradient = self.side * (across * outward).extend(-a_r);
        // The distance, the unit vectors and their products.
        let terms = (segment.from.abs() + segment.to.abs()) + 2.0 * segment.length;
        let slack = 6.0 * UNIT * (a_z.abs() * terms.x + a_r.abs() * terms.y);
        let p = (on.x * outward).extend(on.y);
        let (position, error, n_g) = self.frame.point_with_gradient(p, gradient, slack);
        let mut point = SurfaceInteraction::new(position, error, n_g);
        if needs.contains(SurfaceAttributes::UV) {
            point.uv = DVec2::new(angle(around.x, around.y), (segment.before + s) / self.total);
        }
        point
    }

    /// Whether a ray in the lathe's own space that starts on a segment leaves it on the side of the
    /// normal.
    fn goes_outward(&self, ray: &Ray, primitive: u32) -> bool {
        let segment = &self.segments[primitive as usize];
        let (p, d) = (ray.origin.truncate(), ray.direction.truncate());
        let r = p.length();
        let away = if r > 0.0 { p.dot(d) / r } else { 0.0 };
        self.side * (segment.along.y * away - segment.along.x * ray.direction.z) >= 0.0
    }
}

impl Segment {
    /// Whether the surface of the segment is flat.
    fn is_flat(&self) -> bool {
        self.from.y == self.to.y
    }

    /// The crossings of a cone or cylinder by the line `o + t d`, `height + t slope`: the
    /// parameter, and whether the line goes away from the axis there. The last argument has the
    /// parameters at both ends in order, and whether the line is outside there.
    fn roots(
        &self,
        o: DVec2,
        d: DVec2,
        [height, slope]: [f64; 2],
        [(first, first_outside), (last, last_outside)]: [(f64, bool); 2],
    ) -> [Option<(f64, bool)>; 2] {
        // A cone is convex: it is not left between two points inside.
        if first.partial_cmp(&last) != Some(std::cmp::Ordering::Less) || !(first_outside || last_outside) {
            return [None; 2];
        }
        let DVec2 { x: a_r, y: a_z } = self.along;
        // The radius at t, times a_z, is radius + t rise. The function is
        // a t² + 2 b t + c = a_z² |o + t d|² - (radius + t rise)².
        let radius = a_z * self.from.x + a_r * (height - self.from.y);
        let rise = a_r * slope;
        let a = (a_z * a_z) * d.length_squared() - rise * rise;
        let b = (a_z * a_z) * o.dot(d) - radius * rise;
        let start = a_z.abs() * o.length();
        let c = (start - radius.abs()) * (start + radius.abs());
        // The discriminant over a_z².
        let (v, w) = ((radius * d - rise * o).length(), (a_z * o.perp_dot(d)).abs());
        let discriminant = (v - w) * (v + w);
        let root = a_z.abs() * discriminant.max(0.0).sqrt();
        let q = -(b + root.copysign(b));
        // The function falls at one root and rises at the other.
        let (falls, rises) = if b >= 0.0 { (q / a, c / q) } else { (c / q, q / a) };
        let inside = |t: f64| if t.is_nan() { first } else { t.clamp(first, last) };
        if first_outside != last_outside {
            let t = if first_outside { falls } else { rises };
            return [Some((inside(t), last_outside)), None];
        }
        let nearest = -b / a;
        let dips = a > 0.0 && discriminant > 0.0 && first < nearest && nearest < last;
        if !dips {
            return [None; 2];
        }
        [Some((inside(falls), false)), Some((inside(rises), true))]
    }
}

impl Shape for Lathe {
    fn bounds(&self) -> Aabb {
        self.bounds
    }

    fn intersect(&self, ray: &Ray, interval: Interval, origin_primitive: Option<u32>) -> Option<ShapeHit> {
        if !comes_near_ball(ray, self.center, self.radius) {
            return None;
        }
        let local = self.frame.ray_to_object(ray);
        // A flat segment is not hit again. A cone or cylinder is convex: from outside it is not hit
        // again, from inside only where the ray leaves it.
        let own = |hit: &ShapeHit, enters: bool| {
            let Some(origin) = origin_primitive.filter(|origin| *origin == hit.primitive) else {
                return false;
            };
            let segment = &self.segments[origin as usize];
            // Whether the normal points away from the axis.
            let away = self.side * segment.along.y > 0.0;
            segment.is_flat() || self.goes_outward(&local, origin) == away || enters == away
        };
        if self.closed {
            let mut spans = Spans::new();
            self.spans(ray, &mut spans);
            let Some(origin) = origin_primitive else {
                return solid::first_end(&spans, interval, None);
            };
            let inside = !self.goes_outward(&local, origin);
            return end_beyond(&spans, inside, interval.min, |end, exit| own(end, !exit))
                .filter(|end| interval.contains(end.t));
        }
        let line = Line::near(&local, self.own_center, self.own_radius);
        self.crossings(&line)
            .into_iter()
            .filter(|crossing| interval.contains(crossing.hit.t) && !own(&crossing.hit, crossing.enters))
            .map(|crossing| crossing.hit)
            .reduce(|best, hit| {
                let nearer = (hit.t, hit.primitive) < (best.t, best.primitive);
                if nearer { hit } else { best }
            })
    }

    fn surface(
        &self,
        ray: &Ray,
        hit: &PreliminaryIntersection,
        needs: SurfaceAttributes,
    ) -> SurfaceInteraction {
        let segment = &self.segments[hit.primitive as usize];
        let p = if segment.is_flat() {
            hit.prim_uv.extend(segment.from.y)
        } else {
            self.frame.point_to_object(ray.at(hit.t))
        };
        self.surface_near(p, hit.primitive, false, needs)
    }

    fn surface_at_offset(
        &self,
        point: &SurfaceInteraction,
        hit: &PreliminaryIntersection,
        q: DVec3,
        needs: SurfaceAttributes,
    ) -> Option<SurfaceInteraction> {
        let q = self.frame.point_to_object(q);
        Some(goes_on(self.surface_near(q, hit.primitive, true, needs), point))
    }

    fn is_solid(&self) -> bool {
        self.closed
    }

    fn spans(&self, ray: &Ray, spans: &mut Spans) {
        if !self.closed {
            return;
        }
        let ray = self.frame.ray_to_object(ray);
        let line = Line::near(&ray, self.own_center, self.own_radius);
        pair_up(&mut self.crossings(&line), |enter, exit| {
            solid::push(spans, enter, exit);
        });
    }

    fn goes_inside(&self, ray: &Ray, primitive: u32) -> bool {
        !self.goes_outward(&self.frame.ray_to_object(ray), primitive)
    }

    fn primitives(&self) -> u32 {
        self.segments.len() as u32
    }

    fn parts(&self) -> Vec<SurfacePart> {
        let mut parts = Vec::new();
        for segment in &self.segments {
            let DVec2 { x: r, y: z } = segment.from;
            if segment.is_flat() {
                let side = -self.side * segment.along.x.signum();
                let mut part = self.frame.round_face(side, z, r.max(segment.to.x));
                if let SurfacePart::Polygon { filled, .. } = &mut part {
                    *filled = r.min(segment.to.x) == 0.0;
                }
                parts.push(part);
            } else if r == segment.to.x
                && self.side * segment.along.y > 0.0
                && let Some(scale) = self.frame.similarity_scale()
            {
                let place = |z: f64| self.frame.point(DVec3::new(0.0, 0.0, z), 2).0;
                parts.push(SurfacePart::Cylinder {
                    ends: [place(z), place(segment.to.y)],
                    radius: scale * r,
                });
            }
        }
        parts
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use whitstone_core::InstanceId;
    use whitstone_testkit::{Random, build, shape_laws_everywhere};

    /// A goblet: closed, with a foot, a thin stem and a hollow cup.
    const GOBLET: &str = "outline = [[0, -1], [0.7, -1], [0.7, -0.9], [0.15, -0.7], [0.1, 0], [0.7, 0.2], [0.8, 1], [0.7, 1], [0.6, 0.3], [0, 0.1]]";

    fn lathe(text: &str) -> Box<dyn Shape> {
        match build::<Shapes, Lathe>(text, Transform::IDENTITY) {
            Ok(LoweredShape::Custom(lathe)) => lathe,
            Ok(_) => unreachable!("a lathe is a custom shape"),
            Err(error) => panic!("{error}"),
        }
    }

    fn error(text: &str) -> SceneError {
        build::<Shapes, Lathe>(text, Transform::IDENTITY)
            .err()
            .expect("it is refused")
            .0
            .remove(0)
    }

    /// Parameter and primitive of all hits in order.
    fn hits(lathe: &dyn Shape, origin: [f64; 3], direction: [f64; 3]) -> Vec<(f64, u32)> {
        let ray = Ray::new(origin.into(), direction.into());
        let mut found = Vec::new();
        let mut interval = Interval::FORWARD;
        while let Some(hit) = lathe.intersect(&ray, interval, None) {
            interval.min = hit.t;
            found.push((hit.t, hit.primitive));
        }
        found
    }

    #[test]
    fn obeys_the_laws_of_shapes() {
        shape_laws_everywhere::<Lathe>(GOBLET, 4_000);
        shape_laws_everywhere::<Lathe>("outline = [[0, 0], [1, 0], [0, 1]]", 2_000);
        shape_laws_everywhere::<Lathe>("outline = [[0, 1], [1, 1], [1, -1], [0, -1]]", 2_000);
        // Open: a vase, a ring with a rim, and a bowl that goes down.
        shape_laws_everywhere::<Lathe>("outline = [[0.5, -1], [1, -0.5], [0.4, 0.5], [0.8, 1]]", 2_000);
        shape_laws_everywhere::<Lathe>("outline = [[0.3, 0], [1, 0], [1, 0.5]]", 2_000);
        shape_laws_everywhere::<Lathe>("outline = [[1, 1], [0.8, 0.3], [0.4, 0.05], [0, 0]]", 2_000);
        // Cones that almost are disks and cylinders; an hourglass whose waist is a point.
        shape_laws_everywhere::<Lathe>(
            "outline = [[0, 0], [1, 1e-7], [1.0000001, 0.5], [0.5, 0.5000001], [0, 0.5]]",
            2_000,
        );
        shape_laws_everywhere::<Lathe>("outline = [[0, -1], [1, -1], [0, 0], [1, 1], [0, 1]]", 2_000);
    }

    #[test]
    fn a_ray_meets_the_segments_in_order() {
        let goblet = lathe(GOBLET);
        // Through both walls of the cup, through the stem, and down along the axis.
        let across = hits(&*goblet, [3.0, 0.75, 0.0], [-1.0, 0.0, 0.0]);
        let at: Vec<u32> = across.iter().map(|hit| hit.1).collect();
        assert_eq!(at, [5, 7, 7, 5]);
        let outer = 0.7 + 0.1 * 0.55 / 0.8;
        assert!((across[0].0 - (3.0 - outer)).abs() < 1e-15 && (across[3].0 - (3.0 + outer)).abs() < 1e-15);
        let stem = hits(&*goblet, [3.0, -0.35, 0.0], [-1.0, 0.0, 0.0]);
        assert!((stem[0].0 - 2.875).abs() < 1e-15 && (stem[1].0 - 3.125).abs() < 1e-15 && stem.len() == 2);
        assert_eq!(
            hits(&*goblet, [0.0, 3.0, 0.0], [0.0, -1.0, 0.0])
                .iter()
                .map(|hit| hit.1)
                .collect::<Vec<_>>(),
            [8, 0]
        );
        // Above it, and past it.
        assert_eq!(hits(&*goblet, [3.0, 1.0f64.next_up(), 0.0], [-1.0, 0.0, 0.0]), []);
        assert_eq!(hits(&*goblet, [3.0, 0.0, 0.9], [-1.0, 0.0, 0.0]), []);
    }

    #[test]
    fn normals_point_outward_in_either_sense() {
        let mut points: Vec<&str> = "[0, 0]; [1, 0]; [1, 2]; [0.5, 2]; [0.5, 1]; [0, 1]"
            .split("; ")
            .collect();
        for _ in 0..2 {
            let pot = lathe(&format!("outline = [{}]", points.join(", ")));
            assert!(pot.is_solid());
            for (origin, direction) in [
                ([3.0, 1.5, 0.0], [-1.0, 0.0, 0.0]),
                ([0.0, 1.5, 0.0], [0.0, 0.0, 1.0]),
                ([0.2, 5.0, 0.1], [0.0, -1.0, 0.0]),
                ([0.2, -5.0, 0.1], [0.0, 1.0, 0.0]),
                ([0.75, 5.0, 0.0], [0.0, -1.0, 0.0]),
            ] {
                let ray = Ray::new(origin.into(), direction.into());
                let hit = pot.intersect(&ray, Interval::FORWARD, None).unwrap();
                let hit = hit.of_shape(InstanceId::TOP_LEVEL, 0);
                let point = pot.surface(&ray, &hit, SurfaceAttributes::NOTHING);
                assert!((point.n_g + ray.direction).length() < 1e-15, "{ray:?}");
            }
            points.reverse();
        }
        // An open one: to the right of the outline.
        for (outline, sign) in [("[[1, 0], [1, 1]]", 1.0), ("[[1, 1], [1, 0]]", -1.0)] {
            let tube = lathe(&format!("outline = {outline}"));
            let ray = Ray::new(DVec3::new(3.0, 0.5, 0.0), DVec3::NEG_X);
            let hit = tube.intersect(&ray, Interval::FORWARD, None).unwrap();
            let hit = hit.of_shape(InstanceId::TOP_LEVEL, 0);
            let point = tube.surface(&ray, &hit, SurfaceAttributes::NOTHING);
            assert_eq!(point.n_g, sign * DVec3::X);
        }
    }

    #[test]
    fn texture_coordinates_are_angle_and_length() {
        let pot = lathe("outline = [[0, 0], [1, 0], [1, 2], [0, 2]]");
        let uv = |origin: [f64; 3], direction: [f64; 3]| {
            let ray = Ray::new(origin.into(), direction.into());
            let hit = pot.intersect(&ray, Interval::FORWARD, None).unwrap();
            let hit = hit.of_shape(InstanceId::TOP_LEVEL, 0);
            (hit.primitive, pot.surface(&ray, &hit, SurfaceAttributes::UV).uv)
        };
        // The angle runs from z to x. The outline is 4 long.
        assert_eq!(uv([0.0, 0.5, 3.0], [0.0, 0.0, -1.0]), (1, DVec2::new(0.0, 0.375)));
        assert_eq!(uv([3.0, 1.0, 0.0], [-1.0, 0.0, 0.0]), (1, DVec2::new(0.25, 0.5)));
        assert_eq!(
            uv([0.0, 9.0, -0.5], [0.0, -1.0, 0.0]),
            (2, DVec2::new(0.5, 0.875))
        );
        assert_eq!(
            uv([-0.5, -9.0, 0.0], [0.0, 1.0, 0.0]),
            (0, DVec2::new(0.75, 0.125))
        );
    }

    /// Rays through the circles that two segments share: the surface has no cracks.
    #[test]
    fn no_ray_slips_between_two_segments() {
        let corners = [[0.9, -0.5], [1.0, 0.1], [0.7, 0.6]];
        let ball = lathe("outline = [[0, -1], [0.9, -0.5], [1, 0.1], [0.7, 0.6], [0, 0.8]]");
        let mut random = Random::new(11);
        for i in 0..30_000 {
            let [r, y] = corners[i % 3];
            let (sin, cos) = (std::f64::consts::TAU * random.unit()).sin_cos();
            let target = DVec3::new(r * cos, y, r * sin);
            // From inside, so that the ray must leave.
            let mut origin = 0.4 * DVec3::new(random.signed(), random.signed(), random.signed());
            if i % 5 == 0 {
                origin.y = y.clamp(-0.3, 0.3);
            }
            let ray = Ray::new(origin, target - origin);
            let hit = ball.intersect(&ray, Interval::FORWARD, None);
            let t = hit.map_or(f64::NAN, |hit| hit.t);
            assert!((t - 1.0).abs() < 1e-12, "{ray:?} {t}");
        }
    }

    #[test]
    fn what_leaves_the_inside_of_an_open_tube_crosses_it() {
        let tube = lathe("outline = [[1, -1], [1, 1]]");
        let leave = |x: f64, d: f64| {
            let ray = Ray::new(DVec3::new(x, 0.0, 0.0), DVec3::new(d, 0.0, 0.0));
            tube.intersect(&ray, Interval::FORWARD, Some(0)).map(|hit| hit.t)
        };
        for x in [1.0, 1.0f64.next_up(), 1.0f64.next_down()] {
            assert!((leave(x, -1.0).unwrap() - 2.0).abs() < 1e-15);
            assert_eq!(leave(x, 1.0), None);
        }
    }

    #[test]
    fn what_is_no_lathe_is_refused() {
        let of = |points: &str| error(&format!("outline = [{points}]"));
        let few = of("[0, 0]");
        assert_eq!(few.message, "expected 2 to 4096 points, found 1");
        let negative = of("[1, 0], [-0.5, 1]");
        assert_eq!(
            negative.message,
            "expected a distance from the axis of at least 0, found [-0.5, 1]"
        );
        assert_eq!(negative.span, Some(19..28));
        let axis = of("[1, 0], [0, 0], [0, 1], [1, 1]");
        assert_eq!(
            axis.message,
            "points 1 and 2 of this outline both lie on the axis"
        );
        assert_eq!(axis.span, Some(27..33));
        let again = of("[1, 0], [2, 1], [1, 0]");
        assert_eq!(again.message, "points 0 and 2 of this outline coincide");
        let crossing = of("[1, 0], [2, 2], [2, 0], [1, 2]");
        assert_eq!(crossing.message, "edges 0 and 2 of this outline intersect");
        let flat = of("[0, 0], [1, 0], [0, 1e-10]");
        assert_eq!(flat.message, "this outline encloses no area with the axis");
    }
}
