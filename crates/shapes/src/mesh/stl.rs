//! STL, binary or text: triangles without shared vertices.
//!
//! The normals of the file are ignored: they are those of the triangles, or wrong.

use super::{FileError, Triangles, shorten};
use whitstone_core::DVec3;

/// Bytes before the triangles of a binary file: a comment and their number.
const HEADER: usize = 84;
/// Bytes of a triangle in a binary file: a normal, three vertices and two unused bytes.
const TRIANGLE: usize = 50;

pub(super) fn parse(bytes: &[u8]) -> Result<Triangles, FileError> {
    let count = bytes.get(HEADER - 4..HEADER).map(|count| {
        let count = [count[0], count[1], count[2], count[3]];
        u32::from_le_bytes(count) as usize
    });
    let positions = match count {
        Some(count) if bytes.len() as u64 == HEADER as u64 + count as u64 * TRIANGLE as u64 => {
            binary(&bytes[HEADER..])?
        }
        _ => text(bytes)?,
    };
    let triangles = (0..positions.len() as u32 / 3).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]);
    Ok(Triangles {
        triangles: triangles.collect(),
        positions,
        ..Triangles::default()
    })
}

fn binary(body: &[u8]) -> Result<Vec<DVec3>, FileError> {
    let mut positions = Vec::with_capacity(body.len() / TRIANGLE * 3);
    for (triangle, number) in body.chunks_exact(TRIANGLE).zip(0..) {
        for vertex in triangle[12..48].chunks_exact(12) {
            let part =
                |k: usize| f32::from_le_bytes([vertex[k], vertex[k + 1], vertex[k + 2], vertex[k + 3]]);
            let position = DVec3::new(part(0).into(), part(4).into(), part(8).into());
            if !position.is_finite() {
                return Err(FileError::anywhere(format!(
                    "triangle {number} has a vertex that is not finite"
                )));
            }
            positions.push(position);
        }
    }
    Ok(positions)
}

fn text(bytes: &[u8]) -> Result<Vec<DVec3>, FileError> {
    let expected = "expected an STL file: text that begins with \"solid\", or binary data whose length fits its number of triangles";
    if !bytes.trim_ascii_start().starts_with(b"solid") {
        return Err(FileError::anywhere(expected));
    }
    let mut positions: Vec<DVec3> = Vec::new();
    for (line, number) in lines(bytes) {
        let mut words = line
            .split(u8::is_ascii_whitespace)
            .filter(|word| !word.is_empty());
        match words.next() {
            Some(b"vertex") => {
                let mut next = || -> Result<f64, FileError> {
                    let word = words.next().unwrap_or_default();
                    let word = std::str::from_utf8(word).unwrap_or("?");
                    word.parse().ok().filter(|x: &f64| x.is_finite()).ok_or_else(|| {
                        FileError::at(
                            number,
                            format!("expected a finite number, found \"{}\"", shorten(word)),
                        )
                    })
                };
                positions.push(DVec3::new(next()?, next()?, next()?));
            }
            Some(b"endloop") if !positions.len().is_multiple_of(3) => {
                return Err(FileError::at(number, "expected three vertices in a loop"));
            }
            Some(b"solid" | b"facet" | b"outer" | b"endloop" | b"endfacet" | b"endsolid") | None => {}
            Some(word) => {
                // A name may continue the first line only.
                let word = String::from_utf8_lossy(word);
                let message = format!("expected a line of an STL file, found \"{}\"", shorten(&word));
                return Err(FileError::at(number, message));
            }
        }
    }
    if positions.is_empty() {
        Err(FileError::anywhere("expected triangles, found none"))
    } else if positions.len().is_multiple_of(3) {
        Ok(positions)
    } else {
        Err(FileError::anywhere(
            "is cut: the last triangle has fewer than three vertices",
        ))
    }
}

/// The lines of a text, with their numbers. They end in LF, or in CR in a file without LF; in a
/// file of a single line each keyword begins one.
fn lines(bytes: &[u8]) -> Vec<(&[u8], usize)> {
    let bytes = bytes.trim_ascii();
    for end in [b'\n', b'\r'] {
        if bytes.contains(&end) {
            return bytes.split(|byte| *byte == end).zip(1..).collect();
        }
    }
    let mut found = Vec::new();
    let (mut rest, mut at) = (bytes, 0);
    while at < rest.len() {
        let length = rest[at..]
            .iter()
            .take_while(|byte| !byte.is_ascii_whitespace())
            .count();
        let keywords: [&[u8]; 6] = [
            b"facet",
            b"outer",
            b"vertex",
            b"endloop",
            b"endfacet",
            b"endsolid",
        ];
        if at > 0 && keywords.contains(&&rest[at..at + length]) {
            found.push((&rest[..at], 1));
            (rest, at) = (&rest[at..], 0);
        }
        at += length + 1;
    }
    found.push((rest, 1));
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    const TEXT: &str = "solid a b\n facet normal 0 0 1\n  outer loop\n   vertex 0 0 0\n   vertex 1 0 0\n   \
                        vertex 0 1e0 0\n  endloop\n endfacet\nendsolid a b\n";

    #[test]
    fn text_and_binary_agree() {
        let mut binary = vec![b' '; 80];
        binary.extend(1u32.to_le_bytes());
        let numbers: [f32; 12] = [0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0];
        binary.extend(numbers.iter().flat_map(|number| number.to_le_bytes()));
        binary.extend([0, 0]);
        // Programs write this word in binary files, too.
        binary[..5].copy_from_slice(b"solid");
        for bytes in [TEXT.as_bytes(), &binary] {
            let object = parse(bytes).unwrap();
            assert_eq!(object.positions, [DVec3::ZERO, DVec3::X, DVec3::Y]);
            assert_eq!(object.triangles, [[0, 1, 2]]);
        }
        binary.pop();
        assert!(parse(&binary).is_err());
    }

    #[test]
    fn lines_may_end_in_any_way() {
        let expected = parse(TEXT.as_bytes()).unwrap().positions;
        for end in ["\r\n", "\r", " ", "\t"] {
            let text = TEXT.replace('\n', end);
            assert_eq!(parse(text.as_bytes()).unwrap().positions, expected, "{end:?}");
        }
        let two = format!("{TEXT}{TEXT}").replace('\n', " ");
        assert_eq!(parse(two.as_bytes()).unwrap().positions.len(), 6);
        let none = parse(b"solid a\nendsolid a\n").unwrap_err();
        assert_eq!(none.message, "expected triangles, found none");
    }

    #[test]
    fn faults_are_told_with_their_lines() {
        let fails = |text: &str| parse(text.as_bytes()).unwrap_err();
        assert_eq!(fails(&TEXT.replace("1e0", "x")).line, Some(6));
        assert_eq!(fails(&TEXT.replace("   vertex 1 0 0\n", "")).line, Some(6));
        assert_eq!(fails(&TEXT.replace(" facet", " face")).line, Some(2));
        assert!(fails("").message.contains("expected an STL file"));
    }
}
