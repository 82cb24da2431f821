//! A camera with the equidistant projection: distances from the image centre are proportional to
//! angles.
//!
//! - Twin: none; the tests check the angles of rays.
//! - Example: `scenes/fisheye.toml`.

use schemars::JsonSchema;
use serde::Deserialize;
use whitstone_core::config::{Positive, Vector3};
use whitstone_core::{
    Camera, Cameras, Context, DVec2, DVec3, FilmSize, Plugin, Ray, SceneError, SceneErrors,
};

/// A camera with the equidistant projection, for angles of view up to 360 degrees.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// Position of the camera in metres.
    origin: Vector3,
    /// The point in the middle of the image.
    target: Vector3,
    /// Up direction.
    #[serde(default = "y")]
    up: Vector3,
    /// Angle across the longer side of the image, in degrees. Beyond 360, directions repeat.
    #[serde(default = "half_turn")]
    fov: Positive,
}

fn y() -> Vector3 {
    Vector3::new(0.0, 1.0, 0.0)
}

fn half_turn() -> Positive {
    Positive::new(180.0).expect("180 is positive")
}

/// The camera in world space.
pub struct Fisheye {
    origin: DVec3,
    right: DVec3,
    up: DVec3,
    forward: DVec3,
    middle: DVec2,
    /// Radians per pixel.
    angle: f64,
}

impl Plugin<Cameras> for Fisheye {
    const TYPE: &'static str = "fisheye";
    type Config = Config;

    fn build(config: Config, film: FilmSize, _: &mut dyn Context) -> Result<Box<dyn Camera>, SceneErrors> {
        let origin = config.origin.get();
        let forward = (config.target.get() - origin).normalize_or_zero();
        let Some(right) = forward.cross(config.up.get()).try_normalize() else {
            let message =
                "expected a target that differs from the origin and does not lie along the up direction";
            return Err(SceneError::anywhere(message).into());
        };
        let size = DVec2::new(f64::from(film.width), f64::from(film.height));
        Ok(Box::new(Self {
            origin,
            right,
            up: right.cross(forward),
            forward,
            middle: 0.5 * size,
            angle: config.fov.get().to_radians() / size.max_element(),
        }))
    }
}

impl Camera for Fisheye {
    fn ray(&self, raster: DVec2) -> Ray {
        let from_middle = raster - self.middle;
        let distance = from_middle.length();
        let (sine, cosine) = (self.angle * distance).sin_cos();
        // The exact centre has no direction to the side.
        let sideways = if distance > 0.0 {
            from_middle * (sine / distance)
        } else {
            DVec2::ZERO
        };
        let direction = cosine * self.forward + sideways.x * self.right - sideways.y * self.up;
        Ray::new(self.origin, direction.normalize())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use whitstone_testkit::build;

    whitstone_testkit::camera_laws!(
        Fisheye,
        "origin = [1, 2, 3]\ntarget = [0, 0, 0]",
        "origin = [0, 0, 5]\ntarget = [0, -3.0..3, 0]\nfov = 1.0..360",
    );

    #[test]
    fn distances_are_angles() {
        let film = FilmSize {
            width: 200,
            height: 100,
        };
        let camera = build::<Cameras, Fisheye>("origin = [0, 0, 0]\ntarget = [0, 0, -1]", film).unwrap();
        let at = |x: f64, y: f64| camera.ray(DVec2::new(x, y)).direction;
        assert_eq!(at(100.0, 50.0), DVec3::NEG_Z);
        assert!((at(200.0, 50.0) - DVec3::X).length() < 1e-15);
        let half = 0.5_f64.sqrt();
        assert!((at(100.0, 0.0) - DVec3::new(0.0, half, -half)).length() < 1e-15);
    }

    #[test]
    fn the_up_direction_must_not_be_forward() {
        let film = FilmSize { width: 2, height: 2 };
        assert!(build::<Cameras, Fisheye>("origin = [0, 0, 0]\ntarget = [0, 1, 0]", film).is_err());
    }
}
