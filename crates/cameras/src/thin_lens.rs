//! A thin lens camera with depth of field.
//!
//! The model is that of Potmesil and Chakravarty, *A lens and aperture camera model for synthetic
//! image generation*, 1981. As in Cook, Porter, Carpenter, *Distributed ray tracing*, 1984, section
//! 4.3, rays start at points of the lens. The points are fixed: the n x n cell centres of a square,
//! mapped to the disk (Shirley and Chiu, *A low distortion map between disk and square*, 1997).
//!
//! - Twin: Mitsuba `thinlens` (native), by formula where the aperture is 0, the window is not
//!   centred or its pixels are not square.
//! - Example: `scenes/cameras/thin_lens.toml`.

use crate::support::pinhole::{FovAxis, Keys, Pinhole, Window, normalize};
use crate::support::view::{Frame, LookAt};
use schemars::JsonSchema;
use serde::Deserialize;
use std::f64::consts::{FRAC_PI_2, FRAC_PI_4};
use toml::Spanned;
use whitstone_core::config::{Finite, IntegerIn, NonNegative, Positive};
use whitstone_core::stream::{GROUP, Lanes, RayStream, groups};
use whitstone_core::{
    Camera, Cameras, Context, DMat4, DVec2, DVec3, FilmSize, Plugin, Ray, SceneError, SceneErrors, simd,
};

/// A thin lens camera, sampled at fixed lens points: objects out of focus are blurred.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// Position of the camera, the point it looks at and the up direction.
    #[schemars(with = "LookAt")]
    look_at: Spanned<LookAt>,
    /// Angle of view along `fov_axis`, in degrees between 0 and 180.
    #[serde(default)]
    #[schemars(with = "Finite", extend("x-default" = "45 without `window`", "exclusiveMinimum" = 0, "exclusiveMaximum" = 180))]
    fov: Option<Spanned<Finite>>,
    /// The side of the image that `fov` spans.
    #[serde(default)]
    #[schemars(extend("default" = "x"), with = "FovAxis")]
    fov_axis: Option<Spanned<FovAxis>>,
    /// Window in front of the camera; replaces `fov`.
    #[serde(default)]
    #[schemars(extend("x-default" = "none"), with = "Window")]
    window: Option<Spanned<Window>>,
    /// Radius of the lens in metres.
    aperture: NonNegative,
    /// Distance of the plane of focus, in metres along the view axis.
    #[schemars(with = "Positive")]
    focus_distance: Spanned<Positive>,
    /// Lens points along each side of a grid: with n, each image position has n x n rays.
    #[serde(default = "four")]
    lens_samples: IntegerIn<1, 64>,
}

fn four() -> IntegerIn<1, 64> {
    IntegerIn::new(4).expect("4 is in range")
}

/// The `thin_lens` camera, in world space.
pub struct ThinLens {
    frame: Frame,
    pinhole: Pinhole,
    /// Vectors from the lens centre to its points, in metres.
    lens: Vec<DVec3>,
    /// Window distance divided by focus distance: it scales the lens offset and the point in focus
    /// to the window.
    window_per_focus: f64,
}

impl Plugin<Cameras> for ThinLens {
    const TYPE: &'static str = "thin_lens";
    type Config = Config;

    fn build(config: Config, film: FilmSize, _: &mut dyn Context) -> Result<Box<dyn Camera>, SceneErrors> {
        let mut errors = SceneErrors::default();
        let frame = errors.take(config.look_at.get_ref().frame(&config.look_at.span()));
        let keys = Keys {
            fov: config.fov,
            fov_axis: config.fov_axis,
            window: config.window,
        };
        let pinhole = errors.take(Pinhole::new(keys, film));
        let (Some(frame), Some(pinhole)) = (frame, pinhole) else {
            return Err(errors);
        };
        let n = config.lens_samples.get();
        let on_lens = |[x, y]: [f64; 2]| config.aperture.get() * (x * frame.right + y * frame.up);
        let lens: Vec<DVec3> = (0..n * n)
            .map(|index| on_lens(concentric(cell(index % n, n), cell(index / n, n))))
            .collect();
        let window_per_focus = pinhole.distance / config.focus_distance.get_ref().get();
        let finite =
            |point: &DVec3| (frame.origin + *point).is_finite() && (window_per_focus * *point).is_finite();
        if !lens.iter().all(finite) {
            let message = "the lens is too large for double precision at this distance";
            errors
                .0
                .push(SceneError::at(config.focus_distance.span(), message));
        }
        errors.into_result(Box::new(Self {
            frame,
            pinhole,
            lens,
            window_per_focus,
        }))
    }
}

