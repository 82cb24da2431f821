//! Shared code of the cameras: the frame defined by `look_at`, and windows.

use schemars::JsonSchema;
use serde::Deserialize;
use toml::Spanned;
use whitstone_core::config::Vector3;
use whitstone_core::{DMat4, DVec2, DVec3, DVec4, FilmSize, SceneError, SceneErrors, SourceSpan};

/// Position of the camera, the point it looks at and the up direction.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(crate) struct LookAt {
    /// Position of the camera, in metres.
    origin: Vector3,
    /// A point on the view axis in front of the camera, in metres; must differ from the origin.
    #[schemars(with = "Vector3")]
    target: Spanned<Vector3>,
    /// Direction that is up in the image, of any length and not parallel to the view.
    #[serde(default)]
    #[schemars(extend("default" = [0, 1, 0]), with = "Vector3")]
    up: Option<Spanned<Vector3>>,
}

/// Position of a camera and its axes.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Frame {
    pub(crate) origin: DVec3,
    /// Unit vector to the right in the image.
    pub(crate) right: DVec3,
    /// Unit vector up in the image.
    pub(crate) up: DVec3,
    /// Unit vector opposite to the view direction.
    pub(crate) backwards: DVec3,
}

impl Frame {
    /// Rows of the matrix that maps a point (x, y, z, 1) to its distances to the right, up and in
    /// front of the camera.
    fn rows(&self) -> [DVec4; 3] {
        [self.right, self.up, -self.backwards].map(|axis| axis.extend(-axis.dot(self.origin)))
    }
}

impl LookAt {
    /// The frame, or the errors that prevent it. `place` is the span of the whole `look_at` table.
    pub(crate) fn frame(&self, place: &SourceSpan) -> Result<Frame, SceneErrors> {
        let (origin, target) = (self.origin.get(), self.target.get_ref().get());
        if origin == target {
            return Err(SceneError::at(self.target.span(), "`target` equals `origin`")
                .with_help("the camera looks from `origin` to `target`: move one of them")
                .into());
        }
        // The difference of huge coordinates may overflow; that of their halves does not.
        let difference = origin - target;
        let difference = if difference.is_finite() {
            difference
        } else {
            0.5 * origin - 0.5 * target
        };
        // Scaled by their largest components, so that squares neither overflow nor underflow.
        let back = difference / difference.abs().max_element();
        let up = self.up.as_ref().map_or(DVec3::Y, |up| up.get_ref().get());
        let up_place = self.up.as_ref().map_or_else(|| place.clone(), Spanned::span);
        let largest = up.abs().max_element();
        if largest == 0.0 {
            return Err(
                SceneError::at(up_place, "`up` has no direction: all its components are zero").into(),
            );
        }
        let up = up / largest;
        let backwards = back.normalize();
        if up.cross(backwards).length() <= 1e-12 * up.length() {
            let help = match backwards.z.abs() < 0.9 {
                true => "give another `up`, such as [0, 0, 1] for a view straight down",
                false => "give another `up`, such as [0, 1, 0] for a view along z",
            };
            return Err(SceneError::at(up_place, "`up` is parallel to the view")
                .with_help(help)
                .into());
        }
        // If `up` is nearly parallel to the view, its products cancel. They must be accurate, and
        // the component along the view that rounding of the factors leaves is removed.
        let right = accurate_cross(up, back).normalize();
        let right = (right - right.dot(backwards) * backwards).normalize();
        Ok(Frame {
            origin,
            right,
            up: backwards.cross(right),
            backwards,
        })
    }
}

/// The cross product to about two roundings per component, regardless of cancellation: Kahan's
/// difference of products with fused multiply-add (Jeannerod, Louvet, Muller 2013).
fn accurate_cross(a: DVec3, b: DVec3) -> DVec3 {
    let difference = |p: f64, q: f64, r: f64, s: f64| {
        let rs = r * s;
        let error = (-r).mul_add(s, rs);
        p.mul_add(q, -rs) + error
    };
    DVec3::new(
        difference(a.y, b.z, a.z, b.y),
        difference(a.z, b.x, a.x, b.z),
        difference(a.x, b.y, a.y, b.x),
    )
}

