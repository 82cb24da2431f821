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
use toml::Spanned;
use whitstone_core::config::{Color, Finite, Vector3};
use whitstone_core::{
    Context, DVec3, Light, LightFlags, LightSample, Lights, Plugin, SceneError, SceneErrors,
};

/// Parallel light from a sphere that is lit from the side.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// Direction in which the light travels; any nonzero length.
    #[schemars(with = "Vector3")]
    direction: Spanned<Vector3>,
    /// Irradiance in W/m² at full phase, on a surface that faces the light.
    irradiance: Color,
    /// Phase angle between the sun and the viewer as seen from the sphere, in degrees from 0 (full)
    /// to 180 (new); 0 if omitted.
    #[serde(default)]
    #[schemars(with = "Option<f64>")]
    phase: Option<Spanned<Finite>>,
}

/// The light; its sample is the same everywhere.
pub struct Moon {
    sample: LightSample,
}

impl Plugin<Lights> for Moon {
    const TYPE: &'static str = "moon";
    type Config = Config;

    fn build(config: Config, (): (), _: &mut dyn Context) -> Result<Arc<dyn Light>, SceneErrors> {
        let mut errors = SceneErrors::default();
        let mut reject = |span, message: String| errors.0.push(SceneError::at(span, message));
        let travel = config.direction.get_ref().get().try_normalize();
        if travel.is_none() {
            reject(
                config.direction.span(),
                "expected a direction that is not zero".to_owned(),
            );
        }
        let phase = config.phase.as_ref().map_or(0.0, |phase| phase.get_ref().get());
        if let Some(written) = config.phase.filter(|_| !(0.0..=180.0).contains(&phase)) {
            reject(
                written.span(),
                format!("expected a phase from 0 to 180 degrees, found {phase}"),
            );
        }
        let a = phase.to_radians();
        // Rounding must not make the value negative near a phase angle of 180 degrees.
        let share = ((a.sin() + (PI - a) * a.cos()) / PI).max(0.0);
        errors.into_result(Arc::new(Self {
            sample: LightSample {
                direction: -travel.unwrap_or(DVec3::Z),
                distance: f64::INFINITY,
                irradiance: config.irradiance.get() * share,
            },
        }) as Arc<dyn Light>)
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
    fn both_errors_are_reported() {
        let errors = build::<Lights, Moon>("direction = [0, 0, 0]\nirradiance = 1\nphase = 270", ());
        assert_eq!(errors.err().unwrap().0.len(), 2);
    }
}
