//! Wavefront OBJ: `v`, `vt`, `vn` and `f`, and `usemtl` for parts; everything else is ignored.
//!
//! Hand-written because the existing libraries return groups as separate meshes in single
//! precision, lose the line number of an error, and misalign corners if only some have a normal.

use super::{FileError, Triangles, fan, shorten};
use std::borrow::Cow;
use std::collections::HashMap;
use std::str::SplitAsciiWhitespace;
use whitstone_core::{DVec2, DVec3};

/// Position, texture coordinates and normal of a corner: indices from 0.
type Corner = (u32, Option<u32>, Option<u32>);

/// What to read of a file.
#[derive(Clone, Copy, Default)]
pub(super) struct Request<'a> {
    /// Only the faces under `usemtl` with this name; the empty name for those before any.
    pub(super) part: Option<&'a str>,
    /// Whether to read vertex colours.
    pub(super) colors: bool,
}

#[derive(Default)]
struct File<'a> {
    request: Request<'a>,
    /// Whether the current faces belong to the part.
    skips: bool,
    positions: Vec<DVec3>,
    /// Linear RGB, as many as positions if they are requested.
    colors: Vec<[f64; 3]>,
    uvs: Vec<DVec2>,
    normals: Vec<DVec3>,
    corners: Vec<Corner>,
    /// The line of each polygon, and the end of its corners.
    polygons: Vec<(usize, usize)>,
}

pub(super) fn parse(bytes: &[u8], request: Request<'_>) -> Result<Triangles, FileError> {
    let mut file = File {
        request,
        skips: request.part.is_some_and(|part| !part.is_empty()),
        ..File::default()
    };
    // Skip a byte order mark.
    let bytes = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
    let mut lines = bytes.split(|&byte| byte == b'\n').zip(1..);
    while let Some((line, number)) = lines.next() {
        let mut line = Cow::Borrowed(line.trim_ascii());
        // A trailing backslash continues the line.
        while line.last() == Some(&b'\\') {
            let line = line.to_mut();
            line.pop();
            line.push(b' ');
            let Some((more, _)) = lines.next() else { break };
            line.extend_from_slice(more.trim_ascii());
        }
        file.statement(&line, number)?;
    }
    file.triangles()
}

