//! Nodes, meshes and instances.

use super::kept::{self, Kept};
use super::material::Translated;
use super::{FEATURES, restore};
use crate::document::{Document as Scene, Ids, Shared, table, transform};
use crate::part::Part;
use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::path::Path;
use toml::{Table, Value};
use whitstone_core::{
    DAffine3, DMat3, DVec3, FormatError, FormatErrors, ImportOptions, Imported, Notes, Transform,
};
use whitstone_gltf::json::accessor::Type;
use whitstone_gltf::json::mesh::Semantic;
use whitstone_gltf::json::validation::Checked;
use whitstone_gltf::json::{Node, mesh};
pub(crate) use whitstone_gltf::shortest;
use whitstone_gltf::{Document, Error, MAX_NODE_DEPTH, has_triangles, local_transform, parents};

/// Maximum number of shapes and instances of an imported scene.
const MAX_SHAPES: usize = 100_000;

/// Translates a file.
pub(super) fn import(path: &Path, options: &ImportOptions) -> Result<Imported, FormatErrors> {
    let document = Document::open(path).map_err(told)?;
    let file = path
        .file_name()
        .unwrap_or_default()
        .to_string_lossy()
        .into_owned();
    let mut importer = Importer {
        document: &document,
        options,
        file,
        scene: Scene::default(),
        ids: Ids::new(&options.prefix),
        group_ids: Ids::new(&options.prefix),
        shape_ids: Ids::new(&options.prefix),
        textures: Shared::new(&options.prefix),
        translated: HashMap::new(),
        notes: Notes::default(),
        errors: Vec::new(),
        uses: BTreeMap::new(),
        has_camera: false,
        bounds: Part::EMPTY,
        shapes: 0,
    };
    match kept::read(path, &document) {
        Kept::None => {}
        Kept::Changed => importer.note("Whitstone scene, changed", "/extras/whitstone"),
        Kept::Scene(scene) if restore::follows(&scene, options) => {
            importer.note("Whitstone scene", "/extras/whitstone");
            return Ok(Imported {
                text: restore::restore(scene, path, &importer.file, options)?,
                notes: importer.notes.into_sorted(),
                files: document.companions(),
            });
        }
        Kept::Scene(_) => importer.note("Whitstone scene, in parts", "/extras/whitstone"),
    }
    importer.run()?;
    if !importer.errors.is_empty() {
        return Err(FormatErrors(importer.errors));
    }
    Ok(Imported {
        text: importer.scene.to_toml(),
        notes: importer.notes.into_sorted(),
        files: document.companions(),
    })
}

fn told(error: Error) -> FormatError {
    FormatError::at(error.pointer, error.message)
}

/// The state of an import.
pub(crate) struct Importer<'a> {
    pub(crate) document: &'a Document,
    pub(crate) options: &'a ImportOptions,
    /// Name of the imported file.
    pub(crate) file: String,
    pub(crate) scene: Scene,
    pub(crate) ids: Ids,
    group_ids: Ids,
    shape_ids: Ids,
    textures: Shared,
    /// Materials by index and by whether they have vertex colours.
    pub(crate) translated: HashMap<(Option<usize>, bool), Translated>,
    notes: Notes,
    errors: Vec<FormatError>,
    /// The places of each mesh, in the order of the nodes.
    uses: BTreeMap<MeshKey, Vec<Placed>>,
    has_camera: bool,
    /// Bounds of everything that was placed.
    bounds: Part,
    shapes: usize,
}

/// A mesh as it stands: instances share it if all of this is equal.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
struct MeshKey {
    mesh: usize,
    skin: Option<usize>,
    /// Weights of the node, as bits.
    weights: Option<Vec<u32>>,
}

/// A place of a mesh.
struct Placed {
    world: DAffine3,
    /// Name for the shape.
    name: String,
    /// JSON pointer of the node.
    pointer: String,
}

