//! A paraboloid about the z axis.
//!
//! Haines, *Essential ray tracing algorithms*, in Glassner (ed.), *An Introduction to Ray Tracing*
//! (1989), ch. 2, 5.2. The arithmetic is in `conic.rs`.
//!
//! - Twin: hosted by the Mitsuba driver, in double precision; POV-Ray `quadric`, cut (native).
//! - Example: `scenes/shapes/paraboloid.toml`.

use crate::support::revolution::{Heights, Revolution};
use schemars::JsonSchema;
use serde::{Deserialize, Deserializer};
use whitstone_core::config::{Positive, Vector2};
use whitstone_core::{Context, DVec3, LoweredShape, Plugin, SceneErrors, Shapes, Transform};

/// The paraboloid x² + y² = radius² z of its object space; its normals point away from the axis.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// Radius at z = 1, in metres.
    #[serde(default = "one")]
    radius: Positive,
    /// Lower and upper end along z, in metres, at least 0.
    #[serde(default = "heights", deserialize_with = "not_below")]
    #[schemars(with = "Vector2")]
    z: Heights,
    /// Whether disks close its ends.
    #[serde(default = "yes")]
    caps: bool,
}

fn one() -> Positive {
    Positive::new(1.0).expect("1 is positive")
}

fn heights() -> Heights {
    Heights([0.0, 1.0])
}

fn yes() -> bool {
    true
}

fn not_below<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Heights, D::Error> {
    let heights = Heights::deserialize(deserializer)?;
    if heights.0[0] >= 0.0 {
        return Ok(heights);
    }
    let message = format!("expected heights of at least 0, found {}", heights.0[0]);
    Err(serde::de::Error::custom(message))
}

/// Lowers to a surface of revolution.
pub struct Paraboloid;

impl Plugin<Shapes> for Paraboloid {
    const TYPE: &'static str = "paraboloid";
    type Config = Config;

    fn build(config: Config, transform: Transform, _: &mut dyn Context) -> Result<LoweredShape, SceneErrors> {
        let radius = config.radius.get();
        let Heights([low, high]) = config.z;
        let paraboloid = Revolution {
            square: 0.0,
            linear: 0.5 * radius * radius,
            constant: 0.0,
            origin: 0.0,
            heights: config.z,
            radii: [radius * low.sqrt(), radius * high.sqrt()],
            caps: config.caps,
            tip: DVec3::NEG_Z,
        };
        paraboloid.build(transform, |transform| {
            // Along w and -w, the circle at height z reaches radius sqrt(z) |w_xy| + z w_z and
            // radius sqrt(z) |w_xy| - z w_z. One of the two has its maximum at this height, limited
            // to the ends; the other has it at an end, which is in the bounds anyway.
            let matrix = transform.world_from_object().matrix3;
            let farthest = (0..3).map(|axis| {
                let w = matrix.row(axis);
                let root = 0.5 * radius * w.truncate().length() / w.z.abs();
                (root * root).clamp(low, high)
            });
            // NaN if the shape has no extent along that axis.
            let heights = farthest.filter(|z| !z.is_nan());
            heights.map(|z| [z, radius * z.sqrt()]).collect()
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use whitstone_core::{Interval, Ray};
    use whitstone_testkit::{build, shape_laws_everywhere};

    #[test]
    fn obeys_the_laws_of_shapes() {
        shape_laws_everywhere::<Paraboloid>("", 2_000);
        shape_laws_everywhere::<Paraboloid>("caps = false", 2_000);
        shape_laws_everywhere::<Paraboloid>("radius = 0.1\nz = [0.5, 3]", 2_000);
        shape_laws_everywhere::<Paraboloid>("radius = 30\nz = [0.01, 2]\ncaps = false", 2_000);
    }

    #[test]
    fn a_ray_along_the_axis_meets_it_once() {
        let LoweredShape::Custom(shape) = build::<Shapes, Paraboloid>("", Transform::IDENTITY).unwrap()
        else {
            unreachable!("a paraboloid is a custom shape")
        };
        for x in [0.0, 0.5, -0.5] {
            let up = Ray::new(DVec3::new(x, 0.0, -3.0), DVec3::Z);
            let hit = shape.intersect(&up, Interval::FORWARD, None).unwrap();
            assert_eq!((hit.t, hit.primitive), (3.0 + x * x, 0));
            let down = Ray::new(DVec3::new(x, 0.0, 3.0), DVec3::NEG_Z);
            let hit = shape.intersect(&down, Interval::FORWARD, None).unwrap();
            assert_eq!((hit.t, hit.primitive), (2.0, 2));
        }
    }
}
