//! PLY and STL files as scenes: one mesh with a default material.
//!
//! The positions are read here for the fitted camera, and the scan notes what the scene does not
//! show. The shape `mesh` reads the file itself and reports what is wrong with it, so a file that
//! cannot be understood has no bounds here.

use crate::document::{Document, Ids, typed};
use crate::files::{self, shorten};
use crate::part::{self, Part};
use std::path::Path;
use toml::Value;
use whitstone_core::{
    DVec3, Feature, FormatError, FormatErrors, ImportOptions, Imported, Notes, SceneFormat,
};

/// Largest file in bytes.
const MAX_BYTES: u64 = 4 << 30;
/// Albedo of the default material.
const REFLECTANCE: f64 = 0.8;

/// Stanford PLY.
pub struct Ply;

/// STL, binary or text.
pub struct Stl;

const PLY_FEATURES: &[Feature] = features! {
    Kept "element vertex, element face": "The shape mesh reads them from the file itself.";
    Approximated "red, green, blue": "The colours of vertices are the albedo, taken as linear; most programs write sRGB.";
    Approximated "concave faces": "Split into triangles from their first corner, which covers more than the face.";
    Dropped "alpha": "The default material is opaque.";
    Dropped "texcoord of face": "Only vertices have texture coordinates.";
    Dropped "comment TextureFile": "The default material has no texture.";
    Dropped "red, green, blue of face": "Only vertices have colours.";
    Dropped "other properties": "Only positions, normals, texture coordinates and colours of vertices are read.";
    Dropped "other elements": "Only vertices and faces are read.";
};

const STL_FEATURES: &[Feature] = features! {
    Kept "facets": "The shape mesh reads them from the file itself; normals follow from the winding.";
    Dropped "attributes of facets": "Some programs write colours there, each in its own way.";
};

/// Properties of vertices that the shape `mesh` reads.
const READ: [&str; 16] = [
    "x",
    "y",
    "z",
    "nx",
    "ny",
    "nz",
    "u",
    "v",
    "s",
    "t",
    "texture_u",
    "texture_v",
    "red",
    "green",
    "blue",
    "alpha",
];
/// Names of the list of a face's corners.
const CORNERS: [&str; 2] = ["vertex_indices", "vertex_index"];

impl SceneFormat for Ply {
    fn name(&self) -> &'static str {
        "ply"
    }

    fn extensions(&self) -> &'static [&'static str] {
        &["ply"]
    }

    fn features(&self) -> &'static [Feature] {
        PLY_FEATURES
    }

    fn import(&self, path: &Path, options: &ImportOptions) -> Option<Result<Imported, FormatErrors>> {
        Some(import(path, options, "a PLY file", PLY_FEATURES, scan_ply))
    }
}

impl SceneFormat for Stl {
    fn name(&self) -> &'static str {
        "stl"
    }

    fn extensions(&self) -> &'static [&'static str] {
        &["stl"]
    }

    fn features(&self) -> &'static [Feature] {
        STL_FEATURES
    }

    fn import(&self, path: &Path, options: &ImportOptions) -> Option<Result<Imported, FormatErrors>> {
        Some(import(path, options, "an STL file", STL_FEATURES, scan_stl))
    }
}

/// What other importers need to know of a mesh file.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct MeshInfo {
    /// Bounds of the vertices.
    pub(crate) part: Part,
    /// Whether the file has normals.
    pub(crate) normals: bool,
    /// Whether most faces lie on the other side than their normals: the sides of other programs are
    /// those of the normals, that of the shape `mesh` is that of the winding.
    pub(crate) turned: bool,
    /// Number of triangles; of a PLY file an upper bound, for faces of up to four corners.
    pub(crate) triangles: u64,
}

/// What other importers need to know of a PLY file.
pub(crate) fn inspect_ply(bytes: &[u8]) -> MeshInfo {
    let mut scan = Scan::EMPTY;
    let _ = ply(bytes, &mut scan, Faces::Sides);
    MeshInfo {
        part: scan.part,
        normals: scan.normals,
        turned: scan.sides.turned(),
        triangles: scan.faces.saturating_mul(2),
    }
}

/// Overlaps of less than this part of a face's area are due to the rounding of its corners.
const OVERLAP: f64 = 1e-4;

