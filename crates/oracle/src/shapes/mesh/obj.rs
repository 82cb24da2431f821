//! OBJ files: only the lines that begin with `v`, `vn`, `vt` and `f`.

use super::{Corner, Mesh};

/// Parses a file. `None` if it is malformed.
pub(super) fn read(text: &str) -> Option<Mesh> {
    let (mut places, mut normals, mut uvs) = (Vec::new(), Vec::new(), Vec::new());
    let mut mesh = Mesh::default();
    // A trailing backslash continues the line.
    let text = text.replace("\\\r\n", " ").replace("\\\n", " ");
    for line in text.lines() {
        let mut words = line.split_whitespace();
        match words.next() {
            Some("v") => places.push(numbers::<3>(words)?),
            Some("vn") => normals.push(numbers::<3>(words)?),
            // The second coordinate is optional and defaults to 0.
            Some("vt") => uvs.push(numbers::<2>(words.chain(["0"]))?),
            Some("f") => {
                let corner = |word: &str| {
                    let mut parts = word.split('/');
                    Some(Corner {
                        place: element(&places, parts.next()?)?,
                        uv: parts.next().and_then(|part| element(&uvs, part)),
                        normal: parts.next().and_then(|part| element(&normals, part)),
                    })
                };
                mesh.add(&words.map(corner).collect::<Option<Vec<_>>>()?);
            }
            _ => {}
        }
    }
    Some(mesh)
}

fn numbers<'a, const N: usize>(words: impl Iterator<Item = &'a str>) -> Option<[f64; N]> {
    let found: Vec<f64> = words.take(N).filter_map(|word| word.parse().ok()).collect();
    found.try_into().ok()
}

/// Resolves an index: counted from 1, or from the end if it is negative.
fn element<T: Copy>(all: &[T], word: &str) -> Option<T> {
    let number: i64 = word.parse().ok()?;
    let place = if number < 0 {
        all.len() as i64 + number
    } else {
        number - 1
    };
    all.get(usize::try_from(place).ok()?).copied()
}
