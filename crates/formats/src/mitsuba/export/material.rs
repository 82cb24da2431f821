//! Materials.

use super::node::{Item, Node};
use super::{Exporter, table};
use crate::mitsuba::material::METALS;
use std::f64::consts::PI;
use toml::{Table, Value};

/// Materials that lights light.
pub(super) const LIT: [&str; 6] = ["matte", "phong", "blinn_phong", "whitted", "plastic", "tabulated"];

/// Materials that reflect or pass rays.
pub(super) const TRACED: [&str; 8] = [
    "mirror",
    "glossy",
    "plastic",
    "rough",
    "conductor",
    "dielectric",
    "thin_dielectric",
    "mask",
];

/// What a material needs to know of its shape.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) struct Sides {
    /// Whether Mitsuba's v is 1 - v there.
    pub(super) flip_v: bool,
    /// Whether it is already inside a `twosided`.
    pub(super) bare: bool,
}

impl<'a> Exporter<'a> {
    /// A material as a child of a shape or of another BSDF.
    pub(super) fn material(&mut self, value: &'a Value, sides: Sides, name: &str) -> Item {
        let Value::String(id) = value else {
            return Item::Node(self.bsdf(value, sides, name));
        };
        let key = format!("{id} {sides:?}");
        if let Some(known) = self.shared.get(&key) {
            return Item::Reference(known.clone());
        }
        let mut unique = id.clone();
        while self.shared.values().any(|other| *other == unique) || unique.is_empty() {
            unique.push('_');
        }
        self.shared.insert(key, unique.clone());
        let mut node = self.bsdf(value, sides, id);
        node.id = Some(unique.clone());
        self.root.push("", Item::Node(node));
        Item::Reference(unique)
    }

    fn bsdf(&mut self, value: &'a Value, sides: Sides, name: &str) -> Node {
        let Some(material) = self.plugin("material", value) else {
            return Node::new("bsdf", "diffuse");
        };
        if self.depth > 16 {
            return Node::new("bsdf", "diffuse");
        }
        self.depth += 1;
        let node = self.bsdf_table(material, sides, name);
        self.depth -= 1;
        node
    }

    /// A parameter that is a colour or texture.
    fn look(&mut self, material: &'a Table, key: &str, default: f64, sides: Sides, name: &str) -> Item {
        match material.get(key) {
            None => Item::Color([default; 3]),
            Some(value) => self.texture(value, sides, name),
        }
    }

    /// A constant colour; a texture reads as the default, with a note.
    fn constant(&mut self, material: &'a Table, key: &str, default: f64, name: &str) -> [f64; 3] {
        match material.get(key) {
            None => [default; 3],
            Some(value) => table::as_color(value).unwrap_or_else(|| {
                self.note("[material] texture of a highlight or reflection", name);
                [default; 3]
            }),
        }
    }

    /// A part of a composite material.
    fn part(&mut self, material: &'a Table, key: &str, sides: Sides, name: &str) -> Item {
        match material.get(key) {
            Some(value) => self.material(value, sides, name),
            None => Item::Node(sided(Node::new("bsdf", "diffuse"), sides)),
        }
    }

