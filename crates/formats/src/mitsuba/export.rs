//! From a flattened document to Mitsuba's objects.

mod material;
mod node;
mod shape;
mod texture;
mod view;

use super::FEATURES;
use crate::files::save;
use crate::toml_scene::Copies;
use crate::{files, table, triangles};
use material::Sides;
use node::{Item, Node};
use std::collections::HashMap;
use std::path::{Path, PathBuf};
use toml::{Table, Value};
use whitstone_core::{DVec3, ExportScene, FormatError, FormatErrors, Note, Notes};

/// Writes a scene as XML, or as Python if the file ends in `.py`.
pub(super) fn export(scene: &ExportScene<'_>, path: &Path, python: bool) -> Result<Vec<Note>, FormatErrors> {
    let folder = path.parent().unwrap_or(Path::new("")).to_owned();
    let stem = path
        .file_stem()
        .unwrap_or_default()
        .to_string_lossy()
        .into_owned();
    let mut exporter = Exporter {
        document: scene.document,
        base: scene.base.to_owned(),
        folder,
        stem,
        copies: Copies::new(scene.base, path),
        notes: Notes::default(),
        errors: Vec::new(),
        root: Node::new("scene", "scene"),
        shared: HashMap::new(),
        groups: HashMap::new(),
        depth: 0,
        media: false,
        lit: false,
        written: 0,
    };
    exporter.scene();
    if !exporter.errors.is_empty() {
        return Err(FormatErrors(exporter.errors));
    }
    let text = if python {
        exporter.root.to_python()
    } else {
        exporter.root.to_xml()
    };
    save(path, text.as_bytes())?;
    Ok(exporter.notes.into_sorted())
}

/// The state of an export.
struct Exporter<'a> {
    document: &'a Table,
    /// The folder that the document's paths are relative to.
    base: PathBuf,
    /// The folder of the written file.
    folder: PathBuf,
    /// The name of the written file without its extension.
    stem: String,
    copies: Copies<'a>,
    notes: Notes,
    errors: Vec<FormatError>,
    root: Node,
    /// Ids of shared materials, by their ids in the document and by the sides of the shape.
    shared: HashMap<String, String>,
    /// Whether a group can be placed, by its id.
    groups: HashMap<String, bool>,
    /// Materials inside each other.
    depth: usize,
    /// Whether a dielectric absorbs.
    media: bool,
    /// Whether lights light some material.
    lit: bool,
    /// Number of mesh files that were written.
    written: usize,
}

impl<'a> Exporter<'a> {
    fn scene(&mut self) {
        let mut areas = self.area_lights();
        let mut shapes = Vec::new();
        for (place, shape) in table::tables(self.document, "shape").into_iter().enumerate() {
            let name = table::text(shape, "id").map_or_else(|| format!("shape[{place}]"), str::to_owned);
            shapes.extend(self.shape(shape, &name, Some(&mut areas)));
        }
        // Lights without a visible surface.
        for area in areas {
            if !area.used {
                self.note("[[light]] area", &area.name);
                shapes.extend(self.area_shape(&area));
            }
        }
        let integrator = self.integrator();
        let sensor = self.sensor();
        let emitters = self.emitters();
        let parts = integrator.into_iter().chain(sensor);
        // Materials and groups, which others refer to, are already there.
        let before: Vec<(String, Item)> = parts.map(|node| (String::new(), Item::Node(node))).collect();
        self.root.children.splice(0..0, before);
        for node in shapes.into_iter().chain(emitters) {
            self.root.push("", Item::Node(node));
        }
    }

    fn note(&mut self, feature: &str, place: &str) {
        self.notes.add(FEATURES, feature, place);
    }

    /// The name of a file of the document in the written file: it is copied, unless it is below the
    /// folder of the written file already.
    fn file(&mut self, name: &str) -> String {
        match self.copies.copy(name) {
            Ok(name) => name,
            Err(error) => {
                if !self.errors.contains(&error) {
                    self.errors.push(error);
                }
                String::new()
            }
        }
    }

    /// The PLY file with the triangles of a shape, and whether they have no normals; none if the
    /// shape has no triangles.
    fn ply_of(&mut self, shape: &Table) -> Option<(String, bool)> {
        match triangles::built(shape, &self.base) {
            Ok(mesh) => Some((
                self.write_mesh("ply", &triangles::ply(&mesh)),
                mesh.normals.is_empty(),
            )),
            Err(triangles::Missing::Curved) => None,
            Err(triangles::Missing::Faulty(message)) => {
                self.errors.push(FormatError::anywhere(message));
                None
            }
        }
    }

