//! A surface that shines: as many points of it, each with its share of the area.
//!
//! The soft shadows of Cook, Porter and Carpenter, *Distributed ray tracing*, 1984, by a fixed quadrature instead of random points, so that two
//! renderers that agree on the points must agree on the picture. Each point shines with the cosine to the normal and
//! falls off with the square of the distance. The surface itself is not seen: a shape of material `emissive` in its place is.
//!
//! - Twin: Mitsuba `point` at the same points, through the driver.
//! - Example: `scenes/lights/area.toml`.

use crate::emission::{self, Falloff};
use schemars::JsonSchema;
use serde::Deserialize;
use std::f64::consts::{PI, TAU};
use std::sync::Arc;
use toml::Spanned;
use whitstone_core::config::{Color, IntegerIn, Steps};
use whitstone_core::stream::{LANES, SampleStreams, Vectors};
use whitstone_core::{
    Aabb, Context, DVec3, Light, LightGives, LightSample, Lights, Plugin, Rgb, SceneError, SceneErrors,
    Transform,
};

/// A surface that shines, as a grid of fixed points of it.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// What shines, in the size of the shape of that type: "rectangle" and "disk" along +z, "sphere" outwards.
    #[serde(default)]
    shape: Surface,
    /// Where it stands: one step, or steps in the order in which they are applied. That of a sphere must be a similarity.
    #[serde(default = "none")]
    #[schemars(with = "Steps")]
    transform: Spanned<Steps>,
    /// Radiance in W/(m² sr), the same in all directions.
    radiance: Color,
    /// Points along each side of the grid; their square is the number of shadow rays at each surface point.
    #[serde(default = "four")]
    samples: IntegerIn<1, 32>,
}

fn none() -> Spanned<Steps> {
    Spanned::new(0..0, Steps::NONE)
}

fn four() -> IntegerIn<1, 32> {
    IntegerIn::new(4).expect("4 is in range")
}

/// What shines.
#[derive(Clone, Copy, Debug, Default, Deserialize, JsonSchema, PartialEq)]
#[serde(rename_all = "snake_case")]
enum Surface {
    /// z = 0, -1 <= x, y <= 1.
    #[default]
    Rectangle,
    /// z = 0, x² + y² <= 1.
    Disk,
    /// x² + y² + z² = 1.
    Sphere,
}

/// A point of the surface.
struct Spot {
    position: DVec3,
    /// Unit normal.
    normal: DVec3,
}

/// See the module.
pub struct Area {
    spots: Vec<Spot>,
    /// Of each point, along its normal: radiance times its share of the area.
    intensity: Rgb,
}

impl Plugin<Lights> for Area {
    const TYPE: &'static str = "area";
    type Config = Config;

    fn build(config: Config, (): (), _: &mut dyn Context) -> Result<Arc<dyn Light>, SceneErrors> {
        let transform = config.transform.get_ref().get();
        let n = config.samples.get();
        let area = area(config.shape, &transform).ok_or_else(|| {
            let message = "the transform of a sphere that shines must be a similarity";
            SceneError::at(config.transform.span(), message).with_help("scale by one number, not by axis")
        })?;
        let middle = |k: u32| (f64::from(k) + 0.5) / f64::from(n);
        let cells = (0..n).flat_map(|j| (0..n).map(move |i| (middle(i), middle(j))));
        let spots = cells.map(|(u, v)| spot(config.shape, &transform, u, v)).collect();
        let intensity = config.radiance.get() * (area / f64::from(n * n));
        let finite = intensity.max_component().is_finite();
        if !finite {
            return Err(
                SceneError::at(config.transform.span(), "the surface is too large for numbers").into(),
            );
        }
        Ok(Arc::new(Self { spots, intensity }))
    }
}

/// In m²; `None` for a sphere that is none in the world.
fn area(surface: Surface, transform: &Transform) -> Option<f64> {
    let across = transform
        .vector_to_world(DVec3::X)
        .cross(transform.vector_to_world(DVec3::Y))
        .length();
    match surface {
        Surface::Rectangle => Some(4.0 * across),
        Surface::Disk => Some(PI * across),
        Surface::Sphere => transform
            .similarity_scale()
            .map(|radius| 4.0 * PI * radius * radius),
    }
}

/// The point at (u, v) of a unit square that is mapped to the surface so that equal areas stay equal.
fn spot(surface: Surface, transform: &Transform, u: f64, v: f64) -> Spot {
    let (sin, cos) = (TAU * u).sin_cos();
    let (point, normal) = match surface {
        Surface::Rectangle => (DVec3::new(2.0 * u - 1.0, 2.0 * v - 1.0, 0.0), DVec3::Z),
        Surface::Disk => {
            let r = v.sqrt();
            (DVec3::new(r * cos, r * sin, 0.0), DVec3::Z)
        }
        Surface::Sphere => {
            let z = 1.0 - 2.0 * v;
            let r = (1.0 - z * z).sqrt();
            let point = DVec3::new(r * cos, r * sin, z);
            (point, point)
        }
    };
    Spot {
        position: transform.point_to_world(point),
        normal: transform.normal_to_world(normal),
    }
}

