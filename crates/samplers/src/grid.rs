//! A regular square grid of samples in each pixel.
//!
//! - Twin: the Mitsuba driver, which traces the same positions.
//! - Example: `scenes/samplers/grid.toml`.

use schemars::JsonSchema;
use serde::Deserialize;
use whitstone_core::config::IntegerIn;
use whitstone_core::{Context, DVec2, Plugin, Sampler, Samplers, SceneErrors};

/// A regular grid of n x n samples in each pixel.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// Samples along each axis.
    #[serde(default = "two")]
    samples_per_axis: IntegerIn<1, 64>,
}

fn two() -> IntegerIn<1, 64> {
    IntegerIn::new(2).expect("2 is in range")
}

/// The `grid` sampler; see the module documentation.
pub struct Grid {
    n: u32,
}

impl Plugin<Samplers> for Grid {
    const TYPE: &'static str = "grid";
    type Config = Config;

    fn build(config: Config, (): (), _: &mut dyn Context) -> Result<Box<dyn Sampler>, SceneErrors> {
        Ok(Box::new(Self {
            n: config.samples_per_axis.get(),
        }))
    }
}

impl Sampler for Grid {
    fn count(&self) -> u32 {
        self.n * self.n
    }

    fn position(&self, _: [u32; 2], index: u32) -> DVec2 {
        let cell = DVec2::new(f64::from(index % self.n), f64::from(index / self.n));
        (cell + 0.5) / f64::from(self.n)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use whitstone_testkit::{build, sampler_laws};

    #[test]
    fn laws() {
        for n in 1..=64 {
            let sampler = build::<Samplers, Grid>(&format!("samples_per_axis = {n}"), ()).unwrap();
            assert_eq!(sampler.count(), n * n);
            sampler_laws(&*sampler);
        }
    }

    #[test]
    fn x_runs_first() {
        let sampler = build::<Samplers, Grid>("", ()).unwrap();
        let positions: Vec<[f64; 2]> = (0..4).map(|i| sampler.position([7, 9], i).to_array()).collect();
        assert_eq!(
            positions,
            [[0.25, 0.25], [0.75, 0.25], [0.25, 0.75], [0.75, 0.75]]
        );
    }

    #[test]
    fn sizes_out_of_range_are_refused_at_the_value() {
        for n in ["0", "65", "-1", "9223372036854775807", "2.0", "\"2\""] {
            let errors = build::<Samplers, Grid>(&format!("samples_per_axis = {n}"), ())
                .err()
                .unwrap();
            assert_eq!(errors.0[0].span, Some(19..19 + n.len()), "{n}");
        }
    }
}