/// Whether triangles from the first corner of a face, as the shape `mesh` splits it, cover more
/// than the face: one of them has the opposite orientation.
pub(crate) fn fan_covers_more(corners: &[DVec3]) -> bool {
    let [first, others @ ..] = corners else {
        return false;
    };
    let normal_of = |side: &[DVec3]| (side[0] - *first).cross(side[1] - *first);
    // The normal of the face by Newell's method.
    let normal: DVec3 = others.windows(2).map(normal_of).sum();
    let least = -OVERLAP * normal.length_squared();
    others.windows(2).any(|side| normal_of(side).dot(normal) < least)
}

/// Compares the sides of faces with those of their normals.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Sides {
    seen: u32,
    turned: u32,
}

impl Sides {
    /// Faces that are compared; exporters turn all or none.
    const MOST: u32 = 1000;

    pub(crate) fn full(self) -> bool {
        self.seen >= Self::MOST
    }

    /// Adds a face, by its corners and their normals.
    pub(crate) fn add(&mut self, corners: &[DVec3], normals: &[DVec3]) {
        let [first, others @ ..] = corners else {
            return;
        };
        let across: DVec3 = others
            .windows(2)
            .map(|side| (side[0] - *first).cross(side[1] - *first))
            .sum();
        let cosine = across.dot(normals.iter().sum());
        if cosine != 0.0 && cosine.is_finite() {
            self.seen += 1;
            self.turned += u32::from(cosine < 0.0);
        }
    }

    pub(crate) fn turned(self) -> bool {
        2 * self.turned > self.seen
    }
}

/// Why the faces of a PLY file are read.
#[derive(Clone, Copy, PartialEq)]
enum Faces {
    /// To find concave ones.
    Concave,
    /// To compare their sides with their normals.
    Sides,
}

/// What a scan finds.
struct Scan {
    part: Part,
    /// Whether vertices have colours.
    colors: bool,
    /// Whether vertices have normals.
    normals: bool,
    sides: Sides,
    /// Number of faces of a PLY file.
    faces: u64,
    /// Features to report: the name and the place.
    noted: Vec<(&'static str, String)>,
}

impl Scan {
    const EMPTY: Self = Self {
        part: Part::EMPTY,
        colors: false,
        normals: false,
        sides: Sides { seen: 0, turned: 0 },
        faces: 0,
        noted: Vec::new(),
    };
}

fn import(
    path: &Path,
    options: &ImportOptions,
    what: &str,
    features: &'static [Feature],
    scan: fn(&[u8]) -> Scan,
) -> Result<Imported, FormatErrors> {
    part::no_selection(options, what)?;
    if let Some(name) = options.materials.keys().next() {
        return Err(part::unknown_material(name, &[]).into());
    }
    let bytes = files::read_main(path, MAX_BYTES)?;
    let scan = scan(&bytes);
    drop(bytes);
    let Some(file) = path.file_name().and_then(|name| name.to_str()) else {
        return Err(FormatError::anywhere("expected a file name in UTF-8").into());
    };
    let mut document = Document::default();
    let mut notes = Notes::default();
    for (feature, place) in scan.noted {
        notes.add(features, feature, place);
    }
    let mut shape = typed("mesh", [("file", Value::String(file.to_owned()))]);
    let reflectance = if scan.colors {
        notes.add(features, "red, green, blue", file);
        shape.insert("vertex_colors".to_owned(), Value::Boolean(true));
        Value::Table(typed("vertex_color", []))
    } else {
        Value::Float(REFLECTANCE)
    };
    let id = Ids::new(&options.prefix).unique("default");
    shape.insert("material".to_owned(), Value::String(id.clone()));
    part::place(&mut shape, options);
    document
        .materials
        .push((id, typed("matte", [("reflectance", reflectance)])));
    document.shapes.push(shape);
    scan.part.fit(&mut document, options);
    Ok(Imported {
        text: document.to_toml(),
        notes: notes.into_sorted(),
        files: Vec::new(),
    })
}

/// Bounds of the vertices of an STL file.
fn scan_stl(bytes: &[u8]) -> Scan {
    let mut part = Part::EMPTY;
    let mut noted = Vec::new();
    let count = bytes.get(80..84).and_then(|count| count.try_into().ok());
    let count = count.map(|count| u64::from(u32::from_le_bytes(count)));
    if count.is_some_and(|count| bytes.len() as u64 == 84 + 50 * count) {
        for (facet, number) in bytes[84..].chunks_exact(50).zip(0_u64..) {
            if noted.is_empty() && facet[48..] != [0, 0] {
                noted.push(("attributes of facets", format!("facet {number}")));
            }
            for vertex in facet[12..48].chunks_exact(12) {
                let [x, y, z] = [0, 4, 8].map(|at| {
                    f64::from(f32::from_le_bytes([
                        vertex[at],
                        vertex[at + 1],
                        vertex[at + 2],
                        vertex[at + 3],
                    ]))
                });
                part.add(DVec3::new(x, y, z));
            }
        }
    } else {
        let text = String::from_utf8_lossy(bytes);
        // Lines may end in any way.
        let mut words = text.split_ascii_whitespace();
        while let Some(word) = words.next() {
            if word.eq_ignore_ascii_case("vertex") {
                let mut number = || {
                    words
                        .next()
                        .and_then(|word| word.parse().ok())
                        .unwrap_or(f64::NAN)
                };
                part.add(DVec3::new(number(), number(), number()));
            }
        }
    }
    Scan {
        part,
        noted,
        ..Scan::EMPTY
    }
}

/// Bounds of the vertices of a PLY file, and the parts that the scene does not show.
fn scan_ply(bytes: &[u8]) -> Scan {
    let mut scan = Scan::EMPTY;
    // What is not understood ends the scan.
    let _ = ply(bytes, &mut scan, Faces::Concave);
    scan
}

/// A property of an element: type of the count of a list, type, and name.
struct Property<'a> {
    count: Option<Number>,
    number: Number,
    name: &'a str,
}

