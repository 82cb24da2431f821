//! A flat polygon, convex or not.
//!
//! The vertices are sheared as in the watertight triangle test (Woop, Benthin, Wald, JCGT 2(1),
//! 2013, section 3), which depends on the ray alone. Then the edges that cross a half-axis are
//! counted (Shimrat, *Algorithm 112*, 1962, with the half-open rule of Haines, *Point in Polygon
//! Strategies*, Graphics Gems IV, 1994). The sign of each edge function is exact: if two polygons
//! share an edge and lie on opposite sides of it, a ray through the edge hits exactly one of them.
//! The validation of the vertices uses exact signs too (`outline.rs`).
//!
//! - Twin: hosted by the Mitsuba driver, in double precision; POV-Ray `polygon` (native).
//! - Example: `scenes/shapes/polygon.toml`.

use crate::support::outline::{edges, meeting_edges};
use schemars::JsonSchema;
use serde::Deserialize;
use toml::Spanned;
use whitstone_core::config::Vector3;
use whitstone_core::triangle::ShearedRay;
use whitstone_core::{
    Aabb, Context, DVec2, DVec3, Interval, LoweredShape, Plugin, PreliminaryIntersection, Ray, SceneError,
    SceneErrors, Shape, ShapeHit, Shapes, SurfaceAttributes, SurfaceInteraction, SurfacePart, Transform,
};

/// A planar simple polygon, convex or concave; its front face is counter-clockwise.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// The 3 to 4096 vertices in object space, in metres. They must be coplanar to 1e-9 of the
    /// diagonal of their bounding box. Edges may meet only at their common vertex.
    #[schemars(with = "Vec<Vector3>", extend("minItems" = 3, "maxItems" = 4096))]
    vertices: Spanned<Vec<Spanned<Vector3>>>,
}

/// Maximum number of vertices.
const MAX_VERTICES: usize = 4096;
/// Limit on the distance of a vertex from the plane, relative to the diagonal of the bounding box,
/// and lower limit on twice the area, relative to the diagonal squared.
const FLATNESS: f64 = 1e-9;

/// The polygon in world space.
pub struct Polygon {
    vertices: Vec<DVec3>,
    /// A point of the plane, and its unit normal.
    anchor: DVec3,
    normal: DVec3,
    bounds: Aabb,
    /// The object-space axis that texture coordinates drop.
    axis: usize,
    transform: Transform,
}

impl Plugin<Shapes> for Polygon {
    const TYPE: &'static str = "polygon";
    type Config = Config;

    fn build(config: Config, transform: Transform, _: &mut dyn Context) -> Result<LoweredShape, SceneErrors> {
        let place = config.vertices.span();
        let corners = config.vertices.into_inner();
        let error = |message: String| SceneErrors::from(SceneError::at(place.clone(), message));
        if !(3..=MAX_VERTICES).contains(&corners.len()) {
            let found = corners.len();
            return Err(error(format!(
                "expected 3 to {MAX_VERTICES} vertices, found {found}"
            )));
        }
        let vertices: Vec<DVec3> = corners.iter().map(|corner| corner.get_ref().get()).collect();
        let plane = Plane::through(&vertices).map_err(|(vertex, message)| match vertex {
            Some(vertex) => SceneErrors::from(SceneError::at(corners[vertex].span(), message)),
            None => error(message),
        })?;
        let flat: Vec<DVec2> = vertices.iter().map(|p| without(*p, plane.axis)).collect();
        if let Some([i, j]) = meeting_edges(&flat, true) {
            let mut problem = SceneError::at(place, format!("edges {i} and {j} of this polygon intersect"));
            let help = "edge k joins vertices k and k + 1, counted from 0; only adjacent edges may touch, at their common vertex";
            problem.help = Some(help.into());
            return Err(problem.into());
        }
        let vertices: Vec<DVec3> = vertices
            .into_iter()
            .map(|p| transform.point_to_world(p))
            .collect();
        let bounds = Aabb::around(vertices.iter().copied());
        if !bounds.is_finite() || !bounds.extent().is_finite() {
            return Err(error(
                "the transform moves a vertex out of the range of double precision".to_owned(),
            ));
        }
        Ok(LoweredShape::Custom(Box::new(Self {
            vertices,
            anchor: transform.point_to_world(plane.center),
            normal: transform.normal_to_world(plane.normal),
            bounds,
            axis: plane.axis,
            transform,
        })))
    }
}

