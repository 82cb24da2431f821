//! From a flattened document to a glTF file.
//!
//! Other programs see the triangles, the nearest metallic-roughness materials, the camera and the
//! lights. Whitstone's import uses the document itself, which is kept in `extras` (see `kept`).

mod buffer;
mod geometry;
mod material;
mod node;
mod view;

use super::{FEATURES, kept};
use crate::files::save;
use crate::part::Part;
use crate::table;
use crate::toml_scene::Copies;
use crate::triangles::Missing;
use buffer::Buffer;
use material::Written;
use serde_json::{Map, json};
use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::fmt::Write;
use std::path::{Path, PathBuf};
use toml::{Table, Value};
use whitstone_core::{DAffine3, DVec3, ExportScene, FormatError, FormatErrors, Note, Notes};
use whitstone_gltf::MAX_JSON_BYTES;

/// Largest number of nodes.
const MAX_NODES: usize = 200_000;
/// Largest nesting of groups, by the model.
const MAX_DEPTH: usize = 16;

/// Writes a scene: as one file if its name ends in `.glb`, else as JSON and separate files.
pub(super) fn export(scene: &ExportScene<'_>, path: &Path) -> Result<Vec<Note>, FormatErrors> {
    let embedded = path
        .extension()
        .is_some_and(|extension| extension.eq_ignore_ascii_case("glb"));
    let mut exporter = Exporter {
        document: scene.document,
        base: scene.base.to_owned(),
        embedded,
        copies: Copies::new(scene.base, path),
        notes: Notes::default(),
        errors: Vec::new(),
        root: Root::default(),
        buffer: Buffer::default(),
        materials: HashMap::new(),
        images: HashMap::new(),
        attributes: HashMap::new(),
        meshes: HashMap::new(),
        shapes: BTreeMap::new(),
        bounds: Part::EMPTY,
    };
    exporter.scene();
    let kept = exporter.kept();
    if !exporter.errors.is_empty() {
        return Err(FormatErrors(exporter.errors));
    }
    exporter
        .notes
        .add(FEATURES, "Whitstone scene", "/extras/whitstone");
    let Exporter {
        root, buffer, notes, ..
    } = exporter;
    write(path, embedded, root, buffer, kept)?;
    Ok(notes.into_sorted())
}

/// The lists of a glTF file.
#[derive(Default)]
struct Root {
    nodes: Vec<serde_json::Value>,
    /// Nodes without parents.
    roots: Vec<usize>,
    meshes: Vec<serde_json::Value>,
    materials: Vec<serde_json::Value>,
    textures: Vec<serde_json::Value>,
    samplers: Vec<serde_json::Value>,
    images: Vec<serde_json::Value>,
    cameras: Vec<serde_json::Value>,
    lights: Vec<serde_json::Value>,
    used: BTreeSet<String>,
    required: BTreeSet<String>,
}

impl Root {
    fn uses(&mut self, extension: &str) {
        self.used.insert(extension.to_owned());
    }

    fn requires(&mut self, extension: &str) {
        self.required.insert(extension.to_owned());
    }
}

/// The accessors of the triangles of a shape.
#[derive(Clone, Copy)]
struct Attributes {
    vertices: usize,
    position: usize,
    normal: Option<usize>,
    uvs: [Option<usize>; 2],
    color: Option<usize>,
    tangent: Option<usize>,
    indices: usize,
    bounds: Part,
}

/// A shape in the lists of the document: its group, and its place in the list.
type Place = (Option<String>, usize);

/// The state of an export.
struct Exporter<'a> {
    document: &'a Table,
    /// The folder that the document's paths are relative to.
    base: PathBuf,
    /// Whether everything is in one file.
    embedded: bool,
    copies: Copies<'a>,
    notes: Notes,
    errors: Vec<FormatError>,
    root: Root,
    buffer: Buffer,
    /// Materials by their values in the document.
    materials: HashMap<String, Written>,
    /// Images by their file and their index in it; none if they cannot be read.
    images: HashMap<(String, Option<i64>), Option<usize>>,
    /// Triangles by the keys of their shape; none if there are none.
    attributes: HashMap<String, Result<Attributes, Missing>>,
    /// Meshes by their triangles and their material.
    meshes: HashMap<(String, usize), usize>,
    /// The meshes of shapes, and their bounds.
    shapes: BTreeMap<Place, (usize, Part)>,
    /// Bounds of everything that was placed.
    bounds: Part,
}

