//! `x² + y² = (r0 + (r1 - r0)(z - z0)/(z1 - z0))²` between two heights.

use super::conic::{Conic, Cut};
use super::{Surface, yes};
use crate::interval::Decided;
use crate::root::Roots;
use crate::vector::Line;
use serde::Deserialize;

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Cone {
    #[serde(default = "radii")]
    pub(crate) radii: [f64; 2],
    #[serde(default = "heights")]
    pub(crate) z: [f64; 2],
    #[serde(default = "yes")]
    pub(crate) caps: bool,
}

fn radii() -> [f64; 2] {
    [1.0, 0.0]
}

fn heights() -> [f64; 2] {
    [0.0, 1.0]
}

impl Surface for Cone {
    fn meet(&self, line: &Line) -> Decided<Roots> {
        let [r0, r1] = self.radii.map(|radius| line.number(radius));
        let [z0, z1] = self.z.map(|z| line.number(z));
        // Multiplied by (z1 - z0)²: the radius is (rise z + rest)/height.
        let (height, rise) = (&z1 - &z0, &r1 - &r0);
        let rest = &r0 * &height - &rise * &z0;
        let (square, product) = (height.squared(), &rise * &rest);
        let conic = Conic::straight(
            [square.clone(), square, -rise.squared()],
            -(&product + &product),
            -rest.squared(),
        );
        conic.meet(line, &Cut::between(self.z, self.caps), |p| {
            // The radius depends on four numbers; each contributes its share.
            let ([r0, r1], [z0, z1]) = (self.radii, self.z);
            let height = z1 - z0;
            let up = (p.z - z0) / height;
            let radius = r0 + (r1 - r0) * up;
            let slope = ((r1 - r0) / height).abs();
            let shares = r0 * (1.0 - up) + r1 * up + slope * ((1.0 - up) * z0.abs() + up * z1.abs());
            2.0 * height * height * radius.abs() * shares
        })
    }
}
