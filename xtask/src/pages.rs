//! Generates a page for every plugin from its schema, the header comment of its file, and its
//! example.

use crate::bench::plugins::{Costs, kept};
use crate::{backends, plugins};
use serde_json::Value;
use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use whitstone::Failure;
use whitstone::core::{Entry, FamilyName, Registry};
use whitstone::image::atomic;
use whitstone::scene::table_schema;
use whitstone::validate::CaseResult;

/// The folder of the pages, which contains nothing else.
pub(crate) const FOLDER: &str = "docs/plugins";

/// The table of contents of docs/, for mdBook.
const SUMMARY: &str = "docs/SUMMARY.md";

/// Results of the stored references, by the name of the renderer that they come from.
pub(crate) type Cases<'a> = [(&'a str, &'a [CaseResult])];

/// All pages and the table of contents. `picture` renders an example to PNG.
pub(crate) fn pages<E>(
    registry: &Registry,
    cases: &Cases<'_>,
    picture: impl Fn(&str) -> Result<Vec<u8>, E>,
) -> Result<Vec<(PathBuf, Vec<u8>)>, E> {
    let costs = kept();
    let mut files = Vec::new();
    let mut summary = String::from("# Whitstone\n\n");
    for (title, file) in documents() {
        let _ = writeln!(summary, "- [{title}]({file})");
    }
    for family in FamilyName::ALL {
        let plural = family.plural();
        let _ = writeln!(summary, "\n# {}{}\n", plural[..1].to_uppercase(), &plural[1..]);
        let own = |entry: &&Entry| entry.family == family && entry.crate_name != backends::CRATE;
        for entry in registry.entries().filter(own) {
            let name = entry.name;
            let _ = writeln!(summary, "- [{name}](plugins/{plural}/{name}.md)");
            let path = PathBuf::from(FOLDER).join(plural);
            files.push((
                path.join(format!("{name}.md")),
                page(entry, cases, &costs).into_bytes(),
            ));
            files.push((path.join(format!("{name}.png")), picture(&example(entry))?));
        }
    }
    files.push((PathBuf::from(SUMMARY), summary.into_bytes()));
    Ok(files)
}

/// Writes a text into a page, between two lines that are kept.
pub(crate) fn between(page: &str, [begin, end]: [&str; 2], text: &str) -> Result<(), Failure> {
    let old = std::fs::read_to_string(page).map_err(Failure::environment)?;
    let (Some(from), Some(to)) = (old.find(begin), old.find(end)) else {
        return Err(Failure::usage(format!(
            "{page}: the marker comments {begin} and {end} are missing"
        )));
    };
    let new = format!("{}{begin}\n\n{text}\n\n{}", &old[..from], &old[to..]);
    atomic::write_bytes(Path::new(page), new.as_bytes()).map_err(Failure::environment)?;
    println!("{page}: written");
    Ok(())
}

/// Title and file of the documents in docs/ itself.
fn documents() -> Vec<(String, String)> {
    let files = std::fs::read_dir("docs").into_iter().flatten().flatten();
    let mut documents: Vec<(String, String)> = files
        .filter_map(|file| {
            let name = file.file_name().into_string().ok()?;
            let text = std::fs::read_to_string(file.path())
                .ok()
                .filter(|_| name.ends_with(".md"))?;
            let title = text.lines().next()?.strip_prefix("# ")?.to_owned();
            (Path::new(SUMMARY) != file.path()).then_some((title, name))
        })
        .collect();
    documents.sort_by(|a, b| a.1.cmp(&b.1));
    documents
}

fn example(entry: &Entry) -> String {
    format!("scenes/{}/{}.toml", entry.family.plural(), entry.name)
}

fn page(entry: &Entry, cases: &Cases<'_>, costs: &Costs) -> String {
    let (family, name) = (entry.family, entry.name);
    let plural = family.plural();
    let file = format!("crates/{plural}/src/{name}.rs");
    let source = std::fs::read_to_string(&file).unwrap_or_default();
    let schema = table_schema(entry);
    let mut text = format!(
        "# {name}\n\n<!-- written by `cargo xtask readme` -->\n\n{}\n\n![{name}]({name}.png)\n\n",
        schema["description"].as_str().unwrap_or_default()
    );
    let up = "../../..";
    let article = if family.singular().starts_with(['a', 'e', 'i', 'o', 'u']) {
        "An"
    } else {
        "A"
    };
    let example = example(entry);
    let _ = writeln!(
        text,
        "{article} {} of [`{file}`]({up}/{file}), feature `{name}` of `{}`. The picture is its example, [`{example}`]({up}/{example}).\n",
        family.singular(),
        entry.crate_name
    );
    text += "## Parameters\n\n";
    parameters(&schema, &mut text);
    let method = plugins::method(&source);
    if !method.is_empty() {
        let _ = writeln!(text, "\n## Method\n\n{method}");
    }
    text += "\n## Validation\n\n";
    if let Some(twin) = plugins::note(&source, "Twin") {
        let _ = writeln!(text, "- Twin: {}", twin.trim_end_matches('.'));
    }
    let laws = plugins::laws(&source);
    if !laws.is_empty() {
        let _ = writeln!(text, "- Property tests: `{}`", laws.join("`, `"));
    }
    let scene = format!("{plural}/{name}");
    let cases = cases
        .iter()
        .flat_map(|(renderer, cases)| cases.iter().map(move |case| (renderer, case)));
    for (renderer, case) in cases.filter(|(_, case)| case.scene == scene) {
        let Some(error) = case.rel_rmse_interior else {
            continue;
        };
        let _ = writeln!(
            text,
            "- Error of the example against {renderer}: {error:.0e} (limit {:.0e}); {} pixels over tolerance, {} unexplained",
            case.limit, case.pixels_over_tolerance, case.unexplained
        );
    }
    let _ = match costs.get(plural).and_then(|costs| costs.get(name)) {
        Some(cost) => writeln!(
            text,
            "- Cost of the example: {cost} ns per ray on one thread, including shading and shadow rays (`cargo xtask bench plugins`)"
        ),
        None => writeln!(text, "- Cost: not measured yet (`cargo xtask bench plugins`)"),
    };
    text
}

/// A table of the keys, one for each form if there are several.
fn parameters(schema: &Value, text: &mut String) {
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
