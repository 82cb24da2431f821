//! Finds the parts of different shapes that coincide.

use super::meet;
use super::parts::Parts;
use whitstone_core::{Aabb, DVec2, DVec3, Geometry, SurfacePart};

/// Maximum distance of coincident surfaces, relative to the largest coordinate of both: 16 units in
/// the last place.
const APART: f64 = 16.0 * f64::EPSILON;

/// Normals and offsets are sorted, and compared exactly if they differ by less than this.
const ALIKE: f64 = 1e-10;

/// Maximum sine of the angle between normals that are compared, and relative distance of their
/// planes.
const NEARLY: f64 = 1e-6;

/// Polygons only touch if their intersection is below this fraction of the smaller one.
const LEAST_OVERLAP: f64 = 1e-9;

/// Grid resolution of the probe rays that test whether both faces exist in a common part.
const PROBES: usize = 12;

/// A common part of two surfaces.
pub(super) struct Contact {
    /// Two parts of different shapes, the lower one first.
    pub(super) parts: [usize; 2],
    shapes: [usize; 2],
    /// Points around or on it, with the normal of the first part there.
    pub(super) points: Vec<(DVec3, DVec3)>,
    /// Largest absolute coordinate of the points.
    pub(super) largest: f64,
    pub(super) form: &'static str,
    /// Index of its plane among all distinct planes; `None` if it is not flat.
    pub(super) plane: Option<usize>,
}

impl Contact {
    /// Numbers of the shapes, the lower one first.
    pub(super) fn shapes(&self) -> [usize; 2] {
        self.shapes
    }
}

/// All contacts, in a fixed order.
pub(super) fn find(geometry: &Geometry, parts: &Parts<'_>) -> Vec<Contact> {
    let mut contacts = Vec::new();
    let mut tried = 0;
    for (run, plane) in coplanar(parts).into_iter().zip(0..) {
        sweep(parts, run, |a, b| {
            tried += 1;
            if tried > MAX_PAIRS {
                return;
            }
            if let Some(points) = flat_overlap(&parts.all[a].surface, &parts.all[b].surface)
                && is_there(geometry, parts, [a, b], &points)
            {
                contacts.push(contact(parts, [a, b], points, "plane", Some(plane)));
            }
        });
    }
    curved(parts, &mut contacts);
    contacts.sort_by_key(|contact| contact.parts);
    contacts
}

/// Maximum number of overlapping pairs of faces that are examined. Equal shapes in the same place
/// have a pair for every two.
const MAX_PAIRS: usize = 50_000;

fn contact(
    parts: &Parts<'_>,
    [a, b]: [usize; 2],
    points: Vec<(DVec3, DVec3)>,
    form: &'static str,
    plane: Option<usize>,
) -> Contact {
    let largest = points.iter().map(|(p, _)| p.abs().max_element());
    let pair = [a.min(b), a.max(b)];
    // Parts are not in the order of their shapes.
    let mut shapes = pair.map(|part| parts.all[part].shape);
    shapes.sort_unstable();
    Contact {
        parts: pair,
        shapes,
        largest: largest.fold(0.0, f64::max),
        points,
        form,
        plane,
    }
}

/// A flat part, with keys that are equal for parts in one plane.
struct Flat {
    part: usize,
    /// A function of the normal that has the same value for the opposite normal.
    turn: f64,
    normal: DVec3,
    /// Signed distance of the plane from the origin, along the normal.
    offset: f64,
    /// Largest coordinate of the corner from which it was computed.
    reach: f64,
}

/// Lists of parts that may lie in one plane, from at least two shapes.
fn coplanar(parts: &Parts<'_>) -> Vec<Vec<usize>> {
    let flat = parts.all.iter().zip(0..).filter_map(|(part, number)| {
        let (point, n) = plane_of(&part.surface)?;
        let turn = n.x * n.x
            + 1.4 * n.y * n.y
            + 1.7 * n.z * n.z
            + 2.2 * n.x * n.y
            + 2.6 * n.y * n.z
            + 3.3 * n.z * n.x;
        Some(Flat {
            part: number,
            turn,
            normal: n,
            offset: point.dot(n),
            reach: point.abs().max_element(),
        })
    });
    let mut flat: Vec<Flat> = flat.collect();
    flat.sort_by(|a, b| a.turn.total_cmp(&b.turn).then(a.part.cmp(&b.part)));
    let mut runs = Vec::new();
    for parallel in flat.chunk_by_mut(|a, b| b.turn - a.turn <= ALIKE) {
        let distance = |flat: &Flat| flat.offset.abs();
        parallel.sort_by(|a, b| distance(a).total_cmp(&distance(b)).then(a.part.cmp(&b.part)));
        let same = |a: &Flat, b: &Flat| distance(b) - distance(a) <= ALIKE * a.reach.max(b.reach);
        for run in parallel.chunk_by(same) {
            let shape = |flat: &Flat| parts.all[flat.part].shape;
            for plane in planes(run) {
                if plane.iter().any(|flat| shape(flat) != shape(plane[0])) {
                    let mut plane: Vec<usize> = plane.iter().map(|flat| flat.part).collect();
                    plane.sort_unstable();
                    runs.push(plane);
                }
            }
        }
    }
    runs
}

