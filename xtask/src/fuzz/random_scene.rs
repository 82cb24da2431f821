//! Random scenes from the JSON Schema of scenes.

use serde_json::{Map, Value as Json};
use toml::{Table, Value};
use whitstone_testkit::Random;

/// Deeper tables take the alternative that refers to no other definition, if there is one.
const DEEP: usize = 5;
/// An optional key has a chance of one in this number to be present.
const RARE: usize = 4;

/// How often a part of a scene is tried.
const TRIES: usize = 5;

/// Ids of the shared materials and textures, which every scene defines.
const IDS: [&str; 2] = ["one", "two"];
const MESHES: [&str; 4] = [
    "assets/star.obj",
    "assets/torus.obj",
    "assets/terrain.ply",
    "assets/icosphere.ply",
];
const IMAGES: [&str; 3] = ["assets/checker.png", "assets/corners.png", "assets/leaf.png"];
const EXTREMES: [f64; 10] = [0.0, -0.0, 1e-320, 1e-30, 1e-9, 1e9, 1e30, 1e308, -1e308, f64::NAN];

/// How far the numbers of a scene are from ordinary ones.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Numbers {
    /// Tenths up to 2.
    Plain,
    /// Of any magnitude up to a million.
    Spread,
    /// Also those of [`EXTREMES`].
    Extreme,
}

pub(super) struct Generator<'a> {
    definitions: &'a Map<String, Json>,
    random: Random,
    numbers: Numbers,
    /// Shapes that have an id.
    shapes: usize,
}

impl<'a> Generator<'a> {
    /// `schema` is that of a whole scene; the same seed gives the same scene.
    pub(super) fn new(schema: &'a Json, seed: u64) -> Result<Self, String> {
        let definitions = schema["$defs"].as_object();
        let mut random = Random::new(seed);
        let numbers = match random.below(10) {
            0..6 => Numbers::Plain,
            6..9 => Numbers::Spread,
            _ => Numbers::Extreme,
        };
        Ok(Self {
            definitions: definitions.ok_or("the schema has no definitions")?,
            random,
            numbers,
            shapes: 0,
        })
    }

    /// Whether the scene may have numbers that single precision does not hold.
    pub(super) fn is_extreme(&self) -> bool {
        self.numbers == Numbers::Extreme
    }

    /// A scene of at most 16 x 12 pixels. Each part is tried some times until `is_valid` accepts
    /// a scene with it, and is otherwise left out.
    pub(super) fn scene(mut self, is_valid: &dyn Fn(&Table) -> bool) -> Table {
        let layers = ["depth", "normal", "uv", "shape_id", "primitive_id"];
        let layers = layers.into_iter().filter(|_| self.random.below(2) == 0);
        let layers: Vec<Value> = layers.map(Value::from).collect();
        let mut scene = Table::from_iter([("film".to_owned(), film(16, 12, layers).into())]);
        let sphere = Table::from_iter([("type".to_owned(), Value::from("sphere"))]);
        scene.insert("shape".into(), vec![Value::from(sphere.clone())].into());
        let plain = [("texture", "constant"), ("material", "matte")];
        for (family, name) in plain {
            let shared = Table::from_iter([("type".to_owned(), Value::from(name))]);
            let shared = IDS.map(|id| (id.to_owned(), Value::from(shared.clone())));
            scene.insert(family.into(), Table::from_iter(shared).into());
        }
        let group = |shape: Value| {
            let group = Table::from_iter([("shape".to_owned(), Value::from(vec![shape]))]);
            Value::from(Table::from_iter([("group".to_owned(), group.into())]))
        };
        scene.insert("group".into(), group(sphere.into()));
        if self.random.below(8) > 0 {
            scene.insert("light".into(), vec![lamp(), ambient()].into());
        }

        let mut grow = |scene: &mut Table, add: &mut dyn FnMut(&mut Self, &mut Table)| {
            for _ in 0..TRIES {
                let mut grown = scene.clone();
                add(&mut self, &mut grown);
                if grown == *scene || is_valid(&grown) {
                    *scene = grown;
                    return;
                }
            }
        };
        for (family, _) in plain {
            for id in IDS {
                grow(&mut scene, &mut |this, scene| {
                    if let Some(shared) = scene.get_mut(family).and_then(Value::as_table_mut) {
                        shared.insert(id.to_owned(), this.named(family, 2));
                    }
                });
            }
        }
        grow(&mut scene, &mut |this, scene| {
            scene.insert("group".into(), group(this.named("shape", 2)));
        });
        for family in ["camera", "sampler", "integrator"] {
            grow(&mut scene, &mut |this, scene| {
                if family == "camera" || this.random.below(3) == 0 {
                    scene.insert(family.into(), this.named(family, 0));
                }
            });
        }
        // Shapes and lights are tried alone, because many together take long to build.
        let few = scene.clone();
        let mut added = Vec::new();
        for (family, most) in [("shape", 5), ("light", 3)] {
            for _ in 0..most {
                if self.random.below(2) > 0 {
                    continue;
                }
                for _ in 0..TRIES {
                    let item = match family {
                        "shape" => self.placed_shape(),
                        _ => self.named(family, 0),
                    };
                    let mut grown = few.clone();
                    push(&mut grown, family, item.clone());
                    if is_valid(&grown) {
                        push(&mut scene, family, item);
                        added.push(family);
                        break;
                    }
                }
            }
        }
        // Some that are valid alone are not valid together.
        while !is_valid(&scene)
            && let Some(family) = added.pop()
        {
            scene
                .get_mut(family)
                .and_then(Value::as_array_mut)
                .and_then(Vec::pop);
        }
        // Milliseconds a ray, and a tenth of one.
        let slow = [
            ("fractal", [3_i64, 2]),
            ("implicit", [8, 6]),
            ("isosurface", [8, 6]),
        ];
        let whole = Value::from(scene.clone());
        if let Some((_, [width, height])) = slow.into_iter().find(|(kind, _)| contains(&whole, kind))
            && let Some(film) = scene.get_mut("film").and_then(Value::as_table_mut)
        {
            film.insert("width".into(), width.into());
            film.insert("height".into(), height.into());
            // Many samples a pixel would take seconds.
            scene.remove("sampler");
        }
        scene
    }

