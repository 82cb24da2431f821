//! The infinite plane z = 0; as a CSG operand, the half-space below it.

use super::Surface;
use crate::interval::{Decided, Interval, Undecided};
use crate::root::{Root, Roots};
use crate::vector::Line;
use serde::Deserialize;
use std::cmp::Ordering;
use whitstone_core::DVec3;

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Plane {}

/// The intersection of a line with the plane z = 0. Undecided if the line lies in it.
pub(super) fn meet(line: &Line) -> Decided<Option<Interval>> {
    let (height, slope) = (&line.origin.0[2], &line.direction.0[2]);
    if slope.sign()? != Ordering::Equal {
        return Ok(Some((-height).over(slope)?));
    }
    match height.sign()? {
        Ordering::Equal => Err(Undecided),
        _ => Ok(None),
    }
}

/// The intersection with the part of the plane z = 0 whose x and y satisfy `holds`.
pub(super) fn part(line: &Line, holds: impl Fn(&Interval, &Interval) -> Decided<bool>) -> Decided<Roots> {
    let Some(t) = meet(line)? else {
        return Ok(Roots::default());
    };
    if !holds(&line.coordinate(0, &t), &line.coordinate(1, &t))? {
        return Ok(Roots::default());
    }
    let root = Root::new(t, 0, &line.direction.0[2], DVec3::Z, 0.0)?;
    Ok(Roots::new(vec![root]))
}

impl Surface for Plane {
    fn meet(&self, line: &Line) -> Decided<Roots> {
        let mut roots = part(line, |_, _| Ok(true))?;
        // At t = -infinity the line is below the plane if it rises, or if it is parallel to it and
        // below.
        roots.from_inside = match line.direction.0[2].sign()? {
            Ordering::Greater => true,
            Ordering::Less => false,
            Ordering::Equal => line.origin.0[2].sign()? == Ordering::Less,
        };
        Ok(roots)
    }
}
