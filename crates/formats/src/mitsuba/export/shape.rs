//! Shapes.

use super::material::Sides;
use super::node::{Item, Node};
use super::{Area, Exporter, PLAIN, emitter, table};
use crate::{mesh_file, obj};
use toml::{Table, Value};
use whitstone_core::{DAffine3, DMat3, DVec3};

/// Radius in metres of the disk that replaces an infinite plane.
const PLANE: f64 = 1e7;

impl<'a> Exporter<'a> {
    /// The shapes for a shape; `areas`: the lights that may be on it, none in a group.
    pub(super) fn shape(
        &mut self,
        shape: &'a Table,
        name: &str,
        areas: Option<&mut Vec<Area<'a>>>,
    ) -> Vec<Node> {
        let world = table::transform(shape);
        let kind = table::kind(shape);
        if shape.get("casts_shadow").and_then(Value::as_bool) == Some(false) {
            self.note("[[shape]] without a shadow", name);
        }
        if shape.contains_key("materials") {
            self.note("[[shape]] materials of an instance", name);
        }
        if shape.contains_key("motion") {
            self.note("[[shape]] motion", name);
        }
        let textured = shape.get("material").is_some_and(|value| self.lies_by_uv(value));
        let mut sides = PLAIN;
        let mut nodes = match kind {
            "sphere" => {
                sides.flip_v = true;
                let center = table::vector(shape, "center").unwrap_or(DVec3::ZERO);
                let radius = table::number(shape, "radius").unwrap_or(1.0);
                let unit =
                    world * DAffine3::from_translation(center) * DAffine3::from_scale(DVec3::splat(radius));
                let node = placed("sphere", &unit);
                // Mitsuba's normal points inwards there.
                vec![if unit.matrix3.determinant() < 0.0 {
                    flipped(node)
                } else {
                    node
                }]
            }
            "rectangle" | "disk" => vec![placed(kind, &world)],
            "plane" => {
                if textured {
                    self.note("[[shape]] plane with a texture", name);
                }
                vec![placed(
                    "disk",
                    &(world * DAffine3::from_scale(DVec3::new(PLANE, PLANE, 1.0))),
                )]
            }
            "box" if textured => (0..6)
                .map(|face| placed("rectangle", &(world * face_of_box(face))))
                .collect(),
            "box" => vec![placed("cube", &world)],
            "cylinder" => self.cylinder(shape, &world, name),
            "triangle" => self.triangle(shape, &world),
            "mesh" => self.mesh(shape, &world, name),
            "heightfield" if table::has_texture(shape, "height") => {
                self.note("[[shape]] heightfield with a texture", name);
                return Vec::new();
            }
            "heightfield" => self.triangles(shape, &world),
            "instance" => self.instance(shape, &world, name, areas.is_none()),
            _ => {
                self.note("[[shape]] of another type", name);
                return Vec::new();
            }
        };
        if kind == "instance" {
            return nodes;
        }
        let material = match shape.get("material") {
            Some(value) => self.material(value, sides, name),
            None => Item::Node(Node::new("bsdf", "twosided").containing(Node::new("bsdf", "diffuse"))),
        };
        let light = self.light_of(shape, &world, name, sides, areas);
        let media = self.media_of(shape);
        for node in &mut nodes {
            node.push("", material.clone());
            if let Some(light) = &light {
                node.push("", Item::Node(light.clone()));
            }
            for (side, medium) in &media {
                node.push(side, Item::Node(medium.clone()));
            }
        }
        nodes
    }

    /// The emitter of a shape: of an area light with the same surface, or of an emissive material.
    fn light_of(
        &mut self,
        shape: &'a Table,
        world: &DAffine3,
        name: &str,
        sides: Sides,
        areas: Option<&mut Vec<Area<'a>>>,
    ) -> Option<Node> {
        let radiance = self.emission(shape.get("material")?)?;
        let Some(areas) = areas else {
            self.note("[material] emissive in a group", name);
            return None;
        };
        let same = areas.iter_mut().find(|area| {
            let unit = match table::kind(shape) {
                "sphere" => {
                    let center = table::vector(shape, "center").unwrap_or(DVec3::ZERO);
                    let radius = table::number(shape, "radius").unwrap_or(1.0);
                    *world * DAffine3::from_translation(center) * DAffine3::from_scale(DVec3::splat(radius))
                }
                _ => *world,
            };
            let other = table::transform(area.table);
            let size = 1e-9 * (1.0 + unit.translation.abs().max_element());
            !area.used
                && area.kind == table::kind(shape)
                && table::text(area.table, "file") == table::text(shape, "file")
                && other.abs_diff_eq(unit, size)
        });
        let found = same.map(|area| {
            area.used = true;
            area.name.clone()
        });
        if let Some(light) = &found {
            self.note("[[light]] area", light);
        }
        let material = shape
            .get("material")
            .and_then(|value| self.plugin("material", value));
        if found.is_none() || material.is_some_and(|material| table::kind(material) == "emissive") {
            self.note("[material] emissive", name);
        }
        let radiance = match radiance {
            Some(value) => self.texture(value, sides, name),
            None => Item::Color([1.0; 3]),
        };
        Some(emitter(radiance))
    }