impl<'a> Exporter<'a> {
    fn scene(&mut self) {
        let document: &'a Table = self.document;
        self.list(None, &table::tables(document, "shape"));
        for id in self.placed_groups() {
            self.list(Some(id), &self.group(id));
        }
        let mut roots = Vec::new();
        self.place(None, &DAffine3::IDENTITY, 0, &mut roots);
        self.root.roots = roots;
        self.camera();
        self.lights();
    }

    fn note(&mut self, feature: &str, place: &str) {
        self.notes.add(FEATURES, feature, place);
    }

    fn fail(&mut self, message: &str) {
        let error = FormatError::anywhere(message);
        if !self.errors.contains(&error) {
            self.errors.push(error);
        }
    }

    /// The table of a material or texture that is a name or a table.
    fn plugin(&self, family: &str, value: &'a Value) -> Option<&'a Table> {
        match value {
            Value::String(id) => table::table(table::table(self.document, family)?, id),
            Value::Table(table) => Some(table),
            _ => None,
        }
    }

    /// The shapes of a group.
    fn group(&self, id: &str) -> Vec<&'a Table> {
        let document: &'a Table = self.document;
        let group = table::table(document, "group").and_then(|groups| table::table(groups, id));
        group.map_or(Vec::new(), |group| table::tables(group, "shape"))
    }

