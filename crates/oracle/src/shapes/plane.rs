//! z = 0, endless; as an operand all that is below it.

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

/// Where a line meets the plane z = 0; a line within it meets it nowhere in particular.
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

/// The place where a line meets the plane z = 0, if it is one of those that `holds` says of its x
/// and y.
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
        // Below at the far end behind: it comes up, or always was there.
        roots.from_inside = match line.direction.0[2].sign()? {
            Ordering::Greater => true,
            Ordering::Less => false,
            Ordering::Equal => line.origin.0[2].sign()? == Ordering::Less,
        };
        Ok(roots)
    }
}
