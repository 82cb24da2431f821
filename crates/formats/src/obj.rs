//! Wavefront OBJ with MTL materials, as a scene.
//!
//! The faces of each material become one shape `mesh`. MTL gives light intensities without units:
//! `Kd I` is a radiance. Here, a light with the irradiance `E` has the intensity `I = E/pi`, so
//! that `Kd` is the albedo.
//!
//! Source: the appendix of the Wavefront Advanced Visualizer manual (MTL 3.0, 1995).

mod mtl;
mod scan;

use crate::document::{Document, Ids, Shared, color, numbers, typed};
use crate::files::{self, Folder, folder_of, shorten};
use crate::mesh_file::MeshInfo;
use crate::part::{self, Part};
use mtl::{Map, Mtl};
use std::borrow::Cow;
use std::collections::HashMap;
use std::f64::consts::PI;
use std::path::Path;
use toml::{Table, Value};
use whitstone_core::{Feature, FormatError, FormatErrors, ImportOptions, Imported, Notes, SceneFormat};

/// Largest OBJ file in bytes.
const MAX_BYTES: u64 = 4 << 30;
/// Largest MTL file in bytes.
const MAX_MTL_BYTES: u64 = 64 << 20;

/// Wavefront OBJ.
pub struct Obj;

/// What happens to the statements of OBJ and MTL.
const FEATURES: &[Feature] = features! {
    Kept "v, vt, vn, f": "The shape mesh reads them from the file itself.";
    Approximated "v with a colour": "The colours of vertices multiply Kd, taken as linear; most programs write sRGB.";
    Approximated "concave faces": "Split into triangles from their first corner, which covers more than the face.";
    Kept "usemtl": "The faces of each material are one shape.";
    Kept "g, o": "Names of groups and objects have no effect on the image.";
    Kept "mtllib": "Its materials are translated.";
    Approximated "mtllib without a file": "Materials that are not found are matte, with reflectance 0.5.";
    Approximated "usemtl without a material": "A name that no MTL file defines is matte, with reflectance 0.5.";
    Kept "Kd": "The albedo: a radiance of Kd E/pi for the irradiance E.";
    Approximated "Kd above 1": "It is limited to 1 where there is no highlight.";
    Approximated "Ka": "Surfaces reflect ambient light by Kd: many programs write a Ka without meaning.";
    Kept "Ks, Ns": "The highlight of a blinn_phong with k_s = Ks/pi and the exponent Ns.";
    Approximated "Ns below 1": "The exponent is at least 1.";
    Approximated "Ke": "The surface is seen with this radiance, but lights no other surface.";
    Kept "Ni": "The index of refraction of a glass.";
    Approximated "Tf": "A glass is clear.";
    Kept "d, Tr": "A mask with the opacity d, or 1 - Tr; a glass ignores them.";
    Approximated "d, Tr above 1": "They are limited to 1.";
    Approximated "d -halo": "The opacity is the same from all directions.";
    Approximated "illum 0": "A constant colour is matte instead.";
    Kept "illum 1, 2": "matte or blinn_phong.";
    Approximated "illum 3, 8": "whitted with k_refl = Ks, whose highlight has Phong's form with the exponent Ns/4; matte where Ks is 0.";
    Approximated "illum 4, 6, 7, 9": "A dielectric with the index Ni, without Kd, Ks and Tf.";
    Approximated "illum 4, 6, 7, 9 with Ni 1": "As illum 2: such a glass would be invisible, and Maya writes this for opaque materials.";
    Approximated "illum 5": "As illum 3: the reflection does not follow Fresnel's formula.";
    Approximated "illum 10": "As illum 2: an invisible surface that catches shadows is visible.";
    Approximated "illum with another number": "As illum 2.";
    Kept "map_Kd, map_Ks, map_Ke": "Images that multiply the value of the statement.";
    Kept "map_d": "An opacity that multiplies that of d: without -imfchan the alpha channel of a PNG that has one, otherwise the green channel, which a grey image has too.";
    Approximated "map without a readable file": "The plain colour.";
    Dropped "map without a file name": "The statement has no effect.";
    Kept "norm": "normal_map with the tangents of the mesh; -bm is its strength.";
    Dropped "norm without texture coordinates": "There are no tangents without them.";
    Kept "-s, -o, -clamp, -imfchan": "scale, offset, wrap and channel of the image.";
    Approximated "-imfchan l, z": "The green channel for map_d, otherwise the colour.";
    Dropped "-bm of a colour": "Only a normal map and a bump map have a strength.";
    Approximated "bump": "bump: the height in metres is -bm times the image, since MTL has no unit for it.";
    Dropped "bump without texture coordinates": "There are no slopes without them.";
    Dropped "map_Ka": "Surfaces reflect ambient light by Kd.";
    Dropped "map_Ns": "An exponent is a number.";
    Dropped "map_Tr": "Programs disagree on its meaning; map_d is kept.";
    Dropped "disp": "A displacement by texture coordinates is not translated.";
    Dropped "decal": "There is no counterpart.";
    Dropped "refl": "Reflections are traced.";
    Dropped "sharpness": "It belongs to refl.";
    Dropped "map_aat": "The sampler of the scene smooths edges.";
    Dropped "spectral, xyz": "Only colours in RGB are read.";
    Dropped "Pr, Pm, Ps, Pc, Pcr, aniso, anisor": "The extension for physically based materials has no counterpart.";
    Dropped "-t": "Turbulence of a texture has no counterpart.";
    Dropped "-mm": "Base and gain of a texture are not translated.";
    Dropped "-boost": "Images are not sharpened.";
    Dropped "-texres": "Images have the resolution of their file.";
    Dropped "-blendu, -blendv": "Images are filtered in both directions.";
    Dropped "-cc": "Colours are not corrected.";
    Dropped "other options of a texture": "They are not known.";
    Dropped "s": "Without vn the surface is flat: smoothing groups give no normals.";
    Dropped "p, l": "Points and lines have no area.";
    Dropped "curv, surf": "Free-form curves and surfaces are not read.";
    Dropped "other statements": "They are not known.";
};

