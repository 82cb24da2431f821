//! The parameters of a plugin, read from its schema: their tables for the pages, and what their
//! documentation lacks.

use serde_json::Value;
use std::collections::BTreeMap;
use std::fmt::Write as _;
use whitstone::core::Entry;
use whitstone::scene::table_schema;

/// Appends a table of the keys, one for each form if there are several.
pub(crate) fn write(schema: &Value, text: &mut String) {
    let forms = ["oneOf", "anyOf"].iter().find_map(|key| schema[key].as_array());
    let Some(forms) = forms else {
        let rows = rows(schema, schema);
        match rows.is_empty() {
            true => *text += "None.\n",
            false => *text += &table(&rows),
        }
        return;
    };
    let common = rows(schema, schema);
    if !common.is_empty() {
        *text += &table(&common);
    }
    for form in forms {
        let form = resolved(form, schema);
        let about = form["description"].as_str().unwrap_or_default();
        let _ = writeln!(text, "\n{}\n", one_line(about));
        *text += &table(&rows(form, schema));
    }
}

struct Row {
    key: String,
    kind: String,
    required: bool,
    /// In Markdown; `None` if the key is required, or its default is not declared.
    default: Option<String>,
    about: String,
}

/// The key of a schema that describes a default which is no constant, such as "that of `k_d`".
const COMPUTED_DEFAULT: &str = "x-default";

/// The optional keys of a plugin whose schema declares no default.
pub(crate) fn undeclared_defaults(entry: &Entry) -> Vec<String> {
    let schema = table_schema(entry);
    let forms = ["oneOf", "anyOf"].iter().filter_map(|key| schema[key].as_array());
    let tables = std::iter::once(&schema).chain(forms.flatten().map(|form| resolved(form, &schema)));
    let rows = tables.flat_map(|table| rows(table, &schema));
    let mut keys: Vec<String> = rows
        .filter(|row| !row.required && row.default.is_none())
        .map(|row| row.key)
        .collect();
    keys.dedup();
    keys
}

/// The keys of a plugin that have no description.
pub(crate) fn undocumented_parameters(entry: &Entry) -> impl Iterator<Item = String> {
    let schema = entry.schema();
    let properties = schema
        .get("properties")
        .and_then(|p| p.as_object())
        .cloned()
        .unwrap_or_default();
    properties
        .into_iter()
        .filter(|(_, value)| value.get("description").is_none())
        .map(|(key, _)| key)
}

/// The default of a key in Markdown.
fn default(value: &Value) -> Option<String> {
    let constant = || {
        let constant = value.get("default").filter(|constant| !constant.is_null())?;
        Some(format!("`{}`", as_toml(constant)))
    };
    value[COMPUTED_DEFAULT]
        .as_str()
        .map(str::to_owned)
        .or_else(constant)
}

/// A JSON value as it would be written in a scene file.
fn as_toml(value: &Value) -> String {
    match value {
        Value::Number(number) => match number.as_f64() {
            Some(number) if number.fract() == 0.0 && number.abs() < 1e15 => format!("{number:.0}"),
            _ => number.to_string(),
        },
        Value::Array(items) => {
            let items: Vec<String> = items.iter().map(as_toml).collect();
            format!("[{}]", items.join(", "))
        }
        Value::Object(keys) => {
            let keys: Vec<String> = keys
                .iter()
                .map(|(key, value)| format!("{key} = {}", as_toml(value)))
                .collect();
            format!("{{ {} }}", keys.join(", "))
        }
        other => other.to_string(),
    }
}

fn rows(table: &Value, root: &Value) -> Vec<Row> {
    let required: Vec<&str> = table["required"]
        .as_array()
        .into_iter()
        .flatten()
        .filter_map(Value::as_str)
        .collect();
    let properties: BTreeMap<&String, &Value> =
        table["properties"].as_object().into_iter().flatten().collect();
    let mut rows: Vec<Row> = properties
        .into_iter()
        .filter(|(key, _)| *key != "type")
        .map(|(key, value)| Row {
            key: key.clone(),
            kind: kind(value, root),
            required: required.contains(&key.as_str()),
            default: default(value).filter(|_| !required.contains(&key.as_str())),
            about: one_line(value["description"].as_str().unwrap_or_default()),
        })
        .collect();
    rows.sort_by_key(|row| !row.required);
    rows
}

fn table(rows: &[Row]) -> String {
    let mut text = String::from("| key | value | default | meaning |\n|---|---|---|---|\n");
    for row in rows {
        let default = match (&row.default, row.required) {
            (_, true) => "required",
            (Some(default), false) => default,
            (None, false) => "none",
        };
        let _ = writeln!(
            text,
            "| `{}` | {} | {default} | {} |",
            row.key, row.kind, row.about
        );
    }
    text
}

