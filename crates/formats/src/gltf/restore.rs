//! The import of the scene that an exported file keeps in `extras`.

use crate::document::{Document as Scene, numbers, table as keys, transform};
use crate::files::Folder;
use crate::{part, table};
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use toml::{Table, Value};
use whitstone_core::{DAffine3, DVec3, FormatError, FormatErrors, ImportOptions};

/// Keys whose strings name neither materials nor textures.
const WORDS: [&str; 12] = [
    "type",
    "kind",
    "filter",
    "wrap",
    "color_space",
    "channel",
    "projection",
    "format",
    "file",
    "metal",
    "space",
    "tangent",
];
/// Textures that are mapped by position in the world by default.
const SOLID: [&str; 7] = [
    "checker3d",
    "stripes",
    "rings",
    "gradient",
    "noise",
    "worley",
    "solid",
];
/// Largest difference of the axes of a similarity, relative to their length.
const SIMILAR: f64 = 1e-9;

/// Whether the options can be followed: parts of the scene cannot be selected, and it can be moved,
/// turned and scaled, but not stretched.
pub(super) fn follows(scene: &Table, options: &ImportOptions) -> bool {
    if options.scene.is_some() || options.node.is_some() || options.camera.is_some() {
        return false;
    }
    let map = &options.transform;
    if *map == DAffine3::IDENTITY {
        return true;
    }
    // Environments do not turn.
    let turns = table::tables(scene, "light")
        .into_iter()
        .all(|light| table::kind(light) != "environment");
    let columns = [map.matrix3.x_axis, map.matrix3.y_axis, map.matrix3.z_axis];
    let scale = columns[0].length();
    let similar = (0..3).all(|k| {
        (columns[k].length() - scale).abs() <= SIMILAR * scale
            && columns[k].dot(columns[(k + 1) % 3]).abs() <= SIMILAR * scale * scale
    });
    turns && similar && map.matrix3.determinant() > 0.0
}

/// The scene of a file as TOML. `file`: the name of the imported file.
pub(super) fn restore(
    scene: Table,
    path: &Path,
    file: &str,
    options: &ImportOptions,
) -> Result<String, FormatErrors> {
    // The scene may be by somebody else.
    let folder = Folder::of(path, options);
    let mut outside = Vec::new();
    for value in scene.values() {
        check_files(value, &folder, &mut outside);
    }
    if !outside.is_empty() {
        return Err(FormatErrors(outside));
    }
    let mut restorer = Restorer {
        file,
        map: options.transform,
        materials: BTreeMap::new(),
        textures: BTreeMap::new(),
    };
    let mut document = Scene::from_table(&scene);
    let prefixed = |id: &str| format!("{}{id}", options.prefix);
    for (id, _) in &document.materials {
        let given = options.materials.get(id).cloned();
        let new = given.unwrap_or_else(|| prefixed(id));
        restorer.materials.insert(id.clone(), new);
    }
    let known: Vec<String> = restorer.materials.keys().cloned().collect();
    let unknown: Vec<FormatError> = options
        .materials
        .keys()
        .filter(|name| !restorer.materials.contains_key(*name))
        .map(|name| part::unknown_material(name, &known))
        .collect();
    if !unknown.is_empty() {
        return Err(FormatErrors(unknown));
    }
    for (id, _) in &document.textures {
        restorer.textures.insert(id.clone(), prefixed(id));
    }
    if options.part {
        let kept = ["film", "camera"];
        document.single.retain(|(name, _)| kept.contains(name));
    }
    if !options.lights {
        document.lights.clear();
    }
    document
        .materials
        .retain(|(id, _)| !options.materials.contains_key(id));
    for (id, material) in &mut document.materials {
        *id = restorer.materials[id].clone();
        restorer.material(material);
    }
    for (id, texture) in &mut document.textures {
        *id = restorer.textures[id].clone();
        restorer.texture(texture);
    }
    for light in &mut document.lights {
        restorer.light(light);
    }
    for (id, shapes) in &mut document.groups {
        *id = prefixed(id);
        for shape in shapes {
            restorer.shape(shape, &options.prefix);
        }
    }
    for shape in &mut document.shapes {
        restorer.shape(shape, &options.prefix);
        restorer.place(shape);
    }
    if options.transform != DAffine3::IDENTITY {
        for (name, single) in &mut document.single {
            if *name == "camera"
                && let Some(Value::Table(look_at)) = single.get_mut("look_at")
            {
                let points: BTreeSet<&str> = ["origin", "target"].into();
                look_at.entry("up").or_insert_with(|| numbers([0.0, 1.0, 0.0]));
                restorer.vectors(look_at, &points, &["up"]);
            }
        }
    }
    Ok(document.to_toml())
}

/// Reports the files that a value names and that an import must not read.
fn check_files(value: &Value, folder: &Folder, errors: &mut Vec<FormatError>) {
    match value {
        Value::Array(items) => items.iter().for_each(|item| check_files(item, folder, errors)),
        Value::Table(table) => {
            if let Some(file) = table::text(table, "file")
                && let Err(message) = folder.find("", file)
            {
                errors.push(FormatError::at("/extras/whitstone/scene", message));
            }
            table.values().for_each(|item| check_files(item, folder, errors));
        }
        _ => {}
    }
}

/// Changes of a scene.
struct Restorer<'a> {
    file: &'a str,
    map: DAffine3,
    /// Old ids and new ones.
    materials: BTreeMap<String, String>,
    textures: BTreeMap<String, String>,
}

