//! An orthographic camera.
//!
//! The window (l, r, b, t) and the near limit are those of the lecture notes. Unlike that of
//! `perspective`, the window has no distance `d`.
//!
//! - Twin: Mitsuba `orthographic` (native); a formula if `near` is not 0.
//! - Example: `scenes/cameras/orthographic.toml`.

use crate::support::view::{self, Frame, LookAt};
use schemars::JsonSchema;
use serde::Deserialize;
use toml::Spanned;
use whitstone_core::config::{Finite, Positive};
use whitstone_core::{
    Camera, Cameras, Context, DMat4, DVec2, FilmSize, Plugin, Ray, SceneError, SceneErrors,
};

/// An orthographic camera, defined by its width or by a window.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// Position of the camera, the point it looks at and the up direction.
    #[schemars(with = "LookAt")]
    look_at: Spanned<LookAt>,
    /// Width of the view in metres.
    #[serde(default)]
    #[schemars(extend("x-default" = "2 without `window`"), with = "Positive")]
    width: Option<Spanned<Positive>>,
    /// Window in the plane of the camera; replaces `width`.
    #[serde(default)]
    #[schemars(extend("x-default" = "none"), with = "Window")]
    window: Option<Spanned<Window>>,
    /// Near limit: distance in front of the plane of the camera, in metres. Nearer surfaces are
    /// invisible. A negative limit lies behind the camera.
    #[serde(default = "zero")]
    near: Finite,
}

fn zero() -> Finite {
    Finite::new(0.0).expect("0 is finite")
}

/// A rectangle in the plane of the camera, in metres.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
struct Window {
    /// Left edge, measured to the right from the view axis.
    l: Finite,
    /// Right edge, greater than `l`.
    r: Finite,
    /// Bottom edge, measured upwards from the view axis.
    b: Finite,
    /// Top edge, greater than `b`.
    t: Finite,
}

/// The `orthographic` camera, in world space.
pub struct Orthographic {
    frame: Frame,
    window: view::Window,
    film: DVec2,
    near: f64,
}

impl Plugin<Cameras> for Orthographic {
    const TYPE: &'static str = "orthographic";
    type Config = Config;

    fn build(config: Config, film: FilmSize, _: &mut dyn Context) -> Result<Box<dyn Camera>, SceneErrors> {
        let mut errors = SceneErrors::default();
        let frame = errors.take(config.look_at.get_ref().frame(&config.look_at.span()));
        let window = match (&config.window, &config.width) {
            (None, width) => {
                let width = width.as_ref().map_or(2.0, |width| width.get_ref().get());
                Some(view::Window::of_half_width(0.5 * width, film))
            }
            (Some(window), width) => {
                if let Some(width) = width {
                    let error = SceneError::at(width.span(), "`width` and `window` exclude each other");
                    errors.0.push(error.with_help("remove one of them"));
                }
                let Window { l, r, b, t } = window.get_ref();
                let [l, r, b, t] = [l, r, b, t].map(|value| value.get());
                errors.take(view::Window { l, r, b, t }.check(&window.span()))
            }
        };
        let (Some(frame), Some(window)) = (frame, window) else {
            return Err(errors);
        };
        errors.into_result(Box::new(Self {
            frame,
            window,
            film: view::extent(film),
            near: config.near.get(),
        }))
    }
}

impl Camera for Orthographic {
    fn ray(&self, raster: DVec2) -> Ray {
        let DVec2 { x: a, y: c } = self.window.at(raster, self.film);
        let Frame {
            origin,
            right,
            up,
            backwards,
        } = self.frame;
        let on_plane = origin + a * right + c * up;
        Ray::new(on_plane - self.near * backwards, -backwards)
    }

    fn near(&self, _: DVec2) -> f64 {
        self.near
    }

    fn projection(&self) -> Option<DMat4> {
        Some(view::projection(&self.frame, &self.window, None, self.film))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use whitstone_core::DVec3;
    use whitstone_testkit::{build, camera_laws};

    const FILM: FilmSize = FilmSize { width: 4, height: 2 };
    const LOOK: &str = "look_at = { origin = [1, 2, 3], target = [1, 2, -1] }";

    fn camera(text: &str) -> Result<Box<dyn Camera>, SceneErrors> {
        build::<Cameras, Orthographic>(&format!("{LOOK}\n{text}"), FILM)
    }

    #[test]
    fn laws() {
        for text in [
            "",
            "width = 1e-6",
            "window = { l = -3, r = 1, b = 0, t = 1 }",
            "near = 2.5",
            "near = -2.5",
        ] {
            let camera = camera(text).unwrap();
            camera_laws(&*camera, FILM);
            assert!(camera.projection().is_some());
        }
    }

    #[test]
    fn rays_are_parallel_and_start_in_the_window() {
        let ray = camera("width = 8").unwrap().ray(DVec2::ZERO);
        assert_eq!(ray, Ray::new(DVec3::new(-3.0, 4.0, 3.0), DVec3::NEG_Z));
        let ray = camera("window = { l = 0, r = 1, b = 0, t = 6 }")
            .unwrap()
            .ray(DVec2::new(4.0, 1.0));
        assert_eq!(ray, Ray::new(DVec3::new(2.0, 5.0, 3.0), DVec3::NEG_Z));
    }

    #[test]
    fn rays_start_at_the_near_limit() {
        let camera = camera("width = 8\nnear = 2.5").unwrap();
        assert_eq!(
            camera.ray(DVec2::ZERO),
            Ray::new(DVec3::new(-3.0, 4.0, 0.5), DVec3::NEG_Z)
        );
        assert_eq!(camera.near(DVec2::ZERO), 2.5);
    }

    #[test]
    fn faults_are_reported_at_their_places() {
        let text = "look_at = { origin = [0, 9, 0], target = [0, 0, 0] }\nwidth = 3\n\
            window = { l = 1, r = 0, b = 0, t = 1 }\n";
        let errors = build::<Cameras, Orthographic>(text, FILM).err().unwrap();
        let found: Vec<&str> = errors.0.iter().map(|e| &text[e.span.clone().unwrap()]).collect();
        let look = "{ origin = [0, 9, 0], target = [0, 0, 0] }";
        assert_eq!(found, [look, "3", "{ l = 1, r = 0, b = 0, t = 1 }"]);
        assert!(camera("width = 0").is_err());
        assert!(camera("near = nan").is_err());
    }
}