/// The plane of a polygon in object space.
struct Plane {
    center: DVec3,
    /// Unit vector.
    normal: DVec3,
    /// The axis of the largest component of the normal; the first of equals.
    axis: usize,
}

impl Plane {
    /// Fits the plane. The error is a message with the index of the offending vertex, if there is
    /// one.
    fn through(vertices: &[DVec3]) -> Result<Self, (Option<usize>, String)> {
        let mut order: Vec<usize> = (0..vertices.len()).collect();
        order.sort_by(|i, j| {
            let [a, b] = [i, j].map(|i| (vertices[*i] + 0.0).to_array());
            let by = |k: usize| a[k].total_cmp(&b[k]);
            by(0).then(by(1)).then(by(2)).then(i.cmp(j))
        });
        if let Some(pair) = order
            .windows(2)
            .find(|pair| vertices[pair[0]] == vertices[pair[1]])
        {
            let message = format!("vertices {} and {} of this polygon coincide", pair[0], pair[1]);
            return Err((Some(pair[1]), message));
        }
        let extent = Aabb::around(vertices.iter().copied()).extent();
        let size = extent.length();
        if !(size * size).is_finite() {
            return Err((
                None,
                "the vertices are too far apart for double precision".to_owned(),
            ));
        }
        let first = vertices[0];
        let center = first + vertices.iter().map(|p| *p - first).sum::<DVec3>() / vertices.len() as f64;
        let twice_area: DVec3 = edges(vertices).map(|(a, b)| (a - center).cross(b - center)).sum();
        if twice_area.length() <= FLATNESS * size * size {
            let message = "this polygon encloses no area: its vertices lie on one line, or its edges cross so that the areas cancel";
            return Err((None, message.to_owned()));
        }
        let normal = twice_area.normalize();
        let distance = |p: DVec3| (p - center).dot(normal).abs();
        let (farthest, off) = vertices
            .iter()
            .map(|p| distance(*p))
            .enumerate()
            .fold((0, 0.0), |most, next| if next.1 > most.1 { next } else { most });
        if off > FLATNESS * size {
            let message = format!(
                "expected vertices in one plane to {:.1e} m, found vertex {farthest} {off:.1e} m away from it",
                FLATNESS * size
            );
            return Err((Some(farthest), message));
        }
        let largest = normal.abs().max_element() * (1.0 - 1e-9);
        let axis = (0..3).find(|axis| normal[*axis].abs() >= largest).unwrap_or(2);
        Ok(Self { center, normal, axis })
    }
}

/// The coordinates along the two axes that follow `axis` cyclically.
fn without(p: DVec3, axis: usize) -> DVec2 {
    DVec2::new(p[(axis + 1) % 3], p[(axis + 2) % 3])
}

/// Whether an edge crosses the positive x axis. `low` lies on or below the axis, `high` above it.
/// An edge through the origin does not count, so the origin belongs to the polygon on its right
/// (+x): of two polygons on opposite sides of a shared edge, exactly one contains the origin.
fn crosses(low: DVec3, high: DVec3) -> bool {
    let (left, right) = (low.x * high.y, low.y * high.x);
    if left.abs().min(right.abs()) < NO_UNDERFLOW {
        return is_product_greater([low.x, high.y], [low.y, high.x]);
    }
    if left != right {
        return left > right;
    }
    // The rounded products are equal: compare their rounding errors.
    low.x.mul_add(high.y, -left) > low.y.mul_add(high.x, -right)
}

/// Products of at least this magnitude, and their rounding errors, do not underflow.
const NO_UNDERFLOW: f64 = 1e-280;

