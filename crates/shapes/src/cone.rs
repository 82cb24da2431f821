//! A cone or frustum about the z axis.
//!
//! Haines, *Essential ray tracing algorithms*, in Glassner (ed.), *An Introduction to Ray Tracing*
//! (1989), ch. 2, 5.2. Heights are measured from the apex, where the squared radii do not cancel.
//! The arithmetic is in `conic.rs`.
//!
//! - Twin: hosted by the Mitsuba driver, in double precision; POV-Ray `cone` (native).
//! - Example: `scenes/shapes/cone.toml`.

use crate::support::revolution::{Heights, Revolution};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize, Serializer};
use whitstone_core::config::Vector2;
use whitstone_core::{Context, DVec3, LoweredShape, Plugin, SceneErrors, Shapes, Transform};

/// A cone or frustum about the z axis of its object space; its normals point away from the axis.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// Radii of the lower and upper end in metres, at least 0. One of them may be 0, which makes
    /// that end an apex.
    #[serde(default = "radii")]
    #[schemars(with = "Vector2")]
    radii: Radii,
    /// Lower and upper end along z, in metres.
    #[serde(default = "heights")]
    #[schemars(with = "Vector2")]
    z: Heights,
    /// Whether disks close both ends.
    #[serde(default = "yes")]
    caps: bool,
}

fn radii() -> Radii {
    Radii([1.0, 0.0])
}

fn heights() -> Heights {
    Heights([0.0, 1.0])
}

fn yes() -> bool {
    true
}

#[derive(Debug)]
struct Radii([f64; 2]);

impl Serialize for Radii {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        self.0.serialize(serializer)
    }
}

impl<'de> Deserialize<'de> for Radii {
    fn deserialize<D: serde::Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let radii @ [low, high] = Vector2::deserialize(deserializer)?.get().to_array();
        if low >= 0.0 && high >= 0.0 && low.max(high) > 0.0 {
            return Ok(Self(radii));
        }
        let message = format!("expected two radii of at least 0, not both 0, found [{low}, {high}]");
        Err(serde::de::Error::custom(message))
    }
}

/// Lowers to a surface of revolution.
pub struct Cone;

impl Plugin<Shapes> for Cone {
    const TYPE: &'static str = "cone";
    type Config = Config;

    fn build(config: Config, transform: Transform, _: &mut dyn Context) -> Result<LoweredShape, SceneErrors> {
        let Radii(radii @ [at_low, at_high]) = config.radii;
        let Heights([low, high]) = config.z;
        let slope = (at_high - at_low) / (high - low);
        let apex = if at_low < at_high {
            low - at_low / slope
        } else {
            high - at_high / slope
        };
        // Measure heights from the apex unless it is so distant that they would lose digits.
        let near = (apex - low).abs() <= 1e3 * (high - low);
        let (origin, radius) = if near { (apex, 0.0) } else { (low, at_low) };
        let cone = Revolution {
            square: slope * slope,
            linear: slope * radius,
            constant: radius * radius,
            origin,
            heights: config.z,
            radii,
            caps: config.caps,
            tip: if at_low < at_high { DVec3::NEG_Z } else { DVec3::Z },
        };
        cone.build(transform, |_| Vec::new())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use whitstone_core::{InstanceId, Interval, Ray, Shape, SurfaceAttributes};
    use whitstone_testkit::{build, shape_laws_everywhere};

    fn cone(text: &str) -> Box<dyn Shape> {
        match build::<Shapes, Cone>(text, Transform::IDENTITY).unwrap() {
            LoweredShape::Custom(primitive) => primitive,
            _ => unreachable!("a cone is a custom shape"),
        }
    }

    #[test]
    fn obeys_the_laws_of_shapes() {
        shape_laws_everywhere::<Cone>("", 2_000);
        shape_laws_everywhere::<Cone>("radii = [0, 2]\nz = [-1, 0.5]\ncaps = false", 2_000);
        shape_laws_everywhere::<Cone>("radii = [1, 0.4]", 2_000);
        shape_laws_everywhere::<Cone>("radii = [1, 1]", 2_000);
        shape_laws_everywhere::<Cone>("radii = [1, 1.0000001]\nz = [-1, 1]", 2_000);
    }

    #[test]
    fn the_apex_is_hit_and_has_a_normal() {
        let ray = Ray::new(DVec3::new(0.0, 0.0, 3.0), DVec3::NEG_Z);
        let hit = cone("").intersect(&ray, Interval::FORWARD, None).unwrap();
        assert_eq!((hit.t, hit.primitive), (2.0, 0));
        let point = cone("").surface(
            &ray,
            &hit.of_shape(InstanceId::TOP_LEVEL, 0),
            SurfaceAttributes::UV,
        );
        assert_eq!((point.position, point.n_g), (DVec3::Z, DVec3::Z));
        let beside = Ray::new(DVec3::new(3.0, 0.0, 1.0 + 1e-15), DVec3::NEG_X);
        assert_eq!(cone("").intersect(&beside, Interval::FORWARD, None), None);
        let below = Ray::new(DVec3::new(3.0, 0.0, 1.0 - 1e-12), DVec3::NEG_X);
        assert!(cone("").intersect(&below, Interval::FORWARD, None).is_some());
    }

    #[test]
    fn the_other_half_of_the_double_cone_is_not_there() {
        let ray = Ray::new(DVec3::new(0.0, 0.5, 5.0), DVec3::new(0.0, 0.0, -1.0));
        let hit = cone("").intersect(&ray, Interval::FORWARD, None).unwrap();
        assert_eq!((hit.t, hit.primitive), (4.5, 0));
    }
}
