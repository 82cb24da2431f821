//! A pinhole camera.
//!
//! Whitted 1980, section 2; the window (l, r, b, t, d) is that of the lecture notes. The tangent of half
//! the angle of view is taken from the complement beyond 90 degrees: 180 - fov is exact, and the tangent
//! of a small angle is accurate where that of an angle near 90 degrees is not.
//!
//! - Twin: Mitsuba `perspective` (native).
//! - Example: `scenes/cameras/perspective.toml`.

use crate::view::{self, Frame, LookAt};
use schemars::JsonSchema;
use serde::Deserialize;
use toml::Spanned;
use whitstone_core::config::{Finite, Positive};
use whitstone_core::stream::{LANES, Lanes, RayStream};
use whitstone_core::{
    Camera, Cameras, Context, DMat4, DVec2, DVec3, FilmSize, Plugin, Ray, SceneError, SceneErrors, simd,
};

/// A pinhole camera, by its angle of view or by a window in front of it.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// Where the camera stands, what it looks at and what is up.
    #[schemars(with = "LookAt")]
    look_at: Spanned<LookAt>,
    /// Angle of view along `fov_axis`, in degrees between 0 and 180; 45 if there is no `window`.
    #[serde(default)]
    #[schemars(with = "Finite", extend("exclusiveMinimum" = 0, "exclusiveMaximum" = 180))]
    fov: Option<Spanned<Finite>>,
    /// The side of the image that `fov` spans; "x" if left out.
    #[serde(default)]
    #[schemars(with = "FovAxis")]
    fov_axis: Option<Spanned<FovAxis>>,
    /// The window through which the camera looks, instead of `fov`.
    #[serde(default)]
    #[schemars(with = "Window")]
    window: Option<Spanned<Window>>,
}

/// A side of the image.
#[derive(Clone, Copy, Debug, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
enum FovAxis {
    /// The width.
    X,
    /// The height.
    Y,
    /// The smaller of width and height.
    Smaller,
    /// The larger of width and height.
    Larger,
}

/// A rectangle at distance d in front of the camera, in metres.
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
    /// Distance from the camera.
    #[serde(default = "one")]
    d: Positive,
}

fn one() -> Positive {
    Positive::new(1.0).expect("1 is positive")
}

/// In world space.
pub struct Perspective {
    frame: Frame,
    window: view::Window,
    distance: f64,
    film: DVec2,
}

impl Plugin<Cameras> for Perspective {
    const TYPE: &'static str = "perspective";
    type Config = Config;

    fn build(config: Config, film: FilmSize, _: &mut dyn Context) -> Result<Box<dyn Camera>, SceneErrors> {
        let mut errors = SceneErrors::default();
        let frame = errors.take(config.look_at.get_ref().frame(&config.look_at.span()));
        let fov = config.fov.as_ref().map_or(45.0, |fov| fov.get_ref().get());
        if let Some(place) = &config.fov
            && !(fov > 0.0 && fov < 180.0)
        {
            let message = format!("expected an angle greater than 0 and less than 180 degrees, found {fov}");
            errors.0.push(SceneError::at(place.span(), message));
        }
        let view = match &config.window {
            None => Some((
                window_of_fov(fov, config.fov_axis.map_or(FovAxis::X, Spanned::into_inner), film),
                1.0,
            )),
            Some(window) => {
                for (key, place) in [
                    ("fov", config.fov.as_ref().map(Spanned::span)),
                    ("fov_axis", config.fov_axis.as_ref().map(Spanned::span)),
                ] {
                    if let Some(place) = place {
                        let message = format!("`{key}` and `window` exclude each other");
                        errors
                            .0
                            .push(SceneError::at(place, message).with_help("remove one of them"));
                    }
                }
                let Window { l, r, b, t, d } = window.get_ref();
                let [l, r, b, t] = [l, r, b, t].map(|value| value.get());
                let checked = view::Window { l, r, b, t }.check(&window.span());
                errors.take(checked).map(|window| scaled(window, d.get()))
            }
        };
        let (Some(frame), Some((window, distance))) = (frame, view) else {
            return Err(errors);
        };
        errors.into_result(Box::new(Self {
            frame,
            window,
            distance,
            film: view::extent(film),
        }))
    }
}