/// Whether a product of two numbers is greater than another one; exact also where the products
/// underflow.
fn is_product_greater(left: [f64; 2], right: [f64; 2]) -> bool {
    let sign = |[a, b]: [f64; 2]| match a == 0.0 || b == 0.0 {
        true => 0.0,
        false => a.signum() * b.signum(),
    };
    let (left_sign, right_sign) = (sign(left), sign(right));
    if left_sign != right_sign || left_sign == 0.0 {
        return left_sign > right_sign;
    }
    // Both products have the same sign. Their factors are brought to magnitudes of 1 to 2, and the
    // exponents are compared.
    let [(l, left_exponent), (r, right_exponent)] = [left, right].map(|[a, b]| {
        let ((a, i), (b, j)) = (mantissa(a.abs()), mantissa(b.abs()));
        ([a, b], i + j)
    });
    // Products of mantissas are below 4: beyond this difference the exponents decide.
    let difference = (left_exponent - right_exponent).clamp(-4, 4);
    let first = l[0] * 2f64.powi(difference);
    let (p, q) = (first * l[1], r[0] * r[1]);
    let greater = match p == q {
        true => first.mul_add(l[1], -p) > r[0].mul_add(r[1], -q),
        false => p > q,
    };
    let equal = p == q && first.mul_add(l[1], -p) == r[0].mul_add(r[1], -q);
    if left_sign > 0.0 {
        greater
    } else {
        !greater && !equal
    }
}

/// A positive number as a factor from 1 to 2 times a power of two, whose exponent it returns.
fn mantissa(x: f64) -> (f64, i32) {
    const SCALE: i32 = 54;
    let (x, extra) = match x.is_normal() {
        true => (x, 0),
        false => (x * 2f64.powi(SCALE), -SCALE),
    };
    let exponent = (x.to_bits() >> 52) as i32 - 1023;
    let one_to_two = f64::from_bits(x.to_bits() & ((1 << 52) - 1) | 1.0_f64.to_bits());
    (one_to_two, exponent + extra)
}

impl Polygon {
    /// Intersects the ray with the plane: the ray parameter, the point, and the factor by which a
    /// grazing angle magnifies rounding errors. Infinite or NaN for parallel rays.
    fn meet(&self, ray: &Ray) -> (f64, DVec3, f64) {
        let (o, d, n) = (ray.origin, ray.direction, self.normal);
        let slope = n.dot(d);
        let first = n.dot(self.anchor - o) / slope;
        // The point at the first estimate is exact to one rounding, so the remaining distance can
        // be computed and added.
        let p = DVec3::new(
            first.mul_add(d.x, o.x),
            first.mul_add(d.y, o.y),
            first.mul_add(d.z, o.z),
        );
        let more = n.dot(self.anchor - p) / slope;
        (first + more, p + more * d, d.length() / slope.abs())
    }

    /// The corners of a bounding rectangle in the polygon's plane.
    fn around_in_plane(&self) -> Vec<DVec3> {
        let (x, y) = self.normal.any_orthonormal_pair();
        let flat = |p: &DVec3| DVec3::new((*p - self.anchor).dot(x), (*p - self.anchor).dot(y), 0.0);
        let Aabb { min, max } = Aabb::around(self.vertices.iter().map(flat));
        let corners = [[min.x, min.y], [max.x, min.y], [max.x, max.y], [min.x, max.y]];
        corners.map(|[u, v]| self.anchor + u * x + v * y).to_vec()
    }

    /// Bound on the rounding errors of coordinates near the polygon.
    fn rounding(&self) -> f64 {
        let reach = self.bounds.min.abs().max(self.bounds.max.abs()).max_element();
        4.0 * f64::EPSILON * reach
    }
}

impl Shape for Polygon {
    fn bounds(&self) -> Aabb {
        self.bounds
    }

