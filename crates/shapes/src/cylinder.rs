//! A cylinder about the z axis.
//!
//! Haines, *Essential ray tracing algorithms*, in Glassner (ed.), *An Introduction to Ray Tracing*
//! (1989), chapter 2, section 5.2; Cychosz and Waggenspack, *Intersecting a ray with a cylinder*,
//! Graphics Gems IV (1994), chapter V.2. The intersection is computed in `support/conic.rs`.
//!
//! - Twin: Mitsuba `cylinder` (native) without caps, hosted by the driver with caps; POV-Ray
//!   `cylinder` (native).
//! - Example: `scenes/shapes/cylinder.toml`.

use crate::support::revolution::{Heights, Revolution};
use schemars::JsonSchema;
use serde::Deserialize;
use whitstone_core::config::{Positive, Vector2};
use whitstone_core::{Context, DVec3, LoweredShape, Plugin, SceneErrors, Shapes, Transform};

/// A cylinder about the z axis of its object space, open or closed by disks.
///
/// The normals of the lateral surface point away from the axis, those of the disks along -z and +z.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// Radius in metres.
    #[serde(default = "one")]
    radius: Positive,
    /// z of the lower and of the upper end, in metres.
    #[serde(default = "heights")]
    #[schemars(with = "Vector2")]
    z: Heights,
    /// Whether disks close both ends. A cylinder without them is visible from inside.
    #[serde(default = "yes")]
    caps: bool,
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
pub struct Cylinder;

impl Plugin<Shapes> for Cylinder {
    const TYPE: &'static str = "cylinder";
    type Config = Config;

    fn build(config: Config, transform: Transform, _: &mut dyn Context) -> Result<LoweredShape, SceneErrors> {
        let radius = config.radius.get();
        let cylinder = Revolution {
            square: 0.0,
            linear: 0.0,
            constant: radius * radius,
            origin: 0.0,
            heights: config.z,
            radii: [radius; 2],
            caps: config.caps,
            tip: DVec3::X,
        };
        cylinder.build(transform, |_| Vec::new())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use whitstone_core::{Interval, Ray, Shape};
    use whitstone_testkit::{build, placements, shape_laws, shape_laws_everywhere};

    fn cylinder(text: &str) -> Box<dyn Shape> {
        match build::<Shapes, Cylinder>(text, Transform::IDENTITY).unwrap() {
            LoweredShape::Custom(primitive) => primitive,
            _ => unreachable!("a cylinder is a custom shape"),
        }
    }

    fn intersect(
        text: &str,
        origin: [f64; 3],
        direction: [f64; 3],
        origin_primitive: Option<u32>,
    ) -> Option<(f64, u32)> {
        let ray = Ray::new(origin.into(), direction.into());
        let hit = cylinder(text).intersect(&ray, Interval::FORWARD, origin_primitive)?;
        Some((hit.t, hit.primitive))
    }

    #[test]
    fn obeys_the_laws_of_shapes() {
        shape_laws_everywhere::<Cylinder>("", 2_000);
        // Almost all rays that are aimed at the bounding box of a thin open tube miss the tube, so
        // "thin" is not tested.
        for (name, transform) in placements().into_iter().filter(|(name, _)| *name != "thin") {
            eprintln!("open, {name}");
            shape_laws(
                build::<Shapes, Cylinder>("caps = false", transform).unwrap(),
                2_000,
            );
        }
        shape_laws_everywhere::<Cylinder>("radius = 0.2\nz = [-0.1, 1]", 2_000);
        shape_laws_everywhere::<Cylinder>("radius = 3\nz = [5, 5.001]", 2_000);
    }

    #[test]
    fn radii_without_squares_are_refused() {
        for (radius, refused) in [(1e-150, false), (1e-160, true), (1e160, true)] {
            let built = build::<Shapes, Cylinder>(&format!("radius = {radius:e}"), Transform::IDENTITY);
            assert_eq!(built.is_err(), refused, "{radius:e}");
        }
    }

    #[test]
    fn sides_and_caps_are_numbered() {
        assert_eq!(
            intersect("", [3.0, 0.0, 0.0], [-1.0, 0.0, 0.0], None),
            Some((2.0, 0))
        );
        for zero in [0.0, -0.0] {
            assert_eq!(
                intersect("", [0.5, 0.0, 3.0], [zero, zero, -1.0], None),
                Some((2.0, 2))
            );
            assert_eq!(
                intersect("", [0.5, 0.0, -3.0], [zero, zero, 1.0], None),
                Some((2.0, 1))
            );
            assert_eq!(
                intersect("caps = false", [0.5, 0.0, 3.0], [zero, zero, -1.0], None),
                None
            );
            assert_eq!(intersect("", [1.5, 0.0, 3.0], [zero, zero, -1.0], None), None);
            assert_eq!(intersect("", [3.0, 0.0, 2.0], [-1.0, zero, zero], None), None);
        }
        // Through the open end, to the inside of the lateral surface.
        assert_eq!(
            intersect("caps = false", [0.0, 0.0, 2.0], [0.5, 0.0, -1.0], None),
            Some((2.0, 0))
        );
    }

    #[test]
    fn a_ray_that_leaves_meets_the_far_side_only() {
        assert_eq!(
            intersect("", [1.0, 0.0, 0.0], [-1.0, 0.0, 0.0], Some(0)),
            Some((2.0, 0))
        );
        assert_eq!(intersect("", [1.0, 0.0, 0.0], [1.0, 0.0, 0.0], Some(0)), None);
        // At the rim, one ulp beyond the cap.
        let beyond = 1f64.next_up();
        assert_eq!(
            intersect("", [1.0, 0.0, beyond], [-1.0, 0.0, -1.0], Some(0)),
            Some((2.0, 0))
        );
        // The other cap is reached before the side, because the origin is one ulp off.
        assert_eq!(
            intersect("", [beyond, 0.0, 1.0], [-1.0, 0.0, -1.0], Some(2)),
            Some((2.0, 1))
        );
    }

    #[test]
    fn a_needle_is_hit_from_afar_and_bounds_are_tight() {
        let found = intersect(
            "radius = 1e-8\nz = [0, 1]",
            [1e3, 0.6e-8, 0.5],
            [-1.0, 0.0, 0.0],
            None,
        );
        assert!((found.unwrap().0 - (1e3 - 0.8e-8)).abs() < 2e-13, "{found:?}");
        let bounds = cylinder("radius = 2\nz = [3, 4]").bounds();
        assert_eq!(
            (bounds.min, bounds.max),
            (DVec3::new(-2.0, -2.0, 3.0), DVec3::new(2.0, 2.0, 4.0))
        );
    }
}
