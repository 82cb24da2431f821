//! The box: the surface of `[-1,1]³`. Rays in its faces, along its edges and through its corners
//! hit it.

use super::Surface;
use crate::interval::{Decided, Interval};
use crate::root::{Root, Roots};
use crate::vector::Line;
use serde::Deserialize;
use std::cmp::Ordering;
use whitstone_core::DVec3;

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Cuboid {}

/// One end of the segment between a pair of opposite faces.
struct End {
    t: Interval,
    axis: usize,
}

impl End {
    /// The later of two entries, or the earlier of two exits (`later` = false). If both are equal
    /// or cannot be told apart, t encloses both.
    fn decisive(self, other: Self, later: bool) -> Self {
        let (t, axis) = if later {
            (
                self.t.max(&other.t),
                self.t.compare(&other.t) == Ok(Ordering::Less),
            )
        } else {
            (
                self.t.min(&other.t),
                self.t.compare(&other.t) == Ok(Ordering::Greater),
            )
        };
        Self {
            t,
            axis: if axis { other.axis } else { self.axis },
        }
    }
}

impl Surface for Cuboid {
    fn meet(&self, line: &Line) -> Decided<Roots> {
        let one = line.number(1.0);
        let mut part: Option<[End; 2]> = None;
        for axis in 0..3 {
            let (o, d) = (&line.origin.0[axis], &line.direction.0[axis]);
            let side = d.sign()?;
            if side == Ordering::Equal {
                if !(o.abs() - &one).is_at_most_zero()? {
                    return Ok(Roots::default());
                }
                continue;
            }
            let at = |face: Interval| -> Decided<End> {
                let t = (face - o).over(d)?;
                Ok(End { t, axis })
            };
            let [mut enter, mut exit] = [at(-&one)?, at(one.clone())?];
            if side == Ordering::Less {
                std::mem::swap(&mut enter, &mut exit);
            }
            part = Some(match part {
                None => [enter, exit],
                Some([first, last]) => [first.decisive(enter, true), last.decisive(exit, false)],
            });
        }
        let Some([enter, exit]) = part else {
            return Ok(Roots::default());
        };
        if (&enter.t - &exit.t).is_positive()? {
            return Ok(Roots::default());
        }
        let root = |End { t, axis }: End, side: f64| {
            let d = &line.direction.0[axis];
            let outward = side * if d.sign()? == Ordering::Less { -1.0 } else { 1.0 };
            let face = 2 * axis as u32 + u32::from(outward > 0.0);
            Root::new(
                t,
                face,
                &(d * line.number(outward)),
                outward * DVec3::AXES[axis],
                0.0,
            )
        };
        Ok(Roots::new(vec![root(enter, -1.0)?, root(exit, 1.0)?]))
    }

    fn ball(&self) -> Option<(DVec3, f64)> {
        Some((DVec3::ZERO, 3.0_f64.sqrt()))
    }
}
