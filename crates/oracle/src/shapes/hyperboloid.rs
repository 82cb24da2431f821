//! `x² + y² = radius² + slope² z²` between two heights.

use super::conic::{Conic, Cut};
use super::{Surface, yes};
use crate::interval::Decided;
use crate::root::Roots;
use crate::vector::Line;
use serde::Deserialize;

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Hyperboloid {
    #[serde(default = "radius")]
    pub(crate) radius: f64,
    #[serde(default = "slope")]
    pub(crate) slope: f64,
    #[serde(default = "heights")]
    pub(crate) z: [f64; 2],
    #[serde(default = "yes")]
    pub(crate) caps: bool,
}

fn radius() -> f64 {
    0.5
}

fn slope() -> f64 {
    1.0
}

fn heights() -> [f64; 2] {
    [-1.0, 1.0]
}

impl Surface for Hyperboloid {
    fn meet(&self, line: &Line) -> Decided<Roots> {
        let one = line.number(1.0);
        let [radius, slope] = [self.radius, self.slope].map(|x| line.number(x).squared());
        let conic = Conic::straight([one.clone(), one, -slope], line.number(0.0), -radius);
        conic.meet(line, &Cut::between(self.z, self.caps), |p| {
            let widening = self.slope * p.z;
            2.0 * (self.radius * self.radius + widening * widening)
        })
    }
}
