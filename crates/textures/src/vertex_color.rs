//! The interpolated vertex colour of a mesh, or the alpha of that colour.
//!
//! - Twin: hosted by the Mitsuba driver, which interpolates the colours and alpha in double
//!   precision.
//! - Example: `scenes/textures/vertex_color.toml`.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::sync::Arc;
use whitstone_core::{
    Context, Plugin, Rgb, SceneErrors, SurfaceAttributes, SurfaceInteraction, Texture, Textures,
};

/// The vertex colour of a mesh with `vertex_colors = true`; on other shapes white, or 1 for the
/// channel "alpha".
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// "color", or "alpha" as a grey.
    #[serde(default)]
    channel: Channel,
}

/// A part of a vertex colour.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
enum Channel {
    /// Red, green and blue.
    #[default]
    Color,
    /// Alpha (coverage).
    Alpha,
}

/// The `vertex_color` texture; see the module documentation.
pub struct VertexColor {
    channel: Channel,
}

impl Plugin<Textures> for VertexColor {
    const TYPE: &'static str = "vertex_color";
    type Config = Config;

    fn build(config: Config, (): (), _: &mut dyn Context) -> Result<Arc<dyn Texture>, SceneErrors> {
        Ok(Arc::new(Self {
            channel: config.channel,
        }))
    }
}

impl Texture for VertexColor {
    fn needs(&self) -> SurfaceAttributes {
        SurfaceAttributes::VERTEX_COLOR
    }

    fn value(&self, point: &SurfaceInteraction) -> Rgb {
        // Where two of the three colours are zero, the value may round to just below zero.
        match self.channel {
            Channel::Color => point.vertex.color.map(|part| part.max(0.0)),
            Channel::Alpha => Rgb::splat(point.vertex.alpha.max(0.0)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use whitstone_core::DVec3;
    use whitstone_testkit::{build, texture_laws};

    #[test]
    fn laws() {
        let mut point = SurfaceInteraction::new(DVec3::ONE, 0.0, DVec3::X);
        for (text, colored) in [
            ("", Rgb::new(0.5, 0.25, 2.0)),
            ("channel = \"alpha\"", Rgb::splat(0.125)),
        ] {
            let texture = build::<Textures, VertexColor>(text, ()).unwrap();
            texture_laws(&*texture);
            assert!(texture.needs().contains(SurfaceAttributes::VERTEX_COLOR));
            point.vertex = Default::default();
            assert_eq!(texture.value(&point), Rgb::WHITE);
            point.vertex.color = Rgb::new(0.5, 0.25, 2.0);
            point.vertex.alpha = 0.125;
            assert_eq!(texture.value(&point), colored);
        }
    }
}