/// The planes of parts with equal keys: planes on both sides of the origin have the same, and other
/// ones may.
fn planes(run: &[Flat]) -> Vec<Vec<&Flat>> {
    let mut planes: Vec<Vec<&Flat>> = Vec::new();
    for flat in run {
        let is_same = |plane: &&mut Vec<&Flat>| {
            let first = plane[0];
            let offset = flat.offset.copysign(flat.offset * first.normal.dot(flat.normal));
            let near = NEARLY * first.reach.max(flat.reach);
            first.normal.cross(flat.normal).length() <= NEARLY && (first.offset - offset).abs() <= near
        };
        match planes.iter_mut().find(is_same) {
            Some(plane) => plane.push(flat),
            None => planes.push(vec![flat]),
        }
    }
    planes
}

/// A point and the normal of a flat part.
fn plane_of(surface: &SurfacePart) -> Option<(DVec3, DVec3)> {
    match surface {
        SurfacePart::Plane { point, normal } => Some((*point, *normal)),
        SurfacePart::Polygon { normal, corners, .. } => Some((*corners.first()?, *normal)),
        _ => None,
    }
}

/// All pairs of different shapes whose boxes intersect.
fn sweep(parts: &Parts<'_>, mut run: Vec<usize>, mut pair: impl FnMut(usize, usize)) {
    let aabb = |part: usize| -> &Aabb { &parts.all[part].aabb };
    let extent = run.iter().map(|part| aabb(*part)).filter(|aabb| aabb.is_finite());
    let extent = extent
        .fold(Aabb::EMPTY, |whole, aabb| whole.union(*aabb))
        .extent()
        .to_array();
    let axis = (0..3)
        .max_by(|a, b| extent[*a].total_cmp(&extent[*b]))
        .unwrap_or(0);
    run.sort_by(|a, b| aabb(*a).min[axis].total_cmp(&aabb(*b).min[axis]).then(a.cmp(b)));
    let mut open: Vec<usize> = Vec::new();
    for part in run {
        let one = aabb(part);
        let near = 64.0 * f64::EPSILON * one.min.abs().max(one.max.abs()).max_element().min(f64::MAX);
        // Faces perpendicular to the axis may have a gap of rounding errors between them.
        open.retain(|other| aabb(*other).max[axis] >= one.min[axis] - near);
        for &other in &open {
            let two = aabb(other);
            let meet = (one.min.max(two.min) - near).cmple(one.max.min(two.max)).all();
            if parts.all[part].shape != parts.all[other].shape && meet {
                pair(part.min(other), part.max(other));
            }
        }
        open.push(part);
    }
}

/// The corners of the intersection of two flat parts, with the normal of the first; `None` if they
/// do not coincide.
fn flat_overlap(a: &SurfacePart, b: &SurfacePart) -> Option<Vec<(DVec3, DVec3)>> {
    let ((at, n), (other, m)) = (plane_of(a)?, plane_of(b)?);
    if n.cross(m).length() > NEARLY {
        return None;
    }
    let points = match (a, b) {
        (SurfacePart::Polygon { corners: one, .. }, SurfacePart::Polygon { corners: two, .. }) => {
            // Coordinates are relative to the smaller part.
            if size(one) <= size(two) {
                common(one, two, n)?
            } else {
                common(two, one, m)?
            }
        }
        (SurfacePart::Polygon { corners, .. }, _) | (_, SurfacePart::Polygon { corners, .. }) => {
            corners.clone()
        }
        _ => {
            let foot = at.dot(n) * n;
            let (x, y) = n.any_orthonormal_pair();
            let far = 1.0 + foot.length();
            [x, y, -x, -y].map(|way| foot + far * way).to_vec()
        }
    };
    let reach = |surface: &SurfacePart, point: DVec3| match surface {
        SurfacePart::Polygon { corners, .. } => Aabb::around(corners.iter().copied()),
        _ => Aabb::around([point]),
    };
    let reach = reach(a, at)
        .union(reach(b, other))
        .union(Aabb::around(points.iter().copied()));
    let largest = reach.min.abs().max(reach.max.abs()).max_element();
    let same = 1.0_f64.copysign(n.dot(m));
    let apart = |p: &DVec3| (above(a, *p) - same * above(b, *p)).abs();
    // NaN fails the test.
    let coincide = points.iter().all(|p| apart(p) <= APART * largest);
    coincide.then(|| points.into_iter().map(|p| (p, n)).collect())
}

