//! Stratified sampling: one jittered sample in each cell of a square grid.
//!
//! The RMS error of n² such samples falls as n^-1.5 in a pixel with an edge, and as n^-2 in a
//! smooth one (Mitchell 1996, *Consequences of stratified sampling in graphics*). The error of a
//! regular grid falls only as n^-1 for edges parallel to its rows. The positions differ from pixel
//! to pixel. They come from the hash m of `docs/whitted-model.md` (section 9), so they are the same
//! in every renderer and every run.
//!
//! - Twin: the Mitsuba driver, which traces the same positions.
//! - Example: `scenes/samplers/stratified.toml`.

use crate::hash_of_pixel;
use schemars::JsonSchema;
use serde::Deserialize;
use whitstone_core::config::IntegerIn;
use whitstone_core::hash::mix;
use whitstone_core::{Context, DVec2, Plugin, Sampler, Samplers, SceneErrors};

/// Stratified sampling: one jittered sample in each cell of an n x n grid; positions differ from
/// pixel to pixel.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// Cells along each axis.
    #[serde(default = "two")]
    samples_per_axis: IntegerIn<1, 64>,
    /// Seed of the positions; different seeds give different positions.
    #[serde(default = "zero")]
    seed: IntegerIn<0, 0xffff_ffff>,
}

fn two() -> IntegerIn<1, 64> {
    IntegerIn::new(2).expect("2 is in range")
}

fn zero() -> IntegerIn<0, 0xffff_ffff> {
    IntegerIn::new(0).expect("0 is in range")
}

/// The `stratified` sampler; see the module documentation.
pub struct Stratified {
    n: u32,
    seed: u32,
}

impl Plugin<Samplers> for Stratified {
    const TYPE: &'static str = "stratified";
    type Config = Config;

    fn build(config: Config, (): (), _: &mut dyn Context) -> Result<Box<dyn Sampler>, SceneErrors> {
        Ok(Box::new(Self {
            n: config.samples_per_axis.get(),
            seed: config.seed.get(),
        }))
    }
}

impl Sampler for Stratified {
    fn count(&self) -> u32 {
        self.n * self.n
    }

    fn position(&self, pixel: [u32; 2], index: u32) -> DVec2 {
        let h = mix(hash_of_pixel(self.seed, pixel).wrapping_add(index));
        let place = |k: u32| f64::from(mix(h.wrapping_add(k))) / 4_294_967_296.0;
        let cell = DVec2::new(f64::from(index % self.n), f64::from(index / self.n));
        (cell + DVec2::new(place(1), place(2))) / f64::from(self.n)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use whitstone_testkit::{build, random_sampler_laws};

    #[test]
    fn laws() {
        for n in [1, 2, 3, 8, 64] {
            let sampler = build::<Samplers, Stratified>(&format!("samples_per_axis = {n}"), ()).unwrap();
            assert_eq!(sampler.count(), n * n);
            random_sampler_laws(&*sampler);
        }
    }

    #[test]
    fn each_cell_has_one_sample() {
        let sampler = build::<Samplers, Stratified>("samples_per_axis = 5\nseed = 7", ()).unwrap();
        for pixel in [[0, 0], [3, 4], [65_535, 1]] {
            for index in 0..25 {
                let cell = (sampler.position(pixel, index) * 5.0).floor();
                assert_eq!(cell, DVec2::new(f64::from(index % 5), f64::from(index / 5)));
            }
        }
    }

    #[test]
    fn another_seed_gives_other_places() {
        let [a, b] = ["seed = 1", "seed = 2"].map(|seed| build::<Samplers, Stratified>(seed, ()).unwrap());
        assert_ne!(a.position([0, 0], 0), b.position([0, 0], 0));
    }

    /// The driver's own test contains the same numbers, computed by other code:
    /// `references/mitsuba/tests/test_samplers.py`.
    #[test]
    fn the_places_are_those_of_the_driver() {
        let sampler = build::<Samplers, Stratified>("samples_per_axis = 3\nseed = 4294967295", ()).unwrap();
        let found = sampler.position([12, 65_535], 6).to_array();
        assert_eq!(found, [0.206_475_330_283_865_33, 0.826_831_603_034_709_9]);
    }
}
