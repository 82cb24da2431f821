//! Adaptive sampling: few samples in uniform pixels, more at edges.
//!
//! Whitted 1980, *An improved illumination model for shaded display*, section "Anti-aliasing": a
//! pixel is sampled more finely if its samples differ. A pixel doubles its n samples while its
//! error estimate max(0.3 r / n^(3/4), 0.15 q / n) exceeds `threshold`. r is the range (maximum
//! minus minimum) of its samples, in the channel where it is largest. q is the largest range of the
//! initial samples of any neighbour (at most eight): it stands for an edge that all samples of the
//! pixel missed. The constants: see `Refinement`. (Mitchell 1987, *Generating antialiased images at
//! low sampling densities*, uses the contrast.) The points are those of `sobol`, so that later
//! samples complement earlier ones.
//!
//! - Twin: the Mitsuba driver, which traces the same positions in the same rounds.
//! - Example: `scenes/samplers/adaptive.toml`.

use crate::support::scrambled;
use schemars::JsonSchema;
use serde::Deserialize;
use toml::Spanned;
use whitstone_core::config::{IntegerIn, Positive};
use whitstone_core::{Context, DVec2, Plugin, Refinement, Sampler, Samplers, SceneError, SceneErrors};

/// Adaptive sampling: more samples at edges than in uniform pixels.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// Maximum number of samples per pixel.
    #[serde(default = "most")]
    samples: IntegerIn<1, 65536>,
    /// Initial samples of every pixel, at most `samples`.
    #[serde(default)]
    #[schemars(extend("x-default" = format!("{FIRST}, but at most `samples`")), with = "IntegerIn<1, 65536>")]
    initial_samples: Option<Spanned<IntegerIn<1, 65536>>>,
    /// Target error, a radiance in W/(m² sr), greater than 0. A pixel takes no more samples when
    /// its estimated error is at most this.
    #[serde(default = "threshold")]
    threshold: Positive,
    /// Seed of the scrambling; different seeds give different points.
    #[serde(default = "zero")]
    seed: IntegerIn<0, 0xffff_ffff>,
}

fn most() -> IntegerIn<1, 65536> {
    IntegerIn::new(256).expect("256 is in range")
}

fn threshold() -> Positive {
    Positive::new(0.01).expect("0.01 is positive")
}

fn zero() -> IntegerIn<0, 0xffff_ffff> {
    IntegerIn::new(0).expect("0 is in range")
}

/// The `adaptive` sampler; see the module documentation.
pub struct Adaptive {
    samples: u32,
    seed: u32,
    rule: Refinement,
}

/// Default number of initial samples.
const FIRST: u32 = 8;

impl Plugin<Samplers> for Adaptive {
    const TYPE: &'static str = "adaptive";
    type Config = Config;

    fn build(config: Config, (): (), _: &mut dyn Context) -> Result<Box<dyn Sampler>, SceneErrors> {
        let samples = config.samples.get();
        let first = match &config.initial_samples {
            None => FIRST.min(samples),
            Some(first) if first.get_ref().get() <= samples => first.get_ref().get(),
            Some(first) => {
                let message = format!(
                    "expected at most `samples` ({samples}), found {}",
                    first.get_ref().get()
                );
                return Err(SceneError::at(first.span(), message).into());
            }
        };
        let rule = Refinement {
            initial_samples: first,
            threshold: config.threshold.get(),
        };
        Ok(Box::new(Self {
            samples,
            seed: config.seed.get(),
            rule,
        }))
    }
}

impl Sampler for Adaptive {
    fn count(&self) -> u32 {
        self.samples
    }

    fn position(&self, pixel: [u32; 2], index: u32) -> DVec2 {
        scrambled::position(self.seed, pixel, index)
    }

    fn refinement(&self) -> Option<Refinement> {
        Some(self.rule)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use whitstone_testkit::{build, random_sampler_laws};

    #[test]
    fn laws() {
        for text in [
            "",
            "samples = 1",
            "samples = 1000\ninitial_samples = 16",
            "threshold = 1e-9\nseed = 3",
        ] {
            random_sampler_laws(&*build::<Samplers, Adaptive>(text, ()).unwrap());
        }
    }

    #[test]
    fn the_points_are_those_of_sobol() {
        let adaptive = build::<Samplers, Adaptive>("samples = 64\nseed = 7", ()).unwrap();
        for index in 0..64 {
            let found = adaptive.position([3, 5], index);
            assert_eq!(found, scrambled::position(7, [3, 5], index));
        }
    }

    #[test]
    fn a_pixel_goes_on_while_its_samples_or_its_neighbours_are_apart() {
        let rule = build::<Samplers, Adaptive>("", ()).unwrap().refinement().unwrap();
        assert_eq!((rule.initial_samples, rule.threshold), (8, 0.01));
        assert!(!rule.continues(8, 0.0, 0.0));
        // 0.3 / 64^(3/4) = 0.0133, / 128^(3/4) = 0.0079; 0.15 / 8 = 0.019, / 16 = 0.0094.
        assert!(rule.continues(64, 1.0, 0.0) && !rule.continues(128, 1.0, 0.0));
        assert!(rule.continues(8, 0.0, 1.0) && !rule.continues(16, 0.0, 1.0));
    }

    #[test]
    fn faults_are_refused_at_their_places() {
        for (text, place) in [
            ("samples = 8\ninitial_samples = 9", "9"),
            ("threshold = 0", "0"),
            ("samples = 0", "0"),
            ("initial_samples = 65537", "65537"),
        ] {
            let errors = build::<Samplers, Adaptive>(text, ()).err().unwrap();
            let span = errors.0[0].span.clone().unwrap();
            assert_eq!(&text[span], place, "{text}");
        }
    }
}