    /// The groups that instances place, directly or through others.
    fn placed_groups(&self) -> BTreeSet<&'a str> {
        let document: &'a Table = self.document;
        let mut found = BTreeSet::new();
        let mut lists = vec![table::tables(document, "shape")];
        while let Some(shapes) = lists.pop() {
            for shape in shapes {
                if table::kind(shape) == "instance"
                    && let Some(id) = table::text(shape, "group")
                    && found.insert(id)
                {
                    lists.push(self.group(id));
                }
            }
        }
        found
    }

    /// Writes the meshes of a list of shapes.
    fn list(&mut self, group: Option<&str>, shapes: &[&'a Table]) {
        for (number, shape) in shapes.iter().enumerate() {
            if table::kind(shape) == "instance" {
                continue;
            }
            let name = name(shape, group, number);
            if let Some(found) = self.mesh(shape, &name) {
                self.shapes.insert((group.map(str::to_owned), number), found);
            }
        }
    }

    /// The mesh of a shape, and its bounds; none if the shape has no triangles.
    fn mesh(&mut self, shape: &'a Table, name: &str) -> Option<(usize, Part)> {
        let material = shape.get("material");
        let colors = material.is_some_and(|material| self.reads_colors(material, &mut BTreeSet::new()));
        let mut keys = shape.clone();
        for key in ["id", "material", "transform", "motion", "casts_shadow"] {
            keys.remove(key);
        }
        if !colors {
            keys.remove("vertex_colors");
        }
        let kind = table::kind(shape);
        let mut key = keys.to_string();
        let mut found = self.attributes(&key, &keys);
        if keys.contains_key("displacement") && matches!(found, Err(Missing::Faulty(_))) {
            // Its height may be a texture.
            self.note("[[shape]] mesh with displacement", name);
            keys.remove("displacement");
            key = keys.to_string();
            found = self.attributes(&key, &keys);
        }
        let mut attributes = match found {
            Ok(attributes) => attributes,
            Err(Missing::Curved) => {
                self.note("[[shape]] without triangles", &format!("{name} {kind}"));
                return None;
            }
            Err(Missing::Faulty(message)) => {
                self.note("[[shape]] that is not written", &format!("{name}: {message}"));
                return None;
            }
        };
        if kind == "mesh" {
            let bounds = &attributes.bounds;
            let farthest = bounds.low.abs().max(bounds.high.abs()).max_element();
            let size = (bounds.high - bounds.low).max_element();
            // Half a unit in the last place of the farthest vertex.
            let rounding = farthest * f64::from(f32::EPSILON) / 2.0;
            self.note(
                if rounding > 1e-6 * size {
                    "[[shape]] mesh far from its own origin"
                } else {
                    "[[shape]] mesh"
                },
                name,
            );
        }
        let material = self.material(material, name);
        if let Some(known) = self.meshes.get(&(key.clone(), material.index)) {
            return Some((*known, attributes.bounds));
        }
        for (set, wanted) in material.uv_sets.into_iter().enumerate() {
            if wanted && attributes.uvs[set].is_none() {
                // Shapes without texture coordinates have (0, 0); sets are numbered from 0.
                for earlier in attributes.uvs.iter_mut().take(set + 1) {
                    if earlier.is_none() {
                        let zero = vec![[0.0, 1.0]; attributes.vertices];
                        *earlier = Some(self.buffer.attribute(&zero, false));
                    }
                }
            }
        }
        self.attributes.insert(key.clone(), Ok(attributes));
        let mut list = Map::new();
        list.insert("POSITION".into(), attributes.position.into());
        let others = [
            ("NORMAL", attributes.normal),
            ("TANGENT", attributes.tangent),
            ("TEXCOORD_0", attributes.uvs[0]),
            ("TEXCOORD_1", attributes.uvs[1]),
            ("COLOR_0", attributes.color),
        ];
        for (semantic, accessor) in others {
            if let Some(accessor) = accessor {
                list.insert(semantic.into(), accessor.into());
            }
        }
        let primitive = json!({
            "attributes": list,
            "indices": attributes.indices,
            "material": material.index,
        });
        self.root
            .meshes
            .push(json!({ "name": name, "primitives": [primitive] }));
        let index = self.root.meshes.len() - 1;
        self.meshes.insert((key, material.index), index);
        Some((index, attributes.bounds))
    }

    /// The accessors of the triangles of a shape. `key` is its table as text.
    fn attributes(&mut self, key: &str, shape: &Table) -> Result<Attributes, Missing> {
        if let Some(known) = self.attributes.get(key) {
            return known.clone();
        }
        let found = geometry::triangles(shape, &self.base).map(|triangles| {
            let mut bounds = Part::EMPTY;
            for position in &triangles.positions {
                bounds.add(DVec3::from(position.map(f64::from)));
            }
            let buffer = &mut self.buffer;
            let vertices = triangles.positions.len();
            let mut optional = |used: bool, write: &dyn Fn(&mut Buffer) -> usize| used.then(|| write(buffer));
            let normal = optional(!triangles.normals.is_empty(), &|buffer| {
                buffer.attribute(&triangles.normals, false)
            });
            let uvs = [0, 1].map(|set| {
                let list = &triangles.uvs[set];
                optional(!list.is_empty(), &|buffer| buffer.attribute(list, false))
            });
            let color = optional(!triangles.colors.is_empty(), &|buffer| {
                buffer.attribute(&triangles.colors, false)
            });
            let tangent = optional(!triangles.tangents.is_empty(), &|buffer| {
                buffer.attribute(&triangles.tangents, false)
            });
            Attributes {
                vertices,
                position: buffer.attribute(&triangles.positions, true),
                normal,
                uvs,
                color,
                // Tangents are relative to normals.
                tangent: tangent.filter(|_| normal.is_some()),
                indices: buffer.indices(&triangles.indices, vertices),
                bounds,
            }
        });
        self.attributes.insert(key.to_owned(), found.clone());
        found
    }

    /// Whether a material reads vertex colours.
    fn reads_colors(&self, value: &'a Value, seen: &mut BTreeSet<&'a str>) -> bool {
        match value {
            Value::String(id) => {
                seen.insert(id)
                    && ["material", "texture"].into_iter().any(|family| {
                        let found = table::table(self.document, family).and_then(|all| all.get(id));
                        found.is_some_and(|found| self.reads_colors(found, seen))
                    })
            }
            Value::Array(items) => items.iter().any(|item| self.reads_colors(item, seen)),
            Value::Table(keys) => {
                table::kind(keys) == "vertex_color"
                    || keys.iter().any(|(_, item)| self.reads_colors(item, seen))
            }
            _ => false,
        }
    }

    /// Adds a node.
    fn node(&mut self, name: &str, map: &DAffine3) -> usize {
        let mut node = json!({ "name": name });
        if let Some(matrix) = node::matrix(map) {
            node["matrix"] = matrix;
        }
        self.root.nodes.push(node);
        self.root.nodes.len() - 1
    }

    /// Adds nodes for a map: the outermost and the innermost.
    fn nodes(&mut self, name: &str, map: &DAffine3) -> (usize, usize) {
        let factors = node::factors(map);
        let outer = self.node(name, &factors[0]);
        let inner = match factors.get(1) {
            None => outer,
            Some(factor) => {
                let inner = self.node(name, factor);
                self.root.nodes[outer]["children"] = json!([inner]);
                inner
            }
        };
        (outer, inner)
    }

    /// Adds the nodes of a list of shapes to `out`. `world`: the transform around it.
    fn place(&mut self, group: Option<&'a str>, world: &DAffine3, depth: usize, out: &mut Vec<usize>) {
        let document: &'a Table = self.document;
        let shapes = match group {
            None => table::tables(document, "shape"),
            Some(id) => self.group(id),
        };
        for (number, shape) in shapes.into_iter().enumerate() {
            let name = name(shape, group, number);
            if self.root.nodes.len() >= MAX_NODES || depth > MAX_DEPTH {
                self.note("[[shape]] instance beyond the limit", &name);
                return;
            }
            let own = table::transform(shape);
            let world = *world * own;
            if shape.get("casts_shadow").and_then(Value::as_bool) == Some(false) {
                self.note("[[shape]] without a shadow", &name);
            }
            if shape.contains_key("materials") {
                self.note("[[shape]] materials of an instance", &name);
            }
            if shape.contains_key("motion") {
                self.note("[[shape]] motion", &name);
            }
            if table::kind(shape) == "instance" {
                let Some(inside) = table::text(shape, "group") else {
                    continue;
                };
                let (outer, inner) = self.nodes(&name, &own);
                let mut children = Vec::new();
                self.place(Some(inside), &world, depth + 1, &mut children);
                let last = self.root.nodes.len() - 1;
                if children.is_empty() {
                    self.root.nodes.truncate(outer);
                    continue;
                }
                let only = &self.root.nodes[last];
                if children == [last] && last == inner + 1 && only.get("matrix").is_none() {
                    // One mesh at the origin of its group needs no node of its own.
                    let mesh = only["mesh"].clone();
                    self.root.nodes.truncate(last);
                    self.root.nodes[inner]["mesh"] = mesh;
                } else {
                    self.root.nodes[inner]["children"] = children.into();
                }
                out.push(outer);
            } else if let Some((mesh, bounds)) = self.shapes.get(&(group.map(str::to_owned), number)).copied()
            {
                let (outer, inner) = self.nodes(&name, &own);
                self.root.nodes[inner]["mesh"] = mesh.into();
                let bounds = bounds.transformed(&world);
                self.bounds.add(bounds.low);
                self.bounds.add(bounds.high);
                out.push(outer);
            }
        }
    }

    /// The document as it is kept in the file.
    fn kept(&mut self) -> Table {
        let mut kept = self.document.clone();
        // A mesh in another precision would hide a light on it.
        let lights: BTreeSet<&str> = table::tables(self.document, "light")
            .into_iter()
            .filter_map(|light| table::text(light, "file"))
            .collect();
        let mut lists: Vec<(Option<String>, &mut Value)> = Vec::new();
        let placed: BTreeSet<String> = self.placed_groups().into_iter().map(str::to_owned).collect();
        let mut groups = kept.remove("group");
        if let Some(Value::Table(groups)) = &mut groups {
            for (id, group) in groups.iter_mut() {
                if let Some(shapes) = group.get_mut("shape").filter(|_| placed.contains(id)) {
                    lists.push((Some(id.clone()), shapes));
                }
            }
        }
        if let Some(shapes) = kept.get_mut("shape") {
            lists.push((None, shapes));
        }
        for (group, shapes) in lists {
            let shapes = shapes.as_array_mut().into_iter().flatten();
            for (number, shape) in shapes.enumerate() {
                let mesh = self.shapes.get(&(group.clone(), number)).map(|(mesh, _)| *mesh);
                if let (Some(shape), Some(mesh)) = (shape.as_table_mut(), mesh)
                    && !table::text(shape, "file").is_some_and(|file| lights.contains(file))
                {
                    refer_to_mesh(shape, mesh);
                }
                if group.is_some() {
                    self.files(shape);
                }
            }
        }
        let unused = self.unused();
        for (name, value) in kept.iter_mut() {
            match value {
                Value::Table(all) if name == "material" || name == "texture" => {
                    let used = all.iter_mut().filter(|(id, _)| !unused.contains(*id));
                    used.for_each(|(_, value)| self.files(value));
                }
                _ => self.files(value),
            }
        }
        if let Some(groups) = groups {
            kept.insert("group".to_owned(), groups);
        }
        kept
    }

    /// The ids of shared materials and textures that nothing names.
    fn unused(&self) -> BTreeSet<String> {
        let mut names = BTreeSet::new();
        for value in self.document.values() {
            strings(value, &mut names);
        }
        ["material", "texture"]
            .into_iter()
            .filter_map(|family| table::table(self.document, family))
            .flat_map(Table::keys)
            .filter(|id| !names.contains(id.as_str()))
            .cloned()
            .collect()
    }

    /// Moves the files that a value names into the exported file, or next to it.
    fn files(&mut self, value: &mut Value) {
        match value {
            Value::Array(items) => items.iter_mut().for_each(|item| self.files(item)),
            Value::Table(table) => {
                if let Some(file) = table::text(table, "file").map(str::to_owned) {
                    self.file(table, &file);
                }
                table.iter_mut().for_each(|(_, item)| self.files(item));
            }
            _ => {}
        }
    }

    fn file(&mut self, table: &mut Table, file: &str) {
        let lower = file.to_lowercase();
        let of_gltf = lower.ends_with(".gltf") || lower.ends_with(".glb");
        if table::kind(table) == "image" && !lower.ends_with(".exr") && (self.embedded || of_gltf) {
            if let Some(index) = self.image(table) {
                table.remove("file");
                table.insert("image".to_owned(), Value::Integer(index as i64));
            }
            return;
        }
        if self.embedded {
            self.note("[scene] files next to a .glb", file);
        }
        match self.copies.copy(file) {
            Ok(name) => {
                table.insert("file".to_owned(), Value::String(name));
            }
            Err(error) => self.fail(&error.message),
        }
    }
}