    fn bsdf_table(&mut self, material: &'a Table, sides: Sides, name: &str) -> Node {
        let ior = |key: &str, default: f64| Item::Float(table::number(material, key).unwrap_or(default));
        match table::kind(material) {
            "matte" => {
                let reflectance = self.look(material, "reflectance", 0.5, sides, name);
                sided(
                    Node::new("bsdf", "diffuse").with("reflectance", reflectance),
                    sides,
                )
            }
            "phong" | "blinn_phong" | "whitted" => self.phong(material, sides, name),
            "tabulated" => {
                self.note("[material] tabulated", name);
                sided(Node::new("bsdf", "diffuse"), sides)
            }
            "mirror" => {
                let reflectance = self.look(material, "reflectance", 1.0, sides, name);
                sided(mirror(reflectance), sides)
            }
            "glossy" => {
                self.note("[material] glossy", name);
                let reflectance = self.look(material, "reflectance", 1.0, sides, name);
                let alpha = table::alpha(material);
                let node = Node::new("bsdf", "roughconductor")
                    .with("material", Item::Text("none".into()))
                    .with("alpha", Item::Float(alpha))
                    .with("specular_reflectance", reflectance);
                sided(node, sides)
            }
            "conductor" => {
                let named = table::text(material, "metal");
                let metal = METALS.iter().find(|(known, _, _)| Some(*known) == named);
                let (eta, k) = match metal {
                    Some((_, eta, k)) => (*eta, *k),
                    None => (
                        table::color(material, "eta", [1.0; 3]),
                        table::color(material, "k", [1.0; 3]),
                    ),
                };
                let tint = self.look(material, "tint", 1.0, sides, name);
                let node = Node::new("bsdf", "conductor")
                    .with("eta", Item::Color(eta))
                    .with("k", Item::Color(k))
                    .with("specular_reflectance", tint);
                sided(node, sides)
            }
            "plastic" => {
                if material.get("samples").and_then(Value::as_integer).unwrap_or(1) > 1 {
                    self.note("[material] plastic with samples", name);
                }
                let reflectance = self.look(material, "reflectance", 0.5, sides, name);
                let node = Node::new("bsdf", "plastic")
                    .with("int_ior", ior("interior_ior", 1.5))
                    .with("ext_ior", ior("exterior_ior", 1.0))
                    .with("diffuse_reflectance", reflectance);
                sided(node, sides)
            }
            "rough" => {
                self.note("[material] rough", name);
                let Some(inner) = material.get("material") else {
                    return Node::new("bsdf", "diffuse");
                };
                let transmits = self.transmits(Some(inner));
                let inside = Sides {
                    bare: sides.bare || !transmits,
                    ..sides
                };
                let mut node = self.bsdf(inner, inside, name);
                if matches!(node.plugin.as_str(), "conductor" | "dielectric") {
                    node.plugin.insert_str(0, "rough");
                    node.push("alpha", Item::Float(table::alpha(material)));
                }
                if transmits { node } else { sided(node, sides) }
            }
            "dielectric" => {
                if material.contains_key("priority") {
                    self.note("[material] priority", name);
                }
                Node::new("bsdf", "dielectric")
                    .with("int_ior", ior("interior_ior", 1.5))
                    .with("ext_ior", ior("exterior_ior", 1.0))
            }
            "thin_dielectric" => {
                let tint = self.look(material, "tint", 1.0, sides, name);
                Node::new("bsdf", "thindielectric")
                    .with("int_ior", ior("interior_ior", 1.5))
                    .with("ext_ior", ior("exterior_ior", 1.0))
                    .with("specular_transmittance", tint)
            }
            "mask" => {
                let opacity = self.look(material, "opacity", 0.5, sides, name);
                let inner = self.part(material, "material", sides, name);
                Node::new("bsdf", "mask").with("opacity", opacity).with("", inner)
            }
            "mix" => {
                let weight = self.look(material, "weight", 0.5, sides, name);
                let weight = match weight {
                    Item::Color(value) => Item::Float(self.grey(value, name)),
                    texture => texture,
                };
                let (a, b) = (
                    self.part(material, "a", sides, name),
                    self.part(material, "b", sides, name),
                );
                Node::new("bsdf", "blendbsdf")
                    .with("weight", weight)
                    .with("", a)
                    .with("", b)
            }
            "two_sided" => {
                let inner = Sides { bare: true, ..sides };
                let transmits = ["front", "back"]
                    .iter()
                    .any(|key| self.transmits(material.get(*key)));
                if transmits || sides.bare {
                    self.note("[material] two_sided that lets light through", name);
                    let Some(front) = material.get("front") else {
                        return Node::new("bsdf", "diffuse");
                    };
                    return self.bsdf(front, sides, name);
                }
                let front = self.part(material, "front", inner, name);
                let back = self.part(material, "back", inner, name);
                Node::new("bsdf", "twosided").with("", front).with("", back)
            }
            "normal_map" if table::text(material, "tangent") == Some("mesh") => {
                self.note("[material] normal_map", name);
                let map = self.look(material, "map", 0.5, sides, name);
                let bare = sides.bare || !self.transmits(material.get("material"));
                let inner = self.part(material, "material", Sides { bare, ..sides }, name);
                let node = Node::new("bsdf", "normalmap")
                    .with("normalmap", map)
                    .with("flip_invalid_normals", Item::Boolean(false))
                    .with("use_shadowing_function", Item::Boolean(false))
                    .with("", inner);
                if bare { sided(node, sides) } else { node }
            }
            "bump" if self.is_uv_image(material.get("height")) => {
                self.note("[material] bump by an image over uv", name);
                let height = self.look(material, "height", 0.0, sides, name);
                let bare = sides.bare || !self.transmits(material.get("material"));
                let inner = self.part(material, "material", Sides { bare, ..sides }, name);
                let node = Node::new("bsdf", "bumpmap")
                    .with("height", height)
                    .with(
                        "scale",
                        Item::Float(table::number(material, "scale").unwrap_or(1.0)),
                    )
                    .with("flip_invalid_normals", Item::Boolean(false))
                    .with("use_shadowing_function", Item::Boolean(false))
                    .with("", inner);
                if bare { sided(node, sides) } else { node }
            }
            "normal_map" | "bump" => {
                self.note("[material] bump", name);
                match material.get("material") {
                    Some(inner) => self.bsdf(inner, sides, name),
                    None => Node::new("bsdf", "diffuse"),
                }
            }
            "reflection_map" => {
                self.note("[material] reflection_map", name);
                match material.get("material") {
                    Some(inner) => self.bsdf(inner, sides, name),
                    None => Node::new("bsdf", "diffuse"),
                }
            }
            // Its radiance is the emitter of the shape.
            "emissive" => match material.get("material") {
                Some(inner) => self.bsdf(inner, sides, name),
                None => Node::new("bsdf", "diffuse").with("reflectance", Item::Float(0.0)),
            },
            _ => {
                self.note("[*] plugins of third parties", name);
                sided(Node::new("bsdf", "diffuse"), sides)
            }
        }
    }

