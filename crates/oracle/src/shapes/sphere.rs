//! `|p - center| = radius`.

use super::Surface;
use crate::interval::Decided;
use crate::quadratic;
use crate::root::{Root, Roots};
use crate::vector::Line;
use serde::Deserialize;
use whitstone_core::DVec3;

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Sphere {
    #[serde(default)]
    pub(crate) center: [f64; 3],
    #[serde(default = "one")]
    pub(crate) radius: f64,
}

fn one() -> f64 {
    1.0
}

impl Surface for Sphere {
    fn meet(&self, line: &Line) -> Decided<Roots> {
        let l = line.origin.minus(&line.point(self.center));
        let radius = line.number(self.radius);
        let d = &line.direction;
        let roots = quadratic::roots(&d.dot(d), &l.dot(d), &(l.dot(&l) - &radius * &radius))?;
        let center = DVec3::from_array(self.center);
        let root = |(t, slope)| {
            let normal = line.at(&t).nearest() - center;
            let moves = normal.abs().dot(center.abs()) + self.radius * self.radius;
            Root::new(t, 0, &slope, normal, moves)
        };
        let all: Decided<_> = roots.into_iter().map(root).collect();
        Ok(Roots::new(all?))
    }

    fn ball(&self) -> Option<(DVec3, f64)> {
        Some((DVec3::from_array(self.center), self.radius.abs()))
    }
}
