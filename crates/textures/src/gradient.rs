//! A colour ramp along the first axis.
//!
//! - Twin: Mitsuba, hosted: a Python texture; POV-Ray, a function.
//! - Example: `scenes/textures/gradient.toml`.

use crate::support::cells::cell;
use crate::support::mapping::{Mapping, Projection, TextureFunction};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::sync::Arc;
use toml::Spanned;
use whitstone_core::config::{Color, Finite, Positive, UnitInterval};
use whitstone_core::{Context, DVec3, Plugin, Rgb, SceneError, SceneErrors, Texture, Textures};

/// A colour ramp along the first axis.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// Colour at x = 0 (without an offset).
    #[serde(default)]
    #[schemars(extend("default" = 0.8), with = "Color")]
    a: Option<Spanned<Color>>,
    /// Colour at the end of the ramp, x = 1.
    #[serde(default)]
    #[schemars(extend("default" = 0.2), with = "Color")]
    b: Option<Spanned<Color>>,
    /// Replaces `a` and `b`: 2 to 64 colours at positions from 0 to 1, strictly
    /// increasing.
    #[serde(default)]
    #[schemars(extend("x-default" = "none"), with = "Vec<Stop>")]
    stops: Option<Spanned<Vec<Stop>>>,
    /// Ramps per unit of texture space (a metre by default).
    #[serde(default = "one")]
    scale: Positive,
    /// Added after scaling.
    #[serde(default = "zero")]
    offset: Finite,
    /// Continuation beyond the ramp: "repeat" repeats it, "clamp" uses the colour of its end,
    /// "mirror" reflects it.
    #[serde(default)]
    wrap: Wrap,
    /// Mapping of the texture.
    #[serde(default)]
    #[schemars(extend("x-default" = "by world-space position"))]
    mapping: Mapping,
}

/// A colour stop of the ramp.
#[derive(Clone, Copy, Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Stop {
    /// Position of the stop.
    at: UnitInterval,
    /// Colour at the stop.
    color: Color,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
enum Wrap {
    /// Repeats the ramp.
    #[default]
    Repeat,
    /// Uses the colour of its end.
    Clamp,
    /// Reflects the ramp.
    Mirror,
}

fn one() -> Positive {
    Positive::new(1.0).expect("1 is positive")
}

fn zero() -> Finite {
    Finite::new(0.0).expect("0 is finite")
}

/// The `gradient` texture; see the module documentation.
pub struct Gradient {
    /// Positions and colours; at least two.
    stops: Vec<(f64, Rgb)>,
    scale: f64,
    offset: f64,
    wrap: Wrap,
}

impl Plugin<Textures> for Gradient {
    const TYPE: &'static str = "gradient";
    type Config = Config;

    fn build(config: Config, (): (), _: &mut dyn Context) -> Result<Arc<dyn Texture>, SceneErrors> {
        let stops = match &config.stops {
            None => {
                let color =
                    |key: &Option<Spanned<Color>>, usual| key.as_ref().map_or(usual, |c| c.get_ref().get());
                vec![
                    (0.0, color(&config.a, Rgb::splat(0.8))),
                    (1.0, color(&config.b, Rgb::splat(0.2))),
                ]
            }
            Some(stops) => {
                if let Some(key) = config.a.as_ref().or(config.b.as_ref()) {
                    let message = "a gradient with `stops` has no `a` and no `b`";
                    return Err(SceneError::at(key.span(), message).into());
                }
                let list = stops.get_ref();
                if !(2..=64).contains(&list.len()) {
                    let message = format!("expected 2 to 64 stops, found {}", list.len());
                    return Err(SceneError::at(stops.span(), message).into());
                }
                if let Some(pair) = list.windows(2).find(|pair| pair[0].at >= pair[1].at) {
                    let (before, at) = (pair[0].at.get(), pair[1].at.get());
                    let message = format!("expected stops in ascending order, found {at} after {before}");
                    return Err(SceneError::at(stops.span(), message).into());
                }
                list.iter()
                    .map(|stop| (stop.at.get(), stop.color.get()))
                    .collect()
            }
        };
        let pattern = Self {
            stops,
            scale: config.scale.get(),
            offset: config.offset.get(),
            wrap: config.wrap,
        };
        config.mapping.put(Projection::Solid, pattern)
    }
}

