//! A procedural height field. Its vertices are computed in doubles and rounded to single precision,
//! as the model specifies.

use super::triangle::Triangles;
use serde::Deserialize;

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Heightfield {
    #[serde(default = "side")]
    columns: u32,
    #[serde(default = "side")]
    rows: u32,
    #[serde(default = "amplitude")]
    amplitude: f64,
    #[serde(default = "hills")]
    hills: u64,
    #[serde(default = "octaves")]
    octaves: u32,
    #[serde(default)]
    seed: u32,
}

fn side() -> u32 {
    64
}

fn amplitude() -> f64 {
    0.2
}

fn hills() -> u64 {
    4
}

fn octaves() -> u32 {
    8
}

/// The integer hash of the model.
pub(crate) fn m(mut x: u32) -> u32 {
    x ^= x >> 16;
    x = x.wrapping_mul(0x7feb_352d);
    x ^= x >> 15;
    x = x.wrapping_mul(0x846c_a68b);
    x ^ x >> 16
}

impl Heightfield {
    pub(crate) fn triangles(&self) -> Triangles {
        let mut triangles = Vec::new();
        for j in 0..self.rows {
            for i in 0..self.columns {
                let [a, b, c, d] =
                    [[i, j], [i + 1, j], [i + 1, j + 1], [i, j + 1]].map(|[i, j]| self.vertex(i, j));
                triangles.extend([[a, b, c], [a, c, d]]);
            }
        }
        Triangles(triangles)
    }

    fn vertex(&self, i: u32, j: u32) -> [f64; 3] {
        let across = |i: u32, count: u32| 2.0 * f64::from(i) / f64::from(count) - 1.0;
        let mut z = 0.0;
        for k in 0..self.octaves {
            let h = self.hills << k;
            let p = (u64::from(i) * h) as f64 / f64::from(self.columns);
            let q = (u64::from(j) * h) as f64 / f64::from(self.rows);
            z += self.amplitude * 0.5f64.powi(k as i32) * self.noise(k, p, q);
        }
        [across(i, self.columns), across(j, self.rows), z].map(|x| f64::from(x as f32))
    }

    /// The noise `N_k` of the model.
    fn noise(&self, k: u32, p: f64, q: f64) -> f64 {
        let s = m(self.seed.wrapping_add(m(k)));
        let (column, row) = (p.floor() as u32, q.floor() as u32);
        let eased = |t: f64| t * t * (3.0 - 2.0 * t);
        let (u, v) = (eased(p - p.floor()), eased(q - q.floor()));
        let value = |i: u32, j: u32| f64::from(m(m(s.wrapping_add(j)).wrapping_add(i))) / 2f64.powi(31) - 1.0;
        let along_u = |j: u32| {
            let (a, b) = (value(column, j), value(column + 1, j));
            a + u * (b - a)
        };
        let (a, b) = (along_u(row), along_u(row + 1));
        a + v * (b - a)
    }
}
