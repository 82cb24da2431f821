//! PLY files: a header that lists elements and their properties, followed by their values in order,
//! as text or binary.

use super::{Corner, Mesh};

#[derive(Clone, Copy)]
enum Format {
    Text,
    Little,
    Big,
}

struct Property {
    name: String,
    kind: String,
    /// The type of the length, if the property is a list.
    length: Option<String>,
}

struct Element {
    name: String,
    count: usize,
    properties: Vec<Property>,
}

/// Parses a file. `None` if it is malformed.
pub(super) fn read(bytes: &[u8]) -> Option<Mesh> {
    let mut rest = bytes;
    let mut line = || {
        let end = rest.iter().position(|byte| *byte == b'\n')?;
        let text = std::str::from_utf8(&rest[..end]).ok()?.trim();
        rest = &rest[end + 1..];
        Some(text.to_owned())
    };
    let mut format = Format::Text;
    let mut elements: Vec<Element> = Vec::new();
    loop {
        let line = line()?;
        let words: Vec<&str> = line.split_whitespace().collect();
        match words[..] {
            ["format", "ascii", _] => format = Format::Text,
            ["format", "binary_little_endian", _] => format = Format::Little,
            ["format", "binary_big_endian", _] => format = Format::Big,
            ["element", name, count] => elements.push(Element {
                name: name.to_owned(),
                count: count.parse().ok()?,
                properties: Vec::new(),
            }),
            ["property", "list", length, kind, name] => elements.last_mut()?.properties.push(Property {
                name: name.to_owned(),
                kind: kind.to_owned(),
                length: Some(length.to_owned()),
            }),
            ["property", kind, name] => elements.last_mut()?.properties.push(Property {
                name: name.to_owned(),
                kind: kind.to_owned(),
                length: None,
            }),
            ["end_header"] => break,
            _ => {}
        }
    }
    let mut body = Body { rest, format };
    let mut corners = Vec::new();
    let mut mesh = Mesh::default();
    for element in &elements {
        for _ in 0..element.count {
            // The value of each property: one number or a list.
            let mut row: Vec<(&str, Vec<f64>)> = Vec::new();
            for property in &element.properties {
                let length = match &property.length {
                    Some(kind) => body.number(kind)? as usize,
                    None => 1,
                };
                let values: Option<Vec<f64>> = (0..length).map(|_| body.number(&property.kind)).collect();
                row.push((&property.name, values?));
            }
            let of = |name: &str| {
                let (_, values) = row.iter().find(|(found, _)| *found == name)?;
                Some(values)
            };
            let is_number = |found: &&Property| found.length.is_none();
            let number = |name: &str| {
                let mut numbers = element.properties.iter().filter(is_number);
                numbers.find(|found| found.name == name)?;
                of(name)?.first().copied()
            };
            match &*element.name {
                "vertex" => {
                    let uv = [["u", "v"], ["s", "t"], ["texture_u", "texture_v"]];
                    let channels = ["red", "green", "blue", "alpha"].map(|name| {
                        let property = element.properties.iter().find(|found| found.name == name);
                        number(name)
                            .zip(property)
                            .map_or(1.0, |(value, property)| value / most(&property.kind))
                    });
                    corners.push(Corner {
                        vertex: corners.len(),
                        color: Some(channels),
                        second: None,
                        place: [number("x")?, number("y")?, number("z")?],
                        normal: super::all([number("nx"), number("ny"), number("nz")]),
                        uv: uv.into_iter().find_map(|[u, v]| Some([number(u)?, number(v)?])),
                    });
                }
                "face" => {
                    let indices = of("vertex_indices").or_else(|| of("vertex_index"))?;
                    let face = indices.iter().map(|index| corners.get(*index as usize).copied());
                    mesh.add(&face.collect::<Option<Vec<_>>>()?);
                }
                _ => {}
            }
        }
    }
    Some(mesh)
}

/// The largest number of an integer type, which a colour is divided by; 1 for other types.
fn most(kind: &str) -> f64 {
    match kind {
        "char" | "int8" => f64::from(i8::MAX),
        "uchar" | "uint8" => f64::from(u8::MAX),
        "short" | "int16" => f64::from(i16::MAX),
        "ushort" | "uint16" => f64::from(u16::MAX),
        "int" | "int32" => f64::from(i32::MAX),
        "uint" | "uint32" => f64::from(u32::MAX),
        _ => 1.0,
    }
}

struct Body<'a> {
    rest: &'a [u8],
    format: Format,
}

impl Body<'_> {
    fn number(&mut self, kind: &str) -> Option<f64> {
        if let Format::Text = self.format {
            let space = |byte: &u8| byte.is_ascii_whitespace();
            let start = self.rest.iter().position(|byte| !space(byte))?;
            let word = &self.rest[start..];
            let end = word.iter().position(space).unwrap_or(word.len());
            self.rest = &word[end..];
            return std::str::from_utf8(&word[..end]).ok()?.parse().ok();
        }
        Some(match kind {
            "char" | "int8" => f64::from(i8::from_ne_bytes(self.take()?)),
            "uchar" | "uint8" => f64::from(u8::from_ne_bytes(self.take()?)),
            "short" | "int16" => f64::from(i16::from_ne_bytes(self.take()?)),
            "ushort" | "uint16" => f64::from(u16::from_ne_bytes(self.take()?)),
            "int" | "int32" => f64::from(i32::from_ne_bytes(self.take()?)),
            "uint" | "uint32" => f64::from(u32::from_ne_bytes(self.take()?)),
            "float" | "float32" => f64::from(f32::from_ne_bytes(self.take()?)),
            "double" | "float64" => f64::from_ne_bytes(self.take()?),
            _ => return None,
        })
    }

    /// The next bytes, in the byte order of this machine.
    fn take<const N: usize>(&mut self) -> Option<[u8; N]> {
        let (first, rest) = self.rest.split_at_checked(N)?;
        self.rest = rest;
        let mut bytes: [u8; N] = first.try_into().ok()?;
        if matches!(self.format, Format::Little) != cfg!(target_endian = "little") {
            bytes.reverse();
        }
        Some(bytes)
    }
}