impl TextureFunction for Gradient {
    fn at(&self, q: DVec3) -> Rgb {
        let x = q.x * self.scale + self.offset;
        let t = match self.wrap {
            Wrap::Repeat => x - cell(x),
            Wrap::Clamp => x,
            Wrap::Mirror => 1.0 - (x - 2.0 * (0.5 * x).floor() - 1.0).abs(),
        };
        // Also maps NaN to 0.
        let t = if t > 0.0 { t.min(1.0) } else { 0.0 };
        let above = self.stops.partition_point(|(at, _)| *at <= t);
        match (
            above.checked_sub(1).map(|below| self.stops[below]),
            self.stops.get(above),
        ) {
            (Some((start, first)), Some((end, last))) => {
                let share = (t - start) / (end - start);
                first * (1.0 - share) + *last * share
            }
            (Some((_, color)), None) => color,
            (None, _) => self.stops[0].1,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use whitstone_core::SurfaceInteraction;
    use whitstone_testkit::build;

    const THREE: &str = "stops = [{ at = 0.25, color = 1 }, { at = 0.5, color = 3 }, { at = 1, color = 0 }]";

    whitstone_testkit::texture_laws!(
        Gradient,
        "",
        "scale = 1e300\noffset = -1e9",
        "wrap = \"mirror\"\nb = [1, 2, 3]\nmapping = { projection = \"uv\" }",
        "wrap = \"clamp\"\nstops = [{ at = 0.25, color = 1 }, { at = 0.5, color = 3 }, { at = 1, color = 0 }]",
        "a = 0.0..1\nscale = 0.1..9\noffset = -1.0..1",
    );

    fn at(text: &str, x: f64) -> f64 {
        let point = SurfaceInteraction::new(DVec3::new(x, 5.0, -3.0), 0.0, DVec3::Z);
        build::<Textures, Gradient>(text, ()).unwrap().value(&point).g
    }

    #[test]
    fn ramps_go_on_as_they_are_wrapped() {
        let ramp = "a = 0\nb = 1";
        for (wrap, x, expected) in [
            ("repeat", 0.25, 0.25),
            ("repeat", 1.25, 0.25),
            ("repeat", -0.25, 0.75),
            ("repeat", 1.0, 0.0),
            ("repeat", 1.0 - 1e-9, 0.0),
            ("repeat", -1e-9, 0.0),
            ("clamp", 0.25, 0.25),
            ("clamp", 1.25, 1.0),
            ("clamp", -0.25, 0.0),
            ("mirror", 0.25, 0.25),
            ("mirror", 1.25, 0.75),
            ("mirror", -0.25, 0.25),
            ("mirror", 2.25, 0.25),
        ] {
            assert_eq!(
                at(&format!("{ramp}\nwrap = \"{wrap}\""), x),
                expected,
                "{wrap} {x}"
            );
        }
        assert_eq!(at(&format!("{ramp}\nscale = 0.5\noffset = 0.25"), 0.5), 0.5);
    }

    #[test]
    fn stops_are_joined_by_lines() {
        for (x, expected) in [
            (0.0, 1.0),
            (0.25, 1.0),
            (0.375, 2.0),
            (0.5, 3.0),
            (0.75, 1.5),
            (0.99, 0.06),
        ] {
            let found = at(THREE, x);
            assert!((found - expected).abs() < 1e-12, "{x}: {found}, not {expected}");
        }
    }

    #[test]
    fn stops_are_refused_at_their_place() {
        for (text, at) in [
            ("stops = [{ at = 0, color = 1 }]", "[{ at = 0, color = 1 }]"),
            (
                "stops = [{ at = 0.5, color = 1 }, { at = 0.5, color = 1 }]",
                "[{ at = 0.5, color = 1 }, { at = 0.5, color = 1 }]",
            ),
            (
                "a = 0.5\nstops = [{ at = 0, color = 1 }, { at = 1, color = 1 }]",
                "0.5",
            ),
        ] {
            let error = build::<Textures, Gradient>(text, ()).err().unwrap().0.remove(0);
            assert_eq!(&text[error.span.unwrap()], at);
        }
    }
}
