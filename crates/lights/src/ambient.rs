//! Uniform ambient light from all directions, never shadowed.
//!
//! - Twin: a formula of the Mitsuba driver, which adds the materials' ambient terms.
//! - Example: `scenes/lights/ambient.toml`.

use schemars::JsonSchema;
use serde::Deserialize;
use std::sync::Arc;
use whitstone_core::config::Color;
use whitstone_core::{Context, Light, LightFlags, Lights, Plugin, Rgb, SceneErrors};

/// Uniform ambient light from all directions, never shadowed.
///
/// Materials reflect it by their ambient terms. A ray that hits nothing does not see it.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// Uniform radiance in W/(m² sr).
    radiance: Color,
}

/// The `ambient` light; see the module documentation.
pub struct Ambient {
    radiance: Rgb,
}

impl Plugin<Lights> for Ambient {
    const TYPE: &'static str = "ambient";
    type Config = Config;

    fn build(config: Config, (): (), _: &mut dyn Context) -> Result<Arc<dyn Light>, SceneErrors> {
        Ok(Arc::new(Self {
            radiance: config.radiance.get(),
        }))
    }
}

impl Light for Ambient {
    fn flags(&self) -> LightFlags {
        LightFlags::AMBIENT
    }

    fn ambient(&self) -> Rgb {
        self.radiance
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use whitstone_core::DVec3;
    use whitstone_testkit::{build, light_laws};

    #[test]
    fn laws() {
        let light = build::<Lights, Ambient>("radiance = [1, 2, 3]", ()).unwrap();
        light_laws(&*light);
        assert_eq!(light.ambient(), Rgb::new(1.0, 2.0, 3.0));
        assert_eq!(light.background(DVec3::Y), Rgb::BLACK);
    }

    #[test]
    fn negative_radiance_is_refused() {
        assert!(build::<Lights, Ambient>("radiance = [1, -2, 3]", ()).is_err());
    }
}