/// A kind of element.
struct Element<'a> {
    name: &'a str,
    count: u64,
    properties: Vec<Property<'a>>,
}

impl Element<'_> {
    /// Whether it has a number of this name.
    fn has(&self, name: &str) -> bool {
        let mut numbers = self.properties.iter().filter(|property| property.count.is_none());
        numbers.any(|property| property.name == name)
    }

    /// Reads the values of the next one, each with its property.
    fn read(&self, values: &mut Values<'_>, mut found: impl FnMut(&Property<'_>, f64)) -> Option<()> {
        for property in &self.properties {
            let length = match property.count {
                None => 1.0,
                Some(number) => values.next(number)?,
            };
            if !(0.0..=1e9).contains(&length) {
                return None;
            }
            for _ in 0..length as u64 {
                found(property, values.next(property.number)?);
            }
        }
        Some(())
    }

    /// The features of its properties that the scene does not show.
    fn unread(&self) -> Vec<(&'static str, String)> {
        let place = |name: &str| format!("{} {}", self.name, shorten(name));
        let feature = |property: &Property<'_>| match (self.name, property.name) {
            ("vertex", name) => (!READ.contains(&name)).then_some("other properties"),
            (_, name) if CORNERS.contains(&name) && property.count.is_some() => None,
            (_, "texcoord" | "texnumber") => Some("texcoord of face"),
            (_, "red" | "green" | "blue" | "alpha") => Some("red, green, blue of face"),
            _ => Some("other properties"),
        };
        match self.name {
            _ if self.count == 0 => Vec::new(),
            "vertex" | "face" => (self.properties.iter())
                .filter_map(|property| Some((feature(property)?, place(property.name))))
                .collect(),
            name => vec![("other elements", shorten(name))],
        }
    }
}

/// The header of a PLY file.
#[derive(Default)]
struct Header<'a> {
    format: &'a str,
    elements: Vec<Element<'a>>,
    /// Images that comments name.
    images: Vec<String>,
}