    fn intersect(&self, ray: &Ray, interval: Interval, origin_primitive: Option<u32>) -> Option<ShapeHit> {
        if origin_primitive.is_some() {
            return None;
        }
        let (t, p, slant) = self.meet(ray);
        if !interval.contains(t) {
            return None;
        }
        // Upper bound on the error of points as the edge test below sees them from the ray origin.
        let far =
            ray.origin.abs().max_element() + self.bounds.min.abs().max(self.bounds.max.abs()).max_element();
        let margin = (1e-12 * self.bounds.extent().max_element() + 64.0 * f64::EPSILON * far) * slant;
        let within = self.bounds.padded(margin);
        if !(p.cmpge(within.min).all() && p.cmple(within.max).all()) {
            return None;
        }
        let sheared = ShearedRay::new(ray);
        let mut inside = false;
        let mut a = sheared.shear(self.vertices[self.vertices.len() - 1]);
        for vertex in &self.vertices {
            let b = sheared.shear(*vertex);
            if (a.y > 0.0) != (b.y > 0.0) {
                inside ^= if a.y > 0.0 { crosses(b, a) } else { crosses(a, b) };
            }
            a = b;
        }
        inside.then_some(ShapeHit {
            t,
            primitive: 0,
            prim_uv: DVec2::ZERO,
        })
    }

    fn surface(
        &self,
        ray: &Ray,
        _: &PreliminaryIntersection,
        needs: SurfaceAttributes,
    ) -> SurfaceInteraction {
        let (_, p, _) = self.meet(ray);
        // If the ray origin is distant, rounding may put a point at an edge outside the bounds.
        let p = p.clamp(self.bounds.min, self.bounds.max);
        let off = self.normal.dot(self.anchor - p);
        let position = p + off * self.normal;
        let mut point = SurfaceInteraction::new(position, self.rounding(), self.normal);
        if needs.contains(SurfaceAttributes::UV) {
            let origin = self.transform.world_from_object().translation;
            let local = self.transform.object_from_world().matrix3 * (position - origin);
            point.uv = without(local, self.axis);
        }
        point
    }

    fn parts(&self) -> Vec<SurfacePart> {
        let ring = self.vertices.iter().zip(self.vertices.iter().cycle().skip(1));
        let turns = ring
            .zip(self.vertices.iter().cycle().skip(2))
            .map(|((a, b), c)| (*b - *a).cross(*c - *b).dot(self.normal));
        // A simple polygon that always turns the same way is convex.
        let turns: Vec<f64> = turns.take(self.vertices.len()).collect();
        let filled = turns.iter().all(|turn| *turn >= 0.0) || turns.iter().all(|turn| *turn <= 0.0);
        let corners = if filled {
            self.vertices.clone()
        } else {
            self.around_in_plane()
        };
        vec![SurfacePart::Polygon {
            normal: self.normal,
            corners,
            filled,
        }]
    }