/// The part of a plane perpendicular to the view that the image shows: left, right, bottom and top.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Window {
    pub(crate) l: f64,
    pub(crate) r: f64,
    pub(crate) b: f64,
    pub(crate) t: f64,
}

impl Window {
    /// A centred window with square pixels, given half its width.
    pub(crate) fn of_half_width(half: f64, film: FilmSize) -> Self {
        let half_height = half * f64::from(film.height) / f64::from(film.width);
        Self {
            l: -half,
            r: half,
            b: -half_height,
            t: half_height,
        }
    }

    /// A centred window with square pixels, given half its height.
    pub(crate) fn of_half_height(half: f64, film: FilmSize) -> Self {
        let half_width = half * f64::from(film.width) / f64::from(film.height);
        Self {
            l: -half_width,
            r: half_width,
            b: -half,
            t: half,
        }
    }

    /// Returns the window if it has an area, otherwise all errors.
    pub(crate) fn check(self, place: &SourceSpan) -> Result<Self, SceneErrors> {
        let mut errors = SceneErrors::default();
        for (low, a, high, b) in [("l", self.l, "r", self.r), ("b", self.b, "t", self.t)] {
            if a >= b {
                let message = format!("expected {low} < {high}, found {low} = {a} and {high} = {b}");
                errors.0.push(SceneError::at(place.clone(), message));
            }
        }
        errors.into_result(self)
    }

    /// The point (a, c) of the window at a raster position. It interpolates between the edges
    /// instead of adding steps to one edge, so that the edges are exact and a symmetrical scene
    /// gives a bitwise symmetrical image.
    #[inline(always)]
    pub(crate) fn at(&self, raster: DVec2, film: DVec2) -> DVec2 {
        let (near, far) = (raster / film, (film - raster) / film);
        DVec2::new(self.l * far.x + self.r * near.x, self.t * far.y + self.b * near.y)
    }
}

/// The projection to a window at `distance` in front of the camera; orthographic if that is `None`.
pub(crate) fn projection(frame: &Frame, window: &Window, distance: Option<f64>, film: DVec2) -> DMat4 {
    let Window { l, r, b, t } = *window;
    let [right, up, depth] = frame.rows();
    // By similar triangles, an offset at `depth` appears on the window scaled by `distance` over
    // `depth`.
    let (w, scale) = distance.map_or((DVec4::W, 1.0), |distance| (depth, distance));
    let x = film.x / (r - l) * (scale * right - l * w);
    let y = film.y / (t - b) * (t * w - scale * up);
    DMat4::from_cols(x, y, depth, w).transpose()
}