fn one_line(text: &str) -> String {
    text.replace('\n', " ").replace('|', "\\|")
}

/// Resolves a reference into the definitions.
fn resolved<'a>(value: &'a Value, root: &'a Value) -> &'a Value {
    let name = value["$ref"]
        .as_str()
        .and_then(|name| name.strip_prefix("#/$defs/"));
    name.map_or(value, |name| &root["$defs"][name])
}

/// A description of the values that a key may have.
fn kind(value: &Value, root: &Value) -> String {
    let value = resolved(value, root);
    if let Some(word) = value["const"].as_str() {
        return format!("`\"{word}\"`");
    }
    if let Some(words) = value["enum"].as_array() {
        return words
            .iter()
            .map(|word| format!("`{word}`"))
            .collect::<Vec<_>>()
            .join(", ");
    }
    if let Some(forms) = ["anyOf", "oneOf"].iter().find_map(|key| value[key].as_array()) {
        let mut kinds: Vec<String> = forms
            .iter()
            .map(|form| kind(form, root))
            .filter(|kind| kind != "null")
            .collect();
        kinds.dedup();
        return kinds.join(" or ");
    }
    let types: Vec<&str> = match &value["type"] {
        Value::String(word) => vec![word],
        Value::Array(words) => words
            .iter()
            .filter_map(Value::as_str)
            .filter(|word| *word != "null")
            .collect(),
        _ => Vec::new(),
    };
    let words = types.into_iter().map(|word| match word {
        "array" => array(value, root),
        "object" => "table".to_owned(),
        "string" => "text".to_owned(),
        "number" | "integer" => format!("{word}{}", range(value)),
        other => other.to_owned(),
    });
    let words: Vec<String> = words.collect();
    if words.is_empty() {
        "see the model".to_owned()
    } else {
        words.join(" or ")
    }
}

fn array(value: &Value, root: &Value) -> String {
    let item = kind(&value["items"], root);
    match (value["minItems"].as_u64(), value["maxItems"].as_u64()) {
        (Some(least), Some(most)) if least == most => format!("{least} × {item}"),
        _ => format!("list of {item}"),
    }
}

fn range(value: &Value) -> String {
    let bound = |key: &str, sign: &str| value[key].as_f64().map(|bound| format!("{sign} {bound}"));
    let bounds = [
        bound("minimum", "≥"),
        bound("exclusiveMinimum", ">"),
        bound("maximum", "≤"),
        bound("exclusiveMaximum", "<"),
    ];
    let bounds: Vec<String> = bounds.into_iter().flatten().collect();
    if bounds.is_empty() {
        String::new()
    } else {
        format!(" {}", bounds.join(", "))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn defaults_are_written_as_in_a_scene_file() {
        let shown = |value: Value| default(&value);
        assert_eq!(shown(json!({ "default": 32.0 })), Some("`32`".to_owned()));
        assert_eq!(
            shown(json!({ "default": [0.5, 1.0] })),
            Some("`[0.5, 1]`".to_owned())
        );
        assert_eq!(shown(json!({ "default": "uv" })), Some("`\"uv\"`".to_owned()));
        assert_eq!(
            shown(json!({ "x-default": "that of `k_d`" })),
            Some("that of `k_d`".to_owned())
        );
        assert_eq!(shown(json!({ "default": null })), None);
        assert_eq!(shown(json!({})), None);
    }

    #[test]
    fn kinds_are_put_into_words() {
        let root = json!({ "$defs": { "a": { "oneOf": [{ "const": "x" }, { "const": "y" }] } } });
        let shown = |value: Value| kind(&value, &root);
        assert_eq!(
            shown(json!({ "type": "number", "exclusiveMinimum": 0 })),
            "number > 0"
        );
        assert_eq!(
            shown(json!({ "type": "integer", "minimum": 1, "maximum": 9 })),
            "integer ≥ 1, ≤ 9"
        );
        assert_eq!(shown(json!({ "$ref": "#/$defs/a" })), "`\"x\"` or `\"y\"`");
        let three = json!({ "type": "array", "items": { "type": "number" }, "minItems": 3, "maxItems": 3 });
        assert_eq!(
            shown(json!({ "anyOf": [{ "type": "number" }, three, { "type": "null" }] })),
            "number or 3 × number"
        );
        assert_eq!(shown(json!({ "type": ["boolean", "null"] })), "boolean");
    }
}
