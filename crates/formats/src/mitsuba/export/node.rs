//! Mitsuba objects to write, as XML and as a Python dictionary.

use whitstone_core::{DAffine3, DVec3};

/// An object: an element with a type.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Node {
    /// The name of the element, such as `bsdf`.
    pub(super) family: &'static str,
    pub(super) plugin: String,
    pub(super) id: Option<String>,
    /// Parameters and objects inside; an object may have an empty name.
    pub(super) children: Vec<(String, Item)>,
}

/// A parameter.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Item {
    Boolean(bool),
    Integer(i64),
    Float(f64),
    Text(String),
    Point(DVec3),
    Vector(DVec3),
    Color([f64; 3]),
    Transform(DAffine3),
    Node(Node),
    /// The id of another object.
    Reference(String),
}

impl Node {
    pub(super) fn new(family: &'static str, plugin: &str) -> Self {
        Self {
            family,
            plugin: plugin.to_owned(),
            id: None,
            children: Vec::new(),
        }
    }

    /// Adds a parameter.
    #[must_use]
    pub(super) fn with(mut self, name: &str, item: Item) -> Self {
        self.children.push((name.to_owned(), item));
        self
    }

    /// Adds an object without a name.
    #[must_use]
    pub(super) fn containing(self, node: Node) -> Self {
        self.with("", Item::Node(node))
    }

    pub(super) fn push(&mut self, name: &str, item: Item) {
        self.children.push((name.to_owned(), item));
    }

    /// The scene as XML.
    pub(super) fn to_xml(&self) -> String {
        let mut text =
            String::from("<?xml version=\"1.0\" encoding=\"utf-8\"?>\n<scene version=\"3.0.0\">\n");
        for (name, item) in &self.children {
            write_xml(&mut text, 1, name, item);
        }
        text.push_str("</scene>\n");
        text
    }

    /// The scene as a Python file that defines the dictionary `scene`.
    pub(super) fn to_python(&self) -> String {
        let mut text = String::from(
            "\"\"\"A scene for `mitsuba.load_dict`. Select a variant in RGB before it is imported, for example by\n\
             `mitsuba.set_variant(\"scalar_rgb\")`; the dictionary is `scene`.\n\"\"\"\n\n\
             import os\n\nimport mitsuba as mi\n\nHERE = os.path.dirname(os.path.abspath(__file__))\n\nscene = ",
        );
        write_python(&mut text, 0, self);
        text.push('\n');
        text
    }
}

/// Text between quotes of XML.
fn escaped(text: &str) -> String {
    let mut result = String::new();
    for c in text.chars() {
        match c {
            '&' => result.push_str("&amp;"),
            '<' => result.push_str("&lt;"),
            '>' => result.push_str("&gt;"),
            '"' => result.push_str("&quot;"),
            // Mitsuba substitutes parameters.
            '$' => result.push_str("\\$"),
            '\n' | '\r' | '\t' => result.push_str(&format!("&#{};", u32::from(c))),
            // XML has no other control characters.
            c if c.is_control() => result.push('_'),
            c => result.push(c),
        }
    }
    result
}

fn write_xml(text: &mut String, depth: usize, name: &str, item: &Item) {
    let indent = "    ".repeat(depth);
    let name = escaped(name);
    let value = |tag: &str, value: String| format!("{indent}<{tag} name=\"{name}\" value=\"{value}\"/>\n");
    let line = match item {
        Item::Boolean(flag) => value("boolean", flag.to_string()),
        Item::Integer(number) => value("integer", number.to_string()),
        Item::Float(number) => value("float", number.to_string()),
        Item::Text(string) => value("string", escaped(string)),
        Item::Point(p) => value("point", format!("{}, {}, {}", p.x, p.y, p.z)),
        Item::Vector(p) => value("vector", format!("{}, {}, {}", p.x, p.y, p.z)),
        Item::Color([r, g, b]) => value("rgb", format!("{r}, {g}, {b}")),
        Item::Transform(map) => {
            let values: Vec<String> = rows(map).iter().flatten().map(f64::to_string).collect();
            format!(
                "{indent}<transform name=\"{name}\">\n{indent}    <matrix value=\"{}\"/>\n{indent}</transform>\n",
                values.join(" ")
            )
        }
        Item::Reference(id) if name.is_empty() => format!("{indent}<ref id=\"{}\"/>\n", escaped(id)),
        Item::Reference(id) => format!("{indent}<ref name=\"{name}\" id=\"{}\"/>\n", escaped(id)),
        Item::Node(node) => {
            let mut attributes = format!("type=\"{}\"", escaped(&node.plugin));
            if let Some(id) = &node.id {
                attributes.push_str(&format!(" id=\"{}\"", escaped(id)));
            }
            if !name.is_empty() {
                attributes.push_str(&format!(" name=\"{name}\""));
            }
            if node.children.is_empty() {
                format!("{indent}<{} {attributes}/>\n", node.family)
            } else {
                text.push_str(&format!("{indent}<{} {attributes}>\n", node.family));
                for (name, item) in &node.children {
                    write_xml(text, depth + 1, name, item);
                }
                format!("{indent}</{}>\n", node.family)
            }
        }
    };
    text.push_str(&line);
}