/// The height of a point above a flat part, measured from the nearest known point of the part.
fn above(surface: &SurfacePart, p: DVec3) -> f64 {
    let near = |a: &&DVec3, b: &&DVec3| a.distance_squared(p).total_cmp(&b.distance_squared(p));
    match surface {
        SurfacePart::Polygon { corners, normal, .. } => corners
            .iter()
            .min_by(near)
            .map_or(f64::NAN, |corner| (p - *corner).dot(*normal)),
        SurfacePart::Plane { point, normal } => (p - *point).dot(*normal),
        _ => f64::NAN,
    }
}

/// Squared diagonal of a polygon's bounding box.
fn size(corners: &[DVec3]) -> f64 {
    Aabb::around(corners.iter().copied()).extent().length_squared()
}

/// The intersection of two convex polygons that lie nearly in one plane; `None` if they only touch.
///
/// Sutherland and Hodgman, *Reentrant polygon clipping*, Communications of the ACM 17(1), 1974.
fn common(one: &[DVec3], two: &[DVec3], n: DVec3) -> Option<Vec<DVec3>> {
    let (x, y) = n.any_orthonormal_pair();
    let origin = one[0];
    let flat = |p: &DVec3| DVec2::new((*p - origin).dot(x), (*p - origin).dot(y));
    let subject: Vec<DVec2> = one.iter().map(flat).collect();
    let mut clip: Vec<DVec2> = two.iter().map(flat).collect();
    let (own, other) = (area(&subject), area(&clip));
    if other < 0.0 {
        clip.reverse();
    }
    let mut left: Vec<(DVec2, DVec3)> = subject.into_iter().zip(one.iter().copied()).collect();
    for (k, &a) in clip.iter().enumerate() {
        let along = clip[(k + 1) % clip.len()] - a;
        let side = |p: DVec2| along.perp_dot(p - a);
        let mut next = Vec::with_capacity(left.len() + 1);
        for (i, &(p, in_space)) in left.iter().enumerate() {
            let (q, then) = left[(i + 1) % left.len()];
            let (here, there) = (side(p), side(q));
            if here >= 0.0 {
                next.push((p, in_space));
            }
            if (here > 0.0 && there < 0.0) || (here < 0.0 && there > 0.0) {
                let share = here / (here - there);
                next.push((p + share * (q - p), in_space + share * (then - in_space)));
            }
        }
        left = next;
        if left.len() < 3 {
            return None;
        }
    }
    let flat: Vec<DVec2> = left.iter().map(|(p, _)| *p).collect();
    let least = LEAST_OVERLAP * own.abs().min(other.abs());
    (area(&flat).abs() > least).then(|| left.into_iter().map(|(_, p)| p).collect())
}

fn area(ring: &[DVec2]) -> f64 {
    let first = ring.first().copied().unwrap_or_default();
    let next = ring.iter().skip(1);
    0.5 * ring
        .iter()
        .zip(next)
        .map(|(a, b)| (*a - first).perp_dot(*b - first))
        .sum::<f64>()
}

