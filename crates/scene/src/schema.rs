//! The JSON Schema of whole scenes, composed of those of the registered plugins.

use crate::AUTO;
use serde_json::{Map, Value, json};
use whitstone_core::{Entry, FamilyName, Registry};

/// The dialect of JSON Schema.
const DIALECT: &str = "https://json-schema.org/draft/2020-12/schema";
/// The key with which a plugin's schema marks the place of an inline plugin of a family.
const FAMILY_MARK: &str = "x-family";
/// The definition of a transform step.
const STEP: &str = "transform_step";

/// The schema of a scene file with the plugins of a registry. It does not require a camera, because
/// a file that others include has none. Apart from that, the loader rejects everything that the
/// schema rejects.
pub fn scene_schema(registry: &Registry) -> Value {
    let mut definitions = Map::new();
    for family in FamilyName::ALL {
        let entries = registry.entries().filter(|entry| entry.family == family);
        let mut choices = Vec::new();
        for entry in entries {
            let name = definition_name(entry);
            let schema = plugin_schema(entry, &mut definitions);
            definitions.insert(name.clone(), schema);
            choices.push(reference(&name));
        }
        if family == FamilyName::Accelerator {
            choices.push(object(
                "Chosen by the program; `whitstone explain` reports the choice and its reason.",
                json!({ "type": { "const": AUTO } }),
                &["type"],
            ));
        }
        // `oneOf` selects the matching choice by its `type`. With `anyOf`, editors would offer the
        // keys of all choices.
        definitions.insert(family.singular().to_owned(), json!({ "oneOf": choices }));
    }
    definitions.insert(STEP.to_owned(), transform_step());
    json!({
        "$schema": DIALECT,
        "title": "Whitstone scene",
        "description": "A scene of the Whitted model; see docs/whitted-model.md.",
        "type": "object",
        "properties": top_level(),
        "additionalProperties": false,
        "$defs": definitions,
    })
}

/// The schema of one plugin's table, with the keys that every plugin of its family has. An inline
/// plugin in it is any table with a `type`; the schema of scenes lists the types.
pub fn table_schema(entry: &Entry) -> Value {
    let mut definitions = Map::new();
    let mut schema = plugin_schema(entry, &mut definitions);
    let inline =
        json!({ "type": "object", "properties": { "type": { "type": "string" } }, "required": ["type"] });
    for family in FamilyName::ALL {
        definitions.insert(family.singular().to_owned(), inline.clone());
    }
    definitions.insert(STEP.to_owned(), transform_step());
    if let Value::Object(map) = &mut schema {
        map.insert("$schema".to_owned(), json!(DIALECT));
        let text = map.values().map(Value::to_string).collect::<String>();
        let mut used = Map::new();
        // A definition may need later ones; chains are short.
        let mut open = vec![text];
        while let Some(text) = open.pop() {
            for (name, value) in &definitions {
                if !used.contains_key(name) && text.contains(&format!("\"#/$defs/{name}\"")) {
                    open.push(value.to_string());
                    used.insert(name.clone(), value.clone());
                }
            }
        }
        if !used.is_empty() {
            map.insert("$defs".to_owned(), Value::Object(used));
        }
    }
    schema
}

fn top_level() -> Value {
    let one = |family: FamilyName, text: &str| json!({ "description": text, "allOf": [reference(family.singular())] });
    let by_id = |family: FamilyName, text: &str| {
        json!({
            "description": text,
            "type": "object",
            "additionalProperties": reference(family.singular()),
        })
    };
    let list = |family: FamilyName, text: &str| json!({ "description": text, "type": "array", "items": reference(family.singular()) });
    json!({
        "include": {
            "description": "Scene files to include; paths are relative to this file.",
            "anyOf": [{ "type": "string" }, { "type": "array", "items": { "type": "string" } }],
        },
        "import": { "description": "Files of other formats to import.", "type": "array", "items": import() },
        "film": film(),
        "camera": one(FamilyName::Camera, "The camera; required in the scene, in this file or an included one."),
        "sampler": one(FamilyName::Sampler, "Sample positions in a pixel; \"center\" if omitted."),
        "integrator": one(FamilyName::Integrator, "The rendering method; \"whitted\" if omitted."),
        "accelerator": one(
            FamilyName::Accelerator,
            "The acceleration structure, which does not affect the image; \"auto\" if omitted.",
        ),
        "light": list(FamilyName::Light, "Lights."),
        "texture": by_id(FamilyName::Texture, "Shared textures by id."),
        "material": by_id(FamilyName::Material, "Shared materials by id."),
        "shape": list(FamilyName::Shape, "Shapes; the index of a shape is its `shape_id`."),
        "group": {
            "description": "Groups of shapes by id, instantiated by shapes of type \"instance\".",
            "type": "object",
            "additionalProperties": group(),
        },
        "expect": expect(),
    })
}