/// Lets a shape refer to a mesh of the exported file, which needs no name, instead of a file.
fn refer_to_mesh(shape: &mut Table, mesh: usize) {
    let changes = ["subdivision", "displacement"];
    if table::kind(shape) != "mesh" || changes.into_iter().any(|key| shape.contains_key(key)) {
        return;
    }
    for key in ["file", "part", "primitive", "skin", "weights"] {
        shape.remove(key);
    }
    shape.insert("mesh".to_owned(), Value::Integer(mesh as i64));
    if let Some(Value::Array(sets)) = shape.get_mut("uv_sets") {
        for (number, set) in sets.iter_mut().enumerate() {
            *set = Value::Integer(number as i64);
        }
    }
}

/// Collects all strings that are not keys.
fn strings<'v>(value: &'v Value, out: &mut BTreeSet<&'v str>) {
    match value {
        Value::String(text) => {
            out.insert(text);
        }
        Value::Array(items) => items.iter().for_each(|item| strings(item, out)),
        Value::Table(table) => table.values().for_each(|item| strings(item, out)),
        _ => {}
    }
}

/// The name of a shape in messages and of its node.
fn name(shape: &Table, group: Option<&str>, number: usize) -> String {
    match (table::text(shape, "id"), group) {
        (Some(id), _) => id.to_owned(),
        (None, None) => format!("shape[{number}]"),
        (None, Some(group)) => format!("group.{group}.shape[{number}]"),
    }
}

