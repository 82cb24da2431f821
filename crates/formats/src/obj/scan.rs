//! What an OBJ file contains, without building its triangles.
//!
//! The scan accepts everything: the shape `mesh` reports malformed statements with their lines.

use super::decoded;
use crate::mesh_file::{Sides, fan_covers_more};
use std::collections::{BTreeMap, HashMap};
use whitstone_core::DVec3;

/// Contents of an OBJ file.
#[derive(Clone, Debug, Default)]
pub(super) struct Scan {
    /// `mtllib` statements: line from 1, and text.
    pub(super) libraries: Vec<(usize, String)>,
    /// Names of the materials that have faces, in the order of their first face; "" without a
    /// `usemtl`.
    pub(super) parts: Vec<String>,
    /// Whether some `v` has a colour.
    pub(super) colors: bool,
    /// Whether some face has texture coordinates.
    pub(super) uvs: bool,
    /// Whether some face has normals.
    pub(super) normals: bool,
    /// The sides of faces and of their normals.
    pub(super) sides: Sides,
    /// Number of triangles of all faces.
    pub(super) triangles: u64,
    /// The bounds of all vertices of faces, in metres; empty (low > high) without faces.
    pub(super) low: DVec3,
    pub(super) high: DVec3,
    /// Features to report: the name and the first line.
    pub(super) noted: BTreeMap<&'static str, usize>,
}

/// Scans the bytes of a file.
pub(super) fn scan(bytes: &[u8]) -> Scan {
    let mut scan = Scan {
        low: DVec3::INFINITY,
        high: DVec3::NEG_INFINITY,
        ..Scan::default()
    };
    let mut positions: Vec<DVec3> = Vec::new();
    // Those of the face of a line.
    let mut corners: Vec<DVec3> = Vec::new();
    // Vertices that faces name before they are there.
    let mut later: Vec<usize> = Vec::new();
    let mut parts: HashMap<String, ()> = HashMap::new();
    let (mut material, mut material_is_new) = (String::new(), true);
    // Lines of the `vn`, which are read only for the first faces.
    let mut normals: Vec<&[u8]> = Vec::new();
    let mut of_corners: Vec<DVec3> = Vec::new();
    let mut smooth = None;
    let bytes = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
    let mut lines = bytes.split(|&byte| byte == b'\n').zip(1..);
    while let Some((whole, number)) = lines.next() {
        let mut joined = Vec::new();
        let mut line = whole.trim_ascii();
        // A trailing backslash continues the line.
        if line.ends_with(b"\\") {
            joined.extend_from_slice(line);
            while joined.last() == Some(&b'\\') {
                joined.pop();
                joined.push(b' ');
                let Some((more, _)) = lines.next() else { break };
                joined.extend_from_slice(more.trim_ascii());
            }
            line = &joined;
        }
        let keyword = line.split(u8::is_ascii_whitespace).next().unwrap_or_default();
        let rest = || decoded(line[keyword.len()..].trim_ascii()).into_owned();
        match keyword {
            b"v" => {
                let text = rest();
                let mut values = numbers(&text);
                let xyz = DVec3::new(
                    values.next().unwrap_or(f64::NAN),
                    values.next().unwrap_or(f64::NAN),
                    values.next().unwrap_or(f64::NAN),
                );
                positions.push(xyz);
                scan.colors |= values.count() >= 3;
            }
            b"vn" => normals.push(whole),
            b"f" => {
                let mut count = 0_u64;
                corners.clear();
                of_corners.clear();
                for word in rest()
                    .split('#')
                    .next()
                    .unwrap_or_default()
                    .split_ascii_whitespace()
                {
                    let mut indices = word.split('/');
                    let index = indices.next().and_then(|text| text.parse::<i64>().ok());
                    scan.uvs |= indices.next().is_some_and(|text| !text.is_empty());
                    let normal = indices.next().unwrap_or_default();
                    scan.normals |= !normal.is_empty();
                    count += 1;
                    let place = |index: Option<i64>, length: usize| match index? {
                        index @ 1.. => usize::try_from(index - 1).ok(),
                        index => usize::try_from(length as i64 + index).ok(),
                    };
                    if !normal.is_empty()
                        && !scan.sides.full()
                        && let Some(line) =
                            place(normal.parse().ok(), normals.len()).and_then(|place| normals.get(place))
                    {
                        of_corners.push(normal_of(line));
                    }
                    let Some(place) = place(index, positions.len()) else {
                        continue;
                    };
                    let Some(position) = positions.get(place) else {
                        later.push(place);
                        continue;
                    };
                    if position.is_finite() {
                        corners.push(*position);
                        scan.low = scan.low.min(*position);
                        scan.high = scan.high.max(*position);
                    }
                }
                scan.triangles += count.saturating_sub(2);
                if corners.len() as u64 == count && of_corners.len() as u64 == count {
                    scan.sides.add(&corners, &of_corners);
                }
                if corners.len() as u64 == count && fan_covers_more(&corners) {
                    scan.noted.entry("concave faces").or_insert(number);
                }
                if material_is_new {
                    material_is_new = false;
                    if parts.insert(material.clone(), ()).is_none() {
                        scan.parts.push(material.clone());
                    }
                }
            }
            b"usemtl" => (material, material_is_new) = (rest(), true),
            b"mtllib" => scan.libraries.push((number, rest())),
            b"s" => {
                if !matches!(rest().as_str(), "off" | "0") {
                    smooth.get_or_insert(number);
                }
            }
            b"" | b"vt" | b"g" | b"o" => {}
            _ if keyword.starts_with(b"#") => {}
            b"p" | b"l" => {
                scan.noted.entry("p, l").or_insert(number);
            }
            b"vp" | b"cstype" | b"deg" | b"bmat" | b"step" | b"curv" | b"curv2" | b"surf" | b"parm"
            | b"trim" | b"hole" | b"scrv" | b"sp" | b"end" | b"con" => {
                scan.noted.entry("curv, surf").or_insert(number);
            }
            _ => {
                scan.noted.entry("other statements").or_insert(number);
            }
        }
    }
    for position in later.into_iter().filter_map(|place| positions.get(place)) {
        if position.is_finite() {
            scan.low = scan.low.min(*position);
            scan.high = scan.high.max(*position);
        }
    }
    if let Some(line) = smooth.filter(|_| normals.is_empty()) {
        scan.noted.insert("s", line);
    }
    scan
}

