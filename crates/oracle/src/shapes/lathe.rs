//! All points with `(sqrt(x² + z²), y)` on the outline: cones, cylinders, disks and rings.

use super::Surface;
use super::cone::Cone;
use crate::interval::{Decided, Undecided};
use crate::root::{Root, Roots};
use crate::vector::{Line, Vector};
use serde::Deserialize;
use std::cmp::Ordering;
use whitstone_core::DVec3;

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Lathe {
    /// The points (r, y).
    pub(crate) outline: Vec<[f64; 2]>,
}

impl Lathe {
    /// Whether both ends of the outline lie on the axis.
    pub(crate) fn is_closed(&self) -> bool {
        let ends = [self.outline.first(), self.outline.last()];
        ends.into_iter().flatten().all(|point| point[0] == 0.0)
    }

    /// 1 if the normal of a segment (dr, dy) is along (dy, -dr), else -1.
    pub(crate) fn sense(&self) -> f64 {
        let low = self.outline[0][1];
        // Twice the area with the axis, which adds nothing to the sum.
        let area = |pair: &[[f64; 2]]| {
            let [[r, y], [s, z]] = [pair[0], pair[1]];
            r * (z - low) - s * (y - low)
        };
        let area: f64 = self.outline.windows(2).map(area).sum();
        if self.is_closed() && area < 0.0 { -1.0 } else { 1.0 }
    }

    /// A segment that is not flat, as a cone about the z axis.
    pub(crate) fn cone([[r, y], [s, z]]: [[f64; 2]; 2]) -> Cone {
        let (radii, z) = if y < z { ([r, s], [y, z]) } else { ([s, r], [z, y]) };
        Cone {
            radii,
            z,
            caps: false,
        }
    }

    /// The root at a flat segment.
    fn ring(line: &Line, number: u32, [[r, y], [s, _]]: [[f64; 2]; 2], sense: f64) -> Decided<Option<Root>> {
        let (o, d) = (&line.origin.0[1], &line.direction.0[1]);
        let above = line.number(y) - o;
        if d.sign()? == Ordering::Equal {
            return match above.sign()? {
                // The line lies in the plane of the ring.
                Ordering::Equal => Err(Undecided),
                _ => Ok(None),
            };
        }
        let t = above.over(d)?;
        let square = line.coordinate(0, &t).squared() + line.coordinate(2, &t).squared();
        let outer = (line.number(r.max(s)).squared() - &square).sign()?;
        let inner = match r.min(s) {
            0.0 => Ordering::Greater,
            least => (square - line.number(least).squared()).sign()?,
        };
        match [inner, outer] {
            [Ordering::Less, _] | [_, Ordering::Less] => return Ok(None),
            [Ordering::Greater, Ordering::Greater] => {}
            _ => return Err(Undecided),
        }
        let side = if (s > r) == (sense > 0.0) { -1.0 } else { 1.0 };
        let slope = d * line.number(side);
        Root::new(t, number, &slope, side * DVec3::Y, y.abs()).map(Some)
    }
}

impl Surface for Lathe {
    fn meet(&self, line: &Line) -> Decided<Roots> {
        // The cone stands about z: its axes x, y, z are z, x, y here.
        let turned = |v: &Vector| Vector([2, 0, 1].map(|axis| v.0[axis].clone()));
        let upright = Line {
            origin: turned(&line.origin),
            direction: turned(&line.direction),
        };
        let sense = self.sense();
        let mut all = Vec::new();
        for (ends, number) in self.outline.windows(2).zip(0..) {
            let ends = [ends[0], ends[1]];
            if ends[0][1] == ends[1][1] {
                all.extend(Self::ring(line, number, ends, sense)?);
                continue;
            }
            // The normal of a cone points away from the axis.
            let turns = (ends[1][1] > ends[0][1]) != (sense > 0.0);
            for mut root in Self::cone(ends).meet(&upright)?.all {
                let n = DVec3::new(root.normal.y, root.normal.z, root.normal.x);
                root.normal = if turns { -n } else { n };
                root.enters ^= turns;
                root.primitive = number;
                all.push(root);
            }
        }
        Ok(Roots::new(all))
    }

    fn ball(&self) -> Option<(DVec3, f64)> {
        let mut heights = self.outline.iter().map(|point| point[1]);
        let first = heights.next()?;
        let (low, high) = heights.fold((first, first), |(low, high), y| (low.min(y), high.max(y)));
        let widest = self.outline.iter().map(|point| point[0]).fold(0.0, f64::max);
        let center = DVec3::new(0.0, 0.5 * (low + high), 0.0);
        Some((center, widest.hypot(0.5 * (high - low))))
    }
}