/// The centre of cell `index` of n equal cells of [-1, 1].
fn cell(index: u32, n: u32) -> f64 {
    (2.0 * f64::from(index) + 1.0 - f64::from(n)) / f64::from(n)
}

/// The concentric map from the square [-1, 1]² to the unit disk.
fn concentric(p: f64, q: f64) -> [f64; 2] {
    let (r, phi) = if p.abs() > q.abs() {
        (p, FRAC_PI_4 * (q / p))
    } else if q == 0.0 {
        return [0.0, 0.0];
    } else {
        (q, FRAC_PI_2 - FRAC_PI_4 * (p / q))
    };
    let (sin, cos) = libm::sincos(phi);
    [r * cos, r * sin]
}

impl ThinLens {
    /// The ray from a lens point, given relative to the lens centre, through the point in focus.
    /// Its direction is computed at the distance of the window, because the point in focus may
    /// overflow for a large or very near window.
    #[inline(always)]
    fn ray_from(&self, point: DVec3, raster: DVec2) -> Ray {
        let through = self.pinhole.through(&self.frame, raster);
        Ray::new(
            self.frame.origin + point,
            normalize(through - self.window_per_focus * point),
        )
    }
}

impl Camera for ThinLens {
    #[inline(always)]
    fn ray(&self, raster: DVec2) -> Ray {
        let through = self.pinhole.through(&self.frame, raster);
        Ray::new(self.frame.origin, normalize(through))
    }

    fn lens_points(&self) -> u32 {
        self.lens.len() as u32
    }

    fn lens_ray(&self, raster: DVec2, point: u32) -> Ray {
        self.ray_from(self.lens[point as usize], raster)
    }

    fn lens_stream(&self, raster: &Lanes<DVec2>, point: u32, rays: &mut RayStream) {
        let point = self.lens[point as usize];
        simd::dispatch(
            #[inline(always)]
            || {
                for start in groups(rays.len) {
                    for lane in start..start + GROUP {
                        let ray = self.ray_from(point, raster[lane]);
                        rays.origin.set(lane, ray.origin);
                        rays.direction.set(lane, ray.direction);
                    }
                }
            },
        );
    }