/// The size of the film in pixels.
pub(crate) fn extent(film: FilmSize) -> DVec2 {
    DVec2::new(f64::from(film.width), f64::from(film.height))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn look_at(origin: [f64; 3], target: [f64; 3], up: [f64; 3]) -> Result<Frame, SceneErrors> {
        let vector = |[x, y, z]: [f64; 3]| Vector3::new(x, y, z);
        let target = Spanned::new(1..2, vector(target));
        let up = Some(Spanned::new(3..4, vector(up)));
        LookAt {
            origin: vector(origin),
            target,
            up,
        }
        .frame(&(0..9))
    }

    #[test]
    fn a_cross_product_that_cancels_is_accurate() {
        // (1 + e)² - (1 + 2 e) = e², which no sum of rounded products keeps.
        let e = 2f64.powi(-27);
        let a = DVec3::new(1.0 + e, 1.0, 0.0);
        let b = DVec3::new(1.0 + 2.0 * e, 1.0 + e, 0.0);
        assert_eq!(accurate_cross(a, b), DVec3::new(0.0, 0.0, e * e));
        // Here the second product is rounded, and its error counts.
        let e = 2f64.powi(-31);
        let a = DVec3::new(1.0 + 2.0 * e, 1.0 + e, 0.0);
        let b = DVec3::new(1.0 + 4.0 * e, 1.0 + 2.0 * e, 0.0);
        assert_eq!(accurate_cross(a, b), DVec3::new(0.0, 0.0, -e));
        assert_eq!(accurate_cross(DVec3::X, DVec3::Y), DVec3::Z);
    }

    #[test]
    fn pixels_of_a_centred_window_are_square() {
        let film = FilmSize { width: 6, height: 4 };
        let edges = |window: Window| [window.l, window.r, window.b, window.t];
        assert_eq!(edges(Window::of_half_height(0.5, film)), [-0.75, 0.75, -0.5, 0.5]);
        assert_eq!(edges(Window::of_half_width(0.75, film)), [-0.75, 0.75, -0.5, 0.5]);
    }

    #[test]
    fn a_difference_that_overflows_has_its_direction() {
        let frame = look_at([1.5e308; 3], [-1.5e308, -1e308, 1e308], [0.0, 1.0, 0.0]).unwrap();
        let expected = DVec3::new(3.0, 2.5, 0.5).normalize();
        assert!(
            (frame.backwards - expected).length() < 1e-15,
            "{}",
            frame.backwards
        );
    }

    #[test]
    fn the_frame_is_that_of_the_model() {
        let frame = look_at([0.0, 0.0, 5.0], [0.0; 3], [0.0, 2.0, 0.0]).unwrap();
        assert_eq!(
            (frame.right, frame.up, frame.backwards),
            (DVec3::X, DVec3::Y, DVec3::Z)
        );
    }

    #[test]
    fn frames_are_orthonormal_at_any_size_and_tilt() {
        for (origin, target, up) in [
            ([1e-300, 2e-300, 0.0], [0.0; 3], [0.0, 1e-300, 0.0]),
            ([1.5e308; 3], [-1.5e308, -1e308, 1e308], [0.0, 1e308, 0.0]),
            ([3.0, 1.0, 2.0], [0.0; 3], [3.0, 1.0, 2.0 + 1e-11]),
            ([0.1, 0.7, -0.3], [0.1, 0.6, -0.3], [1e-11, 1.0, 0.0]),
        ] {
            let Frame {
                right, up, backwards, ..
            } = look_at(origin, target, up).unwrap();
            for (a, b) in [(right, up), (up, backwards), (backwards, right)] {
                assert!(a.dot(b).abs() < 3e-16, "{a} {b}");
                assert!((a.length() - 1.0).abs() < 3e-16);
            }
            assert!(right.cross(up).dot(backwards) > 0.0);
        }
    }

    #[test]
    fn a_nearly_parallel_up_still_says_which_way_to_roll() {
        // Up lies 1e-10 off the view, towards z. All these numbers are exact.
        let tilt = f64::exp2(-33.0);
        let frame = look_at([1.0, 1.0, 0.0], [0.0; 3], [1.0, 1.0, tilt]).unwrap();
        assert!((frame.up - DVec3::Z).length() < 1e-9, "{}", frame.up);
    }

    #[test]
    fn views_without_a_direction_are_refused_at_their_place() {
        let refused = |origin, target, up| look_at(origin, target, up).unwrap_err().0[0].span.clone();
        assert_eq!(refused([1.0; 3], [1.0; 3], [0.0, 1.0, 0.0]), Some(1..2));
        assert_eq!(refused([1.0; 3], [0.0; 3], [0.0; 3]), Some(3..4));
        assert_eq!(refused([0.0, 3.0, 0.0], [0.0; 3], [0.0, -1e200, 0.0]), Some(3..4));
        assert_eq!(refused([0.0, 3.0, 0.0], [0.0; 3], [1e-13, 1.0, 0.0]), Some(3..4));
        // An angle of 0.6e-12.
        assert_eq!(refused([1.0; 3], [0.0; 3], [1.0, 1.0, 1.0 + 1.3e-12]), Some(3..4));
    }
}
