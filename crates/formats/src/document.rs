//! A scene that is written as TOML.

use std::collections::{BTreeSet, HashMap};
use std::fmt::Write;
use toml::{Table, Value};
use whitstone_core::DAffine3;

/// Layers of masks that a ray passes through.
const LAYERS: i64 = 32;

/// The tables of a scene, in the order in which they are written.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Document {
    /// `[film]`, `[camera]`, `[sampler]`, `[integrator]`: name and keys.
    pub single: Vec<(&'static str, Table)>,
    /// `[[light]]`s.
    pub lights: Vec<Table>,
    /// `[texture.ID]`s.
    pub textures: Vec<(String, Table)>,
    /// `[material.ID]`s.
    pub materials: Vec<(String, Table)>,
    /// `[group.ID]`s and their shapes.
    pub groups: Vec<(String, Vec<Table>)>,
    /// `[[shape]]`s.
    pub shapes: Vec<Table>,
}

impl Document {
    /// Where a material spreads its reflections, leaves out those with little effect: after a few
    /// bounces there would be more of them than a scene may have.
    pub(crate) fn bound_reflections(&mut self) {
        let materials = self.materials.iter().map(|(_, table)| table);
        let grouped = self.groups.iter().flat_map(|(_, shapes)| shapes);
        let spreads = |table: &Table| contains(table, "glossy");
        if !materials.chain(grouped).chain(&self.shapes).any(spreads) {
            return;
        }
        for (name, table) in &mut self.single {
            if *name == "integrator" && !table.contains_key("min_contribution") {
                table.insert("min_contribution".to_owned(), Value::Float(1e-3));
            }
        }
    }

    /// Where a material is a mask, lets rays pass through more layers of it than by default. Rays
    /// that contribute little are left out, which bounds the number of reflections.
    pub(crate) fn pass_through_layers(&mut self) {
        if self.materials.iter().any(|(_, table)| contains(table, "mask")) {
            let keys = [
                ("max_depth", Value::Integer(LAYERS)),
                ("min_contribution", Value::Float(1e-3)),
            ];
            self.single.push(("integrator", typed("whitted", keys)));
        }
    }

    /// The scene as TOML: a section per table, nested tables inline.
    pub fn to_toml(&self) -> String {
        let mut text = String::new();
        let mut section = |header: String, table: &Table| {
            if !text.is_empty() {
                text.push('\n');
            }
            writeln!(text, "{header}").expect("a string can be written to");
            // The type comes first.
            let kind = table.get_key_value("type");
            let rest = table.iter().filter(|(key, _)| *key != "type");
            for (key, value) in kind.into_iter().chain(rest) {
                writeln!(text, "{} = {value}", quoted_key(key)).expect("a string can be written to");
            }
        };
        for (name, table) in &self.single {
            section(format!("[{name}]"), table);
        }
        for table in &self.lights {
            section("[[light]]".to_owned(), table);
        }
        for (family, tables) in [("texture", &self.textures), ("material", &self.materials)] {
            for (id, table) in tables {
                section(format!("[{family}.{}]", quoted_key(id)), table);
            }
        }
        for (id, shapes) in &self.groups {
            for shape in shapes {
                section(format!("[[group.{}.shape]]", quoted_key(id)), shape);
            }
        }
        for table in &self.shapes {
            section("[[shape]]".to_owned(), table);
        }
        text
    }
}

/// Whether a table is a plugin of this type, or contains one.
fn contains(table: &Table, kind: &str) -> bool {
    let inner = |table: &Table| contains(table, kind);
    let within = |value: &Value| match value {
        Value::Table(table) => inner(table),
        Value::Array(values) => values.iter().filter_map(Value::as_table).any(inner),
        _ => false,
    };
    table.get("type").and_then(Value::as_str) == Some(kind) || table.values().any(within)
}

/// A key as TOML, in quotes if it needs them.
fn quoted_key(key: &str) -> String {
    let bare = |c: char| c.is_ascii_alphanumeric() || c == '_' || c == '-';
    if !key.is_empty() && key.chars().all(bare) {
        key.to_owned()
    } else {
        // On one line, as keys must be: the escapes of JSON are those of TOML, which also wants one
        // for DEL.
        let quoted = serde_json::Value::from(key).to_string();
        quoted.replace('\u{7f}', "\\u007f")
    }
}

/// A table from its keys and values.
pub fn table<const N: usize>(entries: [(&str, Value); N]) -> Table {
    entries
        .into_iter()
        .map(|(key, value)| (key.to_owned(), value))
        .collect()
}

