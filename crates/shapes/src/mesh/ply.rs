//! PLY: the elements `vertex` and `face`; other elements and properties are read over.

use super::{FileError, Triangles, fan};
use ply_rs_bw::parser::{ParseError, Parser, Reader};
use ply_rs_bw::ply::{
    ElementDef, Encoding, Header, Property, PropertyAccess, PropertyAccessResult, PropertyType,
};
use whitstone_core::{DVec2, DVec3};

/// Names of each number of a vertex, in the order of [`Vertex::values`].
const NAMES: [&[&str]; 8] = [
    &["x"],
    &["y"],
    &["z"],
    &["nx"],
    &["ny"],
    &["nz"],
    &["u", "s", "texture_u"],
    &["v", "t", "texture_v"],
];
const POSITION: [usize; 3] = [0, 1, 2];
const NORMAL: [usize; 3] = [3, 4, 5];
const UV: [usize; 2] = [6, 7];

struct Vertex {
    values: [f64; 8],
}

struct Face {
    /// `None` if a vertex number is negative or not a whole number.
    corners: Option<Vec<u32>>,
}

/// An element that is read over.
struct Ignored;

pub(super) fn parse(bytes: &[u8]) -> Result<Triangles, FileError> {
    let mut reader = Reader::new(bytes);
    let header = Parser::<Ignored>::new()
        .read_header(&mut reader)
        .map_err(|error| explain(&error, error.line()))?;
    check_header(&header)?;
    let (mut vertices, mut faces) = (Vec::new(), Vec::new());
    for (name, element) in &header.elements {
        match name.as_str() {
            "vertex" => vertices = payload::<Vertex>(&mut reader, element, &header)?,
            "face" => faces = payload::<Face>(&mut reader, element, &header)?,
            _ => drop(payload::<Ignored>(&mut reader, element, &header)?),
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

/// What the parser would not notice.
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
    // An element without properties takes no bytes: any number of them would fit into any file.
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

/// Reads all elements of a kind. The parser takes the number in the header for no promise, so memory stays
/// in proportion to the file.
fn payload<E: PropertyAccess>(
    reader: &mut Reader<&[u8]>,
    element: &ElementDef,
    header: &Header,
) -> Result<Vec<E>, FileError> {
    Parser::<E>::new()
        .read_payload_for_element(reader, element, header)
        .map_err(|error| {
            // In binary files the parser counts elements as lines.
            let line = error.line().filter(|_| header.encoding == Encoding::Ascii);
            explain(&error, line)
        })
}

fn explain(error: &ParseError, line: Option<usize>) -> FileError {
    let text = error.to_string();
    // "Line 7: what is wrong", then tabbed lines: the offending text, which may be very long, and details.
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
        Self { values: [0.0; 8] }
    }

    fn set_property(&mut self, name: &str, property: Property) -> PropertyAccessResult {
        let Some(value) = NAMES.iter().position(|names| names.contains(&name)) else {
            return PropertyAccessResult::Ignored;
        };
        self.values[value] = match property {
            Property::Char(x) => x.into(),
            Property::UChar(x) => x.into(),
            Property::Short(x) => x.into(),
            Property::UShort(x) => x.into(),
            Property::Int(x) => x.into(),
            Property::UInt(x) => x.into(),
            Property::Float(x) => x.into(),
            Property::Double(x) => x,
            _ => return PropertyAccessResult::UnsupportedType,
        };
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
        parse(bytes.as_ref()).unwrap_err()
    }

    #[test]
    fn other_properties_are_read_over_and_polygons_become_fans() {
        let object = parse(format!("{HEADER}{BODY}").as_bytes()).unwrap();
        assert_eq!(object.triangles, [[0, 1, 2], [0, 2, 3], [0, 2, 3]]);
        assert_eq!(object.positions[2], DVec3::new(1.0, 1.0, 0.0));
        assert_eq!(object.uvs[3], DVec2::new(0.0, 1.0));
        assert!(object.normals.is_empty());
    }

    #[test]
    fn both_byte_orders_are_read() {
        let positions = [0.0, 0.0, 0.0, 1.5, 0.0, 0.0, 0.0, -2.0, 0.0];
        for big in [false, true] {
            let object = parse(&binary(big, 3, &positions, 1, &[0, 1, 2])).unwrap();
            assert_eq!(object.positions[2], DVec3::new(0.0, -2.0, 0.0));
            assert_eq!(object.triangles, [[0, 1, 2]]);
        }
    }

    #[test]
    fn text_that_is_wrong_is_told_with_its_line() {
        let text = |from: &str, to: &str| format!("{HEADER}{BODY}").replace(from, to);
        // The header has 16 lines.
        assert_eq!(fails(text("1 255 0 0 1 0\n", "1 255 x 0 1 0\n")).line, Some(18));
        assert_eq!(fails(text("7 3 0 2 3\n", "7 3 0 2\n")).line, Some(22));
        assert_eq!(fails(text("7 3 0 2 3\n", "7 3 0 2 4\n")).line, None);
        assert_eq!(fails(text("property int z", "property wide z")).line, Some(8));
        assert_eq!(fails(text("ply\n", "plx\n")).line, Some(1));
        for (from, to) in [
            ("7 3 0 2 3\n", "7 3 0 2 -1\n"),
            ("7 3 0 2 3\n", "7 2 0 2\n"),
            ("7 3 0 2 3\n", "7 -3 0 2 3\n"),
            ("7 3 0 2 3\n", "7 1152921504606846976 0 2 3\n"),
            ("2 0.5 0.5\n", ""),
            ("property int z", "property int w"),
            ("property int z", "property list uchar int z"),
            ("uchar int vertex_index", "uchar float vertex_index"),
            ("vertex_index", "corners"),
            ("element face 2", "element side 2"),
            ("element vertex 4", "element vertex 1152921504606846976"),
            ("element vertex 4", "element vertex 18446744073709551616"),
            ("element vertex 4", "element vertex -4"),
            (
                "end_header\n",
                "element nothing 1152921504606846976\nend_header\n",
            ),
            ("made by hand\n", "made by hand"),
        ] {
            let error = fails(text(from, to));
            assert!(
                !error.message.is_empty() && !error.message.contains('\n'),
                "{from} -> {to}"
            );
        }
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
            assert!(parse(&whole[..length]).is_err(), "cut to {length} bytes");
        }
    }
}
