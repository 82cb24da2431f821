//! Sobol' points with Owen scrambling, with a different seed in each pixel.
//!
//! `support/scrambled.rs` lists the sources.
//!
//! - Twin: the Mitsuba driver, which traces the same positions.
//! - Example: `scenes/samplers/sobol.toml`.

use crate::support::scrambled;
use schemars::JsonSchema;
use serde::Deserialize;
use whitstone_core::config::IntegerIn;
use whitstone_core::{Context, DVec2, Plugin, Sampler, Samplers, SceneErrors};

/// Sobol' points with Owen scrambling, different in each pixel.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// Samples per pixel; powers of two are distributed most evenly.
    #[serde(default = "four")]
    samples: IntegerIn<1, 65536>,
    /// Seed of the scrambling; different seeds give different points.
    #[serde(default = "zero")]
    seed: IntegerIn<0, 0xffff_ffff>,
}

fn four() -> IntegerIn<1, 65536> {
    IntegerIn::new(4).expect("4 is in range")
}

fn zero() -> IntegerIn<0, 0xffff_ffff> {
    IntegerIn::new(0).expect("0 is in range")
}

/// The `sobol` sampler; see the module documentation.
pub struct Sobol {
    samples: u32,
    seed: u32,
}

impl Plugin<Samplers> for Sobol {
    const TYPE: &'static str = "sobol";
    type Config = Config;

    fn build(config: Config, (): (), _: &mut dyn Context) -> Result<Box<dyn Sampler>, SceneErrors> {
        Ok(Box::new(Self {
            samples: config.samples.get(),
            seed: config.seed.get(),
        }))
    }
}

impl Sampler for Sobol {
    fn count(&self) -> u32 {
        self.samples
    }

    fn position(&self, pixel: [u32; 2], index: u32) -> DVec2 {
        scrambled::position(self.seed, pixel, index)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::support::scrambled::second;
    use std::collections::BTreeSet;
    use whitstone_testkit::{build, random_sampler_laws};

    #[test]
    fn laws() {
        for samples in [1, 2, 3, 16, 1000, 4096] {
            let sampler = build::<Samplers, Sobol>(&format!("samples = {samples}"), ()).unwrap();
            assert_eq!(sampler.count(), samples);
            random_sampler_laws(&*sampler);
        }
    }

    /// Without scrambling, the first points are those of published tables of the sequence.
    #[test]
    fn the_points_are_those_of_sobol() {
        let plain =
            |index: u32| [index, second(index)].map(|x| f64::from(x.reverse_bits()) / 4_294_967_296.0);
        let known = [
            [0.0, 0.0],
            [0.5, 0.5],
            [0.25, 0.75],
            [0.75, 0.25],
            [0.125, 0.625],
            [0.625, 0.125],
            [0.375, 0.375],
            [0.875, 0.875],
        ];
        assert_eq!([0, 1, 2, 3, 4, 5, 6, 7].map(plain), known);
    }

    /// Of 2^m points, each elementary interval (a box of area 2^-m whose sides are powers of two)
    /// contains exactly one. This property makes them better than random points. Owen scrambling
    /// keeps it; adding a random offset modulo 1 would lose it.
    #[test]
    fn every_elementary_box_holds_one_point() {
        let m = 8;
        let sampler = build::<Samplers, Sobol>("samples = 256\nseed = 3", ()).unwrap();
        for pixel in [[0, 0], [17, 4]] {
            for wide in 0..=m {
                let high = m - wide;
                let boxes: BTreeSet<[u32; 2]> = (0..256)
                    .map(|index| sampler.position(pixel, index))
                    .map(|p| {
                        [
                            (p.x * f64::from(1 << wide)) as u32,
                            (p.y * f64::from(1 << high)) as u32,
                        ]
                    })
                    .collect();
                assert_eq!(boxes.len(), 256, "boxes of 2^-{wide} x 2^-{high}");
            }
        }
    }

    /// The driver's own test contains the same numbers, computed by other code:
    /// `references/mitsuba/tests/test_samplers.py`.
    #[test]
    fn the_points_are_those_of_the_driver() {
        let sampler = build::<Samplers, Sobol>("samples = 8\nseed = 4294967295", ()).unwrap();
        let found = sampler.position([12, 65_535], 6).to_array();
        assert_eq!(
            found,
            [3_596_272_196.0, 1_078_120_820.0].map(|bits| bits / 4_294_967_296.0)
        );
    }
}
