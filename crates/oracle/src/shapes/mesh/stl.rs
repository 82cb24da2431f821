//! STL files, binary or text.

use super::{Corner, Mesh};

/// Parses a file. `None` if it is malformed.
pub(super) fn read(bytes: &[u8]) -> Option<Mesh> {
    let corners = match is_binary(bytes) {
        true => binary(bytes),
        false => text(std::str::from_utf8(bytes).ok()?)?,
    };
    let mut mesh = Mesh::default();
    for (number, facet) in corners.as_chunks::<3>().0.iter().enumerate() {
        let [a, b, c] = facet.map(Corner::at);
        let first = 3 * number;
        let corner = |corner: Corner, k| Corner {
            vertex: first + k,
            ..corner
        };
        mesh.add(&[corner(a, 0), corner(b, 1), corner(c, 2)]);
    }
    Some(mesh)
}

fn is_binary(bytes: &[u8]) -> bool {
    let count = bytes.get(80..84).and_then(|four| four.try_into().ok());
    count.is_some_and(|count| bytes.len() as u64 == 84 + 50 * u64::from(u32::from_le_bytes(count)))
}

fn binary(bytes: &[u8]) -> Vec<[f64; 3]> {
    let facets = bytes[84..].chunks_exact(50);
    facets
        .flat_map(|facet| facet[12..48].as_chunks::<12>().0)
        .map(|vertex| {
            let mut numbers = vertex.as_chunks::<4>().0.iter();
            [0; 3].map(|_| {
                numbers
                    .next()
                    .map_or(0.0, |four| f64::from(f32::from_le_bytes(*four)))
            })
        })
        .collect()
}

/// A text with lines that end in LF: in a file without LF, CR ends them, and in one of a single
/// line each keyword begins one.
fn lines(text: &str) -> String {
    let text = text.trim();
    if text.contains('\n') {
        return text.to_owned();
    }
    if text.contains('\r') {
        return text.replace('\r', "\n");
    }
    let keywords = ["facet", "outer", "vertex", "endloop", "endfacet", "endsolid"];
    let word = |word: &str| {
        let before = if keywords.contains(&&*word.to_lowercase()) {
            "\n"
        } else {
            " "
        };
        format!("{before}{word}")
    };
    text.split_whitespace().map(word).collect()
}

/// The vertices of a text file, three of each facet.
fn text(text: &str) -> Option<Vec<[f64; 3]>> {
    let mut vertices = Vec::new();
    for line in lines(text).lines() {
        let mut words = line.split_whitespace().map(str::to_lowercase);
        match words.next().as_deref() {
            Some("vertex") => {
                let numbers: Vec<f64> = words.map_while(|word| word.parse().ok()).collect();
                vertices.push(<[f64; 3]>::try_from(numbers).ok()?);
            }
            Some("endloop") if vertices.len() % 3 == 0 => {}
            None | Some("solid" | "endsolid" | "facet" | "outer" | "endfacet") => {}
            _ => return None,
        }
    }
    (!vertices.is_empty() && vertices.len() % 3 == 0).then_some(vertices)
}
