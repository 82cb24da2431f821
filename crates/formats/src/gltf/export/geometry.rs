//! The triangles of shapes that consist of triangles, in object space and single precision.

use crate::table;
use crate::triangles::{Missing, built};
use std::path::Path;
use toml::Table;
use whitstone_core::{DVec2, DVec3, TriangleMesh};

/// Largest number of triangles of a shape.
const MAX_TRIANGLES: usize = 1 << 25;
/// Triangles. There are as many of each vertex attribute as positions, or none.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Triangles {
    pub(super) positions: Vec<[f32; 3]>,
    pub(super) normals: Vec<[f32; 3]>,
    /// Two sets of texture coordinates, v pointing down.
    pub(super) uvs: [Vec<[f32; 2]>; 2],
    pub(super) colors: Vec<[f32; 4]>,
    pub(super) tangents: Vec<[f32; 4]>,
    pub(super) indices: Vec<[u32; 3]>,
}

/// The triangles of a shape.
pub(super) fn triangles(shape: &Table, base: &Path) -> Result<Triangles, Missing> {
    let found = match table::kind(shape) {
        "rectangle" => rectangle(),
        "box" => cuboid(),
        "triangle" => triangle(shape)?,
        "polygon" => polygon(shape)?,
        "mesh" | "heightfield" => of_mesh(&built(shape, base)?),
        _ => return Err(Missing::Curved),
    };
    if found.indices.len() > MAX_TRIANGLES {
        return Err(Missing::Faulty(format!(
            "has {} triangles, more than {MAX_TRIANGLES}",
            found.indices.len()
        )));
    }
    let finite = found.positions.iter().flatten().all(|part| part.is_finite())
        && found.uvs.iter().flatten().flatten().all(|part| part.is_finite())
        && found.colors.iter().flatten().all(|part| part.is_finite());
    if !finite {
        return Err(Missing::Faulty(
            "has numbers that single precision cannot hold".to_owned(),
        ));
    }
    if found.colors.iter().flatten().any(|part| *part > 1.0) {
        return Err(Missing::Faulty("has vertex colours above 1".to_owned()));
    }
    Ok(found)
}

fn rectangle() -> Triangles {
    let corners = [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]];
    Triangles {
        positions: corners.map(|[x, y]| [x, y, 0.0]).to_vec(),
        uvs: [
            corners.map(|[x, y]| [(x + 1.0) / 2.0, (1.0 - y) / 2.0]).to_vec(),
            Vec::new(),
        ],
        indices: vec![[0, 1, 2], [0, 2, 3]],
        ..Triangles::default()
    }
}

fn cuboid() -> Triangles {
    let mut found = Triangles::default();
    for face in 0..6 {
        let (axis, side) = (face / 2, if face % 2 == 0 { -1.0 } else { 1.0 });
        let (b, c) = ((axis + 1) % 3, (axis + 2) % 3);
        let start = found.positions.len() as u32;
        for [p, q] in [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]] {
            let mut position = [0.0; 3];
            position[axis] = side;
            position[b] = p;
            position[c] = q;
            found.positions.push(position);
            found.uvs[0].push([(p + 1.0) / 2.0, (1.0 - q) / 2.0]);
        }
        let quads: [[u32; 3]; 2] = if side > 0.0 {
            [[0, 1, 2], [0, 2, 3]]
        } else {
            [[0, 2, 1], [0, 3, 2]]
        };
        found
            .indices
            .extend(quads.map(|corners| corners.map(|corner| start + corner)));
    }
    found
}

/// Lists of numbers, such as points.
fn points<const N: usize>(shape: &Table, key: &str) -> Option<Vec<[f64; N]>> {
    let list = shape.get(key)?.as_array()?;
    list.iter()
        .map(|point| table::numbers(point)?.try_into().ok())
        .collect()
}

fn single<const N: usize>(values: &[[f64; N]]) -> Vec<[f32; N]> {
    values.iter().map(|value| value.map(|part| part as f32)).collect()
}

/// Texture coordinates with v pointing down.
fn down(uv: [f64; 2]) -> [f32; 2] {
    [uv[0] as f32, (1.0 - uv[1]) as f32]
}

fn faulty(message: &str) -> Missing {
    Missing::Faulty(message.to_owned())
}

