//! Finds the parts of a scene for which the oracle shares code with our tracer. A fault there looks
//! right to both. In such scenes the oracle alone does not accept a pixel that the reference's own
//! variation does not explain.

use toml::{Table, Value};
use whitstone_core::DVec3;
use whitstone_core::config::TransformSteps;

/// Maximum difference between the images of unit vectors under both methods, relative to the
/// largest coordinate.
const SAME: f64 = 1e-12;

/// The shared code that may contain a fault, if the scene uses it: the decoding of images, or a
/// transform for which another method gives another result.
pub(crate) fn possible_fault(flattened: &str) -> Option<&'static str> {
    let table: Table = flattened.parse().ok()?;
    find(&Value::Table(table))
}

fn find(value: &Value) -> Option<&'static str> {
    match value {
        Value::Table(table) => table.iter().find_map(|(key, value)| match (key.as_str(), value) {
            ("file", Value::String(path)) if is_image(path) => Some("the decoding of images"),
            ("transform", steps) if !agrees(steps) => Some("the composition of transforms"),
            _ => find(value),
        }),
        Value::Array(values) => values.iter().find_map(find),
        _ => None,
    }
}

fn is_image(path: &str) -> bool {
    let path = path.to_ascii_lowercase();
    [".png", ".jpg", ".jpeg", ".exr", ".hdr"]
        .iter()
        .any(|ending| path.ends_with(ending))
}

/// Whether the steps map the origin and the unit vectors to the same points as quaternions do,
/// applied step by step.
fn agrees(steps: &Value) -> bool {
    let Ok(known) = steps.clone().try_into::<TransformSteps>() else {
        // Both sides reject it.
        return true;
    };
    let map = *known.get().world_from_object();
    let alone = [steps.clone()];
    let list = steps.as_array().map_or(&alone[..], Vec::as_slice);
    [DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::Z]
        .into_iter()
        .all(|point| {
            let expected = list.iter().try_fold(point, |point, step| follow(step, point));
            let found = map.transform_point3(point);
            expected.is_some_and(|expected| {
                let size = 1.0 + expected.abs().max_element() + map.translation.abs().max_element();
                (found - expected).abs().max_element() <= SAME * size
            })
        })
}

fn number(value: &Value) -> Option<f64> {
    value.as_float().or_else(|| Some(value.as_integer()? as f64))
}

fn vector(value: &Value) -> Option<DVec3> {
    let numbers: Vec<f64> = value.as_array()?.iter().map(number).collect::<Option<_>>()?;
    Some(DVec3::from_array(numbers.try_into().ok()?))
}

/// Applies one step to a point.
fn follow(step: &Value, p: DVec3) -> Option<DVec3> {
    let (key, value) = step.as_table()?.iter().next()?;
    match key.as_str() {
        "translate" => Some(p + vector(value)?),
        "scale" => Some(match number(value) {
            Some(factor) => p * factor,
            None => p * vector(value)?,
        }),
        "rotate" => {
            let axis = vector(value.get("axis")?)?.normalize();
            let (sin, w) = (0.5 * number(value.get("degrees")?)?.to_radians()).sin_cos();
            let u = axis * sin;
            // q p q* of the unit quaternion q = (w, u).
            Some(p + 2.0 * (w * u.cross(p) + u.cross(u.cross(p))))
        }
        "matrix" => {
            let rows = value.as_array()?.iter().map(|row| {
                let row: Vec<f64> = row.as_array()?.iter().map(number).collect::<Option<_>>()?;
                let [x, y, z, w] = row.try_into().ok()?;
                Some(x * p.x + y * p.y + z * p.z + w)
            });
            let rows: Vec<f64> = rows.collect::<Option<_>>()?;
            Some(DVec3::from_array(rows.try_into().ok()?))
        }
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn transforms_agree_with_those_of_quaternions() {
        let turned = "[{ scale = [1, -2, 3] }, { rotate = { axis = [1, 2, -0.5], degrees = 213.5 } }, { translate = [100, 0, -3] }]";
        for steps in [
            "{ scale = 2 }",
            turned,
            "{ matrix = [[1, 2, 0, 5], [0, 1, 0, 6], [0, 0.5, 2, 7]] }",
        ] {
            assert_eq!(possible_fault(&format!("[[shape]]\ntransform = {steps}\n")), None);
            let nested = format!(
                "[[shape]]\nmaterial = {{ reflectance = {{ mapping = {{ transform = {steps} }} }} }}\n"
            );
            assert_eq!(possible_fault(&nested), None);
        }
    }

    #[test]
    fn a_step_that_is_followed_otherwise_is_seen() {
        let p = DVec3::new(0.3, -2.0, 1.0);
        let step = |text: &str| follow(&format!("s = {text}").parse::<Table>().unwrap()["s"], p).unwrap();
        let quarter = step("{ rotate = { axis = [0, 0, 2], degrees = 90 } }");
        assert!((quarter - DVec3::new(2.0, 0.3, 1.0)).length() < 1e-15);
        assert!((step("{ rotate = { axis = [0, 0, 2], degrees = 90.000001 } }") - quarter).length() > SAME);
        assert_eq!(step("{ translate = [1, 1, 1] }"), DVec3::new(1.3, -1.0, 2.0));
    }

    #[test]
    fn images_are_shared() {
        let scene = "[texture.sky]\ntype = \"image\"\nfile = \"a.PNG\"\n";
        assert_eq!(possible_fault(scene), Some("the decoding of images"));
        assert_eq!(possible_fault("[[shape]]\nfile = \"bunny.ply\"\n"), None);
    }
}
