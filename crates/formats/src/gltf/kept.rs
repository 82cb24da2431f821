//! The scene that an exported file keeps in `extras`.
//!
//! The root of an exported file has `extras = { "whitstone": { "version", "checksum", "scene" } }`.
//! `scene` is the flattened document, with TOML's integers and floats as numbers without and with
//! a fraction. Meshes and images without `file` are those of the exported file itself. `checksum`
//! is the BLAKE3 hash of everything else in the file: other programs that change the file do not
//! change this copy of the scene, so that it must not be used any more.

use serde_json::{Map, Value as Json, json};
use std::path::Path;
use toml::{Table, Value};
use whitstone_gltf::Document;

/// The name of the object in `extras`.
const NAME: &str = "whitstone";
/// The version of this form.
const VERSION: u64 = 1;

/// Adds a scene to a file with these bytes in its buffer.
pub(super) fn keep(file: &mut Json, buffer: &[u8], scene: Table) {
    let checksum = checksum(file, buffer);
    file["extras"][NAME] = json!({
        "version": VERSION,
        "checksum": checksum,
        "scene": to_json(&Value::Table(scene)),
    });
}

/// A scene in a file.
#[derive(Debug, PartialEq)]
pub(super) enum Kept {
    /// There is none.
    None,
    /// Another program has changed the file.
    Changed,
    /// The scene.
    Scene(Table),
}

/// Reads the scene of a file. Files that cannot be read have none: the import reports the error.
pub(super) fn read(path: &Path, document: &Document) -> Kept {
    // Most files are of other programs and are not parsed twice.
    let text = Document::text(path).unwrap_or_default();
    if !text.contains("\"checksum\"") || !text.contains("\"whitstone\"") {
        return Kept::None;
    }
    let text = text.strip_prefix('\u{feff}').unwrap_or(&text);
    let Ok(file) = serde_json::from_str::<Json>(text) else {
        return Kept::None;
    };
    let kept = &file["extras"][NAME];
    let (Some(expected), Some(Value::Table(scene))) = (kept["checksum"].as_str(), from_json(&kept["scene"]))
    else {
        return Kept::None;
    };
    let buffer = match document.root.buffers.len() {
        0 => Ok(Vec::new()),
        _ => document.buffer(0),
    };
    let unchanged =
        kept["version"] == json!(VERSION) && buffer.is_ok_and(|buffer| checksum(&file, &buffer) == expected);
    if unchanged {
        Kept::Scene(scene)
    } else {
        Kept::Changed
    }
}

/// The hash of a file without `extras`, in hexadecimal.
fn checksum(file: &Json, buffer: &[u8]) -> String {
    let mut hasher = blake3::Hasher::new();
    add(&mut hasher, file);
    hasher.update(buffer);
    hasher.finalize().to_hex().to_string()
}

/// Adds a value to a hash, whatever the order of its keys and the form of its numbers.
fn add(hasher: &mut blake3::Hasher, value: &Json) {
    let mut text = |kind: u8, text: &str| {
        hasher.update(&[kind]);
        hasher.update(&(text.len() as u64).to_le_bytes());
        hasher.update(text.as_bytes());
    };
    match value {
        Json::Null => text(b'n', ""),
        Json::Bool(value) => text(b'b', if *value { "1" } else { "0" }),
        Json::Number(value) => {
            let value = value.as_f64().unwrap_or(f64::NAN) + 0.0;
            hasher.update(b"d");
            hasher.update(&value.to_le_bytes());
        }
        Json::String(value) => text(b's', value),
        Json::Array(items) => {
            text(b'a', "");
            hasher.update(&(items.len() as u64).to_le_bytes());
            items.iter().for_each(|item| add(hasher, item));
        }
        Json::Object(entries) => {
            let mut entries: Vec<(&String, &Json)> =
                entries.iter().filter(|(key, _)| *key != "extras").collect();
            entries.sort_by_key(|(key, _)| *key);
            text(b'o', "");
            hasher.update(&(entries.len() as u64).to_le_bytes());
            for (key, item) in entries {
                hasher.update(&(key.len() as u64).to_le_bytes());
                hasher.update(key.as_bytes());
                add(hasher, item);
            }
        }
    }
}

/// A value of a document as JSON.
fn to_json(value: &Value) -> Json {
    match value {
        Value::String(text) => text.as_str().into(),
        Value::Integer(number) => (*number).into(),
        // Numbers of a scene are finite.
        Value::Float(number) => (*number).into(),
        Value::Boolean(value) => (*value).into(),
        Value::Datetime(value) => value.to_string().into(),
        Value::Array(items) => items.iter().map(to_json).collect(),
        Value::Table(table) => {
            let entries = table.iter().map(|(key, item)| (key.clone(), to_json(item)));
            Json::Object(entries.collect::<Map<_, _>>())
        }
    }
}

/// A value of a document from JSON; none of values that TOML lacks.
fn from_json(value: &Json) -> Option<Value> {
    Some(match value {
        Json::Null => return None,
        Json::Bool(value) => Value::Boolean(*value),
        Json::Number(number) => match number.as_i64() {
            Some(number) => Value::Integer(number),
            None => Value::Float(number.as_f64()?),
        },
        Json::String(text) => Value::String(text.clone()),
        Json::Array(items) => Value::Array(items.iter().map(from_json).collect::<Option<_>>()?),
        Json::Object(entries) => {
            let entries = entries
                .iter()
                .map(|(key, item)| Some((key.clone(), from_json(item)?)));
            Value::Table(entries.collect::<Option<_>>()?)
        }
    })
}