    /// A table of a family.
    fn named(&mut self, family: &str, depth: usize) -> Value {
        let definition = &self.definitions[family];
        let mut value = self.value(definition, family, family, depth);
        // Most random cameras see nothing.
        if family == "camera"
            && self.random.below(8) > 0
            && let Some(table) = value.as_table_mut()
        {
            let mut place = || Value::from(self.random.unit() * 8.0 - 4.0);
            let origin = vec![place(), place(), Value::from(4.0)];
            let target = vec![Value::from(0.0); 3];
            let look_at = [("origin", origin), ("target", target)];
            let look_at = look_at.map(|(key, place)| (key.to_owned(), place.into()));
            table.remove("transform");
            table.insert("look_at".into(), Table::from_iter(look_at).into());
        }
        value
    }

    /// A shape, mostly away from the origin, so that few coincide, and often with a material.
    fn placed_shape(&mut self) -> Value {
        let mut value = self.named("shape", 0);
        if let Some(table) = value.as_table_mut() {
            if !table.contains_key("transform") && self.random.below(4) > 0 {
                let mut place = || Value::from(self.random.unit() * 3.0 - 1.5);
                let offset = vec![place(), place(), place()];
                let step = Table::from_iter([("translate".to_owned(), Value::from(offset))]);
                table.insert("transform".into(), step.into());
            }
            if !table.contains_key("material") && self.random.below(2) == 0 {
                table.insert("material".into(), self.named("material", 2));
            }
        }
        value
    }

    /// A value that fits a schema. `owner` is the definition around it, `key` its key there.
    fn value(&mut self, schema: &Json, owner: &str, key: &str, depth: usize) -> Value {
        if let Some(reference) = schema["$ref"].as_str() {
            let name = reference.trim_start_matches("#/$defs/");
            let definition = &self.definitions[name];
            return self.value(definition, name, key, depth);
        }
        for list in ["anyOf", "oneOf", "allOf"] {
            let Some(choices) = schema[list].as_array() else {
                continue;
            };
            let leaves: Vec<&Json> = choices.iter().filter(|choice| choice["$ref"].is_null()).collect();
            let all: Vec<&Json> = choices.iter().collect();
            let choices = if depth > DEEP && !leaves.is_empty() {
                leaves
            } else {
                all
            };
            if let Some(choice) = one_of(&choices, &mut self.random) {
                return self.value(choice, owner, key, depth + 1);
            }
        }
        if let Some(text) = schema["const"].as_str() {
            return text.into();
        }
        if let Some(choices) = schema["enum"].as_array()
            && let Some(choice) = one_of(choices, &mut self.random)
        {
            return literal(choice);
        }
        match schema["type"].as_str() {
            Some("boolean") => Value::from(self.random.below(2) == 0),
            Some("integer") => Value::from(self.integer(schema)),
            Some("number") => Value::from(self.number(schema)),
            Some("string") => Value::from(self.text(owner, key)),
            Some("array") => self.array(schema, owner, key, depth),
            _ => self.table(schema, owner, depth).into(),
        }
    }

    fn table(&mut self, schema: &Json, owner: &str, depth: usize) -> Table {
        let required = schema["required"].as_array();
        let required: Vec<&str> = required.into_iter().flatten().filter_map(Json::as_str).collect();
        let properties = schema["properties"].as_object();
        let mut table = Table::new();
        for (key, schema) in properties.into_iter().flatten() {
            let rare = if depth > DEEP { 4 * RARE } else { RARE };
            if required.contains(&key.as_str()) || self.random.below(rare) == 0 {
                table.insert(key.clone(), self.value(schema, owner, key, depth + 1));
            }
        }
        table
    }

