//! A procedural landscape: a grid of up to 2^26 quads displaced by noise, without a file.
//!
//! Value noise in octaves on an integer hash (`lowbias32`: C. Wellons, *Prospecting for hash
//! functions*, 2018), so the result is the same on every machine. Coordinates are rounded to single
//! precision, as in most mesh files.
//!
//! - Twin: Mitsuba mesh (native) with the same vertices.
//! - Example: `scenes/shapes/heightfield.toml`.

use crate::support::lower::{Triangles, lower};
use rayon::prelude::*;
use schemars::JsonSchema;
use serde::Deserialize;
use whitstone_core::config::{IntegerIn, NonNegative};
use whitstone_core::hash::mix;
use whitstone_core::{Context, DVec3, LoweredShape, Plugin, SceneError, SceneErrors, Shapes, Transform};

/// Maximum number of quads: twice as many triangles still fit the indices of the accelerators.
const MAX_QUADS: u64 = 1 << 26;

/// A procedural landscape over the square from -1 to 1 in x and y, with z up: a mesh with two
/// triangles per quad.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// Quads along x; columns times rows is at most 2^26.
    #[serde(default = "size")]
    columns: IntegerIn<1, 65536>,
    /// Quads along y.
    #[serde(default = "size")]
    rows: IntegerIn<1, 65536>,
    /// Amplitude of the first octave in metres; it halves with each octave.
    #[serde(default = "height")]
    amplitude: NonNegative,
    /// Lattice cells ("hills") per side in the first octave; they double with each octave.
    #[serde(default = "hills")]
    hills: IntegerIn<1, 1024>,
    /// Number of octaves.
    #[serde(default = "octaves")]
    octaves: IntegerIn<1, 16>,
    /// Seed of the noise.
    #[serde(default = "seed")]
    seed: IntegerIn<0, { u32::MAX }>,
}

fn size() -> IntegerIn<1, 65536> {
    IntegerIn::new(64).expect("in range")
}

fn height() -> NonNegative {
    NonNegative::new(0.2).expect("not negative")
}

fn hills() -> IntegerIn<1, 1024> {
    IntegerIn::new(4).expect("in range")
}

fn seed() -> IntegerIn<0, { u32::MAX }> {
    IntegerIn::new(0).expect("in range")
}

fn octaves() -> IntegerIn<1, 16> {
    IntegerIn::new(8).expect("in range")
}

/// Lowers to triangles in world space.
pub struct Heightfield;

impl Plugin<Shapes> for Heightfield {
    const TYPE: &'static str = "heightfield";
    type Config = Config;

    fn build(
        config: Config,
        transform: Transform,
        context: &mut dyn Context,
    ) -> Result<LoweredShape, SceneErrors> {
        let (columns, rows) = (config.columns.get(), config.rows.get());
        let quads = u64::from(columns) * u64::from(rows);
        if quads > MAX_QUADS {
            let message = format!("{columns} x {rows} is more than {MAX_QUADS} quads");
            return Err(SceneError::anywhere(message).into());
        }
        context.reserve(quads * (size_of::<DVec3>() + 2 * size_of::<[u32; 3]>()) as u64)?;
        let object = landscape(&config);
        let beyond =
            || SceneError::anywhere("the transform moves a vertex out of the range of double precision");
        Ok(LoweredShape::Triangles(
            lower(object, &transform).ok_or_else(beyond)?.mesh,
        ))
    }
}

fn landscape(config: &Config) -> Triangles {
    let (columns, rows) = (config.columns.get(), config.rows.get());
    let amplitude = config.amplitude.get();
    let octaves: Vec<Octave> = (0..config.octaves.get())
        .map(|k| Octave {
            hills: u64::from(config.hills.get()) << k,
            amplitude: amplitude * 0.5f64.powi(k as i32),
            seed: mix(config.seed.get().wrapping_add(mix(k))),
        })
        .collect();
    let mut positions = vec![DVec3::ZERO; (columns as usize + 1) * (rows as usize + 1)];
    let lines = positions.par_chunks_mut(columns as usize + 1);
    lines.zip(0..rows + 1).for_each(|(line, j)| {
        for (position, i) in line.iter_mut().zip(0..=columns) {
            let z = octaves
                .iter()
                .map(|octave| octave.height([i, j], [columns, rows]))
                .sum();
            let across = |i: u32, of: u32| 2.0 * f64::from(i) / f64::from(of) - 1.0;
            *position = DVec3::new(across(i, columns), across(j, rows), z)
                .as_vec3()
                .as_dvec3();
        }
    });
    let mut triangles = vec![[0; 3]; 2 * columns as usize * rows as usize];
    let lines = triangles.par_chunks_mut(2 * columns as usize);
    lines.zip(0..rows).for_each(|(line, j)| {
        for (pair, i) in line.chunks_exact_mut(2).zip(0..columns) {
            let a = j * (columns + 1) + i;
            let (b, d) = (a + 1, a + columns + 1);
            let c = d + 1;
            pair[0] = [a, b, c];
            pair[1] = [a, c, d];
        }
    });
    Triangles {
        positions,
        triangles,
        ..Triangles::default()
    }
}

