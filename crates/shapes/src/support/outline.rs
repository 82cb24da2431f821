//! Outlines in a plane: the checks of their points, and the hits of solids that are bounded by
//! several primitives.
//!
//! The signs that decide whether edges cross are exact: Shewchuk, *Adaptive Precision
//! Floating-Point Arithmetic and Fast Robust Geometric Predicates*, 1997.

use toml::Spanned;
use whitstone_core::config::Vector2;
use whitstone_core::{DAffine3, DMat3, DVec2, DVec3, Ray, SceneError, ShapeHit, Spans, Transform};

/// Maximum number of points of an outline.
pub(crate) const MAX_POINTS: usize = 4096;

/// The points of an outline as a scene file gives them.
pub(crate) type Points = Spanned<Vec<Spanned<Vector2>>>;

/// The points of a simple outline. Edges may meet only at their common point; a closed outline has
/// an edge from its last point to the first one.
pub(crate) fn simple(points: &Points, least: usize, closed: bool) -> Result<Vec<DVec2>, SceneError> {
    let all = points.get_ref();
    let here = |message: String| SceneError::at(points.span(), message);
    if !(least..=MAX_POINTS).contains(&all.len()) {
        let found = all.len();
        return Err(here(format!(
            "expected {least} to {MAX_POINTS} points, found {found}"
        )));
    }
    // Negative zeros become positive, so that equal points are adjacent in the order below.
    let outline: Vec<DVec2> = all.iter().map(|point| point.get_ref().get() + 0.0).collect();
    let mut order: Vec<usize> = (0..outline.len()).collect();
    order.sort_by(|i, j| {
        let (a, b) = (outline[*i], outline[*j]);
        a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y)).then(i.cmp(j))
    });
    if let Some(pair) = order.windows(2).find(|pair| outline[pair[0]] == outline[pair[1]]) {
        let message = format!("points {} and {} of this outline coincide", pair[0], pair[1]);
        let error = SceneError::at(all[pair[1]].span(), message);
        return Err(if closed && pair[0] == 0 && pair[1] + 1 == outline.len() {
            error.with_help("the outline is closed without repeating its first point")
        } else {
            error
        });
    }
    let size = extent(&outline).length();
    let shortest = edges(&outline).fold(size, |least, (a, b)| least.min(a.distance(b)));
    // Edge functions are products of two lengths.
    if !(size * size).is_finite() || !(shortest * shortest).is_normal() {
        return Err(here(
            "the points are too far apart or too close together for double precision".to_owned(),
        ));
    }
    if let Some([i, j]) = meeting_edges(&outline, closed) {
        let help = if closed {
            "edge k joins points k and k + 1, counted from 0, and the last one returns to point 0; only adjacent edges may touch, at their common point"
        } else {
            "edge k joins points k and k + 1, counted from 0; only adjacent edges may touch, at their common point"
        };
        return Err(here(format!("edges {i} and {j} of this outline intersect")).with_help(help));
    }
    Ok(outline)
}

/// The size of the bounding rectangle.
pub(crate) fn extent(outline: &[DVec2]) -> DVec2 {
    let all = outline.iter().copied();
    let low = all.clone().fold(DVec2::INFINITY, DVec2::min);
    let high = all.fold(DVec2::NEG_INFINITY, DVec2::max);
    high - low
}

/// Twice the signed area inside a closed outline: positive if it runs counter-clockwise.
pub(crate) fn twice_area(outline: &[DVec2]) -> f64 {
    let first = outline[0];
    edges(outline).map(|(a, b)| (a - first).perp_dot(b - first)).sum()
}

/// The edges of a closed outline.
pub(crate) fn edges<T: Copy>(ring: &[T]) -> impl Iterator<Item = (T, T)> + '_ {
    let next = ring.iter().cycle().skip(1);
    ring.iter().copied().zip(next.copied())
}

