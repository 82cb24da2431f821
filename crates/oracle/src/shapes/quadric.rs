//! General quadrics, clipped by a box.

use super::conic::{Conic, Cut};
use super::{Surface, yes};
use crate::interval::Decided;
use crate::root::Roots;
use crate::vector::{Line, Vector};
use serde::Deserialize;

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Quadric {
    matrix: Option<[[f64; 4]; 4]>,
    coefficients: Option<[f64; 10]>,
    #[serde(default = "unit")]
    pub(crate) r#box: [[f64; 3]; 2],
    #[serde(default = "yes")]
    pub(crate) caps: bool,
}

fn unit() -> [[f64; 3]; 2] {
    [[-1.0; 3], [1.0; 3]]
}

impl Quadric {
    /// A to J: coefficients of x², y², z², xy, xz, yz, x, y, z and 1. Doubling is exact.
    pub(crate) fn coefficients(&self) -> [f64; 10] {
        if let Some(m) = self.matrix {
            let twice = |i: usize, j: usize| 2.0 * m[i][j];
            return [
                m[0][0],
                m[1][1],
                m[2][2],
                twice(0, 1),
                twice(0, 2),
                twice(1, 2),
                twice(0, 3),
                twice(1, 3),
                twice(2, 3),
                m[3][3],
            ];
        }
        self.coefficients.unwrap_or([0.0; 10])
    }
}

impl Surface for Quadric {
    fn meet(&self, line: &Line) -> Decided<Roots> {
        let c = self.coefficients();
        let three = |k: usize| Vector::new([c[k], c[k + 1], c[k + 2]], line.bits());
        let conic = Conic {
            square: three(0),
            mixed: three(3),
            linear: three(6),
            constant: line.number(c[9]),
        };
        let [min, max] = self.r#box;
        let cut = Cut {
            slabs: [0, 1, 2].map(|axis| Some([min[axis], max[axis]])),
            caps: self.caps,
            first_axis: 0,
        };
        conic.meet(line, &cut, |p| {
            let [x, y, z] = p.to_array();
            let terms = [x * x, y * y, z * z, x * y, x * z, y * z, x, y, z, 1.0];
            c.iter().zip(terms).map(|(c, term)| (c * term).abs()).sum()
        })
    }
}
