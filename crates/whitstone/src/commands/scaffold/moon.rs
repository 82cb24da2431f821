//! Parallel light from a sphere that is lit from the side; it dims with the phase angle.
//!
//! The phase function of a matte sphere (Lambert, *Photometria*, 1760): (sin a + (pi - a) cos a)/pi
//! at the phase angle a.
//!
//! - Twin: none; the tests check closed-form values of the formula.

use schemars::JsonSchema;
use serde::Deserialize;
use std::f64::consts::PI;
use std::sync::Arc;
use whitstone_core::config::{Color, NonNegative, Vector3};
use whitstone_core::{
    Context, DVec3, Light, LightFlags, LightSample, Lights, Plugin, SceneError, SceneErrors,
};

/// Parallel light from a sphere that is lit from the side.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// Direction in which the light travels; any nonzero length.
    direction: Vector3,
    /// Irradiance in W/m² at full phase, on a surface that faces the light.
    irradiance: Color,
    /// Phase angle between the sun and the viewer as seen from the sphere, in degrees: 0 is full
    /// moon, 180 or more is new moon.
    #[serde(default = "full")]
    phase: NonNegative,
}

fn full() -> NonNegative {
    NonNegative::new(0.0).expect("0 is not negative")
}

/// The light; its sample is the same everywhere.
pub struct Moon {
    sample: LightSample,
}

impl Plugin<Lights> for Moon {
    const TYPE: &'static str = "moon";
    type Config = Config;

    fn build(config: Config, (): (), _: &mut dyn Context) -> Result<Arc<dyn Light>, SceneErrors> {
        let Some(travel) = config.direction.get().try_normalize() else {
            return Err(SceneError::anywhere("expected a direction that is not zero").into());
        };
        let a = config.phase.get().min(180.0).to_radians();
        // Rounding must not make the value negative near a phase angle of 180 degrees.
        let share = ((a.sin() + (PI - a) * a.cos()) / PI).max(0.0);
        Ok(Arc::new(Self {
            sample: LightSample {
                direction: -travel,
                distance: f64::INFINITY,
                irradiance: config.irradiance.get() * share,
            },
        }))
    }
}

impl Light for Moon {
    fn flags(&self) -> LightFlags {
        LightFlags::SAMPLES
    }

    fn samples(&self, _: DVec3, out: &mut Vec<LightSample>) {
        out.push(self.sample);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use whitstone_testkit::build;

    whitstone_testkit::light_laws!(
        Moon,
        "direction = [1, -2, 0.5]\nirradiance = 1",
        "direction = [-1.0..1, -1, 0.5]\nirradiance = [0.0..9, 1, 0]\nphase = 0.0..180",
    );

    #[test]
    fn a_half_moon_gives_a_third() {
        let irradiance = |phase: &str| {
            let text = format!("direction = [0, -1, 0]\nirradiance = 1\nphase = {phase}");
            let mut samples = Vec::new();
            build::<Lights, Moon>(&text, ())
                .unwrap()
                .samples(DVec3::ZERO, &mut samples);
            samples[0].irradiance.g
        };
        assert_eq!(irradiance("0"), 1.0);
        assert!((irradiance("90") - 1.0 / PI).abs() < 1e-15);
        assert!(irradiance("180") < 1e-15);
    }

    #[test]
    fn a_direction_is_needed() {
        assert!(build::<Lights, Moon>("direction = [0, 0, 0]\nirradiance = 1", ()).is_err());
    }
}