impl Importer<'_> {
    /// Converts the errors of the reader.
    pub(crate) fn told(&self) -> fn(Error) -> FormatError {
        told
    }

    /// Notes an occurrence of a feature.
    pub(crate) fn note(&mut self, feature: &str, place: &str) {
        self.notes
            .add(FEATURES, feature, if place.is_empty() { "/" } else { place });
    }

    /// The id of a shared texture with these keys.
    pub(crate) fn shared_texture(&mut self, name: &str, keys: Table) -> Value {
        Value::String(self.textures.id(&mut self.scene.textures, name, keys))
    }

    fn run(&mut self) -> Result<(), FormatError> {
        let document = self.document;
        let root = &document.root;
        let parents = parents(document).map_err(told)?;
        let (roots, pointer) = self.roots(&parents)?;
        if !root.animations.is_empty() {
            self.note("animations", "/animations");
        }
        let extensions = root.extensions.as_ref();
        let image_light = "EXT_lights_image_based";
        if extensions.is_some_and(|extensions| extensions.others.contains_key(image_light)) {
            self.note(image_light, &format!("/extensions/{image_light}"));
        }
        for (place, node) in roots.into_iter().enumerate() {
            let pointer = || format!("{pointer}/{place}");
            Document::item(&root.nodes, node, "nodes", pointer).map_err(told)?;
            let world = if self.options.node.is_some() {
                // The selected node keeps its place in the scene.
                whitstone_gltf::world_transform(document, &parents, node).map_err(told)?
            } else {
                local_transform(&root.nodes[node])
            };
            self.node(node, self.options.transform * world, 0)?;
        }
        self.morph_targets()?;
        self.meshes()?;
        self.known_materials()?;
        if self.scene.shapes.is_empty() && !self.options.part {
            let message = "the scene has no triangles";
            let error = FormatError::anywhere(message);
            return Err(match root.scenes.len() {
                0 | 1 => error,
                count => error.with_help(format!("the file has {count} scenes: select another one")),
            });
        }
        if let (Some(wanted), false) = (&self.options.camera, self.has_camera) {
            let names: Vec<String> = (root.cameras.iter().enumerate())
                .map(|(index, camera)| camera.name.clone().unwrap_or_else(|| index.to_string()))
                .collect();
            let error = FormatError::anywhere(format!("no node of the scene has the camera \"{wanted}\""));
            return Err(error.with_help(format!("cameras of the file: {}", names.join(", "))));
        }
        if !self.options.part {
            // The bounds are those after the transform of the options already.
            let bounds = (self.bounds.low, self.bounds.high);
            if !self.has_camera {
                self.note("no camera", "/");
                self.scene.single.push(("film", crate::fit::film()));
                self.scene
                    .single
                    .push(("camera", crate::fit::camera(bounds.0, bounds.1)));
            }
            if self.scene.lights.is_empty() {
                self.note("no lights", "/");
                self.scene.lights = crate::fit::lights(bounds.0, bounds.1);
            }
            self.scene.pass_through_layers();
        }
        Ok(())
    }

    /// The nodes to import, and the JSON pointer of their list.
    fn roots(&self, parents: &[Option<usize>]) -> Result<(Vec<usize>, String), FormatError> {
        let root = &self.document.root;
        if let Some(wanted) = &self.options.node {
            let names = root.nodes.iter().map(|node| node.name.as_deref());
            let node = select(wanted, names, "node")?;
            return Ok((vec![node], "/nodes".to_owned()));
        }
        let scene = match &self.options.scene {
            Some(wanted) => {
                let names = root.scenes.iter().map(|scene| scene.name.as_deref());
                Some(select(wanted, names, "scene")?)
            }
            None => match root.scene {
                Some(scene) => {
                    let pointer = || "/scene".to_owned();
                    Document::item(&root.scenes, scene.value(), "scenes", pointer).map_err(told)?;
                    Some(scene.value())
                }
                None => (!root.scenes.is_empty()).then_some(0),
            },
        };
        Ok(match scene {
            Some(scene) => {
                let nodes = root.scenes[scene].nodes.iter().map(|node| node.value());
                (nodes.collect(), format!("/scenes/{scene}/nodes"))
            }
            // If the file has no scenes: all root nodes.
            None => {
                let free = (0..parents.len()).filter(|node| parents[*node].is_none());
                (free.collect(), "/nodes".to_owned())
            }
        })
    }

    fn node(&mut self, number: usize, world: DAffine3, depth: usize) -> Result<(), FormatError> {
        let pointer = format!("/nodes/{number}");
        if depth > MAX_NODE_DEPTH {
            let message = format!("is in a cycle, or nested more than {MAX_NODE_DEPTH} deep");
            return Err(FormatError::at(pointer, message));
        }
        let document = self.document;
        let node = &document.root.nodes[number];
        let extension = |name: &str| node.extensions.as_ref().and_then(|all| all.others.get(name));
        let visible = extension("KHR_node_visibility").and_then(|extension| extension.get("visible"));
        if visible == Some(&whitstone_gltf::json::Value::Bool(false)) {
            self.note("invisible nodes", &pointer);
            return Ok(());
        }
        if let Some(mesh) = node.mesh {
            self.place(node, mesh.value(), world, &pointer)?;
        }
        if let Some(camera) = node.camera {
            let name = document.root.cameras.get(camera.value());
            let name = name.and_then(|camera| camera.name.as_deref());
            let of_node = node.name.as_deref();
            let wanted = self.options.camera.as_deref().is_none_or(|wanted| {
                name == Some(wanted) || of_node == Some(wanted) || wanted.parse() == Ok(camera.value())
            });
            if wanted && !self.has_camera {
                self.add_camera(camera.value(), &world, &pointer)?;
                self.has_camera = true;
            } else {
                self.note("other cameras", &format!("/cameras/{}", camera.value()));
            }
        }
        if let Some(extensions) = &node.extensions {
            if let Some(light) = &extensions.khr_lights_punctual
                && self.options.lights
            {
                self.add_light(light.light.value(), &world, &pointer)?;
            }
            for name in extensions.others.keys() {
                if !["EXT_mesh_gpu_instancing", "KHR_node_visibility"].contains(&name.as_str()) {
                    self.note("unknown extensions", &format!("{pointer}/extensions/{name}"));
                }
            }
        }
        for (place, child) in node.children.iter().flatten().enumerate() {
            let at = || format!("{pointer}/children/{place}");
            let child_node =
                Document::item(&document.root.nodes, child.value(), "nodes", at).map_err(told)?;
            self.node(child.value(), world * local_transform(child_node), depth + 1)?;
        }
        Ok(())
    }

    /// Records the places of a mesh.
    fn place(&mut self, node: &Node, mesh: usize, world: DAffine3, pointer: &str) -> Result<(), FormatError> {
        let root = &self.document.root;
        let at = || format!("{pointer}/mesh");
        let found = Document::item(&root.meshes, mesh, "meshes", at).map_err(told)?;
        let name = node.name.clone().or_else(|| found.name.clone());
        let name = name.unwrap_or_else(|| format!("mesh{mesh}"));
        let key = MeshKey {
            mesh,
            skin: node.skin.map(|skin| skin.value()),
            weights: node
                .weights
                .as_ref()
                .map(|weights| weights.iter().map(|weight| weight.to_bits()).collect()),
        };
        let mut worlds = vec![world];
        if key.skin.is_some() {
            // The transform of a node with a skin is ignored.
            worlds = vec![self.options.transform];
            self.note("skins", pointer);
        }
        let instancing = node.extensions.as_ref();
        if let Some(instancing) = instancing.and_then(|all| all.others.get("EXT_mesh_gpu_instancing")) {
            let pointer = format!("{pointer}/extensions/EXT_mesh_gpu_instancing");
            self.note("EXT_mesh_gpu_instancing", &pointer);
            worlds = self
                .instances(instancing, &pointer)?
                .into_iter()
                .map(|local| world * local)
                .collect();
        }
        for world in worlds {
            self.shapes += 1;
            if self.shapes > MAX_SHAPES {
                let message = format!("the scene has more than {MAX_SHAPES} meshes and instances");
                return Err(FormatError::at(pointer, message));
            }
            if Transform::new(world).is_none() {
                self.note("nodes without volume", pointer);
                continue;
            }
            self.uses.entry(key.clone()).or_default().push(Placed {
                world,
                name: name.clone(),
                pointer: pointer.to_owned(),
            });
        }
        Ok(())
    }

    /// The transforms of EXT_mesh_gpu_instancing.
    fn instances(
        &self,
        extension: &whitstone_gltf::json::Value,
        pointer: &str,
    ) -> Result<Vec<DAffine3>, FormatError> {
        let read = |name: &str, kind: Type| {
            let Some(index) = extension.get("attributes").and_then(|all| all.get(name)) else {
                return Ok(None);
            };
            let place = || format!("{pointer}/attributes/{name}");
            let index = index
                .as_u64()
                .ok_or_else(|| FormatError::at(place(), "expected the index of an accessor"))?;
            // An accessor without a buffer view may have any count.
            let accessor = self.document.root.accessors.get(index as usize);
            if accessor.is_some_and(|accessor| accessor.count.0 > MAX_SHAPES as u64) {
                let message = format!("has more than {MAX_SHAPES} instances");
                return Err(FormatError::at(place(), message));
            }
            let numbers = self
                .document
                .numbers(index as usize, &[kind], &place)
                .map_err(told)?;
            Ok(Some(numbers))
        };
        let moved = read("TRANSLATION", Type::Vec3)?.map(|numbers| numbers.arrays::<3>(0.0));
        let turned = read("ROTATION", Type::Vec4)?.map(|numbers| numbers.arrays::<4>(0.0));
        let scaled = read("SCALE", Type::Vec3)?.map(|numbers| numbers.arrays::<3>(0.0));
        let counts = [
            moved.as_ref().map(Vec::len),
            turned.as_ref().map(Vec::len),
            scaled.as_ref().map(Vec::len),
        ];
        let count = counts.iter().flatten().copied().max().unwrap_or(0);
        if counts.iter().flatten().any(|other| *other != count) {
            return Err(FormatError::at(pointer, "the attributes have different counts"));
        }
        if count > MAX_SHAPES {
            return Err(FormatError::at(
                pointer,
                format!("has more than {MAX_SHAPES} instances"),
            ));
        }
        let of = |k: usize| {
            let translation = moved.as_ref().map_or(DVec3::ZERO, |all| all[k].into());
            let scale = scaled.as_ref().map_or(DVec3::ONE, |all| all[k].into());
            let [x, y, z, w] = turned.as_ref().map_or([0.0, 0.0, 0.0, 1.0], |all| all[k]);
            let rotation = whitstone_gltf::rotation([x, y, z, w]);
            DAffine3::from_mat3_translation(rotation * DMat3::from_diagonal(scale), translation)
        };
        Ok((0..count).map(of).collect())
    }

    /// Notes what is not read of morph targets.
    fn morph_targets(&mut self) -> Result<(), FormatError> {
        let meshes = &self.document.root.meshes;
        let used: BTreeSet<usize> = self.uses.keys().map(|key| key.mesh).collect();
        let is_morphed =
            |mesh: &usize| (meshes[*mesh].primitives.iter()).any(|primitive| primitive.targets.is_some());
        let morphed: Vec<usize> = used.into_iter().filter(is_morphed).collect();
        if morphed.is_empty() {
            return Ok(());
        }
        // The parsed document has only what is read.
        let text = Document::text(self.document.path()).map_err(told)?;
        let text = text.trim_start_matches('\u{feff}');
        let root: serde_json::Value = serde_json::from_str(text).unwrap_or_default();
        for mesh in morphed {
            for number in 0..meshes[mesh].primitives.len() {
                let pointer = format!("/meshes/{mesh}/primitives/{number}/targets");
                let targets = root.pointer(&pointer).and_then(|targets| targets.as_array());
                for (target, attributes) in targets.into_iter().flatten().enumerate() {
                    for name in attributes.as_object().into_iter().flat_map(|all| all.keys()) {
                        if name.starts_with("COLOR_") || name.starts_with("TEXCOORD_") {
                            let feature = "morph targets of colours and texture coordinates";
                            self.note(feature, &format!("{pointer}/{target}/{name}"));
                        }
                    }
                }
            }
        }
        Ok(())
    }

    /// Writes the shapes of all meshes: directly, or as instances of a group.
    fn meshes(&mut self) -> Result<(), FormatError> {
        // In the order of the meshes, not of the nodes.
        let uses = std::mem::take(&mut self.uses);
        for (key, places) in uses {
            let shapes = self.primitives(&key, &places[0].pointer)?;
            if shapes.is_empty() {
                continue;
            }
            let local = self.mesh_bounds(&key)?;
            for placed in &places {
                let bounds = local.transformed(&placed.world);
                self.bounds.add(bounds.low);
                self.bounds.add(bounds.high);
            }
            if let [placed] = &places[..] {
                for (number, mut shape) in shapes.into_iter().enumerate() {
                    let name = if number == 0 {
                        placed.name.clone()
                    } else {
                        format!("{}.{number}", placed.name)
                    };
                    self.add_shape(&mut shape, &placed.world, &name);
                }
                continue;
            }
            let name = self.document.root.meshes[key.mesh].name.clone();
            let group = self
                .group_ids
                .unique(&name.unwrap_or_else(|| format!("mesh{}", key.mesh)));
            self.note("instances", &format!("/meshes/{}", key.mesh));
            self.scene.groups.push((group.clone(), shapes));
            for placed in &places {
                let mut instance = table([
                    ("type", Value::String("instance".into())),
                    ("group", Value::String(group.clone())),
                ]);
                self.add_shape(&mut instance, &placed.world, &placed.name);
            }
        }
        Ok(())
    }

    fn add_shape(&mut self, shape: &mut Table, world: &DAffine3, name: &str) {
        shape.insert("id".into(), Value::String(self.shape_ids.unique(name)));
        if *world != DAffine3::IDENTITY {
            shape.insert("transform".into(), transform(world));
        }
        self.scene.shapes.push(std::mem::take(shape));
    }

    /// The shapes of a mesh, one for each primitive with triangles.
    fn primitives(&mut self, key: &MeshKey, node: &str) -> Result<Vec<Table>, FormatError> {
        let document = self.document;
        let mesh = &document.root.meshes[key.mesh];
        let mut shapes = Vec::new();
        for (number, primitive) in mesh.primitives.iter().enumerate() {
            let pointer = format!("/meshes/{}/primitives/{number}", key.mesh);
            for name in primitive.extensions.iter().flat_map(|all| all.others.keys()) {
                let at = format!("{pointer}/extensions/{name}");
                match name.as_str() {
                    "KHR_materials_variants" => self.note(name, &at),
                    // The accessors have the same mesh, or are refused.
                    "KHR_draco_mesh_compression" => {}
                    _ => self.note("unknown extensions", &at),
                }
            }
            if !has_triangles(primitive) {
                if primitive.mode == Checked::Invalid {
                    return Err(FormatError::at(
                        format!("{pointer}/mode"),
                        "expected a number from 0 to 6",
                    ));
                }
                self.note("points and lines", &pointer);
                continue;
            }
            if self.is_empty(primitive) {
                continue;
            }
            let has = |semantic| primitive.attributes.contains_key(&Checked::Valid(semantic));
            let colors = has(Semantic::Colors(0));
            // Tangents without normals are ignored.
            let tangents = has(Semantic::Tangents) && has(Semantic::Normals);
            let index = primitive.material.map(|material| material.value());
            let material = self.material(index, colors, tangents, &pointer)?;
            let mut shape = table([
                ("type", Value::String("mesh".into())),
                ("file", Value::String(self.file.clone())),
                ("mesh", Value::Integer(key.mesh as i64)),
                ("primitive", Value::Integer(number as i64)),
                ("material", Value::String(material.id)),
            ]);
            // Sets at the end that the primitive lacks are left out: a missing set reads as (0, 0).
            let mut sets = material.uv_sets;
            while sets.last().is_some_and(|set| !has(Semantic::TexCoords(*set))) {
                sets.pop();
            }
            if sets != [0] {
                let sets = sets.iter().map(|set| Value::Integer((*set).into()));
                shape.insert("uv_sets".into(), Value::Array(sets.collect()));
            }
            if material.colors && colors {
                shape.insert("vertex_colors".into(), Value::Boolean(true));
            }
            if material.tangents {
                shape.insert("tangents".into(), Value::Boolean(true));
            }
            if let Some(skin) = key.skin {
                let pointer = || format!("{node}/skin");
                Document::item(&document.root.skins, skin, "skins", pointer).map_err(told)?;
                shape.insert("skin".into(), Value::Integer(skin as i64));
            }
            if let Some(weights) = &key.weights {
                let weights = weights
                    .iter()
                    .map(|bits| Value::Float(shortest(f32::from_bits(*bits))));
                shape.insert("weights".into(), Value::Array(weights.collect()));
            }
            shapes.push(shape);
        }
        Ok(shapes)
    }

    /// Whether a primitive has too few vertices for a triangle.
    fn is_empty(&self, primitive: &mesh::Primitive) -> bool {
        let position = primitive
            .attributes
            .get(&Checked::Valid(Semantic::Positions))
            .copied();
        let list = primitive.indices.or(position);
        let accessor = list.and_then(|index| self.document.root.accessors.get(index.value()));
        accessor.is_some_and(|accessor| accessor.count.0 < 3)
    }

    /// The bounds of a mesh in its own space, or those of its skinned vertices.
    fn mesh_bounds(&self, key: &MeshKey) -> Result<Part, FormatError> {
        let mut bounds = Part::EMPTY;
        let mesh = &self.document.root.meshes[key.mesh];
        for (number, primitive) in mesh.primitives.iter().enumerate() {
            if !has_triangles(primitive) || self.is_empty(primitive) {
                continue;
            }
            let Some(index) = primitive.attributes.get(&Checked::Valid(Semantic::Positions)) else {
                continue;
            };
            let accessor = self.document.root.accessors.get(index.value());
            let plain = key.skin.is_none() && primitive.targets.is_none();
            let ends = accessor.filter(|accessor| plain && !accessor.normalized);
            let end = |value: &Option<whitstone_gltf::json::Value>| {
                let list = value.as_ref()?.as_array()?;
                let part = |k: usize| list.get(k)?.as_f64();
                Some(DVec3::new(part(0)?, part(1)?, part(2)?))
            };
            if let Some(accessor) = ends
                && let (Some(low), Some(high)) = (end(&accessor.min), end(&accessor.max))
            {
                bounds.add(low);
                bounds.add(high);
                continue;
            }
            let weights: Option<Vec<f64>> = key
                .weights
                .as_ref()
                .map(|weights| weights.iter().map(|bits| f32::from_bits(*bits).into()).collect());
            let request = whitstone_gltf::Request {
                mesh: key.mesh,
                primitive: number,
                weights: weights.as_deref(),
                skin: key.skin,
                ..Default::default()
            };
            let found = whitstone_gltf::Primitive::read(self.document, &request).map_err(told)?;
            for position in found.positions {
                bounds.add(position.into());
            }
        }
        Ok(bounds)
    }

    /// Reports overrides of materials that the file does not have.
    fn known_materials(&mut self) -> Result<(), FormatError> {
        let names = self.document.root.materials.iter().enumerate();
        let names: Vec<String> = names
            .map(|(index, material)| {
                material
                    .name
                    .clone()
                    .unwrap_or_else(|| format!("material{index}"))
            })
            .chain(["default".to_owned()])
            .collect();
        for name in self.options.materials.keys() {
            if !names.contains(name) {
                self.errors.push(crate::part::unknown_material(name, &names));
            }
        }
        Ok(())
    }
}

/// The item with a name, or else with an index.
fn select<'n>(
    wanted: &str,
    names: impl ExactSizeIterator<Item = Option<&'n str>> + Clone,
    what: &str,
) -> Result<usize, FormatError> {
    let count = names.len();
    if let Some(found) = names.clone().position(|name| name == Some(wanted)) {
        return Ok(found);
    }
    if let Some(index) = wanted.parse().ok().filter(|index: &usize| *index < count) {
        return Ok(index);
    }
    let error = FormatError::anywhere(format!("the file has no {what} \"{wanted}\""));
    let known: Vec<&str> = names.flatten().collect();
    Err(match whitstone_core::nearest(wanted, known.iter().copied()) {
        Some(near) => error.with_help(format!("did you mean \"{near}\"?")),
        None => error.with_help(format!(
            "it has {count}: expected a name or an index below {count}"
        )),
    })
}

#[cfg(test)]
mod tests;
