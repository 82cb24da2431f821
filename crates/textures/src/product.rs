//! The product of textures and colours, such as an image and the colour that tints it.
//!
//! - Twin: hosted by the Mitsuba driver.
//! - Example: `scenes/textures/product.toml`.

use crate::support::combine::{needs, parts};
use schemars::JsonSchema;
use serde::Deserialize;
use std::sync::Arc;
use toml::Spanned;
use whitstone_core::config::TextureRef;
use whitstone_core::stream::{Colors, SurfaceStream};
use whitstone_core::{
    ColorSource, Context, Plugin, Rgb, SceneError, SceneErrors, SurfaceAttributes, SurfaceInteraction,
    Texture, Textures,
};

/// Maximum number of factors.
const MAX_FACTORS: usize = 16;

/// The product of textures and colours.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// 1 to 16 textures or colours.
    #[schemars(with = "Vec<TextureRef>", length(min = 1, max = MAX_FACTORS))]
    factors: Spanned<Vec<TextureRef>>,
}

/// The `product` texture; see the module documentation.
pub struct Product {
    factors: Vec<ColorSource>,
}

impl Plugin<Textures> for Product {
    const TYPE: &'static str = "product";
    type Config = Config;

    fn build(config: Config, (): (), context: &mut dyn Context) -> Result<Arc<dyn Texture>, SceneErrors> {
        let span = config.factors.span();
        let references = config.factors.into_inner();
        if !(1..=MAX_FACTORS).contains(&references.len()) {
            let message = format!("expected 1 to {MAX_FACTORS} factors, found {}", references.len());
            return Err(SceneError::at(span, message).into());
        }
        let factors = parts(&references, context)?;
        Ok(Arc::new(Self { factors }))
    }
}

impl Texture for Product {
    fn needs(&self) -> SurfaceAttributes {
        needs(&self.factors)
    }

    fn value(&self, point: &SurfaceInteraction) -> Rgb {
        let (first, rest) = self.factors.split_first().expect("there is a factor");
        rest.iter().fold(first.value(point), |product, factor| {
            product * factor.value(point)
        })
    }

    fn value_stream(&self, points: &SurfaceStream, out: &mut Colors) {
        let (first, rest) = self.factors.split_first().expect("there is a factor");
        first.value_stream(points, out);
        let mut factors = Colors::default();
        for factor in rest {
            factor.value_stream(points, &mut factors);
            for lane in 0..points.len {
                out.set(lane, out.get(lane) * factors.get(lane));
            }
        }
    }

    fn constant(&self) -> Option<Rgb> {
        let mut product = Rgb::WHITE;
        for factor in &self.factors {
            match factor {
                ColorSource::Constant(value) => product *= *value,
                ColorSource::Texture(_) => return None,
            }
        }
        Some(product)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::support::combine::Halves;
    use whitstone_core::DVec3;
    use whitstone_testkit::{TestContext, build_in, texture_laws};

    fn product(text: &str) -> Result<Arc<dyn Texture>, SceneErrors> {
        let mut context = TestContext::default().with_texture("halves", Halves(Rgb::splat(0.8)));
        build_in::<Textures, Product>(text, (), &mut context)
    }

    #[test]
    fn laws() {
        let texture = product("factors = [\"halves\", [0.5, 1, 3], \"halves\"]").unwrap();
        texture_laws(&*texture);
        let point = SurfaceInteraction::new(DVec3::ONE, 0.0, DVec3::X);
        let found = texture.value(&point);
        assert_eq!(found, Rgb::new(0.8 * 0.5 * 0.8, 0.8 * 0.8, 0.8 * 3.0 * 0.8));
        texture_laws(&*product("factors = [0.5, [1, 2, 3]]").unwrap());
    }

    #[test]
    fn a_product_of_constants_is_one() {
        let texture = product("factors = [0.5, [1, 2, 4]]").unwrap();
        assert_eq!(texture.constant(), Some(Rgb::new(0.5, 1.0, 2.0)));
        assert!(product("factors = [\"halves\", 1]").unwrap().constant().is_none());
    }

    #[test]
    fn factors_are_needed_and_not_negative() {
        for (text, place) in [("factors = []", "[]"), ("factors = [-1]", "-1")] {
            let error = product(text).err().unwrap().0.remove(0);
            assert_eq!(&text[error.span.unwrap()], place, "{}", error.message);
        }
    }
}
