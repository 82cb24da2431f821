//! Concentric rings of two colours around the y axis of texture space.
//!
//! - Twin: Mitsuba, hosted: a Python texture; in POV-Ray, a `function` pattern.
//! - Example: `scenes/textures/rings.toml`.

use crate::support::cells::odd;
use crate::support::mapping::{Mapping, Projection, TextureFunction};
use schemars::JsonSchema;
use serde::Deserialize;
use std::sync::Arc;
use whitstone_core::config::{Color, Finite, Positive};
use whitstone_core::{Context, DVec3, Plugin, Rgb, SceneErrors, Texture, Textures};

/// Concentric rings of two colours around the y axis of texture space (up in the world by default).
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// Colour of every second ring, starting with the innermost if `offset` is 0.
    #[serde(default = "light")]
    a: Color,
    /// Colour of the other rings.
    #[serde(default = "dark")]
    b: Color,
    /// Rings per unit of texture space (a metre by default).
    #[serde(default = "one")]
    scale: Positive,
    /// Added to the distance from the axis after scaling.
    #[serde(default = "zero")]
    offset: Finite,
    /// Mapping of the texture.
    #[serde(default)]
    #[schemars(extend("x-default" = "by world-space position"))]
    mapping: Mapping,
}

fn light() -> Color {
    Color::grey(0.8)
}

fn dark() -> Color {
    Color::grey(0.2)
}

fn one() -> Positive {
    Positive::new(1.0).expect("1 is positive")
}

fn zero() -> Finite {
    Finite::new(0.0).expect("0 is finite")
}

/// The `rings` texture; see the module documentation.
pub struct Rings {
    a: Rgb,
    b: Rgb,
    scale: f64,
    offset: f64,
}

impl Plugin<Textures> for Rings {
    const TYPE: &'static str = "rings";
    type Config = Config;

    fn build(config: Config, (): (), _: &mut dyn Context) -> Result<Arc<dyn Texture>, SceneErrors> {
        let pattern = Self {
            a: config.a.get(),
            b: config.b.get(),
            scale: config.scale.get(),
            offset: config.offset.get(),
        };
        config.mapping.put(Projection::Solid, pattern)
    }
}

impl TextureFunction for Rings {
    #[inline(always)]
    fn at(&self, q: DVec3) -> Rgb {
        let r = (q.x * q.x + q.z * q.z).sqrt();
        // If the cell number is NaN, the colour is b.
        if odd(r * self.scale + self.offset) == 0.0 {
            self.a
        } else {
            self.b
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use whitstone_core::SurfaceInteraction;
    use whitstone_testkit::build;

    whitstone_testkit::texture_laws!(
        Rings,
        "",
        "scale = 1e300\noffset = -1e9",
        "a = 0\nb = [1, 2, 3]\nmapping = { projection = \"planar\" }",
        "a = 0.0..1\nscale = 0.1..9\noffset = -1.0..1",
    );

    fn at(text: &str, position: [f64; 3]) -> f64 {
        let point = SurfaceInteraction::new(position.into(), 0.0, DVec3::Z);
        build::<Textures, Rings>(text, ()).unwrap().value(&point).g
    }

    #[test]
    fn rings_alternate_around_y() {
        for (position, expected) in [
            ([0.5, 7.0, 0.5], 0.8),
            ([0.75, 7.0, 0.75], 0.2),
            ([-0.75, -1.0, 0.75], 0.2),
            ([0.0, 0.0, -2.5], 0.8),
        ] {
            assert_eq!(at("", position), expected, "{position:?}");
        }
        assert_eq!(at("scale = 2\noffset = 1", [0.3, 0.0, 0.0]), 0.2);
        assert_eq!(at("scale = 2\noffset = 0.25", [0.4, 0.0, 0.0]), 0.2);
    }
}