    /// Writes a mesh next to the scene; its name in the written file.
    fn write_mesh(&mut self, extension: &str, bytes: &[u8]) -> String {
        self.written += 1;
        let name = format!("{}-mesh{}.{extension}", self.stem, self.written);
        if let Err(error) = save(&self.folder.join(&name), bytes) {
            self.errors.push(error);
        }
        name
    }

    /// Bytes of a file of the document.
    fn read(&mut self, name: &str) -> Option<Vec<u8>> {
        match files::read(&self.base.join(name), 4 << 30) {
            Ok(bytes) => Some(bytes),
            Err(problem) => {
                let name = files::shorten(name);
                self.errors.push(FormatError::anywhere(format!(
                    "cannot read \"{name}\": {problem}"
                )));
                None
            }
        }
    }

    /// The table of a shared material or texture.
    fn shared_table(&self, family: &str, id: &str) -> Option<&'a Table> {
        table::table(table::table(self.document, family)?, id)
    }

    /// The table of a material or texture that is a name or a table.
    fn plugin(&self, family: &str, value: &'a Value) -> Option<&'a Table> {
        match value {
            Value::String(id) => self.shared_table(family, id),
            Value::Table(table) => Some(table),
            _ => None,
        }
    }
}

/// An area light of the document.
struct Area<'a> {
    name: String,
    table: &'a Table,
    kind: &'a str,
    /// Whether a shape of the document is its visible surface.
    used: bool,
}

impl<'a> Exporter<'a> {
    fn area_lights(&mut self) -> Vec<Area<'a>> {
        let lights = table::tables(self.document, "light").into_iter().enumerate();
        lights
            .filter(|(_, light)| table::kind(light) == "area")
            .filter(|(place, light)| {
                let falls = table::text(light, "falloff") != Some("none");
                if !falls {
                    let name = format!("light[{place}]");
                    self.note("[[light]] falloff none", &name);
                }
                falls
            })
            .map(|(place, light)| Area {
                name: format!("light[{place}]"),
                table: light,
                kind: table::text(light, "shape").unwrap_or("rectangle"),
                used: false,
            })
            .collect()
    }

    /// An area light as a visible shape.
    fn area_shape(&mut self, area: &Area<'a>) -> Option<Node> {
        let mut node = match area.kind {
            "mesh" => {
                let file = table::text(area.table, "file")?;
                let lower = file.to_lowercase();
                let (plugin, file) = if lower.ends_with(".obj") {
                    ("obj", self.file(file))
                } else if lower.ends_with(".ply") {
                    ("ply", self.file(file))
                } else {
                    ("ply", self.ply_of(&mesh_of(area.table))?.0)
                };
                Node::new("shape", plugin)
                    .with("filename", Item::Text(file))
                    .with("face_normals", Item::Boolean(true))
            }
            kind => Node::new("shape", kind),
        };
        let world = table::transform(area.table);
        node.push("to_world", Item::Transform(world));
        if world.matrix3.determinant() < 0.0 && matches!(area.kind, "mesh" | "sphere") {
            node.push("flip_normals", Item::Boolean(true));
        }
        let radiance = table::color(area.table, "radiance", [1.0; 3]);
        Some(node.containing(emitter(Item::Color(radiance))))
    }
}

/// The mesh of an area light as a shape.
pub(crate) fn mesh_of(light: &Table) -> Table {
    let mut shape = Table::new();
    shape.insert("type".to_owned(), Value::String("mesh".to_owned()));
    for key in ["file", "mesh", "primitive", "part"] {
        if let Some(value) = light.get(key) {
            shape.insert(key.to_owned(), value.clone());
        }
    }
    shape
}

fn emitter(radiance: Item) -> Node {
    Node::new("emitter", "area").with("radiance", radiance)
}

/// The rotation and position of a frame that looks along `forward`.
fn looking(position: DVec3, forward: DVec3) -> whitstone_core::DAffine3 {
    let forward = forward.try_normalize().unwrap_or(DVec3::Z);
    whitstone_core::DAffine3::from_mat3_translation(super::xml::basis(forward), position)
}

/// Sides of a shape for its material, by its texture coordinates.
const PLAIN: Sides = Sides {
    flip_v: false,
    bare: false,
};

#[cfg(test)]
mod tests;