impl SceneFormat for Obj {
    fn name(&self) -> &'static str {
        "obj"
    }

    fn extensions(&self) -> &'static [&'static str] {
        &["obj"]
    }

    fn features(&self) -> &'static [Feature] {
        FEATURES
    }

    fn import(&self, path: &Path, options: &ImportOptions) -> Option<Result<Imported, FormatErrors>> {
        Some(import(path, options))
    }
}

fn import(path: &Path, options: &ImportOptions) -> Result<Imported, FormatErrors> {
    part::no_selection(options, "an OBJ file")?;
    let bytes = files::read_main(path, MAX_BYTES)?;
    let scan = scan::scan(&bytes);
    drop(bytes);
    let folder = Folder::of(path, options);
    let mut import = Import {
        notes: Notes::default(),
        errors: Vec::new(),
        folder,
        uvs: scan.uvs,
        colors: scan.colors,
        document: Document::default(),
        textures: Shared::new(&options.prefix),
    };
    let materials = import.libraries(&scan.libraries);
    let mut ids = Ids::new(&options.prefix);
    for (name, line) in &scan.noted {
        import.notes.add(FEATURES, name, format!("line {line}"));
    }
    let file = path
        .file_name()
        .unwrap_or_default()
        .to_string_lossy()
        .into_owned();
    // One material, or none, means all faces.
    let several = scan.parts.len() > 1;
    let parts = if scan.parts.is_empty() {
        vec![String::new()]
    } else {
        scan.parts.clone()
    };
    for name in &parts {
        let mut shape = typed("mesh", [("file", Value::String(file.clone()))]);
        let mut set = |key: &str, value: Value| shape.insert(key.to_owned(), value);
        if several {
            set("part", Value::String(name.clone()));
        }
        if scan.colors {
            set("vertex_colors", Value::Boolean(true));
        }
        let material = materials.get(name);
        if let Some(id) = options.materials.get(name) {
            set("material", Value::String(id.clone()));
        } else if let Some(material) = material {
            let translated = import.material(material);
            if translated.tangents {
                set("tangents", Value::Boolean(true));
            }
            let id = ids.unique(if name.is_empty() { "material" } else { name });
            set("material", Value::String(id.clone()));
            import.document.materials.push((id, translated.table));
        } else {
            if !name.is_empty() {
                import
                    .notes
                    .add(FEATURES, "usemtl without a material", name.clone());
            }
            if scan.colors {
                let matte = typed("matte", [("reflectance", Value::Table(vertex_color()))]);
                set("material", Value::Table(matte));
            }
        }
        part::place(&mut shape, options);
        import.document.shapes.push(shape);
    }
    for name in options.materials.keys().filter(|name| !parts.contains(name)) {
        import.errors.push(part::unknown_material(name, &parts));
    }
    if scan.colors {
        import.notes.add(FEATURES, "v with a colour", file);
    }
    if !import.errors.is_empty() {
        return Err(FormatErrors(import.errors));
    }
    let part = Part {
        low: scan.low,
        high: scan.high,
    };
    part.fit(&mut import.document, options);
    Ok(Imported {
        text: import.document.to_toml(),
        notes: import.notes.into_sorted(),
        files: Vec::new(),
    })
}

