//! Worley (cellular) noise: the distance to scattered feature points.
//!
//! Worley, *A cellular texture basis function*, 1996. Here each cell of a grid has exactly one
//! feature point; Worley's cells have a random number of them.
//!
//! - Twin: Mitsuba, hosted: a Python texture, written from the model.
//! - Example: `scenes/textures/worley.toml`.

use crate::support::mapping::{Mapping, Projection, TextureFunction};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::sync::Arc;
use whitstone_core::config::{Color, IntegerIn, Positive};
use whitstone_core::hash::mix;
use whitstone_core::{Context, DVec3, Plugin, Rgb, SceneErrors, Texture, Textures};

/// Worley (cellular) noise: the distance to scattered feature points.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// Displayed value: "f1" is the distance to the nearest point, "f2" that to the second nearest,
    /// and "f2_minus_f1" their difference, which is 0 on the borders of the Voronoi cells.
    #[serde(default)]
    value: Value,
    /// Colour where the value is 0.
    #[serde(default = "dark")]
    a: Color,
    /// Colour where the value is the side of a grid cell or more.
    #[serde(default = "light")]
    b: Color,
    /// Grid cells per unit of texture space (a metre by default).
    #[serde(default = "one")]
    scale: Positive,
    /// Seed of the feature points.
    #[serde(default = "first")]
    seed: IntegerIn<0, { u32::MAX }>,
    /// Mapping of the texture.
    #[serde(default)]
    #[schemars(extend("x-default" = "by world-space position"))]
    mapping: Mapping,
}

fn dark() -> Color {
    Color::grey(0.2)
}

fn light() -> Color {
    Color::grey(0.8)
}

fn one() -> Positive {
    Positive::new(1.0).expect("1 is positive")
}

fn first() -> IntegerIn<0, { u32::MAX }> {
    IntegerIn::new(0).expect("0 is in range")
}

/// The displayed value.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
enum Value {
    /// The distance to the nearest point.
    #[default]
    F1,
    /// The distance to the second nearest point.
    F2,
    /// The difference of these two.
    F2MinusF1,
}

/// The `worley` texture; see the module documentation.
pub struct Worley {
    value: Value,
    a: Rgb,
    b: Rgb,
    scale: f64,
    seed: u32,
}

impl Plugin<Textures> for Worley {
    const TYPE: &'static str = "worley";
    type Config = Config;

    fn build(config: Config, (): (), _: &mut dyn Context) -> Result<Arc<dyn Texture>, SceneErrors> {
        let pattern = Self {
            value: config.value,
            a: config.a.get(),
            b: config.b.get(),
            scale: config.scale.get(),
            seed: mix(config.seed.get()),
        };
        config.mapping.put(Projection::Solid, pattern)
    }
}

/// Offsets of all cells up to two cells away, each with a lower bound on the squared distance of
/// its feature point, in ascending order of that bound.
///
/// **These suffice.** Let x be the position of the shaded point within its own cell and a_k =
/// max(x_k, 1 - x_k), at least 1/2, for each axis k. The feature point of the own cell is no
/// farther than sqrt(a_1^2 + a_2^2 + a_3^2) <= sqrt(3). Let a_1 be the largest a_k. The cell on the
/// nearer side along axis 1 has another feature point, no farther than
/// sqrt((2 - a_1)^2 + a_2^2 + a_3^2) <= sqrt((2 - a_1)^2 + 2 a_1^2). For a_1 from 1/2 to 1, that is
/// at most sqrt(3) as well. So the two nearest feature points are within sqrt(3), and those in
/// cells three away are farther than 2.
const AROUND: [([i8; 3], u8); 125] = around();

const fn around() -> [([i8; 3], u8); 125] {
    let mut cells = [([0; 3], 0); 125];
    let mut count = 0;
    // The squared distance to a feature point in a cell that is two away along n axes exceeds n.
    // For cells that touch the own cell, the bound is 0.
    let mut least = 0;
    while least <= 3 {
        // The own cell comes first, then those that share a face, an edge or a corner.
        let mut steps = 0;
        while steps <= 6 {
            let mut number = 0;
            while number < 125 {
                let cell = [number % 5 - 2, number / 5 % 5 - 2, number / 25 - 2];
                let (mut far, mut sum) = (0, 0);
                let mut axis = 0;
                while axis < 3 {
                    far += (cell[axis] == 2 || cell[axis] == -2) as u8;
                    sum += if cell[axis] < 0 { -cell[axis] } else { cell[axis] };
                    axis += 1;
                }
                if far == least && sum == steps {
                    cells[count] = ([cell[0] as i8, cell[1] as i8, cell[2] as i8], least);
                    count += 1;
                }
                number += 1;
            }
            steps += 1;
        }
        least += 1;
    }
    assert!(count == 125);
    cells
}

impl Worley {
    /// Position of the feature point within its cell.
    #[inline(always)]
    fn feature(&self, cell: [u32; 3]) -> DVec3 {
        let [i, j, k] = cell;
        let plane = mix(self.seed.wrapping_add(k));
        let hash = mix(mix(plane.wrapping_add(j)).wrapping_add(i));
        let part = |axis: u32| f64::from(mix(hash.wrapping_add(axis))) / 2f64.powi(32);
        DVec3::new(part(1), part(2), part(3))
    }