/// A relative path as a URI.
fn uri(path: &str) -> String {
    let mut uri = String::new();
    for byte in path.bytes() {
        if byte.is_ascii_alphanumeric() || b"-._~/".contains(&byte) {
            uri.push(byte.into());
        } else {
            let _ = write!(uri, "%{byte:02X}");
        }
    }
    uri
}

/// Writes the file and, in the same folder, its buffer.
fn write(path: &Path, embedded: bool, root: Root, buffer: Buffer, kept: Table) -> Result<(), FormatError> {
    let mut file = json!({
        "asset": {
            "version": "2.0",
            "generator": concat!("Whitstone ", env!("CARGO_PKG_VERSION")),
        },
    });
    let extensions = |list: BTreeSet<String>| list.into_iter().map(serde_json::Value::from).collect();
    let mut used = root.used;
    used.extend(root.required.iter().cloned());
    let lists: [(&str, Vec<serde_json::Value>); 12] = [
        ("nodes", root.nodes),
        ("meshes", root.meshes),
        ("materials", root.materials),
        ("textures", root.textures),
        ("samplers", root.samplers),
        ("images", root.images),
        ("cameras", root.cameras),
        ("accessors", buffer.accessors),
        ("bufferViews", buffer.views),
        ("extensionsUsed", extensions(used)),
        ("extensionsRequired", extensions(root.required)),
        (
            "buffers",
            if buffer.bytes.is_empty() {
                Vec::new()
            } else {
                vec![json!({ "byteLength": buffer.bytes.len() })]
            },
        ),
    ];
    // Lists must not be empty.
    for (name, list) in lists {
        if !list.is_empty() {
            file[name] = list.into();
        }
    }
    if !root.roots.is_empty() {
        file["scenes"] = json!([{ "nodes": root.roots }]);
        file["scene"] = json!(0);
    }
    if !root.lights.is_empty() {
        file["extensions"] = json!({ "KHR_lights_punctual": { "lights": root.lights } });
    }
    let bytes = buffer.bytes;
    if embedded {
        kept::keep(&mut file, &bytes, kept);
        return save(path, &container(&file, bytes)?);
    }
    if !bytes.is_empty() {
        let name = path.with_extension("bin");
        let file_name = name
            .file_name()
            .unwrap_or_default()
            .to_string_lossy()
            .into_owned();
        file["buffers"][0]["uri"] = uri(&file_name).into();
        save(&name, &bytes)?;
    }
    kept::keep(&mut file, &bytes, kept);
    let text = format!("{file:#}\n");
    check_length(text.len())?;
    save(path, text.as_bytes())
}