/// The state of an import.
struct Import {
    notes: Notes,
    errors: Vec<FormatError>,
    folder: Folder,
    /// Whether the file has texture coordinates.
    uvs: bool,
    /// Whether the file has vertex colours.
    colors: bool,
    document: Document,
    textures: Shared,
}

/// A material of an MTL file, with the folder that its images are relative to.
struct Material {
    mtl: Mtl,
    library: String,
}

/// A material as a table.
struct Translated {
    table: Table,
    /// Whether it needs the tangents of the mesh.
    tangents: bool,
}

impl Import {
    /// The materials of all libraries by their names; the first definition of a name counts.
    fn libraries(&mut self, statements: &[(usize, String)]) -> HashMap<String, Material> {
        let mut found = HashMap::new();
        for (line, text) in statements {
            let text = text.as_str();
            // A name may contain spaces, and a statement may name several files.
            let whole = self.folder.find("", text);
            let names: Vec<&str> = match &whole {
                Ok(named) if named.path.is_file() => vec![text],
                _ => text.split_ascii_whitespace().collect(),
            };
            for name in names {
                // The path of another machine: the library may have been copied next to the file.
                let copied = || {
                    let last = name.rsplit(['/', '\\']).next().unwrap_or_default();
                    let copied = self.folder.find("", last).ok();
                    copied.filter(|copied| is_absolute(name) && copied.path.is_file())
                };
                let named = match self.folder.find("", name) {
                    Ok(named) if named.path.exists() => named,
                    written => match copied().map_or(written, Ok) {
                        Ok(named) => named,
                        Err(message) => {
                            self.errors.push(FormatError::at(line.to_string(), message));
                            continue;
                        }
                    },
                };
                if !named.path.exists() {
                    self.notes.add(FEATURES, "mtllib without a file", shorten(name));
                    continue;
                }
                match files::read(&named.path, MAX_MTL_BYTES) {
                    Err(problem) => {
                        let message = format!("cannot read \"{}\": {problem}", shorten(name));
                        self.errors.push(FormatError::at(line.to_string(), message));
                    }
                    Ok(bytes) => {
                        let (materials, errors) = mtl::parse(&bytes);
                        let located =
                            |(line, message)| FormatError::at(format!("{}:{line}", named.relative), message);
                        self.errors.extend(errors.into_iter().map(located));
                        for mtl in materials {
                            let material = Material {
                                library: named.relative.clone(),
                                mtl,
                            };
                            found.entry(material.mtl.name.clone()).or_insert(material);
                        }
                    }
                }
            }
        }
        found
    }

    fn note(&mut self, feature: &str, material: &Mtl) {
        self.notes.add(FEATURES, feature, shorten(&material.name));
    }

    /// The material without the maps whose files cannot be read, which are noted.
    fn with_readable_maps(&mut self, material: &Material) -> Material {
        let library = &material.library;
        let mut mtl = material.mtl.clone();
        for place in mtl.maps_mut() {
            let Some(map) = place else { continue };
            if let Some(file) = self.image_file(library, &map.file) {
                map.file = file;
            } else {
                let line = format!("{library}:{}", map.line);
                self.notes.add(FEATURES, "map without a readable file", line);
                *place = None;
            }
        }
        Material {
            mtl,
            library: library.clone(),
        }
    }

