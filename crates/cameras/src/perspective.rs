//! A pinhole camera.
//!
//! Whitted 1980, section 2; the window (l, r, b, t, d) and the near limit, planar or spherical, are
//! those of the lecture notes.
//!
//! - Twin: Mitsuba `perspective` (native); a formula if `near` is not 0 or the pixels are not
//!   square.
//! - Example: `scenes/cameras/perspective.toml`.

use crate::support::near::{Near, NearKind};
use crate::support::pinhole::{FovAxis, Keys, Pinhole, Window, normalize};
use crate::support::view::{Frame, LookAt};
use schemars::JsonSchema;
use serde::Deserialize;
use toml::Spanned;
use whitstone_core::config::Finite;
use whitstone_core::stream::{GROUP, Lanes, RayStream, groups};
use whitstone_core::{Camera, Cameras, Context, DMat4, DVec2, FilmSize, Plugin, Ray, SceneErrors, simd};

/// A pinhole camera, defined by its angle of view or by a window in front of it.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// Position of the camera, the point it looks at and the up direction.
    #[schemars(with = "LookAt")]
    look_at: Spanned<LookAt>,
    /// Angle of view along `fov_axis`, in degrees, between 0 and 180 (both exclusive).
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
    /// Near limit: distance from the camera, in metres. Nearer surfaces are invisible. A negative
    /// limit lies behind the camera: surfaces between it and the camera are seen through the
    /// camera's position, upside down and mirrored.
    #[serde(default)]
    #[schemars(extend("default" = 0), with = "Finite")]
    near: Option<Spanned<Finite>>,
    /// Shape of the near limit: "planar" (perpendicular to the view axis) or "spherical" (around
    /// the camera).
    #[serde(default)]
    near_kind: NearKind,
}

/// The `perspective` camera, in world space.
pub struct Perspective {
    frame: Frame,
    pinhole: Pinhole,
    near: Near,
}

impl Plugin<Cameras> for Perspective {
    const TYPE: &'static str = "perspective";
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
        let near = errors.take(Near::new(
            config.near.as_ref(),
            config.near_kind,
            &frame,
            &pinhole,
        ));
        let Some(near) = near else {
            return Err(errors);
        };
        errors.into_result(Box::new(Self { frame, pinhole, near }))
    }
}

impl Camera for Perspective {
    #[inline(always)]
    fn ray(&self, raster: DVec2) -> Ray {
        let through = self.pinhole.through(&self.frame, raster);
        let direction = normalize(through);
        Ray::new(self.near.start(&self.frame, through, direction), direction)
    }

    fn ray_stream(&self, raster: &Lanes<DVec2>, rays: &mut RayStream) {
        simd::dispatch(
            #[inline(always)]
            || {
                for start in groups(rays.len) {
                    for lane in start..start + GROUP {
                        let ray = self.ray(raster[lane]);
                        rays.origin.set(lane, ray.origin);
                        rays.direction.set(lane, ray.direction);
                    }
                }
            },
        );
    }

    fn near(&self, raster: DVec2) -> f64 {
        self.near.distance(self.pinhole.through(&self.frame, raster))
    }

