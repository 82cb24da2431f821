//! An omnidirectional camera: longitude along the width of the image, latitude along its height.
//!
//! The equirectangular (latitude-longitude) projection of environment maps (Blinn and Newell,
//! *Texture and reflection in computer generated images*, 1976). Near the poles, a pixel covers a
//! smaller solid angle.
//!
//! - Twin: a formula of the Mitsuba driver.
//! - Example: `scenes/cameras/environment.toml`.

use crate::support::view::{self, Frame, LookAt};
use schemars::JsonSchema;
use serde::Deserialize;
use std::f64::consts::{FRAC_PI_2, PI};
use toml::Spanned;
use whitstone_core::{Camera, Cameras, Context, DVec2, FilmSize, Plugin, Ray, SceneErrors};

/// An omnidirectional camera: longitude along the width of the image, latitude along its height.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// Position of the camera, the point in the middle of the image and the up direction.
    #[schemars(with = "LookAt")]
    look_at: Spanned<LookAt>,
}

/// The `environment` camera, in world space.
pub struct Environment {
    frame: Frame,
    film: DVec2,
}

impl Plugin<Cameras> for Environment {
    const TYPE: &'static str = "environment";
    type Config = Config;

    fn build(config: Config, film: FilmSize, _: &mut dyn Context) -> Result<Box<dyn Camera>, SceneErrors> {
        let frame = config.look_at.get_ref().frame(&config.look_at.span())?;
        let film = view::extent(film);
        Ok(Box::new(Self { frame, film }))
    }
}

impl Camera for Environment {
    fn ray(&self, raster: DVec2) -> Ray {
        // Computed from the distances to both edges, so that a symmetrical scene gives a bitwise
        // symmetrical image.
        let from_middle = (raster - (self.film - raster)) / self.film;
        let (sin_phi, cos_phi) = libm::sincos(PI * from_middle.x);
        let (sin_theta, cos_theta) = libm::sincos(-FRAC_PI_2 * from_middle.y);
        let Frame {
            origin,
            right,
            up,
            backwards,
        } = self.frame;
        let level = sin_phi * right - cos_phi * backwards;
        Ray::new(origin, cos_theta * level + sin_theta * up)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use whitstone_core::DVec3;
    use whitstone_testkit::{build, camera_laws};

    const FILM: FilmSize = FilmSize { width: 8, height: 4 };

    fn camera(text: &str) -> Result<Box<dyn Camera>, SceneErrors> {
        build::<Cameras, Environment>(text, FILM)
    }

    #[test]
    fn laws() {
        for text in [
            "look_at = { origin = [0, 0, 0], target = [0, 0, -1] }",
            "look_at = { origin = [1e3, 2, -7], target = [3, 5, 8], up = [1, 1, 0] }",
        ] {
            camera_laws(&*camera(text).unwrap(), FILM);
        }
    }

    #[test]
    fn directions_are_those_of_the_model() {
        let camera = camera("look_at = { origin = [1, 2, 3], target = [1, 2, -5] }").unwrap();
        let half = std::f64::consts::FRAC_1_SQRT_2;
        for (raster, expected) in [
            ([4.0, 2.0], DVec3::NEG_Z),
            ([6.0, 2.0], DVec3::X),
            ([2.0, 2.0], DVec3::NEG_X),
            ([0.0, 2.0], DVec3::Z),
            ([8.0, 2.0], DVec3::Z),
            ([3.0, 0.0], DVec3::Y),
            ([5.0, 4.0], DVec3::NEG_Y),
            ([6.0, 1.0], DVec3::new(half, half, 0.0)),
        ] {
            let ray = camera.ray(DVec2::from(raster));
            assert_eq!(ray.origin, DVec3::new(1.0, 2.0, 3.0));
            assert!((ray.direction - expected).length() < 1e-15, "{raster:?}: {ray:?}");
        }
    }

    #[test]
    fn a_view_without_a_direction_is_refused_at_its_place() {
        let text = "look_at = { origin = [0, 9, 0], target = [0, 0, 0] }";
        let errors = camera(text).err().unwrap();
        assert_eq!(errors.0[0].span, Some(10..text.len()));
        assert!(camera(&format!("{text}\nfov = 3")).is_err());
    }
}