    fn surface_at_offset(
        &self,
        _: &SurfaceInteraction,
        hit: &PreliminaryIntersection,
        q: DVec3,
        needs: SurfaceAttributes,
    ) -> Option<SurfaceInteraction> {
        Some(self.surface(&Ray::new(q, self.normal), hit, needs))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fmt::Write;
    use whitstone_testkit::{Random, build, shape_laws_everywhere};

    /// The letter L with a slanted arm, in the plane z = x/2 + y/4.
    const LETTER: &str =
        "vertices = [[-1, -1, -0.75], [1, -1, 0.25], [1, 0, 0.5], [0, 0, 0], [-0.5, 1, 0], [-1, 1, -0.25]]";

    fn polygon(vertices: &[DVec3]) -> Box<dyn Shape> {
        let mut text = String::from("vertices = [");
        for p in vertices {
            write!(text, "[{:?}, {:?}, {:?}],", p.x, p.y, p.z).unwrap();
        }
        match build::<Shapes, Polygon>(&(text + "]"), Transform::IDENTITY) {
            Ok(LoweredShape::Custom(polygon)) => polygon,
            Ok(_) => unreachable!("a polygon is a custom shape"),
            Err(error) => panic!("{error}"),
        }
    }

    #[test]
    fn a_polygon_is_convex_wherever_its_vertices_begin() {
        let arrow = [(0.0, 0.0), (1.0, -1.0), (0.0, 2.0), (-1.0, -1.0)];
        let square = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)];
        for (outline, convex) in [(arrow, false), (square, true)] {
            for first in 0..outline.len() {
                for reversed in [false, true] {
                    let mut vertices: Vec<DVec3> =
                        outline.iter().map(|(x, y)| DVec3::new(*x, *y, 0.5)).collect();
                    vertices.rotate_left(first);
                    if reversed {
                        vertices.reverse();
                    }
                    let parts = polygon(&vertices).parts();
                    assert!(
                        matches!(parts[..], [SurfacePart::Polygon { filled, .. }] if filled == convex),
                        "{vertices:?}"
                    );
                }
            }
        }
    }

    fn is_hit(polygon: &dyn Shape, ray: &Ray) -> bool {
        polygon.intersect(ray, Interval::FORWARD, None).is_some()
    }

    fn error(text: &str) -> SceneError {
        build::<Shapes, Polygon>(text, Transform::IDENTITY)
            .err()
            .unwrap()
            .0
            .remove(0)
    }

    #[test]
    fn obeys_the_laws_of_shapes() {
        shape_laws_everywhere::<Polygon>(LETTER, 2_000);
    }

    #[test]
    fn what_is_cut_out_is_not_hit() {
        let star: Vec<DVec3> = (0..4096)
            .map(|k| {
                let (sin, cos) = (f64::from(k) * std::f64::consts::TAU / 4096.0).sin_cos();
                let r = if k % 2 == 0 { 1.0 } else { 0.5 };
                DVec3::new(r * cos, r * sin, 2.0)
            })
            .collect();
        let star = polygon(&star);
        for (x, hit) in [
            (0.0, true),
            (0.49, true),
            (0.999, true),
            (1.01, false),
            (-0.75, true),
        ] {
            let ray = Ray::new(DVec3::new(x, 0.0, 5.0), DVec3::NEG_Z);
            assert_eq!(is_hit(&*star, &ray), hit, "{x}");
        }
        // Between two tips of the star.
        let (sin, cos) = (std::f64::consts::TAU / 4096.0).sin_cos();
        let ray = Ray::new(DVec3::new(0.75 * cos, 0.75 * sin, 5.0), DVec3::NEG_Z);
        assert!(!is_hit(&*star, &ray));
    }

    /// The common form (Franklin's PNPOLY), which intersects the edge with the axis by a division.
    fn naive_hit(ring: &[DVec3], ray: &Ray) -> bool {
        let sheared = ShearedRay::new(ray);
        edges(ring).fold(false, |inside, (a, b)| {
            let (a, b) = (sheared.shear(a), sheared.shear(b));
            inside ^ ((a.y > 0.0) != (b.y > 0.0) && 0.0 < (b.x - a.x) * -a.y / (b.y - a.y) + a.x)
        })
    }

    /// A square cut by a jagged line, and a heptagonal fan bent in space: a ray through a shared
    /// edge or vertex hits exactly one part.
    #[test]
    fn of_those_that_share_edges_one_is_hit() {
        let mut random = Random::new(3);
        let cut: Vec<DVec3> = (0..=40)
            .map(|k| {
                let jag = if k % 2 == 0 { 0.0 } else { 0.3 * random.unit() };
                DVec3::new(jag, f64::from(k) / 20.0 - 1.0, 0.0)
            })
            .collect();
        let close = |x: f64| {
            let mut ring = cut.clone();
            ring.extend([DVec3::new(x, 1.0, 0.0), DVec3::new(x, -1.0, 0.0)]);
            ring
        };
        let tip = DVec3::new(0.1, -0.07, 0.2);
        let rim: Vec<DVec3> = (0..7)
            .map(|k| {
                let (sin, cos) = (0.3 + f64::from(k) * std::f64::consts::TAU / 7.0).sin_cos();
                DVec3::new(cos, sin, 0.1 * random.signed())
            })
            .collect();
        let fan: Vec<Vec<DVec3>> = edges(&rim).map(|(a, b)| vec![tip, a, b]).collect();
        let along: Vec<DVec3> = rim.iter().flat_map(|p| [*p, tip]).collect();
        let (mut naive_wrong, mut tested) = (0, 0);
        for (rings, line) in [(vec![close(-1.0), close(1.0)], &cut), (fan, &along)] {
            let parts: Vec<_> = rings.iter().map(|ring| polygon(ring)).collect();
            for i in 0..40_000 {
                let k = 1 + random.below(line.len() - 2);
                let target = match i % 3 {
                    0 => line[k],
                    1 => 0.5 * (line[k] + line[k - 1]),
                    _ => line[k] + random.unit() * (line[k - 1] - line[k]),
                };
                let on_rim = target.truncate().length() > 0.8 && line.len() == along.len();
                let side = DVec3::new(random.signed(), random.signed(), 1.5);
                let origin = target + [1.0, 30.0, 1e6][random.below(3)] * side;
                let ray = Ray::new(origin, target - origin);
                if on_rim {
                    continue;
                }
                let hits = parts.iter().filter(|part| is_hit(&***part, &ray)).count();
                assert_eq!(hits, 1, "{ray:?}");
                tested += 1;
                naive_wrong += usize::from(rings.iter().filter(|ring| naive_hit(ring, &ray)).count() != 1);
            }
        }
        println!("PNPOLY: {naive_wrong} of {tested} wrong");
        assert!(naive_wrong > 100, "the naive way must fail: {naive_wrong}");
    }

    /// Rays that pass an edge at the smallest distance that a double can hold, on either side: the
    /// products of the edge functions underflow.
    #[test]
    fn rays_next_to_an_edge_are_on_one_side_of_it() {
        let mut random = Random::new(5);
        let tiny = f64::from_bits(1);
        let mut naive_wrong = 0;
        for _ in 0..200 {
            let [left, right] = [-1.0 - random.unit(), 1.0 + random.unit()];
            let ring = [
                DVec3::new(left, 0.0, 0.0),
                DVec3::new(right, 0.0, 0.0),
                DVec3::new(left + 0.4 * random.unit(), 1.0, 0.0),
            ];
            let above = polygon(&ring);
            let below = polygon(&ring.map(|p| DVec3::new(p.x, -p.y, 0.0)));
            // The last ray passes a vertex, outside of the edge that goes up from there to the
            // right.
            let rays = [
                (0.0, tiny),
                (0.0, -tiny),
                (0.5 * random.signed(), tiny),
                (left, tiny),
            ];
            for (x, y) in rays {
                let ray = Ray::new(DVec3::new(x, y, 3.0), DVec3::NEG_Z);
                assert_eq!(is_hit(&*above, &ray), y > 0.0 && x > left, "{x} {y}: {ring:?}");
                assert_eq!(is_hit(&*below, &ray), y < 0.0 && x > left, "{x} {y}: {ring:?}");
                let corners = ring.map(|p| p.truncate() - ray.origin.truncate());
                let crossed = edges(&corners).filter(|(a, b)| {
                    let (low, high) = if a.y > 0.0 { (b, a) } else { (a, b) };
                    (a.y > 0.0) != (b.y > 0.0) && low.x * high.y > low.y * high.x
                });
                naive_wrong += usize::from((crossed.count() % 2 == 1) != (y > 0.0 && x > left));
            }
            // A slanted edge through the origin, both of whose ends have tiny coordinates.
            let slanted = [
                DVec3::new(-3.0, -tiny, 0.0),
                DVec3::new(5.0, 2.0 * tiny, 0.0),
                DVec3::new(0.0, 1.0, 0.0),
            ];
            let slanted = polygon(&slanted);
            for x in [0.0, 0.2, -0.2] {
                // At y = 0 the edge is at x = -1/3.
                let ray = Ray::new(DVec3::new(x, 0.0, 3.0), DVec3::NEG_Z);
                assert_eq!(is_hit(&*slanted, &ray), x < -1.0 / 3.0, "{x}");
            }
        }
        assert!(naive_wrong > 50, "the naive way must fail: {naive_wrong}");
    }

    #[test]
    fn products_are_compared_exactly() {
        let tiny = f64::from_bits(1);
        let values = [
            0.0,
            tiny,
            3.0 * tiny,
            1e-310,
            1e-160,
            0.1,
            1.0,
            1.0f64.next_up(),
            1e160,
            1e300,
        ];
        let signed = values.iter().flat_map(|x| [*x, -x]).collect::<Vec<_>>();
        // The logarithms decide where they differ clearly.
        let (mut decided, mut naive_wrong) = (0, 0);
        for a in &signed {
            for b in &signed {
                for c in &signed {
                    for d in &signed {
                        let sign = |x: f64, y: f64| {
                            if x * y == 0.0 && (x == 0.0 || y == 0.0) {
                                0.0
                            } else {
                                x.signum() * y.signum()
                            }
                        };
                        let log = |x: f64, y: f64| x.abs().log2() + y.abs().log2();
                        let found = is_product_greater([*a, *b], [*c, *d]);
                        let (s, t) = (sign(*a, *b), sign(*c, *d));
                        let expected = if s != t || s == 0.0 {
                            s > t
                        } else if (log(*a, *b) - log(*c, *d)).abs() > 1e-9 {
                            (log(*a, *b) > log(*c, *d)) == (s > 0.0)
                        } else {
                            continue;
                        };
                        assert_eq!(found, expected, "{a} {b} {c} {d}");
                        decided += 1;
                        naive_wrong += usize::from((a * b > c * d) != expected);
                    }
                }
            }
        }
        assert!(decided > 100_000 && naive_wrong > 1000, "{decided} {naive_wrong}");
        let up = 1.0f64.next_up();
        assert!(is_product_greater([up, tiny], [1.0, tiny]) && !is_product_greater([1.0, tiny], [up, tiny]));
        assert!(
            !is_product_greater([-up, tiny], [1.0, -tiny]) && is_product_greater([-1.0, tiny], [up, -tiny])
        );
        assert!(!is_product_greater([3.0, tiny], [1.0, 3.0 * tiny]));
    }

    #[test]
    fn texture_coordinates_leave_the_largest_axis_out() {
        let flat = polygon(&[DVec3::ZERO, DVec3::new(0.0, 2.0, 0.0), DVec3::new(0.0, 2.0, 3.0)]);
        let ray = Ray::new(DVec3::new(4.0, 1.5, 1.0), DVec3::NEG_X);
        let hit = flat.intersect(&ray, Interval::FORWARD, None).unwrap();
        let point = flat.surface(
            &ray,
            &hit.of_shape(whitstone_core::InstanceId::TOP_LEVEL, 0),
            SurfaceAttributes::UV,
        );
        assert_eq!((point.uv, point.n_g), (DVec2::new(1.5, 1.0), DVec3::X));
    }

    #[test]
    fn what_is_no_polygon_is_refused() {
        let ring = |vertices: &str| error(&format!("vertices = [{vertices}]"));
        assert_eq!(
            ring("[0, 0, 0], [1, 0, 0]").message,
            "expected 3 to 4096 vertices, found 2"
        );
        let bent = ring("[0, 0, 0], [1, 0, 0], [1, 1, 1e-7], [0, 1, 0]");
        assert!(
            bent.message
                .starts_with("expected vertices in one plane to 1.4e-9 m, found vertex ")
        );
        assert_eq!(
            ring("[0, 0, 0], [1, 0, 0], [-0.0, 0, 0], [0, 1, 0]").message,
            "vertices 0 and 2 of this polygon coincide"
        );
        let eight = "[0, 0, 0], [2, 2, 0], [2, 0, 0], [0, 1, 0]";
        assert_eq!(ring(eight).message, "edges 0 and 2 of this polygon intersect");
        assert_eq!(
            ring("[0, 0, 0], [1, 0, 0], [2, 0, 0]").message,
            "this polygon encloses no area: its vertices lie on one line, or its edges cross so that the areas cancel"
        );
        // A square with two vertices exchanged: its halves have opposite areas.
        assert_eq!(
            ring("[0, 0, 0], [2, 2, 0], [2, 0, 0], [0, 2, 0]").message,
            "this polygon encloses no area: its vertices lie on one line, or its edges cross so that the areas cancel"
        );
        // A vertex on an edge, and an edge that turns back on the previous one.
        assert_eq!(
            ring("[0, 0, 0], [2, 0, 0], [2, 2, 0], [1, 0, 0], [0, 2, 0]").message,
            "edges 0 and 3 of this polygon intersect"
        );
        assert_eq!(
            ring("[0, 0, 0], [2, 0, 0], [1, 0, 0], [0, 2, 0]").message,
            "edges 0 and 2 of this polygon intersect"
        );
        assert!(
            ring("[0, 0, 0], [1e200, 0, 0], [0, 1e200, 0]")
                .message
                .contains("too far apart")
        );
    }
}