    /// The file of a map, relative to that of the library; none if there is no image that can be
    /// read.
    fn image_file(&self, library: &str, written: &str) -> Option<String> {
        let inside = folder_of(library);
        let is_image = |name: &str| {
            let named = self.folder.find(inside, name);
            named.is_ok_and(|named| named.path.is_file() && files::is_image(&named.path))
        };
        if is_image(written) {
            return Some(written.to_owned());
        }
        // The path of another machine: its image may have been copied next to the library.
        let copied = written.rsplit(['/', '\\']).next().unwrap_or_default();
        if is_absolute(written) && is_image(copied) {
            return Some(copied.to_owned());
        }
        // A file outside of the folder is an error where the map is used.
        let is_refused = self.folder.find(inside, written).is_err();
        is_refused.then(|| written.to_owned())
    }

    fn material(&mut self, material: &Material) -> Translated {
        let material = &self.with_readable_maps(material);
        let mtl = &material.mtl;
        for feature in &mtl.noted {
            self.note(feature, mtl);
        }
        let diffuse = mtl
            .diffuse
            .unwrap_or(if mtl.diffuse_map.is_some() || self.colors {
                [1.0; 3]
            } else {
                [0.5; 3]
            });
        if mtl.ambient.is_some_and(|ambient| ambient != diffuse) {
            self.note("Ka", mtl);
        }
        let specular = mtl.specular.unwrap_or(if mtl.specular_map.is_some() {
            [1.0; 3]
        } else {
            [0.0; 3]
        });
        let illum = mtl.illum.unwrap_or(2);
        match illum {
            0 => self.note("illum 0", mtl),
            3 | 8 => self.note("illum 3, 8", mtl),
            4 | 6 | 7 | 9 if mtl.ior == Some(1.0) => self.note("illum 4, 6, 7, 9 with Ni 1", mtl),
            4 | 6 | 7 | 9 => self.note("illum 4, 6, 7, 9", mtl),
            5 => self.note("illum 5", mtl),
            10 => self.note("illum 10", mtl),
            1 | 2 => {}
            _ => self.note("illum with another number", mtl),
        }
        // Maya writes illum 4 with the index 1 for opaque materials.
        let glass = matches!(illum, 4 | 6 | 7 | 9) && mtl.ior != Some(1.0);
        let shiny = !matches!(illum, 0 | 1) && specular != [0.0; 3];
        let mut table = if glass {
            self.glass(mtl)
        } else if shiny {
            self.shiny(material, diffuse, specular, matches!(illum, 3 | 5 | 8))
        } else {
            if diffuse.iter().any(|value| *value > 1.0) {
                self.note("Kd above 1", mtl);
            }
            let reflectance = self.diffuse(material, diffuse.map(|value| value.min(1.0)));
            typed("matte", [("reflectance", reflectance)])
        };
        let mut tangents = false;
        if let Some(map) = &mtl.normal_map {
            if self.uvs {
                table = self.normal_map(material, map, table);
                tangents = true;
            } else {
                self.note("norm without texture coordinates", mtl);
            }
        }
        if let Some(map) = &mtl.bump_map {
            if self.uvs {
                self.note("bump", mtl);
                table = self.bump(material, map, table);
            } else {
                self.note("bump without texture coordinates", mtl);
            }
        }
        let emission = mtl.emission.unwrap_or(if mtl.emission_map.is_some() {
            [1.0; 3]
        } else {
            [0.0; 3]
        });
        if emission != [0.0; 3] {
            self.note("Ke", mtl);
            let map = mtl.emission_map.as_ref();
            let map = map.and_then(|map| self.image(material, map, None));
            let radiance = product(emission, map);
            table = typed(
                "emissive",
                [("radiance", radiance), ("material", Value::Table(table))],
            );
        }
        if !glass && (mtl.opacity.is_some_and(|opacity| opacity < 1.0) || mtl.opacity_map.is_some()) {
            let map = mtl.opacity_map.as_ref();
            let map =
                map.and_then(|map| self.image(material, map, Some(self.opacity_channel(material, map))));
            let opacity = product([mtl.opacity.unwrap_or(1.0); 3], map);
            table = typed("mask", [("material", Value::Table(table)), ("opacity", opacity)]);
        }
        Translated { table, tangents }
    }

