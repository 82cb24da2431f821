//! The `transform` key: one step, or a list of steps in order of application.

use crate::Transform;
use crate::config::{Finite, Vector3};
use glam::{DAffine3, DMat3, DVec3};
use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde::de::{Error, MapAccess, SeqAccess, Visitor};
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use std::borrow::Cow;
use std::fmt;

/// One transformation step, with exactly one key. Section 9 of the model defines their meanings.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TransformOp {
    translate: Option<Vector3>,
    scale: Option<Scale>,
    rotate: Option<Rotate>,
    matrix: Option<[[Finite; 4]; 3]>,
}

#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(untagged, expecting = "expected a number or an array of three numbers")]
enum Scale {
    Uniform(Finite),
    PerAxis(Vector3),
}

#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Rotate {
    axis: Vector3,
    degrees: Finite,
}

/// An error of a step as a whole, with an optional hint.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TransformOpError {
    /// The error.
    pub message: &'static str,
    /// A hint.
    pub help: Option<&'static str>,
}

/// The message for transforms that are not invertible.
pub const SINGULAR: &str = "the transform is singular: it flattens the shape or is not finite";

impl TransformOp {
    /// The affine map of the step.
    ///
    /// # Errors
    ///
    /// If there is not exactly one key, or the axis of a rotation is zero.
    pub fn map(&self) -> Result<DAffine3, TransformOpError> {
        match (self.translate, self.scale, self.rotate, self.matrix) {
            (Some(v), None, None, None) => Ok(DAffine3::from_translation(v.get())),
            (None, Some(Scale::Uniform(s)), None, None) => Ok(DAffine3::from_scale(DVec3::splat(s.get()))),
            (None, Some(Scale::PerAxis(s)), None, None) => Ok(DAffine3::from_scale(s.get())),
            (None, None, Some(Rotate { axis, degrees }), None) => {
                let axis = axis.get().try_normalize().ok_or(TransformOpError {
                    message: "the axis of a rotation must not be zero or nearly zero",
                    help: None,
                })?;
                Ok(DAffine3::from_mat3(rotation(axis, degrees.get())))
            }
            (None, None, None, Some(rows)) => {
                let [x, y, z] = rows.map(|row| row.map(Finite::get));
                Ok(DAffine3::from_cols_array(&[
                    x[0], y[0], z[0], x[1], y[1], z[1], x[2], y[2], z[2], x[3], y[3], z[3],
                ]))
            }
            _ => Err(TransformOpError {
                message: "expected exactly one of `translate`, `scale`, `rotate`, `matrix`",
                help: Some("write several steps as a list: they are applied in order"),
            }),
        }
    }
}

impl TransformOp {
    /// The map of the step between this one, at `u` = 0, and `to`, at `u` = 1: each of its numbers
    /// is interpolated linearly.
    ///
    /// # Errors
    ///
    /// As [`Self::map`]; also if the steps are of different kinds, or rotate about different axes.
    pub fn between(&self, to: &Self, u: f64) -> Result<DAffine3, TransformOpError> {
        let (a, b) = (self.map()?, to.map()?);
        if self.kind() != to.kind() {
            return Err(TransformOpError {
                message: "the steps of a keyframe must be of the same kinds as those of the keyframe before",
                help: Some("a step that changes nothing is { translate = [0, 0, 0] } or { scale = 1 }"),
            });
        }
        if let (Some(from), Some(to)) = (self.rotate, to.rotate) {
            let Rotate { axis, degrees } = from;
            if axis != to.axis {
                return Err(TransformOpError {
                    message: "the axis of a rotation must be the same in all keyframes",
                    help: Some("only degrees are interpolated; write one rotation for each axis"),
                });
            }
            let (from, to) = (degrees.get(), to.degrees.get());
            // `map` has checked that it is not zero.
            let axis = axis.get().normalize();
            return Ok(DAffine3::from_mat3(rotation(axis, from + u * (to - from))));
        }
        // The other maps have the numbers of their steps as entries.
        let mix = |a: DVec3, b: DVec3| a + u * (b - a);
        let (linear, moved) = (a.matrix3, b.matrix3);
        Ok(DAffine3 {
            matrix3: DMat3::from_cols(
                mix(linear.x_axis, moved.x_axis),
                mix(linear.y_axis, moved.y_axis),
                mix(linear.z_axis, moved.z_axis),
            ),
            translation: mix(a.translation, b.translation),
        })
    }

    /// Which of the keys it has.
    fn kind(&self) -> [bool; 4] {
        [
            self.translate.is_some(),
            self.scale.is_some(),
            self.rotate.is_some(),
            self.matrix.is_some(),
        ]
    }
}

