//! A constant background: the radiance of rays that hit nothing, the same in every direction.
//!
//! - Twin: Mitsuba `constant` (native); the driver shows it without lighting by it.
//! - Example: `scenes/lights/background.toml`.

use schemars::JsonSchema;
use serde::Deserialize;
use std::sync::Arc;
use whitstone_core::config::Color;
use whitstone_core::stream::{Colors, Vectors};
use whitstone_core::{Context, DVec3, Light, LightFlags, Lights, Plugin, Rgb, SceneErrors};

/// A constant background: the radiance of rays that hit nothing, the same in every direction.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// Radiance in W/(m² sr).
    radiance: Color,
}

/// The `background` light; see the module documentation.
pub struct Background {
    radiance: Rgb,
}

impl Plugin<Lights> for Background {
    const TYPE: &'static str = "background";
    type Config = Config;

    fn build(config: Config, (): (), _: &mut dyn Context) -> Result<Arc<dyn Light>, SceneErrors> {
        Ok(Arc::new(Self {
            radiance: config.radiance.get(),
        }))
    }
}

impl Light for Background {
    fn flags(&self) -> LightFlags {
        LightFlags::BACKGROUND
    }

    fn background(&self, _: DVec3) -> Rgb {
        self.radiance
    }

    fn background_stream(&self, len: usize, _: &Vectors, out: &mut Colors) {
        out.fill(len, self.radiance);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use whitstone_testkit::{build, light_laws};

    #[test]
    fn laws() {
        let light = build::<Lights, Background>("radiance = [1, 2, 3]", ()).unwrap();
        light_laws(&*light);
        assert_eq!(light.background(DVec3::Y), Rgb::new(1.0, 2.0, 3.0));
        assert_eq!(light.ambient(), Rgb::BLACK);
    }

    #[test]
    fn negative_radiance_is_refused() {
        assert!(build::<Lights, Background>("radiance = [1, -2, 3]", ()).is_err());
    }
}
