//! The points whose (x, z) is enclosed by the outline and whose y lies between two heights.

use super::Surface;
use super::polygon::crosses;
use crate::interval::{Decided, Interval, Undecided};
use crate::root::{Root, Roots};
use crate::vector::Line;
use serde::Deserialize;
use std::cmp::Ordering;
use whitstone_core::DVec3;

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Prism {
    /// The points (x, z).
    pub(crate) outline: Vec<[f64; 2]>,
    #[serde(default = "heights")]
    pub(crate) y: [f64; 2],
}

fn heights() -> [f64; 2] {
    [0.0, 1.0]
}

impl Prism {
    pub(crate) fn edges(&self) -> impl Iterator<Item = ([f64; 2], [f64; 2])> + '_ {
        let next = self.outline.iter().cycle().skip(1);
        self.outline.iter().copied().zip(next.copied())
    }

    /// 1 if the outline runs from x to z, -1 if it runs in the other sense.
    pub(crate) fn sense(&self) -> f64 {
        let [x, z] = self.outline[0];
        let area = self
            .edges()
            .map(|(p, q)| (p[0] - x) * (q[1] - z) - (q[0] - x) * (p[1] - z));
        area.sum::<f64>().signum()
    }

    /// The root at the side of an edge.
    fn side(&self, line: &Line, number: u32, p: [f64; 2], q: [f64; 2]) -> Decided<Option<Root>> {
        let [x, y, z] = &line.direction.0;
        let [from_x, from_z] = p.map(|coordinate| line.number(coordinate));
        let [along_x, along_z] = [0, 1].map(|k| line.number(q[k]) - line.number(p[k]));
        let side = line.number(self.sense());
        let [out_x, out_z] = [&side * &along_z, -(&side * &along_x)];
        let slope = &out_x * x + &out_z * z;
        let away = &out_x * (&from_x - &line.origin.0[0]) + &out_z * (&from_z - &line.origin.0[2]);
        if slope.sign()? == Ordering::Equal {
            return match away.sign()? {
                // The line lies in the plane of the side.
                Ordering::Equal => Err(Undecided),
                _ => Ok(None),
            };
        }
        let t = away.over(&slope)?;
        let height = &line.origin.0[1] + y * &t;
        let [hit_x, hit_z] = [line.coordinate(0, &t) - from_x, line.coordinate(2, &t) - from_z];
        let along = hit_x * &along_x + hit_z * &along_z;
        let length = along_x.squared() + along_z.squared();
        let [low, high] = self.y.map(|y| line.number(y));
        if !(is_between(&height, &low, &high)? && is_between(&along, &line.number(0.0), &length)?) {
            return Ok(None);
        }
        let normal = DVec3::new(out_x.nearest(), 0.0, out_z.nearest());
        let reach = DVec3::new(p[0].abs().max(q[0].abs()), 0.0, p[1].abs().max(q[1].abs()));
        Root::new(t, number, &slope, normal, normal.abs().dot(reach)).map(Some)
    }

    /// The root at the lower or the upper cap.
    fn cap(&self, line: &Line, upper: bool) -> Decided<Option<Root>> {
        let (o, d) = (&line.origin.0[1], &line.direction.0[1]);
        let height = self.y[usize::from(upper)];
        let above = line.number(height) - o;
        if d.sign()? == Ordering::Equal {
            return match above.sign()? {
                Ordering::Equal => Err(Undecided),
                _ => Ok(None),
            };
        }
        let t = above.over(d)?;
        let (x, z) = (line.coordinate(0, &t), line.coordinate(2, &t));
        let mut inside = false;
        for (p, q) in self.edges() {
            let [p, q] = [p, q].map(|point| point.map(|coordinate| line.number(coordinate)));
            inside ^= crosses([&p[0], &p[1]], [&q[0], &q[1]], &x, &z)?;
        }
        if !inside {
            return Ok(None);
        }
        let (side, number) = if upper { (1.0, 1) } else { (-1.0, 0) };
        let slope = d * line.number(side);
        let number = self.outline.len() as u32 + number;
        Root::new(t, number, &slope, side * DVec3::Y, height.abs()).map(Some)
    }
}

/// Whether a number lies between two others; undecided if it is one of them.
fn is_between(x: &Interval, low: &Interval, high: &Interval) -> Decided<bool> {
    match [(x - low).sign()?, (high - x).sign()?] {
        [Ordering::Less, _] | [_, Ordering::Less] => Ok(false),
        [Ordering::Greater, Ordering::Greater] => Ok(true),
        _ => Err(Undecided),
    }
}

impl Surface for Prism {
    fn meet(&self, line: &Line) -> Decided<Roots> {
        let mut all = Vec::new();
        for ((p, q), number) in self.edges().zip(0..) {
            all.extend(self.side(line, number, p, q)?);
        }
        for upper in [false, true] {
            all.extend(self.cap(line, upper)?);
        }
        Ok(Roots::new(all))
    }

    fn ball(&self) -> Option<(DVec3, f64)> {
        let [x, z] = *self.outline.first()?;
        let [low, high] = self.y;
        let far = |p: &[f64; 2]| (p[0] - x).hypot(p[1] - z);
        let widest = self.outline.iter().map(far).fold(0.0, f64::max);
        Some((
            DVec3::new(x, 0.5 * (low + high), z),
            widest.hypot(0.5 * (high - low)),
        ))
    }
}