    fn glass(&mut self, mtl: &Mtl) -> Table {
        if mtl.filter.is_some_and(|filter| filter != [1.0; 3]) {
            self.note("Tf", mtl);
        }
        // The index must be positive; programs write 0 for "none".
        let ior = mtl.ior.filter(|ior| *ior > 0.0).unwrap_or(1.5);
        typed("dielectric", [("interior_ior", Value::Float(ior))])
    }

    fn shiny(&mut self, material: &Material, diffuse: [f64; 3], specular: [f64; 3], reflects: bool) -> Table {
        let mtl = &material.mtl;
        let written = mtl.exponent.unwrap_or(32.0);
        if written < 1.0 {
            self.note("Ns below 1", mtl);
        }
        let exponent = written.max(1.0);
        let per_steradian = |values: [f64; 3]| values.map(|value| value / PI);
        let k_a = self.diffuse(material, diffuse);
        let k_d = self.diffuse(material, per_steradian(diffuse));
        let map = mtl.specular_map.as_ref();
        let map = map.and_then(|map| self.image(material, map, None));
        let mut table = typed(
            "blinn_phong",
            [
                ("k_d", k_d),
                ("k_s", product(per_steradian(specular), map.clone())),
                ("k_a", k_a),
                ("exponent", Value::Float(exponent)),
            ],
        );
        if reflects {
            table.insert("type".to_owned(), Value::String("whitted".into()));
            table.insert("exponent".to_owned(), Value::Float(exponent / 4.0));
            table.insert("k_refl".to_owned(), product(specular, map));
        }
        table
    }

    /// A multiple of the diffuse colour.
    fn diffuse(&mut self, material: &Material, factor: [f64; 3]) -> Value {
        let map = material.mtl.diffuse_map.as_ref();
        let map = map.and_then(|map| self.image(material, map, None));
        let colors = self.colors.then(|| Value::Table(vertex_color()));
        product(factor, map.into_iter().chain(colors))
    }

    fn normal_map(&mut self, material: &Material, map: &Map, inner: Table) -> Table {
        let strength = map.multiplier.unwrap_or(1.0);
        let data = Map {
            multiplier: None,
            ..map.clone()
        };
        let Some(image) = self.image(material, &data, Some(Channel::Linear)) else {
            return inner;
        };
        let mut table = typed(
            "normal_map",
            [
                ("map", image),
                ("tangent", Value::String("mesh".into())),
                ("material", Value::Table(inner)),
            ],
        );
        if strength != 1.0 {
            table.insert("strength".to_owned(), Value::Float(strength));
        }
        table
    }

    fn bump(&mut self, material: &Material, map: &Map, inner: Table) -> Table {
        let scale = map.multiplier.unwrap_or(1.0);
        let heights = Map {
            multiplier: None,
            ..map.clone()
        };
        let Some(height) = self.image(material, &heights, Some(Channel::Linear)) else {
            return inner;
        };
        typed(
            "bump",
            [
                ("height", height),
                ("scale", Value::Float(scale)),
                ("material", Value::Table(inner)),
            ],
        )
    }

    /// How an image is read as an opacity.
    fn opacity_channel(&self, material: &Material, map: &Map) -> Channel {
        let named = self.folder.find(folder_of(&material.library), &map.file);
        let has_alpha = named.ok().and_then(|named| files::png_has_alpha(&named.path));
        match (map.channel, has_alpha) {
            // Many programs name the image of the colour here and mean its alpha channel.
            (None, Some(true)) => Channel::Alpha,
            (Some('m'), Some(true) | None) => Channel::Alpha,
            _ => Channel::Green,
        }
    }

