//! OBJ files: only the lines that begin with `v`, `vn`, `vt`, `f` and `usemtl`.

use super::{Corner, Mesh};
use std::collections::BTreeMap;

/// Parses a file, whose bytes are the characters of `text`. `None` if it is malformed. With a
/// `part`, only the faces of this material; with `colored`, the colours of vertices.
pub(super) fn read(text: &str, part: Option<&str>, colored: bool) -> Option<Mesh> {
    let mut lists = Lists::default();
    let mut faces = Vec::new();
    let mut material = String::new();
    // A byte order mark is no text.
    let text = text.strip_prefix("\u{ef}\u{bb}\u{bf}").unwrap_or(text);
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
                lists.places.push((numbers::<3>(words.into_iter())?, color));
            }
            Some("vn") => lists.normals.push(numbers::<3>(words)?),
            // The second coordinate is optional and defaults to 0.
            Some("vt") => lists.uvs.push(numbers::<2>(words.chain(["0"]))?),
            Some("usemtl") => {
                material = name(line.trim_ascii_start()["usemtl".len()..].trim_ascii());
            }
            Some("f") if part.is_some_and(|part| part != material) => {}
            Some("f") => faces.push(lists.face(words)?),
            _ => {}
        }
    }
    // Faces may come before their vertices.
    let mut vertices = BTreeMap::new();
    let mut mesh = Mesh::default();
    for face in &faces {
        mesh.add(&lists.corners(face, &mut vertices)?);
    }
    (part.is_none() || !mesh.triangles.is_empty()).then_some(mesh)
}

/// The places in the lists that a corner names: of `v`, `vt` and `vn`.
type Named = [Option<usize>; 3];

/// The lists of a file.
#[derive(Default)]
struct Lists {
    places: Vec<([f64; 3], Option<[f64; 4]>)>,
    uvs: Vec<[f64; 2]>,
    normals: Vec<[f64; 3]>,
}

impl Lists {
    /// What the corners of a face name.
    fn face<'a>(&self, words: impl Iterator<Item = &'a str>) -> Option<Vec<Named>> {
        let counts = [self.places.len(), self.uvs.len(), self.normals.len()];
        let corner = |word: &str| {
            let mut named = [None; 3];
            for (k, part) in word.split('/').enumerate() {
                if !part.is_empty() {
                    *named.get_mut(k)? = Some(place(part, counts[k])?);
                }
            }
            Some(named)
        };
        words.map(corner).collect()
    }

    /// The corners of a face, which has normals or texture coordinates only if all its corners do.
    fn corners(&self, face: &[Named], vertices: &mut BTreeMap<Named, usize>) -> Option<Vec<Corner>> {
        let all_name = |k: usize| face.iter().all(|named| named[k].is_some());
        let (has_uvs, has_normals) = (all_name(1), all_name(2));
        let corner = |named: &Named| {
            let (position, color) = *self.places.get(named[0]?)?;
            let uv = match named[1] {
                Some(at) => Some(*self.uvs.get(at)?),
                None => None,
            };
            let normal = match named[2] {
                Some(at) => Some(*self.normals.get(at)?),
                None => None,
            };
            let key = [
                named[0],
                named[1].filter(|_| has_uvs),
                named[2].filter(|_| has_normals),
            ];
            let number = vertices.len();
            Some(Corner {
                vertex: *vertices.entry(key).or_insert(number),
                uv: uv.filter(|_| has_uvs),
                normal: normal.filter(|_| has_normals),
                color,
                ..Corner::at(position)
            })
        };
        face.iter().map(corner).collect()
    }
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

/// Resolves an index: counted from 1, or if it is negative from the end of a list that has `count`
/// elements so far. Returns it counted from 0.
fn place(word: &str, count: usize) -> Option<usize> {
    let number: i64 = word.parse().ok()?;
    let place = if number < 0 {
        count as i64 + number
    } else {
        number - 1
    };
    usize::try_from(place).ok()
}
