//! The `transform` of a shape.

use crate::document::type_name;
use serde::Deserialize;
use toml::Spanned;
use toml::de::{DeTable, DeValue};
use whitstone_core::config::{Finite, Vector3, decode};
use whitstone_core::{DAffine3, DMat3, DVec3, SceneError, SceneErrors, Transform};

use crate::document::Value;

/// One step; exactly one key.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Step {
    translate: Option<Vector3>,
    scale: Option<Scale>,
    rotate: Option<Rotate>,
    matrix: Option<[[Finite; 4]; 3]>,
}

#[derive(Deserialize)]
#[serde(untagged, expecting = "expected a number or an array of three numbers")]
enum Scale {
    Uniform(Finite),
    PerAxis(Vector3),
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Rotate {
    axis: Vector3,
    degrees: Finite,
}

/// The transform that a value of the key `transform` says. Steps are applied in the order in which they are written.
///
/// # Errors
///
/// All that is wrong with the steps, each at its place; also a singular result.
pub fn parse(value: &Value<'_>) -> Result<Transform, SceneErrors> {
    let mut errors = SceneErrors::default();
    let one = std::slice::from_ref(value);
    let steps = match value.get_ref() {
        DeValue::Table(_) => one,
        DeValue::Array(items) => items,
        other => {
            let message = format!(
                "expected a transform step or a list of them, found {}",
                type_name(other)
            );
            return Err(SceneError::at(value.span(), message).into());
        }
    };
    let mut world_from_object = DAffine3::IDENTITY;
    for step in steps {
        if let Some(matrix) = errors.take(parse_step(step)) {
            world_from_object = matrix * world_from_object;
        }
    }
    let transform = Transform::new(world_from_object);
    if transform.is_none() && errors.0.is_empty() {
        errors.0.push(
            SceneError::at(
                value.span(),
                "the transform is singular: it flattens the shape or is not finite",
            )
            .with_help("every scale must be other than 0"),
        );
    }
    errors.into_result(transform.unwrap_or(Transform::IDENTITY))
}

fn parse_step(step: &Value<'_>) -> Result<DAffine3, SceneErrors> {
    let DeValue::Table(table) = step.get_ref() else {
        let found = type_name(step.get_ref());
        return Err(
            SceneError::at(step.span(), format!("expected a transform step, found {found}"))
                .with_help("for example { translate = [0, 1, 0] }")
                .into(),
        );
    };
    let table: Spanned<DeTable<'_>> = Spanned::new(step.span(), table.clone());
    let Step {
        translate,
        scale,
        rotate,
        matrix,
    } = decode(&table)?;
    match (translate, scale, rotate, matrix) {
        (Some(v), None, None, None) => Ok(DAffine3::from_translation(v.get())),
        (None, Some(Scale::Uniform(s)), None, None) => Ok(DAffine3::from_scale(DVec3::splat(s.get()))),
        (None, Some(Scale::PerAxis(s)), None, None) => Ok(DAffine3::from_scale(s.get())),
        (None, None, Some(Rotate { axis, degrees }), None) => {
            let axis = axis.get().try_normalize().ok_or_else(|| {
                SceneError::at(
                    step.span(),
                    "the axis of a rotation must not be zero or nearly so",
                )
            })?;
            Ok(DAffine3::from_mat3(rotation(axis, degrees.get())))
        }
        (None, None, None, Some(rows)) => {
            let [x, y, z] = rows.map(|row| row.map(Finite::get));
            Ok(DAffine3::from_cols_array(&[
                x[0], y[0], z[0], x[1], y[1], z[1], x[2], y[2], z[2], x[3], y[3], z[3],
            ]))
        }
        _ => Err(SceneError::at(
            step.span(),
            "expected exactly one of translate, scale, rotate, matrix",
        )
        .with_help("write several steps as a list: they are applied in order")
        .into()),
    }
}

/// Counter-clockwise looking against the axis. Multiples of a right angle are exact, so that floors
/// and walls lie exactly where they should.
fn rotation(axis: DVec3, degrees: f64) -> DMat3 {
    let (sin, cos) = match degrees.rem_euclid(360.0) {
        0.0 => (0.0, 1.0),
        90.0 => (1.0, 0.0),
        180.0 => (0.0, -1.0),
        270.0 => (-1.0, 0.0),
        other => other.to_radians().sin_cos(),
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

#[cfg(test)]
mod tests {
    use super::*;

    fn parse_text(text: &str) -> Result<Transform, SceneErrors> {
        parse(&DeValue::parse(text).unwrap())
    }

    #[test]
    fn steps_are_applied_in_the_order_written() {
        let text =
            "[{ scale = 2 }, { rotate = { axis = [0, 0, 1], degrees = 90 } }, { translate = [1, 0, 0] }]";
        let transform = parse_text(text).unwrap();
        assert_eq!(transform.point_to_world(DVec3::X), DVec3::new(1.0, 2.0, 0.0));
    }

    #[test]
    fn a_matrix_is_given_by_rows() {
        let transform = parse_text("{ matrix = [[1, 2, 0, 5], [0, 1, 0, 6], [0, 0, 1, 7]] }").unwrap();
        assert_eq!(transform.point_to_world(DVec3::Y), DVec3::new(7.0, 7.0, 7.0));
    }

    #[test]
    fn faults_are_at_their_places() {
        let text = "[{ scale = 0 }]";
        assert_eq!(parse_text(text).unwrap_err().0[0].span, Some(0..text.len()));
        let text = "[{ shift = [1, 2, 3] }, { translate = [1, 2] }, 7]";
        let errors = parse_text(text).unwrap_err().0;
        assert_eq!(errors.len(), 3);
        let text = "{ rotate = { axis = [0, 0, 0], degrees = 1 } }";
        assert!(parse_text(text).is_err());
    }
}
