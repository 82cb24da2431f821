//! PLY: the elements `vertex` and `face`; other elements and properties are skipped.
//!
//! A library reads the header and binary bodies; `text` reads text bodies.

mod text;

use super::{FileError, Triangles, fan, shorten};
use ply_rs_bw::parser::{ParseError, Parser, Reader};
use ply_rs_bw::ply::{
    ElementDef, Encoding, Header, Property, PropertyAccess, PropertyAccessResult, PropertyType,
};
use std::collections::HashSet;
use text::Lines;
use whitstone_core::{DVec2, DVec3};

/// Accepted names of each vertex number, in the order of [`Vertex::values`].
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

struct Vertex {
    values: [f64; 12],
}

struct Face {
    /// `None` if a vertex index is negative or not an integer.
    corners: Option<Vec<u32>>,
}

/// An element that is skipped.
struct Ignored;

/// Reads a file, with vertex colours if `colors`.
pub(super) fn parse(bytes: &[u8], colors: bool) -> Result<Triangles, FileError> {
    let header_lines = check_header_lines(bytes)?;
    let mut reader = Reader::new(bytes);
    let header = Parser::<Ignored>::new()
        .read_header(&mut reader)
        .map_err(|error| explain(&error, error.line()))?;
    check_header(&header)?;
    let mut body = match header.encoding {
        Encoding::Ascii => Body::Text(Lines::new(reader.into_inner(), header_lines)),
        _ => Body::Binary(reader),
    };
    let (mut vertices, mut faces) = (Vec::new(), Vec::new());
    for (name, element) in &header.elements {
        match name.as_str() {
            "vertex" => vertices = body.elements::<Vertex>(element, &header)?,
            "face" => faces = body.elements::<Face>(element, &header)?,
            _ => drop(body.elements::<Ignored>(element, &header)?),
        }
    }
    let has = |values: &[usize]| {
        let properties = &header.elements["vertex"].properties;
        values
            .iter()
            .all(|&value| NAMES[value].iter().any(|name| properties.contains_key(*name)))
    };
    if !has(&POSITION) {
        return Err(FileError::anywhere("expected vertex properties x, y and z"));
    }
    for (vertex, number) in vertices.iter().zip(0..) {
        if !vertex.values.iter().all(|value| value.is_finite()) {
            let message = format!("expected finite numbers, but those of vertex {number} are not");
            return Err(FileError::anywhere(message));
        }
    }
    let vector = |[x, y, z]: [usize; 3]| {
        vertices
            .iter()
            .map(move |v| DVec3::new(v.values[x], v.values[y], v.values[z]))
            .collect()
    };
    let mut object = Triangles {
        positions: vector(POSITION),
        ..Triangles::default()
    };
    if has(&NORMAL) {
        object.normals = vector(NORMAL);
    }
    if has(&UV) {
        let [u, v] = UV;
        object.uvs = vertices
            .iter()
            .map(|vertex| DVec2::new(vertex.values[u], vertex.values[v]))
            .collect();
    }
    if colors && (COLOR..NAMES.len()).any(|value| has(&[value])) {
        let color = |vertex: &Vertex| {
            let [.., r, g, b, a] = vertex.values;
            [r, g, b, a].map(|part| part.max(0.0))
        };
        object.attributes.colors = vertices.iter().map(color).collect();
    }
    let count = vertices.len();
    for (face, number) in faces.iter().zip(0..) {
        let corners = face
            .corners
            .as_deref()
            .filter(|corners| corners.len() >= 3 && corners.iter().all(|&corner| (corner as usize) < count));
        let corners = corners.ok_or_else(|| {
            FileError::anywhere(format!(
                "expected each face to name at least 3 of the {count} vertices by number, but face {number} \
                 does not"
            ))
        })?;
        object.triangles.extend(fan(corners));
    }
    Ok(object)
}

/// Finds errors that the parser would miss or report in the terms of its grammar; returns the
/// number of header lines.
fn check_header_lines(bytes: &[u8]) -> Result<usize, FileError> {
    let grammar = Parser::<Ignored>::new();
    let mut elements: HashSet<&str> = HashSet::new();
    let mut properties: HashSet<&str> = HashSet::new();
    let mut has_format = false;
    for (line, number) in bytes.split_inclusive(|&byte| byte == b'\n').zip(1..) {
        let line = std::str::from_utf8(line).ok();
        let words: Vec<&str> = line.unwrap_or_default().split_ascii_whitespace().collect();
        let is_good = line.is_some_and(|line| grammar.read_header_line(line).is_ok());
        if number == 1 && !(is_good && words == ["ply"]) {
            return Err(FileError::at(
                1,
                "expected a PLY file, which begins with a line \"ply\"",
            ));
        }
        let Some(line) = line else {
            return Err(FileError::at(number, "expected UTF-8 text"));
        };
        if !is_good {
            let message = format!(
                "expected a line of a PLY header (format, comment, obj_info, element, property or end_header), \
                 found \"{}\"",
                shorten(line.trim_ascii())
            );
            return Err(FileError::at(number, message));
        }
        match words[..] {
            ["end_header"] if !has_format => {
                return Err(FileError::at(number, "expected a line \"format\" in the header"));
            }
            ["end_header"] => return Ok(number),
            ["format", ..] if has_format => {
                return Err(FileError::at(
                    number,
                    "expected one line \"format\", found another",
                ));
            }
            ["format", ..] => has_format = true,
            ["element", name, ..] => {
                properties.clear();
                if !elements.insert(name) {
                    let message = format!("expected one element `{}`, found another", shorten(name));
                    return Err(FileError::at(number, message));
                }
            }
            ["property", ..] if elements.is_empty() => {
                return Err(FileError::at(number, "expected an element before its properties"));
            }
            ["property", .., name] if !properties.insert(name) => {
                let message = format!("expected one property `{}`, found another", shorten(name));
                return Err(FileError::at(number, message));
            }
            _ => {}
        }
    }
    Err(FileError::anywhere("expected a line \"end_header\", found none"))
}