    /// The radiance of an emissive material, or of the front of a two-sided one: its value, or none
    /// for the default.
    fn emission(&self, value: &'a Value) -> Option<Option<&'a Value>> {
        let mut value = value;
        for _ in 0..16 {
            let material = self.plugin("material", value)?;
            match table::kind(material) {
                "emissive" => return Some(material.get("radiance")),
                "two_sided" => value = material.get("front")?,
                _ => return None,
            }
        }
        None
    }

    /// The media of a dielectric that absorbs, by side.
    fn media_of(&mut self, shape: &'a Table) -> Vec<(&'static str, Node)> {
        let material = shape
            .get("material")
            .and_then(|value| self.plugin("material", value));
        let Some(material) = material.filter(|material| table::kind(material) == "dielectric") else {
            return Vec::new();
        };
        let mut media = Vec::new();
        for (side, key) in [("interior", "absorption"), ("exterior", "exterior_absorption")] {
            let absorption = table::color(material, key, [0.0; 3]);
            let scale = absorption.into_iter().fold(0.0, f64::max);
            if scale > 0.0 {
                self.media = true;
                // Mitsuba's colours are at most 1.
                let medium = Node::new("medium", "homogeneous")
                    .with("albedo", Item::Float(0.0))
                    .with("sigma_t", Item::Color(absorption.map(|value| value / scale)))
                    .with("scale", Item::Float(scale))
                    .with("sample_emitters", Item::Boolean(false));
                media.push((side, medium));
            }
        }
        media
    }

    fn cylinder(&mut self, shape: &'a Table, world: &DAffine3, name: &str) -> Vec<Node> {
        let radius = table::number(shape, "radius").unwrap_or(1.0);
        let [low, high] = match shape.get("z").and_then(table::numbers).as_deref() {
            Some([low, high]) => [*low, *high],
            _ => [-1.0, 1.0],
        };
        let columns = world.matrix3;
        let scale = columns.x_axis.length();
        let stretched = [columns.y_axis.length(), columns.z_axis.length()]
            .into_iter()
            .any(|length| (length - scale).abs() > 1e-9 * scale)
            || columns.x_axis.dot(columns.y_axis).abs() > 1e-9 * scale * scale;
        if stretched {
            self.note("[[shape]] cylinder that is stretched", name);
            return Vec::new();
        }
        let side = placed("cylinder", world)
            .with("p0", Item::Point(DVec3::new(0.0, 0.0, low)))
            .with("p1", Item::Point(DVec3::new(0.0, 0.0, high)))
            .with("radius", Item::Float(radius));
        if shape.get("caps").and_then(Value::as_bool) == Some(false) {
            return vec![side];
        }
        let cap = |z: f64, up: f64| {
            let scale = DAffine3::from_scale(DVec3::new(radius, radius, up));
            placed(
                "disk",
                &(*world * DAffine3::from_translation(DVec3::new(0.0, 0.0, z)) * scale),
            )
        };
        vec![side, cap(low, -1.0), cap(high, 1.0)]
    }

    fn triangle(&mut self, shape: &'a Table, world: &DAffine3) -> Vec<Node> {
        let list = |key: &str| -> Option<Vec<Vec<f64>>> {
            shape
                .get(key)
                .and_then(Value::as_array)
                .and_then(|list| list.iter().map(table::numbers).collect())
        };
        let Some(vertices) = list("vertices") else {
            return Vec::new();
        };
        let uvs = list("uvs").unwrap_or_else(|| vec![vec![0.0, 0.0], vec![1.0, 0.0], vec![0.0, 1.0]]);
        let normals = list("normals");
        let mut text = String::new();
        let mut lines = |keyword: &str, rows: &[Vec<f64>]| {
            for row in rows {
                let numbers: Vec<String> = row.iter().map(f64::to_string).collect();
                text.push_str(&format!("{keyword} {}\n", numbers.join(" ")));
            }
        };
        lines("v", &vertices);
        lines("vt", &uvs);
        lines("vn", normals.as_deref().unwrap_or_default());
        let corner = |i: usize| {
            if normals.is_some() {
                format!("{i}/{i}/{i}")
            } else {
                format!("{i}/{i}")
            }
        };
        text.push_str(&format!("f {} {} {}\n", corner(1), corner(2), corner(3)));
        let file = self.write_mesh("obj", text.as_bytes());
        vec![mesh_node("obj", file, world, normals.is_none())]
    }

    fn mesh(&mut self, shape: &'a Table, world: &DAffine3, name: &str) -> Vec<Node> {
        let Some(file) = table::text(shape, "file") else {
            return Vec::new();
        };
        let lower = file.to_lowercase();
        let plugin = ["obj", "ply"]
            .into_iter()
            .find(|plugin| lower.ends_with(&format!(".{plugin}")));
        let displaced = shape.contains_key("displacement");
        if displaced {
            self.note("[[shape]] mesh with displacement", name);
        }
        let subdivided = shape.contains_key("subdivision") && !displaced;
        let Some(plugin) = plugin.filter(|_| !subdivided) else {
            let mut plain = shape.clone();
            plain.remove("displacement");
            return self.triangles(&plain, world);
        };
        let Some(bytes) = self.read(file) else {
            return Vec::new();
        };
        let info = if plugin == "obj" {
            obj::inspect(&bytes)
        } else {
            mesh_file::inspect_ply(&bytes)
        };
        let flat = table::text(shape, "shading") == Some("flat") || !info.normals;
        let written = match table::text(shape, "part") {
            Some(part) if plugin == "obj" => {
                let faces = obj::only_part(&bytes, part);
                self.write_mesh("obj", &faces)
            }
            _ => self.file(file),
        };
        vec![mesh_node(plugin, written, world, flat)]
    }

    /// The triangles of a shape as a PLY file.
    fn triangles(&mut self, shape: &Table, world: &DAffine3) -> Vec<Node> {
        match self.ply_of(shape) {
            Some((file, flat)) => vec![mesh_node("ply", file, world, flat)],
            None => Vec::new(),
        }
    }

    fn instance(&mut self, shape: &'a Table, world: &DAffine3, name: &str, nested: bool) -> Vec<Node> {
        let Some(id) = table::text(shape, "group") else {
            return Vec::new();
        };
        if nested {
            self.note("[[shape]] instance in a group", name);
            return Vec::new();
        }
        if !self.groups.contains_key(id) {
            let group = table::table(self.document, "group").and_then(|groups| table::table(groups, id));
            let mut node = Node::new("shape", "shapegroup");
            node.id = Some(format!("group {id}"));
            for (place, inner) in group
                .into_iter()
                .flat_map(|group| table::tables(group, "shape"))
                .enumerate()
            {
                for shape in self.shape(inner, &format!("group.{id}.shape[{place}]"), None) {
                    node.push("", Item::Node(shape));
                }
            }
            self.groups.insert(id.to_owned(), !node.children.is_empty());
            if !node.children.is_empty() {
                self.root.push("", Item::Node(node));
            }
        }
        if self.groups.get(id) != Some(&true) {
            return Vec::new();
        }
        let node = Node::new("shape", "instance")
            .with("to_world", Item::Transform(*world))
            .with("", Item::Reference(format!("group {id}")));
        vec![node]
    }
}

fn placed(plugin: &str, world: &DAffine3) -> Node {
    let node = Node::new("shape", plugin);
    if *world == DAffine3::IDENTITY {
        node
    } else {
        node.with("to_world", Item::Transform(*world))
    }
}

fn flipped(node: Node) -> Node {
    node.with("flip_normals", Item::Boolean(true))
}

/// A mesh. Mitsuba computes normals for a file without, unless `face_normals` is set, and turns
/// those of a mirrored one.
fn mesh_node(plugin: &str, file: String, world: &DAffine3, flat: bool) -> Node {
    let mut node = placed(plugin, world).with("filename", Item::Text(file));
    if flat {
        node.push("face_normals", Item::Boolean(true));
    }
    if plugin == "obj" {
        node.push("flip_tex_coords", Item::Boolean(false));
    }
    if flat && world.matrix3.determinant() < 0.0 {
        flipped(node)
    } else {
        node
    }
}

/// Face `face` of the model's box as a rectangle: (u, v) along the next two axes.
fn face_of_box(face: usize) -> DAffine3 {
    let axis = face / 2;
    let sign = if face % 2 == 1 { 1.0 } else { -1.0 };
    let z = DVec3::AXES[axis] * sign;
    let matrix = DMat3::from_cols(DVec3::AXES[(axis + 1) % 3], DVec3::AXES[(axis + 2) % 3], z);
    DAffine3::from_mat3_translation(matrix, z)
}
