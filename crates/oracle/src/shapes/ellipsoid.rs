//! `(x/a)² + (y/b)² + (z/c)² = 1`.

use super::Surface;
use super::conic::{Conic, Cut};
use crate::interval::Decided;
use crate::root::Roots;
use crate::vector::Line;
use serde::Deserialize;
use whitstone_core::DVec3;

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Ellipsoid {
    #[serde(default = "ones")]
    pub(crate) radii: [f64; 3],
}

fn ones() -> [f64; 3] {
    [1.0; 3]
}

impl Surface for Ellipsoid {
    fn meet(&self, line: &Line) -> Decided<Roots> {
        // Multiplied by (a b c)², to avoid quotients.
        let [a, b, c] = self.radii.map(|radius| line.number(radius).squared());
        let all = &a * &b * &c;
        let conic = Conic::straight([&b * &c, &a * &c, &a * &b], line.number(0.0), -&all);
        // Twice the sum of the squares, which is 1: squares double relative changes.
        let moves = 2.0 * all.nearest();
        conic.meet(line, &Cut::NONE, |_| moves)
    }

    fn ball(&self) -> Option<(DVec3, f64)> {
        Some((DVec3::ZERO, DVec3::from_array(self.radii).abs().max_element()))
    }
}