/// A plugin's table from its type, keys and values.
pub fn typed<const N: usize>(kind: &str, entries: [(&str, Value); N]) -> Table {
    let mut all = table(entries);
    all.insert("type".to_owned(), Value::String(kind.to_owned()));
    all
}

/// Numbers as a TOML array.
pub fn numbers(values: impl IntoIterator<Item = f64>) -> Value {
    Value::Array(values.into_iter().map(Value::Float).collect())
}

/// A colour: one number if it is grey.
pub fn color(values: [f64; 3]) -> Value {
    if values.iter().all(|value| *value == values[0]) {
        Value::Float(values[0])
    } else {
        numbers(values)
    }
}

/// The value of the key `transform` for an affine map: one step with three rows.
pub fn transform(map: &DAffine3) -> Value {
    let [x, y, z] = [map.matrix3.row(0), map.matrix3.row(1), map.matrix3.row(2)];
    let rows = [
        [x.x, x.y, x.z, map.translation.x],
        [y.x, y.y, y.z, map.translation.y],
        [z.x, z.y, z.z, map.translation.z],
    ];
    let rows = rows.map(numbers).to_vec();
    Value::Table(table([("matrix", Value::Array(rows))]))
}

/// Distinct ids from names, which may be absent or repeated.
#[derive(Debug, Default)]
pub struct Ids {
    prefix: String,
    used: BTreeSet<String>,
    next: HashMap<String, usize>,
}

impl Ids {
    /// Ids that begin with a prefix.
    pub fn new(prefix: &str) -> Self {
        Self {
            prefix: prefix.to_owned(),
            ..Self::default()
        }
    }

    /// An id that no other call returns: the name if it is free, else with a number.
    pub fn unique(&mut self, name: &str) -> String {
        let wanted = format!("{}{name}", self.prefix);
        if self.used.insert(wanted.clone()) {
            return wanted;
        }
        let number = self.next.entry(wanted.clone()).or_insert(2);
        loop {
            let id = format!("{wanted}-{number}");
            *number += 1;
            if self.used.insert(id.clone()) {
                return id;
            }
        }
    }
}

/// Shared tables of a document, such as its textures: equal ones are written once.
#[derive(Debug, Default)]
pub(crate) struct Shared {
    ids: Ids,
    /// Ids by the tables' text.
    known: HashMap<String, String>,
}

impl Shared {
    /// Tables whose ids begin with a prefix.
    pub(crate) fn new(prefix: &str) -> Self {
        Self {
            ids: Ids::new(prefix),
            known: HashMap::new(),
        }
    }

    /// The id of a table, which is added to `list` if it is new; `name` is the id that it should
    /// have.
    pub(crate) fn id(&mut self, list: &mut Vec<(String, Table)>, name: &str, table: Table) -> String {
        self.id_of(table.to_string(), list, name, table)
    }

    /// [`Self::id`], except that a table with another name is another table.
    pub(crate) fn named_id(&mut self, list: &mut Vec<(String, Table)>, name: &str, table: Table) -> String {
        self.id_of(format!("{name} {table}"), list, name, table)
    }

    fn id_of(&mut self, text: String, list: &mut Vec<(String, Table)>, name: &str, table: Table) -> String {
        if let Some(id) = self.known.get(&text) {
            return id.clone();
        }
        let id = self.ids.unique(name);
        self.known.insert(text, id.clone());
        list.push((id.clone(), table));
        id
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_document_is_valid_toml_in_the_order_of_a_reader() {
        let sphere = table([
            ("radius", Value::Float(2.0)),
            ("type", Value::String("sphere".into())),
        ]);
        let document = Document {
            single: vec![("film", table([("width", Value::Integer(4))]))],
            lights: vec![table([("type", Value::String("ambient".into()))])],
            materials: vec![("a b\"c".into(), table([("type", Value::String("matte".into()))]))],
            groups: vec![("g".into(), vec![sphere.clone()])],
            shapes: vec![sphere],
            ..Document::default()
        };
        let text = document.to_toml();
        let parsed: Table = toml::from_str(&text).unwrap();
        assert_eq!(parsed["group"]["g"]["shape"][0]["radius"].as_float(), Some(2.0));
        assert_eq!(parsed["material"]["a b\"c"]["type"].as_str(), Some("matte"));
        assert!(text.starts_with("[film]\nwidth = 4\n"));
        assert!(text.ends_with("[[shape]]\ntype = \"sphere\"\nradius = 2.0\n"));
    }

    #[test]
    fn ids_are_distinct() {
        let mut ids = Ids::new("x/");
        let all = ["a", "a", "a-2", "a"].map(|name| ids.unique(name));
        assert_eq!(all, ["x/a", "x/a-2", "x/a-2-2", "x/a-3"]);
    }
}