impl<'a> Header<'a> {
    fn of(text: &'a str) -> Option<Self> {
        let mut header = Self::default();
        let elements = &mut header.elements;
        for line in text.lines() {
            match line.split_ascii_whitespace().collect::<Vec<_>>()[..] {
                ["format", name, ..] => header.format = name,
                ["comment", word, ref name @ ..] if word.eq_ignore_ascii_case("TextureFile") => {
                    header.images.push(shorten(&name.join(" ")));
                }
                ["element", name, count] => elements.push(Element {
                    name,
                    count: count.parse().ok()?,
                    properties: Vec::new(),
                }),
                ["property", "list", count, number, name] => {
                    elements.last_mut()?.properties.push(Property {
                        count: Some(Number::of(count)?),
                        number: Number::of(number)?,
                        name,
                    });
                }
                ["property", number, name] => elements.last_mut()?.properties.push(Property {
                    count: None,
                    number: Number::of(number)?,
                    name,
                }),
                _ => {}
            }
        }
        Some(header)
    }

    fn describe(&self, scan: &mut Scan) {
        for element in &self.elements {
            match element.name {
                "vertex" => {
                    scan.colors = ["red", "green", "blue"].iter().any(|name| element.has(name));
                    scan.normals = ["nx", "ny", "nz"].iter().all(|name| element.has(name));
                }
                "face" => scan.faces = element.count,
                _ => {}
            }
            scan.noted.extend(element.unread());
        }
        let images = self.images.iter();
        scan.noted
            .extend(images.map(|name| ("comment TextureFile", name.clone())));
    }
}

/// Scans a file.
fn ply(bytes: &[u8], scan: &mut Scan, faces: Faces) -> Option<()> {
    let end = bytes
        .windows(10)
        .take(1 << 20)
        .position(|window| window == b"end_header")?;
    let body = end + bytes[end..].iter().position(|&byte| byte == b'\n')? + 1;
    // Comments may be in any encoding.
    let text = String::from_utf8_lossy(&bytes[..end]);
    let header = Header::of(&text)?;
    header.describe(scan);
    let mut values = match header.format {
        "ascii" => Values::Text(std::str::from_utf8(&bytes[body..]).ok()?.split_ascii_whitespace()),
        "binary_little_endian" | "binary_big_endian" => Values::Binary {
            rest: &bytes[body..],
            big: header.format == "binary_big_endian",
        },
        _ => return None,
    };
    let mut points = None;
    let has_faces = (header.elements.iter()).any(|element| element.name == "face" && element.count > 0);
    // Without properties an element has no values, however many of it there are.
    for element in header
        .elements
        .iter()
        .filter(|element| !element.properties.is_empty())
    {
        if element.name == "vertex" {
            // Positions take more memory than the file.
            let keep = (faces == Faces::Concave || scan.normals)
                && has_faces
                && ["x", "y", "z"].iter().all(|name| element.has(name));
            points = Some(vertices(
                element,
                &mut values,
                scan,
                [keep, faces == Faces::Sides],
            )?);
            if !keep {
                break;
            }
        } else if element.name == "face"
            && let Some((positions, normals)) = &points
        {
            if faces == Faces::Sides {
                return compare_sides(element, &mut values, positions, normals, &mut scan.sides);
            }
            let number = first_concave(element, &mut values, positions)?;
            scan.noted.push(("concave faces", format!("face {number}")));
            break;
        } else {
            for _ in 0..element.count {
                element.read(&mut values, |_, _| {})?;
            }
        }
    }
    Some(())
}

/// Adds the vertices to the bounds and, if `keep`, returns their positions, and their normals if
/// `with_normals`, too.
fn vertices(
    element: &Element<'_>,
    values: &mut Values<'_>,
    scan: &mut Scan,
    [keep, with_normals]: [bool; 2],
) -> Option<(Vec<DVec3>, Vec<DVec3>)> {
    let (mut positions, mut normals) = (Vec::new(), Vec::new());
    let mut opaque = true;
    for _ in 0..element.count {
        let (mut point, mut normal) = (DVec3::NAN, DVec3::ZERO);
        element.read(values, |property, value| match property.name {
            _ if property.count.is_some() => {}
            "nx" => normal.x = value,
            "ny" => normal.y = value,
            "nz" => normal.z = value,
            "x" => point.x = value,
            "y" => point.y = value,
            "z" => point.z = value,
            "alpha" => opaque &= value >= property.number.largest(),
            _ => {}
        })?;
        scan.part.add(point);
        if keep {
            positions.push(point);
            if with_normals {
                normals.push(normal);
            }
        }
    }
    if !opaque {
        scan.noted.push(("alpha", "vertex alpha".to_owned()));
    }
    Some((positions, normals))
}