    fn projection(&self) -> Option<DMat4> {
        Some(self.pinhole.projection(&self.frame))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use whitstone_core::DVec3;
    use whitstone_testkit::{build, camera_laws};

    whitstone_testkit::camera_laws!(
        Perspective,
        "look_at = { origin = [1, 2, 3], target = [0, 0, 0] }\nfov = 1.0..170",
        "look_at = { origin = [0, 0, 5], target = [0, -2.0..2, 0] }\nnear = -9.0..9",
    );

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
            "near = 3",
            "near = 0.5\nnear_kind = \"spherical\"\nfov = 150",
            "near = -0.5\nnear_kind = \"spherical\"\nfov = 150",
            "near = -3",
            "near = 7\nwindow = { l = -3, r = 1, b = 0, t = 1e-3, d = 2 }",
        ] {
            let camera = camera(text, 31, 47).unwrap();
            assert!(camera.projection().is_some());
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

    /// The lecture notes define the window in two ways: by its edges and by half its angle.
    #[test]
    fn both_forms_of_the_window_agree() {
        let half = 30.0_f64.to_radians().tan();
        let by_angle = camera("fov = 60", 8, 4).unwrap();
        let edges = format!(
            "l = {}, r = {half}, b = {}, t = {}",
            -half,
            -0.5 * half,
            0.5 * half
        );
        let by_edges = camera(&format!("window = {{ {edges} }}"), 8, 4).unwrap();
        for raster in [DVec2::ZERO, DVec2::new(3.3, 0.7), DVec2::new(8.0, 4.0)] {
            let (a, b) = (by_angle.ray(raster), by_edges.ray(raster));
            assert!((a.direction - b.direction).length() < 1e-15, "{a:?} {b:?}");
        }
    }

    /// Tangents of fov/2 to 20 digits, computed with mpmath at 60 digits from the exact binary
    /// values of fov.
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
    fn rays_start_at_the_near_limit_and_point_the_same_way() {
        let window = "window = { l = -6, r = 6, b = -4, t = 4, d = 4 }";
        let at = |text: &str, raster| camera(&format!("{window}\n{text}"), 2, 2).unwrap().ray(raster);
        for raster in [DVec2::ZERO, DVec2::new(0.3, 1.7), DVec2::ONE] {
            let from_eye = at("", raster);
            assert_eq!(from_eye.origin, DVec3::ZERO);
            let planar = at("near = 2", raster);
            assert_eq!((planar.direction, planar.origin.z), (from_eye.direction, -2.0));
            let spherical = at("near = 2\nnear_kind = \"spherical\"", raster);
            assert_eq!(spherical.origin, 2.0 * from_eye.direction);
            let distance = camera(&format!("{window}\nnear = 2"), 2, 2).unwrap().near(raster);
            assert!((distance - planar.origin.length()).abs() < 1e-15);
        }
    }

    /// The start `c + n r` of the lecture notes, with a negative distance n.
    #[test]
    fn rays_may_start_behind_the_camera_and_pass_through_it() {
        let window = "window = { l = -6, r = 6, b = -4, t = 4, d = 4 }";
        let at = |text: &str, raster| camera(&format!("{window}\n{text}"), 2, 2).unwrap().ray(raster);
        for raster in [DVec2::ZERO, DVec2::new(0.3, 1.7), DVec2::ONE] {
            let from_eye = at("", raster);
            let planar = at("near = -2", raster);
            assert_eq!((planar.direction, planar.origin.z), (from_eye.direction, 2.0));
            assert!(planar.at(planar.origin.length()).length() < 1e-14, "{planar:?}");
            let spherical = at("near = -2\nnear_kind = \"spherical\"", raster);
            assert_eq!(spherical.origin, -2.0 * from_eye.direction);
            let distance = camera(&format!("{window}\nnear = -2"), 2, 2)
                .unwrap()
                .near(raster);
            assert!((distance + planar.origin.length()).abs() < 1e-15);
        }
    }

    #[test]
    fn a_limit_that_is_too_far_at_one_corner_is_refused() {
        // At the right corners a planar limit is 1e10 times as far away as at the left ones.
        let window = "window = { l = 0, r = 1e10, b = 0, t = 1 }";
        assert!(camera(&format!("{window}\nnear = 1e298"), 2, 2).is_ok());
        let text = format!("{window}\nnear = 2e298");
        let error = camera(&text, 2, 2).err().unwrap().0.remove(0);
        assert_eq!(&format!("{LOOK}\n{text}")[error.span.unwrap()], "2e298");
    }

    #[test]
    fn a_limit_beyond_all_numbers_is_refused_at_its_place() {
        let text = "window = { l = -1, r = 1, b = -1, t = 1, d = 1e-200 }\nnear = 1e200";
        let errors = camera(text, 2, 2).err().unwrap();
        let text = format!("{LOOK}\n{text}");
        assert_eq!(&text[errors.0[0].span.clone().unwrap()], "1e200");
        let behind = "window = { l = -1, r = 1, b = -1, t = 1, d = 1e-200 }\nnear = -1e200";
        assert!(camera(behind, 2, 2).is_err());
        assert!(camera("near_kind = \"round\"", 2, 2).is_err());
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
        // Each corner in turn is the only one that is too far away.
        for edges in [
            "l = -1e10, r = 1, b = -1, t = 1",
            "l = -1, r = 1e10, b = -1, t = 1",
            "l = -1, r = 1, b = -1e10, t = 1",
            "l = -1, r = 1, b = -1, t = 1e10",
        ] {
            let near = |near: &str| format!("window = {{ {edges}, d = 1 }}\nnear = {near}");
            assert!(camera(&near("1e290"), 2, 2).is_ok(), "{edges}");
            assert!(camera(&near("1e300"), 2, 2).is_err(), "{edges}");
        }
    }
}