impl File<'_> {
    fn statement(&mut self, line: &[u8], number: usize) -> Result<(), FileError> {
        // Comments may be in any encoding.
        let keyword = line.split(u8::is_ascii_whitespace).next();
        if let (Some(b"usemtl"), Some(part)) = (keyword, self.request.part) {
            let name = line.strip_prefix(b"usemtl").unwrap_or_default().trim_ascii();
            self.skips = decoded(name) != part;
        }
        if !matches!(keyword, Some(b"v" | b"vt" | b"vn" | b"f")) {
            return Ok(());
        }
        let text = std::str::from_utf8(line).map_err(|_| FileError::at(number, "expected UTF-8 text"))?;
        // A comment may follow on the same line.
        let text = text.split('#').next().unwrap_or_default();
        let mut words = text.split_ascii_whitespace();
        match words.next() {
            Some("v") => {
                self.positions.push(numbers::<3>(&mut words, 3, number)?.into());
                if self.request.colors {
                    let words: Vec<f64> = words.map_while(|word| word.parse().ok()).collect();
                    self.colors.push(match words[..] {
                        [r, g, b, ..] if [r, g, b].iter().all(|part| part.is_finite() && *part >= 0.0) => {
                            [r, g, b]
                        }
                        _ => [1.0; 3],
                    });
                }
            }
            Some("vn") => self.normals.push(numbers::<3>(&mut words, 3, number)?.into()),
            Some("vt") => self.uvs.push(numbers::<2>(&mut words, 1, number)?.into()),
            _ => {
                let first = self.corners.len();
                for word in words {
                    let corner = self.corner(word).ok_or_else(|| {
                        let expected = "expected a corner as v, v/vt, v//vn or v/vt/vn in whole numbers";
                        FileError::at(
                            number,
                            format!("{expected} other than 0, found \"{}\"", shorten(word)),
                        )
                    })?;
                    self.corners.push(corner);
                }
                let count = self.corners.len() - first;
                if count < 3 {
                    let message = format!("expected a face of at least 3 corners, found {count}");
                    return Err(FileError::at(number, message));
                }
                if self.skips {
                    self.corners.truncate(first);
                } else {
                    self.polygons.push((number, self.corners.len()));
                }
            }
        }
        Ok(())
    }

    fn corner(&self, word: &str) -> Option<Corner> {
        let mut parts = word.split('/');
        let v = index(parts.next()?, self.positions.len())?;
        let mut optional = |count| match parts.next() {
            None | Some("") => Some(None),
            Some(text) => index(text, count).map(Some),
        };
        let (vt, vn) = (optional(self.uvs.len())?, optional(self.normals.len())?);
        parts.next().is_none().then_some((v, vt, vn))
    }

    /// Merges corners with equal indices into one vertex.
    fn triangles(self) -> Result<Triangles, FileError> {
        let with_uvs = self.corners.iter().any(|corner| corner.1.is_some());
        let with_normals = self.corners.iter().any(|corner| corner.2.is_some());
        let mut object = Triangles::default();
        let mut vertices: HashMap<Corner, u32> = HashMap::new();
        let mut polygon = Vec::new();
        let mut first = 0;
        for &(line, end) in &self.polygons {
            polygon.clear();
            let corners = &self.corners[first..end];
            // A face has normals or texture coordinates only if all its corners do.
            let has_uvs = corners.iter().all(|corner| corner.1.is_some());
            let has_normals = corners.iter().all(|corner| corner.2.is_some());
            for &(v, vt, vn) in corners {
                check(v, self.positions.len(), "vertex", line)?;
                vt.map_or(Ok(()), |vt| check(vt, self.uvs.len(), "texture vertex", line))?;
                vn.map_or(Ok(()), |vn| check(vn, self.normals.len(), "normal", line))?;
                let (vt, vn) = (vt.filter(|_| has_uvs), vn.filter(|_| has_normals));
                let next = object.positions.len() as u32;
                let vertex = *vertices.entry((v, vt, vn)).or_insert(next);
                if vertex == next {
                    object.positions.push(self.positions[v as usize]);
                    if let Some([r, g, b]) = self.colors.get(v as usize) {
                        object.attributes.colors.push([*r, *g, *b, 1.0]);
                    }
                    if with_uvs {
                        object
                            .uvs
                            .push(vt.map_or(DVec2::ZERO, |vt| self.uvs[vt as usize]));
                    }
                    if with_normals {
                        object
                            .normals
                            .push(vn.map_or(DVec3::ZERO, |vn| self.normals[vn as usize]));
                    }
                }
                polygon.push(vertex);
            }
            object.triangles.extend(fan(&polygon));
            first = end;
        }
        Ok(object)
    }
}

/// A name, which may be in any encoding: UTF-8, else each byte is a character of Latin-1.
fn decoded(name: &[u8]) -> Cow<'_, str> {
    match std::str::from_utf8(name) {
        Ok(text) => Cow::Borrowed(text),
        Err(_) => name.iter().map(|&byte| char::from(byte)).collect(),
    }
}

/// Converts an index that counts from 1, or backwards from -1 for the latest definition, to one
/// from 0. The upper limit is checked at the end of the file, the lower one here.
fn index(text: &str, count: usize) -> Option<u32> {
    let index: i64 = text.parse().ok()?;
    match index {
        0 => None,
        1.. => u32::try_from(index - 1).ok(),
        // An index before the first definition becomes one that is out of range everywhere.
        _ => Some(u32::try_from(count as i64 + index).unwrap_or(u32::MAX)),
    }
}

fn check(index: u32, count: usize, what: &str, line: usize) -> Result<(), FileError> {
    if (index as usize) < count {
        return Ok(());
    }
    let found = if index == u32::MAX {
        "one before the first".to_owned()
    } else {
        format!("{}", index + 1)
    };
    Err(FileError::at(
        line,
        format!("expected one of the file's {count} {what} numbers, found {found}"),
    ))
}

