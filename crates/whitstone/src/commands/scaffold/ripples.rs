//! Concentric rings of two alternating colours in texture space.
//!
//! - Twin: none; the tests check the colours at given distances from the centre.
//! - Example: `scenes/ripples.toml`.

use schemars::JsonSchema;
use serde::Deserialize;
use std::sync::Arc;
use whitstone_core::config::{Color, Positive, Vector2};
use whitstone_core::{
    Context, DVec2, Plugin, Rgb, SceneErrors, SurfaceAttributes, SurfaceInteraction, Texture, Textures,
};

/// Concentric rings of two alternating colours in texture space.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// Colour of the innermost ring.
    #[serde(default = "light")]
    a: Color,
    /// Colour of the next ring.
    #[serde(default = "dark")]
    b: Color,
    /// Centre of the rings, in (u, v).
    #[serde(default = "middle")]
    center: Vector2,
    /// Width of a ring, in units of u and v.
    #[serde(default = "tenth")]
    width: Positive,
}

fn light() -> Color {
    Color::grey(0.8)
}

fn dark() -> Color {
    Color::grey(0.2)
}

fn middle() -> Vector2 {
    Vector2::new(0.5, 0.5)
}

fn tenth() -> Positive {
    Positive::new(0.1).expect("a tenth is positive")
}

/// The texture that `Config` describes; see the module documentation.
pub struct Ripples {
    colors: [Rgb; 2],
    center: DVec2,
    width: f64,
}

impl Plugin<Textures> for Ripples {
    const TYPE: &'static str = "ripples";
    type Config = Config;

    fn build(config: Config, (): (), _: &mut dyn Context) -> Result<Arc<dyn Texture>, SceneErrors> {
        Ok(Arc::new(Self {
            colors: [config.a.get(), config.b.get()],
            center: config.center.get(),
            width: config.width.get(),
        }))
    }
}

impl Texture for Ripples {
    fn needs(&self) -> SurfaceAttributes {
        SurfaceAttributes::UV
    }

    fn value(&self, point: &SurfaceInteraction) -> Rgb {
        let distance = (point.uv - self.center).length();
        // For an infinite distance the remainder is NaN, which compares false.
        let inner = distance.rem_euclid(2.0 * self.width) < self.width;
        self.colors[usize::from(!inner)]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use whitstone_core::DVec3;
    use whitstone_testkit::build;

    whitstone_testkit::texture_laws!(
        Ripples,
        "",
        "a = [0, 1, 2]\nb = 0",
        "center = [-1.0..1, 0]\nwidth = 1e-3..10.0",
    );

    #[test]
    fn colours_change_with_the_distance() {
        let texture = build::<Textures, Ripples>("a = 1\nb = 0\nwidth = 0.25", ()).unwrap();
        for (u, expected) in [(0.5, 1.0), (0.7, 1.0), (0.8, 0.0), (0.2, 0.0), (1.1, 1.0)] {
            let mut point = SurfaceInteraction::new(DVec3::ZERO, 0.0, DVec3::Z);
            point.uv = DVec2::new(u, 0.5);
            assert_eq!(texture.value(&point), Rgb::splat(expected), "{u}");
        }
    }
}
