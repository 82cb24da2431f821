//! Triangles, numbered in the order of the shape.

use super::{Surface, passes_by};
use crate::interval::{Decided, Undecided};
use crate::root::{Root, Roots};
use crate::vector::Line;
use serde::Deserialize;
use std::cmp::Ordering;
use whitstone_core::DVec3;

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Triangle {
    pub(crate) vertices: [[f64; 3]; 3],
    #[serde(default, rename = "normals")]
    _normals: Option<[[f64; 3]; 3]>,
    #[serde(default, rename = "uvs")]
    _uvs: Option<[[f64; 2]; 3]>,
}

impl Surface for Triangle {
    fn meet(&self, line: &Line) -> Decided<Roots> {
        let root = meet(self.vertices, 0, line)?;
        Ok(Roots::new(root.into_iter().collect()))
    }
}

/// A list of triangles.
#[derive(Debug)]
pub(crate) struct Triangles(pub(crate) Vec<[[f64; 3]; 3]>);

impl Surface for Triangles {
    fn meet(&self, line: &Line) -> Decided<Roots> {
        let (o, d) = (line.origin.nearest(), line.direction.nearest());
        let mut all = Vec::new();
        for (vertices, number) in self.0.iter().zip(0..) {
            if may_meet(vertices, o, d) {
                all.extend(meet(*vertices, number, line)?);
            }
        }
        Ok(Roots::new(all))
    }
}

/// False only if the line certainly misses the triangle, by much more than the rounding error of
/// these few operations.
fn may_meet(vertices: &[[f64; 3]; 3], o: DVec3, d: DVec3) -> bool {
    let [a, b, c] = vertices.map(DVec3::from_array);
    let radius = (b - a).length().max((c - a).length());
    let size = a.abs().max(b.abs()).max(c.abs()).length();
    !passes_by((a, radius), size, o, d) && !certainly_outside([a - o, b - o, c - o], d, size + o.length())
}

/// True only if the line through the origin with direction d certainly misses the triangle. It then
/// lies on different sides of two edges, by much more than the rounding error of these few
/// operations. `size` bounds the numbers that the corners were computed from.
fn certainly_outside([a, b, c]: [DVec3; 3], d: DVec3, size: f64) -> bool {
    let rounding = 1e-13 * size * size * d.length();
    let volumes = [b.cross(c), c.cross(a), a.cross(b)].map(|cross| d.dot(cross));
    volumes.iter().any(|volume| *volume > rounding) && volumes.iter().any(|volume| *volume < -rounding)
}

/// The intersection of a line with a triangle, including its edges. A triangle without area is
/// never hit.
fn meet(vertices: [[f64; 3]; 3], number: u32, line: &Line) -> Decided<Option<Root>> {
    let corners = vertices.map(|vertex| line.point(vertex));
    let [a, b, c] = &corners;
    let normal = b.minus(a).cross(&c.minus(a));
    let along = normal.dot(&line.direction);
    let to_plane = normal.dot(&a.minus(&line.origin));
    let side = along.sign()?;
    if side == Ordering::Equal {
        let is_flat = normal.0.iter().all(|x| x.sign() == Ok(Ordering::Equal));
        return match to_plane.sign()? {
            // The line lies in its plane.
            Ordering::Equal if !is_flat => Err(Undecided),
            _ => Ok(None),
        };
    }
    // Twice the signed volumes spanned by the line and each edge: their signs tell on which side of
    // the edge the line passes.
    let [pa, pb, pc] = [a, b, c].map(|corner| corner.minus(&line.origin));
    let mut volumes = [0.0; 3];
    for (k, [p, q]) in [[&pb, &pc], [&pc, &pa], [&pa, &pb]].into_iter().enumerate() {
        let volume = line.direction.dot(&p.cross(q));
        let sign = volume.sign()?;
        if sign != Ordering::Equal && sign != side {
            return Ok(None);
        }
        volumes[k] = volume.nearest();
    }
    let t = to_plane.over(&along)?;
    let sum: f64 = volumes.iter().sum();
    let corners = vertices.map(|vertex| DVec3::from_array(vertex).abs());
    let weighted = (0..3).map(|k| volumes[k] / sum * corners[k]).sum();
    let n = normal.nearest();
    Ok(Some(Root::new(t, number, &along, n, n.abs().dot(weighted))?))
}

#[cfg(test)]
mod tests {
    use super::*;
    use whitstone_core::Ray;

    /// Lines around, through and along the edges of slivers and distant triangles: everything that
    /// the double-precision filter rejects, the exact test rejects.
    #[test]
    fn what_is_rejected_in_doubles_is_never_met() {
        let mut state = 1_u64;
        let mut random = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            (state >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
        };
        let mut rejected = 0;
        for round in 0..2000 {
            let mut point = |size: f64| [0; 3].map(|_| size * random());
            let far = point(if round % 2 == 0 { 1.0 } else { 1e6 });
            let vertices = [0; 3].map(|_| {
                let offset = point(1.0);
                [0, 1, 2].map(|axis| far[axis] + offset[axis])
            });
            let [a, b, c] = vertices.map(DVec3::from_array);
            let origin = DVec3::from_array(point(5.0));
            // A point on an edge, moved sideways by nothing, a few units in the last place or a
            // visible distance.
            let at_edge = a + (b - a) * random().abs();
            let offset = [0.0, 1e-16, 1e-12, 1e-3, 0.3][round % 5] * (1.0 + at_edge.length());
            let target = at_edge + (at_edge - c) * offset;
            let direction = target - origin;
            let outside = [a - origin, b - origin, c - origin];
            let size = a.abs().max(b.abs()).max(c.abs()).length() + origin.length();
            if certainly_outside(outside, direction, size) {
                rejected += 1;
                let line = Line::of(&Ray { origin, direction }, 512).unwrap();
                assert!(
                    matches!(meet(vertices, 0, &line), Ok(None)),
                    "{vertices:?} {origin} {direction}"
                );
            }
        }
        assert!((400..1400).contains(&rejected), "{rejected}");
    }
}