/// Parses up to N finite numbers, at least `required`; missing ones are zero, further text is
/// ignored.
fn numbers<const N: usize>(
    words: &mut SplitAsciiWhitespace<'_>,
    required: usize,
    line: usize,
) -> Result<[f64; N], FileError> {
    let mut values = [0.0; N];
    for (i, value) in values.iter_mut().enumerate() {
        let Some(word) = words.next() else {
            if i >= required {
                break;
            }
            return Err(FileError::at(
                line,
                format!("expected {required} numbers, found {i}"),
            ));
        };
        *value = word.parse().ok().filter(|x: &f64| x.is_finite()).ok_or_else(|| {
            FileError::at(
                line,
                format!("expected a finite number, found \"{}\"", shorten(word)),
            )
        })?;
    }
    Ok(values)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse_all(bytes: &[u8]) -> Result<Triangles, FileError> {
        parse(bytes, Request::default())
    }

    fn fails(text: &str) -> (Option<usize>, String) {
        let error = parse_all(text.as_bytes()).unwrap_err();
        (error.line, error.message)
    }

    #[test]
    fn polygons_become_fans_and_corners_are_merged() {
        let text = "# caf\u{e9}\nv 0 0 0\nv 1 0 0\nv 1 1 0 1\nv 0 1 0\nvn 0 0 1\nvn 0 0 -1\nvt 0.5\n\
                    g a\nf 1//1 2//1 3//1 4//1\nusemtl b\nf -4//1 -3//1 \\\n -2//2\nf 1/1 2/1 3/1\n";
        let object = parse_all(text.as_bytes()).unwrap();
        assert_eq!(object.triangles, [[0, 1, 2], [0, 2, 3], [0, 1, 4], [5, 6, 7]]);
        assert_eq!(object.normals[4], DVec3::NEG_Z);
        assert_eq!(object.uvs[5], DVec2::new(0.5, 0.0));
        assert_eq!(object.positions[4], DVec3::new(1.0, 1.0, 0.0));
    }

    #[test]
    fn a_byte_order_mark_hides_no_vertex() {
        let text = "\u{feff}v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";
        assert_eq!(parse_all(text.as_bytes()).unwrap().positions.len(), 3);
    }

    #[test]
    fn faces_without_a_normal_or_coordinate_at_each_corner_have_none() {
        let text = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvn 0 0 1\nvt 0.5 0.5\nf 1 2 3\nf 1//1 2 3\n\
                    f 1/1/1 2//1 3/1/1\nf 1/1/1 2/1 3/1/1\n";
        let object = parse_all(text.as_bytes()).unwrap();
        let expected = [[0, 1, 2], [0, 1, 2], [3, 4, 5], [6, 7, 8]];
        assert_eq!(object.triangles, expected);
        let flat = object.normals.iter().map(|normal| *normal == DVec3::ZERO);
        assert!(flat.eq([true, true, true, false, false, false, true, true, true]));
        let origin = object.uvs.iter().map(|uv| *uv == DVec2::ZERO);
        assert!(origin.eq([true, true, true, true, true, true, false, false, false]));
        // Indices that have no effect are still checked.
        assert_eq!(fails(&format!("{text}f 1//2 2 3\n")).0, Some(10));
    }

    #[test]
    fn names_that_are_not_utf_8_are_latin_1() {
        let text = b"v 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl gr\xfcn\nf 1 2 3\nusemtl gr\xe0\nf 2 3 1\nf 3 1 2\n\
                     usemtl \xc3\xa0\nf 1 2 3\n";
        let count = |part| {
            let request = Request {
                part: Some(part),
                colors: false,
            };
            parse(text, request).unwrap().triangles.len()
        };
        assert_eq!(["gr\u{fc}n", "gr\u{e0}", "\u{e0}"].map(count), [1, 2, 1]);
    }

    #[test]
    fn faults_are_told_with_their_line() {
        let start = "v 0 0 0\nv 1 0 0\nv 0 1 0\n";
        assert_eq!(fails("v 0 0\n").0, Some(1));
        assert_eq!(fails("v 0 0 nan\n").1, "expected a finite number, found \"nan\"");
        assert_eq!(fails("\nv 0 0 1e999\n").0, Some(2));
        let out_of_range = "expected one of the file's 3 vertex numbers, found";
        assert_eq!(
            fails(&format!("{start}f 1 2 4\n")),
            (Some(4), format!("{out_of_range} 4"))
        );
        assert_eq!(
            fails(&format!("{start}f 1 2 -4\n")),
            (Some(4), format!("{out_of_range} one before the first"))
        );
        for corner in [
            "0",
            "1/2/3/4",
            "x",
            "99999999999",
            "1.5",
            "9223372036854775808",
            "/1",
        ] {
            assert_eq!(fails(&format!("{start}f 1 2 {corner}\n")).0, Some(4), "{corner}");
        }
        assert_eq!(
            fails(&format!("{start}f 1 2\n")).1,
            "expected a face of at least 3 corners, found 2"
        );
        assert_eq!(
            parse_all(b"v \xff 0 0").unwrap_err().message,
            "expected UTF-8 text"
        );
    }
}
