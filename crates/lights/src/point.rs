//! A point light that emits equally in all directions.
//!
//! - Twin: Mitsuba `point` (native); hosted for `falloff = "none"`.
//! - Example: `scenes/lights/point.toml`.

use crate::support::emission::{self, Falloff};
use schemars::JsonSchema;
use serde::Deserialize;
use std::sync::Arc;
use whitstone_core::config::{Color, Vector3};
use whitstone_core::stream::{SampleStreams, Vectors};
use whitstone_core::{
    Aabb, Context, DVec3, Light, LightBounds, LightFlags, LightSample, Lights, Plugin, Rgb, SceneErrors,
};

/// A point light that emits equally in all directions.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// Position in metres.
    position: Vector3,
    /// Radiant intensity in W/sr.
    intensity: Color,
    /// Falloff of the irradiance with the distance d: "inverse_square" (I/d²), or "none": then
    /// `intensity` is the irradiance itself, in W/m², at any distance.
    #[serde(default)]
    falloff: Falloff,
}

/// The `point` light; see the module documentation.
pub struct Point {
    position: DVec3,
    intensity: Rgb,
    falloff: Falloff,
}

impl Plugin<Lights> for Point {
    const TYPE: &'static str = "point";
    type Config = Config;

    fn build(config: Config, (): (), _: &mut dyn Context) -> Result<Arc<dyn Light>, SceneErrors> {
        Ok(Arc::new(Self {
            position: config.position.get(),
            intensity: config.intensity.get(),
            falloff: config.falloff,
        }))
    }
}

impl Light for Point {
    fn flags(&self) -> LightFlags {
        LightFlags::SAMPLES
    }

    fn samples(&self, point: DVec3, out: &mut Vec<LightSample>) {
        out.extend(emission::sample(
            self.position,
            point,
            self.intensity,
            self.falloff,
        ));
    }

    fn samples_stream(&self, len: usize, points: &Vectors, out: &mut SampleStreams) {
        emission::sample_stream(self.position, len, points, self.intensity, self.falloff, out);
    }

    fn affects_bounds(&self, _: &Aabb) -> bool {
        !self.intensity.is_black()
    }

    fn bounds(&self) -> Option<LightBounds> {
        emission::bounds(&[self.position], self.intensity.max_component(), self.falloff)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use whitstone_testkit::{build, light_near_laws};

    whitstone_testkit::light_laws!(
        Point,
        "position = [0.5, 2, -1]\nintensity = [1, 0, 7]\nfalloff = \"none\"",
        "position = [0.5, 2, -1]\nintensity = [1, 0, 7]",
        "position = [-9.0..9, 0, 1e-3]\nintensity = [0.0..1e6, 1, 0]",
    );

    #[test]
    fn the_inverse_square_holds_near_and_far() {
        let light = build::<Lights, Point>("position = [0, 0, 0]\nintensity = 3", ()).unwrap();
        light_near_laws(&*light, DVec3::ZERO, Rgb::splat(3.0), DVec3::new(0.6, 0.0, 0.8));
    }

    #[test]
    fn it_falls_off_or_does_not() {
        let irradiance = |falloff| {
            let text = format!("position = [0, 4, 0]\nintensity = [16, 32, 0]\nfalloff = \"{falloff}\"");
            let mut samples = Vec::new();
            build::<Lights, Point>(&text, ())
                .unwrap()
                .samples(DVec3::ZERO, &mut samples);
            assert_eq!((samples[0].direction, samples[0].distance), (DVec3::Y, 4.0));
            samples[0].irradiance
        };
        assert_eq!(irradiance("inverse_square"), Rgb::new(1.0, 2.0, 0.0));
        assert_eq!(irradiance("none"), Rgb::new(16.0, 32.0, 0.0));
    }

    #[test]
    fn bounds_are_the_position_and_the_largest_channel() {
        let light = |intensity: &str, falloff: &str| {
            let text = format!("position = [1, 2, 3]\nintensity = {intensity}\nfalloff = \"{falloff}\"");
            build::<Lights, Point>(&text, ()).unwrap()
        };
        let bounds = light("[1, 5, 2]", "inverse_square").bounds().unwrap();
        let position = DVec3::new(1.0, 2.0, 3.0);
        assert_eq!((bounds.bounds.min, bounds.bounds.max), (position, position));
        assert_eq!(bounds.max_intensity, 5.0);
        assert!(light("1", "none").bounds().is_none());
        let affects = |intensity| light(intensity, "none").affects_bounds(&Aabb::EVERYTHING);
        assert_eq!((affects("0"), affects("1")), (false, true));
    }

    #[test]
    fn bad_values_are_refused() {
        for text in [
            "position = [0, inf, 0]\nintensity = 1",
            "position = [0, 0, 0]\nintensity = -1",
            "position = [0, 0, 0]",
            "position = [0, 0, 0]\nintensity = 1\nfalloff = \"linear\"",
        ] {
            assert!(build::<Lights, Point>(text, ()).is_err(), "{text}");
        }
    }
}
