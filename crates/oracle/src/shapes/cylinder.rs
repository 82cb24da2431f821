//! `x² + y² = radius²` between two heights.

use super::conic::{Conic, Cut};
use super::{Surface, yes};
use crate::interval::Decided;
use crate::root::Roots;
use crate::vector::Line;
use serde::Deserialize;
use whitstone_core::DVec3;

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Cylinder {
    #[serde(default = "one")]
    pub(crate) radius: f64,
    #[serde(default = "heights")]
    pub(crate) z: [f64; 2],
    #[serde(default = "yes")]
    pub(crate) caps: bool,
}

fn one() -> f64 {
    1.0
}

fn heights() -> [f64; 2] {
    [-1.0, 1.0]
}

impl Surface for Cylinder {
    fn meet(&self, line: &Line) -> Decided<Roots> {
        let (zero, one) = (line.number(0.0), line.number(1.0));
        let constant = -line.number(self.radius).squared();
        let conic = Conic::straight([one.clone(), one, zero.clone()], zero, constant);
        let moves = 2.0 * self.radius * self.radius;
        conic.meet(line, &Cut::between(self.z, self.caps), |_| moves)
    }

    fn ball(&self) -> Option<(DVec3, f64)> {
        let [bottom, top] = self.z;
        Some((DVec3::ZERO, self.radius.hypot(bottom.abs().max(top.abs()))))
    }
}
