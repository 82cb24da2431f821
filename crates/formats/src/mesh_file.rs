//! PLY and STL files as scenes: one mesh with a default material.
//!
//! Only the positions are read here, for the fitted camera. The shape `mesh` reads the file itself
//! and reports what is wrong with it, so a file that cannot be understood has no bounds here.

use crate::document::{Document, Ids, typed};
use crate::files;
use crate::part::{self, Part};
use std::path::Path;
use toml::Value;
use whitstone_core::{
    DVec3, Feature, FormatError, FormatErrors, ImportOptions, Imported, Notes, SceneFormat, Treatment,
};

/// Largest file in bytes.
const MAX_BYTES: u64 = 4 << 30;
/// Albedo of the default material.
const REFLECTANCE: f64 = 0.8;

/// Stanford PLY.
pub struct Ply;

/// STL, binary or text.
pub struct Stl;

const PLY_FEATURES: &[Feature] = &[
    Feature {
        name: "element vertex, element face",
        treatment: Treatment::Kept,
        how: "The shape mesh reads them from the file itself.",
    },
    Feature {
        name: "red, green, blue",
        treatment: Treatment::Kept,
        how: "The colours of vertices are the albedo, as linear values.",
    },
];

const STL_FEATURES: &[Feature] = &[Feature {
    name: "facets",
    treatment: Treatment::Kept,
    how: "The shape mesh reads them from the file itself; normals follow from the winding.",
}];

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
        Some(import(path, options, "a PLY file", scan_ply))
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
        Some(import(path, options, "an STL file", scan_stl))
    }
}

/// What other importers need to know of a mesh file.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct MeshInfo {
    /// Bounds of the vertices.
    pub(crate) part: Part,
    /// Whether the file has normals.
    pub(crate) normals: bool,
    /// Number of triangles; of a PLY file an upper bound, for faces of up to four corners.
    pub(crate) triangles: u64,
}

/// What other importers need to know of a PLY file.
pub(crate) fn inspect_ply(bytes: &[u8]) -> MeshInfo {
    let scan = scan_ply(bytes);
    MeshInfo {
        part: scan.part,
        normals: scan.normals,
        triangles: scan.faces.saturating_mul(2),
    }
}

/// What a scan finds.
struct Scan {
    part: Part,
    /// Whether vertices have colours.
    colors: bool,
    /// Whether vertices have normals.
    normals: bool,
    /// Number of faces of a PLY file.
    faces: u64,
}

impl Scan {
    const EMPTY: Self = Self {
        part: Part::EMPTY,
        colors: false,
        normals: false,
        faces: 0,
    };
}

fn import(
    path: &Path,
    options: &ImportOptions,
    what: &str,
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
    let mut shape = typed("mesh", [("file", Value::String(file.to_owned()))]);
    let reflectance = if scan.colors {
        notes.add(PLY_FEATURES, "red, green, blue", file);
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
    let count = bytes.get(80..84).and_then(|count| count.try_into().ok());
    let count = count.map(|count| u64::from(u32::from_le_bytes(count)));
    if count.is_some_and(|count| bytes.len() as u64 == 84 + 50 * count) {
        for facet in bytes[84..].chunks_exact(50) {
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
        for line in text.lines() {
            let mut words = line.split_ascii_whitespace();
            if words
                .next()
                .is_some_and(|word| word.eq_ignore_ascii_case("vertex"))
            {
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
    Scan { part, ..Scan::EMPTY }
}

/// Bounds of the vertices of a PLY file.
fn scan_ply(bytes: &[u8]) -> Scan {
    let mut scan = Scan::EMPTY;
    // What is not understood ends the scan.
    let _ = ply(bytes, &mut scan);
    scan
}

/// A property of an element: type of the count of a list, type, and name.
struct Property<'a> {
    count: Option<Number>,
    number: Number,
    name: &'a str,
}

fn ply(bytes: &[u8], scan: &mut Scan) -> Option<()> {
    let end = bytes
        .windows(10)
        .take(1 << 20)
        .position(|window| window == b"end_header")?;
    let body = end + bytes[end..].iter().position(|&byte| byte == b'\n')? + 1;
    let header = std::str::from_utf8(&bytes[..end]).ok()?;
    let mut format = "";
    let mut elements: Vec<(&str, u64, Vec<Property<'_>>)> = Vec::new();
    for line in header.lines() {
        match line.split_ascii_whitespace().collect::<Vec<_>>()[..] {
            ["format", name, ..] => format = name,
            ["element", name, count] => elements.push((name, count.parse().ok()?, Vec::new())),
            ["property", "list", count, number, name] => elements.last_mut()?.2.push(Property {
                count: Some(Number::of(count)?),
                number: Number::of(number)?,
                name,
            }),
            ["property", number, name] => elements.last_mut()?.2.push(Property {
                count: None,
                number: Number::of(number)?,
                name,
            }),
            _ => {}
        }
    }
    for (name, count, properties) in &elements {
        let has = |name: &str| properties.iter().any(|property| property.name == name);
        match *name {
            "vertex" => {
                scan.colors = ["red", "green", "blue"].into_iter().any(has);
                scan.normals = ["nx", "ny", "nz"].into_iter().all(has);
            }
            "face" => scan.faces = *count,
            _ => {}
        }
    }
    let mut values = match format {
        "ascii" => Values::Text(std::str::from_utf8(&bytes[body..]).ok()?.split_ascii_whitespace()),
        "binary_little_endian" | "binary_big_endian" => Values::Binary {
            rest: &bytes[body..],
            big: format == "binary_big_endian",
        },
        _ => return None,
    };
    for (name, count, properties) in elements {
        let is_vertex = name == "vertex";
        if !is_vertex && properties.is_empty() {
            // It has no values, however many there are.
            continue;
        }
        for _ in 0..count {
            let mut point = DVec3::NAN;
            for property in &properties {
                let length = match property.count {
                    None => 1.0,
                    Some(number) => values.next(number)?,
                };
                if !(0.0..=1e9).contains(&length) {
                    return None;
                }
                for _ in 0..length as u64 {
                    let value = values.next(property.number)?;
                    match property.name {
                        "x" => point.x = value,
                        "y" => point.y = value,
                        "z" => point.z = value,
                        _ => {}
                    }
                }
            }
            if is_vertex {
                scan.part.add(point);
                if properties.is_empty() {
                    break;
                }
            }
        }
        if is_vertex {
            break;
        }
    }
    Some(())
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
        let mut binary = vec![b' '; 80];
        binary.extend(1_u32.to_le_bytes());
        for value in [9_f32, 9.0, 9.0, -1.0, 0.0, 0.0, 1.0, 2.0, 3.0, 0.0, 0.0, 0.0] {
            binary.extend(value.to_le_bytes());
        }
        binary.extend([0, 0]);
        assert_eq!(scan_stl(&binary).part, BOX);
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
