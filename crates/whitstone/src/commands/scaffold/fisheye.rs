//! A camera with the equidistant projection: distances from the image centre are proportional to
//! angles.
//!
//! - Twin: none; the tests check the angles of rays.
//! - Example: `scenes/fisheye.toml`.

use schemars::JsonSchema;
use serde::Deserialize;
use toml::Spanned;
use whitstone_core::config::{Finite, Vector3};
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
    #[schemars(with = "Vector3")]
    target: Spanned<Vector3>,
    /// Up direction; +y if omitted.
    #[serde(default = "y")]
    up: Vector3,
    /// Angle across the longer side of the image, in degrees, greater than 0 and at most 360; 180
    /// if omitted.
    #[serde(default)]
    #[schemars(with = "Option<f64>")]
    fov: Option<Spanned<Finite>>,
}

fn y() -> Vector3 {
    Vector3::new(0.0, 1.0, 0.0)
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
        let mut errors = SceneErrors::default();
        let fov = config.fov.as_ref().map_or(180.0, |fov| fov.get_ref().get());
        if let Some(written) = config.fov.filter(|_| !(fov > 0.0 && fov <= 360.0)) {
            let message = format!("expected a fov above 0 and up to 360 degrees, found {fov}");
            errors.0.push(SceneError::at(written.span(), message));
        }
        let origin = config.origin.get();
        let forward = (config.target.get_ref().get() - origin).try_normalize();
        let right = forward.and_then(|forward| forward.cross(config.up.get()).try_normalize());
        if right.is_none() {
            let message =
                "expected a target that differs from the origin and does not lie along the up direction";
            errors.0.push(SceneError::at(config.target.span(), message));
        }
        let (forward, right) = (forward.unwrap_or(DVec3::NEG_Z), right.unwrap_or(DVec3::X));
        let size = DVec2::new(f64::from(film.width), f64::from(film.height));
        errors.into_result(Box::new(Self {
            origin,
            right,
            up: right.cross(forward),
            forward,
            middle: 0.5 * size,
            angle: fov.to_radians() / size.max_element(),
        }) as Box<dyn Camera>)
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
    fn both_errors_are_reported() {
        let film = FilmSize { width: 2, height: 2 };
        let errors = build::<Cameras, Fisheye>("origin = [0, 0, 0]\ntarget = [0, 1, 0]\nfov = 0", film);
        assert_eq!(errors.err().unwrap().0.len(), 2);
    }
}
