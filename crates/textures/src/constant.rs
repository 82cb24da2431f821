//! A constant colour, so that several materials can share it by its ID.
//!
//! - Twin: Mitsuba `rgb` (native).
//! - Example: `scenes/textures/constant.toml`.

use schemars::JsonSchema;
use serde::Deserialize;
use std::sync::Arc;
use whitstone_core::config::Color;
use whitstone_core::{
    Context, Plugin, Rgb, SceneErrors, SurfaceAttributes, SurfaceInteraction, Texture, Textures,
};

/// A constant colour.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// The colour.
    value: Color,
}

/// The `constant` texture; see the module documentation.
pub struct Constant {
    value: Rgb,
}

impl Plugin<Textures> for Constant {
    const TYPE: &'static str = "constant";
    type Config = Config;

    fn build(config: Config, (): (), _: &mut dyn Context) -> Result<Arc<dyn Texture>, SceneErrors> {
        Ok(Arc::new(Self {
            value: config.value.get(),
        }))
    }
}

impl Texture for Constant {
    fn needs(&self) -> SurfaceAttributes {
        SurfaceAttributes::NOTHING
    }

    fn value(&self, _: &SurfaceInteraction) -> Rgb {
        self.value
    }

    fn constant(&self) -> Option<Rgb> {
        Some(self.value)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use whitstone_core::DVec3;
    use whitstone_testkit::{build, texture_laws};

    #[test]
    fn laws() {
        let texture = build::<Textures, Constant>("value = [0.1, 0.2, 3]", ()).unwrap();
        texture_laws(&*texture);
        let point = SurfaceInteraction::new(DVec3::ONE, 0.0, DVec3::X);
        assert_eq!(texture.value(&point), Rgb::new(0.1, 0.2, 3.0));
        assert_eq!(texture.constant(), Some(Rgb::new(0.1, 0.2, 3.0)));
    }
}