    /// The projection from the lens centre.
    fn projection(&self) -> Option<DMat4> {
        Some(self.pinhole.projection(&self.frame))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use whitstone_testkit::{build, camera_laws};

    const FILM: FilmSize = FilmSize { width: 6, height: 4 };
    const LOOK: &str = "look_at = { origin = [1, 2, 3], target = [0, 0, 0] }\n";

    fn camera(text: &str) -> Result<Box<dyn Camera>, SceneErrors> {
        build::<Cameras, ThinLens>(&format!("{LOOK}{text}"), FILM)
    }

    #[test]
    fn laws() {
        for text in [
            "aperture = 0\nfocus_distance = 1",
            "aperture = 0.1\nfocus_distance = 3\nfov = 60",
            "aperture = 5\nfocus_distance = 0.1\nlens_samples = 1",
            "aperture = 0.5\nfocus_distance = 2\nlens_samples = 7\nwindow = { l = -3, r = 1, b = 0, t = 1, d = 2 }",
        ] {
            camera_laws(&*camera(text).unwrap(), FILM);
        }
    }

    #[test]
    fn all_rays_of_a_position_meet_in_focus() {
        let text = "aperture = 0.5\nfocus_distance = 4\nlens_samples = 5\nwindow = { l = -3, r = 1, b = 0, t = 1, d = 2 }";
        let camera = camera(text).unwrap();
        assert_eq!(camera.lens_points(), 25);
        let forward = (-DVec3::new(1.0, 2.0, 3.0)).normalize();
        for raster in [DVec2::ZERO, DVec2::new(2.5, 3.1), DVec2::new(6.0, 4.0)] {
            let middle = camera.ray(raster);
            let focus = middle.at(4.0 / middle.direction.dot(forward));
            for point in 0..25 {
                let ray = camera.lens_ray(raster, point);
                let t = 4.0 / ray.direction.dot(forward);
                assert!((ray.at(t) - focus).length() < 1e-14, "{point}: {ray:?}");
                // On the lens: perpendicular to the view axis, within its radius.
                let off = ray.origin - middle.origin;
                assert!(off.dot(forward).abs() < 1e-15 && off.length() < 0.5);
            }
            // With an odd number of points per side, the middle one is the lens centre.
            let found = camera.lens_ray(raster, 12);
            assert!((found.direction - middle.direction).length() < 1e-15);
        }
    }

    #[test]
    fn points_run_to_the_right_first_and_fill_the_disk_evenly() {
        let half = std::f64::consts::FRAC_1_SQRT_2 / 2.0;
        let close =
            |[x, y]: [f64; 2], [a, b]: [f64; 2]| assert!((x - a).abs() + (y - b).abs() < 1e-15, "{x} {y}");
        close(concentric(cell(0, 2), cell(0, 2)), [-half, -half]);
        close(concentric(cell(1, 2), cell(0, 2)), [half, -half]);
        close(concentric(cell(0, 2), cell(1, 2)), [-half, half]);
        close(concentric(cell(2, 3), cell(1, 3)), [2.0 / 3.0, 0.0]);
        close(concentric(0.0, 0.0), [0.0, 0.0]);
        // The longer coordinate is the signed radius; the ratio of the two is the angle within its
        // quarter.
        let polar = |r: f64, degrees: f64| [r * degrees.to_radians().cos(), r * degrees.to_radians().sin()];
        close(concentric(0.8, 0.4), polar(0.8, 22.5));
        close(concentric(-0.6, 0.2), polar(-0.6, -15.0));
        close(concentric(0.2, -0.6), polar(-0.6, 105.0));
        // In a uniform disk, half of the points lie within the radius sqrt(1/2).
        let n = 64;
        let all = (0..n * n).map(|index| concentric(cell(index % n, n), cell(index / n, n)));
        let inside = all.filter(|[x, y]| x * x + y * y < 0.5).count();
        assert!((inside as f64 / 4096.0 - 0.5).abs() < 0.02, "{inside}");
    }

    #[test]
    fn the_points_of_the_lens_lie_in_its_plane_by_row() {
        let n = 3;
        let camera = camera("aperture = 0.5\nfocus_distance = 2\nlens_samples = 3").unwrap();
        let back = DVec3::new(1.0, 2.0, 3.0);
        let right = DVec3::Y.cross(back).normalize();
        let up = back.cross(right).normalize();
        for index in 0..n * n {
            let [x, y] = concentric(cell(index % n, n), cell(index / n, n));
            let expected = back + 0.5 * (x * right + y * up);
            let found = camera.lens_ray(DVec2::new(1.0, 3.0), index).origin;
            assert!((found - expected).length() < 1e-15, "{index}: {found}");
        }
        assert!(camera.projection().is_some());
    }

    #[test]
    fn faults_are_reported_at_their_places() {
        for (text, place) in [
            ("aperture = -1\nfocus_distance = 1", "-1"),
            ("aperture = 1\nfocus_distance = 0", "0"),
            ("aperture = 1\nfocus_distance = 1\nlens_samples = 65", "65"),
            ("aperture = 1e300\nfocus_distance = 1e-300", "1e-300"),
            ("aperture = 1\nfocus_distance = 1\nfov = 180", "180"),
        ] {
            let errors = camera(text).err().unwrap();
            let text = format!("{LOOK}{text}");
            assert_eq!(&text[errors.0[0].span.clone().unwrap()], place);
        }
        assert!(camera("aperture = 1").is_err());
    }
}
