//! An isosurface of a density that is interpolated between grid points.

use super::jet::Jet;
use super::number::Number;
use super::{Level, LevelSet};
use crate::shapes::heightfield::m;
use serde::Deserialize;
use whitstone_core::config::FilePath;
use whitstone_core::{DVec3, SceneError, SceneErrors};
use whitstone_scene::Description;

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Config {
    size: [usize; 3],
    values: Option<Vec<f64>>,
    file: Option<FilePath>,
    format: Option<String>,
    generator: Option<String>,
    #[serde(default)]
    seed: u32,
    balls: Option<u32>,
    iso_value: Option<f64>,
}

/// Grid values, negative where the density is above the iso value.
pub(crate) struct Grid {
    size: [usize; 3],
    values: Vec<f64>,
}

impl Config {
    pub(crate) fn read(self, description: &Description<'_>) -> Result<LevelSet<Grid>, SceneErrors> {
        let size = self.size;
        let values = if let Some(values) = self.values {
            values
        } else if let Some(file) = &self.file {
            let path = description.sources.path_of(file);
            let bytes = std::fs::read(path);
            let bytes = bytes.map_err(|error| SceneError::at(file.span.clone(), error.to_string()))?;
            match self.format.as_deref() {
                Some("u8") => bytes.iter().map(|byte| f64::from(*byte)).collect(),
                _ => bytes
                    .chunks_exact(4)
                    .map(|four| f64::from(f32::from_le_bytes([four[0], four[1], four[2], four[3]])))
                    .collect(),
            }
        } else {
            let noise = self.generator.as_deref() == Some("noise");
            let of = |place: [usize; 3]| match noise {
                true => noise_at(self.seed, place),
                false => metaballs_at(self.seed, self.balls.unwrap_or(8), size, place),
            };
            let [nx, ny, nz] = size;
            (0..nx * ny * nz)
                .map(|n| of([n % nx, n / nx % ny, n / (nx * ny)]))
                .collect()
        };
        let level = self.iso_value.unwrap_or(0.5);
        Ok(LevelSet(Grid {
            size,
            values: values.into_iter().map(|value| -(value - level)).collect(),
        }))
    }
}

fn noise_at(seed: u32, place: [usize; 3]) -> f64 {
    let [i, j, k] = place.map(|x| x as u32);
    let h = m(m(m(seed.wrapping_add(i)).wrapping_add(j)).wrapping_add(k));
    f64::from(h) / 4_294_967_296.0
}

fn metaballs_at(seed: u32, balls: u32, size: [usize; 3], place: [usize; 3]) -> f64 {
    let p: [f64; 3] = std::array::from_fn(|axis| 2.0 * place[axis] as f64 / (size[axis] - 1) as f64 - 1.0);
    let ball = |b: u32| {
        let h = |a: u32| f64::from(m(m(seed.wrapping_add(m(b))).wrapping_add(a))) / 4_294_967_296.0;
        let c = DVec3::new(h(0) - 0.5, h(1) - 0.5, h(2) - 0.5);
        let r = 0.3 + 0.15 * h(3);
        let part = DVec3::from_array(p).distance_squared(c) / (r * r);
        if part < 1.0 {
            (1.0 - part) * (1.0 - part)
        } else {
            0.0
        }
    };
    (0..balls).map(ball).sum()
}

impl Grid {
    fn value(&self, [i, j, k]: [usize; 3]) -> f64 {
        self.values[(k * self.size[1] + j) * self.size[0] + i]
    }

    /// The interpolant of one cell, extended to all points; `x` is in grid steps.
    fn cell<N: Number>(&self, cell: [usize; 3], x: &[Jet<N>; 3]) -> Jet<N> {
        let part: [Jet<N>; 3] = std::array::from_fn(|axis| x[axis].minus(&x[axis].number(cell[axis] as f64)));
        let between = |axis: usize, low: Jet<N>, high: Jet<N>| {
            let step = high.minus(&low);
            low.plus(&step.times(&part[axis]))
        };
        let corner = |i, j, k| x[0].constant(self.value([cell[0] + i, cell[1] + j, cell[2] + k]));
        let row = |j, k| between(0, corner(0, j, k), corner(1, j, k));
        let sheet = |k| between(1, row(0, k), row(1, k));
        between(2, sheet(0), sheet(1))
    }
}

impl Level for Grid {
    fn at<N: Number>(&self, p: &[Jet<N>; 3]) -> Jet<N> {
        // The point in grid steps, and the range of cells that it may lie in.
        let x: [Jet<N>; 3] = std::array::from_fn(|axis| {
            let half = p[axis].number(0.5 * (self.size[axis] - 1) as f64);
            p[axis].plus(&p[axis].number(1.0)).times(&half)
        });
        let cells: [[usize; 2]; 3] = std::array::from_fn(|axis| {
            let last = self.size[axis] as f64 - 2.0;
            // Outside of the box any value will do.
            x[axis]
                .value
                .ends()
                .map(|end| end.floor().clamp(0.0, last) as usize)
        });
        let spans = |most: usize| cells.iter().all(|[low, high]| high - low <= most);
        let all = |extra: usize| {
            let [a, b, c] = cells.map(|[low, high]| low..=high + extra);
            a.flat_map(move |i| {
                let c = c.clone();
                b.clone().flat_map(move |j| c.clone().map(move |k| [i, j, k]))
            })
        };
        if spans(1) {
            let each = all(0).map(|cell| self.cell(cell, &x));
            let hull = |a: Jet<N>, b: Jet<N>| Jet {
                value: a.value.hull(&b.value),
                slope: a.slope.zip(b.slope).map(|(a, b)| a.hull(&b)),
                moves: a.moves.max(b.moves),
            };
            return each.reduce(hull).unwrap_or_else(|| p[0].number(1.0));
        }
        let values = all(1).map(|place| self.value(place));
        let [low, high] = values.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], value| {
            [low.min(value), high.max(value)]
        });
        Jet {
            value: p[0].value.like(low).hull(&p[0].value.like(high)),
            slope: None,
            moves: f64::INFINITY,
        }
    }

    fn bounds(&self) -> (Option<[DVec3; 2]>, Option<f64>) {
        (Some([-DVec3::ONE, DVec3::ONE]), None)
    }
}