    /// The id of a shared texture; none if the file is refused, which is an error. `channel`: how
    /// data are read, none for colours.
    fn image(&mut self, material: &Material, map: &Map, channel: Option<Channel>) -> Option<Value> {
        let named = match self.folder.find(folder_of(&material.library), &map.file) {
            Ok(named) => named,
            Err(message) => {
                let place = format!("{}:{}", material.library, map.line);
                let error = FormatError::at(place, message);
                if !self.errors.contains(&error) {
                    self.errors.push(error);
                }
                return None;
            }
        };
        if map.multiplier.is_some_and(|multiplier| multiplier != 1.0) {
            self.note("-bm of a colour", &material.mtl);
        }
        let mut table = typed("image", [("file", Value::String(named.relative.clone()))]);
        let mut set = |key: &str, value: Value| table.insert(key.to_owned(), value);
        let written = match map.channel {
            Some('r') => Some("red"),
            Some('g') => Some("green"),
            Some('b') => Some("blue"),
            Some('m') => Some("alpha"),
            _ => None,
        };
        let name = match channel {
            Some(Channel::Alpha) => Some("alpha"),
            // An explicit colour channel, but not an alpha that the file lacks.
            Some(Channel::Green) => written.filter(|name| *name != "alpha").or(Some("green")),
            Some(Channel::Linear) | None => written,
        };
        if let Some(name) = name {
            set("channel", Value::String(name.into()));
        }
        if channel.is_some() && name != Some("alpha") {
            set("color_space", Value::String("linear".into()));
        }
        if map.clamp {
            set("wrap", Value::String("clamp".into()));
        }
        if let Some(scale) = map.scale {
            set("scale", numbers(scale));
        }
        if let Some(offset) = map.offset {
            set("offset", numbers(offset));
        }
        let stem = Path::new(&named.relative).file_stem().unwrap_or_default();
        let list = &mut self.document.textures;
        Some(Value::String(self.textures.id(
            list,
            &stem.to_string_lossy(),
            table,
        )))
    }
}

/// How an image that is no colour is read.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Channel {
    /// Its colour, as it is stored.
    Linear,
    Alpha,
    /// One number of its colour, as it is stored.
    Green,
}

/// Whether a path begins at a root: of Unix, of a drive or of a server.
fn is_absolute(path: &str) -> bool {
    let has_drive = matches!(path.as_bytes(), [letter, b':', ..] if letter.is_ascii_alphabetic());
    has_drive || path.starts_with(['/', '\\'])
}

/// Text in any encoding: UTF-8, else each byte is a character of Latin-1. So names that differ stay
/// different, and the shape `mesh` finds its part.
fn decoded(bytes: &[u8]) -> Cow<'_, str> {
    match std::str::from_utf8(bytes) {
        Ok(text) => Cow::Borrowed(text),
        Err(_) => bytes.iter().map(|&byte| char::from(byte)).collect(),
    }
}

fn vertex_color() -> Table {
    typed("vertex_color", [])
}

/// A colour times textures.
fn product(factor: [f64; 3], textures: impl IntoIterator<Item = Value>) -> Value {
    let mut factors: Vec<Value> = textures.into_iter().collect();
    if factors.is_empty() || factor == [0.0; 3] {
        return color(factor);
    }
    if factor != [1.0; 3] {
        factors.insert(0, color(factor));
    }
    match <[Value; 1]>::try_from(factors) {
        Ok([single]) => single,
        Err(factors) => Value::Table(typed("product", [("factors", Value::Array(factors))])),
    }
}

/// What other importers need to know of an OBJ file.
pub(crate) fn inspect(bytes: &[u8]) -> MeshInfo {
    let scan = scan::scan(bytes);
    MeshInfo {
        part: Part {
            low: scan.low,
            high: scan.high,
        },
        normals: scan.normals,
        turned: scan.sides.turned(),
        triangles: scan.triangles,
    }
}

/// An OBJ file with the faces of one material, as the key `part` selects them.
pub(crate) fn only_part(bytes: &[u8], part: &str) -> Vec<u8> {
    let mut kept = Vec::new();
    let mut here = part.is_empty();
    let mut continues = false;
    let mut keep = true;
    for line in bytes.split_inclusive(|byte| *byte == b'\n') {
        let trimmed = line.trim_ascii();
        if !continues {
            let keyword = trimmed.split(u8::is_ascii_whitespace).next().unwrap_or_default();
            if keyword == b"usemtl" {
                here = decoded(trimmed[keyword.len()..].trim_ascii()) == part;
            }
            keep = keyword != b"f" || here;
        }
        continues = trimmed.ends_with(b"\\");
        if keep {
            kept.extend_from_slice(line);
        }
    }
    kept
}

#[cfg(test)]
mod tests;