    fn array(&mut self, schema: &Json, owner: &str, key: &str, depth: usize) -> Value {
        let least = schema["minItems"].as_u64().unwrap_or(0) as usize;
        let most = schema["maxItems"]
            .as_u64()
            .map_or(least + 3, |most| most as usize);
        let count = least + self.random.below((most - least).min(3) + 1);
        let list: Vec<Value> = (0..count)
            .map(|_| self.value(&schema["items"], owner, key, depth + 1))
            .collect();
        list.into()
    }

    fn text(&mut self, owner: &str, key: &str) -> String {
        let of = |list: &[&str], random: &mut Random| one_of(list, random).map_or("", |text| text).to_owned();
        match key {
            "id" => {
                self.shapes += 1;
                format!("shape{}", self.shapes)
            }
            "group" => key.to_owned(),
            "part" => String::new(),
            "file" if owner.starts_with("texture") => of(&IMAGES, &mut self.random),
            "file" => of(&MESHES, &mut self.random),
            _ => of(&IDS, &mut self.random),
        }
    }

    fn integer(&mut self, schema: &Json) -> i64 {
        let least = schema["minimum"].as_i64().unwrap_or(-2);
        let most = schema["maximum"].as_i64().unwrap_or(i64::MAX);
        match self.random.below(20) {
            0 if self.numbers == Numbers::Extreme => most,
            1 => least.saturating_add(100).min(most),
            _ => least.saturating_add(self.random.below(6) as i64).min(most),
        }
    }

    fn number(&mut self, schema: &Json) -> f64 {
        let above = schema["exclusiveMinimum"].as_f64();
        let least = schema["minimum"].as_f64().or(above);
        let most = schema["maximum"].as_f64();
        if let Some(default) = schema["default"].as_f64()
            && self.random.below(6) == 0
        {
            return default;
        }
        let chance = self.random.below(20);
        let value = match self.numbers {
            Numbers::Extreme if chance == 0 => one_of(&EXTREMES, &mut self.random).copied().unwrap_or(0.0),
            Numbers::Extreme | Numbers::Spread if chance < 4 => {
                let sign = if self.random.below(2) == 0 { 1.0 } else { -1.0 };
                sign * 10f64.powf(12.0 * self.random.unit() - 6.0)
            }
            _ => (self.random.below(41) as f64 - 20.0) / 10.0,
        };
        // Most numbers that are too small are the negative of one that is not.
        let value = if least.is_some_and(|least| value < least) {
            value.abs()
        } else {
            value
        };
        let value = if above == Some(value) { value + 0.5 } else { value };
        most.map_or(value, |most| value.min(most))
    }
}

/// Adds an item to a list of a scene.
fn push(scene: &mut Table, family: &str, item: Value) {
    let list = scene.entry(family).or_insert_with(|| Value::Array(Vec::new()));
    if let Some(list) = list.as_array_mut() {
        list.push(item);
    }
}

fn film(width: i64, height: i64, layers: Vec<Value>) -> Table {
    let entries: [(&str, Value); 3] = [
        ("width", width.into()),
        ("height", height.into()),
        ("aovs", layers.into()),
    ];
    entries
        .into_iter()
        .map(|(key, value)| (key.to_owned(), value))
        .collect()
}

/// A light that most shapes are seen by.
fn lamp() -> Value {
    let place = [2.0, 3.0, 4.0].map(Value::from).to_vec();
    Value::from(Table::from_iter([
        ("type".to_owned(), "point".into()),
        ("position".to_owned(), place.into()),
        ("intensity".to_owned(), 20.0.into()),
    ]))
}

fn ambient() -> Value {
    Value::from(Table::from_iter([
        ("type".to_owned(), "ambient".into()),
        ("radiance".to_owned(), 0.2.into()),
    ]))
}

/// Whether a text is anywhere in a value.
fn contains(value: &Value, text: &str) -> bool {
    match value {
        Value::String(found) => found == text,
        Value::Array(list) => list.iter().any(|item| contains(item, text)),
        Value::Table(table) => table.values().any(|item| contains(item, text)),
        _ => false,
    }
}

fn one_of<'a, T>(list: &'a [T], random: &mut Random) -> Option<&'a T> {
    (!list.is_empty()).then(|| &list[random.below(list.len())])
}

fn literal(value: &Json) -> Value {
    match (value.as_str(), value.as_i64(), value.as_f64()) {
        (Some(text), ..) => text.into(),
        (_, Some(number), _) => number.into(),
        (.., Some(number)) => number.into(),
        _ => Value::from(value.as_bool().unwrap_or(false)),
    }
}