/// Checks the parsed header for errors that are not visible in single lines.
fn check_header(header: &Header) -> Result<(), FileError> {
    let Some(vertex) = header.elements.get("vertex") else {
        return Err(FileError::anywhere("expected an element `vertex`"));
    };
    let Some(face) = header.elements.get("face") else {
        return Err(FileError::anywhere("expected an element `face`"));
    };
    let list = |name: &str| matches!(face.properties.get(name), Some(p) if is_list(&p.data_type));
    if !list("vertex_indices") && !list("vertex_index") {
        return Err(FileError::anywhere(
            "expected a list property `vertex_indices` of `face`",
        ));
    }
    for (value, names) in NAMES.iter().enumerate() {
        let listed = |name: &&str| {
            vertex
                .properties
                .get(*name)
                .is_some_and(|p| is_list(&p.data_type))
        };
        if names.iter().any(listed) {
            let message = format!(
                "expected a number for the vertex property `{}`, found a list",
                NAMES[value][0]
            );
            return Err(FileError::anywhere(message));
        }
    }
    // An element without properties takes no bytes, so any count of them would fit into any file.
    for (name, element) in &header.elements {
        if element.properties.is_empty() && element.count > 0 {
            return Err(FileError::anywhere(format!(
                "expected properties of the element `{name}`"
            )));
        }
    }
    Ok(())
}

fn is_list(data_type: &PropertyType) -> bool {
    matches!(data_type, PropertyType::List(..))
}

/// The data after the header. Memory use stays proportional to the file, whatever element count the
/// header states.
enum Body<'a> {
    Text(Lines<'a>),
    Binary(Reader<&'a [u8]>),
}

impl Body<'_> {
    /// Reads all elements of one kind.
    fn elements<E: PropertyAccess>(
        &mut self,
        element: &ElementDef,
        header: &Header,
    ) -> Result<Vec<E>, FileError> {
        match self {
            Self::Text(lines) => lines.elements(element),
            // The parser counts elements as lines.
            Self::Binary(reader) => Parser::new()
                .read_payload_for_element(reader, element, header)
                .map_err(|error| explain(&error, None)),
        }
    }
}

fn explain(error: &ParseError, line: Option<usize>) -> FileError {
    let text = error.to_string();
    // The text is "Line 7: message", then tabbed lines with the offending text, which may be very
    // long, and details.
    let without_line = text
        .split_once(": ")
        .filter(|(start, _)| start.starts_with("Line "));
    let text = without_line.map_or(text.as_str(), |(_, rest)| rest);
    let told: Vec<&str> = text
        .lines()
        .filter(|line| !line.trim_start().starts_with("String: "))
        .map(str::trim)
        .collect();
    let message: String = told.join(" ").chars().take(300).collect();
    FileError { line, message }
}

impl PropertyAccess for Vertex {
    fn new() -> Self {
        let mut values = [0.0; 12];
        values[COLOR..].fill(1.0);
        Self { values }
    }

    fn set_property(&mut self, name: &str, property: Property) -> PropertyAccessResult {
        let Some(value) = NAMES.iter().position(|names| names.contains(&name)) else {
            return PropertyAccessResult::Ignored;
        };
        let (number, largest): (f64, f64) = match property {
            Property::Char(x) => (x.into(), i8::MAX.into()),
            Property::UChar(x) => (x.into(), u8::MAX.into()),
            Property::Short(x) => (x.into(), i16::MAX.into()),
            Property::UShort(x) => (x.into(), u16::MAX.into()),
            Property::Int(x) => (x.into(), i32::MAX.into()),
            Property::UInt(x) => (x.into(), u32::MAX.into()),
            Property::Float(x) => (x.into(), 1.0),
            Property::Double(x) => (x, 1.0),
            _ => return PropertyAccessResult::UnsupportedType,
        };
        self.values[value] = if value < COLOR { number } else { number / largest };
        PropertyAccessResult::Set
    }
}

impl PropertyAccess for Face {
    fn new() -> Self {
        Self { corners: None }
    }

    fn set_property(&mut self, name: &str, property: Property) -> PropertyAccessResult {
        if !matches!(name, "vertex_indices" | "vertex_index") {
            return PropertyAccessResult::Ignored;
        }
        self.corners = property.to_u32_list();
        PropertyAccessResult::Set
    }
}

impl PropertyAccess for Ignored {
    fn new() -> Self {
        Self
    }
}

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
            ("property int z", "property list uchar int z", "found a list"),
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
