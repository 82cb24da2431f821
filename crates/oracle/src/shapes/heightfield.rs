//! A height field of noise or of a texture. Its vertices are computed in doubles and rounded to
//! single precision, as the model specifies.

use super::triangle::Triangles;
use crate::tracer::texture::VertexTexture;
use serde::Deserialize;
use whitstone_core::config::TextureRef;
use whitstone_core::{DVec3, SceneError, SceneErrors};
use whitstone_scene::Description;

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Heightfield {
    #[serde(default = "side")]
    columns: u32,
    #[serde(default = "side")]
    rows: u32,
    amplitude: Option<f64>,
    hills: Option<u64>,
    octaves: Option<u32>,
    seed: Option<u32>,
    height: Option<TextureRef>,
    scale: Option<f64>,
    offset: Option<f64>,
}

fn side() -> u32 {
    64
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
    pub(crate) fn triangles(&self, description: &Description<'_>) -> Result<Triangles, SceneErrors> {
        let of_noise =
            self.amplitude.is_some() || self.hills.is_some() || self.octaves.is_some() || self.seed.is_some();
        let of_texture = self.scale.is_some() || self.offset.is_some();
        let height = match &self.height {
            Some(reference) => Some(VertexTexture::new(description, reference)?),
            None => None,
        };
        if (height.is_some() && of_noise) || (height.is_none() && of_texture) {
            let message = "the oracle does not support keys of noise and of a texture in one height field";
            return Err(SceneError::anywhere(message).into());
        }
        let vertex = |[i, j]: [u32; 2]| self.vertex(height.as_ref(), i, j);
        let mut triangles = Vec::new();
        for j in 0..self.rows {
            for i in 0..self.columns {
                let [a, b, c, d] = [[i, j], [i + 1, j], [i + 1, j + 1], [i, j + 1]].map(vertex);
                triangles.extend([[a, b, c], [a, c, d]]);
            }
        }
        if triangles.iter().flatten().flatten().all(|x: &f64| x.is_finite()) {
            Ok(Triangles(triangles))
        } else {
            Err(SceneError::anywhere("a height is not finite in single precision").into())
        }
    }

    fn vertex(&self, height: Option<&VertexTexture>, i: u32, j: u32) -> [f64; 3] {
        let across = |i: u32, count: u32| 2.0 * f64::from(i) / f64::from(count) - 1.0;
        let [x, y] = [across(i, self.columns), across(j, self.rows)];
        let z = match height {
            None => self.noise(i, j),
            Some(height) => {
                let uv = [
                    f64::from(i) / f64::from(self.columns),
                    f64::from(j) / f64::from(self.rows),
                ];
                let [h, ..] = height.at(DVec3::new(x, y, 0.0), DVec3::Z, uv);
                self.scale.unwrap_or(1.0) * (h - self.offset.unwrap_or(0.0))
            }
        };
        [x, y, z].map(|x| f64::from(x as f32))
    }

    /// The sum of all octaves at vertex (i, j).
    fn noise(&self, i: u32, j: u32) -> f64 {
        let mut z = 0.0;
        for k in 0..self.octaves.unwrap_or(8) {
            let h = self.hills.unwrap_or(4) << k;
            let p = (u64::from(i) * h) as f64 / f64::from(self.columns);
            let q = (u64::from(j) * h) as f64 / f64::from(self.rows);
            z += self.amplitude.unwrap_or(0.2) * 0.5f64.powi(k as i32) * self.octave(k, p, q);
        }
        z
    }

    /// The noise `N_k` of the model.
    fn octave(&self, k: u32, p: f64, q: f64) -> f64 {
        let s = m(self.seed.unwrap_or(0).wrapping_add(m(k)));
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

#[cfg(test)]
mod tests {
    use crate::testing::{pixel, seen, shows};

    /// Seen from above: a 2 x 1 grid with heights at its vertices from a block of voxels, which
    /// shows its z as a colour: 0.5 + z/4.
    fn ground(mapping: &str) -> String {
        let height = format!(
            "{{ type = \"solid\", size = [3, 2, 1], values = [0, 0.5, 0.25, 1, 0.75, 0.125], \
            filter = \"nearest\", wrap = \"clamp\", mapping = {mapping} }}"
        );
        let ramp = "{ type = \"gradient\", a = 0, b = 1, scale = 0.25, offset = 0.5, wrap = \"clamp\", \
            mapping = { transform = { matrix = [[0, 0, 1, 0], [0, 1, 0, 0], [1, 0, 0, 0]] } } }";
        format!(
            "[[shape]]\ntype = \"heightfield\"\ncolumns = 2\nrows = 1\nheight = {height}\nscale = 2\n\
            offset = 0.25\nmaterial = {{ type = \"matte\", reflectance = {ramp} }}\n"
        )
    }

    /// The vertices have x = -1, 0, 1 and y = -1, 1, and the voxels of the same numbers.
    #[test]
    fn heights_of_a_texture() {
        let by_uv = "{ projection = \"uv\" }";
        let by_place = "{ transform = [{ translate = [1, 1, 0] }, { scale = 0.5 }] }";
        for text in [by_uv, by_place].map(ground) {
            let z = |h: f64| 2.0 * (h - 0.25);
            // On the diagonals, halfway between two vertices, the view is along z.
            for (x, [near, far]) in [(-0.5, [0.0, 0.75]), (0.5, [0.5, 0.125])] {
                let expected = 0.5 + 0.25 * (z(near) + z(far)) / 2.0;
                shows([x, 0.0], &text, &[], [expected; 3]);
            }
            // In the triangle (0, -1), (1, -1), (1, 1).
            let expected = 0.5 + 0.25 * (0.5 * z(0.5) + 0.25 * z(0.25) + 0.25 * z(0.125));
            shows([0.5, -0.5], &text, &[], [expected; 3]);
        }
    }

    #[test]
    fn keys_of_the_other_kind_are_refused() {
        let shape = |keys: &str| format!("[[shape]]\ntype = \"heightfield\"\n{keys}");
        for keys in ["height = 1\nseed = 2", "scale = 2", "height = 1e30\nscale = 1e30"] {
            assert!(pixel([0.0; 2], &shape(keys), &[]).is_err(), "{keys}");
        }
        assert!(seen([0.1, 0.2], &shape("height = 1\noffset = 0.5"), &[]).is_some());
    }
}