/// The cosine at the surface towards a point that sees it in this direction.
#[inline(always)]
fn facing(normal: DVec3, direction: DVec3) -> f64 {
    (-normal.dot(direction)).max(0.0)
}

impl Light for Area {
    fn gives(&self) -> LightGives {
        LightGives::SAMPLES
    }

    fn samples(&self, point: DVec3, out: &mut Vec<LightSample>) {
        for Spot { position, normal } in &self.spots {
            let sample = emission::sample(*position, point, self.intensity, Falloff::InverseSquare);
            out.extend(sample.map(|sample| LightSample {
                irradiance: sample.irradiance * facing(*normal, sample.direction),
                ..sample
            }));
        }
    }

    fn samples_stream(&self, len: usize, points: &Vectors, out: &mut SampleStreams) {
        for Spot { position, normal } in &self.spots {
            let place = out.len();
            emission::sample_stream(
                *position,
                len,
                points,
                self.intensity,
                Falloff::InverseSquare,
                out,
            );
            let stream = out.stream(place);
            for lane in 0..len.min(LANES) {
                let irradiance = stream.irradiance.get(lane);
                // There is no direction to where nothing comes from.
                if !irradiance.is_black() {
                    let cosine = facing(*normal, stream.direction.get(lane));
                    stream.irradiance.set(lane, irradiance * cosine);
                }
            }
        }
    }

    /// A point of it shines to the side of its normal: whether the ball around the box reaches there.
    fn reaches(&self, bounds: &Aabb) -> bool {
        let (center, radius) = emission::ball_around(bounds);
        let before = |spot: &Spot| {
            let out = center - spot.position;
            // Where that is no number, it may reach.
            let behind = spot.normal.dot(out) + radius < -1e-9 * (out.length() + radius);
            !behind
        };
        !self.intensity.is_black() && self.spots.iter().any(before)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use whitstone_testkit::{build, light_laws};

    fn irradiance(text: &str, point: DVec3, normal: DVec3) -> f64 {
        let mut samples = Vec::new();
        build::<Lights, Area>(text, ())
            .unwrap()
            .samples(point, &mut samples);
        samples
            .iter()
            .map(|sample| sample.irradiance.g * normal.dot(sample.direction).max(0.0))
            .sum()
    }

    #[test]
    fn laws() {
        for text in [
            "radiance = [1, 0, 7]",
            "radiance = 3\nshape = \"disk\"\nsamples = 3\ntransform = { scale = [1, 2, 3] }",
            "radiance = 3\nshape = \"sphere\"\nsamples = 2\ntransform = [{ scale = 0.5 }, { translate = [1, 0, 0] }]",
        ] {
            light_laws(&*build::<Lights, Area>(text, ()).unwrap());
        }
    }

    /// Against closed forms of the irradiance below the middle: the error of the quadrature falls with the square of the distance of points.
    #[test]
    fn it_converges_to_the_integral() {
        // A disk of radius 1 at height 1 gives pi L/(1 + h²); a sphere of radius 1 with its middle at height 2 gives pi L (r/d)².
        let below = "transform = { rotate = { axis = [1, 0, 0], degrees = 180 } }";
        for (shape, height, expected) in [("disk", 1.0, PI), ("sphere", 2.0, 2.0 * PI / 4.0)] {
            let error = |n: u32| {
                let text = format!("shape = \"{shape}\"\nradiance = 2\nsamples = {n}\n{below}");
                let point = DVec3::new(0.0, 0.0, -height);
                (irradiance(&text, point, DVec3::Z) / expected - 1.0).abs()
            };
            let (coarse, fine) = (error(4), error(32));
            assert!(coarse < 0.5 && fine < coarse / 20.0, "{shape}: {coarse} {fine}");
        }
    }

    #[test]
    fn the_back_is_dark() {
        let text = "radiance = 1";
        assert_eq!(irradiance(text, DVec3::NEG_Z, DVec3::Z), 0.0);
        assert!(irradiance(text, DVec3::Z, DVec3::NEG_Z) > 0.0);
    }

    #[test]
    fn bad_values_are_refused_at_their_places() {
        for (text, place) in [
            ("radiance = -1", "-1"),
            ("radiance = 1\nsamples = 0", "0"),
            ("radiance = 1\nshape = \"cube\"", "\"cube\""),
            (
                "radiance = 1\nshape = \"sphere\"\ntransform = { scale = [1, 2, 1] }",
                "{ scale = [1, 2, 1] }",
            ),
            (
                "radiance = 1e300\ntransform = { scale = 1e150 }",
                "{ scale = 1e150 }",
            ),
        ] {
            let error = build::<Lights, Area>(text, ()).err().unwrap().0.remove(0);
            assert_eq!(&text[error.span.unwrap()], place);
        }
    }
}
