//! OBJ files: only the lines that begin with `v`, `vn`, `vt`, `f` and `usemtl`.

use super::{Corner, Mesh};
use std::collections::BTreeMap;

/// Parses a file, whose bytes are the characters of `text`. `None` if it is malformed. With a
/// `part`, only the faces of this material; with `colored`, the colours of vertices.
pub(super) fn read(text: &str, part: Option<&str>, colored: bool) -> Option<Mesh> {
    let (mut places, mut normals, mut uvs) = (Vec::new(), Vec::new(), Vec::new());
    let mut material = String::new();
    let mut vertices = BTreeMap::new();
    let mut mesh = Mesh::default();
    // A trailing backslash continues the line.
    let text = text.replace("\\\r\n", " ").replace("\\\n", " ");
    for line in text.lines() {
        let mut words = line.split_ascii_whitespace();
        match words.next() {
            Some("v") => {
                let words: Vec<&str> = words.collect();
                let color = match words.len() {
                    _ if !colored => None,
                    3 => None,
                    6 => {
                        let [r, g, b] = numbers::<3>(words[3..].iter().copied())?;
                        Some([r, g, b, 1.0])
                    }
                    // Four numbers are a point with a weight, or one with a red.
                    _ => return None,
                };
                places.push((numbers::<3>(words.into_iter())?, color));
            }
            Some("vn") => normals.push(numbers::<3>(words)?),
            // The second coordinate is optional and defaults to 0.
            Some("vt") => uvs.push(numbers::<2>(words.chain(["0"]))?),
            Some("usemtl") => {
                material = name(line.trim_ascii_start()["usemtl".len()..].trim_ascii());
            }
            Some("f") if part.is_some_and(|part| part != material) => {}
            Some("f") => {
                let mut corner = |word: &str| {
                    let mut parts = word.split('/');
                    let place = element(&places, parts.next()?)?;
                    let uv = parts.next().and_then(|part| element(&uvs, part));
                    let normal = parts.next().and_then(|part| element(&normals, part));
                    let number = vertices.len();
                    let key = [
                        Some(place.0),
                        uv.map(|(index, _)| index),
                        normal.map(|(index, _)| index),
                    ];
                    Some(Corner {
                        vertex: *vertices.entry(key).or_insert(number),
                        uv: uv.map(|(_, uv)| uv),
                        normal: normal.map(|(_, normal)| normal),
                        color: place.1.1,
                        ..Corner::at(place.1.0)
                    })
                };
                mesh.add(&words.map(&mut corner).collect::<Option<Vec<_>>>()?);
            }
            _ => {}
        }
    }
    (part.is_none() || !mesh.triangles.is_empty()).then_some(mesh)
}

/// A name: its bytes are UTF-8, else Latin-1, whose characters are the bytes.
fn name(text: &str) -> String {
    let bytes = text.chars().map(|byte| byte as u8).collect();
    String::from_utf8(bytes).unwrap_or_else(|_| text.to_owned())
}

fn numbers<'a, const N: usize>(words: impl Iterator<Item = &'a str>) -> Option<[f64; N]> {
    let found: Vec<f64> = words.take(N).filter_map(|word| word.parse().ok()).collect();
    found.try_into().ok()
}

/// Resolves an index: counted from 1, or from the end if it is negative. Returns it, counted from
/// 0, and the element.
fn element<T: Copy>(all: &[T], word: &str) -> Option<(usize, T)> {
    let number: i64 = word.parse().ok()?;
    let place = if number < 0 {
        all.len() as i64 + number
    } else {
        number - 1
    };
    let place = usize::try_from(place).ok()?;
    Some((place, *all.get(place)?))
}
