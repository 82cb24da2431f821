//! An ellipsoid.
//!
//! `radii` are part of the transform. Rays are intersected with a unit sphere in its own space,
//! from the point of the ray that is nearest to the center (see `support/conic.rs`). As in Haines,
//! Günther, Akenine-Möller, *Precision improvements for ray/sphere intersection*, Ray Tracing Gems
//! (2019), ch. 7, the squares of distant origins do not cancel.
//!
//! - Twin: hosted by the Mitsuba driver, in double precision; POV-Ray `sphere`, scaled (native).
//! - Example: `scenes/shapes/ellipsoid.toml`.

use crate::support::conic::{Clipped, Conic, Mapping, angle};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize, Serializer};
use whitstone_core::config::Vector3;
use whitstone_core::{
    Context, DAffine3, DMat3, DVec2, DVec3, LoweredShape, Plugin, SceneError, SceneErrors, Shapes, Transform,
};

/// An axis-aligned ellipsoid about the origin of its object space; its normals point outward.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// Semi-axes along x, y and z in metres, each greater than 0.
    #[serde(default = "ones")]
    #[schemars(with = "Vector3")]
    radii: Radii,
}

fn ones() -> Radii {
    Radii(DVec3::ONE)
}

/// Three numbers greater than 0.
#[derive(Debug)]
struct Radii(DVec3);

impl Serialize for Radii {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        self.0.to_array().serialize(serializer)
    }
}

impl<'de> Deserialize<'de> for Radii {
    fn deserialize<D: serde::Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let radii = Vector3::deserialize(deserializer)?.get();
        if radii.min_element() > 0.0 {
            return Ok(Self(radii));
        }
        let message = format!("expected three numbers greater than 0, found {radii}");
        Err(serde::de::Error::custom(message))
    }
}

/// Lowers to a unit sphere with its own object space.
pub struct Ellipsoid;

#[derive(Clone)]
struct Angles;

impl Mapping for Angles {
    fn uv(&self, p: DVec3, _: u32) -> DVec2 {
        // acos loses half the digits near the poles; atan2 does not.
        let theta = libm::atan2(p.truncate().length(), p.z);
        DVec2::new(angle(p.x, p.y), 1.0 - theta / std::f64::consts::PI)
    }
}

impl Plugin<Shapes> for Ellipsoid {
    const TYPE: &'static str = "ellipsoid";
    type Config = Config;

