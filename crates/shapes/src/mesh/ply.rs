//! PLY: the elements `vertex` and `face`; other elements and properties are skipped.
//!
//! Greg Turk, *The PLY polygon file format*, 1994. Bodies are text, one element per line, or
//! binary; see `body`.

mod body;

use super::{FileError, Triangles, fan, shorten};
use body::{Binary, Body, ParallelText, Text};
use std::collections::HashSet;
use whitstone_core::{DVec2, DVec3};

/// Accepted names of each vertex number, in the order of the values of a vertex.
const NAMES: [&[&str]; 12] = [
    &["x"],
    &["y"],
    &["z"],
    &["nx"],
    &["ny"],
    &["nz"],
    &["u", "s", "texture_u"],
    &["v", "t", "texture_v"],
    &["red"],
    &["green"],
    &["blue"],
    &["alpha"],
];
const POSITION: [usize; 3] = [0, 1, 2];
const NORMAL: [usize; 3] = [3, 4, 5];
const UV: [usize; 2] = [6, 7];
/// The first of the colour channels. Integers are quotients of the largest number of their type.
const COLOR: usize = 8;

/// Accepted names of the list of a face's corners.
const CORNERS: [&str; 2] = ["vertex_indices", "vertex_index"];

/// A type of number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Scalar {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    F32,
    F64,
}

impl Scalar {
    fn named(name: &str) -> Option<Self> {
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

    /// Size in bytes.
    fn size(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::F64 => 8,
        }
    }

    fn is_real(self) -> bool {
        matches!(self, Self::F32 | Self::F64)
    }

    /// The largest number of an integer type; 1 for real ones.
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
}

/// A property: a number, or a list with the type of its length.
#[derive(Debug)]
struct Property {
    name: String,
    length: Option<Scalar>,
    scalar: Scalar,
}

/// A kind of element.
#[derive(Debug)]
struct Element {
    name: String,
    count: u64,
    properties: Vec<Property>,
}

