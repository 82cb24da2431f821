//! Values of a flattened document, with the defaults of the model.
//!
//! Documents that are exported have been checked; a value of a wrong type reads as the default.

use toml::{Table, Value};
use whitstone_core::transform_steps::rotation;
use whitstone_core::{DAffine3, DMat3, DVec3};

/// A number.
pub(crate) fn number(table: &Table, key: &str) -> Option<f64> {
    table.get(key).and_then(as_number)
}

pub(crate) fn as_number(value: &Value) -> Option<f64> {
    match value {
        Value::Float(value) => Some(*value),
        Value::Integer(value) => Some(*value as f64),
        _ => None,
    }
}

pub(crate) fn text<'t>(table: &'t Table, key: &str) -> Option<&'t str> {
    table.get(key).and_then(Value::as_str)
}

/// The type of a plugin's table.
pub(crate) fn kind(table: &Table) -> &str {
    text(table, "type").unwrap_or_default()
}

/// The roughness of a microfacet distribution about the normal that is as wide as the lobe of a
/// material about the reflected direction, whose exponent is four times as small.
pub(crate) fn alpha(material: &Table) -> f64 {
    let exponent = number(material, "exponent").unwrap_or(100.0);
    (2.0 / (4.0 * exponent + 2.0)).sqrt()
}

pub(crate) fn numbers(value: &Value) -> Option<Vec<f64>> {
    value.as_array()?.iter().map(as_number).collect()
}

pub(crate) fn vector(table: &Table, key: &str) -> Option<DVec3> {
    let values = numbers(table.get(key)?)?;
    <[f64; 3]>::try_from(values).ok().map(DVec3::from)
}

/// One number or two.
pub(crate) fn pair(table: &Table, key: &str, default: f64) -> [f64; 2] {
    match table.get(key) {
        None => [default; 2],
        Some(value) => match (as_number(value), numbers(value).as_deref()) {
            (Some(both), _) => [both; 2],
            (None, Some([x, y])) => [*x, *y],
            _ => [default; 2],
        },
    }
}

/// A colour: a number or three.
pub(crate) fn as_color(value: &Value) -> Option<[f64; 3]> {
    if let Some(grey) = as_number(value) {
        return Some([grey; 3]);
    }
    numbers(value)?.try_into().ok()
}

/// Whether a key is a texture, not a colour.
pub(crate) fn has_texture(table: &Table, key: &str) -> bool {
    table.get(key).is_some_and(|value| as_color(value).is_none())
}

pub(crate) fn color(table: &Table, key: &str, default: [f64; 3]) -> [f64; 3] {
    table.get(key).and_then(as_color).unwrap_or(default)
}

/// The tables of a list.
pub(crate) fn tables<'t>(table: &'t Table, key: &str) -> Vec<&'t Table> {
    let list = table.get(key).and_then(Value::as_array);
    list.into_iter().flatten().filter_map(Value::as_table).collect()
}

/// A table in a table; empty if there is none.
pub(crate) fn table<'t>(parent: &'t Table, key: &str) -> Option<&'t Table> {
    parent.get(key).and_then(Value::as_table)
}

/// The product of the steps of the key `transform`, and of the first keyframe of a motion.
pub(crate) fn transform(table: &Table) -> DAffine3 {
    let motion = table.get("motion").and_then(Value::as_array);
    let first = motion.and_then(|keyframes| keyframes.first()?.get("transform"));
    let steps = [table.get("transform"), first].into_iter().flatten();
    let steps = steps.flat_map(|steps| match steps {
        Value::Array(steps) => steps.iter().collect(),
        step => vec![step],
    });
    let steps = steps.filter_map(Value::as_table);
    steps.fold(DAffine3::IDENTITY, |before, step_table| step(step_table) * before)
}

fn step(table: &Table) -> DAffine3 {
    if let Some(by) = vector(table, "translate") {
        return DAffine3::from_translation(by);
    }
    if let Some(by) = table.get("scale").and_then(as_color) {
        return DAffine3::from_scale(by.into());
    }
    if let Some(rotate) = self::table(table, "rotate") {
        let axis = vector(rotate, "axis").and_then(DVec3::try_normalize);
        let degrees = number(rotate, "degrees").unwrap_or(0.0);
        return axis.map_or(DAffine3::IDENTITY, |axis| {
            DAffine3::from_mat3(rotation(axis, degrees))
        });
    }
    let rows = table.get("matrix").and_then(Value::as_array);
    let rows: Option<Vec<Vec<f64>>> = rows.and_then(|rows| rows.iter().map(numbers).collect());
    match rows.as_deref() {
        Some([x, y, z]) if [x, y, z].iter().all(|row| row.len() == 4) => {
            let column = |j: usize| DVec3::new(x[j], y[j], z[j]);
            let matrix = DMat3::from_cols(column(0), column(1), column(2));
            DAffine3::from_mat3_translation(matrix, column(3))
        }
        _ => DAffine3::IDENTITY,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_are_applied_in_order() {
        let table: Table = toml::from_str(
            "transform = [{ scale = 2 }, { rotate = { axis = [0, 0, 2], degrees = 90 } }, { translate = [1, 0, 0] },
             { matrix = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 5]] }, { scale = [1, 1, 2] }]",
        )
        .unwrap();
        let moved = transform(&table).transform_point3(DVec3::X);
        assert!((moved - DVec3::new(1.0, 2.0, 10.0)).length() < 1e-12);
        let moving: Table = toml::from_str(
            "transform = { scale = 2 }
             motion = [{ time = 0, transform = { translate = [1, 0, 0] } }, { time = 1, transform = { translate = [9, 0, 0] } }]",
        )
        .unwrap();
        assert_eq!(
            transform(&moving).transform_point3(DVec3::X),
            DVec3::new(3.0, 0.0, 0.0)
        );
    }
}