/// An error if the JSON is too long for the import.
fn check_length(length: usize) -> Result<(), FormatError> {
    if length as u64 <= MAX_JSON_BYTES {
        return Ok(());
    }
    Err(FormatError::anywhere(format!(
        "the scene needs {} MiB of JSON, more than {}",
        length >> 20,
        MAX_JSON_BYTES >> 20
    )))
}

/// The bytes of a .glb.
fn container(file: &serde_json::Value, mut bytes: Vec<u8>) -> Result<Vec<u8>, FormatError> {
    let mut text = file.to_string().into_bytes();
    check_length(text.len())?;
    text.resize(text.len().next_multiple_of(4), b' ');
    bytes.resize(bytes.len().next_multiple_of(4), 0);
    let chunks: &[(&[u8; 4], &[u8])] = &[(b"JSON", &text), (b"BIN\0", &bytes)];
    let chunks = if bytes.is_empty() { &chunks[..1] } else { chunks };
    let length: usize = 12 + chunks.iter().map(|(_, chunk)| 8 + chunk.len()).sum::<usize>();
    let word = |number: usize| {
        u32::try_from(number).map(u32::to_le_bytes).map_err(|_| {
            FormatError::anywhere("the scene is larger than 4 GiB, which a .glb cannot be")
                .with_help("write a .gltf file")
        })
    };
    let mut out = Vec::with_capacity(length);
    out.extend_from_slice(b"glTF");
    out.extend_from_slice(&2_u32.to_le_bytes());
    out.extend_from_slice(&word(length)?);
    for (kind, chunk) in chunks {
        out.extend_from_slice(&word(chunk.len())?);
        out.extend_from_slice(*kind);
        out.extend_from_slice(chunk);
    }
    Ok(out)
}

#[cfg(test)]
mod tests;
