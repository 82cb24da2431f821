//! A linear blend of two textures or colours, weighted by a third.
//!
//! - Twin: hosted by the Mitsuba driver.
//! - Example: `scenes/textures/mix.toml`.

use crate::support::combine::{needs, parts};
use schemars::JsonSchema;
use serde::Deserialize;
use std::sync::Arc;
use whitstone_core::config::TextureRef;
use whitstone_core::{
    ColorSource, Context, Plugin, Rgb, SceneError, SceneErrors, SurfaceAttributes, SurfaceInteraction,
    Texture, Textures,
};

/// A linear blend of two textures or colours.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// The colour where the weight is 0.
    a: TextureRef,
    /// The colour where the weight is 1.
    b: TextureRef,
    /// Weight of `b`, from 0 to 1 in each channel.
    #[serde(default = "half")]
    weight: TextureRef,
}

fn half() -> TextureRef {
    TextureRef::grey(0.5)
}

/// The `mix` texture; see the module documentation.
pub struct Mix {
    /// a, b, weight.
    parts: [ColorSource; 3],
}

impl Plugin<Textures> for Mix {
    const TYPE: &'static str = "mix";
    type Config = Config;

    fn build(config: Config, (): (), context: &mut dyn Context) -> Result<Arc<dyn Texture>, SceneErrors> {
        let span = config.weight.span.clone();
        let found = parts(&[config.a, config.b, config.weight], context)?;
        let parts: [ColorSource; 3] = found
            .try_into()
            .unwrap_or_else(|_| unreachable!("three references give three parts"));
        if let ColorSource::Constant(weight) = parts[2]
            && weight.to_array().iter().any(|part| *part > 1.0)
        {
            let message = "expected a weight from 0 to 1 in each channel";
            let error = match span {
                Some(span) => SceneError::at(span, message),
                None => SceneError::anywhere(message),
            };
            return Err(error.into());
        }
        Ok(Arc::new(Self { parts }))
    }
}

fn blend([a, b, weight]: [Rgb; 3]) -> Rgb {
    // A weight from a texture may exceed 1 and must not make the result negative.
    let weight = weight.map(|weight| weight.min(1.0));
    a * weight.map(|weight| 1.0 - weight) + b * weight
}

impl Texture for Mix {
    fn needs(&self) -> SurfaceAttributes {
        needs(&self.parts)
    }

    fn value(&self, point: &SurfaceInteraction) -> Rgb {
        blend(self.parts.each_ref().map(|part| part.value(point)))
    }

    fn constant(&self) -> Option<Rgb> {
        match self.parts {
            [
                ColorSource::Constant(a),
                ColorSource::Constant(b),
                ColorSource::Constant(weight),
            ] => Some(blend([a, b, weight])),
            _ => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::support::combine::Halves;
    use whitstone_core::DVec3;
    use whitstone_testkit::{TestContext, build_in, texture_laws};

    fn mix(text: &str) -> Result<Arc<dyn Texture>, SceneErrors> {
        let mut context = TestContext::default().with_texture("halves", Halves(Rgb::splat(0.8)));
        build_in::<Textures, Mix>(text, (), &mut context)
    }

    #[test]
    fn laws() {
        let texture = mix("a = [1, 0, 0]\nb = \"halves\"\nweight = [0.25, 1, 0]").unwrap();
        texture_laws(&*texture);
        let point = SurfaceInteraction::new(DVec3::ONE, 0.0, DVec3::X);
        assert_eq!(texture.value(&point), Rgb::new(0.75 + 0.25 * 0.8, 0.8, 0.0));
        texture_laws(&*mix("a = 0\nb = 1\nweight = \"halves\"").unwrap());
    }

    #[test]
    fn a_blend_of_constants_is_one() {
        assert_eq!(mix("a = 0\nb = 1").unwrap().constant(), Some(Rgb::splat(0.5)));
        assert!(
            mix("a = 0\nb = 1\nweight = \"halves\"")
                .unwrap()
                .constant()
                .is_none()
        );
    }

    #[test]
    fn a_weight_is_at_most_one() {
        let error = mix("a = 0\nb = 1\nweight = 1.5").err().unwrap().0.remove(0);
        assert_eq!(error.span, Some(21..24));
    }
}