/// Two edges that meet other than at their common vertex, if there are any. Edge k begins at vertex
/// k; the last vertex begins an edge if the outline is `closed`.
pub(crate) fn meeting_edges(ring: &[DVec2], closed: bool) -> Option<[usize; 2]> {
    let n = ring.len();
    let end = |i: usize| ring[(i + 1) % n];
    let mut order: Vec<usize> = (0..if closed { n } else { n - 1 }).collect();
    order.sort_by(|i, j| f64::total_cmp(&ring[*i].x.min(end(*i).x), &ring[*j].x.min(end(*j).x)));
    for (place, &i) in order.iter().enumerate() {
        let (a, b) = (ring[i], end(i));
        for &j in &order[place + 1..] {
            let (c, d) = (ring[j], end(j));
            if c.x.min(d.x) > a.x.max(b.x) {
                break;
            }
            let meet = if (i + 1) % n == j {
                folds_back(a, b, d)
            } else if (j + 1) % n == i {
                folds_back(c, a, b)
            } else {
                cross_or_touch([a, b], [c, d])
            };
            if meet {
                return Some([i.min(j), i.max(j)]);
            }
        }
    }
    None
}

/// Whether the path a, b, c turns back on itself.
fn folds_back(a: DVec2, b: DVec2, c: DVec2) -> bool {
    side_of(a, b, c) == 0.0 && (a - b).dot(c - b) > 0.0
}

fn cross_or_touch([a, b]: [DVec2; 2], [c, d]: [DVec2; 2]) -> bool {
    let disjoint = |axis: usize| {
        a[axis].max(b[axis]) < c[axis].min(d[axis]) || c[axis].max(d[axis]) < a[axis].min(b[axis])
    };
    let same_side = |p: f64, q: f64| p > 0.0 && q > 0.0 || p < 0.0 && q < 0.0;
    !(disjoint(0)
        || disjoint(1)
        || same_side(side_of(a, b, c), side_of(a, b, d))
        || same_side(side_of(c, d, a), side_of(c, d, b)))
}

/// Positive if c lies to the left of the line from a to b, negative to the right, and exactly zero
/// on the line.
fn side_of(a: DVec2, b: DVec2, c: DVec2) -> f64 {
    let (left, right) = ((a.x - c.x) * (b.y - c.y), (a.y - c.y) * (b.x - c.x));
    let side = left - right;
    // Shewchuk's error bound for this expression: above it, the sign is right.
    if side.abs() > 3.4e-16 * (left.abs() + right.abs()) {
        return side;
    }
    let terms = [
        (a.x, b.y),
        (-a.y, b.x),
        (b.x, c.y),
        (-b.y, c.x),
        (c.x, a.y),
        (-c.y, a.x),
    ];
    let (mut sum, mut count) = ([0.0; 12], 0);
    let parts = terms.iter().flat_map(|(p, q)| {
        let product = p * q;
        [p.mul_add(*q, -product), product]
    });
    // Adds each term to a sum of non-overlapping parts (Grow-Expansion); the last nonzero part has
    // the sign.
    for part in parts {
        let mut carried = part;
        for kept in &mut sum[..count] {
            let total = carried + *kept;
            let seen = total - carried;
            *kept = (carried - (total - seen)) + (*kept - seen);
            carried = total;
        }
        sum[count] = carried;
        count += 1;
    }
    sum.into_iter().rev().find(|part| *part != 0.0).unwrap_or(0.0)
}

/// The transform from a space whose axes x, y, z are the axes z, x, y of object space: a shape
/// about the y axis is one about the z axis there. Exact.
pub(crate) fn upright(transform: Transform) -> Option<Transform> {
    let DAffine3 { matrix3, translation } = *transform.world_from_object();
    let turned = DMat3::from_cols(matrix3.z_axis, matrix3.x_axis, matrix3.y_axis);
    Transform::new(DAffine3::from_mat3_translation(turned, translation))
}

/// A line in object space, whose parameters are measured from a point near the shape.
pub(crate) struct Line {
    pub(crate) origin: DVec3,
    pub(crate) direction: DVec3,
    /// The parameter of this point on the ray.
    pub(crate) moved: f64,
}