fn triangle(shape: &Table) -> Result<Triangles, Missing> {
    let vertices = points::<3>(shape, "vertices").filter(|vertices| vertices.len() == 3);
    let vertices = vertices.ok_or_else(|| faulty("has no three vertices"))?;
    let normals = points::<3>(shape, "normals").filter(|normals| normals.len() == 3);
    let normals: Vec<[f64; 3]> = normals
        .into_iter()
        .flatten()
        .map(|normal| DVec3::from(normal).normalize_or(DVec3::Z).to_array())
        .collect();
    let uvs = points::<2>(shape, "uvs").filter(|uvs| uvs.len() == 3);
    let uvs = uvs.unwrap_or_else(|| vec![[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]);
    Ok(Triangles {
        positions: single(&vertices),
        normals: single(&normals),
        uvs: [uvs.into_iter().map(down).collect(), Vec::new()],
        indices: vec![[0, 1, 2]],
        ..Triangles::default()
    })
}

fn polygon(shape: &Table) -> Result<Triangles, Missing> {
    let vertices: Vec<[f64; 3]> = points(shape, "vertices").unwrap_or_default();
    if vertices.len() < 3 {
        return Err(faulty("has fewer than three vertices"));
    }
    let corners: Vec<DVec3> = vertices.iter().copied().map(DVec3::from).collect();
    let middle = corners.iter().sum::<DVec3>() / corners.len() as f64;
    let normal: DVec3 = (0..corners.len())
        .map(|k| (corners[k] - middle).cross(corners[(k + 1) % corners.len()] - middle))
        .sum();
    let largest = normal.abs().max_element();
    let axis = (0..3)
        .find(|axis| normal[*axis].abs() >= largest * (1.0 - 1e-9))
        .unwrap_or(2);
    let (b, c) = ((axis + 1) % 3, (axis + 2) % 3);
    let flat: Vec<DVec2> = corners.iter().map(|p| DVec2::new(p[b], p[c])).collect();
    Ok(Triangles {
        positions: single(&vertices),
        uvs: [
            flat.iter().map(|point| down(point.to_array())).collect(),
            Vec::new(),
        ],
        indices: cut(&flat, normal[axis].signum()),
        ..Triangles::default()
    })
}

/// Cuts a simple polygon into triangles: ears, one after another. `turn` is 1 if the polygon runs
/// counter-clockwise, else -1.
fn cut(points: &[DVec2], turn: f64) -> Vec<[u32; 3]> {
    let area = |a: u32, b: u32, c: u32| {
        let [a, b, c] = [a, b, c].map(|k| points[k as usize]);
        turn * (b - a).perp_dot(c - a)
    };
    let mut rest: Vec<u32> = (0..points.len() as u32).collect();
    let mut triangles = Vec::with_capacity(points.len().saturating_sub(2));
    let mut start = 0;
    while rest.len() > 3 {
        let count = rest.len();
        let corner = |k: usize| rest[k % count];
        // Only corners that turn inwards can lie in an ear.
        let inward: Vec<u32> = (0..count)
            .filter(|k| area(corner(k + count - 1), corner(*k), corner(k + 1)) <= 0.0)
            .map(corner)
            .collect();
        let is_ear = |k: usize| {
            let (a, b, c) = (corner(k + count - 1), corner(k), corner(k + 1));
            area(a, b, c) > 0.0
                && inward.iter().all(|p| {
                    [a, b, c].contains(p)
                        || area(a, b, *p) < 0.0
                        || area(b, c, *p) < 0.0
                        || area(c, a, *p) < 0.0
                })
        };
        // Rounding may leave no ear; a corner without area is then cut, or any.
        let ear = (0..count)
            .map(|k| (start + k) % count)
            .find(|k| is_ear(*k))
            .or_else(|| (0..count).find(|k| area(corner(k + count - 1), corner(*k), corner(k + 1)) == 0.0))
            .unwrap_or(0);
        triangles.push([corner(ear + count - 1), corner(ear), corner(ear + 1)]);
        rest.remove(ear);
        start = ear;
    }
    if let [a, b, c] = rest[..] {
        triangles.push([a, b, c]);
    }
    triangles
}

fn of_mesh(mesh: &TriangleMesh) -> Triangles {
    let vectors = |list: &[DVec3]| -> Vec<[f32; 3]> { list.iter().map(|v| v.as_vec3().to_array()).collect() };
    let flipped = |list: &[DVec2]| -> Vec<[f32; 2]> { list.iter().map(|uv| down(uv.to_array())).collect() };
    let mut found = Triangles {
        positions: vectors(&mesh.positions),
        normals: vectors(&mesh.normals),
        uvs: [flipped(&mesh.uvs), Vec::new()],
        indices: mesh.triangles.clone(),
        ..Triangles::default()
    };
    if let Some(attributes) = &mesh.attributes {
        found.uvs[1] = flipped(&attributes.second_uvs);
        found.colors = single(&attributes.colors);
        found.tangents = attributes
            .tangents
            .iter()
            .map(|tangent| {
                let [x, y, z] = tangent.normalize_or(DVec3::X).as_vec3().to_array();
                [x, y, z, 1.0]
            })
            .collect();
        // The sign of a triangle is that of its first vertex; other vertices have one of theirs.
        for corners in [1..3, 0..1] {
            for (triangle, sign) in mesh.triangles.iter().zip(&attributes.handedness) {
                for corner in &triangle[corners.clone()] {
                    if let Some(tangent) = found.tangents.get_mut(*corner as usize) {
                        tangent[3] = *sign as f32;
                    }
                }
            }
        }
    }
    with_normals(&mut found);
    found
}

/// Gives corners without a normal that of their triangle, as vertices of their own: all normals of
/// a glTF file have unit length.
fn with_normals(triangles: &mut Triangles) {
    if !triangles.normals.contains(&[0.0; 3]) {
        return;
    }
    let mut indices = std::mem::take(&mut triangles.indices);
    for corners in &mut indices {
        let [a, b, c] = corners.map(|k| DVec3::from(triangles.positions[k as usize].map(f64::from)));
        let normal = (b - a).cross(c - a).normalize_or(DVec3::Z).as_vec3().to_array();
        for corner in corners {
            let k = *corner as usize;
            if triangles.normals[k] != [0.0; 3] {
                continue;
            }
            *corner = triangles.positions.len() as u32;
            triangles.positions.push(triangles.positions[k]);
            triangles.normals.push(normal);
            for set in &mut triangles.uvs {
                repeat(set, k);
            }
            repeat(&mut triangles.colors, k);
            repeat(&mut triangles.tangents, k);
        }
    }
    triangles.indices = indices;
    // Vertices that no triangle uses any more.
    for normal in &mut triangles.normals {
        if *normal == [0.0; 3] {
            *normal = [0.0, 0.0, 1.0];
        }
    }
}

fn repeat<T: Copy>(list: &mut Vec<T>, k: usize) {
    if let Some(value) = list.get(k).copied() {
        list.push(value);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::TAU;
    use toml::Value;

    fn area(triangles: &Triangles) -> f64 {
        let corner = |k: u32| DVec3::from(triangles.positions[k as usize].map(f64::from));
        let areas = triangles
            .indices
            .iter()
            .map(|[a, b, c]| (corner(*b) - corner(*a)).cross(corner(*c) - corner(*a)).length() / 2.0);
        areas.sum()
    }

    #[test]
    fn faces_of_a_box_point_outwards() {
        let found = cuboid();
        assert!((area(&found) - 24.0).abs() < 1e-12);
        for corners in &found.indices {
            let [a, b, c] = corners.map(|k| DVec3::from(found.positions[k as usize].map(f64::from)));
            assert!((b - a).cross(c - a).dot(a + b + c) > 0.0);
        }
    }

    #[test]
    fn concave_polygons_keep_their_area() {
        // A comb, in the plane x = 1, both ways round.
        let mut comb: Vec<[f64; 2]> = vec![[0.0, 0.0], [5.0, 0.0]];
        for tooth in (0..5).rev() {
            let at = f64::from(tooth);
            comb.extend([[at + 0.8, 3.0], [at + 0.4, 3.0], [at + 0.2, 1.0]]);
        }
        let twice: f64 = (0..comb.len())
            .map(|k| DVec2::from(comb[k]).perp_dot(comb[(k + 1) % comb.len()].into()))
            .sum();
        for reversed in [false, true] {
            let mut corners = comb.clone();
            if reversed {
                corners.reverse();
            }
            let list = corners
                .iter()
                .map(|[y, z]| crate::document::numbers([1.0, *y, *z]));
            let shape = crate::document::typed("polygon", [("vertices", Value::Array(list.collect()))]);
            let found = polygon(&shape).unwrap();
            assert_eq!(found.indices.len(), comb.len() - 2);
            assert!((area(&found) - twice / 2.0).abs() < 1e-6, "{}", area(&found));
            for [a, b, c] in &found.indices {
                let corner = |k: u32| DVec3::from(found.positions[k as usize].map(f64::from));
                let normal = (corner(*b) - corner(*a)).cross(corner(*c) - corner(*a));
                assert!(normal.x * if reversed { -1.0 } else { 1.0 } >= 0.0);
            }
        }
        // A circle.
        let circle: Vec<DVec2> = (0..4096)
            .map(|k| DVec2::from_angle(TAU * f64::from(k) / 4096.0))
            .collect();
        assert_eq!(cut(&circle, 1.0).len(), 4094);
    }

    #[test]
    fn corners_without_a_normal_get_that_of_their_triangle() {
        let mut found = Triangles {
            positions: vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
            normals: vec![[0.0; 3], [0.0; 3], [0.0, 0.0, 1.0], [0.0; 3]],
            uvs: [vec![[0.0, 0.0]; 4], Vec::new()],
            indices: vec![[0, 1, 2], [0, 3, 1]],
            ..Triangles::default()
        };
        with_normals(&mut found);
        assert_eq!(found.indices, [[4, 5, 2], [6, 7, 8]]);
        assert_eq!(found.normals[4], [0.0, 0.0, 1.0]);
        assert_eq!(found.normals[6], [0.0, 1.0, 0.0]);
        assert_eq!(found.uvs[0].len(), 9);
    }
}
