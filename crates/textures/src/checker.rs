//! A checkerboard of two colours.
//!
//! - Twin: Mitsuba `checkerboard` (native).
//! - Example: `scenes/textures/checker.toml`.

use crate::support::mapping::{Mapping, Projection, TextureFunction};
use schemars::JsonSchema;
use serde::Deserialize;
use std::sync::Arc;
use whitstone_core::config::{Color, Scale2, Vector2};
use whitstone_core::{Context, DVec2, DVec3, Plugin, Rgb, SceneErrors, Texture, Textures};

/// A checkerboard of two colours.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// Colour of the squares where floor(x) + floor(y) is even, with (x, y) = (u, v) * scale +
    /// offset.
    #[serde(default = "light")]
    a: Color,
    /// Colour of the other squares.
    #[serde(default = "dark")]
    b: Color,
    /// Squares per unit of u and of v.
    #[serde(default = "one")]
    scale: Scale2,
    /// Offset added to (u, v) after scaling.
    #[serde(default = "zero")]
    offset: Vector2,
    /// Mapping of the texture.
    #[serde(default)]
    #[schemars(extend("x-default" = "by (u, v)"))]
    mapping: Mapping,
}

fn light() -> Color {
    Color::grey(0.8)
}

fn dark() -> Color {
    Color::grey(0.2)
}

fn one() -> Scale2 {
    Scale2::splat(1.0)
}

fn zero() -> Vector2 {
    Vector2::new(0.0, 0.0)
}

/// The `checker` texture; see the module documentation.
pub struct Checker {
    a: Rgb,
    b: Rgb,
    scale: DVec2,
    offset: DVec2,
}

impl Plugin<Textures> for Checker {
    const TYPE: &'static str = "checker";
    type Config = Config;

    fn build(config: Config, (): (), _: &mut dyn Context) -> Result<Arc<dyn Texture>, SceneErrors> {
        let pattern = Self {
            a: config.a.get(),
            b: config.b.get(),
            scale: config.scale.get(),
            offset: config.offset.get(),
        };
        config.mapping.put(Projection::Uv, pattern)
    }
}

impl TextureFunction for Checker {
    #[inline(always)]
    fn at(&self, q: DVec3) -> Rgb {
        let cell = (q.truncate() * self.scale + self.offset).floor();
        // The remainder modulo 2 is exact for every finite number; the sum of both cell numbers
        // could round. If a cell number is NaN, the colour is b.
        let odd = cell - 2.0 * (0.5 * cell).floor();
        if odd.x == odd.y { self.a } else { self.b }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use whitstone_core::SurfaceInteraction;
    use whitstone_testkit::build;

    whitstone_testkit::texture_laws!(
        Checker,
        "",
        "scale = [10, 1e300]\noffset = [0.5, -1e9]",
        "a = 0\nb = [1, 2, 3]\nscale = -1",
        "a = 0.0..1\nscale = [-9.0..9, 0.1..9]\noffset = [-1.0..1, 0]",
    );

    fn at(text: &str, u: f64, v: f64) -> f64 {
        let mut point = SurfaceInteraction::new(DVec3::ZERO, 0.0, DVec3::Z);
        point.uv = DVec2::new(u, v);
        build::<Textures, Checker>(text, ()).unwrap().value(&point).g
    }

    #[test]
    fn squares_alternate_on_both_sides_of_zero() {
        for (u, v, expected) in [
            (0.5, 0.5, 0.8),
            (1.0, 0.5, 0.2),
            (-0.5, 0.5, 0.2),
            (-0.5, -0.5, 0.8),
            (1.5, 7.5, 0.8),
            (9007199254740993.0, 0.0, 0.8),
            (-4503599627370495.0, 1e300, 0.2),
        ] {
            assert_eq!(at("", u, v), expected, "{u} {v}");
        }
    }

    #[test]
    fn scale_comes_before_offset() {
        assert_eq!(at("scale = [4, 1]\noffset = [0.5, 0]", 0.1, 0.0), 0.8);
        assert_eq!(at("scale = [4, 1]\noffset = [0.5, 0]", 0.2, 0.0), 0.2);
    }
}