/// The vector of a `vn` line; 0 if it is malformed.
fn normal_of(line: &[u8]) -> DVec3 {
    let text = decoded(line.trim_ascii());
    let values: Vec<f64> = numbers(text.trim_start_matches("vn")).take(3).collect();
    <[f64; 3]>::try_from(values).map_or(DVec3::ZERO, DVec3::from)
}

fn numbers(text: &str) -> impl Iterator<Item = f64> {
    let text = text.split('#').next().unwrap_or_default();
    text.split_ascii_whitespace().map_while(|word| word.parse().ok())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn materials_with_faces_and_the_bounds_of_faces_are_found() {
        let text = "mtllib a b.mtl\ns 1\nv 0 0 0\nv 1 0 \\\n 0 1 0.5 0\nv 0 2 0\nv 9 9 9\nf 1 2 3\n\
                    usemtl none\nusemtl red\nf -4/1 -3/1 -2/1 #x\nusemtl blue\nf 1 2 3\nusemtl red\nf 1 2 3\nl 1 2\n";
        let scan = scan(text.as_bytes());
        assert_eq!(scan.libraries, [(1, "a b.mtl".to_owned())]);
        assert_eq!(scan.parts, ["", "red", "blue"]);
        assert_eq!((scan.low, scan.high), (DVec3::ZERO, DVec3::new(1.0, 2.0, 0.0)));
        assert!(scan.colors && scan.uvs);
        assert_eq!(scan.noted, BTreeMap::from([("p, l", 16), ("s", 2)]));
        let before = super::scan(b"v -1 0 0\nf 1 2 -1\nv 0 2 0\n");
        assert_eq!(
            (before.low, before.high),
            (DVec3::NEG_X, DVec3::new(0.0, 2.0, 0.0))
        );
    }

    #[test]
    fn concave_faces_are_noted_where_their_triangles_cover_more() {
        let noted = |faces: &str| {
            let vertices = "v 0 0 0\nv 4 0 0\nv 1 1 0\nv 0 4 0\nv 4 4 0\n";
            scan(format!("{vertices}{faces}").as_bytes()).noted
        };
        // The triangles of the second face meet at its first corner and do not overlap.
        let good = "f 1 2 5 4\nf 1 2 3 4\nf 4 5 2 1\nf 1 2 3\nf 3 2 1 9\n";
        assert_eq!(noted(good), BTreeMap::new());
        let concave = format!("{good}f 2 3 4 1\nf 1 4 3 2\nf 2/1 1/1 4/1 3/1\n");
        assert_eq!(noted(&concave), BTreeMap::from([("concave faces", 11)]));
    }

    #[test]
    fn names_that_are_not_utf_8_stay_different() {
        let scan = scan(b"usemtl gr\xfcn\nf 1 2 3\nusemtl  gr\xe4n\t\nf 1 2 3\nusemtl \xc3\xa0\nf 1 2 3\n");
        assert_eq!(scan.parts, ["gr\u{fc}n", "gr\u{e4}n", "\u{e0}"]);
    }

    #[test]
    fn garbage_is_scanned() {
        let garbage: Vec<u8> = (0..1_u32 << 20)
            .map(|i| (i.wrapping_mul(2_654_435_761) >> 24) as u8)
            .collect();
        assert!(scan(&garbage).parts.len() <= 1);
        let huge = scan(b"v 1e999 0 0\nv nan 0 0\nf 1 2 99999999999999999999 -9223372036854775808\n");
        assert!(huge.low.x > huge.high.x);
    }
}