impl Restorer<'_> {
    fn moves(&self) -> bool {
        self.map != DAffine3::IDENTITY
    }

    /// Appends the transform of the options to that of a shape or light.
    fn place(&self, table: &mut Table) {
        if !self.moves() {
            return;
        }
        if let Some(Value::Array(keyframes)) = table.get_mut("motion") {
            // The motion follows the transform.
            for keyframe in keyframes.iter_mut().filter_map(Value::as_table_mut) {
                self.append(keyframe);
            }
        } else {
            self.append(table);
        }
    }

    /// Appends the transform of the options to the steps of a table.
    fn append(&self, table: &mut Table) {
        let mut steps = match table.remove("transform") {
            None => Vec::new(),
            Some(Value::Array(steps)) => steps,
            Some(step) => vec![step],
        };
        steps.push(transform(&self.map));
        table.insert("transform".to_owned(), Value::Array(steps));
    }

    /// Transforms points and directions of a table.
    fn vectors(&self, table: &mut Table, points: &BTreeSet<&str>, directions: &[&str]) {
        for (key, value) in table.iter_mut() {
            let Some(Ok(found)) = table::numbers(value).map(<[f64; 3]>::try_from) else {
                continue;
            };
            let vector = DVec3::from(found);
            if points.contains(key.as_str()) {
                *value = numbers(self.map.transform_point3(vector).to_array());
            } else if directions.contains(&key.as_str()) {
                *value = numbers(self.map.transform_vector3(vector).to_array());
            }
        }
    }

    fn light(&self, light: &mut Table) {
        for (key, value) in light.iter_mut() {
            if !WORDS.contains(&key.as_str()) && key != "shape" && key != "falloff" {
                self.texture_value(value);
            }
        }
        if !self.moves() {
            return;
        }
        match table::kind(light) {
            "area" => self.place(light),
            kind => {
                if kind == "projector" || (kind == "spot" && light.contains_key("image")) {
                    light.entry("up").or_insert_with(|| numbers([0.0, 1.0, 0.0]));
                }
                self.vectors(light, &["position", "target"].into(), &["direction", "up"]);
            }
        }
    }

    /// The same for heights, which are looked up in object space.
    fn still(&self) -> Self {
        Self {
            file: self.file,
            map: DAffine3::IDENTITY,
            materials: BTreeMap::new(),
            textures: self.textures.clone(),
        }
    }

    /// Keys of a shape, but not its place.
    fn shape(&self, shape: &mut Table, prefix: &str) {
        for (key, value) in shape.iter_mut() {
            match (key.as_str(), value) {
                ("id" | "group", Value::String(id)) => *id = format!("{prefix}{id}"),
                ("material", value) => self.material_value(value),
                ("height", value) => self.still().texture_value(value),
                ("displacement", Value::Table(displacement)) => {
                    for key in ["height", "vector_map"] {
                        if let Some(texture) = displacement.get_mut(key) {
                            self.still().texture_value(texture);
                        }
                    }
                }
                _ => {}
            }
        }
        if table::kind(shape) == "mesh" {
            self.own_file(shape);
        }
    }

    /// Meshes and images without a file are those of the imported file.
    fn own_file(&self, table: &mut Table) {
        let own = || Value::String(self.file.to_owned());
        table.entry("file").or_insert_with(own);
    }

    fn material_value(&self, value: &mut Value) {
        match value {
            Value::String(id) => {
                if let Some(new) = self.materials.get(id) {
                    id.clone_from(new);
                }
            }
            Value::Table(material) => self.material(material),
            _ => {}
        }
    }

    fn material(&self, material: &mut Table) {
        let mix = table::kind(material) == "mix";
        for (key, value) in material.iter_mut() {
            match key.as_str() {
                "material" | "front" | "back" => self.material_value(value),
                "a" | "b" if mix => self.material_value(value),
                word if WORDS.contains(&word) => {}
                _ => self.texture_value(value),
            }
        }
    }

    fn texture_value(&self, value: &mut Value) {
        match value {
            Value::String(id) => {
                if let Some(new) = self.textures.get(id) {
                    id.clone_from(new);
                }
            }
            Value::Array(items) => items.iter_mut().for_each(|item| self.texture_value(item)),
            Value::Table(texture) if texture.contains_key("type") => self.texture(texture),
            _ => {}
        }
    }

    fn texture(&self, texture: &mut Table) {
        for (key, value) in texture.iter_mut() {
            if !WORDS.contains(&key.as_str()) {
                self.texture_value(value);
            }
        }
        if table::kind(texture) == "image" {
            self.own_file(texture);
        }
        let solid = SOLID.contains(&table::kind(texture));
        let mapping = table::table(texture, "mapping");
        let projection = mapping.and_then(|mapping| table::text(mapping, "projection"));
        if self.moves() && projection.map_or(solid, |projection| projection != "uv") {
            // The texture moves with the scene.
            let mut mapping = mapping.cloned().unwrap_or_default();
            let mut steps = vec![transform(&self.map.inverse())];
            match mapping.remove("transform") {
                None => {}
                Some(Value::Array(all)) => steps.extend(all),
                Some(step) => steps.push(step),
            }
            mapping.extend(keys([("transform", Value::Array(steps))]));
            texture.insert("mapping".to_owned(), Value::Table(mapping));
        }
    }
}