impl Line {
    /// A ray that starts far from a ball is measured from its point nearest to the center, where
    /// coordinates have more digits. Others keep their origin: it may lie on the surface.
    pub(crate) fn near(ray: &Ray, center: DVec3, radius: f64) -> Self {
        let Ray {
            origin, direction, ..
        } = *ray;
        let away = origin - center;
        if away.length_squared() <= 16.0 * radius * radius {
            return Self {
                origin,
                direction,
                moved: 0.0,
            };
        }
        let moved = -away.dot(direction) / direction.length_squared();
        let at = |o: f64, d: f64| moved.mul_add(d, o);
        Self {
            origin: DVec3::new(
                at(origin.x, direction.x),
                at(origin.y, direction.y),
                at(origin.z, direction.z),
            ),
            direction,
            moved,
        }
    }
}

/// A crossing of a primitive by a line.
#[derive(Clone, Copy)]
pub(crate) struct Crossing {
    pub(crate) hit: ShapeHit,
    /// Whether the line goes against the normal.
    pub(crate) enters: bool,
}

/// The crossings of a line, in no order.
pub(crate) type Crossings = Vec<Crossing>;

/// Appends the parts of a line inside a solid, from all its crossings. As many enter as leave. Near
/// a common edge of two primitives, rounding may exchange two crossings: their number decides, so
/// that this shortens or joins parts by a rounding error only.
pub(crate) fn pair_up(crossings: &mut Crossings, mut push: impl FnMut(ShapeHit, ShapeHit)) {
    crossings.sort_unstable_by(|a, b| {
        let order = a.hit.t.total_cmp(&b.hit.t);
        order
            .then(b.enters.cmp(&a.enters))
            .then(a.hit.primitive.cmp(&b.hit.primitive))
    });
    let mut depth = 0;
    let mut entered: Option<ShapeHit> = None;
    for crossing in crossings.iter() {
        if crossing.enters {
            depth += 1;
            if depth == 1 {
                entered = Some(crossing.hit);
            }
        } else {
            if depth == 1
                && let Some(enter) = entered.take()
            {
                push(enter, crossing.hit);
            }
            depth -= 1;
        }
    }
}

/// The nearest end of a span in front of a ray that starts on the surface of a solid. It goes
/// `inside` or not: the first end is an exit or an entry accordingly, and others before it are the
/// start itself, moved by rounding. `own` are ends that cannot be hit again (an end, and whether it
/// is an exit).
pub(crate) fn end_beyond(
    spans: &Spans,
    inside: bool,
    min: f64,
    own: impl Fn(&ShapeHit, bool) -> bool,
) -> Option<ShapeHit> {
    let ends = spans
        .iter()
        .flat_map(|span| [(span.enter, false), (span.exit, true)]);
    ends.filter(|(end, exit)| end.t > 0.0 && !own(end, *exit))
        .skip_while(|(_, exit)| *exit != inside)
        .map(|(end, _)| end)
        .find(|end| end.t > min)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn signs_are_exact() {
        let e = f64::EPSILON;
        let (a, b) = (DVec2::new(12.0, 12.0), DVec2::new(24.0, 24.0));
        let naive = |a: DVec2, b: DVec2, c: DVec2| (a.x - c.x) * (b.y - c.y) - (a.y - c.y) * (b.x - c.x);
        let mut wrong = 0;
        for i in 0..64 {
            for j in 0..64 {
                // The classical example: points near a diagonal, an ulp apart.
                let c = DVec2::new(0.5 + 0.5 * e * f64::from(i), 0.5 + 0.5 * e * f64::from(j));
                let expected = f64::from(j - i);
                assert!(side_of(a, b, c) * expected > 0.0 || i == j && side_of(a, b, c) == 0.0);
                wrong += usize::from(naive(a, b, c) * expected <= 0.0 && i != j);
            }
        }
        assert!(wrong > 500, "the naive form must be wrong: {wrong}");
    }
}
