//! A camera and lights for files that have none, fitted to the bounds of their surfaces.

use crate::document::{numbers, table};
use std::f64::consts::PI;
use toml::{Table, Value};
use whitstone_core::DVec3;

/// From the middle of the bounds towards the fitted camera.
const TOWARDS_CAMERA: DVec3 = DVec3::new(0.5, 0.4, 1.0);
/// Angle of view of the fitted camera along the smaller image axis, in degrees.
const FOV: f64 = 45.0;
/// Irradiance of the fitted directional light in W/m².
const IRRADIANCE: f64 = 0.8 * PI;
/// Radiance of the fitted ambient light. A white matte surface that faces the directional light
/// has the radiance `IRRADIANCE / pi + AMBIENT = 1`.
const AMBIENT: f64 = 0.2;
/// Radiance of the fitted background: middle grey.
const BACKGROUND: f64 = 0.18;
/// Larger coordinates, in metres, are treated as this. The camera distance then stays finite.
const LIMIT: f64 = 1e150;

/// A `[film]` of 512 x 512 pixels.
pub fn film() -> Table {
    table([("width", Value::Integer(512)), ("height", Value::Integer(512))])
}

/// A `[camera]` that sees the bounding sphere of the box from `low` to `high` (metres) from above,
/// right and in front. The sphere touches the borders of the smaller image axis.
pub fn camera(low: DVec3, high: DVec3) -> Table {
    let (center, radius) = bounding_sphere(low, high);
    let distance = radius / libm::sin((FOV / 2.0).to_radians());
    let origin = center + TOWARDS_CAMERA.normalize() * distance;
    let look_at = table([
        ("origin", numbers(origin.to_array())),
        ("target", numbers(center.to_array())),
    ]);
    table([
        ("type", Value::String("perspective".into())),
        ("fov", Value::Float(FOV)),
        ("fov_axis", Value::String("smaller".into())),
        ("look_at", Value::Table(look_at)),
    ])
}

/// The `[[light]]`s that fit the camera: a directional light from above its left shoulder, an
/// ambient light and a grey background. They do not depend on the box.
pub fn lights(_low: DVec3, _high: DVec3) -> Vec<Table> {
    let backwards = TOWARDS_CAMERA.normalize();
    let right = DVec3::Y.cross(backwards).normalize();
    let up = backwards.cross(right);
    let towards_light = backwards + 0.6 * up - 0.4 * right;
    let kind = |name: &str| ("type", Value::String(name.into()));
    vec![
        table([
            kind("directional"),
            ("direction", numbers((-towards_light).to_array())),
            ("irradiance", Value::Float(IRRADIANCE)),
        ]),
        table([kind("ambient"), ("radiance", Value::Float(AMBIENT))]),
        table([kind("background"), ("radiance", Value::Float(BACKGROUND))]),
    ]
}

/// Center and radius of the sphere around a box; a radius of 1 if the box is a point, the unit
/// sphere if it is empty.
fn bounding_sphere(low: DVec3, high: DVec3) -> (DVec3, f64) {
    let limit = DVec3::splat(LIMIT);
    let (low, high) = (low.clamp(-limit, limit), high.clamp(-limit, limit));
    if !low.cmple(high).all() {
        return (DVec3::ZERO, 1.0);
    }
    let center = (low + high) / 2.0;
    let radius = (high - low).length() / 2.0;
    // A smaller radius would put the camera on the target.
    let smallest = center.abs().max_element() * 1e-9;
    match radius.max(smallest) {
        0.0 => (center, 1.0),
        radius => (center, radius),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn point(table: &Table, key: &str) -> DVec3 {
        let values = table["look_at"][key].as_array().unwrap();
        let [x, y, z] = [0, 1, 2].map(|axis| values[axis].as_float().unwrap());
        DVec3::new(x, y, z)
    }

    #[test]
    fn the_bounding_sphere_touches_the_borders_of_the_image() {
        let (low, high) = (DVec3::new(1.0, 2.0, 3.0), DVec3::new(3.0, 6.0, 7.0));
        let camera = camera(low, high);
        let (origin, target) = (point(&camera, "origin"), point(&camera, "target"));
        assert_eq!(target, DVec3::new(2.0, 4.0, 5.0));
        let angle = (3.0 / (origin - target).length()).asin().to_degrees();
        assert!((angle - 22.5).abs() < 1e-12);
        assert!((origin - target).normalize().dot(TOWARDS_CAMERA.normalize()) > 1.0 - 1e-12);
    }

    #[test]
    fn a_white_matte_surface_that_faces_the_light_has_radiance_one() {
        let lights = lights(DVec3::ZERO, DVec3::ONE);
        let irradiance = lights[0]["irradiance"].as_float().unwrap();
        let ambient = lights[1]["radiance"].as_float().unwrap();
        assert!((irradiance / PI + ambient - 1.0).abs() < 1e-12);
        assert!(lights[0]["direction"][1].as_float().unwrap() < 0.0);
    }

    #[test]
    fn degenerate_and_huge_boxes_have_a_finite_camera() {
        let infinite = DVec3::splat(f64::INFINITY);
        let boxes = [
            (DVec3::ZERO, DVec3::ZERO),
            (DVec3::splat(1e9), DVec3::splat(1e9)),
            (infinite, -infinite),
            (-infinite, infinite),
            (DVec3::splat(-f64::MAX), DVec3::splat(f64::MAX)),
            (DVec3::NAN, DVec3::NAN),
        ];
        for (low, high) in boxes {
            let camera = camera(low, high);
            let (origin, target) = (point(&camera, "origin"), point(&camera, "target"));
            assert!(
                origin.is_finite() && target.is_finite() && origin != target,
                "{low} {high}"
            );
        }
    }
}