fn rows(map: &DAffine3) -> [[f64; 4]; 4] {
    let row = |i: usize| {
        let row = map.matrix3.row(i);
        [row.x, row.y, row.z, map.translation[i]]
    };
    [row(0), row(1), row(2), [0.0, 0.0, 0.0, 1.0]]
}

/// A string of Python.
fn quoted(text: &str) -> String {
    let mut result = String::from("\"");
    for c in text.chars() {
        match c {
            '"' | '\\' => {
                result.push('\\');
                result.push(c);
            }
            c if c.is_control() => result.push_str(&format!("\\x{:02x}", u32::from(c).min(255))),
            c => result.push(c),
        }
    }
    result.push('"');
    result
}

fn write_python(text: &mut String, depth: usize, node: &Node) {
    let indent = "    ".repeat(depth + 1);
    text.push_str("{\n");
    text.push_str(&format!("{indent}\"type\": {},\n", quoted(&node.plugin)));
    let mut unnamed = 0;
    for (name, item) in &node.children {
        // Shared objects are found by their keys.
        let key = match item {
            Item::Node(Node { id: Some(id), .. }) if depth == 0 => id.clone(),
            _ if name.is_empty() => {
                unnamed += 1;
                format!("child{unnamed}")
            }
            _ => name.clone(),
        };
        text.push_str(&format!("{indent}{}: ", quoted(&key)));
        match item {
            Item::Boolean(flag) => text.push_str(if *flag { "True" } else { "False" }),
            Item::Integer(number) => text.push_str(&format!("{number}")),
            Item::Float(number) => text.push_str(&format!("{number:?}")),
            Item::Text(string) if name == "filename" => {
                text.push_str(&format!("os.path.join(HERE, {})", quoted(string)));
            }
            Item::Text(string) => text.push_str(&quoted(string)),
            Item::Point(p) | Item::Vector(p) => text.push_str(&format!("[{:?}, {:?}, {:?}]", p.x, p.y, p.z)),
            Item::Color(value) => text.push_str(&format!("{{\"type\": \"rgb\", \"value\": {value:?}}}")),
            Item::Transform(map) => text.push_str(&format!("mi.ScalarTransform4f({:?})", rows(map))),
            Item::Reference(id) => text.push_str(&format!("{{\"type\": \"ref\", \"id\": {}}}", quoted(id))),
            Item::Node(node) => write_python(text, depth + 1, node),
        }
        text.push_str(",\n");
    }
    text.push_str(&"    ".repeat(depth));
    text.push('}');
}

#[cfg(test)]
mod tests {
    use super::*;

    fn scene() -> Node {
        let bsdf = Node {
            id: Some("a&\"b\"".into()),
            ..Node::new("bsdf", "diffuse").with("reflectance", Item::Color([0.5, 0.25, 1e-9]))
        };
        let shape = Node::new("shape", "obj")
            .with("filename", Item::Text("a$b\\c.obj".into()))
            .with("to_world", Item::Transform(DAffine3::IDENTITY))
            .with("", Item::Reference("a&\"b\"".into()));
        Node::new("scene", "scene").containing(bsdf).containing(shape)
    }

    #[test]
    fn xml_is_escaped() {
        let text = scene().to_xml();
        assert!(text.contains("<bsdf type=\"diffuse\" id=\"a&amp;&quot;b&quot;\">"));
        assert!(text.contains("<string name=\"filename\" value=\"a\\$b\\c.obj\"/>"));
        assert!(text.contains("<matrix value=\"1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1\"/>"));
        assert!(text.contains("<rgb name=\"reflectance\" value=\"0.5, 0.25, 0.000000001\"/>"));
    }

    #[test]
    fn python_is_quoted() {
        let text = scene().to_python();
        assert!(text.contains("    \"a&\\\"b\\\"\": {\n        \"type\": \"diffuse\","));
        assert!(text.contains("\"filename\": os.path.join(HERE, \"a$b\\\\c.obj\"),"));
        assert!(text.contains("\"value\": [0.5, 0.25, 1e-9]"));
    }
}
