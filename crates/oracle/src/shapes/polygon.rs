//! The region enclosed by the edges, in the plane through the mean of the vertices.

use super::Surface;
use crate::interval::{Decided, Interval, Undecided};
use crate::root::{Root, Roots};
use crate::vector::{Line, Vector};
use serde::Deserialize;
use std::cmp::Ordering;
use whitstone_core::DVec3;

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Polygon {
    pub(crate) vertices: Vec<[f64; 3]>,
}

impl Surface for Polygon {
    fn meet(&self, line: &Line) -> Decided<Roots> {
        let vertices: Vec<Vector> = self.vertices.iter().map(|vertex| line.point(*vertex)).collect();
        let edges = || vertices.iter().zip(vertices.iter().cycle().skip(1));
        let zero = line.point([0.0; 3]);
        let sum = vertices.iter().fold(zero.clone(), |sum, vertex| sum.plus(vertex));
        let part = line.number(1.0).over(&line.number(vertices.len() as f64))?;
        let center = sum.times(&part);
        let normal = edges().fold(zero, |sum, (p, q)| {
            sum.plus(&p.minus(&center).cross(&q.minus(&center)))
        });
        let along = normal.dot(&line.direction);
        let to_plane = normal.dot(&center.minus(&line.origin));
        if along.sign()? == Ordering::Equal {
            return match to_plane.sign()? {
                Ordering::Equal => Err(Undecided),
                _ => Ok(Roots::default()),
            };
        }
        let t = to_plane.over(&along)?;
        // Project along the largest axis of the normal; any axis not perpendicular to it would do.
        let n = normal.nearest();
        let axis = (0..3)
            .max_by(|i, j| n[*i].abs().total_cmp(&n[*j].abs()))
            .unwrap_or(2);
        let (b, c) = ((axis + 1) % 3, (axis + 2) % 3);
        let (x, y) = (line.coordinate(b, &t), line.coordinate(c, &t));
        let mut inside = false;
        for (p, q) in edges() {
            inside ^= crosses([&p.0[b], &p.0[c]], [&q.0[b], &q.0[c]], &x, &y)?;
        }
        if !inside {
            return Ok(Roots::default());
        }
        let corners = self
            .vertices
            .iter()
            .map(|vertex| DVec3::from_array(*vertex).abs());
        let reach = corners.fold(DVec3::ZERO, DVec3::max);
        let root = Root::new(t, 0, &along, n, n.abs().dot(reach))?;
        Ok(Roots::new(vec![root]))
    }

    fn ball(&self) -> Option<(DVec3, f64)> {
        let mut all = self.vertices.iter().map(|vertex| DVec3::from_array(*vertex));
        let center = all.next()?;
        Some((
            center,
            all.map(|vertex| vertex.distance(center)).fold(0.0, f64::max),
        ))
    }
}

/// Whether an edge crosses the half-line from (x, y) towards increasing x. A vertex at the same
/// height counts as above it. Where the half-line only touches a vertex, both edges or none count
/// as crossings.
pub(super) fn crosses(p: [&Interval; 2], q: [&Interval; 2], x: &Interval, y: &Interval) -> Decided<bool> {
    let above = |v: &Interval| Ok((v - y).sign()? != Ordering::Less);
    let (p_above, q_above) = (above(p[1])?, above(q[1])?);
    if p_above == q_above {
        return Ok(false);
    }
    let side = (q[0] - p[0]) * (y - p[1]) - (x - p[0]) * (q[1] - p[1]);
    match side.sign()? {
        // The point lies on the edge.
        Ordering::Equal => Err(Undecided),
        sign => Ok((sign == Ordering::Greater) == q_above),
    }
}