/// The window at distance 1.
fn window_of_fov(fov: f64, axis: FovAxis, film: FilmSize) -> view::Window {
    let half = if fov > 90.0 {
        1.0 / (0.5 * (180.0 - fov)).to_radians().tan()
    } else {
        (0.5 * fov).to_radians().tan()
    };
    let along_x = match axis {
        FovAxis::X => true,
        FovAxis::Y => false,
        FovAxis::Smaller => film.width <= film.height,
        FovAxis::Larger => film.width >= film.height,
    };
    if along_x {
        view::Window::of_half_width(half, film)
    } else {
        view::Window::of_half_height(half, film)
    }
}

/// Window and distance in a unit, a power of two, in which their sizes are near 1, so that directions
/// can be normalised. Only the ratios matter.
fn scaled(w: view::Window, distance: f64) -> (view::Window, f64) {
    let largest = [w.l, w.r, w.b, w.t, distance]
        .into_iter()
        .fold(0.0, |m: f64, x| m.max(x.abs()));
    let unit = largest.log2().floor().clamp(-1000.0, 1000.0);
    let factor = (-unit).exp2();
    let window = view::Window {
        l: w.l * factor,
        r: w.r * factor,
        b: w.b * factor,
        t: w.t * factor,
    };
    // A distance too small for this unit is still in front of the camera.
    (window, (distance * factor).max(f64::MIN_POSITIVE))
}

impl Camera for Perspective {
    #[inline(always)]
    fn ray(&self, raster: DVec2) -> Ray {
        let DVec2 { x: a, y: c } = self.window.at(raster, self.film);
        let Frame {
            origin,
            right,
            up,
            backwards,
        } = self.frame;
        let through = a * right + c * up - self.distance * backwards;
        Ray::new(origin, normalize(through))
    }

    fn ray_stream(&self, raster: &Lanes<DVec2>, rays: &mut RayStream) {
        simd::dispatch(
            #[inline(always)]
            || {
                for lane in 0..rays.len.min(LANES) {
                    let ray = self.ray(raster[lane]);
                    rays.origin.set(lane, ray.origin);
                    rays.direction.set(lane, ray.direction);
                }
            },
        );
    }

    fn projection(&self) -> Option<DMat4> {
        Some(view::projection(
            &self.frame,
            &self.window,
            Some(self.distance),
            self.film,
        ))
    }
}

/// A unit vector even where the squares of the components underflow.
#[inline(always)]
fn normalize(v: DVec3) -> DVec3 {
    let squared = v.length_squared();
    let scaled = if squared > 1e-280 {
        v
    } else {
        v / v.abs().max_element()
    };
    scaled / scaled.length()
}

#[cfg(test)]
mod tests {
    use super::*;
    use whitstone_testkit::{build, camera_laws};

    fn camera(text: &str, width: u32, height: u32) -> Result<Box<dyn Camera>, SceneErrors> {
        let film = FilmSize { width, height };
        build::<Cameras, Perspective>(&format!("{LOOK}\n{text}"), film)
    }

    const LOOK: &str = "look_at = { origin = [0, 0, 0], target = [0, 0, -1] }";

    fn slopes(camera: &dyn Camera, x: f64, y: f64) -> DVec2 {
        let d = camera.ray(DVec2::new(x, y)).direction;
        DVec2::new(d.x, d.y) / -d.z
    }

    #[test]
    fn laws() {
        for text in [
            "",
            "fov = 1e-3",
            "fov = 179.99\nfov_axis = \"y\"",
            "window = { l = -3, r = 1, b = 0, t = 1e-3, d = 2 }",
        ] {
            let camera = camera(text, 31, 47).unwrap();
            camera_laws(
                &*camera,
                FilmSize {
                    width: 31,
                    height: 47,
                },
            );
        }
    }

