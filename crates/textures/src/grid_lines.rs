//! A grid of lines on a background.
//!
//! - Twin: Mitsuba, hosted: a Python texture.
//! - Example: `scenes/textures/grid_lines.toml`.

use crate::support::mapping::{Mapping, Projection, TextureFunction};
use schemars::JsonSchema;
use serde::Deserialize;
use std::sync::Arc;
use toml::Spanned;
use whitstone_core::config::{Color, Scale2, Vector2};
use whitstone_core::{Context, DVec2, DVec3, Plugin, Rgb, SceneError, SceneErrors, Texture, Textures};

/// Default width of the lines relative to their spacing.
const DEFAULT_WIDTH: f64 = 0.1;

/// A grid of lines on a background.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// Colour between the lines.
    #[serde(default = "light")]
    a: Color,
    /// Colour of the lines.
    #[serde(default = "dark")]
    b: Color,
    /// Width of the lines across u and across v relative to their spacing, from 0 (no lines) to 1.
    #[serde(default)]
    #[schemars(extend("default" = DEFAULT_WIDTH), with = "Scale2")]
    width: Option<Spanned<Scale2>>,
    /// Lines per unit of u and of v.
    #[serde(default = "one")]
    scale: Scale2,
    /// Offset added to (u, v) after scaling: with 0, lines are centred at u = 0 and at v = 0.
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

/// The `grid_lines` texture; see the module documentation.
pub struct GridLines {
    a: Rgb,
    b: Rgb,
    half_width: DVec2,
    scale: DVec2,
    offset: DVec2,
}

impl Plugin<Textures> for GridLines {
    const TYPE: &'static str = "grid_lines";
    type Config = Config;

    fn build(config: Config, (): (), _: &mut dyn Context) -> Result<Arc<dyn Texture>, SceneErrors> {
        let width = match &config.width {
            None => DVec2::splat(DEFAULT_WIDTH),
            Some(width) => {
                let found = width.get_ref().get();
                if found.min_element() < 0.0 || found.max_element() > 1.0 {
                    let message = format!("expected widths from 0 to 1, found {} and {}", found.x, found.y);
                    return Err(SceneError::at(width.span(), message).into());
                }
                found
            }
        };
        let pattern = Self {
            a: config.a.get(),
            b: config.b.get(),
            half_width: 0.5 * width,
            scale: config.scale.get(),
            offset: config.offset.get(),
        };
        config.mapping.put(Projection::Uv, pattern)
    }
}

impl TextureFunction for GridLines {
    #[inline(always)]
    fn at(&self, q: DVec3) -> Rgb {
        let uv = q.truncate() * self.scale + self.offset;
        // Not the floor of uv + 0.5, which rounds for large uv.
        let part = uv - uv.floor();
        let from_line = part.min(1.0 - part);
        // NaN is not on a line.
        let line = (from_line.x < self.half_width.x) | (from_line.y < self.half_width.y);
        if line { self.b } else { self.a }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use whitstone_core::SurfaceInteraction;
    use whitstone_testkit::{build, texture_laws};

    fn at(text: &str, u: f64, v: f64) -> f64 {
        let mut point = SurfaceInteraction::new(DVec3::ZERO, 0.0, DVec3::Z);
        point.uv = DVec2::new(u, v);
        build::<Textures, GridLines>(text, ()).unwrap().value(&point).g
    }

    #[test]
    fn laws() {
        for text in [
            "",
            "scale = [10, 1e300]\noffset = [0.5, -1e9]",
            "a = 0\nb = [1, 2, 3]\nscale = -1\nwidth = [0, 1]",
            "mapping = { projection = \"spherical\" }",
        ] {
            texture_laws(&*build::<Textures, GridLines>(text, ()).unwrap());
        }
    }

    #[test]
    fn lines_lie_around_whole_numbers() {
        for (u, v, expected) in [
            (0.5, 0.5, 0.8),
            (0.04, 0.5, 0.2),
            (0.06, 0.5, 0.8),
            (-0.04, 0.5, 0.2),
            (0.96, 0.5, 0.2),
            (0.5, 7.04, 0.2),
            (0.5, -3.06, 0.8),
        ] {
            assert_eq!(at("", u, v), expected, "{u} {v}");
        }
        assert_eq!(at("width = [0.3, 0]", 0.14, 0.5), 0.2);
        assert_eq!(at("width = [0.3, 0]", 0.5, 0.0), 0.8);
        assert_eq!(at("width = [0, 0.3]", 0.0, 0.5), 0.8);
        assert_eq!(at("width = [0.2, 0.4]", 0.5, 0.85), 0.2);
        // Where lines cross, too.
        assert_eq!(at("", 0.04, 7.04), 0.2);
        assert_eq!(at("scale = 2\noffset = [0.5, 0.5]", 0.25, 0.1), 0.2);
        assert_eq!(at("offset = [0.25, 0]", 0.76, 0.5), 0.2);
    }

    #[test]
    fn widths_that_are_no_share_are_refused_at_their_place() {
        for text in ["width = [0.5, 1.5]", "width = [-0.5, 0.5]"] {
            let error = build::<Textures, GridLines>(text, ()).err().unwrap().0.remove(0);
            assert_eq!(error.span, Some(8..text.len()));
        }
    }
}