/// Compares the sides of the first faces with those of the normals of their corners.
fn compare_sides(
    element: &Element<'_>,
    values: &mut Values<'_>,
    positions: &[DVec3],
    normals: &[DVec3],
    sides: &mut Sides,
) -> Option<()> {
    let (mut corners, mut of_corners) = (Vec::new(), Vec::new());
    for _ in 0..element.count {
        corners.clear();
        of_corners.clear();
        element.read(values, |property, value| {
            if CORNERS.contains(&property.name) && property.count.is_some() {
                let place = value as usize;
                corners.push(positions.get(place).copied().unwrap_or(DVec3::NAN));
                of_corners.push(normals.get(place).copied().unwrap_or(DVec3::NAN));
            }
        })?;
        sides.add(&corners, &of_corners);
        if sides.full() {
            break;
        }
    }
    Some(())
}

/// The number of the first face whose triangles cover more than the face.
fn first_concave(element: &Element<'_>, values: &mut Values<'_>, positions: &[DVec3]) -> Option<u64> {
    let mut corners = Vec::new();
    for number in 0..element.count {
        corners.clear();
        element.read(values, |property, value| {
            if CORNERS.contains(&property.name) && property.count.is_some() {
                // A wrong number is an error of the shape `mesh`.
                let position = positions.get(value as usize);
                corners.push(position.copied().unwrap_or(DVec3::NAN));
            }
        })?;
        if fan_covers_more(&corners) {
            return Some(number);
        }
    }
    None
}

/// Types of numbers in PLY files.
#[derive(Clone, Copy)]
enum Number {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    F32,
    F64,
}

impl Number {
    fn of(name: &str) -> Option<Self> {
        Some(match name {
            "char" | "int8" => Self::I8,
            "uchar" | "uint8" => Self::U8,
            "short" | "int16" => Self::I16,
            "ushort" | "uint16" => Self::U16,
            "int" | "int32" => Self::I32,
            "uint" | "uint32" => Self::U32,
            "float" | "float32" => Self::F32,
            "double" | "float64" => Self::F64,
            _ => return None,
        })
    }

    /// The largest integer of the type; 1 for other types.
    fn largest(self) -> f64 {
        match self {
            Self::I8 => i8::MAX.into(),
            Self::U8 => u8::MAX.into(),
            Self::I16 => i16::MAX.into(),
            Self::U16 => u16::MAX.into(),
            Self::I32 => i32::MAX.into(),
            Self::U32 => u32::MAX.into(),
            Self::F32 | Self::F64 => 1.0,
        }
    }

    fn bytes(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::F64 => 8,
        }
    }
}

