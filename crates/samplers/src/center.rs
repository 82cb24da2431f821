//! One sample in the middle of each pixel.
//!
//! - Twin: the Mitsuba driver, which traces the same positions.
//! - Example: `scenes/samplers/center.toml`.

use schemars::JsonSchema;
use serde::Deserialize;
use whitstone_core::{Context, DVec2, Plugin, Sampler, Samplers, SceneErrors};

/// One sample in the middle of each pixel.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Config {}

/// The `center` sampler; see the module documentation.
pub struct Center;

impl Plugin<Samplers> for Center {
    const TYPE: &'static str = "center";
    type Config = Config;

    fn build(_: Config, (): (), _: &mut dyn Context) -> Result<Box<dyn Sampler>, SceneErrors> {
        Ok(Box::new(Self))
    }
}

impl Sampler for Center {
    fn count(&self) -> u32 {
        1
    }

    fn position(&self, _: [u32; 2], _: u32) -> DVec2 {
        DVec2::splat(0.5)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use whitstone_testkit::{build, sampler_laws};

    #[test]
    fn laws() {
        let sampler = build::<Samplers, Center>("", ()).unwrap();
        sampler_laws(&*sampler);
        assert_eq!(sampler.count(), 1);
    }
}