/// One octave of noise.
struct Octave {
    /// Lattice cells per side.
    hills: u64,
    amplitude: f64,
    seed: u32,
}

impl Octave {
    /// The height at a vertex of a grid with this many quads.
    fn height(&self, vertex: [u32; 2], quads: [u32; 2]) -> f64 {
        // The product is exact, so there is only one rounding.
        let at = |k: usize| (u64::from(vertex[k]) * self.hills) as f64 / f64::from(quads[k]);
        let (x, y) = (at(0), at(1));
        let (cell_x, cell_y) = (x.floor(), y.floor());
        let (u, v) = (ease(x - cell_x), ease(y - cell_y));
        let corner = |dx: u32, dy: u32| {
            let row = mix(self.seed.wrapping_add(cell_y as u32).wrapping_add(dy));
            let hash = mix(row.wrapping_add(cell_x as u32).wrapping_add(dx));
            f64::from(hash) / 2f64.powi(31) - 1.0
        };
        let between = |a: f64, b: f64, t: f64| a + t * (b - a);
        let near = between(corner(0, 0), corner(1, 0), u);
        let far = between(corner(0, 1), corner(1, 1), u);
        self.amplitude * between(near, far, v)
    }
}

fn ease(t: f64) -> f64 {
    t * t * (3.0 - 2.0 * t)
}

#[cfg(test)]
mod tests {
    use super::*;
    use whitstone_testkit::{build, shape_laws_everywhere};

    fn mesh(text: &str) -> whitstone_core::TriangleMesh {
        match build::<Shapes, Heightfield>(text, Transform::IDENTITY) {
            Ok(LoweredShape::Triangles(mesh)) => mesh,
            _ => panic!("a heightfield is triangles"),
        }
    }

    #[test]
    fn obeys_the_laws_of_shapes() {
        shape_laws_everywhere::<Heightfield>("columns = 5\nrows = 4\nhills = 2\namplitude = 0.6", 2_000);
    }

    #[test]
    fn vertices_and_quads_are_where_the_model_says() {
        let mesh = mesh("columns = 2\nrows = 1\nseed = 7\noctaves = 1\nhills = 1\namplitude = 1");
        let flat: Vec<[f64; 2]> = mesh.positions.iter().map(|p| [p.x, p.y]).collect();
        assert_eq!(
            flat,
            [
                [-1.0, -1.0],
                [0.0, -1.0],
                [1.0, -1.0],
                [-1.0, 1.0],
                [0.0, 1.0],
                [1.0, 1.0]
            ]
        );
        assert_eq!(mesh.triangles, [[0, 1, 4], [0, 4, 3], [1, 2, 5], [1, 5, 4]]);
        // At a lattice point the height is the hash; halfway it is the mean of two.
        let hash = |x: u32, y: u32| mix(mix(mix(7 + mix(0)).wrapping_add(y)).wrapping_add(x));
        let value = |x, y| f64::from(hash(x, y)) / 2f64.powi(31) - 1.0;
        assert_eq!(mesh.positions[0].z, f64::from(value(0, 0) as f32));
        assert_eq!(
            mesh.positions[4].z,
            f64::from((value(0, 1) + 0.5 * (value(1, 1) - value(0, 1))) as f32)
        );
        assert_eq!(mix(1), 0x6889_90c0);
    }

    #[test]
    fn too_many_quads_are_refused() {
        let error = build::<Shapes, Heightfield>("columns = 65536\nrows = 65536", Transform::IDENTITY);
        let message = error.err().unwrap().0.remove(0).message;
        assert_eq!(message, "65536 x 65536 is more than 67108864 quads");
    }
}
