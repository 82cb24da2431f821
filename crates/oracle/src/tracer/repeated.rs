//! Textures that repeat in space: cubes, stripes, rings and ramps (section 10 of the model).

use super::mapping::{MappingConfig, TextureFunction};
use super::pattern::colors;
use serde::Deserialize;
use whitstone_core::config::Color;
use whitstone_core::{DVec3, Rgb};

/// The index of the cell of a coordinate: the model's c, with its shifted borders.
fn cell(x: f64) -> f64 {
    (x + 1.0 / 4096.0).floor()
}

/// Which of the two colours a cell has.
fn parity(sum: f64) -> usize {
    usize::from(sum.rem_euclid(2.0) == 1.0)
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct CubesConfig {
    a: Option<Color>,
    b: Option<Color>,
    scale: Option<f64>,
    offset: Option<[f64; 3]>,
    pub(super) mapping: Option<MappingConfig>,
}

/// The texture `checker3d`.
pub(super) struct Cubes {
    colors: [Rgb; 2],
    scale: f64,
    offset: [f64; 3],
}

impl Cubes {
    pub(super) fn new(config: &CubesConfig) -> Self {
        Self {
            colors: colors(config.a, config.b, [0.8, 0.2]),
            scale: config.scale.unwrap_or(1.0),
            offset: config.offset.unwrap_or_default(),
        }
    }
}

impl TextureFunction for Cubes {
    fn at(&self, q: DVec3) -> Rgb {
        let cells = (0..3).map(|axis| cell(q[axis] * self.scale + self.offset[axis]));
        self.colors[parity(cells.sum())]
    }
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct LayersConfig {
    a: Option<Color>,
    b: Option<Color>,
    scale: Option<f64>,
    offset: Option<f64>,
    pub(super) mapping: Option<MappingConfig>,
}

/// The textures `stripes` and `rings`.
pub(super) struct Layers {
    colors: [Rgb; 2],
    scale: f64,
    offset: f64,
    round: bool,
}

impl Layers {
    pub(super) fn new(config: &LayersConfig, round: bool) -> Self {
        Self {
            colors: colors(config.a, config.b, [0.8, 0.2]),
            scale: config.scale.unwrap_or(1.0),
            offset: config.offset.unwrap_or(0.0),
            round,
        }
    }
}

impl TextureFunction for Layers {
    fn at(&self, q: DVec3) -> Rgb {
        let along = if self.round { q.x.hypot(q.z) } else { q.x };
        self.colors[parity(cell(along * self.scale + self.offset))]
    }
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Stop {
    at: f64,
    color: Color,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RampConfig {
    a: Option<Color>,
    b: Option<Color>,
    stops: Option<Vec<Stop>>,
    scale: Option<f64>,
    offset: Option<f64>,
    wrap: Option<String>,
    pub(super) mapping: Option<MappingConfig>,
}

/// The texture `gradient`.
pub(super) struct Ramp {
    stops: Vec<(f64, Rgb)>,
    scale: f64,
    offset: f64,
    wrap: Option<String>,
}

impl Ramp {
    pub(super) fn new(config: RampConfig) -> Self {
        let [first, last] = colors(config.a, config.b, [0.8, 0.2]);
        Self {
            stops: config.stops.map_or_else(
                || vec![(0.0, first), (1.0, last)],
                |stops| stops.iter().map(|stop| (stop.at, stop.color.get())).collect(),
            ),
            scale: config.scale.unwrap_or(1.0),
            offset: config.offset.unwrap_or(0.0),
            wrap: config.wrap,
        }
    }
}

impl TextureFunction for Ramp {
    fn at(&self, q: DVec3) -> Rgb {
        let x = q.x * self.scale + self.offset;
        let t = match self.wrap.as_deref() {
            Some("clamp") => x.clamp(0.0, 1.0),
            Some("mirror") => {
                let twice = x.rem_euclid(2.0);
                if twice > 1.0 { 2.0 - twice } else { twice }
            }
            _ => (x - cell(x)).max(0.0),
        };
        // From the left, each pair of stops blends the colour by the fraction of its interval that
        // lies before t.
        let mut color = self.stops[0].1;
        for pair in self.stops.windows(2) {
            let share = ((t - pair[0].0) / (pair[1].0 - pair[0].0)).clamp(0.0, 1.0);
            color = color * (1.0 - share) + pair[1].1 * share;
        }
        color
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_ramp_with_three_stops() {
        let stops = vec![
            (0.0, Rgb::splat(1.0)),
            (0.5, Rgb::splat(3.0)),
            (1.0, Rgb::splat(0.0)),
        ];
        let ramp = Ramp {
            stops,
            scale: 1.0,
            offset: 0.0,
            wrap: None,
        };
        for (x, expected) in [
            (0.25, 2.0),
            (0.5, 3.0),
            (0.75, 1.5),
            (-0.75, 2.0),
            (1.0, 1.0),
            (1.0 - 1e-9, 1.0),
        ] {
            assert!((ramp.at(DVec3::X * x).r - expected).abs() < 1e-12, "{x}");
        }
    }
}
