//! Parallel light from infinitely far away.
//!
//! - Twin: Mitsuba `directional` (native).
//! - Example: `scenes/lights/directional.toml`.

use crate::support::emission;
use schemars::JsonSchema;
use serde::Deserialize;
use std::sync::Arc;
use toml::Spanned;
use whitstone_core::config::{Color, Vector3};
use whitstone_core::stream::{SampleStreams, Vectors};
use whitstone_core::{
    Aabb, Context, DVec3, Light, LightFlags, LightSample, Lights, Plugin, SceneError, SceneErrors,
};

/// Parallel light from infinitely far away, such as the sun's.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// Direction in which the light travels; any nonzero length.
    #[schemars(with = "Vector3")]
    direction: Spanned<Vector3>,
    /// Irradiance in W/m² on a surface that faces the light.
    irradiance: Color,
}

/// The `directional` light: the same sample everywhere.
pub struct Directional {
    sample: LightSample,
}

impl Plugin<Lights> for Directional {
    const TYPE: &'static str = "directional";
    type Config = Config;

    fn build(config: Config, (): (), _: &mut dyn Context) -> Result<Arc<dyn Light>, SceneErrors> {
        let Some((travel, _)) = emission::direction_and_length(config.direction.get_ref().get()) else {
            let message = "the light has no direction: all components are zero";
            return Err(SceneError::at(config.direction.span(), message).into());
        };
        Ok(Arc::new(Self {
            sample: LightSample {
                direction: -travel,
                distance: f64::INFINITY,
                irradiance: config.irradiance.get(),
            },
        }))
    }
}

impl Light for Directional {
    fn flags(&self) -> LightFlags {
        LightFlags::SAMPLES
    }

    fn samples(&self, _: DVec3, out: &mut Vec<LightSample>) {
        out.push(self.sample);
    }

    fn samples_stream(&self, len: usize, _: &Vectors, out: &mut SampleStreams) {
        let out = out.add();
        for lane in 0..len {
            out.set(lane, &self.sample);
        }
    }

    fn affects_bounds(&self, _: &Aabb) -> bool {
        !self.sample.irradiance.is_black()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use whitstone_core::Rgb;
    use whitstone_testkit::{build, light_laws};

    #[test]
    fn laws() {
        for direction in ["[0, -1, 0]", "[1e-200, 3e-200, 0]", "[1, -2e300, 1]"] {
            let text = format!("direction = {direction}\nirradiance = [0, 1, 2]");
            light_laws(&*build::<Lights, Directional>(&text, ()).unwrap());
        }
    }

    #[test]
    fn light_comes_from_where_it_does_not_go() {
        let light = build::<Lights, Directional>("direction = [0, -3, 0]\nirradiance = 2", ()).unwrap();
        let mut samples = Vec::new();
        light.samples(DVec3::ONE, &mut samples);
        let sun = LightSample {
            direction: DVec3::Y,
            distance: f64::INFINITY,
            irradiance: Rgb::splat(2.0),
        };
        assert_eq!(samples, [sun]);
    }

    #[test]
    fn only_black_light_affects_nothing() {
        let affects = |irradiance: f64| {
            let text = format!("direction = [0, -3, 0]\nirradiance = {irradiance}");
            let light = build::<Lights, Directional>(&text, ()).unwrap();
            light.affects_bounds(&Aabb::EVERYTHING)
        };
        assert_eq!((affects(0.0), affects(1.0)), (false, true));
    }

    #[test]
    fn a_zero_direction_is_refused_at_its_place() {
        let errors = build::<Lights, Directional>("direction = [0, 0, 0]\nirradiance = 2", ())
            .err()
            .unwrap();
        assert_eq!(errors.0[0].span, Some(12..21));
    }
}
