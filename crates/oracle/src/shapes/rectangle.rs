//! z = 0, -1 <= x, y <= 1.

use super::{Surface, plane};
use crate::interval::{Decided, Interval};
use crate::root::Roots;
use crate::vector::Line;
use serde::Deserialize;
use whitstone_core::DVec3;

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Rectangle {}

impl Surface for Rectangle {
    fn meet(&self, line: &Line) -> Decided<Roots> {
        let near = |x: &Interval| (x.abs() - line.number(1.0)).is_at_most_zero();
        plane::part(line, |x, y| Ok(near(x)? && near(y)?))
    }

    fn ball(&self) -> Option<(DVec3, f64)> {
        Some((DVec3::ZERO, std::f64::consts::SQRT_2))
    }
}
