//! z = 0, x² + y² <= 1.

use super::{Surface, plane};
use crate::interval::Decided;
use crate::root::Roots;
use crate::vector::Line;
use serde::Deserialize;
use whitstone_core::DVec3;

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Disk {}

impl Surface for Disk {
    fn meet(&self, line: &Line) -> Decided<Roots> {
        plane::part(line, |x, y| {
            (x.squared() + y.squared() - line.number(1.0)).is_at_most_zero()
        })
    }

    fn ball(&self) -> Option<(DVec3, f64)> {
        Some((DVec3::ZERO, 1.0))
    }
}
