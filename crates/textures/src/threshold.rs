//! A texture cut to 0 and 1, as for the opacity of leaves.
//!
//! - Twin: hosted by the Mitsuba driver.
//! - Example: `scenes/textures/threshold.toml`.

use crate::support::combine::needs;
use schemars::JsonSchema;
use serde::Deserialize;
use std::sync::Arc;
use whitstone_core::config::{NonNegative, TextureRef};
use whitstone_core::{
    ColorSource, Context, Plugin, Rgb, SceneErrors, SurfaceAttributes, SurfaceInteraction, Texture, Textures,
};

/// 1 where a texture is at least a number, else 0, in each channel.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// The texture.
    input: TextureRef,
    /// The lowest value that gives 1.
    #[serde(default = "half")]
    at: NonNegative,
}

fn half() -> NonNegative {
    NonNegative::new(0.5).expect("a half is not negative")
}

/// The `threshold` texture; see the module documentation.
pub struct Threshold {
    input: [ColorSource; 1],
    at: f32,
}

impl Plugin<Textures> for Threshold {
    const TYPE: &'static str = "threshold";
    type Config = Config;

    fn build(config: Config, (): (), context: &mut dyn Context) -> Result<Arc<dyn Texture>, SceneErrors> {
        let input = context.texture(&config.input)?;
        Ok(Arc::new(Self {
            input: [input],
            at: config.at.get() as f32,
        }))
    }
}

impl Threshold {
    fn cut(&self, value: Rgb) -> Rgb {
        // In single precision, so that a number that was written with few digits equals itself.
        value.map(|part| if part as f32 >= self.at { 1.0 } else { 0.0 })
    }
}

impl Texture for Threshold {
    fn needs(&self) -> SurfaceAttributes {
        needs(&self.input)
    }

    fn value(&self, point: &SurfaceInteraction) -> Rgb {
        self.cut(self.input[0].value(point))
    }

    fn constant(&self) -> Option<Rgb> {
        match self.input {
            [ColorSource::Constant(value)] => Some(self.cut(value)),
            [ColorSource::Texture(_)] => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::support::combine::Halves;
    use whitstone_core::DVec3;
    use whitstone_testkit::{TestContext, build_in, texture_laws};

    fn threshold(text: &str) -> Arc<dyn Texture> {
        let mut context = TestContext::default().with_texture("halves", Halves(Rgb::new(0.8, 0.1, 0.5)));
        build_in::<Textures, Threshold>(text, (), &mut context).unwrap()
    }

    #[test]
    fn laws() {
        let texture = threshold("input = \"halves\"");
        texture_laws(&*texture);
        let point = SurfaceInteraction::new(DVec3::ONE, 0.0, DVec3::X);
        assert_eq!(texture.value(&point), Rgb::new(1.0, 0.0, 1.0));
        assert_eq!(
            threshold("input = [0.2, 0.3, 0.1]\nat = 0.2").constant(),
            Some(Rgb::new(1.0, 1.0, 0.0))
        );
    }
}
