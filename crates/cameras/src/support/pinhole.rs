//! Shared code of the perspective cameras: the window through which the image is seen.
//!
//! The window (l, r, b, t, d) is that of the lecture notes. Beyond 90 degrees, the tangent of half
//! the angle of view is computed from the complement: 180 - fov is exact, and the tangent is
//! accurate for small angles but not near 90 degrees.

use crate::support::view::{self, Frame};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use toml::Spanned;
use whitstone_core::config::{Finite, Positive};
use whitstone_core::{DMat4, DVec2, DVec3, FilmSize, SceneError, SceneErrors};

/// The side of the image that an angle of view spans.
#[derive(Clone, Copy, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub(crate) enum FovAxis {
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
pub(crate) struct Window {
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

/// The keys that define the visible part of the world.
pub(crate) struct Keys {
    pub(crate) fov: Option<Spanned<Finite>>,
    pub(crate) fov_axis: Option<Spanned<FovAxis>>,
    pub(crate) window: Option<Spanned<Window>>,
}

/// Window and distance in a unit of length, a power of two, that brings them near 1. Only ratios
/// matter.
pub(crate) struct Pinhole {
    pub(crate) window: view::Window,
    pub(crate) distance: f64,
    film: DVec2,
}

impl Pinhole {
    /// Creates the pinhole from the keys, or returns all errors in them.
    pub(crate) fn new(keys: Keys, film: FilmSize) -> Result<Self, SceneErrors> {
        let mut errors = SceneErrors::default();
        let fov = keys.fov.as_ref().map_or(45.0, |fov| fov.get_ref().get());
        if let Some(place) = &keys.fov
            && !(fov > 0.0 && fov < 180.0)
        {
            let message = format!("expected an angle greater than 0 and less than 180 degrees, found {fov}");
            errors.0.push(SceneError::at(place.span(), message));
        }
        let view = match &keys.window {
            None => {
                let axis = keys.fov_axis.map_or(FovAxis::X, Spanned::into_inner);
                Some((window_of_fov(fov, axis, film), 1.0))
            }
            Some(window) => {
                for (key, place) in [
                    ("fov", keys.fov.as_ref().map(Spanned::span)),
                    ("fov_axis", keys.fov_axis.as_ref().map(Spanned::span)),
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
        let Some((window, distance)) = view else {
            return Err(errors);
        };
        errors.into_result(Self {
            window,
            distance,
            film: view::extent(film),
        })
    }

    /// Vector from the camera to the point of the window at a raster position.
    #[inline(always)]
    pub(crate) fn through(&self, frame: &Frame, raster: DVec2) -> DVec3 {
        let DVec2 { x: a, y: c } = self.window.at(raster, self.film);
        a * frame.right + c * frame.up - self.distance * frame.backwards
    }

    /// See [`whitstone_core::Camera::projection`].
    pub(crate) fn projection(&self, frame: &Frame) -> DMat4 {
        view::projection(frame, &self.window, Some(self.distance), self.film)
    }

    /// The size of the film.
    pub(crate) fn film(&self) -> DVec2 {
        self.film
    }
}

/// The window at distance 1.
fn window_of_fov(fov: f64, axis: FovAxis, film: FilmSize) -> view::Window {
    let half = if fov > 90.0 {
        1.0 / libm::tan((0.5 * (180.0 - fov)).to_radians())
    } else {
        libm::tan((0.5 * fov).to_radians())
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

/// Window and distance in a unit in which their squares neither overflow nor underflow.
fn scaled(w: view::Window, distance: f64) -> (view::Window, f64) {
    let largest = [w.l, w.r, w.b, w.t, distance]
        .into_iter()
        .fold(0.0, |m: f64, x| m.max(x.abs()));
    let unit = libm::log2(largest).floor().clamp(-1000.0, 1000.0);
    let factor = libm::exp2(-unit);
    let window = view::Window {
        l: w.l * factor,
        r: w.r * factor,
        b: w.b * factor,
        t: w.t * factor,
    };
    // The distance stays positive even if it underflows in this unit.
    (window, (distance * factor).max(f64::MIN_POSITIVE))
}

/// A unit vector even where the squares of the components underflow or overflow.
#[inline(always)]
pub(crate) fn normalize(v: DVec3) -> DVec3 {
    let squared = v.length_squared();
    let scaled = if (squared > 1e-280) & (squared < 1e280) {
        v
    } else {
        v / v.abs().max_element()
    };
    scaled / scaled.length()
}

#[cfg(test)]
mod tests {
    use super::*;
    use whitstone_testkit::Random;

    #[test]
    fn the_unit_of_a_window_changes_no_ratio() {
        let window = view::Window {
            l: -3.0,
            r: 1.0,
            b: -0.5,
            t: 2.0,
        };
        for distance in [6.0, 1e-3, 1e300] {
            let (found, unit) = scaled(window, distance);
            let edges = [found.l, found.r, found.b, found.t];
            assert!(unit > 0.0 && edges.iter().all(|edge| edge.abs() < 2.0 && unit < 2.0));
            // By a power of two, so that nothing is rounded.
            let factor = unit / distance;
            assert_eq!(
                edges,
                [-3.0, 1.0, -0.5, 2.0].map(|edge| edge * factor),
                "{distance}"
            );
        }
    }

    #[test]
    fn vectors_of_any_length_have_a_direction() {
        let mut random = Random::new(1);
        for _ in 0..100 {
            let v = random.cube() - 0.5;
            // Those of usual length without another rounding.
            assert_eq!(normalize(v), v / v.length());
            for scale in [1e-300, 1e-160, 1e160, 1e300] {
                assert!((normalize(v * scale) - normalize(v)).length() < 1e-15, "{scale}");
            }
        }
    }
}
