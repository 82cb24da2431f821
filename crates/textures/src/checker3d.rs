//! A three-dimensional checkerboard: cubes of two colours.
//!
//! - Twin: Mitsuba, hosted: a Python texture; POV-Ray, a function.
//! - Example: `scenes/textures/checker3d.toml`.

use crate::support::cells::odd;
use crate::support::mapping::{Mapping, Projection, TextureFunction};
use schemars::JsonSchema;
use serde::Deserialize;
use std::sync::Arc;
use whitstone_core::config::{Color, Positive, Vector3};
use whitstone_core::{Context, DVec3, Plugin, Rgb, SceneErrors, Texture, Textures};

/// A three-dimensional checkerboard: cubes of two colours.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// Colour of the cube with its lower corner at the origin (without an offset), and of those
    /// that touch it only along edges.
    #[serde(default = "light")]
    a: Color,
    /// Colour of the adjacent cubes.
    #[serde(default = "dark")]
    b: Color,
    /// Cubes per unit of texture space (a metre by default).
    #[serde(default = "one")]
    scale: Positive,
    /// Added after scaling, along each axis.
    #[serde(default = "zero")]
    offset: Vector3,
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

fn zero() -> Vector3 {
    Vector3::new(0.0, 0.0, 0.0)
}

/// The `checker3d` texture; see the module documentation.
pub struct Checker3d {
    a: Rgb,
    b: Rgb,
    scale: f64,
    offset: DVec3,
}

impl Plugin<Textures> for Checker3d {
    const TYPE: &'static str = "checker3d";
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

impl TextureFunction for Checker3d {
    #[inline(always)]
    fn at(&self, q: DVec3) -> Rgb {
        let p = q * self.scale + self.offset;
        // The sum is 0 or 2 in cubes of colour a, 1 or 3 in those of b. If the cell is NaN, the
        // colour is b.
        let odd = odd(p.x) + odd(p.y) + odd(p.z);
        if (odd == 0.0) | (odd == 2.0) {
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
        Checker3d,
        "",
        "scale = 1e300\noffset = [0.5, -1e9, 0]",
        "a = 0\nb = [1, 2, 3]\nmapping = { projection = \"spherical\" }",
        "a = 0.0..1\nscale = 0.1..9\noffset = [-1.0..1, 0, 0.5]",
    );

    fn at(text: &str, position: [f64; 3]) -> f64 {
        let point = SurfaceInteraction::new(position.into(), 0.0, DVec3::Z);
        build::<Textures, Checker3d>(text, ()).unwrap().value(&point).g
    }

    #[test]
    fn cubes_alternate_along_each_axis() {
        for (position, expected) in [
            ([0.5, 0.5, 0.5], 0.8),
            ([1.5, 0.5, 0.5], 0.2),
            ([0.5, -0.5, 0.5], 0.2),
            ([0.5, -0.5, 1.5], 0.8),
            ([-0.5, -0.5, -0.5], 0.2),
        ] {
            assert_eq!(at("", position), expected, "{position:?}");
        }
        assert_eq!(at("scale = 4\noffset = [0.5, 0, 0]", [0.1, 0.1, 0.1]), 0.8);
        assert_eq!(at("scale = 4\noffset = [0.5, 0, 0]", [0.2, 0.1, 0.1]), 0.2);
    }

    #[test]
    fn a_floor_on_a_border_shows_squares() {
        for y in [-1e-12, 0.0, 1e-12] {
            assert_eq!(at("", [0.5, y, 0.5]), 0.8);
            assert_eq!(at("", [1.5, y, 0.5]), 0.2);
        }
    }
}
