//! From a flattened document to pbrt's directives.

mod material;
mod shape;
mod view;

use super::FEATURES;
use crate::files::save;
use crate::mitsuba::export::mesh_of;
use crate::table;
use crate::toml_scene::Copies;
use std::collections::{BTreeSet, HashMap};
use std::path::{Path, PathBuf};
use toml::{Table, Value};
use whitstone_core::{DAffine3, DVec3, ExportScene, FormatError, FormatErrors, Note, Notes};

/// Most materials or textures inside each other, by the model.
const MAX_NESTING: usize = 16;

/// Writes a scene, and its meshes and images next to it.
pub(super) fn export(scene: &ExportScene<'_>, path: &Path) -> Result<Vec<Note>, FormatErrors> {
    let stem = path.file_stem().unwrap_or_default();
    let mut exporter = Exporter {
        document: scene.document,
        base: scene.base,
        folder: path.parent().unwrap_or(Path::new("")).to_owned(),
        stem: stem.to_string_lossy().into_owned(),
        copies: Copies::new(scene.base, path),
        notes: Notes::default(),
        errors: Vec::new(),
        names: BTreeSet::new(),
        materials: HashMap::new(),
        textures: HashMap::new(),
        groups: BTreeSet::new(),
        meshes: HashMap::new(),
        depth: 0,
        out: String::new(),
    };
    exporter.view();
    exporter.out.push_str("\nWorldBegin\n\n");
    exporter.lights();
    exporter.shapes();
    if !exporter.errors.is_empty() {
        return Err(FormatErrors(exporter.errors));
    }
    save(path, exporter.out.as_bytes())?;
    Ok(exporter.notes.into_sorted())
}

/// The state of an export.
struct Exporter<'a> {
    document: &'a Table,
    /// The folder that the document's paths are relative to.
    base: &'a Path,
    /// The folder of the written file.
    folder: PathBuf,
    /// The name of the written file without its extension.
    stem: String,
    copies: Copies<'a>,
    notes: Notes,
    errors: Vec<FormatError>,
    /// Names of materials, textures and groups that were written.
    names: BTreeSet<String>,
    /// Names of written materials, by their value in the document.
    materials: HashMap<String, String>,
    /// Written textures, by their value in the document and whether they are of float.
    textures: HashMap<(String, bool), Pattern>,
    groups: BTreeSet<String>,
    /// Names of meshes that were written as PLY files, by their keys.
    meshes: HashMap<String, String>,
    /// Materials or textures inside each other.
    depth: usize,
    out: String,
}

/// A texture that was written, or a colour.
#[derive(Clone, Debug, PartialEq)]
enum Pattern {
    Color([f64; 3]),
    Named(String),
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
    fn note(&mut self, feature: &str, place: &str) {
        self.notes.add(FEATURES, feature, place);
    }

    fn line(&mut self, text: impl AsRef<str>) {
        self.out.push_str(text.as_ref());
        self.out.push('\n');
    }

    /// A name that is not used yet.
    fn unique(&mut self, wanted: &str) -> String {
        let mut name = wanted.to_owned();
        let mut number = 2;
        while !self.names.insert(name.clone()) {
            name = format!("{wanted}-{number}");
            number += 1;
        }
        name
    }

    /// The table of a material or texture that is a name or a table.
    fn plugin(&self, family: &str, value: &'a Value) -> Option<&'a Table> {
        match value {
            Value::String(id) => table::table(table::table(self.document, family)?, id),
            Value::Table(table) => Some(table),
            _ => None,
        }
    }

    /// The name of a copied file in the written scene.
    fn copied(&mut self, file: &str) -> String {
        match self.copies.copy(file) {
            Ok(name) => name,
            Err(error) => {
                if !self.errors.contains(&error) {
                    self.errors.push(error);
                }
                String::new()
            }
        }
    }

    /// All area lights but those without falloff, which [`Self::light`] notes.
    fn area_lights(&self) -> Vec<Area<'a>> {
        let lights = table::tables(self.document, "light").into_iter().enumerate();
        lights
            .filter(|(_, light)| table::kind(light) == "area")
            .filter(|(_, light)| table::text(light, "falloff") != Some("none"))
            .map(|(place, light)| Area {
                name: format!("light[{place}]"),
                table: light,
                kind: table::text(light, "shape").unwrap_or("rectangle"),
                used: false,
            })
            .collect()
    }

    fn shapes(&mut self) {
        let mut areas = self.area_lights();
        for (place, shape) in table::tables(self.document, "shape").into_iter().enumerate() {
            let name = table::text(shape, "id").map_or_else(|| format!("shape[{place}]"), str::to_owned);
            self.shape(shape, &name, Some(&mut areas));
        }
        // Lights without a visible surface are surfaces that alpha hides.
        for area in areas.iter().filter(|area| !area.used) {
            self.note("[[light]] area", &area.name);
            let radiance = table::color(area.table, "radiance", [1.0; 3]);
            let surface = match area.kind {
                "mesh" => self
                    .mesh_file(&mesh_of(area.table))
                    .map(|file| format!("\"plymesh\" {}", text("filename", &file))),
                "disk" | "sphere" => Some(format!("\"{}\"", area.kind)),
                _ => Some(shape::RECTANGLE.to_owned()),
            };
            let Some(surface) = surface else {
                continue;
            };
            self.line("AttributeBegin");
            self.place(&table::transform(area.table));
            self.line(format!("AreaLightSource \"diffuse\" {}", rgb("L", radiance)));
            self.line(format!("Shape {surface} \"float alpha\" [0]"));
            self.line("AttributeEnd\n");
        }
    }