    #[test]
    fn the_angle_of_view_is_that_of_the_named_axis() {
        let edge = |axis: &str, width, height, x, y| {
            let text = format!("fov = 90\nfov_axis = \"{axis}\"");
            slopes(&*camera(&text, width, height).unwrap(), x, y)
        };
        let close = |a: DVec2, b: DVec2| assert!((a - b).length() < 1e-15, "{a} {b}");
        close(edge("x", 4, 2, 4.0, 1.0), DVec2::X);
        close(edge("x", 4, 2, 2.0, 0.0), 0.5 * DVec2::Y);
        close(edge("y", 4, 2, 2.0, 0.0), DVec2::Y);
        close(edge("smaller", 4, 2, 4.0, 1.0), 2.0 * DVec2::X);
        close(edge("smaller", 2, 4, 2.0, 2.0), DVec2::X);
        close(edge("larger", 4, 2, 0.0, 1.0), -DVec2::X);
        close(edge("larger", 2, 4, 1.0, 4.0), -DVec2::Y);
    }

    /// Tangents of fov/2 to 20 digits, computed with mpmath at 60 digits from the exact binary values
    /// of fov.
    #[test]
    fn extreme_angles_keep_full_accuracy() {
        for (fov, tangent) in TANGENTS {
            let camera = camera(&format!("fov = {fov:?}"), 2, 2).unwrap();
            let found = slopes(&*camera, 2.0, 1.0).x;
            let pixels = (found / tangent - 1.0).abs() * 512.0;
            assert!(
                pixels < 1024.0 * f64::EPSILON,
                "fov {fov}: {found:e}, {pixels:e} px off"
            );
        }
    }

    const TANGENTS: [(f64, f64); 6] = [
        (0.001, 8.7266462601931721052e-6),
        (1.0, 0.0087268677907587893345),
        (45.0, 0.4142135623730950488),
        (90.0, 1.0),
        (120.0, 1.7320508075688772935),
        (179.99, 11459.155873538065336),
    ];

    #[test]
    fn huge_and_tiny_windows_give_unit_directions() {
        for text in [
            "window = { l = -1e308, r = 1e308, b = -1e308, t = 1e308, d = 1e-308 }",
            "window = { l = 0, r = 1e-320, b = 0, t = 1e-320, d = 5e-324 }",
            "window = { l = -1e-200, r = 1, b = 0, t = 1, d = 1e-200 }",
        ] {
            let camera = camera(text, 4, 4).unwrap();
            for raster in [DVec2::ZERO, DVec2::new(0.0, 4.0), DVec2::splat(2.0)] {
                let length = camera.ray(raster).direction.length();
                assert!((length - 1.0).abs() < 1e-15, "{text}: {length}");
            }
        }
    }

    #[test]
    fn all_faults_are_reported_at_their_places() {
        let text = "look_at = { origin = [1, 2, 3], target = [1, 2, 3] }\n\
            fov = 180\nfov_axis = \"y\"\nwindow = { l = 1, r = 1, b = 2, t = -2 }\n";
        let film = FilmSize { width: 2, height: 2 };
        let errors = build::<Cameras, Perspective>(text, film).err().unwrap();
        let found: Vec<&str> = errors.0.iter().map(|e| &text[e.span.clone().unwrap()]).collect();
        let window = "{ l = 1, r = 1, b = 2, t = -2 }";
        assert_eq!(found, ["[1, 2, 3]", "180", "180", "\"y\"", window, window]);
        for fov in ["0", "-1", "180", "1e300"] {
            assert!(camera(&format!("fov = {fov}"), 2, 2).is_err());
        }
        assert!(camera("fovaxis = \"x\"", 2, 2).is_err());
    }
}