    /// A diffuse material with a mirror for the reflection.
    fn phong(&mut self, material: &'a Table, sides: Sides, name: &str) -> Node {
        let whitted = table::kind(material) == "whitted";
        let default = if whitted { 0.0 } else { 0.5 };
        self.note("[material] phong, blinn_phong, whitted", name);
        let times_pi =
            |value: [f64; 3], rest: f64| Item::Color(value.map(|value| (PI * value / rest).min(1.0)));
        let reflected = if whitted {
            self.constant(material, "k_refl", 0.0, name)
        } else {
            [0.0; 3]
        };
        if whitted
            && material
                .get("k_refr")
                .is_some_and(|value| table::as_color(value) != Some([0.0; 3]))
        {
            self.note("[material] k_refr", name);
        }
        let weight = self.grey(reflected, name).min(1.0);
        let diffuse = match material.get("k_d") {
            Some(value) if table::as_color(value).is_none() => {
                self.note("[material] texture of k_d", name);
                self.texture(value, sides, name)
            }
            _ => {
                let k_d = table::color(material, "k_d", [default; 3]);
                times_pi(k_d, if weight < 1.0 { 1.0 - weight } else { 1.0 })
            }
        };
        let diffuse = Node::new("bsdf", "diffuse").with("reflectance", diffuse);
        if weight == 0.0 {
            return sided(diffuse, sides);
        }
        let both = Node::new("bsdf", "blendbsdf")
            .with("weight", Item::Float(weight))
            .containing(diffuse)
            .containing(mirror(Item::Float(1.0)));
        sided(both, sides)
    }

    /// A grey value, with a note if it was coloured.
    fn grey(&mut self, value: [f64; 3], name: &str) -> f64 {
        if value.iter().any(|channel| *channel != value[0]) {
            self.note("[material] coloured weight", name);
        }
        value.iter().sum::<f64>() / 3.0
    }

    /// Whether a material lets light through, which `twosided` must not.
    fn transmits(&self, value: Option<&'a Value>) -> bool {
        let mut pending: Vec<(&Value, usize)> = value.into_iter().map(|value| (value, 0)).collect();
        while let Some((value, depth)) = pending.pop() {
            let Some(material) = self.plugin("material", value) else {
                continue;
            };
            if matches!(table::kind(material), "dielectric" | "thin_dielectric" | "mask") {
                return true;
            }
            if depth < 16 {
                let keys = ["material", "a", "b", "front", "back"];
                pending.extend(
                    keys.into_iter()
                        .filter_map(|key| material.get(key))
                        .map(|inner| (inner, depth + 1)),
                );
            }
        }
        false
    }
}

/// A BSDF that Mitsuba shows from one side, seen from both.
fn sided(node: Node, sides: Sides) -> Node {
    if sides.bare {
        node
    } else {
        Node::new("bsdf", "twosided").containing(node)
    }
}

fn mirror(reflectance: Item) -> Node {
    Node::new("bsdf", "conductor")
        .with("material", Item::Text("none".into()))
        .with("specular_reflectance", reflectance)
}