/// Whether both faces exist somewhere in the common part. If polygons are not filled, rays probe
/// it.
fn is_there(geometry: &Geometry, parts: &Parts<'_>, pair: [usize; 2], points: &[(DVec3, DVec3)]) -> bool {
    let unfilled = |part: &&usize| {
        matches!(
            parts.all[**part].surface,
            SurfacePart::Polygon { filled: false, .. }
        )
    };
    let unsure: Vec<usize> = pair.iter().filter(unfilled).copied().collect();
    if unsure.is_empty() {
        return true;
    }
    let n = points[0].1;
    let (x, y) = n.any_orthonormal_pair();
    let origin = points[0].0;
    let flat: Vec<DVec2> = points
        .iter()
        .map(|(p, _)| DVec2::new((*p - origin).dot(x), (*p - origin).dot(y)))
        .collect();
    let bounds = flat
        .iter()
        .fold((DVec2::INFINITY, DVec2::NEG_INFINITY), |(low, high), p| {
            (low.min(*p), high.max(*p))
        });
    let extent = bounds.1 - bounds.0;
    let far = 1e-6 * extent.max_element();
    let turn = area(&flat).signum();
    let inside = |p: DVec2| {
        let next = flat.iter().cycle().skip(1);
        flat.iter()
            .zip(next)
            .all(|(a, b)| turn * (*b - *a).perp_dot(p - *a) > 0.0)
    };
    (0..PROBES * PROBES).any(|k| {
        let cell = DVec2::new((k % PROBES) as f64 + 0.37, (k / PROBES) as f64 + 0.61) / PROBES as f64;
        let p = bounds.0 + extent * cell;
        let place = origin + p.x * x + p.y * y;
        inside(p)
            && unsure.iter().all(|part| {
                let hit = |n: DVec3| {
                    let hit = meet(geometry, parts.all[*part].shape, place, n, far);
                    hit.is_some_and(|(_, hit)| (hit.t - far).abs() <= 1e-3 * far)
                };
                hit(n) || hit(-n)
            })
    })
}

/// Finds equal spheres and equal cylinders.
fn curved(parts: &Parts<'_>, contacts: &mut Vec<Contact>) {
    let place = |part: usize| match &parts.all[part].surface {
        SurfacePart::Sphere { center, .. } => center.x,
        SurfacePart::Cylinder { ends: [a, b], .. } => a.x.min(b.x),
        _ => 0.0,
    };
    let is_curved = |part: &usize| {
        matches!(
            parts.all[*part].surface,
            SurfacePart::Sphere { .. } | SurfacePart::Cylinder { .. }
        )
    };
    let mut curved: Vec<usize> = (0..parts.all.len()).filter(is_curved).collect();
    let aabb = |part: usize| &parts.all[part].aabb;
    curved.sort_by(|a, b| place(*a).total_cmp(&place(*b)).then(a.cmp(b)));
    for (k, &one) in curved.iter().enumerate() {
        let reach = aabb(one).max.abs().max(aabb(one).min.abs()).max_element();
        for &two in &curved[k + 1..] {
            let sphere = matches!(parts.all[one].surface, SurfacePart::Sphere { .. });
            // Cylinders may begin at different heights.
            let end = if sphere { place(one) } else { aabb(one).max.x };
            if place(two) > end + APART * reach {
                break;
            }
            if parts.all[one].shape == parts.all[two].shape {
                continue;
            }
            if let Some((points, form)) = equal(&parts.all[one].surface, &parts.all[two].surface) {
                contacts.push(contact(parts, [one, two], points, form, None));
            }
        }
    }
}

/// Points of two equal curved surfaces, with the outward normals.
fn equal(one: &SurfacePart, two: &SurfacePart) -> Option<(Vec<(DVec3, DVec3)>, &'static str)> {
    match (one, two) {
        (
            SurfacePart::Sphere { center, radius },
            SurfacePart::Sphere {
                center: other,
                radius: size,
            },
        ) => {
            let apart = APART * (center.abs().max_element() + radius);
            let equal = (*center - *other).abs().max_element() <= apart && (radius - size).abs() <= apart;
            let points = [
                DVec3::X,
                DVec3::NEG_X,
                DVec3::Y,
                DVec3::NEG_Y,
                DVec3::Z,
                DVec3::NEG_Z,
            ];
            equal.then(|| (points.map(|n| (*center + *radius * n, n)).to_vec(), "sphere"))
        }
        (
            SurfacePart::Cylinder { ends: [a, b], radius },
            SurfacePart::Cylinder {
                ends: others,
                radius: size,
            },
        ) => {
            let largest = a.abs().max(b.abs()).max_element() + radius;
            let axis = (*b - *a).try_normalize()?;
            let along = others.map(|p| (p - *a).dot(axis));
            let off = others.map(|p| (p - *a - (p - *a).dot(axis) * axis).length());
            let (low, high) = (along[0].min(along[1]), along[0].max(along[1]));
            let (from, to) = (low.max(0.0), high.min(a.distance(*b)));
            let equal = off[0].max(off[1]) <= APART * largest
                && (radius - size).abs() <= APART * largest
                && to - from > 1e-9 * radius.min(a.distance(*b));
            let (x, y) = axis.any_orthonormal_pair();
            let around = [x, y, -x, -y]
                .into_iter()
                .flat_map(|n| [from, to].map(|t| (*a + t * axis + *radius * n, n)));
            equal.then(|| (around.collect(), "cylinder"))
        }
        _ => None,
    }
}