impl Element {
    /// Size in bytes in a binary body; with lists, the smallest possible one.
    fn least_size(&self) -> usize {
        let size = |property: &Property| property.length.unwrap_or(property.scalar).size();
        self.properties.iter().map(size).sum()
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Format {
    Text,
    LittleEndian,
    BigEndian,
}

#[derive(Debug)]
struct Header {
    format: Format,
    elements: Vec<Element>,
    /// Number of lines.
    lines: usize,
    /// Length in bytes.
    length: usize,
}

/// Reads a file, with vertex colours if `colors`.
pub(super) fn parse(bytes: &[u8], colors: bool) -> Result<Triangles, FileError> {
    let header = Header::read(bytes)?;
    header.check()?;
    let body = &bytes[header.length..];
    match header.format {
        Format::Text => {
            let parallel = ParallelText::suits(body).then(|| ParallelText::new(body));
            match parallel.map(|body| read(&header, body, colors)) {
                Some(Ok(object)) => Ok(object),
                _ => read(&header, Text::new(body, header.lines), colors),
            }
        }
        Format::LittleEndian => read(&header, Binary::<false>::new(body), colors),
        Format::BigEndian => read(&header, Binary::<true>::new(body), colors),
    }
}

fn read(header: &Header, mut body: impl Body, colors: bool) -> Result<Triangles, FileError> {
    let mut object = Triangles::default();
    let vertices = header.element("vertex").map_or(0, |vertex| vertex.count);
    for element in &header.elements {
        // Memory stays proportional to the file, whatever count the header states.
        let most = element.count.min(body.most(element)) as usize;
        match element.name.as_str() {
            "vertex" => read_vertices(element, &mut body, colors, most, &mut object)?,
            "face" => {
                object.triangles.reserve(most);
                read_faces(element, &mut body, vertices, &mut object)?;
            }
            _ => {
                for number in 0..element.count {
                    body.begin(element, number)?;
                    for property in &element.properties {
                        let length = match property.length {
                            Some(length) => body.length(length)?,
                            None => 1,
                        };
                        for _ in 0..length {
                            body.number(property.scalar)?;
                        }
                    }
                    body.end(element)?;
                }
            }
        }
    }
    Ok(object)
}

fn read_vertices(
    element: &Element,
    body: &mut impl Body,
    colors: bool,
    most: usize,
    object: &mut Triangles,
) -> Result<(), FileError> {
    // The value that each property sets, and what it is divided by. Lists set none.
    let values = element.properties.iter().map(|property| {
        let value = NAMES.iter().position(|names| names.contains(&&*property.name));
        let value = value.filter(|_| property.length.is_none());
        let divisor = match value {
            Some(COLOR..) => property.scalar.largest(),
            _ => 1.0,
        };
        (property, value, divisor)
    });
    let values: Vec<(&Property, Option<usize>, f64)> = values.collect();
    let has = |wanted: usize| values.iter().any(|(_, value, _)| *value == Some(wanted));
    if !POSITION.into_iter().all(has) {
        return Err(FileError::anywhere("expected vertex properties x, y and z"));
    }
    let has_normal = NORMAL.into_iter().all(has);
    let has_uv = UV.into_iter().all(has);
    let has_color = colors && (COLOR..NAMES.len()).any(has);
    object.positions.reserve(most);
    object.normals.reserve(if has_normal { most } else { 0 });
    object.uvs.reserve(if has_uv { most } else { 0 });
    let mut vertex = [0.0; NAMES.len()];
    vertex[COLOR..].fill(1.0);
    for number in 0..element.count {
        body.begin(element, number)?;
        for (property, value, divisor) in &values {
            if let Some(length) = property.length {
                for _ in 0..body.length(length)? {
                    body.number(property.scalar)?;
                }
                continue;
            }
            let number = body.number(property.scalar)?;
            if let Some(value) = value {
                vertex[*value] = number / divisor;
            }
        }
        body.end(element)?;
        let [x, y, z, nx, ny, nz, u, v, r, g, b, a] = vertex;
        if !vertex.iter().all(|value| value.is_finite()) {
            let message = format!("expected finite numbers, but those of vertex {number} are not");
            return Err(FileError::anywhere(message));
        }
        object.positions.push(DVec3::new(x, y, z));
        if has_normal {
            object.normals.push(DVec3::new(nx, ny, nz));
        }
        if has_uv {
            object.uvs.push(DVec2::new(u, v));
        }
        if has_color {
            let color = [r, g, b, a].map(|part| part.max(0.0));
            object.attributes.colors.push(color);
        }
    }
    Ok(())
}

fn read_faces(
    element: &Element,
    body: &mut impl Body,
    vertices: u64,
    object: &mut Triangles,
) -> Result<(), FileError> {
    let mut corners: Vec<u32> = Vec::new();
    for number in 0..element.count {
        body.begin(element, number)?;
        let mut is_good = true;
        for property in &element.properties {
            let is_corners = CORNERS.contains(&&*property.name);
            let Some(length) = property.length else {
                body.number(property.scalar)?;
                continue;
            };
            if is_corners {
                corners.clear();
                is_good = !property.scalar.is_real();
            }
            // No preallocation: the file ends long before a wrong length is reached.
            for _ in 0..body.length(length)? {
                let corner = body.number(property.scalar)?;
                if is_corners {
                    is_good &= corner >= 0.0 && corner < vertices as f64;
                    corners.push(corner as u32);
                }
            }
        }
        body.end(element)?;
        if !is_good || corners.len() < 3 {
            return Err(FileError::anywhere(format!(
                "expected each face to name at least 3 of the {vertices} vertices by number, but face {number} \
                 does not"
            )));
        }
        object.triangles.extend(fan(&corners));
    }
    Ok(())
}

impl Header {
    fn read(bytes: &[u8]) -> Result<Self, FileError> {
        let mut header = Self {
            format: Format::Text,
            elements: Vec::new(),
            lines: 0,
            length: 0,
        };
        let mut properties: HashSet<String> = HashSet::new();
        let mut has_format = false;
        for (line, number) in bytes.split_inclusive(|&byte| byte == b'\n').zip(1..) {
            header.lines = number;
            header.length += line.len();
            // Comments may be in any encoding.
            let line = String::from_utf8_lossy(&line[..line.len().min(MAX_LINE)]);
            let words: Vec<&str> = line.split_ascii_whitespace().collect();
            if number == 1 && words != ["ply"] {
                let message = "expected a PLY file, which begins with a line \"ply\"";
                return Err(FileError::at(1, message));
            }
            let wrong = || {
                let message = format!(
                    "expected a line of a PLY header (format, comment, obj_info, element, property or end_header), \
                     found \"{}\"",
                    shorten(line.trim_ascii())
                );
                FileError::at(number, message)
            };
            match words[..] {
                ["ply"] if number == 1 => {}
                ["comment" | "obj_info", ..] => {}
                ["end_header"] if !has_format => {
                    return Err(FileError::at(number, "expected a line \"format\" in the header"));
                }
                ["end_header"] => return Ok(header),
                ["format", ..] if has_format => {
                    let message = "expected one line \"format\", found another";
                    return Err(FileError::at(number, message));
                }
                ["format", format, _] => {
                    has_format = true;
                    header.format = match format {
                        "ascii" => Format::Text,
                        "binary_little_endian" => Format::LittleEndian,
                        "binary_big_endian" => Format::BigEndian,
                        _ => return Err(wrong()),
                    };
                }
                ["element", name, count] => {
                    if header.element(name).is_some() {
                        let message = format!("expected one element `{}`, found another", shorten(name));
                        return Err(FileError::at(number, message));
                    }
                    properties.clear();
                    header.elements.push(Element {
                        name: name.to_owned(),
                        count: count.parse().map_err(|_| wrong())?,
                        properties: Vec::new(),
                    });
                }
                ["property", ref kind @ .., name] => {
                    let scalar = |name: &str| Scalar::named(name).ok_or_else(wrong);
                    let (length, scalar) = match kind {
                        [kind] => (None, scalar(kind)?),
                        ["list", length, kind] => (Some(scalar(length)?), scalar(kind)?),
                        _ => return Err(wrong()),
                    };
                    let Some(element) = header.elements.last_mut() else {
                        let message = "expected an element before its properties";
                        return Err(FileError::at(number, message));
                    };
                    if !properties.insert(name.to_owned()) {
                        let message = format!("expected one property `{}`, found another", shorten(name));
                        return Err(FileError::at(number, message));
                    }
                    element.properties.push(Property {
                        name: name.to_owned(),
                        length,
                        scalar,
                    });
                }
                _ => return Err(wrong()),
            }
        }
        Err(FileError::anywhere("expected a line \"end_header\", found none"))
    }

    fn element(&self, name: &str) -> Option<&Element> {
        self.elements.iter().find(|element| element.name == name)
    }

    /// Checks what is not visible in single lines.
    fn check(&self) -> Result<(), FileError> {
        let missing = |name: &str| FileError::anywhere(format!("expected an element `{name}`"));
        self.element("vertex").ok_or_else(|| missing("vertex"))?;
        let face = self.element("face").ok_or_else(|| missing("face"))?;
        let is_corners =
            |property: &Property| CORNERS.contains(&&*property.name) && property.length.is_some();
        if !face.properties.iter().any(is_corners) {
            let message = "expected a list property `vertex_indices` of `face`";
            return Err(FileError::anywhere(message));
        }
        // An element without properties takes no bytes, so any count of them would fit into any
        // file.
        for element in &self.elements {
            if element.properties.is_empty() && element.count > 0 {
                return Err(FileError::anywhere(format!(
                    "expected properties of the element `{}`",
                    shorten(&element.name)
                )));
            }
        }
        Ok(())
    }
}

/// Longest part of a header line that is read, in bytes.
const MAX_LINE: usize = 4096;

#[cfg(test)]
mod tests {
    use super::*;

    fn parse_all(bytes: &[u8]) -> Result<Triangles, FileError> {
        parse(bytes, true)
    }

    const HEADER: &str = "ply\nformat ascii 1.0\ncomment made by hand\nelement vertex 4\n\
        property float x\nproperty uchar red\nproperty double y\nproperty int z\n\
        property float s\nproperty float t\n\
        element face 2\nproperty uchar flags\nproperty list uchar int vertex_index\n\
        element edge 1\nproperty list uchar float weights\nend_header\n";
    const BODY: &str =
        "0 255 0 0 0 0\n1 255 0 0 1 0\n1 0 1 0 1 1\n0 0 1 0 0 1\n7 4 0 1 2 3\n7 3 0 2 3\n2 0.5 0.5\n";

    /// A binary file with positions (x, y, z as float) and triangles.
    fn binary(big: bool, vertices: u64, positions: &[f32], faces: u64, indices: &[u32]) -> Vec<u8> {
        let encoding = if big { "big" } else { "little" };
        let mut bytes = format!(
            "ply\nformat binary_{encoding}_endian 1.0\nelement vertex {vertices}\nproperty float x\n\
             property float y\nproperty float z\nelement face {faces}\n\
             property list uchar uint vertex_indices\nend_header\n"
        )
        .into_bytes();
        for x in positions {
            bytes.extend(if big { x.to_be_bytes() } else { x.to_le_bytes() });
        }
        for face in indices.chunks(3) {
            bytes.push(3);
            for i in face {
                bytes.extend(if big { i.to_be_bytes() } else { i.to_le_bytes() });
            }
        }
        bytes
    }

    fn fails(bytes: impl AsRef<[u8]>) -> FileError {
        parse_all(bytes.as_ref()).unwrap_err()
    }

    #[test]
    fn other_properties_are_read_over_and_polygons_become_fans() {
        let object = parse_all(format!("{HEADER}{BODY}").as_bytes()).unwrap();
        assert_eq!(object.triangles, [[0, 1, 2], [0, 2, 3], [0, 2, 3]]);
        assert_eq!(object.positions[2], DVec3::new(1.0, 1.0, 0.0));
        assert_eq!(object.uvs[3], DVec2::new(0.0, 1.0));
        assert!(object.normals.is_empty());
    }

    #[test]
    fn both_byte_orders_are_read() {
        let positions = [0.0, 0.0, 0.0, 1.5, 0.0, 0.0, 0.0, -2.0, 0.0];
        for big in [false, true] {
            let object = parse_all(&binary(big, 3, &positions, 1, &[0, 1, 2])).unwrap();
            assert_eq!(object.positions[2], DVec3::new(0.0, -2.0, 0.0));
            assert_eq!(object.triangles, [[0, 1, 2]]);
        }
    }

    #[test]
    fn numbers_are_read_as_exporters_write_them() {
        let body = "\n.5 255 -.5 1. +.25 0\r\n 1. 2.55e+2 1e-1 1 1 0\n\n1 0 1 0 1 1\n0 0 1 0 0 1\n\
                    7 4 0 1 2 3\n7 3 0 2 3\n2 .5 0.5";
        let object = parse_all(format!("{HEADER}{body}").as_bytes()).unwrap();
        assert_eq!(object.positions[0], DVec3::new(0.5, -0.5, 1.0));
        assert_eq!(object.uvs[0], DVec2::new(0.25, 0.0));
        // Not rounded to single precision, whatever type the header states.
        assert_eq!(object.positions[1].y, 0.1);
        assert_eq!(object.triangles.len(), 3);
    }

    /// Files that are read on several threads give the same as all others, errors included.
    #[test]
    fn long_text_is_read_as_short_text() {
        use std::fmt::Write;
        let count = 200_000;
        let mut text = format!(
            "ply\nformat ascii 1.0\nelement vertex {count}\nproperty float x\nproperty float y\n\
             property float z\nelement face {count}\nproperty list uchar int vertex_indices\nend_header\n"
        );
        let header = text.len();
        for number in 0..count {
            let _ = writeln!(text, "{}.5e-3 -{number} .{number}", number % 97);
        }
        for number in 0..count - 1 {
            let blank = if number % 1000 == 0 { "\r\n \n" } else { "" };
            let _ = writeln!(text, "{blank}3 {number} {} 0", number + 1);
        }
        text += "3 1 2 0";
        assert!(ParallelText::suits(text.as_bytes()) || rayon::current_num_threads() == 1);
        let sequential = |text: &str| {
            let head = Header::read(text.as_bytes()).unwrap();
            read(
                &head,
                Text::new(&text.as_bytes()[head.length..], head.lines),
                true,
            )
        };
        let (found, expected) = (parse_all(text.as_bytes()).unwrap(), sequential(&text).unwrap());
        assert_eq!(found.positions, expected.positions);
        assert_eq!(found.triangles, expected.triangles);
        let head = Header::read(text.as_bytes()).unwrap();
        let object = read(&head, ParallelText::new(&text.as_bytes()[header..]), true).unwrap();
        assert_eq!(object.positions, expected.positions);
        // A line that is too long for a block.
        let long = format!("{}{}", &text[..text.len() - 1], "0".repeat(200_000));
        assert!(read(&head, ParallelText::new(&long.as_bytes()[header..]), true).is_err());
        assert_eq!(parse_all(long.as_bytes()).unwrap().triangles, expected.triangles);
        for (from, to) in [
            ("3 150000 150001 0\n", "3 150000 150001\n"),
            ("3 150000 150001 0\n", "3 150000 150001 0 0\n"),
            ("3 150000 150001 0\n", "3 150000 150001 999999\n"),
            ("3 150000 150001 0\n", "3 150000 15x 0\n"),
            ("3 1 2 0", ""),
        ] {
            let wrong = text.replacen(from, to, 1);
            let (found, expected) = (fails(&wrong), sequential(&wrong).unwrap_err());
            assert_eq!((found.line, &found.message), (expected.line, &expected.message));
            assert!(read(&head, ParallelText::new(&wrong.as_bytes()[header..]), true).is_err());
        }
    }

    #[test]
    fn text_that_is_wrong_is_told_with_its_line() {
        let whole = format!("{HEADER}{BODY}");
        let told = |from: &str, to: &str| {
            assert!(whole.contains(from), "{from}");
            let error = fails(whole.replacen(from, to, 1));
            (error.line, error.message)
        };
        // The header has 16 lines.
        for (from, to, line, message) in [
            ("ply\n", "plx\n", 1, "begins with a line \"ply\""),
            ("ply\n", "", 1, "begins with a line \"ply\""),
            (
                "format ascii 1.0\n",
                "format text 1.0\n",
                2,
                "found \"format text 1.0\"",
            ),
            (
                "comment made",
                "format ascii 1.0\ncomment made",
                3,
                "one line \"format\"",
            ),
            ("format ascii 1.0\n", "", 15, "a line \"format\""),
            (
                "comment made by hand\n",
                "property int w\n",
                3,
                "an element before",
            ),
            (
                "property int z",
                "property wide z",
                8,
                "found \"property wide z\"",
            ),
            ("property int z", "property int x", 8, "one property `x`"),
            ("element edge 1", "element vertex 1", 14, "one element `vertex`"),
            ("element face 2", "element vertex 4", 11, "one element `vertex`"),
            (
                "element vertex 4",
                "element vertex -4",
                4,
                "found \"element vertex -4\"",
            ),
            (
                "1 255 0 0 1 0\n",
                "1 255 x 0 1 0\n",
                18,
                "a finite number, found \"x\"",
            ),
            (
                "1 255 0 0 1 0\n",
                "1 255 0 0 nan 0\n",
                18,
                "a finite number, found \"nan\"",
            ),
            (
                "1 255 0 0 1 0\n",
                "1 255 -1e999 0 1 0\n",
                18,
                "a finite number, found \"-1e999\"",
            ),
            (
                "1 255 0 0 1 0\n",
                "1 256 0 0 1 0\n",
                18,
                "from 0 to 255, found \"256\"",
            ),
            (
                "1 255 0 0 1 0\n",
                "1 255 0 0.5 1 0\n",
                18,
                "a whole number of 32 bits, found \"0.5\"",
            ),
            (
                "1 255 0 0 1 0\n",
                "1 255 0 0 1\n",
                18,
                "found the end of the line",
            ),
            (
                "1 255 0 0 1 0\n",
                "1 255 0 0 1 0 9\n",
                18,
                "expected nothing behind",
            ),
            ("7 3 0 2 3\n", "7 3 0 2\n", 22, "found the end of the line"),
            ("7 3 0 2 3\n", "7 -3 0 2 3\n", 22, "from 0 to 255, found \"-3\""),
        ] {
            let (found, told) = told(from, to);
            assert!(found == Some(line) && told.contains(message), "{found:?}: {told}");
        }
        for (from, to, message) in [
            ("7 3 0 2 3\n", "7 3 0 2 4\n", "face 1 does not"),
            ("7 3 0 2 3\n", "7 3 0 2 -1\n", "face 1 does not"),
            ("7 3 0 2 3\n", "7 2 0 2\n", "face 1 does not"),
            (
                "uchar int vertex_index",
                "uchar float vertex_index",
                "face 0 does not",
            ),
            (
                "2 0.5 0.5\n",
                "",
                "expected 1 of the element `edge`, one a line, found 0",
            ),
            ("property int z", "property int w", "x, y and z"),
            ("property int z", "property list uchar int z", "x, y and z"),
            ("vertex_index", "corners", "`vertex_indices`"),
            ("element face 2", "element side 2", "an element `face`"),
            (
                "end_header\n",
                "element nothing 9\nend_header\n",
                "properties of the element `nothing`",
            ),
            ("end_header\n", "", "found \"0 255 0 0 0 0\""),
        ] {
            let (_, told) = told(from, to);
            assert!(told.contains(message), "{from} -> {to}: {told}");
        }
        assert!(fails("ply\nformat ascii 1.0\n").message.contains("end_header"));
    }

    #[test]
    fn counts_are_no_promises() {
        let whole = format!("{HEADER}{BODY}");
        for (from, to) in [
            ("element vertex 4", "element vertex 1152921504606846976"),
            ("element vertex 4", "element vertex 18446744073709551616"),
            ("element face 2", "element face 18446744073709551615"),
            ("element edge 1", "element edge 18446744073709551615"),
            (
                "end_header\n",
                "element nothing 1152921504606846976\nend_header\n",
            ),
        ] {
            assert!(!fails(whole.replace(from, to)).message.contains('\n'));
        }
        let long = whole.replace("list uchar int", "list uint int");
        assert_eq!(
            fails(long.replace("7 3 0 2 3\n", "7 4294967295 0 2 3\n")).line,
            Some(22)
        );
        assert_eq!(
            fails(long.replace("7 3 0 2 3\n", "7 1152921504606846976 0\n")).line,
            Some(22)
        );
        // A list that claims 2^32 - 1 corners but has three.
        let mut binary = binary(false, 0, &[], 1, &[]);
        let text = String::from_utf8(binary.clone()).unwrap();
        binary = text.replace("list uchar uint", "list uint uint").into_bytes();
        binary.extend([0xff; 16]);
        assert!(fails(binary).message.contains("face"));
    }

    #[test]
    fn bytes_that_are_wrong_are_told() {
        let good = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0];
        assert!(
            fails(binary(false, 1 << 60, &good, 1, &[0, 1, 2]))
                .message
                .contains("vertex")
        );
        assert!(
            fails(binary(false, 3, &good, 1 << 60, &[0, 1, 2]))
                .message
                .contains("face")
        );
        assert!(
            fails(binary(true, 3, &good, 1, &[0, 1, 3]))
                .message
                .contains("face 0")
        );
        let nan = [0.0, 0.0, f32::NAN, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0];
        assert!(
            fails(binary(false, 3, &nan, 1, &[0, 1, 2]))
                .message
                .contains("vertex 0")
        );
        assert!(fails([0xff, 0xfe, 0x00]).message.len() > 10);
        let whole = binary(false, 3, &good, 1, &[0, 1, 2]);
        for length in 0..whole.len() {
            assert!(parse_all(&whole[..length]).is_err(), "cut to {length} bytes");
        }
    }

    #[test]
    fn lists_of_vertices_are_skipped() {
        let head = |format: &str| {
            format!(
                "ply\nformat {format} 1.0\nelement vertex 3\nproperty float x\nproperty list uchar short red\n\
                 property float y\nproperty float z\nproperty list uchar float more\nelement face 1\n\
                 property list uchar int vertex_indices\nend_header\n"
            )
        };
        let text = head("ascii") + "0 0 0 0 1 9\n1 2 7 8 0 0 0\n0 1 7 1 0 2 8 9\n3 0 1 2\n";
        let mut binary = head("binary_little_endian").into_bytes();
        for (point, reds, more) in [
            ([0.0f32, 0.0, 0.0], &[][..], &[9.0f32][..]),
            ([1.0, 0.0, 0.0], &[7i16, 8][..], &[][..]),
            ([0.0, 1.0, 0.0], &[7][..], &[8.0, 9.0][..]),
        ] {
            binary.extend(point[0].to_le_bytes());
            binary.push(reds.len() as u8);
            binary.extend(reds.iter().flat_map(|red| red.to_le_bytes()));
            binary.extend(point[1..].iter().flat_map(|x| x.to_le_bytes()));
            binary.push(more.len() as u8);
            binary.extend(more.iter().flat_map(|x| x.to_le_bytes()));
        }
        binary.push(3);
        binary.extend([0i32, 1, 2].iter().flat_map(|x| x.to_le_bytes()));
        for bytes in [text.as_bytes(), &binary] {
            let object = parse_all(bytes).unwrap();
            assert_eq!(object.positions, [DVec3::ZERO, DVec3::X, DVec3::Y]);
            assert!(object.attributes.colors.is_empty());
        }
        assert!(parse_all(&binary[..binary.len() - 1]).is_err());
    }

    #[test]
    fn integer_colours_are_quotients_in_text_and_binary_bodies() {
        let head = |format: &str| {
            format!(
                "ply\nformat {format} 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n\
                 property uchar red\nproperty uchar green\nproperty ushort blue\nelement face 1\n\
                 property list uchar int vertex_indices\nend_header\n"
            )
        };
        let text = head("ascii") + "0 0 0 255 51 65535\n1 0 0 0 0 0\n0 1 0 0 255 13107\n3 0 1 2\n";
        let mut binary = head("binary_little_endian").into_bytes();
        for (point, [r, g], b) in [
            ([0.0f32, 0.0, 0.0], [255u8, 51], 65535u16),
            ([1.0, 0.0, 0.0], [0, 0], 0),
            ([0.0, 1.0, 0.0], [0, 255], 13107),
        ] {
            binary.extend(point.iter().flat_map(|x| x.to_le_bytes()));
            binary.extend([r, g]);
            binary.extend(b.to_le_bytes());
        }
        binary.push(3);
        binary.extend([0i32, 1, 2].iter().flat_map(|x| x.to_le_bytes()));
        for bytes in [text.as_bytes(), &binary] {
            let object = parse_all(bytes).unwrap();
            assert_eq!(object.attributes.colors[0], [1.0, 0.2, 1.0, 1.0]);
            assert_eq!(object.attributes.colors[2], [0.0, 1.0, 0.2, 1.0]);
        }
        assert!(
            parse(text.as_bytes(), false)
                .unwrap()
                .attributes
                .colors
                .is_empty()
        );
    }
}