    fn build(config: Config, transform: Transform, _: &mut dyn Context) -> Result<LoweredShape, SceneErrors> {
        let scaled = *transform.world_from_object() * DAffine3::from_scale(config.radii.0);
        let transform = Transform::new(scaled).ok_or_else(|| {
            SceneError::anywhere("the radii are too large or too small for double precision")
        })?;
        let sphere = Conic {
            turn: DMat3::IDENTITY,
            center: DVec3::ZERO,
            square: DVec3::ONE,
            linear: DVec3::ZERO,
            constant: -1.0,
            min: DVec3::NEG_INFINITY,
            max: DVec3::INFINITY,
            caps: true,
            first_face: 0,
            tip: DVec3::Z,
        };
        let ellipsoid = Clipped::new(transform, sphere, Angles, |frame| {
            frame.around(frame.reach_of_ellipsoid(DVec3::ONE))
        })?;
        Ok(LoweredShape::Custom(Box::new(ellipsoid)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use whitstone_core::{Interval, Ray, Shape};
    use whitstone_testkit::{Random, build};

    whitstone_testkit::shape_laws!(
        Ellipsoid,
        "",
        "radii = [1, 0.02, 7]",
        "radii = [4, 1, 1e-2]",
        "radii = [0.05..4.0, 0.05..4.0, 0.05..4.0]",
    );

    fn ellipsoid(text: &str) -> Box<dyn Shape> {
        match build::<Shapes, Ellipsoid>(text, Transform::IDENTITY).unwrap() {
            LoweredShape::Custom(primitive) => primitive,
            _ => unreachable!("an ellipsoid is a custom shape"),
        }
    }

    /// A distant ellipsoid with semi-axes in the ratio 1 to 1e6.
    #[test]
    fn a_flat_ellipsoid_is_hit_where_it_is() {
        let ray = Ray::new(DVec3::new(100.0, 0.6, 0.0), DVec3::NEG_X);
        let found = ellipsoid("radii = [1e-6, 1, 1]")
            .intersect(&ray, Interval::FORWARD, None)
            .unwrap();
        assert!((found.t - (100.0 - 0.8e-6)).abs() < 3e-14, "{found:?}");
        let beside = Ray::new(DVec3::new(100.0, 1.0 + 1e-14, 0.0), DVec3::NEG_X);
        assert_eq!(
            ellipsoid("radii = [1e-6, 1, 1]").intersect(&beside, Interval::FORWARD, None),
            None
        );
    }

    /// Rays through the plane of ellipsoids without thickness, inside and outside of the rim.
    #[test]
    fn ellipsoids_flatter_than_rounding_errors_are_hit_inside_of_their_rim_only() {
        let mut random = Random::new(11);
        for exponent in (1..=29).step_by(2) {
            let flat = ellipsoid(&format!("radii = [0.7, 1e-{exponent}, 1.1]"));
            for _ in 0..200 {
                let (x, z) = (3.0 * random.unit() - 1.5, 3.0 * random.unit() - 1.5);
                let rim = (x / 0.7).powi(2) + (z / 1.1).powi(2) - 1.0;
                let origin = DVec3::new(4.0 * random.unit() - 2.0, 1.0 + random.unit(), 1.7);
                let ray = Ray::new(origin, (DVec3::new(x, 0.0, z) - origin).normalize());
                let found = flat.intersect(&ray, Interval::FORWARD, None);
                // A thick ellipsoid is hit at some distance from the plane.
                let beside = 4.0 * 10f64.powi(-exponent);
                if rim.abs() > 1e-9 + 10.0 * beside {
                    assert_eq!(found.is_some(), rim < 0.0, "1e-{exponent}: {x} {z}");
                }
                if let Some(found) = found {
                    let expected = (DVec3::new(x, 0.0, z) - origin).length();
                    assert!(
                        (found.t - expected).abs() < 1e-14 + beside,
                        "1e-{exponent}: {found:?}"
                    );
                }
            }
        }
    }

    #[test]
    fn bounds_are_tight() {
        let bounds = ellipsoid("radii = [1, 2, 3]").bounds();
        assert_eq!(bounds.max, DVec3::new(1.0, 2.0, 3.0));
        assert_eq!(bounds.min, -bounds.max);
    }

    /// The quadratic formula in its textbook form.
    fn naive(ray: &Ray) -> f64 {
        let (a, b) = (ray.direction.length_squared(), ray.origin.dot(ray.direction));
        (-b - (b * b - a * (ray.origin.length_squared() - 1.0)).sqrt()) / a
    }

    /// The hit lies nearer than the center by at most the radius. The textbook form loses this
    /// difference, because it subtracts the squared distance of the origin.
    #[test]
    fn far_eyes_see_where_the_surface_is_and_the_naive_form_does_not() {
        let sphere = ellipsoid("");
        let mut random = Random::new(9);
        let (mut worst, mut naive_worst) = (0f64, 0f64);
        for _ in 0..1_000 {
            let distance = 1e7 * (1.0 + random.unit());
            let beside = 0.9 * random.unit();
            let ray = Ray::new(DVec3::new(distance, beside, 0.0), DVec3::NEG_X);
            let expected = distance - (1.0 - beside * beside).sqrt();
            let hit = sphere
                .intersect(&ray, Interval::FORWARD, None)
                .expect("it is there");
            worst = worst.max((hit.t - expected).abs());
            // NaN (no hit) counts as a whole radius.
            naive_worst = naive_worst.max((naive(&ray) - expected).abs().min(1.0));
        }
        assert!(worst < 8e-9, "{worst}");
        assert!(naive_worst > 1e-3, "{naive_worst}");
    }
}
