//! A hyperboloid of one sheet about the z axis.
//!
//! Haines, *Essential ray tracing algorithms*, in Glassner (ed.), *An Introduction to Ray Tracing*
//! (1989), ch. 2, 5.2. The arithmetic is in `conic.rs`. A line may be inside it on two intervals.
//!
//! - Twin: hosted by the Mitsuba driver, in double precision; POV-Ray `quadric`, cut (native).
//! - Example: `scenes/shapes/hyperboloid.toml`.

use crate::support::revolution::{Heights, Revolution};
use schemars::JsonSchema;
use serde::Deserialize;
use whitstone_core::config::{Positive, Vector2};
use whitstone_core::{Context, DVec3, LoweredShape, Plugin, SceneErrors, Shapes, Transform};

/// The hyperboloid of one sheet x² + y² = radius² + slope² z² of its object space; its normals
/// point away from the axis.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// Radius of the waist at z = 0, in metres.
    #[serde(default = "half")]
    radius: Positive,
    /// Asymptotic growth of the radius per metre of height; greater than 0.
    #[serde(default = "one")]
    slope: Positive,
    /// Lower and upper end along z, in metres.
    #[serde(default = "heights")]
    #[schemars(with = "Vector2")]
    z: Heights,
    /// Whether disks close both ends.
    #[serde(default = "yes")]
    caps: bool,
}

fn half() -> Positive {
    Positive::new(0.5).expect("0.5 is positive")
}

fn one() -> Positive {
    Positive::new(1.0).expect("1 is positive")
}

fn heights() -> Heights {
    Heights([-1.0, 1.0])
}

fn yes() -> bool {
    true
}

/// Lowers to a surface of revolution.
pub struct Hyperboloid;

impl Plugin<Shapes> for Hyperboloid {
    const TYPE: &'static str = "hyperboloid";
    type Config = Config;

    fn build(config: Config, transform: Transform, _: &mut dyn Context) -> Result<LoweredShape, SceneErrors> {
        let (radius, slope) = (config.radius.get(), config.slope.get());
        let hyperboloid = Revolution {
            square: slope * slope,
            linear: 0.0,
            constant: radius * radius,
            origin: 0.0,
            heights: config.z,
            radii: config.z.0.map(|z| libm::hypot(radius, slope * z)),
            caps: config.caps,
            tip: DVec3::X,
        };
        hyperboloid.build(transform, |_| Vec::new())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use whitstone_core::{Interval, Ray, Spans};
    use whitstone_testkit::{build, shape_laws_everywhere};

    #[test]
    fn obeys_the_laws_of_shapes() {
        shape_laws_everywhere::<Hyperboloid>("", 2_000);
        shape_laws_everywhere::<Hyperboloid>("caps = false", 2_000);
        shape_laws_everywhere::<Hyperboloid>("radius = 1e-3\nslope = 2\nz = [-0.5, 1.5]", 2_000);
        shape_laws_everywhere::<Hyperboloid>("radius = 1\nslope = 0.1\nz = [1, 2]", 2_000);
    }

    #[test]
    fn a_line_beside_the_waist_is_inside_twice() {
        let LoweredShape::Custom(shape) = build::<Shapes, Hyperboloid>("", Transform::IDENTITY).unwrap()
        else {
            unreachable!("a hyperboloid is a custom shape")
        };
        let ray = Ray::new(DVec3::new(0.8, 0.0, 3.0), DVec3::NEG_Z);
        let mut spans = Spans::new();
        shape.spans(&ray, &mut spans);
        let ends: Vec<_> = spans
            .iter()
            .flat_map(|span| [span.enter, span.exit])
            .map(|end| (end.t, end.primitive))
            .collect();
        let side = 0.39f64.sqrt();
        let expected = [(2.0, 2), (3.0 - side, 0), (3.0 + side, 0), (4.0, 1)];
        assert_eq!(ends.len(), 4);
        for (found, expected) in ends.iter().zip(expected) {
            assert!(
                (found.0 - expected.0).abs() < 1e-14 && found.1 == expected.1,
                "{ends:?}"
            );
        }
        // From the lower flare, past the waist on the outside, into the upper flare.
        let leaving = Ray::new(DVec3::new(0.8, 0.0, -side), DVec3::Z);
        let hit = shape.intersect(&leaving, Interval::FORWARD, Some(0)).unwrap();
        assert!(
            (hit.t - 2.0 * side).abs() < 1e-14 && hit.primitive == 0,
            "{hit:?}"
        );
    }
}