/// The body of a PLY file.
enum Values<'a> {
    Text(std::str::SplitAsciiWhitespace<'a>),
    Binary { rest: &'a [u8], big: bool },
}

impl Values<'_> {
    fn next(&mut self, number: Number) -> Option<f64> {
        let (rest, big) = match self {
            Self::Text(words) => return words.next()?.parse().ok(),
            Self::Binary { rest, big } => (rest, *big),
        };
        let size = number.bytes();
        let (value, after) = rest.split_at_checked(size)?;
        *rest = after;
        let mut bytes = [0; 8];
        bytes[..size].copy_from_slice(value);
        if big {
            bytes[..size].reverse();
        }
        let bits = u64::from_le_bytes(bytes);
        Some(match number {
            Number::I8 => f64::from(bits as i8),
            Number::U8 => f64::from(bits as u8),
            Number::I16 => f64::from(bits as i16),
            Number::U16 => f64::from(bits as u16),
            Number::I32 => f64::from(bits as i32),
            Number::U32 => f64::from(bits as u32),
            Number::F32 => f64::from(f32::from_bits(bits as u32)),
            Number::F64 => f64::from_bits(bits),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;
    use whitstone_core::Treatment;

    const BOX: Part = Part {
        low: DVec3::new(-1.0, 0.0, 0.0),
        high: DVec3::new(1.0, 2.0, 3.0),
    };

    #[test]
    fn the_bounds_of_ply_files_are_found() {
        let list = "element face 1\nproperty list uchar int vertex_indices\n";
        let vertex =
            "element vertex 2\nproperty float x\nproperty short y\nproperty double z\nproperty uchar red\n";
        let text = format!("ply\nformat ascii 1.0\n{list}{vertex}end_header\n3 0 1 1\n-1 0 3 9\n1 2 0 9\n");
        let scan = scan_ply(text.as_bytes());
        assert_eq!((scan.part, scan.colors), (BOX, true));
        for big in [false, true] {
            let format = if big { "big" } else { "little" };
            let mut file =
                format!("ply\nformat binary_{format}_endian 1.0\n{list}{vertex}end_header\n").into_bytes();
            let mut put = |bytes: &[u8]| {
                let mut bytes = bytes.to_vec();
                if big {
                    bytes.reverse();
                }
                file.extend(bytes);
            };
            put(&[3]);
            for index in [0_i32, 1, 1] {
                put(&index.to_le_bytes());
            }
            for (x, y, z) in [(-1_f32, 0_i16, 3_f64), (1.0, 2, 0.0)] {
                put(&x.to_le_bytes());
                put(&y.to_le_bytes());
                put(&z.to_le_bytes());
                put(&[9]);
            }
            assert_eq!(scan_ply(&file).part, BOX, "{format}");
        }
    }

    #[test]
    fn the_bounds_of_stl_files_are_found() {
        let text =
            "solid\nfacet normal 0 0 1\nouter loop\nvertex -1 0 0\nVERTEX 1 2 3\nvertex 0 0 0\nendloop\n";
        assert_eq!(scan_stl(text.as_bytes()).part, BOX);
        assert_eq!(scan_stl(text.replace('\n', " ").as_bytes()).part, BOX);
        let mut binary = vec![b' '; 80];
        binary.extend(1_u32.to_le_bytes());
        for value in [9_f32, 9.0, 9.0, -1.0, 0.0, 0.0, 1.0, 2.0, 3.0, 0.0, 0.0, 0.0] {
            binary.extend(value.to_le_bytes());
        }
        binary.extend([0, 0]);
        assert_eq!(scan_stl(&binary).part, BOX);
    }

    #[test]
    fn files_whose_faces_oppose_their_normals_are_found() {
        let header = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\n\
                      property float z\nproperty float nx\nproperty float ny\nproperty float nz\n\
                      element face 1\nproperty list uchar int vertex_indices\nend_header\n";
        for (z, turned) in [(1, false), (-1, true)] {
            let vertices = format!("0 0 0 0 0 {z}\n1 0 0 0 0 {z}\n0 1 0 0 0 {z}\n");
            let info = inspect_ply(format!("{header}{vertices}3 0 1 2\n").as_bytes());
            assert_eq!((info.normals, info.turned), (true, turned));
            let obj = format!("v 0 0 0\nv 1 0 0\nv 0 1 0\nvn 0 0 {z}\nf 1//1 2//-1 3//1\n");
            let info = crate::obj::inspect(obj.as_bytes());
            assert_eq!((info.normals, info.turned), (true, turned));
        }
        let mixed = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvn 0 0 1\nf 1//1 2//1 3//1\nf 1//1 3//1 2//1\n";
        assert!(!crate::obj::inspect(mixed.as_bytes()).turned);
    }

    fn import_bytes(format: &dyn SceneFormat, bytes: &[u8]) -> Imported {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("mesh").with_extension(format.extensions()[0]);
        fs::write(&path, bytes).unwrap();
        format.import(&path, &ImportOptions::all()).unwrap().unwrap()
    }

    #[test]
    fn comments_of_ply_files_may_be_in_any_encoding() {
        let file = b"ply\nformat ascii 1.0\ncomment gr\xfcn\nelement vertex 2\nproperty float x\n\
                     property float y\nproperty float z\nproperty uchar red\nend_header\n-1 0 3 9\n1 2 0 9\n";
        let scan = scan_ply(file);
        assert_eq!((scan.part, scan.colors), (BOX, true));
        let imported = import_bytes(&Ply, file);
        let colors = imported.notes[0].feature;
        assert_eq!(
            (colors.name, colors.treatment),
            ("red, green, blue", Treatment::Approximated)
        );
    }

    #[test]
    fn concave_faces_of_ply_files_are_noted_where_their_triangles_cover_more() {
        let header = "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\n\
                      property float z\nelement face 2\nproperty list uchar int vertex_indices\nend_header\n\
                      0 0 0\n4 0 0\n1 1 0\n0 4 0\n";
        let noted = |faces: &str| scan_ply(format!("{header}{faces}").as_bytes()).noted;
        // The triangles of a concave face that meet at a suitable corner do not overlap.
        assert_eq!(noted("4 0 1 2 3\n4 3 2 1 9\n"), []);
        let expected = [("concave faces", "face 1".to_owned())];
        assert_eq!(noted("3 0 1 2\n4 1 2 3 0\n"), expected);
        assert_eq!(noted("4 1 2 3\n"), []);
    }

    #[test]
    fn parts_of_ply_files_that_the_scene_does_not_show_are_noted() {
        let text = "ply\nformat ascii 1.0\ncomment TextureFile my brick.png\nelement vertex 1\n\
                    property float x\nproperty float y\nproperty float z\nproperty float s\n\
                    property uchar alpha\nproperty float quality\nelement face 1\n\
                    property list uchar int vertex_indices\nproperty list uchar float texcoord\n\
                    property uchar red\nelement edge 1\nproperty int vertex1\nelement none 0\n\
                    property int a\nend_header\n0 0 0 0 254 1\n";
        let scan = scan_ply(text.as_bytes());
        let noted = scan.noted.iter();
        let noted = noted.map(|(feature, place)| (*feature, place.as_str()));
        let expected = [
            ("other properties", "vertex quality"),
            ("texcoord of face", "face texcoord"),
            ("red, green, blue of face", "face red"),
            ("other elements", "edge"),
            ("comment TextureFile", "my brick.png"),
            ("alpha", "vertex alpha"),
        ];
        assert_eq!(noted.collect::<Vec<_>>(), expected);
        assert_eq!(import_bytes(&Ply, text.as_bytes()).notes.len(), expected.len());
        let opaque = scan_ply(text.replace("254", "255").as_bytes());
        assert_eq!(opaque.noted.len(), expected.len() - 1);
    }

    #[test]
    fn attributes_of_stl_facets_are_noted() {
        let mut binary = vec![0_u8; 80];
        binary.extend(2_u32.to_le_bytes());
        binary.extend([0; 2 * 50]);
        assert_eq!(scan_stl(&binary).noted, []);
        binary[84 + 50 + 49] = 0x80;
        let imported = import_bytes(&Stl, &binary);
        assert_eq!(imported.notes[0].feature.treatment, Treatment::Dropped);
        assert_eq!(imported.notes[0].places, ["facet 1"]);
    }

    #[test]
    fn hostile_headers_end_in_bounded_time() {
        let headers = [
            "element a 99999999999999\nend_header\n",
            "element vertex 18446744073709551615\nend_header\n",
            "element a 1\nproperty list double char b\nend_header\n1e300 1\n",
            "element vertex 1000000000000\nproperty float x\nend_header\n1\n",
            "property float x\nend_header\n",
        ];
        for header in headers {
            scan_ply(format!("ply\nformat ascii 1.0\n{header}").as_bytes());
        }
        let garbage: Vec<u8> = (0..1_u32 << 20)
            .map(|i| (i.wrapping_mul(2_654_435_761) >> 23) as u8)
            .collect();
        scan_ply(&garbage);
        scan_stl(&garbage);
    }

    #[test]
    fn a_file_is_a_scene_of_one_mesh() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.stl");
        fs::write(&path, "solid\nvertex -1 0 0\nvertex 1 2 3\nvertex 0 0 0\n").unwrap();
        let imported = Stl.import(&path, &ImportOptions::all()).unwrap().unwrap();
        let scene: toml::Table = toml::from_str(&imported.text).unwrap();
        assert_eq!(scene["shape"][0]["file"].as_str(), Some("a.stl"));
        assert_eq!(scene["material"]["default"]["reflectance"].as_float(), Some(0.8));
        assert_eq!(
            scene["camera"]["look_at"]["target"].to_string(),
            "[0.0, 1.0, 1.5]"
        );
        let missing = Ply.import(Path::new("/nonexistent.ply"), &ImportOptions::all());
        assert!(missing.unwrap().is_err());
    }
}