    /// The transform of what follows, after the current one.
    fn place(&mut self, map: &DAffine3) {
        if *map != DAffine3::IDENTITY {
            self.line(format!("ConcatTransform {}", matrix(map)));
        }
    }

    fn lights(&mut self) {
        for (place, light) in table::tables(self.document, "light").into_iter().enumerate() {
            self.light(light, &format!("light[{place}]"));
        }
    }

    fn light(&mut self, light: &'a Table, name: &str) {
        let position = table::vector(light, "position").unwrap_or(DVec3::ZERO);
        let kind = table::kind(light);
        if table::text(light, "falloff") == Some("none") {
            return self.note("[[light]] falloff none", name);
        }
        let value = |key: &str| table::color(light, key, [1.0; 3]);
        let text = match kind {
            "point" => format!(
                "\"point\" {} {}",
                point("from", position),
                rgb("I", value("intensity"))
            ),
            "directional" => {
                let direction = table::vector(light, "direction").unwrap_or(DVec3::Z);
                format!(
                    "\"distant\" {} {} {}",
                    point("from", DVec3::ZERO),
                    point("to", direction),
                    rgb("L", value("irradiance"))
                )
            }
            "spot" => {
                self.note("[[light]] spot", name);
                if light.contains_key("image") {
                    self.note("[[light]] image of a spot", name);
                }
                let cutoff = table::number(light, "cutoff_angle").unwrap_or(20.0);
                let beam = table::number(light, "beam_width").unwrap_or(0.75 * cutoff);
                let target = table::vector(light, "target").unwrap_or(position + DVec3::Z);
                format!(
                    "\"spot\" {} {} {} {} {}",
                    point("from", position),
                    point("to", target),
                    rgb("I", value("intensity")),
                    floats("coneangle", &[cutoff]),
                    floats("conedeltaangle", &[cutoff - beam])
                )
            }
            "background" | "environment" => {
                let constant = light.get("radiance").and_then(table::as_color);
                let Some(radiance) = constant else {
                    return self.note("[[light]] environment with an image", name);
                };
                if radiance == [0.0; 3] {
                    return;
                }
                self.note("[[light]] background, environment", name);
                format!("\"infinite\" {}", rgb("L", radiance))
            }
            // They are written with the shapes.
            "area" => return,
            "ambient" => return self.note("[[light]] ambient", name),
            "projector" => return self.note("[[light]] projector", name),
            _ => return self.note("[*] plugins of third parties", name),
        };
        self.line(format!("LightSource {text}\n"));
    }
}

// Parameters. Numbers have as many digits as needed to read the same number again.

fn list(values: &[f64]) -> String {
    let values: Vec<String> = values.iter().map(|value| format!("{value:?}")).collect();
    format!("[{}]", values.join(" "))
}

fn floats(name: &str, values: &[f64]) -> String {
    format!("\"float {name}\" {}", list(values))
}

fn integers(name: &str, values: &[i64]) -> String {
    let values: Vec<String> = values.iter().map(i64::to_string).collect();
    format!("\"integer {name}\" [{}]", values.join(" "))
}

fn rgb(name: &str, value: [f64; 3]) -> String {
    format!("\"rgb {name}\" {}", list(&value))
}

fn point(name: &str, value: DVec3) -> String {
    format!("\"point3 {name}\" {}", list(&value.to_array()))
}

fn text(name: &str, value: &str) -> String {
    format!("\"string {name}\" {}", quoted(value))
}

/// A string in quotes.
fn quoted(text: &str) -> String {
    let mut quoted = String::from("\"");
    for c in text.chars() {
        match c {
            '"' | '\\' => quoted.extend(['\\', c]),
            '\n' => quoted.push_str("\\n"),
            '\r' => quoted.push_str("\\r"),
            '\t' => quoted.push_str("\\t"),
            c => quoted.push(c),
        }
    }
    quoted.push('"');
    quoted
}

/// Sixteen numbers, column by column.
fn matrix(map: &DAffine3) -> String {
    let mut numbers = Vec::new();
    for (column, last) in [
        (map.matrix3.x_axis, 0.0),
        (map.matrix3.y_axis, 0.0),
        (map.matrix3.z_axis, 0.0),
        (map.translation, 1.0),
    ] {
        numbers.extend(column.to_array());
        numbers.push(last);
    }
    list(&numbers)
}

/// A pattern as a parameter: a colour, or of float their mean.
fn parameter(name: &str, pattern: &Pattern, float: bool) -> String {
    match pattern {
        Pattern::Named(texture) => format!("\"texture {name}\" {}", quoted(texture)),
        Pattern::Color(value) if float => floats(name, &[mean(*value)]),
        Pattern::Color(value) => rgb(name, *value),
    }
}

fn mean(value: [f64; 3]) -> f64 {
    if value == [value[0]; 3] {
        value[0]
    } else {
        value.iter().sum::<f64>() / 3.0
    }
}

/// The key of a value in the tables of what was written.
fn key(value: &Value) -> String {
    value.to_string()
}
