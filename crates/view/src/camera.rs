//! The keys that all cameras have in common: where a camera is, where it looks, and what is up.

use serde::{Deserialize, Serialize};
use toml::{Table, Value};

/// The key of a camera that [`LookAt`] replaces.
pub(crate) const KEY: &str = "look_at";

/// The `look_at` table of a camera.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct LookAt {
    /// Position of the camera, in metres.
    pub(crate) origin: [f64; 3],
    /// The point that it looks at.
    pub(crate) target: [f64; 3],
    /// The direction that is up in the image.
    pub(crate) up: [f64; 3],
}

impl LookAt {
    /// The view of the camera of a flattened scene; `None` if this camera has no `look_at`.
    pub(crate) fn of(scene: &Table) -> Option<Self> {
        let table = scene.get("camera")?.get(KEY)?;
        let vector = |key: &str| -> Option<[f64; 3]> {
            let numbers: Option<Vec<f64>> = table.get(key)?.as_array()?.iter().map(number).collect();
            numbers?.try_into().ok()
        };
        Some(Self {
            origin: vector("origin")?,
            target: vector("target")?,
            up: vector("up").unwrap_or([0.0, 1.0, 0.0]),
        })
    }

    /// The table in TOML.
    pub(crate) fn to_toml(self) -> Value {
        let vector = |of: [f64; 3]| Value::Array(of.into_iter().map(Value::Float).collect());
        let keys = [("origin", self.origin), ("target", self.target), ("up", self.up)];
        let entries = keys.into_iter().map(|(key, of)| (key.to_owned(), vector(of)));
        Value::Table(entries.collect())
    }

    /// The change of a scene that gives its camera this view.
    pub(crate) fn change(self) -> String {
        format!("camera.{KEY}={}", self.to_toml())
    }
}

fn number(value: &Value) -> Option<f64> {
    value
        .as_float()
        .or_else(|| value.as_integer().map(|whole| whole as f64))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_view_of_a_scene_is_read_and_written() {
        let scene: Table =
            "[camera]\ntype = \"perspective\"\nlook_at = { origin = [0, 2.5, 6], target = [0, 1, 0] }\n"
                .parse()
                .unwrap();
        let found = LookAt::of(&scene).unwrap();
        let expected = LookAt {
            origin: [0.0, 2.5, 6.0],
            target: [0.0, 1.0, 0.0],
            up: [0.0, 1.0, 0.0],
        };
        assert_eq!(found, expected);
        let again: Table = format!("camera = {{ look_at = {} }}", found.to_toml())
            .parse()
            .unwrap();
        assert_eq!(LookAt::of(&again), Some(expected));
    }

    #[test]
    fn a_camera_without_the_key_cannot_be_moved() {
        let scene: Table = "[camera]\ntype = \"other\"\n".parse().unwrap();
        assert_eq!(LookAt::of(&scene), None);
    }
}