/// The rotation about a unit vector, counter-clockwise when it points towards the viewer. Multiples
/// of 90 degrees are exact, so that floors and walls are exactly aligned with the axes.
pub fn rotation(axis: DVec3, degrees: f64) -> DMat3 {
    let (sin, cos) = match degrees.rem_euclid(360.0) {
        0.0 => (0.0, 1.0),
        90.0 => (1.0, 0.0),
        180.0 => (0.0, -1.0),
        270.0 => (-1.0, 0.0),
        other => libm::sincos(other.to_radians()),
    };
    // Rodrigues' formula.
    let cross = DMat3::from_cols(
        DVec3::new(0.0, axis.z, -axis.y),
        DVec3::new(-axis.z, 0.0, axis.x),
        DVec3::new(axis.y, -axis.x, 0.0),
    );
    let outer = DMat3::from_cols(axis * axis.x, axis * axis.y, axis * axis.z);
    DMat3::IDENTITY * cos + cross * sin + outer * (1.0 - cos)
}

/// The `transform` key in part of a plugin's table, such as the mapping of a texture: an invertible
/// affine map.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TransformSteps(Transform);

impl TransformSteps {
    /// No steps.
    pub const NONE: Self = Self(Transform::IDENTITY);

    /// The product of all steps. Its `world_from_object` maps from the space before the first step
    /// to the space after the last.
    pub const fn get(self) -> Transform {
        self.0
    }

    fn of<E: Error>(map: DAffine3) -> Result<Self, E> {
        Transform::new(map).map(Self).ok_or_else(|| E::custom(SINGULAR))
    }
}

impl<'de> Deserialize<'de> for TransformSteps {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        /// A step that is rejected at its position if it defines no map.
        struct Map(DAffine3);

        impl<'de> Deserialize<'de> for Map {
            fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
                // Inside a visitor, so that an error of the whole step gets its position.
                deserializer.deserialize_any(One)
            }
        }

        struct One;

        impl<'de> Visitor<'de> for One {
            type Value = Map;
            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("a transform step")
            }
            fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<Map, A::Error> {
                let step = TransformOp::deserialize(serde::de::value::MapAccessDeserializer::new(map))?;
                step.map()
                    .map(Map)
                    .map_err(|fault| A::Error::custom(fault.message))
            }
        }

        struct OneOrMore;

        impl<'de> Visitor<'de> for OneOrMore {
            type Value = TransformSteps;
            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("a transform step or a list of them")
            }
            fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<TransformSteps, A::Error> {
                TransformSteps::of(One.visit_map(map)?.0)
            }
            fn visit_seq<A: SeqAccess<'de>>(self, mut seq: A) -> Result<TransformSteps, A::Error> {
                let mut all = DAffine3::IDENTITY;
                while let Some(step) = seq.next_element::<Map>()? {
                    all = step.0 * all;
                }
                TransformSteps::of(all)
            }
        }

        deserializer.deserialize_any(OneOrMore)
    }
}

/// Only the default is serialised, into the JSON Schema: the steps themselves are not kept.
impl Serialize for TransformSteps {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        if self.0 == Transform::IDENTITY {
            serializer.collect_seq([(); 0])
        } else {
            Err(serde::ser::Error::custom("only the identity is serialised"))
        }
    }
}

impl JsonSchema for TransformSteps {
    fn schema_name() -> Cow<'static, str> {
        "Steps".into()
    }
    fn inline_schema() -> bool {
        true
    }
    fn json_schema(_: &mut SchemaGenerator) -> Schema {
        // The schema of whole scenes defines the step.
        json_schema!({ "anyOf": [
            { "$ref": "#/$defs/transform_step" },
            { "type": "array", "items": { "$ref": "#/$defs/transform_step" } }
        ] })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::decode;
    use toml::de::DeTable;

    #[derive(Deserialize)]
    #[serde(deny_unknown_fields)]
    struct Table {
        transform: TransformSteps,
    }

    #[test]
    fn a_step_and_a_list_of_steps() {
        let apply = |text: &str| {
            let table: Table = decode(&DeTable::parse(text).unwrap()).unwrap();
            table.transform.get().point_to_world(DVec3::X)
        };
        assert_eq!(apply("transform = []"), DVec3::X);
        assert_eq!(apply("transform = { scale = 3 }"), DVec3::new(3.0, 0.0, 0.0));
        let steps =
            "[{ scale = 2 }, { rotate = { axis = [0, 0, 1], degrees = 90 } }, { translate = [1, 0, 0] }]";
        assert_eq!(apply(&format!("transform = {steps}")), DVec3::new(1.0, 2.0, 0.0));
    }

    #[test]
    fn errors_are_reported_at_their_positions() {
        for (value, place, why) in [
            ("{ scale = 0 }", "{ scale = 0 }", "singular"),
            ("[{ scale = 2 }, { turn = 1 }]", "turn", "unknown key"),
            ("[{ translate = [1, nan, 0] }]", "nan", "a finite number"),
            (
                "[{ scale = 2, translate = [0, 0, 0] }]",
                "{ scale = 2, translate = [0, 0, 0] }",
                "exactly one",
            ),
            ("[7]", "7", "expected a transform step"),
            ("7", "7", "expected a transform step or a list of them"),
        ] {
            let text = format!("transform = {value}");
            let error = decode::<Table>(&DeTable::parse(&text).unwrap())
                .err()
                .unwrap()
                .0
                .remove(0);
            assert_eq!(&text[error.span.unwrap()], place, "{value}");
            assert!(error.message.contains(why), "{}", error.message);
        }
    }
}