fn import() -> Value {
    let part = |what: &str| json!({ "description": what, "type": ["string", "integer"] });
    object(
        "A file of another format, such as glTF, as a part of this scene.",
        json!({
            "file": { "description": "The file; its path is relative to this file.", "type": "string" },
            "transform": {
                "description": "Transform of everything in it: one step, or steps in the order in which they are applied.",
                "default": [],
                "anyOf": steps(),
            },
            "prefix": {
                "description": "Prefix of the ids that it defines; its name and a slash if omitted.",
                "type": "string",
            },
            "scene": part("Name or index of the scene in it."),
            "node": part("Name or index of the node to import, with all nodes below it."),
            "camera": part("Name or index of its camera; the first if omitted."),
            "lights": {
                "description": "Whether its lights are imported.",
                "type": "boolean",
                "default": true,
            },
            "photometric": {
                "description": "Whether intensities in candela and lux are converted by 683 lm/W; otherwise the numbers are used as W/sr and W/m2.",
                "type": "boolean",
                "default": false,
            },
            "materials": {
                "description": "Ids of materials to use instead of those of the file, by their names there.",
                "type": "object",
                "additionalProperties": { "type": "string" },
            },
            "allow_outside": {
                "description": "Whether files outside of its folder may be read.",
                "type": "boolean",
                "default": false,
            },
        }),
        &["file"],
    )
}

fn group() -> Value {
    object(
        "A group of shapes, with its own coordinate space.",
        json!({
            "accelerator": {
                "description": "The acceleration structure of the group, which does not affect the image; \"auto\" if omitted.",
                "allOf": [reference(FamilyName::Accelerator.singular())],
            },
            "shape": {
                "description": "The shapes; at least one.",
                "type": "array",
                "minItems": 1,
                "items": reference(FamilyName::Shape.singular()),
            },
        }),
        &["shape"],
    )
}

fn film() -> Value {
    let pixels = |text: &str| json!({ "description": text, "type": "integer", "minimum": 1, "maximum": 65536, "default": 512 });
    object(
        "The image.",
        json!({
            "width": pixels("Number of columns."),
            "height": pixels("Number of rows."),
            "time": {
                "description": "The time in seconds at which moving shapes are seen, or the shutter: the image is then the mean of the images at the middles of `count` equal intervals.",
                "default": 0,
                "anyOf": [{ "type": "number" }, shutter()],
            },
            "aovs": {
                "description": "Layers to write in addition to the radiance.",
                "type": "array",
                "uniqueItems": true,
                "items": { "enum": ["depth", "normal", "uv", "shape_id", "primitive_id"] },
            },
            "paths": {
                "description": "Layers of the radiance by classes of light paths: for each name a path expression, such as \"E S* D L\". Events: E eye, S mirror reflection, G ray of a glossy reflection, T transmission, D local illumination, L light, A ambient term, O emission, B background.",
                "type": "object",
                "maxProperties": 64,
                "patternProperties": { "^[A-Za-z0-9_-]+$": { "type": "string" } },
                "additionalProperties": false,
            },
        }),
        &[],
    )
}

fn shutter() -> Value {
    object(
        "A shutter that is open for some time.",
        json!({
            "open": { "description": "When it opens, in seconds.", "type": "number" },
            "close": { "description": "When it closes, in seconds; not before it opens.", "type": "number" },
            "count": { "description": "Number of images.", "type": "integer", "minimum": 1, "maximum": 256 },
        }),
        &["open", "close", "count"],
    )
}

/// The steps of a transform.
fn steps() -> Value {
    json!([reference(STEP), { "type": "array", "items": reference(STEP) }])
}

fn keyframe() -> Value {
    object(
        "The transform at a time.",
        json!({
            "time": { "description": "In seconds.", "type": "number" },
            "transform": {
                "description": "Steps that follow the shape's own; the same kinds of steps in all keyframes.",
                "anyOf": steps(),
            },
        }),
        &["time", "transform"],
    )
}

fn expect() -> Value {
    object(
        "Validation limits that differ from the defaults, with the reason.",
        json!({
            "rel_rmse_interior": {
                "description": "Largest `rel_rmse_interior` that passes.",
                "type": "number",
                "exclusiveMinimum": 0,
            },
            "explained": {
                "description": "Largest number of explained pixels that passes.",
                "type": "integer",
                "minimum": 0,
                "maximum": u32::MAX,
            },
            "reason": { "description": "Why the limits differ; required with any other key.", "type": "string" },
        }),
        &[],
    )
}