    /// The distances to the two nearest feature points, in cells.
    #[inline(always)]
    fn nearest(&self, q: DVec3) -> [f64; 2] {
        let cell = q.floor();
        let p = q - cell;
        // The remainder is exact for every finite number; NaN becomes 0.
        let number = cell.to_array().map(|x| x.rem_euclid(2f64.powi(32)) as u32);
        let [mut first, mut second] = [f64::INFINITY; 2];
        for (step, least) in AROUND {
            if f64::from(least) >= second {
                break;
            }
            // Squared distance between the point and the cell, summed over the axes.
            let apart: f64 = (0..3)
                .map(|k| {
                    let from = f64::from(step[k]) - p[k];
                    from.max(-1.0 - from).max(0.0).powi(2)
                })
                .sum();
            if apart >= second {
                continue;
            }
            let there = std::array::from_fn(|k| number[k].wrapping_add_signed(i32::from(step[k])));
            let corner = DVec3::from_array(step.map(f64::from));
            let distance = (corner + self.feature(there) - p).length_squared();
            second = second.min(first.max(distance));
            first = first.min(distance);
        }
        [first.sqrt(), second.sqrt()]
    }
}

impl TextureFunction for Worley {
    fn at(&self, q: DVec3) -> Rgb {
        let [first, second] = self.nearest(q * self.scale);
        let t = match self.value {
            Value::F1 => first,
            Value::F2 => second,
            Value::F2MinusF1 => second - first,
        };
        // NaN, which occurs only at coordinates far outside every scene, becomes 0.
        let t = if t > 0.0 { t.min(1.0) } else { 0.0 };
        self.a * (1.0 - t) + self.b * t
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use whitstone_testkit::{build, texture_laws};

    #[test]
    fn laws() {
        for value in ["f1", "f2", "f2_minus_f1"] {
            for more in ["", "scale = 1e200", "seed = 7\nmapping = { projection = \"uv\" }"] {
                let text = format!("value = \"{value}\"\n{more}");
                texture_laws(&*build::<Textures, Worley>(&text, ()).unwrap());
            }
        }
    }

    fn worley(seed: u32) -> Worley {
        Worley {
            value: Value::F1,
            a: Rgb::BLACK,
            b: Rgb::WHITE,
            scale: 1.0,
            seed: mix(seed),
        }
    }

    /// Reference implementation: tests the feature points of all cells up to `reach` away.
    fn naive(texture: &Worley, q: DVec3, reach: i32) -> [f64; 2] {
        let cell = q.floor().as_ivec3();
        let mut distances = Vec::new();
        for k in -reach..=reach {
            for j in -reach..=reach {
                for i in -reach..=reach {
                    let there = [cell.x + i, cell.y + j, cell.z + k];
                    let feature =
                        DVec3::from_array(there.map(f64::from)) + texture.feature(there.map(|x| x as u32));
                    distances.push(feature.distance(q));
                }
            }
        }
        distances.sort_by(f64::total_cmp);
        [distances[0], distances[1]]
    }

    #[test]
    fn the_two_nearest_are_found_and_neighbours_alone_do_not_suffice() {
        let texture = worley(5);
        let mut missed = 0;
        for i in 0..20_000 {
            let q = DVec3::new(0.6180339887, 0.7548776662, 0.5698402910) * f64::from(i) - DVec3::splat(3e3);
            let (found, all) = (texture.nearest(q), naive(&texture, q, 3));
            assert!(
                (0..2).all(|k| (found[k] - all[k]).abs() < 1e-11),
                "{q}: {found:?}, not {all:?}"
            );
            assert!(all[1] <= 3f64.sqrt());
            missed += usize::from(naive(&texture, q, 1)[1] > all[1] + 1e-9);
        }
        assert!(missed > 0, "the 27 cells around are too few for some points");
    }

    /// All cells up to two away, those with the least bound first, then the nearest.
    #[test]
    fn cells_around_are_in_order() {
        let mut expected = Vec::new();
        for number in 0..125 {
            let cell = [number % 5, number / 5 % 5, number / 25].map(|x| x as i8 - 2);
            let bound = cell.iter().filter(|x| x.abs() == 2).count() as u8;
            let steps: i8 = cell.iter().map(|x| x.abs()).sum();
            expected.push((bound, steps, number, cell));
        }
        expected.sort_unstable();
        let expected: Vec<([i8; 3], u8)> = expected
            .into_iter()
            .map(|(bound, _, _, cell)| (cell, bound))
            .collect();
        assert_eq!(AROUND.to_vec(), expected);
    }

    #[test]
    fn distances_become_colours() {
        let nearest = worley(5);
        for i in 0..40 {
            let p = DVec3::new(0.61, -0.35, 0.57) * f64::from(i);
            let [first, second] = nearest.nearest(2.0 * p);
            for (value, t) in [("f1", first), ("f2", second), ("f2_minus_f1", second - first)] {
                let text = format!("value = \"{value}\"\na = 0.25\nb = 2\nscale = 2\nseed = 5");
                let point = whitstone_core::SurfaceInteraction::new(p, 0.0, DVec3::Z);
                let found = build::<Textures, Worley>(&text, ()).unwrap().value(&point).g;
                let t = t.min(1.0);
                let expected = 0.25 * (1.0 - t) + 2.0 * t;
                assert!(
                    (found - expected).abs() < 1e-12,
                    "{value} at {p}: {found}, not {expected}"
                );
            }
        }
    }

    #[test]
    fn distances_are_continuous_across_cells() {
        let texture = worley(0);
        for i in 0..500 {
            let q = DVec3::new(f64::from(i % 9), 0.37 * f64::from(i), -0.21 * f64::from(i));
            let step = 1e-9 * DVec3::X;
            let (left, right) = (texture.nearest(q - step), texture.nearest(q + step));
            assert!((0..2).all(|k| (left[k] - right[k]).abs() < 1e-8), "{q}");
        }
    }
}
