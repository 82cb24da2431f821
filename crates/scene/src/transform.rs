//! The `transform` of a shape.

use crate::document::type_name;
use toml::Spanned;
use toml::de::{DeTable, DeValue};
use whitstone_core::config::decode;
use whitstone_core::transform_steps::{SINGULAR, TransformOp, TransformOpError};
use whitstone_core::{DAffine3, SceneError, SceneErrors, SourceSpan, Transform};

use crate::document::Value;

/// Parses the value of the key `transform`. Steps are applied in the order in which they are
/// written.
///
/// # Errors
///
/// All errors of the steps, each at its position; also a singular result.
pub fn parse(value: &Value<'_>) -> Result<Transform, SceneErrors> {
    let mut errors = SceneErrors::default();
    let steps = errors.take(parse_steps(value)).unwrap_or_default();
    let mut world_from_object = DAffine3::IDENTITY;
    for step in steps {
        // `parse_steps` has checked that it has a map.
        if let Ok(map) = step.get_ref().map() {
            world_from_object = map * world_from_object;
        }
    }
    let transform = Transform::new(world_from_object);
    if transform.is_none() && errors.0.is_empty() {
        errors
            .0
            .push(SceneError::at(value.span(), SINGULAR).with_help("every scale factor must be nonzero"));
    }
    errors.into_result(transform.unwrap_or(Transform::IDENTITY))
}

/// The steps of a transform, as they are written.
///
/// # Errors
///
/// All errors of the steps, each at its position.
pub(crate) fn parse_steps(value: &Value<'_>) -> Result<Vec<Spanned<TransformOp>>, SceneErrors> {
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
    let steps = steps
        .iter()
        .filter_map(|step| errors.take(parse_step(step)))
        .collect();
    errors.into_result(steps)
}

fn parse_step(step: &Value<'_>) -> Result<Spanned<TransformOp>, SceneErrors> {
    let DeValue::Table(table) = step.get_ref() else {
        let found = type_name(step.get_ref());
        return Err(
            SceneError::at(step.span(), format!("expected a transform step, found {found}"))
                .with_help("for example { translate = [0, 1, 0] }")
                .into(),
        );
    };
    let table: Spanned<DeTable<'_>> = Spanned::new(step.span(), table.clone());
    let read: TransformOp = decode(&table)?;
    match read.map() {
        Ok(_) => Ok(Spanned::new(step.span(), read)),
        Err(fault) => Err(fault_at(step.span(), fault).into()),
    }
}

/// The error of a step.
pub(crate) fn fault_at(span: SourceSpan, fault: TransformOpError) -> SceneError {
    let error = SceneError::at(span, fault.message);
    match fault.help {
        Some(help) => error.with_help(help),
        None => error,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use whitstone_core::DVec3;

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
    fn errors_are_reported_at_their_positions() {
        let text = "[{ scale = 0 }]";
        assert_eq!(parse_text(text).unwrap_err().0[0].span, Some(0..text.len()));
        let text = "[{ shift = [1, 2, 3] }, { translate = [1, 2] }, 7]";
        let errors = parse_text(text).unwrap_err().0;
        assert_eq!(errors.len(), 3);
        let text = "{ rotate = { axis = [0, 0, 0], degrees = 1 } }";
        assert!(parse_text(text).is_err());
    }
}