fn transform_step() -> Value {
    let numbers = |count: usize| json!({ "type": "array", "items": { "type": "number" }, "minItems": count, "maxItems": count });
    let rotate = object(
        "Rotation, counter-clockwise when the axis points towards the viewer.",
        json!({ "axis": numbers(3), "degrees": { "type": "number" } }),
        &["axis", "degrees"],
    );
    let matrix = json!({ "type": "array", "items": numbers(4), "minItems": 3, "maxItems": 3 });
    let scale = json!({ "anyOf": [{ "type": "number" }, numbers(3)] });
    json!({ "oneOf": [
        object("Translates, in metres.", json!({ "translate": numbers(3) }), &["translate"]),
        object("Scales, uniformly or per axis.", json!({ "scale": scale }), &["scale"]),
        object("Rotates.", json!({ "rotate": rotate }), &["rotate"]),
        object("Three rows of an affine matrix.", json!({ "matrix": matrix }), &["matrix"]),
    ] })
}

/// The keys that every plugin of a family has besides its own.
fn common_keys(family: FamilyName) -> Value {
    match family {
        FamilyName::Shape => json!({
            "id": {
                "description": "A name, unique among the shapes.",
                "type": "string",
                "x-default": "none",
            },
            "material": {
                "description": "Id of a shared material, or an inline material.",
                "x-default": "grey `matte`",
                "anyOf": [{ "type": "string" }, reference(FamilyName::Material.singular())],
            },
            "casts_shadow": {
                "description": "Whether the shape casts shadows. Without, light passes through it, and it is visible as always.",
                "type": "boolean",
                "default": true,
            },
            "transform": {
                "description": "From object to world space: one step, or steps in the order in which they are applied.",
                "default": [],
                "anyOf": steps(),
            },
            "motion": {
                "description": "Keyframes of the motion, by ascending times. Between them, each number of their steps is interpolated linearly.",
                "type": "array",
                "minItems": 2,
                "items": keyframe(),
                "x-default": "none",
            },
        }),
        _ => json!({}),
    }
}

/// The plugin's own schema with `type` and the common keys. Its definitions are moved to
/// `definitions`.
fn plugin_schema(entry: &Entry, definitions: &mut Map<String, Value>) -> Value {
    let prefix = definition_name(entry);
    let mut schema = Value::from(entry.schema());
    relocate(&mut schema, &prefix);
    let Value::Object(map) = &mut schema else {
        return schema;
    };
    map.remove("$schema");
    if let Some(Value::Object(own)) = map.remove("$defs") {
        definitions.extend(
            own.into_iter()
                .map(|(name, value)| (format!("{prefix}.{name}"), value)),
        );
    }
    map.insert("title".to_owned(), json!(entry.name));
    let properties = map.entry("properties").or_insert_with(|| json!({}));
    if let (Value::Object(properties), Value::Object(common)) = (properties, common_keys(entry.family)) {
        properties.insert("type".to_owned(), json!({ "const": entry.name }));
        properties.extend(common);
    }
    let required = map.entry("required").or_insert_with(|| json!([]));
    if let Value::Array(required) = required {
        required.insert(0, json!("type"));
    }
    schema
}

/// Updates references to the plugin's own definitions to their new place, and inserts references to
/// families at the places of inline plugins.
fn relocate(schema: &mut Value, prefix: &str) {
    match schema {
        Value::Array(items) => items.iter_mut().for_each(|item| relocate(item, prefix)),
        Value::Object(map) => {
            if let Some(Value::String(family)) = map.get(FAMILY_MARK) {
                *schema = reference(&family.clone());
                return;
            }
            if let Some(Value::String(target)) = map.get_mut("$ref")
                && let Some(name) = target.strip_prefix("#/$defs/")
                // The transform step is a definition of the whole schema, not of the plugin.
                && name != STEP
            {
                *target = format!("#/$defs/{prefix}.{name}");
            }
            map.values_mut().for_each(|value| relocate(value, prefix));
        }
        _ => {}
    }
}

fn definition_name(entry: &Entry) -> String {
    format!("{}.{}", entry.family.singular(), entry.name)
}

fn reference(definition: &str) -> Value {
    json!({ "$ref": format!("#/$defs/{definition}") })
}

fn object(description: &str, properties: Value, required: &[&str]) -> Value {
    json!({
        "description": description,
        "type": "object",
        "properties": properties,
        "required": required,
        "additionalProperties": false,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::document::TOP_LEVEL;

    #[test]
    fn the_schema_has_every_table_of_a_scene() {
        let schema = scene_schema(&Registry::default());
        let properties = schema["properties"].as_object().unwrap();
        let mut named: Vec<&str> = properties.keys().map(String::as_str).collect();
        let mut known = TOP_LEVEL.to_vec();
        named.sort_unstable();
        known.sort_unstable();
        assert_eq!(named, known);
    }
}
